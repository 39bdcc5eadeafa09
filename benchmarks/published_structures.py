"""Structures that the text of the compensator paper allows, as linear machines with two periodic disturbances.

The disturbances are the dry friction and the dependence of the valve flow on the load pressure. Upward positions: crown
block x, platform z; p is the load pressure, y the spool, u the command.

    D(s) x = -P(s) (x - z) + A p - F                 D: masses, wires, string, formation; P: gas spring, viscous friction
    A s (x - z) + (C s + leakage) p = A K_q y + q    q: flow missing under load
    y = G(s) u,   u = -K_p x - K_v s M(s) z          G: valve, M: motion reference unit

The gains minimise the published index: K_v in closed form, K_p on a grid up to the stability boundary, which follows from
the crossings of the Nyquist plot with the negative real axis. All functions take arrays of values, shape (n, 1), and of
complex frequencies, shape (1, m). `benchmarks.published_search` searches the values of every structure.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Values = Mapping[str, Array]

# -- published ---------------------------------------------------------------------------------------------------------
VALVES = (0.25, 0.5, 0.75, 1.0, 2.5)  # Hz
TABLE = {True: (15.0, 6.2, 2.1, 2.0, 1.9), False: (15.0, 7.1, 1.1, 1.0, 1.0)}  # kN, with and without friction
K_P, K_V = {True: 3.02, False: 6.15}, 0.55  # 1/m and s/m at 0.75 Hz
EIGENFREQUENCY = 0.23  # Hz
CELLS = tuple((friction, f_n) for friction in TABLE for f_n in VALVES)
PUBLISHED = np.array([*TABLE[True], *TABLE[False], K_P[True], K_P[False], K_V, K_V, EIGENFREQUENCY])
TOLERANCES = np.array([0.25] * 10 + [0.10] * 4 + [0.05])

HEAVE, PERIOD = 0.5, 12.0
OMEGA = 2 * np.pi / PERIOD
GAS, GAS_DAMPING = 42e3, 52e3
F_C, F_S, V_S, SIGMA_2, XI = 12e3, 22.8e3, 0.1, 10e3, 1000.0
F_P = 500.0  # pressure-dependent friction at 125 bar, ours
SUPPLY = 345e5
AREA = 2 * np.pi / 4 * (0.2**2 - 0.17**2)
K_Q = float(2 * 460 / 60e3 * np.sqrt(345 / 2 / 35) / AREA)  # speed per unit of spool of the rated valves, m/s
WIRES, STRING, FORMATION = 4000e3, 298e3, 1000e3
LARGEST_K_P = 8.0  # end of the sweep
# rms(v)/rms(x) of the crown in the passive run, which weighs the two parts of the index (measured on the full model)
REFERENCE = {True: 0.571, False: OMEGA}

# -- numerical ---------------------------------------------------------------------------------------------------------
ODD = np.arange(1, 46, 2)  # harmonics of the wave; friction and valve are odd
HARMONICS: Array = np.asarray(OMEGA * ODD, dtype=np.float64)
HALF = np.arange(128) / 256 * PERIOD  # half a period, the other half is its mirror image
NYQUIST = 2 * np.pi * np.geomspace(0.1, 20, 480)
FINE = 2 * np.pi * np.geomspace(0.1, 20, 2000)  # at which results are checked: a search finds gaps between frequencies
AROUND = np.linspace(-1, 1, 66)[1:-1]  # steps of NYQUIST around a resonance
INSIDE = 0.998  # of the limit of K_p, the largest gain that is tried
STEPS = 40  # of K_p


# -- structures --------------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Structure:
    """One reading of the paper: what acts between command and weight on bit."""

    name: str
    law: str = "natural frequency"  # of the valve: natural frequency, -3 dB, first order, two lags
    oil: str = "compliant"  # compliant, damped, rigid
    masses: str = "three"  # three, no wires, 163 t, 130 t
    feedback: str = "crown"  # crown; stroke: cylinder position plus measured heave
    friction: str = "odd"  # odd, printed
    sampled: bool = False  # controller with a zero-order hold
    euler: bool = False  # integrated by backward Euler with a fixed step
    cascade: bool = False  # u = -K_v (dz/dt + K_p x): the published K_p in 1/s
    resolution: float = 0.0  # of the sweep of K_v, s/m
    flow_gain: bool = False  # of the valve free within the tolerance of its rated flow
    stable: bool = True  # False: a run too short for its instability to grow

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the values that the paper does not give and that act in this structure."""
        names = ["d_string", "equalised", "T_1"]
        names += ["zeta"] * (self.law in ("natural frequency", "-3 dB"))
        names += ["beta", "leakage"] * (self.oil != "rigid") + ["zeta_oil"] * (self.oil == "damped")
        names += ["d_formation"] * (self.masses != "163 t")
        names += ["hook"] * (self.masses in ("three", "no wires")) + ["d_wires"] * (self.masses == "three")
        names += ["T_s"] * self.sampled + ["step"] * self.euler + ["K_q"] * self.flow_gain
        return tuple(names)


