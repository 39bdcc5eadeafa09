"""The tables of docs/diagnosis_study.md from the results on disk: `python -m benchmarks.diagnosis.page`."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.diagnosis import (
    compensator,
    confusion,
    detectability,
    false_alarms,
    keeping,
    measured,
    reliability,
    verdicts,
)
from benchmarks.diagnosis.rigs import RIGS
from heavebond.core.presentation import readable
from heavebond.diagnosis.evidence.probability import CALIBRATION

PAGE = Path(__file__).parents[2] / "docs" / "diagnosis_study.md"
BEGIN, END = "<!-- written by `python -m benchmarks.diagnosis.page` -->", "<!-- end of what it writes -->"
OUTCOMES = {"right": "named", "cluster": "among the indistinguishable", "shape": "a shape, no name", "missed": "missed",
            "weak": "too weak", "wrong": "misclassified", "broken": "broken"}
NEVER = 1e4  # chi-square per sample; nobody begins a diagnosis so far from the record
Row = Mapping[str, Any]
HIDDEN = {"clutter": "nothing but clutter", "value": "a wrong fixed value", "inside": "an effect of the catalogue",
          "other law": "another law of a class", "outside": "a class that is struck"}
DRAW = """\
The cases are cluttered machines, drawn at random from bundled diagrams of all domains by `python -m
benchmarks.diagnosis.calibration run`. The command runs one case of each machine in turn and can be interrupted and
continued. The distribution of the cases is also the prior of the [probabilities](diagnosis_method.md#probabilities):

* a dominant effect causes 50 to 95 % of the misfit, two to four minor differences cause the rest; the misfit is 3 to 400
  noise variances per sample, log-uniform;
* the dominant effect is a law of the catalogue (45 % of the cases), an effect whose law is removed from the catalogue, which
  retains another law of the class (13 %), an effect whose whole class is removed (22 %), or a wrong fixed value of the
  diagram (8 %); the other cases (12 %) have no dominant effect, and the minor differences cause 0.02 to 0.5 noise variances
  per sample;
* minor differences are laws of the catalogue, laws that are removed from it, data-sheet values that are wrong, also by more
  than their tolerance, and parameters that drift, oscillate, or differ between records;
* inputs are recorded with noise; channels are up to one and a half samples late, and quantised;
* the class is drawn uniformly from the classes that are possible in the machine, then law and place; there are one to three
  records of 240 to 300 samples; the noise is 0.3 to 1.5 % of the motion of a channel, and is specified in 60 % of the cases;
* each diagnosis has 60 s of processor time; the answer at this limit counts.

The tables count the deepest level that each tree of the answer states, and whether a hidden difference agrees with it."""
CALIBRATED = """\
The constants of the [probabilities](diagnosis_method.md#probabilities) are fitted to these cases; for each machine, they are
fitted to all other machines (`python -m benchmarks.diagnosis.calibration report`).

The *expected calibration error* is the difference between the mean stated probability and the true frequency, computed in
bins and averaged with weights. With so few cases, the error is not zero even for exact probabilities: the brackets contain
the 95 % quantile of the error that exact probabilities would have by chance. The constants have prior distributions, which
keep them within a factor of about e of the values that were assumed before any case was evaluated."""
MEASURED = """\
The records are public records of real machines. The diagrams lack the effects that are known from the authors of the
records, from the literature or from the records themselves (`python -m benchmarks.diagnosis.measured FOLDER --processor
--seconds 180`, in one process). The column *answer* contains the first two sentences of the tree; if there are several
effects, a summary precedes them. *So far* means that the time limit ended the search. The error is the root mean square on
the test record or, without a test record, on the last validation record. The brackets contain its share of the root mean
square of the measured signal. The first error is the error with fitted free parameters, the others are the errors after each
effect. Published figures were obtained with other methods, some with other parts of the records; *verified* figures were
read in the source.

In nine of ten sets the first effect of the answer has the right place and class. The exception is the set of the tanks,
whose diagram has linear outlets: a dead band of the pump explains more of the misfit than square-root outlets alone (0.56 V
on the test record; 0.67 V with both outlets replaced, in an independent fit), and the overflow is the second effect. The
controller of the pendulum is not known, so the model is driven by the measured torque, and the effects in this torque are
missing as well. The end stops of the damper and of the pendulum describe these records, but do not prove that the machines
have end stops."""


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines)


def figure(value: float, digits: int = 3) -> str:
    """So many digits, without an exponent where that is short."""
    return f"{value:.{digits}g}"


def alarms(rows: Sequence[Row]) -> str:
    """Verdicts where nothing is hidden."""
    groups: dict[tuple[str, bool], Counter[str]] = {}
    for row in rows:
        groups.setdefault((row["rig"], row["share"] > 0), Counter())[row["verdict"]] += 1
    lines = [(rig, "drawn from the tolerance" if drawn else "as in the data sheet", sum(found.values()),
              found["nothing"], found["parameters"], sum(found.values()) - found["nothing"] - found["parameters"])
             for (rig, drawn), found in sorted(groups.items())]
    told = sum(line[-1] for line in lines)
    were = "was" if told == 1 else "were"
    return f"{told} of {len(rows)} records without a hidden effect {were} misclassified.\n\n" + table(
        ["rig", "parameters drawn", "records", "result: nothing", "result: parameters", "misclassified"], lines)


def outcomes(rows: Sequence[Row]) -> str:
    """How many of each outcome on each rig."""
    single = [r for r in rows if len(r["truth"]) == 1 and all(r["label"])]
    lines = []
    for rig in RIGS:
        found = Counter(r["outcome"] for r in single if r["rig"] == rig)
        if found:
            lines.append((rig, sum(found.values()), *(found[o] for o in OUTCOMES)))
    total = Counter(r["outcome"] for r in single)
    lines.append(("all", len(single), *(total[o] for o in OUTCOMES)))
    return table(["rig", "effects", *OUTCOMES.values()], lines)


def said(row: Row) -> str:
    """What was answered, in short."""
    if row["outcome"] == "broken":
        return "-"
    named = "; ".join(" or ".join([f"**{f['kind']}** {f['place']}", *f["one_of"][1:5]]) for f in row["named"])
    if row["verdict"] in ("effect", "one_of"):
        return named
    return f"{row['verdict']} ({row['shape']})" if row.get("shape") else str(row["verdict"])


def cases(rows: Sequence[Row]) -> str:
    """Every case."""
    lines = []
    for row in rows:
        ladder = row.get("ladder") or []
        before = ladder[min(1, len(ladder) - 1)][2] if ladder else float("nan")
        after = ladder[-1][2] if ladder else float("nan")
        hidden = " and ".join(label or f"{name} (not in the catalogue)"
                              for name, label in zip(row["truth"], row["label"], strict=True)) or "nothing, hardly moved"
        outcome = OUTCOMES.get(row["outcome"], row["outcome"])
        lines.append((row["rig"], hidden, figure(row.get("misfit", float("nan"))), outcome, said(row),
                      f"{figure(before)} to {figure(after)}", f"{row.get('seconds', 0):.0f}"))
    return table(["rig", "hidden effect", "misfit", "outcome", "result", "chi-square, held out", "s"], lines)


def matrix(rows: Sequence[Row]) -> str:
    """Classes hidden against classes said, the first named."""
    counts: dict[str, Counter[str]] = {}
    for row in rows:
        if len(row["truth"]) == 1 and row["outcome"] != "broken" and row["label"][0]:
            kind, named = row["kinds"][0], row["verdict"] in ("effect", "one_of")
            told = kind if row["outcome"] in ("right", "cluster") else row["named"][0]["kind"] if named else row["verdict"]
            counts.setdefault(kind, Counter())[told] += 1
    lines = [(kind, sum(found.values()), found[kind], ", ".join(f"{k} ({n})" for k, n in found.items() if k != kind) or "-")
             for kind, found in sorted(counts.items())]
    return table(["hidden class", "cases", "named, or among the indistinguishable", "other"], lines)


def sizes(rows: Sequence[Row], checks: Sequence[Row]) -> str:
    """How large effects must be, and what was said of ten of them."""
    best: dict[tuple[str, str], Row] = {}
    for row in rows:
        key = (row["rig"], row["label"])
        if key not in best or row["misfit_named"] < best[key]["misfit_named"]:
            best[key] = row
    lines = [(r["rig"], r["label"], *_from(r, "seen"), *_from(r, "named"), r["rival"], f"{r['cosine']:.4f}")
             for r in best.values()]
    points: dict[tuple[str, str], dict[float, Row]] = {}
    for row in checks:
        points.setdefault((row["rig"], row["label"]), {})[row["factor"]] = row
    told = [(*key, *(_told(found[f]) if f in found else "-" for f in detectability.FACTORS))
            for key, found in points.items()]
    return "\n\n".join([
        table(["rig", "effect", "detected from", "misfit", "distinguished from", "misfit",
               "nearest of another class or place", "cosine"], lines),
        "The prediction was checked by simulation at half and at twice the amplitude from which the effect should be "
        "distinguished:",
        table(["rig", "effect", "at half", "at twice"], told)])


def _from(row: Row, what: str) -> tuple[str, str]:
    """An amplitude with its unit and the misfit that goes with it; nothing tells two apart that move all channels alike."""
    if row[f"misfit_{what}"] > NEVER:
        return "never", "-"
    return f"{figure(row[what])} {next(iter(row['numbers'].values()))}".removesuffix(" 1"), figure(row[f"misfit_{what}"])


def _told(row: Row) -> str:
    """What was said of one point."""
    outcome = {"weak": "not named", "missed": "not named"}.get(row["outcome"], OUTCOMES.get(row["outcome"], row["outcome"]))
    return outcome if outcome == "named" else f"{outcome}: {said(row)}"


def machine(rows: Sequence[Row]) -> str:
    """The cases of the compensator: what was said, and what of the whole catalogue it took."""
    lines, values = [], []
    for row in rows:
        ladder = row["ladder"]
        effects = [f"{p['name']} {readable(p['value'], p['unit'], 3)}" for p in row["parameters"]]
        off = [abs(row["fitted"][name] / true - 1) for name, true in row["values"].items() if name in row["fitted"]]
        outcome = OUTCOMES[row["outcome"]] if row["kinds"] else {"right": "correct"}.get(row["outcome"], row["outcome"])
        lines.append((row["key"], outcome, said(row),
                      " to ".join(figure(ladder[k][2], 4) for k in ([1, -1] if len(ladder) > 2 else [-1])),
                      f"{row['refitted']} of {row['scored']}", f"{row['processor']:.0f}", f"{row['megabytes']:.0f}"))
        values.append((row["key"], ", ".join(effects) or "-", f"{100 * max(off, default=0):.1f} %"))
    return "\n\n".join([
        "The effects were hidden in [the compensator](compensator.md#results-of-a-diagnosis). The diagnosis used the whole "
        "catalogue in one process. Of the candidates that can be simulated, only the candidates that can reduce the error "
        "are refitted.",
        table(["hidden effect", "outcome", "result", "chi-square, held out", "refitted", "processor time, s", "MB"], lines),
        "The table lists the estimated values, and the largest deviation of the free parameters from their true values:",
        table(["hidden effect", "estimated values of the effect", "largest deviation"], values)])


def public_records(rows: Sequence[Row]) -> str:
    """The measured sets: the answer and the errors on the record that is kept for the test, beside published figures."""
    lines = []
    for row in rows:
        known = measured.SETS[row["key"]]
        test = next((n for n, use in row["uses"].items() if use == "test"), list(row["errors"][0])[-1])
        errors = [", ".join(f"{readable(error, unit, 3)} ({100 * share:.3g} %)"
                            for error, unit, share in entry[test].values()) for entry in row["errors"]]
        tree = row["answer"]["tree"]
        several = len(tree["effects"]) > 1 or bool(tree["further"])
        lines.append((row["key"], known.known, " ".join(tree["words"][:3 if several else 2]),
                      " to ".join(errors[1:] or errors), known.grey, known.black, f"{row['processor']:.0f}"))
    return table(["records", "known to be missing", "answer", "error on the test record", "published, physical models",
                  "published, black boxes", "processor time, s"], lines)


def calibration(rows: Sequence[Row]) -> str:
    """How far stated probabilities and true frequencies agree at each level, over the machines of the calibration study."""
    sets = {"present": [CALIBRATION] * len(rows), "fitted to all other machines": reliability.left_out(rows)}
    lines: list[tuple[object, ...]] = []
    for what, constants in sets.items():
        for level, of in reliability.reliability(rows, constants).items():
            first, every = (reliability.by_chance(cases)[1] for cases in ([np.array([p]) for p in of.first],
                                                                          [c.p for c in of.cases]))
            lines.append((what, level, len(of.cases), figure(of.first.mean(), 2), figure(of.first_true.mean(), 2),
                          f"{figure(reliability.expected_error(of.first, of.first_true), 2)} ({figure(first, 2)})",
                          f"{figure(reliability.expected_error(of.stated, of.true), 2)} ({figure(every, 2)})"))
    known = [reliability.probability_of_dominant(trees, constants, "class")
             for trees, constants in reliability.by_case(rows, [CALIBRATION] * len(rows))
             if trees[0]["hidden"] in reliability.KNOWN]
    return "\n\n".join([
        f"{len(rows)} trees of {len({(r['machine'], r['number']) for r in rows})} cases of "
        f"{len({r['machine'] for r in rows})} machines. A branch is true if it belongs to one of the hidden differences.",
        table(["constants", "level", "trees", "stated, most probable branch", "true", "calibration error (95 % by chance)",
               "of all branches above 1 %"], lines),
        "If the catalogue contains the class of the dominant effect, the mean probability of this class, in the tree in "
        f"which it is most probable, is {figure(float(np.mean(known)), 2)}.",
        "![Stated probabilities against true frequencies](pictures/reliability.png)"])


def answers(rows: Sequence[Row]) -> str:
    """The deepest stated level of each tree in the calibration study, by what dominates, and by machine."""
    def line(part: Sequence[Row]) -> list[object]:
        ends = Counter(reliability.deepest(r, CALIBRATION) for r in part)
        wrong = sum(n for (level, right), n in ends.items() if level and not right)
        return [len(part), *(ends[level, True] or "-" for level in reliability.LEVELS), ends["", False] or "-", wrong or "-"]

    head = ["trees", *(f"{level} right" for level in reliability.LEVELS), "none stated", "wrong"]
    machines = sorted({r["machine"] for r in rows})
    return "\n\n".join([
        table(["dominant", *head], [*((words, *line([r for r in rows if r["hidden"] == hidden]))
                                      for hidden, words in HIDDEN.items()), ("all", *line(rows))]),
        table(["machine", *head], [(name, *line([r for r in rows if r["machine"] == name])) for name in machines])])


def share(k: int, n: int) -> str:
    """k of n in percent with its 95 % interval."""
    low, high = verdicts.interval(k, n)
    return f"{k} ({100 * k / n:.1f} %; {100 * low:.1f} to {100 * high:.1f} %)"


def main() -> None:
    """All tables into the page."""
    found = {study: list(keeping.read(study).values()) for study in
             (confusion.STUDY, false_alarms.STUDY, detectability.STUDY, detectability.CHECKS, compensator.STUDY,
              measured.STUDY)}
    rows, drawn = found[confusion.STUDY], reliability.known_rows()
    made = {"False alarms": [alarms(found[false_alarms.STUDY])],
            "Confusion": [outcomes(rows), matrix(rows), "### Every case", cases(rows)],
            "Detectability": [sizes(found[detectability.STUDY], found[detectability.CHECKS])],
            "A machine of real size": [machine(found[compensator.STUDY])],
            "Measured machines": [MEASURED, public_records(found[measured.STUDY])]}
    if drawn:
        made |= {"Cases drawn at random": [DRAW, answers(drawn)], "Probabilities": [CALIBRATED, calibration(drawn)]}
    head, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    present, _, rest = rest.partition(END)
    parts = [BEGIN]
    for section in re.split(r"^## ", present, flags=re.MULTILINE)[1:]:  # without results on disk, a section remains as it is
        title, _, body = section.partition("\n")
        parts += [f"## {title}", *made.get(title, [body.strip()])]
    PAGE.write_text("\n\n".join([head.rstrip(), *parts, END]) + rest, encoding="utf-8")
    summary = {study: Counter(r["outcome"] for r in rows if "outcome" in r) for study, rows in found.items()
               if study != measured.STUDY}
    (keeping.RESULTS / "summary.json").write_text(json.dumps(summary, indent=1), encoding="utf-8")
    print(f"wrote {PAGE.name}: {summary}")


if __name__ == "__main__":
    main()
