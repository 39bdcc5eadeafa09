"""Linear analysis against hand-written matrices and transfer functions (SciPy, python-control), and runs."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import control
import numpy as np
import pytest
import scipy.linalg
from test_linearisation import FREE, OSCILLATOR
from test_sensitivities import LOOP

import heavebond as hb
from heavebond.cli import main
from heavebond.core.units import parse_range
from heavebond.linear import linear_system
from heavebond.linear.linear_system import LINEAR_SYSTEM, spread
from heavebond.linear.linearisation import Linearisation
from heavebond.linear.modal_values import energy_shares
from heavebond.linear.operating_point import OperatingPoints
from heavebond.pictures.plot_linear import plot_bode, plot_nyquist

# passive_rig by hand: masses, stiffnesses and dampings of the diagram
M, C, D, C_S, D_S = 120e3, 42e3, 52e3, 217e3, 8e3
OMEGA = np.geomspace(0.05, 50, 40)
QUARTER_CAR = """
model: quarter_car
summary: Body and wheel of a car over a road.
components:
  road:   {is: PositionSource, u: 0 m}
  tyre:   {is: Spring, c: 190 kN/m}
  wheel:  {is: Mass, m: 45 kg}
  strut:  {is: SpringDamper, c: 16 kN/m, d: 1.2 kN*s/m}
  body:   {is: Mass, m: 300 kg}
nodes:
  road:  [road.a, tyre.a]
  wheel: [tyre.b, wheel.a, strut.a]
  body:  [strut.b, body.a]
initial: {start: rest, body.x: 0 m, wheel.x: 0 m}
simulate: {until: 2 s, every: 1 ms}
"""
SERVO = """
model: servo
components:
  drive: {is: ForceSource, u: 0 N}
  load:  {is: Mass, m: 2 kg}
  drag:  {is: Damper, d: 3 N*s/m}
  frame: {is: Fixed}
  gauge: {is: PositionSensor}
  control: {is: Gain, k: 50 N/m}
  lag:   {is: FirstOrderLag, T_1: 20 ms}
nodes:
  load:  [drive.a, load.a, drag.b, gauge.a]
  frame: [frame.a, drag.a]
  x:     [gauge.y, control.u]
  wanted: [control.y, lag.u]
initial: {load.x: 0 m, load.v: 0 m/s}
set: {drive.u: =-lag.y}
simulate: {until: 1 s}
"""


def _command(words: list[str], tmp_path: Path) -> dict[str, object]:
    told = tmp_path / "told.json"
    with pytest.raises(SystemExit) as caught:
        main([*words, "--json", str(told)])
    assert caught.value.code == 0
    found = json.loads(told.read_text(encoding="utf-8"))
    assert isinstance(found, dict)
    return found


def _by_hand() -> control.TransferFunction:
    """crown.x / platform.x of the passive rig: (d s + c) / (m s^2 + (d + d_s) s + c + c_s)."""
    return control.tf([D, C], [M, D + D_S, C + C_S])


def test_a_position_source_passes_its_speed_on() -> None:
    """The source ties the platform's speed to u': the transfer function has the damper's zero."""
    system = hb.state_space(hb.load("passive_rig"), ["vessel.u"], ["crown.x"])
    magnitude, phase, _ = control.frequency_response(_by_hand(), OMEGA)
    expected = np.squeeze(magnitude) * np.exp(1j * np.squeeze(phase))
    assert np.allclose(system.response(1j * OMEGA)[:, 0, 0], expected, rtol=1e-10)
    own = system.to_control()  # the exported matrices, by python-control's own evaluation
    assert np.allclose(np.squeeze(own(1j * OMEGA)), expected, rtol=1e-10)
    by_scipy = system.to_scipy()
    response = by_scipy.C @ np.linalg.solve(1j * OMEGA[0] * np.eye(2) - by_scipy.A, by_scipy.B) + by_scipy.D
    assert np.allclose(np.squeeze(response), expected[0], rtol=1e-10)
    assert system.zeros() == pytest.approx([-C / D], rel=1e-9)
    assert np.sort_complex(system.poles) == pytest.approx(np.sort_complex(_by_hand().poles()), rel=1e-9)
    assert system.units == (("m/s", "m"), ("m",), ("m",))


