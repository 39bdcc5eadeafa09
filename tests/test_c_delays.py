"""Exact delays and the longest step in C programs and FMUs, compared with `simulate`."""

from __future__ import annotations

import re
from pathlib import Path

import fmpy
import numpy as np
import pytest
from click.testing import CliRunner
from collected import partly
from test_c_events import Program
from test_co_simulation_fmu import get, opened
from test_export import compiled

import heavebond as hb
from heavebond.cli import main
from heavebond.exchange.fmu_export import export_fmu

pytestmark = compiled

LOOP = """
model: loop
components:
  target: {is: %s}
  d:      {is: Delay, T: 0.3 s, u: =plant.y}
  drive:  {is: FirstOrderLag, T_1: 50 ms, u: "=3*(target.y - d.y)"}
  plant:  {is: Integrator, k: 1 1/s, u: =drive.y}
  e:      {is: Delay, T: 0.07 s, u: =target.y}
  filter: {is: FirstOrderLag, T_1: 30 ms, u: =e.y}
initial: {drive.y: 0, plant.y: 0, filter.y: 0}
show: {plant: {is: plant.y, unit: "1"}, d: {is: d.y, unit: "1"}, e: {is: e.y, unit: "1"}, filter: {is: filter.y, unit: "1"}}
simulate: {until: 1.5 s, every: 13 ms}
"""
EVENTS = """
model: sampled
components:
  target:  {is: Ramp, rate: 5 1/s, t_s: 0.05 s, t_e: 0.25 s}
  d:       {is: Delay, T: 0.013 s, u: =plant.y}
  d2:      {is: Delay, T: 0.1 s, u: =d.y}
  control: {is: SampleHold, T_s: 20 ms, u: "=5*(target.y - d2.y*0.5)"}
  relay:   {is: Relay, u_on: 0.3, u_off: 0.1, y_on: 1, u: =d2.y}
  drive:   {is: FirstOrderLag, T_1: 50 ms, u: "=control.y-relay.y"}
  plant:   {is: FirstOrderLag, T_1: 0.2 s, u: =drive.y}
initial: {drive.y: 0, plant.y: 0}
show: {plant: {is: plant.y, unit: "1"}, d2: {is: d2.y, unit: "1"}, relay: {is: relay.y, unit: "1"}}
simulate: {until: 0.4 s, every: 13 ms}
"""
CASES = {"step": LOOP % "Step, t_s: 0.1 s, after: 1", "ramp": LOOP % "Ramp, rate: 2 1/s, t_s: 0.1 s, t_e: 0.5 s",
         "sine": LOOP % "Sine, a: 1, T: 0.4 s", "events": EVENTS}
# Steps with an error of 1e-9 in the program and of 1e-10 in the run, over hundreds of steps; the history errs by up to 1e-9
# in each delay.
AGREE = 1e-7


def compare(found: np.ndarray, run: hb.Result, names: list[str], share: float = AGREE) -> None:
    for k, name in enumerate(names):
        exact = run.display[name]
        assert np.abs(found[:, k] - exact).max() < share * max(float(np.ptp(exact)), 1.0), name


@pytest.mark.parametrize("name", partly(CASES, 4))
def test_a_c_program_keeps_the_history_of_delays(name: str, tmp_path: Path) -> None:
    model = hb.loads(CASES[name])
    program, run = Program(model, tmp_path), hb.simulate(model, rtol=1e-9, atol=1e-11)
    found = np.array([program.advance(t) for t in run.time])
    compare(found, run, list(model.show))


@pytest.mark.parametrize("version", partly([2, 3], 2))
def test_a_co_simulation_fmu_keeps_the_history_of_delays(version: int, tmp_path: Path) -> None:
    model = hb.loads(CASES["step"])
    export_fmu(model, tmp_path / "m.fmu", version=version)
    told = fmpy.read_model_description(str(tmp_path / "m.fmu"))
    assert told.coSimulation is not None and told.modelExchange is None
    found = fmpy.simulate_fmu(str(tmp_path / "m.fmu"), stop_time=1.5, output_interval=0.05)
    run = hb.simulate(model, rtol=1e-9, atol=1e-11, every="50 ms")
    compare(np.array([[row[name] for name in model.show] for row in found]), run, list(model.show))


UNIX = 1_400_000_000  # s


def late(text: str) -> str:
    """The same diagram with a begin at the time of a UNIX clock."""
    text = re.sub(r"(t_[se]|until): ([\d.]+) s", lambda found: f"{found[1]}: {UNIX + float(found[2])!r} s", text)
    return text.replace("{until:", f"{{from: {UNIX} s, until:")


