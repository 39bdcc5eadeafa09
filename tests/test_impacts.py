"""Impacts between bodies: momentum and energy by closed forms, whatever the bodies are rigidly connected with."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import heavebond as hb
from heavebond.core.errors import ModelError
from heavebond.exchange.portable import portable
from heavebond.numerics.impulses import yielding

# p + q = 2 r; T = 1/2 ((2r - q)^2 + q^2 + r^2), so that an impulse at q moves r by 2/5 of what it moves q
SEESAW = """\
model: seesaw
components:
  left:  {is: Mass, m: 1 kg}
  right: {is: Mass, m: 1 kg}
  mid:   {is: Mass, m: 1 kg}
  lever: {is: Lever, l_a: 1 m, l_b: 1 m}
  floor: {is: Fixed}
  stop:  {is: RigidStop, e: 1}
nodes: {p: [left.a, lever.a], q: [right.a, lever.b, stop.b], r: [mid.a, lever.p], floor: [floor.a, stop.a]}
initial: {q.x: 1 m, r.x: 1 m, q.v: -1 m/s, r.v: -1 m/s}
simulate: {until: 1.5 s}
"""

CHAIN = """\
model: chain
parameters: {e: 0.5}
components:
  one:   {is: Mass, m: 1 kg}
  other: {is: Mass, m: 3 kg}
  third: {is: Mass, m: 2 kg}
  first: {is: RigidStop, e: =e}
  last:  {is: RigidStop, e: 1}
nodes: {p: [one.a, first.a], q: [other.a, first.b, last.a], r: [third.a, last.b]}
initial: {p.v: 1 m/s, q.x: 0.5 m, r.x: 1 m}
simulate: {until: 4 s}
"""

# a body that rests on the floor, and that dry friction holds: struck by a hammer from the left
STRUCK = """\
model: struck
components:
  hammer: {is: Mass, m: 2 kg}
  face:   {is: RigidStop, e: 0}
  pile:   {is: Mass, m: 6 kg}
  soil:   {is: DryFriction, F_c: 300 N, F_s: 400 N}
  ground: {is: Fixed}
nodes: {hammer: [hammer.a, face.a], pile: [pile.a, face.b, soil.b], ground: [ground.a, soil.a]}
initial: {hammer.v: 4 m/s, pile.x: 1 m}
simulate: {until: 0.5 s}
"""

# weights on both arms of a lever on a fixed pivot: the heavier one rests on the floor until the other arm is struck
KICKED = """\
model: kicked
components:
  pivot: {is: Fixed}
  floor: {is: Fixed}
  lever: {is: Lever, l_a: 1 m, l_b: 1 m}
  load:  {is: Mass, m: 2 kg}
  down:  {is: Weight, m: 2 kg}
  rest:  {is: RigidStop, e: 0}
  other: {is: Mass, m: 1 kg}
  ram:   {is: Mass, m: 3 kg}
  face:  {is: RigidStop, e: 0}
nodes:
  pivot: [pivot.a, lever.p]
  floor: [floor.a, rest.a]
  load:  [load.a, down.a, rest.b, lever.b]
  other: [other.a, lever.a, face.a]
  ram:   [ram.a, face.b]
