"""Machines of planar parts beside independent models in minimal coordinates."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from doc_pages import blocks
from scipy.integrate import solve_ivp

import heavebond as hb
from heavebond.energy_audit.audit import energy as audit

PAGE = Path(__file__).parent.parent / "docs" / "mechanisms.md"
G, BETA = 9.81, 1.4e9


def strand(a: complex, b: complex, r_a: float, r_b: float, theta_0: float) -> tuple[float, complex]:
    """Straight part of a rope on two wheels less what the rims give along with its direction, and the direction: the line
    between the centres, turned by the angle whose sine is the difference of the radii over their distance."""
    line = b - a
    direction = line/abs(line)*np.exp(-1j*np.arcsin((r_a - r_b)/abs(line)))
    turned = np.angle(direction*np.exp(-1j*theta_0))
    return float(np.sqrt(abs(line)**2 - (r_a - r_b)**2) - (r_a - r_b)*turned), direction


class Crane:
    """The bundled crane in complex numbers: y = boom, its rate, sheave, its rate, load's centre (x, y), its velocity, turn,
    rate, pressure. The drum and the pump move as the diagram says."""

    def __init__(self) -> None:
        self.drum_at, self.foot = -1 - 0.6j, 0.8 - 1.2j
        boom = np.radians(30)
        self.l_fall = (8*np.exp(1j*boom)).imag - 0.5 - 2000*G/3e6
        self.l_hoist = strand(self.drum_at, 8*np.exp(1j*boom), 0.2, 0.25, np.radians(30))[0] - 2000*G/1.6e6
        hook = 8*np.exp(1j*boom) + 0.25
        tip = 2000*G*(strand(self.drum_at, hook - 0.25, 0.2, 0.25, 0.5)[1] + 1j)  # what holds the rope at the sheave
        lug, line = self.cylinder(boom)
        load = 1200*G*4*np.cos(boom) + 30*G*8*np.cos(boom) + (np.conj(8*np.exp(1j*boom))*tip).imag
        pressure = load/(np.conj(lug)*line/abs(line)).imag/154e-4
        self.start = [boom, 0, 0, 0, hook.real, 0.5 - 0.6, 0, 0, 0, 0, pressure]

    def cylinder(self, boom: float) -> tuple[complex, complex]:
        lug = (2.5 - 0.3j)*np.exp(1j*boom)
        return lug, lug - self.foot

    def pull(self, stretch: float, speed: float, c: float) -> float:
        e = max(stretch, 0.0)
        return max(c*e + 5e-3*c*speed*min(e/1e-3, 1), 0.0)

    def rates(self, t: float, y: np.ndarray) -> list[float]:
        boom, w, sheave, v, x, z, u_x, u_z, turn, spin, p = y
        share = np.clip((t - 8)/5, 0, 1)
        drum, drum_w = 12*(share - np.sin(2*np.pi*share)/(2*np.pi)), 12/5*(1 - np.cos(2*np.pi*share))
        tip, arm = 8*np.exp(1j*boom), 0.6j*np.exp(1j*turn)
        tip_v, hook, hook_v = 1j*w*tip, x + 1j*z + arm, u_x + 1j*u_z + 1j*spin*arm
        way, up = strand(self.drum_at, tip, 0.2, 0.25, np.radians(30))
        hoist = self.pull(way + 0.2*drum - 0.25*sheave - self.l_hoist,
                          (np.conj(up)*tip_v).real + 0.2*drum_w - 0.25*v, 1.6e6)
        way, down = strand(tip, hook, 0.25, 0, -np.pi/2)
        fall = self.pull(way + 0.25*sheave - self.l_fall, (np.conj(down)*(hook_v - tip_v)).real + 0.25*v, 3e6)
        lug, line = self.cylinder(boom)
        along = line/abs(line)
        speed = (np.conj(along)*1j*w*lug).real
        thrust = 154e-4*p - 2e3*np.tanh(speed/1e-3)
        at_tip = fall*down - hoist*up - 30j*G
        moment = (np.conj(tip)*at_tip).imag - 1200*G*4*np.cos(boom) + thrust*(np.conj(lug)*along).imag
        flow = 1.5e-3*np.interp(t, [1, 1.8, 5.2, 6], [0, 1, 1, 0])
        volume = 1e-3 + 154e-4*(abs(line) - 2.2)
        force = -fall*down
        return [w, moment/(6400 + 1200*16 + 30*64), v, 0.25*(hoist - fall)/1, u_x, u_z, force.real/2000, force.imag/2000 - G,
                spin, (np.conj(arm)*force).imag/400, (flow - 154e-4*speed)*BETA/volume]


@pytest.mark.long
def test_a_crane_with_a_rope_over_its_head() -> None:
    """Boom, sway of the load on the rope, and the pressure in the cylinder; 1e-6 for both integrations."""
    model, crane = hb.load("mechanisms/crane"), Crane()
    found = hb.simulate(model, "12 s")
    assert found["cap.p"][0] == pytest.approx(crane.start[-1], rel=1e-9)
    exact = solve_ivp(crane.rates, (0, 12), crane.start, "LSODA", found.time, rtol=1e-8, atol=1e-9)
    assert exact.success
    assert found["boom.phi"] == pytest.approx(exact.y[0], abs=1e-6)
    hook = exact.y[4] + 1j*exact.y[5] + 0.6j*np.exp(1j*exact.y[8])
    assert found["hook.x"] == pytest.approx(hook.real, abs=1e-6)
    assert found["hook.y"] == pytest.approx(hook.imag, abs=1e-6)
    assert np.ptp(hook.imag) > 2
    assert found["cap.p"] == pytest.approx(exact.y[10], abs=1e2)
    audit(model, "3 s").raise_if_open(1e-6)


def test_a_planetary_gear_by_willis_and_the_inertia_at_its_arm() -> None:
    """The ring held: the sun turns 1 + 110/50 times as fast as the arm; the planet rolls on the sun."""
    text = next(block.text for block in blocks(PAGE) if block.mark == ("file", "planetary.yaml"))
    found = hb.simulate(hb.loads(text))
    ratio = 1 + 110/50
    assert found["sun.w"] == pytest.approx(ratio*found["arm.w"], abs=1e-9)
    planet = 1 - 50/30*(ratio - 1)
    inertia = 0.2 + 0.8*0.08**2 + 4e-4*planet**2
    assert found["arm.w"] == pytest.approx(2*ratio/inertia*found.time, rel=1e-6, abs=1e-9)


ROCKER = """
model: rocker_arms
components:
  derrick: {is: PlanarFixed}
  rail:    {is: PlanarFixed, x_0: 3 m}
  p_1:     {is: RevoluteJoint}
  p_2:     {is: RevoluteJoint}
  p_3:     {is: RevoluteJoint}
  arm_1:   {is: RigidLink, l: 5 m}
  arm_2:   {is: RigidLink, l: 5 m}
  hub:     {is: RevoluteJoint}
  held:    {is: PlanarShaft}
  still:   {is: FixedShaft}
  lower:   {is: RopeStrand, r_a: 0.9 m, r_b: RADIUS, theta_0: 120 deg, c: 1 MN/m, l0: 9 m}
  upper:   {is: RopeStrand, r_a: RADIUS, r_b: 0.9 m, theta_0: 30 deg, c: 1 MN/m, l0: 9 m}
  guide:   {is: PrismaticJoint, alpha: 90 deg}
  base:    {is: Fixed}
  stroke:  {is: PositionSource, u: "=5 m + 3 m*sin(2*pi*time/10 s)"}
