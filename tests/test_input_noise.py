"""Noise of measured inputs: what it does to the channels, and that a right model is not blamed for it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.signal import cont2discrete, lfilter

import heavebond as hb
from heavebond.core.errors import ModelError
from heavebond.diagnosis.candidates.catalogue import single_candidates
from heavebond.diagnosis.evidence.residual_tests import leftover
from heavebond.diagnosis.search.scoring import scored
from heavebond.diagnosis.search.step import fitted_base
from heavebond.estimation.experiment import load_experiment
from heavebond.estimation.feedback import feedback
from heavebond.estimation.input_noise import with_input_noise
from heavebond.estimation.records import measure

RIG = """model: rig
components:
  shaker: {is: PositionSource, u: 0 m}
  spring: {is: Spring, c: 4 kN/m}
  damper: {is: Damper, d: 150 N*s/m}
  load:   {is: Mass, m: 100 kg}
nodes:
  deck: [shaker.a, spring.a, damper.a]
  load: [spring.b, damper.b, load.a]
initial: {load.x: 0 m, load.v: 0 m/s}
"""
MEASURED = """experiment: shaken
model: rig.yaml
records: {one: {file: one.csv, use: fit}}
time: {column: t, unit: s}
inputs: {shaker.u: {column: deck, unit: mm, interpolation: linear NOISE}}
outputs:
  load.x: {column: load, unit: mm, noise: 0.1 mm}
  deck.x: {column: level, unit: mm, noise: 0.1 mm}
