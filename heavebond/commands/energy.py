"""`heavebond energy`: energy balance of a run, activity of its components, and a simplified diagram."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from heavebond.commands.arguments import (
    Number,
    blamed_on_settings,
    check_new,
    check_picture,
    json_option,
    native_option,
    set_option,
    with_settings,
)
from heavebond.core.errors import Problem, UsageError
from heavebond.core.writable import write_text

if TYPE_CHECKING:
    from heavebond.energy_audit.audit import EnergyAudit
    from heavebond.energy_audit.simplification import Simplified


@click.command(short_help="Audit the energy of a run; rank components by activity.")
@click.argument("model")
@click.option("--until", metavar="TIME", help="End time of the simulation, e.g. --until '2 min'.")
@click.option("--every", metavar="TIME", help="Time between output points, e.g. --every '10 ms'.")
@click.option("--audit", "audited", is_flag=True, help="End with an error that names the component whose balance is open.")
@click.option("--sankey", metavar="PICTURE", type=click.Path(path_type=Path),
              help="Draw the flow of energy between components (Sankey diagram; .png, .svg or .pdf).")
@click.option("--activity", metavar="PICTURE", type=click.Path(path_type=Path),
              help="Draw the activity of the components (.png, .svg or .pdf).")
@click.option("--close", "closed", multiple=True, metavar="BLOCK",
              help="Count a block as one component, in table and pictures, e.g. --close ahc. May be repeated.")
@click.option("--close-all", is_flag=True, help="Count every block as one component.")
@click.option("--reduce", "share", metavar="SHARE", type=Number(0, 100, min_open=True),
              help="Keep the components with this share of the activity in per cent, and neutralise the others.")
@click.option("--error", "limit", metavar="PERCENT", type=Number(0, min_open=True), default=5.0, show_default=True,
              help="With --reduce: keep components whose removal would move an output by more than this.")
@click.option("--write", "written", metavar="FILE", type=click.Path(path_type=Path),
              help="With --reduce: write the reduced diagram, which extends MODEL (.yaml).")
@set_option
@native_option
@json_option
def energy(model: str, until: str | None, every: str | None, audited: bool, sankey: Path | None, activity: Path | None,
           closed: tuple[str, ...], close_all: bool, share: float | None, limit: float, written: Path | None,
           settings: tuple[str, ...]) -> dict[str, object]:
    """Simulate the diagram MODEL, integrate the power of every component, and show the energy balance.

    `activity` is the share of a component in the integrated absolute power of all components; one with a low share has
    little influence. The power at any port is a signal as well: heavebond run MODEL --plot spring.a.power
    """
    from heavebond.commands import terminal
    from heavebond.energy_audit.audit import energy as audit
    from heavebond.energy_audit.audit import table, with_blocks
    from heavebond.language.model import load
    from heavebond.numerics.simulation import changes_of

    for path in (sankey, activity):
        check_picture(path)
    if written is not None and share is None:
        raise UsageError([Problem("write-what", "--write writes the reduced diagram, but --reduce is missing", None,
                                  "Add --reduce 98, for the components that make up 98 % of the activity.")])
    if written is not None:
        check_new(written, (".yaml",))
    with blamed_on_settings(settings), terminal.working("integrating"):
        diagram = with_settings(load(model), settings)
        energy_audit = audit(diagram, until, every=every)
    shown_audit = with_blocks(energy_audit, energy_audit.result.assembly.flat.expanded.blocks if close_all else closed)
    console = terminal.output()
    console.print(table(shown_audit))
    for line in changes_of(energy_audit.result):
        console.print(line)
    files = _pictures(shown_audit, diagram.name, sankey, activity)
    figures: dict[str, object] = {"model": diagram.name, **shown_audit.as_dict()}
    if audited:
        energy_audit.raise_if_open()
        console.print("the energy balance closes")
    if share is not None:
        from heavebond.energy_audit.simplification import simplify

        with terminal.working("trying without") as progress:
            reduced = simplify(diagram, share / 100, limit / 100, found=energy_audit, progress=progress)
        _print_reduced(reduced)
        figures["reduced"] = reduced.as_dict()
        if written is not None and reduced.removed:
            write_text(written, reduced.diagram(written))
            files.append(written)
    for path in files:
        console.print(f"wrote {path}", soft_wrap=True)
    return {**figures, "files": [str(path) for path in files]}


def _pictures(energy_audit: EnergyAudit, name: str, sankey: Path | None, activity: Path | None) -> list[Path]:
    """Write the requested pictures."""
    if sankey is None and activity is None:
        return []
    from heavebond.energy_audit.power_flow import energy_flow
    from heavebond.pictures.plot import save
    from heavebond.pictures.plot_energy import plot_activity, plot_energy_flow

    title = f"{name}: energy over {energy_audit.result.time[-1]:.6g} s"
    files = [] if sankey is None else [save(plot_energy_flow(energy_flow(energy_audit), title=title), sankey)]
    return files if activity is None else [*files, save(plot_activity(energy_audit, title=f"{name}: activity"), activity)]


def _print_reduced(reduced: Simplified) -> None:
    from heavebond.commands import terminal
    from heavebond.core.presentation import number

    console = terminal.output()
    rows = [(one.component, f"{100 * one.share:.3g} %", one.step.words if not one.kept else
             f"stays: {one.kept}") for one in reduced.tried]
    console.print(terminal.table("Little active", ("component", "activity", "replacement"), rows, text=3))
    if reduced.removed:
        console.print(terminal.table("What that moves", ("output", "rms error / rms about the mean"), [
            (name, f"{number(100 * error, 3)} %") for name, error in reduced.errors.items()], text=1))
        console.print(f"{reduced.states[0]} states before, {reduced.states[1]} after")
    else:
        console.print("no component can be neutralised within --error; a larger --error shows the outputs that would move")
