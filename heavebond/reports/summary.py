"""Summary of an assembled diagram: counts, states and reasons of their choice, loops, index, and initial conditions."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from heavebond.core.errors import listing
from heavebond.core.presentation import columns, count, in_unit, path_text, readable, readable_time
from heavebond.core.units import UnitProblem, parse_quantity
from heavebond.equations.expanded import Medium
from heavebond.equations.flatten import EquationRole, FlatEquation
from heavebond.equations.grounding import Circuit, circuits
from heavebond.equations.state_selection import Column
from heavebond.language.state_chart import STATE
from heavebond.numerics.dae import Assembly
from heavebond.numerics.dynamic_state_selection import StateChoices
from heavebond.numerics.initialise import Start, StartLine

SHOWN_NAMES = 60
MOST_OF_A_CIRCUIT = 8
TIMES = {1: "once", 2: "twice"}


@dataclass(frozen=True)
class ChosenState:
    """A state with its unit and the reason of its choice in words."""

    name: str
    unit: str
    why: str


@dataclass(frozen=True)
class OpenChoice:
    """Unknowns that are coupled by the equations of a moving constraint, with a choice of states that may change in a run.

    `states` are the initial states, and `others` the unknowns that may replace them if they become unsuitable.
    """

    states: tuple[str, ...]
    others: tuple[str, ...]
    equations: tuple[str, ...]


@dataclass(frozen=True)
class Differentiation:
    """An equation that was differentiated `times` times by index reduction."""

    component: str
    equation: str
    times: int
    file: str
    line: int


@dataclass(frozen=True)
class AlgebraicLoop:
    """Simultaneous equations of components, the tearing variables, and the number `left` of those that are iterated."""

    components: tuple[str, ...]
    torn: tuple[str, ...]
    left: int


@dataclass(frozen=True)
class Summary:
    """The summary of an assembled diagram. `components` and `blocks` map a kind to the paths of its instances."""

    model: str
    summary: str
    files: tuple[str, ...]
    components: dict[str, tuple[str, ...]]
    blocks: dict[str, tuple[str, ...]]
    nodes: tuple[str, ...]
    media: tuple[str, ...]
    equations: int
    unknowns: int
    circuits: tuple[Circuit, ...]
    inputs: tuple[str, ...]
    events: tuple[str, ...]
    index: int
    differentiated: tuple[Differentiation, ...]
    states: tuple[ChosenState, ...]
    charts: tuple[OpenChoice, ...]
    algebraic: tuple[str, ...]
    loops: tuple[AlgebraicLoop, ...]
    start_mode: str
    start: tuple[StartLine, ...]
    solved: tuple[StartLine, ...]
    placeholders: tuple[str, ...] = ()
    defaults: tuple[str, ...] = ()
    sheets: tuple[str, ...] = ()
    sampled: tuple[str, ...] = ()
    machines: tuple[str, ...] = ()
    transitions: tuple[str, ...] = ()
    redundancies: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, object]:
        """The summary as a dictionary for JSON; values in SI."""
        return {**asdict(self), "equations_left": {"differential": len(self.states), "algebraic": len(self.algebraic)}}

    def text(self, width: int = 100) -> str:
        """The summary as lines of about `width` characters; each section begins with a line that is not indented."""
        rows = []
        for c in self.circuits:
            reference = f"held by {listing(c.held, 6)}" if c.held else \
                f"carried by {listing(c.carried, 6)}; its level is a matter of the start" if c.carried else "held by nothing"
            rows.append((c.domain, f"{listing(c.nodes, MOST_OF_A_CIRCUIT)}: {reference}"))
        if not self.states:
            states = ["States", "  none"]
        else:
            states = ["States, and the equation that determines the rate of each",
                      *columns([(s.name, s.unit, s.why) for s in self.states], width)]
            if self.charts:
                states += ["", "Dynamic state selection: states that may be exchanged during the run", *columns([
                    (listing(c.states, 6), f"to {listing(c.others, 6)}", "; ".join(c.equations[:3]))
                    for c in self.charts], width)]
        return "\n".join([*self._diagram(width), "",
                          *(["Circuits, and what grounds each", *columns(rows, width), ""] if rows else []),
                          *self._equations(width), "", *states,
                          *(["", *self._start(width)] if self.start or self.solved else [])])

    def _diagram(self, width: int) -> list[str]:
        number = sum(map(len, self.components.values()))
        kinds = ", ".join(kind if len(paths) == 1 else f"{len(paths)} {kind}"
                          for kind, paths in self.components.items())
        rows = [("summary", self.summary)] if self.summary else []
        rows += [("from", ", then ".join(self.files)), ("components", f"{number}: {kinds}")]
        if self.blocks:
            rows.append(("blocks", ", ".join(f"{path} ({kind})" for kind, paths in self.blocks.items()
                                             for path in paths)))
        rows.append(("nodes", f"{len(self.nodes)}: {listing(self.nodes, SHOWN_NAMES)}"))
        rows += [("medium", words) for words in self.media]
        rows += [("data", words) for words in self.sheets]
        rows += [("placeholder", words) for words in self.placeholders]
        if self.defaults:
            rows.append(("unconnected", f"{', '.join(self.defaults)} (start value of the input)"))
        if self.inputs:
            rows.append(("measured", ", ".join(self.inputs)))
        if self.events:
            rows.append(("events", f"{len(self.events)}: {listing(self.events, SHOWN_NAMES)}"))
        rows += [("sampled", words) for words in self.sampled]
        rows += [("rates", words) for words in self.transitions]
        rows += [("states", words) for words in self.machines]
        return [f"Diagram {self.model}", *columns(rows, width)]

    def _equations(self, width: int) -> list[str]:
        remaining = f"{count(len(self.states), 'differential equation')}, " \
            f"{count(len(self.algebraic), 'algebraic unknown')}"
        if self.algebraic:
            remaining += f": {listing(self.algebraic, SHOWN_NAMES)}"
        rows = [("assembled", f"{count(self.equations, 'equation')} in {count(self.unknowns, 'unknown')}"),
                ("index", f"{self.index}; {count(len(self.differentiated), 'equation')} differentiated"),
                ("left", remaining), ("loops", count(len(self.loops), "algebraic loop")),
                *(("redundant", words) for words in self.redundancies)]
        lines = ["Equations", *columns(rows, width)]
        if self.loops:
            loops = []
            for loop in self.loops:
                torn = listing(loop.torn, 6)
                loops.append((listing(loop.components, 6), f"solved explicitly, starting from {torn}" if loop.left == 0 else
                              f"tearing variables {torn}, iterated by the integrator" if loop.left == len(loop.torn) else
                              f"torn at {torn}; {loop.left} of these iterated by the integrator"))
            lines += ["", "Algebraic loops", *columns(loops, width)]
        if self.differentiated:
            lines += ["", "Differentiated", *columns([
                (d.component, TIMES.get(d.times, f"{d.times} times"), d.equation) for d in self.differentiated], width)]
        return lines

    def _start(self, width: int) -> list[str]:
        def computed(line: StartLine) -> str:
            try:
                _, unit = parse_quantity(line.asked)
            except UnitProblem:  # a formula, or nothing was specified
                return readable(line.used, line.unit, 6)
            return readable(line.used, line.unit, 6) if unit is None else f"{in_unit(line.used, unit, 6)} {unit.text}"

        head = "Initial conditions" + (f" ({self.start_mode})" if self.start_mode else "")
        rows = [("variable", "specified", "computed", "why"),
                *((line.name, line.asked.lstrip("= ") or "-", computed(line), line.why)
                  for line in self.start)]
        lines = [head, *columns(rows, width)]
        if self.solved:
            lines += ["", "Parameters solved for", *columns([
                (line.name, readable(line.used, line.unit, 8)) for line in self.solved], width)]
        return lines


def summary(assembly: Assembly, start: Start | None) -> Summary:
    """Build the summary of an assembly and of its start (None if the start was not computed or not found)."""
    flat, reduced = assembly.flat, assembly.reduced
    expanded, model = flat.expanded, assembly.model
    table = start.table if start is not None else ()
    solved_for = set(model.initial.solve)
    # a value below 1e-10 of the nominal value, such as 1e-18 m/s, is a rounding error of Newton's method
    sizes = dict(zip(assembly.state_names, assembly.x_nominal.tolist(), strict=True))
    # algebraic loops with their components; nodes are omitted if the loop contains components
    loops = [AlgebraicLoop(tuple(o for o in loop.equations if o in expanded.leaves) or tuple(loop.equations), loop.torn,
                           loop.left) for loop in reduced.loops]
    differentiated = []
    for i, times in reduced.differentiated:
        equation = flat.equations[i]
        differentiated.append(Differentiation(equation.owner, _one_space(equation.text), times, equation.place.file,
                                              equation.place.line))
    machines = []
    for path, leaf in expanded.leaves.items():
        if states := leaf.component.states:
            held = next(h for h in flat.held if h.name == f"{path}.{STATE}")  # the number of the initial state
            machines.append(f"{path} begins in '{states[int(assembly.p[held.index]) - 1].name}' of "
                            f"{listing(state.name for state in states)}")
    return Summary(
        model=model.name, summary=model.summary, files=tuple(map(path_text, model.files)),
        components=_by_kind(assembly, composite=False), blocks=_by_kind(assembly, composite=True),
        nodes=tuple(expanded.junctions), circuits=circuits(flat),
        media=tuple(_medium(assembly, medium) for medium in expanded.media),
        sheets=tuple(f"{path} ({expanded.leaves[path].component.name}) gives {listing(takers, 8)}"
                     for path, takers in expanded.sheets.items()),
        equations=len(flat.equations), unknowns=len(flat.unknowns),
        inputs=tuple(f"{k.name} ({k.source.column} in {k.source.file.name})" for k in flat.inputs),
        events=tuple(f"{event.name} ({event.text})" for event in flat.events), index=reduced.index,
        differentiated=tuple(differentiated),
        states=tuple(ChosenState(assembly.state_names[k], flat.unknowns[j].unit.text + (
            "" if order == 0 else "/s" if order == 1 else f"/s**{order}"), _why(assembly, (j, order)))
            for k, (j, order) in enumerate(reduced.states)),
        charts=_charts(assembly), algebraic=tuple(assembly.algebraic_names),
        loops=tuple(loops),
        start_mode=model.initial.mode or "",
        start=tuple(StartLine(line.name, line.asked, 0.0, line.unit, line.why)
                    if not line.asked and abs(line.used) < 1e-10 * sizes.get(line.name, 0.0) else line for line in table
                    if line.name not in solved_for),
        solved=tuple(line for line in table if line.name in solved_for),
        placeholders=tuple(f"{path}: {leaf.component.placeholder}" for path, leaf in expanded.leaves.items()
                           if leaf.component.placeholder),
        defaults=tuple(f"{name} = {value.text}" for name, value in expanded.defaults.items()), sampled=_sampled(assembly),
        transitions=tuple(t.text for t in assembly.update_order.transitions(assembly.p)),
        machines=tuple(machines), redundancies=tuple(loop.text for loop in flat.redundancies))


def _sampled(assembly: Assembly) -> tuple[str, ...]:
    """The sampling rates, each with its sampled components in the order of evaluation; empty for a single component."""
    events, order = assembly.flat.events, assembly.update_order
    first, period = order.instants(assembly.p)
    clocks: dict[tuple[float, float], list[str]] = {}
    for e in order.at(assembly.p).sequence:
        if events[e].period is not None:
            clocks.setdefault((float(period[e]), float(first[e])), []).append(events[e].name.rpartition(".")[0])
    irregular = [clock.text for clock in assembly.model.clocks.values()]
    if len({part for parts in clocks.values() for part in parts}) < 2:
        return tuple(irregular)
    return tuple(f"every {readable_time(every)[0]}{f' from {readable_time(begin)[0]}' if begin else ''}: "
                 f"{listing(dict.fromkeys(parts), SHOWN_NAMES)}"
                 for (every, begin), parts in sorted(clocks.items())) + tuple(irregular)


def _charts(assembly: Assembly) -> tuple[OpenChoice, ...]:
    """The states that may be exchanged during a run; empty if one choice is valid for the whole run."""
    charts, flat = StateChoices(assembly), assembly.flat
    if not charts.needed:
        return ()
    chart_list = []
    for part in charts.home.parts[::-1]:  # positions before their rates
        # a part contains the highest derivatives; states are one order lower
        states, replacements = ([assembly.reduced.name((j, order - 1)) for j, order in part.columns if
                                 ((j, order) in part.dummies) == dummy] for dummy in (False, True))
        moving = [flat.equations[i] for i in part.rows if any((i, j) in charts.home.moving for j, _ in part.columns)]
        # omit derivatives that have another name
        named = [name for name in replacements if not name.startswith("der(")] or replacements
        chart_list.append(OpenChoice(tuple(states), tuple(named), tuple(f"{e.owner}: {_one_space(e.text)}" for e in moving)))
    return tuple(chart_list)


def _by_kind(assembly: Assembly, *, composite: bool) -> dict[str, tuple[str, ...]]:
    paths_by_kind: dict[str, tuple[str, ...]] = {}
    for path, leaf in assembly.flat.expanded.leaves.items():
        if leaf.component.composite == composite:
            paths_by_kind[leaf.component.name] = (*paths_by_kind.get(leaf.component.name, ()), path)
    return paths_by_kind


def _medium(assembly: Assembly, medium: Medium) -> str:
    """The medium of a circuit and its source, without values that are formulas of other parameters."""
    values, units, leaves = assembly.parameter_values, assembly.flat.units, assembly.flat.expanded.leaves
    settings: dict[str, str] = {}
    for taker in medium.takers:
        path, _, name = taker.rpartition(".")
        property_name = leaves[path].component.parameters[name].medium
        number = values.get(f"{medium.source}.{property_name}" if medium.source else taker)
        if number is not None:
            settings.setdefault(property_name, f"{property_name} {readable(number, units[taker].text)}")
    circuit, numbers = f"the circuit of {listing(medium.nodes, 3)}", ", ".join(settings.values())
    if medium.source:
        return f"{medium.source} ({medium.kind}) fills {circuit}" + (f": {numbers}" if numbers else "")
    return f"no {medium.kind} in {circuit}; usual values for {listing(medium.takers, 6)}: {numbers}"


def _one_space(text: str) -> str:
    """Replace the spaces that align an equation in its file by single spaces."""
    return " ".join(text.split())


def _why(assembly: Assembly, state: Column) -> str:
    """The equation that contains the rate of a state, and the unknowns of differentiated equations to which it was
    preferred."""
    flat, (j, order) = assembly.flat, state
    n = len(flat.unknowns)

    def holding(level: int) -> list[FlatEquation]:
        equations = [flat.equations[i] for i, row in enumerate(flat.entries) if any(c == level * n + j for c, _ in row)]
        # the definition `v = der(x)` of a node is the least informative: prefer any other equation with the rate
        return sorted(equations, key=lambda e: e.role is EquationRole.RATE)

    using, before = holding(order + 1), holding(order)
    if using:
        words = f"{using[0].owner}: {_one_space(using[0].text)}"
    else:
        words = f"d/dt of {before[0].owner}: {_one_space(before[0].text)}" if before else "by differentiation"
    # unknowns that occur with unknown j in a differentiated equation but were not chosen as states
    states = {unknown for unknown, k in assembly.reduced.states}
    rivals: dict[str, None] = {}
    for equation, _ in assembly.reduced.differentiated:
        members = {c % n for c, _ in flat.entries[equation]}
        if j in members:
            rivals.update(dict.fromkeys(flat.unknowns[m].name for m in sorted(members - states)))
    if rivals:
        specified = order == 0 and flat.unknowns[j].name in assembly.model.initial.conditions
        words += f"; chosen before {listing(tuple(rivals), 3)}" + (", as its initial value is asked for" if specified
                                                                   else "")
    return words
