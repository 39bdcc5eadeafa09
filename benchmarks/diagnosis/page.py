"""The tables of docs/diagnosis_study.md from the results on disk: `python -m benchmarks.diagnosis.page`."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

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
from heavebond.diagnosis.evidence.probability import TEMPERATURES, Calibration

PAGE = Path(__file__).parents[2] / "docs" / "diagnosis_study.md"
BEGIN, END = "<!-- written by `python -m benchmarks.diagnosis.page` -->", "<!-- end of what it writes -->"
OUTCOMES = {"right": "named", "cluster": "among the indistinguishable", "shape": "a shape, no name", "missed": "missed",
            "weak": "too weak", "wrong": "misclassified", "broken": "broken"}
IMITATED = 1.3  # chi-square per sample up to which one class imitates another
NEVER = 1e4  # chi-square per sample; nobody begins a diagnosis so far from the record
Row = Mapping[str, Any]
ANSWERS = (verdicts.RIGHT, verdicts.NONE, verdicts.MISSED, verdicts.WRONG)
HIDDEN = {"nothing": "nothing", "free": "wrong free parameters", "fixed": "a wrong fixed value",
          "inside": "an effect of the catalogue", "other law": "another law of a class", "outside": "a class that is struck"}
DRAW = """\
Cases drawn at random over bundled machines of all domains (`python -m benchmarks.diagnosis.calibration`, which takes one
case of each machine in turn and continues where it was interrupted). This draw is also the prior for which the
[probabilities](diagnosis_method.md#probabilities) hold:

* hidden is nothing (12 % of the cases), wrong free parameters (10 %), one wrong value that the diagram holds fixed (8
  %, by 10 to 50 %), an effect of the catalogue (35 %), one whose own law is struck from the catalogue while another
  law of its class is there (15 %), or an effect whose whole class is struck (20 %); the free parameters are drawn
  from their tolerances besides;
* the class is drawn uniformly from those that fit in the machine, then law and place; an effect leaves 1 to 200 noise
  variances per sample of the fitted base model, log-uniform;
* one to three records (25, 50, 25 %) of 240 to 300 samples with inputs of their own; the noise is 1 % of each
  channel's motion, and given in 60 % of the cases;
* one effect is sought (`--steps 1`).

*Right*: the set that the answer names holds the class and the place that were hidden; or it says rightly that nothing is
missing, that parameters are wrong, or that no law of the catalogue explains the records. *No name*: something is missing,
and nothing is named. *Missed*: nothing is said to be missing. *Wrong*: the set leaves out what was hidden; a class that is
struck may be imitated by another one down to the noise, and what is named then is counted as wrong as well."""
CALIBRATION = """\
The constants of the [probabilities](diagnosis_method.md#probabilities) are fitted to these cases
(`python -m benchmarks.diagnosis.calibration fit`).

*Expected calibration error*: the distance of the mean stated probability from the true frequency, in bins, weighted. Its
interval is that of a bootstrap over machines. With so few cases it is not zero for exact probabilities either: the table
says what it would be for them by chance, in the mean and up to its 95 % quantile. The constants have prior distributions
that keep them within a factor of some e of the values that were assumed before any case was seen."""
MEASURED = """\
Public records of real machines, from diagrams without the effects that the literature knows
(`python -m benchmarks.diagnosis.measured FOLDER`). The error is the root mean square on the record that is kept for the
test, and in brackets its share of the root mean square of what was measured: with the free parameters fitted, and after each
effect. Published figures were obtained by other means, some on other parts of the records; *verified* ones were read in the
source.

Each diagnosis had at most ten minutes on a busy processor; `undetermined` here means that they were over. The drive (emps)
is simulated with its controller, as its records are of a closed loop: the position hides the friction, the force shows it.
The controller of the pendulum is not known: it is driven by the measured torque up to the last rise, and what the model
lacks is in this torque as well. The noise of the other sets was estimated for each record alone, as an earlier version did;
it was too large for the Silverbox.

Beside the cubic stiffness of the Silverbox, an offset of 5.4 mV of its input is found there. A constant force acts the same
on these records, and so does a second nonlinear spring with a free length. The cubic stiffness alone leaves 5.1 mV. The
literature has no quadratic damping there: that it removes a fifth of the remaining error describes these records, and is no
proof of the effect. It takes away 0.03 % of the misfit of the model without any effect. The present version judges such an
effect against the residual before it, and asks whether another law of the cubic spring explains as much
([effects that are not certain](diagnosis_method.md#effects-that-are-not-certain))."""


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
        "Check by simulation at half and at twice the amplitude from which the effect should be distinguished:",
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
        "Effects hidden in [the compensator](compensator.md#results-of-a-diagnosis), diagnosed with the whole catalogue in "
        "one process. Of the candidates that can be simulated, those that can reduce the error are refitted.",
        table(["hidden effect", "outcome", "result", "chi-square, held out", "refitted", "processor time, s", "MB"], lines),
        "Estimated values, and the largest deviation of the free parameters from the true values:",
        table(["hidden effect", "estimated values of the effect", "largest deviation"], values)])


def public_records(rows: Sequence[Row]) -> str:
    """The measured sets: the answer and the errors on the record that is kept for the test, beside published figures."""
    lines = []
    for row in rows:
        known = measured.SETS[row["key"]]
        test = next((n for n, use in row["uses"].items() if use == "test"), list(row["uses"])[-1])
        errors = [", ".join(f"{readable(error, unit, 3)} ({100 * share:.3g} %)"
                            for error, unit, share in entry[test].values()) for entry in row["errors"]]
        answer = "; ".join(f"**{kind}** {label}" + (f" or one of {alike - 1} others" if alike > 1 else "")
                           for label, kind, alike in row["effects"])
        only = f" (tried were only {', '.join(row['classes'])})" if row["classes"] else ""
        ended = " (ended by the time before all candidates were fitted)" if row["partial"] else ""
        lines.append((row["key"], known.known, f"{row['verdict']}: {answer or row['shape'] or '-'}{only}{ended}",
                      " to ".join(errors[1:] or errors), known.grey, known.black, f"{row['processor']:.0f}"))
    return table(["records", "known to be missing", "answer", "error on the test record", "published, physical models",
                  "published, black boxes", "processor time, s"], lines)


def calibration() -> str:
    """How far stated probabilities and true frequencies agree, over the machines of the calibration study."""
    rows = reliability.known_rows()
    lines, bins = [], []
    for what, found, (low, high) in reliability.figures(rows):
        first, every = (reliability.expected_error(*pair) for pair in (
            (found.first, found.first_true), (found.stated, found.true)))
        mean, most = reliability.by_chance(found.first)
        lines.append((what, figure(first, 2), f"{figure(low, 2)} to {figure(high, 2)}",
                      f"{figure(mean, 2)}, up to {figure(most, 2)}", figure(every, 2), figure(found.brier),
                      figure(found.loss)))
    for low, high in pairwise(reliability.EDGES):
        inside = (found.stated >= low) & ((found.stated < high) | (high == 1))
        if inside.any():
            bins.append((f"{100 * low:.0f} to {100 * high:.0f} %", int(inside.sum()), figure(found.stated[inside].mean(), 2),
                         figure(found.true[inside].mean(), 2)))
    chosen = reliability.fitted(rows)
    return "\n\n".join([
        f"{len(rows)} cases of {len({r['machine'] for r in rows})} machines, diagnosed by the rules {rows[-1]['rules']} (a "
        "digest of the modules that decide; cases of other rules are not counted).",
        table(["constants fitted to", "expected calibration error, most probable event", "95 % over machines",
               "of exact probabilities by chance", "of all events above 1 %", "Brier score", "log loss"], lines),
        f"The most probable explanations that together have 95 % hold what was hidden in "
        f"{share(int(found.covered.sum()), len(rows))} of the cases; they are {figure(found.size.mean(), 2)} in the mean.",
        "![Stated probabilities against true frequencies](pictures/reliability.png)",
        "Stated probabilities against true frequencies, each machine with constants fitted to the others (in the picture "
        "with the number of events and 95 % intervals):",
        table(["stated", "events", "mean stated", "true"], bins),
        "By what is known of the noise, with the constants fitted to all cases. Where an estimate cannot be separated from "
        "the signal, chi-square is no measure of what is left; the probabilities hold all the same, and are rather too low:",
        table(["noise", "cases", "stated, most probable event", "true", "in the set of 95 %"], by_noise(rows, chosen)),
        "The constants, and the log loss with each halved or doubled and the others as they are:",
        table(["constant", "value", "halved", "doubled"], sensitivity(rows, chosen))])


def by_noise(rows: Sequence[Row], chosen: Calibration) -> list[tuple[object, ...]]:
    """How reliable the probabilities are where the noise is given, estimated, and not separable from the signal."""
    doubtful = [any("cannot be separated from the signal" in words for words in r["words"]) for r in rows]
    parts = {"given": [r for r in rows if r["given"]],
             "estimated": [r for r, doubt in zip(rows, doubtful, strict=True) if not r["given"] and not doubt],
             "estimated, not separable": [r for r, doubt in zip(rows, doubtful, strict=True) if doubt]}
    lines: list[tuple[object, ...]] = []
    for name, part in parts.items():
        found = reliability.reliability(part, [chosen] * len(part))
        lines.append((name, len(part), figure(found.first.mean(), 2), figure(found.first_true.mean(), 2),
                      figure(found.covered.mean(), 2)))
    return lines


def sensitivity(rows: Sequence[Row], chosen: Calibration) -> list[tuple[object, ...]]:
    """Each constant, and the log loss with it halved and doubled."""
    known = reliability.Table.of(rows)
    lines: list[tuple[object, ...]] = [("log loss", figure(known.losses(chosen).mean()), "", "")]
    for name in ("temperature", *reliability.FITTED):
        value = getattr(chosen, name)
        changed = (replace(chosen, **{name: value * factor}) for factor in (0.5, 2.0))
        lines.append((name, figure(value, 2), *(
            figure(known.losses(c).mean()) if c.temperature in TEMPERATURES else "" for c in changed)))
    return lines


def answers(rows: Sequence[Row]) -> str:
    """What was said in the cases of the calibration study, by what was hidden, and by machine."""
    lines: list[tuple[object, ...]] = []
    for hidden, words in HIDDEN.items():
        lines.append((words, *_answers([r for r in rows if r["hidden"] == hidden])))
    lines.append(("all", *_answers(rows)))
    each = [(name, *_answers([r for r in rows if r["machine"] == name])) for name in sorted({r["machine"] for r in rows})]
    head = ["cases", *ANSWERS, "mean size of the set"]
    found = Counter(verdicts.outcome(r) for r in rows)
    still = [r for r in rows if r["hidden"] in ("nothing", "free")]
    inside = [r for r in rows if r["hidden"] in ("inside", "other law")]
    alarms = sum(verdicts.outcome(r) == verdicts.WRONG for r in still)
    wrong = sum(verdicts.outcome(r) == verdicts.WRONG for r in inside)
    named = sum(bool(r["named"]) for r in inside)
    imitated = [r for r in rows if r["hidden"] == "outside" and verdicts.outcome(r) == verdicts.WRONG]
    close = sum(r["chi2"][-1][1] < IMITATED for r in imitated)
    return "\n\n".join([
        table(["hidden", *head], lines),
        f"Of {len(rows)} answers {share(found[verdicts.WRONG], len(rows))} were wrong, of the {named} sets named where the "
        f"catalogue has the class {share(wrong, named)}; of the {len(still)} records with nothing but free parameters "
        f"{share(alarms, len(still))} were false alarms (95 % intervals of Clopper and Pearson).",
        table(["machine", *head], each),
        f"Where the class is struck, {len(imitated)} answers are wrong; in {close} of them another class leaves a "
        f"chi-square below {IMITATED:g} on what was not fitted. All other answers that are not right, with that chi-square:",
        table(["machine", "hidden", "", "answer", "chi-square"],
              [(f"{r['machine']} {r['number']}", HIDDEN[r["hidden"]], r["label"], _said(r), figure(r["chi2"][-1][1]))
               for r in rows if verdicts.outcome(r) != verdicts.RIGHT and r["hidden"] != "outside"])])


def _said(row: Row) -> str:
    """The verdict, and the first of what is named."""
    more = len(row["named"]) - 3
    return f"{row['verdict']}: {', '.join(row['named'][:3])}{f' and {more} more' if more > 0 else ''}".removesuffix(": ")


def _answers(rows: Sequence[Row]) -> list[object]:
    found = Counter(verdicts.outcome(r) for r in rows)
    sizes = [r["size"] for r in rows if r["named"]]
    return [len(rows), *(found[name] or "-" for name in ANSWERS), figure(sum(sizes) / len(sizes), 2) if sizes else "-"]


def share(k: int, n: int) -> str:
    """k of n in percent with its 95 % interval."""
    low, high = verdicts.interval(k, n)
    return f"{k} ({100 * k / n:.1f} %; {100 * low:.1f} to {100 * high:.1f} %)"


def main() -> None:
    """All tables into the page."""
    found = {study: list(keeping.read(study).values()) for study in
             (confusion.STUDY, false_alarms.STUDY, detectability.STUDY, detectability.CHECKS, compensator.STUDY,
              measured.STUDY)}
    rows = found[confusion.STUDY]
    parts = ["## False alarms", alarms(found[false_alarms.STUDY]), "## Confusion", outcomes(rows), matrix(rows),
             "### Every case", cases(rows), "## Detectability",
             sizes(found[detectability.STUDY], found[detectability.CHECKS]),
             "## Cases drawn at random", DRAW, answers(reliability.known_rows()),
             "## Probabilities", CALIBRATION, calibration(),
             "## A machine of real size", machine(found[compensator.STUDY]),
             "## Measured machines", MEASURED, public_records(found[measured.STUDY])]
    text = PAGE.read_text(encoding="utf-8")
    head, _, rest = text.partition(BEGIN)
    PAGE.write_text("\n\n".join([head.rstrip(), BEGIN, *parts, END]) + rest.partition(END)[2], encoding="utf-8")
    summary = {study: Counter(r["outcome"] for r in rows if "outcome" in r) for study, rows in found.items()
               if study != measured.STUDY}
    (keeping.RESULTS / "summary.json").write_text(json.dumps(summary, indent=1), encoding="utf-8")
    print(f"wrote {PAGE.name}: {summary}")


if __name__ == "__main__":
    main()
