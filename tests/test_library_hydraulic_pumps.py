"""Hydraulic pumps, motors, sources and sensors beside formulas of their sources."""

from __future__ import annotations

import numpy as np
import pytest
from library_check import agree, checks, part
from numpy.typing import NDArray

Array = NDArray[np.float64]
bar, RPM = 1e5, 2*np.pi/60
DROPS = np.array([-300, -20, -1, -0.05, 0, 0.05, 0.5, 5, 120])*bar
FLOWS = np.array([-5, -0.3, 0, 0.01, 2])*1e-3


# -- pumps and motors --------------------------------------------------------------------------------------------------
D, W_R, DP_R = 100e-6/(2*np.pi), 1500*RPM, 200*bar
LOSSES = {"D": "100 cm**3/rev", "eta_v": 0.95, "eta_hm": 0.92, "k_v": 0.3, "nu": "60 mm**2/s", "nu_r": "46 mm**2/s"}
SPEEDS, RISES = np.array([150.0, 60, -100, 0, 157]), np.array([200, -150, 100, 50, 0])*bar


def lost(eta_hm: float) -> Array:
    """Torque lost: a share that grows with speed and viscosity, another with pressure (Wilson), 1 - share at rest none."""
    return eta_hm*D*DP_R*(0.3*60/46*SPEEDS/W_R + 0.7*np.abs(RISES)/DP_R*np.tanh(SPEEDS))


@checks("HydraulicPump", "VariablePump")
@pytest.mark.parametrize("x", [1.0, 0.4, -1.0])
def test_pumps(x: float) -> None:
    laws = [part("VariablePump", **LOSSES, u=2*x if abs(x) == 1 else x)]  # clamped
    laws += [part("HydraulicPump", **LOSSES)] if x == 1 else []
    for law in laws:
        found = law({"a.p": 5*bar, "b.p": 5*bar + RISES, "s.w": SPEEDS})
        flow = D*x*SPEEDS - D*W_R/DP_R*0.05*46/60*RISES
        agree(found["b.q"], -flow)
        agree(found["a.q"], flow)
        agree(found["s.tau"], D*x*RISES + lost(1/0.92 - 1), 1e-8)
    # at the rated point the efficiencies are those of the data sheet
    rated = part("HydraulicPump", D="100 cm**3/rev", eta_v=0.95, eta_hm=0.92)({"a.p": 0, "b.p": DP_R, "s.w": W_R})
    agree(rated["a.q"]/(D*W_R), 0.95)
    agree(D*DP_R/rated["s.tau"], 0.92)


@checks("HydraulicMotor", "VariableMotor")
@pytest.mark.parametrize("x", [1.0, 0.4, -1.0])
def test_motors(x: float) -> None:
    for name in ("HydraulicMotor", "VariableMotor") if x == 1 else ("VariableMotor",):
        law = part(name, **LOSSES, **({"u": x} if name == "VariableMotor" else {}))
        found = law({"a.p": 5*bar + RISES, "b.p": 5*bar, "s.w": SPEEDS})
        flow = D*x*SPEEDS + D*W_R/DP_R*(1/0.95 - 1)*46/60*RISES
        agree(found["a.q"], flow)
        agree(found["b.q"], -flow)
        agree(found["s.tau"], -D*x*RISES + lost(1 - 0.92), 1e-8)
    rated = part("HydraulicMotor", D="100 cm**3/rev", eta_v=0.95, eta_hm=0.92)({"a.p": DP_R, "b.p": 0, "s.w": W_R})
    agree(D*W_R/rated["a.q"], 0.95)
    agree(-rated["s.tau"]/(D*DP_R), 0.92)


@checks("CompensatedPump")
def test_compensated_pump_has_the_friction_that_its_page_tells_of() -> None:
    law = part("CompensatedPump", p_0="150 bar", p_b="20 bar", T_x="50 ms", **LOSSES)
    found = law({"a.p": 2*bar, "b.p": 2*bar + RISES, "s.w": SPEEDS, "x": 0.6})
    flow = D*0.6*SPEEDS - D*W_R/DP_R*0.05*46/60*RISES
    agree(found["a.q"], flow)
    agree(found["b.q"], -flow)
    agree(found["s.tau"], D*0.6*RISES + lost(1/0.92 - 1), 1e-8)
    # full below the band, none at the setting, with a lag of first order
    rises = np.array([0, 130, 140, 150, 250])*bar
    found = law({"a.p": 0, "b.p": rises, "s.w": 100, "x": 0.6})
    agree(found["der(x)"], (np.array([1, 1, 0.5, 0, 0]) - 0.6)/50e-3)
    rated = part("CompensatedPump", p_0="300 bar", D="100 cm**3/rev", eta_v=0.95, eta_hm=0.92)(
        {"a.p": 0, "b.p": DP_R, "s.w": W_R, "x": 1})
    agree(D*DP_R/rated["s.tau"], 0.92)
    agree(rated["a.q"]/(D*W_R), 0.95)


# -- sources and sensors -----------------------------------------------------------------------------------------------
@checks("PressureSource", "ControlledPressureSource", "DroopingSource", "FlowSource", "PressureSensor", "PressureDropSensor",
        "FlowSensor")
def test_sources_and_sensors_are_what_they_define() -> None:
    agree(part("PressureSource", p_0="210 bar")({"a.q": FLOWS})["a.p"], 210*bar)
    agree(part("ControlledPressureSource")({"a.q": FLOWS, "u": 3e6})["a.p"], 3e6)
    agree(part("DroopingSource", p_0="200 bar", R="2e9 Pa*s/m**3")({"a.q": -FLOWS})["a.p"], 200*bar - 2e9*FLOWS)
    agree(part("FlowSource")({"a.p": 50*bar, "u": FLOWS})["a.q"], -FLOWS)
    gauge = part("PressureSensor")({"a.p": DROPS})
    agree(gauge["y"], DROPS)
    agree(gauge["a.q"], 0, size=1e-30)
    drop = part("PressureDropSensor")({"a.p": DROPS, "b.p": 3*bar})
    agree(drop["y"], DROPS - 3*bar)
    agree([drop["a.q"], drop["b.q"]], 0, size=1e-30)
    meter = part("FlowSensor")({"a.q": FLOWS, "a.p": 7*bar})
    agree(meter["y"], FLOWS)
    agree(meter["b.q"], -FLOWS)
    agree(meter["b.p"], 7*bar)
