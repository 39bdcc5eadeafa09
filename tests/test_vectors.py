"""Lists as vectors: equations of all elements at once, parts of lists, dot and cross products."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import heavebond as hb
from heavebond.core.errors import HeavebondError
from heavebond.language.component_file import parse_component
from heavebond.language.laws import check
from heavebond.language.library import library
from heavebond.language.power_law import check_power
from heavebond.language.symbols import Context, evaluate
from heavebond.text.expression import parse_formula
from heavebond.text.yaml_source import parse

TOP = """\
component: Top
summary: A rigid body that turns freely about its centre of mass, in its own axes.
parameters:
  J: {unit: kg*m**2, min: 1e-9 kg*m**2, count: 3, doc: principal moments of inertia}
variables:
  w: {unit: rad/s, count: 3, doc: angular velocity}
  L: {unit: N*m*s, count: 3, doc: angular momentum}
equations: |
  each i in 1..3: L[i] = J[i]*w[i]   # angular momentum
  der(L) + cross(w, L) = 0           # Euler
stores: dot(w, L)/2
"""
FREE = """\
model: free
components: {{top: {{is: Top, J: [{J}]}}}}
initial: {{{initial}}}
show:
  energy: {{is: "dot(top.w, top.L)/2", unit: J}}
  momentum: {{is: "sqrt(dot(top.L, top.L))", unit: N*m*s}}
  two: {{is: "sum(top.w[1..2])", unit: rad/s}}
simulate: {{until: 10 s, every: 10 ms}}
"""
CHAIN = """\
component: Chain
summary: Masses between springs in line.
ports: {a: translational}
parameters:
  n: {integer, min: 2, doc: number of masses}
  m: {unit: kg, min: 0, doc: each mass}
  c: {unit: N/m, min: 0, doc: stiffness of each spring}
variables:
  x: {unit: m, count: n, doc: positions}
  v: {unit: m/s, count: n, doc: speeds}
  F: {unit: N, count: n, doc: forces of the springs}
equations: |
  der(x) = v                              # speeds
  F[1] = c*(a.x - x[1])                   # the first spring
  F[2..n] = c*(x[1..n - 1] - x[2..n])     # the other springs
  m*der(v[1..n - 1]) = F[1..n - 1] - F[2..n]   # masses
  m*der(v[n]) = F[n]                      # the last mass
  a.f = F[1]                              # what it takes
stores: dot(F, F)/(2*c) + m*dot(v, v)/2
"""
HANGING = """\
model: hanging
components:
  wall:  {is: Fixed}
  chain: {is: Chain, n: 4, m: 2 kg, c: 50 N/m}
