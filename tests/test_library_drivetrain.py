"""Differential, worm, screw, cam, clutches, drum, tyre and pressed friction beside formulas of their sources."""

from __future__ import annotations

import numpy as np
import pytest
from examples import Array, Case, check
from library_check import agree, checks, part, run

PI = np.pi
SPEEDS = np.array([-30.0, -2, -0.003, 0, 0.003, 2, 30])


def friction_angle(mu: float, flank: float) -> float:
    """Apparent angle of friction of an inclined flank, rad."""
    return float(np.arctan(mu/np.cos(np.radians(flank))))


def follower(t: Array) -> Array:
    """Position of the follower of the example, m."""
    phi = 20*t
    return np.asarray(0.02 - 0.01*np.cos(phi) + 0.001*np.cos(2*phi) + 0.002*np.sin(2*phi))


def cam_power(t: Array) -> Array:
    """Torque of the camshaft: the power of the inertia of 2 kg over the speed of the shaft."""
    phi = 20*t
    v = 20*(0.01*np.sin(phi) - 0.002*np.sin(2*phi) + 0.004*np.cos(2*phi))
    a = 400*(0.01*np.cos(phi) - 0.004*np.cos(2*phi) - 0.008*np.sin(2*phi))
    return np.asarray(2*a*v/20)


def magic(slip: Array, load: float, mu: float) -> Array:
    y = 10*slip
    return np.asarray(load*mu*np.sin(1.9*np.arctan(y - 0.97*(y - np.arctan(y)))))


def housing(t: Array) -> Array:
    """Angle of the housing: the torque at it is -a - b = (i - 1) M on an inertia, which the wheel changes by the ratio.

    With a.w = h + i (b - h) and the motor without inertia: 10 b' = 5 M, 0.4 h' = -4 M - c h."""
    return np.asarray(-40/20e3*(1 - np.cos(np.sqrt(20e3/0.4)*t)))


LIFTING, WINDING = friction_angle(0.12, 15), friction_angle(0.08, 20)
HELIX, GAMMA = np.arctan(6/(PI*27)), np.radians(4)
SETTLED = "textbook; the elastic flank settles with its time constant of 1 ms"
RUN = "closed form; 1e-6 for the integration"
# Tr 40 x 7: mean diameter 36.5 mm; two screws share shaft and beam
TR_40, TR_FRICTION = np.arctan(7/(PI*36.5)), friction_angle(0.12, 15)
SCREW = 36.5e-3/2*np.tan(TR_40 + TR_FRICTION)      # torque per force
PRESS = (60 - 400*9.81*SCREW)/(400*SCREW + 0.05*2*PI/7e-3)
LAW = "the law at a prescribed motion; nothing is integrated"
CASES = [
    Case("differential", "left.w", lambda t: 4/2*10/2*t, RUN),
    Case("differential", "right.w", lambda t: 4/2*10/4*t, RUN),
    # raising a load F takes the torque F d_2/2 tan(helix + friction angle)
    Case("power_screw", "part.a.tau", lambda t: 10e3*0.027/2*np.tan(HELIX + LIFTING) + 0*t, SETTLED, begin=0.1),
    Case("trapezoidal_thread", "beam.x", lambda t: PRESS*t**2/2, "the rigid press; the threads yield by 8 um", 1e-3),
    # efficiency tan(gamma)/tan(gamma + friction angle)
    Case("worm_gear", "part.a.tau", lambda t: 200/40*np.tan(GAMMA + WINDING)/np.tan(GAMMA) + 0*t, SETTLED, begin=0.1),
    Case("cam", "follower.x", follower, LAW),
    Case("cam", "part.a.tau", cam_power, "power of the inertia"),
    # half a swing at 10 rad/s, then free with twice the speed of the drive
    Case("one_way_clutch", "wheel.w", lambda t: np.where(t < PI/10, 2 - 2*np.cos(10*t), 4), RUN),
    Case("locking_clutch", "wheel.w", lambda t: np.minimum(2*t, 10), RUN),
    # 2 m/s**2 from 0.1 s on; then 15 N hold against the push
    Case("locking_brake", "sledge.v", lambda t: np.clip(1 - 2*(t - 0.1), 0, 1), RUN),
    Case("locking_brake", "part.F", lambda t: np.where(t < 0.1, 0, np.where(t < 0.6, 20, np.where(t < 0.8, 0, 15))), RUN),
    # the brake torque of 4 N*m and the load of 1 N*m slow 2 kg*m**2 down to the drive, which then holds the load
    Case("locking_one_way_clutch", "wheel.w", lambda t: np.maximum(7 - 2.5*t, 2), RUN),
    Case("locking_one_way_clutch", "part.M", lambda t: np.where(t < 2, 4, -1), RUN),
    # the support turns back by the torque -(1 - 5) 10 N*m, as a spring and an inertia do: 1 - cos
    Case("gear_with_housing", "housing.phi", housing, RUN, 1e-4),
    Case("winch_drum", "part.r", lambda t: 0.21 + 0.866*0.02*(1 + np.tanh((t - 5)/0.25))/2, RUN),
    # the change of the layer is odd about its middle: nine turns are five of one radius and four of the next
    Case("winch_drum", "rope.x", lambda t: 2*PI*(5*0.21 + 4*(0.21 + 0.866*0.02)) + 0*t, RUN, begin=9),
    Case("tyre", "part.F", lambda t: magic(0.3*t/np.sqrt(1 + 1e-4), 4e3, 0.9), LAW),
    Case("pressed_friction", "part.F", lambda t: 0.4*500*t*np.tanh(0.04*PI*np.cos(2*PI*t)/1e-3), LAW),
    Case("pneumatic_seal_friction", "part.F", lambda t: 2e-4*6e5*np.tanh(0.04*PI*np.cos(2*PI*t)/1e-3), LAW),
]


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.example}-{case.signal}")
def test_the_example_shows_the_law(case: Case) -> None:
    check(case)


