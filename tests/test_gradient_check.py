"""Every verdict on a sensitivity, on machines that deserve it; and the kinks that explain them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from test_sensitivities import MEASURED, SLIDER, _text
from test_tuning import ABSORBER

import heavebond as hb
from heavebond import cli
from heavebond.numerics.kinks import Kinks
from heavebond.numerics.simulator import Simulator, Tolerances
from heavebond.optimise.gradient_check import SampledRun, Subject, Verdict, check_gradients, costs_of, signals_of
from heavebond.optimise.objective import TuningProblem, ranges

# A force of 10 N at most, and cut at 10 N: more amplitude is cut, a higher limit cuts nothing.
LIMITED = """
model: limited
components:
  wall:   {is: Fixed}
  spring: {is: Spring, c: 1.2 kN/m}
  damper: {is: Damper, d: 4 N*s/m}
  cart:   {is: Mass, m: 2.5 kg}
  wave:   {is: Sine, a: 10 N, T: 1 s}
  limit:  {is: Saturation, u_min: -100 N, u_max: 10 N}
  force:  {is: ForceSource}
nodes:
  ground: [wall.a, spring.a, damper.a]
  load:   [spring.b, damper.b, cart.a, force.a]
  raw:    [wave.y, limit.u]
  cut:    [limit.y, force.u]
initial: {load.x: 0 mm, load.v: 0 m/s}
simulate: {until: 2 s, every: 20 ms}
"""

# A force that stands just at its limit: a higher limit changes nothing, a lower one everything.
TOUCHING = """
model: touching
components:
  limit: {is: Saturation, u: 60 N, u_min: -60 N, u_max: 60 N}
  push:  {is: ForceSource}
  cart:  {is: Mass, m: 2.5 kg}
nodes:
  force: [limit.y, push.u]
  load:  [push.a, cart.a]
initial: {load.x: 0 m, load.v: 0 m/s}
simulate: {until: 2 s, every: 20 ms}
"""

RELAY = """
component: Relay
summary: Pushes with a constant force beyond a place.
ports: {b: translational}
parameters:
  F: {unit: N, min: 0, doc: force}
  d: {unit: m, min: 0, doc: place}
power: source
equations: |
  b.f = if_else(b.x > d, F, 0)   # all or nothing
"""
SWITCHED = SLIDER.replace("components:", "components:\n  relay:  {is: Relay, F: 20 N, d: 10 mm}") \
    .replace("[spring.b,", "[relay.b, spring.b,")

STICKING = SLIDER.replace("damper: {is: Damper, d: 4 N*s/m}", "damper: {is: CoulombFriction, F_c: 4 N, v_t: 1 mm/s}")


def _check(text: str, signals: list[str], parameters: list[str], folder: Path, tolerances: Tolerances | None = None
           ) -> list[Verdict]:
    (folder / "relay.yaml").write_text(RELAY)
    return check_gradients(signals_of(_text(text)(folder), signals, tolerances=tolerances), parameters)


def _words(verdicts: list[Verdict]) -> list[tuple[str, str]]:
    return [(v.parameter, v.word) for v in verdicts]


def test_a_smooth_machine_agrees(tmp_path: Path) -> None:
    verdicts = _check(SLIDER, ["load.x", "spring.F"], ["spring.c", "cart.m", "initial.load.v"], tmp_path)
    assert {v.word for v in verdicts} == {"agrees"}
    assert max(v.best for v in verdicts) < 1e-6
    assert max(v.given for v in verdicts) < 1e-5


def test_so_does_a_record_and_what_has_no_influence(tmp_path: Path) -> None:
    verdicts = _check(MEASURED, ["load.x"], ["scale.table.u", "damper.d"], tmp_path)
    assert {v.word for v in verdicts} == {"agrees"}
    none = _check(SLIDER, ["1 m*time/1 s"], ["spring.c"], tmp_path)
    assert (none[0].word, none[0].why) == ("agrees", "the parameter has no influence")


def test_friction_agrees_once_the_steps_are_short(tmp_path: Path) -> None:
    """Coulomb's law smoothed over 1 mm/s is steep, but differentiable: long steps are off, short ones are not."""
    verdict = _check(STICKING, ["load.x"], ["damper.F_c"], tmp_path)[0]
    assert verdict.word == "agrees"
    assert verdict.best < 1e-4


def test_loose_tolerances_are_named(tmp_path: Path) -> None:
    verdict = _check(SLIDER, ["load.x"], ["spring.c"], tmp_path, Tolerances(1e-2, 1e-4))[0]
    assert verdict.word == "tolerance"
    assert "at rtol 0.01 it is off by" in verdict.why
    assert verdict.best < 1e-6 < 1e-2 < verdict.given


