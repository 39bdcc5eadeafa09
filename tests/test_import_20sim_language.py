"""Elements of SIDOPS one by one: delays, whole numbers, constants, descriptions, and what an earlier import has left."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from test_import_20sim import at, one_part, run_part
from test_import_20sim_models import block, imported, one, part

import heavebond as hb
from heavebond.cli import main
from heavebond.core.errors import ModelError
from heavebond.import_20sim.importer import import_emx
from heavebond.language.library import library


def written(folder: Path, text: str) -> dict[str, str]:
    """The files of an import."""
    (folder / "cart.emx").write_text(text)
    return import_emx(folder / "cart.emx", frozenset(library().names())).files


def test_a_delay_in_an_equation_is_that_of_pade(tmp_path: Path) -> None:
    """A sine that begins slowly, delayed by 0.3 s; the delay changes nothing in it but its phase."""
    text = one_part("parameters\n real T = 0.3 {s};\nequations\n y = 2 * tdelay (sin (2 * time)^2, T);", "y", 4)
    run = run_part(tmp_path, text, untranslated=1)  # how it is approximated
    late = run.time > 1.5
    # the phase error of order 6 at 4 rad/s and 0.3 s is below 1e-6
    assert run["Part.y"][late] == pytest.approx(2 * np.sin(2 * (run.time[late] - 0.3))**2, abs=2e-5)


def test_a_submodel_that_delays_its_input_is_the_delay_of_the_library(tmp_path: Path) -> None:
    parts = part("Source", "signal out y", "equations\n y = sin (time)^2;") + \
        part("Late", "signal in input; signal out output", "parameters\n real T = 0.25 {s};\nequations\n"
             " output = tdelay (input, T);") + \
        part("Use", "signal in u; signal out y", "equations\n y = u^2 + u;")
    imported(tmp_path, parts, "Source\\y -> Late\\input; Late\\output -> Use\\u", 2.0, untranslated=1)
    diagram = next(tmp_path.rglob("*.yaml")).parent
    text = "\n".join(path.read_text() for path in diagram.glob("*.yaml"))
    assert "{is: Delay, T: 0.25 s" in text


def test_the_rest_of_a_division_counts_from_zero_in_both_directions(tmp_path: Path) -> None:
    run = run_part(tmp_path, one_part("equations\n up = time mod 0.4;\n down = (1 - time) mod 0.4;\n n = time div 0.5;",
                                      "up down n"))
    assert at(run, "up", 0.3, 0.5, 1.9) == pytest.approx([0.3, 0.1, 0.3])
    assert at(run, "down", 0.4, 1.3, 1.9) == pytest.approx([0.2, -0.3, -0.1])
    assert at(run, "n", 0.4, 0.9, 1.9) == [0, 1, 3]


def test_constants_descriptions_and_derivatives_of_expressions(tmp_path: Path) -> None:
    body = ("constants\n real C[2,3] = [1, 2, 3; 4, 5, 6];\nvariables\n real x {m};\n \"the square of the time\"\n"
            "equations\n x = time^2;\n y = C[2,1] * ddt (x * time);\nfinalequations\n x = 0;")
    text = one_part(body, "y").replace("signal out y;", "signal out y {N}; \"what comes out\"")
    assert at(run_part(tmp_path, text), "y", 0.5, 1.5) == pytest.approx([4 * 3 * 0.25, 4 * 3 * 2.25], rel=1e-6)
    (component,) = (t for name, t in written(tmp_path, text).items() if name.startswith("components/"))
    assert "what comes out" in component and "doc: the square of the time" in component


def test_a_component_of_the_library_keeps_the_global_quantity_that_feeds_it(tmp_path: Path) -> None:
    """`Own` hands a global quantity on that another submodel computes: a Gain of 1 by its law."""
    parts = part("Maker", "signal out y", "variables\n real global G;\nequations\n G = 3 * time;\n y = 0;") + \
        part("Own", "signal out y", "variables\n real global G;\nequations\n y = G;") + \
        part("Use", "signal in u; signal out y", "equations\n y = u + 1;")
    run = imported(tmp_path, parts, "Own\\y -> Use\\u", 2.0)
    assert run["Use.y"][-1] == pytest.approx(7)


def test_an_import_tells_what_an_earlier_one_has_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text = one_part("equations\n y = time^2;", "y")
    written(tmp_path, text)
    assert CliRunner().invoke(main, ["import", "cart.emx"]).exit_code == 0
    own = Path("cart/components/mine.yaml")
    own.write_text("component: Mine\nsummary: My own.\nports: {y: {signal: out, unit: 1}}\nequations: y = 1\n")
    written(tmp_path, text.replace("type Own", "type Other"))
    answer = CliRunner().invoke(main, ["import", "cart.emx"])
    assert "no longer part of the model: cart/components/own.yaml" in answer.output
    assert "mine.yaml" not in answer.output
    assert Path("cart/components/own.yaml").exists() and Path("cart/components/other.yaml").exists()


def test_plotted_quantities_of_ports_keep_their_sign(tmp_path: Path) -> None:
    """A source pushes 3 into a resistance of 2: 1.5 flow out of the one and into the other."""
    parts = part("Source", "power out p", "equations\n p.e = 3;\n") + \
        part("Load", "power in p", "parameters\n real r = 2;\nequations\n p.e = r * p.f + 0 * time;")
    curves = "".join(f"<Curve><YCurveData><VarName>{name}</VarName></YCurveData></Curve>"
                     for name in ("Source\\p.f", "Load\\p.f", "Load\\p.e"))
    run = imported(tmp_path, parts, "Source\\p => Load\\p", 1.0, f"<PlotSpecs><Plots><Plot><Curves>{curves}</Curves></Plot>"
                   "</Plots></PlotSpecs>")
    assert [float(run.display[n][-1]) for n in ("Source_p_f", "Load_p_f", "Load_p_e")] == pytest.approx([1.5, 1.5, 3.0])


def test_a_digital_controller_that_limits_its_integral(tmp_path: Path) -> None:
    """`previous (uI)` is what uI was at the end of the last sample, though `code` assigns it twice; a step at a sample
    counts in that sample. The plant is y' = 2 (u - y), solved exactly between the samples."""
    control = """parameters
 real Kp = 3.0, Ti = 0.4 {s}, Td = 0.02 {s}, umax = 10;
variables
 real error, uI, uD, raw, hidden x;
code
 error = want - sample (is);
 uI = previous (uI) + Kp * sampletime / Ti * error;
 uD = Kp * Td * ddif (error);
 raw = Kp * error + uI + uD;
 if abs (raw) > umax then uI = previous (uI); end;
 u = limit (raw, -umax, umax);"""
    parts = (part("Control", "signal in want; signal in is; signal out u", control)
             + part("DA", "signal in u; signal out y", "equations\n y = hold (u);")
             + part("Want", "signal out y", "equations\n y = 2 * step (0.1);")
             + part("Plant", "signal in u; signal out y", "equations\n y = int (2 * (u - y));"))
    run = imported(tmp_path, parts, "Want\\y -> Control\\want; Plant\\y -> Control\\is; Control\\u -> DA\\u; "
                   "DA\\y -> Plant\\u", 0.6, "<D><DiscreteID>A\\y</DiscreteID><TimeInterval>0.02</TimeInterval></D>")
    y, sum_, last, samples = 0.0, 0.0, 0.0, []
    for k in range(31):
        error = (2 if k >= 5 else 0) - y
        raised = sum_ + 3 * 0.02 / 0.4 * error
        raw = 3 * error + raised + 3 * 0.02 * (error - last) / 0.02
        sum_, last, u = raised if abs(raw) <= 10 else sum_, error, min(max(raw, -10), 10)
        samples.append((y, u))
        y = u + (y - u) * np.exp(-0.04)
    k = np.minimum((run.time / 0.02 + 1e-9).astype(int), 30)
    began, u = np.array(samples)[k].T
    assert run["Plant.y"] == pytest.approx(u + (began - u) * np.exp(-2 * (run.time - 0.02 * k)), abs=1e-6)


