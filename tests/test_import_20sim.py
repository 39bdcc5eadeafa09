"""Import of 20-sim models: a model of our own, hostile and mutated files, and public models where they are at hand."""

from __future__ import annotations

import math
import random
from pathlib import Path

import pytest
from click.testing import CliRunner

import heavebond as hb
from heavebond.cli import main
from heavebond.core.errors import HeavebondError, ModelError
from heavebond.import_20sim.importer import import_emx
from heavebond.language.library import library

MODELS = Path(__file__).parents[2] / "shared" / "data" / "emx"
OWN = """<?xml version="1.0" encoding="UTF-8"?>
<Document>
 <Model version="4.5" build="1">
  <Sidops><![CDATA[model 0 0
 type Mainmodel
 end;
 implementation bg
  submodels
   Source 0 0
    type Pull
     ports
      power out p;
    end;
    implementation eq
parameters
	real F = 2.0 {N};	// force
equations
	p.e = if time < 1 then F else 0 end;
implementation_end;
   OneJunction 40 0
    knot OneJunction
     ports
      power knot duplicatable none p [1];
      signal knot out flow [1];
    end;
    implementation eq
equations
	sum (direct (p.e)) = 0;
	equal (collect (p.f));
	flow = first (p.f);
implementation_end;
   Mass 80 0
    type I
     ports
      power in p;
      signal out state;
    end;
    implementation eq
parameters
	real m = 500 {g};	// mass
equations
	state = int (p.e);
	p.f = state / m;	// speed
implementation_end;
   Brake 40 40
    type R
     ports
      power in p;
    end;
    implementation eq
parameters
	real r = 0.5 {N.s/m};
equations
	p.e = r * p.f;
implementation_end;
   Position 120 0
    type Place
     ports
      signal in v;
      signal out x [2];
    end;
    implementation eq
variables
	real inner;
equations
	inner = int (v, 0.25);
	x = [inner; 2 * inner];
implementation_end;
  end;
  connections
   Source\\p => OneJunction\\p;
   OneJunction\\p => Mass\\p;
   OneJunction\\p => Brake\\p;
   OneJunction\\flow -> Position\\v;
  end;
 implementation_end;
]]></Sidops>
 </Model>
 <Experiments><Experiment><Name>1</Name><ExpData>
  <Variables><Parameters/><Initials/></Variables>
  <PlotSpecs><Plots><Plot><Curves><Curve><YCurveData><VarName>Position\\inner</VarName></YCurveData></Curve></Curves></Plot></Plots></PlotSpecs>
  <RunSpecs><SimulatorSettings><FinishTime>2</FinishTime></SimulatorSettings></RunSpecs>
 </ExpData></Experiment></Experiments>
</Document>
"""


def _file(folder: Path, text: str) -> Path:
    path = folder / "cart.emx"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_bond_graph_gives_the_solution_of_its_equations(tmp_path: Path) -> None:
    """m v' = F - r v to 1 s, then free decay: v(1) = F/r (1 - exp(-r/m)), with m = 0.5 kg."""
    made = import_emx(_file(tmp_path, OWN), frozenset(library().names()))
    assert not made.untranslated
    made.write(tmp_path / "cart")
    run = hb.simulate(hb.load(str(tmp_path / "cart" / "cart.yaml")))
    speed = run["Mass.a.f"]  # the mass and the brake are components of the library
    at_one = abs(run.time - 1).argmin()
    assert speed[at_one] == pytest.approx(4 * (1 - 2.718281828**-1), rel=1e-5)
    assert run["Position.x_2"][-1] == pytest.approx(2 * run["Position.inner"][-1])
    assert run["Position.inner"][0] == 0.25
    assert "Position_inner" in run.display