nodes: {wall: [wall.a, chain.a]}
initial: {"chain.v[4]": 1 m/s}
simulate: {until: 3 s, every: 10 ms}
"""


def run(tmp_path: Path, part: str, text: str, name: str = "part") -> hb.Result:
    (tmp_path / f"{name}.yaml").write_text(part)
    return hb.simulate(hb.loads(text, tmp_path), rtol=1e-9)


def body(tmp_path: Path, J: tuple[float, ...], w: tuple[float, ...]) -> hb.Result:
    initial = ", ".join(f'"top.w[{k}]": {value} rad/s' for k, value in enumerate(w, 1))
    return run(tmp_path, TOP, FREE.format(J=", ".join(f"{j} kg*m**2" for j in J), initial=initial))


def test_a_symmetric_top_precesses(tmp_path: Path) -> None:
    """Euler: with J1 = J2, w3 is constant and w1 + i w2 turns at (J3 - J1)/J1 * w3."""
    result = body(tmp_path, (2, 2, 3), (0.5, 0, 4))
    rate = (3 - 2)/2*4
    np.testing.assert_allclose(result.si["top.w[1]"], 0.5*np.cos(rate*result.time), atol=2e-7)
    np.testing.assert_allclose(result.si["top.w[2]"], 0.5*np.sin(rate*result.time), atol=2e-7)
    np.testing.assert_allclose(result.si["two"], result.si["top.w[1]"] + result.si["top.w[2]"], rtol=1e-12, atol=1e-15)


def test_a_body_tumbles_about_its_middle_axis_as_scipy_says(tmp_path: Path) -> None:
    J, w = (1.0, 2.0, 3.0), (0.01, 3.0, 0.0)
    result = body(tmp_path, J, w)
    j = np.array(J)
    other = solve_ivp(lambda _, y: -np.cross(y, j*y)/j, (0, 10), w, "DOP853", result.time, rtol=1e-11, atol=1e-13)
    own = np.array([result.si[f"top.w[{k}]"] for k in (1, 2, 3)])
    assert own[1].min() < -2.9, "it turns over"
    np.testing.assert_allclose(own, other.y, atol=2e-5)  # an unstable axis: errors of 1e-9 grow by exp(1.7 t) until it turns
    np.testing.assert_allclose(result.si["energy"], result.si["energy"][0], rtol=1e-7)
    np.testing.assert_allclose(result.si["momentum"], result.si["momentum"][0], rtol=1e-7)


def test_vectors_are_the_equations_of_their_elements(tmp_path: Path) -> None:
    """The chain by parts of lists and, element by element, by `each`: the same to the last bit."""
    whole = run(tmp_path, CHAIN, HANGING)
    parts = CHAIN.replace("der(x) = v   ", "each i in 1..n: der(x[i]) = v[i]").replace(
        "F[2..n] = c*(x[1..n - 1] - x[2..n])", "each i in 2..n: F[i] = c*(x[i - 1] - x[i])").replace(
        "m*der(v[1..n - 1]) = F[1..n - 1] - F[2..n]", "each i in 1..n - 1: m*der(v[i]) = F[i] - F[i + 1]")
    (tmp_path / "single").mkdir()
    single = run(tmp_path / "single", parts, HANGING)
    for name in ("chain.x[1]", "chain.x[4]", "chain.F[2]"):
        assert (whole.si[name] == single.si[name]).all()
    assert np.abs(whole.si["chain.x[4]"]).max() > 0.1


def test_the_three_laws_hold() -> None:
    for text in (TOP, CHAIN):
        made = parse_component(parse(text, Path("part.yaml"), "part.yaml"), library().domains)
        check(made, library().domains)
        assert check_power(made, library().domains).holds
    flat = hb.assemble(hb.loads("model: one\ncomponents: {top: {is: Top, J: [1 kg*m**2, 2 kg*m**2, 3 kg*m**2]}}\n",
                                _folder_with_top())).flat
    assert [e.label for e in flat.equations][3:] == [f"Euler, element {k}" for k in (1, 2, 3)]


def _folder_with_top() -> Path:
    from tempfile import mkdtemp

    folder = Path(mkdtemp())
    (folder / "top.yaml").write_text(TOP)
    return folder


@pytest.mark.parametrize(("old", "new", "code", "said"), [
    ("der(L) + cross(w, L) = 0", "der(L) + w*L = 0", "list-product", "a product of two lists has more than one meaning"),
    ("der(L) + cross(w, L) = 0", "(der(L) + cross(w, L))/w = 0", "list-product", "a quotient by a list"),
    ("der(L) + cross(w, L) = 0", "der(L) + dot(w, L) = 0", "list-length", "'+' joins a list and a number"),
    ("der(L) + cross(w, L) = 0", "der(L) = dot(w, L)", "list-length", "the sides of the equation are a list and a number"),
    ("der(L) + cross(w, L) = 0", "der(L) + cross(w, J) = 0", "units-differ", "'+' joins"),
    ("der(L) + cross(w, L) = 0", "der(L) + cross(w, L[1]) = 0", "list-number", "cross takes two lists of 3"),
    ("der(L) + cross(w, L) = 0", "der(L) + cross(w[1..2], L[1..2]) = 0", "list-number", "this is a list of 2"),
    ("der(L) + cross(w, L) = 0", "der(L[1..2]) + cross(w, L) = 0", "list-length", "'+' joins a list of 2 and a list of 3"),
    ("der(L) + cross(w, L) = 0", "der(L[3..1]) = 0", "balance-too-few", "4 equations for 6 unknowns"),
    ("stores: dot(w, L)/2", "stores: L/2*1", "list-number", "`stores:` is a number; this is a list"),
    ("L[i] = J[i]*w[i]", "L[i] = J[i]*abs(w)", "list-number", "the argument of abs is a number; this is a list"),
    ("L[i] = J[i]*w[i]", "L[i] = dead_zone(w, w[1])*J[i]", "list-number", "x of dead_zone is a number"),
    ("L[i] = J[i]*w[i]", "L[i] = if_else(w > 0, J[i], J[i])*w[i]", "list-number", "each side of a comparison"),
    ("L[i] = J[i]*w[i]", "L[i] = J[w]*w[i]", "units-argument", "an index must be a number without unit"),
])
def test_mistakes_with_vectors(tmp_path: Path, old: str, new: str, code: str, said: str) -> None:
    assert old in TOP
    with pytest.raises(HeavebondError) as caught:
        run(tmp_path, TOP.replace(old, new), FREE.format(J="1 kg*m**2, 2 kg*m**2, 3 kg*m**2", initial=""))
    assert code in [p.code for p in caught.value.problems], str(caught.value)
    assert said in str(caught.value)


@pytest.mark.parametrize(("formula", "unit", "code"), [
    ("2*top.w", "rad/s", "list-number"), ("-top.w[1..2]", "rad/s", "list-number"), ("top.w[2..1]", "rad/s", "list-number"),
    ("dot(top.w, top.L[1..2])", "J", "list-length"), ("sum(top.L)", "rad/s", "unit-wrong"),
    ("top.w[4]", "rad/s", "name-unknown"), ("sum(top.w[2..5])", "rad/s", "name-unknown")])
def test_mistakes_in_formulas(tmp_path: Path, formula: str, unit: str, code: str) -> None:
    text = FREE.format(J="1 kg*m**2, 2 kg*m**2, 3 kg*m**2", initial="")
    with pytest.raises(HeavebondError) as caught:
        run(tmp_path, TOP, text.replace('"sum(top.w[1..2])", unit: rad/s', f'"{formula}", unit: {unit}'))
    assert code in [p.code for p in caught.value.problems], str(caught.value)


def stopped(new: str) -> str:
    """The top with an event at 1 s."""
    return TOP.replace("parameters:\n", "parameters:\n  t_s: {unit: s, default: 1 s, doc: time}\n") + \
        f"when:\n  stop: {{at: t_s, then: {new}}}\n"


@pytest.mark.parametrize(("new", "code", "said"), [
    ("{w: 0}", "reset-no-state", r"sets 'top.w\[1\]', which is not a state"),
    ("{L: '2*L[1]'}", "list-length", "the target and its new value are")])
def test_mistakes_of_an_event_that_sets_a_list(tmp_path: Path, new: str, code: str, said: str) -> None:
    """Of a list, an event sets each element, which is a state; only zero stands for a list of the same length."""
    with pytest.raises(HeavebondError, match=said) as caught:
        run(tmp_path, stopped(new), FREE.format(J="1 kg*m**2, 2 kg*m**2, 3 kg*m**2", initial=""))
    assert {p.code for p in caught.value.problems} == {code}


def test_an_event_sets_each_element_of_a_list(tmp_path: Path) -> None:
    initial = '"top.w[1]": 1 rad/s, "top.w[2]": 2 rad/s, "top.w[3]": 3 rad/s'
    result = run(tmp_path, stopped("{L: 0}"), FREE.format(J="1 kg*m**2, 2 kg*m**2, 3 kg*m**2", initial=initial))
    before, after = (int(np.searchsorted(result.time, t)) for t in (0.9, 1.1))
    # the momentum of free rotation is constant, sqrt(1 + 16 + 81) N m s; the run has a relative tolerance of 1e-8
    assert result.si["momentum"][before] == pytest.approx(98**0.5, rel=1e-6)
    assert [result.si[f"top.L[{i}]"][after] for i in (1, 2, 3)] == [0.0, 0.0, 0.0]


def test_the_ports_of_an_array_are_a_vector(tmp_path: Path) -> None:
    """One pressure at all lines of a manifold, its flows in balance: as `Manifold` by `each`."""
    star = """\
