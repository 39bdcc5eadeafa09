"""Laws between two bodies beside the formulas of their sources, along a line and on a shaft.

The two domains have the same laws under other names: each formula is compared with both components. `s` is the distance
(angle) from a to b, `v` its rate; the force (torque) is that which holds b back.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from library_check import CHECKED, Array, agree, checks, cubic_spline, part, run
from numpy.typing import ArrayLike

import heavebond as hb

LINE, SHAFT = ("x", "v", "f"), ("phi", "w", "tau")
S = np.array([-0.3, -0.12, -0.099, -0.05, 0.0, 0.021, 0.099, 0.1004, 0.25, 0.4])[:, None]
V = np.array([-2.0, -0.3, -1e-3, 0.0, 2e-3, 0.4, 3.0])[None, :]
NARROW = 1e-9  # a width of transition so small that the ideal law is left


def between(component: str, s: ArrayLike, v: ArrayLike, given: dict[str, float], *, law: str = "",
            **states: ArrayLike) -> Array:
    """The force that holds b back, over all pairs of s and v; both ports see the same."""
    made = part(component, **given)
    x, w, f = LINE if next(iter(made.component.ports.values())).domain == "translational" else SHAFT
    found = made({f"a.{x}": 0.3, f"b.{x}": 0.3 + np.asarray(s), f"a.{w}": -0.7, f"b.{w}": -0.7 + np.asarray(v), **states})
    agree(found[f"a.{f}"], -found[f"b.{f}"])
    return np.asarray(found[law or f"b.{f}"])


HEIGHTS = [5.0, -2.0, 3.0, 0.5, 0.0, -1.0, 4.0, 2.0, -6.0]
Law = Callable[[Array, Array], Array]
LAWS: dict[str, tuple[tuple[str, dict[str, float]], tuple[str, dict[str, float]] | None, Law]] = {
    "Hooke": (
        ("Spring", {"c": 4e4, "l0": 0.1}), ("TorsionSpring", {"c": 4e4, "phi0": 0.1}), lambda s, v: 4e4*(s - 0.1) + 0*v),
    "viscous": (("Damper", {"d": 300.0}), ("RotationalDamper", {"d": 300.0}), lambda s, v: 300*v + 0*s),
    "creep": (("ShaftSlip", {"d": 300.0}), None, lambda s, v: 300*v + 0*s),
    "Kelvin-Voigt": (
        ("SpringDamper", {"c": 4e4, "d": 300.0, "l0": -0.05}),
        ("TorsionSpringDamper", {"c": 4e4, "d": 300.0, "phi0": -0.05}), lambda s, v: 4e4*(s + 0.05) + 300*v),
    "series compliance": (
        ("SeriesCompliance", {"c": 4e4, "T_d": 3e-3}), ("ShaftCompliance", {"c": 4e4, "T_d": 3e-3}),
        lambda s, v: 4e4*s + 120*v),
    "cubic": (
        ("CubicSpring", {"c_3": 7e3, "l0": 0.1}), ("CubicTorsionSpring", {"c_3": 7e3, "phi0": 0.1}),
        lambda s, v: 7e3*(s - 0.1)**3 + 0*v),
    "Duffing": (
        ("HardeningSpring", {"c": 4e4, "l0": 0.1, "k": 0.6, "s_r": 0.2}),
        ("HardeningTorsionSpring", {"c": 4e4, "phi0": 0.1, "k": 0.6, "s_r": 0.2}),
        lambda s, v: 4e4*(s - 0.1) + 4e4*0.6/0.2**2*(s - 0.1)**3 + 0*v),
    "two straight lines": (
        ("BilinearSpring", {"c": 4e4, "l0": 0.02, "k": 0.75, "s_0": -0.1}),
        ("BilinearTorsionSpring", {"c": 4e4, "phi0": 0.02, "k": 0.75, "s_0": -0.1}),
        lambda s, v: np.where(s - 0.02 > -0.1, 4e4*(s - 0.02), -4e3 + 1e4*(s - 0.02 + 0.1)) + 0*v),
    "dead zone": (
        ("SpringWithPlay", {"c": 4e4, "l0": 0.02, "gap": 0.1}),
        ("TorsionSpringWithPlay", {"c": 4e4, "phi0": 0.02, "gap": 0.1}),
        lambda s, v: 4e4*np.sign(s - 0.02)*np.maximum(np.abs(s - 0.02) - 0.1, 0) + 0*v),
    "dead zone beside a damper": (
        ("SpringDamperWithPlay", {"c": 4e4, "d": 300.0, "l0": 0.02, "gap": 0.1}),
        ("TorsionSpringDamperWithPlay", {"c": 4e4, "d": 300.0, "phi0": 0.02, "gap": 0.1}),
        lambda s, v: 4e4*np.sign(s - 0.02)*np.maximum(np.abs(s - 0.02) - 0.1, 0) + 300*v),
    "dead zone with its damper": (
        ("SpringDamperWithPlay", {"c": 4e4, "d": 300.0, "gap": 0.1, "loose": 1.0, "e_t": NARROW}),
        ("TorsionSpringDamperWithPlay", {"c": 4e4, "d": 300.0, "gap": 0.1, "loose": 1.0, "e_t": NARROW}),
        lambda s, v: np.where(np.abs(s) > 0.1, 4e4*(s - 0.1*np.sign(s)) + 300*v, 0.0)),
    "backlash": (
        ("Backlash", {"gap": 0.1, "c": 4e4, "d": 3.0}), ("GearBacklash", {"gap": 0.1, "c": 4e4, "d": 3.0}),
        lambda s, v: 4e4*np.sign(s)*np.maximum(np.abs(s) - 0.1, 0) + 3*v),
    "Coulomb": (
        ("CoulombFriction", {"F_c": 50.0, "v_t": NARROW}), ("RotationalCoulombFriction", {"M_c": 50.0, "w_t": NARROW}),
        lambda s, v: 50*np.sign(v) + 0*s),
    "two Coulomb levels": (
        ("DirectionalFriction", {"F_p": 50.0, "F_n": 30.0, "v_t": NARROW}),
        ("RotationalDirectionalFriction", {"M_p": 50.0, "M_n": 30.0, "w_t": NARROW}),
        lambda s, v: np.where(v > 0, 50.0, np.where(v < 0, -30.0, 0.0)) + 0*s),
    "Stribeck": (
        ("StribeckFriction", {"F_c": 50.0, "F_s": 80.0, "v_s": 0.2, "sigma_2": 7.0, "v_t": NARROW}),
        ("RotationalStribeckFriction", {"M_c": 50.0, "M_s": 80.0, "w_s": 0.2, "d": 7.0, "w_t": NARROW}),
        lambda s, v: (50 + 30*np.exp(-(v/0.2)**2))*np.sign(v) + 7*v + 0*s),
    "square law": (("Drag", {"d_2": 12.0}), ("RotationalDrag", {"k_2": 12.0}), lambda s, v: 12*v**2*np.sign(v) + 0*s),
    "end stops": (
        ("EndStop", {"c": 4e4, "d": 300.0, "x_min": -0.1, "x_max": 0.1, "e_t": NARROW}),
        ("RotationalEndStop", {"c": 4e4, "d": 300.0, "phi_min": -0.1, "phi_max": 0.1, "e_t": NARROW}),
        lambda s, v: np.where(s > 0.1, np.maximum(4e4*(s - 0.1) + 300*v, 0),
                              np.where(s < -0.1, np.minimum(4e4*(s + 0.1) + 300*v, 0), 0.0))),
    "end stops with limited damping": (
        ("ElasticGap", {"c": 4e4, "d": 300.0, "l0": -0.1}), None,
        lambda s, v: np.where(s < -0.1, 4e4*(s + 0.1) + np.clip(300*v, 4e4*(s + 0.1), -4e4*(s + 0.1)), 0.0)),
    "backlash with limited damping": (
        ("ElasticBacklash", {"c": 4e4, "d": 300.0, "gap": 0.1}), None,
        lambda s, v: np.sign(s)*np.clip(4e4*np.maximum(np.abs(s) - 0.1, 0) + np.sign(s)*300*v, 0,
                                        8e4*np.maximum(np.abs(s) - 0.1, 0))),
    "curve over speed": (
        ("ForceCurveOfSpeed", {"v_max": 0.5, **{f"F_{k + 1}": h for k, h in enumerate(HEIGHTS)}}),
        ("TorqueCurveOfSpeed", {"w_max": 0.5, **{f"M_{k + 1}": h for k, h in enumerate(HEIGHTS)}}),
        lambda s, v: cubic_spline(8*v, HEIGHTS) + 0*s),
    "curve over stroke": (
        ("ForceCurveOfStroke", {"s_0": 0.05, "s_r": 0.2, **{f"F_{k + 1}": h for k, h in enumerate(HEIGHTS)}}),
        ("TorqueCurveOfAngle", {"s_0": 0.05, "s_r": 0.2, **{f"M_{k + 1}": h for k, h in enumerate(HEIGHTS)}}),
        lambda s, v: cubic_spline(20*(s - 0.05), HEIGHTS) + 0*v),
    "bilinear damping": (
        ("ShockAbsorber", {"d_out": 900.0, "d_in": 300.0}), None, lambda s, v: np.where(v > 0, 900.0, 300.0)*v + 0*s),
    "digressive": (
        ("NonlinearDamper", {"d": 900.0, "k": 1.0, "v_k": 0.4, "r": 0.6}),
        ("RotationalNonlinearDamper", {"d": 900.0, "k": 1.0, "w_k": 0.4, "r": 0.6}),
        lambda s, v: np.where(v > 0, 900.0, 360.0)*v/np.hypot(1, v/0.4) + 0*s),
    "progressive": (
        ("NonlinearDamper", {"d": 900.0, "k": -0.5, "v_k": 0.4, "r": 0.0}),
        ("RotationalNonlinearDamper", {"d": 900.0, "k": -0.5, "w_k": 0.4, "r": 0.0}),
        lambda s, v: 900*v*np.sqrt(np.hypot(1, v/0.4)) + 0*s),
    "slack wire": (
        ("SlackWire", {"c": 4e4, "d": 30.0, "l0": 0.02, "k": 1.0, "s_0": -0.05}), None,
        lambda s, v: 4e4*np.maximum(s - 0.02, -0.05) + 30*v),
    "wire rope": (
        ("WireRope", {"l0": 0.2, "A": 1e-4, "E": 1e11, "T_d": 5e-3, "e_t": NARROW}), None,
        lambda s, v: np.where(s > 0.2, np.maximum(1e-4*1e11/0.2*(s - 0.2 + 5e-3*v), 0), 0.0)),
    "Morison": (
        ("BodyDrag", {"C_d": 1.1, "A": 0.4, "rho": 1000.0}), None, lambda s, v: 1.1*0.4*1000/2*v*np.abs(v) + 0*s),
    "constant": (("Preload", {"F": 77.0}), None, lambda s, v: 77 + 0*s + 0*v),
    "resting contact": (
        ("Contact", {"c": 4e4, "d": 300.0, "l0": 0.02, "e_t": NARROW}), None,
        lambda s, v: np.where(s < 0.02, np.minimum(4e4*(s - 0.02) + 300*v, 0), 0.0)),
    "gas behind a piston": (
        # p = p_0 (V_0/(V_0 + A s))**n against p_0, with p_0 A = c/(n kappa), kappa = A/V_0
        ("PolytropicSpring", {"c": 4e4, "kappa": 1.5, "n": 1.3, "kappa_0": 1e-9}), None,
        lambda s, v: 4e4/(1.3*1.5)*(1 - (1/(1 + 1.5*s))**1.3) + 0*v),
}


for _line, _shaft, _ in LAWS.values():
    for _component, _ in filter(None, (_line, _shaft)):
        CHECKED.setdefault(_component, []).append(f"{__name__}.test_law_between_two_bodies")


@pytest.mark.parametrize("name", LAWS)
def test_law_between_two_bodies(name: str) -> None:
    line, shaft, formula = LAWS[name]
    expected = formula(S + 0*V, V + 0*S)
    assert np.ptp(expected) > 0 or name == "constant"
    rtol = 1e-7 if name == "gas behind a piston" else 1e-9  # kappa_0 stands beside kappa: a relative 7e-10, times n
    for component, given in filter(None, (line, shaft)):
        agree(between(component, S, V, given), expected, rtol=rtol, size=float(np.abs(expected).max()))


# -- stated widths of transitions ---------------------------------------------------------------------------------------
@pytest.mark.parametrize(("component", "given", "width"), [
    ("CoulombFriction", {"F_c": 50.0}, 1e-3), ("RotationalCoulombFriction", {"M_c": 50.0}, 0.01),
    ("DirectionalFriction", {"F_p": 50.0, "F_n": 50.0}, 1e-3),
    ("RotationalDirectionalFriction", {"M_p": 50.0, "M_n": 50.0}, 0.01)])
def test_friction_turns_over_its_stated_width(component: str, given: dict[str, float], width: float) -> None:
    agree(between(component, 0.0, np.array([-width, 0, width, 3*width]), given), 50*np.tanh([-1, 0, 1, 3]))


@pytest.mark.parametrize(("component", "given"), [
    ("EndStop", {"c": 4e4, "d": 300.0, "x_min": -1.0, "x_max": 0.1, "e_t": 1e-2}),
    ("RotationalEndStop", {"c": 4e4, "d": 300.0, "phi_min": -1.0, "phi_max": 0.1, "e_t": 1e-2})])
def test_damping_of_a_stop_comes_in_over_its_stated_depth(component: str, given: dict[str, float]) -> None:
    depth = np.array([0.0, 0.0025, 0.005, 0.01, 0.03])
    agree(between(component, 0.1 + depth, 0.5, given), 4e4*depth + 300*0.5*np.minimum(depth/0.01, 1))


def test_damping_of_contact_and_rope_comes_in_over_its_stated_depth() -> None:
    depth = np.array([0.0, 0.0025, 0.005, 0.01, 0.03])
    share = np.minimum(depth/0.01, 1)
    agree(between("Contact", -depth, -0.5, {"c": 4e4, "d": 300.0, "e_t": 1e-2}), -4e4*depth - 150*share)
    agree(between("WireRope", 1 + depth, 0.5, {"l0": 1.0, "A": 1e-4, "E": 1e9, "T_d": 2e-3, "e_t": 1e-2}),
          1e5*(depth + 2e-3*0.5*share))


# -- laws with a state --------------------------------------------------------------------------------------------------
Z, W = np.array([-1.3, -0.6, 0.0, 0.2, 0.9])[:, None], np.array([-0.4, -0.01, 0.0, 0.02, 0.3])[None, :]


@checks("DahlFriction", "RotationalDahlFriction")
def test_dahl() -> None:
    """dF/dx = sigma (1 - F/F_c sgn v) with sigma = F_c/x_s, exponent 1."""
    for component, given in (("DahlFriction", {"F_c": 50.0, "x_s": 2e-3}),
                             ("RotationalDahlFriction", {"M_c": 50.0, "phi_s": 2e-3})):
        force = between(component, 0.0, W, given, z=Z)
        agree(force, 50*Z + 0*W)
        agree(50*between(component, 0.0, W, given, law="der(z)", z=Z), 50/2e-3*(1 - force/50*np.sign(W))*W)


@checks("LuGreFriction", "RotationalLuGreFriction")
def test_lugre_in_its_usual_symbols() -> None:
    """z' = v - sigma_0 |v| z/g, F = sigma_0 z + sigma_1(v) z' + sigma_2 v, g = F_c + (F_s - F_c) exp(-(v/v_s)**2)."""
    F_c, F_s, v_s, x_s, k, sigma_2 = 50.0, 80.0, 0.1, 2e-3, 1.5, 7.0
    sigma_0, sigma_1 = F_c/x_s, k*F_c/v_s*np.exp(-(W/v_s)**2)
    g = F_c + (F_s - F_c)*np.exp(-(W/v_s)**2)
    rate = W - sigma_0*np.abs(W)*(x_s*Z)/g
    for component, given in (
            ("LuGreFriction", {"F_c": F_c, "r": F_s/F_c, "v_s": v_s, "x_s": x_s, "k": k, "sigma_2": sigma_2}),
            ("RotationalLuGreFriction", {"M_c": F_c, "r": F_s/F_c, "w_s": v_s, "phi_s": x_s, "k": k, "d": sigma_2})):
        agree(x_s*between(component, 0.0, W, given, law="der(z)", z=Z), rate)
        agree(between(component, 0.0, W, given, z=Z), sigma_0*x_s*Z + sigma_1*rate + sigma_2*W)


@checks("Hysteresis", "RotationalHysteresis")
@pytest.mark.parametrize("n", [1.0, 2.0, 4.0])
def test_bouc_wen(n: float) -> None:
    """D z' = v - sigma |v| |z|**(n-1) z - (1 - sigma) v |z|**n (Ikhouane, Rodellar, section 2.2)."""
    law = (W - 0.7*np.abs(W)*np.abs(Z)**(n - 1)*Z - 0.3*W*np.abs(Z)**n)/0.02
    for component, given in (("Hysteresis", {"F_h": 50.0, "x_y": 0.02, "n": n, "b_h": 0.7}),
                             ("RotationalHysteresis", {"M_h": 50.0, "phi_y": 0.02, "n": n, "b_h": 0.7})):
        agree(between(component, 0.0, W, given, z=Z), 50*Z + 0*W)
        # 1e-4 of the yield distance is rounded: at |z| = 0.2 and n = 4 a relative 4e-7
        agree(between(component, 0.0, W, given, law="der(z)", z=Z), law, rtol=1e-6, size=20)


