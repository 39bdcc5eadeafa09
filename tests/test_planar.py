"""Machines in a plane: ports of several pairs in checks, energy, power and messages."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from doc_pages import blocks
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import ellipk

import heavebond as hb
from heavebond.diagnosis.candidates.catalogue import single_candidates
from heavebond.energy_audit.audit import energy as audit
from heavebond.equations.places import nodes_of
from heavebond.language.library import library

Array = NDArray[np.float64]
G = 9.81
PAGE = Path(__file__).parent.parent / "docs" / "mechanisms.md"
DIAGRAMS = {block.mark[1]: block.text for block in blocks(PAGE) if block.mark[0] == "file"}
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


def test_friction_and_play_of_a_pin_may_be_what_is_missing(tmp_path: Path) -> None:
    """As candidates of the diagnosis; localisation says what it needs in a diagram whose nodes are all planar."""
    (tmp_path / "pendulum.yaml").write_text(PENDULUM)
    time = np.linspace(0, 3, 31)
    np.savetxt(tmp_path / "run.csv", np.c_[time, 5*np.sin(time)], delimiter=",", header="t,y", comments="")
    (tmp_path / "experiment.yaml").write_text("""
experiment: swinging
model: pendulum.yaml
records: {run: {file: run.csv, use: fit}}
time: {column: t, unit: s}
outputs: {height: {is: end.y, column: y, unit: m}}
free: {bob.J: 0.1 kg*m**2 +- 20 %}
""")
    experiment = hb.load_experiment(tmp_path / "experiment.yaml")
    labels = {candidate.label for candidate in single_candidates(experiment)}
    assert {"PinFriction between ground and top", "RevoluteJointWithPlay in place of pin"} <= labels
    with pytest.raises(hb.UsageError, match="Join a PlanarShaft"):
        hb.localize(experiment)


# -- the page on mechanisms ----------------------------------------------------------------------------------------------
def page(name: str) -> hb.Model:
    return hb.loads(DIAGRAMS[f"{name}.yaml"])


def test_a_slider_crank_by_the_law_of_its_stroke() -> None:
    found = hb.simulate(page("slider_crank"))
    phi, r, rod = found["shaft.phi"], 0.1, 0.4
    beta = np.sqrt(rod**2 - (r*np.sin(phi))**2)
    assert np.ptp(phi) > 4*np.pi
    assert np.abs(found["slide.x"] - (r*np.cos(phi) + beta)).max() < 1e-10
    speed = -r*np.sin(phi)*(1 + r*np.cos(phi)/beta)*found["shaft.w"]
    assert found["slide.v_x"] == pytest.approx(speed, abs=1e-9)
    audit(page("slider_crank")).raise_if_open(1e-6)


def test_a_four_bar_linkage_by_the_equation_of_freudenstein() -> None:
    """K_1 cos(rocker) - K_2 cos(crank) + K_3 = cos(crank - rocker); F. Freudenstein, 1954."""
    found = hb.simulate(page("four_bar"))
    crank, rocker = found["crank.phi"], found["foot.phi"]
    a, b, c, d = 0.3, 1.0, 0.8, 0.9
    assert crank == pytest.approx(5*found.time, abs=1e-9)
    left = d/a*np.cos(rocker) - d/c*np.cos(crank) + (a**2 - b**2 + c**2 + d**2)/(2*a*c)
    assert left == pytest.approx(np.cos(crank - rocker), abs=1e-9)
    audit(page("four_bar")).raise_if_open(1e-6)


def test_a_double_pendulum_by_its_lagrangian() -> None:
    """Two bars whose centres of mass are in the middle; q'' from M(q) q'' = -dV/dq - C(q, q') by hand."""
    model = hb.loads("""
model: double_pendulum
components:
  ground: {is: PlanarFixed}
  pin_1:  {is: RevoluteJoint}
  upper:  {is: PlanarBody, m: 2 kg, J: 0.2 kg*m**2, l_g: 0.5 m}
  arm:    {is: RigidLink, l: 1 m}
  pin_2:  {is: RevoluteJoint}
  lower:  {is: PlanarBody, m: 1 kg, J: 0.05 kg*m**2, l_g: 0.35 m}
nodes:
  ground: [ground.a, pin_1.a]
  one:    [pin_1.b, upper.a, arm.a]
  elbow:  [arm.b, pin_2.a]
  two:    [pin_2.b, lower.a]
initial: {one.phi: 0.3 rad, one.w: 0 rad/s, two.phi: 1.2 rad, two.w: 0 rad/s}
simulate: {until: 3 s, every: 5 ms}
""")
    found = hb.simulate(model, rtol=1e-11, atol=1e-13)

    def rates(t: float, y: Array) -> tuple[float, ...]:
        p, q, w, v = y
        couple = 1*1*0.35
        matrix = [[0.2 + 2*0.5**2 + 1*1**2, couple*np.cos(p - q)], [couple*np.cos(p - q), 0.05 + 1*0.35**2]]
        right = [-couple*np.sin(p - q)*v**2 - G*(2*0.5 + 1*1)*np.cos(p), couple*np.sin(p - q)*w**2 - G*1*0.35*np.cos(q)]
        return (w, v, *np.linalg.solve(matrix, right))

    exact = solve_ivp(rates, (0, 3), (0.3, 1.2, 0, 0), "DOP853", found.time, rtol=1e-12, atol=1e-12)
    assert np.ptp(exact.y[1]) > np.pi
    assert found["one.phi"] == pytest.approx(exact.y[0], abs=1e-6)
    assert found["two.phi"] == pytest.approx(exact.y[1], abs=1e-6)


def test_a_hundred_swings_keep_lengths_and_energy() -> None:
    """Lengths to 1e-10 m and energy to 1e-8 m g l at rtol 1e-12; the period by the complete elliptic integral."""
    long = PENDULUM.replace("l: 5 m", "l: 1 m").replace("J: 0.1 kg*m**2", "J: 0").replace("3 s}", "237 s, every: 50 ms}")
    found = hb.simulate(hb.loads(long), rtol=1e-12, atol=1e-14)
    assert np.abs(np.hypot(found["end.x"], found["end.y"]) - 1).max() < 1e-10
    energy = (found["end.v_x"]**2 + found["end.v_y"]**2)/2 + G*found["end.y"]
    assert np.abs(energy).max() < 1e-8*G
    crossings = np.flatnonzero((found["end.x"][:-1] > 0) & (found["end.x"][1:] <= 0))
    assert len(crossings) == 100
    period = 4*ellipk(0.5)/np.sqrt(G)
    at = [np.interp(0, found["end.x"][[k + 1, k]], found.time[[k + 1, k]]) for k in crossings]
    assert np.diff(at).mean() == pytest.approx(period, rel=1e-5)  # lines between the output points


@pytest.mark.long
def test_a_hundred_turns_of_a_closed_loop_keep_lengths_and_energy() -> None:
    """The slider-crank of the page in a level plane, without its damper: 1e-8 of its energy at rtol 1e-12."""
    text = DIAGRAMS["slider_crank.yaml"].replace("  load:     {is: Damper, d: 20 N*s/m}\n", "").replace(", load.a]", "]")
    text = text.replace(", load.b]", "]").replace("is: PlanarBody,", "is: PlanarBody, g: 0,")
    found = hb.simulate(hb.loads(text), "34 s", every="10 ms", rtol=1e-12, atol=1e-14)
    assert np.ptp(found["shaft.phi"]) > 200*np.pi
    length = np.hypot(found["slide.x"] - found["throw.x"], found["slide.y"] - found["throw.y"])
    assert np.abs(length - 0.4).max() < 1e-10
    rod = found["rod_mass.u_x"]**2 + found["rod_mass.u_y"]**2 + 0.02*found["eye.w"]**2
    energy = 0.4*found["shaft.w"]**2 + rod + 2*found["slide.v_x"]**2
    assert np.abs(energy/energy[0] - 1).max() < 1e-8


@pytest.mark.long
def test_a_parallelogram_ends_in_the_line_of_its_pivots() -> None:
    """Its bar moves in translation, as a pendulum of 0.3 m, from 60 degrees to the level."""
    fallen = solve_ivp(lambda t, y: (y[1], -G/0.3*np.cos(y[0])), (0, 1), (np.pi/3, 0), rtol=1e-10, atol=1e-10,
                       dense_output=True)
    level = brentq(lambda t: fallen.sol(t)[0], 0, 0.5)
    with pytest.raises(hb.SimulationError) as caught:
        hb.simulate(page("parallelogram"))
    text = str(caught.value)
    assert "The links of a mechanism come to lie in one line there" in text
    stopped = float(text.split("t = ")[1].split()[0])
    assert stopped == pytest.approx(level, abs=2e-3)
