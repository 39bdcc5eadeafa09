"""Runs for searches: measured inputs are looked up by time inside the equations.

`Simulator` stops at every sample and gives the integrator a new polynomial piece of each input, which takes three to six
times as many steps as the motion requires. Here the pieces are a table over time within the equations. The integrator
(CVODES if there are no algebraic unknowns, with fewer evaluations a step than IDAS) steps over the samples under its error
control. Results of a search are reported from runs of `Simulator`.

If a C compiler is present, a compiled program calls CVODES and evaluates the equations (see `compiled_cvodes`): two to
four times as fast for a machine of few states.

The integrator stops at every jump of an input (`interpolation: hold`). Multistep methods begin each stretch with their
lowest order and shortest steps. If that takes many evaluations a sample and nothing is compiled, a one-step method is used
instead, which needs one or two steps.
"""

from __future__ import annotations

import time as clock
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from heavebond.core.cancellation import check
from heavebond.core.errors import Problem, SimulationError
from heavebond.equations.buffered import Buffered
from heavebond.numerics import compiled_cvodes, idas
from heavebond.numerics.compiled_cvodes import (
    CVODES,
    CompiledCvodes,
    Driving,
    Equations,
    Integrated,
    LimitReached,
    Watch,
    scaled_equations,
)
from heavebond.numerics.dae import Array, Assembly, Size
from heavebond.numerics.idas import in_unit_of_time, time_unit
from heavebond.numerics.initialise import Start, Tangent, renamed_start
from heavebond.numerics.physical_limits import check_limits, check_margins, limited
from heavebond.numerics.result import Probe, Result
from heavebond.numerics.simulator import Simulator
from heavebond.numerics.solvers import CVODES_SHARE, Choice, Integrator, integrator, solver_options
from heavebond.numerics.time_events import clocks_at
from heavebond.numerics.trace import Trace


@dataclass(frozen=True)
class SearchRunConstants:
    """The constants of the runs of searches (fits and diagnoses), which step over the samples of the records.

    max_steps: steps between two samples after which a candidate is given up. Origin: a bound on the time of a hopeless
        candidate. Doubled: hopeless candidates take twice as long.
    max_steps_exact: the same in final runs of a candidate. Origin: ten times the value of the search. Doubled: as above.
    longest_step: longest step, in samples of the inputs. Origin: from rest an integrator would step over a short motion, and
        the lengths of unlimited steps depend on the parameters, which makes the sum of squares rough. Doubled: fewer
        evaluations, a rougher sum of squares.
    one_step_from: evaluations between two samples from which a one-step method costs less. Origin: each of its steps takes
        eight and a Jacobian. Doubled: some runs take longer, with the same result.
    one_step_tolerance: factor on its tolerances. Origin: its steps end at the samples, so that it errs by far less than
        allowed. Doubled: errors up to the tolerance asked for.
    """

    max_steps: int = 2000
    max_steps_exact: int = 20_000
    longest_step: int = 2
    one_step_from: int = 20
    one_step_tolerance: float = 10.0


SEARCH_RUNS = SearchRunConstants()
# Inputs that need no new start of the integration at their samples: at a kink of the input the error control shortens a step
# or two, and the runs are as exact as over splines in half of the time.
CONTINUOUS = ("spline", "linear")


