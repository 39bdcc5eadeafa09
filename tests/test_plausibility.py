"""Effects that are no candidates where they make no sense, effects that never act, and values that are unusual."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import heavebond as hb
from heavebond.core.units import DIMENSIONLESS
from heavebond.diagnosis.answer.sentences import unusual_values
from heavebond.diagnosis.candidates.catalogue import EffectNumber
from heavebond.diagnosis.candidates.places import candidates
from heavebond.diagnosis.evidence.probability import CALIBRATION, evidence
from heavebond.diagnosis.search.step import ACTS_ALWAYS, ENDS_NO_MOTION, make_stage
from heavebond.estimation.experiment import FARTHEST, Experiment, load_experiment
from heavebond.numerics.dae import assemble

ROTOR = """
model: rotor
components:
  drive: {is: TorqueSource, u: 0 N*m}
  rotor: {is: Inertia, J: 2 kg*m**2}
nodes: {shaft: [drive.a, rotor.a]}
initial: {shaft.phi: 0 rad, shaft.w: 10 rad/s}
"""


def experiment(folder: Path, model: str, columns: dict[str, np.ndarray], inputs: str, outputs: str) -> Experiment:
    (folder / "machine.yaml").write_text(model)
    rows = [",".join(columns), *(",".join(f"{v:.9g}" for v in row) for row in zip(*columns.values(), strict=True))]
    (folder / "monday.csv").write_text("\n".join(rows) + "\n")
    (folder / "measured.yaml").write_text(f"""
