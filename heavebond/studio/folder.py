"""The opened folder: its diagrams and the bundled ones, read and saved without changes of other bytes, and no file
outside.
"""

from __future__ import annotations

import errno
import hashlib
import io
import json
import os
import re
import stat
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import Any

try:
    import fcntl
except ImportError:  # Windows: only tabs of the same studio exclude each other
    fcntl = None  # type: ignore[assignment]

from heavebond.core.errors import HeavebondError, Problem, UsageError
from heavebond.core.limits import FILE_BYTES
from heavebond.core.writable import DESCRIPTORS, NO_LINK, confined, make_folder, new_file, open_folder
from heavebond.language import model
from heavebond.language.library import bundled
from heavebond.text.yaml_source import Scalar, decoded_text, read, unreadable

BUNDLED = model.BUNDLED
LOCKED = 5.0  # s that a save waits while another studio saves in the same folder
YAML = (".yaml", ".yml")
MARKER = ".heavebond.lock"  # the lock file in a folder, if the system has no locks
STALE = 60.0  # s, far longer than a save takes: the age of a lock file whose process has ended
_saving = threading.Lock()
LISTED, DEPTH = 500, 4  # largest number of files on the first page, and depth of the search for them
KINDS = ("study", "experiment", "model", "component")  # kinds of files; an experiment and a study name their model as well
SUMMARY = re.compile(r"^summary:[ \t]*(?:[>|][-+]?[ \t]*\n)?(.*(?:\n[ \t]+.*)*)", re.MULTILINE)
LAYOUTS = ".heavebond"  # the folder for the layouts of charts, in the folder of a diagram
LAYOUT_BYTES = 4_000_000  # of one layout with the texts of its kept runs
BOM = b"\xef\xbb\xbf"
NEW = """\
model: NAME
summary: A load on a spring and a damper, released 20 mm from rest.
components:
  wall:   {is: Fixed, at: [0, 0]}
  spring: {is: Spring, c: 4 kN/m, at: [1, 0]}
  damper: {is: Damper, d: 100 N*s/m, at: [1, 1]}
  load:   {is: Mass, m: 100 kg, at: [2, 0]}
nodes:
  ground: [wall.a, spring.a, damper.a]
  load:   [spring.b, damper.b, load.a]
initial: {load.x: 20 mm, load.v: 0 m/s}
show:
  place: {is: load.x, unit: mm}
  speed: {is: load.v, unit: mm/s}
  force: {is: spring.F + damper.F, unit: N}
simulate: {until: 6 s, every: 5 ms}
"""
# starting points of a new diagram: the name of one, its title on the page, and the bundled diagram whose text it has
TEMPLATES = {"spring": ("A mass on a spring", ""),
             "cylinder": ("A hydraulic cylinder with valve and supply", "cylinder_rig"),
             "motor": ("A motor with shaft and load", "circuits/electric_hoist"),
             "receiver": ("A pneumatic receiver with compressor and consumer", "circuits/compressor_station"),
             "loop": ("A loop with a PID controller", "dc_stage")}
EMPTY = """\
model: NAME
simulate: {until: 5 s, every: 5 ms}
"""


@dataclass(frozen=True)
class Document:
    """A diagram on disk: its `name` on the page, its text with `\n` at the ends of lines, and the `version` of its bytes,
    by which changes by other programs are detected."""

    name: str
    path: Path
    text: str
    version: str
    writable: bool


