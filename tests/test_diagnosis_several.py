"""Several effects at once: which ladders are followed, what is taken out again, and when several names are given."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from benchmarks.diagnosis.making import Hidden
from benchmarks.diagnosis.rigs import RIGS
from benchmarks.diagnosis.truths import RECEIVER
from heavebond.core.cancellation import Budget
from heavebond.diagnosis import phases
from heavebond.diagnosis.answer import ranking, sentences, verdict
from heavebond.diagnosis.answer.sentences import VALUES
from heavebond.diagnosis.candidates.fixed_values import VALUE
from heavebond.diagnosis.diagnose import diagnose
from heavebond.diagnosis.evidence.flexible_laws import Adequacy
from heavebond.diagnosis.evidence.prediction import FITTED, SELECTION, TEST, PredictiveErrors
from heavebond.diagnosis.evidence.residual_tests import ResidualTests
from heavebond.diagnosis.search import stepwise
from heavebond.diagnosis.search.refit import Refit, unshown_amplitudes
from heavebond.diagnosis.search.step import Stage, leaders, merit, simpler_law
from heavebond.diagnosis.search.stepwise import Selection, select_stepwise
from heavebond.diagnosis.state import AddedEffect

SAMPLES = 1000
CLASSES = ("choked flow", "sensor offset", "dead band", "sensor gain")


@pytest.mark.long
def test_two_effects_are_found_and_what_the_first_may_be_is_told_beside_the_second(tmp_path: Path) -> None:
    # a gauge 0.24 bar off, and a valve that chokes; alone, its offset leaves far less than any other error of the gauge;
    # beside the valve another one leaves noise as well
    known = {truth.name: truth for truth in RECEIVER}
    hidden = [known["choked inlet"], known["SensorOffset in the channel receiver.p"]]
    machine = Hidden(replace(RIGS["receiver"], seconds=60.0), hidden, "test", tmp_path, 1.0, 0.0)
    found = diagnose(machine.case([0.6, 24e3]).experiment, classes=CLASSES, number=1, steps=5)
    valve, gauge = sorted(found.findings, key=lambda f: f.kinds != ("choked flow",))
    assert found.verdict == "one_of"
    assert valve.kinds == ("choked flow",)
    assert {"sensor offset"} < set(gauge.kinds)
    assert found.ladder[-1].chi2_held_out < 1.12 < 5 < found.ladder[2].chi2_held_out  # 601 samples: 1 +- 0.06


def test_of_several_effects_noise_is_asked() -> None:
    def explained(fitted: float, held: float, *, effects: int) -> bool:
        ladder: list[Any] = [_rung(1000, 1000), _rung(100, 500), *(_rung(fitted, held) for _ in range(effects))]
        return verdict.is_adequate(ladder, [SimpleNamespace(rung=rung, beyond=()) for rung in ladder[2:]])

    assert explained(1.05, 1.05, effects=1) and explained(1.05, 1.05, effects=5)
    assert explained(1.3, 1.3, effects=1) and not explained(1.3, 1.3, effects=2)
    assert not explained(10, 10, effects=1) and not explained(2.5, 10, effects=1)  # named as the main one at most
    assert not explained(2.1, 1.05, effects=3)


def _rung(fitted: float, held: float) -> Any:
    comparison = SimpleNamespace(experiment=SimpleNamespace(noise_given=True))
    return SimpleNamespace(chi2_fit=fitted, chi2_held_out=held, samples_held_out=SAMPLES, comparison=comparison)


EMPTY = Stage(None, {}, 0.0, SAMPLES, 1.0, 1.0, SAMPLES, (), ResidualTests(0, 0, 0, 9), (), (), None, (), {}, (),
              False, 0.0)


def errors(chi2: float) -> PredictiveErrors:
    """The same chi-square at each of a thousand fitted samples and of a thousand of a selection record."""
    counts = np.full(40, 2 * SAMPLES / 40)
    half = np.repeat([FITTED, SELECTION], 20)
    return PredictiveErrors(chi2 * counts, counts, half, half)


# -- ladders of a made-up catalogue: chi-square by the effects in the diagram ----------------------------------------------
Table = Mapping[str, float]


def climbed(monkeypatch: pytest.MonkeyPatch, table: Table, *, given: bool = True, most: int = 5,
            left: float = np.inf, pairs: dict[str, float] | None = None, cut: int = 0, ends: list[Stage] | None = None,
            parallel: bool = False, storing: str = "", early: list[str] | None = None) -> tuple[str, list[str]]:
    """The effects that are found, and the diagrams on which a step was made.

    `pairs` takes what each leading law leaves in its best pair. The step with the number `cut` is ended by the time
    limit. `ends` takes the last step, `early` the answers of all early ends. A diagram that is not in the table leaves
    what the best diagram with one effect less leaves. `B+A` is what A leaves when it is added to B, in a local minimum
    of its own. The effects are at one place if they are `parallel`, otherwise each is at its own. The effects in
    `storing` store energy.
    """
    made: list[str] = []

    def chi2_of(effects: str) -> float:
        name = "".join(sorted(effects))
        return table[name] if name in table else min((chi2_of(name.replace(e, "")) for e in name), default=1000.0)

    def trial(effects: str, new: str) -> Refit:
        chi2 = table.get(f"{effects}+{new}", chi2_of(effects + new))
        where = ("place",) if parallel else (new,)
        candidate = SimpleNamespace(label=new, component=new, kind=new, where=where, change=SimpleNamespace(moved={}),
                                    attaches="across", place="", signal="", numbers=(), vanishing=(),
                                    acts_on=lambda effects: False)
        return Refit(candidate, experiment(effects + new), {}, chi2 * SAMPLES, chi2, chi2, SAMPLES,
                     SAMPLES, len(effects) + 1, (), 0.0, 0, errors=errors(chi2))

    def step(effects: str, new: Sequence[str]) -> Stage:
        chi2 = chi2_of(effects)
        trials = sorted((trial(effects, e) for e in new if e not in effects), key=lambda t: t.cost)
        bare = Stage(experiment(effects), dict.fromkeys(effects, 0.0), chi2 * SAMPLES, SAMPLES,
                     chi2, chi2, SAMPLES, (), ResidualTests(0, 0, 0, 9), (), tuple(trials), None, (), {}, (), False, 10.0,
                     errors=errors(chi2))
        best = stepwise.leaders(bare, 1)
        return best[0] if best else bare

    def experiment(effects: str) -> SimpleNamespace:
        return SimpleNamespace(effects=effects, noise_given=given, model=SimpleNamespace(library=SimpleNamespace(
            component=lambda name: SimpleNamespace(stores="E" if name in storing else None, dissipates="P"))))

    def stepping(at: Any, way: Selection) -> Stage:
        made.append(at.effects)
        return replace(step(at.effects, "ABCD"), partial=len(made) == cut)

    monkeypatch.setattr(stepwise, "following", lambda made: made.chosen.experiment)
    monkeypatch.setattr(stepwise, "candidates", lambda at: [trial("", e).candidate for e in "ABCD"])
    monkeypatch.setattr(stepwise, "between_all_nodes", lambda at: [])
    monkeypatch.setattr(stepwise, "single", lambda at, candidate, say: step(at.effects, [candidate.label]))
    monkeypatch.setattr(stepwise, "fitted_base", lambda at: at)
    monkeypatch.setattr(stepwise, "refitted_from", lambda at, candidate, lender: trial(at.effects, candidate.label))
    *before, (way, last) = select_stepwise(experiment(""), stepping, lambda text: None, most,
                                           lambda: 0.0 if cut and len(made) >= cut else left)
    if early is not None:
        early += ["".join(added.candidate.label for added in selection) for selection, _ in before]
    if ends is not None:
        ends.append(last)
    if pairs is not None and way:
        pairs.update({t.candidate.label: t.chi2_fit for t in way[0].step.joint})
    return "".join(added.candidate.label for added in way), made


# C alone takes more than A or B, which are there
MISLED = {"": 1000, "A": 40, "B": 60, "C": 10, "AB": 1, "AC": 6, "BC": 7, "CD": 3, "ACD": 1.6}


def test_the_best_first_effect_need_not_be_one_of_the_two(monkeypatch: pytest.MonkeyPatch) -> None:
    found, made = climbed(monkeypatch, MISLED)
    assert found == "AB"
    assert made == ["", "C", "A", "B"]  # noise beside A ends the search; then A is looked back on


def test_the_leading_laws_are_compared_in_pairs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Alone, the imitator C leaves a quarter of what A leaves; in pairs A leaves less. B is not completed by A or C, which
    leave less alone. D explains less than half of what C explains, and is in no pair."""
    pairs: dict[str, float] = {}
    climbed(monkeypatch, {"": 1000, "A": 40, "B": 60, "C": 10, "AB": 1.6, "AC": 6, "BC": 7}, pairs=pairs)
    assert pairs == {"A": 1.6, "C": 6, "B": 60}
    pairs.clear()
    climbed(monkeypatch, {"": 1000, "A": 1}, pairs=pairs)  # A leaves noise: there is nothing to complete
    assert not pairs


