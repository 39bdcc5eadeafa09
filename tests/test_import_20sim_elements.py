# Functions of vectors, elements that the run chooses, global constants and names of nodes in imported 20-sim models.

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from test_import_20sim import at, one_part, run_part
from test_import_20sim_models import block, imported, one, part

import heavebond as hb
from heavebond.import_20sim.importer import import_emx
from heavebond.language.library import library


def test_functions_act_on_each_element_of_a_vector(tmp_path: Path) -> None:
    body = ("variables\n real v[3], w[3], s[2,2];\nequations\n v = [time; 2 * time; -3 * time];\n"
            " w = limit (v, -1, [1; 1.5; 2]);\n a = sum (w);\n b = sum (int (v, [1; 2; 3]));\n"
            " s = arctan2 ([time, 1; 2, 3], 2);\n c = s[2,1];")
    run = run_part(tmp_path, one_part(body, "a b c"))
    assert at(run, "a", 0.2, 1.9) == pytest.approx([0.0, 1 + 1.5 - 1], abs=1e-9)
    assert at(run, "b", 1.0) == pytest.approx([6.0], abs=1e-6)
    assert at(run, "c", 1.0) == pytest.approx([np.arctan2(2, 2)])


def test_vectors_are_sampled_and_held(tmp_path: Path) -> None:
    body = ("variables\n real v[2], w[2];\nequations\n v = sample ([time; 10 * time]);\n w = hold (v - previous (v));\n"
            " a = w[1];\n b = w[2];")
    run = run_part(tmp_path, one_part(body, "a b"), untranslated=1)  # the sample time is not stated
    assert at(run, "a", 0.55, 1.95) == pytest.approx([0.1, 0.1], abs=1e-6)
    assert at(run, "b", 0.55, 1.95) == pytest.approx([1.0, 1.0], abs=1e-6)


def test_an_element_that_the_run_chooses_is_assigned(tmp_path: Path) -> None:
    """`n` is 1, then 2, then 3: each element gets the value of the time at which it was chosen last."""
    body = ("variables\n integer n;\n real v[3];\ncode\n n = if time < 0.5 then 1 else if time < 1 then 2 else 3 end end;\n"
            " v[n] = n * 10;\n a = v[1];\n b = v[2];\n c = v[3];")
    run = run_part(tmp_path, one_part(body, "a b c"))
    assert at(run, "a", 0.3, 0.8, 1.8) == [10, 10, 10]
    assert at(run, "b", 0.3, 0.8, 1.8) == [0, 20, 20]
    assert at(run, "c", 0.3, 0.8, 1.8) == [0, 0, 30]


def test_global_constants_give_sizes_and_values_to_submodels_before_them(tmp_path: Path) -> None:
    parts = part("First", "signal out y", "constants\n integer global n;\n real global weights[3];\nvariables\n real v[n];\n"
                 " integer k;\ncode\n for k = 1 to n do v[k] = k * weights[k] * time; end;\n y = sum (v);") + \
        part("Last", "signal in u; signal out y", "constants\n integer global n = 3;\n"
             " real global weights[3] = [1; 10; 100];\nequations\n y = u / n + weights[1];")
    run = imported(tmp_path, parts, "First\\y -> Last\\u", 2.0)
    assert run["Last.y"][-1] == pytest.approx(2 * 321 / 3 + 1)


def test_a_node_does_not_take_the_name_of_a_port(tmp_path: Path) -> None:
    inner = block("Outer", "signal out A_y", part("A", "signal out y", "equations\n y = time + time^2;")
                  + part("B", "signal in u; signal out y", "equations\n y = u^2 + u;"), "A\\y -> B\\u; B\\y -> A_y")
    outer = part("Use", "signal in u; signal out y", "equations\n y = u^3;")
    run = imported(tmp_path, inner + outer, "Outer\\A_y -> Use\\u", 1.0)
    assert run["Use.y"][-1] == pytest.approx(6**3)


def test_branches_that_share_their_parts_are_imported_in_time(tmp_path: Path) -> None:
    """Each branch reads what those before it have set, so that the values written out would double with each."""
    lines = "".join(f" if x{k % 4} > {k} then x{(k + 1) % 4} = x{k % 4} + x{(k + 2) % 4}; x{(k + 3) % 4} = {k}; end;\n"
                    for k in range(40))
    text = one_part(f"variables\n real x0, x1, x2, x3;\ncode\n x0 = time;\n{lines} y = x1;", "y")
    (tmp_path / "m.emx").write_text(text)
    begin = time.monotonic()
    import_emx(tmp_path / "m.emx")
    assert time.monotonic() - begin < 30


