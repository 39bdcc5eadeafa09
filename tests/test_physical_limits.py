"""Variables that cannot fall below a physical limit: a run ends there, and a trial of a search is rejected."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from diagrams import SUCKING

import heavebond as hb
from heavebond.cli import main
from heavebond.core.errors import RunWarning, SimulationError
from heavebond.equations.flatten import flatten
from heavebond.equations.reduce import collapse_rows
from heavebond.equations.structural_messages import singular
from heavebond.language.library import library
from heavebond.numerics.compiled_cvodes import Method
from heavebond.numerics.quick_simulation import CaseSimulator, FitSimulator, QuickSimulator
from heavebond.numerics.result import Probe
from heavebond.numerics.simulator import Simulator
from heavebond.optimise.objective import TuningProblem, ranges
from heavebond.optimise.tuning import tune

MODELS = Path(hb.__file__).parent.parent / "models"
# a level of 1 m on 0.1 m**2, drawn by 1 L/s: empty after 100 s
DRAINED = """
model: drained
parameters: {draw: 1 L/s}
components:
  tank: {is: OpenTank, A: 0.1 m**2}
  pump: {is: FlowSource, u: =-draw}
  rain: {is: FlowSource, u: 0 L/s}
nodes: {top: [rain.a, tank.a], bottom: [pump.a, tank.b]}
initial: {tank.h: 1 m}
show: {level: {is: tank.h, unit: m}}
simulate: {until: 150 s, every: 0.5 s}
"""
# p = p_0 - q R T/V t: 1 g/s out of 1 L of air at 20 degC and 101325 Pa
EMPTIED = """
model: emptied
components:
  tank: {is: Receiver, V: 1 L}
  draw: {is: PneumaticFlowSource, u: -1 g/s}
nodes: {tank: [tank.a, draw.a]}
initial: {tank.p: 101325 Pa}
simulate: {until: 4 s, every: 10 ms}
"""
# T = T_0 - P/(m c) t: 460 J/K from 293.15 K with 10 kW
FROZEN = """
model: frozen
components:
  block: {is: HeatCapacity, m: 1 kg, c: 460 J/(kg*K)}
  cold:  {is: HeatSource, u: -10 kW}
nodes: {block: [block.a, cold.a]}
simulate: {until: 20 s, every: 0.1 s}
"""
# a rod that is pulled at 0.1 m/s: V_A = 0.2 L - 10 cm**2 * 0.1 m/s * t is 0 after 2 s
PULLED = """
model: pulled
components:
  frame: {is: Fixed}
  ram:   {is: Cylinder, A_A: 10 cm**2, A_B: 10 cm**2, V_A0: 0.2 L, V_B0: 1 L, beta: 1.5 GPa}
  drive: {is: VelocitySource, u: -0.1 m/s}
  tank:  {is: Tank}
