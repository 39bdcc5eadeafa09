"""The unit of time does not matter: the same machine in femtoseconds and in thousands of years gives the same numbers.

Expected values are closed forms. Runs at the default tolerances of 1e-8 a step err by less than 1e-6 of the largest value.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from test_co_simulation_fmu import fmpy
from test_export import compiled

import heavebond as hb
from heavebond.exchange.fmu_export import export_fmu
from heavebond.language.model import Model
from heavebond.numerics.looks import LookAhead

LOW_PASS = """
model: low_pass
components:
  v: {{is: VoltageSource, u: 5 V}}
  r: {{is: Resistor, R: 50 ohm}}
  c: {{is: Capacitor, C: {C!r} F}}
  g: {{is: ElectricalGround}}
nodes: {{p: [v.a, r.a], q: [r.b, c.a], n: [v.b, c.b, g.a]}}
initial: {{q.v: 0 V}}
show: {{v: {{is: q.v, unit: V}}}}
simulate: {{until: {until!r} s}}
"""
# a ramp that passes a threshold, and a lag behind it
SWITCHED = """
model: switched
components:
  ramp:  {{is: Ramp, rate: {rate!r} 1/s}}
  relay: {{is: Comparator, level: 0.3}}
  lag:   {{is: FirstOrderLag, T_1: {T!r} s}}
nodes: {{u: [ramp.y, relay.u], y: [relay.y, lag.u]}}
simulate: {{until: {until!r} s}}
"""
SPANS = (1e-15, 1e-12, 500e-9, 1e-3, 1e6, 1e12)


def low_pass(span: float) -> Model:
    """A time constant of a tenth of the run."""
    return hb.loads(LOW_PASS.format(C=span / 10 / 50, until=span))


def assert_rises(time: np.ndarray, v: np.ndarray, span: float) -> None:
    assert np.abs(v - 5 * (1 - np.exp(-10 * time / span))).max() < 5e-6


@pytest.mark.parametrize(("solver", "span"), [
    *(pytest.param("rosenbrock", span, marks=[compiled, pytest.mark.long]) for span in (1e-15, 1e-12, 500e-9, 1e12)),
    *((solver, span) for solver in ("auto", "idas") for span in (1e-15, 1e-12, 500e-9, 1e-3, 1e6, 1e12))])
def test_a_run_of_any_length_is_integrated(solver: str, span: float) -> None:
    run = hb.simulate(low_pass(span), solver=solver)
    assert_rises(run.time, run.si["q.v"], span)
    assert run.verdict.status == "clean"


@pytest.mark.parametrize("span", SPANS)
def test_sensitivities_of_a_run_of_any_length(span: float) -> None:
    run = hb.simulate(low_pass(span), sensitivities=["r.R"])
    s = 10 * run.time / span
    # d/dR of 5 (1 - exp(-t/RC)); sensitivities are accurate to 1e-4 of their largest value
    assert np.abs(run.sensitivity("q.v", "r.R") + 5 * s * np.exp(-s) / 50).max() < 1e-4 * 5 / 50 / np.e


@pytest.mark.parametrize("span", [1e-15, 1e-9, 1e6, 1e12])
def test_a_threshold_in_a_run_of_any_length(span: float) -> None:
    run = hb.simulate(hb.loads(SWITCHED.format(rate=1 / span, T=span / 20, until=span)))
    assert [round(time / span, 9) for time, name in run.events if name == "relay.rise"] == [0.3]
    late = np.maximum(run.time / span - 0.3, 0.0)
    assert np.abs(run.si["lag.y"] - (1 - np.exp(-20 * late))).max() < 1e-6


@pytest.mark.parametrize("span", [1e-12, 1e12])
def test_unevenly_spaced_times_of_any_length(span: float) -> None:
    from heavebond.numerics.dae import assemble
    from heavebond.numerics.simulator import Simulator

    times = span * np.array([0.0, 1e-9, 0.1, 0.1 + 1e-9, 1.0])
    run = Simulator(assemble(low_pass(span)), times=times).run()
    assert_rises(times, run.si["q.v"], span)
    assert run.si["q.v"][1] == pytest.approx(5e-8, rel=1e-3)


@pytest.mark.parametrize("span", [1e-12, 1e12])
def test_cases_of_a_study_of_any_length(span: float) -> None:
    from heavebond.numerics.dae import assemble
    from heavebond.numerics.quick_simulation import CaseSimulator

    run = CaseSimulator(assemble(low_pass(span)), until=span).run()
    assert_rises(run.time, run.si["q.v"], span)


@pytest.mark.parametrize("span", [1e-12, 1e-9, 1e9])
def test_a_fit_to_a_record_of_any_length(span: float, tmp_path: Path) -> None:
    times = np.linspace(0, span, 51)
    rows = [f"{t!r},{v!r}" for t, v in zip(times.tolist(), (5 * (1 - np.exp(-10 * times / span))).tolist(), strict=True)]
    (tmp_path / "record.csv").write_text("\n".join(["time_s,v", *rows]))
    (tmp_path / "low_pass.yaml").write_text(LOW_PASS.format(C=span / 10 / 50, until=span))
    (tmp_path / "experiment.yaml").write_text(
        "experiment: e\nmodel: low_pass.yaml\ntime: {column: time_s, unit: s}\n"
        "outputs: {q.v: {column: v, unit: V, noise: 1 mV}}\n"
        "records: {a: {file: record.csv, use: fit}}\nfree: {r.R: 10 .. 200 ohm}\n")
    found = hb.fit(hb.load_experiment(tmp_path / "experiment.yaml"))
    assert found.values["r.R"] == pytest.approx(50, rel=1e-5)


@compiled
@pytest.mark.parametrize("span", [1e-12, 1e12])
def test_an_fmu_of_any_length(span: float, tmp_path: Path) -> None:
    export_fmu(low_pass(span), path := tmp_path / "m.fmu")
    found = fmpy.simulate_fmu(str(path), fmi_type="CoSimulation", stop_time=span, output_interval=span / 50,
                              record_events=False)
    assert_rises(found["time"], found["v"], span)


def test_points_of_an_integrator_that_crawls_stay_an_instant_apart() -> None:
    """Their distance was halved to 0 s where each call took many steps, which ended in a division by zero."""
    same = 1e-12
    for crawl in ("accept", "refine"):
        ahead = LookAhead(np.array([0.0, 1.0]), same, True, True)
        for _ in range(200):
            looks = ahead.coming(0.5, 1.0, 0)
            assert looks.times[0] - 0.5 >= 0.4 * same  # it divides the way to the next stop by a power of two
            ahead.accept(0.5, looks, 10**6) if crawl == "accept" else ahead.refine(0.5, looks, 0)


@pytest.mark.parametrize("solver", ["auto", "idas", "cvodes"])
def test_samples_impacts_and_planets(solver: str) -> None:
    """A loop sampled every picosecond, a ball that bounces within femtoseconds, and a planet that cools in 1e17 s."""
    found = hb.simulate(hb.loads("""
