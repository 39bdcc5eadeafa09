# A run that stops in a diagram with parts that were not translated names these parts.
from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from click.testing import CliRunner

import heavebond as hb
from heavebond.cli import main
from heavebond.pictures.plot import plot_signals

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


MARKED = """model: marked
components:
  law:    {is: Lawless}
  push:   {is: ForceSource}
  load:   {is: Mass, m: 1 kg}
  wall:   {is: Fixed}
  spring: {is: Spring, c: 100 N/m}
  apart:  {is: Mass, m: 2 kg}
  pull:   {is: ForceSource, u: 3 N}
  level:  {is: Comparator, u: "=load.x/(1 m)", level: 1}
nodes:
  pushed: [law.y, push.u]
  load: [push.a, load.a]
  wall: [wall.a, spring.a]
  apart: [spring.b, apart.a, pull.a]
initial: {load.x: 0 m, load.v: 0 m/s, apart.x: 0 m, apart.v: 0 m/s}
show:
  place:  {is: load.x, unit: m}
  above:  {is: level.y, unit: 1}
  apart:  {is: apart.x, unit: mm}
  spring: {is: spring.F, unit: N}
simulate: {until: 1 s, every: 0.1 s}
"""


def test_outputs_that_depend_on_a_part_without_a_law_are_marked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the table, in JSON, in files of every format and in plots; through states and held variables of events."""
    monkeypatch.chdir(tmp_path)
    Path("lawless.yaml").write_text(LAWLESS)
    Path("marked.yaml").write_text(MARKED)
    run = hb.simulate(hb.load("marked.yaml"))
    assert run.without_law(["place", "above", "apart", "spring", "load.v", "law.y"]) == ("place", "above", "load.v", "law.y")
    for suffix in (".csv", ".parquet", ".mat", ".nc"):
        run.save(f"run{suffix}", ["place", "apart"])
        read = hb.read_run(f"run{suffix}")
        assert (read.names(), read.without_law, read.unit("place")) == (["place", "apart"], ("place",), "m")
    assert Path("run.csv").read_text().startswith("time [s],place [m] (placeholder),apart [mm],")
    labels = [text.get_text() for text in plot_signals(run, ["place", "apart"]).axes[0].get_legend().get_texts()]
    assert labels == ["place (placeholder)"]
    answer = CliRunner().invoke(main, ["run", "marked.yaml", "--json", "out.json"])
    assert answer.exit_code == 3
    assert re.search(r"^place \* .*\n^above \* .*\n^apart  ", answer.stdout, re.MULTILINE), answer.stdout
    assert "* depends on law, which has no law" in answer.stdout
    assert json.loads(Path("out.json").read_text())["without_law"] == ["place", "above"]
