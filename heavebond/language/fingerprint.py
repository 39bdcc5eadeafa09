"""What a diagram, and what is made of it, follows from: digests of the contents of files, of this program, of values."""

from __future__ import annotations

import hashlib
import os
import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path

from heavebond.language.library import bundled

# what decides with us how a diagram is read and reduced: package and the name under which it is installed
LIBRARIES = {"casadi": "casadi", "numpy": "numpy", "scipy": "scipy", "yaml": "pyyaml",
             "pint": "pint"}
STARTED = time.time_ns()
# Clocks of file systems tick slowly: a file that changed this shortly before it was read may have changed after, too.
TICK = 100_000_000


@dataclass(frozen=True)
class Fingerprint:
    """A digest of contents, and the time in ns of the last change to any of them."""

    digest: bytes
    newest: int

    def settled(self, since: int) -> bool:
        """Whether nothing changed after a time (ns), so that what was read since then is what this tells."""
        return self.newest < since - TICK


def key(*parts: object) -> str:
    """A name for what follows from the parts: bytes, texts and numbers."""
    found = hashlib.blake2b(digest_size=20)
    for part in parts:
        data = part if isinstance(part, bytes) else repr(part).encode()
        found.update(len(data).to_bytes(8, "little") + data)
    return found.hexdigest()


def contents(paths: Iterable[str | Path]) -> Fingerprint:
    """The names and contents of files; OSError where one cannot be read."""
    found, newest = hashlib.blake2b(digest_size=20), 0
    for path in paths:
        with open(path, "rb") as file:
            status, data = os.fstat(file.fileno()), file.read()
        name = os.fspath(path).encode()
        found.update(b"%d %d " % (len(name), len(data)) + name + data)
        newest = max(newest, status.st_mtime_ns, status.st_ctime_ns)
    return Fingerprint(found.digest(), newest)


def program() -> Fingerprint:
    """This program, the libraries that it computes with, the bundled components: OSError where a file cannot be read."""
    code, components = _code(), _stamps(bundled("components"))
    kept = _components(tuple(components))
    return Fingerprint(code.digest + kept.digest, max(code.newest, kept.newest))


@lru_cache(maxsize=1)
def _code() -> Fingerprint:
    """Modules are read once in a process: where one was changed since, it is not known which of the two is in memory."""
    found = contents(sorted(str(path) for path in Path(__file__).parents[1].rglob("*.py")))
    newest = found.newest if found.settled(STARTED) else sys.maxsize
    return Fingerprint(hashlib.blake2b(repr((found.digest, sys.version, _versions())).encode()).digest(), newest)


def _versions() -> list[str]:
    """The names of the folders in which the installed versions of the libraries are told. (They are not imported for it.)"""
    found = []
    for package, distribution in LIBRARIES.items():
        spec = find_spec(package)
        folder = Path(spec.origin).parents[1] if spec is not None and spec.origin else None
        beside = os.listdir(folder) if folder is not None else []
        found += [name for name in sorted(beside) if name.lower().startswith(f"{distribution}-")] or [f"{folder}/{package}"]
    return found


@lru_cache(maxsize=4)
def _components(stamps: tuple[tuple[str, int, int], ...]) -> Fingerprint:
    """The bundled components with these stamps: in one process their contents are read again only where a stamp changes."""
    return contents(path for path, _, _ in stamps)


def _stamps(folder: Path) -> list[tuple[str, int, int]]:
    """Path, time of the last change and size of the YAML files below a folder."""
    return sorted((item.path, item.stat().st_mtime_ns, item.stat().st_size) for item in _below(folder, (".yaml",)))


def _below(folder: Path | str, endings: tuple[str, ...], *, deep: bool = True) -> Iterator[os.DirEntry[str]]:
    """The files with these endings in a folder, and below it."""
    try:
        with os.scandir(folder) as found:
            items = list(found)
    except FileNotFoundError:
        return
    for item in items:
        if item.is_dir():
            if deep:
                yield from _below(item.path, endings)
        elif item.name.endswith(endings):
            yield item


def diagram_files(files: Iterable[Path]) -> Fingerprint:
    """What a diagram that is written in these files (those that it extends first) follows from: their contents, all the
    components and FMUs that lie beside them, and which files would come before those that were taken."""
    files = list(files)
    folders = sorted({str(path.parent) for path in files})
    beside = sorted({item.path for folder in folders for items in (
        _below(folder, (".yaml", ".fmu"), deep=False), _below(os.path.join(folder, "components"), (".yaml", ".fmu")))
        for item in items})
    found = contents([*files, *beside])
    return Fingerprint(key(found.digest, list(_covering(files))).encode(), found.newest)


def _covering(files: list[Path]) -> Iterator[tuple[str, bool]]:
    """For each bundled machine that is extended, the files that would be taken in its place, and whether they are there."""
    machines = bundled("models").resolve()
    for path in files:
        resolved = path.resolve()
        if machines in resolved.parents:
            for folder in sorted({str(other.parent) for other in files}):
                other = os.path.join(folder, resolved.relative_to(machines))
                yield other, os.path.exists(other)
