"""Examples of components under `models/examples`, each with numbers from a closed form or an independent computation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import ellipj, ellipk

import heavebond as hb
from heavebond.language.library import bundled

Array = NDArray[np.float64]
FOLDER = bundled("models") / "examples"
# of the mechanics in the plane and in space
LAW = "the law at a prescribed motion; nothing is integrated"
RUN = "closed form; 1e-6 for the integration"
SWING = "closed form; 2e-5 for the integration, which adds up over the swings"


def swing(t: Array, start: float, rate: float) -> Array:
    """The angle of a pendulum let go at `start` from hanging, sin(theta/2) = k sn(K - rate t, k) with k = sin(start/2)."""
    k = np.sin(start/2)
    return 2*np.arcsin(k*ellipj(ellipk(k**2) - rate*t, k**2)[0])


def by_cosines(t: Array) -> Array:
    """The angle between two sides of 1 m and 0.6 m, opposite to which a strut changes its length."""
    s = 1 + 0.4*np.sin(np.pi/2*t)
    return np.arccos((1 + 0.6**2 - s**2)/(2*0.6))


@dataclass(frozen=True)
class Case:
    """`signal` of an example in SI is `expected(t)` within `tolerance` times its largest value, from `begin` on; `why` says
    where the expected numbers are from, and what the tolerance leaves room for."""

    example: str
    signal: str
    expected: Callable[[Array], Array | float]
    why: str
    tolerance: float = 1e-6
    begin: float = 0.0


@lru_cache(maxsize=16)  # the cases of an example follow each other
def run_of(example: str) -> hb.Result:
    """The run of an example as its file describes it."""
    return hb.simulate(hb.load(FOLDER / f"{example}.yaml"))


def check(case: Case) -> None:
    """Run the example and compare."""
    result = run_of(case.example)
    late = result.time >= case.begin - 1e-12
    expected = np.broadcast_to(case.expected(result.time[late]), late.sum())
    size = float(np.abs(expected).max())
    assert size > 0, "an example that expects nothing but zero shows nothing"
    assert result.display[case.signal][late] == pytest.approx(expected, rel=0, abs=case.tolerance*size)


def without_example(folders: Sequence[str], cases: Sequence[Case]) -> list[str]:
    """Components of these folders of the library that have no example with a number."""
    stems = [path.stem for folder in folders for path in sorted((bundled("components") / folder).glob("*.yaml"))]
    shown = {case.example for case in cases}
    return [stem for stem in stems if stem not in shown or not (FOLDER / f"{stem}.yaml").is_file()]
