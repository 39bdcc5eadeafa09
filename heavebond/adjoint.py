"""Gradients of costs with respect to any number of parameters, from one run backwards in time.

With x' = f(t, x, z, p), 0 = g(t, x, z, p), integrals q' = r(t, x, z, p) and a cost whose change is

    dJ = s^T d(q(t_2) - q(t_1)) + e_x dx(t_2) + e_z dz(t_2) + e_p dp,

the adjoint states l and the multipliers m run from t_2 back to the start at t_0 (s is left out before t_1):

    -l' = f_x^T l + g_x^T m + r_x^T s,   0 = f_z^T l + g_z^T m + r_z^T s,   l(t_2) = e_x - g_x^T g_z^-T e_z,
    dJ/dp = int (f_p^T l + g_p^T m + r_p^T s) dt + e_p - g_p^T g_z^-T e_z + (dx(t_0)/dp)^T l(t_0).

IDAS keeps every step forward and interpolates in them on its way back. Y. Cao, S. Li, L. Petzold and R. Serban, Adjoint
sensitivity analysis for differential-algebraic equations, 2003, doi:10.1137/S1064827501380630.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from heavebond.costs import CostSlopes, Evaluator
from heavebond.dae import Array
from heavebond.errors import Problem, SimulationError
from heavebond.initialise import tangent
from heavebond.result import Result, columns
from heavebond.simulation import MOST_STEPS, Simulator, caught_errors
from heavebond.symbols import stack

# The multipliers jump with s and with the inputs, and the error control backward cannot leave them out as it does the
# algebraic unknowns forward: counted in so large a unit they pass it unseen.
UNSEEN = 1e10
# Added to an adjoint state at a stop it moves nothing, but lets IDAS begin anew there. Otherwise it steps past the stop
# with the inputs that hold after it, and interpolates back.
NOTHING = 1e-300
# Between checkpoints IDAS integrates forward again, with whatever input holds at that moment of the way back. So there
# is one stretch only, with room for this many times the steps of the first run.
ROOM = 2
MOST_NUMBERS = 60_000_000  # kept steps times unknowns: about 1 GB
# Adjoint states are weighted by so much more than forward sensitivities in the error control: contributions to an integral
# over p cancel, and what is left of their errors is magnified.
MORE = 10
# The share of |integrand| at the ends of the time evaluated that a signed integral is taken to be at least: one over
# whole periods may be zero, and still has a gradient.
SIGNED = 1e-3


@dataclass(frozen=True)
class _Ends:
    """What a cost pulls at at the end: states (n_x,), parameters (n_p,)."""

    x: Array
    p: Array


@dataclass(frozen=True)
class _Made:
    """An integrator, the numbers in it and the steps that it can keep."""

    fixed: Array
    room: int
    integrator: ca.Function


class Adjoint:
    """Costs and their gradients at runs of a simulator that integrates the quadratures of the evaluator.

    `names` are the parameters that are differentiated; those under `solve:` follow the start, all others are taken into
    the equations as numbers, so that the gradient is cheap. Each cost is scaled so that its adjoint states count in the
    error control by ten times `tolerances.along`. UsageError for a name that is no independent parameter.
    """

    def __init__(self, simulator: Simulator, evaluator: Evaluator, names: Sequence[str]):
        self.simulator, self.evaluator = simulator, evaluator
        assembly = simulator.assembly
        assembly.with_parameters(dict.fromkeys(names, 0.0))  # says what is wrong with a name that cannot be set
        self._chosen = [assembly.parameter_names.index(name) for name in names]
        self._made: _Made | None = None
        z, p = assembly.arguments[2:4]
        hoisted = simulator.integrand.hoist(p, ca.SX(p.numel(), 0))
        moving = [*self._chosen, *simulator.start_equations.solved_for]
        depends = np.array(ca.which_depends(hoisted, p[moving], 1, True)) if moving else np.zeros(0, dtype=bool)
        self._kept = np.flatnonzero(depends)
        pull = ca.SX.sym("l", len(self._kept), len(evaluator.costs))
        self._hoist_transposed = ca.Function("hoist", [p, pull], [ca.jtimes(hoisted[self._kept.tolist()], p, pull, True)])
        sides = (assembly.ode / ca.SX(ca.DM(assembly.x_nominal)), assembly.alg, evaluator.quadratures)
        self._by_z = ca.Function("by_z", list(assembly.arguments), [ca.jacobian(side, z) for side in sides])
        self._rates = ca.Function("rates", list(assembly.arguments), [evaluator.quadratures])
        self._ends = self._end_function() if any(f.kind == "final" for f in evaluator.functionals) else None

    def costs(self, run: Result, references: Array) -> list[tuple[float, Array]]:
        """Each cost of a run of the simulator and its gradient (m,).

        `references` are the functionals of the reference run. SimulationError where the run backward breaks down.
        """
        slopes = self.evaluator.cost_slopes(run, references)
        ends = [self._end(run, slope) for slope in slopes]
        first = run.start
        u = self.simulator.pieces.at(np.array([first.t]))[:, 0]
        moved = tangent(self.simulator.start_equations, first, u, np.eye(len(run.p))[:, self._chosen])
        x, p = self._backward(run, slopes, ends)
        return [(slope.value, moved.x.T @ x[:, k] + moved.p.T @ (p[:, k] + slope.by_p + end.p))
                for k, (slope, end) in enumerate(zip(slopes, ends, strict=True))]

    # -- the run back ----------------------------------------------------------------------------------------------
    def _backward(self, run: Result, slopes: list[CostSlopes], ends: list[_Ends]) -> tuple[Array, Array]:
        """d cost / d x(t_0) (n_x, k) with parameters held, d cost / dp (n_p, k) with x(t_0) held and without `ends`."""
        simulator, assembly = self.simulator, self.simulator.assembly
        integrator = self._integrator(run)
        n_x, n_all = len(assembly.x_nominal), integrator.size1_in("x0")
        first, p = run.start, self._hoisted(run)[self._kept]
        seeds, jumps, weights = self._seeds(run, slopes, ends, n_all)
        if not weights.any():
            return np.zeros((n_x, len(slopes))), np.zeros((len(run.p), len(slopes)))
        x0 = np.append(first.x / assembly.x_nominal, np.zeros(n_all - n_x))
        middle = (simulator.stops[:-1] + simulator.stops[1:]) / 2
        with caught_errors() as heard:
            try:
                found = integrator(x0=x0, z0=first.z / assembly.z_nominal, p=p, u=simulator.pieces.at(middle),
                                   adj_xf=seeds, adj_zf=jumps)
                by_x, by_p = np.array(found["adj_x0"]), np.array(self._hoist_transposed(run.p, found["adj_p"]))
                failed = "" if np.isfinite(by_x).all() and np.isfinite(by_p).all() else "a value is not a number"
            except RuntimeError as error:
                failed = str(error)
        said = "".join(heard)
        if failed and "KeyboardInterrupt" in said:  # CasADi makes it a failure of the right side
            raise KeyboardInterrupt
        if failed:
            raise _failure(failed, said)
        back = np.divide(1.0, weights, out=np.zeros_like(weights), where=weights > 0)
        return by_x[:n_x] / assembly.x_nominal[:, None] * back, by_p * back

    def _seeds(self, run: Result, slopes: list[CostSlopes], ends: list[_Ends], n_all: int) -> tuple[Array, Array, Array]:
        """What is added to the adjoint states (n_all, stops * k) and to the multipliers (n_z, stops * k) at the stops after
        the first, a column per cost at each stop, and the weight of each cost in it."""
        simulator, k = self.simulator, len(slopes)
        nominal = simulator.assembly.x_nominal
        stops, n_q = len(simulator.stops) - 1, simulator.integrals
        pulls, jumps = np.zeros((stops, k, n_all)), np.zeros((stops, k, len(run.z)))
        weights = np.zeros(k)
        begin = int(np.searchsorted(simulator.stops, simulator.time[-2]))
        sizes = self._sizes(run)
        for j, (slope, end) in enumerate(zip(slopes, ends, strict=True)):
            pull = end.x * nominal
            size = max(float(np.abs(slope.by_integral) @ sizes), float(np.abs(pull).max(initial=0.0)))
            weights[j] = MORE * simulator.tolerances.along / size if size > 0 else 0.0
            pulls[-1, j, : len(nominal)] = weights[j] * pull
            pulls[-1, j, n_all - n_q:] = weights[j] * slope.by_integral
            jumps[-1, j] = weights[j] * self._multipliers(run, -1, pull, slope.by_integral)
            if begin > 0:
                pulls[begin - 1, j, n_all - n_q:] = -weights[j] * slope.by_integral
                jumps[begin - 1, j] = -weights[j] * self._multipliers(run, -2, 0 * pull, slope.by_integral)
        if simulator.pieces.columns.size:
            pulls[:-1, :, -1] += NOTHING
        return pulls.reshape(stops * k, n_all).T, jumps.reshape(stops * k, -1).T, weights

    def _multipliers(self, run: Result, at: int, pull: Array, by_integral: Array) -> Array:
        """The multipliers (n_z,) that go with adjoint states `pull` and with s."""
        if not len(run.z):
            return np.zeros(0)
        f_z, g_z, r_z = (np.array(a.full()) for a in self._by_z(*_column(run, at)))
        return np.asarray(-np.linalg.solve(g_z.T, f_z.T @ pull + r_z.T @ by_integral) / UNSEEN)

    def _sizes(self, run: Result) -> Array:
        """About how large the integral of |integrand| is (n_q,)."""
        evaluator = self.evaluator
        integrals = np.abs(run.quadratures[:, -1] - run.quadratures[:, -2])
        rates = np.abs(np.array(self._rates(*columns(run)))).reshape(len(integrals), -1).max(axis=1)
        signed = np.array([f.kind in ("mean", "integral") for f in evaluator.functionals])
        least = np.where(signed, np.maximum(SIGNED * rates, self.simulator.tolerances.atol), 0.0)
        return np.asarray(np.maximum(integrals, evaluator.length * least))

    def _hoisted(self, run: Result) -> Array:
        return np.array(self.simulator.integrand.hoist(run.p, np.zeros((len(run.p), 0)))).ravel()

    def _integrator(self, run: Result) -> ca.Function:
        """The integrator with its way back, with the numbers of the run and room for its steps."""
        steps = run.statistics.get("nsteps", 0)
        assert isinstance(steps, int)
        hoisted = self._hoisted(run)
        fixed = np.delete(hoisted, self._kept)
        made = self._made
        if made is None or 1.5 * steps > made.room or not np.array_equal(made.fixed, fixed):
            room = ROOM * steps + 1000
            self._made = made = _Made(fixed, room, self._built(hoisted, room))
        return made.integrator

    def _built(self, hoisted: Array, room: int) -> ca.Function:
        simulator = self.simulator
        dae = dict(simulator.integrand.dae)
        rest = np.setdiff1d(np.arange(len(hoisted)), self._kept)
        numbers = ca.SX(ca.DM(hoisted[rest]))
        dae["ode"], alg = ca.substitute([dae["ode"], dae["alg"]], [dae["p"][rest.tolist()]], [numbers])
        dae["alg"], dae["p"] = alg * UNSEEN, dae["p"][self._kept.tolist()]
        size = dae["x"].numel() + dae["z"].numel()
        if room * size > MOST_NUMBERS:
            raise _failure(f"to keep {room} steps of {size} unknowns takes too much memory", "")
        return ca.integrator("back", "idas", dae, float(simulator.stops[0]), list(simulator.stops[1:]), {
            "nadj": len(self.evaluator.costs), "steps_per_checkpoint": room, "max_num_steps": MOST_STEPS,
            "reltol": simulator.tolerances.rtol, "abstol": simulator.tolerances.atol,
            # long steps where the adjoint states are quiet would leave the integrals over p inaccurate
            "quad_err_con": True,
            "linear_solver": "qr" if size < 100 else "csparse", "suppress_algebraic": bool(dae["z"].numel())})

    # -- costs of the last values ----------------------------------------------------------------------------------
    def _end_function(self) -> ca.Function:
        """Gradients of a sum of the last values, by x, z and p, and of the loops."""
        assembly = self.simulator.assembly
        t, x, z, p, u, rate = assembly.arguments
        weights = ca.SX.sym("w", len(self.evaluator.functionals))
        value = ca.dot(weights, stack([f.signal for f in self.evaluator.functionals]))
        return ca.Function("ends", [t, x, z, p, u, rate, weights], [
            *(ca.densify(ca.gradient(value, a)) for a in (x, z, p)),
            *(ca.densify(ca.jacobian(assembly.alg, a)) for a in (x, z, p))])

    def _end(self, run: Result, slope: CostSlopes) -> _Ends:
        if self._ends is None:
            return _Ends(np.zeros(len(run.x)), np.zeros(len(run.p)))
        e_x, e_z, e_p, g_x, g_z, g_p = (np.array(a) for a in self._ends(*_column(run, -1), slope.by_final))
        if e_z.size:
            multipliers = np.linalg.solve(g_z.T, e_z)
            e_x, e_p = e_x - g_x.T @ multipliers, e_p - g_p.T @ multipliers
        return _Ends(e_x.ravel(), e_p.ravel())


def _column(run: Result, at: int) -> list[Array]:
    """The arguments of an assembly's functions at one of a run's times."""
    return [a[:, at] if a.size else np.zeros(0) for a in columns(run)]


def _failure(failed: str, said: str) -> SimulationError:
    words = [line for line in said.splitlines() if line.strip()]
    return SimulationError([Problem("adjoint-failed", "the run backwards stopped", None, "Take forward sensitivities: "
                                    "simulate(..., sensitivities=[...]).", (words[0] if words else failed[-160:],))])
