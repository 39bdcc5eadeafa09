"""Calibration of unknown parameters, so that the measured and tuned quantities of a study match given values:

    minimise  sum_ck ((q_ck(p) - t_ck) / (w_k |t_ck|))**2 + sum_j ((p_j - p0_j) / sigma_j)**2   within the ranges,

over the cases c and quantities k for which a number t_ck is given, with the width w_k; the second sum holds parameters whose
range is given as `value +- tolerance`, which is two standard deviations. The gains g of a case are tuned anew at every p, so
that q = q(p, g(p)) and

    dq/dp = q_p + q_g dg/dp,    dg/dp = -phi_gg^-1 phi_gp,

with q_p and q_g from the forward sensitivities of one run, and the second derivatives of the cost phi as central differences
of its exact gradients (the Gauss-Newton approximation by sensitivities was wrong by up to a factor of ten for gains near the
stability boundary). SciPy's trust-region reflective algorithm minimises the sum.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from heavebond.core.errors import HeavebondError, Problem, SimulationError
from heavebond.core.parallel import as_done
from heavebond.core.progress import Progress
from heavebond.core.units import Range
from heavebond.language.edits import block, extended_from
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.simulator import Simulator
from heavebond.optimise.cost_evaluation import Evaluator
from heavebond.optimise.costs import read_cost
from heavebond.optimise.objective import TOLERANCES, Objective
from heavebond.optimise.search import search
from heavebond.studies.run_case import assembled, own_values, tuned_by
from heavebond.studies.shared_runs import run_times
from heavebond.studies.study import Calibration, Procedure, Study

# Residual of each target of a failed case, in widths.
BROKEN = 30.0
# A gain within this share of its range from a bound stays at the bound when other parameters change.
AT_END = 1e-3
MOST = 30  # largest number of evaluations by the least squares solver
RETUNED = 12  # largest number of steps of a tuning that starts at the gains of the previous values
SETTLED = 1e-3  # relative change of the sum or the parameters at which the search converges
STEP = 2e-3  # step of the differences of gradients, of a range: balances integration errors and truncation
PRIOR = 0.5  # standard deviation as a share of a tolerance


@dataclass(frozen=True)
class Residual:
    """One quantity with its target, in SI; `off` is the difference in widths."""

    case: int
    quantity: str
    value: float
    target: float
    off: float


@dataclass(frozen=True)
class Calibrated:
    """Result of a calibration, in SI: values before and after, parameters at a bound of their range (`low`, `high`), the
    quantities with their targets, and the sum of squares after each evaluation."""

    values: Mapping[str, tuple[float, float]]
    at_end: Mapping[str, str]
    residuals: tuple[Residual, ...]
    history: tuple[float, ...]
    simulations: float
    message: str

    def as_dict(self) -> dict[str, Any]:
        """The result as a dictionary for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, entries: Mapping[str, Any]) -> Calibrated:
        """The inverse of `as_dict`."""
        return cls({name: (pair[0], pair[1]) for name, pair in entries["values"].items()}, entries["at_end"],
                   tuple(Residual(**r) for r in entries["residuals"]), tuple(entries["history"]), entries["simulations"],
                   entries["message"])


@dataclass(frozen=True)
class Point:
    """A case at given parameters: gains, target quantities and their derivatives by the calibrated parameters (SI)."""

    gains: Mapping[str, float] = field(default_factory=dict)
    numbers: Mapping[str, float] = field(default_factory=dict)
    slopes: Mapping[str, Sequence[float]] = field(default_factory=dict)
    simulations: float = 0.0
    broken: bool = False