initial: {load.x: 0 m, other.x: 0 m, ram.x: 0.3 m, ram.v: -3 m/s, load.v: 0 m/s}
simulate: {until: 0.11 s}
"""


def run(text: str, **options: object) -> hb.Result:
    return hb.simulate(hb.loads(text), **options)


def test_an_impact_reaches_all_that_is_rigidly_connected() -> None:
    """q turns from -1 to 1 m/s, r moves by 2/5 of that: energy 1.5 J stays (it became 5.5 J where q alone was turned)."""
    found = run(SEESAW)
    ends = [float(found[name][-1]) for name in ("p.v", "q.v", "r.v")]
    assert ends == pytest.approx([-1.4, 1.0, -0.2], rel=1e-8)
    assert sum(v**2 for v in ends)/2 == pytest.approx(1.5, rel=1e-8)


def test_two_bodies_that_move_share_the_momentum() -> None:
    """m1 v1 + m2 v2 is kept and v2 - v1 = e (1 m/s): v = 1 - (1 + e) 3/4 and (1 + e)/4; then 3 kg strike 2 kg, e = 1."""
    found = run(CHAIN, sensitivities=["e"])
    e = 0.5
    second = (1 + e)/4
    ends = [1 - (1 + e)*3/4, second*(3 - 2)/5, second*2*3/5]
    assert [float(found[f"{n}.v"][-1]) for n in "pqr"] == pytest.approx(ends, rel=1e-7)
    momentum = found["p.v"] + 3*found["q.v"] + 2*found["r.v"]
    assert np.ptp(momentum) < 1e-10
    moved = [float(found.sensitivity(f"{n}.v", "e")[-1]) for n in "pqr"]
    assert moved == pytest.approx([-3/4, 1/20, 6/20], rel=1e-6)


def test_the_position_after_an_impact_follows_the_coefficient_of_restitution() -> None:
    """The second impact comes earlier with a larger e: derivatives against differences of runs."""
    found = run(CHAIN, sensitivities=["e"], rtol=1e-10)
    above, below = (run(CHAIN, parameters={"e": e}, rtol=1e-10) for e in (0.5001, 0.4999))
    for name in ("p.x", "q.x", "r.x"):
        difference = (above[name][-1] - below[name][-1])/2e-4
        assert found.sensitivity(name, "e")[-1] == pytest.approx(difference, rel=1e-6, abs=1e-7)


@pytest.mark.long
def test_friction_that_sticks_gives_way_to_an_impact() -> None:
    """A finite force holds no impulse: 2 kg at 4 m/s become 8 kg at 1 m/s, which 300 N stop after m v**2/(2 F)."""
    found = run(STRUCK)
    assert max(found["pile.v"]) == pytest.approx(1.0, rel=1e-3)  # the largest output point is a moment after the impact
    assert found["pile.x"][-1] - 1 == pytest.approx(8*1**2/(2*300), rel=1e-6)
    assert "soil.forward" in [name for _, name in found.events]


def test_a_body_at_rest_is_not_held_down_by_its_contact() -> None:
    """The ram drives its arm down and so lifts the load off the floor, which pushes only: 3 kg (3 m/s) on 1 + 2 + 3 kg."""
    found = run(KICKED)
    struck = {name: time for time, name in found.events}
    v = 3*3/(1 + 2 + 3)
    assert struck["rest.lift"] == struck["face.impact"] == pytest.approx(0.1)
    assert found["load.v"][-1] == pytest.approx(v - 2*9.80665/6*0.01, rel=1e-3)


def test_a_shaft_strikes_through_a_gear() -> None:
    """J = 4 behind a gear of 2 is 1 at the stop, which meets 3: e = 1 sends it back with (1 - 3)/(1 + 3) of its speed."""
    found = run("""\
model: geared
components:
  fast: {is: Inertia, J: 1 kg*m**2}
  gear: {is: Gear, i: 0.5}
  dog:  {is: RotationalRigidStop, e: 1}
  hub:  {is: Inertia, J: 3 kg*m**2}
nodes: {fast: [fast.a, gear.a], slow: [gear.b, dog.a], hub: [hub.a, dog.b]}
initial: {slow.w: 1 rad/s, hub.phi: 0.5 rad}
simulate: {until: 1 s}
""")
    ratio = float(found["fast.w"][0]/found["slow.w"][0])
    inertia = 1*ratio**2
    assert found["slow.w"][-1] == pytest.approx((inertia - 3)/(inertia + 3), rel=1e-8)


BUMPER = """\
component: Bumper
summary: A body that rebounds.
ports: {a: translational, b: translational}
variables:
  v: {unit: m/s, doc: separation speed}
  J: {unit: N, held: 0, doc: force of an impact}
equations: |
  v   = b.v - a.v   # separation speed
  b.f = -J          # impact
  a.f = J           # reaction
