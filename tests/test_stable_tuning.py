"""Tuned machines are stable at rest unless that is taken off, and say how far from the boundary they are."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from test_robustness import SERVO

import heavebond as hb
from heavebond.cli import main
from heavebond.linear.describing_function import dry_frictions, slopes_over
from heavebond.linear.floquet import largest_multiplier
from heavebond.linear.rest_stability import RestStability, crossing, loop, stability_sentences
from heavebond.numerics.dae import Assembly
from heavebond.optimise.objective import Objective, TuningProblem, ranges
from heavebond.optimise.tuning import stability_of, tune
from heavebond.studies.run_case import Outcome

LIMIT = 100 * (1 / 0.02 + 100 / 10)  # N/m: Hurwitz, for the servo
# the better the larger the gain, whatever the loop does in the short run that is looked at
GREEDY = "rms(load.x)/1 km - gain/1 kN*1 m*0 + (1 + gain/20 kN*1 m)**2"
RUBBED = SERVO.replace("  cart:   {is", "  rub:    {is: CoulombFriction, F_c: 20 N}\n  cart:   {is").replace(
    "ground: [wall.a, damper.a]", "ground: [wall.a, damper.a, rub.a]").replace(
    "load:   [damper.b,", "load:   [damper.b, rub.b,")
PENDULUM_SWING = """
model: driven
components:
  wall:   {is: Fixed}
  spring: {is: Spring, c: 1 kN/m}
  damper: {is: Damper, d: 20 N*s/m}
  cart:   {is: Mass, m: 10 kg}
  push:   {is: ForceSource, u: "=20 N*cos(2*pi*time/1 s)"}
nodes:
  ground: [wall.a, spring.a, damper.a]
  load:   [spring.b, damper.b, cart.a, push.a]
initial: {load.x: 0 m, load.v: 0 m/s}
simulate: {until: 40 s}
"""


@pytest.fixture(scope="module")
def servo() -> Assembly:
    return hb.assemble(hb.loads(SERVO.replace("until: 20 s", "until: 2 s")))


def _task(**more: object) -> TuningProblem:
    return TuningProblem(ranges({"gain": "-20 .. -1 kN/m"}), GREEDY, (), 0.0, 2.0, **more)


@pytest.mark.parametrize("method", ["trust", "ipopt"])
def test_a_gain_that_is_unstable_at_rest_is_no_optimum(servo: Assembly, method: str) -> None:
    """The search ends at the limit of Hurwitz, from the stable side, within the smoothing and the margin of the limit."""
    result = tune(servo, _task(), method=method, explore=3)
    assert -LIMIT < result.values["gain"] < -0.95 * LIMIT
    assert result.stability.stable
    assert result.limits["stable"] <= 1e-4
    assert result.stability.damping is not None and 0 < result.stability.damping < 2e-2


def test_stability_is_taken_off_and_said_to_be_lost(servo: Assembly) -> None:
    result = tune(servo, _task(stable=False), explore=3)
    assert result.values["gain"] < -1.5 * LIMIT
    assert result.stability.stable is False
    assert "stable" not in result.limits
    said = " ".join(stability_sentences(result.stability, asked=False))
    assert "NOT STABLE" in said and "`stable: off`" in said
    assert "friction" not in said  # there is none in this machine
    assert result.stability.boundary is not None
    down, _ = result.stability.boundary["gain"]
    assert down == pytest.approx(LIMIT / -result.values["gain"], rel=1e-3)


def test_the_limit_of_stability_has_its_slope_by_the_gains(servo: Assembly) -> None:
    machine = RestStability(servo, 2.0)
    for gain in (-2e3, -5.9e3, -8e3):
        value, slope = machine.limit({"gain": gain}, ["gain"])
        values = [machine.limit({"gain": gain + sign * 0.1}, [])[0] for sign in (-1, 1)]
        assert slope[0] == pytest.approx((values[1] - values[0]) / 0.2, rel=1e-4)
        assert (value < 0) == (gain > -LIMIT)


def test_a_slope_of_dry_friction_at_rest_does_not_count_as_stability() -> None:
    """As modelled 20 N over 1 mm/s hold the cart like a damper of 20 kN s/m; while it slides there is none of that. Between,
    the share s of the slope is the damper that Hurwitz asks for: k = d (1/T + d/m)."""
    assembly = hb.assemble(hb.loads(RUBBED))
    machine, values = RestStability(assembly, 20.0), {"gain": -1.5 * LIMIT}
    found = machine.at(values)
    assert found is not None
    modelled, sliding = found.variants[0], found.variants[-1]
    assert all(mode.value.real < 0 for mode in modelled.modes)
    assert any(mode.value.real > 0 for mode in sliding.modes)
    told = stability_of(Objective(assembly, TuningProblem(ranges({"gain": "-20 .. -1 kN/m"}), "rms(load.x)/1 m")), values)
    assert told.stable is False and told.frictions == ("rub",)
    d = np.roots([1 / 10, 1 / 0.02, -1.5 * LIMIT]).max() - 100
    assert told.shares is not None
    low, high = told.shares
    assert low == 0 and high <= d / 20e3 < high * np.sqrt(10)
    assert "while its dry friction slides" in " ".join(stability_sentences(told))


@pytest.mark.parametrize("amplitude", [0.01, 0.1, 1.0])
@pytest.mark.parametrize("law", [
    "CoulombFriction, F_c: 20 N", "DirectionalFriction, F_p: 25 N, F_n: 15 N",
    "StribeckFriction, F_c: 20 N, F_s: 20 N, v_s: 1 m/s, sigma_2: 7 N*s/m"])
def test_the_slope_over_a_sinusoidal_motion_is_the_describing_function(law: str, amplitude: float) -> None:
    """4 F/(pi V), whatever the viscous part; the transition of 1 mm/s takes some of it at small speeds."""
    assembly = hb.assemble(hb.loads(f"""