def test_a_submodel_that_only_passes_its_ports_on(tmp_path: Path) -> None:
    through = block("Through", "signal in a [2]; signal out b [2]; power in p; power out q", "   plug a 0 0;\n",
                    "a -> b; p => q")
    parts = through + part("Source", "signal out y [2]", "equations\n y = [time; 3];") + \
        part("Use", "signal in u [2]; signal out y", "equations\n y = u[1] * u[2] + u[1]^2;") + \
        part("Push", "power out p", "equations\n p.e = 6;") + \
        part("Rub", "power in p", "parameters\n real R = 2;\nequations\n p.f = p.e / R + 0 * p.e^3;")
    run = imported(tmp_path, parts, "Source\\y -> Through\\a; Through\\b -> Use\\u; Push\\p => Through\\p;"
                   "Through\\q => Rub\\p", 2.0)
    assert run["Use.y"][-1] == pytest.approx(2 * 3 + 4)
    assert run["Rub.a.f"][-1] == pytest.approx(3)


def test_a_zero_of_the_experiment_does_not_replace_a_value_of_the_global_relations(tmp_path: Path) -> None:
    relations = ("description '<Description><GlobalRelations>parameters\n real La = 0.5;\n real K = 2;\n</GlobalRelations>"
                 "</Description>';\n")
    inner = part("Coil", "signal out y", "parameters\n real global La;\n real global K;\nequations\n y = K * time / La;")
    outer = block("Motor", "signal out y", inner, "Coil\\y -> y").replace(" type Submodel", relations + " type Submodel")
    use = part("Use", "signal in u; signal out y", "equations\n y = u^2;")
    experiment = ("<Variables><Parameters><Variable><Name>La</Name><Value>0</Value></Variable>"
                  "<Variable><Name>K</Name><Value>3</Value></Variable></Parameters></Variables>")
    run = imported(tmp_path, outer + use, "Motor\\y -> Use\\u", 1.0, experiment, untranslated=1)
    assert run["Use.y"][-1] == pytest.approx(36)


def test_a_state_of_a_combustion_is_compared_where_it_is_held(tmp_path: Path) -> None:
    """The output `state` is 0, 1, 2 in turn; conditions ask for its value."""
    body = ("code\n if time > 0.5 and state == 0 then state = 1; end;\n if time > 1 and state == 1 then state = 2; end;\n"
            " y = if state == 2 then 7 else 3 end;")
    run = run_part(tmp_path, one_part(body, "state y"))
    assert at(run, "state", 0.3, 0.8, 1.5) == [0, 1, 2]
    assert at(run, "y", 0.3, 0.8, 1.5) == [3, 3, 7]


def test_a_free_port_has_no_effort_where_it_takes_one(tmp_path: Path) -> None:
    """A file of a library that is one mass: its port is free of force, so the mass keeps its speed."""
    mass = part("Mass", "power in p; signal out v", "parameters\n real m = 2;\nvariables\n real s;\nequations\n"
                " s = int (p.e + 0 * s^2, 6);\n p.f = s / m;\n v = p.f;")
    block_of_it = block("Cart", "power in p; power out q", mass + part("Rub", "power in p", "equations\n p.e = 3 * p.f^3;")
                        + one("Both"), "p => Both\\p; Both\\p => Mass\\p; q => Rub\\p")
    (tmp_path / "m.emx").write_text(
        f"<Document><Model version='4.6'><Sidops><![CDATA[{block_of_it}]]></Sidops></Model></Document>")
    made = import_emx(tmp_path / "m.emx", frozenset(library().names()))
    assert made.untranslated == []
    made.write(tmp_path / "out")
    run = hb.simulate(hb.load(str(tmp_path / "out" / "m.yaml")))
    assert run.time[-1] == 10 and run["Cart.Mass.a.f"] == pytest.approx(np.full(run.time.size, 3.0))
    assert run["Cart.Rub.p.f"] == pytest.approx(np.zeros(run.time.size), abs=1e-9)