free: {spring.c: 4 kN/m +- 20 %, damper.d: 150 N*s/m +- 20 %}
"""
OWN, DECK = 0.1, 0.6  # mm


def shaken(folder: Path, noise: str, seed: int = 0) -> Path:
    """An experiment on a record of the rig whose deck is measured with noise; `noise` is what the experiment says of it."""
    (folder / "rig.yaml").write_text(RIG, encoding="utf-8")
    time = np.arange(401) * 0.02
    random = np.random.default_rng(seed)
    deck = 30 * (np.sin(2 * np.pi * 0.6 * time) + 0.6 * np.sin(2 * np.pi * 1.3 * time + 1) - 0.6 * np.sin(1.0))
    pd.DataFrame({"t": time, "deck": deck}).to_csv(folder / "true.csv", index=False)
    driven = RIG.replace("u: 0 m", "u: {file: true.csv, column: deck, unit: mm, interpolation: linear}")
    run = hb.simulate(hb.loads(driven, folder=folder), until=8.0, every=0.02)
    pd.DataFrame({"t": time, "deck": deck + DECK * random.standard_normal(401),
                  "load": 1e3 * run["load.x"] + OWN * random.standard_normal(401),
                  "level": deck + OWN * random.standard_normal(401)}).to_csv(folder / "one.csv", index=False)
    path = folder / "measured.yaml"
    path.write_text(MEASURED.replace(" NOISE", noise), encoding="utf-8")
    return path


@pytest.mark.long
def test_the_noise_of_an_input_adds_to_that_of_the_channels(tmp_path: Path) -> None:
    """A channel that is the input itself has both noises at each sample; one behind a spring has less of it, and a record
    that a right model explains has chi-square 1 with it and far more without."""
    path = shaken(tmp_path, f", noise: {DECK} mm")
    experiment = with_input_noise(load_experiment(path))
    found = measure(experiment, experiment.records["one"]).channels
    level = found["deck.x"]
    assert level.own_noise == OWN and level.noise == pytest.approx(np.hypot(OWN, DECK), rel=0.05)  # 40 realisations
    assert level.deviation == pytest.approx(np.hypot(OWN, DECK), rel=0.1)     # at each of 401 times
    # white noise of spectral density DECK**2 * 0.02 s behind the transmissibility of a mass on spring and damper
    natural, damping = np.sqrt(4e3 / 100), 150 / (2 * np.sqrt(4e3 * 100))
    behind = DECK * np.sqrt(0.02 * natural * (1 + 4 * damping**2) / (4 * damping))
    late = found["load.x"].deviation[200:]
    assert float(np.sqrt(np.mean(late**2))) == pytest.approx(np.hypot(OWN, behind), rel=0.05)
    told = hb.compare(path).records["one"]
    # 401 samples scatter by 0.07; those of the load are correlated along some ten of them
    assert told.channels["deck.x"].chi2 == pytest.approx(1, abs=0.2)
    assert told.channels["load.x"].chi2 == pytest.approx(1, abs=0.4)
    assert any("% of the variance of deck.x" in note for note in told.notes)
    silent = hb.compare(shaken(tmp_path, "")).records["one"]
    assert silent.channels["deck.x"].chi2 > 20 and not any("noise of the inputs" in note for note in silent.notes)


@pytest.mark.long
def test_a_right_model_is_not_blamed_for_the_noise_of_its_input(tmp_path: Path) -> None:
    """On records of a right model the tests of the residual are significant without the noise of the input, and with it in
    none of three (at 2 % each)."""
    blamed = []
    for seed in range(3):
        experiment = with_input_noise(load_experiment(shaken(tmp_path, f", noise: {DECK} mm", seed)))
        base = fitted_base(experiment)
        tried = ("CoulombFriction", "CubicSpring", "SensorGain")
        chosen = [c for c in single_candidates(experiment) if c.component in tried]
        scores = [s for c in chosen for s in scored(base, c)]
        blamed.append(leftover(base, scores).significant)
        if not seed:
            silent = fitted_base(load_experiment(shaken(tmp_path, "", seed)))
            assert leftover(silent, [s for c in chosen for s in scored(silent, c)]).significant
    assert not any(blamed)


def test_what_is_wrong_with_the_noise_of_an_input_is_told(tmp_path: Path) -> None:
    """Another unit, and a noise that is not above 0."""
    for noise, code in ((", noise: 1 N", "unit-wrong"), (", noise: 0 mm", "noise-not-positive")):
        with pytest.raises(ModelError) as caught:
            load_experiment(shaken(tmp_path, noise))
        assert [p.code for p in caught.value.problems] == [code]


def test_feedback_is_told_and_nothing_else() -> None:
    """An input that reacts to the noise of an output is told, one that a wrong model follows is not."""
    random = np.random.default_rng(2)
    n = 2000
    course, noise = np.cumsum(random.standard_normal(n)) * 0.05, random.standard_normal(n)
    free = np.convolve(random.standard_normal(n), [1, 0.8, 0.5], "same")
    missed = np.convolve(free, [0.0, 0.5, 0.4, 0.3], "full")[:n] + 0.1 * np.maximum(free, 0)  # what a model lacks
    assert feedback(free, missed + 0.2 * noise, 2 * np.convolve(free, [0.5, 0.4], "full")[:n]) is None
    closed = free - 0.6 * np.concatenate([[0.0], noise[:-1]])
    fed = feedback(closed, missed + noise + course, course)
    assert fed is not None and fed.lag == 1 and fed.correlation < -0.2
    at_once = feedback(free - 0.6 * noise, missed + noise + course, course)
    assert at_once is not None and at_once.lag == 0 and at_once.correlation < -0.3
    through = np.convolve(free, [1.0, 0.5, 0.4], "full")[:n]
    assert feedback(free, 0.3 * through + 0.2 * noise, through) is None  # direct transmission, 30 % too small in the model
    for gain in (-1, 9.55):  # a sensor of other sign, or in another unit
        assert feedback(free, gain * through + 0.2 * noise - through, through) is None


@pytest.mark.parametrize(("noise", "quantum"), [(0.01, 0.0), (0.0, 0.02)])
def test_noise_or_quantisation_of_a_measured_input_is_no_closed_loop(noise: float, quantum: float) -> None:
    """The machine, an oscillator at 3 rad/s on a moving foot, follows the smooth input and the model its reading: the
    residual is the response to the noise, and its past tells more of the true input than the past of the reading does. With
    a controller that reads the output there is feedback: it is told."""
    random, n, step = np.random.default_rng(0), 1500, 0.05
    time = step * np.arange(n)
    smooth = sum(random.normal() * np.sin(2 * np.pi * f * time + random.uniform(0, 6.28))
                 for f in np.linspace(0.05, 0.25, 12))
    b, a, _ = cont2discrete(([1.8, 9.0], [1.0, 1.8, 9.0]), step, "foh")
    reading = smooth + noise * random.standard_normal(n)
    reading = quantum * np.round(reading / quantum) if quantum else reading
    sensor, model = 0.001 * random.standard_normal(n), lfilter(b.ravel(), a, reading)
    assert feedback(reading, lfilter(b.ravel(), a, smooth) + sensor - model, model) is None
    controlled = smooth - 5.0 * np.concatenate([[0.0], sensor[:-1]])  # proportional, a sample late
    assert feedback(controlled, sensor, lfilter(b.ravel(), a, controlled)) is not None
