"""Functions in files of their own: called in equations, checked by units, differentiated, written in one place."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from click.testing import CliRunner
from scipy.integrate import solve_ivp

import heavebond as hb
from heavebond.cli import main
from heavebond.core.errors import HeavebondError
from heavebond.language import library as library_files
from heavebond.language.definition import Component
from heavebond.language.library import bundled, called_functions, library
from heavebond.language.symbols import nonsmooth, stepwise
from heavebond.text.expression import (
    Binary,
    Call,
    Elements,
    Expr,
    FunctionCall,
    Name,
    Negative,
    Number,
    parse_equation,
    parse_formula,
)
from heavebond.text.tex import equation_tex

LIBRARY = library()
EVERY = sorted(LIBRARY.functions)

SQUARE = """\
function: drag
summary: Drag that grows with the square of the speed.
inputs:
  v:   {unit: m/s, doc: speed}
  k:   {unit: N*s**2/m**2, doc: force at 1 m/s}
constants:
  v_t: {unit: m/s, value: 1 mm/s, doc: transition speed}
outputs:
  F: {unit: N, doc: force}
  P: {unit: W, doc: power lost}
equations: |
  s = smooth_sign(v, v_t)   # direction
  F = k*v**2 * s            # quadratic drag
  P = F*v                   # power
"""
BRAKE = """\
component: Brake
summary: Drag against the frame.
ports: {a: translational}
parameters:
  k: {unit: N*s**2/m**2, min: 0, doc: force at 1 m/s}
equations: |
  a.f = drag(a.v, k).F   # quadratic drag
dissipates: drag(a.v, k).P
"""
COASTING = """\
model: coasting
components:
  load:  {is: Mass, m: 2 kg}
  brake: {is: Brake, k: 3 N*s**2/m**2}
nodes: {load: [load.a, brake.a]}
initial: {load.v: 4 m/s}
show: {power: {is: "drag(load.v, brake.k).P", unit: W}}
simulate: {until: 2 s}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Callable[..., Path]:
    """A folder with the files above, some of them changed: folder(function=("old", "new"), ...)."""
    def made(**changes: tuple[str, str]) -> Path:
        for name, text in (("drag", SQUARE), ("brake", BRAKE), ("coasting", COASTING)):
            old, new = changes.get(name, ("", ""))
            assert old in text
            (tmp_path / f"{name}.yaml").write_text(text.replace(old, new, 1) if old else text)
        return tmp_path / "coasting.yaml"
    return made


# -- a function of one's own -------------------------------------------------------------------------------------------
def test_a_function_is_called_in_equations_energies_and_outputs(folder: Callable[..., Path]) -> None:
    """m dv/dt = -k v^2 from v0: v = v0/(1 + k v0 t/m); the drag is P = k v^3."""
    run = hb.simulate(hb.load(folder()), sensitivities=["brake.k"])
    v = 4/(1 + 3*4*run.time/2)
    np.testing.assert_allclose(run.si["load.v"], v, rtol=2e-6)
    np.testing.assert_allclose(run.si["power"], 3*v**3, rtol=6e-6)
    # derivatives go through it: dv/dk = -v0^2 t/m / (1 + k v0 t/m)^2
    np.testing.assert_allclose(run.sensitivity("load.v", "brake.k")[1:], -(v**2*run.time/2)[1:], rtol=1e-4)


def test_its_power_is_checked_with_the_component(folder: Callable[..., Path]) -> None:
    path = folder(drag=("F = k*v**2", "F = -k*v**2")).with_name("brake.yaml")
    found = CliRunner().invoke(main, ["check", str(path)])
    assert found.exit_code != 0
    assert "creates power" in found.output


