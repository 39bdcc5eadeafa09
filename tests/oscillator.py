"""A driven oscillator with records whose states, noise and process noise are known, for tests of state estimation."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy.linalg import expm

M, C, D, STEP = 2.0, 50.0, 3.0, 0.05
MACHINE = """model: oscillator
components:
  motor:  {is: ForceSource, u: 0 N}
  body:   {is: Mass, m: 2 kg}
  spring: {is: Spring, c: 50 N/m}
  damper: {is: Damper, d: 3 N*s/m}
  wall:   {is: Fixed}
nodes: {wall: [wall.a, spring.a, damper.a], body: [body.a, spring.b, damper.b, motor.a]}
initial: {body.x: 0.1 m, body.v: 0 m/s}
simulate: {until: 20 s, every: 50 ms}
"""
EXPERIMENT = """experiment: oscillator
model: oscillator.yaml
records: {first: {file: first.csv, use: fit}}
time: {column: t, unit: s}
inputs:  {motor.u: {column: u, unit: N, interpolation: hold}}
outputs: {body.x: {column: x, unit: mm, noise: 2 mm}, body.v: {column: v, unit: m/s, noise: 0.05 m/s}}
free: {spring.c: 50 N/m +- 20 %, damper.d: 3 N*s/m +- 20 %}
"""
A, B = np.array([[0, 1], [-C / M, -D / M]]), np.array([0, 1 / M])
NOISE = np.array([2e-3, 0.05])


def exact(h: float, stiffness: float = C) -> tuple[np.ndarray, np.ndarray]:
    """exp(A h) and its integral times B, for an input that is held."""
    whole = np.zeros((3, 3))
    whole[:2, :2], whole[:2, 2] = A, B
    whole[1, 0] = -stiffness / M
    whole = expm(whole * h)
    return whole[:2, :2], whole[:2, 2]


def write_record(path: Path, seed: int, *, count: int = 200, intensity: float = 0.0, start: float = 0.0,
                 stiffness: Mapping[int, float] | None = None) -> np.ndarray:
    """A record of the oscillator with white noise; process noise of the speed, another start, another stiffness from some
    sample on. Returns the states (N, 2)."""
    random = np.random.default_rng(seed)
    u = np.repeat(random.normal(0, 3, count // 10 + 1), 10)[:count]
    x = np.array([0.1 + start * random.standard_normal(), start * random.standard_normal()])
    states, value = [], C
    for i in range(count):
        states.append(x)
        value = (stiffness or {}).get(i, value)
        phi, gamma = exact(STEP, value)
        if intensity:
            x = phi @ x + gamma * u[i] + random.multivariate_normal([0, 0], disturbance(intensity), method="cholesky")
        else:
            x = phi @ x + gamma * u[i]
    measured = np.array(states) + NOISE * random.standard_normal((count, 2))
    table = np.column_stack([STEP * np.arange(count), u, 1000 * measured[:, 0], measured[:, 1]])
    np.savetxt(path, table, fmt="%.17g", delimiter=",", header="t,u,x,v", comments="")
    return np.array(states)


def disturbance(intensity: float, h: float = STEP) -> np.ndarray:
    """The covariance of white process noise of the speed over a step, after Van Loan, doi:10.1109/TAC.1978.1101743."""
    n = 2
    whole = np.zeros((2 * n, 2 * n))
    whole[:n, :n], whole[n:, n:], whole[1, 3] = -A, A.T, intensity**2
    whole = expm(whole * h)
    return whole[n:, n:].T @ whole[:n, n:]


def write_experiment(folder: Path) -> Path:
    """The diagram, the experiment and its record in a folder; the path of the experiment."""
    (folder / "oscillator.yaml").write_text(MACHINE)
    (folder / "rig.yaml").write_text(EXPERIMENT)
    write_record(folder / "first.csv", 1)
    return folder / "rig.yaml"
