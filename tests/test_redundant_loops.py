"""Loops in space that constrain motions more than once, against planar mechanisms and Bennett's linkage."""

import warnings

import numpy as np
import pytest

import heavebond as hb
from heavebond import ModelError
from heavebond.numerics.initialise import start

HINGE = "{is: SpatialRevoluteJoint, n: [0, -1, 0]}"
FOUR_BAR = """model: four_bar
components:
  left:    {is: SpatialFixed}
  right:   {is: SpatialFixed, x_0: 1 m}
  pin_1:   HINGE
  pin_2:   HINGE
  pin_3:   HINGE
  pin_4:   HINGE
  crank:   {is: SpatialLink, l_x: 0.3 m}
  coupler: {is: SpatialLink, l_x: 1 m}
  rocker:  {is: SpatialLink, l_x: -0.5 m}
  mass:    {is: SpatialBody, m: 2 kg, J_x: 0.05 kg*m**2, J_y: 0.1 kg*m**2, J_z: 0.1 kg*m**2}
nodes:
  left:    [left.a, pin_1.a]
  crank:   [pin_1.b, crank.a]
  one:     [crank.b, pin_2.a]
  coupler: [pin_2.b, coupler.a, mass.a]
  two:     [coupler.b, pin_3.a]
  rocker:  [pin_3.b, rocker.a]
  foot:    [rocker.b, pin_4.b]
  right:   [right.a, pin_4.a]
  d_1:     [pin_1.d]
  d_2:     [pin_2.d]
  d_3:     [pin_3.d]
  d_4:     [pin_4.d]
initial: {pin_1.phi: 60 deg, pin_1.w: 1 rad/s, pin_4.phi: ~ 80 deg, pin_3.phi: ~ 80 deg}
show: {x: {is: two.x, unit: m}}
simulate: {until: 0.1 s, every: 10 ms}
""".replace("HINGE", HINGE)
PLANAR = """model: four_bar
components:
  left:    {is: PlanarFixed}
  right:   {is: PlanarFixed, x_0: 1 m}
  pin_1:   {is: RevoluteJoint}
  pin_2:   {is: RevoluteJoint}
  pin_3:   {is: RevoluteJoint}
  pin_4:   {is: RevoluteJoint}
  crank:   {is: RigidLink, l: 0.3 m}
  coupler: {is: RigidLink, l: 1 m}
  rocker:  {is: RigidLink, l: -0.5 m}
  mass:    {is: PlanarBody, m: 2 kg, J: 0.1 kg*m**2}
nodes:
  left:    [left.a, pin_1.a]
  crank:   [pin_1.b, crank.a]
  one:     [crank.b, pin_2.a]
  coupler: [pin_2.b, coupler.a, mass.a]
  two:     [coupler.b, pin_3.a]
  rocker:  [pin_3.b, rocker.a]
  foot:    [rocker.b, pin_4.b]
  right:   [right.a, pin_4.a]
initial: {crank.phi: 60 deg, crank.w: 1 rad/s, foot.phi: ~ 75 deg, coupler.phi: ~ 13 deg}
simulate: {until: 0.1 s, every: 10 ms}
"""


@pytest.mark.long
def test_a_four_bar_linkage_moves_like_the_planar_one() -> None:
    assembly = hb.assemble(hb.loads(FOUR_BAR))
    loop, = assembly.flat.redundancies
    assert loop.text == "the loop pin_1, pin_2, pin_3, pin_4 constrains 3 motions more than once; the reactions M_x, M_z, " \
        "F_y at coupler.b (in its axes) are taken as zero"
    run, plane = hb.simulate(assembly, rtol=1e-11, sensitivities=["coupler.l_x"]), hb.simulate(
        hb.loads(PLANAR), rtol=1e-11, sensitivities=["coupler.l"])
    assert run.verdict.status == "clean"
    assert run["two.x"] == pytest.approx(plane["two.x"], abs=1e-8)
    assert run["two.z"] == pytest.approx(plane["two.y"], abs=1e-8)
    assert run["pin_4.b.F_z"] == pytest.approx(plane["pin_4.b.F_y"], abs=1e-6)
    assert run.sensitivity("two.x", "coupler.l_x") == pytest.approx(plane.sensitivity("two.x", "coupler.l"), abs=1e-6)
    # a length along the axes opens the loop
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        verdict = hb.simulate(assembly, 0.01, parameters={"coupler.l_y": 1e-3}).verdict
    assert verdict.failed and verdict.findings[0].kind == "loop"
    assert "the loop pin_1, pin_2, pin_3, pin_4 is open at coupler from 0 s on" in str(verdict)