@pytest.mark.filterwarnings("ignore:.*does not balance")  # the energy of the component is that of the law it replaces
def test_a_function_of_ones_own_comes_before_that_of_the_library(tmp_path: Path) -> None:
    """Oil whose compressibility does not depend on the air in it: the library's Volume uses the law of the folder."""
    text = (bundled("components") / "functions" / "oil_with_air.yaml").read_text()
    text = text.replace("(1/beta + c) / (1 + y)", "1/beta")
    diagram = "model: one\nnodes: {oil: [oil.a, pump.a]}\nsimulate: {until: 1 s}\n" \
        "components: {oil: {is: Volume, V: 1 L, beta: 1 GPa, air: 5 %}, pump: {is: FlowSource, u: 1 L/min}}\n"
    (tmp_path / "one.yaml").write_text(diagram)
    before = hb.simulate(hb.load(tmp_path / "one.yaml")).si["oil.p"][-1]
    (tmp_path / "oil_with_air.yaml").write_text(text)
    after = hb.simulate(hb.load(tmp_path / "one.yaml")).si["oil.p"][-1]
    assert after == pytest.approx(1e9/60, rel=1e-6)
    assert before < 0.5*after
    (tmp_path / "oil_with_air.yaml").write_text(text.replace("k = 1/beta", "k = 2/beta"))
    assert hb.simulate(hb.load(tmp_path / "one.yaml")).si["oil.p"][-1] == pytest.approx(5e8/60, rel=1e-6)


def test_a_variant_in_another_folder_knows_the_functions_of_both(folder: Callable[..., Path], tmp_path: Path) -> None:
    base = folder()
    below = tmp_path / "below"
    below.mkdir()
    (below / "variant.yaml").write_text("model: variant\nextends: ../coasting.yaml\n"
                                        "show: {twice: {is: twice(load.v), unit: m/s}}\n")
    (below / "twice.yaml").write_text("function: twice\nsummary: Twice.\ninputs: {x: {unit: $U, doc: any}}\n"
                                      "outputs: {y: {unit: $U, doc: twice as much}}\nequations: |\n  y = 2*x   # twice\n")
    run = hb.simulate(hb.load(below / "variant.yaml"))
    assert run.si["twice"][0] == pytest.approx(8)
    assert hb.load(base).library.functions is hb.load(base).library.functions
    again = pickle.loads(pickle.dumps(hb.load(base)))
    assert again.library.functions is hb.load(base).library.functions, "another process must not read all components anew"


def test_a_component_that_is_renamed_in_its_file_is_found_under_its_new_name(tmp_path: Path) -> None:
    """Heads of files are kept from one look at a folder to the next, as long as the file is the same."""
    file = tmp_path / "own.yaml"
    for name in ("OwnDamper", "OwnViscousDamper"):
        file.write_text(f"component: {name}\nsummary: A damper.\n")
        assert [known for known, path in library([tmp_path]).files.items() if path == file] == [name]
    file.unlink()
    file.mkdir()
    assert file not in library([tmp_path]).files.values()


def test_a_working_copy_of_the_library_is_no_folder_of_a_user() -> None:
    assert library([bundled("components").parent]).files == library().files


def test_a_component_that_is_added_to_the_library_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "one.yaml").write_text("component: One\nsummary: A part.\n")
    monkeypatch.setattr(library_files, "bundled", lambda folder: tmp_path)
    monkeypatch.setattr(library_files, "_bundled_folders", lambda: [str(tmp_path)])
    assert library_files._bundled_files()["component"] == {"One": tmp_path / "one.yaml"}
    (tmp_path / "two.yaml").write_text("component: Two\nsummary: Another part.\n")
    assert [*library_files._bundled_files()["component"]] == ["One", "Two"]


