"""Simulation of a diagram; the default solver `auto`: CVODES or IDAS, and the alternatives after a failure.

A diagram without algebraic unknowns is integrated by CVODES. If CVODES fails, or has stepped over a point at which a
divisor vanishes (a volume, an arm), IDAS integrates from the start. IDAS also runs all other diagrams. If IDAS fails:

1. If algebraic unknowns are pressures of nodes without oil or gas of their own volume, their flow balance may have no
   gradient (valves shut on all sides) or change more sharply than any step resolves. Each of these nodes then receives the
   component that its domain specifies under `fills:`, the oil in a short bore, and the run restarts: its pressures are
   states.
2. Otherwise the run is repeated in stretches. If a solver fails, the other one continues from the last accepted point:
   CVODES, or with algebraic unknowns IDAS with these under error control, and IDAS again if that fails.

Each change is listed in the statistics of the run, `fills` and `solver_changes`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

import casadi as ca
import numpy as np

from heavebond.core.errors import HeavebondError, Problem, SimulationError, StartError, listing
from heavebond.core.presentation import count
from heavebond.core.reporting import cancellable
from heavebond.equations.connect import connect
from heavebond.equations.parameters import formula_order
from heavebond.language.definition import Value
from heavebond.language.external_functions import naming_results
from heavebond.language.model import Model, ModelOrFile, loaded
from heavebond.language.sections import Condition
from heavebond.language.symbols import split, stack
from heavebond.numerics.dae import Assembly, assemble, at_zero
from heavebond.numerics.idas import Tolerances
from heavebond.numerics.initialise import Start, start
from heavebond.numerics.output_times import Time, with_begin
from heavebond.numerics.physical_limits import LimitPassed, resolved
from heavebond.numerics.pointwise import evaluated
from heavebond.numerics.result import Result, columns
from heavebond.numerics.run_verdict import report_verdict
from heavebond.numerics.simulator import Simulator
from heavebond.numerics.solvers import RETYPE
from heavebond.text.expression import Number

# Pressures of a filled node beyond so many usual ones (100 000 bar of oil, 1000 bar of gas) are none of a machine: a pump
# that works against a shut valve reaches them within 0.1 s.
MOST_FILLED = 1000
T = TypeVar("T")


@cancellable
def simulate(model: ModelOrFile | Assembly, until: Time | None = None, *, every: Time | None = None,
             begin: Time | None = None, parameters: Mapping[str, float | str] | None = None, also: Iterable[str] = (),
             sensitivities: Iterable[str] = (), rtol: float = 1e-8, atol: float = 1e-10,
             solver: str | None = None, step: Time | None = None, allow_fmu: bool = False) -> Result:
    """Simulate a diagram from `begin` to `until`, with an output point every `every`.

    Integrates x' = f(t, x, z), 0 = g(t, x, z) from consistent initial values; all signals of the result have shape (N,).
    Times are in s or text (`"2 min"`) and default to `simulate:` of the diagram (`from:` for `begin`, else 0 s);
    `parameters` overrides values by name, in SI or as text with a unit. `also` names positions that no equation uses;
    `sensitivities` names parameters for `result.sensitivity`. The error of each step is controlled to `rtol` and to `atol`
    times the nominal size of each unknown. `solver` is idas, cvodes, rosenbrock, auto (see `solvers` and `run_by_auto`), or
    with a fixed `step` euler, rk4 or backward-euler; by default the solver of the diagram, else auto. FMUs are executed
    with `allow_fmu` only. `model` is a diagram, the path or bundled name of one, or an Assembly, which is used without
    assembling it again.

    Warns (RunWarning) unless the verdict of the run (`result.verdict`) is clean. Raises ModelError for an invalid
    diagram, UsageError for wrong arguments or an unsuitable solver, StartError if no consistent initial values exist
    and SimulationError if the integration fails. Source: A. C. Hindmarsh et al., SUNDIALS, 2005,
    doi:10.1145/1089014.1089020.
    """
    if begin is not None:
        # a diagram or assembly (with its parameter values) whose runs begin at another time
        if not isinstance(model, Assembly):
            model = with_begin(loaded(model), begin)
        else:
            model = replace(assemble(with_begin(model.model, begin), also), p=model.p)
    assembly = assemble(model, also)
    sensitivities = tuple(sensitivities)
    assembly, parameters = with_equations_at_zero(assembly, parameters, sensitivities)
    written = assembly.model.solver
    solver_name = solver or (written.text if written else "auto")
    simulator = Simulator(assembly, until, every=every, tolerances=Tolerances(rtol, atol), sensitivities=sensitivities,
                          solver=solver_name, allow_fmu=allow_fmu, dense=True, step=step)
    simulator.expect(parameters)
    try:
        result = run_by_auto(simulator, parameters, allow_fmu) if solver_name == "auto" else _run_as_asked(simulator,
                                                                                                           parameters)
    except LimitPassed as error:
        result = resolved(error, simulator.time, lambda times, dense: Simulator(
            assembly, times=times, tolerances=simulator.tolerances, sensitivities=simulator.parameters, allow_fmu=allow_fmu,
            dense=dense, solver=solver_name if simulator.step else None, step=simulator.step or None).run(parameters))
    report_verdict(assembly.model.name, result.verdict)
    return result


def with_equations_at_zero(assembly: Assembly, parameters: Mapping[str, float | str] | None, free: Iterable[str] = ()
                           ) -> tuple[Assembly, Mapping[str, float | str] | None]:
    """An assembly and the parameters of a run of it; if a parameter of value 0 changes the equations (see `at_zero`), the
    assembly is made from the changed ones, with these parameters."""
    zeroed = at_zero(assembly.with_parameters(parameters) if parameters else assembly, free)
    return (zeroed, None) if zeroed.flat.zeros else (assembly, parameters)


def _run_as_asked(simulator: Simulator, parameters: Mapping[str, float | str] | None) -> Result:
    """A run by the requested solver; if `auto` could continue after its failure, the error mentions it."""
    try:
        return simulator.run(parameters)
    except (StartError, SimulationError) as error:
        problem = error.problems[0]
        if not _may_help(problem) or (isinstance(error, StartError) and not unfilled(simulator.assembly)):
            raise
        hint = f"{problem.hint}\n{RETYPE.format('auto')}: it continues with other equations or another solver after a " \
            "failure."
        raise type(error)([replace(problem, hint=hint.strip()), *error.problems[1:]]) from None


def run_by_auto(simulator: Simulator, parameters: Mapping[str, float | str] | None = None, allow_fmu: bool = False
                ) -> Result:
    """A run that changes its equations or its solver after a failure. If nothing succeeds, the error of the last attempt
    that integrated with filled nodes is raised, else the first error."""
    simulator.explains = False  # what helps needs no reason
    try:
        with naming_results():
            return _changed_where_it_stops(simulator, parameters, allow_fmu)
    finally:
        simulator.explains = True


def _changed_where_it_stops(simulator: Simulator, parameters: Mapping[str, float | str] | None, allow_fmu: bool) -> Result:
    if simulator.solver.provisional:
        result, why = _provisional(simulator, parameters)
        if result is not None:
            return result
        simulator.change_to_default(why)
    try:
        return simulator.run(parameters)
    except (StartError, SimulationError) as error:
        # the pressure of a node without capacity at the start may be below its limit, because nothing determines it there
        at_start = isinstance(error, LimitPassed) and error.result is not None and error.bracket[0] == error.bracket[1]
        if not _may_help(error.problems[0]) and not (at_start and unfilled(simulator.assembly)):
            raise
        first = error
    assembly = simulator.assembly.with_parameters(parameters) if parameters else simulator.assembly
    fills = unfilled(assembly)
    if not fills:
        reasoned = simulator.explained(first)
        if isinstance(first, StartError):
            raise reasoned
        simulator.change_solvers()
        try:
            return _accepted(simulator.run(parameters), fills, first)
        except HeavebondError:
            raise reasoned from None
    try:
        again = type(simulator)(filled(assembly, fills, simulator.begun), times=simulator.time,
                                tolerances=simulator.tolerances, sensitivities=simulator.parameters, allow_fmu=allow_fmu,
                                dense=simulator.dense)
        try:
            return _accepted(again.run(), fills, first)
        except SimulationError as error:
            if not _may_help(error.problems[0]):
                raise
        again.change_solvers()
        return _accepted(again.run(), fills, first)
    except HeavebondError as error:
        failed = error is not first and error.problems[0].code in ("integration-failed", "run-physical")
        raise (error if failed else simulator.explained(first)) from None


def _provisional(simulator: Simulator, parameters: Mapping[str, float | str] | None) -> tuple[Result | None, str]:
    """The run by the first solver of `auto`; None, and the reason, if IDAS must integrate it."""
    try:
        result = simulator.run(parameters)
    except SimulationError as error:
        if not _may_help(problem := error.problems[0]):
            raise
        return None, f"{simulator.solver.name} gave up: {', '.join(problem.notes) or problem.message}"
    if _passes_zero(result):
        return None, f"{simulator.solver.name} stepped over a point where a divisor vanishes"
    return result, ""


def changes_of(result: Result, states: bool = True) -> list[str]:
    """Sentences on the redundant constraints of loops and on the changes during a run: its tolerances, solver and `states`;
    filled nodes are part of its verdict."""
    sentences = [loop.text for loop in result.assembly.flat.redundancies]
    sizes = result.statistics.get("sizes")
    if isinstance(sizes, dict):
        units = {u.name: u.unit.text for u in result.assembly.flat.unknowns}
        listed = [f"{name} {size:g} {units.get(name, '')}".strip() for name, size in sizes.items()]
        sentences.append(f"repeated with absolute tolerances for the sizes that the run reached: {listing(listed, 4)}")
    for key, noun in (("solver_changes", "solver"), *((("state_changes", "states"),) if states else ())):
        changes = result.statistics.get(key, [])
        assert isinstance(changes, list)
        if changes:
            first = changes[0]
            before, after = (", ".join([first[k]] if isinstance(first[k], str) else first[k]) for k in ("before", "after"))
            sentences.append(f"{count(len(changes), 'change')} of {noun}, the first at {first['time']:.4g} s: "
                             f"{before} -> {after}")
    return sentences


def with_filled_nodes(make: Callable[[Assembly], T], assembly: Assembly, run_of: Callable[[T], Result | None],
                      free: Iterable[str] = ()) -> tuple[T, str]:
    """The result of `make`, which varies the parameters `free`, for an assembly, `at_zero` if others are 0. If a run fails
    at nodes without capacity, the result is for the assembly with these nodes filled, as in a run by `auto`, and with the
    messages on the filling. `run_of` gives one of the runs of the result, if any."""
    assembly = at_zero(assembly, free)
    try:
        return make(assembly), ""
    except (StartError, SimulationError) as error:
        nodes = unfilled(assembly)
        if not nodes or not _may_help(error.problems[0]):
            raise
        try:
            result = make(filled(assembly, nodes))
            if (run := run_of(result)) is not None:
                _accepted(run, nodes, error)
        except HeavebondError:
            raise error from None
        return result, fills_told(list(nodes), error.problems[0].message)


def fills_told(nodes: Sequence[str], why: str) -> str:
    """Sentences on volumes added at nodes without capacity: the added component, the reason `why`, and the lines to type."""
    return f"with a short bore of oil or gas on {listing(nodes)}, which store none: before, {why}. " \
        "A Volume or a Receiver there of the real size takes its place."


def _may_help(problem: Problem) -> bool:
    """True if another system or solver might succeed: not after a failure of events, or after a physical limit."""
    return not problem.code.startswith("event") and problem.code != "run-physical"


def _accepted(result: Result, fills: Mapping[str, str], why: HeavebondError) -> Result:
    """The result with the filling and its reason in its statistics. The error `why` is raised if the result is meaningless:
    a run that fails its verdict, that has stepped over a point where a volume or an arm vanishes, or that the filled volumes
    determine."""
    if result.verdict.failed or _passes_zero(result) or _decides(result, fills):
        raise why
    if not fills:
        return result
    return replace(result, statistics={**result.statistics, "fills": {
        "nodes": list(fills), "components": [f"fill_{k}" for k in range(1, 1 + len(fills))],
        "why": why.problems[0].message}})


def _passes_zero(result: Result) -> bool:
    """True if a divisor changes its sign along the run, in the default states of the diagram."""
    in_default_states = np.ones(len(result.time), bool)
    in_default_states[[k for at, _ in result.stays for k in at]] = False
    varying = result.assembly.once("varying pivots", lambda: _varying_pivots(result.assembly))
    if varying is None or not in_default_states.any():
        return False
    values, = evaluated(result.assembly, varying, columns(result, np.flatnonzero(in_default_states)))
    return bool(((values.min(axis=1) < 0) & (values.max(axis=1) > 0)).any())


def _varying_pivots(assembly: Assembly) -> ca.Function | None:
    """The divisors (k, 1) that may vary along a run; None if all depend on parameters only."""
    whole = assembly.pivots(*assembly.arguments)
    fixed = assembly.flat.places.keys()
    varying = [c for c, q in zip(split(whole), assembly.reduced.pivots, strict=True)
               if not q.derived and any(s.element_hash() not in fixed for s in ca.symvar(c))]
    return ca.Function("varying_pivots", list(assembly.arguments), [stack(varying)]) if varying else None


def _decides(result: Result, fills: Mapping[str, str]) -> bool:
    """True if a filled node far exceeds any usual pressure: a flow without an outlet accumulates in its volume."""
    assembly, domains = result.assembly, result.assembly.model.library.domains
    names = {node: f"{node}.{domains[domain].across[0]}" for node, domain in fills.items()}
    usual = {name: assembly.flat.unknowns[assembly.flat.names[name]].nominal for name in names.values()}
    return any(np.abs(values).max() > MOST_FILLED * usual[name] for name, values in result.signals(list(usual)).items())


def unfilled(assembly: Assembly) -> dict[str, str]:
    """The nodes whose pressure follows from a flow balance and is not a state, with their domains, if these have
    `fills:`."""
    flat, domains = assembly.flat, assembly.model.library.domains
    states = set(assembly.state_names)
    free = {s.element_hash() for s in split(assembly.arguments[2])}
    nodes = {}
    for group in connect(flat.expanded, formula_order(flat.expanded)).groups if free else ():
        domain = domains.get(group.domain)
        if domain is None or domain.fills is None or (name := f"{group.name}.{domain.across[0]}") in states:
            continue
        if free & {s.element_hash() for s in ca.symvar(assembly.reduced.express(flat.levels[0][flat.names[name]]))}:
            nodes[group.name] = domain.name
    return nodes


def filled(assembly: Assembly, nodes: Mapping[str, str], begun: Start | None = None) -> Assembly:
    """The assembly of the diagram with its nodes filled; their pressures begin at the values of the start (if the run has
    `begun`, of its start), if there is one."""
    flat = assembly.flat
    model = _with_guesses(assembly, nodes, begun)
    for k, (node, domain) in enumerate(nodes.items(), 1):
        fills = model.library.domains[domain].fills
        assert fills is not None
        model = model.with_component(f"fill_{k}", fills[0], {"a": node}, dict(fills[1]))
    filled_assembly = assemble(model, [u.name for u in flat.unknowns if u.role == "position"])
    known = assembly.parameter_values
    return replace(filled_assembly, p=np.array([known.get(name, value) for name,
                                                value in filled_assembly.parameter_values.items()]))


def _with_guesses(assembly: Assembly, nodes: Mapping[str, str], begun: Start | None) -> Model:
    """The diagram with the pressures of its nodes at the start as guesses, if there is a start."""
    model, flat = assembly.model, assembly.flat
    try:
        point = begun or start(assembly)
    except StartError:
        return model
    u = np.zeros(assembly.arguments[4].numel())
    values = np.array(assembly.values(point.t, point.x, point.z, point.p, u, 1.0)).ravel()
    conditions = dict(model.initial.conditions)
    for name in (f"{node}.{member}" for node, domain in nodes.items() for member in model.library.domains[domain].across):
        value, unknown = float(values[flat.names[name]]), flat.unknowns[flat.names[name]]
        if np.isfinite(value) and name not in conditions and unknown.place is not None:
            guess = Value(Number(value, unknown.unit, 0), f"{value:.6g}", unknown.place, si=True)
            conditions[name] = Condition(name, guess, True, unknown.place)
    return replace(model, initial=replace(model.initial, conditions=conditions))
