"""How often what is called probable is true, on cluttered machines of different kinds.

`python -m benchmarks.diagnosis.calibration run` diagnoses the cases that are not on disk yet, one of each machine after the
other; with names of machines only these. `--cases` of each machine, `--limit` is the processor time of each diagnosis in s
(the answer at the limit counts), `--seconds` the duration after which no case is begun.

`python -m benchmarks.diagnosis.calibration report` prints how reliable the probabilities are, with the constants of
`heavebond.diagnosis.evidence.probability` and with those that are fitted to all other machines; `--pictures DIR` for the
reliability diagrams."""

from __future__ import annotations

import argparse
import ast
import hashlib
import json
import tempfile
import time as clock
import traceback
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from unittest.mock import patch

import numpy as np

import heavebond as hb
from benchmarks.diagnosis import keeping, reliability
from benchmarks.diagnosis.cluttered import Drawn, drawn
from benchmarks.diagnosis.drawing import alike
from benchmarks.diagnosis.machines import MACHINES, Machine
from benchmarks.diagnosis.measured import count_processor_time
from heavebond.core.cancellation import Budget
from heavebond.diagnosis.answer.tree import LEVELS, Leaf, answer_leaves, levels
from heavebond.diagnosis.candidates.catalogue import Candidate
from heavebond.diagnosis.candidates.fixed_values import VALUE
from heavebond.diagnosis.candidates.varying import BY_RECORD
from heavebond.diagnosis.diagnose import Diagnosis
from heavebond.diagnosis.evidence.comparison import ALL, loss
from heavebond.diagnosis.evidence.prediction import confidence_set, discrepancy, levelled
from heavebond.diagnosis.evidence.probability import (
    CALIBRATION,
    OUTSIDE,
    TEMPERATURES,
    Evidence,
    compared_step,
    evidence,
    parts,
)
from heavebond.diagnosis.search.step import Stage
from heavebond.numerics.dae import Array

STUDY = reliability.STUDY
CASES = 30  # of each machine
LIMIT = 60.0  # s of processor time of a diagnosis
DRAWING = 120.0  # s of processor time of a draw
SHOWN = ("hidden", "truth", "stated", "named", "seconds", "draw_seconds", "broken", "trace")  # while the study runs
LISTED = 6  # refits whose errors are kept
LEAVES = 20  # laws that are kept,
LEAST = 0.003  # with at least this weight
DIGITS = 4
GRID = TEMPERATURES[1:]
VARIES = "varying parameter"


def rules() -> str:
    """A digest of the statements of the diagnosis, without docstrings and comments: rows of other rules are not mixed with
    those of the present ones."""
    digest = hashlib.sha256()
    for path in sorted((Path(hb.__file__).parent / "diagnosis").rglob("*.py")):
        module = ast.parse(path.read_bytes())
        for node in ast.walk(module):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None:
                del node.body[0]
        digest.update(ast.dump(module).encode())
    return digest.hexdigest()[:10]


def judged(machine: Machine, number: int, limit: float) -> dict[str, object]:
    """One case from its draw to the evidence for each branch of the answer."""
    began = clock.process_time()
    with tempfile.TemporaryDirectory() as folder:
        case = Budget(DRAWING).made(lambda: drawn(machine, number, Path(folder)))
        if case is None:
            return {"broken": f"no draw within {DRAWING:g} s"}
        made = clock.process_time()
        # the search for an experiment that decides has no part in the probabilities
        with patch("heavebond.diagnosis.phases._separation", lambda *_: None):
            answer = hb.diagnose(case.experiment, number=1, seconds=limit, classes=case.classes)
        ended = clock.process_time()
        row = _row(case, answer)
    return row | {"draw_seconds": round(made - began, 1), "seconds": round(ended - made, 1), "limit": limit}


