"""The answer of a diagnosis as a tree, its sentences of physics, and the agreement of its tables and texts."""

from __future__ import annotations

from dataclasses import replace
from math import exp
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from heavebond.diagnosis.answer import ranking, tree
from heavebond.diagnosis.answer.physics import physics
from heavebond.diagnosis.answer.ranking import conclusion
from heavebond.diagnosis.answer.sentences import _curve_comparison, _fall, _undetermined
from heavebond.diagnosis.answer.tree import ANOTHER, STATED, Node, answer_tree
from heavebond.diagnosis.answer.verdict import without_effects
from heavebond.diagnosis.candidates.catalogue import Candidate, quantity
from heavebond.diagnosis.candidates.places import Places, candidates
from heavebond.diagnosis.evidence.flexible_laws import Adequacy
from heavebond.diagnosis.evidence.probability import CALIBRATION, TEMPERATURES, Event, Evidence
from heavebond.diagnosis.search.schedule import beyond_their_members
from heavebond.diagnosis.search.scoring import holding
from heavebond.estimation.experiment import load_experiment
from heavebond.estimation.fitting import Fitted
from heavebond.language.library import bundled, library

EXPERIMENT = load_experiment(bundled("models") / "passive_rig" / "friction.yaml")
LIBRARY = EXPERIMENT.model.library
FOUND = {c.label: c for c in candidates(EXPERIMENT)}
FRICTION, DAMPER = FOUND["CoulombFriction between platform and crown"], FOUND["Damper between platform and crown"]
OFFSET, LAG = FOUND["SensorOffset in the channel extension"], FOUND["FirstOrderLag in the channel extension"]
PLACES = Places.of(EXPERIMENT)


def _step(found: list[Candidate], partial: bool = False, planned: int = 0) -> Any:
    """A step with these candidates, the scores of which are equal, and no refits."""
    scores = tuple(SimpleNamespace(candidate=c, gain=1.0) for c in found)
    return SimpleNamespace(experiment=EXPERIMENT, scores=scores, trials=(), places=PLACES, partial=partial, planned=planned,
                           joint=(), twins={}, broken=())


def _evidence(weights: dict[str, float], left: float = 1.0, missing: float = 0.0) -> Evidence:
    events = tuple(Event(c.kind, 0.0, c.place, c.where, (c.label,)) for c in map(FOUND.__getitem__, weights))
    return Evidence(events, {t: np.array([*weights.values()]) for t in TEMPERATURES}, left, missing, 1.0)


def _sums(node: Node) -> None:
    """The children of every branch add up to it."""
    if node.children:
        assert sum(child.probability for child in node.children) == pytest.approx(node.probability, abs=1e-12)
    for child in node.children:
        _sums(child)


def test_the_branches_of_every_level_add_up_and_the_deepest_probable_one_is_stated() -> None:
    """Friction and a damper share place and kind: each class alone is below one half, the kind is not."""
    known = _evidence({FRICTION.label: 0.48, DAMPER.label: 0.46, OFFSET.label: 0.06})
    (effect,) = answer_tree([_step([FRICTION, DAMPER, OFFSET])], known, (), (), None, False).effects
    _sums(effect.root)
    assert [node.level for node in effect.path] == ["system", "place", "kind"]
    assert all(node.probability >= STATED for node in effect.path)
    odds = CALIBRATION.outside  # of a law outside the catalogue where one inside leaves noise
    among = (1 - CALIBRATION.lapse) / (1 + odds)
    assert effect.path[-1].probability == pytest.approx((among + among * odds) * 0.94)  # the outside law acts there too
    assert effect.statement.startswith("Something dissipates energy between platform and crown, with a force that depends "
                                       "on the speed (9")
    assert {child.name for child in effect.path[-1].children} == {"dry friction", "viscous damping",
                                                                  "a law outside the catalogue", ANOTHER}