@pytest.mark.long
def test_linear_analysis_and_energy_of_a_redundant_loop() -> None:
    rest = "initial: {start: steady, pin_1.phi: ~ -80 deg, pin_4.phi: ~ -100 deg, pin_3.phi: ~ 80 deg}"
    plane = "initial: {start: steady, crank.phi: ~ -80 deg, foot.phi: ~ -100 deg, coupler.phi: ~ 0 deg}"
    modes, expected = (hb.modes(hb.loads("\n".join(line if not line.startswith("initial:") else initial
                                                   for line in text.splitlines())))
                       for text, initial in ((FOUR_BAR, rest), (PLANAR, plane)))
    assert modes.frequencies == pytest.approx(expected.frequencies, rel=1e-6)
    assert hb.energy(hb.loads(FOUR_BAR)).closes()


def test_a_bennett_linkage_of_hinges_alone() -> None:
    """tan(theta_1/2) tan(theta_2/2) = sin((beta + alpha)/2)/sin((beta - alpha)/2) (G. T. Bennett, Engineering 76 (1903)
    777), and opposite joints turn alike."""
    alpha, beta, a = 0.6, 1.1, 0.5
    b, K = a*np.sin(beta)/np.sin(alpha), np.sin((beta + alpha)/2)/np.sin((beta - alpha)/2)
    hinge = "{is: SpatialRevoluteJoint, n: [0, 0, 1]}"
    text = f"""model: bennett
components:
  ground: {{is: SpatialFixed}}
  drive:  {{is: AngleSource, u: "=1 rad + 2 rad/s*time"}}
  one:    {hinge}
  two:    {hinge}
  three:  {hinge}
  four:   {hinge}
  link_1: {{is: SpatialLink, l_x: {a} m, roll: {alpha} rad}}
  link_2: {{is: SpatialLink, l_x: {b} m, roll: {beta} rad}}
  link_3: {{is: SpatialLink, l_x: {a} m, roll: {alpha} rad}}
  link_4: {{is: SpatialLink, l_x: {b} m, roll: {beta} rad}}
  mass:   {{is: SpatialBody, m: 2 kg, J_x: 0.1 kg*m**2, J_y: 0.1 kg*m**2, J_z: 0.1 kg*m**2}}
nodes:
  ground: [ground.a, one.a, link_4.b]
  drive:  [drive.a, one.d]
  one:    [one.b, link_1.a]
  a:      [link_1.b, two.a]
  two:    [two.b, link_2.a, mass.a]
  b:      [link_2.b, three.a]
  three:  [three.b, link_3.a]
  c:      [link_3.b, four.a]
  four:   [four.b, link_4.a]
  d_2:    [two.d]
  d_3:    [three.d]
  d_4:    [four.d]
initial: {{two.phi: ~ 3 rad, three.phi: ~ -1 rad}}
show: {{second: {{is: two.phi, unit: rad}}, third: {{is: three.phi, unit: rad}}}}
simulate: {{until: 1 s, every: 20 ms}}
"""
    run = hb.simulate(hb.loads(text))
    loop, = run.assembly.flat.redundancies
    assert "one, two, three, four constrains 3 motions" in loop.text
    assert run.verdict.status == "clean"
    theta = 1 + 2*run.time
    assert run["second"] == pytest.approx(2*np.arctan(K/np.tan(theta/2)), abs=1e-8)
    assert run["third"] == pytest.approx(-theta, abs=1e-8)
    assert np.abs(run.evaluate(loop.residuals)).max() < 1e-9


