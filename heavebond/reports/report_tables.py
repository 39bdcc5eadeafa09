"""Tables of a report: candidates and their evidence, parameters, residual tests, noise, steps of the search, records."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from heavebond.core.errors import listing
from heavebond.core.presentation import count, in_unit, number, readable, readable_unit, unit_label
from heavebond.core.units import Unit, read_unit
from heavebond.diagnosis.answer.ranking import BY_KEY, JUDGEMENTS, Column, Entry, entries, shown_in
from heavebond.diagnosis.diagnose import Diagnosis
from heavebond.diagnosis.evidence.residual_tests import LEVELS
from heavebond.diagnosis.search.step import Stage
from heavebond.diagnosis.state import parameter_description
from heavebond.estimation.fitting import Fit, Fitted
from heavebond.experiment_design.separation import Predicted, Separation
from heavebond.numerics.dae import Array
from heavebond.pictures.markup import Html, element, joined, table
from heavebond.reports.report_charts import BLUE, GREEN, INK, MOST_POINTS, ORANGE, PURPLE, Line, interval, over, swatch

FIRST_ROWS = 12  # number of fitted candidates in the visible table; the others are folded
# CSS classes of the row and of the label of a judgement
MARKS = {"chosen": ("chosen", "good"), "indistinguishable": ("alike", "bad")}
TESTS = {
    "score": "Does any effect of the catalogue explain more of it than chance would?",
    "size": "Is it larger than the noise?",
    "memory": "Are successive values correlated, unlike white noise?",
}
COLOURS = (BLUE, ORANGE, GREEN, PURPLE, INK)
DASHES = (None, "7 3", "2 2", "9 3 2 3", None)
SHOWN = 8  # number of simulated inputs in the table
SIZE = (518.0, 230.0)


def words_of_chance(p: float) -> str:
    """A p value in words."""
    if math.isnan(p):
        return "not tested"
    frequency = "never" if p < 1e-4 else "hardly" if p < 0.01 else "it may well be"
    return f"{frequency} ({chance(p)})"


def chance(p: float) -> str:
    """A p value as text: `p = 0.012`."""
    return "p < 0.000001" if p < 1e-6 else f"p = {p:.2g}"


# -- candidates --------------------------------------------------------------------------------------------------------
def ranking(step: Stage) -> Html:
    """All candidates of one step: the fitted candidates with their statistics, then the other candidates by reason."""
    ranked = entries(step)
    fitted = [e for e in ranked if e.trial is not None]
    unfitted = _unfitted(ranked[len(fitted):])
    if not fitted:
        return joined([element("p", "No candidate was fitted: the residual is noise." if not step.left.significant else
                               "No candidate could be fitted."), unfitted])
    caption = f"Before: reduced chi-square {number(step.chi2_fit, 4)} fitted, {number(step.chi2_held_out, 4)} held out; " \
              "1 is the noise level. BIC change is relative to that model: if it is negative, the smaller residual " \
              "justifies the parameters of the candidate."
    parts = [_ranked(fitted[:FIRST_ROWS], 1, caption)]
    if len(fitted) > FIRST_ROWS:
        parts.append(_folded(f"{count(len(fitted) - FIRST_ROWS, 'more fitted candidate')}, ranked below these",
                             _ranked(fitted[FIRST_ROWS:], FIRST_ROWS + 1), None))
    return joined([*parts, unfitted])


def _ranked(ranked: Sequence[Entry], first: int, caption: str = "") -> Html:
    columns = shown_in("report")
    rows = [[str(k), *(_cell(column, entry) for column in columns)] for k, entry in enumerate(ranked, first)]
    marks = [MARKS.get(entry.judgement, ("", ""))[0] for entry in ranked]
    return table(["", *(c.title for c in columns)], rows, caption=caption, marks=marks, wide=True,
                 numbers=(0, *(k for k, c in enumerate(columns, 1) if c.numeric)))


def _cell(column: Column, entry: Entry) -> Html | str:
    """A cell of the ranking; the place also lists equivalent candidates, and the judgement is a label."""
    if column.key == "place" and entry.same_as:
        twins = f"acts the same as {listing(list(entry.same_as))}"
        return joined([column.text(entry), element("br"), element("span", twins, class_="quiet small")])
    if column.key == "judgement":
        words = JUDGEMENTS[entry.judgement]
        tag = MARKS.get(entry.judgement, ("", ""))[1]
        return element("span", words, class_=f"tag {tag}") if tag else joined([words])
    return column.text(entry)


def _unfitted(unfitted: Sequence[Entry]) -> Html:
    """The candidates that were not fitted, by reason."""
    parts = []
    for reason, words in JUDGEMENTS.items():
        entries = [e for e in unfitted if e.judgement == reason and reason != "same_direction"]
        if entries:
            columns = [BY_KEY[key] for key in ("class", "effect", "place", "score")]
            rows = [[column.text(e) for column in columns] for e in entries]
            parts.append(_folded(f"{count(len(entries), 'candidate')}: {words}",
                                 table([c.title for c in columns], rows, numbers=(3,))))
    return joined(parts)


def _folded(title: str, inside: Html, kind: str | None = "long") -> Html:
    return element("details", element("summary", title), inside, class_=kind)


# -- parameters --------------------------------------------------------------------------------------------------------
def parameters(fit: Fit, base: Fit | None) -> Html:
    """The fitted parameters of the last model in their ranges, and how well the records determine them.

    `base` is the fit of the diagram without added effects.
    """
    alone = {(p.name, p.record): p for p in base.parameters} if base is not None and base is not fit else {}
    rows = [_parameter(p, alone.get((p.name, p.record)), bool(alone),
                       parameter_description(fit, p.name)) for p in fit.parameters]
    head = ["parameter", "data sheet", *(["fitted alone", "fitted with it"] if alone else ["fitted"]), "95 % interval",
            "range", "in its range"]
    fitted_table = table(head, rows, numbers=(1, 2, 3) if alone else (1, 2), wide=True)
    words = fit.identifiability.words or ("The records determine all of them.",)
    return joined([fitted_table, element("ul", *(element("li", w) for w in words))])


def _parameter(p: Fitted, alone: Fitted | None, both: bool, description: str) -> list[str]:
    """The row of a parameter with its `description`; a parameter of the added effect has no value of a data sheet."""
    sheet = alone.before if alone is not None else p.before
    value, inside = valued(p)
    least, most, before = in_one_unit(p.unit, p.value, (p.low, p.high, sheet))
    known = alone is not None or not both
    picture = interval(p.low, p.high, p.interval, p.value, sheet if known else None, p.low > 0,
                       f"{p.name}: {value}, 95 %: {inside}, range {least} to {most}")
    earlier = [_ended(in_one_unit(p.unit, p.value, (alone.value,))[0], alone) if alone is not None else "–"] if both else []
    name = explained(p.name + (f" ({p.record})" if p.record else ""), description)
    return [name, before if known else "–", *earlier, _ended(value, p), inside, f"{least.split(' ')[0]} … {most}", picture]


def valued(p: Fitted) -> tuple[str, str]:
    """A value and its confidence interval, in one unit."""
    unit, label = shown_unit(p.unit, p.value)
    written = partial(in_unit, unit=unit, digits=p.digits)
    return written(p.value) + label, p.known(written, label, "…")


def explained(name: str, description: str) -> Html:
    """A name with its description below it."""
    return joined([name, *([element("br"), element("span", description, class_="quiet small")] if description else [])])


def _ended(value: str, p: Fitted) -> Html:
    """A value, with a label if it is at an end of its range."""
    if not p.ended:
        return joined([value])
    return joined([value, element("br"), element("span", f"at the {p.ended} end", class_="tag bad")])


def in_one_unit(unit: str, size: float, values: Sequence[float]) -> list[str]:
    """Values in SI as texts in the unit suited to `size`, each with the unit."""
    display_unit, label = shown_unit(unit, size)
    return [in_unit(value, display_unit, 5) + label for value in values]


def shown_unit(unit: str, size: float) -> tuple[Unit, str]:
    """The unit suited to values of a size, and its text after a number."""
    name = readable_unit(unit, size)
    return read_unit(name), "" if name == "1" else f" {unit_label(name)}"


# -- residual tests ----------------------------------------------------------------------------------------------------
def tests(steps: Sequence[Stage], names: Sequence[str]) -> Html:
    """The tests of the residuals of the fitted samples for each model; `names` are the names of the models."""
    rows = []
    for step, name in zip(steps, names, strict=True):
        for test, question in TESTS.items():
            p, level = getattr(step.left, test), LEVELS[test]
            if test == "size" and p == 1.0:
                answer = element("span", "not asked: the noise is estimated", class_="quiet")
            else:
                answer = element("span", "yes", class_="tag bad") if p < level else element("span", "no", class_="tag good")
            rows.append([name if test == "score" else "", question, answer, words_of_chance(p), number(level, 2)])
    return table(("residual of", "question", "answer", "by chance?", "limit"), rows)


def noise(diagnosis: Diagnosis) -> Html:
    """The noise of each channel and the rms residuals of the first and the last model."""
    first, last = diagnosis.ladder[0].comparison, diagnosis.ladder[-1].comparison
    rows = []
    for record in last.records.values():
        for name, channel in record.channels.items():
            before = first.records[record.name].channels[name]
            known = "given" if channel.noise_given else "estimated from the record"
            values = (channel.noise, before.error, channel.error)
            sizes = [readable(v, channel.unit, 3, beside=max(values)) for v in values]
            p = channel.white
            rows.append([name, record.name, *sizes, number(channel.chi2, 3),
                         "–" if math.isnan(p) else f"{'yes' if p >= 0.01 else 'no'} ({chance(p)})", known])
    head = ("channel", "record", "noise", "rms residual before", "after", "reduced χ²", "white after?", "the noise is")
    return table(head, rows, numbers=(2, 3, 4, 5))


# -- what was tried ----------------------------------------------------------------------------------------------------
def tried(diagnosis: Diagnosis) -> Html:
    """The candidates and the time of each step."""
    rows = []
    for k, step in enumerate(diagnosis.steps, 1):
        labels = {s.candidate.label for s in step.scores}
        chosen = step.chosen.candidate.label if step.chosen is not None else "nothing that is statistically justified"
        rows.append([f"step {k}", str(len(labels)), str(len(step.trials)), str(len(step.unseen)), str(step.samples),
                     str(step.samples_held_out), f"{step.seconds:.0f} s",
                     chosen + (" (ended early)" if step.partial else "")])
    head = ("", "candidates", "refitted", "not identifiable", "samples fitted", "held out", "duration", "result")
    return table(head, rows, numbers=(1, 2, 3, 4, 5, 6))


def records(diagnosis: Diagnosis) -> Html:
    """The records and their use."""
    rows = []
    for record in diagnosis.ladder[-1].comparison.records.values():
        first = next(iter(record.channels.values()))
        use = "fitted" if record.use == "fit" else "held out"
        rows.append([record.name, use + (" but for the shaded stretches" if record.validate is not None else ""),
                     record.file.name, f"{number(float(first.time[-1] - first.time[0]), 4)} s",
                     ", ".join(f"{c.name} ({len(c.time)})" for c in record.channels.values())])
    return table(("record", "use", "file", "length", "channels (samples)"), rows, numbers=(3,))


def separating(separation: Separation) -> Html:
    """The section on the next experiment: the most discriminating input, the predicted channels, the distinguished pairs."""
    parts = [element("p", line) for line in separation.words]
    if separation.best is None:
        return joined(parts)
    kinds = ["line" if dash is None else "dash" for dash in DASHES]
    legend = swatch(*((kinds[k], COLOURS[k], name) for k, name in enumerate(separation.alternatives[:len(COLOURS)])))
    figures = [figure for name, channel in separation.channels.items() for figure in _channel(separation, name, channel)]
    rows = [(p.one, p.other, p.channel, f"{number(p.at, 3)} s", number(p.size, 3), number(p.chi2, 4),
             f"{100 * p.sure:.4g} %") for p in separation.best.pairs]
    head = ("one", "other", "differ most in", "near", "by noise levels", "χ² of the wrong one higher by", "decides in")
    pairs = table(head, rows, numbers=(3, 4, 5, 6), caption="What the proposed record would decide")
    # the proposed input
    input_name, unit = separation.best.proposal.input, separation.limits[separation.best.proposal.input][1]
    display_unit = readable_unit(unit, float(np.max(np.abs(separation.best.proposal.values), initial=0.0)))
    input_values = separation.best.proposal.values * (read_unit(unit).scale / read_unit(display_unit).scale)
    tried_rows = [(t.proposal.input, t.proposal.shape,
                   f"{number(t.proposal.frequency, 3)} Hz" if t.proposal.frequency else "–",
                   str(t.decided), number(t.smallest, 4)) for t in separation.tried[:SHOWN]]
    tried_head = ("input", "shape", "frequency", "pairs distinguished", "smallest rise of χ²")
    caption = f"Inputs that were simulated, {len(separation.tried)} in all, the best first"
    parts += [element("figure", over([], [Line(_thin(separation.time), _thin(input_values), INK, 1.4)],
                                     title=f"input {input_name}", across="time [s]",
                                     up=f"[{unit_label(display_unit)}]" if display_unit != "1" else "dimensionless",
                                     label=f"Proposed course of the input {input_name}", size=SIZE)),
              element("p", legend, class_="small"),
              element("div", *(element("figure", figure) for figure in figures), class_="panels"), pairs,
              table(tried_head, tried_rows, numbers=(2, 3, 4), caption=caption)]
    return joined(parts)


def _thin(values: Array) -> Array:
    return values[::max(1, -(-len(values) // MOST_POINTS))]


def _channel(separation: Separation, name: str, channel: Predicted) -> list[Html]:
    """A channel under each alternative, and the differences from the first alternative in multiples of the noise."""
    display_unit = readable_unit(channel.unit, float(np.max(np.abs(channel.values), initial=0.0)))
    source, target = read_unit(channel.unit), read_unit(display_unit)
    values = (channel.values * source.scale + source.offset - target.offset) / target.scale
    apart = (channel.values - channel.values[:1]) / channel.noise
    pictures = ((values, f"{name} as each alternative predicts it", f"[{unit_label(display_unit)}]"),
                (apart, f"{name}: each alternative minus the first", "[noise levels]"))
    return [over([], [Line(_thin(separation.time), _thin(course), COLOURS[k % len(COLOURS)], 1.4, DASHES[k % len(DASHES)])
                      for k, course in enumerate(courses)], title=title, across="time [s]", up=up, size=SIZE,
                 label=f"{title}, under each alternative") for courses, title, up in pictures]
