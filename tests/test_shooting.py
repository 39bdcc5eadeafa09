"""Multiple shooting: records that cover many periods, on a model whose frequency is far off."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import heavebond as hb
from heavebond.numerics.simulator import Simulator, Tolerances

# A loop that the integrator iterates (no volume between two turbulent orifices), beside a state.
LOOP = """
model: loop
components:
  vessel: {is: Volume, V: 5 L, beta: 1e9 Pa}
  first:  {is: Orifice, q_r: 60 L/min, dp_r: 10 bar}
  second: {is: Orifice, q_r: 40 L/min, dp_r: 10 bar}
  tank:   {is: Tank}
nodes:
  high: [vessel.a, first.a]
  mid:  [first.b, second.a]
  low:  [second.b, tank.a]
initial: {high.p: 100 bar}
"""


def test_sensitivities_to_the_states_at_the_beginning() -> None:
    """d/dx_0 of a run from given states, through algebraic unknowns, against fourth-order differences (runs at 1e-11
    over steps of 1e-3: right to about 1e-8)."""
    assembly = hb.assemble(hb.loads(LOOP))
    assert len(assembly.algebraic_names) == 1
    times = np.linspace(0, 0.02, 21)
    tight = Tolerances(1e-11, 1e-13, along=1.0)
    simulator = Simulator(assembly, times=times, tolerances=tight, sensitivities=["first.q_r"], free_start=True)
    x = np.array([80e5])
    run = simulator.run_from(x)
    assert run["high.p"][0] == 80e5
    for signal in ("high.p", "mid.p"):
        for name, moved in (("first.q_r", None), (assembly.state_names[0], x)):
            value = x[0] if moved is not None else assembly.parameter_values[name]
            step = 1e-3 * value
            runs = [simulator.run_from(x + k * step)[signal] if moved is not None else
                    simulator.run_from(x, {name: value + k * step})[signal] for k in (-2, -1, 1, 2)]
            difference = (8 * (runs[2] - runs[1]) - (runs[3] - runs[0])) / (12 * step)
            exact = run.sensitivity(signal, name)
            assert np.abs(exact - difference).max() < 1e-6 * np.abs(exact).max()


@pytest.fixture
def swing(tmp_path: Path) -> Path:
    """Some thirty periods of a swinging mass; the diagram's stiffness is half the true one."""
    (tmp_path / "swing.yaml").write_text("""
model: swing
components:
  wall:   {is: Fixed}
  spring: {is: Spring, c: 0.6 kN/m}
  damper: {is: Damper, d: 0.5 N*s/m}
  cart:   {is: Mass, m: 2.5 kg}
nodes:
  ground: [wall.a, spring.a, damper.a]
  load:   [spring.b, damper.b, cart.a]
initial: {load.x: 50 mm, load.v: 0 m/s}
""", encoding="utf-8")
    t = np.arange(0, 10, 0.02)
    decay = 0.5 / 5
    omega = np.sqrt(1200 / 2.5 - decay**2)
    x = 0.05 * np.exp(-decay * t) * (np.cos(omega * t) + decay / omega * np.sin(omega * t))
    x = x + 5e-4 * np.random.default_rng(0).standard_normal(len(t))
    rows = "\n".join(f"{a:.2f},{b:.8f}" for a, b in zip(t, x, strict=True))
    (tmp_path / "record.csv").write_text("t_s,x_m\n" + rows + "\n", encoding="utf-8")
    (tmp_path / "experiment.yaml").write_text("""
experiment: swing
model: swing.yaml
records: {one: {file: record.csv, use: fit}}
time: {column: t_s, unit: s}
outputs: {load.x: {column: x_m, unit: m, noise: 0.5 mm}}
free: {spring.c: 0.3 .. 3 kN/m, damper.d: 0.1 .. 5 N*s/m}
""", encoding="utf-8")
    return tmp_path / "experiment.yaml"


def test_segments_find_what_one_run_misses(swing: Path) -> None:
    plain = hb.fit(swing)
    assert plain.cost[0] > 100 * plain.samples  # a false minimum: the model has slipped by whole periods
    found = hb.fit(swing, segments=20)
    assert found.values["spring.c"] == pytest.approx(1200, rel=1e-3)
    assert found.values["damper.d"] == pytest.approx(0.5, rel=0.02)
    assert found.chi2 == pytest.approx(1.0, abs=0.3)  # 500 samples: five standard deviations
