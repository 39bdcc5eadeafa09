"""Definitions of components, domains and parts of diagrams: frozen values, each with its place in a file."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from heavebond.core.errors import Place
from heavebond.core.units import Range, Unit
from heavebond.text.expression import Call, Compare, Equation, Expr, FunctionCall, Name, children, inside

REGULARISED = ("smooth_sign", "signed_sqrt")  # functions whose second argument is the width over which they turn


@dataclass(frozen=True)
class Member:
    """One variable of a port: its unit, the size that it commonly has (for scaling; `sized` tells whether the domain
    declares one), what it never falls below, and the guess where a start is searched and nothing else is known. Below
    `physical` its laws mean nothing; `beyond` says what that is and what to do. No machine has a value larger than
    `largest`. `noun` is what it is called in a sentence."""

    name: str
    unit: Unit
    nominal: float
    doc: str = ""
    low: float | None = None
    start: float | None = None
    physical: float | None = None
    beyond: str = ""
    largest: float | None = None
    sized: bool = False
    noun: str = ""


@dataclass(frozen=True)
class Domain:
    """What a wire of one kind carries: `across` is shared at a node, `through` sums to zero. Power is the sum of effort
    times flow over the pairs of `efforts` and `flows` (a machine in a plane has three), or the one variable `power`; in
    mechanics the flows are the rates of the `positions`. `effort`, `flow` and `position` are those of a domain with one
    pair, else None. `reference` is the component that stands for the surroundings: the ground, a tank; `medium` the one
    that sets what flows in a circuit; `fills` the component, with its settings, that a node without storage is given where
    a run stops without. Where the effort is `relative`, a voltage, only its differences mean something: its zero is
    wherever ground was put. Lines are drawn in `colour`, areas in `pale`. What is `determined_by` fixes the shared variable
    of a node; a `compliance` ends a rigid loop."""

    name: str
    members: dict[str, Member]
    across: tuple[str, ...]
    through: tuple[str, ...]
    efforts: tuple[str, ...]
    flows: tuple[str, ...]
    positions: tuple[str, ...]
    power: str | None
    reference: str | None = None
    medium: str | None = None
    fills: tuple[str, tuple[tuple[str, str], ...]] | None = None
    relative: bool = False
    colour: str = ""
    pale: str = ""
    determined_by: str = "what decides it"
    compliance: str = "a part that gives way"

    @property
    def effort(self) -> str | None:
        """The effort of a domain with one pair."""
        return self.efforts[0] if len(self.efforts) == 1 else None

    @property
    def flow(self) -> str | None:
        """The flow of a domain with one pair."""
        return self.flows[0] if len(self.flows) == 1 else None

    @property
    def position(self) -> str | None:
        """The position of a domain with one pair."""
        return self.positions[0] if len(self.positions) == 1 else None

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """Each effort with its flow."""
        return tuple(zip(self.efforts, self.flows, strict=True))

    def rate(self, position: str) -> str:
        """The flow that is the rate of a position."""
        return self.flows[self.positions.index(position)]

    def role(self, member: str) -> str:
        """The member's own name for `effort` and `flow` as generic ports write them."""
        generic = {"effort": self.effort, "flow": self.flow, "position": self.position}
        return generic.get(member) or member


@dataclass(frozen=True)
class Port:
    """A power port; `domain` may be `$D` (taken from what it is wired to), `count` makes it an array."""

    name: str
    domain: str
    place: Place
    doc: str = ""
    count: Expr | None = None


@dataclass(frozen=True)
class SignalPort:
    """A directed signal, `direction` in or out; `count` makes it a vector, with `columns` a matrix."""

    name: str
    direction: str
    unit: Unit
    place: Place
    doc: str = ""
    count: Expr | None = None
    columns: Expr | None = None


@dataclass(frozen=True)
class Value:
    """A number with its unit or a formula, as written in a diagram; `si`: a plain Python number in SI; `file`: the one in
    whose column it stands."""

    expr: Expr
    text: str
    place: Place
    formula: bool = False
    si: bool = False
    file: Path | None = None


@dataclass(frozen=True)
class FileInput:
    """A signal given by a column of a measured file; `interpolation` is spline, linear or hold.

    `file` is `Path()` where the experiment's record is meant. `bridge`: gaps may be gone across. `zero` is the file and its
    column of times from whose first row times of a clock count, where that is another one's. `noise` is the standard
    deviation of its white noise, in `unit` (0: none is known); `seed` that of a realisation of this noise to be added to
    the readings; `smooth` the frequency in Hz above which a smoothing spline takes away more than half.
    """

    file: Path
    column: str
    unit: str
    interpolation: str
    place: Place
    time_column: str | None = None
    time_unit: str = "s"
    bridge: bool = False
    zero: tuple[Path, str] | None = None
    noise: float = 0.0
    seed: int | None = None
    smooth: float | None = None


