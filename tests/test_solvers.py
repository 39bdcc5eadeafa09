"""Solvers by name: the same answers from each of them, and clear words where one cannot be used."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from click.testing import CliRunner
from collected import partly
from diagrams import BALL, FLOOR

import heavebond as hb
from heavebond import cli
from heavebond.language.sections import SOLVERS
from heavebond.numerics.dae import Integrand
from heavebond.numerics.dynamic_state_selection import StateChoices
from heavebond.numerics.event_constants import EVENTS
from heavebond.numerics.idas import Idas, Tolerances
from heavebond.numerics.looks import Looks
from heavebond.optimise.influence import rank

MODELS = Path(__file__).parents[1] / "models"
# rms of the difference over the range of an output (see `apart`) at the default tolerances: errors add up over thousands of
# steps. Where friction turns over or an event decides, a difference of 1e-8 moves an instant: such runs must agree as well
# at tolerances a hundred times smaller, and at the default ones to so much (IDAS itself moves by 1e-3 there).
AGREE, AGREE_SHARP = 3e-5, 3e-2
needs_compiler = pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc here")

SHAKEN = """
model: shaken
components:
  deck:
    is: PositionSource
    u: {file: heave.csv, column: "z [mm]", time: {column: "time [s]", unit: s}, unit: mm, interpolation: spline}
  spring: {is: SpringDamper, c: 2 kN/m, d: 40 N*s/m}
  load:   {is: Mass, m: 10 kg}
nodes: {deck: [deck.a, spring.a], load: [spring.b, load.a]}
initial: {start: steady}
show: {load: {is: load.x, unit: mm}}
simulate: {until: 5 s, every: 10 ms}
"""
ROOT = """
model: root
components:
  source: {is: PositionSource, u: "=sqrt((1 s - time)/1 s)*0.1 m"}
  spring: {is: SpringDamper, c: 2 kN/m, d: 40 N*s/m}
  load:   {is: Mass, m: 10 kg}