def calibrate(study: Study, executor: Executor | None = None, ahead: int = 1, progress: Progress | None = None
              ) -> Calibrated:
    """Estimate the values under `calibrate:`. Cases run on `executor`, `ahead` at a time. Raises UsageError for
    parameters that cannot be free, SimulationError if no case can be run at the diagram's values."""
    from scipy.optimize import least_squares

    solve: Any = least_squares
    assert study.calibration is not None
    problem = _Problem(study, study.calibration, executor, ahead, progress or (lambda text: None))
    first = problem.at(problem.start)
    if all(point.broken for point in first.points.values()):
        raise SimulationError([Problem("calibration-broken", "no case can be run with the diagram's own values", None,
                                       "Correct the diagram, or the ranges under `calibrate:`.")])
    solution = solve(lambda y: problem.at(y).residuals, problem.start, jac=lambda y: problem.at(y).jacobian,
                     bounds=(0.0, 1.0), method="trf", x_scale="jac", ftol=SETTLED, xtol=SETTLED, gtol=1e-6, max_nfev=MOST)
    best = problem.at(solution.x)
    after = problem.values(solution.x)
    ends = {name: "low" if y < AT_END else "high" if y > 1 - AT_END else ""
            for name, y in zip(after, solution.x, strict=True)}
    return Calibrated({name: (problem.before[name], value) for name, value in after.items()},
                      {name: end for name, end in ends.items() if end}, tuple(problem.compared(best.points)),
                      tuple(problem.history), problem.simulations, str(solution.message))


@dataclass(frozen=True)
class _Seen:
    points: Mapping[int, Point]
    residuals: Array
    jacobian: Array


class _Problem:
    """The least squares problem in y in [0, 1]^n: shares of the ranges, in logarithms for ranges above zero."""

    def __init__(self, study: Study, calibration: Calibration, executor: Executor | None, ahead: int, say: Progress):
        self.study, self.calibration, self.executor, self.ahead, self.say = study, calibration, executor, ahead, say
        self.names, self.ranges = list(calibration.free), list(calibration.free.values())
        self.before = own_values(study.model, calibration)
        published = study.beside[calibration.source].numbers
        self.targets = {k: {q: published[q][case.index].value for q in calibration.targets if case.index in published[q]}
                        for k, case in enumerate(study.cases)}
        self.cases = [k for k, targets in self.targets.items() if targets]
        self.seen: dict[bytes, _Seen] = {}
        self.gains: dict[int, Mapping[str, float]] = {}
        self.history: list[float] = []
        self.simulations = 0.0

    @property
    def start(self) -> Array:
        """The diagram's values, clipped to 1 % from the bounds: the search must start in the interior."""
        shares = [_share(wanted, self.before[name]) for name, wanted in zip(self.names, self.ranges, strict=True)]
        return np.clip(shares, 0.01, 0.99)

    def values(self, y: Array) -> dict[str, float]:
        """The parameters in SI."""
        return {name: _value(wanted, float(s)) for name, wanted, s in zip(self.names, self.ranges, y, strict=True)}

    def at(self, y: Array) -> _Seen:
        """Residuals (n,) and their derivatives (n, m) by y."""
        key = np.round(y, 12).tobytes()
        if key in self.seen:
            return self.seen[key]
        values = self.values(y)
        study = replace(self.study, calibrated={name: (self.before[name], value) for name, value in values.items()})
        jobs = [(k, (study, k, self.gains.get(k))) for k in self.cases]
        if self.executor is not None:
            pairs = as_done(self.executor, at_point, jobs, self.ahead, instead=self._died)
        else:
            pairs = ((k, at_point(*arguments)) for k, arguments in jobs)
        points: dict[int, Point] = {}
        for k, point in pairs:
            points[k] = point
            best = f", sum {min(self.history):.4g}" if self.history else ""
            self.say(f"calibrating, step {len(self.history) + 1}{best}: {len(points)} of {len(jobs)} cases")
        for k in self.cases:
            self.simulations += points[k].simulations
            if not points[k].broken:
                self.gains[k] = points[k].gains
        # d value / d share
        slopes = np.array([(float(values[name] * np.log(wanted.high / wanted.low)) if wanted.low > 0
                            else wanted.high - wanted.low) for name, wanted in zip(self.names, self.ranges, strict=True)])
        residuals, rows = [], []
        for k in self.cases:
            for quantity, target in self.targets[k].items():
                width = self.calibration.targets[quantity] * abs(target)
                if points[k].broken:
                    residuals.append(BROKEN)
                    rows.append(np.zeros(len(y)))
                else:
                    residuals.append((points[k].numbers[quantity] - target) / width)
                    rows.append(np.asarray(points[k].slopes[quantity]) / width * slopes)
        for j, (name, wanted) in enumerate(zip(self.names, self.ranges, strict=True)):
            if wanted.nominal is not None:
                sigma = PRIOR * (wanted.high - wanted.nominal)
                residuals.append((values[name] - wanted.nominal) / sigma)
                rows.append(np.eye(len(y))[j] * slopes[j] / sigma)
        self.history.append(float(np.sum(np.square(residuals))))
        self.seen[key] = _Seen(points, np.array(residuals), np.array(rows))
        return self.seen[key]

    def _died(self, k: int, _: BaseException) -> Point:
        """Raise an error for a case whose process died twice: without it the sum of squares would be another function."""
        case = ", ".join(level.name for level in self.study.case(k).levels)
        raise SimulationError([Problem("worker-died", f"the process of the case '{case}' of the calibration was "
                                       "ended from outside, also alone: there may be too little memory", None,
                                       "Run fewer cases at a time (--processes 1), or use a machine with more memory.")])

    def compared(self, points: Mapping[int, Point]) -> list[Residual]:
        """Every quantity with its target."""
        residuals = []
        for k in self.cases:
            for quantity, target in self.targets[k].items():
                value = points[k].numbers.get(quantity, float("nan"))
                residuals.append(Residual(k, quantity, value, target,
                                          (value - target) / (self.calibration.targets[quantity] * abs(target))))
        return residuals