@checks("GearWithHousing")
def test_a_gear_with_a_housing_conserves_power_and_torque() -> None:
    found = part("GearWithHousing", i=-3)({"a.tau": 7.0, "b.w": 4 + SPEEDS, "h.w": 4})
    agree(found["a.w"], 4 - 3*SPEEDS)
    agree(found["b.tau"], 21)
    agree(found["h.tau"], -28)
    agree(found["a.tau"]*found["a.w"] + found["b.tau"]*found["b.w"] + found["h.tau"]*found["h.w"], 0, size=100.0)


@checks("LockingBrake", "LockingOneWayClutch")
def test_sliding_brakes_and_overrun_clutches_have_the_torque_of_their_pressure() -> None:
    for u, force in ((-5.0, 0.0), (0.0, 0.0), (8.0, 2.4)):
        for mode in (-1.0, 1.0):
            found = part("LockingBrake", mu=0.3)({"u": u, "a.v": 1, "b.v": 1 + mode*np.array([0.1, 3]), "mode": mode,
                                                   "limit": 0, "der(v)": 0})
            agree([found["b.f"], -found["a.f"]], mode*force)
    for u, torque in ((-1.0, 0.0), (0.25, 3.0), (4.0, 12.0)):
        found = part("LockingOneWayClutch", M_max="12 N*m")({"u": u, "a.w": 1, "b.w": 1 + np.array([0.1, 3]), "mode": 1,
                                                                 "limit": 0, "der(w)": 0})
        agree([found["b.tau"], -found["a.tau"]], torque)


def test_a_freewheel_without_engagement_takes_a_wheel_along_and_lets_it_overrun() -> None:
    """A drive that swings: the wheel has the speed of the drive as it rises, and keeps its top."""
    found = run("""
model: freewheel
components:
  drive: {is: SpeedSource, u: "=3 rad/s*sin(2*pi*time/4 s)"}
  part:  {is: LockingOneWayClutch, M_max: 8 N*m, u: 0}
  wheel: {is: Inertia, J: 2 kg*m**2}
nodes: {drive: [drive.a, part.a], wheel: [part.b, wheel.a]}
initial: {wheel.w: 0 rad/s}
simulate: {until: 4 s, every: 10 ms}
""")
    # 1e-5: while locked, the shafts creep by 1e-12 of the torque, and the instant of release is found to 1e-6
    agree(found["wheel.w"], np.where(found.time < 1, 3*np.sin(PI/2*found.time), 3), 1e-5, size=3.0)


