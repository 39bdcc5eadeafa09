"""Signal blocks beside the formulas of their sources."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from library_check import CHECKED, Array, _seen, agree, checks, cubic_spline, part, run
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import PchipInterpolator, RegularGridInterpolator
from scipy.special import gamma

import heavebond as hb
from heavebond.core.errors import ModelError
from heavebond.language.symbols import uniform

PD_ON_A_MASS = """\
model: pd
components:
  pid: {is: PID, K_p: 20 N/m, K_d: 20 N*s/m, y_min: -5 N, y_max: 5 N, r: 10 m, u: =l.x}
  push: {is: ForceSource, u: =pid.y}
  cart: {is: Mass, m: 10 kg}
nodes: {l: [push.a, cart.a]}
initial: {l.x: 0 m, l.v: 0 m/s}
simulate: {until: 60 s, every: 50 ms}
"""

RANDOM = np.random.default_rng(4)


def rows(matrix: NDArray[np.float64], unit: str = "") -> str:
    """A matrix as a diagram has it."""
    return str([[f"{value!r}{unit}" for value in row] for row in matrix.tolist()]).replace("'", "")



@checks("PID")
def test_the_three_parts_of_a_controller_and_its_limits() -> None:
    """w = K_p e + q + K_d (e - z)/T_f; q' = K_i e + (y - w)/T_t, z' = (e - z)/T_f (Astrom, Haegglund, section 3.5)."""
    law = part("PID", r="1 m", u="0 m", K_p="2 N/m", K_i="4 N/(m*s)", K_d="0.1 N*s/m", T_f="10 ms", T_t="0.2 s",
               y_min="-5 N", y_max="5 N")
    r, z, q = np.array([1.0, 3.0, -2.0, 0.0]), np.array([1.0, 2.9, 0.0, 0.0]), np.array([0.5, 1.0, 1.0, -7.0])
    found = law({"r": r, "u": 0.0, "z": z, "q": q})
    w = 2*r + q + 0.1*(r - z)/0.01
    agree(found["y"], np.clip(w, -5, 5))
    agree(found["der(z)"], (r - z)/0.01)
    agree(found["der(q)"], 4*r + (np.clip(w, -5, 5) - w)/0.2)


@checks("PID")
def test_a_controller_without_integral_gain_returns_from_its_limit() -> None:
    """What leads the integral back must not charge it: a PD controller is the same after saturation as before."""
    result = run(PD_ON_A_MASS)
    agree(np.ptp(result["pid.q"]), 0.0, size=1.0)
    assert result["pid.w"].max() > 100  # twenty times the limit
    assert result["l.x"][-1] == pytest.approx(10, abs=1e-6)


@checks("PID")
def test_the_rate_of_the_anti_windup_goes_to_zero_with_the_integral_gain() -> None:
    """1/T_t, and from K_p/K_i = 20 T_t on 20 K_i/K_p, continuous at both ends and for reversed action."""
    K_i = np.array([-100.0, 100.0, 1.0, 0.5, 1e-3, 1e-9, 0.0])
    law = part("PID", r="0 m", u="0 m", K_p="2 N/m", T_t="0.2 s", y_min="-5 N", y_max="5 N")
    found = law({"r": 0.0, "u": 0.0, "K_i": K_i, "z": 0.0, "q": 7.0})
    agree(found["der(q)"], -2*np.minimum(1/0.2, 20*np.abs(K_i)/2))


@checks("Quantiser")
def test_a_jump_of_any_number_of_steps_is_read_at_once() -> None:
    """k = floor(u/step + 1/2), whatever it was before (Astrom, Wittenmark, section 9.4)."""
    result = run("""\
model: adc
components:
  adc: {is: Quantiser, step: 2 mV, T_s: 10 ms, u: "=if_else(time < 0.105 s, 3 V, -7.0011 V)"}
simulate: {until: 0.2 s, every: 4 ms}
""")
    agree(np.interp([0.05, 0.104, 0.15], result.time, result["adc.y"]), [3.0, 3.0, -7.002])


def test_a_sign_of_a_periodic_function_of_time_switches_exactly_and_with_its_parameters() -> None:
    """y(2 s) = k (pi T - pi T + 2 s - 2 pi T) for k = 2/s, T = 0.3 s."""
    run = hb.simulate(hb.loads("""\
model: square
parameters: {T: 0.3 s, k: 2}
components: {part: {is: Integrator, k: 1 1/s, u: "=k*sign(sin(time/T))"}}
simulate: {until: 2 s}
"""), sensitivities=["T", "k"])
    # the instants are exact, the integral of a constant too
    assert run.si["part.y"][-1] == pytest.approx(4 - 1.2 * np.pi, abs=1e-6)
    assert run.sensitivity("part.y", "T")[-1] == pytest.approx(-4 * np.pi, rel=1e-6)
    assert run.sensitivity("part.y", "k")[-1] == pytest.approx(2 - 0.6 * np.pi, rel=1e-5)


def test_floor_of_what_moves_is_refused_outside_of_events() -> None:
    text = """\
model: stairs
components:
  source: {is: ForceSource, u: "=1 N*floor(cart.x/(1 m))"}
  cart: {is: Mass, m: 1 kg}
nodes: {cart: [source.a, cart.a]}
simulate: {until: 1 s}
"""
    with pytest.raises(ModelError) as caught:
        hb.simulate(hb.loads(text))
    assert [p.code for p in caught.value.problems] == ["floor-moves"]
    assert "then:" in str(caught.value)
    with pytest.raises(ModelError, match="SampleHold of a Ramp"):
        hb.simulate(hb.loads(text.replace("cart.x/(1 m)", "sin(time/(1 s))")))


def test_the_advice_for_floor_of_the_time_gives_its_staircase() -> None:
    text = """\
model: stairs
components:
  source: {is: ForceSource, u: "=1 N*floor(time/(0.3 s)) + 2 N"}
  cart: {is: Mass, m: 1 kg}
