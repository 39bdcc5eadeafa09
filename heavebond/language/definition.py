"""Definitions of components, domains and parts of diagrams: frozen values, each with its place in a file."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

from heavebond.core.errors import Place
from heavebond.core.units import Range, Unit
from heavebond.records.time_axis import TimeAxis
from heavebond.text.expression import (
    Call,
    Compare,
    Equation,
    Expr,
    FunctionCall,
    Name,
    children,
    inside,
    names,
    parse_formula,
)

REGULARISED = ("smooth_sign", "signed_sqrt")  # functions whose second argument is the width of their transition


@dataclass(frozen=True)
class Member:
    """One variable of a port: its unit, its usual size (for scaling; `sized` is True if the domain declares one), its
    lower limit, and its guess in the search for a start. Below `physical` its laws are not valid; `beyond` describes
    the state there and the remedy. No machine has a value larger than `largest`. `noun` is its name in a sentence."""

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
    """The kind of a wire: `across` variables are shared at a node, `through` variables sum to zero. Power is the sum of
    effort times flow over the pairs of `efforts` and `flows` (three in planar mechanics), or the one variable `power`;
    in mechanics the flows are the rates of the `positions`. `effort`, `flow` and `position` are the variables of a
    domain with one pair, else None. `reference` is the component that represents the surroundings: the ground, a tank.
    `medium` is the component that sets the fluid of a circuit; `fills` is the component, with its settings, that is
    added to a node without storage if a run fails without it. If the effort is `relative`, as a voltage, only its
    differences have a meaning, and its zero is at the ground. Lines are drawn in `colour`, areas in `pale`. Components
    in `determined_by` fix the shared variable of a node; a `compliance` removes a rigid loop.

    `vectors` are lists of members by a common name. The `orientation` of a node is a unit quaternion, of which the vector
    `turning` is the angular velocity (empty in other domains). The component `free` is added to a node whose orientation no
    part determines, for a linearisation `minimal`, and `idle` if no law depends on the orientation."""

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
    vectors: dict[str, tuple[str, ...]] = field(default_factory=dict)
    orientation: tuple[str, ...] = ()
    turning: str = ""
    free: str = ""
    minimal: str = ""
    idle: str = ""

    @property
    def shared(self) -> tuple[str, ...]:
        """The variables that all ports on a node share: across variables, positions and orientation."""
        return (*self.across, *self.positions, *self.orientation)

    @property
    def effort(self) -> str | None:
        return self.efforts[0] if len(self.efforts) == 1 else None

    @property
    def flow(self) -> str | None:
        return self.flows[0] if len(self.flows) == 1 else None

    @property
    def position(self) -> str | None:
        return self.positions[0] if len(self.positions) == 1 else None

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """Each effort with its flow."""
        return tuple(zip(self.efforts, self.flows, strict=True))

    def rate(self, position: str) -> str:
        """The flow that is the rate of a position."""
        return self.flows[self.positions.index(position)]

    def role(self, member: str) -> str:
        """Name of the domain's member for `effort` or `flow` of a generic port."""
        generic = {"effort": self.effort, "flow": self.flow, "position": self.position}
        return generic.get(member) or member


@dataclass(frozen=True)
class Port:
    """A power port. `domain` may be `$D` (taken from the connected node); `count` makes it an array."""

    name: str
    domain: str
    place: Place
    doc: str = ""
    count: Expr | None = None


@dataclass(frozen=True)
class SignalPort:
    """A directed signal, `direction` in or out; `count` makes it a vector, with `columns` a matrix. An input with a
    `default` need not be connected."""

    name: str
    direction: str
    unit: Unit
    place: Place
    doc: str = ""
    count: Expr | None = None
    columns: Expr | None = None
    default: Value | None = None


@dataclass(frozen=True)
class Value:
    """A number with its unit or a formula, as written in a diagram. `si`: a plain Python number in SI; `file`: the file
    whose column contains the value."""

    expr: Expr
    text: str
    place: Place
    formula: bool = False
    si: bool = False
    file: Path | None = None


