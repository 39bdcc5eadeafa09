"""What many tasks share, as it is sent to the workers of this program: serialised once, never written to a file."""

from __future__ import annotations

import pickle
import zlib
from typing import Any


def packed(shared: object) -> bytes:
    """An object of this program as bytes."""
    return zlib.compress(pickle.dumps(shared))


def unpacked(shared: bytes) -> Any:
    """The object that `packed` was given, by a process of this program."""
    return pickle.loads(zlib.decompress(shared))
