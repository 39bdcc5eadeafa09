"""Restriction of linear algebra libraries to one thread.

The matrices here have few columns. Libraries that split such a product or factorisation over all processors spend more time
on synchronisation than on computation: with several processes in parallel, a thousand times as much.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import wraps
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


def single() -> AbstractContextManager[object]:
    """Restrict this process to one thread from now on, or, as a context, until its end."""
    from threadpoolctl import threadpool_limits

    limits: AbstractContextManager[object] = threadpool_limits(1, "blas")
    return limits


def single_threaded(function: Callable[P, T]) -> Callable[P, T]:
    """Decorator: run the function with one thread."""

    @wraps(function)
    def limited(*args: P.args, **named: P.kwargs) -> T:
        with single():
            return function(*args, **named)

    return limited
