"""Findings written back as diagrams: a file that extends the model and says only what was found."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from heavebond.basis.errors import Problem, UsageError
from heavebond.basis.numerals import whole
from heavebond.basis.presentation import readable_unit
from heavebond.basis.units import Unit, read_unit
from heavebond.basis.writable import why_unwritable, write_text
from heavebond.evidence.change import Change, block, quoted
from heavebond.evidence.experiment import FIXED, Experiment, load_experiment
from heavebond.evidence.finding import Finding
from heavebond.evidence.fitting import Fit, Fitted
from heavebond.evidence.separation import Separation
from heavebond.language.library import bundled
from heavebond.language.model import Model
from heavebond.studies.calibration import Calibrated
from heavebond.studies.objective import Task
from heavebond.studies.study import Study
from heavebond.studies.tuning import Tuned


def quantity(value: float, unit: Unit) -> str:
    """`46.998 kN/m`: an SI value in a unit, to six digits."""
    return unit.written(value)


def fitted_diagram(fit: Fit, path: Path) -> str:
    """The text of a diagram at `path` that extends the fitted one and sets what was fitted for all records."""
    experiment = fit.experiment
    records = [r.name for r in experiment.records.values() if r.use == "fit"]
    change, notes = fitted_values(fit)
    head = [f"model: {path.stem}",
            f"summary: {experiment.model.name} with parameters fitted to {', '.join(records)}.",
            f"extends: {extended_from(path, experiment.model.path)}"]
    return "\n".join([*head, *block("set", change.settings, notes), *block("initial", change.initial, notes)]) + "\n"


def fitted_values(fit: Fit) -> tuple[Change, dict[str, str]]:
    """What was fitted for all records, as a change to the diagram, and the interval of each as a note."""
    values, notes = {}, {}
    for p in fit.parameters:
        if not p.record:
            unit = fit.experiment.free[p.name].range.unit
            values[p.name] = quantity(p.value, unit)
            notes[p.name.removeprefix("initial.")] = f"at the {p.at_bound} end of its range" if p.at_bound else \
                p.known(partial(quantity, unit=unit))
    return Change().with_values(values), notes


def tuned_diagram(model: Model, task: Task, result: Tuned, path: Path, settings: Mapping[str, str]) -> str:
    """The text of a diagram at `path` that extends the tuned one and sets the best values, and what was set beside them."""
    tuned = {name: quantity(value, task.free[name].unit) for name, value in result.values.items()}
    values = {**{name: quoted(text) for name, text in settings.items()}, **tuned}
    head = [f"model: {path.stem}",
            f"summary: {model.name}, tuned to a cost of {result.cost:.5g}.",
            f"extends: {extended_from(path, model.path)}"]
    return "\n".join([*head, *block("set", values)]) + "\n"


def calibrated_diagram(study: Study, found: Calibrated, path: Path) -> str:
    """The text of a diagram at `path` that extends a study's diagram and sets what was calibrated."""
    assert study.calibration is not None
    values = {name: quantity(after, study.calibration.free[name].unit) for name, (_, after) in found.values.items()}
    notes = {name: f"at the {end} end of its range" for name, end in found.at_end.items()}
    source = study.beside[study.calibration.source].source
    head = [f"model: {path.stem}", f"summary: {study.model.name}, calibrated to what {source} gives.",
            f"extends: {extended_from(path, study.model.path)}"]
    return "\n".join([*head, *block("set", values, notes)]) + "\n"


def extended_from(path: Path, model: Path) -> str:
    """How a file at `path` names the diagram at `model`: a bundled one by its name, so that the file can move."""
    inside = bundled("models").resolve()
    if model.resolve().is_relative_to(inside) and not path.resolve().is_relative_to(inside):
        return model.resolve().relative_to(inside).as_posix()
    return Path(os.path.relpath(model.resolve(), path.resolve().parent)).as_posix()


def finding_files(finding: Finding, before: Experiment, model: Path, experiment: Path) -> tuple[str, str]:
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
        if not found.folder.is_dir():
            raise UsageError([Problem("file-unwritable", f"there is no folder '{found.folder}'", None,
                                      "Make it first, or give another one.")])
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


def _counted(name: str, more: int) -> str:
    """`rig` as `rig_2`, `rig_2` as `rig_3`."""
    base, _, number = name.rpartition("_")
    last = whole(number)
    return f"{base}_{last + more}" if base and last is not None else f"{name}_{1 + more}"


def write_findings(before: Experiment, findings: Sequence[Finding], targets: Targets) -> list[Path]:
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
    _new(path, "\n".join(lines) + "\n")
    return [path]


def span(fitted: Fitted, unit: Unit, amplitude: bool) -> str:
    """The range of a number that was found: an amplitude may grow by half and shrink to nothing, a shape keeps its own."""
    low, high = fitted.low, fitted.high
    if amplitude and fitted.value:
        reach = 1.5 * abs(fitted.value)
        low, high = max(low, -reach if low < 0 else low), min(high, reach) if high > 0 else high
    shown = [f"{unit.from_si(end):.4g}" for end in (low, high)]
    return f"{shown[0]} .. {shown[1]}" + ("" if unit.text in ("1", "") else f" {unit.text}")


def write(path: Path, text: str) -> None:
    """Write a new file; UsageError where it exists already or cannot be written, so that nothing is lost."""
    if path.suffix not in (".yaml", ".yml"):
        raise UsageError(f"'{path.name}' is no name of a diagram", hint=f"Write {path.with_suffix('.yaml').name}.")
    _new(path, text)


def _new(path: Path, text: str) -> None:
    try:
        write_text(path, text, exclusive=True)
    except FileExistsError:
        raise UsageError(f"{path} exists already", hint="Give another name, or remove it first.") from None
    except OSError as error:
        raise UsageError(f"{path} cannot be written: {error.strerror}") from None


