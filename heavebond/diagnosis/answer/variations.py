"""Sentences on parameters that vary and on effects that begin at a time."""

from __future__ import annotations

from collections.abc import Sequence

from heavebond.core.presentation import number, readable
from heavebond.diagnosis.state import AddedEffect
from heavebond.estimation.fitting import Fitted
from heavebond.language.definition import Effect


def variation_words(findings: Sequence[AddedEffect]) -> list[str]:
    """What varies, by how much, and when, for each finding that is a varying parameter."""
    said = []
    for finding in findings:
        change = finding.candidate.change
        said += [_of_records(name, [p for p in finding.fit.parameters if p.name == name]) for name in change.each]
        effect = finding.fit.experiment.model.library.component(finding.candidate.component).effect
        for name, factors in change.vary.items():
            said += [f"The effect begins at {_at(when)}." for when in finding.parameters
                     if any(factor.rpartition(".")[0] == when.name.rpartition(".")[0] != finding.candidate.name
                            for factor in factors)]
            if effect is not None and f"{finding.candidate.name}.factor" in factors:
                said.append(_of_factor(name, finding, effect))
    return list(dict.fromkeys(line for line in said if line))


def _of_records(name: str, values: Sequence[Fitted]) -> str:
    """The ratio of the largest to the smallest value of a parameter over the records."""
    own = sorted((p for p in values if p.record), key=lambda p: abs(p.value))
    if len(own) < 2 or own[0].value == 0:
        return ""
    low, high = own[0], own[-1]
    return f"{name} is {number(high.value / low.value, 3)} times as large in record {high.record} as in record " \
        f"{low.record} ({readable(high.value, high.unit, 3)} and {readable(low.value, low.unit, 3)})."


def _of_factor(name: str, finding: AddedEffect, effect: Effect) -> str:
    """The change of a parameter over the range of the variable with which it varies."""
    candidate = finding.candidate
    part = candidate.change.components[candidate.name]
    model = finding.fit.experiment.model.library.component(candidate.component)
    own = {p.name.rpartition(".")[2]: p for p in finding.parameters}
    variable = next(iter(part.values.values())).lstrip("=")
    amplitudes = {key: own[key].value for key in effect.amplitude if key in own}
    words = effect.varies_with
    when = next((own[key] for key in effect.shapes if key in own), None)
    if "instant" in words and when is not None and amplitudes:
        change = next(iter(amplitudes.values()))
        return f"{name} {'rises' if change > 0 else 'falls'} by {number(100 * abs(change), 3)} % at {_at(when)}."
    if len(amplitudes) != 1 or model.effect is None:
        sizes = [f"{key} = {number(value, 3)}" for key, value in amplitudes.items()]
        return f"{name} varies with {variable}: {', '.join(sizes)}."
    k = next(iter(amplitudes.values()))
    if "rate" in words:
        return f"{name} is {number((1 + k) / (1 - k), 3)} times as large at positive {variable} as at negative {variable}."
    ratio = (1 + k) / (1 - k)
    low, high = (part.values.get(key, "") for key in ("u_0", "u_m"))
    grown = f"grows by {number(100 * (ratio - 1), 3)} %" if ratio > 1 else f"falls by {number(100 * (1 - ratio), 3)} %"
    return f"{name} {grown} over the range of {variable} ({low} +- {high})."


def _at(when: Fitted) -> str:
    low, high = when.told
    span = f" ({number(low, 4)} to {number(high, 4)})" if low is not None and high is not None else ""
    return f"{readable(when.value, when.unit, 4)}{span}"
