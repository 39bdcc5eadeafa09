"""Signal blocks beside the formulas of their sources."""

from __future__ import annotations

import numpy as np
import pytest
from library_check import agree, checks, part, run

import heavebond as hb
from heavebond.basis.errors import ModelError

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
    at = lambda time: float(np.interp(time, result.time, result["adc.y"]))  # noqa: E731
    agree([at(0.05), at(0.104), at(0.15)], [3.0, 3.0, -7.002])


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
