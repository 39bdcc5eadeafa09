"""Results of `compare`, `fit`, `localize`, `diagnose`, `laws` and `errors` as tables and lines, for the terminal and the
studio."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from heavebond.core.errors import listing
from heavebond.core.presentation import count, in_unit, number, readable, readable_difference, readable_unit
from heavebond.core.units import read_unit
from heavebond.diagnosis.answer.ranking import conclusion, entries, shown_in
from heavebond.diagnosis.answer.sentences import at_ends
from heavebond.diagnosis.answer.tree import Tree, branches
from heavebond.diagnosis.attempt import Attempt
from heavebond.diagnosis.diagnose import Diagnosis
from heavebond.diagnosis.evidence.probability import PROBABILITY, percent
from heavebond.diagnosis.search.step import Stage
from heavebond.diagnosis.state import AddedEffect, LadderEntry, parameter_description
from heavebond.estimation.comparison import Channel, Comparison
from heavebond.estimation.fitting import Fit
from heavebond.laws.find import Laws
from heavebond.localise.misfit import Localization, summary
from heavebond.records import metrics

RANKED = 12  # maximum number of candidates in a table
FITTED = ("parameter", "before", "fitted", "95 % interval", "range")
RECORDS = ("record", "channel", "error before", "after", "noise", "reduced chi-square")
LADDER = ("error, fitted", "held out", "chi-square, fitted", "held out")
EVENTS = ("explanation", "probability")
LEVELS = ("system, place, kind, class, law", "probability")
PLACES = ("place", "explains", "behind", "rms", "follows", "R2", "shape")
EFFECT = ("parameter", "fitted", "95 % interval", "sought in", "what it is")


@dataclass(frozen=True)
class ResultTable:
    """A table; its first `text` columns contain text, the other columns numbers."""

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    text: int = 1


@dataclass(frozen=True)
class Line:
    """A sentence of a result; a `warning` is printed on standard error, a `highlight` in colour."""

    text: str
    warning: bool = False
    highlight: bool = False


@dataclass(frozen=True)
class Notes:
    """Notes on records: pairs of record and note; an empty record means the record of the row above."""

    rows: Sequence[tuple[str, str]]


Item = ResultTable | Line | Notes


# -- compare -----------------------------------------------------------------------------------------------------------
def comparison_items(comparison: Comparison) -> list[Item]:
    """The errors of each channel and record, the notes and the advice."""
    largest: dict[str, float] = {}
    for part in comparison.parts:
        for name, channel in part.channels.items():
            largest[name] = max(largest.get(name, 0.0), channel.error, channel.noise)
    rows = [(part.name if k == 0 else "", *_row(channel, largest[name])) for part in comparison.parts
            for k, (name, channel) in enumerate(part.channels.items())]
    heads = ("record", "channel", *(s.column for s in metrics.STATISTICS if s.column), "noise", "error/noise")
    return [ResultTable(comparison.experiment.name, heads, rows, text=2),
            *(Line(f"{part.name} ({part.use}): normalised error {_percent(100 * part.normalised)}, "
                   f"reduced chi-square {number(part.chi2, 3)}") for part in comparison.parts),
            *noticed(comparison), *map(Line, comparison.advice)]


def noticed(comparison: Comparison) -> list[Notes]:
    """The notes on all records, with one note on feedback to an input for all its records; empty without notes."""
    fed: dict[str, list[str]] = {}
    for name, record in comparison.records.items():
        for note in record.feedback:
            fed.setdefault(note.partition(" (")[0], []).append(name)
    rows: list[tuple[str, str]] = []
    for name, record in comparison.records.items():
        notes = []
        for note in record.notes:
            records = fed.get(note.partition(" (")[0], []) if note in record.feedback else [name]
            same_note = f" (the same in {listing(records[1:], 3)})" if len(records) > 1 else ""
            notes += [note + same_note] if records[0] == name else []
        rows += [(name if k == 0 else "", note) for k, note in enumerate(notes)]
    return [Notes(rows)] if rows else []


def _row(channel: Channel, largest: float) -> tuple[str, ...]:
    """A row of the table; all values are in the unit suited to `largest`, so that they can be compared."""
    def written(value: float, form: str) -> str:
        return readable_difference(value, channel.unit, 3, beside=largest) if form == "unit" else \
            _percent(value) if form == "%" else number(value, 3) if math.isfinite(value) else "-"

    return (channel.name, *(written(channel.statistics[s.name], s.form) for s in metrics.STATISTICS if s.column),
            written(channel.noise, "unit"), number(channel.error / channel.noise, 3) if channel.noise else "-")


def _percent(value: float) -> str:
    return f"{number(value, 3)} %" if math.isfinite(value) else "-"


# -- fit -----------------------------------------------------------------------------------------------------------------
def fit_items(fit: Fit) -> list[Item]:
    """The fitted parameters with their intervals, the errors before and after, and how well the records determine them."""
    unseen = fit.identifiability.unseen_names
    names = [p.name for p in fit.parameters
             if p.at_bound and p.name + (f" ({p.record})" if p.record else "") not in unseen]
    at_bounds = f"{', '.join(names)} ended at the end of the range: often a sign that an effect is missing." if names else ""
    rows = []
    for before_fit, part in zip(fit.before.parts, fit.after.parts, strict=True):
        for k, channel in enumerate(part.channels.values()):
            before = before_fit.channels[channel.name]
            rows.append((f"{part.name} ({part.use})" if k == 0 else "", channel.name,
                         *(readable_difference(v, channel.unit, 3) for v in (before.error, channel.error, channel.noise)),
                         number(channel.chi2, 3)))
    return [fitted_parameters(fit), *map(Line, own_words(fit)), ResultTable("", RECORDS, rows, text=2),
            *noticed(fit.after), *map(Line, fit.identifiability.words), *([Line(at_bounds)] if at_bounds else [])]


def fitted_parameters(fit: Fit) -> ResultTable:
    """The fitted parameters with their intervals."""
    rows = []
    for p in fit.parameters:
        name = p.name + (f" ({p.record})" if p.record else "")
        unit = fit.experiment.free[p.name].range.unit
        before, value, least, most = (in_unit(v, unit, digits) for v, digits in (
            (p.before, 6), (p.value, p.digits), (p.low, 6), (p.high, 6)))
        of = "" if unit.text in ("1", "") else f" {unit.text}"
        rows.append((name, f"{before}{of}", f"{value}{of}", p.known(partial(in_unit, unit=unit, digits=p.digits), of),
                     f"{least} .. {most}{of}" + (f", at its {p.at_bound} end" if p.at_bound else "")))
    # parameters that are fitted separately to a held-out record
    for record, record_fit in fit.held_out.items():
        for name in dict.fromkeys(p.name for p in fit.parameters if p.name in record_fit.values):
            p = next(p for p in fit.parameters if p.name == name)
            unit = fit.experiment.free[name].range.unit
            of = "" if unit.text in ("1", "") else f" {unit.text}"
            value, least, most = (in_unit(v, unit, 6) for v in (record_fit.values[name], p.low, p.high))
            rows.append((f"{name} ({record}, held out)", "-", f"{value}{of}", "-", f"{least} .. {most}{of}"))
    return ResultTable(f"{fit.experiment.name}: {fit.samples} samples, reduced chi-square {fit.chi2:.4g}",
                       FITTED, rows)


def own_words(fit: Fit) -> list[str]:
    """Sentences on the treatment of parameters `each: record` for held-out records."""
    instants = {name: record for record, record_fit in fit.held_out.items() for name in record_fit.instants}
    names = listing([name for name, free in fit.experiment.free.items() if free.each and name not in instants], 4)
    fitted = [f"the first {number(record_fit.seconds, 3)} s of {record}" for record, record_fit in fit.held_out.items()
              if {*record_fit.values} - {*record_fit.instants}]
    failed = [record for record, record_fit in fit.held_out.items() if not record_fit.values]
    sentences = []
    if fitted:
        sentences.append(f"{names} (each: record): on held-out records fitted too, to {listing(fitted, 4)}, with all other "
                         "values given; the held-out errors contain these samples.")
    if instants:
        sentences.append(f"{listing(instants, 4)} (each: record): on held-out records sought on the whole record, with all "
                         "other values given; one value of each held-out record is fitted to it.")
    if failed:
        names = listing([name for name, free in fit.experiment.free.items() if free.each], 4)
        sentences.append(f"{names} (each: record): could not be fitted on {listing(failed, 4)}, where the model cannot be "
                         "simulated; the values of the diagram are used there.")
    return sentences


# -- localize ------------------------------------------------------------------------------------------------------------
def localization_items(localization: Localization) -> list[Item]:
    """The times and states of motion with a large misfit, and the places at which an effect may be missing."""
    places = []
    for s in localization.suspects:
        curve = s.curve
        curve_cells = ("-", "-", "-")
        if curve is not None:
            times = f" * {curve.times}" if curve.times else f", {curve.second.formula}" if curve.second is not None else ""
            curve_cells = (curve.variable.formula + times, f"{max(curve.r2, 0.0):.2f}", curve.shape)
        places.append((s.place.name, f"{100 * s.explained:.4g} %", number(s.behind, 3),
                       readable(s.rms, s.place.unit.text, 3), *curve_cells))
    table = [ResultTable("", PLACES, places, text=1)] if localization.missing else []
    unseen = [Line(f"Not seen in these records: {', '.join(localization.unseen)}.")] if localization.unseen else []
    return [*map(Line, summary(localization)), *table, *unseen, *map(Line, localization.words)]


# -- diagnose ------------------------------------------------------------------------------------------------------------
def diagnosis_items(diagnosis: Diagnosis) -> list[Item]:
    """The answer with its levels, the table of models, the candidates of each step, the parameters of the added effects, the
    probabilities and the verdict."""
    items: list[Item] = [*map(Line, diagnosis.tree.words), *tree_tables(diagnosis.tree)]
    items += [ladder_table(diagnosis.ladder, "model")] if diagnosis.ladder else []
    items += [ranking_table(step, f"Step {k}: " if len(diagnosis.steps) > 1 else "")
              for k, step in enumerate(diagnosis.steps, 1) if step.trials]
    if diagnosis.verdict == "parameters" and diagnosis.fitted is not None:
        items.append(fitted_parameters(diagnosis.fitted))
    items += [effect_table(finding) for finding in diagnosis.added]
    return [*items, *probability_table(diagnosis), *map(Line, diagnosis.words)]


def tree_tables(tree: Tree) -> list[ResultTable]:
    """A table for each effect: the levels of the answer with their probabilities."""
    tables = []
    for k, effect in enumerate(tree.effects, 1):
        title = "The answer by levels" + (f", effect {k}" if len(tree.effects) > 1 else "")
        rows = [(f"{'  ' * depth}{node.name}", percent(node.probability)) for depth, node in branches(effect.root)]
        tables.append(ResultTable(title, LEVELS, rows))
    return tables


def probability_table(diagnosis: Diagnosis) -> list[ResultTable]:
    """The possible explanations of the records with their probabilities; if several effects were added, of the first one."""
    return [ResultTable(PROBABILITY, EVENTS, [e.row for e in diagnosis.events])] if diagnosis.events else []


def attempt_items(attempt: Attempt) -> list[Item]:
    """The errors with an effect that the user chose, its parameters, and whether it is statistically justified."""
    held_out = "the error falls by more than chance." if attempt.earned else \
        "the effect does not lower the error by more than chance."
    ends = at_ends(attempt.finding, attempt.earned and attempt.bic_difference < 0)
    return [ladder_table(attempt.ladder, "model"), effect_table(attempt.finding), *map(Line, ends),
            Line(f"BIC changes by {number(attempt.bic_difference, 4)} (below -10 is strong evidence for the effect); on "
                 f"held-out data {held_out}")]


def laws_items(laws: Laws) -> list[Item]:
    """The formulas that were refitted in simulation, the laws of the catalogue for comparison, and the answer."""
    rows = [(law.text, law.formula.place.name, f"{law.formula.count}", number(law.chi2_fit, 3), number(law.chi2_held_out, 3),
             percent(law.probability)) for law in laws.laws]
    rows += [(f"{t.candidate.component} (catalogue)", "-".join(t.candidate.where), f"{len(t.candidate.numbers)}",
              number(t.chi2_fit, 3), number(t.chi2_held_out, 3), "") for t in laws.catalogue]
    columns = ("formula", "place", "parameters", "fitted", "held out", "probability")
    table = [ResultTable("Formulas refitted in simulation; reduced chi-square (1 = noise level)", columns, rows, text=2)]
    return [*(table if rows else []), *map(Line, laws.words)]


def ladder_table(rungs: Sequence[LadderEntry], first: str) -> ResultTable:
    """The errors of models on the same records; `first` is the heading of the first column."""
    rows = [(r.name, *(f"{number(100 * e, 3)} %" for e in (r.error_fit, r.error_held_out)),
             *(number(c, 3) for c in (r.chi2_fit, r.chi2_held_out))) for r in rungs]
    return ResultTable("Error in % of what was measured; reduced chi-square (1 = noise level)", (first, *LADDER), rows)


def ranking_table(step: Stage, prefix: str) -> ResultTable:
    """The best candidates of a step; `which` is the first part of the title and names the step."""
    columns = shown_in("terminal")
    ranked = entries(step)
    listed = ranked[:min(RANKED, len(step.trials))]  # plus indistinguishable candidates
    listed += tuple(e for e in ranked[len(listed):] if e["cluster"])
    rows = [[column.text(entry) for column in columns] for entry in listed]
    more = f", the {RANKED} best shown" if len(step.trials) > RANKED else ""
    title = f"{prefix}{count(len(step.scores), 'candidate')} scored, {len(step.trials)} fitted{more} ({conclusion(step)})"
    return ResultTable(title, [column.title for column in columns], rows, text=sum(not c.numeric for c in columns))


def effect_table(finding: AddedEffect) -> ResultTable:
    """The parameters of an effect with their intervals."""
    rows = []
    for p in finding.parameters:
        unit = read_unit(readable_unit(p.unit, p.value))
        name = "" if unit.text in ("1", "") else f" {unit.text}"
        alike = len({in_unit(end, unit, 4) for end in p.interval}) == 1  # equal ends of a narrow interval
        written = partial(in_unit, unit=unit, digits=p.digits if alike else 4)
        end = f", at its {p.ended} end" if p.ended else ""
        rows.append((p.name, f"{written(p.value)}{name}", p.known(written, name),
                     f"{written(p.low)} .. {written(p.high)}{name}{end}", parameter_description(finding.fit, p.name)))
    return ResultTable(f"{finding.candidate.kind} {finding.candidate.place}", EFFECT, rows)
