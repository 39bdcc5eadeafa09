"""Files of a diagnosis: each finding as a diagram and an experiment that extend the original ones, and the proposed
input."""

from __future__ import annotations

import itertools
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from heavebond.core.errors import HeavebondError, Problem, UsageError
from heavebond.core.numerals import whole
from heavebond.core.presentation import readable_unit
from heavebond.core.units import Unit, read_unit
from heavebond.core.writable import make_folder, why_unwritable
from heavebond.diagnosis.search.record_starts import INITIAL, free_text
from heavebond.diagnosis.state import AddedEffect
from heavebond.estimation.experiment import FIXED, Experiment, load_experiment
from heavebond.estimation.fitting import Fitted, fitted_values
from heavebond.experiment_design.separation import Separation
from heavebond.language.edits import Change, block, extended_from, quoted, write, write_new
from heavebond.language.library import bundled
from heavebond.text.yaml_source import read

LADDER = 200  # number of free file numbers that are reserved; exceeds the number of findings


def finding_files(finding: AddedEffect, before: Experiment, model: Path, experiment: Path) -> tuple[str, str]:
    """Create the texts of a diagram and an experiment for one finding.

    The diagram at `model` extends the diagram of `before` by the effect, with all fitted values. In the experiment at
    `experiment` the parameters of the effect are free.
    """
    candidate = finding.candidate
    sought = {p.name: p for p in finding.parameters}
    units = {name: read_unit(readable_unit(p.unit, p.value)) for name, p in sought.items()}
    other_parameters = tuple(p for p in finding.fit.parameters if p.name not in sought)
    fitted, _ = fitted_values(replace(finding.fit, parameters=other_parameters))
    change = candidate.change.joined(fitted).with_values(
        {name: units[name].written(p.value) for name, p in sought.items()})
    description = f"{before.model.name} with {candidate.kind} {candidate.place}."
    newly_separate = {name: f for name, f in finding.fit.experiment.free.items()
                      if f.each and (name not in before.free or not before.free[name].each)}
    begun = {p.name.removeprefix(INITIAL): newly_separate[p.name].range.unit.written(p.before)
             for p in finding.fit.parameters if p.name in newly_separate and p.name.startswith(INITIAL)}
    # a free initial value needs a value in the diagram
    change = Change(initial={state: text for state, text in begun.items()
                             if state not in before.model.initial.conditions}).joined(change)
    diagram = change.diagram(model.stem, description, extended_from(model, before.model.path))
    free = {name: span(p, units[name], name in {n.name for n in candidate.numbers if n.amplitude})
            for name, p in sought.items()}
    free.update({name: FIXED for name in before.free if name not in finding.fit.experiment.free})
    free.update({name: free_text(f) for name, f in newly_separate.items()})
    # the values that differ between records are in the diagram for none of them
    of_records: dict[str, str] = {}
    for record, fitted_of_record in finding.fit.record_values.items():
        separate = {name: quoted(finding.fit.experiment.free[name].range.unit.written(value))
                    for name, value in fitted_of_record.items()}
        entries = {"set": {n: text for n, text in separate.items() if not n.startswith(INITIAL)},
                   "initial": {n.removeprefix(INITIAL): text for n, text in separate.items() if n.startswith(INITIAL)}}
        texts = [f"{key}: {{{', '.join(f'{name}: {text}' for name, text in values.items())}}}"
                 for key, values in entries.items() if values]
        if texts:
            of_records[record] = f"{{{', '.join(texts)}}}"
    # inputs that the diagnosis smooths although their file does not request it
    smoothed = {name: f"{{column: {quoted(file_input.column)}, unit: {quoted(file_input.unit)}, "
                      f"interpolation: {file_input.interpolation}, {'gaps: bridge, ' if file_input.bridge else ''}"
                      f"smooth: {file_input.smooth:g} Hz"
                      f"{f', noise: {file_input.noise:g} {file_input.unit}' if file_input.noise else ''}}}"
                for name, file_input in before.inputs.items() if file_input.smooth is not None and file_input.file == Path()}
    lines = [f"experiment: {quoted(f'{before.name}, with {candidate.kind} {candidate.place}')}",
             f"extends: {quoted(extended_from(experiment, before.path))}",
             f"model: {quoted(extended_from(experiment, model))}",
             *block("records", of_records),
             *block("inputs", {**smoothed, **{new: old for old, new in change.moved.items()}}),
             *block("outputs", {name: f"{{is: {quoted(formula)}}}" for name, formula in change.channels.items()}),
             *block("free", free)]
    return diagram, "\n".join(lines) + "\n"


