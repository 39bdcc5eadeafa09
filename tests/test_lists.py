"""Lists of parameters and variables: given in brackets or by a column of a file, their length, and what goes wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import heavebond as hb
from heavebond.cli import main
from heavebond.core.errors import HeavebondError, ModelError
from heavebond.language.component_file import parse_component
from heavebond.language.definition import Component
from heavebond.language.laws import check
from heavebond.language.library import library
from heavebond.language.lists import written_out
from heavebond.language.power_law import check_power
from heavebond.text.yaml_source import parse

CHAIN = """\
component: Chain
summary: Masses between springs in line.
ports: {a: translational}
parameters:
  n: {integer, min: 2, doc: number of masses}
  m: {unit: kg, min: 0, count: n, doc: masses}
  c: {unit: N/m, min: 0, doc: stiffness of each spring}
variables:
  x: {unit: m, count: n, doc: positions}
  v: {unit: m/s, count: n, doc: speeds}
requires: ["m[i] >= m[i + 1] for i in 1..n - 1"]
equations: |
  each i in 1..n: der(x[i]) = v[i]                                                     # speed
  m[1]*der(v[1]) = c*(a.x - x[1]) - c*(x[1] - x[2])                                    # the first mass
  each i in 2..n - 1: m[i]*der(v[i]) = c*(x[i - 1] - x[i]) - c*(x[i] - x[i + 1])       # one in the middle
  m[n]*der(v[n]) = c*(x[n - 1] - x[n])                                                 # the last mass
  a.f = c*(a.x - x[1])                                                                 # what it takes
stores: 1/2*c*(a.x - x[1])**2 + sum(1/2*c*(x[i] - x[i + 1])**2 for i in 1..n - 1) + sum(1/2*m[i]*v[i]**2 for i in 1..n)
"""


def component(text: str) -> Component:
    return parse_component(parse(text, Path("chain.yaml"), "chain.yaml"), library().domains)


def diagram(tmp_path: Path, settings: str, more: str = "") -> hb.Model:
    (tmp_path / "components").mkdir(exist_ok=True)
    (tmp_path / "components" / "chain.yaml").write_text(CHAIN)
    return hb.loads("model: trial\n" f"""components:
  wall: {{is: Fixed}}
  chain: {{is: Chain, {settings}}}
nodes: {{wall: [wall.a, chain.a]}}
initial: {{"chain.v[3]": 0.1 m/s}}
simulate: {{until: 1 s}}
{more}""", tmp_path)


def test_a_component_with_lists_keeps_the_three_laws() -> None:
    check(component(CHAIN), library().domains)
    assert check_power(component(CHAIN), library().domains).holds
    wrong = component(CHAIN.replace("c*(x[i - 1] - x[i]) -", "c*(x[i - 1] - 1.01*x[i]) -"))
    check(wrong, library().domains)
    assert not check_power(wrong, library().domains).holds


def test_the_equations_are_those_of_a_chain(tmp_path: Path) -> None:
    result = hb.simulate(diagram(tmp_path, "m: [2 kg, 2 kg, 1 kg], c: 500 N/m"))
    mass = np.diag([2.0, 2.0, 1.0])
    stiffness = 500*np.array([[2.0, -1, 0], [-1, 2, -1], [0, -1, 1]])
    squares, shapes = np.linalg.eig(np.linalg.solve(mass, stiffness))
    share = np.linalg.solve(shapes, [0, 0, 0.1])
    expected = shapes[2] @ (share/np.sqrt(squares)*np.sin(np.sqrt(squares)*result.time[:, None])).T
    # integration to a relative 1e-8 over some ten periods
    assert result["chain.x[3]"] == pytest.approx(expected, abs=2e-7)


def test_one_element_may_be_set_named_and_differentiated(tmp_path: Path) -> None:
    model = diagram(tmp_path, "m: [2 kg, 2 kg, 1 kg], c: 500 N/m", 'set: {"chain.m[2]": 1.5 kg}\n'
                    'show: {sum: {is: "chain.m[1] + chain.m[2] + chain.m[3]", unit: kg}}')
    assert hb.simulate(model)["sum"][-1] == 4.5
    other = hb.simulate(model.with_parameters({"chain.m[2]": 1.2}), sensitivities=["chain.m[2]"])
    above, below = (hb.simulate(model.with_parameters({"chain.m[2]": 1.2 + step})) for step in (1e-3, -1e-3))
    slope = (above["chain.x[3]"] - below["chain.x[3]"])/2e-3
    # central differences with a step of a thousandth leave some 1e-6 of the slope, the error control of the runs 1e-4
    assert other.sensitivity("chain.x[3]", "chain.m[2]") == pytest.approx(slope, abs=1e-3*np.abs(slope).max())


def test_a_list_may_stand_in_a_file(tmp_path: Path) -> None:
    (tmp_path / "masses.csv").write_text("name,mass\n1,2000\n2,2000\n3,1000\n")
    from_file = diagram(tmp_path, "m: {file: masses.csv, values: mass, unit: g}, c: 500 N/m")
    inline = diagram(tmp_path, "m: [2 kg, 2 kg, 1 kg], c: 500 N/m")
    assert hb.simulate(from_file)["chain.x[3]"] == pytest.approx(hb.simulate(inline)["chain.x[3]"])
    set_later = diagram(tmp_path, "c: 500 N/m", "set: {chain.m: {file: masses.csv, values: mass, unit: g}}")
    assert hb.simulate(set_later)["chain.x[3]"] == pytest.approx(hb.simulate(inline)["chain.x[3]"])


@pytest.mark.parametrize(("settings", "code", "words"), [
    ("m: [2 kg, 1 kg], n: 3, c: 500 N/m", "parameter-missing", "needs a list of 3 values for m (masses); m[3]"),
    ("m: [2 kg, 1 kg, 1 kg], n: 2, c: 500 N/m", "parameter-unknown", "m[3]"),
    ("m: 2 kg, n: 2, c: 500 N/m", "parameter-list", "m of Chain is a list"),
    ("m: [2 kg, 1 m, 1 kg], c: 500 N/m", "unit-wrong", "chain.m[2]"),
    ("m: [2 kg, -1 kg, 1 kg], c: 500 N/m", "parameter-bound", "chain.m[2]"),
    ("m: [1 kg, 2 kg, 1 kg], c: 500 N/m", "requirement", "m[i] >= m[i + 1] for i in 1..n - 1"),
    ("c: 500 N/m", "parameter-missing", "needs a value for n"),
    ("m: [2 kg], c: 500 N/m", "parameter-bound", "n = 1"),
    ("m: {file: nowhere.csv, values: mass, unit: g}, c: 500 N/m", "record-missing", "nowhere.csv"),
    ("m: {file: masses.csv, values: weight, unit: g}, c: 500 N/m", "record-column-unknown", "weight"),
    ("m: {file: masses.csv, values: mass}, c: 500 N/m", "key-missing", "unit"),
])
def test_what_is_wrong_with_a_list_is_said(tmp_path: Path, settings: str, code: str, words: str) -> None:
    (tmp_path / "masses.csv").write_text("name,mass\n1,2000\n2,2000\n3,1000\n")
    with pytest.raises(HeavebondError) as error:
        hb.simulate(diagram(tmp_path, settings))
    found = [p for p in error.value.problems if p.code == code]
    assert found, error.value
    assert any(words in p.message for p in found)


@pytest.mark.parametrize(("old", "new", "code"), [
    ("der(x[i]) = v[i]", "der(x[i]) = v   ", "list-length"), ("c*(a.x - x[1])  ", "c[1]*(a.x - x[1])  ", "list-index")])
def test_a_list_stands_for_no_number_and_a_number_has_no_index(old: str, new: str, code: str) -> None:
    assert old in CHAIN
    with pytest.raises(ModelError) as error:
        check(component(CHAIN.replace(old, new, 1)), library().domains)
    assert code in [p.code for p in error.value.problems]


def test_the_same_numbers_give_the_same_component() -> None:
    chain = component(CHAIN)
    assert written_out(chain, {"n": 4}) is written_out(chain, {"n": 4})
    assert list(written_out(chain, {"n": 2}).variables) == ["x[1]", "x[2]", "v[1]", "v[2]"]


def test_an_element_is_fitted_and_written_back(tmp_path: Path) -> None:
    (tmp_path / "components").mkdir()
    (tmp_path / "components" / "chain.yaml").write_text(CHAIN)
    (tmp_path / "rig.yaml").write_text("""model: rig
