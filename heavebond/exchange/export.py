"""Export of a diagram to the format of a file's suffix."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from heavebond.core.errors import Problem, UsageError, joined
from heavebond.exchange.c_code import export_c
from heavebond.exchange.fmu_export import export_fmu
from heavebond.exchange.modelica import ModelicaExport, export_modelica
from heavebond.exchange.portable import Portable
from heavebond.exchange.real_time import export_real_time
from heavebond.language.model import ModelOrFile, loaded
from heavebond.numerics.output_times import Time

SUFFIXES = (".fmu", ".c", ".mo")


def export(model: ModelOrFile, path: str | Path, *, inputs: Iterable[str] = (), fmi: int = 3,
           parameters: Mapping[str, float | str] | None = None, cross: bool = False, solver: str | None = None,
           step: Time | None = None, locals: Iterable[str] = (), picture: str = "") -> Portable | ModelicaExport:
    """Write a diagram as an FMU (.fmu, needs a C compiler), as C (.c) or as a Modelica model (.mo) to `path`.

    `model` is a diagram, or the path or bundled name of one, `parameters` overrides its values by name. Measured inputs, and
    the signal inputs that are named in `inputs`, become inputs of the exported model; the outputs are those under `show:`.
    `fmi` is the standard of an FMU, 2 or 3, for model exchange and co-simulation; with `cross` it has binaries for Windows,
    macOS and Linux (x86-64 and arm64), `locals` are variables of the diagram that it has as local variables, and `picture`,
    such as `hb.draw(model)`, is its icon. With a fixed `step` (s or text, as `"1 ms"`) and a `solver` (euler, rk4,
    backward-euler or rosenbrock, the default), the C is a program for real time, with a header and a runner. Returns the
    exported equations with their quantities, in SI. Raises UsageError for another suffix, without a compiler, and for a step
    or a method that does not suit the diagram, ModelError for an invalid diagram or one with FMUs, and for a part that
    Modelica cannot express.
    """
    path, diagram, locals = Path(path), loaded(model), tuple(locals)
    if path.suffix.lower() not in SUFFIXES:
        raise UsageError([Problem("file-suffix", f"'{path}' does not end in {joined(SUFFIXES, 'or')}", None,
                                  f"Write for example {path.stem or 'model'}{SUFFIXES[0]}.")])
    if (step is not None or solver is not None) and path.suffix.lower() != ".c":
        option = "solver" if step is None else "step"
        raise UsageError([Problem("step-unused", f"a {option} is for programs in C; '{path}' is not one", None,
                                  f"Write {path.stem}.c, or leave out `--step` and `--solver`.")])
    if path.suffix.lower() != ".fmu":
        for option, given in (("--fmi", fmi != 3), ("--cross", cross), ("--local", bool(locals))):
            if given:
                raise UsageError([Problem("fmu-option", f"`{option}` is for FMUs; '{path}' is not one", None,
                                          f"Write {path.stem}.fmu, or leave out `{option}`.")])
    if parameters:
        diagram = diagram.with_parameters(parameters)
    try:
        if path.suffix.lower() == ".mo":
            return export_modelica(diagram, path, inputs)
        if step is not None or solver is not None:
            return export_real_time(diagram, path, inputs, solver, step)
        if path.suffix.lower() == ".c":
            return export_c(diagram, path, inputs)
        return export_fmu(diagram, path, inputs, fmi, cross=cross, locals=locals, picture=picture)
    except OSError as error:
        raise UsageError([Problem("file-unwritable", f"'{path}' cannot be written: {error.strerror or error}")]) from None
