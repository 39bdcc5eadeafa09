"""Each word of a verdict on a short record with something hidden in it, and the bundled records with a hidden effect."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from diagrams import CART_RIG

from benchmarks.diagnosis.making import Hidden
from benchmarks.diagnosis.rigs import RIGS
from benchmarks.diagnosis.truths import TRUTHS
from heavebond.cli import main
from heavebond.diagnosis.answer.confirm import at_fit
from heavebond.diagnosis.answer.ranking import BY_KEY, COLUMNS, JUDGEMENTS, as_dicts, entries
from heavebond.diagnosis.attempt import attempt
from heavebond.diagnosis.candidates.fixed_values import fixed_values
from heavebond.diagnosis.decision import DECISION
from heavebond.diagnosis.diagnose import Diagnosis, diagnose
from heavebond.diagnosis.evidence import comparison, residual_tests
from heavebond.diagnosis.evidence.flexible_laws import OTHER_CAUSES, Remainder
from heavebond.diagnosis.evidence.probability import probabilities
from heavebond.diagnosis.search import schedule, step
from heavebond.diagnosis.search.refit import Refit
from heavebond.diagnosis.state import ladder_entry
from heavebond.estimation.comparison import compare
from heavebond.estimation.experiment import Experiment, load_experiment
from heavebond.estimation.fitting import Fitted, fit
from heavebond.experiment_design.separation import AdditionalSensor
from heavebond.language.model import load, loads
from heavebond.localise.curves import Curve, Variable
from heavebond.numerics.simulation import simulate
from heavebond.reports.report import report
from heavebond.text.syntax import Binary

pytestmark = pytest.mark.long

NAMES = {"parameters", "noise", "limits"}  # what holds entries by names that are not keys
PAGE = Path(__file__).parents[1] / "docs" / "diagnosis_method.md"
MEASURED = """
experiment: the cart on its rail
model: rig.yaml
records: {monday: {file: monday.csv, use: fit}}
time: {column: "time [s]", unit: s}
inputs: {foot.u: {column: "foot.u [m]", unit: m, interpolation: spline}}
outputs: {load.x: {column: "load.x [m]", unit: m, noise: 0.5 mm}}
free: {spring.c: 60 N/m +- 10 %}
"""
KNOWN = {(rig, truth.name): truth for rig, truths in TRUTHS.items() for truth in truths}


def found(folder: Path, rig: str, hidden: Sequence[tuple[str, float]], classes: Sequence[str], *, scale: float = 1.0,
          share: float = 0.0, seconds: float = 60.0) -> Diagnosis:
    """What is said of a record in which the effects stand with these amplitudes; the same noise each time."""
    short = replace(RIGS[rig], seconds=seconds)
    machine = Hidden(short, [KNOWN[rig, name] for name, _ in hidden], "test", folder, scale, share)
    return diagnose(machine.case([size for _, size in hidden]).experiment, classes=classes, number=1)


@pytest.fixture(scope="module")
def leak_or_offset(tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    """A leak past the valve, among two classes that act alike."""
    return found(tmp_path_factory.mktemp("leaking"), "receiver", [("leak in", 4e-10)], ["leakage", "sensor offset"])


def test_noise_alone_is_nothing(tmp_path: Path) -> None:
    said = found(tmp_path, "receiver", [], ["leakage", "choked flow"])
    assert said.verdict == "nothing"
    assert not said.findings
    assert said.ladder[-1].chi2_held_out == pytest.approx(1, abs=0.15)   # 601 samples: 1 +- 0.06


def test_wrong_values_are_parameters(tmp_path: Path) -> None:
    said = found(tmp_path, "receiver", [], ["leakage", "choked flow"], share=0.9)
    assert said.verdict == "parameters"
    assert said.ladder[0].chi2_held_out > 10 > 1.2 > said.ladder[1].chi2_held_out


@pytest.fixture
def too_heavy(tmp_path: Path) -> Experiment:
    """A record of the cart, and a diagram in which it weighs 4 kg; its mass is not free."""
    model = loads(CART_RIG)
    (tmp_path / "rig.yaml").write_text(CART_RIG.replace("2.5 kg", "4 kg"))
    run = simulate(model, until=12, every=0.04)
    measured = run["load.x"] + 5e-4 * np.random.default_rng(1).standard_normal(len(run.time))
    columns = {"time [s]": run.time, "foot.u [m]": run["base.x"], "load.x [m]": measured}
    np.savetxt(tmp_path / "monday.csv", np.column_stack(list(columns.values())), "%.9g", ",", header=",".join(columns),
               comments="")
    (tmp_path / "rig_monday.yaml").write_text(MEASURED)
    return load_experiment(tmp_path / "rig_monday.yaml")


def test_a_wrong_value_that_is_held_fixed_is_told_where_no_effect_explains(too_heavy: Experiment) -> None:
    said = diagnose(too_heavy, classes=["dry friction", "value of a parameter"], number=1)
    assert said.verdict == "parameters"
    (finding,) = said.findings
    assert finding.candidate.name == "cart.m"
    low, high = finding.parameters[0].interval
    assert low < 2.5 < high
    assert "cart.m at 2.5" in said.words[0] and "(in the diagram 4 kg)" in said.words[0]
    assert said.ladder[-1].chi2_held_out < 1.2 < 10 < said.ladder[1].chi2_held_out


def test_a_search_that_is_ended_among_values_begins_nothing_more(too_heavy: Experiment) -> None:
    def say(text: str) -> None:
        assert "learning" not in text
        if text.startswith("trying other values") and "scoring 1 " in text:
            raise KeyboardInterrupt

    said = diagnose(too_heavy, classes=["quadratic damping", "value of a parameter"], number=1, progress=say)
    assert (said.verdict, said.shape) == ("undetermined", None)


def test_a_value_is_tried_by_hand_by_its_name(too_heavy: Experiment) -> None:
    tried = attempt(too_heavy, "cart.m")
    assert tried.earned and tried.finding.parameters[0].value == pytest.approx(2.5, rel=0.01)
    # `Mass` is the effect that has the name, an added mass, and not the mass that is there
    assert attempt(too_heavy, "Mass", ["load"]).finding.candidate.kind == "added mass"


def test_what_may_be_wrong_is_what_a_diagram_gives(too_heavy: Experiment) -> None:
    # not what is free, sleeps or is zero
    assert [c.name for c in fixed_values(too_heavy)] == ["damper.d", "cart.m"]


def test_an_effect_is_named_with_its_place_and_size(tmp_path: Path) -> None:
    said = found(tmp_path, "receiver", [("leak in", 4e-10)], ["leakage", "line resistance"])
    assert said.verdict == "effect"
    (finding,) = said.findings
    assert (finding.candidate.kind, finding.candidate.where) == ("leakage", ("supply", "receiver"))
    (size,) = finding.parameters
    assert size.interval[0] < 4e-10 < size.interval[1]
    assert finding.rung.chi2_held_out < 1.2 < 2 < said.ladder[1].chi2_held_out


def test_what_acts_alike_is_named_together(leak_or_offset: Diagnosis) -> None:
    # a leak past the valve, and a valve that is open by more than was asked for: the same flow
    assert leak_or_offset.verdict == "one_of"
    assert {"leakage", "sensor offset"} <= set(leak_or_offset.findings[0].kinds)


def test_a_law_that_could_bend_further_but_does_not_is_no_rival(tmp_path: Path) -> None:
    # play whose gap closes in the fit is a compliance too; the two ends of the string are alike
    machine = Hidden(replace(RIGS["passive"], seconds=20), [KNOWN["passive", "string compliance"]], "test", tmp_path)
    made = step.make_stage(machine.case([4.0]).experiment, number=1, classes=["series compliance", "backlash"])
    assert {t.candidate.kind for t in made.trials} == {"series compliance", "backlash"}
    assert {t.candidate.kind for t in made.cluster} == {"series compliance"}
    closed = [t for t in made.trials if t.chi2_fit < 1.1 and t.candidate.kind == "backlash"]
    assert closed and all(t.unshown == ("backlash.gap",) for t in closed)
    assert all(t.unshown == () for t in made.cluster)
    # were its gap seen, it would be another explanation
    seen = [replace(t, unshown=()) if t in closed else t for t in made.trials]
    again = step.choosing(replace(made, trials=tuple(seen)), made.cluster[0])
    assert {t.candidate.kind for t in again.cluster} == {"series compliance", "backlash"}
    # another end that leaves more elsewhere, yet no more than noise, stays; one that leaves more does not
    best, other = made.cluster
    noise = 1 + residual_tests.SIGMAS * (2 / best.samples_held_out) ** 0.5
    for left, near in ((noise - 1e-3, True), (noise + 0.1, False)):
        again = step.choosing(replace(made, trials=(best, replace(other, chi2_held_out=left, slack=0.0))), best)
        assert (len(again.cluster) == 2) is near
    # where neither law reaches the noise, one that leaves more by a material share of the misfit is excluded
    assert made.errors is not None
    misfit = made.errors.mean(*comparison.ALL) - 1

    def inexact(trial: Refit, left: float) -> Refit:
        assert trial.errors is not None
        varied = 1 + 0.01 * np.cos(np.arange(len(trial.errors.sums)))
        errors = replace(trial.errors, sums=left * trial.errors.counts * varied)
        return replace(trial, cost=left * trial.samples, chi2_fit=left, chi2_held_out=left, slack=0.0, errors=errors)

    def alike(left: float, other_left: float) -> bool:
        near = inexact(best, 1 + left)
        return len(step.choosing(replace(made, trials=(near, inexact(other, 1 + other_left))), near).cluster) == 2

    large, small = 0.1 * misfit, 0.005 * misfit
    assert small > DECISION.near - 1
    assert alike(large, large + 0.8 * DECISION.material * misfit)
    assert not alike(large, large + 1.2 * DECISION.material * misfit)
    # or by several times what the better one leaves; near the noise, of what is called near
    assert alike(small, 0.9 * DECISION.times * small) and not alike(small, 1.1 * DECISION.times * small)
    assert alike(0.4, 0.9 * DECISION.times * 0.5) and not alike(0.4, 1.1 * DECISION.times * 0.5)
    stiffness, loss = fit(step.following(made)).parameters[-2:]  # 1e6 N/m, sought from 1e4 to 1e10: near neither end
    assert stiffness.name == "series_compliance.c" and not stiffness.at_bound
    assert loss.name == "series_compliance.T_d"


def test_a_channel_of_noise_alone_is_no_error(tmp_path: Path) -> None:
    # a record in which one channel hardly moves: no model leaves less than all of what was measured there
    case = Hidden(replace(RIGS["receiver"], seconds=30), [KNOWN["receiver", "leak in"]], "test", tmp_path).case([4e-10])
    still = {name: replace(output, noise=1e9) for name, output in case.experiment.outputs.items()}
    bad = ladder_entry("", compare(case.experiment))
    good = ladder_entry("", compare(replace(case.experiment, outputs=still)))
    assert bad.error_held_out == good.error_held_out


def test_what_the_catalogue_lacks_is_a_shape(tmp_path: Path) -> None:
    # a gauge that reads 5 % too much, among classes that do not hold it: a bent channel is as near as a curve comes to it
    said = found(tmp_path, "receiver", [("SensorGain in the channel receiver.p", 0.05)], ["line resistance"])
    assert said.verdict == "shape"
    assert said.shape is not None and said.shape.candidate.where == ("receiver.p",)
    assert said.shape.rung.chi2_held_out < 0.1 * said.ladder[1].chi2_held_out


def test_a_gauge_that_reads_too_much_is_no_other_start(tmp_path: Path) -> None:
    # it begins elsewhere than the diagram too, and starts of each record would leave hardly more than noise; but all records
    # do so by the same 5 %
    classes = ["line resistance", "sensor gain"]
    said = found(tmp_path, "receiver", [("SensorGain in the channel receiver.p", 0.05)], classes)
    assert said.verdict == "effect" and not said.started
    assert said.findings[0].candidate.label == "SensorGain in the channel receiver.p"


def test_a_sensor_that_counts_the_other_way_is_a_gain_below_zero(tmp_path: Path) -> None:
    # the fit to it drives all that is free to the ends of the ranges: the way to the right values begins at the given ones
    given = Hidden(replace(RIGS["passive"], seconds=60.0), [], "test", tmp_path).case([]).experiment
    reach = given.outputs["extension"]
    assert isinstance(reach.shown.expr, Binary) and reach.shown.text == "crown.x - platform.x"
    turned = replace(reach.shown, expr=replace(reach.shown.expr, left=reach.shown.expr.right, right=reach.shown.expr.left),
                     text="platform.x - crown.x")
    wrong = replace(given, outputs={**given.outputs, "extension": replace(reach, shown=turned)})
    said = diagnose(wrong, classes=["sensor gain", "delay"], number=1)
    assert said.verdict == "effect" and len(said.findings) == 1
    (turn,) = said.findings[0].parameters
    assert turn.name.endswith(".e") and turn.value == pytest.approx(-2.0, abs=1e-3)  # noise of 1 mm beside 0.6 m
    assert said.ladder[1].chi2_held_out > 1e4 and said.ladder[-1].chi2_held_out == pytest.approx(1, abs=0.15)
    assert said.fitted is not None
    first = {p.name: p.before for p in said.fitted.parameters}
    assert {name: free.given for name, free in at_fit(wrong, said.fitted).free.items()} == first


def test_where_the_largest_scores_mislead_everything_is_refitted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # no score is trusted at all: what is refitted first is nothing
    monkeypatch.setattr(schedule, "REFITS", 0)
    monkeypatch.setattr(schedule, "PROMISING", 2.0)
    said = found(tmp_path, "receiver", [("leak in", 4e-10)], ["leakage", "line resistance"])
    assert said.verdict == "effect"
    assert len(said.steps[0].trials) > 1
    experiment = said.steps[0].experiment
    assert not step.make_stage(experiment, number=1, classes=["leakage"], thorough=False).trials


def test_too_little_motion_tells_nothing(tmp_path: Path) -> None:
    said = found(tmp_path, "passive", [], ["dry friction"], scale=0.002, seconds=20)
    assert said.verdict == "undetermined"


def test_where_nothing_is_found_the_law_that_acts_in_the_residual_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """A class of the catalogue that is not what is missing, and no identified curve: the choked flow at the outlet."""
    monkeypatch.setattr("heavebond.diagnosis.phases.worth_it", lambda step: step.chosen.candidate.kind != "unknown law")
    said = diagnose("receiver_rig/choked", classes=["gain by direction"], number=1)
    assert (said.verdict, said.findings) == ("undetermined", ())
    assert said.words[0].endswith("reduces it noticeably on held-out data.")
    assert said.remainder is not None and said.remainder.decided and said.remainder.words in said.words
    assert OTHER_CAUSES not in " ".join(said.words)


def test_a_search_that_is_ended_early_does_not_blame_the_catalogue() -> None:
    def say(text: str) -> None:
        if "refitting 2 " in text:
            raise KeyboardInterrupt  # as Ctrl-C does; in the background a process may ignore the signal itself

    said = diagnose("receiver_rig/choked", classes=["sensor gain", "line resistance"], number=1, progress=say)
    assert said.verdict == "mainly" and said.partial and len(said.findings) == 1
    assert said.tree.words[0].startswith("So far: ") and " were scored and " in " ".join(said.words)
    # what is left may be another effect of the catalogue, which was not refitted
    assert said.evidence is not None
    chances = {event.kind: event.probability for event in probabilities(said.evidence)}
    assert chances["outside the catalogue"] < 0.2 < chances["another effect of the catalogue"]


STOPPED = """
model: stopped
extends: rig.yaml
components:
  stop: {is: EndStop, x_min: -200 mm, x_max: 40 mm, c: 5 kN/m, d: 20 N*s/m}
