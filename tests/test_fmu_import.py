"""FMUs as components: read without running them, run beside a diagram where that is allowed, refused elsewhere."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from collected import partly
from test_physical_limits import DRAINED

import heavebond as hb
from heavebond.cli import main
from heavebond.exchange.fmu_export import export_fmu, platform_of

COMPILER = next((found for name in ("cc", "gcc", "clang") if (found := shutil.which(name))), None)
compiled = pytest.mark.skipif(COMPILER is None, reason="no C compiler is installed")
SOURCE = Path(__file__).parent / "fmu" / "controller.c"
UNITS = """<UnitDefinitions><Unit name="mm"><BaseUnit m="1" factor="0.001"/></Unit>
<Unit name="kN"><BaseUnit kg="1" m="1" s="-2" factor="1000"/></Unit></UnitDefinitions>"""
FMI2 = f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="Controller" guid="1" description="A sampled controller">
<CoSimulation modelIdentifier="controller"/>{UNITS}<DefaultExperiment stepSize="0.02"/><ModelVariables>
<ScalarVariable name="position" valueReference="0" causality="input" description="where it is"><Real unit="mm" start="0"/>
</ScalarVariable>
<ScalarVariable name="law.gain" valueReference="1" causality="parameter" variability="fixed"><Real start="-10"/>
</ScalarVariable>
<ScalarVariable name="force" valueReference="2" causality="output" initial="calculated"><Real unit="kN"/></ScalarVariable>
<ScalarVariable name="count" valueReference="3" causality="output"><Integer/></ScalarVariable>
<ScalarVariable name="in" valueReference="4" causality="input"><Boolean start="true"/></ScalarVariable>
</ModelVariables><ModelStructure/></fmiModelDescription>"""
FMI3 = f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="Controller" instantiationToken="1" description="A sampled controller">
<CoSimulation modelIdentifier="controller"/>{UNITS}<DefaultExperiment stepSize="0.02"/><ModelVariables>
<Float64 name="position" valueReference="0" causality="input" unit="mm" start="0" description="where it is"/>
<Float64 name="law.gain" valueReference="1" causality="parameter" variability="fixed" start="-10"/>
<Float64 name="force" valueReference="2" causality="output" unit="kN"/>
<Int32 name="count" valueReference="3" causality="output"/>
<Boolean name="in" valueReference="4" causality="input" start="true"/>
</ModelVariables><ModelStructure/></fmiModelDescription>"""
FMI1 = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="1.0" modelName="C" modelIdentifier="c" guid="1" numberOfContinuousStates="0"
numberOfEventIndicators="0"><ModelVariables/></fmiModelDescription>"""
RIG = """
model: rig
components:
  cart:   {is: Mass, m: 2 t}
  spring: {is: SpringDamper, c: 20 kN/m, d: 200 N*s/m}
  wall:   {is: Fixed}
  pull:   {is: ForceSource}
  where:  {is: PositionSensor}
  controller: {is: controller.fmu, step: 40 ms, law_gain: -0.02, in_2: 1}
nodes:
  wall:  [wall.a, spring.a]
  cart:  [cart.a, spring.b, pull.a, where.a]
  gauge: [where.y, controller.position]
  force: [controller.force, pull.u]
initial: {cart.x: 50 mm, cart.v: 0 m/s}
show:
  place: {is: cart.x, unit: mm}
  force: {is: pull.u, unit: N}
simulate: {until: 2 s, every: 10 ms}
"""
# the same in the language: what is sampled at one instant is given out at the next; -0.02 kN/mm
LIKE = RIG.replace("{is: controller.fmu, step: 40 ms, law_gain: -0.02, in_2: 1}", "{is: SampleHold, T_s: 40 ms}").replace(
    "  pull: ", "  late:   {is: UnitDelay, T_s: 40 ms, u: =-20 kN/m*controller.y}\n  pull: ").replace(
    "controller.position", "controller.u").replace("controller.force", "late.y")


def make_fmu(path: Path, description: str, source: Path = SOURCE) -> Path:
    """A packed FMU, compiled where there is a compiler."""
    folder, suffix = platform_of()
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", description)
        if COMPILER:
            library = path.with_suffix(".so")
            version = ["-DFMI3"] if 'fmiVersion="3.0"' in description else []
            subprocess.run([COMPILER, "-std=c99", "-shared", "-fPIC", *version, str(source), "-o", str(library)], check=True)
            for name in (folder, f"{'darwin' if sys.platform == 'darwin' else 'linux'}64"):
                archive.write(library, f"binaries/{name}/controller{suffix}")
    return path