def _row(case: Drawn, answer: Diagnosis) -> dict[str, object]:
    truth = case.effect.label if case.effect is not None else case.name
    row: dict[str, object] = {
        "hidden": case.hidden, "truth": truth, "kind": case.effect.kind if case.effect is not None else "",
        "misfit": round(case.misfit, 3), "share": round(case.share, 3), "minor": case.minor,
        "records": len(case.experiment.records), "given": case.experiment.noise_given, "partial": answer.partial,
        "verdict": answer.verdict, "chi2": [[_short(r.chi2_fit), _short(r.chi2_held_out)] for r in answer.ladder]}
    if not answer.steps or answer.evidence is None:
        return row
    compared = [compared_step(step, answer.reviews[k] if k < len(answer.reviews) else None)
                for k, step in enumerate(answer.steps[:max(1, len(answer.findings))])]
    row["named"] = [[f.candidate.label, _match(case, step, f.candidate)]
                    for step, f in zip(compared, answer.findings, strict=False)]
    row["stated"] = [[[node.level, node.name, round(node.probability, DIGITS)] for node in tree.path]
                     for tree in answer.tree.effects]
    evidences = [answer.evidence, *(evidence(answer.steps[k:], review=answer.reviews[k] if k < len(answer.reviews) else None)
                                    for k in range(1, len(compared)))]
    row["trees"] = [evidence_of(case, step, known, answer, first=k == 0)
                    for k, (step, known) in enumerate(zip(compared, evidences, strict=True))]
    return row | {"errors": _errors(case, compared[0])}


def _short(x: float) -> float:
    return float(f"{x:.4g}")


def _match(case: Drawn, step: Stage, candidate: Candidate) -> int:
    """2 if a candidate is the dominant effect, or acts as the value that is wrong; 1 if it is a minor one; else 0."""
    values = {*step.acts_as.get(candidate.label, ()), *([candidate.name] if candidate.kind == VALUE else [])}
    if case.effect is not None and candidate.kind != VALUE:
        if case.matches(candidate, step.places):
            return 2
    elif case.effect is not None:
        if candidate.name in step.acts_as.get(case.effect.label, ()):
            return 2
    elif case.name in values:
        return 2
    effects = [e for e in case.minor_effects if candidate.kind != VALUE and alike(e, candidate, step.places)]
    return int(bool(effects) or any(what in ("value", "sheet") and name in values for what, name, _ in case.minor))


def evidence_of(case: Drawn, step: Stage, known: Evidence, answer: Diagnosis, first: bool = True) -> dict[str, object]:
    """What the probabilities of all branches of the tree of one effect are computed from, at each temperature, and which of
    them are true; `first` for the tree of the first effect.

    `laws`: for each law the numbers of its branches from the level `system` down, whether they belong to one of the hidden
    differences (1 or 0 for each), whether they belong to the dominant one, whether the law is outside the catalogue, and its
    weights. `values`: the weights of wrong values of parameters that the diagram holds fixed. `flexible`: the weights of the
    identified curves relative to the weights of all effects. `nothing` is true if no effect dominates, or if the dominant
    effect acts as a wrong value."""
    candidates = {c.label: c for c in (*(s.candidate for s in step.scores), *(t.candidate for t in step.trials))}
    table: dict[tuple[object, ...], _Law] = {}
    values = np.zeros(len(GRID))
    for k, temperature in enumerate(GRID):
        constants = replace(CALIBRATION, temperature=temperature)
        effects, outside, _ = answer_leaves(step, known, answer.localization if first else None, constants)
        _, _, mass, among = map(float, parts(constants, known.missing, known.sheet, known.left,
                                             known.outside.get(temperature, float("nan"))))
        # the laws that explain nothing belong to the mass of all effects, at the places of laws outside the catalogue
        unexplained = (1 - known.untried) * known.unexplained(temperature)
        everything = max(mass + among * unexplained, 1e-300)
        for leaf, weight, of_outside in [*((leaf, leaf.probability / max(among, 1e-300), False) for leaf in effects),
                                         *((leaf, leaf.probability / everything, True) for leaf in outside),
                                         *((leaf, leaf.probability / everything * unexplained, False) for leaf in outside)]:
            law = table.setdefault((leaf.keys, leaf.labels, of_outside), _Law(leaf, np.zeros(len(GRID)), of_outside))
            law.weights[k] += weight
        if known.effects:
            values[k] = (1 - known.untried) * sum(
                float(w) for e, w in zip(known.effects, known.weights[temperature], strict=True) if e.kind == VALUE)
    laws = sorted(table.values(), key=lambda law: -law.weights.max())
    hidden = hidden_levels(case, step)
    entries = []
    for law in laws:
        matches = max((_match(case, step, candidates[label]) for label in law.leaf.labels if label in candidates), default=0)
        dominant, every = (belonging(law.leaf.keys, of, matches >= least) for of, least in ((hidden[:1], 2), (hidden, 1))) \
            if case.effect is not None else [str(int(matches == 2)) * len(law.leaf.keys)] * 2
        entries.append(Entry(law.leaf.keys, every, dominant, law.weights, law.of_outside))
    values_alike = case.effect is not None and bool(step.acts_as.get(case.effect.label))
    adequacy = answer.adequacy
    return {"laws": listed(entries), "names": [" | ".join(law.leaf.names[1:]) for law in laws[:3]],
            "values": [round(float(v), DIGITS) for v in values],
            "nothing": int(first and (case.hidden in ("clutter", "value") or values_alike)),
            "left": _short(known.left), "missing": _short(known.missing), "sheet": _short(known.sheet),
            "untried": round(known.untried, 3),
            "flexible": [_short(known.outside[t]) for t in GRID] if known.outside else None,
            "curves": [len(known.curves), *([int(adequacy.tried), int(adequacy.beaten)] if adequacy is not None else [])]}


