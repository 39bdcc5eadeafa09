"""Diagrams as C and as FMUs: compiled, called, and simulated by another program to the same result."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import zipfile
from pathlib import Path
from xml.etree import ElementTree as Xml

import fmpy
import numpy as np
import pytest
from click.testing import CliRunner
from collected import partly
from fmpy.fmi3 import FMU3Model
from fmpy.validation import validate_fmu

import heavebond as hb
from heavebond.cli import main
from heavebond.exchange.c_code import c_name, c_text, export_c
from heavebond.exchange.fmu_export import export_fmu
from heavebond.exchange.portable import Portable, portable
from heavebond.language.library import bundled
from heavebond.numerics.result import with_held

COMPILER = next((found for name in ("cc", "gcc", "clang") if (found := shutil.which(name))), None)
compiled = pytest.mark.skipif(COMPILER is None, reason="no C compiler is installed")

# two orifices in series with nothing between them: their common pressure is an algebraic unknown
LOOP = """
model: loop
components:
  pump:   {is: FlowSource, u: 12 L/min}
  oil:    {is: Volume, V: 2 L, beta: 1.5 GPa}
  first:  {is: Orifice, q_r: 20 L/min, dp_r: 10 bar}
  second: {is: Orifice, q_r: 10 L/min, dp_r: 10 bar}
  tank:   {is: Tank}
nodes:
  inlet:  [pump.a, oil.a, first.a]
  middle: [first.b, second.a]
  back:   [second.b, tank.a]
show:
  inlet:  {is: inlet.p, unit: bar}
  middle: {is: middle.p, unit: bar}
  flow:   {is: second.q, unit: L/min}
simulate: {until: 1 s, every: 10 ms}
"""
DRIVEN = """
model: driven
components:
  heave:  {is: Sine, a: 0.1 m, T: 2 s}
  deck:   {is: PositionSource}
  spring: {is: SpringDamper, c: 4 kN/m, d: 300 N*s/m}
  load:   {is: Mass, m: 100 kg}
  push:   {is: ForceSource, u: 20 N}
nodes:
  heave: [heave.y, deck.u]
  deck:  [deck.a, spring.a]
  load:  [spring.b, load.a, push.a]
initial: {start: rest, load.x: 5 mm}
show:
  load: {is: load.x, unit: mm}
  warm: {is: load.x*1 K/1 m, unit: degC}
