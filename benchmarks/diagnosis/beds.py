"""Test beds: simulated machines with declared hidden effects and disturbances, and the answer of the diagnosis.

A bed is a base diagram, the effects that it lacks, and minor disturbances that are not declared (clutter). An effect is a
variant of the diagram, so the truth is a chain of variants, and each effect can be left out of it. The records are simulated
from the truth with fixed seeds. `several` and `beyond` hold the beds; each runs as

    python -m benchmarks.diagnosis.several                     beds that have no result yet
    python -m benchmarks.diagnosis.several oven lift           these beds
    python -m benchmarks.diagnosis.several --seconds 200       with this time limit for each diagnosis
    python -m benchmarks.diagnosis.several oven --write DIR    write diagram, records and experiment; no diagnosis
"""

from __future__ import annotations

import argparse
import tempfile
import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import heavebond as hb
from benchmarks.diagnosis import keeping
from benchmarks.diagnosis.making import FINE, generator
from benchmarks.diagnosis.measured import count_processor_time
from benchmarks.diagnosis.rigs import Signal, steps
from heavebond.estimation.residuals import Run
from heavebond.numerics.dae import Array
from heavebond.numerics.simulator import Tolerances

ACCURATE = Tolerances(1e-8, 1e-10)
SECONDS = 200.0
STEP = 0.1  # of half a tolerance, for the derivatives with respect to a free parameter
PRIOR = 2.0  # standard deviations of a free parameter in half its tolerance
Excitation = Callable[[np.random.Generator], Signal]


# -- excitation ------------------------------------------------------------------------------------------------------------
def waves(low: float, high: float, fast: float, slow: float, start: float | None = None) -> Excitation:
    """Eight sines with periods from `fast` to `slow` (s) between two values, gradually from `start` (or the middle)."""
    middle, half = (low + high) / 2, (high - low) / 2

    def drawn(rng: np.random.Generator) -> Signal:
        rates, phases = 2 * np.pi / np.geomspace(fast, slow, 8), rng.uniform(0, 2 * np.pi, 8)
        sizes = rng.uniform(0.4, 1, 8)

        def signal(t: Array) -> Array:
            shape = np.tanh(1.5 * np.sin(np.multiply.outer(t, rates) + phases) @ sizes / np.linalg.norm(sizes))
            fade = np.exp(-((2 * t / slow) ** 3))
            return np.asarray((middle + half * shape) * (1 - fade) + (middle if start is None else start) * fade)

        return signal

    return drawn


def stairs(low: float, high: float, hold: tuple[float, float], rise: float, start: float | None = None) -> Excitation:
    """Random levels between two values, each held for a time (s) between the limits of `hold`, with smooth transitions."""
    def levels(rng: np.random.Generator, n: int) -> Array:
        values = rng.uniform(low, high, n)
        values[0] = values[0] if start is None else start
        return values

    return lambda rng: steps(rng, lambda n: levels(rng, n), hold, rise)


# -- beds ------------------------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Input:
    """A measured input: unit, excitation, standard deviation of its noise and step of its quantisation, in its unit, whether
    the experiment states their sum, and its interpolation."""

    unit: str
    signal: Excitation
    noise: float = 0.0
    step: float = 0.0
    stated: bool = False
    interpolation: str = "spline"


@dataclass(frozen=True)
class Channel:
    """A measured channel: formula in the base diagram, unit, noise, quantisation (in its unit) and delay (s)."""

    formula: str
    unit: str
    noise: float
    step: float = 0.0
    late: float = 0.0


def rms(measured: Input | Channel) -> float:
    """Standard deviation of noise and quantisation together."""
    return float(np.hypot(measured.noise, measured.step / 12**0.5))


