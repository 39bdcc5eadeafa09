"""A belt that creeps, by an independent integration: its diagnosis names the slip and its size."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.integrate import solve_ivp

from heavebond.cli import main
from heavebond.language.model import load
from heavebond.numerics.dae import assemble

DIAGRAM = """\
model: sander
components:
  motor: {is: TorqueSource, u: 9 N*m}
  rotor: {is: Inertia, J: 0.021 kg*m**2}
  belt: {is: Belt, r_a: 60 mm, r_b: 150 mm, c: 120 kN/m, T_d: 2 ms}
  drum: {is: Inertia, J: 0.34 kg*m**2}
  drag: {is: RotationalDamper, d: 0.11 N*m*s/rad}
  housing: {is: FixedShaft}
nodes:
  motor: [motor.a, rotor.a, belt.a]
  drum: [belt.b, drum.a, drag.a]
  ground: [housing.a, drag.b]
initial: {motor.w: 100 rad/s, drum.w: 40 rad/s}
simulate: {until: 6 s, every: 10 ms}
"""
EXPERIMENT = """\
experiment: sander
model: sander.yaml
records: {one: {file: one.csv, use: fit}, two: {file: two.csv, use: validate}}
time: {column: t, unit: s}
inputs: {motor.u: {column: torque, unit: N*m, interpolation: spline}}
outputs:
  motor.w: {column: n_1, unit: rpm, noise: 0.8 rpm}
  drum.w: {column: n_2, unit: rpm, noise: 0.4 rpm}
free: {drag.d: 0.11 N*m*s/rad +- 20 %, drum.J: 0.34 kg*m**2 +- 10 %}
"""
CREEP = 2200.0  # N*s/m, belt force per speed of slip: 2200*0.15**2 = 49.5 N*m*s/rad at the drum


def record(path: Path, seed: int) -> None:
    """Elongation, rate of the strand and slip in series: F = c (s + T_d s'), s' = r_1 w_1 - r_2 w_2 - F/CREEP."""
    rng = np.random.default_rng(seed)
    frequency, phase = rng.uniform(0.1, 1.5, 8), rng.uniform(0, 2*np.pi, 8)
    inertia, load = 0.33, 0.115
    c, lag = 1.2e5, 2e-3

    def torque(t: float) -> float:
        return float(9 + 2.5*np.sin(2*np.pi*frequency*t + phase).sum())

    def rate(t: float, y: np.ndarray) -> list[float]:
        force = c*(y[2] + lag*(0.06*y[0] - 0.15*y[1]))/(1 + c*lag/CREEP)
        return [(torque(t) - 0.06*force)/0.021, (0.15*force - load*y[1])/inertia, 0.06*y[0] - 0.15*y[1] - force/CREEP]

    time = np.arange(0, 6, 0.01)
    found = solve_ivp(rate, (0, 6), [100.0, 40.0, 0.0], method="LSODA", t_eval=time, rtol=1e-9, atol=1e-11)
    speeds = found.y[:2]*30/np.pi + np.array([[0.8], [0.4]])*rng.normal(size=(2, len(time)))
    columns = np.column_stack([time, [torque(t) for t in time], *speeds])
    path.write_text("t,torque,n_1,n_2\n" + "".join(",".join(f"{v:.9g}" for v in row) + "\n" for row in columns))


@pytest.mark.long
def test_the_slip_of_a_belt_is_named(tmp_path: Path) -> None:
    (tmp_path / "sander.yaml").write_text(DIAGRAM)
    (tmp_path / "sanded.yaml").write_text(EXPERIMENT)
    record(tmp_path / "one.csv", 1)
    record(tmp_path / "two.csv", 2)
    classes = ["slip", "sensor gain", "sensor offset", "series compliance", "viscous damping"]
    found = CliRunner().invoke(main, ["diagnose", str(tmp_path / "sanded.yaml"), "--processes", "1",
                                      *(word for c in classes for word in ("--only", c))])
    assert found.exit_code == 0, found.output
    assert "Missing: slip between" in found.output
    assert "near the noise level" in found.output
    size = assemble(load(tmp_path / "sander_2.yaml")).parameter_values["shaft_slip.d"]
    # four standard errors of about 0.5 %; slip in series with the motor's pulley is the same with its radius
    assert size in (pytest.approx(CREEP*0.15**2, rel=0.02), pytest.approx(CREEP*0.06**2, rel=0.02))
