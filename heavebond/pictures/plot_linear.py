"""Figures of linear analysis: Bode, Nyquist, poles and zeros, steps, root loci."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.patches import Circle, Rectangle
from matplotlib.ticker import FixedLocator, NullLocator

from heavebond.core.errors import Problem, UsageError, suggest
from heavebond.core.presentation import number, readable, readable_unit, unit_label
from heavebond.core.units import read_unit
from heavebond.linear.held_variables import with_held
from heavebond.linear.linear_system import LINEAR_SYSTEM
from heavebond.linear.margins import CUT
from heavebond.linear.sampled import sampled_words
from heavebond.pictures.plot import COLOURS, DASHES, DPI, RECT, WIDTH, figure_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from heavebond.linear.held_variables import HeldVariable
    from heavebond.linear.linear_system import StateSpace
    from heavebond.linear.margins import Crossings
    from heavebond.linear.root_locus import RootLocus
    from heavebond.numerics.dae import Array

GRID = "#e4e4e4"
DAMPINGS = (0.1, 0.3, 0.5, 0.7)
# A Nyquist curve is drawn up to so many times the distance of -1; a pole on the axis would hide everything else.
REACH = 3.0
# In the z-plane points farther from 0 are left out, and points within such a square are drawn larger.
FAR, CLOSE = 3.0, 0.5
CORNER, HALVINGS = 0.02, 6  # steps of a curve that the eye sees, over its size; how often they are halved


def plot_bode(channels: Sequence[StateSpace], frequencies: Array, *, title: str = "", margins: Crossings | None = None
              ) -> Figure:
    """Magnitude (as a ratio, with decibels on the right) and phase over the frequency in Hz, a line for each channel."""
    channels = [channel.displayed() for channel in channels]
    figure = Figure(figsize=(WIDTH, 7.5), dpi=DPI, layout=ConstrainedLayoutEngine(rect=RECT))
    figure_title(figure, _with_period(title, channels[0].period, dict.fromkeys(h for c in channels for h in c.held)))
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    units = {ratio(c) for c in channels}
    for k, channel in enumerate(channels):
        response = channel.response(2j * np.pi * frequencies)[:, 0, 0]
        label = channel_name(channel) + (f" [{ratio(channel)}]" if len(units) > 1 else "")
        style = {"color": COLOURS[k % len(COLOURS)], "linewidth": 1.4, "linestyle": DASHES[k // len(COLOURS) % len(DASHES)]}
        upper.loglog(frequencies, np.abs(response), label=label, **style)
        lower.semilogx(frequencies, _phase(channel, frequencies, response), **style)
    upper.set_ylabel(f"magnitude [{units.pop()}]" if len(units) == 1 else "magnitude")
    decibels = upper.twinx()
    decibels.set_ylim(*(20 * np.log10(upper.get_ylim())))
    decibels.set_ylabel("dB")
    decibels.spines[["top", "right"]].set_visible(False)
    lower.set_ylabel("phase [°]")
    lower.set_xlabel("frequency [Hz]")
    lower.yaxis.get_major_locator().set_params(steps=[1, 1.5, 3, 4.5, 9])
    lower.set_xlim(frequencies[0], frequencies[-1])
    for axes in (upper, lower):
        _quiet(axes)
        axes.grid(True, which="minor", color=GRID, linewidth=0.3)
    if margins is not None:
        # where the gain is 1 and where the phase is -180 degrees, with the margins there
        kind = "crossing" if margins.unstable else "margin"
        upper.axhline(1, color="#8c8c8c", linewidth=0.8)
        lower.axhline(-180, color="#8c8c8c", linewidth=0.8)
        for k, margin in enumerate(margins.phase):
            lower.axvline(margin.frequency, color=COLOURS[1], linewidth=0.9, linestyle=DASHES[1])
            upper.axvline(margin.frequency, color=COLOURS[1], linewidth=0.9, linestyle=DASHES[1],
                          label=f"phase {kind} {number(margin.value, 3)}°" if k == 0 else None)
        for k, margin in enumerate(m for m in margins.gain if 0 < m.frequency < np.inf):
            upper.axvline(margin.frequency, color=COLOURS[2], linewidth=0.9, linestyle=DASHES[2],
                          label=f"gain {kind} {number(margin.value, 3)}" if k == 0 else None)
            lower.axvline(margin.frequency, color=COLOURS[2], linewidth=0.9, linestyle=DASHES[2])
    figure.legend(*upper.get_legend_handles_labels(), loc="outside upper right", ncols=3, frameon=False, fontsize=9)
    return figure


def plot_nyquist(channels: Sequence[StateSpace], frequencies: Array, *, title: str = "", margins: Crossings | None = None
                 ) -> Figure:
    """The response in the complex plane, a plane for each unit, with the unit circle and -1 for an open loop (`margins`)."""
    channels = [channel.displayed() for channel in channels]
    units = list(dict.fromkeys(ratio(c) for c in channels))
    figure, planes = _planes(_with_period(title, channels[0].period, dict.fromkeys(h for c in channels for h in c.held)),
                             len(units))
    for axes, unit in zip(planes, units, strict=True):
        coloured_channels = [(COLOURS[k % len(COLOURS)], c) for k, c in enumerate(channels) if ratio(c) == unit]
        # the curves of channels in their colours, and what is looked at in an open loop
        reach = 0.0
        for colour, channel in coloured_channels:
            # the response at the frequencies, and between those where it would show corners
            f = np.asarray(frequencies, dtype=float)
            response = channel.response(2j * np.pi * f)[:, 0, 0]
            for _ in range(HALVINGS):
                far = np.flatnonzero(np.abs(np.diff(response)) > CORNER * np.abs(response).max())
                if not len(far):
                    break
                f = np.insert(f, far + 1, np.sqrt(f[far] * f[far + 1]))
                response = channel.response(2j * np.pi * f)[:, 0, 0]
            response = np.asarray(response)
            axes.plot(response.real, response.imag, color=colour, linewidth=1.5, label=channel_name(channel))
            axes.plot(response.real, -response.imag, color=colour, linewidth=0.8, linestyle=DASHES[1])
            k = int(np.argmax(np.abs(np.diff(response)) * (np.abs(response[:-1]) < REACH)))
            axes.annotate("", (response[k + 1].real, response[k + 1].imag), (response[k].real, response[k].imag),
                          arrowprops={"arrowstyle": "-|>", "color": colour})
            sizes = np.abs(response)
            # at an undamped resonance the curve is infinite: the plane then shows some times the median distance
            reach = max(reach, REACH * float(np.median(sizes)) if len(channel.unbounded()) else float(sizes.max()))
        if margins is not None:
            turn = np.linspace(0, 2 * np.pi, 200)
            axes.plot(np.cos(turn), np.sin(turn), color="#8c8c8c", linewidth=0.8)
            axes.plot(-1, 0, "+", color=COLOURS[1], markersize=12, markeredgewidth=2, label="−1")
            m = margins.modulus.value
            axes.plot(-1 + m * np.cos(turn), m * np.sin(turn), color=COLOURS[1], linewidth=0.8, linestyle=DASHES[2],
                      label=f"distance {number(m, 3)}")
            reach = min(reach, REACH)
        axes.set_xlim(-1.08 * reach, 1.08 * reach)
        axes.set_ylim(-1.08 * reach, 1.08 * reach)
        axes.set_aspect("equal")
        axes.set_xlabel(f"real part [{unit}]")
        axes.set_ylabel(f"imaginary part [{unit}]")
    entries = [entry for axes in planes for entry in zip(*axes.get_legend_handles_labels(), strict=True)]
    figure.legend([handle for handle, _ in entries], [label for _, label in entries], loc="outside upper right", ncols=3,
                  frameon=False, fontsize=9)
    return figure


def plot_poles(poles: NDArray[np.complex128], zeros: Mapping[str, NDArray[np.complex128]], *, title: str = "",
               period: float | None = None) -> Figure:
    """Poles as crosses, the zeros of each channel as circles, with lines of equal damping; with a period in s those of a
    sampled system in the z-plane."""
    figure, axes = _plane(_with_period(title, period, ()))
    axes.plot(poles.real, poles.imag, "x", color=COLOURS[0], markersize=9, markeredgewidth=2, label="poles", zorder=3)
    for k, (name, channel_zeros) in enumerate(zeros.items()):
        colour = COLOURS[(k + 1) % len(COLOURS)]
        axes.plot(channel_zeros.real, channel_zeros.imag, "o", color=colour, markersize=8 + 3 * k, fillstyle="none",
                  markeredgewidth=1.4,
                  label=f"zeros of {name}{_far_zeros(channel_zeros) if period is not None else ''}", zorder=3)
    points = np.concatenate([poles, *zeros.values()])
    _s_plane(axes, points) if period is None else _z_plane(axes, points)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper right", ncols=2, frameon=False, fontsize=9)
    return figure


def _far_zeros(zeros: NDArray[np.complex128]) -> str:
    """` (and -3.6)` for zeros that the z-plane leaves out."""
    far = [number(float(z.real), 3) if not z.imag else f"{z:.3g}" for z in zeros if abs(z) > FAR]
    return f" (and {', '.join(far)})" if far else ""


def plot_root_locus(locus: RootLocus, *, title: str = "") -> Figure:
    """The ways of the poles while a parameter moves, coloured by its value; the stability boundaries in the legend."""
    periods = locus.periods
    figure, axes = _plane(_with_period(title, float(periods[0]) if periods is not None and np.ptp(periods) == 0 else None,
                                       locus.held))
    poles = locus.poles if periods is None else locus.z
    unit = readable_unit(locus.unit, float(np.abs(locus.values).max()))
    ends = read_unit(unit).from_si(locus.values)
    values = np.broadcast_to(ends[:, None], poles.shape)
    axes.plot(poles.real, poles.imag, color="#c8c8c8", linewidth=0.8, zorder=1)
    drawn = axes.scatter(poles.real, poles.imag, c=values, s=11, cmap="viridis", zorder=2)
    axes.plot(poles[0].real, poles[0].imag, "x", color="black", markersize=8, markeredgewidth=1.6, zorder=3,
              label=f"at {number(float(values[0, 0]), 4)}")
    axes.plot(poles[-1].real, poles[-1].imag, "s", color="black", markersize=6, fillstyle="none", zorder=3,
              label=f"at {number(float(values[-1, 0]), 4)}")
    for limit in locus.limits:
        axes.plot([], [], " ", label=f"stability boundary at {readable(limit, locus.unit, 4)}")
    figure.colorbar(drawn, ax=axes, label=f"{locus.parameter} [{unit_label(unit)}]")
    _s_plane(axes, poles.ravel()) if periods is None else _z_plane(axes, poles.ravel())
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper right", ncols=4, frameon=False, fontsize=9)
    return figure


def plot_steps(channels: Sequence[StateSpace], times: Sequence[Array], *, title: str = "") -> Figure:
    """Draw the response of each channel to a step of 1 in the unit of its input, each in separate axes, and its final
    value."""
    channels = [channel.displayed() for channel in channels]
    n = len(channels)
    figure = Figure(figsize=(WIDTH, max(4.5, 0.9 + 2.2 * n)), dpi=DPI, layout=ConstrainedLayoutEngine(rect=RECT))
    figure_title(figure, _with_period(title, channels[0].period, dict.fromkeys(h for c in channels for h in c.held)))
    for axes, channel, time in zip(figure.subplots(n, 1, squeeze=False)[:, 0], channels, times, strict=True):
        axes.plot(time, channel.step(time)[:, 0, 0], color=COLOURS[0], linewidth=1.4,
                  drawstyle="default" if channel.period is None else "steps-post")
        if channel.stable:
            settled = float(channel.response(np.zeros(1))[0, 0, 0].real)
            axes.axhline(settled, color="#8c8c8c", linewidth=0.8, linestyle=DASHES[1])
        _quiet(axes)
        axes.set_xlim(0, time[-1])
        axes.set_ylabel(f"{channel.outputs[0]} [{unit_label(channel.units[2][0])}]")
        axes.set_title(f"step of 1 {_bare(channel.units[1][0])} at {channel.inputs[0]}", loc="left", fontsize=10)
        axes.set_xlabel("time [s]")
    return figure


def _with_period(title: str, period: float | None, held: Iterable[HeldVariable]) -> str:
    """The title with the period of a sampled system and the variables that are constant."""
    sampled = [sampled_words(period)] if period is not None else []
    return with_held(", ".join(filter(None, [title, *sampled])), held)


def channel_name(channel: StateSpace) -> str:
    """`vessel.u → crown.x`; of an open loop where it is cut."""
    if channel.inputs[0].startswith(CUT):
        return f"open loop at {channel.outputs[0]}"
    return f"{channel.inputs[0]} → {channel.outputs[0]}"


def ratio(channel: StateSpace) -> str:
    """The unit of a channel's gain as on paper: `kN/m`; `–` where output and input are of one unit."""
    upper, lower = channel.units[2][0], channel.units[1][0]
    if upper == lower:
        return unit_label("1")
    if lower == "1":
        return unit_label(upper)
    return f"{unit_label(upper)} / {f'({unit_label(lower)})' if any(c in lower for c in '*/') else unit_label(lower)}"


