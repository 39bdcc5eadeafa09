"""`heavebond export`: a diagram as an FMU, C or Modelica for other programs; the JSON Schema of the language for editors."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from heavebond.commands.arguments import (
    blamed_on_settings,
    check_writable,
    json_option,
    native_option,
    set_option,
    with_settings,
)
from heavebond.core.errors import Problem, UsageError
from heavebond.core.writable import write_text

if TYPE_CHECKING:
    from heavebond.exchange.portable import Portable, Quantity

SUFFIXES = (".fmu", ".c", ".mo")
SCHEMA = "heavebond.schema.json"


@click.command(short_help="Write a diagram as an FMU, C or Modelica, or a JSON schema for an editor.")
@click.argument("model", required=False)
@click.option("-o", "--output", metavar="FILE", type=click.Path(path_type=Path),
              help="model.fmu (needs a C compiler), model.c or model.mo (Modelica); with --schema a .json file.")
@click.option("--schema", "for_editor", is_flag=True,
              help="Write a JSON schema for completion and checks in an editor; MODEL is then the folder of your diagrams, "
                   "by default the current one.")
@click.option("--fmi", "version", type=click.Choice(["2", "3"]), default="3", show_default=True,
              help="The standard of an FMU, which is for model exchange and for co-simulation.")
@click.option("--cross", is_flag=True,
              help="Put binaries for Windows, macOS and Linux (x86-64 and arm64) into the FMU; needs `pip install "
                   "'heavebond[cross]'`.")
@click.option("--local", "local_variables", metavar="VARIABLE", multiple=True,
              help="Add a variable of the diagram to an FMU as a local variable, e.g. --local spring.F. May be repeated.")
@click.option("--step", metavar="TIME",
              help="Write model.c as a program with this fixed step for real time, e.g. --step '1 ms', with a header and a "
                   "runner.")
@click.option("--solver", metavar="NAME",
              help="With --step: euler, rk4, backward-euler (one iteration) or rosenbrock (the default).")
@click.option("--input", "inputs", metavar="SIGNAL", multiple=True,
              help="Make a signal input of the diagram an input of the exported model, e.g. --input deck.u. May be "
                   "repeated.")
@set_option
@native_option
@json_option
def export(model: str | None, output: Path | None, for_editor: bool, version: str, cross: bool,
           local_variables: tuple[str, ...], step: str | None, solver: str | None, inputs: tuple[str, ...],
           settings: tuple[str, ...]) -> dict[str, object]:
    """Write the diagram MODEL as an FMU, as C or as a flat Modelica model.

    The file has its states, parameters, inputs, and the outputs under `show:`.

    Initial conditions are those of the diagram. Measured inputs and those named by --input become inputs.

    With --schema, write a JSON Schema of the files of the language, including the components in the folder, and the settings
    for Visual Studio Code. Its extension YAML (redhat.vscode-yaml) then completes while you type and underlines mistakes.
    Run this command again after you have added a component.
    """
    if for_editor:
        return _schema(Path(model or "."), output)
    if model is None or output is None:
        raise UsageError([Problem("option-missing", "no diagram is named" if model is None else "no file is named", None,
                                  "Give a diagram and a file, e.g. heavebond export cmc_ahc -o cmc_ahc.fmu.")])
    from heavebond.commands import terminal
    from heavebond.core.presentation import count
    from heavebond.exchange.export import export as export_to
    from heavebond.exchange.portable import Portable
    from heavebond.language.model import load

    check_writable(output, SUFFIXES)
    with blamed_on_settings(settings), terminal.working("writing"):
        diagram, picture = with_settings(load(model), settings), ""
        if output.suffix.lower() == ".fmu":
            from heavebond.pictures.drawing import draw

            picture = draw(diagram)
        exported = export_to(diagram, output, inputs=inputs, fmi=int(version), cross=cross, solver=solver, step=step,
                             locals=local_variables, picture=picture)
    console = terminal.output()
    tunable = [q for q, is_tunable in zip(exported.parameters, exported.tunable, strict=True) if is_tunable]
    local = exported.locals if isinstance(exported, Portable) else 0
    outputs = exported.outputs[:len(exported.outputs) - local]
    groups = {"inputs": exported.inputs, "outputs": outputs, "local variables": exported.outputs[len(outputs):],
              "states": exported.states,
              "algebraic unknowns": exported.algebraic,
              "parameters": tunable}
    console.print(terminal.table(exported.name, ("", "name", "unit", "start"), [
        (title, q.name, q.unit.text, f"{q.start:.6g}") for title in ("inputs", "outputs") for q in groups[title]], text=3))
    console.print(", ".join(count(len(members), name.removesuffix("s")) for name, members in groups.items() if members),
                  soft_wrap=True)
    if isinstance(exported, Portable):
        for note in _notes(exported, output.suffix.lower() == ".fmu"):
            console.print(note, soft_wrap=True)
    files = [output]
    if isinstance(exported, Portable) and (step is not None or solver is not None):
        from heavebond.exchange.real_time import companions, notes

        files += companions(output)
        for note in notes(exported, solver, step):
            console.print(note, soft_wrap=True)
    for path in files:
        console.print(f"wrote {path}", soft_wrap=True)
    return {"model": exported.name, "file": str(output), "files": [str(path) for path in files],
            **{name.replace(" ", "_"): _listed(g) for name, g in groups.items()}}


def _schema(folder: Path, output: Path | None) -> dict[str, object]:
    """Write the JSON Schema of the language with the components of a folder, and the settings of the editor."""
    from heavebond.commands.terminal import output as console
    from heavebond.exchange.json_schema import schema as make
    from heavebond.language.library import library

    if not folder.is_dir():
        raise UsageError([Problem("folder-missing", f"cannot find the folder '{folder}'", None,
                                  "Give an existing folder.")])
    path, files = output or folder / ".vscode" / SCHEMA, []
    if output is None:
        path.parent.mkdir(exist_ok=True)
    check_writable(path, (".json",))
    write_text(path, json.dumps(make(library([folder])), ensure_ascii=False, separators=(",", ":")) + "\n")
    files.append(path)
    settings = folder / ".vscode" / "settings.json"
    snippet = {"yaml.schemas": {_from(folder, path): "*.yaml"}}
    if path.parent == settings.parent and not settings.exists():
        write_text(settings, json.dumps(snippet, indent=2) + "\n")
        files.append(settings)
    else:
        console().print("Put this into the settings of your editor (.vscode/settings.json):", soft_wrap=True)
        console().print(json.dumps(snippet, indent=2), soft_wrap=True, highlight=False, markup=False)
    for written in files:
        console().print(f"wrote {written}", soft_wrap=True)
    console().print("Or begin a single file with the line", soft_wrap=True)
    console().print(f"# yaml-language-server: $schema={_from(folder, path)}", soft_wrap=True, highlight=False, markup=False)
    return {"files": [str(written) for written in files], "settings": snippet}


def _from(folder: Path, path: Path) -> str:
    """Path of the file from the folder that is open in the editor."""
    try:
        return path.resolve().relative_to(folder.resolve()).as_posix()
    except ValueError:
        return path.resolve().as_posix()


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
