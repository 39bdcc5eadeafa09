"""Resolution of the names of a diagram to symbols and units, for formulas, outputs, conditions and costs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf
from typing import TypeVar

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import NAMES_LISTED, Place, suggest
from heavebond.core.units import FREQUENCY, ONE, Dimension, Unit, declared_unit, dimension_text
from heavebond.language.definition import Domain
from heavebond.language.external_functions import derivative_along
from heavebond.language.symbols import Context, evaluate, indicator, split, stack
from heavebond.text.dimensions import SECOND, TRUTH, counted, dimension
from heavebond.text.expression import Expr, ExpressionProblem, Name, Slice, constant, names
from heavebond.text.shapes import Lengths, Shape, gives_lists

Course = TypeVar("Course", ca.SX, NDArray[np.float64])  # an expression, or values over time
POWER, WATT = "power", declared_unit("W").dimension


# angles that a user may look for at a frame in space, and the outputs of a SpatialSensor
ANGLES = {"phi": "pitch", "angle": "pitch", "roll": "roll", "pitch": "pitch", "yaw": "yaw"}


@dataclass(frozen=True)
class PlausibleRange:
    """The plausible values of a variable in SI: its typical size (inf if none is declared), the growth of that size per
    second (a position moves on at its typical speed), the value that no machine exceeds, the physical limit below which a
    run ends, and the advice of the message on a value below it, or outside the declared range if there is no such limit."""

    typical: float = inf
    per_second: float = 0.0
    largest: float = inf
    least: float = -inf
    beyond: str = ""


NOTHING_KNOWN = PlausibleRange()


def plausible(domain: Domain, name: str) -> PlausibleRange:
    """The plausible values of a member of a domain; the range of a position grows with the typical speed of its domain."""
    member = domain.members[name]
    speed = domain.members[domain.rate(name)].nominal if name in domain.positions else 0.0
    return PlausibleRange(member.nominal if member.sized else inf, speed, inf if member.largest is None else member.largest,
                          -inf if member.physical is None else member.physical, member.beyond)


@dataclass(frozen=True)
class Unknown:
    """One scalar unknown: unit, usual size, bounds and first guess in SI; `role` is across, position, through, own or
    signal; `plausible` are the values for the verdict of a run."""

    name: str
    unit: Unit
    nominal: float
    role: str
    place: Place
    doc: str = ""
    low: float = -inf
    high: float = inf
    start: float | None = None
    # a velocity (a mechanical across variable): what `start: rest` sets to zero
    motion: bool = False
    # a position or velocity of a frame, which follows from the coordinates of the joints: never preferred as a state
    pose: bool = False
    # a position or velocity of a free body: preferred as a state to the lengths of struts that carry it
    root: bool = False
    plausible: PlausibleRange = NOTHING_KNOWN
    usual: float = 0.0  # size that the diagram replaces by a nominal one of its own


@dataclass(frozen=True)
class Bond:
    """The power into a component or a block over one port: effort times flow, summed over its pairs, or one variable that is
    a power itself (an enthalpy flow; then there are no `efforts`). Numbers of unknowns."""

    owner: str
    efforts: tuple[int, ...]
    flows: tuple[int, ...]

    def power(self, values: Sequence[Course]) -> Course:
        """The power, of the values of all unknowns."""
        if not self.efforts:
            return values[self.flows[0]]
        total = values[self.efforts[0]] * values[self.flows[0]]
        for effort, flow in zip(self.efforts[1:], self.flows[1:], strict=True):
            total = total + values[effort] * values[flow]
        return total


@dataclass(frozen=True)
class Resolver:
    """Names of a diagram to SX and units: for formulas in place, outputs, conditions and costs; `spring.a.power` is the
    power into a component over a port."""

    names: dict[str, int]
    constants: dict[str, ca.SX]
    units: dict[str, Unit]
    unknowns: tuple[Unknown, ...]
    columns: tuple[ca.SX, ...]  # of the unknowns and their derivatives
    time: ca.SX
    rate: ca.SX
    bonds: Mapping[str, Bond] = field(default_factory=dict)  # by port

    def evaluate(self, expr: Expr, scope: str = "", extra: Mapping[str, ca.SX] | None = None) -> ca.SX:
        """The SX of a formula (`extra` names more than the diagram does); ExpressionProblem for an unknown name."""
        more = extra or {}
        self._check_lengths(expr, scope)
        return evaluate(expr, Context(
            lambda text, name: more[text] if text in more else self._value(scope, text, name), self._der))

    def indicator(self, expr: Expr) -> ca.SX:
        """A condition as a number that is positive while it holds; ExpressionProblem for a formula that is not a
        condition."""
        if self.dimension(expr) != TRUTH:
            raise ExpressionProblem("not-a-condition", "this is not a condition", 0,
                                    hint="Write a comparison: `load.x > 0.5 m`.")
        return indicator(expr, Context(lambda text, name: self._value("", text, name), self._der))

    def _check_lengths(self, expr: Expr, scope: str) -> None:
        """ExpressionProblem where a formula gives a list, or joins lists that do not fit."""
        if gives_lists(expr) or any(self._elements(scope + name.text) or any(isinstance(part, Slice) for part in name.parts)
                                    for name in names(expr)):
            Lengths(lambda name: self.shape(name, scope), exact=True).number(expr, "what a formula gives")

    def shape(self, name: Name, scope: str = "") -> Shape:
        """The shape of the value of a name; None for a number, and for an unknown name."""
        sizes = []
        for part in name.parts:
            if isinstance(part, Slice):
                low, high = constant(part.low), constant(part.high)
                if low is None or high is None or low != int(low) or high != int(high):
                    raise ExpressionProblem("not-an-integer", "whole numbers are needed here", part.column, 2,
                                            "Write for example `x[1..3]`.")
                sizes.append(max(1, int(high - low) + 1))
        if not sizes:
            rows = self._elements(scope + name.text)
            columns = len(self._elements(rows[0])) if rows else 0
            return (len(rows), columns) if columns else len(rows) or None
        last = _end_of(name, "high")
        if not self._known(scope + last):
            raise self._unknown(scope + last, replace(name, parts=(last,)))
        return sizes[0] if len(sizes) == 1 else (sizes[0], sizes[1])

    def _known(self, path: str) -> bool:
        return path in self.names or path in self.constants

    def _elements(self, path: str) -> list[str]:
        """The paths of the elements of a list or the rows of a matrix; none for anything else."""
        elements: list[str] = []
        if self._known(path):
            return elements
        while self._known(element := f"{path}[{len(elements) + 1}]") or self._known(f"{element}[1]"):
            elements.append(element)
        owner, _, member = path.rpartition(".")
        # a member of all ports of an array, or of all nodes
        while owner and self._known(element := f"{owner}[{len(elements) + 1}].{member}"):
            elements.append(element)
        return elements

    def dimension(self, expr: Expr, scope: str = "", extra: Mapping[str, Dimension] | None = None) -> Dimension | None:
        """The dimension of a formula; ExpressionProblem where its units disagree."""
        more = extra or {}
        self._check_lengths(expr, scope)
        return dimension(expr, lambda name: more[name.text] if name.text in more else self._dimension(scope, name))

    def unit(self, expr: Expr) -> Unit | None:
        """The SI unit of a formula, and the entity that it counts, if known (`counted`); None if any unit fits."""
        dimension = self.dimension(expr)
        if dimension is None:
            return None
        counts = counted(expr, lambda name: unit.counts if (unit := self._declared(name.text)) is not None else "")
        turns = {"angle": "rad/s", "cycles": "Hz"} if dimension == FREQUENCY else {}
        text = turns.get(counts) or dimension_text(dimension)
        return Unit(text, 1.0, 0.0, dimension, counts)

    def _declared(self, path: str) -> Unit | None:
        return self.unknowns[self.names[path]].unit if path in self.names else self.units.get(path)

    def _value(self, scope: str, text: str, name: Name) -> ca.SX:
        if text == "time":
            return self.time
        path = scope + text
        if path in self.names:
            return self.columns[0][self.names[path]]
        if path in self.constants:
            return self.constants[path]
        if elements := self._elements(path):
            values = [self._value("", element, name) for element in elements]
            return stack(values) if self._known(elements[0]) else ca.vertcat(*(row.T for row in values))
        port, _, member = path.rpartition(".")
        if member == POWER and port in self.bonds:
            return self.bonds[port].power(split(self.columns[0]))
        raise self._unknown(path, name)

    def _dimension(self, scope: str, name: Name) -> Dimension:
        path = scope + _end_of(name, "low")
        if name.text in ("time", "pi"):
            return SECOND if name.text == "time" else ONE
        while elements := self._elements(path):
            path = elements[0]
        if path in self.names:
            return self.unknowns[self.names[path]].unit.dimension
        if path in self.units:
            return self.units[path].dimension
        port, _, member = path.rpartition(".")
        if member == POWER and port in self.bonds:
            return WATT
        raise self._unknown(path, name)

    def _unknown(self, path: str, name: Name) -> ExpressionProblem:
        powers = [f"{port}.{POWER}" for port in self.bonds] if path.endswith(f".{POWER}") else []
        owner, _, member = path.rpartition(".")
        if path == "t":
            hint = "The time is called 'time'."
        elif member in ANGLES and self._known(f"{owner}.q_0"):
            hint = "A frame in space has no angles. Add a SpatialSensor `attitude` to the node and write " \
                f"`attitude.{ANGLES[member]}`, or name the coordinate of a joint, such as `joint.phi`."
        else:
            hint = suggest(path, powers or [*self.names, *self.constants]) or NAMES_LISTED
        return ExpressionProblem("name-unknown", f"nothing here is called '{name.text}'", name.column, name.length,
                                 hint)

    def _der(self, expression: ca.SX) -> ca.SX:
        if ca.depends_on(expression, self.columns[-1]):
            raise ExpressionProblem("derivative-too-high", f"more than {len(self.columns) - 1} derivatives of a variable "
                                    "are not available here", 0, hint="Leave out a `der`.")
        low, high = ca.vertcat(*self.columns[:-1]), ca.vertcat(*self.columns[1:])
        return derivative_along(expression, low, high) + derivative_along(expression, self.time, self.rate)


def _end_of(name: Name, end: str) -> str:
    """A name; for several elements the first (`low`) or last (`high`) of them."""
    parts = tuple(getattr(part, end) if isinstance(part, Slice) else part for part in name.parts)
    return Name(parts, name.column, name.length).text