def test_a_force_that_follows_the_speed_of_its_input_is_not_proper() -> None:
    """Damper force / platform position = d s (G - 1): no state space, but a frequency response."""
    system = hb.state_space(hb.load("passive_rig"), ["vessel.u"], ["damper.F"])
    s = 1j * OMEGA
    expected = D * s * (np.squeeze(_by_hand()(s)) - 1)
    assert np.allclose(system.response(s)[:, 0, 0], expected, rtol=1e-9)
    assert not system.proper
    zeros = np.sort_complex(system.zeros())  # d s (G - 1) = -d s (m s^2 + d_s s + c_s) / (...)
    assert zeros == pytest.approx(np.sort_complex(np.roots([M, D_S, C_S, 0])), rel=1e-7, abs=1e-9)
    for exported in (system.to_control, system.to_scipy):
        with pytest.raises(hb.UsageError, match=r"follows the derivative of 'vessel\.u'"):
            exported()


def test_a_force_from_outside_and_an_output_in_its_unit() -> None:
    system = hb.state_space(hb.load("passive_rig"), ["crown.f"], ["crown", "string_force"])
    s = 1j * OMEGA
    compliance = 1 / (M * s**2 + (D + D_S) * s + C + C_S)
    assert np.allclose(system.response(s)[:, 0, 0], compliance, rtol=1e-10)
    found = system.displayed().response(s)
    assert np.allclose(found[:, 0, 0], 1e3 * compliance, rtol=1e-10)  # mm
    assert np.allclose(found[:, 1, 0], 1e-3 * (C_S + D_S * s) * compliance, rtol=1e-10)  # kN


def test_a_quarter_car_has_the_eigenvalues_of_its_matrices() -> None:
    """M q'' + D q' + K q = 0 as a quadratic eigenvalue problem by SciPy."""
    mass, damping = np.diag([45.0, 300.0]), 1200 * np.array([[1, -1], [-1, 1.0]])
    stiffness = np.array([[190e3 + 16e3, -16e3], [-16e3, 16e3]])
    whole = np.block([[np.zeros((2, 2)), np.eye(2)],
                      [-np.linalg.solve(mass, stiffness), -np.linalg.solve(mass, damping)]])
    values, vectors = scipy.linalg.eig(whole)
    system = hb.state_space(hb.loads(QUARTER_CAR), ["road.u"], ["body.x"])
    assert np.sort_complex(system.poles) == pytest.approx(np.sort_complex(values), rel=1e-9)
    points = OperatingPoints(hb.loads(QUARTER_CAR))
    point = points.at()
    modes = Linearisation(points.assembly).at(point).modes()
    shares = energy_shares(points.assembly, point, modes)
    for mode, share in zip(modes, shares, strict=True):
        q = vectors[:2, int(np.argmin(np.abs(values - mode.value)))]
        sizes = {"wheel": 45 * abs(mode.value * q[0])**2, "body": 300 * abs(mode.value * q[1])**2,
                 "tyre": 190e3 * abs(q[0])**2, "strut": 16e3 * abs(q[1] - q[0])**2}
        for name, size in sizes.items():
            assert share.energy[name] == pytest.approx(size / sum(sizes.values()), rel=1e-6), name
        assert share.damping == pytest.approx({"strut": 1.0}, rel=1e-6)