# -- what is wrong -------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("changes", "code", "said"), [
    ({"brake": ("drag(a.v, k).F", "drak(a.v, k).F")}, "function-unknown", "Did you mean 'drag'?"),
    ({"brake": ("drag(a.v, k).F", "drag(a.v).F")}, "function-arguments", "drag takes 2 arguments, not 1"),
    ({"brake": ("drag(a.v, k).F", "drag(a.v, k)")}, "function-output", "Write `drag(v, k).F`, or `.P` behind"),
    ({"brake": ("drag(a.v, k).F", "drag(a.v, k).f")}, "function-output", "Did you mean 'F'?"),
    ({"brake": ("drag(a.v, k).F", "drag(a.f, k).F")}, "units-argument", "argument v of drag must be in m/s; this is in N"),
    ({"brake": ("drag(a.v, k).F", "drag(a.v, k).P")}, "units-differ", "the right side is in W"),
    ({"coasting": ("brake.k).P", "load.m).P")}, "units-argument", "argument k of drag"),
    ({"drag": ("F = k*v**2 * s ", "F = k*v * s    ")}, "units-differ", "output F must be in N"),
    ({"drag": ("smooth_sign(v, v_t)", "smooth_sign(v, k)")}, "units-differ", "drag.yaml:12"),
    ({"drag": ("P = F*v ", "P = Q*v ")}, "name-unknown", "'Q' is not given in drag"),
    ({"drag": ("  s = smooth_sign(v, v_t)   # direction\n", "")}, "name-unknown", "'s' is not given"),
    ({"drag": ("  P = F*v                   # power\n", "")}, "function-output", "no line gives the output 'P'"),
    ({"drag": ("P = F*v ", "F = F*v ")}, "function-given-twice", "'F' is given by a line above already"),
    ({"drag": ("P = F*v ", "v = F*v ")}, "function-given-twice", "'v' is an input already"),
    ({"drag": ("P = F*v ", "P = F*der(v)")}, "function-refused", "der() is not permitted in a function"),
    ({"drag": ("P = F*v ", "P = floor(F*v/1)")}, "function-refused", "jumps"),
    ({"drag": ("P = F*v ", "P = F*time*v ")}, "name-unknown", "'time' is not given"),
    ({"drag": ("P = F*v   ", "P + F = F*v   ")}, "function-left", "one name"),
    ({"drag": ("P = F*v   ", "P[1] = F*v   ")}, "function-left", "each i in 1..n: y[i] = f(i, ...)"),
    ({"drag": ("P = F*v   ", "each i in 1..2: P[i] = F*v   ")}, "function-left", "not its elements"),
    ({"drag": ("# power\n", "# power\n  e = 1 # nothing\n")}, "function-unused", "'e' is not used"),
    ({"drag": ("1 mm/s", "1 mm")}, "unit-wrong", "value of v_t"),
    ({"drag": ("1 mm/s", "1")}, "unit-missing", "value of v_t"),
    ({"drag": ("P: {unit: W", "v: {unit: W")}, "name-twice", "'v' is declared under inputs and under outputs"),
    ({"drag": ("P = F*v ", "P = drag(v, k).P ")}, "function-circle", "'drag' calls itself"),
    ({"drag": ("summary: D", "sumary: D")}, "key-unknown", "has no entry 'sumary'"),
    ({"drag": ("function: drag", "function: sqrt")}, "function-unknown", "there is no function 'drag'"),
])
def test_mistakes_are_told_with_their_place(folder: Callable[..., Path], changes: dict[str, tuple[str, str]], code: str,
                                            said: str) -> None:
    path = folder(**changes)
    with pytest.raises(HeavebondError) as caught:
        hb.assemble(hb.load(path))
    first = [problem for problem in caught.value.problems if problem.code == code]
    assert first, str(caught.value)
    assert said in str(caught.value)
    assert all(problem.place is not None for problem in caught.value.problems)
    assert len({str(problem) for problem in caught.value.problems}) == len(caught.value.problems)


def test_functions_that_call_each_other_in_a_circle_are_refused(folder: Callable[..., Path]) -> None:
    path = folder(drag=("P = F*v ", "P = other(v, F) "))
    path.with_name("other.yaml").write_text(
        "function: other\nsummary: Another.\ninputs: {v: {unit: m/s, doc: speed}, F: {unit: N, doc: force}}\n"
        "outputs: {P: {unit: W, doc: power}}\nequations: |\n  P = drag(v, F*v/v).P   # round about\n")
    with pytest.raises(HeavebondError, match="in a circle: drag > other > drag"):
        hb.assemble(hb.load(path))


