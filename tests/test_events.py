"""Events against exact solutions: where they happen, what they set, and how that moves with parameters."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from diagrams import BALL, FLOOR, PEAKS

import heavebond as hb
from heavebond.core.errors import RunWarning
from heavebond.energy_audit.audit import energy as audit
from heavebond.estimation.experiment import load_experiment
from heavebond.estimation.fitting import fit
from heavebond.exchange.portable import portable
from heavebond.numerics import event_integration, simulator
from heavebond.numerics.dae import Assembly
from heavebond.numerics.jumps import EventEquations
from heavebond.numerics.pointwise import AT_ONCE
from heavebond.numerics.simulator import Simulator, Tolerances
from heavebond.optimise.adjoint import Adjoint
from heavebond.optimise.gradient_check import check_gradients, costs_of
from heavebond.optimise.objective import Objective, TuningProblem, ranges
from heavebond.text.expression import parse_formula

TIGHT = Tolerances(1e-12, 1e-14, along=1.0)
# what is integrated to rtol 1e-8 over some hundred steps, and located as well, is right to this share
CLOSE = 1e-6
GRAVITY = 9.80665

HEATER = """
component: HeatedTank
summary: A tank that cools by itself and is heated between two temperatures.
parameters:
  tau:   {unit: s, min: 1e-3 s, doc: time constant}
  T_air: {unit: 1, doc: temperature of the air}
  T_hot: {unit: 1, doc: temperature that heating leads to}
  low:   {unit: 1, doc: heating begins below}
  high:  {unit: 1, doc: heating ends above}
variables:
  T:  {unit: 1, doc: temperature}
  on: {unit: 1, held: 1, min: 0, max: 1, doc: 1 while heating}
  E:  {unit: s, doc: time of heating}
equations: |
  tau * der(T) = T_air - T + on * (T_hot - T_air)   # heat
  der(E) = on                                       # time of heating
when:
  stop:  {condition: T > high and on == 1, then: {on: 0}}
  start: {condition: T < low, then: {on: 1}}
"""

THERMOSTAT = """
model: thermostat
components:
  tank: {is: HeatedTank, tau: 4 s, T_air: 10, T_hot: 40, low: 20, high: 25}
initial: {tank.T: 18, tank.E: 0 s}
simulate: {until: 10 s, every: 50 ms}
"""

SAMPLED = """
model: sampled
parameters: {T: 50 ms}
components:
  cart: {is: Mass, m: 2 kg}
  pull: {is: ForceSource}
  hold: {is: SampleHold, T_s: =T, u: "=-20 N/m*load.x - 9 N*s/m * load.v"}
nodes:
  load:  [cart.a, pull.a]
  force: [hold.y, pull.u]
initial: {load.x: 0.2 m, load.v: 0 m/s}
simulate: {until: 3 s, every: 10 ms}
"""

SWITCHED = """
model: switched
components:
  wall:   {is: Fixed}
  spring: {is: Spring, c: 1.2 kN/m}
  cart:   {is: Mass, m: 2.5 kg}
  pull:   {is: ForceSource}
  step:   {is: Step, t_s: 0.7 s, after: 30 N}
nodes:
  ground: [wall.a, spring.a]
  load:   [spring.b, cart.a, pull.a]
  force:  [step.y, pull.u]
initial: {load.x: 50 mm, load.v: 0.1 m/s}
simulate: {until: 2 s, every: 20 ms}
"""

LOOP = """
model: loop
components:
  source: {is: PressureSource, p_0: 100 bar}
  first:  {is: Orifice, q_r: 60 L/min, dp_r: 10 bar}
  second: {is: Orifice, q_r: 40 L/min, dp_r: 10 bar}
  bypass: {is: BypassValve, q_r: 20 L/min, dp_r: 10 bar}
  step:   {is: Step, t_s: 0.45 s, after: 1}
  oil:    {is: Volume, V: 1 L, beta: 1.5 GPa}
  third:  {is: Orifice, q_r: 50 L/min, dp_r: 10 bar}
  tank:   {is: Tank}
nodes:
  high:   [source.a, first.a]
  mid:    [first.b, second.a, bypass.a]
  volume: [second.b, bypass.b, oil.a, third.a]
  low:    [third.b, tank.a]
  open:   [step.y, bypass.u]
simulate: {until: 1 s, every: 10 ms}
"""

RELIEF = """
component: Relief
summary: Opens for good above a pressure.
ports: {a: hydraulic, y: {signal: out, unit: 1, doc: opening}}
parameters: {p_max: {unit: Pa, doc: pressure at which it opens}}
variables: {open: {unit: 1, held: 0, min: 0, max: 1, doc: 1 once it is open}}
equations: |
  a.q = 0      # it only feels the pressure
  y   = open   # opening
when:
  open: {condition: a.p > p_max, then: {open: 1}}