def test_a_step_is_what_a_run_does() -> None:
    """The linear machine's step against the integrator: the quarter car is linear, its road rises by 10 mm at the start."""
    system = hb.state_space(hb.loads(QUARTER_CAR), ["road.u"], ["body.x"])
    run = hb.simulate(hb.loads(QUARTER_CAR.replace("u: 0 m", "u: 10 mm")), 2)
    linear = 0.01 * system.step(run.time)[:, 0, 0]
    assert np.abs(linear - run["body.x"]).max() < 1e-7  # a hundred thousandth of the motion: the integrator's errors
    assert system.step(np.linspace(0, 60, 601))[-1, 0, 0] == pytest.approx(1, rel=1e-6)


def test_parameters_are_inputs_and_loops_are_eliminated() -> None:
    """Two turbulent orifices in series share a pressure as the squares of their flows: mid = p_0 q_1^2/(q_1^2 + q_2^2)."""
    model = hb.loads(LOOP)
    values = hb.assemble(model).parameter_values
    share = values["first.q_r"]**2 / (values["first.q_r"]**2 + values["second.q_r"]**2)
    system = hb.state_space(model, ["source.p_0"], ["mid.p"])
    assert not system.states
    assert system.d[0, 0] == pytest.approx(share, rel=1e-4)  # the laminar transition at small differences
    assert system.response(np.zeros(1))[0, 0, 0] == system.d[0, 0]


def test_the_margins_of_a_hand_written_loop() -> None:
    """L = k / ((m s^2 + d s)(T s + 1)) by python-control; cut anywhere in the loop it is the same."""
    loop = control.tf([50], np.polymul([2, 3, 0], [0.02, 1]))
    gain, phase, at_gain, at_phase = control.margin(loop)
    for signal in ("wanted", "x", "drive.u"):
        found = hb.loop_margins(hb.loads(SERVO), signal)
        assert found.stable
        assert found.least_gain is not None
        assert found.least_phase is not None
        assert found.least_delay is not None
        assert found.least_gain.value == pytest.approx(gain, rel=1e-8)
        assert found.least_gain.frequency == pytest.approx(at_gain / (2 * np.pi), rel=1e-8)
        assert found.least_phase.value == pytest.approx(phase, rel=1e-7)
        assert found.least_phase.frequency == pytest.approx(at_phase / (2 * np.pi), rel=1e-8)
        assert found.least_delay.value == pytest.approx(np.radians(phase) / at_phase, rel=1e-7)
        omega = 2 * np.pi * found.modulus.frequency
        near = np.abs(1 + np.squeeze(loop(1j * omega * np.linspace(0.99, 1.01, 201))))
        assert found.modulus.value == pytest.approx(near.min(), rel=1e-6)


def test_a_gain_at_the_margin_is_at_the_limit_of_stability() -> None:
    model = hb.loads(SERVO)
    margin = hb.loop_margins(model, "x").least_gain
    assert margin is not None
    critical = 50 * margin.value
    assert hb.state_space(model, ["x"], ["x"], parameters={"control.k": 0.999 * critical}).stable
    assert not hb.state_space(model, ["x"], ["x"], parameters={"control.k": 1.001 * critical}).stable
    locus = hb.root_locus(model, "control.k", parse_range("0 .. 600 N/m"))
    assert locus.limits == pytest.approx((critical,), rel=1e-7)
    assert np.sort_complex(locus.poles[-1]) == pytest.approx(np.sort_complex(
        np.roots(np.polyadd(np.polymul([2, 3, 0], [0.02, 1]), [600]))), rel=1e-8)


def test_the_compensators_margin_is_the_gain_at_which_it_grows() -> None:
    """The loop is closed by the position gain alone; the speed that is measured is the platform's."""
    model = hb.load("cmc_ahc")
    margin = hb.loop_margins(model, "command").least_gain
    assert margin is not None
    gain = hb.assemble(model).parameter_values["controller.K_p"]
    for factor, stable in ((0.999, True), (1.001, False)):
        values = {"controller.K_p": gain * factor * margin.value}
        assert hb.state_space(model, ["heave"], ["crown.x"], parameters=values).stable is stable


