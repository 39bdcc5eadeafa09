"""Hard models of mechanisms and switching: what comes of each of them.

The files under `hard/` say in their first lines which pain each stands for. Expected are closed forms, independent
solutions, laws that must hold, or the message that says what is wrong.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import heavebond as hb
from heavebond.energy_audit.audit import energy as audit
from heavebond.numerics.result import Result

Array = NDArray[np.float64]
FOLDER = Path(__file__).parent / "hard"
G = 9.81
SMALL = 1e-6


def model(name: str) -> hb.Model:
    path = FOLDER / f"{name}.yaml"
    assert path.read_text(encoding="utf-8").startswith("# "), "the file says what it stands for"
    return hb.load(path)


def run(name: str, rtol: float = 1e-8, sensitivities: tuple[str, ...] = ()) -> Result:
    return hb.simulate(model(name), rtol=rtol, atol=rtol / 100, sensitivities=sensitivities)


def changes(result: Result) -> int:
    return len(result.statistics.get("state_changes", []))


def times(result: Result, name: str) -> Array:
    return np.array([time for time, event in result.events if event == name])


def swing(L: float, angle: float, speed: float, time: Array) -> tuple[Array, Array]:
    found = solve_ivp(lambda t, y: (y[1], -G / L * np.sin(y[0])), (0, time[-1]), (angle, speed), "DOP853", time, rtol=1e-12,
                      atol=1e-12)
    return L * np.sin(found.y[0]), -L * np.cos(found.y[0])


# -- mechanisms --------------------------------------------------------------------------------------------------------
@pytest.mark.long
def test_pendulum_over_the_top() -> None:
    found = run("pendulum_over_the_top", 1e-11)
    x, y = swing(1.3, 0, 30 / 1.3, found.time)
    assert changes(found) >= 4 * 7  # seven turns
    assert found["bob.x"] == pytest.approx(x, abs=10 * SMALL)  # seven turns magnify an error of the speed
    assert found["bob.y"] == pytest.approx(y, abs=10 * SMALL)
    assert np.abs(np.hypot(found["bob.x"], found["bob.y"]) - 1.3).max() < 1e-8


def test_pendulum_that_just_makes_it() -> None:
    found = run("pendulum_that_just_makes_it", 1e-11)
    # the energy at the top: (v**2 - 4 g L)/2 is 1e-3 of that at the bottom, errors grow by exp(t sqrt(g/L)) up there
    x, y = swing(1.3, 0, 7.1434 / 1.3, found.time)
    assert found["bob.x"] == pytest.approx(x, abs=1e-4)
    assert found["bob.y"] == pytest.approx(y, abs=1e-4)
    audit(model("pendulum_that_just_makes_it")).raise_if_open(SMALL)


def test_pendulum_let_go_flat() -> None:
    found = run("pendulum_let_go_flat", 1e-11)
    x, y = swing(1.3, np.pi / 2, 0, found.time)
    assert found["bob.x"] == pytest.approx(x, abs=SMALL)
    assert found["bob.y"] == pytest.approx(y, abs=SMALL)
    assert found["bob.k"].min() > -SMALL  # the rod is never pressed


def test_two_pendulums() -> None:
    found = run("two_pendulums", 1e-11)
    x, _ = swing(1.3, 0, 8 / 1.3, found.time)
    assert found["bob.x"] == pytest.approx(x, abs=SMALL)
    x, _ = swing(3, np.arcsin(0.5 / 3), 0, found.time)
    assert found["slow.x"] == pytest.approx(x, abs=SMALL)
    for change in found.statistics["state_changes"]:
        # the slow one keeps its states
        assert {"slow.x", "slow.v_x"} <= set(change["before"]) & set(change["after"])


def test_triple_pendulum() -> None:
    found = run("triple_pendulum")
    for ends in (("x_1", "y_1", "0*x_1", "0*y_1"), ("x_2", "y_2", "x_1", "y_1"), ("x_3", "y_3", "x_2", "y_2")):
        x, y, u, v = (np.asarray(found["0*chain.x_1" if e.startswith("0") else f"chain.{e}"]) for e in ends)
        assert np.abs(np.hypot(x - u, y - v) - 0.5).max() < 1e-8
    assert changes(found) > 2
    audit(model("triple_pendulum")).raise_if_open(SMALL)


@pytest.mark.long
def test_four_bar_turning() -> None:
    found = run("four_bar_turning")
    x, y, p, q = (found[f"links.{n}"] for n in ("x_1", "y_1", "x_2", "y_2"))
    assert np.ptp(np.unwrap(np.arctan2(y, x))) > 4 * np.pi
    assert np.abs(np.hypot(p - x, q - y) - 1).max() < 1e-8
    assert np.abs(np.hypot(p - 0.9, q) - 0.8).max() < 1e-8
    assert q.min() > 0  # it never folds over to its other way of being put together
    audit(model("four_bar_turning")).raise_if_open(SMALL)


@pytest.mark.long
def test_parallelogram() -> None:
    """The crank reaches the line at a known angle, and there the run ends with what is wrong."""
    with pytest.raises(hb.SimulationError) as caught:
        run("parallelogram")
    text = str(caught.value)
    assert "[integration-failed]" in text
    assert "The links of a mechanism come to lie in one line there, from where it could go on in two ways" in text
    assert "No choice of states helps" in text


def test_slider_drives_crank() -> None:
    found = run("slider_drives_crank")
    assert np.ptp(found["shaft.phi"]) > 6 * np.pi
    phi, beta = found["shaft.phi"], found["crank.beta"]
    assert found["piston.x"] == pytest.approx(0.06 * np.cos(phi) + 0.18 * np.cos(beta), abs=1e-8)
    assert np.abs(0.06 * np.sin(phi) - 0.18 * np.sin(beta)).max() < 1e-8
    assert changes(found) == 1
    audit(model("slider_drives_crank")).raise_if_open(SMALL)


def test_inverse_dynamics() -> None:
    assembly = hb.assemble(model("inverse_dynamics"))
    assert assembly.reduced.index == 5
    assert assembly.state_names == []
    found = hb.simulate(assembly)
    A, w, c, m, M = 0.1, 4.0, 200.0, 1.0, 3.0
    # load: m x'' = -c (x - y), so y = x + m x''/c; drive: M y'' = F + c (x - y)
    y = A * np.sin(w * found.time) * (1 - m * w**2 / c)
    assert found["drive.x"] == pytest.approx(y, abs=1e-12)
    force = -M * w**2 * y - c * (A * np.sin(w * found.time) - y)
    assert found["path.F"] == pytest.approx(force, abs=1e-9 * np.abs(force).max())


def test_geared_inertias() -> None:
    found = run("geared_inertias")
    assert len(found.assembly.reduced.states) == 3  # a place, a speed, and the angle, which begins anywhere
    acceleration = 60 / (10 + 0.5 / 0.1**2 + 3**2 * 3)
    assert found["cart.v"] == pytest.approx(acceleration * found.time, abs=SMALL)
    assert found["shaft.w"] == pytest.approx(10 * acceleration * found.time, abs=10 * SMALL)
    assert found["tip.v"] == pytest.approx(3 * acceleration * found.time, abs=SMALL)


def test_coupled_cylinders() -> None:
    found = run("coupled_cylinders")
    assert found["left.A.q"] == pytest.approx(found["right.A.q"], abs=1e-12)
    # oil as a spring: c = beta (2 A_A)**2/(2 V + V_line) + the same at the rod side, up to the stroke's share of V (1e-2)
    c = 1e9 * ((2 * 50e-4) ** 2 + (2 * 30e-4) ** 2) / 5e-3
    w = np.sqrt(c / 1000)
    swings = np.flatnonzero(np.diff(np.sign(found["head.v"])))
    assert np.diff(found.time[swings]).mean() == pytest.approx(np.pi / w, rel=0.02)
    audit(model("coupled_cylinders")).raise_if_open(SMALL)


# -- dry friction ------------------------------------------------------------------------------------------------------
def test_mass_on_a_belt() -> None:
    """Stuck until the spring pulls with F_s; then x = F_c/c + A cos(w s) + V/w sin(w s), until it is as fast as the belt
    again; then it is carried on for 2 (F_s - F_c)/(c V)."""
    c, m, V, F_s, F_c = 400, 2, 0.1, 12, 8
    w, A = np.sqrt(c / m), (F_s - F_c) / c
    slip, stick = 2 * (np.pi - np.arctan2(A * w, V)) / w, 2 * A / V
    found = run("mass_on_a_belt", sensitivities=("grip.F_s", "spring.c"))
    begins, ends = times(found, "grip.backward"), times(found, "grip.stick")
    assert len(begins) == len(ends) or len(begins) == len(ends) + 1
    wanted = F_s / (c * V) + np.arange(len(begins)) * (slip + stick)
    assert begins == pytest.approx(wanted, abs=SMALL)
    assert ends == pytest.approx(wanted[: len(ends)] + slip, abs=SMALL)
    stuck = found["grip.mode"] == 0
    assert np.abs(found["grip.v"][stuck]).max() < 1e-9  # it does not creep
    assert np.abs(found["grip.F"]).max() <= F_s * (1 + SMALL)
    # the second release, F_s/(c V) + slip + stick
    by_F = 1 / (c * V) - 2 / w * (V * w / c) / ((A * w) ** 2 + V**2) + 2 / (c * V)
    assert found.event_sensitivity("grip.backward", 1, "grip.F_s") == pytest.approx(by_F, rel=1e-6)
    audit(model("mass_on_a_belt")).raise_if_open(SMALL)


def test_drill_string_that_sticks() -> None:
    """The bit stands until the string is wound up by M_s/c. Then its angle swings by A = (M_s - M_c)/c and V/w about what
    M_c leaves, as seen from the drive, until it stands again; the string is then short of M_s by 2 A c."""
    c, J, V, M_s, M_c = 500, 300, 10, 6000, 3000
    w, A = np.sqrt(c / J), (M_s - M_c) / c
    slip, stick = 2 * (np.pi - np.arctan2(A * w, V)) / w, 2 * A / V
    found = run("drill_string_that_sticks", sensitivities=("grip.M_s",))
    begins, ends = times(found, "grip.forward"), times(found, "grip.stick")
    assert len(begins) > 3
    assert begins == pytest.approx(M_s / (c * V) + np.arange(len(begins)) * (slip + stick), abs=SMALL)
    assert ends == pytest.approx(begins[: len(ends)] + slip, abs=SMALL)
    assert np.abs(found["bit.w"][found["grip.mode"] == 0]).max() < 1e-8  # it creeps by 1e-12 of M_s on J_r only
    by_M = 1 / (c * V) - 2 / w * (V * w / c) / ((A * w) ** 2 + V**2) + 2 / (c * V)
    assert found.event_sensitivity("grip.forward", 1, "grip.M_s") == pytest.approx(by_M, rel=1e-6)
    audit(model("drill_string_that_sticks")).raise_if_open(SMALL)


def test_shafts_that_lock_up() -> None:
    found = run("shafts_that_lock_up")
    assert times(found, "clutch.stick") == pytest.approx([20 / (6 / 2 + 6 / 3)], abs=SMALL)
    # of the motor's torque 3/5 go to the load, once 9 N*m
    loose = 5 + 9 / (3 / 5) / 5
    assert times(found, "clutch.backward") == pytest.approx([loose], abs=SMALL)
    locked = (found.time > 4 + 1e-9) & (found.time < loose)
    assert np.abs(found["motor.w"][locked] - found["load.w"][locked]).max() < 1e-9
    common = 8 + 5 * 3**2 / 2 / 5
    assert found["load.w"][-1] == pytest.approx(common + (9 - loose) * 6 / 3, rel=SMALL)


def test_friction_under_prescribed_motion() -> None:
    found = run("friction_under_prescribed_motion")
    assert times(found, "grip.stick") == pytest.approx([0.25, 0.75, 1.25, 1.75], abs=1e-9)
    assert len(times(found, "grip.backward")) == len(times(found, "grip.forward")) == 2
    turning = (np.arange(len(found.time)) % 50) == 25
    v = np.cos(2 * np.pi * found.time)
    assert found["grip.F"][~turning] == pytest.approx(8 * np.sign(v[~turning]), abs=SMALL)


def test_two_frictions_on_one_body() -> None:
    found = run("two_frictions_on_one_body")
    assert times(found, "front.forward") == pytest.approx([2.4], abs=SMALL)  # 24 N at 10 N/s
    assert times(found, "rear.forward") == pytest.approx([2.4], abs=SMALL)
    before = found.time < 2.4
    assert found["front.F"][before] == pytest.approx(5 * found.time[before], abs=1e-4)
    assert found["rear.F"][before] == pytest.approx(5 * found.time[before], abs=1e-4)
    late = found.time[-1] - 2.4
    assert found["body.v"][-1] == pytest.approx((8 * late + 5 * late**2) / 5, rel=SMALL)


def test_two_blocks_that_stick_together() -> None:
    found = run("two_blocks_that_stick_together")
    # the lower block is held by 30 N and by 4 N, the upper driven by 4 N, until they are equally fast; then both are held by
    # 30 N on 11 kg, which asks of the joint less than its 4 N
    joined = 2 / (3.4 + 4)
    assert times(found, "between.stick") == pytest.approx([joined], abs=SMALL)
    rest = joined + 4 * joined / (30 / 11)
    assert times(found, "under.stick") == pytest.approx([rest], abs=SMALL)
    after = found.time > rest + 1e-6
    assert np.abs(found["lower.v"][after]).max() < 1e-9
    assert np.abs(found["upper.v"][after]).max() < 1e-9
    audit(model("two_blocks_that_stick_together")).raise_if_open(SMALL)


# -- impacts -----------------------------------------------------------------------------------------------------------
def impacts(e: float, number: int) -> float:
    """The time of the number-th impact (from 1) of a ball let go 1 m above the floor."""
    return float(np.sqrt(2 / G) * (1 + 2 * sum(e**k for k in range(1, number))))


def test_ball_that_comes_to_rest() -> None:
    found = run("ball_that_comes_to_rest", sensitivities=("floor.e",))
    hits = times(found, "floor.impact")
    assert hits == pytest.approx([impacts(0.6, k + 1) for k in range(len(hits))], abs=SMALL)
    # rebounds slower than 1 mm/s end in rest: sqrt(2 g) 0.6**k < 1e-3 after the k-th impact
    assert len(hits) == int(np.ceil(np.log(1e-3 / np.sqrt(2 * G)) / np.log(0.6)))
    late = found.time > hits[-1]
    assert np.abs(found["ball.x"][late]).max() < 1e-12
    assert found["floor.N"][late] == pytest.approx(2 * G)
    assert found["ball.x"].min() > -1e-9
    exact = np.sqrt(2 / G) * 2 * sum(k * 0.6 ** (k - 1) for k in range(1, 5))
    assert found.event_sensitivity("floor.impact", 4, "floor.e") == pytest.approx(exact, rel=1e-9)
    with pytest.raises(hb.UsageError, match="happened 17 times"):
        found.event_sensitivity("floor.impact", 99, "floor.e")
    with pytest.raises(hb.UsageError, match=r"sensitivities=\['ball\.m'\]"):
        found.event_sensitivity("floor.impact", 0, "ball.m")


def test_ball_without_rest() -> None:
    with pytest.raises(hb.SimulationError) as caught:
        run("ball_without_rest")
    text = str(caught.value)
    assert "'floor.impact' happens" in text and "[event-chatter]" in text
    assert "at t = 1.80609 s" in text  # sqrt(2/g) (1 + 2 e/(1 - e))
    assert "a speed below which a body rests" in text


def test_ball_on_a_heaving_deck() -> None:
    found = run("ball_on_a_heaving_deck")
    # at rest both are integrated alike, the deck by its formula and the ball by its acceleration
    assert found["floor.gap"].min() > -1e-7
    assert found["floor.N"].min() > -SMALL
    resting = found["floor.rest"] == 1
    assert resting.any() and (~resting).any()
    assert np.abs(found["floor.gap"][resting]).max() < 1e-7
    # it leaves the deck where that falls with g: a w**2 sin(w t) = g
    w = 2 * np.pi / 0.8
    assert times(found, "floor.lift")[0] == pytest.approx(np.arcsin(G / (0.2 * w**2)) / w, abs=SMALL)
    flying = (found.time > 0.12) & (found.time < 0.45)
    assert found["der(ball.v)"][flying] == pytest.approx(-G, rel=SMALL)


def test_between_two_stops() -> None:
    found = run("between_two_stops")
    wanted, speed, t = [], 1.0, 0.2
    while t <= 3:
        wanted.append(t)
        speed *= 0.5 if len(wanted) % 2 else 0.9
        t += 0.3 / speed
    impacts = [(time, name) for time, name in found.events if not name.endswith(".begin")]
    assert [time for time, _ in impacts] == pytest.approx(wanted, abs=SMALL)
    assert [name for _, name in impacts] == (["top.impact", "bottom.impact"] * 3)[: len(wanted)]


def test_newtons_cradle() -> None:
    found = run("newtons_cradle")
    assert found.events == [(pytest.approx(0.5), "one.hit"), (pytest.approx(0.5), "two.hit")]
    assert found["first.v"][-1] == found["second.v"][-1] == pytest.approx(0, abs=1e-9)
    assert found["third.v"][-1] == pytest.approx(2, abs=1e-9)


# -- switching ---------------------------------------------------------------------------------------------------------
def test_relay_without_band() -> None:
    with pytest.raises(hb.SimulationError) as caught:
        run("relay_without_band")
    text = str(caught.value)
    assert "'relay." in text and "[event-chatter]" in text and "a band between switching on and off" in text
    assert "t = 0.142857 s" in text  # 0.5 m at 3.5 m/s


def test_band_of_a_thermostat() -> None:
    found = run("band_of_a_thermostat")
    cooling, heating = 4 * np.log(15 / 10), 4 * np.log(20 / 15)
    wanted = 4 * np.log(22 / 15) + np.cumsum([0, *[cooling, heating] * 10])
    assert [t for t, _ in found.events] == pytest.approx(wanted[wanted <= 20], rel=SMALL)


def test_check_valve_with_hysteresis() -> None:
    found = run("check_valve_with_hysteresis")
    names = [name for _, name in found.events]
    assert len(names) > 10
    assert all(a != b for a, b in pairwise(names))
    for instant in found.instants:
        x = dict(zip(found.assembly.state_names, instant.before.x, strict=True))
        limit = 5e5 if instant.names == ("valve.lift",) else 1e5
        assert x["line.p"] - x["oil.p"] == pytest.approx(limit, rel=1e-6)
    assert np.all(found["valve.q"] >= -1e-12)
    # what is open lets through at dp/R only above 1 bar
    assert found["valve.q"][found["valve.open"] == 1].min() >= 1e5 / 2e9 * (1 - SMALL)
    audit(model("check_valve_with_hysteresis")).raise_if_open(SMALL)


def test_grazing() -> None:
    found = run("grazing")
    # beyond its line by 1 nm of 0.1 m for 28 us of 0.6 s
    beyond = np.arcsin(1 - 1e-8) / 10 + 2 * np.pi / 10 * np.arange(5)
    assert times(found, "over.beyond") == pytest.approx(beyond, abs=1e-7)
    assert found["over.n"][-1] == 5
    assert found["under.n"][-1] == 0


def test_sampled_with_computing_time() -> None:
    found = run("sampled_with_computing_time")
    assert [t for t, n in found.events if n == "hold.put"] == pytest.approx(0.015 + 0.04 * np.arange(75), abs=1e-12)
    x, v, force, at = 0.2, 0.0, 0.0, 0
    for k in range(75):
        assert found["load.x"][at] == pytest.approx(x, abs=SMALL)
        taken = -20 * x - 9 * v
        for t, f in ((0.015, force), (0.025, taken)):
            x, v = x + v * t + f / 2 * t**2 / 2, v + f / 2 * t
        force, at = taken, 8 * (k + 1)


@pytest.mark.long
def test_switched_slope() -> None:
    with pytest.raises(hb.SimulationError) as caught:
        run("switched_slope")
    text = str(caught.value)
    assert "the integration stopped at t = 0.5" in text
    assert "let it happen as an event" in text


def test_a_pendulum_alone_is_not_said_to_lose_energy() -> None:
    """Let go flat, its energy is zero all the time: what it exchanges between height and speed tells what is little."""
    assert not run("pendulum_let_go_flat").verdict.findings