@checks("Differential")
def test_a_differential_divides_the_torque_and_locks_by_its_friction() -> None:
    found = part("Differential", i=3.5, M_l="60 N*m")({"s.tau": 100, "a.w": 5 + SPEEDS, "b.w": 5})
    agree(found["s.w"], 3.5*(5 + SPEEDS/2))
    lock = 60*np.tanh(SPEEDS/0.01)
    agree(found["a.tau"] - found["b.tau"], lock)   # the faster one is loaded
    agree(found["a.tau"] + found["b.tau"], -350)


@checks("WormGear", "PowerScrew")
@pytest.mark.parametrize("mu", [0.03, 0.15])
@pytest.mark.parametrize("load", [-300.0, 300.0])
def test_worm_and_screw_have_the_efficiencies_of_textbooks(mu: float, load: float) -> None:
    """Against the load tan(gamma + rho)/tan(gamma), with it tan(gamma - rho): below zero it has to be turned down."""
    gamma, rho = np.radians(5), friction_angle(mu, 20)
    law = part("WormGear", i=30, gamma="5 deg", mu=mu, c="1e6 N*m/rad", d=0)
    for way in (1, -1):
        # both shafts turn at once, as in a settled run
        found = law({"b.tau": load, "a.w": way*60, "b.w": way*2}, {"M": -load, "e": -load/1e6})
        driven = way*load < 0      # the torque on the wheel is what it gives away
        agree(found["a.tau"], -load/30*np.tan(gamma + (rho if driven else -rho))/np.tan(gamma))
    helix, rho = np.arctan(5/(PI*20)), friction_angle(mu, 15)
    law = part("PowerScrew", h="5 mm", d_2="20 mm", mu=mu, c="1e8 N/m", d=0)
    for way in (1, -1):
        w = way*10.0
        found = law({"b.f": load, "a.w": w, "b.v": w*5e-3/(2*PI)}, {"S": -load, "e": -load/1e8})
        driven = way*load < 0
        agree(found["a.tau"], -load*0.01*np.tan(helix + (rho if driven else -rho)))


@checks("PowerScrew")
def test_a_screw_holds_its_load_if_the_friction_angle_exceeds_the_helix_angle() -> None:
    """Tr 20 x 5 has a helix angle of 4.5 deg: with 0.15 the load stays, with 0.03 it runs down."""
    for mu, drops in ((0.15, False), (0.03, True)):
        found = run(f"""
model: hoist
components:
  screw:  {{is: PowerScrew, h: 5 mm, d_2: 20 mm, mu: {mu}, c: 20 kN/mm}}
  rotor:  {{is: Inertia, J: 1e-3 kg*m**2}}
  load:   {{is: Mass, m: 100 kg}}
  weight: {{is: Weight, m: 100 kg}}
nodes: {{shaft: [screw.a, rotor.a], nut: [screw.b, load.a, weight.a]}}
initial: {{shaft.phi: 0 rad, shaft.w: 0 rad/s, nut.x: -49 um, nut.v: 0 m/s}}
simulate: {{until: 0.3 s}}
""")
        turned = found["shaft.phi"][-1]
        assert turned < -10 if drops else abs(turned) < 1e-2
        # energy: without friction the weight would turn the rotor by this much
        assert turned > -0.5*100*9.81*5e-3/(2*PI)/1e-3*0.3**2
    agree(1.0, 1.0)


