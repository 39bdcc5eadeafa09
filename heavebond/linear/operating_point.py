"""Operating points for linearisation: the start, a steady state, or the state of a run at a given time."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

from heavebond.core.errors import HeavebondError, Problem, StartError, UsageError, listing, suggest
from heavebond.core.units import read_unit
from heavebond.equations.flatten import Flat, flatten
from heavebond.equations.reduce import reduce_flattened
from heavebond.language.model import Model
from heavebond.language.sections import Initial
from heavebond.language.symbols import stack
from heavebond.linear.disturbance import disturbed, quiet
from heavebond.linear.held_variables import StartEvents
from heavebond.linear.linearisation import Linearisation, start_point
from heavebond.numerics.dae import DELAY_ROWS, Array, Assembly, at_zero, build, measured_rows, other_states
from heavebond.numerics.initialise import start
from heavebond.numerics.output_times import Time, begin_of, grid, seconds
from heavebond.numerics.result import columns
from heavebond.numerics.simulation import filled, fills_told, run_by_auto, unfilled
from heavebond.numerics.simulator import Simulator
from heavebond.numerics.start_equations import Point, StartEquations

MOST_STEPS = 20
EVENT_ROUNDING = 1e-12  # share by which a held variable is set to the value that it has
STEADY = "steady"
SPEEDS = tuple(read_unit(text).dimension for text in ("m/s", "rad/s"))


class OperatingPoints:
    """The machine with its disturbances, assembled once, and its operating points for given parameters.

    If a node without capacity prevents a start, or ends the run to the time, it is filled as in a run by `auto` (see
    `heavebond.numerics.simulation`), and `filled` describes it. This is determined without disturbances; their diagram is
    then made from the filled one.
    """

    filled: str = ""

    def __init__(self, model: Model, at: Time | None = None, *, disturbances: Sequence[str] = (), also: Iterable[str] = (),
                 approximate: bool = True):
        """`at`: None for the start of the diagram, `"steady"`, or a time; `also` names positions that are wanted. Without
        `approximate` delayed variables are constant near the point, as parameters `history.NAME`."""
        if isinstance(at, str) and at != STEADY and (near := suggest(at, [STEADY])):
            raise UsageError([Problem("not-a-quantity", f"at: '{at}' is neither a time nor `{STEADY}`", None, near)])
        self.steady, self._disturbances, self._also = at == STEADY, disturbances, tuple(also)
        self.begin = begin_of(model)
        self.time = self.begin if at is None or self.steady else seconds(at, "--at")
        model = replace(model, ends=None, approximate=approximate or model.approximate)
        self._assemble(_steady(model) if self.steady else model)
        if not disturbances:
            self._fill()
        approximated = self.assembly.flat.expanded.approximated
        parts = listing([f"{path} ({kind}) as a {replacement}" for path, kind, replacement in approximated], 4)
        note = f"States, poles, zeros and steps have an approximation without history: {parts}. Frequency responses and " \
            "margins are exact." if approximated else ""
        self.filled = " ".join(filter(None, (self.filled, note)))

    def _assemble(self, model: Model) -> None:
        def flattened(corners: Mapping[int, int]) -> Flat:
            return disturbed(flatten(model, self._also, corners=corners), self._disturbances)

        self.assembly = at_zero(build(reduce_flattened(flattened)), (), flattened)
        end = self.time if self.time != self.begin else \
            float(grid(model, None, None)[-1]) if model.until is not None else self.begin + 1.0
        self.driven = quiet(self.assembly.flat, len(self._disturbances), self.begin, end)
        self.equations = StartEquations(self.assembly)
        self._events = StartEvents(self.assembly)
        self._simulator = Simulator(self.assembly, times=np.array([self.begin, self.time]), driven=self.driven) \
            if self.time != self.begin else None

    def _fill(self) -> None:
        """Fill nodes if there is no operating point without it; other errors are raised by `at`, because they may be absent
        with other parameters."""
        before = self.assembly.model
        try:
            if self._simulator is None:
                self.at()
            elif isinstance(fills := run_by_auto(self._simulator).statistics.get("fills"), dict):
                self._assemble(filled(self.assembly, unfilled(self.assembly)).model)
                self.filled = f"Linearised {fills_told(fills['nodes'], fills['why'])}"
        except StartError as error:
            if nodes := unfilled(self.assembly):
                try:
                    self._assemble(filled(self.assembly, nodes).model)
                    self.at()
                except HeavebondError:
                    self._assemble(before)
                else:
                    self.filled = f"Linearised {fills_told(list(nodes), error.problems[0].message)}"
        except HeavebondError:
            return

    @property
    def words(self) -> str:
        """`at the start`, `steady`, `at 12 s`."""
        return "in its steady state" if self.steady else f"at {self.time:g} s" if self.time != self.begin else "at its start"

    def at(self, parameters: Mapping[str, float | str] | None = None) -> Point:
        """The point with these parameters set; StartError or SimulationError if there is none, UsageError
        where other states are integrated at that time."""
        if self._simulator is not None:
            result = run_by_auto(self._simulator, parameters)
            if result.assembly.flat is not self.assembly.flat:  # nodes that need filling with these parameters only
                result = self._simulator.run(parameters)
            if any(len(result.time) - 1 in at for at, _ in result.stays):
                raise UsageError([Problem("other-states", f"at {self.time:g} s this diagram is integrated in other states "
                                          "than at its start, which is not linearised", None,
                                          "Take a time before that event.")])
            t, x, z, p, u, _ = (values[:, -1] for values in columns(result))
            return self._with_constant_delays(Point(float(t[0]), x, z, p, u, 1.0))
        assembly = self.assembly.with_parameters(parameters) if parameters else self.assembly
        if self.assembly.flat.zeros and assembly.flat is not self.assembly.flat:
            raise other_states(self.assembly)
        u = self.driven.at(np.array([self.begin]))[:, 0] if self.driven.columns.size else np.zeros(0)
        delayed = np.zeros(DELAY_ROWS * len(assembly.flat.delays))
        if not self.steady:
            u = np.append(u, delayed)
            return self._events.after(start_point(start(assembly, self.begin, u, self.equations), u))
        # the inputs at their value, without derivatives
        if len(u):
            value = np.zeros((len(u) // 4, 4))
            value[:, 0] = u[1:].reshape(-1, 4)[:, 0]
            u = np.concatenate([u[:1], value.ravel()])
        # the steady state after the events at its instant; without these if they do not come to rest
        u = np.append(u, delayed)
        first = point = _still(assembly, self.equations, start_point(start(assembly, self.begin, u, self.equations), u))
        held = [h.index for h in assembly.flat.held]
        updates = assembly.once("linearisation", lambda: Linearisation(assembly)).updates(first) if held else None
        if updates is not None and (equilibrium := updates.at_rest(first, self.equations.bounds)) is not None:
            other_held = [index for index in held if index not in updates.indices]
            if np.allclose(self._events.after(equilibrium).p[other_held], equilibrium.p[other_held], EVENT_ROUNDING, 0.0):
                return equilibrium
        for _ in range(MOST_STEPS if held else 0):
            after = self._events.after(point)
            if np.allclose(after.p[held], point.p[held], EVENT_ROUNDING, 0.0):
                return point
            p = assembly.p.copy()
            p[held] = after.p[held]
            point = _still(assembly, self.equations,
                           start_point(start(replace(assembly, p=p), self.begin, u, self.equations), u))
        return first

    def changed(self, point: Point, parameters: Mapping[str, float | str]) -> Point:
        """The point with other parameters at the same states and held variables, with its algebraic unknowns solved again;
        the point of the diagram with these parameters if they have no solution near the former one."""
        assembly = self.assembly.with_parameters(parameters)
        if self.assembly.flat.zeros and assembly.flat is not self.assembly.flat:
            raise other_states(self.assembly)
        differing = assembly.p != self.assembly.p
        moved_point = _solved(assembly, self.equations, replace(point, p=np.where(differing, assembly.p, point.p)))
        change = np.abs(_solved(assembly, self.equations, moved_point, 1).z - moved_point.z)
        return moved_point if (change <= 1e-9 * (np.abs(moved_point.z) + assembly.z_nominal)).all() else self.at(parameters)

    def _with_constant_delays(self, point: Point) -> Point:
        """A point of a run with its inputs expanded about its time, and delayed variables as they are there."""
        flat, rows = self.assembly.flat, measured_rows(self.assembly.flat)
        u, p = _begun_at(point.u[:rows], point.t), point.p
        if flat.delays:
            value = self.assembly.once("delayed values", lambda: ca.Function("delayed", list(self.assembly.arguments), [
                self.assembly.express(stack(d.symbols[0] for d in flat.delays))]))
            p = p.copy()
            p[[d.index for d in flat.delays]] = np.array(value(*point.values())).ravel()
        return replace(point, p=p, u=np.append(u, np.zeros(len(point.u) - rows)))


def stuck(assembly: Assembly, point: Point) -> list[str]:
    """A sentence for each friction that is linearised in its transition around rest, and what to type for one that slides.

    A smoothed friction F(v) of width v_t has the slope F/v_t at rest, as a damper far stiffer than any in the machine. A
    component is listed if it may be an effect, has amplitudes other than zero, and has a width in the unit of one of its
    variables, which is below this width in magnitude.
    """
    flat = assembly.flat
    values = np.array(assembly.values(*point.values())).ravel()
    number = dict(zip(assembly.parameter_names, point.p, strict=True))
    lines = []
    for path, leaf in flat.expanded.leaves.items():
        component = leaf.component
        widths = [(f"{path}.{q.name}", q.unit.dimension) for q in component.parameters.values()
                  if q.width and q.unit.dimension in SPEEDS]
        speeds = {flat.unknowns[j].unit.dimension: values[j] for name in component.unknowns
                  if (j := flat.names.get(f"{path}.{name}")) is not None}
        forces = [f"{path}.{name}" for name in (component.effect.amplitude if component.effect else ())
                  if number.get(f"{path}.{name}", 1.0)]
        slow = [name for name, unit in widths if unit in speeds and name in flat.constants
                and abs(speeds[unit]) < float(ca.Function("w", [flat.p], [flat.constants[name]])(point.p))]
        if slow and forces:
            units = (component.parameters[name.rpartition(".")[2]].unit.text for name in forces)
            put = " ".join(f"--set {name}='0 {unit}'" for name, unit in zip(forces, units, strict=True))
            lines.append(f"{path} is stuck there (slower than its {slow[0].rpartition('.')[2]}) and linearised as a damper "
                         f"that holds all. For the machine that slides: {put}, or a moment of motion by --at.")
    return lines


def _steady(model: Model) -> Model:
    """The diagram started in its steady state: conditions of another start become guesses, unless parameters are solved for
    them."""
    initial = model.initial
    if initial.mode == STEADY or initial.solve:
        return replace(model, initial=replace(initial, mode=STEADY))
    guesses = {name: replace(condition, guess=True) for name, condition in initial.conditions.items()}
    return replace(model, initial=Initial(STEADY, guesses, {}))


def _begun_at(u: Array, t: float) -> Array:
    """The pieces (1 + 4 n,) that hold at t, expanded about t: c'_j = sum_k binomial(k, j) s**(k - j) c_k."""
    if not len(u):
        return u
    s, old = t - u[0], u[1:].reshape(-1, 4)
    new = np.column_stack([sum(math.comb(k, j) * s ** (k - j) * old[:, k] for k in range(j, 4)) for j in range(4)])
    return np.concatenate([[t], new.ravel()])


def _still(assembly: Assembly, equations: StartEquations, point: Point) -> Point:
    """The point with the time rate 0."""
    return _solved(assembly, equations, replace(point, rate=0.0))


def _solved(assembly: Assembly, equations: StartEquations, point: Point, steps: int = MOST_STEPS) -> Point:
    """The point with its algebraic unknowns solved again by Newton's method."""
    for _ in range(steps if len(point.z) else 0):
        residual, jacobian = equations.algebraic.at(point)
        step = np.linalg.lstsq(jacobian, residual, rcond=None)[0]
        point = replace(point, z=point.z - step)
        if np.all(np.abs(step) <= 1e-12 * (np.abs(point.z) + assembly.z_nominal)):
            break
    return point