@dataclass(frozen=True)
class FileInput:
    """A signal given by a column of a measured file; `interpolation` is spline, linear or hold.

    `file` is `Path()` for the record of the experiment. `time` gives the times of its rows (None: the times of the
    record, or in a diagram the first column in s). `bridge`: interpolate across gaps. `zero` is the file, with its
    times, whose first row is the zero of clock times, if it is another file. `factor` multiplies the readings. `noise`
    is the standard deviation of its white noise, in `unit` (0: unknown); `seed` selects a realisation of this noise that
    is added to the readings; `smooth` is the frequency in Hz above which a smoothing spline attenuates by more than
    half.
    """

    file: Path
    column: str
    unit: str
    interpolation: str
    place: Place
    time: TimeAxis | None = None
    bridge: bool = False
    zero: tuple[Path, TimeAxis] | None = None
    factor: float = 1.0
    noise: float = 0.0
    seed: int | None = None
    smooth: float | None = None


@dataclass(frozen=True)
class SearchRange:
    """Range in which a number of an effect is sought: a given range, or the range of the component's variable `seen`
    while a record is simulated. A `held` number is not sought: it is fixed at the middle of that motion, at half its
    span or at its peak (see HELD). Scores are computed within the part `scored` of a given range (None: the whole)."""

    range: Range | None
    seen: str
    place: Place | None = None
    held: str = ""
    scored: Range | None = None


HELD = ("middle", "half", "peak")


@dataclass(frozen=True)
class Meaning:
    """A sentence of physics about an effect: `texts` with a field between each pair. A field is a name (`part`, `place`,
    a port or a parameter) or a formula of the component's parameters."""

    texts: tuple[str, ...]
    fields: tuple[str | Expr, ...]
    place: Place


@dataclass(frozen=True)
class Typical:
    """Usual range of a parameter, with its source; without a range, `source` is the quantity to which an engineer
    compares the value."""

    range: Range | None
    source: str


@dataclass(frozen=True)
class Effect:
    """A component as a candidate for a missing effect: an entry of the catalogue.

    kind: class of the effect, equal for all its laws; attaches: permitted places (see ATTACHES); amplitude: parameters
    that are zero if the effect is absent (None), or that have no such value and are sought within a range; shapes: the
    other parameters that are sought; also: further ports and the domain on whose nodes they are tried; replaces: the
    components that it replaces, with `start` giving its parameters as formulas of the `old` one: an amplitude under
    `start` is absent at that value instead of zero; settled: variables (`v`) and rates (`der(v)`) that are zero at the
    start of a record if the record leaves them open, because the machine runs already; begins: parameters of the state at
    the start of a record, each with the range in which it is sought separately for every record; meaning: a sentence on the
    effect with its values; requires: kinds of components of which one must be on the node of a port, kinds
    after EXCLUDES of which none may be, or that a variable REVERSES in the records; acts: a quantity that is above zero
    while the effect acts; partly: True if it must also be idle for a part of the records (PARTLY before `acts`);
    varies_with: for the factor of a parameter, the kind of its input (see VARIES_WITH).
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
    begins: dict[str, SearchRange] = field(default_factory=dict)
    partly: bool = False


PARTLY = "partly "  # `acts:` of a law with a limit: it must act in a part of the records and be idle in another
REVERSES = "reverses"  # `requires:` of a variable: that it moves in both directions
EXCLUDES = "no "  # `requires:` of a port: before a kind of component that must not be on its node

# between two nodes; on a node; between a port and its node; before a signal input; behind a measured output; as the factor
# of a part's parameter
ATTACHES = ("across", "at", "in series", "input", "channel", "parameter")
# inputs of a factor: a variable of its part that changes its sign, any variable of its part, the time, a time
VARIES_WITH = ("rate", "variable", "time", "instant")
FACTOR = "factor"  # the variable of a component that is the factor of a parameter


@dataclass(frozen=True)
class Parameter:
    """A constant of a component, or with `count` a list of them, with `columns` a matrix; bounds and default in SI.

    `neutral` is the value at which an effect is absent. Such a parameter is a dormant effect of the class `kind`; when it
    is active it is `sought` within a range, together with the parameters that it `wakes_with`; `meaning` describes the
    effect with its value. `medium` names the parameter of the circuit's medium that is the default. An `instant` is a
    time at which something begins or changes; it is independent of the beginning of a record. A `width` is the width of a
    transition that makes a law smooth: results should not depend on it. A width in the unit of a speed belongs to dry
    friction near rest. An `interval` is a difference or an amplitude, which has no origin, of a quantity in any unit.
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
    interval: bool = False


