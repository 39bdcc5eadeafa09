"""Results that are text: lines and tables for the terminal, a page for Python and notebooks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from heavebond.core import facade
from heavebond.core.errors import Problem
from heavebond.core.presentation import brief, columns, count
from heavebond.reports.result_tables import ResultTable

WIDTH = 100  # characters of a line in Python


@dataclass(frozen=True)
class TextLine:
    """A line of a page; `style` is bold, dim, yellow, warning (on standard error) or none."""

    text: str
    style: str = ""


@dataclass(frozen=True)
class TextPage(facade.Displayed):
    """A text with its content: `print(page)` shows it, `page.as_dict()` is the content of the JSON file of the command.
    `problems` are mistakes in files that the page could not include."""

    name: str
    items: tuple[TextLine | ResultTable, ...]
    content: Mapping[str, object] = field(default_factory=dict)
    problems: tuple[Problem, ...] = ()

    def as_dict(self) -> dict[str, object]:
        """The content as a dictionary for JSON."""
        return dict(self.content)

    def __str__(self) -> str:
        lines = []
        for item in self.items:
            if isinstance(item, TextLine):
                lines.append(item.text)
            else:
                lines += [item.title] if item.title else []
                lines += [line.rstrip() for line in columns([item.head, *item.rows], WIDTH)]
        return "\n".join(lines)

    def __repr__(self) -> str:
        return brief(self, self.name, f"{count(str(self).count(chr(10)) + 1, 'line')}, shown by print()",
                     count(len(self.problems), "problem") if self.problems else "")


class Lines:
    """Collects the lines and tables of a page of a width in characters."""

    def __init__(self, width: int) -> None:
        self.width = width
        self.items: list[TextLine | ResultTable] = []

    def add(self, text: str, style: str = "") -> None:
        """Add a text, which may have several lines."""
        self.items += [TextLine(line, style) for line in text.split("\n")]

    def table(self, title: str, head: Sequence[str], rows: Sequence[Sequence[str]], text: int = 1) -> None:
        """Add a table whose first `text` columns are text."""
        self.items.append(ResultTable(title, head, rows, text))

    def page(self, name: str, content: Mapping[str, object], problems: Sequence[Problem] = ()) -> TextPage:
        """The page of all lines so far."""
        return TextPage(name, tuple(self.items), content, tuple(problems))
