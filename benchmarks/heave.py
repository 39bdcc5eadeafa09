"""A stiff compensator of eight states: the diagram heave.yaml against its equations written for CasADi by hand."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path

import casadi as ca
import numpy as np
from numpy.typing import NDArray

import heavebond as hb
from benchmarks.floor import Floor, NoFloor
from benchmarks.measuring import SETTLE, Figure, at_most, duration, paired, spoken
from heavebond.numerics.idas import integrator_options
from heavebond.numerics.machine_code import compiler, with_compiled_equations
from heavebond.numerics.simulator import Tolerances

Array = NDArray[np.float64]
DIAGRAM = Path(__file__).parent / "heave.yaml"
TOLERANCES = Tolerances(1e-6, 1e-8)
UNTIL, POINTS = 60.0, 6000
STATES = ("crown.x", "crown.v", "bit.x", "bit.v", "chamber_a.p", "chamber_b.p", "valve.x", "valve.w")
START = (0.0, 0.0, 0.0, 0.0, 572.5e5, 572.5e5, 0.0, 0.0)
# the gain of the position loop in 1/m: a calm run, and one in a limit cycle, which takes four times the steps
GAINS = {"calm": 1.0, "limit cycle": 3.0}
# Tolerances, times those of the others, at which the Rosenbrock method is as accurate as the program in C, or more so
ALIKE = {"calm": 4.0, "limit cycle": 2.0}


def rates(t: ca.SX, x: ca.SX, p: ca.SX) -> ca.SX:
    """x' (8,) of the STATES; p are K_p, K_v, F_c, F_s, sigma_2, beta, c, d, f_n, zeta; all in SI."""
    x_c, v_c, x_b, v_b, p_a, p_b, y, w = ca.vertsplit(x)
    gain, damping, f_c, f_s, sigma_2, beta, c, d, f_n, zeta = ca.vertsplit(p)
    area, volume, supply, tank, frequency = 0.0174, 0.067, 745e5, 400e5, 2 * math.pi / 12
    z, dz = 0.5 * ca.sin(frequency * t), 0.5 * frequency * ca.cos(frequency * t)
    s, v = x_c - z, v_c - dz
    sign = ca.tanh(v / 1e-3)
    friction = (f_c + (f_s * ca.fabs(sign) - f_c) * ca.exp(-((v / 0.1) ** 2))) * sign + sigma_2 * v
    string = 4e6 * (x_c - x_b) + 1e5 * (v_c - v_b)
    ground = 229.6e3 * x_b + 2e4 * v_b
    rated = 2 * 460 / 60000 / math.sqrt(35e5) * y
    q_a = rated * ca.if_else(y >= 0, _orifice(supply - p_a), _orifice(p_a - tank))
    q_b = -rated * ca.if_else(y >= 0, _orifice(p_b - tank), _orifice(supply - p_b))
    u = ca.fmin(ca.fmax(-gain * x_c - damping * dz, -1), 1)
    w_n = 2 * math.pi * f_n
    return ca.vertcat(
        v_c, (area * (p_a - p_b) - friction - c * s - d * v - string) / 80e3, v_b, (string - ground) / 83e3,
        beta / (volume + area * s) * (q_a - area * v), beta / (volume - area * s) * (q_b + area * v),
        w, w_n * w_n * (u - y) - 2 * zeta * w_n * w)


def _orifice(dp: ca.SX) -> ca.SX:
    return dp / ca.sqrt(ca.sqrt(dp * dp + 1e4 * 1e4))


