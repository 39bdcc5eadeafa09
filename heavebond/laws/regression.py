"""Regression of closed forms on the records: the formulas that are tried in simulation.

The response of the outputs to a term that acts at a place follows from the linear time-varying model about the estimated
motion (see `localise.kalman_smoother.Unknown.innovations`). With e (n,) the whitened innovations, E (n, k) their derivatives
with respect to the free parameters q with prior N(mean, 1), and C (n, K) the responses to K terms, the amplitudes a minimise

    |e + E q + C a|**2 + |q - mean|**2.

The formulas grow by greedy selection (orthogonal least squares; S. Chen, S. A. Billings, W. Luo, 1989,
doi:10.1080/00207178908953472): the best single forms, then the form that reduces each residual most, and a third. The
shape parameters, which enter non-linearly, are tried on a grid and then found by variable projection (G. H. Golub, V.
Pereyra, 1973, doi:10.1137/0710036). The formulas with the smallest residual for each number of parameters are kept.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import product
from typing import TypeVar

import numpy as np

from heavebond.equations.places import Place
from heavebond.laws.forms import (
    MEMORY,
    ONE_VARIABLE,
    REFERENCE,
    SLIDING,
    TRANSITION,
    TWO_VARIABLES,
    Form,
    Motion,
    Shape,
    remembered,
    values,
)
from heavebond.localise.curves import Variable
from heavebond.localise.input_estimation import Estimate, Search
from heavebond.localise.kalman_smoother import Unknown
from heavebond.localise.whitening import Whitening
from heavebond.numerics.dae import Array

T = TypeVar("T")
SAMPLES = 6000  # of each fitted record that are used, from its beginning
BETWEEN = 4  # points between two samples at which a term is evaluated for its mean
VARIABLES = 4  # variables at most that formulas are composed of
# Single forms that are refined, forms that a second is added to, pairs that a third is added to, sums that are refined.
REFINED_ALONE, SINGLES, PAIRS, REFINED = 30, 8, 4, 16
# A formula with more numbers must leave less than LESS (MUCH_LESS in the end) of what one with fewer leaves. Of each number
# of numbers EACH are kept at most that leave less than ALIKE times the least; in the end all leave less than HOPELESS times
# the least.
LESS, MUCH_LESS, EACH, ALIKE, HOPELESS = 0.97, 0.8, 4, 3.0, 20.0
LARGEST = 1e100  # magnitude of a term
MOST = 8  # formulas that are returned for a place
RANGE, HELD = 2.0, 1e4  # deviations of the prior at the ends of a range; the weight of a prior that holds the parameters
INDEPENDENT = 1e-6  # square of the part of a unit column that known ones do not take, from which on it is another
STEPS = 8  # of the refinement of shape parameters


@dataclass(frozen=True)
class Part:
    """A form of certain variables with values of its shape parameters (SI) and amplitudes (one for each term)."""

    form: Form
    first: Variable
    second: Variable | None = None
    shapes: tuple[float, ...] = ()
    amplitudes: tuple[float, ...] = ()

    @property
    def variables(self) -> tuple[Variable, ...]:
        """Those that it depends on."""
        return (self.first,) if self.second is None else (self.first, self.second)

    @property
    def families(self) -> frozenset[tuple[str, ...]]:
        """Its shape parameters, each with the variables of the part."""
        return frozenset((shape.name, *(v.formula for v in self.variables)) for shape in self.form.shapes)

    @property
    def key(self) -> tuple[str, ...]:
        """Its form and variables, without values."""
        return (self.form.name, *(v.formula for v in self.variables))


@dataclass(frozen=True)
class Composed:
    """A sum of parts, its loss (sum of squares with the prior), and the free parameters q (k,) with it."""

    parts: tuple[Part, ...]
    loss: float
    q: Array

    @property
    def numbers(self) -> int:
        """The number of its parameters."""
        return sum(part.form.numbers for part in self.parts)

    @property
    def key(self) -> frozenset[tuple[str, ...]]:
        """The keys of its parts."""
        return frozenset(part.key for part in self.parts)


@dataclass(frozen=True)
class RecordAtPlace:
    """A fitted record about its estimated motion: its time (N,), its variables at the samples (N,) and between them
    (N-1, BETWEEN), the response of the innovations to an input at the place, the innovations (N m, 1+k) of the data and the
    parameters, and which samples (N,) are learnt from."""

    time: Array
    samples: Mapping[str, Array]
    between: Mapping[str, Array]
    whitening: Whitening
    gamma: Array
    d: Array
    data: Array
    learn: Array

    def responses(self, part: Part, shapes: Sequence[Sequence[float]], fixed: Mapping[str, float]) -> Array:
        """The responses of the innovations to the terms of a part (rows, len(shapes) * terms), for several values of its
        shapes."""
        names = {"u": part.first.formula, **({"w": part.second.formula} if part.second is not None else {})}
        constants = {shape.name: np.array([chosen[k] for chosen in shapes]) for k, shape in enumerate(part.form.shapes)}
        if part.form.memory:
            constants |= {name: np.array([value]) for name, value in fixed.items()}
            columns = remembered(part.form.memory, self.time, {n: self.samples[v] for n, v in names.items()}, constants)
            return self._through(columns, (columns[1:] + columns[:-1]) / 2)
        known: dict[str, Array | float] = {**fixed, **{name: value[:, None] for name, value in constants.items()}}

        def of(motions: Mapping[str, Array]) -> Array:
            """The terms at all samples of the motions, (len(shapes) * terms, ...)."""
            every = {n: motions[v].ravel() for n, v in names.items()}
            size = (len(shapes), *motions[part.first.formula].shape)
            terms = [np.broadcast_to(values(term.text, {**every, **known}), (len(shapes), every["u"].size)).reshape(size)
                     for term in part.form.terms]
            return np.stack(terms, axis=1).reshape(-1, *size[1:])

        return self._through(of(self.samples).T, of(self.between).mean(axis=2).T)

    def _through(self, at: Array, mean: Array) -> Array:
        # a term without a finite value somewhere (an exponential of a large ratio) counts as none
        finite = (np.abs(at) < LARGEST).all(axis=0) & (np.abs(mean) < LARGEST).all(axis=0)
        responses = self.whitening.responses(np.where(finite, at, 0.0), self.gamma, self.d, np.where(finite, mean, 0.0))
        return np.asarray(responses[self.learn].reshape(-1, at.shape[1]))


@dataclass(frozen=True)
class PlaceRegression:
    """The fitted records and the variables at a place. `target` (n,): the innovations after a fit of the free parameters
    alone; `basis` (n, k): an orthonormal basis of the columns of the parameters; `weight` multiplies the prior of the
    parameters."""

    place: Place
    variables: tuple[Variable, ...]
    records: tuple[RecordAtPlace, ...]
    motions: Mapping[str, Motion]
    rows: int
    mean: Array
    weight: float = 1.0

    @cached_property
    def _parameters(self) -> tuple[Array, Array]:
        """(E, e) of all records with the rows of the prior below."""
        data = np.concatenate([record.data for record in self.records])
        k = len(self.mean)
        root = np.sqrt(self.weight)
        return np.concatenate([data[:, 1:], root * np.eye(k)]), np.concatenate([data[:, 0], -root * self.mean])

    @cached_property
    def basis(self) -> Array:
        """See the class."""
        E = self._parameters[0]
        return np.asarray(np.linalg.qr(E)[0]) if E.shape[1] else np.zeros((len(E), 0))

    @cached_property
    def target(self) -> Array:
        """See the class."""
        e = self._parameters[1]
        return np.asarray(e - self.basis @ (self.basis.T @ e))

    def fixed(self, part: Part) -> dict[str, float]:
        """The constants of a part that are not free: the reference value and the width of a sign."""
        size = rounded(self.motions[part.first.formula].size)
        return {REFERENCE: size, TRANSITION: SLIDING * size}

    def columns(self, part: Part, shapes: Sequence[Sequence[float]]) -> Array:
        """The responses to the terms of a part, without their projection on the parameters (n, len(shapes) * terms)."""
        fixed = self.fixed(part)
        responses = [record.responses(part, shapes, fixed) for record in self.records]
        whole = np.concatenate([*responses, np.zeros((len(self.mean), responses[0].shape[1]))])
        whole -= self.basis @ (self.basis.T @ whole)
        return whole

    def motion(self, part: Part, shape: Shape) -> Motion:
        """The motion of the variable in whose unit a shape parameter is."""
        return self.motions[(part.second if shape.unit == "w" and part.second is not None else part.first).formula]

    def bic(self, loss: float, numbers: int) -> float:
        """BIC of a formula with so many numbers."""
        return float(self.rows * np.log(max(loss, 1e-300) / self.rows) + numbers * np.log(self.rows))

    def solved(self, parts: Sequence[Part]) -> Composed:
        """The parts with the amplitudes that fit best."""
        C = np.concatenate([self.columns(part, [part.shapes]) for part in parts], axis=1)
        a = _amplitudes(C, self.target)
        residual = self.target + C @ a
        ends = np.cumsum([0, *(len(part.form.terms) for part in parts)])
        fitted = tuple(replace(part, amplitudes=tuple(map(float, a[i:j])))
                       for part, i, j in zip(parts, ends[:-1], ends[1:], strict=True))
        return Composed(fitted, float(residual @ residual), self._q(fitted))

    def _q(self, parts: Sequence[Part]) -> Array:
        """The free parameters with these parts."""
        E, e = self._parameters
        if not E.shape[1]:
            return np.zeros(0)
        acting = np.concatenate([
            sum((record.responses(part, [part.shapes], self.fixed(part)) @ np.array(part.amplitudes) for part in parts),
                np.zeros(1)) for record in self.records])
        e = e + np.concatenate([acting, np.zeros(len(self.mean))])
        return np.asarray(np.linalg.lstsq(E, -e, rcond=None)[0])


def rounded(value: float) -> float:
    """A value to one significant digit."""
    return float(f"{value:.0e}")


def at_place(search: Search, estimate: Estimate, place: Place, variables: Sequence[Variable]) -> PlaceRegression:
    """The regression at a place; the values of the variables cover all records, one after another."""
    from scipy.interpolate import CubicSpline

    records, begin = [], 0
    mean = -search.centre(estimate.systems)
    for side in search.sides:
        end = begin + len(side.time)
        if side.record.use == "fit":
            count = min(len(side.time), SAMPLES)
            system = estimate.systems[side.record.name]
            unknown = Unknown(system, list(side.nodes), [place], np.ones(1))
            innovations = unknown.innovations(np.zeros((len(side.time), 0)))
            wide = np.zeros((*innovations.shape[:2], 1 + search.width))
            wide[:, :, [0, *(1 + search.columns(side.record.name))]] = innovations
            time, learn = side.time[:count], np.asarray(side.learn[:count], bool)
            samples = {v.formula: v.values[begin:begin + count] for v in variables}
            middle = time[:-1, None] + np.diff(time)[:, None] * (np.arange(BETWEEN) + 0.5) / BETWEEN
            between = {n: np.asarray(CubicSpline(time, v)(middle)) for n, v in samples.items()}
            whitening = unknown.system.whitening
            short = Whitening(whitening.by_state[:count], whitening.by_error[:count], whitening.step[:count - 1],
                              whitening.gain[:count - 1])
            records.append(RecordAtPlace(time, samples, between, short, unknown.gamma[:count - 1, 0], unknown.d[:count, 0],
                                         wide[:count][learn].reshape(-1, wide.shape[2]), learn))
        begin = end
    motions = {}
    for v in variables:
        every = np.concatenate([record.samples[v.formula] for record in records])
        interval = float(np.median(np.diff(records[0].time)))
        motions[v.formula] = Motion(float(every.min()), float(every.max()),
                                    np.quantile(every, np.linspace(0.1, 0.9, 9)), interval)
    rows = sum(len(record.data) for record in records)
    return PlaceRegression(place, tuple(variables), tuple(records), motions, rows, mean)


def _amplitudes(C: Array, target: Array) -> Array:
    """The a that minimise |target + C a|, scaled so that units do not matter."""
    size = np.linalg.norm(C, axis=0)
    size = np.where(size > 0, size, 1.0)
    return np.asarray(np.linalg.lstsq(C / size, -target, rcond=1e-10)[0] / size)


# -- search ----------------------------------------------------------------------------------------------------------------
def parts_of(variables: Sequence[Variable]) -> Iterator[Part]:
    """Every form of every variable that it is meant for, without values; of two variables the first acts across the
    place."""
    for form in (*ONE_VARIABLE, *MEMORY):
        yield from (Part(form, v) for v in (variables[:1] if form.name == "constant" else variables)
                    if form.first in ("", v.kind))
    for form in TWO_VARIABLES:
        yield from (Part(form, v, w) for v in variables if v.kind == form.first for w in variables
                    if w is not v and form.second in ("any", w.kind))


class _Grid:
    """The columns C (n, m) of every part at every value of its shape on the grid, with length 1 or, without influence on the
    records, 0: `squares` (m,). `towards` (m,) are their scalar products with the target. `groups` are the parts with their
    values and columns; `grams` the scalar products of the columns of those with several terms."""

    def __init__(self, problem: PlaceRegression):
        self.problem, self.groups, self.grams = problem, list[tuple[Part, slice]](), dict[int, Array]()
        tried = [(part, list(product(*([float(v) for v in shape.tried(problem.motion(part, shape)) if v]
                                       for shape in part.form.shapes)))) for part in parts_of(problem.variables)]
        count = sum(len(shapes) * len(part.form.terms) for part, shapes in tried)
        most = max(len(part.form.terms) for part, _ in tried)
        # columns are added behind those of the grid
        self._store = np.empty((len(problem.target), count + SINGLES * most), order="F")
        self.C, self.squares, self.towards = self._store[:, :0], np.zeros(0), np.zeros(0)
        for part, shapes in tried:
            self._join(part, shapes, problem.columns(part, shapes))

    def _join(self, part: Part, shapes: Sequence[tuple[float, ...]], block: Array) -> None:
        """Add the columns of a part at several values of its shape."""
        finite, size = np.asarray(np.isfinite(block).all(axis=0)), np.linalg.norm(block, axis=0)
        block /= np.where((size > 0) & np.isfinite(size), size, 1.0)
        begin, each = self.C.shape[1], len(part.form.terms)
        self.C = self._store[:, :begin + block.shape[1]]
        self.C[:, begin:] = block
        self.squares = np.concatenate([self.squares, (size > 0).astype(float)])
        self.towards = np.concatenate([self.towards, block.T @ self.problem.target])
        for k, chosen in enumerate(shapes):
            of_block = slice(k * each, (k + 1) * each)
            if finite[of_block].all():
                if each > 1:
                    self.grams[len(self.groups)] = block[:, of_block].T @ block[:, of_block]
                self.groups.append((replace(part, shapes=chosen), slice(begin + of_block.start, begin + of_block.stop)))

    def add(self, part: Part) -> int:
        """Add a part with its values; its index."""
        self._join(part, [part.shapes], self.problem.columns(part, [part.shapes]))
        return len(self.groups) - 1

    def best(self, known: Sequence[int], number: int) -> list[tuple[int, float]]:
        """The groups (indices) that together with known groups have the smallest residuals, one of each form and
        variables, with their losses; groups that share a shape parameter and variables with a known group are left out."""
        r, projection = self.problem.target, np.zeros((0, self.C.shape[1]))
        towards, total = self.towards, float(r @ r)
        if known:
            Q = np.linalg.qr(np.concatenate([self.C[:, self.groups[k][1]] for k in known], axis=1))[0]
            projection, along = Q.T @ self.C, Q.T @ r
            towards, total = towards - projection.T @ along, total - float(along @ along)
        alike = {family for k in known for family in self.groups[k][0].families}
        squares = self.squares - (projection**2).sum(axis=0)  # without the projection on the columns of known groups
        with np.errstate(divide="ignore", invalid="ignore"):
            gains = np.where(squares < INDEPENDENT, -np.inf, towards**2 / squares)
        losses: dict[tuple[str, ...], tuple[float, int]] = {}
        for k, (part, where) in enumerate(self.groups):
            gain = float(gains[where.start])
            if k in self.grams and np.isfinite(gain := float(gains[where].min())):
                G = self.grams[k] - projection[:, where].T @ projection[:, where]
                gain = float(towards[where] @ np.linalg.lstsq(G, towards[where], rcond=1e-8)[0])
            if total - gain < losses.get(part.key, (np.inf, 0))[0] and not alike & part.families:
                losses[part.key] = (total - gain, k)

        def cost(entry: tuple[float, int]) -> float:
            return self.problem.bic(entry[0], self.groups[entry[1]][0].form.numbers)

        return [(k, loss) for loss, k in sorted(losses.values(), key=cost)[:number]]


def composed(problem: PlaceRegression) -> list[Composed]:
    """As `_composed`. If the free parameters of the best formulas leave their ranges, which the normal prior permits and a
    refit does not, the formulas with parameters that hardly move come as well."""
    formulas = leading(_composed(problem), MOST)
    beyond = any(np.any(np.abs(formula.q - problem.mean) > RANGE) for formula in formulas)
    return [*formulas, *(leading(_composed(replace(problem, weight=HELD)), MOST) if beyond else [])]


def _composed(problem: PlaceRegression) -> list[Composed]:
    """The formulas that leave least of the records with each number of numbers, with refined shape parameters, best
    first."""
    grid = _Grid(problem)
    refined: dict[frozenset[tuple[str, ...]], Composed] = {}

    def refine(parts: Sequence[Part]) -> Composed:
        fitted = _refined(problem, parts)
        if fitted.key not in refined or fitted.loss < refined[fitted.key].loss:
            refined[fitted.key] = fitted
        return fitted

    alone = sorted((refine([grid.groups[k][0]]) for k, _ in grid.best((), REFINED_ALONE)), key=lambda f: f.loss)
    singles = [(grid.add(formula.parts[0]), formula.loss) for formula in alone[:SINGLES]]
    pairs = sorted(((loss, (k, added)) for k, _ in singles for added, loss in grid.best((k,), 3)), key=lambda p: p[0])
    triples = [(loss, (*pair, added)) for _, pair in pairs[:PAIRS] for added, loss in grid.best(pair, 2)]
    chosen = {frozenset(groups): loss for loss, groups in [*((loss, (k,)) for k, loss in singles), *pairs, *triples]}
    for groups in _leading({g: loss for g, loss in chosen.items() if len(g) > 1},
                           lambda groups: sum(grid.groups[k][0].form.numbers for k in groups), REFINED):
        refine([grid.groups[k][0] for k in groups])
    return sorted(refined.values(), key=lambda f: f.loss)


def leading(formulas: Sequence[Composed], most: int) -> list[Composed]:
    """The formulas that leave least of those with no more numbers, some of each number of numbers."""
    least = min(formula.loss for formula in formulas)
    by_loss = {k: formula.loss for k, formula in enumerate(formulas) if formula.loss < HOPELESS * least}
    return [formulas[k] for k in _leading(by_loss, lambda k: formulas[k].numbers, most, MUCH_LESS)]


def _leading(losses: Mapping[T, float], numbers: Callable[[T], int], most: int, less: float = LESS) -> list[T]:
    """The formulas with the smallest losses for each number of parameters, in the order of these numbers, if the best of
    them has less than `less` times the loss of the best with fewer parameters."""
    chosen, least = list[T](), np.inf
    for count in sorted({numbers(one) for one in losses}):
        order = sorted((one for one in losses if numbers(one) == count), key=lambda one: losses[one])
        if losses[order[0]] < less * least:
            least = losses[order[0]]
            chosen += [one for one in order[:EACH] if losses[one] < ALIKE * least]
    return chosen[:most]


def _refined(problem: PlaceRegression, parts: Sequence[Part]) -> Composed:
    """The parts with their shape parameters at the nearest minimum of the loss: Gauss-Newton steps of variable projection,
    with differences for the derivatives of the columns."""
    from scipy.optimize import least_squares

    where = [(i, j) for i, part in enumerate(parts) for j in range(len(part.form.shapes))]
    if not where:
        return problem.solved(parts)
    bounds = [parts[i].form.shapes[j].bounds(problem.motion(parts[i], parts[i].form.shapes[j])) for i, j in where]
    start = np.array([parts[i].shapes[j] for i, j in where])
    low, high = np.array([b[0] for b in bounds]), np.array([b[1] for b in bounds])
    size = np.abs(start)

    @lru_cache(maxsize=4 * len(parts))  # most steps move the shapes of one part
    def columns(i: int, shapes: tuple[float, ...]) -> Array:
        return problem.columns(parts[i], [shapes])

    def at(z: Array) -> list[Part]:
        shaped = [list(part.shapes) for part in parts]
        for (i, j), value in zip(where, z * size, strict=True):
            shaped[i][j] = float(value)
        return [replace(part, shapes=tuple(s)) for part, s in zip(parts, shaped, strict=True)]

    def residual(z: Array) -> Array:
        C = np.concatenate([columns(i, part.shapes) for i, part in enumerate(at(z))], axis=1)
        if not np.all(np.isfinite(C)):
            return np.full(len(problem.target), 1e6)
        return np.asarray(problem.target + C @ _amplitudes(C, problem.target))

    low, high = np.minimum(low / size, high / size), np.maximum(low / size, high / size)
    x0 = np.clip(start / size, low + 1e-9, high - 1e-9)
    solution = least_squares(residual, x0, bounds=(low, high), max_nfev=STEPS, diff_step=np.full(len(x0), 1e-5), x_scale=0.1)
    return problem.solved(at(solution.x))