model: rub
components:
  wall: {{is: Fixed}}
  rub:  {{is: {law}}}
  hand: {{is: PositionSource, u: "={amplitude} m*sin(2*pi*time/1 s)"}}
nodes: {{ground: [wall.a, rub.a], end: [hand.a, rub.b]}}
simulate: {{until: 2 s}}
"""))
    run = hb.Simulator(assembly, times=np.linspace(0, 2, 8001)).run()
    share, = slopes_over(assembly, dry_frictions(assembly), run)
    assert share * 20 / 1e-3 == pytest.approx(4 * 20 / (np.pi * amplitude * 2 * np.pi), rel=2e-3)


def test_no_equation_of_the_program_knows_a_friction_by_name() -> None:
    """Laws of the library that stick are marked in their files: a width in the unit of a speed, or `sliding`."""
    text = RUBBED.replace("rub:    {is: CoulombFriction, F_c: 20 N}", "rub:    {is: %s}")
    for law in ("LuGreFriction, F_c: 20 N", "DahlFriction, F_c: 20 N", "CoulombFriction, F_c: 20 N",
                "StribeckFriction, F_c: 20 N, F_s: 30 N, v_s: 0.1 m/s", "DirectionalFriction, F_p: 20 N, F_n: 25 N",
                "DryFriction, F_c: 20 N, F_s: 25 N"):
        machine = RestStability(hb.assemble(hb.loads(text % law)), 20.0)
        assert dry_frictions(machine.assembly).names == ("rub",)
        for gain, stable in ((-0.9 * LIMIT, True), (-1.1 * LIMIT, False)):
            found = machine.at({"gain": gain})
            assert found is not None
            poles = [mode.value.real for mode in found.variants[-1].modes if mode.value]
            assert (max(poles) < 0) == stable, law


def test_a_friction_of_no_force_is_no_friction(servo: Assembly) -> None:
    machine = RestStability(hb.assemble(hb.loads(RUBBED.replace("F_c: 20 N", "F_c: 0 N"))), 20.0)
    found, plain = machine.at({}), RestStability(servo, 20.0).at({})
    assert found is not None and plain is not None
    assert len(found.variants) == 1
    assert found.worst == pytest.approx(plain.worst, rel=1e-9)


def test_margins_of_the_loop_are_those_of_its_frequency_response(servo: Assembly) -> None:
    """L = k / (s (m s + d) (T s + 1))."""
    machine, k = RestStability(servo, 20.0), 1000.0
    found = machine.at({"gain": -k})
    assert found is not None
    told = loop(machine, found.variants[0], ["gain"], {"gain": -k})
    assert told is not None and told.through == ("gain",)
    assert told.gain_up == pytest.approx(LIMIT / k, rel=1e-3)
    w = np.geomspace(0.1, 100, 400_001)
    response = k / (1j * w * (10j * w + 100) * (0.02j * w + 1))
    at = int(np.argmin(np.abs(np.abs(response) - 1)))
    assert told.phase == pytest.approx(180 + np.degrees(np.angle(response[at])), abs=0.01)
    assert told.frequency == pytest.approx(w[at] / 2 / np.pi, rel=1e-3)


def test_bodies_that_nothing_holds_are_no_instability() -> None:
    text = SERVO.replace("  wall:   {is: Fixed}", "  wall:   {is: Fixed}\n  ship:   {is: Mass, m: 1 t}")
    text = text.replace("nodes:", "nodes:\n  afloat: [ship.a]")
    text = text.replace("{load.x:", "{afloat.x: 0 m, afloat.v: 0 m/s, load.x:")
    task = TuningProblem(ranges({"gain": "-20 .. -1 kN/m"}), "rms(load.x)/1 m + 0*rms(afloat.x)/1 m")
    objective = Objective(hb.assemble(hb.loads(text)), task)
    told = stability_of(objective, {"gain": -2e3})
    assert told.stable and told.marginal == 2
    assert "not counted" in " ".join(stability_sentences(told))


def test_a_periodic_run_has_the_multiplier_of_its_decay() -> None:
    """exp(-d T / 2 m) for the driven oscillator; and None for one that does not repeat itself."""
    assembly = hb.assemble(hb.loads(PENDULUM_SWING))
    assert largest_multiplier(assembly, 40.0) == pytest.approx(np.exp(-20 / 20), rel=2e-2)
    assert largest_multiplier(assembly.with_parameters({"damper.d": 0.0}), 40.0) is None


def test_without_an_equilibrium_it_is_said_that_nothing_is_decided() -> None:
    """A cart that a force drives ever harder on its way: no state of rest, no steady speed."""
    assembly = hb.assemble(hb.loads("""