"""

KEEPER = """
component: Keeper
summary: Keeps two values of a signal.
ports: {u: {signal: in, unit: s}, y: {signal: out, unit: s}}
parameters: {t_1: {unit: s}, t_2: {unit: s}}
variables: {h: {unit: s, count: 2, held: 0 s}}
equations: |
  y = h[1] + 10 * h[2]
when:
  first:  {at: t_1, then: {"h[1]": u}}
  second: {at: t_2, then: {"h[2]": "u + h[1]"}}
"""
KEPT = """
model: kept
components:
  ramp:   {is: Ramp, rate: 1}
  keeper: {is: Keeper, t_1: 1 s, t_2: 2 s}
nodes: {u: [ramp.y, keeper.u]}
simulate: {until: 3 s, every: 10 ms}
"""

# the pressure of a node without volume, an algebraic unknown, sets it off
BURST = LOOP.replace("step:   {is: Step, t_s: 0.45 s, after: 1}", "burst:  {is: Relief, p_max: 75 bar}") \
    .replace("bypass.a]", "bypass.a, burst.a]").replace("step.y", "burst.y").replace("V: 1 L", "V: 40 L")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, text in (("floor", FLOOR), ("heater", HEATER), ("relief", RELIEF), ("keeper", KEEPER)):
        (tmp_path / f"{name}.yaml").write_text(text, encoding="utf-8")
    return tmp_path


def built(text: str, folder: Path) -> Assembly:
    return hb.assemble(hb.loads(text, folder))


# -- against exact solutions -------------------------------------------------------------------------------------------
def test_a_bouncing_ball(folder: Path) -> None:
    run = hb.simulate(built(BALL, folder))
    impacts, speed = [np.sqrt(2 / GRAVITY)], np.sqrt(2 * GRAVITY)
    while impacts[-1] < 2:
        speed *= 0.8
        impacts.append(impacts[-1] + 2 * speed / GRAVITY)
    times = np.array([time for time, _ in run.events])
    assert [name for _, name in run.events] == ["floor.impact"] * 3
    assert times == pytest.approx(np.array(impacts[:3]), rel=CLOSE)
    last = run.time > impacts[2]
    flight = run.time[last] - impacts[2]
    speed = np.sqrt(2 * GRAVITY) * 0.8**3
    assert run["ball.x"][last] == pytest.approx(speed * flight - GRAVITY / 2 * flight**2, abs=CLOSE)
    assert run["floor.bounces"] == pytest.approx(np.searchsorted(times, run.time, side="right"))


def test_a_thermostat_with_two_temperatures(folder: Path) -> None:
    run = hb.simulate(built(THERMOSTAT, folder))
    cooling, heating = 4 * np.log((25 - 10) / (20 - 10)), 4 * np.log((40 - 20) / (40 - 25))
    first = 4 * np.log((40 - 18) / (40 - 25))
    wanted = np.cumsum([first, cooling, heating, cooling, heating, cooling, heating])
    assert [name for _, name in run.events] == [*["tank.stop", "tank.start"] * 3, "tank.stop"]
    assert np.array([time for time, _ in run.events]) == pytest.approx(wanted, rel=CLOSE)
    assert run["tank.E"][-1] == pytest.approx(first + 3 * heating, rel=CLOSE)
    assert set(run["tank.on"]) == {0.0, 1.0}


def test_a_sampled_controller(folder: Path) -> None:
    run = hb.simulate(built(SAMPLED, folder))
    period, mass, (x, v) = 0.05, 2.0, (0.2, 0.0)
    for k in range(60):  # the exact motion under a force that is held for a period
        at = round(k * period / 0.01)
        force = -20 * x - 9 * v
        assert run["load.x"][at] == pytest.approx(x, abs=CLOSE)
        assert run["pull.u"][at:at + 5] == pytest.approx(force, abs=20 * CLOSE)
        x, v = x + v * period + force / mass * period**2 / 2, v + force / mass * period
    assert len(run.events) == 61


def test_a_switch_at_a_given_time(folder: Path) -> None:
    run = hb.simulate(built(SWITCHED, folder))
    w = np.sqrt(1200 / 2.5)
    free = 0.05 * np.cos(w * run.time) + 0.1 / w * np.sin(w * run.time)
    pulled = np.where(run.time > 0.7, 30 / 1200 * (1 - np.cos(w * (run.time - 0.7))), 0)
    assert run.events == [(pytest.approx(0.7), "step.switch")]
    assert run["load.x"] == pytest.approx(free + pulled, abs=CLOSE)
    at = int(np.argmin(np.abs(run.time - 0.7)))
    assert run["step.y"][at - 1:at + 1] == pytest.approx([0, 30])  # at the instant the value after it


def test_events_assign_elements_of_a_held_list(folder: Path) -> None:
    """Each keeps what the ramp is at its time; the second adds what the first has kept."""
    run = hb.simulate(built(KEPT, folder))
    assert [run[f"keeper.h[{k}]"][-1] for k in (1, 2)] == pytest.approx([1.0, 3.0])
    assert run["keeper.y"][-1] == pytest.approx(1.0 + 10 * 3.0)


def test_algebraic_unknowns_jump_with_an_event(folder: Path) -> None:
    run = hb.simulate(built(LOOP, folder))
    flow = run["first.q"] - run["second.q"] - run["bypass.q"]
    assert np.abs(flow).max() < 1e-9 * np.abs(run["first.q"]).max()
    at = int(np.argmin(np.abs(run.time - 0.45)))
    assert run["bypass.q"][at - 1] == 0 < run["bypass.q"][at]
    # the pressure of a node without volume jumps, that of the oil does not
    assert abs(run["mid.p"][at] - run["mid.p"][at - 1]) > 1e5
    assert abs(run["volume.p"][at] - run["volume.p"][at - 1]) < 1e5


def test_instants_before_the_run(folder: Path) -> None:
    """What happens once has happened; what is repeated goes on with its next instant."""
    step = Simulator(built(SWITCHED, folder), times=np.array([1.0, 1.5, 2.0])).run()
    assert step.events == [(1.0, "step.switch")]
    assert step["step.y"] == pytest.approx(30)
    sampled = Simulator(built(SAMPLED, folder), times=np.array([1.02, 1.06, 1.11])).run()
    assert [time for time, _ in sampled.events] == pytest.approx([1.05, 1.1])


def test_a_condition_that_is_true_between_two_looks_only(folder: Path) -> None:
    """A sine is above 0.9999 for 4.5 ms of a period of 1 s; conditions are looked at every 10 ms."""
    (folder / "peaks.yaml").write_text(PEAKS, encoding="utf-8")
    run = hb.simulate(built("model: peaks\ncomponents: {p: {is: Peaks, w: 6.283185307 1/s, level: 0.9999}}\n"
                            "initial: {p.x: 0, p.y: 1}\nsimulate: {until: 10 s, every: 10 ms}", folder))
    wanted = (np.arcsin(0.9999) / (2 * np.pi)) + np.arange(10)
    # near a peak an error of the sine is a ten times larger one of the time, and it adds up over ten periods
    times = np.array([time for time, _ in run.events])
    assert times == pytest.approx(wanted, abs=100 * CLOSE)


def test_late_times(folder: Path) -> None:
    """Where a time is rounded to 1e-7 s, instants are found to that."""
    begin = 1e9
    run = Simulator(built(BALL, folder), times=begin + np.arange(0, 1, 0.01)).run()
    assert [name for _, name in run.events] == ["floor.impact"]
    assert run.events[0][0] - begin == pytest.approx(np.sqrt(2 / GRAVITY), abs=1e-6)
    sampled = Simulator(built(SAMPLED, folder), times=begin + np.arange(0, 0.5, 0.01)).run()
    assert len(sampled.events) == 10


# -- sensitivities -----------------------------------------------------------------------------------------------------
CASES = {
    "ball": (BALL, "ball.x", ["floor.e", "weight.g", "initial.ball.x", "initial.ball.v"]),
    "thermostat": (THERMOSTAT, "tank.T", ["tank.low", "tank.high", "tank.tau", "tank.T_hot", "initial.tank.T"]),
    "sampled": (SAMPLED, "load.x", ["T", "cart.m", "initial.load.x"]),
    "sampled later": (SAMPLED.replace("T_s: =T,", "T_s: =T, t_0: 25 ms,"), "load.x", ["T", "hold.t_0"]),
    "switched": (SWITCHED, "load.x", ["step.t_s", "step.after", "spring.c"]),
    "loop": (LOOP, "mid.p", ["step.t_s", "first.q_r", "bypass.q_r"]),
    "condition on a loop": (BURST, "volume.p", ["burst.p_max", "first.q_r", "bypass.q_r", "oil.V"]),
}


@pytest.mark.long
@pytest.mark.parametrize("case", list(CASES))
def test_sensitivities_agree_with_differences(case: str, folder: Path) -> None:
    """Sixth order differences with steps of 5e-4 of each parameter, as in test_sensitivities; points within the
    reach of a step around an instant are on both sides of it and left out."""
    text, signal, names = CASES[case]
    assembly = built(text, folder)
    along = Simulator(assembly, tolerances=TIGHT, sensitivities=names).run()
    plain = Simulator(assembly, tolerances=TIGHT)
    for name in names:
        value = assembly.parameter_values[name]
        step = 5e-4 * (abs(value) or 0.1)
        found = {k: plain.run({name: value + k * step}) for k in (-3, -2, -1, 1, 2, 3)}
        runs = {k: run.display[signal] for k, run in found.items()}
        difference = (45 * (runs[1] - runs[-1]) - 9 * (runs[2] - runs[-2]) + (runs[3] - runs[-3])) / (60 * step)
        exact = along.sensitivity(signal, name)
        away = np.ones(len(exact), dtype=bool)
        for k, (time, _) in enumerate(along.events):
            times = [time, *(run.events[k][0] if k < len(run.events) else along.time[-1] for run in found.values())]
            away &= (along.time < min(times) - 1e-9) | (along.time > max(times) + 1e-9)
        assert away.sum() > len(away) / 2
        assert np.abs(exact - difference)[away].max() <= 1e-6 * np.abs(exact[away]).max(), name


def test_integrals_move_with_events_too(folder: Path) -> None:
    assembly = built(BALL, folder)
    square = assembly.expression(parse_formula("ball.v**2"))
    names = ["floor.e", "initial.ball.x"]
    along = Simulator(assembly, tolerances=TIGHT, quadratures=square, sensitivities=names).run()
    plain = Simulator(assembly, tolerances=TIGHT, quadratures=square)
    assert along.along is not None
    for k, name in enumerate(names):
        value, step = assembly.parameter_values[name], 1e-3
        ends = {n: plain.run({name: value + n * step}).quadratures[0, -1] for n in (-2, -1, 1, 2)}
        difference = (8 * (ends[1] - ends[-1]) - (ends[2] - ends[-2])) / (12 * step)
        assert along.along.quadratures[k, 0, -1] == pytest.approx(difference, rel=1e-6)


def test_the_start_of_a_held_variable_is_a_parameter(folder: Path) -> None:
    text = SWITCHED.replace("initial: {", "initial: {step.switched: 0.5, ")
    run = hb.simulate(built(text, folder), sensitivities=["initial.step.switched"], parameters={"step.t_s": 0.9})
    assert run["step.y"][0] == 15
    before = run.time < 0.9 - 1e-9
    assert run.sensitivity("step.y", "initial.step.switched") == pytest.approx(np.where(before, 30, 0))


# -- what is made of events --------------------------------------------------------------------------------------------
def test_a_switching_time_is_found_from_a_record(folder: Path) -> None:
    run = hb.simulate(built(SWITCHED, folder), every="20 ms", parameters={"step.t_s": 0.8137, "step.after": 27})
    noise = 1e-5 * np.random.default_rng(1).standard_normal(len(run.time))
    rows = "\n".join(f"{t:.2f},{x:.9f}" for t, x in zip(run.time, run["load.x"] + noise, strict=True))
    (folder / "record.csv").write_text("t_s,x_m\n" + rows + "\n", encoding="utf-8")
    (folder / "switched.yaml").write_text(SWITCHED, encoding="utf-8")
    (folder / "experiment.yaml").write_text("""
