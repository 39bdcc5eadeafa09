"""Fourteen machines whose hidden law is not in the catalogue, and the formula that `heavebond laws` finds for it.

The laws are taken from handbooks: three depend on two variables, two have memory, three are periodic. The records carry
noise; some machines have clutter, that is a small effect that is not declared, or a quantised channel. Each runs as

    python -m benchmarks.diagnosis.laws                     machines that have no result yet
    python -m benchmarks.diagnosis.laws cogging magnet      these machines
    python -m benchmarks.diagnosis.laws cogging --write DIR write diagram, records and experiment; no search
    python -m benchmarks.diagnosis.laws --nothing 50        count the formulas for records in which nothing is hidden

A formula is right if it differs from the law by at most 5 % over the motion of the fitted record, and by at most 20 % over
1.3 times that motion (rms of the difference over the rms of the law). The simplest of the formulas that the records cannot
distinguish is counted.
"""

from __future__ import annotations

import argparse
import tempfile
import time as clock
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.integrate import solve_ivp

import heavebond as hb
from benchmarks.diagnosis import keeping
from benchmarks.diagnosis.beds import Bed, Channel, Effect, Input, waves, write
from benchmarks.diagnosis.making import made
from benchmarks.diagnosis.rigs import RIGS
from heavebond.core.errors import SimulationError
from heavebond.numerics.dae import Array

NEAR, BEYOND, WIDER = 0.05, 0.20, 1.3  # largest relative rms differences, and how much wider the motion is for the second
RESULTS = "laws"
Values = Mapping[str, Array]


@dataclass(frozen=True)
class HiddenLaw:
    """A hidden law: the machine, where it acts, the variables of the law (formulas in the base diagram) by name, and its
    value (N,) in SI from those (N,) and the time (N,)."""

    bed: Bed
    place: tuple[str, ...]
    variables: Mapping[str, str]
    value: Callable[[Values, Array], Array]


def slide(name: str, story: str, law: str, text: str, *, drive: float = 60.0, mass: float = 4.0, stiffness: float = 900.0,
          damping: float = 12.0, periods: tuple[float, float] = (0.5, 4.0), noise: float = 1e-4, step: float = 0.0,
          clutter: tuple[Effect, ...] = (), seconds: float = 20.0, rate: float = 100.0, part: str = "") -> Bed:
    """A driven slide on a spring and a damper, with a law between frame and slide."""
    return Bed(name, story, f"""
components:
  drive: {{is: ForceSource, u: 0 N}}
  slide: {{is: Mass, m: {mass} kg}}
  rest:  {{is: SpringDamper, c: {stiffness} N/m, d: {damping} N*s/m}}
  frame: {{is: Fixed}}
nodes:
  slide: [drive.a, slide.a, rest.b]
  frame: [frame.a, rest.a]
initial: {{slide.x: 0 m, slide.v: 0 m/s}}
""", {"drive.u": Input("N", waves(-drive, drive, *periods, 0.0))},
               {"slide.x": Channel("slide.x", "m", noise, step)}, f"""
rest.c: {stiffness} N/m +- 10 %
rest.d: {damping} N*s/m +- 30 %
""", (Effect(law, "unknown law: frame slide", text),), seconds, rate, 0.0, (1.0,), clutter, parts=(part,) if part else ())


