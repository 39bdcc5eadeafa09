"""A candidate refitted: where its numbers are sought, and how far its figures can be trusted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from benchmarks.diagnosis.drawing import drawn
from benchmarks.diagnosis.machines import MACHINES
from benchmarks.diagnosis.making import Hidden, made
from benchmarks.diagnosis.rigs import RIGS
from benchmarks.diagnosis.truths import TRUTHS
from heavebond.diagnosis.answer.sentences import _not_held_out
from heavebond.diagnosis.candidates.catalogue import Candidate, single_candidates
from heavebond.diagnosis.diagnose import diagnose
from heavebond.diagnosis.search import refit, refit_starts
from heavebond.diagnosis.search.base_model import Base
from heavebond.diagnosis.search.refit import Refit, begun, followed, polished
from heavebond.diagnosis.search.scoring import Score, scored
from heavebond.diagnosis.search.step import fitted_base, is_noticeable, make_stage
from heavebond.diagnosis.search.workers import entry, restored


def refitted(base: Base, candidate: Candidate, guesses: Sequence[Score]) -> Refit | None:
    """A whole refit."""
    found = begun(base, candidate, guesses)
    return None if found is None else followed(base, found, guesses)


def test_an_amplitude_is_sought_beyond_what_the_tangent_tells(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The free flow of the valve takes most of a leak's misfit on itself, so that the leak is seven times what the rest asks
    for."""
    for module in (refit, refit_starts):
        monkeypatch.setattr(module, "WIDE", 3.0)
    truth = next(t for t in TRUTHS["cylinder"] if t.name == "valve leak")
    machine = Hidden(replace(RIGS["cylinder"], seconds=10.0), [truth], "test", tmp_path, 1.0, 0.0)
    base = fitted_base(machine.case([1e-11]).experiment)
    leak = next(c for c in single_candidates(base.problem.experiment) if c.label == truth.label)
    guesses = scored(base, leak)
    assert refit._RefitProblem(base, leak, guesses).ranges["valve.leakage"][1] < 0.5e-11
    found = refitted(base, leak, guesses)
    assert found is not None
    assert found.values["valve.leakage"] == pytest.approx(1e-11, rel=0.1)
    assert found.chi2_fit < 1.1  # 1503 samples: 1 +- 0.04
    assert found.experiment.free["valve.leakage"].range.high > 1e-11  # what is written to the new experiment


