"""Mechanics in space beside closed forms and beside the programs Pinocchio and MuJoCo."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from collected import partly
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, fsolve
from scipy.spatial.transform import Rotation
from scipy.special import ellipj

import heavebond as hb
from benchmarks.random_trees import (
    Pinocchio,
    TreeBody,
    aligned_tree,
    closed_diagram,
    closed_mechanism,
    diagram,
    mujoco_accelerations,
    random_tree,
)
from heavebond.core.errors import HeavebondError, ModelError
from heavebond.language.library import library
from heavebond.language.power_law import wrong_rates
from heavebond.language.power_terms import power_problems
from heavebond.linear.operating_point import OperatingPoints

G = 9.81
TREES = range(20)


@cache
def _moving_tree(seed: int) -> tuple[list[TreeBody], hb.Result]:
    """A random tree and its motion in a second."""
    bodies = random_tree(2 + seed % 7, seed)
    return bodies, hb.simulate(hb.loads(diagram(bodies)), rtol=1e-10)


@pytest.mark.parametrize("seed", partly(TREES, 5))
def test_accelerations_of_a_random_tree_by_pinocchio(seed: int) -> None:
    """Rounding of some thousand operations: 1e-9 of the largest acceleration."""
    pytest.importorskip("pinocchio", reason="Pinocchio (pin) is not installed")
    bodies, run = _moving_tree(seed)
    expected = Pinocchio(bodies).accelerations(np.array([b.q for b in bodies]), np.array([b.v for b in bodies]))
    found = np.array([run[f"a_{k}"][0] for k in range(len(bodies))])
    assert found == pytest.approx(expected, abs=1e-9*np.abs(expected).max())


@pytest.mark.parametrize(("n", "seed"), [pytest.param(30, 1, marks=pytest.mark.long),
                                         pytest.param(50, 3, marks=pytest.mark.slow)])
def test_accelerations_of_a_large_tree_by_pinocchio(n: int, seed: int) -> None:
    """Explicit, also where two unknowns have a common divisor only; rounding adds up over the bodies of a chain."""
    pytest.importorskip("pinocchio", reason="Pinocchio (pin) is not installed")
    bodies = random_tree(n, seed)
    run = hb.simulate(hb.loads(diagram(bodies, 1e-5)))
    assert run.assembly.reduced.z.numel() == 0
    expected = Pinocchio(bodies).accelerations(np.array([b.q for b in bodies]), np.array([b.v for b in bodies]))
    found = np.array([run[f"a_{k}"][0] for k in range(n)])
    assert found == pytest.approx(expected, abs=1e-9*np.abs(expected).max())


@pytest.mark.parametrize("seed", partly(TREES, 7))
def test_accelerations_of_an_aligned_chain_by_pinocchio(seed: int) -> None:
    """Where axes are parallel a divisor of the elimination that is not an inertia may vanish."""
    pytest.importorskip("pinocchio", reason="Pinocchio (pin) is not installed")
    bodies = aligned_tree(3 + seed % 6, seed)
    run = hb.simulate(hb.loads(diagram(bodies, 1e-4)))
    expected = Pinocchio(bodies).accelerations(np.zeros(len(bodies)), np.zeros(len(bodies)))
    found = np.array([run[f"a_{k}"][0] for k in range(len(bodies))])
    assert found == pytest.approx(expected, abs=1e-9*np.abs(expected).max())


@pytest.mark.parametrize("seed", partly(TREES, 5))
def test_accelerations_of_a_random_tree_by_mujoco(seed: int) -> None:
    pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    bodies, run = _moving_tree(seed)
    expected = mujoco_accelerations(bodies)
    found = np.array([run[f"a_{k}"][0] for k in range(len(bodies))])
    assert found == pytest.approx(expected, abs=1e-9*np.abs(expected).max())


@pytest.mark.parametrize("seed", partly(TREES, 5))
def test_the_motion_of_a_random_tree_by_pinocchio(seed: int) -> None:
    """Pinocchio's accelerations, integrated by SciPy to 1e-11; 1e-6 of the largest displacement in a second."""
    pytest.importorskip("pinocchio", reason="Pinocchio (pin) is not installed")
    bodies, run = _moving_tree(seed)
    n, tree = len(bodies), Pinocchio(bodies)
    start = [*(b.q for b in bodies), *(b.v for b in bodies)]
    expected = solve_ivp(lambda t, y: np.append(y[n:], tree.accelerations(y[:n], y[n:])), (0, 1), start, "DOP853", run.time,
                         rtol=1e-11, atol=1e-11)
    found = np.array([run[f"q_{k}"] for k in range(n)])
    assert found == pytest.approx(expected.y[:n], abs=1e-6*np.abs(expected.y[:n]).max())


