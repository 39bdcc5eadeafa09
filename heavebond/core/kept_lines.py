"""Resume file: results of a long search, appended as lines of JSON, so that an interrupted search can continue.

Each line is the entry of one result with a digest of all its inputs. A line that was cut short by the end of the process
is ignored.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

Kept = Mapping[str, Any]


@dataclass
class KeptLines:
    """The entries of a file by their digests; `taken` counts the entries that a search has used."""

    path: Path
    known: dict[str, Kept] = field(default_factory=dict)
    taken: int = 0

    @classmethod
    def read(cls, path: Path) -> KeptLines:
        """Read the entries of a file; empty if it does not exist."""
        known: dict[str, Kept] = {}
        with suppress(OSError):
            for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
                with suppress(ValueError):  # an incomplete line
                    entry = json.loads(line)
                    if isinstance(entry, dict) and isinstance(entry.get("digest"), str):
                        known[entry["digest"]] = entry
        return cls(path, known)

    @classmethod
    def begin(cls, path: Path, resume: bool) -> KeptLines:
        """Read the entries of a file to `resume` a search; else start an empty file."""
        if resume:
            return cls.read(path)
        lines = cls(path)
        lines.remove()
        return lines

    def remove(self) -> None:
        """Remove the file after the search is complete."""
        with suppress(OSError):
            self.path.unlink()

    def get(self, digest: str) -> Kept | None:
        """The entry with this digest, or None."""
        entry = self.known.get(digest)
        self.taken += entry is not None
        return entry

    def add(self, digest: str, entry: Kept) -> None:
        """Append an entry. If the file cannot be written, the search continues without it."""
        if digest in self.known:
            return
        self.known[digest] = entry = {"digest": digest, **entry}
        with suppress(OSError), open(self.path, "a", encoding="utf-8", newline="\n") as file:
            # a line break first, because the last line may be incomplete
            file.write(f"\n{json.dumps(entry)}\n")
