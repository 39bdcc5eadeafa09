"""Drawings coloured by a run: the values are those of the run, and the colours those of the bar."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest
from click.testing import CliRunner

import heavebond as hb
from heavebond.cli import main
from heavebond.pictures.colour_map import BOTH_WAYS, FADED, SCALE, paint

# two dampers drawn by a constant force: powers by hand
PULL = """
model: pull
components:
  wall:   {is: Fixed}
  damper: {is: Damper, d: 3 N*s/m}
  other:  {is: Damper, d: 1 N*s/m}
  drive:  {is: ForceSource, u: 8 N}
  cart:   {is: Mass, m: 1 g}
nodes:
  wall: [wall.a, damper.a, other.a]
  cart: [damper.b, other.b, drive.a, cart.a]
initial: {start: steady, cart.x: 0}
simulate: {until: 2 s, every: 0.1 s}
"""


def test_powers_are_what_components_and_nodes_pass_on() -> None:
    """8 N against 4 N*s/m is 2 m/s: 16 W, of which 12 W and 4 W end in the dampers."""
    found = paint(hb.loads(PULL.replace("start: steady, ", "cart.v: 2 m/s, ")), "power", at="1 s")
    assert found.unit == "W"
    assert found.parts == pytest.approx({"wall": 0.0, "damper": 12.0, "other": 4.0, "drive": 16.0, "cart": 0.0}, abs=1e-6)
    assert found.nets == pytest.approx({"wall": 0.0, "cart": 16.0}, abs=1e-6)
    assert found.title == "power, at 1 s"


@pytest.mark.parametrize("grounded", ["zero", "plus", "middle"])
def test_electrical_power_does_not_depend_on_where_ground_is(grounded: str) -> None:
    """12 V and 6 ohm make 2 A: 24 W, of which 2 W stay in the battery, 6 W in the wire and 16 W in the load."""
    found = paint(hb.loads(f"""
model: battery
components:
  battery: {{is: Battery, U_0: 12 V, R_i: 0.5 ohm}}
  wire:    {{is: Resistor, R: 1.5 ohm}}
  load:    {{is: Resistor, R: 4 ohm}}
  ground:  {{is: ElectricalGround}}
nodes:
  plus:   [battery.a, wire.a{", ground.a" if grounded == "plus" else ""}]
  middle: [wire.b, load.a{", ground.a" if grounded == "middle" else ""}]
  zero:   [load.b, battery.b{", ground.a" if grounded == "zero" else ""}]
simulate: {{until: 1 s, every: 0.1 s}}
"""), "power", at="1 s")
    assert found.parts == pytest.approx({"battery": 22.0, "wire": 6.0, "load": 16.0, "ground": 0.0}, abs=1e-6)


def test_a_transformer_passes_on_the_power_of_its_primary_winding() -> None:
    """Each winding is one pair of ports: 230 V and, by turns of 10:1, 23 V on 5 ohm: 23 * 23 / 5 = 105.8 W at the peak."""
    found = paint(hb.load("examples/transformer"), "power", over="peak")
    assert found.parts == pytest.approx(dict.fromkeys(("supply", "transformer", "load"), 105.8) | {"ground": 0.0}, abs=1e-6)


def test_a_variable_is_shown_where_there_is_one() -> None:
    model = hb.loads(PULL.replace("start: steady, ", "cart.v: 2 m/s, "))
    found = paint(model, "v", over="peak")
    assert found.nets == pytest.approx({"wall": 0.0, "cart": 2.0})
    assert found.parts == pytest.approx({"damper": 2.0, "other": 2.0})  # their own variable of that name
    force = paint(model, "f")
    assert abs(force.parts["damper"]) == pytest.approx(6.0) and not force.nets
    one = paint(model, "cart.x", at="2 s")
    assert one.nets == pytest.approx({"cart": 4.0}) and not one.parts


def test_colours_run_along_the_bar() -> None:
    found = paint(hb.loads(PULL.replace("start: steady, ", "cart.v: 2 m/s, ")), "power", at="1 s")
    assert found.colour(found.high) == SCALE[-1] and found.colour(found.low) == SCALE[0]
    assert found.colour(1e9) == SCALE[-1]
    signed = paint(hb.load("quarter_car"), "v", at="1.1 s")
    assert signed.low == -signed.high and signed.colour(0.0) == BOTH_WAYS[2]
    wide = paint(hb.load("cmc_ahc"), "power", at="10 s")
    assert wide.logarithmic
    assert math.log10(wide.at(0.5)) == pytest.approx((math.log10(wide.low) + math.log10(wide.high)) / 2)


def test_the_drawing_has_the_colours_the_figures_and_a_bar() -> None:
    model = hb.load("quarter_car")
    found = paint(model, "power", over="mean")
    svg = hb.draw(model, colour=found)
    assert f'stroke="{found.colour(found.nets["wheel"])}"' in svg
    assert f">{found.text(found.parts['damper'])}<" in svg
    assert "power, mean over 0 to 4 s [W]" in svg
    assert svg == hb.draw(model, colour=found)
    only = hb.draw(model, colour=paint(model, "body.x", at="0 s"))
    assert FADED in only and len(re.findall(r"fill-opacity", only)) == 0


@pytest.mark.parametrize(("given", "said"), [
    (["--colour", "powr"], "power"),
    (["--colour", "v", "--at", "9 s"], "from 0 to 4 s"), (["--colour", "v", "--at", "1 m"], "s"),
    (["--colour", "zz"], "nothing in this diagram"),
])
def test_what_cannot_be_shown_is_said(given: list[str], said: str, tmp_path: Path) -> None:
    answer = CliRunner().invoke(main, ["draw", "quarter_car", "-o", str(tmp_path / "x.svg"), *given])
    assert answer.exit_code == 2 and said in answer.output


def test_a_name_of_different_quantities_is_refused() -> None:
    with pytest.raises(hb.UsageError, match=r"not the same quantity everywhere[\s\S]*unit-kind"):
        paint(hb.load("dc_stage"), "v")