def test_what_is_not_translated_is_a_part_that_check_names(tmp_path: Path) -> None:
    made = import_emx(_file(tmp_path, OWN.replace("p.e = r * p.f", "p.e = dll ('a.dll', 'f', p.f)")))
    found = made.untranslated[0]
    assert (found.submodel, "dll" in found.reason) == ("Brake", True)
    assert OWN.splitlines()[found.line - 1].strip() == "p.e = r * p.f;"
    assert any("placeholder:" in text for text in made.files.values())
    made.write(tmp_path / "cart")
    with pytest.warns(hb.RunWarning, match="Brake has no law"):
        run = hb.simulate(hb.load(str(tmp_path / "cart" / "cart.yaml")))
    assert run.time[-1] == 2 and [f.kind for f in run.verdict.findings] == ["placeholder"]


def one_part(body: str, outputs: str, finish: float = 2.0, more: str = "") -> str:
    """A model with one submodel of equations."""
    ports = "\n".join(f"      signal out {name};" for name in outputs.split())
    return f"""<?xml version="1.0"?><Document><Model version="4.5"><Sidops><![CDATA[model 0 0
 type Mainmodel
 end;
 implementation bg
  submodels
   Part 0 0
    type Own
     ports
{ports}
    end;
    implementation eq
{body}
implementation_end;
  end;
 implementation_end;
]]></Sidops></Model><Experiments><Experiment><ExpData><RunSpecs><SimulatorSettings><FinishTime>{finish}</FinishTime>
</SimulatorSettings>{more}</RunSpecs></ExpData></Experiment></Experiments></Document>"""


def run_part(folder: Path, text: str, untranslated: int = 0) -> hb.Result:
    made = import_emx(_file(folder, text), frozenset(library().names()))
    assert len(made.untranslated) == untranslated, made.untranslated
    made.write(folder / "out")
    return hb.simulate(hb.load(str(folder / "out" / "cart.yaml")))


def at(run: hb.Result, name: str, *times: float) -> list[float]:
    return [float(run[f"Part.{name}"][abs(run.time - t).argmin()]) for t in times]


def test_integrals_that_are_reset_and_limited(tmp_path: Path) -> None:
    """resint of 1, set to -1 while 0.5 < t < 0.75; limint of cos(pi t) between 0 and 0.2, which leaves it at t = 1/2."""
    run = run_part(tmp_path, one_part("""equations
  saw = resint (1, 0, eventup (sin (4 * pi * time - 1)), 0);
  y = resint (1, -1, time > 0.5 and time < 0.75, 0.25);
  w = limint (cos (pi * time), 0, 0.2, 0.1);""", "y w saw"))
    resets = [(1 / (4 * math.pi)) + k / 2 for k in range(4)]
    assert at(run, "saw", 0.05, 0.3, 0.9) == pytest.approx([0.05, 0.3 - resets[0], 0.9 - resets[1]], abs=1e-6)
    assert at(run, "y", 0.4, 0.6, 1.75) == pytest.approx([0.65, -1, 0], abs=1e-6)
    # 0.1 + sin(pi t)/pi reaches 0.2 at t = 0.1017; from 0.5 on it falls, 0.2 + (sin(pi t) - 1)/pi, to 0 at t = 0.8784
    assert at(run, "w", 0.05, 0.3, 0.7, 1.2) == pytest.approx(
        [0.1 + math.sin(0.05 * math.pi) / math.pi, 0.2, 0.2 + (math.sin(0.7 * math.pi) - 1) / math.pi, 0], abs=1e-6)


def test_discrete_functions_act_every_sample_time(tmp_path: Path) -> None:
    """x = 3 t sampled every 0.1 s: hold, the sample before, the sum of the samples before, and the difference quotient."""
    run = run_part(tmp_path, one_part("""variables
  real x, s;
equations
  x = 3 * time;
  s = sample (x);
  held = hold (s, 0);
  before = hold (previous (s, -1), 0);
  total = hold (dint (s, 5), 0);
  slope = hold (ddif (s, 0), 0);""", "held before total slope", more="<D><DiscreteID>A\\y</DiscreteID><TimeInterval>0.1"
                                     "</TimeInterval></D>"))
    assert at(run, "held", 0.05, 0.55, 1.05) == pytest.approx([0, 1.5, 3.0])
    assert at(run, "before", 0.05, 0.15, 0.55) == pytest.approx([-1, 0, 1.2])
    assert at(run, "total", 0.05, 0.55) == pytest.approx([5, 5 + 0.1 * 3 * (0 + 0.1 + 0.2 + 0.3 + 0.4)])
    assert at(run, "slope", 0.55, 1.55) == pytest.approx([3, 3])


