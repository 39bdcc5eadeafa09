"""Margins of control loops from their transfer functions, against python-control, closed forms and frequency responses."""

from __future__ import annotations

import json
from pathlib import Path

import control
import numpy as np
import pytest
from collected import partly

import heavebond as hb
from heavebond.cli import main
from heavebond.core.units import parse_range
from heavebond.linear.linear_system import StateSpace
from heavebond.linear.margins import Crossings, crossings, loop_frequencies, loops, open_loop
from heavebond.linear.stability import Stability, stability
from heavebond.numerics.start_equations import Point
from heavebond.pictures.plot_linear import plot_bode

PD = """
model: pd
parameters: {K_p: 2 N/m, K_d: 1 N*s/m}
components:
  body:  {is: Mass, m: 1 kg}
  drive: {is: ForceSource, u: "=-K_p*body.x - K_d*body.v"}
nodes: {body: [body.a, drive.a]}
initial: {body.x: 0 m, body.v: 0 m/s}
simulate: {until: 5 s}
"""


def _open_loop(system: control.StateSpace) -> StateSpace:
    n, none = system.nstates, np.zeros(0)
    return StateSpace(tuple(f"x{k}" for k in range(n)), ("in",), ("out",), (("",) * n, ("",), ("",)), system.A, system.B,
                      system.C, system.D, np.zeros((2, 1, 1)), np.ones(n), Point(0.0, none, none, none, none, 1.0))


def _crossings(system: control.StateSpace, dead_time: float = 0.0) -> Crossings:
    closed = system.A - system.B @ system.C / (1 + system.D[0, 0])
    judged = stability(closed, np.ones(len(closed)), [f"x{k}" for k in range(len(closed))])
    return crossings(_open_loop(system), judged, dead_time=dead_time)


def _random_loop(seed: int) -> control.TransferFunction:
    """A machine of swinging modes, lags, integrators or a free body with a controller, gain anywhere over six decades."""
    random = np.random.default_rng(seed)
    numerator, denominator = np.array([1.0]), np.array([1.0])
    for _ in range(random.integers(0, 3)):  # modes from nearly undamped to overdamped
        omega, damping = 10 ** random.uniform(-1, 3), 10 ** random.uniform(-2.5, 0.3)
        denominator = np.polymul(denominator, [1 / omega**2, 2 * damping / omega, 1])
    for _ in range(random.integers(0, 3)):
        denominator = np.polymul(denominator, [10 ** random.uniform(-3, 1), 1])
    kind = seed % 4  # 0: static, 1: an integrator, 2: a free body, 3: a free body under an integrating controller
    denominator = np.polymul(denominator, [1, *[0] * kind])
    for _ in range(min(kind - 1, len(denominator) - 1) if kind else random.integers(0, 2)):
        numerator = np.polymul(numerator, [10 ** random.uniform(-2, 1), 1])
    if len(numerator) >= len(denominator):
        denominator = np.polymul(denominator, np.polymul([1e-3, 1], [2e-3, 1]))
    gain = 10 ** random.uniform(-3, 3) * (1 if kind or random.random() < 0.8 else -1)
    return control.tf(gain * numerator, denominator)


@pytest.mark.parametrize("seed", range(50))
def test_margins_are_those_of_python_control(seed: int) -> None:
    """Every crossing that python-control finds from the polynomials, and no other; 1/M_s from a dense response."""
    transfer = _random_loop(seed)
    system = control.ss(transfer)
    found = _crossings(system)
    gains, phases, _, at_gain, at_phase, _ = control.stability_margins(transfer, returnall=True)
    assert found.verdict in ("stable", "marginally stable", "unstable")
    assert found.stable is bool(np.all(np.linalg.eigvals(system.A - system.B @ system.C / (1 + system.D[0, 0])).real < 0))
    inner = [m for m in found.gain if 0 < m.frequency < np.inf]
    assert [2 * np.pi * m.frequency for m in inner] == pytest.approx(sorted(at_gain[at_gain > 0]), rel=1e-4)
    order = np.argsort(at_gain[at_gain > 0])
    assert [m.value for m in inner] == pytest.approx(gains[at_gain > 0][order], rel=1e-4)
    order = np.argsort(at_phase)
    assert [2 * np.pi * m.frequency for m in found.phase] == pytest.approx(at_phase[order], rel=1e-5)
    wanted = (phases[order] + 180) % 360 - 180
    assert [m.value for m in found.phase] == pytest.approx(wanted, abs=1e-3)
    for margin, omega, angle in zip(found.delay, at_phase[order], wanted, strict=True):
        assert margin.value == pytest.approx(np.radians(angle % 360) / omega, rel=1e-4)
    omega = np.geomspace(1e-4, 1e6, 200_001)
    dense = np.abs(1 + np.squeeze(transfer(1j * omega)))
    assert found.modulus.value <= dense.min() * (1 + 1e-9)
    at = 2 * np.pi * found.modulus.frequency
    if 0 < at < np.inf:
        assert found.modulus.value == pytest.approx(abs(1 + complex(transfer(1j * at))), rel=1e-6)