nodes: {load: [+stop.b], rail: [+stop.a]}
"""


def test_a_stop_that_is_not_reached_is_told_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The cart meets the far stop only: of the near one the record tells how far the cart goes, and no more."""
    monkeypatch.chdir(tmp_path)
    rig = {"rig.yaml": CART_RIG, "machine.yaml": STOPPED, "measured.yaml": MEASURED}
    for name, text in rig.items():
        Path(name).write_text(text)
    run = simulate(load("machine.yaml"), until="12 s", every="40 ms")
    run.save("monday.csv", ["foot.u", "load.x"])
    tried = CliRunner().invoke(main, ["try", "measured.yaml", "EndStop", "--between", "load", "rail", "--json", "j"])
    near, far = (json.loads(Path("j").read_text())["step"]["parameters"][f"end_stop.{n}"] for n in ("x_min", "x_max"))
    least = float(run["load.x"].min())
    assert near["unreached"] and near["interval"] == [None, pytest.approx(least, rel=1e-3)]
    assert near["value"] < least and near["at_bound"] == ""
    assert not far["unreached"] and far["interval"][0] < 0.04 < far["interval"][1]
    assert f"below {least:.4g} m, not reached" in tried.stdout


@pytest.mark.parametrize(("interval", "at_bound", "unreached", "said"), [
    ((1.0, 2.0), "", None, "1 .. 2 m"), ((0.0, 2.0), "", None, "below 2 m"), ((1.0, 5.0), "", None, "above 1 m"),
    ((0.0, 5.0), "", None, "not identifiable"), ((4.0, 5.0), "high", None, "-"),
    ((0.0, 5.0), "high", 1.2, "above 1.2 m, not reached"), ((0.0, 5.0), "", 1.8, "below 1.8 m, not reached"),
])
def test_an_end_of_an_interval_is_told_where_the_record_tells_it(
        interval: tuple[float, float], at_bound: str, unreached: float | None, said: str) -> None:
    p = Fitted("x", "m", 1.0, 1.5, 0.0, 5.0, interval, at_bound, unreached=unreached)
    assert p.known(lambda v: f"{v:g}", " m") == said


