"""Records and FMUs that are dropped on the page, stored in the folder of the diagram: under a plain name, completely or not
at all, and never over another file."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import AsyncIterator
from pathlib import Path
from zipfile import is_zipfile

from heavebond.core.errors import Problem, UsageError, listing
from heavebond.core.writable import confined, make_folder, new_file
from heavebond.records.measurements import SUFFIXES
from heavebond.studio.folder import BUNDLED, Folder

RECORD_BYTES = 500_000_000  # bytes of one file
PLACE = "data"  # the folder for records in the folder of a diagram; FMUs, which are components, are next to the diagram
FMU = ".fmu"
LONGEST = 80  # characters of a name without its suffix


def plain_name(name: str) -> str:
    """The name under which a file is stored: its last part, of letters, digits, `_`, `-` and single dots. UsageError for
    a kind of file that is neither a record nor an FMU."""
    last = re.split(r"[/\\]", name)[-1]
    suffix = Path(last).suffix.lower()
    if suffix not in (*SUFFIXES, FMU):
        raise UsageError([Problem("record-suffix", f"'{last[:80]}' is not a supported format of records", None,
                                  f"Export it as CSV. Supported are {listing(SUFFIXES, 12)}.")])
    stem = re.sub(r"[^\w-]+", "_", last[:-len(suffix)]).strip("_-")[:LONGEST]
    return f"{stem or 'record'}{suffix}"


async def store(folder: Folder, beside: str, name: str, parts: AsyncIterator[bytes]) -> str:
    """Store a file in the folder of the document `beside`; returns its name in the opened folder. An existing file of the
    same name is kept: it is used if its content is the same, else the new one gets a number."""
    base = folder.root if not beside or beside.startswith(BUNDLED) else folder.path(beside).parent
    if not base.is_dir():
        raise UsageError([Problem("file-missing", f"cannot find the folder '{base}'")])
    stored_name = plain_name(name)
    target = base.resolve() / ("" if stored_name.endswith(FMU) else PLACE) / stored_name
    folder.record(target.relative_to(folder.root.resolve()).as_posix(), exists=False)
    for k in range(1, 1000):
        path = target if k == 1 else target.with_stem(f"{target.stem}_{k}")
        if not os.path.lexists(path):  # a broken link occupies a name as well
            break
    try:
        size, digest = 0, hashlib.sha256()
        with confined(folder.root):
            make_folder(target.parent)
        with confined(folder.root), new_file(path, exclusive=True) as fresh:
            with open(fresh, "wb") as file:
                async for part in parts:
                    size += len(part)
                    if size > RECORD_BYTES:
                        raise UsageError([Problem("record-too-large", f"'{target.name}' is larger than "
                                                  f"{RECORD_BYTES // 10**6} MB", None, "Cut it, or thin it out.")])
                    digest.update(part)
                    file.write(part)
            if path.suffix == FMU and not is_zipfile(fresh):
                raise UsageError([Problem("fmu-unusable", f"{target.name} is not an FMU that can be read", None,
                                          "Export it again; it is a ZIP file with a modelDescription.xml.")])
            candidates = [target, *(target.with_stem(f"{target.stem}_{k}") for k in range(2, 1000))]
            same = next((p for p in candidates[:candidates.index(path)] if _digest(folder, p) == digest.digest()), None)
            if same is not None:
                raise _Known(same)
    except _Known as known:
        path = known.path
    except OSError as error:
        message = f"'{target.name}' cannot be stored: {error.strerror or error}"
        raise UsageError([Problem("file-unwritable", message)]) from None
    return path.relative_to(folder.root.resolve()).as_posix()


class _Known(Exception):
    """A file with the same content exists."""

    def __init__(self, path: Path):
        super().__init__()
        self.path = path


def _digest(folder: Folder, path: Path) -> bytes:
    """The digest of a file; empty if it cannot be read, as for a link."""
    try:
        with folder.opened(path) as file:
            return hashlib.file_digest(file, "sha256").digest()
    except OSError:
        return b""
