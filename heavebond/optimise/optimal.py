"""The best input: free signals of a diagram that minimise a cost within limits, whatever the controller.

The law of each free signal is replaced by a function of time. Collocation of the remaining equations (see `collocation`)
gives this function, and a run of the same equations with this input verifies it: cost and limits are evaluated in the
run, and its outputs are compared with the outputs of the collocation. The result is the bound that no controller of this
signal can surpass, also one that knows the future; it is a local optimum if the problem is not convex.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import Problem, SimulationError, UsageError, listing, suggest
from heavebond.core.presentation import brief
from heavebond.core.progress import Progress
from heavebond.core.quantities import ranges, si_value
from heavebond.core.units import Range, read_unit
from heavebond.equations.flatten import Flat, flatten, unclocked
from heavebond.equations.reduce import reduce_flattened
from heavebond.language.model import ModelOrFile
from heavebond.language.symbols import split, stack
from heavebond.linear.disturbance import freed
from heavebond.numerics.dae import Array, Assembly, assemble, build
from heavebond.numerics.forcing import Forcing
from heavebond.numerics.inputs import pieced
from heavebond.numerics.output_times import Time, grid, seconds
from heavebond.numerics.result import Result, columns, signal_expression
from heavebond.numerics.simulator import Simulator
from heavebond.optimise.collocation import (
    COLLOCATION,
    INTEGRALS,
    SUPPORTED,
    Programme,
    Trajectory,
    Transcription,
    pieces_of,
    refined,
    times_of,
)
from heavebond.optimise.costs import Cost, read_cost, read_limit
from heavebond.optimise.sampled_values import sampled_value
from heavebond.optimise.verification import VERIFICATION
from heavebond.records.saved_runs import SavedRun

STARTS = ("diagram", "periodic")
INTERPOLATIONS = ("linear", "hold")
SOLVED = ("Solve_Succeeded", "Solved_To_Acceptable_Level")


@dataclass(frozen=True)
class OptimalConstants:
    """The constants of the verification of an optimal input.

    points: output points of the verifying run for each interval. Origin: integrals by trapezoids to 1e-4. Doubled: time.
    agrees: difference of an output between collocation and run, root mean square over its range, and of the cost, over its
        size, up to which the run confirms the collocation. Origin: the width of a line in a plot. Doubled: larger
        differences pass.
    least: share of the range, or of the cost, in the diagram's own run that is the smallest range and size for this
        comparison. Origin: an input that removes a variation leaves rounding of it. Doubled: larger differences pass.
    limit: share by which a limit may be exceeded in the run. Origin: as above. Doubled: larger excesses pass.
    near_zero: cost over the diagram's own cost below which a root has too steep a derivative for the solver. Origin: its
        tolerance. Doubled: the advice appears for larger costs.
    """

    points: int = 10
    agrees: float = 0.02
    least: float = 0.5
    limit: float = 0.01
    near_zero: float = 1e-4


OPTIMAL = OptimalConstants()


@dataclass(frozen=True)
class OptimalProblem:
    """An optimal input problem: free signals with their ranges in SI, a cost, and limits, as in a `TuningProblem`.

    `begin` and `end` are the horizon in s; with a range of the `duration` in s the end is free. `start` is diagram (the
    states of the diagram's run at `begin`) or periodic (the states at the end are those at the beginning). `at_end` are
    values of signals at the end. Inputs are `linear` between `intervals` or constant (`hold`). `reference` are the values of
    the reference run for `ref(...)`. `optimal_task` makes one from text.
    """

    free: Mapping[str, Range]
    cost: str
    limits: tuple[str, ...] = ()
    begin: float | None = None
    end: float | None = None
    duration: Range | None = None
    start: str = "diagram"
    at_end: Mapping[str, str] = field(default_factory=dict)
    intervals: int = 100
    interpolation: str = "linear"
    reference: Mapping[str, float | str] | None = None


@dataclass(frozen=True)
class Optimal:
    """The optimal input and its verification.

    `cost` and `limits` (not above zero) are evaluated in the verifying `run`; `collocated` is the cost of the collocation,
    `before` the cost of the diagram with its laws. `trajectory` are the outputs and free signals of
    the collocation, `inputs` the free signals at the breaks, `diagram` the outputs of the `diagram_run`.
    `differences` are the differences of outputs between collocation and run, root mean square over their ranges. `error` is
    the largest error of an interval, `message` the status of the solver.
    """

    task: OptimalProblem
    cost: float
    collocated: float
    before: float
    limits: Mapping[str, float]
    inputs: SavedRun
    trajectory: SavedRun
    run: Result
    diagram: SavedRun
    diagram_run: Result
    differences: Mapping[str, float]
    intervals: int
    iterations: int
    error: float
    message: str
    cost_unit: str = "1"

    def __repr__(self) -> str:
        return brief(self, listing(list(self.task.free)), f"cost {self.cost:.5g} (diagram {self.before:.5g})",
                     "verified" if self.verified else f"NOT VERIFIED: {'; '.join(self.doubts)}")

    @property
    def duration(self) -> float:
        """The length of the horizon in s."""
        return float(self.inputs.time[-1] - self.inputs.time[0])

    @property
    def doubts(self) -> tuple[str, ...]:
        """Reasons why the result is not confirmed by its run."""
        worst = max(self.differences, key=lambda name: self.differences[name], default="")
        before = OPTIMAL.least * abs(self.before)
        size = max(abs(self.cost), abs(self.collocated), before, 1e-300)
        reasons = []
        if self.message not in SOLVED:
            near_zero = abs(self.collocated) < OPTIMAL.near_zero * abs(self.before)
            reasons.append(f"the solver ended with {self.message.replace('_', ' ').lower()}" + (
                " near a cost of 0, where `rms` and `deviation` have no derivative: minimise the mean square, mean(e**2)"
                if near_zero and re.search(r"\b(rms|deviation)\(", self.task.cost) else ""))
        if worst and not self.differences[worst] <= OPTIMAL.agrees:
            reasons.append(f"{worst} differs by {100 * self.differences[worst]:.2g} % of its range between collocation and "
                           "run")
        if not abs(self.cost - self.collocated) <= OPTIMAL.agrees * size:
            reasons.append(f"the cost of the run is {self.cost:.5g}; the cost of the collocation is {self.collocated:.5g}")
        reasons += [f"the run exceeds {text} by {100 * value:.2g} %" for text, value in self.limits.items()
                    if not value <= OPTIMAL.limit]
        return tuple(reasons)

    @property
    def verified(self) -> bool:
        """True if the solver converged and the run confirms cost, limits and outputs."""
        return not self.doubts


def optimal_task(free: Mapping[str, Range | str], cost: str, *, limits: Sequence[str] = (), begin: Time | None = None,
                 end: Time | None = None, duration: Range | str | None = None, start: str = "diagram",
                 at_end: Mapping[str, str] | None = None, intervals: int = 100, interpolation: str = "linear",
                 reference: Mapping[str, float | str] | None = None) -> OptimalProblem:
    """A problem for `optimal`: minimise `cost` over functions of time for the signals in `free`, such that `limits` hold.

    `begin` and `end` are the horizon; with a range `duration` its length is free. `start` is "diagram" (the states of the
    diagram's own run at the begin) or "periodic"; `at_end` prescribes variables at the end. The inputs have `intervals` on
    the first grid, with an `interpolation` that is "linear" or "hold"; `reference` are the parameters of `ref(...)`.
    `optimal_task({"controller.u": "-1 .. 1"}, "deviation(WOB)", limits=["peak(extension) < 3.8 m"], begin="24 s",
    end="36 s", start="periodic")`. Raises UsageError for a range or a time that cannot be read; `optimal` raises it for
    unknown names and wrong units.
    """
    return OptimalProblem(ranges(free), cost, tuple(limits), None if begin is None else seconds(begin, "begin"),
                          None if end is None else seconds(end, "end"),
                          None if duration is None else ranges({"duration": duration})["duration"], start,
                          dict(at_end or {}), intervals, interpolation, reference)


def optimal(model: ModelOrFile | Assembly, task: OptimalProblem, *, progress: Progress | None = None) -> Optimal:
    """Compute the input of least cost by direct collocation, and verify it by a run.

    `model` is a diagram or an Assembly (with its parameter values); `task` comes from `optimal_task` or a study. `progress`
    is called with the number of the grid. Raises UsageError for mistakes in the task and for equations that jump at events
    or have delays, and SimulationError if the diagram's own run, from which the search begins, or the verifying run fails,
    or if no input satisfies the limits.
    """
    say = progress or (lambda text: None)
    diagram_assembly = assemble(model)
    assembly, begin, end = free_assembly(diagram_assembly, task), *_horizon(diagram_assembly, task)
    costs = _costs(assembly, task)
    _check_functionals(costs)
    relevant = _check_continuous(assembly, costs, _at_end(assembly, task))
    if assembly.flat.events:  # those of blocks that no longer act on anything
        assembly = free_assembly(diagram_assembly, task, events=False)
        costs = _costs(assembly, task)
    # the first grid has a break at each kink of a function of time
    forcing: Forcing = assembly.once("forcing", lambda: Forcing(assembly))
    stops = forcing.stops(np.array([begin, end]), diagram_assembly.p).times if task.duration is None else np.zeros(0)
    breaks = np.union1d(np.linspace(begin, end, task.intervals + 1), stops[(stops > begin) & (stops < end)])
    say("the diagram's own run")
    times = times_of(breaks)
    guess = Simulator(diagram_assembly, times=np.union1d([diagram_assembly.begin], times)).run()
    p = dict(zip(diagram_assembly.parameter_names, guess.p.tolist(), strict=True))
    assembly = replace(assembly, p=np.array([p[name] for name in assembly.parameter_names]))
    references = _references(diagram_assembly, task, guess.time)
    before = cost_values(guess.assembly, guess, _costs(diagram_assembly, task), references, begin)[0]
    size = abs(before) if np.isfinite(before) and before else 1.0
    low, high = (np.array([getattr(r, side) for r in task.free.values()]) for side in ("low", "high"))
    inputs = assembly.flat.inputs
    programme = Programme(
        assembly, costs, references, low, high, task.interpolation == "hold", _at_end(assembly, task),
        relevant if task.start == "periodic" else None,
        None if task.duration is None else (task.duration.low, task.duration.high),
        pieced(replace(assembly.flat, inputs=inputs[:len(inputs) - len(task.free)]), begin, end))
    at, at_breaks = np.searchsorted(guess.time, times), np.searchsorted(guess.time, breaks)
    x, z = (rows[:, at] for rows in _guess(assembly, guess))
    w = np.clip(np.vstack([guess.si[name][at_breaks] for name in task.free]), low[:, None], high[:, None])
    results: list[Optimal] = []
    for number in range(1, COLLOCATION.rounds + 2):
        solution = Transcription(programme, breaks, (x, z, w)).solve(size, partial(_say_with_grid, say, number))
        if solution.status.startswith(("Infeasible", "Restoration")):
            raise SimulationError([Problem(
                "optimal-infeasible", f"the search found no input within the ranges of {listing(list(task.free))} that "
                "satisfies the limits and the values at the end", None, "Relax a limit, widen a range, allow more time, or "
                "give more intervals. Another start may also help: change the law of the free signal in the diagram so that "
                "the run of the diagram is near the solution.")])
        say("the verifying run")
        results.append(result := _verified(task, programme, solution, before, guess))
        say(f"grid {number}: cost {result.cost:.5g}" + "".join(f"; {doubt}" for doubt in result.doubts))
        finer = refined(solution.breaks, solution.errors, COLLOCATION.most * task.intervals)
        if result.verified or len(finer) == len(solution.breaks) or solution.status not in SOLVED:
            break
        # the next grid begins from the run, which satisfies the equations
        breaks, times = finer, times_of(finer)
        w = solution.w[:, np.searchsorted(solution.breaks, breaks, side="right") - 1] if programme.held else \
            np.array([np.interp(breaks, solution.breaks, row) for row in solution.w])
        run = Simulator(assembly, times=times, driven=pieces_of(programme, breaks, w)).run_from(solution.x[:, 0])
        x, z = run.x, run.z
    return min(results, key=lambda result: (len(result.doubts), result.cost))


def _say_with_grid(say: Progress, number: int, text: str) -> None:
    say(f"grid {number}: {text}")


def free_assembly(diagram_assembly: Assembly, task: OptimalProblem, *, events: bool = True) -> Assembly:
    """The equations with an input in place of the law of each free signal, with the parameters of the assembly, with or
    without their events; UsageError for a wrong name, unit or option."""
    problems = []
    for name, span in task.free.items():
        unknown = diagram_assembly.flat.names.get(name)
        if name in diagram_assembly.parameter_values:
            problems.append(Problem("free-parameter", f"'{name}' is a parameter, which is constant in time", None,
                                    "Tune it with `heavebond tune`; a free input is a signal, such as the output of a "
                                    "controller."))
        elif unknown is not None and diagram_assembly.flat.unknowns[unknown].unit.dimension != span.unit.dimension:
            needed = diagram_assembly.flat.unknowns[unknown].unit.text
            of_signal, of_range = ("has no unit" if text == "1" else f"is in {text}" for text in (needed, span.unit.text))
            low, high = (f"{span.unit.from_si(bound):.6g}" for bound in (span.low, span.high))
            problems.append(Problem("unit-wrong", f"{name} {of_signal}; its range {of_range}", None,
                                    f"Write for example `{low} .. {high} {needed}".removesuffix(" 1") + "`."))
        elif not span.low < span.high:
            problems.append(Problem("range-empty", f"the range of {name} is empty", None,
                                    "Write the lower limit first, for example `-1 .. 1`."))
    for subject, value, known in (("start", task.start, STARTS), ("interpolation", task.interpolation, INTERPOLATIONS)):
        if value not in known:
            problems.append(Problem("option-unknown", f"{subject}: '{value}' is unknown", None,
                                    f"Write one of {listing(known)}."))
    if not task.free:
        problems.append(Problem("free-missing", "no signal is free", None,
                                "Write for example `free: {controller.u: -1 .. 1}`."))
    if task.intervals < 2:
        problems.append(Problem("intervals-few", f"intervals: {task.intervals} is too few", None, "Write 2 or more."))
    if problems:
        raise UsageError(problems)

    def flattened(corners: Mapping[int, int]) -> Flat:
        flat = unclocked(freed(flatten(diagram_assembly.model, corners=corners), task.free, task.interpolation))
        return flat if events else replace(flat, events=(), held=())

    assembly = build(reduce_flattened(flattened))
    return replace(assembly, p=np.array([diagram_assembly.parameter_values[name] for name in assembly.parameter_names]))


def _horizon(diagram_assembly: Assembly, task: OptimalProblem) -> tuple[float, float]:
    """The horizon in s; its middle length if its end is free."""
    begin = diagram_assembly.begin if task.begin is None else task.begin
    if task.duration is not None:
        if task.duration.unit.dimension != read_unit("s").dimension:
            raise UsageError([Problem("unit-wrong", f"the duration is in {task.duration.unit.text}; s is needed", None,
                                      "Write for example `0.3 .. 2 s`.")])
        if not 0 < task.duration.low < task.duration.high:
            raise UsageError([Problem("duration-range", f"the duration {task.duration.low:g} .. {task.duration.high:g} s is "
                                      "not a rising range above 0", None, "Write for example `0.3 .. 2 s`.")])
        if diagram_assembly.flat.inputs:
            raise UsageError([Problem("duration-record", "the duration cannot be free with a measured input", None,
                                      "Give the end of the horizon instead.")])
        return begin, begin + (task.duration.low + task.duration.high) / 2
    end = task.end if task.end is not None else float(grid(diagram_assembly.model, None, None)[-1])
    if not diagram_assembly.begin <= begin < end:
        raise UsageError([Problem("evaluate-empty", f"the horizon from {begin:g} s to {end:g} s is empty or begins before "
                                  f"the run of the diagram, at {diagram_assembly.begin:g} s", None,
                                  "Give a horizon such as `evaluate: {from: 0 s, to: 10 s}`.")])
    return begin, end


def _check_functionals(costs: Sequence[Cost]) -> None:
    """UsageError for a functional that collocation does not have."""
    for cost in costs:
        for f in cost.functionals:
            if f.kind not in SUPPORTED:
                raise UsageError([Problem("cost-kind", f"{f.kind}(...) in '{cost.text}' is not available for an optimal "
                                          "input", None, f"Use {listing(SUPPORTED, 12)}.")])


def _check_continuous(assembly: Assembly, costs: Sequence[Cost], ends: Sequence[tuple[ca.SX, float, float]]) -> list[int]:
    """The states on which costs, limits and the values at the end depend; UsageError if events or delays act on these."""
    _, x, z, p, *_ = assembly.arguments
    n, n_z, flat = x.numel(), z.numel(), assembly.flat
    signals = stack([*(f.signal for cost in costs for f in cost.functionals), *(signal for signal, _, _ in ends)])
    laws = stack([assembly.ode, assembly.alg])
    unknowns = stack([x, z])

    def by(expression: ca.SX) -> NDArray[np.bool_]:
        return np.asarray(np.array(ca.DM(ca.jacobian_sparsity(expression, unknowns), 1)) != 0)

    structure, relevant = by(laws), np.asarray(by(signals).any(axis=0))
    while True:
        # an equation of a relevant state; all algebraic equations are taken as one system
        rows = np.concatenate([relevant[:n], np.full(n_z, relevant[n:].any())])
        more = np.asarray(relevant | structure[rows].any(axis=0))
        if (more == relevant).all():
            break
        relevant = more
    acting = stack([signals, *[e for e, needed in zip(split(laws), rows, strict=True) if needed]])
    columns = [reset.unknown for event in flat.events for reset in event.resets]
    reset = {assembly.reduced.states.index((j, 0)) for j in columns if j is not None and (j, 0) in assembly.reduced.states}
    held = [h for h in flat.held if ca.depends_on(acting, p[h.index])]
    if held or any(relevant[k] for k in reset):
        names = [h.name for h in held] or [assembly.state_names[k] for k in sorted(reset) if relevant[k]]
        raise UsageError([Problem(
            "optimal-events", f"events change {listing(names, 4)}: an optimal input needs equations without jumps", None,
            "Free the signal behind the sampled block or the switch, or replace that part by its continuous law.")])
    if flat.delays:
        raise UsageError([Problem("optimal-delays", f"{listing([d.name for d in flat.delays], 4)}: an optimal input cannot "
                                  "be computed for delays", None, "Replace the delay by a PadeDelay, or free the signal "
                                  "behind it.")])
    return [k for k in range(n) if relevant[k]]


def _at_end(assembly: Assembly, task: OptimalProblem) -> list[tuple[ca.SX, float, float]]:
    """The signals, values in SI and sizes under `at_end`."""
    prescribed, flat = [], assembly.flat
    for name, text in task.at_end.items():
        if name not in flat.names:
            raise UsageError([Problem("signal-unknown", f"at_end: '{name}' is not a variable of this diagram", None,
                                      suggest(name, flat.names) or "`heavebond check` lists the variables.")])
        unknown = flat.unknowns[flat.names[name]]
        value = si_value(text, unknown.unit.text, f"at_end: {name}")
        prescribed.append((assembly.express(flat.levels[0][flat.names[name]]), value, unknown.nominal))
    return prescribed


def _costs(assembly: Assembly, task: OptimalProblem) -> list[Cost]:
    return [read_cost(assembly, task.cost), *(read_limit(assembly, text) for text in task.limits)]


def _references(diagram_assembly: Assembly, task: OptimalProblem, times: Array) -> list[Array]:
    """The functionals of each cost in the reference run, for `ref(...)`."""
    costs = _costs(diagram_assembly, task)
    if not any(any(cost.references) for cost in costs):
        return [np.zeros(len(cost.functionals)) for cost in costs]
    run = Simulator(diagram_assembly, times=times).run(task.reference or {})
    return [_functionals(run.assembly, run, cost, diagram_assembly.begin if task.begin is None else task.begin)
            for cost in costs]


def _guess(assembly: Assembly, run: Result) -> tuple[Array, Array]:
    """States and algebraic unknowns of the equations with free inputs along the diagram's own run; unknowns that it does not
    have stay at their nominal sizes."""
    known = run.signals([n for n in (*assembly.state_names, *assembly.algebraic_names) if n in run.assembly.flat.names])

    def rows(names: list[str], sizes: Array) -> Array:
        values = [known[n] if n in known else np.full(len(run.time), size) for n, size in zip(names, sizes, strict=True)]
        return np.array(values).reshape(len(names), len(run.time))

    return rows(assembly.state_names, assembly.x_nominal), rows(assembly.algebraic_names, assembly.z_nominal)


def _functionals(assembly: Assembly, run: Result, cost: Cost, begin: float) -> Array:
    """The functionals of a cost in a run, by trapezoids between its output points."""
    inside = run.time >= begin
    time = run.time[inside]
    if not cost.functionals:
        return np.zeros(0)
    along = ca.Function("signals", list(assembly.arguments), [stack([f.signal for f in cost.functionals])])
    signals = np.array(along(*columns(run))).reshape(len(cost.functionals), -1)[:, inside]
    values = []
    for f, signal in zip(cost.functionals, signals, strict=True):
        if f.kind == "final":
            values.append(signal[-1])
        elif f.kind in INTEGRALS:
            total = float(np.trapezoid(signal ** INTEGRALS[f.kind], time))
            length = time[-1] - time[0]
            values.append(total if f.kind == "integral" else total / length if f.kind == "mean" else (total / length)**0.5)
        else:
            kind = "largest" if f.kind == "peak" else f.kind
            values.append(sampled_value(kind, time, signal, np.zeros((0, len(time))))[0])
    return np.array(values)


def cost_values(assembly: Assembly, run: Result, costs: Sequence[Cost], references: Sequence[Array], begin: float
                ) -> list[float]:
    """The cost and the limits in a run; the costs are read from its assembly."""
    values = []
    for cost, reference in zip(costs, references, strict=True):
        inner = np.where(np.array(cost.references, dtype=bool), reference, _functionals(assembly, run, cost, begin))
        values.append(float(cost.value(inner, run.p)))
    return values


def _verified(task: OptimalProblem, programme: Programme, solution: Trajectory, before: float, own_run: Result) -> Optimal:
    """The result, from a run with the input of the collocation."""
    assembly, breaks = programme.assembly, solution.breaks
    between = (breaks[:-1, None] + np.diff(breaks)[:, None] * np.arange(OPTIMAL.points) / OPTIMAL.points).ravel()
    times = np.union1d(np.union1d(between, solution.times), breaks)
    pieces = pieces_of(programme, breaks, solution.w)
    run = Simulator(assembly, times=times, driven=pieces).run_from(solution.x[:, 0])
    costs = cost_values(assembly, run, programme.costs, programme.references, float(breaks[0]))
    outputs = list(assembly.model.show) or assembly.state_names
    names = list(dict.fromkeys([*outputs, *task.free]))
    along = ca.Function("outputs", list(assembly.arguments), [stack([signal_expression(assembly, n) for n in names])])
    values = np.array(along(solution.times[None, :], solution.x, solution.z, assembly.p, pieces.at(solution.times), 1.0))
    units = {name: run.unit(name) for name in names}
    trajectory = SavedRun(assembly.model.name, solution.times, dict(zip(names, values, strict=True)), units)
    inside = own_run.time >= breaks[0]
    diagram_signals = own_run.signals(names)
    diagram = SavedRun(assembly.model.name, own_run.time[inside], {n: v[inside] for n, v in diagram_signals.items()}, units)
    at = np.searchsorted(run.time, solution.times)
    differences = {}
    for name, simulated in run.signals(outputs).items():
        collocated = trajectory.values[name]
        size = max(float(np.ptp(collocated)), OPTIMAL.least * float(np.ptp(diagram.values[name])),
                   VERIFICATION.held_share * float(np.abs(collocated).max()), 1e-300)
        differences[name] = float(np.sqrt(np.mean((simulated[at] - collocated)**2))) / size
    collocated_cost = float(programme.costs[0].value(np.where(
        np.array(programme.costs[0].references, dtype=bool), programme.references[0], solution.values[0]), assembly.p))
    inputs = SavedRun(assembly.model.name, breaks, {name: task.free[name].unit.from_si(row) for name, row in
                                                    zip(task.free, solution.w, strict=True)},
                      {name: task.free[name].unit.text for name in task.free})
    return Optimal(task, costs[0], collocated_cost, before, dict(zip(task.limits, costs[1:], strict=True)), inputs,
                   trajectory, run, diagram, own_run, differences, len(breaks) - 1, solution.iterations,
                   float(solution.errors.max(initial=0.0)), solution.status, programme.costs[0].unit)
