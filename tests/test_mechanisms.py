"""Mechanisms whose states change during a run, beside independent solutions in minimal coordinates by SciPy.

The angles of the bundled mechanisms are integrated by an explicit Runge-Kutta method of order 8 with tolerances of 1e-12;
what is compared are the places of the masses, to 1e-6 of the size of the mechanism.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import acos, atan2, cos, hypot, pi, sin, sqrt
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import heavebond as hb
from heavebond.energy_audit.audit import energy as audit
from heavebond.equations.state_selection import preference, strain
from heavebond.numerics.dynamic_state_selection import STATE_SELECTION, StateChoices
from heavebond.numerics.result import Result
from heavebond.numerics.simulator import Simulator, Tolerances
from heavebond.text.expression import parse_formula

Array = NDArray[np.float64]
SMALL = 1e-6
DRIFT = 1e-8
G = 9.81


def run(name: str) -> Result:
    """A bundled mechanism, its states controlled to 1e-11: a change of states begins with steps of first order."""
    return hb.simulate(hb.load(f"mechanisms/{name}"), rtol=1e-11, atol=1e-13)


def integrated(rates: Callable[[float, Array], Sequence[float]], start: Sequence[float], time: Array) -> Array:
    found = solve_ivp(rates, (time[0], time[-1]), start, "DOP853", time, rtol=1e-12, atol=1e-12)
    assert found.success
    return np.asarray(found.y)


def changes(result: Result) -> int:
    return len(result.statistics.get("state_changes", []))


def test_a_pendulum_through_every_angle() -> None:
    found = run("pendulum")
    L, m = 1.3, 0.7
    angle, speed = integrated(lambda t, y: (y[1], -G / L * np.sin(y[0])), (0, 8 / L), found.time)
    assert angle[-1] > 4 * np.pi
    assert changes(found) >= 8  # four in each turn
    assert found["bob.x"] == pytest.approx(L * np.sin(angle), abs=SMALL * L)
    assert found["bob.y"] == pytest.approx(-L * np.cos(angle), abs=SMALL * L)
    assert found["bob.v_y"] == pytest.approx(L * np.sin(angle) * speed, abs=SMALL * 8)
    assert found["bob.k"] == pytest.approx(m * (speed**2 + G / L * np.cos(angle)), abs=SMALL * m * speed.max() ** 2)


def test_the_hidden_constraints_hold() -> None:
    """Place, velocity and acceleration, at every output and at usual tolerances."""
    found = hb.simulate(hb.load("mechanisms/pendulum"))
    x, y, u, v, a, b = (found[n] for n in ("bob.x", "bob.y", "bob.v_x", "bob.v_y", "der(bob.v_x)", "der(bob.v_y)"))
    assert np.abs(x**2 + y**2 - 1.3**2).max() < DRIFT
    assert np.abs(x * u + y * v).max() < DRIFT
    assert np.abs(x * a + y * b + u**2 + v**2).max() < DRIFT
    links = hb.simulate(hb.load("mechanisms/four_bar"))
    x, y, p, q, u, v, r, s = (links[f"links.{n}"] for n in ("x_1", "y_1", "x_2", "y_2", "u_1", "v_1", "u_2", "v_2"))
    assert np.abs(x**2 + y**2 - 0.3**2).max() < DRIFT
    assert np.abs((p - x) ** 2 + (q - y) ** 2 - 1).max() < DRIFT
    assert np.abs((p - 0.9) ** 2 + q**2 - 0.8**2).max() < DRIFT
    assert np.abs((p - x) * (r - u) + (q - y) * (s - v)).max() < DRIFT


def test_a_double_pendulum() -> None:
    found = run("double_pendulum")
    m_1, m_2, a, b = 1.0, 0.5, 1.0, 0.7

    def rates(t: float, y: Array) -> Sequence[float]:
        one, two, w, v = y
        c, s = np.cos(one - two), np.sin(one - two)
        matrix = [[(m_1 + m_2) * a**2, m_2 * a * b * c], [m_2 * a * b * c, m_2 * b**2]]
        right = [-m_2 * a * b * s * v**2 - (m_1 + m_2) * G * a * np.sin(one),
                 m_2 * a * b * s * w**2 - m_2 * G * b * np.sin(two)]
        return (w, v, *np.linalg.solve(matrix, right))

    x_1, y_1, x_2, y_2 = (found[f"rods.{n}"][0] for n in ("x_1", "y_1", "x_2", "y_2"))
    one, two, _, _ = integrated(rates, (np.arctan2(x_1, -y_1), np.arctan2(x_2 - x_1, y_1 - y_2), 0, 0), found.time)
    assert np.ptp(two) > np.pi
    assert changes(found) > 3
    assert found["rods.x_1"] == pytest.approx(a * np.sin(one), abs=SMALL)
    assert found["rods.x_2"] == pytest.approx(a * np.sin(one) + b * np.sin(two), abs=SMALL)
    assert found["rods.y_2"] == pytest.approx(-a * np.cos(one) - b * np.cos(two), abs=SMALL)


def along_one_angle(mass: Callable[[float], float], height: Callable[[float], float], q: float, w: float, time: Array
                    ) -> Array:
    """The angle (N,) with mass(q) q'**2/2 + height(q) = E, where it never stands still."""
    energy = mass(q) * w**2 / 2 + height(q)
    return integrated(lambda t, y: (np.sign(w) * sqrt(2 * (energy - height(y[0])) / mass(y[0])),), (q,), time)[0]