@checks("TrapezoidalThread")
def test_a_thread_by_its_designation_has_the_dimensions_of_the_standard() -> None:
    """ISO 2904: Tr 20 x 4 has d_2 = 18 mm, Tr 40 x 14 P7 of two starts d_2 = 36.5 mm."""
    for d_n, pitch, starts, d_2 in ((20, 4, 1, 18), (40, 7, 2, 36.5)):
        found = run(f"""
model: thread
components:
  thread: {{is: TrapezoidalThread, d_n: {d_n} mm, P: {pitch} mm, starts: {starts}, mu: 0.1}}
  screw:  {{is: PowerScrew, data: thread, c: 1 MN/m}}
  rotor:  {{is: Inertia, J: 1 kg*m**2}}
  load:   {{is: Mass, m: 1 kg}}
nodes: {{shaft: [screw.a, rotor.a], nut: [screw.b, load.a]}}
show: {{d_2: {{is: screw.d_2, unit: m}}, h: {{is: screw.h, unit: m}}}}
simulate: {{until: 1 ms}}
""")
        agree(found["screw.d_2"], d_2*1e-3)
        agree(found["screw.h"], starts*pitch*1e-3)


@checks("Cam", "WinchDrum")
def test_cam_and_drum_keep_the_power() -> None:
    angle = np.linspace(-3, 3, 7)
    found = part("Cam", l0="5 mm", c="[3 mm, 1 mm]", s="[0 mm, -2 mm]")({"a.phi": angle, "a.w": 7, "b.f": 50})
    agree(found["b.x"], 0.005 + 0.003*np.cos(angle) + 0.001*np.cos(2*angle) - 0.002*np.sin(2*angle))
    slope = -0.003*np.sin(angle) - 0.002*np.sin(2*angle) - 0.004*np.cos(2*angle)
    agree(found["a.tau"], -50*slope)
    turns = np.array([0.0, 2, 4, 6, 12, 20])
    drum = part("WinchDrum", n=3, D="300 mm", d="16 mm", z=4, z_0=2, dn=0.01)(
        {"a.phi": 2*PI*(turns - 2), "a.w": 3, "b.f": -1e3})
    layers = np.array([0, 0, 0.5, 1, 2, 2])   # four turns each
    agree(drum["r"], 0.158 + 0.866*0.016*layers)
    agree(drum["a.tau"], 1e3*drum["r"])
    agree(drum["b.v"], 3*drum["r"])


@checks("OneWayClutch")
def test_a_one_way_clutch_pushes_in_one_direction_only() -> None:
    law = part("OneWayClutch", c="100 N*m/rad", d="2 N*m*s/rad")
    for theta, w in ((0.1, 3), (0.1, -3), (0.1, -8), (0.0, 0)):
        found = law({"a.w": 5 + w, "b.w": 5, "theta": theta, "on": 1})
        agree([found["a.tau"], found["b.tau"]], np.array([1, -1])*max(100*theta + 2*w, 0), size=1)
        agree(found["der(theta)"], w, size=1)
    off = law({"a.w": SPEEDS, "b.w": 0, "theta": 0, "on": 0})
    agree([off["a.tau"], off["der(theta)"]], 0, size=1)


def test_a_freewheel_rectifies_a_swing() -> None:
    """A hand swings to and fro; the wheel follows forwards and is never pulled back."""
    found = run("""
model: ratchet
components:
  hand:  {is: AngleSource, u: "=0.5 rad*(1 - cos(2*pi*time/1 s))"}
  part:  {is: OneWayClutch, c: 10 kN*m/rad, d: 100 N*m*s/rad}
  wheel: {is: Inertia, J: 1 kg*m**2}
  brake: {is: RotationalDamper, d: 0.01 N*m*s/rad}
  floor: {is: FixedShaft}
nodes: {hand: [hand.a, part.a], wheel: [part.b, wheel.a, brake.b], floor: [brake.a, floor.a]}
initial: {wheel.w: 0 rad/s}
simulate: {until: 3 s, every: 1 ms}
""")
    speed = found["wheel.w"]
    top = 0.5*2*PI
    # the drive's top speed, and at most what the elastic sprags add; a bearing that drags at 0.01/s
    assert speed.min() > -1e-6
    assert top*np.exp(-0.01*3) < speed[-1] < top*1.1