def test_a_tree_has_explicit_equations_and_the_coordinates_of_its_joints_as_states() -> None:
    bodies = random_tree(8, 5)
    assembly = hb.assemble(hb.loads(diagram(bodies)))
    assert assembly.reduced.z.numel() == 0
    assert len(assembly.reduced.states) == 2*len(bodies)


TOP = """
model: top
components:
  floor: {is: SpatialFixed}
  tip:   {is: SphericalJoint}
  top:   {is: SpatialBody, m: 1.5 kg, J_x: 0.02 kg*m**2, J_y: 0.02 kg*m**2, J_z: 0.03 kg*m**2, l_z: 0.2 m}
  axes:  {is: SpatialSensor}
nodes:
  floor: [floor.a, tip.a]
  top:   [tip.b, top.a, axes.a]
initial: {axes.roll: 0 rad, axes.pitch: 0.4 rad, axes.yaw: 0 rad, top.w_x: WX rad/s, top.w_y: 0 rad/s, top.w_z: WZ rad/s}
show:
  tilt: {is: "1 - 2*(top.q_1**2 + top.q_2**2)", unit: 1}
  way:  {is: "top.r[1]", unit: m}
  height: {is: "top.r[3]", unit: m}
simulate: {until: 2 s, every: 5 ms}
"""


def test_a_heavy_top_precesses_without_nodding() -> None:
    """At the slow precession p with J_z w_s p - (J_t - J_z) p**2 cos(theta) = m g l the tilt is constant, and the centre
    goes round with p."""
    theta, m, length, axial = 0.4, 1.5, 0.2, 0.03
    transverse, spin = 0.02 + m*length**2, 60.0  # of the body against the precessing frame
    # axial*(spin + p*cos) * p - transverse*p**2*cos = m g l
    p = min(np.roots([(axial - transverse)*np.cos(theta), axial*spin, -m*G*length]).real, key=abs)
    w = np.array([spin*np.sin(theta), 0, spin*np.cos(theta) + p])
    run = hb.simulate(hb.loads(TOP.replace("WX", repr(float(w[0]))).replace("WZ", repr(float(w[2])))), rtol=1e-10)
    assert run["tilt"] == pytest.approx(np.cos(theta), abs=1e-7)
    assert run["way"] == pytest.approx(length*np.sin(theta)*np.cos(p*run.time), abs=1e-6)


def test_a_body_without_moments_turns_by_elliptic_functions() -> None:
    """Euler's equations of a body with three moments of inertia (Landau, Lifshitz, Mechanics, section 37)."""
    J = np.array([1.0, 2.0, 3.0])
    run = hb.simulate(hb.loads("""model: free
components: {body: {is: SpatialBody, m: 1 kg, J_x: 1 kg*m**2, J_y: 2 kg*m**2, J_z: 3 kg*m**2, g: 0 m/s**2}}
nodes: {body: [body.a]}
initial: {"body.w[1]": 0.5 rad/s, "body.w[2]": 0 rad/s, "body.w[3]": 1.5 rad/s}
show: {middle: {is: "body.w[2]", unit: rad/s}, norm: {is: "body.q_0**2 + body.q_1**2 + body.q_2**2 + body.q_3**2", unit: 1}}
simulate: {until: 20 s, every: 20 ms}
"""), rtol=1e-10)
    w = np.array([0.5, 0, 1.5])
    energy, momentum = J @ w**2, J**2 @ w**2  # twice the energy, square of the angular momentum
    assert momentum > energy*J[1]
    rate = np.sqrt((J[2] - J[1])*(momentum - energy*J[0])/J.prod())
    k2 = (J[1] - J[0])*(energy*J[2] - momentum)/((J[2] - J[1])*(momentum - energy*J[0]))
    expected = np.sqrt((energy*J[2] - momentum)/(J[1]*(J[2] - J[1])))*ellipj(rate*run.time, k2)[0]
    assert run["middle"] == pytest.approx(expected, abs=1e-6)
    assert run["norm"] == pytest.approx(1, abs=1e-14)


