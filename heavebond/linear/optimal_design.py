"""Optimal design of controllers on the linearised diagram: state feedback, LQG and model predictive control.

The machine without its controller block is linearised with the commands, the disturbances, the measured values and the
weighed values, and the matrices of the block follow from Riccati equations. Weights are the deviations that count as 1
(Bryson's rule). A sampled block is designed for the exactly discretised machine, including its delays.

K. J. Astrom, R. M. Murray, Feedback Systems, 2nd ed., Princeton 2021, chapters 7 and 8 (state feedback, observers); J. B.
Rawlings, D. Q. Mayne, M. Diehl, Model Predictive Control, 2nd ed., Nob Hill 2017, chapter 1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from heavebond.core.errors import Problem, UsageError, listing
from heavebond.core.presentation import brief, count
from heavebond.core.quantities import si_value
from heavebond.language.model import Model, ModelOrFile, loaded
from heavebond.linear.design import loop_at, wrong_block
from heavebond.linear.linear_system import LINEAR_SYSTEM, Complex, StateSpaces
from heavebond.linear.margins import Crossings
from heavebond.numerics.dae import Array
from heavebond.numerics.output_times import Time

HORIZON = 30  # most commands in the horizon of a predictive controller, whose work grows with the third power
LIMITS = {"y_min": -1e9, "y_max": 1e9, "rate": 1e9, "u_min": -1e9, "u_max": 1e9}  # of a predictive controller: not active
BLOCKS = {"K": "a MatrixGain", "C": "a LinearSystem or a DiscreteStateSpace", "F": "a PredictiveController"}


@dataclass(frozen=True)
class OptimalConstants:
    """The constants of an optimal design.

    soft: softness of a limit of a measured value, relative to the largest response of this value to a correction of 1. The
        value exceeds its limit by the square of `soft`, as a share of the correction that the limit requires. Origin: four
        digits of the correction. Doubled: 4 times the excess.
    decay: rate of a pole of the regulator, as a share of the largest pole, from which it counts as decaying. Origin:
        rounding of eigenvalues. Doubled: nothing.
    """

    soft: float = 1e-2
    decay: float = 1e-7


OPTIMAL = OptimalConstants()


@dataclass(frozen=True)
class ObserverController:
    """A state feedback with an observer as one block: x~' = a x~ + b y, u = c x~, or with a sampling `period` in s
    x~[k+1] = a x~[k] + b y[k], u[k] = c x~[k]. `gain` (m, n) is the state feedback u = -gain x~, `observer` (n, k) the
    gain of the observer; `poles` are the eigenvalues of the regulator and of the observer, in 1/s or z. `least` (n, n) is
    the matrix P of the least cost x' P x of the regulator. `points` are the crossings of the loops through the outputs of
    the block, by operating point and, if there are several, output."""

    states: tuple[str, ...]
    a: Array
    b: Array
    c: Array
    gain: Array
    observer: Array
    poles: tuple[Complex, Complex]
    least: Array
    period: float | None = None
    points: Mapping[str, Crossings] = field(default_factory=dict)

    def __repr__(self) -> str:
        return brief(self, f"{len(self.a)} states", f"regulator {np.round(self.poles[0], 4)}")


def lqg(plant: Sequence[Array], weights: Sequence[Array], noise: Sequence[Array], *, period: float | None = None,
        states: Sequence[str] = ()) -> ObserverController:
    """Linear quadratic regulator with a Kalman filter for the plant x' = A x + B u, y = C x + D u.

    `plant` is (A, B, C) or (A, B, C, D), `weights` (Q, R) or (Q, R, N) are the weights of x' Q x + u' R u + 2 x' N u,
    `noise` (W, V) or (W, V, S) the intensities of the process noise in x' and of the noise of y, and their cross intensity
    (n, k), `states` the names of x. With a `period` in s the plant is x[k+1] = A x[k] + B u[k], y[k] = C x[k] + D u[k], and
    the matrices are for a sample. The filter predicts: u[k] is a function of y up to k - 1. Raises UsageError if a Riccati
    equation has no stabilising solution.
    """
    from scipy.linalg import solve_continuous_are, solve_discrete_are

    a, b, c, *direct = (np.atleast_2d(np.asarray(m, float)) for m in plant)
    (q, r, *cross), (w, v, *common) = ([np.atleast_2d(np.asarray(m, float)) for m in group] for group in (weights, noise))
    d = direct[0] if direct else np.zeros((len(c), b.shape[1]))
    cross_weight = cross[0] if cross else np.zeros(b.shape)
    cross_noise = common[0] if common else np.zeros(c.T.shape)
    try:
        if period is None:
            least = solve_continuous_are(a, b, q, r, s=cross_weight)
            gain = np.linalg.solve(r, b.T @ least + cross_weight.T)
            observer = np.linalg.solve(v, c @ solve_continuous_are(a.T, c.T, w, v, s=cross_noise) + cross_noise.T).T
        else:
            least, p = solve_discrete_are(a, b, q, r, s=cross_weight), solve_discrete_are(a.T, c.T, w, v, s=cross_noise)
            gain = np.linalg.solve(r + b.T @ least @ b, b.T @ least @ a + cross_weight.T)
            observer = np.linalg.solve(v + c @ p @ c.T, c @ p @ a.T + cross_noise.T).T
    except (np.linalg.LinAlgError, ValueError) as error:
        raise UsageError([Problem(
            "design-riccati", f"a Riccati equation has no stabilising solution ({error})", None, "Every state that "
            "does not decay must be controllable by the inputs and observable by the outputs. Weights of inputs and "
            "noise of outputs must be above 0.")
        ]) from None
    poles = (np.linalg.eigvals(a - b @ gain).astype(complex), np.linalg.eigvals(a - observer @ c).astype(complex))
    return ObserverController(tuple(states), a - b @ gain - observer @ (c - d @ gain), observer, -gain, gain, observer,
                              poles, least, period)


def design_lqg(model: ModelOrFile, block: str, weigh: Mapping[str, float | str], effort: Sequence[float],
               disturbances: Mapping[str, float | str], noise: Sequence[float], *, at: Time | None = None,
               points: Mapping[str, Mapping[str, float | str]] | None = None) -> ObserverController:
    """An LQG controller for a block of a diagram, from the linearised machine without that block.

    The `block` is a `LinearSystem` or a `DiscreteStateSpace`; `at` is the operating point of `state_space`.
    `weigh` are signals or formulas, each with the deviation that counts as 1 (Bryson's rule); `effort` are these deviations
    for the outputs of the block. `disturbances` are signals or forces with added white noise, each with the root of its
    spectral density for 1 Hz; `noise` are these roots for the inputs of the block. Plain numbers are in SI; a text has the
    unit of its signal. A sampled
    plant is discretised exactly with its delays. The margins of the loops through the outputs of the block are computed at
    the operating point and at further `points`, which are values of parameters by name. Raises UsageError for units of
    another dimension, and for numbers that are not above 0.
    """
    diagram = loaded(model)
    result, _ = _regulated(diagram, block, ("C", "D"), weigh, effort, disturbances, noise, at)
    values = _block_values(diagram, block, {"n": len(result.a)}, {"A": result.a, "B": result.b, "C": result.c}, {})
    outputs = [f"{block}.y[{k + 1}]" for k in range(len(result.c))]
    return replace(result, points=_loops_of_outputs(diagram, values, outputs, at, points))


@dataclass(frozen=True)
class StateFeedback:
    """An optimal state feedback u = `matrix` y (m, n) of n measured values that determine the `states`; `poles` (n,) of the
    closed loop in 1/s, `points` as in `ObserverController`."""

    states: tuple[str, ...]
    matrix: Array
    poles: Complex
    points: Mapping[str, Crossings]

    def __repr__(self) -> str:
        return brief(self, f"{len(self.states)} states", f"poles {np.round(self.poles, 4)}")


def design_lqr(model: ModelOrFile, block: str, weigh: Mapping[str, float | str], effort: Sequence[float], *,
               at: Time | None = None, points: Mapping[str, Mapping[str, float | str]] | None = None) -> StateFeedback:
    """A linear quadratic regulator for a `MatrixGain` of a diagram, which measures as many values as the machine has states.

    The `block` minimises the weighted squares of `weigh` and `effort` (see `design_lqg`) of the linearised machine at the
    operating point `at`; `points` as there. Raises UsageError if the inputs do not determine the states, and for a machine
    with samples.
    """
    diagram = loaded(model)
    plant = _plant(diagram, block, ("K",), weigh, effort, {}, at)
    a, b, c, d = plant.of_block
    if plant.period is not None:
        raise UsageError([Problem("design-sampled", f"the machine around {block} contains samples", None, "Design a "
                                  "DiscreteStateSpace by --lqg, or remove the samples.")])
    # an observer is not needed: its gain is that of one that measures all states
    controller = lqg((a, b, np.eye(len(a))), plant.weights, (np.eye(len(a)), np.eye(len(a))), states=plant.states)
    _check_decaying("regulator", a - b @ controller.gain, plant)
    closed = c - d @ controller.gain  # the measured values by the states
    if len(c) != len(a) or np.linalg.matrix_rank(closed) < len(a):
        raise UsageError([Problem("design-states", f"the {count(len(c), 'input')} of {block} do not determine the "
                                  f"{count(len(a), 'state')} of the machine: {listing(plant.states)}", None,
                                  "Measure each state, or design an observer controller by --lqg.")])
    matrix = np.asarray(-np.linalg.solve(closed.T, controller.gain.T).T, dtype=float)
    outputs = [f"{block}.y[{k + 1}]" for k in range(len(matrix))]
    values = _block_values(diagram, block, {}, {"K": matrix}, {})
    return StateFeedback(plant.states, matrix, controller.poles[0], _loops_of_outputs(diagram, values, outputs, at, points))


@dataclass(frozen=True)
class PredictiveDesign:
    """The matrices of a `PredictiveController` with a `horizon` of N samples for m commands: its Kalman filter x[k+1] = a
    x[k] + b u[k] + observer (y[k] - c x[k]) with k measured values y. `plan` (N (2 m + k), n) are
    the commands of the regulator over the horizon, below them their changes, below them the measured values, by the states;
    `response` (N (2 m + k), N m) is the same by corrections v of the commands. The cost of a plan is the sum of v^2, and of
    (e/s)^2 for an excess e of a measured value over its limit, with the softness s of `soft` (k,). `controller` is the
    controller without limits, `period` the sampling period in s."""

    a: Array
    b: Array
    c: Array
    observer: Array
    plan: Array
    response: Array
    soft: Array
    horizon: int
    period: float
    controller: ObserverController

    def __repr__(self) -> str:
        return brief(self, f"{len(self.a)} states", f"{count(self.horizon, 'sample')} of {self.period:g} s")


def design_mpc(model: ModelOrFile, block: str, weigh: Mapping[str, float | str], effort: Sequence[float],
               disturbances: Mapping[str, float | str], noise: Sequence[float], *, horizon: int = 10, at: Time | None = None,
               points: Mapping[str, Mapping[str, float | str]] | None = None) -> PredictiveDesign:
    """A model predictive controller for a `PredictiveController` of a diagram, from the linearised machine without it.

    The `block` is the name of the `PredictiveController` in the `model` (a diagram or a file). Regulator and Kalman filter
    are designed as by `design_lqg`, with the same arguments `weigh`, `effort`, `disturbances`, `noise`, `at` and `points`
    (the margins are those without an active limit). With the gain K and the Riccati matrix P of the regulator, and
    R + B' P B = L L', the cost of any commands is x' P x + sum |v[k]|^2 with v[k] = L' (u[k] + K x[k]) (Rawlings, Mayne,
    Diehl, Model Predictive Control, 2017, section 1.3). The `horizon` is the number of samples within the limits; after
    the horizon the regulator continues without limits. Limits of measured values are soft (see `OptimalConstants.soft`).
    Without an active limit the commands are those of the regulator. Raises UsageError as `design_lqg`, and for a horizon of
    less than one sample or more than 30 commands.
    """
    diagram = loaded(model)
    controller, plant = _regulated(diagram, block, ("F", "W"), weigh, effort, disturbances, noise, at)
    a, b, c, d = plant.of_block
    outputs, most = b.shape[1], HORIZON // b.shape[1]
    if not 1 <= horizon <= most:
        several = "" if outputs == 1 else f" ({HORIZON} commands of {count(outputs, 'output')})"
        raise UsageError([Problem("design-horizon", f"the horizon has {count(horizon, 'sample')}; 1 to {most} are "
                                  f"possible{several}", None, f"Give for example --horizon {min(10, most)} (in Python "
                                  f"horizon={min(10, most)}).")])
    period = controller.period
    assert period is not None
    shape = np.linalg.inv(np.linalg.cholesky(plant.weight + b.T @ controller.least @ b)).T
    plan, response = _plan(plant.of_block, controller.gain, shape, horizon)
    measured = response[2 * horizon * outputs:].reshape(horizon, len(c), -1)
    soft = OPTIMAL.soft * np.linalg.norm(measured, axis=2).max(axis=0)
    entry = b - controller.observer @ d  # into the estimate of the filter, which reads y - C x
    # without active limits a horizon of one sample is sufficient for the margins
    first, corrected = _plan(plant.of_block, controller.gain, shape, 1)
    values = _block_values(diagram, block, {"n": len(a), "N": 1}, {
        "A": a, "B": entry, "C": c, "L": controller.observer, "F": first, "W": corrected, "S": soft}, LIMITS)
    controller = replace(controller, points=_loops_of_outputs(
        diagram, values, [f"{block}.y[{k + 1}]" for k in range(outputs)], at, points))
    return PredictiveDesign(a, entry, c, controller.observer, plan, response, soft, horizon, period, controller)


def _plan(plant: tuple[Array, Array, Array, Array], gain: Array, shape: Array, horizon: int) -> tuple[Array, Array]:
    """The commands u[k] = -gain x[k] + shape v[k] over a horizon, below them their changes and the measured values, by
    the states x[0] and by the corrections v (see `PredictiveDesign`)."""
    a, b, c, d = plant
    m = b.shape[1]
    # x[k] = x_k x[0] + x_v v, and the same of u[k] and y[k]
    x_k, x_v = np.eye(len(a)), np.zeros((len(a), horizon * m))
    by_state, by_correction = [], []
    for k in range(horizon + 1):
        correction = np.eye(1, horizon, k) if k < horizon else np.zeros((1, horizon))
        u_k, u_v = -gain @ x_k, np.kron(correction, shape) - gain @ x_v
        by_state.append((u_k, c @ x_k + d @ u_k))
        by_correction.append((u_v, c @ x_v + d @ u_v))
        x_k, x_v = a @ x_k + b @ u_k, a @ x_v + b @ u_v
    changes = np.eye(horizon * m) - np.eye(horizon * m, k=-m)

    def stacked(rows: list[tuple[Array, Array]]) -> Array:
        commands = np.vstack([u for u, _ in rows[:-1]])
        return np.vstack([commands, changes @ commands, *(y for _, y in rows[1:])])

    return stacked(by_state), stacked(by_correction)


def _block_values(diagram: Model, block: str, counts: Mapping[str, int], matrices: Mapping[str, Array],
                  limits: Mapping[str, float]) -> dict[str, float | str]:
    """Values of the parameters of a block with other sizes; `limits` are the values of all elements of its lists."""
    values: dict[str, float | str] = {f"{block}.{name}": str(number) for name, number in counts.items()}
    for name, matrix in matrices.items():
        values |= {f"{block}.{name}" + "".join(f"[{k + 1}]" for k in index): float(value)
                   for index, value in np.ndenumerate(matrix)}
    heads = {f"{block}.{name}": limit for name, limit in limits.items()}
    return values | {name: heads[name.partition("[")[0]] for name in StateSpaces(
        diagram, [], []).points.assembly.parameter_names if name.partition("[")[0] in heads}


def _loops_of_outputs(diagram: Model, values: Mapping[str, float | str], outputs: Sequence[str], at: Time | None,
                      points: Mapping[str, Mapping[str, float | str]] | None) -> dict[str, Crossings]:
    """The crossings of the loop through each output of a block with designed `values`, at the operating point of the design
    and at further points; outputs in no loop are left out."""
    by_name: dict[str, Crossings] = {}
    for point, settings in {"design": {}, **(points or {})}.items():
        for output in outputs:
            try:
                by_name[point if len(outputs) == 1 else f"{point}, {output}"] = loop_at(
                    diagram, output, {**values, **settings}, at)
            except UsageError as error:
                if error.problems[0].code != "loop-none":
                    raise
    return by_name


def _feedthrough(diagram: Model, block: str, commands: int, measured: int, at: Time | None) -> tuple[Array, Array]:
    """The direct effects (k, m) of the commands of a sampled block on the measured values that it reads: of the commands of
    the same instant, which reach it through signals, and of the former commands, through the physical network.

    They are read from the update of the block at its sample, with commands that are its states and a state that becomes one
    of the measured values. The limits of a predictive controller are wide.
    """
    predictive = f"{block}.F[1][1]" in StateSpaces(diagram, [], []).points.assembly.parameter_names
    unit, counts = np.eye(commands), {"n": commands, **({"N": 1} if predictive else {})}
    rows: list[tuple[Array, Array]] = []
    for k in range(measured):
        reading = np.zeros((commands, measured))
        reading[0, k] = 1
        zero = np.zeros((commands, commands))
        matrices = {"A": zero, "B": zero, "C": np.zeros((measured, commands)), "L": reading,
                    "F": np.vstack([unit, unit, np.zeros((measured, commands))]),
                    "W": np.zeros((2 * commands + measured, commands)), "S": np.ones(measured)} if predictive else {
            "A": zero, "B": reading, "C": unit, "D": np.zeros((commands, measured))}
        changed = diagram.with_parameters(_block_values(diagram, block, counts, matrices, LIMITS if predictive else {}))
        hybrid = StateSpaces(changed, [f"{block}.y[1]"], [f"{block}.u[1]"], at).at().hybrid
        assert hybrid is not None
        target = hybrid.names.index(f"{block}.x[1]")
        event = hybrid.event[hybrid.target.index(target)]
        instant = next(events for _, events in hybrid.schedule.instants if event in events)
        targets, before, _ = hybrid.updates(instant)
        row = before[targets.index(target)]
        new, old = ([row[hybrid.names.index(name)] if name in hybrid.names else 0.0 for name in (
            f"{block}.{state}[{i + 1}]" for i in range(commands))] for state in ("x", "last"))
        rows.append((np.array(new), np.array(old)))
    return np.array([new for new, _ in rows]), np.array([old for _, old in rows])


@dataclass(frozen=True)
class _Plant:
    """A linearised machine without a block: inputs are the `commands` outputs of the block, and disturbances divided by
    their sizes; outputs are the `measured` inputs of the block, and weighed values divided by their sizes. `weight` (m, m)
    is the weight R of the commands."""

    a: Array
    b: Array
    c: Array
    d: Array
    states: tuple[str, ...]
    commands: int
    measured: int
    weight: Array
    period: float | None

    @property
    def of_block(self) -> tuple[Array, Array, Array, Array]:
        """The matrices from the commands to the measured values."""
        return self.a, self.b[:, :self.commands], self.c[:self.measured], self.d[:self.measured, :self.commands]

    @property
    def weights(self) -> tuple[Array, Array, Array]:
        """The matrices Q, R and N of the regulator."""
        weighed, length = self.c[self.measured:], self.period or 1.0
        return length * weighed.T @ weighed, self.weight, length * weighed.T @ self.d[self.measured:, :self.commands]


def _plant(diagram: Model, block: str, through: tuple[str, ...], weigh: Mapping[str, float | str], effort: Sequence[float],
           disturbances: Mapping[str, float | str], at: Time | None) -> _Plant:
    """The machine without a block, which has no effect if its matrices `through` are 0."""
    plain = StateSpaces(diagram, [], []).points.assembly
    block_outputs, block_inputs = ([n for n in plain.flat.names if n.partition("[")[0] == f"{block}.{port}"]
                                   for port in "yu")
    heads = tuple(f"{block}.{matrix}[" for matrix in through)
    matrices = [n for n in plain.parameter_names if n.startswith(heads)]
    blocks = sorted({n.partition(f".{through[0]}[")[0] for n in plain.parameter_names if f".{through[0]}[" in n})
    if through[0] == "C":
        blocks = [name for name in blocks if f"{name}.F[1][1]" not in plain.parameter_names]
    if not block_outputs or not block_inputs or not matrices or block not in blocks:
        raise wrong_block(block, BLOCKS[through[0]], blocks,
                          f"'{block}' has no matrices with inputs u and outputs y" if through[0] == "C" else "")
    _check_sizes("effort", effort, block_outputs)
    outputs = [*block_inputs, *(f"({text})" for text in weigh)]
    system = StateSpaces(diagram, [*block_outputs, *disturbances], outputs, at).at(dict.fromkeys(matrices, 0.0))
    weigh_sizes = _sizes("weigh", weigh, system.units[2][len(block_inputs):])
    disturbance_sizes = _sizes("disturbance", disturbances, system.units[1][len(block_outputs):])
    machine = [k for k, name in enumerate(system.states) if not name.startswith(f"{block}.")]
    scale = system.sizes[machine]
    m, k = len(block_outputs), len(block_inputs)
    for name, derivatives in zip(outputs, np.abs(system.higher).max(axis=(0, 2)), strict=True):
        if derivatives > 0:
            raise UsageError([Problem("design-derivative", f"{name} depends on the derivative of a command or disturbance, "
                                      "which is unbounded", None, "Put a lag, such as a FirstOrderLag, between the block "
                                      "and the machine, or name another signal.")])
    a, b = system.a[np.ix_(machine, machine)] * scale / scale[:, None], system.b[machine] / scale[:, None]
    c, d = system.c[:, machine] * scale, system.d.copy()
    states = [system.states[j] for j in machine]
    direct = np.abs(d) > LINEAR_SYSTEM.rounding * (np.abs(d) + np.abs(c) @ np.abs(b))
    if system.period is not None and direct[:k, :m].any() and through[0] != "K":
        d[:k, :m], former = _feedthrough(diagram, block, m, k, at)
        for j in np.flatnonzero(former.any(axis=0)).tolist():  # a former command is a state
            a = np.block([[a, np.zeros((len(a), 1))], [np.zeros((1, len(a) + 1))]])
            b = np.vstack([b, np.eye(1, b.shape[1], j)])
            c = np.hstack([c, np.pad(former[:, j:j + 1], ((0, len(c) - k), (0, 0)))])
            states.append(f"the former {block_outputs[j]}")
    b, d = (np.hstack([matrix[:, :m], matrix[:, m:] * disturbance_sizes]) for matrix in (b, d))
    c, d = (np.vstack([matrix[:k], matrix[k:] / weigh_sizes[:, None]]) for matrix in (c, d))
    weight = (system.period or 1.0) * (np.diag(1 / np.asarray(effort) ** 2) + d[k:, :m].T @ d[k:, :m])
    return _Plant(a, b, c, d, tuple(states), m, k, weight, system.period)


def _regulated(diagram: Model, block: str, through: tuple[str, str], weigh: Mapping[str, float | str],
               effort: Sequence[float], disturbances: Mapping[str, float | str], noise: Sequence[float], at: Time | None
               ) -> tuple[ObserverController, _Plant]:
    """The LQG controller for a block, and the plant."""
    plant = _plant(diagram, block, through, weigh, effort, disturbances, at)
    _check_sizes("noise", noise, [f"{block}.u[{k + 1}]" for k in range(plant.measured)])
    a, b, c, _ = plant.of_block
    entry, measured = plant.b[:, plant.commands:], plant.d[:plant.measured, plant.commands:]
    length = plant.period or 1.0
    controller = lqg(plant.of_block, plant.weights, (
        entry @ entry.T / length, (np.diag(np.asarray(noise) ** 2) + measured @ measured.T) / length,
        entry @ measured.T / length), period=plant.period, states=plant.states)
    _check_decaying("regulator", a - b @ controller.gain, plant)
    _check_decaying("observer", (a - controller.observer @ c).T, plant)
    return controller, plant


def _check_sizes(subject: str, sizes: Sequence[float], ports: Sequence[str]) -> None:
    """UsageError if there is not a number above 0 for each port of a block."""
    if len(sizes) != len(ports) or not min(sizes, default=0) > 0:
        raise UsageError([Problem("design-sizes", f"{subject} needs {count(len(ports), 'number')} above 0", None,
                                  f"Give one for each of {listing(ports)}, for example "
                                  f"--{subject} '{', '.join(['1'] * len(ports))}'.")])


def _check_decaying(role: str, matrix: Array, plant: _Plant) -> None:
    """UsageError if the regulator, or the transposed observer, has a pole that does not decay."""
    poles = np.linalg.eigvals(matrix).astype(complex)
    rates = -poles.real if plant.period is None else 1 - np.abs(poles)
    if not rates.min(initial=np.inf) > OPTIMAL.decay * np.abs(poles).max(initial=0.0):
        vector = np.abs(np.linalg.eig(matrix)[1][:, int(np.argmin(rates))])
        slow = [name for name, share in zip(plant.states, vector, strict=True) if share > 0.1 * vector.max()]
        raise UsageError([Problem(
            "design-not-decaying", f"the {role} has a pole that does not decay, with {listing(slow)}", None,
            "Add --weigh for a signal that contains it: the regulator ignores other variables." if role == "regulator" else
            "Add --disturbance for a signal that acts on it: without a disturbance the filter does not correct it.")])


def _sizes(subject: str, values: Mapping[str, float | str], units: Sequence[str]) -> Array:
    """The values of some signals in SI."""
    sizes = [si_value(value, unit, f"{subject} {name}") for (name, value), unit in zip(values.items(), units, strict=True)]
    for (name, value), size in zip(values.items(), sizes, strict=True):
        if not 0 < size < np.inf:
            raise UsageError([Problem("design-sizes", f"{subject} {name}: the size is {value}; it must be above 0", None,
                                      f"Write for example --{subject} {name}='1 UNIT', with the unit of the signal.")])
    return np.array(sizes)
