"""Jitter and lost samples of clocks: the instants of a run, their statistics, and what analysis and exports say."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import heavebond as hb
from heavebond.cli import main
from heavebond.core.errors import HeavebondError
from heavebond.exchange.c_code import export_c
from heavebond.numerics.dae import assemble
from heavebond.reports.summary import summary
from heavebond.studio.diagram_edits import Named, renamed_mentions

LOOP = """
model: loop
components:
  plant:  {is: Integrator, k: 1 1/s, u: =hold.y}
  sensor: {is: SampleHold, T_s: 10 ms, u: =plant.y}
  hold:   {is: SampleHold, T_s: 10 ms, u: "=20*(1 - sensor.y)"}
  slow:   {is: SampleHold, T_s: 20 ms, u: =plant.y}
initial: {plant.y: 0}
CLOCKS
show: {plant: {is: plant.y, unit: 1}}
simulate: {until: 4 s, every: 10 ms}
"""


def run(clocks: str) -> hb.Result:
    return hb.simulate(hb.loads(LOOP.replace("CLOCKS", clocks)))


def instants(found: hb.Result, part: str) -> np.ndarray:
    return np.array([time for time, name in found.events if name == f"{part}.sample"])


def test_jitter_delays_each_instant_of_a_clock_and_keeps_its_parts_together() -> None:
    found = run("clocks: {control: {parts: [sensor, hold], jitter: 2 ms, seed: 3}}")
    late = instants(found, "hold") - 0.01 * np.arange(len(instants(found, "hold")))
    assert np.array_equal(instants(found, "hold"), instants(found, "sensor"))
    n = len(late)
    assert n in (400, 401) and late.min() >= 0 and late.max() < 2e-3
    # uniform in [0, J]: mean J/2 and variance J**2/12, within five standard errors
    assert late.mean() == pytest.approx(1e-3, abs=5 * 2e-3 / np.sqrt(12 * n))
    assert late.var() == pytest.approx(4e-6 / 12, rel=5 * np.sqrt(0.8 / n))
    assert abs(np.corrcoef(late[:-1], late[1:])[0, 1]) < 5 / np.sqrt(n)
    assert instants(found, "slow") == pytest.approx(0.02 * np.arange(201), abs=1e-12)  # another clock is regular


def test_lost_samples_are_left_out_and_the_loop_holds_its_value() -> None:
    """y[k + 1] = y[k] + T u[k], with u as it was where a sample is lost."""
    found = run("clocks: {control: {parts: [sensor, hold], lost: 20 %, seed: 1}}")
    taken = np.round(instants(found, "hold") / 0.01).astype(int)
    # binomial, within five standard deviations
    assert 401 - len(taken) == pytest.approx(0.2 * 401, abs=5 * np.sqrt(0.16 * 401))
    y, u, expected = 0.0, 0.0, []
    for k in range(401):
        u = 20 * (1 - y) if k in taken else u
        expected.append(y)
        y += 0.01 * u
    # the integrator of a piecewise constant input errs by rounding
    assert found["plant.y"] == pytest.approx(np.array(expected), abs=1e-6)


def test_the_seed_decides_on_the_instants() -> None:
    first, again, other = (instants(run(f"clocks: {{c: {{parts: [hold], jitter: 1 ms, lost: 0.1, seed: {seed}}}}}"), "hold")
                           for seed in (5, 5, 6))
    assert np.array_equal(first, again)
    assert len(first) != len(other) or not np.array_equal(first, other)


def test_reports_analysis_and_exports_name_an_irregular_clock(tmp_path: Path) -> None:
    text = "clock control (sensor, hold): jitter 2 ms, 1 % of the samples lost, seed 1"
    file = tmp_path / "loop.yaml"
    file.write_text(LOOP.replace("CLOCKS", "clocks: {control: {parts: [sensor, hold], jitter: 2 ms, lost: 1 %}}"))
    assert text in summary(assemble(hb.load(file)), None).sampled
    for command, words in (("run", text), ("modes", f"{text}; the linear system takes its instants as regular")):
        told = CliRunner().invoke(main, [command, str(file), "--json", str(tmp_path / "told.json")])
        assert told.exit_code == 0 and words in " ".join(told.output.split()), told.output
    assert json.loads((tmp_path / "told.json").read_text())["stability"] == "stable"
    with pytest.raises(HeavebondError, match="an export has regular clocks; clock control"):
        export_c(hb.load(file), tmp_path / "loop.c")


@pytest.mark.parametrize(("clocks", "words"), [
    ("clocks: {c: {parts: [plant], jitter: 1 ms}}", "'plant' is not a sampled part"),
    ("clocks: {c: {parts: [holt], jitter: 1 ms}}", "Did you mean 'hold'"),
    ("clocks: {c: {parts: [hold]}}", "has neither jitter nor lost samples"),
    ("clocks: {c: {parts: [hold], jitter: 1 mm}}", "'1 mm' is in mm; s is needed"),
    ("clocks: {c: {parts: [hold], lost: 1}}", "Write a probability below 1"),
    ("clocks: {c: {parts: [hold], lost: 0.1, seed: 1.5}}", "Write a whole number"),
    ("clocks: {c: {parts: [hold], jitter: 10 ms}}", "is not below the period of 'hold.sample', 0.01 s"),
    ("clocks: {c: {parts: [hold, slow], jitter: 1 ms}}", "Give each rate a separate clock"),
    ("clocks: {c: {parts: [hold], jitter: 1 ms}, d: {parts: [hold], lost: 0.1}}", "'hold' has the clocks 'c' and 'd'"),
])
def test_mistakes_in_clocks(clocks: str, words: str) -> None:
    with pytest.raises(HeavebondError) as caught:
        run(clocks)
    assert words in str(caught.value)


def test_a_part_that_is_renamed_keeps_its_clock() -> None:
    text = LOOP.replace("CLOCKS", "clocks: {control: {parts: [sensor, hold], jitter: 2 ms}}")
    named = Named("hold", frozenset({"u", "y"}), True, False)
    assert "parts: [sensor, zoh]" in renamed_mentions(text, named, "zoh", node=False)
