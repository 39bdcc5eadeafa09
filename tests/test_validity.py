"""The verdict of a run on itself: values out of range or beyond all bounds, or no numbers, and laws that make energy."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path

import click.testing
import numpy as np
import pytest
from click.testing import CliRunner
from diagrams import SUCKING

import heavebond as hb
from heavebond.cli import main
from heavebond.core.errors import RunWarning, SimulationError, UsageError
from heavebond.language.model import Model
from heavebond.numerics.run_verdict import Verdict, listening
from heavebond.numerics.simulator import Simulator

# the same oil compressed from 19990 to 20490 bar, which no machine does
PUMPED = SUCKING.replace("-2 L/min", "2 L/min").replace("10 bar", "19990 bar")
# a stop of 5 N/m in place of 5 MN/m, and the oil is drawn from a chamber that is shut
CROWN = """
model: crown
components:
  derrick: {is: Fixed}
  stop:    {is: EndStop, c: 5 N/m, d: 50 N*s/m, x_min: -1 m, x_max: 1 m}
  crown:   {is: Mass, m: 2 t}
  thrust:  {is: ForceSource, u: 1.5 MN}
  oil:     {is: Volume, V: 2 L, beta: 1.5 GPa}
  leak:    {is: FlowSource, u: -100 L/min}
nodes:
  derrick: [derrick.a, stop.a]
  crown:   [stop.b, crown.a, thrust.a]
  chamber: [oil.a, leak.a]
initial: {crown.x: 0 m, crown.v: 0 m/s, chamber.p: 35 bar}
show: {crown: {is: crown.x, unit: m}, chamber: {is: chamber.p, unit: bar}}
simulate: {until: 60 s, every: 10 ms}
"""
# the drive pushes with the speed instead of against it: exp(9 s**-1*time)
WINCH = """
model: winch
components:
  load:   {is: Mass, m: 2 t}
  weight: {is: Weight, m: =load.m}
  drive:  {is: ForceSource, u: =18 kN*s/m*load.v}
nodes: {load: [load.a, weight.a, drive.a]}
initial: {load.x: 0 m, load.v: 0 m/s}
show: {load: {is: load.x, unit: m}}
simulate: {until: 10 s, every: 10 ms}
"""
WEIR = """
component: Weir
summary: Flow over a weir.
ports: {h: {signal: in, unit: m}}
parameters: {k: {unit: m**3/s, doc: flow at 1 m}, h_0: {unit: m, default: 1 m, doc: 1 m}}
variables: {q: {unit: m**3/s, doc: flow}}
equations: |
  q = k*(h/h_0)**1.5   # over a sharp crest
"""
OVERFLOWING = """
model: overflowing
components: {weir: {is: Weir, k: 1 m**3/s, h: "=1 m*cos(1 s**-1*time)"}}
nodes: {}
show: {flow: {is: weir.q, unit: L/min}}
simulate: {until: 4 s, every: 10 ms}
"""
TURNED = """
component: TurnedSpring
summary: A spring whose forces have the wrong signs.
ports: {a: translational, b: translational}
parameters: {c: {unit: N/m, min: 0, doc: stiffness}}
variables: {s: {unit: m, doc: elongation}, F: {unit: N, doc: tension}}
equations: |
  s = b.x - a.x   # elongation
  F = c*s         # law of Hooke
  b.f = -F        # pushes instead of pulling
  a.f = F         # and here
stores: 0.5*c*s**2
"""
SPRUNG = """
model: sprung
components:
  wall:   {is: Fixed}
  spring: {is: TurnedSpring, c: 100 N/m}
  load:   {is: Mass, m: 1 kg}
