"""Atomic writing of output files, and checks whether a file can be written.

Every output file is written by `new_file` or `write_text`: under a temporary name in the same folder, flushed to the disk,
and then renamed. After a full disk, a killed process or an error the previous file is unchanged, or there is none.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from heavebond.core.errors import Problem, UsageError

LONGEST_STEM = 100  # characters of the name that the name of an unfinished file repeats; a name may have 255 bytes


@contextmanager
def new_file(path: str | Path, *, exclusive: bool = False) -> Iterator[Path]:
    """A path with the same suffix to write to; what stands there at the end takes the place of `path` in one step.

    Devices and pipes are written directly. With `exclusive` FileExistsError where `path` exists at the end. OSError names
    `path`, not the unfinished file.
    """
    target = Path(os.path.realpath(path))
    if target.exists() and not target.is_file():
        yield target
        return
    fresh = target.with_name(f".{target.stem[:LONGEST_STEM]}.{os.urandom(4).hex()}.new{target.suffix}")
    try:
        try:
            os.close(os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
            yield fresh
            _flush(fresh)
            _rename(fresh, target, exclusive)
        except BaseException:
            with suppress(OSError):
                fresh.unlink()
            raise
    except OSError as error:
        if error.filename in (None, str(fresh), fresh):
            raise type(error)(error.errno, error.strerror or str(error), str(path)) from error
        raise


def write_text(path: str | Path, text: str, *, exclusive: bool = False) -> None:
    """Write a text as UTF-8 with line feeds, whole or not at all; see `new_file`."""
    with new_file(path, exclusive=exclusive) as fresh, open(fresh, "w", encoding="utf-8", newline="\n") as file:
        file.write(text)


def _flush(path: Path) -> None:
    # r+: Windows flushes only what is open for writing
    with open(path, "rb+") as file:
        os.fsync(file.fileno())


def _rename(fresh: Path, target: Path, exclusive: bool) -> None:
    if exclusive:
        # a link fails where the name is taken; some file systems have none
        try:
            os.link(fresh, target)
            fresh.unlink()
        except FileExistsError:
            raise
        except OSError:
            if target.exists():
                raise FileExistsError(17, "File exists", str(target)) from None
            os.replace(fresh, target)
    else:
        with suppress(OSError):
            os.chmod(fresh, target.stat().st_mode & 0o777)
        os.replace(fresh, target)
    if hasattr(os, "O_DIRECTORY"):  # the rename itself reaches the disk with its folder
        with suppress(OSError):
            folder = os.open(target.parent, os.O_RDONLY | os.O_DIRECTORY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)


def why_unwritable(folder: Path) -> str:
    """Why no file can be made in a folder, in a few words; empty where one can.

    One is made and gone at once: rights alone do not tell of a medium that is read only, or full.
    """
    if not folder.is_dir():
        return f"there is no folder '{folder}'"
    import tempfile  # not needed where nothing is written

    try:
        with tempfile.TemporaryFile(dir=folder):
            return ""
    except OSError as error:
        return (error.strerror or str(error)).lower()


def make_folder(folder: Path) -> None:
    """Make a folder and its parents where they do not exist; UsageError where that fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        said = f"the folder '{folder}' cannot be made: {(error.strerror or str(error)).lower()}"
        raise UsageError([Problem("file-unwritable", said, None, "Give another one.")]) from None
