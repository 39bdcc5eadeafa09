"""The permissions to run programs that files contain: those of external functions, for diagrams that are read in a context,
and those of FMUs, for simulations in a context."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_native: ContextVar[bool] = ContextVar("native code allowed", default=False)
_fmus: ContextVar[bool] = ContextVar("FMUs allowed", default=False)


@contextmanager
def native_code(allowed: bool = True) -> Iterator[None]:
    """Context in which diagrams are loaded with the permission to compile and run the programs of their external functions.

    The permission belongs to the diagrams that are loaded in it, also in later calls with them; with `allowed` False, only
    that of an outer context does. Without it, a diagram with external functions raises ModelError.
    """
    with _granted(_native, allowed):
        yield


@contextmanager
def fmu_code(allowed: bool = True) -> Iterator[None]:
    """Context in which simulations run the programs in FMUs, as with `simulate(model, allow_fmu=True)`; with `allowed`
    False, only if an outer context permits it."""
    with _granted(_fmus, allowed):
        yield


@contextmanager
def _granted(permission: ContextVar[bool], allowed: bool) -> Iterator[None]:
    token = permission.set(allowed or permission.get())
    try:
        yield
    finally:
        permission.reset(token)


def native_allowed() -> bool:
    """True in a context of `native_code`."""
    return _native.get()


def fmu_allowed() -> bool:
    """True in a context of `fmu_code`."""
    return _fmus.get()
