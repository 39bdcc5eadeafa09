"""What a diagnosis said, against what was hidden."""

from __future__ import annotations

from benchmarks.diagnosis.making import Case
from benchmarks.diagnosis.rigs import Rig
from heavebond.diagnosis.candidates.catalogue import Candidate
from heavebond.diagnosis.diagnose import Diagnosis
from heavebond.diagnosis.search.step import merit

SECONDS = float("inf")  # for a search: the machine may be busy, and what is not refitted would count as rejected
SEEN = 3.0  # chi-square per sample above noise from which an effect must be named


def outcome(rig: Rig, case: Case, found: Diagnosis) -> str:
    """right (one class at one place, and that one), cluster (among those that are said to be alike), wrong (named, but
    another), shape, missed; a `weak` one could not be made as large as `SEEN`."""
    said = found.verdict
    if not case.truths:
        told = said in ("nothing", "parameters") or (said == "undetermined" and not found.steps[0].left.significant)
        return "right" if told else "false alarm"
    named = [{_key(rig, f.candidate)} for f in found.findings]
    if all(t.outside for t in case.truths):
        # a law that the catalogue lacks: its shape; or its class and place, where a law of that class comes near
        near = said in ("effect", "one_of", "mainly") and bool(named[0] & case.accepted[0])
        return "right" if near or said == "shape" else "wrong" if said in ("effect", "one_of", "mainly") else "missed"
    if said in ("nothing", "parameters", "undetermined"):
        return "missed" if case.misfit >= SEEN else "weak"
    if said == "shape":
        return "shape"
    alike = [{_key(rig, t.candidate) for t in f.alternatives} for f in found.findings]
    # a part in series on either side of another one is at one place
    if all(any(n & accepted for n in named) for accepted in case.accepted) and all(len(a) == 1 for a in alike):
        return "right"
    if all(any(n & accepted for n in alike) for accepted in case.accepted):
        return "cluster"
    return "wrong"


def _key(rig: Rig, candidate: Candidate) -> tuple[str, frozenset[str]]:
    return candidate.kind, rig.place(candidate.where)


def told(rig: Rig, case: Case, found: Diagnosis) -> dict[str, object]:
    """Everything that helps to see why."""
    first = found.steps[0]
    accepted = frozenset().union(*case.accepted)
    hidden = [t.label for t in case.truths]
    best = merit(first.trials[0]) if first.trials else 0.0
    trials = [{"label": t.candidate.label, "kind": t.candidate.kind, "merit": merit(t) - best, "fit": t.chi2_fit,
               "held": t.chi2_held_out, "at_end": list(t.at_end), "unknowns": t.unknowns, "evaluations": t.evaluations,
               "truth": t.candidate.label in hidden, "accepted": _key(rig, t.candidate) in accepted,
               "values": {n.name: t.values[n.name] for n in t.candidate.numbers if n.name in t.values}}
              for t in first.trials]
    scores = [{"label": s.candidate.label, "z": s.z, "gain": s.gain, "share": s.share, "size": s.size} for s in first.scores]
    return {"outcome": outcome(rig, case, found), "kinds": [min(kind for kind, _ in a) for a in case.accepted if a],
            "verdict": found.verdict, "words": list(found.words),
            "named": [{"kind": f.candidate.kind, "place": f.candidate.place, "component": f.candidate.component,
                       "held": f.rung.chi2_held_out, "kinds": list(f.kinds),
                       "one_of": [t.candidate.label for t in f.alternatives]}
                      for f in found.findings],
            "shape": found.shape and found.shape.candidate.label,
            "ladder": [(r.name, r.chi2_fit, r.chi2_held_out) for r in found.ladder],
            "left": {"score": first.left.score, "size": first.left.size, "memory": first.left.memory, "z": first.left.z},
            "base_at_end": list(first.at_end), "twins": {k: list(v) for k, v in first.twins.items()},
            "rank": next((k for k, t in enumerate(first.trials) if t.candidate.label in hidden), None),
            "scored_at": next((k for k, s in enumerate(first.scores) if s.candidate.label in hidden), None),
            "refitted": len(first.trials), "partial": any(s.partial for s in found.steps), "seconds": found.seconds,
            "trials": [t for k, t in enumerate(trials) if k < 10 or t["accepted"]],
            "scores": [s for k, s in enumerate(scores) if k < 6 or s["label"] in hidden]}
