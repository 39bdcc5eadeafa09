"""Probabilities of what records may be explained by, and the study that they are calibrated with."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

import heavebond as hb
from benchmarks.diagnosis import drawing
from benchmarks.diagnosis.machines import MACHINES
from benchmarks.diagnosis.verdicts import interval
from heavebond.diagnosis.candidates.catalogue import single_candidates
from heavebond.diagnosis.candidates.fixed_values import VALUE
from heavebond.diagnosis.candidates.places import Places
from heavebond.diagnosis.evidence import probability
from heavebond.diagnosis.evidence.prediction import PredictiveErrors
from heavebond.diagnosis.evidence.probability import (
    NOTHING,
    OTHER,
    OUTSIDE,
    PARAMETERS,
    TEMPERATURES,
    Calibration,
    Event,
    Evidence,
    compared_step,
    factor_bound,
    probabilities,
    stated,
)
from heavebond.diagnosis.evidence.residual_tests import ResidualTests
from heavebond.diagnosis.search.refit import Refit
from heavebond.diagnosis.search.step import Stage
from heavebond.language.library import library

FRICTION = Event("dry friction", 0.0, "between bed and slide", ("bed", "slide"), ("CoulombFriction between bed and slide",))
DRAG = Event("quadratic damping", 0.0, "between bed and slide", ("bed", "slide"), ("Drag between bed and slide",))
MASS = Event(VALUE, 0.0, "in slide (m)", ("slide",), ("Mass in slide (m)",))
REFIT = Refit(*(cast(Any, None),) * 3, 100.0, 1.0, 1.0, 100, 100, 2, (), 0.0, 1)
GIVEN = Calibration(0, 4.0, 0.25, math.log(2) / 0.75, 5.0, 0.02)  # odds outside: 0.25 at noise level, 0.5 at four times


def known(left: float = 1.0, missing: float = 0.0, sheet: float = 0.0) -> Evidence:
    """The evidence of friction before drag and a mass, at every temperature."""
    weights = {t: np.array([0.8, 0.15, 0.05]) for t in TEMPERATURES}
    return Evidence((FRICTION, DRAG, MASS), weights, left, missing, sheet)


def of(evidence: Evidence, given: Calibration = GIVEN) -> dict[str, float]:
    """The probabilities by the kinds of the events."""
    found = probabilities(evidence, given)
    assert sum(e.probability for e in found) == pytest.approx(1, abs=1e-12)
    return {e.kind: e.probability for e in found}


def test_probabilities_follow_from_the_weights_and_the_tests() -> None:
    """By hand: odds 0.25 of a law outside, 2 % kept, a fixed value counts as parameters."""
    found = of(known())
    assert found["dry friction"] == pytest.approx(0.98 * 0.8 * 0.8)
    assert found[PARAMETERS] == pytest.approx(0.98 * 0.8 * 0.05) and found[NOTHING] == 0
    assert found[OUTSIDE] == pytest.approx(0.98 * 0.2) and found[OTHER] == pytest.approx(0.02)
    worse = of(known(left=4.0))
    assert worse[OUTSIDE] == pytest.approx(0.98 / 3)  # odds 0.25 * 2
    assert of(known(left=1e9))[OUTSIDE] == pytest.approx(0.98 * (odds := 0.25 * 2**(1 / 0.75)) / (1 + odds))  # no more
    still = of(replace(known(missing=1.0, sheet=1.0), effects=(), weights={}, left=1.0))
    assert still[NOTHING] == pytest.approx(0.98 * (5 / 6) ** 2) and still[PARAMETERS] == pytest.approx(0.98 * 5 / 36)


def test_an_effect_that_is_found_beside_the_first_is_no_sign_of_a_law_outside(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is left is counted after all steps."""
    def step(left: float | None) -> Any:
        chosen = SimpleNamespace(errors=True, left=left) if left is not None else None
        return SimpleNamespace(trials=(), errors=None, left=ResidualTests(1, 1, 1, 0), chosen=chosen, partial=False,
                               joint=())

    monkeypatch.setattr(probability, "loss", lambda trial: trial.left)
    assert probability.evidence([step(40.0)]).left == 1  # of the first, trials that were refitted count
    assert probability.evidence([step(40.0), step(7.0)]).left == 7
    assert probability.evidence([step(40.0), step(7.0), step(0.9)]).left == 1
    assert probability.evidence([step(40.0), step(7.0), step(None)]).left == 7