def test_foucaults_pendulum() -> None:
    """On a turntable with W about z, a pendulum that swings with small amplitude keeps its plane in space: seen from the
    table, x + i y = exp(-i W t)*(A cos(k t) + i W A/k sin(k t)) for a start at rest on the table, with k**2 = g/l in the
    linear limit. The amplitude of 1e-3 rad leaves a share of 1e-6 of it."""
    run = hb.simulate(hb.loads("""model: foucault
components:
  table: {is: SpatialPositionSource, x: [0 m, 0 m, 2 m], phi: [0 rad, 0 rad, "=0.3 rad/s*time"]}
  hook:  {is: UniversalJoint, n_a: [0, -1, 0], n_b: [1, 0, 0]}
  rope:  {is: SpatialLink, l_z: -2 m}
  bob:   {is: SpatialPointMass, m: 3 kg}
nodes:
  table: [table.a, hook.a]
  top:   [hook.b, rope.a]
  bob:   [rope.b, bob.a]
  one:   [hook.d]
  two:   [hook.e]
initial: {hook.phi: 1e-3 rad, hook.psi: 0 rad, hook.w: 0 rad/s, hook.o: 0 rad/s}
show: {x: {is: bob.x, unit: m}, y: {is: bob.y, unit: m}}
simulate: {until: 10 s, every: 20 ms}
"""), rtol=1e-11, atol=1e-13)
    k, W = np.sqrt(G/2), 0.3
    start = run["x"][0]
    assert abs(start) == pytest.approx(2e-3, rel=1e-6)
    assert run["x"] == pytest.approx(start*np.cos(k*run.time), abs=1e-5*abs(start))
    assert run["y"] == pytest.approx(start*W/k*np.sin(k*run.time), abs=1e-5*abs(start))


def test_energy_of_a_spatial_double_pendulum() -> None:
    found = hb.energy(hb.loads(DOUBLE))
    assert found.closes()


DOUBLE = """model: double
components:
  ground: {is: SpatialFixed}
  upper:  {is: SpatialRevoluteJoint, n: [0, -1, 0]}
  one:    {is: SpatialBody, m: 2 kg, J_x: 0.1 kg*m**2, J_y: 0.2 kg*m**2, J_z: 0.2 kg*m**2, l_x: 0.5 m}
  rod:    {is: SpatialLink, l_x: 1 m}
  lower:  {is: SpatialRevoluteJoint, n: [1, 0, 1]}
  two:    {is: SpatialBody, m: 1 kg, J_x: 0.05 kg*m**2, J_y: 0.1 kg*m**2, J_z: 0.1 kg*m**2, l_x: 0.4 m}
nodes:
  ground: [ground.a, upper.a]
  one:    [upper.b, one.a, rod.a]
  elbow:  [rod.b, lower.a]
  two:    [lower.b, two.a]
  d_1:    [upper.d]
  d_2:    [lower.d]
initial: {upper.phi: 0.3 rad, lower.phi: 1 rad, upper.w: 0 rad/s, lower.w: 0 rad/s}
show:
  energy: {is: "two.m*dot(two.u, two.u)/2 + one.m*dot(one.u, one.u)/2 + dot(one.w, one.L)/2 + dot(two.w, two.L)/2
               + one.m*one.g*(one.z + one.r[3]) + two.m*two.g*(two.z + two.r[3])", unit: J}
simulate: {until: 10 s, every: 10 ms}
"""


def test_every_rate_of_a_frame_is_a_derivative() -> None:
    """`spin` and `speed` of the components of the library."""
    bundled = library()
    related = [bundled.component(name) for name, path in bundled.files.items() if path.parent.name == "spatial"]
    assert sum(bool(component.frames) for component in related) >= 10
    for component in related:
        assert wrong_rates(component, bundled.domains) == [], component.name


@pytest.mark.parametrize(("rule", "code"), [
    ("{port: c, shares: b, excludes: [PlanarBody], advice: Use another.}", "circuit-port"),
    ("{port: a, shares: b, excludes: [PlanarBody]}", "key-missing"),
    ("a", "not-a-mapping"),
])
def test_mistakes_in_the_rule_of_a_circuit(rule: str, code: str, tmp_path: Path) -> None:
    (tmp_path/"own.yaml").write_text(f"""component: Own
summary: A part.
ports: {{a: planar, b: spatial}}
circuit: {rule}
equations: |
  a.F = 0    # none
""")
    with pytest.raises(ModelError) as error:
        library([tmp_path]).component("Own")
    assert code in [problem.code for problem in error.value.problems]


