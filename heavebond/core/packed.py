"""Serialisation of data that many tasks share: done once, sent to the workers of this program, never written to a file."""

from __future__ import annotations

import pickle
import zlib
from typing import Any


def packed(shared: object) -> bytes:
    """Serialise an object."""
    return zlib.compress(pickle.dumps(shared))


def unpacked(shared: bytes) -> Any:
    """Restore an object that `packed` has serialised, in a process of this program."""
    return pickle.loads(zlib.decompress(shared))