def test_a_sample_time_that_is_not_stated_is_listed(tmp_path: Path) -> None:
    made = import_emx(_file(tmp_path, one_part("equations\n  y = hold (time, 0);", "y")))
    assert [u.reason[:33] for u in made.untranslated] == ["the file states no sample time; 0"]
    assert "sampletime: 0.1 s" in made.files["cart.yaml"]


@pytest.mark.filterwarnings("ignore:.*is true at the start.*:heavebond.RunWarning")
def test_events_set_what_their_branches_assign(tmp_path: Path) -> None:
    """sin(2 pi t) passes zero at every half second: both ways, upwards, and every 0.4 s from 0.1 s on."""
    run = run_part(tmp_path, one_part("""variables
  boolean crossing;
  real wave, n, up, ticks;
initialequations
  n = 0; up = 0; ticks = 10;
equations
  wave = sin (2 * pi * time + 0.3);
  crossing = event (wave);
code
  if crossing then n = n + 1; end;
  if eventup (wave) then up = time; end;
  if frequencyevent (0.4, 0.1) then ticks = ticks + 2; end;
  count = n;
  last = up;
  beats = ticks;""", "count last beats"))
    passed = [(k * math.pi - 0.3) / (2 * math.pi) for k in range(1, 5)]
    assert at(run, "count", passed[0] - 0.01, passed[0] + 0.01, 2) == [0, 1, 4]
    assert at(run, "last", passed[1] - 0.01, passed[1] + 0.01, 2) == pytest.approx([0, passed[1], passed[3]], abs=1e-6)
    assert at(run, "beats", 0.05, 0.15, 2) == [10, 12, 20]


def test_a_value_that_no_branch_assigns_is_kept(tmp_path: Path) -> None:
    """y follows t while sin(2 pi t) > 0 and keeps its last value, at each half second, while it is not."""
    run = run_part(tmp_path, one_part("""variables
  real ramp, y;
initialequations
  y = 7;
equations
  ramp = int (1);
code
  if sin (2 * pi * time) < 0 then y = ramp; end;
  kept = y;""", "kept"))
    assert at(run, "kept", 0.3, 0.7, 1.2, 1.4, 1.7) == pytest.approx([7, 0.7, 1, 1, 1.7], abs=1e-6)


def test_loops_cases_and_matrices_are_worked_out(tmp_path: Path) -> None:
    run = run_part(tmp_path, one_part("""constants
  integer n = 3;
variables
  real m[3,3], v[3], s, odd, k, x;
initialequations
  k = 0;
  while k < 4 do k = k + 1; end;
equations
  m = [2, 0, 1; 1, 3, 0; 0, 1, 4];
  v = inverse (m) * [1 + time; 2; 3];
  first = v[1] * 2 + v[3];
  volume = det (m) + inner (cross ([1; 0; 0], [0; 1; 0]), [7; 8; 9]);
code
  s = 0; odd = 0;
  for i = 1 to n do s = s + i * time; end;
  for i = 1 to 7 by 2 do odd = odd + i; end;
  x = 1;
  repeat x = 2 * x; until x > 10;
  total = s + odd + k;
  doubled = x;
  switch n
    case 1 do which = 10;
    case 2, 3 do which = 20 + time;
    default do which = 0;
  end;""", "first volume total doubled which"))
    assert at(run, "first", 0, 2) == pytest.approx([1, 3])
    assert at(run, "volume", 1) == pytest.approx([25 + 9])
    assert at(run, "total", 0.5) == pytest.approx([3 + 16 + 4])
    assert at(run, "doubled", 1) == [16]
    assert at(run, "which", 1.5) == pytest.approx([21.5])


