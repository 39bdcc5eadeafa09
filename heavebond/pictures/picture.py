"""The picture of a diagram: its drawing, with the colours of a run, or its bond graph; saved as SVG, PNG or PDF."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from heavebond.core.errors import Problem, UsageError
from heavebond.core.writable import new_file
from heavebond.language.model import ModelOrFile, loaded
from heavebond.numerics.output_times import Time
from heavebond.pictures import drawing
from heavebond.pictures.bond_picture import draw_bond_graph
from heavebond.pictures.colour_map import Paint, paint

SUFFIXES = (".svg", ".png", ".pdf")
PIXELS = 2  # pixels of a PNG picture per unit of the drawing, which is one pixel on a screen


class Picture(str):
    """The text of an SVG file; a notebook displays the picture."""

    __slots__ = ()

    def save(self, path: str | Path) -> Path:
        """Write the picture as .svg, .png or .pdf and return the path; UsageError for another suffix, if the file cannot be
        written, or if CairoSVG is missing for PNG and PDF."""
        path = Path(path)
        if path.suffix.lower() not in SUFFIXES:
            raise UsageError([Problem("file-suffix", f"'{path}' does not end in {' or '.join(SUFFIXES)}", None,
                                      f"Write for example {path.stem or 'picture'}{SUFFIXES[0]}.")])
        data = converter(path)(self)
        try:
            with new_file(path) as fresh:
                fresh.write_bytes(data)
        except OSError as error:
            message = f"'{path}' cannot be written: {error.strerror or error}"
            raise UsageError([Problem("file-unwritable", message)]) from None
        return path

    def _repr_svg_(self) -> str:
        return str(self)


def draw(model: ModelOrFile, *, open: Iterable[str] = (), open_all: bool = False, values: bool = False,
         highlight: Mapping[str, str] | Iterable[str] = (), colour: Paint | str | None = None, at: Time | None = None,
         over: str = "mean", bond_graph: bool = False, parameters: Mapping[str, float | str] | None = None) -> Picture:
    """Draw a diagram: the text of an SVG file, which a notebook displays; `picture.save("rig.png")` writes it.

    `model` is a diagram, or the path or bundled name of one, with `parameters` by name. `open` names blocks (`cmc`, `ahc`)
    that are drawn with their contents, `open_all` opens them all; others are boxes. `values` writes the settings of each
    component below its name. `highlight` marks components, nodes or ports in a warning colour, each with a short label if a
    mapping is given: by path, as `cmc.gas`, `platform`, `ahc.cylinder.A`, and `node crown` if a component has the node's
    name. `colour` colours components and wires by a run: `power`, a variable such as p, v, q or F, or one with its path;
    `at` a time, else by the `over` (mean or peak) of the run. `bond_graph` draws the bond graph instead, alone.

    Raises ModelError for a diagram or a symbol that cannot be read, UsageError for names that the diagram does not have, and
    for options that a bond graph does not have.
    """
    diagram = loaded(model)
    diagram = diagram.with_parameters(parameters) if parameters else diagram
    if bond_graph and (colour or values or highlight or open):
        raise UsageError([Problem("bonds-alone", "a bond graph has no colours, values, marks or closed blocks", None,
                                  "Draw it alone, and the other options in a second picture.")])
    if at is not None and not isinstance(colour, str):
        raise UsageError([Problem("at-alone", "`at` is the time of the colours, but `colour` names no variable", None,
                                  'Add for example colour="power".')])
    if bond_graph:
        return Picture(draw_bond_graph(diagram))
    painted = paint(diagram, colour, at=at, over=over) if isinstance(colour, str) else colour
    return Picture(drawing.draw(diagram, open=open, open_all=open_all, values=values, highlight=highlight, colour=painted))


def converter(path: Path) -> Callable[[str], bytes]:
    """The function that converts an SVG picture to the format of `path`; UsageError if its library is missing."""
    suffix = path.suffix.lower()
    if suffix == ".svg":
        return str.encode
    try:
        import cairosvg
    except (ImportError, OSError) as error:  # OSError: the shared library of Cairo is missing
        raise UsageError([Problem(
            "picture-library", f"'{path}' needs the library CairoSVG, which cannot be loaded: "
            f"{str(error).partition(chr(10))[0]}", None,
            f"pip install 'heavebond[pictures]', or write {path.with_suffix('.svg')}.")]) from None
    if suffix == ".pdf":
        return lambda picture: bytes(cairosvg.svg2pdf(picture.encode()))
    return lambda picture: bytes(cairosvg.svg2png(picture.encode(), scale=PIXELS, background_color="white"))
