"""Functions in C, in shared libraries and in Python beside the same law as a formula."""

from __future__ import annotations

import ctypes
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from collected import partly

import heavebond as hb
from heavebond.cli import NAMES, main
from heavebond.numerics.machine_code import compiler

pytestmark = pytest.mark.skipif(compiler() is None, reason="there is no C compiler")

SOURCE = """\
#include "shape.h"
double hard_spring(double s, double c) { return c*s*(1 + HARDENING*s*s); }
void hard_spring_slopes(double s, double c, double *d) { d[0] = c*(1 + 3*HARDENING*s*s); d[1] = s*(1 + HARDENING*s*s); }
int hard_spring_20(double *inarr, int inputs, double *outarr, int outputs, int major)
{ outarr[0] = hard_spring(inarr[0], inarr[1]); return inputs != 2 || outputs != 1; }
"""
PYTHON = """\
from pathlib import Path
Path(__file__).with_name("executed").touch()
def hard_spring(s, c):
    return c*s*(1 + s*s)
"""
FUNCTION = """\
function: hard_spring
is: external
summary: Force of a hardening spring.
file: {file}
inputs:
  s: {{unit: m, {s}doc: elongation}}
  c: {{unit: N/m, {c}doc: stiffness}}
outputs:
  F: {{unit: N, doc: force}}
"""
SIZED = {"s": "nominal: 0.1 m, ", "c": "nominal: 1 kN/m, "}
PLAIN = {"s": "", "c": ""}
FORMULA = FUNCTION.format(file="", **PLAIN).replace("is: external\n", "").replace("file: \n", "").replace(
    "outputs:", "constants:\n  l: {unit: m, value: 1 m}\noutputs:") + "equations: |\n  F = c*s*(1 + (s/l)**2)\n"
FORMS = {
    "differences": FUNCTION.format(file="law.c", **SIZED),
    "derivatives": FUNCTION.format(file="law.c\nderivatives: hard_spring_slopes", **PLAIN),
    "20-sim": FUNCTION.format(file="law.c\ncall: hard_spring_20\nsignature: 20-sim", **SIZED),
    "library": FUNCTION.format(file="law.so", **SIZED),
    "python": FUNCTION.format(file="law.py", **SIZED)}
SPRING = """\
component: Hard
summary: Hardening spring by a function.
ports: {a: translational, b: translational}
parameters: {c: {unit: N/m, doc: stiffness}}
variables: {s: {unit: m, doc: elongation}, F: {unit: N, doc: force}}
equations: |
  s = b.x - a.x          # elongation
  F = hard_spring(s, c)  # law
  b.f = F                # force
  a.f = -F               # reaction
power: controlled, the law is a program
"""
RIG = """\
model: rig
components:
  wall:   {is: Fixed}
  part:   {is: Hard, c: 100 N/m}
  body:   {is: Mass, m: 1 kg}
  damper: {is: Damper, d: 0.5 N*s/m}
nodes: {wall: [wall.a, part.a, damper.a], body: [part.b, body.a, damper.b]}
initial: {body.x: 0.5 m, body.v: 0 m/s}
show: {x: {is: body.x, unit: m}, F: {is: part.F, unit: N}}
simulate: {until: 2 s, every: 10 ms}
"""


def folder(path: Path, function: str) -> Path:
    """A folder with the rig and the function in one of its forms."""
    path.mkdir(exist_ok=True)
    for name, text in (("law.c", SOURCE), ("shape.h", "#define HARDENING 1.0\n"), ("law.py", PYTHON),
                       ("hard_spring.yaml", function), ("hard.yaml", SPRING), ("rig.yaml", RIG)):
        (path / name).write_text(text)
    return path


@pytest.fixture(scope="module")
def formula(tmp_path_factory: pytest.TempPathFactory) -> hb.Model:
    return hb.load(folder(tmp_path_factory.mktemp("formula"), FORMULA) / "rig.yaml")


def difference(one: hb.Result, other: hb.Result, name: str) -> float:
    return float(np.abs(one.si[name] - other.si[name]).max() / np.ptp(other.si[name]))


