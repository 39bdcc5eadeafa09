"""`heavebond check`: check a diagram, a component, an experiment or a study without running it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from heavebond.commands.arguments import blamed_on_settings, json_option, set_option, with_settings
from heavebond.core.errors import HeavebondError, Problem, UsageError

if TYPE_CHECKING:
    from heavebond.numerics.dae import Assembly
    from heavebond.numerics.initialise import Start
    from heavebond.numerics.start_equations import Point


@click.command(short_help="Check a diagram, component, function, experiment or study file.")
@click.argument("model", metavar="FILE")
@click.option("--names", "listed", is_flag=True, help="List every variable and parameter by its name.")
@set_option
@json_option
def check(model: str, listed: bool, settings: tuple[str, ...]) -> dict[str, object]:
    """Check FILE and show what it contains, or all problems in it.

    FILE is a YAML file or a bundled name (cmc_ahc, cmc_ahc/passive). Its first key selects the checks. Diagram: states,
    algebraic loops, index, initial conditions, and whether user-defined components in it create power. Component: units,
    equations and power. Function: names and units. Experiment: the records, their columns, times and units, and that the
    diagram has the inputs, outputs and free parameters. Study: that every case assembles and every quantity exists.
    """
    from heavebond.language.model import find
    from heavebond.text.yaml_source import read

    path = find(model)
    kind = next(iter(read(path).root.items), "")
    checks = {"component": _check_component, "function": _check_function, "experiment": _check_experiment,
              "study": _check_study}
    if kind in checks and (listed or settings):
        option = "--names" if listed else "--set"
        raise UsageError([Problem("option-unsuited", f"{option} is for diagrams; {model} is a file of the kind `{kind}:`",
                                  None, f"Leave {option} out, or check the diagram itself.")])
    return checks[kind](path) if kind in checks else _check_diagram(model, listed, settings)


def _check_diagram(model: str, listed: bool, settings: tuple[str, ...]) -> dict[str, object]:
    """Structure, initial conditions and power of a diagram."""
    from heavebond.commands.steady_start import warn_of_growing
    from heavebond.commands.terminal import output, working
    from heavebond.core.errors import StartError
    from heavebond.language.model import load
    from heavebond.numerics.dae import assemble, at_zero
    from heavebond.numerics.run_verdict import report_verdict
    from heavebond.numerics.validity import at_point
    from heavebond.reports.summary import summary

    with blamed_on_settings(settings):
        with working("assembling"):
            assembly = at_zero(assemble(with_settings(load(model), settings)))
        failure, begun, first = None, None, None
        try:
            begun, first = _start(assembly)
        except StartError as error:  # print the structure also if the diagram cannot start
            failure = error
        entries = summary(assembly, begun)
        console = output()
        for line in entries.text(console.width).splitlines():
            console.print(line, style="bold" if line[:1].strip() else None, soft_wrap=True)
        if listed:
            console.print()
            console.print(_names(assembly))
        if failure:
            console.print()
            raise failure
        powers = _check_powers(assembly)
        if first is not None:
            report_verdict(assembly.model.name, at_point(assembly, first))
    growing = warn_of_growing(assembly, first) if first is not None and assembly.model.initial.mode == "steady" else []
    return {**entries.as_dict(), "power": [problem.as_dict() for problem in powers], "growing": growing}


def _check_powers(assembly: Assembly) -> list[Problem]:
    """Print undeclared sources and losses of power in user-defined components; ModelError if one creates power."""
    from heavebond.commands.terminal import output, working
    from heavebond.core.errors import ModelError
    from heavebond.language.power_terms import CREATED, power_problems, used

    model = assembly.model
    with working("checking the power of components"):
        power_issues = list(power_problems(used(model.library, [model.body]), model.library.domains))
    created = [problem for problem in power_issues if problem.code == CREATED]
    for problem in power_issues:
        if problem not in created:
            output().print(str(problem), style="yellow", soft_wrap=True, markup=False, highlight=False)
    if created:
        raise ModelError(created)
    return power_issues


def _check_experiment(path: Path) -> dict[str, object]:
    """Read each record and assemble its diagram; nothing is simulated."""
    from heavebond.commands.terminal import output, table, working
    from heavebond.core.errors import ModelError, Problems
    from heavebond.core.presentation import number, readable_difference
    from heavebond.estimation.channel_noise import with_channel_noise
    from heavebond.estimation.comparison import assemble_for
    from heavebond.estimation.experiment import load_experiment
    from heavebond.estimation.records import Measured, measure
    from heavebond.estimation.residuals import columns_of, starts_outside

    experiment, problems, measured_records = load_experiment(path), Problems(), dict[str, Measured]()
    with working("reading the records"):
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
    console = output()
    console.print(table(f"Experiment {experiment.name}", ("record", "use", "time", "channel", "samples", "noise", ""), rows,
                        text=4))
    for name, measured in measured_records.items():
        for note in measured.notes:
            console.print(f"{name}: {note}", soft_wrap=True)
    free = ", ".join(experiment.free)
    console.print(f"free: {free}" if free else "no free parameters", soft_wrap=True)
    return {"experiment": experiment.name, "free": list(experiment.free), "records": figures}


def _check_study(path: Path) -> dict[str, object]:
    """Assemble every level of every axis and check each quantity and its unit; nothing is run."""
    from heavebond.commands.terminal import output, working
    from heavebond.core.presentation import count
    from heavebond.studies.run_case import checked
    from heavebond.studies.study import load_study

    study = load_study(path)
    with working("assembling"):
        units = checked(study)
    console = output()
    console.print(f"Study {study.name}", style="bold", soft_wrap=True)
    cases = study.cases
    lines = [("cases", f"{len(cases)}: " + " x ".join(f"{axis.name} ({len(axis.levels)})" for axis in study.axes)
              if study.axes else "1"),
             ("tunes", ", ".join(study.task.free) + f" by {', '.join(p.name for p in study.procedures)}"
              if study.task is not None else "nothing"),
             ("measures", ", ".join(f"{name} [{unit.text}]" for name, unit in units.items()) or "nothing"),
             ("draws", count(len(study.pictures), "picture"))]
    for name, text in lines:
        console.print(f"  {name:<9} {text}", soft_wrap=True, markup=False, highlight=False)
    return {"study": study.name, "cases": len(cases), "units": {name: unit.text for name, unit in units.items()}}


def _check_component(path: Path) -> dict[str, object]:
    """Check units, balance and power of a component; ModelError with the mistakes."""
    from heavebond.commands.terminal import output, working
    from heavebond.core.errors import ModelError
    from heavebond.language.component_file import parse_component
    from heavebond.language.laws import check as check_laws
    from heavebond.language.library import library
    from heavebond.language.power_law import check_power
    from heavebond.language.power_terms import power_problems, used
    from heavebond.text.expression import calling
    from heavebond.text.yaml_source import read

    known = library([path.parent, path.parent.parent])
    with calling(known.functions):
        component = parse_component(read(path), known.domains, known.base(path))
    if not component.composite:
        check_laws(component, known.domains)
    console = output()
    with working("checking its power"):
        report = check_power(component, known.domains)
        power_issues = list(power_problems([component, *used(known, [component.body])], known.domains))
    console.print(f"Component {component.name}", style="bold")
    console.print("  units and equations agree" if not component.composite else "  a block: its parts are checked with it",
                  soft_wrap=True)
    if report.holds and (component.ports or component.signals):
        console.print(f"  {report.verdict.partition(': ')[2]}", soft_wrap=True)
    if power_issues:
        raise ModelError(power_issues)
    return {"component": component.name, "power": {"tried": report.tried, "exempt": report.exempt,
                                                   "imbalance": report.imbalance, "problems": []}}


def _check_function(path: Path) -> dict[str, object]:
    """Check names and units of a function and of the functions that it calls."""
    from heavebond.commands.terminal import output
    from heavebond.language.function_file import parse_function
    from heavebond.language.library import library
    from heavebond.text.expression import calling
    from heavebond.text.yaml_source import read

    with calling(library([path.parent, path.parent.parent]).functions):
        function = parse_function(read(path))
    console = output()
    console.print(f"Function {function.name}", style="bold")
    console.print("  names and units agree", soft_wrap=True)
    console.print(f"  called as {function.usage}", soft_wrap=True, markup=False, highlight=False)
    return {"function": function.name, "usage": function.usage,
            "inputs": {q.name: q.unit.text for q in function.inputs.values()},
            "outputs": {q.name: q.unit.text for q in function.outputs.values()}}


def _names(assembly: Assembly) -> object:
    """Variables, then parameters with their values: the names for formulas, --plot and --set."""
    from heavebond.commands.terminal import table
    from heavebond.core.presentation import readable

    flat = assembly.flat
    rows = [(name, flat.unknowns[j].unit.text, "", flat.unknowns[j].doc) for name, j in flat.names.items()]
    rows += [(h.name, h.unit.text, "", h.doc) for h in flat.held]
    rows += [(q.name, q.unit.text, readable(q.value, q.unit.text), "") for q in flat.parameters]
    return table("Names", ("name", "unit", "value", "what"), rows, text=4)


def _start(assembly: Assembly) -> tuple[Start, Point]:
    """The start, as `Start` and as a point with the inputs at this time."""
    import numpy as np

    from heavebond.linear.linearisation import start_point
    from heavebond.numerics.initialise import start
    from heavebond.numerics.inputs import pieced
    from heavebond.numerics.output_times import grid

    if not assembly.flat.inputs:
        begun = start(assembly)
        return begun, start_point(begun, np.zeros(assembly.arguments[4].numel()))
    # a record must cover the whole run: report it here and not only in `run`
    times = grid(assembly.model, None, None)
    u = pieced(assembly.flat, float(times[0]), float(times[-1])).at(times[:1])[:, 0]
    begun = start(assembly, None, u)
    return begun, start_point(begun, u)
