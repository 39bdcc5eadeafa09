# A digressive, asymmetric damper of a quarter car, by an independent integration: the diagnosis names it and its numbers,
# though its records are a thousand times above their noise.
from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import heavebond as hb

DIAGRAM = """\
model: car
components:
  road: {is: PositionSource, u: 0 mm}
  tyre: {is: Spring, c: 180 kN/m}
  wheel: {is: Mass, m: 38 kg}
  spring: {is: Spring, c: 21 kN/m}
  damper: {is: Damper, d: 1400 N*s/m}
  body: {is: Mass, m: 310 kg}
nodes:
  road: [road.a, tyre.a]
  wheel: [tyre.b, wheel.a, spring.a, damper.a]
  body: [spring.b, damper.b, body.a]
initial: {wheel.x: 0 mm, wheel.v: 0 m/s, body.x: 0 mm, body.v: 0 m/s}
"""
EXPERIMENT = """\
experiment: quarter car on a rig
model: car.yaml
records: {one: {file: one.csv, use: fit}, two: {file: two.csv, use: validate}}
time: {column: t, unit: s}
inputs: {road.u: {column: road, unit: mm, interpolation: spline}}
outputs:
  travel: {is: body.x - wheel.x, column: travel, unit: mm, noise: 0.2 mm}
  body.v: {column: speed, unit: mm/s, noise: 3 mm/s}
free: {damper.d: 200 .. 6000 N*s/m, spring.c: 21 kN/m +- 10 %}
"""
EXTENDING, COMPRESSING, KNEE = 1700.0, 1100.0, 0.25  # N*s/m at low speed, m/s


def record(path: Path, seed: int, size: float) -> None:
    rng = np.random.default_rng(seed)
    time = np.arange(0, 8, 0.005)
    frequency, phase = rng.uniform(0.3, 12, 20), rng.uniform(0, 2*np.pi, 20)
    samples = size*np.minimum(time/0.5, 1)*np.sin(2*np.pi*np.outer(time, frequency) + phase).sum(1)/np.sqrt(20)
    road = CubicSpline(time, samples)  # the input between its samples is the spline that the experiment names

    def rate(t: float, y: np.ndarray) -> list[float]:
        v = y[1] - y[3]
        force = 21e3*(y[0] - y[2]) + (EXTENDING if v > 0 else COMPRESSING)*v/np.hypot(1, v/KNEE)
        return [y[1], -force/310, y[3], (force + 180e3*(float(road(t)) - y[2]))/38]

    found = solve_ivp(rate, (0, 8), np.zeros(4), t_eval=time, rtol=1e-8, atol=1e-10, max_step=0.005).y
    travel = 1e3*(found[0] - found[2]) + 0.2*rng.normal(size=len(time))
    speed = 1e3*found[1] + 3*rng.normal(size=len(time))
    rows = np.column_stack([time, 1e3*samples, travel, speed])
    path.write_text("t,road,travel,speed\n" + "".join(",".join(f"{v:.9g}" for v in row) + "\n" for row in rows))


@pytest.mark.long
def test_a_digressive_damper_is_named(tmp_path: Path) -> None:
    (tmp_path / "car.yaml").write_text(DIAGRAM)
    (tmp_path / "driven.yaml").write_text(EXPERIMENT)
    record(tmp_path / "one.csv", 1, 0.015)
    record(tmp_path / "two.csv", 2, 0.012)
    classes = ["damping law", "dry friction", "backlash", "quadratic damping", "series compliance", "sensor gain"]
    found = hb.diagnose(tmp_path / "driven.yaml", steps=1, number=1, classes=classes)
    assert found.verdict == "effect" and found.findings[0].candidate.label == "NonlinearDamper in place of damper"
    # the runs of the refit were made finer as it came near the noise, which they had erred by far above it
    chosen = found.steps[0].chosen
    assert chosen is not None and chosen.finer > 0
    assert chosen.chi2_fit < 1.1 and chosen.chi2_held_out < 1.1
    values = found.findings[0].fit.values
    # intervals of 95 % are 0.5 %, 1 % and 0.001 wide
    assert values["damper.d"] == pytest.approx(EXTENDING, rel=0.02)
    assert values["damper.v_k"] == pytest.approx(KNEE, rel=0.03)
    assert values["damper.k"] == pytest.approx(1, abs=0.01)
    assert values["damper.r"] == pytest.approx(1 - COMPRESSING/EXTENDING, abs=0.005)
