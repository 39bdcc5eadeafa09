"""Impacts in closed loops of planar parts beside the equations of Lagrange in their least coordinates, integrated by SciPy.

An impact takes no time: M(q) (q'+ - q'-) = J' P with J = dg/dq of the gap g, and J q'+ = -e J q'-.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import heavebond as hb

Array = NDArray[np.float64]
G = 9.81
H = 1e-5  # of the differences of second order: rounding 1e-11, and as much of the third derivatives


@dataclass(frozen=True)
class Mechanism:
    """Bodies by the positions of their centres of mass and their angles, (3, bodies), and a gap over the coordinates q."""

    bodies: Callable[[Array], Array]
    masses: Array       # (3, bodies): m, m, J
    gap: Callable[[Array], float]
    e: float

    def jacobian(self, q: Array) -> Array:
        """d bodies/d q, (3, bodies, n)."""
        return np.stack([(self.bodies(q + d) - self.bodies(q - d))/(2*H) for d in H*np.eye(len(q))], axis=-1)

    def inertia(self, q: Array) -> Array:
        return self.inertia_by(self.jacobian(q))

    def inertia_by(self, J: Array) -> Array:
        return np.asarray(np.einsum("cbi,cb,cbj->ij", J, self.masses, J))

    def energy(self, q: Array, w: Array) -> float:
        return float(w @ self.inertia(q) @ w)/2 + G*float(self.masses[0] @ self.bodies(q)[1])

    def rate(self, t: float, y: Array) -> Array:
        """Lagrange: M q'' = sum over bodies of J' (m g - m dJ/dt q')."""
        n = len(y)//2
        q, w = y[:n], y[n:]
        J = self.jacobian(q)
        drift = (self.jacobian(q + 1e-4*w) - self.jacobian(q - 1e-4*w))/2e-4 @ w
        force = -self.masses*drift
        force[1] -= G*self.masses[1]
        return np.concatenate([w, np.linalg.solve(self.inertia_by(J), np.einsum("cbi,cb->i", J, force))])

    def struck(self, y: Array) -> Array:
        n = len(y)//2
        q, w = y[:n], y[n:]
        J = np.array([(self.gap(q + d) - self.gap(q - d))/(2*H) for d in H*np.eye(n)])
        give = np.linalg.solve(self.inertia(q), J)
        return np.concatenate([q, w - give*(1 + self.e)*(J @ w)/(J @ give)])

    def run(self, y: Array, until: float) -> tuple[list[float], Callable[[Array], Array]]:
        """The instants of impacts and the motion over time."""
        def touch(t: float, y: Array) -> float:
            return self.gap(y[:len(y)//2])
        touch.terminal, touch.direction = True, -1  # type: ignore[attr-defined]
        t, impacts, pieces = 0.0, [], []
        while t < until:
            # no coordinate turns by more than some hundredths of a radian in a step, so no touch is stepped over
            found = solve_ivp(self.rate, (t, until), y, "DOP853", events=touch, rtol=1e-10, atol=1e-10, max_step=5e-3,
                              dense_output=True)
            pieces.append((t, found.sol))
            t, y = float(found.t[-1]), found.y[:, -1]
            if found.status == 1:
                impacts.append(t)
                y = self.struck(y)
        def at(times: Array) -> Array:
            return np.array([next(sol for begin, sol in reversed(pieces) if begin <= t)(t) for t in times])
        return impacts, at


def crank_and_rod(theta: float, x: float = 0.0) -> tuple[Array, float]:
    """Bodies of a slider-crank whose bearing lies at x, and the way of its piston from there."""
    psi = np.arcsin(-np.sin(theta)/3)
    way = 0.1*np.cos(theta) + 0.3*np.cos(psi)
    return np.array([[x, x + 0.1*np.cos(theta) + 0.15*np.cos(psi), x + way], [0, 0.1*np.sin(theta) + 0.15*np.sin(psi), 0],
                     [theta, psi, 0]]), way


PISTON = np.array([[2, 1, 1.5], [2, 1, 1.5], [0.05, 0.01, 0]])
SLIDER_CRANK = """
  pin:     {is: RevoluteJoint}
  wheel:   {is: PlanarBody, m: 2 kg, J: 0.05 kg*m**2}
  crank:   {is: RigidLink, l: 0.1 m}
  knee:    {is: RevoluteJoint}
  rod:     {is: RigidLink, l: 0.3 m}
  mass:    {is: PlanarBody, m: 1 kg, J: 0.01 kg*m**2, l_g: 0.15 m}
  eye:     {is: RevoluteJoint}
  guide:   {is: PrismaticJoint}
  piston:  {is: PlanarBody, m: 1.5 kg, J: 0}
  frame:   {is: PlanarFixed}
  ground:  {is: Fixed}
  wall:    {is: Fixed}
"""
LOOP = """
  crank:  [pin.b, wheel.a, crank.a]
  tip:    [crank.b, knee.a]
  rod:    [knee.b, mass.a, rod.a]
  end:    [rod.b, eye.a]
  piston: [eye.b, guide.b, piston.a]
  ground: [ground.a, guide.h]
  wall:   [wall.a, stop.a]
