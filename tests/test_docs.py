"""README and docs/ say what is so: every block is executed or checked (see `doc_pages`), every link leads somewhere.

`python tests/test_docs.py` writes the messages of failing commands anew into the pages; read the difference before you
keep it. Numbers are not rewritten: where one has moved, find out why.
"""

from __future__ import annotations

import inspect
import os
import re
import runpy
import shutil
import sys
import tempfile
from pathlib import Path

import pytest
from collected import for_each
from doc_pages import PAGES, ROOT, PageRun, alike, blocks, rewrite

from benchmarks.diagnosis.reliability import known_rows
from heavebond.exchange.fmu_export import COMPILERS

LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
HEADING = re.compile(r"^#+\s+(.*)$", re.MULTILINE)
FENCED = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)


def _name(page: Path) -> str:
    return str(page.relative_to(ROOT))


OF_COMPONENTS = [page for page in PAGES if page.parent.parent.name == "components"]


@pytest.mark.long
@for_each("page", OF_COMPONENTS, ids=_name, parts=8)
def test_every_block_of_the_pages_of_components_is_so(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    found = PageRun(page).execute().found
    assert not found, "\n\n".join(found)


@pytest.mark.long
@pytest.mark.parametrize("page", [page for page in PAGES if page not in OF_COMPONENTS], ids=_name)
def test_every_block_of_a_page_is_so(page: Path, tmp_path: Path, studies_folder: Path, monkeypatch: pytest.MonkeyPatch
                                     ) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("COLUMNS", raising=False)
    if page.name in ("exchange.md", "real_time.md") and not any(shutil.which(name) for name in COMPILERS):
        pytest.skip("no C compiler is installed")
    found = PageRun(page, studies_folder).execute().found
    assert not found, "\n\n".join(found)


@for_each("page", [*PAGES, *ROOT.glob("*.md"), *ROOT.glob("models/**/*.md")], ids=_name)
def test_links_lead_somewhere(page: Path) -> None:
    for target in LINK.findall(FENCED.sub("", page.read_text(encoding="utf-8"))):
        if target.startswith(("http://", "https://")):
            continue
        path, _, anchor = target.partition("#")
        file = (page.parent / path) if path else page
        assert file.exists(), f"{_name(page)} links to {target}, which is not there"
        if anchor:
            assert anchor in _anchors(file), f"{_name(page)} links to {target}, a heading that is not there"


def _anchors(page: Path) -> set[str]:
    text = FENCED.sub("", page.read_text(encoding="utf-8"))
    return {re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in HEADING.findall(text)}


def test_every_page_is_reached_from_the_index() -> None:
    """By one link; tutorials and components by that of their own index."""
    indexes = [ROOT / "docs" / name / "index.md" for name in (".", "tutorials", "components")]
    linked = {(index.parent / target.partition("#")[0]).resolve()
              for index in indexes for target in LINK.findall(index.read_text("utf-8"))}
    assert {index.resolve() for index in indexes[1:]} <= linked
    linked |= {ROOT / "docs" / "index.md", ROOT / "README.md"}
    missing = [_name(page) for page in PAGES if page not in linked]
    assert not missing


@pytest.mark.slow
def test_pictures_can_be_drawn_anew(tmp_path: Path) -> None:
    """Studies and surfaces at few points; they are run in full by the pages and the tests of the studies."""
    drawing = runpy.run_path(str(ROOT / "docs" / "pictures" / "draw.py"))
    for draw in drawing["DRAWN"]:
        draw(tmp_path, **({"points": 2} if "points" in inspect.signature(draw).parameters else {}))
    there = {path.name for path in (ROOT / "docs" / "pictures").iterdir() if path.suffix in (".png", ".svg", ".gif")}
    there -= {"icon.svg"} if known_rows() else {"icon.svg", "reliability.png"}  # drawn from the rows of the study
    assert {path.name for path in tmp_path.iterdir()} == there


def test_pages_have_blocks_that_run() -> None:
    """A change of the marks must not turn every check off at once."""
    languages = [block.language for page in PAGES for block in blocks(page)]
    assert languages.count("console") >= 10
    assert languages.count("python") >= 3


@pytest.mark.parametrize(("wanted", "line", "same"), [
    ("place  mm  -50  50", "place    mm     -49.9999    50.0", True),
    ("place  mm  -50  50", "place    mm     -48    50", False),
    ("place  mm ...", "place    mm     -48    50", True),
    ("start 0.1 ...", "start 0.2 s; 30 steps", False),
    ("place  mm  -50", "place    mm     -50    50", False),
    ("place  mm", "pull  mm", False),
])
def test_lines_are_compared_with_tolerance(wanted: str, line: str, same: bool) -> None:
    assert alike(wanted, line) is same


if __name__ == "__main__":
    os.environ.pop("COLUMNS", None)
    for _page in PAGES:
        with tempfile.TemporaryDirectory() as folder:
            os.chdir(folder)
            run = PageRun(_page).execute()
            os.chdir(ROOT)
        rewrite(_page, run.said)
        print(f"{_name(_page)}: {len(run.said)} messages written anew, {len(run.found) - len(run.said)} other findings")
    sys.exit(0)