@pytest.mark.long
def test_three_parallel_cranks() -> None:
    """The third crank adds a redundancy that the loops have only together."""
    text = FOUR_BAR.replace("rocker:  {is: SpatialLink, l_x: -0.5 m}", "rocker:  {is: SpatialLink, l_x: -0.3 m}\n"
                            f"  middle:  {{is: SpatialFixed, x_0: 0.4 m}}\n  pin_5:   {HINGE}\n  pin_6:   {HINGE}\n"
                            "  third:   {is: SpatialLink, l_x: 0.3 m}\n  eye:     {is: SpatialLink, l_x: 0.4 m}")
    text = text.replace("mass.a]", "mass.a, eye.a]").replace("  d_1:", "  middle:  [middle.a, pin_5.a]\n  third:   "
                        "[pin_5.b, third.a]\n  three:   [third.b, pin_6.a]\n  eye:     [eye.b, pin_6.b]\n"
                        "  d_5:     [pin_5.d]\n  d_6:     [pin_6.d]\n  d_1:")
    assembly = hb.assemble(hb.loads(text.replace("~ 80 deg", "~ 50 deg", 1)))
    assert len(assembly.reduced.states) == 2
    assert sum(len(loop.reactions) for loop in assembly.flat.redundancies) == 7


def test_a_joint_with_both_ports_on_one_node_is_no_redundant_loop() -> None:
    text = FOUR_BAR.replace("[pin_1.b, crank.a]", "[crank.a]").replace("[left.a, pin_1.a]", "[left.a, pin_1.a, pin_1.b]")
    with pytest.raises(ModelError) as caught:
        hb.assemble(hb.loads(text))
    assert "[overdetermined]" in str(caught.value) and "pin_1" in str(caught.value)


@pytest.mark.parametrize(("old", "new", "said"), [
    ("pin_3:   " + HINGE, "pin_3:   {is: SpatialRevoluteJoint, n: [0, -0.99995, 0.0099998]}",
     "the axis of pin_3 deviates by 0.573 deg"),
    ("pin_1:   " + HINGE, "pin_1:   {is: SpatialRevoluteJoint, n: [0, -0.99995, 0.0099998]}",
     "the axis of pin_1 deviates by 0.573 deg"),
    ("l_x: 1 m}", "l_x: 1 m, l_y: 5 mm}", "Along the axes, its ends are 5 mm apart"),
    ("l_x: 1 m}", "l_x: 0.1 m}", "the lengths of its links do not allow a closed loop")])
def test_a_loop_that_does_not_close_is_named(old: str, new: str, said: str) -> None:
    with pytest.raises(ModelError) as caught:
        hb.assemble(hb.loads(FOUR_BAR.replace(old, new)))
    message = str(caught.value)
    assert "[loop-open]" in message and "pin_1, pin_2, pin_3, pin_4" in message and said in message


@pytest.mark.long
def test_the_start_follows_from_the_initial_value_of_any_joint() -> None:
    """Without guesses, with a guess that is far off, and with too many values."""
    def first(initial: str) -> dict[str, float]:
        line = next(line for line in FOUR_BAR.splitlines() if line.startswith("initial:"))
        assembly = hb.assemble(hb.loads(FOUR_BAR.replace(line, f"initial: {{{initial}}}")))
        begun = start(assembly)
        u = np.zeros(0)
        values = np.array(assembly.values(begun.t, begun.x, begun.z, begun.p, u, 1.0)).ravel()
        return {f"pin_{k}": float(np.degrees(values[assembly.flat.names[f"pin_{k}.phi"]])) for k in (1, 3, 4)}

    expected = first("pin_1.phi: 60 deg")
    assert first(f"pin_4.phi: {expected['pin_4']!r} deg, pin_1.phi: ~ 50 deg") == pytest.approx(expected, abs=1e-6)
    assert first("pin_1.phi: 60 deg, pin_3.phi: ~ 20 deg")["pin_1"] == pytest.approx(60)
    with pytest.raises(hb.StartError) as caught:
        first("pin_1.phi: 60 deg, pin_4.phi: 30 deg")
    assert "pin_1.phi, pin_4.phi" in str(caught.value)