# The variables of a hidden component in each domain, their equations, and those of its ports.
FRAMES = {
    "translational": """
variables:
  x: {unit: m, doc: travel of b relative to a}
  v: {unit: m/s, doc: speed of b relative to a}
  F: {unit: N, doc: force at b}
equations: |
  x = b.x - a.x        # travel
  v = b.v - a.v        # speed
  b.f = F              # force at b
  a.f = -F             # reaction at a
""",
    "rotational": """
variables: {x: {unit: rad, doc: angle of b relative to a}, M: {unit: N*m, doc: torque at b}}
equations: |
  x = b.phi - a.phi    # angle
  b.tau = M            # torque at b
  a.tau = -M           # reaction at a
""",
    "hydraulic": """
variables: {dp: {unit: Pa, doc: pressure drop}, q: {unit: m**3/s, doc: flow from a to b}}
equations: |
  dp = a.p - b.p       # pressure drop
  a.q = q              # flow at a
  b.q = -q             # flow at b
""",
    "thermohydraulic": """
variables: {m: {unit: kg/s, doc: mass flow from a to b}, H: {unit: W, doc: enthalpy flow from a to b}}
equations: |
  H = oil_enthalpy_flow(m, a.p, a.T, b.p, b.T, rho, alpha, beta, k_T, c_p, T_0, m_t, G)   # enthalpy from upstream
  a.m = m              # in at a
  b.m = -m             # out at b
  a.H = H              # in at a
  b.H = -H             # out at b
"""}
OIL_DATA = """
  rho: {unit: kg/m**3, min: 1 kg/m**3, medium: rho, doc: density at T_0}
  alpha: {unit: 1/K, min: 0, medium: alpha, doc: volumetric expansion coefficient}
  beta: {unit: Pa, min: 1e5 Pa, medium: beta, doc: bulk modulus at T_0}
  k_T: {unit: 1/K, min: 0, medium: k_T, doc: relative increase of the compressibility with temperature}
  c_p: {unit: J/(kg*K), min: 1 J/(kg*K), medium: c_p, doc: specific heat capacity}
  T_0: {unit: K, min: 1 K, medium: T_0, doc: reference temperature of the oil data}
  m_t: {unit: kg/s, width, min: 1e-9 kg/s, default: 1e-4 kg/s, doc: mass flow of the transition between the directions}
  G: {unit: W/K, default: 1e-3 W/K, doc: thermal conductance}
"""


def hidden_component(domain: str, formula: str, parameters: Mapping[str, str]) -> str:
    """A component with a law between its ports; parameters with their values and units."""
    declared = "".join(f"  {name}: {{unit: {unit}, default: {value} {unit}, doc: number of the law}}\n"
                       for name, (value, _, unit) in ((n, text.partition(" ")) for n, text in parameters.items()))
    return f"""
component: HiddenLaw
summary: A law that the catalogue does not have.
ports: {{a: {domain}, b: {domain}}}
parameters:
{declared}{OIL_DATA if domain == "thermohydraulic" else ""}{FRAMES[domain].rstrip()}
  {formula}   # law
power: controlled, a hidden law
"""


def beside(one: str, other: str) -> str:
    """The variant of a diagram with the hidden component between two nodes."""
    return f"components: {{hidden: {{is: HiddenLaw}}}}\nnodes: {{{one}: [+hidden.a], {other}: [+hidden.b]}}\n"


TRAVEL = {"x": "slide.x", "v": "slide.v"}
SMALL_FRICTION = Effect("A little dry friction of the guide.", "dry friction: frame slide", """
components: {guide: {is: CoulombFriction, F_c: 0.3 N, v_t: 3 mm/s}}
nodes: {frame: [+guide.a], slide: [+guide.b]}
""")


def _slide(name: str, story: str, law: str, formula: str, parameters: Mapping[str, str],
           value: Callable[[Values, Array], Array], **options: object) -> HiddenLaw:
    part = hidden_component("translational", formula, parameters)
    return HiddenLaw(slide(name, story, law, beside("frame", "slide"), part=part, **options),  # type: ignore[arg-type]
                     ("frame", "slide"), TRAVEL, value)


def _integrated(slope: Callable[[float, Array, float], float], inputs: Array, time: Array) -> Array:
    """The state (N,) from zero on, with the slope as a function of time, inputs and state."""
    def right(t: float, state: Array) -> list[float]:
        return [slope(t, np.array([np.interp(t, time, row) for row in inputs]), float(state[0]))]

    found = solve_ivp(right, (float(time[0]), float(time[-1])), [0.0], t_eval=time, method="LSODA", rtol=1e-8, atol=1e-8)
    return np.asarray(found.y[0])