def test_a_four_bar_linkage() -> None:
    found = run("four_bar")
    m_1, m_2, crank, coupler, rocker, d = 2.0, 1.0, 0.3, 1.0, 0.8, 0.9

    def rocking(q: float) -> tuple[float, float]:
        """The angle of the rocker by the cosine law, and of the coupler."""
        x, y = crank * cos(q) - d, crank * sin(q)
        far = hypot(x, y)
        other = atan2(y, x) - acos((far**2 + rocker**2 - coupler**2) / (2 * far * rocker))
        return other, atan2(rocker * sin(other) - y, rocker * cos(other) - x)

    def mass(q: float) -> float:
        other, middle = rocking(q)
        return m_1 * crank**2 + m_2 * (crank * sin(q - middle) / sin(other - middle)) ** 2

    speed = -3 / crank  # the crank stands upright and its joint moves to the right
    q = along_one_angle(mass, lambda q: m_1 * G * crank * sin(q) + m_2 * G * rocker * sin(rocking(q)[0]), pi / 2, speed,
                        found.time)
    assert np.ptp(q) > 4 * np.pi
    assert changes(found) > 6
    assert found["links.x_1"] == pytest.approx(crank * np.cos(q), abs=SMALL)
    assert found["links.x_2"] == pytest.approx([d + rocker * cos(rocking(a)[0]) for a in q], abs=SMALL)


def test_a_slider_crank_that_begins_with_its_slider_as_a_state() -> None:
    found = run("slider_crank")
    r, length, c = 0.06, 0.18, 800.0

    def rod(q: float) -> float:
        return sqrt(length**2 - (r * sin(q)) ** 2)

    def slope(q: float) -> float:
        return -r * sin(q) * (1 + r * cos(q) / rod(q))

    def mass(q: float) -> float:
        return 0.02 + 1.5 * slope(q) ** 2

    q = along_one_angle(mass, lambda q: c / 2 * (r * cos(q) + rod(q) - length) ** 2, found["shaft.phi"][0],
                        found["shaft.w"][0], found.time)
    assert found["piston.x"][0] == pytest.approx(0.2, abs=1e-9)
    assert found["piston.v"][0] == pytest.approx(-1, abs=1e-9)
    assert np.ptp(q) > 8 * np.pi
    assert changes(found) == 1  # from the slider to the crank, which does for all angles
    assert found["piston.x"] == pytest.approx([r * cos(a) + rod(a) for a in q], abs=SMALL)
    assert found["piston.v"] == pytest.approx(found["shaft.w"] * [slope(a) for a in q], abs=SMALL)


