"""Import of 20-sim models: a model of our own, hostile and mutated files, and public models where they are at hand."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

import heavebond as hb
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
    speed = run["Mass.state"] / 0.5
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


@pytest.mark.parametrize("text", [
    OWN.replace("<Document>", '<!DOCTYPE a [<!ENTITY b "c">]><Document>', 1),
    OWN.replace("F else 0 end", "(" * 500 + "F" + ")" * 500 + " else 0 end"),
    "<a>" * 5000 + "</a>" * 5000,
    "", "no XML", OWN.replace("model 0 0", "mode"),
], ids=["entities", "brackets", "elements", "empty", "text", "no_model"])
def test_hostile_files_are_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(ModelError):
        import_emx(_file(tmp_path, text))


def test_mutated_files_end_without_a_traceback(tmp_path: Path) -> None:
    draw = random.Random(7)
    words = OWN.split(" ")
    for _ in range(200):
        mutant = list(words)
        for _ in range(draw.randint(1, 4)):
            k = draw.randrange(len(mutant))
            mutant[k] = draw.choice(["", "end;", "[", "(", "'", "=", "if", "1e999", "[0]", "knot", draw.choice(words)])
        try:
            import_emx(_file(tmp_path, " ".join(mutant)))
        except HeavebondError:
            continue


@pytest.mark.parametrize("name", ["mass_spring_damper", "single_watertank", "three_tank", "bicycle", "line_sensor",
                                  "line_follower_body"])
def test_public_models_are_assembled(tmp_path: Path, name: str) -> None:
    if not MODELS.is_dir():
        pytest.skip("the public 20-sim models (../shared/data/emx) are not here")
    made = import_emx(MODELS / f"{name}.emx", frozenset(library().names()))
    made.write(tmp_path)
    hb.assemble(hb.load(str(tmp_path / f"{name}.yaml")))