def test_values_of_the_default_experiment_reach_elements_and_names_with_spaces(tmp_path: Path) -> None:
    def experiment(name: str, values: dict[str, str]) -> str:
        inner = "".join(f"<Variable><Name>{n}</Name><Value>{v}</Value></Variable>" for n, v in values.items())
        return (f"<Experiment><Name>{name}</Name><ExpData><Variables><Parameters>{inner}</Parameters></Variables><RunSpecs>"
                "<SimulatorSettings><FinishTime>1</FinishTime><UseOutputAfterEach>true</UseOutputAfterEach><OutputAfterEach>0.25"
                "</OutputAfterEach></SimulatorSettings></RunSpecs></ExpData></Experiment>")

    text = one_part("parameters\n real w[3] = [1; 1; 1], M[2,2] = [1, 1; 1, 1]; boolean on;\nequations\n"
                    " y = sum (w) + 100 * M[1,2] + (if on then 1000 else 0 end);", "y").replace("Part 0 0", "'the part' 0 0")
    head = text[:text.index("<Experiments>")]
    (tmp_path / "cart.emx").write_text(
        head + "<Experiments><DefaultExperiment>b</DefaultExperiment>" + experiment("a", {"the part\\w[1]": "50"})
        + experiment("b", {"the part\\w[2]": "3", "the part\\w[3,1]": "5", "the part\\M[1,2]": "7", "the part\\on": "true"})
        + "</Experiments></Document>")
    made = import_emx(tmp_path / "cart.emx", frozenset(library().names()))
    made.write(tmp_path / "out")
    run = hb.simulate(hb.load(str(tmp_path / "out" / "cart.yaml")))
    assert run["the_part.y"][-1] == 9 + 700 + 1000 and len(run.time) == 5