nodes: {frame: [frame.a, ram.a], rod: [ram.b, drive.a], oil: [ram.A, ram.B, tank.a]}
initial: {rod.x: 0 m}
simulate: {until: 3 s, every: 10 ms}
"""
CASES = {
    "pressure": (SUCKING, "oil.p", 11.01325 / 250, "Cavitation"),
    "level": (DRAINED, "tank.h", 100.0, "Relay"),
    "gas pressure": (EMPTIED, "tank.p", 101325 * 1e-3 / (1e-3 * 287.05 * 293.15), "PneumaticOrifice"),
    "temperature": (FROZEN, "block.T", 293.15 * 460 / 10e3, "ThermalResistance"),
    "volume": (PULLED, "ram.V_A", 2.0, "EndStop"),
}


def command(folder: Path, text: str, *words: str, name: str = "run") -> tuple[int, str, dict[str, Any]]:
    """Exit code, standard error and JSON file of a command on a diagram."""
    (folder / "machine.yaml").write_text(text, encoding="utf-8")
    said = CliRunner().invoke(main, [name, str(folder / "machine.yaml"), *words, "--json", str(folder / "told.json")])
    return said.exit_code, said.stderr, json.loads((folder / "told.json").read_text(encoding="utf-8"))


@pytest.mark.long
def test_a_chamber_of_negative_volume_ends_the_run_of_the_compensator(tmp_path: Path) -> None:
    """The rod leaves the active cylinder of 1.26 m after 8.6 s in a wave of 4 m; the results before it are written."""
    saved, told = tmp_path / "run.csv", tmp_path / "told.json"
    said = CliRunner().invoke(main, ["run", "cmc_ahc", "--set", "wave.a=4 m", "--save", str(saved), "--json", str(told)])
    assert said.exit_code == 1
    assert "ahc.cylinder.V_B falls below 0 m**3 at 8.6" in said.stderr and "[run-physical]" in said.stderr
    assert "EndStop" in said.stderr
    rows = np.genfromtxt(saved, delimiter=",", skip_header=1)
    assert 8.6 < rows[-1, 0] < 8.7 and len(rows) > 400
    found = json.loads(told.read_text(encoding="utf-8"))["validity"]
    assert (found["status"], found["exit"]) == ("failed", 1)
    assert (found["findings"][0]["part"], found["findings"][0]["name"]) == ("ahc.cylinder", "ahc.cylinder.V_B")


@pytest.mark.parametrize("case", CASES)
def test_a_run_ends_at_its_physical_limit_with_the_part_the_time_and_the_component_to_add(case: str, tmp_path: Path) -> None:
    """The times are closed forms; they are interpolated between two output points of a straight line, which is exact up to
    the tolerance below the limit (1e-3 of the atmosphere, 1e-6 of the nominal size)."""
    text, name, time, component = CASES[case]
    code, said, told = command(tmp_path, text)
    assert code == 1, said
    assert f"{name} falls below" in said and component in said
    found = told["validity"]["findings"][0]
    assert (found["kind"], found["part"], found["name"]) == ("physical", name.rpartition(".")[0], name)
    assert found["time"] == pytest.approx(time, rel=1e-3)
    assert told["until"] <= time * (1 + 1e-3)


def test_a_limit_between_distant_output_points_has_its_time(tmp_path: Path) -> None:
    """A tank that empties at 100 s, in a run with output points at 0 and 150 s only."""
    code, said, told = command(tmp_path, DRAINED, "--every", "150 s")
    assert code == 1, said
    assert told["validity"]["findings"][0]["time"] == pytest.approx(100.0, rel=1e-3)


def test_python_has_the_results_up_to_the_limit_and_a_failed_verdict() -> None:
    with pytest.warns(RunWarning, match=r"tank\.h falls below 0 m at 100 s"):
        result = hb.simulate(hb.loads(DRAINED), sensitivities=["draw"])
    assert result.verdict.failed and result.time[-1] == pytest.approx(100.0, abs=0.5)
    assert result["tank.h"] == pytest.approx(1 - result.time / 100, abs=1e-8)
    assert result.sensitivity("tank.h", "draw") == pytest.approx(-result.time / 0.1, rel=1e-6, abs=1e-9)
    with pytest.raises(SimulationError, match="run-physical"):
        result.verdict.raise_if_failed()


def test_a_limit_ends_a_run_with_events() -> None:
    """A relay opens the outflow at 0.5 m, after 50 s; 2 L/s then empty the tank within 25 s."""
    text = DRAINED.replace("u: =-draw", 'u: "=if_else(valve.y > 0.5, -2*draw, -draw)"').replace(
        "  rain:", "  valve: {is: Relay, u: =-tank.h/(1 m), u_on: -0.5, u_off: -10, y_on: 1}\n  rain:")
    with pytest.warns(RunWarning, match=r"tank\.h falls below 0 m at 75"):
        result = hb.simulate(hb.loads(text))
    assert [round(time) for time, _ in result.events] == [0, 50]


@pytest.mark.parametrize("kind", [Simulator, FitSimulator, QuickSimulator, CaseSimulator])
def test_a_trial_beyond_a_limit_fails_in_every_simulator_of_a_search(kind: type[Simulator]) -> None:
    assembly = hb.assemble(hb.loads(DRAINED))
    simulator = kind(assembly, times=np.linspace(0, 150, 301))
    with pytest.raises(SimulationError) as failed:
        simulator.run({"draw": 1e-3})
    assert failed.value.problems[0].code == "run-physical"
    assert simulator.run({"draw": 1e-4})["tank.h"][-1] == pytest.approx(0.85)


@pytest.mark.parametrize("kind", [FitSimulator, QuickSimulator])
def test_a_trial_of_which_only_outputs_are_kept_fails_too(kind: type[FitSimulator | QuickSimulator]) -> None:
    """The level is no output, only the flow is."""
    assembly = hb.assemble(hb.loads(DRAINED))
    simulator = kind(assembly, times=np.linspace(0, 150, 301), probe=Probe(assembly, ["pump.u"]), sensitivities=["draw"])
    with pytest.raises(SimulationError):
        simulator.measured({"draw": 1e-3})
    values, _ = simulator.measured({"draw": 1e-4})
    assert values.shape == (1, 301)


def test_a_fit_rejects_trials_beyond_a_limit_and_finds_the_values(tmp_path: Path) -> None:
    """Starts are spread over 0 to 20 L/s; the record is of 0.5 L/s, and above 1.5 times that the tank runs empty."""
    (tmp_path / "drained.yaml").write_text(DRAINED.replace("draw: 1 L/s", "draw: 0.3 L/s"), encoding="utf-8")
    time = np.arange(0, 151, 5)
    rows = "\n".join(f"{t},{1 - t / 200 + 1e-3 * np.sin(7 * t)}" for t in time)
    (tmp_path / "record.csv").write_text(f"t,h\n{rows}\n", encoding="utf-8")
    (tmp_path / "level.yaml").write_text("""
