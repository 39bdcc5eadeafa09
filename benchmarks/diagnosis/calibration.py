"""How often what is called probable is true, over machines of different kinds.

`python -m benchmarks.diagnosis.calibration [SECONDS [MACHINE ...]]` diagnoses the cases that are not on disk yet, one of
each machine after the other, for so long; `python -m benchmarks.diagnosis.calibration fit` fits the constants of
`heavebond.diagnosis.evidence.probability` to all of them and prints the figures."""

from __future__ import annotations

import hashlib
import json
import sys
import tempfile
import time as clock
from collections.abc import Sequence
from pathlib import Path
from unittest.mock import patch

import heavebond as hb
from benchmarks.diagnosis import keeping
from benchmarks.diagnosis.drawing import Drawn, drawn
from benchmarks.diagnosis.machines import MACHINES, Machine
from heavebond.core.errors import HeavebondError
from heavebond.diagnosis.candidates.catalogue import Candidate
from heavebond.diagnosis.candidates.fixed_values import VALUE, fixed_values
from heavebond.diagnosis.candidates.places import Places, candidates
from heavebond.diagnosis.diagnose import Diagnosis
from heavebond.diagnosis.evidence.comparison import ALL

STUDY = "calibration"
CASES = 50  # of each machine
LONGEST = 900.0  # s of a case; one that is not done by then is not counted
NAMING = ("effect", "one_of", "mainly", "parameters")  # verdicts that name a set
LISTED = 8  # candidates of a case that are kept


def rules() -> str:
    """A digest of the modules that decide: rows of other rules are not mixed with those of the present ones."""
    folder = Path(hb.__file__).parent / "diagnosis"
    text = b"".join(path.read_bytes() for path in sorted(folder.glob("*.py")) if path.stem != "probability")
    return hashlib.sha256(text).hexdigest()[:10]


def judged(machine: Machine, number: int) -> dict[str, object]:
    """One case from its draw to the evidence for each event."""
    began = clock.process_time()
    with tempfile.TemporaryDirectory() as folder:
        case = drawn(machine, number, Path(folder))
        made = clock.process_time()
        # the search for an experiment that decides has no part in the probabilities
        with patch("heavebond.diagnosis.phases._separation", lambda *_: None):
            found = hb.diagnose(case.experiment, steps=1, number=1, seconds=LONGEST, classes=case.classes)
    row = _row(case, found)
    return row | {"draw_seconds": round(made - began, 2), "seconds": round(clock.process_time() - made, 2)}


def _row(case: Drawn, found: Diagnosis) -> dict[str, object]:
    assert found.evidence is not None
    effect = case.effect
    return {"hidden": case.hidden, "kind": effect.kind if effect else "", "where": list(effect.where) if effect else [],
            "label": effect.label if effect else case.name, "misfit": round(case.misfit, 3), "values": dict(case.values),
            "records": len(case.experiment.records), "given": case.experiment.noise_given, "partial": found.partial,
            "verdict": found.verdict, "words": list(found.words),
            "chi2": [[r.chi2_fit, r.chi2_held_out] for r in found.ladder], **answers(case, found),
            "evidence": found.evidence.as_dict(), "details": _details(found)}


def answers(case: Drawn, found: Diagnosis) -> dict[str, object]:
    """The set that the answer names, each class and place once, whether what was hidden is in it, and which of the events
    it is. Another value of a number is what was hidden where the effect is nothing but that, to first order (heat capacity
    put on a body, and the mass of that body): the words then name the effect beside the value."""
    step = found.steps[0]
    places = Places.of(step.experiment, step.as_one)
    by_label = {c.label: c for c in (*candidates(step.experiment), *fixed_values(step.experiment))}
    same = {name for label, names in step.acts_as.items() if label in by_label and case.matches(by_label[label], places)
            for name in names}

    def is_hidden(candidate: Candidate) -> bool:
        return case.matches(candidate, places) or (
            candidate.kind == VALUE and not same.isdisjoint(n.name for n in candidate.numbers))

    named = [t.candidate for f in found.findings[:1] for t in f.alternatives] if found.verdict in NAMING else []
    events = found.evidence.effects if found.evidence is not None else ()
    return {"named": [c.label for c in named],
            "size": len({c.name if c.kind == VALUE else (c.kind, places.place(c)) for c in named}),
            "right": any(is_hidden(c) or case.name == c.name for c in named),
            "true": [e.labels[0] for e in events if any(label in by_label and is_hidden(by_label[label])
                                                        for label in e.labels)]}


def _details(found: Diagnosis) -> dict[str, object]:
    """What the evidence was computed from, for those who look for the cause of a wrong answer."""
    step = found.steps[0]
    trials = [*step.trials, *(t for s in found.steps[1:] for t in s.trials if t.candidate.kind == VALUE)][:LISTED]
    return {"samples": step.errors.samples(*ALL) if step.errors is not None else 0,
            "tests": [step.left.score, step.left.size, step.left.memory],
            "blocks": step.identity.blocks if step.identity is not None else None,
            "adequacy": found.adequacy.as_dict() if found.adequacy is not None else None,
            "trials": [[t.candidate.label, t.errors.mean(*ALL) if t.errors is not None else None, t.chi2_fit,
                        t.chi2_held_out, t.unknowns] for t in trials]}


def run(seconds: float, names: Sequence[str] = ()) -> None:
    """What is not on disk yet of all machines, or of those named, for so long."""
    began, now = clock.monotonic(), rules()
    done = keeping.read(STUDY)
    for number in range(CASES):
        for machine in (m for m in MACHINES.values() if not names or m.name in names):
            key = f"{machine.name}/{number}/{now}"
            if key in done:
                continue
            if clock.monotonic() - began > seconds:
                return
            head = {"key": key, "machine": machine.name, "number": number, "rules": now}
            try:
                row = head | judged(machine, number)
            except HeavebondError as error:
                row = head | {"broken": str(error) or "no draw can be simulated"}
            keeping.add(STUDY, row)
            said = {k: row.get(k) for k in ("hidden", "label", "misfit", "verdict", "seconds", "draw_seconds", "broken")}
            print(f"{key:40s} {json.dumps(said)}", flush=True)


def main(words: list[str]) -> None:
    """The study, or the fit of the constants to it."""
    if words[:1] == ["fit"]:
        from benchmarks.diagnosis.reliability import fit

        fit()
    else:
        run(float(words[0]) if words else float("inf"), words[1:])


if __name__ == "__main__":
    main(sys.argv[1:])
