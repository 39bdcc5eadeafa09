"""The third law of a component: the power that enters it is stored, dissipated, or declared to be unbalanced.

    sum over the ports of effort * flow = d(stores)/dt + dissipates + unbalanced,  dissipates >= 0

for every motion that the component's equations permit. The law is checked on random motions: random parameters, and
random jets (values, first and second derivatives) of all variables in the equations. A Gauss-Newton method projects each
jet with the smallest change onto the equations and onto their time derivatives of the orders in the jet. Directions that
the equations do not determine stay random, so the points cover all motions, not only those of one machine.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice, product
from math import inf, isfinite, sqrt
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from heavebond.core.errors import ModelError
from heavebond.core.threads import single_threaded
from heavebond.core.units import ONE, Dimension, Unit, solved, times
from heavebond.language.definition import Component, Domain, FrameRelation, Parameter
from heavebond.language.external_functions import NOT_ALLOWED
from heavebond.language.incidence import UNIT
from heavebond.language.lists import written_out
from heavebond.language.symbols import split, stack
from heavebond.language.template import LEVELS, FrameForm, Template, template, turning_speed
from heavebond.text.dimensions import SECOND
from heavebond.text.expression import Call, Name, constant

Array = NDArray[np.float64]

# A jet satisfies the equations to some 1e-13 of its size, and the sizes of one jet span 10**3.5, so the rounding error is
# below 1e-9 of the largest power; a wrong sign or a missing term is of order one.
TOLERANCE = 1e-6
# Where equations keep a port from taking power (a fixed point) all terms are zero but for rounding; powers below this
# share of effort size * flow size are treated as zero.
APPARENT = 1e-6
DRAWS = 200  # jets in each domain; a law that fails for 2 % of them escapes once in 57 trials
RATE_DRAWS = 10  # jets in which a rate of a frame is compared; a wrong one differs in almost every jet
ATTEMPTS = 5  # attempts for each required jet
ENOUGH = 0.3  # share of the required jets below which the law counts as not tried
# Newton's method: the residual is in relative changes of the values (of SMALLEST times the usual size near zero)
MOST_STEPS = 20
SOLVED = 1e-12  # largest error of a solution by Cholesky factorisation, relative to the right-hand side
SMALLEST = 1e-6
CONVERGED, ROUNDING = 1e-13, 1e-14
SWEEPS = 6  # chained assignments in a component


@dataclass(frozen=True)
class PowerReport:
    """Result of the power check of one component.

    `tried` jets; `imbalance`: the worst |power in - d(stores)/dt - dissipates - unbalanced| and `dissipation`: the lowest
    `dissipates`, both relative to the largest power at that point; `exempt`: reason if no check was needed; `notes`: the
    worst point.
    """

    component: str
    tried: int
    imbalance: float = 0.0
    dissipation: float = 0.0
    exempt: str = ""
    notes: tuple[str, ...] = ()

    @property
    def holds(self) -> bool:
        """True if the law holds; a law that could not be tried does not hold."""
        return bool(self.exempt) or (
            self.tried > 0 and self.imbalance <= TOLERANCE and self.dissipation >= -TOLERANCE)

    @property
    def verdict(self) -> str:
        if self.exempt:
            return f"{self.component}: not tried, {self.exempt}"
        if not self.tried:
            return f"{self.component}: too few motions satisfy its equations within the bounds to try its power"
        if self.imbalance > TOLERANCE:
            return (f"{self.component}: up to {self.imbalance:.2g} of the power in is neither stored, dissipated nor "
                    "declared as unbalanced")
        if self.dissipation < -TOLERANCE:
            return f"{self.component}: dissipates becomes negative, down to {self.dissipation:.2g} of the power there"
        return f"{self.component}: power balances to {self.imbalance:.1g} in {self.tried} motions"


@single_threaded
def check_power(component: Component, domains: Mapping[str, Domain], seed: int = 0) -> PowerReport:
    """Check law 3 of one component; a port of a generic domain (`$D`) is tried in each domain with an effort and a flow."""
    exempt = "its power is the sum of its parts" if component.composite else \
        "it carries signals only" if not component.ports and component.stores is None else \
        f"declared `power: {component.power}`" if component.power else ""
    if exempt:
        return PowerReport(component.name, 0, exempt=exempt)
    try:
        reports = [_Trial(component, domains, bound, seed).report() for bound in _bindings(component, domains)]
    except ModelError as error:
        if error.problems[0].code != NOT_ALLOWED:
            raise
        return PowerReport(component.name, 0, exempt=f"{error.problems[0].message}; give --allow-native")
    failed = [r for r in reports if not r.holds]
    worst = max(failed or reports, key=lambda r: max(r.imbalance, -r.dissipation))
    tried = min(r.tried for r in reports)
    return PowerReport(component.name, tried, worst.imbalance, worst.dissipation, notes=worst.notes)


def powers(component: Component, domains: Mapping[str, Domain]) -> tuple[tuple[str, ...], Array]:
    """The names of the ports, and for each motion (n,) of the trial with the largest violation: power in, d(stores)/dt,
    dissipates, unbalanced, the size below which powers are treated as zero, and the power in at each port."""
    reports = []
    for bound in _bindings(component, domains):
        trial = _Trial(component, domains, bound)
        rows = np.array([np.concatenate([terms[:4], [APPARENT * terms[4]], terms[6:]]) for terms, _, _ in trial.motions()])
        lost = np.abs(rows[:, 0] - rows[:, 1:4].sum(axis=1)) + np.maximum(-rows[:, 2], 0)
        sizes = np.abs(rows[:, [1, 2, 3, *range(5, rows.shape[1])]]).max(axis=1) + rows[:, 4]
        reports.append((float((lost / np.where(sizes > 0, sizes, 1.0)).max()), tuple(trial.ports), rows))
    _, ports, rows = max(reports, key=lambda item: item[0])
    return ports, rows


def wrong_rates(component: Component, domains: Mapping[str, Domain]) -> list[tuple[FrameRelation, str]]:
    """The relations of frames whose `spin` or `speed` is not the rate of their `turn` or `shift` in random motions, with the
    key."""
    if not component.frames:
        return []
    trial = _Trial(component, domains, next(_bindings(component, domains)))
    n = len(trial.made.slots)
    y, p, t = ca.SX.sym("y", LEVELS*n), ca.SX.sym("p", len(trial.made.given)), ca.SX.sym("t")
    arguments = [*(y[k*n:(k + 1)*n] for k in range(LEVELS)), p, t, ca.SX(1)]
    place = {slot: k for k, slot in enumerate(trial.made.slots)}
    checks = []  # (relation, key, the residual of the rates, the velocities with which it is compared)
    for relation, law in zip(component.frames, trial.made.frames, strict=True):
        domain = domains[trial.bound[relation.b]]
        speeds = tuple(domain.rate(position) for position in domain.positions)
        for key, forms, begin, members in (("spin", law.rotation, 4, domain.vectors[domain.turning]),
                                           ("speed", law.translation, 3, speeds)):
            if forms and getattr(relation, key) is not None:
                velocities = y[[place[f"{relation.b}.{member}"] for member in members]]
                checks.append((relation, key, forms[FrameForm.FORWARD].residuals(*arguments)[begin:], velocities))
    sizes = ca.Function("rates", [y, p, t], [stack([ca.norm_inf(residual) for _, _, residual, _ in checks]),
                                             stack([1 + ca.norm_inf(velocities) for *_, velocities in checks])])
    worst = np.zeros(len(checks))
    for _, parameters, jet in islice(trial.motions(), RATE_DRAWS):
        residual, size = (np.array(values).ravel() for values in sizes(jet, parameters, trial.instant))
        worst = np.maximum(worst, residual/size)
    return [(relation, key) for (relation, key, *_), error in zip(checks, worst, strict=True) if error > TOLERANCE]


def _bindings(component: Component, domains: Mapping[str, Domain]) -> Iterator[dict[str, str]]:
    """The domain of every port, for every choice of the generic ones."""
    generic = list(dict.fromkeys(p.domain for p in component.ports.values() if p.domain.startswith("$")))
    with_effort = [name for name, domain in domains.items() if domain.effort and domain.flow]
    for choice in product(with_effort, repeat=len(generic)):
        of = dict(zip(generic, choice, strict=True))
        yield {name: of.get(port.domain, port.domain) for name, port in component.ports.items()}


def usual_sizes(domains: Iterable[Domain]) -> dict[Dimension, float]:
    """Sizes by dimension: of the variables of ports, of their rates and integrals, and of their ratios and products.

    A stiffness, for example, has the size of a force over the size of a position. If one dimension results in several
    ways (kg/s**2 is a stiffness, and a mass flow over a time), the first domain decides.
    """
    return _sizes(tuple(tuple((m.unit.dimension, m.nominal) for m in domain.members.values()) for domain in domains))


@lru_cache(maxsize=64)
def _sizes(members: tuple[tuple[tuple[Dimension, float], ...], ...]) -> dict[Dimension, float]:
    size_by_dimension: dict[Dimension, float] = {ONE: 1.0, SECOND: 1.0}
    groups = [_first_of_each(group).items() for group in (*members, [m for group in members for m in group])]
    for group in groups:
        _note(size_by_dimension, group, (0, 1, -1, 2, -2))
    for power in (-1, 1):  # ratios of all quantities before products: an area is N/Pa rather than m*m
        for group in groups:
            _note(size_by_dimension, [(times(a, b, power), size_a * size_b**power)
                                      for (a, size_a), (b, size_b) in product(group, group)], (0, 1, -1))
    return size_by_dimension


def _note(size_by_dimension: dict[Dimension, float], quantities: Iterable[tuple[Dimension, float]],
          orders: Iterable[int]) -> None:
    """Add the quantities times powers of a second if their dimension is new."""
    first = _first_of_each(quantities)
    for k in orders:
        for dimension, size in first.items():
            size_by_dimension.setdefault(times(dimension, SECOND, k), size)


def _first_of_each(quantities: Iterable[tuple[Dimension, float]]) -> dict[Dimension, float]:
    """The first size of each dimension."""
    first: dict[Dimension, float] = {}
    for dimension, size in quantities:
        first.setdefault(dimension, size)
    return first


class _Trial:
    """Power check of one component with its ports in given domains."""

    def __init__(self, component: Component, domains: Mapping[str, Domain], bound: Mapping[str, str], seed: int = 0):
        integers = {n: _whole(p) for n, p in component.parameters.items() if p.integer}
        component = written_out(component, integers)
        self.component, self.domains, self.bound = component, domains, bound
        self.random = np.random.default_rng(seed)
        self.instant = 0.0  # of the last motion
        bound_domains = list(dict.fromkeys(bound.values()))
        self.sizes = usual_sizes([domains[name]
                                  for name in (*bound_domains, *(n for n in domains if n not in bound_domains))])
        self.generic = {f"{component.ports[port].domain}.{role}": domains[name].members[member].unit.dimension
                        for port, name in bound.items() for role, member in (
                            ("effort", domains[name].effort), ("flow", domains[name].flow)) if member}
        self.made: Template = template(component, domains, bound, integers)
        # the elements of each matrix among the parameters that must be positive by `requires:`, and whether also symmetric
        wanted: dict[str, set[str]] = {}
        for formula in self.component.requires:
            if isinstance(formula.tree, Call) and isinstance(formula.tree.args[0], Name):
                wanted.setdefault(formula.tree.args[0].text, set()).add(formula.tree.function)
        self.matrices = [([k for k, n in enumerate(self.made.parameters) if n.startswith(f"{name}[")], "symmetric" in kinds)
                         for name, kinds in wanted.items()]
        # the domain of each port, with every element of an array (`p[2]`)
        self.ports: dict[str, Domain] = {}
        for slot in self.made.slots:
            port, _, member = slot.rpartition(".")
            if member and port:
                self.ports[port] = self.domains[self.bound[port.partition("[")[0]]]
        self.size = np.array([self._size(slot) for slot in self.made.slots])
        self.low, self.high = np.array([self._slot_bounds(slot) for slot in self.made.slots]).T
        self.usual = {n: self._usual(p.unit) for n, p in component.parameters.items()}
        system, terms = self._functions()
        self.system, self.terms = _Evaluation(system), _Evaluation(terms)
        self.nominal = np.tile(self.size, LEVELS)  # usual sizes of a jet
        self.usual_low, self.usual_high = (np.concatenate([bounds, np.full((LEVELS - 1) * len(self.size), sign * inf)])
                                           for bounds, sign in ((self.low, -1), (self.high, 1)))
        # equations that can be satisfied by other rates should not be satisfied by slower motions
        self.readiness = np.repeat([1e3**k for k in range(LEVELS)], len(self.size))
        # (equation, slot) if an equation gives a slot with coefficient 1, inner variables and through variables first
        across = {f"{port}.{member}" for port, domain in self.ports.items() for member in domain.across}
        slot_of_equation: dict[int, int] = {}
        for i, row in enumerate(self.made.entries):
            choices = [e.column for e in row if e.kind == UNIT and e.column < len(self.size)
                       and e.column not in slot_of_equation.values() and self.made.slots[e.column] not in across]
            if choices:
                slot_of_equation[i] = max(choices, key=lambda c: self.made.slots[c] in self.component.variables)
        assignments = list(slot_of_equation.items())
        self.assigning = np.array([i for i, _ in assignments], dtype=int)  # equations
        self.assigned = np.array([k for _, k in assignments], dtype=int)  # the slots that they give
        self.defaults = {n: None if p.default is None else constant(p.default.expr)
                         for n, p in component.parameters.items()}

    # -- the equations and the powers ------------------------------------------------------------------------------

    def _functions(self) -> tuple[ca.Function, ca.Function]:
        """Residuals (m,) with their Jacobian, and the powers, of a jet y = (slots, d slots, d2 slots)."""
        n = len(self.made.slots)
        levels = [ca.SX.sym(f"level{k}", n) for k in range(LEVELS)]
        p, t = ca.SX.sym("p", len(self.made.given)), ca.SX.sym("t")
        y = stack(levels)
        arguments = [*levels, p, t, ca.SX(1)]
        residuals = split(self.made.residuals(*arguments)) if self.made.lines else []
        orders = [max((e.column // n for e in row), default=0) for row in self.made.entries]
        place = {slot: k for k, slot in enumerate(self.made.slots)}
        for port, domain in self.ports.items():
            for position in domain.positions:
                if f"{port}.{position}" in place:
                    x, v = place[f"{port}.{position}"], place[f"{port}.{domain.rate(position)}"]
                    residuals.append(levels[1][x] - levels[0][v])
                    orders.append(1)
            if domain.orientation and f"{port}.{domain.orientation[0]}" in place:
                q, w = ([place[f"{port}.{member}"] for member in members] for members in (
                    domain.orientation, domain.vectors[domain.turning]))
                residuals += [ca.sumsqr(levels[0][q]) - 1, *split(levels[0][w] - turning_speed(levels[0][q], levels[1][q]))]
                orders += [0, 1, 1, 1]
        for law in self.made.frames:
            for forms in (law.rotation, law.translation):
                if forms:
                    residuals += split(forms[FrameForm.CLOSING].residuals(*arguments))
                    orders += [0, 0, 0]
        # the time derivatives of equations that the jet contains: two of an equation without derivatives, one of first
        # order
        low, high = stack(levels[:-1]), stack(levels[1:])
        rate_residuals: list[ca.SX] = []
        pending = list(zip(residuals, orders, strict=True))
        while pending := [(r, k) for r, k in pending if k < LEVELS - 1]:
            column = stack([r for r, _ in pending])
            rates = split(ca.jtimes(column, low, high) + ca.jtimes(column, t, ca.SX(1)))
            rate_residuals += rates
            pending = [(r, k + 1) for r, (_, k) in zip(rates, pending, strict=True)]
        rows = stack([*residuals, *rate_residuals])
        *energy, store = split(self.made.energy(*arguments))
        port_powers = [self._port_power(port, domain, levels[0], place) for port, domain in self.ports.items()]
        # energy exchange between the stores of one component may cancel, in a pendulum completely
        exchanged = ca.dot(ca.fabs(ca.gradient(store, stack(levels[:-1]))), ca.fabs(stack(levels[1:])))
        apparent = sum((a for _, a in port_powers), ca.SX(0))
        return (ca.Function("system", [y, p, t], [ca.densify(rows), ca.densify(ca.jacobian(rows, y))]),
                ca.Function("terms", [y, p, t],
                            [stack([*energy, apparent, exchanged, *(power for power, _ in port_powers)])]))

    def _port_power(self, port: str, domain: Domain, slots: ca.SX, place: Mapping[str, int]) -> tuple[ca.SX, ca.SX]:
        """Power into a port, and the product of the usual sizes of its effort and flow."""
        if domain.power:
            k = place[f"{port}.{domain.power}"]
            return slots[k], ca.fabs(slots[k]) + self.size[k]
        power, size = ca.SX(0), ca.SX(0)
        for effort, flow in domain.pairs:
            e, f = place[f"{port}.{effort}"], place[f"{port}.{flow}"]
            power += slots[e] * slots[f]
            size += ca.fabs(slots[e]) * self.size[f] + self.size[e] * ca.fabs(slots[f])
        return power, size

    # -- random numbers --------------------------------------------------------------------------------------------
    def _size(self, slot: str) -> float:
        port, _, member = slot.rpartition(".")
        if port:
            return self.ports[port].members[member].nominal
        variable = self.component.variables.get(slot)
        if variable is not None:
            return max(self._usual(variable.unit), abs(variable.start or 0.0))
        return self._usual(self.component.signals[slot].unit)

    def _usual(self, unit: Unit) -> float:
        return self.sizes.get(solved(unit.dimension, self.generic), 1.0)

    def _slot_bounds(self, slot: str) -> tuple[float, float]:
        port, _, member = slot.rpartition(".")
        if port:
            # pressure and temperature of a port that carries enthalpy are absolute
            absolute = self.ports[port].power is not None and member in self.ports[port].across
            return (0.0, inf) if absolute else (-inf, inf)
        variable = self.component.variables.get(slot)
        if variable is None:
            return -inf, inf
        return -inf if variable.low is None else variable.low, inf if variable.high is None else variable.high

    def _spread(self, size: Array, low: Array, high: Array) -> Array:
        """Numbers between their bounds; without bounds of either sign, of sizes between size/1000 and 3 size."""
        number = size * 10 ** self.random.uniform(-3, 0.5, len(size))
        signed = np.where(self.random.random(len(size)) < 0.5, -number, number)
        below, above = np.isfinite(low), np.isfinite(high)
        inside = low + self.random.random(len(size)) * (high - low)
        return np.where(below & above, inside, np.where(below, low + number, np.where(above, high - number, signed)))

    def _parameter(self, name: str) -> float:
        """A value around the default; else of the usual size of its unit; sometimes the value at which the parameter has
        no effect.
        """
        parameter = self.component.parameters[name]
        low = -inf if parameter.low is None else parameter.low
        high = inf if parameter.high is None else parameter.high
        if parameter.neutral is not None and self.random.random() < 0.3:
            return parameter.neutral
        default = self.defaults[name]
        if default:
            return min(max(default * 10 ** self.random.uniform(-0.5, 0.5), low), high)
        size = self.usual[name]
        if low > -inf and high == inf:
            return low + float(size * 10 ** self.random.uniform(-1, 1))
        number = size * 10 ** self.random.uniform(-3, 0.5)  # as `_spread`
        signed = -number if self.random.random() < 0.5 else number
        inside = self.random.random()
        if low > -inf:
            return low + inside * (high - low)
        return signed if high == inf else high - number

    def _parameters(self) -> Array | None:
        """Random values of all parameters that satisfy `requires:`, followed by the held variables; None after thirty
        failed draws.
        """
        for _ in range(30):
            p = np.array([self._parameter(n) for n in self.made.parameters])
            for elements, symmetric in self.matrices:
                # a random positive definite matrix of about the size of a random one (n*n,), row by row
                rows = p[elements]
                order = round(sqrt(len(rows)))
                matrix = rows.reshape(order, order)
                size = float(np.abs(matrix).max()) or 1.0
                positive = matrix @ matrix.T / size + 1e-3 * size * np.eye(order)
                p[elements] = np.ravel(positive if symmetric else positive + matrix - matrix.T)
            if not self.component.requires or np.all(np.array(self.made.requirements(p))):
                held = [self.component.held[n] for n in self.made.held]
                sizes = np.array([max(self._usual(v.unit), abs(v.held or 0.0)) for v in held])
                low, high = (np.array([limit if value is None else value for value in values]) for limit, values in (
                    (-inf, [v.low for v in held]), (inf, [v.high for v in held])))
                return np.append(p, self._spread(sizes, low, high))
        return None

    # -- a motion --------------------------------------------------------------------------------------------------
    def _jet(self, p: Array, t: float) -> Array | None:
        """A random jet on the equations and within the bounds, or None."""
        y = self._spread(self.nominal, self.usual_low, self.usual_high)
        projected = self._on_equations(self._assigned(y, p, t), p, t)
        if projected is None:
            return None
        slots, slack = projected[: len(self.size)], 1e-9 * self.size
        return projected if np.all((slots >= self.low - slack) & (slots <= self.high + slack)) else None

    def _assigned(self, y: Array, p: Array, t: float) -> Array:
        """Carry out every assignment `F = ...` a few times on the guess: from an arbitrary guess Newton's method fails at
        the kinks of `max` and `min`. If the values diverge, the guess is unchanged."""
        guess = y.copy()
        for _ in range(SWEEPS):
            residual, jacobian = self.system(guess, p, t)
            guess[self.assigned] -= residual[self.assigning] * jacobian[self.assigning, self.assigned]
        return guess if np.isfinite(self.system(guess, p, t)[0]).all() else y

    def _on_equations(self, y: Array, p: Array, t: float) -> Array | None:
        """Gauss-Newton with the smallest steps relative to the values, halved until the residual falls."""
        residual, jacobian = self._at(y, p, t)
        for _ in range(MOST_STEPS):
            scale = self.readiness * np.maximum(np.abs(y), SMALLEST * self.nominal)
            scaled = jacobian * scale
            gradient = np.abs(scaled).max(axis=1, initial=0.0)
            weights = np.asarray(1 / np.where(gradient > 0, gradient, 1.0))
            weighted = residual * weights
            norm = sqrt(weighted @ weighted)
            if not isfinite(norm):
                return None
            if norm < ROUNDING * sqrt(len(residual)):
                return y
            step = _least(scaled * weights[:, None], -weighted) * scale
            length = 1.0
            while length > 1e-2:
                trial = y + length * step
                new, new_jacobian = self._at(trial, p, t)
                lower = new * weights
                if sqrt(lower @ lower) < norm:
                    break
                length /= 2
            else:
                # as small as rounding permits, or at a kink
                return y if norm < CONVERGED * sqrt(len(residual)) else None
            y, residual, jacobian = trial, new, new_jacobian
        return None

    def _at(self, y: Array, p: Array, t: float) -> tuple[Array, Array]:
        residual, jacobian = self.system(y, p, t)
        return residual.copy(), jacobian.copy(order="F")

    def motions(self) -> Iterator[tuple[Array, Array, Array]]:
        """The terms, parameters and jets of motions, up to the required number."""
        tried, begun = 0, 0
        with np.errstate(all="ignore"):
            while tried < DRAWS and begun < ATTEMPTS * DRAWS:
                begun += 1
                p, t = self._parameters(), float(self.random.uniform(0, 10))
                self.instant = t
                y = None if p is None else self._jet(p, t)
                if p is None or y is None:
                    continue
                tried += 1
                yield self.terms(y, p, t)[0].copy(), p, y

    def report(self) -> PowerReport:
        """The largest violation in many motions."""
        tried, worst = 0, PowerReport(self.component.name, 0)
        for terms, p, y in self.motions():
            tried += 1
            power, stored, dissipated, unbalanced, apparent = terms[:5].tolist()
            size = float(np.abs([*terms[5:], stored, dissipated, unbalanced]).max()) + APPARENT * apparent
            imbalance = abs(power - stored - dissipated - unbalanced) / size if size else 0.0
            negative = min(0.0, dissipated / size) if size else 0.0
            if max(imbalance, -negative) < max(worst.imbalance, -worst.dissipation):
                continue
            values = [f"{n} = {v:.4g}" for n, v in zip((*self.made.given, *self.made.slots), (*p, *y), strict=False)]
            notes = (f"power in {power:.4g} W, d(stores)/dt {stored:.4g} W, dissipates {dissipated:.4g} W, "
                     f"unbalanced {unbalanced:.4g} W", "at " + ", ".join(values) + " (SI)")
            worst = PowerReport(self.component.name, 0, max(imbalance, worst.imbalance), min(negative, worst.dissipation),
                                notes=notes)
        tried = tried if tried >= ENOUGH * DRAWS else 0
        return PowerReport(self.component.name, tried, worst.imbalance, worst.dissipation, notes=worst.notes)


class _Evaluation:
    """A function of (y, p, t) on NumPy arrays: conversions of CasADi matrices take longer than the evaluation. The results
    are overwritten by the next call; a column is a vector (n,)."""

    def __init__(self, function: ca.Function):
        self.function = function  # the buffer does not keep it alive
        self.given = [np.zeros(function.nnz_in(k)) for k in range(3)]
        results = [np.zeros(function.size_out(k), order="F") for k in range(function.n_out())]
        self.results = tuple(r.ravel(order="K") if r.shape[1] == 1 else r for r in results)
        self.buffer, self.evaluate = function.buffer()
        bindings: list[tuple[Any, list[Any]]] = [(self.buffer.set_arg, self.given), (self.buffer.set_res, results)]
        for bind, arrays in bindings:
            for k, values in enumerate(arrays):
                bind(k, memoryview(values.ravel(order="K")))

    def __call__(self, y: Array, p: Array, t: float) -> tuple[Array, ...]:
        self.given[0][:], self.given[1][:], self.given[2][:] = y, p, t
        self.evaluate()
        return self.results


def _least(matrix: Array, right: Array) -> Array:
    """The least-squares solution x of smallest norm. With independent rows x = A'(A A')^-1 b, by Cholesky factorisation with
    two refinements; if x does not satisfy the equations, by complete orthogonal factorisation, which takes three times as
    long."""
    m, n = matrix.shape
    if not m:
        return np.zeros(n)
    if m <= n:
        factor, failed = lapack.dpotrf(matrix @ matrix.T)
        x, limit = np.zeros(n), SOLVED * float(np.abs(right).max())
        for _ in range(0 if failed else 3):
            x += matrix.T @ lapack.dpotrs(factor, right - matrix @ x)[0]
            if np.abs(matrix @ x - right).max() <= limit:
                return x
    padded = np.zeros((max(m, n), 1))
    padded[:m, 0] = right
    work = min(m, n) + 3 * n + 1 + max(m, n) * 32
    return np.asarray(lapack.dgelsy(matrix, padded, np.zeros((n, 1), np.int32), 1e-12, work, overwrite_a=True)[1][:n, 0])


def _whole(parameter: Parameter) -> int:
    """A whole-number parameter at its default, else at 3, the smallest number for which `each` differs from one line."""
    default = constant(parameter.default.expr) if parameter.default is not None else None
    return int(default if default is not None else max(3, parameter.low or 0))
