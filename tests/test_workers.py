"""Candidates in one and two processes, and what Ctrl-C leaves."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time as clock
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from collected import partly

from heavebond.core.progress import Progress
from heavebond.diagnosis.candidates.catalogue import Candidate, single_candidates
from heavebond.diagnosis.diagnose import diagnose
from heavebond.diagnosis.search import schedule, step, workers
from heavebond.diagnosis.search.base_model import Base, SharedDiagram
from heavebond.diagnosis.search.refit import Refit
from heavebond.diagnosis.search.scoring import Score, scored
from heavebond.diagnosis.search.step import fitted_base, make_stage
from heavebond.diagnosis.search.workers import Workers
from heavebond.estimation.experiment import load_experiment
from heavebond.estimation.residuals import Residuals, Run

CHOSEN = ("PneumaticValve in inlet (b_cr)", "SensorGain in the channel receiver.p", "DeadBand before inlet.u")


@pytest.fixture(scope="module")
def base() -> Base:
    return fitted_base(load_experiment("receiver_rig/choked"))


@pytest.fixture(scope="module")
def chosen(base: Base) -> list[Candidate]:
    return [c for c in single_candidates(base.problem.experiment) if c.label in CHOSEN]


def refitted(workers: Workers, jobs: Sequence[tuple[Candidate, Sequence[Score]]]) -> dict[str, Refit]:
    """Whole refits, by label."""
    found = {c.label: trial for c, trial in workers.begin(jobs) if trial is not None}
    return {c.label: trial for c, trial in workers.follow([(found[c.label], guesses) for c, guesses in jobs])}


def test_two_processes_find_what_one_finds(base: Base, chosen: list[Candidate]) -> None:
    found = []
    for number in (1, 2):
        with Workers(base, number) as workers:
            scores = {c.label: got for c, got in workers.score(chosen)}
            trials = refitted(workers, [(c, scores[c.label]) for c in chosen])
        found.append((scores, trials))
    (one, alone), (two, beside) = found
    assert set(one) == set(two) == set(alone) == set(beside) == set(CHOSEN)
    for label in CHOSEN:
        assert [s.z for s in one[label]] == pytest.approx([s.z for s in two[label]], rel=1e-9)
        first, second = alone[label], beside[label]
        assert first.cost == pytest.approx(second.cost, rel=1e-9)
        assert first.values == pytest.approx(second.values, rel=1e-9)


def test_the_classes_take_turns_in_the_scores(base: Base) -> None:
    labels = ("Delay before inlet.u", "Delay in the channel receiver.p", "SensorGain before inlet.u")
    among = {c.label: c for c in single_candidates(base.problem.experiment)}
    with Workers(base, 1) as workers:
        assert [c.label for c, _ in workers.score([among[label] for label in labels])] == [labels[0], labels[2], labels[1]]


def test_a_candidate_that_casadi_cannot_evaluate_does_not_end_a_search(base: Base, chosen: list[Candidate],
                                                                       monkeypatch: pytest.MonkeyPatch) -> None:
    """Its error is a RuntimeError in the midst of a run: the candidate counts as one that cannot be simulated."""
    def broken(*given: object) -> None:
        raise RuntimeError("CVODES does not support algebraic variables")

    with Workers(base, 1) as workers_here:
        scores = {c.label: got for c, got in workers_here.score(chosen)}
        (_, refit), *_ = workers_here.begin([(chosen[0], scores[chosen[0].label])])
        monkeypatch.setattr(Run, "residuals", broken)
        monkeypatch.setattr(Residuals, "evaluate", broken)
        assert [got for _, got in workers_here.score(chosen)] == [[], [], []]
        assert [trial for _, trial in workers_here.begin([(chosen[0], scores[chosen[0].label])])] == [None]
        assert refit is not None and [t for _, t in workers_here.follow([(refit, scores[chosen[0].label])])] == [refit]


@pytest.mark.long
def test_half_of_the_time_of_a_step_is_left_for_refits(monkeypatch: pytest.MonkeyPatch) -> None:
    """A clock on which each score takes a second and all else nothing: of 20 s ten are for scores."""
    now = [0.0]

    def say(text: str) -> None:
        now[0] += text.startswith("scoring ")

    fake = SimpleNamespace(perf_counter=lambda: now[0])
    for module in (step, schedule, workers):
        monkeypatch.setattr(module, "clock", fake)
    made = make_stage(load_experiment("receiver_rig/choked"), number=1, seconds=20.0, progress=say)
    assert made.partial and made.trials and made.chosen is not None
    assert 10 <= len({s.candidate.label for s in made.scores}) <= 11 < made.planned


def test_the_truth_wins(base: Base, chosen: list[Candidate]) -> None:
    with Workers(base, 1) as workers:
        trials = refitted(workers, [(c, []) for c in chosen])
    best = min(trials.values(), key=lambda t: t.chi2_held_out)
    assert best.candidate.label == CHOSEN[0]
    assert best.chi2_held_out < 1.1 and np.isfinite(best.bic)


@pytest.mark.parametrize("number", [1, 2])
@pytest.mark.parametrize("at", partly(["scoring 3", "refitting 1"], 2))
def test_ctrl_c_ends_at_once_with_what_was_done(number: int, at: str) -> None:
    pressed: list[float] = []

    def say(text: str) -> None:
        if text.startswith(at) and not pressed:
            pressed.append(clock.perf_counter())
            signal.raise_signal(signal.SIGINT)

    made = make_stage(load_experiment("receiver_rig/choked"), number=number, progress=say,
                      classes=("choked flow", "sensor gain"))
    assert clock.perf_counter() - pressed[0] < 5  # a busy machine; it takes some tenths of a second
    assert made.partial
    assert len(made.scores) == 2 if at.startswith("scoring") else len(made.trials) == 1
    # not by `join`: where the thread of the pool collects a process, `join` returns before that is noted
    end = clock.perf_counter() + 5
    while multiprocessing.active_children() and clock.perf_counter() < end:
        clock.sleep(0.01)
    assert not multiprocessing.active_children()


def _dying(base: Base, candidate: Candidate, shared: SharedDiagram | None) -> list[Score]:
    """The scores of a candidate; the process is killed at the second, for ever, and once at the third."""
    if candidate.label == CHOSEN[1] or (candidate.label == CHOSEN[2] and not Path("died").exists()):
        Path("died" if candidate.label == CHOSEN[2] else "dead").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return scored(base, candidate, shared)


def _not_followed(base: Base, trial: Refit, guesses: Sequence[Score], progress: Progress) -> Refit:
    os.kill(os.getpid(), signal.SIGKILL)
    return trial


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="processes are killed otherwise here")
def test_a_worker_that_the_system_kills_costs_its_candidate_only(
        base: Base, chosen: list[Candidate], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("heavebond.diagnosis.search.workers.scored", _dying)
    with Workers(base, 2) as workers:
        scores = {c.label: got for c, got in workers.score(chosen)}
    assert Path("died").exists() and Path("dead").exists()
    assert set(scores) == set(CHOSEN) and workers.lost == [CHOSEN[1]]
    assert scores[CHOSEN[0]] and not scores[CHOSEN[1]] and scores[CHOSEN[2]]
    monkeypatch.setattr("heavebond.diagnosis.search.workers.followed", _not_followed)
    with Workers(base, 2) as workers:
        begun = [t for _, t in workers.begin([(c, scores[c.label]) for c in chosen if scores[c.label]]) if t is not None]
        after = {c.label: t for c, t in workers.follow([(t, scores[t.candidate.label]) for t in begun])}
    assert begun and {label: t.cost for label, t in after.items()} == {t.candidate.label: t.cost for t in begun}
    assert set(workers.lost) == set(after)


@pytest.mark.long
def test_a_diagnosis_says_what_it_is_without(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("heavebond.diagnosis.search.workers.scored", _killed)
    found = diagnose("receiver_rig/choked", number=2, classes=("sensor gain",))
    assert found.steps[0].lost and found.as_dict()["lost"] == sorted(found.steps[0].lost)
    assert any(line.startswith("Not tried to the end: ") and found.steps[0].lost[0] in line for line in found.words)


def _killed(base: Base, candidate: Candidate, shared: SharedDiagram | None) -> list[Score]:
    os.kill(os.getpid(), signal.SIGKILL)
    return scored(base, candidate, shared)