@dataclass(frozen=True)
class Entry:
    """A law in a row: the keys of its branches, whether they are true, whether they belong to the dominant effect, its
    weights (k,), and whether these are shares of the mass of laws outside the catalogue."""

    keys: tuple[object, ...]
    truths: str
    dominant: str
    weights: Array
    of_outside: bool


def listed(entries: Sequence[Entry]) -> list[list[object]]:
    """The entries of a row, those with the largest weights first: the branches as numbers. Small ones count together, in a
    branch of the level `system` without others below it."""
    large = [entry for entry in entries if entry.weights.max() >= LEAST][:LEAVES]
    small: dict[tuple[object, bool], Entry] = {}
    for entry in (e for e in entries if not any(e is other for other in large)):
        key = entry.keys[0], entry.of_outside
        keys = (entry.keys[0], *([OUTSIDE] if entry.of_outside else []))
        before = small.get(key, Entry(keys, "0", "0", np.zeros(len(GRID)), entry.of_outside))
        small[key] = replace(before, weights=before.weights + entry.weights, truths=max(before.truths, entry.truths[0]),
                             dominant=max(before.dominant, entry.dominant[0]))
    numbers: dict[tuple[object, ...], int] = {}
    rows: list[list[object]] = []
    for entry in (*large, *small.values()):
        branches = [numbers.setdefault(entry.keys[:d + 1], len(numbers)) for d in range(len(entry.truths))]
        rows.append([branches, entry.truths, entry.dominant, int(entry.of_outside),
                     [round(float(w), DIGITS) for w in entry.weights]])
    return rows


@dataclass(frozen=True)
class _Law:
    """A law and its weights (k,) at the temperatures, of the mass of laws outside the catalogue or of the effects."""

    leaf: Leaf
    weights: Array
    of_outside: bool


def hidden_levels(case: Drawn, step: Stage) -> list[tuple[tuple[object, ...], bool]]:
    """The branches (keys from the level `system` down) of the hidden differences, the dominant one first, and whether the
    law of each is missing from the catalogue. A drift, a cycle and a value of each record are variations of a parameter of
    their part, and a late channel is a delay in it; values that are wrong in all records have no branch."""
    library = step.experiment.model.library
    candidates = [*(s.candidate for s in step.scores), *(t.candidate for t in step.trials)]
    unknown = {label for what, label, _ in case.minor if what == "unknown law"}
    effects = [(case.effect, case.hidden in ("other law", "outside"))] if case.effect is not None else []
    effects += [(effect, effect.label in unknown) for effect in case.minor_effects]
    found = [(levels(step, effect, effect.kind, library)[0], missing) for effect, missing in effects]
    for what, name, _ in case.minor:
        part = name.rpartition(".")[0]
        kinds, where = {"drift": ((VARIES,), part), "cycle": ((VARIES,), part), "record": ((BY_RECORD,), part),
                        "late": (("delay",), name)}.get(what, ((), ""))
        alike_ones = [c for c in candidates if c.kind in kinds and where in c.where]
        found += [(levels(step, c, c.kind, library)[0][:4], what == "cycle") for c in alike_ones[:1]]
    return found