def test_the_text_is_that_of_a_person(tmp_path: Path) -> None:
    """Comments stand where they stood, in `code` too; parts of one law share a file; a 1-junction is that of the library;
    what only declares global quantities, and parameters that are initial values, leave nothing but value and comment."""
    lag = part("Lag", "signal in u; signal out y", """// how fast it is
parameters
 real tau = 0.3;	// time constant
 real y0 = 0.5;	// start
equations
 // first order
 y = int (u - y * tau, y0);	// lag""")
    code = """variables
 real x;
code
 // the square
 x = u * u;	// of the input
 y = x + (if x > 2 then sin (x) * cos (x) + tanh (x) else 0 end);
 z = x - (if x > 2 then sin (x) * cos (x) + tanh (x) else 0 end);"""
    parts = (part("Globals", "", "parameters\n real global mass = 3 {kg};	// of the cart")
             + part("In", "signal out y", "equations\n y = time;") + lag
             + lag.replace("Lag", "Lag2").replace("0.3", "0.7")
             + part("Code", "signal in u; signal out y; signal out z", code)
             + part("Force", "power out p", "parameters\n real effort = 2;\nequations\n p.e = effort;") + one("Ring")
             + part("M", "power in p", "parameters\n real global mass;\nequations\n p.f = int (p.e) / mass;")
             + part("D", "power in p", "parameters\n real r = 1;\nequations\n p.e = r * p.f;"))
    run = imported(tmp_path, parts, "In\\y -> Lag\\u; In\\y -> Lag2\\u; Lag\\y -> Code\\u; Force\\p => Ring\\p; "
                   "Ring\\p => M\\p; Ring\\p => D\\p", 3.0)
    assert run["M.p.f"] == pytest.approx(2 * (1 - np.exp(-run.time / 3)), rel=1e-6)
    diagram, lags, codes = (re.sub(" +", " ", (tmp_path / "out" / name).read_text())
                            for name in ("m.yaml", "components/lag.yaml", "components/code.yaml"))
    assert "mass: 3 kg # of the cart" in diagram and "Lag2: {is: Lag, tau: 0.7," in diagram and "Globals" not in diagram
    assert "Ring: {is: Junction1, at:" in diagram and '"Ring.a[1]"' in diagram and "Lag.y: 0.5" in diagram
    assert "parameters:\n # how fast it is\n tau: {unit: 1, default: 0.3, doc: time constant}\n" in lags and "y0" not in lags
    assert " # first order\n der(y) = u - y*tau # lag\n" in lags
    assert " # the square\n x = u*u # of the input\n y_part = if_else(x > 2, " in codes
    assert " y = x + y_part\n z = x - y_part\n" in codes


def test_computed_global_quantities_with_units(tmp_path: Path) -> None:
    """The area follows from a global diameter; a submodel within a submodel uses it with a global stiffness in bar."""
    relations = ("description '<A><GlobalRelations>parameters\n real global bulk {bar} = 14000;\n real global d = 40 {mm};\n"
                 "variables\n real global area {m2};\nequations\n area = pi / 4 * d ^ 2;</GlobalRelations></A>';\n")
    leaf = part("Leaf", "signal out y", "parameters\n real global bulk;\nvariables\n real global area;\nequations\n"
                " y = int (bulk * area);")
    parts = block("Outer", "signal out y", leaf, "Leaf\\y -> y").replace(" type Submodel", f" {relations} type Submodel", 1)
    run = imported(tmp_path, parts, "", 1.0)
    assert run["Outer.Leaf.y"][-1] == pytest.approx(14000e5 * np.pi / 4 * 0.04**2)


def test_discrete_signals_keep_their_values_between_samples(tmp_path: Path) -> None:
    """A controller without `hold`, whose output passes a gain into the plant y' = u - y; a counter in `code` behind it that
    counts samples and reads what it will assign; plotted variables are those of the last sample."""
    parts = (part("Control", "signal in want; signal in is; signal out u; signal out before", "variables\n real s, i;\n"
                  "equations\n s = want - sample (is);\n i = dint (s);\n u = 2 * s + i;\n before = previous (s);")
             + part("Half", "signal in u; signal out y", "equations\n y = 0.5 * u;")
             + part("Count", "signal in u; signal out n; signal out late", "variables\n real on;\ninitialequations\n"
                    " n = 10;\ncode\n late = on;\n if u > 0.9 then on = 1; end;\n if u < 0.85 then on = 0; end;\n"
                    " n = n + on;")
             + part("Step", "signal out y", "equations\n y = step (0.2);")
             + part("Plant", "signal in u; signal out y", "equations\n y = int (u - y);"))
    plotted = ("Control\\s", "Control\\before", "Count\\n", "Count\\late")
    curves = "".join(f"<Curve><YCurveData><VarName>{name}</VarName></YCurveData></Curve>" for name in plotted)
    run = imported(tmp_path, parts, "Step\\y -> Control\\want; Plant\\y -> Control\\is; Control\\u -> Half\\u; "
                   "Half\\y -> Plant\\u; Half\\y -> Count\\u", 2.0,
                   f"<D><DiscreteID>A\\y</DiscreteID><TimeInterval>0.1</TimeInterval></D>"
                   f"{curves}")
    y, i, s, n, on, rows = 0.0, 0.0, 0.0, 10, 0, []
    for k in range(21):
        before, late, s = s, on, (k >= 2) - y
        u = 0.5 * (2 * s + i)
        i += 0.1 * s
        on = 1 if u > 0.9 else 0 if u < 0.85 else on
        n += on
        rows.append((y, u, s, before, n, late))
        y = u + (y - u) * np.exp(-0.1)
    k = np.minimum((run.time / 0.1 + 1e-9).astype(int), 20)
    began, u, *kept = np.array(rows).T[:, k]
    assert run["Plant.y"] == pytest.approx(u + (began - u) * np.exp(-(run.time - 0.1 * k)), abs=1e-6)
    for name, values in zip(plotted, kept, strict=True):
        assert run.display[name.replace("\\", "_")] == pytest.approx(values, abs=1e-6), name
    assert n == 15


