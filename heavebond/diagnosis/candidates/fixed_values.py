"""Candidates for other values of fixed parameters, and calibration errors of instruments.

A wrong value from a data sheet is not a missing effect, but it explains a misfit as well.

A calibration error is an offset or a gain of an input or of a measured channel. A parameter of a law can absorb it (friction
that depends on the direction, a free length). So the laws that lead the first step are refitted together with each
calibration error.
"""

from __future__ import annotations

from math import isfinite

from heavebond.core.errors import listing
from heavebond.diagnosis.candidates.catalogue import (
    Candidate,
    EffectNumber,
    is_offset_or_gain,
    quantity,
    single_candidates,
    within,
)
from heavebond.estimation.comparison import assemble_for
from heavebond.estimation.experiment import Experiment
from heavebond.language.definition import Value
from heavebond.language.edits import Change
from heavebond.text.expression import names

VALUE = "value of a parameter"
WIDE = 10.0  # largest factor, up or down, on the value in the diagram


def classes_of(experiment: Experiment) -> list[str]:
    """The classes of the effects that fit in the diagram of an experiment, with the class of fixed values, by name."""
    return sorted({VALUE, *(candidate.kind for candidate in single_candidates(experiment))})


def fixed_values(experiment: Experiment) -> list[Candidate]:
    """One candidate for each parameter that is not free.

    These are the parameters under `parameters:` of the diagram that the formulas of parts use, the parameters of its parts,
    and required parameters of parts inside blocks. Zeros, inactive effects, widths of transitions and values that follow
    from a formula are left out. The diagram's value is the null value, like amplitude 0 of an effect.
    """
    assembly = assemble_for(experiment, next(iter(experiment.records.values())))
    units, leaves = {q.name: q.unit for q in assembly.flat.parameters}, assembly.flat.expanded.leaves
    candidates = []
    for name in assembly.flat.expanded.parameters:
        value = assembly.parameter_values.get(name, 0.0)
        using = tuple(path for path, leaf in leaves.items() if any(
            isinstance(bound.value, Value) and name in {n.text for n in names(bound.value.expr)}
            for bound in leaf.parameters.values()))
        if using and name not in experiment.free and isfinite(value) and value:
            low, high = sorted((value / WIDE, value * WIDE))
            number = EffectNumber(name, units[name], low, high, None, True, value)
            candidates.append(Candidate(
                name, leaves[using[0]].component.name, VALUE, "parameter of the diagram", f"in {listing(using)} ({name})",
                using, Change(settings={name: quantity(value, units[name])}), (number,), "in"))
    for leaf in leaves.values():
        for parameter in leaf.component.parameters.values():
            name = f"{leaf.path}.{parameter.name}"
            value = assembly.parameter_values.get(name, 0.0)
            single = not parameter.integer and not parameter.width and parameter.count is None \
                and ("." not in leaf.path or parameter.default is None)
            if single and name not in experiment.free and isfinite(value) and value not in (0.0, parameter.neutral):
                low, high = sorted((value / WIDE, value * WIDE))
                low = low if parameter.low is None else max(low, parameter.low)
                high = high if parameter.high is None else min(high, parameter.high)
                number = EffectNumber(name, parameter.unit, low, high, None, True, value, (parameter.low, parameter.high))
                candidates.append(within(leaf, parameter, VALUE, [number]))
    return candidates


def is_calibration_error(candidate: Candidate, experiment: Experiment) -> bool:
    """True for an offset or a gain of an input or a channel: a law with one amplitude, polynomial in the signal and the
    amplitude, without states and without time."""
    if candidate.attaches not in ("input", "channel") or len(candidate.numbers) != 1 or not candidate.vanishes:
        return False
    return is_offset_or_gain(experiment.model.library.component(candidate.component))