@dataclass(frozen=True)
class Effect:
    """A change that the base diagram lacks.

    `law` is the true sentence. `answers` are the classes and places that name it: `leakage: a b | internal leakage: part`.
    `text` holds the keys of a variant; a mapping gives one text for each record with the effect. `read` changes the formulas
    of channels; `{}` in it is the formula without the effect.
    """

    law: str
    answers: str
    text: str | Mapping[str, str] = ""
    read: Mapping[str, str] = field(default_factory=dict)

    def variant(self, record: str) -> str | None:
        """The keys of the variant in a record; None if the record has no such effect."""
        return self.text if isinstance(self.text, str) else self.text.get(record)

    def is_named_by(self, candidate: Mapping[str, Any]) -> bool:
        """True if class and place of a candidate are among the answers."""
        return any(candidate["class"] == kind and set(candidate["where"]) == place for kind, place in self.accepted)

    @property
    def accepted(self) -> list[tuple[str, set[str]]]:
        """Classes and places."""
        pairs = [answer.partition(":") for answer in self.answers.split("|")]
        return [(kind.strip(), set(place.split())) for kind, _, place in pairs]


@dataclass(frozen=True)
class Bed:
    """A machine on a test stand.

    `misfit` is the chi-square per sample above the noise that the fitted base model leaves (linearised, all records). The
    `shares` of the effects in it, and of the clutter, are the mean squares of what each changes in the channels, where the
    free parameters cannot imitate it. They need not add up to 1: changes may cancel or support each other. `parts` are
    components of the machine's own.
    """

    name: str
    story: str
    model: str
    inputs: Mapping[str, Input]
    channels: Mapping[str, Channel]
    free: str
    effects: tuple[Effect, ...]
    seconds: float
    rate: float
    misfit: float
    shares: tuple[float, ...]
    clutter: tuple[Effect, ...] = ()
    records: Mapping[str, str] = field(default_factory=lambda: {"train": "fit", "validate": "validate"})
    parts: tuple[str, ...] = ()

    @property
    def time(self) -> Array:
        """Instants of the samples."""
        return np.arange(round(self.seconds * self.rate) + 1) / self.rate

    @property
    def fine(self) -> Array:
        """Instants at which the true machine is driven."""
        return np.arange(FINE * (len(self.time) - 1) + 1) / (FINE * self.rate)

    def driven(self, record: str) -> dict[str, Array]:
        """The true inputs at the fine instants."""
        return {name: shown.signal(generator("bed", self.name, record, name))(self.fine)
                for name, shown in self.inputs.items()}

    def experiment(self, model: str, records: Mapping[str, str], effects: Sequence[Effect] = ()) -> str:
        """The text of an experiment on files RECORD.csv, with the channels as the effects change them."""
        lines = [f"experiment: {self.name}", f"model: {model}", "records:"]
        lines += [f"  {name}: {{file: {name}.csv, use: {use}}}" for name, use in records.items()]
        lines += ["time: {column: time, unit: s}", "inputs:"]
        for name, given in self.inputs.items():
            noise = f", noise: {rms(given):.4g} {given.unit}" if given.stated else ""
            lines.append(f"  {name}: {{column: {name}, unit: {given.unit}, "
                         f"interpolation: {given.interpolation}{noise}}}")
        lines.append("outputs:")
        for name, channel in self.channels.items():
            formula = channel.formula
            for effect in effects:
                formula = effect.read.get(name, "{}").replace("{}", formula)
            lines.append(f'  {name}: {{is: "{formula}", column: {name}, unit: {channel.unit}, '
                         f"noise: {rms(channel):.4g} {channel.unit}}}")
        return "\n".join([*lines, "free:", *(f"  {line.strip()}" for line in self.free.strip().splitlines())]) + "\n"


class Machine:
    """A bed with some of its effects, on one record; called with values (SI) of parameters, it gives the true channels
    (channels, N) in their units."""

    def __init__(self, bed: Bed, record: str, effects: Sequence[Effect], folder: Path):
        self.bed = bed
        acting = [(e, text) for e in effects if (text := e.variant(record)) is not None]
        file = write_diagram(bed, folder, "\n".join(text for _, text in acting))
        previous = file
        for k, (_, text) in enumerate(acting):
            file = folder / f"variant_{k}.yaml"
            file.write_text(f"model: variant_{k}\nextends: {previous.name}\n{text}\n", encoding="utf-8")
            previous = file
        columns = {"time": bed.fine, **bed.driven(record), **{name: np.zeros(len(bed.fine)) for name in bed.channels}}
        pd.DataFrame(columns).to_csv(folder / f"{record}.csv", index=False, float_format="%.12g")
        text = bed.experiment(file.name, {record: "fit"}, [e for e, _ in acting])
        (folder / "driven.yaml").write_text(text, encoding="utf-8")
        experiment = hb.load_experiment(folder / "driven.yaml")
        self.free = experiment.free
        self.run = Run(experiment, experiment.records[record], [], ACCURATE)

    def __call__(self, values: Mapping[str, float] | None = None) -> Array:
        y = np.array(self.run.probe.values(self.run.simulator.run(dict(values or {})))) / self.run.scale[:, None]
        t, channels = self.bed.fine, self.bed.channels.values()
        return np.array([np.interp(t - channel.late, t, row) for channel, row in zip(channels, y, strict=True)])[:, ::FINE]


