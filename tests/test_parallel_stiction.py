"""Contacts that stick in parallel: they hold the sum of their stiction forces, however they share the load before."""

from __future__ import annotations

from itertools import permutations, product
from pathlib import Path

import numpy as np
import pytest
from test_co_simulation_fmu import fmpy
from test_export import compiled

import heavebond as hb
from heavebond.exchange.fmu_export import export_fmu
from heavebond.numerics.result import Result

# locating an event and the steps after it at rtol 1e-8, and F_s/m_r*1e-12 of creep while a contact sticks
SMALL = 1e-6
BLOCK = """
model: block
components:
  w: {{is: Fixed}}
  m: {{is: Mass, m: 2 kg}}
{contacts}
  push: {{is: ForceSource, u: "{force}"}}
nodes:
  w: [w.a, {a}]
  m: [m.a, push.a, {b}]
initial: {{m.x: 0 m, m.v: 0 m/s}}
simulate: {{until: {until} s, every: 10 ms}}
"""
LEVELS = {"f1": (4, 5), "f2": (8, 10), "f3": (1, 3)}  # F_c and F_s


def block(contacts: tuple[str, ...], force: str, until: float, **levels: tuple[float, float]) -> hb.Model:
    known = LEVELS | levels
    return hb.loads(BLOCK.format(
        contacts="\n".join(f"  {c}: {{is: DryFriction, F_c: {known[c][0]} N, F_s: {known[c][1]} N}}" for c in contacts),
        force=force, a=", ".join(f"{c}.a" for c in contacts), b=", ".join(f"{c}.b" for c in contacts), until=until))


def times(result: Result, event: str) -> list[float]:
    return [time for time, name in result.events if name == event]


def test_a_contact_of_two_does_not_slide_before_both_are_at_their_limits() -> None:
    found = hb.simulate(block(("f1", "f2"), "=10 N/s*time", 2), rtol=1e-10, sensitivities=["f1.F_s", "m.m"])
    late = found.time[-1] - 1.5  # 15 N at 10 N/s; then 2 kg * a = 10 N/s * t - 12 N
    assert times(found, "f1.forward") == times(found, "f2.forward") == pytest.approx([1.5], abs=SMALL)
    assert found["m.x"][-1] == pytest.approx((3 * late**2 / 2 + 10 * late**3 / 6) / 2, rel=SMALL)
    assert np.abs(found["m.x"][found.time < 1.5]).max() < 1e-9
    # a later breakaway: d x / d F_s = -late * (15 N - 12 N) / 2 kg / (10 N/s)
    assert found.sensitivity("m.x", "f1.F_s")[-1] == pytest.approx(-late * 3 / 2 / 10, rel=1e-5)
    assert found.sensitivity("m.x", "m.m")[-1] == pytest.approx(-found["m.x"][-1] / 2, rel=1e-5)


def test_the_order_of_three_parallel_contacts_does_not_matter() -> None:
    ends = []
    for order in permutations(("f1", "f2", "f3")):
        found = hb.simulate(block(order, "=10 N/s*time", 2.2))
        assert [t for c in order for t in times(found, f"{c}.forward")] == pytest.approx([1.8] * 3, abs=SMALL)
        ends.append(found["m.x"][-1])
    assert ends == pytest.approx([(5 * 0.4**2 / 2 + 10 * 0.4**3 / 6) / 2] * 6, rel=SMALL)


@pytest.mark.parametrize("f2", [(8, 10), *(pytest.param(f2, marks=pytest.mark.long) for f2 in ((10, 10), (0, 10)))])
def test_a_load_that_turns_below_the_sum_of_the_limits_moves_nothing(f2: tuple[float, float]) -> None:
    held = hb.simulate(block(("f1", "f2"), "=14.99 N*sin(2*pi*time/1 s)", 3, f2=f2))
    assert np.abs(held["m.v"]).max() < 1e-9
    assert times(held, "f2.forward") == times(held, "f2.backward") == []
    moved = hb.simulate(block(("f1", "f2"), "=-15.01 N*sin(2*pi*time/1 s)", 0.3, f2=f2))
    assert times(moved, "f1.backward") == times(moved, "f2.backward") \
        == pytest.approx([np.arcsin(15 / 15.01) / (2 * np.pi)], abs=SMALL)


