"""Simulation of a base model with a law at a place, and the fit of its parameters, for entries that are not heavebond.

The law is a function of the across variable and the position at the place. If these depend on the input itself (a node
without a capacity), the input follows from a secant iteration.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from benchmarks.missing_physics.reading import Array, Case, Record, System, Values, parsed

RTOL, ATOL = 1e-6, 1e-8
STEP = 1e-3  # of half a tolerance, or of a number of the law, for differences: runs are accurate to 1e-6
FAILED = 1e5  # residual of a run that fails, in noise units
Law = Callable[[float, float, Sequence[float]], float]


class Course:
    """An input between its samples, with its first three derivatives."""

    def __init__(self, time: Array, values: Array, interpolation: str):
        self.begin, self.step, self.last = float(time[0]), float(time[1] - time[0]), len(time) - 2
        if interpolation == "spline":
            self.rows = CubicSpline(time, values).c.T.tolist()
        else:
            slopes = np.diff(values) / np.diff(time) * (interpolation == "linear")
            self.rows = [[0.0, 0.0, b, a] for a, b in zip(values[:-1], slopes, strict=True)]

    def at(self, t: float) -> tuple[float, float, float, float]:
        """The value and its derivatives."""
        k = min(max(int((t - self.begin) / self.step), 0), self.last)
        s, (a, b, c, d) = t - self.begin - k * self.step, self.rows[k]
        return ((a * s + b) * s + c) * s + d, (3 * a * s + 2 * b) * s + c, 6 * a * s + 2 * b, 6 * a


@dataclass(frozen=True)
class AtPlace:
    """A law w(across, position; numbers) at a place of the model."""

    place: Mapping[str, Any]
    law: Law
    numbers: tuple[float, ...] = ()


class Simulation:
    """A case, ready to be run with parameters and a law."""

    def __init__(self, case: Case):
        self.case, self.system = case, System(case)
        self.size = np.array([max(abs(v), 1e-3) for v in self.system.start])
        self.noise = {name: channel["noise"] for name, channel in case.outputs.items()}
        self.ends = clock.process_time() + 1e9

    def _inputs(self, record: Record) -> dict[str, Course]:
        return {name: Course(record.time, values, self.case.content["inputs"][name]["interpolation"])
                for name, values in record.inputs.items()}

    def _point(self, courses: Mapping[str, Course], parameters: Mapping[str, float], t: float, x: Sequence[float] | Array,
               law: AtPlace | None) -> Values:
        values: Values = {**parameters, "time": t, **dict(zip(self.system.states, map(float, x), strict=True))}
        for name, course in courses.items():
            u, first, second, third = course.at(t)
            values[name], values[f"der({name})"] = u, first
            values[f"der(der({name}))"], values[f"der(der(der({name})))"] = second, third
        if law is not None:
            values.update(self.entering(values, law))
        return values

    def around(self, place: Mapping[str, Any]) -> tuple[Callable[[Values], Any], Callable[[Values], Any] | None]:
        """The across variable and the position of a place as functions of the signals."""
        return parsed(place["across"]), parsed(place["position"]) if place["position"] else None

    def entering(self, values: Values, law: AtPlace) -> dict[str, float]:
        """What the law lets enter each node."""
        across, position = self.around(law.place)
        enters = law.place["enters"]

        def at(w: float) -> float:
            signals = self.system.signals({**values, **{node: weight * w for node, weight in enters.items()}})
            return law.law(float(across(signals)), float(position(signals)) if position else 0.0, law.numbers)

        w = at(0.0)
        if w and (after := at(w)) != w:  # the variables depend on the input
            before, f_before, now = 0.0, w, w
            f_now = after - w
            for _ in range(12):
                if f_now == f_before or abs(f_now) <= 1e-9 * abs(w):
                    break
                before, now, f_before = now, now - f_now * (now - before) / (f_now - f_before), f_now
                f_now = at(now) - now
            w = now
        return {node: weight * w for node, weight in enters.items()}

    def run(self, record: Record, parameters: Mapping[str, float] | None = None, law: AtPlace | None = None) -> Array | None:
        """The states (N, n) in a record; None if the run fails."""
        courses, known = self._inputs(record), {**self.system.parameters, **(parameters or {})}

        def slope(t: float, x: Array) -> list[float]:
            if clock.process_time() > self.ends:
                raise TimeoutError
            return self.system.derivatives(self._point(courses, known, t, x, law))

        try:
            found = solve_ivp(slope, (record.time[0], record.time[-1]), self.system.start, "LSODA", record.time, rtol=RTOL,
                              atol=ATOL * self.size, max_step=(record.time[-1] - record.time[0]) / 50)
        except (ArithmeticError, ValueError, TypeError):
            return None
        return found.y.T if found.success and np.all(np.isfinite(found.y)) else None

    def channels(self, record: Record, parameters: Mapping[str, float] | None = None, law: AtPlace | None = None
                 ) -> dict[str, Array] | None:
        """The channels in a record (SI); None if the run fails."""
        states = self.run(record, parameters, law)
        if states is None:
            return None
        courses, known = self._inputs(record), {**self.system.parameters, **(parameters or {})}
        rows = [self.system.outputs(self._point(courses, known, t, x, law))
                for t, x in zip(record.time, states, strict=True)]
        return {name: np.array([float(row[name]) for row in rows]) for name in self.case.outputs}

    def motion(self, record: Record, parameters: Mapping[str, float], law: AtPlace) -> tuple[Array, Array, Array]:
        """The across variable, the position and the input at the place of a law (N,) in a record."""
        states = self.run(record, parameters, law)
        if states is None:
            return (np.full(len(record.time), np.nan),) * 3
        courses, known = self._inputs(record), {**self.system.parameters, **parameters}
        across, position = self.around(law.place)
        rows = []
        for t, x in zip(record.time, states, strict=True):
            values = self._point(courses, known, t, x, law)
            signals = self.system.signals(values)
            node, weight = next(iter(law.place["enters"].items()))
            rows.append((float(across(signals)), float(position(signals)) if position else 0.0, values[node] / weight))
        found = np.array(rows).T
        return found[0], found[1], found[2]

    def fitted(self, law: AtPlace | None = None, start: Mapping[str, float] | None = None, runs: int = 12,
               records: Sequence[Record] | None = None) -> Fitted:
        """The free parameters, and the numbers of a law, fitted to all records with measured outputs but the scored ones."""
        chosen = list(records or [r for r in self.case.records.values() if r.use != "score"])
        names = list(self.system.free)
        low, high = (np.array([self.system.free[n][k] for n in names]) for k in (0, 1))
        middle, half = (low + high) / 2, (high - low) / 2
        numbers = np.array(law.numbers if law is not None else ())
        scale = np.where(numbers != 0, np.abs(numbers), 1.0)

        def of(q: Array) -> tuple[dict[str, float], AtPlace | None]:
            parameters = dict(zip(names, (middle + half * q[:len(names)]).tolist(), strict=True))
            return parameters, None if law is None else AtPlace(law.place, law.law, tuple(scale * q[len(names):]))

        def residual(q: Array) -> Array:
            parameters, acting = of(q)
            parts = [2 * q[:len(names)]]  # the tolerance is two standard deviations
            for record in chosen:
                found = self.channels(record, parameters, acting)
                for name, measured in record.outputs.items():
                    parts.append(np.full(len(measured), FAILED) if found is None else
                                 (found[name] - measured) / self.noise[name])
            return np.concatenate(parts)

        first = [((start or {}).get(n, m) - m) / h for n, m, h in zip(names, middle, half, strict=True)]
        begin = np.concatenate([np.clip(first, -0.999, 0.999), numbers / scale])
        bounds = np.concatenate([np.ones(len(names)), np.full(len(numbers), np.inf)])
        best: tuple[float, Array] = (np.inf, begin)

        def kept(q: Array) -> Array:
            nonlocal best
            r = residual(q)
            if float(r @ r) < best[0]:
                best = float(r @ r), q.copy()
            return r

        def jacobian(q: Array) -> Array:
            r = residual(q)
            return np.array([(residual(q + step) - r) / step.max() for step in np.eye(len(q)) * STEP]).T

        try:
            if len(begin):
                least_squares(kept, begin, jacobian, bounds=(-bounds, bounds), max_nfev=runs, x_scale="jac",
                              ftol=1e-4, xtol=1e-4)
            else:
                kept(begin)
        except TimeoutError:
            pass
        rows = sum(len(m) for record in chosen for m in record.outputs.values())
        parameters, acting = of(best[1])
        return Fitted(parameters, acting, best[0], rows, len(begin))


@dataclass(frozen=True)
class Fitted:
    """Fitted parameters and law, the sum of squares, the number of samples and of unknowns."""

    parameters: Mapping[str, float]
    law: AtPlace | None
    squares: float
    samples: int
    unknowns: int

    @property
    def chi2(self) -> float:
        """Chi-square per sample."""
        return self.squares / self.samples

    @property
    def bic(self) -> float:
        """Bayesian information criterion."""
        return self.squares + self.unknowns * float(np.log(self.samples))
