"""Nonlinear equations from a far guess: Newton's method, scaled, damped and kept within bounds, and continuation."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from heavebond.numerics.matrices import Array, Matrix, finite, largest_of_rows, least_change, scaled

# residuals (m,) and Jacobian (m, n) in unknowns counted in their usual sizes
System = Callable[[Array], tuple[Array, Matrix]]


@dataclass(frozen=True)
class NewtonConstants:
    """The constants of the solution of nonlinear equations. Residuals are scaled such that a change of each unknown by its
    usual size changes each residual by about one; constants without a unit are shares of that.

    max_iterations: iterations of Newton's method. Origin: a bound on the time of a hopeless start. Doubled: a start
        without a solution is refused later.
    converged: largest residual of a solution. Origin: ten times below the default relative tolerance of runs. Doubled:
        nothing, as the last step is quadratic.
    acceptable: largest residual accepted where no step makes it smaller. Origin: rounding of equations whose terms far
        exceed their sum. Doubled: starts with poorly scaled equations are accepted sooner.
    min_continuation_step: step of a continuation, as a share of its path, below which it is given up. Origin: a bound
        on the number of steps. Doubled: paths with a sharp bend are given up sooner.
    min_damping: share of a Newton step below which halving it ends. Origin: rounding of the residuals' decrease.
        Doubled: one halving less.
    path_iterations: iterations of one equation on a path between solutions. Origin: from a near solution a few are
        needed. Doubled: longer steps of a path succeed.
    first_pseudo_step: first step in pseudo-time, in s. Origin: below the time constants of machines. Doubled: one step
        less where it is short enough.
    pseudo_step_growth: factor from step to step in pseudo-time. Origin: moderate, so that a step that was accepted is
        followed by one that is. Doubled (in its excess over 1): fewer steps, more of them rejected.
    max_pseudo_steps: steps in pseudo-time. Origin: with the growth above they span any time. Doubled: nothing.
    """

    max_iterations: int = 100
    converged: float = 1e-9
    acceptable: float = 1e-6
    min_continuation_step: float = 1e-3
    min_damping: float = 1e-7
    path_iterations: int = 20
    first_pseudo_step: float = 1e-3
    pseudo_step_growth: float = 1.5
    max_pseudo_steps: int = 160


NEWTON = NewtonConstants()


@dataclass(frozen=True)
class Scaling:
    """The usual sizes of the unknowns and the bounds that they keep to, (n,) each."""

    sizes: Array
    low: Array
    high: Array

    def within(self, y: Array) -> Array:
        """The nearest point within the bounds."""
        return np.clip(y, self.low, self.high)

    def inside(self, y: Array) -> bool:
        """True if no bound is active at the point."""
        return bool(np.all((self.low < y) & (y < self.high)))


@dataclass(frozen=True)
class NewtonResult:
    """The end of a search: y (n,), the scaled residuals (m,) at y, and the number of steps."""

    y: Array
    residual: Array
    steps: int

    @property
    def good(self) -> bool:
        """Whether the equations hold."""
        return bool(np.all(np.isfinite(self.residual)) and np.abs(self.residual).max(initial=0.0) < NEWTON.acceptable)

    @property
    def missed(self) -> tuple[int, float]:
        """The number of equations that do not hold, and the largest residual, for comparison of two results. A result that
        is not finite, such as that of a failed search, compares as the worst."""
        finite_size = np.isfinite(self.size)
        return int((~(np.abs(self.residual) < NEWTON.acceptable)).sum()) if finite_size else sys.maxsize, self.size

    @property
    def size(self) -> float:
        """The largest residual; infinite if a residual is not finite."""
        return float(np.abs(self.residual).max(initial=0.0)) if np.all(np.isfinite(self.residual)) else np.inf


def weights(residual: Array, jacobian: Matrix) -> Array:
    """1 / largest scaled gradient of each row; a row without gradient counts by its own size."""
    gradient = largest_of_rows(jacobian)
    return np.asarray(1 / np.where(gradient > 0, gradient, np.maximum(np.abs(residual), 1e-300)))


@np.errstate(over="ignore", invalid="ignore")  # a trial may go anywhere; what is no number is not taken
def newton(system: System, y: Array, frame: Scaling, most: int = NEWTON.max_iterations) -> NewtonResult:
    """Gauss-Newton method with a limited number of steps of least norm in scaled unknowns. Steps are halved until the
    residual decreases, and clipped at the bounds."""
    y, steps = frame.within(y), 0
    residual, jacobian = system(y)
    for _ in range(most):
        if not residual.size or not np.all(np.isfinite(residual)) or not finite(jacobian):
            break
        row = weights(residual, jacobian)
        size = float(np.linalg.norm(residual * row))
        if np.abs(residual * row).max() < NEWTON.converged:
            break
        weighted = scaled(jacobian, row)
        if not finite(weighted):
            break
        step = least_change(weighted, -residual * row)
        length = 1.0
        while length > NEWTON.min_damping:
            trial = frame.within(y + length * step * frame.sizes)
            new, new_jacobian = system(trial)
            if np.all(np.isfinite(new)) and float(np.linalg.norm(new * row)) < (1 - 1e-4 * length) * size:
                break
            length /= 2
        else:
            break
        y, residual, jacobian = trial, new, new_jacobian
        steps += 1
    scaled_residual = residual * weights(residual, jacobian) if residual.size and finite(jacobian) else residual
    return NewtonResult(y, scaled_residual, steps)


def sharpened(system: System, solution: NewtonResult, frame: Scaling) -> NewtonResult:
    """A solution after one further step, to the rounding of its equations, if this reduces the residual."""
    residual, jacobian = system(solution.y)
    if not residual.size:
        return solution
    row = weights(residual, jacobian)
    y = frame.within(solution.y + least_change(scaled(jacobian, row), -residual * row) * frame.sizes)
    weighted = system(y)[0] * row
    better = np.all(np.isfinite(weighted)) and np.abs(weighted).max() < np.abs(residual * row).max()
    return NewtonResult(y, weighted, solution.steps + 1) if better else solution


def settled(system: System, slowed: Callable[[Array, float], System], y: Array, frame: Scaling, least: float = 0.0
            ) -> NewtonResult:
    """The equilibrium to which a machine settles from y: implicit Euler steps of increasing length until Newton's method
    finds the equilibrium. `slowed(y, step)` are the equations of one step. Newton's method, which may go to another
    equilibrium, is tried once the steps are longer than `least` (s).

    Pseudo-transient continuation; C. T. Kelley, D. E. Keyes, Convergence analysis of pseudo-transient continuation, SIAM J.
    Numer. Anal. 35 (1998) 508-523, doi:10.1137/S0036142996304796.
    """
    y, step, steps = frame.within(y), NEWTON.first_pseudo_step, 0
    result = NewtonResult(y, np.full(1, np.inf), 0)
    for k in range(NEWTON.max_pseudo_steps):
        trial = newton(slowed(y, step), y, frame, NEWTON.path_iterations)
        steps += trial.steps
        if trial.good:
            y, step = trial.y, NEWTON.pseudo_step_growth * step
        else:
            step /= 4
        if k % 8 == 7 and step >= least:
            result = newton(system, y, frame, NEWTON.path_iterations)
            steps += result.steps
        if result.good or step < NEWTON.first_pseudo_step * 1e-4 or not np.all(np.isfinite(y)):
            break
    return NewtonResult(result.y, result.residual, steps)


def continued(family: Callable[[float], System], y: Array, frame: Scaling) -> NewtonResult:
    """F_s(y) = (1 - s) F_0(y_0) for s from 0 to 1, with the equations F_1: the residual at the guess acts as a source that
    is reduced step by step, each solution being the guess for the next. Steps grow and shrink with success.

    The Newton homotopy; E. L. Allgower, K. Georg, Introduction to Numerical Continuation Methods, SIAM 2003, chapter 1,
    doi:10.1137/1.9780898719154.
    """
    y = frame.within(y)
    first, _ = family(0.0)(y)
    result, steps, s, stride = NewtonResult(y, first, 0), 0, 0.0, 0.25
    while s < 1 and stride >= NEWTON.min_continuation_step and np.all(np.isfinite(first)):
        to = min(1.0, s + stride)
        member = family(to)

        def balanced(at: Array, system: System = member, remaining_share: float = 1 - to) -> tuple[Array, Matrix]:
            residual, jacobian = system(at)
            return residual - remaining_share * first, jacobian

        trial = newton(balanced, result.y, frame, NEWTON.path_iterations)
        steps += trial.steps
        if trial.good:
            result, s, stride = trial, to, 2 * stride
        else:
            stride /= 4
    last, jacobian = family(1.0)(result.y)
    weighted = last * weights(last, jacobian) if last.size and finite(jacobian) else last
    return NewtonResult(result.y, weighted, steps)