def test_a_model_of_equations_alone_is_a_part(tmp_path: Path) -> None:
    """Without submodels, and without anything; the experiment names its quantities without a path."""
    text = ("<Document><Model><Sidops>model 0 0 type Mainmodel end; implementation eq\nparameters\n real k = 3;\nvariables\n"
            " real y;\nequations\n y = int (-k * y, 1);\nimplementation_end;</Sidops></Model><Experiment><Parameters>"
            "<Variable><Name>k</Name><Value>2</Value></Variable></Parameters><YCurveData><VarName>y</VarName></YCurveData>"
            "<FinishTime>2</FinishTime></Experiment></Document>")
    run = run_part(tmp_path, text)
    assert run.display["cart_y"] == pytest.approx(np.exp(-2 * run.time), rel=1e-6)
    (tmp_path / "cart.emx").write_text(text[:text.index("implementation eq")] + "</Sidops></Model></Document>")
    with pytest.raises(ModelError, match="no submodels and no equations"):
        import_emx(tmp_path / "cart.emx")


def test_collected_signals_are_a_vector(tmp_path: Path) -> None:
    parts = part("A", "signal out y", "equations\n y = time;") + part("B", "signal out y", "equations\n y = 2 - time;") + \
        part("Mux", "signal knot duplicatable in input [1]; signal out output [2]; signal out most", "equations\n"
             " output = collect (input);\n most = max (collect (input));", knot=True)
    run = imported(tmp_path, parts, "A\\y -> Mux\\input; B\\y -> Mux\\input", 2.0)
    assert run["Mux.output_2"] == pytest.approx(2 - run.time) and run["Mux.most"] == pytest.approx(1 + abs(run.time - 1))


def test_what_branches_compute_for_themselves_takes_no_events(tmp_path: Path) -> None:
    """A value that is used in its own branch alone is an equation; one that is read when its branch has ended is kept."""
    text = one_part("""parameters
 real a = 2;
variables
 real r, root, last, early;
code
 if sin (time) > 0 then
  r = sin (time) / a;
  root = sqrt (sin (time));
  early = 3 * time;
  y = r^2 + root;
 else
  y = 0;
  w = early;
 end;
 if sin (time) > 0.5 then
  last = time;
  z = last;
 end;""", "y w z", finish=5)
    (component,) = (t for name, t in written(tmp_path, text).items() if name.startswith("components/"))
    equations = re.sub(" +=", " =", component)
    assert "  r = sin(time)/a\n" in equations
    assert "  root = if_else(sin(time) > 0, sqrt(sin(time)), 0)   # 0 where no branch assigns it\n" in equations
    assert "r**2 + root" in equations and "r_kept" not in component and "root_kept" not in component
    run = run_part(tmp_path, text)
    assert at(run, "y", 1, 4) == pytest.approx([np.sin(1)**2 / 4 + np.sqrt(np.sin(1)), 0])
    assert at(run, "w", 4) == pytest.approx([3 * np.pi], abs=1e-5)  # kept at the end of the branch
    assert at(run, "z", 1, 4) == pytest.approx([1, 5 * np.pi / 6], abs=1e-5)


def test_equality_of_whole_numbers_and_of_what_changes_continuously(tmp_path: Path) -> None:
    """A mode is compared within a half; a pressure of 0.4 is not 0, but a valve that has reached its end is there."""
    run = run_part(tmp_path, one_part("""variables
 real p, valve, mode;
code
 p = 0.4 * exp (-time);
 valve = limit (time, 0, 1);
 if time > 0.5 then mode = 2; else mode = 1; end;
 if p == 0 then y = 5; end;
 if valve == 1 then z = 7; end;
 if mode == 2 then w = 9; end;""", "y z w"))
    assert at(run, "y", 2) == [0]
    assert at(run, "z", 0.9, 1.1) == [0, 7]
    assert at(run, "w", 0.4, 0.6) == [0, 9]