def test_places_that_the_records_cannot_distinguish_are_stated_together_if_no_single_one_is_probable() -> None:
    """An offset of a sensor acts like an offset of the other one: each of both places has less than one half."""
    other = next(c for c in FOUND.values() if c.kind == "sensor offset" and c.label != OFFSET.label)
    step = _step([OFFSET, other, FRICTION])
    known = _evidence({OFFSET.label: 0.4, other.label: 0.4, FRICTION.label: 0.2})
    (apart,) = answer_tree([step], known, (), (), None, False).effects
    step.twins = {OFFSET.label: (other.label,)}
    (together,) = answer_tree([step], known, (), (), None, False).effects
    _sums(together.root)
    assert [node.level for node in apart.path][-1] == "system"
    assert together.path[1].name == f"{OFFSET.place} or {other.place}" and together.path[3].name == "sensor offset"
    assert together.path[1].probability == pytest.approx(2 * next(
        child.probability for node in apart.root.children for child in node.children if child.name == OFFSET.place))


def test_a_law_outside_the_catalogue_takes_the_class_and_not_the_place() -> None:
    """Where much is left, the law is not named; place, kind and the class of all effects there still are."""
    known = _evidence({FRICTION.label: 1.0}, left=1e6)
    (effect,) = answer_tree([_step([FRICTION])], known, (), (), None, False).effects
    outside = CALIBRATION.outside * exp(CALIBRATION.excess)
    assert outside / (1 + outside) > 0.8
    assert [node.level for node in effect.path] == ["system", "place", "kind", "class", "law"]
    assert "dry friction (98 %), probably with a law outside the catalogue (8" in effect.statement
    assert "CoulombFriction" not in effect.statement


def test_a_sensor_is_in_the_measuring_chain_and_so_is_the_lag_of_a_channel() -> None:
    known = _evidence({OFFSET.label: 0.5, LAG.label: 0.5})
    (effect,) = answer_tree([_step([OFFSET, LAG])], known, (), (), None, False).effects
    assert [node.name for node in effect.path] == ["measuring chain", "in the channel extension"]
    assert {node.name for node in effect.path[-1].children} >= {"shifts or scales a signal", "delays or distorts a "
                                                                "signal"}


def test_no_missing_effect_is_the_answer_where_the_residual_is_noise() -> None:
    (effect,) = answer_tree([_step([FRICTION])], _evidence({FRICTION.label: 1.0}, missing=1.0), (), (), None, False).effects
    share = CALIBRATION.simpler / (1 + CALIBRATION.simpler)  # of the prior odds, for the effect and for the data sheet
    assert effect.root.children[0].probability == pytest.approx((1 - CALIBRATION.lapse) * share**2)
    assert effect.statement == "No effect is missing (93 %)." and effect.meaning == ""


def test_no_law_that_explains_anything_is_stated_so() -> None:
    """The weights of the laws are 0: all of it is outside the catalogue, at no known place."""
    known = _evidence({FRICTION.label: 0.0, OFFSET.label: 0.0})
    (effect,) = answer_tree([_step([FRICTION, OFFSET])], known, (), (), None, False).effects
    _sums(effect.root)
    assert effect.path == () and effect.meaning == ""
    assert effect.statement == "No effect of the catalogue that was tried explains a noticeable part of the misfit."


def test_a_search_that_was_ended_early_has_the_same_tree_with_wider_probabilities() -> None:
    """Half of the candidates were refitted: the effects are half as probable, and the answer says so far."""
    known = _evidence({FRICTION.label: 1.0})
    whole = answer_tree([_step([FRICTION])], known, (), (), None, False)
    cut = answer_tree([_step([FRICTION], partial=True)], replace(known, untried=0.5), (), (), None, True)
    _sums(cut.effects[0].root)
    classes = [tree.effects[0].root.children[0].children[0].children[0].children[0] for tree in (whole, cut)]
    assert classes[0].children[0].probability == pytest.approx(2 * classes[1].children[0].probability)
    assert cut.words[0].startswith("No conclusion yet; by the scores so far")
    assert replace(cut, fitted=True).words[0].startswith("So far: ") and set(cut.as_dict()) == set(whole.as_dict())
    assert answer_tree([], None, (), (), None, True).words[0].startswith("So far no level")
    # another law of the class there has a third of the score and no refit, and two candidates have no score: the class keeps
    # its probability, the law does not
    step = _step([FRICTION, FOUND["StribeckFriction between platform and crown"]], partial=True)
    step.scores[0].gain, step.excluded, step.broken = 2.0, {}, ("broken",)
    step.planned = 5  # two of four were scored
    step.trials = (SimpleNamespace(candidate=FRICTION, errors=1.0, values={FRICTION.numbers[0].name: 8000.0}),)
    open_ = answer_tree([step], known, (), (), None, True).effects[0].root
    _sums(open_)
    klass, before = (root.children[0].children[0].children[0].children[0] for root in (open_, whole.effects[0].root))
    assert klass.probability == pytest.approx(before.probability)
    law = next(child for child in klass.children if child.name == "CoulombFriction")
    assert law.probability == pytest.approx(2 / 3 / 2 * next(c.probability for c in before.children if c.name == law.name))


