"""Adjoint sensitivity analysis: gradients of costs by any number of parameters from one backward integration.

With x' = f(t, x, z, p), 0 = g(t, x, z, p), integrals q' = r(t, x, z, p) and a cost whose change is

    dJ = s^T d(q(t_2) - q(t_1)) + e_x dx(t_2) + e_z dz(t_2) + e_p dp,

the adjoint states l and the multipliers m run from t_2 back to the start at t_0 (s is zero before t_1):

    -l' = f_x^T l + g_x^T m + r_x^T s,   0 = f_z^T l + g_z^T m + r_z^T s,   l(t_2) = e_x - g_x^T g_z^-T e_z,
    dJ/dp = int (f_p^T l + g_p^T m + r_p^T s) dt + e_p - g_p^T g_z^-T e_z + (dx(t_0)/dp)^T l(t_0).

IDAS stores every forward step and interpolates in them during the backward integration. Y. Cao, S. Li, L. Petzold and R.
Serban, Adjoint sensitivity analysis for differential-algebraic equations, 2003, doi:10.1137/S1064827501380630.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from heavebond.core.cancellation import check
from heavebond.core.errors import Problem, SimulationError, UsageError
from heavebond.language.symbols import stack
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.idas import caught_errors, in_unit_of_time, integrator_options, time_unit
from heavebond.numerics.initialise import Start, Tangent, start, tangent
from heavebond.numerics.machine_code import Evaluated
from heavebond.numerics.physical_limits import check_limits
from heavebond.numerics.result import Result, columns
from heavebond.numerics.simulator import Simulator
from heavebond.numerics.solvers import DEFAULT
from heavebond.optimise.cost_evaluation import CostSlopes, Evaluator

CHARTS = "adjoint-charts"  # code of the problem if the states change


@dataclass(frozen=True)
class AdjointConstants:
    """The constants of adjoint runs (gradients by IDAS backwards).

    multiplier_unit: unit of the multipliers, chosen so that the error control ignores them. Origin: they jump with s and
    with the inputs. Doubled: nothing.
    restart: value added to an adjoint state at a stop, which restarts IDAS without effect on the result. Origin: far below
    any state. Doubled: nothing.
    checkpoint_room: memory between checkpoints as a multiple of the steps of the first run. Origin: the repeated forward
    integration takes about as many. Doubled: memory.
    max_numbers: stored steps times unknowns. Origin: 1 GB. Doubled: twice the memory.
    tolerance_factor: factor on the weight of adjoint states in the error control. Origin: contributions to an integral
    cancel and magnify errors. Doubled: more steps.
    max_separate: integrals with a separate backward integration each. Origin: each costs a fifth of a run, and saves the run
    before. Doubled: more time.
    signed_share: share of the |integrand| that is the least assumed size of a signed integral. Origin: an integral over
    whole periods may be zero and still has a gradient. Doubled: looser errors of such gradients.
    """

    multiplier_unit: float = 1e10
    restart: float = 1e-300
    checkpoint_room: int = 2
    max_numbers: int = 60_000_000
    tolerance_factor: int = 4
    max_separate: int = 4
    signed_share: float = 1e-3


ADJOINT = AdjointConstants()


@dataclass(frozen=True)
class _Ends:
    """Gradient of a cost by its last values: states (n_x,), parameters (n_p,)."""

    x: Array
    p: Array


@dataclass(frozen=True)
class _BuiltIntegrator:
    """An integrator, its numerical parameters and the largest number of steps that it can store."""

    fixed: Array
    room: int
    integrator: Evaluated
    hoist_transposed: ca.Function


class Adjoint:
    """Costs and their gradients at runs of a simulator that integrates the quadratures of the evaluator.

    `names` are the parameters that are differentiated; those under `solve:` follow the start, all others are constants in
    the equations, so that the gradient is cheap. Each cost is scaled so that its adjoint states count in the error
    control by four times `tolerances.along`. UsageError for a dependent parameter, for a diagram with events and for
    another simulator than IDAS. A run during which the states are exchanged (`dynamic_state_selection`) has no adjoint:
    SimulationError.
    """

    def __init__(self, simulator: Simulator, evaluator: Evaluator, names: Sequence[str]):
        self.simulator, self.evaluator, self._names = simulator, evaluator, names
        assembly = self._assembly = simulator.assembly
        assembly.parameter_indices(names)  # UsageError for a name that cannot be set
        if assembly.flat.events or assembly.flat.delays:
            feature = "events" if assembly.flat.events else "delayed variables"
            raise UsageError([Problem("adjoint-events", f"a run backwards does not go through {feature}", None,
                                      "Take forward sensitivities: simulate(..., sensitivities=[...]).")])
        if simulator.solver.name != DEFAULT:
            raise UsageError([Problem("adjoint-solver", f"a run backwards is one of {DEFAULT}, and this simulator was made "
                                      f"with solver='{simulator.solver.name}'", None,
                                      f"Type Simulator(..., solver='{DEFAULT}'), or take forward sensitivities: "
                                      "simulate(..., sensitivities=[...]).")])
        self._chosen = [assembly.parameter_names.index(name) for name in names]
        self._made: dict[int, _BuiltIntegrator] = {}
        self._steps = 0
        self._last_sizes = np.zeros(0)
        z, p = assembly.arguments[2:4]
        hoisted = simulator.integrand.hoist(p, ca.SX(p.numel(), 0))
        moving = [*self._chosen, *simulator.start_equations.solved_for]
        depends = np.array(ca.which_depends(hoisted, p[moving], 1, True)) if moving else np.zeros(0, dtype=bool)
        self._kept = np.flatnonzero(depends)
        sides = (assembly.ode / ca.SX(ca.DM(assembly.x_nominal)), assembly.alg, evaluator.quadratures)
        arguments = [*assembly.arguments, evaluator.factors.symbols]
        self._by_z = ca.Function("by_z", arguments, [ca.jacobian(side, z) for side in sides])
        self._rates = ca.Function("rates", arguments, [evaluator.quadratures])
        # gradients of a sum of the last values, by x, z and p, and of the loops
        self._ends: ca.Function | None = None
        if any(f.kind == "final" for f in evaluator.functionals):
            t, x, z, p, u, rate = assembly.arguments
            weights = ca.SX.sym("w", len(self.evaluator.functionals))
            value = ca.dot(weights, stack([f.signal for f in self.evaluator.functionals]))
            self._ends = ca.Function("ends", [t, x, z, p, u, rate, weights],
                                     [*(ca.densify(ca.gradient(value, a)) for a in (x, z, p)),
                                      *(ca.densify(ca.jacobian(assembly.alg, a)) for a in (x, z, p))])

    def costs(self, run: Result, references: Array) -> list[tuple[float, Array]]:
        """Each cost of a run of the simulator and its gradient (m,).

        `references` are the functionals of the reference run. SimulationError if the backward run fails, or if the states
        change during the run.
        """
        if run.statistics.get("state_changes"):
            changes = run.statistics["state_changes"]
            assert isinstance(changes, list)
            before, after = (", ".join(changes[0][k]) for k in ("before", "after"))
            raise SimulationError([Problem(
                CHARTS, f"the states change at t = {changes[0]['time']:.6g} s; a backward run supports one choice of states "
                "only", None, "Take forward sensitivities: simulate(..., sensitivities=[...]). `tune` does so by itself.",
                (f"{before} -> {after}",))])
        self._follow_sizes()
        slopes = self.evaluator.cost_slopes(run, references)
        ends = [self._end(run, slope) for slope in slopes]
        tangents = self._start_tangents(run.start)
        # d cost / d x(t_0) (n_x, k) with parameters held, d cost / dp (n_p, k) with x(t_0) held and without `ends`
        self._steps = _steps(run.statistics)
        integrator = self._integrator(self._steps, run.p, len(slopes))
        pulls, jumps, weights = self._seeds(run, slopes, ends, integrator.integrator.size1_in("x0"))
        if not weights.any():
            x, p = np.zeros((len(run.x), len(slopes))), np.zeros((len(run.p), len(slopes)))
        else:
            by_x, by_p, _ = self._called(integrator, run.start, pulls, jumps)
            back = np.divide(1.0, weights, out=np.zeros_like(weights), where=weights > 0)
            x, p = by_x * back, by_p * back
        return [(slope.value, tangents.x.T @ x[:, k] + tangents.p.T @ (p[:, k] + slope.by_p + end.p))
                for k, (slope, end) in enumerate(zip(slopes, ends, strict=True))]

    def at(self, parameters: Mapping[str, float | str], references: Array) -> list[tuple[float, Array]]:
        """As `costs`, at parameters without a known run.

        If costs consist of few integrals, without end values that need a run, one call integrates forward and then
        backward for every integral, whatever the costs are. Raises the errors of a run.
        """
        self._follow_sizes()
        n_q = len(self.evaluator.integrated)
        told_by_a_run = self._ends is not None or self.simulator.assembly.z_nominal.size > 0 or \
            self.simulator.switching is not None
        if not self._steps or told_by_a_run or not 0 < n_q <= ADJOINT.max_separate:
            return self.costs(self.simulator.run(parameters), references)
        assembly, simulator = self.simulator.assembly.with_parameters(parameters), self.simulator
        first = start(assembly, float(simulator.time[0]), self._first_inputs(), simulator.start_equations)
        weights = ADJOINT.tolerance_factor * simulator.tolerances.along / \
            np.maximum(self._last_sizes, simulator.tolerances.atol)
        integrator = self._integrator(self._steps, first.p, n_q)
        n_all = integrator.integrator.size1_in("x0")
        pulls = np.zeros((len(simulator.stops) - 1, n_q, n_all))
        self._pull(pulls, np.hstack([np.zeros((n_q, n_all - n_q)), np.diag(weights)]))
        by_x, by_p, outcome = self._called(integrator, first, pulls, np.zeros((0, pulls.shape[0] * n_q)))
        self._steps = max(self._steps, _steps(integrator.integrator.stats()))
        run = self._result(assembly, first, np.array(outcome["xf"]).reshape(n_all, -1))
        check_limits(run)
        self._last_sizes, start_slopes = self._sizes(run), self._start_tangents(first)
        along = (start_slopes.x.T @ by_x + start_slopes.p.T @ by_p) / weights
        return [(slope.value, along @ slope.by_integral + start_slopes.p.T @ slope.by_p)
                for slope in self.evaluator.cost_slopes(run, references)]

    def _follow_sizes(self) -> None:
        """Use the nominal sizes that the simulator has adopted since (see `numerics.sizes`)."""
        if self._assembly is not self.simulator.assembly:
            steps = self._steps
            Adjoint.__init__(self, self.simulator, self.evaluator, self._names)
            self._steps = steps

    def _result(self, assembly: Assembly, first: Start, after: Array) -> Result:
        """The run of an integrator without algebraic unknowns: states and integrals (n_all, stops)."""
        simulator, n_x = self.simulator, len(first.x)
        x = np.column_stack([np.zeros(len(after)), after])
        x[:n_x, 0] = assembly.scaled_x(first.x)
        x = x[:, np.searchsorted(simulator.stops, simulator.time)]
        return Result(assembly, simulator.time, assembly.unscaled_x(x[:n_x]), np.zeros((0, x.shape[1])),
                      simulator.pieces.at(simulator.time), first.p, first, {}, x[len(after) - simulator.integrals:])

    def _first_inputs(self) -> Array:
        return self.simulator.pieces.at(self.simulator.time[:1])[:, 0]

    def _start_tangents(self, first: Start) -> Tangent:
        directions = np.eye(len(first.p))[:, self._chosen]
        return tangent(self.simulator.start_equations, first, self._first_inputs(), directions)

    def _called(self, integrator: _BuiltIntegrator, first: Start, pulls: Array, jumps: Array
                ) -> tuple[Array, Array, dict[str, Array]]:
        """Forward and backward integration from a start, with additions to the adjoint states (stops, k, n_all) and to
        the multipliers (n_z, stops * k): the adjoint states at the start in SI (n_x, k), by p (n_p, k), and the
        results of the call."""
        simulator, assembly = self.simulator, self.simulator.assembly
        n_x, n_all = len(assembly.x_nominal), pulls.shape[2]
        x0 = np.append(assembly.scaled_x(first.x), np.zeros(n_all - n_x))
        middle = (simulator.stops[:-1] + simulator.stops[1:]) / 2
        with caught_errors() as heard:
            try:
                outcome = integrator.integrator(x0=x0, z0=first.z / assembly.z_nominal, p=self._hoisted(first.p)[self._kept],
                                                u=simulator.inputs(middle), adj_xf=pulls.reshape(-1, n_all).T, adj_zf=jumps)
                by_x, by_p = np.array(outcome["adj_x0"]), np.array(integrator.hoist_transposed(first.p, outcome["adj_p"]))
                failed = "" if np.isfinite(by_x).all() and np.isfinite(by_p).all() else "a value is not a number"
            except RuntimeError as error:
                failed = str(error)
        output_text = "".join(heard)
        check()
        if failed and "KeyboardInterrupt" in output_text:  # CasADi reports it as a failure of the right side
            raise KeyboardInterrupt
        if failed:
            raise _failure(failed, output_text)
        return by_x[:n_x] / assembly.x_nominal[:, None], by_p, outcome

    def _seeds(self, run: Result, slopes: list[CostSlopes], ends: list[_Ends], n_all: int) -> tuple[Array, Array, Array]:
        """Additions to the adjoint states (stops, k, n_all) and to the multipliers (n_z, stops * k) at the stops after
        the first, a column per cost at each stop, and the weight of each cost in it."""
        simulator, k = self.simulator, len(slopes)
        nominal = simulator.assembly.x_nominal
        stops, n_q = len(simulator.stops) - 1, simulator.integrals
        pulls, jumps = np.zeros((stops, k, n_all)), np.zeros((stops, k, len(run.z)))
        weights, by_integral = np.zeros(k), np.zeros((k, n_all))
        begin = int(np.searchsorted(simulator.stops, self.evaluator.begin))
        self._last_sizes = sizes = self._sizes(run)
        for j, (slope, end) in enumerate(zip(slopes, ends, strict=True)):
            pull = end.x * nominal
            size = max(float(np.abs(slope.by_integral) @ sizes), float(np.abs(pull).max(initial=0.0)))
            weights[j] = ADJOINT.tolerance_factor * simulator.tolerances.along / size if size > 0 else 0.0
            by_integral[j, n_all - n_q:] = weights[j] * slope.by_integral
            pulls[-1, j, : len(nominal)] = weights[j] * pull
            jumps[-1, j] = weights[j] * self._multipliers(run, -1, pull, slope.by_integral)
            if begin > 0:
                jumps[begin - 1, j] = -weights[j] * self._multipliers(run, -2, 0 * pull, slope.by_integral)
        self._pull(pulls, by_integral)
        return pulls, jumps.reshape(stops * k, -1).T, weights

    def _pull(self, pulls: Array, by_integral: Array) -> None:
        """Add the contributions of integrals (k, n_all): from the begin of the evaluated time to its end."""
        begin = int(np.searchsorted(self.simulator.stops, self.evaluator.begin))
        pulls[-1] += by_integral
        if begin > 0:
            pulls[begin - 1] -= by_integral
        if self.simulator.pieces.columns.size:
            pulls[:-1, :, -1] += ADJOINT.restart

    def _multipliers(self, run: Result, at: int, pull: Array, by_integral: Array) -> Array:
        """The multipliers (n_z,) for adjoint states `pull` and s."""
        if not len(run.z):
            return np.zeros(0)
        f_z, g_z, r_z = (np.array(a.full()) for a in self._by_z(*_column(run, at), self.evaluator.factors.values))
        return np.asarray(-np.linalg.solve(g_z.T, f_z.T @ pull + r_z.T @ by_integral) / ADJOINT.multiplier_unit)

    def _sizes(self, run: Result) -> Array:
        """Approximate integral of |integrand| (n_q,)."""
        evaluator = self.evaluator
        integrals = np.abs(evaluator.integrals(run))
        rates = np.array(self._rates(*columns(run), evaluator.factors.values)).reshape(len(integrals), -1)
        signed = np.array([f.kind in ("mean", "integral") for f in evaluator.integrated])
        least = np.where(
            signed, np.maximum(ADJOINT.signed_share * np.abs(rates).max(axis=1), self.simulator.tolerances.atol), 0.0)
        return np.asarray(np.maximum(integrals, evaluator.length * least))

    def _hoisted(self, p: Array) -> Array:
        return np.array(self.simulator.integrand.hoist(p, np.zeros((len(p), 0)))).ravel()

    def _integrator(self, steps: int, p: Array, number: int) -> _BuiltIntegrator:
        """The integrator with so many backward directions, the parameters of a run and memory for its steps."""
        hoisted = self._hoisted(p)
        fixed = np.delete(hoisted, self._kept)
        integrator = self._made.get(number)
        if integrator is None or 1.5 * steps > integrator.room or not np.array_equal(integrator.fixed, fixed):
            integrator = self._made[number] = self._built(hoisted, ADJOINT.checkpoint_room * steps + 1000, number)
        return integrator

    def _built(self, hoisted: Array, room: int, number: int) -> _BuiltIntegrator:
        simulator = self.simulator
        dae = dict(simulator.integrand.dae)
        constant = np.setdiff1d(np.arange(len(hoisted)), self._kept)
        numbers = ca.SX(ca.DM(hoisted[constant]))
        dae["ode"], alg = ca.substitute([dae["ode"], dae["alg"]], [dae["p"][constant.tolist()]], [numbers])
        dae["alg"], dae["p"] = alg * ADJOINT.multiplier_unit, dae["p"][self._kept.tolist()]
        size = dae["x"].numel() + dae["z"].numel()
        if room * size > ADJOINT.max_numbers:
            raise _failure(f"to keep {room} steps of {size} unknowns takes too much memory", "")
        # long steps during slow adjoint states would make the integrals over p inaccurate
        options = {**integrator_options(dae, simulator.tolerances, simulator.integrand.smallest_pivot), "nadj": number,
                   "steps_per_checkpoint": room, "quad_err_con": True}
        stops = simulator.stops - simulator.begin
        unit = time_unit(stops)
        times = (stops / unit).tolist()
        integrator_arguments = ("back", "idas", in_unit_of_time(dae, unit), times[0], times[1:])
        integrator = Evaluated(lambda more: ca.integrator(*integrator_arguments, {**options, **more}),
                               ("xf", "adj_x0", "adj_p"))
        p = simulator.assembly.arguments[3]
        kept_values = simulator.integrand.hoist(p, ca.SX(p.numel(), 0))[self._kept.tolist()]
        pull = ca.SX.sym("l", len(self._kept), number)
        transposed = ca.Function("hoist", [p, pull], [ca.jtimes(kept_values, p, pull, True)])
        return _BuiltIntegrator(hoisted[constant], room, integrator, transposed)

    def _end(self, run: Result, slope: CostSlopes) -> _Ends:
        if self._ends is None:
            return _Ends(np.zeros(len(run.x)), np.zeros(len(run.p)))
        e_x, e_z, e_p, g_x, g_z, g_p = (np.array(a) for a in self._ends(*_column(run, -1), slope.by_final))
        if e_z.size:
            multipliers = np.linalg.solve(g_z.T, e_z)
            e_x, e_p = e_x - g_x.T @ multipliers, e_p - g_p.T @ multipliers
        return _Ends(e_x.ravel(), e_p.ravel())


def _steps(statistics: Mapping[str, object]) -> int:
    steps = statistics.get("nsteps", 0)
    assert isinstance(steps, int)
    return steps


def _column(run: Result, at: int) -> list[Array]:
    """The arguments of an assembly's functions at one of a run's times."""
    return [a[:, at] if a.size else np.zeros(0) for a in columns(run)]


def _failure(failed: str, text: str) -> SimulationError:
    words = [line for line in text.splitlines() if line.strip()]
    return SimulationError([Problem("adjoint-failed", "the run backwards stopped", None, "Take forward sensitivities: "
                                    "simulate(..., sensitivities=[...]).", (words[0] if words else failed[-160:],))])