when: {hit: {condition: b.x < a.x, impulse: J, then: {v: -v}}}
power: controlled, impacts
"""


def refused(folder: Path, bumper: str, components: str, nodes: str) -> list[str]:
    (folder / "bumper.yaml").write_text(bumper, encoding="utf-8")
    path = folder / "none.yaml"
    path.write_text(f"model: none\ncomponents: {{{components}}}\nnodes: {{{nodes}}}\n", encoding="utf-8")
    with pytest.raises(ModelError) as caught:
        hb.assemble(hb.load(path))
    return [p.code for p in caught.value.problems]


@pytest.mark.parametrize(("part", "code"), [
    ("PositionSource, u: \"=0.1 m*sin(time/(1 s))\"", "impulse-without-effect"),
    ("Damper, d: 1 kN*s/m", "impulse-on-massless")])
def test_what_has_no_mass_to_strike_is_refused(part: str, code: str, tmp_path: Path) -> None:
    ground = "ground.a, bump.a" + ", part.b" * part.startswith("Damper")
    assert refused(tmp_path, BUMPER, f"ground: {{is: Fixed}}, part: {{is: {part}}}, bump: {{is: Bumper}}",
                   f"g: [{ground}], d: [part.a, bump.b]") == [code]


@pytest.mark.parametrize(("written", "instead"), [
    ("impulse: J", "impulse: v"), ("v: -v}", "v: -v, J: 2*J}"), ("b.f = -J ", "b.f = 0  "),
    ("then: {v: -v}", "then: {J: 0}"),
    ("then: {v: -v}", "then: {v: -v, b.v: 0}"), ("held: 0", "held: 1 N")])
def test_an_impulse_that_is_not_one_is_refused(written: str, instead: str, tmp_path: Path) -> None:
    bumper = BUMPER.replace(written, instead)
    if instead == "b.f = 0  ":
        bumper = bumper.replace("a.f = J ", "a.f = 0 ")
    codes = refused(tmp_path, bumper, "ground: {is: Fixed}, mass: {is: Mass, m: 1 kg}, bump: {is: Bumper}",
                    "g: [ground.a, bump.a], d: [mass.a, bump.b]")
    assert "impulse-form" in codes


def test_the_force_of_an_impact_has_no_value_at_the_start() -> None:
    with pytest.raises(ModelError, match="held-initial"):
        hb.assemble(hb.loads(SEESAW.replace("r.v: -1 m/s", "r.v: -1 m/s, stop.N_i: 5 N")))


@pytest.mark.long
def test_an_fmu_has_impacts_alone_and_none_at_which_something_yields() -> None:
    assert yielding(hb.assemble(hb.loads(SEESAW)).reduced) == []
    assert yielding(hb.assemble(hb.loads(CHAIN)).reduced) == ["last.lift", "first.lift"]
    with pytest.raises(ModelError, match="export-impact"):
        portable(hb.loads(STRUCK), events=True)


OWN_STOP = """\
component: OwnStop
summary: Stop that turns the speed of a body.
ports: {a: {domain: translational, doc: floor}, b: {domain: translational, doc: body}}
variables: {s: {unit: m, doc: distance}}
equations: |
  s = b.x - a.x
  a.f = 0
  b.f = 0
when:
  hit: {condition: s < 0 and b.v < 0, then: {b.v: -b.v}}
"""

ONE_STATE = """\
model: lever
components:
  left:  {is: Mass, m: 1 kg}
  right: {is: Mass, m: 1 kg}
  lever: {is: Lever, l_a: 1 m, l_b: 1 m}
  floor: {is: Fixed}
  stop:  {is: OwnStop}
nodes: {p: [left.a, lever.a], q: [right.a, lever.b, stop.b], floor: [floor.a, lever.p, stop.a]}
initial: {q.x: 1 m, q.v: -1 m/s}
simulate: {until: 1.5 s}
"""


def test_a_speed_that_is_set_without_an_impulse_on_what_is_coupled_is_refused(tmp_path: Path) -> None:
    (tmp_path / "own_stop.yaml").write_text(OWN_STOP)
    (tmp_path / "seesaw.yaml").write_text(SEESAW.replace("{is: RigidStop, e: 1}", "{is: OwnStop}"))
    with pytest.raises(ModelError, match=r"'stop.hit' sets q.v and leaves r.v, which a force at its ports changes too"):
        hb.assemble(tmp_path / "seesaw.yaml")
    # one state: the body on the other arm of the lever has its speed turned with it
    (tmp_path / "lever.yaml").write_text(ONE_STATE)
    result = hb.simulate(tmp_path / "lever.yaml")
    assert result["q.v"].max() == pytest.approx(1.0, abs=1e-6) and result["p.v"].min() == pytest.approx(-1.0, abs=1e-6)


def test_a_body_that_begins_inside_a_rigid_stop_is_reported() -> None:
    """Where a body rests 1 rad inside the stop, nothing moves, and the run is not clean."""
    with pytest.warns(hb.RunWarning, match=r"s.gap reaches -1 rad.*inside the stop"):
        run = hb.simulate(hb.loads("""
model: inside
components:
  m: {is: TorqueSource, u: 2 N*m}
  i: {is: Inertia, J: 0.05 kg*m**2}
  s: {is: RotationalRigidStop, e: 0.5, phi0: 1 rad}
  w: {is: FixedShaft}
nodes: {x: [m.a, i.a, s.a], w: [s.b, w.a]}
initial: {x.w: 0 rad/s, x.phi: 0 rad}
simulate: {until: 0.5 s, every: 0.1 s}
"""))
    assert run.verdict.status == "outside"
