"""Results on disk: one line of JSON for each case, so that a study goes on where it was stopped."""

from __future__ import annotations

import json
from pathlib import Path

DRAW = "third"  # of the cases: those of the first two were used to find faults
RESULTS = Path(__file__).parent / "results"


def read(name: str) -> dict[str, dict[str, object]]:
    """All results of a study by their keys."""
    path = RESULTS / f"{name}.jsonl"
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return {row["key"]: row for row in map(json.loads, lines)}


def add(name: str, row: dict[str, object]) -> None:
    """One more result."""
    RESULTS.mkdir(exist_ok=True)
    with (RESULTS / f"{name}.jsonl").open("a", encoding="utf-8") as file:
        file.write(json.dumps(row, default=float) + "\n")
