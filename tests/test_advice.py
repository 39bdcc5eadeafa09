"""Refusals that should work, and advice of messages that must lead on when it is followed."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import heavebond as hb
from heavebond.cli import main
from heavebond.core.errors import HeavebondError, ModelError, SimulationError, StartError
from heavebond.records.measurements import read_table

MOTION = """\
model: motion
components:
  t: {is: TrapezoidalMotion, end: 1 m, v: 0.5 m/s, a: 1 m/s**2}
  p: {is: PositionSource}
  s: {is: SpringDamper, c: 10 kN/m, d: 2 kN*s/m}
  m: {is: Mass, m: 100 kg}
nodes: {u: [t.y, p.u], a: [p.a, s.a], m: [s.b, m.a]}
initial: {m.x: 0 m, m.v: 0 m/s}
show: {x: {is: m.x, unit: mm}, u: {is: p.u, unit: mm}}
simulate: {until: 4 s, every: 10 ms}
"""
RIGID = """\
model: rigid
components:
  t: {is: TrapezoidalMotion, end: 1 m, v: 0.5 m/s, a: 1 m/s**2}
  p: {is: PositionSource}
  m: {is: Mass, m: 100 kg}
nodes: {u: [t.y, p.u], a: [p.a, m.a]}
show: {F: {is: p.a.f, unit: N}}
simulate: {until: 4 s, every: 10 ms}
"""
FORMULA = RIGID.replace("  t: {is: TrapezoidalMotion, end: 1 m, v: 0.5 m/s, a: 1 m/s**2}\n", "") \
    .replace("u: [t.y, p.u], ", "")


def formula(text: str) -> str:
    """The rigid mass, moved by a formula of the time."""
    return FORMULA.replace("{is: PositionSource}", f'{{is: PositionSource, u: "={text}"}}')


def trapezoid(t: np.ndarray) -> np.ndarray:
    """The motion over 1 m with 0.5 m/s and 1 m/s**2, written out: 0.5 s of acceleration, 1.5 s at full speed, 0.5 s of
    deceleration."""
    return np.piecewise(t, [t < 0.5, (t >= 0.5) & (t < 2), (t >= 2) & (t < 2.5), t >= 2.5],
                        [lambda t: t**2 / 2, lambda t: 0.125 + 0.5 * (t - 0.5), lambda t: 1 - (2.5 - t)**2 / 2, 1.0])


def test_a_position_source_follows_a_trapezoidal_motion() -> None:
    """Its position is differentiable, though it is written with `max` and `min`. The mass follows to its end; by then the
    spring-damper has let it settle by exp(-zeta*omega*1.5 s) = exp(-15)."""
    run = hb.simulate(hb.loads(MOTION))
    assert run.display["u"] == pytest.approx(1000 * trapezoid(run.time), abs=1e-6)  # rounding
    assert run.display["x"][-1] == pytest.approx(1000, abs=0.1)


def test_a_rigid_mass_follows_a_motion_whose_speed_is_continuous() -> None:
    """The force is m*a with its steps; a formula with `max` whose rate is continuous is followed, too."""
    run = hb.simulate(hb.loads(RIGID))
    inside = np.abs(run.time[:, None] - [0, 0.5, 2, 2.5]).min(axis=1) > 1e-3
    expected = 100 * ((run.time < 0.5) * 1.0 - ((run.time > 2) & (run.time < 2.5)))
    assert np.abs(-run["F"] - expected)[inside].max() == pytest.approx(0, abs=1e-6)  # rounding of the second derivative
    run = hb.simulate(hb.loads(formula("0.1 m/s**2*max(time - 1 s, 0 s)**2")))
    assert np.abs(run["F"][run.time > 1.01]) == pytest.approx(20, abs=1e-6)  # m * 2 * 0.1 m/s**2
    assert np.abs(run["F"][run.time < 0.99]).max() == 0


def test_a_rigid_mass_does_not_follow_a_step_in_speed_and_the_advice_works() -> None:
    """Its force would be an impulse, which no run shows. The motion that the message names is followed."""
    with pytest.raises(ModelError, match="max has a kink") as caught:
        hb.simulate(hb.loads(formula("0.1 m/s*max(time - 1 s, 0 s)")))
    assert "SCurveMotion" in str(caught.value)
    run = hb.simulate(hb.loads(RIGID.replace("TrapezoidalMotion, end: 1 m, v: 0.5 m/s, a: 1 m/s**2",
                                             "SCurveMotion, end: 1 m, T: 2 s")))
    expected = 100 * np.pi / 2 * np.sin(np.pi * run.time) * (run.time < 2)  # m * 2 pi way / T**2 * sin(2 pi t / T)
    assert np.abs(run["F"]) == pytest.approx(np.abs(expected), abs=1e-5)


PARALLELOGRAM = """\
model: parallelogram
components:
  g0: {is: PlanarFixed}
  g1: {is: PlanarFixed, x_0: 1 m}
  g2: {is: PlanarFixed, x_0: 2 m}
  p0: {is: RevoluteJoint}
  p1: {is: RevoluteJoint}
  p2: {is: RevoluteJoint}
  k0: {is: RigidLink, l: 1 m}
  k1: {is: RigidLink, l: 1 m}
  k2: {is: RigidLink, l: 1 m}
  q0: {is: RevoluteJoint}
  q1: {is: RevoluteJoint}
  q2: {is: RevoluteJoint}
  b01: {is: RigidLink, l: 1 m}
  b12: {is: RigidLink, l: 1 m}
  m: {is: PlanarBody, m: 10 kg, J: 1 kg*m**2, l_g: 1 m}