nodes: {wall: [wall.a, spring.a], load: [spring.b, load.a]}
initial: {load.v: 0.1 m/s, load.x: 0 m}
show: {load: {is: load.x, unit: mm}}
simulate: {until: 0.3 s}
"""


def run(text: str | Model) -> Verdict:
    """The verdict on a run; nothing is warned of."""
    with listening():
        return hb.simulate(hb.loads(text) if isinstance(text, str) else text).verdict


def command(folder: Path, text: str, *words: str, parts: Mapping[str, str] | None = None, name: str = "run"
            ) -> tuple[click.testing.Result, dict[str, object]]:
    """A command on a diagram, and its JSON file."""
    for part, law in (parts or {}).items():
        (folder / f"{part}.yaml").write_text(law, encoding="utf-8")
    (folder / "machine.yaml").write_text(text, encoding="utf-8")
    said = CliRunner().invoke(main, [name, str(folder / "machine.yaml"), *words, "--json", str(folder / "told.json")])
    return said, json.loads((folder / "told.json").read_text(encoding="utf-8"))


def findings(told: dict[str, object]) -> Iterator[dict[str, object]]:
    verdict = told["validity"]
    assert isinstance(verdict, dict)
    yield from verdict["findings"]


def test_a_pressure_below_vacuum_is_told_once_with_its_time() -> None:
    """dp/dt = -q beta/V = -250 bar/s: 10 bar last 40 ms, and vacuum is passed 1.013 bar later, after 44.05 ms."""
    verdict = run(SUCKING)
    found, = verdict.findings
    assert (found.kind, found.name, found.part) == ("physical", "oil.p", "oil")
    assert found.time == pytest.approx(11.01325 / 250, abs=1e-6)
    assert -101325 - 220 < found.value < -101325  # the first point that is below by more than the grace, 1e-4 of the largest
    assert found.limit == -101325
    assert verdict.text.startswith("oil.p falls below -1.0132 bar at 0.04405 s: below vacuum")
    assert "Add a Cavitation there" in verdict.text


def test_a_node_that_is_kept_from_it_is_no_matter() -> None:
    kept = SUCKING.replace("nodes: {oil: [pump.a, oil.a]}", "nodes: {oil: [pump.a, oil.a, vapour.a]}").replace(
        "  oil:  {is", "  vapour: {is: Cavitation, C: 1e-7 m**3/(s*Pa)}\n  oil:  {is")
    assert run(kept).status == "clean"


def test_a_gas_that_is_drawn_until_nothing_is_left() -> None:
    text = """
model: drawn
components:
  tank: {is: Receiver, V: 1 L}
  draw: {is: PneumaticFlowSource, u: -1 g/s}
nodes: {tank: [tank.a, draw.a]}
simulate: {until: 2 s, every: 10 ms}
"""
    assert "tank.p" in [f.name for f in run(text).findings]


def test_what_is_outside_its_range_is_one_line_on_standard_error_and_no_failure(tmp_path: Path) -> None:
    for name in ("run", "check", "energy"):
        said, told = command(tmp_path, SUCKING.replace("10 bar", "30000 bar"), name=name)
        assert said.exit_code == 0, said.output
        assert "warning" not in said.stdout
        assert said.stderr.startswith("warning: oil.p reaches") and said.stderr.count("\n") == 1
        verdict = told["validity"]
        assert isinstance(verdict, dict) and (verdict["status"], verdict["exit"]) == ("outside", 0)
        found, = findings(told)
        assert (found["part"], found["name"], found["limit"], found["unit"]) == ("oil", "oil.p", 2e9, "Pa")
        assert {"time", "value", "advice", "message", "run", "failed"} <= set(found)


def test_a_clean_run_says_so_in_json(tmp_path: Path) -> None:
    said, told = command(tmp_path, SUCKING.replace("-2 L/min", "2 L/min"))
    assert (said.exit_code, said.stderr) == (0, "")
    assert told["validity"] == {"status": "clean", "exit": 0, "findings": []}


def test_a_variable_beyond_what_its_component_declares(tmp_path: Path) -> None:
    """A ram without end stops, extended at 1 m/s beyond its stroke of 0.45 m."""
    (tmp_path / "ram.yaml").write_text("""
component: Ram
summary: A ram that is extended at a constant speed.
ports: {}
parameters: {v: {unit: m/s, doc: speed}}
variables: {s: {unit: m, min: 0 m, max: 0.45 m, doc: extension}}
equations: |
  der(s) = v   # extension
