"""Gas flow by ISO 6358 and initial value problems for tests, by SciPy; nothing of heavebond is used."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Array = NDArray[np.float64]
R, KAPPA, T_0, RHO_0, P_0 = 287.05, 1.4, 293.15, 1.185, 101325.0
C_V, C_P = R/(KAPPA - 1), 1005.0  # c_p of the components is that of tables, 3e-4 above kappa*R/(kappa - 1)
RT = R*T_0
LAMINAR = 0.999


def iso(C: float, b: float, p_1: float, p_2: float, m: float = 0.5, T_1: float = T_0) -> float:
    """Mass flow from p_1 to p_2 by ISO 6358; the last thousandth of the pressure ratio is straight, to be integrable."""
    if p_2 > p_1:
        return -iso(C, b, p_2, p_1, m, T_1)
    ratio = p_2/p_1
    share = 1 - (max(min(ratio, LAMINAR) - b, 0.0)/(1 - b))**2
    return C*RHO_0*p_1*float(share**m)*float(np.sqrt(T_0/T_1))*min((1 - ratio)/(1 - LAMINAR), 1.0)


def integrated(rate: Callable[[float, Array], Sequence[float]], start: Sequence[float], t: Array,
               breaks: Sequence[float] = (), rtol: float = 1e-10) -> Array:
    """The states (n, N) of an initial value problem at the times t, begun anew at the breaks of its inputs."""
    found = np.empty((len(start), t.size))
    state = np.array(start, float)
    for begin, end in pairwise([0.0, *breaks, t[-1]]):
        inside = (t >= begin) & (t <= end)
        times = np.union1d(t[inside], [begin, end])
        run = solve_ivp(rate, (begin, end), state, "LSODA", t_eval=times, rtol=rtol, atol=1e-8)
        assert run.success, run.message
        found[:, inside] = run.y[:, np.searchsorted(run.t, t[inside])]
        state = run.y[:, -1]
    return found