# lower bound, upper bound, logarithmic, wide lower, wide upper: the range of data sheets and handbooks, and one far beyond
BOX: dict[str, tuple[float, float, bool, float, float]] = {
    "zeta": (0.5, 1.2, False, 0.3, 3.0),
    "beta": (0.7e9, 1.8e9, True, 0.3e9, 20e9),  # Pa, with 67 L per chamber
    "leakage": (1e-12, 3e-10, True, 1e-13, 1e-8),
    "zeta_oil": (0.0, 0.1, False, 0.0, 1.0),  # of crown block and hook on the oil
    "hook": (50e3, 90e3, False, 50e3, 130e3),
    "d_wires": (5e3, 100e3, True, 1e3, 1000e3),
    "d_string": (1.5e3, 28e3, True, 0.3e3, 280e3),
    "d_formation": (5e3, 255e3, True, 1e3, 2000e3),
    "equalised": (0.0, 1.15, False, 0.0, 1.5),
    "T_1": (1e-3, 50e-3, True, 1e-3, 300e-3),
    "T_s": (1e-2, 0.2, True, 1e-3, 0.5),
    "step": (1e-3, 0.1, True, 1e-3, 0.5),
    "K_q": (0.9 * K_Q, 1.1 * K_Q, False, 0.5 * K_Q, 2 * K_Q),  # m/s; data sheets state the rated flow to 10 %
}
OURS = {"zeta": 0.87, "beta": 1.8e9, "leakage": 2e-11, "zeta_oil": 0.0, "hook": 68e3, "d_wires": 50e3, "d_string": 15e3,
        "d_formation": 220e3, "equalised": 1.03, "T_1": 0.02, "T_s": 0.01, "step": 1e-3, "K_q": K_Q}

