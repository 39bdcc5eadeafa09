"""The equations of the large machines as a person writes them for CasADi, in a loop over their parts. SI units."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
G = 9.81


@dataclass(frozen=True)
class Flat:
    """x' = ode(t, x) for states counted in their `sizes`, from x0; `signals` are the numbers of states to compare by the
    names that the diagram has for them."""

    t: ca.SX
    x: ca.SX
    ode: ca.SX
    x0: Array
    sizes: Array
    signals: Mapping[str, int]


class _States:
    """States as they are written down, with their sizes, starts and rates."""

    def __init__(self) -> None:
        self.scaled: list[ca.SX] = []
        self.sizes: list[float] = []
        self.starts: list[float] = []
        self.rates: dict[int, ca.SX] = {}
        self.named: dict[str, int] = {}

    def new(self, name: str, size: float = 1.0, start: float = 0.0) -> ca.SX:
        """A state in SI."""
        self.named[name] = len(self.scaled)
        self.scaled.append(ca.SX.sym(name))
        self.sizes.append(size)
        self.starts.append(start)
        return size * self.scaled[-1]

    def rate(self, name: str, value: ca.SX) -> None:
        """d/dt of a state in SI."""
        self.rates[self.named[name]] = value

    def flat(self, t: ca.SX, signals: Mapping[str, str]) -> Flat:
        """Everything, with the states to compare: the diagram's name to the one here."""
        sizes = np.array(self.sizes)
        ode = ca.vertcat(*(self.rates[k] / size for k, size in enumerate(self.sizes)))
        return Flat(t, ca.vertcat(*self.scaled), ode, np.array(self.starts) / sizes, sizes,
                    {theirs: self.named[ours] for theirs, ours in signals.items()})


def _root(dp: ca.SX, dp_t: float = 1e4) -> ca.SX:
    """Signed square root of a pressure drop with a laminar transition."""
    return dp / ca.sqrt(ca.sqrt(dp * dp + dp_t * dp_t))


# -- the compensator with a drill string in pieces -----------------------------------------------------------------------
def drill_string(n: int) -> Flat:
    """The compensator of `reference_cmc_ahc.py`, at the values that drill_string.yaml sets, with hook, n pieces of
    string and bit in place of two masses."""
    s, t = _States(), ca.SX.sym("t")
    wob, c, d, piece = 30e3, 298e3 * n, 15e3 * n, 80e3 / n
    masses = [50e3 + piece / 2, *[piece] * (n - 1), 3e3 + piece / 2]
    heights = [-((sum(masses)) * G - wob) / 4e6]
    for k in range(n):  # what hangs below a piece stretches it
        heights.append(heights[-1] - (sum(masses[k + 1:]) * G - wob) / c)
    preload, seabed = (30e3 + sum(masses)) * G - wob, heights[-1] + wob / 1e6
    x, v = s.new("x"), s.new("v")
    xs = [s.new(f"x_{k}", 1, height) for k, height in enumerate(heights)]
    vs = [s.new(f"v_{k}") for k in range(n + 1)]
    w, fade = 2 * math.pi / 12, ca.exp(-((t / 6) ** 3))
    z, dz = 0.5 * (1 - fade) * ca.sin(w * t), 0.5 * (3 * t**2 / 6**3 * fade * ca.sin(w * t) + (1 - fade) * w * ca.cos(w * t))
    lift = _lift(x - z, v - dz, preload) + _active(s, x, z, v - dz)
    forces = [4e6 * (x - xs[0]) + 50e3 * (v - vs[0])]
    forces += [c * (xs[k] - xs[k + 1]) + d * (vs[k] - vs[k + 1]) for k in range(n)]
    e = ca.fmax(seabed - xs[-1], 0)
    forces.append(-ca.fmax(1e6 * e - 220e3 * vs[-1] * ca.fmin(e / 1e-3, 1), 0))
    s.rate("x", v)
    s.rate("v", (lift - forces[0]) / 30e3 - G)
    for k, mass in enumerate(masses):
        s.rate(f"x_{k}", vs[k])
        s.rate(f"v_{k}", (forces[k] - forces[k + 1]) / mass - G)
    return s.flat(t, {"crown.x": "x", "drilling.hook.x": "x_0", "drilling.bit.x": f"x_{n}", "ahc.chamber_a.p": "p_a",
                      "ahc.valve.x": "y"})


def _lift(s: ca.SX, v: ca.SX, preload: float) -> ca.SX:
    """Gas spring and equalisers less friction."""
    thrust = preload - 42e3 * s - 52e3 * v
    pressure = thrust / (math.pi / 4 * 0.4**2)
    dry = 12e3 + (22.8e3 - 12e3) * ca.exp(-((v / 0.1) ** 2)) + 0.4e-4 * ca.fmax(pressure, 0)
    return thrust + 2 * 69e-4 * pressure * s / ca.sqrt(s**2 + 16) - dry * ca.tanh(v / 1e-3) - 10e3 * v


