"""Machines in space beside Pinocchio and MuJoCo, their energy, and the growth of their cost. `python -m benchmarks.spatial`
prints all tables, `python -m benchmarks.spatial closed drift` those that are named; times are processor times of one run.

trees: accelerations of twenty random trees. closed: accelerations of six mechanisms with closed loops. drift: energy of a
double pendulum in space over 1000 s. growth: assembly and right-hand side of trees of N bodies; the exponent between two
numbers of bodies is log(time ratio)/log(number ratio). arm: the right-hand side of six hinges, compiled by the C compiler
with -O2 and called 2000 times in a loop in C, and Pinocchio's aba in a loop in C++ (some minutes to compile). machines:
assembly of the crane, and a run of the platform.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

import heavebond as hb
from benchmarks.random_trees import (
    Pinocchio,
    TreeBody,
    aligned_tree,
    closed_diagram,
    closed_mechanism,
    diagram,
    mujoco_accelerations,
    random_tree,
)
from heavebond.numerics.dae import Assembly
from heavebond.numerics.initialise import start

NUMBERS = (12, 25, 50, 100, 200)
CALLS = 2000
PENDULUM = """model: double
components:
  ground: {is: SpatialFixed}
  upper:  {is: SpatialRevoluteJoint, n: [0, -1, 0]}
  one:    {is: SpatialBody, m: 2 kg, J_x: 0.1 kg*m**2, J_y: 0.2 kg*m**2, J_z: 0.2 kg*m**2, l_x: 0.5 m}
  rod:    {is: SpatialLink, l_x: 1 m}
  lower:  {is: SpatialRevoluteJoint, n: [1, 0, 1]}
  two:    {is: SpatialBody, m: 1 kg, J_x: 0.05 kg*m**2, J_y: 0.1 kg*m**2, J_z: 0.1 kg*m**2, l_x: 0.4 m}
nodes:
  ground: [ground.a, upper.a]
  one:    [upper.b, one.a, rod.a]
  elbow:  [rod.b, lower.a]
  two:    [lower.b, two.a]
  d_1:    [upper.d]
  d_2:    [lower.d]
initial: {upper.phi: 0.3 rad, lower.phi: 1 rad, upper.w: 0 rad/s, lower.w: 0 rad/s}
show:
  kinetic: {is: "two.m*dot(two.u, two.u)/2 + one.m*dot(one.u, one.u)/2 + dot(one.w, one.L)/2 + dot(two.w, two.L)/2", unit: J}
  potential: {is: "one.m*one.g*(one.z + one.r[3]) + two.m*two.g*(two.z + two.r[3])", unit: J}
