"""What was found once and is kept for later processes: files in one folder, each with its checksum.

An entry is looked up by a key that says all that it follows from, so that none is ever out of date; what nobody looks up any
more goes when the limit is reached. Nothing here ever fails: where the folder cannot be read or written, or an entry is
damaged, there is none. Entries hold data only, and are written under another name first, so that several processes can use
one folder.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
import zlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

# environment variables: the folder (or `off`), and the limit in MB
FOLDER, LIMIT = "HEAVEBOND_CACHE", "HEAVEBOND_CACHE_LIMIT"
USUAL_LIMIT = 500.0
MB = 1_000_000
SUFFIX = ".kept"
HEAD = b"heavebond cache 1\n"
# a file of this name in the folder switches the cache off
SWITCH = "switched off"
MOST_UNPACKED = 2_000 * MB
DIGEST = 32


@dataclass(frozen=True)
class Cache:
    """A folder of entries and the number of bytes that they may take together."""

    folder: Path
    limit: int

    @property
    def switched_off(self) -> bool:
        """Whether `switch` turned it off for good."""
        return (self.folder / SWITCH).exists()

    def fetch(self, key: str) -> bytes | None:
        """What is kept under a key; None where nothing is, or nothing sound."""
        path = self._path(key)
        try:
            data = path.read_bytes()
        except OSError:
            return None
        found = _opened(key, data)
        with suppress(OSError):
            if found is None:
                path.unlink()
            else:
                os.utime(path)  # what was used last goes last
        return found

    def keep(self, key: str, data: bytes) -> None:
        """Keep data under a key, and drop what has not been used for longest where the limit is passed."""
        body = zlib.compress(data, 1)
        if len(body) > self.limit // 4:
            return
        with suppress(OSError):
            self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            handle, name = tempfile.mkstemp(".new", ".", self.folder)
            try:
                with os.fdopen(handle, "wb") as file:
                    file.write(HEAD + _checksum(key, body) + body)
                os.replace(name, self._path(key))
            except BaseException:
                with suppress(OSError):
                    os.unlink(name)
                raise
            self._shrink()

    def drop(self, key: str) -> None:
        """Keep nothing under a key."""
        with suppress(OSError):
            self._path(key).unlink()

    def sizes(self) -> list[int]:
        """The size of each entry in bytes."""
        return [size for _, size, _ in self._entries()]

    def empty(self) -> None:
        """Drop every entry; OSError where one cannot be removed."""
        for path, _, _ in self._entries():
            path.unlink(missing_ok=True)

    def switch(self, *, on: bool) -> None:
        """Turn the cache off for good, or on again; OSError where the folder cannot be written."""
        if on:
            (self.folder / SWITCH).unlink(missing_ok=True)
        else:
            self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            (self.folder / SWITCH).touch()

    def _path(self, key: str) -> Path:
        return self.folder / f"{key}{SUFFIX}"

    def _entries(self) -> Iterator[tuple[Path, int, int]]:
        """Path, size and time of the last use of each entry, and of what a process left that was killed while it wrote."""
        with suppress(OSError), os.scandir(self.folder) as found:
            for item in found:
                if item.name.endswith((SUFFIX, ".new")):
                    with suppress(OSError):
                        status = item.stat()
                        yield Path(item.path), status.st_size, status.st_mtime_ns

    def _shrink(self) -> None:
        found = sorted(self._entries(), key=lambda entry: entry[2])
        total = sum(size for _, size, _ in found)
        for path, size, _ in found:
            if total <= self.limit:
                break
            with suppress(OSError):
                path.unlink()
            total -= size


def _checksum(key: str, body: bytes) -> bytes:
    return hashlib.blake2b(body, digest_size=DIGEST, key=key.encode()[:64]).digest()


def _opened(key: str, data: bytes) -> bytes | None:
    """The content of an entry; None where it is not what was written under this key."""
    begin = len(HEAD) + DIGEST
    if data[:len(HEAD)] != HEAD or data[len(HEAD):begin] != _checksum(key, data[begin:]):
        return None
    unpacker = zlib.decompressobj()
    try:
        found = unpacker.decompress(data[begin:], MOST_UNPACKED)
    except zlib.error:
        return None
    return found if unpacker.eof else None


def the_cache() -> Cache | None:
    """The cache that the environment variables ask for; None where they switch it off."""
    asked = os.environ.get(FOLDER, "")
    if asked.lower() == "off":
        return None
    if asked:
        folder = Path(asked).expanduser()
    else:
        from platformdirs import user_cache_path

        folder = user_cache_path("heavebond", appauthor=False)
    return Cache(folder, limit_of(os.environ.get(LIMIT, "")))


def limit_of(text: str) -> int:
    """A limit in bytes from a number of MB; the usual one where the text is none."""
    try:
        megabytes = float(text)
    except ValueError:
        megabytes = USUAL_LIMIT
    return int(max(0.0, min(megabytes, 1e9)) * MB) if megabytes == megabytes else int(USUAL_LIMIT * MB)