simulate: {until: 2 s, every: 10 ms}
"""


def call(*words: str) -> object:
    return CliRunner().invoke(main, list(words))


@pytest.fixture(autouse=True)
def compiler_of_users(monkeypatch: pytest.MonkeyPatch) -> None:
    """FMUs with the flags of `export`; other files of tests compile them with fewer optimisations."""
    monkeypatch.delenv("CC", raising=False)


class Compiled:
    """A C file of heavebond, compiled and called through ctypes."""

    def __init__(self, made: Portable, path: Path):
        library = path.with_suffix(".so")
        assert COMPILER
        flags = ["-O1", "-std=c99", "-Wall", "-Wextra", "-Werror", "-Wpedantic", "-shared", "-fPIC"]
        subprocess.run([COMPILER, *flags, str(path), "-o",
                        str(library), "-lm"], check=True)
        self.made, self.prefix, self.library = made, c_name(path.stem), ctypes.CDLL(str(library))

    def start(self, letter: str, n: int) -> np.ndarray:
        return np.array((ctypes.c_double * n).in_dll(self.library, f"{self.prefix}_{letter}_start"))

    def __call__(self, t: float, *given: np.ndarray) -> tuple[int, np.ndarray, np.ndarray, np.ndarray]:
        x, z, p, u = (np.array(g, float) for g in given)
        dx, y = np.zeros(max(1, len(x))), np.zeros(max(1, len(self.made.outputs)))
        pointers = [a.ctypes.data_as(ctypes.c_void_p) for a in (x, z, p, u, dx, y)]
        code = getattr(self.library, f"{self.prefix}_evaluate")(ctypes.c_double(t), *pointers)
        return code, dx[: len(x)], y[: len(self.made.outputs)], z


def check_agreement(model: hb.Model, folder: Path) -> None:
    """The C of a diagram gives the rates, outputs and algebraic unknowns of its run, at three points of it."""
    code = Compiled(export_c(model, folder / "m.c"), folder / "m.c")
    run = hb.simulate(model)
    p, u, own = run.p, np.zeros(0), len(code.made.parameters)  # held variables stand behind the parameters in a run
    assert not code.made.inputs
    assert np.array_equal(code.start("p", own), p[:own])
    assert np.array_equal(code.start("x", len(run.x)), run.start.x)
    rates = run.assembly.rates
    # conditions on the clock are held variables of the run, set at its events; the C reads them from its time
    held = with_held(run, p, run.held)
    largest = np.abs(np.array(rates(run.time[None, :], run.x, run.z, held, np.zeros((0, 1)), 1.0)[0])).max(axis=1)
    for k in (0, len(run.time) // 3, len(run.time) - 1):
        # from a guess some 20 % off: the algebraic unknowns have to be found. A guess that is further away can lead to
        # another solution: a rod on a sphere has two heights
        largest_z = np.abs(run.z).max(axis=1, initial=0.0)
        guess = 0.8 * run.z[:, k] + np.where(largest_z > 0, np.minimum(0.2 * largest_z, 1.0), 1.0)
        status, dx, y, z = code(run.time[k], run.x[:, k], guess, p, u)
        assert status == 0
        # at the algebraic unknowns that were found, which are compared below
        exact = np.array(rates(run.time[k], run.x[:, k], z, held[:, k], u, 1.0)[0]).ravel()
        # the same formulas; sums of terms that cancel are rounded in another way, by 1e-16 of the terms
        assert np.all(np.abs(dx - exact) <= 1e-12 * largest + 1e-15), (dx, exact)
        # 1e-15 of the largest of the run: rates of pressure at rest, too, are sums that cancel
        near = 1e-9*np.abs(run.z[:, k]) + 1e-15*np.abs(run.z).max(axis=1, initial=0.0) + 1e-12
        assert np.all(np.abs(z - run.z[:, k]) <= near), (z, run.z[:, k])
        for output, value in zip(code.made.outputs, y, strict=True):
            course = run.display[output.name]
            assert value == pytest.approx(course[k], rel=1e-9, abs=1e-12 + 1e-9 * np.abs(course).max()), output.name


@compiled
@pytest.mark.parametrize("name", ["passive_rig", "cmc_ahc", "receiver_rig", "LOOP"])
def test_compiled_c_gives_the_same_rates_and_outputs(name: str, tmp_path: Path) -> None:
    check_agreement(hb.loads(LOOP) if name == "LOOP" else hb.load(name), tmp_path)


@compiled
@pytest.mark.slow
def test_every_example_of_the_library_as_c(tmp_path: Path) -> None:
    switched = []
    examples = sorted((bundled("models") / "examples").glob("*.yaml"))
    for path in examples:
        model = hb.load(path)
        flat = hb.assemble(model).flat
        if not all(event.by_clock for event in flat.events):
            switched.append(path.stem)  # see test_c_events.py
        elif not flat.inputs and not flat.delays:  # a record becomes an input; see test_c_delays.py
            (tmp_path / path.stem).mkdir()
            check_agreement(model, tmp_path / path.stem)
    assert "sample_hold" in switched and len(switched) < len(examples)/10, switched


@compiled
def test_c_says_where_the_algebraic_unknowns_are_not_found(tmp_path: Path) -> None:
    code = Compiled(export_c(hb.loads(LOOP), tmp_path / "m.c"), tmp_path / "m.c")
    made = code.made
    x, z, p = code.start("x", 1), code.start("z", len(made.algebraic)), code.start("p", len(made.parameters))
    assert code(0.0, x, z, p, np.zeros(1))[0] == 0
    assert code(0.0, np.full_like(x, np.nan), z, p, np.zeros(1))[0] == 1


def test_the_head_of_the_c_lists_everything() -> None:
    made = portable(hb.loads(DRIVEN), ["deck.u"], "rig_equations")
    text = c_text(made, "rig")
    head = text[: text.index("*/", text.index("y[1]"))]
    for words in ("x[0]", "load.v", "m/s", "spring.c", "4000", "u[0]  deck.u", "u[1]  der(deck.u)", "y[0]", "mm", "degC"):
        assert words in head
    assert [q.name for q in made.inputs] == ["deck.u", "der(deck.u)"]
    assert made.inputs[1].start == pytest.approx(0.1 * 2 * np.pi * 0.5)


@pytest.mark.parametrize(("text", "name"), [("rig", "rig"), ("2 rig-a", "m_2_rig_a"), ("for", "m_for"), ("_x", "m__x")])
def test_names_in_c(text: str, name: str) -> None:
    assert c_name(text) == name


def test_measured_inputs_become_inputs(tmp_path: Path) -> None:
    times = np.arange(0, 0.5, 0.01)
    np.savetxt(tmp_path / "heave.csv", np.column_stack([times, 0.1 + 0.2 * times + times**2]), delimiter=",", header="t,z",
               comments="")
    text = DRIVEN.replace("{is: PositionSource}", "{is: PositionSource, u: {file: heave.csv, column: z, unit: m, "
                          "interpolation: spline}}").replace("[heave.y, deck.u]", "[heave.y]")
    made = portable(hb.loads(text, tmp_path))
    assert {q.name: q.start for q in made.inputs} == pytest.approx({"deck.u": 0.1, "der(deck.u)": 0.2})
    assert not any(shown for q, shown in zip(made.parameters, made.tunable, strict=True) if q.name == "scale.deck.u")


# -- FMU -------------------------------------------------------------------------------------------------------------
@pytest.mark.long
@compiled
@pytest.mark.parametrize("name", ["passive_rig", "cmc_ahc", "LOOP"])
def test_fmpy_simulates_an_fmu_to_the_same_result(name: str, tmp_path: Path) -> None:
    model = hb.loads(LOOP) if name == "LOOP" else hb.load(name)
    path = tmp_path / "m.fmu"
    export_fmu(model, path)
    assert validate_fmu(str(path)) == []
    run = hb.simulate(model)
    found = fmpy.simulate_fmu(str(path), fmi_type="ModelExchange", solver="CVode", relative_tolerance=1e-9,
                              stop_time=float(run.time[-1]), output_interval=float(run.time[1]), record_events=False)
    assert found.dtype.names[1:] == tuple(model.show)
    assert len(found) == len(run.time)
    for output in model.show:
        exact = run.display[output]
        # two integrators with errors of 1e-8 and 1e-9 a step, over thousands of steps
        assert np.abs(found[output] - exact).max() < 1e-4 * np.abs(exact).max(), output


@compiled
def test_parameters_inputs_and_units_of_an_fmu(tmp_path: Path) -> None:
    model, path = hb.loads(DRIVEN), tmp_path / "driven.fmu"
    export_fmu(model, path, ["deck.u", "push.u"])
    known = {v.name: v for v in fmpy.read_model_description(str(path)).modelVariables}
    assert {n for n, v in known.items() if v.causality == "input"} == {"deck.u", "der(deck.u)", "push.u"}
    assert (known["push.u"].start, known["push.u"].unit) == ("20.0", "N")
    assert (known["spring.d"].unit, known["spring.d"].variability, known["spring.d"].min) == ("N.s/m", "tunable", "0.0")
    assert not any(name.startswith(("scale.", "initial.")) for name in known)
    units = {u.name: u.baseUnit for u in fmpy.read_model_description(str(path)).unitDefinitions}
    assert (units["N.s/m"].kg, units["N.s/m"].m, units["N.s/m"].s) == (1, 0, -1)
    assert (units["mm"].m, units["mm"].factor, units["degC"].offset) == (1, 0.001, 273.15)
    times = np.arange(4001) * 0.0005
    signals = np.array(list(zip(times, 0.05 * times**2, 0.1 * times, 10 + 0 * times, strict=True)),
                       dtype=[(n, float) for n in ("time", "deck.u", "der(deck.u)", "push.u")])
    found = fmpy.simulate_fmu(str(path), fmi_type="ModelExchange", solver="CVode", relative_tolerance=1e-9, stop_time=2.0,
                              output_interval=0.0005, input=signals, start_values={"spring.c": 6000.0}, record_events=False)
    free = hb.loads(DRIVEN.replace("[heave.y, deck.u]", "[heave.y]"))
    run = hb.simulate(free.with_parameters({"deck.u": "=0.05 m/s**2*time**2", "push.u": "10 N", "spring.c": "6 kN/m"}))
    # FMPy holds an input over a step of 0.5 ms, in which the deck moves by 0.1 mm at most
    assert found["load"][::20] == pytest.approx(run.display["load"], abs=0.1)
    assert np.ptp(run.display["load"]) > 50


@compiled
@pytest.mark.parametrize(("name", "given"), [("LOOP", "first.q_r"), ("DRIVEN", "deck.u"),
                                             pytest.param("cmc_ahc", "crown.m", marks=pytest.mark.long)])
def test_the_directional_derivatives_of_an_fmu_are_exact(name: str, given: str, tmp_path: Path) -> None:
    """By states they are the matrices of the linearised machine; by an input or a parameter what differences say."""
    model = hb.loads({"LOOP": LOOP, "DRIVEN": DRIVEN}[name]) if name.isupper() else hb.load(name)
    made = export_fmu(model, tmp_path / "m.fmu", [given] if given.endswith(".u") else [])
    told = fmpy.read_model_description(str(tmp_path / "m.fmu"))
    xml = Xml.fromstring(zipfile.ZipFile(tmp_path / "m.fmu").read("modelDescription.xml"))
    assert xml.find("ModelExchange").get("providesDirectionalDerivatives") == "true"
    numbers = {v.name: v.valueReference for v in told.modelVariables}
    fmu = FMU3Model(guid=told.guid, unzipDirectory=fmpy.extract(str(tmp_path / "m.fmu")), instanceName="m",
                    modelIdentifier=told.modelExchange.modelIdentifier)
    fmu.instantiate()
    try:
        fmu.enterInitializationMode()
        fmu.exitInitializationMode()
        states = [numbers[q.name] for q in made.states]
        sides = [numbers[f"der({q.name})"] for q in made.states], [numbers[name] for name in model.show]
        system = hb.state_space(model, [given], list(model.show)).displayed()  # an FMU's outputs are in their units
        for side, exact in zip(sides, (system.a, system.c), strict=True):
            found = np.array([fmu.getDirectionalDerivative(side, [k], [1.0]) for k in states]).T
            assert found == pytest.approx(exact, rel=1e-9, abs=1e-12 * np.abs(exact).max())
            along = fmu.getDirectionalDerivative(side, states, list(range(1, 1 + len(states))))
            assert along == pytest.approx(exact @ np.arange(1, 1 + len(states)), rel=1e-9, abs=1e-9 * np.abs(exact).max())
        fmu.setFloat64(states, [q.start + 0.3 * q.nominal for q in made.states])  # away from where a slope may be nothing
        start, = fmu.getFloat64([numbers[given]])
        step = 1e-5 * max(abs(start), 0.1)
        unknowns, ends = [*sides[0], *sides[1]], []
        for value in (start - step, start + step):
            fmu.setFloat64([numbers[given]], [value])
            ends.append(np.array(fmu.getFloat64(unknowns)))
        fmu.setFloat64([numbers[given]], [start])
        slope = np.array(fmu.getDirectionalDerivative(unknowns, [numbers[given]], [1.0]))
        assert np.abs(slope).max() > 0
        # central differences: rounding of 1e-16/1e-5 and a curvature of 1e-10
        assert slope == pytest.approx((ends[1] - ends[0]) / (2 * step), rel=1e-4, abs=1e-6 * np.abs(slope).max())
        with pytest.raises(fmpy.fmi1.FMICallException):
            fmu.getDirectionalDerivative(states, states[:1], [1.0])
    finally:
        fmu.freeInstance()


@compiled
def test_an_fmu_brings_its_sources_and_is_the_same_each_time(tmp_path: Path) -> None:
    for name in "ab":
        export_fmu(hb.loads(LOOP), tmp_path / f"{name}.fmu")
    a, b = (zipfile.ZipFile(tmp_path / f"{name}.fmu") for name in "ab")
    assert {"modelDescription.xml", "sources/model.c", "sources/fmi3.c", "sources/buildDescription.xml"} < set(a.namelist())
    assert a.read("modelDescription.xml") == b.read("modelDescription.xml")
    assert Xml.fromstring(a.read("modelDescription.xml")).get("instantiationToken") in a.read("sources/model.c").decode()
    without_warnings(tmp_path / "a.fmu", "fmi3.c")


@compiled
def test_the_sources_of_an_fmu_with_events_give_no_warning(tmp_path: Path) -> None:
    export_fmu(hb.load("circuits/tank_level"), tmp_path / "m.fmu", version=2)
    without_warnings(tmp_path / "m.fmu", "fmi2.c")


def without_warnings(fmu: Path, source: str) -> None:
    """The sources of an FMU are those of C99 for a compiler that looks closely."""
    zipfile.ZipFile(fmu).extractall(fmu.parent / "unpacked")
    assert COMPILER is not None
    subprocess.run([COMPILER, "-fsyntax-only", "-std=c99", "-Wall", "-Wextra", "-Wshadow", "-Wpedantic", "-Werror", source],
                   cwd=fmu.parent / "unpacked" / "sources", check=True)


def test_names_of_outputs_that_are_taken(tmp_path: Path) -> None:
    from heavebond.exchange.fmu_export import description

    text = LOOP.replace("inlet:  {is: inlet.p, unit: bar}", "inlet.p: {unit: bar}")
    names = [v.get("name") for v in Xml.fromstring(description(portable(hb.loads(text)), "m", "t")).iter("Float64")]
    assert len(set(names)) == len(names)
    assert {"inlet.p", "show.inlet.p"} < set(names)


# -- messages --------------------------------------------------------------------------------------------------------
@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "driven.yaml").write_text(DRIVEN)
    return tmp_path


@pytest.mark.parametrize(("words", "code", "said"), [
    (("driven.yaml", "-o", "m.exe"), "file-suffix", ".c or .mo"), (("driven.yaml",), "option-missing", "-o cmc_ahc.fmu"),
    (("driven.yaml", "-o", "m.c", "--input", "deck.v"), "input-unknown", "Did you mean 'deck.u'"),
    (("driven.yaml", "-o", "m.c", "--input", "nothing"), "input-unknown", "Signal inputs: "),
    (("driven.yaml", "-o", "nowhere/m.c"), "file-unwritable", "find the folder"),
    (("driven.yaml", "-o", "m.c", "--set", "spring.k=1 N/m"), "setting-unknown", "spring.c"),
])
def test_wrong_usage(folder: Path, words: tuple[str, ...], code: str, said: str) -> None:
    answer = call("export", *words)
    assert answer.exit_code == 2
    assert f"[{code}]" in answer.stderr
    assert said in answer.stderr
    assert not list(folder.glob("m.*"))


def test_without_a_compiler(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", str(folder))
    answer = call("export", "driven.yaml", "-o", "m.fmu")
    assert answer.exit_code == 2
    assert "[compiler-missing]" in answer.stderr
    assert "-o model.c" in answer.stderr
    assert call("export", "driven.yaml", "-o", "m.c").exit_code == 0


@pytest.mark.skipif(os.name == "nt", reason="needs a script as compiler")
def test_a_compiler_that_fails(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "badcc").write_text("#!/bin/sh\necho 'x.c:1: error: no such processor' >&2\nexit 1\n")
    (folder / "badcc").chmod(0o755)
    monkeypatch.setenv("CC", str(folder / "badcc"))
    answer = call("export", "driven.yaml", "-o", "m.fmu")
    assert answer.exit_code == 2
    assert "no such processor" in answer.stderr


@compiled
def test_the_command_tells_what_it_wrote(folder: Path) -> None:
    answer = call("export", "driven.yaml", "-o", "m.fmu", "--input", "deck.u", "--json", "out.json")
    assert answer.exit_code == 0, answer.output
    assert "der(deck.u)" in answer.stdout
    assert "wrote m.fmu" in answer.stdout
    assert zipfile.is_zipfile(folder / "m.fmu")


@compiled
@pytest.mark.parametrize("version", partly([2, 3], 2))
def test_an_fmu_has_a_picture_documentation_a_licence_and_local_variables(version: int, tmp_path: Path) -> None:
    from lxml import etree

    path, model = tmp_path / "driven.fmu", hb.loads(DRIVEN)
    exported = hb.export(model, path, fmi=version, inputs=["deck.u"], locals=["spring.F", "load.x"], picture=hb.draw(model))
    assert exported.locals == 1  # load.x is a state
    assert validate_fmu(str(path)) == []
    local = {v.name: v.causality for v in fmpy.read_model_description(str(path)).modelVariables}
    assert local["spring.F"] == "local"
    found = fmpy.simulate_fmu(str(path), output=["spring.F"], stop_time=1, output_interval=0.1, start_values={"deck.u": 0.1})
    assert found["spring.F"][-1] != 0
    with zipfile.ZipFile(path) as archive:
        names, page = set(archive.namelist()), archive.read("documentation/index.html").decode()
        assert "<td>deck.u</td><td>m</td>" in page and "spring.d" in page
        assert b"MIT License" in archive.read("documentation/licenses/license.txt")
        icons = {"terminalsAndIcons/icon.png", "terminalsAndIcons/icon.svg"} if version == 3 else {"model.png"}
        assert {*icons, "documentation/diagram.svg"} <= names
        if version == 3:
            schema = Path(fmpy.__file__).parent / "schema" / "fmi3" / "fmi3TerminalsAndIcons.xsd"
            terminals = etree.fromstring(archive.read("terminalsAndIcons/terminalsAndIcons.xml"))
            etree.XMLSchema(etree.parse(str(schema))).assertValid(terminals)
            assert [t.get("name") for t in terminals.iter("Terminal")] == ["deck.u", "outputs"]
    with pytest.raises(hb.UsageError, match=r"no variable 'spring\.G'"):
        hb.export(model, path, locals=["spring.G"])