simulate: {until: 1000 s, every: 0.1 s}
"""


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


def trees() -> None:
    """Largest differences of the accelerations at the start, relative to the largest acceleration."""
    print(f"{'tree':>10} {'bodies':>7} {'Pinocchio':>10} {'MuJoCo':>10}")
    for seed in range(20):
        bodies = random_tree(2 + seed % 7, seed)
        run = hb.simulate(hb.loads(diagram(bodies)), "1 us", every="1 us")
        q, v, a = (np.array(values) for values in (
            [b.q for b in bodies], [b.v for b in bodies], [run[f"a_{k}"][0] for k in range(len(bodies))]))
        others = Pinocchio(bodies).accelerations(q, v), mujoco_accelerations(bodies)
        print(f"{seed:>10} {len(bodies):>7} " + " ".join(f"{np.abs(a - o).max()/np.abs(o).max():>10.1e}" for o in others))


def closed() -> None:
    """As `trees`; the closures of MuJoCo are stiff."""
    print(f"{'mechanism':>10} {'bodies':>7} {'loops':>6} {'Pinocchio':>10} {'MuJoCo':>10}")
    for number in range(6):
        bodies, closures, independent = closed_mechanism(number)
        run = hb.simulate(hb.loads(closed_diagram(bodies, closures, independent)), "1 us", every="1 us")
        q, v, a = (np.array([run[f"{word}_{k}"][0] for k in range(len(bodies))]) for word in "qva")
        others = Pinocchio(bodies).closed_accelerations(closures, q, v), mujoco_accelerations(bodies, closures, q, v)
        print(f"{number:>10} {len(bodies):>7} {len(closures):>6} " + " ".join(
            f"{np.abs(a - o).max()/np.abs(o).max():>10.1e}" for o in others), flush=True)


def drift() -> None:
    """The drift of the energy, relative to the range of the kinetic energy."""
    model = hb.loads(PENDULUM)
    for rtol in (1e-10, 1e-12):
        begin = time.process_time()
        run = hb.simulate(model, rtol=rtol, atol=rtol)
        took, share = time.process_time() - begin, np.ptp(run["kinetic"] + run["potential"])/np.ptp(run["kinetic"])
        print(f"double pendulum in space, 1000 s, rtol {rtol:g}: drift {share:.1e} in {took:.0f} s", flush=True)


def machines() -> None:
    """Assembly of the crane, and the platform over 60 s."""
    assembled(4)
    model = hb.load("spatial/vessel_crane")
    begin = time.process_time()
    hb.assemble(model)
    print(f"vessel_crane: assembly {time.process_time() - begin:.2f} s")
    model = hb.load("spatial/platform")
    begin = time.process_time()
    hb.simulate(model, "60 s")
    print(f"platform: 60 s in {time.process_time() - begin:.1f} s, with its assembly")


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
    """The right-hand side of six hinges beside the articulated-body algorithm of Pinocchio for the same tree, in C++."""
    bodies = aligned_tree(6, 1)
    assembly = hb.assemble(hb.loads(diagram(bodies)))
    first = start(assembly)
    x = np.asarray(first.x, float) + 0.1
    rates = right_hand_side(assembly)
    with tempfile.TemporaryDirectory() as folder:
        ours = seconds(compiled(rates, Path(folder)), x, CALLS)
    print(f"six hinges: {ours*1e6:.2f} us", flush=True)
    other = articulated_body(bodies, 10*CALLS)
    if isinstance(other, str):
        print(f"Pinocchio in C++ is not timed: {other}")
        return
    took, accelerations = other
    error = np.abs(np.asarray(rates(x)).ravel()[6:] - accelerations).max()  # after the rates of six angles
    print(f"Pinocchio's ABA in C++: {took*1e6:.2f} us, ratio {ours/took:.2f}; accelerations differ by {error:.0e} rad/s2")


def articulated_body(bodies: list[TreeBody], calls: int) -> tuple[float, np.ndarray] | str:
    """The processor time (s) of one call of Pinocchio's aba in a loop in C++ (spatial_aba.cpp), and the accelerations at
    coordinates and speeds of 0.1; or what is missing."""
    import pinocchio

    prefix = next(parent for parent in Path(pinocchio.__file__).parents if parent.name == "cmeel.prefix")
    eigen = next((folder for folder in (prefix/"include"/"eigen3", Path("/usr/include/eigen3"),
                                        Path(os.environ.get("EIGEN", ""))) if (folder/"Eigen"/"Core").exists()), None)
    if eigen is None or shutil.which("g++") is None:
        return "it needs g++ and the headers of Eigen; type `pip install cmeel-eigen`, or set EIGEN to their folder"
    numbers = [f"{len(bodies)}"]
    for b in bodies:
        numbers += [f"{b.parent}", *(repr(float(value)) for value in (*b.axis, *b.shift, b.m, *b.centre, *b.J.ravel()))]
    numbers += [f"{calls} 0.1 0.1"]
    definitions = ("PINOCCHIO_ENABLE_TEMPLATE_INSTANTIATION", "BOOST_MPL_LIMIT_LIST_SIZE=30",
                   "BOOST_MPL_LIMIT_VECTOR_SIZE=30", "BOOST_MPL_CFG_NO_PREPROCESSED_HEADERS",
                   "BOOST_FUSION_INVOKE_MAX_ARITY=12", "NDEBUG")
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder)/"aba"
        # the algorithm is in the library of the wheel; the flags of this file do not act on it
        subprocess.run(["g++", "-O1", "-std=c++17", "-w", *(f"-D{d}" for d in definitions),
                        f"-I{prefix/'include'}", f"-I{eigen}", str(Path(__file__).with_name("spatial_aba.cpp")),
                        "-o", str(program), f"-L{prefix/'lib'}", "-lpinocchio_default", f"-Wl,-rpath,{prefix/'lib'}"],
                       check=True)
        answer = subprocess.run([str(program)], input=" ".join(numbers), text=True, capture_output=True, check=True).stdout
    took, *accelerations = map(float, answer.split())
    return took, np.array(accelerations)


def compiled(function: ca.Function, folder: Path) -> ca.Function:
    """The function as machine code."""
    source = folder / "rates.c"
    generator = ca.CodeGenerator(source.name)
    generator.add(function)
    generator.generate(str(folder) + "/")
    subprocess.run(["cc", "-O2", "-fPIC", "-shared", str(source), "-o", str(folder / "rates.so")], check=True)
    return ca.external(function.name(), str(folder / "rates.so"))


if __name__ == "__main__":
    tables = {table.__name__: table for table in (trees, closed, drift, growth, arm, machines)}
    for name in sys.argv[1:] or tables:
        tables[name]()