@pytest.mark.parametrize("form", FORMS)
def test_a_program_runs_as_its_formula(form: str, tmp_path: Path, formula: hb.Model) -> None:
    """To the error of the integration (rtol 1e-8) in values, sensitivities and modes. Differences of order 2 with steps of
    6e-6 have errors of 1e-10."""
    path = folder(tmp_path, FORMS[form])
    if form == "library":
        subprocess.run([str(compiler()), "-shared", "-fPIC", "-o", "law.so", "law.c"], cwd=path, check=True)
    model = hb.load(path / "rig.yaml", allow_native=True)
    exact, run = (hb.simulate(m, "0.1 s", sensitivities=["part.c"]) for m in (formula, model))
    for name in ("x", "F"):
        assert difference(run, exact, name) < 1e-6
    slopes = [r.sensitivity("x", "part.c") for r in (exact, run)]
    assert np.abs(slopes[1] - slopes[0]).max() < 1e-6*np.abs(slopes[0]).max()
    poles, wanted = (sorted(np.asarray([mode.value for mode in hb.modes(m).modes]), key=lambda s: (s.real, s.imag))
                     for m in (model, formula))
    np.testing.assert_allclose(poles, wanted, rtol=1e-7)


def test_a_program_is_differentiated_for_a_constraint(tmp_path: Path) -> None:
    """The carriage on a guide y = f(x): its velocity and acceleration are the first and second derivative of the program."""
    guide = """\
component: Guide
summary: A follower on a curve.
ports: {a: translational, b: translational}
parameters: {c: {unit: N/m, doc: scale}}
variables: {F: {unit: N, doc: force}}
equations: |
  b.x * 1 = hard_spring(a.x, c)   # curve
  b.f = F
  a.f = -F
units: unchecked
power: controlled, the curve is not checked
"""
    rig = """\
model: follower
components:
  hand:  {is: PositionSource, u: "=0.3 m*sin(2*time/1 s)"}
  guide: {is: Guide, c: 1 N/m}
  mass:  {is: Mass, m: 2 kg}
nodes: {hand: [hand.a, guide.a], mass: [guide.b, mass.a]}
show: {f: {is: mass.a.f, unit: N}}
simulate: {until: 2 s, every: 10 ms}
"""
    runs = []
    for name, function in (("formula", FORMULA), ("differences", FORMS["differences"]), ("given", FORMS["derivatives"])):
        path = folder(tmp_path / name, function)
        (path / "guide.yaml").write_text(guide)
        (path / "follower.yaml").write_text(rig)
        runs.append(hb.simulate(hb.load(path / "follower.yaml", allow_native=True)))
    assert difference(runs[2], runs[0], "f") < 1e-8  # the second derivative by differences of exact ones
    assert difference(runs[1], runs[0], "f") < 1e-5  # by differences of differences, with steps of 3e-4