experiment: measured
model: machine.yaml
records: {{monday: {{file: monday.csv, use: fit}}}}
time: {{column: t, unit: s}}
inputs: {{{inputs}}}
outputs: {{{outputs}}}
""")
    return load_experiment(folder / "measured.yaml")


def test_an_end_stop_is_no_candidate_for_a_shaft_that_turns_one_way(tmp_path: Path) -> None:
    """A rotor with a bearing that damps 0.1 N*m*s/rad: w = 10 exp(-t/20)."""
    t = np.arange(0, 20, 0.05)
    noise = np.random.default_rng(2).normal(0, 0.01, len(t))
    made = experiment(tmp_path, ROTOR, {"t": t, "w": 10*np.exp(-t/20) + noise, "tau": 0*t},
                      "drive.u: {column: tau, unit: N*m, interpolation: linear}",
                      "shaft.w: {column: w, unit: rad/s, noise: 0.01 rad/s}")
    stage = make_stage(made, number=1, classes=("end stop", "viscous damping"))
    assert stage.chosen is not None and stage.chosen.candidate.component == "RotationalDamper"
    reasons = dict(stage.excluded)
    stops = [label for label in reasons if label.startswith("RotationalEndStop")]
    assert stops and all(reasons[label] == "the motion there goes in one direction only" for label in stops)
    assert not any(s.candidate.component == "RotationalEndStop" for s in stage.scores)


def test_an_end_stop_that_always_holds_is_a_spring(tmp_path: Path) -> None:
    """A spring has 7.5 N*m/rad in the diagram and 8 N*m/rad in the machine, with damping: w = 10 exp(-t/20) cos(2 t). Stops
    at both sides of a narrow gap act as the rest. A stop of 800 N*m/rad that throws a free rotor back is kept, although the
    diagram without it turns one way."""
    spring = ROTOR.replace("nodes:", "  spring: {is: TorsionSpring, c: 7.5 N*m/rad}\n  frame: {is: FixedShaft}\nnodes:")
    spring = spring.replace("rotor.a]}", "rotor.a, spring.b], ground: [frame.a, spring.a]}")
    t = np.arange(0, 6, 0.02)
    noise = np.random.default_rng(2).normal(0, 0.01, len(t))
    bounce = np.where(t < 0.3, 10.0, np.where(t < 0.3 + np.pi/20, 10*np.cos(20*(t - 0.3)), -10.0))
    for name, model, w, end, kept in (("spring", spring, 10*np.exp(-t/20)*np.cos(2*t), 6.0, False),
                                      ("stop", ROTOR, bounce, 1.0, True)):
        (folder := tmp_path / name).mkdir()
        made = experiment(folder, model, {"t": t[t < end], "w": (w + noise)[t < end], "tau": 0*t[t < end]},
                          "drive.u: {column: tau, unit: N*m, interpolation: linear}",
                          "shaft.w: {column: w, unit: rad/s, noise: 0.01 rad/s}")
        stage = make_stage(made, number=1, classes=("end stop",))
        assert (stage.chosen is not None) == kept and (ENDS_NO_MOTION in stage.excluded.values()) != kept


def test_a_saturation_that_always_acts_is_another_input(tmp_path: Path) -> None:
    """The torque of a rotor is 0.3 N*m, whatever the record of its drive is: limits of 0.3 N*m would explain it. A torque
    that is cut off at half of its amplitude is at a limit for two thirds of the time."""
    t = np.arange(0, 10, 0.05)
    u = np.sin(2*np.pi*t/2)
    for name, torque, kept in (("constant", 0.3 + 0*t, False), ("cut", np.clip(u, -0.5, 0.5), True)):
        (folder := tmp_path / name).mkdir()
        w = 10 + np.concatenate([[0.0], np.cumsum((torque[1:] + torque[:-1]) / 2) * 0.05]) / 2
        made = experiment(folder, ROTOR, {"t": t, "w": w + np.random.default_rng(2).normal(0, 0.01, len(t)), "tau": u},
                          "drive.u: {column: tau, unit: N*m, interpolation: linear}",
                          "shaft.w: {column: w, unit: rad/s, noise: 0.01 rad/s}")
        stage = make_stage(made, number=1, classes=("saturation",))
        chosen = stage.chosen.candidate.label if stage.chosen is not None else ""
        assert (chosen == "Saturation before drive.u") == kept
        assert (stage.excluded.get("Saturation before drive.u") == ACTS_ALWAYS) != kept


def test_a_law_that_makes_a_wrong_model_stand_still_explains_nothing(tmp_path: Path) -> None:
    """The speed of a rotor does not follow its torque. A sensor that sees nothing reduces chi-square to that of a mean."""
    t = np.arange(0, 10, 0.05)
    w = 10 + np.sin(2*np.pi*t/0.7) + np.random.default_rng(2).normal(0, 0.01, len(t))
    made = experiment(tmp_path, ROTOR, {"t": t, "w": w, "tau": 10*np.sin(2*np.pi*t/2)},
                      "drive.u: {column: tau, unit: N*m, interpolation: linear}",
                      "shaft.w: {column: w, unit: rad/s, noise: 0.01 rad/s}")
    stage = make_stage(made, number=1, classes=("sensor gain",))
    assert stage.trials[0].chi2_fit < 0.5 * stage.chi2_fit and stage.still == pytest.approx(0.5 / 0.01**2, rel=0.05)
    assert evidence([stage]).unexplained(CALIBRATION.temperature) == 1


def test_a_bent_characteristic_is_no_candidate_for_a_temperature_far_from_absolute_zero(tmp_path: Path) -> None:
    """There it is a gain and an offset; on a heating power that begins at zero it is a bend."""
    t = np.arange(0, 86400, 1800.0)
    made = experiment(tmp_path, """
model: room
components:
  weather: {is: TemperatureSource, u: 290 K}
  walls: {is: ThermalResistance, R: 10 mK/W}
  heater: {is: HeatSource, u: 0 W}
  room: {is: HeatCapacity, m: 1000 kg, c: 1000 J/(kg*K)}
