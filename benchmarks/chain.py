"""N masses behind cubic springs: a diagram of 3 N components against scalar CasADi expressions written by hand."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path

import casadi as ca
import numpy as np
from numpy.typing import NDArray

import heavebond as hb
from benchmarks.measuring import PAIRS, Figure, at_most, duration, paired, process, seconds
from heavebond.numerics.dae import Assembly
from heavebond.numerics.simulator import Tolerances

Array = NDArray[np.float64]
DIAGRAM = Path(__file__).parent / "chain.yaml"
TOLERANCES = Tolerances(1e-6, 1e-8)
COMPARED = 1000  # masses in the comparison with the model by hand
SIZES = (10, 100, 1000, 5000)
GROWTH = 1.15
MEMORY = 1000
# s from an acausal diagram of 10 masses to the end of its first run; measured on such a machine, not run here
JAXONOMY = 22.0


def assembled(masses: int) -> Assembly:
    """From the file to the assembly."""
    return hb.assemble(hb.load(DIAGRAM).with_parameters({"n": masses}))


def ours(masses: int) -> Array:
    """Position of the last mass after 0.1, 0.2 ... 10 s: read, assembled, integrated."""
    return hb.Simulator(assembled(masses), tolerances=TOLERANCES).run().si["end.x"][1:]


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


def peak(masses: int) -> float:
    """The largest memory in MB of a process that reads, assembles and integrates a chain, and does nothing else."""
    said = process("-c", "import resource, sys; from benchmarks.chain import ours; ours(int(sys.argv[1])); "
                   "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)", str(masses))
    return float(said) / 1024


def figures() -> list[Figure]:
    """The whole way against that by hand, how its time grows, and what memory it needs."""
    assert disagreement(100) < 1e-3
    found = [at_most(f"chain({COMPARED}): read, assemble, integrate / build and integrate by hand",
                     paired(partial(ours, COMPARED), partial(by_hand, COMPARED)), 8)]
    times = [float(np.median([seconds(partial(ours, masses)) for _ in range(PAIRS)])) for masses in SIZES]
    found.append(Figure("chain(N): read, assemble, integrate, N = " + ", ".join(map(str, SIZES)),
                        ", ".join(map(duration, times))))
    for begin in (SIZES[0], SIZES[1]):
        k = SIZES.index(begin)
        growth = float(np.polyfit(np.log(SIZES[k:]), np.log(times[k:]), 1)[0])
        found.append(Figure(f"chain(N): growth from N = {begin}", f"N^{growth:.2f}", f"≤ N^{GROWTH:g}", growth <= GROWTH))
    found.append(Figure(f"chain({SIZES[0]}): read, assemble, integrate, of the {JAXONOMY:g} s of jaxonomy",
                        f"1/{JAXONOMY / times[0]:.0f}", "≤ 1/100", times[0] <= JAXONOMY / 100))
    memory = peak(SIZES[-1])
    found.append(Figure(f"chain({SIZES[-1]}): largest memory of the process", f"{memory:.0f} MB", f"≤ {MEMORY} MB",
                        memory <= MEMORY))
    return found