model: sampled
components:
  h: {is: SampleHold, T_s: 1e-12 s, u: "=1 - i.y"}
  i: {is: Integrator, k: 5e11 1/s}
nodes: {a: [h.y, i.u]}
initial: {i.y: 0}
simulate: {until: 10.5e-12 s, every: 1e-12 s}
"""), solver=solver)
    assert found.si["i.y"][:11] == pytest.approx(1 - 0.5**np.arange(11), abs=1e-12)  # rounding of some operations
    if solver != "cvodes":
        ball = hb.simulate(hb.loads("""
model: ball
components:
  m: {is: Mass, m: 1 ng}
  f: {is: ForceSource, u: -2e12 N}
  w: {is: Fixed}
  s: {is: RigidStop, e: 0.5}
nodes: {x: [m.a, f.a, s.b], w: [w.a, s.a]}
initial: {x.x: 1e-6 m, x.v: 0 m/s}
nominal: {f.u: 1e12 N, m.a.f: 1e12 N, f.a.f: 1e12 N, x.v: 1e9 m/s, s.v: 1e9 m/s}
simulate: {until: 1.9e-15 s, every: 1e-17 s}
"""), solver=solver)
        assert [t for t, name in ball.events if name == "s.impact"] == pytest.approx([1e-15], rel=1e-9)
        late = ball.time > 1e-15
        rest = ball.time[late] - 1e-15
        assert ball.si["x.x"][late] == pytest.approx(1e9 * rest - 1e24 * rest**2, abs=1e-13)  # 1e-7 of the largest height
    cooled = hb.simulate(hb.loads("""
model: planet
components:
  h: {is: HeatCapacity, m: 6e18 kg, c: 1000 J/(kg*K)}
  r: {is: ThermalResistance, R: 1e-5 K/W}
  a: {is: Ambient, T_0: 3 K}
nodes: {x: [h.a, r.a], a: [r.b, a.a]}
initial: {x.T: 5000 K}
simulate: {until: 1e17 s}
"""), solver=solver)
    assert cooled.si["x.T"] == pytest.approx(3 + 4997 * np.exp(-cooled.time / 6e16), rel=1e-6)