def test_a_limit_that_is_just_reached_is_a_kink(tmp_path: Path) -> None:
    """Only as the root of the step does a difference approach the derivative: the limit cuts a part of that length."""
    verdicts = _check(LIMITED, ["load.x"], ["limit.u_max", "wave.a", "spring.c"], tmp_path)
    assert _words(verdicts) == [("limit.u_max", "kink"), ("wave.a", "kink"), ("spring.c", "agrees")]
    assert "limit (min) switches at 0.2" in verdicts[0].why
    steps = list(verdicts[0].steps.values())
    assert steps == sorted(steps, reverse=True)


def test_a_value_at_the_kink_itself_has_two_slopes(tmp_path: Path) -> None:
    """The one-sided differences are 1 and 0 times the effect of the force; their mean agrees with CasADi's choice."""
    verdict = _check(TOUCHING, ["load.x"], ["limit.u_max"], tmp_path)[0]
    assert verdict.word == "kink"
    assert "limit (min)" in verdict.why
    assert verdict.apart > 0.5


def test_a_law_that_jumps_is_a_kink(tmp_path: Path) -> None:
    """The differences settle, on another value: the moment of a jump moves too, which sensitivities do not see."""
    for verdict in _check(SWITCHED, ["load.x"], ["relay.F", "spring.c"], tmp_path):
        assert verdict.word == "kink"
        assert "a law jumps" in verdict.why
        assert "relay (if_else) switches" in verdict.why
        assert verdict.best > 0.1


def test_a_kink_in_the_signal_itself_is_told(tmp_path: Path) -> None:
    verdict = _check(SLIDER, ["max(load.x, 0 m)"], ["spring.c"], tmp_path)[0]
    assert verdict.word == "agrees"  # between the times of output it does not show
    assert "the signal max(load.x, 0 m) (max)" in verdict.why


def _wrong(subject: Subject, factor: float) -> Subject:
    exact = subject.exact
    return replace(subject, exact=lambda tolerances, names: factor * exact(tolerances, names))


def test_a_wrong_derivative_disagrees(tmp_path: Path) -> None:
    subject = _wrong(signals_of(_text(SLIDER)(tmp_path), ["load.x"]), 1.01)
    verdict = check_gradients(subject, ["spring.c"])[0]
    assert verdict.word == "disagrees"
    assert "settle on another value, 0.99 % away" in verdict.why


def test_a_wrong_derivative_is_not_blamed_on_a_harmless_kink(tmp_path: Path) -> None:
    """A stop that is hit bends the motion but the differences settle: what is wrong then is the derivative."""
    stop = "  stop:   {is: EndStop, c: 50 kN/m, d: 0 N*s/m, x_min: -30 mm, x_max: 1 m, e_t: 1 mm}"
    text = SLIDER.replace("components:", f"components:\n{stop}") \
        .replace("spring.a,", "spring.a, stop.a,").replace("spring.b,", "spring.b, stop.b,")
    subject = signals_of(_text(text)(tmp_path), ["load.x"])
    assert check_gradients(subject, ["spring.c"])[0].word == "agrees"
    assert check_gradients(_wrong(subject, 1.1), ["spring.c"])[0].word == "disagrees"


def test_noise_is_called_unsettled(tmp_path: Path) -> None:
    subject = signals_of(_text(SLIDER)(tmp_path), ["load.x"])
    generator = np.random.default_rng(1)

    def noisy(tolerances: Tolerances) -> object:
        plain = subject.runs(tolerances)

        def ran(settings: Mapping[str, float]) -> SampledRun:
            found = plain(settings)
            return replace(found, values=found.values * (1 + 0.1 * generator.standard_normal()))

        return ran

    verdict = check_gradients(replace(subject, runs=noisy), ["spring.c"])[0]
    assert verdict.word == "unsettled"


@pytest.mark.long
def test_differences_over_an_event_are_left_out(tmp_path: Path) -> None:
    """A body that jumps back: its speed jumps at an instant that moves with the parameter."""
    (tmp_path / "floor.yaml").write_text("""
component: Floor
summary: Throws back what falls on it.
ports: {a: translational}
parameters:
  e: {unit: 1, doc: restitution}
equations: |
  a.f = 0   # free flight
when:
  impact: {condition: a.x < 0, then: {a.v: -e * a.v}}
power: controlled, impacts
""", encoding="utf-8")
    assembly = hb.assemble(hb.loads("""
model: ball
components: {body: {is: Mass, m: 2 kg}, weight: {is: Weight, m: 2 kg}, floor: {is: Floor, e: 0.8}}
nodes: {ball: [body.a, weight.a, floor.a]}
initial: {ball.x: 1 m, ball.v: 0 m/s}
simulate: {until: 2 s, every: 10 ms}
""", tmp_path))
    subject = signals_of(assembly, ["ball.v"])
    assert check_gradients(subject, ["floor.e"])[0].word == "agrees"
    assert check_gradients(_wrong(subject, 1.01), ["floor.e"])[0].word == "disagrees"


def test_values_near_which_no_run_can_be_made(tmp_path: Path) -> None:
    subject = signals_of(_text(SLIDER)(tmp_path), ["load.x"])

    def broken(tolerances: Tolerances) -> object:
        plain = subject.runs(tolerances)

        def run(settings: dict[str, float]) -> object:
            if settings:
                raise hb.SimulationError("the integration stopped")
            return plain(settings)
        return run

    verdict = check_gradients(replace(subject, runs=broken), ["spring.c"])[0]
    assert (verdict.word, verdict.why) == ("unsettled", "no run near the value of the parameter could be made")