@dataclass(frozen=True)
class Folder:
    """The files that the page may access: YAML files below `root`, and the bundled machines, which are read only."""

    root: Path

    def path(self, name: str) -> Path:
        """The file of a document; UsageError for a file outside, a hidden one or another kind of file."""
        if name.startswith(BUNDLED):
            machines = {entry["name"]: entry["path"] for entry in bundled_machines()}
            if name not in machines:
                raise UsageError([Problem("file-missing", f"there is no bundled diagram '{name.removeprefix(BUNDLED)}'")])
            return Path(machines[name])
        path = self.inside(name, "YAML file")
        if path.suffix not in YAML:
            raise _outside(name, "YAML file")
        return path

    def inside(self, name: str, kind: str = "file") -> Path:
        """The resolved path of a name below the folder; UsageError for a file outside or a hidden one. Every path that
        the server receives from a page is resolved here, and is then opened by `opened` or written within `writing`."""
        try:
            path = (self.root.resolve() / name).resolve()
            os.fsencode(path)
        except (OSError, ValueError, RuntimeError):  # a NUL or a lone surrogate in it, circular links
            raise _outside(name, kind) from None
        if not self._is_visible(path):
            raise _outside(name, kind)
        return path

    @contextmanager
    def opened(self, path: Path) -> Iterator[io.BufferedReader]:
        """Open an ordinary file below the folder, or a bundled one, to read; OSError for all others. No link is followed,
        also none that was created after the path was resolved, and a pipe does not block."""
        flags, root = os.O_RDONLY | NO_LINK | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0), self.root.resolve()
        machines = bundled("models")
        if DESCRIPTORS and not (path.is_relative_to(machines) or path.is_relative_to(machines.resolve())):
            folder = open_folder(path.parent, root)
            try:
                descriptor = os.open(path.name, flags, dir_fd=folder)
            finally:
                os.close(folder)
        else:
            descriptor = os.open(path, flags)
        with open(descriptor, "rb") as file:
            mode = os.fstat(descriptor).st_mode
            if stat.S_ISDIR(mode):
                raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
            if not stat.S_ISREG(mode):
                raise PermissionError(errno.EACCES, "it is not an ordinary file", str(path))
            yield file

    @contextmanager
    def writing(self, path: Path) -> Iterator[None]:
        """Restrict writing to the folder, and lock the folder of `path` against other tabs and other studios: the folder
        itself, or a file in it if the system has no locks (Windows, some network file systems). UsageError if another tab
        or studio has the lock."""
        with _saving, confined(self.root):
            lock, marked = -1, False
            try:
                if path.parent.is_dir():
                    lock = open_folder(path.parent, self.root.resolve()) if DESCRIPTORS else -1
                    if fcntl is None or not _lock(lock, path):
                        _mark(lock, path)
                        marked = True
                yield
            finally:
                if marked:
                    name, at = _marker(lock, path)
                    with suppress(OSError):
                        os.unlink(name, **at)
                if lock >= 0:
                    os.close(lock)

    def document(self, path: Path) -> str:
        """The document name of a YAML file in the folder; empty for others."""
        path = path.resolve()
        return path.relative_to(self.root.resolve()).as_posix() if self._is_visible(path) and path.suffix in YAML else ""

    def _is_visible(self, path: Path) -> bool:
        """True if a resolved path lies in the folder, and in no hidden part of it."""
        root = self.root.resolve()
        return path.is_relative_to(root) and path != root and \
            not any(part.startswith(".") for part in path.relative_to(root).parts)

    def record(self, name: str, *, exists: bool = True) -> Path:
        """The file of a record in the folder; UsageError for a file outside, a hidden or a missing one."""
        path = self.inside(name)
        if exists and not path.is_file():
            raise _outside(name, "file")
        return path

    def new_name(self, name: str, beside: str = "") -> str:
        """The document `name`.yaml in the folder `beside` below the opened one; UsageError for an invalid name."""
        if not re.fullmatch(r"[A-Za-z]\w{0,60}", name, flags=re.ASCII):
            message = f"'{name[:80]}' cannot name a file: letters, digits and _, a letter first"
            raise UsageError([Problem("name-bad", message)])
        document = (PurePosixPath(beside) / f"{name}.yaml").as_posix()
        if os.path.lexists(self.path(document)):
            raise UsageError([Problem("file-exists", f"{document} exists already", None, "Give another name.")])
        return document

    def read(self, name: str) -> Document:
        """Read a document; ModelError if it cannot be read."""
        path = self.path(name)
        try:
            with self.opened(path) as file:
                raw = file.read(FILE_BYTES + 1)
        except OSError as error:
            raise unreadable(error, name) from None
        decoded_text(raw, name)  # raises the problem of a file that is too large or not UTF-8
        content = raw.removeprefix(BOM)
        text = (content.replace(b"\r\n", b"\n") if _with_cr(content) else content).decode("utf-8")
        return Document(name, path, text, version(raw), not name.startswith(BUNDLED) and os.access(path, os.W_OK))

    def save(self, name: str, text: str, base: str) -> Document:
        """Replace the version `base` by a text, with the line ends of the file, or write a removed file again; UsageError
        `file-changed` if another version is on disk."""
        if name.startswith(BUNDLED):
            raise UsageError([Problem("file-bundled", "a bundled diagram cannot be changed", None,
                                      "Copy the machine into your folder, and change the copy.")])
        path = self.path(name)
        if len(data := text.encode("utf-8")) > FILE_BYTES:
            raise UsageError([Problem("file-too-large", f"the text is larger than {FILE_BYTES // 10**6} MB")])
        try:
            with self.writing(path):
                before = None
                with suppress(FileNotFoundError), self.opened(path) as file:
                    before = file.read()
                if before is not None and version(before) != base:
                    raise UsageError([Problem("file-changed", f"{name} has been changed on disk since it was read", None,
                                              "Compare the two, then keep one.")])
                # with the byte order mark and the line ends of the former file
                if before is not None and _with_cr(before):
                    data = data.replace(b"\n", b"\r\n")
                with new_file(path) as fresh:
                    fresh.write_bytes(BOM + data if before is not None and before.startswith(BOM) else data)
        except OSError as error:
            raise UsageError([Problem("file-unwritable", f"{name} cannot be saved: {error.strerror or error}")]) from None
        return self.read(name)

    def layout(self, name: str) -> tuple[dict[str, Any] | None, str]:
        """The charts and the kept runs of a document, and the version of their file; None if they cannot be read, and an
        empty version if there is no file."""
        try:
            with self.opened(self._layout_file(name)) as file:
                raw = file.read(LAYOUT_BYTES + 1)
        except OSError:
            return None, ""
        try:
            layout = json.loads(raw)
        except (ValueError, RecursionError):
            layout = None
        return layout if isinstance(layout, dict) else None, version(raw)

    def save_layout(self, name: str, layout: dict[str, Any], base: str) -> str:
        """Replace the version `base` of the layout of a document; returns the new version, or an empty string if another tab
        has written since. UsageError if it is too large or cannot be written."""
        path = self._layout_file(name)
        data = (json.dumps(layout, indent=1, allow_nan=False) + "\n").encode()
        if len(data) > LAYOUT_BYTES:
            raise UsageError([Problem("file-too-large", f"the kept runs need more than {LAYOUT_BYTES // 10**6} MB", None,
                                      "Forget some of them.")])
        try:
            with self.writing(self.path(name)):
                if path.is_symlink():  # its target is another file of the folder
                    raise PermissionError(errno.EACCES, "its file is a link", str(path))
                if self.layout(name)[1] != base:
                    return ""
                make_folder(path.parent)
                with new_file(path) as fresh:
                    fresh.write_bytes(data)
        except OSError as error:
            message = f"the charts of {name} cannot be stored: {error.strerror or error}"
            raise UsageError([Problem("file-unwritable", message)]) from None
        return version(data)

    def _layout_file(self, name: str) -> Path:
        """The file of the layout of a document in this folder; UsageError for another one."""
        if name.startswith(BUNDLED):
            raise UsageError([Problem("file-bundled", "a bundled diagram has no stored charts")])
        path = self.path(name)
        return path.parent / LAYOUTS / f"{path.name}.json"

    def create(self, name: str, text: str = NEW) -> str:
        """Create a diagram `name`, by default a first example; returns the name of its document."""
        if not re.fullmatch(r"[A-Za-z]\w{0,60}", name, flags=re.ASCII):
            raise UsageError([Problem("name-bad", f"'{name}' cannot name a diagram: letters, digits and _, a letter first")])
        self.write_new(f"{name}.yaml", text.replace("NAME", name, 1))
        return self.path(f"{name}.yaml").name

    def create_from(self, name: str, template: str) -> str:
        """Create a diagram `name` with the text of one of TEMPLATES; returns the name of its document."""
        origin = TEMPLATES[template][1]
        text = re.sub(r"^model: .*", "model: NAME", self.read(BUNDLED + origin).text, count=1) if origin else NEW
        return self.create(name, text)

    def write_new(self, document: str, text: str) -> None:
        """Write a new document; UsageError if it exists."""
        path = self.path(document)
        try:
            with self.writing(path), new_file(path, exclusive=True) as fresh:
                fresh.write_bytes(text.encode("utf-8"))
        except FileExistsError:
            raise UsageError([Problem("file-exists", f"{document} exists already", None, "Give another name.")]) from None
        except OSError as error:
            message = f"{document} cannot be created: {error.strerror or error}"
            raise UsageError([Problem("file-unwritable", message)]) from None

    def derive(self, name: str, origin: str, values: Mapping[str, str]) -> str:
        """Create a diagram that extends `origin` and sets some of its parameters; returns the name of its document."""
        path = self.path(origin)
        base = path.relative_to(bundled("models").resolve() if origin.startswith(BUNDLED) else self.root.resolve())
        lines = ["model: NAME", f"extends: {json.dumps(base.as_posix(), ensure_ascii=False)}"]
        for parameter, value in values.items():
            if not re.fullmatch(r"[\w.\[\]]+", parameter) or not value.isprintable():
                raise UsageError([Problem("usage", f"'{parameter[:60]}' cannot be set")])
        lines += ["set:", *(f"  {k}: {_plain_or_quoted(v)}" for k, v in values.items())] if values else []
        return self.create(name, "\n".join(lines) + "\n")

    def diagrams(self) -> list[dict[str, str]]:
        """The files of the language below the folder, by name, with their `kind` and `summary`; links out of the folder
        and hidden folders are excluded."""
        entries, root = [], self.root.resolve()
        for folder, folders, files in os.walk(root):
            current_folder = Path(folder)
            deep = len(current_folder.relative_to(root).parts)
            folders[:] = sorted(d for d in folders if not d.startswith((".", "__")) and deep + 1 < DEPTH)
            for name in sorted(files):
                relative = (current_folder / name).relative_to(root).as_posix()
                if name.endswith(YAML) and not name.startswith(".") and (head := self._head(relative)):
                    entries.append({"name": relative, **head})
                if len(entries) >= LISTED:
                    return entries
        return entries

    def _head(self, name: str) -> dict[str, str]:
        """The `kind` (`model`, `experiment`, `study` or `component`) and the `summary` of a file, read from its beginning
        only; empty for another file."""
        try:
            with self.opened(self.path(name)) as file:
                head = file.read(4000).decode("utf-8", "replace").replace("\r\n", "\n")
        except (OSError, HeavebondError):
            return {}
        kind = next((kind for kind in KINDS if re.search(rf"^{kind}\s*:", head, re.MULTILINE)), "")
        summary = SUMMARY.search(head)
        return {"kind": kind, "summary": " ".join(summary.group(1).split()).strip("'\"") if summary else ""} if kind else {}


