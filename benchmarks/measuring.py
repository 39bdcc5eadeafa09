"""Ratios of processor time: both sides in one run of the program, in turns, so that a busy machine slows both alike."""

from __future__ import annotations

import atexit
import gc
import os
import platform
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import casadi
import numpy
from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).parents[1]
PAIRS = 5
# a measurement shorter than this is repeated until it is as long: the clock and the caches are no longer seen
SHORTEST = 0.1
# after so many seconds of calls the equations of a machine of some states are compiled
SETTLE = 1.5
BEGIN, END = "<!-- written by the benchmark -->", "<!-- end of what the benchmark writes -->"
WIDTH = 150  # the table whole, also into a file
MET = {True: "yes", False: "no", None: ""}


@dataclass(frozen=True)
class Paired:
    """Median processor time of each side in s, and the median of the ratios of the pairs."""

    ours: float
    theirs: float
    ratio: float


@dataclass(frozen=True)
class Figure:
    """A line of the table; `met` is None where there is no target."""

    what: str
    measured: str
    target: str = ""
    met: bool | None = None


def cpu() -> float:
    """Processor time in s of this process and of the children that have ended."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def seconds(run: Callable[[], object], repeat: int = 1) -> float:
    """Processor time of one call, from `repeat` calls."""
    gc.collect()
    began = cpu()
    for _ in range(repeat):
        run()
    return (cpu() - began) / repeat


def paired(ours: Callable[[], object], theirs: Callable[[], object], pairs: int = PAIRS, settle: float = 0.0) -> Paired:
    """Both sides in turns after one call of each that is not counted; the second side goes first in every other pair. Each
    is called for `settle` seconds before, so that equations that are compiled once they were evaluated often have been."""
    sides = (ours, theirs)
    for side in sides:
        began = cpu()
        while cpu() - began < settle:
            side()
    repeats = [max(1, round(SHORTEST / max(seconds(side), 1e-4))) for side in sides]
    times: tuple[list[float], list[float]] = ([], [])
    for k in range(pairs):
        for which in ((0, 1), (1, 0))[k % 2]:
            times[which].append(seconds(sides[which], repeats[which]))
    return Paired(statistics.median(times[0]), statistics.median(times[1]),
                  statistics.median(a / b for a, b in zip(*times, strict=True)))


def at_most(what: str, found: Paired, limit: float) -> Figure:
    """The line of a ratio that should not exceed `limit`."""
    return Figure(what, spoken(found), f"≤ {limit:g}", found.ratio <= limit)


def spoken(found: Paired) -> str:
    """`2.79 (86.1 ms / 30.9 ms)`."""
    return f"{found.ratio:.2f} ({duration(found.ours)} / {duration(found.theirs)})"


def duration(time_s: float) -> str:
    """`86.1 ms`, `1.62 s`."""
    return f"{time_s:.2f} s" if abs(time_s) >= 0.9995 else f"{1e3 * time_s:.3g} ms"


@cache
def _bytecode() -> str:
    """A folder for the bytecode of modules: installed packages have theirs compiled, a copy of the sources perhaps not."""
    folder = tempfile.TemporaryDirectory()
    atexit.register(folder.cleanup)
    return folder.name


def process(*arguments: str) -> str:
    """What Python says when called like this; CalledProcessError where it fails. From its second call on, modules are read
    as bytecode, whatever the settings of this process."""
    paths = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH", "")])]
    own = {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "PYTHONPYCACHEPREFIX": _bytecode()}
    own.pop("PYTHONDONTWRITEBYTECODE", None)
    return subprocess.run([sys.executable, *arguments], env=own, capture_output=True, text=True, check=True).stdout


# -- pages -------------------------------------------------------------------------------------------------------------
def page_table(figures: Sequence[Figure], conditions: str) -> str:
    """The table in Markdown."""
    rows = [f"| {f.what} | {f.measured} | {f.target} | {MET[f.met]} |" for f in figures]
    return "\n".join([BEGIN, "", f"{conditions}", "", "| what | measured | target | met? |", "|---|---|---|---|", *rows, "",
                      END])


def write_page(figures: Sequence[Figure], page: Path) -> None:
    """Print the table, and put it into the page between its marks."""
    conditions = (f"Python {platform.python_version()}, CasADi {casadi.CasadiMeta.version()}, NumPy {numpy.__version__}, "
                  f"{platform.machine()}.")
    table = Table("what", "measured", "target", "met?", title=conditions, title_justify="left")
    for figure in figures:
        table.add_row(figure.what.replace("`", ""), figure.measured, figure.target, MET[figure.met])
    Console(width=WIDTH).print(table)
    head, _, rest = page.read_text(encoding="utf-8").partition(BEGIN)
    page.write_text(head + page_table(figures, conditions) + rest.partition(END)[2], encoding="utf-8")
