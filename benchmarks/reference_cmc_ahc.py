"""The crown-mounted compensator as flat ordinary differential equations, to compare `models/cmc_ahc` with.

Nothing here comes from the diagram: the equations were set up by hand, with upward positions x_1 (crown block),
x_2 (travelling block and top drive), x_3 (bit) and z (platform), chamber pressures p_A, p_B and spool position y:

    m_1 a_1 = F_gas + F_eq - F_fric + F_ahc - F_wire - m_1 g
    m_2 a_2 = F_wire - F_string - m_2 g
    m_3 a_3 = F_string + N - m_3 g
    V_A/beta dp_A/dt = q_A - A v,   V_B/beta dp_B/dt = q_B + A v
    d2y/dt2 = w^2 (u - y) - 2 zeta w dy/dt,   u = -K_p x_1 - K_v ds/dt within -1..1
    ds/dt = (z - s)/t_m   (the motion reference unit's heave s)

The platform moves as the regular wave of the parameters, or as a heave that is given. SI units throughout.

Effects that the diagram lacks are off in `ACTIVE`:

    polytropic gas               F_gas = F_0 (1 + c s/(n F_0))^-n - d v; n = -1 is the linear spring F_0 - c s
    loss in the supply line      p_P = p_s - K q^2 before the edges, in closed form with the square law of an edge
    air in the oil               isothermal, alpha p_0/(p + p_0) of the volume of the oil
    friction in the drill hole   F_hole tanh(v_3/v_hole) + d_hole v_3 on the bit
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Array = NDArray[np.float64]
Parameters = Mapping[str, float]
Heave = Callable[[float], tuple[float, float]]     # position (m) and velocity (m/s) of the platform at a time (s)

ACTIVE: dict[str, float] = {
    # wave
    "a": 0.5, "T": 12.0, "t_r": 6.0,
    # masses and the structure
    "m_1": 30e3, "m_2": 68e3, "m_3": 65e3, "g": 9.81,
    "k_wire": 4.0e6, "d_wire": 50e3, "k_string": 298e3, "d_string": 15e3,
    "k_form": 1.0e6, "d_form": 220e3, "e_t": 1e-3, "WOB": 30e3,
    # passive part
    "c": 42e3, "d": 52e3, "A_plunger": math.pi / 4 * 0.4**2, "A_eq": 69e-4, "h": 4.0,
    "F_c": 12e3, "F_s": 22.8e3, "v_s": 0.1, "v_t": 1e-3, "sigma_2": 10e3, "k_p": 0.4e-4,
    # active part
    "A": math.pi / 2 * (0.2**2 - 0.17**2), "V_0": 0.067, "beta": 1.8e9, "leak_piston": 2e-11,
    "p_s": 345e5, "q_r": 920 / 60e3, "dp_r": 35e5, "dp_t": 1e4, "leak_edge": 1e-12, "overlap": 0.0,
    "q_bypass": 4000 / 60e3, "dp_bypass": 5e5, "bypass": 0.0,
    "f_n": 0.75, "zeta": 0.87, "K_p": 3.02, "K_v": 0.55, "t_m": 0.02,
    # effects that the diagram lacks
    "n": -1.0, "K_supply": 0.0, "air": 0.0, "p_0": 101325.0, "F_hole": 0.0, "v_hole": 2e-3, "d_hole": 0.0,
}
PASSIVE = {**ACTIVE, "bypass": 1.0, "K_p": 0.0, "K_v": 0.0}
FRICTIONLESS = {"F_c": 0.0, "F_s": 0.0, "sigma_2": 0.0, "k_p": 0.0}

# the size of each state: x_1, v_1, x_2, v_2, x_3, v_3, p_A, p_B, y, dy/dt, s
SIZES = np.array([1, 1, 1, 1, 1, 1, 1e7, 1e7, 1, 1, 1.0])
OUTPUTS = ("WOB", "crown", "crown_speed", "platform", "extension", "p_A", "p_B", "spool", "command", "friction",
           "p_main")


def wave(t: float, p: Parameters) -> tuple[float, float]:
    """Platform position z = a (1 - exp(-(t/t_r)^3)) sin(2 pi t/T) and its velocity."""
    w, fade = 2 * math.pi / p["T"], math.exp(-(t / p["t_r"])**3)
    eased, growth = 1 - fade, 3 * t**2 / p["t_r"]**3 * fade
    return (p["a"] * eased * math.sin(w * t),
            p["a"] * (growth * math.sin(w * t) + eased * w * math.cos(w * t)))


def steady(p: Parameters) -> tuple[Array, float, float]:
    """State (11,) at rest with x_1 = 0 and the wanted weight on bit; the gas preload and the sea bed's height."""
    preload = (p["m_1"] + p["m_2"] + p["m_3"]) * p["g"] - p["WOB"]
    x_2 = -((p["m_2"] + p["m_3"]) * p["g"] - p["WOB"]) / p["k_wire"]
    x_3 = x_2 - (p["m_3"] * p["g"] - p["WOB"]) / p["k_string"]
    half = p["p_s"] / 2
    return np.array([0, 0, x_2, 0, x_3, 0, half, half, 0, 0, 0.0]), preload, x_3 + p["WOB"] / p["k_form"]


def command(z: float, y: Array, p: Parameters) -> float:
    """Valve command: feedback of the crown block's position, feed-forward of the rate of the measured heave."""
    return float(min(max(-p["K_p"] * y[0] - p["K_v"] * (z - y[10]) / p["t_m"], -1.0), 1.0))