""", encoding="utf-8")
    file = tmp_path / "extended.yaml"
    file.write_text("model: extended\ncomponents: {ram: {is: Ram, v: 1 m/s}}\nnodes: {}\n"
                    "simulate: {until: 1 s, every: 0.1 s}\n", encoding="utf-8")
    verdict = run(hb.load(file))
    found, = verdict.findings
    assert (found.name, found.limit) == ("ram.s", 0.45)
    assert (found.value, found.time) == (pytest.approx(1.0), pytest.approx(0.45))
    assert "beyond what ram allows for its s" in verdict.text


def test_a_crown_hundreds_of_kilometres_behind_its_end_stop_does_not_end_as_fine(tmp_path: Path) -> None:
    """430 km is outside of what machines do; the oil that is drawn from the shut chamber is below vacuum at once."""
    said, _ = command(tmp_path, CROWN)
    assert said.exit_code == 1
    assert "chamber.p falls below -1.0132 bar at 0.002881 s [run-physical]" in said.stderr  # 36.013 bar at 12500 bar/s
    said, told = command(tmp_path, CROWN.replace("-100 L/min", "0 L/min"))
    assert said.exit_code == 0
    assert said.stderr.startswith("warning: crown.x (crown.v too) reaches") and said.stderr.count("\n") == 1
    crown = next(f for f in findings(told) if f["name"] == "crown.x")
    assert crown["kind"] == "larger" and crown["value"] == pytest.approx(4.29e5, rel=0.01)
    shut = CROWN.replace("c: 5 N/m, d: 50", "c: 50 MN/m, d: 500").replace("-100 L/min", "0 L/min")
    assert run(shut).status == "clean"


def test_a_winch_that_ran_away_ends_with_exit_code_1(tmp_path: Path) -> None:
    said, told = command(tmp_path, WINCH)
    assert said.exit_code == 1
    assert "[run-runaway]" in said.stderr and "(a million typical sizes) from" in said.stderr
    assert "winch, 0 to 10 s" in said.stdout  # what was computed is shown all the same
    assert told["ok"] is False
    load = next(f for f in findings(told) if f["name"] == "load.x")
    assert load["kind"] == "runaway" and abs(float(str(load["value"]))) > 1e37
    assert run(WINCH.replace("18 kN", "-18 kN")).status == "clean"


def test_a_fractional_power_of_a_negative_number_is_a_failure_with_the_equation_in_it(tmp_path: Path) -> None:
    said, told = command(tmp_path, OVERFLOWING, parts={"weir": WEIR})
    assert said.exit_code == 1
    assert "weir.q is no number from 1.58 s on [run-not-finite]" in said.stderr
    assert "'q = k*(h/h_0)**1.5' of weir" in said.stderr and "weir.yaml:8" in said.stderr
    assert [f["name"] for f in findings(told)] == ["weir.q"]


def test_an_output_whose_formula_has_no_value_is_a_failure(tmp_path: Path) -> None:
    """The power stands in the formula of an output; no variable of the diagram is concerned."""
    text = WINCH.replace("18 kN", "-18 kN").replace("{is: load.x, unit: m}", '{is: "(load.x/(1 m))**1.5", unit: 1}')
    said, _ = command(tmp_path, text)
    assert said.exit_code == 1
    assert "load is no number from" in said.stderr and "the formula of load has no value" in said.stderr


def test_what_python_runs_is_warned_of_and_has_its_verdict() -> None:
    with pytest.warns(RunWarning, match="winch: .*a million typical sizes") as heard:
        result = hb.simulate(hb.loads(WINCH))
    assert heard[0].filename == __file__
    assert result.verdict.failed and str(result.verdict) == result.verdict.text
    with pytest.raises(SimulationError, match="run-runaway"):
        result.verdict.raise_if_failed()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert hb.simulate(hb.loads(SUCKING.replace("-2 L/min", "2 L/min"))).verdict.raise_if_failed().text == "clean"


def test_a_component_that_makes_energy_ends_with_exit_code_1(tmp_path: Path) -> None:
    """F = -c s adds power where the store says that it takes it: twice c s v too much."""
    said, told = command(tmp_path, SPRUNG, parts={"turned_spring": TURNED})
    assert said.exit_code == 1
    assert "the power of spring does not balance" in said.stderr and "[run-energy]" in said.stderr
    found, = (f for f in findings(told) if f["kind"] == "energy")
    assert found["part"] == "spring"
    t = np.linspace(0, 0.3, 1001)[-1]  # x = 0.01 sinh(10 t), and 2 c x v are missing
    assert found["value"] == pytest.approx(-2 * 100 * 0.01 * np.sinh(10 * t) * 0.1 * np.cosh(10 * t), rel=1e-6)
    right = TURNED.replace("b.f = -F ", "b.f = F ").replace("a.f = F ", "a.f = -F ")
    assert command(tmp_path, SPRUNG, parts={"turned_spring": right})[0].exit_code == 0


def test_a_dissipation_below_zero_is_told(tmp_path: Path) -> None:
    law = TURNED.replace("F = c*s         # law of Hooke", "F = -c*s").replace("b.f = -F", "b.f = F").replace(
        "a.f = F", "a.f = -F").replace("stores: 0.5*c*s**2", "dissipates: -c*s*(b.v - a.v)")
    said, told = command(tmp_path, SPRUNG, parts={"turned_spring": law})
    assert said.exit_code == 1
    assert [f["part"] for f in findings(told) if f["kind"] == "energy"] == ["spring"]
    assert "Its `dissipates` is below zero" in said.stderr


def test_what_grows_exponentially_is_told_before_it_has_left_all_ranges() -> None:
    """g/9 exp(9 s**-1*t): 8.8 km/s at 1 s, which no limit forbids."""
    verdict = run(WINCH.replace("until: 10 s", "until: 1 s"))
    assert verdict.status == "outside"
    assert {f.name for f in verdict.findings if f.kind == "growth"} == {"load.x", "load.v"}
    fall = WINCH.replace("18 kN*s/m*load.v", "0 N").replace("until: 10 s", "until: 30 s")  # 4.4 km down: t**2 is no growth
    assert run(fall).status == "clean"


def test_a_shaft_that_turns_for_hours_is_fine() -> None:
    """150 rad/s for three hours are 1.6 million rad, which is no matter."""
    assert run("""