BASE = Structure("second order, natural frequency")
STRUCTURES = (
    BASE,
    replace(BASE, name="second order, -3 dB bandwidth", law="-3 dB"),
    replace(BASE, name="first order", law="first order"),
    replace(BASE, name="two equal lags", law="two lags"),
    replace(BASE, name="oil stiffness that damps", oil="damped"),
    replace(BASE, name="valve around the stroke, rigid oil", oil="rigid"),
    replace(BASE, name="-3 dB, rigid oil", law="-3 dB", oil="rigid"),
    replace(BASE, name="first order, rigid oil", law="first order", oil="rigid"),
    replace(BASE, name="crown block and hook as one mass", masses="no wires"),
    replace(BASE, name="crown block and hook as one mass, -3 dB", masses="no wires", law="-3 dB"),
    replace(BASE, name="one mass of 163 t, rigid formation", masses="163 t"),
    replace(BASE, name="one mass of 130 t", masses="130 t"),
    replace(BASE, name="-3 dB, one mass of 163 t", law="-3 dB", masses="163 t"),
    replace(BASE, name="-3 dB, one mass of 130 t", law="-3 dB", masses="130 t"),
    replace(BASE, name="first order, one mass of 163 t", law="first order", masses="163 t"),
    replace(BASE, name="feedback of stroke and measured heave", feedback="stroke"),
    replace(BASE, name="cascade, K_p in 1/s", cascade=True),
    replace(BASE, name="cascade, -3 dB", cascade=True, law="-3 dB"),
    replace(BASE, name="sampled controller", sampled=True),
    replace(BASE, name="backward Euler, fixed step", euler=True),
    replace(BASE, name="backward Euler, one mass of 130 t", euler=True, masses="130 t"),
    replace(BASE, name="friction as printed", friction="printed"),
    replace(BASE, name="friction as printed, -3 dB", friction="printed", law="-3 dB"),
    replace(BASE, name="friction as printed, crown block and hook as one mass", friction="printed", masses="no wires"),
    replace(BASE, name="friction as printed, crown block and hook as one mass, -3 dB", friction="printed", masses="no wires",
            law="-3 dB"),
    replace(BASE, name="friction as printed, rigid oil", friction="printed", oil="rigid"),
    replace(BASE, name="friction as printed, one mass of 130 t", friction="printed", masses="130 t"),
    replace(BASE, name="friction as printed, backward Euler", friction="printed", euler=True),
    replace(BASE, name="friction as printed, first order", friction="printed", law="first order"),
    replace(BASE, name="friction as printed, -3 dB, one mass of 130 t", friction="printed", law="-3 dB", masses="130 t"),
    replace(BASE, name="K_v in steps of 0.05 s/m", resolution=0.05),
    replace(BASE, name="backward Euler, crown block and hook as one mass", euler=True, masses="no wires"),
    replace(BASE, name="friction as printed, backward Euler, crown block and hook as one mass", friction="printed",
            euler=True, masses="no wires"),
    replace(BASE, name="friction as printed, backward Euler, one mass of 130 t", friction="printed", euler=True,
            masses="130 t"),
    replace(BASE, name="friction as printed, backward Euler, -3 dB", friction="printed", euler=True, law="-3 dB"),
    replace(BASE, name="cascade, crown block and hook as one mass", cascade=True, masses="no wires"),
    replace(BASE, name="friction as printed, cascade, crown block and hook as one mass", friction="printed", cascade=True,
            masses="no wires"),
    replace(BASE, name="friction as printed, K_v in steps of 0.05 s/m", friction="printed", resolution=0.05),
    replace(BASE, name="friction as printed, sampled controller", friction="printed", sampled=True),
    replace(BASE, name="run too short to show the instability", stable=False),
    replace(BASE, name="friction as printed, run too short", friction="printed", stable=False),
)
# the same with the flow gain of the valve free; the published K_v of 0.55 s/m is the inverse of 1.82 m/s
FREE_FLOW = tuple(
    replace(structure, name=f"{structure.name}; flow gain free", flow_gain=True) for structure in STRUCTURES
    if structure.friction == "odd" and structure.stable
    and not (structure.euler or structure.sampled or structure.resolution))


def arrays(values: Mapping[str, float]) -> dict[str, Array]:
    """One set of values, as the functions of the structures take it."""
    return {name: np.array([[value]]) for name, value in {**OURS, **values}.items()}


# -- transfer functions ------------------------------------------------------------------------------------------------
def valve(structure: Structure, v: Values, s: Complex, f_n: float) -> Complex:
    """Spool over command."""
    w: Array | float = 2 * np.pi * f_n
    if structure.law == "first order":
        return 1 / (1 + s / w)
    if structure.law == "two lags":
        return 1 / (1 + s / w) ** 2
    if structure.law == "-3 dB":
        b = 1 - 2 * v["zeta"] ** 2
        w = w / np.sqrt(b + np.sqrt(b**2 + 1))
    return 1 / (1 + 2 * v["zeta"] * s / w + (s / w) ** 2)


