"""Cases drawn at random of machines that are perfect but for one law, one value or nothing: what is hidden, and records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
import pandas as pd

import heavebond as hb
from benchmarks.diagnosis.machines import NOISE, Machine
from benchmarks.diagnosis.making import QUICK, TIGHT, generator
from heavebond.core.errors import HeavebondError, SimulationError
from heavebond.core.units import parse_range
from heavebond.diagnosis.candidates.catalogue import UNKNOWN, Candidate, quantity, single_candidates
from heavebond.diagnosis.candidates.fixed_values import VALUE, fixed_values
from heavebond.diagnosis.candidates.places import Places
from heavebond.diagnosis.search.base_model import Base, searched
from heavebond.diagnosis.search.scoring import Score, scored
from heavebond.estimation.experiment import Experiment, Free, changed_experiment
from heavebond.estimation.residuals import Run
from heavebond.language.definition import Component
from heavebond.language.library import Library, same_class
from heavebond.numerics.dae import Array
from heavebond.numerics.simulator import Tolerances

# What is hidden, with its share of the draw.
T = TypeVar("T")
SHARES = {"nothing": 0.12, "free": 0.1, "fixed": 0.08, "inside": 0.35, "other law": 0.15, "outside": 0.2}
USES = (("fit",), ("fit", "validate"), ("fit", "validate", "test"))
RECORDS = (0.25, 0.5, 0.25)  # shares of one, two and three records
GIVEN = 0.6  # share of the cases in which the noise is given
MISFIT = (1.0, 200.0)  # noise variances per sample that the effect leaves of the fitted base model, log-uniform
WRONG = (1.1, 1.5)  # factor, or part, by which a fixed value of the data sheet is wrong
TAKEN = 0.9  # of the tolerance from which free parameters are drawn
ATTEMPTS = 12


@dataclass(frozen=True)
class LibraryWithout(Library):
    """A library whose catalogue lacks the components `struck`."""

    struck: frozenset[str] = field(default_factory=frozenset)

    def effects(self) -> list[Component]:
        """The components that have an `effect:`, but those that are struck."""
        return [c for c in super().effects() if c.name not in self.struck]


@dataclass(frozen=True)
class Drawn:
    """A case: the experiment, whose library may lack laws; `hidden` (of SHARES), the effect that is hidden, or the name of
    the value that is wrong, its `values`, `classes` that the catalogue has (none: all), and the misfit in noise variances
    per sample."""

    experiment: Experiment
    hidden: str
    effect: Candidate | None = None
    name: str = ""
    values: Mapping[str, float] = field(default_factory=dict)
    classes: tuple[str, ...] = ()
    misfit: float = 0.0

    def matches(self, other: Candidate, places: Places) -> bool:
        """Whether a candidate is what is hidden: it, its class at its place, or a special case of the class there."""
        return self.effect is not None and alike(self.effect, other, places)


def alike(effect: Candidate, other: Candidate, places: Places) -> bool:
    """Whether a candidate is of the class of an effect at its place, or a special case of the class there."""
    mine, its = places.place(effect), places.place(other)
    if other.kind == effect.kind:
        return mine == its
    # leakage between two chambers is internal leakage of the cylinder, which has more nodes
    return same_class(other.kind, effect.kind) and mine[0] == its[0] and (mine[1] <= its[1] or its[1] <= mine[1])


def drawn(machine: Machine, number: int, folder: Path) -> Drawn:
    """The case of this number; SimulationError where no draw of it can be simulated."""
    hidden = str(generator("hidden", machine.name, number).choice(list(SHARES), p=list(SHARES.values())))
    for attempt in range(ATTEMPTS):
        if hidden == "other law" and 2 * attempt > ATTEMPTS:  # the machine may have no class of several laws
            hidden = "inside"
        with suppress(HeavebondError, _Unfit):
            return _Case(machine, hidden, generator("calibration", machine.name, number, attempt), folder).case()
    raise SimulationError([])


class _Unfit(Exception):
    """A draw that does not do what it should."""


class _Case:
    def __init__(self, machine: Machine, hidden: str, rng: np.random.Generator, folder: Path):
        self.machine, self.hidden, self.rng, self.folder = machine, hidden, rng, folder
        uses = USES[int(rng.choice(3, p=RECORDS))]
        self.records = {f"record_{k}": use for k, use in enumerate(uses)}
        self.inputs = {name: machine.excitation(rng)(machine.time) for name in self.records}
        write_records(machine, folder, self.inputs, dict.fromkeys(self.records))
        self.base = self._experiment(dict.fromkeys(machine.outputs, 1.0))
        self.values = {} if self.hidden in ("nothing", "fixed") and rng.random() < 0.5 else {
            f.name: f.range.nominal * (1 + TAKEN * rng.uniform(-1, 1) * machine.free[f.name] / 100)
            for f in self.base.free.values() if f.range.nominal is not None}
        if self.hidden == "nothing":
            self.values = {}

    def _experiment(self, noise: Mapping[str, float]) -> Experiment:
        return experiment_of(self.machine, self.folder, self.records, noise)

    def _clean(self, experiment: Experiment, values: Mapping[str, float], tolerances: Tolerances) -> dict[str, Array]:
        """The channels (channels, N) of all records of a machine with these values."""
        found = {}
        for name, record in experiment.records.items():
            run = Run(experiment, record, [], tolerances)
            known = run.assembly.parameter_values
            found[name] = np.array(run.probe.values(run.simulator.run({k: v for k, v in values.items() if k in known})))
            if not np.all(np.isfinite(found[name])):
                raise _Unfit
        return found

    def _measured(self, clean: Mapping[str, Array], noise: Array) -> None:
        noisy = {name: y + noise[:, None] * self.rng.standard_normal(y.shape) for name, y in clean.items()}
        write_records(self.machine, self.folder, self.inputs, noisy)

    def case(self) -> Drawn:
        base = self._clean(self.base, self.values, TIGHT)
        spread = np.std(np.hstack(list(base.values())), axis=1)
        if not np.all(spread > 0):
            raise _Unfit
        noise = NOISE * spread
        given = dict(zip(self.machine.outputs, noise.tolist(), strict=True))
        shown = given if self.rng.random() < GIVEN else {}
        if self.hidden in ("nothing", "free"):
            self._measured(base, noise)
            return Drawn(self._experiment(shown), self.hidden, values=self.values)
        self._measured(base, noise)
        problem = searched(replace(self._experiment(given), model=self.base.model.with_parameters(self.values)))
        reference = Base.at(problem, problem.start)
        first = self._fixed if self.hidden == "fixed" else self._effect
        return first(reference, base, noise, shown)

    def _one_of(self, things: Sequence[T]) -> T:
        if not things:  # a machine may have no value that is held fixed
            raise _Unfit
        return things[int(self.rng.integers(len(things)))]

    def _fixed(self, reference: Base, base: Mapping[str, Array], noise: Array, shown: Mapping[str, float]) -> Drawn:
        """A value that the diagram holds fixed is wrong."""
        chosen = self._one_of(fixed_values(self.base))
        (held,) = chosen.numbers
        factor = self.rng.uniform(*WRONG) ** self.rng.choice([-1, 1])
        clean = self._clean(self.base, {**self.values, held.name: held.neutral * factor}, TIGHT)
        misfit = self._left(reference, base, clean, noise)
        if misfit < MISFIT[0]:
            raise _Unfit
        self._measured(clean, noise)
        return Drawn(self._experiment(shown), self.hidden, name=held.name, misfit=misfit,
                     values={**self.values, held.name: held.neutral * factor})

    def _effect(self, reference: Base, base: Mapping[str, Array], noise: Array, shown: Mapping[str, float]) -> Drawn:
        everything = [c for c in single_candidates(self.base) if c.kind != UNKNOWN]
        laws: dict[str, dict[str, list[Candidate]]] = {}
        for c in everything:
            laws.setdefault(c.kind, {}).setdefault(c.component, []).append(c)
        classes = [kind for kind, of in laws.items() if self.hidden != "other law" or len(of) > 1]
        if not classes:
            raise _Unfit
        of = laws[self._one_of(classes)]
        chosen = self._one_of(of[self._one_of(list(of))])
        if self.hidden == "other law" and not any(c.kind == chosen.kind and set(c.where) == set(chosen.where)
                                                  for c in everything if c.component != chosen.component):
            raise _Unfit
        target = float(np.exp(self.rng.uniform(*np.log(MISFIT))))
        clean, values, misfit = self._sized(chosen, reference, base, noise, target)
        self._measured(clean, noise)
        experiment = self._experiment(shown)
        found = Drawn(experiment, self.hidden, chosen, values={**self.values, **values}, misfit=misfit)
        if self.hidden == "other law":
            library = experiment.model.library
            struck = LibraryWithout(**vars(library), struck=frozenset({chosen.component}))
            return replace(found, experiment=replace(experiment, model=replace(experiment.model, library=struck)))
        return replace(found, classes=without(everything, chosen.kind)) if self.hidden == "outside" else found

    def _sized(self, chosen: Candidate, reference: Base, base: Mapping[str, Array], noise: Array, target: float
               ) -> tuple[dict[str, Array], dict[str, float], float]:
        """The channels with an effect of about the misfit that is asked for, its values and the misfit."""
        scores = [s for s in scored(reference, chosen) if s.told_apart]
        if not scores:
            raise _Unfit
        score = self._one_of(scores)
        size = float(np.sqrt(target * len(reference.r))) / (score.size * score.share)
        side = score.side or (int(self.rng.choice([-1, 1])) if score.signed else 1)
        for _ in range(4):
            values = numbers_at(score, side * size)
            changed = score.candidate.change.with_values(
                {n.name: quantity(values[n.name], n.unit) for n in score.candidate.numbers})
            clean = self._clean(changed_experiment(self.base, changed), {**self.values, **values}, TIGHT)
            misfit = self._left(reference, base, clean, noise)
            if 0.4 * target < misfit < 2.5 * target or (not score.along and MISFIT[0] < misfit < MISFIT[1]):
                return clean, values, misfit
            size *= float(np.clip(np.sqrt(target / max(misfit, 1e-9)), 0.1, 10))
            if not score.along:
                break
        raise _Unfit

    def _left(self, reference: Base, base: Mapping[str, Array], clean: Mapping[str, Array], noise: Array) -> float:
        """What free parameters do not take of the difference on the fitted record, in noise variances per sample."""
        s = ((base["record_0"] - clean["record_0"]) / noise[:, None])[reference.problem.runs[0].counts]
        return float(np.mean(reference.split(s)[0] ** 2))


def experiment_of(machine: Machine, folder: Path, uses: Mapping[str, str], noise: Mapping[str, float], of_input: float = 0.0
                  ) -> Experiment:
    """The experiment on the records in a folder, written there as case.yaml, with the free parameters within their
    tolerances."""
    path = folder / "case.yaml"
    path.write_text(machine.experiment(uses, noise, of_input), encoding="utf-8")
    made = hb.load_experiment(path)
    run = Run(made, next(iter(made.records.values())), [], QUICK)
    known, free = run.assembly.parameter_values, {}
    for name, tolerance in machine.free.items():
        unit = next(q.unit.text for q in run.assembly.flat.parameters if q.name == name)
        bounds = parse_range(f"{known[name]:.9g}{'' if unit == '1' else f' {unit}'} +- {tolerance} %")
        free[name] = Free(name, bounds, made.records["record_0"].place)
    return replace(made, free=free)


def write_records(machine: Machine, folder: Path, inputs: Mapping[str, Array], channels: Mapping[str, Array | None]) -> None:
    """Write the input and the channels (channels, N) of each record; channels that are not known yet (None) as zeros."""
    folder.mkdir(exist_ok=True)
    for name, y in channels.items():
        columns = {"time": machine.time, "input": inputs[name]}
        for k in range(len(machine.outputs)):
            columns[f"channel_{k}"] = y[k] if y is not None else np.zeros(machine.samples)
        pd.DataFrame(columns).to_csv(folder / f"{name}.csv", index=False, float_format="%.10g")


def numbers_at(score: Score, step: float) -> dict[str, float]:
    """The numbers of an effect with its amplitudes at a step from neutral."""
    found = {n.name: n.neutral for n in score.candidate.vanishing} | dict(score.shapes)
    for n in score.candidate.numbers:
        if n.name in score.along:
            low = n.low if n.low is not None else -np.inf
            high = n.high if n.high is not None else np.inf
            found[n.name] = float(np.clip(n.neutral + step, low, high))
    return found


def without(everything: Sequence[Candidate], kind: str) -> tuple[str, ...]:
    """All classes but one and those that are special cases of it or of which it is one."""
    return (VALUE, *sorted({c.kind for c in everything if not same_class(c.kind, kind)}))