nodes:
  derrick: [derrick.a, p_1.a, lower.a]
  arm_1:   [p_1.b, arm_1.a]
  elbow:   [arm_1.b, p_2.a, hub.a]
  sheave:  [hub.b, held.a, lower.b, upper.a]
  still:   [held.s, still.a]
  arm_2:   [p_2.b, arm_2.a]
  end:     [arm_2.b, p_3.a]
  rail:    [rail.a, guide.a]
  crown:   [p_3.b, guide.b, upper.b]
  base:    [base.a, guide.h]
  stroke:  [stroke.a, guide.r]
initial: {arm_1.phi: ~ 120 deg, arm_2.phi: ~ 10 deg}
simulate: {until: 10 s, every: 50 ms}
"""


@pytest.mark.parametrize("radius", [0.9, 0.6])
def test_rocker_arms_keep_the_path_of_the_wire(radius: float) -> None:
    """Of two arms with sheaves of one radius about their pins: the law of RockerArm with k = 1 is exact. A smaller sheave
    in the middle gives its difference of radii times the angle between the arms."""
    found = hb.simulate(hb.loads(ROCKER.replace("RADIUS", f"{radius} m")))
    path = found["lower.s"] + found["upper.s"]
    assert np.ptp(found["crown.y"]) > 5.9
    bend = found["arm_1.phi"] - found["arm_2.phi"]
    straight = 2*np.sqrt(25 - (0.9 - radius)**2)
    # the strands lean against their arms by angles that stay
    assert path - path[0] == pytest.approx(-(0.9 - radius)*(bend - bend[0]), abs=1e-9)
    assert found["lower.l"] + found["upper.l"] == pytest.approx(straight, abs=1e-9)
