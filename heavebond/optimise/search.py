"""Gradient-based local optimisation within ranges and limits from one starting point.

`trust`: sequential quadratic programming in a trust region. The curvature is computed from the sensitivities of signals at
each point (Gauss-Newton), corrected by the last step (symmetric rank one); if only gradients are known it is estimated from
these (damped BFGS). A run that fails, or a machine that has lost its stability, means that the step was too long.

`ipopt`: A. Wachter and L. T. Biegler, 2006, doi:10.1007/s10107-004-0559-y, as in CasADi, with a limited-memory Hessian: a
check of `trust` by an independent method.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import casadi as ca
import numpy as np

from heavebond.core.cancellation import ENDED_EARLY, clear_signal, is_interrupt
from heavebond.core.progress import Progress
from heavebond.numerics.dae import Array
from heavebond.optimise.objective import OBJECTIVE, Evaluation, Objective

METHODS = ("trust", "ipopt")


@dataclass(frozen=True)
class SearchConstants:
    """The constants of the local search of a tuning (trust region, sequential quadratic programming).

    converged: gain of a step, over the cost, at which a search ends. Origin: runs at the tolerances of a tuning are no
    smoother. Doubled: fewer runs, less exact parameters.
    same_optimum: distance of two results, over the ranges, below which they are one optimum. Origin: searches from other
    starts end closer if they reach one minimum. Doubled: neighbouring optima are reported as one.
    failed_cost: cost of a run that fails, in costs at the start. Origin: larger than any useful cost. Doubled: nothing.
    min_curvature: least curvature, over the largest. Origin: errors of gradients. Doubled: shorter steps along flat
    directions.
    first_radius: first radius of the trust region, in ranges. Origin: short enough to stay near the minimum of the start.
    Doubled: one step less or a rejected one more.
    max_radius: largest radius, in ranges. Origin: half a range. Doubled: nothing measurable.
    min_radius: radius at which a search ends, in ranges. Origin: finer than parameters are set. Doubled: some runs fewer.
    at_guard: share of `OBJECTIVE.max_growth` above which the guard of stability limits a search. Origin: costs near it are
    dominated by it. Doubled: never reported.
    step_beyond: first step without the guard, in ranges. Origin: short, as the model of the cost is new. Doubled: one more
    rejected step.
    unstable_cost: costs above the best from which a rise is attributed to lost stability. Origin: other rises are smaller.
    Doubled: such steps are judged as poor models.
    inactive_limit: relative distance from a limit at which it is inactive. Origin: multipliers vanish there. Doubled: fewer
    gradients of limits, some later.
    accepted: gain over the predicted gain from which a step is taken. Origin: usual (J. Nocedal, S. Wright, Numerical
    Optimization, 2006, ch. 4). Doubled: a few more rejected steps.
    good: the same from which the next step may be longer. Origin: as above. Doubled: the radius never grows.
    """

    converged: float = 1e-4
    same_optimum: float = 0.03
    failed_cost: float = 1e3
    min_curvature: float = 1e-4
    first_radius: float = 0.15
    max_radius: float = 0.5
    min_radius: float = 1e-4
    at_guard: float = 0.8
    step_beyond: float = 0.02
    unstable_cost: float = 2.0
    inactive_limit: float = 0.05
    accepted: float = 0.1
    good: float = 0.7


SEARCH = SearchConstants()


@dataclass(frozen=True)
class SearchResult:
    """End of a search, its reason, and every evaluated point."""

    best: Evaluation
    message: str
    path: tuple[Evaluation, ...]


def search(problem: Objective, first: Array, method: str, most_steps: int, say: Progress,
           earlier: Sequence[SearchResult] = (),
           partial: bool = False) -> SearchResult:
    """Minimise the cost from one point; `most_steps` limits the accepted steps. A search by `trust` that arrives at the
    end of one of `others` stops there. With `partial` Ctrl-C ends it with the best result so far (ENDED_EARLY)."""
    memo = _Seen(problem, say)
    first = np.clip(first, 0, 1)
    try:
        message = _trust(memo, first, most_steps, [result.best for result in earlier]) if method == "trust" else \
            _ipopt(memo, first, most_steps)
    except BaseException as error:
        if not (partial and is_interrupt(error) and any(np.isfinite(e.cost) for e in memo.path)):
            raise
        clear_signal()
        message = ENDED_EARLY
    best = min(memo.path, key=lambda e: (not e.feasible, e.cost))
    known = best.gradient is not None or message == ENDED_EARLY
    return SearchResult(best if known else problem.evaluate(best.at), message, tuple(memo.path))


class _Seen:
    """The objective with a cache of evaluated points."""

    def __init__(self, problem: Objective, say: Progress):
        self.problem, self.say = problem, say
        self.path: list[Evaluation] = []

    def plain(self, y: Array) -> Evaluation:
        return self._recorded(self.problem.plain(np.clip(y, 0, 1)))

    def guarded(self, y: Array) -> Evaluation:
        """Evaluate a point; without a run as a failed one if the machine has lost its initial stability there."""
        y = np.clip(y, 0, 1)
        if self.path and self.problem.calm(self.path[0].at) and not self.problem.calm(y):
            return Evaluation(y, np.inf, np.full(len(self.problem.limits), np.inf), {})
        return self.plain(y)

    def slopes(self, y: Array) -> Evaluation:
        return self._recorded(self.problem.evaluate(np.clip(y, 0, 1)))

    def _recorded(self, evaluation: Evaluation) -> Evaluation:
        if not self.path or not np.array_equal(self.path[-1].at, evaluation.at):
            self.path.append(evaluation)
        self.say(f"cost {min(e.cost for e in self.path):.5g} after {len(self.path)} evaluations")
        return evaluation


# -- trust region ------------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class _Step:
    """A step within the trust region, and its predicted gain."""

    d: Array
    gain: float


def _trust(memo: _Seen, first: Array, most_steps: int, known_best: Sequence[Evaluation]) -> str:
    problem = memo.problem
    at = memo.slopes(first)
    if at.gradient is None:
        return "the run at the first point breaks down"
    radii, curvature, penalty = np.full(len(first), SEARCH.first_radius), _first_curvature(at), abs(at.cost)
    calm, sure, idle = problem.calm(at.at), True, 0
    for _ in range(most_steps):
        forces = _forces(at)
        penalty = max(penalty, 3 * float(forces.max(initial=0.0)))
        step = _quadratic_step(at, curvature, radii, penalty)
        settled = step.gain < SEARCH.converged * max(abs(at.cost), 1e-300)
        if settled or radii.max() < SEARCH.min_radius or idle >= 2:
            return "settled" if settled or idle >= 2 else "no shorter step improves the cost"
        trial_at = np.clip(at.at + step.d, 0, 1)
        growth = problem.growth(trial_at)
        if calm and not growth < OBJECTIVE.max_growth:
            calm = problem.growth(at.at) < SEARCH.at_guard * OBJECTIVE.max_growth
            # limited by the linearised machine alone: friction, or the motion itself, may keep it stable beyond
            radii = _shorter_where(radii, step.d, problem.growth_slope(trial_at) * step.d, _to_guard(problem, at.at, step.d)
                                   ) if calm else np.full(len(first), SEARCH.step_beyond)
            continue
        # After a successful step the next is probably accepted: its gradient is computed with it, at less than two runs.
        # Runs of a weakly damped machine are long, and longer with sensitivities.
        trial = memo.slopes(trial_at) if sure and growth < 0 else memo.plain(trial_at)
        gained = _merit(at, penalty) - _merit(trial, penalty)
        sure = gained > SEARCH.accepted * step.gain
        if sure and (trial := memo.slopes(trial_at)).gradient is not None:
            known = _definite(trial.curvature)
            curvature = _updated(curvature, at, trial, forces) if known is None else _corrected(known, at, trial, forces)
            idle = idle + 1 if gained < SEARCH.converged * abs(at.cost) else 0
            problem.resize(trial)
            at = trial
            if any(o.feasible and o.cost <= at.cost and np.abs(o.at - at.at).max() < SEARCH.same_optimum
                   for o in known_best):
                return "came to where another search ended"
            if gained > SEARCH.good * step.gain:
                radii = np.where(np.abs(step.d) > 0.9 * radii, np.minimum(2 * radii, SEARCH.max_radius), radii)
        else:
            # shorter radii in the unknowns in which a step was too long, by the slopes at its far end, or by the loss of
            # stability
            d = step.d
            if trial.gradient is not None and at.gradient is not None:
                radii = _shorter_where(radii, d, (trial.gradient - at.gradient) * d, _lowest_between(at, trial, d))
            else:
                before, after = problem.growth(at.at), problem.growth(trial.at)
                lost = not trial.cost < SEARCH.unstable_cost * abs(at.cost) and \
                    before + max(OBJECTIVE.max_growth, 0.2 * abs(before)) < after < np.inf and after > 0
                rise = problem.growth_slope(trial.at) * d if lost else np.zeros(len(d))
                assert at.gradient is not None
                slope = float(at.gradient @ d)
                bend = trial.cost - at.cost - slope
                share = float(np.clip(-slope / (2 * bend), 0.1, 0.5)) if np.isfinite(bend) and bend > 0 else 0.25
                radii = _shorter_where(radii, d, rise, share)
    return f"{most_steps} steps"


def _shorter_where(radii: Array, d: Array, rise: Array, share: float = 0.3) -> Array:
    """Shorten the radii of the unknowns that cause most of a rise, or all radii equally if no unknown does."""
    most = float(rise.max())
    if not most > 0:
        return np.asarray(radii * share * float((np.abs(d) / radii).max()))
    return np.where(rise >= 0.3 * most, np.minimum(radii, np.abs(d)) * share, radii)


def _to_guard(problem: Objective, at: Array, d: Array) -> float:
    """The share of a step up to the guard of stability, by bisection without runs."""
    low, high = 0.0, 1.0
    while high - low > 0.05:
        middle = (low + high) / 2
        inside = problem.growth(np.clip(at + middle * d, 0, 1)) < (1 + SEARCH.at_guard) / 2 * OBJECTIVE.max_growth
        low, high = (middle, high) if inside else (low, middle)
    return max(low, 0.05)


def _first_curvature(at: Evaluation) -> Array:
    """Initial curvature from the sensitivities of signals. Without them, a multiple of the identity that makes the first
    step as long as the trust region."""
    assert at.gradient is not None
    if (known := _definite(at.curvature)) is not None:
        return known
    return np.eye(len(at.at)) * max(float(np.abs(at.gradient).max()), 1e-12) / SEARCH.first_radius


def _definite(curvature: Array | None) -> Array | None:
    """The curvature made positive definite; None without one."""
    if curvature is None or not np.isfinite(curvature).all():
        return None
    values, vectors = np.linalg.eigh(curvature)
    most = float(np.abs(values).max(initial=0.0))
    return np.asarray((vectors * np.maximum(values, SEARCH.min_curvature * most)) @ vectors.T) if most > 0 else None


def _merit(at: Evaluation, penalty: float) -> float:
    return at.cost + penalty * float(np.maximum(at.limits - 0.5 * OBJECTIVE.limit_tolerance, 0).sum()) \
        if np.isfinite(at.cost) else np.inf


def _lowest_between(at: Evaluation, trial: Evaluation, d: Array) -> float:
    """The share of a step to try next: the minimum of the cubic through the costs and slopes at both ends."""
    assert at.gradient is not None and trial.gradient is not None
    first, last = float(at.gradient @ d), float(trial.gradient @ d)
    bend = first + last - 3 * (trial.cost - at.cost)
    root = bend**2 - first * last
    if not (np.isfinite(root) and root >= 0 and last > 0):
        return 0.3
    return float(np.clip(1 - (last + np.sqrt(root) - bend) / (last - first + 2 * np.sqrt(root)), 0.1, 0.7))


def _quadratic_step(at: Evaluation, curvature: Array, radii: Array, penalty: float) -> _Step:
    """min g d + d B d / 2 + penalty sum t, with limits + slopes d <= t, t >= 0, within the ranges and the radii."""
    from scipy.optimize import minimize

    assert at.gradient is not None and at.limit_gradients is not None
    n, k, gradient, rows = len(at.at), len(at.limits), at.gradient, at.limit_gradients
    excess = at.limits - 0.5 * OBJECTIVE.limit_tolerance
    scale = max(float(np.abs(gradient).max()), 1e-300)
    bounds = [*zip(np.maximum(-radii, -at.at), np.minimum(radii, 1 - at.at), strict=True), *[(0.0, None)] * k]

    def model(v: Array) -> tuple[float, Array]:
        bent = curvature @ v[:n]
        return (float(gradient @ v[:n] + 0.5 * v[:n] @ bent + penalty * v[n:].sum()) / scale,
                np.append(gradient + bent, np.full(k, penalty)) / scale)

    constraints: Any = [{"type": "ineq", "fun": lambda v: v[n:] - excess - rows @ v[:n],
                         "jac": lambda v: np.hstack([-rows, np.eye(k)])}]
    first = np.append(np.zeros(n), np.maximum(excess, 0))
    solution: Any = cast(Any, minimize)(model, first, jac=True, method="SLSQP", bounds=bounds, constraints=constraints if k
                                        else [],
                     options={"maxiter": 200, "ftol": 1e-10})
    d = solution.x[:n]
    kept_better = np.maximum(excess, 0) - np.maximum(excess + rows @ d, 0)
    return _Step(d, float(penalty * kept_better.sum() - gradient @ d - 0.5 * d @ curvature @ d))


def _forces(at: Evaluation) -> Array:
    """The multipliers (k,) of limits that best balance the slope of the cost, at the bounds of the ranges only outwards."""
    from scipy.optimize import nnls

    assert at.gradient is not None and at.limit_gradients is not None
    near = at.limits > -SEARCH.inactive_limit
    if not near.any():
        return np.zeros(len(at.limits))
    bounds = np.diag(np.where(at.at <= 0, -1.0, np.where(at.at >= 1, 1.0, 0.0)))
    forces = np.zeros(len(at.limits))
    forces[near] = nnls(np.hstack([at.limit_gradients[near].T, bounds]), -at.gradient)[0][:int(near.sum())]
    return forces


def _turned(old: Evaluation, new: Evaluation, forces: Array) -> Array:
    """Change of the gradient of the Lagrangian over a step."""
    assert old.gradient is not None and new.gradient is not None
    assert old.limit_gradients is not None and new.limit_gradients is not None
    return np.asarray(new.gradient - old.gradient + forces @ (new.limit_gradients - old.limit_gradients))


def _corrected(known: Array, old: Evaluation, new: Evaluation, forces: Array) -> Array:
    """A curvature with small unknown parts, corrected by the error of the last step (symmetric rank one, A. R. Conn, N.
    I. M. Gould, P. L. Toint, 1991, doi:10.1007/BF01594934). BFGS would replace the known curvature along the step; if the
    minimum is narrow in one direction, this is mostly the steep direction."""
    d = new.at - old.at
    missed = _turned(old, new, forces) - known @ d
    along = float(missed @ d)
    if abs(along) < 1e-8 * float(np.linalg.norm(missed) * np.linalg.norm(d)) or not d.any():
        return known
    definite = _definite(known + np.outer(missed, missed) / along)
    return known if definite is None else definite


def _updated(curvature: Array, old: Evaluation, new: Evaluation, forces: Array) -> Array:
    """Damped BFGS (M. J. D. Powell, 1978): stays positive definite if the cost is not convex."""
    d, turned = new.at - old.at, _turned(old, new, forces)
    straight = curvature @ d
    bend, expected = float(d @ turned), float(d @ straight)
    if expected <= 0:
        return curvature
    share = 1.0 if bend >= 0.2 * expected else 0.8 * expected / (expected - bend)
    turned = share * turned + (1 - share) * straight
    return np.asarray(curvature - np.outer(straight, straight) / expected + np.outer(turned, turned) / float(d @ turned))


# -- IPOPT -------------------------------------------------------------------------------------------------------------
class _Slopes(ca.Callback):
    """The Jacobian of `_Costs`, in CasADi's interface."""

    def __init__(self, costs: _Costs):
        ca.Callback.__init__(self)
        self.costs = costs
        self.construct("slopes", {})

    def get_n_in(self) -> int:
        return 2

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return self.costs.get_sparsity_in(0) if i == 0 else self.costs.get_sparsity_out(0)

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self.costs.k, self.costs.n)

    def eval(self, arguments: Sequence[ca.DM]) -> list[ca.DM]:
        slopes = self.costs.seen.slopes(np.array(arguments[0]).ravel())
        if slopes.gradient is None or slopes.limit_gradients is None:
            return [ca.DM.nan(self.costs.k, self.costs.n)]
        return [ca.DM(np.vstack([slopes.gradient[None, :], slopes.limit_gradients]))]


