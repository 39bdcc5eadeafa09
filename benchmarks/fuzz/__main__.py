"""Judge the diagrams of many seeds; go on where it was stopped."""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from benchmarks.fuzz.campaign import Judge, smallest
from benchmarks.fuzz.diagrams import diagram
from benchmarks.fuzz.judging import FAULTS, judge

HERE = Path(__file__).parent


def _remaining(file: Path, first: int, number: int) -> Iterator[int]:
    done = {json.loads(line)["seed"] for line in file.read_text().splitlines()} if file.exists() else set()
    return (seed for seed in range(first, first + number) if seed not in done)


def main() -> None:
    """Judge what is left of the seeds, print the faults with their smallest diagrams, and the counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=100_000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--limit", type=float, default=60.0, help="seconds for one diagram")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="stop after so long")
    parser.add_argument("--results", type=Path, default=HERE / "results.jsonl")
    parser.add_argument("--show", type=int, help="print the diagram of one seed and its verdict")
    options = parser.parse_args()
    if options.show is not None:
        text = diagram(options.show).text()
        print(text, judge(options.show, text))
        return
    judged, end = Judge(options.limit), time.monotonic() + 60 * options.minutes
    with options.results.open("a", encoding="utf-8") as out:
        for seed in _remaining(options.results, options.first, options.seeds):
            found = judged(seed, diagram(seed).text())
            out.write(json.dumps(found.as_dict()) + "\n")
            out.flush()
            if found.outcome in FAULTS:
                print(f"seed {seed}: {found.outcome}: {found.what}\n{smallest(judged, diagram(seed), found.outcome).text()}",
                      flush=True)
            if time.monotonic() > end:
                break
    judged.close()
    _report(options.results)


def _report(file: Path) -> None:
    lines = [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]
    counts = Counter(line["outcome"] for line in lines)
    print(f"{len(lines)} diagrams: " + ", ".join(f"{number} {outcome}" for outcome, number in counts.most_common()))
    faults = [f"{line['seed']} ({line['outcome']})" for line in lines if line["outcome"] in FAULTS]
    print("faults: " + (", ".join(faults[:100]) or "none"))


if __name__ == "__main__":
    main()
