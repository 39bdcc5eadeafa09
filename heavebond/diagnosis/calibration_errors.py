"""Calibration errors: an offset or a gain of an input or of a measured channel.

A fault of a sensor or of a supply can be absorbed by a number of a law (a friction that differs by direction, a free
length): the law then stands for both. So the laws that lead the first step are refitted beside each calibration error.
"""

from __future__ import annotations

from heavebond.diagnosis.catalogue import Candidate
from heavebond.estimation.experiment import Experiment
from heavebond.text.expression import Binary, Expr, Name, Negative, Number, children


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