def structure_below(structure: Structure, v: Values, s: Complex) -> tuple[Complex, Complex]:
    """Dynamic stiffness D of the crown block and everything below, and force on the formation per crown position."""
    string = STRING + v["d_string"] * s
    if structure.masses == "163 t":
        return 163e3 * s**2 + string, string
    formation = FORMATION + v["d_formation"] * s
    if structure.masses == "130 t":
        spring = string * formation / (string + formation)
        return 130e3 * s**2 + spring, spring
    bit = (133e3 - v["hook"]) * s**2 + formation
    hook = v["hook"] * s**2 + string * bit / (string + bit)
    force = formation * string / (string + bit)
    if structure.masses == "no wires":
        return 30e3 * s**2 + hook, force
    wires = WIRES + v["d_wires"] * s
    return 30e3 * s**2 + wires * hook / (wires + hook), force * wires / (wires + hook)


def compliance(structure: Structure, v: Values, s: Complex) -> Complex | float:
    """C s + leakage: flow per load pressure."""
    if structure.oil == "rigid":
        return 0.0
    capacity: Array | Complex = 0.067 / (2 * v["beta"])
    if structure.oil == "damped":
        stiffness = AREA**2 / capacity
        capacity = AREA**2 / (stiffness + 2 * v["zeta_oil"] * np.sqrt(stiffness * 100e3) * s)
    return capacity * s + v["leakage"] + 1e-12


@dataclass(frozen=True)
class Linear:
    """Crown position x = heave z + force F + flow q + spool y, and force on the formation, at some frequencies."""

    heave: Complex
    force: Complex
    flow: Complex
    spool: Complex
    formation: Complex
    dynamic: Complex
    passive: Complex


def linear(structure: Structure, v: Values, s: Complex, slope: float) -> Linear:
    """The open loop; `slope` is the viscous friction between platform and crown block."""
    dynamic, formation = structure_below(structure, v, s)
    passive = GAS * (1 - v["equalised"]) + (GAS_DAMPING + slope) * s
    y = compliance(structure, v, s)
    common = y * (dynamic + passive) + AREA**2 * s
    return Linear((y * passive + AREA**2 * s) / common, -y / common, AREA / common,
                  AREA**2 * v["K_q"] / common, formation, dynamic, passive)


def plane(structure: Structure, v: Values, w: Array) -> Complex:
    """s at the real frequencies w, (m,) or (n, m), or what backward Euler makes of it."""
    w = np.atleast_2d(w)
    if not structure.euler:
        return np.asarray(1j * w)
    step = v["step"]
    return np.asarray((1 - np.exp(-1j * w * step)) / step)


def hold(structure: Structure, v: Values, s: Complex) -> Complex | float:
    """The zero-order hold of a sampled controller."""
    if not structure.sampled:
        return 1.0
    return (1 - np.exp(-s * v["T_s"])) / (s * v["T_s"])


def slopes(friction: bool) -> tuple[float, ...]:
    """Viscous friction at which the loop must be stable: sliding, over the motion (describing function), at rest."""
    return (SIGMA_2, SIGMA_2 + 4 * F_C / (np.pi * OMEGA * HEAVE), 1e7) if friction else (0.0,)


def open_loops(structure: Structure, v: Values, friction: bool, w: Array = NYQUIST) -> list[tuple[Complex, Complex]]:
    """(n, m) s and crown position per spool, for each of `slopes`, with more frequencies around the two highest resonances:
    a weakly damped one crosses the real axis twice within a step of `w`, which are in geometric progression."""
    found, ratio = [], w[1] / w[0]
    for slope in slopes(friction):
        at = plane(structure, v, w)
        size = np.abs(linear(structure, v, at, slope).spool * at)
        inner = size[:, 1:-1]
        peaks = np.where((inner >= size[:, :-2]) & (inner > size[:, 2:]), inner, 0).argsort(axis=1)[:, -2:] + 1
        around = (w[peaks][:, :, None] * ratio**AROUND).reshape(len(size), -1)
        every = np.sort(np.concatenate([np.broadcast_to(w, size.shape), around], axis=1), axis=1)
        if structure.euler:
            every = np.minimum(every, 0.999 * np.pi / v["step"])  # beyond it the discrete equations repeat themselves
        s = plane(structure, v, every)
        found.append((s, linear(structure, v, s, slope).spool))
    return found


