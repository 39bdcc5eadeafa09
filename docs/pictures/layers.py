"""Draws docs/pictures/layers.svg, the modules of heavebond by their layers, from the table of docs/architecture.md.

`make pages` draws it anew, and a test compares it with the table.
"""

from __future__ import annotations

import html
import re
from pathlib import Path

HERE = Path(__file__).parent
ROW = re.compile(r"^\| ([a-z]*) ?\| `([\w.]+)` \|", re.MULTILINE)
SAYS = {"commands": "what a user types", "reports": "pages and summaries", "pictures": "plots and drawings",
        "analysis": "a machine looked at", "evidence": "models beside records", "studies": "many runs of one model",
        "numbers": "from equations to runs", "equations": "from a diagram to a reduced system",
        "language": "what files say", "text": "from characters to trees", "basis": "what all of them need"}
COLOURS = ("#fff0e6", "#ffe8cc", "#fff3bf", "#e9fac8", "#d3f9d8", "#c5f6fa", "#d0ebff", "#e5dbff")
WIDTH, LEFT, LINE, CHARACTER = 1000, 190, 19, 7.25
FONT = "font-family='DejaVu Sans Mono, Menlo, Consolas, monospace' font-size='12'"


def layers(table: str) -> dict[str, list[str]]:
    """The modules of each layer, from top to bottom, as the table lists them."""
    found: dict[str, list[str]] = {}
    for layer, module in ROW.findall(table):
        found.setdefault(layer or next(reversed(found)), []).append(module)
    return found


def picture(table: str) -> str:
    """One band for each layer with the names of its modules, as SVG."""
    parts, y = [], 10
    for k, (layer, modules) in enumerate(layers(table).items()):
        lines = _lines([module.rpartition(".")[2] for module in modules])
        height = max(2, len(lines)) * LINE + 16
        parts.append(f"<rect x='30' y='{y}' width='{WIDTH - 40}' height='{height}' rx='6' stroke='#868e96' "
                     f"fill='{COLOURS[k % len(COLOURS)]}'/>")
        parts.append(_text(44, y + 24, layer, "font-family='sans-serif' font-size='15' font-weight='bold'"))
        parts.append(_text(44, y + 41, SAYS.get(layer, ""), "font-family='sans-serif' font-size='10.5'"))
        parts += [_text(LEFT + 50, y + 24 + LINE * n, line, FONT) for n, line in enumerate(lines)]
        y += height + 8
    arrow = f"<path d='M14 14 V{y - 14} M8 {y - 24} L14 {y - 12} L20 {y - 24}' fill='none' stroke='#495057' " \
        "stroke-width='2'/>"
    return "\n".join([f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {WIDTH} {y + 4}' role='img'>",
                      "<title>The modules by layers; imports point down</title>", arrow, *parts, "</svg>"]) + "\n"


def _lines(modules: list[str]) -> list[str]:
    """Names side by side, as many in a line as there is room for."""
    lines = [""]
    for name in modules:
        if lines[-1] and (len(lines[-1]) + 2 + len(name)) * CHARACTER > WIDTH - LEFT - 75:
            lines.append("")
        lines[-1] += ("  " if lines[-1] else "") + name
    return lines


def _text(x: float, y: float, text: str, style: str) -> str:
    return f"<text x='{x}' y='{y}' {style} fill='#212529' xml:space='preserve'>{html.escape(text)}</text>"


if __name__ == "__main__":
    (HERE / "layers.svg").write_text(picture((HERE.parent / "architecture.md").read_text("utf-8")), encoding="utf-8")
