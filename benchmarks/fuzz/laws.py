"""One law in two descriptions: small diagrams in pairs that must give the same run."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import numpy as np

import heavebond as hb
from benchmarks.fuzz.metamorphic import ATOL, RTOL, Compared
from heavebond.core.errors import HeavebondError
from heavebond.language.model import loads
from heavebond.numerics.result import Result

SHARE = 1e-6  # of its largest value, to which a signal agrees; runs of both are to RTOL of each step
NEAR = 1e-6  # share of the run around an event in which values are not compared
TIMES = 30.0  # of the change by tighter tolerances, that two runs may differ besides


@dataclass(frozen=True)
class Law:
    """Two diagrams and the signals that both have; of the second under another name where it is given as `a: b`."""

    name: str
    first: str
    second: str
    signals: tuple[str, ...]


def compared(law: Law) -> Compared:
    """Whether the two diagrams of a law give the same run."""
    try:
        first, second = (hb.simulate(loads(text)) for text in (law.first, law.second))
        finer = hb.simulate(loads(law.first), rtol=RTOL / 100, atol=ATOL / 100)
    except HeavebondError as error:
        return Compared(law.name, "refused", str(error)[:400])
    return agreement(law, first, second, finer)


def agreement(law: Law, first: Result, second: Result, finer: Result) -> Compared:
    """Compare the signals of two runs at all output points that are not at events."""
    instants = np.array([t for r in (first, second) for t, _ in r.events])
    near = np.any(np.abs(first.time[:, None] - instants[None, :]) < NEAR * first.time[-1], axis=1)
    if first.verdict.status != second.verdict.status:
        return Compared(law.name, "different", f"verdict {first.verdict.status} and {second.verdict.status}")
    for entry in law.signals:
        name, _, other = entry.partition(": ")
        a, b, c = (np.where(near, 0.0, values) for values in (first[name], second[other or name], finer[name]))
        size = max(float(np.abs(v).max()) for v in (a, b, c))
        if size == 0:  # two runs that miss a pulse agree
            return Compared(law.name, "different", f"{name} does not move")
        off = float(np.abs(a - b).max()) / size
        if off > SHARE + TIMES * float(np.abs(a - c).max()) / size:
            return Compared(law.name, "different", f"{name}: off by {off:.2g} of its size", len(law.signals))
    return Compared(law.name, "same", "", len(law.signals))


# -- signals of time ---------------------------------------------------------------------------------------------------
def _lagged(source: str, until: str, lag: str = "0.2 s") -> str:
    return f"""
model: lagged
components:
  source: {{is: {source}}}
  lag: {{is: FirstOrderLag, T_1: {lag}}}
nodes: {{command: [source.y, lag.u]}}
initial: {{lag.y: 0}}
simulate: {{until: {until}, every: {float(until.split()[0]) / 100!r} {until.split()[1]}}}
"""


def _formula(text: str, until: str, lag: str = "0.2 s") -> str:
    return f"""
model: lagged
components:
  lag: {{is: FirstOrderLag, T_1: {lag}, u: "={text}"}}
