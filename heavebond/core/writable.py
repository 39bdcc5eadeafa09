"""Atomic writing of output files, and checks whether a file can be written.

Every output file is written by `new_file` or `write_text`: under a temporary name in the same folder, flushed to the disk,
and then renamed. After a full disk, a killed process or an error the previous file is unchanged, or there is none.
"""

from __future__ import annotations

import errno
import itertools
import os
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

from heavebond.core.errors import Problem, UsageError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

LONGEST_STEM = 100  # characters of the name that are repeated in the name of an unfinished file; a name may have 255 bytes
UNFINISHED = re.compile(r"\..*\.[0-9a-f]{8}\.new(\.\w+)?")  # the names of unfinished files
DESCRIPTORS = os.open in os.supports_dir_fd  # True if the system can open files relative to the descriptor of a folder
FOLDER = os.O_RDONLY | getattr(os, "O_DIRECTORY", 0) | getattr(os, "O_CLOEXEC", 0)
NO_LINK = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0)
_root: ContextVar[Path | None] = ContextVar("root", default=None)


@contextmanager
def confined(root: Path) -> Iterator[None]:
    """Inside, `new_file`, `write_text` and `make_folder` write below the folder `root` only, also if links are in it or
    are created meanwhile; PermissionError for other paths, and for devices and pipes."""
    before = _root.set(root.resolve())
    try:
        yield
    finally:
        _root.reset(before)


def open_folder(path: Path, root: Path | None = None, *, make: bool = False) -> int:
    """The descriptor of a folder, which is created with its parents if `make` is true. Each folder between `root` and
    `path` is opened relative to the one above it, and none may be a link; PermissionError for a path outside `root`."""
    if root is None:
        return os.open(path, FOLDER)
    if not path.is_relative_to(root):
        raise PermissionError(errno.EACCES, f"it leads out of the folder {root}", str(path))
    folder = os.open(root, FOLDER)
    for part in path.relative_to(root).parts:
        try:
            if make:
                with suppress(FileExistsError):
                    os.mkdir(part, dir_fd=folder)
            inner = os.open(part, FOLDER | NO_LINK, dir_fd=folder)
        finally:
            os.close(folder)
        folder = inner
    return folder


@contextmanager
def new_file(path: str | Path, *, exclusive: bool = False) -> Iterator[Path]:
    """A temporary path with the same suffix; at the end its file replaces `path` in one step.

    A link at `path` is followed, devices and pipes are written directly; see also `confined`. With `exclusive`
    FileExistsError if `path` exists at the end, as a file or as a link to anything. OSError names `path`, not the
    unfinished file. Unfinished files that killed processes left in the folder are removed.
    """
    root, path = _root.get(), Path(path)
    target = Path(os.path.realpath(path.parent)) / path.name if exclusive else Path(os.path.realpath(path))
    if root is None and target.exists() and not target.is_file():
        yield target
        return
    name = f".{target.stem[:LONGEST_STEM]}.{os.urandom(4).hex()}.new{target.suffix}"
    fresh, at, folder, lock = target.with_name(name), {}, -1, -1
    try:
        try:
            if DESCRIPTORS:
                folder = open_folder(target.parent, root)
                at = {"dir_fd": folder}
                if root is not None:
                    # PermissionError for a name in a folder that is not an ordinary file
                    with suppress(FileNotFoundError):
                        if not stat.S_ISREG(os.stat(target.name, dir_fd=folder, follow_symlinks=False).st_mode):
                            raise PermissionError(errno.EACCES, "it is not an ordinary file", target.name)
                    link = Path(f"/proc/{os.getpid()}/fd/{folder}")  # Linux
                    fresh = link / fresh.name if link.exists() else fresh
                _remove_unfinished(folder)
            elif root is not None and not target.is_relative_to(root):
                raise PermissionError(errno.EACCES, f"it leads out of the folder {root}", str(path))
            lock = _created(name if at else fresh, at)
            yield fresh
            with open(fresh, "rb+") as file:
                os.fsync(file.fileno())
            _rename(name if at else fresh, target.name if at else target, exclusive, at)
        except BaseException:
            with suppress(OSError):
                os.unlink(name if at else fresh, **at)
            raise
    except OSError as error:
        if error.filename in (None, str(fresh), fresh, name, str(target.parent), target.name):
            raise type(error)(error.errno, error.strerror or str(error), str(path)) from error
        raise
    finally:
        for descriptor in (lock, folder):
            if descriptor >= 0:
                os.close(descriptor)


