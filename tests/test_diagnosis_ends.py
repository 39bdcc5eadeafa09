"""What stands at an end of its range, and what the first effect may be once another one stands beside it."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from diagrams import CART_RIG

from heavebond.core.cancellation import Budget
from heavebond.diagnosis import phases
from heavebond.diagnosis.answer import sentences, verdict
from heavebond.diagnosis.attempt import attempt
from heavebond.diagnosis.candidates.catalogue import single_candidates
from heavebond.diagnosis.candidates.places import Places, candidates
from heavebond.diagnosis.diagnose import diagnose
from heavebond.diagnosis.evidence import flexible_laws
from heavebond.diagnosis.evidence.flexible_laws import Adequacy, Comparand, adequacy
from heavebond.diagnosis.evidence.prediction import PredictiveErrors
from heavebond.diagnosis.evidence.residual_tests import ResidualTests
from heavebond.diagnosis.search.step import Stage, following, make_stage, refitted_beside, single
from heavebond.diagnosis.state import AddedEffect
from heavebond.estimation.experiment import Experiment, load_experiment
from heavebond.language.model import load
from heavebond.numerics.simulation import simulate

pytestmark = pytest.mark.long

BRAKE = """
component: EddyBrake
summary: A metal plate that moves through the field of a magnet.
source: Force over speed with a maximum at a characteristic speed, as textbooks of electrical machines give it.
symbol: damper
ports: {a: translational, b: translational}
parameters:
  F_m: {unit: N, min: 0, doc: largest force}
  v_c: {unit: m/s, min: 1e-6 m/s, doc: speed at which it is reached}
variables:
  v: {unit: m/s, doc: speed of b relative to a}
  F: {unit: N, doc: force against the motion}
equations: |
  v   = b.v - a.v
  F   = F_m * 2 * (v/v_c) / (1 + (v/v_c)**2)
  b.f = F
  a.f = -F
dissipates: F * v
effect: {class: eddy currents, description: a metal plate in the field of a magnet, attaches: across, amplitude: [F_m],
         search_range: {v_c: RANGE}}