# -- periodic --------------------------------------------------------------------------------------------------------------
COGGING = _slide(
    "cogging", "A linear motor with an iron core.",
    "Cogging: F = 12 N*sin(2*pi*x/24 mm). Hanselman, Brushless Permanent Magnet Motor Design, 2nd ed. 2006, ch. 4.",
    "F = F_0*sin(2*pi*x/p)", {"F_0": "12 N", "p": "0.024 m"},
    lambda q, t: 12 * np.sin(2 * np.pi * q["x"] / 0.024), clutter=(SMALL_FRICTION,))
HARMONICS = _slide(
    "harmonics", "A linear motor with two slot harmonics.",
    "Cogging with the second harmonic: F = 10 N*sin(2*pi*x/40 mm) + 5 N*sin(4*pi*x/40 mm). Hanselman 2006, ch. 4.",
    "F = F_1*sin(2*pi*x/p) + F_2*sin(4*pi*x/p)", {"F_1": "10 N", "F_2": "5 N", "p": "0.04 m"},
    lambda q, t: 10 * np.sin(2 * np.pi * q["x"] / 0.04) + 5 * np.sin(4 * np.pi * q["x"] / 0.04))
RIPPLE = HiddenLaw(Bed(
    "ripple", "A motor with reluctance torque turns a flywheel against a spiral spring.", """
components:
  motor:    {is: TorqueSource, u: 0 N*m}
  flywheel: {is: Inertia, J: 0.02 kg*m**2}
  spring:   {is: TorsionSpringDamper, c: 1.2 N*m/rad, d: 0.03 N*m*s/rad}
  frame:    {is: FixedShaft}
nodes:
  flywheel: [motor.a, flywheel.a, spring.b]
  frame:    [frame.a, spring.a]
initial: {flywheel.phi: 0 rad, flywheel.w: 0 rad/s}
""", {"motor.u": Input("N*m", waves(-3.0, 3.0, 0.6, 4.0, 0.0))}, {"flywheel.phi": Channel("flywheel.phi", "rad", 2e-3)}, """
spring.c: 1.2 N*m/rad +- 10 %
spring.d: 0.03 N*m*s/rad +- 30 %
""", (Effect("Torque ripple of six poles with a phase: M = 0.4 N*m*sin(6*phi + 0.7). Krishnan, Permanent Magnet "
             "Synchronous and Brushless DC Motor Drives, 2010, ch. 1.", "unknown law: frame flywheel",
             beside("frame", "flywheel")),), 20.0, 100.0, 0.0, (1.0,), parts=(hidden_component(
                 "rotational", "M = M_0*sin(6*x + phi_0)", {"M_0": "0.4 N*m", "phi_0": "0.7 rad"}),)),
    ("frame", "flywheel"), {"x": "flywheel.phi", "v": "flywheel.w"}, lambda q, t: 0.4 * np.sin(6 * q["x"] + 0.7))

# -- one variable ----------------------------------------------------------------------------------------------------------
MAGNET = _slide(
    "magnet", "A slide that a magnet attracts across an air gap.",
    "Attraction across a gap: F = -0.03 N*m**2/(0.1 m - x)**2. Woodson, Melcher, Electromechanical Dynamics I, 1968, ch. 3.",
    "F = -C/(g - x)**2", {"C": "0.03 N*m**2", "g": "0.1 m"}, lambda q, t: -0.03 / (0.1 - q["x"])**2, stiffness=1800.0)
RUBBER = _slide(
    "rubber", "A slide with a soft bumper that stiffens exponentially.",
    "Exponential spring: F = 4 N*(exp(x/20 mm) - 1). Fung, Biomechanics, 2nd ed. 1993, ch. 7.",
    "F = F_0*(exp(x/x_0) - 1)", {"F_0": "4 N", "x_0": "0.02 m"}, lambda q, t: 4 * (np.exp(q["x"] / 0.02) - 1), step=2e-4)
