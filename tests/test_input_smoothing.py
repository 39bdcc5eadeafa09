"""Smoothing of measured inputs that a model differentiates."""

from __future__ import annotations

import numpy as np
import pytest

from heavebond.core.errors import ModelError
from heavebond.estimation.comparison import assemble_for
from heavebond.estimation.experiment import experiment_from_source
from heavebond.estimation.input_smoothing import proposed_smoothing, with_smoothed_inputs
from heavebond.records.piecewise import evaluate, smoothed_pieces
from heavebond.text.yaml_source import parse

EXPERIMENT = """experiment: rig
model: passive_rig/passive_rig.yaml
records: {train: {file: record.csv, use: fit}}
time: {column: t, unit: s}
inputs:
  vessel.u: {column: u, unit: m, interpolation: INTERPOLATION, smooth: SMOOTH}
outputs:
  crown.x: {is: crown.x, column: x, unit: m, noise: 1 mm}
"""


@pytest.mark.parametrize("frequency", [0.2, 1.0, 4.0])
def test_the_gain_of_smoothing_is_a_half_at_the_bandwidth_without_a_phase_shift(frequency):
    time = np.linspace(0, 100, 5001)
    signal = np.sin(2 * np.pi * frequency * time)
    middle = time[1500:3500]
    smooth = evaluate(smoothed_pieces(time, signal, "spline", 1.0), middle)
    # the ends of the record and the samples in a period (at least 12) let it err by less
    assert smooth == pytest.approx(np.sin(2 * np.pi * frequency * middle) / (1 + frequency**4), abs=1e-4)


def record(folder, noise: float, step: float) -> None:
    random, time = np.random.default_rng(1), np.arange(0, 120, 0.04)
    heave = 0.5 * np.sin(2 * np.pi * time / 12) + noise * random.standard_normal(len(time))
    heave = np.round(heave / step) * step if step else heave
    np.savetxt(folder / "record.csv", np.column_stack([time, heave, 0 * time]), delimiter=",", header="t,u,x", comments="",
               fmt="%.9g")


def loaded(folder, interpolation: str = "spline", smooth: str = "0.5 Hz"):
    text = EXPERIMENT.replace("INTERPOLATION", interpolation).replace("SMOOTH", smooth)
    return experiment_from_source(parse(text, folder / "rig.yaml", "rig.yaml"), ())


def proposal(folder):
    experiment = loaded(folder).inputs["vessel.u"]
    from dataclasses import replace

    from heavebond.records.time_axis import TimeAxis
    return proposed_smoothing(replace(experiment, file=folder / "record.csv", time=TimeAxis("t"), smooth=None))


def test_noise_and_steps_of_a_position_are_seen_and_a_clean_one_is_left_alone(tmp_path):
    record(tmp_path, 3e-3, 5e-3)
    found = proposal(tmp_path)
    # noise of 3 mm and rounding to 5 mm, 1.44 mm: together 3.33 mm; an estimate from 3000 samples errs by some percent
    assert found is not None and found.noise == pytest.approx(3.33e-3, rel=0.1) and found.step == pytest.approx(5e-3)
    assert 0.3 < found.bandwidth < 3  # above the period of 12 s, far below the 12.5 Hz of the samples
    record(tmp_path, 0, 0)
    assert proposal(tmp_path) is None


@pytest.mark.parametrize(("interpolation", "smooth", "message"), [
    ("spline", "5 rad/s", "smooth"), ("spline", "-1 Hz", "is not a frequency above 0"),
    ("hold", "5 Hz", "an input that is held from sample to sample"),
])
def test_a_wrong_bandwidth_is_reported_with_its_line(tmp_path, interpolation, smooth, message):
    record(tmp_path, 0, 0)
    with pytest.raises(ModelError) as caught:
        loaded(tmp_path, interpolation, smooth)
    assert message in str(caught.value) and "rig.yaml:6:" in str(caught.value)


FORCE = """experiment: driven mass
model: driven.yaml
records: {train: {file: record.csv, use: fit}}
time: {column: t, unit: s}
inputs:
  drive.u: {column: u, unit: m/s, interpolation: linear}
outputs:
  CHANNEL: {column: x, unit: UNIT, noise: 1}
"""
DRIVEN = """model: driven
components:
  drive: {is: VelocitySource, u: 0 m/s}
  cell:  {is: ForceSensor}
  load:  {is: Mass, m: 2 kg}
nodes:
  drive: [drive.a, cell.a]
  load:  [cell.b, load.a]
simulate: {until: 1 s}
"""


@pytest.mark.parametrize(("channel", "unit", "smoothed"), [("cell.y", "N", True), ("load.v", "m/s", False)])
def test_a_speed_whose_derivative_is_in_a_channel_only_is_smoothed(tmp_path, channel, unit, smoothed):
    """The force on a mass with a prescribed speed is in no differential equation of the model."""
    record(tmp_path, 3e-3, 0)
    (tmp_path / "driven.yaml").write_text(DRIVEN)
    text = FORCE.replace("CHANNEL", channel).replace("UNIT", unit).replace("noise: 1", f"noise: 1 {unit}")
    experiment = experiment_from_source(parse(text, tmp_path / "exp.yaml", "exp.yaml"), ())
    found, said = with_smoothed_inputs(experiment, assemble_for(experiment, experiment.records["train"]))
    assert (found.inputs["drive.u"].smooth is not None, bool(said)) == (smoothed, smoothed)
