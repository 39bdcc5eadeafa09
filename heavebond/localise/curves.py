"""Laws of one or two variables for an unknown input, fitted to the records and validated on held-out data.

A law is linear in the coefficients of piecewise linear functions of its variables (of one, or of two with a coefficient
at each pair of knots). The responses of the outputs to each of these functions, acting at a place, follow from the linear
time-varying model (see `kalman_smoother.Unknown.innovations`); so the coefficients are estimated from the outputs
themselves, together with the free parameters and their prior, and not from an estimated input. With L the sum of squared
whitened innovations of n held-out samples, L_0 that with the parameters alone,

    R2 = 1 - (L - n) / (L_0 - n)        share of the misfit above the noise that the law removes.

In addition to the free curve, simple laws (a step, a line, a dead band, ...) are fitted and validated in the same way. A
law that fits as well as the free curve, with few numbers, names its shape.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from heavebond.localise.law_forms import CURVES, FORMS, Form, Kinks, best_kinks, crosses_zero, hats, knots_of
from heavebond.numerics.dae import Array

Mask = NDArray[np.bool_]
Index = NDArray[np.int64]


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


@dataclass(frozen=True)
class Curve:
    """The best law of one or two variables for an unknown input.

    `r2` is the R2 of the free curve (or of a better law) on the samples not learnt from, `shape` the name of the law that
    fits as well (or `curve`, or `loop`), `shape_r2` its R2; x, y (K,) draw that law, in a loop its rising branch, `y_down`
    its falling branch; `q` are the fitted parameters; `scores` the R2 of every variable by its formula, `units` their units;
    `times` a signal by which the curve is multiplied; `second` another variable on which it depends: then y is the curve at
    large and `y_down` at small values of it. `covered` is the share of the samples not learnt from whose variables lie in
    the range of those learnt from; `chance` the p value that it predicts no better there than the parameters alone
    (Student's t of the mean over blocks of time, H. R. Kuensch, 1989, doi:10.1214/aos/1176347265).
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
    second: Variable | None = None
    covered: float = 1.0
    chance: float = 1.0

    @property
    def loop(self) -> bool:
        """Whether it has a branch for each direction of motion."""
        return self.shape == "loop"


@dataclass(frozen=True)
class Regression:
    """Sums of squared whitened innovations as quadratic forms of (1, q, a): `learn` and `held_out` (1+k+K, 1+k+K) over the
    samples that are learnt from and the others, `samples` how many these are; `folds` are parts of the former and `tests`
    of the latter, by blocks of time; q (k,) are the parameters, normal with `mean` and variance 1, a (K,) the coefficients,
    with a `penalty` P (K, K) on them, a' P a."""

    learn: Array
    held_out: Array
    samples: tuple[int, int]
    mean: Array
    folds: tuple[Array, ...] = ()
    tests: tuple[Array, ...] = ()
    penalty: Array | float = 0.0

    @property
    def k(self) -> int:
        """The number of parameters."""
        return len(self.mean)

    def of(self, index: Index) -> Regression:
        """With some of the coefficients alone."""
        indices = np.concatenate([np.arange(1 + self.k), 1 + self.k + index])
        penalty = self.penalty[np.ix_(index, index)] if isinstance(self.penalty, np.ndarray) else self.penalty
        return replace(self._transformed(lambda form: form[np.ix_(indices, indices)]), penalty=penalty)

    def along(self, T: Array) -> Regression:
        """With coefficients a = T b in place of a."""
        whole = np.zeros((1 + self.k + T.shape[0], 1 + self.k + T.shape[1]))
        whole[:1 + self.k, :1 + self.k] = np.eye(1 + self.k)
        whole[1 + self.k:, 1 + self.k:] = T
        penalty = T.T @ self.penalty @ T if isinstance(self.penalty, np.ndarray) else self.penalty
        return replace(self._transformed(lambda form: whole.T @ form @ whole), penalty=penalty)

    def _transformed(self, change: Callable[[Array], Array]) -> Regression:
        return replace(self, learn=change(self.learn), held_out=change(self.held_out), folds=tuple(map(change, self.folds)),
                       tests=tuple(map(change, self.tests)))

    def smooth(self, differences: Array) -> Regression:
        """With the penalty lambda |D a|**2 on `differences` D (d, K) of the coefficients whose lambda predicts best in
        cross-validation over the folds: a curve has as much freedom as the samples learnt from support."""
        size = float(np.trace(self.learn[1 + self.k:, 1 + self.k:])) / max(len(self.learn) - 1 - self.k, 1)
        tried = [replace(self, penalty=size * weight * (differences.T @ differences)) for weight in CURVES.smoothness]
        return min(tried, key=Regression._cross_validated)

    def _cross_validated(self) -> float:
        """The sum of the losses on the folds, each learnt from the others."""
        total = 0.0
        for fold in self.folds:
            q, a = replace(self, learn=self.learn - fold).solved()
            total += self._loss(fold, np.concatenate([q, a]))
        return total

    def solved(self) -> tuple[Array, Array]:
        """The learnt q (k,) and coefficients. The prior of q has more weight if the law leaves more than the noise: its
        residuals are correlated, and parameters must not compensate for them."""
        k = self.k
        normal, slope = self.learn[1:, 1:].copy(), self.learn[1:, 0]
        normal[k:, k:] += self.penalty
        prior = np.concatenate([np.ones(k), np.zeros(len(normal) - k)])
        # a parameter of another record, and a function that does nothing, have no information
        scale = np.sqrt(np.maximum(np.diag(normal) + prior, 1e-100))
        mean = np.concatenate([self.mean, np.zeros(len(scale) - k)])
        weight, solution = 1.0, mean
        for _ in range(3):
            matrix = (normal + np.diag(weight * prior)) / scale[:, None] / scale + 1e-9 * np.eye(len(scale))
            solution = np.linalg.solve(matrix, (weight * prior * mean - slope) / scale) / scale
            solution[:k] = self.mean + np.clip(solution[:k] - self.mean, -2.0, 2.0)
            excess = self._loss(self.learn, solution) / max(self.samples[0], 1)
            weight = 1.0 + CURVES.correlated_samples * max(excess - 1.0, 0.0)
        return solution[:k], solution[k:]

    def tried(self) -> float:
        """The loss on the samples not learnt from."""
        return self._loss(self.held_out, self._applied())

    def chance(self) -> float:
        """The p value that the law predicts the other samples no better than the parameters alone do."""
        from scipy.special import stdtr

        alone, law = np.zeros(len(self.held_out) - 1), self._applied()
        alone[:self.k] = self.of(np.zeros(0, np.int64))._applied()
        gains = np.array([self._loss(form, alone) - self._loss(form, law) for form in self.tests])
        error = float(gains.std(ddof=1)) / np.sqrt(len(gains)) if len(gains) > 1 else np.inf
        return float(stdtr(len(gains) - 1, -gains.mean() / error)) if error > 0 else float(gains.mean() <= 0)

    def _applied(self) -> Array:
        """The learnt (q, a), with separate parameters of a record fitted to the other samples."""
        q, a = self.solved()
        solution = np.concatenate([q, a])
        separate = np.flatnonzero(np.diag(self.learn)[1:1 + self.k] == 0)
        if len(separate):
            normal = self.held_out[np.ix_(1 + separate, 1 + separate)] + np.eye(len(separate))
            shared = np.delete(np.arange(len(solution)), separate)
            slope = self.held_out[1 + separate, 0] + self.held_out[np.ix_(1 + separate, 1 + shared)] @ solution[shared]
            solution[separate] = np.linalg.solve(normal, self.mean[separate] - slope)
        return solution

    @staticmethod
    def _loss(form: Array, solution: Array) -> float:
        full = np.concatenate([[1.0], solution])
        return float(max(full @ form @ full, 0.0))

    def learnt(self) -> float:
        """The loss on the samples learnt from."""
        return self._loss(self.learn, np.concatenate(self.solved()))

    @property
    def misfit(self) -> float:
        """The misfit above the noise with the parameters alone, fitted or at their known values, whichever is less: a change
        of parameters must not create a misfit to explain."""
        alone = self.of(np.zeros(0, np.int64))
        return max(min(alone.tried(), self._loss(alone.held_out, self.mean)) - self.samples[1], 1e-300)

    def r2(self, misfit: float) -> float:
        """The share of a `misfit` that the law removes."""
        return self.share(self.tried(), misfit)

    def share(self, loss: float, misfit: float) -> float:
        """The removed share of a `misfit` for a remaining `loss`."""
        return float(min(1.0, 1.0 - (loss - self.samples[1]) / misfit))


def regression(innovations: Array, learn: Mask, counts: Array, mean: Array) -> Regression:
    """From whitened innovations (N, m, 1+k+K), the mask (N,) of samples to learn from and how many values (N,) were measured
    at each."""
    size = innovations.shape[2]

    def forms(mask: Mask, blocks: int) -> tuple[Array, ...]:
        parts = (innovations[block].reshape(-1, size) for block in np.array_split(np.flatnonzero(mask), blocks))
        return tuple(part.T @ part for part in parts)

    folds, tests = forms(learn, CURVES.folds), forms(~learn, CURVES.test_blocks)
    samples = int(counts[learn].sum()), int(counts[~learn].sum())
    return Regression(np.asarray(sum(folds)), np.asarray(sum(tests)), samples, mean, folds, tests)


class Design:
    """The functions of the variables at a place: `columns` (N, K) over the samples, and the columns of each variable, of its
    rising branch and of each pair of variables. The `knots` of a variable are the `inner` ones, in the range of the samples
    learnt from, and the ends of its whole range, so that a named law continues beyond the free curve."""

    def __init__(self, variables: Sequence[Variable], learn: Mask):
        self.variables = list(variables)
        self.inner = [knots_of(v.values[learn]) for v in variables]
        self.knots = [np.unique([*inner, v.values.min(), v.values.max()]) for v, inner in
                      zip(variables, self.inner, strict=True)]
        self.pairs = list(self._pairs())[:CURVES.max_pairs]
        parts: list[Array] = []
        self._begin: dict[tuple[int, ...], int] = {}
        hats_of_variables = [hats(v.values, k) for v, k in zip(variables, self.knots, strict=True)]
        for i, basis in enumerate(hats_of_variables):
            self._add(parts, (i,), basis)
        for i, v in enumerate(variables):
            if v.kind in ("position", "across"):
                self._add(parts, (i, i), hats_of_variables[i] * v.rising[:, None])
        for i, j in self.pairs:
            second_hats = hats(variables[j].values, self.ends(j))
            self._add(parts, (i, j), (hats_of_variables[i][:, :, None] * second_hats[:, None, :]).reshape(len(second_hats),
                                                                                                          -1))
        self.columns = np.concatenate(parts, axis=1) if parts else np.zeros((len(learn), 0))

    def _add(self, parts: list[Array], key: tuple[int, ...], basis: Array) -> None:
        self._begin[key] = sum(p.shape[1] for p in parts)
        parts.append(basis)

    def _pairs(self) -> Iterator[tuple[int, int]]:
        """Pairs of speed, pressure drop or position with other variables at the place, the nearest first."""
        for j, second in enumerate(self.variables):
            for i, first in enumerate(self.variables):
                if i != j and first.kind in ("across", "position") and second.kind != "rate" \
                        and not (first.kind == "position" and second.kind == "across"):
                    yield i, j

    def ends(self, j: int) -> Array:
        """The knots of a second variable: its ends and its middle."""
        values = self.variables[j].values
        return np.array([values.min(), (values.min() + values.max()) / 2, values.max()])

    def free(self, i: int) -> Array:
        """The free curve of a variable, in the functions at its knots: constant beyond the samples learnt from."""
        return hats(self.knots[i], self.inner[i])

    def index(self, *key: int) -> Index:
        """The columns of the functions of a variable (i), of its rising branch (i, i) or of a pair (i, j)."""
        size = len(self.knots[key[0]]) * (3 if len(key) == 2 and key[0] != key[1] else 1)
        return self._begin[key] + np.arange(size)


def best_curve(design: Design, regression: Regression, learn: Mask) -> Curve | None:
    """The variable whose curve explains most of the misfit (the first of equal ones); a loop, with a branch for
    each direction, or a law of two variables only if it explains clearly more. None if no variable changes."""
    if not design.variables:
        return None
    misfit = regression.misfit
    whole = [regression.of(design.index(i)) for i in range(len(design.variables))]
    free = [part.along(design.free(i)).smooth(_differences(len(design.inner[i]))) for i, part in enumerate(whole)]
    # of a force that is hardly seen a line tells more than a free curve
    lines = [part.along(np.stack([np.ones_like(k), k], axis=1)) for part, k in zip(whole, design.knots, strict=True)]
    losses = [min(part.tried(), line.tried()) for part, line in zip(free, lines, strict=True)]
    r2 = [regression.share(loss, misfit) for loss in losses]
    scores = {v.formula: score for v, score in zip(design.variables, r2, strict=True)}
    # A variable counts as equal to the best one at noise level by its likelihood, otherwise by its share of the misfit, as
    # no law is exact then.
    least, samples = min(losses), regression.samples[1]
    margin = CURVES.strong + CURVES.inexact * samples if least <= samples + 3 * np.sqrt(2 * samples) else \
        CURVES.exact * misfit
    best = next(i for i, loss in enumerate(losses) if loss <= least + margin)
    q, a = free[best].solved()
    variable, units = design.variables[best], {v.formula: v.unit for v in design.variables}
    curve = Curve(variable, r2[best], "curve", r2[best], design.inner[best], a, q, scores, units=units)
    curve = _named(curve, learn, design.knots[best], whole[best], misfit)
    enough = max(curve.r2, 0.0) + max(0.05, 0.2 * (1 - max(curve.r2, 0.0)))
    richer = [*_of_two(design, regression, misfit), *_loops(design, regression, misfit)]
    # a loop over the position says the same as one over the speed, and more
    more = max(richer, key=lambda f: f[0].r2 - CURVES.loop_margin * (f[0].loop and f[0].variable.kind == "across"),
               default=None)
    if more is None or more[0].r2 <= enough:
        return _tested(curve, free[best], design, learn)
    curve, part, functions, law = more
    curve = _tested(curve, law, design, learn)
    if functions is not None:
        knots = next(k for v, k in zip(design.variables, design.knots, strict=True) if v is curve.variable)
        curve = _named(curve, learn, knots, part, misfit, functions)
    return replace(curve, scores=scores, units=units)


def _tested(curve: Curve, law: Regression, design: Design, learn: Mask) -> Curve:
    """The curve with its figures on the samples not learnt from."""
    names = {curve.variable.formula, curve.times, curve.second.formula if curve.second is not None else ""}
    inside = np.ones(len(learn), dtype=bool)
    for variable in design.variables:
        if variable.formula in names:
            low, high = np.quantile(variable.values[learn], [0.0, 1.0])
            inside &= (variable.values >= low) & (variable.values <= high)
    return replace(curve, covered=float(inside[~learn].mean()) if (~learn).any() else float("nan"), chance=law.chance())


def _differences(knots: int) -> Array:
    """The differences of neighbouring coefficients (knots - 1, knots)."""
    return np.asarray(np.diff(np.eye(knots), axis=0))


# A law, the regression in the functions at its knots, the functions of a second variable, and the regression of the law.
_Found = tuple[Curve, Regression, Array | None, Regression]


def _loops(design: Design, regression: Regression, misfit: float) -> Iterator[_Found]:
    for i, variable in enumerate(design.variables):
        knots, coarse = design.knots[i], design.inner[i][::2]
        if variable.kind not in ("position", "across") or len(coarse) < 2:
            continue
        H = hats(knots, coarse)  # the falling branch is the whole less the rising one
        T = np.block([[np.zeros_like(H), H], [H, -H]])
        part = regression.of(np.concatenate([design.index(i), design.index(i, i)])).along(T)
        part = part.smooth(np.asarray(np.kron(np.eye(2), _differences(len(coarse)))))
        q, a = part.solved()
        r2 = part.r2(misfit)
        yield Curve(variable, r2, "loop", r2, coarse, a[:len(coarse)], q, {}, a[len(coarse):]), part, None, part


def _of_two(design: Design, regression: Regression, misfit: float) -> Iterator[_Found]:
    """Curves times a second variable, and curves that change in proportion to it."""
    for i, j in design.pairs:
        variable, second, knots, ends = design.variables[i], design.variables[j], design.inner[i], design.ends(j)
        part, first = regression.of(design.index(i, j)), design.free(i)
        affine = np.stack([np.ones(3), ends / max(float(np.abs(ends).max()), 1e-300)], axis=1)
        both, product = (part.along(np.asarray(np.kron(first, functions))).smooth(
            np.asarray(np.kron(_differences(len(knots)), np.eye(functions.shape[1]))))
            for functions in (affine, affine[:, 1:]))
        r2, r2_product = both.r2(misfit), product.r2(misfit)
        if second.kind != "position" and r2_product >= r2 - 0.01:
            q, a = product.solved()
            yield (Curve(variable, r2_product, "curve", r2_product, knots, a, q, {}, times=second.formula), part,
                   affine[:, 1:], product)
        else:
            q, a = both.solved()
            drawn = a.reshape(-1, 2) @ affine.T
            yield Curve(variable, r2, "curve", r2, knots, drawn[:, 2], q, {}, drawn[:, 0], second=second), part, affine, both


def _named(curve: Curve, learn: Mask, knots: Array, regression: Regression, misfit: float,
           second: Array | None = None) -> Curve:
    """The best of the laws that explain as much as the free curve, with a penalty for each number of a law; the curve itself
    if there is none. `second` (3, p) are the functions of a second variable at its knots, by each of which the law is
    multiplied."""
    v, r2 = curve.variable.values[learn], curve.r2
    enough = r2 - max(CURVES.simple_share, (CURVES.simple_factor - 1) * (1 - r2))
    size = float(np.quantile(np.abs(v), 0.98)) or 1.0
    regression = replace(regression, folds=(), tests=())  # many are tried, and the sums do

    def fitted(form: Form, kinks: Kinks) -> Regression:
        T = form.basis(knots, size, kinks)
        return regression.along(T if second is None else np.asarray(np.kron(T, second)))

    def unlearnt(form: Form, kinks: Kinks) -> float:
        return -fitted(form, kinks).learnt()

    good = []
    for form in FORMS:
        if (form.crossing and not crosses_zero(v, size)) or (form.kind and curve.variable.kind != form.kind):
            continue
        kinks = best_kinks(partial(unlearnt, form), form.kinks, v)
        if len(kinks) < form.kinks:
            continue
        tried = fitted(form, kinks).r2(misfit)
        if tried >= enough:
            good.append(((CURVES.exact + 1 - tried) * CURVES.per_number**form.free, tried, form, kinks))
    if not good:
        return curve
    _, tried, form, kinks = min(good, key=lambda regression: regression[0])
    q, b = fitted(form, kinks).solved()
    drawn = form.basis(curve.x, size, kinks) @ b.reshape(len(b) // (1 if second is None else second.shape[1]), -1)
    if second is None:
        return replace(curve, r2=max(r2, tried), shape=form.name, shape_r2=tried, y=drawn[:, 0], q=q)
    if curve.times:
        return replace(curve, shape=form.name, shape_r2=tried, y=drawn[:, 0], q=q)
    ends = drawn @ second[[2, 0]].T
    return replace(curve, shape=form.name, shape_r2=tried, y=ends[:, 0], y_down=ends[:, 1], q=q)