experiment: when did it switch
model: switched.yaml
records: {train: {file: record.csv, use: fit}}
time: {column: t_s, unit: s}
outputs: {load.x: {column: x_m, unit: m, noise: 10 um}}
free: {step.t_s: 0.5 .. 1.2 s, step.after: 10 .. 60 N}
""", encoding="utf-8")
    found = fit(load_experiment(folder / "experiment.yaml")).values
    # a noise of 10 um against forces of 27 N in 1.2 kN/m: some parts in ten thousand
    assert found["step.t_s"] == pytest.approx(0.8137, abs=1e-4)
    assert found["step.after"] == pytest.approx(27, rel=1e-3)


def test_the_compensator_is_switched_on() -> None:
    run = hb.simulate(hb.load("cmc_ahc/passive_then_active"), "144 s", every="0.1 s")
    active = hb.simulate(hb.load("cmc_ahc"), "144 s", every="0.1 s")
    assert run.events == [(48.0, "switch.switch")]
    moved = {name: np.sqrt(np.mean(values["crown.x"][(run.time >= begin) & (run.time < begin + 24)]**2))
             for name, values, begin in (("off", run, 24), ("on", run, 120), ("active", active, 120))}
    assert moved["off"] > 10 * moved["on"]
    # what is left of the passive motion after six periods
    assert moved["on"] == pytest.approx(moved["active"], rel=0.02)


def test_costs_are_differentiated_forward(folder: Path) -> None:
    names = ["step.t_s", "step.after", "spring.c", "cart.m"]
    task = TuningProblem(ranges(dict(zip(names, ("0.5 .. 1 s", "10 .. 50 N", "1 .. 2 kN/m", "2 .. 3 kg"), strict=True))),
                         "rms(load.x) + 0.001*final(load.x*step.switched)")
    assembly = built(SWITCHED, folder)
    problem = Objective(assembly, task)
    assert not problem.backwards
    verdicts = check_gradients(costs_of(assembly, task), names)
    assert [verdict.word for verdict in verdicts] == ["agrees"] * 4
    with pytest.raises(hb.UsageError, match="a run backwards does not go through events"):
        Adjoint(problem.cases[0].plain, problem.cases[0].evaluator, names)


def test_energy_is_accounted_for_at_events(folder: Path) -> None:
    found = audit(built(BALL, folder)).raise_if_open()
    # a ball keeps e**2 of its energy at each of three impacts
    assert found.events == pytest.approx(-2 * GRAVITY * (1 - 0.8**6), rel=CLOSE)
    assert found.dissipated == 0


def test_events_set_off_each_other_at_one_instant(folder: Path) -> None:
    (folder / "chain.yaml").write_text("""