@pytest.mark.long
@compiled
def test_an_fmu_holds_parallel_contacts_as_a_run_does(tmp_path: Path) -> None:
    model = block(("f1", "f2", "f3"), "=17.9 N*sin(2*pi*time/1 s)*if_else(time > 1.5 s, 1.1, 1)", 2)
    export_fmu(model, tmp_path / "m.fmu", version=3)
    found = fmpy.simulate_fmu(str(tmp_path / "m.fmu"), fmi_type="CoSimulation", stop_time=2.0, output_interval=0.01,
                              output=["m.x"])
    exact = hb.simulate(model)
    at = np.searchsorted(found["time"], exact.time - 1e-9)
    assert np.abs(exact["m.x"][exact.time < 1.5]).max() < 1e-9 < np.abs(exact["m.x"]).max()
    # the tolerance of the FMU is 1e-9 a step
    assert found["m.x"][at] == pytest.approx(exact["m.x"], abs=1e-6 * np.abs(exact["m.x"]).max())


def test_a_load_at_the_start_is_held_up_to_the_sum_of_the_limits() -> None:
    held = hb.simulate(block(("f1", "f2"), "14 N", 1))
    assert np.abs(held["m.x"]).max() < 1e-9
    assert not times(held, "f1.forward")
    moved = hb.simulate(block(("f1", "f2"), "16 N", 1))
    assert moved["m.x"][-1] == pytest.approx((16 - 12) / 2 / 2, rel=SMALL)


def test_contacts_of_two_bodies_hold_by_the_shortest_way_to_the_frame() -> None:
    """A is held by the frame (5 N) and by B through a contact of 3 N; B by the frame (10 N): 8 N hold A."""
    found = hb.simulate(hb.loads("""
model: pair
components:
  w: {is: Fixed}
  A: {is: Mass, m: 2 kg}
  B: {is: Mass, m: 3 kg}
  wA: {is: DryFriction, F_c: 4 N, F_s: 5 N}
  AB: {is: DryFriction, F_c: 1 N, F_s: 3 N}
  wB: {is: DryFriction, F_c: 8 N, F_s: 10 N}
  push: {is: ForceSource, u: "=10 N/s*time"}
nodes:
  w: [w.a, wA.a, wB.a]
  A: [A.a, wA.b, AB.a, push.a]
  B: [B.a, AB.b, wB.b]
initial: {A.x: 0 m, A.v: 0 m/s, B.x: 0 m, B.v: 0 m/s}
simulate: {until: 1.2 s, every: 10 ms}
"""))
    assert times(found, "wA.forward") == times(found, "AB.backward") == pytest.approx([0.8], abs=SMALL)
    assert not times(found, "wB.forward")
    assert found["A.x"][-1] == pytest.approx((3 * 0.4**2 / 2 + 10 * 0.4**3 / 6) / 2, rel=SMALL)
    assert np.abs(found["B.x"]).max() < 1e-9


@pytest.mark.parametrize("mass", [2e-3, 2, 2e4])
def test_contacts_on_both_sides_of_a_rack_hold_together(mass: float) -> None:
    """5 N on the rack and 0.5 N*m on the pinion of 50 mm hold 15 N; every force in proportion to the mass."""
    scale = mass / 2
    found = hb.simulate(hb.loads(f"""
model: rack
components:
  w: {{is: Fixed}}
  s: {{is: FixedShaft}}
  m: {{is: Mass, m: {mass} kg}}
  rack: {{is: Rack, r: 50 mm}}
  guide: {{is: DryFriction, F_c: {4 * scale} N, F_s: {5 * scale} N}}
  bearing: {{is: RotationalDryFriction, M_c: {0.4 * scale} N*m, M_s: {0.5 * scale} N*m}}
  push: {{is: ForceSource, u: "={10 * scale} N/s*time"}}
nodes:
  w: [w.a, guide.a]
  s: [s.a, bearing.a]
  m: [m.a, guide.b, push.a, rack.b]
  p: [rack.a, bearing.b]
initial: {{m.x: 0 m, m.v: 0 m/s}}
simulate: {{until: 2 s, every: 10 ms}}
"""))
    assert [time for time, name in found.events if "ward" in name] == pytest.approx([1.5] * 2, abs=SMALL)
    assert found["m.x"][-1] == pytest.approx((3 * 0.5**2 / 2 + 10 * 0.5**3 / 6) / 2, rel=SMALL)