def stage(*laws: tuple[str, str, float], joint: Sequence[Refit] = ()) -> Stage:
    """A step with refits of these kinds and names that leave so much of a large misfit."""
    trials = tuple(refit(*law) for law in laws)
    return Stage(cast(Any, None), {}, 4e5, 1000, 400, 400, 1000, (), ResidualTests(0, 0, 0, 9), (), trials, None, (), {}, (),
                 False, 0.0, errors=trials[0].errors, joint=tuple(joint))


def refit(kind: str, name: str, chi2: float) -> Refit:
    candidate: Any = SimpleNamespace(kind=kind, name=name, where=(name,), place=f"at {name}", label=f"{kind} at {name}")
    experiment: Any = SimpleNamespace(noise_given=True)
    counts = np.full(50, 20.0)
    errors = PredictiveErrors(chi2 * counts, counts, np.zeros(50, np.int64), np.zeros(50, np.int64))
    return replace(REFIT, candidate=candidate, experiment=experiment, chi2_fit=chi2, chi2_held_out=chi2, errors=errors)


def test_the_leading_laws_count_with_what_they_leave_in_pairs() -> None:
    """Drag leaves less than friction alone, and more in the best pairs. A review beside one further effect does not count,
    but if it reaches the noise, as then nothing else is missing."""
    friction, drag = ("dry friction", "slide", 60.0), ("quadratic damping", "slide", 40.0)
    pairs = [refit("dry friction", "slide", 2.0), refit("quadratic damping", "slide", 20.0)]
    step, other = stage(friction, drag, joint=pairs), stage(("quadratic damping", "slide", 9.0), ("end stop", "slide", 30.0))

    def left(made: Stage) -> list[float]:
        return sorted(t.chi2_fit for t in made.trials)

    assert left(compared_step(stage(friction, drag), None)) == [40, 60]
    assert left(compared_step(stage(friction, drag), other)) == [9, 30]
    assert left(compared_step(step, None)) == left(compared_step(step, other)) == [2, 20]
    assert left(compared_step(step, stage(("quadratic damping", "slide", 1.0)))) == [1]


def test_a_value_of_the_diagram_is_compared_with_effects_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """A wrong mass leaves as much as friction alone, and many times what friction leaves in a pair."""
    monkeypatch.setattr(Stage, "places", SimpleNamespace(place=lambda candidate: candidate.where))
    step = stage(("dry friction", "slide", 40.0), joint=[refit("dry friction", "slide", 2.0)])
    values = stage((VALUE, "slide.m", 40.0))
    made = compared_step(step, None)
    best = [*made.trials, *values.trials]
    found = probability._beside_values(best, probability.law_weights(best), [[*step.trials], [*values.trials]], step)
    assert found[16.0] == pytest.approx([0.5, 0.5])
    assert probability.law_weights(best)[16.0][1] < 0.05


def test_a_law_that_only_refines_a_simpler_one_counts_with_it() -> None:
    """Laws that predict alike: friction; friction with an amplitude that is not shown, there and at the other end of a rope;
    drag whose amplitudes are shown; and friction at a place that is another one."""
    experiment: Any = SimpleNamespace(model=SimpleNamespace(library=library()))

    def law(kind: str, unknowns: int, where: str, unshown: tuple[str, ...] = (), component: str = "Drag") -> Refit:
        candidate: Any = SimpleNamespace(kind=kind, where=("bed", where), label=f"{kind} at {where}", component=component)
        return replace(REFIT, candidate=candidate, unknowns=unknowns, unshown=unshown, experiment=experiment)

    families = [[law("pressed friction", 3, "slide", ("mu",))], [law("dry friction", 2, "slide")],
                [law("quadratic damping", 3, "slide")], [law("dry friction", 2, "floor")],
                [law("pressed friction", 3, "rope", ("mu",))]]
    twin: Any = SimpleNamespace(candidate=law("dry friction", 2, "rope").candidate)
    made: Any = SimpleNamespace(scores=[twin], twins={"dry friction at slide": ("dry friction at rope",)},
                                places=SimpleNamespace(place=lambda candidate: candidate.where))
    weights = {1.0: np.array([0.4, 0.2, 0.2, 0.1, 0.1])}
    found = probability._to_simpler(families, [family[0] for family in families], weights, made)
    assert found[1.0] == pytest.approx([0.0, 0.7, 0.2, 0.1, 0.0])


