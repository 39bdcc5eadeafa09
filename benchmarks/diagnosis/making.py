"""Records with something hidden in them: another machine than the one that is diagnosed, tight tolerances, and noise."""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.diagnosis.rigs import TRAIN, VALIDATE, Rig
from benchmarks.diagnosis.truths import Draw, Truth
from heavebond.core.errors import HeavebondError, SimulationError
from heavebond.diagnosis.candidates.catalogue import Candidate, single_candidates
from heavebond.diagnosis.search.base_model import Base
from heavebond.estimation.experiment import Experiment, changed_experiment
from heavebond.estimation.residuals import Run
from heavebond.language.edits import Change
from heavebond.numerics.dae import Array
from heavebond.numerics.simulator import Tolerances

TIGHT, QUICK = Tolerances(1e-10, 1e-12), Tolerances(1e-7, 1e-9)
FINE = 4  # the hidden machine is driven by so many times more samples than are measured
USES = {"train": TRAIN, "validate": VALIDATE}
NEAR = 1.25  # factor of the misfit that was asked for within which it is taken
SHARE = 0.9  # of the data sheet's tolerance, from which parameters are drawn


@dataclass(frozen=True)
class Case:
    """An experiment with something hidden: what, its amplitudes, and the misfit in units of the noise that the fitted base
    model should leave of it (chi-square per sample above 1)."""

    experiment: Experiment
    truths: tuple[Truth, ...]
    accepted: tuple[frozenset[tuple[str, frozenset[str]]], ...]
    amplitudes: tuple[float, ...]
    drawn: tuple[Draw, ...]
    values: Mapping[str, float]
    misfit: float


def generator(*names: object) -> np.random.Generator:
    """The same for the same names, on every machine."""
    return np.random.default_rng(zlib.crc32("/".join(map(str, names)).encode()))


def drawn_parameters(base: Experiment, rng: np.random.Generator, share: float = SHARE) -> dict[str, float]:
    """Values (SI) within the tolerance of the data sheet."""
    found = {}
    for free in base.free.values():
        nominal = free.range.nominal if free.range.nominal is not None else (free.range.low + free.range.high) / 2
        found[free.name] = float(nominal + share * rng.uniform(-1, 1) * (free.range.high - free.range.low) / 2)
    return found


def at_records(base: Experiment, folder: Path, kind: str) -> Experiment:
    """The base experiment on the records of a folder."""
    old = {"train": "fit", "validate": "validate"}
    first = next(iter(base.records.values()))
    return replace(base, records={n: replace(first, name=n, use=use, file=folder / f"{kind}_{n}.csv")
                                  for n, use in old.items()})


def write(path: Path, base: Experiment, rig: Rig, t: Array, u: Array, y: Array | None = None) -> None:
    """A record as it comes from a machine; without outputs (channels, N) they are zero."""
    columns = {base.time.column: t, base.inputs[rig.input].column: u}
    for k, output in enumerate(base.outputs.values()):
        columns[output.column] = y[k] if y is not None else np.zeros(len(t))
    pd.DataFrame(columns).to_csv(path, index=False, float_format="%.10g")