def keys(told: object) -> set[str]:
    """All keys of a JSON text, but for the names of parameters, channels and inputs."""
    if isinstance(told, dict):
        inner = [v for k, v in told.items() if k not in NAMES] + [v for k in NAMES & told.keys() for v in told[k].values()]
        return set(told) | keys(inner)
    return set().union(*map(keys, told)) if isinstance(told, list) else set()


def documented() -> set[str]:
    """The keys in the table of the page."""
    rows = PAGE.read_text(encoding="utf-8").partition("| key | part of |")[2].partition("\n\n")[0].splitlines()[2:]
    listed = [row.split("`")[1] for row in rows]
    assert len(set(listed)) == len(listed)
    return set(listed) | set(BY_KEY)


def test_the_page_has_the_columns_of_the_ranking() -> None:
    rows = PAGE.read_text(encoding="utf-8").partition("| key | heading |")[2].partition("\n\n")[0].splitlines()[2:]
    cells = [(f"`{c.key}`", c.title, c.unit, c.meaning) for c in COLUMNS]
    assert rows == [" ".join("|" if not cell else f"| {cell}" for cell in row) + " |" for row in cells]


def test_every_candidate_is_ranked_once_with_the_reason_for_its_judgement(leak_or_offset: Diagnosis) -> None:
    first = leak_or_offset.steps[0]
    ranked = entries(first)
    assert {e.candidate.label for e in ranked} == {s.candidate.label for s in first.scores}
    assert [e.judgement for e in ranked].count("chosen") == 1 and ranked[0]["cluster"] is True
    for e in ranked:
        assert e.judgement in JUDGEMENTS and (e["chi2_fit"] is None) == (e.trial is None)
        without_fit = ("same_direction", "not_identifiable", "low_score", "left_out", "not_reached", "not_simulated")
        assert (e.judgement in without_fit) == (e.trial is None)
    best = ranked[0]
    assert best.trial is not None and best["bic_difference"] == best.trial.bic - first.bic < -10
    assert as_dicts(ranked)[0]["error_over_noise_held_out"] == pytest.approx(math.sqrt(best.trial.chi2_held_out))


