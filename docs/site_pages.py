"""What turns the pages of docs/ into a site with mkdocs: formulas, and the files of the repository that pages speak of.

Pages are written so that they read well as files. A formula is TeX between dollar signs, and becomes MathML here, which
browsers draw by themselves: no script, no fonts, no network. A link to a file outside docs/ becomes a page that shows it.
"""

from __future__ import annotations

import html
import os
import posixpath
import re
from pathlib import Path

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parent.parent
# pages of the project that stand outside docs/, and where they are in the site
OUTSIDE = {"CHANGELOG.md": "changelog.md", "CONTRIBUTING.md": "contributing.md", "models/README.md": "machines.md",
           "README.md": "index.md"}
SHOWN = {".yaml": "yaml", ".py": "python", ".md": "markdown", ".csv": "text"}
LINK = re.compile(r"(?<!!)\[([^\]]*)\]\(([^)\s#:]+)(#[^)\s]*)?\)")
FENCED = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)
FORMULA = re.compile(r'<(span|div) class="arithmatex">\s*\\([(\[])(.*?)\\[)\]]\s*</\1>', re.DOTALL)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that stand outside docs/, and one for each file that a page links to."""
    for path, name in OUTSIDE.items():
        if name != "index.md":
            files.append(File.generated(config, name, content=(ROOT / path).read_text("utf-8")))
    for path in sorted(_spoken_of(files)):
        files.append(File.generated(config, _page_of(path), content=_shown(path)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Links and marks as the site needs them; a component's page leads back to its domain."""
    place = page.file.src_uri
    source = _source(place)
    parts = FENCED.split(markdown)
    fences = [re.sub(r"^```(\w+) fragment$", r"```\1", fence, flags=re.MULTILINE) for fence in FENCED.findall(markdown)]
    text = "".join(LINK.sub(lambda m: _link(m, source, place), part) + fence
                   for part, fence in zip(parts, [*fences, ""], strict=True))
    if re.fullmatch(r"components/\w+/(?!index)\w+\.md", place):
        domain = place.split("/")[1]
        text = text.replace("\n# ", f"\n[Components](../index.md) / [{domain}](index.md)\n\n# ", 1)
    return text


def on_page_content(content: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Formulas as MathML."""
    return FORMULA.sub(_mathml, content)


def _mathml(found: re.Match[str]) -> str:
    tex = html.unescape(found.group(3)).strip().replace("{aligned}", "{align*}")  # the one that the converter knows
    mathml = convert(tex, display="inline" if found.group(2) == "(" else "block")
    return mathml.replace(r"\_", "_")  # which the converter leaves in \text{}: no other use of it reaches a page


# -- links -------------------------------------------------------------------------------------------------------------
def _source(place: str) -> str:
    """Where a page of the site stands in the repository."""
    return next((path for path, name in OUTSIDE.items() if name == place and name != "index.md"), f"docs/{place}")


def _spoken_of(files: Files) -> set[str]:
    """Files of the repository outside docs/ to which pages link."""
    found = set()
    for file in files.documentation_pages():
        source = _source(file.src_uri)
        for _, target, _ in LINK.findall(FENCED.sub("", (ROOT / source).read_text("utf-8"))):
            path = posixpath.normpath(posixpath.join(posixpath.dirname(source), target))
            if not path.startswith("docs/") and path not in OUTSIDE and (ROOT / path).is_file():
                found.add(path)
    return found


def _page_of(path: str) -> str:
    return OUTSIDE.get(path) or f"files/{path}.md"


def _link(found: re.Match[str], source: str, place: str) -> str:
    """A link of a page as a link of the site; what is no file is only named."""
    text, target, anchor = found.groups()
    path = posixpath.normpath(posixpath.join(posixpath.dirname(source), target))
    if path.startswith("docs/"):
        there = path.removeprefix("docs/")
    elif (ROOT / path).is_file():
        there = _page_of(path)
    else:
        return f"{text} (`{path}`)" if (ROOT / path).exists() else found.group(0)
    return f"[{text}]({os.path.relpath(there, posixpath.dirname(place) or '.')}{anchor or ''})"


def _shown(path: str) -> str:
    """A page that shows a file."""
    text = (ROOT / path).read_text("utf-8")
    if path.endswith(".md"):
        return text
    return f"# {posixpath.basename(path)}\n\n`{path}`\n\n```{SHOWN.get(Path(path).suffix, 'text')}\n{text.rstrip()}\n```\n"