@pytest.mark.long
@pytest.mark.parametrize("name", CASES)
def test_a_late_begin_does_not_change_delays_in_a_c_program(name: str, tmp_path: Path) -> None:
    """A loop with delays, inputs of time, samples and a relay, after a begin at the time of a UNIX clock and at 0."""
    found = []
    for begin, text in ((0, CASES[name]), (UNIX, late(CASES[name]))):
        program = Program(hb.loads(text.replace("model: ", f"model: from_{begin}_")), tmp_path)
        program.begin(begin)
        found.append([program.advance(begin + t) for t in np.arange(0.013, 0.39, 0.013)])
    # an instant is rounded to 1.2e-7 s; the fastest output changes by 60 1/s
    assert np.abs(np.subtract(*found)).max() < 2e-5


@pytest.mark.long
@pytest.mark.parametrize("version", [2, 3])
def test_a_late_begin_does_not_change_delays_in_a_co_simulation_fmu(version: int, tmp_path: Path) -> None:
    found = []
    for begin, text in ((0, CASES["step"]), (UNIX, late(CASES["step"]))):
        export_fmu(hb.loads(text), tmp_path / f"{begin}.fmu", version=version)
        with opened(tmp_path / f"{begin}.fmu", version, begin) as (instance, references):
            for k in range(30):
                instance.doStep(currentCommunicationPoint=begin + 0.05 * k, communicationStepSize=0.05)
                found.append([get(instance, references[name]) for name in ("plant", "d", "e", "filter")])
    assert np.abs(np.subtract(found[:30], found[30:])).max() < 2e-5


@pytest.mark.long
def test_water_hammer_in_a_c_program(tmp_path: Path) -> None:
    """Delayed variables that follow each other without a state between: the front comes back undamped."""
    model = hb.load("examples/transmission_line")
    program, run = Program(model, tmp_path), hb.simulate(model, every="2 ms")
    found = np.array([program.advance(t) for t in run.time])
    # the front rises by 28 bar within a millisecond; both interpolate it anew in each passage of the pipe
    compare(found, run, list(model.show), 1e-5)


def test_a_copy_of_the_memory_goes_on_with_its_history_and_delays_are_parameters(tmp_path: Path) -> None:
    program = Program(hb.loads(CASES["step"]), tmp_path)
    program.advance(0.6)
    snapshot = program.run.raw
    first = program.advance(1.2)
    program.run.raw = snapshot
    assert np.array_equal(program.advance(1.2), first)
    program.begin(e_T=0.2)
    assert program.advance(0.299)[2] == 0
    assert program.advance(0.301)[2] == pytest.approx(1)
    program.begin(e_T=0.0)
    assert "not positive" in str(program.advance(0.1))


def test_a_jump_of_an_input_comes_back_after_the_delay(tmp_path: Path) -> None:
    """x' = u(t - T) with u held in each step: exact areas."""
    model = hb.loads("""
model: late
components:
  push: {is: Step, t_s: 10 s, after: 0}
  gain: {is: Gain, k: 2, u: =push.y}
  d:    {is: Delay, T: 0.25 s, u: =gain.y}
  x:    {is: Integrator, k: 1 1/s, u: =d.y}
initial: {x.y: 0}
show: {x: {is: x.y, unit: "1"}, d: {is: d.y, unit: "1"}}
simulate: {until: 1 s, every: 10 ms}
""")
    program = Program(model, tmp_path, ("gain.u",))
    program.advance(0.1, 0.0)
    program.advance(0.2, 1.5)
    x, d = program.advance(0.4, -1.0)
    assert (x, d) == pytest.approx((2 * 1.5 * 0.05, 3.0), abs=1e-8)
    x, d = program.advance(1.0, 0.0)
    assert (x, d) == pytest.approx((2 * (1.5 * 0.1 - 1.0 * 0.2), 0.0), abs=1e-8)


def test_the_longest_step_of_the_diagram_holds_in_c(tmp_path: Path) -> None:
    """A pulse that no step meets: a formula of the time without a kink, 2 ms wide, seen with steps of 1 ms only."""
    text = """
model: pulse
components:
  x: {is: Integrator, k: 1 1/s, u: "=exp(-(sin(pi*(time/(1 s) - 0.503))/0.004)**2)"}
initial: {x.y: 0}
show: {x: {is: x.y, unit: "1"}}
simulate: {until: 0.9 s, every: 0.3 s%s}
"""
    program = Program(hb.loads(text % ", largest_step: 1 ms"), tmp_path)
    assert program.advance(0.9)[0] == pytest.approx(0.004 / np.sqrt(np.pi), rel=1e-4)


@pytest.mark.long
def test_the_command_says_that_model_exchange_has_no_history(tmp_path: Path) -> None:
    (tmp_path / "loop.yaml").write_text(CASES["step"], encoding="utf-8")
    said = CliRunner().invoke(main, ["export", str(tmp_path / "loop.yaml"), "-o", str(tmp_path / "m.fmu")]).output
    assert "kept in co-simulation only" in said and "m: 3" in said
    with opened(tmp_path / "m.fmu", 3) as (made, _):
        made.doStep(currentCommunicationPoint=0.0, communicationStepSize=0.1)
