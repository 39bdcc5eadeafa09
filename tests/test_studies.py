"""Studies worked out: cases, procedures, measured numbers, published ones, calibration, what is kept, and wrong files."""

from __future__ import annotations

import csv
import json
import math
import os
import signal
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from diagrams import ISOLATOR
from scipy.optimize import minimize_scalar

import heavebond as hb
from heavebond.cli import main
from heavebond.optimise.objective import Objective
from heavebond.optimise.sampled_values import sampled_value
from heavebond.studies import calibration, campaign
from heavebond.studies.calibration import Point, at_point
from heavebond.studies.run_case import Outcome, assembled

SOFT = "model: soft\nextends: isolator.yaml\nset: {spring.c: 20 kN/m}\n"
STUDY = """study: transmission
model: isolator.yaml
cases:
  spring: {hard: {}, soft: {model: soft.yaml}}
  f: [1 Hz, 2 Hz, 4 Hz]
evaluate: {from: 4 s, to: 5 s}
measure:
  transmission: largest(motion)/largest(floor.x)
  travel: {is: rms(machine.x - floor.x), unit: mm}
compare_with:
  textbook:
    transmission: {soft: [1.2, -, 0.6], 2 Hz: 1.5}
pictures:
  curves: {curves: [transmission, travel]}
  motion: {signals: [motion, spring.F], from: 4 s}
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "isolator.yaml").write_text(ISOLATOR, encoding="utf-8")
    (tmp_path / "soft.yaml").write_text(SOFT, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def _study(text: str) -> hb.Study:
    Path("study.yaml").write_text(text, encoding="utf-8")
    return hb.load_study("study.yaml")


def _called(*arguments: str) -> tuple[int, dict[str, object]]:
    with pytest.raises(SystemExit) as caught:
        main([*arguments, "--json", "told.json"])
    assert isinstance(caught.value.code, int)
    told: dict[str, object] = json.loads(Path("told.json").read_text(encoding="utf-8"))
    return caught.value.code, told


def _transmission(f: float, c: float, d: float = 1e3, m: float = 100.0) -> float:
    w = 2 * math.pi * f
    return abs(complex(c, d * w) / complex(c - m * w**2, d * w))


def test_cases_are_all_combinations_and_each_is_its_own_diagram(folder: Path) -> None:
    study = _study(STUDY.replace("{soft: [1.2, -, 0.6], 2 Hz: 1.5}", "{soft: [1.2, -, 0.6]}"))
    assert [case.name for case in study.cases] == [f"{s}, {f}" for s in ("hard", "soft") for f in ("1 Hz", "2 Hz", "4 Hz")]
    result = hb.study(study, processes=1)
    for outcome in result.outcomes:
        spring, level = result.case_of(outcome).levels
        # the start has died out to exp(-5*4) and the samples miss a peak by up to (w dt/2)**2/2
        assert result.value(outcome, "transmission") == pytest.approx(
            _transmission(level.value, {"hard": 40e3, "soft": 20e3}[spring.name]), rel=1e-2)
    soft = result.of("soft", "4 Hz")
    assert result.published(soft, "transmission") == 0.6
    assert result.difference(soft, "transmission") == pytest.approx(result.value(soft, "transmission") / 0.6 - 1)
    assert math.isnan(result.published(result.of("hard", "4 Hz"), "transmission"))
    assert math.isnan(result.published(result.of("soft", "2 Hz"), "transmission"))
    assert len(soft.signals["motion"]) == len(soft.time) == 501


@pytest.mark.long
def test_files_tables_and_pictures(folder: Path) -> None:
    _study(STUDY.replace("{soft: [1.2, -, 0.6], 2 Hz: 1.5}", "{2 Hz: 1.5}"))
    code, told = _called("study", "study.yaml", "--processes", "2", "--output", "out")
    assert code == 0
    rows = list(csv.DictReader((folder / "out" / "table.csv").open()))
    assert [(row["spring"], row["f [Hz]"]) for row in rows[:2]] == [("hard", "1.0"), ("hard", "2.0")]
    assert (rows[1]["textbook transmission"], rows[0]["textbook transmission"]) == ("1.5", "")
    assert json.loads((folder / "out" / "study.json").read_text())["rows"] == told["rows"]
    assert len(list(csv.reader((folder / "out" / "signals.csv").open()))) == 1 + 6 * 501
    for name in ("curves", "motion"):
        for suffix in (".svg", ".png"):
            assert (folder / "out" / f"{name}{suffix}").stat().st_size > 10_000


@pytest.mark.long
def test_what_is_done_is_kept_until_a_file_changes(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stopped after two cases, the next call works the others out; a changed diagram begins anew."""
    worked: list[int] = []
    real = campaign.worked

    def counted(study: hb.Study, number: int, *more: object) -> Outcome:
        if len(worked) == 2 and not (folder / "go_on").exists():
            raise KeyboardInterrupt
        worked.append(number)
        return real(study, number, None)

    monkeypatch.setattr(campaign, "worked", counted)
    study = _study(STUDY.replace("{soft: [1.2, -, 0.6], 2 Hz: 1.5}", "1.5"))
    stopped = hb.study(study, folder=folder / "out", processes=1)
    assert (len(stopped.outcomes), stopped.complete) == (2, False)
    (folder / "go_on").touch()
    whole = hb.study(study, folder=folder / "out", processes=1)
    assert whole.complete
    assert worked == list(range(6))
    hb.study(study, folder=folder / "out", processes=1)
    assert len(worked) == 6
    assert [o.values for o in whole.outcomes] == [o.values for o in hb.study(study, processes=1).outcomes]
    worked.clear()
    (folder / "soft.yaml").write_text(SOFT.replace("20 kN/m", "21 kN/m"), encoding="utf-8")
    hb.study("study.yaml", folder=folder / "out", processes=1)
    assert worked == list(range(6))


