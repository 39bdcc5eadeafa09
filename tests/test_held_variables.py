"""Held variables in linear analysis: each is named with its treatment, and loops with quantisers get no verdict."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from diagrams import SAMPLED_LOOP

import heavebond as hb
from heavebond.cli import main
from heavebond.core.errors import UsageError
from heavebond.language.model import loads
from heavebond.linear.stability import STABLE, UNDECIDED
from heavebond.numerics.dae import assemble
from heavebond.optimise.objective import Objective, tuning_task
from heavebond.optimise.tuning import tune

SAMPLED_POSITION = """
model: sampled_position
components:
  m: {is: Mass, m: 2 kg}
  f: {is: ForceSource, u: 0 N}
  k: {is: ForceSource}
  h: {is: SampleHold, T_s: 40 ms, u: "=-20 N/m*b.x - 9 N*s/m*b.v"}
nodes: {y: [h.y, k.u], b: [f.a, m.a, k.a]}
initial: {b.x: 0.1 m, b.v: 0 m/s}
simulate: {until: 4 s, every: 10 ms}
"""
OSCILLATOR = """
model: oscillator
components:
  g: {is: Fixed}
  s: {is: SpringDamper, c: 200 N/m, d: 4 N*s/m}
  m: {is: Mass, m: 2 kg}
  f: {is: ForceSource, u: 0 N}
  PART
nodes: {g: [g.a, s.a], b: [s.b, f.a, m.a]}
initial: {b.x: 0.1 m, b.v: 0 m/s}
simulate: {until: 4 s, every: 10 ms}
"""
RECORDER = OSCILLATOR.replace("PART", 'h: {is: SampleHold, T_s: 40 ms, u: "=b.x"}')
# a relay that is sampled: its derivative is zero, its effect is not
SAMPLED_RELAY = SAMPLED_POSITION.replace('"=-20 N/m*b.x - 9 N*s/m*b.v"', '"=if_else(b.x + 0.2 s*b.v > 0 m, -5 N, 5 N)"')
# a controller of a user, whose memory is a state that each sample sets to one of two values
MEMORY = """
component: Memory
summary: A sampled force law.
source: A test.
ports: {u: {signal: in, unit: N, doc: input}, y: {signal: out, unit: N, doc: output}}
parameters: {T_s: {unit: s, doc: period}, s: {unit: N, default: 1 N, doc: step}}
variables: {q: {unit: N, doc: memory}}
equations: |
  der(q) = 0
  y = q
when: {sample: {every: T_s, then: {q: "if_else(u > s, s, -s)"}}}
"""
# a sample is taken by the edges of a square wave
TRIGGERED = """
component: Triggered
summary: A sample at each rising edge of the trigger.
source: A test.
ports:
  u: {signal: in, unit: N, doc: input}
  t: {signal: in, unit: 1, doc: trigger}
  y: {signal: out, unit: N, doc: output}
variables: {last: {unit: N, held: 0, doc: last sample}, on: {unit: 1, held: 0, doc: 1 while the trigger is high}}
equations: |
  y = last
when:
  rise: {condition: t > 0.5 and on == 0, then: {on: 1, last: u}}
  fall: {condition: t < 0.5 and on == 1, then: {on: 0}}
"""
RELAY = OSCILLATOR.replace("f: {is: ForceSource, u: 0 N}", "f: {is: ForceSource}").replace(
    "PART", 'r: {is: Relay, u_on: 50 mm, u_off: -50 mm, y_on: -3 N, y_off: 3 N, u: "=b.x"}').replace(
    "nodes: {", "nodes: {r: [r.y, f.u], ")
STUCK = OSCILLATOR.replace("PART", "d: {is: DryFriction, F_c: 30 N, F_s: 40 N}").replace(
    "g: [g.a, s.a]", "g: [g.a, s.a, d.a]").replace("b: [s.b,", "b: [s.b, d.b,")
SWITCHED = """
model: switched
components:
  p: {is: TransferFunction, b: [0, 1], a: [1, 1]}
  s: {is: Switch, level: 0, u: 1, u_1: "=-3*p.y", u_2: "=5*p.y"}
