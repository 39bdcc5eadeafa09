"""Hydraulic orifices and valves beside formulas of their sources, written here from these."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from library_check import agree, checks, part
from numpy.typing import NDArray
from scipy.interpolate import BSpline

Array = NDArray[np.float64]
bar, LPM = 1e5, 1e-3/60
RHO, NU = 870.0, 46e-6
OIL = {"rho": "870 kg/m**3", "nu": "46 mm**2/s"}
NARROW = "1e-3 Pa"  # a transition so narrow that the square-root law itself is left
DROPS = np.array([-300, -20, -1, -0.05, 0, 0.05, 0.5, 5, 120])*bar  # both directions, none, small and large


def root(dp: Array | float) -> Array:
    """The signed root of Bernoulli's law."""
    return np.sign(dp)*np.sqrt(np.abs(dp))


def clipped(x: Array | float) -> Array:
    return np.clip(x, 0, 1)


def eased(x: Array | float) -> Array:
    """From 0 to 1 without a kink: the cubic that is flat at both ends."""
    return 3*clipped(x)**2 - 2*clipped(x)**3


def passes(name: str, expected: Callable[[Array], Array], rtol: float = 1e-9, **given: object) -> None:
    """A part with the ports a and b passes expected(drop), at any level of pressure, and keeps nothing back."""
    law = part(name, **given)
    for level in (0.0, 55*bar):
        found = law({"a.p": level + DROPS, "b.p": level})
        agree(found["a.q"], expected(DROPS), rtol, size=float(np.abs(expected(DROPS)).max())*1e-3)
        agree(found["b.q"], -found["a.q"])


def between(widths: str, law: Callable[[float], Array], ideal: Array, drops: Array, width: float) -> None:
    """With the stated width of the transition the ideal law is missed by a quarter of (width/drop)**2 at most, and flow
    always goes down the pressure."""
    found, large = law(width), np.abs(drops) > 2*width
    off = np.abs(found/np.where(ideal == 0, 1, ideal) - 1)
    assert np.all(off[large] <= 0.2501*(width/drops[large])**2 + 1e-12), widths
    assert np.all(found*drops >= 0)
    assert np.all(np.abs(found) <= np.abs(ideal) + 1e-18)


# -- orifices and passages ---------------------------------------------------------------------------------------------
@checks("Orifice")
def test_orifice() -> None:
    # Merritt (3-34), Q = C_d A sqrt(2/rho (P1 - P2)), by a flow at a drop: Q = Q_r sqrt(dp/dp_r)
    passes("Orifice", lambda dp: 30*LPM*root(dp/(10*bar)), 1e-7, q_r="30 L/min", dp_r="10 bar", dp_t=NARROW)
    drops = np.array([-300, -1, -0.3, 0.02, 0.3, 2, 50])*bar
    between("dp_t", lambda width: part("Orifice", q_r="30 L/min", dp_r="10 bar", dp_t=width)(
        {"a.p": drops, "b.p": 0})["a.q"], 30*LPM*root(drops/(10*bar)), drops, 0.1*bar)


@checks("OrificeWithHeatPort")
def test_orifice_with_heat_port() -> None:
    passes("OrificeWithHeatPort", lambda dp: 30*LPM*root(dp/(10*bar)), 1e-7, q_r="30 L/min", dp_r="10 bar", dp_t=NARROW)
    found = part("OrificeWithHeatPort", q_r="30 L/min", dp_r="10 bar", dp_t=NARROW)({"a.p": DROPS, "b.p": 0, "h.T": 300})
    agree(found["h.Q"], -30*LPM*np.abs(DROPS)**1.5/np.sqrt(10*bar), 1e-7, size=1.0)  # the loss, out at h


@checks("SharpEdgedOrifice")
def test_sharp_edged_orifice() -> None:
    area = np.pi/4*2e-3**2
    passes("SharpEdgedOrifice", lambda dp: 0.61*area*root(2*dp/RHO), 1e-7, d="2 mm", Re_t=0.01, **OIL)
    # Merritt (3-40): far below the transition C_d = delta sqrt(R), so Q = 2 delta**2 D A/mu dp with delta = 0.61/sqrt(R_t)
    tiny = np.array([-0.1, 0.1])
    found = part("SharpEdgedOrifice", d="2 mm", **OIL)({"a.p": tiny, "b.p": 0})
    agree(found["a.q"], 2*0.61**2/9.3*2e-3*area/(RHO*NU)*tiny, 1e-6)
    agree(0.61/np.sqrt(9.3), 0.2, 1e-3)  # delta of a sharp-edged round hole


