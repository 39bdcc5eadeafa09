"""Laws of one variable as functions that are linear in their coefficients: piecewise linear ones, and simple named forms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from heavebond.numerics.dae import Array


@dataclass(frozen=True)
class CurveConstants:
    """The constants of the laws that are learnt from an estimated input.

    knots: knots of a free curve. Origin: enough for the shapes that are named. Doubled: rougher curves.
    correlated_samples: samples over which the residuals of a law above the noise are correlated; the prior of the parameters
        has more weight by this factor. Origin: residuals of a wrong law are slow. Doubled: parameters stay nearer to the
        data sheet with a law that leaves much.
    step_width: width of a step, over the span of its variable, on either side of zero. Origin: resolution of an estimate.
        Doubled: steep lines count as steps.
    simple_share: share of the variance by which a simple law may leave more than the free curve. Origin: errors of the
        estimate. Doubled: simpler laws are named.
    simple_factor: the same as a factor on the residual of the free curve. Origin: as above. Doubled (in its excess over 1):
        simpler laws.
    strong: chi-square by which the residual of a variable must exceed that of a variable at noise level to be distinguished.
        Origin: strong evidence, 2 ln B = 10 (R. E. Kass, A. E. Raftery, 1995). Doubled: the first of two variables is named
        where the second explains more.
    inexact: the same as a share of the samples, besides. Origin: no law is exact. Doubled: as above, for long records.
    exact: share of the misfit that is added to the residual of a law when laws are compared. Origin: no law is exact, nor is
        the linear model. Doubled: simpler laws are named.
    per_number: factor on the share left by which a law with one number more must be better. Origin: as above. Doubled (in
        its excess over 1): simpler laws.
    loop_margin: R2 by which a loop over the speed must beat one over the position. Origin: hysteresis acts over positions.
        Doubled: fewer loops over speeds.
    max_pairs: pairs of variables that are tried. Origin: time; they are ordered by nearness. Doubled: twice the time,
        farther second variables.
    folds: blocks of time of the cross-validation within the samples that are learnt from. Origin: usual. Doubled: twice the
        time.
    test_blocks: blocks of time of the samples not learnt from, over which the error of a mean is taken. Origin: many enough
        for a t value, and longer than residuals are correlated. Doubled: smaller errors where residuals are slow.
    smoothness: penalties of differences of coefficients that are tried, over their mean information. Origin: from none to a
        constant. Doubled: smoother curves.
    crossed: share of samples on either side of zero from which a variable crosses it. Origin: below, a step at zero cannot
        be seen. Doubled: fewer steps.
    """

    knots: int = 16
    correlated_samples: float = 10.0
    step_width: float = 0.02
    simple_share: float = 0.03
    simple_factor: float = 1.25
    strong: float = 10.0
    inexact: float = 0.003
    exact: float = 0.01
    per_number: float = 1.2
    loop_margin: float = 0.05
    max_pairs: int = 8
    folds: int = 5
    test_blocks: int = 20
    smoothness: tuple[float, ...] = (0.0, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
    crossed: float = 0.05


CURVES = CurveConstants()
Kinks = tuple[float, ...]
Basis = Callable[[Array, float, Kinks], Array]


@dataclass(frozen=True)
class Form:
    """A simple law w = sum_k a_k basis_k(v, size of v, kinks): `free` is the number of its parameters, including the
    `kinks`; with `crossing` the law applies only if v takes both signs, `kind` restricts the kind of variable."""

    name: str
    basis: Basis
    free: int
    kinks: int = 0
    crossing: bool = False
    kind: str = ""


def hats(v: Array, knots: Array) -> Array:
    """Piecewise linear basis (N, K): 1 at its knot, 0 at the others, constant beyond the ends."""
    v = np.clip(v, knots[0], knots[-1])
    right = np.clip(np.searchsorted(knots, v, side="right"), 1, len(knots) - 1)
    share = (v - knots[right - 1]) / (knots[right] - knots[right - 1])
    basis = np.zeros((len(v), len(knots)))
    rows = np.arange(len(v))
    basis[rows, right - 1], basis[rows, right] = 1 - share, share
    return basis


def knots_of(v: Array) -> Array:
    """Quantiles of v, with evenly spaced ones among them so that one line does not bridge a rarely visited end, and some
    about zero, where a step may occur."""
    low, high = np.quantile(v, [0.002, 0.998])
    size = float(np.quantile(np.abs(v), 0.98))
    about_zero = CURVES.step_width * size * np.arange(-2.0, 3.0) if low < 0 < high else np.zeros(0)
    both = np.concatenate([np.quantile(v, np.linspace(0.002, 0.998, CURVES.knots)), about_zero,
                           np.linspace(low, high, CURVES.knots // 2)])
    both = np.sort(both)
    apart = np.diff(both, prepend=-np.inf) > 5e-3 * (high - low)
    return np.asarray(both[apart]) if high > low and apart.sum() > 1 else np.array([low - 1.0, low + 1.0])


def solved(basis: Array, w: Array, weight: Array) -> Array:
    """Weighted least squares, with a small diagonal term so that an interval without samples is not singular."""
    scaled = basis * weight[:, None]
    normal = scaled.T @ basis
    normal[np.diag_indices_from(normal)] += 1e-9 * np.trace(normal) / len(normal) + 1e-300
    return np.asarray(np.linalg.solve(normal, scaled.T @ w))


def best_kinks(learnt: Callable[[Kinks], float], count: int, v: Array) -> Kinks:
    """The kinks (increasing) of the best fit of a law; none if the variable has too few different values."""
    if not count:
        return ()
    grid = np.unique(np.concatenate([np.quantile(v, [0.03, 0.1, 0.25, 0.5, 0.75, 0.9, 0.97]),
                                     np.linspace(np.quantile(v, 0.02), np.quantile(v, 0.98), 7)]))
    if len(grid) <= count:
        return ()
    best = max(combinations(grid.tolist(), count), key=learnt)
    for _ in range(2):
        step = float(np.max(np.diff(grid))) / 3
        finer = product(*([k + d * step for d in (-2, -1, 0, 1, 2)] for k in best))
        best = max((f for f in finer if list(f) == sorted(f)), key=learnt)
        grid = grid[0] + (grid - grid[0]) / 4
    return best


def crosses_zero(v: Array, size: float) -> bool:
    """True if a variable has a considerable share of its samples on either side of zero."""
    return bool(min(np.mean(v > 0.02 * size), np.mean(v < -0.02 * size)) > CURVES.crossed)


def _terms(*terms: Callable[[Array, float, Kinks], Array]) -> Basis:
    return lambda v, size, kinks: np.stack([np.ones_like(v), *(t(v, size, kinks) for t in terms)], axis=1)


def _line(v: Array, size: float, kinks: Kinks) -> Array:
    return v


def _step(v: Array, size: float, kinks: Kinks) -> Array:
    return np.tanh(v / (CURVES.step_width * size))


def _peak(v: Array, size: float, kinks: Kinks) -> Array:
    return _step(v, size, kinks) * np.exp(-(v / max(abs(kinks[0]), CURVES.step_width * size))**2)


def _square(v: Array, size: float, kinks: Kinks) -> Array:
    return v * np.abs(v)


def _cube(v: Array, size: float, kinks: Kinks) -> Array:
    return (v / size)**3


# The laws that are tried, each with a constant: `free` counts their numbers, `crossing` whether they need both signs.
FORMS = (
    Form("line", _terms(_line), 2),
    Form("step", _terms(_step), 2, crossing=True),
    Form("square", _terms(_square), 2, crossing=True),
    Form("root", _terms(lambda v, size, kinks: np.sign(v) * np.sqrt(np.abs(v))), 2),
    Form("cube", _terms(_cube), 2),
    Form("step and line", _terms(_step, _line), 3, crossing=True),
    Form("falling step", _terms(_step, _peak), 4, 1, crossing=True, kind="across"),
    Form("line and square", _terms(_line, _square), 3, crossing=True),
    Form("line and cube", _terms(_line, _cube), 3),
    Form("parabola", _terms(_line, lambda v, size, kinks: (v / size)**2), 3),
    Form("one-sided above", _terms(lambda v, size, kinks: np.maximum(v - kinks[0], 0)), 3, 1),
    Form("one-sided below", _terms(lambda v, size, kinks: np.maximum(kinks[0] - v, 0)), 3, 1),
    Form("dead band", _terms(lambda v, size, kinks: np.maximum(v - kinks[1], 0) - np.maximum(kinks[0] - v, 0)), 4, 2),
    Form("saturation", _terms(lambda v, size, kinks: np.clip(v, kinks[0], kinks[1])), 4, 2),
)