component: Star
summary: Joins lines without loss.
ports: {p: {domain: hydraulic, count: n}}
parameters:
  n: {integer, min: 2, doc: number of lines}
equations: |
  p[2..n].p = p[1..n - 1].p   # one pressure
  sum(p.q) = 0                # nothing is stored
"""
    text = """\
model: three_lines
components:
  pump:   {is: FlowSource, u: 12 L/min}
  oil:    {is: Volume, V: 2 L, beta: 1.5 GPa}
  star:   {is: Star, n: 3}
  coarse: {is: Orifice, q_r: 20 L/min, dp_r: 10 bar}
  fine:   {is: Orifice, q_r: 10 L/min, dp_r: 10 bar}
  tank:   {is: Tank}
nodes:
  inlet: [pump.a, oil.a, "star.p[1]"]
  left:  ["star.p[2]", coarse.a]
  right: ["star.p[3]", fine.a]
  back:  [coarse.b, fine.b, tank.a]
simulate: {until: 2 s}
"""
    result = run(tmp_path, star, text)
    (tmp_path / "each").mkdir()
    single = run(tmp_path / "each", star.replace("p[2..n].p = p[1..n - 1].p", "each i in 2..n: p[i].p = p[i - 1].p"), text)
    assert (result.si["inlet.p"] == single.si["inlet.p"]).all()
    assert result.si["fine.q"][-1] == pytest.approx(4e-3/60, rel=1e-4)  # 12 L/min, shared as 10 to 20


# -- wires between whole arrays of ports ---------------------------------------------------------------------------------
FIELDS = """
model: fields
components:
  masses:  {is: IField, n: 2, M: [2 W*s, 1 W*s, 1 W*s, 2 W*s]}
  springs: {is: CField, n: 2, K: [5 W/s, -1 W/s, -1 W/s, 5 W/s]}
