"""What the diagram language means: variants, blocks, many of a kind, generic ports, inputs from outside."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import heavebond as hb

CHAIN = """
model: chain
parameters: {n: 4}
components:
  wall: {is: Fixed}
  seg:  {is: Segment, repeat: =n, m: 2 kg, c: 500 N/m}
nodes:
  top: [wall.a, seg.a]
  end: [seg.b]
initial: {end.x: 10 mm}
simulate: {until: 2 s, every: 10 ms}
"""

SEGMENT = """
component: Segment
summary: A spring with a mass at its lower end.
ports: {a: translational, b: translational}
parameters:
  m: {unit: kg, min: 0, doc: mass}
  c: {unit: N/m, min: 0, doc: stiffness}
components:
  spring: {is: Spring, c: =c}
  mass:   {is: Mass, m: =m}
nodes:
  top:    [a, spring.a]
  bottom: [b, spring.b, mass.a]
"""

# The same by hand, in coordinates along the chain.
BY_HAND = """
model: by_hand
components:
  wall: {is: Fixed}
  s1: {is: Spring, c: 500 N/m}
  s2: {is: Spring, c: 500 N/m}
  s3: {is: Spring, c: 500 N/m}
  s4: {is: Spring, c: 500 N/m}
  m1: {is: Mass, m: 2 kg}
  m2: {is: Mass, m: 2 kg}
  m3: {is: Mass, m: 2 kg}
  m4: {is: Mass, m: 2 kg}
nodes:
  top: [wall.a, s1.a]
  n1: [s1.b, m1.a, s2.a]
  n2: [s2.b, m2.a, s3.a]
  n3: [s3.b, m3.a, s4.a]
  end: [s4.b, m4.a]
initial: {end.x: 10 mm}
simulate: {until: 2 s, every: 10 ms}
"""

JUNCTION = """
component: Junction0
summary: A 0-junction - one effort, the flows sum to zero.
ports:
  p: {domain: $D, count: n, doc: bonds}
parameters:
  n: {integer, min: 2, doc: number of bonds}
equations: |
  each i in 2..n: p[i].effort = p[1].effort   # one effort
  sum(p.flow) = 0                             # flows balance
"""

RESISTOR = """
component: Resistor
summary: A linear resistance between two ports of any one domain.
ports: {a: $D, b: $D}
parameters:
  R: {unit: $D.effort/$D.flow, min: 0, doc: resistance}
equations: |
  a.effort - b.effort = R * a.flow   # Ohm's law
  a.flow + b.flow = 0                # nothing is kept
dissipates: (a.effort - b.effort) * a.flow
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, text in (("segment", SEGMENT), ("junction0", JUNCTION), ("resistor", RESISTOR)):
        (tmp_path / f"{name}.yaml").write_text(text, encoding="utf-8")
    return tmp_path


def test_repeat_joins_one_to_the_next(folder: Path) -> None:
    repeated = hb.simulate(hb.loads(CHAIN, folder))
    by_hand = hb.simulate(hb.loads(BY_HAND, folder))
    assert np.abs(repeated["end.x"] - by_hand["end.x"]).max() < 1e-9
    assert np.abs(repeated["seg_2.b.x"] - by_hand["n2.x"]).max() < 1e-9
    assert len(repeated.assembly.state_names) == 8


def test_repeat_follows_a_parameter(folder: Path) -> None:
    longer = hb.loads(CHAIN, folder).with_parameters({"n": 7})
    assert len(hb.assemble(longer).state_names) == 14


def test_equal_parts_are_checked_together_and_told_one_by_one(folder: Path) -> None:
    """Units and numbers of equal parts are found once: each has values of its own all the same, and an error for each."""
    model = hb.loads(CHAIN, folder)
    assembly = hb.assemble(model)
    assert [assembly.parameter_values[f"seg_{k}.m"] for k in range(1, 5)] == [2.0] * 4
    heavy = assembly.with_parameters({"seg_3.m": 5.0}).parameter_values
    assert [heavy[f"seg_{k}.m"] for k in range(1, 5)] == [2.0, 2.0, 5.0, 2.0]
    for wrong, code in (("=n*2 s", "unit-wrong"), ("=1 kg/(2 - 2)", "value-not-finite")):
        with pytest.raises(hb.ModelError) as told:
            hb.assemble(hb.loads(CHAIN.replace("m: 2 kg", f'm: "{wrong}"'), folder))
        own = [problem.message for problem in told.value.problems if problem.code == code]
        assert len(own) == 4 and all(any(f"seg_{k}.m" in message for message in own) for k in range(1, 5)), wrong


