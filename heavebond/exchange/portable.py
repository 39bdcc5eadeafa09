"""A diagram as explicit equations for export: x' = f(t, x, z, p, u), 0 = g(t, x, z, p, u), y = h(t, x, z, p, u).

All values are in SI except the outputs y, which are the outputs under `show:` in their units. The inputs u are the
measured signals of the diagram and the signal inputs that are opened; if an equation needs it, the rate of an input is an
input too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import factorial, inf
from pathlib import Path

import casadi as ca
import numpy as np

from heavebond.core.errors import HeavebondError, ModelError, Place, Problem, UsageError, listing, suggest
from heavebond.core.presentation import brief, count
from heavebond.core.units import Unit, declared_unit, dimension_text, read_unit, times, unit
from heavebond.equations.events import FlatEvent, Held
from heavebond.equations.flatten import DelayedVariable, unclocked
from heavebond.equations.parameters import with_declaration
from heavebond.equations.reduce import reduce
from heavebond.equations.resolver import Unknown
from heavebond.equations.time_conditions import NEVER
from heavebond.language.definition import FileInput
from heavebond.language.model import Model
from heavebond.language.sections import Setting
from heavebond.language.symbols import split, stack
from heavebond.language.values import bounds_text
from heavebond.numerics.co_simulation import foreign_parts
from heavebond.numerics.dae import DELAY_ROWS, Array, Assembly, Size, assemble, build, from_begin, measured_rows
from heavebond.numerics.forcing import Forcing, switch_arguments
from heavebond.numerics.impulses import yielding
from heavebond.numerics.initialise import Start, held_still, start
from heavebond.numerics.inputs import pieced
from heavebond.numerics.jumps import differentiated
from heavebond.numerics.matrices import null_space, scaled
from heavebond.numerics.newton import weights
from heavebond.numerics.output_times import grid, largest_step_of
from heavebond.numerics.physical_limits import limited
from heavebond.numerics.result import signal_expression
from heavebond.numerics.simulator import Simulator
from heavebond.numerics.start_equations import INITIALISATION, Point, StartEquations
from heavebond.numerics.time_search import rounding

AT_ONCE = 1e-6  # s; only the beginning of the records is needed
DERIVED = ("scale.", "initial.", "history.")  # these are parameters of a run, not of the machine
MOST_INSTANTS = 500  # limit of instants of an export
LEVELS = (0.0, -1.0, 1.0, -4.0, 4.0)  # values of a linear expression in an exponential or a power


@dataclass(frozen=True)
class Quantity:
    """A state, parameter, input or output: its name, unit, value at the start (in that unit) and bounds (SI)."""

    name: str
    unit: Unit
    start: float
    doc: str = ""
    low: float = -inf
    high: float = inf
    nominal: float = 1.0


@dataclass(frozen=True)
class StartConditions:
    """The conditions of the start, for values that are set before it: `conditions` is (t, x, z, p, u) -> (residuals,
    their gradients by rows, the same of the guesses, the guesses of x and z). The unknowns are x, z and the parameters
    `solved_for`, of the usual `sizes`. `by_parameters` and `by_inputs` are the values on which the start depends,
    `of_states` the parameters that hold the specified values of the states (-1 for a state without); `square` is True if
    its conditions determine all unknowns."""

    conditions: ca.Function
    solved_for: tuple[int, ...]
    sizes: tuple[float, ...]
    by_parameters: tuple[bool, ...]
    by_inputs: tuple[bool, ...]
    of_states: tuple[int, ...]
    square: bool

    @property
    def follows(self) -> bool:
        """True if the start depends on any settable value."""
        return any((*self.by_parameters, *self.by_inputs))


@dataclass(frozen=True)
class Rule:
    """The admissible values (SI) of a quantity that follows from parameters: with `low` and `high`, a message is `text`, the
    value and `rest`. A requirement of a component has the value 1 if it is met, and no `rest`."""

    low: float
    high: float
    text: str
    rest: str = ""


@dataclass(frozen=True)
class Portable:
    """The exported equations: `equations` is (t, x, z, p, u) -> (x', y, g, dg/dz by rows), `directions` (t, x, z, p, u and a
    direction of each) -> the directional derivative of (x', y, g, indicators), and `jacobian` (t, x, z, p, u) -> the
    derivatives of (x', g) by (x, z), by rows, and by t. `parameters` are all entries of p; `tunable` is True
    for those that the user may change.

    For events, `happenings` is (t, x, z, p, u) -> (indicators of the conditions; quantities that must not jump at
    events, because the equations contain their derivatives; accelerations of the contacts that may break away). `sizes`
    are the usual sizes of the quantities that must not jump. `updates` (t, x, z, p, u, 1 for each active event) -> new
    values of all resets (see `numerics.update_order`), and `instants` p -> (first instants, periods). `stops` is p ->
    the instants at which an integrator stops for functions of time; `limits` (t, x, z, p, u) -> the distance of the
    variables `limited` from their physical limits, and the time; `histories` (t, x, z, p, u) -> (sources of the delayed
    variables, their delays); `allowed` p -> the values that have `rules`. After the inputs, u has the rows of each delayed
    variable (see `substitute_inputs`) and, with delays, the time of the begin: t then counts from it, so that their history
    is not rounded far from 0."""

    assembly: Assembly
    states: tuple[Quantity, ...]
    algebraic: tuple[Quantity, ...]
    parameters: tuple[Quantity, ...]
    tunable: tuple[bool, ...]
    inputs: tuple[Quantity, ...]
    outputs: tuple[Quantity, ...]
    equations: ca.Function
    directions: ca.Function
    jacobian: ca.Function
    happenings: ca.Function
    updates: ca.Function
    instants: ca.Function
    sizes: tuple[float, ...]
    starting: StartConditions
    limits: ca.Function
    histories: ca.Function
    allowed: ca.Function
    rules: tuple[Rule, ...]

    def __repr__(self) -> str:
        return brief(self, self.name, f"{count(len(self.states), 'state')}, {count(len(self.inputs), 'input')}, "
                     f"{count(len(self.outputs), 'output')}, {count(sum(self.tunable), 'parameter')}")
    stops: ca.Function | None = None
    locals: int = 0  # number of the last outputs, which an FMU describes as local variables

    @property
    def events(self) -> tuple[FlatEvent, ...]:
        """The events, in the order of `instants`."""
        return tuple(self.assembly.flat.events)

    @property
    def limited(self) -> tuple[Unknown, ...]:
        """The variables with a physical limit, in the order of `limits`."""
        return limited(self.assembly).unknowns

    @property
    def held(self) -> dict[int, Held]:
        """The variables that events hold, by their entry in the parameters."""
        return {held.index: held for held in self.assembly.flat.held}

    @property
    def delays(self) -> tuple[DelayedVariable, ...]:
        """The delayed variables, in the order of `histories`."""
        return tuple(self.assembly.flat.delays)

    @property
    def at_start(self) -> tuple[float, Array, Array, Array, Array]:
        """The arguments (t, x, z, p, u) of the functions at the start of the run."""
        x, z, p, u = (np.array([q.start for q in group], float)
                      for group in (self.states, self.algebraic, self.parameters, self.inputs))
        return self.assembly.begin, x, z, p, np.concatenate([u, np.zeros(self.equations.numel_in(4) - len(u))])

    @property
    def integrated(self) -> bool:
        """True if the export contains an integrator, which events, delays and a longest step need."""
        return bool(self.events or self.delays or largest_step_of(self.assembly.model))

    @property
    def name(self) -> str:
        """The name of the diagram."""
        return self.assembly.model.name


def portable(model: Model, inputs: Iterable[str] = (), prefix: str = "", *, events: bool = False, locals: Iterable[str] = ()
             ) -> Portable:
    """The equations of a diagram, started by its initial conditions, with the signal inputs `inputs` opened; the names of
    the functions begin with `prefix`.

    The sources of these inputs in the diagram give their values at the start only. `locals` are variables that follow the
    outputs, in SI. Unless `events`, a diagram whose only
    events are comparisons with the time has none in its equations. Raises UsageError for an unknown input, ModelError for
    a diagram with FMUs.
    """
    wanted = list(dict.fromkeys(inputs))
    assembly = assemble(replace(model, ends=None))  # the program that runs it decides the end of a run
    sizes = _sizes(assembly)
    assembly, column = opened(assembly, wanted) if wanted else (assembly, _measured(assembly))
    if parts := foreign_parts(assembly.flat):
        raise ModelError([Problem("export-fmu", f"a diagram with an FMU in it cannot be exported: {listing(parts, 3)}",
                                  assembly.flat.expanded.leaves[next(iter(parts))].place, "Remove the FMU, and make the "
                                                                                          "signals that it drives inputs "
                                                                                          "(`--input`).")])
    if not events and assembly.flat.events and all(event.by_clock for event in assembly.flat.events):
        assembly = build(reduce(unclocked(assembly.flat)))
    events = events or bool(assembly.flat.events or assembly.flat.delays or largest_step_of(assembly.model))
    for clock in assembly.model.clocks.values():
        raise ModelError([Problem("export-clock", f"an export has regular clocks; {clock.text}", clock.place,
                                  "Export a variant without `clocks:`, or let the importing program make the jitter.")])
    if any(event.impulse for event in assembly.flat.events) and (turned := yielding(assembly.reduced)):
        raise ModelError([Problem("export-impact", f"an impact may set off {listing(turned, 3)} at once, which FMUs and C "
                                  "programs do not support",
                                  next(e.place for e in assembly.flat.events if e.impulse),
                                  "Remove friction that sticks (DryFriction) and further stops, or take elastic ones "
                                  "(EndStop).")])
    assembly = assembly.with_sizes(sizes) if sizes else assembly
    # time events that set nothing, at the instants at which functions of time have kinks or fast transitions
    forcing: Forcing = assembly.once("forcing", lambda: Forcing(assembly))
    if not forcing.parts:
        stops = []
    else:
        time, p = assembly.arguments[0], assembly.arguments[3]
        x = start(assembly, None, column).x if forcing.follows_states else None
        roots = _roots(forcing.parts_from(assembly.begin, x), time)
        known = np.array(ca.Function("known", [p], [stack(roots)])(assembly.p)).ravel()
        if assembly.model.until is not None:  # instants without a formula, with the parameters of the diagram
            times = forcing.stops(grid(assembly.model, None, None), assembly.p, x).times
            near = np.abs(times[:, None] - known[None, :]).min(axis=1, initial=np.inf) <= 4 * rounding(times)
            roots += [ca.SX(t) for t in times[~near].tolist()]
        place = next(iter(assembly.flat.expanded.leaves.values())).place
        stops = [FlatEvent(f"stop_{k}", "stop", place, None, root, None, ())
                 for k, root in enumerate(roots[:MOST_INSTANTS], 1)]
    if events and stops:
        flat = replace(assembly.flat, events=(*assembly.flat.events, *stops), options=None)
        assembly = replace(assembly, reduced=replace(assembly.reduced, flat=flat), memo={})
    instants = ca.Function(f"{prefix}stops", [assembly.arguments[3]], [ca.densify(stack(e.first for e in stops))])
    return replace(_portable(assembly, column, prefix, tuple(locals)), stops=instants)


def _sizes(assembly: Assembly) -> Mapping[str, Size]:
    """The sizes of unknowns that stay far below their nominal ones, or move little about a large value, in a run of the
    diagram (see `numerics.sizes`); none without `until:`, or if the run fails."""
    if assembly.model.until is None or foreign_parts(assembly.flat):
        return {}
    try:
        return Simulator(assembly).run().assembly.sizes
    except HeavebondError:
        return {}


# -- inputs ----------------------------------------------------------------------------------------------------------
def _measured(assembly: Assembly) -> Array:
    """The column of measured inputs at the start."""
    return pieced(assembly.flat, assembly.begin, assembly.begin + AT_ONCE).at(np.array([assembly.begin]))[:, 0]


def opened(before: Assembly, wanted: list[str]) -> tuple[Assembly, Array]:
    """The diagram with opened signal inputs, and the column of inputs at the start in the form for `Assembly`."""
    flat, settings = before.flat, dict(before.model.settings)
    free = [f"{path}.{n}" for path, leaf in flat.expanded.leaves.items()
            for n, s in leaf.component.signals.items() if s.direction == "in"]
    for path in wanted:
        if path not in free:
            hint = suggest(path, free) or (f"Signal inputs: {listing(free)}." if free else "It has no signal inputs.")
            raise UsageError([Problem("input-unknown", f"the diagram has no signal input '{path}'", None, hint)])
        place = Place(f"input {path}", 1, 1, path)
        text = flat.unknowns[flat.names[path]].unit.text
        settings[path] = Setting(path, FileInput(Path(), path, text, "spline", place), place)
    assembly = assemble(replace(before.model, settings=settings))
    # (t, c0..c3 of each input) at the start: the values of the inputs in the diagram, and their rates
    measured = _measured(before)
    first = start(before, None, measured)
    column = np.zeros(assembly.arguments[4].numel())
    column[0] = before.begin
    t, x, z, _, _, rate = before.arguments
    for k, known in enumerate(assembly.flat.inputs):
        course = before.express(before.flat.levels[0][before.flat.names[known.name]])
        for order in range(4):
            value = ca.Function("c", list(before.arguments), [course])(first.t, first.x, first.z, first.p, measured, 1.0)
            column[1 + 4 * k + order] = float(value) / factorial(order)
            if z.numel() and ca.which_depends(course, z, 1, False)[0]:
                break  # its rate depends on a loop; the new input begins at rest
            course = ca.jtimes(course, stack([x, t]), stack([before.ode, rate]))
    return assembly, column


# -- equations -------------------------------------------------------------------------------------------------------
def _portable(assembly: Assembly, column: Array, prefix: str, locals: Sequence[str] = ()) -> Portable:
    flat, first = assembly.flat, start(assembly, None, column)
    t, x, z, p, pieces, rate = assembly.arguments
    output_names = list(assembly.model.show) or assembly.state_names
    for name in locals:
        if name not in flat.names:
            raise UsageError([Problem("local-unknown", f"the diagram has no variable '{name}'", None,
                                      suggest(name, flat.names) or "`heavebond check MODEL --names` lists all of them.")])
    named = {*output_names, *assembly.state_names}
    hidden = [name for name in dict.fromkeys(locals) if name not in named]
    output_names += hidden
    outputs = stack([signal_expression(assembly, n) for n in output_names])
    jacobian = ca.densify(ca.jacobian(assembly.alg, z)).T if z.numel() else ca.SX(0, 0)
    symbols = [ca.SX.sym("u", 4) for _ in flat.inputs]
    rows = measured_rows(flat)
    delayed = pieces[rows:]
    begin = ca.SX.sym("begin", 1 if flat.delays else 0)

    def counted(sides: Sequence[ca.SX]) -> list[ca.SX]:
        """Expressions with the time counted from the begin if the diagram has delays."""
        if not flat.delays:
            return list(sides)
        elapsed, origins = ca.SX.sym("t"), stack([delayed[DELAY_ROWS * k + 1] for k in range(len(flat.delays))])
        # r (t - t_0) is r times a difference of two times from the begin: CasADi writes t - (t - e) as e
        sides = ca.substitute(list(sides), [origins], [t - (elapsed - origins)])
        return ca.substitute(from_begin(sides, t, begin), [elapsed], [t])

    measured = [t, *(s / ca.SX(ca.DM([1, 1, 2, 6])) for s in symbols)] if flat.inputs else []  # c_k = u^(k) / k!
    inputs_with_rates = stack([*measured, delayed])
    followed = differentiated(assembly)
    happenings = [assembly.express(stack(group)) for group in (
        [e.indicator for e in flat.events if e.indicator is not None], [flat.levels[0][j] for j in followed],
        [flat.levels[1][e.breakaway.speed] for e in flat.events if e.breakaway],
        [flat.levels[0][flat.names[u.name]] - u.plausible.least for u in limited(assembly).unknowns])]
    updates = assembly.update_order.at(first.p)
    sources = assembly.express(stack(d.source for d in flat.delays))
    right = counted(ca.substitute(
        [assembly.ode, outputs, assembly.alg, ca.vec(jacobian), *happenings, updates.values, sources,
         assembly.express(stack(d.delay for d in flat.delays)), t], [pieces, rate], [inputs_with_rates, ca.SX(1)]))
    used = {s.element_hash() for side in right for s in ca.symvar(side)}
    kept_inputs = [(k, order) for k, s in enumerate(symbols) for order, one in enumerate(split(s))
                   if order == 0 or one.element_hash() in used]
    u = stack([*(symbols[k][order] for k, order in kept_inputs), delayed, begin])
    arguments = [t, x, z, p, u]
    equations = ca.Function(f"{prefix}equations", arguments, ca.cse([ca.densify(side) for side in right[:4]]))
    happening = ca.Function(f"{prefix}happenings", arguments, ca.cse([ca.densify(side) for side in right[4:7]]))
    limits = ca.Function(f"{prefix}limits", arguments, ca.cse([ca.densify(right[7]), right[11]]))
    updated = ca.Function(f"{prefix}updates", [*arguments, updates.fired], ca.cse([ca.densify(right[8])]))
    along = [ca.SX.sym("along", one.shape) for one in arguments]
    moving = [*right[:3], right[4]]
    slopes = ca.jtimes(stack(moving), stack(arguments), stack(along))
    cuts = np.cumsum([0, *(side.numel() for side in moving)]).tolist()
    directions = ca.Function(f"{prefix}directions", [*arguments, *along],
                             ca.cse([ca.densify(slopes[a:b]) for a, b in pairwise(cuts)]))
    laws, unknowns = stack([right[0], right[2]]), stack([x, z])
    by_unknowns = ca.densify(ca.jacobian(laws, unknowns)).T if unknowns.numel() else ca.SX(0, 0)
    by_all = ca.Function(f"{prefix}jacobian", arguments,
                         ca.cse([ca.vec(by_unknowns), ca.densify(ca.jtimes(laws, t, ca.SX(1)))]))
    instants = ca.Function(f"{prefix}instants", [p], [ca.densify(assembly.express(stack(
        ca.SX(0) if e is None else e for e in group))) for group in (
            [event.first for event in flat.events], [event.period for event in flat.events])])
    histories = ca.Function(f"{prefix}histories", arguments, ca.cse([ca.densify(side) for side in right[9:11]]))
    starting = _start_conditions(assembly, first, column, symbols, arguments, counted, f"{prefix}starting")
    values, rules = _rules(assembly)
    allowed = ca.Function(f"{prefix}allowed", [p], ca.cse([ca.densify(values)]))
    return Portable(assembly, _columns(assembly, assembly.reduced.states, first.x, assembly.x_nominal),
                    _columns(assembly, assembly.reduced.algebraic, first.z, assembly.z_nominal),
                    _parameters(assembly, first), tuple(not q.name.startswith(DERIVED) for q in flat.parameters),
                    tuple(_input(assembly, k, order, column) for k, order in kept_inputs),
                    tuple(_outputs(assembly, output_names, outputs, first, column)), equations, directions, by_all,
                    happening, updated, instants, tuple(float(flat.unknowns[j].nominal) for j in followed), starting, limits,
                    histories, allowed, rules, locals=len(hidden))


def _rules(assembly: Assembly) -> tuple[ca.SX, tuple[Rule, ...]]:
    """The values that follow from parameters and have bounds, or are requirements of components, with their rules."""
    flat, limits = assembly.flat, assembly.flat.limits
    bounded = [(name, q) for name, q, _ in with_declaration(flat.expanded) if q.low is not None or q.high is not None]
    checks = [(flat.constants[name], Rule(float(low), float(high), f"{name} is", f" {q.unit.text}".removesuffix(" 1")
                                          + f"; it must be {bounds_text(q)}"))
              for (name, q), low, high in zip(bounded, limits.low, limits.high, strict=True)]
    for path, template in flat.templates.items():
        leaf = flat.expanded.leaves[path]
        if leaf.component.requires:
            truths = template.requirements(stack(flat.constants[f"{path}.{name}"] for name in template.parameters))
            checks += [(truth, Rule(0.5, inf, f"'{path}' ({leaf.component.name}) requires {formula.text}"))
                       for truth, formula in zip(split(truths), leaf.component.requires, strict=True)]
    checks = [(value, rule) for value, rule in checks if ca.symvar(value)]
    return stack(value for value, _ in checks), tuple(rule for _, rule in checks)


def _start_conditions(assembly: Assembly, first: Start, column: Array, symbols: list[ca.SX], arguments: list[ca.SX],
                      counted: Callable[[Sequence[ca.SX]], list[ca.SX]], label: str) -> StartConditions:
    """The conditions of the start in the arguments of an export; a steady start keeps the inputs constant."""
    flat, equations = assembly.flat, StartEquations(assembly)
    t, _, _, p, pieces, rate = assembly.arguments
    of_components = first.of_components and bool(equations.component_rows)
    whole = equations.with_components if of_components else equations.conditions if first.in_turn else equations.all
    aims = (equations.aims if first.in_turn else equations.approach) if equations.guesses else None
    guesses = equations.guess.columns([(j, order) for j, order in (*assembly.reduced.states, *assembly.reduced.algebraic)])
    sides = [whole.residuals, whole.slopes, *((aims.residuals, aims.slopes) if aims else (ca.SX(0, 1), ca.SX(0, 1)))]
    orders = ca.SX(ca.DM([1, 0, 0, 0] if equations.steady else [1, 1, 1 / 2, 1 / 6]))  # c_k = u^(k) / k!
    inputs_with_rates = stack([*([t, *(s * orders for s in symbols)] if flat.inputs else []), pieces[measured_rows(flat):]])
    sides = ca.substitute([*sides, guesses], [pieces, rate],
                          [inputs_with_rates, ca.SX(0 if equations.steady else 1)])
    used = {s.element_hash() for side in sides for s in ca.symvar(side)}
    fixed = {*equations.solved_for, *(held.index for held in flat.held)}
    numbers = {name: k for k, name in enumerate(assembly.parameter_names)}
    specified = {c.name: numbers.get(f"initial.{c.name}", -1) for c in equations.initial.conditions.values() if not c.guess}
    of_states = tuple(specified.get(name, -1) for name in assembly.state_names)
    by_parameters = tuple(s.element_hash() in used and k not in fixed and (k in of_states or not name.startswith(DERIVED))
                          for k, (name, s) in enumerate(zip(assembly.parameter_names, split(p), strict=True)))
    of_states = tuple(k if k >= 0 and by_parameters[k] else -1 for k in of_states)
    by_inputs = tuple(s.element_hash() in used for s in split(arguments[4]))
    point = Point(first.t, first.x, first.z, first.p, held_still(column, first.t) if equations.steady else column,
                  0.0 if equations.steady else 1.0)
    sizes = equations.sizes(first.p)
    if of_components:
        sizes = equations.following(sizes)
    residual, gradients = whole.at(point)
    gradients = scaled(gradients, None, sizes)
    square = gradients.shape[0] == gradients.shape[1] and not null_space(
        scaled(gradients, weights(residual, gradients)), INITIALISATION.undetermined).size
    columns = [ca.densify(sides[0]), ca.vec(ca.densify(sides[1]).T), ca.densify(sides[2]), ca.vec(ca.densify(sides[3]).T),
               ca.densify(sides[4])]
    return StartConditions(ca.Function(label, arguments, ca.cse(counted(columns))), tuple(equations.solved_for),
                           tuple(sizes.tolist()), by_parameters, by_inputs, of_states, bool(square))


def derived(base: Unit, order: int) -> Unit:
    """The unit of the order-th time derivative."""
    return declared_unit(dimension_text(times(base.dimension, unit("s").dimension, -order))) if order else base


def _columns(assembly: Assembly, columns: Iterable[tuple[int, int]], values: Array, nominal: Array) -> tuple[Quantity, ...]:
    quantities = []
    for (j, order), value, size in zip(columns, values, nominal, strict=True):
        unknown = assembly.flat.unknowns[j]
        quantities.append(Quantity(assembly.reduced.name((j, order)), derived(unknown.unit, order), float(value),
                                   unknown.doc,
                                   nominal=float(size)))
    return tuple(quantities)


def _parameters(assembly: Assembly, first: Start) -> tuple[Quantity, ...]:
    quantities, leaves = [], assembly.flat.expanded.leaves
    for q, value in zip(assembly.flat.parameters, first.p, strict=True):
        path, _, name = q.name.rpartition(".")
        declared = leaves[path].component.parameters.get(name) if path in leaves else None
        low, high = (None, None) if declared is None else (declared.low, declared.high)
        quantities.append(Quantity(q.name, q.unit, float(value), declared.doc if declared else "",
                                   -inf if low is None else low, inf if high is None else high))
    return tuple(quantities)


def _input(assembly: Assembly, k: int, order: int, column: Array) -> Quantity:
    known = assembly.flat.inputs[k]
    value = float(column[1 + 4 * k + order]) * factorial(order)
    name, doc = known.name, ""
    for _ in range(order):
        name, doc = f"der({name})", f"derivative of {name}; required in addition to it"
    return Quantity(name, derived(known.unit, order), value, doc)


def _outputs(assembly: Assembly, names: Sequence[str], expressions: ca.SX, first: Start, column: Array
             ) -> Iterable[Quantity]:
    values = ca.Function("y", list(assembly.arguments), [expressions])(first.t, first.x, first.z, first.p, column, 1.0)
    units = dict(zip(assembly.state_names, (derived(assembly.flat.unknowns[j].unit, order)
                                            for j, order in assembly.reduced.states), strict=True))
    units |= {name: assembly.flat.unknowns[assembly.flat.names[name]].unit for name in names
              if name not in units and name in assembly.flat.names}
    for name, value in zip(names, np.array(values).ravel(), strict=True):
        shown_output = assembly.model.show.get(name)
        yield Quantity(name, read_unit(shown_output.unit) if shown_output else units[name], float(value),
                       shown_output.text if shown_output and shown_output.text != name else "")


# -- instants at which an integrator stops -----------------------------------------------------------------------------
def _roots(parts: list[ca.SX], time: ca.SX) -> list[ca.SX]:
    """Times at which a function of time switches: zeros of expressions that are linear in time and, for smooth switches,
    the ends of the steep part."""
    roots: dict[str, ca.SX] = {}
    for expressions, levels in zip(switch_arguments(parts, time)[1:], ((0.0,), LEVELS), strict=True):
        for expression in expressions:
            slope = ca.jacobian(expression, time)
            if slope.nnz() and not ca.depends_on(slope, time):
                first = ca.substitute(expression, time, ca.SX(0))
                for level in levels:
                    root = ca.if_else(slope == 0, NEVER, (level - first) / slope)
                    roots.setdefault(str(root), root)
    return list(roots.values())