nodes: {cart: [source.a, cart.a]}
simulate: {until: 1 s, every: 50 ms}
"""
    with pytest.raises(ModelError) as caught:
        hb.simulate(hb.loads(text))
    block, part = re.search(r"Add `(.*)` and write (\S+) in place of floor", caught.value.problems[0].hint).groups()  # type: ignore[union-attr]
    followed = text.replace("floor(time/(0.3 s))", part).replace("  cart: {is", f"  {block}\n  cart: {{is", 1)
    run = hb.simulate(hb.loads(followed))
    assert run["source.u"] == pytest.approx(np.floor(run.time / 0.3 + 1e-9) + 2, abs=1e-9)


# -- blocks without memory ----------------------------------------------------------------------------------------------
U, W = np.array([-3.0, -0.5, 0.0, 0.2, 4.0]), np.array([2.0, -0.5, 1.0, 0.1, -7.0])
TIME = np.linspace(-0.0, 5.0, 101)
ACROSS, ALONG = np.repeat([-1.0, 0.0, 0.3, 1.0, 2.2, 9.0], 4), np.tile([-2.0, -0.7, 0.4, 3.0], 6)
HEIGHTS = [5.0, -2.0, 3.0, 0.5, 0.0, -1.0, 4.0, 2.0, -6.0]
FACTORS = ("LinearVariation", "BentVariation", "PiecewiseVariation", "StepVariation", "Onset", "VariationByDirection")
STATIC: list[tuple[str, dict[str, object], dict[str, object], object]] = [
    ("Absolute", {"u": "0 V"}, {"u": U}, np.where(U < 0, -U, U)),
    ("And", {}, {"u_1": [0, 0, 1, 1], "u_2": [0, 1, 0, 1]}, [0, 0, 0, 1]),
    ("Or", {}, {"u_1": [0, 0, 1, 1], "u_2": [0, 1, 0, 1]}, [0, 1, 1, 1]),
    ("Not", {}, {"u": [0, 1]}, [1, 0]),
    ("Constant", {"k": "3 V"}, {"time": TIME}, 3.0),
    ("DeadBand", {"u": "0 V", "g": "0.3 V"}, {"u": U}, np.sign(U)*np.maximum(np.abs(U) - 0.3, 0)),
    ("Division", {"u_1": "0 V", "u_2": "1 A"}, {"u_1": U, "u_2": W}, U/W),
    ("Product", {"u_1": "0 V", "u_2": "1 A"}, {"u_1": U, "u_2": W}, U*W),
    ("Sum", {"u_1": "0 V", "u_2": "0 V", "k_1": 2.0, "k_2": -3.0}, {"u_1": U, "u_2": W}, 2*U - 3*W),
    ("Maximum", {"u_1": "0 V", "u_2": "0 V"}, {"u_1": U, "u_2": W}, np.where(U > W, U, W)),
    ("Minimum", {"u_1": "0 V", "u_2": "0 V"}, {"u_1": U, "u_2": W}, np.where(U < W, U, W)),
    ("Gain", {"u": "0 V", "k": "4 N/V"}, {"u": U}, 4*U),
    ("SensorGain", {"u": "0 V", "e": -0.02}, {"u": U}, 0.98*U),
    ("LinearVariation", {"u": "0 V", "k": 0.4, "u_0": "1 V", "u_m": "2 V"}, {"u": U}, 1 + 0.4*np.clip((U - 1)/2, -1, 1)),
    ("BentVariation", {"u": "0 V", "k_a": 0.4, "k_b": -0.2, "u_0": "0 V", "u_m": "5 V"}, {"u": U},
     1 + np.where(U > 0, -0.04, -0.08)*U),
    ("PiecewiseVariation", {"u": "0 V", "k_a": 0.4, "k_b": -0.2, "k_c": 0.6, "k_d": 0.1, "u_0": "0.5 V", "u_m": "2 V"},
     {"u": U}, 1 + np.interp(U, [-1.5, -0.5, 0.5, 1.5, 2.5], [0.4, -0.2, 0.0, 0.6, 0.1])),
    ("StepVariation", {"u": "0 V", "k": 0.5, "t_0": "1 V", "u_m": "5 V"}, {"u": U}, 1 + 0.25*(1 + np.tanh((U - 1)/0.1))),
    ("Onset", {"u": "0 V", "t_0": "1 V", "u_m": "5 V"}, {"u": U}, (1 + np.tanh((U - 1)/0.1))/2),
    ("VariationByDirection", {"u": "0 V", "k": 0.3, "u_m": "5 V"}, {"u": U}, 1 + 0.3*np.tanh(U/0.1)),
    ("SensorOffset", {"u": "0 V", "offset": "0.3 V"}, {"u": U}, U + 0.3),
    ("SensorDrift", {"u": "0 V", "r": "0.3 V/s"}, {"u": 2.0, "time": TIME}, 2 + 0.3*TIME),
    ("CurvedGain", {"u": "0 V", "k": 0.4, "u_m": "2 V"}, {"u": U}, 0.6*U + 0.2*U*np.abs(U)),
    ("SidedGain", {"u": "0 V", "e": 0.1}, {"u": U}, np.where(U > 0, U, 1.1*U)),
    ("Saturation", {"u": "0 V", "u_min": "-1 V", "u_max": "2 V"}, {"u": U}, np.clip(U, -1, 2)),
    ("HeaveController", {"K_p": "0.5 1/m", "K_v": "0.2 s/m"}, {"z": U, "v": W}, np.clip(-0.5*U - 0.2*W, -1, 1)),
    ("Lookup", {"u": "0 V", "x": "[-1 V, 0 V, 2 V]", "v": "[5 N, 1 N, -3 N]"}, {"u": U},
     np.interp(U, [-1, 0, 2], [5, 1, -3])),
    ("Lookup", {"u": "0 V", "x": "[-1 V, 0 V, 1 V]", "v": "[5 N, 1 N, -3 N]", "outside": 1}, {"u": U},
     1 - 4*U),
    ("Lookup", {"u": "0 V", "x": "[-1 V, 0 V, 2 V]", "v": "[5 N, 1 N, 5 N]", "outside": 2}, {"u": 3*U},
     np.interp((3*U + 1) % 3 - 1, [-1, 0, 2], [5, 1, 5])),
    ("StepLookup", {"u": "0 V", "x": "[-1 V, 0 V, 2 V]", "v": "[5 N, 1 N, -3 N]"}, {"u": U},
     np.interp(U, [-1, 0, 2], [5, 1, -3])),  # without steps
    ("MonotoneLookup", {"u": "0 V", "x": "[-2 V, -1.5 V, 0 V, 1 V, 2 V]", "v": "[0 N, 3 N, 3.5 N, 3.5 N, -2 N]"}, {"u": U},
     PchipInterpolator([-2, -1.5, 0, 1, 2], [0, 3, 3.5, 3.5, -2])(np.clip(U, -2, 2))),
    ("TableSource", {"t": "[1 s, 2 s, 4 s]", "v": "[5 N, 1 N, -3 N]"}, {"time": TIME},
     np.interp(TIME, [1, 2, 4], [5, 1, -3])),
    ("TableSource", {"t": "[1 s, 2 s, 2 s, 4 s]", "v": "[5 N, 1 N, 2 N, -2 N]", "outside": 1}, {"time": TIME + 1e-3},
     np.where(TIME + 1e-3 < 2, 5 - 4*(TIME + 1e-3 - 1), 2 - 2*(TIME + 1e-3 - 2))),
    ("TableSource", {"t": "[1 s, 2 s, 4 s]", "v": "[5 N, 1 N, 5 N]", "outside": 2}, {"time": 3*TIME - 1},
     np.interp((3*TIME - 2) % 3 + 1, [1, 2, 4], [5, 1, 5])),
    ("Lookup2", {"u_1": "0 V", "u_2": "0 A", "x_1": "[0 V, 1 V, 3 V]", "x_2": "[-1 A, 1 A]", "v": "[1, 2, 3, 5, 8, 13]"},
     {"u_1": ACROSS, "u_2": ALONG},
     RegularGridInterpolator(([0.0, 1.0, 3.0], [-1.0, 1.0]), np.array([[1, 2], [3, 5], [8, 13.0]]))(
         (np.clip(ACROSS, 0, 3), np.clip(ALONG, -1, 1)))),
    ("SignalCurve", {"u": "0 V", "x_0": "0.2 V", "x_r": "2 V", **{f"y_{k + 1}": f"{h} V" for k, h in enumerate(HEIGHTS)}},
     {"u": U}, U + cubic_spline(2*(U - 0.2), HEIGHTS)),
    ("Ramp", {"rate": "2 V/s", "t_s": 1.0, "t_e": 3.0, "start": "0.5 V"}, {"time": TIME}, 0.5 + 2*(np.clip(TIME, 1, 3) - 1)),
    ("Sine", {"a": "2 V", "T": 3.0, "phi": 0.4, "offset": "1 V"}, {"time": TIME}, 1 + 2*np.sin(2*np.pi/3*TIME + 0.4)),
    ("RegularSea", {"a": 2.0, "T": 8.0, "t_r": 3.0}, {"time": TIME},
     2*(1 - np.exp(-(TIME/3)**3))*np.sin(2*np.pi*TIME/8)),
]
for _name, *_ in STATIC:
    CHECKED.setdefault(_name, []).append(f"{__name__}.test_block_without_memory")


@pytest.mark.parametrize(("component", "parameters", "given", "expected"), STATIC, ids=[row[0] for row in STATIC])
def test_block_without_memory(component: str, parameters: dict[str, object], given: dict[str, ArrayLike],
                              expected: ArrayLike) -> None:
    found = part(component, **parameters)(given)
    names = {"RegularSea": "z", "HeaveController": "u", **dict.fromkeys(FACTORS, "factor")}
    agree(found[names.get(component, "y")], expected, size=1.0)


# -- motions and signals over time --------------------------------------------------------------------------------------
@pytest.mark.parametrize(("component", "given", "fastest", "hardest"), [
    ("PolynomialMotion", {"T": 2.0}, 15/8*3/2, 10/np.sqrt(3)*3/2**2),
    ("SCurveMotion", {"T": 2.0}, 2*3/2, 2*np.pi*3/2**2),
    ("TrapezoidalMotion", {"v": "2 m/s", "a": "4 m/s**2"}, 2.0, 4.0),
    ("TrapezoidalMotion", {"v": "5 m/s", "a": "4 m/s**2"}, np.sqrt(3*4), 4.0)])  # the way is too short for 5 m/s
def test_motion_goes_from_place_to_place_within_its_stated_rates(component: str, given: dict[str, object], fastest: float,
                                                                 hardest: float) -> None:
    t = np.linspace(0, 6, 6001)
    found = part(component, start="-1 m", end="2 m", t_s=1.0, **given)({"time": t})
    y, w = found["y"], found["w"]
    agree(np.array([y[0], y[t < 1][-1], y[-1]]), [-1, -1, 2])
    agree(cumulative_trapezoid(w, t, initial=0) - 1, y, rtol=1e-5, size=1.0)  # w is the rate of y; step 1 ms
    agree(w.max(), fastest, rtol=1e-3)                                        # a corner lies between two points
    agree(np.abs(np.diff(w)/np.diff(t)).max(), hardest, rtol=1e-5)            # difference over 1 ms
    other = part(component, start="2 m", end="-1 m", t_s=1.0, **given)({"time": t})
    agree(other["y"], 1 - y, size=1.0)                                        # the way back is the same


for _name in ("PolynomialMotion", "SCurveMotion", "TrapezoidalMotion"):
    CHECKED.setdefault(_name, []).append(f"{__name__}.test_motion_goes_from_place_to_place_within_its_stated_rates")


@checks("Chirp")
def test_chirp() -> None:
    """The phase is the integral of the frequency, which grows evenly and then stays."""
    t = np.linspace(0, 6, 6001)
    y = part("Chirp", a="2 V", f_1=1.0, f_2=5.0, T=4.0, offset="1 V")({"time": t})["y"]
    phase = 2*np.pi*cumulative_trapezoid(np.interp(t, [0, 4], [1, 5]), t, initial=0)
    agree(y, 1 + 2*np.sin(phase), rtol=1e-7, size=1.0)


@checks("Multisine")
def test_multisine() -> None:
    """n lines of equal size at multiples of f_0, with the given root mean square and Schroeder's low peak."""
    t = np.arange(0, 2, 1e-3)
    y = part("Multisine", n=10, f_0=0.5, rms="3 V")({"time": t})["y"]
    agree(np.sqrt(np.mean(y**2)), 3.0)
    lines = np.abs(np.fft.rfft(y))*2/len(t)
    agree(lines[1:11], 3*np.sqrt(2/10))
    agree(lines[11:], 0.0, size=1.0)
    assert np.abs(y).max()/3 == pytest.approx(1.9, abs=0.1)