def test_whole_numbers_follow_their_value(tmp_path: Path) -> None:
    run = run_part(tmp_path, one_part("""variables
  real x;
equations
  x = 4 * time - 3;
  down = floor (x);
  near = round (x);
  up = ceil (x);
  multiple = x - (x mod 2);
  inwards = trunc (x);""", "down near up inwards multiple"))
    times = [0.1, 0.4, 0.7, 0.9, 1.2, 1.9]  # x = -2.6, -1.4, -0.2, 0.6, 1.8, 4.6
    assert at(run, "down", *times) == [-3, -2, -1, 0, 1, 4]
    assert at(run, "near", *times) == [-3, -1, 0, 1, 2, 5]
    assert at(run, "up", *times) == [-2, -1, 0, 1, 2, 5]
    assert at(run, "inwards", *times) == [-2, -1, 0, 0, 1, 4]
    assert at(run, "multiple", *times) == [-2, 0, 0, 0, 0, 4]
    assert "multiple = 2*multiple_steps" in (tmp_path / "out" / "components" / "own.yaml").read_text()


def test_a_file_of_a_library_is_a_part_of_a_diagram(tmp_path: Path) -> None:
    """A submodel without a main model, the active one of two specifications, global relations, causal strokes, names with
    spaces, umlauts and Greek letters, equations behind the end; gain g_n + 2 gain = 23.6133 at two resistances of 4."""
    made = import_emx(_file(tmp_path, LIBRARY_FILE), frozenset(library().names()))
    assert not made.untranslated
    made.write(tmp_path / "out")
    run = hb.simulate(hb.load(str(tmp_path / "out" / "cart.yaml")), until=1)
    part = "Verstaerker"
    assert run[f"{part}.the_source.p.e"][-1] == pytest.approx(2 * 9.80665 + 4)
    assert run[f"{part}.Gain_1.p.f"][-1] == run[f"{part}.Gain_1_2.p.f"][-1] == pytest.approx((2 * 9.80665 + 4) / 4)
    assert [run[f"{part}.y_{k}"][-1] for k in (1, 2, 3)] == [0.0005, 0, 3]


def _element(name: str, kind: str, ports: str, equations: str, knot: bool = False) -> str:
    return f"""   {name} 0 0
    {"knot" if knot else "type"} {kind}
     ports
      {ports}
    end;
    implementation eq
{equations}
implementation_end;
"""


def _whole(parts: str, connections: str) -> str:
    return f"""<?xml version="1.0"?><Document><Model version="4.5"><Sidops><![CDATA[model 0 0
 type Mainmodel
 end;
 implementation bg
  submodels
{parts}  end;
  connections
{connections}
  end;
 implementation_end;
]]></Sidops></Model></Document>"""


