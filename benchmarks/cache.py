"""What the cache saves: whole processes and one large assembly, from the cache against without."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import heavebond as hb
from benchmarks import chain
from benchmarks.compensator import COMMAND
from benchmarks.measuring import Figure, at_most, paired, process, spoken
from heavebond.basis.cache import FOLDER

MASSES = 1000


@contextmanager
def cached_in(folder: str) -> Iterator[None]:
    """The cache in a folder, for this process and those that it starts."""
    before = os.environ[FOLDER]
    os.environ[FOLDER] = folder
    try:
        yield
    finally:
        os.environ[FOLDER] = before


def warm(folder: str, work: partial[object]) -> object:
    """Work with the cache in a folder."""
    with cached_in(folder):
        return work()


def kept(folder: Path) -> int:
    """How many entries a run of the compensator leaves in an empty cache."""
    warm(str(folder), partial(process, *COMMAND, "run", "cmc_ahc"))
    return len(list(folder.glob("*.kept")))


def figures() -> list[Figure]:
    """The first measurement of each, which is not counted, fills the cache."""
    with tempfile.TemporaryDirectory() as folder:
        assert kept(Path(folder)) == 3  # its files, the diagram, the reduced diagram
        run = partial(process, *COMMAND, "run", "cmc_ahc")
        imports = paired(partial(warm, folder, run), partial(process, "-c", "import casadi, numpy"), 7)
        processes = paired(partial(warm, folder, run), run)
        large = partial(hb.assemble, hb.load(chain.DIAGRAM).with_parameters({"n": MASSES}))
        assemblies = paired(partial(warm, folder, large), large)
    return [at_most("process: `heavebond run cmc_ahc`, cache warm / `import casadi, numpy`", imports, 8.0),
            Figure("process: `heavebond run cmc_ahc`, cache warm / without a cache", spoken(processes)),
            Figure(f"chain({MASSES}): assembly from the cache / assembly", spoken(assemblies))]