@pytest.fixture(params=["2.0", "3.0"])
def rig(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a diagram and the FMU in it, in both versions of the standard."""
    monkeypatch.chdir(tmp_path)
    make_fmu(tmp_path / "controller.fmu", FMI2 if request.param == "2.0" else FMI3)
    (tmp_path / "rig.yaml").write_text(RIG)
    return tmp_path


@compiled
def test_sampled_blocks_before_and_behind_an_fmu_add_no_sample(rig: Path) -> None:
    """The FMU is given what a converter reads at the same instant, and a hold behind it passes its output at once."""
    text = RIG.replace("  gauge: [where.y, controller.position]",
                       "  gauge: [where.y, adc.u]\n  read: [adc.y, controller.position]")
    text = text.replace("  pull: ", "  after: {is: SampleHold, T_s: 40 ms, u: =controller.force}\n"
                        "  adc: {is: SampleHold, T_s: 40 ms}\n  pull: ")
    run, plain = (hb.simulate(hb.loads(t), allow_fmu=True) for t in (text, RIG))
    assert np.array_equal(run["after.y"], run["controller.force"])
    # the same numbers, up to the rounding of another order of equations
    assert run.display["force"] == pytest.approx(plain.display["force"], abs=1e-4)


@compiled
def test_a_controller_in_an_fmu_is_one_in_the_language(rig: Path) -> None:
    model = hb.load("rig.yaml")
    run, like = hb.simulate(model, allow_fmu=True), hb.simulate(hb.loads(LIKE))
    assert np.ptp(like.display["force"]) > 500
    # the same events at the same instants; the numbers went through mm and kN and back
    assert run.display["place"] == pytest.approx(like.display["place"], abs=1e-6)
    assert run.display["force"] == pytest.approx(like.display["force"], abs=1e-4)
    assert run["controller.count"][-1] == 50
    assert [time for time, _ in run.events][:3] == pytest.approx([0, 0.04, 0.08])
    again = hb.simulate(model, allow_fmu=True)
    assert np.array_equal(again.display["place"], run.display["place"])


@compiled
def test_inputs_parameters_and_the_step_of_an_fmu(rig: Path) -> None:
    model = hb.load("rig.yaml")
    off = hb.simulate(model.with_parameters({"controller.in_2": 0}), allow_fmu=True)
    assert not off.display["force"].any()
    twice = hb.simulate(model.with_parameters({"controller.law_gain": "-0.04", "controller.step": "10 ms"}), allow_fmu=True)
    assert twice["controller.count"][-1] == 200
    assert twice.display["force"][1] == pytest.approx(-40e3 * 0.05)


def test_an_fmu_is_described_without_being_run(rig: Path) -> None:
    component = hb.load("rig.yaml").library.component("controller.fmu")
    assert component.summary == "A sampled controller"
    assert {n: (s.direction, s.unit.text) for n, s in component.signals.items()} == {
        "position": ("in", "m"), "in_2": ("in", "1"), "force": ("out", "N"), "count": ("out", "1")}
    assert component.parameters["law_gain"].doc == "law.gain"
    assert component.parameters["step"].default is not None
    for words in (("check", "rig.yaml"), ("library", "controller.fmu"), ("draw", "rig.yaml", "-o", "rig.svg")):
        answer = CliRunner().invoke(main, list(words))
        assert answer.exit_code == 0, answer.output


@pytest.mark.parametrize("unit", ["", ' unit="m.kg/s2"', ' unit="nothing"'])
def test_signals_without_unit_definitions(unit: str, tmp_path: Path) -> None:
    """What an FMU does not say is solved from the wires; what it says in the common way is read."""
    text = FMI2.replace(UNITS, "").replace(' unit="mm"', "").replace(' unit="kN"', unit)
    make_fmu(tmp_path / "controller.fmu", text)
    flat = hb.assemble(hb.loads(RIG, tmp_path)).flat
    assert flat.unknowns[flat.names["controller.position"]].unit.text == "m"
    assert flat.unknowns[flat.names["controller.force"]].unit.text == "N"


def test_nothing_is_run_unless_the_user_says_so(rig: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import fmpy

    monkeypatch.setattr(fmpy, "extract", lambda *_, **__: pytest.fail("the FMU was opened"))
    answer = CliRunner().invoke(main, ["run", "rig.yaml"])
    assert answer.exit_code == 2
    assert "[fmu-not-allowed]" in answer.stderr
    assert "--allow-fmu" in answer.stderr
    with pytest.raises(hb.UsageError, match="fmu-not-allowed"):
        hb.simulate(hb.load("rig.yaml"))
    with pytest.raises(hb.UsageError, match="no derivatives through"):
        hb.simulate(hb.load("rig.yaml"), allow_fmu=True, sensitivities=["cart.m"])


@compiled
def test_an_fmu_does_not_run_outside_a_simulation(rig: Path) -> None:
    """The linear system of a diagram with samples evaluates the events at the start, without a run."""
    for words in (["modes", "rig.yaml"], ["modes", "rig.yaml", "--steady"]):
        answer = CliRunner().invoke(main, words)
        assert answer.exit_code == 2, answer.output
        assert re.search(r"\[fmu-not-(run|allowed)\]", answer.stderr) and "NoneType" not in answer.stderr


@compiled
def test_a_step_beyond_the_end_of_the_run_is_stated(rig: Path) -> None:
    text = Path("rig.yaml").read_text(encoding="utf-8")
    Path("rig.yaml").write_text(re.sub(r"step: [^,}]*", "step: 1000 s", text), encoding="utf-8")
    answer = CliRunner().invoke(main, ["run", "rig.yaml", "--allow-fmu"])
    assert "1 communication point: its outputs kept their start values" in answer.stdout, answer.output


@compiled
def test_the_command_runs_it_where_it_is_allowed(rig: Path) -> None:
    answer = CliRunner().invoke(main, ["run", "rig.yaml", "--allow-fmu"])
    assert answer.exit_code == 0, answer.output
    assert "51 events" in answer.stdout


@compiled
def test_an_fmu_that_fails_is_told_with_its_own_words(rig: Path) -> None:
    model = hb.load("rig.yaml").with_parameters({"initial.cart.x": "3 m"})
    with pytest.raises(hb.SimulationError, match="fmu-failed") as caught:
        hb.simulate(model, allow_fmu=True)
    assert "controller (controller.fmu) failed at t = 0.04 s" in str(caught.value)
    assert "out of reach" in str(caught.value)


@compiled
def test_each_fmu_has_its_own_log_and_others_of_the_process_keep_theirs(tmp_path: Path) -> None:
    """The logger of the process outlives the run: an FMU that FMPy opens afterwards logs to FMPy."""
    make_fmu(tmp_path / "controller.fmu", FMI2)
    make_fmu(tmp_path / "reserve.fmu", FMI2)
    text = RIG.replace("  controller: {", "  reserve: {is: reserve.fmu, step: 40 ms}\n  controller: {")
    (tmp_path / "rig.yaml").write_text(text.replace("cart.x: 50 mm", "cart.x: 3 m"))
    program = f"""
import gc, fmpy, heavebond as hb
try:
    hb.simulate(hb.load({str(tmp_path / 'rig.yaml')!r}), allow_fmu=True)
except hb.SimulationError as error:
    print("MESSAGE", error)
gc.collect()
try:
    fmpy.simulate_fmu({str(tmp_path / 'controller.fmu')!r}, start_values={{"position": 2000}}, stop_time=1, validate=False)
except Exception as error:
    print("FAILED", error)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    first, then = done.stdout.split("FAILED")[0].split("[fmu-failed]")
    assert "controller (controller.fmu) failed" in first and then.count("out of reach") == 2


@compiled
def test_an_fmu_that_asks_for_the_end_ends_the_run_with_its_results(rig: Path) -> None:
    model = hb.load("rig.yaml").with_parameters({"controller.law_gain": 0})
    run = hb.simulate(model, allow_fmu=True)
    assert run.time[-1] == pytest.approx(0.44)  # its 11th step of 40 ms
    assert run["controller.count"][-1] == 10
    assert len(run.display["place"]) == len(run.time) == 45
    answer = CliRunner().invoke(main, ["run", "rig.yaml", "--allow-fmu", "--set", "controller.law_gain=0"])
    assert answer.exit_code == 0, answer.output
    assert "12 communication points every 0.04 s; it ended the run at t = 0.44 s" in answer.stdout


@compiled
@pytest.mark.parametrize("extra", [
    '<String name="label" valueReference="9" causality="input" start="a"/>',
    '<Binary name="label" valueReference="9" causality="input"/>',
    '<Float64 name="label" valueReference="9" causality="input" start="1"><Dimension start="100"/><Dimension start="90"/>'
    "</Float64>"])
def test_variables_that_are_no_numbers_or_too_many_keep_their_start_values(extra: str, tmp_path: Path) -> None:
    make_fmu(tmp_path / "controller.fmu", FMI3.replace("</ModelVariables>", extra + "</ModelVariables>"))
    model = hb.loads(RIG, tmp_path)
    component = model.library.component("controller.fmu")
    assert "label" not in component.signals
    assert "label keeps its start value" in component.restrictions
    assert hb.simulate(model, until=0.2, allow_fmu=True)["controller.count"][-1] == 5


CLOCKED = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="Clocked" instantiationToken="1">
INTERFACES<ModelVariables>
<Float64 name="u" valueReference="1" causality="input" start="0"/>
<Float64 name="x" valueReference="2" causality="local" start="0"/>
<Float64 name="der(x)" valueReference="3" causality="local" derivative="2"/>
<Float64 name="y" valueReference="4" causality="output" variability="discrete" clocks="10"/>
<Int32 name="n" valueReference="5" causality="output"/>
<Clock name="tick" valueReference="10" causality="input" intervalVariability="constant" INTERVAL/>
</ModelVariables><ModelStructure><Output valueReference="4"/><Output valueReference="5"/>
<ContinuousStateDerivative valueReference="3"/></ModelStructure></fmiModelDescription>"""
CO_SIMULATION = '<CoSimulation modelIdentifier="controller" hasEventMode="true"/>'
DECIMAL = 'intervalDecimal="0.3" shiftDecimal="0.1"'
CLOCKED_RIG = """model: rig
components: {part: {is: controller.fmu, step: 0.25 s, u: "=2 + 0*time/(1 s)"}}
simulate: {until: 2 s, every: 0.25 s}
"""


def clocked(path: Path, interfaces: str, interval: str = DECIMAL) -> None:
    make_fmu(path, CLOCKED.replace("INTERFACES", interfaces).replace("INTERVAL", interval), SOURCE.with_name("clocked.c"))


@compiled
@pytest.mark.parametrize(("interfaces", "interval"), [
    (CO_SIMULATION, DECIMAL), ('<ModelExchange modelIdentifier="controller"/>', DECIMAL),
    (CO_SIMULATION, 'intervalCounter="3" shiftCounter="1" resolution="10"'),
    ('<ModelExchange modelIdentifier="controller"/><CoSimulation modelIdentifier="controller"/>', DECIMAL)])
def test_the_clock_of_an_fmu_ticks_between_the_exchanges(interfaces: str, interval: str, tmp_path: Path) -> None:
    """x' = 2; y = x at the ticks 0.1, 0.4, ... s, and no number at other times; n counts the ticks."""
    clocked(tmp_path / "controller.fmu", interfaces, interval)
    run = hb.simulate(hb.loads(CLOCKED_RIG, tmp_path), allow_fmu=True)
    assert not run.verdict.findings
    ticks = np.floor((run.time - 0.1 + 1e-9)/0.3) + 1
    assert run["part.n"] == pytest.approx(ticks)
    assert run["part.y"][1:] == pytest.approx(2*(0.1 + 0.3*(ticks[1:] - 1)), abs=1e-7)


@compiled
@pytest.mark.parametrize(("interfaces", "interval"), [
    ('<CoSimulation modelIdentifier="controller"/>', DECIMAL), (CO_SIMULATION, ""),
    (CO_SIMULATION, 'intervalDecimal="0"')])
def test_a_clock_that_never_ticks_is_reported(interfaces: str, interval: str, tmp_path: Path) -> None:
    clocked(tmp_path / "controller.fmu", interfaces, interval)
    model = hb.loads(CLOCKED_RIG, tmp_path)
    assert "Its clock tick never ticks." in model.library.component("controller.fmu").restrictions
    with pytest.warns(hb.RunWarning, match=r"the clock part\.tick of an FMU never ticks"):
        run = hb.simulate(model, allow_fmu=True)
    assert run["part.n"][-1] == 0


@compiled
@pytest.mark.parametrize(("kind", "ticks"), [
    ('changing" shiftDecimal="0.1', (0.1, 0.4, 0.8, 1.3, 1.9)), ("countdown", (0.2, 0.5, 0.9, 1.4, 2.0))])
@pytest.mark.parametrize("interfaces", [CO_SIMULATION, '<ModelExchange modelIdentifier="controller"/>'])
def test_clocks_tick_at_the_instants_that_the_fmu_computes(interfaces: str, kind: str, ticks: tuple[float, ...],
                                                           tmp_path: Path) -> None:
    """An output clock, which is active at every second tick, too."""
    described = CLOCKED.replace("INTERFACES", interfaces).replace('"constant" INTERVAL', f'"{kind}"').replace(
        "</ModelVariables>", '<Float64 name="z" valueReference="6" causality="output" variability="discrete" clocks="11"/>'
        '<Clock name="second" valueReference="11" causality="output" intervalVariability="triggered"/></ModelVariables>')
    make_fmu(tmp_path / "controller.fmu", described, SOURCE.with_name("clocked.c"))
    run = hb.simulate(hb.loads(CLOCKED_RIG, tmp_path), allow_fmu=True)
    assert not run.verdict.findings
    counts = np.searchsorted(np.array(ticks) - 1e-9, run.time, side="right")
    assert run["part.n"] == pytest.approx(counts)
    seen = counts > 0
    assert run["part.y"][seen] == pytest.approx(2*np.array(ticks)[counts[seen] - 1], abs=1e-7)
    assert run["part.z"][seen] == pytest.approx(2*np.array(ticks)[(counts[seen] - 1)//2*2], abs=1e-7)


@compiled
def test_a_triggered_clock_ticks_when_its_input_rises(tmp_path: Path) -> None:
    described = CLOCKED.replace("INTERFACES", CO_SIMULATION).replace("INTERVAL", DECIMAL).replace(
        'name="tick" valueReference="10"', 'name="tick" valueReference="12"').replace('clocks="10"', 'clocks="12"').replace(
        '"constant"', '"triggered"')
    make_fmu(tmp_path / "controller.fmu", described, SOURCE.with_name("clocked.c"))
    model = hb.loads(CLOCKED_RIG.replace("u: ", 'tick: "=sin(2*pi*time/(1 s) + 0.1)", u: '), tmp_path)
    assert "ticks at a communication if the input tick has risen above 0.5" in model.library.component(
        "controller.fmu").restrictions
    run = hb.simulate(model, allow_fmu=True)
    assert run["part.n"][-1] == 2  # at 0.25 and 1.25 s
    assert run["part.y"][-1] == pytest.approx(2*1.25, abs=1e-7)


ARRAYS = """<UInt64 name="n" valueReference="8" causality="structuralParameter" variability="fixed" start="3"/>
<Float64 name="weights" valueReference="5" causality="input" unit="mm" start="1 2 3"><Dimension valueReference="8"/>
</Float64><Float64 name="scales" valueReference="6" causality="parameter" variability="fixed" start="10">
<Dimension start="2"/></Float64><Float64 name="table" valueReference="7" causality="output" unit="mm">
<Dimension start="2"/><Dimension valueReference="8"/></Float64></ModelVariables>"""


@compiled
@pytest.mark.parametrize("used", [False, True])
def test_the_elements_of_arrays_are_variables(used: bool, tmp_path: Path) -> None:
    """The table is the product of scales and weights, in the unit mm, one step late; unused elements keep their start
    values, and one start value is that of all elements."""
    make_fmu(tmp_path / "controller.fmu", FMI3.replace("</ModelVariables>", ARRAYS))
    text = RIG.replace("in_2: 1}", "in_2: 1, scales_2: 100}").replace("  gauge: [", "  gauge: [controller.weights_2, ")
    text = text if used else RIG
    model = hb.loads(text, tmp_path)
    component = model.library.component("controller.fmu")
    assert component.parameters["scales_2"].doc == "scales[2]"
    assert [name for name in component.signals if "_" in name and name != "in_2"] == [
        "weights_1", "weights_2", "weights_3", *(f"table_{i}_{k}" for i in (1, 2) for k in (1, 2, 3))]
    run = hb.simulate(model, allow_fmu=True)
    place = run["cart.x"][::4]
    assert np.ptp(place) > 0.05
    weights = [0.001 + 0*place, place if used else 0.002 + 0*place, 0.003 + 0*place]
    for i, scale in ((1, 10), (2, 100 if used else 10)):
        for k in (1, 2, 3):
            assert run[f"controller.table_{i}_{k}"][4::4] == pytest.approx(scale*weights[k - 1][:-1], rel=1e-9, abs=1e-12)


def test_an_enumeration_is_a_whole_number(tmp_path: Path) -> None:
    text = FMI2.replace('<Boolean start="true"/>', '<Enumeration declaredType="Mode" start="2"/>').replace(
        "<ModelVariables>", '<TypeDefinitions><SimpleType name="Mode"><Enumeration><Item name="a" value="1"/>'
        '<Item name="b" value="2"/></Enumeration></SimpleType></TypeDefinitions><ModelVariables>', 1)
    make_fmu(tmp_path / "controller.fmu", text)
    component = hb.loads(RIG, tmp_path).library.component("controller.fmu")
    assert component.signals["in_2"].unit.text == "1"
    assert [v.type for v in component.foreign.inputs] == ["Real", "Integer"]


def test_an_fmu_for_another_machine(rig: Path) -> None:
    with zipfile.ZipFile("controller.fmu") as old:
        description = old.read("modelDescription.xml")
    with zipfile.ZipFile("controller.fmu", "w") as new:
        new.writestr("modelDescription.xml", description)
    with pytest.raises(hb.SimulationError, match="cannot be loaded on this machine"):
        hb.simulate(hb.load("rig.yaml"), allow_fmu=True)


@pytest.mark.parametrize(("text", "said"), [
    ("nonsense", "not an FMU"), (FMI1, "written in FMI 1.0"),
    (FMI3.replace("CoSimulation", "ScheduledExecution"), "scheduled execution only"),
    (FMI2.replace('causality="output"', 'causality="local"').replace(' initial="calculated"', ""), "no outputs"),
])
def test_fmus_that_cannot_be_used(text: str, said: str, tmp_path: Path) -> None:
    if text == "nonsense":
        (tmp_path / "controller.fmu").write_text(text)
    else:
        make_fmu(tmp_path / "controller.fmu", text)
    with pytest.raises(hb.ModelError, match="fmu-un") as caught:
        hb.assemble(hb.loads(RIG, tmp_path))
    assert said in str(caught.value)
    assert caught.value.problems[0].place is not None


def test_a_misspelt_fmu_and_fmpy_missing(rig: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(hb.ModelError, match=r"Did you mean 'controller\.fmu'"):
        hb.assemble(hb.loads(RIG.replace("controller.fmu", "controler.fmu"), rig))
    (rig / "other.fmu").write_bytes((rig / "controller.fmu").read_bytes())
    monkeypatch.setitem(sys.modules, "fmpy", None)
    with pytest.raises(hb.ModelError, match=r"heavebond\[fmu\]"):
        hb.assemble(hb.loads(RIG.replace("controller.fmu", "other.fmu"), rig))


def test_fmus_that_are_no_components_do_not_disturb(rig: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from heavebond.exchange.json_schema import schema
    from heavebond.language.library import library

    (rig / "broken.fmu").write_text("nonsense")
    assert "broken.fmu" not in library([rig]).names()
    assert CliRunner().invoke(main, ["library"]).exit_code == 0
    kinds = schema(library([rig]))["definitions"]["components"]["additionalProperties"]["properties"]["is"]["enum"]
    assert "controller.fmu" in kinds and "broken.fmu" not in kinds
    hb.assemble(hb.load("rig.yaml"))


SWITCHED = """
component: Latch
summary: Notes how often a load passes a place, and kicks it.
ports: {a: translational}
parameters: {x_0: {unit: m, default: 10 mm}}
variables: {count: {unit: 1, held: 0}}
equations: |
  a.f = 0
when:
  passes: {condition: a.x > x_0, then: {count: count + 1, a.v: 0.9*a.v}}
"""


@compiled
def test_events_of_the_diagram_between_communications(rig: Path) -> None:
    """What happens in between is found by integrating again; the FMU goes through each of its steps once."""
    (rig / "latch.yaml").write_text(SWITCHED)
    more = [text.replace("nodes:", "  latch: {is: Latch}\nnodes:").replace("pull.a, ", "pull.a, latch.a, ")
            for text in (RIG, LIKE)]
    run, like = hb.simulate(hb.loads(more[0], rig), allow_fmu=True), hb.simulate(hb.loads(more[1], rig))
    passed = [time for time, name in run.events if name == "latch.passes"]
    assert passed == pytest.approx([time for time, name in like.events if name == "latch.passes"])
    assert passed and all(abs(time / 0.04 - round(time / 0.04)) > 0.01 for time in passed)
    assert run.display["place"] == pytest.approx(like.display["place"], abs=1e-5)
    assert run["controller.count"][-1] == 50


OWN = """
model: pair
components:
  other: {is: oscillator.fmu, step: 10 ms}
  wall:  {is: Fixed}
  hold:  {is: SpringDamper, c: 1 kN/m, d: 100 N*s/m}
  cart:  {is: Mass, m: 3 kg}
  push:  {is: ForceSource, u: 0 N}
nodes: {wall: [wall.a, hold.a], cart: [hold.b, cart.a, push.a]}
show: {place: {is: other.place, unit: mm}}
simulate: {until: 1 s, every: 10 ms}
"""


@compiled
def test_an_fmu_of_ours_is_a_part_of_another_diagram(tmp_path: Path) -> None:
    alone = hb.loads("""
model: oscillator
components: {wall: {is: Fixed}, spring: {is: SpringDamper, c: 80 N/m, d: 1 N*s/m}, load: {is: Mass, m: 2 kg}}
nodes: {wall: [wall.a, spring.a], load: [spring.b, load.a]}
initial: {load.x: 50 mm}
show: {place: {is: load.x, unit: mm}}
simulate: {until: 1 s, every: 10 ms}
""")
    export_fmu(alone, tmp_path / "oscillator.fmu")
    found = hb.simulate(hb.loads(OWN, tmp_path), allow_fmu=True).si["place"]
    # an output of an FMU holds from one communication to the next
    assert np.abs(found - hb.simulate(alone).si["place"]).max() < 1e-6


# for model exchange ---------------------------------------------------------------------------------------------------
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
show: {height: {is: ball.x, unit: m}, speed: {is: ball.v, unit: m/s}}
simulate: {until: 2 s, every: 20 ms}
"""
STAGE = """
model: stage
components:
  wall:   {is: Fixed}
  spring: {is: SpringDamper, c: 80 N/m, d: 3 N*s/m}
  load:   {is: Mass, m: 2 kg}
  push:   {is: ForceSource, u: 0 N}
  wave:   {is: SquareWave, T: 0.3 s, high: 1, low: 0}
  taken:  {is: SampleHold, T_s: 70 ms}
nodes: {wall: [wall.a, spring.a], load: [spring.b, load.a, push.a], wave: [wave.y, taken.u]}
initial: {load.x: 50 mm}
show: {place: {is: load.x, unit: mm}, wave: {is: wave.y, unit: 1}, taken: {is: taken.y, unit: 1}}
simulate: {until: 1 s, every: 10 ms}
"""


def model_exchange_only(model: hb.Model, path: Path, version: int, inputs: tuple[str, ...] = ()) -> Path:
    """An exported FMU without the description of its co-simulation."""
    export_fmu(model, path, inputs, version)
    with zipfile.ZipFile(path) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    files["modelDescription.xml"], removed = re.subn(
        b"<CoSimulation[^>]*/>|<CoSimulation[^>]*[^/]>.*?</CoSimulation>", b"", files["modelDescription.xml"],
        flags=re.DOTALL)
    assert removed == 1
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return path


def whole(step: str = "20 ms", until: str = "2 s") -> str:
    return f"model: w\ncomponents:\n  part: {{is: part.fmu, step: {step}}}\nsimulate: {{until: {until}, every: {step}}}\n"


@compiled
@pytest.mark.parametrize("version", partly([2, 3], 2))
def test_an_fmu_for_model_exchange_is_integrated_between_the_communications(version: int, tmp_path: Path) -> None:
    """State events and jumps of states: the rebounds of a ball."""
    model = hb.loads(BALL)
    model_exchange_only(model, tmp_path / "part.fmu", version)
    run, alone = hb.simulate(hb.loads(whole(), tmp_path), allow_fmu=True), hb.simulate(model, rtol=1e-10)
    assert np.abs(run["part.height"] - alone.si["height"]).max() < 1e-7
    assert np.abs(run["part.speed"] - alone.si["speed"])[run.time < 1.5].max() < 1e-6
    assert f"part (part.fmu, FMI {version}.0, model exchange): 101 communication points every 0.02 s; " in \
        run.statistics["fmus"][0]


@compiled
@pytest.mark.parametrize("version", partly([3, 2], 2))
def test_time_events_and_inputs_of_an_fmu_for_model_exchange(version: int, tmp_path: Path) -> None:
    """Time events between the communications, and an input that jumps at them."""
    text = STAGE.replace("push:   {is: ForceSource, u: 0 N}", "push:   {is: ForceSource}\n"
                         "  held: {is: SampleHold, T_s: 10 ms}\n  sine: {is: Sine, a: 10 N, T: 0.4 s}").replace(
        "wave: [wave", "force: [held.y, push.u], sine: [sine.y, held.u], wave: [wave")
    model_exchange_only(hb.loads(STAGE), tmp_path / "part.fmu", version, ("push.u",))
    driven = whole("10 ms", "1 s").replace("simulate", "  sine: {is: Sine, a: 10 N, T: 0.4 s}\n"
                                           "nodes: {force: [sine.y, part.push_u]}\nsimulate")
    run = hb.simulate(hb.loads(driven, tmp_path), allow_fmu=True)
    like = hb.simulate(hb.loads(text), rtol=1e-10)
    assert np.array_equal(run["part.wave"], like.si["wave"])
    assert np.array_equal(run["part.taken"], like.si["taken"])
    assert np.ptp(like.si["place"]) > 0.05
    assert np.abs(run["part.place"] - like.si["place"]).max() < 1e-8


@compiled
def test_an_fmu_for_model_exchange_that_fails_is_shown_with_its_log(tmp_path: Path) -> None:
    model_exchange_only(hb.loads(DRAINED), tmp_path / "part.fmu", 3)
    with pytest.raises(hb.SimulationError, match="fmu-failed") as caught:
        hb.simulate(hb.loads(whole("8 s", "150 s"), tmp_path), allow_fmu=True)
    assert "failed at t = 104 s" in str(caught.value)  # in the first step beyond the level of 0 at 100 s
    assert "tank.h falls below 0 m" in str(caught.value)


def test_unconnected_inputs_keep_their_declared_start_values(rig: Path) -> None:
    """Of an FMU, of a component and of a block; `check` and `run` list them."""
    text = RIG.replace(", in_2: 1", "").replace("components:", "components:\n  own: {is: Own}\n  block: {is: Whole}")
    Path("own.yaml").write_text("component: Own\nsummary: A law.\nports: {u: {signal: in, unit: V, default: 2 V}, "
                                "y: {signal: out, unit: V}}\nequations: y = 3*u\n")
    Path("whole.yaml").write_text("component: Whole\nsummary: A block.\nports: {u: {signal: in, unit: V, default: 5 mV}, "
                                  "y: {signal: out, unit: V}}\ncomponents: {law: {is: Own}}\n"
                                  "nodes: {u: [u, law.u], y: [law.y, y]}\n")
    Path("rig.yaml").write_text(text)
    expected = "controller.in_2 = 1.0"
    answer = CliRunner().invoke(main, ["check", "rig.yaml"])
    assert answer.exit_code == 0, answer.output
    shown = " ".join(answer.stdout.split())
    assert "unconnected own.u = 2 V, block.u = 5 mV, controller.in_2 = 1.0 (start value of the input)" in shown, shown
    assert hb.assemble(hb.load("rig.yaml")).flat.expanded.defaults.keys() == {"own.u", "block.u", "controller.in_2"}
    if COMPILER:
        run = hb.simulate(hb.load("rig.yaml"), until="0.2 s", allow_fmu=True)
        assert (run["own.y"][-1], run["block.y"][-1]) == (6, pytest.approx(0.015))
        assert run["controller.force"][-1] != 0  # it is on
        answer = CliRunner().invoke(main, ["run", "rig.yaml", "--until", "0.2 s", "--allow-fmu"])
        assert expected in answer.stdout
    wrong = Path("own.yaml").read_text().replace("y: {signal: out, unit: V}", "y: {signal: out, unit: V, default: 1 V}")
    Path("own.yaml").write_text(wrong)
    with pytest.raises(hb.ModelError, match="'y' cannot have a default"):
        hb.assemble(hb.load("rig.yaml"))