def passive_forces(z: float, dz: float, y: Array, p: Parameters, preload: float) -> tuple[float, float, float]:
    """Upward force of gas spring and equalisers on the crown block, friction holding it back, oil pressure."""
    s, v = y[0] - z, y[1] - dz
    n = p["n"]
    thrust = preload * (1 + p["c"] * s / (n * preload)) ** -n - p["d"] * v
    pressure = thrust / p["A_plunger"]
    equaliser = 2 * p["A_eq"] * pressure * s / math.hypot(s, p["h"])
    dry = p["F_c"] + (p["F_s"] - p["F_c"]) * math.exp(-(v / p["v_s"])**2) + p["k_p"] * max(pressure, 0.0)
    return thrust + equaliser, dry * math.tanh(v / p["v_t"]) + p["sigma_2"] * v, pressure


def contact(y: Array, p: Parameters, seabed: float) -> float:
    """Compressive force of the formation on the bit, never tensile."""
    e = max(seabed - y[4], 0.0)
    return float(max(p["k_form"] * e - p["d_form"] * y[5] * min(e / p["e_t"], 1.0), 0.0))


def root(dp: float, dp_t: float) -> float:
    """Signed square root of a pressure drop with a laminar transition of size dp_t."""
    return dp / math.sqrt(math.hypot(dp, dp_t))


def chamber_flows(y: Array, p: Parameters) -> tuple[float, float]:
    """Net flow into chambers A and B from valve, leakage and bypass."""
    p_a, p_b, spool = y[6], y[7], y[8]
    gain, leak, source, t = p["q_r"] / math.sqrt(p["dp_r"]), p["leak_edge"], p["p_s"], p["dp_t"]
    up, down = max(spool - p["overlap"], 0.0), max(-spool - p["overlap"], 0.0)     # openings P-A and B-T, P-B and A-T
    lossy = gain / math.sqrt(1 + p["K_supply"] * (gain * (up + down))**2)     # edge and supply line in series
    q_a = lossy * up * root(source - p_a, t) - gain * down * root(p_a, t)
    q_b = lossy * down * root(source - p_b, t) - gain * up * root(p_b, t)
    across = (p["bypass"] * p["q_bypass"] / math.sqrt(p["dp_bypass"]) * root(p_a - p_b, t)
              + p["leak_piston"] * (p_a - p_b))
    return q_a + leak * (source - 2 * p_a) - across, q_b + leak * (source - 2 * p_b) + across


def compressibility(pressure: float, p: Parameters) -> float:
    """Of oil and free air at a pressure above the atmosphere, 1/Pa."""
    absolute = pressure + p["p_0"]
    share = p["air"] * p["p_0"] / absolute
    return (1 / p["beta"] + share / absolute) / (1 + share)


def derivative(z: float, dz: float, y: Array, p: Parameters, preload: float, seabed: float) -> Array:
    """d(state)/dt (11,) where the platform is at z and moves at dz."""
    x_1, v_1, x_2, v_2, x_3, v_3, p_a, p_b, spool, rate, heave = y
    lift, friction, _ = passive_forces(z, dz, y, p, preload)
    wire = p["k_wire"] * (x_1 - x_2) + p["d_wire"] * (v_1 - v_2)
    string = p["k_string"] * (x_2 - x_3) + p["d_string"] * (v_2 - v_3)
    q_a, q_b = chamber_flows(y, p)
    swept, w = p["A"] * (v_1 - dz), 2 * math.pi * p["f_n"]
    hole = p["F_hole"] * math.tanh(v_3 / p["v_hole"]) + p["d_hole"] * v_3
    return np.array([
        v_1, (lift - friction + p["A"] * (p_a - p_b) - wire) / p["m_1"] - p["g"],
        v_2, (wire - string) / p["m_2"] - p["g"],
        v_3, (string + contact(y, p, seabed) - hole) / p["m_3"] - p["g"],
        (q_a - swept) / (p["V_0"] + p["A"] * (x_1 - z)) / compressibility(p_a, p),
        (q_b + swept) / (p["V_0"] - p["A"] * (x_1 - z)) / compressibility(p_b, p),
        rate, w**2 * (command(z, y, p) - spool) - 2 * p["zeta"] * w * rate,
        (z - heave) / p["t_m"]])


def outputs(z: float, dz: float, y: Array, p: Parameters, preload: float, seabed: float) -> tuple[float, ...]:
    """The values named in OUTPUTS, as the diagram shows them, in SI."""
    _, friction, pressure = passive_forces(z, dz, y, p, preload)
    return (contact(y, p, seabed), y[0], y[1], z, y[0] - z, y[6], y[7], y[8], command(z, y, p), friction,
            pressure)


def simulate(p: Parameters, times: Array, *, heave: Heave | None = None, rtol: float = 1e-11) -> dict[str, Array]:
    """Each output (n,) at `times` (n,), which begin at 0, from the steady start; RuntimeError if SciPy fails.

    `heave`: motion of the platform, at rest at z = 0 in the beginning; without it the wave of the parameters.
    """
    start, preload, seabed = steady(p)
    moving = heave or (lambda t: wave(t, p))

    def scaled(t: float, y: Array) -> Array:
        return np.asarray(derivative(*moving(t), y * SIZES, p, preload, seabed) / SIZES)

    run = solve_ivp(scaled, (0.0, float(times[-1])), start / SIZES, method="LSODA", t_eval=times, rtol=rtol,
                    atol=rtol * 1e-2)
    if not run.success:
        raise RuntimeError(run.message)
    table = np.array([outputs(*moving(t), y * SIZES, p, preload, seabed) for t, y in zip(run.t, run.y.T, strict=True)])
    return dict(zip(OUTPUTS, table.T, strict=True))
