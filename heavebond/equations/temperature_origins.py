"""Distinction of temperatures and temperature differences in K, by their dependence on the origin of temperature.

An equation between temperatures does not change if all of them, and no difference, are moved by the same amount. With
w_j = 1 for a temperature and 0 for a difference, r(T + w c) = r(T) for every residual r and every shift c. This is evaluated
at random points. Temperatures of nodes are known (w = 1). An equation determines the others if only one choice of 0 and 1
keeps its residual. Laws that need the absolute temperature (ideal gas, radiation) keep no choice and determine nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Protocol

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import ModelError, Problems
from heavebond.core.units import Unit, counts_from_origin, interval_text, interval_unit
from heavebond.equations.events import FlatEvent, Held
from heavebond.equations.expanded import Bound, Expanded
from heavebond.equations.parameters import FlatParameter, declared
from heavebond.equations.resolver import Unknown
from heavebond.language import reading
from heavebond.language.definition import FileInput, Value
from heavebond.language.sections import NamedOutput
from heavebond.language.values import add_formula_problem
from heavebond.text.dimensions import KELVIN, check_origins, has_origin, origins
from heavebond.text.expression import Expr, ExpressionProblem, Name, Number, parse_formula

SHIFT = 35.0       # K
POINTS = 8         # random points at which a residual must not change
UNDECIDED = 5      # quantities in an equation of which at most that many are decided at once
ROUNDING = 1e-9    # of the largest change of a residual


class Flat(Protocol):
    """The required interface of a flat model (see `heavebond.equations.flatten.Flat`)."""

    @property
    def expanded(self) -> Expanded:
        """The opened diagram."""

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """The variables."""

    @property
    def levels(self) -> tuple[tuple[ca.SX, ...], ...]:
        """The symbols of the unknowns and of their derivatives."""

    @property
    def parameters(self) -> tuple[FlatParameter, ...]:
        """The independent parameters."""

    @property
    def p(self) -> ca.SX:
        """The symbols of the independent parameters."""

    @property
    def residuals(self) -> tuple[ca.SX, ...]:
        """The equations."""

    @property
    def held(self) -> tuple[Held, ...]:
        """The variables that only events change."""

    @property
    def events(self) -> tuple[FlatEvent, ...]:
        """The events."""

    @property
    def names(self) -> dict[str, int]:
        """The numbers of the variables."""

    @property
    def units(self) -> dict[str, Unit]:
        """The units of all parameters."""

    @property
    def origins(self) -> TemperatureOrigins:
        """Which quantities in K are temperatures and which are differences."""


def origins_of(flat: Flat) -> dict[str, float]:
    """The origin of each variable and independent parameter in K: 1 for a temperature, 0 for a difference of temperatures.
    Quantities in other units are omitted."""
    variables = {u.name: s for u, s in zip(flat.unknowns, flat.levels[0], strict=True) if u.unit.dimension == KELVIN}
    parameters = {q.name: flat.p[k] for k, q in enumerate(flat.parameters)
                  if q.unit.dimension == KELVIN and not q.name.startswith("initial.")}
    parameters |= {h.name: flat.p[h.index] for h in flat.held if h.unit.dimension == KELVIN}
    if not variables:
        return {}
    symbols = {s.element_hash(): name for name, s in (*variables.items(), *parameters.items())}
    unknowns = {s.element_hash() for s in flat.levels[0]}
    numbers = {flat.p[k].element_hash(): q.value for k, q in enumerate(flat.parameters)}
    weights = {u.name: 1.0 for u in flat.unknowns if u.name in variables and u.role == "across"}
    weights |= {name: 0.0 for name, _, leaf in declared(flat.expanded) if name in parameters and leaf is not None
                and leaf.component.parameters[name.rpartition(".")[2]].interval}
    conditions = (event.indicator for event in flat.events if event.indicator is not None)
    samples = (flat.p[r.held] - r.value for event in flat.events for r in event.resets if r.held is not None)
    rows = [(row, ca.symvar(row)) for row in (*flat.residuals, *conditions, *samples)]
    rows = [(row, used) for row, used in rows if any(s.element_hash() in symbols for s in used)]
    given = [(name, value) for name, value, _ in _values(flat) if name in {*variables, *parameters} and
             isinstance(value, Value) and isinstance(value.expr, Number) and has_origin(value.expr)]
    progress = True
    while progress or given:
        if not progress:  # what no equation determines is what its value says
            name, _ = given.pop(0)
            weights.setdefault(name, 1.0)
        progress = False
        for row, used in rows:
            open_names = [symbols[h] for s in used if (h := s.element_hash()) in symbols and symbols[h] not in weights]
            known = [weights[symbols[h]] for s in used if (h := s.element_hash()) in symbols and symbols[h] in weights]
            alone = all(s.element_hash() in symbols for s in used if s.element_hash() in unknowns)
            if not 0 < len(open_names) <= UNDECIDED or not known or not (alone or 1.0 in known):
                continue
            decided = _decided(row, used, symbols, numbers, weights, open_names)
            weights.update(decided)
            progress = progress or bool(decided)
    return weights


def _decided(row: ca.SX, used: Sequence[ca.SX], symbols: Mapping[int, str], numbers: Mapping[int, float],
             weights: Mapping[str, float], names: Sequence[str]) -> dict[str, float]:
    """The names with the same value in all choices of 0 and 1 that preserve a residual; for a single name also 2 and -1, the
    sum of two temperatures and its negative."""
    rng = np.random.default_rng(1)
    hashes = [s.element_hash() for s in used]

    def drawn(h: int) -> list[float]:
        if h in numbers:
            return [numbers[h]] * POINTS
        if h not in symbols:
            return list(rng.uniform(0.5, 2, POINTS))
        small = rng.choice((-1.0, 1.0), POINTS) * 10**rng.uniform(-1, 2, POINTS)  # differences of all sizes
        return list(small if weights.get(symbols[h]) == 0 else rng.uniform(250, 400, POINTS))

    base = np.array([drawn(h) for h in hashes])
    residual = ca.Function("residual", [ca.vertcat(*used)], [row])
    before = np.array(residual(base)).ravel()

    def change(choice: Mapping[str, float]) -> NDArray[np.float64]:
        steps = SHIFT * np.array([choice.get(symbols.get(h, ""), weights.get(symbols.get(h, ""), 0.0)) for h in hashes])
        return np.asarray(np.abs(np.array(residual(base + steps[:, None])).ravel() - before))

    choices = [dict(zip(names, values, strict=True)) for values in product((0.0, 1.0), repeat=len(names))]
    changes = np.array([change(choice) for choice in choices])
    if len(names) == 1:
        choices += [{names[0]: value} for value in (2.0, -1.0)]
        changes = np.vstack([changes, [change(choice) for choice in choices[-2:]]])
    usable = np.isfinite(changes).all(axis=0)
    if not usable.any():
        return {}
    changes = changes[:, usable]
    admissible = [choice for choice, c in zip(choices, changes, strict=True) if np.all(c <= ROUNDING * changes.max(axis=0))]
    return {name: admissible[0][name] for name in names if admissible and len({choice[name] for choice in admissible}) == 1}


class TemperatureOrigins:
    """Whether expressions of a diagram are temperatures or differences."""

    def __init__(self, flat: Flat):
        self.flat = flat
        self.bounds: dict[str, Bound] = {name: bound for name, bound, _ in declared(flat.expanded)}
        self.weights = origins_of(flat)

    def of(self, expr: Expr, scope: str = "") -> float | None:
        """The origin of an expression (see `dimensions.origins`) whose names are those of the diagram, inside `scope`."""
        return origins(expr, self.lookup(scope))

    def determined(self, path: str) -> float | None:
        """The origin of a variable or parameter, by the equations alone."""
        flat = self.flat
        return self.weights.get(flat.unknowns[flat.names[path]].name if path in flat.names else path)

    def lookup(self, scope: str = "") -> Callable[[Name], float | None]:
        """The function that gives the origin of a name inside the part `scope`."""
        return lambda name: self.of_name(scope + name.text)

    def of_name(self, path: str) -> float | None:
        """The origin of a variable or parameter: 1 for a temperature, 0 otherwise. If no equation determines the origin of a
        parameter, the unit of its value does."""
        flat = self.flat
        if path in flat.names:
            return self.determined(path) if flat.unknowns[flat.names[path]].unit.dimension == KELVIN else 0.0
        if path in self.weights:
            return self.weights[path]
        if path in flat.units and flat.units[path].dimension != KELVIN:
            return 0.0
        if path in (show := flat.expanded.model.show):
            return self.of(show[path].expr)
        bound = self.bounds.get(path)
        if bound is None or not isinstance(bound.value, Value):
            return 0.0 if path in ("time", "pi") else None
        return self.of(bound.value.expr, bound.scope)


def with_intervals(flat: Flat) -> dict[str, NamedOutput]:
    """The outputs of a diagram; an output that is a difference of temperatures gets a unit without origin (K instead of
    degC).

    ModelError for a sum of temperatures, and for a difference whose value is in a unit with an origin.
    """
    model = flat.expanded.model
    values, ends = list(_values(flat)), model.ends
    if not (any(counts_from_origin(output.unit) or has_origin(output.expr) for output in model.show.values())
            or (ends is not None and has_origin(ends.tree))
            or any(counts_from_origin(v.unit) if isinstance(v, FileInput) else has_origin(v.expr) for _, v, _ in values)):
        return model.show
    known, problems, shows = flat.origins, Problems(), dict(model.show)
    starts = {name: known.of(parse_formula(name)) for name in model.initial.conditions}
    for name, value, scope in values:
        needed = starts.get(name) if name in starts else known.determined(name)
        if isinstance(value, FileInput):
            if needed == 0 and counts_from_origin(value.unit):
                problems.add("unit-offset", f"{name} is a difference of temperatures, and {value.unit} has a "
                             "separate origin", value.place, hint=f"Write `unit: {interval_unit(value.unit)}`.")
            continue
        try:
            weight = check_origins(value.expr, known.lookup(scope))
        except ExpressionProblem as problem:
            add_formula_problem(problem, value, problems)
            continue
        if name in starts and needed not in (None, 0.0, 1.0) and weight == 1:
            problems.add("unit-offset", f"{name} is no temperature, and '{value.text}' counts from an origin", value.place,
                         hint="A sum of temperatures has no value in such a unit. Write the mean, `\"(a.T + b.T)/2\"`, or "
                         "each of them.")
        if needed == 0 and isinstance(value.expr, Number) and weight == 1:
            problems.add("unit-offset", f"{name} is a difference of temperatures, and '{value.text}' is a temperature",
                         value.place, hint=f"Write '{interval_text(value.expr.value, value.expr.unit)}'.")
    if ends is not None:
        try:
            check_origins(ends.tree, known.lookup())
        except ExpressionProblem as problem:
            reading.add_expression_problem(problem, ends.place, problems)
    for output in model.show.values():
        try:
            weight = check_origins(output.expr, known.lookup(), shown=counts_from_origin(output.unit))
        except ExpressionProblem as problem:
            reading.add_expression_problem(problem, output.place, problems)
            continue
        if weight == 0 and counts_from_origin(output.unit):
            shows[output.name] = replace(output, unit=interval_unit(output.unit))
    problems.raise_as(ModelError)
    return shows


def _values(flat: Flat) -> Iterator[tuple[str, Value | FileInput, str]]:
    """Every value of a diagram with its name and scope: parameters, inputs, initial values."""
    for name, bound, _ in declared(flat.expanded):
        yield name, bound.value, bound.scope
    for path, leaf in flat.expanded.leaves.items():
        for name, bound in leaf.inputs.items():
            yield f"{path}.{name}", bound.value, bound.scope
    for name, condition in flat.expanded.model.initial.conditions.items():
        yield name, condition.value, ""
    for name, setting in flat.expanded.model.vary.items():
        yield f"vary {name}", setting.value, ""