class Unexplained(Simulator):
    """A `Simulator` for one candidate among many: it gives up early, and does not search for the reason of a failure, which
    would cost further runs. If the compiled program can integrate its equations, it is used, with the share `CVODES_SHARE`
    of the requested tolerances."""

    looks_between = False  # only its samples are compared
    most_steps = SEARCH_RUNS.max_steps_exact
    share = CVODES_SHARE  # of the tolerances asked for, with which the compiled program integrates

    def __init__(self, *given: Any, probe: Probe | None = None, among: Sequence[str] = (), like: Simulator | None = None,
                 **named: Any):
        """`probe` are the signals that `measured` gives. The compiled program has derivatives by all parameters `among`,
        which include the sensitivities: simulators with equal equations share one list of operations. The integrator is
        taken from the simulator `like` if it is of the same kind; its start is the one that the first start follows."""
        self.probe, self.among = probe, among
        of = like.driver if isinstance(like, Unexplained) and type(like) is type(self) else None
        self.method = None if of is None else of.method
        self.driver: CompiledCvodes | None = None
        self._last: tuple[Array, Start, Tangent | None] | None = None  # what was felt, and the start with it
        self._whole: Integrated | None = None  # the first run of `measured` with its states, which set the sizes of all
        self._measured = False
        super().__init__(*given, like=like, **named)
        if isinstance(like, Unexplained) and (known := like.begun or like.near) is not None:
            self.near = renamed_start(known, like.assembly, self.assembly)

    @property
    def looks_up(self) -> bool:
        """Whether inputs are looked up in the equations."""
        inputs = self.assembly.flat.inputs
        return self._may_look_up and bool(inputs) and self.factors is None and \
            all(k.source.interpolation in CONTINUOUS for k in inputs)

    @property
    def _may_look_up(self) -> bool:
        return self.compiled

    @property
    def compiled(self) -> bool:
        """Whether the compiled program integrates the equations."""
        return self.equations is not None

    @cached_property
    def equations(self) -> Equations | None:
        """The equations of the compiled program; None if it cannot integrate them."""
        assembly = self.assembly
        if assembly.flat.events or assembly.flat.delays or self.charts.needed or self.quadratures is not None \
                or compiled_cvodes.program() is None \
                or len(self.sensitivities) > len(self.parameters):
            return None
        moving = tuple(self._differentiated(assembly)) if self.sensitivities else ()
        # each set has a list of its own: over a kink the roundings of another order of operations would be seen, and what
        # a candidate gets would depend on what was made before
        key = ("compiled", self.probe.names if self.probe is not None else (), moving, self.begin)
        return assembly.once(key, lambda: scaled_equations(
            assembly, ca.SX(0, 1) if self.probe is None else self.probe.signals, moving, self.begin,
            looked=limited(assembly).margins))

    def _differentiated(self, assembly: Assembly) -> list[int]:
        """The parameters (indices) by which the compiled program's list has derivatives."""
        names = set(self.among)
        return sorted({*self._moving(assembly), *(k for k, name in enumerate(assembly.parameter_names) if name in names)})

    @property
    def _cut(self) -> bool:
        return self.equations is None and super()._cut

    def prepare(self) -> None:
        self.__dict__.pop("integrator", None)
        if self.equations is None or len(self.stops) < 2:
            super().prepare()
            return
        self.solver = Choice("cvodes", "driven by compiled code")
        tolerances = self.tolerances.scaled(self.share)
        self.driver = CompiledCvodes(self.equations, len(self.sensitivities), self.stops - self.begin, tolerances,
                                     self.most_steps, self._driving(), self._longest(),
                                     self.method if self.driver is None else self.driver.method,
                                     limited(self.assembly).graces)

    def _integrator(self) -> Integrator:
        name = "idas" if self.equations is not None else self.solver.name
        return integrator(name, self.integrand, self.stops - self.begin, self.tolerances, self.most_steps)

    def _driving(self) -> Driving:
        """The inputs, for the compiled program."""
        stops, kinks = self.stops - self.begin, self.kinks - self.begin
        if self.looks_up:
            return Driving(self.pieces.breaks - self.begin, self.pieces.columns, self.pieces.at(self.stops), False, kinks)
        between = self.pieces.at((self.stops[:-1] + self.stops[1:]) / 2)
        return Driving(stops, between, self.pieces.at(self.stops), between.size > 0, kinks)

    def _longest(self) -> float:
        """The longest step, in s, over inputs that are looked up and prescribed functions of time; 0 for no limit."""
        looked_up = SEARCH_RUNS.longest_step * float(np.median(np.diff(self.pieces.breaks))) if self.looks_up else 0.0
        return min((step for step in (looked_up, self.longest, self.largest) if step), default=0.0)

    def measured(self, parameters: Mapping[str, float], watch: Watch | None = None) -> tuple[Array, Array]:
        """The signals of the probe (k, N) along a run and their derivatives by the sensitivities (m, k, N). The compiled
        program calls `watch` from time to time with the number of output times passed before and the signals (k, n) at the
        output times since; an exception that it raises ends the run."""
        assert self.probe is not None
        check()
        with self._turn:
            began = clock.perf_counter()
            assembly, first, start_tangent = self._started(parameters)
            if self._limit_steps(first.p, first.x):  # of a pulse whose time is free
                self._renew()
            measured = self._signals(first, start_tangent, watch)
            if (whole := self._whole) is not None and not self.assembly.sizes:
                self._whole = None
                sizes = self._fitting_sizes(assembly, first, start_tangent, self._states(whole)).sizes
                # a search keeps them for its other runs, where a single state may not stay as small
                if not sizes.keys() >= {*assembly.state_names}:
                    sizes = {name: size for name, size in sizes.items() if size.origin}
                if sizes:
                    self._take_sizes(sizes)
                    assembly, first, start_tangent = self._started(parameters)
                    measured = self._signals(first, start_tangent, watch)
            if measured is None:
                result = self._result(assembly, first, start_tangent, began, lambda: self._started(parameters))
                sensitivities = self.probe.sensitivities(result) if start_tangent is not None else np.zeros((0, 0, 0))
                return self.probe.values(result), sensitivities
            return measured[:, 0].T, np.ascontiguousarray(np.moveaxis(measured[:, 1:] / self._sizes(start_tangent)[:, None],
                                                                      0, -1))

    def _started(self, parameters: Mapping[str, float | str] | None, before: Start | None = None
                 ) -> tuple[Assembly, Start, Tangent | None]:
        """As `Simulator`, but the start is solved again only if a parameter on which it depends has changed, and it then
        follows the last start."""
        assembly = self.assembly.with_parameters(parameters) if parameters else self.assembly
        equations = self.start_equations
        p = clocks_at(assembly, float(self.time[0]), assembly.p)
        felt = np.concatenate([p[equations.felt], self.pieces.at(self.time[:1]).ravel()])
        if self._last is not None and np.array_equal(felt, self._last[0]):
            _, first, start_tangent = self._last
            p = clocks_at(assembly, first.t, assembly.p.copy())
            p[equations.solved_for] = first.p[equations.solved_for]
            return assembly, replace(first, p=p), start_tangent
        _, first, start_tangent = super()._started(parameters, before)
        self._last, self.near = (felt, first, start_tangent), first
        return assembly, first, start_tangent

    def _signals(self, first: Start, start_tangent: Tangent | None, watch: Watch | None = None) -> Array | None:
        """The signals of the probe at the output times, with their moves along the directions (N, 1 + m, k), by the
        compiled program; None if that does not serve."""
        if self.driver is None:
            return None
        def at_outputs(first_new: int, signals: Array) -> None:
            assert watch is not None
            begin, end = np.searchsorted(self._keep, (first_new, first_new + len(signals)))
            watch(int(begin), signals[self._keep[begin:end] - first_new].T)

        try:
            whole = self._compiled(self.driver, first, start_tangent, not self._measured, watch and at_outputs)
            self._whole, self._measured = None if self._measured else whole, True
        except RuntimeError as error:
            check()
            if self.driver.equations.n_z:
                return None
            raise self._failure(self.assembly, first, str(error)) from None
        signals_at_outputs = whole.signals[self._keep]
        if not np.all(np.isfinite(signals_at_outputs)):
            raise self._failure(self.assembly, first, "a value became infinite or not a number")
        return signals_at_outputs

    def _compiled(self, driver: CompiledCvodes, first: Start, start_tangent: Tangent | None, states: bool,
                  watch: Watch | None = None) -> Integrated:
        """A run by the compiled program; RuntimeError if it fails."""
        x0, nominal = self.assembly.scaled_x(first.x), self.assembly.x_nominal[:, None]
        directions = self.along if start_tangent is None else start_tangent.p
        if start_tangent is not None:
            x0 = np.concatenate([x0, (start_tangent.x / nominal).T.ravel()])
        with self._limits(first):
            return driver.run(x0, first.z / self.assembly.z_nominal, first.p, directions, states, watch)

    @contextmanager
    def _limits(self, first: Start) -> Iterator[None]:
        """Raise LimitPassed if a variable falls below its physical limit at a step of the compiled program."""
        assembly, driver = self.assembly, self.driver
        assert driver is not None
        try:
            yield
        except LimitReached as at:
            t = np.array([self.begin + at.t])
            check_limits(Result(assembly, t, assembly.unscaled_x(at.x[:len(first.x)])[:, None],
                                (at.z * assembly.z_nominal)[:, None], self.pieces.at(t), first.p, first))
            raise
        check_margins(limited(assembly), driver.margins, self.begin)

    def attempt(self, first: Start, start_tangent: Tangent | None = None) -> Trace:
        if self.driver is None:
            return super().attempt(first, start_tangent)
        try:
            integrated = self._compiled(self.driver, first, start_tangent, True)
        except RuntimeError:
            if not self.driver.equations.n_z:
                raise
            # where the equations for z are all but singular IDAS may go on, which has them under its own control
            if len(self.kinks):
                return self._switching(self.charts).run(first, start_tangent)
            if not hasattr(self, "integrator"):
                super().prepare()
            return super().attempt(first, start_tangent)
        return self._states(integrated)

    def _states(self, integrated: Integrated) -> Trace:
        """A run of the compiled program without integrals."""
        assert self.driver is not None
        blocks = 1 + len(self.sensitivities)
        z_size = np.tile(self.assembly.z_nominal, blocks)
        return self._trace(self.assembly.unscaled_x(integrated.x, blocks), integrated.z * z_size[:, None],
                           np.zeros((0, len(self.stops))), dict(self.driver.stats()))

    def _take_sizes(self, sizes: Mapping[str, Size]) -> None:
        self._last = None
        self.__dict__.pop("integrator", None)  # with the sizes before
        super()._take_sizes(sizes)

    def _check_rates(self, assembly: Assembly, first: Start) -> None:
        """Nothing: the number of steps is limited."""

    def _failure(self, assembly: Assembly, first: Start, message: str) -> SimulationError:
        return SimulationError([Problem("integration-failed", "the integration stopped")])


