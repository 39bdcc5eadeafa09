"""Nonlinear model predictive control: the commands of least cost over a horizon, by the equations of a diagram.

At each sample the commands u_0 .. u_(N-1), each constant during a period T, minimise

    integral over N T of sum ((y_i - r_i)/s_i)^2 + sum (u_j/e_j)^2,

subject to the equations of the diagram from the present states on, to the ranges and rates of the commands and to limits of
signals, and the first commands are applied. The states at the samples are unknowns, and the collocation equations of
`radau_step` between them are constraints (multiple shooting). Limits of signals are soft: an excess has a cost in proportion
to its sum, so that the problem has a solution when a disturbance has passed a limit. IPOPT solves the problem with exact
derivatives; it begins from the solution of the last sample, moved by one period.

J. B. Rawlings, D. Q. Mayne, M. M. Diehl, Model Predictive Control, 2nd ed., 2017, chapters 1 and 8; H. G. Bock, K. J. Plitt,
A multiple shooting algorithm for direct solution of optimal control problems, 1984, doi:10.1016/S1474-6670(17)61205-9.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from heavebond.core.errors import Problem, SimulationError, UsageError, listing, suggest
from heavebond.core.presentation import brief, count
from heavebond.core.quantities import ranges, si_value
from heavebond.core.units import Range, Unit, dimension_text, read_unit, times
from heavebond.language.model import ModelOrFile
from heavebond.monitoring.radau_step import RadauStep
from heavebond.numerics.dae import Array, Assembly, assemble
from heavebond.numerics.initialise import start
from heavebond.numerics.output_times import Time, seconds
from heavebond.numerics.result import signal_expression
from heavebond.optimise.optimal import free_assembly, optimal_task

PENALTY = 1e3  # cost of an excess of a limit by its range at one sample, in costs of the present deviation over the horizon
ITERATIONS = 300  # most iterations of IPOPT
LONGEST = 500  # most samples of a horizon, and steps in a period


@dataclass(frozen=True, eq=False)
class PredictedPlan:
    """The plan of one sample in SI: its times (N+1,) in s, `commands` (N,) and `states` (N+1,) by name, the `cost`, the
    `iterations` of IPOPT, and the largest `excess` of a limit, as a share of its range."""

    time: Array
    commands: Mapping[str, Array]
    states: Mapping[str, Array]
    cost: float
    iterations: int
    excess: float


class PredictiveControl:
    """A nonlinear predictive controller of a diagram.

    `free` are the signals that it commands, with their ranges (`{"force.u": "-8 .. 8 N"}`); their laws in the diagram are
    replaced. `weigh` are signals or formulas, and `effort` the commands, each with the deviation that counts as 1. The
    controller has a sampling `period` and a `horizon` in samples. `targets` are values of weighed signals (0 without an
    entry), `limits` ranges of signals at the samples, `rates` the largest changes of commands in a second, `steps` the steps
    of the integration in a period. Plain numbers are in SI. Raises UsageError for unknown names, units of another
    dimension, and diagrams with events, delays or records.
    """

    def __init__(self, model: ModelOrFile, free: Mapping[str, Range | str], weigh: Mapping[str, float | str],
                 effort: Mapping[str, float | str], *, period: Time, horizon: int,
                 targets: Mapping[str, float | str] | None = None, limits: Mapping[str, Range | str] | None = None,
                 rates: Mapping[str, float | str] | None = None, steps: int = 2):
        targets, rates = targets or {}, rates or {}
        task = optimal_task(free, "integral(1)", interpolation="hold")
        self.assembly: Assembly = free_assembly(assemble(model), task)
        self.free, self.period, self.horizon, self.steps = list(task.free), seconds(period, "period"), horizon, steps
        self._check(weigh, effort, targets, rates)
        bounds = ranges(limits or {})
        self.low, self.high = (np.array([getattr(task.free[name], end) for name in self.free]) for end in ("low", "high"))
        size, wanted = self._sizes("size", weigh), dict.fromkeys(weigh, 0.0) | self._sizes("target", targets)
        efforts, speeds = self._sizes("effort", effort), self._sizes("rate", rates, -1)
        for name, bound in bounds.items():
            needed = self._unit(name)
            if needed is not None and needed.dimension != bound.unit.dimension:
                raise UsageError([Problem("unit-wrong", f"{name} is in {needed.text}; its limit is in {bound.unit.text}",
                                          None, f"Write the limit in {needed.text}.")])
        self.radau = RadauStep(self.assembly, [self._expression(name) for name in (*weigh, *bounds)], (),
                               np.zeros(len(self.assembly.x_nominal)))
        self._rest = np.clip(0.0, self.low, self.high)
        time = self.assembly.begin
        first = start(self.assembly, time, np.concatenate([[time], *([value, 0, 0, 0] for value in self._rest)]))
        self._p, self._z = first.p, first.z / self.assembly.z_nominal
        self._build([size[name] for name in weigh], [wanted[name] for name in weigh], [efforts[name] for name in self.free],
                    list(bounds.values()), {self.free.index(name): speed for name, speed in speeds.items()})
        self.forget()

    def __repr__(self) -> str:
        return brief(self, self.assembly.model.name, f"commands {listing(self.free)}",
                     f"{count(self.horizon, 'sample')} of {self.period:g} s")

    def forget(self) -> None:
        """Forget the last plan: the next one begins from rest, and the rate of its first command has no bound."""
        self._guess: Array | None = None
        self._before: Array | None = None

    def plan(self, states: Mapping[str, float], time: float = 0.0) -> PredictedPlan:
        """The plan from these states (all states of the diagram, in SI) at a time in s. The last plan is the first guess,
        and rates count from its first command. Raises UsageError for missing states, SimulationError if IPOPT finds no
        solution."""
        names, radau, count_ = self.assembly.state_names, self.radau, self.horizon * self.steps
        if missing := [name for name in names if name not in states]:
            raise UsageError([Problem("state-missing", f"the value of {listing(missing)} is missing", None,
                                      f"States: {listing(names, 20)}. hb.Estimator estimates them from measured values.")])
        x = np.array([float(states[name]) for name in names]) / self.assembly.x_nominal
        if not np.isfinite(x).all():
            raise UsageError([Problem("state-value", f"{names[int(np.flatnonzero(~np.isfinite(x))[0])]} is not a finite "
                                      "number", None, "Give finite numbers in SI.")])
        span, stages = self.high - self.low, len(radau.stage_times)
        guesses = [] if self._guess is None else [self._guess]
        guesses.append(np.concatenate([
            np.tile(x, count_), np.tile(np.concatenate([x, self._z]), count_ * stages),
            np.tile((self._rest - self.low) / span, self.horizon), np.zeros(self._slacks * self.horizon)]))
        low, high, least, most = self._bounds
        if self._before is None and self._rated:
            least, most = least.copy(), most.copy()
            least[self._rated], most[self._rated] = -np.inf, np.inf
        before = self._rest if self._before is None else self._before
        pieces = np.concatenate([[time], *([value, 0, 0, 0] for value in before)])
        signals = np.array(radau.rates(time, x, self._z, [], self._p, pieces)[2]).ravel()[:len(self._goal)]
        present = float(np.sum(((signals - self._goal) / self._size) ** 2))
        penalty = PENALTY * (1 + (present if np.isfinite(present) else 0.0)) * self.horizon * self.period
        for guess in guesses:  # if the last plan does not lead to a solution, the guess at rest may
            result = self._solver(x0=np.clip(guess, low, high), lbx=low, ubx=high, lbg=least, ubg=most,
                                  p=np.concatenate([x, [time], before, [penalty]]))
            statistics = self._solver.stats()
            if statistics["success"]:
                break
        else:
            self.forget()
            raise SimulationError([Problem("control-unsolved", f"IPOPT found no commands at t = {time:.6g} s "
                                           f"({statistics['return_status']})", None, "Give more steps in a period, a "
                                           "shorter horizon, or wider ranges of the commands.")])
        at_samples, x_all, w_all, share, slack = (np.array(part) for part in self._parts(result["x"]))
        moved = [np.roll(part, -columns, axis=1) for part, columns in (
            (x_all, self.steps), (w_all, self.steps), (share, 1), (slack, 1))]
        for part, columns in zip(moved, (self.steps, self.steps, 1, 1), strict=True):
            if part.shape[1] > columns:
                part[:, -columns:] = part[:, [-columns - 1]]
        self._guess = np.concatenate([part.ravel(order="F") for part in moved])
        commands = self.low[:, None] + span[:, None] * share
        self._before = commands[:, 0]
        courses = np.column_stack([x, at_samples]) * self.assembly.x_nominal[:, None]
        instants: Array = np.asarray(time + self.period * np.arange(self.horizon + 1), np.float64)
        return PredictedPlan(instants, dict(zip(self.free, commands, strict=True)),
                             dict(zip(names, courses, strict=True)), float(result["f"]), int(statistics["iter_count"]),
                             float(slack.max(initial=0.0)))

    def command(self, states: Mapping[str, float], time: float = 0.0) -> dict[str, float]:
        """The commands from these states until the next sample, in SI (see `plan`)."""
        return {name: float(values[0]) for name, values in self.plan(states, time).commands.items()}

    def _check(self, weigh: Mapping[str, object], effort: Mapping[str, object], targets: Mapping[str, object],
               rates: Mapping[str, object]) -> None:
        problems = [Problem("control-number", f"{subject}: {value} is not a whole number from 1 to {LONGEST}", None,
                            "Write for example horizon=20, steps=2.")
                    for subject, value in (("horizon", self.horizon), ("steps", self.steps))
                    if not (isinstance(value, int) and 1 <= value <= LONGEST)]
        if not self.period > 0:
            problems.append(Problem("control-period", f"the period is {self.period:g} s: it must be above 0", None,
                                    "Write for example period='50 ms'."))
        if not weigh:
            problems.append(Problem("control-weigh", "no signal is weighed", None,
                                    "Write for example weigh={'cart.x': '10 mm'}."))
        if records := [known.name for known in self.assembly.flat.inputs if known.name not in self.free]:
            problems.append(Problem("control-records", f"{listing(records)} of the diagram follow records, whose future a "
                                    "controller does not know", None, "Give them a law, or command them."))
        for subject, names, known in (("effort", effort, self.free), ("rates", rates, self.free),
                                      ("targets", targets, [*weigh])):
            problems += [Problem("control-name", f"{subject}: '{name}' is not among {listing(known)}", None,
                                 suggest(name, known) or f"Names: {listing(known)}.") for name in names if name not in known]
        problems += [Problem("control-effort", f"the effort of '{name}' is missing", None,
                             f"Give the size that counts as 1, such as half of its range: effort={{'{name}': ...}}.")
                     for name in self.free if name not in effort]
        if problems:
            raise UsageError(problems)

    def _expression(self, name: str) -> ca.SX:
        """An output or a formula in SI."""
        output = self.assembly.model.show.get(name)
        return self.assembly.expression(output.expr) if output else signal_expression(self.assembly, name, si=True)

    def _unit(self, name: str) -> Unit | None:
        output, resolver = self.assembly.model.show.get(name), self.assembly.resolver()
        self._expression(name)  # UsageError for an unknown name
        return resolver.unit(output.expr if output else self.assembly.model.library.formula(name))

    def _sizes(self, subject: str, given: Mapping[str, float | str], power: int = 0) -> dict[str, float]:
        """The sizes of signals in SI, with their unit times a power of seconds, which are above 0, or their targets."""
        sizes = {}
        for name, text in given.items():
            needed = self._unit(name)
            base = needed or read_unit("1")
            text_of_unit = dimension_text(times(base.dimension, read_unit("s").dimension, power)) if power else base.text
            sizes[name] = si_value(text, text_of_unit, f"{subject} of {name}")
            if subject != "target" and not sizes[name] > 0:
                raise UsageError([Problem("control-size", f"the {subject} of {name} is {sizes[name]:g}: it must be above 0",
                                          None, "Give the size of a deviation that counts as 1.")])
        return sizes

    def _build(self, size: Sequence[float], wanted: Sequence[float], effort: Sequence[float], limits: Sequence[Range],
               rates: Mapping[int, float]) -> None:
        """The nonlinear programme with its bounds; x and z by nominal sizes, commands as shares of their ranges."""
        radau, n, m, horizon, steps = self.radau, self.radau.n, len(self.free), self.horizon, self.steps
        total, h, unknowns = horizon * steps, self.period / steps, n + radau.n_z
        x, w = ca.MX.sym("X", n, total), ca.MX.sym("W", len(radau.stage_times) * unknowns, total)
        share, slack = ca.MX.sym("U", m, horizon), ca.MX.sym("S", len(limits), horizon)
        first, time, before, penalty = (ca.MX.sym(name, size_) for name, size_ in (
            ("x", n), ("t", 1), ("before", m), ("penalty", 1)))
        self._size, self._goal = np.array(size), np.array(wanted)
        span = self.high - self.low
        command = ca.repmat(ca.DM(self.low), 1, horizon) + ca.DM(np.diag(span)) @ share
        held = ca.horzcat(*(command[:, k // steps] for k in range(total)))
        instants = time + ca.DM(h * np.arange(total)).T
        pieces = ca.vertcat(instants, *(ca.vertcat(held[j, :], ca.DM.zeros(3, total)) for j in range(m)))
        p, q = ca.repmat(ca.DM(self._p), 1, total), ca.DM(0, total)
        constraints = [radau.residual.map(total)(w, ca.horzcat(first, x[:, :-1]), q, p, pieces, instants,
                                                 ca.repmat(ca.DM(h), 1, total)), x - w[-unknowns:, :][:n, :]]
        equal = np.zeros(sum(part.numel() for part in constraints))
        least, most = [equal], [equal]
        goals, sizes = (ca.repmat(ca.DM(list(values)), 1, total) for values in (wanted, size))
        cost, signals = ca.MX(0), ca.MX(0)
        weights = np.array(ca.collocation_coeff(radau.stage_times)[2]).ravel().tolist()
        for i, (tau, weight) in enumerate(zip(radau.stage_times, weights, strict=True)):
            at = w[i * unknowns:(i + 1) * unknowns, :]
            signals = radau.rates.map(total)(instants + h * tau, at[:n, :], at[n:, :], q, p, pieces)[2]
            cost += weight * h * ca.sumsqr((signals[:len(size), :] - goals) / sizes)
        cost += self.period * ca.sumsqr(command / ca.repmat(ca.DM(list(effort)), 1, horizon))
        cost += penalty * ca.sum1(ca.sum2(slack))
        for k, limit in enumerate(limits):  # the last stage is the end of a step
            signal, width = signals[len(size) + k, steps - 1::steps], limit.high - limit.low
            constraints += [(signal - limit.low) / width + slack[k, :], (limit.high - signal) / width + slack[k, :]]
            least, most = [*least, np.zeros(2 * horizon)], [*most, np.full(2 * horizon, np.inf)]
        self._rated = [sum(map(len, least)) + horizon * k for k in range(len(rates))]  # the first changes
        for j, rate in rates.items():
            constraints.append((command[j, :] - ca.horzcat(before[j], command[j, :-1])) / span[j])
            change = np.full(horizon, rate * self.period / span[j])
            least, most = [*least, -change], [*most, change]
        free = np.full(x.numel() + w.numel(), np.inf)
        self._bounds = (np.concatenate([-free, np.zeros(share.numel() + slack.numel())]),
                        np.concatenate([free, np.ones(share.numel()), np.full(slack.numel(), np.inf)]),
                        np.concatenate(least), np.concatenate(most))
        self._slacks = len(limits)
        variables = ca.veccat(x, w, share, slack)
        self._solver = ca.nlpsol("predictive", "ipopt", {
            "x": variables, "p": ca.vertcat(first, time, before, penalty), "f": cost, "g": ca.veccat(*constraints)},
            {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "max_iter": ITERATIONS, "tol": 1e-9}})
        self._parts = ca.Function("parts", [variables], [x[:, steps - 1::steps], x, w, share, slack])
