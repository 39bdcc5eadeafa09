"""The permission to compile and run the programs of external functions, for files that are read in a context."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_allowed: ContextVar[bool] = ContextVar("native code allowed", default=False)


@contextmanager
def native_code(allowed: bool = True) -> Iterator[None]:
    """Context in which diagrams are loaded with the permission to compile and run the programs of their external functions.

    The permission belongs to the diagrams that are loaded in it, also in later calls with them; with `allowed` False, only
    that of an outer context does. Without it, a diagram with external functions raises ModelError.
    """
    token = _allowed.set(allowed or _allowed.get())
    try:
        yield
    finally:
        _allowed.reset(token)


def native_allowed() -> bool:
    """True in a context of `native_code`."""
    return _allowed.get()
