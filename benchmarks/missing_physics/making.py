"""Write the cases of the benchmark: base model, records, and the hidden truth in a folder of its own.

Three sources give the cases: the bundled rigs, machines with a dominant effect and clutter as they are drawn for the
calibration study (`benchmarks.diagnosis.cluttered`), and machines with a law of a handbook that heavebond's catalogue does
not have (`benchmarks.diagnosis.laws`). All random numbers follow from the names of the machines.

The last record of a case is scored: its inputs are with the case, its outputs with the truth.
"""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import heavebond as hb
from benchmarks.diagnosis.beds import ACCURATE, write_diagram
from benchmarks.diagnosis.beds import Machine as BedMachine
from benchmarks.diagnosis.beds import write as write_bed
from benchmarks.diagnosis.cluttered import RECORDS, USES, Drawn, drawn
from benchmarks.diagnosis.laws import LAWS, HiddenLaw
from benchmarks.diagnosis.machines import MACHINES, Machine
from benchmarks.diagnosis.making import Hidden, generator
from benchmarks.diagnosis.measured import SETS
from benchmarks.diagnosis.measured import experiment as measured_experiment
from benchmarks.diagnosis.rigs import MODELS, RIGS, Rig
from benchmarks.missing_physics.equations import base_model
from heavebond.core.errors import HeavebondError
from heavebond.core.units import read_unit
from heavebond.diagnosis.candidates.catalogue import Candidate
from heavebond.diagnosis.candidates.fixed_values import VALUE
from heavebond.diagnosis.candidates.places import Places
from heavebond.estimation.channel_noise import with_noise
from heavebond.estimation.experiment import Experiment, changed_experiment, load_experiment
from heavebond.estimation.residuals import Run
from heavebond.exchange.c_code import export_c
from heavebond.language.edits import quoted
from heavebond.language.library import effect_classes, effect_kind
from heavebond.numerics.dae import Array

FOLDER = Path(__file__).parent
DIGITS = "%.7g"
TRIED = 40  # draws of a machine until one has at least two records
BEDS = ("cogging", "magnet", "eddy", "barus", "metering", "lagged", "norton")
BUNDLED = {"rig_friction": ("passive_rig", "friction"), "rig_nothing": ("passive_rig", "nothing"),
           "rig_choked": ("receiver_rig", "choked"), "rig_leakage": ("cylinder_rig", "leakage"),
           "rig_cogging": ("linear_motor", "cogging")}


@dataclass(frozen=True)
class Effect:
    """A true effect: `side` is machine or measuring chain, `places` the accepted sets of names, `classes` and `laws` the
    accepted names (empty: outside every catalogue), `kind` on what it depends, `words` what it is."""

    words: str
    side: str
    places: Sequence[Sequence[str]]
    kind: str
    classes: Sequence[str] = ()
    laws: Sequence[str] = ()


@dataclass(frozen=True)
class Truth:
    """The hidden truth of a case: the dominant effect (none: nothing is missing), further effects, the error (in noise
    variances) of the true machine on the scored record if it is known, and the input at the place of the effect in the
    first record, where it is a law between nodes."""

    origin: str
    dominant: Effect | None
    minor: Sequence[Effect] = ()
    floor: float | None = None
    input: Mapping[str, Any] | None = None
    misfit: float | None = None


@dataclass(frozen=True)
class Made:
    """A case before it is written: the experiment with all records, its noise (unit of each channel), and the truth."""

    experiment: Experiment
    noise: Mapping[str, float]
    truth: Truth
    files: Mapping[str, str] = field(default_factory=dict)


def names() -> list[str]:
    """The names of all cases."""
    return [*BUNDLED, *(f"nothing_{rig}" for rig in RIGS), *(f"law_{name}" for name in BEDS),
            *(_plain(machine) for machine in MACHINES)]


def _plain(name: str) -> str:
    return name.replace(" ", "_")


def write(name: str, folder: Path = FOLDER) -> None:
    """Write a case to FOLDER/machines/NAME and its truth to FOLDER/truths."""
    with tempfile.TemporaryDirectory() as work:
        made = _made(name, Path(work))
        _written(name, made, folder)