def test_scores_alone_give_the_place_before_the_first_refit() -> None:
    """Two candidates of one place were scored, with three quarters of the scores, and half of the catalogue."""
    step = _step([FRICTION, DAMPER, OFFSET], partial=True, planned=6)
    for score, gain in zip(step.scores, (50.0, 25.0, 25.0), strict=True):
        score.gain = gain
    (effect,) = answer_tree([step], Evidence((), {}, 1.0, 0.0, 1.0), (), (), None, True).effects
    _sums(effect.root)
    among = (1 - CALIBRATION.lapse) / (1 + CALIBRATION.outside)
    machine = next(node for node in effect.root.children if node.name == "machine")
    effects = 0.75 * 0.5 * among  # beside a law outside the catalogue, which acts where the scores are
    assert machine.probability == pytest.approx(effects + 0.75 * among * CALIBRATION.outside)
    assert effect.statement.startswith("The records do not decide what is missing: machine")


def _suspect(nodes: tuple[str, ...], behind: float, kind: str, explained: float = 0.9) -> Any:
    domain = LIBRARY.domains["translational"]
    place = SimpleNamespace(name="-".join(nodes), words="between " + " and ".join(nodes), nodes=tuple(
        SimpleNamespace(name=n, domain=domain, mechanical=True, through="f") for n in nodes))
    curve = SimpleNamespace(r2=0.9, variable=SimpleNamespace(kind=kind))
    return SimpleNamespace(place=place, behind=behind, explained=explained, alike=(), curve=curve)


def test_the_unknown_input_says_where_a_law_outside_the_catalogue_acts() -> None:
    """The catalogue has nothing but friction; the input follows the position at another place."""
    local: Any = SimpleNamespace(missing=True, suspects=[_suspect(("crown", "seabed"), 0.0, "position"),
                                                         _suspect(("platform", "crown"), 1000.0, "across")])
    (effect,) = answer_tree([_step([FRICTION])], _evidence({FRICTION.label: 1.0}, left=1e6), (), (), local, False).effects
    _sums(effect.root)
    assert effect.path[1].name == "between crown and seabed"
    assert "exerts a force that depends on the displacement between crown and seabed" in effect.statement
    outside = CALIBRATION.outside * exp(CALIBRATION.excess * (1 - 1e-6))
    share = (1 - CALIBRATION.lapse) * outside / (1 + outside)
    assert effect.path[1].probability == pytest.approx(0.9 * 0.9 * share, rel=1e-6)  # explained, predicted


def test_an_unknown_input_keeps_what_its_variable_predicts_and_shares_it_with_the_inputs_before_its_node() -> None:
    """The vessel moves the platform by an input, which may be wrong as well; the force at the crown follows no variable."""
    command = next(c for c in FOUND.values() if c.attaches == "input")
    platform, crown = _suspect(("platform",), 0.0, "across", explained=0.8), _suspect(("crown",), 0.0, "across")
    crown.curve = None
    located: Any = SimpleNamespace(missing=True, suspects=[platform, crown])
    at_platform, before_vessel, at_crown = tree._localized(_step([FRICTION, command]), located, 1.0, 16.0)
    # half of the likelihood; explained; predicted; shared by node and input
    assert at_platform.probability == pytest.approx(0.5 * 0.9 * 0.9 / 2) == before_vessel.probability
    assert before_vessel.names[:2] == ("machine", "before vessel.u") and at_platform.names[1] == "between platform"
    assert at_crown.probability == 0.0


def _fitted(name: str, unit: str, value: float, low: float, high: float, range_: tuple[float, float] = (0.0, 1e9)) -> Fitted:
    return Fitted(name, unit, 0.0, value, *range_, (low, high), "")