def _bare(unit: str) -> str:
    return "" if unit == "1" else unit_label(unit)


def _plane(title: str) -> tuple[Figure, Axes]:
    figure, planes = _planes(title, 1)
    return figure, planes[0]


def _planes(title: str, number: int) -> tuple[Figure, list[Axes]]:
    """Complex planes side by side."""
    figure = Figure(figsize=(9.0, 7.5) if number == 1 else (6.0 * number, 6.8), dpi=DPI,
                    layout=ConstrainedLayoutEngine(rect=RECT))
    figure_title(figure, title)
    planes: list[Axes] = list(figure.subplots(1, number, squeeze=False)[0])
    for axes in planes:
        _quiet(axes)
        axes.axhline(0, color="#8c8c8c", linewidth=0.7)
        axes.axvline(0, color="#8c8c8c", linewidth=0.7)
    return figure, planes


def _s_plane(axes: Axes, points: NDArray[np.complex128]) -> None:
    """Axes that show all points: logarithmic away from zero where the fastest is far beyond the slowest."""
    sizes = np.abs(points[np.abs(points) > 0])
    low, high = (float(sizes.min()), float(sizes.max())) if len(sizes) else (1.0, 1.0)
    if high > 30 * low:
        straight = float(np.median(sizes)) / 10
        axes.set_xscale("symlog", linthresh=straight, linscale=0.6)
        axes.set_yscale("symlog", linthresh=straight, linscale=0.6)
        for axis in (axes.xaxis, axes.yaxis):  # the ticks on either side of zero would lie on each other
            powers = 10.0 ** np.arange(np.ceil(np.log10(1.2 * straight)), np.ceil(np.log10(high)) + 1)
            axis.set_major_locator(FixedLocator([*-powers[::-1], 0.0, *powers]))
            axis.set_minor_locator(NullLocator())
    size = np.geomspace(low / 10, 10 * high, 300)
    for damping in DAMPINGS:
        for sign in (-1, 1):
            axes.plot(-damping * size, sign * np.sqrt(1 - damping**2) * size, color=GRID, linewidth=0.8, zorder=0,
                      scalex=False, scaley=False)
    left, right, up = float(points.real.min()), float(points.real.max()), float(np.abs(points.imag).max())
    room = 0.12 * max(right - left, 1e-9)
    reach = 1.25 * up if up > 0 else max(high, 1.0)
    beyond = float(np.median(sizes)) / 10 if high > 30 * low else 0.05 * high
    axes.set_xlim(1.6 * left if left < 0 else -room, 1.6 * right if right > 0.02 * low else beyond)
    axes.set_ylim(-reach, reach)
    # the damping on each line, just inside the frame where it leaves
    left, top = axes.get_xlim()[0], axes.get_ylim()[1]
    for damping in DAMPINGS:
        rise = float(np.sqrt(1 - damping**2))
        radius = 0.86 * min(top / rise, -left / damping if left < 0 else np.inf)
        axes.annotate(f"{damping:g}", (-damping * radius, rise * radius), fontsize=7, color="#8c8c8c", ha="center",
                      va="center", bbox={"boxstyle": "round,pad=0.1", "facecolor": "white", "linewidth": 0}, zorder=0.5)
    axes.axvspan(0, axes.get_xlim()[1], color="#f6e3da", zorder=0, linewidth=0)
    axes.set_xlabel("real part [1/s]")
    axes.set_ylabel("imaginary part [rad/s]")