def _made(name: str, work: Path) -> Made:
    if name in BUNDLED:
        return _bundled(*BUNDLED[name])
    if name.startswith("nothing_"):
        return _nothing(RIGS[name.removeprefix("nothing_")], work)
    if name.startswith("law_"):
        return _of_law(LAWS[name.removeprefix("law_")], work)
    return _cluttered(next(m for m in MACHINES.values() if _plain(m.name) == name), work)


# -- sources ---------------------------------------------------------------------------------------------------------------
# What is hidden in the bundled records (models/README.md): words, nodes of the place, class, laws, kind.
BUNDLED_TRUTHS: Mapping[str, tuple[str, tuple[str, ...], str, tuple[str, ...]]] = {
    "friction": ("dry friction between platform and crown", ("platform", "crown"), "dry friction",
                 ("CoulombFriction", "DryFriction", "StribeckFriction")),
    "choked": ("both orifices choke below a critical pressure ratio of 0.5", ("supply", "receiver"), "choked flow", ()),
    "leakage": ("leakage past the piston between both chambers", ("chamber_a", "chamber_b"), "leakage",
                ("LaminarLeakage",)),
    "cogging": ("a force that is periodic in the position: 14 N*sin(2*pi*x/32 mm)", ("frame", "slide"), "", ())}


def _bundled(folder: str, name: str) -> Made:
    experiment = load_experiment(MODELS / folder / f"{name}.yaml")
    noise = {key: o.noise or 0.0 for key, o in experiment.outputs.items()}
    if name == "nothing":
        return Made(experiment, noise, Truth("bundled rig", None))
    words, nodes, kind, laws = BUNDLED_TRUTHS[name]
    classes = [c for c in (kind, *effect_classes()) if kind and (c == kind or effect_classes().get(c) == kind)]
    accepted = places(experiment, nodes)
    if name == "choked":  # at one orifice or at both
        accepted = [*accepted, *places(experiment, ("receiver", "air")), ["inlet", "outlet"], ["air", "receiver", "supply"]]
    effect = Effect(words, "machine", accepted, effect_kind(kind) if kind else "displacement", classes, laws)
    return Made(experiment, noise, Truth("bundled rig", effect, input=_slots(experiment) if name == "cogging" else None))


def _slots(experiment: Experiment) -> dict[str, Any]:
    """The force of the slots in the first record of the linear motor, at the measured position."""
    record = next(iter(experiment.records.values()))
    position = pd.read_csv(record.file)[experiment.outputs["position"].column].to_numpy()
    force = 14 * np.sin(2 * np.pi * position / 0.032)
    return {"place": ["frame", "slide"], "record": record.name, "values": _rounded(force)}


def _nothing(rig: Rig, work: Path) -> Made:
    """A rig in which nothing is missing, and values of the data sheet that are wrong within their tolerance."""
    for seed in range(TRIED):
        try:
            hidden = Hidden(rig, (), f"missing physics {seed}", work)
            experiment = hidden.case().experiment
        except HeavebondError:
            continue
        names = list(experiment.outputs)
        noise = dict(zip(names, hidden.noise.tolist(), strict=True))
        return Made(experiment, noise, Truth("rig without a missing effect", None))
    raise RuntimeError(f"no draw of {rig.name} can be simulated")


