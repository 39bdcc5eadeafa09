"""Dates and times of day in the formats of data loggers, converted to ns if their reading is unambiguous.

Formats: ISO 8601 (`2024-05-01 12:00:03.250`, with `T` or a zone), the same with slashes, days first with dots
(`01.05.2024 12:00:03`), and times of day (`12:00:03`), each with decimal points or commas. With slashes the order of day
and month must follow from the dates: one number above twelve, or all the same.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Moments = NDArray[np.int64]
NONE = np.iinfo(np.int64).min  # missing value of NumPy and pandas
DAY = 86_400_000_000_000  # ns
MISSING = {"", "nan", "na", "n/a", "nat", "null", "none", "-", "?"}
_TIME = r"(?P<time>[0-9]{1,2}:[0-9]{2}:[0-9]{2}(\.[0-9]{1,9})?|[0-9]{1,2}:[0-9]{2})"
_YEAR_FIRST = re.compile(rf"(?P<year>[0-9]{{4}})[-/](?P<month>[0-9]{{1,2}})[-/](?P<day>[0-9]{{1,2}})([T ]{_TIME})?"
                         r"(?P<zone>Z|[+-][0-9]{2}:?[0-9]{2})?")
_YEAR_LAST = re.compile(rf"(?P<one>[0-9]{{1,2}})(?P<mark>[./-])(?P<two>[0-9]{{1,2}})[./-](?P<year>[0-9]{{4}})( {_TIME})?")
_OF_DAY = re.compile(r"(?P<h>[0-9]{1,2}):(?P<m>[0-9]{2}):(?P<s>[0-9]{2})(\.(?P<f>[0-9]{1,9}))?")
_SHORT = re.compile(r"[0-9]{1,3}:[0-9]{2}(\.[0-9]+)?")


@dataclass(frozen=True, eq=False)
class Clock:
    """The times (n,) of a column in ns, NONE for an empty cell: since 1970 if they are `dated`, else since midnight of
    the first day."""

    moments: Moments
    dated: bool

    @property
    def first(self) -> int:
        known = self.moments[self.moments != NONE]
        return int(known[0]) if len(known) else 0

    def seconds(self, since: int) -> NDArray[np.float64]:
        """Seconds (n,) since a moment, NaN for a missing one."""
        # the difference in integer ns first: a float of the seconds since 1970 resolves half a microsecond only
        return np.where(self.moments == NONE, np.nan, (self.moments - since) * 1e-9)


class ClockProblem(ValueError):
    """The cell in `row` cannot be read as a time, or is ambiguous; `hint` states what to type."""

    def __init__(self, message: str, hint: str, row: int):
        super().__init__(message)
        self.message, self.hint, self.row = message, hint, row


def read_clock(cells: Sequence[str]) -> Clock:
    """Convert a column of text to times; ClockProblem at the first cell that is not a time, or is ambiguous."""
    texts = [cell.strip().replace(",", ".") for cell in cells]
    known = [k for k, text in enumerate(texts) if text.lower() not in MISSING]
    if known and _OF_DAY.fullmatch(texts[known[0]]):
        # times of day; a decrease by more than half a day is a passage of midnight
        moments = np.full(len(texts), NONE, dtype=np.int64)
        days, before = 0, 0
        for k in known:
            time_match = _OF_DAY.fullmatch(texts[k])
            if time_match is None or int(time_match["m"]) > 59 or int(time_match["s"]) > 59:
                raise _unreadable(texts[k], k)
            seconds = 3600 * int(time_match["h"]) + 60 * int(time_match["m"]) + int(time_match["s"])
            moment = 1_000_000_000 * seconds + int((time_match["f"] or "").ljust(9, "0"))
            days += before - moment > DAY // 2
            moments[k], before = days * DAY + moment, moment
        return Clock(moments, False)
    if known and _SHORT.fullmatch(texts[known[0]]):
        raise ClockProblem(f"'{cells[known[0]].strip()}' may be hours and minutes, or minutes and seconds",
                           "Export the times as hours:minutes:seconds, such as 12:05:00, or as seconds.", known[0])
    moments = np.full(len(texts), NONE, dtype=np.int64)
    if known:
        import pandas as pd

        date_matches = [_YEAR_FIRST.fullmatch(texts[k]) or _YEAR_LAST.fullmatch(texts[k]) for k in known]
        for k, date_match in zip(known, date_matches, strict=True):
            if date_match is None:
                raise _unreadable(cells[k].strip(), k)
        matches = [date_match for date_match in date_matches if date_match is not None]
        swapped = _day_first(matches, [cells[k].strip() for k in known], known)
        written = [_iso(date_match, swapped) for date_match in matches]
        read = pd.to_datetime(pd.Series(written), format="ISO8601", utc=True, errors="coerce")
        wrong = np.flatnonzero(read.isna().to_numpy())
        if len(wrong):
            raise _unreadable(cells[known[wrong[0]]].strip(), known[wrong[0]])
        moments[known] = np.asarray(read.dt.tz_localize(None).to_numpy().astype("datetime64[ns]").astype(np.int64))
    return Clock(moments, True)


def _iso(match: re.Match[str], day_first: bool) -> str:
    parts = match.groupdict()
    day, month = (parts["day"], parts["month"]) if "day" in parts else \
        (parts["one"], parts["two"]) if day_first else (parts["two"], parts["one"])
    hour, minutes = (parts["time"] or "00:00").split(":", 1)
    return f"{parts['year']}-{month:0>2}-{day:0>2}T{hour:0>2}:{minutes}{parts.get('zone') or ''}"


def _day_first(matches: Sequence[re.Match[str]], cells: Sequence[str], known: Sequence[int]) -> bool:
    """True if the day is before the month in dates with the year last; ClockProblem if the order is ambiguous."""
    dates = [(int(match["one"]), int(match["two"])) for match in matches if match.re is _YEAR_LAST]
    if not dates or all(match["mark"] == "." for match in matches if match.re is _YEAR_LAST) or any(a > 12 for a,
                                                                                                    _ in dates):
        return True
    if any(b > 12 for _, b in dates) or len(set(dates)) == 1:
        return False
    k = next(k for k, match in enumerate(matches) if match.re is _YEAR_LAST)
    raise ClockProblem(f"'{cells[k]}' is ambiguous: day and month could be exchanged",
                       "Export the dates as 2024-05-01 12:00:03, or the times as seconds.", known[k])


def _unreadable(cell: str, row: int) -> ClockProblem:
    return ClockProblem(f"'{cell}' is neither a number nor a time of a clock that can be read",
                        "Export the times as seconds, as 12:00:03.25 or as 2024-05-01 12:00:03.25.", row)
