"""State estimation: the Kalman filter beside independent filters and least squares, its consistency over many seeds, and the
moving horizon estimator beside the fit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from oscillator import NOISE, STEP, C, D, disturbance, exact, write_experiment, write_record
from scipy.stats import chi2

import heavebond as hb
from heavebond.core.errors import UsageError
from heavebond.estimation.experiment import Experiment
from heavebond.monitoring.kalman_filter import Estimator
from heavebond.monitoring.moving_horizon import moving_horizon


@pytest.fixture
def rig(tmp_path: Path) -> Experiment:
    return hb.load_experiment(write_experiment(tmp_path))


def test_a_linear_machine_is_filtered_as_by_an_independent_kalman_filter(rig: Experiment) -> None:
    estimator = Estimator(rig, walks={"body.v": "0.3 m/s"}, start_deviation=0.1)
    estimate = estimator.run()
    table = np.loadtxt(rig.records["first"].file, delimiter=",", skiprows=1)
    order = [estimator.assembly.state_names.index(name) for name in ("body.x", "body.v")]
    nominal = estimator.assembly.x_nominal[order]
    x, p = np.array([0.1, 0.0]), np.diag((0.1 * estimator.reference.span[order] * nominal) ** 2)
    phi, gamma = exact(STEP)
    q = disturbance(0.3)
    nis = 0.0
    for i, (_, u, place, speed) in enumerate(table):
        e = np.array([place / 1000, speed]) - x
        s = p + np.diag(NOISE**2)
        gain = p @ np.linalg.inv(s)
        nis += e @ np.linalg.solve(s, e)
        x, p = x + gain @ e, (np.eye(2) - gain) @ p
        # tolerances: the integration by collocation errs by (h w)**6, 4e-4 of 1e-3 of a state at most
        got = np.array([estimate.values[n][i] for n in ("body.x", "body.v")])
        assert got == pytest.approx(x, rel=1e-5, abs=1e-7)
        deviation = np.array([estimate.deviations[n][i] for n in ("body.x", "body.v")])
        assert deviation == pytest.approx(np.sqrt(np.diag(p)), rel=1e-5)
        x, p = phi @ x + gamma * u, phi @ p @ phi.T + q
    assert estimate.consistency.nis == pytest.approx(nis, rel=1e-5)


def test_a_constant_parameter_is_the_least_squares_fit(rig: Experiment) -> None:
    """Without process noise and with a known start the filter at the end of the record is the fit of all samples, and a
    horizon of the whole record is this fit."""
    estimator = Estimator(rig, walks={"spring.c": 0, "damper.d": 0}, start_deviation=0)
    estimate, whole = estimator.run(), moving_horizon(estimator)
    fit = hb.fit(replace(rig, records={"first": replace(rig.records["first"], use="fit"),
                                       "copy": replace(rig.records["first"], name="copy", use="validate")}))
    for parameter in fit.parameters:
        last, deviation = estimate.values[parameter.name][-1], estimate.deviations[parameter.name][-1]
        # the filter linearises each sample about the estimate at that time: an error of second order in the deviations
        assert last == pytest.approx(parameter.value, abs=0.1 * deviation)
        assert abs(last - {"spring.c": C, "damper.d": D}[parameter.name]) < 4 * deviation
        values = whole.values[parameter.name]
        # the optimum of one cost by two methods; both stop at relative changes of about 1e-6
        assert values == pytest.approx(np.full(len(values), parameter.value), rel=1e-4)


def test_a_short_horizon_of_a_linear_machine_ends_at_the_estimate_of_the_filter(rig: Experiment) -> None:
    """A linear machine has one posterior distribution: the last sample of a window, with the arrival cost of the filter, is
    the estimate of the filter. Process noise is added once a step here, and continuously by the filter: it is small."""
    estimator = Estimator(rig, walks={"body.v": "10 mm/s"}, start_deviation=0.1)
    filtered, windows = estimator.run(), moving_horizon(estimator, horizon="2 s")
    assert windows.values["body.x"][-1] == pytest.approx(filtered.values["body.x"][-1], abs=0.05 * NOISE[0])
    # within its window a sample is estimated from later ones too: it is nearer to the truth than the filter
    truth = write_record(rig.records["first"].file, 1)[:, 0]
    errors = [np.std(e.values["body.x"] - truth) for e in (filtered, windows)]
    assert errors[1] < errors[0]


def test_the_innovations_are_white_with_the_stated_size_over_many_seeds(rig: Experiment, tmp_path: Path) -> None:
    """The sum of NIS over independent records is chi-square; each estimate errs by its standard deviation."""
    estimator = Estimator(rig, walks={"body.v": "0.5 m/s"}, start_deviation=0.1)
    deviations = 0.1 * estimator.reference.span * estimator.assembly.x_nominal
    total, samples, outside, errors = 0.0, 0, 0, []
    for seed in range(20):
        file = tmp_path / f"{seed}.csv"
        random = np.random.default_rng([seed, 7])
        truth = write_record(file, seed, count=100, intensity=0.5)
        # the start of the record is drawn as the filter assumes, by a shift of the start of the diagram
        shift = deviations[[estimator.assembly.state_names.index(n) for n in ("body.x", "body.v")]] * random.normal(size=2)
        table = np.loadtxt(file, delimiter=",", skiprows=1)
        free = np.array([np.linalg.matrix_power(exact(STEP)[0], i) @ shift for i in range(100)])
        table[:, 2:] += free * [1000, 1]
        np.savetxt(file, table, fmt="%.17g", delimiter=",", header="t,u,x,v", comments="")
        estimate = estimator.run(replace(estimator.record, name=str(seed), file=file))
        total, samples = total + estimate.consistency.nis, samples + estimate.consistency.samples
        outside += not estimate.consistency.low <= estimate.consistency.nis <= estimate.consistency.high
        errors.append((estimate.values["body.x"] - (truth + free)[:, 0])[-1] / estimate.deviations["body.x"][-1])
    assert chi2.ppf(1e-3, samples) < total < chi2.ppf(1 - 1e-3, samples)
    assert outside <= 4  # of 20 records 5 % are outside; 5 or more have a probability of 0.3 %
    assert chi2.ppf(1e-3, 20) < np.sum(np.square(errors)) < chi2.ppf(1 - 1e-3, 20)


def test_a_random_walk_follows_a_parameter_that_changes(rig: Experiment, tmp_path: Path) -> None:
    write_record(tmp_path / "softer.csv", 3, count=400, stiffness={200: 40.0})
    estimator = Estimator(rig, walks={"spring.c": "3 N/m"})
    estimate = estimator.run(replace(estimator.record, file=tmp_path / "softer.csv"))
    stiffness, deviation = estimate["spring.c"], estimate.deviation("spring.c")
    assert abs(stiffness[190] - 50) < 3 * deviation[190]
    assert abs(stiffness[-1] - 40) < 3 * deviation[-1]
    assert deviation[-1] < 3  # it is determined far better than by its prior, 5 N/m
    # within the walk of the parameter the innovations remain about as the filter expects
    assert estimate.consistency.nis / estimate.consistency.samples < 1.3


def test_samples_of_a_running_machine_give_the_estimates_of_the_record(rig: Experiment) -> None:
    walks: Mapping[str, float | str] = {"body.v": "0.1 m/s", "spring.c": "1 N/m"}
    estimate = Estimator(rig, walks=walks).run()
    online = Estimator(rig, walks=walks)
    for i, (time, u, place, speed) in enumerate(np.loadtxt(rig.records["first"].file, delimiter=",", skiprows=1)[:60]):
        one = online.step(time, {"motor.u": u}, {"body.x": place, "body.v": speed})
        for name, value in one.values.items():
            assert value == pytest.approx(estimate.values[name][i], rel=1e-9, abs=1e-12)
    assert one.nis == pytest.approx(sum(v[i] ** 2 for v in estimate.innovations.values()))


def test_samples_are_read_with_their_units_and_names(rig: Experiment) -> None:
    """A number is in the unit of its column, a text has its own; an input that is no number would
    spoil all later estimates."""
    numbers, texts = Estimator(rig), Estimator(rig)
    for k in range(3):
        one = numbers.step(0.1 * k, {"motor.u": 2.0}, {"body.x": 10.0 * k})
        other = texts.step(f"{100 * k} ms", {"motor.u": "2000 mN"}, {"body.x": f"{k} cm", "body.v": float("nan")})
    assert other.values == pytest.approx(one.values, rel=1e-9)
    for time, inputs, outputs, message in (
            (1.0, {"motor.u": "2 m"}, {}, "unit-wrong"), (1.0, {"motor.u": 1.0}, {"body.x": "1 s"}, "unit-wrong"),
            (1.0, {"motor.u": float("nan")}, {}, "input-value"), (1.0, {"motor.u": float("inf")}, {}, "input-value"),
            (1.0, {"motor.v": 1.0, "motor.u": 1.0}, {}, "there is no input 'motor.v'"), (float("inf"), {"motor.u": 1.0}, {},
                                                                                         "time-order"),
            ("now", {"motor.u": 1.0}, {}, "Write for example `1 s`"), (0.1, {"motor.u": 1.0}, {}, "time-order")):
        with pytest.raises(UsageError, match=message):
            texts.step(time, inputs, outputs)
    assert texts.step(0.3, {"motor.u": 2.0}, {}).values == pytest.approx(numbers.step(0.3, {"motor.u": 2.0}, {}).values)
    assert "body.x" in repr(texts)
    with pytest.raises(UsageError, match="estimator-needed"):
        hb.moving_horizon("rig.yaml")  # type: ignore[arg-type]


@pytest.mark.parametrize(("walks", "message"), [
    ({"body.y": 1.0}, "'body.y' is neither a state nor a free parameter"),
    ({"body.m": "1 kg"}, "'body.m' is neither a state nor a free parameter"),
    ({"body.v": "1 kg"}, "kg"), ({"body.v": -1.0}, "must be 0 or above")])
def test_process_noise_that_the_machine_does_not_have_is_refused(rig: Experiment, walks: Mapping[str, float | str],
                                                                 message: str) -> None:
    with pytest.raises(UsageError, match=message):
        Estimator(rig, walks=walks)


def test_a_machine_with_events_is_refused(tmp_path: Path, rig: Experiment) -> None:
    late = "  late: {is: ForceSource, u: \"=if_else(time > 3 s, 1 N, 0 N)\"}"
    text = (tmp_path / "oscillator.yaml").read_text()
    text = text.replace("components:", f"components:\n{late}").replace("motor.a]", "motor.a, late.a]")
    (tmp_path / "oscillator.yaml").write_text(text)
    with pytest.raises(UsageError, match="does not support events"):
        Estimator(hb.load_experiment(tmp_path / "rig.yaml"))
