"""Matrices and vectors of signals: products, transposes, parts, one wire for a vector, outputs by elements, mistakes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

import heavebond as hb
from heavebond.core.errors import HeavebondError
from heavebond.language.component_file import parse_component
from heavebond.language.laws import check
from heavebond.language.library import library
from heavebond.language.power_law import check_power
from heavebond.text.yaml_source import parse

PLATE = """\
component: Plate
summary: Two rows of three masses of a grid that springs tie to the ground, and an output for each row.
ports:
  u: {signal: in, unit: N, count: r, doc: a force on each row}
  y: {signal: out, unit: m, count: r, doc: mean place of each row}
parameters:
  r: {integer, min: 1, doc: rows}
  c: {integer, min: 1, doc: columns}
  K: {unit: N/m, count: [c, c], doc: stiffness of a row}
  m: {unit: kg, count: [r, c], min: 1e-3 kg, doc: masses}
variables:
  X: {unit: m, count: [r, c], doc: places}
  V: {unit: m/s, count: [r, c], doc: velocities}
  S: {unit: N, count: [c, r], doc: "forces, of each row in a column"}
requires: [symmetric(K), semidefinite(K)]
equations: |
  der(X) = V                                                              # rates
  S = K*transpose(X)                                                      # springs
  each i in 1..r: y[i] = sum(X[i, 1..c])/c                                # means
  each i in 1..r: m[i, 1]*der(V[i, 1]) = u[i] - S[1, i]                   # first column
  each i in 1..r: m[i, 2]*der(V[i, 2..c]) = -S[2..c, i]                   # the others have the mass of the second
power: source
"""
RIG = """\
model: rig
components:
  plate:
    is: Plate
    K: [[40 N/m, -20 N/m, 0 N/m], [-20 N/m, 40 N/m, -20 N/m], [0 N/m, -20 N/m, 20 N/m]]
    m: [[1 kg, 2 kg, 2 kg], [1.5 kg, 1 kg, 1 kg]]
  mix: {is: MatrixGain, K: [[1 N/m, 0.5 N/m], [0 N/m, -1 N/m]]}
nodes:
  places: [plate.y, mix.u]
  forces: [mix.y, plate.u]
initial: {"plate.X[1, 1]": 0.1 m, "plate.X[2][3]": -0.2 m}
show:
  grid:   {is: plate.X, unit: m}
  row:    {is: "plate.X[2, 1..3]", unit: m}
  places: {unit: m}
  work:   {is: "dot(plate.V[1, 1..3], plate.S[1..3, 1])", unit: W}
simulate: {until: 2 s}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "plate.yaml").write_text(PLATE)
    return tmp_path


def exact(times: np.ndarray) -> np.ndarray:
    """Places (2, 3, N) and velocities by the exponential of the whole system's matrix."""
    k = np.array([[40.0, -20, 0], [-20, 40, -20], [0, -20, 20]])
    m = np.array([[1, 2, 2], [1.5, 1, 1]], float)
    gain = np.array([[1, 0.5], [0, -1]])
    system = np.zeros((12, 12))
    system[:6, 6:] = np.eye(6)
    for i in range(2):
        for j in range(3):
            system[6 + 3*i + j, 3*i:3*i + 3] -= k[j]/m[i, j]
            if j == 0:
                for other in range(2):
                    system[6 + 3*i, 3*other:3*other + 3] += gain[i, other]/3/m[i, 0]
    start = np.zeros(12)
    start[0], start[5] = 0.1, -0.2
    return np.array([expm(system*t) @ start for t in times]).T


def test_a_system_of_matrices_is_that_of_its_elements(folder: Path) -> None:
    run = hb.simulate(hb.loads(RIG, folder), rtol=1e-9, atol=1e-12)
    found = exact(run.time[::50])
    for i in range(2):
        for j in range(3):
            # 1e-9 of each of some thousand steps
            np.testing.assert_allclose(run[f"grid[{i + 1}][{j + 1}]"][::50], found[3*i + j], atol=1e-6)
    np.testing.assert_allclose(run["row[3]"], run["plate.X[2][3]"], rtol=1e-12)
    np.testing.assert_allclose(run["places[2]"], run["plate.y[2]"], rtol=1e-12)
    assert "places[1]" in run.names() and "places" not in run.names()


def test_the_laws_of_matrices_hold_and_name_their_elements(folder: Path) -> None:
    made = parse_component(parse(PLATE, Path("plate.yaml"), "plate.yaml"), library().domains)
    check(made, library().domains)
    assert check_power(made, library().domains).holds
    labels = [e.label for e in hb.assemble(hb.loads(RIG, folder)).flat.equations]
    assert "springs, element 3, 2" in labels and "rates, element 2, 3" in labels


