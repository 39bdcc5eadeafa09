"""Events in FMUs: stops, stick-slip, relays, samples and instants, within steps, in event mode and in model exchange."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from collected import partly
from test_co_simulation_fmu import fmpy, get, opened, put
from test_export import compiled

import heavebond as hb
from heavebond.exchange.fmu_export import export_fmu
from heavebond.language.library import bundled

pytestmark = compiled

BALL = """
model: ball
components:
  floor: {is: Fixed}
  stop:  {is: RigidStop, e: 0.5}
  ball:  {is: Mass, m: 2 kg}
  weight: {is: ForceSource, u: -20 N}
nodes:
  floor: [floor.a, stop.a]
  ball:  [stop.b, ball.a, weight.a]
initial: {ball.x: 0.8 m, ball.v: 0 m/s}
show: {height: {is: ball.x, unit: m}, speed: {is: ball.v, unit: m/s}, rest: {is: stop.rest, unit: 1}}
simulate: {until: 2 s, every: 20 ms}
"""
# falls 0.4 s, rebounds at 2 m/s for 0.4 s, at 1 m/s for 0.2 s ...
IMPACTS = [0.4, 0.8, 1.0, 1.1]
SWITCHED = """
model: switched
components:
  relay: {is: Relay, u_on: 1, u_off: -1, y_on: 5, u: 0}
  lag:   {is: FirstOrderLag, T_1: 0.2 s}
  taken: {is: SampleHold, T_s: 0.1 s}
  alarm: {is: Comparator, level: 4}
nodes:
  command: [relay.y, lag.u]
  level:   [lag.y, taken.u, alarm.u]