@checks("VariableOrifice")
def test_variable_orifice() -> None:
    law = part("VariableOrifice", A_m="3 mm**2", A_0="0.01 mm**2", Re_t=0.01, **OIL)
    for u in (-1.0, 0.0, 0.3, 1.0, 2.0):
        area = 0.01e-6 + 2.99e-6*clipped(u)
        agree(law({"a.p": DROPS, "b.p": 0, "u": u})["a.q"], 0.61*area*root(2*DROPS/RHO), 1e-4, size=1e-6*area/3e-6)
    tiny = np.array([-0.1, 0.1])
    found = part("VariableOrifice", A_m="3 mm**2", **OIL)({"a.p": tiny, "b.p": 0, "u": 1})
    diameter = np.sqrt(4*3e-6/np.pi)
    agree(found["a.q"], 2*0.61**2/9.3*diameter*3e-6/(RHO*NU)*tiny, 1e-6)


@checks("TurbulentLeakage")
def test_turbulent_leakage() -> None:
    passes("TurbulentLeakage", lambda dp: 0.7*1e-6*root(2*dp/RHO), 1e-7, A="1 mm**2", rho="870 kg/m**3", dp_t=NARROW)


@checks("LaminarLeakage")
def test_laminar_leakage() -> None:
    passes("LaminarLeakage", lambda dp: 3e-12*dp, C="3e-12 m**3/(s*Pa)")


@checks("Capillary")
def test_capillary() -> None:
    # Hagen and Poiseuille, Merritt (2-27): Q = pi D**4/(128 mu L) dp
    passes("Capillary", lambda dp: np.pi*1e-3**4/(128*RHO*NU*0.5)*dp, d="1 mm", length="0.5 m", **OIL)


@checks("AnnularGap")
def test_annular_gap() -> None:
    # Merritt (2-40): Q = pi D c**3/(12 mu L) (1 + 3/2 (e/c)**2) dp
    for share, factor in ((0.0, 1.0), (0.4, 1.24), (1.0, 2.5)):
        passes("AnnularGap", lambda dp, k=factor: np.pi*20e-3*10e-6**3/(12*RHO*NU*15e-3)*k*dp,
               d="20 mm", gap="10 um", length="15 mm", eccentricity=share, **OIL)


@checks("PowerLawOrifice")
def test_power_law_orifice() -> None:
    for n in (0.5, 0.7, 1.0):
        passes("PowerLawOrifice", lambda dp, n=n: np.sign(dp)*1e-10*bar*(np.abs(dp)/bar)**n, 1e-7,
               C="1e-10 m**3/(s*Pa)", dp_0="1 bar", n=n, dp_t=NARROW)


@checks("ExponentOrifice")
def test_exponent_orifice() -> None:
    for n in (0.5, 0.7, 1.0):
        passes("ExponentOrifice", lambda dp, n=n: np.sign(dp)*20*LPM*(np.abs(dp)/(5*bar))**n, 1e-7,
               q_r="20 L/min", dp_r="5 bar", n=n, dp_t=NARROW)


@checks("TransitionOrifice")
def test_transition_orifice() -> None:
    def flow(dp: Array) -> Array:
        """dp = R q + K q |q| with R = 1/C and K = k/C**2, solved by the formula of quadratics."""
        R, K = 1e10, 2e-5*1e20
        return np.sign(dp)*(-R + np.sqrt(R**2 + 4*K*np.abs(dp)))/(2*K)

    passes("TransitionOrifice", flow, C="1e-10 m**3/(s*Pa)", k="2e-5 1/Pa")
    passes("TransitionOrifice", lambda dp: 1e-10*dp, C="1e-10 m**3/(s*Pa)", k=0)