def test_a_law_with_an_unsupported_amplitude_counts_with_the_law_without_it() -> None:
    """Play whose gap is closed is a compliance, although the compliance has a number more (its damping time)."""
    experiment: Any = SimpleNamespace(model=SimpleNamespace(library=library()))

    def law(kind: str, component: str, unknowns: int, unshown: tuple[str, ...] = ()) -> Refit:
        candidate: Any = SimpleNamespace(kind=kind, where=("shaft", "arm"), label=component, component=component)
        return replace(REFIT, candidate=candidate, unknowns=unknowns, unshown=unshown, experiment=experiment)

    families = [[law("backlash", "GearBacklash", 3, ("gap",))], [law("series compliance", "ShaftCompliance", 4)]]
    made: Any = SimpleNamespace(scores=[], twins={}, places=SimpleNamespace(place=lambda candidate: candidate.where))
    found = probability._to_simpler(families, [family[0] for family in families], {1.0: np.array([0.9, 0.1])}, made)
    assert found[1.0] == pytest.approx([0.0, 1.0])


def test_a_law_that_generalises_a_simpler_one_counts_with_it() -> None:
    """Bouc-Wen hysteresis contains dry friction with presliding (`replaces: DahlFriction`): with more numbers and no smaller
    residual it is that friction. The drag of another class is not."""
    experiment: Any = SimpleNamespace(model=SimpleNamespace(library=library()))

    def law(kind: str, component: str, unknowns: int) -> Refit:
        candidate: Any = SimpleNamespace(kind=kind, where=("bed", "slide"), label=component, component=component)
        return replace(REFIT, candidate=candidate, unknowns=unknowns, experiment=experiment)

    families = [[law("dry friction", "DahlFriction", 3)], [law("hysteresis", "Hysteresis", 5)],
                [law("quadratic damping", "Drag", 5)]]
    made: Any = SimpleNamespace(scores=[], twins={}, places=SimpleNamespace(place=lambda candidate: candidate.where))
    found = probability._to_simpler(families, [family[0] for family in families], {1.0: np.array([0.3, 0.4, 0.3])}, made)
    assert found[1.0] == pytest.approx([0.7, 0.0, 0.3])


def test_a_model_with_more_numbers_has_a_smaller_weight_for_the_same_residual() -> None:
    """Two numbers more cost a factor of 2 q, the effective samples: 1000 samples at the noise level at temperature 16."""
    one, other = refit("dry friction", "slide", 1.0), replace(refit("hysteresis", "slide", 1.0), unknowns=REFIT.unknowns + 2)
    weights = probability.law_weights([one, other])[16.0]
    assert weights[0] / weights[1] == pytest.approx(1000 / 16, rel=1e-9)
    assert probability.law_weights([one, other], penalised=False)[16.0] == pytest.approx([0.5, 0.5])


def test_classes_are_equally_probable_before_the_records_and_share_it_among_their_places() -> None:
    """Two laws that predict alike, one of a class that was scored at one place, one of a class scored at four."""
    offset, variation = refit("sensor offset", "x", 1.0), refit("varying parameter", "spring", 1.0)
    scored: list[Any] = [SimpleNamespace(candidate=SimpleNamespace(kind="varying parameter", place=f"of spring with {k}",
                                                                   label=k), told_apart=True) for k in range(3)]
    made: Any = SimpleNamespace(scores=scored, twins={}, places=SimpleNamespace(place=lambda candidate: candidate.where))
    found = probability._with_prior({16.0: np.array([0.5, 0.5])}, [offset, variation], made)
    assert found[16.0] == pytest.approx([0.8, 0.2])


def test_the_bound_of_the_factor_falls_with_p() -> None:
    """-e p ln p: 1 at p = 1/e and above, 0.41 at 5 %, 0 at 0 (T. Sellke et al., 2001, table 1: 0.409)."""
    assert factor_bound(0.05) == pytest.approx(0.409, abs=2e-3)  # the table, from alpha = 0.289 = B/(1 + B)
    assert factor_bound(1.0) == factor_bound(1 / np.e) == 1.0 and factor_bound(0.0) == 0.0