@pytest.mark.parametrize("turned", [False, True], ids=["arrow_in", "arrow_out"])
def test_elements_with_two_terminals(tmp_path: Path, turned: bool) -> None:
    """A capacitor charged through a resistor, and a mass on a spring and a damper to the ground that is pulled by a force:
    the elements have ports with a high and a low terminal, whichever way the arrows of the connections point."""
    parts = "".join([
        _element("Battery", "Battery", "electric delta out p;", "equations\n	p.u = 10;"),
        _element("Resistor", "Resistor", "electric delta in p;", "equations\n	p.u = 100 * p.i;"),
        _element("Capacitor", "Capacitor", "electric delta in p; signal out u;",
                 "equations\n	p.u = int (p.i) / 0.001;\n	u = p.u;"),
        _element("Ground", "Ground", "electric knot duplicatable none p [1];",
                 "equations\n	collect (p.u) = 0;", knot=True),
        _element("Mass", "Mass", "translation knot duplicatable none p [1]; signal out x;",
                 "equations\n	collect (p.v) = int (sum (direct (p.F)) / 2);\n	x = int (first (p.v));", knot=True),
        _element("Spring", "Spring", "translation delta in p;", "equations\n	p.F = 50 * int (p.v);"),
        _element("Damper", "Damper", "translation delta in p;", "equations\n	p.F = 3 * p.v;"),
        _element("Fixed", "Fixed", "translation knot duplicatable none p [1];",
                 "equations\n	collect (p.v) = 0;", knot=True),
        _element("Pull", "Pull", "translation out p;", "equations\n	p.F = 4;")])
    side = "Fixed\\p => {0}\\p_low;" if turned else "{0}\\p_low => Fixed\\p;"
    made = import_emx(_file(tmp_path, _whole(parts, "\n".join([
        "   Battery\\p_high => Resistor\\p_high;", "   Resistor\\p_low => Capacitor\\p_high;",
        "   Ground\\p => Battery\\p_low;", "   Capacitor\\p_low => Ground\\p;", "   Pull\\p => Mass\\p;",
        *(f"   Mass\\p => {e}\\p_high;\n   {side.format(e)}" for e in ("Spring", "Damper"))]))))
    assert not made.untranslated
    made.write(tmp_path / "out")
    run = hb.simulate(hb.load(str(tmp_path / "out" / "cart.yaml")), until=1)
    charged = abs(run.time - 0.1).argmin()
    assert run["Capacitor.u"][charged] == pytest.approx(10 * (1 - math.exp(-run.time[charged] / 0.1)), rel=1e-5)
    decay, omega = 3 / 4, math.sqrt(25 - (3 / 4)**2)
    t = run.time[-1]
    shape = math.exp(-decay * t) * (math.cos(omega * t) + decay / omega * math.sin(omega * t))
    assert run["Mass.x"][-1] == pytest.approx(4 / 50 * (1 - shape), rel=1e-5)


def test_what_no_equation_assigns_is_zero_and_listed(tmp_path: Path) -> None:
    run = run_part(tmp_path, one_part("""variables
  real lost, kept;
initialequations
  kept = 1;
equations
  y = 2 * lost + time;
code
  if time == 0 then kept = 3; end;
  z = kept;""", "y z"), untranslated=1)
    assert at(run, "y", 1) == [1] and at(run, "z", 1) == [3]


def test_functions_of_transforms_and_twists(tmp_path: Path) -> None:
    """Compared with the matrices of screw theory, rotation first; whole numbers and bits are known beforehand."""
    run = run_part(tmp_path, one_part("""constants
  integer bits = bitor (5, bitshift (1, 3));
variables
  real H[4,4], w[6], A[6,6], B[6,6], T[4,4], x[2];
equations
  H = homogeneous ([0, -1, 0; 1, 0, 0; 0, 0, 1], [1; 2; 3]);
  w = [1; 2; 3; 4; 5; 6];
  A = Adjoint (H);
  B = adjoint (w);
  T = tilde (w);
  x = linsolve ([2, 1; 1, 3], [5; 10]);
  a = A[4,1] + 10 * A[5,2] + 100 * A[6,1] + 1000 * A[6,2];
  b = B[4,2] + 10 * B[6,1] + 100 * B[2,1];
  c = T[1,4] + 10 * T[2,3] + 100 * inverseH (H)[1,4] + 1000 * multiplyH (H, H)[1,4];
  d = x[1] + 10 * x[2] + max ([1; 7; 3]) + norminf ([1, -4; 2, 2]);
  n = bits + round (-2.5) + trunc (2.7) + 17 mod 5;
  l = log (exp (2)) + log10 (1000) + sym ([1, 2; 4, 1])[1,2] + antisym ([1, 2; 4, 1])[1,2];""", "a b c d n l"))
    rotation, place = [[0, -1, 0], [1, 0, 0], [0, 0, 1]], [1, 2, 3]
    lower = [[sum(_skew(place)[i][j] * rotation[j][k] for j in range(3)) for k in range(3)] for i in range(3)]
    assert at(run, "a", 1) == [lower[0][0] + 10 * lower[1][1] + 100 * lower[2][0] + 1000 * lower[2][1]]
    assert at(run, "b", 1) == [_skew([4, 5, 6])[0][1] + 10 * _skew([4, 5, 6])[2][0] + 100 * _skew([1, 2, 3])[1][0]]
    assert at(run, "c", 1) == [4 + 10 * -1 + 100 * -2 + 1000 * (-2 + 1)]
    assert at(run, "d", 1) == pytest.approx([1 + 30 + 7 + 5])
    assert at(run, "n", 1) == [13 - 3 + 2 + 2]
    assert at(run, "l", 1) == pytest.approx([2 + 3 + 3 - 1])


