"""Segments of records on which a machine that integrates its inputs is compared."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

import heavebond as hb
from heavebond.core.cancellation import Budget
from heavebond.diagnosis import phases
from heavebond.diagnosis.answer.sentences import SEGMENTS
from heavebond.diagnosis.evidence.horizons import horizon_words, with_horizons
from heavebond.diagnosis.search.stepwise import SelectedEffect
from heavebond.diagnosis.state import ladder_entry
from heavebond.estimation.channel_noise import with_noise
from heavebond.estimation.comparison import Comparison, compare
from heavebond.estimation.experiment import Experiment, Horizon, without_carried
from heavebond.estimation.residuals import Exceeded, Run

PERIOD, NOISE = 40.0, 1e-3
TANK = """
model: vessel
components:
  pump: {is: FlowSource, u: 0 L/min}
  tank: {is: OpenTank, A: 0.1 m**2}
  OUTLET
nodes: {inlet: [pump.a, tank.a], bottom: [tank.b, outlet.a] END}
initial: {tank.h: 1 m}
"""
CLOSED = TANK.replace("OUTLET", "outlet: {is: Cap}").replace(" END", "")
OPEN = TANK.replace("OUTLET", "outlet: {is: LaminarLeakage, C: 2e-6 m**3/(s*Pa)}\n  pit: {is: Tank}").replace(
    " END", ", pit: [outlet.b, pit.a]")  # an error decays in A/(C rho g) = 5 s
EXPERIMENT = """
experiment: vessel
model: vessel.yaml
records: {one: {file: one.csv, use: fit}, two: {file: two.csv, use: validate}}
time: {column: t, unit: s}
inputs: {pump.u: {column: q, unit: L/min, interpolation: spline}}
outputs: {level: {is: tank.h, column: h, unit: m, noise: 1 mm}}
"""


def written(folder: Path, model: str, flow: float) -> Experiment:
    """A tank that a pump fills and empties in periods, of which the diagram lacks a constant flow (L/min)."""
    (folder / "vessel.yaml").write_text(model)
    (folder / "vessel_records.yaml").write_text(EXPERIMENT)
    t = np.arange(401.0)
    for name, seed in (("one", 1), ("two", 2)):
        q = 30 * np.sin(2 * np.pi * t / PERIOD)
        h = 1 + np.concatenate([[0.0], np.cumsum((q[1:] + q[:-1]) / 2)]) / 6e4 / 0.1
        h += flow * t / 6e4 / 0.1 + NOISE * np.random.default_rng(seed).standard_normal(len(t))
        np.savetxt(folder / f"{name}.csv", np.column_stack([t, q, h]), delimiter=",", header="t,q,h", comments="")
    return with_noise(hb.load_experiment(folder / "vessel_records.yaml"))


def test_an_error_that_is_constant_within_each_segment_is_no_evidence() -> None:
    horizon = Horizon(np.arange(12) / 10, np.repeat([0, 1, 2], 4), np.ones((1, 12, 1)))
    r = np.random.default_rng(0).standard_normal((2, 11))
    place = np.delete(np.arange(12), 5)  # one sample is missing
    found = without_carried(horizon.carried(np.zeros(11, int), horizon.time[place], np.full(11, 0.1)), r)
    for segment in range(3):
        inside = horizon.segment[place] == segment
        expected = r[:, inside] - r[:, inside].mean(axis=1, keepdims=True)
        assert found[:, inside] == pytest.approx(expected, abs=1e-12)
    # a sum of constants leaves nothing, not even rounding, in whatever unit
    constants = np.array([1e5 / 3, 1e-5 / 3])[:, None] * np.repeat([1.1, 0.9, 1.3], 4)[place]
    assert np.all(without_carried(horizon.carried(np.zeros(11, int), horizon.time[place], np.full(11, 0.1)), constants) == 0)


def test_the_level_of_a_closed_tank_is_compared_within_segments_of_about_a_period(tmp_path: Path) -> None:
    """A lost flow of 1 % of the pump adds up to 20 mm. An error of the level stays: the residual of a segment is the plain
    one less its mean."""
    plain = written(tmp_path, CLOSED, 0.3)
    cut = with_horizons(plain, {})
    horizon = cut.horizons["one"]
    count = int(horizon.segment[-1]) + 1
    # the correlation time of a sine is the arc cosine of 1/e over 2 pi: 0.19 periods
    assert 400 / count == pytest.approx(5 * 0.19 * PERIOD, rel=0.15)
    assert np.ptp(horizon.responses[0, horizon.segment == 3, 0]) < 1e-6 * np.abs(horizon.responses).max()
    record = plain.records["one"]
    before, after = (Run(e, record, []).residuals({})[0] for e in (plain, cut))
    segment = horizon.segment[:len(before)]
    means = np.array([before[segment == k].mean() for k in range(count)])
    assert after == pytest.approx(before - means[segment], abs=1e-6)
    with pytest.raises(Exceeded):
        Run(cut, record, []).residuals({}, float(after @ after) / 2)
    compared = compare(cut)
    assert ladder_entry("", compared).chi2_fit == pytest.approx(float(after @ after) / len(after), rel=1e-3)
    assert ladder_entry("", Comparison(plain, compared.records)).chi2_fit == pytest.approx(
        float(before @ before) / len(before), rel=1e-3)
    assert "within segments of" in horizon_words(cut)[0] and not horizon_words(plain)


def test_the_length_of_the_segments_follows_from_the_measured_motion(tmp_path: Path) -> None:
    """The diagram has a flow that grows over the whole record, ten times as large in the end as that of the pump. Its
    simulated level moves slowly, the measured one in periods of 40 s."""
    growing = CLOSED.replace("nodes: {inlet: [pump.a,", "  error: {is: FlowSource, u: \"=300 L/min*time/(400 s)\"}\n"
                             "nodes: {inlet: [pump.a, error.a,")
    drifting, plain = (with_horizons(written(tmp_path, model, flow), {}) for model, flow in ((growing, 0.0), (CLOSED, 2.0)))
    counts = [int(cut.horizons["one"].segment[-1]) + 1 for cut in (drifting, plain)]
    assert counts[0] == pytest.approx(counts[1], abs=1) and counts[0] > 5


@pytest.mark.parametrize(("chi2", "share", "within_segments", "kept"), [
    (1.0, 1.0, [False], True), (3.0, 1.0, [False], True), (50.0, 1.0, [False, True], False),
    (50.0, 0.6, [False, True], False), (50.0, 0.4, [False, True], True)])
def test_segments_are_searched_if_the_effects_do_not_explain_the_whole_records(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch, chi2: float, share: float, within_segments: list[bool],
        kept: bool) -> None:
    """`share`: misfit within the segments of the effects on whole records, of the misfit of the effects within segments. A
    vessel whose leak shows over the whole record, and in the segments of its fitted part only, keeps the leak."""
    plain = written(tmp_path, CLOSED, 0.3)
    searched = []

    def search(state: phases.State, task: phases.Task, kept: float) -> Iterator[phases.State]:
        searched.append(bool(state.experiment.horizons))
        chosen: Any = SimpleNamespace(experiment=plain, chi2_fit=chi2, chi2_held_out=chi2, samples_held_out=401, samples=401)
        last: Any = SimpleNamespace(partial=False, trials=(), left=SimpleNamespace(significant=True))
        yield replace(state, last=last, selection=(cast(SelectedEffect, SimpleNamespace(chosen=chosen)),))

    monkeypatch.setattr(phases, "_search", search)
    monkeypatch.setattr(phases, "_misfit_within", lambda cut, state: 1.0 if state.experiment.horizons else share)
    state = phases.State(plain, plain, models=(ladder_entry("vessel", compare(plain)),))
    task: Any = SimpleNamespace(budget=Budget(np.inf), say=lambda text: None)
    *_, found = phases.search(state, task)
    assert searched == within_segments and bool(found.experiment.horizons) is not kept
    if found.experiment.horizons:  # the table of models refers to the segments
        assert found.models[-1].chi2_fit < state.models[-1].chi2_fit / 10


def test_the_result_on_whole_records_is_the_answer_until_an_effect_is_refitted_within_segments(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The time ends during the scores within the segments, or after its first refit."""
    plain = written(tmp_path, CLOSED, 0.3)
    for trials in ((), (SimpleNamespace(),)):
        def search(state: phases.State, task: phases.Task, kept: float, of: Any = trials) -> Iterator[phases.State]:
            within = bool(state.experiment.horizons)
            last: Any = SimpleNamespace(partial=within, trials=of, left=SimpleNamespace(significant=True))
            chosen: Any = SimpleNamespace(experiment=plain, chi2_fit=50.0, chi2_held_out=50.0, samples_held_out=401)
            effect = cast(SelectedEffect, SimpleNamespace(chosen=chosen))
            yield replace(state, last=last, selection=() if within else (effect,))

        monkeypatch.setattr(phases, "_search", search)
        monkeypatch.setattr(phases, "_misfit_within", lambda cut, state: 1.0)
        task: Any = SimpleNamespace(budget=Budget(np.inf), say=lambda text: None)
        *_, found = phases.search(phases.State(plain, plain, models=(ladder_entry("vessel", compare(plain)),)), task)
        assert bool(found.experiment.horizons) == bool(trials) and (SEGMENTS in found.untried) != bool(trials)