LIMIT = _slide(
    "limit", "A slide on a chain that can be extended finitely.",
    "Finitely extensible spring: F = 300 N/m*x/(1 - (x/0.25 m)**2). Warner, Ind. Eng. Chem. Fundam. 11 (1972) 379-387.",
    "F = k*x/(1 - (x/L)**2)", {"k": "300 N/m", "L": "0.25 m"},
    lambda q, t: 300 * q["x"] / (1 - (q["x"] / 0.25)**2), drive=90.0)
EDDY = _slide(
    "eddy", "A slide with an eddy current brake.",
    "Eddy current brake: F = 2*15 N*(v/0.25 m/s)/(1 + (v/0.25 m/s)**2). Wouterse, IEE Proc. B 138 (1991) 153-158.",
    "F = 2*F_m*(v/v_c)/(1 + (v/v_c)**2)", {"F_m": "15 N", "v_c": "0.25 m/s"},
    lambda q, t: 30 * (q["v"] / 0.25) / (1 + (q["v"] / 0.25)**2),
    clutter=(SMALL_FRICTION,))
EYRING = _slide(
    "eyring", "A slide in a thin film of a polymer.",
    "Thermally activated flow: F = 5 N*asinh(v/0.02 m/s). Eyring, J. Chem. Phys. 4 (1936) 283-291.",
    "F = F_0*log(v/v_0 + sqrt(1 + (v/v_0)**2))", {"F_0": "5 N", "v_0": "0.02 m/s"},
    lambda q, t: 5 * np.arcsinh(q["v"] / 0.02))
BARUS = HiddenLaw(Bed(
    "barus", "A pressure vessel that a pump fills, with a leak.", """
components:
  pump:   {is: FlowSource, u: 0 L/min}
  vessel: {is: Volume, V: 2 L, beta: 1.2 GPa}
  drain:  {is: LaminarLeakage, C: 4e-12 m**3/(s*Pa)}
  tank:   {is: Tank}
nodes:
  vessel: [pump.a, vessel.a, drain.a]
  tank:   [drain.b, tank.a]
initial: {vessel.p: 40 bar}
""", {"pump.u": Input("L/min", waves(1.0, 14.0, 0.5, 6.0, 6.0))}, {"vessel.p": Channel("vessel.p", "bar", 0.2)}, """
drain.C: 4e-12 m**3/(s*Pa) +- 15 %
vessel.beta: 1.2 GPa +- 10 %
""", (Effect("A leak whose viscosity grows exponentially with the pressure: q = 1.2e-11 m**3/(s*Pa)*p*exp(-p/150 bar). "
             "Barus, Am. J. Sci. 45 (1893) 87-96.", "unknown law: vessel tank",
             beside("vessel", "tank")),), 30.0, 50.0, 0.0, (1.0,), parts=(hidden_component(
                 "hydraulic", "q = G*dp*exp(-dp/p_0)", {"G": "1.2e-11 m**3/(s*Pa)", "p_0": "1.5e7 Pa"}),)),
    ("vessel", "tank"), {"x": "vessel.p"}, lambda q, t: 1.2e-11 * q["x"] * np.exp(-q["x"] / 150e5))

# -- two variables ---------------------------------------------------------------------------------------------------------
METERING = _slide(
    "metering", "A slide with a shock absorber whose orifice closes along the stroke.",
    "Metering pin: F = 60 N*s**2/m**2*v*abs(v)*exp(x/50 mm). Currey, Aircraft Landing Gear Design, 1988, ch. 5.",
    "F = C*v*abs(v)*exp(x/L)", {"C": "60 N*s**2/m**2", "L": "0.05 m"},
    lambda q, t: 60 * q["v"] * np.abs(q["v"]) * np.exp(q["x"] / 0.05))