class Heave:
    """Both sides at one gain, ready to run."""

    def __init__(self, gain: float, until: float = UNTIL, points: int = POINTS):
        self.parameters = [gain, 0.55, 12e3, 22.8e3, 10e3, 1e9, 42e3, 52e3, 0.75, 0.8]
        self.until, self.points = until, points
        self.equations = t, x, p = ca.SX.sym("t"), ca.SX.sym("x", len(STATES)), ca.SX.sym("p", len(self.parameters))
        times = (np.arange(1, points + 1) * (until / points)).tolist()
        self.flat = ca.integrator("flat", "idas", {"x": x, "t": t, "p": p, "ode": rates(t, x, p)}, 0, times,
                                  {"reltol": TOLERANCES.rtol, "abstol": TOLERANCES.atol, "max_num_steps": 10**6})
        assembly = hb.assemble(hb.load(DIAGRAM)).with_parameters({"K_p": gain})
        self.simulator, self.assembly = self.simulated(assembly), assembly
        made = self.simulator.integrand
        # compiled, as that of the simulator is after some runs
        self.same = (with_compiled_equations if compiler() else lambda make: make({}))(lambda more: ca.integrator(
            "same", "idas", made.dae, 0, times, {**integrator_options(made.dae, TOLERANCES, made.smallest_pivot), **more}))
        first = self.simulator.run()
        self.x0 = first.x[:, 0] / assembly.x_nominal
        self.p = made.hoist(first.p, np.zeros((len(first.p), 0)))

    def simulated(self, assembly: hb.Assembly, solver: str = "idas", tolerances: Tolerances = TOLERANCES) -> hb.Simulator:
        """A simulator of the diagram by a solver."""
        return hb.Simulator(assembly, self.until, every=self.until / self.points, tolerances=tolerances, solver=solver)

    def by_hand(self) -> Array:
        """The states (8, points) of the flat equations."""
        return np.asarray(self.flat(x0=START, p=self.parameters)["xf"].full())

    def called(self) -> ca.DM:
        """The scaled states (8, points) from the integrator that heavebond made, called as CasADi calls it."""
        return self.same(x0=self.x0, p=self.p)["xf"]

    def as_array(self) -> Array:
        """These made into an array."""
        return np.asarray(self.called().full())

    def integrated(self, simulator: hb.Simulator | None = None) -> Array:
        """The scaled states (8, points) from the integrator that heavebond made, called by itself."""
        return np.asarray((simulator or self.simulator).integrator(x0=self.x0, p=self.p)["xf"])

    def disagreement(self, others: Array | None = None) -> float:
        """The largest difference of a state between the diagram and the flat equations, or others' states (8, points), as a
        share of the state's largest value."""
        result, flat = self.simulator.run(), self.by_hand() if others is None else others
        return max(float(np.abs(result.display[name][1:] - row).max() / np.abs(row).max())
                   for name, row in zip(STATES, flat, strict=True))

    def error(self, found: Array) -> float:
        """The largest error (rms over the points) of the scaled states (8, points), as a share of the state's largest value,
        by a run at the smallest tolerances."""
        exact = self.integrated(self.simulated(self.assembly, tolerances=Tolerances(1e-12, 1e-13)))
        return float((np.sqrt(np.mean((found - exact) ** 2, axis=1)) / np.abs(exact).max(axis=1)).max())

    def scaled(self, flat: Array) -> Array:
        """The scaled states (8, points) of the diagram, of those of the flat equations."""
        rows = [flat[STATES.index(name)] for name in self.assembly.state_names]
        return np.asarray(np.array(rows) / self.assembly.x_nominal[:, None])

    def floor(self) -> Callable[[], Array]:
        """The same equations by a program in C; NoFloor where it cannot be built."""
        made = Floor(*self.equations, rates(*self.equations))
        start, p = np.array(START), np.array(self.parameters)
        return lambda: made.run(start, p, self.until, self.points, TOLERANCES.rtol, TOLERANCES.atol)


def floor_figures(name: str, heave: Heave) -> list[Figure]:
    """The integrations that are offered against the program in C."""
    targets = {"idas": 1.15, "cvodes": None, "rosenbrock": 0.8}
    lines = {solver: f"heave, {name}: {solver}, compiled / C program on SUNDIALS" for solver in targets}
    try:
        floor = heave.floor()
    except NoFloor as reason:
        return [Figure(line, f"left out: {reason}", f"≤ {targets[solver]:g}" if targets[solver] else "")
                for solver, line in lines.items()]
    assert heave.disagreement(floor()) < 1e-3
    found = []
    for solver, line in lines.items():
        simulator = heave.simulated(heave.assembly, solver)
        assert np.abs(heave.integrated(simulator) - heave.integrated()).max() < 1e-3
        measured = paired(partial(heave.integrated, simulator), floor, 7, SETTLE)
        limit = targets[solver]
        found.append(at_most(line, measured, limit) if limit else Figure(line, spoken(measured)))
    simulator = heave.simulated(heave.assembly, "rosenbrock", TOLERANCES.scaled(ALIKE[name]))
    assert heave.error(heave.integrated(simulator)) <= heave.error(heave.scaled(floor()))
    found.append(at_most(f"{lines['rosenbrock']}, at equal errors",
                         paired(partial(heave.integrated, simulator), floor, 7, SETTLE), 0.5))
    return found


def figures() -> list[Figure]:
    """The integration against the flat model's, and what `Simulator.run` adds to it."""
    found = []
    for name, gain in GAINS.items():
        heave = Heave(gain)
        assert heave.disagreement() < 1e-3
        found.append(at_most(f"heave, {name}: integration / hand-written CasADi",
                             paired(heave.integrated, heave.by_hand, 7, SETTLE), 1.05))
        for what, theirs, limit in (("", heave.as_array, 1.05), (", its states left with CasADi", heave.called, None)):
            added = paired(heave.simulator.run, theirs, 9, SETTLE)
            found.append(Figure(f"heave, {name}: what `Simulator.run` adds to the integrator{what}",
                                f"{100 * (added.ratio - 1):.1f} % ({duration(added.ours - added.theirs)})",
                                "≤ 5 %" if limit else "", added.ratio <= limit if limit else None))
        found += floor_figures(name, heave)
    return found
