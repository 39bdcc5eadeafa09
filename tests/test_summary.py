"""What `heavebond check` says of a diagram: states, loops, index and start in words and as data."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import heavebond as hb
from heavebond.numerics.initialise import start
from heavebond.reports.summary import Summary, summary

SLIDER = """
model: slider
summary: A cart on a rail, pulled aside against a spring.
components:
  wall:   {is: Fixed}
  spring: {is: Spring, c: 1.2 kN/m}
  cart:   {is: Mass, m: 2.5 kg}
nodes:
  ground: [wall.a, spring.a]
  load:   [spring.b, cart.a]
initial: {load.x: 50 mm, load.v: 0 m/s}
"""
ROD = """
component: Rod
summary: A rigid rod.
ports: {a: translational, b: translational}
parameters:
  l: {unit: m, doc: length}
variables:
  F: {unit: N, doc: tension}
equations: |
  b.x = a.x + l   # rigid
  b.f = F
  a.f = -F
"""
RODS = """
model: rods
components:
  one:    {is: Mass, m: 2 kg}
  two:    {is: Mass, m: 3 kg}
  rod:    {is: Rod, l: 1 m}
  wall:   {is: Fixed}
  spring: {is: Spring, c: 2 N/m}
nodes:
  ground: [wall.a, spring.a]
  left:   [spring.b, one.a, rod.a]
  right:  [rod.b, two.a]
initial: {right.x: 1 m}
"""
ORIFICES = """
model: orifices
components:
  supply: {is: PressureSource, p_0: 100 bar}
  first:  {is: Orifice, q_r: 10 L/min, dp_r: 5 bar}
  second: {is: Orifice, q_r: 20 L/min, dp_r: 5 bar}
  tank:   {is: Tank}
nodes:
  high:   [supply.a, first.a]
  middle: [first.b, second.a]
  low:    [second.b, tank.a]
initial: {middle.p: ~ 50 bar}
"""


def _summary(text: str, folder: Path) -> Summary:
    assembly = hb.assemble(hb.loads(text, folder))
    return summary(assembly, start(assembly))


def test_counts_of_a_slider(tmp_path: Path) -> None:
    found = _summary(SLIDER, tmp_path)
    assert found.components == {"Fixed": ("wall",), "Spring": ("spring",), "Mass": ("cart",)}
    assert found.nodes == ("ground", "load")
    assert found.equations == found.unknowns
    assert {s.name: s.unit for s in found.states} == {"load.x": "m", "load.v": "m/s"}
    assert (found.algebraic, found.loops) == ((), ())
    assert found.as_dict()["equations_left"] == {"differential": 2, "algebraic": 0}


def test_a_state_says_where_its_rate_stands(tmp_path: Path) -> None:
    why = {s.name: s.why for s in _summary(SLIDER, tmp_path).states}
    assert why["load.v"] == "cart: m * der(a.v) = a.f"
    assert "load.v = der(load.x)" in why["load.x"]


def test_a_rigid_rod_is_differentiated_twice_and_its_other_end_is_no_state(tmp_path: Path) -> None:
    (tmp_path / "rod.yaml").write_text(ROD)
    found = _summary(RODS, tmp_path)
    assert found.index == 3
    twice = [d for d in found.differentiated if d.times == 2]
    assert [(d.component, d.equation) for d in twice] == [("rod", "b.x = a.x + l")]
    assert twice[0].file.endswith("rod.yaml")
    assert twice[0].line > 1
    chosen = next(s for s in found.states if s.name == "right.x")
    assert "chosen before" in chosen.why
    assert "left.x" in chosen.why
    assert "initial value is asked for" in chosen.why
    (loop,) = found.loops
    assert loop.components == ("one", "two", "rod")
    assert (len(loop.torn), loop.left) == (1, 0)
    assert "solved explicitly" in found.text()


def test_a_loop_that_is_left_to_the_solver(tmp_path: Path) -> None:
    found = _summary(ORIFICES, tmp_path)
    assert found.algebraic == ("middle.p",)
    assert found.loops[0].components == ("first", "second")
    assert "tearing variables middle.p, iterated by the integrator" in found.text()
    assert "1 algebraic unknown: middle.p" in found.text()


def test_start_table_tells_asked_used_and_why(tmp_path: Path) -> None:
    found = _summary(SLIDER, tmp_path)
    line = next(s for s in found.start if s.name == "load.x")
    assert (line.asked, line.used, line.why) == ("50 mm", pytest.approx(0.05), "asked for")
    text = found.text()
    assert "50 mm" in text.split("Initial conditions")[1]


def test_start_values_are_shown_in_the_units_of_the_diagram() -> None:
    found = hb.check(hb.loads("""
model: plate
components:
  h: {is: HeatCapacity, m: 1 kg, c: 460 J/(kg*K)}
  i: {is: Inertia, J: 1 kg*m**2}
nodes: {a: [h.a], x: [i.a]}
initial: {a.T: 68 degF, x.w: 3000 rpm, x.phi: 1e-14 rad}
simulate: {until: 1 s}
"""))
    lines = [line.split() for line in str(found).split("Initial conditions")[1].splitlines()]
    assert ["a.T", "68", "degF", "68", "degF", "asked", "for"] in lines
    assert ["x.w", "3000", "rpm", "3000", "rpm", "asked", "for"] in lines
    # a tiny value that was specified is no rounding error
    assert ["x.phi", "1e-14", "rad", "1.0000e-14", "rad", "asked", "for"] in lines


def test_parameters_solved_for_stand_apart() -> None:
    assembly = hb.assemble(hb.load("cmc_ahc"))
    found = summary(assembly, start(assembly))
    assert [line.name for line in found.solved] == ["cmc.gas.F_0", "drilling.seabed.x0"]
    assert not {line.name for line in found.start} & {"cmc.gas.F_0", "drilling.seabed.x0"}
    assert found.start_mode == "steady"
    assert found.blocks == {"PassiveCompensator": ("cmc",), "ActiveCompensator": ("ahc",), "DrillString": ("drilling",)}
    assert sum(map(len, found.components.values())) == 24
    # Newton's rounding is shown as the zero that it means
    assert next(line for line in found.start if line.name == "crown.v").used == 0


@pytest.mark.parametrize("width", [60, 80, 120])
def test_text_keeps_to_the_width(width: int, tmp_path: Path) -> None:
    assembly = hb.assemble(hb.load("cmc_ahc"))
    text = summary(assembly, start(assembly)).text(width)
    assert max(map(len, text.splitlines())) <= width


def test_without_a_start_the_structure_is_told_all_the_same(tmp_path: Path) -> None:
    found = summary(hb.assemble(hb.loads(SLIDER, tmp_path)), None)
    assert found.start == ()
    assert "States" in found.text()
    assert "Initial conditions" not in found.text()


def test_data_is_json(tmp_path: Path) -> None:
    assert json.loads(json.dumps(_summary(SLIDER, tmp_path).as_dict()))["model"] == "slider"


def test_states_that_may_change_are_told() -> None:
    found = summary(hb.assemble(hb.load("mechanisms/pendulum")), None)
    assert [(c.states, c.others) for c in found.charts] == [(("bob.x",), ("bob.y",)), (("bob.v_x",), ("bob.v_y",))]
    assert found.charts[0].equations == ("bob: x**2 + y**2 = L**2",)
    assert "\n  bob.x    to bob.y    bob: x**2 + y**2 = L**2\n" in found.text()
    # constraints that never change need one choice only
    assert not summary(hb.assemble(hb.load("passive_rig")), None).charts
