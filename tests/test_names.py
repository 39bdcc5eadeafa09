"""One owner for every name: two things of a diagram that would be called alike are refused, with the lines of both."""

from __future__ import annotations

import pytest

import heavebond as hb
from heavebond.core.errors import ModelError
from heavebond.equations import flatten as flattening
from heavebond.language.model import loads

ROPE = """model: rope
components:
  hand: {is: VelocitySource, u: 0.1 m/s}
  rope: {is: SpringDamper, c: 200 kN/m, d: 800 N*s/m}
  load: {is: Mass, m: 250 kg}
nodes:
  NODE: [hand.a, rope.a]
  load: [rope.b, load.a]
"""
BLOCK = """component: Rig
summary: A mass on a spring.
ports: {a: translational}
parameters: {k: {unit: N/m, min: 0, doc: stiffness}}
components:
  PART: {is: Spring, c: =k}
  damper: {is: Damper, d: 100 N*s/m}
  mass: {is: Mass, m: 1 kg}
  sensor: {is: PositionSensor}
nodes:
  top: [a, PART.a, damper.a]
  NODE: [PART.b, damper.b, mass.a, sensor.a]
  SIGNAL: [sensor.y]
"""


def refused(text: str, folder: str = ".") -> str:
    with pytest.raises(ModelError) as caught:
        flattening.flatten(loads(text, folder))
    return str(caught.value)


def block(folder, part: str = "spring", node: str = "low", signal: str = "place") -> str:
    """A diagram with one block, whose inner names are given."""
    text = BLOCK.replace("PART", part).replace("NODE", node).replace("SIGNAL", signal)
    (folder / "rig.yaml").write_text(text)
    return "model: m\ncomponents:\n  wall: {is: Fixed}\n  rig: {is: Rig, k: 1 kN/m}\nnodes: {wall: [wall.a, rig.a]}\n"


def test_a_node_named_like_a_part_is_refused():
    """The spring's own speed v and the node's velocity would both be `rope.v`: the load was at -36.6 m."""
    said = refused(ROPE.replace("NODE", "rope"))
    assert "'rope.v' would mean two things: v (velocity) of node 'rope' (line 7 of text)" in said
    assert "the variable v of component 'rope' (SpringDamper) (line 4 of text)" in said
    assert "Give the node another name" in said
    assert "[name-twice]" in said


def test_a_node_named_otherwise_runs():
    run = hb.simulate(loads(ROPE.replace("NODE", "hook")), until=2.0, also=["load.x"])
    assert run["load.x"][-1] == pytest.approx(0.200, abs=0.002)


def test_a_node_named_like_a_part_without_such_variables_is_none_of_these():
    """As the language page says: `load.x` is the node's, `load.m` the part's."""
    flat = flattening.flatten(loads(ROPE.replace("NODE", "hand")))
    assert flat.unknowns[flat.names["hand.v"]].role == "across"


def test_a_position_that_nothing_names_counts_all_the_same(tmp_path):
    """`press.x` is a variable of the part; asking for it must not make an unknown of the node's position."""
    (tmp_path / "press.yaml").write_text("""component: Press
summary: A force that is twice a given one.
ports: {a: translational}
parameters: {F: {unit: N, default: 9810 N, doc: force}}
variables: {x: {unit: 1, doc: factor}}
equations: |
  a.f = -x*F
  x = 2
""")
    text = "model: m\ncomponents: {press: {is: Press}, load: {is: Mass, m: 1 kg}}\nnodes: {NODE: [press.a, load.a]}\n"
    said = refused(text.replace("NODE", "press"), tmp_path)
    assert "'press.x' would mean two things: x (position) of node 'press'" in said
    flattening.flatten(loads(text.replace("NODE", "load"), tmp_path))


@pytest.mark.parametrize(("inner", "words"), [
    ({"part": "a"}, ("'a' is both a port and a part",)),
    ({"node": "a"}, ("'rig.a.v'", "node 'rig.a'", "port 'rig.a'")),                 # a node like a port that is not on it
    ({"node": "damper"}, ("'rig.damper.v'", "node 'rig.damper'")),                  # a node like a part on it
    ({"signal": "k"}, ("'rig.k'", "the parameter k of component 'rig' (Rig)")),     # a signal like a parameter
])
def test_names_inside_a_block_that_meet_are_refused(tmp_path, inner, words):
    said = refused(block(tmp_path, **inner), tmp_path)
    assert all(word in said for word in words), said


def test_a_block_without_such_names_is_accepted(tmp_path):
    flat = flattening.flatten(loads(block(tmp_path), tmp_path))
    assert "rig.low.v" in flat.names


def test_a_part_named_like_one_that_repeat_makes_is_refused():
    """`leg: {repeat: 2}` makes leg_1 and leg_2 and the node leg_1_2; what stands there under these names was lost."""
    text = """model: m
components:
  wall: {is: Fixed}
  leg: {is: SpringDamper, c: 1 kN/m, d: 1 N*s/m, repeat: 2}
  leg_2: {is: Mass, m: 1 kg}
nodes: {wall: [wall.a, leg.a], end: [leg.b, leg_2.a]}
"""
    said = refused(text)
    assert "`repeat:` makes a component 'leg_2' of 'leg' (line 4); there is one already (line 5)" in said
    said = refused(text.replace("leg_2:", "m:").replace("leg_2.a", "m.a").replace("end:", "leg_1_2:"))
    assert "`repeat:` makes a node 'leg_1_2' of 'leg' (line 4)" in said


