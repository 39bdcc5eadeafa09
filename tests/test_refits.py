"""Which refits are followed to their ends, and which are only begun."""

from __future__ import annotations

import time as clock
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from heavebond.diagnosis.search.schedule import FIRST, REFITS, RefitSchedule, planned
from heavebond.diagnosis.search.scoring import Score
from heavebond.diagnosis.search.step import make_stage
from heavebond.estimation.experiment import load_experiment
from heavebond.estimation.residuals import Descent

SAMPLES = 1000
NODES = SimpleNamespace(nodes={})


@dataclass(frozen=True)
class Candidate:
    label: str


@dataclass(frozen=True)
class Trial:
    """What is asked of one: the sum of squares and its figures a sample."""

    candidate: Candidate
    cost: float
    begun: tuple[Descent, ...] = ()
    falls: bool = False
    samples_held_out: int = SAMPLES

    @property
    def chi2_fit(self) -> float:
        return self.cost / SAMPLES

    @property
    def chi2_held_out(self) -> float:
        return self.cost / SAMPLES


@dataclass
class Workers:
    """Chi-square a sample of each candidate after its first steps and at its end; None cannot be simulated."""

    figures: Mapping[str, tuple[float, float] | None]
    falling: str = ""
    lost: tuple[str, ...] = ()
    begun: list[str] = field(default_factory=list)
    followed: list[str] = field(default_factory=list)

    def begin(self, jobs: Sequence[tuple[Candidate, object]], least: float, until: float, most: float
              ) -> Iterator[tuple[Candidate, Trial | None]]:
        for candidate, _ in jobs:
            if clock.perf_counter() > until:
                return
            self.begun.append(candidate.label)
            found = self.figures[candidate.label]
            ends = (Descent(np.zeros(1), 0.0, (), ""),)
            yield candidate, found and Trial(candidate, SAMPLES * found[0], ends, candidate.label == self.falling)

    def follow(self, jobs: Sequence[tuple[Trial, object]], until: float) -> Iterator[tuple[Candidate, Trial]]:
        for trial, _ in jobs:
            if clock.perf_counter() > until:
                return
            found = self.figures[trial.candidate.label]
            assert found is not None
            self.followed.append(trial.candidate.label)
            yield trial.candidate, Trial(trial.candidate, SAMPLES * found[1])


def made(workers: Workers, leading: str, rest: str, seconds: float = 60.0, explained: float = 0.0,
         postponed: Sequence[str] = (), misfit: float = 0.0) -> tuple[bool, dict[str, float]]:
    """Whether all was done, and the figure that each candidate was left with; a trial below `explained` explains the
    misfit. `misfit` is the figure without candidates, of a later step."""
    refits = RefitSchedule(cast(Any, workers), lambda text: None, lambda trial: trial.chi2_fit < explained,
                           whole=SAMPLES * misfit)
    first, others = ([(cast(Any, Candidate(label)), list[Any]()) for label in labels] for labels in (leading, rest))
    whole = refits.make(first, lambda: others, clock.perf_counter() + seconds)
    assert refits.postponed == [*postponed]
    return whole, {label: trial.chi2_fit for label, trial in refits.trials.items()}


def test_what_is_hopeless_beside_the_best_is_not_followed() -> None:
    workers = Workers({"a": (500.0, 400.0), "b": (3.0, 1.0), "c": (20.0, 12.0), "d": None, "e": (9.0, 8.0)})
    assert made(workers, "abcd", "e") == (True, {"a": 500.0, "b": 1.0, "c": 12.0})
    assert workers.followed == ["b", "c"]  # the best first
    assert "e" not in workers.begun  # b is noise


def test_what_still_falls_is_followed_though_it_is_far_behind() -> None:
    workers = Workers({"a": (500.0, 0.9), "b": (3.0, 1.0)}, falling="a")
    assert made(workers, "ab", "") == (True, {"a": 0.9, "b": 1.0})


