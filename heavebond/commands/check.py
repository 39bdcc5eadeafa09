"""`heavebond check`: read, assemble and start a diagram; say what became of it, or all that is wrong."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from heavebond.commands.arguments import blamed_on_settings, json_option, set_option, with_settings

if TYPE_CHECKING:
    from heavebond.core.errors import Problem
    from heavebond.numerics.dae import Assembly
    from heavebond.numerics.initialise import Start
    from heavebond.numerics.start_equations import Point


@click.command(short_help="Check a diagram; show its states, loops, index and initial conditions.")
@click.argument("model", metavar="FILE")
@click.option("--names", "listed", is_flag=True, help="List every variable and parameter by its name.")
@set_option
@json_option
def check(model: str, listed: bool, settings: tuple[str, ...]) -> dict[str, object]:
    """Check the diagram FILE: what it contains, its states, loops, index and initial conditions; and whether
    your own components in it create power.

    FILE is a YAML file or the name of a bundled diagram (cmc_ahc, cmc_ahc/passive). A file that begins with `component:` is
    checked as a component: its units, equations and power.
    """
    from heavebond.commands.terminal import output, working
    from heavebond.core.errors import StartError
    from heavebond.language.model import load
    from heavebond.numerics.dae import assemble
    from heavebond.numerics.run_verdict import tell
    from heavebond.numerics.validity import at_point
    from heavebond.reports.summary import summary

    path = _component_file(model)
    if path is not None:
        return _check_component(path)
    with blamed_on_settings(settings):
        with working("assembling"):
            assembly = assemble(with_settings(load(model), settings))
        failure, begun, first = None, None, None
        try:
            begun, first = _start(assembly)
        except StartError as error:  # the structure is worth seeing all the same
            failure = error
        found = summary(assembly, begun)
        console = output()
        for line in found.text(console.width).splitlines():
            console.print(line, style="bold" if line[:1].strip() else None, soft_wrap=True)
        if listed:
            console.print()
            console.print(_names(assembly))
        if failure:
            console.print()
            raise failure
        powers = _check_powers(assembly)
        if first is not None:
            tell(assembly.model.name, at_point(assembly, first))
    return {**found.as_dict(), "power": [problem.as_dict() for problem in powers]}


def _check_powers(assembly: Assembly) -> list[Problem]:
    """Print what is not declared about the powers of the user's components; ModelError where one creates power."""
    from heavebond.commands.terminal import output, working
    from heavebond.core.errors import ModelError
    from heavebond.language.power_terms import CREATED, power_problems, used

    model = assembly.model
    with working("checking the power of components"):
        found = list(power_problems(used(model.library, [model.body]), model.library.domains))
    created = [problem for problem in found if problem.code == CREATED]
    for problem in found:
        if problem not in created:
            output().print(str(problem), style="yellow", soft_wrap=True, markup=False, highlight=False)
    if created:
        raise ModelError(created)
    return found


def _component_file(name: str) -> Path | None:
    """The path of a file whose first key is `component:`."""
    from heavebond.core.errors import HeavebondError
    from heavebond.text.yaml_source import read

    path = Path(name)
    if not (path.is_file() and path.suffix in (".yaml", ".yml")):
        return None
    try:
        return path if next(iter(read(path).root.items), "") == "component" else None
    except HeavebondError:
        return None  # told when it is read as a diagram


def _check_component(path: Path) -> dict[str, object]:
    """Units, balance and power of a component; ModelError with what is wrong."""
    from heavebond.commands.terminal import output, working
    from heavebond.core.errors import ModelError
    from heavebond.language.component_file import parse_component
    from heavebond.language.laws import check as check_laws
    from heavebond.language.library import library
    from heavebond.language.power_law import check_power
    from heavebond.language.power_terms import power_problems, used
    from heavebond.text.yaml_source import read

    known = library([path.parent, path.parent.parent])
    component = parse_component(read(path), known.domains)
    if not component.composite:
        check_laws(component, known.domains)
    console = output()
    with working("checking its power"):
        report = check_power(component, known.domains)
        found = list(power_problems([component, *used(known, [component.body])], known.domains))
    console.print(f"Component {component.name}", style="bold")
    console.print("  units and equations agree" if not component.composite else "  a block: its parts are checked with it",
                  soft_wrap=True)
    if report.holds:
        console.print(f"  {report.verdict.partition(': ')[2]}", soft_wrap=True)
    if found:
        raise ModelError(found)
    return {"component": component.name, "power": {"tried": report.tried, "exempt": report.exempt,
                                                   "imbalance": report.imbalance, "problems": []}}


def _names(assembly: Assembly) -> object:
    """Variables, then parameters with their values: what formulas, --plot and --set understand."""
    from heavebond.commands.terminal import table
    from heavebond.core.presentation import readable

    flat = assembly.flat
    rows = [(name, flat.unknowns[j].unit.text, "", flat.unknowns[j].doc) for name, j in flat.names.items()]
    rows += [(h.name, h.unit.text, "", h.doc) for h in flat.held]
    rows += [(q.name, q.unit.text, readable(q.value, q.unit.text), "") for q in flat.parameters]
    return table("Names", ("name", "unit", "value", "what"), rows, text=4)


def _start(assembly: Assembly) -> tuple[Start, Point]:
    """The start, and the same as a point with the inputs there."""
    import numpy as np

    from heavebond.linear.linearisation import start_point
    from heavebond.numerics.initialise import start
    from heavebond.numerics.inputs import pieced
    from heavebond.numerics.simulator import grid

    if not assembly.flat.inputs:
        begun = start(assembly)
        return begun, start_point(begun, np.zeros(0))
    # a record must cover the whole run, which is said here and not first by `run`
    times = grid(assembly.model, None, None)
    u = pieced(assembly.flat, 0.0, float(times[-1])).at(np.zeros(1))[:, 0]
    begun = start(assembly, 0.0, u)
    return begun, start_point(begun, u)
