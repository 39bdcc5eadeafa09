"""Candidate inputs for the next experiment: shapes within the range of the existing records.

Limits of an input are its extreme values in the records and, if it is position-like (`interpolation: spline`), the
largest rate in them. Every shape begins at the first value of the records, at rest, and is scaled about that value until
value and rate are within the limits.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from heavebond.equations.flatten import KnownInput
from heavebond.estimation.experiment import Experiment
from heavebond.numerics.dae import Array
from heavebond.numerics.inputs import read_input
from heavebond.records.piecewise import Pieces, evaluate

PER_PERIOD = 10  # samples per period of the fastest sine
SLOWEST = 3  # periods of the slowest sine in the record
FREQUENCIES = 7
EASE = 15  # part of its length over which a shape is faded in
LEAST = 0.01  # share of the largest amplitude below which a motion is too small
USUAL = 99.5  # percentile of |rate| in a record that counts as the largest: single samples are noise


@dataclass(frozen=True)
class Limits:
    """Limits of an input in the records, in SI: lowest and highest value, largest |rate| (infinite if it may jump), the
    first value, and the mean of the first record: the required average of a valve that drives a cylinder."""

    low: float
    high: float
    rate: float
    start: float
    rest: float

    @property
    def half(self) -> float:
        """The largest amplitude."""
        return (self.high - self.low) / 2

    @property
    def middle(self) -> float:
        return (self.high + self.low) / 2

    def inside(self, values: Array, step: float) -> Array:
        """Values (N,), `step` seconds apart, scaled about the start until they are within the limits."""
        away = values - self.start
        room = min(_share(self.high - self.start, float(away.max())), _share(self.start - self.low, float(-away.min())))
        fastest = float(np.abs(np.gradient(away, step)).max())
        return np.asarray(self.start + min(room, _share(self.rate, fastest)) * away)


def _share(most: float, wanted: float) -> float:
    return min(1.0, most / wanted) if wanted > 0 else 1.0


@dataclass(frozen=True)
class Proposal:
    """A candidate input: its name, its shape in words, its values (N,) in SI, their mean level and amplitude (half of
    highest minus lowest), and the frequency in Hz if there is one."""

    input: str
    shape: str
    values: Array
    frequency: float | None = None

    @property
    def amplitude(self) -> float:
        return float(np.ptp(self.values)) / 2

    @property
    def level(self) -> float:
        return float(self.values.max() + self.values.min()) / 2


@dataclass(frozen=True)
class Recorded:
    """An input in the records: each by name from its begin, at common times (N,), and the limits over all."""

    limits: Limits
    courses: dict[str, Array]


def recorded(experiment: Experiment, known: KnownInput, time: Array) -> Recorded:
    """Values and limits of one input in the records of an experiment; `time` (N,) s begins at 0. A shorter record keeps
    its last value. Raises DataError for files that cannot be read."""
    courses: dict[str, Array] = {}
    values, rates, starts = [], [0.0], []
    for record in experiment.records.values():
        file_input = experiment.inputs_for(record).get(known.name)
        if file_input is None:
            continue
        signal = read_input(replace(known, source=file_input))
        begin = signal.breaks[0] if record.begin is None else max(record.begin, signal.breaks[0])
        end = signal.breaks[-1] if record.end is None else min(record.end, signal.breaks[-1])
        at = signal.breaks[(signal.breaks >= begin) & (signal.breaks <= end)]
        values.append(evaluate(signal, at))
        rates.append(_rate(signal, at))
        starts.append(float(values[-1][0]))
        courses[record.name] = evaluate(signal, np.minimum(time + begin, end))
    every = np.concatenate(values)
    fastest = max(rates) if known.source.interpolation == "spline" else np.inf
    return Recorded(Limits(float(every.min()), float(every.max()), fastest, starts[0], float(values[0].mean())),
                    courses)


def _rate(signal: Pieces, at: Array) -> float:
    """The largest |du/dt| over four samples, which average some of their noise."""
    if len(at) < 6:
        return float(np.abs(evaluate(signal, at, 1)).max())
    values = evaluate(signal, at)
    return float(np.percentile(np.abs(values[4:] - values[:-4]) / (at[4:] - at[:-4]), USUAL))


def family(name: str, time: Array, seen: Recorded) -> list[Proposal]:
    """All shapes for one input at even times (N,) s from 0 on."""
    step, length, limits = float(time[1] - time[0]), float(time[-1]), seen.limits
    grid = np.geomspace(SLOWEST / length, max(1 / (PER_PERIOD * step), 2 * SLOWEST / length), FREQUENCIES)
    draw = _Draw(time, limits)
    shapes: list[tuple[str, Array, float | None]] = [
        (f"the record '{record}' {how}", limits.rest + share * (course - limits.rest), None)
        for record, course in list(seen.courses.items())[:3]
        for share, how in ((-1.0, "with its sign changed"), (0.5, "at half its size"), (0.25, "at a quarter of its size"))]
    shapes += [("sine", draw.sine(f), f) for f in grid]
    shapes += [("sine", draw.sine(f, most=0.3), f) for f in grid[::2] if draw.amplitude(f) > 0.3 * limits.half]
    shapes += [("sine with growing amplitude", draw.sine(f, over=lambda t: 0.05 + 0.95 * t), f) for f in grid]
    shapes += [("sine about a shifted mean", draw.sine(f, most=0.4, about=about), f)
               for f in (grid[1], grid[3]) for about in (-0.5, 0.5)]
    shapes += [("sine after rest, and rest again", draw.sine(f, over=_twice), f) for f in (grid[1], grid[3])]
    shapes += [("sweep of sines, slow to fast", draw.sweep(grid[0], grid[-1], most), None) for most in (1.0, 0.3)]
    shapes += [("triangle", draw.triangle(periods), periods / length) for periods in (1, 2, 4)]
    shapes += [("staircase", draw.levels([0, 0.5, 1, 0.5, 0, -0.5, -1, -0.5, 0]), None),
               ("steps", draw.levels([0, 1, -1, 1, -1, 0]), None),
               ("small steps", draw.levels([0, 0.2, 0, -0.2, 0, 0.2, -0.2, 0]), None)]
    proposals = [Proposal(name, shape, limits.inside(draw.eased(values), step), f) for shape, values, f in shapes]
    return [p for p in proposals if p.amplitude > LEAST * limits.half]


def _twice(share: Array) -> Array:
    """Motion in the second and the fourth quarter."""
    return np.where((share * 4).astype(int) % 2 == 1, np.sin(np.pi * (share * 4 % 1)) ** 0.5, 0.0)


class _Draw:
    """Shapes within limits at times (N,)."""

    def __init__(self, time: Array, limits: Limits):
        self.time, self.limits = time, limits
        self.step = float(time[1] - time[0])

    def eased(self, values: Array) -> Array:
        """Fade in from the start value, without a jump of the rate."""
        x = np.clip(self.time / self.time[-1] * EASE, 0.0, 1.0)
        start = self.limits.start
        return np.asarray(start + (3 * x**2 - 2 * x**3) * (values - start))

    def amplitude(self, frequency: Array | float, most: float = 1.0) -> Array:
        """Largest amplitude within the limits of value and rate."""
        return np.minimum(most * self.limits.half, self.limits.rate / (2 * np.pi * np.asarray(frequency)))

    def sine(self, frequency: float, most: float = 1.0, about: float = 0.0,
             over: Callable[[Array], Array] = lambda share: np.ones_like(share)) -> Array:
        """A sine whose amplitude is multiplied by `over` (1 at most), a function of the elapsed share of the time;
        `about` shifts its mean, in units of the largest amplitude."""
        limits = self.limits
        around = limits.middle + about * limits.half
        if about == 0.0:  # a small one stays at the mean of the records
            room = float(self.amplitude(frequency, most))
            around = float(np.clip(limits.rest, limits.low + room, limits.high - room))
        course = over(self.time / self.time[-1]) * np.sin(2 * np.pi * frequency * self.time)
        return np.asarray(around + self.amplitude(frequency, most) * course)

    def sweep(self, low: float, high: float, most: float) -> Array:
        """Frequency sweep, logarithmic in time."""
        ratio = np.log(high / low) / self.time[-1]
        f = low * np.exp(ratio * self.time)
        return np.asarray(self.limits.middle + self.amplitude(f, most) * np.sin(2 * np.pi * (f - low) / ratio))

    def triangle(self, periods: int) -> Array:
        """Triangle of constant speed, with rounded corners."""
        x = self.time / self.time[-1] * periods
        course = 2 / np.pi * np.arcsin(np.sin(2 * np.pi * x))
        return self.limits.middle + self.limits.half * self._rounded(course, self.time[-1] / (30 * periods))

    def levels(self, levels: Sequence[float]) -> Array:
        """Successive levels; if the rate is limited, the duration of each step follows from it."""
        index = np.minimum((self.time / self.time[-1] * len(levels)).astype(int), len(levels) - 1)
        course = np.array(levels)[index]
        highest = float(np.abs(np.diff(levels)).max()) * self.limits.half
        # a step smoothed over an interval w has the largest rate 2/w
        stretch = 2 * highest / self.limits.rate if np.isfinite(self.limits.rate) and self.limits.rate > 0 else 0.0
        return self.limits.middle + self.limits.half * self._rounded(course, stretch)

    def _rounded(self, course: Array, stretch: float) -> Array:
        """Weighted moving average over an interval of time; an input that may jump is unchanged."""
        if not np.isfinite(self.limits.rate):
            return course
        width = int(np.clip(stretch / self.step, 5, len(course) // 6)) | 1
        window = np.hanning(width + 2)[1:-1]
        padded = np.pad(course, width // 2, mode="edge")
        return np.convolve(padded, window / window.sum(), mode="valid")
