"""Recognition of library components in imported submodels, by their equations instead of their names.

The equations of both sides are linear in the quantities of the ports and in the internal variables, with coefficients
from parameters, inputs and the time: A(s) z + b = 0, where s represents the derivative. Both are the same law if, at
random values of s, of the parameters and of the inputs, the same port quantities solve them, and all branches of their
choices occur there. Port quantities, inputs and parameters are assigned to each other in every order; a parameter of the
library without a counterpart gets a number.

Recognition of linear systems in imported submodels, `ddt (x) = A * x + B * u; y = C * x + D * u`, in the form of the
editor.
"""

from __future__ import annotations

import cmath
import itertools
import math
import operator
import random
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import HeavebondError
from heavebond.import_20sim import formula_text as f
from heavebond.import_20sim.choices import names, renamed
from heavebond.import_20sim.component import Component
from heavebond.import_20sim.evaluate import fold
from heavebond.import_20sim.memory import DELAYED
from heavebond.import_20sim.tables import Table
from heavebond.language import definition
from heavebond.language.library import library
from heavebond.text import syntax
from heavebond.text.expression import parse_equation

Array = NDArray[np.complex128]
Taken = set[tuple[int, object]]
MOST_PARAMETERS, MOST_SIGNALS, MOST_BONDS = 3, 4, 2
TRIALS = 4  # random points at which both must agree
TRIALS_OF_CHOICES = 60  # points for laws with branches, each of which must occur at one of them
SAME = 1e-9  # relative size that counts as zero for matrices with entries of about 1
FOR_FILES = {"Record"}  # it forwards a column of a file
NUMBERS = (1.0, -1.0)  # values to try for a parameter without a counterpart, in addition to its default
MATRIX = re.compile(r"[ABCD](_[0-9]+){0,2}")
LINEAR = 1e-9  # tolerance relative to the largest value, with which the coefficients must reproduce another point
BETWEEN = (0.0, 0.25, 0.7)  # shares of an interval at which both must agree
ON_TABLE = 1e-9  # relative to the range of the values


@dataclass(frozen=True)
class Match:
    """A library component that replaces an imported one: its name, its ports by the imported ones, its parameters (and
    constant inputs) by the imported parameters or as numbers with units, and its states by its port."""

    name: str
    ports: dict[str, str]
    parameters: dict[str, str]
    numbers: dict[str, float]
    units: dict[str, str]
    initial: dict[str, float] = field(default_factory=dict)
    lists: dict[str, str] = field(default_factory=dict)  # for a table: the names of its inputs `x` and values `v`
    matrices: dict[str, list[list[float]]] = field(default_factory=dict)  # matrix parameters, by rows
    any_domain: bool = False  # its ports take the domain of the connected node


# -- equations as matrices -------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Law:
    """Equations in names: bonds by their port, inputs, outputs, parameters, internal variables."""

    equations: tuple[syntax.Equation, ...]
    bonds: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: tuple[str, ...]
    inner: tuple[str, ...]

    @property
    def differentiated(self) -> list[syntax.Expr]:
        """Arguments of `der`."""
        return [argument for e in self.equations for side in (e.left, e.right) for argument in _differentiated(side)]

    @property
    def choices(self) -> int:
        """The number of comparisons and of functions that choose, each of which has two outcomes."""
        return sum(_choices(side) for e in self.equations for side in (e.left, e.right))

    @property
    def states(self) -> set[str]:
        """The names in the arguments of `der`."""
        return {_plain(expr) for expr in self.differentiated}


def _differentiated(expr: syntax.Expr) -> Iterator[syntax.Expr]:
    if isinstance(expr, syntax.Call) and expr.function == "der":
        yield expr.args[0]
    for child in syntax.children(expr):
        yield from _differentiated(child)


def _choices(expr: syntax.Expr) -> int:
    is_choice = isinstance(expr, syntax.Compare) or (isinstance(expr, syntax.Call) and expr.function in CHOOSING)
    return is_choice + sum(map(_choices, syntax.children(expr)))


def _plain(expr: syntax.Expr) -> str:
    """A name, with `e` and `f` for the quantities of a port of any domain."""
    if not isinstance(expr, syntax.Name):
        raise ValueError
    return re.sub(r"\.effort$", ".e", re.sub(r"\.flow$", ".f", expr.text))