nodes: {deck: [source.a, spring.a], load: [spring.b, load.a]}
initial: {load.x: 0 m, load.v: 0 m/s}
simulate: {until: 2 s}
"""


def diagrams() -> list[str]:
    """The bundled machines, without the examples of single components."""
    files = sorted(p for p in MODELS.glob("*/*.yaml") if p.parent.name != "examples")
    return [p.parent.name if p.stem == p.parent.name else f"{p.parent.name}/{p.stem}" for p in files
            if any(line.startswith("model:") for line in p.read_text(encoding="utf-8").splitlines())
            and not any(line.startswith(("experiment:", "study:")) for line in p.read_text(encoding="utf-8").splitlines())]


def apart(one: hb.Result, other: hb.Result) -> float:
    """The largest rms of a difference between outputs, over the output's range or, where that is more, a hundredth of its
    largest value: tolerances are relative to the value, and a pressure of 170 bar may swing by 0.06 bar."""
    found = [0.0]
    for name in list(one.assembly.model.show) or one.assembly.state_names or one.names():
        largest = float(np.abs(one.display[name]).max())
        if largest > 1e-12:  # below is rounding, as the spool of a shut valve
            size = max(float(np.ptp(one.display[name])), 0.01 * largest)
            found.append(float(np.sqrt(np.mean((one.display[name] - other.display[name]) ** 2))) / size)
    return max(found)


def refusal(assembly: hb.Assembly, solver: str) -> str:
    """The code of the problem that a diagram has to be refused with for its properties, or none."""
    if solver == "rosenbrock":
        return "solver-cut" if assembly.flat.events or StateChoices(assembly).needed else ""
    return "solver-algebraic" if assembly.algebraic_names else ""


def check(name: str, solver: str) -> str:
    """The diagram runs as by IDAS, or is refused for the reason that its properties give, or fails as IDAS does where that
    needs what `auto` changes; gives the code of the refusal or failure."""
    assembly = hb.assemble(hb.load(name))
    if code := refusal(assembly, solver):
        with pytest.raises(hb.UsageError) as caught:
            hb.simulate(assembly, solver=solver)
        assert caught.value.problems[0].code == code
        assert "solver='" in caught.value.problems[0].hint
        return code
    plain = hb.simulate(assembly)
    if {"fills", "solver_changes"} & set(plain.statistics):
        told = []
        for asked in ("idas", solver):
            with pytest.raises((hb.SimulationError, hb.StartError)) as failed:
                hb.simulate(assembly, solver=asked)
            told.append(failed.value.problems[0])
            assert "--solver auto" in told[-1].hint
        assert told[0].code == told[1].code
        return told[0].code
    usual = ("idas", "the default") if assembly.algebraic_names or StateChoices(assembly).needed else \
        ("cvodes", "no algebraic unknowns")
    assert (plain.statistics["solver"], plain.statistics["why"]) == usual
    if usual[0] == solver:
        plain = hb.simulate(assembly, solver="idas")
    run = hb.simulate(assembly, solver=solver)
    assert run.statistics["solver"] == solver
    assert [event for _, event in run.events] == [event for _, event in plain.events]
    difference = apart(plain, run)
    if difference >= AGREE:
        assert difference < AGREE_SHARP
        close = [hb.simulate(assembly, solver=s, rtol=1e-10, atol=1e-12) for s in ("idas", solver)]
        assert apart(*close) < AGREE
    return ""


@pytest.mark.long
@pytest.mark.parametrize(("name", "code"), [
    ("cmc_ahc", ""), ("cmc_ahc/passive_then_active", ""), ("cmc_ahc/detailed", "solver-algebraic"), ("excavator_boom", ""),
    ("cylinder_rig", ""), ("quarter_car", ""), ("hydrostatic_drive", ""), ("circuits/intensifier", "")])
def test_cvodes_agrees_with_idas(name: str, code: str) -> None:
    assert check(name, "cvodes") == code


@pytest.mark.long
@needs_compiler
@pytest.mark.parametrize(("name", "code"), [
    ("cmc_ahc", ""), ("dc_stage", ""), ("passive_rig/passive_rig_friction", ""), ("pneumatic_cylinder", "solver-cut"),
    ("mechanisms/pendulum", "solver-cut"), ("excavator_boom", ""), ("circuits/tipper", "rank-lost")])
def test_rosenbrock_agrees_with_idas(name: str, code: str) -> None:
    assert check(name, "rosenbrock") == code


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["cvodes", pytest.param("rosenbrock", marks=needs_compiler)])
@pytest.mark.parametrize("name", diagrams())
def test_every_bundled_machine_runs_alike_by_every_solver(name: str, solver: str) -> None:
    check(name, solver)


@pytest.mark.slow
@pytest.mark.parametrize("path", sorted((MODELS / "examples").glob("*.yaml")), ids=lambda path: path.stem)
def test_every_example_runs_alike_by_auto(path: Path) -> None:
    assembly = hb.assemble(hb.load(path))
    plain, run = hb.simulate(assembly, solver="idas"), hb.simulate(assembly)
    assert run.statistics["why"] in ("the default", "no algebraic unknowns") and "solver_changes" not in run.statistics
    assert apart(plain, run) < 1e-4  # examples of laws with steps among them
    assert [name for _, name in run.events] == [name for _, name in plain.events]


@pytest.mark.parametrize("name", partly(["emps/emps_friction", "emps"], 2))
def test_auto_does_not_stall_where_idas_rejects_every_second_step(name: str) -> None:
    assembly = hb.assemble(hb.load(name))
    runs = {solver: hb.simulate(assembly, solver=solver) for solver in ("idas", "auto")}
    steps = {solver: int(str(run.statistics["nsteps"])) for solver, run in runs.items()}
    assert steps["auto"] < steps["idas"] / 10
    assert apart(runs["auto"], runs["idas"]) < AGREE


# By their formulas (see test_examples_electrical and test_examples_mechanics); the tolerances are per step.
@pytest.mark.parametrize(("name", "signal", "exact"), [
    ("i_field", "second", lambda t: (np.exp(-t / 3) - np.exp(-t)) / 2),
    ("c_field", "first", lambda t: (np.cos(2 * t) + np.cos(np.sqrt(6) * t)) / 2)])
def test_auto_is_as_exact_as_idas(name: str, signal: str, exact: Callable[[np.ndarray], np.ndarray]) -> None:
    assembly = hb.assemble(hb.load(f"examples/{name}"))
    errors = []
    for solver in ("auto", "idas"):
        run = hb.simulate(assembly, solver=solver)
        errors.append(float(np.abs(run.display[signal] - exact(run.time)).max()))
    assert errors[0] <= errors[1]


def test_idas_runs_what_cvodes_gives_up(monkeypatch: pytest.MonkeyPatch) -> None:
    from heavebond.numerics.solvers import Explicit

    def failing(self: Explicit, **given: object) -> dict[str, np.ndarray]:
        raise RuntimeError("CV_CONV_FAILURE")

    plain = hb.simulate(hb.load("quarter_car"), 1.0, solver="idas")
    monkeypatch.setattr(Explicit, "__call__", failing)
    run = hb.simulate(hb.load("quarter_car"), 1.0)
    assert (run.statistics["solver"], run.statistics["why"]) == ("idas", "cvodes gave up: CV_CONV_FAILURE")
    assert np.array_equal(run.x, plain.x)


# -- sensitivities -----------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("solver", ["cvodes", pytest.param("rosenbrock", marks=[needs_compiler, pytest.mark.long])])
def test_sensitivities_are_those_of_differences(solver: str) -> None:
    assembly, names = hb.assemble(hb.load("cmc_ahc")), ["controller.K_p", "crown.m"]
    run = hb.simulate(assembly, 6.0, every=0.05, sensitivities=names, solver=solver)
    plain = hb.simulate(assembly, 6.0, every=0.05, sensitivities=names)
    for name in names:
        exact = run.sensitivity("WOB", name)
        largest = np.abs(exact).max()
        # forward sensitivities are right to some 1e-4 of their largest value (see Tolerances)
        assert np.abs(exact - plain.sensitivity("WOB", name)).max() < 1e-3 * largest
        if name == "controller.K_p":
            value = assembly.parameter_values[name]
            high, low = (hb.simulate(assembly, 6.0, every=0.05, parameters={name: value + h}, rtol=1e-11,
                                     atol=1e-13).display["WOB"] for h in (1e-3, -1e-3))
            assert np.abs(exact - (high - low) / 2e-3).max() < 1e-3 * largest


def test_sensitivities_go_through_events_with_cvodes(tmp_path: Path) -> None:
    (tmp_path / "bouncing_floor.yaml").write_text(FLOOR)
    model = hb.loads(BALL, tmp_path)
    run = hb.simulate(model, sensitivities=["floor.e", "weight.g"], solver="cvodes")
    e, g = 0.8, 9.80665
    first = np.sqrt(2 / g)  # s: the first bounce; then hops of 2 e v/g, 2 e**2 v/g
    times = [time for time, _ in run.events]
    assert times[:2] == pytest.approx([first, first * (1 + 2 * e)], abs=1e-6)
    assert run.event_sensitivity("floor.impact", 1, "floor.e") == pytest.approx(2 * first, rel=1e-5)
    plain = hb.simulate(model, sensitivities=["floor.e", "weight.g"])
    for name in ("floor.e", "weight.g"):
        ours, theirs = run.sensitivity("ball.x", name), plain.sensitivity("ball.x", name)
        assert np.abs(ours - theirs).max() < 1e-5 * np.abs(theirs).max()


def test_a_run_backwards_asks_for_idas() -> None:
    from heavebond.optimise.adjoint import Adjoint
    from heavebond.optimise.cost_evaluation import Evaluator
    from heavebond.optimise.costs import read_cost

    assembly, study = hb.assemble(hb.load("cmc_ahc")), hb.load_study("cmc_ahc/quality_index")
    evaluator = Evaluator(assembly, [read_cost(assembly, study.tuning.cost)], 72.0, 96.0)
    simulator = hb.Simulator(assembly, times=np.array([0.0, 72.0, 96.0]), quadratures=evaluator.quadratures,
                             factors=evaluator.factors, solver="cvodes")
    with pytest.raises(hb.UsageError, match="solver='idas'"):
        Adjoint(simulator, evaluator, ["controller.K_p"])


# -- inputs, failures --------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("solver", ["cvodes", pytest.param("rosenbrock", marks=[needs_compiler, pytest.mark.long])])
def test_measured_inputs(solver: str, tmp_path: Path) -> None:
    t = np.arange(0, 5.01, 0.1)
    rows = [f"{a:.3f},{b:.9g}" for a, b in zip(t, 20 * np.sin(3 * t), strict=True)]
    (tmp_path / "heave.csv").write_text("time [s],z [mm]\n" + "\n".join(rows) + "\n")
    model = hb.loads(SHAKEN, tmp_path)
    assert apart(hb.simulate(model), hb.simulate(model, solver=solver)) < 1e-6


@pytest.mark.long
@pytest.mark.parametrize("solver", ["cvodes", pytest.param("rosenbrock", marks=needs_compiler)])
def test_a_failure_is_told_as_by_idas(solver: str) -> None:
    with pytest.raises(hb.SimulationError) as caught:
        hb.simulate(hb.loads(ROOT), solver=solver)
    assert "the integration stopped at t = 1" in str(caught.value)
    assert "no finite value" in str(caught.value)


# -- the choice --------------------------------------------------------------------------------------------------------
def test_the_choice_and_why() -> None:
    model = hb.load("quarter_car")
    told = {solver: hb.simulate(model, 0.1, solver=solver).statistics for solver in (None, "idas", "cvodes", "auto")}
    assert [(s["solver"], s["why"]) for s in told.values()] == [
        ("cvodes", "no algebraic unknowns"), ("idas", "asked for"), ("cvodes", "asked for"),
        ("cvodes", "no algebraic unknowns")]


def test_a_diagram_says_by_what_its_plain_runs_are_made(tmp_path: Path) -> None:
    base = tmp_path / "base.yaml"
    text = (MODELS / "quarter_car" / "quarter_car.yaml").read_text(encoding="utf-8")
    base.write_text(text.replace("simulate: {", "simulate: {solver: cvodes, "), encoding="utf-8")
    variant = tmp_path / "variant.yaml"
    variant.write_text("model: variant\nextends: base.yaml\nsimulate: {until: 0.1 s}\n", encoding="utf-8")
    found = hb.simulate(hb.load(variant))
    assert (found.statistics["solver"], found.statistics["why"]) == ("cvodes", "as the diagram says")
    assert hb.simulate(hb.load(variant), solver="idas").statistics["solver"] == "idas"
    # what is compared, fitted or tuned is run by IDAS
    assert hb.Simulator(hb.assemble(hb.load(variant))).solver.name == "idas"


def test_a_name_that_is_no_solver(tmp_path: Path) -> None:
    with pytest.raises(hb.UsageError, match="Did you mean 'cvodes'"):
        hb.simulate(hb.load("quarter_car"), solver="cvode")
    with pytest.raises(hb.ModelError, match="There are idas, cvodes, rosenbrock, euler, rk4, backward") as caught:
        hb.loads("model: m\nsimulate: {until: 1 s, solver: zzz}\n", tmp_path)
    assert caught.value.problems[0].place is not None


def test_the_compiler_is_asked_for_where_there_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(hb.UsageError, match="apt install gcc") as caught:
        hb.simulate(hb.load("quarter_car"), solver="rosenbrock")
    assert "--solver auto" in caught.value.problems[0].hint


@pytest.mark.long
@needs_compiler
def test_a_compiler_that_fails_and_what_it_leaves(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    model = hb.load("quarter_car")
    assert hb.simulate(model, 0.1, solver="rosenbrock").time[-1] == 0.1
    assert list(tmp_path.iterdir()) == []
    monkeypatch.setattr("heavebond.numerics.machine_code.compiler", lambda: "false")
    with pytest.raises(hb.UsageError, match="false could not compile the equations"):
        hb.simulate(model, 0.1, solver="rosenbrock")
    assert list(tmp_path.iterdir()) == []


def test_the_command_line_tells_it() -> None:
    told = CliRunner().invoke(cli.main, ["run", "quarter_car", "--until", "0.1 s", "--solver", "cvodes"])
    assert told.exit_code == 0
    assert "solver cvodes (asked for)" in told.output
    wrong = CliRunner().invoke(cli.main, ["run", "dc_stage", "--solver", "cvodes"])
    assert wrong.exit_code != 0
    for words in ("screw.a.tau", "--solver idas", "auto"):
        assert words in " ".join(str(wrong.exception).split()) + wrong.output
    assert set(SOLVERS) == {"idas", "cvodes", "rosenbrock", "auto", "euler", "rk4", "backward-euler"}


@pytest.mark.long
def test_a_chamber_that_is_emptied_is_told_as_that() -> None:
    rig = hb.load("cylinder_rig").with_parameters({"valve.u": "-0.08", "load_spring.c": "120 kN/m"})
    with pytest.warns(hb.RunWarning, match=r"cylinder.V_A falls below 0 m\*\*3 at 33.86 s: .*Add an EndStop"):
        found = hb.simulate(rig, until=40.0)
    assert found.verdict.failed and 33.8 < found.time[-1] < 33.87


SHUT = """
model: shut
components:
  pump:  {is: PressureSource, p_0: 200 bar}
  inlet: {is: BypassValve, q_r: 60 L/min, dp_r: 35 bar, u: "=if_else(time < 0.5 s, 0, 1)"}
  exit:  {is: BypassValve, q_r: 60 L/min, dp_r: 35 bar, u: 0}
  tank:  {is: Tank}
