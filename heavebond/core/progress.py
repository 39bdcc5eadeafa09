"""How far something long is: a function that is told in words."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str], None]


def numbered(say: Progress, what: str, number: int, of: int) -> Progress:
    """Progress that begins with `start 2 of 5: `, where there are several."""
    return lambda text: say(f"{what} {number} of {of}: {text}" if of > 1 else text)
