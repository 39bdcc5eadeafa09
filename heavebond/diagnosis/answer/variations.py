"""Sentences on parameters that vary and on effects that begin at a time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from heavebond.core.errors import joined, listing
from heavebond.core.presentation import number, readable
from heavebond.diagnosis.candidates.varying import SECOND, unit_of_variable
from heavebond.diagnosis.state import AddedEffect
from heavebond.estimation.fitting import Fitted, is_instant
from heavebond.language.definition import FACTOR, Effect
from heavebond.numerics.result import Probe


def variation_words(findings: Sequence[AddedEffect]) -> list[str]:
    """Sentences for findings with a varying parameter: the parameter, the size of the variation, and its time."""
    lines = []
    for finding in findings:
        change = finding.candidate.change
        for name in change.each if finding.candidate.differs else ():
            # the ratio of the largest to the smallest value over the fitted records, unless their intervals overlap (an
            # unknown end of an interval is replaced by the value)
            values = sorted((p for p in finding.fit.parameters if p.name == name and p.record), key=lambda p: abs(p.value))
            if len(values) < 2 or values[0].value == 0:
                continue
            low, high = values[0], values[-1]
            begins, ends = zip(*((p.value if p.told[0] is None else p.told[0], p.value if p.told[1] is None else p.told[1])
                                 for p in (low, high)), strict=True)
            if max(begins) > min(ends):
                lines.append(f"{name} is {number(high.value / low.value, 3)} times as large in record {high.record} as in "
                             f"record {low.record} ({readable(high.value, high.unit, 3)} and "
                             f"{readable(low.value, low.unit, 3)}).")
        effect = finding.fit.experiment.model.library.component(finding.candidate.component).effect
        for name, factors in change.vary.items():
            if effect is not None and f"{finding.candidate.name}.{FACTOR}" in factors:
                lines.append(_of_factor(name, finding, effect))
        lines.append(onset_words(finding))
    return list(dict.fromkeys(line for line in lines if line))


def onset_words(finding: AddedEffect) -> str:
    """Sentence on the time at which an effect begins in each record; empty for an effect without an onset.

    If this time is not inside a record, the sentence states that the effect acts in the whole record, or not at all.
    """
    name = next((n for n in finding.candidate.change.each if is_instant(finding.fit.experiment.model, n)), "")
    if not name:
        return ""
    fitted = {p.record: p for p in finding.fit.parameters if p.name == name}
    held_out = {record: estimate.values[name] for record, estimate in finding.fit.held_out.items()
                if name in estimate.values}
    at, whole, absent = list[str](), list[str](), list[str]()
    for record, part in finding.fit.after.records.items():
        when, beside = fitted.get(record), "" if record in fitted else " (fitted to this record)"
        value = when.value if when is not None else held_out.get(record)
        if value is None:
            continue
        begin, end = float(part.result.time[0]), float(part.result.time[-1])
        if value <= begin:
            whole.append(f"{record}{beside}")
        elif value >= end:
            absent.append(f"{record}{beside}")
        else:
            time_text = _at(when) if when is not None else readable(value, SECOND.text, 3)
            at.append(f"at {time_text} in record {record}{beside}")
    parts = [f"begins {joined(at)}" if at else "", f"acts in the whole record {joined(whole)}" if whole else "",
             f"does not act in record {joined(absent)}" if absent else ""]
    subject = "change" if finding.candidate.attaches == "parameter" else "effect"
    return f"The {subject} {joined([part for part in parts if part])}." if any(parts) else ""


def _of_factor(name: str, finding: AddedEffect, effect: Effect) -> str:
    """Sentence on the values of a parameter over the range of its variable, or on its change at a time."""
    candidate = finding.candidate
    parameters = {p.name.rpartition(".")[2]: p for p in finding.parameters}
    amplitudes = [parameters[key].value for key in effect.amplitude if key in parameters]
    words = effect.varies_with
    when = next((parameters[key] for key in effect.shapes if key in parameters), None)
    if "instant" in words and amplitudes:
        verb, at_time = "rises" if amplitudes[0] > 0 else "falls", f" at {_at(when)}" if when is not None else ""
        return f"{name} {verb} by {number(100 * abs(amplitudes[0]), 3)} %{at_time}."
    runs = [record.result for record in finding.fit.after.records.values() if record.use == "fit"]
    variable = next(iter(candidate.change.components[candidate.name].values.values())).lstrip("=")
    factor = f"{candidate.name}.{FACTOR}"
    v, f = np.hstack([Probe(run.assembly, [variable, factor], si=True).values(run) for run in runs])
    flat = runs[0].assembly.flat
    unit, value = unit_of_variable(flat, variable), finding.fit.values.get(name, runs[0].assembly.parameter_values[name])
    own_unit = next(q.unit.text for q in flat.parameters if q.name == name)
    if "rate" in words:
        ahead, back = (float(value * f[int(np.argmax(side * v))]) for side in (1, -1))
        return f"{name} is {number(ahead / back, 3)} times as large at positive {variable} as at negative {variable} " \
            f"({readable(ahead, own_unit, 3)} and {readable(back, own_unit, 3)})."
    at = np.linspace(float(v.min()), float(v.max()), len(amplitudes) + 1)
    course = [f"{readable(float(value * f[int(np.argmin(np.abs(v - x)))]), own_unit, 3)} at "
              f"{f'{variable} = ' if k == 0 else ''}{readable(float(x), unit.text, 3)}" for k, x in enumerate(at)]
    return f"{name} is {listing(course, len(course))}."


def _at(when: Fitted) -> str:
    low, high = when.told
    span = f" ({number(low, 4)} to {number(high, 4)})" if low is not None and high is not None else ""
    return f"{readable(when.value, when.unit, 4)}{span}"