def test_a_sentence_of_physics_has_values_with_units_and_as_many_digits_as_are_determined() -> None:
    name = FRICTION.numbers[0].name
    exact = physics(FRICTION, LIBRARY, {name: 8213.0}, [_fitted(name, "N", 8213.0, 8121.0, 8305.0)])
    assert exact == "Dry friction of 8.2 kN (8.1 to 8.3) between platform and crown."
    open_end = physics(FRICTION, LIBRARY, {name: 8213.0}, [_fitted(name, "N", 8213.0, 8121.0, 1e4, (0.0, 1e4))])
    assert open_end == "Dry friction of 8.21 kN (above 8.12) between platform and crown."
    assert physics(FRICTION, LIBRARY, {name: 8213.0}) == "Dry friction of 8.21 kN between platform and crown."


def test_a_quotient_in_a_sentence_has_the_interval_of_its_parameter_and_a_percent_sign_before_it() -> None:
    """100*(1 - r) falls with r: the ends of the interval change places."""
    damper = FOUND["NonlinearDamper in place of damper"]
    names = {n.name.rpartition(".")[2]: n for n in damper.numbers}
    values = {names["r"].name: 0.64, names["k"].name: 0.0, names["v_k"].name: 0.1}
    said = physics(damper, LIBRARY, values, [_fitted(names["r"].name, "1", 0.64, 0.62, 0.67, (-20.0, 1.0))])
    assert said.startswith("In compression the damper transmits 36 % (33 to 38) of its force in extension")


@pytest.mark.parametrize("label", [*FOUND])
def test_every_candidate_of_a_diagram_has_a_sentence_without_a_field(label: str) -> None:
    """Some numbers are held at a value that the motion gives, and are no numbers of the candidate from then on."""
    held = {n.name: quantity(2.0, n.unit) for n in FOUND[label].numbers if n.sought is not None and n.sought.held}
    candidate = holding(FOUND[label], held)
    said = physics(candidate, LIBRARY, {**dict.fromkeys(held, 2.0), **{n.name: 0.25 for n in candidate.numbers}})
    assert "{" not in said and "nan" not in said and "$" not in said and said.endswith(".")


# -- tables and texts agree ----------------------------------------------------------------------------------------------
def _trial(label: str, bic: float, held: float, share: float = 1.0) -> Any:
    errors = SimpleNamespace(mean=lambda *_: held, samples=lambda *_: 1000)
    return SimpleNamespace(candidate=FOUND[label], bic=bic, chi2_held_out=held, chi2_fit=held, beyond=(), errors=errors,
                           cost=1000 * held, samples=1000, unknowns=1, samples_held_out=1000)


def _judged_step(trials: list[Any], held: float, partial: bool = False) -> Any:
    errors = SimpleNamespace(mean=lambda *_: held, samples=lambda *_: 1000)
    return SimpleNamespace(trials=trials, joint=(), cluster=(), chosen=None, bic=0.0, chi2_held_out=held,
                           samples_held_out=1000, errors=errors, merit=1e9, shown_held_out=True, partial=partial,
                           chi2_fit=held)


def test_a_table_does_not_say_by_chance_beside_strong_evidence(monkeypatch: pytest.MonkeyPatch) -> None:
    """A candidate with a BIC change of -522 that is not in the answer is there with the reason."""
    worse = conclusion(_judged_step([_trial(FRICTION.label, -522.0, 60.0)], 50.0))
    assert worse == f"none is in the answer; {FRICTION.label}: larger error on held-out data"
    monkeypatch.setattr(ranking, "is_noticeable", lambda step, trial: False)
    little = conclusion(_judged_step([_trial(FRICTION.label, -522.0, 48.0)], 50.0))
    assert little == f"none is in the answer; {FRICTION.label}: takes away less than 20 % of the misfit of its step"
    assert conclusion(_judged_step([_trial(FRICTION.label, -2.0, 49.9)], 50.0)) == "none is better than by chance"
    ended = conclusion(_judged_step([_trial(FRICTION.label, -522.0, 20.0)], 50.0, partial=True))
    assert ended == f"none is in the answer; {FRICTION.label}: not decided before the search ended"