SQUEEZE = _slide(
    "squeeze", "A slide that squeezes a film of oil.",
    "Squeeze film: F = 8 N*s/m*v/(1 - x/0.15 m)**3. Hamrock, Fundamentals of Fluid Film Lubrication, 2nd ed. 2004, ch. 12.",
    "F = c*v/(1 - x/h)**3", {"c": "8 N*s/m", "h": "0.15 m"},
    lambda q, t: 8 * q["v"] / (1 - q["x"] / 0.15)**3, clutter=(SMALL_FRICTION,))

OIL = HiddenLaw(Bed(
    "oil", "Cold oil flushes the hot oil out of a block that leaks.", """
components:
  oil:    {is: Oil}
  pump:   {is: OilFlowSource, u: 6 L/min, T_s: 20 degC}
  block:  {is: OilVolume, V: 10 L}
  outlet: {is: OilOrifice, q_r: 6 L/min, dp_r: 1 bar}
  tank:   {is: OilReservoir}
nodes:
  block: [pump.a, oil.a, block.a, outlet.a]
  back:  [outlet.b, tank.a]
initial: {block.T: 80 degC, block.p: 1 bar}
""", {"pump.u": Input("L/min", waves(3.0, 9.0, 10.0, 60.0, 6.0))},
    {"block.p": Channel("block.p", "bar", 0.002), "block.T": Channel("block.T", "K", 0.05)}, """
outlet.q_r: 6 L/min +- 10 %
""", (Effect("A leak whose viscosity falls exponentially with the temperature: m = 8e-8 kg/(s*Pa)*p*exp((T - 313.15 K)/"
             "30 K). O. Reynolds, Phil. Trans. R. Soc. 177 (1886) 157-234.", "unknown law: block back",
             beside("block", "back")),),
    300.0, 2.0, 0.0, (1.0,), parts=(hidden_component(
        "thermohydraulic", "m = C*(a.p - b.p)*exp((a.T - T_r)/T_e)",
        {"C": "8e-8 kg/(s*Pa)", "T_r": "313.15 K", "T_e": "30 K"}),)),
    ("block", "back"), {"x": "block.p", "T": "block.T"}, lambda q, t: 8e-8 * q["x"] * np.exp((q["T"] - 313.15) / 30))

# -- memory ----------------------------------------------------------------------------------------------------------------
LAGGED = _slide(
    "lagged", "A slide with a wake: the drag follows the speed with a delay of first order.",
    "Drag with memory: 0.15 s*der(F) = 80 N*s**2/m**2*v*abs(v) - F. Sarpkaya, Wave Forces on Offshore Structures, 2010, "
    "ch. 3.", "tau*der(F) = C*v*abs(v) - F", {"tau": "0.15 s", "C": "80 N*s**2/m**2"},
    lambda q, t: _integrated(lambda s, u, F: (80 * u[0] * abs(u[0]) - F) / 0.15, q["v"][None], t))
NORTON = _slide(
    "norton", "A slide with a rod of a metal that creeps.",
    "Creep by Norton's law in series with a spring: der(F) = 700 N/m*(v - 0.2 m/s*(F/15 N)**3). Norton, The Creep of "
    "Steel at High Temperatures, 1929.", "der(F) = k*(v - v_0*(F/F_0)**3)",
    {"k": "700 N/m", "v_0": "0.2 m/s", "F_0": "15 N"},
    lambda q, t: _integrated(lambda s, u, F: 700 * (u[0] - 0.2 * (F / 15)**3), q["v"][None], t))

LAWS = {law.bed.name: law for law in (COGGING, HARMONICS, RIPPLE, MAGNET, RUBBER, LIMIT, EDDY, EYRING, BARUS, METERING,
                                      SQUEEZE, OIL, LAGGED, NORTON)}