experiment: level
model: drained.yaml
time: {column: t, unit: s}
records: {test: {file: record.csv, use: fit}}
outputs: {level: {is: tank.h, column: h, unit: m, noise: 1 mm}}
free: {draw: 0 .. 20 L/s}
""", encoding="utf-8")
    found = hb.fit(str(tmp_path / "level.yaml"), starts=5)
    assert found.parameters[0].value == pytest.approx(0.5e-3, rel=1e-2)


def test_tuning_stays_inside_a_limit() -> None:
    """The lowest level at the end is asked for: without the limit it is -14 m, with it the tank is just empty. The cost at
    the end of the search is within 2 % of the range of the level, as steps into the forbidden side are halved."""
    task = TuningProblem(ranges({"draw": "0.1 .. 10 L/s"}), "final(tank.h)", begin=0.0, end=150.0)
    found = tune(hb.loads(DRAINED.replace("draw: 1 L/s", "draw: 0.2 L/s")), task)
    assert 0 <= found.cost < 0.15


def test_a_study_marks_the_case_beyond_a_limit(tmp_path: Path) -> None:
    code, said, told = command(tmp_path, DRAINED, "--over", "draw=0.5 L/s, 1 L/s", "--measure", "final(level) in m",
                               "--processes", "1", "--output", str(tmp_path / "swept"), name="sweep")
    assert code == 0, said
    fine, empty = told["cases"]
    assert fine["problem"] == "" and list(fine["values"].values()) == [pytest.approx(0.25)]
    assert "tank.h falls below 0 m at 100 s" in empty["problem"] and not empty["values"]


def test_a_start_below_a_limit_is_an_error(tmp_path: Path) -> None:
    for name in ("run", "check", "energy"):
        code, said, _ = command(tmp_path, SUCKING.replace("10 bar", "-10 bar"), name=name)
        assert code == 1 and "oil.p" in said and "Cavitation" in said, name


@pytest.mark.parametrize("more", [{}, {"sensitivities": ["cylinder.beta"]}, {"solver": "rk4", "step": 1e-4}])
def test_a_start_below_a_limit_is_reported_before_the_integration(more: dict[str, Any], monkeypatch: pytest.MonkeyPatch
                                                                   ) -> None:
    text = (MODELS / "cylinder_rig" / "cylinder_rig.yaml").read_text(encoding="utf-8")
    model = hb.loads(text.replace("load.x: 0 m", "load.x: -10 m"))
    monkeypatch.setattr(Simulator, "_integrate", lambda *_: pytest.fail("it integrates"))
    with pytest.warns(RunWarning, match=r"cylinder\.V_A falls below 0 m\*\*3 at 0 s"):
        run = hb.simulate(model, **more)
    assert run.verdict.failed and list(run.time) == [0.0]


@pytest.mark.filterwarnings("ignore::heavebond.RunWarning")
def test_a_start_below_a_limit_at_a_node_without_capacity_is_repeated_with_a_volume_there() -> None:
    """The sensing line has no capacity, and its pressure without one is below vacuum at the start."""
    run = hb.simulate(hb.load(MODELS / "circuits" / "load_sensing.yaml"), until=0.01)
    assert run.statistics["fills"] and not run.verdict.failed
    assert run.time[-1] == 0.01


def test_a_component_declares_the_limit_of_its_variable(tmp_path: Path) -> None:
    """A gauge pressure of a component in a file of a user, and the message that it has."""
    law = """
