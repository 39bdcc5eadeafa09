"""The site of docs/: every page has its place in the navigation, and what mkdocs makes of the pages needs no network."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import browser
import pytest
import yaml

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
ELSEWHERE = {"changelog.md", "contributing.md", "machines.md"}  # pages that stand outside docs/
FETCHED = (r'<(?:script|img|iframe)[^>]* src="(https?:[^"]+)',
           r'<link[^>]* rel="(?:stylesheet|preload)"[^>]* href="(https?:[^"]+)')


class _Loader(yaml.SafeLoader):
    """YAML with the tags of mkdocs, whose values are not needed here."""


_Loader.add_multi_constructor("tag:yaml.org,2002:python/", lambda loader, suffix, node: suffix)


def _places(nav: object) -> Iterator[str]:
    if isinstance(nav, str):
        yield nav
    for inner in nav.values() if isinstance(nav, dict) else nav if isinstance(nav, list) else ():
        yield from _places(inner)


def test_every_page_stands_in_the_navigation_once() -> None:
    nav = list(_places(yaml.load((ROOT / "mkdocs.yml").read_text("utf-8"), _Loader)["nav"]))
    assert len(nav) == len(set(nav))
    pages = {path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md")}
    pages = {page for page in pages if not re.fullmatch(r"components/\w+/(?!index)\w+\.md", page)}
    assert pages - set(nav) == set(), "these pages are in no entry of `nav` in mkdocs.yml"
    assert set(nav) - pages - ELSEWHERE == set(), "mkdocs.yml speaks of pages that are not there"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    run = subprocess.run([sys.executable, "-m", "mkdocs", "--quiet", "build", "--strict", "--site-dir", str(folder)],
                         cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    return folder


@pytest.mark.long
def test_formulas_are_mathml_and_nothing_is_fetched(site: Path) -> None:
    spring = (site / "components" / "translational" / "spring.html").read_text("utf-8")
    assert spring.count("<math") > 10 and "arithmatex" not in spring and "$$" not in spring
    for page in site.rglob("*.html"):
        text = page.read_text("utf-8")
        fetched = [url for pattern in FETCHED for url in re.findall(pattern, text)]
        assert not fetched, f"{page.relative_to(site)} asks for {fetched}"
        escaped = any(r"\_" in words for words in re.findall("<mtext>.*?</mtext>", text))
        tex = escaped or r"\begin{" in text or "merror" in text or re.search("<mi>&(amp;)?<", text)
        assert not tex, f"{page.relative_to(site)} shows TeX"


@pytest.mark.long
def test_files_that_pages_speak_of_can_be_read(site: Path) -> None:
    assert "Hooke" in (site / "files" / "components" / "translational" / "spring.yaml.html").read_text("utf-8")
    assert (site / "notebooks" / "first_machine.ipynb").is_file()
    assert not list(site.rglob("*.py"))


SEARCH = """(() => {
  const field = document.querySelector("[data-md-component=search-query]"), open = document.querySelector("#__search");
  open.checked = true;
  open.dispatchEvent(new Event("change"));
  field.focus();
  field.value = %r;
  field.dispatchEvent(new Event("keyup"));
})()"""
FOUND = """new Promise((done, failed) => { let left = 150; const look = () => {
  const found = [...document.querySelectorAll(".md-search-result__item a")].map(link => link.getAttribute("href"));
  if (found.length || !left--) done(found); else setTimeout(look, 100); }; look(); })"""


@pytest.mark.long
def test_the_search_works_from_the_folder(site: Path, tmp_path: Path) -> None:
    """Opened as a file, without a server; a page two folders down finds its way too."""
    if browser.browser() is None:
        pytest.skip("no browser is installed")
    tab = browser.Tab(tmp_path / "profile")
    try:
        for page, words, expected in (("index.html", "rainflow", "signals.html"),
                                      ("components/hydraulic/index.html", "index reduction", "theory.html")):
            tab.open(site / page)
            tab.run(SEARCH % words)
            assert any(expected in link for link in tab.run(FOUND)), page
        assert [url for url in tab.requested() if url.startswith("http")] == []
    finally:
        tab.close()
