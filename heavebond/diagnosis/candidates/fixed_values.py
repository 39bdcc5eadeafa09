"""Fixed values of a diagram and calibration errors of its instruments, as candidates.

A wrong value of a data sheet is no missing physics, but explains a misfit as well.

A calibration error is an offset or a gain of an input or of a measured channel. A number of a law can absorb it (friction
that differs by direction, a free length). So the laws that lead the first step are refitted beside each calibration error.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import isfinite

from heavebond.core.errors import listing
from heavebond.diagnosis.candidates.catalogue import Candidate, EffectNumber, quantity, within
from heavebond.equations.expanded import Leaf
from heavebond.estimation.comparison import assemble_for
from heavebond.estimation.experiment import Experiment
from heavebond.language.definition import Parameter, Value
from heavebond.language.edits import Change
from heavebond.numerics.dae import Assembly
from heavebond.text.expression import Binary, Expr, Name, Negative, Number, children, names

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


def is_calibration_error(candidate: Candidate, experiment: Experiment) -> bool:
    """Whether it is an offset or a gain of an input or a channel: a law of one amplitude that is a polynomial of the
    signal and the amplitude, without states and without time."""
    if candidate.attaches not in ("input", "channel") or len(candidate.numbers) != 1 or not candidate.vanishes:
        return False
    component = experiment.model.library.component(candidate.component)
    known = {*component.signals, *component.parameters}
    return not component.variables and all(_polynomial(side, known) for line in component.equations
                                           for side in (line.tree.left, line.tree.right))


def _polynomial(expr: Expr, known: set[str]) -> bool:
    """Whether an expression holds nothing but sums and products of numbers and `known` names."""
    if isinstance(expr, Name):
        return expr.text in known
    return isinstance(expr, (Number, Binary, Negative)) and all(_polynomial(child, known) for child in children(expr))
