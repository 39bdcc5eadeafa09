"""Each effect of the catalogue hidden in turn, and what the diagnosis says: `python -m benchmarks.diagnosis.confusion`.

Names of rigs narrow it down.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import heavebond as hb
from benchmarks.diagnosis import keeping
from benchmarks.diagnosis.judging import SECONDS, told
from benchmarks.diagnosis.making import made
from benchmarks.diagnosis.rigs import RIGS, Rig
from benchmarks.diagnosis.truths import PAIRS, TRUTHS, Truth

STUDY = "confusion"
STILL = 0.002  # of the excitation, too little to tell anything


def cases(rig: Rig) -> Iterator[tuple[str, list[Truth], float]]:
    """Key, what is hidden and the scale of the excitation."""
    known = {t.name: t for t in TRUTHS[rig.name]}
    for truth in known.values():
        yield f"{rig.name}/{truth.name}", [truth], 1.0
    for pair in PAIRS[rig.name]:
        yield f"{rig.name}/{' + '.join(pair)}", [known[name] for name in pair], 1.0
    yield f"{rig.name}/still", [], STILL


def judged(rig: Rig, key: str, truths: Sequence[Truth], scale: float) -> dict[str, object]:
    """One case from making its records to what was said of them."""
    with tempfile.TemporaryDirectory() as folder:
        case = made(rig, truths, f"{keeping.DRAW}/{key}", Path(folder), scale)
        found = hb.diagnose(case.experiment, steps=max(1, len(truths)), number=1, seconds=SECONDS)
        return {"key": key, "rig": rig.name, "truth": [t.name for t in truths], "label": [t.label for t in truths],
                "misfit": case.misfit, "amplitudes": list(case.amplitudes), "drawn": list(case.drawn),
                "values": dict(case.values), **told(rig, case, found)}


def main(names: Sequence[str]) -> None:
    """What is not on disk yet."""
    done = keeping.read(STUDY)
    for rig in (r for r in RIGS.values() if not names or r.name in names):
        for key, truths, scale in cases(rig):
            if key in done and done[key]["outcome"] != "broken":
                continue
            try:
                row = judged(rig, key, truths, scale)
            except hb.HeavebondError as error:
                row = {"key": key, "rig": rig.name, "truth": [t.name for t in truths], "label": [t.label for t in truths],
                       "outcome": "broken", "words": str(error)}
            keeping.add(STUDY, row)
            print(f"{row['outcome']:12s} {key:45s} misfit {row.get('misfit', 0):8.3g} {row.get('verdict', '')} "
                  f"{row.get('seconds', 0):.0f} s  {row.get('words')}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