show: {level: {is: lag.y, unit: 1}, taken: {is: taken.y, unit: 1}, alarm: {is: alarm.y, unit: 1}}
simulate: {until: 2 s, every: 10 ms}
"""


def circuit(name: str) -> Path:
    return bundled("models") / name


@pytest.mark.parametrize(("name", "version"), [
    ("circuits/tank_level", 3),
    *(pytest.param(name, version, marks=pytest.mark.long) for name, version in (
        ("circuits/vibrating_conveyor", 3), ("power_unit/power_unit", 2), ("circuits/train_buffers", 3))),
    *(pytest.param(name, version, marks=pytest.mark.slow) for name, version in (
        ("circuits/positioning_servo", 2), ("circuits/pneumatic_hammer", 3)))])
def test_machines_with_events_run_in_another_program_as_here(name: str, version: int, tmp_path: Path) -> None:
    from fmpy.validation import validate_fmu

    model, path = hb.load(circuit(f"{name}.yaml")), tmp_path / "m.fmu"
    export_fmu(model, path, version=version)
    assert validate_fmu(str(path)) == []
    run = hb.simulate(model, rtol=1e-11)
    assert run.events
    modes: list[dict[str, Any]] = [{}] if version == 2 else [{}, {"use_event_mode": True, "early_return_allowed": True,
                                                                  "record_events": False}]
    for mode in modes:
        found = fmpy.simulate_fmu(str(path), fmi_type="CoSimulation", stop_time=float(run.time[-1]),
                                  output_interval=float(run.time[1]), **mode)
        # in event mode there are points at events too; the last one at a time is what stands there after all
        last = np.searchsorted(found["time"], run.time + 1e-9 * run.time[-1], side="right") - 1
        assert np.abs(found["time"][last] - run.time).max() < 1e-9 * run.time[-1]
        for output in model.show:
            exact = run.display[output]
            # two integrators with errors of 1e-9 and 1e-11 a step, over thousands of steps
            assert np.abs(found[output][last] - exact).max() < 1e-6 * np.ptp(exact), (output, mode)


@pytest.mark.parametrize("version", partly([2, 3], 2))
def test_one_step_over_several_impacts_is_exact(version: int, tmp_path: Path) -> None:
    export_fmu(hb.loads(BALL), tmp_path / "m.fmu", version=version)
    with opened(tmp_path / "m.fmu", version) as (made, numbers):
        made.doStep(0.0, 0.9)  # 0.1 s after the second impact, at 1 m/s: at the top
        assert get(made, numbers["height"]) == pytest.approx(0.05, abs=1e-9)
        assert get(made, numbers["speed"]) == pytest.approx(0.0, abs=1e-8)
        made.doStep(0.9, 0.6)  # impacts below 1 mm/s end on the floor
        assert [get(made, numbers[n]) for n in ("height", "rest")] == pytest.approx([0.0, 1.0], abs=1e-9)


def test_a_program_with_event_mode_is_told_of_each_event(tmp_path: Path) -> None:
    from ctypes import byref, c_bool, c_double

    export_fmu(hb.loads(BALL), tmp_path / "m.fmu")
    with opened(tmp_path / "m.fmu", 3, eventModeUsed=True, earlyReturnAllowed=True) as (made, numbers):
        made.updateDiscreteStates()  # what happens at the start
        made.enterStepMode()
        time, found = 0.0, []
        while time < 1.13:
            event, terminate, early, reached = c_bool(), c_bool(), c_bool(), c_double()
            made.fmi3DoStep(made.component, time, 1.13 - time, True, byref(event), byref(terminate), byref(early),
                            byref(reached))
            assert early.value == event.value  # none falls on the end of a step
            time = reached.value
            if event.value:
                before = get(made, numbers["speed"])
                made.enterEventMode()
                again, _, _, changed, known, _ = made.updateDiscreteStates()
                assert (again, changed, known) == (False, True, False)
                assert get(made, numbers["speed"]) == pytest.approx(-0.5 * before, rel=1e-12)
                made.enterStepMode()
                found.append(time)
        assert found == pytest.approx(IMPACTS, abs=1e-9)


@pytest.mark.parametrize("version", partly([3, 2], 2))
def test_model_exchange_has_the_conditions_as_indicators(version: int, tmp_path: Path) -> None:
    model = hb.loads(BALL)
    export_fmu(model, tmp_path / "m.fmu", version=version)
    told = fmpy.read_model_description(str(tmp_path / "m.fmu"))
    if version == 2:
        assert told.numberOfEventIndicators == 2
    else:
        assert [e.variable.name for e in told.eventIndicators] == ["stop.impact.indicator", "stop.lift.indicator"]
    found = fmpy.simulate_fmu(str(tmp_path / "m.fmu"), fmi_type="ModelExchange", stop_time=0.95, output_interval=0.05,
                              relative_tolerance=1e-9, record_events=False)
    assert found["height"][6] == pytest.approx(0.8 - 5 * 0.3**2, abs=1e-7)
    assert found["height"][10] == pytest.approx(2 * 0.1 - 5 * 0.1**2, abs=1e-6)


@pytest.mark.parametrize("version", [2, 3])
def test_inputs_set_off_events_and_restored_runs_are_the_same_to_the_last_bit(version: int, tmp_path: Path) -> None:
    """The level of the lag rises to 5 with 0.2 s while the relay is on: it passes 4 after 0.2 s ln 5 = 0.322 s."""
    export_fmu(hb.loads(SWITCHED), tmp_path / "m.fmu", ["relay.u"], version)
    with opened(tmp_path / "m.fmu", version) as (made, numbers):
        names = ("level", "taken", "alarm")

        def onwards() -> list[float]:
            found, time = [], 0.05
            for step, command in ((0.013, 0.5), (0.3, 2.0), (0.05, 0.0), (0.07, -0.5), (0.2, -3.0), (0.11, 0.0)):
                put(made, numbers["relay.u"], command)
                made.doStep(time, step)
                time += step
                found += [get(made, numbers[name]) for name in names]
            return found

        made.doStep(0.0, 0.05)
        state = made.getFMUState() if version == 3 else made.getFMUstate()
        first = onwards()
        on, off = 0.063, 0.483  # the relay follows its input at once: on at 2, off at -3
        assert first[3] == pytest.approx(5 * (1 - np.exp(-(0.363 - on) / 0.2)), abs=1e-8)
        assert first[4] == pytest.approx(5 * (1 - np.exp(-(0.3 - on) / 0.2)), abs=1e-8)
        assert (first[5], first[8]) == (0.0, 1.0)
        top = 5 * (1 - np.exp(-(off - on) / 0.2))
        assert first[12] == pytest.approx(top * np.exp(-0.2 / 0.2), abs=1e-8)
        (made.setFMUState if version == 3 else made.setFMUstate)(state)
        assert onwards() == first
        bytes_of = made.serializeFMUState(state) if version == 3 else made.serializeFMUstate(state)
        kept = made.deserializeFMUState(bytes_of) if version == 3 else made.deSerializeFMUstate(bytes_of)
        (made.setFMUState if version == 3 else made.setFMUstate)(kept)
        assert onwards() == first


def test_periods_follow_parameters_and_an_endless_row_of_events_is_refused(tmp_path: Path) -> None:
    export_fmu(hb.loads(SWITCHED), tmp_path / "m.fmu", ["relay.u"], 2)
    with opened(tmp_path / "m.fmu", 2) as (made, numbers):
        put(made, numbers["taken.T_s"], 0.04)
        put(made, numbers["relay.u"], 2.0)
        made.doStep(0.0, 0.1)  # samples at 0.04 and 0.08 s
        assert get(made, numbers["taken"]) == pytest.approx(5 * (1 - np.exp(-0.08 / 0.2)), abs=1e-8)
        put(made, numbers["taken.T_s"], -1.0)
        with pytest.raises(fmpy.fmi1.FMICallException):
            made.doStep(0.1, 0.1)
    endless = BALL.replace("e: 0.5", "e: 0.9, v_r: 1e-12 m/s")
    export_fmu(hb.loads(endless), tmp_path / "n.fmu", version=2)
    with opened(tmp_path / "n.fmu", 2) as (made, _), pytest.raises(fmpy.fmi1.FMICallException):
        made.doStep(0.0, 9.0)


def test_a_diagram_with_an_fmu_in_it_is_refused(tmp_path: Path) -> None:
    export_fmu(hb.loads(SWITCHED), tmp_path / "part.fmu", ["relay.u"], 2)
    (tmp_path / "outer.yaml").write_text(
        "model: outer\ncomponents:\n  part: {is: part.fmu, step: 10 ms, relay_u: 2}\n"
        "show: {y: {is: part.show_level, unit: 1}}\nsimulate: {until: 1 s, every: 10 ms}\n")
    with pytest.raises(hb.ModelError, match="export-fmu"):
        export_fmu(hb.load(tmp_path / "outer.yaml"), tmp_path / "outer.fmu")


STUCK = """
model: stuck
components:
  frame:  {is: Fixed}
  spring: {is: SpringDamper, c: 500 N/m, d: 2 N*s/m}
  body:   {is: Mass, m: 3 kg}
  grip:   {is: DryFriction, F_c: 9 N, F_s: 14 N, v_s: 0.05 m/s}
  belt:   {is: VelocitySource, u: "=0.25 m/s*sin(2*pi*time/3 s)"}