def _of_law(law: HiddenLaw, work: Path) -> Made:
    """A machine with a law of a handbook."""
    bed = law.bed
    experiment = load_experiment(write_bed(bed, work / "bed"))
    scored, train = list(bed.records)[-1], next(iter(bed.records))
    courses = {}
    for record in (train, scored):
        with tempfile.TemporaryDirectory() as hidden:
            courses[record] = BedMachine(bed, record, (*bed.effects, *bed.clutter), Path(hidden))()
    noise = {key: (o.noise or 0.0) for key, o in experiment.outputs.items()}
    measured = pd.read_csv(work / "bed" / f"{scored}.csv")
    floor = float(np.mean([np.mean(((measured[o.column].to_numpy() - y) / noise[key])**2) for (key, o), y in zip(
        experiment.outputs.items(), courses[scored], strict=True)]))
    with tempfile.TemporaryDirectory() as hidden:
        machine = BedMachine(bed, train, (*bed.effects, *bed.clutter), Path(hidden))
        result = machine.run.simulator.run({})
        from heavebond.numerics.result import Probe

        motion = dict(zip(law.variables, Probe(machine.run.assembly, list(law.variables.values()), si=True).values(result),
                          strict=True))
        step = (len(result.time) - 1) // (len(bed.time) - 1)
        value = law.value(motion, result.time)[::step]
    effect = Effect(bed.effects[0].law, "machine", places(experiment, law.place), _kind_of(law))
    diagram = write_diagram(replace(bed, parts=()), work)
    return Made(experiment, noise, Truth("law of a handbook", effect, tuple(
        Effect(e.law, "machine", [sorted(place) for _, place in e.accepted], effect_kind(e.accepted[0][0]),
               [kind for kind, _ in e.accepted]) for e in bed.clutter), floor,
        {"place": list(law.place), "record": train, "values": _rounded(value)}), {diagram.name: diagram.read_text("utf-8")})


def _kind_of(law: HiddenLaw) -> str:
    """On what a law depends: `rate` if the speed or a pressure drop is in it, `displacement` if only the position is."""
    return "rate" if law.bed.name in ("eddy", "barus", "metering", "lagged", "norton") else "displacement"


def _cluttered(machine: Machine, work: Path) -> Made:
    """The first draw of a machine that has at least two records; of its library no law is struck."""
    for number in range(TRIED):
        uses = USES[int(generator("cluttered", machine.name, number, 0).choice(len(USES), p=RECORDS))]
        if len(uses) == 1:  # of the first attempt of this draw
            continue
        (work / str(number)).mkdir()
        try:
            case = drawn(machine, number, work / str(number))
        except HeavebondError:
            continue
        if len(case.experiment.records) > 1:
            break
    else:
        raise RuntimeError(f"no draw of {machine.name} has two records")
    library = hb.load(machine.model).library
    experiment = replace(case.experiment, model=replace(case.experiment.model, library=library))
    keys = {o.shown.text: key for key, o in experiment.outputs.items()}
    noise = {keys[formula]: value for formula, value in case.noise.items()}
    scored = list(experiment.records)[-1]
    measured = pd.read_csv(experiment.records[scored].file)
    floor = float(np.mean([np.mean(((measured[o.column].to_numpy() - y) / noise[key])**2) for (key, o), y in zip(
        experiment.outputs.items(), case.clean[scored], strict=True)]))
    dominant = _effect(experiment, case.effect) if case.effect is not None else _value(experiment, case.name) \
        if case.name else None
    minor = [*(_effect(experiment, e) for e in case.minor_effects),
             *(_value(experiment, label) for what, label, _ in case.minor if what in ("value", "sheet", "drift", "cycle",
                                                                                     "record"))]
    return Made(experiment, noise, Truth("cluttered machine", dominant, tuple(minor), floor, _input(case, experiment),
                                         case.misfit))


def _effect(experiment: Experiment, candidate: Candidate) -> Effect:
    kind = effect_kind(candidate.kind)
    side = "measuring chain" if kind == "measurement" or candidate.attaches == "channel" else "machine"
    alike = [c for c in (candidate.kind, *effect_classes()) if c == candidate.kind or
             effect_classes().get(c) == candidate.kind or c == effect_classes().get(candidate.kind)]
    return Effect(candidate.label, side, places(experiment, candidate.where), kind, list(dict.fromkeys(alike)),
                  [candidate.component])


def _value(experiment: Experiment, name: str) -> Effect:
    """A parameter whose value differs from that of the base model, or varies."""
    component = name.rpartition(".")[0]
    return Effect(name, "machine", places(experiment, (component,)), "variation", [VALUE, "varying parameter"], [name])


