"""Studies as files: what is read, and what is said of wrong ones, letter by letter."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from test_tuning import ABSORBER

import heavebond as hb
from heavebond.cli import main
from heavebond.studies.study import load_study

STUDY = """study: soft landing
model: absorber.yaml
evaluate: {from: 10 s, to: 20 s}
modes: {cart.m: 12 kg}
tune:
  free: {damper.d: 1 .. 200 N*s/m}
  cost: rms(load.x)/1 mm
  limits: [peak(load.x) < 60 mm, damping(least) > 0.1]
  over:
    light: {cart.m: 8 kg}
    heavy: {cart.m: 14 kg, weight: 3}
  uncertain: {spring.c: 20 %, cart.m: 1 kg}
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "absorber.yaml").write_text(ABSORBER.replace("10 rad/s*time", "10 rad/s * time"), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def _study(folder: Path, text: str) -> Path:
    (folder / "landing.yaml").write_text(text, encoding="utf-8")
    return Path("landing.yaml")


def _told(folder: Path, *arguments: str) -> tuple[int, dict[str, object]]:
    with pytest.raises(SystemExit) as caught:
        main(["tune", *arguments, "--json", "told.json"])
    code = caught.value.code
    assert isinstance(code, int)
    told: dict[str, object] = json.loads((folder / "told.json").read_text(encoding="utf-8"))
    return code, told


def test_all_entries_are_read(folder: Path) -> None:
    task = load_study(_study(folder, STUDY)).tuning
    assert task.limits == ("peak(load.x) < 60 mm", "damping(least) > 0.1")
    assert task.modes == {"cart.m": "12 kg"}
    assert task.uncertain == {"spring.c": "20 %", "cart.m": "1 kg"}
    assert (task.begin, task.end) == (10.0, 20.0)
    assert [(case.name, case.weight) for case in task.cases] == [("light", 1.0), ("heavy", 3.0)]


@pytest.mark.parametrize(("old", "new", "message"), [
    ("from: 10 s", "from: 10 m", """landing.yaml:3: from: '10 m' is in m; s is needed [unit-wrong]
    3 | evaluate: {from: 10 m, to: 20 s}
      |                  ^^^^
  Write it in s or in a multiple of it."""),
    ("20 %", "some", """landing.yaml:12: spring.c: 'some' is not a number with a unit [not-a-quantity]
   12 |   uncertain: {spring.c: some, cart.m: 1 kg}
      |                         ^^^^
  Write `20 %` or `3 kN`."""),
    ("20 %", "0 %", """landing.yaml:12: spring.c: an uncertainty is above 0 [uncertainty-not-positive]
   12 |   uncertain: {spring.c: 0 %, cart.m: 1 kg}
      |                         ^^^
  Write `20 %` or `3 kN`."""),
    ("modes:", "mode:", """landing.yaml:4: a study has no entry 'mode' [key-unknown]
    4 | mode: {cart.m: 12 kg}
      | ^^^^
  Did you mean 'modes' or 'model'?""")])
def test_wrong_studies_are_refused_with_a_place(folder: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(hb.ModelError) as caught:
        load_study(_study(folder, STUDY.replace(old, new)))
    assert str(caught.value) == message


@pytest.mark.parametrize(("arguments", "code"), [
    (("landing.yaml", "--method", "genetic"), "method-unknown"), (("absorber.yaml",), "not-a-study"),
    (("absorber.yaml", "--cost", "rms(load.x)"), "free-empty"),
    (("absorber.yaml", "--cost", "rms(load.x)", "--free", "damper.e"), "parameter-unknown"),
    (("landing.yaml", "--evaluate", "10 .. 20 m"), "unit-wrong"),
    (("landing.yaml", "--limit", "peak(load.x)"), "limit-form"),
    (("landing.yaml", "--reference", "damper.d"), "set-form"),
    (("landing.yaml", "--free", "initial.load.v"), "range-missing")])
def test_wrong_usage_is_told(folder: Path, arguments: tuple[str, ...], code: str) -> None:
    _study(folder, STUDY)
    ended, told = _told(folder, *arguments)
    assert ended in (1, 2)
    problems = told["problems"]
    assert isinstance(problems, list)
    assert problems[0]["code"] == code
    assert problems[0]["hint"]


@pytest.mark.long
def test_a_study_is_tuned_with_its_surroundings(folder: Path) -> None:
    _study(folder, STUDY)
    code, told = _told(folder, "landing.yaml", "--free", "spring.c=0.5 .. 2 kN/m", "--sweep", "3", "--output", "surface.png",
                       "--write", "tuned.yaml")
    assert code == 0
    assert (folder / "surface.png").stat().st_size > 10_000
    assert hb.assemble(hb.load("tuned.yaml")).parameter_values["damper.d"] == pytest.approx(200, rel=1e-3)
    robust, limits = told["robustness"], told["limits"]
    assert isinstance(robust, dict)
    assert isinstance(limits, dict)
    assert {c["parameter"] for c in robust["changes"]} == {"damper.d", "spring.c", "cart.m"}
    assert robust["worst"]["case"] in ("light", "heavy")
    assert max(limits.values()) < 1e-3


def test_what_is_set_while_tuning_stands_in_the_diagram_that_is_written(folder: Path) -> None:
    code, _ = _told(folder, "absorber.yaml", "--free", "damper.d", "--cost", "rms(load.x)/1 mm", "--evaluate", "10 .. 20 s",
                    "--set", "cart.m=11 kg", "--no-robustness", "--write", "tuned.yaml")
    assert code == 0
    assert hb.assemble(hb.load("tuned.yaml")).parameter_values["cart.m"] == 11


def test_a_diagram_is_tuned_by_options(folder: Path) -> None:
    """Without a range a parameter may grow to three times its value: 15 N s/m."""
    code, told = _told(folder, "absorber.yaml", "--free", "damper.d", "--cost", "rms(load.x)/1 mm",
                       "--evaluate", "10 .. 20 s", "--no-robustness")
    values = told["values"]
    assert isinstance(values, dict)
    assert (code, told["robustness"]) == (0, None)
    assert values["damper.d"] == pytest.approx(15, rel=1e-3)