def _z_plane(axes: Axes, points: NDArray[np.complex128]) -> None:
    """The unit circle with lines of equal damping and of equal frequency, a tenth of that of the samples apart; where all
    points are close to each other, what is around them."""
    near = points[np.abs(points) <= FAR]
    spans = [(float(part.min()), float(part.max())) if len(part) else (0.0, 0.0) for part in (near.real, near.imag)]
    width = max(high - low for low, high in spans)
    reach = 1.15 * max(1.0, float(np.abs(near).max(initial=0.0)))
    centre, half = ((sum(spans[0]) / 2, sum(spans[1]) / 2), 1.2 * width) if 0 < width < CLOSE else ((0.0, 0.0), reach)
    turn = np.linspace(0, np.pi, 300)
    axes.add_patch(Rectangle((-2 * FAR, -2 * FAR), 4 * FAR, 4 * FAR, color="#f6e3da", zorder=-1))
    axes.add_patch(Circle((0, 0), 1.0, facecolor="white", edgecolor="#8c8c8c", linewidth=0.8, zorder=-0.5))
    for sign in (-1, 1):
        for damping in DAMPINGS:
            line = np.exp(-damping / np.sqrt(1 - damping**2) * turn + 1j * sign * turn)
            axes.plot(line.real, line.imag, color=GRID, linewidth=0.8, zorder=0)
            if sign > 0:
                away = np.maximum(np.abs(line.real - centre[0]), np.abs(line.imag - centre[1]))
                inside = np.flatnonzero(away < 0.9 * half)
                at = line[inside[min(90, len(inside) - 1)]] if len(inside) else line[90]
                axes.annotate(f"{damping:g}", (at.real, at.imag), fontsize=7, color="#8c8c8c", ha="center", va="center",
                              bbox={"boxstyle": "round,pad=0.1", "facecolor": "white", "linewidth": 0}, zorder=0.5,
                              annotation_clip=True)
        for k in range(1, 5):
            natural = np.linspace(0, 1, 100)  # damping ratios along a natural frequency of k/10 of the samples
            s = 2 * np.pi * k / 10 * (-natural + 1j * sign * np.sqrt(1 - natural**2))
            axes.plot(np.exp(s).real, np.exp(s).imag, color=GRID, linewidth=0.8, zorder=0)
    axes.set_xlim(centre[0] - half, centre[0] + half)
    axes.set_ylim(centre[1] - half, centre[1] + half)
    axes.set_aspect("equal")
    axes.set_xlabel("real part of z")
    axes.set_ylabel("imaginary part of z")