nodes:
  g0: [g0.a, p0.a]
  g1: [g1.a, p1.a]
  g2: [g2.a, p2.a]
  c0: [p0.b, k0.a]
  c1: [p1.b, k1.a]
  c2: [p2.b, k2.a]
  e0: [k0.b, q0.a]
  e1: [k1.b, q1.a]
  e2: [k2.b, q2.a]
  t0: [q0.b, b01.a, m.a]
  t1: [q1.b, b01.b, b12.a]
  t2: [q2.b, b12.b]
initial: {c0.phi: 60 deg, c0.w: 0 rad/s, c1.phi: ~ 60 deg, c2.phi: ~ 60 deg}
show: {phi: {is: c0.phi, unit: deg}}
simulate: {until: 0.8 s, every: 10 ms}
"""


def test_a_redundant_crank_is_named_and_without_it_the_machine_runs() -> None:
    """Three parallel cranks: the zeros of the links have nothing to do with it. Without the middle crank the motion is that
    of the body on two cranks, phi'' = -g cos(phi) / l, here integrated by SciPy."""
    from scipy.integrate import solve_ivp

    with pytest.raises(StartError) as caught:
        hb.simulate(hb.loads(PARALLELOGRAM))
    text = str(caught.value)
    assert "redundant" in text and "'k1'" in text and ".h" not in text
    # it stays clear of phi = 0, where all links lie in one line
    without = re.sub(r"  (p1|k1|q1|g1): .*\n|  (g1|c1|e1): .*\n", "", PARALLELOGRAM).replace("q1.b, ", "") \
        .replace("c1.phi: ~ 60 deg, ", "").replace("until: 0.8 s", "until: 0.5 s")
    run = hb.simulate(hb.loads(without))
    exact = solve_ivp(lambda t, y: [y[1], -9.81 * np.cos(y[0])], (0, 0.5), [np.pi / 3, 0], rtol=1e-10, atol=1e-12)
    assert run.display["phi"][-1] == pytest.approx(np.degrees(exact.y[0, -1]), abs=0.01)  # the integration's own error


SLIP = """\
model: slip
components:
  frame:    {is: Fixed}
  spring:   {is: SpringWithPlay, c: 5 kN/mm, gap: 3 mm}
  friction: {is: DirectionalFriction, F_p: 9 kN, F_n: 9 kN, v_t: 1 mm/s}
  drive:    {is: PositionSource, u: "=20 mm*sin(2*pi*time/3 s)"}
nodes:
  frame: [frame.a, spring.a]
  shoe:  [spring.b, friction.a]
  rod:   [friction.b, drive.a]
show: {force: {is: spring.F, unit: kN}}
simulate: {until: 1 s, every: 10 ms}
"""


def test_a_node_without_mass_is_named_and_with_the_mass_of_the_message_the_run_succeeds() -> None:
    with pytest.raises(SimulationError) as caught:
        hb.simulate(hb.loads(SLIP))
    line = re.search(r"`(shoe_mass: \{is: Mass, m: 1 kg\})`", str(caught.value))
    assert line is not None, str(caught.value)
    cured = SLIP.replace("nodes:", f"  {line.group(1)}\nnodes:").replace("friction.a]", "friction.a, shoe_mass.a]")
    run = hb.simulate(hb.loads(cured))
    assert np.abs(run.display["force"]).max() == pytest.approx(9, rel=0.05)  # it slides at 9 kN; the 1 kg adds a little


def test_a_bundled_diagram_is_extended_by_its_name_and_a_wrong_name_gets_a_near_one(tmp_path: Path) -> None:
    assert hb.loads("model: b\nextends: bundled:cmc_ahc/designed\n", tmp_path).show == hb.load("cmc_ahc/designed").show
    assert hb.load("bundled:quarter_car").name == hb.load("quarter_car").name
    with pytest.raises(HeavebondError, match=r"no bundled diagram 'cmc_ahc/desined'(?s:.*)Did you mean 'cmc_ahc/designed'"):
        hb.loads("model: b\nextends: bundled:cmc_ahc/desined\n", tmp_path)
    for outside in ("bundled:../pyproject", "bundled:/etc/hosts.yaml"):
        with pytest.raises(HeavebondError, match="there is no bundled"):
            hb.load(outside)


PENDULUM = """\
model: pendulum
components:
  frame:   {is: FixedShaft}
  bearing: {is: RotationalDamper, d: 1e-3 N*m*s/rad}
  arm:     {is: ArmWeight, m: 0.5 kg, l: 0.4 m}
  rotor:   {is: Inertia, J: 0.08 kg*m**2}