@pytest.mark.parametrize(("line", "code"), [
    ("a to b: {turn: \"turn([0, 0, 1], phi)\", spin: \"[0, w, 0]\", shift: \"[0, 0, 0]\"}", "frames-rate"),
    ("a to c: {turn: \"turn([0, 0, 1], phi)\", shift: \"[0, 0, 0]\"}", "frames-port"),
    ("a to b: {turn: \"[0, 0, phi]\", shift: \"[0, 0, 0]\"}", "frames-vector"),
    ("a to b: {turn: \"turn([0, 0, 1], phi)\", shift: \"[0, 0, w]\"}", "frames-vector"),
    ("a to b: {turn: \"turn([0, 0, 1], phi)\", speed: \"[0, 0, 0]\"}", "frames-alone"),
    ("a to b: {turn: \"turn([0, 0, 1], phi)\"}", "balance-too-few"),
])
def test_mistakes_in_frames(line: str, code: str, tmp_path: Path) -> None:
    path = tmp_path/"hinge.yaml"
    path.write_text(f"""component: Hinge
summary: A hinge.
ports: {{a: spatial, b: spatial}}
variables:
  phi: {{unit: rad, doc: angle}}
  w:   {{unit: rad/s, doc: its rate}}
frames:
  {line}
equations: |
  w   = der(phi)                                   # rate
  b.F = -a.F                                       # force
  a.M = -b.M - cross(b.r - a.r, b.F)               # moments
  dot(rotated(a.q, [0, 0, 1]), b.M) = 0            # no friction
""")
    own = library([path.parent])
    try:
        codes = [problem.code for problem in power_problems([own.checked("Hinge")], own.domains)]
    except ModelError as error:
        codes = [problem.code for problem in error.problems]
    assert code in codes


BENNETT = """model: bennett
components:
  ground: {is: SpatialFixed}
  drive:  {is: AngleSource, u: "=1 rad + 0.5 rad/s*time"}
  one:    {is: SpatialRevoluteJoint, n: [0, 0, 1]}
  link_1: {is: SpatialLink, l_x: A m, roll: 0.6 rad}
  two:    {is: SpatialRevoluteJoint, n: [0, 0, 1]}
  link_2: {is: SpatialLink, l_x: B m, roll: 1.1 rad}
  three:  {is: CylindricalJoint, n: [0, 0, 1]}
  link_3: {is: SpatialLink, l_x: A m, roll: 0.6 rad}
  four:   {is: SphericalJoint}
  link_4: {is: SpatialLink, l_x: B m, roll: 1.1 rad}
  mass:   {is: SpatialBody, m: 2 kg, J_x: 0.1 kg*m**2, J_y: 0.1 kg*m**2, J_z: 0.1 kg*m**2}
nodes:
  ground: [ground.a, one.a, link_4.b]
  drive:  [drive.a, one.d]
  one:    [one.b, link_1.a]
  a:      [link_1.b, two.a]
  two:    [two.b, link_2.a, mass.a]
  d_2:    [two.d]
  b:      [link_2.b, three.a]
  three:  [three.b, link_3.a]
  d_3:    [three.d]
  e_3:    [three.e]
  c:      [link_3.b, four.a]
  four:   [four.b, link_4.a]
initial: {two.phi: ~ START rad, three.phi: ~ -1 rad, three.s: ~ 0 m}
show:
  driven: {is: two.phi, unit: rad}
  third:  {is: three.phi, unit: rad}
  slide:  {is: three.s, unit: m}
simulate: {until: 1 s, every: 20 ms}
"""


@pytest.mark.long
def test_a_bennett_linkage() -> None:
    """tan(theta_1/2) tan(theta_2/2) = sin((beta + alpha)/2)/sin((beta - alpha)/2) (G. T. Bennett, Engineering 76 (1903)
    777), and opposite joints turn alike. Hinges alone would constrain it three times too often: one is a sleeve that does
    not slide, and one a ball joint."""
    alpha, beta, short = 0.6, 1.1, 0.5
    K = np.sin((beta + alpha)/2)/np.sin((beta - alpha)/2)
    text = BENNETT.replace("A m", f"{short} m").replace("B m", f"{short*np.sin(beta)/np.sin(alpha)} m")
    run = hb.simulate(hb.loads(text.replace("START", repr(float(2*np.arctan(K/np.tan(0.5)) + 0.05)))))
    theta = 1 + 0.5*run.time
    # algebraic equations, solved to about 1e-10 of their size
    assert run["driven"] == pytest.approx(2*np.arctan(K/np.tan(theta/2)), abs=1e-8)
    assert run["third"] == pytest.approx(-theta, abs=1e-8)
    assert run["slide"] == pytest.approx(0, abs=1e-8)


