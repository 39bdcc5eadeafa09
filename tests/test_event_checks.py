"""Conditions that rise and fall between two output points: found where the steps of the integrator show them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from diagrams import PEAKS

import heavebond as hb

THROWN = """
component: Thrown
summary: A body that is thrown upwards and counts how often it comes above a height.
parameters: {g: {unit: m/s**2, doc: gravity}, top: {unit: m, doc: height}}
variables:
  x: {unit: m, doc: height}
  v: {unit: m/s, doc: speed}
  n: {unit: 1, held: 0, doc: how often}
equations: |
  der(x) = v     # motion
  der(v) = -g    # fall
when:
  above: {condition: x > top, then: {n: n + 1}}
"""
RESONANCE = """
component: Resonance
summary: A response that is large for a moment.
parameters: {t_0: {unit: s, doc: when}, w: {unit: s, doc: half of its width}}
variables:
  s: {unit: s, doc: time}
  p: {unit: 1, doc: response}
  q: {unit: s, doc: its integral}
  n: {unit: 1, held: 0, doc: how often it was above a half}
equations: |
  der(s) = 1                             # a state, so that nothing is known of it beforehand
  p = 1/(1 + ((s - t_0)/w)**2)           # response
  der(q) = p                             # integral
when:
  half: {condition: p > 1/2, then: {n: n + 1}}
"""


def run(folder: Path, component: str, arguments: str, initial: str, until: str, every: str,
        rtol: float = 1e-8) -> hb.Result:
    name = component.split()[1]
    (folder / f"{name.lower()}.yaml").write_text(component, encoding="utf-8")
    return hb.simulate(hb.loads(f"model: checks\ncomponents: {{p: {{is: {name}, {arguments}}}}}\ninitial: {{{initial}}}\n"
                                f"simulate: {{until: {until}, every: {every}}}", folder), rtol=rtol, atol=rtol/100)


@pytest.mark.parametrize("solver", ["idas", "cvodes"])
def test_a_pulse_far_shorter_than_a_thousandth_of_the_run(tmp_path: Path, solver: str) -> None:
    # two hundredths of an output interval
    found = run(tmp_path, RESONANCE, "t_0: 5.0037 s, w: 0.1 ms", "p.s: 0 s, p.q: 0 s", f"10 s, solver: {solver}", "10 ms")
    assert [time for time, _ in found.events] == [pytest.approx(5.0037 - 1e-4, abs=1e-9)]


def test_an_oscillation_with_three_output_points_a_period(tmp_path: Path) -> None:
    found = run(tmp_path, PEAKS, "w: 1884.955592 1/s, level: 0.99", "p.x: 0, p.y: 1", "0.2 s", "1 ms", 1e-10)
    wanted = (np.arcsin(0.99) / (2 * np.pi) + np.arange(60)) / 300
    assert np.array([time for time, _ in found.events]) == pytest.approx(wanted, abs=1e-7)  # of 3 ms, errors of phase add up


@pytest.mark.parametrize("depth", [1e-4, 1e-6, 1e-8])
def test_a_parabola_that_passes_a_height_by_a_little(tmp_path: Path, depth: float) -> None:
    g, v = 9.81, 20.0
    top = v**2 / (2 * g) - depth
    start = f"p.x: 0 m, p.v: {v} m/s"
    found = run(tmp_path, THROWN, f"g: {g} m/s**2, top: {top!r} m", start, "4 s", "20 ms", 1e-12)
    # 1e-11 of 20 m beside a depth of 1e-8 m
    assert [time for time, _ in found.events] == [pytest.approx(v / g - np.sqrt(2 * depth / g), abs=1e-5)]
    below = run(tmp_path, THROWN, f"g: {g} m/s**2, top: {top + 2 * depth!r} m", start, "4 s", "20 ms", 1e-12)
    assert not below.events


def test_the_pile_sticks_between_two_output_points() -> None:
    # the pile rests for 0.6 ms; instants of a run with an output every 0.1 ms
    found = hb.simulate("circuits/pile_driver", 2.3)
    assert [name for _, name in found.events if name == "soil.stick"] == 3 * ["soil.stick"]
    times = [time for time, name in found.events if name in ("soil.stick", "soil.slide")]
    assert times == pytest.approx([2.206154224, 2.228443272, 2.229032568, 2.240045843, 2.241751003, 2.247306237], abs=1e-6)
