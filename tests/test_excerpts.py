"""Long records are searched on their beginning, and what is found is fitted to all of them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import heavebond as hb
from heavebond.estimation import excerpts
from heavebond.estimation.comparison import Comparison

EXPERIMENT = hb.load_experiment("receiver_rig/choked")


@pytest.fixture(scope="module")
def compared() -> Comparison:
    return hb.compare(EXPERIMENT)


def quiet_first(compared: Comparison, share: float) -> Comparison:
    """The same with a model that misses nothing in the first part of the fitted record, and the rest by five times the
    noise."""
    record = compared.records["train"]
    channels = {n: replace(c, model=c.measured + 5*c.noise*(c.time >= share*c.time[-1]))
                for n, c in record.channels.items()}
    return replace(compared, records={**compared.records, "train": replace(record, channels=channels)})


def test_short_records_are_searched_whole(compared: Comparison) -> None:
    assert excerpts.excerpt(EXPERIMENT, compared) is EXPERIMENT
    assert excerpts.cut(EXPERIMENT, EXPERIMENT) == ""


def test_the_beginning_is_cut_and_the_whole_comes_back(compared: Comparison) -> None:
    points = len(compared.records["train"].result.time)
    part = excerpts.excerpt(EXPERIMENT, quiet_first(compared, 0), points//4 + 1)
    grid = compared.records["train"].result.time
    assert part.records["train"].end == pytest.approx(grid[points//4])
    assert part.records["train"].begin is None
    # of a record that only checks twice as much is looked at, and more as its beginning is quiet
    checked = part.records["validate"].end
    assert checked is not None and grid[2*(points//4)] < checked < grid[-1]
    assert excerpts.as_long_as(EXPERIMENT, part) == EXPERIMENT
    assert excerpts.cut(part, EXPERIMENT).startswith("train up to 20 s, validate up to ")


def test_a_quiet_beginning_makes_the_excerpt_longer(compared: Comparison) -> None:
    grid = compared.records["train"].result.time
    points = len(grid)
    cut = excerpts.excerpt(EXPERIMENT, quiet_first(compared, 0.3), points//5).records["train"].end
    assert cut is not None and 0.3*grid[-1] < cut < 0.8*grid[-1]
    # but never longer than four times what was asked for
    most = excerpts.excerpt(EXPERIMENT, quiet_first(compared, 0.95), points//5).records["train"].end
    assert most == pytest.approx(grid[4*(points//5) - 1])


def test_of_a_run_with_many_evaluations_between_two_samples_less_is_looked_at(compared: Comparison,
                                                                               monkeypatch: pytest.MonkeyPatch) -> None:
    """Samples count as often as their evaluations ask for, but not where it is said how many are to be looked at."""
    wrong = quiet_first(compared, 0)
    points = len(compared.records["train"].result.time)  # 2001

    def taking(evaluations: float) -> Comparison:
        record = wrong.records["train"]
        result = replace(record.result, statistics={"nfevals": round(evaluations * points)})
        return replace(wrong, records={**wrong.records, "train": replace(record, result=result)})

    assert excerpts.excerpt(EXPERIMENT, taking(14.4 * excerpts.EXCERPTS.evaluations)) is EXPERIMENT
    grid = compared.records["train"].result.time
    for least, end in ((100, 5000 // 20), (400, 400)):
        monkeypatch.setattr(excerpts, "EXCERPTS", replace(excerpts.EXCERPTS, least=least))
        part = excerpts.excerpt(EXPERIMENT, taking(20 * excerpts.EXCERPTS.evaluations))
        assert part.records["train"].end == pytest.approx(grid[end - 1])
    assert excerpts.excerpt(EXPERIMENT, taking(20 * excerpts.EXCERPTS.evaluations), points) is EXPERIMENT
    # a large misfit needs few samples
    monkeypatch.setattr(excerpts, "EXCERPTS", replace(excerpts.EXCERPTS, long_clear=points - 1, excerpt=500))
    assert excerpts.excerpt(EXPERIMENT, wrong).records["train"].end == pytest.approx(grid[499])
    monkeypatch.setattr(excerpts, "EXCERPTS", replace(excerpts.EXCERPTS, clear=200.0))  # chi-square is 181
    assert excerpts.excerpt(EXPERIMENT, wrong) is EXPERIMENT
    assert excerpts.excerpt(EXPERIMENT, taking(20 * excerpts.EXCERPTS.evaluations)) is EXPERIMENT


@pytest.mark.long
def test_what_does_not_show_at_the_beginning_is_sought_in_all() -> None:
    """The first 24 s of the vessel are told by another flow coefficient."""
    found = hb.diagnose(EXPERIMENT, classes=["choked flow"], samples=300, number=1)
    assert found.findings[0].kinds == ("choked flow",)
    assert found.steps[0].samples == found.findings[0].fit.samples == 2001
    assert not any("beginning" in line for line in found.words)


RIG = """
model: rig
components:
  push:   {is: ForceSource, u: "=5 N*sin(2*pi*time/1.3 s) + 2 N*sin(2*pi*time/0.4 s)"}
  load:   {is: Mass, m: 2 kg}
  spring: {is: Spring, c: 200 N/m}
  damper: {is: Damper, d: 4 N*s/m}
  wall:   {is: Fixed}
nodes:
  load: [push.a, load.a, spring.a, damper.a]
  wall: [wall.a, spring.b, damper.b]
initial: {load.x: 0 m, load.v: 0 m/s}
simulate: {until: 30 s, every: 20 ms}
"""
SPEED = """
experiment: a tachometer without sign
model: rig.yaml
records: {one: {file: one.csv, use: fit}}
time: {column: t, unit: s}
inputs: {push.u: {column: push, unit: N, interpolation: spline}}
outputs: {load.v: {column: speed, unit: mm/s, noise: 2 mm/s}}
free: {damper.d: 4 N*s/m +- 50 %}
"""


@pytest.mark.long
def test_what_is_found_on_an_excerpt_is_fitted_to_all(tmp_path: Path) -> None:
    """A sensor that counts pulses gives the size of the speed alone."""
    run = hb.simulate(hb.loads(RIG), parameters={"damper.d": 3})
    speed = np.abs(1e3*run["load.v"]) + 2*np.random.default_rng(3).standard_normal(len(run.time))
    rows = [f"{a:.2f},{b:.6f},{c:.3f}" for a, b, c in zip(run.time, run["push.u"], speed, strict=True)]
    for name, text in (("rig.yaml", RIG), ("speed.yaml", SPEED), ("one.csv", "\n".join(["t,push,speed", *rows]))):
        (tmp_path / name).write_text(text)
    found = hb.diagnose(tmp_path / "speed.yaml", classes=["gain by direction"], samples=600, number=1)
    assert (found.verdict, found.findings[0].candidate.label) == ("effect", "SidedGain in the channel load.v")
    # 1000 samples are fitted of 1501, to 2 mm/s of some 200 each
    assert found.findings[0].parameters[0].value == pytest.approx(-2, abs=0.01)
    assert found.findings[0].fit.experiment.records["one"].end is None
    assert (found.steps[0].samples, found.findings[0].fit.samples) == (400, 1000)
    assert "used their beginning (one up to 11.98 s), and the effects were" in found.words[-1]
    assert found.searched.records["one"].end == pytest.approx(11.98)
