"""Oil by itself, for tests: its specific volume by definition, everything else from that by quadrature and differences.

The library integrates dh = c_p dT + (v - T dv/dT) dp by hand; here a Gauss rule does it, so that a slip of either shows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

NODES, WEIGHTS = np.polynomial.legendre.leggauss(4)


@dataclass(frozen=True)
class OilData:
    """The defaults of `Oil`, in SI."""

    rho: float = 860.0
    alpha: float = 7e-4
    beta: float = 1.4e9
    k_T: float = 6e-3
    c_p: float = 1950.0
    T_0: float = 313.15
    nu_40: float = 46e-6
    nu_100: float = 6.8e-6

    def v(self, p: float, T: float) -> float:
        """Specific volume: expansion by temperature, compressibility that grows with it."""
        return (1 + self.alpha*(T - self.T_0))/self.rho - p*(1 + self.k_T*(T - self.T_0))/(self.rho*self.beta)

    def v_T(self, p: float, T: float) -> float:
        """dv/dT by a difference, exact for what is linear in T."""
        return (self.v(p, T + 1) - self.v(p, T - 1))/2

    def v_p(self, p: float, T: float) -> float:
        """dv/dp by a difference, exact for what is linear in p."""
        return (self.v(p + 1e5, T) - self.v(p - 1e5, T))/2e5

    def h(self, p: float, T: float) -> float:
        """Specific enthalpy: along T at p = 0, then along p at T, by a Gauss rule that is exact up to degree 7."""
        at = p*(NODES + 1)/2
        along = sum(w*(self.v(q, T) - T*self.v_T(q, T)) for w, q in zip(WEIGHTS, at, strict=True))
        return self.c_p*(T - self.T_0) + p/2*along

    def u(self, p: float, T: float) -> float:
        """Specific internal energy, but for the constant of the atmosphere."""
        return self.h(p, T) - p*self.v(p, T)

    def nu(self, T: float) -> float:
        """Kinematic viscosity in m**2/s by ASTM D341, in decadic logarithms as the standard has it."""
        z = [np.log10(np.log10(nu*1e6 + 0.7)) for nu in (self.nu_40, self.nu_100)]
        slope = (z[1] - z[0])/np.log10(373.15/313.15)
        return float(10**(10**(z[0] + slope*np.log10(T/313.15))) - 0.7)*1e-6


OIL = OilData()
"""Mineral oil ISO VG 46, as the library has it."""


def rated(q_r: float, dp_r: float, dp: float, dp_t: float = 1e4) -> float:
    """Flow of an orifice by its rating, linear around zero."""
    return q_r*np.sqrt(1/dp_r)*dp/(dp**2 + dp_t**2)**0.25