def test_matrices_are_derivatives_also_at_a_time() -> None:
    """Central differences of the rates around the state of a run after 20 s."""
    model = hb.load("cmc_ahc/active_frictionless")
    assembly = hb.assemble(model)
    operating = OperatingPoints(model, "20 s")
    linear = Linearisation(operating.assembly).at(operating.at())
    point, step = operating.at(), 1e-4
    moved = np.zeros((len(point.x), len(point.x)))
    for k in range(len(point.x)):
        ends = []
        for sign in (-1, 1):
            x = point.x.copy()
            x[k] += sign * step * assembly.x_nominal[k]
            ends.append(np.array(assembly.rates(20.0, x, point.z, point.p, np.zeros(0), 1.0)[0]).ravel())
        moved[:, k] = (ends[1] - ends[0]) / (2 * step * assembly.x_nominal[k])
    sizes = assembly.x_nominal
    # central differences over 1e-4 of the usual sizes: errors of their square, times curvature
    assert np.allclose(linear.a * sizes / sizes[:, None], moved * sizes / sizes[:, None], rtol=1e-4, atol=1e-3)


def test_a_steady_state_holds_its_inputs_still() -> None:
    model = hb.loads(OSCILLATOR.replace("u: =force", 'u: "=force + 3 N*sin(5*time/1 s) + 1 N"'))
    point = OperatingPoints(model, "steady").at()
    assert point.rate == 0
    assert point.x == pytest.approx([0, 6 / 4000], abs=1e-12)
    assert OperatingPoints(model, "steady").words == "in its steady state"
    assert OperatingPoints(hb.load("cmc_ahc"), "steady").at().x == pytest.approx(OperatingPoints(hb.load("cmc_ahc")).at().x)


def test_other_states_are_not_linearised() -> None:
    """The four-bar linkage changes its states while it turns: that is said, and nothing else taken instead."""
    model = hb.load("mechanisms/four_bar")
    result = hb.simulate(model, "0.3 s")
    during = float(result.time[result.stays[0][0][-1]])
    with pytest.raises(hb.UsageError, match="integrated in other states"):
        OperatingPoints(model, during).at()


def test_a_measured_input_at_a_time(tmp_path: Path) -> None:
    """A record between whose samples the machine is linearised: pieces are expanded about that time."""
    (tmp_path / "road.csv").write_text("t,x\n" + "".join(f"{t / 10},{np.sin(t / 10)}\n" for t in range(41)))
    record = "u: {file: road.csv, column: x, unit: m, interpolation: spline}"
    (tmp_path / "car.yaml").write_text(QUARTER_CAR.replace("u: 0 m", record))
    for at in (None, "1.234 s"):
        system = hb.state_space(hb.load(tmp_path / "car.yaml"), ["road.u"], ["body.x", "tyre.F"], at=at)
        plain = hb.state_space(hb.loads(QUARTER_CAR), ["road.u"], ["body.x", "tyre.F"])
        assert np.allclose(system.response(1j * OMEGA), plain.response(1j * OMEGA), rtol=1e-9)


@pytest.mark.parametrize(("inputs", "outputs", "message"), [
    (["vessel.w"], ["crown.x"], "nothing here is called 'vessel.w'"),
    (["crown.x"], ["crown.x"], "nothing can be added to 'crown.x'"),
    (["vessel.u"], ["crown.z"], r"crown\.z")])
def test_wrong_names_are_said(inputs: list[str], outputs: list[str], message: str) -> None:
    with pytest.raises(hb.UsageError, match=message):
        hb.state_space(hb.load("passive_rig"), inputs, outputs)


def test_a_signal_outside_every_loop_has_no_margins() -> None:
    with pytest.raises(hb.UsageError, match="is in no loop"):
        hb.loop_margins(hb.load("cmc_ahc"), "platform_velocity")