@dataclass(frozen=True)
class SearchRange:
    """Where a number of an effect is sought: within a range, or within that in which the component's own variable
    `seen` moves while a record is simulated; or it is not sought but `held` at the middle of that motion, at half its span
    or at its peak (see HELD)."""

    range: Range | None
    seen: str
    place: Place | None = None
    held: str = ""


HELD = ("middle", "half", "peak")


@dataclass(frozen=True)
class Meaning:
    """A sentence of physics about an effect: `texts` with a field between each two of them. A field is a name (`part`,
    `place`, a port or a parameter) or a formula of the component's parameters."""

    texts: tuple[str, ...]
    fields: tuple[str | Expr, ...]
    place: Place


@dataclass(frozen=True)
class Typical:
    """Between which values a parameter commonly lies, and who says so; without a range, `source` is what an engineer
    compares its value with."""

    range: Range | None
    source: str


@dataclass(frozen=True)
class Effect:
    """What a component would be if it were missing from a diagram: an entry of the catalogue.

    kind: what a finding is called, the same for all laws of a kind; attaches: where it may stand (see ATTACHES);
    amplitude: parameters that are zero where the effect is absent (None), or that have no such value and are sought
    within a range; shapes: the other parameters that are sought; also: further ports and the domain on whose nodes they
    are tried; replaces: the components whose place it takes, `start` giving its parameters by those of the `old` one: an
    amplitude under `start` is absent at that value instead of zero; settled: variables (`v`) and rates (`der(v)`) that are
    zero at the start of a record, as far as that is open: a machine that runs already; meaning: what the effect does, with
    its values, in a sentence; requires: kinds of components of which one must stand on the node of a port, or that a
    variable REVERSES in the records; acts: a quantity that is above zero while the effect acts; varies_with: of the
    factor of a parameter, what its input is (see VARIES_WITH).
    """

    kind: str
    description: str
    attaches: tuple[str, ...]
    amplitude: dict[str, SearchRange | None]
    shapes: dict[str, SearchRange]
    also: dict[str, str]
    replaces: tuple[str, ...]
    start: dict[str, Formula]
    settled: tuple[str, ...]
    place: Place
    meaning: Meaning | None = None
    requires: dict[str, tuple[str, ...]] = field(default_factory=dict)
    acts: Formula | None = None
    varies_with: tuple[str, ...] = ()


REVERSES = "reverses"  # what `requires:` asks of a variable: that it does not move in one direction only

# between two nodes; on a node; between a port and its node; before a signal input; behind a measured output; as the factor
# of a part's parameter
ATTACHES = ("across", "at", "in series", "input", "channel", "parameter")
# what a parameter may vary with: a variable of its part that changes its sign, any variable of its part, the time, a time
VARIES_WITH = ("rate", "variable", "time", "instant")
FACTOR = "factor"  # the variable of a component that is the factor of a parameter


@dataclass(frozen=True)
class Parameter:
    """A constant of a component, or with `count` a list of them, with `columns` a matrix; bounds and default in SI.

    `neutral` is the value at which an effect is absent: such a parameter is a dormant effect, called `kind`, `sought`
    within a range when it wakes and with it those it `wakes_with`; `meaning` describes the effect with its value.
    `medium` names the parameter of the circuit's medium whose value it takes where it is not given.
    An `instant` is a time at which something begins or changes: the beginning of a record does not tell it.
    A `width` is that of a transition which makes a law smooth: results should not depend on it. One in the unit of a speed
    is that of dry friction around rest.
    """

    name: str
    unit: Unit
    place: Place
    doc: str = ""
    low: float | None = None
    high: float | None = None
    default: Value | None = None
    neutral: float | None = None
    integer: bool = False
    kind: str = ""
    sought: SearchRange | None = None
    wakes_with: tuple[str, ...] = ()
    count: Expr | None = None
    medium: str = ""
    width: bool = False
    columns: Expr | None = None
    meaning: Meaning | None = None
    typical: Typical | None = None
    instant: bool = False


def rate_of(text: str) -> str | None:
    """The variable of which `der(v)` is the rate; None for any other text."""
    found = re.fullmatch(r"der\((.+)\)", text)
    return found[1] if found is not None else None