def left() -> Remainder:
    """A law of two variables that is left after all effects."""
    crown = SimpleNamespace(name="crown", mechanical=True, through="f", domain=SimpleNamespace(
        members={"f": SimpleNamespace(noun="force")}))
    speed, pressure = (Variable(kind, name, name, unit, np.zeros(2), np.zeros(2, dtype=bool)) for kind, name, unit in
                       (("across", "crown.v", "m/s"), ("pressure", "oil.p", "Pa")))
    curve = Curve(speed, 0.8, "step", 0.8, np.zeros(2), np.zeros(2), np.zeros(0), {}, second=pressure, covered=0.9,
                  chance=0.01)
    place: Any = SimpleNamespace(place=SimpleNamespace(nodes=[crown], words="at crown"), curve=curve)
    return Remainder(True, place)


def test_what_is_left_is_told_by_its_law_where_that_is_decided() -> None:
    said = left()
    assert said.decided and said.words == "With the parameters at their values, a force at crown that follows the " \
        "crown.v, as a step at zero, and changes with the oil.p, would explain most of the residual (80 % of it on " \
        "held-out data)."
    assert said.place is not None and said.place.curve is not None
    changes: list[tuple[dict[str, Any], str]] = [
        ({"covered": 0.5}, "is not decided: 50 % of the held-out motion"),
        ({"chance": 0.3}, "is not decided: none predicts held-out data better"),
        ({"r2": 0.3}, "No law of one or two variables at any place explains most")]
    for change, words in changes:
        place: Any = SimpleNamespace(place=said.place.place, curve=replace(said.place.curve, **change))
        assert words in Remainder(True, place).words
    assert "acts as no force or flow" in Remainder(True, None).words