def test_a_formula_that_vanishes_for_one_part_is_kept_for_its_like(folder: Path) -> None:
    """`c: =k_1 - k_2` is nothing in the first of two equal blocks, where both are one parameter."""
    (folder / "both.yaml").write_text(SEGMENT.replace("component: Segment", "component: Both").replace(
        "  c: {unit: N/m, min: 0, doc: stiffness}", "  k_1: {unit: N/m, doc: one}\n  k_2: {unit: N/m, doc: other}").replace(
        "c: =c", "c: =k_1 - k_2"), encoding="utf-8")
    text = CHAIN.replace("parameters: {n: 4}", "parameters: {p: 700 N/m, q: 200 N/m}").replace(
        "  seg:  {is: Segment, repeat: =n, m: 2 kg, c: 500 N/m}",
        "  none: {is: Both, m: 2 kg, k_1: =p, k_2: =p}\n  seg: {is: Both, m: 2 kg, k_1: =p, k_2: =q}").replace(
        "[seg.b]", "[seg.b, none.b]").replace("[wall.a, seg.a]", "[wall.a, seg.a, none.a]")
    flat = hb.assemble(hb.loads(text, folder)).flat
    assert str(flat.constants["seg.spring.c"]) == "(p-q)" and str(flat.constants["none.spring.c"]) == "none.spring.c"


def test_a_derivative_that_no_symbol_stands_for_is_refused(folder: Path) -> None:
    """It was taken for zero."""
    text = CHAIN.replace("simulate:", 'show: {jerk: {is: "der(der(der(end.v)))", unit: m/s**4}}\nsimulate:')
    with pytest.raises(hb.UsageError, match="derivatives of a variable are not available"):
        hb.simulate(hb.loads(text, folder))["jerk"]


def test_arrays_of_generic_ports(folder: Path) -> None:
    """Three resistances meet at a 0-junction: the pressure there is that of a divider of conductances."""
    result = hb.simulate(hb.loads("""
model: star
components:
  high:  {is: PressureSource, p_0: 100 bar}
  low:   {is: PressureSource, p_0: 20 bar}
  tank:  {is: Tank}
  r1: {is: Resistor, R: 1e9 Pa*s/m**3}
  r2: {is: Resistor, R: 2e9 Pa*s/m**3}
  r3: {is: Resistor, R: 4e9 Pa*s/m**3}
  star: {is: Junction0, n: 3}
nodes:
  a: [high.a, r1.a]
  b: [low.a, r2.a]
  c: [tank.a, r3.a]
  d: [r1.b, "star.p[1]"]
  e: [r2.b, "star.p[2]"]
  f: [r3.b, "star.p[3]"]
simulate: {until: 1 s, every: 0.5 s}
""", folder))
    conductances = np.array([1, 1 / 2, 1 / 4])
    assert result["d.p"][-1] == pytest.approx(conductances @ [100e5, 20e5, 0] / conductances.sum(), rel=1e-12)
    assert result["f.p"][-1] == result["d.p"][-1]


def test_a_resistance_takes_the_domain_it_is_wired_to(folder: Path) -> None:
    """In mechanics effort is force and flow velocity: a one-port R in N s/m brakes a mass, v = v_0 exp(-R t/m)."""
    (folder / "r.yaml").write_text("""
component: R
summary: A linear resistance, the bond-graph element with one port.
ports: {p: $D}
parameters:
  R: {unit: $D.effort/$D.flow, min: 0, doc: resistance}
equations: |
  p.effort = R * p.flow   # Ohm's law
dissipates: p.effort * p.flow
""", encoding="utf-8")
    result = hb.simulate(hb.loads("""
model: damped
components:
  r:    {is: R, R: 5 N*s/m}
  cart: {is: Mass, m: 2 kg}
nodes:
  load: [cart.a, r.p]
initial: {load.v: 3 m/s}
simulate: {until: 1 s, every: 0.1 s}
""", folder))
    assert result["load.v"] == pytest.approx(3 * np.exp(-5 / 2 * result.time), rel=1e-6)