def _share(wanted: Range, value: float) -> float:
    if wanted.low > 0:
        return float(np.log(max(value, wanted.low) / wanted.low) / np.log(wanted.high / wanted.low))
    return (value - wanted.low) / (wanted.high - wanted.low)


def _value(wanted: Range, share: float) -> float:
    if wanted.low > 0:
        return float(wanted.low * (wanted.high / wanted.low) ** share)
    return wanted.low + share * (wanted.high - wanted.low)


# -- one case ----------------------------------------------------------------------------------------------------------
def at_point(study: Study, number: int, gains: Mapping[str, float] | None) -> Point:
    """A case with the calibrated values of the study: tuned, starting at `gains` if they are given, simulated,
    differentiated. No state is kept between calls, so that the same values give the same point in every process.
    """
    try:
        assembly, simulations = assembled(study, study.case(number)), 0.0
        following: dict[str, Array] = {}
        if study.task is not None:
            objective = Objective(assembly, study.task)
            # the tuned gains, by the study's first procedure with gradients, or by a search that starts at `gains`
            if gains is None:
                gains = tuned_by(objective, next((p for p in study.procedures if not p.sweeps),
                                                 Procedure("gradients"))).values
            else:
                first = objective.shares([gains[name] for name in objective.names])
                gains = objective.values(search(objective, first, "trust", RETUNED, lambda text: None).best.at)
            following = _following(objective, gains, _range_widths(study, assembly))
            simulations = objective.simulations
            assembly = assembly.with_parameters(gains)
        point = _differentiated(study, assembly, gains or {}, following)
        return replace(point, simulations=simulations + point.simulations)
    except HeavebondError:
        return Point(broken=True)


def _range_widths(study: Study, assembly: Assembly) -> dict[str, float]:
    """The widths of the ranges of the calibrated parameters that are set in this case."""
    assert study.calibration is not None
    return {name: wanted.high - wanted.low for name, wanted in study.calibration.free.items()
            if np.isclose(assembly.parameter_values[name], study.calibrated[name][1], rtol=1e-9, atol=0.0)}


