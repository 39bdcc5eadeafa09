"""Results of a long search kept as lines of a JSON file as they are made, so that a search that was ended goes on from them.

Each line is the entry of one result with a digest of all that it depends on. A line that was cut short by the end of the
process is left out.
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
    """The entries of a file by their digests; `taken` counts those that a search has asked for."""

    path: Path
    known: dict[str, Kept] = field(default_factory=dict)
    taken: int = 0

    @classmethod
    def read(cls, path: Path) -> KeptLines:
        """What a file holds; nothing where there is none."""
        known: dict[str, Kept] = {}
        with suppress(OSError):
            for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
                with suppress(ValueError):  # one that was cut short
                    entry = json.loads(line)
                    if isinstance(entry, dict) and isinstance(entry.get("digest"), str):
                        known[entry["digest"]] = entry
        return cls(path, known)

    @classmethod
    def begin(cls, path: Path, resume: bool) -> KeptLines:
        """What a file holds where a search is to `resume`; else an empty one in its place."""
        if resume:
            return cls.read(path)
        kept = cls(path)
        kept.remove()
        return kept

    def remove(self) -> None:
        """Remove the file, as a search has come to its end."""
        with suppress(OSError):
            self.path.unlink()

    def get(self, digest: str) -> Kept | None:
        """The entry with this digest, where it is kept."""
        found = self.known.get(digest)
        self.taken += found is not None
        return found

    def add(self, digest: str, entry: Kept) -> None:
        """Keep an entry. Where the file cannot be written the search goes on without it."""
        if digest in self.known:
            return
        self.known[digest] = entry = {"digest": digest, **entry}
        with suppress(OSError), open(self.path, "a", encoding="utf-8", newline="\n") as file:
            # a line break before, too: the last line may have been cut short
            file.write(f"\n{json.dumps(entry)}\n")
