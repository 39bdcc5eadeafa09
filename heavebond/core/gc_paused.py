"""Suspension of Python's cyclic garbage collection while many long-lived objects are created."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def put_off() -> Iterator[None]:
    """Disable the cyclic garbage collector in the body of a `with` statement.

    While hundreds of thousands of long-lived objects are created, each collection traverses all of them again. Reference
    counting still frees objects without cycles.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
