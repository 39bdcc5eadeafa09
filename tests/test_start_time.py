"""Runs that begin at another time than 0 s."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

import heavebond as hb

RECORD = """
model: unix_time
components:
  f: {is: FirstOrderLag, T_1: 0.5 s, u: {file: unix.csv, column: u_V, unit: V, interpolation: linear,
                                         time: {column: time_s, unit: s}}}
show: {y: {is: f.y, unit: V}}
simulate: {from: 1400000000 s, until: 1400000010 s, every: 0.1 s}
"""
# all sources of the library that know the time, and a formula, in a time axis that begins at t_0
SOURCES = """
model: shifted
parameters: {t_0: T_0 s, w: 0.3 s}
components:
  step: {is: Step, t_s: =t_0 + 1 s, after: 2 N}
  pulse: {is: Pulse, t_s: =t_0 + 2.25 s, width: 0.5 s, height: 3 N}
  table: {is: TableSource, n: 3, t: ["=t_0 + 3 s", "=t_0 + 3.5 s", "=t_0 + 4 s"], v: [0 N, 5 N, 1 N]}
  ramp: {is: Ramp, rate: 1 N/s, t_s: =t_0 + 0.5 s, t_e: =t_0 + 4.5 s}
  bell: {is: Gain, k: 4 N, u: "=exp(-((time - t_0 - 1.75 s)/w)**2)"}
  gate: {is: Gain, k: 1 N, u: "=if_else(time - t_0 < 1.5 s, 1, 0)"}
  hold: {is: SampleHold, T_s: 0.25 s, t_0: =t_0}
  a: {is: FirstOrderLag, T_1: 0.2 s}
  b: {is: FirstOrderLag, T_1: 0.2 s}
  c: {is: FirstOrderLag, T_1: 0.2 s}
  d: {is: FirstOrderLag, T_1: 0.2 s}
  e: {is: FirstOrderLag, T_1: 0.2 s}
  g: {is: FirstOrderLag, T_1: 0.2 s}
  h: {is: FirstOrderLag, T_1: 0.2 s}
nodes:
  a: [step.y, a.u]
  b: [pulse.y, b.u]
  c: [table.y, c.u]
  d: [ramp.y, d.u, hold.u]
  e: [bell.y, e.u]
  g: [gate.y, g.u]
  h: [hold.y, h.u]
initial: start: steady
simulate: {from: T_0 s, until: T_1 s, every: 10 ms}
"""


def shifted(begin: float) -> hb.Model:
    text = SOURCES.replace("T_0 s", f"{begin!r} s").replace("T_1 s", f"{begin + 5!r} s")
    return hb.loads(text.replace("initial: start: steady", "initial: {start: steady}"))


def record(folder: Path, begin: float = 1.4e9) -> Path:
    time = np.arange(0, 10.05, 0.1)
    rows = "\n".join(f"{begin + t:.3f},{np.sin(t):.9f}" for t in time)
    (folder / "unix.csv").write_text(f"time_s,u_V\n{rows}\n", encoding="utf-8")
    text = RECORD.replace("1400000000 s", f"{begin!r} s").replace("1400000010 s", f"{begin + 10!r} s")
    (folder / "m.yaml").write_text(text, encoding="utf-8")
    return folder / "m.yaml"


def test_a_run_begins_at_the_first_row_of_a_record_with_unix_times(tmp_path: Path) -> None:
    found = hb.simulate(record(tmp_path))
    (tmp_path / "zero").mkdir()
    reference = hb.simulate(record(tmp_path / "zero", 0.0))
    assert found.time[0] == 1.4e9 and len(found.time) == 101
    # times of 1.4e9 s are rounded to 2.4e-7 s, the signal changes by 1 V/s; the solver errs by some 100 tolerances of 1e-8
    assert found.si["y"] == pytest.approx(reference.si["y"], abs=1e-5)


@pytest.mark.parametrize("solver", ["idas", "cvodes"])
@pytest.mark.parametrize("begin", [1.0, -3.7, 1.4e9])
def test_a_shift_of_the_time_axis_changes_nothing_but_rounding(begin: float, solver: str) -> None:
    reference, found = hb.simulate(shifted(0.0), solver=solver), hb.simulate(shifted(begin), solver=solver)
    assert found.time - begin == pytest.approx(reference.time, abs=1e-6)
    # the global error of the solvers is some hundred times their tolerance of 1e-8; the rounding of time at 1.4e9 s, 2.4e-7
    # s,
    # times the fastest change of a signal, 25 N/s, comes on top
    tolerance = 3e-5 if begin > 1e6 else 2e-5
    for name in "abcdegh":
        assert found.si[f"{name}.y"] == pytest.approx(reference.si[f"{name}.y"], abs=tolerance), name
    assert [n for _, n in found.events] == [n for _, n in reference.events]


def test_begin_and_from_say_the_same(tmp_path: Path) -> None:
    text = SOURCES.replace("from: T_0 s, ", "").replace("T_0 s", "1 s").replace("T_1 s", "6 s")
    model = hb.loads(text.replace("initial: start: steady", "initial: {start: steady}"))
    assert np.array_equal(hb.simulate(model, begin="1 s").si["e.y"], hb.simulate(shifted(1.0)).si["e.y"])


def test_a_steady_start_takes_what_has_passed_before_its_time() -> None:
    """From 2 s on the step of 1 s is over, so that its lag begins at rest with the value after it."""
    found = hb.simulate(shifted(0.0), begin=2.0)
    assert found.si["g.y"] == pytest.approx(np.zeros(len(found.time)), abs=1e-9)
    assert found.si["d.y"][0] == pytest.approx(1.5)


def test_an_end_before_the_start_is_refused() -> None:
    with pytest.raises(hb.UsageError, match="from"):
        hb.simulate(shifted(0.0), begin="7 s")


def test_an_fmu_begins_at_the_start_time_of_the_diagram(tmp_path: Path) -> None:
    import fmpy

    from heavebond.exchange.fmu_export import export_fmu

    model = hb.loads("""