model: runaway
components:
  cart:  {is: Mass, m: 10 kg}
  motor: {is: ForceSource, u: "=20 N*(1 + (load.x/1 m)**2)"}
  drag:  {is: Damper, d: 1 N*s/m}
  wall:  {is: Fixed}
nodes: {load: [cart.a, motor.a, drag.b], wall: [wall.a, drag.a]}
initial: {load.v: 0 m/s, load.x: 0 m}
simulate: {until: 1 s}
"""))
    told = stability_of(Objective(assembly, TuningProblem(ranges({"drag.d": "0.5 .. 3 N*s/m"}), "rms(load.x)/1 m")),
                        {"drag.d": 1.0})
    assert (told.decided, told.stable) == ("", None)
    assert next(stability_sentences(told)).startswith("stability not decided")


def test_tune_that_ends_at_a_bound_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                           capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "servo.yaml").write_text(SERVO, encoding="utf-8")
    with pytest.raises(SystemExit) as caught:
        main(["tune", "servo.yaml", "--free", "gain=-3 .. -1 kN/m", "--cost", "gain/1 kN*1 m + 0*rms(load.x)/1 m",
              "--explore", "0", "--no-robustness", "--json", "told.json"])
    assert caught.value.code == 0
    told = json.loads((tmp_path / "told.json").read_text(encoding="utf-8"))
    assert told["at_end"] == {"gain": "lower"}
    assert told["stability"]["stable"] is True
    out = capsys.readouterr().out
    assert "gain ended at the lower end of its range, -3 kN/m" in out
    assert "stable at its operating point: least damping ratio" in out
    assert "gain margin times 2" in out


def test_unstable_gains_meet_no_published_number(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                                 capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "servo.yaml").write_text(SERVO.replace("until: 20 s", "until: 2 s"), encoding="utf-8")
    for number, stable in enumerate(("off", "on")):
        (tmp_path / "gains.yaml").write_text(f"""study: gains
model: servo.yaml
tune: {{free: {{gain: -20 .. -1 kN/m}}, stable: {stable}, cost: "{GREEDY}"}}
measure: {{way: largest(load.x)}}
compare_with: {{somebody: {{gain: -6 kN/m}}}}
""", encoding="utf-8")
        result = hb.study("gains.yaml", processes=1)
        outcome = result.outcomes[0]
        assert outcome.unstable == (stable == "off")
        assert np.isfinite(result.difference(outcome, "gain")) == (stable == "on")
        with pytest.raises(SystemExit):
            main(["study", "gains.yaml", "--processes", "1", "--output", f"out{number}"])
        out = capsys.readouterr().out
        assert ("(unstable)" in out) == ("NOT STABLE" in out) == (stable == "off")
        told = json.loads((tmp_path / f"out{number}" / "study.json").read_text(encoding="utf-8"))
        assert told["cases"][0]["stability"]["stable"] is (stable == "on")
    assert not Outcome(0).unstable


@pytest.mark.parametrize(("text", "code"), [
    ("stable: maybe", "stable-unknown"), ("stable: off, limits: [stable]", "stable-twice")])
def test_wrong_words_about_stability_are_refused(tmp_path: Path, text: str, code: str) -> None:
    (tmp_path / "servo.yaml").write_text(SERVO, encoding="utf-8")
    (tmp_path / "gains.yaml").write_text(f"study: gains\nmodel: servo.yaml\ntune: {{free: {{gain: -3 .. -1 kN/m}}, {text}, "
                                         "cost: rms(load.x)}\n", encoding="utf-8")
    with pytest.raises(hb.ModelError) as caught:
        hb.load_study(tmp_path / "gains.yaml")
    assert caught.value.problems[0].code == code


def test_a_boundary_is_not_named_where_a_score_is_missing() -> None:
    """A machine may find no rest at the values between."""
    assert crossing(lambda factor: -1.0 if factor < 1.1 else 1.0, True) == pytest.approx(1.1, abs=1e-3)
    assert crossing(lambda factor: -1.0 if factor < 1.05 else 1.0 if factor > 1.2 else np.nan, True) is None
