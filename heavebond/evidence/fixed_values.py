"""The values that a diagram holds fixed, as candidates: a number of the data sheet that is wrong is no missing physics."""

from __future__ import annotations

from collections.abc import Iterator

from heavebond.equations.expand import Leaf
from heavebond.evidence.catalogue import Candidate, Sized, quantity
from heavebond.evidence.change import Change
from heavebond.evidence.comparison import assemble_for
from heavebond.evidence.experiment import Experiment
from heavebond.language.definition import Parameter

VALUE = "value of a parameter"
WIDE = 10.0  # times and parts of what stands in the diagram: beyond it is another machine


def fixed_values(experiment: Experiment) -> list[Candidate]:
    """One candidate for each number that is not free: those of the parts of the diagram, and those that parts of parts must
    be given. Not among them are zeros, effects that sleep, widths of transitions and what follows from a formula."""
    assembly = assemble_for(experiment, next(iter(experiment.records.values())))
    values = assembly.parameter_values
    return [_candidate(leaf, parameter, values[full]) for leaf in assembly.flat.expanded.leaves.values()
            for full, parameter in _held(leaf) if full not in experiment.free and values.get(full, parameter.neutral or 0.0)
            not in (0.0, parameter.neutral)]


def _held(leaf: Leaf) -> Iterator[tuple[str, Parameter]]:
    for parameter in leaf.component.parameters.values():
        if not parameter.integer and not parameter.width and parameter.count is None \
                and ("." not in leaf.path or parameter.default is None):
            yield f"{leaf.path}.{parameter.name}", parameter


def _candidate(leaf: Leaf, parameter: Parameter, value: float) -> Candidate:
    full = f"{leaf.path}.{parameter.name}"
    ends = sorted((value / WIDE, value * WIDE))
    low = ends[0] if parameter.low is None else max(ends[0], parameter.low)
    high = ends[1] if parameter.high is None else min(ends[1], parameter.high)
    number = Sized(full, parameter.unit, low, high, None, True, value)
    return Candidate(full, leaf.component.name, VALUE, parameter.doc, f"in {leaf.path} ({parameter.name})", (leaf.path,),
                     Change(settings={full: quantity(value, parameter.unit)}), (number,), "in")