@dataclass(frozen=True)
class Targets:
    """Unused paths for the files of findings: pairs (diagram, experiment) in `folder`.

    Consecutive numbers in the names make them unique. Numbering begins at the number in the name of `experiment` plus
    `first`; `numbers` are the increments without existing files.
    """

    folder: Path
    model: str
    experiment: str
    first: int = 1
    numbers: tuple[int, ...] = ()

    @classmethod
    def beside(cls, experiment: Experiment, folder: Path | None) -> Targets:
        """Targets in the folder of the experiment, with consecutive numbers: rig.yaml, rig_2.yaml, ...

        For a bundled experiment the folder is the current one. Existing files are kept, and the next unused number is taken.
        Raises UsageError if the folder is not writable.
        """
        inside = experiment.path.resolve().is_relative_to(bundled("models").resolve())
        targets = cls(folder or (Path() if inside else experiment.path.parent), experiment.model.path.stem,
                      experiment.path.stem)._with_free_numbers()
        make_folder(targets.folder)
        if reason := why_unwritable(targets.folder):
            raise UsageError([Problem("file-unwritable", f"nothing can be written in '{targets.folder}': {reason}", None,
                                      "Give another one: --folder FOLDER (with `try`: --write FOLDER).")])
        return targets

    @classmethod
    def named(cls, experiment: Experiment, file: Path) -> Targets:
        """Target `file` for the experiment of one finding, with its diagram FILE_diagram.yaml in the same folder.

        If the files exist and contain an earlier result for the same experiment, the next unused number is taken. Raises
        UsageError if they contain anything else.
        """
        targets = cls(file.parent, f"{file.stem}_diagram", file.stem, 0)._with_free_numbers()
        if targets.passed and not is_finding(file, experiment):
            raise UsageError([Problem("file-exists", f"{targets.passed} exists already", None,
                                      "Give another name, or remove it first.")])
        make_folder(targets.folder)
        if reason := why_unwritable(targets.folder):
            raise UsageError([Problem("file-unwritable", f"'{file}' cannot be written: {reason}")])
        return targets

    def _with_free_numbers(self) -> Targets:
        free = (k for k in itertools.count(self.first) if not any(os.path.lexists(path) for path in self._files(k)))
        return replace(self, numbers=tuple(itertools.islice(free, LADDER)))

    def _pair(self, number: int) -> tuple[Path, Path]:
        model, experiment = (_counted(name, number) for name in (self.model, self.experiment))
        model = f"{model}_diagram" if model == experiment else model
        return self.folder / f"{model}.yaml", self.folder / f"{experiment}.yaml"

    def _files(self, number: int) -> tuple[Path, ...]:
        experiment = self._pair(number)[1]
        return *self._pair(number), experiment.with_name(f"{experiment.stem}_input.csv")

    def pair(self, k: int) -> tuple[Path, Path]:
        """Paths of the diagram and the experiment of finding `k`, counted from 0."""
        return self._pair(self.numbers[k])

    @property
    def passed(self) -> Path | None:
        """First existing file with a name that the targets would use; None if there is none."""
        existing = (path for k in range(self.first, self.numbers[0]) for path in self._files(k) if os.path.lexists(path))
        return next(existing, None)

    @property
    def proposal(self) -> Path:
        """Path of the input that would distinguish the alternatives: `rig_2_input.csv` for `rig_2.yaml`."""
        return self._files(self.numbers[0])[-1]

    @property
    def kept(self) -> Path:
        """Path of the refits that a running search stores: `rig_refits.jsonl`."""
        return self.folder / f"{self.experiment}_refits.jsonl"

    @property
    def report(self) -> Path:
        """Path of the page on the diagnosis of `rig.yaml`: `rig_report.html`, or `rig_report_2.html` if that exists. (The
        page of `rig_2.yaml` is `rig_2_report.html`.)"""
        names = (f"{self.experiment}_report{f'_{k}' if k > 1 else ''}.html" for k in itertools.count(1))
        return next(path for name in names if not os.path.lexists(path := self.folder / name))


def is_finding(path: Path, before: Experiment) -> bool:
    """True if the file is an experiment that `write_findings` wrote for a finding in the experiment `before`."""
    try:
        root = read(path).root.items
    except (HeavebondError, OSError):
        return False
    name, extended = (getattr(root.get(key), "text", "") for key in ("experiment", "extends"))
    return name.startswith(f"{before.name}, with ") and extended == extended_from(path, before.path)


def _counted(name: str, more: int) -> str:
    """Increase the number in a name by `more`: `rig` to `rig_2`, `rig_2` to `rig_3`."""
    if not more:
        return name
    base, _, number = name.rpartition("_")
    last = whole(number)
    return f"{base}_{last + more}" if base and last is not None else f"{name}_{1 + more}"


def write_findings(before: Experiment, findings: Sequence[AddedEffect], targets: Targets) -> list[Path]:
    """Write each finding as a diagram and an experiment that extend the previous ones; return the paths of the experiments.

    Each experiment is loaded again after writing, so a file that does not represent the finding causes an error.
    """
    written = []
    for k, finding in enumerate(findings):
        model, experiment = targets.pair(k)
        diagram, text = finding_files(finding, before, model, experiment)
        write(model, diagram)
        write(experiment, text)
        before = load_experiment(experiment)
        written.append(experiment)
    return written


def write_proposal(separation: Separation, path: Path) -> list[Path]:
    """Write the proposed input as a record without measured channels, to be applied to the machine.

    The columns are time and the inputs in the units of the records. Return the path in a list, which is empty without a
    proposal.
    """
    if not separation.decides:
        return []
    rows = zip(*separation.columns.values(), strict=True)
    lines = [",".join(separation.columns), *(",".join(f"{value:.9g}" for value in row) for row in rows)]
    write_new(path, "\n".join(lines) + "\n")
    return [path]


def span(fitted: Fitted, unit: Unit, amplitude: bool) -> str:
    """Range of a fitted parameter in the new experiment. An amplitude may increase by half or decrease to zero; a shape
    keeps its range."""
    low, high = fitted.low, fitted.high
    if amplitude and fitted.value:
        reach = 1.5 * abs(fitted.value)
        low, high = max(low, -reach if low < 0 else low), min(high, reach) if high > 0 else high
    ends = [f"{unit.from_si(end):.4g}" for end in (low, high)]
    return f"{ends[0]} .. {ends[1]}" + ("" if unit.text in ("1", "") else f" {unit.text}")
