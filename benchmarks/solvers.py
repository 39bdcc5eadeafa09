"""Every bundled machine by IDAS and CVODES: how long a plain run takes by `auto`, against the fastest of them.

`python -m benchmarks.solvers [NAME ...]` prints a line for each machine. A solver counts where it goes through with the
answer of `auto`. Where `auto` gives nodes a volume of their own, the others run the diagram with these volumes, and both
sides are timed with their assembly, as `auto` assembles twice. Compiling is part of the time, so the compiled Rosenbrock
method is left out: for a single run it compiles for up to minutes and was the fastest for no machine; `heave` times it.
"""

from __future__ import annotations

import sys
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import heavebond as hb
from benchmarks.measuring import Figure, cpu, duration, seconds
from heavebond.core.errors import HeavebondError
from heavebond.language.library import bundled
from heavebond.numerics.simulation import filled, unfilled

SOLVERS = ("idas", "cvodes")
AGREE = 3e-2  # rms over the range of an output, as in tests/test_solvers.py
REPEATED, LONG = 3, 1.0  # runs of which the shortest counts; one that takes so many s is not repeated
MOST = 2.0  # `auto` over the fastest


@dataclass(frozen=True)
class Compared:
    """Processor time in s of `auto` and of the solvers that go through."""

    name: str
    auto: float
    others: dict[str, float]

    @property
    def ratio(self) -> float:
        """Of `auto` to the fastest of all, itself among them."""
        return self.auto / min(self.auto, *self.others.values())

    @property
    def text(self) -> str:
        """`cmc_ahc: 1.31 (auto 111 ms; idas 89 ms, ...)`."""
        others = ", ".join(f"{solver} {duration(time)}" for solver, time in self.others.items())
        return f"{self.name}: {self.ratio:.2f} (auto {duration(self.auto)}; {others or 'no other goes through'})"


def machines() -> list[str]:
    """The names of the bundled machines, without the examples of single components."""
    folder = bundled("models")
    files = [path for path in sorted(folder.glob("*/*.yaml")) if path.parent.name != "examples"]
    return [path.parent.name if path.stem == path.parent.name else f"{path.parent.name}/{path.stem}" for path in files
            if _is_diagram(path)]


def _is_diagram(path: Path) -> bool:
    heads = {line.partition(":")[0] for line in path.read_text(encoding="utf-8").splitlines()}
    return "model" in heads and not heads & {"experiment", "study"}


def compared(name: str) -> Compared:
    """One machine."""
    model = hb.load(name)
    assembly = ready = hb.assemble(model)
    auto, plain = _timed(assembly, "auto")
    before = 0.0
    if "fills" in plain.statistics:
        ready = filled(assembly, unfilled(assembly))
        auto += seconds(lambda: hb.assemble(model))
        before = seconds(lambda: hb.assemble(ready.model))
    others = {}
    for solver in SOLVERS:
        try:
            took, run = _timed(ready, solver)
        except HeavebondError:
            continue  # refused, or it stops
        if _apart(plain, run) < AGREE:
            others[solver] = before + took
    return Compared(name, auto, others)


def _timed(assembly: hb.Assembly, solver: str) -> tuple[float, hb.Result]:
    times: list[float] = []
    while True:
        began = cpu()
        run = hb.simulate(assembly, solver=solver)
        times.append(cpu() - began)
        if len(times) == REPEATED or times[-1] > LONG:
            return min(times), run


def _apart(one: hb.Result, other: hb.Result) -> float:
    """The largest rms of a difference between outputs, over their range or a hundredth of their largest value."""
    found = [0.0]
    for name in one.assembly.model.show:
        a, b = one.display[name], other.display[name]
        size = max(float(np.ptp(a)), 0.01 * float(np.abs(a).max()), 1e-12)
        found.append(float(np.sqrt(np.mean((a - b) ** 2))) / size)
    return max(found)


def figures() -> list[Figure]:
    """The slowest of all machines against their fastest solvers."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hb.RunWarning)
        found = sorted((compared(name) for name in machines()), key=lambda c: -c.ratio)
    above = [c for c in found if c.ratio > MOST]
    return [Figure(f"{len(found)} bundled machines: run by auto / by the fastest solver, the worst", found[0].text,
                   f"≤ {MOST:g}", not above),
            Figure("those machines: median of the ratios; machines above the target",
                   f"{found[len(found) // 2].ratio:.2f}; {', '.join(c.name for c in above) or 'none'}")]


def main() -> None:
    """As the command line calls it."""
    warnings.simplefilter("ignore", hb.RunWarning)
    for name in sys.argv[1:] or machines():
        print(compared(name).text, flush=True)


if __name__ == "__main__":
    main()