def write_diagram(bed: Bed, folder: Path, variants: str = "") -> Path:
    """The base diagram, with those components of the bed that it or the variants use."""
    for part in bed.parts:
        kind = part.split("component:")[1].split()[0]
        if f"is: {kind}" in bed.model + variants or any(f"is: {kind}" in other for other in bed.parts):
            (folder / f"{kind}.yaml").write_text(part.strip() + "\n", encoding="utf-8")
    file = folder / f"{bed.name}.yaml"
    file.write_text(f"model: {bed.name}\n{bed.model.strip()}\n", encoding="utf-8")
    return file


def write(bed: Bed, folder: Path) -> Path:
    """Base diagram, records of the true machine with noise, and experiment; the path of the experiment."""
    folder.mkdir(parents=True, exist_ok=True)
    for record in bed.records:
        with tempfile.TemporaryDirectory() as hidden:
            y = Machine(bed, record, (*bed.effects, *bed.clutter), Path(hidden))()
        rng = generator("noise", bed.name, record)
        columns = {"time": bed.time}
        signals: list[tuple[str, Input | Channel, Array]] = []
        signals += [(name, bed.inputs[name], u[::FINE]) for name, u in bed.driven(record).items()]
        signals += zip(bed.channels, bed.channels.values(), y, strict=True)
        for name, shown, signal in signals:
            noisy = signal + shown.noise * rng.standard_normal(len(signal))
            columns[name] = np.round(noisy / shown.step) * shown.step if shown.step else noisy
        pd.DataFrame(columns).to_csv(folder / f"{record}.csv", index=False, float_format="%.8g")
    diagram = write_diagram(bed, folder)
    file = folder / f"{bed.name}_records.yaml"
    file.write_text(bed.experiment(diagram.name, bed.records), encoding="utf-8")
    return file


def misfits(bed: Bed) -> tuple[float, tuple[float, ...]]:
    """`misfit` and `shares` of a bed, computed with the free parameters fitted along their tangents."""
    hidden = (*bed.effects, *bed.clutter)
    without = [tuple(other for other in hidden if other is not e) for e in bed.effects] + [bed.effects] * bool(bed.clutter)
    changes: list[list[Array]] = [[] for _ in range(1 + len(without))]
    derivatives: list[list[Array]] = []
    noise = np.array([rms(channel) for channel in bed.channels.values()])[:, None]
    for record in bed.records:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            base = Machine(bed, record, (), folder)
            y_base, moved = base(), []
            for free in base.free.values():
                step = STEP * (free.range.high - free.range.low) / 2
                middle = (free.range.high + free.range.low) / 2
                moved.append(((base({free.name: middle + step}) - y_base) / noise / STEP).ravel())
            derivatives.append(moved)
            y_true = Machine(bed, record, hidden, folder)()
            others = [y_base, *(Machine(bed, record, effects, folder)() for effects in without)]
            for change, y in zip(changes, others, strict=True):
                change.append(((y_true - y) / noise).ravel())
    free_count = len(derivatives[0])
    J = np.array([np.concatenate([moved[k] for moved in derivatives]) for k in range(free_count)]).T.reshape(-1, free_count)
    normal = J.T @ J + PRIOR**2 * np.eye(free_count)
    left = []
    for change in changes:
        r = np.concatenate(change)
        left.append(float(np.mean((r - J @ np.linalg.solve(normal, J.T @ r))**2)))
    return left[0], tuple(value / left[0] for value in left[1:])