class CaseSimulator(Unexplained):
    """A `Simulator` for the cases of a sweep, which have the same equations with other parameters, with integrals along the
    run; without sensitivities. The result of a run does not depend on the runs before it. `compiled` is true if the compiled
    program integrates the equations."""

    most_steps, share = idas.MOST_STEPS, 1.0
    keeps_shortest = False

    def __init__(self, *given: Any, **named: Any):
        super().__init__(*given, **named)
        if self.driver is not None:
            self.driver.method = CVODES

    @cached_property
    def equations(self) -> Equations | None:
        """The equations of the compiled program; None if it cannot integrate them."""
        assembly = self.assembly
        if assembly.flat.events or assembly.flat.delays or self.charts.needed or self.sensitivities \
                or compiled_cvodes.program() is None:
            return None
        return scaled_equations(assembly, ca.SX(0, 1), (), self.begin, self.quadratures,
                                None if self.factors is None else self.factors.symbols, limited(assembly).margins)

    def _take_sizes(self, sizes: Mapping[str, Size]) -> None:
        super()._take_sizes(sizes)
        if self.driver is not None:
            self.driver.method = CVODES

    def _limit_steps(self, p: Array, x: Array | None = None) -> bool:
        kinks = self.kinks
        super()._limit_steps(p, x)
        if self.driver is not None:
            self.driver.limit_steps(self._longest())
        return self.kinks is not kinks

    @property
    def looks_up(self) -> bool:
        """Whether inputs are looked up in the equations: factors are parameters here."""
        inputs = self.assembly.flat.inputs
        return self.compiled and bool(inputs) and all(k.source.interpolation == "spline" for k in inputs)

    @property
    def _may_be_dense(self) -> bool:
        """Whether points may be added between the stops: not where integration begins anew at each of these."""
        return not self.assembly.flat.inputs or self.looks_up

    def attempt(self, first: Start, start_tangent: Tangent | None = None) -> Trace:
        assert self.driver is not None and start_tangent is None
        n = len(first.x)
        x0 = np.append(self.assembly.scaled_x(first.x), np.zeros(self.integrals))
        p = first.p if self.factors is None else np.concatenate([first.p, self.factors.values])
        with self._limits(first):
            integrated = self.driver.run(x0, first.z / self.assembly.z_nominal, p, np.zeros((len(p), 0)))
        trace = self._trace(self.assembly.unscaled_x(integrated.x[:n]), integrated.z * self.assembly.z_nominal[:,
                                                                                                                        None],
                            integrated.x[n:], dict(self.driver.stats()))
        return replace(trace, between=(lambda: (self.stops, trace, None)) if self.dense else None)