def test_two_files_of_one_name_are_refused(folder: Callable[..., Path]) -> None:
    path = folder()
    path.with_name("drag_again.yaml").write_text(SQUARE)
    with pytest.raises(HeavebondError, match="two files describe a function 'drag'"):
        hb.assemble(hb.load(path))


def test_a_kink_in_a_function_is_found_where_it_must_be_differentiated() -> None:
    """As in a component: of what varies alone, and in the steps of the output that is meant."""
    from heavebond.text.expression import calling

    with calling(LIBRARY.functions):
        zone, flow = parse_formula("dead_zone(x, g)"), parse_formula("oil_with_air(p, beta, air, p_a, n).k")
        smooth = parse_formula("rated_orifice_flow(x, q, g, g)")
    assert nonsmooth(zone, lambda name: name == "g") == "max"
    assert nonsmooth(zone, lambda name: True) is None
    assert nonsmooth(flow, lambda name: name != "p") == "max"
    assert nonsmooth(smooth, lambda name: False) is None
    # the index of a sum does not vary in time
    terms = parse_formula("sum(max(a[i] - i, 0)*x for i in 1..n)"), parse_formula("sum(i*max(x, 0) for i in 1..n)")
    assert [nonsmooth(term, lambda name: name != "x") for term in terms] == [None, "max"]


# -- the library -------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", EVERY)
def test_a_function_of_the_library_says_all(name: str) -> None:
    function = LIBRARY.functions[name]
    assert function.path.stem == name
    assert function.summary.endswith(".")
    assert function.source
    assert function.restrictions
    assert all(q.doc for group in (function.inputs, function.outputs, function.constants) for q in group.values())
    assert all(step.label for step in function.steps)
    assert any(function in called_functions(component) for component in COMPONENTS), "nothing calls it"


COMPONENTS = [LIBRARY.component(name) for name in LIBRARY.names()]
LONG = 60  # signs of a right side with its names replaced: shorter ones are products and sums that many laws have


def _form(expr: Expr, names: dict[str, str]) -> str:
    """An expression with its names numbered: equal for the same law in other letters."""
    if isinstance(expr, Name):
        return names.setdefault(expr.text, f"x{len(names)}")
    if isinstance(expr, Number):
        return repr(expr.value)
    if isinstance(expr, Binary):
        return f"({_form(expr.left, names)}{expr.op}{_form(expr.right, names)})"
    if isinstance(expr, Negative):
        return f"-{_form(expr.operand, names)}"
    if isinstance(expr, FunctionCall):
        return "law"
    if isinstance(expr, Elements) and all(isinstance(item, Name) for item in expr.items):  # a vector under one name
        return names.setdefault(repr([item.text for item in expr.items]), f"x{len(names)}")
    if isinstance(expr, Elements):
        return f"[{','.join(_form(item, names) for item in expr.items)}]"
    return f"{expr.function}({','.join(_form(a, names) for a in expr.args)})" if isinstance(expr, Call) else repr(expr)


def test_no_long_law_is_written_in_three_components() -> None:
    """A law that several components share is a function. Twins of translation and rotation are two."""
    where: dict[str, list[Component]] = {}
    for component in COMPONENTS:
        for form in {_form(line.tree.right, {}) for line in component.equations}:
            if len(form) > LONG and "law" not in form:
                where.setdefault(form, []).append(component)
    assert {form: [c.name for c in found] for form, found in where.items() if len(found) > 2} == {}


def test_the_law_of_air_stands_in_one_place() -> None:
    users = {c.name for c in COMPONENTS if LIBRARY.functions["oil_with_air"] in called_functions(c)}
    assert users == {"Volume", "Cylinder", "SingleActingCylinder", "LineSegment"}
    exponent = [path for path in bundled("components").rglob("*.yaml") if "**(-1/n_air)" in path.read_text()]
    assert [path.name for path in exponent] == ["oil_with_air.yaml"]


