"""Diagrams that rival each other, ready to be run with any input, and how well one can imitate another."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass

import numpy as np

from heavebond.core.errors import ModelError, SimulationError, StartError
from heavebond.equations.flatten import KnownInput
from heavebond.estimation.comparison import assemble_for
from heavebond.estimation.experiment import Experiment, Record
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.inputs import Pieced, read_input
from heavebond.numerics.quick_simulation import QuickSimulator
from heavebond.numerics.result import Probe
from heavebond.numerics.simulator import Tolerances
from heavebond.records.piecewise import align, evaluate, pieces

STEPS = 6  # of a fit of one rival to another
# finer than a search: what is wanted are small differences of runs
FINE = Tolerances(1e-6, 1e-8)


@dataclass(frozen=True)
class Alternative:
    """A diagram that the records allow: what it is called, its experiment, the fitted values (SI), and how many samples
    the records have."""

    label: str
    experiment: Experiment
    values: Mapping[str, float]
    samples: int


@dataclass(frozen=True)
class AlternativeRun:
    """A run of one alternative with the values p (m,) of what is free: what was looked at (n_y, N) in SI, and its
    derivatives (m, n_y, N)."""

    p: Array
    values: Array
    moved: Array


class PreparedAlternative:
    """An alternative ready to be run with many inputs."""

    def __init__(self, alternative: Alternative, record: Record, time: Array, known: Mapping[str, Array]):
        experiment = alternative.experiment
        own = assemble_for(experiment, record)
        names = set(own.parameter_values)
        self.label = alternative.label
        self.time = time
        self.assembly: Assembly = own.with_parameters({n: v for n, v in alternative.values.items() if n in names})
        self.simulator = QuickSimulator(self.assembly, times=time, tolerances=FINE, sensitivities=list(experiment.free),
                                        driven=self.pieced(known))
        ranges = [f.range for f in experiment.free.values()]
        self.names = list(experiment.free)
        self.fitted = np.array([self.assembly.parameter_values[name] for name in self.names])
        self.low, self.high = (np.array([getattr(r, end) for r in ranges]) for end in ("low", "high"))
        self.precision = np.sqrt([_precision(r.nominal, r.high) for r in ranges])
        self.probe = Probe(self.assembly, [o.shown.text for o in experiment.outputs.values()], si=True)

    def pieced(self, known: Mapping[str, Array]) -> Pieced:
        """Inputs by column, (N,) in SI at the times of the run, as pieces between those."""
        inputs = self.assembly.flat.inputs
        found = [pieces(self.time, known[k.source.column] if k.source.column in known else self._elsewhere(k),
                        k.source.interpolation) for k in inputs]
        breaks, coefficients = align(found, float(self.time[0]), float(self.time[-1]), names=[k.name for k in inputs])
        return Pieced(breaks, np.vstack([breaks[:-1], coefficients.reshape(len(breaks) - 1, -1).T]))

    def _elsewhere(self, known: KnownInput) -> Array:
        """An input that the diagram takes from a file of its own."""
        signal = read_input(known, float(self.time[0]), float(self.time[-1]))
        return evaluate(signal, self.time)

    def run(self, known: Mapping[str, Array], probe: Probe | None = None, p: Array | None = None) -> AlternativeRun:
        """One run; SimulationError or StartError where it breaks down."""
        simulator = copy(self.simulator)
        simulator.pieces = self.pieced(known)
        if simulator.looks_up or simulator.compiled:  # the input stands in what integrates
            simulator.prepare()
        p = self.fitted if p is None else p
        result, probe = simulator.run(dict(zip(self.names, p.tolist(), strict=True))), probe or self.probe
        moved = probe.sensitivities(result) if self.names else np.zeros((0, len(probe.names), len(self.time)))
        return AlternativeRun(p, probe.values(result), moved)

    def left(self, own: AlternativeRun, other: AlternativeRun, weight: Array) -> tuple[Array, Array]:
        """What is between its own run and another's (n_y, N) that its parameters do not make up for, as far as the tangent
        holds, and the step of theirs (m,); `weight` (n_y,) is sqrt(samples that each one stands for) / noise."""
        from scipy.optimize import lsq_linear

        d = ((other.values - own.values) * weight[:, None]).ravel()
        if not self.names:
            return d.reshape(own.values.shape), np.zeros(0)
        J = (own.moved * weight[None, :, None]).reshape(len(own.moved), -1).T
        rows = np.vstack([J, np.diag(self.precision)])
        scale = np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
        q, r = np.linalg.qr(rows / scale)
        target = q.T @ np.concatenate([d, self.precision * (self.fitted - own.p)])
        room = (np.minimum(self.low - own.p, 0.0) * scale - 1e-9, np.maximum(self.high - own.p, 0.0) * scale + 1e-9)
        step = np.clip(own.p + lsq_linear(r, target, room, method="bvls").x / scale, self.low, self.high) - own.p
        return (d - J @ step).reshape(own.values.shape), step

    def imitating(self, own: AlternativeRun, other: AlternativeRun, known: Mapping[str, Array], weight: Array) -> Array:
        """The same with its parameters fitted: Gauss and Newton's steps, halved until they help."""
        def distance(seen: AlternativeRun) -> float:
            off = (other.values - seen.values) * weight[:, None]
            return float(np.sum(off**2) + np.sum((self.precision * (seen.p - self.fitted)) ** 2))

        for _ in range(STEPS if self.names else 0):
            step, before, better = self.left(own, other, weight)[1], distance(own), own
            for share in (1.0, 0.5, 0.1):
                try:
                    seen = self.run(known, p=own.p + share * step)
                except (ModelError, SimulationError, StartError):
                    continue
                if distance(seen) < before:
                    better = seen
                    break
            own = better
            if distance(own) > 0.99 * before:
                break
        return np.asarray((other.values - own.values) * weight[:, None])


def _precision(nominal: float | None, high: float) -> float:
    """1/sigma**2 of a data sheet's tolerance, 0 without one."""
    return 0.0 if nominal is None else (2 / (high - nominal)) ** 2