component: Cell
summary: A pressure that falls at a constant rate.
ports: {}
parameters: {r: {unit: Pa/s, doc: rate}}
variables: {p: {unit: Pa, physical: -1 bar, beyond: the cell boils. Add a Vent, doc: gauge pressure}}
equations: |
  der(p) = -r   # falls
"""
    text = "model: m\ncomponents: {cell: {is: Cell, r: 1 bar/s}}\nnodes: {}\ninitial: {cell.p: 0 bar}\n" \
        "simulate: {until: 2 s}\n"
    (tmp_path / "cell.yaml").write_text(law, encoding="utf-8")
    code, said, told = command(tmp_path, text)
    assert code == 1 and "cell.p falls below -1 bar at 1" in said and "the cell boils. Add a Vent." in said
    assert told["validity"]["findings"][0]["time"] == pytest.approx(1.0, rel=2e-3)
    (tmp_path / "cell.yaml").write_text(law.replace(", beyond: the cell boils. Add a Vent", ""), encoding="utf-8")
    code, said, _ = command(tmp_path, text)
    assert code == 1 and "[beyond-missing]" in said


# Variables with the unit of a volume, a mass, a pressure or a temperature, and levels, without a limit.
DIFFERENCE = re.compile(
    r"pressure (drop|rise|loss)|loss of unsteady|steady pressure|distance|temperature difference|above that of the fluid|"
    r"pressure across|compression energy|above the final vacuum|has come in since|set pressure")
WITHOUT_LIMIT = {
    ("GasAccumulator", "V"): "V_0 - V_g with V_g below V_0 by its law",
    ("SpringAccumulator", "V"): "between 0 and V_m by its law",
    ("GasAccumulator", "V_v"): "positive by the function vapour_volume",
    ("PistonAccumulator", "V_v"): "positive by the function vapour_volume",
    ("SpringAccumulator", "V_v"): "positive by the function vapour_volume",
    ("GasAccumulatorWithHeat", "p_c"): "a product of T, which has the limit",
    ("CavitatingVolume", "p_g"): "an exponential",
    ("CavitatingVolume", "V_g"): "a product of an exponential and x",
    ("ForceCurveOfPressure", "x"): "the pressure of a port, which has the limit of its domain",
    ("GasCompliance", "p"): "the pressure of a port, which has the limit of its domain",
    ("Overflow", "p"): "the pressure of a port, which has the limit of its domain",
    ("AnalogDigitalConverter", "k"): "a level of a converter, not of a liquid",
    ("AnalogDigitalConverter", "step"): "a difference of two levels of a converter",
    **{("TransmissionLine", wave): "a wave, p + Z*q, which a flow out of the line makes lower than the pressure"
       for wave in ("w_a", "w_b", "c_a", "c_b")},
}


def test_the_library_declares_the_limits_of_volumes_masses_levels_and_absolute_pressures_and_temperatures() -> None:
    known, found, excused = library(), 0, set()
    for name in known.names():
        for variable in known.component(name).variables.values():
            if variable.unit.text not in ("m**3", "kg", "Pa", "K") and "level" not in variable.doc:
                continue
            if variable.physical is not None:
                found += 1
                assert variable.physical == (-101325 if name in ("Tee", "TransmissionLine") else 0), (name, variable.name)
            elif (name, variable.name) in WITHOUT_LIMIT:
                excused.add((name, variable.name))
            else:
                assert DIFFERENCE.search(variable.doc), f"{name}.{variable.name} ({variable.doc}) has no `physical:`"
    assert excused == set(WITHOUT_LIMIT) and found >= 20
    for domain in known.domains.values():
        for member in domain.members.values():
            assert member.unit.text not in ("Pa", "K") or member.physical is not None, (domain.name, member.name)
    # the advice names a component of the library, or a parameter of its own
    kinds = re.compile(r"\b[A-Z][a-z]+(?:[A-Z][a-z]+)*\b")
    for name in known.names():
        for variable in known.component(name).variables.values():
            assert all(word in known.names() or word in ANY for word in kinds.findall(variable.beyond)), variable.beyond


ANY = {"Add", "Begin", "Draw", "Look", "Make", "Limit"}


def test_equations_that_depend_on_each_other_are_named_with_parts_and_lines() -> None:
    """A decomposition finds no part of a sound diagram; the error then names the equations that it is called with."""
    flat = flatten(hb.loads("""
