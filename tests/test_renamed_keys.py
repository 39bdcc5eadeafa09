"""Former names of keys: read with a warning, told once by the command line, and rewritten by `heavebond check --fix`."""

from __future__ import annotations

import json
import warnings
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import heavebond as hb
from heavebond.cli import main, present_options
from heavebond.core.errors import ModelError, UsageError
from heavebond.core.renamed import RenamedKeyWarning, collecting
from heavebond.language import component_file, effects, reading
from heavebond.language.renamed_keys import RENAMED
from heavebond.studies import study

COMPONENT = """component: SealFriction   # former keys: `says: this comment stays`
summary: Dry friction of a seal.
ports: {a: translational, b: translational}
parameters:
  F_c: {unit: N, min: 0, default: 10 N, neutral: 0 N, class: dry friction, "try": 0 .. 50 N}
  v_s: {unit: m/s, min: 0, default: 1 mm/s}
variables: {v: {unit: m/s}}
equations: |
  v = a.v - b.v
  a.f = F_c*tanh(v/v_s)
  a.f + b.f = 0
dissipates: a.f*v
effect:
  class: dry friction
  says: friction of the seal   # its unit: `try: this too`
  attaches: across
  amplitude: F_c
  try: {v_s: 1 .. 20 mm/s}
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
  foot.u: {column: u, unit: m, between: spline}
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
beside: {others: {motion: [1 mm, 2 mm]}}
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


def test_every_former_key_has_a_present_one() -> None:
    reader = {"input": reading.EXAMPLES, "effect": effects.KEYS, "study": study.STUDY_KEYS}
    for kind, names in RENAMED.items():
        for old, new in names.items():
            assert old not in reader.get(kind, ()) and new in reader.get(kind, [new])


def test_a_former_key_means_what_the_present_one_means_and_warns(folder: Path) -> None:
    with pytest.warns(RenamedKeyWarning, match="`between:` is now `interpolation:`"):
        old = hb.load_experiment("test.yaml")
    Path("new.yaml").write_text(EXPERIMENT.replace("between:", "interpolation:"))
    new = hb.load_experiment("new.yaml")
    assert old.inputs["foot.u"].interpolation == new.inputs["foot.u"].interpolation == "spline"


def test_a_command_tells_all_renamed_keys_in_one_line(folder: Path) -> None:
    said = told("compare", "test.yaml")
    assert said.count("warning:") == 1 and "`between:` is now `interpolation:`" in said
    assert "(4 places in 2 files)" in said and "`heavebond check FILE --fix`" in said


def test_check_fix_rewrites_the_files_that_are_read_and_nothing_else_in_them(folder: Path) -> None:
    part = folder / "components" / "seal_friction.yaml"
    part.write_bytes(b"\xef\xbb\xbf" + COMPONENT.replace("\n", "\r\n").encode())
    said = told("check", "test.yaml", "--fix", "--json", "out.json")
    assert "test.yaml: 1 key renamed" in said and "seal_friction.yaml: 3 keys renamed" in said
    expected = COMPONENT.replace('"try": 0', '"search_range": 0').replace("  says: fr", "  description: fr") \
        .replace("  try: {", "  search_range: {")
    assert part.read_bytes() == b"\xef\xbb\xbf" + expected.replace("\n", "\r\n").encode()
    assert (folder / "test.yaml").read_text() == EXPERIMENT.replace("between:", "interpolation:")
    assert (folder / "rig.yaml").read_text() == MODEL and (folder / "springs.yaml").read_text().startswith("study: springs")
    assert sum(json.loads(Path("out.json").read_text())["rewritten"].values()) == 4
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        hb.load_experiment("test.yaml")
    assert "no renamed keys" in told("check", "test.yaml", "--fix")


def test_check_fix_of_a_study_and_of_a_component(folder: Path) -> None:
    assert "springs.yaml: 1 key renamed" in told("check", "springs.yaml", "--fix")
    assert "compare_with: {others" in (folder / "springs.yaml").read_text()
    assert "no renamed keys" in told("check", "components/seal_friction.yaml", "--fix")  # done with the study


def test_a_file_with_other_mistakes_is_rewritten_and_the_mistakes_are_told(folder: Path) -> None:
    wrong = EXPERIMENT.replace("noise: 1 mm", "noise: 1 mn")
    (folder / "test.yaml").write_text(wrong)
    assert "'mn' is not a known unit" in told("check", "test.yaml", "--fix", code=1)
    assert (folder / "test.yaml").read_text() == wrong.replace("between:", "interpolation:")


def test_a_key_under_both_names_is_refused(folder: Path) -> None:
    (folder / "test.yaml").write_text(EXPERIMENT.replace("between: spline", "between: spline, interpolation: hold"))
    with collecting(), pytest.raises(ModelError, match="'between' is the former name of 'interpolation'") as raised:
        hb.load_experiment("test.yaml")
    assert "Remove `between:`." in str(raised.value)


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


def test_a_former_option_means_what_the_present_one_means_and_warns(folder: Path) -> None:
    run = ["signal", "one.csv", "--signal", "y", "--json"]
    said = told(*run, "old.json", "--to", "1.5 s")
    assert "warning: --to is now --until." in said
    assert "warning" not in told(*run, "new.json", "--until", "1.5 s")
    old, new = (json.loads(Path(name).read_text())["signals"] for name in ("old.json", "new.json"))
    assert old == new and old["y"]["to"] == pytest.approx(1.5)


def test_an_option_under_both_names_is_refused(folder: Path) -> None:
    said = told("signal", "one.csv", "--signal", "y", "--to=1 s", "--until", "2 s", code=2)
    assert "--to is the former name of --until" in said and "Leave --to out." in said


def test_a_former_flag_may_mean_an_option_with_a_value(capsys: pytest.CaptureFixture[str]) -> None:
    assert present_options("diagnose", ["a.yaml", "--auto"]) == ["a.yaml", "--steps=5"]
    assert "--auto is now --steps=5" in capsys.readouterr().err
    with pytest.raises(UsageError, match="--steps is given too"):
        present_options("diagnose", ["--auto", "--steps", "2"])


@pytest.mark.parametrize(("alias", "name"), [("where", "localize"), ("ladder", "errors")])
def test_an_alias_of_a_command_is_that_command(alias: str, name: str) -> None:
    assert told(alias, "--help").replace(alias, name, 1) == told(name, "--help")


def test_key_lists_of_the_reader_have_no_former_key() -> None:
    assert not {old for names in RENAMED.values() for old in names} & {
        *component_file.COMPONENT_KEYS, *effects.KEYS, *study.STUDY_KEYS}
