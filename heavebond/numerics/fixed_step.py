"""Integration with a fixed step and without error control: Euler, Runge-Kutta of order 4, backward Euler.

They reproduce the results of programs that use these methods, where a model depends on the step. The steps begin at
multiples of the step from the start of the run. Values at output times between two steps are interpolated: linearly, for
Runge-Kutta by the cubic polynomial with the values and rates at both ends. E. Hairer, S. P. Nørsett and G. Wanner, Solving
Ordinary Differential Equations I, 1993, II.1 and II.6; E. Hairer and G. Wanner, II, 1996, IV.3.

In a diagram with events, an event at a known time, such as a sample, ends a step at that time, and a shorter step leads to
the next multiple. A condition is evaluated at the ends of the steps: its event happens at the end of the step in which it
becomes true, so that the error of a run is of order 1. An event that brings its condition nearer to its end without
reaching it, such as the count of an encoder, happens again at once.

A step h of an explicit method multiplies a motion exp(lambda t) by R(h lambda), with the stability function R (1 + z for
Euler's method). If Re lambda <= 0 and |R(h lambda)| > 1, a motion that decays grows instead. The eigenvalues lambda of the
Jacobian matrix at some points of the run therefore give the limit of stability of the step.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import casadi as ca
import numpy as np

from heavebond.core.errors import Problem, UsageError
from heavebond.equations.buffered import Buffered
from heavebond.numerics.dae import Array, Integrand

MOST_STEPS = 100_000_000  # some minutes
# Share of a step that is rounding: a stop that is no further from the end of a step is this end.
SAME = 1e-6
WINDOW = 64  # steps of a run with events whose conditions are evaluated together
STEP_CASCADES = 10_000  # largest number of repetitions of an event at the end of one step (count of an encoder)
# Newton's method of backward Euler ends when its last change, in nominal sizes and relative to larger values, is below this:
# it converges quadratically, so that the error is then of rounding.
CONVERGED = 1e-10
MOST_ITERATIONS = 50
# Points of a run whose eigenvalues are computed, states above which they are not, and the growth of a motion during the run
# beyond which the step is unstable: less is an error among others.
POINTS, LARGE, GROWTH = 8, 300, 2.0


def amplification(z: Array, fourth_order: bool) -> Array:
    """The factor |R(z)|, z = h lambda, by which a step h of Runge-Kutta of order 4 or of Euler multiplies a motion
    exp(lambda t)."""
    return np.asarray(np.abs(1 + z + (z**2 / 2 + z**3 / 6 + z**4 / 24 if fourth_order else 0)))


def longest_step(grows: Callable[[float], bool], step: float) -> float | None:
    """The longest step (s) with which no motion grows, by bisection of `grows`; None if no motion grows with `step`."""
    if not grows(step):
        return None
    low, high = 0.0, step
    for _ in range(30):
        middle = (low + high) / 2
        low, high = (low, middle) if grows(middle) else (middle, high)
    return low


class FixedStep:
    """An integration with steps of `integrand.longest`, called as the other integrators are. RuntimeError if a value
    overflows or if Newton's method of backward Euler fails."""

    def __init__(self, solver: str, integrand: Integrand, stops: Array):
        dae, self._stops, self._step = integrand.dae, np.asarray(stops, float), integrand.longest
        if (stops[-1] - stops[0]) / self._step > MOST_STEPS:
            raise UsageError([Problem("step-too-short", f"a step of {self._step:g} s makes "
                                      f"{(stops[-1] - stops[0]) / self._step:.3g} steps; the most is {MOST_STEPS}", None,
                                      "Make the step longer, or the run shorter.")])
        t, x, z, p, u = (dae[name] for name in ("t", "x", "z", "p", "u"))
        self._sizes = {"x0": x.numel(), "z0": z.numel(), "p": p.numel(), "u": u.numel()}
        rates, h = ca.Function("rates", [t, x, z, p, u], [dae["ode"]]), self._step
        self._rates = Buffered(rates)
        self._implicit, self._cubic = solver == "backward-euler", solver == "rk4"
        if self._implicit:
            self._next = Buffered(_residual(dae, h, []))
            return
        self._next = Buffered(ca.Function("step", [t, x, z, p, u], [ca.densify(_explicit(solver, dae, rates, h))]))
        if x.numel() <= LARGE:
            self._jacobian = Buffered(ca.Function("jacobian", [t, x, z, p, u], [ca.densify(ca.jacobian(dae["ode"], x))]))

    def size1_in(self, name: str) -> int:
        """The number of numbers in an input."""
        return self._sizes[name]

    def stats(self) -> dict[str, Any]:
        """The number of steps of the last call, and the limit of stability (s) if its step is beyond it."""
        return {"nsteps": self._steps, **({"stable_step": self._limit} if self._limit is not None else {})}

    def __call__(self, **arguments: Any) -> dict[str, Array]:
        """The states and algebraic unknowns (n, N) at the stops after the first."""
        x, z, p = (np.asarray(arguments[name], float).ravel() for name in ("x0", "z0", "p"))
        stops, h = self._stops - self._stops[0], self._step
        u = np.asarray(arguments["u"], float).reshape(self._sizes["u"], len(stops) - 1)
        xf, zf = np.empty((len(x), len(stops) - 1)), np.empty((len(z), len(stops) - 1))
        j, k, jacobians = 1, 0, list[Array]()
        every = max(1, int(stops[-1] / h) // POINTS)
        while j < len(stops):
            begin, x_before, z_before = self._stops[0] + k * h, x, z
            end = self._stops[0] + (k + 1) * h
            # the piece of the measured inputs at the instant that the method reads first
            piece = int(np.searchsorted(stops, (k + 1 - SAME if self._implicit else k + SAME) * h, side="right")) - 1
            pieces = u[:, min(piece, u.shape[1] - 1)]
            if self._jacobian is not None and k % every == 0:
                jacobians.append(self._jacobian(begin, x, z, p, pieces)["o0"].copy())
            if self._implicit:
                x, z = self._solved(end, x, z, p, pieces)
            else:
                x = self._next(begin, x, z, p, pieces)["o0"].ravel()
            if not np.all(np.isfinite(x)):
                known = [jacobian for jacobian in jacobians if np.all(np.isfinite(jacobian))]
                self._steps, self._limit = k + 1, self._limit_of_stability(np.array(known), k + 1) if known else None
                raise RuntimeError(f"a value became infinite or not a number at t = {end:.6g}")
            k += 1
            while j < len(stops) and stops[j] <= (k + SAME) * h:
                share = stops[j] / h - (k - 1)
                if share >= 1 - SAME:
                    xf[:, j - 1], zf[:, j - 1] = x, z
                else:
                    xf[:, j - 1] = x_before + share * (x - x_before)
                    zf[:, j - 1] = z_before + share * (z - z_before)
                    if self._cubic:
                        slopes = [h * self._rates(t, at, z, p, pieces)["o0"].ravel() - (x - x_before)
                                  for t, at in ((begin, x_before), (end, x))]
                        xf[:, j - 1] += share * (1 - share) * ((1 - share) * slopes[0] - share * slopes[1])
                j += 1
        self._steps, self._limit = k, self._limit_of_stability(np.array(jacobians), k) if jacobians else None
        return {"xf": xf, "zf": zf}

    _steps = 0
    _limit: float | None = None
    _jacobian: Buffered | None = None

    def _limit_of_stability(self, jacobians: Array, steps: int) -> float | None:
        """The largest step (s) with which no motion that decays or stays grows to `GROWTH` times its size during the run, if
        the step is longer."""
        if not np.all(np.isfinite(jacobians)):
            return None
        eigenvalues = np.linalg.eigvals(jacobians).ravel()
        eigenvalues = eigenvalues[eigenvalues.real <= 1e-9 * np.abs(eigenvalues)]

        def grows(h: float) -> bool:
            factor = amplification(h * eigenvalues, self._cubic)
            return bool(np.any(np.log(np.maximum(factor, 1.0)) * (steps * self._step / h) > np.log(GROWTH)))

        return longest_step(grows, self._step)

    def _solved(self, t: float, before: Array, z: Array, p: Array, u: Array) -> tuple[Array, Array]:
        """The states and algebraic unknowns at the end of a step of backward Euler, by Newton's method from those at its
        begin."""
        return _solved(lambda both: self._next(t, before, both, p, u), t, before, z)


class Steps:
    """Single steps of variable length, for runs with events. RuntimeError as in `FixedStep`."""

    def __init__(self, solver: str, integrand: Integrand):
        dae, h = integrand.dae, ca.SX.sym("h")
        t, x, z, p, u = (dae[name] for name in ("t", "x", "z", "p", "u"))
        rates = ca.Function("rates", [t, x, z, p, u], [dae["ode"]])
        self._rates, self.solver = Buffered(rates), solver
        self._next = Buffered(_residual(dae, h, [h])) if solver == "backward-euler" else Buffered(
            ca.Function("step", [t, x, z, p, u, h], [ca.densify(_explicit(solver, dae, rates, h))]))

    def step(self, t: float, x: Array, z: Array, p: Array, u: Array, h: float) -> tuple[Array, Array]:
        """The states and algebraic unknowns a step h after t; u are the inputs at the instant that the method reads."""
        if self.solver == "backward-euler":
            x, z = _solved(lambda both: self._next(t + h, x, both, p, u, h), t + h, x, z)
        else:
            x = self._next(t, x, z, p, u, h)["o0"].ravel().copy()
        if not np.all(np.isfinite(x)):
            raise RuntimeError(f"a value became infinite or not a number at t = {t + h:.6g}")
        return x, z

    def between(self, t: float, ends: tuple[Array, Array], z: Array, p: Array, u: Array, h: float, shares: Array) -> Array:
        """The states (n_x, k) at shares of a step between its `ends`: linear, for Runge-Kutta by the cubic polynomial with
        the rates at both ends."""
        before, after = ends
        change = (after - before)[:, None]
        inner = before[:, None] + shares * change
        if self.solver == "rk4":
            first, last = (h * self._rates(at, x, z, p, u)["o0"].ravel()[:, None].copy() - change
                           for at, x in ((t, before), (t + h, after)))
            inner = inner + shares * (1 - shares) * ((1 - shares) * first - shares * last)
        return np.asarray(inner)


def _explicit(solver: str, dae: dict[str, ca.SX], rates: ca.Function, h: float | ca.SX) -> ca.SX:
    """The states after a step h of an explicit method."""
    t, x, z, p, u = (dae[name] for name in ("t", "x", "z", "p", "u"))
    slope = first = rates(t, x, z, p, u)
    if solver == "rk4":
        second = rates(t + h / 2, x + h / 2 * first, z, p, u)
        third = rates(t + h / 2, x + h / 2 * second, z, p, u)
        slope = (first + 2 * second + 2 * third + rates(t + h, x + h * third, z, p, u)) / 6
    return x + h * slope


def _residual(dae: dict[str, ca.SX], h: float | ca.SX, more: list[ca.SX]) -> ca.Function:
    """The residual of a step of backward Euler and its Jacobian; `more` are further arguments."""
    t, x, z, p, u = (dae[name] for name in ("t", "x", "z", "p", "u"))
    before, both = ca.SX.sym("before", x.numel()), ca.vertcat(x, z)
    residual = ca.vertcat(x - before - h * dae["ode"], dae["alg"])
    return ca.Function("residual", [t, before, both, p, u, *more], [
        ca.densify(residual), ca.densify(ca.jacobian(residual, both))])


def _solved(system: Callable[[Array], Mapping[str, Array]], t: float, before: Array, z: Array) -> tuple[Array, Array]:
    """The states and algebraic unknowns at the end of a step of backward Euler, by Newton's method."""
    both = np.concatenate([before, z])
    for _ in range(MOST_ITERATIONS):
        step = system(both)
        try:
            change = np.linalg.solve(step["o1"], -step["o0"].ravel())
        except np.linalg.LinAlgError:
            raise RuntimeError(f"the equations of the step to t = {t:.6g} are singular") from None
        both = both + change
        if np.all(np.abs(change) <= CONVERGED * (1 + np.abs(both))):
            return both[:len(before)], both[len(before):]
    raise RuntimeError(f"Newton's method does not converge in the step to t = {t:.6g}")