component: Chain
summary: One step after the other, at once.
parameters: {t_1: {unit: s, doc: begin}}
variables:
  mode: {unit: 1, held: 0, doc: how far}
  x:    {unit: 1, doc: anything that moves}
equations: |
  der(x) * t_1 = mode   # motion
when:
  third:  {condition: mode == 2 and x > -1, then: {mode: 3, x: x + 1}}
  second: {condition: mode == 1, then: {mode: 2}}
  first:  {at: t_1, then: {mode: 1}}
""", encoding="utf-8")
    assembly = built("model: chain\ncomponents: {c: {is: Chain, t_1: 0.5 s}}\nsimulate: {until: 1 s, every: 100 ms}", folder)
    run = hb.simulate(assembly, sensitivities=["c.t_1"])
    assert run.events == [(0.5, "c.first"), (0.5, "c.second"), (0.5, "c.third")]
    assert run["c.x"][-1] == pytest.approx(1 + 3 / 0.5 * 0.5)
    # x = 1 + 3 (t - t_1)/t_1
    assert run.sensitivity("c.x", "c.t_1")[-1] == pytest.approx(-3 * 1 / 0.5**2)


def test_chattering_is_named(folder: Path) -> None:
    (folder / "relay.yaml").write_text("""
component: Relay
summary: A relay without a band.
variables:
  x:  {unit: m, doc: place}
  v:  {unit: m/s, held: 1 m/s, doc: speed}