"""
MEASURED = """
experiment: the cart on its rail
model: rig.yaml
records: {monday: {file: monday.csv, use: fit}}
time: {column: "time [s]", unit: s}
inputs: {foot.u: {column: "foot [m]", unit: m, interpolation: spline}}
outputs: {load.x: {column: "cart [m]", unit: m, noise: 0.5 mm}}
free: {spring.c: 60 N/m +- 20 %, damper.d: 3 N*s/m +- 20 %}
"""


def measured(folder: Path, part: str, ends: tuple[str, str, str], offset: float = 0.0) -> Experiment:
    """A record of 12 s of the cart with a part more, at these nodes (base, load, rail); what measures the foot is off."""
    text = CART_RIG.replace("nodes:", f"  more: {part}\nnodes:")
    for node, end in zip(("base: [", "load: [", "rail: ["), ends, strict=True):
        text = text.replace(node, node + (f"more.{end}, " if end else ""))
    (folder / "machine.yaml").write_text(text)
    (folder / "rig.yaml").write_text(CART_RIG)
    run = simulate(load(folder / "machine.yaml"), until=12, every=0.04)
    cart = run["load.x"] + 5e-4 * np.random.default_rng(1).standard_normal(len(run.time))
    np.savetxt(folder / "monday.csv", np.column_stack([run.time, run["base.x"] + offset, cart]), "%.9g", ",",
               header="time [s],foot [m],cart [m]", comments="")
    (folder / "measured.yaml").write_text(MEASURED)
    return load_experiment(folder / "measured.yaml")


@pytest.mark.parametrize(("sought", "beyond"), [("5 .. 30 mm/s", ("eddy_brake.v_c",)), ("0.02 .. 2 m/s", ())])
def test_a_range_that_ends_before_the_truth_is_told_and_names_nothing_for_sure(
        tmp_path: Path, sought: str, beyond: tuple[str, ...]) -> None:
    (tmp_path / "components").mkdir()
    (tmp_path / "components" / "eddy_brake.yaml").write_text(BRAKE.replace("RANGE", sought))
    given = measured(tmp_path, "{is: EddyBrake, F_m: 2 N, v_c: 0.1 m/s}", ("", "b", "a"))
    brake = next(c for c in single_candidates(given) if c.component == "EddyBrake" and set(c.where) == {"rail", "load"})
    (trial,) = single(given, brake, lambda text: None).trials
    assert trial.beyond == beyond
    rung: Any = SimpleNamespace(chi2_fit=1.0, chi2_held_out=1.0, samples_held_out=300,
                                comparison=SimpleNamespace(experiment=given))
    finding = AddedEffect(brake, (), rung, None, (trial,))
    assert verdict.is_adequate([rung, rung], [finding]) is not bool(beyond)
    assert ("widen `search_range`" in " ".join(sentences.at_ends(finding))) is bool(beyond)


def test_a_sensor_that_is_noisier_in_a_record_is_no_missing_effect(tmp_path: Path) -> None:
    """The noise is estimated from all records as one. What is left on the noisier one is white: the answer says what to
    write, and then nothing is missing."""
    measured(tmp_path, "{is: Damper, d: 0 N*s/m}", ("", "b", "a"))
    rows = np.loadtxt(tmp_path / "monday.csv", delimiter=",", skiprows=1)
    rows[:, 2] += 1.5e-3 * np.random.default_rng(2).standard_normal(len(rows))
    np.savetxt(tmp_path / "tuesday.csv", rows, "%.9g", ",", header="time [s],foot [m],cart [m]", comments="")
    both = MEASURED.replace("use: fit}", "use: fit}, tuesday: {file: tuesday.csv, use: validate}")

    def answer(noise: str) -> Any:
        (tmp_path / "measured.yaml").write_text(both.replace(", noise: 0.5 mm", noise))
        return diagnose(tmp_path / "measured.yaml", classes=["dry friction"], number=1)

    said = answer("")
    assert said.verdict == "undetermined"
    written = re.search(r"nothing is missing: write `(noise: [0-9.]+ mm)` at load.x\.", said.words[0])
    assert written is not None
    assert answer(f", {written[1]}").verdict == "nothing"


def test_a_limit_of_the_parameter_is_a_value_like_any_other(tmp_path: Path) -> None:
    """Directional friction that acts one way only: the other number is 0, and nothing more of its kind is to be sought."""
    given = measured(tmp_path, "{is: DirectionalFriction, F_p: 0.8 N, F_n: 0 N}", ("", "b", "a"))
    finding = attempt(given, "DirectionalFriction", ["rail", "load"]).finding
    assert finding.beyond == () and [p.name for p in finding.at_limits] == ["directional_friction.F_n"]
    (line,) = sentences.at_ends(finding)
    assert line.startswith("directional_friction.F_n = 0 N: ") and "more of its kind" not in line


def test_an_effect_that_does_not_show_is_not_said_to_be_there() -> None:
    """Its interval covers its whole range, as that of an effect does whose size the records do not tell."""
    finding: Any = SimpleNamespace(at_limits=(), parameters=(), beyond=(), undetermined=("brake.F_m",))
    assert sentences.at_ends(finding)[0].startswith("The records show that the effect is there but not how large it is")
    (line,) = sentences.at_ends(finding, is_shown=False)
    assert line == "The records do not show how large the effect is: brake.F_m may lie anywhere in the range."


def test_only_rivals_that_explain_as_much_as_the_answer_are_not_excluded() -> None:
    """Three candidates whose search stopped at an end of a range: one as good as the answer but for 3 % of the misfit, one
    that leaves twice as much as the answer, one that explains half."""
    def trial(name: str, chi2: float, beyond: tuple[str, ...] = ("law.k",)) -> Any:
        number = SimpleNamespace(name="law.k", unit=SimpleNamespace(text="m"))
        candidate = SimpleNamespace(label=name, kind=name, where=("base", name), attaches="across", place=f"at {name}",
                                    component="Law", numbers=(number,))
        return SimpleNamespace(candidate=candidate, chi2_fit=chi2, beyond=beyond, values={"law.k": 5e-6})

    answer = trial("play", 8.0, ())
    trials = (answer, trial("compliance", 11.0), trial("friction", 20.0), trial("damping", 50.0))
    finding: Any = SimpleNamespace(candidate=answer.candidate, alternatives=(answer,),
                                   rung=SimpleNamespace(chi2_fit=8.0, chi2_held_out=9.0))
    step: Any = SimpleNamespace(chi2_fit=101.0, trials=trials)
    (line,) = sentences._not_excluded([finding], [step])
    assert line == "The search for compliance at compliance (Law), which is not excluded, stopped at the end of a range " \
                   "(law.k at 5 um), beyond which its residual would be smaller: widen `search_range` in a copy of the " \
                   "component file beside the diagram."


def test_what_the_first_effect_may_be_is_judged_beside_a_sensor_s_offset(tmp_path: Path) -> None:
    """A hardening spring, and a foot that is measured 20 mm off. Alone no law reaches the noise, and stops of a travel do
    nearly as well as the spring; beside the offset the spring leaves noise and the stops do not, wherever the search for
    these ended there."""
    given = measured(tmp_path, "{is: CubicSpring, c_3: 8000 N/m**3, l0: 0 m}", ("a", "b", ""), offset=0.02)
    between = {(c.component, c.place): c for c in single_candidates(given)}
    spring, stop = (_only(given, between[law, "between base and load"]) for law in ("CubicSpring", "EndStop"))
    offset = between["SensorOffset", "before foot.u"]
    assert min(t.chi2_fit for t in (*spring.trials, *stop.trials)) > 10
    both = single(following(spring), offset, lambda text: None).trials[0]
    assert both.chi2_fit < 1.3
    beside = following(_only(given, offset))
    stuck = replace(make_stage(beside, number=1, classes=["end stop"]), trials=())  # as if no refit had found its way
    exact = replace(both, candidate=between["CubicSpring", "between base and load"])
    made = refitted_beside(stuck, stop.trials, exact)
    assert [t.candidate.component for t in made.trials] == ["CubicSpring", "EndStop"]
    assert made.trials[1].chi2_fit < stop.trials[0].chi2_fit
    assert [t.candidate.component for t in made.cluster] == ["CubicSpring"]


def test_a_curve_is_no_better_law_for_taking_up_a_second_effect(monkeypatch: pytest.MonkeyPatch) -> None:
    """A curve of nine coefficients takes up the offset of an input, which the law that is right cannot: alone the law leaves
    30 and the curve 3. Beside the offset both leave 2, and the law stands. Where further effects were not sought, the curves
    decide nothing. One that is better beside the offset as well takes the name."""
    def refit(level: float, seed: int) -> Any:
        sums = level * np.random.default_rng(seed).uniform(0.5, 1.5, 400)
        errors = PredictiveErrors(sums, np.ones(400), np.zeros(400, np.int64), np.zeros(400, np.int64))
        candidate = SimpleNamespace(where=("base", "load"), change=SimpleNamespace(nodes={}), label=str(level))
        return _Refit(candidate, errors)

    law, offset = refit(30.0, 1), refit(2.0, 2)
    first: Any = SimpleNamespace(chosen=law, candidate=law.candidate, alternatives=(law,),
                                 step=SimpleNamespace(errors=refit(300.0, 3).errors, experiment="base"))
    last: Any = SimpleNamespace(chosen=offset, candidate=offset.candidate)
    others: Any = (SimpleNamespace(chosen=refit(250.0, 4), step="offset"),)
    curves = {"base": 3.0, "base, offset": 2.0}
    monkeypatch.setattr(flexible_laws, "without_effect", lambda way, k, say: others)
    monkeypatch.setattr(flexible_laws, "following", lambda step: "base, offset")
    monkeypatch.setattr(flexible_laws, "make_curve_stage", lambda experiment, **given: SimpleNamespace(
        trials=(refit(curves[experiment], 5),), partial=False, places=_PLACES))
    monkeypatch.setattr("heavebond.diagnosis.evidence.flexible_laws.coverage", lambda curve, before: 1.0)

    def found(way: Any, tried: bool = True) -> Any:
        return flexible_laws.judged(way, True, tried, 1, 1e9, lambda text: None)[0]

    assert found((first,)).beaten and not found((first,)).stands
    assert found((first, last)).stands and not found((first, last)).beaten
    assert found((first,)).explained == pytest.approx(0.9, abs=0.01)  # 300 to 30
    assert found((first, last)).explained == pytest.approx(0.997, abs=0.001)  # together, 300 to 2
    assert found((first,), tried=False).stands and not found((first,), tried=False).tried
    curves["base, offset"] = 1.2
    assert found((first, last)).beaten


def test_a_curve_at_another_place_takes_the_name_where_it_explains_most_of_what_that_leaves(
        monkeypatch: pytest.MonkeyPatch) -> None:
    """A circuit with a diode: a saturation of the channel leaves 40 of 500, its curve there 30. A curve between other nodes
    that leaves 35 makes the place uncertain, one that leaves 4 is the answer; and where two effects leave 8 together, the
    curve alone takes their place if it leaves less."""
    def refit(level: float, where: str) -> Any:
        sums = level * np.random.default_rng(3).uniform(0.5, 1.5, 400)
        errors = PredictiveErrors(sums, np.ones(400), np.zeros(400, np.int64), np.zeros(400, np.int64))
        return _Refit(SimpleNamespace(where=(where,), change=SimpleNamespace(nodes={}), label=where), errors)

    law = refit(40.0, "channel")
    first: Any = SimpleNamespace(chosen=law, candidate=law.candidate, alternatives=(law,), step=SimpleNamespace(
        errors=refit(500.0, "").errors, experiment="base"))
    left = {"channel": 30.0, "out": 35.0}
    monkeypatch.setattr(flexible_laws, "make_curve_stage", lambda experiment, **given: SimpleNamespace(
        trials=tuple(refit(level, where) for where, level in left.items()), partial=False, places=_PLACES))
    monkeypatch.setattr("heavebond.diagnosis.evidence.flexible_laws.coverage", lambda curve, before: covered)

    def found() -> Any:
        return flexible_laws.judged((first,), True, True, 1, 1e9, lambda text: None)[0]

    covered = 1.0
    assert found().stands and found().elsewhere.candidate.label == "out"
    left["out"] = 4.0
    assert found().beaten and found().flexible.candidate.label == "out" and found().elsewhere is None
    covered = 0.5  # it was fitted to another motion than that on which it is judged
    assert not found().beaten

    for together, alone in ((8.0, "out"), (3.0, None)):
        last: Any = SimpleNamespace(chosen=refit(together, "feed"))
        curve, stage = flexible_laws.curve_alone((first, last), 1, 1e9, lambda text: None)
        assert stage is not None and (curve.candidate.label if curve is not None else None) == alone


@pytest.mark.parametrize("leaves_less", [False, True])
def test_a_curve_takes_no_name_where_it_leaves_more_than_effects_of_which_the_last_is_not_named(
        monkeypatch: pytest.MonkeyPatch, leaves_less: bool) -> None:
    """A valve with overlap whose command has an offset: the offset leaves 64 of 2600, both 1.1, which is too small a share
    for a second name; a curve before the valve leaves 13."""
    offset, overlap = (SimpleNamespace(candidate=SimpleNamespace(label=name), chosen=name) for name in ("offset", "overlap"))
    curve, curves = SimpleNamespace(candidate="curve"), SimpleNamespace(partial=False)
    beaten = Adequacy(0.97, flexible=cast(Any, curve), beaten=True, covered=1.0)
    monkeypatch.setattr(phases, "judged", lambda *given: (beaten, curves))
    monkeypatch.setattr(phases, "adequacy_alone", lambda *given: Adequacy(0.97))
    monkeypatch.setattr(phases, "better", lambda one, other: other == "overlap" and leaves_less)
    monkeypatch.setattr(phases, "choosing", lambda curves, curve: curves)
    monkeypatch.setattr(phases, "SelectedEffect", lambda *given: given)
    step = Stage(cast(Any, None), {}, 0.0, 1, 1.0, 1.0, 1, (), ResidualTests(0, 0, 0, 9), (), (), None, (), {}, (), False,
                 0.0)
    models = (cast(Any, SimpleNamespace(comparison=None)),) * 4
    confirming = cast(Any, SimpleNamespace(one=lambda *given: "shape"))
    task = phases.Task(Budget(float("inf")), 1, 1, (), None, lambda text: None, lambda models: None)

    def named(whole: tuple[Any, ...]) -> tuple[Any, Any]:
        state = phases.State(cast(Any, None), cast(Any, None), models=models, selection=cast(Any, whole),
                             doubtful=cast(Any, whole[1:]), findings=(cast(Any, offset),), steps=(step,),
                             confirming=confirming)
        *_, state = phases._without_name(state, task, 1e9)
        return state.shape, state.adequacy

    shape, found = named((offset, overlap))
    assert shape == ("shape" if leaves_less else None) and found.stands is not leaves_less
    assert named((offset,))[0] == "shape"


def test_a_curve_between_the_nodes_of_a_part_stands_where_a_law_in_place_of_it_does(monkeypatch: pytest.MonkeyPatch) -> None:
    """Such a curve is the yardstick of the law, and no doubt of its place."""
    experiment = load_experiment("passive_rig/friction")
    found = {c.label: c for c in candidates(experiment)}
    law = next(c for label, c in found.items() if c.component == "NonlinearDamper" and c.attaches == "replaces")

    def refit(candidate: Any, level: float) -> Any:
        sums = level * np.random.default_rng(3).uniform(0.5, 1.5, 400)
        return _Refit(candidate, PredictiveErrors(sums, np.ones(400), np.zeros(400, np.int64), np.zeros(400, np.int64)))

    curve = next(c for c in found.values() if c.component == "ForceCurveOfSpeed" and Places.of(experiment).place(c)
                 == Places.of(experiment).place(law))
    named, before = refit(law, 40.0), refit(law, 500.0).errors
    monkeypatch.setattr("heavebond.diagnosis.evidence.flexible_laws.coverage", lambda curve, before: 1.0)
    stage: Any = SimpleNamespace(errors=before)
    curves: Any = SimpleNamespace(trials=(refit(curve, 35.0),), partial=False, places=Places.of(experiment))
    judged = adequacy(named, stage, Comparand(named, before, experiment), curves)
    assert judged.flexible is not None and judged.flexible.candidate is curve and judged.elsewhere is None


_PLACES = SimpleNamespace(place=lambda candidate: candidate.where)


@dataclass(frozen=True)
class _Refit:
    candidate: Any
    errors: PredictiveErrors


def _only(experiment: Experiment, candidate: Any) -> Stage:
    """A step with one candidate, chosen."""
    made = single(experiment, candidate, lambda text: None)
    return replace(made, chosen=made.trials[0], cluster=made.trials)
