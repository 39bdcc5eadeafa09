"""Root loci: poles over one parameter, with the operating point computed anew for each value."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from heavebond.core import facade
from heavebond.core.errors import HeavebondError, Problem, UsageError
from heavebond.core.presentation import brief, count, readable
from heavebond.core.quantities import si_range
from heavebond.core.units import Range
from heavebond.equations.parameters import check_ranges
from heavebond.language.model import ModelOrFile, loaded
from heavebond.linear.held_variables import HeldVariable
from heavebond.linear.linearisation import Linear, Linearisation
from heavebond.linear.operating_point import OperatingPoints
from heavebond.linear.stability import Stability
from heavebond.numerics.dae import Array
from heavebond.numerics.output_times import Time

if TYPE_CHECKING:
    from matplotlib.figure import Figure

POINTS = 81


@dataclass(frozen=True)
class RootLocus(facade.Displayed):
    """Poles (N, n) in 1/s at the values (N,) of a parameter in SI, each column following one pole; `limits` are values at
    which the last growing mode appears or vanishes (the stability boundary). `stability` is the verdict on each value: free
    modes remain exactly zero and give no limit. The poles of a sampled system are log(z)/T; `periods` (N,) are T in s.
    `filled` describes the volumes added to nodes without capacity; `held` lists the variables that are constant in the
    linear system, at the first value."""

    parameter: str
    unit: str
    values: Array
    poles: NDArray[np.complex128]
    limits: tuple[float, ...]
    stability: tuple[Stability, ...]
    filled: str = ""
    held: tuple[HeldVariable, ...] = ()
    periods: Array | None = None

    def __repr__(self) -> str:
        ends = " to ".join(readable(float(self.values[k]), self.unit) for k in (0, -1))
        limits = ", ".join(readable(limit, self.unit) for limit in self.limits)
        return brief(self, self.parameter, f"{ends}, {count(self.poles.shape[1], 'pole')}",
                     f"stability boundary at {limits}" if limits else "no stability boundary")

    def plot(self) -> Figure:
        """A matplotlib figure of the ways of the poles, coloured by the value of the parameter."""
        figure: Figure = facade.call("RootLocus.plot", self)
        return figure

    @property
    def z(self) -> NDArray[np.complex128]:
        """The poles (N, n) of a sampled system in the z-plane."""
        return np.asarray(np.exp(self.poles * (1.0 if self.periods is None else self.periods[:, None])))


def root_locus(model: ModelOrFile, parameter: str, span: Range | str, *, at: Time | None = None, points: int = POINTS
               ) -> RootLocus:
    """The poles of a diagram over a span of a parameter: `root_locus(model, "controller.K_p", "0 .. 10 1/m")`.

    The `points` values of `parameter` are evenly spaced over `span`; poles are in 1/s; for sampled systems they are
    log(z)/T. `model` is linearised at the operating point `at`, as by `state_space`. Raises UsageError for an unknown
    parameter, a span in another unit, or if fewer than two values have an operating point.
    """
    span = si_range(span, parameter)
    operating = OperatingPoints(loaded(model), at)
    linearisation = Linearisation(operating.assembly)
    flat = operating.assembly.flat
    check_ranges({q.name: q.unit for q in flat.parameters}, {parameter: span}, flat.limits, flat.origins.of_name)

    def linear(value: float) -> Linear:
        return linearisation.at(operating.at({parameter: value}))

    tried, poles, judged, periods, failed, held = [], [], [], list[float | None](), "", tuple[HeldVariable, ...]()
    for value in np.linspace(span.low, span.high, points).tolist():
        try:
            near = linear(value)
        except HeavebondError as error:
            failed = str(error)
            continue
        poles.append(near.poles())
        periods.append(near.period)
        judged.append(near.stability())
        tried.append(value)
        held = held or near.held
    if len(tried) < 2:
        raise UsageError([Problem("locus-empty", f"no operating point was found while {parameter} moves", notes=(failed,))])
    values = np.array(tried)
    limits = [_limit(lambda v: linear(v).stability(), (values[k], values[k + 1]), (judged[k], judged[k + 1]))
              for k in range(len(values) - 1) if bool(judged[k].growing) != bool(judged[k + 1].growing)
              and not (judged[k].undecided or judged[k + 1].undecided)]
    index = operating.assembly.parameter_names.index(parameter)
    unit = operating.assembly.flat.parameters[index].unit.text
    sampled = None if None in periods else np.array(periods, dtype=float)
    return RootLocus(parameter, unit, values, _followed(poles, sampled), tuple(limits), tuple(judged), operating.filled,
                     held, sampled)


def _limit(judged: Callable[[float], Stability], span: tuple[float, float], ends: tuple[Stability, Stability]) -> float:
    """The value between two at which a mode begins to grow, or ends to."""
    from scipy.optimize import brentq

    if ends[0].abscissa * ends[1].abscissa < 0 and all(np.isfinite(end.abscissa) for end in ends):
        # a real pole on its way through zero is free there: an end of the search, on the side that does not grow
        limit = float(brentq(lambda v: judged(v).abscissa if np.isfinite(judged(v).abscissa) else 0.0, *span, rtol=1e-10))
        return 0.0 if abs(limit) <= 1e-9 * abs(span[1] - span[0]) else limit
    low, high = span
    grows = bool(ends[0].growing)
    while abs(high - low) > 1e-10 * max(abs(low), abs(high)):
        middle = (low + high) / 2
        if middle in (low, high):
            break
        low, high = (middle, high) if bool(judged(middle).growing) == grows else (low, middle)
    return (low + high) / 2


def _followed(poles_by_value: Sequence[NDArray[np.complex128]], periods: Array | None) -> NDArray[np.complex128]:
    """The poles in an order with the least changes of each column from row to row; poles of a sampled system in the
    z-plane."""
    from scipy.optimize import linear_sum_assignment

    rows = [poles_by_value[0][np.lexsort((poles_by_value[0].imag, poles_by_value[0].real))]]
    for k, poles in enumerate(poles_by_value[1:], 1):
        if periods is not None:
            apart = np.abs(np.exp(rows[-1] * periods[k - 1])[:, None] - np.exp(poles * periods[k])[None, :])
        else:
            sizes = np.abs(rows[-1])[:, None] + np.abs(poles)[None, :] + 1e-300
            apart = np.abs(rows[-1][:, None] - poles[None, :]) / sizes
        rows.append(poles[linear_sum_assignment(apart)[1]])
    return np.array(rows)