def test_where_nothing_comes_near_the_noise_all_are_followed() -> None:
    """Also what was only begun before, which may be slow to arrive."""
    workers = Workers({"a": (500.0, 1.0), "b": (30.0, 20.0), "c": (800.0, 700.0)})
    assert made(workers, "ab", "c") == (True, {"a": 1.0, "b": 20.0, "c": 700.0})
    assert workers.followed == ["b", "a", "c"]


def test_in_a_later_step_inferior_refits_are_not_followed() -> None:
    """`a` removes 100 of 1000 and `b` 600, of which a quarter is 150; `c` still falls."""
    figures = {"a": (900.0, 1.0), "b": (400.0, 300.0), "c": (950.0, 940.0), "d": (850.0, 840.0)}
    workers = Workers(figures, falling="c")
    assert made(workers, "abcd", "", misfit=1000.0) == (True, {"a": 900.0, "b": 300.0, "c": 940.0, "d": 840.0})
    # the best one removes less than a fifth
    assert made(Workers({**figures, "b": (810.0, 805.0)}), "abcd", "", misfit=1000.0)[1]["a"] == 1.0


def test_in_a_later_step_small_scores_are_refitted_for_the_first_candidates_only() -> None:
    def scored(number: int, gain: float) -> Score:
        candidate = SimpleNamespace(
            label=f"c{number}", kind=f"k{number}", where=(), vanishes=True, numbers=(), component=f"k{number}", change=NODES)
        return Score(cast(Any, candidate), {}, gain**0.5, 1.0, np.zeros(0), 1.0, 1.0, np.eye(40)[number], ("a",), 1)

    scores = [scored(k, 100.0 - k) for k in range(30)]
    for needed, number in ((0.0, 30), (80.5, 20), (99.5, FIRST)):
        leading, remaining, _ = planned(scores, {}, needed)
        assert (len(leading), len(remaining)) == (number, 30 - number)


def test_the_rest_waits_for_the_next_step_if_a_law_explains_most_and_more_than_noise_is_left() -> None:
    """`b` leaves 20 of 1000; beyond the first 24 candidates nothing is refitted then. At the noise level all leading ones
    are, as they are alternatives."""
    leading = "b" + "acdefghijklmnopqrstuvwxyzABC"
    many = dict.fromkeys(leading, (500.0, 400.0))
    workers = Workers({**many, "b": (30.0, 20.0), "D": (1.0, 1.0)})
    whole, figures = made(workers, leading, "D", explained=200.0, postponed=leading[REFITS:])
    assert whole and figures["b"] == 20.0 and len(figures) == REFITS and "D" not in figures
    whole, figures = made(Workers({**many, "b": (3.0, 1.0), "D": (1.0, 1.0)}), leading, "D", explained=200.0)
    assert whole and len(figures) == len(leading)
    whole, figures = made(Workers({**many, "b": (30.0, 20.0), "D": (1.0, 1.0)}), leading, "D")
    assert figures["D"] == 1.0


def test_one_of_the_rest_that_explains_spares_all_others() -> None:
    workers = Workers({"a": (500.0, 400.0), "b": (300.0, 200.0), "c": (3.0, 1.0), "d": (700.0, 600.0)})
    assert made(workers, "ab", "cd") == (True, {"a": 400.0, "b": 200.0, "c": 1.0, "d": 700.0})


@pytest.mark.parametrize("seconds", [-1.0, 0.0])
def test_where_time_is_over_nothing_is_begun(seconds: float) -> None:
    assert made(Workers({"a": (3.0, 1.0)}), "a", "", seconds) == (False, {})


def test_a_step_that_ends_before_its_refits_knows_the_equivalent_candidates(monkeypatch: pytest.MonkeyPatch) -> None:
    """An answer that ends early would otherwise name one of two equal laws only."""
    def ended(*_: object) -> bool:
        raise KeyboardInterrupt

    monkeypatch.setattr(RefitSchedule, "make", ended)
    stage = make_stage(load_experiment("cylinder_rig/leakage"), number=1, classes=("internal leakage", "leakage"))
    assert stage.partial and not stage.trials
    assert "LaminarLeakage between chamber_a and chamber_b" in stage.twins["Cylinder in cylinder (leakage)"]
