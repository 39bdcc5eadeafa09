"""The start of each record in a fit: values that `each: record` frees begin at those of the record itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import heavebond as hb
from heavebond.core.errors import UsageError
from heavebond.estimation.residuals import Residuals

PENDULUM = """
model: pendulum
components:
  wall: {is: FixedShaft}
  arm:  {is: ArmWeight, m: 1 kg, l: 0.3 m}
  rot:  {is: Inertia, J: 0.1 kg*m**2}
  damp: {is: RotationalDamper, d: 0.002 N*m*s/rad}
nodes:
  wall:  [wall.a, damp.a]
  shaft: [damp.b, arm.a, rot.a]
initial: {shaft.phi: 0.2 rad, shaft.w: 0 rad/s}
simulate: {until: 6 s, every: 20 ms}
"""
SWING = """
model: swing
components:
  wall:   {is: Fixed}
  spring: {is: SpringDamper, c: 4 N/m, d: 0.2 N*s/m, l0: 0 mm}
  load:   {is: Mass, m: 1 kg}
nodes: {wall: [wall.a, spring.a], load: [spring.b, load.a]}
initial: {load.v: 0 m/s, load.x: 10 mm}
simulate: {until: 5 s, every: 50 ms}
"""


def swing(t: np.ndarray, rest: float, x: float, v: float) -> np.ndarray:
    """x(t) of m x'' + d x' + c (x - rest) = 0 with m = 1 kg, d = 0.2 N*s/m, c = 4 N/m, in closed form."""
    decay, w = 0.1, np.sqrt(4 - 0.01)
    a, b = x - rest, (v + decay * (x - rest)) / w
    return np.asarray(rest + np.exp(-decay * t) * (a * np.cos(w * t) + b * np.sin(w * t)))


def experiment(folder: Path, diagram: str, output: str, noise: str, records: dict[str, tuple[str, np.ndarray]], free: str
               ) -> Path:
    """An experiment file whose records hold the values (N,) of one output, with the entries of each."""
    (folder / "diagram.yaml").write_text(diagram, encoding="utf-8")
    lines = []
    for name, (entries, values) in records.items():
        rows = "\n".join(f"{0.05 * k!r},{value!r}" for k, value in enumerate(values.tolist()))
        (folder / f"{name}.csv").write_text(f"t_s,y\n{rows}\n", encoding="utf-8")
        lines.append(f"  {name}: {{file: {name}.csv, use: fit, {entries}}}\n")
    path = folder / "experiment.yaml"
    path.write_text(f"experiment: starts\nmodel: diagram.yaml\nrecords:\n{''.join(lines)}"
                    f"time: {{column: t_s, unit: s}}\noutputs:\n  {output}: {{column: y, noise: {noise}}}\nfree:\n{free}",
                    encoding="utf-8")
    return path


T = 0.05 * np.arange(101)


def two_starts() -> dict[str, tuple[str, np.ndarray]]:
    return {name: (f"initial: {{load.x: {x} mm}}", swing(T, 0, x / 1000, 0)) for name, x in (("a", 10), ("b", 80))}


def test_a_fit_begins_each_record_at_the_start_of_that_record_and_not_of_the_first(tmp_path: Path) -> None:
    """A pendulum near its upper rest has several minima: from the start of the other record the fit ends in a wrong one."""
    (tmp_path / "diagram.yaml").write_text(PENDULUM)
    starts = {"a": (0.2, 0.0), "b": (2.9, -1.0)}
    records = {}
    for name, (phi, w) in starts.items():
        run = hb.simulate(tmp_path / "diagram.yaml", 5.0, every=0.05,
                          parameters={"initial.shaft.phi": phi, "initial.shaft.w": w})
        records[name] = f"initial: {{shaft.phi: {phi} rad, shaft.w: {w} rad/s}}", run["shaft.phi"]
    path = experiment(tmp_path, PENDULUM, "shaft.phi", "1 mrad, unit: rad", records,
                      "  damp.d: 0 .. 0.1 N*m*s/rad\n  initial.shaft.phi: {range: -3.2 .. 3.2 rad, each: record}\n"
                      "  initial.shaft.w: {range: -10 .. 10 rad/s, each: record}\n")
    found = hb.fit(path)
    assert found.chi2 < 1e-4  # errors of the integration are far below the noise of 1 mrad
    before = {(p.name, p.record): p.before for p in found.parameters if p.record}
    assert before == {(f"initial.shaft.{state}", name): starts[name][k] for name in starts
                      for k, state in enumerate(("phi", "w"))}
    assert found.values["damp.d"] == pytest.approx(0.002, rel=1e-4)


def test_the_column_before_of_a_fit_is_what_compare_says(tmp_path: Path) -> None:
    """Starts that only the records have, in mm, one of them sought as its logarithm."""
    records = two_starts()
    path = experiment(tmp_path, SWING, "load.x", "1 mm, unit: m", records,
                      "  spring.c: 1 .. 9 N/m\n  initial.load.x: {range: 1 .. 100 mm, each: record}\n")
    found, compared = hb.fit(path), hb.compare(path)
    for name in records:
        channel, expected = (c.records[name].channels["load.x"] for c in (found.before, compared))
        assert channel.error == pytest.approx(expected.error, abs=1e-12)  # exp(log(80 mm)) is rounded
        assert channel.error < 1e-7  # the model is exact; the integration is to 1e-8


def test_a_parameter_that_a_record_sets_begins_at_that_value(tmp_path: Path) -> None:
    """The same of a parameter under `set:` of each record, which is not of the start."""
    records = {name: (f"set: {{spring.l0: {rest} mm}}", swing(T, rest / 1000, 0.01, 0))
               for name, rest in (("a", 5), ("b", -30))}
    path = experiment(tmp_path, SWING, "load.x", "1 mm, unit: m", records,
                      "  spring.c: 1 .. 9 N/m\n  spring.l0: {range: -50 .. 50 mm, each: record}\n")
    problem = Residuals(hb.load_experiment(path))
    assert {c.record: c.before for c in problem.columns if c.record} == {"a": 0.005, "b": -0.03}
    residuals, _ = problem.evaluate(problem.start)
    assert np.abs(residuals).max() < 1e-4  # in standard deviations of 1 mm


def test_a_start_of_a_record_outside_its_range_is_refused_with_the_record(tmp_path: Path) -> None:
    records = two_starts()
    path = experiment(tmp_path, SWING, "load.x", "1 mm, unit: m", records,
                      "  initial.load.x: {range: -50 .. 50 mm, each: record}\n")
    with pytest.raises(UsageError, match=r"initial\.load\.x is 80 mm in record b, outside its range"):
        hb.fit(path)