def test_a_law_outside_the_catalogue_is_probable_if_curves_predict_better_or_none_was_fitted() -> None:
    event = Event("dry friction", 0.0, "at a", ("a",), ("CoulombFriction at a",))
    weights = {t: np.ones(1) for t in TEMPERATURES}
    likely = probabilities(Evidence((event,), weights, 50.0, 1e-9, 1e-9))
    assert {e.kind: e.probability for e in likely}[OUTSIDE] > 0.8
    unlikely = probabilities(Evidence((event,), weights, 1.0, 1e-9, 1e-9))
    assert {e.kind: e.probability for e in unlikely}[OUTSIDE] < 0.2
    # an identified curve that predicts no better than the law is no evidence for a law outside, whatever is left
    alike = Evidence((event,), weights, 50.0, 1e-9, 1e-9, (Event("rate", 0.0, "at a", ("a",), ("Curve at a",)),), weights)
    assert {e.kind: e.probability for e in probabilities(alike)}[OUTSIDE] < 0.2
    better = replace(alike, flexible={t: 100 * weight for t, weight in weights.items()})
    assert {e.kind: e.probability for e in probabilities(better)}[OUTSIDE] > 0.9


def test_what_is_hardly_probable_is_listed_as_one() -> None:
    """But what the answer names always stands by itself; the sum stays 1, also from a file."""
    kept = Evidence.of_dict(json.loads(json.dumps(known().as_dict())))
    events = probabilities(kept, replace(GIVEN, lapse=0.9))
    short = stated(events, [])
    assert DRAG.kind in {e.kind for e in short} and sum(e.probability for e in short) == pytest.approx(1)
    rare = probabilities(replace(kept, weights={t: np.array([0.995, 0.005, 0.0]) for t in TEMPERATURES}), GIVEN)
    assert DRAG.kind not in {e.kind for e in stated(rare, [])}
    assert DRAG.kind in {e.kind for e in stated(rare, DRAG.labels)}
    assert sum(e.probability for e in stated(rare, [])) == pytest.approx(1)


def test_a_case_of_the_study_is_drawn_and_judged(tmp_path: Path) -> None:
    """A case is the same each time; a law that is struck is no candidate; what was hidden is found among the events."""
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    one, two = (drawing.drawn(MACHINES["coil"], 0, tmp_path / name) for name in "ab")
    assert one.effect is not None and two.effect is not None and one.effect.label == two.effect.label
    assert one.misfit == two.misfit > 1
    assert (tmp_path / "a" / "record_0.csv").read_text() == (tmp_path / "b" / "record_0.csv").read_text()
    library = one.experiment.model.library
    struck = drawing.LibraryWithout(**vars(library), struck=frozenset({"SensorDrift"}))
    assert {c.name for c in library.effects()} - {c.name for c in struck.effects()} == {"SensorDrift"}
    places, candidates = Places.of(one.experiment), {c.label: c for c in single_candidates(one.experiment)}
    # that of the channel; before the input is another place, and other laws of the channel are other classes
    there = [label for label, c in candidates.items() if one.matches(c, places)]
    assert there == [one.effect.label] and one.effect.label.endswith("in the channel channel_0")
    assert f"{one.effect.component} before supply.u" in candidates and "FirstOrderLag in the channel channel_0" in candidates


def test_intervals_of_shares() -> None:
    """0 of 20: up to 16.8 % (Clopper and Pearson: 1 - 0.025**(1/20))."""
    assert interval(0, 20) == pytest.approx((0.0, 1 - 0.025**(1 / 20)))
    assert interval(20, 20) == pytest.approx((0.025**(1 / 20), 1.0))


@pytest.mark.long
def test_a_diagnosis_states_probabilities() -> None:
    """Of the bundled record with choked flow; none where only a class was tried."""
    found = hb.diagnose("receiver_rig/choked", number=1, steps=1)
    assert found.events[0].kind == "choked flow" and found.events[0].probability > 0.6
    assert sum(e["probability"] for e in found.as_dict()["probabilities"]) == pytest.approx(1)
    assert replace(found, restricted=True).events == ()