def _plain_or_quoted(value: str) -> str:
    plain = re.fullmatch(r"[-+.\w]+( [\w*/().%]+)?", value, flags=re.ASCII)
    return value if plain else json.dumps(value, ensure_ascii=False)


def version(data: bytes) -> str:
    """A digest of a file's bytes."""
    return hashlib.sha256(data).hexdigest()


def _lock(folder: int, path: Path) -> bool:
    """Lock a folder by its descriptor, until that is closed; False if the file system has no locks."""
    until = time.monotonic() + LOCKED
    while True:
        try:
            fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return True
        except BlockingIOError:
            _wait(until, path)
        except OSError:
            return False


def _mark(folder: int, path: Path) -> None:
    """Create the lock file in the folder of `path`, which no other process has. One that is older than STALE was left by a
    process that ended; it is removed."""
    until, (marker, at) = time.monotonic() + LOCKED, _marker(folder, path)
    while True:
        try:
            os.close(os.open(marker, os.O_WRONLY | os.O_CREAT | os.O_EXCL | NO_LINK, 0o666, **at))
            return
        except FileExistsError:
            if not _remove_stale(marker, at):
                _wait(until, path)


def _remove_stale(marker: str | Path, at: dict[str, int]) -> bool:
    """Remove a lock file older than STALE; whether it was removed. One of several processes that wait may do so, after it
    has created a second file, named after the time of the first: else another one would remove the next lock file."""
    with suppress(OSError):  # it was removed meanwhile
        created = os.stat(marker, follow_symlinks=False, **at).st_mtime_ns
        if time.time() - created / 1e9 <= STALE:
            return False
        guard = f"{marker}.{created}"
        os.close(os.open(guard, os.O_WRONLY | os.O_CREAT | os.O_EXCL | NO_LINK, 0o666, **at))
        try:
            if os.stat(marker, follow_symlinks=False, **at).st_mtime_ns == created:
                os.unlink(marker, **at)
                return True
        finally:
            os.unlink(guard, **at)
    return False


