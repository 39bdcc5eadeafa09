"""Linear algebra in one thread.

The matrices here have a few columns. Libraries that split such a product or factorisation over all processors wait for their
threads longer than they compute: where processes run side by side, a thousand times as long.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


def single() -> None:
    """From now on, in this process."""
    from threadpoolctl import threadpool_limits

    threadpool_limits(1, "blas")


def single_threaded(function: Callable[P, T]) -> Callable[P, T]:
    """The function with one thread while it runs."""

    @wraps(function)
    def limited(*args: P.args, **named: P.kwargs) -> T:
        from threadpoolctl import threadpool_limits

        with threadpool_limits(1, "blas"):
            return function(*args, **named)

    return limited