nodes:
  frame: [frame.a, bearing.a]
  shaft: [bearing.b, arm.a, rotor.a]
initial: {shaft.phi: 2 rad, shaft.w: 0 rad/s}
show: {angle: {is: shaft.phi, unit: rad}}
simulate: {until: 5 s, every: 10 ms}
"""


def test_the_advice_for_an_output_that_is_a_formula_can_be_followed(tmp_path: Path) -> None:
    """The record of a pendulum that began at 1.2 rad, measured from below: the message names the state and its value."""
    run = hb.simulate(hb.loads(PENDULUM.replace("phi: 2 rad", "phi: 1.2 rad")))
    rows = "\n".join(f"{t:.2f},{180 / np.pi * a + 180:.5f}" for t, a in zip(run.time, run["angle"], strict=True))
    (tmp_path / "p.csv").write_text("time,theta\n" + rows + "\n")
    (tmp_path / "pendulum.yaml").write_text(PENDULUM)
    text = ("experiment: e\nmodel: pendulum.yaml\nrecords:\n  train: {file: p.csv, use: fit}\ntime: {column: time, "
            "unit: s}\noutputs:\n  angle: {is: shaft.phi + 3.14159265, column: theta, unit: deg, noise: 0.1 deg}\n")
    (tmp_path / "e.yaml").write_text(text)
    before = hb.compare(tmp_path / "e.yaml").records["train"]
    advice = re.search(r"`(initial: \{shaft\.phi: 1\.2[^`]*\})`", " ".join(before.notes))
    assert advice is not None, before.notes
    (tmp_path / "e.yaml").write_text(text.replace("use: fit}", f"use: fit, {advice.group(1)}}}"))
    assert hb.compare(tmp_path / "e.yaml").records["train"].chi2 < 0.1  # 1e4 before; the record has no noise


def drive_and_response(tmp_path: Path, change: dict[str, np.ndarray] | None = None, columns: str = "deck load",
                       free: str = "") -> Path:
    """An experiment of a mass on a spring and damper whose foot is moved, with its own run as record."""
    text = MOTION.replace("  t: {is: TrapezoidalMotion, end: 1 m, v: 0.5 m/s, a: 1 m/s**2}\n", "") \
        .replace("u: [t.y, p.u], ", "").replace("until: 4 s", "until: 12 s") \
        .replace("c: 10 kN/m, d: 2 kN*s/m", "c: 4 kN/m, d: 400 N*s/m") \
        .replace("{is: PositionSource}", '{is: PositionSource, u: "=30 mm*sin(5 rad/s*time) + 20 mm*sin(2.3 rad/s*time)"}')
    (tmp_path / "rig.yaml").write_text(text)
    run = hb.simulate(hb.loads(text))
    noise = np.random.default_rng(3).standard_normal((2, len(run.time)))
    values = {"deck": run.display["u"] + 0.01 * noise[0], "load": run.display["x"] + 0.1 * noise[1], **(change or {})}
    first, second = columns.split()
    np.savetxt(tmp_path / "r.csv", np.column_stack([run.time, values["deck"], values["load"]]), delimiter=",",
               header=f"time,{first},{second}", comments="", fmt="%.6f")
    path = tmp_path / "e.yaml"
    path.write_text("experiment: e\nmodel: rig.yaml\nrecords:\n  train: {file: r.csv, use: fit}\ntime: {column: time, "
                    "unit: s}\ninputs:\n  p.u: {column: deck, unit: mm, interpolation: linear}\n"
                    "outputs:\n  m.x: {column: load, unit: mm, noise: 0.1 mm}\n" + free)
    return path


def notes(path: Path) -> str:
    return " ".join(hb.compare(path).records["train"].notes)


def test_a_frozen_sensor_and_swapped_columns_are_noticed_and_sound_records_are_not(tmp_path: Path) -> None:
    sound = notes(drive_and_response(tmp_path))
    assert "exactly" not in sound and "swapped" not in sound
    values = np.loadtxt(tmp_path / "r.csv", delimiter=",", skiprows=1)
    for name, column in (("m.x", "load"), ("p.u", "deck")):
        frozen = values[:, 1 if column == "deck" else 2].copy()
        frozen[300:] = frozen[300]
        said = notes(drive_and_response(tmp_path, {column: frozen}))
        assert f"{name} stays at exactly" in said and "from 3 s to 12 s" in said and "75 % of the record" in said
    assert "are the columns 'deck' and 'load' swapped?" in notes(drive_and_response(tmp_path, columns="load deck"))


def test_a_value_outside_its_range_is_told(tmp_path: Path) -> None:
    path = drive_and_response(tmp_path, free="free:\n  m.m: 150 .. 200 kg\n")
    assert any("m.m is 100 kg in the diagram, outside its range 150 .. 200 kg" in line for line in hb.compare(path).advice)
    path = drive_and_response(tmp_path, free="free:\n  m.m: 50 .. 200 kg\n")
    assert not any("outside its range" in line for line in hb.compare(path).advice)


def test_no_shift_is_advised_before_the_parameters_are_fitted(tmp_path: Path) -> None:
    """A stiffness that is a little off shifts phases by a fraction of a sample."""
    path = drive_and_response(tmp_path, free="free:\n  s.c: 3 .. 5 kN/m\n")
    rig = (tmp_path / "rig.yaml").read_text()
    (tmp_path / "rig.yaml").write_text(rig.replace("c: 4 kN/m", "c: 3.98 kN/m"))
    said = notes(path)
    assert "`shift:" not in said


def test_decimal_commas_between_comma_separators_are_named_in_rows_of_any_length(tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_text("time_s,x_mm\n0,1,5\n0,1,1,6\n0,2,1,7\n")
    with pytest.raises(HeavebondError, match="decimal commas"):
        read_table(tmp_path / "r.csv")


def test_new_takes_inputs_that_only_a_record_drives(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The diagram of a rig whose drive is only known as a record has open inputs: they are proposed first."""
    monkeypatch.chdir(tmp_path)
    drive_and_response(tmp_path)
    rig = (tmp_path / "rig.yaml").read_text()
    (tmp_path / "rig.yaml").write_text(re.sub(r'\{is: PositionSource, u: ".*"\}', "{is: PositionSource}", rig))
    (tmp_path / "r.csv").write_text((tmp_path / "r.csv").read_text().replace("time,deck,load", "time [s],p [mm],m.x [mm]"))
    run = CliRunner().invoke(main, ["new", "first.yaml", "--from", "rig.yaml", "r.csv"])
    assert run.exit_code == 0, run.output
    assert "p.u: {column:" in Path("first.yaml").read_text()
    assert CliRunner().invoke(main, ["compare", "first.yaml"]).exit_code == 0