@pytest.mark.parametrize("name", ["pendulum", "double_pendulum", "four_bar", "slider_crank"])
def test_energy_is_kept_through_changes(name: str) -> None:
    audit(hb.load(f"mechanisms/{name}"), "1 s").raise_if_open(SMALL)


def test_what_is_told_of_a_change() -> None:
    found = hb.simulate(hb.load("mechanisms/pendulum"), "1 s")
    first = found.statistics["state_changes"][0]
    assert first["before"] == ("bob.x", "bob.v_x")
    assert first["after"] == ("bob.y", "bob.v_y")
    # the rod leans by the angle whose tangent is the strain
    at = int(np.argmin(np.abs(found.time - first["time"])))
    strain = float(first["why"].split(" moves ")[1].split()[0])
    assert -found["bob.x"][at] / found["bob.y"][at] == pytest.approx(strain, rel=0.05)
    assert "bob.y, bob.v_y moves" in first["why"]


@pytest.mark.long
@pytest.mark.parametrize("name", ["bob.L", "bob.g", "initial.bob.v_x"])
def test_sensitivities_through_changes_of_states(name: str) -> None:
    """Sixth order differences with steps of 5e-4 of the parameter, as through events."""
    tight = Tolerances(1e-11, 1e-13, along=1.0)
    assembly = hb.assemble(hb.load("mechanisms/pendulum"))
    along = Simulator(assembly, "1.5 s", tolerances=tight, sensitivities=[name]).run()
    assert changes(along) >= 4
    plain = Simulator(assembly, "1.5 s", tolerances=tight)
    value = assembly.parameter_values[name]
    step = 5e-4 * value
    runs = {k: plain.run({name: value + k * step}) for k in (-3, -2, -1, 1, 2, 3)}
    for signal in ("bob.x", "bob.y", "bob.v_y", "tension"):
        found = {k: r.display[signal] for k, r in runs.items()}
        wanted = (45 * (found[1] - found[-1]) - 9 * (found[2] - found[-2]) + (found[3] - found[-3])) / (60 * step)
        exact = along.sensitivity(signal, name)
        assert np.abs(exact - wanted).max() <= 1e-5 * np.abs(exact).max()


def test_integrals_go_through_changes_of_states() -> None:
    assembly = hb.assemble(hb.load("mechanisms/pendulum"))
    path = assembly.expression(parse_formula("bob.v_x**2 + bob.v_y**2"))
    names = ["bob.g"]
    along = Simulator(assembly, "2 s", quadratures=path, sensitivities=names).run()
    # v**2 = v_0**2 - 2 g (y + L)
    speed = 64 - 2 * G * (along["bob.y"] + 1.3)
    assert along.quadratures[0, -1] == pytest.approx(np.trapezoid(speed, along.time), rel=1e-5)
    moved = {s: Simulator(assembly, "2 s", quadratures=path).run({"bob.g": G + s}).quadratures[0, -1] for s in (-0.01, 0.01)}
    assert along.along is not None
    assert along.along.quadratures[0, 0, -1] == pytest.approx((moved[0.01] - moved[-0.01]) / 0.02, rel=1e-4)


@pytest.mark.long
def test_constant_constraints_have_one_chart() -> None:
    rigid = hb.loads("""
model: joined
components: {push: {is: ConstantForce, F: 6 N}, m_1: {is: Mass, m: 1 kg}, m_2: {is: Mass, m: 2 kg}}
nodes: {one: [push.a, m_1.a, m_2.a]}
simulate: {until: 1 s}
""")
    assembly = hb.assemble(rigid)
    assert not StateChoices(assembly).needed
    assert Simulator(assembly).switching is None
    run = hb.simulate(assembly)
    at = (run.time[None], run.x, run.z, np.tile(run.p[:, None], (1, len(run.time))), run.u, np.ones((1, len(run.time))))
    assert not StateChoices(assembly).home.strain(at).worst.any()  # a run that enters it may stay for ever
    assert StateChoices(hb.assemble(hb.load("mechanisms/pendulum"))).needed