def test_lists_and_several_outputs_of_a_program(tmp_path: Path) -> None:
    (tmp_path / "sums.c").write_text("""
void sums_of(const double *x, int n, double k, double *total, double *scaled)
{ int i; *total = 0; for (i = 0; i < n; ++i) { *total += x[i]; scaled[i] = k*x[i]; } }
""")
    (tmp_path / "sums_of.yaml").write_text("""\
function: sums_of
is: external
summary: Sum and multiple of a list.
file: sums.c
inputs: {x: {unit: m, count: n, nominal: 1 m}, k: {unit: 1, nominal: 1}}
outputs: {total: {unit: m}, scaled: {unit: m, count: n}}
""")
    (tmp_path / "adder.yaml").write_text("""\
component: Adder
summary: A sum.
ports: {u: {signal: in, unit: m}, y: {signal: out, unit: m}, z: {signal: out, unit: m}}
equations: |
  y = sums_of([u, 2*u, 3*u], 4).total
  z = sum(sums_of([u, 2*u, 3*u], 4).scaled)
""")
    model = hb.loads("""
model: sums
components: {part: {is: Adder, u: "=1 m*time/1 s"}}
show: {y: {is: part.y, unit: m}, z: {is: part.z, unit: m}}
simulate: {until: 1 s, every: 0.1 s}
""", tmp_path, allow_native=True)
    found = hb.simulate(model)
    np.testing.assert_allclose(found.si["y"], 6*found.time, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(found.si["z"], 24*found.time, rtol=1e-12, atol=1e-15)


def test_nothing_is_executed_without_permission(tmp_path: Path) -> None:
    path = folder(tmp_path, FORMS["python"])
    model = hb.load(path / "rig.yaml")
    with pytest.raises(hb.ModelError, match="native-not-allowed") as error:
        hb.simulate(model)
    assert "--allow-native" in str(error.value) and "allow_native=True" in str(error.value)
    assert not (path / "executed").exists()
    hb.simulate(hb.load(path / "rig.yaml", allow_native=True))
    assert (path / "executed").exists()
    with pytest.raises(hb.ModelError, match="native-not-allowed"):  # the permission belongs to the other diagram
        hb.simulate(hb.load(path / "rig.yaml"))


def test_a_program_that_does_not_compile_shows_what_the_compiler_found(tmp_path: Path) -> None:
    path = folder(tmp_path, FORMS["differences"])
    (path / "law.c").write_text(SOURCE.replace("c*s*(1", "c*t*(1"))
    with pytest.raises(hb.ModelError, match="native-not-compiled") as error:
        hb.simulate(hb.load(path / "rig.yaml", allow_native=True))
    assert "law.c:2" in str(error.value) and "`double hard_spring(double s, double c)`" in str(error.value)
    (path / "law.c").unlink()
    with pytest.raises(hb.ModelError, match="native-missing"):
        hb.simulate(hb.load(path / "rig.yaml", allow_native=True))


@pytest.mark.long
@pytest.mark.parametrize("form", ["differences", "python"])
def test_a_result_that_is_not_a_number_names_the_function_and_its_arguments(form: str, tmp_path: Path) -> None:
    path = folder(tmp_path, FORMS[form])
    (path / "law.c").write_text("#include <math.h>\n"
                                "double hard_spring(double s, double c) { return s < 0.3 ? NAN : c*s; }\n")
    (path / "law.py").write_text("def hard_spring(s, c):\n    return float('nan') if s < 0.3 else c*s\n")
    with pytest.raises(hb.SimulationError) as error:
        hb.simulate(hb.load(path / "rig.yaml", allow_native=True))
    assert re.search(r"hard_spring gave a result that is not a number for s = 0\.2\d* m, c = 100 N/m", str(error.value))


def test_exported_c_contains_the_program(tmp_path: Path) -> None:
    """The file compiles by itself, and its rates are those of the formula to rounding."""
    path = folder(tmp_path, FORMS["derivatives"])
    target = path / "out" / "machine.c"
    target.parent.mkdir()
    exported = hb.export(hb.load(path / "rig.yaml", allow_native=True), target)
    subprocess.run([str(compiler()), "-std=c99", "-Wall", "-Werror", "-shared", "-fPIC", "-o", "machine.so", "machine.c",
                    "-lm"], cwd=target.parent, check=True)
    library = ctypes.CDLL(str(target.parent / "machine.so"))
    x = np.array([0.3, 0.7])
    p = np.array([q.start for q in exported.parameters])
    rates, y = np.zeros(2), np.zeros(2)
    pointers = [a.ctypes.data_as(ctypes.c_void_p) for a in (x, np.zeros(1), p, np.zeros(1), rates, y)]
    assert library.machine_evaluate(ctypes.c_double(0.0), *pointers) == 0
    place = [q.name for q in exported.states].index("body.x")
    force = 100*x[place]*(1 + x[place]**2)
    np.testing.assert_allclose(y, [x[place], force], rtol=1e-14)
    np.testing.assert_allclose(rates[1 - place], -force - 0.5*x[1 - place], rtol=1e-14)


def test_python_is_not_exported(tmp_path: Path) -> None:
    path = folder(tmp_path, FORMS["python"])
    with pytest.raises(hb.ModelError, match="native-not-exported") as error:
        hb.export(hb.load(path / "rig.yaml", allow_native=True), path / "machine.c")
    assert "law.c" in str(error.value)
    with pytest.raises(hb.UsageError, match=r"function hard_spring \(law\.py\) cannot be written in Modelica"):
        hb.export(hb.load(path / "rig.yaml", allow_native=True), path / "machine.mo")


@pytest.mark.parametrize(("old", "new", "code"), [
    ("file: law.c", "file: law.fmu", "external-fmu"), ("file: law.c", "file: law.f90", "external-file"),
    ("nominal: 0.1 m, ", "", "key-missing"), ("nominal: 0.1 m", "nominal: 0.1 s", "unit"),
    ("nominal: 0.1 m", "nominal: 0 m", "value-out-of-range"),
    ("file: law.c", "file: law.c\nequations: F = c*s", "key-unknown"),
    ("file: law.c", "file: law.c\nsignature: fortran", "signature-unknown"), ("is: external", "is: internal", "is-unknown"),
    ("file: law.c", "file: law.c\ncall: a b", "name-bad")])
def test_mistakes_in_the_file_of_a_program(old: str, new: str, code: str, tmp_path: Path) -> None:
    path = folder(tmp_path, FORMS["differences"].replace(old, new))
    with pytest.raises(hb.HeavebondError, match=code):
        hb.simulate(hb.load(path / "rig.yaml", allow_native=True))


def test_programs_with_functions_of_one_name_are_apart(tmp_path: Path) -> None:
    """A changed source or included file, another folder and a library that was built again: each run calls its own."""
    def stiffness(path: Path) -> float:
        run = hb.simulate(hb.load(path / "rig.yaml", allow_native=True), "10 ms")
        return float(run.si["F"][0] / run.si["x"][0])

    sources = [SOURCE.replace("c*s*(1 +", f"{k}*c*s*(1 +") for k in (1, 2, 3)]
    first, second = folder(tmp_path / "first", FORMS["differences"]), folder(tmp_path / "second", FORMS["differences"])
    (second / "law.c").write_text(sources[1])
    assert stiffness(first) == pytest.approx(125) and stiffness(second) == pytest.approx(250)
    (first / "law.c").write_text(sources[2])
    assert stiffness(first) == pytest.approx(375)
    (first / "shape.h").write_text("#define HARDENING 2.0\n")
    assert stiffness(first) == pytest.approx(450)
    library = folder(tmp_path / "library", FORMS["library"])
    for k, source in enumerate(sources):
        (library / "law.c").write_text(source)
        subprocess.run([str(compiler()), "-shared", "-fPIC", "-o", "law.so", "law.c"], cwd=library, check=True)
        assert stiffness(library) == pytest.approx(125*(k + 1))


WITHOUT_DIAGRAM = {"plot", "signal", "library", "demo", "import", "new"}  # these evaluate no equations


def test_every_command_that_evaluates_a_diagram_takes_the_permission() -> None:
    for name in NAMES:
        options = {option for parameter in main.commands[name].params for option in parameter.opts}
        assert ("--allow-native" in options) is (name not in WITHOUT_DIAGRAM), name


EXPERIMENT = """\
experiment: rig
model: rig.yaml
records: {one: {file: one.csv, use: fit}}
time: {column: t, unit: s}
outputs: {body.x: {column: x, unit: m, noise: 1 mm}}
free: {damper.d: 0.5 N*s/m +- 20 %}
"""


@pytest.mark.parametrize("words", [
    ["errors", "rig_experiment.yaml"], ["monitor", "rig_experiment.yaml", "records", "--processes", "2"],
    ["design", "rig.yaml", "--loop", "body.f", "--free", "damper.d", "--crossover", "1 Hz"],
    pytest.param(["laws", "rig_experiment.yaml", "--at", "body"], marks=pytest.mark.long)], ids=lambda words: words[0])
def test_a_command_runs_programs_with_permission_only(words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
                                                      ) -> None:
    """Two records of the rig itself, with noise: no error, no change. Its force is no loop, which `design` finds only after
    it has evaluated the program."""
    path = folder(tmp_path, FORMS["differences"])
    monkeypatch.chdir(path)
    (path / "rig_experiment.yaml").write_text(EXPERIMENT)
    (path / "records").mkdir()
    run = hb.simulate(hb.load(path / "rig.yaml", allow_native=True))
    for seed, name in enumerate(("one.csv", "records/two.csv", "records/three.csv")):
        noise = 1e-3 * np.random.default_rng(seed).normal(size=len(run.time))
        np.savetxt(name, np.column_stack([run.time, run.si["x"] + noise]), delimiter=",", header="t,x", comments="")
    forbidden = CliRunner().invoke(main, words)
    assert forbidden.exit_code == 1 and "native-not-allowed" in forbidden.output
    allowed = CliRunner().invoke(main, [*words, "--allow-native"])
    assert "native-not-allowed" not in allowed.output
    assert allowed.exit_code == (2 if words[0] == "design" else 0), allowed.output


@pytest.mark.parametrize(("old", "new", "form"), [
    ("double hard_spring(double s", "int hard_spring(double s", "differences"),
    ("double hard_spring(double s", "float hard_spring(double s", "differences"),
    ("double hard_spring(double s", "double hard_spring(int s", "differences"),
    ("double hard_spring(double s", "double hard_spring(float s", "differences"),
    ("void hard_spring_slopes(double s", "void hard_spring_slopes(int s", "derivatives")])
def test_a_c_function_of_other_types_is_refused(old: str, new: str, form: str, tmp_path: Path) -> None:
    """C converts `int` to `double` and back without a word: the force would be cut off to whole newtons."""
    path = folder(tmp_path, FORMS[form])
    (path / "law.c").write_text(SOURCE.replace(old, new))
    with pytest.raises(hb.ModelError, match="native-not-compiled") as error:
        hb.simulate(hb.load(path / "rig.yaml", allow_native=True), "10 ms")
    named = "must be `void hard_spring_slopes(double s, double c, double *d)`" in str(error.value)
    assert named is (form == "derivatives")


def test_derivatives_that_are_not_those_of_the_values_are_refused(tmp_path: Path) -> None:
    """Wrong slopes give wrong modes, sensitivities and fits of a run that looks right. A nominal size beside `derivatives:`
    is the point of the comparison."""
    path = folder(tmp_path, FUNCTION.format(file="law.c\nderivatives: hard_spring_slopes", **SIZED))
    model = hb.load(path / "rig.yaml", allow_native=True)
    hb.simulate(model, "10 ms")
    for old, new in (("3*HARDENING", "2*HARDENING*1000"), ("d[1] = s", "d[1] = 2*s"), ("d[0] = c", "d[0] = -c")):
        (path / "law.c").write_text(SOURCE.replace(old, new))
        with pytest.raises(hb.ModelError, match="native-derivatives") as error:
            hb.simulate(hb.load(path / "rig.yaml", allow_native=True), "10 ms")
        assert "by differences of `hard_spring`" in str(error.value)


@pytest.mark.parametrize(("body", "said"), [
    ("def hard_spring(s): return s", "takes 1 positional argument but 2 were given"),
    ("def hard_spring(s, c): c*s", "it returns None; is `return` missing?"),
    ("def hard_spring(s, c): return c*s, 1.0", "it returns 2 numbers in place of 1"),
    ("def hard_spring(s, c): return c*s + 0j", "complex"),
    ("def hard_spring(s, c): raise SystemExit", "SystemExit, law.py:1"),
    ("def hard_spring(s, c):\n    return nothing", "NameError: name 'nothing' is not defined, law.py:2"),
    ("raise SystemExit", "SystemExit")])
def test_a_python_function_that_fails_is_named(body: str, said: str, tmp_path: Path) -> None:
    path = folder(tmp_path, FORMS["python"])
    (path / "law.py").write_text(body + "\n")
    with pytest.raises(hb.ModelError, match=r"native-failed|native-not-loaded") as error:
        hb.simulate(hb.load(path / "rig.yaml", allow_native=True), "10 ms")
    assert said in str(error.value) and "law.py" in str(error.value)


@pytest.mark.parametrize("kind", partly(["ValueError", "KeyError", "SystemExit"], 3))
def test_an_exception_during_a_run_is_named_with_its_line(kind: str, tmp_path: Path) -> None:
    path = folder(tmp_path, FORMS["python"])
    (path / "law.py").write_text(f"def hard_spring(s, c):\n    if 0.2 < s < 0.3:\n        raise {kind}('too short')\n"
                                 "    return c*s\n")
    with pytest.raises(hb.SimulationError, match=r"not a number for s = 0\.2\d* m.*too short'?, law.py:3\)"):
        hb.simulate(hb.load(path / "rig.yaml", allow_native=True))