nodes: {supply: [pump.a, inlet.a], middle: [inlet.b, exit.a], back: [exit.b, tank.a]}
simulate: {until: 1 s, every: 10 ms}
"""


def test_the_verdict_names_a_node_without_capacity_that_was_filled() -> None:
    """Once the node has a volume of its own, the verdict is clean."""
    with pytest.warns(hb.RunWarning, match=r"middle has no capacity: .* a volume of 0\.001 L there"):
        run = hb.simulate(hb.loads(SHUT))
    assert [(f.kind, f.part, f.value, f.failed) for f in run.verdict.findings] == [("filled", "middle", 1e-6, False)]
    block = SHUT.replace("  tank:", "  block: {is: Volume, V: 1 cm**3}\n  tank:").replace("exit.a]", "exit.a, block.a]")
    assert hb.simulate(hb.loads(block)).verdict.status == "clean"


def test_a_node_between_shut_valves_is_filled_and_the_run_begins_anew() -> None:
    run = hb.simulate(hb.loads(SHUT))
    fills = run.statistics["fills"]
    assert isinstance(fills, dict) and fills["nodes"] == ["middle"] and "middle.p" in fills["why"]
    # 1 cm**3 takes 0.014 cm**3 for 200 bar, which the valve lets through within microseconds
    assert run["middle.p"][40] == pytest.approx(0, abs=1) and run["middle.p"][60] == pytest.approx(200e5, rel=1e-6)
    with pytest.raises(hb.HeavebondError):
        hb.simulate(hb.loads(SHUT), solver="idas")


def test_a_machine_is_linearised_wherever_it_runs(tmp_path: Path) -> None:
    """The same nodes are filled at the start and on the way, with inputs to the filled machine too, and it is said."""
    (tmp_path / "shut.yaml").write_text(SHUT)
    for words in (["modes"], ["modes", "--at", "0.7 s"], ["linear", "--from", "middle.q", "--to", "middle.p"],
                  ["linear", "--over", "exit.dp_r=20 .. 40 bar"]):
        told = CliRunner().invoke(cli.main, [words[0], str(tmp_path / "shut.yaml"), *words[1:]])
        assert told.exit_code == 0, told.output
        said = " ".join(told.output.split())
        assert "Linearised with a short bore of oil or gas on middle, which store none: before, no equation" in said
    found = hb.state_space(hb.load(tmp_path / "shut.yaml"), ["middle.q"], ["middle.p"], at=0.7)
    # what enters while the inlet is open leaves through it; the slope of its law at rest is that of its smoothing
    assert found.states == ("middle.p",) and found.stable


def test_sensitivities_and_sweeps_run_what_run_runs(tmp_path: Path) -> None:
    (tmp_path / "shut.yaml").write_text(SHUT)
    told = CliRunner().invoke(cli.main, ["sensitivity", str(tmp_path / "shut.yaml"), "--of", "middle.p"])
    assert told.exit_code == 0, told.output
    assert "Run with a short bore of oil or gas on middle" in " ".join(told.output.split())
    found = rank(hb.assemble(hb.loads(SHUT)), ["middle.p"], ["pump.p_0"])
    (influence,) = found.rankings[0].influences
    assert influence.peak == pytest.approx(200e5, rel=1e-6)  # the node takes the pressure of the pump
    swept = CliRunner().invoke(cli.main, [
        "sweep", str(tmp_path / "shut.yaml"), "--over", "pump.p_0=100 bar, 200 bar", "--measure", "final(middle.p) in bar",
        "--processes", "1", "--output", str(tmp_path / "swept"), "--json", str(tmp_path / "told.json")])
    assert swept.exit_code == 0, swept.output
    assert "run with a short bore of oil or gas on middle" in " ".join(swept.output.split())
    cases = json.loads((tmp_path / "told.json").read_text())["cases"]
    assert [*(value for case in cases for value in case["values"].values())] == pytest.approx([1e7, 2e7], rel=1e-6)


def test_a_node_that_takes_up_a_flow_is_not_filled_in_a_sweep(tmp_path: Path) -> None:
    """A pump against shut valves: the bore would decide, and the first reason is told."""
    (tmp_path / "dead.yaml").write_text(SHUT.replace("{is: PressureSource, p_0: 200 bar}", "{is: FlowSource, u: 30 L/min}"))
    told = CliRunner().invoke(cli.main, ["sensitivity", str(tmp_path / "dead.yaml"), "--of", "middle.p"])
    assert told.exit_code == 1 and "short bore" not in told.output


def test_energy_beside_which_nodes_need_filling_is_that_of_the_filled_machine() -> None:
    """A run that needs none, until integrals stand beside it."""
    found = hb.energy(hb.load("circuits/truck_brake"))
    assert found.closes() and "fill_1" in {line.component for line in found.lines}


def test_energy_and_compare_run_what_run_runs_and_fit_says_why_not(tmp_path: Path) -> None:
    """They begin anew with the same nodes filled, and say so."""
    (tmp_path / "shut.yaml").write_text(SHUT)
    run = hb.simulate(hb.load(tmp_path / "shut.yaml"))
    found = hb.energy(hb.load(tmp_path / "shut.yaml"))
    fills = found.result.statistics["fills"]
    assert isinstance(fills, dict) and fills["nodes"] == ["middle"]
    assert found.closes() and "fill_1" in {line.component for line in found.lines}
    rows = [f"{t:.9g},{p / 1e5:.9g}" for t, p in zip(run.time, run["middle.p"], strict=True)]
    (tmp_path / "shut.csv").write_text("\n".join(["time,p", *rows, ""]))
    (tmp_path / "rig.yaml").write_text("""experiment: rig