nodes: {ground: [frame.a, spring.a], body: [spring.b, body.a, grip.b], belt: [belt.a, grip.a]}
initial: {body.x: 0 m, body.v: 0 m/s}
show: {place: {is: body.x, unit: m}, speed: {is: body.v, unit: m/s}, force: {is: grip.F, unit: N}}
simulate: {until: 6 s, every: 10 ms}
"""


@pytest.mark.parametrize("version", partly([2, 3], 2))
def test_snapshots_around_events_continue_in_a_second_instance_to_the_last_bit(version: int, tmp_path: Path) -> None:
    model, path = hb.loads(STUCK), tmp_path / "m.fmu"
    export_fmu(model, path, version=version)
    instants = [t for t, name in hb.simulate(model, rtol=1e-10).events if name in ("grip.backward", "grip.stick")]

    def onwards(made: Any, numbers: dict[str, int], time: float) -> list[float]:
        found = []
        for step in (1e-6, 0.003, 0.4, 1e-4, 0.07):
            made.doStep(time, step)
            time += step
            found += [get(made, numbers[name]) for name in model.show]
        return found

    with opened(path, version) as (first, numbers), opened(path, version) as (second, _):
        beginning, time = onwards(first, numbers, 0.0), 0.473101
        for point in (t + shift for t in instants[1:3] for shift in (-1e-9, 0.0, 1e-9)):
            if point <= time:
                continue
            first.doStep(time, point - time)
            time = point
            state = first.getFMUState() if version == 3 else first.getFMUstate()
            data = first.serializeFMUState(state) if version == 3 else first.serializeFMUstate(state)
            undisturbed = onwards(first, numbers, time)
            kept = second.deserializeFMUState(data) if version == 3 else second.deSerializeFMUstate(data)
            (second.setFMUState if version == 3 else second.setFMUstate)(kept)
            assert onwards(second, numbers, time) == undisturbed
            (first.setFMUState if version == 3 else first.setFMUstate)(state)
        second.reset()
        if version == 2:
            second.setupExperiment(startTime=0.0)
        second.enterInitializationMode()
        second.exitInitializationMode()
        assert onwards(second, numbers, 0.0) == beginning


@pytest.mark.parametrize("version", partly([3, 2], 2))
def test_stick_slip_in_model_exchange(version: int, tmp_path: Path) -> None:
    model = hb.loads(STUCK)
    export_fmu(model, tmp_path / "m.fmu", version=version)
    run = hb.simulate(model, rtol=1e-10)
    found = fmpy.simulate_fmu(str(tmp_path / "m.fmu"), fmi_type="ModelExchange", stop_time=6.0, output_interval=0.01,
                              relative_tolerance=1e-10, record_events=False)
    for output in ("place", "force"):
        # the error of CVode, at the tolerance above, grows while the friction falls with the speed
        assert np.abs(found[output] - run.display[output]).max() < 1e-5 * np.ptp(run.display[output])


@pytest.mark.parametrize(("name", "until", "version"), [
    ("thermostat", 43200.0, 2), pytest.param("pwm_drive", 6e-3, 3, marks=pytest.mark.long)])
def test_model_exchange_switches_at_the_instants_of_the_run(name: str, until: float, version: int, tmp_path: Path) -> None:
    """At the same output times. Between two output times of another program the interpolated result passes over the kink at
    an instant of switching: with points every 100 s, the temperature of the thermostat by 3e-3 of its range."""
    model, path = hb.load(circuit(f"circuits/{name}.yaml")), tmp_path / "m.fmu"
    export_fmu(model, path, version=version)
    run = hb.simulate(model, until, rtol=1e-11)
    switched = np.unique([t for t, _ in run.events if 0 < t < until])
    found = fmpy.simulate_fmu(str(path), fmi_type="ModelExchange", stop_time=until, output_interval=float(run.time[1]),
                              relative_tolerance=1e-10)
    assert len(switched) > 5
    # the instants follow from the states, with the errors of two integrators
    distance = np.abs(found["time"][:, None] - switched[None, :]).min(axis=0)
    assert distance.max() < 1e-6 * until
    last = np.searchsorted(found["time"], run.time + 1e-9 * until, side="right") - 1
    for output in model.show:
        # CVode of FMPy at 1e-10 a step against 1e-11: 1.3e-7 for the thermostat, 4e-9 for the drive
        assert np.abs(found[output][last] - run.display[output]).max() < 1e-6 * np.ptp(run.display[output]), output