components:
  wall: {is: Fixed}
  chain: {is: Chain, m: [2 kg, 2 kg, 1 kg], c: 500 N/m}
nodes: {wall: [wall.a, chain.a]}
initial: {"chain.v[3]": 0.1 m/s}
simulate: {until: 2 s, every: 20 ms}
""")
    truth = hb.simulate(hb.load(tmp_path / "rig.yaml").with_parameters({"chain.m[2]": 1.7}))
    rows = "".join(f"{t!r},{x!r}\n" for t, x in zip(truth.time.tolist(), truth["chain.x[3]"].tolist(), strict=True))
    (tmp_path / "record.csv").write_text("t,x\n" + rows)
    (tmp_path / "rig_fit.yaml").write_text("""experiment: a mass in the middle
model: rig.yaml
records: {a: {file: record.csv, use: fit}}
time: {column: t, unit: s}
outputs: {"chain.x[3]": {column: x, unit: m, noise: 0.1 mm}}
free: {"chain.m[2]": 1.2 .. 2 kg}
""")
    result = CliRunner().invoke(main, ["fit", str(tmp_path / "rig_fit.yaml"), "--write", str(tmp_path / "fitted.yaml")])
    assert result.exit_code == 0, result.output
    # the record has no noise; what the search leaves is far below the 0.1 mm that it takes for noise
    written = hb.assemble(hb.load(tmp_path / "fitted.yaml")).parameter_values
    assert written["chain.m[2]"] == pytest.approx(1.7, rel=1e-3)


def test_the_library_tells_lists_from_numbers() -> None:
    result = CliRunner().invoke(main, ["library", "Lookup"])
    assert "list, $U" in result.output


def test_one_value_for_a_list_or_a_matrix_is_named() -> None:
    for settings, wanted in (("is: TableSource, t: 1 s, v: [0, 1]", "Write `t: [1 s, 1 s]`, with a value for each element"),
                             ("is: PredictiveController, n: 1, m: 1, r: 1, y_min: -1, y_max: [1], rate: [1 1/s], T_s: 1 s",
                              "Write `y_min: [-1]`, with a value for each element"),
                             ("is: MatrixGain, n: 2, m: 2, K: 2", "Write `K: [[2, 2]]`, with a value for each element of")):
        with pytest.raises(hb.ModelError, match="not one value") as error:
            hb.assemble(hb.loads(f"model: m\ncomponents: {{part: {{{settings}}}}}\n"))
        assert wanted in str(error.value)