nodes: {outside: [weather.a, walls.a], room: [walls.b, room.a, heater.a]}
initial: {room.T: 290 K}
""", {"t": t, "To": 15 + 5*np.sin(2*np.pi*t/86400), "Q": 1000*(t > 2e4), "T": 17 + 5*np.sin(2*np.pi*t/86400 + 0.3)},
        "weather.u: {column: To, unit: degC, interpolation: linear}, heater.u: {column: Q, unit: W, interpolation: linear}",
        "room.T: {column: T, unit: degC, noise: 0.1 degC}")
    stage = make_stage(made, number=1, classes=("nonlinear characteristic",))
    reasons = dict(stage.excluded)
    assert reasons["CurvedGain before weather.u"] == reasons["CurvedGain in the channel room.T"] == \
        "the signal stays far from zero, where this law is a gain and an offset"
    assert stage.scores[0].candidate.label == "CurvedGain before heater.u"


def test_an_overflow_is_a_candidate_at_open_tanks_only(tmp_path: Path) -> None:
    excluded: dict[str, str] = {}
    tanks = {c.where for c in candidates("cascaded_tanks/tanks", excluded) if c.component == "Overflow"}
    assert ("upper_bottom", "cascade") in tanks
    excluded = {}
    assert not [c for c in candidates("cylinder_rig/leakage", excluded) if c.component == "Overflow"]
    assert any(label.startswith("Overflow") and reason == "no OpenTank is connected there" for label, reason in
               excluded.items())


def test_a_relief_valve_is_no_candidate_at_an_open_tank() -> None:
    """There it would be an overflow: the same law of the pressure at the bottom."""
    excluded: dict[str, str] = {}
    found = {c.where for c in candidates("cascaded_tanks/tanks", excluded) if c.component == "ReliefValve"}
    assert not any("upper_bottom" in where[:1] for where in found)
    reason = next(reason for label, reason in excluded.items() if label.startswith("ReliefValve between upper_bottom"))
    assert reason == "OpenTank is connected there"
    assert [c for c in candidates("cylinder_rig/leakage", {}) if c.component == "ReliefValve"]


def test_nothing_is_put_before_a_port_that_carries_nothing(tmp_path: Path) -> None:
    model = ROTOR.replace("rotor.a]}", "rotor.a, sensor.a], read: [sensor.y]}")
    t = np.arange(0, 1, 0.1)
    made = experiment(tmp_path, model.replace("components:", "components:\n  sensor: {is: AngleSensor}"), {"t": t, "w": t},
                      "", "shaft.w: {column: w, unit: rad/s, noise: 0.01 rad/s}")
    excluded: dict[str, str] = {}
    series = [c.label for c in candidates(made, excluded) if c.attaches == "in series"]
    assert any(label.endswith("rotor.a") for label in series) and not [s for s in series if s.endswith("sensor.a")]
    assert excluded["ShaftCompliance before sensor.a"] == "nothing flows through that port"


@pytest.mark.parametrize(("gap", "acts"), [("0.5 mm", True), ("200 mm", False)])
def test_a_law_knows_whether_it_acts(gap: str, acts: bool) -> None:
    """A play that is wider than the motion of 20 mm never closes."""
    found = hb.simulate(hb.loads(f"""
model: trial
components:
  wall: {{is: Fixed}}
  hand: {{is: PositionSource, u: "=20 mm*sin(2*pi*time/1 s)"}}
  law: {{is: SpringWithPlay, c: 1 kN/m, gap: {gap}}}
nodes: {{wall: [wall.a, law.a], hand: [hand.a, law.b]}}
simulate: {{until: 1 s, every: 10 ms}}
"""))
    component = found.assembly.flat.expanded.leaves["law"].component
    effect = component.effect
    assert effect is not None and effect.acts is not None
    assert bool((found[component.in_diagram(effect.acts, "law")] > 0).any()) is acts


def gearbox(folder: Path) -> Experiment:
    """A gearbox that loses 25 % of its torque."""
    t = np.arange(0, 10, 0.05)
    noise = np.random.default_rng(3).normal(0, 0.01, len(t))
    model = """
model: geared
components:
  drive: {is: TorqueSource, u: 1 N*m}
  gear:  {is: Gear, i: 2}
  rotor: {is: Inertia, J: 2 kg*m**2}