@checks("FlowCurveOfDrop")
def test_flow_curve_of_drop() -> None:
    coefficients = np.array([3, -1, 4, 1, -5, 9, 2, -6, 5])*1e-5
    law = part("FlowCurveOfDrop", dp_0="10 bar", dp_r="80 bar", **{f"q_{k + 1}": c for k, c in enumerate(coefficients)})
    spline = BSpline(np.arange(-6.0, 7), coefficients, 3, extrapolate=False)  # nine of nine that end at zero
    drops = np.linspace(-75, 95, 41)*bar
    u = np.clip(4*(drops - 10*bar)/(80*bar), -4, 4)
    design = np.array([BSpline.basis_element(k + np.arange(-2.0, 3), extrapolate=False)(u) for k in range(-4, 5)])
    expected = coefficients @ np.nan_to_num(design)
    inside = np.abs(u) <= 3
    agree(spline(u)[inside], expected[inside])
    agree(law({"a.p": drops, "b.p": 0})["a.q"], expected, size=1e-5)
    ends = law({"a.p": np.array([-500, -70, 90, 500])*bar, "b.p": 0})["q"]
    agree(ends[[0, 3]], ends[[1, 2]])  # beyond the range it keeps its value


# -- valves with two ports ---------------------------------------------------------------------------------------------
@checks("BypassValve")
def test_bypass_valve() -> None:
    for u in (-0.5, 0.0, 0.4, 1.0, 3.0):
        passes("BypassValve", lambda dp, u=u: clipped(u)*40*LPM*root(dp/(5*bar)) + 1e-13*dp, 1e-6,
               q_r="40 L/min", dp_r="5 bar", u=u, leakage="1e-13 m**3/(s*Pa)", dp_t=NARROW)


@checks("DirectionalValve22")
def test_directional_valve_22() -> None:
    law = part("DirectionalValve22", q_r="40 L/min", dp_r="5 bar", T_v="20 ms", leakage="1e-13 m**3/(s*Pa)", dp_t=NARROW)
    for u, y in ((0.0, 0.2), (1.0, 0.0), (5.0, 1.0), (-2.0, 0.5)):
        found = law({"a.p": DROPS, "b.p": 0, "u": u, "y": y})
        agree(found["a.q"], y*40*LPM*root(DROPS/(5*bar)) + 1e-13*DROPS, 1e-6, size=1e-9)
        agree(found["b.q"], -found["a.q"])
        agree(found["der(y)"], (clipped(u) - y)/20e-3)


@checks("CheckValve")
def test_check_valve() -> None:
    passes("CheckValve", lambda dp: eased((dp - 0.5*bar)/bar)*40*LPM*root(dp/(4*bar)) + 1e-14*dp, 1e-6,
           q_r="40 L/min", dp_r="4 bar", leakage="1e-14 m**3/(s*Pa)", dp_t=NARROW)
    found = part("CheckValve", q_r="40 L/min", dp_r="4 bar")({"a.p": 0, "b.p": np.array([0.0, -0.5, 300])*bar})
    agree(found["a.q"], 0, size=1e-30)  # shut at rest, up to p_o, and against any flow back


@checks("ReliefValve")
def test_relief_valve() -> None:
    passes("ReliefValve", lambda dp: 1e-10*np.maximum(dp - 100*bar, 0), C="1e-10 m**3/(s*Pa)", dp_0="100 bar")


@checks("RatedReliefValve")
def test_rated_relief_valve() -> None:
    law = part("RatedReliefValve", p_0="200 bar", p_r="220 bar", q_r="60 L/min", T_v="10 ms", dp_t=NARROW,
               leakage="1e-13 m**3/(s*Pa)")
    drops = np.array([-300, 0, 199, 200, 210, 220, 300])*bar
    found = law({"a.p": 5*bar + drops, "b.p": 5*bar, "y": 0.3})
    agree(found["der(y)"], (clipped((drops - 200*bar)/(20*bar)) - 0.3)/10e-3)
    agree(found["a.q"], 0.3*60*LPM*root(drops/(220*bar)) + 1e-13*drops, 1e-6, size=1e-9)
    steady = law({"a.p": 220*bar, "b.p": 0, "der(y)": 0})  # what its data sheet says
    agree(steady["a.q"], 60*LPM + 1e-13*220*bar, 1e-9)
    agree(law({"a.p": 199*bar, "b.p": 0, "der(y)": 0})["a.q"], 1e-13*199*bar)