def write_text(path: str | Path, text: str, *, exclusive: bool = False) -> None:
    """Write a text as UTF-8 with line feeds, whole or not at all; see `new_file`."""
    with new_file(path, exclusive=exclusive) as fresh, open(fresh, "w", encoding="utf-8", newline="\n") as file:
        file.write(text)


def _created(fresh: str | Path, at: dict[str, int]) -> int:
    """The descriptor of a new empty file. Its lock shows other processes that it is still being written; -1 if the system
    has no locks."""
    while True:
        lock = os.open(fresh, os.O_RDWR | os.O_CREAT | os.O_EXCL | NO_LINK, 0o666, **at)
        if fcntl is None:
            os.close(lock)  # Windows does not rename open files
            return -1
        with suppress(OSError):  # file systems without locks, on which unfinished files are not removed
            fcntl.flock(lock, fcntl.LOCK_EX)
        if os.fstat(lock).st_nlink:
            return lock
        os.close(lock)  # another process has removed it before it was locked


def _remove_unfinished(folder: int) -> None:
    """Remove unfinished files in a folder that are not locked, because their processes have ended."""
    for name in filter(UNFINISHED.fullmatch, os.listdir(folder) if fcntl is not None else ()):
        with suppress(OSError):
            file = os.open(name, os.O_RDWR | os.O_NONBLOCK | NO_LINK, dir_fd=folder)
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                os.unlink(name, dir_fd=folder)
            finally:
                os.close(file)


def _rename(fresh: str | Path, target: str | Path, exclusive: bool, at: dict[str, int]) -> None:
    """Give a file its name; both names are relative to the folder `at`, if there is one."""
    folder = at.get("dir_fd")
    both = {} if folder is None else {"src_dir_fd": folder, "dst_dir_fd": folder}
    if exclusive:
        # a link fails if the name exists; some file systems have no links
        try:
            os.link(fresh, target, follow_symlinks=False, **both)
            os.unlink(fresh, **at)
        except FileExistsError:
            raise
        except (OSError, NotImplementedError):
            with suppress(FileNotFoundError):
                os.stat(target, follow_symlinks=False, **at)
                raise FileExistsError(errno.EEXIST, "File exists", str(target)) from None
            os.replace(fresh, target, **both)
    else:
        with suppress(OSError):
            os.chmod(fresh, os.stat(target, dir_fd=folder, follow_symlinks=False).st_mode & 0o777, dir_fd=folder)
        os.replace(fresh, target, **both)
    if folder is not None:  # the rename reaches the disk with its folder
        with suppress(OSError):
            os.fsync(folder)


def why_unwritable(folder: Path) -> str:
    """Reason why no file can be created in a folder, in a few words; empty if one can.

    A file is created and removed at once: rights alone do not show that a medium is read only, or full.
    """
    if not folder.is_dir():
        return f"cannot find the folder '{folder}'"
    import tempfile  # not needed where nothing is written

    try:
        with tempfile.TemporaryFile(dir=folder):
            return ""
    except OSError as error:
        return (error.strerror or str(error)).lower()


def make_folder(folder: Path) -> None:
    """Create a folder and its parents if they do not exist; UsageError if that fails. See also `confined`."""
    try:
        if (root := _root.get()) is not None and DESCRIPTORS:
            os.close(open_folder(Path(os.path.realpath(folder)), root, make=True))
        else:
            folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        message = f"the folder '{folder}' cannot be created: {(error.strerror or str(error)).lower()}"
        raise UsageError([Problem("file-unwritable", message, None, "Give another one.")]) from None


def free_path(path: Path, *reserved: Path) -> Path:
    """The path, with the next free number if it exists."""
    names = (path.with_stem(f"{path.stem}_{k}") if k > 1 else path for k in itertools.count(1))
    return next(p for p in names if not os.path.lexists(p) and p not in reserved)
