"""A compensator of eight states: the diagram `heave.yaml` against its equations written down for CasADi by hand."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
STATES = ("crown.x", "crown.v", "bit.x", "bit.v", "chamber_a.p", "chamber_b.p", "valve.x", "valve.w")
START = (0.0, 0.0, 0.0, 0.0, 172.5e5, 172.5e5, 0.0, 0.0)
UNTIL, POINTS = 60.0, 6000
PARAMETERS = {
    "K_p": 1.0, "K_v": 0.55, "F_c": 12e3, "F_s": 22.8e3, "sigma_2": 10e3, "beta": 1e9, "c": 42e3, "d": 52e3, "f_n": 0.75,
    "zeta": 0.8}


def rates(t: ca.SX, x: ca.SX, p: ca.SX) -> ca.SX:
    """x' (8,) of the states in the order of STATES; p (10,) in the order of PARAMETERS; all in SI."""
    x_c, v_c, x_b, v_b, p_a, p_b, y, w = ca.vertsplit(x)
    k_p, k_v, f_c, f_s, sigma_2, beta, c, d, f_n, zeta = ca.vertsplit(p)
    area, volume, supply, frequency = 0.0174, 0.067, 345e5, 2 * math.pi / 12
    z, dz = 0.5 * ca.sin(frequency * t), 0.5 * frequency * ca.cos(frequency * t)
    s, v = x_c - z, v_c - dz
    sign = ca.tanh(v / 1e-3)
    friction = (f_c + (f_s * ca.fabs(sign) - f_c) * ca.exp(-((v / 0.1) ** 2))) * sign + sigma_2 * v
    string = 4e6 * (x_c - x_b) + 1e5 * (v_c - v_b)
    ground = 229.6e3 * x_b + 2e4 * v_b
    rated = 2 * 460 / 60000 / math.sqrt(35e5) * y
    q_a = rated * ca.if_else(y >= 0, _orifice(supply - p_a), _orifice(p_a))
    q_b = -rated * ca.if_else(y >= 0, _orifice(p_b), _orifice(supply - p_b))
    u = ca.fmin(ca.fmax(-k_p * x_c - k_v * dz, -1), 1)
    w_n = 2 * math.pi * f_n
    return ca.vertcat(
        v_c, (area * (p_a - p_b) - friction - c * s - d * v - string) / 80e3,
        v_b, (string - ground) / 83e3,
        beta / (volume + area * s) * (q_a - area * v), beta / (volume - area * s) * (q_b + area * v),
        w, w_n * w_n * (u - y) - 2 * zeta * w_n * w)


def _orifice(dp: ca.SX) -> ca.SX:
    return dp / ca.sqrt(ca.sqrt(dp * dp + 1e4 * 1e4))


def by_hand(rtol: float, atol: float) -> ca.Function:
    """The integrator of the flat equations, from 0 to UNTIL in POINTS steps."""
    t, x, p = ca.SX.sym("t"), ca.SX.sym("x", 8), ca.SX.sym("p", len(PARAMETERS))
    times = np.linspace(UNTIL / POINTS, UNTIL, POINTS).tolist()
    return ca.integrator("flat", "idas", {"x": x, "t": t, "p": p, "ode": rates(t, x, p)}, 0, times,
                         {"reltol": rtol, "abstol": atol, "max_num_steps": 10**6})
