"""The times of the rows of a measured file: a column, or equal steps."""

from __future__ import annotations

from dataclasses import dataclass

from heavebond.core.units import read_unit

STEPS = "\0steps"  # the column of a table to which times of equal steps are written; no column of a file has this name

FIXED_RATE = "Rows of a fixed rate without times: `time: {every: 10 ms}`, or `heavebond new --every '10 ms'`."


@dataclass(frozen=True)
class TimeAxis:
    """The times of the rows of a file: its column `column` in `unit`; or, if `every` is given, equal steps of `every` (s)
    from the first row at `start` (s) on, for a file without times (`column` is `STEPS` then)."""

    column: str = STEPS
    unit: str = "s"
    every: float | None = None
    start: float = 0.0

    @property
    def scale(self) -> float:
        """Seconds per `unit`."""
        return read_unit(self.unit).scale