def test_two_brakes_on_a_shaft_hold_the_sum_of_their_slip_torques() -> None:
    """14 N*m against 1.5*6 N*m and a brake of 1.2*10 N*m that is released from 1 s on, down to 5 N*m at 1 - u = 0.5833."""
    found = hb.simulate(hb.loads("""
model: brakes
components:
  h: {is: FixedShaft}
  J: {is: Inertia, J: 2 kg*m**2}
  park: {is: LockingClutch, M_max: 6 N*m, k_s: 1.5, u: 1}
  main: {is: LockingClutch, M_max: 10 N*m, k_s: 1.2, u: "=1 - max(time - 1 s, 0)/1 s"}
  load: {is: TorqueSource, u: 14 N*m}
nodes:
  h: [h.a, park.a, main.a]
  J: [J.a, park.b, main.b, load.a]
initial: {J.phi: 0 rad, J.w: 0 rad/s}
simulate: {until: 2 s, every: 10 ms}
"""), rtol=1e-10)
    loose = 1 + 1 - (14 - 9) / 12
    assert times(found, "park.forward") == times(found, "main.forward") == pytest.approx([loose], abs=SMALL)
    t = np.linspace(0, 2 - loose, 20001)
    rate = (14 - 6 - 10 * (2 - loose - t)) / 2  # the slip torque of the main brake falls to 0 at 2 s
    assert found["J.w"][-1] == pytest.approx(np.trapezoid(rate, t), rel=SMALL)


def test_bodies_rest_on_two_stops_side_by_side() -> None:
    found = hb.simulate(hb.loads("""
model: beam
components:
  w: {is: Fixed}
  m: {is: Mass, m: 2 kg}
  left: {is: RigidStop, e: 0}
  right: {is: RigidStop, e: 0}
  push: {is: ForceSource, u: "=20 N*(time/1 s - 1)"}
nodes:
  w: [w.a, left.a, right.a]
  m: [m.a, left.b, right.b, push.a]
initial: {m.x: 0.1 m, m.v: -1 m/s}
simulate: {until: 2 s, every: 10 ms}
"""))
    held = (found.time > 0.2) & (found.time < 1)
    assert np.abs(found["m.x"][held]).max() < 1e-9
    assert (found["left.N"] + found["right.N"])[held] == pytest.approx(20 * (1 - found.time[held]), abs=SMALL)
    assert found["m.x"][-1] == pytest.approx(20 / 6 / 2, rel=SMALL)


PILE = """
model: pile
components:
  w: {{is: Fixed}}
{parts}
nodes:
  w: [w.a, f0.a]
{nodes}
initial: {{{initial}}}
simulate: {{until: {until}, every: 5 ms}}
"""


def pile(forces: np.ndarray, limits: np.ndarray, masses: np.ndarray, until: str = "10 ms") -> hb.Model:
    """Bodies on each other, the first on the ground, each with a force and with friction against the body below."""
    n = len(forces)
    parts = [f"  m{k}: {{is: Mass, m: {masses[k]} kg}}\n  p{k}: {{is: ForceSource, u: {forces[k]} N}}\n"
             f"  f{k}: {{is: DryFriction, F_c: {limits[k]} N, F_s: {limits[k]} N}}" for k in range(n)]
    nodes = [f"  m{k}: [m{k}.a, p{k}.a, f{k}.b{f', f{k + 1}.a' if k + 1 < n else ''}]" for k in range(n)]
    initial = [f"m{k}.x: 0 m, m{k}.v: 0 m/s" for k in range(n)]
    return hb.loads(PILE.format(parts="\n".join(parts), nodes="\n".join(nodes), initial=", ".join(initial), until=until))


def accelerations(forces: np.ndarray, limits: np.ndarray, masses: np.ndarray) -> np.ndarray:
    """Of the bodies at rest: by the only combination of contacts that stick, slide forwards and slide backwards whose forces
    and accelerations agree with it."""
    n, ways = len(forces), np.eye(len(forces)) - np.eye(len(forces), k=-1)  # relative accelerations = ways @ accelerations
    for modes in product((-1, 0, 1), repeat=n):
        slides = np.array(modes, bool)
        # unknowns: n accelerations, n friction forces
        rows = np.block([[np.diag(masses), ways.T], [np.where(slides[:, None], 0, ways), np.diag(slides.astype(float))]])
        solved = np.linalg.solve(rows, np.concatenate([forces, np.array(modes) * limits]))
        moves, friction = ways @ solved[:n], solved[n:]
        if np.all(np.where(slides, np.array(modes) * moves >= 0, np.abs(friction) <= limits)):
            return solved[:n]
    raise AssertionError("no combination")


@pytest.mark.long
def test_bodies_at_rest_break_away_in_the_only_consistent_directions(tmp_path: Path) -> None:
    """Forces far above the limits: a contact that its load would move forwards is dragged backwards by the body below."""
    case = np.array([100.0, 3.0]), np.array([5.0, 2.0]), np.array([1.0, 1.0])
    assert accelerations(*case) == pytest.approx([93, 5])  # 100 - 5 - 2 and 3 + 2
    cases, random = [case], np.random.default_rng(3)
    for _ in range(8):
        values = random.normal(0, 30, 4), random.uniform(1, 20, 4), random.uniform(0.2, 5, 4)
        cases.append((values[0].round(2), values[1].round(2), values[2].round(2)))
    for forces, limits, masses in cases:
        result = hb.simulate(pile(forces, limits, masses))
        reached = np.array([result[f"m{k}.v"][-1] for k in range(len(forces))])
        assert reached == pytest.approx(0.01 * accelerations(forces, limits, masses), abs=SMALL)