@checks("FlowControlValve")
def test_flow_control_valve_is_a_plain_orifice_below_its_least_drop_and_back() -> None:
    law = part("FlowControlValve", q_r="20 L/min", dp_m="8 bar", dp_t=NARROW)
    for u in (-1.0, 0.0, 0.5, 1.0, 2.0):
        set_flow = 20*LPM*clipped(u)
        y = np.array([-300.0, -8, -0.1, 0, 0.02, 0.3, 0.5])
        agree(law({"a.p": y*8*bar, "b.p": 0, "u": u})["a.q"], set_flow*root(y), 0.01, size=1e-9)
        y = np.array([3.0, 10, 60])  # kept
        agree(law({"a.p": y*8*bar, "b.p": 0, "u": u})["a.q"], set_flow*np.ones(3), 2e-3, size=1e-9)
        agree(law({"a.p": 8*bar, "b.p": 0, "u": u})["a.q"], set_flow*2**-0.125, 1e-9, size=1e-9)


@checks("Filter")
def test_filter() -> None:
    for loading in (0.0, 0.9):
        passes("Filter", lambda dp, s=loading: 60*LPM*((1 - s)*32/46*dp/(0.5*bar) + np.maximum(dp - 3.5*bar, 0)/bar),
               q_r="60 L/min", dp_r="0.5 bar", loading=loading, p_o="3.5 bar", nu="46 mm**2/s", nu_r="32 mm**2/s")


@checks("PilotCheckValve")
def test_pilot_check_valve() -> None:
    law = part("PilotCheckValve", q_r="40 L/min", dp_r="4 bar", ratio=4.0, leakage="1e-14 m**3/(s*Pa)", dp_t=NARROW)
    p_a, p_b, p_x = (k*bar for k in np.array([(30, 10, 0), (10, 100, 0), (0, 100, 25.1), (0, 100, 25.2), (0, 100, 80),
                                              (0, 100, -5), (50, 100, 60), (50, 100, 63), (0, 0, 0)], float).T)
    found = law({"a.p": p_a, "b.p": p_b, "x.p": p_x})
    # forces on the poppet over the area of its seat; the pilot piston is vented to a and only pushes
    lift = p_a - p_b + 4*np.maximum(p_x - p_a, 0)
    agree(found["a.q"], eased((lift - 0.5*bar)/bar)*40*LPM*root((p_a - p_b)/(4*bar)) + 1e-14*(p_a - p_b), 1e-6, size=1e-9)
    agree(found["b.q"], -found["a.q"])
    agree(found["x.q"], 0, size=1e-30)


@checks("CounterbalanceValve")
def test_counterbalance_valve() -> None:
    law = part("CounterbalanceValve", p_0="250 bar", ratio=4.0, p_b="30 bar", q_r="60 L/min", dp_r="20 bar", T_v="20 ms",
               q_c="80 L/min", dp_c="5 bar", p_o="0.5 bar", p_f="1.5 bar", leakage="1e-14 m**3/(s*Pa)", dp_t=NARROW)
    p_a, p_b, p_x = (k*bar for k in np.array([(150, 0, 0), (150, 0, 30), (265, 0, 0), (280, 0, 0), (150, 20, 60),
                                              (10, 11, 0), (10, 30, 0), (0, 0, 0)], float).T)
    found = law({"a.p": p_a, "b.p": p_b, "x.p": p_x, "y": 0.2})
    opening = clipped((p_a - p_b + 4*(p_x - p_b) - 250*bar)/(30*bar))
    agree(found["der(y)"], (opening - 0.2)/20e-3)
    check = eased((p_b - p_a - 0.5*bar)/bar)
    expected = (0.2*60*LPM/np.sqrt(20*bar) + check*80*LPM/np.sqrt(5*bar))*root(p_a - p_b) + 1e-14*(p_a - p_b)
    agree(found["a.q"], expected, 1e-6, size=1e-9)
    agree(found["b.q"], -found["a.q"])
    agree(found["x.q"], 0, size=1e-30)


# -- valves with more ports --------------------------------------------------------------------------------------------
PORTS = np.array([(200, 0, 80, 20), (200, 5, 20, 80), (0, 100, 50, 60), (70, 70, 70, 70)], float).T*bar  # P, T, A, B