@dataclass(frozen=True)
class Variable:
    """An inner unknown of a component, or with `count` a list or matrix of them; `start` is the guess where nothing else is
    known, `nominal` its typical size where that is not the usual one of its unit. A run ends where it falls below its
    `physical` limit; `beyond` says what happens there and what models it.

    With `held`, the value that it starts at, it is no unknown: it is constant between events, which alone change it. With
    `delayed` no equation of the component decides it: it is another variable at an earlier time.
    """

    name: str
    unit: Unit
    place: Place
    doc: str = ""
    low: float | None = None
    high: float | None = None
    start: float | None = None
    held: float | None = None
    count: Expr | None = None
    nominal: float | None = None
    columns: Expr | None = None
    physical: float | None = None
    beyond: str = ""
    delayed: Delayed | None = None


@dataclass(frozen=True)
class Delayed:
    """The variable or signal `of` of the same component, delayed by a formula of its parameters; it is constant before
    the start."""

    of: str
    by: Formula
    place: Place


@dataclass(frozen=True)
class Approximation:
    """The component `kind` without history that takes the place of one with delayed variables: where the whole number
    `order` is above 0, and in computations that keep no history."""

    kind: str
    order: str
    place: Place


@dataclass(frozen=True)
class EquationLine:
    """One equation with its name (the `#` comment) and where it stands; `each` is (index, low, high) or None."""

    tree: Equation
    text: str
    label: str
    place: Place
    each: tuple[str, Expr, Expr] | None = None


@dataclass(frozen=True)
class Formula:
    """An expression of a component that is no equation (stores, dissipates, a requirement)."""

    tree: Expr
    text: str
    place: Place


@dataclass(frozen=True)
class Reset:
    """What an event sets: a held variable or a state, `target` with its place in the file, to a new value."""

    target: Formula
    value: Formula


@dataclass(frozen=True)
class EventDefinition:
    """An event of a component: it happens as `condition` becomes true, at the instant `at`, or `every` so often from
    `first` on (None: from 0). `key` is the one of these words that it is written with. `impulse` is the held variable by
    whose impulse the one of its targets changes that is not held (empty: it is set). With `moves`, the name of a speed, it
    is the breakaway of a contact, and happens only if that speed changes by it; else `otherwise` is set."""

    name: str
    key: str
    formula: Formula
    first: Formula | None
    resets: tuple[Reset, ...]
    place: Place
    impulse: str = ""
    moves: str = ""
    otherwise: tuple[Reset, ...] = ()


@dataclass(frozen=True)
class Instance:
    """A component standing in a diagram or a block: its kind, what was set on it, and the parts beside it, with their
    places, from which it takes the parameters that are not."""

    name: str
    kind: str
    place: Place
    kind_place: Place
    settings: dict[str, Value | FileInput] = field(default_factory=dict)
    at: tuple[float, ...] | None = None
    repeat: Value | None = None
    data: tuple[tuple[str, Place], ...] = ()


@dataclass(frozen=True)
class End:
    """One end of a wire: `spring.a`, or a bare port name inside a block."""

    path: str
    place: Place


@dataclass(frozen=True)
class Wire:
    """A node: its name and the ports that it joins."""

    name: str
    ends: tuple[End, ...]
    place: Place


@dataclass(frozen=True)
class Body:
    """Instances and the wires between them; `inside` are parts of blocks by their paths (`ahc.pump`) whose place others
    take."""

    instances: dict[str, Instance] = field(default_factory=dict)
    wires: dict[str, Wire] = field(default_factory=dict)
    inside: dict[str, Instance] = field(default_factory=dict)


@dataclass(frozen=True)
class ForeignVariable:
    """A variable of an FMU by its `name` in the component: its own name, type and value reference; in SI it is
    scale * value + offset."""

    name: str
    own: str
    type: str
    reference: int
    scale: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Foreign:
    """The FMU behind a component: its file, and what it is given and gives."""

    path: Path
    identifier: str
    inputs: tuple[ForeignVariable, ...]
    outputs: tuple[ForeignVariable, ...]
    parameters: tuple[ForeignVariable, ...]


_FIRST_WORD = re.compile(r"(?<![\w.])[A-Za-z_]\w*")  # of a name in a formula


