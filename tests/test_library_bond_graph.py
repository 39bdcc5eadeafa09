"""Elements of bond graphs beside the formulas of Karnopp, Margolis and Rosenberg."""

from __future__ import annotations

import numpy as np
import pytest
from library_check import agree, checks, part, run

import heavebond as hb

E, F = np.array([-3.0, 0.0, 0.5, 7.0]), np.array([2.0, 1.0, -4.0, 0.3])


@checks("TF", "MTF")
def test_transformer() -> None:
    """e_1 = m e_2, f_2 = m f_1 with f_2 counted out of it: what goes in comes out."""
    for found, m in ((part("TF", m=2.5)({"a.f": F, "b.e": E}), 2.5), (part("MTF")({"a.f": F, "b.e": E, "m": 2*F}), 2*F)):
        agree(found["a.e"], m*E)
        agree(-found["b.f"], m*F)


@checks("GY", "MGY")
def test_gyrator() -> None:
    """e_1 = r f_2, e_2 = r f_1 with f_2 counted out of it."""
    for found, r in ((part("GY", r=2.5)({"a.f": F, "b.f": -E}), 2.5), (part("MGY")({"a.f": F, "b.f": -E, "r": 2*F}), 2*F)):
        agree(found["a.e"], r*E)
        agree(found["b.e"], r*F)


@checks("Junction0")
def test_junction_of_one_effort() -> None:
    found = part("Junction0", n=2, m=2)({"a[1].e": E, "a[1].f": F, "a[2].f": 2*F, "b[1].f": E})
    for bond in ("a[2]", "b[1]", "b[2]"):
        agree(found[f"{bond}.e"], E)
    agree(found["b[2].f"], -3*F - E)


@checks("Junction1")
def test_junction_of_one_flow() -> None:
    found = part("Junction1", n=2, m=2)({"a[1].f": F, "a[1].e": E, "a[2].e": 2*E, "b[1].e": F})
    agree(found["a[2].f"], F)
    for bond in ("b[1]", "b[2]"):
        agree(found[f"{bond}.f"], -F)
    agree(found["b[2].e"], 3*E - F)


@checks("Junction1Field")
def test_junction_of_common_flows() -> None:
    """Two multi-bonds of 2 in, two out, by the definition."""
    found = part("Junction1Field", k=2, n=2, m=2)({
        "a[1].f": F, "a[2].f": 2*F, "a[1].e": E, "a[2].e": 3*E, "a[3].e": 2*E, "a[4].e": -E, "b[1].e": F, "b[2].e": 5*F})
    for bond, flow in (("a[3]", F), ("a[4]", 2*F), ("b[1]", -F), ("b[2]", -2*F), ("b[3]", -F), ("b[4]", -2*F)):
        agree(found[f"{bond}.f"], flow)
    agree(found["b[3].e"], 3*E - F)
    agree(found["b[4].e"], 2*E - 5*F)


def oscillator(time: np.ndarray, e: float, inertia: float, R: float, C: float) -> tuple[np.ndarray, np.ndarray]:
    """Flow and effort of C where a step of effort e stands before I, R and C on one flow."""
    decay, swing = R/(2*inertia), np.sqrt(1/(inertia*C) - (R/(2*inertia))**2)
    f = e/(inertia*swing)*np.exp(-decay*time)*np.sin(swing*time)
    return f, e*(1 - np.exp(-decay*time)*(np.cos(swing*time) + decay/swing*np.sin(swing*time)))


@checks("Se", "I", "R", "C")
def test_elements_on_one_flow_swing_as_the_formula_says() -> None:
    """As a bond graph, with k = 2 at the source."""
    result = run("""\
model: bonds
components:
  source: {is: Se, u: 3 W, k: 2}
  one:    {is: Junction1, m: 3}
  mass:   {is: I, I: 2 J}
  spring: {is: C, C: 0.01 s/W}
  damper: {is: R, R: 3 W}
nodes:
  feed:   [source.a, "one.a[1]"]
  mass:   ["one.b[1]", mass.a]
  spring: ["one.b[2]", spring.a]
  damper: ["one.b[3]", damper.a]
simulate: {until: 3 s, every: 10 ms}
""", rtol=1e-9, atol=1e-11)
    f, e = oscillator(result.time, 6.0, 2.0, 3.0, 0.01)
    agree(result["one.f"], f, rtol=1e-6, size=0.5)
    agree(result["spring.a.e"], e, rtol=1e-6, size=6.0)
    agree(result["damper.a.e"], 3*f, rtol=1e-6, size=1.5)