equations: |
  der(x) = v   # motion
when:
  down: {condition: x > 0, then: {v: -abs(v)}}
  up:   {condition: x < 0, then: {v: abs(v)}}
""", encoding="utf-8")
    assembly = built("model: relay\ncomponents: {r: {is: Relay}}\ninitial: {r.x: -0.5 m}\nsimulate: {until: 1 s}", folder)
    with pytest.raises(hb.SimulationError, match=r"'r\.(up|down)' happens 4 times .* t = 0\.5 s") as caught:
        hb.simulate(assembly)
    assert "a band between switching on and off" in str(caught.value)


def test_a_ball_that_comes_to_rest_is_chattering(folder: Path) -> None:
    with pytest.raises(hb.SimulationError, match=r"'floor\.impact' happens 4 times"):
        hb.simulate(built(BALL, folder), "6 s")


def test_a_law_that_ends_at_its_event(folder: Path) -> None:
    """Behind the event, and not only there, the outflow's root has no value: the run stops in time."""
    (folder / "drain.yaml").write_text("""
component: Drain
summary: A tank that runs empty.
parameters:
  k: {unit: m/s, doc: speed at the height l}
  q: {unit: m/s, doc: what a pump draws}
  l: {unit: m, default: 1 m, doc: height}
variables:
  h:    {unit: m, doc: level}
  open: {unit: 1, held: 1, doc: 1 until it is empty}
equations: |
  der(h) = -open * (k * sqrt(h/l) + q)   # outflow
when:
  empty: {condition: h < 0, then: {open: 0}}
""", encoding="utf-8")
    run = hb.simulate(built("model: drain\ncomponents: {tank: {is: Drain, k: 0.4 m/s, q: 0.1 m/s}}\n"
                            "initial: {tank.h: 1 m}\nsimulate: {until: 5 s}", folder))
    empty = 2 / 0.4 * (1 - 0.25 * np.log(5))  # int_0^1 dh / (0.4 sqrt(h) + 0.1)
    assert run.events == [(pytest.approx(empty, rel=CLOSE), "tank.empty")]
    assert run["tank.h"][-1] == pytest.approx(0, abs=CLOSE)


def test_an_event_that_leaves_no_solution(folder: Path) -> None:
    assembly = built("""
model: shut
components:
  pump:  {is: FlowSource, u: 12 L/min}
  valve: {is: BypassValve, q_r: 20 L/min, dp_r: 10 bar}
  step:  {is: Step, t_s: 1 s, before: 1, after: 0}
  tank:  {is: Tank}
nodes: {high: [pump.a, valve.a], low: [valve.b, tank.a], open: [step.y, valve.u]}
simulate: {until: 2 s}
""", folder)
    with pytest.raises(hb.SimulationError, match=r"determines high\.p after 'step\.switch' at t = 1 s: open is 0"):
        hb.simulate(assembly)


def test_a_run_that_breaks_down_between_events(folder: Path) -> None:
    (folder / "blow.yaml").write_text("""
component: Blow
summary: Grows without bounds from an instant on.
parameters: {T: {unit: s, doc: time}}
variables:
  x:  {unit: 1, doc: what grows}
  on: {unit: 1, held: 0, doc: 1 while it does}
equations: |
  T * der(x) = on * sqrt(1 - x)   # has no value beyond 1
when:
  go: {at: T, then: {on: -1}}
  on: {condition: x < -3, then: {x: 2}}
""", encoding="utf-8")
    assembly = built("model: blow\ncomponents: {b: {is: Blow, T: 1 s}}\nsimulate: {until: 9 s}", folder)
    # x' = -sqrt(1 - x) from 1 s on: sqrt(1 - x) = 1 + (t - 1)/2 is 2 at 3 s
    with pytest.raises(hb.SimulationError, match=r"stopped at t = 3.* s"):
        hb.simulate(assembly)