def test_two_repeats_that_make_one_name_are_refused():
    text = """model: m
components:
  wall: {is: Fixed}
  leg: {is: SpringDamper, c: 1 kN/m, d: 1 N*s/m, repeat: 2}
  leg_1: {is: SpringDamper, c: 1 kN/m, d: 1 N*s/m, repeat: 2}
nodes: {wall: [wall.a, leg.a], middle: [leg.b, leg_1.a], end: [leg_1.b]}
"""
    assert "makes a component 'leg_1' of 'leg'" in refused(text)


@pytest.mark.parametrize(("entry", "other"), [
    ("load.x: {is: -load.x, unit: m}", "x (position) of node 'load'"),
    ("load.m: {is: load.x, unit: m}", "the parameter m of component 'load' (Mass)"),
    ("y: {is: load.x, unit: m}", "the signal of node 'y'"),
    ("time: {is: load.x, unit: m}", "a formula, or the time"),
    ("2*load.x: {is: load.x, unit: m}", "a formula, or the time"),
])
def test_an_output_named_like_something_else_is_refused(entry, other):
    text = ROPE.replace("NODE", "hook").replace("  load: {is", "  s: {is: PositionSensor}\n  load: {is") \
        .replace("load.a]", "load.a, s.a]\n  y: [s.y]") + f"show: {{{entry}}}\n"
    assert other in refused(text)


def test_an_output_that_is_the_variable_in_another_unit_is_accepted():
    text = ROPE.replace("NODE", "hook") + "show: {load.x: {unit: mm}, " \
        "rope.F: {is: rope.F, unit: kN}, load x: {is: load.x, unit: m}}\n"
    flattening.flatten(loads(text))


def test_a_part_named_like_the_parameters_of_a_run_is_refused():
    said = refused(ROPE.replace("NODE", "hook").replace("load:", "initial:").replace("load.a", "initial.a"))
    assert "'initial' cannot name a component with parameters" in said


def test_a_variable_named_like_a_switch_of_the_time_is_refused(tmp_path):
    (tmp_path / "part.yaml").write_text("""component: Step
summary: A step.
ports: {y: {signal: out, unit: 1}}
parameters: {t: {unit: s, default: 1 s, doc: instant}}
variables: {clock_1: {unit: 1, doc: the same}}
equations: |
  y = if_else(time < t, 0, 1)
  clock_1 = 2*y
""")
    said = refused("model: m\ncomponents: {s: {is: Step}}\nnodes: {y: [s.y]}\n", tmp_path)
    assert "'s.clock_1' would mean two things" in said


def test_no_unknown_takes_the_name_of_another(monkeypatch):
    """The one place where unknowns are made refuses what the checks before it might miss."""
    monkeypatch.setattr("heavebond.equations.flatten.claim_names", lambda expanded, network, problems: claims(problems))

    class Everything(dict):
        def __contains__(self, key):
            return True

    def claims(problems):
        from heavebond.equations.ownership import Names
        return Names(problems, Everything())

    with pytest.raises(AssertionError, match=r"'rope.v' is the name of two unknowns"):
        flattening.flatten(loads(ROPE.replace("NODE", "rope")))


@pytest.mark.parametrize("name", ["cmc_ahc", "excavator_boom", "hydrostatic_drive", "examples/receiver_with_heat"])
def test_every_name_of_a_flat_model_has_one_owner(name):
    flat = flattening.flatten(hb.load(name))
    assert len({u.name for u in flat.unknowns}) == len(flat.unknowns)
    assert not set(flat.names) & set(flat.constants)
    symbols = [s.element_hash() for level in flat.levels for s in level]
    assert len(set(symbols)) == len(symbols)


HINTS = """model: m
components:
  spring: {is: Spring, c: 1 kN/m}
  load: {is: Mass, m: 1 kg}
nodes: {a: [spring.a], load: [spring.b, load.a]}
show: {load.x: {unit: mm}}
"""


@pytest.mark.parametrize(("before", "after", "hint"), [
    ("{load.x: {unit: mm}}", "{opening: load.x}", "`opening: {is: load.x, unit: ...}`"),
    ("{unit: mm}", "{is: load.x}", "1 for a plain number"),
    ("unit: mm", "unit: Ohm", "'ohm'"),
    ("unit: mm", "unit: mOhm", "'mohm'"),
    ("is: Mass", "si: Mass", "{is: Mass, ...}"),
    ("is: Mass", "is Mass", "Write `is: Mass`."),
    ("c: 1 kN/m", "c 1 kN/m", "Write `c: 1 kN/m`."),
    ("load: {is", "load {is", "a `:` is missing behind 'load'"),
    ("model: m", "model m", "text:1: a `:` is missing behind 'model'"),
    ("show: {load.x: {unit: mm}}", "simulate {until: 1 s}", "write `simulate: {...}`"),
])
def test_a_hint_leads_to_what_was_meant(before, after, hint):
    assert hint in refused(HINTS.replace(before, after, 1))