def test_the_law_of_air_is_the_derivative_of_the_volume() -> None:
    """The compressibility is -dV/dp/V of oil and air in series, V = 1 - p/beta + y to first order in p/beta, and y falls
    with pressure by c; both by CasADi's derivative of the steps."""
    function = LIBRARY.functions["oil_with_air"]
    p = ca.SX.sym("p")
    values = stepwise(function, [p, ca.SX(1.4e9), ca.SX(0.02), ca.SX(101325.0), ca.SX(1.3)])
    given = ca.Function("f", [p], [values["c"], -ca.jacobian(values["y"], p), values["k"], values["y"]])
    for pressure in (-5e4, 0.0, 1e5, 2e7):
        c, slope, k, y = (float(v) for v in given(pressure))
        assert c == pytest.approx(slope, rel=1e-12)
        assert k == pytest.approx((1/1.4e9 + slope)/(1 + y), rel=1e-12)


def test_outputs_of_one_call_share_its_steps() -> None:
    """Three outputs cost as many operations as their steps have, not three times that."""
    from heavebond.language.template import template

    volume = LIBRARY.component("Volume")
    made = template(volume, LIBRARY.domains, {"a": "hydraulic"}, {})
    steps = stepwise(LIBRARY.functions["oil_with_air"], [ca.SX.sym(n) for n in "abcde"])
    alone = ca.Function("f", [ca.vertcat(*ca.symvar(ca.vertcat(*steps.values())))], [ca.vertcat(*steps.values())])
    assert made.residuals.n_instructions() < 1.5*alone.n_instructions()


def test_commands_know_functions(folder: Callable[..., Path], monkeypatch: pytest.MonkeyPatch) -> None:
    run, path = CliRunner().invoke, folder()
    monkeypatch.chdir(path.parent)
    listed, shown = run(main, ["library"]).output, run(main, ["library", "drag"]).output
    assert all(name in listed for name in (*EVERY, "drag"))
    assert "Called as drag(v, k).F" in shown
    assert "v_t  m/s  0.001  transition speed" in shown
    plotted = run(main, ["run", "coasting.yaml", "--plot", "drag(load.v, brake.k).P"])
    assert plotted.exit_code == 0, plotted.output
    assert "drag(load.v, brake.k).P" in plotted.output
    assert run(main, ["check", "coasting.yaml"]).exit_code == 0
    checked = run(main, ["check", str(bundled("components") / "functions" / "dead_zone.yaml")])
    assert "called as dead_zone(x, g)" in checked.output
    wrong = run(main, ["run", str(bundled("components") / "functions" / "dead_zone.yaml")])
    assert "it describes a function, 'dead_zone'" in wrong.output


def test_units_that_are_open_are_solved_by_each_call() -> None:
    """`dead_zone` in lengths and in angles; two units in one call are refused."""
    from heavebond.text.dimensions import dimension
    from heavebond.text.expression import ExpressionProblem, calling

    metre, newton = (("m", 1),), (("kg", 1), ("m", 1), ("s", -2))
    units = {"x": metre, "g": metre, "F": newton}
    with calling(LIBRARY.functions):
        good, bad = parse_formula("dead_zone(x, g)"), parse_formula("dead_zone(x, F)")
    assert dimension(good, lambda name: units[name.text]) == metre
    with pytest.raises(ExpressionProblem, match="argument g of dead_zone must be in m"):
        dimension(bad, lambda name: units[name.text])