def test_a_curve_that_leaves_much_more_does_not_predict_as_well() -> None:
    """26883 beside 1924."""
    law = _trial(FRICTION.label, 0.0, 1924.0)
    more = _curve_comparison(Adequacy(0.9, elsewhere=_trial(DAMPER.label, 0.0, 26883.0), law=law))[-1]
    assert "predicts as well" not in more and "leaves more" in more and "26883" in more and "1924" in more
    alike = Adequacy(0.9, elsewhere=_trial(DAMPER.label, 0.0, 1930.0), law=law)
    assert "predicts as well" in _curve_comparison(alike)[-1]


def _entry(name: str, held: float, error: float) -> Any:
    parts = [SimpleNamespace(use="validate", channels={"x": SimpleNamespace(
        unit="m", error=error, noise=1e-3, counts=np.ones(10))})]
    return SimpleNamespace(name=name, chi2_held_out=held, chi2_fit=held, error_held_out=error, error_fit=error,
                           comparison=SimpleNamespace(parts=parts))


def test_the_error_without_an_effect_is_that_of_the_fitted_model() -> None:
    """What the fit of the parameters takes away is no effect: the error rises from 2 to 3, whatever the data sheet left."""
    sheet, fitted, last = _entry("sheet", 900.0, 0.09), _entry("fitted", 2.0, 0.02), _entry("+ effect", 3.0, 0.03)
    finding: Any = SimpleNamespace(rung=last)
    assert without_effects([sheet, fitted, last], [finding]) is fitted
    assert without_effects([sheet, last], [finding]) is sheet
    said = _fall(without_effects([sheet, fitted, last], [finding]), last, False)
    assert "rises" in said and "20 mm to 30 mm" in said and "900" not in said


def test_a_search_that_was_ended_early_with_a_leader_far_ahead_names_it() -> None:
    step = _judged_step([_trial(FRICTION.label, -75369.0, 1.01), _trial(LAG.label, -2273.0, 3556.0)], 3998.0, partial=True)
    step.left = SimpleNamespace(significant=True)
    said = _undetermined([], [], [step])
    assert "No conclusion" not in said
    assert said == ("The search was ended early. Best so far: dry friction between platform and crown (CoulombFriction), "
                    "which explains more than 99 % of the misfit; of the others lag in the channel extension "
                    "(FirstOrderLag) explains 11 %.")
    weak = _judged_step([_trial(LAG.label, -2273.0, 3556.0)], 3998.0, partial=True)
    assert _undetermined([], [], [weak]) == "No conclusion yet: the search was ended early."


def test_a_law_at_several_places_that_is_dropped_on_purpose_was_simulated() -> None:
    """`broken` holds what has no score at all; a law at like places with a score below those of its members has one."""
    single = [SimpleNamespace(candidate=c, gain=10.0) for c in (FRICTION, DAMPER)]
    joined = SimpleNamespace(candidate=replace(FRICTION, place="at both", members=(FRICTION.label, DAMPER.label)), gain=1.0)
    scores: Any = [*single, joined]
    assert beyond_their_members(scores, {}) == single




@pytest.mark.parametrize("noticeable", [True, False])
def test_a_law_elsewhere_is_described_only_if_it_explains_a_noticeable_part(noticeable: bool, monkeypatch: pytest.MonkeyPatch
                                                                            ) -> None:
    """The stated branch has no law of the catalogue; the refit of the offset may explain nothing at all."""
    outside, elsewhere = Node("system", "machine", 0.8), Node("system", OFFSET.kind, 0.2, labels=(OFFSET.label,))
    step: Any = SimpleNamespace(trials=[SimpleNamespace(candidate=OFFSET)])
    monkeypatch.setattr(tree, "is_noticeable", lambda step, trial: noticeable)
    best = tree._best(step, None, (outside,), Node("", "", 1.0, (outside, elsewhere)))
    assert (best is not None) is noticeable


def test_the_kind_of_a_law_on_a_body_names_none_of_its_several_forces() -> None:
    domains = library().domains
    assert tree.kind_words("rate", domains["planar"], True) == "dissipates energy"
    assert tree.kind_words("rate", domains["rotational"], True) == \
        "dissipates energy, with a torque that depends on the angular speed"
