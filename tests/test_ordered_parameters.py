"""Parameters of which one must stay above another, sought in the same range."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np

import heavebond as hb
from heavebond.estimation.residuals import Residuals

DIAGRAM = """\
model: stops
components:
  wall: {is: Fixed}
  push: {is: ForceSource, u: 0 N}
  load: {is: Mass, m: 5 kg}
  hold: {is: SpringDamper, c: 200 N/m, d: 20 N*s/m}
  stop: {is: EndStop, c: 50 kN/m, d: 100 N*s/m, x_min: -20 mm, x_max: 30 mm}
nodes:
  wall: [wall.a, hold.a, stop.a]
  load: [push.a, load.a, hold.b, stop.b]
initial: {load.x: 0 m, load.v: 0 m/s}
simulate: {until: 4 s}
"""
EXPERIMENT = """\
experiment: stops
model: stops.yaml
records: {one: {file: one.csv, use: fit}}
time: {column: t, unit: s}
inputs: {push.u: {column: u, unit: N, interpolation: linear}}
outputs: {load.x: {column: x, unit: mm, noise: 0.1 mm}}
free: {stop.x_min: -60 .. 60 mm, stop.x_max: -60 .. 60 mm}
"""


def stops(folder: Path) -> Path:
    (folder / "stops.yaml").write_text(DIAGRAM)
    (folder / "stops_record.yaml").write_text(EXPERIMENT)
    pushed = hb.load(folder / "stops.yaml").with_parameters({"push.u": "=20 N*sin(2*pi*time/(1.7 s))"})
    run = hb.simulate(pushed, 8, every=0.02)
    u, x = 20 * np.sin(2 * np.pi * run.time / 1.7), 1e3 * run["load.x"] + 0.1 * np.random.default_rng(1).standard_normal(401)
    np.savetxt(folder / "one.csv", np.column_stack([run.time, u, x]), delimiter=",", header="t,u,x", comments="")
    return folder / "stops_record.yaml"


def test_every_point_between_the_bounds_stands_for_values_in_order_and_within_the_ranges(tmp_path: Path) -> None:
    problem = Residuals(hb.load_experiment(stops(tmp_path)))
    assert problem.orders == [(1, 0)]
    for share in product(np.linspace(0, 1, 5), repeat=2):
        values = problem.values_of(problem.low + np.array(share) * (problem.high - problem.low), "one")
        assert -0.06 <= values["stop.x_min"] < values["stop.x_max"] <= 0.06
        hb.assemble(hb.load(tmp_path / "stops.yaml").with_parameters(values))
