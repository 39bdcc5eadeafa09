"""Table of the candidates of one step, for the command line, `--json`, the report and the documentation.

Each statistic is one `Column`, with its key in `--json`, heading, unit, format, meaning, value and the media that show it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from heavebond.core.presentation import number
from heavebond.diagnosis.candidates.catalogue import Candidate
from heavebond.diagnosis.decision import DECISION
from heavebond.diagnosis.evidence.comparison import STRONG, likelihood
from heavebond.diagnosis.search.refit import Refit
from heavebond.diagnosis.search.step import EARNED, Stage, fallen, is_noticeable, merit

Cell = float | bool | str | tuple[str, ...] | None

# reasons why a candidate is, may be or is not the result of its step
JUDGEMENTS = {
    "chosen": "chosen",
    "indistinguishable": "cannot be distinguished from the chosen one",
    "range_end": "search stopped at an end of a range; the residual would be smaller beyond it",
    "worse_held_out": "larger error on held-out data",
    "not_significant": "no significant gain on held-out data",
    "larger_residual": "less likely than the chosen one (BIC and error on held-out data)",
    "not_justified": "not statistically justified",
    "immaterial": f"takes away less than {100 * DECISION.further:.0f} % of the misfit of its step",
    "replaced": "justified, but another explanation is in the answer",
    "same_direction": "acts the same as a candidate that was fitted",
    "not_identifiable": "not identifiable together with the free parameters",
    "low_score": "score too small for a refit",
    "left_out": "left out; the file of `--json` states the reason under `left_out`",
    "not_reached": "not decided before the search ended",
    "not_simulated": "could not be simulated",
}


@dataclass(frozen=True)
class Entry:
    """One candidate in the ranking of a step.

    * score: chi-square that the candidate could remove, to first order.
    * trial: its refit (None if it was not refitted).
    * judgement: a key of `JUDGEMENTS`.
    * identifiable: for a candidate without a refit, True if its effect on the channels is identifiable.
    """

    candidate: Candidate
    score: float
    trial: Refit | None
    step: Stage
    judgement: str
    identifiable: bool | None = None

    def __getitem__(self, key: str) -> Cell:
        """Value of the column `key`."""
        return BY_KEY[key].value(self)

    @property
    def acts_as(self) -> tuple[str, ...]:
        """Numbers of the diagram to which the candidate is equivalent, to first order."""
        return tuple(self.step.acts_as.get(self.candidate.label, ()))

    @property
    def same_as(self) -> tuple[str, ...]:
        """Labels of the equivalent candidates, which were not refitted for this reason."""
        return tuple(self.step.twins.get(self.candidate.label, ())) if self.trial is not None else ()


@dataclass(frozen=True)
class Column:
    """A column of the ranking.

    * key: key in `--json`.
    * title, unit: heading and unit.
    * digits: significant digits (0: text).
    * meaning: description.
    * value: function of an entry.
    * shown: media that show the column (`terminal`, `report`).
    """

    key: str
    title: str
    unit: str
    digits: int
    meaning: str
    value: Callable[[Entry], Cell]
    shown: frozenset[str] = frozenset()

    @property
    def numeric(self) -> bool:
        """True if the column contains numbers, which are aligned to the right."""
        return self.digits > 0

    def text(self, entry: Entry) -> str:
        """Format the cell of an entry."""
        value = self.value(entry)
        if value is None:
            return "-"
        if isinstance(value, bool):
            return "*" if value else ""
        if isinstance(value, tuple):
            return ", ".join(value) or "none"
        return value if isinstance(value, str) else number(value, self.digits)


TERMINAL, REPORT = frozenset({"terminal"}), frozenset({"report"})
BOTH = TERMINAL | REPORT


def _fitted(value: Callable[[Refit, Stage], Cell]) -> Callable[[Entry], Cell]:
    """Restrict a value to candidates with a refit."""
    return lambda entry: value(entry.trial, entry.step) if entry.trial is not None else None


COLUMNS: tuple[Column, ...] = (
    Column("cluster", "", "", 0, "whether it is the chosen one or cannot be distinguished from it",
           lambda e: e.judgement in ("chosen", "indistinguishable"), TERMINAL),
    Column("class", "class", "", 0, "what the effect is called: `dry friction`", lambda e: e.candidate.kind, BOTH),
    Column("effect", "effect", "", 0, "its name for `heavebond try`: a component, or a dormant parameter such as "
           "`cylinder.leakage`",
           lambda e: e.candidate.name if e.candidate.attaches == "in" else e.candidate.component, BOTH),
    Column("place", "place", "", 0, "the place in words: `between platform and crown`", lambda e: e.candidate.place, BOTH),
    Column("score", "score", "1", 3, "the chi-square that the candidate could remove, to first order (the gain "
           "[above](#the-score))", lambda e: e.score, REPORT),
    Column("chi2_fit", "chi-square, fitted", "1", 3, "reduced chi-square on the fitted records; 1 = noise level",
           _fitted(lambda t, s: t.chi2_fit), BOTH),
    Column("chi2_held_out", "held out", "1", 3, "the same on held-out data", _fitted(lambda t, s: t.chi2_held_out), BOTH),
    Column("error_over_noise_held_out", "error/noise", "1", 3, "the error on held-out data in multiples of the noise: the "
           "root of `chi2_held_out`", _fitted(lambda t, s: math.sqrt(t.chi2_held_out))),
    Column("bic_difference", "BIC change", "1", 4, "BIC with the candidate less BIC of the model of that step without it; "
           "below -10 is strong evidence for it", _fitted(lambda t, s: t.bic - s.bic), BOTH),
    Column("at_end", "at its bound", "", 0, "free parameters that ended at an end of their range with it, and its own "
           "numbers at an end of the range in which they were sought, beyond which its residual would be smaller",
           _fitted(lambda t, s: (*t.at_end, *t.beyond)), REPORT),
    Column("same_as", "acts the same", "", 0, "candidates that act the same and were not fitted for that reason",
           lambda e: e.same_as),
    Column("acts_as", "acts as", "", 0, "numbers of the diagram of which it is another value, to first order: one that is "
           "held fixed, or, of a candidate that is not identifiable, a free one",
           lambda e: e.acts_as),
    Column("seen", "identifiable", "", 0, "of one that was not fitted: whether its effect on the channels is identifiable "
           "together with the free parameters", lambda e: e.identifiable),
    Column("judgement", "result", "", 0, f"why it is the result or not: {', '.join(f'`{word}`' for word in JUDGEMENTS)}",
           lambda e: e.judgement, REPORT),
)
BY_KEY = {column.key: column for column in COLUMNS}


def shown_in(medium: str) -> tuple[Column, ...]:
    """Columns that `terminal` or `report` shows."""
    return tuple(column for column in COLUMNS if medium in column.shown)


def entries(step: Stage) -> tuple[Entry, ...]:
    """All candidates of a step in the order of their rank: those with a refit, then the others by their score."""
    fitted = {t.candidate.label for t in step.trials}
    alike = {t.candidate.label for t in step.cluster}
    ranked = [Entry(t.candidate, t.score, t, step, _judged(t, step, alike)) for t in step.trials]
    twins = {label for group in step.twins.values() for label in group}
    unseen = {c.label for c in step.unseen}
    promised = [t.score for t in step.trials if math.isfinite(t.score)]
    least = min(promised, default=math.inf)
    for s in step.scores:
        label = s.candidate.label
        if label not in fitted:
            why = "indistinguishable" if label in alike else "same_direction" if label in twins else \
                "not_identifiable" if label in unseen else "not_simulated" if label in step.failed else \
                "left_out" if label in step.excluded else "not_reached" if step.partial and s.gain >= least else "low_score"
            ranked.append(Entry(s.candidate, s.gain, None, step, why, s.told_apart))
    return tuple(ranked)


def _judged(trial: Refit, step: Stage, alike: set[str]) -> str:
    """Judgement on a refitted candidate. `alike` are the labels of the alternatives in the answer; labels are compared
    because the alternatives may have been refitted together with later effects."""
    if step.chosen is not None and trial.candidate.label == step.chosen.candidate.label:
        return "chosen"
    if trial.candidate.label in alike:
        return "indistinguishable"
    if trial.beyond:
        return "range_end"
    fall = fallen(step.chi2_held_out, trial.chi2_held_out, step.samples_held_out)
    if step.samples_held_out and fall <= 0:
        return "worse_held_out"
    if step.samples_held_out and fall <= EARNED:
        return "not_significant"
    if step.chosen is not None and likelihood(trial) > likelihood(step.chosen):
        return "larger_residual"
    if step.chosen is None and merit(trial) < step.merit - EARNED:
        return "not_reached" if step.partial else "replaced" if is_noticeable(step, trial) else "immaterial"
    return "not_justified"


def conclusion(step: Stage) -> str:
    """Result of a step in a few words: the entries of its ranking that are in the answer, or the reason why there is
    none."""
    if step.cluster:
        return "* chosen" if len(step.cluster) == 1 else "* cannot be distinguished"
    better = [t for t in step.trials if t.bic - step.bic < -STRONG]
    if not better:
        return "none is better than by chance"
    best = min(better, key=lambda t: t.bic)
    return f"none is in the answer; {best.candidate.label}: {JUDGEMENTS[_judged(best, step, set())]}"


def as_dicts(ranked: Sequence[Entry]) -> list[dict[str, object]]:
    """Ranking for JSON: each candidate with all columns; None for a missing value."""
    cells = [{c.key: c.value(e) for c in COLUMNS} for e in ranked]
    return [{**e.candidate.as_dict(), **{key: list(value) if isinstance(value, tuple) else value
                                         for key, value in row.items()}} for e, row in zip(ranked, cells, strict=True)]