def _differentiated(study: Study, assembly: Assembly, gains: Mapping[str, float], following: Mapping[str, Array]) -> Point:
    """The target quantities and their total derivatives; `following` has dg/dp (k,) for each calibrated parameter p."""
    calibration, parameters = study.calibration, list(_range_widths(study, assembly))
    assert calibration is not None
    measured = [name for name in calibration.targets if name in study.measures]
    times = run_times(study, assembly)
    evaluator = Evaluator(assembly, [read_cost(assembly, study.measures[name].text) for name in measured], study.begin,
                          float(times[-1]), named=(*parameters, *gains), modes=study.modes or {})
    plain = Simulator(assembly, times=times, tolerances=TOLERANCES, dense=True)
    if evaluator.integrated:
        evaluator.resized(evaluator.largest(plain.run()))
    run = Simulator(assembly, times=times, tolerances=TOLERANCES, quadratures=evaluator.quadratures,
                    factors=evaluator.factors, sensitivities=[*parameters, *gains], like=plain, dense=True).run()
    assert run.along is not None
    numbers, slopes = evaluator.functional_values(run)
    costs = evaluator.cost_values(numbers, slopes, np.zeros(len(numbers)), run.p, run.along.p)
    values = {**gains, **{name: value for name, (value, _) in zip(measured, costs, strict=True)}}
    slopes_by_target = {name: [0.0] * len(calibration.free) for name in calibration.targets}
    for k, name in enumerate(calibration.free):
        gain_slopes = following.get(name, np.zeros(len(gains)))
        for quantity, (_, slope) in zip(measured, costs, strict=True):
            slopes_by_target[quantity][k] = float(slope[parameters.index(name)] + slope[len(parameters):]
                                                  @ gain_slopes) if name in parameters else 0.0
        for gain, by in zip(gains, gain_slopes, strict=True):
            if gain in slopes_by_target:
                slopes_by_target[gain][k] = float(by)
    return Point(dict(gains), {name: values[name] for name in calibration.targets}, slopes_by_target,
                 1 + len(parameters) + len(gains) + bool(evaluator.integrated))


def _following(objective: Objective, gains: Mapping[str, float], parameters: Mapping[str, float]) -> dict[str, Array]:
    """d gains / d p (k,) for each calibrated parameter at an optimum. A gain at a bound of its range is constant, and
    gains at the stability boundary move along it."""
    shares = objective.shares([gains[name] for name in objective.names])
    moving = [k for k, share in enumerate(shares) if AT_END < share < 1 - AT_END]
    gain_slopes = {name: np.zeros(len(gains)) for name in parameters}
    if not moving:
        return gain_slopes
    values = {**{name: objective.assembly.parameter_values[name] for name in parameters}, **gains}

    def bend(name: str, width: float) -> Array:
        low, high = (objective.gradient_anew({**values, name: values[name] + sign * STEP * width}) for sign in (-1, 1))
        return np.asarray((high - low) / (2 * STEP * width))

    by_gains = np.array([bend(objective.names[k], float(objective.span[k]))[moving] for k in moving]).T
    edge = objective.boundary([*objective.names, *parameters], values)
    for name, width in parameters.items():
        right = bend(name, width)[moving]
        if edge is None:
            gain_slopes[name][moving] = -np.linalg.lstsq(by_gains, right, rcond=None)[0]
        else:  # stationary along the stability boundary, to which the gains are constrained
            along, slope = edge[moving], edge[len(objective.names) + list(parameters).index(name)]
            size = float(np.abs(by_gains).max()) / max(float(np.abs(along).max()), 1e-300)
            whole = np.block([[by_gains, size * along[:, None]], [size * along[None, :], np.zeros((1, 1))]])
            gain_slopes[name][moving] = -np.linalg.lstsq(whole, np.append(right, size * slope), rcond=None)[0][:-1]
    return gain_slopes


def calibrated_diagram(study: Study, calibrated: Calibrated, path: Path) -> str:
    """The text of a diagram at `path` that extends a study's diagram and sets the calibrated values."""
    assert study.calibration is not None
    values = {name: study.calibration.free[name].unit.written(after) for name, (_, after) in calibrated.values.items()}
    notes = {name: f"at the {end} end of its range" for name, end in calibrated.at_end.items()}
    source = study.beside[study.calibration.source].source
    head = [f"model: {path.stem}", f"summary: {study.model.name}, calibrated to what {source} gives.",
            f"extends: {extended_from(path, study.model.path)}"]
    return "\n".join([*head, *block("set", values, notes)]) + "\n"