@checks("IrregularSea")
def test_irregular_sea_has_the_moments_of_its_spectrum() -> None:
    """H_s = 4 sqrt(m_0); mean period T_1 = 2 pi m_0/m_1 = 0.772 T_p of a Pierson-Moskowitz spectrum; no two seeds alike."""
    t = np.arange(200, 10200, 0.5)
    sea = part("IrregularSea", H_s=3.0, T_p=10.0, t_r=5.0, n=200, seed=7)({"time": t})["z"]
    assert 4*sea.std() == pytest.approx(3.0, rel=0.02)
    power, f = np.abs(np.fft.rfft(sea))**2, np.fft.rfftfreq(len(t), 0.5)
    mean_period = power.sum()/(power*f).sum()
    # closed form of S ~ w**-5 exp(-1.25 (w_p/w)**4): T_1/T_p = 1.25**(1/4)/... = Gamma(1)/(Gamma(3/4) 1.25**(1/4))
    assert mean_period == pytest.approx(10/(gamma(0.75)*1.25**0.25), rel=0.02)
    other = part("IrregularSea", H_s=3.0, T_p=10.0, t_r=5.0, n=200, seed=8)({"time": t})["z"]
    assert abs(np.corrcoef(sea, other)[0, 1]) < 0.1
    peaked = part("IrregularSea", H_s=3.0, T_p=10.0, t_r=5.0, n=200, seed=7, gamma=3.3)({"time": t})["z"]
    # 1 - 0.287 log(gamma) is a fit of DNV-RP-C205 to the peaked spectrum
    assert 4*peaked.std() == pytest.approx(3.0, rel=0.04)
    agree(part("IrregularSea", H_s=3.0, T_p=10.0, t_r=5.0)({"time": 0.0})["z"], 0.0, size=1.0)


