# A run that stops in a diagram with parts that were not translated names these parts.
from __future__ import annotations

from pathlib import Path

import pytest

import heavebond as hb

LAWLESS = """component: Lawless
summary: A part that was not translated.
placeholder: "line 3: its law stands in another file"
ports: {y: {signal: out, unit: N}}
parameters: {y_0: {unit: N, default: 10 N}}
equations: |
  y = y_0
"""
STOPS = """model: stops
components:
  law:   {is: Lawless}
  push:  {is: ForceSource}
  grip:  {is: ForceSource, u: "=-20 N*sign(load.v)"}
  load:  {is: Mass, m: 1 kg}
nodes:
  pushed: [law.y, push.u]
  load: [push.a, grip.a, load.a]
initial: {load.x: 0 m, load.v: 1 m/s}
simulate: {until: 2 s, solver: idas}
"""


def test_a_run_that_stops_names_the_parts_without_a_law(tmp_path: Path) -> None:
    (tmp_path / "lawless.yaml").write_text(LAWLESS)
    (tmp_path / "stops.yaml").write_text(STOPS)
    with pytest.raises(hb.SimulationError, match="law has no law, and what placeholders give is constant"):
        hb.simulate(hb.load(tmp_path / "stops.yaml"))
