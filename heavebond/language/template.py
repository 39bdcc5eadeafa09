"""A component's equations as CasADi expressions in local symbols, built once and shared by all its instances."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import Enum
from functools import lru_cache, partial
from math import inf
from operator import methodcaller
from typing import TypeVar

import casadi as ca

from heavebond.core.errors import ModelError, Place, Problem, listing, suggest
from heavebond.language.definition import (
    Component,
    Domain,
    EventDefinition,
    Formula,
    FrameRelation,
    Reset,
    Variable,
)
from heavebond.language.incidence import Entry, Interval, classify
from heavebond.language.symbols import Called, Context, evaluate, indicator, nonsmooth, operated, split, stack
from heavebond.text.expression import Expr, ExpressionProblem, Name, Slice, names
from heavebond.text.shapes import Lengths, Shape, indexed

Result = TypeVar("Result")
# a component's text contains at most der(der(x)); index reduction differentiates on the flat model
LEVELS = 3
BEYOND = 1e-9


@dataclass(frozen=True)
class Line:
    """One equation of a template: name, text, place, and the function with a kink in it, if any."""

    label: str
    text: str
    place: Place
    kink: str | None


@dataclass(frozen=True)
class EventLine:
    """An event of a template, and the local name of the target of each of its resets."""

    when: EventDefinition
    targets: tuple[str, ...]


class FrameForm(Enum):
    """The form of a relation between two frames: explicit for the frame of `b`, explicit for that of `a`, or three equations
    for a loop that it closes."""

    FORWARD = "forward"
    INVERSE = "inverse"
    CLOSING = "closing"


@dataclass(frozen=True, eq=False)
class FrameEquations:
    """Equations of a relation of frames in one form: their names and text, the function of their residuals (with the
    arguments of `Template.residuals`) and the incidence of these."""

    labels: tuple[str, ...]
    text: str
    residuals: ca.Function
    entries: tuple[tuple[Entry, ...], ...]


@dataclass(frozen=True, eq=False)
class FrameLaw:
    """A relation of frames: the equations of its rotation and of its translation in each form; none if these are not
    related."""

    a: str
    b: str
    place: Place
    rotation: Mapping[FrameForm, FrameEquations]
    translation: Mapping[FrameForm, FrameEquations]


@dataclass(frozen=True, eq=False)
class Template:
    """Residuals r(slots, d slots, d2 slots, given, time, time rate) of a component; all residuals in SI.

    `slots` are the local names (`a.v`, `F`, `u`) in the order of the arguments, `given` the parameters and then the held
    variables; `residuals` is a CasADi function with one output per equation, `entries[i]` the incidence of equation i with
    columns level * len(slots) + slot. `energy` gives (power into the ports, d stores/dt, dissipates, unbalanced, stores),
    `requirements` the truth of each. `happenings` gives for each event (indicator of the condition, first instant, period,
    new value of each target).
    """

    slots: tuple[str, ...]
    parameters: tuple[str, ...]
    held: tuple[str, ...]
    lines: tuple[Line, ...]
    residuals: ca.Function
    entries: tuple[tuple[Entry, ...], ...]
    energy: ca.Function
    requirements: ca.Function
    events: tuple[EventLine, ...]
    happenings: ca.Function | None
    frames: tuple[FrameLaw, ...] = ()

    @property
    def given(self) -> tuple[str, ...]:
        """Names of the values that are constant between events."""
        return (*self.parameters, *self.held)


def template(component: Component, domains: Mapping[str, Domain], bound: Mapping[str, str],
             integers: Mapping[str, int]) -> Template:
    """The template of a component; `bound` maps each of its ports to its domain."""
    return _cached(_Key(component, dict(domains)), tuple(bound.items()), tuple(integers.items()))


@dataclass(frozen=True)
class _Key:
    """A component by identity: the loader returns the same object for the same file."""

    component: Component
    domains: dict[str, Domain]

    def __hash__(self) -> int:
        return id(self.component)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and other.component is self.component


@lru_cache(maxsize=4096)
def _cached(key: _Key, bound: tuple[tuple[str, str], ...], integers: tuple[tuple[str, int], ...]) -> Template:
    return _Builder(key.component, key.domains, dict(bound), dict(integers)).template()


class _Builder:
    def __init__(self, component: Component, domains: Mapping[str, Domain], bound: Mapping[str, str],
                 integers: Mapping[str, int]):
        self.component, self.domains, self.bound, self.integers = component, domains, bound, integers
        self.time, self.rate = ca.SX.sym("time"), ca.SX.sym("time_rate")
        self.parameters = {n: ca.SX.sym(n) for n, p in component.parameters.items() if not p.integer}
        self.held = {n: ca.SX.sym(n) for n in component.held}
        self.arrays = {n: self._count(p.count) for n, p in component.ports.items() if p.count is not None}
        self.levels: list[dict[str, ca.SX]] = [{} for _ in range(LEVELS)]
        # port members, signals and inner variables; a position only if the text names it
        texts = [n.text for tree in self._trees() for n in names(tree)]
        positions = {(port, member) for t in texts if "." in t
                     for port in [t.split("[")[0].split(".")[0]] for d in [self.bound.get(port)] if d
                     for member in [self.domains[d].role(t.rsplit(".", 1)[1])]
                     if member in (*self.domains[d].positions, *self.domains[d].orientation)}
        related = {port for relation in self.component.frames for port in (relation.a, relation.b) if port}
        turned = related | {port for port, member in positions if member in self.domains[self.bound[port]].orientation}
        positions |= {(port, member) for port in related for member in self.domains[self.bound[port]].positions}
        slots = []
        for port, domain_name in self.bound.items():
            domain = self.domains[domain_name]
            copies = [f"{port}[{k + 1}]" for k in range(self.arrays[port])] if port in self.arrays else [port]
            members = [*domain.across, *domain.through, *(m for m in domain.positions if (port, m) in positions),
                       *(domain.orientation if port in turned else ())]
            slots += [f"{copy}.{member}" for copy in copies for member in members]
        for slot in [*slots, *self.component.signals, *self.component.unknowns]:
            for level in range(LEVELS):
                self.levels[level][slot] = ca.SX.sym("d" * level + slot)
        # the shape of each list of parameters, variables or signals: the shape of `x` by its last element `x[3]`
        self.lists: dict[str, Shape] = {}
        for name in (*self.parameters, *self.held, *self.component.signals, *self.component.unknowns):
            base, bracket, last = name.partition("[")
            if bracket:
                rows, _, columns = last[:-1].partition("][")
                self.lists[base] = (int(rows), int(columns)) if columns else int(rows)
        # whether the laws may contain lists
        self.vectors = bool(self.lists or self.arrays or any(domains[name].vectors for name in bound.values()))
        self.called: Called = {}
        self.context = self._context({})

    def _context(self, index: Mapping[str, int]) -> Context:
        return Context(self._lookup, self._der, {**self.integers, **index}, called=self.called)

    def _length(self, name: Name) -> Shape:
        """The shape of a name's value; None for a number."""
        head = name.parts[0]
        shape = (self.arrays.get(head) or self.lists.get(head)) if isinstance(head, str) else None
        return None if shape is None else indexed(shape, name, self._size)

    def _size(self, part: Slice) -> int:
        low, high = (int(float(evaluate(bound, self.context))) for bound in (part.low, part.high))
        return max(1, high - low + 1)

    def _count(self, expr: Expr) -> int:
        context = Context(self._lookup_nothing, lambda x: x, self.integers)
        return int(float(evaluate(expr, context)))

    def _lookup_nothing(self, text: str, name: Name) -> ca.SX:
        raise ExpressionProblem("not-an-integer", f"'{text}' is not a whole number", name.column, name.length)

    def _trees(self) -> list[Expr]:
        component = self.component
        formulas = [component.stores, component.dissipates, component.unbalanced,
                    *(formula for relation in component.frames for _, formula, _ in relation.formulas)]
        for event in component.when:
            formulas += [event.formula, *(f for reset in event.resets for f in (reset.target, reset.value))]
        return [side for line in component.equations for side in (line.tree.left, line.tree.right)] + \
            [f.tree for f in formulas if f is not None]

    def _lookup(self, text: str, name: Name) -> ca.SX:
        if text in self.parameters:
            return self.parameters[text]
        if text in self.held:
            return self.held[text]
        if text == "time":
            return self.time
        head, _, member = text.partition(".")
        port = head.partition("[")[0]
        if port in self.bound:
            text = f"{head}.{self.domains[self.bound[port]].role(member)}"
        if text in self.levels[0]:
            return self.levels[0][text]
        if isinstance(shape := self.lists.get(text), tuple):
            return ca.vertcat(*(ca.horzcat(*(self._lookup(f"{text}[{i + 1}][{j + 1}]", name) for j in range(shape[1])))
                                for i in range(shape[0])))
        if shape is not None:
            return stack(self._lookup(f"{text}[{k + 1}]", name) for k in range(shape))
        if head in self.arrays:
            return stack(self._lookup(f"{head}[{k + 1}].{member}", name) for k in range(self.arrays[head]))
        raise ExpressionProblem("name-unknown", f"'{name.text}' is not a name in this component", name.column, name.length,
                              suggest(text, known := [*self.parameters, *self.held, *self.levels[0]])
                              or f"the names in {self.component.name} are {listing(known)}; an index counts from 1.")

    def _der(self, expression: ca.SX) -> ca.SX:
        """d/dt by the chain rule; the explicit dependence on time carries the factor `time_rate` (1, or 0 when the
        inputs are held still to find a steady start)."""
        low = stack([s for level in self.levels[:-1] for s in level.values()])
        high = stack([s for level in self.levels[1:] for s in level.values()])
        column = ca.vec(expression)
        rate = ca.jtimes(column, low, high) + ca.jtimes(column, self.time, self.rate)
        return ca.reshape(rate, expression.shape)

    def _evaluated(self, tree: Expr, place: Place, build: Callable[[Expr, Context], ca.SX] = evaluate) -> ca.SX:
        try:
            return build(tree, self.context)
        except ExpressionProblem as problem:
            where = place.moved(problem.column, problem.length)
            raise ModelError([Problem(problem.code, problem.message, where, problem.hint)]) from None

    def _lines(self) -> tuple[list[Line], list[ca.SX]]:
        lines, residuals = [], []
        known = {*(n.partition("[")[0] for n in (*self.parameters, *self.held)), *self.integers, "pi"}
        for equation in self.component.equations:
            constant = self._constants({*known, equation.each[0]} if equation.each else known)
            for index in self._indices(equation.each, equation.place):
                self.context = self._context(index)
                shape = self._shaped(methodcaller("equation", equation.tree), equation.place) if self.vectors else None
                left = self._evaluated(equation.tree.left, equation.place)
                right = self._evaluated(equation.tree.right, equation.place)
                kink = nonsmooth(equation.tree.left, constant) or nonsmooth(equation.tree.right, constant)
                lines += [Line(equation.label + suffix, equation.text.strip(), equation.place, kink)
                          for suffix in _elements(shape)]
                residuals.append(ca.vec(operated("-", left, right).T))  # row by row; a plain 0 is a list of zeros
        self.context = self._context({})
        return lines, residuals

    def _shaped(self, ask: Callable[[Lengths], Result], place: Place) -> Result:
        """The result of a question about shapes; ModelError if they do not fit."""
        try:
            return ask(Lengths(self._length, exact=True))
        except ExpressionProblem as problem:
            where = place.moved(problem.column, problem.length)
            raise ModelError([Problem(problem.code, problem.message, where, problem.hint)]) from None

    @staticmethod
    def _constants(known: set[str]) -> Callable[[str], bool]:
        return lambda text: text.partition("[")[0] in known

    def _indices(self, each: tuple[str, Expr, Expr] | None, place: Place) -> list[dict[str, int]]:
        if each is None:
            return [{}]
        low, high = (int(float(self._evaluated(e, place))) for e in each[1:])
        return [{each[0]: k} for k in range(low, high + 1)]

    def template(self) -> Template:
        lines, residuals = self._lines()
        arguments = [stack(level.values()) for level in self.levels]
        parameters, constants = stack(self.parameters.values()), stack([*self.parameters.values(), *self.held.values()])
        inputs = [*arguments, constants, self.time, self.rate]
        stacked = stack(residuals)
        entries = classify(stacked, stack(arguments), {s.element_hash() for s in self.parameters.values()},
                           self._bounds())
        truths = [self._number(r) for r in self.component.requires]
        events, happenings = self._events()
        return Template(
            tuple(self.levels[0]), tuple(self.parameters), tuple(self.held), tuple(lines),
            ca.Function("residuals", inputs, [stacked]), tuple(tuple(row) for row in entries),
            ca.Function("energy", inputs, [stack(self._energy())]),
            ca.Function("requirements", [parameters], [stack(truths)]), events,
            ca.Function("happenings", inputs, [stack(happenings)]) if events else None,
            tuple(self._frame_law(relation, inputs, stack(arguments)) for relation in self.component.frames))

    def _frame_law(self, relation: FrameRelation, inputs: list[ca.SX], unknowns: ca.SX) -> FrameLaw:
        """The equations of a relation of frames in each form. With R the rotation of `a`:

            q_b = q_a (x) turn,  w_b = w_a + R spin;   r_b = r_a + R shift,  v_b = v_a + w_a x R shift + R speed
        """
        constants = {s.element_hash() for s in self.parameters.values()}

        def equations(quantity: str, formula: Formula, residual: ca.SX) -> FrameEquations:
            rows = classify(residual, unknowns, constants, self._bounds())
            text = f"{quantity} of {relation.b}" + (f" from {relation.a}" if relation.a else "") + f": {formula.text}"
            labels = tuple(f"{quantity} of {relation.b}, element {k + 1}" for k in range(residual.numel()))
            return FrameEquations(labels, text,
                                  ca.Function("frame", inputs, [residual]), tuple(tuple(row) for row in rows))

        forms = (FrameForm.FORWARD, FrameForm.CLOSING, *((FrameForm.INVERSE,) if relation.a else ()))
        rotation = {form: equations("orientation", relation.turn, self._rotation(relation, form)) for form in forms} \
            if relation.turn is not None else {}
        translation = {form: equations("position", relation.shift, self._translation(relation, form)) for form in forms} \
            if relation.shift is not None else {}
        return FrameLaw(relation.a, relation.b, relation.place, rotation, translation)

    def _rotation(self, relation: FrameRelation, form: FrameForm) -> ca.SX:
        assert relation.turn is not None
        turn = self._evaluated(relation.turn.tree, relation.turn.place)
        spin = turning_speed(turn, self._der(turn)) if relation.spin is None else \
            self._evaluated(relation.spin.tree, relation.spin.place)
        still = ca.SX([1, 0, 0, 0])
        (qa, wa), (qb, wb) = ((still, ca.SX(3, 1)) if not port else (self._orientation(port), self._vector(port, "turning"))
                              for port in (relation.a, relation.b))
        ahead = quaternion_product(qa, turn) if relation.a else turn
        faster = wa + (rotated(qa, spin) if relation.a else spin)
        if form is FrameForm.FORWARD:
            return stack([qb - ahead, wb - faster])
        if form is FrameForm.INVERSE:
            return stack([qa - quaternion_product(qb, conjugate(turn)), wb - faster])
        return quaternion_product(conjugate(qb), ahead)[1:]

    def _translation(self, relation: FrameRelation, form: FrameForm) -> ca.SX:
        assert relation.shift is not None
        shift = self._evaluated(relation.shift.tree, relation.shift.place)
        speed = self._der(shift) if relation.speed is None else self._evaluated(relation.speed.tree, relation.speed.place)
        rb, vb = self._vector(relation.b, "positions"), self._vector(relation.b, "flows")
        place, velocity = shift, speed
        if relation.a:
            ra, va, wa, q = (self._vector(relation.a, "positions"), self._vector(relation.a, "flows"),
                             self._vector(relation.a, "turning"), self._orientation(relation.a))
            arm = rotated(q, shift)
            place, velocity = ra + arm, va + ca.cross(wa, arm) + rotated(q, speed)
        return rb - place if form is FrameForm.CLOSING else stack([rb - place, vb - velocity])

    def _vector(self, port: str, quantity: str) -> ca.SX:
        """The positions of a port, their rates (`flows`), or its angular velocity (`turning`)."""
        domain = self.domains[self.bound[port]]
        members = {"positions": domain.positions, "flows": tuple(domain.rate(x) for x in domain.positions),
                   "turning": domain.vectors[domain.turning]}[quantity]
        return stack(self.levels[0][f"{port}.{member}"] for member in members)

    def _orientation(self, port: str) -> ca.SX:
        return stack(self.levels[0][f"{port}.{member}"] for member in self.domains[self.bound[port]].orientation)

    def _events(self) -> tuple[tuple[EventLine, ...], list[ca.SX]]:
        local = {s.element_hash(): name for group in (self.levels[0], self.held) for name, s in group.items()}
        still = {s.element_hash() for group in (self.parameters, self.held) for s in group.values()}
        lines, happenings = [], []
        for when in self.component.when:
            condition, first, period = ca.SX(0), ca.SX(0), ca.SX(0)
            if when.key == "condition":
                condition = self._evaluated(when.formula.tree, when.formula.place, partial(indicator, still=still))
            elif when.key == "at":
                first = self._evaluated(when.formula.tree, when.formula.place)
            else:
                period = self._evaluated(when.formula.tree, when.formula.place)
                first = self._optional(when.first)
            targets, resets, values = [], [], []
            for reset in when.resets:  # of a list, each of its elements
                target = split(ca.vec(self._evaluated(reset.target.tree, reset.target.place)))
                if len(target) > 1:
                    self._shaped(partial(_assigned, reset), reset.value.place)
                value = split(ca.vec(self._evaluated(reset.value.tree, reset.value.place)))
                targets += target
                resets += [reset] * len(target)
                values += value * (len(target) if len(value) == 1 else 1)
            lines.append(EventLine(replace(when, resets=tuple(resets)),
                                   tuple(local[target.element_hash()] for target in targets)))
            happenings += [condition, first, period, *values]
        return tuple(lines), happenings

    def _bounds(self) -> dict[int, Interval]:
        bounds: dict[int, Interval] = {}
        for name, parameter in self.component.parameters.items():
            if name in self.parameters:
                bounds[self.parameters[name].element_hash()] = _interval(parameter.low, parameter.high)
        for name, variable in self.component.unknowns.items():
            bounds[self.levels[0][name].element_hash()] = _interval(variable.low, variable.high)
        for name, variable in self.component.held.items():
            bounds[self.held[name].element_hash()] = held_interval(variable)
        return bounds

    def _energy(self) -> list[ca.SX]:
        power = ca.SX(0)
        for port, domain_name in self.bound.items():
            domain = self.domains[domain_name]
            copies = [f"{port}[{k + 1}]" for k in range(self.arrays[port])] if port in self.arrays else [port]
            for copy in copies:
                if domain.power:
                    power += self.levels[0][f"{copy}.{domain.power}"]
                else:
                    power += sum((self.levels[0][f"{copy}.{effort}"] * self.levels[0][f"{copy}.{flow}"]
                                  for effort, flow in domain.pairs), ca.SX(0))
        component = self.component
        stores = self._optional(component.stores)
        return [power, self._der(stores), self._optional(component.dissipates), self._optional(component.unbalanced),
                stores]

    def _optional(self, formula: Formula | None) -> ca.SX:
        return ca.SX(0) if formula is None else self._number(formula)

    def _number(self, formula: Formula) -> ca.SX:
        """Evaluate a formula that is one number, with its vectors and matrices compared."""
        if self.vectors:
            self._shaped(lambda lengths: lengths.number(formula.tree, "the formula"), formula.place)
        return self._evaluated(formula.tree, formula.place)


