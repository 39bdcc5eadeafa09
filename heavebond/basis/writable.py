"""Whether a file can be made in a folder, found out before what would be lost is computed."""

from __future__ import annotations

import tempfile
from pathlib import Path


def why_unwritable(folder: Path) -> str:
    """Why no file can be made in a folder, in a few words; empty where one can.

    One is made and gone at once: rights alone do not tell of a medium that is read only, or full.
    """
    if not folder.is_dir():
        return f"there is no folder '{folder}'"
    try:
        with tempfile.TemporaryFile(dir=folder):
            return ""
    except OSError as error:
        return (error.strerror or str(error)).lower()