def test_a_linear_system_is_that_of_the_library(tmp_path: Path) -> None:
    """A mass on a spring with two inputs, as the editor of linear systems writes it."""
    body = ("parameters\n real hidden A [2, 2] = [0, 1; -4, 0];\n real hidden B [2, 2] = [0, 0; 4, 1];\n"
            " real hidden C [1, 2] = [1, 0];\n real hidden D [1, 2] = [0, 0.5];\n real hidden x0 [2] = [1; 0];\n"
            "variables\n real x [2];\nequations\n ddt (x, x0) = A * x + B * u;\n y = C * x + D * u;")
    parts = part("Drive", "signal out y [2]", "equations\n y = [time; 0];") + \
        part("Plant", "signal in u [2]; signal out y", body) + \
        part("Use", "signal in u; signal out y", "equations\n y = u^2;")
    plots = ("<PlotSpecs><Plots><Plot><Curves><Curve><YCurveData><VarName>Plant\\y</VarName></YCurveData></Curve></Curves>"
             "</Plot></Plots></PlotSpecs>")
    run = imported(tmp_path, parts, "Drive\\y -> Plant\\u; Plant\\y -> Use\\u", 2.0, plots)
    text = (tmp_path / "out" / "m.yaml").read_text()
    assert "is: LinearSystem, A: [[0 1/s, 1 1/s], [-4 1/s, 0 1/s]], B:" in text and "D: [[0, 0.5]]" in text
    expected = run.time + np.cos(2 * run.time) - np.sin(2 * run.time) / 2
    assert run["Plant_y"] == pytest.approx(expected, abs=1e-6)


def test_two_names_for_one_value_of_a_branch(tmp_path: Path) -> None:
    """`r` and `v[2]` are the same: one of them stands for the other, and not each for the other."""
    body = ("variables\n real r, v[3];\ncode\n if time < 1 then r = (time + 2) / 3; v[2] = r; v[3] = v[2] * r; y = v[3];\n"
            " else y = 0; end;")
    run = run_part(tmp_path, one_part(body, "y"))
    assert at(run, "y", 0.4, 1.5) == pytest.approx([0.64, 0])


def test_an_index_of_parameters_is_required_to_lie_in_its_vector(tmp_path: Path) -> None:
    """An index that the run decides is listed instead."""
    parts = (part("Clock", "signal out y", "equations\n y = 1 + 2 * time;")
             + part("Case", "signal in u; signal out y", "parameters\n integer n = 2;\n real v[3] = [4; 5; 6];\n"
                    "equations\n y = u * v[n];")
             + part("Run", "signal in u; signal out y", "parameters\n real v[3] = [4; 5; 6];\nvariables\n integer n;\n"
                    "equations\n n = round (u);\n y = v[n] + u;")
             + part("Lost", "signal out y", "parameters\n integer n = 9;\nequations\n w[n] = time;\n y = 1;"))
    run = imported(tmp_path, parts, "Clock\\y -> Case\\u; Clock\\y -> Run\\u", 2.0, untranslated=2)
    assert run["Case.y"][-1] == pytest.approx(25)
    assert run["Run.y"][-1] == pytest.approx(11)  # 5 for an index, of which there is none
    assert 'requires: ["n > 0.5", "n < 3.5"]' in (tmp_path / "out" / "components" / "case.yaml").read_text()
    text = (tmp_path / "out" / "m.yaml").read_text().replace("{is: Case,", "{is: Case, n: 4,")
    (tmp_path / "out" / "m.yaml").write_text(text)
    with pytest.raises(hb.ModelError, match=r"n < 3\.5"):
        hb.simulate(hb.load(tmp_path / "out" / "m.yaml"))


def test_whole_parameters_give_the_turns_of_loops_and_sizes(tmp_path: Path) -> None:
    """A mean over a field of n x n values, of which the experiment says that n is 2."""
    body = ("parameters\n integer n = 3;\n real step = 0.5;\nvariables\n real offset[n];\n real field[n,n];\n"
            " integer i, k;\ninitialequations\n for i = 0 to n - 1 do offset[i + 1] = (i - (n - 1) / 2) * step; end;\n"
            "equations\n for i = 1 to n do\n  for k = 1 to n do\n   field[i,k] = (u + offset[i]) * (u + offset[k]);\n"
            "  end;\n end;\n y = msum (field) / n^2;")
    parts = part("Clock", "signal out y", "equations\n y = time;") + part("Mean", "signal in u; signal out y", body)
    run = imported(tmp_path, parts, "Clock\\y -> Mean\\u", 2.0,
                   "<Variables><Parameters><Variable><Name>Mean\\n</Name><Value>2</Value></Variable></Parameters></Variables>")
    offsets = np.array([-0.25, 0.25])
    exact = np.array([np.mean(np.outer(t + offsets, t + offsets)) for t in run.time])
    assert np.abs(run["Mean.y"] - exact).max() < 1e-12