def _active(states: _States, x: ca.SX, z: ca.SX, v: ca.SX) -> ca.SX:
    """The thrust of the active cylinder, with its valve, its controller and the motion reference unit."""
    p_a, p_b = states.new("p_a", 1e7, 172.5e5), states.new("p_b", 1e7, 172.5e5)
    y, rate, heave = states.new("y"), states.new("w"), states.new("heave")
    area, volume, beta, supply, gain = math.pi / 2 * (0.2**2 - 0.17**2), 0.067, 1.8e9, 345e5, 920 / 60e3 / math.sqrt(35e5)
    y_p, y_n, swept, across = ca.fmax(y, 0), ca.fmax(-y, 0), area * v, 2e-11 * (p_a - p_b)
    q_a = gain * (y_p * _root(supply - p_a) - y_n * _root(p_a)) + 1e-12 * (supply - 2 * p_a) - across
    q_b = gain * (y_n * _root(supply - p_b) - y_p * _root(p_b)) + 1e-12 * (supply - 2 * p_b) + across
    measured = (z - heave) / 0.02
    u = ca.fmin(ca.fmax(-3.02 * x - 0.55 * measured, -1), 1)
    w_n = 2 * math.pi * 0.75
    states.rate("p_a", beta / (volume + area * (x - z)) * (q_a - swept))
    states.rate("p_b", beta / (volume - area * (x - z)) * (q_b + swept))
    states.rate("y", rate)
    states.rate("w", w_n**2 * (u - y) - 2 * 0.87 * w_n * rate)
    states.rate("heave", measured)
    return area * (p_a - p_b)


# -- a pipe in cells -----------------------------------------------------------------------------------------------------
def line(n: int) -> Flat:
    """Pump flow into n cells of pipe, laminar or turbulent, and a throttle at the end."""
    s, t = _States(), ca.SX.sym("t")
    rho, nu, beta, diameter, rough, length = 870.0, 10e-6, 1.4e9, 0.02, 1.5e-6, 100 / n
    area = math.pi / 4 * diameter**2
    p = [s.new(f"p_{k}", 1e5) for k in range(n + 1)]
    q = [s.new(f"q_{k}", 1e-3) for k in range(n)]
    pump = 40 / 60e3 * (1 - ca.exp(-((t / 0.2) ** 2))) * (1 + 0.5 * ca.sin(2 * math.pi * t / 0.5))
    flows = [pump, *q, 40 / 60e3 / math.sqrt(50e5) * _root(p[-1])]
    for k in range(n + 1):
        share = 0.5 if k in (0, n) else 1.0
        s.rate(f"p_{k}", (flows[k] - flows[k + 1]) / (share * length * area / beta))
    for k in range(n):
        reynolds = ca.fabs(q[k]) * diameter / (area * nu)
        y = ca.fmin(ca.fmax((reynolds - 2300) / 1700, 0), 1)
        y = y**2 * (3 - 2 * y)
        f = (1.8 / math.log(10) * ca.log((rough / (3.7 * diameter)) ** 1.11 + 6.9 / ca.fmax(reynolds, 2300))) ** -2
        lost = ((1 - y) * 32 * rho * nu * length / diameter**2 * q[k] / area
                + y * f * length / diameter * rho / 2 * q[k] * ca.fabs(q[k]) / area**2)
        s.rate(f"q_{k}", (p[k] - p[k + 1] - lost) * area / (rho * length))
    return s.flat(t, {"inlet.p": "p_0", "outlet.p": f"p_{n}", f"pipe.segment_{n // 2}.q": f"q_{n // 2 - 1}"})


# -- cylinders on one supply ---------------------------------------------------------------------------------------------
def cylinders(n: int) -> Flat:
    """A pump with a relief valve, and n cylinders that swing a mass each."""
    s, t = _States(), ca.SX.sym("t")
    p, open_ = s.new("p", 1e5, 200e5), s.new("open")
    area_a, area_b, volume, beta, w_n = 20e-4, 12e-4, 2e-3, 1.2e9, 2 * math.pi * 20
    gain, taken = 20 / 60e3 / math.sqrt(35e5), ca.SX(0)
    for k in range(1, n + 1):
        x, v, p_a, p_b = s.new(f"x_{k}"), s.new(f"v_{k}"), s.new(f"p_a_{k}", 1e5), s.new(f"p_b_{k}", 1e5)
        y, w = s.new(f"y_{k}"), s.new(f"w_{k}")
        y_p, y_n, leak = ca.fmax(y, 0), ca.fmax(-y, 0), 2e-13 * (p_a - p_b)
        q_pa, q_at = gain * y_p * _root(p - p_a), gain * y_n * _root(p_a)
        q_pb, q_bt = gain * y_n * _root(p - p_b), gain * y_p * _root(p_b)
        taken += q_pa + q_pb
        command = 0.5 * ca.sin(2 * math.pi * t / (1 + 0.02 * k))
        s.rate(f"x_{k}", v)
        s.rate(f"v_{k}", (area_a * p_a - area_b * p_b - 100e3 * x - 4e3 * v) / (200 + 3 * k))
        s.rate(f"p_a_{k}", beta / (volume + area_a * x) * (q_pa - q_at - leak - area_a * v))
        s.rate(f"p_b_{k}", beta / (volume - area_b * x) * (q_pb - q_bt + leak + area_b * v))
        s.rate(f"y_{k}", w)
        s.rate(f"w_{k}", w_n**2 * (command - y) - 2 * 0.8 * w_n * w)
    relieved = 1500 / 60e3 / math.sqrt(220e5) * ca.fmax(open_, 0) * _root(p)
    s.rate("p", 1.2e9 / 0.1 * (1200 / 60e3 - relieved - taken))
    s.rate("open", (ca.fmin(ca.fmax((p - 200e5) / 20e5, 0), 1) - open_) / 0.02)
    return s.flat(t, {"supply.p": "p", "c_001.load.x": "x_1", "c_100.load.x": f"x_{n}", "c_050.A.p": "p_a_50"})
