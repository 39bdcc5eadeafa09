"""The long computations of the studio: the functions of the commands `fit`, `localize`, `diagnose`, `try` and `tune`,
their results for the page, and the files to write."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from heavebond.core.cancellation import ENDED_EARLY, clear_signal
from heavebond.core.presentation import readable_unit
from heavebond.core.quoting import file_stem
from heavebond.core.units import read_unit
from heavebond.core.writable import free_path, write_text
from heavebond.diagnosis.answer.files import Targets, write_findings
from heavebond.diagnosis.answer.ranking import entries
from heavebond.diagnosis.attempt import attempt
from heavebond.diagnosis.diagnose import Diagnosis, diagnose
from heavebond.diagnosis.state import AddedEffect
from heavebond.estimation.experiment import Experiment, load_experiment
from heavebond.estimation.fitting import Fit, fit, fitted_diagram
from heavebond.language.edits import extended_from, quoted, write
from heavebond.localise.misfit import PlaceEstimate, localize, noun
from heavebond.reports.result_tables import Item, Line, attempt_items, diagnosis_items, fit_items
from heavebond.reports.result_tables import localization_items as places_items
from heavebond.studio.command_forms import run_command
from heavebond.studio.contents import Entry
from heavebond.studio.evidence import item_entries

Arrays = dict[str, Any]
Writing = Callable[[Mapping[str, Any]], list[Path]]
Done = tuple[Entry, Arrays, Writing | None]
ALTERNATIVES = 8  # alternatives to the chosen candidate that can be added in its place


class Teller(Protocol):
    """Receiver of the progress of a computation."""

    def progress(self, text: str) -> None:
        """The progress callback."""

    def tell(self, kind: str, *content: Any) -> None:
        """Send other data, such as the growing table of models."""


def _result(kind: str, items: Sequence[Item], figures: Mapping[str, object], partial: bool, **more: object) -> Entry:
    return {"kind": kind, "items": item_entries(items), "figures": dict(figures), "partial": partial, **more}


# -- fit -----------------------------------------------------------------------------------------------------------------
def fitted(path: Path, options: Mapping[str, Any], job: Teller) -> Done:
    """As `heavebond fit`; the diagram with the fitted values and an experiment on it can be written."""
    fit_result = fit(load_experiment(path), progress=job.progress, partial=True)
    early = fit_result.message == ENDED_EARLY
    items = [*fit_items(fit_result), *([Line("ended early: these are the best values so far", True)] if early else [])]
    return _result("fit", items, fit_result.as_dict(), early, adds=[{"label": "the fitted values"}]), {}, \
        lambda request: [] if request.get("lost") else _write_fit(fit_result, path, _folder(path, options))


def _folder(path: Path, options: Mapping[str, Any]) -> Path:
    """Folder for results: the folder of the file, for a bundled one the opened folder."""
    return Path(str(options["folder"])) if options.get("folder") else path.parent


def _write_fit(fit_result: Fit, path: Path, folder: Path) -> list[Path]:
    experiment = free_path(folder / f"{path.stem}_fitted.yaml")
    diagram = free_path(folder / f"{fit_result.experiment.model.path.stem}_fitted.yaml", experiment)
    write(diagram, fitted_diagram(fit_result, diagram))
    name = f"{fit_result.experiment.name}, fitted"
    write(experiment, f"experiment: {quoted(name)}\nextends: {quoted(extended_from(experiment, path))}\n"
                      f"model: {quoted(extended_from(experiment, diagram))}\n")
    return [diagram, experiment]


# -- localize ------------------------------------------------------------------------------------------------------------
def localized(path: Path, options: Mapping[str, Any], job: Teller) -> Done:
    """As `heavebond localize`, with the estimated input at each place of the diagram."""
    localization = localize(load_experiment(path), progress=job.progress)
    arrays: Arrays = {}
    places = [_place(k, suspect, arrays) for k, suspect in enumerate(localization.suspects)]
    # the variables on which the error of a channel depends, with the curve of the error over each
    states = []
    for k, state in enumerate(localization.states):
        display_unit = readable_unit(state.unit, float(np.max(np.abs(state.x)))) if state.unit else ""
        per = read_unit(state.unit).scale / read_unit(display_unit).scale if state.unit else 1.0
        arrays[f"state/{k}"] = np.vstack([state.x * per, state.y])
        states.append({"key": f"state/{k}", "channel": state.channel, "variable": state.variable,
                       "unit": display_unit, "r2": state.r2,
                       "of": localization.experiment.outputs[state.channel].shown.unit})
    return _result("where", places_items(localization), localization.as_dict(), False, places=places, states=states,
                   sections=[{"record": s.record, "from": s.begin, "to": s.end, "chi2": s.chi2}
                             for s in localization.stretches]), arrays, None


def _place(k: int, suspect: PlaceEstimate, arrays: Arrays) -> Entry:
    """A place with the names of its arrays: over time for each record, and over the variables around it."""
    display_unit = readable_unit(suspect.place.unit.text, suspect.rms)
    scale = read_unit(suspect.place.unit.text).scale / read_unit(display_unit).scale
    for name, implied in suspect.implied.items():
        arrays[f"place/{k}/{name}"] = np.vstack([implied.time, implied.value * scale, 2 * implied.deviation * scale])
    curve, over = suspect.curve, []
    if curve is not None:
        best = curve.variable.formula
        for n, formula in enumerate([best, *(f for f in curve.scores if f != best)][:4]):
            over.append(_over(f"place/{k}/over/{n}", suspect, formula, scale, arrays))
    return {"name": suspect.place.name, "words": suspect.words, "what": noun(suspect), "unit": display_unit,
            "nodes": [n.name for n in suspect.place.nodes], "components": list(suspect.place.components),
            "explained": suspect.explained, "behind": suspect.behind, "alike": list(suspect.alike),
            "records": list(suspect.implied), "over": over}


def _over(name: str, suspect: PlaceEstimate, formula: str, scale: float, arrays: Arrays) -> Entry:
    """The estimated input at a place over one variable: its samples, and the curve through them if that form is the best."""
    curve = suspect.curve
    assert curve is not None
    x = np.concatenate([i.local[formula] for i in suspect.implied.values()])
    y = np.concatenate([i.value for i in suspect.implied.values()]) * scale
    up = np.concatenate([np.gradient(i.local[formula]) > 0 for i in suspect.implied.values()])
    unit = curve.units.get(formula, "")
    across = readable_unit(unit, float(np.max(np.abs(x)))) if unit else unit
    per = read_unit(unit).scale / read_unit(across).scale if unit else 1.0
    arrays[name] = np.vstack([x * per, y, up.astype(float)])
    best = formula == curve.variable.formula
    if best and not curve.times:
        down = curve.y_down if curve.y_down.size else curve.y
        arrays[f"{name}/curve"] = np.vstack([curve.x * per, curve.y * scale, down * scale])
    return {"key": name, "formula": formula, "unit": across, "r2": curve.r2 if best else curve.scores[formula],
            "curve": best and not curve.times, "loop": bool(curve.y_down.size)}


# -- diagnose and try ----------------------------------------------------------------------------------------------------
def diagnosed(path: Path, options: Mapping[str, Any], job: Teller) -> Done:
    """As `heavebond diagnose`; the diagrams and experiments of the selected effects can be written."""
    experiment = load_experiment(path)
    diagnosis = diagnose(experiment, steps=int(options.get("steps", 5)), seconds=float(options.get("seconds", 600)),
                         classes=[str(c) for c in options.get("classes", ())], progress=job.progress,
                         growing=lambda models: job.tell("ladder", models))
    adds = [{"label": f"{f.candidate.kind} {f.candidate.place}", "count": k} for k, f in enumerate(diagnosis.added, 1)]
    chosen = {f.candidate.label for f in diagnosis.added}
    alternatives = [{"label": f"{e['effect']} {e.candidate.place}", "kind": e.candidate.kind, "component": e["effect"],
                     "where": list(e.candidate.where), "chi2": e["chi2_held_out"]} for step in diagnosis.steps[:1]
                    for e in entries(step) if e.trial is not None and e.candidate.label not in chosen][:ALTERNATIVES]

    def write(request: Mapping[str, Any]) -> list[Path]:
        folder = _folder(path, options)
        if request.get("report"):
            return [_write_report(diagnosis, folder)]
        return _write_added(experiment, diagnosis.added[:int(request.get("count", len(diagnosis.added)))], folder)

    return _result("diagnose", diagnosis_items(diagnosis), diagnosis.as_dict(), diagnosis.partial, adds=adds,
                   others=alternatives, ladder=[rung_entry(r.as_dict()) for r in diagnosis.ladder],
                   verdict=diagnosis.verdict, pictures=_law_pictures(diagnosis)), {}, write


def _law_pictures(diagnosis: Diagnosis) -> list[Entry]:
    """The pictures of the chosen laws over their variables."""
    from heavebond.reports.report_where import law_picture

    entries: list[Entry] = []
    for finding in diagnosis.added:
        svg = law_picture(diagnosis.localization, finding) if diagnosis.localization is not None else ""
        title = f"{finding.candidate.component} {finding.candidate.place}"
        words = f"{title}: what the records ask for at this place (blue while the variable rises, orange while it falls; " \
            "dashed: a curve through it), and the fitted law (black)."
        entries += [{"title": title, "svg": svg, "words": words}] if svg else []
    return entries


def _write_report(diagnosis: Diagnosis, folder: Path) -> Path:
    """Write the report of `heavebond diagnose` without its other files."""
    from heavebond.reports.report import report

    target = Targets.beside(diagnosis.experiment, folder).report
    write_text(target, report(diagnosis, diagnosis.localization))
    return target


def tried(path: Path, options: Mapping[str, Any], job: Teller) -> Done:
    """As `heavebond try`: add one effect by hand."""
    experiment = load_experiment(path)
    attempted = attempt(experiment, str(options["component"]), [str(p) for p in options.get("where", ())],
                        progress=job.progress)
    label = f"{attempted.finding.candidate.kind} {attempted.finding.candidate.place}"
    return _result("try", attempt_items(attempted), attempted.as_dict(), False, adds=[{"label": label, "count": 1}],
                   ladder=[rung_entry(r.as_dict())
                           for r in attempted.ladder]), {}, lambda request: [] if request.get("lost") \
        else _write_added(experiment, [attempted.finding], _folder(path, options))


def rung_entry(rung: Mapping[str, object]) -> Entry:
    """A row of the table of models, with null for unknown values."""
    return {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in rung.items()}


def _write_added(experiment: Experiment, findings: Sequence[AddedEffect], folder: Path) -> list[Path]:
    """Write the files of the effects; returns each experiment, the last one last."""
    return write_findings(experiment, findings, Targets.beside(experiment, folder)) if findings else []


# -- tune ----------------------------------------------------------------------------------------------------------------
def tuned(path: Path, options: Mapping[str, Any], job: Teller) -> Done:
    """As `heavebond tune`; the diagram with the tuned values can be written."""
    from heavebond.numerics.dae import assemble
    from heavebond.optimise.objective import Objective
    from heavebond.optimise.robustness import robustness
    from heavebond.optimise.tuning import tune, tuned_diagram
    from heavebond.reports.study_tables import tuning_figures, tuning_items
    from heavebond.studies.tuning_request import tuning_request, with_free

    tuning = tuning_request(str(path), str(options["cost"]) if options.get("cost") else None,
                            [str(t) for t in options.get("limits", ())], options.get("evaluate") or None, {})
    assembly = assemble(tuning.model)
    task = with_free(assembly, tuning.task, [str(t) for t in options.get("free", ())])
    objective = Objective(assembly, task)
    result = tune(objective, task, progress=job.progress, partial=True)
    early = result.message == ENDED_EARLY
    robust = None if early else robustness(objective, result, progress=job.progress)
    items = [*tuning_items(tuning.name, assembly, result, robust),
             *([Line("ended early: these are the best values so far", True)] if early else [])]

    def write_tuned(request: Mapping[str, Any]) -> list[Path]:
        if request.get("lost"):
            return []
        target = free_path(_folder(path, options) / f"{tuning.model.path.stem}_tuned.yaml")
        write(target, tuned_diagram(tuning.model, task, result, target, {}))
        return [target]

    return _result("tune", items, tuning_figures(tuning.name, result, robust), early,
                   adds=[{"label": "the tuned values"}]), {}, write_tuned


# -- study ---------------------------------------------------------------------------------------------------------------
def studied(path: Path, options: Mapping[str, Any], job: Teller) -> Done:
    """As `heavebond study`, which writes its cases, tables and pictures to a folder of its name."""
    from heavebond.reports.study_tables import study_items, write_study
    from heavebond.studies.campaign import study as run_study
    from heavebond.studies.study import load_study
    from heavebond.studies.tables import as_dict

    folder = _folder(path, options) / path.stem
    result = run_study(load_study(path), folder=folder, progress=job.progress)
    clear_signal()  # a stop has ended the cases; the completed ones are reported
    files = write_study(result, folder)
    pictures = {p.stem: p.read_text(encoding="utf-8") for p in files if p.suffix == ".svg"}
    titles = {file_stem(p.name): p.title or p.name for p in result.study.pictures}
    items = [*study_items(result), *([] if result.complete else [Line(
        f"stopped with {len(result.outcomes)} of {result.jobs} cases done; run it again to continue", True)])]
    return _result("study", items, as_dict(result), False, folder=folder.name, files=[p.name for p in files],
                   pictures=[{"title": titles.get(k, k), "svg": svg} for k, svg in pictures.items()]), {}, None


# -- any command ---------------------------------------------------------------------------------------------------------
def commanded(path: Path, options: Mapping[str, Any], job: Teller) -> Done:
    """Run a command of the command line on the document."""
    job.progress(f"heavebond {options.get('command', '')}")
    return {"items": [], "figures": {}, "partial": False, **run_command(path, options, _folder(path, options))}, {}, None


TASKS: dict[str, Callable[[Path, Mapping[str, Any], Teller], Done]] = {
    "fit": fitted, "where": localized, "diagnose": diagnosed, "try": tried, "tune": tuned, "study": studied,
    "command": commanded}
