"""Limits at zero frequency: DC gains, zeros at 0 and margins of loops with integrators, against closed forms."""

from __future__ import annotations

import json
from pathlib import Path

import control
import numpy as np
import pytest

import heavebond as hb
from heavebond.cli import main
from heavebond.linear.linear_system import StateSpace
from heavebond.linear.margins import crossings
from heavebond.linear.stability import stability
from heavebond.numerics.start_equations import Point

DAMPED = """
model: damped
components:
  g: {is: Fixed}
  d: {is: Damper, d: 4 N*s/m}
  m: {is: Mass, m: 2 kg}
  f: {is: ForceSource, u: 0 N}
nodes: {g: [g.a, d.a], b: [d.b, f.a, m.a]}
initial: {b.x: 0 m, b.v: 0 m/s}
simulate: {until: 4 s, every: 10 ms}
"""
TWO_FREE_BODIES = """
model: two_free_bodies
components:
  m1: {is: Mass, m: 2 kg}
  s: {is: SpringDamper, c: 3 kN/m, d: 7 N*s/m}
  m2: {is: Mass, m: 5 kg}
nodes: {b1: [m1.a, s.a], b2: [s.b, m2.a]}
initial: {b1.x: 0 m, b1.v: 0 m/s, b2.x: 0 m, b2.v: 0 m/s}
simulate: {until: 4 s}
"""
CONTROLLED = """
model: controlled
components:
  r: {is: Constant, k: 0}
  e: {is: Sum, k_1: 1, k_2: -1}
  c: {is: TransferFunction, b: [3, 2], a: [1, 0]}
  d: {is: Sum, k_1: 1, k_2: 1, u_2: 0}
  p: {is: TransferFunction, b: [0, 4], a: [2, 1]}
nodes: {r: [r.y, e.u_1], e: [e.y, c.u], c: [c.y, d.u_1], d: [d.y, p.u], y: [p.y, e.u_2]}
simulate: {until: 4 s}
"""
OIL = """
model: oil
components:
  v: {is: Volume, V: 2 l, beta: 1.4 GPa}
  o: {is: LaminarLeakage, C: 2e-10 m**3/(s*Pa)}
  t: {is: Tank}
nodes: {n: [v.a, o.a], t: [o.b, t.a]}
initial: {n.p: 10 bar}
simulate: {until: 1 s}
"""


def _gain(text: str, given: str, asked: str, tmp_path: Path) -> float:
    file = tmp_path / "machine.yaml"
    file.write_text(text, encoding="utf-8")
    return float(hb.state_space(hb.load(file), [given], [asked]).dc_gain()[0, 0])


def test_a_channel_with_an_integrator_has_an_infinite_dc_gain_in_the_table_and_in_json(tmp_path: Path,
                                                                                      capsys: pytest.CaptureFixture[str]):
    """-0.125 m/N was printed: the value of 1/(s (2 s + 4)) at one low frequency."""
    file, told = tmp_path / "damped.yaml", tmp_path / "told.json"
    file.write_text(DAMPED, encoding="utf-8")
    with pytest.raises(SystemExit) as ended:
        main(["linear", str(file), "--from", "b.f", "--to", "b.x,b.v", "--json", str(told)])
    assert ended.value.code == 0
    position, speed = json.loads(told.read_text(encoding="utf-8"))["channels"]
    assert position["static_gain"] is None and position["integrators"] == 1
    assert speed["static_gain"] == pytest.approx(0.25, rel=1e-12) and speed["integrators"] == 0
    line = next(row for row in capsys.readouterr().out.splitlines() if "b.x" in row and "m / N" in row)
    assert "infinite" in line and "-0.125" not in line