nodes: {y: [s.y, p.u]}
simulate: {until: 2 s}
"""


def _file(text: str, tmp_path: Path, **components: str) -> Path:
    folder = tmp_path / "components"
    folder.mkdir(exist_ok=True)
    for name, part in components.items():
        (folder / f"{name}.yaml").write_text(part, encoding="utf-8")
    file = tmp_path / "machine.yaml"
    file.write_text(text.strip() + "\n", encoding="utf-8")
    return file


def _command(words: list[str], tmp_path: Path) -> tuple[int, dict]:
    told = tmp_path / "told.json"
    with pytest.raises(SystemExit) as ended:
        main([*words, "--json", str(told)])
    return int(ended.value.code or 0), json.loads(told.read_text(encoding="utf-8"))


def _memory(text: str) -> str:
    return text.replace("{is: SampleHold,", "{is: Memory,")


def test_a_loop_through_a_sampled_relay_is_refused_by_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """The loop was said not to exist, and the machine marginally stable."""
    file = _file(SAMPLED_LOOP.replace("h: {is: SampleHold,", 'h: {is: SampleHold, u: "=if_else(e.y > 0.1, 1, -1)",').replace(
        "e: [e.y, h.u]", "e: [e.y]"), tmp_path)
    code, _ = _command(["linear", str(file), "--loop", "y"], tmp_path)
    said = capsys.readouterr()
    assert code != 0 and "loop-held" in said.err
    assert "h.last" in said.err and "SampleHold" in said.err and "machine.yaml:4" in said.err
    assert "marginally stable" not in said.out


@pytest.mark.parametrize("law", ["if_else(u > s, s, -s)", "s*sign(u)"])
def test_a_state_that_a_sampled_relay_sets_is_no_constant(law: str, tmp_path: Path):
    """Four random motions on one side of its threshold made it one."""
    file = _file(_memory(SAMPLED_POSITION), tmp_path, memory=MEMORY.replace("if_else(u > s, s, -s)", law))
    assert hb.state_space(hb.load(file), ["b.f"], ["b.x"]).stability().verdict == UNDECIDED


@pytest.mark.parametrize(("text", "parts", "name", "kind"), [
    (SAMPLED_RELAY, {}, "h.last", "SampleHold"),
    (_memory(SAMPLED_POSITION), {"memory": MEMORY}, "h.q", "Memory"),
    (SAMPLED_POSITION.replace("SampleHold, T_s: 40 ms,", "Triggered,").replace(
        "  m: {is", "  w: {is: SquareWave, T: 40 ms, high: 1, low: 0}\n  m: {is").replace(
            "nodes: {", "nodes: {w: [w.y, h.t], "),
     {"triggered": TRIGGERED}, "h.last", "Triggered"),
])
def test_modes_of_a_loop_without_linear_samples_give_no_verdict_and_name_the_block(
        text: str, parts: dict[str, str], name: str, kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """m x'' = u(t_k) was reported as a free body, marginally stable."""
    file = _file(text, tmp_path, **parts)
    code, told = _command(["modes", str(file)], tmp_path)
    said = capsys.readouterr().out
    assert code == 0 and told["stability"] is None
    assert "stable at its start" not in said.replace("stability not decided", "") and "not decided" in said
    held = {one["variable"]: one for one in told["held"]}
    assert held[name]["component"] == kind and held[name]["part"] == "h" and held[name]["in_loop"] is True
    line = next(k for k, row in enumerate(file.read_text(encoding="utf-8").splitlines(), 1) if row.lstrip().startswith("h:"))
    assert held[name]["line"] == line and Path(held[name]["file"]).name == "machine.yaml"
    assert held[name]["treatment"].startswith("held constant") and name in said and f"machine.yaml:{line}" in said


def test_a_recorder_outside_of_the_loop_does_not_take_the_verdict(tmp_path: Path):
    """A sample and hold that reads the position, and that nothing reads."""
    file = _file(RECORDER, tmp_path)
    _, told = _command(["modes", str(file)], tmp_path)
    assert told["stability"] == STABLE and [(h["variable"], h["in_loop"]) for h in told["held"]] == [("h.last", False)]
    system = hb.state_space(hb.load(file), ["b.f"], ["b.x", "h.y"])
    assert system.stable and system.dc_gain()[0, 0] == pytest.approx(1 / 200, rel=1e-9)
    assert system.held == () and system.period == pytest.approx(0.04)  # between input and output: its samples are in it
    assert system.dc_gain()[1, 0] == pytest.approx(1 / 200, rel=1e-9)
    alone = hb.state_space(hb.load(file), ["b.f"], ["b.x"])
    assert alone.period is None and [h.name for h in alone.held] == ["h.last"] and not alone.held[0].between


def test_a_sampled_command_outside_of_the_loop_does_not_take_the_verdict(tmp_path: Path):
    """A force that follows a signal of time by samples."""
    text = OSCILLATOR.replace("f: {is: ForceSource, u: 0 N}", "f: {is: ForceSource}").replace(
        "PART", 'h: {is: SampleHold, T_s: 40 ms, u: "=3 N*sin(time/1 s)"}').replace("nodes: {", "nodes: {h: [h.y, f.u], ")
    system = hb.state_space(hb.load(_file(text, tmp_path)), ["b.f"], ["b.x"])
    assert system.stable and [(h.name, h.in_loop) for h in system.held] == [("h.last", False)]


def test_a_law_that_a_clock_switches_takes_the_verdict(tmp_path: Path):
    """Periodic changes of a stiffness: every frozen machine is stable, and the motion grows (Meissner's equation)."""
    text = OSCILLATOR.replace("f: {is: ForceSource, u: 0 N}", 'f: {is: ForceSource, u: "=-150 N/m*w.y*b.x"}').replace(
        "d: 4 N*s/m", "d: 0.1 N*s/m").replace("PART", "w: {is: SquareWave, T: 280 ms, high: 1, low: -1}")
    file = _file(text, tmp_path)
    run = hb.simulate(hb.load(file))["b.x"]
    assert np.abs(run[-50:]).max() > 2 * np.abs(run[:50]).max()
    system = hb.state_space(hb.load(file), ["b.f"], ["b.x"])
    assert system.stability().verdict == UNDECIDED and not system.stability().growing
    assert "w.on" in system.stability().reasons[0]


def test_state_spaces_and_their_exports_name_held_variables(tmp_path: Path):
    file = _file(SAMPLED_RELAY, tmp_path)
    system = hb.state_space(hb.load(file), ["b.f"], ["b.x"])
    assert system.stability().verdict == UNDECIDED and not system.stable
    held, = system.held
    assert (held.name, held.part, held.component, held.place.line, held.sampled, held.in_loop) == \
        ("h.last", "h", "SampleHold", 6, True, True)
    # the first sample is taken at 0 s, at 0.1 m
    assert held.value == pytest.approx(-5.0)
    assert system.to_control().held == (held.text,)
    saved = tmp_path / "matrices.npz"
    code, told = _command(["linear", str(file), "--from", "b.f", "--to", "b.x", "--save", str(saved)], tmp_path)
    assert code == 0 and told["stability"] is None and told["stable"] is None
    assert [one["variable"] for one in told["held"]] == ["h.last"]
    assert list(np.load(saved)["held"]) == [held.text]


def test_figures_name_held_variables(tmp_path: Path):
    from heavebond.pictures.plot_linear import plot_bode

    system = hb.state_space(hb.load(_file(SAMPLED_RELAY, tmp_path)), ["b.f"], ["b.x"])
    figure = plot_bode([system], np.array([0.1, 1.0]), title="a title")
    assert any("held constant" in text.get_text() and "h.last" in text.get_text() for text in figure.texts)


def test_a_root_locus_of_a_loop_with_a_sampled_relay_has_no_stability_boundary(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    file = _file(SAMPLED_RELAY.replace("components:", "parameters: {K: 1 N*s/m}\ncomponents:").replace(
        "u: 0 N}", 'u: "=-K*b.v"}'), tmp_path)
    code, told = _command(["linear", str(file), "--over", "K=-1 .. 1 N*s/m"], tmp_path)
    assert code == 0 and told["limits"] == [] and set(told["stability"]) == {None}
    assert [one["variable"] for one in told["held"]] == ["h.last"] and "h.last" in capsys.readouterr().out


def test_margins_name_a_relay_that_is_held_and_keep_those_of_the_loop_around_it(tmp_path: Path):
    """A relay away from its thresholds does nothing to small motions; the verdict holds for these, and says so."""
    file = _file(RELAY, tmp_path)
    code, told = _command(["modes", str(file)], tmp_path)
    held, = told["held"]
    assert code == 0 and told["stability"] == STABLE
    assert (held["variable"], held["in_loop"], held["value"]) == ("r.on", True, 1.0)  # 0.1 m is above its threshold
    with pytest.raises(UsageError, match=r"r\.on"):
        hb.loop_margins(hb.load(file), "r.y")


def test_a_relay_at_its_threshold_takes_the_verdict(tmp_path: Path):
    """The smallest motion switches it: the linear system holds for no motion."""
    text = RELAY.replace("u_on: 50 mm, u_off: -50 mm", "u_on: 100 mm, u_off: 0 mm").replace("0.1 m,", "100 mm,")
    _, told = _command(["modes", str(_file(text, tmp_path))], tmp_path)
    assert told["stability"] is None and told["held"][0]["variable"] == "r.on"


def test_a_friction_that_sticks_is_named_with_its_state(tmp_path: Path):
    """20 N of the spring, 40 N of stiction: no state is free."""
    _, told = _command(["modes", str(_file(STUCK, tmp_path))], tmp_path)
    held = {one["variable"]: one for one in told["held"]}
    assert held["d.mode"]["value"] == 0 and held["d.mode"]["component"] == "DryFriction"
    assert "held constant" in held["d.mode"]["treatment"]


def test_what_happens_at_the_start_is_done_before_the_machine_is_linearised(tmp_path: Path):
    """The switch selects -3 y from 0 s on: y' = -4 y; linearised was 5 y, which holds in no moment of a run."""
    file = _file(SWITCHED, tmp_path)
    _, told = _command(["modes", str(file)], tmp_path)
    assert [mode["real"] for mode in told["modes"]] == [pytest.approx(-4.0)]
    assert told["held"][0]["value"] == 1.0 and told["stability"] == STABLE


def test_tuning_refuses_a_stability_limit_with_a_sampled_relay_and_otherwise_says_that_it_is_not_decided(tmp_path: Path):
    file = _file(SAMPLED_RELAY, tmp_path)
    free = {"h.T_s": "30 .. 50 ms"}
    with pytest.raises(UsageError, match=r"h\.last.*SampleHold"):
        Objective(assemble(hb.load(file)), tuning_task(free, "rms(b.x)/1 m", stable=True))
    found = tune(hb.load(file), tuning_task(free, "rms(b.x)/1 m", end="1 s"), explore=0, most_steps=1)
    assert found.stability.stable is None and "h.last" in found.stability.undecided[0]
    assert "stable" not in found.limits
    with pytest.raises(UsageError, match=r"h\.last"):
        Objective(assemble(hb.load(file)), tuning_task(free, "rms(b.x)/1 m", limits=["damping(least) > 0.1"]))


def test_the_command_tune_says_that_the_stability_of_a_loop_with_a_sampled_relay_is_not_decided(tmp_path: Path,
                                                                                   capsys: pytest.CaptureFixture[str]):
    file = _file(SAMPLED_RELAY, tmp_path)
    words = ["tune", str(file), "--free", "h.T_s=30 .. 50 ms", "--cost", "rms(b.x)/1 m", "--evaluate", "0 .. 1 s",
             "--explore", "0", "--no-robustness"]
    code, told = _command(words, tmp_path)
    assert code == 0 and told["stability"]["stable"] is None
    said = capsys.readouterr().out
    assert "stability not decided" in said and "h.last" in said
    code, _ = _command([*words, "--stable"], tmp_path)
    assert code != 0 and "h.last" in capsys.readouterr().err


def least_gain(block: str) -> float:
    """The gain margin of an integrator of 1/s behind a sampled block with 2, sampled every 0.1 s."""
    margin = hb.loop_margins(loads(f"""
model: loop
components:
  s: {{is: Sum, k_1: 1, k_2: -1, u_1: 1}}
  q: {{is: {block}, T_s: 0.1 s, t_0: 30 ms}}
  g: {{is: Gain, k: 2}}
  i: {{is: Integrator, k: 1 1/s}}
nodes: {{a: [s.y, q.u], b: [q.y, g.u], c: [g.y, i.u], y: [i.y, s.u_2]}}
initial: {{i.y: 0}}
simulate: {{until: 20 s}}
"""), "s.y").least_gain
    assert margin is not None
    return margin.value


@pytest.mark.parametrize(("block", "limit"), [("UnitDelay", 1.0), ("FirstOrderHold", 1.0), ("MovingAverage, n: 3", 1.5)])
def test_margins_are_those_after_the_first_samples(block: str, limit: float) -> None:
    """A = K T_s at the limit of stability: 1 for z**2 - z + A and for z**2 - (1 - 1.5 A) z - 0.5 A, 1.5 for
    z**3 - z**2 + A/3 (z**2 + z + 1). A hold of first order has no slope and an average no past in its first sample, and
    the slope acts between samples alone."""
    assert least_gain(block) == pytest.approx(limit / 0.2, rel=1e-6)


def test_a_share_that_changes_between_samples_is_not_taken_as_constant(tmp_path: Path) -> None:
    """y = last + slope*(time - t_k): frozen at the instant of a sample, the slope would not act."""
    (tmp_path / "line.yaml").write_text("""
component: LineThroughSamples
summary: Straight line through two samples.
ports: {u: {signal: in, unit: 1}, y: {signal: out, unit: 1}}
parameters: {T_s: {unit: s, min: 1e-9 s, doc: period}}
variables:
  last: {unit: 1, held: 0, doc: last sample}
  slope: {unit: 1/s, held: 0, doc: slope}
  t_k: {unit: s, held: 0 s, doc: time of the last sample}
equations: |
  y = last + slope*(time - t_k)   # line
when:
  sample: {every: T_s, then: {last: u, slope: (u - last)/T_s, t_k: time}}
""", encoding="utf-8")
    (tmp_path / "loop.yaml").write_text("""
model: loop
components:
  q: {is: LineThroughSamples, T_s: 0.1 s, u: =1 - i.y}
  i: {is: Integrator, k: 2 1/s}
nodes: {b: [q.y, i.u]}
initial: {i.y: 0}
simulate: {until: 2 s}
""", encoding="utf-8")
    assert "not decided" in str(hb.modes(tmp_path / "loop.yaml"))


def test_a_locked_clutch_makes_one_body_of_two() -> None:
    found = hb.modes(loads("""
model: locked
components:
  a: {is: Inertia, J: 2 kg*m**2}
  b: {is: Inertia, J: 3 kg*m**2}
  c: {is: LockingClutch, M_max: 500 N*m, u: 1}
  s: {is: TorsionSpring, c: 500 N*m/rad}
  w: {is: FixedShaft}
nodes: {x: [a.a, c.a], y: [b.a, c.b, s.a], w: [s.b, w.a]}
initial: {x.phi: 0.001 rad, x.w: 0 rad/s, y.w: 0 rad/s, y.phi: 0.001 rad}
simulate: {until: 2 s}
""")).as_dict()
    assert any(mode["frequency"] == pytest.approx(10 / (2 * np.pi), rel=1e-6) for mode in found["modes"])
    assert {h["variable"] for h in found["held"]} >= {"c.mode"}
