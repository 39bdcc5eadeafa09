"""A Radau step of the assembled equations with its exact derivatives, for state estimation.

The reduced equations x' = f(t, x, z, p, u), 0 = g(t, x, z, p, u) are integrated over a step h by the method Radau IIA with
three stages, of order 5, which is stable for stiff machines and meets the algebraic equations at the end of each step:

    sum_j c_ji X_j = h f(t + tau_i h, X_i, Z_i),   0 = g(t + tau_i h, X_i, Z_i),   i = 1 .. 3,   X_0 = x(t),

x(t + h) = X_3. Newton's method solves these equations; the implicit function theorem then gives the derivatives Phi_i of the
stages by s = (x, q), with q the estimated parameters. They are the derivatives of the numerical solution itself. White
process noise of intensity Q adds sum_i b_i h Phi_i Q Phi_i', the quadrature of the method for a Jacobian that is constant in
the step. The moving horizon estimator has the same equations as constraints, so that both estimators have one model.

E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, 2nd ed., Springer 1996, sections IV.5, IV.8 and VI.1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from heavebond.core.errors import Problem, SimulationError, UsageError, listing
from heavebond.equations.buffered import Buffered
from heavebond.language.symbols import stack
from heavebond.localise.ltv_model import Known
from heavebond.numerics.dae import Array, Assembly

LESS_NOISE = "A smaller process noise keeps the estimate near the motion of the model."


@dataclass(frozen=True)
class RadauConstants:
    """The constants of a Radau step.

    stages: stages of the method. Origin: order 5 needs one step between most samples. Doubled: higher order, four times the
        time.
    tolerance: last correction of Newton's method, in nominal sizes or relative. Origin: far below the noise of any record.
        Doubled: the same.
    corrections: most corrections before a step is halved. Origin: Newton's method takes two to four from a good start.
        Doubled: steps over a kink take longer.
    halvings: most halvings of a step. Origin: a thousandth of a sample interval. Doubled: hopeless steps take longer.
    """

    stages: int = 3
    tolerance: float = 1e-7
    corrections: int = 12
    halvings: int = 10


RADAU = RadauConstants()


@dataclass(frozen=True, eq=False)
class Point:
    """The estimate at a time: x (n,) and z (n_z,) in nominal sizes, the parameters q (k,) in units of their priors, and the
    covariance (n+k, n+k) of (x, q)."""

    x: Array
    z: Array
    q: Array
    covariance: Array


class RadauStep:
    """Steps of an assembly, and corrections by the samples of its `outputs`.

    `known` are the priors of the estimated parameters, `noise` (n+k,) the squares of the process noise per second of x in
    nominal sizes and of q."""

    def __init__(self, assembly: Assembly, outputs: Sequence[ca.SX], known: Sequence[Known], noise: Array):
        for kind, items in (("events", assembly.flat.events), ("delays", assembly.flat.delays)):
            if items:
                names = listing([item.name for item in items], 4)
                raise UsageError([Problem(f"estimation-{kind}", f"state estimation does not support {kind}, and this "
                                          f"diagram has {names}", None, "Measure the outputs of sampled blocks and make "
                                          "them inputs of the experiment; replace a delay by a lag.")])
        t, x, z, p, u, rate = assembly.arguments
        self.n, self.n_z, self.k = x.numel(), z.numel(), len(known)
        self.places = assembly.parameter_indices([prior.name for prior in known])
        q, values = ca.SX.sym("q", self.k), ca.SX(p)
        for j, prior in zip(self.places, known, strict=True):
            normalised = q[known.index(prior)]
            values[j] = prior.centre * ca.exp(prior.deviation * normalised) if prior.logarithmic else \
                prior.centre + prior.deviation * normalised
        scaled = [ca.SX.sym("x", self.n), ca.SX.sym("z", self.n_z)]
        x_nominal, z_nominal = ca.SX(ca.DM(assembly.x_nominal)), ca.SX(ca.DM(assembly.z_nominal))
        right = ca.substitute([assembly.ode / x_nominal, assembly.alg, stack(list(outputs))], [x, z, rate, p],
                              [scaled[0] * x_nominal, scaled[1] * z_nominal, ca.SX(1), values])
        self.rates = ca.Function("rates", [t, *scaled, q, p, u], [ca.densify(row) for row in right])
        self.stage_times = ca.collocation_points(RADAU.stages, "radau")
        coefficients, _, weights = ca.collocation_coeff(self.stage_times)
        x_0, h = ca.SX.sym("x_0", self.n), ca.SX.sym("h")
        stages = [(ca.SX.sym("X", self.n), ca.SX.sym("Z", self.n_z)) for _ in self.stage_times]
        columns = ca.horzcat(x_0, *(s for s, _ in stages))
        rows = []
        for i, (tau, (at_x, at_z)) in enumerate(zip(self.stage_times, stages, strict=True)):
            ode, alg, _ = self.rates(t + tau * h, at_x, at_z, q, p, u)
            rows += [columns @ ca.SX(coefficients[:, i]) - h * ode, alg]
        unknowns, residual = stack([s for pair in stages for s in pair]), stack(rows)
        arguments = [x_0, q, p, u, t, h]
        self.residual = ca.Function("residual", [unknowns, *arguments], [residual])
        self._step = Buffered(self._stepping(unknowns, arguments, residual, np.array(weights).ravel(), noise))
        self._correct = Buffered(self._correcting(len(outputs)))

    def _stepping(self, unknowns: ca.SX, arguments: list[ca.SX], residual: ca.SX, weights: Array, noise: Array
                  ) -> ca.Function:
        """(x, z, q, covariance, p, u, t, h) to x, z and the covariance after a step, and the last correction."""
        n, size, k = self.n, self.n + self.n_z, self.k
        newton = ca.rootfinder("newton", "newton", {"x": unknowns, "p": stack(arguments), "g": residual}, {
            "error_on_fail": False, "abstol": 0.0, "abstolStep": 10 * RADAU.tolerance, "line_search": False,
            "max_iter": RADAU.corrections, "linear_solver": "csparse"})
        slopes = ca.Function("slopes", [unknowns, *arguments], [
            residual, ca.jacobian(residual, unknowns), ca.jacobian(residual, stack(arguments[:2]))])
        x, z, q, p, u, t, h = (ca.MX.sym(name, part.numel()) for name, part in (
            ("x", arguments[0]), ("z", ca.SX(self.n_z, 1)), *zip("qputh", arguments[1:], strict=True)))
        covariance = ca.MX.sym("covariance", n + k, n + k)
        solution = newton(ca.repmat(ca.vertcat(x, z), len(weights), 1), ca.vertcat(x, q, p, u, t, h))
        value, matrix, by_start = slopes(solution, x, q, p, u, t, h)
        solved = ca.solve(matrix, ca.densify(ca.horzcat(value, -by_start)), "csparse")
        end = solution - solved[:, 0]
        phis = [ca.vertcat(solved[i * size:i * size + n, 1:], ca.horzcat(ca.MX.zeros(k, n), ca.MX.eye(k)))
                for i in range(len(weights))]
        total = phis[-1] @ covariance @ phis[-1].T
        if noise.any():
            for weight, phi in zip(weights, phis, strict=True):
                total += (float(weight) * h) * (phi * ca.repmat(ca.DM(noise).T, n + k, 1)) @ phi.T
        correction = ca.mmax(ca.fabs(solved[:, 0]) / ca.fmax(1, ca.fabs(end)))
        last = end[-size:]
        return ca.Function("step", [x, z, q, covariance, p, u, t, h], [last[:n], last[n:], ca.densify(total), correction])

    def _correcting(self, count: int) -> ca.Function:
        """(x, z, q, covariance, p, u, t, y, weights) to x, z, q and the covariance after the samples y (m,) with weights of
        1 over the noise, or 0, the outputs before, and the normalised innovations."""
        n, n_z, k = self.n, self.n_z, self.k
        arguments = [ca.SX.sym(name, self.rates.size1_in(j)) for j, name in enumerate("txzqpu")]
        _, alg, values = self.rates(*arguments)
        s = stack([arguments[1], arguments[3]])
        linearised = ca.Function("linearised", arguments, [
            alg, ca.jacobian(alg, arguments[2]), ca.jacobian(alg, s), values, ca.jacobian(values, arguments[2]),
            ca.jacobian(values, s)])
        p_before, s_before, row = (ca.SX.sym("P", n + k, n + k), ca.SX.sym("s", n + k), ca.SX.sym("h", 1, n + k))
        e = ca.SX.sym("e")
        cross = p_before @ row.T
        variance = row @ cross + 1
        gain = cross / variance
        # P. D. Joseph's form keeps the covariance symmetric and positive semidefinite
        reduced = p_before - gain @ cross.T
        update = ca.Function("update", [s_before, p_before, row, e], [
            s_before + gain * e, reduced + (gain - reduced @ row.T) @ gain.T, e / ca.sqrt(variance)])
        x, z, q, p, u, t = (ca.MX.sym(name, arguments["txzqpu".index(name)].numel()) for name in "xzqput")
        covariance = ca.MX.sym("covariance", n + k, n + k)
        y, weight = ca.MX.sym("y", count), ca.MX.sym("weight", count)
        algebraic = z
        if n_z:  # an input that jumps at t changes z there
            unknowns = ca.SX.sym("z", n_z)
            knowns = [a for j, a in enumerate(arguments) if j != 2]
            newton = ca.rootfinder("loops", "newton", {
                "x": unknowns, "p": stack(knowns), "g": self.rates(*arguments[:2], unknowns, *arguments[3:])[1]}, {
                    "error_on_fail": False, "abstol": 0.0, "abstolStep": 10 * RADAU.tolerance,
                    "max_iter": RADAU.corrections, "linear_solver": "csparse"})
            algebraic = newton(z, ca.vertcat(t, x, q, p, u))
        at, at_z, at_s, predicted, by_z, by_s = linearised(t, x, algebraic, q, p, u)
        if n_z:
            solved = ca.solve(at_z, ca.densify(ca.horzcat(at, at_s)), "csparse")
            algebraic = algebraic - solved[:, 0]
            predicted, by_s = predicted - by_z @ solved[:, 0], by_s - by_z @ solved[:, 1:]
        state, rows, innovations = ca.vertcat(x, q), ca.densify(by_s) * ca.repmat(weight, 1, n + k), []
        begin, p_now = state, covariance
        errors = (y - predicted) * weight
        for c in range(count):
            state, p_now, v = update(state, p_now, rows[c, :], errors[c] - rows[c, :] @ (state - begin))
            innovations.append(v)
        return ca.Function("correct", [x, z, q, covariance, p, u, t, y, weight], [
            state[:n], algebraic, state[n:], p_now, predicted, ca.vertcat(*innovations)])

    def step(self, point: Point, p: Array, u: Array, t: float, h: float, *, halved: int = 0) -> Point:
        """One step from t over h with the parameters p (SI; entries of estimated ones are not used) and the pieces `u` of
        the inputs. Raises SimulationError if the equations of the step cannot be solved."""
        try:
            x, z, covariance, correction = self._step(point.x, point.z, point.q, point.covariance, p, u, t, h).values()
            if correction[0, 0] < RADAU.tolerance:
                return Point(x[:, 0], z[:, 0], point.q, covariance)
        except RuntimeError:  # a singular matrix
            pass
        if halved == RADAU.halvings:
            raise SimulationError([Problem("estimation-step", "the equations could not be integrated from the estimated "
                                           f"state at t = {t:.6g} s", None,
                                           f"{LESS_NOISE} `heavebond compare` shows if the model runs at all.")])
        middle = self.step(point, p, u, t, h / 2, halved=halved + 1)
        return self.step(middle, p, u, t + h / 2, h / 2, halved=halved + 1)

    def correct(self, point: Point, p: Array, u: Array, t: float, values: Array, deviations: Array
                ) -> tuple[Point, Array, Array]:
        """Return the estimate after samples (m,) of the outputs (SI, nan: not sampled), the outputs predicted before them,
        and the normalised innovations (nan: not sampled)."""
        on = np.isfinite(values)
        x, z, q, covariance, predicted, innovations = self._correct(
            point.x, point.z, point.q, point.covariance, p, u, t, np.where(on, values, 0.0), on / deviations).values()
        if not (np.isfinite(predicted).all() and np.isfinite(covariance).all()):
            raise SimulationError([Problem("estimation-value", "an output has no value in the estimated state at "
                                           f"t = {t:.6g} s", None, LESS_NOISE)])
        return Point(x[:, 0], z[:, 0], q[:, 0], covariance), predicted[:, 0], np.where(on, innovations[:, 0], np.nan)