class FitSimulator(Unexplained):
    """A `Simulator` for the runs of a fit, of which none is given up before a plain run would be."""

    most_steps = idas.MOST_STEPS


class QuickSimulator(Unexplained):
    """A `Simulator` for searches. For a diagram with events, or with inputs that have kinks or jumps at their samples, it
    differs from `Simulator` in its messages only."""

    most_steps, share = SEARCH_RUNS.max_steps, 1.0

    def __init__(self, *given: Any, like: Simulator | None = None, **named: Any):
        self.one_step: bool = isinstance(like, QuickSimulator) and like.one_step
        super().__init__(*given, like=like, **named)

    @property
    def _may_look_up(self) -> bool:
        return True

    def _driven(self, times: Array) -> dict[str, Array]:
        return {} if self.looks_up else super()._driven(times)

    def _integrator(self) -> Integrator:
        dae, looser = self.integrand.dae, SEARCH_RUNS.one_step_tolerance if self.one_step else 1.0
        solver = "rosenbrock" if self.one_step else "idas" if dae["z"].numel() else "cvodes"
        tolerances = self.tolerances.scaled(looser)
        options = {**solver_options(solver, dae, tolerances, self.integrand.smallest_pivot),
                   "max_num_steps": self.most_steps}
        stops = self.stops - self.begin
        unit = time_unit(stops)
        scaled_dae = in_unit_of_time(self._with_table() if self.looks_up else dae, unit)
        # the one-step method ends its steps at the samples of the inputs
        if longest := self.longest if self.one_step else self._longest():
            options["max_step_size"] = longest / unit
        if not dae["z"].numel():
            del scaled_dae["z"], scaled_dae["alg"]
        outputs = [float(t) for t in stops[1:] / unit] or [1.0]
        return Buffered(ca.integrator("run", solver, scaled_dae, 0.0, outputs, options), ("xf", "zf"))

    def attempt(self, first: Start, start_tangent: Tangent | None = None) -> Trace:
        stopped = bool(self.assembly.flat.inputs) and not self.looks_up and not self.compiled
        try:
            trace = super().attempt(first, start_tangent)
        except RuntimeError:
            # behind a jump of what is held CVODES may go on with the slope before it, and give up where something is quick
            if self.one_step or not stopped or self.switching is not None:
                raise
            self.one_step = True
            self.integrator = self._integrator()
            return super().attempt(first, start_tangent)
        if stopped and not self.one_step and \
                self.integrator.stats()["nfevals"] > SEARCH_RUNS.one_step_from * (len(self.stops) - 1):
            self.one_step = True
            self.integrator = self._integrator()
        return trace

    def _with_table(self) -> dict[str, ca.MX]:
        """The equations with the pieces of the inputs as a table over time."""
        dae = self.integrand.dae
        # the right sides (ode, alg) as a function of (t, x, z, p, u) that knows its Jacobian by x and z, the only derivative
        # that an integrator needs. By default CasADi differentiates the function once for each colour of columns, with its
        # parameters and inputs: five times the operations, in a run with sensitivities half of its time
        inputs, outputs = ("t", "x", "z", "p", "u"), ("ode", "alg")
        arguments, sides = [dae[k] for k in inputs], [dae[k] for k in outputs]
        before = [ca.SX.sym(f"out_{k}", dae[k].numel()) for k in outputs]
        slopes = [ca.jacobian(side, dae[k]) if k in ("x", "z") else ca.SX(side.numel(), dae[k].numel())
                  for side in sides for k in inputs]
        jacobian = ca.Function("jac_right", [*arguments, *before], slopes, [*inputs, *(f"out_{k}" for k in outputs)],
                               [f"jac_{side}_{k}" for side in outputs for k in inputs])
        right = ca.Function("right", arguments, sides, inputs, outputs, {
             "custom_jacobian": jacobian, "jac_penalty": 0, "enable_forward": False, "enable_reverse": False})
        t, x, z, p = (ca.MX.sym(k, dae[k].numel()) for k in ("t", "x", "z", "p"))
        # a spline of degree 0, because what it holds is not copied at every step
        columns, breaks = self.pieces.columns, self.pieces.breaks - self.begin
        u = ca.Function.bspline("pieces", [breaks.tolist()], columns.ravel("F").tolist(), [0], len(columns),
                                {"lookup_mode": ["binary"]})(t)
        ode, alg = right(t, x, z, p, u)
        return {"t": t, "x": x, "z": z, "p": p, "ode": ode, "alg": alg}
