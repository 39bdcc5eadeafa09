"""How the poles of a machine move while one parameter does, its operating point moving along."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from heavebond.analysis.operating import OperatingPoints
from heavebond.basis.errors import HeavebondError, Problem, UsageError
from heavebond.basis.units import Range
from heavebond.language.model import Model
from heavebond.numbers.dae import Array
from heavebond.numbers.simulation import Time
from heavebond.studies.linearisation import Linearisation
from heavebond.studies.objective import check_ranges

POINTS = 81


@dataclass(frozen=True)
class RootLocus:
    """Poles (N, n) in 1/s at the values (N,) of a parameter in SI, each column following one pole; `limits` are values at
    which the last growing mode appears or goes (the limit of stability)."""

    parameter: str
    unit: str
    values: Array
    poles: NDArray[np.complex128]
    limits: tuple[float, ...]


def root_locus(model: Model, parameter: str, span: Range, *, at: Time | None = None, points: int = POINTS) -> RootLocus:
    """The poles of a diagram over a span of a parameter; UsageError where fewer than two values have an operating point."""
    from scipy.optimize import brentq

    operating = OperatingPoints(model, at)
    linearisation = Linearisation(operating.assembly)
    check_ranges(operating.assembly, {parameter: span})

    def poles(value: float) -> NDArray[np.complex128]:
        linear = linearisation.at(operating.at({parameter: value}))
        return np.asarray(np.linalg.eigvals(linear.a * linear.sizes / linear.sizes[:, None]), dtype=complex)

    tried, found, failed = [], [], ""
    for value in np.linspace(span.low, span.high, points).tolist():
        try:
            found.append(poles(value))
            tried.append(value)
        except HeavebondError as error:
            failed = str(error)
    if len(tried) < 2:
        raise UsageError([Problem("locus-empty", f"no operating point was found while {parameter} moves", notes=(failed,))])
    values, growth = np.array(tried), [float(p.real.max(initial=-np.inf)) for p in found]
    limits = [float(brentq(lambda v: poles(v).real.max(), values[k], values[k + 1], rtol=1e-10))
              for k in range(len(values) - 1) if growth[k] * growth[k + 1] < 0]
    index = operating.assembly.parameter_names.index(parameter)
    unit = operating.assembly.flat.parameters[index].unit.text
    return RootLocus(parameter, unit, values, _followed(found), tuple(limits))


def _followed(found: Sequence[NDArray[np.complex128]]) -> NDArray[np.complex128]:
    """The poles in such order that each column moves little from row to row."""
    from scipy.optimize import linear_sum_assignment

    rows = [found[0][np.lexsort((found[0].imag, found[0].real))]]
    for poles in found[1:]:
        apart = np.abs(rows[-1][:, None] - poles[None, :]) / (np.abs(rows[-1])[:, None] + np.abs(poles)[None, :] + 1e-300)
        rows.append(poles[linear_sum_assignment(apart)[1]])
    return np.array(rows)