SEA = "H_s: 3 m, T_p: 9 s, gamma: 3.3, t_r: 6 s, n: 12, seed: 3"
TABLE = "omega: [0.3 rad/s, 0.6 rad/s, 1.2 rad/s], beta: [0 deg, 90 deg]"
VESSEL = f"""
model: vessel
components:
  sea:  {{is: IrregularSea, {SEA}}}
  same: {{is: SeaResponse, {SEA}, heading: 30 deg, {TABLE}, amplitude: [[1, 1], [1, 1], [1, 1]],
         phase: [[0 rad, 0 rad], [0 rad, 0 rad], [0 rad, 0 rad]]}}
  ship: {{is: SeaResponse, {SEA}, heading: 30 deg, {TABLE}, amplitude: [[1, 0.9], [0.5, 1.2], [0.1, 0.3]],
         phase: [[0 rad, 0 rad], [3 rad, -0.5 rad], [-3 rad, -2 rad]]}}
nodes: {{sea: [sea.z], same: [same.z], ship: [ship.z]}}
show: {{sea: {{is: sea.z, unit: m}}, same: {{is: same.z, unit: m}}, ship: {{is: ship.z, unit: m}}}}
simulate: {{until: 60 s, every: 0.5 s}}
"""


@checks("SeaResponse")
def test_sea_response_is_the_sum_of_the_responses() -> None:
    """By NumPy from the table: bilinear in the complex response, so that phases of 3 and -3 rad are near each other. A
    table of ones is the sea itself."""
    found, n, seed, peak = run(VESSEL), 12, 3, 3.3
    agree(found.display["same"], found.display["sea"])
    t, number = found.time, range(1, n + 1)
    share = np.array([i - 0.75 + 0.5*uniform(seed, i) for i in number])/n
    ratio = (1.25/-np.log(share))**0.25
    omega, start = 2*np.pi/9*ratio, 2*np.pi*np.array([uniform(seed, n + i) for i in number])
    waves = 3/4*np.sqrt(2/n*(1 - 0.287*np.log(peak)))*peak**(0.5*np.exp(-0.5*((ratio - 1)/0.08)**2))
    table = np.array([[1, 0.9], [0.5, 1.2], [0.1, 0.3]])*np.exp(1j*np.array([[0, 0], [3, -0.5], [-3, -2]]))
    row = table[:, 0] + (table[:, 1] - table[:, 0])*30/90
    response = np.interp(omega, [0.3, 0.6, 1.2], row.real) + 1j*np.interp(omega, [0.3, 0.6, 1.2], row.imag)
    moving = np.exp(1j*(np.multiply.outer(t, omega) + start)) @ (waves*response)
    agree(found.display["ship"], (1 - np.exp(-(t/6)**3))*moving.imag, rtol=1e-8, size=1.0)


SPREAD = """
model: spread
components:
  sea:  {is: IrregularSea, H_s: 3 m, T_p: 9 s, t_r: 6 s, n: 60, seed: 3}
  same: {is: ShortCrestedResponse, H_s: 3 m, T_p: 9 s, t_r: 6 s, n: 60, seed: 3, heading: 150 deg, s: 4, m: 12,
         omega: [0.3 rad/s, 1 rad/s], beta: [0 deg, 360 deg], amplitude: [[1, 1], [1, 1]],
         phase: [[0 deg, 0 deg], [0 deg, 0 deg]]}
  roll: {is: ShortCrestedResponse, H_s: 3 m, T_p: 9 s, t_r: 6 s, n: 60, seed: 3, heading: 150 deg, s: 4, m: 12,
         omega: [0.4 rad/s, 1.2 rad/s], beta: [-180 deg, -90 deg, 0 deg, 90 deg, 180 deg],
         amplitude: [[0, 2, 0, 2, 0], [0, 0.4, 0, 0.4, 0]],
         phase: [[0 deg, -90 deg, 0 deg, 90 deg, 0 deg], [0 deg, -90 deg, 0 deg, 90 deg, 0 deg]]}
nodes: {sea: [sea.z], same: [same.z], roll: [roll.z]}
show: {sea: {is: sea.z, unit: m}, same: {is: same.z, unit: m}, roll: {is: roll.z, unit: m}}
simulate: {until: 3000 s, every: 1 s}
"""


@pytest.mark.long  # 60 sines of two motions over 3000 s
@checks("ShortCrestedResponse")
def test_a_short_crested_sea_has_the_spectrum_of_its_directions() -> None:
    """The spectrum of a response is the integral of S(w) D(delta) |H(w, heading + delta)|**2 over the directions, here by
    quadrature with D ~ cos(delta/2)**(2 s): as a whole, and in three ranges of frequency with a third of the energy of
    the waves each. At an angle of 30 degrees from ahead the ship rolls 1.5 times as much as in long-crested waves."""
    found = run(SPREAD)
    agree(found.display["same"], found.display["sea"])
    peak, delta = 2*np.pi/9, np.linspace(-np.pi, np.pi, 2001)[:-1]
    omega = np.linspace(0.2, 6, 20001)
    spectrum = 5/16*3**2*peak**4/omega**5*np.exp(-1.25*(peak/omega)**4)
    density = np.cos(delta/2)**8/np.sum(np.cos(delta/2)**8)
    place = np.mod(5/6*np.pi + delta + np.pi, 2*np.pi) - np.pi
    across = np.sum(density*np.interp(place, np.radians([-180, -90, 0, 90, 180]), [0, -1, 0, 1, 0])**2)
    expected = spectrum*across*np.interp(omega, [0.4, 1.2], [2, 0.4])**2
    still = slice(300, None)
    # the sampling of 60 directions; a spectrum without the spread is 0.44 of this
    assert found.display["roll"][still].var() == pytest.approx(np.trapezoid(expected, omega), rel=0.05)
    assert across == pytest.approx((1.5/3)**2, rel=0.02)
    power = np.abs(np.fft.rfft(found.display["roll"][still]))**2
    limits = [0, *(peak*(1.25/-np.log(share))**0.25 for share in (0.33, 0.67)), 6]
    seen = 2*np.pi*np.fft.rfftfreq(len(found.time) - 300, 1)
    for low, high in pairwise(limits):
        part_of = np.sum(power[(seen >= low) & (seen < high)])/np.sum(power[1:])
        there = (omega >= low) & (omega < high)
        assert part_of == pytest.approx(np.trapezoid(expected*there, omega)/np.trapezoid(expected, omega), rel=0.1)