@checks("LockingClutch")
def test_a_clutch_locks_two_wheels_and_slips_where_it_is_overloaded() -> None:
    """2 and 3 kg*m**2 at 10 and 0 rad/s: both 4 rad/s after the clutch has taken 12 kg*m**2/s, at 6 N*m in 2 s."""
    found = run("""
model: shafts
components:
  first:  {is: Inertia, J: 2 kg*m**2}
  clutch: {is: LockingClutch, M_max: 12 N*m, k_s: 1.5, u: 0.5}
  second: {is: Inertia, J: 3 kg*m**2}
  load:   {is: TorqueSource, u: "=if_else(time < 3 s, 0 N*m, -10 N*m * (time - 3 s)/1 s)"}
nodes: {first: [first.a, clutch.a], second: [clutch.b, second.a, load.a]}
initial: {first.w: 10 rad/s, second.w: 0 rad/s}
simulate: {until: 5.5 s, every: 5 ms}
""")
    t, one, two = found.time, found["first.w"], found["second.w"]
    slipping, locked = t < 1.99, (t > 2.01) & (t < 3)
    agree(one[slipping], 10 - 3*t[slipping], rtol=1e-6)
    agree(two[slipping], 2*t[slipping], rtol=1e-6, size=4.0)
    agree(one[locked], 4.0, rtol=1e-6)
    agree(two[locked], 4.0, rtol=1e-6)
    # two fifths of the load go through the clutch; 9 N*m are exceeded at 22.5 N*m, 2.25 s later
    assert [time for time, name in found.events if name == "clutch.backward"] == pytest.approx([5.25], abs=1e-5)
    after = t > 5.26
    agree(np.gradient(one[after], t[after])[1:-1], -6/2, rtol=1e-4)


@checks("Tyre")
def test_a_tyre_peaks_at_its_friction_and_drags_when_locked() -> None:
    law = part("Tyre", r="0.3 m", mu=0.9, c_r=0.01, v_t="1e-6 m/s")
    slips = np.array([-1, -0.2, -0.01, 0, 0.01, 0.5])
    found = law({"b.v": 20, "a.w": (1 + slips)*20/0.3, "u": 5e3})
    agree(found["F"], magic(slips, 5e3, 0.9), size=4.5e3)
    agree(found["b.f"], -magic(slips, 5e3, 0.9), size=4.5e3)
    rolling = 0.01*5e3*0.3*np.tanh((1 + slips)*20/0.3/0.01)
    agree(found["a.tau"], 0.3*magic(slips, 5e3, 0.9) + rolling, size=1e3)
    forces = law({"b.v": 20, "a.w": np.linspace(1, 1.5, 501)*20/0.3, "u": 5e3})["F"]
    agree(forces.max(), 0.9*5e3, rtol=1e-4)
    agree(law({"b.v": 20, "a.w": 0, "u": -1})["F"], 0, size=1)


@checks("PressedFriction", "PneumaticSealFriction")
def test_friction_follows_what_presses() -> None:
    found = part("PressedFriction", mu=0.3, v_t="1 mm/s")({"a.v": 1, "b.v": 1 + SPEEDS, "u": 400})
    agree(found["b.f"], 120*np.tanh(SPEEDS/1e-3))
    agree(found["a.f"], -120*np.tanh(SPEEDS/1e-3))
    agree(part("PressedFriction", mu=0.3)({"a.v": 0, "b.v": 1, "u": -5})["F"], 0, size=1)
    law = part("PneumaticSealFriction", k_p="1e-4 m**2")
    found = law({"a.v": 0, "b.v": SPEEDS, "p.p": 501325, "p.T": 300})
    agree(found["b.f"], 40*np.tanh(SPEEDS/1e-3))
    agree([found["p.m"], found["p.H"]], 0, size=1)
    agree(law({"a.v": 0, "b.v": 1, "p.p": 5e4, "p.T": 300})["F"], 0, size=1)