model: turning
components: {wheel: {is: Inertia, J: 1 kg*m**2}}
nodes: {shaft: [wheel.a]}
initial: {shaft.w: 150 rad/s, shaft.phi: 0 rad}
simulate: {until: 3 h}
""").status == "clean"


def test_a_typical_size_of_a_variable_is_used(tmp_path: Path) -> None:
    """A reading in a unit of its own, of 1e9; with `nominal: 10` that is a run that ran away."""
    law = """
component: Counter
summary: Counts.
ports: {}
parameters: {r: {unit: kg/s**3, doc: rate}}
variables: {n: {unit: kg/s**2, NOMINAL doc: reading}}
equations: |
  der(n) = r   # counts
"""
    text = "model: counting\ncomponents: {counter: {is: Counter, r: 1e9 kg/s**3}}\nnodes: {}\nsimulate: {until: 1 s}\n"
    assert command(tmp_path, text, parts={"counter": law.replace("NOMINAL ", "")})[0].exit_code == 0
    said, _ = command(tmp_path, text, parts={"counter": law.replace("NOMINAL ", "nominal: 10 kg/s**2, ")})
    assert (said.exit_code, "counter.n reaches" in said.stderr) == (1, True)
    said, _ = command(tmp_path, text, parts={"counter": law.replace("NOMINAL ", "nominal: -10 kg/s**2, ")})
    assert said.exit_code == 1 and "[nominal-not-positive]" in said.stderr


def test_energy_of_a_run_that_ran_away_is_refused_before_it_is_integrated(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its squares overflow in the integrals, which took minutes and ended in words about something else."""
    runs = 0
    whole = Simulator.run

    def counted(self: Simulator, *given: object) -> hb.Result:
        nonlocal runs
        runs += 1
        return whole(self, *given)

    monkeypatch.setattr(Simulator, "run", counted)
    with pytest.raises(SimulationError, match="run-runaway"):
        hb.energy(hb.loads(WINCH.replace("until: 10 s", "until: 45 s")))
    assert runs == 1


@pytest.mark.long
def test_a_run_that_overflows_is_not_told_of_roots_of_negative_numbers() -> None:
    with pytest.raises(SimulationError) as failed:
        hb.simulate(hb.loads(WINCH.replace("until: 10 s", "until: 100 s")))
    said = str(failed.value)
    assert "load.v, load.x have grown beyond all bounds" in said
    assert "root" not in said


def test_an_output_interval_longer_than_the_run_is_refused() -> None:
    with pytest.raises(UsageError, match=r"every \(20 s\) is longer than until \(10 s\).*every-too-long"):
        hb.simulate(hb.loads(WINCH), every="20 s")
    with listening():
        assert len(hb.simulate(hb.loads(SUCKING.replace("-2 L/min", "2 L/min")), every="2 s").time) == 2