def test_other_first_effects_are_followed_only_if_they_may_come_as_near_the_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    """A with D leaves little more than noise. B and C with D leave far more, so that no own second effect is searched for
    them; if B with D comes near the noise as well, one is."""
    apart = {"": 1000, "A": 10, "B": 40, "C": 60, "AD": 1.3, "BD": 9, "CD": 20}
    found, made = climbed(monkeypatch, apart)
    assert found == "AD" and made[:2] == ["", "A"] and not {"B", "C"} & set(made)
    assert climbed(monkeypatch, {**apart, "BD": 1.45})[1][:4] == ["", "A", "B", "C"]


def test_an_early_end_adds_no_effect_that_explains_nothing_noticeable(monkeypatch: pytest.MonkeyPatch) -> None:
    """D removes 7 % or half of what A leaves; the time may end while the leading laws are compared in pairs."""
    for remaining, answers in ((9.3, {"", "A"}), (5.0, {"", "A", "AD"})):
        early: list[str] = []
        climbed(monkeypatch, {"": 1000, "A": 10, "B": 400, "AD": remaining}, early=early)
        assert {*early} == answers


def test_one_step_is_one_effect(monkeypatch: pytest.MonkeyPatch) -> None:
    assert climbed(monkeypatch, MISLED, most=1) == ("C", [""])