nodes: {shaft: [drive.a, gear.a], wheel: [gear.b, rotor.a]}
initial: {wheel.phi: 0 rad, wheel.w: 0 rad/s}
"""
    return experiment(folder, model, {"t": t, "w": 0.75*2/2*t + noise, "tau": 1 + 0*t},
                      "drive.u: {column: tau, unit: N*m, interpolation: linear}",
                      "wheel.w: {column: w, unit: rad/s, noise: 0.01 rad/s}")


def test_an_unusual_value_gets_a_remark(tmp_path: Path) -> None:
    found = hb.attempt(gearbox(tmp_path), "gear.eta")
    assert found.finding.parameters[0].value == pytest.approx(0.75, abs=0.01)
    remark, = unusual_values([found.finding])
    assert remark.startswith("gear.eta = 0.75 is unusual: 0.8 to 0.995 is typical (G. Niemann")


def test_typical_values_are_a_weak_prior_of_a_refit(tmp_path: Path) -> None:
    """The typical efficiency of 0.8 to 0.995 allows a loss of 0.2 within one standard deviation."""
    stage = make_stage(gearbox(tmp_path), number=1, classes=("dry friction",))
    trial = next(t for t in stage.trials if t.candidate.name == "gear.eta")
    value = trial.values["gear.eta"]
    assert value == pytest.approx(0.75, abs=0.01)
    assert trial.cost - trial.chi2_fit * trial.samples == pytest.approx(((1 - value) / 0.2)**2, rel=1e-6)


def test_the_ends_of_a_typical_range_above_zero_are_one_standard_deviation_from_its_middle() -> None:
    model = hb.loads(ROTOR.replace("rotor.a]", "rotor.a, law.a], earth: [law.b, frame.a]").replace(
        "components:", "components:\n  law: {is: RotationalLuGreFriction, M_c: 1 N*m}\n"
                       "  frame: {is: FixedShaft}"))
    leaves = assemble(model).flat.expanded.leaves
    number = EffectNumber("law.r", DIMENSIONLESS, None, None, None, False)
    prior = number.prior(leaves)
    assert prior is not None and [prior.at(v)[0] for v in (1.0, 2.5)] == pytest.approx([-1, 1])
    assert prior.at(1.5)[1] == pytest.approx((prior.at(1.5 + 1e-6)[0] - prior.at(1.5 - 1e-6)[0]) / 2e-6, rel=1e-6)
    assert prior.at(0.0) == (-FARTHEST, 0.0)
    assert EffectNumber("law.M_c", DIMENSIONLESS, 0.0, None, None, True).prior(leaves) is None


DRIVE = """
component: Drive
summary: A cart that is driven by one force as it is commanded, and by one with a lag.
ports:
  a: translational
  u: {signal: in, unit: N, doc: commanded force}
components:
  lag:    {is: FirstOrderLag, T_1: 500 ms}
  first:  {is: ForceSource}
  second: {is: ForceSource}
nodes:
  cart: [a, first.a, second.a]
  command: [u, lag.u, first.u]
  late: [lag.y, second.u]
"""
CART = """
model: cart
components:
  DRIVE
  cart:   {is: Mass, m: 2 kg}
  damper: {is: Damper, d: 3 N*s/m}
  wall:   {is: Fixed}
nodes: {cart: [NODES, cart.a, damper.b], wall: [wall.a, damper.a]MORE}
initial: {cart.x: 0 m, cart.v: 0 m/s}
"""


def test_effects_are_tried_before_signal_inputs_inside_blocks(tmp_path: Path) -> None:
    """An offset of 0.4 N behind the lag inside a block."""
    truth = CART.replace("DRIVE", """lag: {is: FirstOrderLag, T_1: 500 ms, u: "=5 N*sin(2*pi*time/3 s)"}
  first:  {is: ForceSource, u: "=5 N*sin(2*pi*time/3 s)"}
  second: {is: ForceSource, u: "=lag.y + 0.4 N"}""").replace("NODES", "first.a, second.a").replace("MORE", "")
    t = np.arange(0, 12, 0.05)
    found = hb.simulate(hb.loads(truth), until=12, every=0.05)
    noise = np.random.default_rng(3).normal(0, 0.01, len(t))
    (tmp_path / "components").mkdir()
    (tmp_path / "components" / "drive.yaml").write_text(DRIVE)
    model = CART.replace("DRIVE", "drive: {is: Drive}\n  demand: {is: Gain, k: 1}").replace("NODES", "drive.a")
    made = experiment(tmp_path, model.replace("MORE", ", demand: [demand.y, drive.u]"),
                      {"t": t, "F": 5*np.sin(2*np.pi*t/3), "v": found["cart.v"][:len(t)] + noise},
                      "demand.u: {column: F, unit: N, interpolation: spline}",
                      "cart.v: {column: v, unit: m/s, noise: 0.01 m/s}")
    before = {c.signal for c in candidates(made) if c.attaches == "input"}
    assert before == {"demand.u", "drive.u", "drive.lag.u", "drive.first.u", "drive.second.u"}
    offset = hb.attempt(made, "SensorOffset", ["drive.second.u"]).finding
    assert offset.parameters[0].value == pytest.approx(0.4, abs=0.03)
    assert offset.rung.chi2_fit < 1.2

