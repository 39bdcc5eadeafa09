"""Measured inputs of a run: records read, checked and put on one set of polynomial pieces."""

from __future__ import annotations

from dataclasses import dataclass
from zlib import crc32

import numpy as np

from heavebond.core.errors import DataError, Problem, Problems
from heavebond.core.units import check_turns, other_unit, read_unit
from heavebond.equations.flatten import Flat, KnownInput
from heavebond.language.definition import FileInput
from heavebond.numerics.dae import DELAY_ROWS, Array
from heavebond.records.measurements import Table, check_gaps, check_time, column, read_table, samples, timed
from heavebond.records.piecewise import Pieces, align, pieces, smoothed_pieces
from heavebond.records.time_axis import TimeAxis

# Change of an input or of its slope at a break, as a multiple of the mean of all its breaks, above which it is a kink. In a
# record of few breaks less suffices. Origin: a tenth of the breaks at most. Doubled: half as many restarts.
ABRUPT = 10.0
# Change of an input at a break, as a share of its largest value, that is no kink. Origin: rounding of the coefficients.
RESOLVED = 1e-9


@dataclass(frozen=True)
class Pieced:
    """Breaks (m+1,) and the columns u (1 + 4 n, m) of each piece: its first time, then four coefficients per input. So many
    rows of zeros follow for `delayed` variables, whose pieces are known during a run only."""

    breaks: Array
    columns: Array
    delayed: int = 0

    def at(self, times: Array) -> Array:
        """The columns (1 + 4 n, N) that hold at the given times."""
        if not self.columns.size:
            return np.zeros((self.delayed, len(times)))
        index = np.clip(np.searchsorted(self.breaks, times, side="right") - 1, 0, self.columns.shape[1] - 1)
        return self.columns[:, index] if not self.delayed else np.pad(self.columns[:, index], ((0, self.delayed), (0, 0)))

    def inner_breaks(self, begin: float, end: float) -> Array:
        """The breaks strictly between."""
        return self.breaks[(self.breaks > begin) & (self.breaks < end)]

    def kinks(self) -> Array:
        """The breaks at which an input changes abruptly in comparison with its other breaks: steps and spikes after a quiet
        time. A multistep method that carries its history across such a break may accept a step of any error: at the top
        of a symmetric spike its prediction and its corrector agree, as the mean slope before is the slope after."""
        changes, lengths = self.columns.shape[1] - 1, np.diff(self.breaks)
        abrupt = np.zeros(max(changes, 0), bool)
        for k in range(1, len(self.columns) - 1, 4) if changes > 0 else ():
            c, h = self.columns[k:k + 4], lengths
            steps = np.abs(c[0, 1:] - (c[0] + h*(c[1] + h*(c[2] + h*c[3])))[:-1])
            bends = np.abs(c[1, 1:] - (c[1] + h*(2*c[2] + h*3*c[3]))[:-1]) * np.minimum(h[1:], h[:-1])
            jumps = steps + bends
            abrupt |= jumps > min(ABRUPT, changes / ABRUPT) * np.mean(jumps) + RESOLVED * np.abs(c).max(axis=1)[0]
        return self.breaks[1:-1][abrupt]


def pieced(flat: Flat, begin: float, end: float) -> Pieced:
    """Read every measured input of a model; DataError with file and line for faults of a record."""
    if not flat.inputs:
        return Pieced(np.zeros(0), np.zeros((0, 0)), DELAY_ROWS * len(flat.delays))
    problems = Problems()
    pieces_by_input: list[Pieces] = []
    for known in flat.inputs:
        try:
            pieces_by_input.append(read_input(known, begin, end))
        except DataError as error:
            problems.extend(error)
    problems.raise_as(DataError)
    breaks, coefficients = align(pieces_by_input, begin, end, names=[k.name for k in flat.inputs])
    n_pieces = len(breaks) - 1
    columns = np.vstack([breaks[:-1][None, :], coefficients.reshape(n_pieces, -1).T])
    return Pieced(breaks, columns, DELAY_ROWS * len(flat.delays))


def read_input(known: KnownInput, begin: float = -np.inf, end: float = np.inf) -> Pieces:
    """One measured signal in SI, of which the time from `begin` to `end` is wanted."""
    source: FileInput = known.source
    unit = read_unit(source.unit)
    if unit.dimension != known.unit.dimension:
        raise DataError([Problem("unit-wrong", f"{known.name} is in {known.unit.text}; the record gives it in "
                                 f"{source.unit}", source.place, hint=other_unit(unit, known.unit))])
    problems = Problems()
    check_turns(source.unit, known.unit, known.name, source.place, problems)
    problems.raise_as(DataError)
    time, values = input_samples(source, begin, end)
    if source.seed is not None:
        random = np.random.default_rng([source.seed, crc32(known.name.encode())])
        values = values + source.noise * random.standard_normal(len(values))
    if source.smooth is not None:
        return smoothed_pieces(time, unit.to_si(values), source.interpolation, source.smooth)
    return pieces(time, unit.to_si(values), source.interpolation)


def input_samples(source: FileInput, begin: float = -np.inf, end: float = np.inf, *, table: Table | None = None
                  ) -> tuple[Array, Array]:
    """The times (n,) in s and values (n,) of the samples of an input, with its factor, in its unit; rows without a value
    are omitted. `table` is its file where that has been read. DataError for a gap between `begin` and `end` (see
    `check_gaps`) that may not be bridged."""
    table = table or read_table(source.file, place=source.place, beside=source.time.column if source.time else None)
    axis = source.time or TimeAxis(table.header[0])
    table, name = timed(table, axis, zero=source.zero, place=source.place), axis.column
    check_time(table, name)
    rows = samples(table, name, source.column, source.place, least=2)
    scale = axis.scale
    if not source.bridge:
        check_gaps(table, name, {source.column: rows}, begin=begin / scale, end=end / scale)
    return table.columns[name][rows] * scale, column(table, source.column)[rows] * source.factor