def test_the_start_of_a_record_with_unix_times_is_named_with_the_end_of_the_run(tmp_path: Path) -> None:
    """The line of the message is put in place of `simulate:`, and the run is that of the record from 0."""
    t = np.arange(101) / 10
    for name, first in (("unix", 1.4e9), ("zero", 0.0)):
        np.savetxt(tmp_path / f"{name}.csv", np.column_stack([t + first, np.sin(t)]), delimiter=",", header="time_s,u_V",
                   comments="", fmt="%.3f")
    text = ("model: m\ncomponents:\n  f: {is: FirstOrderLag, T_1: 0.5 s, u: {file: unix.csv, column: u_V, unit: V, "
            "interpolation: linear, time: {column: time_s, unit: s}}}\nshow: {y: {is: f.y, unit: V}}\n"
            "simulate: {until: 10 s, every: 0.1 s}\n")
    with pytest.raises(HeavebondError) as caught:
        hb.simulate(hb.loads(text, tmp_path))
    advice = re.search(r"`simulate: \{(from: 1400000000 s, until: 1400000010 s)\}`", str(caught.value))
    assert advice is not None, str(caught.value)
    late = hb.simulate(hb.loads(text.replace("until: 10 s", advice.group(1)), tmp_path))
    early = hb.simulate(hb.loads(text.replace("unix.csv", "zero.csv"), tmp_path))
    assert late["y"] == pytest.approx(early["y"], abs=1e-4)  # times of 1.4e9 s have a resolution of 0.2 us