@pytest.mark.parametrize("seed", partly(range(0, 50, 3), 4))
def test_margins_with_a_dead_time_are_those_of_its_frequency_response(seed: int) -> None:
    """The exact e^(-s T), on a dense response as python-control's own data: crossings of -180 degrees by changes of sign."""
    transfer = _random_loop(seed)
    plain = _crossings(control.ss(transfer))
    fastest = 2 * np.pi * max((m.frequency for m in plain.phase), default=1.0)
    dead_time = 0.7 / fastest
    found = _crossings(control.ss(transfer), dead_time)
    omega = np.geomspace(1e-3 * fastest, 30 * fastest, 400_001)
    values = np.squeeze(transfer(1j * omega)) * np.exp(-1j * omega * dead_time)
    data = control.frd(values, omega)
    assert np.allclose(np.squeeze(data(1j * omega[::10_000])), values[::10_000])
    angle, size = values.imag / np.abs(values), np.abs(values)
    down = np.flatnonzero((np.sign(angle[:-1]) != np.sign(angle[1:])) & (values.real[:-1] < 0) & (np.abs(angle[:-1]) < 0.1))
    inside = [2 * np.pi * m.frequency for m in found.gain if omega[0] < 2 * np.pi * m.frequency < omega[-1]]
    last = max(inside, default=0.0)
    assert inside == pytest.approx(omega[down][omega[down] <= last * (1 + 1e-4)], rel=1e-4)
    factors = 1 / size[down]
    for margin, wanted in ((found.gain_up, factors[factors > 1]), (found.gain_down, -factors[factors < 1])):
        if margin is not None and len(wanted) and omega[0] < 2 * np.pi * margin.frequency < omega[-1]:
            assert margin.value == pytest.approx(abs(wanted.min()), rel=1e-3)
    assert [m.frequency for m in found.phase] == pytest.approx([m.frequency for m in plain.phase])
    for before, after in zip(plain.phase, found.phase, strict=True):
        moved = before.value - np.degrees(2 * np.pi * before.frequency * dead_time)
        assert after.value == pytest.approx((moved + 180) % 360 - 180, abs=1e-6)
    assert found.modulus.value <= np.abs(1 + values).min() * (1 + 1e-9)
    if plain.stable:  # the first root passes the axis with the least delay margin
        least = plain.least_delay
        assert found.stable is (least is None or dead_time < least.value)


def test_a_dead_time_may_stabilise_what_is_unstable_without() -> None:
    """x'' + x = k x(t - T), k = 0.5, undamped for T = 0: roots pass the axis to the left at T = 2 pi n/sqrt(1 - k), to the
    right at T = pi (2 n + 1)/sqrt(1 + k) = 2.565, 7.695, ... (Cooke, van den Driessche)."""
    plant = control.tf([-0.5], [1, 0.0, 1])
    for dead_time, verdict in ((0.0, "marginally stable"), (1.0, "stable"), (2.5, "stable"), (2.6, "unstable"),
                               (9.0, "unstable")):
        assert _crossings(control.ss(plant), dead_time).verdict == verdict, dead_time


def test_a_crossover_above_all_poles_is_found() -> None:
    """A PD controller on a free mass of 1 kg by hand: |L| = sqrt(K_p^2 + (K_d w)^2)/(m w^2) = 1."""
    found = hb.loop_margins(hb.loads(PD), "drive.u")
    omega = np.sqrt((1 + np.sqrt(1 + 4 * 4)) / 2)
    assert found.stable
    phase, = found.phase
    assert 2 * np.pi * phase.frequency == pytest.approx(omega, rel=1e-10)
    assert phase.frequency == pytest.approx(0.2547, rel=1e-3)
    assert phase.value == pytest.approx(np.degrees(np.arctan(omega / 2)), rel=1e-9)
    assert phase.value == pytest.approx(38.7, abs=0.05)
    assert found.gain == ()
    assert found.least_delay is not None
    assert found.least_delay.value == pytest.approx(np.arctan(omega / 2) / omega, rel=1e-9)


@pytest.mark.parametrize("unit", ["N", "kN", "MN"])
def test_a_display_unit_changes_no_margin(unit: str) -> None:
    """The signal at which the loop is cut also stands under `show:`, in another unit."""
    plain = hb.loop_margins(hb.loads(PD), "drive.u")
    found = hb.loop_margins(hb.loads(PD + f"show: {{drive.u: {{is: drive.u, unit: {unit}}}}}\n"), "drive.u")
    assert found.modulus.value == pytest.approx(plain.modulus.value, rel=1e-9)
    assert [m.value for m in found.phase] == pytest.approx([m.value for m in plain.phase], rel=1e-9)