@pytest.mark.parametrize("section", ["equations", "code"])
def test_a_count_of_integration_steps_is_not_translated(tmp_path: Path, section: str) -> None:
    """`i = i + 1` at every step; in a branch that an event takes, and at samples, it counts these."""
    text = one_part(f"variables\n integer i;\ninitialequations\n i = 0;\n{section}\n i = i + 1;\n y = i;", "y")
    (tmp_path / "cart.emx").write_text(text)
    (problem,) = import_emx(tmp_path / "cart.emx").untranslated
    assert problem.reason == "'i' depends on its value at the integration step before, and so on the integration method"
    counted = one_part("variables\n integer i;\ncode\n if frequencyevent (0.5, 0.5) then i = i + 1; end;\n y = i;", "y")
    assert at(run_part(tmp_path, counted), "y", 0.4, 1.2) == [0, 2]


def test_a_state_machine_of_a_switch(tmp_path: Path) -> None:
    """A vessel that fills with 2, empties with 1/2 from 1 to 0.4 and fills again: one event for each way out of a state."""
    text = one_part("""parameters
 real fast = 2, slow = 0.5;
variables
 integer state;
 real rate;
initialequations
 state = 1;
code
 switch state
  case 1 do
   rate = fast;
   if y > 1 then state = 2; end;
  case 2 do
   rate = -slow;
   if y < 0.4 then state = 3; end;
  default do
   rate = 2 * slow;
 end;
 mode = state;
equations
 y = int (rate, 0);""", "y mode", finish=3)
    (component,) = (t for name, t in written(tmp_path, text).items() if name.startswith("components/"))
    assert 'condition: "state == 2 and y < 0.4"' in component and "_kept" not in component
    run = run_part(tmp_path, text)
    assert at(run, "y", 0.3, 0.9, 2.4) == pytest.approx([0.6, 0.8, 1.1], abs=1e-6)
    assert at(run, "mode", 0.3, 0.9, 2.4) == [1, 2, 3]


def test_a_placeholder_gives_what_its_equations_gave(tmp_path: Path) -> None:
    """A store with a law in a DLL behind a source of flow: its effort is a parameter, and the rest of the model runs."""
    parts = (part("Source", "power out p", "equations\n p.f = 1;") + part("Store", "power in p; signal out m", "variables\n"
             " real inner;\nequations\n m = int (p.f);\n inner = dll ('gas.dll', 'pressure', m);\n p.e = inner;"))
    run = imported(tmp_path, parts, "Source\\p => Store\\p", 1.0, untranslated=1)
    assert "  p.e = p_effort   # not translated\n" in (tmp_path / "out" / "components" / "store.yaml").read_text()
    assert run["Store.p.e"][-1] == 0


TABLE = """parameters
 real M[3,2] = [0, 1; 2, 5; 3, 4];
variables
 integer k, n;
 real share;
code
 n = rows (M);
 k = 1;
 while k < n - 1 and u > M[k + 1,1] do k = k + 1; end;
 share = limit ((u - M[k,1]) / (M[k + 1,1] - M[k,1]), 0, 1);
 y = M[k,2] + share * (M[k + 1,2] - M[k,2]);"""


@pytest.mark.parametrize(("ports", "body", "kind"), [
    ("signal in u; signal out y", TABLE, "Lookup, x: [0, 2, 3], v: [1, 5, 4]"),
    ("signal out y", re.sub(r"\bu\b", "time", TABLE), "TableSource, t: "),
    ("signal in u; signal out y", TABLE.replace("share * (M", "0 * share * (M"), "Map"),  # constant between the points
])
def test_a_matrix_of_points_is_the_table_of_the_library(tmp_path: Path, ports: str, body: str, kind: str) -> None:
    """By whatever loop it is searched; what is not linear between its points, or not constant outside, is another law."""
    clock = part("Clock", "signal out y", "equations\n y = 4 * time - 1;")
    run = imported(tmp_path, clock + part("Map", ports, body), "Clock\\y -> Map\\u" if "in u" in ports else "", 1.25)
    assert f"{{is: {kind}" in (tmp_path / "out" / "m.yaml").read_text()
    if kind != "Map":
        u = 4 * run.time - 1 if "in u" in ports else run.time
        assert run["Map.y"] == pytest.approx(np.interp(u, [0, 2, 3], [1, 5, 4]), abs=1e-9)


def test_a_branch_that_ends_itself_is_an_event(tmp_path: Path) -> None:
    """A flag that the branch itself clears holds at an instant only; what the branch sets is taken from before it."""
    parts = part("Clock", "signal out y; signal out n", """variables
 real t_hit, count, next;
 boolean hit;
initialequations
 t_hit = 0.25; count = 0; next = 5;
code
 hit = major and (time >= t_hit);
 if hit then
  t_hit = time + 0.5;
  y = next;
  next = y + 3;
  count = count + 1;
 end;
 n = count;""")
    run = imported(tmp_path, parts, "", 2.0)
    assert list(run["Clock.n"][np.searchsorted(run.time, [0.2, 0.3, 0.8, 1.3, 1.9])]) == [0, 1, 2, 3, 4]
    assert list(run["Clock.y"][np.searchsorted(run.time, [0.2, 0.3, 0.8, 1.9])]) == [0, 5, 8, 14]