model: shut.yaml
records: {bench: {file: shut.csv, use: fit}}
time: {column: time, unit: s}
outputs: {p: {is: middle.p, column: p, unit: bar}}
""")
    compared = hb.compare(tmp_path / "rig.yaml").records["bench"]
    assert compared.channels["p"].error < 1e-3
    assert [f.name for f in compared.result.verdict.findings if f.kind == "filled"] == ["middle"]
    with (tmp_path / "rig.yaml").open("a") as rig:
        rig.write("free: {inlet.q_r: 40 .. 80 L/min}\n")
    with pytest.raises(hb.HeavebondError, match="add Volume on middle"):
        hb.fit(tmp_path / "rig.yaml")


def test_another_solver_goes_on_from_the_last_accepted_point(monkeypatch: pytest.MonkeyPatch) -> None:
    from heavebond.numerics import event_integration
    from heavebond.numerics.idas import Idas
    from heavebond.numerics.solvers import Explicit

    plain = hb.simulate(hb.load("quarter_car"), 3.0)
    call = Idas.__call__

    def stopping(self: Idas, **given: object) -> dict[str, np.ndarray]:
        end = np.asarray(given["u"])[-2:].sum(axis=0).max() if self.size1_in("u") >= 2 else 3.0
        if end > 1.0:
            raise RuntimeError("IDA_CONV_FAIL")
        return call(self, **given)

    def from_a_point_on(self: Explicit, **given: object) -> dict[str, np.ndarray]:
        if self.size1_in("u") < 2:  # the whole run, by which `auto` begins
            raise RuntimeError("CV_CONV_FAILURE")
        return goes_on(self, **given)

    goes_on = Explicit.__call__
    monkeypatch.setattr(Explicit, "__call__", from_a_point_on)
    monkeypatch.setattr(Idas, "__call__", stopping)
    assert event_integration.reason("x IDA_CONV_FAIL y") == "IDA_CONV_FAIL"
    run = hb.simulate(hb.load("quarter_car"), 3.0)
    changes = run.statistics["solver_changes"]
    assert isinstance(changes, list) and [(c["before"], c["after"], c["why"]) for c in changes] == [
        ("idas", "cvodes", "IDA_CONV_FAIL")]
    assert 0.9 < changes[0]["time"] < 1.6  # a stretch that began before 1 s ended there
    assert apart(plain, run) < 1e-6


def test_few_steps_suffice_without_consistent_rates(monkeypatch: pytest.MonkeyPatch) -> None:
    """In a search for events, a call may take few steps between two points, the first of which are close to the begin. Where
    IDAS cannot make x' consistent, the steps begin so small that they double many times."""
    x, z = ca.SX.sym("x"), ca.SX.sym("z")
    dae = {"x": x, "z": z, "ode": -z, "alg": z - x, "t": ca.SX.sym("t"), "p": ca.SX(0, 1), "u": ca.SX(0, 1)}
    looks = Looks.dense(0.0, 1e-3, 1, 1e-9)
    stops = np.append(0.0, looks.times)
    idas = Idas(Integrand(dae, ca.Function("hoist", [], [])), stops, Tolerances(), EVENTS.steps_per_check)

    def inconsistent(**arguments: object) -> None:
        raise RuntimeError("IDACalcIC failed")

    monkeypatch.setattr(idas, "_usual", inconsistent)
    found = idas(x0=[1.0], z0=[1.0])
    assert found["xf"].ravel() == pytest.approx(np.exp(-looks.times), rel=1e-7)