def test_a_close_comparison_goes_beyond_an_end_that_nobody_declared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A refit that has not arrived ends inside of a range which its valley leaves."""
    truth = next(t for t in TRUTHS["receiver"] if t.name == "leak in")
    machine = Hidden(replace(RIGS["receiver"], seconds=20.0), [truth], "test", tmp_path, 1.0, 0.0)
    base = fitted_base(machine.case([4e-10]).experiment)
    leak = next(c for c in single_candidates(base.problem.experiment) if c.label == truth.label)
    guesses, number = scored(base, leak), leak.numbers[0].name
    for module in (refit, refit_starts):  # the leak is four times what would move the channels by the misfit
        monkeypatch.setattr(module, "WIDE", 2.0)
    with monkeypatch.context() as at_once:
        at_once.setattr(refit, "WIDENED", 0)
        narrow = refitted(base, leak, guesses)
    assert narrow is not None
    end = narrow.experiment.free[number].range.high
    assert narrow.values[number] == pytest.approx(end, rel=2e-3)  # it stands at the end (see `AT_END`)
    found = polished(base, narrow, guesses)
    assert found.values[number] > 1.5 * end
    assert found.cost < 0.9 * narrow.cost


def test_a_limit_that_the_records_do_not_reach_is_said_to_be_that(tmp_path: Path) -> None:
    """A sensor that ends below the largest pressure says nothing of a lower end."""
    truth = next(t for t in TRUTHS["receiver"] if t.name == "leak in")
    machine = Hidden(replace(RIGS["receiver"], seconds=20.0), [truth], "test", tmp_path, 1.0, 0.0)
    experiment = machine.case([1e-14]).experiment
    tables = {record.file: pd.read_csv(record.file) for record in experiment.records.values()}
    least, most = (max(getattr(t.iloc[:, -1], end)() for t in tables.values()) for end in ("min", "max"))
    for file, table in tables.items():
        table.iloc[:, -1] = table.iloc[:, -1].clip(upper=0.4 * least + 0.6 * most)
        table.to_csv(file, index=False)
    found = diagnose(experiment, classes=["saturation"], number=1)
    assert found.verdict == "effect"
    low, high = sorted(found.findings[0].parameters, key=lambda p: p.value)
    assert low.unreached is not None and high.unreached is None
    assert any(low.name in line and "is not reached" in line for line in found.words)
    assert not any("look for more of its kind" in line for line in found.words)


def test_an_amplitude_that_no_score_moves_stays_neutral(tmp_path: Path) -> None:
    """A stop whose damping the records do not see is one whose stiffness alone is sought."""
    truth = next(t for t in TRUTHS["passive"] if t.name == "end stop")
    machine = Hidden(replace(RIGS["passive"], seconds=10.0), [truth], "test", tmp_path, 1.0, 0.0)
    base = fitted_base(machine.plain)
    stop = next(c for c in single_candidates(machine.plain) if c.label == truth.label)
    guesses = [s for s in scored(base, stop) if s.along == ("end_stop.c",)]
    found = refitted(base, stop, guesses)
    assert found is not None
    assert "end_stop.c" in found.values and "end_stop.d" not in found.experiment.free
    problem = refit._RefitProblem(base, stop, guesses)
    assert problem.starts.beside is not None and len(problem._start(problem.starts.beside)) == found.unknowns


def test_slack_is_what_a_fit_to_all_samples_takes_away(tmp_path: Path) -> None:
    """A few seconds of a record say little of twenty of another one."""
    truth = next(t for t in TRUTHS["receiver"] if t.name == "leak in")
    machine = Hidden(replace(RIGS["receiver"], seconds=20.0), [truth], "test", tmp_path, 1.0, 0.5)
    records = machine.case([4e-10]).experiment.records
    short = {n: replace(r, end=11.0) if r.use == "fit" else r for n, r in records.items()}
    base = fitted_base(replace(machine.plain, records=short))
    both = fitted_base(replace(machine.plain, records={n: replace(r, use="fit") for n, r in short.items()}))
    leak = next(c for c in single_candidates(base.problem.experiment) if c.label == truth.label)
    found, joint = (refitted(at, leak, scored(at, leak)) for at in (base, both))
    assert found is not None and joint is not None
    found = polished(base, found, scored(base, leak))
    # compared on the samples of the first search: of records that are all fitted, parts are held out, with gaps
    ranges = {n.name: (f.range.low, f.range.high) for n in leak.numbers if (f := found.experiment.free.get(n.name))}
    joint = refit.at_end_of(base, leak, scored(base, leak), ranges, joint.inner)
    apart, together = (t.cost + t.chi2_held_out * t.samples_held_out for t in (found, joint))
    assert apart > 1.2 * together
    assert np.isclose(apart - found.slack, together, rtol=0.05)  # as far as the tangent holds


@pytest.mark.long
def test_runs_that_err_by_more_than_what_a_refit_leaves_are_made_finer(tmp_path: Path) -> None:
    """A gauge with a rate limit whose lag is a millisecond: the runs of the search err by more than the noise, and a descent
    would end in the roughness of the sum of squares, at 5 to 70 noise variances."""
    name = "RateLimit in the channel receiver.p"
    rig = RIGS["receiver"]
    truth = next(t for t in TRUTHS["receiver"] if t.name == name)
    case = made(rig, [truth], f"third/receiver/{name}", tmp_path)
    base = fitted_base(case.experiment)
    candidate = next(c for c in single_candidates(case.experiment) if c.label == name)
    found = begun(base, candidate, scored(base, candidate))
    assert found is not None and found.finer > 0
    assert found.chi2_fit == pytest.approx(1.0, abs=3.5 * np.sqrt(2 / found.samples))
    kept = restored(base, candidate, scored(base, candidate), entry(candidate, found))
    assert kept is not None and kept.finer == found.finer


@pytest.mark.long
def test_an_effect_that_only_the_fitted_samples_show_is_named_by_their_cross_validation(tmp_path: Path) -> None:
    """A gauge that reads 11 % too little, on a record whose last third hardly moves: held-out samples are noise with and
    without it."""
    case = drawn(MACHINES["oil block"], 23, tmp_path)
    step = make_stage(case.experiment, number=1, classes=("sensor gain", "dead band"))
    assert not step.shown_held_out and step.chi2_held_out == pytest.approx(1.0, abs=3 * np.sqrt(2 / step.samples_held_out))
    assert step.chosen is not None and step.chosen.candidate.label == "SensorGain in the channel channel_1"
    assert is_noticeable(step, step.chosen) and step.chosen.chi2_fit < 1.1 < 2 < step.chi2_fit
    rival = next(t for t in step.trials if t.candidate.kind == "dead band")
    assert not is_noticeable(step, rival)
    finding: Any = SimpleNamespace(alternatives=step.cluster)
    (words,) = _not_held_out(finding, step)
    assert words.startswith("Held-out data do not show the effect") and "(2.15 to 0.947)" in words
    there: Any = SimpleNamespace(shown_held_out=True)
    assert _not_held_out(finding, there) == []


@pytest.mark.long
def test_candidates_that_only_held_out_data_tell_apart_are_refitted_both(tmp_path: Path) -> None:
    """Dry friction of a shaft that turns one way in the fitted record is a constant torque, and past a large inertia a
    drift of the sensor; the other record reverses."""
    case = drawn(MACHINES["gearbox"], 15, tmp_path)
    step = make_stage(case.experiment, number=1, classes=("dry friction", "constant force", "sensor drift"))
    fits = {t.candidate.label: (t.chi2_fit, t.chi2_held_out) for t in step.trials}
    friction, torque = "RotationalCoulombFriction between slow and the surroundings", "ConstantTorque on slow"
    assert fits[friction][0] == pytest.approx(fits[torque][0], rel=0.01) and fits[friction][1] < 0.7 * fits[torque][1]
    assert step.chosen is not None and step.chosen.candidate.kind == "dry friction"
    assert not {friction, torque, "SensorDrift in the channel channel_0"} & {t for of in step.twins.values() for t in of}


@pytest.mark.long
def test_what_takes_a_noticeable_part_away_leads(tmp_path: Path) -> None:
    """Friction that grows with the position, of which the catalogue has no law: end stops fit the first record best and do
    nothing for the other one, constant friction takes three quarters away there."""
    truth = next(t for t in TRUTHS["passive"] if t.name == "position friction")
    case = made(RIGS["passive"], [truth], "third/passive/position friction", tmp_path)
    step = make_stage(case.experiment, number=1, classes=("dry friction", "end stop"))
    assert step.chosen is not None and step.chosen.candidate.kind == "dry friction"
    best = min(step.trials, key=lambda t: t.cost)
    assert best.candidate.kind == "end stop" and not is_noticeable(step, best) and is_noticeable(step, step.chosen)
