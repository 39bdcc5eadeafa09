"""Findings written back as diagrams: a file that extends the model and says only what was found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from heavebond.core.errors import Problem, UsageError
from heavebond.core.numerals import whole
from heavebond.core.presentation import readable_unit
from heavebond.core.units import read_unit
from heavebond.core.writable import why_unwritable
from heavebond.diagnosis.experiment_design import Separation
from heavebond.diagnosis.ladder import AddedEffect
from heavebond.estimation.change import block, quoted
from heavebond.estimation.diagram_files import extended_from, fitted_values, quantity, span, write, write_new
from heavebond.estimation.experiment import FIXED, Experiment, load_experiment
from heavebond.language.library import bundled


def finding_files(finding: AddedEffect, before: Experiment, model: Path, experiment: Path) -> tuple[str, str]:
    """The texts of a diagram at `model` that extends the one of `before` with what was found, fitted values and all, and of
    the experiment on it at `experiment`, where what was added is free."""
    candidate = finding.candidate
    own = {p.name: p for p in finding.parameters}
    units = {name: read_unit(readable_unit(p.unit, p.value)) for name, p in own.items()}
    fitted, _ = fitted_values(replace(finding.fit, parameters=tuple(p for p in finding.fit.parameters if p.name not in own)))
    change = candidate.change.joined(fitted).with_values(
        {name: quantity(p.value, units[name]) for name, p in own.items()})
    said = f"{before.model.name} with {candidate.kind} {candidate.place}."
    diagram = change.diagram(model.stem, said, extended_from(model, before.model.path))
    free = {name: span(p, units[name], name in {n.name for n in candidate.numbers if n.amplitude})
            for name, p in own.items()}
    free.update({name: FIXED for name in before.free if name not in finding.fit.experiment.free})
    lines = [f"experiment: {quoted(f'{before.name}, with {candidate.kind} {candidate.place}')}",
             f"extends: {quoted(extended_from(experiment, before.path))}",
             f"model: {quoted(extended_from(experiment, model))}",
             *block("inputs", {new: old for old, new in change.moved.items()}),
             *block("outputs", {name: f"{{is: {quoted(formula)}}}" for name, formula in change.channels.items()}),
             *block("free", free)]
    return diagram, "\n".join(lines) + "\n"


@dataclass(frozen=True)
class Targets:
    """Where the files of findings go: pairs (diagram, experiment) of names that are free, in `folder`."""

    folder: Path
    model: str
    experiment: str

    @classmethod
    def beside(cls, experiment: Experiment, folder: Path | None) -> Targets:
        """Beside the experiment (a bundled one: in the current folder), its names counted up: rig.yaml, rig_2.yaml, ...

        UsageError where the next file exists already: nothing is written over, and it is found before the search.
        """
        inside = experiment.path.resolve().is_relative_to(bundled("models").resolve())
        found = cls(folder or (Path() if inside else experiment.path.parent), experiment.model.path.stem,
                    experiment.path.stem)
        for path in (*found.pair(0), found.proposal):
            if path.exists():
                raise UsageError([Problem("file-exists", f"{path} exists already", None,
                                          "Move it away, or give another folder.")])
        make_folder(found.folder)
        if reason := why_unwritable(found.folder):
            raise UsageError([Problem("file-unwritable", f"nothing can be written in '{found.folder}': {reason}", None,
                                      "Give another one: --folder FOLDER (with `try`: --write FOLDER).")])
        return found

    def pair(self, k: int) -> tuple[Path, Path]:
        """The files of the k-th finding, counted from 0."""
        model, experiment = (_counted(name, k + 1) for name in (self.model, self.experiment))
        model = f"{model}_diagram" if model == experiment else model
        return self.folder / f"{model}.yaml", self.folder / f"{experiment}.yaml"

    @property
    def proposal(self) -> Path:
        """The input that would tell alternatives apart: `rig_2_input.csv` beside `rig_2.yaml`."""
        experiment = self.pair(0)[1]
        return experiment.with_name(f"{experiment.stem}_input.csv")

    @property
    def report(self) -> Path:
        """The page on the diagnosis of `rig.yaml`, `rig_report.html`: that of `rig_2.yaml` is another one."""
        return self.folder / f"{self.experiment}_report.html"


def make_folder(folder: Path) -> None:
    """Make a folder and its parents where they do not exist; UsageError where that fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        said = f"the folder '{folder}' cannot be made: {(error.strerror or str(error)).lower()}"
        raise UsageError([Problem("file-unwritable", said, None, "Give another one.")]) from None


def _counted(name: str, more: int) -> str:
    """`rig` as `rig_2`, `rig_2` as `rig_3`."""
    base, _, number = name.rpartition("_")
    last = whole(number)
    return f"{base}_{last + more}" if base and last is not None else f"{name}_{1 + more}"


def write_findings(before: Experiment, findings: Sequence[AddedEffect], targets: Targets) -> list[Path]:
    """Write each finding as a diagram and an experiment that extend the ones before; the experiments' paths.

    The experiments are loaded again as they stand: what is written is what was found, or an error says why not.
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
    """Write the proposed input as a record without measured channels: time and inputs in the columns and units of the
    records, to run the machine with. The path, none where nothing is proposed."""
    if not separation.decides:
        return []
    rows = zip(*separation.columns.values(), strict=True)
    lines = [",".join(separation.columns), *(",".join(f"{value:.9g}" for value in row) for row in rows)]
    write_new(path, "\n".join(lines) + "\n")
    return [path]
