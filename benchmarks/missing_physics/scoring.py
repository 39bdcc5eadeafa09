"""Score answers: the level of the hierarchy that each reaches, false names, held-out error, processor time.

The levels are, from the top down: whether anything is `missing`, the `side` (machine or measuring chain), the `place`, the
`kind` (on what the law depends), the `class` and the `law`. A level counts if all above it are right. The error on the
scored record is the root of the mean square of (prediction - record)/noise over all channels, relative to the best known
one: that of the true machine, or the smallest of all answers that were scored.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.missing_physics.reading import Array, Case, case_at

FOLDER = Path(__file__).parent
LEVELS = ("missing", "side", "place", "kind", "class", "law")
SAME = 0.05  # relative rms difference of the input at the place up to which a law counts as found
Answer = Mapping[str, Any]


@dataclass(frozen=True)
class Score:
    """The score of an answer: the number of `levels` that are right, whether names are `false` (an effect where nothing is
    missing) or `extra` (effects that the machine does not have), the `error` on the scored record in noise units (infinite
    without a usable prediction) and relative to the best known, and the processor time (s)."""

    case: str
    entry: str
    missing: bool
    levels: int
    false: bool
    extra: int
    error: float
    relative: float
    processor: float


def cases(folder: Path = FOLDER) -> dict[str, Case]:
    """All cases on disk by name."""
    return {path.parent.name: case_at(path.parent) for path in sorted((folder / "machines").glob("*/case.json"))}


def truth_of(case: Case) -> dict[str, Any]:
    """The hidden truth of a case."""
    found: dict[str, Any] = json.loads((case.folder.parents[1] / "truths" / f"{case.name}.json").read_text(encoding="utf-8"))
    return found


def error_of(case: Case, truth: Mapping[str, Any], answer: Answer) -> float:
    """The error of the predictions on the scored record, in noise units."""
    squares = []
    for record, file in truth["records"].items():
        table = pd.read_csv(case.folder.parents[1] / "truths" / file)
        for name, channel in case.outputs.items():
            measured = table[channel["column"]].to_numpy(float) * channel["scale"] + channel["offset"]
            predicted = np.array(answer.get("predictions", {}).get(record, {}).get(name, []), float)
            if predicted.shape != measured.shape or not np.all(np.isfinite(predicted)):
                return float("inf")
            squares.append(float(np.mean(((predicted - measured) / channel["noise"])**2)))
    return float(np.sqrt(np.mean(squares)))


def levels_of(effect: Mapping[str, Any], true: Mapping[str, Any], law_found: bool = False) -> int:
    """How many levels below `missing` a named effect and a true one have in common, from the top down."""
    outside = not true["classes"]
    right = (effect.get("side") == true["side"],
             set(effect.get("place", ())) in [set(place) for place in true["places"]],
             effect.get("kind") == true["kind"],
             law_found if outside else effect.get("class") in true["classes"],
             law_found or effect.get("law") in true["laws"])
    return next((k for k, ok in enumerate(right) if not ok), len(right))


def same_input(answer: Answer, truth: Mapping[str, Any]) -> bool:
    """Whether the input that the answer's law gives at the place in the first record is the true one, up to its sign."""
    true, own = truth["input"], answer.get("input")
    if true is None or own is None or len(own["values"]) != len(true["values"]):
        return False
    w, v = np.array(true["values"]), np.array(own["values"], float)
    return bool(min(np.sqrt(np.mean((w - sign * v)**2)) for sign in (1, -1)) <= SAME * np.sqrt(np.mean(w**2)))


def scored(case: Case, answer: Answer, best: float = np.inf) -> Score:
    """The score of one answer; `best` is the smallest known error."""
    truth = truth_of(case)
    dominant, effects = truth["dominant"], list(answer.get("effects", ()))
    true = [*([dominant] if dominant else []), *truth["minor"]]
    extra = sum(not any(levels_of(effect, other) >= 4 or (effect is effects[0] and other is dominant) for other in true)
                for effect in effects)
    levels, false = 0, False
    if dominant is None:
        false = extra > 0
        levels = 0 if false else 1
    elif effects or answer.get("missing"):
        levels = 1 + max((levels_of(effect, dominant, k == 0 and same_input(answer, truth))
                          for k, effect in enumerate(effects)), default=0)
    error = error_of(case, truth, answer)
    best = min(error, best, np.sqrt(truth["floor"]) if truth["floor"] else np.inf)
    return Score(case.name, str(answer["entry"]), dominant is not None, levels, false, extra, error, error / best if
                 np.isfinite(error) else np.inf, float(answer.get("processor", np.nan)))


def answers_in(folder: Path) -> dict[str, dict[str, Answer]]:
    """The answers below a folder by entry and case: `ENTRY/NAME.json`, or the folder of one entry."""
    found: dict[str, dict[str, Answer]] = {}
    for path in sorted(folder.rglob("*.json")):
        answer = json.loads(path.read_text(encoding="utf-8"))
        found.setdefault(answer["entry"], {})[answer["case"]] = answer
    return found


def scores(answers: Mapping[str, Mapping[str, Answer]], root: Path = FOLDER) -> list[Score]:
    """The scores of all answers to known cases."""
    known = cases(root)
    best = {name: min((error_of(case, truth_of(case), its[name]) for its in answers.values() if name in its), default=np.inf)
            for name, case in known.items()}
    return [scored(known[name], answer, best[name]) for its in answers.values() for name, answer in its.items()
            if name in known]


def table(found: Sequence[Score], number: int) -> str:
    """The scores by entry as Markdown; `number` is that of all cases."""
    head = ["entry", "answered", *(f"{level}" for level in LEVELS), "false alarms", "wrong names", "error, median",
            "within 1.1 of the best", "s, median"]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for entry in dict.fromkeys(s.entry for s in found):
        its = [s for s in found if s.entry == entry]
        hidden, nothing = [s for s in its if s.missing], [s for s in its if not s.missing]
        relative = np.array([s.relative for s in its])
        cells = [entry, f"{len(its)} of {number}"]
        cells += [f"{sum(s.levels > k for s in hidden)}/{len(hidden)}" for k in range(len(LEVELS))]
        cells += [f"{sum(s.false for s in nothing)}/{len(nothing)}", str(sum(s.extra for s in its)),
                  f"{np.median(relative):.3g}", f"{np.sum(relative < 1.1)}", f"{np.median([s.processor for s in its]):.1f}"]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def by_case(found: Sequence[Score]) -> str:
    """The deepest right level and the relative error of each entry on each case, as Markdown."""
    entries = list(dict.fromkeys(s.entry for s in found))
    lines = ["| case | " + " | ".join(entries) + " |", "|" + "---|" * (1 + len(entries))]
    for name in dict.fromkeys(s.case for s in found):
        cells = [name]
        for entry in entries:
            score = next((s for s in found if s.case == name and s.entry == entry), None)
            if score is None:
                cells.append("-")
                continue
            level = ("false alarm" if score.false else "nothing") if not score.missing else \
                LEVELS[score.levels - 1] if score.levels else "not seen"
            cells.append(f"{level}, {score.relative:.3g}" if np.isfinite(score.relative) else f"{level}, no prediction")
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def predictions_of(record: str, channels: Mapping[str, Array]) -> dict[str, dict[str, list[float]]]:
    """Predicted channels (SI) of a record in the form of an answer."""
    return {record: {name: [float(f"{v:.6g}") for v in values] for name, values in channels.items()}}