@dataclass(frozen=True)
class Component:
    """A component file: ports, parameters, variables, equations and, for a block, what it is composed of.

    `sliding` is what is set where dry friction is linearised as it slides, for laws whose slope at rest is no width.
    `symbol` names the picture that stands for it in drawings; without one it is drawn as a box. `foreign` is the FMU
    that sets its held variables. `extends` names the components whose laws it has, with other values: the nearest first;
    `values` are those of the elements of its lists.
    """

    name: str
    summary: str
    place: Place
    path: Path
    ports: dict[str, Port] = field(default_factory=dict)
    signals: dict[str, SignalPort] = field(default_factory=dict)
    parameters: dict[str, Parameter] = field(default_factory=dict)
    variables: dict[str, Variable] = field(default_factory=dict)
    equations: tuple[EquationLine, ...] = ()
    initial: tuple[Reset, ...] = ()  # states at the start, where the diagram does not give them
    travel_time: Formula | None = None  # that of a wave through a segment of a line
    opens: Formula | None = None  # positive while a valve passes from the first to the second port in it
    when: tuple[EventDefinition, ...] = ()
    body: Body = field(default_factory=Body)
    stores: Formula | None = None
    dissipates: Formula | None = None
    unbalanced: Formula | None = None
    unbalanced_why: str = ""
    power: str = ""
    requires: tuple[Formula, ...] = ()
    restrictions: str = ""
    source: str = ""
    symbol: str = ""
    effects: tuple[Effect, ...] = ()
    sliding: dict[str, float] = field(default_factory=dict)
    placeholder: str = ""  # why its law is missing: it stands for something that was not translated
    units_checked: bool = True  # False: the equations are between numbers in SI, as in an imported component
    foreign: Foreign | None = None
    extends: tuple[str, ...] = ()
    values: dict[str, Value] = field(default_factory=dict)
    approximation: Approximation | None = None

    @property
    def effect(self) -> Effect | None:
        """The first of its effects; None without one."""
        return self.effects[0] if self.effects else None

    def effect_of(self, attaches: str, old: str = "") -> Effect | None:
        """Its effect that attaches in a way, or that takes the place of the component `old`; None without one."""
        return next((e for e in self.effects if attaches in e.attaches or old in e.replaces), None)

    def is_a(self, kind: str) -> bool:
        """Whether it is the component of that name, or extends it."""
        return kind == self.name or kind in self.extends

    def in_diagram(self, formula: Formula, path: str) -> str:
        """A formula of the component in the names of the diagram, where the component is the part `path`."""
        names = (*self.parameters, *self.variables, *self.signals, *self.ports, *self.body.instances)
        known = {name.partition("[")[0] for name in names}
        return _FIRST_WORD.sub(lambda m: f"{path}.{m[0]}" if m[0] in known else m[0], formula.text)

    def signal(self, name: str) -> SignalPort | None:
        """The signal of that name, of a vector (`u`, `u[2]`) the whole one or its first element."""
        base = name.partition("[")[0]
        return next((self.signals[n] for n in (name, base, f"{base}[1]", f"{base}[1][1]") if n in self.signals), None)

    @property
    def signal_names(self) -> tuple[str, ...]:
        """The names of its signals, a vector by one name."""
        return tuple(dict.fromkeys(name.partition("[")[0] for name in self.signals))

    @property
    def unknowns(self) -> dict[str, Variable]:
        """The variables that its equations decide."""
        return {name: variable for name, variable in self.variables.items() if variable.held is None}

    @property
    def delayed(self) -> dict[str, Delayed]:
        """The variables that are delayed ones."""
        return {name: variable.delayed for name, variable in self.variables.items() if variable.delayed is not None}

    @property
    def held(self) -> dict[str, Variable]:
        """The variables that only events change."""
        return {name: variable for name, variable in self.variables.items() if variable.held is not None}

    @property
    def orders(self) -> tuple[tuple[str, str], ...]:
        """Pairs of parameters of which the first must not be below the second (`requires: [x_max > x_min]`)."""
        found = []
        for formula in self.requires:
            tree = formula.tree
            if isinstance(tree, Compare) and isinstance(tree.left, Name) and isinstance(tree.right, Name):
                ends = (tree.left.text, tree.right.text)
                found.append(ends if tree.op in (">", ">=") else ends[::-1])
        return tuple(found)

    @cached_property
    def widths(self) -> frozenset[str]:
        """The parameters that are widths of regularised laws: that over which `smooth_sign` and `signed_sqrt` turn."""
        return frozenset(width for line in self.equations for side in (line.tree.left, line.tree.right)
                         for width in _widths(side))

    @property
    def composite(self) -> bool:
        """Whether it is made of other components."""
        return bool(self.body.instances)


def _widths(expr: Expr) -> Iterator[str]:
    """The names of second arguments of regularised laws."""
    if isinstance(expr, Call) and expr.function in REGULARISED and isinstance(expr.args[1], Name):
        yield expr.args[1].text
    for child in (*children(expr), *(inside(expr) if isinstance(expr, FunctionCall) else ())):
        yield from _widths(child)