def quaternion_product(a: ca.SX, b: ca.SX) -> ca.SX:
    """a (x) b for quaternions (4,), the real part first."""
    return ca.vertcat(a[0]*b[0] - ca.dot(a[1:], b[1:]), a[0]*b[1:] + b[0]*a[1:] + ca.cross(a[1:], b[1:]))


def conjugate(q: ca.SX) -> ca.SX:
    """The quaternion (4,) of the reverse rotation of a unit quaternion."""
    return ca.vertcat(q[0], -q[1:])


def rotated(q: ca.SX, r: ca.SX) -> ca.SX:
    """The vector r (3,) turned by the unit quaternion q (4,)."""
    if r.is_zero():
        return r
    twice = 2*ca.cross(q[1:], r)
    return r + q[0]*twice + ca.cross(q[1:], twice)


def turning_speed(q: ca.SX, rate: ca.SX) -> ca.SX:
    """The angular velocity (3,) in the fixed frame of a frame with unit quaternion q (4,): 2 vec(dq/dt (x) conj(q))."""
    return 2*quaternion_product(rate, conjugate(q))[1:]


def _assigned(reset: Reset, lengths: Lengths) -> None:
    """Check the shape of a new value; the target is a name, as `event_laws` has checked."""
    if isinstance(reset.target.tree, Name):
        lengths.assigned(reset.target.tree, reset.value.tree)


def _elements(shape: Shape) -> list[str]:
    """Suffix of the label of each element of an equation."""
    if isinstance(shape, tuple):
        return [f", element {i + 1}, {j + 1}" for i in range(shape[0]) for j in range(shape[1])]
    return [""] if shape is None else [f", element {k + 1}" for k in range(shape)]


def held_interval(variable: Variable) -> Interval:
    """The bounds of a held variable as an interval, with bounds at zero extended slightly beyond: a held variable may be
    zero, so equations must not be divided by it.
    """
    low, high = _interval(variable.low, variable.high)
    return -BEYOND if low == 0 else low, BEYOND if high == 0 else high


def _interval(low: float | None, high: float | None) -> Interval:
    return (-inf if low is None else low, inf if high is None else high)