@checks("HardeningHysteresis")
def test_bouc_wen_without_a_largest_force() -> None:
    """z' = v - beta gamma |v| z - delta v |z| in units of the force (Bouc; Wen), beta gamma = 1/x_l, delta = h/x_l."""
    given = {"c_h": 3e4, "x_l": 2e-3, "h": -0.8}
    force = 3e4*2e-3*Z + 0*W
    agree(between("HardeningHysteresis", 0.0, W, given, z=Z), force)
    agree(60*between("HardeningHysteresis", 0.0, W, given, law="der(z)", z=Z),
          3e4*W - np.abs(W)*force/2e-3 + 0.8*W*np.abs(force)/2e-3)


# -- laws with events ---------------------------------------------------------------------------------------------------
@checks("DryFriction", "RotationalDryFriction")
def test_sliding_follows_the_stribeck_curve() -> None:
    for component, given in (
            ("DryFriction", {"F_c": 50.0, "F_s": 80.0, "v_s": 0.2, "sigma_2": 7.0}),
            ("RotationalDryFriction", {"M_c": 50.0, "M_s": 80.0, "w_s": 0.2, "d": 7.0})):
        for mode in (-1.0, 1.0):
            v = mode*np.array([1e-6, 0.1, 2.0])
            rate = {f"der({'w' if 'Rot' in component else 'v'})": 0.0}
            agree(between(component, 0.0, v, given, mode=mode, **rate), mode*(50 + 30*np.exp(-(v/0.2)**2)) + 7*v)