@checks("Sf", "I", "R", "C", "Se")
def test_elements_in_the_other_domains() -> None:
    """Their port takes the effort and the flow of its domain: force, torque, pressure, voltage."""
    result = run("""\
model: domains
components:
  push:  {is: Se, u: 6 N, k: -1}
  mass:  {is: I, I: 2 kg}
  drag:  {is: R, R: 3 N*s/m}
  turn:  {is: Sf, u: 5 rad/s}
  wheel: {is: R, R: 4 N*m*s/rad}
  pump:  {is: Sf, u: 1e-4 m**3/s, k: -1}
  oil:   {is: C, C: 1e-11 m**3/Pa}
  cell:  {is: Sf, u: 2 A, k: -1}
  coil:  {is: I, I: 0.5 H}
  wire:  {is: R, R: 10 V/A}
  brake: {is: R, R: 2 N*s/m}
  lamp:  {is: R, R: 1 V/A}
  earth: {is: ElectricalGround}
  v_1: {is: VelocitySensor}
  v_2: {is: VelocitySensor}
  w_1: {is: ShaftSpeedSensor}
  p_1: {is: PressureSensor}
  u_1: {is: VoltageSensor}
  u_2: {is: VoltageSensor}
nodes:
  body:   [mass.a, drag.a, v_1.a]
  still:  [push.a, brake.a, v_2.a]
  shaft:  [turn.a, wheel.a, w_1.a]
  hose:   [pump.a, oil.a, p_1.a]
  clamp:  [cell.a, wire.a, u_1.b]
  second: [coil.a, lamp.a, u_2.b]
  zero:   [earth.a, u_1.a, u_2.a]
initial: {body.v: 4 m/s, oil.a.p: 0 Pa, coil.a.i: 3 A}
simulate: {until: 1 s, every: 10 ms}
""", rtol=1e-9, atol=1e-11)
    t = result.time
    agree(result["body.v"], 4*np.exp(-1.5*t), rtol=1e-6, size=4.0)          # m v' = -R v
    agree(result["brake.a.f"], 6.0, size=6.0)                               # the source takes -6 N
    agree(result["wheel.a.tau"], 20.0)
    agree(result["hose.p"], 1e7*t, rtol=1e-6, size=1e7)
    agree(result["clamp.v"], 20.0)
    agree(result["coil.a.i"], 3*np.exp(-2*t), rtol=1e-6, size=3.0)          # L i' = -R i around the loop


MATRIX = np.array([[2.0, 0.5], [-1.5, 3.0]])
ROWS = "[2{0}, 0.5{0}, -1.5{0}, 3{0}]"


@checks("TFField")
def test_transformer_of_a_multi_bond() -> None:
    """f_2 = T f_1 with f_2 counted out of it, e_1 = T' e_2; three bonds in, two out."""
    law = part("TFField", n=3, m=2, T="[1, 2, 3, 4, 5, 6]")
    matrix = np.array([[1, 2, 3], [4, 5, 6]])
    found = law({"a[1].f": F, "a[2].f": 2*F, "a[3].f": 1.0, "b[1].e": E, "b[2].e": 3.0})
    flows, efforts = matrix @ [F, 2*F, 0*F + 1], matrix.T @ [E, 0*E + 3]
    for k in range(2):
        agree(-found[f"b[{k + 1}].f"], flows[k])
    for k in range(3):
        agree(found[f"a[{k + 1}].e"], efforts[k])


@checks("GYField")
def test_gyrator_of_a_multi_bond() -> None:
    """e_2 = G f_1, e_1 = G' f_2 with f_2 counted out of it."""
    law = part("GYField", n=3, m=2, G="[1 W, 2 W, 3 W, 4 W, 5 W, 6 W]")
    matrix = np.array([[1, 2, 3], [4, 5, 6]])
    found = law({"a[1].f": F, "a[2].f": 2*F, "a[3].f": 1.0, "b[1].f": -E, "b[2].f": -3.0})
    out, back = matrix @ [F, 2*F, 0*F + 1], matrix.T @ [E, 0*E + 3]
    for k in range(2):
        agree(found[f"b[{k + 1}].e"], out[k])
    for k in range(3):
        agree(found[f"a[{k + 1}].e"], back[k])


@checks("MTFField", "MGYField", "MRField")
def test_fields_that_a_matrix_signal_modulates() -> None:
    """f_2 = T f_1, e_1 = T' e_2; e_2 = G f_1, e_1 = G' f_2; e = R_0 L L' f."""
    matrix = np.array([[1.0, 2, 3], [4, 5, 6]])
    given = {f"{{}}[{i + 1}][{j + 1}]": matrix[i, j] for i in range(2) for j in range(3)}
    flows = {"a[1].f": F, "a[2].f": 2*F, "a[3].f": 1.0}
    f = np.array([F, 2*F, 0*F + 1])
    found = part("MTFField", n=3, m=2)({**flows, "b[1].e": E, "b[2].e": 3.0, **{k.format("T"): v for k, v in given.items()}})
    agree([-found["b[1].f"], -found["b[2].f"]], matrix @ f)
    agree([found[f"a[{k + 1}].e"] for k in range(3)], matrix.T @ [E, 0*E + 3])
    found = part("MGYField", n=3, m=2)(
        {**flows, "b[1].f": -E, "b[2].f": -3.0, **{k.format("G"): v for k, v in given.items()}})
    agree([found["b[1].e"], found["b[2].e"]], matrix @ f)
    agree([found[f"a[{k + 1}].e"] for k in range(3)], matrix.T @ [E, 0*E + 3])
    square = {k.format("L"): v for k, v in given.items() if "[3]" not in k}
    found = part("MRField", n=2, R_0="5 W")({"a[1].f": F, "a[2].f": 2*F, **square})
    agree([found["a[1].e"], found["a[2].e"]], 5*matrix[:, :2] @ matrix[:, :2].T @ f[:2])


