"""Flattening: the expanded diagram as one set of unknowns, parameters and equations, each with its provenance."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import ModelError, Place, Problems, listing, suggest
from heavebond.core.units import (
    DIMENSIONLESS,
    ONE,
    Unit,
    as_meant,
    check_turns,
    declared_unit,
    dimension_text,
    other_unit,
    read_unit,
)
from heavebond.equations.connect import Network, connect, drivers
from heavebond.equations.events import FlatEvent, Held, held_bounds, leaf_events, with_held
from heavebond.equations.expand import expand
from heavebond.equations.expanded import Expanded, Leaf
from heavebond.equations.flat_unknowns import Unknowns
from heavebond.equations.frames import FrameTree, Key, RedundantLoop, frame_tree, with_roots
from heavebond.equations.medium import check_circuits, with_media
from heavebond.equations.output_checks import check_asked, with_nominal_sizes
from heavebond.equations.ownership import Names, check_outputs, claim_clocks, claim_names
from heavebond.equations.parameters import (
    FlatParameter,
    Limits,
    Parameters,
    check_values,
    formula_order,
    make_parameters,
    narrowed,
    parameter_bounds,
    solved_unit,
)
from heavebond.equations.resolver import Bond, Resolver, Unknown
from heavebond.equations.temperature_origins import TemperatureOrigins, with_intervals
from heavebond.equations.time_conditions import check_steps, timed
from heavebond.equations.variation import Factor, factors, incidence
from heavebond.language.definition import Delayed, Domain, FileInput, Value
from heavebond.language.incidence import EVERYTHING, INDEFINITE, Entry, Interval, classify
from heavebond.language.model import Model
from heavebond.language.sections import Clock
from heavebond.language.symbols import Context, evaluate, nonsmooth, places, split, stack
from heavebond.language.template import LEVELS, FrameEquations, Template, template
from heavebond.language.values import add_formula_problem, check_dimension
from heavebond.text.expression import ExpressionProblem, calling, constant, names, parse_formula

SECOND = declared_unit("s").dimension
Array = NDArray[np.float64]
Entries = list[tuple[int, int]]  # (column, kind); column = level * len(unknowns) + unknown


class EquationRole(Enum):
    """The role of an equation."""

    LAW = "law"  # of a component
    BALANCE = "balance"  # the sum of a through variable at a node
    RATE = "rate"  # the flow at a node is the derivative of its position
    GIVEN = "given"  # the value or formula of an input
    MEASURED = "measured"  # the record of an input


@dataclass(frozen=True)
class FlatEquation:
    """The provenance of an equation: its component or node, its name, its text, the kink in it; its role, and the variable
    that it concerns (the input that is given or measured, the through variable that is summed)."""

    owner: str
    label: str
    text: str
    place: Place
    kink: str | None = None
    notes: tuple[str, ...] = ()
    role: EquationRole = EquationRole.LAW
    subject: str = ""


@dataclass(frozen=True)
class KnownInput:
    """A measured signal: symbols for its value and its first three derivatives."""

    name: str
    source: FileInput
    unit: Unit
    symbols: ca.SX


@dataclass(frozen=True)
class DelayedVariable:
    """A delayed variable: symbols for its value and its first three derivatives, its source and its delay as expressions.
    Its constant value before the start is the entry `index` of the parameters, which follows from the start."""

    name: str
    symbols: ca.SX
    source: ca.SX
    delay: ca.SX
    index: int
    place: Place
    nominal: float


@dataclass(frozen=True)
class Energetics:
    """Power into the ports, rate of the stored energy, dissipation, unbalanced power, and the energy stored."""

    owner: str
    power: ca.SX
    stored: ca.SX
    dissipated: ca.SX
    unbalanced: ca.SX
    energy: ca.SX
    kind: str
    why: str


@dataclass(frozen=True)
class Flat:
    """Unknowns v_j with derivative symbols `columns[k][j]` = d^k v_j / dt^k, and residuals r_i = 0 in SI. Symbols are picked
    from a column ten times as fast as stacked."""

    expanded: Expanded
    unknowns: tuple[Unknown, ...]
    columns: tuple[ca.SX, ...]
    parameters: tuple[FlatParameter, ...]
    p: ca.SX
    time: ca.SX
    rate: ca.SX
    inputs: tuple[KnownInput, ...]
    equations: tuple[FlatEquation, ...]
    residual_column: ca.SX
    entries: tuple[Entries, ...]
    names: dict[str, int]
    constants: dict[str, ca.SX]
    units: dict[str, Unit] = field(default_factory=dict)
    energies: tuple[tuple[tuple[str, ...], ca.SX], ...] = ()  # of parts of one kind: power ... energy (5, n)
    bounds: dict[int, Interval] = field(default_factory=dict)  # by the hash of a symbol
    held: tuple[Held, ...] = ()
    events: tuple[FlatEvent, ...] = ()
    bonds: dict[str, Bond] = field(default_factory=dict)        # of the components
    block_bonds: dict[str, Bond] = field(default_factory=dict)  # of the blocks that they are in
    domains: dict[str, Domain] = field(default_factory=dict)    # by the path of a node or port
    delays: tuple[DelayedVariable, ...] = ()
    passed_through: tuple[DelayedVariable, ...] = ()  # those whose delay is zero: they equal their sources
    templates: dict[str, Template] = field(default_factory=dict, repr=False)
    # `also`, `widths` and `zeros`, with which the same is made of the diagram; None if other equations were put in since
    options: tuple[tuple[str, ...], float, tuple[str, ...]] | None = None
    zeros: tuple[str, ...] = ()  # the parameters that were left out of the equations, see `without_zeros`
    # the relations of frames, and the equations of the rotation and of the translation of each
    frames: FrameTree | None = None
    frame_rows: Mapping[tuple[Key, str], range] = field(default_factory=dict, repr=False)
    redundancies: tuple[RedundantLoop, ...] = ()  # the loops whose redundant constraints were left out of the equations

    @cached_property
    def levels(self) -> tuple[tuple[ca.SX, ...], ...]:
        """The elements of the columns."""
        return tuple(tuple(split(column)) for column in self.columns)

    @cached_property
    def residuals(self) -> tuple[ca.SX, ...]:
        """Each of the residuals."""
        return tuple(split(self.residual_column))

    @property
    def driving(self) -> tuple[KnownInput | DelayedVariable, ...]:
        """The known functions of time in the equations; each has symbols for its value and three derivatives."""
        return (*self.inputs, *self.delays)

    @cached_property
    def delay_lengths(self) -> ca.Function:
        """The lengths (n,) in s of the delays, then of those that are zero, given p."""
        return ca.Function("delays", [self.p], [stack(d.delay for d in (*self.delays, *self.passed_through))])

    def other_delays(self, p: Array) -> bool:
        """True if, with parameters (n_p,), a zero delay becomes nonzero or a nonzero delay becomes zero."""
        if not self.delays and not self.passed_through:
            return False
        zero = np.array(self.delay_lengths(p)).ravel() == 0
        return bool(zero[:len(self.delays)].any() or not zero[len(self.delays):].all())

    @cached_property
    def energetics(self) -> tuple[Energetics, ...]:
        """The energetics of the components, in the order of the diagram."""
        leaves, energetics, varied = self.expanded.leaves, dict[str, Energetics](), dict[str, list[str]]()
        for name in self.expanded.model.vary:
            varied.setdefault(name.rpartition(".")[0], []).append(name)
        for paths, values in self.energies:
            for path, leaf_values in zip(paths, _columns(values, len(paths)), strict=True):
                power, stored, dissipated, unbalanced, energy = leaf_values
                component = leaves[path].component
                kind, why = component.power, component.unbalanced_why
                if names := varied.get(path):  # the variation itself exchanges power with the surroundings
                    kind, why = kind or "controlled", f"{listing(names)} {'vary' if len(names) > 1 else 'varies'}"
                energetics[path] = Energetics(path, power, stored, dissipated, unbalanced, energy, kind, why)
        return tuple(energetics[path] for path in leaves if path in energetics)

    @cached_property
    def places(self) -> dict[int, int]:
        """The index of the symbol of each parameter, by its hash."""
        return places(self.p)

    @cached_property
    def limits(self) -> Limits:
        """The admissible values of the parameters by the components."""
        return Limits.of(self.expanded, Parameters(self.parameters, self.p, self.constants, self.units), self.templates)

    @cached_property
    def origins(self) -> TemperatureOrigins:
        """Which quantities in K are temperatures and which are differences."""
        return TemperatureOrigins(self)

    @property
    def constant_hashes(self) -> set[int]:
        """The hashes of the symbols that are constant during a run: the parameters without held variables."""
        held = {h.index for h in self.held}
        return {s for s, k in self.places.items() if k not in held}


def flatten(model: Model, also: Iterable[str] = (), widths: float = 1.0, corners: Mapping[int, int] | None = None) -> Flat:
    """The flat model; `also` names signals that a caller needs in addition to those named by the diagram, `widths` is a
    factor on the widths of all transitions. `corners` gives the number of differentiations of equations (by index) whose
    corners in time become events."""
    expanded = with_media(expand(model))
    check_circuits(expanded)
    expanded = expanded if widths == 1 else narrowed(expanded, widths)
    order = formula_order(expanded)
    network = connect(expanded, order)
    rooted = with_roots(expanded, network)
    if rooted is not expanded:
        expanded, network = rooted, connect(rooted, order)
    problems = Problems()
    claimed = claim_names(expanded, network, problems)
    problems.raise_as(ModelError)
    with calling(model.library.functions):  # names of outputs and of conditions are formulas
        builder = _Builder(expanded, network, make_parameters(expanded, network, order), claimed, corners or {})
        flat = builder.build(tuple(also))
    return replace(flat, options=(tuple(also), widths, ()))


def without_zeros(flat: Flat, zeros: Iterable[str]) -> Flat:
    """The flat model without the parameters `zeros`, whose value is 0: an equation that they multiply has no such term then,
    and the model other states (a body without mass) or another index (a resistor of 0 Ohm before a capacitor)."""
    names, n = tuple(zeros), len(flat.unknowns)
    column, entries = ca.SX(flat.residual_column), list(flat.entries)
    removed = [flat.constants[name] for name in names]
    changed, known = set[int](), set[int]()  # rows, and those of them that say of an unknown that it is 0
    zero_unknowns = set[int]()
    while removed:
        symbols = stack(removed)
        rows = [row for row in np.flatnonzero(ca.which_depends(column, symbols, 1, True)).tolist() if row not in known]
        column[rows] = ca.substitute(column[rows], symbols, ca.SX.zeros(len(removed)))
        for row in rows:
            unknowns = sorted({packed % n for packed, _ in entries[row]})
            entries[row], = incidence(column[row], flat.columns, unknowns, flat.constant_hashes, flat.bounds) \
                if unknowns else ([],)
        changed |= set(rows)
        removed = []
        for row in sorted(changed - known):  # a compliance c = C*y with C = 0
            if len(entries[row]) == 1 and (column[row].is_symbolic() or (-column[row]).is_symbolic()):
                known.add(row)
                unknown = entries[row][0][0] % n
                if unknown not in zero_unknowns:  # two rows may say so of one
                    zero_unknowns.add(unknown)
                    removed += [level[unknown] for level in flat.levels]
    options = None if flat.options is None else (*flat.options[:2], (*flat.zeros, *names))
    return replace(flat, residual_column=column, entries=tuple(entries), zeros=(*flat.zeros, *names), options=options)


def unclocked(flat: Flat) -> Flat:
    """The flat model with comparisons of the time in its equations as written, for programs without events."""
    # of two that set one variable, that which sets it to 1
    event_of_clock = {e.resets[0].name: e for e in reversed(flat.events) if e.by_clock}
    if not event_of_clock:
        return flat
    symbols = stack(flat.constants[name] for name in event_of_clock)
    passed = stack(e.first <= flat.time if e.indicator is None else e.indicator > 0 for e in event_of_clock.values())
    for _ in event_of_clock:  # the instant of one may follow from whether others have passed
        if not ca.depends_on(passed, symbols):
            break
        passed = ca.substitute(passed, symbols, passed)
    removed = {name for clock in event_of_clock for name in (clock, f"initial.{clock}")}
    last = -len(event_of_clock)  # clocks are the last held variables
    return replace(flat, parameters=flat.parameters[:last], p=flat.p[:last], held=flat.held[:last], options=None,
                   residual_column=ca.substitute(flat.residual_column, symbols, passed),
                   events=tuple(event for event in flat.events if not event.by_clock),
                   constants={name: s for name, s in flat.constants.items() if name not in removed},
                   units={name: u for name, u in flat.units.items() if name not in removed})


class _Builder:
    def __init__(self, expanded: Expanded, network: Network, parameters: Parameters, claimed: Names,
                 corners: Mapping[int, int]):
        self.claimed, self.corners = claimed, corners
        self.expanded, self.network, self.parameters = expanded, network, parameters
        self.domains = expanded.model.library.domains
        self.tree = frame_tree(expanded, network)
        self.problems = claimed.problems
        self.unknowns: list[Unknown] = []
        self.names: dict[str, int] = {}
        self.time, self.rate = ca.SX.sym("time"), ca.SX.sym("time_rate")
        self.constants = parameters.expressions
        self.inputs: list[KnownInput] = []
        self.delays: list[DelayedVariable] = []
        self.passed_through: list[DelayedVariable] = []
        self.equations: list[FlatEquation] = []
        self.pieces: list[ca.SX] = []  # residuals: columns are stacked far faster than their elements
        self.number = 0  # of all in these
        self.order: list[int] = []  # where that of each equation stands
        self.residuals = ca.SX(0, 1)
        self.entries: list[Entries] = []
        self.energies: list[tuple[tuple[str, ...], ca.SX]] = []
        self.bonds: dict[str, Bond] = {}
        self.block_bonds: dict[str, Bond] = {}
        self.held: tuple[Held, ...] = ()
        self.events: list[FlatEvent] = []
        self.templates: dict[str, Template] = {}
        self.factors: dict[str, Factor] = {}  # of parameters that vary
        self.frame_rows: dict[tuple[Key, str], range] = {}

    def build(self, also: tuple[str, ...]) -> Flat:
        for path, leaf in self.expanded.leaves.items():
            inner = {e.path for w in leaf.component.body.wires.values() for e in w.ends}
            component = leaf.component
            if component.composite and not component.equations and not component.variables and not component.when \
                    and not component.requires \
                    and {*component.ports, *component.signal_names} <= inner:
                continue
            self.templates[path] = template(component, self.domains, self.network.domains[path], leaf.integers)
        check_values(self.expanded, self.parameters, self.templates)
        unknowns = Unknowns(self.expanded, self.network, self.templates, self.claimed, also, self.tree.roots)
        self.names, self.bonds, self.block_bonds = unknowns.names, unknowns.bonds, unknowns.block_bonds
        self.unknowns = with_nominal_sizes(self.expanded.model, unknowns.listed, self.names, self.problems)
        self.n = len(self.unknowns)
        named = [ca.SX.sym(u.name) for u in self.unknowns]  # as they are printed; those of derivatives made in one call
        self.columns = (stack(named), *(ca.SX.sym("d" * k + "v", self.n) for k in range(1, LEVELS)))
        self._numbers_of_a_run()
        check_asked(self.expanded.model, self._resolver(), (q.name for q in self.parameters.independent),
                    {h.name for h in self.held}, self.problems)
        check_outputs(self.claimed, self.expanded.model.show, self.names)
        self.factors = factors(self.expanded.model, self.expanded.leaves, self.templates, self._resolver(), self.problems)
        self._node_equations()
        self._leaf_equations()
        self._frame_equations()
        self._given_inputs()
        self._delayed_variables()
        self._end()
        self._irregular_clocks()
        self.problems.raise_as(ModelError)
        # replace comparisons of the time in the equations by held variables
        provenance = [(e.owner, e.text, e.place) for e in self.equations]
        self.residuals = ca.densify(ca.vertcat(*self.pieces)[self.order]) if self.order else ca.SX(0, 1)
        check_steps(self.residuals, provenance, self.time, self.parameters, self.problems)
        self.problems.raise_as(ModelError)
        clocked = timed(self.residuals, provenance, self.time, self.parameters, self.held, self.corners)
        claim_clocks(self.claimed, clocked.held[len(self.held):])
        self.residuals, self.parameters = clocked.residuals, clocked.parameters
        self.constants = clocked.parameters.expressions
        self.held, self.events = clocked.held, [*self.events, *clocked.events]
        self.equations = [replace(e, kink=None) if k in clocked.smooth else e for k, e in enumerate(self.equations)]
        self.problems.raise_as(ModelError)
        bounds = self._bounds()
        bounds.update(held_bounds(self.expanded, self.constants))
        bounds.update({self.constants[e.resets[0].name].element_hash(): (0.0, 1.0) for e in self.events if e.by_clock})
        flat = Flat(self.expanded, tuple(self.unknowns), self.columns,
                    self.parameters.independent, self.parameters.p, self.time, self.rate, tuple(self.inputs),
                    tuple(self.equations), self.residuals, tuple(self.entries), self.names, self.constants,
                    self.parameters.units, tuple(self.energies), bounds, self.held, tuple(self.events), self.bonds,
                    self.block_bonds, {path: self.domains[group.domain] for group in self.network.groups
                                       if group.domain in self.domains for path in group.aliases},
                    tuple(self.delays), tuple(self.passed_through), self.templates, frames=self.tree,
                    frame_rows=self.frame_rows)
        model = self.expanded.model
        outputs = with_intervals(flat)
        return flat if outputs is model.show else replace(flat, expanded=replace(
            self.expanded, model=replace(model, show=outputs)))

    def _bounds(self) -> dict[int, Interval]:
        """The intervals of unknowns and parameters by the hashes of their symbols."""
        bounds = {s.element_hash(): (u.low, u.high) for s, u in zip(split(self.columns[0]), self.unknowns, strict=True)
                  if (u.low, u.high) != EVERYTHING}
        return bounds | parameter_bounds(self.expanded, self.parameters)

    def _numbers_of_a_run(self) -> None:
        """Initial values (`initial.crown.x`) and the scales of measured inputs (`scale.heave.u`, 1) as parameters, so that
        they can be set, fitted and differentiated like other parameters."""
        numbers = [FlatParameter(f"scale.{path}.{name}", 1.0, DIMENSIONLESS, bound.place)
                   for path, leaf in self.expanded.leaves.items() for name, bound in leaf.inputs.items()
                   if isinstance(bound.value, FileInput)]
        self.parameters, self.held = with_held(
            self.parameters.joined(numbers), self.expanded,
            lambda leaf, unit: solved_unit(unit, leaf, self.expanded, self.network), self.problems)
        resolver, held, numbers = self._resolver(), {h.name for h in self.held}, []
        for name, condition in self.expanded.model.initial.conditions.items():
            number = constant(condition.value.expr)
            if condition.guess or number is None or name in held:
                continue
            try:
                dimension = resolver.dimension(parse_formula(name)) or ONE
            except ExpressionProblem:
                continue  # said when the start is solved
            index = self.names.get(name)
            unit = self.unknowns[index].unit if index is not None else Unit(dimension_text(dimension), 1.0, 0.0, dimension)
            numbers.append(FlatParameter(f"initial.{name}", number, unit, condition.value.place))
        numbers += [FlatParameter(f"history.{path}.{name}", 0.0, self.unknowns[self.names[f"{path}.{name}"]].unit, d.place)
                    for path, leaf in self.expanded.leaves.items() for name, d in leaf.component.delayed.items()]
        self.parameters = self.parameters.joined(numbers)
        self.constants = self.parameters.expressions

    def _resolver(self) -> Resolver:
        return Resolver(self.names, self.constants, self.parameters.units, tuple(self.unknowns), self.columns, self.time,
                        self.rate, {**self.bonds, **self.block_bonds})

    # -- equations -------------------------------------------------------------------------------------------------
    def _kept(self, residuals: ca.SX) -> range:
        """The numbers of these residuals, of columns from left to right."""
        self.pieces.append(ca.vec(residuals))
        begin, self.number = self.number, self.number + residuals.numel()
        return range(begin, self.number)

    def _add(self, equation: FlatEquation, residual: int, entries: Entries) -> None:
        self.equations.append(equation)
        self.order.append(residual)
        self.entries.append(entries)

    def _node_equations(self) -> None:
        # the through variables of each node: all sums at once, as the product of the incidence matrix with them
        equations: list[FlatEquation] = []
        ends: list[list[tuple[int, int]]] = []
        for junction in self.expanded.junctions.values():
            group = self.network.groups[self.network.group_of_node[junction.path]]
            # a node whose only end takes a record instead is left with nothing
            if group.domain not in self.domains or not junction.ends:
                continue
            for member in self.domains[group.domain].through:
                ends.append([(e.sign, self.names[f"{e.name}.{member}"]) for e in junction.ends])
                equations.append(FlatEquation(
                    junction.path, f"sum of {member} at node '{junction.path}'",
                    " + ".join(f"{e.name}.{member}" for e in junction.ends) + " = 0", junction.place,
                    role=EquationRole.BALANCE, subject=f"{junction.path}.{member}"))
        if ends:
            rows, signs, columns = zip(*((i, sign, j) for i, row in enumerate(ends) for sign, j in row), strict=True)
            incidence_matrix = ca.DM.triplet(rows, columns, ca.DM(signs), len(ends), self.n)
            totals = self._kept(ca.mtimes(ca.SX(incidence_matrix), self.columns[0]))
            for equation, row, total in zip(equations, ends, totals, strict=True):
                self._add(equation, total, [(j, 0) for _, j in row])
        # the flow at a node is the derivative of its position
        equations, pairs = [], []
        for k, group in enumerate(self.network.groups):
            domain = self.domains.get(group.domain)
            for position in domain.positions if domain is not None and k not in self.tree.carried else ():
                if domain is None or f"{group.name}.{position}" not in self.names:
                    continue
                flow = domain.rate(position)
                pairs.append((self.names[f"{group.name}.{flow}"], self.names[f"{group.name}.{position}"]))
                equations.append(FlatEquation(
                    group.name, f"{flow} is the rate of {position} at node '{group.name}'",
                    f"{group.name}.{flow} = der({group.name}.{position})", group.place,
                    role=EquationRole.RATE, subject=f"{group.name}.{flow}"))
        rates = self.columns[0][[v for v, _ in pairs]] - self.columns[1][[x for _, x in pairs]]
        for equation, (v, x), residual in zip(equations, pairs, self._kept(rates), strict=True):
            self._add(equation, residual, [(v, 0), (self.n + x, 0)])

    def _frame_equations(self) -> None:
        """The relations of frames, explicit along a tree and three equations for each loop (see `frames`)."""
        users: dict[FrameEquations, tuple[Template, str, list[tuple[str, int]]]] = {}
        for (path, number), forms in self.tree.forms.items():
            frame = self.templates[path].frames[number]
            for quantity, form, equations in (("rotation", forms.rotation, frame.rotation),
                                              ("translation", forms.translation, frame.translation)):
                if form is not None:
                    users.setdefault(equations[form], (self.templates[path], quantity, []))[2].append((path, number))
        for law, (template_of_part, quantity, parts) in users.items():
            size = len(template_of_part.slots)
            slots = [self.names[f"{path}.{slot}"] for path, _ in parts for slot in template_of_part.slots]
            parameters = [self._given(f"{path}.{name}") for path, _ in parts for name in template_of_part.given]
            inputs = [*(ca.reshape(column[slots], size, len(parts)) for column in self.columns),
                      ca.reshape(stack(parameters), len(template_of_part.given), len(parts)), self.time, self.rate]
            numbers = iter(self._kept(law.residuals(*inputs)))
            for k, (path, number) in enumerate(parts):
                unknowns, place = slots[k*size:(k + 1)*size], template_of_part.frames[number].place
                begin = len(self.equations)
                self.frame_rows[((path, number), quantity)] = range(begin, begin + len(law.labels))
                for label, row in zip(law.labels, law.entries, strict=True):
                    self._add(FlatEquation(path, label, law.text, place), next(numbers), self._mapped(row, unknowns))

    def _mapped(self, row: Sequence[Entry], unknowns: Sequence[int]) -> Entries:
        """The incidence of an equation of a part with its `unknowns`: one entry for each column (two ports of a part may
        be on one node), the harder kind kept."""
        kinds: dict[int, int] = {}
        for e in row:
            column = (e.column // len(unknowns))*self.n + unknowns[e.column % len(unknowns)]
            # two unit coefficients may cancel or add up; what they give is found when the equation is solved
            kinds[column] = e.kind if column not in kinds else max(kinds[column], e.kind, INDEFINITE)
        return list(kinds.items())

    def _leaf_equations(self) -> None:
        """The templates in the diagram's symbols, in the order of the diagram."""
        # a template is called once for all its leaves, a column for each: the numbers of the residuals of each leaf, and
        # its events
        users: dict[Template, list[str]] = {}
        for path, model_template in self.templates.items():
            users.setdefault(model_template, []).append(path)
        evaluated: dict[str, tuple[range, list[ca.SX]]] = {}
        for model_template, paths in users.items():
            slots = [self.names[f"{path}.{slot}"] for path in paths for slot in model_template.slots]
            parameters = [self._given(f"{path}.{name}") for path in paths for name in model_template.given]
            inputs = [*(ca.reshape(column[slots], len(model_template.slots), len(paths)) for column in self.columns),
                      ca.reshape(stack(parameters), len(model_template.given), len(paths)), self.time, self.rate]
            columns = model_template.happenings(*inputs) if model_template.happenings else ca.SX(0, len(paths))
            numbers, height = self._kept(model_template.residuals(*inputs)), len(model_template.lines)
            residuals_of_parts = (numbers[k * height:(k + 1) * height] for k in range(len(paths)))
            evaluated.update(zip(paths, zip(residuals_of_parts, _columns(columns, len(paths)), strict=True), strict=True))
            if not self.expanded.leaves[paths[0]].component.composite:  # leaves of one template are of one component
                self.energies.append((tuple(paths), model_template.energy(*inputs)))
        held = {h.name: h for h in self.held}
        varied: dict[str, list[Factor]] = {}
        for name, factor in self.factors.items():
            varied.setdefault(name.rpartition(".")[0], []).append(factor)
        for path in self.expanded.leaves:
            template = self.templates.get(path)
            if template is None:
                continue
            residuals, happenings = evaluated[path]
            self.events += leaf_events(path, template, happenings, self.names, held)
            unknowns = [self.names[f"{path}.{slot}"] for slot in template.slots]
            rows = [self._mapped(row, unknowns) for row in template.entries]
            if path in varied:
                # the equations of a part with varying parameters contain the unknowns of the factors, too
                held_hashes = {self.constants[h.name].element_hash() for h in self.held}
                column = ca.vertcat(*self.pieces)[list(residuals)]
                occurring = sorted({*unknowns, *(k for factor in varied[path] for k in factor.unknowns)})
                rows = list(incidence(column, self.columns, occurring, self.parameters.places.keys() - held_hashes,
                                      self._bounds()))
            for line, residual, entries in zip(template.lines, residuals, rows, strict=True):
                self._add(FlatEquation(path, line.label, line.text, line.place, line.kink), residual, entries)

    def _given(self, name: str) -> ca.SX:
        """A parameter as it occurs in the equations of its part."""
        factor = self.factors.get(name)
        return self.constants[name] if factor is None else self.constants[name] * factor.expression

    def _given_inputs(self) -> None:
        held = {self.constants[h.name].element_hash() for h in self.held}
        resolver, parameters = self._resolver(), self.parameters.places.keys() - held
        for group in self.network.groups:
            if group.domain != "signal":
                continue
            for path, bound in drivers(self.expanded, group)[1]:
                column = self.names[path]
                if isinstance(bound.value, FileInput):
                    unit = self.unknowns[self.names[path]].unit
                    if (read := read_unit(bound.value.unit)).dimension != unit.dimension:
                        converted = as_meant(read, unit) is not read
                        self.problems.add(
                            "unit-wrong", f"{path} is in {unit.text}; the column '{bound.value.column}' cannot be in "
                            f"{bound.value.unit}", bound.value.place, hint=other_unit(read, unit) if converted else
                            "Write the unit of the numbers in the file, or take another column.")
                    check_turns(bound.value.unit, unit, path, bound.value.place, self.problems)
                    symbols = stack([ca.SX.sym("d" * k + "measured " + group.name) for k in range(4)])
                    known = KnownInput(path, bound.value, unit, symbols)
                    self.inputs.append(known)
                    self._add(FlatEquation(path.rpartition(".")[0], f"{path} as measured",
                                           f"{path} = {bound.value.column}", bound.place,
                                           role=EquationRole.MEASURED, subject=path),
                              self._kept(self.columns[0][column] - self.constants[f"scale.{path}"] * known.symbols[0])[0],
                              [(column, 0)])
                else:
                    assert isinstance(bound.value, Value)
                    value, unit = bound.value, self.unknowns[column].unit
                    try:
                        dimension = resolver.dimension(value.expr, bound.scope)
                        expression = resolver.evaluate(value.expr, bound.scope)
                    except ExpressionProblem as problem:
                        add_formula_problem(problem, value, self.problems)
                        continue
                    check_dimension(path, value, dimension, unit, self.problems)
                    residual = self.columns[0][column] - expression
                    named = (self.names.get(bound.scope + name.text, column) for name in names(value.expr))
                    columns = sorted({column, *named})
                    occurring = ca.vertcat(*(level[columns] for level in self.columns))
                    row = classify(residual, occurring, parameters, {})[0]
                    scope = bound.scope
                    kink = nonsmooth(value.expr, lambda text: text == "pi" or scope + text in self.constants)  # noqa: B023
                    entries = [(e.column // len(columns) * self.n + columns[e.column % len(columns)], e.kind) for e in row]
                    self._add(FlatEquation(path.rpartition(".")[0], f"{path} as given",
                                           f"{path} = {value.text.lstrip('= ')}", value.place, kink,
                                           role=EquationRole.GIVEN, subject=path), self._kept(residual)[0], entries)

    def _end(self) -> None:
        """The condition at which a run ends as an event that sets nothing."""
        ends = self.expanded.model.ends
        if ends is None:
            return
        try:
            above = self._resolver().indicator(ends.tree)
        except ExpressionProblem as problem:
            self.problems.add(problem.code, problem.message, ends.place.moved(problem.column, problem.length),
                              hint=problem.hint)
            return
        self.events.append(FlatEvent("until", f"when: {ends.text}", ends.place, above, ca.SX(0), None, (), ends=True))

    def _irregular_clocks(self) -> None:
        """The sampled events of the parts under `clocks:` get their clock; a block stands for all parts in it."""
        clocks: dict[int, Clock] = {}
        for clock in self.expanded.model.clocks.values():
            for path, place in clock.parts:
                events = [k for k, event in enumerate(self.events) if event.period is not None
                          and (event.name.startswith(f"{path}.") or event.name.rpartition(".")[0] == path)]
                sampled = dict.fromkeys(e.name.rpartition(".")[0] for e in self.events if e.period is not None)
                if not events:
                    self.problems.add("clock-part", f"clock '{clock.name}': '{path}' is not a sampled part", place,
                                      hint=suggest(path, sampled) or f"Sampled parts: {listing(sampled) or 'none'}.")
                for k in events:
                    if (earlier := clocks.setdefault(k, clock)) is not clock:
                        self.problems.add("clock-part", f"'{path}' has the clocks '{earlier.name}' and '{clock.name}'",
                                          place,
                                          hint="Name it in one of them.")
        self.events = [replace(event, clock=clocks.get(k)) for k, event in enumerate(self.events)]

    def _delayed_variables(self) -> None:
        """An equation for each delayed variable: it is a known function of time, or its source where the delay is zero."""
        delayed = [(path, leaf, name, d) for path, leaf in self.expanded.leaves.items()
                   for name, d in leaf.component.delayed.items()]
        if not delayed:
            return
        index = {q.name: k for k, q in enumerate(self.parameters.independent)}

        def delay_of(path: str, leaf: Leaf, delay: Delayed) -> ca.SX:
            return evaluate(delay.by.tree, Context(lambda text, _: self._given(f"{path}.{text}"), lambda e: ca.SX(0),
                                                   leaf.integers))

        lengths = [delay_of(path, leaf, d) for path, leaf, _, d in delayed]
        values = np.array(ca.Function("delays", [self.parameters.p], [stack(lengths)])(self.parameters.numbers)).ravel()
        for (path, _, name, d), length, value in zip(delayed, lengths, values.tolist(), strict=True):
            full, column, source = f"{path}.{name}", self.names[f"{path}.{name}"], self.names[f"{path}.{d.of}"]
            if not value >= 0:
                self.problems.add("delay-negative", f"the delay of {full} is {value:g} s", d.by.place,
                                  hint="A signal cannot be known before it is there: give a time of 0 s or more.")
                continue
            symbols = stack([ca.SX.sym("d" * k + "delayed " + full) for k in range(4)])
            delayed_variable = DelayedVariable(full, symbols, self.columns[0][source], length, index[f"history.{full}"],
                                               d.place, self.unknowns[column].nominal)
            if value == 0:
                self.passed_through.append(delayed_variable)
                self._add(FlatEquation(path, "a delay of zero", f"{name} = {d.of}", d.place, subject=full),
                          self._kept(self.columns[0][column] - self.columns[0][source])[0], [(column, 0), (source, 0)])
            else:
                self.delays.append(delayed_variable)
                self._add(FlatEquation(path, f"{name} is {d.of}, delayed", f"{name} = {d.of}, {d.by.text} earlier", d.place,
                                       role=EquationRole.MEASURED, subject=full),
                          self._kept(self.columns[0][column] - symbols[0])[0], [(column, 0)])


def _columns(matrix: ca.SX, number: int) -> list[list[ca.SX]]:
    """The elements of each of so many columns."""
    elements, height = split(matrix), matrix.shape[0]
    return [elements[k * height:(k + 1) * height] for k in range(number)]