def places(experiment: Experiment, where: Sequence[str]) -> list[list[str]]:
    """The sets of names that name a place: its nodes, with and without those of the surroundings, or the component that
    joins them."""
    known, accepted = Places.of(experiment), {frozenset(where)}
    ends = {part: frozenset(nodes.values()) for part, nodes in known.parts.items()}
    nodes = frozenset().union(*(ends.get(name, frozenset([name])) for name in where))
    every = {node for part in ends.values() for node in part}
    if nodes <= every:
        inner = nodes - known.grounds
        accepted |= {nodes, *([inner] if inner else []), *(inner | {ground} for ground in known.grounds if inner)}
        accepted |= {frozenset([part]) for part, its in ends.items() if its - known.grounds == inner and inner and (
            len(inner) > 1 or its & known.grounds)}
    return sorted(sorted(place) for place in accepted)


def _input(case: Drawn, experiment: Experiment) -> Mapping[str, Any] | None:
    """The input at the place of the dominant effect in the first record, if it is a law between nodes."""
    effect = case.effect
    if effect is None or effect.attaches not in ("across", "at") or effect.members or len(effect.numbers) == 0:
        return None
    owner = effect.numbers[0].name.rpartition(".")[0]
    name, record = next(iter(experiment.records.items()))
    run = Run(changed_experiment(experiment, case.alteration.change), record, [], ACCURATE)
    known, site = run.assembly.parameter_values, run.assembly.flat.names
    port = "b" if (len(effect.where) == 2 and f"{owner}.b.f" in site) or f"{owner}.b.tau" in site else "a"
    through = next((m for m in ("f", "tau", "q", "m", "i", "Q") if f"{owner}.{port}.{m}" in site), None)
    if through is None:
        return None
    from heavebond.numerics.result import Probe

    values = {**case.values, **case.alteration.values, **case.alteration.each.get(name, {})}
    result = run.simulator.run({k: v for k, v in values.items() if k in known})
    course = Probe(run.assembly, [f"{owner}.{port}.{through}"], si=True).values(result)[0]
    return {"place": list(effect.where), "record": name, "values": _rounded(course)}


def _rounded(values: Array) -> list[float]:
    return [float(f"{v:.5g}") for v in values]


# -- files -----------------------------------------------------------------------------------------------------------------
def _written(name: str, made: Made, root: Path) -> None:
    folder, truths = root / "machines" / name, root / "truths"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    truths.mkdir(exist_ok=True)
    experiment = made.experiment
    scored = list(experiment.records)[-1]
    inputs = experiment.inputs_for(next(iter(experiment.records.values())))
    outputs = {key: (o.column, o.shown.unit) for key, o in experiment.outputs.items()}
    records: dict[str, dict[str, str]] = {}
    for key, record in experiment.records.items():
        table = pd.read_csv(record.file)
        kept = (table[experiment.time.column] >= (record.begin if record.begin is not None else -np.inf)) & (
            table[experiment.time.column] <= (record.end if record.end is not None else np.inf))
        table = table[kept][[experiment.time.column, *(i.column for i in inputs.values()),
                                          *(column for column, _ in outputs.values())]]
        records[key] = {"file": f"{key}.csv", "use": "score" if key == scored else record.use}
        if key == scored:
            table.to_csv(truths / f"{name}_{key}.csv", index=False, float_format=DIGITS)
            table = table.drop(columns=[column for column, _ in outputs.values()])
        table.to_csv(folder / f"{key}.csv", index=False, float_format=DIGITS)
    content = {
        "case": name, "time": experiment.time.column, "records": records,
        "inputs": {key: {"column": i.column, "unit": i.unit, **_si(i.unit), "interpolation": i.interpolation}
                   for key, i in inputs.items()},
        "outputs": {key: {"column": column, "unit": unit, **_si(unit), "noise": made.noise[key] * read_unit(unit).scale}
                    for key, (column, unit) in outputs.items()},
        "model": base_model(experiment, experiment.records[next(iter(records))])}
    _dump(folder / "case.json", content)
    (folder / "experiment.yaml").write_text(_experiment_text(name, made, folder, records, inputs, outputs), encoding="utf-8")
    for file, text in made.files.items():
        (folder / file).write_text(text, encoding="utf-8")
    truth = made.truth
    _dump(truths / f"{name}.json", {
        "case": name, "origin": truth.origin, "dominant": truth.dominant and vars(truth.dominant),
        "minor": [vars(effect) for effect in truth.minor], "floor": truth.floor, "misfit": truth.misfit,
        "input": truth.input, "records": {scored: f"{name}_{scored}.csv"}})


