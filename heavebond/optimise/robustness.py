"""Robustness of a tuned machine: sensitivity of cost and limits to parameters, and the stability boundary."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from heavebond.core.errors import NAMES_LISTED, Problem, UsageError, suggest
from heavebond.core.progress import Progress
from heavebond.core.units import UnitProblem, check_unit, parse_quantity
from heavebond.language.definition import Value
from heavebond.numerics.dae import Array, Assembly
from heavebond.optimise.objective import OBJECTIVE, Objective
from heavebond.optimise.tuning import Tuned
from heavebond.text.dimensions import has_origin

SHARE = 0.1  # relative change of every free parameter
RISE = 0.01  # relative increase of the cost at the edge of the ellipse
# share of a range for differences of gradients: large compared with the errors of runs, small compared with the ellipse
STEP = 2e-3


@dataclass(frozen=True)
class Change:
    """One parameter at another value (SI): the cost and the limits there (satisfied if not above zero)."""

    name: str
    value: float
    share: float
    cost: float
    limits: Mapping[str, float]

    @property
    def exceeded(self) -> list[str]:
        """The violated limits."""
        return [text for text, value in self.limits.items() if not value <= OBJECTIVE.limit_tolerance]


@dataclass(frozen=True)
class Margin:
    """The factors by which a parameter may decrease and increase, with the others fixed, until the machine at rest
    becomes unstable (or stable); None if that does not happen within a factor of a hundred."""

    name: str
    down: float | None
    up: float | None


@dataclass(frozen=True)
class Ellipse:
    """Region in which the cost rises by less than RISE in second order: the half-width in each free parameter (SI, with
    all others optimised), and the ellipse's half axes as columns (m, m) in SI."""

    widths: dict[str, float]
    axes: Array


@dataclass(frozen=True)
class Robustness:
    """Robustness of a tuned machine; `damping` is the least damping ratio at the best values, `worst` the case with the
    highest cost, `ellipse` None if the best point lies at the edge of a range or of a limit, or is not a minimum."""

    changes: tuple[Change, ...]
    damping: float
    margins: tuple[Margin, ...]
    worst: tuple[str, float]
    ellipse: Ellipse | None


def robustness(problem: Objective, tuned: Tuned, *, progress: Progress | None = None) -> Robustness:
    """Runs around the best values, and the linearised machine along each free parameter.

    Every free parameter is changed by a tenth either way, every uncertain one by its uncertainty. UsageError for an
    uncertainty that cannot be read. The reference run is always the run of the tuned machine.
    """
    say = progress or (lambda text: None)
    widths = {name: SHARE * abs(value) for name, value in tuned.values.items()} | uncertainties(problem)
    centre = {name: problem.assembly.parameter_values[name] for name in widths} | tuned.values
    changes = []
    for name, width in widths.items():
        for sign in (-1, 1):
            say(f"moving {name}")
            value = centre[name] + sign * width
            evaluation = problem.at({**tuned.values, name: value})
            share = sign * width / abs(centre[name]) if centre[name] else sign * np.inf
            limits = dict(zip(problem.limits, evaluation.limits.tolist(), strict=True))
            changes.append(Change(name, value, share, evaluation.cost, limits))
    margins = tuple(Margin(name, *factors) for name, factors in (tuned.stability.boundary or {}).items())
    worst = max(tuned.cost_of_cases.items(), key=lambda pair: pair[1])
    damping = np.nan if tuned.stability.damping is None else tuned.stability.damping
    return Robustness(tuple(changes), damping, margins, worst, _ellipse(problem, tuned))


def uncertainties(problem: Objective) -> dict[str, float]:
    """The half-width (SI) of each uncertain parameter: a share of its value (`20 %`) or a quantity."""
    return {name: _width(problem.assembly, name, text) for name, text in problem.task.uncertain.items()}


def _width(assembly: Assembly, name: str, text: str) -> float:
    units = {q.name: q.unit for q in assembly.flat.parameters}
    if name not in units:
        raise UsageError([Problem("parameter-unknown", f"'{name}' is not a parameter of the diagram that can be "
                                  "uncertain", None,
                                  suggest(name, units) or NAMES_LISTED)])
    try:
        number, unit = parse_quantity(text)
        if unit is not None and unit.text == "%":
            value = assembly.parameter_values[name]
            bound = assembly.flat.origins.bounds.get(name)
            if bound is not None and isinstance(bound.value, Value) and has_origin(bound.value.expr):
                raise UnitProblem("range-relative", f"a percentage of {bound.value.text} depends on the zero of the scale",
                                  f"Write a width in K, for example '{abs(number * value):.3g} K'.")
            return abs(number * value)
        if unit is not None:
            number -= unit.offset  # 3 degC is a width of 3 K
        check_unit(unit, units[name], number, text)
    except UnitProblem as problem:
        raise UsageError([Problem(problem.code, f"uncertainty of {name}: {problem.message}", None, problem.hint)]) from None
    return abs(number)


def _ellipse(problem: Objective, tuned: Tuned) -> Ellipse | None:
    """The ellipse from central differences of gradients, which are more accurate than the curvature of a search."""
    best = problem.shares([tuned.values[name] for name in problem.names])
    if (best < 2 * STEP).any() or (best > 1 - 2 * STEP).any() or max(tuned.limits.values(), default=-1.0) > -1e-3:
        return None
    bends = []
    for k in range(len(best)):
        step = STEP * np.eye(len(best))[k]
        slopes = [problem.evaluate(best + sign * step).gradient for sign in (-1, 1)]
        if slopes[0] is None or slopes[1] is None:
            return None
        bends.append((slopes[1] - slopes[0]) / (2 * STEP))
    bend = np.array(bends)
    values, vectors = np.linalg.eigh((bend + bend.T) / 2)
    if values.min() <= 0 or not tuned.cost:
        return None
    axes = problem.span[:, None] * vectors * np.sqrt(2 * RISE * abs(tuned.cost) / values)
    return Ellipse(dict(zip(problem.names, np.linalg.norm(axes, axis=1).tolist(), strict=True)), axes)
