"""Import of a mesh as a body: mass, centre of mass and inertia tensor of its closed surface, as a diagram with its picture.

With the volume V, its centre c and the tensor J of its second moments about c, all in units u of the file, a body of the
density rho has the mass rho V u^3, the centre of mass c u and the inertia tensor rho J u^5.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from heavebond.core.errors import Place, Problem, UsageError, listing
from heavebond.core.quoting import file_stem
from heavebond.import_20sim.importer import Imported
from heavebond.import_20sim.names import identifier
from heavebond.import_20sim.write import quantity, scalar
from heavebond.language.view import MESHES

METRES = (".glb", ".gltf")  # glTF has the unit m; STL and OBJ have no unit, and most programs write mm
DIGITS = 12  # of the written values
SMALL = 1e-9  # share of the largest element of a tensor, below which an element is rounding


def read_mesh(file: Path, place: Place | None = None) -> Any:
    """The `trimesh.Trimesh` of a file, of glTF all meshes of its scene. `place` is the line that names the file. Raises
    UsageError if it cannot be read."""
    if file.suffix.lower() not in MESHES:
        raise UsageError([Problem("file-suffix", f"'{file.name}' is not a mesh", place,
                                  f"Give a file that ends in {listing(MESHES[:-1])} or {MESHES[-1]}.")])
    if not file.is_file():
        raise UsageError([Problem("file-missing", f"cannot find the file '{file}'", place,
                                  "The path is relative to the folder of the diagram." if place else "Check the path.")])
    try:
        import trimesh
    except ImportError:
        raise UsageError([Problem("trimesh-missing", "reading a mesh needs trimesh, which is not installed", place,
                                  "pip install 'heavebond[mesh]'" + (", or draw a box." if place else ""))]) from None
    try:
        mesh: Any = trimesh.load(file, force="mesh", process=False, skip_materials=True)
        readable = len(mesh.faces) > 0 and bool(np.isfinite(mesh.vertices).all())
    except Exception as error:  # a loader raises whatever it meets in a damaged file
        raise UsageError([Problem("mesh-unreadable", f"'{file.name}' cannot be read: {error}", place)]) from None
    if not readable:
        raise UsageError([Problem("mesh-unreadable", f"'{file.name}' contains no triangles", place)])
    return mesh


def import_mesh(path: Path, folder: Path | None = None) -> Imported:
    """Translate a mesh into a diagram of one body, to be written into a folder, by default one that is named after it.
    Raises UsageError if the mesh cannot be read or its surface is not closed."""
    mesh = read_mesh(path)
    mesh.process(validate=True)  # joins the corners of neighbouring triangles
    if not mesh.is_watertight or not mesh.is_winding_consistent or not mesh.volume:
        raise UsageError([Problem("mesh-open", f"the surface of '{path.name}' is not closed: it has no volume", None,
                                  "Close its holes in the program that wrote it, or write a SpatialBody with its mass and "
                                  "its inertia.")])
    if mesh.volume < 0:  # the triangles are seen from inside
        mesh.invert()
    imported = Imported(identifier(file_stem(path.stem)), path.stem)
    name, J, centre = imported.name, np.asarray(mesh.moment_inertia), np.asarray(mesh.center_mass)

    def written(value: float) -> str:
        return quantity(float(f"{value:.{DIGITS}g}"), "")

    moments = [f"J_{axes}: =rho*u**5*{written(J[i, j])}" if J[i, j] >= 0 else f"J_{axes}: \"=-rho*u**5*{written(-J[i, j])}\""
               for axes, i, j in (("x", 0, 0), ("y", 1, 1), ("z", 2, 2), ("xy", 0, 1), ("xz", 0, 2), ("yz", 1, 2))
               if i == j or abs(J[i, j]) > SMALL*J.max()]
    centres = [f"l_{axis}: \"=u*{written(value)}\"" for axis, value in zip("xyz", centre, strict=True)
               if abs(value) > SMALL*mesh.scale]
    unit = "1 m" if path.suffix.lower() in METRES else "1 mm"
    picture = os.path.relpath(path, folder or Path(name)).replace(os.sep, "/")
    rest = ", ".join([f"frame.{rate}_{axis}: 0 {per}" for rate, per in (("v", "m/s"), ("w", "rad/s")) for axis in "xyz"])
    imported.files[f"{name}.yaml"] = f"""model: {name}
summary: {scalar(f"A body with the shape of {path.name}, in free fall.")}
parameters:
  rho: 7850 kg/m**3  # density, of steel
  u: {unit}  # length of 1 in the file of the mesh
components:
  {name}: {{is: SpatialBody, m: =rho*u**3*{written(mesh.volume)}, {', '.join([*moments, *centres])}}}
nodes: {{frame: [{name}.a]}}
initial: {{frame.x: 0 m, frame.y: 0 m, frame.z: 0 m, {rest}}}
show: {{mass: {{is: {name}.m, unit: kg}}, height: {{is: frame.z, unit: m}}}}
view: {{{name}: {{is: mesh, at: frame, file: {scalar(picture)}, unit: 1*u}}}}
simulate: {{until: 1 s, every: 10 ms}}
"""
    return imported