class _Costs(ca.Callback):
    """Cost and limits (1 + k,) of y (n,) as a CasADi function; NaN, from which IPOPT steps back, if a run fails."""

    def __init__(self, memo: _Seen):
        ca.Callback.__init__(self)
        self.seen = memo
        self.n, self.k = len(memo.problem.names), 1 + len(memo.problem.limits)
        self.construct("costs", {})

    def get_n_in(self) -> int:
        return 1

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self.n, 1)

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self.k, 1)

    def eval(self, arguments: Sequence[ca.DM]) -> list[ca.DM]:
        evaluation = self.seen.guarded(np.array(arguments[0]).ravel())
        return [ca.DM(np.append(evaluation.cost, evaluation.limits) if np.isfinite(evaluation.cost)
                      else np.full(self.k, np.nan))]

    def has_jacobian(self) -> bool:
        return True

    @cached_property
    def _slopes(self) -> _Slopes:
        return _Slopes(self)

    def get_jacobian(self, *_: Any) -> ca.Function:
        return self._slopes


def _ipopt(memo: _Seen, first: Array, most_steps: int) -> str:
    begin = abs(memo.plain(first).cost)
    size = begin if np.isfinite(begin) and begin > 0 else 1.0
    costs = _Costs(memo)
    y = ca.MX.sym("y", costs.n)
    solution = costs(y)
    solver = ca.nlpsol("tune", "ipopt", {"x": y, "f": solution[0] / size, "g": solution[1:]}, {
        "print_time": False, "ipopt": {
            "print_level": 0, "sb": "yes", "hessian_approximation": "limited-memory", "max_iter": most_steps,
            "tol": 10 * SEARCH.converged, "acceptable_tol": 100 * SEARCH.converged, "acceptable_iter": 3,
            "acceptable_obj_change_tol": SEARCH.converged, "mu_strategy": "adaptive", "bound_push": 1e-3, "bound_frac": 1e-3,
            "honor_original_bounds": "yes", "nlp_scaling_method": "none"}})
    with suppress(RuntimeError):
        solver(x0=first, lbx=0, ubx=1, lbg=-np.inf, ubg=0)
    return str(solver.stats().get("return_status", "stopped")).replace("_", " ").lower()
