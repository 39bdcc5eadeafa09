"""The values that a diagram holds fixed, as candidates: a number of the data sheet that is wrong is no missing physics."""

from __future__ import annotations

from collections.abc import Iterator
from math import isfinite

from heavebond.core.errors import listing
from heavebond.diagnosis.catalogue import Candidate, EffectNumber, quantity, within
from heavebond.equations.expanded import Leaf
from heavebond.estimation.comparison import assemble_for
from heavebond.estimation.experiment import Experiment
from heavebond.language.definition import Parameter, Value
from heavebond.language.edits import Change
from heavebond.numerics.dae import Assembly
from heavebond.text.expression import names

VALUE = "value of a parameter"
WIDE = 10.0  # times and parts of what stands in the diagram: beyond it is another machine


def fixed_values(experiment: Experiment) -> list[Candidate]:
    """One candidate for each number that is not free: the parameters of the diagram itself, those of its parts, and those
    that parts of parts must be given. Not among them are zeros, effects that sleep, widths of transitions and what follows
    from a formula."""
    assembly = assemble_for(experiment, next(iter(experiment.records.values())))
    found = []
    for leaf in assembly.flat.expanded.leaves.values():
        for parameter in _given(leaf):
            name = f"{leaf.path}.{parameter.name}"
            value = assembly.parameter_values.get(name, 0.0)
            if name not in experiment.free and isfinite(value) and value not in (0.0, parameter.neutral):
                found.append(within(leaf, parameter, VALUE, [_number(name, parameter, value)]))
    return [*_of_diagram(experiment, assembly), *found]


def _of_diagram(experiment: Experiment, assembly: Assembly) -> Iterator[Candidate]:
    """The numbers under `parameters:` of the diagram that parts use in their formulas."""
    units = {q.name: q.unit for q in assembly.flat.parameters}
    leaves = assembly.flat.expanded.leaves.items()
    for name in assembly.flat.expanded.parameters:
        value = assembly.parameter_values.get(name, 0.0)
        using = tuple(path for path, leaf in leaves if any(
            isinstance(bound.value, Value) and name in {n.text for n in names(bound.value.expr)}
            for bound in leaf.parameters.values()))
        if using and name not in experiment.free and isfinite(value) and value:
            low, high = sorted((value / WIDE, value * WIDE))
            number = EffectNumber(name, units[name], low, high, None, True, value)
            component = assembly.flat.expanded.leaves[using[0]].component.name
            yield Candidate(name, component, VALUE, "parameter of the diagram", f"in {listing(using)} ({name})", using,
                            Change(settings={name: quantity(value, units[name])}), (number,), "in")


def _given(leaf: Leaf) -> Iterator[Parameter]:
    """What a diagram, or a block, says of a part by a single number."""
    for parameter in leaf.component.parameters.values():
        if not parameter.integer and not parameter.width and parameter.count is None \
                and ("." not in leaf.path or parameter.default is None):
            yield parameter


def _number(name: str, parameter: Parameter, value: float) -> EffectNumber:
    """What stands in the diagram is what an amplitude of zero is to an effect."""
    ends = sorted((value / WIDE, value * WIDE))
    low = ends[0] if parameter.low is None else max(ends[0], parameter.low)
    high = ends[1] if parameter.high is None else min(ends[1], parameter.high)
    return EffectNumber(name, parameter.unit, low, high, None, True, value, (parameter.low, parameter.high))