@pytest.mark.long
def test_the_command_tells_and_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for kind in ("bode", "nyquist", "poles", "step"):
        path = tmp_path / f"{kind}.png"
        told = _command(["linear", "passive_rig", "--from", "vessel.u,crown.f", "--to", "crown.x", "--picture", kind,
                         "--output", str(path), "--save", str(tmp_path / "rig.npz")], tmp_path)
        assert path.stat().st_size > 10_000
    saved = np.load(tmp_path / "rig.npz")
    assert np.allclose(saved["A"], told["A"])
    assert list(saved["outputs"]) == ["crown.x"]
    channels = told["channels"]
    assert isinstance(channels, list)
    assert channels[0]["static_gain"] == pytest.approx(C / (C + C_S), rel=1e-6)
    assert channels[1]["peak_gain"] == pytest.approx(np.abs(1 / (
        M * (1j * OMEGA)**2 + (D + D_S) * 1j * OMEGA + C + C_S)).max(), rel=0.02)
    told = _command(["linear", "cmc_ahc", "--loop", "command", "--output", str(tmp_path / "loop.svg")], tmp_path)
    assert "gain" in capsys.readouterr().out
    assert told["stable"] is True
    told = _command(["linear", "cmc_ahc", "--over", "controller.K_p=0 .. 8 1/m", "--output", str(tmp_path / "l.pdf")],
                    tmp_path)
    assert len(told["limits"]) == 1


def chain(n: int) -> hb.Model:
    """n masses behind springs of different stiffness, the last one pulled."""
    parts = [f"  m_{k}: {{is: Mass, m: 1 kg}}\n  s_{k}: {{is: SpringDamper, c: {100 + k} N/m, d: 0.3 N*s/m}}"
             for k in range(n)]
    nodes = [f"  n_{k}: [m_{k}.a, s_{k}.b" + (f", s_{k + 1}.a]" if k + 1 < n else ", pull.a]") for k in range(n)]
    ends = ["  wall: {is: Fixed}", "  pull: {is: ForceSource, u: 0 N}"]
    return hb.loads("\n".join(["model: chain", "components:", *ends, *parts, "nodes:", "  ground: [wall.a, s_0.a]", *nodes]))


def test_many_states_are_solved_by_sparse_factors(monkeypatch: pytest.MonkeyPatch) -> None:
    """As by dense ones, in blocks of any size, with several channels."""
    system = hb.state_space(chain(60), ["pull.u"], ["n_0.v", "n_59.v"])
    assert len(system.states) == 120
    points = 2j * np.pi * np.geomspace(1e-3, 10, 50)
    sparse = system.response(points)
    monkeypatch.setattr(linear_system, "LINEAR_SYSTEM", replace(LINEAR_SYSTEM, sparse=1000, block=7 * 120**2))
    dense = system.response(points)
    assert np.abs(sparse - dense).max() < 1e-11 * np.abs(dense).max()
    assert np.abs(sparse / dense - 1).max() < 1e-6  # also where the far end hardly moves


def test_many_resonances_share_their_points() -> None:
    poles = np.array([complex(-0.01, w) for w in np.geomspace(1, 1000, 1000)])
    assert len(spread(poles, poles)) < LINEAR_SYSTEM.points + 2 * LINEAR_SYSTEM.most_near
    one = np.array([complex(-0.01, 1.0)])
    assert len(spread(one, one)) == LINEAR_SYSTEM.points + LINEAR_SYSTEM.near


UNDAMPED = """
model: undamped
components:
  frame:  {is: Fixed}
  spring: {is: Spring, c: 1 kN/m}
  mass:   {is: Mass, m: 1 kg}
nodes: {frame: [frame.a, spring.a], load: [spring.b, mass.a]}
"""