@checks("DryFriction", "RotationalDryFriction")
def test_an_exponential_stribeck_curve_stops_a_body_at_the_time_of_its_integral() -> None:
    """m v' = -(F_c + F_1 exp(-v/v_s)): from v_0 the body stops at m v_s/F_c ln((F_c exp(v_0/v_s) + F_1)/(F_c + F_1))."""
    m, coulomb, extra, scale, first = 2.0, 8.0, 4.0, 0.5, 1.5
    stop = m*scale/coulomb*np.log((coulomb*np.exp(first/scale) + extra)/(coulomb + extra))
    for words in SLIDING:
        law = f"{words['c']}: {coulomb} {words['N']}, {words['s']}: {coulomb + extra} {words['N']}, " \
            f"{words['v']}_s: {scale} {words['unit']}, n: 1"
        text = SLED.format(**words, push=0, start=first).replace(f"{words['c']}: 8 {words['N']}, {words['s']}: 10 "
                                                                f"{words['N']}", law)
        assert [time for time, name in run(text).events if name == "dry.stick"] == pytest.approx([stop], rel=1e-6)
    agree(1.0, 1.0)


SLED = """\
model: sled
components:
  frame: {{is: {fixed}}}
  dry:   {{is: {friction}, {c}: 8 {N}, {s}: 10 {N}}}
  body:  {{is: {mass}, {m}: 2 {kg}}}
  push:  {{is: {source}, u: "={push} {N}"}}
nodes: {{ground: [frame.a, dry.a], body: [dry.b, body.a, push.a]}}
initial: {{body.{x}: 0, body.{v}: {start} {unit}}}
simulate: {{until: 1 s, every: 10 ms}}
"""
SLIDING = ({"fixed": "Fixed", "friction": "DryFriction", "c": "F_c", "s": "F_s", "mass": "Mass", "m": "m", "N": "N",
            "kg": "kg", "source": "ForceSource", "x": "x", "v": "v", "unit": "m/s"},
           {"fixed": "FixedShaft", "friction": "RotationalDryFriction", "c": "M_c", "s": "M_s", "mass": "Inertia", "m": "J",
            "N": "N*m", "kg": "kg*m**2", "source": "TorqueSource", "x": "phi", "v": "w", "unit": "rad/s"})