def rate_of(text: str) -> str | None:
    """The variable of which `der(v)` is the rate; None for any other text."""
    rate_match = re.fullmatch(r"der\((.+)\)", text)
    return rate_match[1] if rate_match is not None else None


@dataclass(frozen=True)
class Variable:
    """An inner unknown of a component, or with `count` a list or matrix of them. `start` is its guess without other
    information, `nominal` its typical size if it differs from the usual size of its unit. A run ends if it falls below
    its `physical` limit; `beyond` describes the state there and a component that models it.

    With `held`, its initial value, it is not an unknown: it is constant between events, and only events change it. With
    `delayed` source and delay, if it is another variable at an earlier time, and no equation of the component determines it.
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
    """The component `kind` without history that replaces one with delayed variables, if the whole number `order` is above
    0 and in computations that keep no history."""

    kind: str
    order: str
    place: Place


@dataclass(frozen=True)
class CircuitRule:
    """What a component requires of the circuit of its `port`, the nodes of the same domain that parts connect: no parts of
    the kinds `excludes`, and one node for the port `shares` of all parts with the same rule. `advice` is the remedy."""

    port: str
    shares: str
    excludes: tuple[str, ...]
    advice: str


@dataclass(frozen=True)
class EquationLine:
    """One equation with its name (the `#` comment) and its place in the file; `each` is (index, low, high) or None."""

    tree: Equation
    text: str
    label: str
    place: Place
    each: tuple[str, Expr, Expr] | None = None


@dataclass(frozen=True)
class Formula:
    """An expression of a component other than an equation (stores, dissipates, a requirement)."""

    tree: Expr
    text: str
    place: Place


@dataclass(frozen=True)
class Point:
    """A point in space: its coordinates in m, along the axes of `frame` from its origin, or of the fixed frame if `frame` is
    empty. Without coordinates it is the origin."""

    frame: str
    coordinates: tuple[Formula, ...]
    place: Place


@dataclass(frozen=True)
class ViewShape:
    """A shape: its kind, its places and sizes as formulas (pairs are x to the right and y upwards, in m; `turned` is an
    angle), its colour and its text.

    `spatial` is True for a shape in space, False for a shape in a plane, None for a shape in either. In space `points` are
    its places, and `size`, `turned`, `axis` and `vector` have three formulas, or one vector formula. `file` is the file of a
    mesh.
    """

    name: str
    kind: str
    formulas: dict[str, tuple[Formula, ...]]
    colour: str
    label: str
    place: Place
    spatial: bool | None = False
    points: dict[str, Point] = field(default_factory=dict)
    file: Path | None = None

    @property
    def all_formulas(self) -> tuple[Formula, ...]:
        """The formulas of its sizes and places."""
        return (*(f for part in self.formulas.values() for f in part),
                *(f for point in self.points.values() for f in point.coordinates))

    def placed(self, path: str, component: Component) -> ViewShape:
        """The shape of a component in the names of the diagram, for its part `path`."""
        own = {re.split(r"[.\[]", name)[0] for name in (*component.parameters, *component.variables, *component.signals,
                                                        *component.ports, *component.body.instances)}

        def formula(old: Formula) -> Formula:
            return renamed(old, lambda name: f"{path}.{name}" if re.split(r"[.\[]", name)[0] in own else name)

        points = {key: Point(f"{path}.{point.frame}" if point.frame else "", tuple(map(formula, point.coordinates)),
                             point.place) for key, point in self.points.items()}
        return replace(self, name=f"{path}.{self.name}", points=points,
                       formulas={key: tuple(map(formula, part)) for key, part in self.formulas.items()})


def renamed(formula: Formula, new_name: Callable[[str], str]) -> Formula:
    """A formula with other names."""
    text = formula.text
    for name in sorted(names(formula.tree), key=lambda n: -n.column):
        text = text[:name.column] + new_name(name.text) + text[name.column + name.length:]
    return Formula(parse_formula(text), text, formula.place)


@dataclass(frozen=True)
class FrameRelation:
    """How the frame of port `b` follows from that of port `a`, or without `a` from the fixed frame. All formulas are in the
    axes of `a`: `turn`, the unit quaternion of its rotation, with the angular velocity `spin`; `shift`, the vector to its
    origin, with the rate `speed`. Without `turn` the orientations, without `shift` the positions are not related; without
    `spin` or `speed` they are derivatives."""

    a: str
    b: str
    turn: Formula | None
    spin: Formula | None
    shift: Formula | None
    speed: Formula | None
    place: Place

    @property
    def formulas(self) -> tuple[tuple[str, Formula, int], ...]:
        """The key, the formula and the length of each of its vectors."""
        known = (("turn", self.turn, 4), ("spin", self.spin, 3), ("shift", self.shift, 3), ("speed", self.speed, 3))
        return tuple((key, formula, length) for key, formula, length in known if formula is not None)

    @property
    def rank(self) -> int:
        """The number of independent equations between both frames."""
        return 3*(self.turn is not None) + 3*(self.shift is not None)


@dataclass(frozen=True)
class Reset:
    """Assignment of an event or of the start: a held variable or a state, `target` with its place in the file, and its new
    value."""

    target: Formula
    value: Formula

    @property
    def steady(self) -> bool:
        """Whether the derivative of a state is to be zero at the start."""
        return self.value.text == "steady"


@dataclass(frozen=True)
class EventDefinition:
    """An event of a component: it occurs when `condition` becomes true, at the instant `at`, or periodically with the
    period `every` from `first` on (None: from 0). `key` is the keyword of these in the file. `impulse` is the held
    variable whose impulse changes the target that is not held (empty: the target is set). With `moves`, the name of a
    speed, it is the breakaway of a contact, and occurs only if that speed changes by it; else `otherwise` is set. It does
    not occur at an instant at which an event occurs that it `yields_to`."""

    name: str
    key: str
    formula: Formula
    first: Formula | None
    resets: tuple[Reset, ...]
    place: Place
    impulse: str = ""
    moves: str = ""
    otherwise: tuple[Reset, ...] = ()
    yields_to: tuple[str, ...] = ()


@dataclass(frozen=True)
class Transition:
    """A transition between two states: it happens if the source has been active for the time `after` and `when` holds."""

    source: str
    target: str
    when: Formula | None
    after: Formula | None
    place: Place

    @property
    def event(self) -> str:
        """The name of its event."""
        return f"{self.source}_to_{self.target}"

    @property
    def text(self) -> str:
        """`button > 0.5 after T`."""
        words = [self.when.text] if self.when is not None else []
        return " ".join([*words, *([f"after {self.after.text}"] if self.after is not None else [])])


@dataclass(frozen=True)
class ChartState:
    """A named state of a component: what it sets on entry, and the transitions that leave it, the first one first."""

    name: str
    place: Place
    doc: str = ""
    entry: tuple[Reset, ...] = ()
    transitions: tuple[Transition, ...] = ()

    def entry_of(self, name: str) -> Reset | None:
        """What it sets an output or a held variable to on entry."""
        return next((reset for reset in self.entry if reset.target.text == name), None)


@dataclass(frozen=True)
class Instance:
    """A component in a diagram or a block: its kind, its settings, and the other parts, with their places, from which it
    takes missing parameters."""

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
class PartPlace:
    """The exact place of a part in the drawing, in steps of the grid, with its clockwise rotation in degrees (None: chosen
    by the layout) and whether its picture is mirrored."""

    x: int
    y: int
    turn: int | None = None
    mirrored: bool = False


@dataclass(frozen=True)
class Note:
    """A text on the drawing, with the place of its upper left corner."""

    text: str
    x: int
    y: int


@dataclass(frozen=True)
class Layout:
    """Exact places of parts, pieces (x1, y1, x2, y2) that the wire of a node contains, and notes; all in steps of the
    grid."""

    parts: dict[str, PartPlace] = field(default_factory=dict)
    wires: dict[str, tuple[tuple[int, int, int, int], ...]] = field(default_factory=dict)
    notes: dict[str, Note] = field(default_factory=dict)


@dataclass(frozen=True)
class Body:
    """Instances and the wires between them; `inside` are parts of blocks by their paths (`ahc.pump`) that are replaced."""

    instances: dict[str, Instance] = field(default_factory=dict)
    wires: dict[str, Wire] = field(default_factory=dict)
    inside: dict[str, Instance] = field(default_factory=dict)
    layout: Layout = field(default_factory=Layout)


@dataclass(frozen=True)
class ForeignVariable:
    """A variable of an FMU: its `name` in the component, its name in the FMU, type and value reference. The SI value is
    scale * value + offset. An array of the FMU has one variable for each element, in order: `element` of `size`. `clocks`
    are the value references of the clocks at whose ticks it is computed."""

    name: str
    own: str
    type: str
    reference: int
    scale: float = 1.0
    offset: float = 0.0
    element: int = 0
    size: int = 1
    clocks: tuple[int, ...] = ()


@dataclass(frozen=True)
class ForeignClock:
    """An input clock of an FMU with known or calculated instants: its name, value reference, interval in s, and first tick
    after the start in s. Of a `calculated` clock the FMU computes each interval, of a `countdown` the time to the next
    tick."""

    own: str
    reference: int
    interval: float
    shift: float
    calculated: bool = False
    countdown: bool = False


@dataclass(frozen=True)
class Foreign:
    """The FMU behind a component: its file, inputs and outputs. `has_solver` is false for an FMU for model exchange.
    `clocks` are its input clocks that tick by themselves, `output_clocks` the value references of the clocks that it
    activates in events; the triggered input clocks are inputs of the type Clock. `idle_clocks` name input clocks that never
    tick."""

    path: Path
    identifier: str
    inputs: tuple[ForeignVariable, ...]
    outputs: tuple[ForeignVariable, ...]
    parameters: tuple[ForeignVariable, ...]
    has_solver: bool = True
    clocks: tuple[ForeignClock, ...] = ()
    idle_clocks: tuple[str, ...] = ()
    output_clocks: tuple[int, ...] = ()

    @property
    def has_events(self) -> bool:
        """True if a clock needs the event mode of the FMU."""
        return bool(self.clocks or self.output_clocks or any(v.type == "Clock" for v in self.inputs))


_FIRST_WORD = re.compile(r"(?<![\w.])[A-Za-z_]\w*")  # of a name in a formula


@dataclass(frozen=True)
class Component:
    """A component file: ports, parameters, variables, equations and, for a block, its parts.

    `sliding` are values for linearisation while dry friction slides, for laws whose slope at rest is not a width.
    `symbol` names its picture in drawings; without one it is drawn as a box. `foreign` is the FMU that sets its held
    variables. `states` are those of its state machine; `variables`, `equations` and `when` contain them written out.
    `extends` names the components whose laws it has, with other values, the nearest first; `values` are the values of the
    elements of its lists.
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
    frames: tuple[FrameRelation, ...] = ()
    initial: tuple[Reset, ...] = ()  # states at the start, if the diagram does not give them
    travel_time: Formula | None = None  # travel time of a wave through a segment of a line
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
    placeholder: str = ""  # reason of a missing law: a placeholder for something that was not translated
    units_checked: bool = True  # False: the equations relate numbers in SI, as in an imported component
    foreign: Foreign | None = None
    extends: tuple[str, ...] = ()
    values: dict[str, Value] = field(default_factory=dict)
    approximation: Approximation | None = None
    circuit: CircuitRule | None = None
    states: tuple[ChartState, ...] = ()
    view: dict[str, ViewShape] = field(default_factory=dict)  # its shapes in an animation of a diagram without `view:`

    @property
    def effect(self) -> Effect | None:
        """The first of its effects; None without one."""
        return self.effects[0] if self.effects else None

    def effect_of(self, attaches: str, old: str = "") -> Effect | None:
        """Its effect with this way of attaching, or that replaces the component `old`; None without one."""
        return next((e for e in self.effects if attaches in e.attaches or old in e.replaces), None)

    def is_a(self, kind: str) -> bool:
        """True if it is the component of that name, or extends it."""
        return kind == self.name or kind in self.extends

    def in_diagram(self, formula: Formula, path: str) -> str:
        """Rewrite a formula of the component in the names of the diagram, for the part `path`."""
        names = (*self.parameters, *self.variables, *self.signals, *self.ports, *self.body.instances)
        known = {name.partition("[")[0] for name in names}
        return _FIRST_WORD.sub(lambda m: f"{path}.{m[0]}" if m[0] in known else m[0], formula.text)

    def signal(self, name: str) -> SignalPort | None:
        """The signal of that name; for a vector (`u`, `u[2]`) the whole one or its first element."""
        base = name.partition("[")[0]
        return next((self.signals[n] for n in (name, base, f"{base}[1]", f"{base}[1][1]") if n in self.signals), None)

    @property
    def signal_names(self) -> tuple[str, ...]:
        """Names of its signals; a vector has one name."""
        return tuple(dict.fromkeys(name.partition("[")[0] for name in self.signals))

    @property
    def unknowns(self) -> dict[str, Variable]:
        """The variables that its equations determine."""
        return {name: variable for name, variable in self.variables.items() if variable.held is None}

    @property
    def delayed(self) -> dict[str, Delayed]:
        return {name: variable.delayed for name, variable in self.variables.items() if variable.delayed is not None}

    @property
    def held(self) -> dict[str, Variable]:
        """The variables that only events change."""
        return {name: variable for name, variable in self.variables.items() if variable.held is not None}

    @property
    def orders(self) -> tuple[tuple[str, str], ...]:
        """Pairs of parameters whose first must not be below the second (`requires: [x_max > x_min]`)."""
        pairs = []
        for formula in self.requires:
            tree = formula.tree
            if isinstance(tree, Compare) and isinstance(tree.left, Name) and isinstance(tree.right, Name):
                ends = (tree.left.text, tree.right.text)
                pairs.append(ends if tree.op in (">", ">=") else ends[::-1])
        return tuple(pairs)

    @cached_property
    def widths(self) -> frozenset[str]:
        """The parameters that are widths of regularised laws: second arguments of `smooth_sign` and `signed_sqrt`."""
        return frozenset(width for line in self.equations for side in (line.tree.left, line.tree.right)
                         for width in _widths(side))

    @property
    def composite(self) -> bool:
        return bool(self.body.instances)


def _widths(expr: Expr) -> Iterator[str]:
    """The names of second arguments of regularised laws."""
    if isinstance(expr, Call) and expr.function in REGULARISED and isinstance(expr.args[1], Name):
        yield expr.args[1].text
    for child in (*children(expr), *(inside(expr) if isinstance(expr, FunctionCall) else ())):
        yield from _widths(child)