initial: {{lag.y: 0}}
simulate: {{until: {until}, every: {float(until.split()[0]) / 100!r} {until.split()[1]}}}
"""


def _signals() -> list[Law]:
    y = ("lag.y",)
    ramps = "min(max((time - 0.1 s)/0.2 s, 0), 1)*2 - min(max((time - 0.6 s)/0.2 s, 0), 1)*3"
    found = [
        Law("table and formula", _lagged("TableSource, t: [0.1 s, 0.3 s, 0.6 s, 0.8 s], v: [0, 2, 2, -1]", "1 s"),
            _formula(ramps, "1 s"), y),
        Law("ramp and formula", _lagged("Ramp, rate: 2 1/s, t_s: 0.31 s, t_e: 0.67 s", "1 s"),
            _formula("2 1/s*(min(max(time, 0.31 s), 0.67 s) - 0.31 s)".replace("2 1/s", "2*1 1/s"), "1 s"), y),
        Law("sine and formula", _lagged("Sine, a: 2, T: 0.3 s, offset: 1", "1 s"),
            _formula("1 + 2*sin(2*pi*time/0.3 s)", "1 s"), y),
        Law("step and condition", _lagged("Step, t_s: 0.333 s, after: 2", "1 s"),
            _formula("if_else(time < 0.333 s, 0, 2)", "1 s"), y),
        Law("pulse and condition", _lagged("Pulse, t_s: 0.3 s, width: 0.2 s, height: 2", "1 s"),
            _formula("if_else(time < 0.3 s, 0, 2) - if_else(time < 0.5 s, 0, 2)", "1 s"), y),
        Law("square wave and conditions", _lagged("SquareWave, high: 1, T: 0.5 s, duty: 0.3", "1 s"),
            _formula("1 - if_else(time < 0.15 s, 0, 1) + if_else(time < 0.5 s, 0, 1) - if_else(time < 0.65 s, 0, 1) "
                     "+ if_else(time < 1 s, 0, 1)", "1 s"), y)]
    for until, width in (("1 s", 0.02), ("100 s", 0.5), ("3600 s", 1.0)):
        at = 0.617 * float(until.split()[0])
        table = f"TableSource, t: [{at!r} s, {at + width / 2!r} s, {at + width!r} s], v: [0, 1, 0]"
        shape = f"max(0, 1 - abs(time - {at + width / 2!r} s)/{width / 2!r} s)"
        lag = f"{0.1 * float(until.split()[0])!r} s"
        found += [Law(f"triangle of {width} s in {until}, table and formula", _lagged(table, until, lag),
                      _formula(shape, until, lag), y),
                  Law(f"triangle of {width} s in {until}, table and conditions", _lagged(table, until, lag),
                      _formula(f"if_else(time < {at!r} s, 0, if_else(time < {at + width!r} s, {shape}, 0))", until, lag), y),
                  Law(f"pulse of {width} s in {until}, as two steps",
                      _lagged(f"Pulse, t_s: {at!r} s, width: {width!r} s, height: 1", until, lag),
                      _formula(f"if_else(time < {at!r} s, 0, 1) - if_else(time < {at + width!r} s, 0, 1)", until, lag), y)]
    return found


# -- parts -------------------------------------------------------------------------------------------------------------
SLEDGE = """
model: sledge
components:
  ground: {is: Fixed}
PARTS
  sledge: {is: Mass, m: 10 kg}
  push:   {is: ForceSource, u: "=25 N*sin(3 rad/s*time)"}
nodes:
  ground: [ground.a, GROUND]
  sledge: [sledge.a, push.a, SLEDGE]
initial: {sledge.x: 0 m, sledge.v: 0.3 m/s}
simulate: {until: 2 s, every: 10 ms}
"""
SHAFT = """
model: shaft
components:
  wall: {is: FixedShaft}
PARTS
  rotor: {is: Inertia, J: 0.2 kg*m**2}
  push:  {is: TorqueSource, u: "=3 N*m*sin(3 rad/s*time)"}
nodes:
  wall:  [wall.a, GROUND]
  rotor: [rotor.a, push.a, SLEDGE]
