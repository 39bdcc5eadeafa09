"""Warnings for runs and starts that go where the laws of the diagram mean nothing."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

import heavebond as hb
from heavebond.cli import main
from heavebond.studies.validity import beyond, told

SUCKING = """
model: sucking
components:
  pump: {is: FlowSource, u: -2 L/min}
  oil:  {is: Volume, V: 2 L, beta: 1.5 GPa}
nodes: {oil: [pump.a, oil.a]}
initial: {oil.p: 10 bar}
simulate: {until: 2 s, every: 1 ms}
"""


def test_a_pressure_below_vacuum_is_told_once_with_its_time() -> None:
    """dp/dt = -q beta/V = -250 bar/s: 10 bar last 40 ms, and vacuum is passed 1.013 bar later, after 44.05 ms."""
    found = beyond(hb.simulate(hb.loads(SUCKING)))
    assert [b.name for b in found] == ["oil.p"]
    assert found[0].time == pytest.approx(0.045, abs=1e-9)  # the first point behind it
    assert found[0].worst == pytest.approx(1e6 - 2 * 2.5e7, rel=1e-6)
    line, = told(found)
    assert line.startswith("warning: oil.p goes to -490 bar, beyond -1.0132 bar from 0.045 s on: below vacuum")
    assert "Add a Cavitation there" in line


def test_a_node_that_is_kept_from_it_is_no_matter() -> None:
    kept = SUCKING.replace("nodes: {oil: [pump.a, oil.a]}", "nodes: {oil: [pump.a, oil.a, vapour.a]}").replace(
        "  oil:  {is", "  vapour: {is: Cavitation, C: 1e-7 m**3/(s*Pa)}\n  oil:  {is")
    assert beyond(hb.simulate(hb.loads(kept))) == []


def test_a_gas_that_is_drawn_until_nothing_is_left() -> None:
    text = """
model: drawn
components:
  tank: {is: Receiver, V: 1 L}
  draw: {is: PneumaticFlowSource, u: -1 g/s}
nodes: {tank: [tank.a, draw.a]}
simulate: {until: 2 s, every: 10 ms}
"""
    names = [b.name for b in beyond(hb.simulate(hb.loads(text)))]
    assert names == ["tank.p"]


def test_the_commands_warn_too(tmp_path: Path) -> None:
    file = tmp_path / "sucking.yaml"
    file.write_text(SUCKING.replace("10 bar", "-10 bar"), encoding="utf-8")
    for command in ("run", "check"):
        said = CliRunner().invoke(main, [command, str(file), "--json", str(tmp_path / "told.json")])
        assert said.exit_code == 0
        assert "warning: oil.p goes to" in " ".join(said.output.split())
        told_json = json.loads((tmp_path / "told.json").read_text(encoding="utf-8"))
        assert [w["name"] for w in told_json["warnings"]] == ["oil.p"]


def test_a_variable_beyond_what_its_component_declares(tmp_path: Path) -> None:
    """A ram without end stops, extended at 1 m/s beyond its stroke of 0.45 m."""
    (tmp_path / "ram.yaml").write_text("""
component: Ram
summary: A ram that is extended at a constant speed.
ports: {}
parameters: {v: {unit: m/s, doc: speed}}
variables: {s: {unit: m, min: 0 m, max: 0.45 m, doc: extension}}
equations: |
  der(s) = v   # extension
""", encoding="utf-8")
    file = tmp_path / "extended.yaml"
    file.write_text("model: extended\ncomponents: {ram: {is: Ram, v: 1 m/s}}\nnodes: {}\n"
                    "simulate: {until: 1 s, every: 0.1 s}\n", encoding="utf-8")
    found, = beyond(hb.simulate(hb.load(file)))
    assert (found.name, found.limit) == ("ram.s", 0.45)
    assert (found.worst, found.time) == (pytest.approx(1.0), pytest.approx(0.5))
    assert "beyond what ram allows for its s" in told([found])[0]


def test_a_friction_that_is_stuck_is_told_with_what_to_type(tmp_path: Path) -> None:
    file = tmp_path / "held.yaml"
    file.write_text("""
model: held
components:
  frame:    {is: Fixed}
  spring:   {is: Spring, c: 1 kN/m}
  friction: {is: CoulombFriction, F_c: 10 N, v_t: 20 mm/s}
  mass:     {is: Mass, m: 1 kg}
nodes: {frame: [frame.a, friction.a, spring.a], load: [friction.b, spring.b, mass.a]}
initial: {load.x: 0 m, load.v: 0 m/s}
""", encoding="utf-8")
    said = " ".join(CliRunner().invoke(main, ["modes", str(file)]).output.split())
    assert "friction is stuck there (slower than its v_t)" in said
    assert "--set friction.F_c='0 N'" in said
    free = CliRunner().invoke(main, ["modes", str(file), "--set", "friction.F_c=0 N"]).output
    assert "stuck" not in free
    assert "5.033 Hz" in free
    event = file.read_text().replace("CoulombFriction, F_c: 10 N, v_t: 20 mm/s", "DryFriction, F_c: 10 N, F_s: 12 N")
    file.write_text(event)
    for words in (["modes", str(file)], ["linear", str(file), "--from", "load.f", "--to", "load.x"]):
        switched = " ".join(CliRunner().invoke(main, words).output.split())
        assert "friction.mode is 0 there (1 sliding forwards, -1 backwards, 0 stuck) and stays so" in switched, words
        assert "friction.told" not in switched