def differences(law: HiddenLaw, found: hb.FoundLaw, motion: Values, time: Array) -> tuple[float, float]:
    """The relative rms difference of a formula over a motion (SI), and over one that is WIDER about its centre."""
    def difference(values: Values) -> float:
        true = law.value(values, time)
        said = found.value({law.variables[name]: column for name, column in values.items()}, time)
        return float(np.sqrt(np.mean((said - true)**2) / np.mean(true**2)))

    wider = {name: (c := (v.min() + v.max()) / 2) + WIDER * (v - c) for name, v in motion.items()}
    return difference(motion), difference(wider)


def motion_of(law: HiddenLaw, file: Path) -> tuple[Values, Array]:
    """The motion (SI) of the base machine's variables in the fitted record, as it was measured; speeds by splines."""
    from scipy.interpolate import make_smoothing_spline

    data = pd.read_csv(file.parent / "train.csv")
    time = data["time"].to_numpy()
    courses = {channel.formula: make_smoothing_spline(time, (1e5 if channel.unit == "bar" else 1.0) * data[name].to_numpy())
               for name, channel in law.bed.channels.items()}
    speed = next(iter(courses.values())).derivative()(time)
    return {name: courses[formula](time) if formula in courses else speed for name, formula in law.variables.items()}, time


def searched(name: str) -> dict[str, object]:
    """The records of a machine and the formula found, as a row of results."""
    law = LAWS[name]
    with tempfile.TemporaryDirectory() as folder:
        file = write(law.bed, Path(folder))
        motion, time = motion_of(law, file)
        began = clock.process_time()
        answer = hb.find_laws(file)
        spent = clock.process_time() - began
        best = answer.simplest
        near, beyond = differences(law, best, motion, time) if best is not None and set(best.place) == set(law.place) \
            else (np.inf, np.inf)
    return {"key": name, "law": law.bed.effects[0].law, "formula": best.text if best is not None else "",
            "place": list(best.place) if best is not None else [], "difference": near, "beyond": beyond,
            "right": near <= NEAR and beyond <= BEYOND, "processor": round(spent, 1), "words": list(answer.words)}


def nothing(number: int) -> int:
    """How many formulas are named for so many records of the rigs in which nothing is hidden but noise, and values of the
    data sheet that are wrong within their tolerance; draws with which a machine leaves its range are left out."""
    named, done, rigs = 0, 0, list(RIGS.values())
    for k in count():
        rig = rigs[k % len(rigs)]
        with tempfile.TemporaryDirectory() as folder:
            try:
                case = made(rig, (), f"laws/{k}", Path(folder))
            except SimulationError:
                continue
            found = hb.find_laws(case.experiment)
        named, done = named + (found.simplest is not None), done + 1
        print(f"{rig.name} {k}: {' '.join(found.words)}", flush=True)
        if done == number:
            break
    return named


def main() -> None:
    """The machines named on the command line, or all without a result."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("names", nargs="*", choices=[*LAWS, []], metavar="NAME", help=", ".join(LAWS))
    parser.add_argument("--write", type=Path, metavar="DIR", help="write the files of each machine; no search")
    parser.add_argument("--results", default=RESULTS, help="results are appended to this file, without .jsonl")
    parser.add_argument("--nothing", type=int, metavar="N", help="search in so many records in which nothing is hidden")
    options = parser.parse_args()
    if options.nothing:
        print(f"{nothing(options.nothing)} of {options.nothing} have a formula")
        return
    for name in options.names or [name for name in LAWS if options.write or name not in keeping.read(options.results)]:
        if options.write:
            print(write(LAWS[name].bed, options.write / name))
            continue
        row = searched(name)
        keeping.add(options.results, row)
        print(f"{name}: {'right' if row['right'] else 'not right'}, {row['difference']:.3f}, beyond {row['beyond']:.3f}, "
              f"{row['processor']} s\n  truth {row['law']}\n  found {row['formula']}", flush=True)


if __name__ == "__main__":
    main()