def test_the_response_at_an_undamped_resonance_is_infinite(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "undamped.yaml").write_text(UNDAMPED)
    for picture in ("bode", "nyquist", "step"):
        told = _command(["linear", str(tmp_path / "undamped.yaml"), "--from", "load.f", "--to", "load.x", "--picture",
                         picture, "--output", str(tmp_path / f"{picture}.png")], tmp_path)
        channel = told["channels"][0]
        assert channel["peak_gain"] is None
        assert channel["peak_frequency"] == pytest.approx(np.sqrt(1000) / 2 / np.pi, rel=1e-12)
        assert channel["static_gain"] == pytest.approx(1e-3, rel=1e-12)
    system = hb.state_space(hb.loads(UNDAMPED), ["load.f"], ["load.x"])
    assert system.unbounded() == pytest.approx([np.sqrt(1000) / 2 / np.pi])
    around = 1j * np.sqrt(1000) * np.array([0.5, 1.0, 2.0])
    for sparse in (LINEAR_SYSTEM.sparse, 0):
        monkeypatch.setattr(linear_system, "LINEAR_SYSTEM", replace(LINEAR_SYSTEM, sparse=sparse, dense=1.0))
        found = system.response(around)[:, 0, 0]
        assert found[[0, 2]] == pytest.approx([1e-3 / 0.75, -1e-3 / 3])
        assert np.isinf(np.abs(found[1]))
    drawn = plot_bode([system], system.frequencies())
    phase = np.asarray(drawn.axes[1].get_lines()[0].get_ydata())
    assert phase[[0, -1]] == pytest.approx([0.0, -180.0])


def test_zeros_of_many_states_are_left_out_of_the_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "oscillator.yaml").write_text(OSCILLATOR)
    words = ["linear", str(tmp_path / "oscillator.yaml"), "--from", "push.u", "--to", "load.x", "--json",
             str(tmp_path / "found.json")]
    monkeypatch.setattr(linear_system, "LINEAR_SYSTEM", replace(LINEAR_SYSTEM, zeros=1))
    with pytest.raises(SystemExit):
        main(words)
    assert json.loads((tmp_path / "found.json").read_text())["channels"][0]["zeros"] is None


def test_a_nyquist_curve_has_a_plane_for_each_unit_and_no_corners() -> None:
    system = hb.state_space(hb.load("cmc_ahc"), ["heave"], ["crown.x", "WOB"])
    channels = [system.channel(name, "heave").displayed() for name in ("crown.x", "WOB")]
    figure = plot_nyquist(channels, np.geomspace(0.01, 100, 60))
    assert [axes.get_xlabel() for axes in figure.axes] == ["real part [–]", "real part [kN / m]"]
    for axes, channel in zip(figure.axes, channels, strict=True):
        curve = max(axes.get_lines(), key=lambda line: len(line.get_xdata()))
        points = np.asarray(curve.get_xdata()) + 1j * np.asarray(curve.get_ydata())
        assert np.abs(np.diff(points)).max() < 0.05 * np.abs(points).max()
        assert np.abs(points).max() == pytest.approx(  # the peaks are between the 60 frequencies
            np.abs(channel.response(2j * np.pi * np.geomspace(0.1, 3, 20_000))).max(), rel=1e-3)


@pytest.mark.parametrize(("words", "message"), [
    ([], "no input and output are given"), (["--loop", "command", "--from", "heave"], "exclude each other"),
    (["--over", "controller.K_p=3"], "--over"),
    (["--from", "heave", "--to", "crown.x", "--frequencies", "1 .. 2 m"], "in Hz"),
    (["--from", "heave", "--to", "crown.x", "--at", "1 s", "--steady"], "two operating points")])
def test_wrong_usage_is_said(words: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["linear", "cmc_ahc", *words])
    assert caught.value.code == 2
    assert message in " ".join(capsys.readouterr().err.split())