def _phase(channel: StateSpace, frequencies: Array, response: NDArray[np.complex128]) -> Array:
    """The phase in degrees of a response (N,), with the multiple of 360 degrees that follows from the poles and zeros.

    A stable or undamped zero adds 0 to 90 degrees, an unstable one subtracts them; poles have the opposite sign. A zero at 0
    adds 90 degrees, a negative gain -180. Without a pole or zero at 0, the phase begins between -180 and 180. If the zeros
    are not found (many states), or not exactly, the phase is continued without jumps."""
    angle = np.degrees(np.angle(response))
    plain = np.asarray(np.degrees(np.unwrap(np.radians(np.where(angle > 180 - 1e-4, angle - 360, angle)))))
    if len(channel.states) > LINEAR_SYSTEM.zeros or channel.higher[1].any() or channel.period is not None:
        return plain
    omega = 2 * np.pi * np.asarray(frequencies, dtype=float)[:, None]

    def turned(roots: NDArray[np.complex128]) -> Array:
        side = np.where(roots.real > LINEAR_SYSTEM.undamped * np.abs(roots), -1.0, 1.0)
        return np.asarray(np.degrees(side * np.arctan2(omega - roots.imag, np.abs(roots.real))).sum(axis=1))

    zeros, poles = channel.zeros(), channel.poles
    course = turned(zeros) - turned(poles)
    course = course - 180 * (round(float(np.median((course - plain) / 180))) % 2)
    if np.all(poles != 0) and np.abs(zeros).min(initial=np.inf) > LINEAR_SYSTEM.free * np.abs(poles).max(initial=0.0):
        course = course - 360 * round((course[0] - plain[0]) / 360)
    phase = np.asarray(angle + 360 * np.round((course - angle) / 360))
    return phase if np.abs(phase - course).max(initial=0.0) < 45 else plain


def _quiet(axes: Axes) -> None:
    axes.grid(True, color=GRID, linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_axisbelow(True)


def channels_figure(system: StateSpace, picture: str) -> Figure:
    """All channels of a system over the frequencies that show them; UsageError for an unknown picture."""
    channels = [system.channel(o, i) for i in system.inputs for o in system.outputs]
    span = np.unique(np.concatenate([channel.frequencies() for channel in channels]))
    if picture == "bode":
        return plot_bode(channels, span)
    if picture == "nyquist":
        return plot_nyquist(channels, span)
    if picture == "poles":
        zeros = {channel_name(c): c.zeros() for c in channels}
        return plot_poles(channels[0].poles, zeros, title="poles and zeros", period=channels[0].period)
    raise UsageError([Problem("picture-unknown", f"there is no picture '{picture}' of a linear system", None,
                              suggest(picture, ("bode", "nyquist", "poles")) or "Pictures: bode, nyquist, poles.")])
