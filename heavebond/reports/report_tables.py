"""The tables of a report: candidates and their evidence, parameters, tests, noise, what was tried."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

from heavebond.core.errors import listing
from heavebond.core.presentation import count, in_unit, number, readable, readable_unit, unit_label
from heavebond.core.units import Unit, read_unit
from heavebond.diagnosis.diagnosis import Diagnosis
from heavebond.diagnosis.ladder import meaning
from heavebond.diagnosis.refit import Trial
from heavebond.diagnosis.residual_tests import LEVELS, Leftover
from heavebond.diagnosis.scoring import Score
from heavebond.diagnosis.stage import EARNED, Step, indistinct, merit
from heavebond.estimation.fitting import Fit, Fitted
from heavebond.pictures.markup import Html, element, joined, table
from heavebond.reports.report_charts import interval

FIRST_ROWS = 12  # refitted candidates that stand open; the others are folded away
TESTS = {
    "score": "Does any effect of the catalogue explain more of it than chance would?",
    "size": "Is it larger than the noise?",
    "memory": "Does it have a memory, where noise would be white?",
}


def words_of_chance(p: float) -> str:
    """A p value as one says it."""
    if math.isnan(p):
        return "not tested"
    said = "never" if p < 1e-4 else "hardly" if p < 0.01 else "it may well be"
    return f"{said} ({chance(p)})"


def chance(p: float) -> str:
    """A p value as it is printed."""
    return "p < 0.000001" if p < 1e-6 else f"p = {p:.2g}"


# -- candidates --------------------------------------------------------------------------------------------------------
def ranking(step: Step) -> Html:
    """All candidates of one step: those refitted with what they leave, then the others and why they were not."""
    rows = [_row(k, t, step) for k, t in enumerate(step.trials, 1)]
    cluster = [t.candidate.label for t in step.cluster]
    marks = ["chosen" if step.chosen is t else "alike" if t.candidate.label in cluster else "" for t in step.trials]
    head = ("", "class", "component", "place", "score", "χ² fit", "χ² held out", "Δ BIC", "parameters at an end", "verdict")
    if not rows:
        return joined([element("p", "No candidate was refitted: the residual is noise." if not step.left.significant else
                               "No candidate could be refitted."), _others(step)])
    caption = f"Before: χ² per sample {number(step.chi2_fit, 4)} fitted, {number(step.chi2_held_out, 4)} held out; 1 is " \
              "noise. Δ BIC is against that: below zero a candidate is worth its numbers."
    parts = [table(head, rows[:FIRST_ROWS], caption=caption, numbers=(0, 4, 5, 6, 7), marks=marks[:FIRST_ROWS], wide=True)]
    if len(rows) > FIRST_ROWS:
        rest = table(head, rows[FIRST_ROWS:], numbers=(0, 4, 5, 6, 7), marks=marks[FIRST_ROWS:], wide=True)
        parts.append(_folded(f"{count(len(rows) - FIRST_ROWS, 'more refitted candidate')}, ranked below these", rest, None))
    return joined([*parts, _others(step)])


def _row(k: int, trial: Trial, step: Step) -> list[str]:
    twins = step.twins.get(trial.candidate.label, ())
    place = joined([trial.candidate.place, *([element("br"), element("span", f"acts the same as {listing(list(twins))}",
                                                                    class_="quiet small")] if twins else [])])
    return [str(k), trial.candidate.kind, trial.candidate.component, place, number(trial.score, 3),
            number(trial.chi2_fit, 4), number(trial.chi2_held_out, 4), number(trial.bic - step.bic, 4),
            ", ".join(trial.at_end) or "none", _judgement(trial, step)]


def _judgement(trial: Trial, step: Step) -> Html:
    """Why a refitted candidate is the answer, may be, or is not."""
    if trial is step.chosen:
        return element("span", "chosen", class_="tag good")
    if any(t is trial for t in step.cluster):
        return element("span", "not told from it", class_="tag bad")
    fall = (step.chi2_held_out - trial.chi2_held_out) * step.samples_held_out / max(1.0, trial.chi2_held_out)
    if step.samples_held_out and fall <= 0:
        return joined(["worse on held-out data"])
    if step.samples_held_out and fall <= EARNED:
        return joined(["no gain beyond chance on held-out data"])
    if step.chosen is not None and merit(trial) - merit(step.chosen) >= indistinct(step.chosen, step.merit):
        return joined(["leaves more than the chosen one"])
    return joined(["earns no place"])


def _others(step: Step) -> Html:
    """Candidates that were not refitted, by reason."""
    refitted = {t.candidate.label for t in step.trials}
    twins = {label for group in step.twins.values() for label in group}
    unseen = {c.label for c in step.unseen}
    left = [s for s in step.scores if s.candidate.label not in refitted | twins | unseen]
    promised = [t.score for t in step.trials if math.isfinite(t.score)]
    failed = [s for s in left if promised and s.gain >= min(promised)]
    weak = [s for s in left if s not in failed]
    reason = "were not reached before the search ended" if step.partial else "could not be simulated"
    groups = [(f"{count(len(failed), 'candidate')} that {reason}", failed),
              (f"{count(len(weak), 'candidate')} whose score promised too little to refit", weak)]
    parts = [_folded(title, _scores(found)) for title, found in groups if found]
    if step.unseen:
        rows = [(c.kind, c.component, c.place) for c in step.unseen]
        parts.append(_folded(f"{count(len(rows), 'candidate')} that these records do not see apart from what is free "
                             "already", table(("class", "component", "place"), rows)))
    return joined(parts)


def _scores(found: Sequence[Score]) -> Html:
    rows = [(s.candidate.kind, s.candidate.component, s.candidate.place, number(s.gain, 3)) for s in found]
    return table(("class", "component", "place", "score"), rows, numbers=(3,))


def _folded(title: str, inside: Html, kind: str | None = "long") -> Html:
    return element("details", element("summary", title), inside, class_=kind)


# -- parameters --------------------------------------------------------------------------------------------------------
def parameters(fit: Fit, base: Fit | None) -> Html:
    """Values fitted with the last model of the ladder, and alone before anything was added (`base`), in their ranges; and
    what the records tell about them."""
    alone = {(p.name, p.record): p for p in base.parameters} if base is not None and base is not fit else {}
    rows = [_parameter(p, alone.get((p.name, p.record)), bool(alone), meaning(fit, p.name)) for p in fit.parameters]
    head = ["parameter", "data sheet", *(["fitted alone", "fitted with it"] if alone else ["fitted"]), "95 % interval",
            "range", "in its range"]
    made = table(head, rows, numbers=(1, 2, 3) if alone else (1, 2), wide=True)
    words = fit.identifiability.words or ("The records determine all of them.",)
    return joined([made, element("ul", *(element("li", w) for w in words))])


def _parameter(p: Fitted, alone: Fitted | None, both: bool, description: str) -> list[str]:
    """A row, `description` what the parameter is; of a number of the effect itself there is no value on a data sheet."""
    sheet = alone.before if alone is not None else p.before
    value, inside = valued(p)
    least, most, before = in_one_unit(p.unit, p.value, (p.low, p.high, sheet))
    known = alone is not None or not both
    picture = interval(p.low, p.high, p.interval, p.value, sheet if known else None, p.low > 0,
                       f"{p.name}: {value}, 95 %: {inside}, range {least} to {most}")
    earlier = [_ended(in_one_unit(p.unit, p.value, (alone.value,))[0], alone) if alone is not None else "–"] if both else []
    name = explained(p.name + (f" ({p.record})" if p.record else ""), description)
    return [name, before if known else "–", *earlier, _ended(value, p), inside, _span(least, most), picture]


def _span(least: str, most: str) -> str:
    """A range, its unit once."""
    return f"{least.split(' ')[0]} … {most}"


def valued(p: Fitted) -> tuple[str, str]:
    """A value and what the records tell of it, in one unit."""
    unit, label = shown_unit(p.unit, p.value)
    written = partial(in_unit, unit=unit, digits=p.digits)
    return written(p.value) + label, p.known(written, label, "…")


def explained(name: str, description: str) -> Html:
    """A name with what it stands for below it."""
    return joined([name, *([element("br"), element("span", description, class_="quiet small")] if description else [])])


def _ended(value: str, p: Fitted) -> Html:
    """A value, with a word where it stands at an end of its range."""
    if not p.ended:
        return joined([value])
    return joined([value, element("br"), element("span", f"at the {p.ended} end", class_="tag bad")])


def in_one_unit(unit: str, size: float, values: Sequence[float], digits: int = 5) -> list[str]:
    """Values in SI in the unit that suits `size`, each with it."""
    shown, label = shown_unit(unit, size)
    return [in_unit(value, shown, digits) + label for value in values]


def shown_unit(unit: str, size: float) -> tuple[Unit, str]:
    """The unit that suits values of a size, and how it stands behind a number."""
    shown = readable_unit(unit, size)
    return read_unit(shown), "" if shown == "1" else f" {unit_label(shown)}"


# -- what is left ------------------------------------------------------------------------------------------------------
def tests(steps: Sequence[Step], names: Sequence[str]) -> Html:
    """The tests on what each model leaves of the fitted samples; `names` says which model that is."""
    rows = []
    for step, name in zip(steps, names, strict=True):
        for test, question in TESTS.items():
            p, level = getattr(step.left, test), LEVELS[test]
            rows.append([name if test == "score" else "", question, _answer(test, p, level, step.left),
                         words_of_chance(p), number(level, 2)])
    return table(("what is left by", "question", "answer", "by chance?", "limit"), rows)


def _answer(test: str, p: float, level: float, left: Leftover) -> Html:
    if test == "size" and p == 1.0:
        return element("span", "not asked: the noise is estimated", class_="quiet")
    return element("span", "yes", class_="tag bad") if p < level else element("span", "no", class_="tag good")


def noise(diagnosis: Diagnosis) -> Html:
    """The noise of each channel beside what the first and the last model leave."""
    first, last = diagnosis.ladder[0].comparison, diagnosis.ladder[-1].comparison
    rows = []
    for record in last.records.values():
        for name, channel in record.channels.items():
            before = first.records[record.name].channels[name]
            known = "given" if channel.noise_given else "estimated from the record"
            values = (channel.noise, before.error, channel.error)
            sizes = [readable(v, channel.unit, 3, beside=max(values)) for v in values]
            rows.append([name, record.name, *sizes, number(channel.chi2, 3), _white(channel.white), known])
    head = ("channel", "record", "noise", "rms left before", "rms left after", "reduced χ²", "white after?", "the noise is")
    return table(head, rows, numbers=(2, 3, 4, 5))


def _white(p: float) -> str:
    return "–" if math.isnan(p) else f"{'yes' if p >= 0.01 else 'no'} ({chance(p)})"


# -- what was tried ----------------------------------------------------------------------------------------------------
def tried(diagnosis: Diagnosis) -> Html:
    """What each step tried and how long it took."""
    rows = []
    for k, step in enumerate(diagnosis.steps, 1):
        labels = {s.candidate.label for s in step.scores}
        found = step.chosen.candidate.label if step.chosen is not None else "nothing that is statistically justified"
        rows.append([f"step {k}", str(len(labels)), str(len(step.trials)), str(len(step.unseen)), str(step.samples),
                     str(step.samples_held_out), f"{step.seconds:.0f} s",
                     found + (" (ended early)" if step.partial else "")])
    head = ("", "candidates", "refitted", "not seen", "samples fitted", "held out", "took", "found")
    return table(head, rows, numbers=(1, 2, 3, 4, 5, 6))


def records(diagnosis: Diagnosis) -> Html:
    """The records and what they were used for."""
    rows = []
    for record in diagnosis.ladder[-1].comparison.records.values():
        first = next(iter(record.channels.values()))
        use = "fitted" if record.use == "fit" else "held out"
        rows.append([record.name, use + (" but for the shaded stretches" if record.validate is not None else ""),
                     record.file.name, f"{number(float(first.time[-1] - first.time[0]), 4)} s",
                     ", ".join(f"{c.name} ({len(c.time)})" for c in record.channels.values())])
    return table(("record", "use", "file", "length", "channels (samples)"), rows, numbers=(3,))