def test_what_cannot_go_through_events_says_so(folder: Path) -> None:
    assembly = built(SWITCHED, folder)
    with pytest.raises(hb.UsageError, match=r"cannot begin midway"):
        Simulator(assembly, free_start=True).run_from(np.zeros(2))
    with pytest.raises(hb.UsageError, match=r"'initial\.step\.switched'"):
        hb.simulate(assembly, parameters={"step.switched": 1})
    with pytest.raises(hb.ModelError, match=r"hold\.T_s = T, that is -1 s, is not allowed"):
        hb.simulate(built(SAMPLED, folder), parameters={"T": -1})


# -- comparisons of the time -------------------------------------------------------------------------------------------
PUSHED = """
model: pushed
parameters: {{T: {T}}}
components:
  cart: {{is: Mass, m: 2 kg}}
  drag: {{is: Damper, d: 3 N*s/m}}
  wall: {{is: Fixed}}
  push: {{is: ForceSource, u: "={push}"}}
nodes: {{load: [cart.a, push.a, drag.b], wall: [wall.a, drag.a]}}
initial: {{{start}}}
simulate: {{until: 2 s, every: 0.1 s}}
"""


def pushed(folder: Path, push: str, T: str = "0.33 s", start: str = "load.v: 0 m/s") -> hb.Assembly:
    return built(PUSHED.format(push=push, T=T, start=start), folder)


@pytest.mark.parametrize("push", [
    "if_else(time < T, 0 N, 5 N)", "if_else(T <= time, 5 N, 0 N)", "if_else(1 - time/T > 0, 0 N, 5 N)",
    "if_else(not time >= T or time < 0.1 s, 0 N, 5 N)", "5 N*if_else(time > T and time < 100*T, 1, 0)"])
def test_a_comparison_of_the_time_is_a_time_event(push: str, folder: Path) -> None:
    """v = F/d*(1 - exp(-d/m*(t - T))) from T on, and its derivative by T; the solver knows no tolerance of an instant."""
    run = hb.simulate(pushed(folder, push), sensitivities=["T"])
    assert 0.33 in [time for time, _ in run.events]
    late = np.maximum(run.time - 0.33, 0.0)
    assert run["load.v"] == pytest.approx(5/3*(1 - np.exp(-1.5*late)), abs=2e-7)  # the solver's own error, at rtol 1e-8
    by_T = np.where(run.time < 0.33, 0.0, -2.5*np.exp(-1.5*late))
    assert run.sensitivity("load.v", "T") == pytest.approx(by_T, abs=1e-6)


def test_an_instant_that_depends_on_a_parameter_moves_with_it(folder: Path) -> None:
    assembly = pushed(folder, "if_else(2*time < T, 0 N, 5 N)")
    assert hb.simulate(assembly, parameters={"T": 1.5}).events == [(0.75, "push.clock_1")]


def test_a_condition_of_the_time_that_holds_from_the_start_on_holds_for_a_steady_start(folder: Path) -> None:
    for push in ("if_else(time < T, 0 N, 6 N)", "if_else(time*(1 - 1) < -T, 0 N, 6 N)"):
        run = hb.simulate(pushed(folder, push, T="0 s", start="start: steady"))
        assert run["load.v"] == pytest.approx(np.full(21, 2.0), abs=1e-9)


def test_what_moves_is_no_condition_of_the_time_alone(folder: Path) -> None:
    assembly = pushed(folder, "if_else(time + load.v/(1 m/s)*1 s < T, 0 N, 5 N)")
    assert not assembly.flat.events


def test_runs_from_midway_and_exports_go_with_conditions_of_the_time(folder: Path) -> None:
    assembly = pushed(folder, "if_else(time < T, 0 N, 5 N)")
    midway = Simulator(assembly, times=np.linspace(1.0, 2.0, 11), free_start=True)
    run = midway.run_from(np.array([0.5]))
    assert run["load.v"] == pytest.approx(5/3 + (0.5 - 5/3)*np.exp(-1.5*(run.time - 1)), abs=2e-7)
    assert run.sensitivity("load.v", "load.v") == pytest.approx(np.exp(-1.5*(run.time - 1)), abs=1e-6)
    exported = portable(assembly.model)
    rates = [float(exported.equations(t, [0.0], [], exported.assembly.p, [])[0]) for t in (0.32, 0.34)]
    assert rates == [0.0, 2.5]


LATCH = """component: Latch
summary: A switch that closes as its signal exceeds a level.
ports: {u: {signal: in, unit: V}, y: {signal: out, unit: 1}}
parameters: {level: {unit: V, default: 1 V}}
variables: {on: {unit: 1, held: 0, min: 0, max: 1}}
equations: |
  y = on
when:
  rise: {condition: u > level, then: {on: 1}}
"""