nodes:
  bonds: [masses.a, springs.a]
initial: {"springs.q[1]": 1 s}
simulate: {until: 5 s, every: 10 ms}
"""


def test_a_node_of_whole_arrays_is_an_array_of_nodes() -> None:
    found = hb.simulate(hb.loads(FIELDS), rtol=1e-10)
    # M p'' = -K q: on (1, 1) 3 and 4, on (1, -1) 1 and 6
    q = [(np.cos(np.sqrt(4/3)*found.time) + sign*np.cos(np.sqrt(6)*found.time))/2 for sign in (1, -1)]
    assert found["springs.q[1]"] == pytest.approx(q[0], abs=1e-7)
    assert found["bonds[2].e"] == pytest.approx(5*q[1] - q[0], abs=1e-6)
    apart = hb.loads(FIELDS.replace("bonds: [masses.a, springs.a]",
                                    'one: ["masses.a[1]", "springs.a[1]"]\n  two: ["masses.a[2]", "springs.a[2]"]'))
    assert hb.simulate(apart, rtol=1e-10)["springs.q[2]"] == pytest.approx(q[1], abs=1e-7)


def test_whole_arrays_are_one_wire_in_a_drawing() -> None:
    picture = hb.draw(hb.loads(FIELDS))
    assert ">bonds<" in picture
    assert "bonds[2]" not in picture
    assert hb.draw(hb.loads(FIELDS), highlight={"node bonds[2]": "here"}) != picture
    assert 'data-node="bonds[1]"' in picture
    assert picture.count('stroke-width="3.52"') == 1  # wider than a wire of one element, 1.6


def test_wires_to_elements_of_a_vector_say_in_a_drawing_which() -> None:
    picture = hb.draw(hb.load("examples/linear_system"))
    assert [text for text in ("u[1]", "u[2]", "y[1..2]", "y[3]", "y[1]") if f">{text}<" in picture] == \
        ["u[1]", "u[2]", "y[1..2]", "y[3]"]  # `back` has one output, y[1]


@pytest.mark.parametrize(("old", "new", "said"), [
    ("springs.a]", '"springs.a[1]"]', "'springs.a[1]' is one port"),
    ("n: 2, K: [5 W/s, -1 W/s, -1 W/s, 5 W/s]", "n: 1, K: [5 W/s]",
     "'masses.a' is an array of 2, 'springs.a' is an array of 1"),
])
def test_arrays_that_do_not_fit_each_other(old: str, new: str, said: str) -> None:
    with pytest.raises(hb.ModelError, match="array-length") as caught:
        hb.assemble(hb.loads(FIELDS.replace(old, new)))
    assert said in str(caught.value)


@pytest.mark.parametrize(("matrix", "symmetric", "definite", "semidefinite"), [
    ([2, 1, 1, 2], 1, 1, 1), ([2, 1, -1, 2], 0, 1, 1), ([1, 1, 1, 1], 1, 0, 1), ([1, 2, 2, 1], 1, 0, 0),
    ([0, 0, 0, 0], 1, 0, 1),
    ([0, 1, 1, 0], 1, 0, 0), ([-1], 1, 0, 0), ([4, 2, 0, 2, 2, 1, 0, 1, 1], 1, 0, 1), ([0, 5, -5, 0], 0, 0, 1)])
def test_properties_of_matrices_by_their_eigenvalues(matrix: list[float], symmetric: int, definite: int, semidefinite: int
                                                     ) -> None:
    n = round(len(matrix)**0.5)
    whole = np.reshape(matrix, (n, n))
    eigenvalues = np.linalg.eigvalsh((whole + whole.T)/2)
    assert (int(np.array_equal(whole, whole.T)), int(eigenvalues.min() > 1e-12), int(eigenvalues.min() > -1e-12)) == (
        symmetric, definite, semidefinite)
    context = Context(lambda text, name: ca.SX(ca.DM(matrix)), lambda x: x)
    found = [int(float(evaluate(parse_formula(f"{name}(K)"), context)))
             for name in ("symmetric", "definite", "semidefinite")]
    assert found == [symmetric, definite, semidefinite]


def test_a_block_passes_a_whole_array_on(tmp_path: Path) -> None:
    (tmp_path / "lossy.yaml").write_text("""
component: Lossy
summary: A field with losses.
ports: {p: {domain: bond, count: n}}
parameters:
  n: {integer, min: 2, default: 2, doc: bonds}
components:
  field: {is: CField, n: =n, K: [5 W/s, -1 W/s, -1 W/s, 5 W/s]}
  loss:  {is: RField, n: =n, R: [0 W, 1 W, -1 W, 0 W]}
nodes:
  inner: [p, field.a, loss.a]
""", encoding="utf-8")
    text = FIELDS.replace("is: CField, n: 2, K: [5 W/s, -1 W/s, -1 W/s, 5 W/s]", "is: Lossy").replace(
        "springs.a]", "springs.p]")
    found = hb.simulate(hb.loads(text.replace("springs.q[1]", "springs.field.q[1]"), tmp_path))
    flat = hb.simulate(hb.loads(FIELDS.replace("springs.a]", "springs.a, loss.a]").replace(
        "nodes:", "  loss: {is: RField, n: 2, R: [0 W, 1 W, -1 W, 0 W]}\nnodes:")))
    assert found["bonds[2].e"] == pytest.approx(flat["bonds[2].e"], abs=1e-6)
    assert found["springs.inner[2].e"] == pytest.approx(found["bonds[2].e"])
