"""N masses behind cubic springs: a diagram of 3 N components against scalar CasADi expressions written by hand."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path

import casadi as ca
import numpy as np
from numpy.typing import NDArray

import heavebond as hb
from benchmarks.measuring import PAIRS, Figure, at_most, duration, paired, seconds
from heavebond.dae import Assembly
from heavebond.simulation import Tolerances

Array = NDArray[np.float64]
DIAGRAM = Path(__file__).parent / "chain.yaml"
TOLERANCES = Tolerances(1e-6, 1e-8)
COMPARED = 1000  # masses in the comparison with the model by hand
SIZES = (10, 100, 1000, 5000)
ONCE = 1000  # a larger chain is assembled once


def assembled(masses: int) -> Assembly:
    """From the file to the assembly."""
    return hb.assemble(hb.load(DIAGRAM).with_parameters({"n": masses}))


def ours(masses: int) -> Array:
    """Position of the last mass after 0.1, 0.2 ... 10 s: read, assembled, integrated."""
    return hb.Simulator(assembled(masses), tolerances=TOLERANCES).run()["end.x"][1:]


def by_hand(masses: int) -> Array:
    """The same from equations that are written for CasADi, built and integrated."""
    t = ca.SX.sym("t")
    x = [ca.SX.sym(f"x_{i}") for i in range(masses)]
    v = [ca.SX.sym(f"v_{i}") for i in range(masses)]
    forces = []
    for i in range(masses):
        s, rate = (x[i] - x[i - 1], v[i] - v[i - 1]) if i else (x[0], v[0])
        forces.append(1e3 * s + 1e5 * s**3 + 10 * rate)
    forces.append(50 * ca.sin(math.pi * t))
    states = [q for i in range(masses) for q in (x[i], v[i])]
    rates = [q for i in range(masses) for q in (v[i], forces[i + 1] - forces[i])]
    run = ca.integrator("chain", "idas", {"x": ca.vertcat(*states), "t": t, "ode": ca.vertcat(*rates)}, 0,
                        (np.arange(1, 101) / 10).tolist(),
                        {"reltol": TOLERANCES.rtol, "abstol": TOLERANCES.atol, "max_num_steps": 10**6,
                         "linear_solver": "csparse" if masses >= 50 else "qr"})
    return np.asarray(run(x0=0)["xf"].full()[-2])


def disagreement(masses: int) -> float:
    """The largest difference of the last mass's position, as a share of its largest position."""
    flat = by_hand(masses)
    return float(np.abs(ours(masses) - flat).max() / np.abs(flat).max())


def figures() -> list[Figure]:
    """The whole way against that by hand, and how the time of the assembly grows."""
    assert disagreement(100) < 1e-3
    found = [at_most(f"chain({COMPARED}): read, assemble, integrate / build and integrate by hand",
                     paired(partial(ours, COMPARED), partial(by_hand, COMPARED)), 8)]
    times = [float(np.median([seconds(partial(assembled, masses)) for _ in range(PAIRS if masses <= ONCE else 1)]))
             for masses in SIZES]
    found.append(Figure("chain(N): assembly, N = " + ", ".join(map(str, SIZES)), ", ".join(map(duration, times))))
    growth = float(np.polyfit(np.log(SIZES[1:]), np.log(times[1:]), 1)[0])
    found.append(Figure(f"chain(N): growth of the assembly from N = {SIZES[1]}", f"N^{growth:.2f}", "≤ N^1.2",
                        growth <= 1.2))
    return found
