"""Records in which nothing is hidden but noise, and in every other one wrong parameters:
`python -m benchmarks.diagnosis.false_alarms`."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import heavebond as hb
from benchmarks.diagnosis import keeping
from benchmarks.diagnosis.judging import told
from benchmarks.diagnosis.making import SHARE, Hidden
from benchmarks.diagnosis.rigs import RIGS, Rig
from heavebond.numerics.physical_limits import LimitPassed

STUDY = "false_alarms"
NUMBER = 100


def judged(rig: Rig, key: str, share: float) -> dict[str, object] | None:
    """One record without anything hidden, from its making to what was said; None if a part of the machine that was drawn
    passes its physical limit."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            case = Hidden(rig, (), f"{keeping.DRAW}/{key}", Path(folder), share=share).case()
        except LimitPassed:
            return None
        found = hb.diagnose(case.experiment, number=1)
        row = told(rig, case, found)
        return {"key": key, "rig": rig.name, "share": share, "values": dict(case.values), **row}


def main(names: Sequence[str]) -> None:
    """What is not on disk yet."""
    done = keeping.read(STUDY)
    rigs = list(RIGS.values())
    for k in range(NUMBER):
        rig = rigs[k % len(rigs)]
        key = f"{rig.name}/nothing {k}"
        if key in done or (names and rig.name not in names):
            continue
        row = judged(rig, key, SHARE * (k // len(rigs) % 2))
        if row is None:
            print(f"{'not drawn':12s} {key}", flush=True)
            continue
        keeping.add(STUDY, row)
        print(f"{row['outcome']:12s} {key} {row['verdict']} {row['seconds']:.0f} s {row['left']}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
