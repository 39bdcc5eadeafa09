"""What the verdict of a run on itself costs: bundled machines from their files to a result, with it and without."""

from __future__ import annotations

import gc
import statistics
from collections.abc import Iterator, Sequence

import heavebond as hb
from benchmarks.measuring import PAIRS, Figure, Paired, at_most, cpu
from heavebond.language import library
from heavebond.numerics.dae import assemble

MACHINES = ("cmc_ahc", "cmc_ahc/passive", "cmc_ahc/detailed", "cmc_ahc/irregular_sea", "hydrostatic_drive", "excavator_boom",
            "pneumatic_cylinder", "mechanisms/double_pendulum", "quarter_car")
LIMIT = 1.03


def run(name: str) -> hb.Result:
    """A machine from files that were never read before to its result, as a command makes it."""
    library._load_cached.cache_clear()
    return hb.Simulator(assemble(hb.load(name))).run()


def timed(names: Sequence[str]) -> Paired:
    """Processor time of runs with their verdicts against that of the same runs without: the verdict follows the run, so that
    its share is measured in one and the same run."""
    whole, alone = [], []
    for _ in range(PAIRS):
        gc.collect()
        began = cpu()
        results = [run(name) for name in names]
        ran = cpu()
        assert all(result.verdict.status == "clean" for result in results)
        whole.append(cpu() - began)
        alone.append(ran - began)
    return Paired(statistics.median(whole), statistics.median(alone),
                  statistics.median(a / b for a, b in zip(whole, alone, strict=True)))


def figures() -> Iterator[Figure]:
    """All machines together, and each of them."""
    yield at_most("nine bundled machines from their files to a verdict: runs with verdict / without", timed(MACHINES), LIMIT)
    for name in MACHINES:
        yield at_most(f"{name}: run with verdict / without", timed([name]), LIMIT)


if __name__ == "__main__":
    for figure in figures():
        print(f"{figure.what}: {figure.measured} ({figure.target})")