def test_no_other_formula_takes_the_name_of_the_signal_at_which_a_loop_is_cut() -> None:
    """What is refused cannot be mistaken for the signal."""
    with pytest.raises(hb.ModelError, match="name-twice"):
        hb.loop_margins(hb.loads(PD + "show: {drive.u: {is: 0.01*drive.u, unit: N}}\n"), "drive.u")


def test_outputs_are_si_inside_and_in_their_unit_where_they_are_displayed() -> None:
    model = hb.loads(PD + "show: {place: {is: body.x, unit: mm}}\n")
    system = hb.state_space(model, ["body.f"], ["place"])
    omega = 1j * np.array([0.3, 3.0])
    wanted = 1 / (omega**2 + omega + 2)
    assert system.response(omega)[:, 0, 0] == pytest.approx(wanted, rel=1e-9)
    assert system.units[2] == ("m",)
    assert system.displayed().response(omega)[:, 0, 0] == pytest.approx(1e3 * wanted, rel=1e-9)
    assert system.displayed().units[2] == ("mm",)


def test_an_unstable_loop_has_no_margins() -> None:
    model = hb.loads(PD.replace("K_d: 1 N*s/m", "K_d: -0.1 N*s/m"))
    with pytest.raises(hb.UsageError, match="unstable when closed, and has no margins: growing mode at") as caught:
        hb.loop_margins(model, "drive.u")
    assert [p.code for p in caught.value.problems] == ["loop-unstable"]
    found = hb.loop_crossings(model, "drive.u")
    assert found.least_phase is not None
    assert found.least_phase.value < 0


def test_a_free_mode_outside_a_loop_keeps_its_margins() -> None:
    """Speed control of a body whose position is free: L = K/(m s), 90 degrees of phase margin."""
    model = hb.loads(PD.replace("K_p: 2 N/m", "K_p: 0 N/m"))
    found = hb.loop_margins(model, "drive.u")
    assert found.verdict == "marginally stable"
    assert found.reasons == ("rigid-body mode of body.x",)
    assert found.least_phase is not None
    assert found.least_phase.value == pytest.approx(90)


def test_a_conditionally_stable_loop_has_a_gain_margin_downwards_and_upwards() -> None:
    """L = k (s + 1)^2/(s^3 (s/100 + 1)^2): Routh's criterion gives both ends of the gain."""
    loop = control.tf(20 * np.polymul([1, 1], [1, 1]), np.polymul([1, 0, 0, 0], np.polymul([0.01, 1], [0.01, 1])))
    found = _crossings(control.ss(loop))
    assert found.stable
    assert found.gain_up is not None
    assert found.gain_down is not None
    for margin in (found.gain_up, found.gain_down):
        for factor in (0.999, 1.001):
            poles = control.feedback(factor * margin.value * loop).poles()
            inside = (factor < 1) == (margin is found.gain_up)
            assert bool((poles.real < 0).all()) is inside


def test_static_and_infinite_frequencies_are_limits_too() -> None:
    """L = -0.5/(s + 1) reaches -1 at rest with twice its gain; L = -0.25 (s + 2)/(s + 1) above all frequencies with four."""
    rest = _crossings(control.ss(control.tf([-0.5], [1, 1])))
    assert rest.gain_up is not None
    assert (rest.gain_up.value, rest.gain_up.frequency) == pytest.approx((2, 0))
    fast = _crossings(control.ss(control.tf([-0.25, -0.25 * 0.5], [1, 1])))
    assert fast.gain_up is not None
    assert fast.gain_up.value == pytest.approx(4)
    assert fast.gain_up.frequency == np.inf


def test_the_frequencies_of_a_picture_cover_the_crossovers() -> None:
    for gain in (1e-3, 1.0, 1e6):
        system = _open_loop(control.ss(control.tf([gain, gain], [1, 2, 0])))
        found = crossings(system, _judged(system))
        span = loop_frequencies(system, found)
        for margin in (*found.phase, *found.gain):
            assert span[0] < margin.frequency / 3
            assert span[-1] > 3 * margin.frequency


def _judged(system: StateSpace) -> Stability:
    return stability(system.a - system.b @ system.c, np.ones(len(system.a)), system.states)


FREE_SERVO = PD.replace("nodes: {body: [body.a, drive.a]}", """  rider: {is: Mass, m: 0.5 kg}
  hinge: {is: SpringDamper, c: 40 N/m, d: 2 N*s/m}
  other: {is: Mass, m: 2 kg}
nodes: {body: [body.a, drive.a], rider: [rider.a, hinge.a], other: [other.a, hinge.b]}""").replace(
    "body.v: 0 m/s}", "body.v: 0 m/s, rider.x: 0 m, rider.v: 0 m/s, other.x: 0 m, other.v: 0 m/s}")


