"""Judge the diagrams of many seeds; go on where it was stopped."""

from __future__ import annotations

import argparse
import hashlib
import json
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import heavebond
from benchmarks.fuzz.campaign import Judge, patiently, smallest
from benchmarks.fuzz.diagrams import diagram
from benchmarks.fuzz.judging import FAULTS, judge
from heavebond.language.library import bundled

HERE = Path(__file__).parent
WARM = 20  # diagrams judged before the first process is copied


def code() -> str:
    """Eight digits that tell in which state the program, the library and the diagrams are."""
    folders = (Path(heavebond.__file__).parent, bundled("components"), HERE)
    files = sorted(path for folder in folders for kind in ("*.py", "*.yaml") for path in folder.rglob(kind))
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()[:8]


def _remaining(file: Path, first: int, number: int) -> Iterator[int]:
    done = {json.loads(line)["seed"] for line in file.read_text().splitlines()} if file.exists() else set()
    return (seed for seed in range(first, first + number) if seed not in done)


def main() -> None:
    """Judge what is left of the seeds, print the faults with their smallest diagrams, and the counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=100_000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--limit", type=float, default=20.0, help="seconds of processor time for one diagram")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="stop after so long")
    parser.add_argument("--results", type=Path, default=HERE / "results.jsonl")
    parser.add_argument("--summary", type=Path, help="write the counts of all results to this file, and stop")
    parser.add_argument("--show", type=int, help="print the diagram of one seed and its verdict")
    options = parser.parse_args()
    if options.show is not None:
        text = diagram(options.show).text()
        print(text, judge(options.show, text))
    elif options.summary:
        options.summary.write_text(json.dumps(summary(options.results), indent=2) + "\n", encoding="utf-8")
    else:
        _campaign(options.results, _remaining(options.results, options.first, options.seeds), options.limit,
                  time.monotonic() + 60 * options.minutes)


def _campaign(results: Path, seeds: Iterator[int], limit: float, end: float) -> None:
    for seed in range(WARM):
        judge(seed, diagram(seed).text())
    judged, state = Judge(limit), code()
    with results.open("a", encoding="utf-8") as out:
        for seed in seeds:
            found = patiently(judged, diagram(seed))
            out.write(json.dumps({**found.as_dict(), "code": state}) + "\n")
            out.flush()
            if found.outcome in FAULTS:
                print(f"seed {seed}: {found.outcome}: {found.what}\n{smallest(judged, diagram(seed), found.outcome).text()}",
                      flush=True)
            if time.monotonic() > end:
                break
    judged.close()
    counted = summary(results)
    print(f"{counted['diagrams']} diagrams: {counted['outcomes']}\nfaults: {counted['faults'] or 'none'}")


def summary(results: Path) -> dict[str, object]:
    """How many diagrams ended how, why they were refused, the seeds of faults, and how many were judged in which state of
    the program (see `code`)."""
    lines = [json.loads(line) for line in results.read_text(encoding="utf-8").splitlines()]
    reasons = Counter(reason for line in lines if line["outcome"] == "refused" for reason in line["what"].split())
    return {"diagrams": len(lines), "outcomes": dict(Counter(line["outcome"] for line in lines).most_common()),
            "faults": {line["seed"]: line["outcome"] for line in lines if line["outcome"] in FAULTS},
            "refused for": dict(reasons.most_common()), "hours": round(sum(line["seconds"] for line in lines) / 3600, 2),
            "code": dict(Counter(line["code"] for line in lines))}


if __name__ == "__main__":
    main()
