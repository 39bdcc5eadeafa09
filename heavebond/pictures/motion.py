"""A run as moving shapes: the position of every shape of a diagram's `view:` at every instant.

A shape lies along the line from one point to another, of length L. Its outline is stored as corners (a, b, w), located a
L + b B along that line and w W to its left, where B and W are a length and a width of the shape. So a spring stretches
with L, the barrel of a cylinder keeps its length B, and its rod ends at L.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.core import facade
from heavebond.core.errors import ModelError, Problem, Problems, UsageError, listing
from heavebond.core.presentation import brief, converted, count, readable_unit
from heavebond.core.presentation import number as number_text
from heavebond.core.units import ONE, Dimension, declared_unit, times
from heavebond.language.definition import ViewShape
from heavebond.language.model import Model, ModelOrFile, loaded
from heavebond.language.reading import add_expression_problem
from heavebond.language.symbols import stack
from heavebond.language.view import EXAMPLES, WIDE
from heavebond.linear.linearisation import Linearisation, Mode
from heavebond.linear.operating_point import OperatingPoints
from heavebond.numerics.dae import Array, Assembly, assemble
from heavebond.numerics.output_times import Time
from heavebond.numerics.result import Result
from heavebond.numerics.simulation import simulate
from heavebond.numerics.simulator import Simulator
from heavebond.numerics.start_equations import Point
from heavebond.pictures.space import CAMERA, Solid, default_view, frame_names, is_in_space, resolved, scene
from heavebond.text.expression import Call, Expr, ExpressionProblem, children, names, parse_formula

RATE, LEAST_FRAMES, MOST_FRAMES = 25.0, 500, 3000  # pictures per second, and in a whole run
CYCLES, MODE_FRAMES, TURN = 4, 400, 0.4  # periods and pictures of a mode shape, and its largest angle in rad
EDGE, BAND, ASPECT = 0.05, 0.04, 1.35  # relative to the height: margin around the picture, depth of the ground, least width
THIN = 0.08  # default width of a spring relative to its length
TURNS, ROUND = 7, 36  # number of coils of a spring, corners of a circle
SHOWN = 3  # signals drawn below by default
METRE, SECOND = declared_unit("m").dimension, declared_unit("s").dimension
# what an entry of a shape must be, if not a length; without a dimension anything
WANTED: dict[str, tuple[Dimension | None, str]] = {
    **dict.fromkeys(("turned", "azimuth", "elevation"), (ONE, "an angle")), "axis": (ONE, "a number"),
    "duration": (SECOND, "a time"), "vector": (None, ""), "scale": (None, "")}
Corner = tuple[float, float, float]


@dataclass(frozen=True)
class Outline:
    """A line through corners, filled (`fill`) with the shape's colour (full), a pale one (soft), white, or not at all;
    `edge` is the style of the line: solid, dashed or none (empty)."""

    corners: tuple[Corner, ...]
    fill: str = ""
    edge: str = "solid"


@dataclass(frozen=True)
class Moving:
    """A shape over time: x and y of its two ends, its width W and its length B as `courses` (6, n) in m."""

    name: str
    kind: str
    colour: str
    label: str
    courses: Array
    outlines: tuple[Outline, ...]


@dataclass(frozen=True)
class Motion(facade.Displayed):
    """Animation data of a run at `time` (n,) in s: shapes in drawing order, the picture's edges in m (left, bottom,
    right, top), and signals by name: unit and time series (n,). A notebook plays it.

    A machine in space has `solids` in place of shapes; its edges are the lowest x, y, z and the highest x, y, z, and
    `camera` is the azimuth and the elevation of the camera in rad. `runs` are other runs by their labels, which are drawn
    over it, translucent and each in one colour.
    """

    title: str
    summary: str
    time: Array
    shapes: tuple[Moving, ...]
    edges: tuple[float, ...]
    signals: dict[str, tuple[str, Array]] = field(default_factory=dict)
    solids: tuple[Solid, ...] = ()
    camera: tuple[float, float] = CAMERA
    runs: Mapping[str, Motion] = field(default_factory=dict)

    def with_runs(self, runs: Mapping[str, Motion]) -> Motion:
        """The motion with other runs of this or of a similar machine by their labels, drawn over it at the same times; a run
        that is over stays at its end. Raises UsageError for machines that are not in space."""
        flat = [motion.title for motion in (self, *runs.values()) if not motion.solids]
        if flat:
            raise UsageError([Problem("overlay-plane", f"'{flat[0]}' is not a machine in space", None,
                                      "Compare the runs of a machine in a plane by `heavebond plot`.")])
        return replace(self, runs={**self.runs, **runs})

    def save(self, path: str | Path, *, speed: float = 1.0, at: Time | None = None) -> Path:
        """Write a page (.html), which plays without a network, a film (.gif, .mp4), or a picture (.png) of the instant `at`,
        by default the first, and return the path; `speed` 1 is real time. Raises UsageError for another suffix, for an
        instant outside the run, or if a program for films is missing."""
        written: Path = facade.call("Motion.save", self, Path(path), speed, at)
        return written

    def __repr__(self) -> str:
        names_shown = [*(shape.name for shape in self.shapes), *(solid.name for solid in self.solids)]
        return brief(self, self.title, f"{count(len(self.time), 'frame')} from {number_text(float(self.time[0]))} to "
                     f"{number_text(float(self.time[-1]))} s", f"shapes {listing(names_shown, 8)}")


def _rectangle(x: tuple[float, float], b: tuple[float, float] = (0, 0), w: float = 0.5) -> tuple[Corner, ...]:
    return ((x[0], b[0], -w), (x[1], b[1], -w), (x[1], b[1], w), (x[0], b[0], w), (x[0], b[0], -w))


def _zigzag() -> tuple[Corner, ...]:
    steps = [(0.1 + 0.8 * (k + 0.5) / (2 * TURNS), 0.0, 0.5 if k % 2 else -0.5) for k in range(2 * TURNS)]
    return ((0.0, 0.0, 0.0), (0.1, 0.0, 0.0), *steps, (0.9, 0.0, 0.0), (1.0, 0.0, 0.0))


def _round() -> tuple[Corner, ...]:
    turns = [2 * math.pi * k / ROUND for k in range(ROUND + 1)]
    return tuple((0.5 + 0.5 * math.cos(t), 0.0, 0.5 * math.sin(t)) for t in turns)


_LINE: tuple[Corner, ...] = ((0, 0, 0), (1, 0, 0))
_BODY = (Outline(_rectangle((0, 1)), "full"),)
_BELOW = (Outline(((0, 0, 0), (1, 0, 0), (1, 0, -1), (0, 0, -1)), "soft", ""), Outline(_LINE))
_POT: tuple[Corner, ...] = ((0, 1, 0.5), (0, 0, 0.5), (0, 0, -0.5), (0, 1, -0.5))
_PISTON: tuple[Corner, ...] = ((1, -1, -0.42), (1, -1, 0.42))
OUTLINES: dict[str, tuple[Outline, ...]] = {
    "box": _BODY, "beam": _BODY, "line": (Outline(_LINE),), "spring": (Outline(_zigzag()),),
    "circle": (Outline(_round(), "full"), Outline(((0.5, 0, 0), (1, 0, 0)))),
    "cylinder": (Outline(_rectangle((0, 0), (0, 1)), "white"), Outline(_rectangle((0, 1), (0, -1)), "soft"),
                 Outline(_rectangle((1, 1), (-1, 0), 0.14), "full"), Outline(((1, -1, -0.5), (1, -1, 0.5)))),
    "damper": (Outline(_POT), Outline(_PISTON), Outline(((1, -1, 0), (1, 0, 0)))),
    "ground": _BELOW, "level": _BELOW, "mark": (Outline(_LINE, edge="dashed"),)}


def animate(model: ModelOrFile, until: Time | None = None, *, every: Time | None = None,
            parameters: Mapping[str, float | str] | None = None, signals: Iterable[str] = ()) -> Motion:
    """Run a diagram and compute the positions of the shapes of its `view:`: an animation.

    `model`, `until`, `every` and `parameters` are as in `simulate`. `signals` are drawn over time below; by default the
    first outputs of the diagram. `animation.save("run.html")` writes it. A machine in space without `view:` is shown by the
    shapes of its parts. Raises the errors of `simulate`, and ModelError if the diagram has no shapes, names something that
    it does not have, or gives a place that is not a length.
    """
    model = loaded(model)
    chosen = list(signals)
    assembly = assemble(model, chosen)
    view = model.view or default_view(assembly)
    if not view:
        raise ModelError([Problem(
            "view-missing", f"{model.path.name} has no `view:` with shapes to animate", None,
            "Add for example `view: {body: {is: box, at: [0, body.x], size: [1 m, 0.5 m]}}`.")])
    spatial = is_in_space(view, assembly)
    if spatial:
        view = resolved(view, assembly)
    formulas = [f for shape in view.values() for f in shape.all_formulas]
    # the rate of each required position that no equation of the diagram needs
    known, apart = assembly.flat.names, {}
    for name in (n.text for f in formulas for n in names(f.tree)):
        port, _, member = name.rpartition(".")
        for domain in assembly.model.library.domains.values():
            if name not in known and member in domain.positions and (rate := f"{port}.{domain.rate(member)}") in known:
                apart[name] = _Apart(rate, domain.members[member].unit.dimension)
    check_view(assembly, view, apart)
    result = simulate(assembly, until, every=every, parameters=parameters)
    trees = {f.text: f.tree for f in formulas} | {name: parse_formula(name) for name in
                                                  (frame_names(view, assembly) if spatial else ())}
    courses = _courses(result, trees, _integrated(result, apart, parameters))
    # instants at a constant frame rate, limited to the number that a page can hold
    begin, end = float(result.time[0]), float(result.time[-1])
    number = min(MOST_FRAMES, len(result.time), max(LEAST_FRAMES, math.ceil((end - begin) * RATE)))
    time = np.linspace(begin, end, max(2, number))
    shown_series = {text: np.interp(time, result.time, course) for text, course in courses.items()}
    signals_below = _signals(result, time, chosen or list(model.show)[:SHOWN])
    if not spatial:
        return _motion(model, time, shown_series, signals_below)
    found = scene(view, shown_series, len(time), assembly, ground=not model.view)
    return Motion(model.name, model.summary, time, (), found.edges, signals_below, found.solids, found.camera)


def animate_mode(model: ModelOrFile, number: int, *, at: Time | None = None, size: float = 0.1,
                 parameters: Mapping[str, float | str] | None = None) -> Motion:
    """Compute the positions of the shapes of a diagram in one of its modes: an animated mode shape.

    `number` is the place of the mode in `modes(model, at=at, parameters=parameters)`, from 1. The shapes move linearly about
    the operating point, without damping, over CYCLES periods; a mode that does not oscillate is shown over five time
    constants. `size` is the largest displacement relative to the extent of the picture; no frame turns by more than about
    TURN. Raises the errors of `modes` and `animate`, and UsageError for a number of no mode, or a mode of eigenvalue 0.
    """
    diagram = loaded(model)
    operating = OperatingPoints(diagram.with_parameters(parameters) if parameters else diagram, at)
    assembly, point = operating.assembly, operating.at()
    modes = Linearisation(assembly).at(point).modes()
    chosen = modes[number - 1] if 1 <= number <= len(modes) else None
    if chosen is None or not chosen.value or chosen.z is not None:
        reason = f"the diagram has {count(len(modes), 'mode')}" if chosen is None else \
            "a free mode has no shape in time" if chosen.z is None else "a sampled system has no mode shapes"
        raise UsageError([Problem("mode-number", f"mode {number} cannot be animated: {reason}", None,
                                  f"`heavebond modes {diagram.name}` lists the modes; count from 1.")])
    view = diagram.view or default_view(assembly)
    if not view:
        raise ModelError([Problem("view-missing", f"{diagram.path.name} has no `view:` with shapes to animate", None,
                                  "Add for example `view: {body: {is: box, at: [0, body.x], size: [1 m, 0.5 m]}}`.")])
    spatial = is_in_space(view, assembly)
    if spatial:
        view = resolved(view, assembly)
    check_view(assembly, view, {})
    frames = frame_names(view, assembly) if spatial else []
    trees = {f.text: f.tree for shape in view.values() for f in shape.all_formulas} | {
        name: parse_formula(name) for name in frames}
    values, changes = _modal_changes(assembly, point, list(trees.values()), chosen)
    # displacements of points, and changes of quaternions
    places = {f.text for shape in view.values() for key, p in shape.points.items() if not p.frame for f in p.coordinates} | {
        f.text for shape in view.values() for key in ("at", "from", "to") for f in shape.formulas.get(key, ())} | {
        name for name in frames if not name.rpartition(".")[2].startswith("q_")}
    moved = np.array([text in places for text in trees])
    turned = np.array([text in frames and text not in places for text in trees])
    still = {text: np.full(2, value) for text, value in zip(trees, values, strict=True)}
    at_rest = scene(view, still, 2, assembly, ground=False) if spatial else _motion(diagram, np.arange(2.0), still, {})
    edges = at_rest.edges
    extent = max(high - low for low, high in zip(edges[:len(edges) // 2], edges[len(edges) // 2:], strict=True))
    largest = max(float(np.abs(changes[moved]).max(initial=0.0)) / (size * extent),
                  2 * float(np.abs(changes[turned]).max(initial=0.0)) / TURN)
    # the largest displacement is real: at its largest at the start
    s, leading = chosen.value, changes[np.argmax(np.abs(changes) * (moved if np.any(changes[moved]) else turned))]
    changes = changes * (np.conj(leading) / (abs(leading) or 1.0))
    time = np.linspace(0.0, CYCLES * 2 * np.pi / s.imag if chosen.swings else 5 / abs(s.real), MODE_FRAMES)
    course = np.exp(1j * s.imag * time) if chosen.swings else np.exp(-np.abs(s.real) * time)
    series = {text: value + np.real(change * course) for text, value, change in
              zip(trees, values, changes / (largest or 1.0), strict=True)}
    title = f"{diagram.name}, mode {number}"
    frequency, damping = number_text(chosen.frequency, 4), number_text(chosen.damping, 3)
    summary = f"{frequency} Hz, damping ratio {damping}" if chosen.swings else \
        f"time constant {number_text(1 / abs(s.real), 4)} s"
    if not spatial:
        return replace(_motion(diagram, time, series, {}), title=title, summary=summary)
    found = scene(view, series, len(time), assembly, ground=not diagram.view)
    return Motion(title, summary, time, (), found.edges, {}, found.solids, found.camera)


def _modal_changes(assembly: Assembly, point: Point, trees: list[Expr], mode: Mode) -> tuple[Array, NDArray[np.complex128]]:
    """The values (m,) of formulas at a point, and their complex amplitudes (m,) in a mode."""
    _, x, z, *_ = assembly.arguments
    rows = stack([assembly.expression(tree) for tree in trees])
    slopes = ca.Function("slopes", list(assembly.arguments), [
        rows, ca.jacobian(stack([rows, assembly.alg]), stack([x, z]))])
    values, jacobian = (np.array(part.full()) for part in slopes(*point.values()))
    m, n_x = len(trees), len(point.x)
    v = mode.right * assembly.x_nominal
    if len(point.z):
        v = np.append(v, -np.linalg.solve(jacobian[m:, n_x:], jacobian[m:, :n_x] @ v))
    return values.ravel(), jacobian[:m] @ v


@dataclass(frozen=True)
class _Apart:
    """A position that is integrated in addition to the run: the variable that is its rate, and its dimension."""

    rate: str
    dimension: Dimension


def _integrated(result: Result, apart: Mapping[str, _Apart],
                parameters: Mapping[str, float | str] | None) -> dict[str, Array]:
    """The integrals (N,) of some rates over a run, which is repeated with them."""
    if not apart:
        return {}
    assembly = result.assembly
    rates = assembly.express(stack([assembly.flat.levels[0][assembly.flat.names[a.rate]] for a in apart.values()]))
    again = Simulator(assembly, times=result.time, quadratures=rates, solver=str(result.statistics["solver"]))
    return dict(zip(apart, again.run(parameters).quadratures, strict=True))


def _courses(result: Result, formulas: Mapping[str, Expr], beside: Mapping[str, Array]) -> dict[str, Array]:
    """Evaluate formulas in SI along a run; names in `beside` have given time series (N,)."""
    without_beside = [text for text, tree in formulas.items() if not any(n.text in beside for n in names(tree))]
    # in brackets, so that a formula is not taken for the output of that name in its unit
    series_by_text = dict(zip(without_beside, result.signals([f"({text})" for text in without_beside]).values(),
                              strict=True))
    resolver = result.assembly.resolver()
    for text in formulas.keys() - set(without_beside):
        used = list(dict.fromkeys(n.text for n in names(formulas[text])))
        known = {name: result.signals([f"({name})"])[f"({name})"] for name in used if name not in beside}
        symbols = {name: ca.SX.sym(name) for name in used}
        value = resolver.evaluate(formulas[text], extra=symbols)
        function = ca.Function("formula", [stack(list(symbols.values()))], [value])
        series_by_text[text] = np.array(function(np.array([beside[n] if n in beside else known[n] for n in used]))).ravel()
    return series_by_text


def check_view(assembly: Assembly, view: Mapping[str, ViewShape], apart: Mapping[str, _Apart]) -> None:
    """Check names and units of all formulas of a view, where `apart` are the positions that are integrated separately."""
    problems, resolver = Problems(), assembly.resolver()
    places = {name: position.dimension for name, position in apart.items()}
    for shape in view.values():
        entries = [(key, f) for key, part in shape.formulas.items() for f in part]
        entries += [(key, f) for key, point in shape.points.items() for f in point.coordinates]
        vector: Dimension | None = None
        for key, formula in entries:
            try:
                dimension_found = resolver.dimension(formula.tree, extra=places)
                resolver.evaluate(formula.tree, extra={name: ca.SX.sym(name) for name in apart})
            except ExpressionProblem as problem:
                add_expression_problem(problem, formula.place, problems)
                continue
            wanted, noun = WANTED.get(key, (METRE, "a length"))
            if key == "vector":
                vector = dimension_found
            if key == "scale" and vector is not None:
                wanted, noun = times(vector, METRE, -1), "the size of the vector over a length"
            if dimension_found is not None and wanted is not None and dimension_found != wanted:
                problems.add("view-unit", f"`{key}` of '{shape.name}' must be {noun}; '{formula.text}' is not",
                             formula.place,
                             hint=f"Write for example `{key}: {EXAMPLES[key]}`."
                             if shape.spatial and key in EXAMPLES else "Write for example `crown.x + 12 m`.")
            moving = [apart[n.text].rate for n in names(formula.tree) if n.text in apart]
            if moving and _has_derivative(formula.tree):
                problems.add("view-der", f"'{formula.text}' takes the derivative of a position that is not a variable of "
                                         f"the diagram", formula.place, hint=f"Write the rate by its name: "
                                                                             f"{listing(moving)}.")
    problems.raise_as(ModelError)


def _has_derivative(tree: Expr) -> bool:
    return (isinstance(tree, Call) and tree.function == "der") or any(_has_derivative(child) for child in children(tree))


def _signals(result: Result, time: Array, chosen: list[str]) -> dict[str, tuple[str, Array]]:
    """The unit and the time series of signals, in units that suit their size."""
    shown_series = {}
    for name, values in result.signals(chosen).items():
        unit_text = result.unit(name)
        unit = readable_unit(unit_text, float(np.max(np.abs(values), initial=0.0)))
        shown_series[name] = (unit, np.interp(time, result.time, converted(values, unit_text, unit)))
    return shown_series


def _motion(model: Model, time: Array, courses: Mapping[str, Array], signals: dict[str, tuple[str, Array]]) -> Motion:
    n = len(time)
    placed = {name: _placed(shape, courses, n) for name, shape in model.view.items()}
    edges = _edges([(model.view[name].kind, course) for name, course in placed.items()])
    left, bottom, right, top = edges
    for name, course in placed.items():
        kind = model.view[name].kind
        if kind in WIDE:
            course[0], course[2] = left, right
            course[4] = course[1] - bottom
        elif kind == "ground":
            course[4] = BAND * (top - bottom)
    shapes = tuple(Moving(shape.name, shape.kind, shape.colour, shape.label, placed[name], OUTLINES[shape.kind])
                   for name, shape in model.view.items())
    return Motion(model.name, model.summary, time, shapes, edges, signals)


def _placed(shape: ViewShape, courses: Mapping[str, Array], n: int) -> Array:
    """x and y of both ends, W and B over time (6, n); values that depend on the edges of the picture are still nan."""
    rows_found = np.full((6, n), np.nan)
    series_by_key = {key: [courses[f.text] for f in part] for key, part in shape.formulas.items()}
    if shape.kind in WIDE:
        rows_found[1] = rows_found[3] = series_by_key["at"][0]
    elif "at" in series_by_key:
        across = (series_by_key.get("diameter") or series_by_key.get("width") or series_by_key["size"])[0] / 2
        turned = series_by_key["turned"][0] if "turned" in series_by_key else np.zeros(n)
        offset = np.array([across * np.cos(turned), across * np.sin(turned)])
        rows_found[:2], rows_found[2:4] = np.array(series_by_key["at"]) - offset, np.array(series_by_key["at"]) + offset
        rows_found[4] = series_by_key["size"][1] if "size" in series_by_key else 2 * across
    else:
        rows_found[:2], rows_found[2:4] = series_by_key["from"], series_by_key["to"]
        length = float(np.mean(np.hypot(*(rows_found[2:4] - rows_found[:2]))))
        rows_found[4] = series_by_key["width"][0] if "width" in series_by_key else THIN * length
        # by default the mean position of the piston is the middle of its barrel
        rows_found[5] = series_by_key["length"][0] if "length" in series_by_key else 2 / 3 * length
    return rows_found


def _edges(placed: list[tuple[str, Array]]) -> tuple[float, float, float, float]:
    """Left, bottom, right, top of all positions, with a margin."""
    series_in_picture = [course for kind, course in placed if kind not in WIDE]
    if not series_in_picture:
        raise UsageError([Problem("view-empty", "a view of levels and marks alone has no width", None, "Add a box.")])
    half = [0.0 if kind == "ground" else float(np.nanmax(np.abs(course[4]))) / 2 for kind, course in placed
            if kind not in WIDE]
    x = [(float(np.min(c[[0, 2]])) - h, float(np.max(c[[0, 2]])) + h) for c, h in zip(series_in_picture, half, strict=True)]
    y = [(float(np.min(c[[1, 3]])) - h, float(np.max(c[[1, 3]])) + h) for c, h in zip(series_in_picture, half, strict=True)]
    y += [(float(np.min(c[1])), float(np.max(c[1]))) for kind, c in placed if kind in WIDE]
    left, right = min(a for a, _ in x), max(b for _, b in x)
    bottom, top = min(a for a, _ in y), max(b for _, b in y)
    edge = EDGE * max(right - left, top - bottom)
    beside = max(0.0, ASPECT * (top - bottom + 2 * edge) - (right - left)) / 2
    return left - max(edge, beside), bottom - edge, right + max(edge, beside), top + edge