@checks("DirectionalValve32")
def test_directional_valve_32() -> None:
    law = part("DirectionalValve32", q_r="40 L/min", dp_r="5 bar", T_v="20 ms", leakage="1e-13 m**3/(s*Pa)", dp_t=NARROW)
    P, T, A, _ = PORTS
    for u, y in ((1.0, 0.9), (0.0, 0.1), (3.0, 0.5), (-1.0, 0.0)):
        found = law({"P.p": P, "T.p": T, "A.p": A, "u": u, "y": y})
        into = max(2*y - 1, 0)*40*LPM*root((P - A)/(5*bar)) + 1e-13*(P - A)
        out = max(1 - 2*y, 0)*40*LPM*root((A - T)/(5*bar)) + 1e-13*(A - T)
        for port, flow in (("P", into), ("A", out - into), ("T", -out)):
            agree(found[f"{port}.q"], flow, 1e-6, size=1e-9)
        agree(found["der(y)"], (clipped(u) - y)/20e-3)


CENTRES = {"PT": 1.0, "PA": 0.2, "PB": 0.3, "AT": 0.4, "BT": 0.5}


@checks("DirectionalValve43")
@pytest.mark.parametrize("x", [-1.0, -0.3, 0.0, 0.6, 1.0])
def test_directional_valve_43(x: float) -> None:
    law = part("DirectionalValve43", q_r="40 L/min", dp_r="5 bar", T_v="50 ms", leakage="1e-13 m**3/(s*Pa)", dp_t=NARROW,
               **{f"c_{k}": v for k, v in CENTRES.items()})
    P, T, A, B = PORTS
    centre, ahead, back = 1 - abs(x), max(x, 0), max(-x, 0)
    opening = {"PT": CENTRES["PT"]*centre, "PA": ahead + CENTRES["PA"]*centre, "PB": back + CENTRES["PB"]*centre,
               "AT": back + CENTRES["AT"]*centre, "BT": ahead + CENTRES["BT"]*centre}
    p = {"P": P, "T": T, "A": A, "B": B}
    flow = {k: y*40*LPM*root((p[k[0]] - p[k[1]])/(5*bar)) + (0 if k == "PT" else 1e-13)*(p[k[0]] - p[k[1]])
            for k, y in opening.items()}
    for u in (-3.0, 0.5):
        found = law({"P.p": P, "T.p": T, "A.p": A, "B.p": B, "u": u, "x": x})
        for port in p:
            expected = sum(q if k[0] == port else -q for k, q in flow.items() if port in k)
            agree(found[f"{port}.q"], expected, 1e-6, size=1e-9)
        agree(found["der(x)"], (np.clip(u, -1, 1) - x)/50e-3, size=1.0)


def edges(x: float, gain: dict[str, Array], overlap: float, full: float) -> dict[str, Array]:
    """Flow over the four edges of a spool at x, each gain being that of the whole opening."""
    ahead, back = max(x - overlap, 0)/full, max(-x - overlap, 0)/full
    return {"PA": ahead*gain["PA"], "BT": ahead*gain["BT"], "PB": back*gain["PB"], "AT": back*gain["AT"]}


def spool(law: Callable[..., dict[str, Array]], known: dict[str, object], f_n: float, zeta: float) -> None:
    """A spool of second order whose command is clamped."""
    for u, x, w in ((0.3, 0.1, 5.0), (4.0, 1.1, -20.0), (-4.0, 0.0, 0.0)):
        found = law({**known, "u": u, "x": x, "w": w})
        agree(found["der(w)"], (2*np.pi*f_n)**2*(np.clip(u, -1, 1) - x) - 2*zeta*2*np.pi*f_n*w)
        agree(found["der(x)"], w, size=1.0)


@checks("ProportionalValve43")
@pytest.mark.parametrize("overlap", [-0.1, 0.0, 0.2])
def test_proportional_valve_43(overlap: float) -> None:
    law = part("ProportionalValve43", q_r="40 L/min", dp_r="5 bar", f_n="60 Hz", zeta=0.7, overlap=overlap,
               leakage="1e-13 m**3/(s*Pa)", dp_t=NARROW)
    p = dict(zip("PTAB", PORTS, strict=True))
    gain = {k: 40*LPM*root((p[k[0]] - p[k[1]])/(5*bar)) for k in ("PA", "PB", "AT", "BT")}
    known = {f"{k}.p": v for k, v in p.items()}
    for x in (-1.0, -0.15, 0.0, 0.05, 1.0, 1.1):
        found = law({**known, "u": 0, "x": x, "w": 0})
        flow = {k: q + 1e-13*(p[k[0]] - p[k[1]]) for k, q in edges(x, gain, overlap, 1.0).items()}
        for port in p:
            agree(found[f"{port}.q"], sum(q if k[0] == port else -q for k, q in flow.items() if port in k), 1e-6, size=1e-9)
    spool(law, known, 60, 0.7)


