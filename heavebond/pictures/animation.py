"""Animation of a run: a self-contained HTML page, a film (GIF, MP4) or one picture (PNG)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from heavebond.core.errors import Problem, UsageError
from heavebond.core.presentation import number, unit_label
from heavebond.core.writable import new_file, write_text
from heavebond.numerics.dae import Array
from heavebond.numerics.output_times import Time, seconds
from heavebond.pictures.markup import Html, data_block, element, page
from heavebond.pictures.motion import Motion

SUFFIXES = (".html", ".gif", ".mp4", ".png")
SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0, 10.0)
IN_SPACE = ("space/three.js", "space/scene.js")  # scripts that draw machines in space
FINENESS = 1e-5  # resolution of numbers, relative to the picture's height and to a signal's range


def animation_page(motion: Motion, speed: float = 1.0) -> str:
    """The motion as the text of an HTML file with controls: play, pause, any instant, slower or faster; `speed` 1 is real
    time.
    """
    speeds = sorted({*SPEEDS, speed})
    options = [element("option", "real time" if s == 1 else f"{number(s, 3)} ×", value=f"{s:g}",
                       selected=True if s == speed else None) for s in speeds]
    controls = element(
        "div", element("button", "Play", id="play", type="button"),
        element("input", id="when", type="range", min="0", max=str(len(motion.time) - 1), step="any", value="0",
                aria_label="time"),
        element("output", "", id="clock"), element("select", *options, id="speed", aria_label="speed"), class_="controls")
    spatial = bool(motion.solids)
    tools = [element("div", id="camera", class_="controls", role="group", aria_label="camera and picture")]
    return page(motion.title, element("header", element("h1", motion.title), element("p", motion.summary)),
                element("main", element("div", id="stage"), *(tools if spatial else ()), controls,
                        element("div", id="courses")),
                data_block("motion", packed(motion)), look="animation", scripts=IN_SPACE if spatial else ())


def animation_frame(motion: Motion) -> Html:
    """The page of a motion in a frame, for notebooks; its script has no access to the notebook."""
    rights = "allow-scripts allow-downloads" if motion.solids else "allow-scripts"  # the page in space saves pictures
    return element("iframe", srcdoc=str(animation_page(motion)), sandbox=rights, width="100%", height="640",
                   style="border: 0", title=motion.title)


def packed(motion: Motion) -> dict[str, object]:
    """The motion for the page's script: a number for a constant, else the index of its track and the offset.

    Most shapes move with one of a few bodies, so their time series are stored once.
    """
    tracks: list[tuple[Array, float]] = []
    found: dict[str, object] = {
        "times": [round(float(motion.time[0]), 9), round(float(motion.time[-1]), 9), len(motion.time)],
        "edges": list(motion.edges)}
    if motion.solids:
        fine = FINENESS * max(motion.edges[k + 3] - motion.edges[k] for k in range(3))
        # unit quaternions are numbers of about 1, the other courses lengths
        found |= {"title": motion.title, "camera": list(motion.camera), "solids": [
            {"name": solid.name, "kind": solid.kind, "colour": solid.colour, "label": solid.label,
             "courses": {key: [_on_track(c, tracks, FINENESS if key == "turn" else fine) for c in course]
                         for key, course in solid.courses.items()},
             **({"faces": {"corners": _rounded(solid.faces[0].ravel(), FINENESS),
                           "triangles": solid.faces[1].ravel().tolist()}} if solid.faces is not None else {})}
            for solid in motion.solids]}
    else:
        fine = FINENESS * (motion.edges[3] - motion.edges[1])
        found |= {"shapes": [
            {"name": moving.name, "kind": moving.kind, "colour": moving.colour, "label": moving.label,
             "courses": [_on_track(c, tracks, fine) for c in np.nan_to_num(moving.courses)],
             "outlines": [{"corners": o.corners, "fill": o.fill, "edge": o.edge} for o in moving.outlines]}
            for moving in motion.shapes]}
    if motion.runs:
        found["runs"] = [{"label": label, **packed(run)} for label, run in motion.runs.items()]
    found["tracks"] = [_rounded(track, step) for track, step in tracks]
    found["signals"] = [{"name": name, "unit": unit_label(unit),
                         "values": _rounded(values, FINENESS * float(np.ptp(values) or 1.0))}
                        for name, (unit, values) in motion.signals.items()]
    return found


def _on_track(values: Array, tracks: list[tuple[Array, float]], fine: float) -> float | list[float]:
    """Encode a time series: a number if it is constant, otherwise a track and an offset from it. If no track in `tracks` has
    the same form, it is appended as a new one."""
    if np.ptp(values) < fine:
        return _rounded(values[:1], fine)[0]
    for k, (track, step) in enumerate(tracks):
        if step <= fine and np.ptp(values - track) < fine:
            return [k, *_rounded((values - track)[:1], fine)]
    tracks.append((values, fine))
    return [len(tracks) - 1, 0]


def _rounded(values: Array, fine: float) -> list[float]:
    digits = max(0, -int(np.floor(np.log10(fine))))
    return [round(float(value), digits) for value in values]


def save_animation(motion: Motion, path: Path, *, speed: float = 1.0, at: Time | None = None) -> Path:
    """Write an animation (.html, .gif, .mp4), or the picture of the instant `at` (.png, by default the first). UsageError
    for another suffix, for an instant outside the run, or if a program for films is missing."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise UsageError([Problem("file-suffix", f"'{path.name}' is not a moving picture", None,
                                  f"Write {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}.")])
    begin, end = float(motion.time[0]), float(motion.time[-1])
    instant = begin if at is None else seconds(at, "at")
    if at is not None and suffix != ".png":
        raise UsageError([Problem("at-moving", f"`at` is the instant of a picture; '{path.name}' shows the whole run", None,
                                  "Write a file `.png`, or leave it out.")])
    if not begin <= instant <= end:
        raise UsageError([Problem("at-outside", f"the run has no instant {number(instant)} s", None,
                                  f"It begins at {number(begin)} s and ends at {number(end)} s.")])
    try:
        if suffix == ".html":
            write_text(path, animation_page(motion, speed))
        else:
            from heavebond.pictures.film import save_film, save_picture

            with new_file(path) as fresh:
                if suffix == ".png":
                    save_picture(motion, fresh, instant)
                else:
                    save_film(motion, fresh, speed)
    except OSError as error:
        raise UsageError([Problem("file-unwritable", f"'{path}' cannot be written: {error.strerror or error}")]) from None
    return path