def test_variants_add_replace_remove_and_set(folder: Path) -> None:
    (folder / "base.yaml").write_text("""
model: base
components:
  wall:   {is: Fixed}
  spring: {is: Spring, c: 1 kN/m}
  damper: {is: Damper, d: 10 N*s/m}
  cart:   {is: Mass, m: 2 kg}
nodes:
  ground: [wall.a, spring.a, damper.a]
  load:   [spring.b, damper.b, cart.a]
initial: {load.x: 10 mm, load.v: 0 m/s}
simulate: {until: 1 s, every: 10 ms}
""", encoding="utf-8")
    changed = hb.loads("""
model: changed
extends: base.yaml
components:
  damper: {is: SpringDamper, c: 500 N/m, d: 4 N*s/m}
  extra:  {is: Mass, m: 1 kg}
nodes:
  load: [+extra.a]
remove: [spring]
set: {cart.m: 3 kg}
""", folder)
    result = hb.simulate(changed)
    omega, decay = np.sqrt(500 / 4 - (4 / 8) ** 2), 4 / 8
    exact = 0.01 * np.exp(-decay * result.time) * (
        np.cos(omega * result.time) + decay / omega * np.sin(omega * result.time))
    assert np.abs(result["load.x"] - exact).max() < 1e-8


def test_values_of_a_part_that_another_kind_replaces_are_kept_where_that_has_them(folder: Path) -> None:
    (folder / "base.yaml").write_text("""
model: base
components: {wall: {is: Fixed}, spring: {is: SpringDamper, c: 1 kN/m, d: 3 N*s/m}, cart: {is: Mass, m: 2 kg}}
nodes: {ground: [wall.a, spring.a], load: [spring.b, cart.a]}
initial: {load.x: 10 mm, load.v: 0 m/s}
simulate: {until: 1 s, every: 10 ms}
set: {spring.c: 800 N/m, spring.d: 4 N*s/m}
""", encoding="utf-8")
    variant = "model: changed\nextends: base.yaml\ncomponents: {spring: {is: Spring, c: 1 kN/m}}\n"
    assembly = hb.assemble(hb.loads(variant, folder))
    assert assembly.parameter_values["spring.c"] == 800.0 and "spring.d" not in assembly.parameter_values
    with pytest.raises(hb.ModelError, match=r"spring\.d"):  # what the variant itself sets must be there
        hb.assemble(hb.loads(variant + "set: {spring.d: 4 N*s/m}\n", folder))


def test_dotted_names_reach_into_blocks() -> None:
    model = hb.loads("""
model: leaking
extends: cmc_ahc/cmc_ahc.yaml
components:
  leak: {is: LaminarLeakage, C: 1e-12 m**3/(s*Pa)}
  sump: {is: Tank}
nodes:
  ahc.chamber_a: [+leak.a]
  drain: [leak.b, sump.a]
set: {ahc.valve.f_n: 2 Hz}
""")
    assembly = hb.assemble(model)
    assert assembly.parameter_values["ahc.valve.f_n"] == 2.0
    result = hb.simulate(assembly, "20 s", every="0.1 s")
    assert result["leak.a.q"] == pytest.approx(1e-12 * result["ahc.chamber_a.p"])
    plain = hb.simulate(hb.load("cmc_ahc"), "20 s", every="0.1 s")
    assert result.display["p_A"][-1] != pytest.approx(plain.display["p_A"][-1])


def test_a_record_takes_the_place_of_a_wired_input(tmp_path: Path) -> None:
    """An experiment overrides an input that a node drives in the diagram; other inputs on the node keep their signal."""
    (tmp_path / "rig.yaml").write_text("""
model: rig
components:
  wave:  {is: Sine, a: 1 m, T: 1 s}
  table: {is: PositionSource}
  other: {is: PositionSource}
  m1: {is: Mass, m: 1 kg}
  m2: {is: Mass, m: 1 kg}
nodes:
  drive: [wave.y, table.u, other.u]
  one: [table.a, m1.a]
  two: [other.a, m2.a]
simulate: {until: 1 s, every: 10 ms}
""", encoding="utf-8")
    t = np.arange(0, 1.001, 0.01)
    rows = "\n".join(f"{a:.2f},{0.2 * a**2:.9f}" for a in t)
    (tmp_path / "r.csv").write_text("t_s,x_m\n" + rows + "\n", encoding="utf-8")
    (tmp_path / "e.yaml").write_text("""
experiment: moved
model: rig.yaml
records: {one: {file: r.csv, use: fit}}
time: {column: t_s, unit: s}
inputs: {table.u: {column: x_m, unit: m, interpolation: spline}}
outputs: {one.x: {column: x_m, unit: m, noise: 1 mm}}
""", encoding="utf-8")
    record = hb.compare(tmp_path / "e.yaml").records["one"]
    assert record.channels["one.x"].error < 1e-9
    assert np.abs(record.result["two.x"] - np.sin(2 * np.pi * record.result.time)).max() < 1e-6