# one with every run; the other five take two minutes
@pytest.mark.long
@pytest.mark.parametrize("number", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(1, 6))])
def test_accelerations_of_a_closed_mechanism_by_pinocchio(number: int) -> None:
    """At the start, where the dependent joints follow from the independent ones; rounding of some thousand operations. The
    closures of MuJoCo are stiff: it agrees to 2e-3 of the largest acceleration."""
    pytest.importorskip("pinocchio", reason="Pinocchio (pin) is not installed")
    bodies, closures, independent = closed_mechanism(number)
    run = hb.simulate(hb.loads(closed_diagram(bodies, closures, independent)), "1 us", every="1 us")
    q, v, a = (np.array([run[f"{word}_{k}"][0] for k in range(len(bodies))]) for word in "qva")
    assert q == pytest.approx(np.array([b.q for b in bodies]), abs=1e-9)
    expected = Pinocchio(bodies).closed_accelerations(closures, q, v)
    assert a == pytest.approx(expected, abs=1e-8*np.abs(expected).max())
    pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    assert mujoco_accelerations(bodies, closures, q, v) == pytest.approx(expected, abs=2e-3*np.abs(expected).max())


FOUR_BAR = """model: four_bar
components:
  left:    {is: SpatialFixed}
  right:   {is: SpatialFixed, x_0: 1 m}
  pin_1:   {is: SpatialRevoluteJoint, n: [0, -1, 0]}
  pin_2:   {is: SphericalJoint}
  pin_3:   {is: UniversalJoint, n_a: [0, -1, 0], n_b: [1, 0, 0]}
  pin_4:   {is: SpatialRevoluteJoint, n: [0, -1, 0]}
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
  d_3:     [pin_3.d]
  e_3:     [pin_3.e]
  d_4:     [pin_4.d]
initial: {pin_1.phi: 60 deg, pin_1.w: 1 rad/s, pin_4.phi: ~ 80 deg, pin_3.phi: ~ 80 deg}
show:
  length: {is: "sqrt((two.x - one.x)**2 + (two.z - one.z)**2)", unit: m}
  energy: {is: "mass.m*dot(mass.u, mass.u)/2 + dot(mass.w, mass.L)/2 + mass.m*mass.g*coupler.z", unit: J}
  side:   {is: two.y, unit: m}
simulate: {until: 1 s, every: 5 ms}
"""


def test_a_closed_loop_keeps_its_lengths_and_its_energy() -> None:
    run = hb.simulate(hb.loads(FOUR_BAR), rtol=1e-10)
    assert run["length"] == pytest.approx(1, abs=1e-9)
    assert run["side"] == pytest.approx(0, abs=1e-9)
    # the energy turned over is some 6 J
    assert run["energy"] == pytest.approx(run["energy"][0], abs=1e-6)


@pytest.mark.long
def test_a_loop_that_does_not_close_is_named() -> None:
    with pytest.raises(HeavebondError) as caught:
        hb.simulate(hb.loads(FOUR_BAR.replace("l_x: 1 m}", "l_x: 0.1 m}")))
    assert "the loop pin_1, pin_2, pin_3, pin_4 does not close" in str(caught.value)


def test_a_machine_at_rest_is_clean() -> None:
    """Speeds of 1e-17 m/s times forces are no missing power."""
    text = DOUBLE.replace("initial: {upper.phi: 0.3 rad, lower.phi: 1 rad, upper.w: 0 rad/s, lower.w: 0 rad/s}",
                          "initial: {start: steady, upper.phi: ~ -80 deg, lower.phi: ~ 5 deg}")
    assert not hb.simulate(hb.loads(text)).verdict.failed


def test_modes_have_as_many_states_as_degrees_of_freedom() -> None:
    """A body on a ball joint: three degrees of freedom, though its orientation has four states in a run."""
    model = hb.loads(TOP.replace("WX", "0.0").replace("WZ", "0.0").replace("axes.pitch: 0.4 rad", "axes.pitch: 3 rad"))
    assert len(hb.assemble(model).reduced.states) == 7
    point = OperatingPoints(model)
    assert len(point.assembly.reduced.states) == 6