def test_a_branch_for_the_start_avoids_a_division_by_zero(tmp_path: Path) -> None:
    """A mean over the time would be 0/0 at the start, which a branch of its own avoids."""
    run = run_part(tmp_path, one_part("""variables
 real total, first, n;
initialequations
 n = 2;
equations
 total = int (3 + 0 * time);
 mean = if time == 0 or total < 0 then 7 else total / time end;
code
 if time == starttime then n = n + 1; end;
 y = n;""", "mean y", 2))
    assert at(run, "mean", 0.5, 2) == pytest.approx([3, 3]) and at(run, "y", 0, 1) == [3, 3]


@pytest.mark.parametrize("section", ["equations", "code"])
def test_a_global_event_is_listed_and_does_not_stop_the_import(tmp_path: Path, section: str) -> None:
    text = one_part(f"variables\n boolean global landed ('event');\n{section}\n y = time;\n landed = eventup (y - 1);", "y")
    (tmp_path / "cart.emx").write_text(text)
    made = import_emx(tmp_path / "cart.emx", frozenset(library().names()))
    assert [u.reason for u in made.untranslated] == ["the global event 'landed' is true at instants only; it is 0 elsewhere "
                                                     "in the model"]
    assert "landed = 0   # true at its events only" in made.files["components/own.yaml"]


def test_numbers_with_a_prefix(tmp_path: Path) -> None:
    files = written(tmp_path, one_part("parameters\n real La = 0.161m {H}, R = 2k {ohm}, C = .5u {F}, T = 5 {ms};\n"
                                       "equations\n y = La / R + R * C + T + 3M;", "y"))
    own = files["components/own.yaml"]
    assert "La: {unit: H, default: 0.000161 H}" in own and "R: {unit: ohm, default: 2000 ohm}" in own
    assert "C: {unit: F, default: 5e-07 F}" in own and "T: {unit: s, default: 0.005 s}" in own and "+ 3000000" in own


def test_what_an_encoder_samples_is_held(tmp_path: Path) -> None:
    """A submodel with a bond, an integral and a sample: its count changes at the samples only, its angle does not."""
    parts = (part("Turn", "power out p", "equations\n p.f = 10;")
             + part("Follow", "signal in u; signal in w; signal out y", "equations\n y = int (u - w);")
             + part("Encoder", "power in p; signal out count; signal out angle", """variables
 real s, q;
equations
 p.e = 0;
 angle = int (p.f);
 s = sample (angle);
 if s < 0 then q = s - 0.5; else q = s + 0.5; end;
 count = q - (q mod 1);"""))
    experiment = ("<DiscreteSystem><DiscreteID>Encoder\\s</DiscreteID><TimeInterval>0.5</TimeInterval></DiscreteSystem>"
                  "<Curve><YCurveData><VarName>Encoder\\count</VarName></YCurveData></Curve>")
    run = imported(tmp_path, parts, "Turn\\p => Encoder\\p; Encoder\\count -> Follow\\u; Encoder\\angle -> Follow\\w", 2.0,
                   experiment)
    held = 10 * np.floor(run.time / 0.5 + 1e-9) * 0.5
    inside = np.abs(run.time / 0.5 - np.round(run.time / 0.5)) > 0.01
    assert run["Encoder_count_sampled"][inside] == pytest.approx(held[inside])
    # the integral of what is held less that of the angle: 5 * 0.5 * k - 5 t**2 over whole samples
    assert run["Follow.y"][-1] == pytest.approx(0.5 * (0 + 5 + 10 + 15) - 5 * 2**2, abs=1e-6)


@pytest.mark.parametrize("section", ["", "code\n"])
def test_what_a_submodel_samples_is_held_in_its_bond_equation(tmp_path: Path, section: str) -> None:
    """A brake whose torque follows from the sampled angle, beside friction that acts continuously."""
    parts = (part("Turn", "power out p", "equations\n p.f = 10;")
             + part("Brake", "power in p; signal out angle", f"""variables
 real s, torque;
equations
 angle = int (p.f);
{section} s = sample (angle);
 torque = 2 * s;
 p.e = torque + p.f;"""))
    experiment = "<DiscreteSystem><DiscreteID>Brake\\s</DiscreteID><TimeInterval>0.5</TimeInterval></DiscreteSystem>"
    run = imported(tmp_path, parts, "Turn\\p => Brake\\p", 2.0, experiment)
    inside = np.abs(run.time / 0.5 - np.round(run.time / 0.5)) > 0.01
    torque = 2 * 10 * np.floor(run.time / 0.5) * 0.5
    assert run["Brake.p.e"][inside] == pytest.approx(torque[inside] + 10)
    assert run["Brake.angle"] == pytest.approx(10 * run.time, abs=1e-9)