"""
STRUCK_PISTON = f"""
model: struck_piston
components:{SLIDER_CRANK}  stop:    {{is: RigidStop, e: 0.6, l0: 0.3 m}}
nodes:{LOOP}  frame:  [frame.a, pin.a, guide.a]
  rail:   [guide.r, stop.b]
initial: {{crank.phi: 40 deg, crank.w: 8 rad/s, rod.phi: ~ -12 deg}}
simulate: {{until: 1 s, every: 1 ms}}
"""
# the same on a cart that slides on a level rail and strikes a wall: two coordinates
STRUCK_CART = f"""
model: struck_cart
components:{SLIDER_CRANK}  rail:    {{is: PrismaticJoint}}
  cart:    {{is: PlanarBody, m: 4 kg, J: 0}}
  track:   {{is: Fixed}}
  spring:  {{is: Spring, c: 2 kN/m}}
  stop:    {{is: RigidStop, e: 0.5, l0: -5 mm}}
nodes:{LOOP}  frame:  [frame.a, rail.a]
  cart:   [rail.b, cart.a, pin.a, guide.a]
  track:  [track.a, rail.h, spring.a]
  buffer: [rail.r, spring.b, stop.b]
  slide:  [guide.r]
initial: {{rail.s: 0 m, rail.r.v: 0 m/s, crank.phi: 40 deg, crank.w: 12 rad/s, rod.phi: ~ -12 deg}}
simulate: {{until: 1 s, every: 1 ms}}
"""
# the piston strikes a plate that yields: momentum goes over into a body that is no part of the loop
STRUCK_BUFFER = f"""
model: struck_buffer
components:{SLIDER_CRANK}  plate:   {{is: Mass, m: 3 kg}}
  spring:  {{is: Spring, c: 500 N/m}}
  post:    {{is: Fixed, x0: 0.38 m}}
  stop:    {{is: RigidStop, e: 0.7, side: -1}}
nodes:{LOOP.replace("wall:   [wall.a, stop.a]", "wall:   [wall.a]")}  frame:  [frame.a, pin.a, guide.a]
  rail:   [guide.r, stop.b]
  plate:  [plate.a, spring.b, stop.a]
  post:   [post.a, spring.a]
initial: {{plate.x: 0.38 m, plate.v: 0 m/s, crank.phi: 40 deg, crank.w: -8 rad/s, rod.phi: ~ -12 deg}}
simulate: {{until: 3 s, every: 1 ms}}
"""
FOUR_BAR = """
model: struck_rocker
components:
  frame:   {is: PlanarFixed}
  left:    {is: RevoluteJoint}
  crank:   {is: RigidLink, l: 0.3 m}
  first:   {is: PlanarBody, m: 2 kg, J: 0.02 kg*m**2, l_g: 0.15 m}
  tip:     {is: RevoluteJoint}
  coupler: {is: RigidLink, l: 0.9 m}
  second:  {is: PlanarBody, m: 1 kg, J: 0.07 kg*m**2, l_g: 0.45 m}
  top:     {is: RevoluteJoint}
  rocker:  {is: RigidLink, l: 0.6 m}
  third:   {is: PlanarBody, m: 1.5 kg, J: 0.05 kg*m**2, l_g: 0.3 m}
  base:    {is: RigidLink, l: 0.8 m}
  right:   {is: RevoluteJoint}
  shaft:   {is: PlanarShaft}
  housing: {is: FixedShaft}
  stop:    {is: RotationalRigidStop, e: 0.4, phi0: 80 deg}
nodes:
  frame:  [frame.a, left.a, base.a]
  one:    [left.b, crank.a, first.a]
  two:    [crank.b, tip.a]
  three:  [tip.b, coupler.a, second.a]
  four:   [coupler.b, top.a]
  five:   [rocker.b, top.b]
  six:    [right.b, rocker.a, third.a, shaft.a]
  corner: [base.b, right.a]
  axle:   [shaft.s, stop.b]
  casing: [housing.a, stop.a]