def test_a_short_record_that_is_not_fitted_is_one_segment(tmp_path: Path) -> None:
    """The drift within it is no evidence either; two fitted segments would be too few."""
    plain = written(tmp_path, CLOSED, 0.3)
    one, two = plain.records["one"], plain.records["two"]
    cut = with_horizons(replace(plain, records={"one": one, "two": replace(two, end=50.0)}), {})
    assert int(cut.horizons["two"].segment[-1]) == 0 < int(cut.horizons["one"].segment[-1])
    short = replace(plain, records={"one": replace(one, end=110.0), "two": two})
    assert with_horizons(short, {}) is short


def test_records_of_a_machine_that_forgets_its_state_are_compared_whole(tmp_path: Path) -> None:
    plain = written(tmp_path, OPEN, 0.3)
    assert with_horizons(plain, {}) is plain


def test_records_without_drift_are_compared_whole(tmp_path: Path) -> None:
    plain = written(tmp_path, CLOSED, 0.0)
    assert with_horizons(plain, {}) is plain


@pytest.mark.parametrize("stiffness", [1000.0, 0.0])
def test_an_oscillator_without_damping_is_compared_whole(tmp_path: Path, stiffness: float) -> None:
    """A load on a spring, of which the diagram lacks the damping. Its error does not decay but adds up nothing, and within a
    period the damping hardly shows. Without the spring the same load integrates the lost force."""
    (tmp_path / "vessel.yaml").write_text(f"""
model: load
components:
  drive: {{is: ForceSource, u: 0 N}}
  frame: {{is: Fixed}}
  spring: {{is: Spring, c: {stiffness} N/m}}
  load: {{is: Mass, m: 10 kg}}
nodes: {{load: [drive.a, spring.b, load.a], frame: [frame.a, spring.a]}}
initial: {{load.x: {stiffness / 2e4} m, load.v: 0 m/s}}
""")
    (tmp_path / "vessel_records.yaml").write_text(EXPERIMENT.replace(
        "pump.u: {column: q, unit: L/min", "drive.u: {column: F, unit: N").replace("tank.h, column: h", "load.x, column: x"))
    t = np.linspace(0, 20, 2001)
    drive = 100 * np.sin(t) * (not stiffness)
    # the amplitude decays with a damping of 1 N*s/m; without the spring a force of 0.4 N is lost
    x = 0.05 * np.exp(-t / 20) * np.cos(10 * t) if stiffness else 10 * t - 10 * np.sin(t) - 0.02 * t**2
    for name, seed in (("one", 1), ("two", 2)):
        noisy = x + NOISE * np.random.default_rng(seed).standard_normal(len(t))
        np.savetxt(tmp_path / f"{name}.csv", np.column_stack([t, drive, noisy]), delimiter=",", header="t,F,x", comments="")
    plain = with_noise(hb.load_experiment(tmp_path / "vessel_records.yaml"))
    assert (with_horizons(plain, {}) is plain) is bool(stiffness)