def test_constants_of_the_experiment_replace_those_of_the_text(tmp_path: Path) -> None:
    own = "".join(f"<Variable><Name>Part\\{name}</Name><Value>{value}</Value></Variable>"
                  for name, value in (("a", 5), ("b[2]", 7)))
    text = one_part("constants\n real a = 2.0, c = 3.0;\n real b[2] = [1.0; 2.0];\nequations\n"
                    " y = a * int (1) + b[2] + 10 * b[1] + 100 * c;", "y",
                    more=f"<Variables><Constants>{own}</Constants></Variables>")
    assert at(run_part(tmp_path, text), "y", 0, 2) == pytest.approx([317, 327])


def test_a_run_that_does_not_start_at_zero(tmp_path: Path) -> None:
    """A run from 1 s to 3 s: instants come at their time, and functions of the time have its values."""
    body = ("parameters\n real T = 2.5;\nequations\n y = int (if time >= starttime + 0.5 then 1 else 0 end);\n a = time^2;\n"
            " b = step (2) + 10 * ramp (T);\n c = if time == 1 then 0 else 1 / (time - 1) end;\n"
            " n = resint (0, n + 1, timeevent (1.5) or timeevent (0.5), 0);")
    text = one_part(body, "y a b c n", 3)
    run = run_part(tmp_path, text.replace("<FinishTime>", "<StartTime>1</StartTime><FinishTime>"))
    assert run.time[-1] == pytest.approx(2) and at(run, "y", 2) == pytest.approx([1.5])
    assert at(run, "a", 0, 1) == pytest.approx([1, 4])
    assert at(run, "b", 0.9, 1.1, 2) == pytest.approx([0, 1, 6])
    assert at(run, "c", 0.5, 1) == pytest.approx([2, 1])
    assert at(run, "n", 0.3, 0.8) == pytest.approx([0, 1])


def test_held_inputs_are_written_in_the_order_of_the_ports(tmp_path: Path) -> None:
    """Two imports of a file are the same text, whatever order a set of names has in a process."""
    names = ["left", "right", "arm", "drive", "brake"]
    control = "equations\n" + "".join(f" {n} = {k + 1} * sample (time);\n" for k, n in enumerate(names))
    plant = "equations\n y = int (" + " + ".join(names) + ");"
    parts = (part("Control", "; ".join(f"signal out {n}" for n in names), control)
             + part("Plant", "; ".join(f"signal in {n}" for n in names) + "; signal out y", plant))
    wires = "; ".join(f"Control\\{n} -> Plant\\{n}" for n in names)
    run = imported(tmp_path, parts, wires, 1.0,
                   "<D><DiscreteID>A\\y</DiscreteID><TimeInterval>0.1</TimeInterval></D>")
    (text,) = (p.read_text() for p in tmp_path.rglob("plant.yaml"))
    assert re.findall(r"^  (\w+)_sampled: ", text, re.MULTILINE) == names
    assert run["Plant.y"][-1] == pytest.approx(15 * 0.1 * sum(0.1 * k for k in range(10)), abs=1e-6)


GAS = """\
static int ready;
int Initialize(void) { ready = 1; return 0; }
int pressure(double *inarr, int inputs, double *outarr, int outputs, int major)
{ outarr[0] = ready*3*inarr[0]*inarr[1]; return inputs != 2 || outputs != 1; }
int both(double *inarr, int inputs, double *outarr, int outputs, int major)
{ outarr[0] = inarr[0] + 1; outarr[1] = 2*inarr[0]; return 0; }
"""


def emx(path: Path, parts: str, connections: str) -> Path:
    """A model in a file."""
    path.write_text(f"""<?xml version="1.0"?><Document><Model version="4.6"><Sidops><![CDATA[model 0 0
 type Mainmodel
 end;
 implementation bg
 submodels
{parts} end;
 connections
{connections} end;
 implementation_end;
]]></Sidops></Model></Document>""")
    return path


