"""Costs of runs and their derivatives: from quadratures of the integrator, signals and modes.

See `heavebond.optimise.costs` for the formulas.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.language.symbols import stack
from heavebond.linear.modal_values import NUMBERS, ModalNumbers
from heavebond.numerics.dae import Array, Assembly, Factors
from heavebond.numerics.pointwise import evaluated
from heavebond.numerics.result import Result, columns, with_held
from heavebond.optimise.costs import Cost, Functional
from heavebond.optimise.sampled_values import SAMPLED, sampled_value

# A high power selects the largest value; above some dozens the gradient depends on one sample only.
PEAK_POWER = 32
# Integrand of a scaled signal, if it is not the signal itself.
POWERS = {"rms": 2, "peak": PEAK_POWER}
# Signals grow to their full size in the integrals within this share of the evaluated time, before it begins; until then they
# are limited to so many times their scale (its 32nd power is 4e3).
RAMP = 0.05
MOST = 1.3
# mean of |sin|**m over a period is (m-1)!!/m!!: the factor that makes the peak of a sine exact
PEAK_OF_SINE = float(np.prod([(k - 1) / k for k in range(2, PEAK_POWER + 1, 2)]) ** (-1 / PEAK_POWER))


@dataclass(frozen=True)
class CostSlopes:
    """A cost of a run and its derivatives by each integral (n_q,), by each functional's last value (n,), by p (n_p,)."""

    value: float
    by_integral: Array
    by_final: Array
    by_p: Array