def test_a_difference_that_persists_throughout_records_is_worth_as_many_blocks_as_records() -> None:
    """Six records of 100 bins, blocks of two bins: of white differences the records are worth some 300 blocks (the variance
    comes from six sums, so that it may be off by half), of a shift of each record six, less one for the mean."""
    draws = np.random.default_rng(1)
    stretch, counts = np.repeat(np.arange(6), 100), np.ones(600)
    for _ in range(5):
        white = draws.normal(size=600)
        shift = np.repeat(draws.normal(size=6), 100) + 0.1 * white
        assert 100 < probability._independent_blocks(np.array([0 * white, white]), counts, stretch, 2.0) <= 300
        assert 4.5 < probability._independent_blocks(np.array([0 * shift, shift]), counts, stretch, 2.0) < 6
    # of three records no variance is estimated
    assert probability._independent_blocks(np.array([shift[:300]]), counts[:300], stretch[:300], 2.0) == 150


def test_a_law_that_explains_nothing_noticeable_is_no_explanation(monkeypatch: pytest.MonkeyPatch) -> None:
    """Drift leaves less than the other law on all samples, but removes no fifth of the residual of 400: what is missing is
    outside the catalogue. A law that removes half of it keeps its share."""
    monkeypatch.setattr(Stage, "places", SimpleNamespace(place=lambda candidate: candidate.where))
    before = {"errors": refit("", "", 400.0).errors, "chi2_held_out": math.nan, "samples_held_out": 0}  # one record
    weak = probability.evidence([replace(stage(("sensor drift", "x", 330.0), ("heat loss", "room", 390.0)), **before)])
    assert of(weak)[OUTSIDE] == pytest.approx(0.98) and of(weak)["sensor drift"] == 0
    mixed = probability.evidence([replace(stage(("sensor drift", "x", 330.0), ("heat loss", "room", 200.0)), **before)])
    assert of(mixed)["heat loss"] + of(mixed)[OUTSIDE] == pytest.approx(0.98) and of(mixed)["heat loss"] > 0.2
    still = replace(stage(("heat loss", "room", 200.0)), **before, still=220.0)  # the mean values leave hardly more
    assert of(probability.evidence([still]))[OUTSIDE] == pytest.approx(0.98)


def test_candidates_that_act_as_a_refitted_one_or_cannot_be_simulated_are_not_left_to_try() -> None:
    """Eleven candidates: one refitted, its twin, another law there, one that was left out, two that cannot be simulated,
    four that were not refitted, and one without a score, which gets the mean gain. A law that explains nine tenths is hardly
    wrong."""
    gains = [("a", 3.0), ("a2", 3.0), ("twin", 3.0), ("out", 1.0), *((f"open {k}.", 0.875) for k in range(4))]
    scored: list[Any] = [SimpleNamespace(candidate=SimpleNamespace(label=label, kind=label.rstrip("2"), where=("x",)),
                                         gain=gain) for label, gain in gains]
    made = replace(stage(("a", "x", 9.0)), scores=tuple(scored), partial=True, planned=11, broken=("b", "c"),
                   twins={"a at x": ("twin",)}, excluded={"out": "never acts", "a": ""})
    mean = 13.5 / 8
    u = (3.5 + mean) / (13.5 + mean)
    assert probability._untried(made) == pytest.approx(u)
    explains = replace(made, errors=refit("", "", 81.0).errors)  # 8 of 80 above the noise are left
    assert probability._untried(explains) == pytest.approx(0.1 * u / (0.1 * u + 1 - u))


def test_places_that_the_records_cannot_distinguish_add_their_prior_probabilities() -> None:
    """A damper between three pairs of nodes: two act alike, of which one was refitted, and one has no influence."""
    damper, compliance = refit("viscous damping", "tip", 1.0), refit("series compliance", "beam", 1.0)
    twin, mute = (SimpleNamespace(kind="viscous damping", place=f"at {w}", where=(w,), label=w) for w in ("wall", "motor"))
    made: Any = SimpleNamespace(twins={"viscous damping at tip": ("wall",)}, scores=[
        SimpleNamespace(candidate=twin, told_apart=True), SimpleNamespace(candidate=mute, told_apart=False)],
        places=SimpleNamespace(place=lambda candidate: candidate.where))
    found = probability._with_prior({16.0: np.array([0.5, 0.5])}, [damper, compliance], made)
    assert found[16.0] == pytest.approx([0.5, 0.5])
