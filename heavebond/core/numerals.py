"""Numbers in text: one grammar for diagrams, records, descriptions of FMUs and the command line.

Python's `float` and `int` also accept underscores between digits (`1_0` is 10) and the digits of every script; here a
number has the digits 0 to 9 only.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

NUMBER = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
_NUMBER = re.compile(NUMBER)
_SPECIAL = re.compile(r"[+-]?(?:nan|inf|infinity)", re.IGNORECASE)
_WHOLE = re.compile(r"[0-9]{1,9}")


def number(text: str) -> float:
    """Convert a text to a number, `nan` and `inf` included; ValueError if it is not one."""
    plain = text.strip()
    if not (_NUMBER.fullmatch(plain) or _SPECIAL.fullmatch(plain)):
        raise ValueError(f"'{text}' is not a number")
    return float(plain)


def whole(text: str) -> int | None:
    """Convert a text of up to nine digits to a whole number; None for any other text."""
    return int(text) if _WHOLE.fullmatch(text) else None


def plain(texts: Sequence[str]) -> bool:
    """True if every text that Python reads as a number is also one here: a test of the characters, for long columns."""
    joined = "".join(texts)
    return joined.isascii() and "_" not in joined
