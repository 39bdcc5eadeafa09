"""A motion as a film: GIF by Pillow, MP4 by ffmpeg if it is installed; and one of its pictures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, PillowWriter
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from heavebond.core.errors import Problem, UsageError
from heavebond.core.presentation import number
from heavebond.language.view import WIDE
from heavebond.numerics.dae import Array
from heavebond.pictures.motion import Motion, Moving, Outline
from heavebond.pictures.projection import Camera, cell_size, middle, polygons
from heavebond.pictures.space import AREAS

RATE, MOST = 12, 600  # pictures per second, and in all: a GIF holds each of them completely
HEIGHT, BREADTH, DPI = 6.0, 9.0, 90  # inches at most
SPACE = 6.4, 4.8  # inches of a picture in space
EDGE = 0.03  # margin around a picture in space
LETTERS = 34, 62  # height of letters relative to height and width of a picture, as in animation.js
SLIM = 0.55  # average width of a letter relative to its height
# edge, face and pale face, as in animation.css
COLOURS = {
    "grey": ("#47525e", "#cfd6dc", "#e8ecef"), "dark": ("#263238", "#5d6a75", "#cfd6dc"),
    "blue": ("#00507f", "#6fb1d8", "#d7e8f3"), "sea": ("#3c86b8", "#9cc9e4", "#dceefa"),
    "gas": ("#8a3570", "#cf8fbc", "#f3dfec"), "oil": ("#005a9c", "#8fb9db", "#d6e6f2"),
    "rock": ("#6b5a3d", "#b5a280", "#e6dcc8"), "red": ("#c2410c", "#f0a37f", "#ffe3d1"),
    "green": ("#00714f", "#7cc4a9", "#dcf1e9"), "orange": ("#a35a00", "#f0b866", "#fbe8cc")}
RUNS, OPACITY = ("blue", "red", "green", "gas", "orange", "dark"), 0.45  # of the runs that are overlaid, as in scene.js


def save_film(motion: Motion, path: Path, speed: float) -> None:
    """Write .gif or .mp4 with the playback speed `speed`; UsageError without ffmpeg for .mp4."""
    if path.suffix.lower() == ".gif":
        writer: AbstractMovieWriter = PillowWriter(fps=RATE)
    else:
        if not FFMpegWriter.isAvailable():
            raise UsageError([Problem("ffmpeg-missing", "writing .mp4 needs ffmpeg, which is not installed", None,
                                      "Install ffmpeg, or write .gif or .html.")])
        writer = FFMpegWriter(fps=RATE)
    figure, draw = _in_space(motion) if motion.solids else _in_plane(motion)
    length = float(motion.time[-1] - motion.time[0]) / speed
    frames = max(2, min(MOST, int(length * RATE)))
    with writer.saving(figure, str(path), DPI):
        for k in np.linspace(0, len(motion.time) - 1, frames).round().astype(int):
            draw(int(k))
            writer.grab_frame()


def save_picture(motion: Motion, path: Path, at: float) -> None:
    """Write the picture (.png) of the instant `at` in s."""
    figure, draw = _in_space(motion) if motion.solids else _in_plane(motion)
    draw(int(np.argmin(np.abs(motion.time - at))))
    figure.savefig(path, format="png", dpi=DPI)


def _in_plane(motion: Motion) -> tuple[Figure, Callable[[int], None]]:
    """A figure and the function that draws the machine in a plane at frame k in it."""
    left, bottom, right, top = motion.edges
    inch = min(HEIGHT / (top - bottom), BREADTH / (right - left))
    figure = Figure(figsize=(inch * (right - left), inch * (top - bottom)), dpi=DPI)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_xlim(left, right)
    axes.set_ylim(bottom, top)
    axes.set_axis_off()
    patches = []
    for moving in motion.shapes:
        edge, face, pale = COLOURS[moving.colour]
        for outline in moving.outlines:
            fill = {"full": face, "soft": pale, "white": "#ffffff"}.get(outline.fill, "none")
            patch = Polygon(corners(moving, outline, 0), closed=False, edgecolor=edge, facecolor=fill,
                            linewidth=1.2 if outline.edge else 0.0, linestyle="--" if outline.edge == "dashed" else "-")
            patches.append((moving, outline, patch))
            axes.add_patch(patch)
    letter = max((top - bottom) / LETTERS[0], (right - left) / LETTERS[1])
    size = 72 * inch * letter
    clock = axes.text(left + letter / 2, top - letter / 2, "", va="top", fontsize=size)
    labels = [(moving, axes.text(0, 0, moving.label, va="center", fontsize=size)) for moving in motion.shapes
              if moving.label]

    def draw(k: int) -> None:
        for moving, outline, patch in patches:
            patch.set_xy(corners(moving, outline, k))
        for moving, words in labels:
            x, y, side = writing(moving, k, right, letter)
            words.set(x=x, y=y, ha=side)
        clock.set_text(f"{motion.time[k]:.1f} s")

    return figure, draw


def _in_space(motion: Motion) -> tuple[Figure, Callable[[int], None]]:
    """A figure and the function that draws the machine in space at frame k in it."""
    edges = np.array([motion.edges, *(run.edges for run in motion.runs.values())])
    low, high = edges[:, :3].min(axis=0), edges[:, 3:].max(axis=0)
    camera = Camera((low + high) / 2, float(np.linalg.norm(high - low)) / 2 or 1.0, *motion.camera)
    # the picture ends at the corners of the box around the machine
    seen = camera.seen(np.array(list(product(*zip(low, high, strict=True)))))[:, :2]
    centre, half = (seen.min(axis=0) + seen.max(axis=0)) / 2, np.ptp(seen, axis=0) / 2 * (1 + EDGE)
    across = max(half[0] / SPACE[0], half[1] / SPACE[1])
    inches = np.clip(2 * half / (2 * across), 0.55 * np.array(SPACE), None)
    figure = Figure(figsize=(float(inches[0]), float(inches[1])), dpi=DPI)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_xlim(centre[0] - across * inches[0], centre[0] + across * inches[0])
    axes.set_ylim(centre[1] - across * inches[1], centre[1] + across * inches[1])
    axes.set_axis_off()
    painted = PolyCollection([], closed=False, capstyle="round", joinstyle="round")
    axes.add_collection(painted)
    clock = axes.text(0.015, 0.98, "", va="top", fontsize=10, transform=axes.transAxes)
    ground = next((solid for solid in motion.solids if solid.kind == "ground"), None)
    if ground is not None:
        cell = cell_size(float(ground.courses["size"][0, 0]))
        axes.text(0.015, 0.02, f"squares of {number(cell)} m", va="bottom", fontsize=8, color="#55606c",
                  transform=axes.transAxes)
    labels = [(solid, axes.text(0, 0, solid.label, va="bottom", ha="center", fontsize=9)) for solid in motion.solids
              if solid.label]

    for k, name in enumerate(motion.runs):
        axes.text(0.985, 0.98 - 0.04 * k, name, va="top", ha="right", fontsize=9, color=COLOURS[RUNS[k % len(RUNS)]][0],
                  transform=axes.transAxes)
    overlaid = [(run, tuple(replace(solid, colour=RUNS[k % len(RUNS)]) for solid in run.solids if solid.kind not in AREAS))
                for k, run in enumerate(motion.runs.values())]
    lasting = float(motion.time[-1] - motion.time[0])
    digits = 1 if lasting > 20 else 2 if lasting > 0.2 else 4

    def draw(k: int) -> None:
        found = polygons(motion.solids, k, motion.time, camera, COLOURS)
        for run, solids in overlaid:
            at = int(np.argmin(np.abs(run.time - motion.time[k])))
            found += [replace(p, face=p.face and (*p.face[:3], OPACITY), edge=p.edge and (*p.edge[:3], OPACITY))
                      for p in polygons(solids, at, run.time, camera, COLOURS)]
        painted.set_verts([p.corners if p.face is None else np.vstack([p.corners, p.corners[:1]]) for p in found],
                          closed=False)
        painted.set(facecolors=[p.face or (0, 0, 0, 0) for p in found], edgecolors=[p.edge or (0, 0, 0, 0) for p in found],
                    linewidths=[p.width for p in found])
        for solid, words in labels:
            x, y, _ = camera.seen(middle(solid, k)[None])[0]
            words.set(x=x, y=y)
        clock.set_text(f"{motion.time[k]:.{digits}f} s")

    return figure, draw


def corners(moving: Moving, outline: Outline, k: int) -> Array:
    """The corners of an outline (m, 2) in m at frame k."""
    x, y, u, v, width, barrel = np.nan_to_num(moving.courses[:, k])
    length = float(np.hypot(u - x, v - y)) or 1e-12
    along, beside = np.array([u - x, v - y]) / length, np.array([y - v, u - x]) / length
    a, b, w = np.array(outline.corners).T
    return np.array([x, y]) + np.outer(a * length + b * barrel, along) + np.outer(w * width, beside)


def writing(moving: Moving, k: int, right: float, letter: float) -> tuple[float, float, str]:
    """Position and alignment of the label of a shape at frame k: inside if it fits, else at its side."""
    x, y, u, v, width, _ = np.nan_to_num(moving.courses[:, k]).tolist()
    length = float(np.hypot(u - x, v - y))
    if moving.kind in WIDE:
        return right - letter / 2, y + letter / 2, "right"
    ground = moving.kind == "ground"
    if (ground or moving.kind == "box") and SLIM * letter * len(moving.label) < length and letter < width:
        return (x + u) / 2, y - width / 2 if ground else (y + v) / 2, "center"
    steep = abs(v - y) > 0.5 * length
    return max(x, u) + (width / 2 if steep else 0.0) + letter / 2, (y + v) / 2, "left"
