"""Runs of many samples by the compiled program, against the integration that goes from instant to instant in Python."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from collected import partly

import heavebond as hb
from benchmarks import sampled
from heavebond.language.symbols import stack
from heavebond.numerics import event_integration
from heavebond.numerics.machine_code import compiler
from heavebond.numerics.simulator import Simulator

pytestmark = pytest.mark.skipif(compiler() is None, reason="needs a C compiler")

PLANT = """
  a: {is: FirstOrderLag, T_1: %s, u: =control.y}
  b: {is: FirstOrderLag, T_1: 100 ms, u: =a.y}
  c: {is: Integrator, k: 1 1/s, u: =b.y}
initial: {a.y: 0, b.y: 0, c.y: 0}
simulate: {until: 0.3 s, every: 3.3 ms}
"""
PLAIN = """
model: loop
parameters: {K: 6}
components:
  target:  {is: Sine, a: 1, T: 0.2 s}
  control: {is: SampleHold, T_s: 1 ms, u: =K*(target.y - c.y)}
"""
RATES = PLAIN.replace("u: =K*(", "u: =slow.y + K*(") + """
  slow: {is: DiscreteLowPass, T_1: 5 ms, T_s: 3 ms, u: =target.y}
  fine: {is: Quantiser, step: 0.01, T_s: 1 ms, u: =target.y}
"""
SWITCHED = PLAIN.replace("u: =K*(", "u: =0.4*relay.y + K*(") + """
  relay: {is: Relay, u_on: 0.5, u_off: -0.5, y_on: 1, u: =target.y}
  stage: {is: Relay, u_on: 0.02, u_off: -0.02, y_on: 1, u: =c.y}
"""
STEPPED = PLAIN.replace("u: =K*(", "u: =0.4*late.y + K*(") + """
  late: {is: Step, t_s: 0.1503 s, after: 1}
"""
LOOPS = {"plain": PLAIN + PLANT % "20 ms", "several rates": RATES + PLANT % "20 ms", "stiff": PLAIN + PLANT % "2 us",
         "conditions": SWITCHED + PLANT % "20 ms", "step": STEPPED + PLANT % "20 ms"}
# Both integrate with rtol 1e-8. The errors of the steps add up over 300 restarts; those of the integration in Python reach
# 2e-6 of the largest value, those of the program 1e-8 (against rtol 1e-11).
AGREE = 1e-5


def runs(monkeypatch: pytest.MonkeyPatch, model: hb.Model, **given: object) -> tuple[hb.Result, hb.Result]:
    """A run by the program, and the same in Python."""
    found = []
    for least in (1, 10**9):
        monkeypatch.setattr(event_integration, "SAMPLED_RUNS", replace(event_integration.SAMPLED_RUNS, least=least))
        found.append(hb.simulate(model, **given))
    return found[0], found[1]


@pytest.mark.parametrize("name", partly(LOOPS, 3))
def test_the_compiled_program_gives_the_run_that_python_gives(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
                                                               ) -> None:
    (tmp_path / "loop.yaml").write_text(LOOPS[name], encoding="utf-8")
    model = hb.load(tmp_path / "loop.yaml")
    quick, plain = runs(monkeypatch, model, sensitivities=["K"])
    assert quick.statistics["compiled_intervals"] > 250
    assert "compiled_intervals" not in plain.statistics
    assert [event for _, event in quick.events] == [event for _, event in plain.events]
    assert [time for time, _ in quick.events] == pytest.approx([time for time, _ in plain.events], abs=1e-9)
    for ours, theirs in ((quick.x, plain.x), (quick.held, plain.held)):
        assert ours == pytest.approx(theirs, abs=AGREE * np.abs(theirs).max())
    for state in quick.assembly.state_names:
        theirs = plain.sensitivity(state, "K")
        assert quick.sensitivity(state, "K") == pytest.approx(theirs, abs=10 * AGREE * np.abs(theirs).max())
    dense, other = quick.dense, plain.dense
    assert np.all(np.diff(dense.time) >= 0)
    assert np.ptp(dense["a.y"]) == pytest.approx(np.ptp(other["a.y"]), rel=1e-3)


def test_each_instant_has_the_point_before_and_after_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "loop.yaml").write_text(LOOPS["several rates"], encoding="utf-8")
    quick, plain = runs(monkeypatch, hb.load(tmp_path / "loop.yaml"))
    for ours, theirs in zip(quick.instants, plain.instants, strict=True):
        assert (ours.names, ours.time) == (theirs.names, pytest.approx(theirs.time, abs=1e-12))
        for point, other in ((ours.before, theirs.before), (ours.after, theirs.after)):
            assert point.x == pytest.approx(other.x, abs=AGREE)
            assert point.p == pytest.approx(other.p, abs=10 * AGREE)


def test_algebraic_unknowns_follow_their_equations(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    text = """
model: loop
parameters: {K: 6}
components:
  target:  {is: Sine, a: 1, T: 0.2 s}
  control: {is: SampleHold, T_s: 1 ms, u: =K*(target.y - c.y)}
  back:    {is: Gain, k: 0.2, u: "=exp(sum.y) - exp(-sum.y)"}
  sum:     {is: Gain, k: 1, u: =control.y - back.y}