def test_an_interrupted_command_leaves_a_partial_table(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stopped(study: hb.Study, number: int, *more: object) -> Outcome:
        if number == 1:
            raise KeyboardInterrupt
        return Outcome(number, values={"transmission": 1.0, "travel": 0.0})

    monkeypatch.setattr(campaign, "worked", stopped)
    _study(STUDY.replace("{soft: [1.2, -, 0.6], 2 Hz: 1.5}", "1.5"))
    code, _ = _called("study", "study.yaml", "--processes", "1")
    assert code == 130
    assert len(list(csv.DictReader((folder / "study" / "table.csv").open()))) == 1


def test_any_executor_gives_the_same(folder: Path) -> None:
    study = _study(STUDY.replace("{soft: [1.2, -, 0.6], 2 Hz: 1.5}", "1.5"))
    with ThreadPoolExecutor(1) as executor:
        there = hb.study(study, executor=executor)
    here = hb.study(study, processes=1)
    assert [o.values for o in there.outcomes] == [o.values for o in here.outcomes]
    assert [o.signals for o in there.outcomes] == [o.signals for o in here.outcomes]


def test_a_case_that_cannot_be_run_is_a_row_that_says_why(folder: Path) -> None:
    result = hb.study(_study("""study: masses
model: isolator.yaml
cases: {machine.m: [100 kg, -1 kg]}
measure: {motion: {is: largest(motion), unit: mm}}
"""), processes=1)
    fine, broken = result.outcomes
    assert not fine.problem
    assert "machine.m" in broken.problem
    assert math.isnan(result.value(broken, "motion"))


TUNING = """study: quiet
model: isolator.yaml
cases: {f: [4 Hz, 6 Hz]}
evaluate: {from: 3 s, to: 5 s}
reference: {damper.d: 100 N*s/m}
tune:
  free: {damper.d: 0.1 .. 4 kN*s/m, spring.c: 20 .. 60 kN/m}
  cost: rms(motion)/ref(rms(motion)) + damper.d/20 kN*s/m
  by:
    hand:
      begin: {spring.c: 40 kN/m}
      sweep:
        damper.d: {from: 0.1 kN*s/m, to: 4 kN*s/m, number: 21}
        spring.c: [20 kN/m, 40 kN/m, 60 kN/m]
    gradients: {explore: 3}
measure: {motion: {is: largest(motion), unit: mm}}
compare_with: {us: {damper.d: {4 Hz: 2 kN*s/m}}}
"""


@pytest.mark.long
def test_gains_are_swept_one_after_the_other_and_by_gradients(folder: Path) -> None:
    """At 4 Hz the damper chosen for a hard spring is too strong for the soft one: one after the other misses the best."""
    result = hb.study(_study(TUNING), processes=1)
    hand, gradients = (result.of("4 Hz", procedure=name) for name in ("hand", "gradients"))
    assert [result.value(outcome, "spring.c") for outcome in (hand, gradients)] == pytest.approx([20, 20])
    assert result.value(gradients, "cost") < 0.5 * result.value(hand, "cost")
    # 24 points and the runs for sizes and reference
    assert result.value(hand, "simulations") == 26
    assert result.published(hand, "damper.d") == 2
    best = hb.load_study("study.yaml").tuning
    assert set(best.free) == {"damper.d", "spring.c"}


def test_modes_are_told_with_components_and_without_a_run(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _study("""study: modes
model: isolator.yaml
cases: {machine.m: [100 kg, 400 kg]}
modes: {damper.d: 0 N*s/m}
measure: {own: {is: frequency(machine), unit: Hz}, damping: damping(slowest)}
compare_with: {formula: {own: [3.183 Hz, 1.592 Hz]}}
""")
    code, told = _called("study", "study.yaml", "--processes", "1")
    assert code == 0
    rows, cases = told["rows"], told["cases"]
    assert isinstance(rows, list)
    assert isinstance(cases, list)
    for row, mass in zip(rows, (100, 400), strict=True):
        assert row["own [Hz]"] == pytest.approx(math.sqrt(40e3 / mass) / 2 / math.pi)
        assert row["damping"] == pytest.approx(0, abs=1e-9)
    swinging = [m for m in cases[0]["modes"] if m["swings"]]
    assert swinging[0]["components"] == {"machine": pytest.approx(1)}
    assert "machine 100 %" in capsys.readouterr().out


CALIBRATION = """study: weighed
model: isolator.yaml
cases: {f: [2 Hz, 3 Hz, 4 Hz], mount: {own: {}, stiff: {spring.c: 60 kN/m}}}
evaluate: {from: 4 s, to: 5 s}
measure: {transmission: peak(motion)/peak(floor.x)}
compare_with:
  measured: {transmission: {own: [NUMBERS], stiff: {2 Hz: 1.3}}}
calibrate:
  free: {spring.c: 20 .. 60 kN/m, damper.d: 0.1 .. 4 kN*s/m}
  targets: {transmission: 5 %}
"""


@pytest.mark.long
def test_values_are_calibrated_to_numbers_of_a_known_machine(folder: Path) -> None:
    """The numbers of c = 30 kN/m and d = 1.5 kN s/m give these back; the stiff mount keeps its own spring."""
    numbers = ", ".join(f"{_transmission(f, 30e3, 1.5e3):.6f}" for f in (2, 3, 4))
    stiff = _transmission(2, 60e3, 1.5e3)
    study = _study(CALIBRATION.replace("NUMBERS", numbers).replace("1.3", f"{stiff:.6f}"))
    result = hb.study(study, processes=1, folder=folder / "out")
    assert result.calibrated is not None
    found = {name: after for name, (_, after) in result.calibrated.values.items()}
    # what is left of the start (exp(-7.5*4)), runs at 1e-6, the search ends at changes below 1e-3
    assert found == {"spring.c": pytest.approx(30e3, rel=2e-3), "damper.d": pytest.approx(1.5e3, rel=5e-3)}
    assert not result.calibrated.at_end
    assert min(result.calibrated.history) < 1e-3 * result.calibrated.history[0]
    assert result.value(result.of("stiff", "2 Hz"), "transmission") == pytest.approx(stiff, rel=1e-3)
    again = hb.study(study, processes=1, folder=folder / "out")
    assert again.calibrated == result.calibrated


def _ends_once(study: hb.Study, number: int, gains: dict[str, float] | None) -> Point:
    """The third case ends its process, once."""
    if number == 2 and not Path("died").exists():
        Path("died").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return at_point(study, number, gains)


def _ends_always(study: hb.Study, number: int, gains: dict[str, float] | None) -> Point:
    """The second case ends its process."""
    if number == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return at_point(study, number, gains)


@pytest.mark.long
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="processes are killed otherwise here")
def test_a_calibration_works_a_case_again_whose_process_is_killed(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    study = _study(CALIBRATION.replace("NUMBERS", "1.2, 1.1, 1"))
    plain = hb.study(study, processes=1, folder=folder / "plain")
    monkeypatch.setattr(calibration, "at_point", _ends_once)
    result = hb.study(study, processes=2, folder=folder / "out")
    assert Path("died").exists()
    assert result.calibrated is not None and plain.calibrated is not None
    assert result.calibrated.values == plain.calibrated.values


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="processes are killed otherwise here")
def test_a_calibration_whose_process_is_killed_says_which_case(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that dies alone, too, is named, and no answer is given without it."""
    monkeypatch.setattr(calibration, "at_point", _ends_always)
    study = _study(CALIBRATION.replace("NUMBERS", "1.2, 1.1, 1"))
    with pytest.raises(hb.SimulationError, match="of the calibration was ended"):
        hb.study(study, processes=2, folder=folder / "out")


def test_gains_that_move_along_stand_in_the_derivatives(folder: Path) -> None:
    """d/dm of the tuned damper and of what is measured with it, against the best dampers of two masses, bracketed."""
    study = _study("""study: along
model: isolator.yaml
evaluate: {from: 3 s, to: 5 s}
tune: {free: {damper.d: 0.1 .. 20 kN*s/m}, cost: rms(machine.v)*1 s/1 m + (damper.d/20 kN*s/m)**2/10}
measure: {motion: {is: peak(motion), unit: mm}}
compare_with: {wanted: {motion: 10 mm, damper.d: 5 kN*s/m}}
calibrate: {free: {machine.m: 50 .. 200 kg}, targets: {motion: 10 %, damper.d: 10 %}}
""")

    def best(mass: float) -> Point:
        there = replace(study, calibrated={"machine.m": (100.0, mass)})
        objective = Objective(assembled(there, there.cases[0]), study.tuning)
        found = minimize_scalar(lambda y: objective.cost(np.array([y])), bounds=(0, 1), method="bounded",
                                options={"xatol": 1e-5})
        return at_point(there, 0, objective.values(np.array([found.x])))

    exact, low, high = best(100.0), best(95.0), best(105.0)
    for name in ("motion", "damper.d"):
        # the bracketing knows the damper to some 1e-4 of 5 kN s/m, of the 160 N s/m that it moves by 5 %
        assert exact.slopes[name][0] == pytest.approx((high.numbers[name] - low.numbers[name]) / 10, rel=0.1)


@pytest.mark.parametrize(("kind", "wanted", "slope"), [
    ("highest", 3.0, 4.0), ("lowest", -5.0, 2.0), ("largest", 5.0, -2.0)])
def test_extremes_of_samples_and_their_slopes(kind: str, wanted: float, slope: float) -> None:
    signal, moved = np.array([1.0, -5.0, 3.0]), np.array([[0.0, 2.0, 4.0]])
    value, slopes = sampled_value(kind, np.arange(3.0), signal, moved)
    assert (value, slopes.tolist()) == (wanted, [slope])


def test_equivalent_range_of_a_sine_and_its_slope() -> None:
    """Cycles of range 6 at 2 Hz do the damage of one of 6*2**(1/m) a second; the range moves as the ends of each cycle."""
    time = np.linspace(0, 100, 20001)
    signal, shape = 1 + 3 * np.sin(4 * np.pi * time), np.sin(4 * np.pi * time) * (1 + 0.1 * np.sin(0.3 * time))
    value, (slope,) = sampled_value("equivalent_range", time, signal, shape[None, :], 4.0)
    assert value == pytest.approx(6 * 2**0.25, rel=2e-3)     # one cycle of two hundred is not closed
    still = np.zeros((0, len(time)))
    high, low = (sampled_value("equivalent_range", time, signal + h * shape, still, 4.0)[0] for h in (1e-5, -1e-5))
    assert slope == pytest.approx((high - low) / 2e-5, rel=1e-6)
    value, (slope,) = sampled_value("deviation", time, signal, shape[None, :])
    high, low = (sampled_value("deviation", time, signal + h * shape, still)[0] for h in (1e-5, -1e-5))
    assert value == pytest.approx(3 / np.sqrt(2), rel=1e-3)
    assert slope == pytest.approx((high - low) / 2e-5, rel=1e-6)
    assert sampled_value("equivalent_range", time, 0 * time, shape[None, :], 4.0)[0] == 0


def test_conditions_are_timed_and_counted() -> None:
    """One second of four, begun twice; what holds from the beginning has not begun."""
    time = np.linspace(0, 4, 401)
    holds = ((time > 1) & (time < 1.5) | (time > 2) & (time < 2.5)).astype(float)
    assert sampled_value("share", time, holds, np.zeros((0, 401)))[0] == pytest.approx(0.25, abs=0.01)
    assert sampled_value("times", time, holds, np.zeros((0, 401)))[0] == 2
    assert sampled_value("times", time, 1 - holds, np.zeros((0, 401)))[0] == 2


YEAR = """study: a year of floors
model: isolator.yaml
cases:
  damper: {light: {}, heavy: {damper.d: 2 kN*s/m}}
  a: [5 mm, 10 mm]
  f: [1 Hz, 2 Hz, 6 Hz]
  start: {sample: seeds, over: {seed: 1 .. 2}}
measure:
  motion: {is: largest(motion) + (seed - 1)*3 mm, unit: mm}
occurrence:
  of: [f, a]
  share: {1 Hz: [30, 30], 2 Hz: {5 mm: 15}, 6 Hz: [20, -]}
  required: {motion: <= 12 mm}
"""


def test_means_and_availability_are_weighted_by_the_scatter_diagram(folder: Path) -> None:
    Path("isolator.yaml").write_text(ISOLATOR.replace("a: 10 mm", "a: 10 mm, seed: 1"), encoding="utf-8")
    result = hb.study(_study(YEAR), processes=1)
    shares = {("1 Hz", "5 mm"): 30, ("1 Hz", "10 mm"): 30, ("2 Hz", "5 mm"): 15, ("6 Hz", "5 mm"): 20}
    assert result.complete
    assert len(result.outcomes) == 2 * 2 * len(shares), "combinations that never occur are not simulated"
    for means in result.occurrence_means():
        values = {cell: [result.value(o, "motion") for o in result.outcomes
                         if {means.others, *cell} <= {level.name for level in result.case_of(o).levels}] for cell in shares}
        assert means.means["motion"] == pytest.approx(sum(w*sum(values[c])/2 for c, w in shares.items())/95)
        assert means.available == pytest.approx(sum(w*sum(v <= 12 for v in values[c])/2 for c, w in shares.items())/95)
        assert 0 < means.available < 1
        assert means.fulfilled == {"motion <= 12 mm": means.available}
        assert means.failed == 0


def test_a_combination_without_a_result_is_not_available(folder: Path) -> None:
    text = YEAR.replace("  start: {sample: seeds, over: {seed: 1 .. 2}}\n", "").replace(" + (seed - 1)*3 mm", "")
    result = hb.study(_study(text.replace("<= 12 mm", "< 1 m")), processes=1)
    failed = replace(result.outcomes[0], values={}, problem="broken")
    light, heavy = replace(result, outcomes=(failed, *result.outcomes[1:])).occurrence_means()
    assert (light.failed, light.available) == (pytest.approx(30/95), pytest.approx(65/95))
    assert (heavy.failed, heavy.available) == (0, 1)
    assert math.isfinite(light.means["motion"])


@pytest.mark.parametrize(("old", "new", "message"), [
    ("<= 12 mm", "<= 12 s", """study.yaml:13: motion is in mm; its limit is in s [unit-wrong]
   13 |   required: {motion: <= 12 s}
      |                      ^^^^^^^
  Write the limit in mm or in a multiple of it."""),
    ("<= 12 mm", "<= 12", """study.yaml:13: motion is in mm; its limit has no unit [unit-wrong]
   13 |   required: {motion: <= 12}
      |                      ^^^^^
  Write the limit in mm or in a multiple of it."""),
    ("{1 Hz: [30, 30], 2 Hz: {5 mm: 15}, 6 Hz: [20, -]}", "{1 Hz: [0, -], 2 Hz: {5 mm: 0}}",
     """study.yaml:12: share: no combination occurs [occurrence-never]
   12 |   share: {1 Hz: [0, -], 2 Hz: {5 mm: 0}}
      |          ^
  Write a number above 0 for at least one of them."""),
    ("{1 Hz: [30, 30], 2 Hz: {5 mm: 15}, 6 Hz: [20, -]}", "scatter.csv",
     """study.yaml:12: share: 'scatter.csv' is not a number with a unit [not-a-quantity]
   12 |   share: scatter.csv
      |          ^^^^^^^^^^^
  Write a number, with its unit if it has one, or `-` for none."""),
    ("<= 12 mm", "12 mm", """study.yaml:13: motion: this is not a comparison with a limit [requirement-wrong]
   13 |   required: {motion: 12 mm}
      |                      ^^^^^
  Write a comparison with a quantity: `WOB deviation: <= 2 kN`."""),
    ("[f, a]", "[f, start]", """study.yaml:11: 'start' is not an axis of `cases:` with fixed levels [occurrence-axis]
   11 |   of: [f, start]
      |           ^^^^^
  Axes: damper, a, f."""),
    ("[20, -]", "[20, -3]", """study.yaml:12: share: a share is a number of at least 0 without a unit [occurrence-share]
   12 |   share: {1 Hz: [30, 30], 2 Hz: {5 mm: 15}, 6 Hz: [20, -3]}
      |                                                        ^^
  Write for example `12`, `3 %`, or `-` for a combination that never occurs.""")])
def test_wrong_scatter_diagrams_are_refused(folder: Path, old: str, new: str, message: str) -> None:
    Path("isolator.yaml").write_text(ISOLATOR.replace("a: 10 mm", "a: 10 mm, seed: 1"), encoding="utf-8")
    assert old in YEAR
    with pytest.raises(hb.ModelError) as caught:
        hb.study(_study(YEAR.replace(old, new, 1)), processes=1)
    assert str(caught.value) == message


# -- wrong files -------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("old", "new", "message"), [
    ("cases:\n", "free: {spring.c: 1 .. 2 kN/m}\ncases:\n", """study.yaml:3: 'free' belongs under `tune:` [key-strayed]
    3 | free: {spring.c: 1 .. 2 kN/m}
      | ^^^^
  Write `tune:` on a separate line, and `free:` below it, indented."""),
    ("4 Hz]", "4 mm]", """study.yaml:5: f: '4 mm' is not in Hz as the first value is [unit-wrong]
    5 |   f: [1 Hz, 2 Hz, 4 mm]
      |                   ^^^^
  Write it in Hz or in a multiple of it."""),
    ("largest(motion)/", "largest(moton)/", """study.yaml:8: nothing here is called 'moton' [name-unknown]
    8 |   transmission: largest(moton)/largest(floor.x)
      |                         ^^^^^
  Did you mean 'motion'?"""),
    ("transmission: largest(motion)/largest(floor.x)", "transmission: equivalent_range(motion, f)/1 m",
     """study.yaml:8: equivalent_range(e, m) needs a plain number m from 1 to 20 [exponent-wrong]
    8 |   transmission: equivalent_range(motion, f)/1 m
      |                 ^^^^^^^^^^^^^^^^
  Write the exponent of the S-N curve, e.g. `equivalent_range(WOB, 4)`."""),
    ("unit: mm}", "unit: kN}", """study.yaml:9: 'travel' is in m, not in kN [unit-wrong]
    9 |   travel: {is: rms(machine.x - floor.x), unit: kN}
      |                ^^^^^^^^^^^^^^^^^^^^^^^^
  Write a unit of the same kind, or leave it out."""),
    ("-, 0.6]", "0.6]", """study.yaml:12: transmission: 2 numbers are given along 'f', which has 3 levels [beside-number]
   12 |     transmission: {soft: [1.2, 0.6]}
      |                          ^
  Write one number for each level (1 Hz, 2 Hz, 4 Hz), `-` where there is none."""),
    ("{soft: [", "{sofft: [", """study.yaml:12: transmission: these are not levels of one axis [level-unknown]
   12 |     transmission: {sofft: [1.2, -, 0.6]}
      |                   ^
  Levels: spring: hard, soft; f: 1 Hz, 2 Hz, 4 Hz."""),
    ("    transmission: {", "    transmision: {", """study.yaml:12: 'transmision' is neither measured nor tuned in """
     """this study [quantity-unknown]
   12 |     transmision: {soft: [1.2, -, 0.6]}
      |     ^^^^^^^^^^^
  Did you mean 'transmission'?"""),
    ("signals: [motion,", "signals: [moton,", """study.yaml:15: nothing here is called 'moton' [name-unknown]
   15 |   motion: {signals: [moton, spring.F], from: 4 s}
      |   ^^^^^^
  Did you mean 'motion'?"""),
    ("curves: [transmission, travel]", "title: nothing", """study.yaml:14: picture 'curves' shows one of signals, """
     """curves, map, histogram, tornado, indices [picture-kind]
   14 |   curves: {title: nothing}
      |   ^^^^^^
  Write `signals: [WOB]` or `curves: [WOB variation]`.""")])
def test_wrong_studies_are_refused_with_a_place(folder: Path, old: str, new: str, message: str) -> None:
    text = STUDY.replace(", 2 Hz: 1.5}", "}")
    assert old in text
    with pytest.raises(hb.ModelError) as caught:
        hb.study(_study(text.replace(old, new, 1)), processes=1)
    assert str(caught.value) == message


@pytest.mark.parametrize(("old", "new", "code"), [
    ("rms(motion)/ref", "largest(motion)/ref", "cost-sampled"),
    ("        spring.c: [", "        spring.d: [", "sweep-unknown"),
    ("[20 kN/m, 40 kN/m, 60 kN/m]", "[20 mm]", "unit-wrong"), ("explore: 3", "explore: some", "count-wrong"),
    ("explore: 3", "method: genetic", "method-unknown"), ("number: 21}", "number: 1}", "number-wrong"),
    ("{damper.d: {4 Hz: 2 kN*s/m}}", "{damper.d: {4 Hz: 2 mm}}", "unit-wrong"), ("{motion: {is", "{cost: {is", "name-twice"),
    ("20 .. 60 kN/m}", "50 .. 60 kN/m}", "free-start-outside"),
    ("compare_with:", "calibrate: {free: {machine.m: 1 .. 2 t}, targets: {motion: 5 %}}\ncompare_with:", "target-unknown"),
    ("compare_with: {us", "calibrate: {free: {machine.m: 1 .. 2 t}, targets: {damper.d: 5 %}, to: them}\ncompare_with: {us",
     "source-unknown"),
    ("compare_with: {us", "calibrate: {free: {machine.n: 1 .. 2 t}, targets: {damper.d: 5 %}}\ncompare_with: {us",
     "free-unknown"),
    ("cases: {f:", "cases: {g:", "setting-unknown")])
def test_wrong_tunings_are_refused_before_any_run(folder: Path, old: str, new: str, code: str) -> None:
    assert old in TUNING
    with pytest.raises(hb.HeavebondError) as caught:
        hb.study(_study(TUNING.replace(old, new, 1)), processes=1)
    assert caught.value.problems[0].code == code
    assert caught.value.problems[0].place is not None


def test_a_study_that_tunes_nothing_is_not_tuned(folder: Path) -> None:
    _study(STUDY.replace("{soft: [1.2, -, 0.6], 2 Hz: 1.5}", "1.5"))
    code, told = _called("tune", "study.yaml")
    problems = told["problems"]
    assert isinstance(problems, Sequence)
    assert (code, problems[0]["code"]) == (2, "study-untuned")
