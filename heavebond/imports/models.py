"""Import of a model of another program, by the suffix of its file: a folder with a diagram and its components."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from heavebond.core.errors import ModelError, Place, Problem, UsageError, listing, suggest
from heavebond.core.presentation import brief, count
from heavebond.import_20sim.importer import Untranslated, import_20sim
from heavebond.imports.mesh import import_mesh
from heavebond.imports.urdf import import_urdf
from heavebond.language.library import bundled
from heavebond.language.view import MESHES

WANTED = "Name a 20-sim model (.emx), the description of a robot (.urdf) or a mesh (.stl, .obj, .glb, .gltf)."
CONVERT = {".xacro": "Expand the template first: xacro {0} -o {1}.urdf", ".sdf": "Export the robot as URDF first.",
           ".mjcf": "Export the robot as URDF first.", ".xml": "If its root element is <robot>, rename it to {1}.urdf.",
           ".slx": "Simulink models cannot be imported. An FMU exported by Simulink can be a part of a diagram.",
           ".fmu": "An FMU needs no import: write `is: {0}` in a diagram.",
           ".mo": "Modelica models cannot be imported. An FMU exported from the model can be a part of a diagram."}


@dataclass(frozen=True)
class ImportedModel:
    """The result of an import: the diagram `path`, all written `files`, the diagram first, and the constructs that are not
    translated. `left_over` are components of an earlier import that the model no longer contains; `placeholders` are the
    files of components without a law."""

    path: Path
    files: tuple[Path, ...]
    untranslated: tuple[Untranslated, ...]
    left_over: tuple[Path, ...] = ()
    placeholders: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return brief(self, str(self.path), f"{count(len(self.files) - 1, 'component')}",
                     *(f"not translated: {u.submodel}, line {u.line}: {u.reason}" for u in self.untranslated[:8]))


def import_model(file: str | Path, folder: str | Path = "", *, functions: Mapping[str, str | Path] | None = None,
                 global_files: Iterable[str | Path] = (), libraries: Iterable[str | Path] = (), strict: bool = False
                 ) -> ImportedModel:
    """Translate a 20-sim model (.emx), a robot (.urdf) or a mesh (.stl, .obj, .glb, .gltf) into a diagram.

    A mesh becomes a body with the mass and the inertia of its closed surface. A 20-sim model has component files, too.
    The files are written into a `folder`, by default one that is named after the model. `file` is the path of the model
    or of a bundled one; nothing in it is executed. Three arguments are for 20-sim models: `functions` are C sources
    that replace functions of compiled libraries, by the name of the function; `global_files` are other .emx files with
    global parameters of the model; `libraries` are .emx files, or folders of them, with implementations that the model
    does not contain. With `strict`, a submodel without a law is an error and nothing is written.
    `hb.load(imported.path)` reads the diagram.
    Raises UsageError for another kind of file, ModelError for one that cannot be read.
    """
    file, global_files, libraries = Path(file), list(global_files), list(libraries)
    suffix = file.suffix.lower()
    if suffix not in (".emx", ".urdf", *MESHES):
        raise UsageError([Problem("import-suffix", f"'{file}' is not a model that can be imported", None,
                                  CONVERT.get(suffix, WANTED).format(file.name, file.name.partition(".")[0]))])
    if not file.is_file() and (inside := bundled("models") / file).is_file():
        file = inside
    if not file.is_file():
        near = sorted(p.name for p in file.parent.glob(f"*{file.suffix}")) if file.parent.is_dir() else []
        raise UsageError([Problem("file", f"cannot find the file '{file}'", None, suggest(file.name, near) or
                                  f"Files of this kind there: {listing(near)}." if near else "Check the path.")])
    if suffix != ".emx" and (functions or global_files or libraries):
        raise UsageError([Problem("import-option", "C sources, global parameters and libraries are for 20-sim models only",
                                  None, f"Leave out --function, --globals and --library for a {suffix} file.")])
    target = Path(folder) if str(folder) else None
    if suffix == ".emx":
        imported = import_20sim(file, functions or {}, global_files, libraries)
    else:
        imported = import_urdf(file, target) if suffix == ".urdf" else import_mesh(file, target)
    placeholders = tuple(name for name, text in imported.files.items() if re.search("^placeholder:", text, re.MULTILINE))
    if strict and placeholders:
        raise ModelError([Problem("import-incomplete", f"{u.submodel}: {u.reason}", Place(file.name, u.line),
                                  "Without --strict the rest of the model is translated.")
                          for u in imported.untranslated if u.lawless])
    target = target or Path(imported.name)
    left_over, written = imported.left_over(target), imported.write(target)
    return ImportedModel(written[0], tuple(written), tuple(imported.untranslated), tuple(left_over), placeholders)
