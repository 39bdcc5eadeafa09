"""Cases of the calibration study, drawn at random: cluttered machines, and their records.

A machine differs from its diagram by a dominant effect, which makes 50 to 95 % of the misfit, and by two to four minor
differences: laws of the catalogue, laws whose component the diagnosis does not know, values of the data sheet that are
wrong (also by more than their tolerance), parameters that drift, that follow a formula outside the catalogue, or that
differ between records. Besides, inputs are recorded with noise, channels are late and quantised. In some cases the dominant
law is missing from the catalogue, or there is no dominant effect and the clutter is below the noise.

The misfit of a machine is the mean square, in noise variances, of the part of its channels that the diagram cannot imitate
by its free parameters within their ranges (linearised, all records). The share of the dominant effect is the part of the
misfit that vanishes with it. All numbers follow from the name of the machine and the number of the case.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
from scipy.optimize import lsq_linear

from benchmarks.diagnosis.drawing import (
    ATTEMPTS,
    GIVEN,
    TAKEN,
    LibraryWithout,
    T,
    alike,
    experiment_of,
    numbers_at,
    without,
    write_records,
)
from benchmarks.diagnosis.machines import NOISE, Machine
from benchmarks.diagnosis.making import QUICK, TIGHT, generator
from heavebond.core.errors import HeavebondError, SimulationError
from heavebond.diagnosis.candidates.catalogue import UNKNOWN, Candidate, quantity
from heavebond.diagnosis.candidates.fixed_values import fixed_values
from heavebond.diagnosis.candidates.places import Places, between_all_nodes, named_apart
from heavebond.diagnosis.candidates.varying import BY_RECORD, varying_parameters
from heavebond.diagnosis.search.base_model import Base, searched
from heavebond.diagnosis.search.scoring import scored
from heavebond.estimation.experiment import Experiment, changed_experiment
from heavebond.estimation.residuals import Run
from heavebond.language.edits import Change
from heavebond.language.library import same_class
from heavebond.numerics.dae import Array
from heavebond.numerics.simulator import Tolerances

# What dominates, with its share of the draw: nothing (clutter alone), a wrong value that the diagram holds fixed, a law of
# the catalogue, a law whose component is not in the catalogue but others of its class are, a law whose class is not.
SHARES = {"clutter": 0.12, "value": 0.08, "inside": 0.45, "other law": 0.13, "outside": 0.22}
MINOR = {"law": 0.35, "unknown law": 0.15, "sheet": 0.1, "value": 0.1, "drift": 0.1, "cycle": 0.1, "record": 0.1}
NUMBER = (2, 3, 4)  # of minor differences
USES = (("fit",), ("fit", "validate"), ("fit", "fit", "validate"), ("fit", "validate", "test"))
RECORDS = (0.15, 0.4, 0.25, 0.2)  # shares of these
MISFIT = (3.0, 400.0)  # of all cases with a dominant effect, log-uniform
CLUTTER = (0.02, 0.5)  # of those without one, log-uniform
DOMINANT = (0.5, 0.95)  # share of the dominant effect in the misfit
NOISY = (0.3, 1.5)  # noise of a channel in parts of NOISE, log-uniform
SIGNALS = 0.15  # share of the clutter that noise of the input and a delay of a channel make, each at most
INPUT_NOISE, LATE, STEPPED = 0.6, 0.5, 0.6  # shares of the cases with input noise, with a late channel, of stepped channels
STEP = (0.3, 2.0)  # step of a quantised channel in parts of its noise, log-uniform
LATEST = 1.5  # samples
DISTANT = 0.15  # share of the laws that act between nodes which no component joins
SEEN = 0.1  # of the misfit that is asked for, which a difference at its largest size must have
TRIES = 6  # draws of each minor difference
NEAR = 1.6  # factor of a misfit that is asked for within which it is taken


@dataclass(frozen=True)
class Alteration:
    """What a machine is and its diagram is not: a change of the diagram, `values` (SI) of parameters, others in `each`
    record, `late` channels by their numbers (s), and `noise` of the recorded input (in its unit)."""

    change: Change = field(default_factory=Change)
    values: Mapping[str, float] = field(default_factory=dict)
    each: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    late: Mapping[int, float] = field(default_factory=dict)
    noise: float = 0.0

    def joined(self, other: Alteration) -> Alteration:
        """Both; _Unfit if both change the same."""
        for name in ("components", "settings", "initial", "channels", "moved", "vary"):
            if {*getattr(self.change, name)} & {*getattr(other.change, name)}:
                raise _Unfit
        if {*self.values, *self.each} & {*other.values, *other.each}:
            raise _Unfit
        return Alteration(self.change.joined(other.change), {**self.values, **other.values}, {**self.each, **other.each},
                          {**self.late, **other.late}, self.noise + other.noise)


@dataclass(frozen=True)
class Difference:
    """A difference of unknown size between machine and diagram: what it is (of MINOR), its `label`, the alteration at a
    size, the size for a misfit of about 1, and the `largest`; `effect` if it is a law."""

    what: str
    label: str
    at: Callable[[float], Alteration]
    size: float
    largest: float = np.inf
    effect: Candidate | None = None


@dataclass(frozen=True)
class Drawn:
    """A case: the experiment, whose library may lack laws; `hidden` (of SHARES), the dominant effect, or the name of the
    value that is wrong, `classes` that the catalogue has (none: all), the misfit in noise variances per sample, the share
    of the dominant effect in it, and the minor differences: what, label, misfit alone.

    `alteration` is the whole difference, `values` (SI) the true free parameters, `noise` the standard deviation of each
    channel with its quantisation, and `clean` (channels, N) the true channels of each record.
    """

    experiment: Experiment
    hidden: str
    effect: Candidate | None = None
    name: str = ""
    classes: tuple[str, ...] = ()
    misfit: float = 0.0
    share: float = 0.0
    minor: tuple[tuple[str, str, float], ...] = ()
    minor_effects: tuple[Candidate, ...] = ()
    alteration: Alteration = field(default_factory=Alteration)
    values: Mapping[str, float] = field(default_factory=dict)
    noise: Mapping[str, float] = field(default_factory=dict)
    clean: Mapping[str, Array] = field(default_factory=dict)

    def matches(self, other: Candidate, places: Places) -> bool:
        """Whether a candidate is the dominant effect: it, its class at its place, or a special case of the class there."""
        return self.effect is not None and alike(self.effect, other, places)


def drawn(machine: Machine, number: int, folder: Path) -> Drawn:
    """The case of this number; SimulationError where no draw of it can be simulated."""
    hidden = str(generator("dominant", machine.name, number).choice(list(SHARES), p=list(SHARES.values())))
    for attempt in range(ATTEMPTS):
        if hidden == "other law" and 2 * attempt > ATTEMPTS:  # the machine may have no class of several laws
            hidden = "inside"
        with suppress(HeavebondError, _Unfit):
            return _Case(machine, hidden, generator("cluttered", machine.name, number, attempt), folder).case()
    raise SimulationError([])


class _Unfit(Exception):
    """A draw that does not do what it should."""


class _Everything:
    """A container of all labels."""

    def __contains__(self, label: object) -> bool:
        return True


class _Case:
    def __init__(self, machine: Machine, hidden: str, rng: np.random.Generator, folder: Path):
        self.machine, self.hidden, self.rng, self.folder = machine, hidden, rng, folder
        uses = USES[int(rng.choice(len(USES), p=RECORDS))]
        self.records = {f"record_{k}": use for k, use in enumerate(uses)}
        self.inputs = {name: machine.excitation(rng)(machine.time) for name in self.records}
        self.input_noise = {name: rng.standard_normal(machine.samples) for name in self.records}
        write_records(machine, folder / "true", self.inputs, dict.fromkeys(self.records))
        self.true = self._fitted("true", dict.fromkeys(machine.outputs, 1.0))
        self.sheet = {f.name: f.range.nominal for f in self.true.free.values() if f.range.nominal is not None}
        self.values = {name: nominal * (1 + TAKEN * rng.uniform(-1, 1) * machine.free[name] / 100)
                       for name, nominal in self.sheet.items()}
        self.base = self._channels(Alteration(), TIGHT)
        spread = np.std(np.hstack(list(self.base.values())), axis=1)
        if not np.all(spread > 0):
            raise _Unfit
        self.noise = NOISE * spread * np.exp(rng.uniform(np.log(NOISY[0]), np.log(NOISY[1]), len(spread)))
        write_records(machine, folder / "true", self.inputs, self.base)
        given = dict(zip(machine.outputs, self.noise.tolist(), strict=True))
        model = self.true.model.with_parameters(self.values)
        problem = searched(replace(self._fitted("true", given), model=model))
        self.reference = Base.at(problem, problem.start)
        apart = named_apart(self.true, _Everything())
        near = {c.label for c in apart} - {c.label for c in between_all_nodes(self.true)}
        laws = [c for c in apart if c.kind != UNKNOWN and not c.members]
        variations = [c for c in varying_parameters(problem, problem.start).candidates if not c.change.each]
        self.laws = [[c for c in laws if c.label in near] + variations, [c for c in laws if c.label not in near]]

    def _fitted(self, folder: str, noise: Mapping[str, float]) -> Experiment:
        """The experiment in a folder, with all its records fitted."""
        return experiment_of(self.machine, self.folder / folder, dict.fromkeys(self.records, "fit"), noise)

    # -- simulation and misfit ------------------------------------------------------------------------------------------
    def _channels(self, altered: Alteration, tolerances: Tolerances = QUICK, experiment: Experiment | None = None
                  ) -> dict[str, Array]:
        """The channels (channels, N) of all records of a machine, driven by the true inputs."""
        changed = changed_experiment(experiment or self.true, altered.change)
        found, t = {}, self.machine.time
        for name, record in changed.records.items():
            run = Run(changed, record, [], tolerances)
            values = {**self.values, **altered.values, **altered.each.get(name, {})}
            known = run.assembly.parameter_values
            y = np.array(run.probe.values(run.simulator.run({k: v for k, v in values.items() if k in known})))
            for k, late in altered.late.items():
                y[k] = np.interp(t - late, t, y[k])
            if not np.all(np.isfinite(y)):
                raise _Unfit
            found[name] = y
        return found

    def _recorded(self, noise: float) -> dict[str, Array]:
        """The inputs as they are recorded."""
        return {name: u + noise * self.input_noise[name] for name, u in self.inputs.items()}

    def _misfit(self, altered: Alteration) -> float:
        """What the free parameters within their ranges cannot imitate, in noise variances per sample."""
        base = self.base
        if altered.noise:
            write_records(self.machine, self.folder / "recorded", self._recorded(altered.noise), dict.fromkeys(self.records))
            base = self._channels(Alteration(), QUICK, self._fitted("recorded", dict.fromkeys(self.machine.outputs, 1.0)))
        y = self._channels(altered)
        runs, problem = self.reference.problem.runs, self.reference.problem
        s = np.concatenate([((y[run.record.name] - base[run.record.name]) / self.noise[:, None])[run.counts]
                            for run in runs])
        left = s
        if problem.columns:
            inner = self.reference.inner
            limits = (problem.low - inner - 1e-9, problem.high - inner + 1e-9)  # a value may stand at its end
            left = s - self.reference.J @ lsq_linear(self.reference.J, s, limits).x
        return float(np.mean(left**2))

    @staticmethod
    def _tried(times: int, make: Callable[[], T]) -> T:
        """What `make` gives the first time that it can be simulated and fits."""
        for _ in range(times):
            with suppress(HeavebondError, _Unfit):
                return make()
        raise _Unfit

    def _with_size(self, difference: Difference, target: float, exact: bool = False) -> tuple[Difference, float, float]:
        """A difference, a size at which it alone has about this misfit, and the misfit; less at its largest size."""
        size = min(difference.size * float(np.sqrt(target)), difference.largest)
        for _ in range(5):
            misfit = self._misfit(difference.at(size))
            if target / NEAR < misfit < target * NEAR:
                return difference, size, misfit
            if misfit <= target and size >= difference.largest:
                break
            size = min(size * float(np.clip(np.sqrt(target / max(misfit, 1e-9)), 0.1, 10)), difference.largest)
        if exact or not SEEN * target < misfit < target * NEAR:
            raise _Unfit
        return difference, size, misfit

    # -- the differences ------------------------------------------------------------------------------------------
    def _one_of(self, things: Sequence[T]) -> T:
        if not things:  # a machine may have no value that is held fixed
            raise _Unfit
        return things[int(self.rng.integers(len(things)))]

    def _law(self, besides: Sequence[Candidate] = (), siblings: bool = False) -> Candidate:
        """A law of a class of which no other one is; `siblings`: other laws of its class fit at its place."""
        pool = self.laws[int(self.rng.random() < DISTANT)] or self.laws[0]
        pool = [c for c in pool if not any(same_class(c.kind, other.kind) for other in besides)]
        if siblings:
            pool = [c for c in pool if any(o.kind == c.kind and {*o.where} == {*c.where} and o.component != c.component
                                           for o in pool)]
        kind = self._one_of(sorted({c.kind for c in pool}))
        component = self._one_of(sorted({c.component for c in pool if c.kind == kind}))
        return self._one_of([c for c in pool if c.kind == kind and c.component == component])

    def _dominant(self) -> Difference:
        """The dominant difference."""
        return self._difference("value") if self.hidden == "value" else \
            self._of_law(self.hidden, self._law(siblings=self.hidden == "other law"))

    def _difference(self, what: str, besides: Sequence[Candidate] = ()) -> Difference:
        if what in ("law", "unknown law"):
            return self._of_law(what, self._law(besides))
        if what == "value":
            held = self._one_of(fixed_values(self.true)).numbers[0]
            side = self.rng.choice([-1, 1])
            return Difference(what, held.name, lambda a: Alteration(values={
                held.name: held.neutral * (1 + a) ** side}), 0.05, 1.0)
        if what == "sheet":  # beyond the tolerance
            name = self._one_of(sorted(self.sheet))
            side, tolerance = self.rng.choice([-1, 1]), self.machine.free[name] / 100
            return Difference(what, name, lambda a: Alteration(values={
                name: self.sheet[name] * (1 + tolerance * (1 + a)) ** side}), 0.5, 3.0)
        run = self.reference.problem.runs[0]
        known = {q.name: run.assembly.parameter_values.get(q.name, 0.0) for q in run.assembly.flat.parameters}
        fixed = {c.numbers[0].name for c in fixed_values(self.true)}
        name = self._one_of(sorted(n for n in {*self.sheet, *fixed} if n in known))
        if what == "record":
            if len(self.records) < 2:
                raise _Unfit
            parts = self.rng.uniform(-1, 1, len(self.records))
            value = self.values.get(name, known[name])
            shares = dict(zip(self.records, parts.tolist(), strict=True))
            return Difference(what, name, lambda a: Alteration(each={
                record: {name: value * (1 + a) ** part} for record, part in shares.items()}), 0.1, 1.0)
        length, side = self.machine.samples / self.machine.rate, self.rng.choice([-1, 1])
        period, phase = length / self.rng.uniform(1.5, 8.0), self.rng.uniform(0, 2 * np.pi)
        course = f"time/{length:.6g} s" if what == "drift" else f"sin(2*pi*time/{period:.6g} s + {phase:.4f})"
        return Difference(what, name, lambda a: Alteration(Change(vary={name: (f"(1 + ({side * a:.9g})*{course})",)})),
                          0.1, 0.8)

    def _of_law(self, what: str, law: Candidate) -> Difference:
        scores = [s for s in scored(self.reference, law) if s.told_apart and s.along]
        score = self._one_of(scores)
        first = float(np.sqrt(len(self.reference.r))) / (score.size * score.share)  # a misfit of 1, along the tangent
        side = score.side or (int(self.rng.choice([-1, 1])) if score.signed else 1)

        def at(a: float) -> Alteration:
            values = numbers_at(score, side * a * first)
            written = {n.name: quantity(values[n.name], n.unit) for n in score.candidate.numbers if n.name in values}
            return Alteration(score.candidate.change.with_values(written), values)

        return Difference(what, law.label, at, 1.0, effect=law)

    def _signals(self, clutter: float) -> list[tuple[Difference, float]]:
        """Noise of the input and a late channel, with their shares of the clutter."""
        found = []
        rng, machine = self.rng, self.machine
        if rng.random() < INPUT_NOISE:
            span = 0.002 * (machine.high - machine.low)
            found.append(Difference("input noise", machine.input, lambda a: Alteration(noise=a), span, 10 * span))
        if rng.random() < LATE:
            k, most = int(rng.integers(len(machine.outputs))), LATEST / machine.rate
            found.append(Difference("late", f"channel_{k}", lambda a: Alteration(late={k: a}), most / 3, most))
        return [(difference, clutter * SIGNALS * rng.uniform(0.2, 1.0)) for difference in found]

    # -- the case ------------------------------------------------------------------------------------------
    def case(self) -> Drawn:
        rng = self.rng
        target = float(np.exp(rng.uniform(*np.log(CLUTTER if self.hidden == "clutter" else MISFIT))))
        share = 0.0 if self.hidden == "clutter" else float(rng.uniform(*DOMINANT))
        dominant, whole = None, Alteration()
        if self.hidden != "clutter":
            dominant, size, _ = self._tried(TRIES, lambda: self._with_size(self._dominant(), share * target, exact=True))
            whole = dominant.at(size)
        clutter = (1 - share) * target
        effects = [d.effect for d in [dominant] if d is not None and d.effect is not None]
        rest = Alteration()
        sizes: list[tuple[Difference, float]] = []
        listed: list[tuple[str, str, float]] = []

        def add(signal: Difference | None, part: float) -> None:
            nonlocal rest
            difference, size, misfit = self._with_size(signal or self._difference(
                str(rng.choice(list(MINOR), p=list(MINOR.values()))), effects), part)
            whole.joined(difference.at(size))  # _Unfit if both change the same
            rest = rest.joined(difference.at(size))
            sizes.append((difference, size))
            listed.append((difference.what, difference.label, round(misfit, 4)))
            effects.extend([difference.effect] if difference.effect is not None else [])

        for part in rng.dirichlet(np.full(int(rng.choice(NUMBER)), 2.0)):
            self._tried(TRIES, partial(add, None, float(part) * clutter))
        for signal, part in self._signals(clutter):
            with suppress(HeavebondError, _Unfit):
                add(signal, part)
        struck = {d.effect.component for d, _ in sizes if d.what == "unknown law" and d.effect is not None}
        whole, misfit, reached = self._shared(whole, sizes, share if dominant is not None else None)
        return self._finished(dominant, whole, misfit, reached, tuple(listed), effects, struck)

    def _shared(self, dominant: Alteration, minor: Sequence[tuple[Difference, float]], share: float | None
                ) -> tuple[Alteration, float, float]:
        """The machine with all differences, the minor ones larger or smaller such that the dominant effect has about this
        share of the misfit; the misfit, and the share."""
        factor = 1.0
        for _ in range(4):
            rest = Alteration()
            for difference, size in minor:
                rest = rest.joined(difference.at(min(factor * size, difference.largest)))
            whole = rest.joined(dominant)
            misfit = self._misfit(whole)
            if share is None:
                return whole, misfit, 0.0
            clutter = self._misfit(rest)
            reached = 1 - clutter / misfit
            if DOMINANT[0] <= reached <= DOMINANT[1] and abs(reached - share) < 0.1 \
                    and MISFIT[0] / 2 < misfit < 2 * MISFIT[1]:
                return whole, misfit, reached
            factor *= float(np.clip(np.sqrt((1 - share) * misfit / max(clutter, 1e-9)), 0.3, 3))
        raise _Unfit

    def _finished(self, dominant: Difference | None, whole: Alteration, misfit: float, share: float,
                  listed: tuple[tuple[str, str, float], ...], effects: Sequence[Candidate], struck: set[str]) -> Drawn:
        """The records with noise in steps, and the experiment with the library that the diagnosis knows."""
        rng = self.rng
        step = self.noise * np.exp(rng.uniform(np.log(STEP[0]), np.log(STEP[1]), len(self.noise)))
        step *= rng.random(len(step)) < STEPPED
        measured, clean = {}, self._channels(whole, TIGHT)
        for name, y in clean.items():
            noisy = y + self.noise[:, None] * rng.standard_normal(y.shape)
            wide = np.where(step > 0, step, 1.0)[:, None]
            measured[name] = np.where(step[:, None] > 0, np.round(noisy / wide) * wide, noisy)
        write_records(self.machine, self.folder / "case", self._recorded(whole.noise), measured)
        given = rng.random() < GIVEN
        rms = np.hypot(self.noise, step / 12**0.5)
        shown = dict(zip(self.machine.outputs, rms.tolist(), strict=True)) if given else {}
        of_input = whole.noise if given and rng.random() < 0.5 else 0.0
        experiment = experiment_of(self.machine, self.folder / "case", self.records, shown, of_input)
        effect = dominant.effect if dominant is not None else None
        if self.hidden == "other law" and effect is not None:
            struck |= {effect.component}
        if struck:
            library = LibraryWithout(**vars(experiment.model.library), struck=frozenset(struck))
            experiment = replace(experiment, model=replace(experiment.model, library=library))
        everything = [c for laws in self.laws for c in laws]
        classes = (*without(everything, effect.kind), BY_RECORD) if self.hidden == "outside" and effect is not None else ()
        return Drawn(experiment, self.hidden, effect, dominant.label if dominant is not None else "", classes, misfit, share,
                     listed, tuple(e for e in effects if e is not effect), whole, self.values,
                     dict(zip(self.machine.outputs, rms.tolist(), strict=True)), clean)
