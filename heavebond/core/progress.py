"""Progress callbacks of long computations: functions that take a line of text."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str], None]


def numbered(say: Progress, subject: str, number: int, of: int) -> Progress:
    """A callback that puts `{what} 2 of 5: ` before each text; with `of` = 1 the text is passed on unchanged."""
    return lambda text: say(f"{subject} {number} of {of}: {text}" if of > 1 else text)


def duration(seconds: float) -> str:
    """`25 s`, `1 min 05 s`, `2 h 10 min`."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    return f"{whole // 60} min {whole % 60:02d} s" if whole < 3600 else f"{whole // 3600} h {whole % 3600 // 60:02d} min"
