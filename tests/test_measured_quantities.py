"""The page on measured quantities names every source and sensor of the library, and its signs are those of runs."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from doc_pages import blocks
from oil_reference import OIL

import heavebond as hb
from heavebond.language.library import library

PAGE = Path(__file__).parent.parent / "docs" / "measured_quantities.md"
ROW = re.compile(r"^\| `(\w+)` \| `(\w+)` \| .+ \| `(.+)` \|$", re.MULTILINE)
ROWS = ROW.findall(PAGE.read_text("utf-8"))
DIAGRAMS = {block.mark[1].removesuffix(".yaml"): block.text for block in blocks(PAGE) if block.mark[0] == "file"}


def gauges() -> dict[str, set[str]]:
    """Every source and sensor, with the names of the values that it sets or shows."""
    found = {}
    for name in library().names():
        component = library().component(name)
        outputs = {s.name for s in component.signals.values() if s.direction == "out"}
        if component.ports and (component.power == "source" or outputs):
            found[name] = outputs
    return found


def test_every_source_and_sensor_is_on_the_page_with_each_of_its_readings() -> None:
    rows = {(component, value) for component, value, _ in ROWS}
    assert {component for component, _ in rows} == set(gauges())
    assert {(name, output) for name, outputs in gauges().items() for output in outputs} <= rows


@pytest.mark.parametrize(("component", "value", "line"), ROWS)
def test_a_row_quotes_the_line_of_the_component_that_fixes_the_sign(component: str, value: str, line: str) -> None:
    of = library().component(component)
    relations = {f.text for frame in of.frames for f in (frame.turn, frame.shift) if f is not None}
    assert line in {" ".join(e.text.split()) for e in of.equations} | relations
    assert re.search(rf"\b{value}\b", line)


def test_every_source_and_sensor_stands_in_a_diagram_of_the_page() -> None:
    used = {kind for text in DIAGRAMS.values() for kind in re.findall(r"is: (\w+)", text)}
    assert not set(gauges()) - used


# behind the throttle at the same enthalpy
T_BEHIND = 313.15 + OIL.h(99.955e5, 333.15)/OIL.c_p
# Readings at the end of the runs, from Newton's, Ohm's and Fourier's laws and balances of mass by hand; every value set
# is positive, so that a sign of the page that is wrong shows here. The tolerance is that of the integrator.
READINGS = {
    "measured_translation": {
        "shaft.y": 100*9.81*0.5, "cell.y": 100*9.81, "height.y": 0.5, "tacho.y": 0.5, "laser.y": 0.5, "radar.y": 0.5,
        "g_cart.y": 10/5, "g_sled.y": 10/5, "g_held.y": -10/5, "gap.y": 2*10/5*1, "table.y": 2.0},
    "measured_rotation": {
        "power.y": 0.2*100**2, "torque.y": 0.2*100, "tacho.y": 100, "encoder.y": 100,
        "counter.y": 2*np.pi/1000*np.floor(1000*100/(2*np.pi)), "resolver.y": 100, "slip.y": 100,
        "g_rotor.y": 10/5, "g_disc.y": 10/5, "apart.y": 2*10/5*1, "n_servo.y": 2, "n_bench.y": 2},
    "measured_plane": {"gauge.x": 1.001, "gauge.y": 1.5, "string.y": np.hypot(1.001, 1.5), "gyro.v_x": 2.0, "gyro.v_y": 3.0,
                       "foot.x": 2.0, "cell.F_y": 98.1, "cell.M": 98.1*0.5},
    "measured_space": {"gauge.x": 1.001, "string.y": 1.001, "imu.v[1]": 2.0, "imu.b[1]": 2.0, "imu.b[3]": 9.81,
                       "cell.F[3]": 98.1, "cell.M[2]": -98.1*0.5, "compass.yaw": np.pi/2},
    "measured_hydraulics": {
        "meter.y": 20/6e4, "gauge.y": 100e5, "drop.y": 100e5, "m_supply.y": 20/6e4, "m_droop.y": 20/6e4,
        "m_servo.y": 20/6e4, "m_tank.y": 80/6e4, "pump.a.q": -20/6e4, "supply.a.q": -20/6e4, "tank.a.q": 80/6e4},
    "measured_pneumatics": {
        # 10 g in 10 L: p = m R T/V at the temperature that the thermometer shows, beside what was there before
        "meter.y": 2e-3, "compressor.a.m": -2e-3, "m_supply.y": 1.185*1e-8*6e5, "m_servo.y": 1.185*1e-8*6e5,
        "m_room.y": 2*1.185*1e-8*6e5, "room.a.m": 2*1.185*1e-8*6e5},
    "measured_thermohydraulics": {
        "meter.y": 20/6e4, "pump.a.m": -20/6e4/OIL.v(99.955e5, 333.15), "gauge.y": 99.955e5, "thermometer.y": 333.15,
        "m_tank.y": 20/6e4*OIL.v(0, T_BEHIND)/OIL.v(99.955e5, 333.15), "tank.a.m": 20/6e4/OIL.v(99.955e5, 333.15)},
    "measured_electricity": {
        "ammeter.y": 12/6, "voltmeter.y": 12, "wattmeter.y": 24, "v_current.y": 2*6, "v_battery.y": 12*5.5/6,
        "mains.a.i": -2, "current.a.i": -2, "battery.a.i": -2},
    "measured_heat": {"thermometer.y": 293.15 + 100*0.5, "meter.y": 100, "m_bath.y": 40/0.4, "heater.a.Q": -100,
                      "room.a.Q": 200},
    "measured_bonds": {"meter.y": 20/6e4, "gauge.y": 100e5, "g_cart.y": 10/5, "tacho.y": 0.5},
}


@pytest.mark.parametrize("name", DIAGRAMS)
def test_the_gauges_of_a_diagram_show_what_the_laws_say(name: str) -> None:
    run = hb.simulate(hb.loads(DIAGRAMS[name]))
    found = {signal: float(run.si[signal][-1]) for signal in READINGS[name]}
    # rated flows are exact above the transition to laminar flow up to (dp_t/dp)**2/4 = 2.5e-7
    assert found == pytest.approx(READINGS[name], rel=1e-5)


def test_gas_gauges_and_heave_have_the_sign_of_the_machine() -> None:
    run = hb.simulate(hb.loads(DIAGRAMS["measured_pneumatics"]))
    final = {name: float(run.si[name][-1]) for name in ("gauge.y", "absolute.y", "thermometer.y")}
    mass = 101325*0.01/(287.05*293.15) + 2e-3*5
    assert final["absolute.y"] == pytest.approx(mass*287.05*final["thermometer.y"]/0.01, rel=1e-5)
    assert final["gauge.y"] == pytest.approx(final["absolute.y"] - 101325, rel=1e-9)
    assert 293.15 < final["thermometer.y"] < 1.4*313.15          # compression warms, at most to the adiabatic filling
    sea = hb.simulate(hb.loads(DIAGRAMS["measured_translation"]))
    # behind the lag of 10 ms of the unit, a quarter of the way up: heave and its rate are positive
    assert float(sea.si["mru.z"][-1]) == pytest.approx(0.7071, abs=0.01)
    assert float(sea.si["mru.v"][-1]) == pytest.approx(0.5554, abs=0.01)


def test_a_force_below_the_centre_of_mass_turns_a_plate_anticlockwise() -> None:
    run = hb.simulate(hb.loads(DIAGRAMS["measured_plane"]))
    # J phi'' = h (F_x cos(phi) + F_y sin(phi)) from rest; phi'' = 0.2 + 0.3 phi leaves out phi**2/2 = 5e-3 of the first term
    assert float(run.si["gauge.phi"][-1]) == pytest.approx(0.2/0.3*(np.cosh(np.sqrt(0.3)) - 1), rel=2e-3)