def test_a_platform_on_six_cylinders() -> None:
    """The lengths of the legs at the position and orientation of the platform; no leg is a constraint."""
    run = hb.simulate(hb.load("spatial/platform"), "2 s")
    assert len(run.assembly.reduced.states) == 25
    assert run.assembly.reduced.z.numel() == 0
    model = run.assembly.model
    place = np.array([run[f"deck.{name}"] for name in "xyz"]).T
    x, y, z, w = (np.asarray(run[f"deck.q_{k}"]) for k in (1, 2, 3, 0))
    turn = Rotation.from_quat(np.stack([x, y, z, w], axis=-1))
    values = run.assembly.parameter_values
    for k in range(1, 7):
        low, high = (np.array([values[f"{part}_{k}.l_{axis}"] for axis in "xyz"]) for part in ("base", "eye"))
        length = np.linalg.norm(place + turn.apply(high) - low, axis=1)
        assert run[f"leg_{k}.line.l"] == pytest.approx(length, abs=1e-9)
    assert model.name == "platform"
    height = 1.9 + 0.15*np.sin(2*np.pi*0.2*(run.time - 0.2))  # a loop of 5 1/s follows 0.2 s later
    assert np.abs(np.asarray(run["deck.z"]) - height)[run.time > 1].max() < 0.02


@pytest.mark.parametrize("name", partly(["gyroscope", "robot_arm"], 2))
def test_the_energy_of_a_bundled_machine(name: str) -> None:
    assert hb.energy(hb.load(f"spatial/{name}"), "1 s").closes()


@pytest.mark.long
def test_a_crane_on_a_vessel_starts_in_equilibrium() -> None:
    run = hb.simulate(hb.load("spatial/vessel_crane"), "0.5 s")
    assert run.si["tension"][0] == pytest.approx(25e3*G, rel=1e-6)


@pytest.mark.slow
def test_a_crane_compensates_heave_and_lands_its_load() -> None:
    """The numbers are those of the page on machines in space, as it rounds them."""
    run = hb.simulate(hb.load("spatial/landing_crane"))
    calm, landed = (run.time > 15) & (run.time < 35), run.time > 65
    load, head = (np.std(np.asarray(run[name])[calm]) for name in ("load.z", "tip.z"))
    # a feed-forward with the mean of the gains of the valve in both directions
    assert [load, head] == pytest.approx([0.015, 0.178], abs=0.0005)
    assert run.si["contact"].max() == pytest.approx(251e3, abs=500)
    contact = run.si["contact"]
    # the load accelerates with the deck by some 2 % of g; the indentation of the pads is some 20 mm
    assert contact[landed] == pytest.approx(25e3*G, rel=0.03) and contact.max() < 1.1*25e3*G
    assert not run.si["tension"][landed].any() and np.abs(run.si["gap"][landed]).max() < 0.03


BOOM = """
  one:   {is: SpatialBody, m: 6 kg, J_x: 0.1 kg*m**2, J_y: 0.6 kg*m**2, J_z: 0.5 kg*m**2, l_x: 0.5 m}
  two:   {is: SpatialBody, m: 4 kg, J_x: 0.1 kg*m**2, J_y: 0.4 kg*m**2, J_z: 0.4 kg*m**2, l_x: 0.4 m, l_y: 0.1 m}
  deck:  {is: SpatialBody, m: 40 kg, J_x: 8 kg*m**2, J_y: 9 kg*m**2, J_z: 10 kg*m**2, g: 0 m/s**2}
nodes:"""
MOVES = """
initial: {pin.phi: 0.3 rad, pin.w: 0.2 rad/s, knee.phi: -0.8 rad, knee.w: 0 rad/s, deck.w_x: 0.4 rad/s, deck.w_y: -0.2 rad/s,
          deck.w_z: 0.3 rad/s}
simulate: {until: 1 s, every: 10 ms}
"""