# -- lists and matrices ------------------------------------------------------------------------------------------------
LINES = """\
function: lines
summary: Straight lines through points.
inputs:
  x:  {unit: $X, doc: where}
  xs: {unit: $X, count: n, doc: points}
  ys: {unit: $Y, count: n, doc: values}
outputs: {y: {unit: $Y, doc: value}}
equations: |
  d = ys[2..n] - ys[1..n - 1]   # rises
  y = ys[1] + sum(d[i]*min(max((x - xs[i])/(xs[i + 1] - xs[i]), 0), 1) for i in 1..n - 1)   # lines
"""
MOMENTA = """\
function: momenta
summary: Momenta and energy of coupled masses.
inputs:
  M: {unit: kg, count: [n, n], doc: masses}
  v: {unit: m/s, count: n, doc: speeds}
outputs:
  p: {unit: N*s, count: n, doc: momenta}
  E: {unit: J, doc: energy}
equations: |
  p = M*v          # momenta
  E = dot(p, v)/2  # energy
"""
COUPLED = """\
component: Coupled
summary: Two masses that are coupled, on springs by measured points.
parameters:
  n: {integer, min: 2, doc: number of points}
  s: {unit: m, count: n, doc: elongations}
  F: {unit: N, count: n, doc: tensions}
  M: {unit: kg, count: [2, 2], doc: mass matrix}
variables:
  x: {unit: m, count: 2, doc: places}
  v: {unit: m/s, count: 2, doc: speeds}
  p: {unit: N*s, count: 2, doc: momenta}
requires: [symmetric(M), definite(M)]
equations: |
  v = der(x)           # speeds
  p = momenta(M, v).p  # momenta
  each i in 1..2: der(p[i]) = -lines(x[i], s, F)   # springs
power: source
"""
SWUNG = """\
model: swung
components: {part: {is: Coupled, s: [-1 m, 0 m, 2 m], F: [-8 N, 0 N, 4 N], M: [[2 kg, 1 kg], [1 kg, 3 kg]]}}
initial: {"part.x[1]": 0.5 m, "part.x[2]": -0.25 m}
show:
  energy: {is: "momenta(part.M, part.v).E", unit: J}
  force:  {is: "lines(part.x[1], part.s, part.F)", unit: N}
simulate: {until: 2 s}
"""


def swung(folder: Path, **changes: tuple[str, str]) -> Path:
    for name, text in (("lines", LINES), ("momenta", MOMENTA), ("coupled", COUPLED), ("swung", SWUNG)):
        old, new = changes.get(name, ("", ""))
        assert old in text
        (folder / f"{name}.yaml").write_text(text.replace(old, new, 1) if old else text, encoding="utf-8")
    return folder / "swung.yaml"


def test_functions_of_lists_and_matrices(tmp_path: Path) -> None:
    """Values by NumPy at every point of a run; energy of the masses and of the springs is kept."""
    found = hb.simulate(hb.load(swung(tmp_path)), rtol=1e-10)
    x, v = (np.array([found[f"part.{n}[{k}]"] for k in (1, 2)]) for n in "xv")
    masses = np.array([[2.0, 1], [1, 3]])
    assert found["energy"] == pytest.approx(np.einsum("it,ij,jt->t", v, masses, v)/2, abs=1e-12)
    assert found["force"] == pytest.approx(np.interp(x[0], [-1, 0, 2], [-8, 0, 4]), abs=1e-9)
    stored = np.where(x < 0, 4*x**2, x**2).sum(axis=0)
    assert found["energy"] + stored == pytest.approx(np.full(len(found.time), stored[0]), rel=1e-6)


