"""Machines in a plane: ports of several pairs in checks, energy, power and messages."""

from __future__ import annotations

import pytest

import heavebond as hb
from heavebond.energy.audit import audit
from heavebond.equations.places import nodes_of
from heavebond.language.library import library

PENDULUM = """
model: pendulum
components:
  ground: {is: PlanarFixed}
  pin:    {is: RevoluteJoint}
  rod:    {is: RigidLink, l: 5 m}
  bob:    {is: PlanarBody, m: 2 kg, J: 0.1 kg*m**2}
nodes:
  ground: [ground.a, pin.a]
  top:    [pin.b, rod.a]
  end:    [rod.b, bob.a]
initial: {top.phi: 0 rad, top.w: 0 rad/s}
show: {height: {is: end.y, unit: m}}
simulate: {until: 3 s}
"""


def test_a_domain_with_several_pairs() -> None:
    planar = library().domains["planar"]
    assert planar.pairs == (("F_x", "v_x"), ("F_y", "v_y"), ("M", "w"))
    assert planar.rate("phi") == "w"
    assert planar.effort is planar.flow is planar.position is None
    assert library().domains["translational"].pairs == (("f", "v"),)


def test_the_power_over_a_port_is_the_sum_over_its_pairs() -> None:
    found = hb.simulate(hb.loads(PENDULUM))
    power = found["bob.a.F_x"]*found["end.v_x"] + found["bob.a.F_y"]*found["end.v_y"] + found["bob.a.M"]*found["end.w"]
    assert found.signals(["bob.a.power"])["bob.a.power"] == pytest.approx(power, abs=1e-9)
    assert found["pin.a.F_x"] == pytest.approx(-found["ground.a.F_x"])
    braked = PENDULUM.replace("nodes:", """  shaft:  {is: PlanarShaft}
  brake:  {is: RotationalDamper, d: 8 N*m*s/rad}
  wall:   {is: FixedShaft}
nodes:
  hub:    [shaft.s, brake.b]
  wall:   [wall.a, brake.a]""").replace("rod.a]", "rod.a, shaft.a]")
    audit(hb.loads(braked)).raise_if_open(1e-6)


def test_the_angle_stays_the_state_of_a_long_pendulum_at_any_angle() -> None:
    found = hb.simulate(hb.loads(PENDULUM))
    assert not found.statistics.get("state_changes")
    assert {name.rpartition(".")[2] for name in found.assembly.state_names} == {"phi", "w"}


def test_only_positions_that_something_names_are_unknowns() -> None:
    flat = hb.assemble(hb.loads("""
model: pushed
components:
  body:  {is: PlanarBody, m: 1 kg, J: 1 kg*m**2, g: 0}
  push:  {is: PlanarForce, F_x: 1 N, F_y: 0}
  shaft: {is: PlanarShaft}
nodes: {a: [push.a, shaft.a, body.a], s: [shaft.s]}
""")).flat
    assert {"a.phi"} <= set(flat.names)
    assert "a.x" not in flat.names


def test_a_virtual_source_sets_one_effort_and_so_leaves_planar_nodes_out() -> None:
    assert nodes_of(hb.assemble(hb.loads(PENDULUM)).flat) == {}


def test_a_port_of_any_domain_on_a_node_with_several_pairs() -> None:
    with pytest.raises(hb.ModelError) as caught:
        hb.assemble(hb.loads("""
model: pulled
components: {body: {is: PlanarBody, m: 1 kg, J: 1 kg*m**2}, loss: {is: R, R: 1 N*s/m}}
nodes: {n: [body.a, loss.a]}
"""))
    text = str(caught.value)
    assert "[domain-pair]" in text
    assert "a planar node has several of each" in text
