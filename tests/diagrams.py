"""Diagrams and components that several tests use."""

ISOLATOR = """model: isolator
parameters: {f: 2 Hz, a: 10 mm}
components:
  shaker:  {is: PositionSource, u: "=a*sin(2*pi*f*time)"}
  spring:  {is: Spring, c: 40 kN/m}
  damper:  {is: Damper, d: 1 kN*s/m}
  machine: {is: Mass, m: 100 kg}
nodes:
  floor:   [shaker.a, spring.a, damper.a]
  machine: [spring.b, damper.b, machine.a]
initial: {machine.x: 0 m, machine.v: 0 m/s}
show: {motion: {is: machine.x, unit: mm}}
simulate: {until: 5 s, every: 10 ms}
"""

FLOOR = """
component: BouncingFloor
summary: Throws back what falls on it.
ports: {a: translational}
parameters:
  e: {unit: 1, min: 0, max: 1, doc: restitution}
variables:
  bounces: {unit: 1, held: 0, min: 0, doc: how often}
equations: |
  a.f = 0   # no force between two impacts
when:
  impact: {condition: a.x < 0, then: {a.v: -e * a.v, bounces: bounces + 1}}
power: controlled, impacts
"""
BALL = """
model: ball
components:
  body:   {is: Mass, m: 2 kg}
  weight: {is: Weight, m: 2 kg, g: 9.80665 m/s**2}
  floor:  {is: BouncingFloor, e: 0.8}
nodes:
  ball: [body.a, weight.a, floor.a]
initial: {ball.x: 1 m, ball.v: 0 m/s}
simulate: {until: 2 s, every: 10 ms}
"""

# a cart on a rail behind a spring, whose foot is moved
CART_RIG = """
model: rig
components:
  foot:   {is: PositionSource, u: "=40 mm*sin(2*pi*time/1.7 s) + 25 mm*sin(2*pi*time/0.9 s)"}
  spring: {is: Spring, c: 60 N/m}
  damper: {is: Damper, d: 3 N*s/m}
  rail:   {is: Fixed}
  cart:   {is: Mass, m: 2.5 kg}
nodes: {base: [foot.a, spring.a], load: [spring.b, damper.b, cart.a], rail: [rail.a, damper.a]}
initial: {load.x: 0 m, load.v: 0 m/s}
"""

PEAKS = """
component: Peaks
summary: Counts the peaks of a sine.
parameters: {w: {unit: 1/s, doc: angular frequency}, level: {unit: 1, doc: what counts as a peak}}
variables:
  x: {unit: 1, doc: sine}
  y: {unit: 1, doc: cosine}
  n: {unit: 1, held: 0, doc: peaks}
equations: |
  der(x) = w * y     # sine
  der(y) = -w * x    # cosine
when:
  peak: {condition: x > level, then: {n: n + 1}}
"""

# K G(z) of 2/(s (s + 1)(s + 2)) with a zero-order hold of 50 ms
SAMPLED_LOOP = """
model: sampled_loop
components:
  e: {is: Sum, k_1: 1, k_2: -1, u_1: "=if_else(time < 0.1 s, 0, 1)"}
  h: {is: SampleHold, T_s: 50 ms}
  k: {is: Gain, k: 2.70}
  g: {is: TransferFunction, b: [0, 0, 0, 2], a: [1, 3, 2, 0]}
nodes: {e: [e.y, h.u], h: [h.y, k.u], u: [k.y, g.u], y: [g.y, e.u_2]}
show: {y: {is: g.y, unit: 1}}
simulate: {until: 200 s, every: 50 ms}
"""

CART = """
model: cart
components:
  wall:   {is: Fixed}
  spring: {is: Spring, c: 1 kN/m}
  damper: {is: Damper, d: 20 N*s/m}
  cart:   {is: Mass, m: 10 kg}
nodes: {wall: [wall.a, spring.a, damper.a], load: [spring.b, damper.b, cart.a]}
initial: {load.x: 20 mm, load.v: 0 m/s}
show: {place: {is: load.x, unit: mm}}
simulate: {until: 1 s, every: 0.1 s}
"""

# 2 L/min out of 2 L of oil: dp/dt = -q beta/V = -250 bar/s from 10 bar, vacuum after 11.01325/250 s
SUCKING = """
model: sucking
components:
  pump: {is: FlowSource, u: -2 L/min}
  oil:  {is: Volume, V: 2 L, beta: 1.5 GPa}
nodes: {oil: [pump.a, oil.a]}
initial: {oil.p: 10 bar}
show: {pressure: {is: oil.p, unit: bar}}
simulate: {until: 2 s, every: 1 ms}
"""