def test_a_step_that_would_not_end_in_time_is_not_begun(monkeypatch: pytest.MonkeyPatch) -> None:
    """The step before took 10 s; half of that may do, as a step ends where the noise is reached."""
    assert climbed(monkeypatch, MISLED, left=4.0) == ("C", [""])
    assert climbed(monkeypatch, MISLED, left=6.0)[0] == "AB"


def test_a_step_that_the_time_limit_ended_is_reported_without_a_result(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its refits may be the wrong ones, since others are missing: it adds no effect, and its leading refit is shown. A step
    beside another leading law that was complete before is kept."""
    ends: list[Stage] = []
    assert climbed(monkeypatch, MISLED, cut=2, ends=ends)[0] == "C"
    assert ends[0].partial and ends[0].chosen is None and ends[0].trials[0].candidate.label == "D"
    assert climbed(monkeypatch, {**MISLED, "AB": 5}, cut=3, ends=ends)[0] == "CD" and ends[1].partial
    assert climbed(monkeypatch, MISLED, cut=3)[0] == "AB"  # noise is a result


def test_noise_ends_the_search(monkeypatch: pytest.MonkeyPatch) -> None:
    assert climbed(monkeypatch, {**MISLED, "C": 1.05}) == ("C", [""])


def test_with_an_estimated_noise_the_best_alone_is_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    _, made = climbed(monkeypatch, {"": 1000, "A": 40, "B": 60, "C": 10}, given=False)
    assert made == ["", "C"]
    _, made = climbed(monkeypatch, {"": 1000, "A": 40, "B": 60, "C": 10})
    assert made == ["", "C", "A", "B"]  # and none of A or B with another is better than C


def test_less_than_an_estimated_noise_ends_the_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is near it does not: an estimate sees only a part of the noise."""
    assert climbed(monkeypatch, {"": 1000, "C": 0.9, "CD": 0.4}, given=False) == ("C", [""])
    assert climbed(monkeypatch, {"": 1000, "C": 1.2, "CD": 0.4}, given=False)[0] == "CD"


def test_an_effect_that_hardly_takes_anything_away_is_no_finding() -> None:
    def step(before: float, after: float, held: bool = True) -> Any:
        found = SimpleNamespace(chi2_fit=after, chi2_held_out=after if held else float("nan"), errors=errors(after))
        return replace(EMPTY, chi2_fit=before, chi2_held_out=before if held else float("nan"), chosen=found,
                       cluster=(found,), errors=errors(before), samples_held_out=SAMPLES if held else 0)

    for before, after, named in ((16.1, 15.2, False), (16.1, 12.0, True), (1.05, 1.0, True), (1e6, 9e5, False)):
        for held in (True, False):
            made = step(before, after, held)
            way, last = phases._noticeable((stepwise.SelectedEffect(made, ()),), made)
            assert (len(way) == 1, last.chosen is not None) == (named, named)
    two = (stepwise.SelectedEffect(step(16.1, 15.2), ()), stepwise.SelectedEffect(step(15.2, 1.0), ()))
    assert phases._noticeable(two, two[1].step)[0] == two


def test_a_score_that_no_refit_justifies_is_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    """The fall that justifies an effect is exceeded by chance once in 1900 tries: what a score finds more often than that is
    settled by the refits, where neither size nor memory of what is left is more than chance."""
    monkeypatch.setattr(verdict, "is_still", lambda rung: False)
    ladder: list[Any] = [_rung(1.0, 1.0)]

    def said(score: float, size: float = 0.5, memory: float = 0.5, held: float = 1.0, complete: bool = True,
             partial: bool = False) -> str:
        step = replace(EMPTY, left=ResidualTests(score, size, memory, 3.7), chi2_held_out=held, partial=partial)
        return verdict.verdict(None, ladder, (), [step], None, complete=complete)

    assert said(0.5) == said(0.009) == said(6e-4) == "nothing"
    assert said(5e-4) == said(0.009, size=0.004) == said(0.009, memory=0.004) == said(0.009, held=1.2) == "undetermined"
    assert said(0.009, complete=False) == said(0.009, partial=True) == "undetermined"
    step = replace(EMPTY, left=ResidualTests(0.009, 0.5, 0.5, 3.7))
    words = sentences.verdict_words("nothing", ladder, (), [step], None)
    assert "z = 3.7, is exceeded by chance in 0.9 % of such records" in words


def test_an_effect_that_is_not_missed_any_more_is_taken_out(monkeypatch: pytest.MonkeyPatch) -> None:
    # A and B do next to nothing alone, so no ladder begins with them
    found, _ = climbed(monkeypatch, {"": 1000, "A": 700, "B": 800, "C": 10, "AC": 4, "BC": 6, "AB": 1, "ABC": 1})
    assert found == "BA"  # B in the place of C
    found, _ = climbed(monkeypatch, {"": 1000, "A": 700, "B": 900, "C": 10, "AC": 4, "BC": 6, "AB": 1, "ABC": 1})
    assert found == "AB"  # B, which does too little there, behind A


def test_another_effect_takes_the_place_of_one_that_it_beats_beside_a_later_one(monkeypatch: pytest.MonkeyPatch) -> None:
    found, _ = climbed(monkeypatch, {"": 1000, "C": 10, "AC": 2, "A": 800, "AD": 1, "D": 900})
    assert found == "AD"


def test_an_effect_keeps_its_place_where_the_records_do_not_exclude_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside A, D leaves 20 and C 30 of 1000: no law is exact, and the difference is no material share of the misfit. Of 2
    and 1 it is four times what D leaves."""
    table = {"": 1000, "C": 40, "A": 900, "AC": 30, "AD": 20, "D": 850, "CD": 40, "ACD": 29}
    assert climbed(monkeypatch, table)[0] == "CA"
    assert climbed(monkeypatch, {**table, "AC": 2, "AD": 1, "ACD": 2})[0] == "AD"


def test_an_effect_that_does_nothing_at_its_place_comes_behind_what_it_needs(monkeypatch: pytest.MonkeyPatch) -> None:
    """D takes the place of C, which came first; A does nothing alone, and D nothing without A."""
    table = {"": 1000, "C": 100, "A": 1000, "B": 700, "D": 950, "AC": 50, "AB": 49.9, "ABC": 20, "ABD": 1}
    assert climbed(monkeypatch, table)[0] == "BAD"


def test_an_effect_is_beaten_only_where_it_is_at_its_best(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sought anew beside A, C comes out in a valley that was not found before, where it leaves no more than D does."""
    table = {"": 1000, "C": 10, "AC": 2, "A": 800, "AD": 1.2, "D": 900}
    assert climbed(monkeypatch, table)[0] == "AD"
    assert climbed(monkeypatch, {**table, "A+C": 1.2})[0] == "CA"


def test_an_effect_has_the_alternatives_again_that_it_had_without_a_later_one() -> None:
    first, rival, other = (SimpleNamespace(candidate=SimpleNamespace(label=name)) for name in "ABC")
    alone: Any = stepwise.SelectedEffect(replace(EMPTY, chosen=first), (first, rival))
    later: Any = stepwise.SelectedEffect(replace(EMPTY, chosen=other), (other,), frozenset("A"))
    beside = alone.judged((first,), frozenset("C"))
    assert stepwise._among((beside, later)) == (beside, later)
    (again,) = stepwise._among((beside,))
    assert again.alternatives == (first, rival) and again.beside == frozenset()
    # and beside it once more those that were found beside it
    assert again.among(frozenset("C")).alternatives == (first,)
    # what was never asked for is left to be asked
    assert beside.among(frozenset("D")) is beside and beside.beside != frozenset("D")


def test_what_remains_without_an_effect_that_is_not_named_is_looked_back_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """B takes the place of C beside A, so what A and B may be is asked beside each other, once each."""
    asked: list[tuple[str, str]] = []
    before = stepwise._asked_again

    def noted(way: Selection, k: int, *more: Any) -> Selection | None:
        asked.append(("".join(added.candidate.label for added in way), way[k].candidate.label))
        return before(way, k, *more)

    monkeypatch.setattr(stepwise, "_asked_again", noted)
    assert climbed(monkeypatch, {"": 1000, "C": 10, "AC": 2, "A": 300, "AB": 1, "B": 400})[0] == "BA"
    assert asked == [("CA", "C"), ("BA", "A")]


def test_two_laws_that_one_between_them_imitates_are_tried_in_a_pair(monkeypatch: pytest.MonkeyPatch) -> None:
    """C leaves less than A or B alone, also with the best further effect; A and B together leave less, at one place."""
    hidden = {"": 1000, "C": 10, "AC": 9, "BC": 9, "A": 30, "B": 40, "AB": 3}
    for given in (True, False):  # the noise
        assert climbed(monkeypatch, hidden, given=given, parallel=True)[0] == "AB"
    assert climbed(monkeypatch, hidden, given=False)[0] == "C"  # at other places they are not tried
    assert climbed(monkeypatch, hidden, given=False, parallel=True, storing="A")[0] == "C"  # nor if one stores energy
    level = {**hidden, "AB": 9}
    assert climbed(monkeypatch, level, given=False, parallel=True)[0] == "C"


def test_a_name_by_an_effect_that_is_taken_out_goes_back_to_what_drove_it() -> None:
    def delay(signal: str) -> SimpleNamespace:
        return SimpleNamespace(component="Delay", attaches="input", place=f"before {signal}", signal=signal)

    gone = SimpleNamespace(change=SimpleNamespace(moved={"inlet.u": "lag_inlet.u"}))
    same: Any = stepwise._is
    assert same(delay("inlet.u"), delay("lag_inlet.u"), gone) and same(delay("outlet.u"), delay("outlet.u"), gone)
    assert not same(delay("lag_inlet.u"), delay("lag_inlet.u"), gone) and not same(delay("outlet.u"), delay("inlet.u"), gone)


def test_two_laws_of_one_name_are_named_once() -> None:
    def found(kind: str) -> Any:
        return SimpleNamespace(candidate=SimpleNamespace(attaches="across", kind=kind, place="at the wall", component="Law"),
                               alternatives=())

    assert sentences.verdict_words("effect", [], [found("drag"), found("stiffness"), found("stiffness")], [], None) == \
        "Missing: drag at the wall (Law); stiffness at the wall (Law), 2 times."


def test_every_law_that_is_starred_is_named() -> None:
    def law(name: str) -> Any:
        return SimpleNamespace(candidate=SimpleNamespace(attaches="across", kind="friction", place="at the wall",
                                                         component=name, where=("wall",)))

    finding = AddedEffect(law("Law1").candidate, *[None] * 3, tuple(law(f"Law{k}") for k in range(1, 10)))
    for said in (sentences.verdict_words("effect", [], [finding], [], None),
                 sentences.verdict_words("mainly", [], [replace(finding, rung=_rung(9, 9))], [], None, Adequacy(0.8))):
        assert "friction at the wall (Law1)." in said and f"{', '.join(f'Law{k}' for k in range(2, 10))} there." in said
    # where all are named one by one, the laws of one place are one name
    other = law("Law0")
    other.candidate.place, other.candidate.where = "at the floor", ("floor",)
    unsure = replace(finding, alternatives=(*finding.alternatives, other))
    assert sentences.verdict_words("one_of", [], [unsure], [], None) == "Missing: friction at the wall or at the floor. " \
        "The records cannot distinguish these places."
    play = law("Law10")
    play.candidate.kind = "play"
    either = replace(unsure, alternatives=(*unsure.alternatives, play))
    assert sentences.verdict_words("one_of", [], [either], [], None) == \
        "Missing: friction at the wall or at the floor; or play at the wall. The records cannot distinguish these."
    either = replace(finding, alternatives=(*finding.alternatives, play))
    words = sentences.verdict_words("one_of", [], [either], [], None)
    assert words.startswith("Missing: friction at the wall or play at the wall. ")


def test_a_candidate_whose_search_stopped_at_an_end_does_not_count_as_refitted() -> None:
    trial = SimpleNamespace(candidate=SimpleNamespace(label="A"), beyond=("a.F",), chi2_held_out=9.0)
    assert ranking._judged(trial, EMPTY, set()) == "range_end"
    assert ranking._judged(trial, EMPTY, {"A"}) == "indistinguishable"


def test_a_value_that_is_a_little_better_than_an_effect_is_named_with_it() -> None:
    def trial(cost: float) -> Any:
        return SimpleNamespace(cost=cost, samples=1000, unknowns=5, chi2_held_out=1.0, samples_held_out=1000,
                               errors=None)

    finding = AddedEffect(*[None] * 4, (trial(1000),))
    chosen = finding.alternatives[0]
    for cost, beside in ((985.0, True), (995.0, False)):  # BIC falls by 15 and by 5
        value = trial(cost)
        value.candidate = SimpleNamespace(kind=VALUE)
        made = replace(EMPTY, cluster=(value,))
        (found,), as_near = phases._beside([finding], chosen, made)
        assert (value in found.alternatives) is beside and as_near == (value,)
        assert phases._beside([finding, finding], chosen, made) == ((finding, finding), (value,))
        assert phases._beside([finding], chosen, replace(made, partial=True)) == ((finding,), ())


def test_values_are_tried_where_nothing_was_found(monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[Refit | None] = []

    def trying(experiment: Any, *, beside: Refit | None, **options: Any) -> Stage:
        tried.append(beside)
        return replace(EMPTY, partial=True)

    monkeypatch.setattr(phases, "make_value_stage", trying)
    monkeypatch.setattr(phases, "as_long_as", lambda part, experiment: experiment)
    # no effect was selected, and the diagram is near the noise
    near: Any = SimpleNamespace(chi2_held_out=1.2, chi2_fit=1.2)
    experiment: Any = SimpleNamespace()
    state = phases.State(experiment, experiment, models=(near,), searched=experiment, steps=(EMPTY,),
                         confirming=cast(Any, SimpleNamespace(one=None)))
    task = phases.Task(Budget(float("inf")), 1, 1, (), None, lambda text: None, lambda models: None)
    *_, state = phases.try_fixed_values(state, task)
    assert tried == [None] and [step.partial for step in state.steps] == [True] and VALUES in state.untried


def test_a_candidate_that_the_test_data_exclude_does_not_lead() -> None:
    def made_of(fitted: float, selection: float, test: float) -> PredictiveErrors:
        means = np.repeat([fitted, selection, test], 400)
        return PredictiveErrors(means, np.ones(1200), np.repeat([0, 1, 2], 400), np.repeat([FITTED, SELECTION, TEST], 400))

    def trial(name: str, found: PredictiveErrors, attaches: str = "across") -> Refit:
        candidate = SimpleNamespace(label=name, component=name, kind=name, where=(name,), attaches=attaches)
        return Refit(candidate, SimpleNamespace(noise_given=True), {}, found.mean(FITTED) * 400,
                     found.mean(FITTED), found.mean(SELECTION, TEST), 400, 800, 1, (), 0.0, 0, errors=found)

    before = made_of(20, 20, 20)
    by_merit, robust = trial("A", made_of(3, 3, 15)), trial("B", made_of(3.1, 3.1, 3))
    made = Stage(SimpleNamespace(noise_given=True), {}, 8000, 400, 20, 20, 800, (),
                 ResidualTests(0, 0, 0, 9), (), (by_merit, robust), None, (), {}, (), False, 0.0, errors=before)
    assert merit(by_merit) < merit(robust)
    assert [stage.chosen.candidate.label for stage in leaders(made, 2) if stage.chosen] == ["B"]

    # where noise is left, what a part of the diagram has already goes before a further part that fits a little better
    added, own = trial("added", made_of(0.999, 0.999, 0.999)), trial("own", made_of(1, 1, 1), "in")
    for trials, leader in (((added, own), "own"), ((added, trial("far", made_of(1.2, 1.2, 1.2), "in")), "added")):
        first = leaders(replace(made, trials=trials), 1)[0].chosen
        assert first is not None and first.candidate.label == leader


def test_a_law_whose_further_numbers_are_not_needed_becomes_the_simpler_one() -> None:
    def trial(name: str, unknowns: int, selection: float, kind: str = "friction", where: str = "rail") -> Refit:
        counts = np.full(40, 2 * SAMPLES / 40)
        half = np.repeat([FITTED, SELECTION], 20)
        found = PredictiveErrors(np.repeat([1.0, selection], 20) * counts, counts, half, half)
        candidate = SimpleNamespace(label=name, component=name, kind=kind, where=(where,))
        return Refit(candidate, SimpleNamespace(noise_given=True), {}, SAMPLES, 1.0, selection, SAMPLES,
                     SAMPLES, unknowns, (), 0.0, 0, errors=found)

    bent = trial("bent", 5, 1.0)
    made = replace(EMPTY, cost=9.0 * SAMPLES, chi2_fit=9.0, chi2_held_out=9.0, errors=errors(9.0))

    def simpler(*others: Refit) -> str | None:
        found = simpler_law(replace(made, trials=(bent, *others)), bent)
        return found.candidate.label if found is not None else None

    assert simpler(trial("plain", 4, 1.0)) == "plain"
    assert simpler(trial("worse", 4, 1.1)) is None
    # a little more on the selection data is chance, but with the larger merit a search would go to and fro
    assert simpler(trial("larger merit", 4, 1.011)) is None
    # an overflow whose edge is at the bottom is a leakage, whatever part of the circuit has it
    assert simpler(trial("elsewhere", 4, 1.0, where="wall"), trial("another class", 4, 1.0, kind="drag")) == "elsewhere"
    assert simpler(trial("as many numbers", 5, 0.99, kind="drag")) is None


def test_an_amplitude_is_shown_where_the_error_rises_without_it() -> None:
    """A straight line through 100 samples of noise 1, of which the slope is an amplitude and the offset is free: without the
    slope the sum of squares rises by (slope/its standard error)**2, which counts from 12 on."""
    x = np.linspace(0, 1, 100)
    J = np.stack([np.ones(100), x], axis=1)
    error = 1 / np.sqrt(np.sum((x - x.mean()) ** 2))

    def unshown(slope: float, neutral: float | None) -> tuple[str, ...]:
        number: Any = SimpleNamespace(name="law.k", amplitude=True, neutral=0.0, sought="" if neutral is None else None)
        columns = [SimpleNamespace(free=SimpleNamespace(name=name, range=SimpleNamespace(low=-1.0, high=99.0)),
                                   inner=lambda value: value) for name in ("c", "law.k")]
        problem: Any = SimpleNamespace(
            columns=columns, low=np.array([-1.0, -1.0]), high=np.array([99.0, 99.0]), evaluate=lambda inner: (None, J),
            priors=lambda inner: (np.zeros(0), np.zeros((0, 2))), at_end=lambda inner: np.zeros(2, bool))
        return unshown_amplitudes(problem, [number], np.array([0.5, slope]), np.zeros(100))

    assert unshown(3.3 * error, 0.0) == ("law.k",) and unshown(3.6 * error, 0.0) == ()
    # one that cannot be 0 is compared with the ends of its range, -1 and 99
    assert unshown(3.3 * error - 1, None) == ("law.k",) and unshown(3.6 * error - 1, None) == ()
    assert unshown(99 - 3.3 * error, None) == ("law.k",)
