"""Moving horizon estimation of states and slowly varying parameters, by nonlinear programming.

Over a window of samples a .. b the states X, the parameters q and the process noise w minimise

    |xi|^2 + sum |w_j|^2 + sum ((y_k - h(X_k, q_k)) / sigma_k)^2,   (X_a, q_a) = s_a + L xi,

where s_a and L L' are the estimate of the Kalman filter at the first sample and its covariance (the arrival cost), and the
collocation equations of every step (see `radau_step`) are constraints: X_(j+1) is the end of step j plus sigma_w sqrt(h)
w_j. IPOPT solves the problem with exact derivatives. Parameters stay within their ranges. In contrast to the filter, all
steps of the window are linearised about the final estimate, and the estimate of a sample uses later samples of its window.
If the window is the whole record and there is no process noise, the result is the least squares fit of parameters and start.

C. V. Rao, J. B. Rawlings, D. Q. Mayne, Constrained state estimation for nonlinear discrete-time systems: stability and
moving horizon approximations, IEEE Trans. Automatic Control 48 (2003) 246-258, doi:10.1109/TAC.2002.808470.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from heavebond.core.cancellation import check
from heavebond.core.errors import Problem, SimulationError, UsageError
from heavebond.core.quantities import si_value
from heavebond.estimation.experiment import Record
from heavebond.monitoring.estimates import StateEstimate
from heavebond.monitoring.kalman_filter import Estimator, SampledRecord, steps_between
from heavebond.monitoring.radau_step import Point
from heavebond.numerics.dae import Array

ITERATIONS = 300  # most iterations of IPOPT


def moving_horizon(estimator: Estimator, record: Record | None = None, *, horizon: float | str | None = None
                   ) -> StateEstimate:
    """Estimate the states and parameters of a record by the machine of an `estimator`.

    The record is estimated over windows of a length `horizon` (s, or text with a unit; by default
    the whole record).

    Windows follow each other at half of their length; the estimate of a sample is from the first window that contains it.
    The standard deviations of the result are the deviations of the filter, which uses no later samples. `innovations` of the
    result are the residuals over their noise. Raises UsageError for a horizon of fewer than two samples, SimulationError if
    IPOPT finds no solution, and the errors of `Estimator.run`.
    """
    if not isinstance(estimator, Estimator):
        raise UsageError([Problem("estimator-needed", f"a {type(estimator).__name__} is not an estimator", None,
                                  'Write for example hb.moving_horizon(hb.Estimator("rig.yaml"), horizon="2 s").')])
    samples = estimator.sampled(record)
    time, count = samples.time, len(samples.time)
    length = time[-1] - time[0] if horizon is None else si_value(horizon, "s", "horizon")
    width = min(int(length / np.median(np.diff(time)) * (1 + 1e-9)), count - 1)
    if width < 2:
        raise UsageError([Problem("horizon-short", f"a horizon of {length:g} s has fewer than two samples after its first",
                                  None, "Give a longer horizon, or none for the whole record.")])
    points = list[Point]()
    variances = np.empty((count, len(estimator.assembly.x_nominal) + len(estimator.known)))
    estimator.begin(float(time[0]), samples.inputs.at(time[:1])[:, 0])
    prior = estimator.point
    for i, _ in enumerate(estimator.filtered(samples)):
        points.append(estimator.point)
        variances[i] = np.diag(estimator.point.covariance)
    states, predicted = np.empty(variances.shape), np.empty_like(samples.values)
    begin, solved = 0, 0
    while solved < count:
        end = min(begin + width, count - 1)
        # the arrival cost includes the sample `begin`, except at the start of the record
        window = _window(estimator, samples, points, begin, end, prior if begin == 0 else points[begin], begin == 0)
        states[solved:end + 1], predicted[solved:end + 1] = (part[solved - begin:] for part in window)
        solved, begin = end + 1, begin + max(1, width // 2)
        check()
    residuals = (samples.values - predicted) / samples.deviations
    return estimator.estimate(samples, states, variances, predicted, residuals)


def _window(estimator: Estimator, samples: SampledRecord, points: list[Point], begin: int, end: int,
            arrival: Point, uses_first: bool) -> tuple[Array, Array]:
    """The states (N, n+k) in nominal sizes and units of q, and the outputs (N, m), at the samples begin .. end."""
    equations, known = estimator.radau, estimator.known
    n, n_z, k = equations.n, equations.n_z, equations.k
    size, stages = n + n_z, len(equations.stage_times)
    steps, nodes = [], [0]  # the steps of the window, and the node at which each sample is
    for i in range(begin, end):
        steps += list(steps_between(float(samples.time[i]), float(samples.time[i + 1]), samples.inputs,
                                    estimator.reference.longest))
        nodes.append(len(steps))
    begins, lengths, pieces = (np.array(part) for part in zip(*steps, strict=True))
    x, q = ca.MX.sym("X", n, len(steps) + 1), ca.MX.sym("q", k, len(steps) + 1)
    w, z = ca.MX.sym("W", stages * size, len(steps)), ca.MX.sym("Z", n_z, len(nodes))
    noisy = np.flatnonzero(estimator.noise)
    omega, xi = ca.MX.sym("w", len(noisy), len(steps)), ca.MX.sym("xi", n + k)
    driven = np.zeros((n + k, len(noisy)))
    driven[noisy, range(len(noisy))] = np.sqrt(estimator.noise[noisy])
    disturbance = (ca.DM(driven) @ omega) * ca.repmat(ca.DM(np.sqrt(lengths)).T, n + k, 1)
    values, vectors = np.linalg.eigh(arrival.covariance)
    root = vectors * np.sqrt(np.maximum(values, 0))
    p, u = ca.DM(estimator.p), ca.DM(pieces.reshape(len(steps), -1).T)
    constraints = [
        equations.residual.map(len(steps))(w, x[:, :-1], q[:, :-1], ca.repmat(p, 1, len(steps)), u, ca.DM(begins).T,
                                           ca.DM(lengths).T),
        x[:, 1:] - w[-size:, :][:n, :] - disturbance[:n, :], q[:, 1:] - q[:, :-1] - disturbance[n:, :],
        ca.vertcat(x[:, 0], q[:, 0]) - ca.DM(np.concatenate([arrival.x, arrival.q])) - ca.DM(root) @ xi]
    at = samples.time[begin:end + 1]
    _, alg, outputs = equations.rates.map(len(nodes))(ca.DM(at).T, x[:, nodes], z, q[:, nodes], ca.repmat(p, 1, len(nodes)),
                                                      ca.DM(samples.inputs.at(at)))
    constraints.append(alg)
    measured, deviations = samples.values[begin:end + 1].T, samples.deviations[begin:end + 1].T
    on = np.isfinite(measured)
    on[:, 0] &= uses_first
    residual = ca.DM(on / deviations) * (outputs - ca.DM(np.where(on, measured, 0.0)))
    unknowns = ca.veccat(x, q, w, z, omega, xi)
    g = ca.veccat(*constraints)
    solver = ca.nlpsol("horizon", "ipopt", {
        "x": unknowns, "g": g, "f": (ca.sumsqr(residual) + ca.sumsqr(omega) + ca.sumsqr(xi)) / 2},
        {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "max_iter": ITERATIONS, "tol": 1e-9}})
    # the estimate of the filter is the first guess, and parameters stay within their ranges
    course = [points[begin + i] for i in np.searchsorted(nodes, np.arange(len(steps) + 1))]
    first = np.concatenate([
        np.concatenate([c.x for c in course]), np.concatenate([c.q for c in course]),
        np.concatenate([np.tile(np.concatenate([c.x, c.z]), stages) for c in course[1:]]),
        np.concatenate([points[i].z for i in range(begin, end + 1)]), np.zeros(omega.numel() + n + k)])
    low, high = np.full(len(first), -np.inf), np.full(len(first), np.inf)
    ends = [sorted((prior.place_of(prior.low), prior.place_of(prior.high))) for prior in known]
    of_q = slice(x.numel(), x.numel() + q.numel())
    low[of_q], high[of_q] = (np.tile([pair[side] for pair in ends], len(steps) + 1) for side in (0, 1))
    solution = solver(x0=np.clip(first, low, high), lbx=low, ubx=high, lbg=0, ubg=0)
    if not solver.stats()["success"]:
        raise SimulationError([Problem("horizon-unsolved", "IPOPT found no estimate in the window from "
                                       f"{samples.time[begin]:.6g} s to {samples.time[end]:.6g} s "
                                       f"({solver.stats()['return_status']})", None,
                                       "Give a shorter horizon, or a smaller process noise.")])
    result = ca.Function("result", [unknowns], [ca.vertcat(x[:, nodes], q[:, nodes]), outputs])
    states, predicted = result(solution["x"])
    return np.array(states).T, np.array(predicted).T