# -- the answer ------------------------------------------------------------------------------------------------------------
def level(effect: Effect, answer: Mapping[str, Any]) -> str:
    """How an answer names an effect: `first`, `plausible` (among those that the records cannot distinguish), `place` or
    `class` only, or `not named`."""
    steps = answer["steps"]
    if any(effect.is_named_by(step) for step in steps):
        return "first"
    if any(effect.is_named_by(other) for step in steps for other in step["one_of"]):
        return "plausible"
    if any(set(step["where"]) == place for step in steps for _, place in effect.accepted):
        return "place"
    return "class" if any(step["class"] == kind for step in steps for kind, _ in effect.accepted) else "not named"


def judged(bed: Bed, answer: Mapping[str, Any]) -> dict[str, object]:
    """Compare an answer with the truth. `extra` lists first names without a declared effect. `right` is true if all
    effects are first or plausible, and there is no extra name."""
    levels = {e.law: level(e, answer) for e in bed.effects}
    extra = [step["candidate"] for step in answer["steps"]
             if not any(e.is_named_by(other) for e in bed.effects for other in (step, *step["one_of"]))]
    return {"levels": levels, "extra": extra, "right": not extra and set(levels.values()) <= {"first", "plausible"},
            "verdict": answer["verdict"], "words": answer["words"], "partial": answer["partial"],
            "named": [{"candidate": step["candidate"], "class": step["class"], "place": step["place"],
                       "component": step["component"], "one_of": [other["candidate"] for other in step["one_of"]]}
                      for step in answer["steps"]],
            "probabilities": answer["probabilities"][:6],
            "chi2": [[step["name"], step["chi2_fit"], step["chi2_held_out"]] for step in answer["ladder"]]}


def diagnosed(bed: Bed, seconds: float) -> dict[str, object]:
    """The records of a bed and their diagnosis, in one process."""
    with tempfile.TemporaryDirectory() as folder:
        file = write(bed, Path(folder))
        began, processor = clock.monotonic(), clock.process_time()
        answer = hb.diagnose(file, number=1, seconds=seconds).as_dict()
        spent = {"processor": round(clock.process_time() - processor, 1), "seconds": round(clock.monotonic() - began, 1)}
    return {"key": bed.name, "limit": seconds, **spent, **judged(bed, answer)}


def main(beds: Mapping[str, Bed], study: str, description: str | None) -> None:
    """The beds named on the command line, or all without a result."""
    parser = argparse.ArgumentParser(description=(description or "").partition("\n")[0])
    parser.add_argument("names", nargs="*", choices=[*beds, []], metavar="NAME", help=", ".join(beds))
    parser.add_argument("--seconds", type=float, default=SECONDS, help="time limit of each diagnosis")
    parser.add_argument("--processor", action="store_true", help="`--seconds` are processor time")
    parser.add_argument("--results", default=study, help="results are appended to this file, without .jsonl")
    parser.add_argument("--write", type=Path, metavar="DIR", help="write the files of each bed to DIR/NAME; no diagnosis")
    options = parser.parse_args()
    if options.processor:
        count_processor_time()
    for name in options.names or [name for name in beds if options.write or name not in keeping.read(options.results)]:
        if options.write:
            print(write(beds[name], options.write / name))
            continue
        row = diagnosed(beds[name], options.seconds)
        keeping.add(options.results, row)
        print(report(beds[name], row), flush=True)


def report(bed: Bed, row: Mapping[str, Any]) -> str:
    """Truth and answer of a bed as text."""
    lines = [f"{bed.name}: {'right' if row['right'] else 'not right'}, {row['verdict']}, {row['processor']:.0f} s"]
    lines += [f"  truth   {row['levels'][e.law]:10s} {e.law} [{e.answers}]" for e in bed.effects]
    lines += [f"  answer  {n['class']}, {n['place']}, {n['component']}"
              f"{' or ' + ', '.join(n['one_of'][1:]) if n['one_of'][1:] else ''}" for n in row["named"]]
    return "\n".join([*lines, *(f"  {sentence}" for sentence in row["words"])])