class Evaluator:
    """Several costs of runs evaluated between two times (s): their quadratures and their values.

    A run begins at 0 and ends at `end`, with an output point at `begin`; its Simulator receives `quadratures` and
    `factors`. Functionals of one kind and signal share one integral; each signal is divided by its size (n_q,), one at
    first, so that all integrals have equal weight in the error control, and is limited to that size until shortly before
    `begin`. `named` are the parameters by which numbers of modes are differentiated, `modes` the values that are set in
    their computation.
    """

    def __init__(self, assembly: Assembly, costs: list[Cost], begin: float, end: float, *, named: tuple[str, ...] = (),
                 modes: Mapping[str, float | str] | None = None):
        self.assembly, self.costs, self.begin, self.length, self.named = assembly, costs, begin, end - begin, named
        self.functionals = [f for cost in costs for f in cost.functionals]
        self.integrated: list[Functional] = []
        self.columns: list[int | None] = [self._column(f) for f in self.functionals]
        n_q = len(self.integrated)
        self.factors = Factors(ca.SX.sym("w", n_q), np.ones(n_q))
        # 0 before begin - ramp, 1 from begin on, smooth in between (a jump would stop the integrator, a kink slow it)
        ramp = min(begin, RAMP * (end - begin))
        if ramp <= 0:
            gate = ca.SX(1)
        else:
            s = ca.fmin(ca.fmax((assembly.arguments[0] - begin) / ramp + 1, 0), 1)
            gate = s**3 * (10 - 15 * s + 6 * s**2)
        scaled = [_until(gate, self.factors.symbols[k] * f.signal) for k, f in enumerate(self.integrated)]
        self.quadratures = stack([s ** POWERS.get(f.kind, 1) for f, s in zip(self.integrated, scaled, strict=True)])
        self._integrated = _functional_sensitivities(assembly, self.integrated)
        self._finals = _functional_sensitivities(assembly, self.functionals)
        modal = any(f.kind in NUMBERS for f in self.functionals)
        self._modal = ModalNumbers(assembly, modes or {}, named) if modal else None

    def _column(self, functional: Functional) -> int | None:
        """Index of the integral of a functional; None if it needs none."""
        if functional.kind in ("final", *SAMPLED, *NUMBERS):
            return None
        for k, known in enumerate(self.integrated):
            if functional.same_integral(known):
                return k
        self.integrated.append(functional)
        return len(self.integrated) - 1

    @property
    def sampled(self) -> bool:
        """True if a functional uses the points of a run: these must be dense then (see `Result.dense`)."""
        return any(f.kind in SAMPLED for f in self.functionals)

    @property
    def sizes(self) -> Array:
        """Scale of each signal (n_q,)."""
        return np.asarray(1 / self.factors.values)

    def resized(self, sizes: Array) -> Factors:
        """The factors for other sizes (zero: unchanged); later runs and values use these."""
        sizes = np.where(np.isfinite(sizes) & (sizes > 0), sizes, self.sizes)
        self.factors = Factors(self.factors.symbols, 1 / sizes)
        return self.factors

    def largest(self, run: Result) -> Array:
        """The largest |signal| of each integral (n_q,) at the times of a run that lie in the window."""
        inside = run.time >= self.begin
        return np.asarray(np.abs(_signal_sensitivities(self._integrated, run, inside)[0]).max(axis=1, initial=0.0))

    def found_sizes(self, values: Array) -> Array:
        """The size (n_q,) of each signal from the functionals of a run; zero if it is unknown."""
        sizes = np.zeros(len(self.integrated))
        for f, column, value in zip(self.functionals, self.columns, values, strict=True):
            if column is not None and f.kind in ("rms", "peak"):
                sizes[column] = abs(value)
        return sizes

    def integrals(self, run: Result) -> Array:
        """The integrals (n_q,) of a run over the evaluated time."""
        return np.asarray(run.quadratures[:, -1] - run.quadratures[:, np.searchsorted(run.time, self.begin)])

    def functional_values(self, result: Result) -> tuple[Array, Array]:
        """The functionals (n,) of a run and their derivatives (m, n) along its sensitivities."""
        m = 0 if result.along is None else len(result.along.names)
        values, slopes = np.zeros(len(self.functionals)), np.zeros((m, len(self.functionals)))
        integrals, first = self.integrals(result), int(np.searchsorted(result.time, self.begin))
        for k, (f, column) in enumerate(zip(self.functionals, self.columns, strict=True)):
            if column is not None:
                values[k], slope = _from_integral(f.kind, integrals[column], self.length, self.sizes[column])
                if result.along is not None:
                    slopes_of_column = result.along.quadratures[:, column]
                    slopes[:, k] = slope * (slopes_of_column[:, -1] - slopes_of_column[:, first])
            elif self._modal is not None and f.kind in NUMBERS:
                values[k], by_p = self._modal.at(f.kind, f.which, result.p)
                if result.along is not None:
                    slopes[:, k] = result.along.p @ by_p
        pointwise = [k for k, f in enumerate(self.functionals) if f.kind in ("final", *SAMPLED)]
        if pointwise:
            run = result.dense if self.sampled else result
            inside = run.time >= (self.begin if self.sampled else run.time[-1])
            signals, signal_slopes = _signal_sensitivities(self._finals, run, inside)
            for k in pointwise:
                kind = self.functionals[k].kind
                values[k], slopes[:, k] = (signals[k, -1], signal_slopes[:, k, -1]) if kind == "final" else \
                    sampled_value(kind, run.time[inside], signals[k], signal_slopes[:, k], self.functionals[k].exponent)
        return values, slopes

    def curvature(self, result: Result, references: Array) -> Array:
        """The second derivative (m, m) of the first cost along the sensitivities of a run with output points in the window,
        without the terms of second derivatives of signals (Gauss-Newton): for signals s,

            d2 int r(s) dt = int r'' ds ds^T dt (+ int r' d2s dt)."""
        values, slopes = self.functional_values(result)
        cost, inside = self.costs[0], result.time >= self.begin
        chosen = slice(0, len(cost.functionals))
        _, by_value, _ = self._at(cost, values[chosen], references[chosen], result.p)
        signals, sensitivities = _signal_sensitivities(self._integrated, result, inside)
        steps = np.gradient(result.time[inside])
        steps[[0, -1]] /= 2
        hessian = np.zeros((len(slopes), len(slopes)))
        for k, by in enumerate(by_value):
            kind, column = self.functionals[k].kind, self.columns[k]
            if column is None or kind not in POWERS or not by:
                continue
            power, size = POWERS[kind], self.sizes[column]
            bend = power * (power - 1) * (signals[column] / size) ** (power - 2) / size**2
            inner = (sensitivities[:, column] * bend * steps) @ sensitivities[:, column].T
            slope = _from_integral(kind, self.integrals(result)[column], self.length, size)[1]
            # (q/T)**(1/power) is concave
            hessian += by * (slope * inner - (power - 1) * np.outer(slopes[:, k], slopes[:, k]) / max(values[k], 1e-300))
        return hessian

    def cost_slopes(self, result: Result, references: Array) -> list[CostSlopes]:
        """Each cost of a run and its direct derivatives; `references` are the functionals of the reference run."""
        values, _ = self.functional_values(result)
        integrals = self.integrals(result)
        final = np.array([f.kind == "final" for f in self.functionals], dtype=bool)
        cost_slopes, first = [], 0
        for cost in self.costs:
            chosen = slice(first, first + len(cost.functionals))
            first = chosen.stop
            value, by_value, by_p = self._at(cost, values[chosen], references[chosen], result.p)
            by_functional = np.zeros(len(values))
            by_functional[chosen] = by_value
            by_integral = np.zeros(len(self.integrated))
            for f, column, by in zip(self.functionals, self.columns, by_functional, strict=True):
                if column is not None:
                    slope = _from_integral(f.kind, integrals[column], self.length, self.sizes[column])[1]
                    by_integral[column] += by * slope
                elif self._modal is not None and f.kind in NUMBERS:
                    by_p = by_p + by * self._modal.at(f.kind, f.which, result.p)[1]
            cost_slopes.append(CostSlopes(value, by_integral, np.where(final, by_functional, 0.0), by_p))
        return cost_slopes

    @staticmethod
    def _at(cost: Cost, values: Array, references: Array, p: Array) -> tuple[float, Array, Array]:
        """A cost and its derivatives by its functionals (with constant reference values) and by p."""
        is_reference = np.array(cost.references, dtype=bool)
        inner = np.where(is_reference, references, values)
        by_value, by_p = (np.array(g).ravel() for g in cost.gradient(inner, p))
        return float(cost.value(inner, p)), np.where(is_reference, 0.0, by_value), by_p

    def cost_values(self, values: Array, slopes: Array, references: Array, p: Array, dp: Array) -> list[tuple[float, Array]]:
        """Each cost and its gradient (m,), from the functionals of the run and of the reference run."""
        costs_with_gradients = []
        first = 0
        for cost in self.costs:
            chosen = slice(first, first + len(cost.functionals))
            first = chosen.stop
            value, by_value, by_p = self._at(cost, values[chosen], references[chosen], p)
            costs_with_gradients.append((value, slopes[:, chosen] @ by_value + dp @ by_p))
        return costs_with_gradients