def test_values_of_a_matrix_are_set_by_element_in_either_form(folder: Path) -> None:
    for name in ("plate.K[1, 2]", "plate.K[1][2]", "plate.K[1,2]"):
        model = hb.loads(RIG, folder).with_parameters({name: "-19 N/m"})
        with pytest.raises(hb.ModelError, match=r"symmetric\(K\)"):
            hb.assemble(model)
    both = hb.loads(RIG + "set: {\"plate.K[1, 2]\": -19 N/m, \"plate.K[2, 1]\": -19 N/m}\n", folder)
    assert hb.assemble(both).parameter_values["plate.K[2][1]"] == -19
    run = hb.simulate(hb.loads(RIG, folder), sensitivities=["plate.m[1][2]"])
    model, h = hb.loads(RIG, folder), 1e-3
    ends = [hb.simulate(model.with_parameters({"plate.m[1][2]": 2 + d}), rtol=1e-9)["places[1]"][-1] for d in (h, -h)]
    # runs of 1e-9 over steps of 1e-3
    assert run.sensitivity("places[1]", "plate.m[1][2]")[-1] == pytest.approx((ends[0] - ends[1])/(2*h), abs=2e-5)


def test_one_list_of_a_matrix_is_its_rows(folder: Path) -> None:
    flat = RIG.replace("[[1 kg, 2 kg, 2 kg], [1.5 kg, 1 kg, 1 kg]]",
                       "[1 kg, 2 kg, 2 kg, 1.5 kg, 1 kg, 1 kg]\n    r: 2\n    c: 3")
    for text in (RIG, flat):
        assert hb.assemble(hb.loads(text, folder)).parameter_values["plate.m[2][1]"] == 1.5


def test_a_vector_goes_over_one_wire_or_in_parts() -> None:
    text = """\
model: wires
components:
  source: {is: MatrixGain, K: [[1], [2], [3]], u: ["=sin(time/1 s)"]}
  whole:  {is: MatrixGain, K: [[1, 1, 1]], u: =source.y}
  tail:   {is: MatrixGain, K: [[1, 10]]}
  single: {is: Gain, k: 4}
nodes:
  rest:  ["source.y[2..3]", tail.u]
  first: ["source.y[1]", single.u]
  sums:  [whole.y]
  tails: [tail.y]
  last:  [single.y]
simulate: {until: 2 s}
"""
    run = hb.simulate(hb.loads(text))
    wave = np.sin(run.time)
    for name, factor in (("sums[1]", 6), ("tails[1]", 32), ("last", 4), ("rest[2]", 3)):
        np.testing.assert_allclose(run[name], factor*wave, rtol=1e-12, atol=1e-15)


def test_vectors_of_signals_pass_the_ports_of_a_block(tmp_path: Path) -> None:
    (tmp_path / "stage.yaml").write_text("""\
component: Stage
summary: Two gains in line.
ports:
  u: {signal: in, unit: 1, count: 2, doc: inputs}
  y: {signal: out, unit: 1, count: 2, doc: outputs}
components:
  first:  {is: MatrixGain, K: [[0, 1], [1, 0]]}
  second: {is: MatrixGain, K: [[2, 0], [0, 3]]}
nodes: {in: [u, first.u], between: [first.y, second.u], out: [second.y, y]}
""".replace("in: [", "inner: ["))
    run = hb.simulate(hb.loads("""\
model: blocks
components: {stage: {is: Stage, u: [1, 5]}}
nodes: {out: [stage.y]}
simulate: {until: 1 s}
""", tmp_path))
    assert (run["out[1]"][-1], run["out[2]"][-1]) == (10, 3)


@pytest.mark.parametrize(("old", "new", "code", "said"), [
    ("S = K*transpose(X)", "S = K*X", "list-length", "a product of a matrix of 3 x 3 and a matrix of 2 x 3"),
    ("S = K*transpose(X)", "S = X*K", "list-length", "a matrix of 3 x 2 and a matrix of 2 x 3"),
    ("S = K*transpose(X)", "S = K*transpose(y)", "list-number", "transpose takes a matrix; this is a list"),
    ("S = K*transpose(X)", "S = K*y", "list-length", "the sides of the equation are a matrix and a list"),
    ("S = K*transpose(X)", "S = transpose(X)*K", "list-length", "a product of a matrix of 3 x 2 and a matrix of 3 x 3"),
    ("S = K*transpose(X)", "S = K*transpose(X) + 0*y*1", "list-length", "'+' joins"),
    ("der(X) = V", "der(X) = V*transpose(V)", "units-differ", "the right side is in J/kg"),
    ("der(X) = V", "der(X) = sin(V)", "units-argument", "the argument of sin"),
    ("der(X) = V", "der(X) = abs(V)", "list-number", "the argument of abs is a number; this is a matrix"),
    ("X[i, 1..c]", "X[i]", "list-index", "two indices are needed"),
    ("u[i] - S", "u[i, 1] - S", "list-index", "one index is needed"),
    ("X[i, 1..c]", "X[i, 1..4]", "name-unknown", "is not a name in this component"),
    ("symmetric(K)", "symmetric(m)", "list-number", "symmetric takes a square matrix; this is a matrix of 2 x 3"),
    ("count: [c, c], doc", "count: [c, c, c], doc", "count-bad", "rows and columns of a matrix"),
    ("S = K*transpose(X)", "S = y*K", "list-product", "a vector stands on the left of a matrix"),
])
def test_mistakes_with_matrices(folder: Path, old: str, new: str, code: str, said: str) -> None:
    assert old in PLATE
    (folder / "plate.yaml").write_text(PLATE.replace(old, new))
    with pytest.raises(HeavebondError) as caught:
        hb.assemble(hb.loads(RIG, folder))
    assert code in [p.code for p in caught.value.problems], str(caught.value)
    assert any(part in str(caught.value) for part in said.split("|")), str(caught.value)


