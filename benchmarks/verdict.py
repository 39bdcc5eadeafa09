"""What the verdict of a run on itself costs: bundled machines from their files to a result, with it and without."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import heavebond as hb
from benchmarks.measuring import Figure, at_most, paired
from heavebond.language import library
from heavebond.numbers.dae import assemble

MACHINES = ("cmc_ahc", "cmc_ahc/passive", "cmc_ahc/detailed", "cmc_ahc/irregular_sea", "hydrostatic_drive", "excavator_boom",
            "pneumatic_cylinder", "mechanisms/double_pendulum", "quarter_car")
LIMIT = 1.03


def run(name: str) -> hb.Result:
    """A machine from files that were never read before to its result, as a command makes it."""
    library._load_cached.cache_clear()
    return hb.Simulator(assemble(hb.load(name))).run()


def judged(name: str) -> hb.Result:
    """The same with its verdict, which is clean for all of these."""
    result = run(name)
    assert result.verdict.status == "clean", result.verdict.text
    return result


def all_of(make: Callable[[str], hb.Result]) -> None:
    """Every machine once."""
    for name in MACHINES:
        make(name)


def figures() -> Iterator[Figure]:
    """All machines together, and each of them."""
    yield at_most("runs of nine machines from their files: with verdict / without", paired(
        lambda: all_of(judged), lambda: all_of(run)), LIMIT)
    for name in MACHINES:
        found = paired(lambda name=name: judged(name), lambda name=name: run(name))  # type: ignore[misc]
        yield at_most(f"{name}, one run from its files: with verdict / without", found, LIMIT)


if __name__ == "__main__":
    for figure in figures():
        print(f"{figure.what}: {figure.measured}, {figure.target}")