def test_unknown_names(tmp_path: Path) -> None:
    assembly = _text(SLIDER)(tmp_path)
    with pytest.raises(hb.UsageError, match="nothing here is called"):
        signals_of(assembly, ["load.y"])
    with pytest.raises(hb.UsageError, match="cannot be set"):
        check_gradients(signals_of(assembly, ["load.x"]), ["spring.k"])
    with pytest.raises(hb.UsageError, match="no parameter is named"):
        check_gradients(signals_of(assembly, ["load.x"]), [])


# -- costs -----------------------------------------------------------------------------------------------------------
@pytest.mark.long
@pytest.mark.parametrize("backwards", [False, True])
def test_costs_and_limits_agree(backwards: bool) -> None:
    task = TuningProblem(ranges({"damper.d": "1 .. 200 N*s/m"}), "rms(load.x)/1 mm + final(load.v)/1 m*1 s",
                         ("peak(load.x) < 1 m",),
                         begin=10.0, end=20.0)
    assembly = hb.assemble(hb.loads(ABSORBER.replace("10 rad/s*time", "10 rad/s * time")))
    subject = costs_of(assembly, task, tolerances=Tolerances(1e-8, 1e-10), backwards=backwards)
    verdicts = check_gradients(subject, ["damper.d", "spring.c"])
    assert [v.quantity for v in verdicts] == ["cost", "peak(load.x) < 1 m"] * 2
    assert {v.word for v in verdicts} == {"agrees"}


# -- kinks -----------------------------------------------------------------------------------------------------------
def test_kinks_are_found_with_their_owner_and_time(tmp_path: Path) -> None:
    assembly = _text(LIMITED)(tmp_path)
    kinks = Kinks(assembly, ["abs(load.v)"])
    assert [(k.owner, k.function, k.jumps) for k in kinks.kinks] == [
        ("limit", "min", False), ("limit", "max", False), ("the signal abs(load.v)", "abs", False)]
    simulator = Simulator(assembly)
    low, high = (simulator.run({"wave.a": a}) for a in (9.0, 11.0))
    first = kinks.apart(low, high)[0]
    assert first.kink.owner == "limit"
    assert first.time == pytest.approx(np.arcsin(10 / 11) / (2 * np.pi), abs=0.02)
    assert kinks.apart(low, low) == []


def test_a_smooth_machine_has_none(tmp_path: Path) -> None:
    assembly = _text(SLIDER)(tmp_path)
    run = hb.simulate(assembly)
    assert Kinks(assembly).apart(run, run) == []


# -- command ---------------------------------------------------------------------------------------------------------
def _call(folder: Path, *words: str) -> tuple[int, str]:
    (folder / "slider.yaml").write_text(SLIDER)
    answer = CliRunner().invoke(cli.main, ["sensitivity", "--check", *words])
    return answer.exit_code, answer.output


def test_the_command_on_a_diagram(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    code, said = _call(tmp_path, "slider.yaml", "--of", "load.x", "--parameter", "spring.c,cart.m", "--rtol", "1e-2",
                       "--json", "g.json")
    assert code == 0, said
    assert "tolerance too loose" in said
    assert "load.x to spring.c: at rtol 0.01 it is off by" in said
    found = json.loads(Path("g.json").read_text())
    assert [v["verdict"] for v in found["verdicts"]] == ["tolerance", "tolerance"]
    assert set(found["verdicts"][0]["steps"]) == {"0.01", "0.001", "0.0001", "1e-05"}


def test_the_command_on_a_bundled_diagram(tmp_path: Path) -> None:
    code, said = _call(tmp_path, "passive_rig", "--of", "crown.x", "--parameter", "gas.c")
    assert code == 0, said
    assert "agrees" in said


def test_the_command_on_a_study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("study.yaml").write_text("study: small\nmodel: slider.yaml\ntune:\n  free: {damper.d: 1 .. 20 N*s/m}\n"
                                  "  cost: rms(load.x)/1 mm\n")
    for more in ([], ["--backwards"]):
        code, said = _call(tmp_path, "study.yaml", *more)
        assert code == 0, said
        assert "cost   damper.d" in said
        assert "agrees" in said


@pytest.mark.parametrize(("words", "message"), [
    (["slider.yaml", "--parameter", "spring.c"], "no signal is named"),
    (["slider.yaml", "--of", "load.x"], "no parameter is named"),
    (["slider.yaml", "--of", "load.x", "--parameter", "spring.c", "--backwards"], "only the costs of a study"),
    (["slidr.yaml", "--of", "load.x", "--parameter", "spring.c"], "there is no diagram or study")])
def test_wrong_usage(words: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    code, said = _call(tmp_path, *words)
    assert code == 2
    assert message in said