@checks("MCField", "MIField")
def test_stores_that_a_displacement_modulates_take_its_power() -> None:
    """Efforts are the derivatives of the energy; the port of the modulation has that of the displacement."""
    k_0, k_1 = np.array([[5.0, -1], [-1, 4]]), np.array([[2.0, 0.5], [0.5, 1]])
    q, x = np.array([1.5, -2.0]), 0.7
    found = part("MCField", n=2, K_0="[[5 W/s, -1 W/s], [-1 W/s, 4 W/s]]",
                 K_1="[[2 W/s**2, 0.5 W/s**2], [0.5 W/s**2, 1 W/s**2]]")(
        {"q[1]": q[0], "q[2]": q[1], "x": x, "a[1].f": 1.0, "a[2].f": 2.0, "m.f": 3.0})
    agree([found["a[1].e"], found["a[2].e"]], (k_0 + x*k_1) @ q)
    agree(found["m.e"], q @ k_1 @ q/2)
    f = np.array([1.5, -2.0])
    p = (k_0 + x*k_1) @ f
    found = part("MIField", n=2, M_0="[[5 W*s, -1 W*s], [-1 W*s, 4 W*s]]", M_1="[[2 W, 0.5 W], [0.5 W, 1 W]]")(
        {"p[1]": p[0], "p[2]": p[1], "x": x, "a[1].e": 1.0, "a[2].e": 2.0, "m.f": 3.0})
    agree([found["a[1].f"], found["a[2].f"]], f)
    # of the energy p' M^-1 p/2 by differences, at constant momenta
    h = 1e-6
    energy = [p @ np.linalg.solve(k_0 + (x + d)*k_1, p)/2 for d in (h, -h)]
    agree(found["m.e"], (energy[0] - energy[1])/(2*h), 1e-6)


@checks("RField", "CField", "IField")
def test_fields() -> None:
    efforts = MATRIX @ [F, 3*F]
    found = part("RField", n=2, R=ROWS.format(" W"))({"a[1].f": F, "a[2].f": 3*F})
    agree(found["a[2].e"], efforts[1])
    symmetric = np.array([[2.0, -1], [-1, 3]])
    stored = part("CField", n=2, K="[2 W/s, -1 W/s, -1 W/s, 3 W/s]")({"q[1]": F, "q[2]": 3*F, "a[1].f": E, "a[2].f": 1.0})
    agree(stored["a[2].e"], (symmetric @ [F, 3*F])[1])
    agree(stored["der(q[1])"], E)
    moving = part("IField", n=2, M="[2 W*s, -1 W*s, -1 W*s, 3 W*s]")(
        {"p[1]": (symmetric @ [F, 3*F])[0], "p[2]": (symmetric @ [F, 3*F])[1], "a[1].e": E, "a[2].e": 1.0})
    agree(moving["a[1].f"], F)
    agree(moving["der(p[2])"], 1.0)


@pytest.mark.parametrize(("kind", "values", "rule"), [
    ("CField", "K: [1 W/s, 2 W/s, 0 W/s, 1 W/s]", "symmetric(K)"),
    ("CField", "K: [1 W/s, 2 W/s, 2 W/s, 1 W/s]", "semidefinite(K)"),
    ("IField", "M: [1 W*s, 1 W*s, 1 W*s, 1 W*s]", "definite(M)"),
    ("RField", "R: [1 W, 9 W, -3 W, 1 W]", "semidefinite(R)"),
])
def test_a_matrix_that_would_make_energy_is_refused(kind: str, values: str, rule: str) -> None:
    with pytest.raises(hb.ModelError) as caught:
        hb.assemble(hb.loads(f"""
model: refused
components:
  field: {{is: {kind}, n: 2, {values}}}
  loss:  {{is: RField, n: 2, R: [1 W, 5 W, -5 W, 0 W]}}
nodes: {{bonds: [field.a, loss.a]}}
"""))
    text = str(caught.value)
    assert rule in text
    assert "field" in text
    assert "loss" not in text.splitlines()[0]


def test_a_singular_stiffness_is_allowed() -> None:
    found = run("""
model: held_apart
components:
  field: {is: CField, n: 2, K: [3 W/s, -3 W/s, -3 W/s, 3 W/s]}
  brake: {is: RField, n: 2, R: [1 W, 5 W, -5 W, 0 W]}
nodes: {bonds: [field.a, brake.a]}
initial: {"field.q[1]": 1 s}
simulate: {until: 1 s}
""")
    agree(found["bonds[1].e"], -found["bonds[2].e"])
