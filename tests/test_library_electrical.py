"""Electrical components beside formulas of their sources."""

from __future__ import annotations

import numpy as np
import pytest
from library_check import agree, checks, cubic_spline, part

import heavebond as hb

V = np.array([-230.0, -1, 0, 0.5, 48])
I = np.array([-20.0, 0, 0.1, 3, 100])  # noqa: E741 - the letter of a current


@checks("Resistor", "Capacitor", "Inductor")
def test_two_poles() -> None:
    found = part("Resistor", R="4 ohm")({"a.v": 10 + V, "b.v": 10})
    agree(found["a.i"], V/4)
    agree(found["b.i"], -V/4)
    agree(part("Resistor", R=0)({"i": I, "b.v": 10})["a.v"], 10)  # a wire
    found = part("Capacitor", C="2 mF")({"u": 10, "a.i": I, "b.v": 3})
    agree(found["der(u)"], I/2e-3)
    agree(found["a.v"], 13)
    agree(found["b.i"], -I)
    found = part("Inductor", L="5 mH")({"i": 2, "a.v": 10 + V, "b.v": 10})
    agree(found["der(i)"], V/5e-3)
    agree(found["a.i"], 2)
    agree(found["b.i"], -2)


def test_a_saturated_coil_takes_up_no_more_flux() -> None:
    """The slope of the flux linkage L i/sqrt(1 + (i/i_s)**2), by differences, and the energy of a coil under a voltage step
    beside the integral of current over flux."""
    coil, knee = 5e-3, 3.0

    def flux(current: np.ndarray) -> np.ndarray:
        return coil*current/np.sqrt(1 + (current/knee)**2)

    slope = (flux(I + 1e-4) - flux(I - 1e-4))/2e-4
    found = part("Inductor", L=coil, c_s=1/knee**2)({"i": I, "a.v": 12, "b.v": 2})
    agree(found["der(i)"], 10/slope, 1e-6)
    through = np.linspace(0, 10, 20_001)
    wanted = float(np.trapezoid(through, flux(through)))
    coil_alone = hb.loads(f"""
model: coil
components:
  supply: {{is: VoltageSource, u: 12 V}}
  coil: {{is: Inductor, L: {coil} H, c_s: {1/knee**2} 1/A**2}}
  ground: {{is: ElectricalGround}}
nodes: {{plus: [supply.a, coil.a], zero: [supply.b, coil.b, ground.a]}}
initial: {{coil.i: 0 A}}
simulate: {{until: {float(flux(np.array(10.0)))/12} s, every: 1e-5 s}}
""")
    audit = hb.energy(coil_alone)
    assert audit.result["coil.i"][-1] == pytest.approx(10, rel=1e-6)
    assert audit.closes() and audit.stored == pytest.approx(wanted, rel=1e-6)


@checks("ResistorWithHeatPort")
def test_a_resistor_with_a_heat_port_heats_by_its_loss_and_changes_its_resistance() -> None:
    law = part("ResistorWithHeatPort", R_0="4 ohm", alpha="0.0039 1/K", T_0="20 degC")
    for temperature in (253.15, 293.15, 400.0):
        found = law({"a.v": 10 + V, "b.v": 10, "h.T": temperature})
        resistance = 4*(1 + 0.0039*(temperature - 293.15))
        agree(found["a.i"], V/resistance)
        agree(found["b.i"], -V/resistance)
        agree(found["h.Q"], -V**2/resistance)


@checks("Conductance", "BrushContact")
def test_leakage_and_brushes() -> None:
    found = part("Conductance", G="2 mA/V")({"a.v": 10 + V, "b.v": 10})
    agree(found["a.i"], 2e-3*V)
    agree(found["b.i"], -2e-3*V)
    found = part("BrushContact", U_b="2 V", i_t="50 mA")({"i": I, "b.v": 10})
    agree(found["a.v"], 10 + 2*np.tanh(I/50e-3))
    agree(found["a.i"], I)
    agree(found["b.i"], -I)


@checks("VoltageSource", "CurrentSource", "Battery", "ElectricalGround", "VoltageSensor", "CurrentSensor",
        "ElectricalPowerSensor")
def test_sources_and_sensors_are_what_they_define() -> None:
    found = part("VoltageSource")({"u": V, "b.v": 10, "a.i": 2})
    agree(found["a.v"], 10 + V)
    agree(found["b.i"], -2)
    found = part("CurrentSource")({"u": I, "b.v": 10, "a.v": 12})
    agree(found["a.i"], -I)
    agree(found["b.i"], I)
    delivered = I
    found = part("Battery", U_0="12 V", R_i="0.1 ohm")({"a.i": -delivered, "b.v": 1})
    agree(found["a.v"], 1 + 12 - 0.1*delivered)
    agree(found["b.i"], delivered)
    agree(part("ElectricalGround")({"a.i": I})["a.v"], 0, size=1e-30)
    found = part("VoltageSensor")({"a.v": V, "b.v": 2})
    agree(found["y"], V - 2)
    agree([found["a.i"], found["b.i"]], 0, size=1e-30)
    found = part("CurrentSensor")({"a.i": I, "a.v": 7})
    agree(found["y"], I)
    agree(found["b.v"], 7)
    agree(found["b.i"], -I)
    found = part("ElectricalPowerSensor")({"a.i": I, "a.v": 24, "n.v": -24})
    agree(found["y"], 48*I)  # against the return, not against ground
    agree(found["b.i"], -I)
    agree(found["b.v"], 24)
    agree(found["n.i"], 0, size=1e-30)