model: late
components:
  gate: {is: Gain, k: 1 N, u: "=if_else(time < 2.5 s, 1, if_else(time < 4 s, 3, 0))"}
  lag: {is: FirstOrderLag, T_1: 0.2 s}
nodes: {u: [gate.y, lag.u]}
show: {y: {is: lag.y, unit: N}}
initial: {start: steady}
simulate: {from: 3 s, until: 5 s, every: 0.1 s}
""")
    export_fmu(model, tmp_path / "m.fmu")
    assert float(fmpy.read_model_description(str(tmp_path / "m.fmu")).defaultExperiment.startTime) == 3.0
    found = fmpy.simulate_fmu(str(tmp_path / "m.fmu"), start_time=3.0, stop_time=5.0, output_interval=0.1,
                              fmi_type="CoSimulation")
    exact = np.where(found["time"] <= 4, 3.0, 3*np.exp(-(found["time"] - 4)/0.2))  # 2.5 s has passed at the start
    assert found["y"] == pytest.approx(exact, abs=1e-5)  # the tolerance of the integrator inside, 1e-9, times its steps
    assert hb.simulate(model).si["y"] == pytest.approx(exact[:21], abs=1e-5)


@pytest.mark.parametrize("solver", ["idas", "cvodes", pytest.param("rosenbrock", marks=pytest.mark.long)])
def test_steps_are_not_rounded_to_the_times_of_a_unix_clock(solver: str) -> None:
    """A body of 1 kg at 50 Hz, whose steps of some 10 us are 40 spacings of the numbers at 1.4e9 s, driven at 10 Hz."""
    k, w, t_0 = (2 * np.pi * 50)**2, 2 * np.pi * 10, 1.4e9
    model = hb.loads(f"""
model: unix
components:
  wall: {{is: Fixed}}
  spring: {{is: Spring, c: {k!r} N/m}}
  mass: {{is: Mass, m: 1 kg}}
  force: {{is: ForceSource, u: "=1e4 N*sin({w!r} rad/s*(time - {t_0!r} s))"}}
nodes: {{a: [wall.a, spring.a], b: [spring.b, mass.a, force.a]}}
simulate: {{from: {t_0!r} s, until: {t_0 + 0.2!r} s, every: 2 ms}}
""")
    found = hb.simulate(model, solver=solver, sensitivities=["mass.m"])
    tau, p = found.time - t_0, np.sqrt(k)  # the difference of times is exact
    exact = 1e4 / (k - w**2) * (np.sin(w * tau) - w / p * np.sin(p * tau))
    sign = np.sign(found["b.x"] @ exact)  # of the port of the source
    # 2000 tolerances of 1e-8 of the amplitude, as a run from 0 s; steps on rounded times err by 2e-3
    assert sign * found["b.x"] == pytest.approx(exact, abs=2e-5 * np.abs(exact).max())
    assert np.all(np.isfinite(found.sensitivity("b.x", "mass.m")))


def test_a_delayed_loop_keeps_its_answer_at_the_times_of_a_unix_clock() -> None:
    """x' = -2 x(t - 0.25 s): the first steps of the integrator are shorter than the spacing of numbers at 1.4e9 s, and the
    history has one time for several of them."""
    def ends(begin: float) -> np.ndarray:
        return hb.simulate(hb.loads(f"""
model: loop
components:
  x: {{is: Integrator, k: 1 1/s, u: =-2*late.y}}
  late: {{is: Delay, T: 0.25 s, u: =x.y}}
initial: {{x.y: 1}}
simulate: {{from: {begin!r} s, until: {begin + 2!r} s, every: 0.1 s}}
""")).si["x.y"]

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert ends(1.4e9) == pytest.approx(ends(0.0), abs=1e-4)
