"""HTML and SVG with escaping of all inserted text, and a page that loads nothing from elsewhere."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterable, Sequence
from importlib import resources

from heavebond.core.quoting import script_json, xml

_EMPTY = {"meta", "path", "line", "rect", "circle", "br", "input", "img"}


class Html(str):
    """Markup; any other text is escaped when it is inserted into an element."""

    __slots__ = ()


def element(tag: str, *children: str, **attributes: object) -> Html:
    """`<tag attributes>children</tag>`. Attribute names: `class_` is `class`, underscores become hyphens; None omits an
    attribute, True writes it without a value."""
    attribute_text = "".join(_attribute(name, value) for name, value in attributes.items() if value is not None)
    if tag in _EMPTY and not children:
        return Html(f"<{tag}{attribute_text}>" if tag in ("meta", "br", "input", "img") else f"<{tag}{attribute_text}/>")
    return Html(f"<{tag}{attribute_text}>{joined(children)}</{tag}>")


def joined(parts: Iterable[str]) -> Html:
    """Parts in sequence, with texts among them escaped."""
    return Html("".join(part if isinstance(part, Html) else escaped(part) for part in parts))


def escaped(text: str) -> Html:
    """An escaped text, without the control characters that are invalid in documents."""
    return Html(xml(text))


def _attribute(name: str, value: object) -> str:
    plain = name.rstrip("_").replace("_", "-")
    return f" {plain}" if value is True else f' {plain}="{escaped(str(value))}"'


def table(head: Sequence[str], rows: Sequence[Sequence[str]], *, caption: str = "", numbers: Iterable[int] = (),
          marks: Sequence[str] = (), wide: bool = False) -> Html:
    """A table with column headings; the first cell of a row is its heading, the columns `numbers` are aligned to the
    right, `marks` gives a class to each row; a `wide` one is scrolled rather than squeezed. Spaces before a heading of a row
    indent it, as in a tree."""
    right = set(numbers)
    rows = [["\u00a0" * (len(row[0]) - len(row[0].lstrip(" "))) + row[0].lstrip(" ") if row[0].startswith(" ") else row[0],
             *row[1:]] for row in rows]
    kind = ["n" if k in right else None for k in range(len(head))]
    heads = element("tr", *(element("th", text, scope="col", class_=kind[k]) for k, text in enumerate(head)))
    lines = [element("tr", *(element("td" if k else "th", text, class_=kind[k], scope=None if k else "row")
                             for k, text in enumerate(row)), class_=mark or None)
             for row, mark in zip(rows, marks or [""] * len(rows), strict=True)]
    return element("div", element("table", *([element("caption", caption)] if caption else []), element("thead", heads),
                                  element("tbody", *lines), class_="wide" if wide else None), class_="scroll")


def data_block(name: str, value: object) -> Html:
    """Data for the page's script, as JSON that its content cannot end early."""
    return Html(f'<script type="application/json" id="{escaped(name)}">{script_json(value)}</script>')


def page(title: str, *body: Html, look: str = "report", scripts: Sequence[str] = ()) -> str:
    """A complete document with style and script of `look` inside, after the files `scripts` of the folder `web`. The policy
    lets the browser use these, identified by their hashes, and nothing else: no address, no other script, no form."""
    files = resources.files("heavebond").joinpath("web")
    style, *parts = (files.joinpath(name).read_text(encoding="utf-8") for name in (f"{look}.css", *scripts, f"{look}.js"))
    script = "\n".join(parts)
    policy = f"default-src 'none'; style-src '{_hash(style)}'; script-src '{_hash(script)}'; base-uri 'none'; " \
             "form-action 'none'"
    head = element("head", element("meta", charset="utf-8"),
                   Html(f'<meta http-equiv="Content-Security-Policy" content="{policy}">'),
                   element("meta", name="viewport", content="width=device-width, initial-scale=1"),
                   element("title", title), Html(f"<style>{style}</style>"))
    return f'<!DOCTYPE html>\n<html lang="en">\n{head}\n<body>\n{joined(body)}\n<script>{script}</script>\n' \
           '</body>\n</html>\n'


def _hash(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode("ascii")