model: m
components: {wall: {is: Fixed}, spring: {is: Spring, c: 1 kN/m}, load: {is: Mass, m: 1 kg}}
nodes: {wall: [wall.a, spring.a], load: [spring.b, load.a]}
initial: {load.x: 0 m, load.v: 0 m/s}
"""), [])
    laws = [k for k, e in enumerate(flat.equations) if e.owner == "spring"]
    said = str(singular(flat, collapse_rows(flat), [-1] * len(flat.equations), laws))
    assert "equations of spring are equivalent" in said and "[singular]" in said
    assert "Hooke's law" in said and "spring.yaml:15" in said


# a level that dips to -0.05 m for 2.9 s between 49 and 51 s: h = 1 - 1.05 sin(pi t/100)
DIP = """
model: dip
components:
  tank: {is: OpenTank, A: 1 m**2}
  flow: {is: FlowSource, u: "=-1.05*3.14159265358979/100*1 m**3/s*cos(3.14159265358979/100*time/(1 s))"}
  rain: {is: FlowSource, u: 0 L/s}
nodes: {top: [rain.a, tank.a], bottom: [flow.a, tank.b]}
initial: {tank.h: 1 m}
simulate: {until: 100 s, every: 50 s}
"""
DIPS = 100 / np.pi * np.arcsin(1 / 1.05)  # s; when it is empty


@pytest.mark.parametrize("every", ["100 s", "37 s", "10 ms"])
@pytest.mark.parametrize("solver", ["auto", "idas"])
def test_a_limit_that_is_passed_between_output_points_ends_the_run_at_its_time(every: str, solver: str) -> None:
    with pytest.warns(RunWarning, match="tank.h falls below 0 m"):
        result = hb.simulate(hb.loads(DIP), every=every, solver=solver)
    # the straight line meets the limit within 1e-6 of the run
    assert result.ended is not None and result.ended.time == pytest.approx(DIPS, abs=1e-4)
    assert result.time[-1] == result.ended.time and result["tank.h"][-1] == pytest.approx(0, abs=1e-5)


@pytest.mark.parametrize("kind", [Simulator, FitSimulator, QuickSimulator, CaseSimulator])
def test_a_trial_beyond_a_limit_between_output_points_fails_in_every_simulator_of_a_search(kind: type[Simulator]) -> None:
    assembly = hb.assemble(hb.loads(DIP))
    with pytest.raises(SimulationError) as failed:
        kind(assembly, times=np.array([0.0, 30.0, 100.0])).run()
    assert failed.value.problems[0].code == "run-physical"
    quiet = hb.assemble(hb.loads(DIP.replace("1.05", "0.95")))
    assert kind(quiet, times=np.array([0.0, 50.0, 100.0])).run()["tank.h"] == pytest.approx([1, 0.05, 1], abs=1e-6)


def test_a_limit_between_output_points_ends_a_run_with_events() -> None:
    text = DIP.replace("  rain:", "  clock: {is: Relay, u: '=time/(1 s)', u_on: 20, u_off: 10, y_on: 1}\n  rain:")
    with pytest.warns(RunWarning, match="tank.h falls below 0 m"):
        result = hb.simulate(hb.loads(text))
    assert result.ended is not None and result.ended.time == pytest.approx(DIPS, abs=1e-3)
    assert len(result.events) >= 1
    for kind in (Simulator, FitSimulator):
        with pytest.raises(SimulationError, match="run-physical"):
            kind(hb.assemble(hb.loads(text)), times=np.array([0.0, 30.0, 100.0])).run()


# the rod flies at 0.2 mm/s until the piston meets a wall at -0.2 m, where V_A is 0, for 60 ms
BRIEF = """
model: brief
components:
  frame: {is: Fixed}
  ram:   {is: Cylinder, A_A: 100 cm**2, A_B: 100 cm**2, V_A0: 2 L, V_B0: 10 L, beta: 1.5 GPa}
  load:  {is: Mass, m: 1 kg}
  wall:  {is: ForceSource, u: "=1e9 N/m**2*max(PLACE - rod.x, 0 m)**2"}
  tank:  {is: Tank}