def _si(unit: str) -> dict[str, float]:
    one = read_unit(unit)
    return {"scale": one.scale, "offset": one.offset}


def _dump(path: Path, content: object) -> None:
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def _experiment_text(name: str, made: Made, folder: Path, records: Mapping[str, Mapping[str, str]],
                     inputs: Mapping[str, Any], outputs: Mapping[str, tuple[str, str]]) -> str:
    """The case as an experiment of heavebond, without the scored record."""
    experiment = made.experiment
    file = next(iter(made.files), None) or os.path.relpath(experiment.model.path, folder)
    lines = [f"experiment: {name}", f"model: {quoted(Path(file).as_posix())}", "records:"]
    lines += [f"  {key}: {{file: {key}.csv, use: {entry['use']}}}" for key, entry in records.items()
              if entry["use"] != "score"]
    lines += [f"time: {{column: {experiment.time.column}, unit: s}}", "inputs:"]
    lines += [f"  {key}: {{column: {i.column}, unit: {quoted(i.unit)}, interpolation: {i.interpolation}}}"
              for key, i in inputs.items()]
    lines.append("outputs:")
    for key, (column, unit) in outputs.items():
        formula = experiment.outputs[key].shown.text
        lines.append(f'  {key}: {{is: "{formula}", column: {column}, unit: {quoted(unit)}, '
                     f"noise: {made.noise[key]:.6g} {'' if unit == '1' else unit}}}")
    if experiment.free:
        lines.append("free:")
        for key, free in experiment.free.items():
            unit = "" if free.range.unit.text == "1" else f" {free.range.unit.text}"
            scale = free.range.unit.scale
            low, high, nominal = free.range.low / scale, free.range.high / scale, free.range.nominal
            lines.append(f"  {key}: {low:.9g} .. {high:.9g}{unit}" if not nominal else
                         f"  {key}: {nominal / scale:.9g}{unit} +- {100 * (free.range.high / nominal - 1):.6g} %")
    return "\n".join(lines) + "\n"


def cases(chosen: Sequence[str], folder: Path) -> Iterator[str]:
    """Write the cases one after another."""
    for name in chosen:
        write(name, folder)
        yield name


def code(folder: Path, root: Path = FOLDER) -> None:
    """Write the base model of each case as C, by the export of heavebond, to FOLDER/NAME.c."""
    folder.mkdir(parents=True, exist_ok=True)
    for path in sorted((root / "machines").glob("*/experiment.yaml")):
        experiment = load_experiment(path)
        record = next(iter(experiment.records.values()))
        export_c(experiment.model_for(record), folder / f"{path.parent.name}.c", list(experiment.inputs_for(record)))
        print(path.parent.name, flush=True)


def measured(records: Path, root: Path) -> None:
    """Write cases of measured machines, from the user's copy of the public records, to ROOT; the last record is scored.

    Sources and licences are in `benchmarks/diagnosis/measured/sets.yaml`. A set without a scored record, or with a model
    that has no equations in this form, is left out with the reason.
    """
    for name, entry in SETS.items():
        try:
            experiment = with_noise(measured_experiment(name, records.resolve()))
            if len(experiment.records) < 2:
                print(f"{name}: left out, it has one record only")
                continue
            noise = {key: o.noise or 0.0 for key, o in experiment.outputs.items()}
            named = [Effect(e["effect"], e["side"], e["places"], effect_kind(e["classes"][0]) if e["classes"] else "",
                            e["classes"], e["laws"]) for e in entry.effects]
            minor = [bool(e.get("minor")) for e in entry.effects]
            dominant = next((e for e, small in zip(named, minor, strict=True) if not small), None)
            truth = Truth(f"measured: {entry.source} Licence: {entry.licence}", dominant,
                          tuple(e for e in named if e is not dominant))
            _written(name, Made(experiment, noise, truth), root)
            print(name, flush=True)
        except (HeavebondError, OSError, KeyError, AssertionError, ValueError) as error:
            print(f"{name}: left out, {type(error).__name__}: {str(error).splitlines()[0] if str(error) else ''}")