@pytest.mark.long
def test_a_planar_machine_moves_the_body_that_carries_it() -> None:
    """Two links that hang in a plane of a free tumbling body beside the same links on hinges in space; both runs deviate by
    some 1e-8 of each motion at these tolerances."""
    carried = hb.simulate(hb.loads("""model: carried
components:
  post:  {is: PlanarFixed, y_0: 1 m}
  pin:   {is: RevoluteJoint}
  boom:  {is: RigidLink, l: 1 m}
  knee:  {is: RevoluteJoint}
  first: {is: PlaneOnBody}
  last:  {is: PlaneOnBody}""" + BOOM + """
  deck:  [deck.a, first.base, last.base]
  post:  [post.a, pin.a]
  boom:  [pin.b, boom.a, first.a]
  elbow: [boom.b, knee.a]
  jib:   [knee.b, last.a]
  one:   [first.b, one.a]
  two:   [last.b, two.a]""" + MOVES), rtol=1e-9)
    native = hb.simulate(hb.loads("""model: native
components:
  post:  {is: SpatialLink, l_z: 1 m}
  pin:   {is: SpatialRevoluteJoint, n: [0, -1, 0]}
  boom:  {is: SpatialLink, l_x: 1 m}
  knee:  {is: SpatialRevoluteJoint, n: [0, -1, 0]}""" + BOOM + """
  deck:  [deck.a, post.a]
  post:  [post.b, pin.a]
  one:   [pin.b, boom.a, one.a]
  elbow: [boom.b, knee.a]
  two:   [knee.b, two.a]
  d_1:   [pin.d]
  d_2:   [knee.d]""" + MOVES), rtol=1e-9)
    for node in ("deck", "one", "two"):
        for member in ("x", "y", "z", "q_0", "q_1", "q_2", "q_3", "v_x", "w_x", "w_y", "w_z"):
            assert carried[f"{node}.{member}"] == pytest.approx(native[f"{node}.{member}"], abs=1e-6)


@pytest.mark.long
def test_a_planar_crane_trims_its_barge() -> None:
    """The moments of the weights about the centre of the waterplane in the axes of the barge are those of the righting
    moment and of the swell, and the sum of the weights is the buoyancy and the force of the swell."""
    run = hb.simulate(hb.load("spatial/barge_crane"), "20 ms")
    values = run.assembly.parameter_values
    place = np.array([run[f"deck.{axis}"][0] for axis in "xyz"])
    weights = [(values["barge.m"], place + turned(run, "deck", [0, 0, values["barge.l_z"]]))]
    for node, part in (("jib", "boom_mass"), ("block", "sheave_mass"), ("cargo", "load_mass")):
        arm = [values[f"{part}.l_{axis}"] for axis in "xyz"]
        at = np.array([run[f"{node}.{axis}"][0] for axis in "xyz"])
        weights.append((values[f"{part}.m"], at + turned(run, node, arm)))
    moment = sum(np.cross(at - place, [0, 0, -m*G]) for m, at in weights)
    assert moment == pytest.approx([run[f"hull.a.M_{axis}"][0] + run[f"wave.a.M_{axis}"][0] + run[f"mooring.b.M_{axis}"][0]
                                    for axis in "xyz"], abs=1)


def turned(run: hb.Result, node: str, arm: list[float]) -> np.ndarray:
    """A vector of a frame at the start in the fixed frame."""
    return Rotation.from_quat([run[f"{node}.q_{k}"][0] for k in (1, 2, 3, 0)]).apply(arm)


def test_a_hinge_with_dry_friction_swings_and_sticks() -> None:
    """The first turning point: m g l (cos(theta_1) - cos(theta_0)) = M (theta_0 + theta_1) from hanging. The divisors of the
    elimination differ from zero while the hinge sticks and while it slips."""
    run = hb.simulate(hb.loads("""model: swing
components:
  wall:     {is: SpatialFixed}
  pin:      {is: SpatialRevoluteJoint, n: [0, 1, 0]}
  arm:      {is: SpatialBody, m: 2 kg, J_x: 0.1 kg*m**2, J_y: 0.1 kg*m**2, J_z: 0.1 kg*m**2, l_x: 0.3 m}
  friction: {is: RotationalDryFriction, M_c: 1 N*m, M_s: 1 N*m}
  housing:  {is: FixedShaft}
nodes: {wall: [wall.a, pin.a], arm: [pin.b, arm.a], drive: [pin.d, friction.b], housing: [housing.a, friction.a]}
initial: {pin.phi: 0 rad, pin.w: 0 rad/s}
show: {angle: {is: pin.phi, unit: rad}}
simulate: {until: 6 s, every: 5 ms}
"""))
    turned = brentq(lambda theta: 2*G*0.3*np.cos(theta) - (np.pi/2 + theta), 0, np.pi/2)
    assert run["angle"].max() == pytest.approx(np.pi/2 + turned, abs=1e-4)
    assert run["angle"][-100:] == pytest.approx(run["angle"][-1], abs=1e-7)