FLEXIBLE = """
model: flexible
components:
  ctl:    {is: PID, r: 0 m, K_p: 400 N/m, K_i: 100 N/(m*s), K_d: 60 N*s/m, y_min: -500 N, y_max: 500 N}
  act:    {is: ForceSource}
  mass:   {is: Mass, m: 2 kg}
  spring: {is: Spring, c: 3 kN/m}
  tip:    {is: Mass, m: 0.5 kg}
  sense:  {is: PositionSensor}
nodes:
  load: [act.a, mass.a, spring.a, sense.a]
  tip: [spring.b, tip.a]
  meas: [sense.y, ctl.u]
  cmd: [ctl.y, act.u]
initial: {load.x: 0 m, load.v: 0 m/s, tip.v: 0 m/s, tip.x: 0 m}
"""


def test_a_loop_with_an_undamped_mode_has_the_margins_of_python_control() -> None:
    """A body with a tip on a spring: undamped poles and zeros on the axis, two free modes and an integrator."""
    found = hb.loop_margins(hb.loads(FLEXIBLE), "act.u")
    s = control.tf("s")
    plant = (0.5*s**2 + 3000)/((2*s**2 + 3000)*(0.5*s**2 + 3000) - 3000**2)
    loop = control.minreal((400 + 100/s + 60*s/(0.01*s + 1))*plant, verbose=False)
    gain, phase, distance, *_ = control.stability_margins(loop, returnall=True)
    assert found.least_phase is not None and found.gain_down is not None and found.modulus is not None
    least = int(np.argmin(phase[phase > 1e-6]))
    assert found.least_phase.value == pytest.approx(phase[phase > 1e-6][least], rel=1e-6)
    assert found.modulus.value == pytest.approx(distance.min(), rel=1e-5)
    assert found.gain_down.value == pytest.approx(gain[0], rel=1e-6)


def test_the_phase_of_a_plot_has_the_turns_of_poles_and_zeros() -> None:
    """Three integrations begin at -270 degrees; undamped zeros go up by 180, undamped poles down again."""
    cut = open_loop(loops(hb.loads(FLEXIBLE), "act.u").at())
    frequencies = np.array([1e-3, 10.0, 13.0, 20.0, 1e4])
    phase = np.asarray(plot_bode([cut], frequencies).axes[1].get_lines()[0].get_ydata())
    assert phase[[0, -1]] == pytest.approx([-270, -180], abs=2)
    assert -135 < phase[1] < -90 < 0 < phase[2] < 90 and -180 < phase[3] < -135


def test_a_root_locus_takes_no_free_mode_for_a_stability_boundary() -> None:
    """A pair of bodies beside the loop is free to move as one: two zeros at every value of the parameter."""
    found = hb.root_locus(hb.loads(FREE_SERVO), "K_d", parse_range("0.1 .. 3 N*s/m"))
    assert found.limits == ()
    assert {judged.verdict for judged in found.stability} == {"marginally stable"}
    assert np.all((found.poles == 0).sum(axis=1) == 2)
    found = hb.root_locus(hb.loads(FREE_SERVO), "K_d", parse_range("-1 .. 2 N*s/m"))
    assert found.limits == pytest.approx((0.0,), abs=1e-8)


@pytest.mark.long
def test_the_command_tells_margins_only_of_a_loop_that_is_not_unstable(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "pd.yaml"
    path.write_text(PD, encoding="utf-8")
    told = {}
    for gain in ("1", "-0.1"):
        with pytest.raises(SystemExit) as caught:
            main(["linear", str(path), "--loop", "drive.u", "--set", f"K_d={gain} N*s/m", "--json",
                  str(tmp_path / "told.json"), "--output", str(tmp_path / "loop.svg")])
        assert caught.value.code == 0
        told[gain] = json.loads((tmp_path / "told.json").read_text(encoding="utf-8"))
    shown = capsys.readouterr().out
    assert "no margins" in shown
    assert told["1"]["stability"] == "stable"
    assert told["1"]["margins"]["least_phase_deg"]["value"] == pytest.approx(38.67, rel=1e-3)
    assert told["-0.1"]["margins"] is None
    assert told["-0.1"]["stability"] == "unstable"
    assert told["-0.1"]["crossings"]["least_phase_deg"]["value"] < 0


def test_the_loop_of_a_diagram_is_that_of_its_transfer_function() -> None:
    """Poles and zeros of L from a diagram: (K_d s + K_p)/(m s^2)."""
    loop = open_loop(loops(hb.loads(PD), "drive.u").at())
    assert np.all(loop.poles == 0)
    assert loop.zeros() == pytest.approx([-2], rel=1e-9)