@pytest.mark.long
@compiled
def test_an_fmu_lets_bodies_break_away_as_a_run_does(tmp_path: Path) -> None:
    forces, limits, masses = np.array([100.0, 3.0]), np.array([5.0, 2.0]), np.array([1.0, 1.0])
    export_fmu(pile(forces, limits, masses), tmp_path / "m.fmu", version=3)
    found = fmpy.simulate_fmu(str(tmp_path / "m.fmu"), fmi_type="CoSimulation", stop_time=0.01, output_interval=0.005,
                              output=["m0.v", "m1.v"])
    assert (found["m0.v"][-1], found["m1.v"][-1]) == pytest.approx(0.01 * accelerations(forces, limits, masses), abs=SMALL)


def test_two_locking_clutches_in_parallel_carry_the_sum_of_their_torques() -> None:
    """20 N*m/s on 2 and 3 kg*m**2: 3/5 of the torque reach 5*1.2 + 10 N*m after 4/3 s; then 15 N*m slip."""
    found = hb.simulate(hb.loads("""
model: clutches
components:
  a: {is: Inertia, J: 2 kg*m**2}
  b: {is: Inertia, J: 3 kg*m**2}
  c: {is: LockingClutch, M_max: 5 N*m, k_s: 1.2, u: 1}
  d: {is: LockingClutch, M_max: 10 N*m, u: 1}
  t: {is: TorqueSource, u: "=20 N*m/s*time"}
nodes: {x: [a.a, t.a, c.a, d.a], y: [b.a, c.b, d.b]}
initial: {x.phi: 0 rad, x.w: 0 rad/s, y.w: 0 rad/s, y.phi: 0 rad}
simulate: {until: 2 s, every: 10 ms}
"""))
    t, slip = found.time, 4 / 3
    assert found.si["y.w"] == pytest.approx(np.where(t < slip, 2 * t**2, 2 * slip**2 + 5 * (t - slip)), rel=1e-8, abs=1e-9)


@pytest.mark.parametrize(("force", "mass", "turning"), [
    (1e-2, 1e-2, False), (1e-3, 1.0, True), (1e-6, 1.0, False), (1e-6, 1e-6, True), (1e-9, 1e-9, False)])
def test_contacts_of_tiny_forces_in_parallel(force: float, mass: float, turning: bool) -> None:
    """Two contacts of F each under F t/s: both slide at 2 s, with 0.8 of the force. No unknown is left at a size that does
    not fit, and a size that the diagram states is accepted."""
    text = f"""
model: block
components:
  w: {{is: Fixed}}
  m: {{is: Mass, m: {mass} kg}}
  f: {{is: DryFriction, F_c: {0.8 * force} N, F_s: {force} N}}
  g: {{is: DryFriction, F_c: {0.8 * force} N, F_s: {force} N}}
  p: {{is: ForceSource, u: "={force} N/s*time"}}
nodes: {{w: [w.a, f.a, g.a], x: [m.a, f.b, g.b, p.a]}}
initial: {{x.x: 0 m, x.v: 0 m/s}}
nominal: {{f.b.f: {force} N}}
simulate: {{until: 3 s, every: 10 ms}}
"""
    if turning:
        for old, new in (("Fixed", "FixedShaft"), ("Mass, m:", "Inertia, J:"), ("kg}", "kg*m**2}"), ("F_c", "M_c"),
                         ("DryFriction", "RotationalDryFriction"), ("F_s", "M_s"), (" N,", " N*m,"), (" N}", " N*m}"),
                         ("ForceSource", "TorqueSource"), ("N/s", "N*m/s"), ("x.x: 0 m", "x.phi: 0 rad"), ("b.f:", "b.tau:"),
                         ("x.v: 0 m/s", "x.w: 0 rad/s")):
            text = text.replace(old, new)
    for diagram in (text, "\n".join(line for line in text.splitlines() if not line.startswith("nominal"))):
        found = hb.simulate(hb.loads(diagram))
        late = np.maximum(found.time - 2, 0)
        exact = force / mass * (0.4 * late**2 / 2 + late**3 / 6)
        assert found.verdict.status == "clean"
        # a motion of 4e-4 keeps the absolute tolerance of 1e-10; stuck bodies creep by F_s/m_r*1e-15 s a second, far less
        assert found.si["x.phi" if turning else "x.x"] == pytest.approx(exact, abs=3e-6 * exact.max())
