"""`heavebond check`: check a diagram, a component, an experiment or a study without running it."""

from __future__ import annotations

import click

from heavebond.commands.arguments import blamed_on_settings, json_option, native_option, set_option, settings_of


@click.command(short_help="Check a diagram, component, function, experiment or study file.")
@click.argument("model", metavar="FILE")
@click.option("--names", "listed", is_flag=True, help="List every variable and parameter by its name.")
@set_option
@native_option
@json_option
def check(model: str, listed: bool, settings: tuple[str, ...]) -> dict[str, object]:
    """Check FILE and show what it contains, or all problems in it.

    FILE is a YAML file or a bundled name (cmc_ahc, cmc_ahc/passive). Its first key selects the checks. Diagram: states,
    algebraic loops, index, initial conditions, and whether user-defined components in it create power. Component: units,
    equations and power. Function: names and units. Experiment: the records, their columns, times and units, and that the
    diagram has the inputs, outputs and free parameters. Study: that every case assembles and every quantity exists.
    """
    from heavebond.commands import terminal
    from heavebond.reports.check import check_page

    with blamed_on_settings(settings), terminal.working("checking"):
        page = check_page(model, listed, settings_of("--set", settings), terminal.output().width)
    terminal.show_page(page)
    return page.as_dict()
