"""Variables that no equation determines and on which no motion depends: the run goes on, their values are missing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import heavebond as hb
from heavebond.core.errors import RunWarning, StartError

DIAGRAM = """
model: oscillator
components:
  spring: {is: Spring, c: 100 N/m}
  mass: {is: Mass, m: 1 kg}
  wall: {is: Fixed}
  derived: {is: Derived, k: 0}
nodes: {a: [wall.a, spring.a], b: [spring.b, mass.a, derived.a]}
initial: {b.x: 10 mm}
show: {twice: {is: 2*derived.y, unit: mm}, x: {is: b.x, unit: mm}}
simulate: {until: 0.5 s, every: 10 ms}
"""
COMPONENT = """
component: Derived
summary: A variable that only plots show.
ports: {{a: translational}}
parameters: {{k: {{unit: "1", doc: factor}}}}
variables: {{y: {{unit: {unit}, doc: derived}}{more}}}
equations: |
  a.f = 0
  {law}
"""
# laws that leave y open: all along the run, or only at its start, where the body rests
ALWAYS = {"k*y = k*a.x": "m", "0*y = 0": "m", "k*y = 0": "m", "y = k*a.x/(3*k)": "m"}
AT_START = {"a.v*y = a.x*a.v": "m", "y = a.x*a.v/(3*a.v)": "m"}


def machine(folder: Path, law: str, more: str = "", diagram: str = DIAGRAM) -> hb.Model:
    (folder / "components").mkdir(exist_ok=True)
    (folder / "components" / "derived.yaml").write_text(COMPONENT.format(law=law, unit="m", more=more))
    (folder / "oscillator.yaml").write_text(diagram)
    return hb.load(folder / "oscillator.yaml")


@pytest.mark.parametrize("law", ALWAYS)
def test_a_variable_that_is_only_plotted_and_undetermined_does_not_stop_the_run(tmp_path: Path, law: str) -> None:
    with pytest.warns(RunWarning, match="derived.y"):
        run = hb.simulate(machine(tmp_path, law))
    assert np.isnan(run["derived.y"]).all() and np.isnan(run.display["twice"]).all()
    # the closed form, to the error control of 1e-8 over a swing and a half
    assert run["b.x"] == pytest.approx(0.01 * np.cos(10 * run.time), abs=1e-8)
    finding = next(f for f in run.verdict.findings if f.name == "derived.y")
    assert (finding.kind, finding.time, run.verdict.status) == ("undetermined", 0.0, "outside")


@pytest.mark.parametrize("law", AT_START)
def test_a_variable_has_its_values_where_it_is_determined(tmp_path: Path, law: str) -> None:
    with pytest.warns(RunWarning, match=r"derived.y .*undetermined from 0 s"):
        run = hb.simulate(machine(tmp_path, law), sensitivities=["spring.c"])
    factor = 1 / 3 if "/" in law else 1.0
    assert np.isnan(run["derived.y"][0])
    assert run["derived.y"][1:] == pytest.approx(factor * run["b.x"][1:], abs=1e-12)
    assert run.sensitivity("b.x", "spring.c")[-1] == pytest.approx(-0.01 * np.sin(5) * 0.5 / 20, rel=1e-5)
    # the figures are those of the determined values
    assert run.figures(["derived.y"])["derived.y"].least == pytest.approx(-0.01 * factor, rel=1e-6)


def test_values_that_are_undetermined_are_missing_in_files_and_pictures(tmp_path: Path) -> None:
    with pytest.warns(RunWarning):
        run = hb.simulate(machine(tmp_path, "k*y = k*a.x"))
    run.save(tmp_path / "run.csv")
    header, first = (tmp_path / "run.csv").read_text().splitlines()[:2]
    row = dict(zip(header.split(","), first.split(","), strict=True))
    assert row["twice [mm]"] == "" and row["x [mm]"] == "10.0"
    run.plot("x", "twice").savefig(tmp_path / "run.svg")


def test_a_parameter_of_a_call_makes_a_variable_undetermined(tmp_path: Path) -> None:
    """The assembly was built with another value, by which it could divide."""
    assembly = hb.assemble(machine(tmp_path, "k*y = k*a.x", diagram=DIAGRAM.replace("k: 0", "k: 2")))
    assert hb.simulate(assembly)["derived.y"][0] == pytest.approx(0.01)
    with pytest.warns(RunWarning, match="derived.y"):
        assert np.isnan(hb.simulate(assembly, parameters={"derived.k": 0.0})["derived.y"]).all()


@pytest.mark.parametrize(("law", "more"), [
    ("k*y = 1e-3*a.x", ""),  # contradicts itself
    ("k*y = k*a.x\n  der(w) = y", ", w: {unit: m*s, doc: integral}"),  # a motion depends on it
    ("y = sqrt(k - 1)*a.x", ""),  # has no value
])
def test_what_contradicts_or_moves_or_has_no_value_still_stops_the_run(tmp_path: Path, law: str, more: str) -> None:
    with pytest.raises(StartError, match=r"derived\.y|derived\.k"):
        hb.simulate(machine(tmp_path, law, more))
