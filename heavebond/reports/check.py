"""`check`: what a diagram, a component, a function, an experiment or a study contains, without running it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from heavebond.core.errors import HeavebondError, ModelError, Problem, Problems, StartError, UsageError
from heavebond.core.presentation import count, number, readable, readable_difference
from heavebond.estimation.channel_noise import with_channel_noise
from heavebond.estimation.comparison import assemble_for
from heavebond.estimation.experiment import load_experiment
from heavebond.estimation.records import Measured, measure
from heavebond.estimation.residuals import columns_of, starts_outside
from heavebond.language.component_file import parse_component
from heavebond.language.function_file import parse_function
from heavebond.language.laws import check as check_laws
from heavebond.language.library import library
from heavebond.language.model import ModelOrFile, find, loaded
from heavebond.language.power_law import check_power
from heavebond.language.power_terms import CREATED, power_problems, used
from heavebond.linear.linearisation import start_point
from heavebond.linear.modes import growing_modes
from heavebond.numerics.dae import Assembly, assemble, at_zero
from heavebond.numerics.initialise import Start, start
from heavebond.numerics.inputs import pieced
from heavebond.numerics.output_times import grid
from heavebond.numerics.run_verdict import report_verdict
from heavebond.numerics.start_equations import Point
from heavebond.numerics.validity import at_point
from heavebond.reports.summary import summary
from heavebond.reports.text_page import WIDTH, Lines, TextPage
from heavebond.studies.run_case import checked
from heavebond.studies.study import load_study
from heavebond.text.expression import calling
from heavebond.text.yaml_source import read


def check(model: ModelOrFile, *, names: bool = False, parameters: Mapping[str, float | str] | None = None) -> TextPage:
    """Check a diagram, or the file of a component, a function, an experiment or a study, and show what it contains.

    `model` is a diagram, or the path or bundled name of a file; its first key selects the checks. Diagram, with
    `parameters` by name: states, algebraic loops, index, initial conditions, and whether user-defined components create
    power; with `names` every variable and parameter is listed. Component: units, equations and power. Function: names and
    units. Experiment: the records, their columns, times and units. Study: every case and quantity. `print(page)` shows the
    text, `page.as_dict()` the content. Raises ModelError with all problems, StartError if a diagram cannot start, UsageError
    for a missing file.
    """
    page = check_page(model, names, parameters or {}, WIDTH)
    if page.problems:
        raise StartError(page.problems)
    return page


def check_page(model: ModelOrFile, names: bool, parameters: Mapping[str, float | str], width: int) -> TextPage:
    """The page of `check`, in lines of `width` characters; its `problems` are those of a diagram that cannot start."""
    lines = Lines(width)
    if isinstance(model, (str, Path)):
        path = find(model)
        kind = next(iter(read(path).root.items), "")
        checks = {"component": _check_component, "function": _check_function, "experiment": _check_experiment,
                  "study": _check_study}
        if kind in checks and (names or parameters):
            option = "--names" if names else "--set"
            raise UsageError([Problem("option-unsuited", f"{option} is for diagrams; {model} is a file of the kind "
                                      f"`{kind}:`", None, f"Leave {option} out, or check the diagram itself.")])
        if kind in checks:
            return lines.page(path.stem, checks[kind](path, lines))
    return _check_diagram(model, names, parameters, lines)


def _check_diagram(model: ModelOrFile, names: bool, parameters: Mapping[str, float | str], lines: Lines) -> TextPage:
    """Structure, initial conditions and power of a diagram."""
    diagram = loaded(model)
    assembly = at_zero(assemble(diagram.with_parameters(parameters) if parameters else diagram))
    failure, begun, first = None, None, None
    try:
        begun, first = _start(assembly)
    except StartError as error:  # show the structure also if the diagram cannot start
        failure = error
    entries = summary(assembly, begun)
    for line in entries.text(lines.width).splitlines():
        lines.add(line, style="bold" if line[:1].strip() else "")
    if names:
        lines.add("")
        # variables, then parameters with their values: the names for formulas, --plot and --set
        flat = assembly.flat
        name_rows = [(name, flat.unknowns[j].unit.text, "", flat.unknowns[j].doc) for name, j in flat.names.items()]
        name_rows += [(h.name, h.unit.text, "", h.doc) for h in flat.held]
        name_rows += [(q.name, q.unit.text, readable(q.value, q.unit.text), "") for q in flat.parameters]
        lines.table("Names", ("name", "unit", "value", "what"), name_rows, 4)
    if failure:
        lines.add("")
        return lines.page(assembly.model.name, entries.as_dict(), failure.problems)
    # add undeclared sources and losses of power in user-defined components; ModelError if one creates power
    checked_model = assembly.model
    powers = list(power_problems(used(checked_model.library, [checked_model.body]), checked_model.library.domains))
    created = [problem for problem in powers if problem.code == CREATED]
    for problem in powers:
        if problem not in created:
            lines.add(str(problem), style="yellow")
    if created:
        raise ModelError(created)
    growing: list[dict[str, object]] = []
    if first is not None:
        report_verdict(assembly.model.name, at_point(assembly, first))
        growing, words = growing_modes(assembly, first) if assembly.model.initial.mode == "steady" else ([], "")
        if words:
            lines.add(words, style="warning")
    return lines.page(assembly.model.name, {**entries.as_dict(), "power": [problem.as_dict() for problem in powers],
                                            "growing": growing})


def _check_experiment(path: Path, lines: Lines) -> dict[str, object]:
    """Read each record and assemble its diagram; nothing is simulated."""
    experiment, problems, measured_records = load_experiment(path), Problems(), dict[str, Measured]()
    experiment = with_channel_noise(experiment)
    for name, record in experiment.records.items():
        try:
            problems.extend(UsageError(starts_outside(columns_of(experiment, {name: assemble_for(experiment, record)}))))
            measured_records[name] = measure(experiment, record)
        except HeavebondError as error:
            problems.extend(error)
    problems.raise_as(ModelError)
    rows, figures = [], {}
    for name, measured in measured_records.items():
        use, span = measured.record.use, f"{number(measured.grid[0], 5)} .. {number(measured.grid[-1], 5)} s"
        channels = {}
        for channel, c in measured.channels.items():
            unit = c.output.shown.unit
            rows.append((name, use, span, channel, f"{len(c.time)}", readable_difference(c.noise, unit, 3),
                         "given" if c.estimate is None else f"estimated, +- {number(100 * c.estimate.error, 2)} %"
                         if c.estimate.separable else "estimated, not separable from the signal"))
            channels[channel] = {"unit": unit, "samples": len(c.time), "noise": c.noise, "noise_given": c.noise_given}
            if c.estimate is not None:
                channels[channel] |= {"noise_error": c.estimate.error * c.noise, "noise_separable": c.estimate.separable}
        figures[name] = {"use": use, "file": str(measured.record.file), "begin": float(measured.grid[0]),
                         "end": float(measured.grid[-1]), "channels": channels, "notes": list(measured.notes)}
    lines.table(f"Experiment {experiment.name}", ("record", "use", "time", "channel", "samples", "noise", ""), rows, 4)
    for name, measured in measured_records.items():
        for note in measured.notes:
            lines.add(f"{name}: {note}")
    free = ", ".join(experiment.free)
    lines.add(f"free: {free}" if free else "no free parameters")
    return {"experiment": experiment.name, "free": list(experiment.free), "records": figures}


def _check_study(path: Path, lines: Lines) -> dict[str, object]:
    """Assemble every level of every axis and check each quantity and its unit; nothing is run."""
    study = load_study(path)
    units = checked(study)
    lines.add(f"Study {study.name}", style="bold")
    cases = study.cases
    entries = [("cases", f"{len(cases)}: " + " x ".join(f"{axis.name} ({len(axis.levels)})" for axis in study.axes)
                if study.axes else "1"),
               ("tunes", ", ".join(study.task.free) + f" by {', '.join(p.name for p in study.procedures)}"
                if study.task is not None else "nothing"),
               ("measures", ", ".join(f"{name} [{unit.text}]" for name, unit in units.items()) or "nothing"),
               ("draws", count(len(study.pictures), "picture"))]
    for name, text in entries:
        lines.add(f"  {name:<9} {text}")
    return {"study": study.name, "cases": len(cases), "units": {name: unit.text for name, unit in units.items()}}


def _check_component(path: Path, lines: Lines) -> dict[str, object]:
    """Check units, balance and power of a component; ModelError with the mistakes."""
    known = library([path.parent, path.parent.parent])
    with calling(known.functions):
        component = parse_component(read(path), known.domains, known.base(path))
    if not component.composite:
        check_laws(component, known.domains)
    report = check_power(component, known.domains)
    power_issues = list(power_problems([component, *used(known, [component.body])], known.domains))
    lines.add(f"Component {component.name}", style="bold")
    lines.add("  units and equations agree" if not component.composite else "  a block: its parts are checked with it")
    if report.holds and (component.ports or component.signals):
        lines.add(f"  {report.verdict.partition(': ')[2]}")
    if power_issues:
        raise ModelError(power_issues)
    return {"component": component.name, "power": {"tried": report.tried, "exempt": report.exempt,
                                                   "imbalance": report.imbalance, "problems": []}}


def _check_function(path: Path, lines: Lines) -> dict[str, object]:
    """Check names and units of a function and of the functions that it calls."""
    with calling(library([path.parent, path.parent.parent]).functions):
        function = parse_function(read(path))
    lines.add(f"Function {function.name}", style="bold")
    lines.add("  names and units agree")
    lines.add(f"  called as {function.usage}")
    return {"function": function.name, "usage": function.usage,
            "inputs": {q.name: q.unit.text for q in function.inputs.values()},
            "outputs": {q.name: q.unit.text for q in function.outputs.values()}}


def _start(assembly: Assembly) -> tuple[Start, Point]:
    """The start, as `Start` and as a point with the inputs at this time."""

    if not assembly.flat.inputs:
        begun = start(assembly)
        return begun, start_point(begun, np.zeros(assembly.arguments[4].numel()))
    # a record must cover the whole run: report it here and not only in `run`
    times = grid(assembly.model, None, None)
    u = pieced(assembly.flat, float(times[0]), float(times[-1])).at(times[:1])[:, 0]
    begun = start(assembly, None, u)
    return begun, start_point(begun, u)
