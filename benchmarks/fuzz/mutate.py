"""Try the mutants of many seeds; go on where it was stopped.

    python -m benchmarks.fuzz.mutate --seeds 20000    # goes on where it was stopped
    python -m benchmarks.fuzz.mutate --show 4711      # one mutant and what becomes of it
    python -m benchmarks.fuzz.mutate --again          # what was a fault, once more
"""

from __future__ import annotations

import argparse
import difflib
import json
import resource
import time
from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.fuzz.__main__ import code
from benchmarks.fuzz.campaign import BRIEF, Judge
from benchmarks.fuzz.mutants import files_of, mutant
from benchmarks.fuzz.trying import FAULTS, Tried, tried, unfinished

HERE = Path(__file__).parent
WARM = 10  # mutants tried before the first process is copied
MEMORY = 6_000_000_000  # bytes that one process may take


def main() -> None:
    """Try what is left of the seeds, print the faults, and the counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20_000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--limit", type=float, default=20.0, help="seconds of processor time for each step of a mutant")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="stop after so long")
    parser.add_argument("--results", type=Path, default=HERE / "mutants.jsonl")
    parser.add_argument("--summary", type=Path, help="write the counts of all results to this file, and stop")
    parser.add_argument("--show", type=int, help="print what one seed changes, and what becomes of it")
    parser.add_argument("--again", action="store_true", help="try again what was a fault")
    options = parser.parse_args()
    if options.show is not None:
        print(difference(options.show), tried(options.show))
    elif options.summary:
        options.summary.write_text(json.dumps(summary(options.results), indent=2) + "\n", encoding="utf-8")
    else:
        seeds = range(options.first, options.first + options.seeds)
        done = _results(options.results)
        left = [s for s, line in done.items() if line["outcome"] in FAULTS] if options.again else \
            [s for s in seeds if s not in done]
        _campaign(options.results, left, options.limit, time.monotonic() + 60 * options.minutes)


def _results(file: Path) -> dict[int, dict[str, Any]]:
    """The last line of each seed."""
    lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
    return {line["seed"]: line for line in map(json.loads, lines)}


def _campaign(results: Path, seeds: Iterable[int], limit: float, end: float) -> None:
    for seed in range(WARM):
        tried(seed)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    judged, state = Judge(limit, tried, unfinished), code()
    with results.open("a", encoding="utf-8") as out:
        for seed in seeds:
            found = patiently(judged, seed)
            out.write(json.dumps({**found.as_dict(), "code": state}) + "\n")
            out.flush()
            if found.outcome in FAULTS:
                print(f"seed {seed}, {found.root}: {found.outcome}: {found.what}\n{difference(seed)}", flush=True)
            if time.monotonic() > end:
                break
    judged.close()
    counted = summary(results)
    print(f"{counted['mutants']} mutants: {counted['outcomes']}\nfaults: {counted['faults'] or 'none'}")


def patiently(judged: Judge, seed: int) -> Tried:
    """What becomes of a mutant. One that takes longer than it may is tried over a thousandth of its time: a machine may be
    so fast that its time has millions of steps or events, which is no fault. Then it is `long`, unless it ends badly in
    this time too."""
    found: Tried = judged(seed)
    if found.outcome != "hang":
        return found
    brief: Tried = judged(seed, BRIEF)
    return brief if brief.outcome in FAULTS else replace(brief, outcome="long", what=brief.outcome, seconds=found.seconds)


def difference(seed: int) -> str:
    """What a mutant changes, as lines before and after."""
    given = mutant(seed)
    before = files_of(f"{given.folder.name}/{given.root}").get(given.changed)
    if before is None:
        return f"{given.changed}, a copy of a component of the library:\n{given.files[given.changed]}"
    return "\n".join(difflib.unified_diff(before.split("\n"), given.files[given.changed].split("\n"), given.changed,
                                          f"{given.changed}, {', '.join(given.mutations)}", lineterm="", n=0))


def summary(results: Path) -> dict[str, object]:
    """How many mutants ended how, by what was changed, and how each step ended; the seeds of faults; in which states of the
    program (see `code`) they were tried."""
    lines = list(_results(results).values())
    by_mutation: dict[str, Counter[str]] = {}
    steps: dict[str, Counter[str]] = {}
    for line in lines:
        for name in line["mutations"]:
            by_mutation.setdefault(name, Counter())[str(line["outcome"])] += 1
        for name, outcome in line["steps"].items():
            steps.setdefault(name, Counter())[outcome] += 1
    reasons = Counter(r for line in lines if line["outcome"] == "refused" for r in str(line["what"]).split())
    return {"mutants": len(lines), "outcomes": dict(Counter(str(line["outcome"]) for line in lines).most_common()),
            "steps": {name: dict(found.most_common()) for name, found in steps.items()},
            "mutations": {name: dict(found.most_common()) for name, found in sorted(by_mutation.items())},
            "faults": {line["seed"]: line["outcome"] for line in lines if line["outcome"] in FAULTS},
            "refused for": dict(reasons.most_common()),
            "longest": max((float(line["seconds"]) for line in lines), default=0.0),
            "hours": round(sum(float(line["seconds"]) for line in lines) / 3600, 2),
            "code": dict(Counter(str(line["code"]) for line in lines))}


if __name__ == "__main__":
    main()