@checks("DryFriction", "RotationalDryFriction")
@pytest.mark.parametrize(("push", "start", "way"), [
    (9, 0, 0.0),                # below the stiction: it stays
    (-9, 0, 0.0),
    (12, 0, (12 - 8)/2/2),      # above it: F - F_c accelerates 2 kg for 1 s
    (-12, 0, -(12 - 8)/2/2),
    (0, 2, 2**2*2/(2*8)),       # it runs out: m v**2/2 = F_c s, in 0.5 s
    (0, -2, -2**2*2/(2*8)),
    (9, 2, 2*1 + (9 - 8)/2/2)])  # pushed on by more than it is held: no end
def test_a_body_pushed_from_the_start_sticks_slips_and_stops(push: float, start: float, way: float) -> None:
    for words in SLIDING:
        result = run(SLED.format(**words, push=push, start=start))
        # stuck bodies part with 1e-12 of an acceleration
        assert result[f"body.{words['x']}"][-1] == pytest.approx(way, abs=1e-7)
    agree(1.0, 1.0)


BELT = """\
model: belt
components:
  frame:  {{is: {fixed}}}
  spring: {{is: {spring}, {k}: 500 {N}/{X}, {d}: 2 {N}*s/{X}}}
  body:   {{is: {mass}, {m}: 3 {kg}}}
  grip:   {{is: {friction}, {c}: 9 {N}, {s}: 14 {N}, {v}_s: 0.05 {unit}}}
  belt:   {{is: {drive}, u: "=0.25 {unit}*sin(2*pi*time/3 s)"}}
nodes: {{ground: [frame.a, spring.a], body: [spring.b, body.a, grip.b], belt: [belt.a, grip.a]}}
initial: {{body.{x}: 0, body.{v}: 0}}
simulate: {{until: 6 s, every: 20 ms}}
"""
ON_BELTS = ({"spring": "SpringDamper", "k": "c", "d": "d", "drive": "VelocitySource", "X": "m"},
            {"spring": "TorsionSpringDamper", "k": "c", "d": "d", "drive": "SpeedSource", "X": "rad"})


