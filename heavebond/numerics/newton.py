"""Nonlinear equations from a far guess: Newton's method, scaled, damped and kept within bounds, and continuation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from heavebond.numerics.matrices import Array, Matrix, finite, largest_of_rows, least_change, scaled

# residuals (m,) and Jacobian (m, n) in unknowns counted in their usual sizes
System = Callable[[Array], tuple[Array, Matrix]]
MOST_STEPS = 100
# residuals are scaled so that a change of every unknown by its usual size changes each by about one
CONVERGED = 1e-9
GOOD = 1e-6
# a continuation whose steps become shorter than this share of the whole is given up
SHORTEST = 1e-3
# share of a step below which halving it is given up; steps of one equation on a path from solution to solution
SHORTEST_STEP, ON_A_PATH = 1e-7, 20
# steps of pseudo-time, in s
FIRST_STEP, GROWTH, MOST_PSEUDO_STEPS = 1e-3, 1.5, 160


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
        """Whether no bound holds the point."""
        return bool(np.all((self.low < y) & (y < self.high)))


@dataclass(frozen=True)
class NewtonResult:
    """Where a search ended: y (n,), the scaled residuals there (m,), and the steps that it took."""

    y: Array
    residual: Array
    steps: int

    @property
    def good(self) -> bool:
        """Whether the equations hold."""
        return bool(np.all(np.isfinite(self.residual)) and np.abs(self.residual).max(initial=0.0) < GOOD)

    @property
    def missed(self) -> tuple[int, float]:
        """How many equations do not hold, and the largest residual: of two ends of a search the one that is nearer."""
        return int((~(np.abs(self.residual) < GOOD)).sum()) if np.isfinite(self.size) else len(self.residual) + 1, self.size

    @property
    def size(self) -> float:
        """The largest residual; infinite where one is no number."""
        return float(np.abs(self.residual).max(initial=0.0)) if np.all(np.isfinite(self.residual)) else np.inf


def weights(residual: Array, jacobian: Matrix) -> Array:
    """1 / largest scaled gradient of each row; a row without gradient counts by its own size."""
    gradient = largest_of_rows(jacobian)
    return np.asarray(1 / np.where(gradient > 0, gradient, np.maximum(np.abs(residual), 1e-300)))


@np.errstate(over="ignore", invalid="ignore")  # a trial may go anywhere; what is no number is not taken
def newton(system: System, y: Array, frame: Scaling, most: int = MOST_STEPS) -> NewtonResult:
    """Gauss-Newton with at most so many steps of least norm in scaled unknowns, halved until the residual falls; a step
    that leaves the bounds is cut at them."""
    y, steps = frame.within(y), 0
    residual, jacobian = system(y)
    for _ in range(most):
        if not residual.size or not np.all(np.isfinite(residual)) or not finite(jacobian):
            break
        row = weights(residual, jacobian)
        size = float(np.linalg.norm(residual * row))
        if np.abs(residual * row).max() < CONVERGED:
            break
        weighted = scaled(jacobian, row)
        if not finite(weighted):
            break
        step = least_change(weighted, -residual * row)
        length = 1.0
        while length > SHORTEST_STEP:
            trial = frame.within(y + length * step * frame.sizes)
            new, new_jacobian = system(trial)
            if np.all(np.isfinite(new)) and float(np.linalg.norm(new * row)) < (1 - 1e-4 * length) * size:
                break
            length /= 2
        else:
            break
        y, residual, jacobian = trial, new, new_jacobian
        steps += 1
    left = residual * weights(residual, jacobian) if residual.size and finite(jacobian) else residual
    return NewtonResult(y, left, steps)


def settled(system: System, slowed: Callable[[Array, float], System], y: Array, frame: Scaling) -> NewtonResult:
    """Where a machine comes to rest from y by itself: implicit Euler steps, short at first and then ever longer, until
    Newton's method finds the equilibrium. `slowed(y, step)` are the equations of one step.

    Pseudo-transient continuation; C. T. Kelley, D. E. Keyes, Convergence analysis of pseudo-transient continuation, SIAM J.
    Numer. Anal. 35 (1998) 508-523, doi:10.1137/S0036142996304796.
    """
    y, step, steps = frame.within(y), FIRST_STEP, 0
    found = NewtonResult(y, np.full(1, np.inf), 0)
    for k in range(MOST_PSEUDO_STEPS):
        trial = newton(slowed(y, step), y, frame, ON_A_PATH)
        steps += trial.steps
        if trial.good:
            y, step = trial.y, GROWTH * step
        else:
            step /= 4
        if k % 8 == 7:
            found = newton(system, y, frame, ON_A_PATH)
            steps += found.steps
        if found.good or step < FIRST_STEP * 1e-4 or not np.all(np.isfinite(y)):
            break
    return NewtonResult(found.y, found.residual, steps)


def continued(family: Callable[[float], System], y: Array, frame: Scaling) -> NewtonResult:
    """F_s(y) = (1 - s) F_0(y_0) for s from 0 to 1, where F_1 are the equations: what is out of balance at the guess acts as
    a source that is taken away little by little, each solution being the guess for the next. Steps grow and shrink with
    success.

    The Newton homotopy; E. L. Allgower, K. Georg, Introduction to Numerical Continuation Methods, SIAM 2003, chapter 1,
    doi:10.1137/1.9780898719154.
    """
    y = frame.within(y)
    first, _ = family(0.0)(y)
    found, steps, s, stride = NewtonResult(y, first, 0), 0, 0.0, 0.25
    while s < 1 and stride >= SHORTEST and np.all(np.isfinite(first)):
        to = min(1.0, s + stride)
        member = family(to)

        def balanced(at: Array, system: System = member, left: float = 1 - to) -> tuple[Array, Matrix]:
            residual, jacobian = system(at)
            return residual - left * first, jacobian

        trial = newton(balanced, found.y, frame, ON_A_PATH)
        steps += trial.steps
        if trial.good:
            found, s, stride = trial, to, 2 * stride
        else:
            stride /= 4
    last, jacobian = family(1.0)(found.y)
    weighted = last * weights(last, jacobian) if last.size and finite(jacobian) else last
    return NewtonResult(found.y, weighted, steps)
