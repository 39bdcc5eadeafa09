"""Trees of bodies in space: how assembly and the right-hand side grow with the number of bodies, and the robot arm beside
Pinocchio. `python -m benchmarks.spatial` prints the figures; times are processor times of one run of this program.

The exponent between two numbers of bodies is log(time ratio)/log(number ratio). The right-hand side of the arm is compiled
by the C compiler with -O2 and called 2000 times in a loop in C; Pinocchio is called from Python, and an empty call is
subtracted.
"""

from __future__ import annotations

import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

import heavebond as hb
from benchmarks.random_trees import Pinocchio, aligned_tree, diagram, random_tree
from heavebond.numerics.dae import Assembly
from heavebond.numerics.initialise import start

NUMBERS = (12, 25, 50, 100, 200)
CALLS = 2000


def assembled(n: int) -> tuple[float, Assembly]:
    """The processor time (s) of the assembly of a random tree of n bodies, and the assembly."""
    model = hb.loads(diagram(random_tree(n, 3)))
    begin = time.process_time()
    assembly = hb.assemble(model)
    return time.process_time() - begin, assembly


def right_hand_side(assembly: Assembly) -> ca.Function:
    """x' and the residuals of algebraic unknowns as a function of x, at the parameters of the diagram."""
    t, x, z, p, u, rate = assembly.arguments
    values = [ca.DM(0), x, ca.DM.zeros(z.numel()), ca.DM(assembly.p), ca.DM.zeros(u.numel()), 1]
    whole = ca.Function("whole", [t, x, z, p, u, rate], [ca.vertcat(assembly.ode, assembly.alg)])
    rates: Any = whole(*values)
    return ca.Function("rates", [x], [ca.densify(rates)])


def seconds(function: ca.Function, x: np.ndarray, calls: int) -> float:
    """The least processor time (s) of one evaluation in three loops."""
    many, points = function.map(calls), np.tile(x[:, None], calls)
    many(points)
    times = []
    for _ in range(3):
        begin = time.process_time()
        many(points)
        times.append((time.process_time() - begin)/calls)
    return min(times)


def growth() -> None:
    print(f"{'bodies':>7} {'assembly':>10} {'exponent':>9} {'evaluation':>12} {'exponent':>9} "
          f"{'operations':>11} {'algebraic':>10}")
    before: tuple[int, float, float] | None = None
    assembled(4)
    for n in NUMBERS:
        took, assembly = assembled(n)
        rates = right_hand_side(assembly)
        each = seconds(rates, np.asarray(start(assembly).x, float), max(1, 20000 // n))
        exponents = ["", ""] if before is None else [f"{np.log(new/old)/np.log(n/before[0]):.2f}" for new, old in (
            (took, before[1]), (each, before[2]))]
        print(f"{n:>7} {took:>8.2f} s {exponents[0]:>9} {each*1e6:>9.1f} us {exponents[1]:>9} {rates.n_instructions():>11} "
              f"{assembly.reduced.z.numel():>10}",
              flush=True)
        before = (n, took, each)


def arm() -> None:
    """The right-hand side of six hinges beside the articulated-body algorithm of Pinocchio for the same tree."""
    bodies = aligned_tree(6, 1)
    assembly = hb.assemble(hb.loads(diagram(bodies)))
    x = np.asarray(start(assembly).x, float) + 0.1
    with tempfile.TemporaryDirectory() as folder:
        ours = seconds(compiled(right_hand_side(assembly), Path(folder)), x, CALLS)
    tree: Any = Pinocchio(bodies)
    q, v = np.full(6, 0.1), np.full(6, 0.1)
    times = []
    works: tuple[Any, Any] = (lambda: tree.pin.aba(tree.model, tree.data, q, v, v), lambda: tree.pin.neutral)
    for work in works:
        begin = time.process_time()
        for _ in range(20000):
            work()
        times.append((time.process_time() - begin)/20000)
    print(f"six hinges: {ours*1e6:.2f} us, Pinocchio from Python {(times[0] - times[1])*1e6:.2f} us")


def compiled(function: ca.Function, folder: Path) -> ca.Function:
    """The function as machine code."""
    source = folder / "rates.c"
    generator = ca.CodeGenerator(source.name)
    generator.add(function)
    generator.generate(str(folder) + "/")
    subprocess.run(["cc", "-O2", "-fPIC", "-shared", str(source), "-o", str(folder / "rates.so")], check=True)
    return ca.external(function.name(), str(folder / "rates.so"))


if __name__ == "__main__":
    growth()
    arm()
    arm()
