"""Parts inside blocks that a diagram replaces, rewires and that a diagnosis finds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import heavebond as hb
from heavebond.core.errors import ModelError
from heavebond.diagnosis.candidates.places import candidates
from heavebond.estimation.experiment import load_experiment

STATION = """
component: Station
summary: A pump with a pressure limit and a filter.
parameters:
  p_S: {unit: Pa, doc: pressure}
ports: {out: hydraulic}
components:
  pump:   {is: PressureSource, p_0: =p_S}
  filter: {is: LaminarLeakage, C: 2e-10 m**3/(s*Pa)}
nodes:
  supply: [pump.a, filter.a]
  far:    [filter.b, out]
"""
RIG = """
model: rig
parameters: {p_main: 100 bar}
components:
  station: {is: Station, p_S: =p_main}
  load: {is: LaminarLeakage, C: 2e-10 m**3/(s*Pa)}
  tank: {is: Tank}
nodes:
  line: [station.out, load.a]
  tank: [load.b, tank.a]
show: {line.p: {unit: bar}}
simulate: {until: 1 s, every: 50 ms}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "station.yaml").write_text(STATION)
    (tmp_path / "rig.yaml").write_text(RIG)
    return tmp_path


def pressure(folder: Path, changes: str, **values: str) -> float:
    model = hb.loads(f"model: changed\nextends: rig.yaml\n{changes}", folder).with_parameters(values)
    return float(hb.simulate(model).display["line.p"][-1])


def test_a_part_of_a_block_is_replaced_with_formulas_of_the_diagram(folder: Path) -> None:
    """Resistances of 5e9 each divide the pressure; the pump adds another one."""
    assert pressure(folder, "") == pytest.approx(50)
    droop = "components: {station.pump: {is: DroopingSource, p_0: =p_main, R: 5e9 Pa*s/m**3}}"
    assert pressure(folder, droop) == pytest.approx(100/3)
    assert pressure(folder, droop, p_main="150 bar") == pytest.approx(50)
    assert pressure(folder, droop, **{"station.pump.R": "0 Pa*s/m**3"}) == pytest.approx(50)


def test_a_part_stands_in_series_with_one_of_a_block(folder: Path) -> None:
    series = """
components: {loss: {is: LineResistance, R: 5e9 Pa*s/m**3}}
nodes:
  station.supply: [-station.pump.a, +loss.b]
  before: [station.pump.a, loss.a]
"""
    assert pressure(folder, series) == pytest.approx(100/3)
    (folder / "first.yaml").write_text(f"model: first\nextends: rig.yaml\n{series}")
    again = hb.loads("""
model: second
extends: first.yaml
components: {loss_2: {is: LineResistance, R: 5e9 Pa*s/m**3}}
nodes: {before: [-station.pump.a, +loss_2.b], at_pump: [station.pump.a, loss_2.a]}
""", folder)
    assert hb.simulate(again).display["line.p"][-1] == pytest.approx(25)
    assert "loss" in (again._repr_svg_() or "")


@pytest.mark.parametrize(("changes", "code"), [
    ("components: {station.pmp: {is: Tank}}", "part-unknown"),
    ("nodes: {station.supply: [-station.filter.b]}", "node-end-unknown"),
    ("components: {loss: {is: Cap}}\nnodes: {x: [loss.a, station.pump.b]}", "end-unknown"),
    ("components: {loss: {is: Cap}}\nnodes: {x: [loss.a, station.pump.a]}", "port-on-two-nodes")])
def test_what_is_not_in_the_block_is_said(folder: Path, changes: str, code: str) -> None:
    with pytest.raises(ModelError) as error:
        pressure(folder, changes)
    assert code in {p.code for p in error.value.problems}


def test_effects_inside_a_block_are_found_and_written(folder: Path) -> None:
    """A supply that droops by 6e9 Pa*s/m**3, and a load that changes by a factor of five during the record."""
    time = np.arange(0, 4, 0.02)
    C = 2e-10*(0.6 + 0.4*np.sin(2*np.pi*time/2))
    (folder / "rig.yaml").write_text(RIG.replace("LaminarLeakage, C: 2e-10 m**3/(s*Pa)", "FlowSource")
                                     .replace("  tank: {is: Tank}\n", "").replace("  tank: [load.b, tank.a]\n", ""))
    flow = 1e7*C/(1 + C*(5e9 + 6e9))
    noise = np.random.default_rng(1).normal(0, 0.05, len(time))
    rows = [f"{t:.3f},{-q*6e4:.9g},{(1e7 - 11e9*q)/1e5 + e:.6f}" for t, q, e in zip(time, flow, noise, strict=True)]
    (folder / "monday.csv").write_text("t,q,p\n" + "\n".join(rows) + "\n")
    (folder / "measured.yaml").write_text("""
experiment: measured
model: rig.yaml
records: {monday: {file: monday.csv, use: fit}}
time: {column: t, unit: s}
inputs: {load.u: {column: q, unit: L/min, interpolation: linear}}
outputs: {line.p: {column: p, unit: bar, noise: 0.05 bar}}
""")
    experiment = load_experiment(folder / "measured.yaml")
    labels = {c.label for c in candidates(experiment)}
    assert {"DroopingSource in place of station.pump", "LineResistance between station.supply and station.pump.a"} <= labels
    for component, places in (("DroopingSource", ["station.pump"]),
                              ("LineResistance", ["station.supply", "station.pump.a"])):
        found = hb.attempt(experiment, component, places)
        assert found.earned
        value = {p.name.rpartition(".")[2]: p.value for p in found.finding.parameters}["R"]
        # 200 samples of 0.05 bar over flows of 1e-4 m3/s: 3e7 Pa*s/m3
        assert value == pytest.approx(6e9, abs=1e8)
    from heavebond.diagnosis.answer.files import Targets, write_findings
    written = write_findings(experiment, [found.finding], Targets.beside(experiment, folder))
    again = hb.compare(written[0])
    assert all(r.chi2 < 1.5 for r in again.records.values())