@pytest.mark.parametrize(("text", "given", "asked", "gain"), [
    (DAMPED, "b.f", "b.x", np.inf),
    (DAMPED, "b.f", "b.v", 1 / 4),
    (DAMPED, "b.f", "m.a.f", 0.0),                                       # no acceleration in the end
    (DAMPED, "b.f", "d.b.f", 1.0),                                       # the damper carries the force
    (TWO_FREE_BODIES, "b1.f", "b1.x", np.inf),                           # two integrators
    (TWO_FREE_BODIES, "b1.f", "b2.v", np.inf),
    (TWO_FREE_BODIES, "b1.f", "b1.x - b2.x", 5 / 7 / 3000),              # both cancel: m2/(m1 + m2)/c
    (TWO_FREE_BODIES, "b1.f", "2*b1.x + 5*b2.x", np.inf),                # the centre of mass
    (CONTROLLED, "r", "p.y", 1.0),                                       # no error in the steady state
    (CONTROLLED, "r", "e.y", 0.0),
    (CONTROLLED, "d.u_2", "p.y", 0.0),                                   # the integral takes the disturbance
    (CONTROLLED, "d.u_2", "c.y", -1.0),
    (CONTROLLED.replace("p.y, e.u_2", "p.y").replace("k_1: 1, k_2: -1}", "k_1: 1, k_2: -1, u_2: 0}"),
     "r", "p.y", np.inf),                                                # the loop is open: the integrator is left
    (CONTROLLED.replace("b: [3, 2], a: [1, 0]", "b: [1, 0], a: [1, 5]"), "r", "c.y", 0.0),  # a differentiator
    (OIL, "n.q", "n.p", 5e9),
    (OIL.replace("C: 2e-10", "C: 0"), "n.q", "n.p", np.inf),
    (OIL.replace("C: 2e-10", "C: 0"), "n.q", "v.a.q", 1.0),
])
def test_a_dc_gain_is_that_of_the_poles_and_zeros_at_zero(text: str, given: str, asked: str, gain: float, tmp_path: Path):
    # 1e-9: solves with matrices of condition numbers up to 1e6
    assert _gain(text, given, asked, tmp_path) == pytest.approx(gain, rel=1e-9, abs=0.0)


def _system(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: float = 0.0, sizes: np.ndarray | None = None) -> StateSpace:
    n = len(a)
    names = tuple(f"x{k}" for k in range(n))
    return StateSpace(names, ("u",), ("y",), (("1",) * n, ("1",), ("1",)), a, b.reshape(n, 1), c.reshape(1, n),
                      np.array([[d]]), np.zeros((2, 1, 1)), np.ones(n) if sizes is None else sizes,
                      Point(0.0, np.zeros(n), np.zeros(0), np.zeros(0), np.zeros(0), 1.0))


def _series(poles: list[float], zeros: list[float], gain: float, rng: np.random.Generator) -> tuple[StateSpace, float]:
    """k prod(s - z)/prod(s - p) in random states of widely different sizes, and c of c/s**q at 0, q the poles there less
    the zeros there."""
    top, bottom = gain * np.poly(zeros), np.poly(poles)
    found = control.tf2ss(control.tf(top, bottom))
    n = len(poles)
    turn = np.linalg.qr(rng.normal(size=(n, n)))[0] * 10.0 ** rng.uniform(-3, 3, n)
    inverse = np.linalg.inv(turn)
    leading = gain * np.prod([-z for z in zeros if z]) / np.prod([-p for p in poles if p])
    return _system(inverse @ found.A @ turn, inverse @ found.B, found.C @ turn, float(found.D[0, 0]),
                   1 / np.abs(inverse).max(axis=1)), float(leading)


@pytest.mark.parametrize("seed", range(12))
def test_random_systems_have_the_gain_of_their_poles_and_zeros_at_zero(seed: int):
    """Up to two integrators and two differentiators, also where they cancel; states in random directions and sizes."""
    rng = np.random.default_rng(seed)
    at_pole, at_zero = int(rng.integers(0, 3)), int(rng.integers(0, 3))
    poles = [0.0] * at_pole + list(-10.0 ** rng.uniform(-1, 1, 4))
    zeros = [0.0] * at_zero + list(-10.0 ** rng.uniform(-1, 1, 2))
    system, leading = _series(poles, zeros, 10.0 ** rng.uniform(-2, 2), rng)
    wanted = np.inf if at_pole > at_zero else 0.0 if at_zero > at_pole else leading
    # 1e-6: the canonical form of four poles over two decades has a condition number of some 1e6, its directions 1e3
    assert abs(system.dc_gain()[0, 0]) == pytest.approx(abs(wanted), rel=1e-6, abs=0.0)
    assert system.poles_at_zero() == max(at_pole - at_zero, 0)