def test_tables_must_contain_the_waves() -> None:
    """A heading outside the table is refused. Waves of 3 s are shorter than those of the table; 98 % of a Pierson-Moskowitz
    spectrum of 9 s is in 0.3 to 1.85 rad/s: 1.25 (2 pi/(9*1.85))**4 = 0.0254."""
    with pytest.raises(ModelError, match="heading <= beta"):
        hb.assemble(hb.loads(VESSEL.replace("heading: 30 deg", "heading: 100 deg")))
    covered = VESSEL.replace("1.2 rad/s]", "1.85 rad/s]").replace("until: 60 s", "until: 1 s")
    assert run(covered)["ship.K"][-1] == pytest.approx(np.exp(-0.0254), rel=1e-3) and not run(covered).verdict.findings
    with pytest.warns(match="ship.K.*add frequencies to omega"):
        run(covered.replace("T_p: 9 s", "T_p: 3 s"))


def test_the_table_of_a_short_crested_sea_goes_round() -> None:
    with pytest.raises(ModelError, match="beta"):
        hb.assemble(hb.loads(SPREAD.replace("[0 deg, 360 deg]", "[0 deg, 180 deg]")))


# -- linear dynamics ----------------------------------------------------------------------------------------------------
@checks("FirstOrderLag", "Integrator", "FilteredDerivative", "SecondOrderLag", "RateLimit")
def test_rates_of_lags() -> None:
    agree(part("FirstOrderLag", u="0 V", T_1=0.2)({"u": U, "y": W})["der(y)"], (U - W)/0.2)
    agree(part("Integrator", u="0 V", k="3 N/(V*s)")({"u": U})["der(y)"], 3*U)
    found = part("FilteredDerivative", u="0 V", T_f=0.02)({"u": U, "z": W})
    agree(found["y"], (U - W)/0.02)
    agree(found["der(z)"], (U - W)/0.02)
    # y'' + 2 zeta w y' + w**2 y = w**2 u with y' = w z
    w = 2*np.pi*5
    found = part("SecondOrderLag", u="0 V", f_n=5.0, zeta=0.3)({"u": U, "y": W, "z": 0.4})
    agree(found["der(y)"], w*0.4)
    agree(w*found["der(z)"], w**2*U - w**2*W - 2*0.3*w*(w*0.4))
    # a rate limit: the wanted rate below the limit (1e-3 off at 0.7 of it), the limit above
    wanted = np.array([-50.0, -1.0, 0.0, 0.7, 3.0])
    rate = part("RateLimit", u="0 V", r_max="2 V/s", T_f=1e-3)({"u": 1 + 1e-3*wanted, "y": 1.0, "z": 1.0})["der(y)"]
    agree(rate, np.clip(wanted, -2, 2), rtol=1e-4, size=2.0)


def response(component: str, frequency: Array, names: list[str], **given: object) -> NDArray[np.complex128]:
    """Frequency response of a linear block, whose matrices are read from its law by unit vectors."""
    law, n = part(component, u="0 V", **given), len(names)
    rates = [f"der({name})" for name in names]
    points = np.vstack([np.eye(n + 1)])
    found = law({"u": points[:, n], **{name: points[:, k] for k, name in enumerate(names)}})
    A = np.array([found[r][:n] for r in rates])
    B = np.array([found[r][n] for r in rates])
    C, D = found["y"][:n], found["y"][n]
    s = 2j*np.pi*frequency
    return np.array([C @ np.linalg.solve(k*np.eye(n) - A, B) + D for k in s])


@checks("PadeDelay", "DelayChain")
def test_delays() -> None:
    """exp(-s T): gain 1 and phase -2 pi f T within 1 degree at the stated frequencies; a chain is (1 + s T/n)**-n."""
    for m, reach in ((1, 0.27), (2, 0.73), (3, 1.23), (4, 1.77)):
        f = np.linspace(0.01, reach, 40)/0.5
        states = [f"{name}[{k + 1}]" for name in "wz" for k in range(m)]
        found = response("PadeDelay", f, states, T=0.5, m=m)
        agree(np.abs(found), 1.0, rtol=1e-8)
        error = np.degrees(np.angle(found*np.exp(2j*np.pi*f*0.5)))
        # the reaches are stated to 0.01, where the error grows as the power 4 m + 1 of f T: 4 to 10 %
        assert np.abs(error).max() == pytest.approx(1.0, abs=0.1)
    f = np.array([0.1, 1.0, 3.0])
    found = response("DelayChain", f, [f"z[{k + 1}]" for k in range(4)], T=0.5, n=4)
    agree(found.real, ((1 + 2j*np.pi*f*0.5/4)**-4).real)
    agree(found.imag, ((1 + 2j*np.pi*f*0.5/4)**-4).imag)


@checks("Delay")
def test_exact_delay_shifts_its_input() -> None:
    found = run("""\
model: shifted
components:
  part: {is: Delay, T: 0.25 s, u: "=1 V*exp(-time/1 s)"}
simulate: {until: 2 s, every: 10 ms}
""")
    agree(found["part.d"], np.exp(-np.clip(found.time - 0.25, 0, None)), rtol=1e-7)


