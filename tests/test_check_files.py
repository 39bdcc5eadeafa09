"""`heavebond check` of experiments, studies and components; keys and options that do not exist are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from heavebond.cli import main

COMPONENT = """component: SealFriction
summary: Dry friction of a seal.
ports: {a: translational, b: translational}
parameters:
  F_c: {unit: N, min: 0, default: 10 N, neutral: 0 N, class: dry friction, search_range: 0 .. 50 N}
  v_s: {unit: m/s, min: 0, default: 1 mm/s}
variables: {v: {unit: m/s}}
equations: |
  v = a.v - b.v
  a.f = F_c*tanh(v/v_s)
  a.f + b.f = 0
dissipates: a.f*v
effect:
  class: dry friction
  description: friction of the seal
  attaches: across
  amplitude: F_c
  search_range: {v_s: 1 .. 20 mm/s}
"""
MODEL = """model: rig
components:
  foot:   {is: PositionSource, u: 0 m}
  seal:   {is: SealFriction}
  spring: {is: Spring, c: 2 kN/m}
  load:   {is: Mass, m: 20 kg}
nodes:
  foot: [foot.a, spring.a, seal.a]
  top:  [spring.b, seal.b, load.a]
show: {height: {is: load.a.x, unit: mm}}
simulate: {until: 2 s, every: 10 ms}
"""
EXPERIMENT = """experiment: test of the rig
model: rig.yaml
time: {column: t, unit: s}
inputs:
  foot.u: {column: u, unit: m, interpolation: spline}
outputs:
  height: {is: load.a.x, column: y, unit: mm, noise: 1 mm}
free: {spring.c: 1 .. 4 kN/m}
records:
  one: {file: one.csv, to: 1 s, use: fit}
  two: {file: one.csv, from: 1 s, use: validate}
"""
STUDY = """study: springs
model: rig.yaml
cases: {spring.c: [1 kN/m, 2 kN/m]}
measure: {motion: {is: peak(load.a.x - foot.u), unit: mm}}
compare_with: {others: {motion: [1 mm, 2 mm]}}
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "components").mkdir()
    (tmp_path / "components" / "seal_friction.yaml").write_text(COMPONENT)
    (tmp_path / "rig.yaml").write_text(MODEL)
    (tmp_path / "test.yaml").write_text(EXPERIMENT)
    (tmp_path / "springs.yaml").write_text(STUDY.replace("foot.u", "foot.a.x"))
    t = np.linspace(0.0, 2.0, 101)
    rows = [f"{a:.4f},{0.01 * np.sin(5 * a):.6f},{12 * np.sin(5 * a - 0.1):.4f}" for a in t]
    (tmp_path / "one.csv").write_text("t,u,y\n" + "\n".join(rows) + "\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def told(*words: str, code: int = 0) -> str:
    result = CliRunner().invoke(main, list(words))
    assert result.exit_code == code, result.output
    return " ".join(result.output.split())


def test_check_of_an_experiment_and_a_study_says_what_they_contain(folder: Path) -> None:
    said = told("check", "test.yaml")
    assert "one fit 0 .. 1 s height" in said and "free: spring.c" in said
    said = told("check", "springs.yaml")
    assert "2: spring.c (2)" in said and "motion [mm]" in said


def test_check_of_an_experiment_finds_free_values_outside_their_range(folder: Path) -> None:
    (folder / "test.yaml").write_text(EXPERIMENT.replace("1 .. 4 kN/m", "3 .. 4 kN/m"))
    said = told("check", "test.yaml", code=1)
    assert said.count("[free-start-outside]") == 1 and "outside its range 3 .. 4 kN/m" in said


def test_check_of_an_experiment_finds_what_its_records_lack(folder: Path) -> None:
    (folder / "test.yaml").write_text(EXPERIMENT.replace("column: y", "column: z"))
    assert "one.csv" in told("check", "test.yaml", code=1)


@pytest.mark.parametrize("option", [("--names",), ("--set", "v_s=1 mm/s")])
def test_an_option_for_diagrams_is_refused_for_other_files(folder: Path, option: tuple[str, ...]) -> None:
    assert "option-unsuited" in told("check", "components/seal_friction.yaml", *option, code=2)


def test_a_key_that_does_not_exist_is_refused_with_its_place(folder: Path) -> None:
    (folder / "test.yaml").write_text(EXPERIMENT.replace("interpolation: spline", "between: spline"))
    said = told("check", "test.yaml", code=1)
    assert "test.yaml:5" in said and "between" in said and "interpolation" in said


@pytest.mark.parametrize("words", [("where", "test.yaml"), ("check", "test.yaml", "--fix")])
def test_a_command_or_an_option_that_does_not_exist_is_refused(folder: Path, words: tuple[str, ...]) -> None:
    told(*words, code=2)