def _skew(v: list[int]) -> list[list[int]]:
    return [[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]]


LIBRARY_FILE = """<?xml version="1.0"?><Document><Model version="4.5"><Sidops><![CDATA[Verst\u00e4rker 40 20
 description '<Attributes><GlobalRelations>parameters
	integer n = 3;
	real gain (range=&lt;0,10&gt;) = 2;
	real \u03b8[2] = [1; 2 * gain];</GlobalRelations></Attributes>';
 type Submodel
  ports
   signal in u;
   signal out y [n];
 end;
 implementation bg
  submodels
   'the source' 0 0
    specifications active 'b'
     specification 'a' description ''; type Se ports power out p; end; implementation eq
equations
	p.e = 1;implementation_end;specification_end;
     specification 'b' description ''; type Se ports power out p; signal in u; signal out all [n]; end; implementation eq
parameters
	integer global n;
	real global gain;
	real global \u03b8[2];
	real gain2 (range=<-1,1>) = 0.5 {length, mm};
equations
	p.e = gain * g_n + \u03b8[2];implementation_end;
	all = [gain2; u; n];specification_end;
    end;
   'Gain-1' 40 0
    type R ports power in p; end;
    implementation eq
equations
	p.e = 4 * p.f;
    implementation_end;
   Gain_1 80 0
    type R2 ports power in p; end;
    implementation eq
equations
	p.f = p.e / 4;
    implementation_end;
   ZeroJunction 40 40
    knot ZeroJunction ports power knot duplicatable none p [1]; end; implementation eq
equations
	sum (direct (p.f)) = 0; equal (collect (p.e)); \u00b0
    implementation_end;
  end;
  connections
   'the source'\\p |=> ZeroJunction\\p;
   'the source'\\all -> y;
   u -> 'the source'\\u;
   ZeroJunction\\p =>| 'Gain-1'\\p;
   Gain_1\\p <=| ZeroJunction\\p;
  end;
 implementation_end;
]]></Sidops></Model></Document>"""


@pytest.mark.parametrize("text", [
    OWN.replace("<Document>", '<!DOCTYPE a [<!ENTITY b "c">]><Document>', 1),
    OWN.replace("F else 0 end", "(" * 500 + "F" + ")" * 500 + " else 0 end"),
    "<a>" * 5000 + "</a>" * 5000,
    "", "no XML", OWN.replace("model 0 0", "mode"),
], ids=["entities", "brackets", "elements", "empty", "text", "no_model"])
def test_hostile_files_are_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(ModelError):
        import_emx(_file(tmp_path, text))


EVERYTHING = one_part("""constants
  integer n = 3;
variables
  real m[3,3], v[3], s, k, x;
  boolean crossing;
initialequations
  k = 0;
  while k < 4 do k = k + 1; end;
equations
  m = [2, 0, 1; 1, 3, 0; 0, 1, 4];
  v = inverse (m) * [1 + time; 2; 3];
  crossing = event (sin (time));
  a = resint (1, -1, crossing, 0.25) + limint (cos (time), 0, 0.2, 0.1);
  b = hold (dint (sample (v[1]), 5), 0) + hold (previous (time, -1), 0);
  d = constraint (d - time * 2 {hr});
code
  k = 1; x = 0;
  while (k <= 3 and not x) do
    if v[2] < m[k,1] then x = 1; else if k == 3 then x = 2; end; end;
    k = k + 1;
  end;
  s = 0;
  for i = 1 to n by 2 do s = s + i * time; end;
  repeat x = 2 * k; until x > 7;
  if frequencyevent (0.4, 0.1) then k = k + 2; end;
  switch n
    case 1 do c = round (time);
    default do c = s + x;
  end;""", "a b c d")