def test_a_body_comes_loose_from_what_changes_its_speed_at_any_tolerance() -> None:
    """Errors of the integration add up to a speed while it sticks: more than v_r, and not to be taken for sliding."""
    for words, more in zip(SLIDING, ON_BELTS, strict=True):
        model = hb.loads(BELT.format(**words, **more))
        coarse, fine = (hb.simulate(model, rtol=rtol) for rtol in (1e-6, 1e-10))
        assert [name for _, name in coarse.events] == [name for _, name in fine.events]
        place = f"body.{words['x']}"
        agree(coarse[place], fine[place], 1e-4, size=np.ptp(fine[place]))


BOUNCE = """\
model: bounce
components:
  frame: {{is: {fixed}}}
  stop:  {{is: {stop}, e: 0.5, {side}}}
  body:  {{is: {mass}, {m}: 2 {kg}}}
  pull:  {{is: {source}, u: {pull} {N}}}
nodes: {{floor: [frame.a, stop.a], body: [stop.b, body.a, pull.a]}}
initial: {{body.{x}: {height} {X}, body.{v}: 0}}
simulate: {{until: 2 s, every: 1 ms}}
"""


BOUNCING = ({"fixed": "Fixed", "stop": "RigidStop", "mass": "Mass", "m": "m", "kg": "kg", "source": "ForceSource",
             "N": "N", "x": "x", "v": "v", "X": "m"},
            {"fixed": "FixedShaft", "stop": "RotationalRigidStop", "mass": "Inertia", "m": "J", "kg": "kg*m**2",
             "source": "TorqueSource", "N": "N*m", "x": "phi", "v": "w", "X": "rad"})