def test_the_report_of_effects_that_are_not_certain_names_the_diagram_of_each_step(leak_or_offset: Diagnosis) -> None:
    """Steps after the last finding: one with an effect that is not certain, and one that chose no effect."""
    said = replace(leak_or_offset, findings=(), doubtful=leak_or_offset.findings[:1], steps=leak_or_offset.steps[:1] * 3)
    assert report(said).count(f"the diagram with {said.doubtful[0].candidate.label}") == 2


def test_a_fault_in_the_report_keeps_the_results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("heavebond.reports.report.report", lambda *_, **__: [][0])
    result = CliRunner().invoke(main, ["diagnose", "receiver_rig/choked", "--only", "sensor gain", "--processes", "1",
                                       "--json", "j"])
    written = json.loads((tmp_path / "j").read_text())
    assert result.exit_code == 70 and "is not written, by a fault of heavebond itself, IndexError" in result.output
    assert written["verdict"] and not written["ok"] and not list(tmp_path.glob("*_report.html"))


def test_the_page_lists_the_keys_of_every_verdict(leak_or_offset: Diagnosis, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
                                                   ) -> None:
    """What the command writes has these keys and no others, and on the table there is none that never comes."""
    top: list[set[str]] = []
    all_keys: set[str] = set()
    for said in (found(tmp_path, "receiver", [], ["leakage"]), leak_or_offset):
        # whether another channel would decide is a matter of the machine: the keys of one that would
        apart = said.separation and replace(said.separation, extra=AdditionalSensor("valve.m", "kg/s", 1e-6, 20.0))
        # and that a law is left besides
        whole = replace(said, separation=apart, restricted=False, remainder=said.separation and left())
        told = json.loads(json.dumps(whole.as_dict()))
        top.append(set(told))
        all_keys |= keys(told)
    assert top[0] == top[1]
    monkeypatch.chdir(tmp_path)
    CliRunner().invoke(main, ["diagnose", "receiver_rig/choked", "--only", "sensor gain", "--processes", "1", "--json", "j"])
    written = json.loads((tmp_path / "j").read_text())
    assert written["ok"] and top[0] <= set(written) and isinstance(written["verdict"], str)
    written["validity"] = {}  # the same for all commands, described with these
    assert all_keys | keys(written) == documented()


@pytest.mark.slow
@pytest.mark.parametrize(("experiment", "kinds", "places"), [
    ("passive_rig/friction", {"dry friction"}, {("platform", "crown")}),
    ("cylinder_rig/leakage", {"internal leakage", "leakage"}, {("cylinder",), ("chamber_a", "chamber_b")}),
    ("receiver_rig/choked", {"choked flow"}, {("inlet",), ("inlet", "outlet")}),
])
def test_the_bundled_records_are_named(experiment: str, kinds: set[str], places: set[tuple[str, ...]]) -> None:
    said = diagnose(experiment)
    assert said.verdict in ("effect", "one_of")
    (finding,) = said.findings
    assert finding.candidate.kind in kinds
    assert finding.candidate.where in places
    assert finding.rung.chi2_held_out <= 1.5


@pytest.mark.slow
def test_the_bundled_record_without_an_effect_is_parameters() -> None:
    assert diagnose("passive_rig/nothing").verdict == "parameters"