PIECES = ["", "end;", "[", "(", "'", "=", "if", "1e999", "[0]", "knot", ")", ";", "while", "repeat", "until", "switch",
          "by 0", "resint (", "event (", "frequencyevent (0)", "hold (", "next (y) = 1;", "inverse (", "eye (-1)",
          "floor (", "constraint (", "{hr}", "not", "table ('x.txt', ", "mul (collect (", "x[k]"]


def test_texts_in_the_code_page_of_windows_are_read(tmp_path: Path) -> None:
    """Letters of a symbol font in a file that is declared as UTF-8."""
    text = one_part("parameters\n real a = 3;\t// gr\xf6\xdfe\x02\nequations\n y = a;", "y")
    (tmp_path / "cart.emx").write_bytes(text.replace("?>", ' encoding="UTF-8"?>', 1).encode("cp1252"))
    files = import_emx(tmp_path / "cart.emx").files
    assert "a: {unit: 1, default: 3, doc: " in (own := files["components/own.yaml"]) and "gr\xf6\xdfe" in own


def test_units_of_declarations_and_of_numbers(tmp_path: Path) -> None:
    made = import_emx(_file(tmp_path, one_part("""parameters
 real a = 2 {km/h}, b = 3 {Nm}, c = 20 {degC}, e = 5 {uF}, f = 7 {furlong}, g = 90 {deg};	// seven
equations
 y = a * b * c * e * f * g * time / 1 {ms};""", "y")))
    text = made.files["components/own.yaml"]
    for name, unit, value in (("a", "m/s", "0.555555555555556 m/s"), ("b", "N*m", "3 N*m"), ("c", "K", "293.15 K"),
                              ("e", "F", "5e-06 F"), ("g", "rad", "1.5707963267949 rad")):
        assert f"{name}: {{unit: {unit}, default: {value}" in text
    assert 'f: {unit: 1, default: 7, doc: "seven [furlong]"}' in text
    assert "time / 0.001" in text


@pytest.mark.long
@pytest.mark.parametrize("text", [OWN, EVERYTHING], ids=["graph", "equations"])
def test_mutated_files_end_without_a_traceback(tmp_path: Path, text: str) -> None:
    draw, names = random.Random(7), frozenset(library().names())
    words, refused = text.split(" "), 0
    for _ in range(100):  # of each of two, with the recognition of library components
        mutant = list(words)
        for _ in range(draw.randint(1, 4)):
            k = draw.randrange(len(mutant))
            mutant[k] = draw.choice([*PIECES, draw.choice(words)])
        try:
            import_emx(_file(tmp_path, " ".join(mutant)), names)
        except HeavebondError:
            refused += 1
    assert 0 < refused < 100


@pytest.mark.parametrize("name", ["mass_spring_damper", "single_watertank", "three_tank", "bicycle", "line_sensor",
                                  pytest.param("line_follower_body", marks=pytest.mark.long)])
def test_public_models_pass_the_check(tmp_path: Path, name: str) -> None:
    if not MODELS.is_dir():
        pytest.skip("the public 20-sim models (../shared/data/emx) are not here")
    made = import_emx(MODELS / f"{name}.emx", frozenset(library().names()))
    made.write(tmp_path)
    answer = CliRunner().invoke(main, ["check", str(tmp_path / f"{name}.yaml")])
    lawless = any("\nplaceholder:" in text for text in made.files.values())
    assert answer.exit_code == (3 if lawless else 0), answer.output
    for part in {u.submodel for u in made.untranslated if "is not translated" in u.reason}:
        assert part in answer.output