def test_records_of_a_machine_without_states_are_compared_whole(tmp_path: Path) -> None:
    """A damper between two measured motions has no state that carries an error."""
    (tmp_path / "vessel.yaml").write_text("""
model: damper
components:
  drive: {is: VelocitySource, u: 0 m/s}
  frame: {is: Fixed}
  damper: {is: Damper, d: 100 N*s/m}
nodes: {rod: [drive.a, damper.b], frame: [frame.a, damper.a]}
""")
    (tmp_path / "vessel_records.yaml").write_text(EXPERIMENT.replace(
        "pump.u: {column: q, unit: L/min", "drive.u: {column: v, unit: m/s").replace(
        "level: {is: tank.h, column: h, unit: m, noise: 1 mm}", "force: {is: damper.F, column: F, unit: N, noise: 0.1 N}"))
    t = np.arange(401) / 100
    for name, amplitude in (("one", 0.3), ("two", 0.2)):
        v = amplitude * np.sin(2 * np.pi * t)
        F = 100 * v + 5 * np.tanh(v / 1e-2)
        np.savetxt(tmp_path / f"{name}.csv", np.column_stack([t, v, F]), delimiter=",", header="t,v,F", comments="")
    plain = with_noise(hb.load_experiment(tmp_path / "vessel_records.yaml"))
    assert with_horizons(plain, {}) is plain