nodes: {frame: [frame.a, ram.a], rod: [ram.b, load.a, wall.a], oil: [ram.A, ram.B, tank.a]}
initial: {rod.x: 0 m, rod.v: -0.2 mm/s}
simulate: {until: 3600 s}
"""


def test_a_limit_that_is_passed_for_milliseconds_of_an_hour_is_noticed_by_runs_and_searches() -> None:
    inside, beyond = BRIEF.replace("PLACE", "-0.199 m"), BRIEF.replace("PLACE", "-0.2 m")
    with pytest.warns(RunWarning, match="ram.V_A falls below 0 m"):
        result = hb.simulate(hb.loads(beyond))
    assert result.ended is not None and result.ended.time == pytest.approx(1000, abs=0.1)
    for times in (np.array([0.0, 3600.0]), np.linspace(0, 3600, 1001)):
        with pytest.raises(SimulationError, match="run-physical"):
            Simulator(hb.assemble(hb.loads(beyond)), times=times).run()
        assert Simulator(hb.assemble(hb.loads(inside)), times=times).run().ended is None


# oil at 0.1 bar from which 2 L/min are drawn for 4 ms, and given back after 20 ms: dp/dt = -q beta/V
SHORT_VACUUM = """
model: short_vacuum
parameters: {q: 2 L/min}
components:
  pump: {is: FlowSource, u: "=-q*(exp(-((time - 5.03 s)/(2 ms))**2) - exp(-((time - 5.05 s)/(2 ms))**2))"}
  oil:  {is: Volume, V: 0.1 L, beta: 1.5 GPa}
nodes: {oil: [pump.a, oil.a]}
initial: {oil.p: 0.1 bar}
simulate: {until: 20 s, every: 0.1 s}
"""


@pytest.mark.parametrize("kind", [FitSimulator, QuickSimulator, CaseSimulator])
@pytest.mark.parametrize("one_step", [False, True])
def test_compiled_runs_end_at_the_step_that_passes_a_limit_between_their_samples(kind: type[Simulator], one_step: bool
                                                                                 ) -> None:
    assembly = hb.assemble(hb.loads(SHORT_VACUUM))
    probe = {} if kind is CaseSimulator else {"probe": Probe(assembly, ["oil.p"], si=True)}
    simulator = kind(assembly, **probe)
    if simulator.driver is None:
        pytest.skip("the compiled program is not available here")
    if one_step:
        simulator.driver.method = Method(True, 1e6)
    run = simulator.run if kind is CaseSimulator else simulator.measured
    for _ in range(2):
        with pytest.raises(SimulationError, match=r"oil.p falls below -1.0132 bar at 5.02\d* s") as failed:
            run({})
        assert failed.value.problems[0].code == "run-physical"
    assert simulator.driver.stats()["nsteps"] < 600  # it ends there: the whole run has more
    run({"q": 1e-6})  # down to -0.43 bar; nothing is left of the run before


@pytest.mark.filterwarnings("ignore::heavebond.RunWarning")
@pytest.mark.parametrize(("parts", "ends", "adds"), [
    # 0.1 m and 1 L by 6 L/min
    ("""  t: {is: OpenTank, A: 0.01 m**2}
  q: {is: FlowSource, u: -6 L/min}
  c: {is: Cap}
  f: {is: Water}
nodes: {x: [t.b, q.a, f.a], z: [t.a, c.a]}
initial: {t.h: 0.1 m}""", 10.0, "Orifice"),
    # 300 K and 100 J/K by 1 kW
    ("""  h: {is: HeatCapacity, m: 1 kg, c: 100 J/(kg*K)}
  q: {is: HeatSource, u: -1 kW}
nodes: {x: [h.a, q.a]}
initial: {x.T: 300 K}""", 30.0, "ThermalResistance"),
    # 2 bar*1 L/(287.05 J/(kg K)*293.15 K) by 1 g/s
    ("""  r: {is: Receiver, V: 1 L}
  q: {is: PneumaticFlowSource, u: -1 g/s}
nodes: {x: [r.a, q.a]}
initial: {x.p: 2 bar}""", 200 / 287.05 / 293.15 * 1e3, "PneumaticOrifice"),
], ids=["tank", "heat", "gas"])
def test_a_store_that_is_emptied_ends_the_run_at_the_time_of_its_balance(parts: str, ends: float, adds: str) -> None:
    found = hb.simulate(hb.loads(f"model: emptied\ncomponents:\n{parts}\nsimulate: {{until: 60 s}}\n"))
    assert found.time[-1] == pytest.approx(ends, rel=1e-5)
    assert found.verdict.status == "failed"
    assert adds in found.verdict.findings[0].advice