def test_units_are_solved_for_each_instance() -> None:
    """A Gain from metres to newtons, then one without unit: each takes its units from what it is given and joined to."""
    result = hb.simulate(hb.loads("""
model: gains
components:
  wave:  {is: Sine, a: 2 m, T: 1 s}
  stiff: {is: Gain, k: 3 kN/m}
  half:  {is: Gain, k: 0.5}
  push:  {is: ForceSource}
  cart:  {is: Mass, m: 1 kg}
nodes:
  motion: [wave.y, stiff.u]
  force:  [stiff.y, half.u]
  halved: [half.y, push.u]
  load:   [push.a, cart.a]
initial: {load.v: 0 m/s}
simulate: {until: 1 s, every: 10 ms}
"""))
    assert result.unit("force") == "N"
    assert result["halved"] == pytest.approx(0.5 * 3000 * result["motion"])


STAR = """
model: star
components:
  high: {is: PressureSource, p_0: 100 bar}
  tank: {is: Tank}
  r1: {is: Resistor, R: 1e9 Pa*s/m**3}
  r2: {is: Resistor, R: 2e9 Pa*s/m**3}
  star: {is: Junction0, n: 3}
nodes:
  a: [high.a, r1.a]
  c: [tank.a, r2.a]
  d: [r1.b, "star.p[1]"]
  e: [r2.b, "star.p[2]"]
simulate: {until: 1 s, every: 0.5 s}
"""


@pytest.mark.parametrize(("old", "new", "code", "words"), [
    ("", "", "port-unconnected", r"'star.p\[3\]' is on no node"),
    ("star.p[2]", "star.p[4]", "port-index", r"ports p\[1\] to p\[3\]"),
    ("star.p[2]", "star.p", "array-length", r"'star.p' is an array of 3, 'r2.b' is one port"),
])
def test_arrays_of_ports_are_joined_one_by_one(folder: Path, old: str, new: str, code: str, words: str) -> None:
    with pytest.raises(hb.ModelError, match=words) as caught:
        hb.assemble(hb.loads(STAR.replace(old, new), folder))
    assert code in [p.code for p in caught.value.problems]


def test_a_unit_ends_where_a_name_begins() -> None:
    """`3 N*s/m*load.v` and `20 rad/s*time`: the longest unit is taken, the name after it is a factor."""
    result = hb.simulate(hb.loads("""
model: glued
components:
  brake: {is: ForceSource, u: "=-3 N*s/m*load.v + 2 N*sin(20 rad/s*time)"}
  cart:  {is: Mass, m: 1 kg}
nodes:
  load: [brake.a, cart.a]
initial: {load.v: 1 m/s}
simulate: {until: 1 s, every: 10 ms}
"""))
    wanted = -3 * result["load.v"] + 2 * np.sin(20 * result.time)
    assert result["brake.u"] == pytest.approx(wanted, abs=1e-9)


def test_a_plain_number_keeps_the_unit_that_tells_that_of_a_signal() -> None:
    """The unit of what a gain gives follows from its parameter; another value of it must not lose that."""
    model = hb.loads("""
model: pushed
components:
  drive: {is: Gain, k: 20 N/V, u: 3 V}
  push:  {is: ForceSource, u: =drive.y/2}
  load:  {is: Mass, m: 2 kg}
nodes: {load: [push.a, load.a]}
initial: {load.x: 0 m, load.v: 0 m/s}
simulate: {until: 1 s}
""")
    assert hb.simulate(model)["load.v"][-1] == pytest.approx(15)
    assert hb.simulate(model.with_parameters({"drive.k": -10}).with_parameters({"drive.k": 10}))["load.v"][-1] == \
        pytest.approx(7.5)


def test_atan2_is_the_angle_of_a_point() -> None:
    """Over a whole turn, and on the negative x axis, in a formula of parameters too."""
    result = hb.simulate(hb.loads("""
model: turning
parameters: {r: 2 m, back: "=atan2(0 m, -1 m)"}
components:
  angle: {is: Gain, k: 1, u: "=atan2(r*sin(3*time/(1 s)), r*cos(3*time/(1 s)))"}
show: {angle: {is: angle.y, unit: 1}, back: {is: back, unit: 1}}
simulate: {until: 2 s, every: 10 ms}
"""))
    turned = 3 * result.time
    assert result.display["angle"] == pytest.approx(np.arctan2(np.sin(turned), np.cos(turned)), abs=1e-14)
    assert result.display["back"] == pytest.approx(np.pi, abs=1e-15)
