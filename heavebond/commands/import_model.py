"""`heavebond import`: a 20-sim model, a robot or a mesh as a diagram with its components."""

from __future__ import annotations

from pathlib import Path

import click

from heavebond.commands.arguments import json_option, settings_of


@click.command("import", short_help="Translate a 20-sim model (.emx), a robot (.urdf) or a mesh into a diagram.")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("-o", "--output", metavar="FOLDER", type=click.Path(path_type=Path),
              help="Output folder; by default named after the model.")
@click.option("--function", "functions", metavar="NAME=FILE.c", multiple=True,
              help="C source in place of the function NAME of a compiled library (dll). May be repeated.")
@click.option("--globals", "global_files", metavar="FILE.emx", multiple=True, type=click.Path(path_type=Path),
              help="Another 20-sim model whose global parameters this one uses. May be repeated.")
@click.option("--library", "libraries", metavar="FILE.emx", multiple=True, type=click.Path(path_type=Path),
              help="A 20-sim model, or a folder of models, with submodels that this one only names. May be repeated.")
@click.option("--strict", is_flag=True, help="Write nothing if a submodel has no law after the translation.")
@json_option
def import_model(file: Path, output: Path | None, functions: tuple[str, ...], global_files: tuple[Path, ...],
                 libraries: tuple[Path, ...], strict: bool) -> dict[str, object]:
    """Translate the 20-sim model (.emx) or the robot (.urdf) FILE into a folder with a diagram and component files. A mesh
    (.stl, .obj, .glb, .gltf) becomes a body with the mass and the inertia of its closed surface.

    Elements that cannot be translated are listed with submodel and line; a submodel with such elements becomes a placeholder
    without a law, and the exit code is 3. Nothing in the file is executed.
    """
    from heavebond.commands import terminal
    from heavebond.core.quoting import visible
    from heavebond.imports import models

    with terminal.working("translating"):
        imported = models.import_model(file, output or "", functions=settings_of("--function", functions),
                                       global_files=global_files, libraries=libraries, strict=strict)
    written = imported.files
    console = terminal.output()
    components = f" and {len(written) - 1} components" if file.suffix.lower() == ".emx" else ""
    console.print(f"wrote {written[0]}{components}", soft_wrap=True, markup=False)
    for item in imported.untranslated:
        console.print(visible(f"not translated: {file.name}:{item.line}: {item.submodel}: {item.reason}"), soft_wrap=True,
                      markup=False)
    for path in imported.left_over:
        console.print(visible(f"no longer part of the model: {path} (from an earlier import; delete it if unused)"),
                      soft_wrap=True, markup=False)
    permission = " --allow-native" if functions else ""
    console.print(f"next: heavebond check {written[0]}{permission}", soft_wrap=True, markup=False)
    return {"model": written[0].stem, "files": [str(path) for path in written],
            "left_over": [str(path) for path in imported.left_over], "placeholders": list(imported.placeholders),
            "untranslated": [{"submodel": u.submodel, "line": u.line, "reason": u.reason} for u in imported.untranslated]}