@pytest.mark.parametrize(("old", "new", "code", "said"), [
    ("[1.5 kg, 1 kg, 1 kg]]", "[1.5 kg, 1 kg]]", "matrix-rows", "differ in length"),
    ("[1.5 kg, 1 kg, 1 kg]]", "1.5 kg]", "matrix-rows", "a list of values and of lists"),
    ("places: [plate.y, mix.u]", "places: [\"plate.y[1]\", mix.u]", "array-length", "an array of 2, 'plate.y[1]' is one"),
    ("places: [plate.y, mix.u]", "places: [\"plate.y[1..3]\", mix.u]", "array-length", "an array of 3"),
    ("places: [plate.y, mix.u]", "places: [\"plate.y[2..3]\", mix.u]", "port-index", "'y[3]' is none of these"),
    ("forces: [mix.y, plate.u]", "forces: [mix.y]", "input-unconnected", "input 'plate.u' has no value"),
    ("forces: [mix.y, plate.u]", "forces: [mix.y, plate.u, plate.y]", "port-on-two-nodes", "'plate.y' is on two nodes"),
    ("is: plate.X, unit: m", "is: 2*plate.X, unit: m", "list-number", "this is a matrix of 2 x 3"),
    ("[1 N/m, 0.5 N/m], [0 N/m, -1 N/m]]", "[1 N/m, 0.5 N/m]]", "array-length", "an array of 1"),
    ("is: plate.X, unit: m", "is: plate.X, unit: kg", "unit-wrong", "grid"),
])
def test_mistakes_in_a_diagram(folder: Path, old: str, new: str, code: str, said: str) -> None:
    assert old in RIG
    with pytest.raises(HeavebondError) as caught:
        hb.assemble(hb.loads(RIG.replace(old, new), folder))
    assert code in [p.code for p in caught.value.problems], str(caught.value)
    assert said in str(caught.value), str(caught.value)


def test_a_store_that_varies_without_a_port_is_refused() -> None:
    """A stiffness that follows the time would make energy; the message names the store with the port of the modulation."""
    with pytest.raises(HeavebondError) as caught:
        hb.assemble(hb.loads("""\
model: refused
components:
  spring: {is: CField, n: 1, K: ["=2 W/s*(1 + time/1 s)"]}
  mass:   {is: IField, n: 1, M: [[1 W*s]]}
nodes: {bonds: [spring.a, mass.a]}
"""))
    assert caught.value.problems[0].code == "parameter-varies"
    assert "MCField" in caught.value.problems[0].hint


@pytest.mark.parametrize(("part", "other", "name"), [
    ("MCField, K_0: [[5 W/s, 0 W/s], [0 W/s, 3 W/s]], K_1: [[1 W/s**2, 0 W/s**2], [0 W/s**2, 0 W/s**2]]",
     "IField, n: 2, M: [[3 W*s, 0 W*s], [0 W*s, 3 W*s]]", "semidefinite_matrix"),
    ("MIField, M_0: [[5 W*s, 0 W*s], [0 W*s, 3 W*s]], M_1: [[1 W, 0 W], [0 W, 0 W]]",
     "CField, n: 2, K: [[3 W/s, 0 W/s], [0 W/s, 3 W/s]]", "definite_matrix")])
def test_a_modulated_store_whose_matrix_becomes_indefinite_is_told(part: str, other: str, name: str) -> None:
    """x = -t**2/(1 s): 5 + x is below zero from sqrt(5) s on."""
    text = f"""\
model: indefinite
components: {{part: {{is: {part}}}, other: {{is: {other}}}, drive: {{is: Sf, u: "=2*time/1 s"}}}}
nodes: {{bonds: [part.a, other.a], slide: [drive.a, part.m]}}
simulate: {{until: 3 s}}
"""
    with pytest.warns(hb.RunWarning, match=f"part.{name} reaches 0"):
        verdict = hb.simulate(hb.loads(text)).verdict
    (found,) = verdict.findings
    assert (found.kind, found.part) == ("range", "part")
    assert found.time == pytest.approx(5**0.5, abs=0.003)  # of the next output point
    assert not hb.simulate(hb.loads(text.replace("until: 3 s", "until: 2 s"))).verdict.findings


def test_a_vector_that_tells_another_size_than_a_matrix() -> None:
    text = "model: gain\ncomponents:\n  k: {is: MatrixGain, K: [[1, 0], [-1, 2]], u: [1, 2, 3]}\nnodes: {out: [k.y]}\n"
    with pytest.raises(hb.ModelError, match="a matrix of 2 rows and 3 columns for K") as caught:
        hb.assemble(hb.loads(text))
    assert "Or give the other lists of 'k' the same length" in str(caught.value)