def limit_of_gain(structure: Structure, v: Values, f_n: float, loops: Sequence[tuple[Complex, Complex]]) -> Array:
    """(n,) largest stable K_p: the first crossing of the Nyquist plot with the negative real axis, over all `open_loops`."""
    found = []
    for s, open_loop in loops:
        loop = open_loop * valve(structure, v, s, f_n) * hold(structure, v, s)
        a, b = loop[:, :-1], loop[:, 1:]
        share = a.imag / np.where(a.imag == b.imag, 1, a.imag - b.imag)
        real = a.real + share * (b.real - a.real)
        crossing = (a.imag * b.imag < 0) & (real < 0)
        found.append(1 / np.maximum(np.where(crossing, -real, 0).max(axis=1), 1e-9))
    return np.asarray(np.min(found, axis=0))


def eigenfrequency(structure: Structure, v: Values) -> Array:
    """(n,) Hz, undamped natural frequency of the passive machine without friction, by Newton's method from 0.23 Hz."""
    s: Complex = np.full((len(v["equalised"]), 1), 2j * np.pi * EIGENFREQUENCY - 0.3)

    def stiffness(s: Complex) -> Complex:
        return np.asarray(structure_below(structure, v, s)[0] + GAS * (1 - v["equalised"]) + GAS_DAMPING * s)

    for _ in range(12):
        h = 1e-5
        step = stiffness(s) * 2 * h / (stiffness(s + h) - stiffness(s - h))
        s = np.asarray(s - step)
    return np.asarray(np.abs(s[:, 0])) / (2 * np.pi)


# -- periodic disturbances ---------------------------------------------------------------------------------------------
FORWARD = np.exp(-1j * OMEGA * np.outer(HALF, ODD)) * 2 / len(HALF)  # samples of half a period to odd harmonics
BACK = np.exp(1j * OMEGA * np.outer(ODD, HALF))


def dry_friction(structure: Structure, speed: Array) -> Array:
    """Friction without its viscous part; the constant part of the printed equation is balanced by the preload."""
    bell = np.exp(-((speed / V_S) ** 2))
    if structure.friction == "printed":
        return (F_S * np.abs(np.tanh(XI * speed)) - F_C) * bell * np.tanh(XI * speed)
    return (F_C + F_P + (F_S - F_C) * bell) * np.tanh(XI * speed)


def missing_flow(v: Values, spool: Array, pressure: Array) -> Array:
    """Flow of the two metering edges under load, less that without load."""
    return np.asarray(AREA * v["K_q"] * spool * (np.sqrt(np.clip(1 - np.sign(spool) * pressure / SUPPLY, 0, 2)) - 1))


@dataclass(frozen=True)
class Cell:
    """Gains that minimise the index, the limit of K_p, and the variation of the weight on bit in kN; (n,) each."""

    K_p: Array
    K_v: Array
    limit: Array
    WOB: Array


def cell(structure: Structure, v: Values, friction: bool, f_n: float, rounds: int = 4) -> Cell:
    """One cell of the published table."""
    return cells(structure, v, friction, (f_n,), rounds)[0]


def cells(structure: Structure, v: Values, friction: bool, valves: Sequence[float] = VALVES, rounds: int = 4,
          w: Array = NYQUIST) -> list[Cell]:
    """A row of the published table; `w` are the frequencies of the Nyquist plot."""
    loops = open_loops(structure, v, friction, w)
    s = plane(structure, v, HARMONICS)
    machine = linear(structure, v, s, slopes(friction)[0])
    return [tuned(structure, v, s, machine, friction, f_n, limit_of_gain(structure, v, f_n, loops), rounds)
            for f_n in valves]