def test_a_function_of_a_library_is_replaced_by_its_source(tmp_path: Path) -> None:
    """Scalar and vector arguments and results, and a global parameter of another file."""
    (tmp_path / "gas.c").write_text(GAS)
    file = emx(tmp_path / "m.emx", part("Source", "signal out m", "equations\n m = time;") + part(
        "Gas", "signal in m; signal out p; signal out q [2]", "parameters\n real global T;\nequations\n"
        " p = dll ('gas.dll', 'pressure', [m; T]);\n q = dll ('gas.dll', 'both', m);")
        + part("Use", "signal in p; signal in q [2]; signal out y; signal out w", "equations\n y = p; w = q[2] + 10*q[1];"),
        "Source\\m -> Gas\\m; Gas\\p -> Use\\p; Gas\\q -> Use\\q;")
    other = emx(tmp_path / "Parameters.emx", part("Values", "signal out y", "parameters\n real global T = 5.0;\nequations\n"
                                                  " y = T;"), "")
    with pytest.raises(ModelError, match="--function pressure=source"):
        hb.import_model(file, tmp_path / "out", strict=True, global_files=[other])
    assert not (tmp_path / "out").exists()
    with pytest.raises(hb.UsageError, match="It calls pressure, both"):
        hb.import_model(file, tmp_path / "out", functions={"presure": tmp_path / "gas.c"})
    made = hb.import_model(file, tmp_path / "out", global_files=[other], strict=True,
                           functions={"pressure": tmp_path / "gas.c", "both": tmp_path / "gas.c"})
    run = hb.simulate(hb.load(made.path, allow_native=True), "1 s", every="0.1 s")
    np.testing.assert_allclose(run["Use.y"], 15*run.time, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(run["Use.w"], 2*run.time + 10*(run.time + 1), rtol=1e-12)


def test_placeholders_have_an_exit_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    emx(tmp_path / "m.emx", part("Gas", "signal out p", "equations\n p = dll ('gas.dll', 'pressure', time);")
        + part("Use", "signal in p; signal out y", "equations\n y = 2*p;"), "Gas\\p -> Use\\p;")
    for words in (["import", "m.emx"], ["check", "m/m.yaml"], ["run", "m/m.yaml"]):
        assert CliRunner().invoke(main, words).exit_code == 3


def test_submodels_of_other_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A submodel without an implementation has that of its type in a library, with its comments; a construct without a
    translation is at the line of the submodel and names the line of the library."""
    monkeypatch.chdir(tmp_path)
    lag = part("Lag", "signal in u; signal out y", "parameters\n real T = 0.2 {s};\nequations\n y = int ((u - y)/T, 0.5);")
    empty = re.sub(r"implementation eq.*?implementation_end;", "", lag.replace("Lag 0 0", "First 0 0"), flags=re.DOTALL)
    source = part("Source", "signal out y", "equations\n y = 2 + 0*time;")
    emx(tmp_path / "m.emx", source + empty, "Source\\y -> First\\u;")
    Path("shared").mkdir()
    emx(tmp_path / "shared" / "blocks.emx", part("Other", "signal out y", "equations\n y = 3;") + lag.replace(
        "0.5);", "0.5);\t// the lag"), "")
    assert CliRunner().invoke(main, ["import", "m.emx"]).exit_code == 3
    strict = CliRunner().invoke(main, ["import", "m.emx", "-o", "strict", "--strict"])
    assert (strict.exit_code, Path("strict").exists()) == (1, False) and "First: it has no implementation" in strict.stderr
    assert CliRunner().invoke(main, ["import", "m.emx", "--library", "shared", "--strict"]).exit_code == 0
    run = hb.simulate(hb.load("m/m.yaml"), until=1)
    assert run["First.y"] == pytest.approx(2 - 1.5*np.exp(-run.time/0.2), abs=1e-6)
    path = tmp_path / "shared" / "blocks.emx"
    path.write_text(path.read_text().replace("y = int ((u - y)/T, 0.5)", "y = dll ('gas.dll', 'f', u)"))
    answer = CliRunner().invoke(main, ["import", "m.emx", "--library", str(path)])
    assert answer.exit_code == 3 and re.search(r"m\.emx:\d+: First: .*\(blocks\.emx:\d+\)", answer.stdout)
    assert re.search(r'placeholder: "blocks\.emx line \d\d: ', Path("m/components/lag.yaml").read_text())
    missing = CliRunner().invoke(main, ["import", "m.emx", "--library", "nowhere"])
    assert missing.exit_code == 2 and "cannot find 20-sim models at 'nowhere'" in missing.stderr


def test_names_and_samplers_stay_those_of_the_model(tmp_path: Path) -> None:
    """`Sample` is no Gain of 1, an effect of the library is no part, and a name that the library has is marked."""
    parts = part("Source", "signal out y", "equations\n y = sin (time);") + \
        part("Sample", "signal in input; signal out output", "equations\n output = sample (input);") + \
        part("Twice", "signal in u; signal out y", "code\n y = 2*u;") + \
        part("Hold", "signal in input; signal out output", "equations\n output = hold (input);") + \
        part("Tank", "signal in u; signal out y", "equations\n y = u^2 + time;")
    emx(tmp_path / "m.emx", parts, "Source\\y -> Sample\\input; Sample\\output -> Twice\\u; Twice\\y -> Hold\\input; "
        "Hold\\output -> Tank\\u;")
    files = import_emx(tmp_path / "m.emx", frozenset(library().names())).files
    assert re.findall(r"^  (\w+): +\{is: (\w+)", files["m.yaml"], re.MULTILINE) == [
        ("Source", "Source"), ("Sample", "Sample"), ("Twice", "Twice"), ("Hold", "Hold"), ("Tank", "Tank20sim")]
