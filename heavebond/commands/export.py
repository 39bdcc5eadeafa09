"""`heavebond export`: a diagram for other programs, as an FMU or as C."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from heavebond.commands.arguments import blamed_on_settings, check_writable, json_option, set_option, with_settings

if TYPE_CHECKING:
    from heavebond.exchange.portable import Portable, Quantity

SUFFIXES = (".fmu", ".c")


@click.command(short_help="Write a diagram as an FMU or as C for other programs.")
@click.argument("model")
@click.option("-o", "--output", metavar="FILE", required=True, type=click.Path(path_type=Path),
              help="model.fmu (needs a C compiler) or model.c.")
@click.option("--fmi", "version", type=click.Choice(["2", "3"]), default="3", show_default=True,
              help="The standard of an FMU, which is for model exchange and for co-simulation.")
@click.option("--input", "inputs", metavar="SIGNAL", multiple=True,
              help="Make a signal input of the diagram an input of the exported model, e.g. --input deck.u. May be "
                   "repeated.")
@set_option
@json_option
def export(model: str, output: Path, version: str, inputs: tuple[str, ...], settings: tuple[str, ...]) -> dict[str, object]:
    """Write the diagram MODEL as an FMU or as C: its states, parameters, inputs, and the outputs under `show:`.

    Initial conditions are those of the diagram. Measured inputs and those named by --input become inputs.
    """
    from heavebond.commands import terminal
    from heavebond.exchange.c_code import export_c
    from heavebond.exchange.fmu_export import export_fmu
    from heavebond.language.model import load

    check_writable(output, SUFFIXES)
    with blamed_on_settings(settings), terminal.working("writing"):
        diagram = with_settings(load(model), settings)
        exported = export_fmu(diagram, output, inputs, int(version)) if output.suffix.lower() == ".fmu" \
            else export_c(diagram, output, inputs)
    console = terminal.output()
    tunable = [q for q, is_tunable in zip(exported.parameters, exported.tunable, strict=True) if is_tunable]
    groups = {"inputs": exported.inputs, "outputs": exported.outputs, "states": exported.states,
              "algebraic unknowns": exported.algebraic,
              "parameters": tunable}
    console.print(terminal.table(exported.name, ("", "name", "unit", "start"), [
        (title, q.name, q.unit.text, f"{q.start:.6g}") for title in ("inputs", "outputs") for q in groups[title]], text=3))
    console.print(", ".join(f"{len(members)} {name}" for name, members in groups.items() if members), soft_wrap=True)
    for note in _notes(exported, output.suffix.lower() == ".fmu"):
        console.print(note, soft_wrap=True)
    console.print(f"wrote {output}", soft_wrap=True)
    return {"model": exported.name, "file": str(output),
            **{name.replace(" ", "_"): _listed(g) for name, g in groups.items()}}


def _notes(exported: Portable, fmu: bool) -> list[str]:
    """Limits of the export for an importing program: delays and the longest step."""
    from heavebond.core.errors import listing
    from heavebond.numerics.output_times import largest_step_of

    notes = []
    if exported.delays and fmu:
        names = listing([d.name for d in exported.delays], 3)
        notes.append(f"{names}: the history of delayed variables is kept in co-simulation only. The FMU is not for "
                     "model exchange; approximate the delays for that (for a Delay `m: 3`)")
    if fmu and not exported.delays and (longest := largest_step_of(exported.assembly.model)):
        notes.append(f"co-simulation makes no step longer than {longest:g} s (`largest_step`); in model exchange set this "
                     "limit in the importing program")
    return notes


def _listed(quantities: Sequence[Quantity]) -> list[dict[str, object]]:
    return [{"name": q.name, "unit": q.unit.text, "start": q.start} for q in quantities]