ROTATION = """
function: rotation
summary: Turning of a vector of the plane.
source: Definition.
inputs:
  phi: {unit: rad, doc: angle}
  u:   {unit: $U, count: 2, doc: vector}
outputs:
  v: {unit: $U, count: 2, doc: turned vector}
  R: {unit: 1, count: [2, 2], doc: matrix}
equations: |
  R = [[cos(phi), -sin(phi)],   # by its rows
       [sin(phi), cos(phi)]]
  v = R*u                       # turned
"""
TURNED = """
component: Turned
summary: A force of the plane that turns, on a body that springs hold.
parameters:
  m: {unit: kg, doc: mass}
  c: {unit: N/m, doc: stiffness along x}
  k: {unit: N/m, doc: stiffness along y}
  w: {unit: rad/s, doc: speed of turning}
  F: {unit: N, doc: force}
variables:
  phi: {unit: rad, start: 0, doc: angle}
  x: {unit: m, count: 2, doc: position}
  v: {unit: m/s, count: 2, doc: velocity}
equations: |
  der(phi) = w                                                      # angle
  der(x) = v                                                        # velocity
  m*der(v) = rotation(phi, [F, 0]).v - transpose(rotation(0.3, [1, 0]).R)*[[c, 0], [0, k]]*rotation(0.3, [1, 0]).R*x
stores: dot(v, v)*m/2
power: controlled, a force from outside
"""


def turned(folder: Path, old: str = "", new: str = "") -> Path:
    for name, text in (("rotation", ROTATION), ("turned", TURNED)):
        (folder / f"{name}.yaml").write_text(text.replace(old, new, 1) if old else text, encoding="utf-8")
    path = folder / "plane.yaml"
    path.write_text("model: plane\ncomponents: {part: {is: Turned, m: 2 kg, c: 8 N/m, k: 50 N/m, w: 3 rad/s, F: 4 N}}\n"
                    "initial: {'part.x[1]': 0.1 m, 'part.x[2]': 0 m, 'part.v[1]': 0 m/s, 'part.v[2]': 0 m/s}\n"
                    "simulate: {until: 2 s, every: 20 ms}\n", encoding="utf-8")
    return path


def test_a_function_builds_a_matrix_from_elements(tmp_path: Path) -> None:
    """Beside SciPy: a rotating force on a body between springs whose axes are turned by 0.3 rad."""
    found = hb.simulate(hb.load(turned(tmp_path)), rtol=1e-10)
    R = np.array([[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]])
    stiffness = R.T @ np.diag([8.0, 50]) @ R
    exact = solve_ivp(lambda t, y: [*y[2:], *((4*np.array([np.cos(3*t), np.sin(3*t)]) - stiffness @ y[:2])/2)],
                      (0, 2), [0.1, 0, 0, 0], rtol=1e-11, atol=1e-12, t_eval=found.time)
    for k in (0, 1):
        assert found[f"part.x[{k + 1}]"] == pytest.approx(exact.y[k], abs=1e-8)


@pytest.mark.parametrize(("old", "new", "code", "said"), [
    ("[sin(phi), cos(phi)]]", "[sin(phi), cos(phi), 0]]", "list-length", "is a list of 2, this is a list of 3"),
    ("[sin(phi), cos(phi)]]", "sin(phi)]", "list-length", "the first of a list is a list, this is a number"),
    ("[[c, 0], [0, k]]", "[[c, 0], [0, m]]", "units-differ", "the list joins"),
    ("[[c, 0], [0, k]]", "[[c, 0], [0, k]", "formula-incomplete", "a `]` is missing"),
    ("[F, 0]", "[F, 0, 0]", "list-length", "u of rotation has the length 2; this is a list of 3"),
    ("[F, 0]", "[[[F, 0]]]", "list-number", "a list has numbers or rows"),
    ("[F, 0]", "[]", "formula-broken", "a number or a name is missing"),
    ("w                 ", "[w, w]            ", "list-length", "the sides of the equation"),
])
def test_mistakes_in_lists_by_elements(tmp_path: Path, old: str, new: str, code: str, said: str) -> None:
    with pytest.raises(HeavebondError) as caught:
        hb.assemble(hb.load(turned(tmp_path, old, new)))
    assert code in [p.code for p in caught.value.problems], str(caught.value)
    assert said in str(caught.value), str(caught.value)