@checks("Transformer", "Gyrator")
def test_couplings_keep_the_power() -> None:
    found = part("Transformer", n=5.0)({"a_1.v": 230 + V, "b_1.v": 230, "b_2.v": -4, "a_2.i": I})
    agree(found["a_2.v"] + 4, V/5)
    agree(found["a_1.i"], -I/5)
    agree([found["b_1.i"], found["b_2.i"]], [I/5, -I])
    agree(found["a_1.i"]*V + found["a_2.i"]*(found["a_2.v"] + 4), 0, size=1e-6)
    # Tellegen: v_1 = -r i_2, v_2 = r i_1 with currents into the two-port
    found = part("Gyrator", r="8 ohm")({"a_1.v": 230 + V, "b_1.v": 230, "b_2.v": -4, "a_1.i": I})
    agree(found["a_2.i"], -V/8)
    agree(found["a_2.v"] + 4, 8*I)
    agree([found["b_1.i"], found["b_2.i"]], [-I, V/8])


@checks("DCMotor", "MotorConstant")
def test_motors() -> None:
    i, w = np.array([-3.0, 0, 2, 10]), np.array([100.0, 0, -50, 300])
    law = part("DCMotor", R="2 ohm", L="3 mH", k="0.05 N*m/A", J="2e-4 kg*m**2", d="1e-5 N*m*s/rad", M_c="0.01 N*m")
    found = law({"i": i, "a.v": 30, "b.v": 6, "s.w": w, "der(s.w)": 40})
    agree(found["der(i)"], (24 - 2*i - 0.05*w)/3e-3)  # Franklin (2.52 a, b)
    agree(found["s.tau"], 2e-4*40 + 1e-5*w + 0.01*np.tanh(w/0.1) - 0.05*i)
    agree(found["a.i"], i)
    agree(found["b.i"], -i)
    # no load: the friction is k times the current; stalled: the current is u/R
    agree(law({"i": 0.2, "der(i)": 0, "b.v": 0, "s.w": 200, "der(s.w)": 0, "d": 0})["s.tau"], 0, size=1.0)
    agree(law({"der(i)": 0, "a.v": 24, "b.v": 0, "s.w": 0, "der(s.w)": 0})["i"], 12)
    found = part("MotorConstant", k="0.05 N*m/A")({"a.i": i, "b.v": 5, "s.w": w, "h.w": 20})
    agree(found["a.v"], 5 + 0.05*(w - 20))
    agree(found["s.tau"], -0.05*i)
    agree(found["h.tau"], 0.05*i)
    agree(found["b.i"], -i)


@checks("VoiceCoil")
def test_a_voice_coil_turns_electrical_power_into_mechanical() -> None:
    i, v = np.array([-3.0, 0, 2, 10]), np.array([1.0, 0, -0.5, 3])
    law = part("VoiceCoil", R="2 ohm", L="3 mH", k="15 N/A")
    found = law({"i": i, "a.v": 30, "b.v": 6, "s.x": 0.3, "h.x": 0.1, "s.v": v, "h.v": 0.4})
    agree(found["der(i)"], (24 - 2*i - 15*(v - 0.4))/3e-3)
    agree([found["s.f"], found["h.f"]], [-15*i, 15*i])
    agree([found["a.i"], found["b.i"]], [i, -i])
    electrical = 24*i - 2*i**2 - 3e-3*i*found["der(i)"]      # without the loss of the winding and what is stored
    agree(electrical, -found["s.f"]*v - found["h.f"]*0.4, size=100.0)


@checks("CurrentCurveOfVoltage")
def test_current_curve() -> None:
    coefficients = np.array([3, -1, 4, 1, -5, 9, 2, -6, 5])*0.1
    law = part("CurrentCurveOfVoltage", v_0="1 V", v_r="8 V", **{f"i_{k + 1}": c for k, c in enumerate(coefficients)})
    positions = np.linspace(-3.75, 3.75, 31)
    expected = cubic_spline(positions, coefficients)
    found = law({"a.v": 4 + positions*2, "b.v": 3})
    agree(found["a.i"], expected, size=0.1)
    agree(found["b.i"], -found["a.i"])
    ends = law({"a.v": 4 + np.array([-9, -4, 4, 9])*2, "b.v": 3})["i"]
    agree(ends[[0, 3]], ends[[1, 2]])  # beyond the range it keeps its value