@pytest.mark.long
def test_the_kinematics_of_a_double_wishbone() -> None:
    """Angles of the upright and of the upper arm from that of the lower arm, by the equations of closure of the joints."""
    model = hb.load("spatial/wishbone")
    run = hb.simulate(model, "0.45 s", every="10 ms")
    values = run.assembly.parameter_values

    def point(part: str) -> np.ndarray:
        return np.array([values[f"{part}.l_{axis}"] for axis in "xyz"])

    def turn(part: str, angle: float) -> Rotation:
        axis = np.array([values[f"{part}.n[{k}]"] for k in (1, 2, 3)])
        return Rotation.from_rotvec(angle*axis/np.linalg.norm(axis))

    instants = (0, 35, 38, 40, 42, 44)
    assert np.ptp(np.asarray(run.si["wheel"])[list(instants)]) > 0.03
    guess = np.zeros(4)
    for k in instants:
        low = point("low_pivot") + turn("low_hinge", float(run["low_hinge.phi"][k])).apply(point("low_arm"))

        def gap(unknown: np.ndarray, low: np.ndarray = low) -> np.ndarray:
            upright = Rotation.from_euler("ZYX", unknown[:0:-1])
            high = point("high_pivot") + turn("high_hinge", unknown[0]).apply(point("high_arm"))
            rod = low + upright.apply(point("lever")) - point("rack")
            return np.append(low + upright.apply(point("king_pin")) - high, rod @ rod - values["tie_rod.l"]**2)

        guess = fsolve(gap, guess, xtol=1e-13)
        assert [run["high_hinge.phi"][k], *(run[f"angles.{name}"][k] for name in ("roll", "pitch", "yaw"))] == pytest.approx(
            guess, abs=1e-7)


def test_a_force_on_a_point_mass() -> None:
    """A mass without extension has no orientation, on which a force along fixed axes does not depend."""
    run = hb.simulate(hb.loads("""model: ball
components:
  push: {is: SpatialForce, F: [1 N, "=-3 N*s/m*ball.v_y", 0 N], M: [0 N*m, 0 N*m, 0 N*m]}
  ball: {is: SpatialPointMass, m: 2 kg, g: 0}
nodes: {ball: [push.a, ball.a]}
initial: {ball.v_y: 1 m/s}
simulate: {until: 1 s, every: 100 ms}
"""))
    assert run["ball.x"][-1] == pytest.approx(0.25, abs=1e-8)
    assert run["ball.y"][-1] == pytest.approx(2/3*(1 - np.exp(-1.5)), abs=1e-7)


@pytest.mark.parametrize(("old", "new", "code", "hint"), [
    ("upper.phi: 0.3 rad", "one.phi: 0.3 rad", "name-unknown", "`attitude.pitch`"),
    ("n: [0, -1, 0]", "n: y", "formula-unmarked", "`n: [1, 0, 0]`"),
    ("n: [0, -1, 0]", "n: [0, -1]", "parameter-missing", "Write `n: [..., ..., ...]`, each value with its unit."),
    ("two:    {is: SpatialBody, m: 1 kg, J_x: 0.05 kg*m**2, J_y: 0.1 kg*m**2, J_z: 0.1 kg*m**2, l_x: 0.4 m}",
     "two:    {is: PlanarBody, m: 1 kg, J: 0.1 kg*m**2}", "domains-mixed", "SpatialBody"),
    ("J_y: 0.2 kg*m**2, J_z", "J_y: 0.2 kg*m**2, J_xy: 0.15 kg*m**2, J_z", "requirement", "J_xy = 0.15 kg*m**2"),
])
def test_mistakes_in_a_machine_in_space(old: str, new: str, code: str, hint: str) -> None:
    assert old in DOUBLE
    with pytest.raises(HeavebondError) as caught:
        hb.simulate(hb.loads(DOUBLE.replace(old, new)))
    first = next(problem for problem in caught.value.problems if problem.code == code)
    assert hint in str(first)


def test_moments_of_inertia_of_no_body_are_reported() -> None:
    run = hb.simulate(hb.loads(DOUBLE.replace("J_z: 0.2 kg*m**2", "J_z: 2 kg*m**2")), "0.1 s")
    assert any("no rigid body has a moment of inertia" in str(finding) for finding in run.verdict.findings)
    # a plate, with rounded values
    plate = DOUBLE.replace("J_y: 0.2 kg*m**2, J_z: 0.2 kg*m**2", "J_y: 0.2 kg*m**2, J_z: 0.301 kg*m**2")
    assert not any("rigid body" in str(finding) for finding in hb.simulate(hb.loads(plate), "0.1 s").verdict.findings)