def belonging(branches: Sequence[object], hidden: Sequence[tuple[tuple[object, ...], bool]], matches: bool = False) -> str:
    """Whether each of the `branches` of a law belongs to one of these differences (1 or 0), or the law `matches` one in its
    class. A law outside the catalogue is true where the component of the difference is missing, at its place and of its
    kind."""
    best = "0" * len(branches)
    for keys, unknown in hidden:
        truths = ""
        for depth, key in enumerate(branches):
            right = (depth < len(keys) and key == keys[depth]) or (key == OUTSIDE and unknown) \
                or (matches and LEVELS[depth + 1] != "law")
            truths += str(int(right and "0" not in truths))
        best = max(best, truths)
    return best


def _errors(case: Drawn, step: Stage) -> dict[str, object] | None:
    """The predictive errors of the first refits, and of the model without any, for each uninterrupted stretch of the
    records: sums in units of its discrepancy, samples, roles; and how many independent blocks the samples are worth."""
    if step.errors is None:
        return None
    bins = len(step.errors.sums)
    trials = sorted((t for t in step.trials if t.errors is not None and len(t.errors.sums) == bins > 0), key=loss)[:LISTED]
    errors = [t.errors for t in trials if t.errors is not None]
    if not errors:
        return None
    stretch, counts = errors[0].stretch, errors[0].counts
    level = discrepancy(errors)
    begins = np.flatnonzero(np.r_[True, np.diff(stretch) > 0])
    sums = [[_short(x) for x in np.bincount(stretch, row)] for row in (step.errors.sums / level, *levelled(errors))]
    return {"samples": errors[0].samples(*ALL), "counts": np.bincount(stretch, counts).astype(int).tolist(),
            "role": errors[0].role[begins].tolist(), "level": [_short(x) for x in level[begins]],
            "blocks": _short(confidence_set(levelled(errors), counts, stretch).blocks), "without": sums[0],
            "trials": [[t.candidate.label, _match(case, step, t.candidate), t.unknowns, row]
                       for t, row in zip(trials, sums[1:], strict=True)]}


def run(seconds: float, cases: int, limit: float, names: Sequence[str] = (), study: str = STUDY) -> None:
    """What is not on disk yet of all machines, or of those named, for so long."""
    count_processor_time()
    began, now = clock.monotonic(), rules()
    done = keeping.read(study)
    for number in range(cases):
        for machine in (m for m in MACHINES.values() if not names or m.name in names):
            key = f"{machine.name}/{number}/{now}"
            if key in done:
                continue
            if clock.monotonic() - began > seconds:
                return
            row: Mapping[str, object] = {"key": key, "machine": machine.name, "number": number, "rules": now}
            try:
                row = {**row, **judged(machine, number, limit)}
            except Exception as error:  # one case must not end a study of days
                row = {**row, "broken": f"{type(error).__name__}: {error}", "trace": [
                    f"{Path(f.filename).name}:{f.lineno}" for f in traceback.extract_tb(error.__traceback__)[-12:]]}
            keeping.add(study, row)
            shown = {k: row[k] for k in SHOWN if k in row}
            print(f"{key:40s} {json.dumps(shown, default=float)}", flush=True)


def main() -> None:
    """The study, or the report on it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("command", choices=["run", "report"])
    parser.add_argument("machines", nargs="*", choices=[*MACHINES, []], metavar="MACHINE", help=", ".join(MACHINES))
    parser.add_argument("--cases", type=int, default=CASES, help="of each machine")
    parser.add_argument("--limit", type=float, default=LIMIT, help="processor time of a diagnosis (s)")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="duration after which no case is begun")
    parser.add_argument("--study", default=STUDY, help="file of the results, without ending")
    parser.add_argument("--pictures", type=Path, metavar="DIR", help="write the reliability diagrams")
    options = parser.parse_args()
    if options.command == "run":
        run(options.seconds, options.cases, options.limit, options.machines, options.study)
    else:
        print(reliability.report(reliability.known_rows(options.study), options.pictures))


if __name__ == "__main__":
    main()