@pytest.mark.parametrize(("start", "said"), [("", True), ("initial: {latch.on: 1}", False)])
def test_a_condition_that_is_true_at_the_start_is_named_by_the_verdict(tmp_path: Path, start: str, said: bool) -> None:
    """It does not become true, and nothing happens; where the diagram states what holds there, nothing is missing."""
    (tmp_path / "components").mkdir()
    (tmp_path / "components" / "latch.yaml").write_text(LATCH)
    (tmp_path / "rig.yaml").write_text(f"model: rig\ncomponents:\n  latch: {{is: Latch, u: 2 V}}\n{start}\n"
                                       "simulate: {until: 1 s}\n")
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        result = hb.simulate(hb.load(tmp_path / "rig.yaml"))
    assert result["latch.y"][-1] == (0 if said else 1)
    kinds = [f.kind for f in result.verdict.findings]
    assert kinds == (["true-at-start"] if said else [])
    assert bool(heard) == said
    if said:
        assert "latch.rise" in str(heard[0].message) and "initial: {switch.on: 1}" in str(heard[0].message)
        assert result.verdict.as_dict()["exit"] == 0


@pytest.mark.filterwarnings("error")
def test_a_condition_that_becomes_true_by_an_event_at_the_start_acts_without_a_warning(tmp_path: Path) -> None:
    (tmp_path / "rig.yaml").write_text("""model: rig
components:
  pulses:  {is: SquareWave, high: 1, T: 1 s}
  counter: {is: Counter, r: 0}
nodes: {pulses: [pulses.y, counter.u], count: [counter.y]}
simulate: {until: 2.5 s, every: 0.25 s}
""")
    result = hb.simulate(hb.load(tmp_path / "rig.yaml"))
    assert not result.verdict.findings
    assert list(result["counter.y"]) == [1]*4 + [2]*4 + [3]*3


def test_an_indicator_that_falls_from_zero_is_no_crossing() -> None:
    """A condition such as `x > limit` where x leaves the limit: zero at the begin, below it afterwards."""
    from heavebond.numerics.zero_crossings import crossing

    def falls(t: float) -> tuple[float, float]:
        return -t * t, -2 * t

    def bounces(t: float) -> tuple[float, float]:  # below zero up to 1/2, and above it at the end
        return t * (t - 0.5), 2 * t - 0.5

    assert crossing(falls, 0.0, 1.0, 0.0, (1e-17, 0.875), certain=False, precision=1e-12) is None
    assert crossing(bounces, 0.0, 1.0, 0.0, (1.0, 0.25), certain=True, precision=1e-12) == pytest.approx(0.5, abs=1e-11)


COUNTED = """component: Counted
summary: Counts whole seconds while the count has reached a level.
units: unchecked
ports: {y: {signal: out, unit: 1}}
parameters: {level: {unit: 1, default: 0}}
variables: {n: {unit: 1, held: 0}}
equations: |
  y = n
when:
  up: {condition: CONDITION, then: {n: n + 1}}
"""


@pytest.mark.parametrize("condition", ["n >= level and time > n + 1", "not n < level and time > n + 1",
                                       "level <= n and time > n + 1", "not (n > 5 or n < level) and time > n + 1"])
def test_what_an_event_holds_may_equal_the_bound_of_a_condition(tmp_path: Path, condition: str) -> None:
    (tmp_path / "components").mkdir()
    (tmp_path / "components" / "counted.yaml").write_text(COUNTED.replace("CONDITION", condition))
    (tmp_path / "m.yaml").write_text("model: m\ncomponents: {part: {is: Counted}}\nsimulate: {until: 2.5 s, every: 0.1 s}\n")
    run = hb.simulate(hb.load(str(tmp_path / "m.yaml")))
    assert [name for _, name in run.events] == ["part.up", "part.up"]
    assert [t for t, _ in run.events] == pytest.approx([1.0, 2.0], abs=1e-9)
    never = hb.simulate(hb.load(str(tmp_path / "m.yaml")), parameters={"part.level": 1.0})
    assert not never.events


def test_conditions_are_evaluated_at_many_points_as_at_each_by_itself() -> None:
    """To the last bit, whatever the number of points: they are handed over some at a time."""
    assembly = hb.assemble(hb.load("circuits/pile_driver"))
    equations = EventEquations(assembly, ca.SX(0, 1), ca.SX(0, 1))
    n, random = 2*AT_ONCE + 7, np.random.default_rng(1)
    times, u = np.linspace(0, 1, n), np.zeros((0, n))
    x, z = (size[:, None]*random.normal(size=(len(size), n)) for size in (assembly.x_nominal, assembly.z_nominal))
    many = equations.indicators(times, x, z, assembly.p, u)
    assert len(many[0]) == 4
    assert all(np.ptp(values, axis=1).any() for values in many)
    for k in range(n):
        at = slice(k, k + 1)
        one = equations.indicators(times[at], x[:, at], z[:, at], assembly.p, u[:, at])
        for values, alone in zip(many, one, strict=True):
            np.testing.assert_array_equal(values[:, at], alone)