OPERATIONS: dict[str, Callable[[complex, complex], complex]] = {
    "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv, "**": operator.pow}
COMPARED: dict[str, Callable[[float, float], bool]] = {"<": operator.lt, "<=": operator.le, ">": operator.gt,
                                                       ">=": operator.ge, "==": operator.eq, "!=": operator.ne}
REAL: dict[str, Callable[..., float]] = {"abs": abs, "min": min, "max": max, "sign": lambda x: float(np.sign(x)),
                                         "floor": math.floor, "atan": math.atan, "atan2": math.atan2, "asin": math.asin,
                                         "acos": math.acos}
CHOOSING = {"abs", "min", "max", "sign"}
ANALYTIC: dict[str, Callable[[complex], complex]] = {n: getattr(cmath, n) for n in (
    "sqrt", "exp", "log", "sin", "cos", "tan", "tanh")}


def _real(value: complex) -> float:
    if isinstance(value, complex) and value.imag:
        raise ValueError  # an unknown in a function that is not linear
    return value.real


@dataclass(frozen=True)
class Point:
    """Point of evaluation of a law: its quantities and the value of s. `branches` are the branches taken of its choices: the
    expression of a condition, or of a function that chooses, by its identity, with the outcome."""

    at: Mapping[str, complex]
    s: complex = 0j
    branches: Taken = field(default_factory=set)


def _value(expr: syntax.Expr, point: Point) -> complex:
    if isinstance(expr, syntax.Number):
        return expr.value
    if isinstance(expr, syntax.Name):
        return math.pi if expr.text == "pi" else point.at[_plain(expr)]
    if isinstance(expr, syntax.Negative):
        return -_value(expr.operand, point)
    if isinstance(expr, syntax.Binary):
        return OPERATIONS[expr.op](_value(expr.left, point), _value(expr.right, point))
    if isinstance(expr, syntax.Call):
        if expr.function == "der":
            return point.s * _value(expr.args[0], point)
        if expr.function == "if_else":
            return _value(expr.args[1 if _true(expr.args[0], point) else 2], point)
        values = [_value(e, point) for e in expr.args]
        if expr.function in REAL:
            real = [_real(v) for v in values]
            value = REAL[expr.function](*real)
            if expr.function in CHOOSING:
                point.branches.add((id(expr), real.index(value) if len(real) > 1 else real[0] > 0))
            return value
        return ANALYTIC[expr.function](*values)
    raise ValueError


def _true(expr: syntax.Expr, point: Point) -> bool:
    if isinstance(expr, syntax.Not):
        return not _true(expr.operand, point)
    if isinstance(expr, syntax.Logic):
        return (all if expr.op == "and" else any)(_true(e, point) for e in (expr.left, expr.right))
    if isinstance(expr, syntax.Compare):
        outcome = COMPARED[expr.op](_real(_value(expr.left, point)), _real(_value(expr.right, point)))
        point.branches.add((id(expr), outcome))
        return outcome
    raise ValueError


def _computed(law: Law, known: Mapping[str, complex],
              branches: Taken) -> tuple[dict[str, complex], list[syntax.Equation], list[str]]:
    """The inner variables that follow explicitly from the known quantities, the other equations, and the other inner
    variables.
    """
    values, remaining, inner = dict(known), list(law.equations), list(law.inner)
    changed = True
    while changed:
        changed = False
        for equation in remaining:
            if not isinstance(equation.left, syntax.Name) or equation.left.text not in inner:
                continue
            try:
                values[equation.left.text] = _value(equation.right, Point(values, branches=branches))
            except (ValueError, KeyError):
                continue
            if equation.left.text in law.states:
                del values[equation.left.text]
                continue
            inner.remove(equation.left.text)
            remaining.remove(equation)
            changed = True
            break
    return values, remaining, inner


def _matrix(law: Law, where: Point, chosen: Sequence[syntax.Equation] | None = None) -> Array:
    """Rows [A b] over the port quantities, the inner variables and 1, for all equations (without the explicit inner
    variables) or for some; raises ValueError if they are not linear."""
    inner: Sequence[str] = law.inner
    known = where.at
    if chosen is None:
        known, chosen, inner = _computed(law, known, where.branches)
    unknown = [*(f"{p}.{q}" for p in law.bonds for q in "ef"), *law.outputs, *inner]
    draw = random.Random(3)
    point = [complex(draw.uniform(1, 2), draw.uniform(1, 2)) for _ in unknown]

    def residual(values: Sequence[complex]) -> Array:
        at = Point({**known, **dict(zip(unknown, values, strict=True))}, where.s, where.branches)
        return np.array([_value(e.left, at) - _value(e.right, at) for e in chosen], complex)

    zero = residual([0j] * len(unknown))
    columns = [residual([1 + 0j if i == k else 0j for i in range(len(unknown))]) - zero for k in range(len(unknown))]
    matrix = np.array([*columns, zero], complex).T.reshape(len(chosen), len(unknown) + 1)
    if not np.all(np.isfinite(matrix)) or np.abs(matrix @ np.array([*point, 1]) - residual(point)).max(initial=0) > \
            SAME * max(1.0, np.abs(matrix).max(initial=0)):
        raise ValueError
    return matrix


def _ports_only(matrix: Array, ports: int) -> Array:
    """The rows between the port quantities and 1 only, after elimination of the inner variables."""
    inner = matrix[:, ports:-1]
    inner_rows = np.delete(matrix, np.s_[ports:matrix.shape[1] - 1], axis=1)
    if inner.shape[1]:
        left, sizes, _ = np.linalg.svd(inner)
        rank = int((sizes > SAME * max(1.0, sizes.max(initial=0))).sum())
        if rank < inner.shape[1]:
            raise ValueError  # an undetermined inner variable
        inner_rows = left[:, rank:].conj().T @ inner_rows
    size = np.linalg.norm(inner_rows, axis=1)
    rows: Array = inner_rows[size > SAME] / size[size > SAME][:, None]
    return rows


def _rank(matrix: Array) -> int:
    return int(np.linalg.matrix_rank(matrix, tol=SAME * 100)) if matrix.size else 0


# -- both sides ------------------------------------------------------------------------------------------------------------
def _imported(component: Component, joined: set[str]) -> Law | None:
    """The law of an imported component, in which unconnected outputs are inner variables; None if it has more than a law:
    events, held variables, or untranslated constructs."""
    if component.events or component.untranslated or component.omitted or component.gives or component.of_kind("held") \
            or not component.equations:
        return None
    outputs = [i.name for i in component.of_kind("out")]
    bonds = tuple(i.name for i in component.of_kind("bond"))
    law_outputs = tuple(n for n in outputs if n in joined or not (bonds or joined & set(outputs)))
    inner = (*(n for n in outputs if n not in law_outputs), *(i.name for i in component.of_kind("variable")))
    used = {n for left, right, _ in component.equations for n in (*names(left), *names(right))}
    parameters = tuple(i.name for i in component.of_kind("parameter") if i.name in used)  # others are initial values
    inputs = tuple(i.name for i in component.of_kind("in"))
    if len(parameters) > MOST_PARAMETERS or len(inputs) + len(law_outputs) > MOST_SIGNALS or len(bonds) > MOST_BONDS:
        return None
    if not (law_outputs or bonds):
        return None
    try:
        equations = tuple(parse_equation(f"{f.text(left)} = {f.value_text(right)}")
                          for left, right, _ in component.equations)
    except ValueError:
        return None
    return Law(equations, bonds, inputs, law_outputs, parameters, inner)


@lru_cache(maxsize=1)
def _candidates() -> tuple[tuple[definition.Component, Law], ...]:
    """The components of the library with ports of any domain and signals of any unit that consist of a law only, without
    the errors of sensors."""
    candidates = []
    for name in sorted(set(library().names()) - FOR_FILES):
        try:
            component = library().component(name)
        except HeavebondError:
            continue
        counts = [*(p.count for p in component.ports.values()), *(p.count for p in component.parameters.values()),
                  *(v.count for v in component.variables.values())]
        if component.when or component.body.instances or component.foreign or component.placeholder or \
                (component.effect is not None and component.effect.kind.startswith("sensor")) or \
                not component.equations or any(count is not None for count in counts) or \
                any(e.each for e in component.equations) or \
                any(p.domain not in ("bond", "$D") for p in component.ports.values()) or \
                any(p.integer or p.neutral is not None or p.width for p in component.parameters.values()) or \
                len(component.parameters) > MOST_PARAMETERS + 1 or len(component.signals) > MOST_SIGNALS:
            continue
        law = Law(tuple(e.tree for e in component.equations), tuple(component.ports),
                  tuple(n for n, p in component.signals.items() if p.direction == "in"),
                  tuple(n for n, p in component.signals.items() if p.direction == "out"), tuple(component.parameters),
                  tuple(component.variables))
        candidates.append((component, law))
    return tuple(candidates)


def _unit(text: str) -> str:
    """The unit of a number in a model whose signals have no units, with effort W and flow 1 of bonds: `$Y/($U*s)` is 1/s."""
    plain = re.sub(r"\$[A-Z]\.effort", "W", re.sub(r"\$[A-Z](\.flow)?(?![.\w])", "1", text))
    plain = re.sub(r"\(1\*(\w+)\)", r"\1", plain)
    while plain != (shorter := re.sub(r"(?<![\w.])1\*|[*/]1(?![\w.*])", "", plain)):
        plain = shorter
    return "" if plain == "1" else plain


# -- the comparison --------------------------------------------------------------------------------------------------------
def recognised(imported: Component, joined: set[str]) -> Match | None:
    """The component of the library with the law of an imported one, whose ports `joined` are connected."""
    if imported.samples:
        return None
    if (whole := table_match(imported) or linear_match(imported, joined) or _delay(imported) or
            _junction(imported, joined)) is not None:
        return whole
    law = _imported(imported, joined)
    if law is None or imported.tables or any(not isinstance(e, syntax.Name) for e in law.differentiated):
        return None
    simplest = sorted(_candidates(), key=lambda pair: (pair[0].effect is not None, len(pair[1].inputs),
                                                       len(pair[1].parameters), len(pair[0].name), pair[0].name))
    for component, library_law in simplest:
        if len(component.ports) != len(law.bonds) or len(library_law.outputs) != len(law.outputs) or \
                len(library_law.states) != len(law.states) or \
                len(library_law.inputs) < len(law.inputs) or (not law.bonds
                                                              and len(library_law.inputs) > len(law.inputs)) or \
                len(library_law.inputs) - len(law.inputs) + len(library_law.parameters) < len(law.parameters):
            continue
        for match in _assignments(imported, law, component, library_law):
            if _within_bounds(imported, component, match) and _agree(law, library_law, match) and \
                    (complete := _with_states(imported, law, component, library_law, match)) is not None:
                return complete
    # the library component for a law with gains of 1, as numbers in place of parameters: 1/(tau*s + 1)
    ones = [n for n in law.parameters if imported.items[n].value == 1 and not imported.items[n].unit
            and n not in imported.shared]
    if not ones or len(ones) == len(law.parameters):
        return None
    equations = imported.equations
    for name in ones:
        equations = [(left, renamed(right, name, f.number(1)), comment) for left, right, comment in equations]
    items = {n: item for n, item in imported.items.items() if n not in ones}
    return recognised(replace(imported, equations=equations, items=items), joined)


def _junction(component: Component, joined: set[str]) -> Match | None:
    """A 1-junction of bonds or multi-bonds whose flow no signal takes."""
    if component.junction is None or component.untranslated:
        return None
    bonds, flows = component.junction
    width, count = len(bonds[0][0]), {"a": 0, "b": 0}
    outputs = [name for flow in flows for name in component.elements[flow]]
    if set(outputs) & joined:
        return None
    ports = dict(zip(outputs, ["f"] if width == 1 else [f"f[{k + 1}]" for k in range(width)], strict=False))
    for bond, out in bonds:
        side = "b" if out else "a"
        ports |= {name: f"{side}[{count[side] + k + 1}]" for k, name in enumerate(bond)}
        count[side] += width
    sizes = {"k": width, "n": count["a"] // width, "m": count["b"] // width}
    usual = {"k": 1 if width == 1 else 2, "n": 1, "m": 2}
    numbers = {name: float(size) for name, size in sizes.items() if size != usual[name]}
    return Match("Junction1" if width == 1 else "Junction1Field", ports, {}, numbers, dict.fromkeys(numbers, ""))


def _delay(component: Component) -> Match | None:
    """A component that only delays its input by a parameter."""
    if component.delay is None or component.untranslated or component.events or component.gives:
        return None
    result, value, time = component.delay
    output = next((left.name for left, right, _ in component.equations if right == result and left.op == "name"), "")
    known = {item.name: item.kind for item in component.items.values() if item.doc != DELAYED}
    if known != {output: "out", value: "in", time: "parameter"}:
        return None
    return Match("Delay", {output: "y", value: "u"}, {"T": time}, {}, {"T": "s"})


def _assignments(component: Component, law: Law, library_component: definition.Component,
                 library_law: Law) -> Iterator[Match]:
    """Every way to assign the quantities of both to each other."""
    for bonds in itertools.permutations(library_law.bonds):
        for outputs in itertools.permutations(library_law.outputs):
            for inputs in itertools.permutations(library_law.inputs, len(law.inputs)):
                if any(_unit(library_component.signals[n].unit.text) for n in (*outputs, *inputs)):
                    continue  # the signals of an imported model have no units
                places = [n for n in (*library_law.inputs, *library_law.parameters) if n not in inputs]
                ports = dict(zip((*law.bonds, *law.outputs, *law.inputs), (*bonds, *outputs, *inputs), strict=True))
                for chosen in itertools.permutations(places, len(law.parameters)):
                    remaining = [n for n in places if n not in chosen]
                    for numbers in itertools.product(*(_numbers(library_component, n) for n in remaining)):
                        units = {n: _unit((library_component.parameters[n] if n in library_component.parameters
                                           else library_component.signals[n]).unit.text)
                                 for n in places}
                        yield Match(library_component.name, ports, dict(zip(chosen, law.parameters, strict=True)),
                                    dict(zip(remaining, numbers, strict=True)), units,
                                    any_domain=any(p.domain == "$D" for p in library_component.ports.values()))


def _numbers(library_component: definition.Component, name: str) -> tuple[float, ...]:
    default = library_component.parameters[name].default if name in library_component.parameters else None
    known = (float(default),) if isinstance(default, (int, float)) else ()
    return (*known, *(n for n in NUMBERS if n not in known))


def _within_bounds(component: Component, library_component: definition.Component, match: Match) -> bool:
    """True if the library's bounds and requirements permit the values."""
    values: dict[str, complex] = {**match.numbers,
                                  **{n: component.items[p].value or 0.0 for n, p in match.parameters.items()}}
    for name, parameter in library_component.parameters.items():
        value = values[name].real
        if (parameter.low is not None and value < parameter.low) or (parameter.high is not None and value > parameter.high):
            return False
        if parameter.low == 0 and value == 0:  # the library may divide by it
            return False
    try:
        return all(_true(r.tree, Point(values)) for r in library_component.requires)
    except (ValueError, KeyError, ZeroDivisionError):
        return False


def _agree(law: Law, library_law: Law, match: Match) -> bool:
    """True if the same port quantities solve both, at random values of everything else."""
    draw = random.Random(7)
    ports = 2 * len(law.bonds) + len(law.outputs)
    order = [q for p in law.bonds for q in (f"{match.ports[p]}.e", f"{match.ports[p]}.f")] + \
        [match.ports[n] for n in law.outputs]
    theirs = [*(f"{p}.{q}" for p in library_law.bonds for q in "ef"), *library_law.outputs]
    columns = [theirs.index(n) for n in order]
    choices = (law.choices, library_law.choices)
    met: tuple[Taken, Taken] = (set(), set())
    for _ in range(TRIALS_OF_CHOICES if any(choices) else TRIALS):
        known: dict[str, complex] = {n: draw.choice((-1, 1)) * draw.uniform(0.3, 3) for n in (*law.inputs, "time")}
        known |= {n: draw.uniform(0.3, 3) for n in law.parameters}
        mapped: dict[str, complex] = {match.ports[n]: known[n] for n in law.inputs}
        mapped |= {n: known[p] for n, p in match.parameters.items()} | match.numbers | {"time": known["time"]}
        s = complex(draw.uniform(0.3, 2), draw.uniform(0.3, 2))
        try:
            mine = _ports_only(_matrix(law, Point(known, s, met[0])), ports)
            yours = _ports_only(_matrix(library_law, Point(mapped, s, met[1])), ports)
        except (ValueError, KeyError, ZeroDivisionError, OverflowError, TypeError):
            return False
        yours = yours[:, [*columns, ports]]
        rank = _rank(mine)
        if rank != _rank(yours) or rank != _rank(np.concatenate([mine, yours])):
            return False
    # a limit of 1000, or a choice at 100 s, is reached at no point: the range beyond it has not been compared
    return all(len(outcomes) == 2 * count for outcomes, count in zip(met, choices, strict=True))


def _with_states(component: Component, law: Law, library_component: definition.Component, library_law: Law,
                 match: Match) -> Match | None:
    """The match with the initial values of the states of the library, which must be port quantities: at the start they
    follow from the imported states by the imported equations without derivatives."""
    if not library_law.states:
        return match if not law.states else None
    known: dict[str, complex] = {"time": 0.0, **{n: component.items[n].value or 0.0 for n in law.parameters}}
    # equations without derivatives, for all values of the inputs
    at_once = [e for e in law.equations if not any(True for side in (e.left, e.right) for _ in _differentiated(side))
               and not any(n.text in law.inputs for side in (e.left, e.right) for n in syntax.names(side))]
    columns = [*(f"{p}.{q}" for p in law.bonds for q in "ef"), *law.outputs, *law.inner]
    rows = _matrix(law, Point({**known, **dict.fromkeys(law.inputs, 0.0)}, 1j), at_once)
    for state, first in component.initial.items():
        row = np.zeros(len(columns) + 1, complex)
        row[columns.index(state)], row[-1] = 1, -first.value
        rows = np.vstack([rows, row])
    back = {match.ports[p]: p for p in (*law.bonds, *law.outputs)}
    initial_values: dict[str, float] = {}
    for state in sorted(library_law.states):
        port, _, quantity = state.partition(".")
        if port not in back:
            return None
        unit = np.zeros(len(columns))
        unit[columns.index(f"{back[port]}.{quantity}" if quantity else back[port])] = 1
        # the combination of the rows that is this quantity alone
        weights, *_ = np.linalg.lstsq(rows[:, :-1].T, unit.astype(complex), rcond=None)
        if np.abs(rows[:, :-1].T @ weights - unit).max() > SAME:
            return None
        initial_values[state] = float(f"{-(weights @ rows[:, -1]).real:.13g}") + 0.0  # with the precision of the combination
    units = match.units | {state: "W" if state.endswith(".e") else "" for state in initial_values}
    return replace(match, units=units, initial=initial_values)


def linear_match(component: Component, joined: Collection[str]) -> Match | None:
    """The `LinearSystem` of the library for a component whose parameters are matrices A, B, C, D and whose rates and outputs
    are linear in its states and inputs, with its matrices. All inputs must be connected."""
    values = {item.name: item.value for item in component.of_kind("parameter")}
    inputs, outputs = [i.name for i in component.of_kind("in")], [i.name for i in component.of_kind("out")]
    states = [i.name for i in component.of_kind("variable")]
    rates = {left.args[0].name: right for left, right, _ in component.equations if left.op == "call" and left.name == "der"}
    output_formulas = {left.name: right for left, right, _ in component.equations if left.op == "name"}
    if component.events or component.untranslated or component.shared or component.gives \
            or component.tables or component.of_kind("bond", "held"):
        return None
    if not all(map(MATRIX.fullmatch, values)) or None in values.values() or not (states and inputs and outputs):
        return None
    if set(rates) != set(states) or set(output_formulas) != set(outputs) or not set(inputs) <= set(joined):
        return None
    rows, columns = [*(rates[x] for x in states), *(output_formulas[y] for y in outputs)], [*states, *inputs]
    known = {name: value for name, value in values.items() if value is not None}

    def at(point: np.ndarray) -> np.ndarray | None:
        folded = [fold(e, {**known, **dict(zip(columns, map(float, point), strict=True))}) for e in rows]
        return None if None in folded else np.array(folded, dtype=float)

    offset, units = at(np.zeros(len(columns))), [at(p) for p in np.eye(len(columns))]
    second_point = np.random.default_rng(0).uniform(-1, 1, len(columns))
    value_there = at(second_point)
    if offset is None or offset.any() or value_there is None or any(c is None for c in units):
        return None
    whole = np.array(units).T
    if not np.allclose(whole @ second_point, value_there, rtol=LINEAR, atol=SAME * np.abs(whole).max(initial=0.0)):
        return None
    first = {name: fold(value, known) for name, value in component.initial.items()}
    if None in first.values():
        return None
    n = len(states)
    parts = {"A": whole[:n, :n], "B": whole[:n, n:], "C": whole[n:, :n], "D": whole[n:, n:]}
    matrices = {name: m.tolist() for name, m in parts.items() if name != "D" or m.any()}
    ports = {name: f"{kind}[{k + 1}]" for kind, group in (("u", inputs), ("y", outputs)) for k, name in enumerate(group)}
    begins = {f"x[{k + 1}]": first.get(x) or 0.0 for k, x in enumerate(states)}
    return Match("LinearSystem", ports, {}, {}, {"A": "1/s", "B": "1/s", "C": "", "D": "", **dict.fromkeys(begins, "")},
                 begins, matrices=matrices)


def table_match(component: Component) -> Match | None:
    """A component that is only a table of its inputs or of the time."""
    if component.events or component.untranslated or component.gives or len(component.of_kind("out")) != 1 \
            or component.of_kind("bond", "held") or component.initial:
        return None
    if [len(table) for table in component.tables.values()] == [3]:
        # a component whose output is a table of its two inputs
        formulas = {left.name: right for left, right, _ in component.equations if left.op == "name"}
        inputs, output = [item.name for item in component.of_kind("in")], component.of_kind("out")[0].name
        value, input_names = formulas.get(output), []
        if value is None or value.op != "table2" or component.shared:
            return None
        for e in value.args:
            while e.op == "name" and e.name in formulas:
                e = formulas[e.name]
            input_names.append(e.name if e.op == "name" else "")
        if sorted(input_names) != sorted(inputs) or len(set(input_names)) != 2:
            return None
        return Match("Lookup2", {output: "y", input_names[0]: "u_1", input_names[1]: "u_2"}, {}, {}, {},
                     lists={"x": "x_1", "y": "x_2", "v": "v"})
    if len(component.of_kind("in")) > 1:
        return None
    if not component.tables:
        return _of_matrix(component)
    if len(component.equations) != 1 or len(component.items) > 2:
        return None
    left, right, _ = component.equations[0]
    if right.op != "table" or left.op != "name" or component.items[left.name].kind != "out" or right.args[0].op != "name":
        return None
    input_name = right.args[0].name
    if input_name == "time" and len(component.items) == 1:
        return _match(component, "time")
    return _match(component,
                  input_name) if input_name in component.items and component.items[input_name].kind == "in" else None


def _match(component: Component, input_name: str) -> Match:
    output = component.of_kind("out")[0].name
    if input_name == "time":
        return Match("TableSource", {output: "y"}, {}, {}, {}, lists={"x": "t", "v": "v"})
    steps = any(a == b for table in component.tables.values() for a, b in pairwise(table[0]))
    return Match("StepLookup" if steps else "Lookup", {output: "y", input_name: "u"}, {}, {}, {}, lists={"x": "x", "v": "v"})


def _of_matrix(component: Component) -> Match | None:
    """A component whose only parameters are a matrix of points (x, y) in rows, with an output that is linear between them
    and constant outside; these points become its table."""
    values = {item.name: item.value for item in component.of_kind("parameter")}
    entries = {(m[1], int(m[2]), int(m[3])): v for n, v in values.items() if (m := re.fullmatch(r"(.*)_([0-9]+)_([12])", n))
               and v is not None}
    rows, bases = len(entries) // 2, {base for base, *_ in entries}
    if len(bases) != 1 or rows < 2 or len(entries) != len(values):
        return None
    (base,) = bases
    points = [[entries.get((base, i + 1, k), np.nan) for i in range(rows)] for k in (1, 2)]
    x, y = np.array(points)
    if not np.all(np.diff(x) > 0) or not np.all(np.isfinite(y)):
        return None
    known = {name: value for name, value in values.items() if value is not None}
    input_name = component.of_kind("in")[0].name if component.of_kind("in") else "time"
    steps = np.diff(x, append=2 * x[-1] - x[-2])
    tried = [x[0] - steps[0], *(x[i] + share * steps[i] for i in range(rows) for share in BETWEEN)]
    near = ON_TABLE * (np.ptp(y) or 1.0)
    if any(not _agrees(component, {**known, input_name: float(u)}, float(np.interp(u, x, y)), near) for u in tried):
        return None
    table: Table = (tuple(points[0]), tuple(points[1]))
    component.tables = {base: table}
    return _match(component, input_name)


def _agrees(component: Component, known: Mapping[str, float], expected: float, tolerance: float) -> bool:
    """True if the output has the expected value, computed from the known quantities."""
    at, output = dict(known), component.of_kind("out")[0].name
    known_values = [(a.name, b) for a, b, _ in component.equations if a.op == "name"]
    while output not in at:
        new = {name: value for name, formula in known_values if name not in at and (value := fold(formula, at)) is not None}
        if not new:
            return False
        at |= new
    return abs(at[output] - expected) <= tolerance