def tuned(structure: Structure, v: Values, s: Complex, machine: Linear, friction: bool, f_n: float, limit: Array,
          rounds: int) -> Cell:
    """The gains of a cell; disturbances and gains follow from each other in some rounds."""
    most = np.minimum(INSIDE * limit, LARGEST_K_P) if structure.stable else np.full_like(limit, LARGEST_K_P)
    grid = np.linspace(1 / STEPS, 1, STEPS)[None, :] * most[:, None]
    z = np.where(ODD == 1, -1j * HEAVE, 0)[None, :]
    measured = z / (1 + v["T_1"] * s)
    law = valve(structure, v, s, f_n) * hold(structure, v, s)
    held = law * machine.spool
    error = measured - z if structure.feedback == "stroke" else 0 * measured
    x, spool = np.zeros_like(measured), -s * z / v["K_q"] + 0 * v["T_1"]
    force, flow = x, x
    for k in range(rounds):
        sliding = ((x - z) * s) @ BACK
        new_force = dry_friction(structure, sliding.real) @ FORWARD if friction else 0 * x
        pressure = (machine.dynamic * x + machine.passive * (x - z) + new_force) / AREA
        new_flow = missing_flow(v, (spool @ BACK).real, (pressure @ BACK).real) @ FORWARD
        mix = 1.0 if k == 0 else 0.5
        force, flow = force + mix * (new_force - force), flow + mix * (new_flow - flow)
        free = machine.heave * z + machine.force * force + machine.flow * flow
        k_p, k_v = gains(grid, free, held, held * measured * s, held * error, s, REFERENCE[friction], structure.resolution)
        feed = k_v[:, None] * measured * s
        x = (free - held * (feed + k_p[:, None] * error)) / (1 + k_p[:, None] * held)
        spool = -law * (k_p[:, None] * (x + error) + feed)
    wob = np.abs(((machine.formation * x) @ BACK).real).max(axis=1) / 1e3
    return Cell(k_p, k_v, limit, wob)


def squared(z: Complex) -> Array:
    """Squared magnitude."""
    return np.asarray(z.real**2 + z.imag**2)


def gains(grid: Array, free: Complex, held: Complex, forward: Complex, shift: Complex, s: Complex,
          reference: float, resolution: float) -> tuple[Array, Array]:
    """(n,) K_p and K_v of the smallest index. K_v acts on the fundamental alone, both parts of the index there alike."""
    first = free[:, :1] - grid * shift[:, :1]
    feed = forward[:, :1]
    k_v = np.clip((first * feed.conj()).real / np.abs(feed) ** 2, 0, 1.2)
    if resolution:
        k_v = np.round(k_v / resolution) * resolution
    # |1 + K_p held|**2 and |free - K_p shift|**2 as polynomials in K_p
    k, feedback, square = grid[:, :, None], squared(held)[:, None, :], squared(free)[:, None, :]
    closed = 1 + k * (2 * held.real[:, None, :] + k * feedback)
    if shift.any():
        square = square - k * (2 * (free * shift.conj()).real[:, None, :] - k * squared(shift)[:, None, :])
    kept = square / closed
    kept[:, :, 0] = squared(first - k_v * feed) / closed[:, :, 0]
    position = np.sqrt(kept.sum(axis=2))
    speed = np.sqrt((kept @ squared(s)[:, :, None])[:, :, 0])
    index = position + speed / reference
    best, rows = index.argmin(axis=1), np.arange(len(grid))
    inner = np.clip(best, 1, STEPS - 2)
    a, b, c = (index[rows, inner + k] for k in (-1, 0, 1))
    bend = a - 2 * b + c
    vertex = np.clip((a - c) / (2 * np.where(bend > 0, bend, 1)), -1, 1)
    offset = np.where((best == inner) & (bend > 0), vertex, best - inner)
    k_p = grid[rows, inner] + offset * grid[:, 0]
    return k_p, k_v[rows, best]


def numbers(structure: Structure, v: Values, w: Array = NYQUIST) -> Array:
    """(n, 15) what PUBLISHED lists: ten cells, K_p and K_v at 0.75 Hz with and without friction, eigenfrequency."""
    found = dict(zip(CELLS, [one for friction in TABLE for one in cells(structure, v, friction, w=w)], strict=True))
    k_p = [found[friction, 0.75].K_p for friction in TABLE]
    k_v = [found[friction, 0.75].K_v for friction in TABLE]
    if structure.cascade:
        k_p = [a / b for a, b in zip(k_p, k_v, strict=True)]
    return np.column_stack([*(found[key].WOB for key in CELLS), *k_p, *k_v, eigenfrequency(structure, v)])