@pytest.mark.long
def test_dense_events_are_named_with_their_part_and_rate() -> None:
    """A comparator behind a burst of 60 kHz for 2 ms: an event in each half of a period."""
    text = """model: burst
components:
  quiet: {is: Comparator, level: 0.5, u: "=sin(2*pi*3 Hz*time)"}
  edges: {is: Comparator, level: 0, u: "=if_else(time < 2 ms, sin(2*pi*F*time), -1)"}
simulate: {until: 1 s}
"""
    with pytest.warns(hb.RunWarning, match=r"edges has 12\d{4} events per second at 0\.00\d+ s and 24\d in the run"):
        run = hb.simulate(hb.loads(text.replace("F", "60 kHz")))
    found, = run.verdict.findings
    assert (found.kind, found.part, found.failed) == ("dense-events", "edges", False)
    assert found.value == pytest.approx(2 * 60e3, rel=0.02)  # of 99 half periods
    assert "Relay" in found.advice
    assert not hb.simulate(hb.loads(text.replace("F", "10 kHz"))).verdict.findings


# x'' = -1 above x = b and +1 below, from x = 1 at rest; with s = sqrt(2 (1 - b)), x(3) = b - s (3 - s) + (3 - s)**2/2
TURNING = """
model: turning
parameters: {{b: 0.1 m}}
components:
  mass:  {{is: Mass, m: 1 kg}}
  push:  {{is: ForceSource, u: "{force}"}}
  {more}
nodes: {{body: [mass.a, push.a]}}
initial: {{body.x: 1 m, body.v: 0 m/s}}
simulate: {{until: 3 s, every: 10 ms}}
"""


@pytest.mark.parametrize("force", ["=if_else(body.x > b, -1 N, 1 N)", "=-1 N*sign(body.x - b)",
                                   "=if_else(body.x <= b, 1 N, if_else(body.x < 9 m, -1 N, 0 N))"])
def test_sensitivities_past_a_jump_at_a_condition_of_a_state_are_not_given_without_a_warning(force):
    run_of = hb.loads(TURNING.format(force=force, more=""))
    with pytest.warns(RunWarning, match=r"the sensitivities lack the jump of push at 1.34\d s"):
        run = hb.simulate(run_of, sensitivities=["b"])
    assert [(f.kind, f.failed) for f in run.verdict.findings] == [("jump", False)]
    s = np.sqrt(1.8)
    assert run["body.x"][-1] == pytest.approx(0.1 - s*(3 - s) + (3 - s)**2/2, abs=1e-6)
    assert not hb.simulate(run_of).verdict.findings


def test_sensitivities_past_a_switch_on_a_state_are_those_of_the_closed_form():
    more = 'side: {{is: Switch, u: "=body.x - b", u_1: -1 N, u_2: 1 N}}'.replace("{{", "{").replace("}}", "}")
    run = hb.simulate(hb.loads(TURNING.format(force="=side.y", more=more)), sensitivities=["b"])
    s = np.sqrt(1.8)
    by_s = -3 + 2*s - (3 - s)  # and ds/db = -1/s
    assert run.verdict.findings == () and run.sensitivity("body.x", "b")[-1] == pytest.approx(1 - by_s/s, rel=1e-3)


def test_kinks_of_a_state_do_not_warn():
    for force in ("=-2 N/m*max(body.x - b, 0 m)", "=if_else(body.x > b, -2 N/m*(body.x - b), 0 N)",
                  "=-abs(body.x - b)*1 N/m"):
        run = hb.simulate(hb.loads(TURNING.format(force=force, more="")), sensitivities=["b"])
        assert run.verdict.findings == ()


def test_a_run_with_few_output_points_takes_its_steps_in_several_calls(monkeypatch: pytest.MonkeyPatch) -> None:
    """Oscillations of 10 Hz after a step, without an output point before the end: more steps than one call may take."""
    for module in (simulator, event_integration):
        monkeypatch.setattr(module, "EVENTS", replace(module.EVENTS, steps_between=400, steps_ahead=400))
    run = hb.simulate(hb.loads("""
model: few
components:
  wall: {is: Fixed}
  spring: {is: Spring, c: 4 kN/m}
  mass: {is: Mass, m: 1 kg}
  push: {is: ForceSource, u: =step.y}
  step: {is: Step, t_s: 0.1 s, after: 4 kN}
nodes: {wall: [wall.a, spring.a], load: [spring.b, mass.a, push.a]}
initial: {load.x: 0 m, load.v: 0 m/s}
simulate: {until: 3 s, every: 3 s, solver: cvodes}
"""))
    assert run["load.x"][-1] == pytest.approx(1 - np.cos(np.sqrt(4000.0) * 2.9), abs=1e-4)