def test_charts_are_exact_maps_of_each_other() -> None:
    assembly = hb.assemble(hb.load("mechanisms/four_bar"))
    charts = StateChoices(assembly)
    result = hb.simulate(assembly, "0.3 s")
    point = result.instants[0].before if result.instants else None
    assert point is None
    at, stay = result.stays[0]
    assert set(stay.assembly.reduced.states) != set(assembly.reduced.states)
    # signals of the stay, in its own states, are those of the states at home where these are good too
    p = np.tile(result.p[:, None], (1, len(at)))
    given = (result.time[None, at], result.x[:, at], result.z[:, at], p, result.u[:, at], np.ones((1, len(at))))
    good = charts.home.strain(given).worst < STATE_SELECTION.max_strain
    assert good.any()
    home = Result(assembly, result.time[at], result.x[:, at], result.z[:, at], result.u[:, at], result.p, result.start)
    for name in ("links.x_2", "links.v_2", "links.k_2", "der(links.u_1)"):
        assert home[name][good] == pytest.approx(stay[name][good], rel=1e-9, abs=1e-9)


def test_the_strain_block_by_block_is_that_of_the_whole_matrix() -> None:
    """At random values of the constraints, one of which makes the matrix singular; the signs agree up to a common one."""
    random = np.random.default_rng(1)
    for part in StateChoices(hb.assemble(hb.load("mechanisms/crane"))).home.parts:
        numbers = random.normal(size=(len(part.constraints.entries), 6))
        numbers[[part.constraints.place[(part.rows[0], j)] for j in part.constraints.rows[part.rows[0]]], 5] = 0
        states = [column for column in part.columns if column not in part.dummies]
        whole, outer = (part.matrices(numbers, columns) * [preference(part.constraints.flat, column, frozenset())
                                                           for column in columns] for columns in (part.dummies, states))
        worst, signs = strain(part, numbers)
        assert worst[:5] == pytest.approx(np.abs(np.linalg.solve(whole[:5], outer[:5])).max(axis=(1, 2)), rel=1e-8)
        assert np.isinf(worst[5]) and signs[5] == 0
        assert len(set((signs[:5] * np.linalg.slogdet(whole[:5])[0]).tolist())) == 1


def test_events_in_a_mechanism(tmp_path: Path) -> None:
    """A pendulum that counts its turns: events and changes of states in one run."""
    text = Path(hb.load("mechanisms/pendulum").path).parent / "components" / "pendulum.yaml"
    counted = text.read_text(encoding="utf-8").replace("component: Pendulum", "component: CountedPendulum").replace(
        "variables:\n", "variables:\n  turns: {unit: 1, held: 0, doc: turns}\n") + \
        "when:\n  turn: {condition: x < 0 and y > 0, then: {turns: turns + 1}}\n"
    (tmp_path / "counted_pendulum.yaml").write_text(counted, encoding="utf-8")
    found = hb.simulate(hb.loads("""
model: counted
components: {bob: {is: CountedPendulum, m: 0.7 kg, L: 1.3 m}}
initial: {bob.x: 0 m, bob.y: ~ -1.3 m, bob.v_x: 8 m/s}
simulate: {until: 5 s, every: 5 ms}
""", tmp_path))
    angle, _ = integrated(lambda t, y: (y[1], -G / 1.3 * np.sin(y[0])), (0, 8 / 1.3), found.time)
    # upright, from right to left, and again after each turn
    wanted = [found.time[np.argmax(angle > np.pi + 2 * np.pi * k)] for k in range(int(angle[-1] / 2 / np.pi + 0.5))]
    assert [t for t, _ in found.events] == pytest.approx(wanted, abs=0.005)
    assert found["bob.turns"][-1] == len(wanted)
    assert found.instants[0].before.columns()[0].shape == (1, 1)