@checks("LinearSystem", "MatrixGain")
def test_systems_of_vectors_are_products_of_matrices() -> None:
    a, b, c, d = (RANDOM.normal(size=shape) for shape in ((2, 2), (2, 3), (1, 2), (1, 3)))
    law = part("LinearSystem", n=2, m=3, r=1, A=rows(a, " 1/s"), B=rows(b, " 1/s"), C=rows(c), D=rows(d))
    x, u = RANDOM.normal(size=2), RANDOM.normal(size=3)
    found = law({**{f"x[{k + 1}]": x[k] for k in range(2)}, **{f"u[{k + 1}]": u[k] for k in range(3)}})
    agree([found[f"der(x[{k + 1}])"] for k in range(2)], a @ x + b @ u)
    agree(found["y[1]"], (c @ x + d @ u)[0])
    found = part("MatrixGain", n=2, m=3, K=rows(b, " N"))({f"u[{k + 1}]": u[k] for k in range(3)})
    agree([found[f"y[{k + 1}]"] for k in range(2)], b @ u)


@checks("TransferFunction", "StateSpace", "StateSpace22")
def test_linear_systems_have_their_frequency_response() -> None:
    f = np.array([0.01, 0.2, 1.5])
    s = 2j*np.pi*f
    found = response("TransferFunction", f, ["z[1]", "z[2]"], a="[2, 6, 4]", b="[1, 1, 3]", T=0.5)
    q = 0.5*s
    expected = (q**2 + q + 3)/(2*q**2 + 6*q + 4)
    agree(np.array([found.real, found.imag]), np.array([expected.real, expected.imag]))
    A, B, C = np.array([[-1.0, 2.0], [-3.0, -0.5]]), np.array([0.5, 1.0]), np.array([2.0, -1.0])
    found = response("StateSpace", f, ["x[1]", "x[2]"], A="[-1 1/s, 2 1/s, -3 1/s, -0.5 1/s]", B="[0.5 1/s, 1 1/s]",
                     C="[2, -1]", D=0.7)
    expected = np.array([C @ np.linalg.solve(k*np.eye(2) - A, B) + 0.7 for k in s])
    agree(np.array([found.real, found.imag]), np.array([expected.real, expected.imag]))
    law = part("StateSpace22", u_1="0 V", u_2="0 N", A="[-1 1/s, 2 1/s, -3 1/s, -0.5 1/s]", B_1="[0.5 1/(V*s), 1 1/(V*s)]",
               B_2="[3 1/(N*s), -2 1/(N*s)]", C_1="[2 m, -1 m]", C_2="[1 Pa, 4 Pa]", D_11="0.1 m/V", D_12="0.2 m/N",
               D_21="0.3 Pa/V", D_22="0.4 Pa/N")
    x, u = np.array([0.3, -0.8]), np.array([2.0, 5.0])
    found = law({"x[1]": x[0], "x[2]": x[1], "u_1": u[0], "u_2": u[1]})
    rates = A @ x + np.array([[0.5, 3.0], [1.0, -2.0]]) @ u
    agree([found["der(x[1])"], found["der(x[2])"]], rates)
    agree([found["y_1"], found["y_2"]], np.array([[2.0, -1.0], [1.0, 4.0]]) @ x + np.array([[0.1, 0.2], [0.3, 0.4]]) @ u)


# -- switches and samplers ----------------------------------------------------------------------------------------------
SWITCHED = """\
model: switched
components:
  comparator: {is: Comparator, u: "=1 V*sin(2*pi*time/1 s + 0.5)", level: 0.2 V}
  switch: {is: Switch, u_1: 3 N, u_2: "=-1 N*time/1 s", u: "=1 V*sin(2*pi*time/1 s + 0.5)", level: 0.2 V}
  relay:  {is: Relay, u: "=1 V*sin(2*pi*time/1 s + 0.5)", u_on: 0.6 V, u_off: -0.3 V, y_on: 5 A, y_off: 1 A}
  step:   {is: Step, t_s: 0.73 s, before: 1 V, after: 4 V}
  pulse:  {is: Pulse, t_s: 0.31 s, width: 0.42 s, height: 4 V, rest: 1 V}
  square: {is: SquareWave, low: 1 V, high: 4 V, T: 0.4 s, duty: 0.3, t_s: 0.1 s}
  hold:   {is: SampleHold, u: "=1 V*time/1 s", T_s: 0.17 s, t_0: 0.05 s}
  late:   {is: DelayedSampleHold, u: "=1 V*time/1 s", T_s: 0.17 s, T_d: 0.06 s, t_0: 0.05 s}
simulate: {until: 2 s, every: 1.37 ms}
"""


@checks("Comparator", "Switch", "Relay", "Step", "Pulse", "SquareWave", "SampleHold", "DelayedSampleHold")
def test_what_switches_does_so_at_its_instants() -> None:
    result = run(SWITCHED)
    t = result.time
    u = np.sin(2*np.pi*t + 0.5)
    relay = [1.0 if np.sin(0.5) > 0.6 else 0.0]
    for value in u[1:]:
        relay.append(1.0 if value > 0.6 else 0.0 if value < -0.3 else relay[-1])
    sample = np.floor((t - 0.05)/0.17 + 1e-9)
    taken = np.where(t >= 0.05, 0.05 + 0.17*sample, 0.0)
    put = np.floor((t - 0.11)/0.17 + 1e-9)
    expected = {
        "comparator.y": (u > 0.2).astype(float), "switch.y": np.where(u > 0.2, 3.0, -t),
        "relay.y": 1 + 4*np.array(relay), "step.y": np.where(t >= 0.73, 4.0, 1.0),
        "pulse.y": np.where((t >= 0.31) & (t < 0.73), 4.0, 1.0),
        "square.y": np.where((t >= 0.1) & (np.mod(t - 0.1 + 1e-9, 0.4) < 0.12), 4.0, 1.0),
        "hold.y": taken, "late.y": np.where(t >= 0.11, 0.05 + 0.17*put, 0.0)}
    for name, values in expected.items():
        agree(result[name], values, rtol=1e-6, size=1.0)