def test_a_rigid_stop_on_a_driven_deck_is_no_free_body() -> None:
    """Driven by a signal that follows a state, as behind a filter: nothing that acts on the deck moves it."""
    hb.assemble(hb.loads("""\
model: deck
components:
  lag:  {is: FirstOrderLag, T_1: 0.1 s, u: "=1 m/s*sin(3*time/(1 s))"}
  deck: {is: VelocitySource, u: =lag.y}
  stop: {is: RigidStop, e: 0.2}
  load: {is: Mass, m: 2 kg}
  fall: {is: Weight, m: 2 kg}
nodes: {deck: [deck.a, stop.a], load: [stop.b, load.a, fall.a]}
initial: {load.x: 1 m}
simulate: {until: 2 s}
"""))


@checks("RigidStop", "RotationalRigidStop")
def test_a_body_that_begins_inside_a_stop_does_not_fall_through() -> None:
    """Slow enough, it rests where it is; faster, it is thrown back with e times its speed."""
    for words in BOUNCING:
        for speed, then in ((-2.0, 1.0), (-5e-4, 0.0)):
            text = BOUNCE.format(**words, side="side: 1", pull=-20, height=-0.01).replace(
                f"body.{words['v']}: 0", f"body.{words['v']}: {speed} {words['X']}/s")
            result = run(text, until="10 ms")
            agree(result[f"body.{words['v']}"][-1], then - 0.1*(then > 0), rtol=1e-6, size=1.0)


@checks("RigidStop", "RotationalRigidStop")
@pytest.mark.parametrize("side", [1, -1])
def test_a_body_bounces_and_comes_to_rest(side: int) -> None:
    """Newton's impact law: from the height h it rises to e**2 h, and rests after t_0 (1 + e)/(1 - e), t_0 = sqrt(2 h/g)."""
    for words in BOUNCING:
        result = run(BOUNCE.format(**words, side=f"side: {side}", pull=-side*20, height=side*0.5))
        time, height, first = result.time, side*result[f"body.{words['x']}"], np.sqrt(2*0.5/10)
        bounce = (time > first) & (time < 2*first)
        # the top lies between two points 1 ms apart: 10/2 (0.5 ms)**2 at most
        assert height[bounce].max() == pytest.approx(0.25*0.5, abs=2e-6)
        agree(height[time > 3*first + 0.02], 0.0, rtol=1e-6, size=1.0)
        agree(result["stop.N"][-1], 20.0, rtol=1e-6)