def test_a_slow_pole_is_no_integrator():
    """A thermal time constant of 1e6 s beside a lag of 1 us."""
    a = np.array([[-1e-6, 0.0], [1e6, -1e6]])
    system = _system(a, np.array([1e-6 * 7, 0.0]), np.array([0.0, 1.0]))
    assert system.dc_gain()[0, 0] == pytest.approx(7.0, rel=1e-12)


def test_a_zero_at_the_origin_is_zero_and_not_rounding():
    """s**2/(s + 1)**3 in random states."""
    rng = np.random.default_rng(3)
    system, _ = _series([-1.0, -2.0, -3.0], [0.0, 0.0], 1.0, rng)
    zeros = system.zeros()
    assert len(zeros) == 2 and np.all(zeros == 0)


def _margins(system: StateSpace):
    closed = system.a - system.b @ system.c / (1 + system.d[0, 0])
    return crossings(system, stability(closed, system.sizes, system.states))


@pytest.mark.parametrize("seed", range(8))
def test_margins_of_loops_with_integrators_are_those_of_python_control(seed: int):
    """Type 1 and type 2 loops: no crossing at 0 Hz, the others as python-control finds them."""
    rng = np.random.default_rng(100 + seed)
    kind = 1 + seed % 2
    poles = [0.0] * kind + list(-10.0 ** rng.uniform(0, 1.5, 3))
    zeros = list(-10.0 ** rng.uniform(-1, 0.5, kind))
    gain = 10.0 ** rng.uniform(0, 2)
    system, _ = _series(poles, zeros, gain, rng)
    found = _margins(system)
    loop = control.zpk(zeros, poles, gain)
    gains, phases, _, at_gain, at_phase, _ = control.stability_margins(loop, returnall=True)
    wanted = sorted((w / 2 / np.pi, g) for w, g in zip(at_gain, gains, strict=True) if 0 < w < np.inf and g > 0)
    assert [m.frequency for m in found.gain] == pytest.approx([f for f, _ in wanted], rel=1e-5)
    assert [m.value for m in found.gain] == pytest.approx([g for _, g in wanted], rel=1e-5)
    assert sorted(m.frequency for m in found.phase) == pytest.approx(sorted(at_phase / 2 / np.pi), rel=1e-5)
    turned = sorted((phases + 180) % 360 - 180)
    assert sorted(m.value for m in found.phase) == pytest.approx(turned, abs=1e-3)


def test_a_cancelled_integrator_does_not_hide_the_gain_margin_at_zero_frequency():
    """L = -0.5 s/(s (s + 1)): the closed loop needs a factor of 2 at 0 Hz."""
    system = _system(np.array([[0.0, 0.0], [1.0, -1.0]]), np.array([0.0, -0.5]), np.array([0.0, 1.0]))
    turn = np.array([[1.0, 2.0], [3.0, -1.0]])
    turned = _system(np.linalg.inv(turn) @ system.a @ turn, np.linalg.inv(turn) @ system.b, system.c @ turn)
    for one in (system, turned):
        assert [(m.value, m.frequency) for m in _margins(one).gain] == [(pytest.approx(2.0, rel=1e-9), 0.0)]


def test_rounding_of_the_direct_gain_makes_no_gain_margin_at_infinite_frequency():
    """1/(s + 1) with a direct gain of -1e-16, as an algebraic loop leaves it."""
    found = _margins(_system(np.array([[-1.0]]), np.array([1.0]), np.array([1.0]), -1e-16))
    assert found.gain == ()


def test_a_free_mode_has_no_damping_ratio(tmp_path: Path):
    """0 is the damping ratio of an undamped oscillation; a pole at 0 has none."""
    file, told = tmp_path / "damped.yaml", tmp_path / "told.json"
    file.write_text(DAMPED, encoding="utf-8")
    with pytest.raises(SystemExit):
        main(["modes", str(file), "--json", str(told)])
    free, decaying = json.loads(told.read_text(encoding="utf-8"))["modes"]
    assert free["damping"] is None and free["frequency"] == 0.0
    assert decaying["damping"] == 1.0 and decaying["real"] == pytest.approx(-2.0)