""" + PLANT % "20 ms"
    (tmp_path / "loop.yaml").write_text(text.replace("u: =control.y}\n  b", "u: =sum.y}\n  b"), encoding="utf-8")
    model = hb.load(tmp_path / "loop.yaml")
    quick, plain = runs(monkeypatch, model, sensitivities=["K"])
    assert quick.assembly.algebraic_names
    assert quick.statistics["compiled_intervals"] > 250
    moved = quick.sensitivity("c.y", "K"), plain.sensitivity("c.y", "K")
    for ours, theirs in ((quick.x, plain.x), (quick.z, plain.z), moved):
        assert ours == pytest.approx(theirs, abs=10 * AGREE * np.abs(theirs).max())


def test_a_sensitivity_to_the_sampling_period_goes_through_python(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    text = LOOPS["plain"].replace("{K: 6}", "{K: 6, T: 1 ms}").replace("T_s: 1 ms", "T_s: =T")
    (tmp_path / "loop.yaml").write_text(text, encoding="utf-8")
    quick, _ = runs(monkeypatch, hb.load(tmp_path / "loop.yaml"), sensitivities=["T"])
    assert "compiled_intervals" not in quick.statistics


def test_a_jump_that_the_equations_differentiate_is_refused_as_in_python(monkeypatch: pytest.MonkeyPatch, tmp_path: Path
                                                                         ) -> None:
    text = """
model: jerked
components:
  drive:  {is: PositionSource, u: =hold.y}
  hold:   {is: SampleHold, T_s: 1 ms, u: "=0.1 m*floor(time/(0.1 s))"}
  slide:  {is: Mass, m: 1 kg}
nodes:
  tip: [drive.a, slide.a]
simulate: {until: 0.3 s, every: 10 ms}
"""
    (tmp_path / "jerked.yaml").write_text(text, encoding="utf-8")
    said = []
    for least in (1, 10**9):
        monkeypatch.setattr(event_integration, "SAMPLED_RUNS", replace(event_integration.SAMPLED_RUNS, least=least))
        with pytest.raises(hb.HeavebondError) as raised:
            hb.simulate(tmp_path / "jerked.yaml")
        said.append(raised.value.problems[0].code)
    assert said[0] == said[1]


def test_the_loop_of_the_benchmark_is_its_plant_with_the_recorded_command(tmp_path: Path) -> None:
    sides = sampled.prepared(tmp_path, "3 s")
    sides.check()
    assert hb.simulate(sides.loop).statistics["compiled_intervals"] > 2900


def test_integrals_and_their_sensitivities_along_samples(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "loop.yaml").write_text(LOOPS["plain"], encoding="utf-8")
    assembly, found = hb.assemble(tmp_path / "loop.yaml"), []
    time, x = assembly.arguments[0], assembly.arguments[1]
    for least in (1, 10**9):
        monkeypatch.setattr(event_integration, "SAMPLED_RUNS", replace(event_integration.SAMPLED_RUNS, least=least))
        found.append(Simulator(assembly, quadratures=stack([x[0]**2, time*x[2]]), sensitivities=["K", "b.T_1"]).run())
    quick, plain = found
    assert quick.statistics["compiled_intervals"] > 250
    assert quick.along is not None and plain.along is not None
    assert quick.quadratures == pytest.approx(plain.quadratures, abs=AGREE * np.abs(plain.quadratures).max())
    for ours, theirs in ((quick.along.x, plain.along.x), (quick.along.quadratures, plain.along.quadratures)):
        assert ours == pytest.approx(theirs, abs=10 * AGREE * np.abs(theirs).max())