@pytest.mark.parametrize(("formula", "said"), [
    ("[1 N, 2 N]", "is a number; this is a list of 2"), ("dot([1 N, 2 N], [1, 2, 3])", "a list of 2 and a list of 3"),
    ("spread(time).f", "is a number; this is a list of 2"), ("sum([3 N, spread(time).f[1]])", "'[' cannot stand here"),
])
def test_a_list_in_a_diagram_is_no_number(tmp_path: Path, formula: str, said: str) -> None:
    (tmp_path / "spread.yaml").write_text("function: spread\nsummary: Two forces.\ninputs: {t: {unit: s, doc: time}}\n"
                                          "constants: {k: {unit: N/s, value: 1 N/s, doc: rate}}\n"
                                          "outputs: {f: {unit: N, count: 2, doc: forces}}\n"
                                          "equations: |\n  f = [k*t, 2*k*t]\n")
    text = """
model: one
components: {source: {is: ForceSource, u: "=FORMULA"}, mass: {is: Mass, m: 1 kg}}
nodes: {mass: [source.a, mass.a]}
simulate: {until: 2 s}
"""
    with pytest.raises(HeavebondError) as caught:
        hb.assemble(hb.loads(text.replace("FORMULA", formula), tmp_path))
    assert said in str(caught.value)
    with pytest.raises(HeavebondError, match="what a formula gives is a number"):
        hb.assemble(hb.loads(text.replace("FORMULA", "1 N").replace("m: 1 kg", 'm: "=[1 kg, 2 kg]"'), tmp_path))
    found = hb.simulate(hb.loads(text.replace("FORMULA", "sum(spread(time)) + dot([1, 2], [3 N, 4 N])"), tmp_path))
    assert found["mass.v"][-1] == pytest.approx(3*2**2/2 + 11*2)


def test_a_matrix_by_elements_in_formulas_of_a_page() -> None:
    shown = equation_tex(parse_equation("K = [[c, 0], [-c, 2*d]]"))
    assert r"\begin{pmatrix} c & 0 \\ -c & 2" in shown
    assert equation_tex(parse_equation("x = [a, b]")).count(r"\\") == 1


@pytest.mark.parametrize(("file", "old", "new", "code", "said"), [
    ("coupled", "x[i], s, F", "x, s, F", "list-number", "x of lines is a number; this is a list"),
    ("coupled", "x[i], s, F", "x[i], s, F[1]", "list-number", "ys of lines is a list; this is a number"),
    ("coupled", "x[i], s, F", "x[i], s, F[1..2]", "list-length", "ys of lines has the length n = 3; this is a list of 2"),
    ("coupled", "momenta(M, v).p", "momenta(M, x).p", "units-argument", "v of momenta must be in m/s"),
    ("coupled", "momenta(M, v).p", "momenta(v, v).p", "units-argument", "M of momenta must be in kg"),
    ("lines", "ys[1] + sum(d", "ys + sum(d", "list-length", "in lines, `y = ys + sum"),
    ("lines", "count: n, doc: values", "doc: values", "list-index", "'ys' is a number, it has no elements"),
    ("lines", "x - xs[i]", "x - xs[i + n]", "list-index", "'xs[4]' is not an element of xs, which has 3"),
    ("lines", "ys[2..n] -", "ys[3..n] -", "list-length", "in lines, `d = ys[3..n]"),
    ("lines", "count: n, doc: points", "count: n + 1, doc: points", "count-bad", "is a name or a whole number"),
    ("momenta", "N*s, count: n", "N*s, count: m", "count-bad", "depends on m, which no input determines"),
    ("momenta", "N*s, count: n", "N*s", "list-number", "the output p is declared as a number"),
    ("momenta", "count: [n, n]", "count: [v, v]", "name-twice", "'v' is a length and an input")])
def test_mistakes_in_functions_of_lists(tmp_path: Path, file: str, old: str, new: str, code: str, said: str) -> None:
    with pytest.raises(HeavebondError) as caught:
        hb.assemble(hb.load(swung(tmp_path, **{file: (old, new)})))
    assert code in [p.code for p in caught.value.problems], str(caught.value)
    assert said in str(caught.value), str(caught.value)