def test_a_friction_that_is_stuck_is_told_with_what_to_type(tmp_path: Path) -> None:
    file = tmp_path / "held.yaml"
    file.write_text("""
model: held
components:
  frame:    {is: Fixed}
  spring:   {is: Spring, c: 1 kN/m}
  friction: {is: CoulombFriction, F_c: 10 N, v_t: 20 mm/s}
  mass:     {is: Mass, m: 1 kg}
nodes: {frame: [frame.a, friction.a, spring.a], load: [friction.b, spring.b, mass.a]}
initial: {load.x: 0 m, load.v: 0 m/s}
""", encoding="utf-8")
    said = " ".join(CliRunner().invoke(main, ["modes", str(file)]).output.split())
    assert "friction is stuck there (slower than its v_t)" in said
    assert "--set friction.F_c='0 N'" in said
    free = CliRunner().invoke(main, ["modes", str(file), "--set", "friction.F_c=0 N"]).output
    assert "stuck" not in free
    assert "5.033 Hz" in free
    event = file.read_text().replace("CoulombFriction, F_c: 10 N, v_t: 20 mm/s", "DryFriction, F_c: 10 N, F_s: 12 N")
    file.write_text(event)
    for words in (["modes", str(file)], ["linear", str(file), "--from", "load.f", "--to", "load.x"]):
        made = CliRunner().invoke(main, words)
        assert made.exit_code == 0, made.output
        switched = " ".join(made.output.split())
        assert "held constant: friction.mode = 0 (1 sliding forwards, -1 backwards, 0 stuck)" in switched, words
        assert "friction.told" not in switched


def test_a_case_of_a_sweep_that_ran_away_has_no_numbers_but_a_problem(tmp_path: Path) -> None:
    """The drive holds back, or pushes along; the first case is fine, the numbers of the other are not told."""
    (tmp_path / "winch.yaml").write_text(WINCH.replace("=18 kN*s/m*load.v", "=k*load.v").replace(
        "components:", "parameters: {k: -18 kN*s/m}\ncomponents:", 1), encoding="utf-8")
    said = CliRunner().invoke(main, [
        "sweep", str(tmp_path / "winch.yaml"), "--over", "k=-18 kN*s/m, 18 kN*s/m", "--measure", "final(load) in m",
        "--processes", "1", "--output", str(tmp_path / "swept"), "--json", str(tmp_path / "told.json")])
    assert said.exit_code == 0, said.output
    fine, away = json.loads((tmp_path / "told.json").read_text(encoding="utf-8"))["cases"]
    assert (fine["problem"], fine["outside"]) == ("", "") and fine["values"]
    assert "a million typical sizes" in away["problem"] and not away["values"]


def test_cases_of_a_sweep_that_leave_a_range_are_named_on_standard_error(tmp_path: Path) -> None:
    (tmp_path / "sucking.yaml").write_text(PUMPED, encoding="utf-8")
    said = CliRunner().invoke(main, [
        "sweep", str(tmp_path / "sucking.yaml"), "--over", "oil.V=2 L, 200 L", "--measure", "peak(oil.p) in bar",
        "--processes", "1", "--output", str(tmp_path / "swept"), "--json", str(tmp_path / "told.json")])
    assert said.exit_code == 0, said.output
    cases = json.loads((tmp_path / "told.json").read_text(encoding="utf-8"))["cases"]
    assert [bool(case["outside"]) for case in cases] == [True, False]
    assert "oil.p reaches 20490 bar" in said.stderr and said.stderr.count("warning:") == 1


def test_compare_and_tune_carry_the_verdict(tmp_path: Path) -> None:
    """A pressure larger than in any machine is a warning of `tune` and `compare` as of a plain run."""
    (tmp_path / "sucking.yaml").write_text(PUMPED, encoding="utf-8")
    rows = "\n".join(f"{k / 10},{19990 + 25 * k}" for k in range(21))
    (tmp_path / "pressures.csv").write_text(f"time_s,p_bar\n{rows}\n", encoding="utf-8")
    (tmp_path / "suction.yaml").write_text("""
experiment: suction
model: sucking.yaml
time: {column: time_s, unit: s}
records: {test: {file: pressures.csv, use: validate}}
outputs: {pressure: {is: oil.p, column: p_bar, unit: bar}}
""", encoding="utf-8")
    told = tmp_path / "told.json"
    said = CliRunner().invoke(main, ["compare", str(tmp_path / "suction.yaml"), "--json", str(told)])
    assert said.exit_code == 0, said.output
    assert said.stderr.startswith("warning: oil.p reaches 20490 bar")
    assert [f["run"] for f in findings(json.loads(told.read_text(encoding="utf-8")))] == ["suction, test"]
    said = CliRunner().invoke(main, ["tune", str(tmp_path / "sucking.yaml"), "--free", "oil.V=1 .. 3 L", "--cost",
                                     "mean((oil.p/(1 bar) - 20240)**2)", "--no-robustness", "--json", str(told)])
    assert said.exit_code == 0, said.output
    assert [f["part"] for f in findings(json.loads(told.read_text(encoding="utf-8")))] == ["oil"]
