"""Checks for wrong columns of a record: a frozen sensor, swapped columns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from heavebond.core.presentation import number
from heavebond.core.units import read_unit
from heavebond.estimation.experiment import Experiment, Record
from heavebond.language.definition import FileInput
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.inputs import input_samples


@dataclass(frozen=True)
class ColumnCheckConstants:
    """The constants of the checks for frozen sensors and swapped columns. Origin of all: records of machines at rest, and of
    steps.

    frozen: least share of the samples of a record in which a frozen sensor repeats one value. Doubled: shorter failures are
    not reported.
    frozen_samples: least number of such samples. Doubled: short records are not checked.
    moving: least share of its range along the record that the model, or for an input the most active channel, moves
    meanwhile. Doubled: failures during slow motions are not reported.
    alike: least correlation of input and output at which their order in time is meaningful. Doubled: no exchange is ever
    reported.
    tie: share of the largest correlation above which the smallest delay is chosen. Doubled: the lead of a periodic motion is
    overestimated.
    lead: least number of samples by which an output leads its input if the columns are swapped. Doubled: slower exchanges
    of energy are not reported.
    """

    frozen: float = 0.2
    frozen_samples: int = 30
    moving: float = 0.3
    alike: float = 0.7
    tie: float = 0.98
    lead: int = 2


COLUMN_CHECKS = ColumnCheckConstants()


class ComparedChannel(Protocol):
    """Data of a channel for the checks: times, readings and model (n,) in its unit."""

    @property
    def name(self) -> str: ...
    @property
    def unit(self) -> str: ...
    @property
    def time(self) -> Array: ...
    @property
    def measured(self) -> Array: ...
    @property
    def model(self) -> Array: ...


def frozen_notes(experiment: Experiment, record: Record, channels: Mapping[str, ComparedChannel]) -> tuple[str, ...]:
    """A note for each sensor that repeats one value for much of a record while the model, or another channel, moves."""
    notes = []
    for c in channels.values():
        stretch = _frozen(c.measured)
        if stretch is not None and np.ptp(c.model[stretch]) > COLUMN_CHECKS.moving * np.ptp(c.model):
            notes.append(_frozen_note(c.name, c.time, c.measured, c.unit, stretch, "the model moves on"))
    for name, file_input in experiment.inputs_for(record).items():
        if file_input.interpolation == "hold":  # a command stays as it is
            continue
        time, values = _samples(file_input)
        stretch = _frozen(values)
        if stretch is None:
            continue
        first, last = time[stretch.start], time[stretch.stop - 1]
        # after the input has come to rest the machine settles: its second half counts
        moving = [c for c in channels.values() for later in [(c.time > (first + last) / 2) & (c.time <= last)]
                  if later.sum() > 2 and np.ptp(c.measured[later]) > COLUMN_CHECKS.moving * np.ptp(c.measured)]
        if moving:
            notes.append(_frozen_note(name, time, values, file_input.unit, stretch, f"{moving[0].name} moves on"))
    return tuple(notes)


def swapped_notes(experiment: Experiment, record: Record, assembly: Assembly, channels: Mapping[str, ComparedChannel]
                  ) -> tuple[str, ...]:
    """A note for an output that leads an input of the same kind, which it follows in the model."""
    notes = []
    for name, file_input in experiment.inputs_for(record).items():
        time, values = _samples(file_input)
        for c in channels.values():
            if read_unit(file_input.unit).dimension != read_unit(c.unit).dimension:
                continue
            u = np.interp(c.time, time, values)
            measured, model = _lag(u, c.measured), _lag(u, c.model)
            if measured is not None and model is not None and measured <= -COLUMN_CHECKS.lead and model >= 0:
                lead = -measured * float(np.median(np.diff(c.time)))
                output = experiment.outputs[c.name]
                notes.append(f"{c.name} leads the input {name} by {number(lead, 3)} s, whereas it follows it in the model: "
                             f"are the columns '{file_input.column}' and '{output.column}' swapped?")
    return tuple(notes)


def prescribing_inputs(assembly: Assembly) -> frozenset[str]:
    """The inputs that prescribe a variable which a node shares: the position of a shaker, the voltage of a source."""
    flat = assembly.flat
    names = set()
    for known in flat.inputs:
        part, _, signal = known.name.rpartition(".")
        leaf = flat.expanded.leaves.get(part)
        if leaf is None or signal not in leaf.component.signals:
            continue
        dimension = leaf.component.signals[signal].unit.dimension
        shared = [d.members[m].unit.dimension for port in leaf.component.ports
                  if (d := flat.domains.get(f"{part}.{port}")) is not None for m in (*d.across, *d.positions)]
        if leaf.component.power == "source" and dimension in shared:
            names.add(known.name)
    return frozenset(names)


def _samples(file_input: FileInput) -> tuple[Array, Array]:
    return input_samples(replace(file_input, bridge=True))


def _frozen(values: Array) -> slice | None:
    """The longest interval of constant value, if it is long and the series is not constant."""
    if not len(values) or not np.ptp(values):
        return None
    edges = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1, [len(values)]])
    k = int(np.argmax(np.diff(edges)))
    length = edges[k + 1] - edges[k]
    enough = length >= max(COLUMN_CHECKS.frozen_samples, COLUMN_CHECKS.frozen * len(values))
    return slice(int(edges[k]), int(edges[k + 1])) if enough else None


def _frozen_note(name: str, time: Array, values: Array, unit: str, stretch: slice, moves: str) -> str:
    first, last = (number(float(time[k]), 6) for k in (stretch.start, stretch.stop - 1))
    share = number(100 * (stretch.stop - stretch.start) / len(values), 2)
    value = f"{number(float(values[stretch.start]), 6)} {unit}".removesuffix(" 1")
    return f"{name} stays at exactly {value} from {first} s to {last} s ({share} % of the record) while {moves}: if its " \
        "sensor is frozen, leave this part out (`from:` and `to:` at this record)"


def _lag(u: Array, y: Array) -> int | None:
    """Delay of y (n,) after u (n,) in samples at their largest correlation; None if it is small."""
    n = len(u)
    a, b = u - u.mean(), y - y.mean()
    size = float(np.sqrt((a @ a) * (b @ b)))
    if n < COLUMN_CHECKS.frozen_samples or not size > 0:
        return None
    most = n // 4
    padded = 2 * n
    whole = np.fft.irfft(np.fft.rfft(b, padded) * np.conj(np.fft.rfft(a, padded)), padded)
    lags = np.arange(-most, most + 1)
    correlation = whole[lags] / size
    if correlation.max() < COLUMN_CHECKS.alike:
        return None
    near = lags[correlation >= COLUMN_CHECKS.tie * correlation.max()]
    # among equal peaks of a periodic motion the one at the smallest lag; within it the highest point
    lag = int(near[np.argmin(np.abs(near))])
    step = int(np.sign(lag))
    while step and abs(lag) < most and correlation[lag + step + most] > correlation[lag + most]:
        lag += step
    return lag