def test_modes_name_components_at_any_operating_point(tmp_path: Path) -> None:
    (tmp_path / "free.yaml").write_text(FREE)
    told = _command(["modes", str(tmp_path / "free.yaml"), "--at", "0.3 s"], tmp_path)
    moving = [mode for mode in told["modes"] if mode["real"] or mode["imaginary"]]
    # kinetic energy is half of all, in inverse proportion to the masses: 3 to 1
    assert moving[0]["energy"] == pytest.approx({"spring": 0.5, "one": 0.375, "two": 0.125}, rel=1e-6)
    assert told["at"] == "at 0.3 s"
    told = _command(["modes", "cmc_ahc", "--steady"], tmp_path)
    assert told["at"] == "in its steady state"


@pytest.mark.parametrize(("span", "code"), [("0 .. 8", "unit-missing"), ("0 .. 8 kN", "unit-wrong")])
def test_a_locus_runs_over_values_of_the_parameters_unit(span: str, code: str) -> None:
    with pytest.raises(hb.UsageError) as caught:
        hb.root_locus(hb.load("cmc_ahc"), "controller.K_p", parse_range(span))
    assert [p.code for p in caught.value.problems] == [code]
    assert "1/m" in str(caught.value)


ELECTRICAL = """
model: branches
components:
  v: {is: VoltageSource, u: 0 V}
  c: {is: Capacitor, C: 1 uF}
  r: {is: Resistor, R: 1 kohm}
  l: {is: Inductor, L: 1 mH}
  g: {is: ElectricalGround}
nodes: {p: [v.a, c.a, l.a], q: [c.b, r.a], n: [v.b, r.b, l.b, g.a]}
simulate: {until: 1 ms}
"""
PLATES = """
model: plates
components:
  a: {is: HeatCapacity, m: 1 kg, c: 500 J/(kg*K)}
  b: {is: HeatCapacity, m: 3 kg, c: 500 J/(kg*K)}
  r: {is: ThermalResistance, R: 2 K/W}
  q: {is: HeatSource, u: 0 W}
nodes: {a: [a.a, r.a, q.a], b: [b.a, r.b]}
simulate: {until: 1 s}
"""
CYLINDER = """
model: cylinder
components:
  q: {is: FlowSource, u: 0 L/min}
  c: {is: SingleActingCylinder, A_A: 20 cm**2, V_0: 1 L, beta: 1 GPa}
  m: {is: Mass, m: 50 kg}
  d: {is: Damper, d: 100 N*s/m}
  w: {is: Fixed}
nodes: {p: [q.a, c.A], w: [c.a, w.a, d.a], x: [c.b, m.a, d.b]}
initial: {x.x: 0.1 m, x.v: 0 m/s, p.p: 0 bar}
simulate: {until: 1 s}
"""
DERIVATIVE = """
model: cancelled
components: {i: {is: Integrator, k: 3 1/s, u: 0}, d: {is: FilteredDerivative, T_f: 0.1 s}}
nodes: {a: [i.y, d.u]}
initial: {i.y: 0}
simulate: {until: 1 s}
"""


@pytest.mark.parametrize(("text", "source", "gains"), [
    (ELECTRICAL, "v.u", {"q.v": 0.0, "l.i": np.inf, "r.i": 0.0}),  # a capacitor blocks, an inductor shorts
    (PLATES, "q.u", {"a.T": np.inf, "a.T - b.T": 2 * 0.75, "r.Q": 0.75}),  # three quarters of the heat flow on
    (CYLINDER, "q.u", {"x.x": np.inf, "x.v": 1 / 20e-4, "p.p": 100 / 20e-4**2}),
    (DERIVATIVE, "i.u", {"d.y": 3.0}),  # a zero at 0 cancels the integrator
], ids=["electrical", "thermal", "hydraulic", "signal"])
def test_gains_at_zero_frequency_beside_integrators(text: str, source: str, gains: dict[str, float]) -> None:
    for output, gain in gains.items():
        found = hb.state_space(hb.loads(text), [source], [output]).dc_gain()[0, 0]
        assert found == pytest.approx(gain, rel=1e-9, abs=1e-12), output
