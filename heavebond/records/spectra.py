"""Analysis of an oscillating signal: spectrum, significant values, waves between zero crossings, rainflow cycles.

The spectral density S(f) is Welch's estimate: P. D. Welch, IEEE Trans. Audio Electroacoust. 15 (1967) 70-73,
doi:10.1109/TAU.1967.1161901. Its moments m_n = int f**n S df give the significant height 4 sqrt(m_0) and the mean periods
m_0/m_1 and sqrt(m_0/m_2), the latter the mean period of zero crossings of a normal process (S. O. Rice, Bell Syst. Tech.
J. 24 (1945) 46-156). Waves are counted from one upward crossing of the mean to the next. Rainflow cycles as in ASTM
E1049-85.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from heavebond.core import facade
from heavebond.core.errors import DataError, Problem, UsageError
from heavebond.core.presentation import brief, count, number
from heavebond.core.quantities import si_value
from heavebond.core.units import UnitProblem, read_unit
from heavebond.records.measurements import check_time, column, read_table, samples, timed
from heavebond.records.saved_runs import read_run
from heavebond.records.signal_array import Signal
from heavebond.records.time_axis import TimeAxis

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
UNEVEN = 1e-3  # relative difference of steps that count as even
LEAST = 16  # samples
ROUNDING = 1e-6  # relative to the largest cycle: error of an integrator on a straight line
SEGMENTS = 8  # segments that overlap by half, if a record is long enough for so many
WAVES = 20  # least number of waves in a segment of the spectrum, if the record has them
CLASSES = 20  # of range, in `SignalAnalysis.as_dict`
STILL = 1e-12  # relative size below which a signal counts as constant
_HEAD = re.compile(r"(?P<name>.+?)\s*[\[(](?P<unit>[^\[\]()]*)[\])]\s*")


@dataclass(frozen=True, eq=False)
class EvenSignal:
    """A signal at even steps: `values` (n,) in `unit` at `time` (n,) in s; `note` describes the resampling."""

    name: str
    unit: str
    time: Array
    values: Array
    note: str = ""

    @property
    def step(self) -> float:
        """The time between samples."""
        return float((self.time[-1] - self.time[0]) / (len(self.time) - 1))

    @property
    def length(self) -> float:
        """The time from the first to the last sample."""
        return float(self.time[-1] - self.time[0])


@dataclass(frozen=True, eq=False)
class Spectrum:
    """One-sided density S (k,) in unit**2/Hz over the frequency (k,) in Hz, from `segments` overlapping pieces."""

    frequency: Array
    density: Array
    segments: int

    def moment(self, n: int) -> float:
        """m_n = int f**n S df, by the sum over the lines without frequency zero."""
        width = float(self.frequency[1])
        return float((self.frequency[1:]**n * self.density[1:]).sum() * width)

    @property
    def significant(self) -> float:
        """4 sqrt(m_0), for waves the significant height."""
        return 4 * math.sqrt(self.moment(0))

    @property
    def peak_period(self) -> float:
        """The period of the highest line."""
        return float(1 / self.frequency[1 + int(np.argmax(self.density[1:]))])

    @property
    def mean_period(self) -> float:
        """m_0/m_1."""
        return self.moment(0) / self.moment(1)

    @property
    def crossing_period(self) -> float:
        """sqrt(m_0/m_2)."""
        return math.sqrt(self.moment(0) / self.moment(2))


@dataclass(frozen=True, eq=False)
class Waves:
    """Waves between upward crossings of the mean: heights (w,) from trough to crest, and periods (w,) in s."""

    heights: Array
    periods: Array

    @property
    def significant(self) -> tuple[float, float]:
        """The mean height and period of the highest third; NaN without a wave."""
        if not len(self.heights):
            return math.nan, math.nan
        highest = np.argsort(self.heights)[-math.ceil(len(self.heights) / 3):]
        return float(self.heights[highest].mean()), float(self.periods[highest].mean())


@dataclass(frozen=True, eq=False)
class Cycles:
    """Rainflow cycles: ranges, means and counts (c,), a half cycle counting 0.5."""

    ranges: Array
    means: Array
    counts: Array

    @property
    def number(self) -> float:
        """Number of cycles."""
        return float(self.counts.sum())

    def equivalent(self, slope: float, cycles: float) -> float:
        """Equivalent range: the range that, in so many cycles, causes the damage of all of them, if damage is
        proportional to range**slope (Palmgren-Miner)."""
        return float(((self.counts * self.ranges**slope).sum() / cycles) ** (1 / slope))

    def classes(self, number: int) -> tuple[Array, Array]:
        """The edges (number + 1,) of equal classes of range, and the cycles in each (number,)."""
        most = float(self.ranges.max(initial=0.0)) or 1.0
        counts, edges = np.histogram(self.ranges, number, (0.0, most), weights=self.counts)
        return edges, counts


@dataclass(frozen=True, eq=False)
class SignalAnalysis(facade.Displayed):
    """Complete analysis of one signal; `segment` (s) is the length of the segments of the spectrum, None for automatic
    choice, `slope` the exponent of the S-N curve for the equivalent range.
    """

    course: EvenSignal
    segment: float | None = None
    slope: float = 3.0

    @property
    def mean(self) -> float:
        return float(self.course.values.mean())

    @property
    def deviation(self) -> float:
        return float(self.course.values.std())

    @property
    def still(self) -> bool:
        """True if it is constant."""
        return self.deviation <= STILL * max(float(np.abs(self.course.values).max()), 1e-300)

    @cached_property
    def waves(self) -> Waves:
        return waves(self.course)

    @cached_property
    def spectrum(self) -> Spectrum:
        return spectrum(self.course, self.segment, self.waves)

    @cached_property
    def cycles(self) -> Cycles:
        return rainflow_cycles(self.course.values)

    def as_dict(self) -> dict[str, Any]:
        """The numbers of the signal, in its unit and in s; of a constant one its mean and extremes only."""
        course = self.course
        figures: dict[str, Any] = {"unit": course.unit, "from": float(course.time[0]), "to": float(course.time[-1]),
                                   "step": course.step, "note": course.note, "mean": self.mean,
                                   "deviation": self.deviation, "least": float(course.values.min()),
                                   "most": float(course.values.max())}
        if self.still:
            return figures
        known, counted = self.spectrum, self.waves
        heights = counted.heights.tolist()
        return {**figures, "significant": known.significant, "peak_period": known.peak_period,
                "mean_period": known.mean_period, "crossing_period": known.crossing_period, "segments": known.segments,
                "waves": len(heights), "wave_period": float(counted.periods.mean()) if heights else None,
                "highest_third": counted.significant[0], "period_of_highest_third": counted.significant[1],
                "highest_wave": max(heights, default=None), "cycles": self.cycles.number,
                "largest_range": float(self.cycles.ranges.max()), "slope": self.slope,
                "equivalent_range": self.cycles.equivalent(self.slope, course.length),
                "spectrum": {"frequency": known.frequency.tolist(), "density": known.density.tolist()},
                "ranges": {key: v.tolist() for key, v in zip(("edges", "counts"), self.cycles.classes(CLASSES),
                                                             strict=True)}}

    def __repr__(self) -> str:
        unit = self.course.unit
        return brief(self, self.course.name, f"mean {number(self.mean)} {unit}, standard deviation {number(self.deviation)} "
                     f"{unit}", "" if self.still else f"significant height {number(self.spectrum.significant)} {unit}, peak "
                     f"period {number(self.spectrum.peak_period, 4)} s, {count(len(self.waves.heights), 'wave')}, "
                     f"{number(self.cycles.number)} cycles")

    def plot(self) -> Figure:
        """A matplotlib figure of the signal, its spectrum and its cycles."""
        figure: Figure = facade.call("SignalAnalysis.plot", self)
        return figure


def evenly(name: str, unit: str, time: Array, values: Array) -> EvenSignal:
    """Interpolate a signal linearly to even steps (the median step) if its steps are uneven; DataError for too few
    samples.
    """
    if len(time) < LEAST:
        raise DataError([Problem("signal-short", f"'{name}' has {len(time)} samples, {LEAST} are needed at least", None,
                                 "Take a longer time, or more samples.")])
    steps = np.diff(time)
    step = float(np.median(steps))
    if np.abs(steps - step).max() <= UNEVEN * step:
        return EvenSignal(name, unit, time, values)
    even = time[0] + step * np.arange(int((time[-1] - time[0]) / step * (1 + 1e-9)) + 1)
    return EvenSignal(name, unit, even, np.interp(even, time, values), f"samples put on even steps of {step:.4g} s")


def waves(course: EvenSignal) -> Waves:
    """The waves between upward crossings of the mean, located by linear interpolation."""
    x = course.values - course.values.mean()
    up = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0))
    crossings = up + x[up] / (x[up] - x[up + 1])
    heights = [float(np.ptp(x[a + 1:b + 1])) for a, b in pairwise(up)]
    return Waves(np.array(heights), np.diff(crossings) * course.step)


def spectrum(course: EvenSignal, segment: float | None = None, known: Waves | None = None) -> Spectrum:
    """Welch's density with Hann windows that overlap by half, with the mean of each segment subtracted.

    `segment` (s) is its length; by default an eighth of the record with overlap, longer if it would contain fewer than
    20 waves. UsageError for a segment that does not fit.
    """
    from scipy.signal import welch

    n = len(course.values)
    if segment is None:
        periods = (known or waves(course)).periods
        wanted = WAVES * float(periods.mean()) / course.step if len(periods) else n
        length = int(min(n, max(2 * n / (SEGMENTS + 1), wanted)))
    else:
        length = round(segment / course.step)
        if not LEAST <= length <= n:
            raise UsageError([Problem("segment-wrong", f"a segment of {segment:g} s does not fit: '{course.name}' is "
                                      f"{course.length:g} s long, at steps of {course.step:g} s", None,
                                      f"Take one between {LEAST * course.step:.3g} s and {course.length:.4g} s.")])
    frequency, density = welch(course.values, 1 / course.step, "hann", length, detrend="constant")
    return Spectrum(np.asarray(frequency), np.asarray(density), 1 + (n - length) // (length - length // 2))


def rainflow_cycles(values: Array) -> Cycles:
    """The cycles of samples (n,) by the rules of ASTM E1049-85, 5.4.4; unclosed cycles count as half cycles. Cycles of
    the size of rounding errors, relative to the largest, are omitted."""
    cycles = _extracted(values)
    return Cycles(cycles[:, 0], cycles[:, 1], cycles[:, 2])


def rainflow_ranges(values: Array) -> tuple[Array, Array, NDArray[np.intp]]:
    """The ranges and counts (c,) of the same cycles, and the samples (2, c) at their two ends."""
    cycles = _extracted(values)
    return cycles[:, 0], cycles[:, 2], cycles[:, 3:].T.astype(np.intp)


def _extracted(values: Array) -> Array:
    """Range, mean, count and the two ends (c, 5) of each cycle."""
    from rainflow import extract_cycles

    cycles = np.array([*extract_cycles(values.tolist())]).reshape(-1, 5)
    return np.asarray(cycles[cycles[:, 0] > ROUNDING * cycles[:, 0].max(initial=0.0)])


class Run(Protocol):
    """A run with signals by name: a Result or a SavedRun."""

    def __getitem__(self, name: str) -> Signal:
        raise NotImplementedError


def signal(source: Signal | Run | str | Path, name: str = "", *, begin: float | str = 0.0, until: float | str = float("inf"),
           segment: float | str | None = None, slope: float = 3.0, time: str | None = None) -> SignalAnalysis:
    """Analyse an oscillating signal: spectrum, significant values, waves and rainflow cycles.

    `source` is a signal, a run and the `name` of one of its signals or formulas, or the path of a saved run or of a record
    and the name of a column. The part from `begin` to `until` is evaluated (s or text, `"60 s"`); `segment` is the length of
    the segments over which the spectrum is averaged (Welch), `slope` the exponent of the S-N curve for the equivalent range,
    `time` the column of the times of a record, by default the first. Numbers are in the unit of the signal. Raises
    UsageError for an unknown name or file, DataError for too few samples. Source of the rainflow count: ASTM E1049-85.
    """
    first, last = si_value(begin, "s", "begin"), si_value(until, "s", "until")
    length = None if segment is None else si_value(segment, "s", "segment")
    if isinstance(source, (str, Path)):
        course, = read_courses(Path(source), [name], time=time, begin=first, end=last)
        return SignalAnalysis(course, length, slope)
    if not hasattr(source, "__getitem__"):
        raise UsageError([Problem("signal-source", f"a signal comes from a run, not from a {type(source).__name__}", None,
                                  f'Simulate it first: hb.signal(hb.simulate(...), "{name}").')])
    whole = source if isinstance(source, Signal) else source[name]
    part = whole.between(first, min(last, float(whole.time[-1]))) if whole.time is not None else whole
    axis = part.time
    if axis is None:
        raise UsageError([Problem("time-missing", f"'{whole.name}' has no axis of time", None,
                                  "Take the signal of a run, as in `run[\"crown.x\"]`.")])
    return SignalAnalysis(evenly(part.name, part.unit, axis, part.magnitude), length, slope)


def read_courses(path: Path, names: Sequence[str], *, time: str | None = None, begin: float = 0.0,
                 end: float = float("inf")) -> list[EvenSignal]:
    """Signals of a file between two times (s).

    A saved run has units; in a record `time` is the column of the times in s (the first by default), and a unit is read
    from brackets in the header. DataError and UsageError as for these files.
    """
    try:
        run = read_run(path)
    except DataError as error:
        if time is None and error.problems[0].code != "run-unreadable":
            raise
    except UsageError as error:
        if error.problems[0].code != "file-suffix":
            raise
    else:
        inside = (run.time >= begin) & (run.time <= end)
        return [evenly(name, run.unit(name), run.time[inside], run.display[name][inside]) for name in names]
    table = read_table(path, beside=time)
    time = time or table.header[0]
    table = timed(table, TimeAxis(time))
    check_time(table, time)
    signals = []
    for name in names:
        head = next((h for h in table.header if (m := _HEAD.fullmatch(h)) and m["name"] == name), name)
        rows = samples(table, time, head)
        t = column(table, time)[rows]
        inside = (t >= begin) & (t <= end)
        signals.append(evenly(name, _unit(head), t[inside], column(table, head)[rows][inside]))
    return signals


def _unit(head: str) -> str:
    known = _HEAD.fullmatch(head)
    try:
        return read_unit(known["unit"]).text if known else ""
    except UnitProblem:
        return ""