initial: {rotor.phi: 0 rad, rotor.w: 1 rad/s}
simulate: {until: 2 s, every: 10 ms}
"""


def _parts(diagram: str, *parts: str) -> str:
    lines = "\n".join(f"  p{k}: {{is: {part}}}" for k, part in enumerate(parts))
    return diagram.replace("PARTS", lines).replace("GROUND", ", ".join(f"p{k}.a" for k in range(len(parts)))) \
        .replace("SLEDGE", ", ".join(f"p{k}.b" for k in range(len(parts))))


def _halves() -> list[Law]:
    x, phi = ("sledge.x", "sledge.v"), ("rotor.phi", "rotor.w")
    cases = [
        (SLEDGE, x, "CoulombFriction, F_c: {} N", (12.0,)),
        (SLEDGE, x, "DryFriction, F_c: {} N, F_s: {} N", (12.0, 18.0)),
        (SLEDGE, x, "StribeckFriction, F_c: {} N, F_s: {} N, v_s: 0.1 m/s", (12.0, 18.0)),
        (SLEDGE, x, "SpringDamper, c: {} N/m, d: {} N*s/m", (300.0, 10.0)),
        (SLEDGE, x, "Drag, d_2: {} N*s**2/m**2", (50.0,)),
        (SLEDGE, x, "SpringWithPlay, c: {} N/m, gap: 20 mm", (3000.0,)),
        (SLEDGE, x, "EndStop, c: {} N/m, d: {} N*s/m, x_min: -20 mm, x_max: 30 mm", (1e5, 200.0)),
        (SHAFT, phi, "RotationalCoulombFriction, M_c: {} N*m", (1.5,)),
        (SHAFT, phi, "RotationalDryFriction, M_c: {} N*m, M_s: {} N*m", (1.5, 2.0)),
        (SHAFT, phi, "TorsionSpringDamper, c: {} N*m/rad, d: {} N*m*s/rad", (20.0, 0.3)),
        (SHAFT, phi, "RotationalStribeckFriction, M_c: {} N*m, M_s: {} N*m, w_s: 0.2 rad/s", (1.5, 2.0))]
    found = []
    for diagram, names, part, values in cases:
        one, half, third = (part.format(*(v * share for v in values)) for share in (1.0, 0.5, 1 / 3))
        kind = part.partition(",")[0]
        found += [Law(f"two halves of {kind}", _parts(diagram, one), _parts(diagram, half, half), names),
                  Law(f"three thirds of {kind}", _parts(diagram, one), _parts(diagram, third, third, third), names)]
    return found


def _orders() -> list[Law]:
    """Contacts of one body, and events of one instant, in every order."""
    contacts = ("DryFriction, F_c: 5 N, F_s: 8 N", "EndStop, c: 100 kN/m, d: 200 N*s/m, x_min: -20 mm, x_max: 30 mm",
                "CoulombFriction, F_c: 4 N")
    rigid = ("DryFriction, F_c: 5 N, F_s: 8 N", "RigidStop, e: 0.5, l0: -20 mm", "RigidStop, e: 0.3, l0: 40 mm, side: -1")
    found = []
    for label, kinds in (("contacts", contacts), ("rigid contacts", rigid)):
        first = _parts(SLEDGE, *kinds)
        found += [Law(f"{label} in order {''.join(map(str, order))}", first, _parts(SLEDGE, *(kinds[k] for k in order)),
                      ("sledge.x", "sledge.v")) for order in list(permutations(range(3)))[1:]]
    parts = {"a": "Step, t_s: 0.4 s, after: 2", "b": "Pulse, t_s: 0.4 s, width: 0.2 s, height: -1",
             "c": "SampleHold, T_s: 0.2 s, u: =time*1 1/s", "d": "SquareWave, T: 0.4 s, high: 3"}

    def diagram(order: tuple[str, ...]) -> str:
        lines = "\n".join(f"  {n}: {{is: {parts[n]}}}".replace("u: =time*1 1/s", 'u: "=time*1 1/s"') for n in order)
        return f"""
model: instants
components:
{lines}
  lag: {{is: FirstOrderLag, T_1: 0.2 s, u: "=a.y + b.y + c.y + d.y"}}
simulate: {{until: 1 s, every: 10 ms}}
"""
    names = tuple(parts)
    return found + [Law(f"events of one instant in order {''.join(order)}", diagram(names), diagram(order), ("lag.y", "c.y"))
                    for order in list(permutations(names))[1::4]]


# -- units and values --------------------------------------------------------------------------------------------------
WARM = """
model: warm
components:
  steel: {is: HeatCapacity, m: 1 kg, c: 500 J/(kg*K)}
  wall:  {is: ThermalResistance, R: 0.2 K/W}
  air:   {is: Ambient, T_0: AIR}
nodes: {steel: [steel.a, wall.a], air: [wall.b, air.a]}
initial: {steel.T: STEEL}
simulate: {until: 300 s, every: 3 s}
"""


def _units() -> list[Law]:
    pairs = [("degC and K", ("20 degC", "80 degC"), ("293.15 K", "353.15 K")),
             ("degF and K", ("68 degF", "176 degF"), ("293.15 K", "353.15 K")),
             ("degC and mK", ("20 degC", "80 degC"), ("293150 mK", "353150 mK"))]
    def warm(air: str, steel: str) -> str:
        return WARM.replace("AIR", air).replace("STEEL", steel)

    return [Law(f"temperatures in {n}", warm(*a), warm(*b), ("steel.T",)) for n, a, b in pairs]


def laws() -> list[Law]:
    """All pairs."""
    return [*_signals(), *_halves(), *_orders(), *_units()]
