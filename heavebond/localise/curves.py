"""Regression of an estimated input on one variable, validated on held-out data, with the shape of the curve.

A curve is piecewise linear between quantiles of its variable, fitted by weighted least squares on the samples for learning;
its R2 = 1 - sum(rest**2) / sum((w - mean)**2) counts on the others. Beside it stand simple laws (a step, a line, a dead
band, ...) fitted and tried alike: one that does as well as the free curve, with few numbers, names its shape.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from heavebond.numerics.dae import Array

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class CurveConstants:
    """The constants of the laws that are learnt from an estimated input.

    knots: knots of a free curve. Origin: enough for the shapes that are named. Doubled: rougher curves.
    correlated_samples: samples over which the errors of an estimated force are correlated. Origin: smoothed estimates
        are correlated. Doubled: fewer significant curves.
    seen: share of samples that must lie within the fitted stretch for a score. Origin: below, few samples decide.
        Doubled: fewer curves are scored.
    step_width: width of a step, over the span of its variable, on either side of zero. Origin: resolution of an
        estimate. Doubled: steep lines count as steps.
    simple_share: share of the variance by which a simple law may leave more than the free curve. Origin: errors of the
        estimate. Doubled: simpler laws are named.
    simple_factor: the same as a factor on what the free curve leaves. Origin: as above. Doubled (in its excess over 1):
        simpler laws.
    per_number: factor on the variance left by which a law with one number more must be better. Origin: as above.
        Doubled (in its excess over 1): simpler laws.
    loop_margin: R2 by which a loop over the speed must beat one over the position. Origin: hysteresis acts over
        positions. Doubled: fewer loops over speeds.
    crossed: share of samples on either side of zero from which a variable crosses it. Origin: below, a step at zero
        cannot be seen. Doubled: fewer steps.
    """

    knots: int = 16
    correlated_samples: float = 10.0
    seen: float = 0.3
    step_width: float = 0.02
    simple_share: float = 0.03
    simple_factor: float = 1.25
    per_number: float = 1.2
    loop_margin: float = 0.05
    crossed: float = 0.05


CURVES = CurveConstants()


@dataclass(frozen=True)
class Variable:
    """A signal on which a law may depend. kind: across (speed, pressure drop), position, rate (of the across variable),
    pressure, speed, place (a position of a neighbour), signal; `phrase` names it in words, `formula` in the diagram's names;
    values (N,) in `unit`, `rising` where it grows."""

    kind: str
    phrase: str
    formula: str
    unit: str
    values: Array
    rising: Mask

    def thinned(self, samples: slice) -> Variable:
        """The same at fewer samples."""
        return replace(self, values=self.values[samples], rising=self.rising[samples])


Kinks = tuple[float, ...]
Basis = Callable[[Array, float, Kinks], Array]


@dataclass(frozen=True)
class Form:
    """A simple law w = sum_k a_k basis_k(v, size of v, kinks): `free` counts its numbers, the `kinks` among them; `crossing`
    tells that it is one only where v takes both signs."""

    name: str
    basis: Basis
    free: int
    kinks: int = 0
    crossing: bool = False


@dataclass(frozen=True)
class Curve:
    """The best curve of one variable through w.

    `r2` is that of the free curve (or of a law, where better) on the samples not learnt from, `shape` the name of the law
    that does as well (or `curve`, or `loop`), `shape_r2` its own; x, y (K,) draw the curve, in a loop its way up, `y_down`
    its way down; `q` are the parameters with which it is so; `scores` the R2 of every variable by its formula, `units`
    their units; `times` a signal by which the curve is multiplied.
    """

    variable: Variable
    r2: float
    shape: str
    shape_r2: float
    x: Array
    y: Array
    q: Array
    scores: dict[str, float]
    y_down: Array = field(default_factory=lambda: np.zeros(0))
    times: str = ""
    units: dict[str, str] = field(default_factory=dict)

    @property
    def loop(self) -> bool:
        """Whether it has a branch for each direction of motion."""
        return bool(self.y_down.size)


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
    """Quantiles of v, evenly spaced ones among them so that a rarely visited end is not bridged by one line."""
    low, high = np.quantile(v, [0.002, 0.998])
    both = np.concatenate([np.quantile(v, np.linspace(0.002, 0.998, CURVES.knots)),
                           np.linspace(low, high, CURVES.knots // 2)])
    both = np.sort(both)
    apart = np.diff(both, prepend=-np.inf) > 5e-3 * (high - low)
    return np.asarray(both[apart]) if high > low and apart.sum() > 1 else np.array([low - 1.0, low + 1.0])


def solved(basis: Array, w: Array, weight: Array, prior: Array | None = None) -> Array:
    """Weighted least squares; `prior` adds to the diagonal, a trace everywhere so that an empty stretch does no harm."""
    scaled = basis * weight[:, None]
    normal = scaled.T @ basis
    diagonal = 1e-9 * np.trace(normal) / len(normal) + 1e-300
    normal[np.diag_indices_from(normal)] += diagonal + (0.0 if prior is None else prior)
    return np.asarray(np.linalg.solve(normal, scaled.T @ w))


@dataclass(frozen=True)
class Samples:
    """A force w (N,) with its standard deviation (N,), which samples are learnt from, and how w moves with each parameter
    (N, k), these being normal with mean 0 and deviation 1; w is that with the parameters at `q` (k,)."""

    w: Array
    deviation: Array
    learn: Mask
    moved: Array
    q: Array

    @property
    def weight(self) -> Array:
        """Of each sample; where the records hardly tell w, little."""
        return np.asarray(1 / (self.deviation**2 + np.median(self.deviation)**2))

    def tried(self, basis: Array, where: Mask | None = None) -> tuple[float, Array]:
        """R2 on the other samples (those in `where`) and the coefficients of a basis (N, K). The variance is that of w as it
        is or with the parameters at their mean, whichever is less: moving a parameter must not make something to explain."""
        learn, weight = self.learn, self.weight
        other = ~learn if where is None else ~learn & where
        a = solved(basis[learn], self.w[learn], weight[learn])
        if other.sum() < CURVES.seen * (~learn).sum():
            return -np.inf, a
        plain = self.w - self.moved @ self.q
        total = min(_variance(self.w[other], weight[other]), _variance(plain[other], weight[other]))
        rest = float(np.average((self.w[other] - basis[other] @ a)**2, weights=weight[other]))
        return 1 - rest / total if total > 0 else 0.0, a

    def with_parameters(self, basis: Array) -> Samples:
        """The force with the parameters at the values with which a basis tells it best, within their tolerance.

        The rest of the fit, whose errors hang together over some samples, is weighed against what is known of them.
        """
        k = self.moved.shape[1]
        if not k:
            return self
        learn, weight = self.learn, self.weight
        both = np.concatenate([basis, -self.moved], axis=1)[learn]
        q, prior = np.zeros(k), np.concatenate([np.zeros(basis.shape[1]), np.ones(k)])
        for _ in range(3):
            a = solved(both, self.w[learn], weight[learn], prior)
            rest = self.w[learn] - both @ a
            variance = float(weight[learn] @ rest**2 / len(rest))
            q, prior[-k:] = a[-k:], CURVES.correlated_samples * max(variance, 1e-12)
        q = np.clip(q, -2.0, 2.0)
        return replace(self, w=self.w + self.moved @ q, q=q)


def _variance(w: Array, weight: Array) -> float:
    return float(np.average((w - np.average(w, weights=weight))**2, weights=weight))


def best_curve(variables: Sequence[Variable], samples: Samples, margin: float = 0.01) -> Curve | None:
    """The variable whose curve tells w best (the first of those within `margin`); a loop, with a branch for each direction,
    or a curve times a signal only if it tells clearly more. None where no variable moves."""
    found = [_free(variable, samples) for variable in variables]
    if not found:
        return None
    # of a force that is hardly seen a line tells more than a free curve
    found = [(replace(c, r2=max(c.r2, s.tried(np.stack([np.ones_like(s.w), c.variable.values], 1))[0])), s)
             for c, s in found]
    scores = {curve.variable.formula: curve.r2 for curve, _ in found}
    units = {variable.formula: variable.unit for variable in variables}
    best = max(scores.values())
    curve, settled = next(f for f in found if f[0].r2 >= best - margin)
    shape, shape_r2 = shape_of(curve.variable.values, samples, settled, curve.r2)
    curve = replace(curve, r2=max(curve.r2, shape_r2), shape=shape, shape_r2=shape_r2, scores=scores, units=units)
    enough = max(curve.r2, 0.0) + max(0.05, 0.2 * (1 - max(curve.r2, 0.0)))
    richer = [*_products(variables, samples), *_loops(variables, samples)]
    # a loop over the position says the same as one over the speed, and more
    more = max(richer, key=lambda c: c.r2 - CURVES.loop_margin * (c.loop and c.variable.kind == "across"), default=None)
    return replace(more, scores=scores, units=units) if more is not None and more.r2 > enough else curve


def _free(variable: Variable, samples: Samples, times: Variable | None = None) -> tuple[Curve, Samples]:
    """The free curve of one variable, times a signal, and the force with the parameters that suit it."""
    knots = knots_of(variable.values[samples.learn])
    basis = hats(variable.values, knots)
    basis = basis * times.values[:, None] if times is not None else basis
    settled = samples.with_parameters(basis)
    # beyond the samples learnt from a free curve knows nothing
    inside = (variable.values >= knots[0]) & (variable.values <= knots[-1])
    r2, a = settled.tried(basis, inside)
    name = times.formula if times is not None else ""
    return Curve(variable, r2, "curve", r2, knots, a, settled.q, {}, times=name), settled


def _products(variables: Sequence[Variable], samples: Samples) -> list[Curve]:
    return [_free(variable, samples, signal)[0] for signal in variables if signal.kind == "signal"
            for variable in variables if variable.kind in ("across", "pressure")]


def _loops(variables: Sequence[Variable], samples: Samples) -> list[Curve]:
    loops = []
    for variable in variables:
        knots = knots_of(variable.values[samples.learn])[::2]
        if variable.kind not in ("position", "across") or len(knots) < 2:
            continue
        basis, up = hats(variable.values, knots), variable.rising
        branches = np.concatenate([basis * up[:, None], basis * ~up[:, None]], axis=1)
        settled = samples.with_parameters(branches)
        r2, a = settled.tried(branches, (variable.values >= knots[0]) & (variable.values <= knots[-1]))
        loops.append(Curve(variable, r2, "loop", r2, knots, a[:len(knots)], settled.q, {}, a[len(knots):]))
    return loops


def shape_of(v: Array, samples: Samples, settled: Samples, r2: float) -> tuple[str, float]:
    """Of the laws that tell w as well as the free curve does the best, each number in a law counting against it, and its R2;
    `curve` where none does.

    Kinks are sought first on a coarse grid, then between its points, the parameters moving with them; what is known of
    these is weighed against the rest that the free curve leaves (`settled`).
    """
    enough = r2 - max(CURVES.simple_share, (CURVES.simple_factor - 1) * (1 - r2))
    learn, size = samples.learn, float(np.quantile(np.abs(v[samples.learn]), 0.98)) or 1.0

    weight, k = samples.weight[learn], samples.moved.shape[1]
    rest = settled.tried(hats(v, knots_of(v[learn])))[1]
    variance = float(np.mean(weight * (settled.w - hats(v, knots_of(v[learn])) @ rest)[learn]**2))

    def learnt(basis: Array) -> float:
        both = np.concatenate([basis, -samples.moved], axis=1)[learn]
        prior = np.concatenate([np.zeros(basis.shape[1]), np.full(k, CURVES.correlated_samples * max(variance, 1e-12))])
        a = solved(both, samples.w[learn], weight, prior)
        return -float(weight @ (samples.w[learn] - both @ a)**2 + prior @ a**2)

    good = []
    for form in FORMS:
        if form.crossing and not _crossed(v[learn], size):
            continue
        kinks = _kinks(lambda given, form=form: learnt(form.basis(v, size, given)), form.kinks, v[learn])  # type: ignore[misc]
        basis = form.basis(v, size, kinks)
        tried = samples.with_parameters(basis).tried(basis)[0]
        if tried >= enough:
            good.append(((1 - tried) * CURVES.per_number**form.free, tried, form.name))
    if not good:
        return "curve", r2
    _, tried, name = min(good)
    return name, tried


def _kinks(learnt: Callable[[Kinks], float], count: int, v: Array) -> Kinks:
    """The kinks (increasing) with which a law is learnt best."""
    if not count:
        return ()
    grid = np.unique(np.concatenate([np.quantile(v, [0.03, 0.1, 0.25, 0.5, 0.75, 0.9, 0.97]),
                                     np.linspace(np.quantile(v, 0.02), np.quantile(v, 0.98), 7)]))
    best = max(combinations(grid.tolist(), count), key=learnt)
    for _ in range(2):
        step = float(np.max(np.diff(grid))) / 3
        finer = product(*([k + d * step for d in (-2, -1, 0, 1, 2)] for k in best))
        best = max((f for f in finer if list(f) == sorted(f)), key=learnt)
        grid = grid[0] + (grid - grid[0]) / 4
    return best


def _crossed(v: Array, size: float) -> bool:
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
    Form("falling step", _terms(_step, _peak), 4, 1, crossing=True),
    Form("line and square", _terms(_line, _square), 3, crossing=True),
    Form("line and cube", _terms(_line, _cube), 3),
    Form("parabola", _terms(_line, lambda v, size, kinks: (v / size)**2), 3),
    Form("one-sided above", _terms(lambda v, size, kinks: np.maximum(v - kinks[0], 0)), 3, 1),
    Form("one-sided below", _terms(lambda v, size, kinks: np.maximum(kinks[0] - v, 0)), 3, 1),
    Form("dead band", _terms(lambda v, size, kinks: np.maximum(v - kinks[1], 0) - np.maximum(kinks[0] - v, 0)), 4, 2),
    Form("saturation", _terms(lambda v, size, kinks: np.clip(v, kinks[0], kinks[1])), 4, 2),
)