@checks("ServoValve43")
@pytest.mark.parametrize(("overlap", "ratio"), [(0.0, 1.0), (0.05, 0.6), (-0.02, 2.0)])
def test_servo_valve_43_leaks_as_its_data_sheet_says_whatever_the_ratio_of_its_edges(overlap: float, ratio: float) -> None:
    law = part("ServoValve43", q_r="38 L/min", dp_r="70 bar", f_n="90 Hz", zeta=0.8, overlap=overlap, ratio=ratio,
               q_0="1.5 L/min", p_0="140 bar", dp_t=NARROW)
    p = dict(zip("PTAB", PORTS, strict=True))
    # the rated flow passes two edges of half the rated drop each
    gain = {k: (ratio if "B" in k else 1)*38*LPM*root((p[k[0]] - p[k[1]])/(35*bar)) for k in ("PA", "PB", "AT", "BT")}
    known = {f"{k}.p": v for k, v in p.items()}
    # in the middle, with A and B shut, the leakage q_0 at p_0 goes by two ways of two edges in line: c/2 + ratio*c/2
    c = 2*1.5*LPM/(140*bar)/(1 + ratio)
    for x in (-1.0, 0.0, 0.5, 1.0):
        found = law({**known, "u": 0, "x": x, "w": 0})
        flow = {k: q + (ratio if "B" in k else 1)*c*(p[k[0]] - p[k[1]])
                for k, q in edges(x, gain, overlap, 1 - overlap).items()}
        for port in p:
            agree(found[f"{port}.q"], sum(q if k[0] == port else -q for k, q in flow.items() if port in k), 1e-6, size=1e-9)
    if overlap >= 0:
        middle = law({"P.p": 140*bar, "T.p": 0, "A.q": 0, "B.q": 0, "x": 0, "w": 0, "u": 0}, guess={"A.p": 7e6, "B.p": 7e6})
        agree(middle["P.q"], 1.5*LPM)
    spool(law, known, 90, 0.8)


@checks("ShuttleValve")
def test_shuttle_valve() -> None:
    law = part("ShuttleValve", q_r="20 L/min", dp_r="3 bar", p_t="0.5 bar", dp_t=NARROW)
    A, B, X = (k*bar for k in np.array([(60, 20, 50), (20, 60, 70), (30, 30, 20), (30.2, 30, 0), (0, 0, 0)], float).T)
    found = law({"A.p": A, "B.p": B, "X.p": X})
    place = eased(0.5 + (A - B)/bar)
    agree(found["A.q"], place*20*LPM*root((A - X)/(3*bar)), 1e-6, size=1e-9)
    agree(found["B.q"], (1 - place)*20*LPM*root((B - X)/(3*bar)), 1e-6, size=1e-9)
    agree(found["X.q"], -found["A.q"] - found["B.q"])


@checks("PressureReducingValve")
def test_pressure_reducing_valve() -> None:
    law = part("PressureReducingValve", p_0="50 bar", p_b="10 bar", q_r="20 L/min", dp_r="10 bar", T_v="5 ms", dp_t=NARROW)
    P, T, A, _ = PORTS
    for y in (-1.0, -0.4, 0.0, 0.7):
        found = law({"P.p": P, "T.p": T, "A.p": A, "y": y})
        into, out = (max(k, 0)*20*LPM*root(dp/(10*bar)) for k, dp in ((y, P - A), (-y, A - T)))
        for port, flow in (("P", into), ("A", out - into), ("T", -out)):
            agree(found[f"{port}.q"], flow, 1e-6, size=1e-9)
        agree(found["der(y)"], (np.clip((50*bar - A + T)/(10*bar), -1, 1) - y)/5e-3)