def _marker(folder: int, path: Path) -> tuple[str | Path, dict[str, int]]:
    """The lock file in the folder of `path`, relative to the descriptor of the folder if there is one."""
    return (MARKER, {"dir_fd": folder}) if folder >= 0 else (path.parent / MARKER, {})


def _wait(until: float, path: Path) -> None:
    if time.monotonic() > until:
        raise UsageError([Problem("file-locked", f"{path.name} cannot be saved: another studio is saving in its folder",
                                  None, "Save again when that has finished.")]) from None
    time.sleep(0.02)


def _outside(name: str, kind: str) -> UsageError:
    return UsageError([Problem("file-outside", f"'{name[:100]}' is not a {kind} in the opened folder")])


def _with_cr(raw: bytes) -> bool:
    return b"\r\n" in raw and raw.count(b"\n") == raw.count(b"\r\n") == raw.count(b"\r")


def _complete(path: Path) -> bool:
    """True if all records of a bundled experiment exist: the licences of some do not permit distribution."""
    from heavebond.estimation.experiment import load_experiment

    return all(record.file.is_file() for record in load_experiment(path).records.values())


@lru_cache(maxsize=1)
def bundled_machines() -> tuple[dict[str, Any], ...]:
    """The bundled diagrams with their summaries, by machine, the main diagram first; and the number of studies of each
    machine."""
    root, machines = bundled("models"), []
    for folder in sorted(p for p in root.iterdir() if p.is_dir() and p.name != "examples"):
        main = folder / f"{folder.name}.yaml"
        texts = (path.read_text(encoding="utf-8") for path in folder.rglob("*.yaml"))
        studies = sum(bool(re.search(r"^study\s*:", text, re.MULTILINE)) for text in texts)
        for path in sorted(folder.glob("*.yaml"), key=lambda p: (p != main, p.name)):
            items = read(path, bundled=True).root.items
            kind = next(iter(items))
            if kind not in ("model", "experiment") or (kind == "experiment" and not _complete(path)):
                continue
            title = items.get("summary") or items.get("experiment")
            name = folder.name if path == main else f"{folder.name}/{path.stem}"
            machines.append({"name": BUNDLED + name, "path": str(path), "machine": folder.name, "kind": kind,
                             "studies": studies, "summary": title.text if isinstance(title, Scalar) else ""})
    return tuple(machines)