class Hidden:
    """A machine with effects hidden in it, driven as the rig is."""

    def __init__(self, rig: Rig, truths: Sequence[Truth], seed: str, folder: Path, scale: float = 1.0, share: float = SHARE):
        self.rig, self.truths, self.folder = rig, truths, folder
        rng = generator(seed, rig.name, *(t.name for t in truths))
        self.base = rig.base
        self.values = drawn_parameters(self.base, rng, share)
        self.fine = np.arange(FINE * (len(rig.time) - 1) + 1) / (FINE * rig.rate)
        self.inputs = {name: scale * rig.excitation(rng, use)(self.fine) for name, use in USES.items()}
        self.drawn = [{k: float(low * (high / low)**rng.random() if low > 0 else rng.uniform(low, high))
                       for k, (low, high) in t.shapes.items()} for t in truths]
        self.target = float(np.exp(rng.uniform(np.log(3), np.log(300))))
        self.noise = np.array([o.noise or 0.0 for o in self.base.outputs.values()])
        self.rng = rng
        plain = at_records(self.base, folder, "plain")
        for name, u in self.inputs.items():
            write(plain.records[name].file, self.base, rig, rig.time, u[::FINE])
        self.plain = plain
        self.seen: dict[str, dict[str, float]] = {}
        self.found = {c.label: c for c in single_candidates(plain)} if truths else {}

    def candidate(self, truth: Truth) -> Candidate:
        """The entry of the catalogue that a truth is."""
        return self.found[truth.label]

    def clean(self, name: str, amplitudes: Sequence[float], tolerances: Tolerances) -> Array:
        """The channels (channels, N) of one record on the fine instants."""
        u, channels, numbers = self.inputs[name], [], dict(self.values)
        assert name == "train" or self.seen.keys() >= {t.name for t in self.truths if t.filter}
        experiment = replace(self.base, model=self.rig.truth)
        for truth, a, drawn in zip(self.truths, amplitudes, self.drawn, strict=True):
            if truth.filter is not None:
                place = self.candidate(truth)
                if place.attaches == "input":
                    u = self._filtered(truth, u, a, drawn)
                else:
                    channels.append((list(self.base.outputs).index(place.where[0]), truth, a, drawn))
                continue
            change, owner = self._change(truth)
            experiment = changed_experiment(experiment, change)
            numbers |= {f"{owner}.{key}": value for key, value in truth.path(a, drawn).items()}
        driven = at_records(experiment, self.folder, "driven")
        write(driven.records[name].file, self.base, self.rig, self.fine, u)
        run = Run(driven, driven.records[name], [], tolerances)
        known = run.assembly.parameter_values
        y = np.array(run.probe.values(run.simulator.run({k: v for k, v in numbers.items() if k in known})))
        for k, truth, a, drawn in channels:
            y[k] = self._filtered(truth, y[k], a, drawn)
        return y

    def _filtered(self, truth: Truth, y: Array, a: float, drawn: Draw) -> Array:
        """What a sensor or drive makes of a signal; how far and fast that moves is what it was in the training record."""
        assert truth.filter is not None
        rate = float(np.abs(np.diff(y)).max() / (self.fine[1] - self.fine[0]))
        seen = self.seen.setdefault(truth.name, {"low": float(y.min()), "high": float(y.max()), "rate": rate})
        return truth.filter(self.fine, y, a, {**drawn, **seen})

    def _change(self, truth: Truth) -> tuple[Change, str]:
        if truth.change is not None:
            return truth.change, truth.owner
        found = self.candidate(truth)
        owner = found.numbers[0].name.rpartition(".")[0]
        if truth.law:
            parts = {name: replace(part, kind=truth.law, values={}) if name == owner else part
                     for name, part in found.change.components.items()}
            return replace(found.change, components=parts), owner
        return found.change, owner

    def misfit(self, amplitudes: Sequence[float], reference: tuple[Array, Base]) -> float:
        """What the base model cannot explain of the training record within its ranges, in noise variances per sample
        (linearised)."""
        from scipy.optimize import lsq_linear

        y0, base = reference
        y = self.clean("train", amplitudes, QUICK)[:, ::FINE]
        problem = base.problem
        rows = np.vstack([base.J, base.priors])
        wanted = np.concatenate([((y - y0) / self.noise[:, None]).ravel(), -problem.priors(base.inner)[0]])
        steps = lsq_linear(rows, wanted, (problem.low - base.inner, problem.high - base.inner)).x
        return float(np.sum((wanted - rows @ steps)[:y.size]**2) / y.size)

    def reference(self) -> tuple[Array, Base]:
        """The channels (channels, N) of the base machine with the drawn values, and its derivatives there."""
        from heavebond.estimation.residuals import Residuals

        model = self.base.model.with_parameters(self.values)
        problem = Residuals(replace(self.plain, model=model), tolerances=QUICK)
        base = Base.at(problem, problem.start)
        return base.r.reshape(len(self.noise), -1) * self.noise[:, None], base

    def sized(self) -> tuple[list[float], float]:
        """Amplitudes that leave about the misfit that is asked for, and what they leave."""
        reference = self.reference()
        found: list[float] = []
        for k, truth in enumerate(self.truths):
            alone = Hidden.__new__(Hidden)
            alone.__dict__.update({**self.__dict__, "truths": [truth], "drawn": [self.drawn[k]]})
            found.append(alone._amplitude(truth, reference))
        return found, self.misfit(found, reference) if found else 0.0

    def _amplitude(self, truth: Truth, reference: tuple[Array, Base]) -> float:
        a, low, high = truth.first, 0.0, np.inf
        for _ in range(12):
            try:
                left = self.misfit([a], reference)
            except HeavebondError:  # it does not move any more
                left = np.inf
            if self.target / NEAR < left < self.target * NEAR or (a == truth.most and left < self.target):
                return a
            low, high = (max(a, low), high) if left < self.target else (low, min(a, high))
            # the misfit grows with the square of the amplitude, until both ends are known
            step = float(np.clip(np.sqrt(self.target / np.clip(left, 1e-12, 1e12)), 0.1, 10))
            a = min(a * step, truth.most) if low == 0 or high == np.inf else float(np.sqrt(low * high))
        return low if left == np.inf else a

    def case(self, given: Sequence[float] | None = None) -> Case:
        """Amplitudes chosen where they are not given, both records made and disturbed by noise."""
        amplitudes, misfit = self.sized() if given is None else (list(given), float("nan"))
        experiment = at_records(self.base, self.folder, "measured")
        for name, record in experiment.records.items():
            y = self.clean(name, amplitudes, TIGHT)[:, ::FINE]
            y = y + self.noise[:, None] * self.rng.standard_normal(y.shape)
            write(record.file, self.base, self.rig, self.rig.time, self.inputs[name][::FINE], y)
        own = [() if t.outside else ((self.candidate(t).kind, self.candidate(t).where),) for t in self.truths]
        accepted = tuple(frozenset((kind, self.rig.place(where)) for kind, where in (*first, *t.also))
                         for first, t in zip(own, self.truths, strict=True))
        return Case(experiment, tuple(self.truths), accepted, tuple(amplitudes), tuple(self.drawn), self.values, misfit)


def made(rig: Rig, truths: Sequence[Truth], seed: str, folder: Path, scale: float = 1.0) -> Case:
    """A case of the first of three draws with which the machine can move: an excitation may drive a cylinder out of its
    stroke."""
    for draw in (seed, f"{seed}/again"):
        with suppress(SimulationError):
            return Hidden(rig, truths, draw, folder, scale).case()
    return Hidden(rig, truths, f"{seed}/once more", folder, scale).case()
