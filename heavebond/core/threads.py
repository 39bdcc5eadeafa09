"""Restriction of linear algebra libraries to one thread.

The matrices here have few columns. Libraries that split such a product or factorisation over all processors spend more time
on synchronisation than on computation: with several processes in parallel, a thousand times as much.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import lru_cache, wraps
from typing import TYPE_CHECKING, ParamSpec, TypeVar

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

P = ParamSpec("P")
T = TypeVar("T")


def single() -> AbstractContextManager[object]:
    """Restrict this process to one thread from now on, or, as a context, until its end."""
    limits: AbstractContextManager[object] = _libraries(len(sys.modules)).limit(limits=1, user_api="blas")
    return limits


@lru_cache(maxsize=1)
def _libraries(imported: int) -> ThreadpoolController:
    """The libraries that this process has loaded, which take a millisecond to find; more come with further imports."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def single_threaded(function: Callable[P, T]) -> Callable[P, T]:
    """Decorator: run the function with one thread."""

    @wraps(function)
    def limited(*args: P.args, **named: P.kwargs) -> T:
        with single():
            return function(*args, **named)

    return limited