def _functional_sensitivities(assembly: Assembly, functionals: list[Functional]) -> ca.Function:
    """The signals (n,) of functionals, and their change along dx, dz, dp."""
    t, x, z, p, u, rate = assembly.arguments
    signals = stack([f.signal for f in functionals])
    dx, dz, dp = (ca.SX.sym("d", a.numel()) for a in (x, z, p))
    directional = ca.SX(len(functionals), 1)
    for argument, direction in ((x, dx), (z, dz), (p, dp)):
        if argument.numel() and signals.numel():
            directional += ca.jtimes(signals, argument, direction)
    return ca.Function("moved", [t, x, z, p, u, rate, dx, dz, dp], [signals, directional])


def _signal_sensitivities(function: ca.Function, run: Result, chosen: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Signals (n, N) at chosen times of a run, and their change (m, n, N) along its sensitivities."""
    arguments = [c[:, chosen] for c in columns(run)]
    number, n = int(np.count_nonzero(chosen)), function.size1_out(0)
    names = () if run.along is None else run.along.names
    if not number:
        return np.zeros((n, 0)), np.zeros((len(names), n, 0))
    still = [np.zeros((len(a), number)) for a in (run.x, run.z, run.p)]
    signals = evaluated(run.assembly, function, [*arguments, *still])[0]
    if run.along is None:
        return signals, np.zeros((0, n, number))
    directions = zip(run.along.x, run.along.z, run.along.p, run.along.held, strict=True)
    return signals, np.array([evaluated(run.assembly, function,
                                        [*arguments,
                                         *(direction[:, chosen] for direction in (x, z, with_held(run, p, held)))])[1]
                              for x, z, p, held in directions]).reshape(len(names), n, number)


def _until(gate: ca.SX, scaled: ca.SX) -> ca.SX:
    """A scaled signal, limited to MOST before the gate opens: the integrator still resolves it, but a large transient
    cannot dominate."""
    return scaled if gate.is_constant() else (held := MOST * ca.tanh(scaled / MOST)) + gate * (scaled - held)


def _from_integral(kind: str, integral: float, length: float, size: float) -> tuple[float, float]:
    """The functional and its derivative with respect to the integral of the scaled signal."""
    mean = integral / length
    if kind == "integral":
        return integral * size, size
    if kind == "mean":
        return mean * size, size / length
    if mean <= 0:
        return 0.0, 0.0
    if kind == "rms":
        return float(size * np.sqrt(mean)), float(0.5 * size / np.sqrt(mean) / length)
    value = PEAK_OF_SINE * size * mean ** (1 / PEAK_POWER)
    return float(value), float(value / PEAK_POWER / mean / length)
