"""Hydraulic components beside formulas of their sources."""

from __future__ import annotations

import numpy as np
from library_check import agree, checks, part

bar, L, minute = 1e5, 1e-3, 60.0
# drops in both directions, none, small and large
DROPS = np.array([-300, -20, -1, 0, 1e-3, 0.5, 5, 120])*bar


def root(dp: np.ndarray) -> np.ndarray:
    """The signed root of the law of Bernoulli."""
    return np.sign(dp)*np.sqrt(np.abs(dp))


@checks("Orifice")
def test_orifice() -> None:
    found = part("Orifice", q_r="30 L/min", dp_r="10 bar", dp_t="1e-3 Pa")({"a.p": 40*bar + DROPS, "b.p": 40*bar})
    agree(found["a.q"], 30*L/minute*root(DROPS)/np.sqrt(10*bar), rtol=1e-8)
    agree(found["b.q"], -found["a.q"])


@checks("AnnularGap")
def test_annular_gap() -> None:
    law = part("AnnularGap", d="20 mm", gap="10 um", length="15 mm", eccentricity="0.4", rho="870 kg/m**3", nu="46 mm**2/s")
    found = law({"a.p": DROPS, "b.p": 0})
    # Merritt, (2-40): Q = pi d c**3/(12 mu L) (1 + 1.5 (e/c)**2) (P1 - P2)
    agree(found["a.q"], np.pi*20e-3*10e-6**3/(12*870*46e-6*15e-3)*(1 + 1.5*0.4**2)*DROPS)