SLED = """
model: sled
components:
  push: {is: ForceSource, u: 0 N}
  sled: {is: Mass, m: 10 kg}
  DAMPER
nodes: {sled: [push.a, sled.a END}
initial: {sled.x: 0 m, sled.v: 0 m/s}
"""


@pytest.mark.parametrize(("damping", "count"), [(0.0, 2), (0.025, 2), (5.0, 1)])
def test_a_sled_carries_its_position_and_without_much_friction_its_speed_too(tmp_path: Path, damping: float, count: int
                                                                             ) -> None:
    """A force of 1 mN that the diagram lacks. The speed decays in m/d = 400 s or 2 s of a record of 200 s. An error of the
    speed and of the position cancel each other at some time, but neither decays."""
    t = np.arange(0, 200, 0.5)
    law = f"ice: {{is: Damper, d: {damping} N*s/m}}\n  frame: {{is: Fixed}}" if damping else ""
    model = SLED.replace("DAMPER", law).replace(" END", ", ice.b], frame: [ice.a, frame.a]" if damping else "]")
    (tmp_path / "sled.yaml").write_text(model)
    (tmp_path / "truth.yaml").write_text(model.replace("u: 0 N", 'u: "=1 N*cos(2*pi*time/10 s) + 0.001 N"'))
    x = np.asarray(hb.simulate(tmp_path / "truth.yaml", until=199.5, every=0.5)["sled.x"])
    x = x + NOISE * np.random.default_rng(1).standard_normal(len(t))
    np.savetxt(tmp_path / "a.csv", np.column_stack([t, np.cos(2*np.pi*t/10), x]), delimiter=",", header="t,u,x", comments="")
    (tmp_path / "e.yaml").write_text("""experiment: sled
model: sled.yaml
records: {a: {file: a.csv, use: fit}}
time: {column: t, unit: s}
inputs: {push.u: {column: u, unit: N, interpolation: spline}}
outputs: {sled.x: {column: x, unit: m, noise: 1 mm}}
""")
    cut = with_horizons(with_noise(hb.load_experiment(tmp_path / "e.yaml")), {})
    assert cut.horizons["a"].responses.shape[2] == count
