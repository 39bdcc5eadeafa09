"""The simulator: a diagram's equations, an integrator and a grid of output times, built once and run with many values."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import cache, cached_property
from threading import RLock

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.core.cancellation import check
from heavebond.core.errors import HeavebondError, Problem, SimulationError, StartError, UsageError, listing
from heavebond.core.limits import RATE
from heavebond.equations.buffered import Buffered
from heavebond.language.external_functions import naming_results
from heavebond.language.sections import FIXED_STEP
from heavebond.language.symbols import stack
from heavebond.numerics.co_simulation import check_allowed
from heavebond.numerics.dae import (
    LARGE,
    Array,
    Assembly,
    Factors,
    Integrand,
    Size,
    integrand,
    newton_loops,
    other_states,
    substitute_inputs,
    summed,
)
from heavebond.numerics.delays import Delays
from heavebond.numerics.dynamic_state_selection import StateChoice, StateChoices
from heavebond.numerics.event_constants import EVENTS
from heavebond.numerics.event_integration import EventIntegration, reason, settled
from heavebond.numerics.failure_messages import Stop, check_decided, explain_failure, stop_message, stop_times
from heavebond.numerics.forcing import FORCING, Forcing
from heavebond.numerics.hidden_motions import HiddenMotions, Stretch
from heavebond.numerics.idas import Idas, caught_errors, is_large, time_unit
from heavebond.numerics.idas import Tolerances as Tolerances  # a part of this module's interface
from heavebond.numerics.initialise import Start, Tangent, start, tangent
from heavebond.numerics.inputs import Pieced, pieced
from heavebond.numerics.jumps import EventEquations
from heavebond.numerics.kinks import passed_jumps
from heavebond.numerics.looks import Looks
from heavebond.numerics.narrow_functions import NARROW, NarrowFunctions, missed
from heavebond.numerics.output_times import DENSE_POINTS, POINTS, Time, grid, largest_step_of, refined, step_of
from heavebond.numerics.physical_limits import WATCHED, check_limits, is_outside, limited
from heavebond.numerics.result import ForwardSensitivities, Result, Settle, Stayed
from heavebond.numerics.sampled_integration import SampledIntegration, sampled_integration
from heavebond.numerics.sizes import EPS, SIZES, FittingSizes, drifting, far_below, fitting_sizes, little_moved
from heavebond.numerics.solvers import (
    AUTO,
    DEFAULT,
    RETYPE,
    Choice,
    Explicit,
    Integrator,
    algebraic_left,
    chosen,
    integrator,
)
from heavebond.numerics.start_equations import Point, StartEquations
from heavebond.numerics.time_events import clocks_at, same_instant
from heavebond.numerics.time_search import rounding
from heavebond.numerics.trace import Frame, Points, Trace

ASIDE = 1e-3  # of each state's nominal size: how far from the start its stiffness is felt
COUNTED = ("nsteps", "nfevals", "netfails", "equations", "stable_step")  # of an integration, in the statistics of a run
MANY_POINTS = 10_000  # output points from which on a single run may be long enough to be compiled
LOOKED_AT = 0.02  # share of a single run that is integrated beforehand, to find out how long it will take


class Simulator:
    """An integrator built once for one grid of output times, to be run with many parameter values. Runs of several threads
    are executed one after the other."""

    def __init__(self, assembly: Assembly, until: Time | None = None, *, every: Time | None = None,
                 times: Array | None = None, tolerances: Tolerances | None = None,
                 quadratures: ca.SX | None = None, factors: Factors | None = None, sensitivities: Iterable[str] = (),
                 free_start: bool = False, like: Simulator | None = None, driven: Pieced | None = None,
                 solver: str | None = None, allow_fmu: bool = False, dense: bool = False, step: Time | None = None):
        """IDAS integrates unless another `solver` is requested, independently of the solver in the diagram; `auto` is
        resolved here (see `chosen`), while its alternatives after a failure are in `run_by_auto`. `factors` are factors in
        the quadratures; `free_start` adds the states at the first time to the sensitivities (see `run_from`); functions of
        another simulator (`like`) are reused if they apply; `driven` are inputs that replace those of records. With `dense`
        a result has points between its output points (see `Result.dense`). `step` is for solvers with a fixed step."""
        self.assembly, self._turn = assembly, RLock()
        self._sized = {tuple(sorted(assembly.sizes.items())): assembly}
        self._base_sizes, self._sized_for = dict(assembly.sizes), None
        check_allowed(assembly.flat, allow_fmu, sensitivities := tuple(sensitivities))
        self.tolerances = tolerances or Tolerances()
        self.parameters = sensitivities
        self.sensitivities = (*self.parameters, *(assembly.state_names if free_start else ()))
        # one column per name: its parameter changes by its size (1 if it is zero) times the weight, so that the error
        # control sees sensitivities of the size of the states; UsageError for a name that is not a parameter
        index = {name: k for k, name in enumerate(assembly.parameter_names)}
        along = np.zeros((len(assembly.p), len(self.parameters)))
        for column, name in enumerate(self.parameters):
            assembly.parameter_indices([name])  # UsageError for a name that cannot be set
            along[index[name], column] = self.tolerances.along * (abs(assembly.p[index[name]]) or 1.0)
        self.along = along
        self.along = np.pad(self.along, ((0, 0), (0, len(self.sensitivities) - len(self.parameters))))
        _check_delays(assembly, self.along, self.parameters)
        self.time = grid(assembly.model, until, every) if times is None else np.asarray(times, float)
        self.begin = float(self.time[0])  # from which integrators count the time
        self.largest = largest_step_of(assembly.model)
        self.pieces: Pieced = driven or (like.pieces if like is not None and self._driven_as(like) else
                                         pieced(assembly.flat, float(self.time[0]), float(self.time[-1])))
        self.quadratures, self.factors = quadratures, factors
        self.start_equations = assembly.once("start", lambda: StartEquations(assembly))
        self.integrals = 0 if quadratures is None else quadratures.numel() * (1 + len(self.sensitivities))
        self.charts = charts = StateChoices(assembly)
        self.solver: Choice = chosen(solver, assembly, charts.needed)
        fixed = self.solver.name in FIXED_STEP
        if step is not None and not fixed:
            raise UsageError([Problem("step-unused", f"{self.solver.name} chooses its steps itself; a step was specified",
                                      None, f"Specify a solver with a fixed step ({listing(FIXED_STEP)}), or leave the "
                                      "step out. `simulate: {largest_step: ...}` limits the steps of the others.")])
        self.step = step_of(assembly.model, step) if fixed else 0.0
        self.looks_between = self.looks_between and not fixed
        self.dense = dense and self._may_be_dense and not fixed
        self.asked = solver not in (None, AUTO)  # for a solver by its name
        self._felt, self.longest, self.kinks, self.unknown_forcing = None, 0.0, np.zeros(0), ()
        self._place_stops()
        self._limit_steps(assembly.p)
        self.prepare()
        self._known_slopes: dict[int, ca.Function] = {}
        self.switching = self._switching(charts) if self._cut else None

    @cached_property
    def _input_kinks(self) -> Array:
        """The breaks of measured inputs at which a multistep method begins anew; a one-step method stops at all breaks."""
        if self.solver.name not in ("idas", "cvodes"):
            return np.zeros(0)
        breaks = self.pieces.kinks()
        return np.asarray(breaks[(breaks > self.time[0]) & (breaks < self.time[-1])])

    @property
    def _may_be_dense(self) -> bool:
        """Whether points may be added between the stops."""
        return True

    @property
    def _watched(self) -> bool:
        """Whether a run without points between its output points has some to test its physical limits there. Measured inputs
        have their own, at which a method may begin anew."""
        return len(self.time) <= WATCHED and not (self.dense or self.assembly.flat.inputs) and \
            len(limited(self.assembly).unknowns) > 0

    def prepare(self) -> None:
        """Build the integrator."""
        self.integrator = self._integrator()

    longest: float  # of a step, in s; 0 for no limit
    kinks: Array  # instants at which functions of time make the integrator stop, in s
    keeps_shortest = True  # the shortest limit of the runs so far holds for all further ones
    unknown_forcing: tuple[str, ...]  # functions of time without a bound
    _felt: Array | None  # the parameters that these were found with

    def _limit_steps(self, p: Array, x: Array | None = None) -> bool:
        """Determine the stops and the longest step with which no motion of a prescribed function of time is missed, from the
        state `x` (n_x,). True if the integrator must be built again: for other stops, or for much shorter steps."""
        self.forcing: Forcing = self.assembly.once("forcing", lambda: Forcing(self.assembly))
        felt = self.forcing.felt(p, self.begin, x)
        if self._felt is not None and np.array_equal(felt, self._felt):
            return False
        before, self._felt = self.longest, felt
        stops = self.forcing.stops(self.time, p, x)
        self.unknown_forcing = stops.unknown
        shorter = stops.longest > 0 and (before == 0 or stops.longest < FORCING.renewed_below * before)
        self.longest = stops.longest if shorter or not self.keeps_shortest else before
        kinks = np.union1d(stops.times, self._input_kinks)
        stops_changed = not np.array_equal(kinks, self.kinks)
        if stops_changed:
            self.kinks = kinks
            self._place_stops()
        return shorter or stops_changed

    def _place_stops(self) -> None:
        """Merge the output times, the breaks of measured inputs and the kinks in order; a kink that differs by rounding from
        an output time or a break is replaced by it."""
        stops = np.union1d(self.time, self.pieces.inner_breaks(self.time[0], self.time[-1]))
        if len(self.kinks):
            place = np.clip(np.searchsorted(stops, self.kinks), 1, len(stops) - 1)
            near = np.where(self.kinks - stops[place - 1] < stops[place] - self.kinks, stops[place - 1], stops[place])
            same = np.abs(near - self.kinks) <= rounding(near)
            self.kinks = np.unique(np.where(same, near, self.kinks))
            stops = np.union1d(stops, self.kinks)
        self._points = len(stops)
        if self.dense and not self._cut:
            stops = refined(stops, len(self.assembly.x_nominal) * (1 + len(self.sensitivities)) + self.integrals)
        elif self._watched:
            stops = refined(stops, 1, WATCHED)
        self.stops, self._keep = stops, np.searchsorted(stops, self.time)

    def _renew(self) -> None:
        """Build the integrator again, for other stops or a shorter longest step."""
        for name in ("integrand", "loops", "_hoist"):
            self.__dict__.pop(name, None)
        self.prepare()
        self.switching = self._switching(self.charts) if self._cut else None

    @property
    def _cut(self) -> bool:
        """True if runs are integrated in stretches: a multistep method would carry its history across a kink."""
        kinked = len(self.kinks) and self.solver.name not in ("rosenbrock", *FIXED_STEP)
        return bool(self.assembly.flat.events or self.charts.needed or kinked or self.assembly.flat.delays)

    @property
    def _counts_kinks(self) -> bool:
        """Whether the last input of the integrator counts the kinks: a one-step method stops where an input changes."""
        return len(self.kinks) > 0 and self.solver.name == "rosenbrock"

    def change_to_default(self, why: str) -> None:
        """Make all further runs by IDAS."""
        self.solver = Choice(DEFAULT, why)
        self._renew()

    def change_solvers(self) -> None:
        """Change the solver at the last accepted point where one stops, in all further runs (see `EventIntegration`)."""
        self.switching = self._switching(self.charts, changes=True)

    def _switching(self, charts: StateChoices, changes: bool = False) -> EventIntegration:
        tolerances = self.solver.controlled(self.tolerances)
        delays = Delays(self.assembly, len(self.sensitivities), same_instant(float(self.stops[0]), float(self.stops[-1])),
                        tolerances.rtol, tolerances.atol) if self.assembly.flat.delays else None

        def build(name: str, made: Integrand, looks: Looks) -> Integrator:
            most = EVENTS.steps_per_check if looks.limited else EVENTS.steps_in_chart if charts.needed \
                else EVENTS.steps_ahead if len(looks.times) > 1 else EVENTS.steps_between
            return integrator(name, made, looks.grid, tolerances, most)

        def sampled() -> SampledIntegration | None:
            return sampled_integration(
                self.assembly, len(self.sensitivities), self._moving(self.assembly), self.quadratures, self.factors,
                self.begin, tolerances, EVENTS.steps_between, self.integrand.longest, self.dense,
                same_instant(float(self.stops[0]), float(self.stops[-1])))

        return EventIntegration(charts, self._framed, self.integrals, self.stops, self.inputs, build, self.solver.name,
                                changes, self.dense, np.zeros(0) if self.step else self.kinks, delays,
                                None if self.asked else sampled, self.step)

    @cached_property
    def integrand(self) -> Integrand:
        """The integrand of the simulator."""
        return self._made(self.assembly, self.quadratures)

    @cached_property
    def loops(self) -> ca.Function | None:
        """Newton's method for the algebraic unknowns; None if there are none."""
        return newton_loops(self.integrand)

    @cached_property
    def _hoist(self) -> Buffered:
        return Buffered(self.integrand.hoist)

    def _made(self, assembly: Assembly, quadratures: ca.SX | None) -> Integrand:
        augmented = summed(integrand(assembly, quadratures, len(self.sensitivities), self._moving(assembly),
                                self.begin), self.factors)
        # an integrator stops where an input changes: the last one counts the kinks
        dae = {**augmented.dae, "u": stack([augmented.dae["u"],
                                            ca.SX.sym("kinks")])} if self._counts_kinks else augmented.dae
        longest = self.step or min(self.longest or self.largest, self.largest or self.longest)
        return replace(augmented, dae=dae, longest=longest)

    def _moving(self, assembly: Assembly) -> list[int]:
        """The parameters (indices) that vary along the sensitivities, including those that depend on the start or are
        held."""
        moving = {*np.flatnonzero(self.along.any(axis=1)).tolist(), *self.start_equations.solved_for,
                  *(held.index for held in assembly.flat.held)}
        return sorted(moving)

    def _framed(self, chart: StateChoice) -> Frame:
        """The equations in the states of a chart; quadratures are given in the states of the first chart."""
        factors = ca.SX(0, 1) if self.factors is None else self.factors.symbols
        quadratures = ca.SX(0, 1) if self.quadratures is None else self.quadratures
        if chart.assembly is self.assembly:
            return Frame(chart, EventEquations(chart.assembly, quadratures, factors), self.integrand, self.loops)
        if self.solver.name == "cvodes" and chart.assembly.algebraic_names:
            raise UsageError([algebraic_left(chart.assembly.algebraic_names)])
        u = chart.assembly.arguments[4]
        raw = chart.assembly.reduced.express(ca.substitute(quadratures, self.assembly.arguments[4], u))
        quadratures = substitute_inputs(raw, self.assembly.flat, self.assembly.flat.time, u)
        dae = self._made(chart.assembly, None if self.quadratures is None else quadratures)
        return Frame(chart, EventEquations(chart.assembly, quadratures, factors), dae, newton_loops(dae))

    def _driven_as(self, like: Simulator) -> bool:
        """Whether another simulator has the same measured inputs over the same time."""
        ours, theirs = ([(k.source, k.unit.text) for k in s.assembly.flat.inputs] for s in (self, like))
        return ours == theirs and self.time[0] == like.time[0] and self.time[-1] == like.time[-1]

    def _integrator(self) -> Integrator:
        """From the first stop to the others."""
        return integrator(self.solver.name, self.integrand, self.stops - self.begin,
                          self.solver.controlled(self.tolerances))

    def _driven(self, times: Array) -> dict[str, Array]:
        """The inputs of the compiled integrators between the stops, at times between them."""
        return {"u": self.inputs(times)}

    def inputs(self, times: Array) -> Array:
        """Inputs of the integrator (k, N) at times (N,): pieces of the measured signals, factors of the quadratures, and the
        number of kinks before, if there are any."""
        rows = [self.pieces.at(times)]
        if self.factors is not None:
            rows.append(np.outer(self.factors.values, np.ones(len(times))))
        if self._counts_kinks:
            rows.append(np.searchsorted(self.kinks, times, side="right")[None, :].astype(float))
        return np.vstack(rows) if len(rows) > 1 else rows[0]

    def run(self, parameters: Mapping[str, float | str] | None = None) -> Result:
        """Simulate from the diagram's initial conditions.

        `parameters` overrides values by name, in SI or as text with a unit. Raises StartError if no consistent initial
        values exist and SimulationError if the integration fails.
        """
        check()
        began = clock.perf_counter()
        flat = self.assembly.flat
        if parameters and (flat.delays or flat.passed_through or flat.zeros) and \
                (assembly := self.assembly.with_parameters(parameters)).flat is not self.assembly.flat:
            return type(self)(assembly, times=self.time, tolerances=self.tolerances, quadratures=self.quadratures,
                              factors=self.factors, sensitivities=self.parameters, driven=self.pieces if
                              self.assembly.flat.inputs else None, allow_fmu=True, dense=self.dense).run()
        with self._turn, naming_results():
            if self.assembly.sizes != self._base_sizes and parameters != self._sized_for:
                self._take_sizes(self._base_sizes)  # sizes that fit one run are not those of another
            self._sized_for = parameters
            result = self._result(*self._started(parameters), began, lambda: self._started(parameters, self.begun))
        check()  # a signal within the last evaluation
        return result

    looks_between = True  # whether motions between the points of a run are looked for
    begun: Start | None = None  # where the last run began
    near: Start | None = None  # a start that the next one may follow
    _sized_for: Mapping[str, float | str] | None  # the parameters of the last run, which sizes were taken from

    def _started(self, parameters: Mapping[str, float | str] | None, before: Start | None = None
                 ) -> tuple[Assembly, Start, Tangent | None]:
        """The equations with these parameters, their start, and how it moves along the sensitivities. `before` is a start of
        the same equations with other sizes."""
        assembly = self.assembly.with_parameters(parameters) if parameters else self.assembly
        if assembly.flat is not self.assembly.flat and self.assembly.flat.zeros:
            raise other_states(self.assembly)
        if assembly.flat is not self.assembly.flat:
            delay = (*self.assembly.flat.delays, *self.assembly.flat.passed_through)[0]
            raise UsageError([Problem("delay-zero", "a delay becomes zero within a search, or is zero no more, and the "
                                      "equations change with it", delay.place, "Keep its range above 0 s.")])
        u = self.pieces.at(np.array([self.time[0]]))[:, 0]
        first = start(assembly, float(self.time[0]), u, self.start_equations, before or self.near)
        if before is not None:  # the steps of both: without any, the values of the diagram are exact
            first = replace(first, steps=first.steps + before.steps)
        self.begun = first
        return assembly, first, tangent(self.start_equations, first, u, self.along) if self.sensitivities else None

    def run_from(self, x: Array, parameters: Mapping[str, float | str] | None = None) -> Result:
        """One run from given states x (n_x,) in SI instead of the diagram's start; with `free_start` the sensitivities after
        those by the parameters are with respect to these states."""
        assembly = self.assembly.with_parameters(parameters) if parameters else self.assembly
        if assembly.flat.delays or not all(event.by_clock for event in assembly.flat.events):
            reason, unknown = ("delayed variables", "their history") if assembly.flat.delays else \
                ("events", "the values of held variables")
            raise UsageError([Problem("events-midway", f"a run cannot begin midway where a diagram has {reason}: {unknown} "
                                      "is not known", None, "Run it from its start.")])
        if (held := clocks_at(assembly, float(self.time[0]), assembly.p)) is not assembly.p:
            assembly = replace(assembly, p=held)
        n_x, n_z = len(assembly.x_nominal), len(assembly.z_nominal)
        steps = np.pad(self.tolerances.along * np.eye(n_x), ((0, 0), (len(self.parameters), 0)))  # of scaled states
        if not self.sensitivities:
            steps = np.zeros((n_x, 0))
        assert steps.shape == (n_x, len(self.sensitivities))
        x0 = np.concatenate([assembly.scaled_x(x), steps.T.ravel()])
        x0 = np.append(x0, np.zeros(self.integrator.size1_in("x0") - len(x0)))
        z0 = np.zeros((n_z * (1 + len(self.sensitivities)), 1))
        z0 = self._settled(x0[:, None], z0, self.integrand.hoist(assembly.p, self.along), self.stops[:1])[:, 0]
        first = Start(float(self.time[0]), x, z0[:n_z] * assembly.z_nominal, assembly.p, (), (), 0)
        start_tangent = Tangent(steps * assembly.x_nominal[:, None],
                                z0[n_z:].reshape(len(self.sensitivities), n_z).T * assembly.z_nominal[:, None], self.along)
        return self._result(assembly, first, start_tangent if self.sensitivities else None, clock.perf_counter())

    def _integrated(self, assembly: Assembly, first: Start, start_tangent: Tangent | None,
                    again: Callable[[], tuple[Assembly, Start, Tangent | None]] | None
                    ) -> tuple[Assembly, Start, Tangent | None, Trace, dict[str, object]]:
        """The trace of a run, with its equations, start and remarks. If `again` gives the start of another run, the run is
        repeated with fitting sizes while unknowns stay far below their nominal sizes, and then with stops at passages that
        its steps miss."""
        if self._limit_steps(first.p, first.x):
            self._renew()
        if is_outside(assembly, self._columns(first, self.stops[:1], first.x[:, None], first.z[:, None])):
            return assembly, first, start_tangent, self._start_only(first, start_tangent), {}
        if again is not None and (sizes := self._steep_sizes(assembly, first)):
            self._take_sizes({**self.assembly.sizes, **sizes})
            assembly, first, start_tangent = again()
        try:
            trace = self._integrate(assembly, first, start_tangent)
        except SimulationError as error:
            if again is None or not (sizes := self._sizes_before(error)):
                raise
            try:
                assembly, first, start_tangent, trace = self._repeated(sizes, again)
            except HeavebondError:  # the sizes were not the cause
                raise error from None
        remarks: dict[str, object] = {}
        if again is None:
            return assembly, first, start_tangent, trace, remarks
        hidden: Mapping[str, tuple[float, float]] = {}
        for _ in range(SIZES.max_repeats):
            fitting = self._fitting_sizes(assembly, first, start_tangent, trace)
            hidden = fitting.hidden
            if not fitting.sizes:
                break
            try:
                assembly, first, start_tangent, trace = self._repeated(fitting.sizes, again)
            except (StartError, SimulationError):  # the first run is the result, and its verdict names these unknowns
                check()
                if unfit := {name: size.value for name, size in fitting.sizes.items() if not size.origin}:
                    remarks["unfit"] = unfit
                hidden = {**hidden, **{name: (size.value, self.tolerances.rtol * abs(size.origin))
                                       for name, size in fitting.sizes.items() if size.origin}}
                break
        if hidden:
            remarks["rounded"] = hidden
        # stops at the passages of one run are not those of the next run of a search
        if self.looks_between and self.dense and (trace.stays or not is_outside(assembly, self._columns(
                first, self.stops if trace.ended is None else trace.ended, trace.x, trace.z, trace))):
            for repeats_left in reversed(range(NARROW.passes)):
                unresolved = self._stepped_over(assembly, first, trace)
                if not len(unresolved):
                    break
                if not repeats_left:
                    remarks["stepped_over"] = unresolved
                    break
                self.kinks = np.union1d(self.kinks, unresolved)
                self._place_stops()
                self._renew()
                assembly, first, start_tangent = again()
                trace = self._integrate(assembly, first, start_tangent)
        return assembly, first, start_tangent, trace, remarks

    def _repeated(self, sizes: Mapping[str, Size], again: Callable[[], tuple[Assembly, Start, Tangent | None]]
                  ) -> tuple[Assembly, Start, Tangent | None, Trace]:
        """Repeat a run with other nominal sizes of some unknowns. If it fails, the sizes, the switching with the history of
        its delays, and the reason of an earlier failure are restored."""
        before, switching, unexplained = self.assembly.sizes, self.switching, self._unexplained
        self._take_sizes({**before, **sizes})
        try:
            restarted = again()
            return *restarted, self._integrate(*restarted)
        except HeavebondError:
            self._take_sizes(before)
            self.switching, self._unexplained = switching, unexplained
            raise

    def _result(self, assembly: Assembly, first: Start, start_tangent: Tangent | None, began: float,
                again: Callable[[], tuple[Assembly, Start, Tangent | None]] | None = None) -> Result:
        """A run at the times of its outputs; see `_integrated` for `again`."""
        started = clock.perf_counter()
        with self._turn:
            assembly, first, start_tangent, whole, remarks = self._integrated(assembly, first, start_tangent, again)
        seconds = {"start": started - began, "integration": clock.perf_counter() - started}
        statistics = {"solver": self.solver.name, "why": self.solver.why, "seconds": seconds,
                      "start_steps": first.steps, **whole.statistics,
                      **({"step": self.step} if self.step else {}),
                      **({"sizes": {name: size.value for name, size in self.assembly.sizes.items()}}
                         if self.assembly.sizes else {}),
                      **remarks,
                      **({"unknown_forcing": self.unknown_forcing} if self.unknown_forcing else {})}
        if self.switching is not None and (fmus := self.switching.home.equations.partners.reports):
            statistics["fmus"] = fmus
        sizes = self._sizes(start_tangent)
        instants = whole.instants if start_tangent is None else tuple(replace(i, delays=i.delays / sizes)
                                                                      for i in whole.instants)
        n_q = self.integrals // (1 + len(self.sensitivities))

        stops, output_times, output_stops = self.stops, self.time, self._keep
        if whole.ended is not None:
            stops = whole.ended
            output_times = np.append(self.time[self.time < stops[-1]], stops[-1])
            output_stops = np.searchsorted(stops, output_times)

        def run_at(trace: Trace, times: Array, keep: NDArray[np.intp]) -> Result:
            """The run at times (n,), which are points of a trace."""

            def in_states(of: Assembly, at: NDArray[np.intp], x: Array, z: Array, stays: tuple[Stayed, ...] = ()) -> Result:
                """The run at some of these times, from x and z at all points in the states of an assembly."""
                points = slice(None) if len(at) == x.shape[1] else keep[at]
                n_x, n_z = len(of.x_nominal), len(of.z_nominal)
                along = None if start_tangent is None else ForwardSensitivities(
                    self.sensitivities, _by_direction(x[n_x:, points], sizes), _by_direction(z[n_z:, points], sizes),
                    (start_tangent.p / sizes).T, _by_direction(trace.quadratures[n_q:, points], sizes),
                    trace.held_along[..., points] / sizes[:, None, None],
                    None if trace.driven is None else trace.driven.along[..., points] / sizes[:, None, None])
                u = self.pieces.at(times[at]) if trace.driven is None else trace.driven.u[:, points]
                return Result(of, times[at], x[:n_x, points], z[:n_z, points], u, first.p, first,
                              statistics, trace.quadratures[:n_q, points], along, trace.held[:, points], instants, stays)

            other_states = ((np.flatnonzero(stay.at[keep]), stay) for stay in trace.stays)
            # a stay may pass between two output points
            stays = tuple((at, in_states(stay.assembly, at, stay.x, stay.z)) for at, stay in other_states if len(at))
            return in_states(assembly, np.arange(len(keep)), trace.x, trace.z, stays)

        def with_hidden(points: Points) -> Points:
            """The points of this run, and the points of the motions between them."""
            return points if start_tangent is not None or not self.looks_between else HiddenMotions(
                assembly, self.integrand, self.inputs, self.solver, self.tolerances, self.begin).found_in(points, first.p)

        result = run_at(whole, output_times, output_stops)
        if start_tangent is not None and (jumps := passed_jumps(result)):
            statistics["jumps"] = jumps
        if whole.between is None:
            if limited(self.assembly).unknowns:
                times, trace, _ = with_hidden((stops, whole, None))
                check_limits(result, run_at(trace, times, np.arange(len(times))) if len(times) > len(output_times) else None)
            self._check_decided(result)
            return result

        def dense() -> tuple[Result, Settle | None]:
            assert whole.between is not None
            with self._turn:
                times, trace, settle = with_hidden(whole.between())
            # the run begins with the values after the events at its start
            begin = int(np.searchsorted(times, times[0], side="right")) - 1
            points = np.arange(begin, len(times))
            return run_at(trace, times[points], points), None if settle is None else lambda at: settle(at + begin)

        result = replace(result, between=dense)
        check_limits(result)
        self._check_decided(result)
        return result

    def _fitting_sizes(self, assembly: Assembly, first: Start, start_tangent: Tangent | None, trace: Trace
                       ) -> FittingSizes:
        """Fitting sizes of unknowns for a run, if it stays far below its nominal sizes or moves little about its start."""
        stops = self.stops if trace.ended is None else trace.ended
        in_default_states = np.ones(len(stops), bool)
        reached, nominal, declared = dict[str, float](), dict[str, float](), dict[str, float]()
        lowest, highest = dict[str, float](), dict[str, float]()
        for stay in trace.stays:
            in_default_states &= ~stay.at
        for of, x, z in ((assembly, trace.x[:, in_default_states], trace.z[:, in_default_states]),
                         *((s.assembly, s.x[:, s.at], s.z[:, s.at])
                                                                                                     for s in trace.stays)):
            for names, unknowns, sizes, values in (
                    (of.state_names, of.reduced.states, of.x_nominal, x),
                    (of.algebraic_names, of.reduced.algebraic, SIZES.algebraic * of.z_nominal, z)):
                if not names:
                    continue
                if values is x and values.shape[1]:
                    for k, name in enumerate(names):
                        lowest[name] = min(lowest.get(name, np.inf), float(values[k].min()))
                        highest[name] = max(highest.get(name, -np.inf), float(values[k].max()))
                if values is x and of.x_origin.any():
                    values = np.vstack([x[:len(names)] - of.x_origin[:, None], x[len(names):]])
                largest = np.abs(values).max(axis=1, initial=0.0).reshape(-1, len(names))
                # what is zero throughout is as large as its sensitivities to a parameter's own size
                along = largest[1:].max(axis=0, initial=0.0) / self.tolerances.along
                for k, (name, (j, _)) in enumerate(zip(names, unknowns, strict=True)):
                    reached[name] = max(reached.get(name, 0.0), float(largest[0, k] or along[k]))
                    nominal[name], declared[name] = float(sizes[k]), of.flat.unknowns[j].nominal
        last = len(stops) - 1
        if self.start_equations.asks_tiny_values(first.p):  # what grows from there has to be accurate from the beginning
            last = 1 + len(stops) // 100
            early = np.abs(trace.x[:len(first.x), :last + 1]).max(axis=1)
            reached |= {name: min(reached[name], float(value))
                        for name, value in zip(assembly.state_names, early, strict=True) if value > 0}
        exact = first.steps == 0
        small = far_below(reached, nominal, declared, exact)

        def arguments_along() -> tuple[Array, ...]:
            chosen = np.unique(np.linspace(0, min(last, len(stops) - 1), SIZES.points).astype(int))
            return tuple(of[:, chosen] for of in self._columns(first, stops, trace.x, trace.z, trace))

        steps = trace.statistics.get("nsteps", len(stops))
        assert isinstance(steps, int)
        nearly_constant = little_moved(lowest, highest, exact)
        if not trace.stays:
            allowed = self.solver.controlled(self.tolerances).rtol * steps
            nearly_constant += drifting(assembly, lowest, highest, allowed, arguments_along)
        about = dict(zip(assembly.state_names, first.x.tolist(), strict=True))
        origins = {name: about[name] for name in nearly_constant if about.get(name) and name not in assembly.sizes}
        wanted = {**{name: reached[name] for name in small}, **{name: highest[name] - lowest[name] for name in origins}}
        hidden = {name: highest[name] - lowest[name] for name in nearly_constant
                  if EPS * abs(lowest[name]) > SIZES.resolved * (highest[name] - lowest[name])}
        if not wanted and not hidden:
            return FittingSizes({}, {})
        if wanted and len(stops) < SIZES.least_stops:
            times = np.linspace(stops[0], stops[-1], SIZES.least_stops)
            dense = Simulator(assembly, times=np.union1d(self.time, times), tolerances=self.tolerances, driven=self.pieces,
                              allow_fmu=True)
            try:
                if dense._limit_steps(first.p, first.x):
                    dense._renew()
                return dense._fitting_sizes(assembly, first, None, dense._integrate(assembly, first, None))
            except SimulationError:  # with the sizes that fit it before its failure
                dense_sizes = dense.run().assembly.sizes
                return FittingSizes({} if dense_sizes == assembly.sizes else dict(dense_sizes), {})
        steps = steps * last // (len(stops) - 1)
        return fitting_sizes(assembly, wanted, origins, hidden, arguments_along(), steps, self.tolerances.atol)

    def _steep_sizes(self, assembly: Assembly, first: Start) -> dict[str, Size]:
        """Sizes of algebraic unknowns whose absolute tolerance would be a large error of a rate at the start: forces on
        a body of 1 mg, for example."""
        if self.step or not len(first.z) or len(first.z) >= LARGE:
            return {}
        slopes = assembly.once("rates by algebraic unknowns", lambda: ca.Function(
            "slopes", list(assembly.arguments), [ca.jacobian(assembly.ode, assembly.arguments[2])]))
        u = self.pieces.at(np.array([first.t]))[:, 0]
        gradients = np.abs(np.array(slopes(first.t, first.x, first.z, first.p, u, 1.0))) / assembly.x_nominal[:, None]
        steepest = (gradients * min(1.0, float(self.stops[-1] - self.stops[0]))).max(axis=0, initial=0.0)
        return {name: Size(float(10.0 ** np.floor(np.log10(SIZES.steep / slope))))
                for name, slope, nominal in zip(assembly.algebraic_names, steepest, assembly.z_nominal, strict=True)
                if np.isfinite(slope) and slope * nominal > SIZES.steep}

    def _sizes_before(self, error: SimulationError) -> dict[str, Size]:
        """Sizes that fit the algebraic unknowns of a run up to its failure: far below their nominal sizes, their absolute
        tolerance is an error of the rates that no step is short enough for (forces on a body of 1 mg)."""
        if self._unexplained is None or error.problems[0].code != "integration-failed" or not self.assembly.algebraic_names:
            return {}
        stopped = self._stop_time(stop_times(self._unexplained[3]))
        if not stopped > self.begin:
            return {}
        times = self.begin + (stopped - self.begin) * SIZES.before_failure * np.linspace(0.0, 1.0, SIZES.least_stops)
        try:
            before = type(self)(self.assembly, times=times, tolerances=self.tolerances, driven=self.pieces
                                if self.assembly.flat.inputs else None, allow_fmu=True).run()
        except HeavebondError:
            return {}
        reached = dict(zip(self.assembly.algebraic_names, np.abs(before.z).max(axis=1).tolist(), strict=True))
        nominal = dict(zip(self.assembly.algebraic_names, self.assembly.z_nominal.tolist(), strict=True))
        return {name: Size(float(10.0 ** np.ceil(np.log10(value)))) for name, value in reached.items()
                if SIZES.zero * nominal[name] < value < SIZES.algebraic * nominal[name]}

    def _stepped_over(self, assembly: Assembly, first: Start, trace: Trace) -> Array:
        """The instants (n,) of narrow functions of states (see `narrow_functions`), if a run has stepped over one."""
        functions = self.assembly.once("narrow functions", lambda: NarrowFunctions(self.assembly))
        if not functions.number or trace.stays or trace.ended is not None:
            return np.zeros(0)
        times, points, _ = trace.between() if trace.between is not None else (self.stops, trace, None)
        if len(times) < NARROW.points:
            return np.zeros(0)
        n_x, n_z = len(first.x), len(first.z)
        x, z = points.x[:n_x], points.z[:n_z]
        held = [h.index for h in self.assembly.flat.held]
        p = np.tile(first.p[:, None], (1, len(times)))
        p[held] = points.held
        delays = self.assembly.flat.delays

        def inputs(at: Array) -> Array:
            return self.switching.driven(at).u if delays and self.switching is not None else self.pieces.at(at)

        passages = functions.passed(times, x, z, p, inputs)
        if not len(passages.times) or delays:
            return passages.times[~np.isin(passages.times, self.kinks)]
        plain = integrand(assembly, begin=self.begin)  # without integrals and sensitivities
        motions = HiddenMotions(assembly, plain, self.pieces.at, self.solver, self.tolerances, self.begin)
        spans = np.diff(times)[passages.after]
        for j in np.argsort(-passages.excess * spans, kind="stable")[:NARROW.most].tolist():
            k, at = int(passages.after[j]), float(passages.times[j])
            # a function at a point of the run acts in both intervals beside it
            beside = NARROW.beside * (times[k + 1] - times[k])
            if at_begin := k > 0 and at - times[k] < beside:
                k -= 1
            at_end = at_begin or (times[k + 1] - at < beside and k + 2 < len(times))
            instants = times[k:k + 3] if at_end else np.array([times[k], at, times[k + 1]])
            before, after = (Stretch(instants[i:i + 2], x[:, k:k + 2], z[:, k:k + 2], p[:, k],
                                     self.pieces.at(instants[i:i + 2].mean(keepdims=True))[:, 0], k) for i in (0, 1))
            end = motions.passes(before, after)
            if end is not None and missed(end, x[:, k + 1 + at_end], x, self.assembly.x_nominal):
                return passages.times
        return np.zeros(0)

    def _take_sizes(self, sizes: Mapping[str, Size]) -> None:
        """Integrate further runs with other sizes of some unknowns."""
        self.assembly = self._sized.setdefault(tuple(sorted(sizes.items())), self.assembly.with_sizes(sizes))
        for name in ("integrand", "loops", "_hoist", "equations"):
            self.__dict__.pop(name, None)
        self.start_equations = self.assembly.once("start", lambda: StartEquations(self.assembly))
        self.charts, self._known_slopes = StateChoices(self.assembly), {}
        self.prepare()
        if self.switching is not None:
            self.switching = self._switching(self.charts, self.switching.changes)

    def _check_decided(self, result: Result) -> None:
        """Raise SimulationError if a run continued although no equation determined an algebraic unknown, in any of its
        charts."""
        in_default_states = np.ones(len(result.time), bool)
        in_default_states[[k for at, _ in result.stays for k in at]] = False
        for part, at in ((result, np.flatnonzero(in_default_states)), *((stay, np.arange(len(stay.time))) for _,
                                                                        stay in result.stays)):
            if len(part.z) and len(at):
                assembly = part.assembly
                if id(assembly.reduced) not in self._known_slopes:
                    jacobian = ca.densify(ca.jacobian(assembly.alg, assembly.arguments[2]))
                    self._known_slopes[id(assembly.reduced)] = ca.Function("slopes", list(assembly.arguments), [jacobian])
                check_decided(part, at, self._known_slopes[id(assembly.reduced)])

    def _sizes(self, start_tangent: Tangent | None) -> Array:
        """The length of each direction, in units of its parameter (or of the state at the first time)."""
        of_parameters = np.abs(self.along).max(axis=0, initial=0.0)
        return of_parameters if start_tangent is None else np.asarray(
            np.where(of_parameters > 0, of_parameters, np.abs(start_tangent.x).max(axis=0, initial=0.0)))

    def _integrate(self, assembly: Assembly, first: Start, start_tangent: Tangent | None) -> Trace:
        if len(self.stops) == 1 and self.switching is None:
            return replace(self._start_only(first, start_tangent), ended=None)
        self._check_rates(assembly, first)
        attempt = self.attempt if self.switching is None else self.switching.run
        failed = ""
        with caught_errors() as heard:
            try:
                trace = attempt(first, start_tangent)
                failed = "" if np.all(np.isfinite(trace.x)) else "a value became infinite or not a number"
            except RuntimeError as error:
                failed = str(error)
        if failed:
            message = "".join(heard)
            check()
            if "KeyboardInterrupt" in message:  # CasADi makes it a failure of the right side
                raise KeyboardInterrupt
            raise self._failure(assembly, first, failed + "\n" + message)
        return trace if trace.between is None else replace(trace, between=cache(trace.between))  # it is needed twice

    def _start_only(self, first: Start, start_tangent: Tangent | None) -> Trace:
        """The trace of a run that ends at its start."""
        x = first.x if start_tangent is None else np.concatenate([first.x, start_tangent.x.T.ravel()])
        z = first.z if start_tangent is None else np.concatenate([first.z, start_tangent.z.T.ravel()])
        held = [h.index for h in self.assembly.flat.held]
        return Trace(x[:, None], z[:, None], np.zeros((self.integrals, 1)), first.p[held][:, None],
                     np.zeros((len(self.sensitivities), len(held), 1)), (), {}, ended=self.stops[:1])

    def _columns(self, first: Start, times: Array, x: Array, z: Array, trace: Trace | None = None) -> tuple[Array, ...]:
        """The arguments (., N) of the equations at points of a run, or of its start."""
        n = len(times)
        p = np.tile(first.p[:, None], (1, n))
        if trace is not None:
            p[[h.index for h in self.assembly.flat.held]] = trace.held
        u = self.pieces.at(times) if trace is None or trace.driven is None else trace.driven.u
        return times[None, :], x[:len(first.x)], z[:len(first.z)], p, u, np.ones((1, n))

    def _check_rates(self, assembly: Assembly, first: Start) -> None:
        """SimulationError if a state near the start changes faster than solvers can count."""
        u = self.pieces.at(np.array([first.t]))[:, 0]
        near = first.x + ASIDE * assembly.x_nominal
        rates = np.abs(np.array(assembly.rates(first.t, near, first.z, first.p, u, 1.0)[0]).ravel()) / assembly.x_nominal
        if (fast := np.flatnonzero(rates > RATE)).size:
            name = assembly.state_names[fast[0]]
            raise SimulationError([Problem(
                "rate-too-large", f"{name} would change by {rates[fast[0]]:.1g} times its nominal size a second, near the "
                f"start; up to {RATE:g} can be integrated", None, "Look for a stiffness, a gain or a mass out of range "
                "by many powers of ten. Connect rigid parts to one node.")])

    explains = True  # whether the reason is looked for as soon as a run fails: it takes further runs
    _unexplained: tuple[SimulationError, Assembly, Start, str] | None = None  # the last

    def _failure(self, assembly: Assembly, first: Start, message: str) -> HeavebondError:
        """The error of a run that failed; `message` is the message of the integrator."""
        stopped = SimulationError([Problem("integration-failed", stop_message(self._stop_time(stop_times(message))),
                                           notes=(reason(message),))])
        self._unexplained = stopped, assembly, first, message
        return self.explained(stopped) if self.explains else stopped

    def explained(self, error: HeavebondError) -> HeavebondError:
        """An error of the last run, with its reason if that was not yet determined."""
        if self._unexplained is None or self._unexplained[0] is not error:
            return error
        _, assembly, first, message = self._unexplained
        if self.solver.name != DEFAULT:
            return self._failure_by_default(assembly, first)
        with caught_errors():  # it integrates again up to there
            return explain_failure(self._stop(assembly, first, stop_times(message)), first, message, self.tolerances.rtol)

    def _stop_time(self, times: list[float]) -> float:
        """The time (s) at which the integrator failed (NaN if unknown), from the times in its message."""
        if self.switching is None or self.switching.last is None:
            return self.begin + max(times) * time_unit(self.stops - self.begin) if times else float("nan")
        return self.switching.last.time(times[-1]) if times else self.switching.last.begin.t

    def _stop(self, assembly: Assembly, first: Start, times: list[float]) -> Stop:
        """The failure of the integrator, with the state shortly before it."""
        stopped = self._stop_time(times)
        if self.switching is None or self.switching.last is None:
            return Stop(assembly, stopped, self._state_before(assembly, first, stopped))
        stretch = self.switching.last
        last, frame = self.switching.before(stretch, stopped), stretch.begin.frame
        return Stop(frame.assembly, stopped, last, frame.chart.folded(last))

    def _state_before(self, assembly: Assembly, first: Start, stopped: float) -> Point | None:
        """The state shortly before the failure, by another integration up to that time."""
        begin = float(self.time[0])
        if not np.isfinite(stopped) or stopped <= begin:
            u = self.pieces.at(np.array([begin]))[:, 0]
            return Point(begin, first.x, first.z, first.p, u, 1.0)
        for share in (1 - 1e-6, 1 - 1e-3, 0.9):
            times = np.array([begin, begin + (stopped - begin) * share])
            again = type(self)(assembly, times=times, tolerances=self.tolerances)
            try:
                trace = again.attempt(first)
            except RuntimeError:
                continue
            u = again.pieces.at(times[-1:])[:, 0]
            return Point(float(times[-1]), trace.x[:, -1], trace.z[:, -1], first.p, u, 1.0)
        return None

    def _failure_by_default(self, assembly: Assembly, first: Start) -> SimulationError:
        """The error for a failure of another solver than IDAS: the error of IDAS, or a hint that IDAS succeeds."""
        again = Simulator(assembly, times=self.time, tolerances=self.tolerances, driven=self.pieces, allow_fmu=True)
        try:
            again._integrate(assembly, first, None)
        except SimulationError as error:
            return error
        hint, stable = "", self.integrator.stats().get("stable_step") if self.step and self.switching is None else None
        if stable is not None:
            power = 10.0 ** np.floor(np.log10(0.9 * stable))
            hint = f"Its step of {self.step:g} s is beyond its limit of stability at {stable:.3g} s: type " \
                f"`--step '{np.floor(0.9 * stable / power) * power:.1g} s'` or less. "
        elif self.step:
            hint = f"Make the step shorter than {self.step:g} s. "
        return SimulationError([Problem("solver-gave-up", f"{self.solver.name} gave up where {DEFAULT} goes through", None,
                                        hint + RETYPE.format(DEFAULT) + ".")])

    def _trace(self, x: Array, z: Array, quadratures: Array, statistics: dict[str, object]) -> Trace:
        """The trace of a run without events."""
        m, n = len(self.sensitivities), x.shape[1]
        return Trace(x, z, quadratures, np.zeros((0, n)), np.zeros((m, 0, n)), (), statistics)

    def attempt(self, first: Start, start_tangent: Tangent | None = None) -> Trace:
        """Integrate from `first` over the stops; raises the integrator's RuntimeError if it fails."""
        x0, z0, p = self._scaled_start(first, start_tangent)
        assembly, n_all, n = self.assembly, len(x0), len(self.stops) - 1
        blocks = 1 if start_tangent is None else 1 + len(self.sensitivities)
        n_x, z_size = len(first.x) * blocks, np.tile(assembly.z_nominal, blocks)
        middle = (self.stops[:-1] + self.stops[1:]) / 2
        ends = self.integrator(x0=x0, z0=z0, p=p, **self._driven(middle))
        x = np.column_stack([x0, np.asarray(ends["xf"]).reshape(n_all, n)])
        raw = np.column_stack([z0, np.asarray(ends["zf"]).reshape(len(z0), n)])
        z, keep = raw.copy(), self._keep if self.dense else slice(None)
        z[:, keep] = self._settled(x[:, keep], raw[:, keep], p, self.stops[keep])

        def traced(x: Array, z: Array, statistics: dict[str, object]) -> Trace:
            return self._trace(assembly.unscaled_x(x[:n_x], blocks), z * z_size[:, None], x[n_all - self.integrals:],
                               statistics)

        def between() -> Points:
            times, states, unknowns = self._with_first_interval(first, x, raw, p)

            def settle(at: NDArray[np.intp]) -> Array:
                with self._turn:
                    values = self._settled(states[:, at], unknowns[:, at], p, times[at])
                return np.asarray((values * z_size[:, None])[:len(first.z)])

            # with sensitivities the algebraic unknowns have theirs behind them
            with_tangents = start_tangent is not None
            settled_now = self._settled(states, unknowns, p, times) if with_tangents and self.loops is not None else unknowns
            return times, traced(states, settled_now, {}), None if self.loops is None or with_tangents else settle

        statistics = {k: v for k, v in self.integrator.stats().items() if k in COUNTED}
        return replace(traced(x, z, statistics), between=between if self.dense else None)

    def _with_first_interval(self, first: Start, x: Array, z: Array, p: Array) -> tuple[Array, Array, Array]:
        """The stops (N,) with scaled states (n, N) and algebraic unknowns. The first interval is not divided in the run. If
        the states change much in it, it is integrated again with points between. It is at least a thousandth of the run:
        shorter intervals at the begin are joined."""
        assembly, stops = self.assembly, self.stops
        share = (stops[-1] - stops[0]) / POINTS
        last = max(int(np.searchsorted(stops, stops[0] + share * (1 + 1e-9), side="right")) - 1, 1)
        length = float(stops[last] - stops[0])
        u = self.pieces.at(stops[:1])[:, 0]
        rates = np.array(assembly.rates(first.t, first.x, first.z, first.p, u, 1.0)[0]).ravel() / assembly.x_nominal
        ranges, n = np.ptp(x, axis=1), len(first.x)
        moves = np.maximum(np.ptp(x[:n, :last + 1], axis=1), np.abs(rates) * length)
        between = stops[0] + length * DENSE_POINTS.shares[:-1]
        apart = np.abs(between[:, None] - stops[1:last + 1]).min(axis=1) > rounding(stops[last]) + 1e-9 * length
        times = np.union1d(stops[:last + 1], between[apart])
        if len(stops) < 3 or not np.any(moves > DENSE_POINTS.moved * ranges[:n]):
            return stops, x, z
        name = "idas" if len(z) else self.solver.name
        again = integrator(name, self.integrand, times - self.begin, self.solver.controlled(self.tolerances))
        with caught_errors():
            try:
                results = again(x0=x[:, 0], z0=z[:, 0], p=p, **self._driven((times[:-1] + times[1:]) / 2))
            except RuntimeError:
                check()
                return stops, x, z
        inner = [np.asarray(results[name]).reshape(len(of), len(times) - 1)[:, :-1] for name, of in (("xf", x), ("zf", z))]
        if not np.all(np.isfinite(inner[0])):
            return stops, x, z
        states, unknowns = (np.column_stack([of[:, :1], more, of[:, last:]])
                            for of, more in zip((x, z), inner, strict=True))
        return np.concatenate([stops[:1], times[1:-1], stops[last:]]), states, unknowns

    def _scaled_start(self, first: Start, start_tangent: Tangent | None = None) -> tuple[Array, Array, Array]:
        """x0, z0 and p of the integrator."""
        assembly = self.assembly
        x0, z0, dp = assembly.scaled_x(first.x), first.z / assembly.z_nominal, self.along
        if start_tangent is not None:
            dp = start_tangent.p
            x0 = np.concatenate([x0, (start_tangent.x / assembly.x_nominal[:, None]).T.ravel()])
            z0 = np.concatenate([z0, (start_tangent.z / assembly.z_nominal[:, None]).T.ravel()])
        # integrals begin at 0, as does what stands in where no state is
        x0 = np.append(x0, np.zeros(self.integrator.size1_in("x0") - len(x0)))
        return x0, z0, self._hoist(first.p, dp)["o0"]

    def expect(self, parameters: Mapping[str, float | str] | None = None) -> None:
        """Compile the equations before a single run if the time of its first points shows that this pays. Runs of fewer
        points are over too soon, and those with events are compiled on their way."""
        points = int(LOOKED_AT * (len(self.stops) - 1))
        integration = self.integrator
        if self._points < MANY_POINTS or self.switching is not None or is_large(self.integrand.dae) or \
                self.solver.name == "rosenbrock" or not isinstance(integration, Idas | Explicit):
            return
        try:
            _, first, start_tangent = self._started(parameters)
            stops = self.stops[:points + 1]
            trial = integrator(self.solver.name, self.integrand, stops - self.begin,
                               self.solver.controlled(self.tolerances))
            x0, z0, p = self._scaled_start(first, start_tangent)
            began = clock.thread_time()
            with caught_errors():
                trial(x0=x0, z0=z0, p=p, **self._driven((stops[:-1] + stops[1:]) / 2))
        except (HeavebondError, RuntimeError):
            return  # the run itself says what is wrong
        integration.expect((clock.thread_time() - began) * (len(self.stops) - 1) / points)

    def _settled(self, x: Array, z: Array, p: ca.DM | Array, times: Array) -> Array:
        return z if self.loops is None else settled(self.loops, x, z, p, times - self.begin,
                                                    self.inputs(times))


def _check_delays(assembly: Assembly, along: Array, names: tuple[str, ...]) -> None:
    """Raise UsageError for a sensitivity by a delay of zero, since the equations change at zero."""
    zero = assembly.flat.passed_through
    if not zero or not names:
        return
    derivatives = np.array(ca.Function("moved", [assembly.flat.p], [ca.jacobian(stack(d.delay for d in zero),
                                                                                assembly.flat.p)])(
        assembly.p)) @ along
    if (moving := np.argwhere(derivatives)).size:
        k, column = moving[0].tolist()
        raise UsageError([Problem("delay-zero", f"the delay of {zero[k].name} is 0 s, and its derivative by {names[column]} "
                                  "was asked for: a delay of zero can only grow", zero[k].place,
                                  "Give it a small delay, or leave this sensitivity out.")])


def _by_direction(values: Array, sizes: Array) -> Array:
    """Blocks of sensitivities one below the other (m n, N) as (m, n, N), per unit of each parameter."""
    m = len(sizes)
    return values.reshape(m, len(values) // m if m else 0, values.shape[1]) / sizes[:, None, None]
