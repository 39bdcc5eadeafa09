"""Restriction of linear algebra libraries to one thread.

The matrices here have few columns. Libraries that split such a product or factorisation over all processors spend more time
on synchronisation than on computation: with several processes in parallel, a thousand times as much.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


def single() -> None:
    """Restrict this process to one thread from now on."""
    from threadpoolctl import threadpool_limits

    threadpool_limits(1, "blas")


def single_threaded(function: Callable[P, T]) -> Callable[P, T]:
    """Decorator: run the function with one thread."""

    @wraps(function)
    def limited(*args: P.args, **named: P.kwargs) -> T:
        from threadpoolctl import threadpool_limits

        with threadpool_limits(1, "blas"):
            return function(*args, **named)

    return limited
