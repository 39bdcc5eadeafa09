"""Machines of about 100 000 unknowns before reduction, from the file to the end of the first run, each in its own process.

`python -m benchmarks.hundred_thousand` prints their lines; `python -m benchmarks.hundred_thousand NAME` runs one of them.
"""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import heavebond as hb
from benchmarks import chain
from benchmarks.measuring import Figure, duration, process, seconds
from heavebond.linear.linearisation import ModesAtStart, start_point
from heavebond.linear.slow_modes import slow_modes
from heavebond.numerics.simulator import Tolerances

HERE = Path(__file__).parent
TOLERANCES = Tolerances(1e-6, 1e-8)
SECONDS, MEGABYTES = 60, 3000


def drill_string(pieces: int) -> hb.Model:
    """The compensator with its drill string in so many pieces."""
    return hb.load(HERE / "drill_string.yaml").with_parameters({"drilling.n": pieces})


def drill_string_in_hole(pieces: int) -> hb.Model:
    """The same with dry friction on the wall of the hole at each piece, beside the contact of the bit."""
    return hb.loads(f"""
model: drill_string_in_hole
extends: ../models/cmc_ahc/cmc_ahc.yaml
components:
  drilling: {{is: StringInHole, n: {pieces}, at: [4, 1]}}
simulate: {{until: 24 s, every: 50 ms}}
""", HERE)


def chain_of_masses(masses: int) -> hb.Model:
    """Masses behind cubic springs."""
    return hb.load(chain.DIAGRAM).with_parameters({"n": masses})


def cylinders(stations: int) -> hb.Model:
    """Cylinders, each with its valve, mass and rhythm, on one supply."""
    parts = [f"  c_{k}: {{is: Station, m: {200 + 300 * k / stations:g} kg, T: {1 + 2 * k / stations:g} s}}"
             for k in range(1, stations + 1)]
    supply = ", ".join(["pump.a", "oil.a", "relief.a", *(f"c_{k}.P" for k in range(1, stations + 1))])
    return hb.loads(f"""
model: cylinders
components:
  pump:   {{is: FlowSource, u: {12 * stations} L/min}}
  oil:    {{is: Volume, V: {stations} L, beta: 1.2 GPa}}
  relief: {{is: RatedReliefValve, p_0: 200 bar, p_r: 220 bar, q_r: {15 * stations} L/min, T_v: 20 ms}}
  tank:   {{is: Tank}}
{chr(10).join(parts)}
nodes:
  back:   [relief.b, tank.a]
  supply: [{supply}]
initial: {{supply.p: 200 bar}}
simulate: {{until: 4 s, every: 10 ms}}
""", HERE)


def pipe_network(crossings: int, cells: int) -> hb.Model:
    """A square grid of pipes of so many cells each, a throttle to the tank at each crossing, a pump at a corner."""
    grid = [(i, j) for i in range(crossings) for j in range(crossings)]
    ends = {at: [f"use_{at[0]}_{at[1]}.a"] for at in grid}
    parts = [f"  use_{i}_{j}: {{is: Orifice, q_r: {2 + 0.3 * ((7 * i + 3 * j) % 5):g} L/min, dp_r: 40 bar}}"
             for i, j in grid]
    for i, j in grid:
        for name, other in ((f"down_{i}_{j}", (i + 1, j)), (f"right_{i}_{j}", (i, j + 1))):
            if other in ends:
                length = 10 + (i + 2 * j) % 3
                parts.append(f"  {name}: {{is: Line, n: {cells}, length: {length} m, d: 20 mm, eps: 1.5 um}}")
                ends[i, j].append(f"{name}.a")
                ends[other].append(f"{name}.b")
    ends[0, 0] += ["pump.a", "oil.a"]
    nodes = [f"  n_{i}_{j}: [{', '.join(joined)}]" for (i, j), joined in ends.items()]
    back = ", ".join(["tank.a", *(f"use_{i}_{j}.b" for i, j in grid)])
    return hb.loads(f"""
model: pipe_network
components:
  pump: {{is: FlowSource, u: "={2 * crossings**2} L/min*(1 - exp(-(time/20 ms)**2))"}}
  oil:  {{is: Fluid, rho: 870 kg/m**3, nu: 10 mm**2/s, beta: 1.4 GPa}}
  tank: {{is: Tank}}
{chr(10).join(parts)}
nodes:
{chr(10).join(nodes)}
  back: [{back}]
simulate: {{until: 0.1 s, every: 1 ms}}
""", HERE)


@dataclass(frozen=True)
class Machine:
    """A machine in its full size and in a small one for tests."""

    what: str
    full: Callable[[], hb.Model]
    small: Callable[[], hb.Model]


MACHINES = {
    "drill_string": Machine("drill string in 5000 pieces", lambda: drill_string(5000), lambda: drill_string(10)),
    "drill_string_in_hole": Machine("drill string in 3400 pieces with friction in its hole",
                                    lambda: drill_string_in_hole(3400), lambda: drill_string_in_hole(10)),
    "chain": Machine("chain of 10 000 masses", lambda: chain_of_masses(10_000), lambda: chain_of_masses(20)),
    "cylinders": Machine("2200 cylinders on one supply", lambda: cylinders(2200), lambda: cylinders(10)),
    "pipe_network": Machine("network of 180 pipes in 40 cells", lambda: pipe_network(10, 40), lambda: pipe_network(3, 2)),
}


def run(model: hb.Model) -> hb.Result:
    """Assembled, started and integrated."""
    return hb.Simulator(hb.assemble(model), tolerances=TOLERANCES).run()


def alone(name: str) -> Figure:
    """Processor time and largest memory of a process that reads, assembles, starts and integrates a machine."""
    unknowns, states, took, memory = process("-m", "benchmarks.hundred_thousand", name).split()
    return Figure(f"{MACHINES[name].what} ({int(unknowns)} unknowns, {int(states)} states): whole process",
                  f"{duration(float(took))}, {float(memory):.0f} MB", f"≤ {SECONDS} s, {MEGABYTES} MB",
                  float(took) <= SECONDS and float(memory) <= MEGABYTES)


def modes(model: hb.Model) -> float:
    """Processor time of the slowest modes and of the search for growing ones, at the start of an assembled machine."""
    at_start = ModesAtStart(hb.assemble(model))
    point = start_point(at_start.start({}), at_start.u)
    return seconds(partial(slow_modes, at_start.linearisation, point, 24.0))


def figures() -> Iterator[Figure]:
    """A line for each machine, and one for the modes of the first."""
    yield from (alone(name) for name in MACHINES)
    first = MACHINES["drill_string"]
    yield Figure(f"{first.what}: slowest modes and search for growing ones", duration(modes(first.full())))


def main() -> None:
    """As the command line calls it."""
    if len(sys.argv) < 2:
        for found in figures():
            print(f"{found.what}: {found.measured} ({found.target})", flush=True)
        return
    result = run(MACHINES[sys.argv[1]].full())
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(len(result.assembly.flat.unknowns), len(result.assembly.state_names), time.process_time(), memory)


if __name__ == "__main__":
    main()