initial: {one.phi: 60 deg, one.w: 5 rad/s, six.phi: ~ 100 deg, three.phi: ~ 20 deg}
simulate: {until: 4 s, every: 1 ms}
"""


def four_bar(q: Array) -> Array:
    """Its bodies by the intersection of two circles: coupler about the tip of the crank, rocker about its own bearing."""
    tip = 0.3*np.exp(1j*q[0])
    line = 0.8 - tip
    d = abs(line)
    along = (0.9**2 - 0.6**2 + d**2)/(2*d)
    top = tip + line/d*(along + 1j*np.sqrt(0.9**2 - along**2))
    coupler, rocker = (top - tip)/0.9, (top - 0.8)/0.6
    centres = np.array([0.15*np.exp(1j*q[0]), tip + 0.45*coupler, 0.8 + 0.3*rocker])
    return np.array([centres.real, centres.imag, [q[0], np.angle(coupler), np.angle(rocker)]])


def on_cart(q: Array) -> Array:
    bodies, _ = crank_and_rod(q[1], q[0])
    return np.column_stack([bodies, [q[0], 0, 0]])


def with_buffer(q: Array) -> Array:
    bodies, _ = crank_and_rod(q[1])
    return np.column_stack([bodies, [q[0], 0, 0]])


@dataclass(frozen=True)
class Sprung(Mechanism):
    """With a spring at the first coordinate."""

    stiffness: float = 0.0
    rest: float = 0.0

    def rate(self, t: float, y: Array) -> Array:
        found = super().rate(t, y)
        found[2:] += np.linalg.solve(self.inertia(y[:2]), [-self.stiffness*(y[0] - self.rest), 0])
        return found


CASES = {
    "piston": (STRUCK_PISTON,
               Mechanism(lambda q: crank_and_rod(q[0])[0], PISTON, lambda q: crank_and_rod(q[0])[1] - 0.3, 0.6),
               [np.radians(40), 8.0], ["crank.phi", "crank.w"]),
    "cart": (STRUCK_CART, Sprung(on_cart, np.column_stack([PISTON, [4, 4, 0]]), lambda q: q[0] + 5e-3, 0.5, 2e3),
             [0, np.radians(40), 0, 12.0], ["cart.x", "crank.phi", "cart.v_x", "crank.w"]),
    "buffer": (STRUCK_BUFFER, Sprung(with_buffer, np.column_stack([PISTON, [3, 0, 0]]),
                                     lambda q: q[0] - crank_and_rod(q[1])[1], 0.7, 500, 0.38),
               [0.38, np.radians(40), 0, -8.0], ["plate.x", "crank.phi", "plate.v", "crank.w"]),
    "rocker": (FOUR_BAR, Mechanism(four_bar, np.array([[2, 1, 1.5], [2, 1, 1.5], [0.02, 0.07, 0.05]]),
                                   lambda q: four_bar(q)[2, 2] - np.radians(80), 0.4),
               [np.radians(60), 5.0], ["one.phi", "one.w"]),
}


@pytest.mark.long
@pytest.mark.parametrize("name", CASES)
def test_a_closed_loop_that_strikes_a_stop(name: str) -> None:
    text, mechanism, start, signals = CASES[name]
    found = hb.simulate(hb.loads(text), rtol=1e-9)
    until = float(found.time[-1])
    impacts, motion = mechanism.run(np.array(start), until)
    struck = [t for t, event in found.events if event == "stop.impact"]
    assert len(impacts) >= 2
    assert struck == pytest.approx(impacts, abs=1e-6)
    away = np.all(np.abs(found.time[:, None] - np.array(impacts)) > 2e-6, axis=1)  # a speed jumps at an impact
    expected = motion(found.time[away])
    n = len(start)//2
    for k, signal in enumerate(signals):
        # positions and speeds, of their largest value
        size = np.abs(expected[:, k]).max()
        assert np.abs(found.si[signal][away] - expected[:, k]).max() < (2e-6 if k < n else 2e-5)*size, signal


def test_a_mechanism_rests_on_a_stop_and_is_lifted_off() -> None:
    """Without rebound the loop stands still on the stop, held by the motor; the reversed torque takes it off at once."""
    text = STRUCK_PISTON.replace("e: 0.6", "e: 0").replace("  wall:    {is: Fixed}", """  wall:    {is: Fixed}
  shaft:   {is: PlanarShaft}
  motor:   {is: TorqueSource, u: "=if_else(time < 0.5 s, 4 N*m, -4 N*m)"}""")
    text = text.replace("crank:  [pin.b, wheel.a, crank.a]",
                        "crank:  [pin.b, wheel.a, crank.a, shaft.a]\n  axle:   [shaft.s, motor.a]")
    found = hb.simulate(hb.loads(text), "0.8 s", rtol=1e-9)
    t, x, v = found.time, found.si["piston.x"], found.si["crank.w"]
    # at 0.5 s the loop leaves the stop, at which it rests with a speed of rounding: a further impact there has no impulse
    struck, *others = (time for time, event in found.events if event == "stop.impact")
    *first, left = (time for time, event in found.events if event == "stop.lift")
    assert others == pytest.approx([0.5] * len(others), abs=1e-6) and first == pytest.approx([0.5] * len(first), abs=1e-6)
    rests = (t > struck + 1e-6) & (t < 0.5)
    assert np.abs(x[rests] - 0.3).max() < 1e-9
    assert np.abs(v[rests]).max() < 1e-9
    # virtual work while it rests: N dx = M dtheta + weight of the rod
    theta = found.si["crank.phi"][rests][0]
    ways = [crank_and_rod(theta + d) for d in (-H, H)]
    slope, rise = (ways[1][1] - ways[0][1])/(2*H), (ways[1][0][1, 1] - ways[0][0][1, 1])/(2*H)
    assert found.si["stop.N"][rests] == pytest.approx((G*rise - 4)/slope, rel=1e-6)
    assert left == pytest.approx(0.5, abs=1e-6)
    assert x[-1] > 0.301