@checks("Record")
def test_record(tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_text("time,heave\n0,1\n0.5,3\n1.0,-2\n", encoding="utf-8")
    model = hb.loads("""\
model: record
components:
  part: {is: Record, u: {file: r.csv, column: heave, unit: mm, interpolation: linear, time: {column: time, unit: s}}}
simulate: {until: 1 s, every: 50 ms}
""", tmp_path)
    result = hb.simulate(model)
    _seen.add("Record")
    agree(result["part.y"], np.interp(result.time, [0, 0.5, 1], [1e-3, 3e-3, -2e-3]), size=1e-3)


@checks("StateMachine")
def test_state_machine_takes_the_first_released_transition() -> None:
    """By hand: state 2 may go to 3 (after 0.5 s) or to 1; its value, the active state, the transition that comes first."""
    law = part("StateMachine", n=3, y_s="[2 V, 5 V, -10 V]", to="[3, 1, 1]", T="[0.5 s, 0.1 s, 0.1 s]",
               **{"from": "[2, 2, 3]"})
    released = {"u[1]": 1.0, "u[2]": 1.0, "u[3]": 0.2}
    found = law({"state": np.array([1.0, 2, 3]), "t_0": 0.0, "time": 1.0, **released})
    agree(found["y"], [2.0, 5.0, -10.0])
    agree(found["x[2]"], [0.0, 1.0, 0.0])
    agree(found["next[3]"][1:], [3.0, 1.0])  # where none is released, that with the largest release
    agree(found["r_m[3]"], [-1.0, 0.5, -0.3])
    agree(law({"state": 2.0, "t_0": 0.7, "time": 1.0, **released})["next[3]"], 1.0)  # the first one needs 0.5 s
    events = run("""
model: one
components:
  button: {is: SquareWave, high: 1, T: 2 s}
  part:   {is: StateMachine, n: 3, y_s: [0, 1, 2], from: [1, 2, 3], to: [2, 3, 1], T: [0.3 s, 0.2 s, 1 us],
           u: [=button.y, 1, =1 - button.y]}
nodes: {button: [button.y], command: [part.y]}
simulate: {until: 3.9 s, every: 10 ms}
""").events
    agree([time for time, name in events if name == "part.transition"], [0.3, 0.5, 1.0, 2.0, 2.2, 3.0], 1e-9)


@checks("Sequencer")
def test_sequencer_by_a_timing_diagram() -> None:
    """A step ends when its time is over and the release is up; it is up in the first half of each second."""
    values = [2.0, 5.0, -10.0]
    law = part("Sequencer", n=3, T="[0.2 s, 1.2 s, 0.3 s]", y_s="[2 V, 5 V, -10 V]", u=0)
    agree(law({"step": np.array([1.0, 2, 3]), "t_0": 0.0})["y"], values)
    agree(law({"step": np.array([1.0, 2, 3]), "t_0": 0.0})["t_m"], [0.2, 1.2, 0.3])
    events = run("""
model: one
components:
  release: {is: SquareWave, high: 1, T: 1 s}
  part:    {is: Sequencer, n: 3, T: [0.2 s, 1.2 s, 0.3 s], y_s: [2 V, 5 V, -10 V]}
nodes: {release: [release.y, part.u], command: [part.y]}
simulate: {until: 3.9 s, every: 10 ms}
""").events
    agree([time for time, name in events if name == "part.next"], [0.2, 1.4, 2.0, 2.2, 3.4], 1e-9)


@pytest.mark.parametrize(("table", "words"), [
    ("StepLookup, outside: 1, x: [0 V, 0 V, 1 V], v: [0, 1, 2]", "outside"),
    ("Lookup, outside: 2, x: [0 V, 1 V], v: [0, 1]", "outside"), ("StepLookup, x: [1 V, 0 V], v: [0, 1]", "x[1] < x[n]"),
    ("Lookup, x: [0 V, 1 V, 1 V], v: [0, 1, 2]", "a table with steps is a StepLookup")])
def test_a_table_without_slope_period_or_order_is_refused(table: str, words: str) -> None:
    with pytest.raises(ModelError) as caught:
        hb.simulate(hb.loads(f"model: t\ncomponents:\n  a: {{is: {table}, u: 0 V}}\nsimulate: {{until: 1 s}}\n"))
    assert words in str(caught.value)


def test_a_step_of_a_table_is_an_event_with_its_sensitivity() -> None:
    """A mass under 10 N up to 0.5 m, -30 N from there on, and between; it turns back and passes the steps again."""
    text = """model: t
components:
  table:
    is: StepLookup
    x: [0 m, 0.5 m, 0.5 m, 0.9 m, 0.9 m, 0.9 m, 1 m]
    v: [10 N, 10 N, -30 N, -30 N, 5 N, 1 N, 1 N]
    u: =load.x
  push:  {is: ForceSource, u: =table.y}
  load:  {is: Mass, m: 1 kg}
nodes: {load: [load.a, push.a]}
initial: {load.x: 0 m, load.v: 0 m/s}
simulate: {until: 1.2 s, every: 10 ms}
"""
    run = hb.simulate(hb.loads(text), sensitivities=["load.m"])
    first, speed = np.sqrt(2*0.5/10), np.sqrt(2*0.5*10)
    events = [(time, name.rpartition(".")[2]) for time, name in run.events]
    assert [name for _, name in events] == ["begin", "rise", "fall", "rise"]
    agree([time for time, _ in events[1:]], [first, first + 2*speed/30, 3*first + 2*speed/30], 1e-7)
    t, left = run.time, first + 2*speed/30
    inside = 0.5 + speed*(t - first) - 15*(t - first)**2
    expected = np.where(t < first, 5*t**2, np.where(t < left, inside, 5*(t - first - left)**2))
    before = t < 3*first + 2*speed/30
    assert run["load.x"][before] == pytest.approx(expected[before], abs=1e-7)
    lighter, heavier = (hb.simulate(hb.loads(text), parameters={"load.m": 1 + d}, rtol=1e-10)["load.x"]
                        for d in (-1e-4, 1e-4))
    # the error of the differences
    assert run.sensitivity("load.x", "load.m") == pytest.approx((heavier - lighter)/2e-4, abs=1e-3)
    up = hb.simulate(hb.loads(text.replace("load.v: 0 m/s", "load.v: 6 m/s").replace("1.2 s", "0.3 s")))
    assert up["table.k"][-1] == 3 and up["table.y"][-1] == 1  # two steps at one input
    past = hb.simulate(hb.loads(text.replace("load.x: 0 m", "load.x: 0.9 m").replace("1.2 s", "10 ms")))
    assert past["table.k"][0] == 3


def test_a_periodic_table_repeats_in_a_run_and_in_its_slope() -> None:
    """y' = f(a t) with the triangle f of period 3 and mean 3 over the angle a t: y = G(a t)/a with the integral G of f, and
    dy/da = t f(a t)/a - G(a t)/a^2."""
    text = """model: t
parameters: {a: 7}
components:
  angle: {is: Integrator, k: 1 1/s, u: =a}
  table: {is: Lookup, outside: 2, x: [-1, 0, 2], v: [1, 5, 1], u: =angle.y}
  sum:   {is: Integrator, k: 1 1/s, u: =table.y}
initial: {angle.y: 0, sum.y: 0}
simulate: {until: 5 s, every: 10 ms}
"""
    run = hb.simulate(hb.loads(text), sensitivities=["a"])
    assert not run.verdict.findings
    u = 7 * run.time
    f = np.interp((u + 1) % 3 - 1, [-1, 0, 2], [1, 5, 1])
    rest = u % 3  # falls from 5 to 1 over 2, rises to 5 over 1
    g = 9 * (u // 3) + np.where(rest < 2, 5*rest - rest**2, 6 + (rest - 2) + 2*(rest - 2)**2)
    # twelve kinks, each of which the integrator crosses within its tolerance of 1e-6 or so
    assert run["table.y"] == pytest.approx(f, abs=1e-5)
    assert run["sum.y"] == pytest.approx(g/7, abs=1e-4)
    assert run.sensitivity("sum.y", "a")[-1] == pytest.approx(5*f[-1]/7 - g[-1]/49, rel=1e-3)


@checks("ScheduledPID")
def test_the_gains_of_a_scheduled_controller_are_linear_between_the_points_of_its_table() -> None:
    """w = K_p(s) e + q + K_d(s) (e - z)/T_f; q' = K_i(s) e + (y - w)/T_t (Astrom, Wittenmark, chapter 9)."""
    law = part("ScheduledPID", n=3, x="[1, 3, 4]", K_p="[2, 6, 1]", K_i="[4 1/s, 4 1/s, 8 1/s]",
               K_d="[0.1 s, 0.3 s, 0.3 s]", T_f="10 ms", T_t="0.2 s", y_min="-5", y_max="5")
    s, e, z, q = np.array([0.0, 2.0, 3.5, 9.0]), np.array([1.0, -0.5, 2.0, 0.1]), np.array([1.0, -0.6, 2.0, 0.0]), 0.5
    found = law({"s": s, "r": e + 7, "u": 7.0, "z": z, "q": q})
    gains = [np.interp(s, [1, 3, 4], values) for values in ([2, 6, 1], [4, 4, 8], [0.1, 0.3, 0.3])]
    w = gains[0]*e + q + gains[2]*(e - z)/0.01
    agree(found["y"], np.clip(w, -5, 5))
    agree(found["der(q)"], gains[1]*e + (np.clip(w, -5, 5) - w)/np.maximum(0.2, gains[0]/gains[1]/20))


@checks("MotionSequence")
def test_a_sequence_of_motions_keeps_its_limits_and_takes_the_shortest_time() -> None:
    """A motion over D > v**2/a + v a/j takes D/v + v/a + a/j; its ends have the jerk j (Lambrechts and others, 2005)."""
    law = part("MotionSequence", n=3, p="[0, 3, 1]", T_d="[0.5 s, 1 s]", v="1 1/s", a="2 1/s**2", j="10 1/s**3")
    T = np.array([3.7, 2.7])
    begin = np.array([0.5, 0.5 + T[0] + 1.0])
    t, D = np.array([0.0, 0.05, 0.2]), np.array([3.0, -2.0])
    for k, start in enumerate((0.0, 3.0)):
        rising, falling = law({"time": begin[k] + t}), law({"time": begin[k] + T[k] - t})
        side = np.sign(D[k])
        agree(rising["y"], start + side*10*t**3/6, size=1)
        agree(falling["y"], start + D[k] - side*10*t**3/6, size=1)
        agree(rising["w"], side*10*t**2/2, size=1)
        agree(rising["b"], side*10*t, size=1)
        middle = law({"time": begin[k] + T[k]/2})
        agree([middle["y"], middle["w"], middle["b"]], [start + D[k]/2, side, 0], size=1)
    agree(law({"time": begin[1] - 0.5})["y"], 3.0)


@checks("PolynomialSequence")
def test_a_sequence_of_polynomials_is_a_row_of_single_motions() -> None:
    """Also the highest speed 15/8 D/T and acceleration 10/sqrt(3) D/T**2 of VDI 2143."""
    law = part("PolynomialSequence", n=3, p="[1, 4, 2]", T="[2 s, 0.5 s]", T_d="[0.5 s, 1 s]")
    single = part("PolynomialMotion", start="0", end="1", T="1 s")
    for begin, T, start, way in ((0.5, 2.0, 1.0, 3.0), (3.5, 0.5, 4.0, -2.0)):
        for share in (0.0, 0.2, 0.5, 0.9, 1.0):
            motion, expected = law({"time": begin + share*T}), single({"time": share})
            agree([motion["y"], motion["w"]], [start + way*expected["y"], way/T*expected["w"]], size=1)
        agree(law({"time": begin + T/2})["w"], 15/8*way/T)
        agree(law({"time": begin + T*(0.5 - np.sqrt(3)/6)})["b"], 10/np.sqrt(3)*way/T**2)


def test_a_sequence_of_motions_with_a_large_jerk_is_trapezoidal() -> None:
    """v/a + a/j of each motion is then v/a."""
    law, single = part("MotionSequence", n=2, p="[0, 3]", v="1 1/s", a="2 1/s**2", j="1e9 1/s**3"), part(
        "TrapezoidalMotion", start="0", end="3", v="1 1/s", a="2 1/s**2")
    for time in (0.1, 0.4, 1.7, 3.2, 3.49):
        agree([law({"time": time})[name] for name in "yw"], [single({"time": time})[name] for name in "yw"], rtol=1e-6)


@checks("PredictiveController")
def test_the_command_of_a_predictive_controller_is_the_nearest_one_within_its_limits() -> None:
    """With a horizon of one command: that of the regulator -2 x, of the estimate x from the sample before, within both
    limits (Rawlings and others, section 2.5)."""
    found = run("""\
model: one
components:
  part: {is: PredictiveController, n: 1, N: 1, C: [[0]], L: [[1]], F: [[-2], [-2], [0]], W: [[1], [1], [0]], y_min: [-1.5],
         y_max: [1], rate: [5 1/s], T_s: 100 ms, u: ["=if_else(time < 0.65 s, 1, -0.1)"]}
simulate: {until: 1.2 s, every: 50 ms}
""")
    command, x, expected = 0.0, 0.0, []
    for k in range(12):
        command = float(np.clip(np.clip(-2*x, command - 0.5, command + 0.5), -1.5, 1))
        x = 1.0 if k <= 6 else -0.1
        expected.append(command)
    # the interior-point method ends at 1e-8 of the limits
    agree(np.interp(0.05 + 0.1*np.arange(12), found.time, found["part.y[1]"]), expected, size=1, rtol=1e-6)
