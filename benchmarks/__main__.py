"""Measure everything, print the table, and put it into docs/performance.md."""

from __future__ import annotations

import platform
import time
from pathlib import Path

import casadi
import numpy
from rich.console import Console
from rich.table import Table

from benchmarks import cache, chain, compensator, heave
from benchmarks.measuring import Figure

PAGE = Path(__file__).parents[1] / "docs" / "performance.md"
BEGIN, END = "<!-- written by `make bench` -->", "<!-- end of what `make bench` writes -->"
WIDTH = 150  # the table whole, also into a file
MET = {True: "yes", False: "no", None: ""}


def measured() -> list[Figure]:
    """Every figure, in the order of the page."""
    return [*heave.figures(), *compensator.figures(), *cache.figures(), *chain.figures()]


def page_table(figures: list[Figure], conditions: str) -> str:
    """The table in Markdown."""
    rows = [f"| {f.what} | {f.measured} | {f.target} | {MET[f.met]} |" for f in figures]
    return "\n".join([BEGIN, "", f"{conditions}", "", "| what | measured | target | met? |", "|---|---|---|---|", *rows, "",
                      END])


def main() -> None:
    """As the command line calls it."""
    began = time.perf_counter()
    figures = measured()
    conditions = (f"Python {platform.python_version()}, CasADi {casadi.__version__}, NumPy {numpy.__version__}, "
                  f"{platform.machine()}.")
    table = Table("what", "measured", "target", "met?", title=conditions, title_justify="left")
    for figure in figures:
        table.add_row(figure.what.replace("`", ""), figure.measured, figure.target, MET[figure.met])
    Console(width=WIDTH).print(table)
    text = PAGE.read_text(encoding="utf-8")
    head, _, rest = text.partition(BEGIN)
    tail = rest.partition(END)[2]
    PAGE.write_text(head + page_table(figures, conditions) + tail, encoding="utf-8")
    print(f"{time.perf_counter() - began:.0f} s; wrote {PAGE.name}")


main()
