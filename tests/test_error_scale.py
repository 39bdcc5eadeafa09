"""Error control at the scale of a run: tiny machines are integrated as accurately as those of usual size.

Expected values are closed forms. Runs at the default tolerances of 1e-8 a step err by less than 1e-5 of the largest value.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from collected import partly
from scipy.special import ive
from test_co_simulation_fmu import fmpy
from test_export import compiled

import heavebond as hb
from heavebond.exchange.fmu_export import export_fmu
from heavebond.language.model import Model
from heavebond.numerics.dae import assemble
from heavebond.numerics.simulator import Simulator

TANK = """
model: tank_circuit
components:
  l: {is: Inductor, L: 1 mH}
  c: {is: Capacitor, C: 1 uF}
  g: {is: ElectricalGround}
nodes: {a: [l.a, c.a], g: [l.b, c.b, g.a]}
initial: {l.i: 1 nA, a.v: 0 V}
simulate: {until: 20 ms}
"""
DISCHARGE = """
model: discharge
components:
  r: {is: Resistor, R: 1 kohm}
  c: {is: Capacitor, C: 1 uF}
  g: {is: ElectricalGround}
nodes: {p: [r.a, c.a], n: [r.b, c.b, g.a]}
initial: {p.v: 1 nV}
show: {v: {is: p.v, unit: V}}
simulate: {until: 5 ms}
"""
OSCILLATOR = """
model: oscillator
components:
  m: {is: Mass, m: 1 kg}
  s: {is: Spring, c: 1 N/m}
  w: {is: Fixed}
nodes: {x: [m.a, s.a], w: [s.b, w.a]}
initial: {x.x: 1e-12 m, x.v: 0 m/s}
show: {x: {is: x.x, unit: m}}
simulate: {until: 60 s}
"""
# unstable: m x'' = k x with m = 1 kg, k = 1 N/m
GROWING = """
model: growing
components:
  m: {is: Mass, m: 1 kg}
  f: {is: ForceSource, u: "=1 N/m * x.x"}
nodes: {x: [m.a, f.a]}
initial: {x.x: 1e-12 m, x.v: 1e-12 m/s}
simulate: {until: 30 s}
"""
# a voltage of 10 V beside a motion of picometres that it drives by 1e-13 N/V
COUPLED = """
model: coupled
components:
  u: {is: VoltageSource, u: 10 V}
  r: {is: Resistor, R: 1 kohm}
  c: {is: Capacitor, C: 1 mF}
  g: {is: ElectricalGround}
  f: {is: ForceSource, u: "=1e-13 N/V * q.v"}
  m: {is: Mass, m: 1 kg}
  d: {is: Damper, d: 1 N*s/m}
  w: {is: Fixed}
nodes: {p: [u.a, r.a], q: [r.b, c.a], n: [u.b, c.b, g.a], x: [m.a, f.a, d.a], w: [d.b, w.a]}
initial: {q.v: 0 V, x.v: 0 m/s}
simulate: {until: 5 s}
"""
# a leak of femtoamperes through two resistors in series
LEAK = """
model: leak
components:
  c: {is: Capacitor, C: 1 pF}
  a: {is: Resistor, R: 1 Gohm}
  d: {is: Resistor, R: 3 Gohm}
  g: {is: ElectricalGround}
nodes: {p: [c.a, a.a], q: [a.b, d.a], n: [c.b, d.b, g.a]}
initial: {p.v: 1 uV}
simulate: {until: 5 ms}
"""
# two equal masses that swing against each other: the middle stays where it is, but for rounding
SYMMETRIC = """
model: symmetric
components:
  a: {is: Mass, m: 1.1 kg}
  m: {is: Mass, m: 0.7 kg}
  b: {is: Mass, m: 1.1 kg}
  s: {is: SpringDamper, c: 130 N/m, d: 0.3 N*s/m}
  t: {is: SpringDamper, c: 130 N/m, d: 0.3 N*s/m}
nodes: {a: [a.a, s.a], m: [s.b, m.a, t.a], b: [t.b, b.a]}
initial: {a.x: -0.123 m, b.x: 0.123 m, m.x: 0 m, a.v: 0 m/s, b.v: 0 m/s, m.v: 0 m/s}
simulate: {until: 20 s}
"""
SOLVERS = ["auto", "idas", "cvodes", pytest.param("rosenbrock", marks=compiled)]


def worst(found: np.ndarray, exact: np.ndarray) -> float:
    """The largest error as a share of the largest value."""
    return float(np.abs(found - exact).max() / np.abs(exact).max())


@pytest.mark.long
@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("amplitude", [1e-15, 1e-9, 1e-6])
def test_a_discharge_from_a_nanovolt(amplitude: float, solver: str) -> None:
    run = hb.simulate(hb.loads(DISCHARGE.replace("1 nV", f"{amplitude} V")), solver=solver)
    assert worst(run.si["p.v"], amplitude * np.exp(-run.time / 1e-3)) < 1e-5
    assert run.verdict.status == "clean"


@pytest.mark.long
@pytest.mark.parametrize("solver", SOLVERS)
def test_a_lossless_circuit_at_a_nanoampere_keeps_its_amplitude(solver: str) -> None:
    run = hb.simulate(hb.loads(TANK), solver=solver)
    # a hundred oscillations add up their errors
    assert worst(run.si["l.i"], 1e-9 * np.cos(run.time / np.sqrt(1e-9))) < 1e-4


@pytest.mark.long
@pytest.mark.parametrize("solver", SOLVERS)
def test_an_oscillator_of_a_picometre(solver: str) -> None:
    run = hb.simulate(hb.loads(OSCILLATOR), solver=solver)
    assert worst(run.si["x.x"], 1e-12 * np.cos(run.time)) < 1e-5


def test_a_motion_that_grows_from_a_picometre() -> None:
    with pytest.warns(UserWarning, match="grows exponentially"):
        run = hb.simulate(hb.loads(GROWING))
    assert worst(run.si["x.x"], 1e-12 * np.exp(run.time)) < 1e-5


def test_a_tiny_motion_beside_a_large_voltage() -> None:
    run = hb.simulate(hb.loads(COUPLED))
    t = run.time
    # m v' + d v = f (1 - exp(-t)) with m = d = 1, f = 1e-12 N
    assert worst(run.si["x.v"], 1e-12 * (1 - np.exp(-t) - t * np.exp(-t))) < 1e-5
    assert worst(run.si["q.v"], 10 * (1 - np.exp(-t))) < 1e-6


@pytest.mark.parametrize("large", ["1e9", "1"])
def test_a_tiny_signal_that_shares_no_equation_with_a_large_one(large: str) -> None:
    """At an exact start nothing but rounding disturbs the tiny one, whatever the ratio: the closed form of a lagged sine."""
    run = hb.simulate(hb.loads(f"""
model: beside
components:
  large: {{is: FirstOrderLag, T_1: 1 s, u: {large}}}
  tiny:  {{is: FirstOrderLag, T_1: 1 s, u: "=1e-15*sin(3*time/(1 s))"}}
initial: {{large.y: 0, tiny.y: 0}}
simulate: {{until: 10 s}}
"""))
    t = run.time
    assert worst(run["tiny.y"], 1e-16 * (np.sin(3*t) - 3*np.cos(3*t) + 3*np.exp(-t))) < 1e-6


def test_a_leak_of_femtoamperes_through_two_resistors() -> None:
    run = hb.simulate(hb.loads(LEAK))
    assert worst(run.si["p.v"], 1e-6 * np.exp(-run.time / 4e-3)) < 1e-5


def test_the_run_reports_the_sizes_that_it_took() -> None:
    run = hb.simulate(hb.loads(TANK))
    assert set(run.statistics["sizes"]) == {"l.i", "c.u"}


@pytest.mark.parametrize("amplitude", [1.0, 0.01])
def test_a_run_of_usual_size_is_not_repeated(amplitude: float) -> None:
    run = hb.simulate(hb.loads(DISCHARGE.replace("1 nV", f"{amplitude} V")))
    assert "sizes" not in run.statistics


def test_rounding_about_a_point_of_symmetry_is_no_size() -> None:
    model = hb.loads(SYMMETRIC)
    run = hb.simulate(model)
    assert np.abs(run.si["m.x"]).max() < 1e-12
    assert "sizes" not in run.statistics


@pytest.mark.parametrize("amplitude", [1e-12, 1e-6])
def test_sensitivities_of_a_tiny_motion(amplitude: float) -> None:
    run = hb.simulate(hb.loads(OSCILLATOR.replace("1e-12", repr(amplitude))), sensitivities=["s.c"])
    # x = a cos(w t), w**2 = c: dx/dc = -a t sin(t)/2
    assert worst(run.sensitivity("x.x", "s.c"), -amplitude * run.time * np.sin(run.time) / 2) < 1e-4


def test_cases_of_a_study_at_a_nanovolt() -> None:
    from heavebond.numerics.quick_simulation import CaseSimulator

    simulator = CaseSimulator(assemble(hb.loads(DISCHARGE)), until=5e-3)
    for capacity in (1e-6, 2e-6):
        run = simulator.run({"c.C": capacity})
        assert worst(run.si["p.v"], 1e-9 * np.exp(-run.time / capacity / 1e3)) < 1e-5


def experiment(folder: Path, model: str, record: dict[str, np.ndarray], output: str, column: str, rest: str) -> Path:
    lines = [",".join(record), *(",".join(map(repr, row)) for row in np.column_stack(list(record.values())).tolist())]
    (folder / "record.csv").write_text("\n".join(lines))
    (folder / "model.yaml").write_text(model)
    path = folder / "experiment.yaml"
    path.write_text(f"experiment: e\nmodel: model.yaml\ntime: {{column: time_s, unit: s}}\noutputs: {{{output}: {column}}}\n"
                    f"records: {{a: {{file: record.csv, use: fit}}}}\n{rest}\n")
    return path


def test_a_fit_to_a_record_of_picometres(tmp_path: Path) -> None:
    t = np.linspace(0, 20, 201)
    path = experiment(tmp_path, OSCILLATOR, {"time_s": t, "x": 1e-12 * np.cos(1.1 * t)}, "x.x",
                      "{column: x, unit: m, noise: 1e-15 m}", "free: {s.c: 0.5 .. 2 N/m}")
    found = hb.fit(hb.load_experiment(path))
    assert found.values["s.c"] == pytest.approx(1.21, rel=1e-5)


@compiled
@pytest.mark.parametrize("version", partly([2, 3], 2))
def test_an_fmu_of_a_picometre(version: int, tmp_path: Path) -> None:
    export_fmu(hb.loads(OSCILLATOR), path := tmp_path / "m.fmu", version=version)
    found = fmpy.simulate_fmu(str(path), fmi_type="CoSimulation", stop_time=60, output_interval=0.5, record_events=False)
    assert worst(found["x"], 1e-12 * np.cos(found["time"])) < 1e-5


@compiled
def test_an_fmu_states_the_sizes_of_its_run(tmp_path: Path) -> None:
    export_fmu(hb.loads(TANK), path := tmp_path / "m.fmu")
    described = fmpy.read_model_description(str(path))
    sizes = {v.name: float(v.nominal) for v in described.modelVariables if v.nominal is not None}
    assert 1e-10 < sizes["l.i"] < 1e-8


def test_an_adjoint_of_a_tiny_motion() -> None:
    from heavebond.optimise.adjoint import Adjoint
    from heavebond.optimise.cost_evaluation import Evaluator
    from heavebond.optimise.costs import read_cost

    assembly = assemble(hb.loads(OSCILLATOR))
    evaluator = Evaluator(assembly, [read_cost(assembly, "mean(x.x**2)*1e24/1 m/1 m")], 0.0, 60.0)
    plain = Simulator(assembly, times=np.linspace(0.0, 60.0, 201))
    evaluator.resized(evaluator.largest(plain.run()))
    simulator = Simulator(assembly, times=np.array([0.0, 60.0]), quadratures=evaluator.quadratures,
                          factors=evaluator.factors)
    (value, slope), = Adjoint(simulator, evaluator, ["s.c"]).costs(simulator.run(), np.zeros(1))
    assert value == pytest.approx(0.5 + np.sin(120) / 240, rel=1e-5)
    # d/dc of 1/2 + sin(2 w T)/(4 w T) with w = sqrt(c), dw/dc = 1/2
    assert slope[0] == pytest.approx((np.cos(120) / 2 - np.sin(120) / 240) / 2, rel=1e-3)


def with_nominal(text: str, nominal: str) -> Model:
    return hb.loads(text.replace("simulate:", f"nominal: {{{nominal}}}\nsimulate:"))


def test_a_nominal_size_in_a_diagram_sets_the_error_control() -> None:
    run = hb.simulate(with_nominal(TANK, "l.i: 1 nA, c.u: 30 nV"))
    assert "sizes" not in run.statistics  # one run was enough
    assert worst(run.si["l.i"], 1e-9 * np.cos(run.time / np.sqrt(1e-9))) < 1e-4
    assert run.assembly.x_nominal.tolist() == pytest.approx([1e-9, 30e-9])


@pytest.mark.parametrize(("nominal", "code"), [
    ("l.j: 1 nA", "name-unknown"), ("l.i: 1 nV", "unit-wrong"), ("l.i: 0 A", "nominal-not-positive"),
    ("l.i: -1 nA", "nominal-not-positive"), ("l.i: =l.L", "not-a-quantity"), ("l.L: 1 mH", "name-unknown")])
def test_a_wrong_nominal_size_is_refused_with_its_place(nominal: str, code: str) -> None:
    with pytest.raises(hb.ModelError) as caught:
        assemble(with_nominal(TANK, nominal))
    problem = caught.value.problems[0]
    assert problem.code == code
    assert problem.place is not None and problem.place.line == 9
    assert problem.hint


MICROFLUIDIC = """
model: microfluidic
components:
  pump:   {is: FlowSource, u: 2e-14 m**3/s}
  oil:    {is: Volume, V: 2e-13 m**3, beta: 1.5 GPa}
  first:  {is: Orifice, q_r: 4e-14 m**3/s, dp_r: 10 bar}
  second: {is: Orifice, q_r: 2e-14 m**3/s, dp_r: 10 bar}
  tank:   {is: Tank}
nodes: {inlet: [pump.a, oil.a, first.a], middle: [first.b, second.a], back: [second.b, tank.a]}
simulate: {until: 1 s}
"""


def test_a_loop_with_tiny_gradients_is_solved() -> None:
    """The gradient of the node's balance, 1e-15 m3/s in a nominal pressure, is no sign of a singular matrix."""
    run = hb.simulate(hb.loads(MICROFLUIDIC))
    assert run.assembly.algebraic_names == ["middle.p"]
    # the rated drop, and a quarter of it at half the rated flow; the transition to laminar flow adds 2e-4
    assert run.si["middle.p"][-1] == pytest.approx(10e5, rel=1e-3)
    assert run.si["inlet.p"][-1] == pytest.approx(12.5e5, rel=1e-3)


# a body near the ambient temperature: T = T_a + dT exp(-t/(m c R))
COOLING = """
model: cooling
components:
  c: {is: HeatCapacity, m: 1 kg, c: 100 J/(kg*K)}
  r: {is: ThermalResistance, R: 1 K/W}
  t: {is: TemperatureSource, u: 293.15 K}
nodes: {b: [c.a, r.a], t: [r.b, t.a]}
initial: {b.T: 293.1501 K}
show: {T: {is: b.T, unit: K}}
simulate: {until: 500 s}
"""
# a mass on a spring, 1 km from the origin
FAR = """
model: far
components:
  m: {is: Mass, m: 1 kg}
  s: {is: Spring, c: 100 N/m}
  w: {is: Fixed, x0: 1000 m}
nodes: {x: [m.a, s.a], w: [s.b, w.a]}
initial: {x.x: 1000.000001 m, x.v: 0 m/s}
simulate: {until: 20 s}
"""
# a supply with a ripple: the lag 1/(1 + s R C) of a sine
RIPPLE = """
model: ripple
components:
  u: {is: VoltageSource, u: "=OFFSET V + RIPPLE V * sin(10 rad/s * time)"}
  r: {is: Resistor, R: 1 ohm}
  c: {is: Capacitor, C: 0.1 F}
  g: {is: ElectricalGround}
nodes: {p: [u.a, r.a], q: [r.b, c.a], n: [u.b, c.b, g.a]}
initial: {q.v: OFFSET V}
simulate: {until: 5 s}
"""


def cooled(time: np.ndarray, start: float = 293.1501, constant: float = 100.0) -> np.ndarray:
    return np.asarray((start - 293.15) * np.exp(-time / constant))


@pytest.mark.parametrize("solver", ["auto", "idas", pytest.param("rosenbrock", marks=(compiled, pytest.mark.long))])
def test_a_body_a_tenth_of_a_millikelvin_above_the_ambient(solver: str) -> None:
    run = hb.simulate(hb.loads(COOLING), solver=solver)
    assert worst(run.si["b.T"] - 293.15, cooled(run.time)) < 1e-6
    assert run.verdict.status == "clean"


def test_the_verdict_states_what_rounding_hides_of_a_motion_about_a_large_value() -> None:
    for above, accuracy in ((1e-9, 3e-4), (1e-11, 0.03), (1e-12, 0.3)):
        begin = 293.15 + above
        with pytest.warns(UserWarning, match="its error is up to 6.5.*e-14 K"):
            run = hb.simulate(hb.loads(COOLING.replace("293.1501", repr(begin))))
        finding, = run.verdict.findings
        assert finding.kind == "rounding" and finding.value == pytest.approx(above, rel=0.1)
        # a few units in the last place of 293 K
        assert worst(run.si["b.T"] - 293.15, cooled(run.time, begin)) < accuracy


def test_a_body_at_the_ambient_temperature_has_no_motion_to_be_resolved() -> None:
    run = hb.simulate(hb.loads(COOLING.replace("293.1501", "293.15")))
    assert run.verdict.status == "clean" and "sizes" not in run.statistics


@pytest.mark.parametrize("solver", ["auto", "cvodes"])
def test_a_motion_of_a_micrometre_at_a_kilometre(solver: str) -> None:
    run = hb.simulate(hb.loads(FAR), solver=solver)
    # 32 oscillations add up their errors
    assert worst(run.si["x.x"] - 1000, (1000.000001 - 1000) * np.cos(10 * run.time)) < 1e-4


@pytest.mark.parametrize(("offset", "ripple"), [(200.0, 1e-5), (2e5, 1e-2), (-50.0, 1e-3)])
def test_a_ripple_on_a_large_value_and_its_sensitivity(offset: float, ripple: float) -> None:
    text = RIPPLE.replace("OFFSET", repr(offset)).replace("RIPPLE", repr(ripple))
    run, moved = hb.simulate(hb.loads(text)), hb.simulate(hb.loads(text), sensitivities=["c.C"])

    def exact(tau: float, t: np.ndarray) -> np.ndarray:
        a = 10 * tau
        return np.asarray((np.sin(10 * t) - a * np.cos(10 * t) + a * np.exp(-t / tau)) / (1 + a**2))

    assert worst(run.si["q.v"] - offset, ripple * exact(0.1, run.time)) < 1e-6
    slope = (exact(0.1001, moved.time) - exact(0.0999, moved.time)) / 2e-4
    assert worst(moved.sensitivity("q.v", "c.C"), ripple * slope) < 1e-4


def test_the_accuracy_of_a_motion_does_not_depend_on_its_offset() -> None:
    runs = [hb.simulate(hb.loads(RIPPLE.replace("OFFSET", offset).replace("RIPPLE", "1e-3"))) for offset in ("0", "1e3")]
    assert worst(runs[1].si["q.v"] - 1e3, runs[0].si["q.v"]) < 1e-6


def test_a_fit_to_a_record_near_the_ambient_temperature(tmp_path: Path) -> None:
    t = np.linspace(0, 500, 101)
    path = experiment(tmp_path, COOLING, {"time_s": t, "T": 293.15 + cooled(t, constant=130.0)}, "b.T",
                      "{column: T, unit: K, noise: 1e-9 K}", "free: {r.R: 0.5 .. 2 K/W}")
    assert hb.fit(hb.load_experiment(path)).values["r.R"] == pytest.approx(1.3, rel=1e-4)


@compiled
@pytest.mark.parametrize("version", partly([3, 2], 2))
def test_an_fmu_near_the_ambient_temperature(version: int, tmp_path: Path) -> None:
    export_fmu(hb.loads(COOLING), path := tmp_path / "m.fmu", version=version)
    found = fmpy.simulate_fmu(str(path), fmi_type="CoSimulation", stop_time=500, output_interval=5, record_events=False)
    assert worst(found["T"] - 293.15, cooled(found["time"])) < 1e-5


RUBBED = """
model: rubbed
parameters: {mass: 1 kg}
components:
  ground: {is: Fixed}
  f: {is: DryFriction, F_c: =mass*1 N/kg, F_s: =mass*1 N/kg}
  m: {is: Mass, m: =mass}
  push: {is: ForceSource, u: "=2*mass*(1 m/s**2)*sin(2*pi*time/(1 s))"}
nodes: {g: [ground.a, f.a], b: [f.b, m.a, push.a]}
initial: {b.x: 0 m, b.v: 0 m/s}
simulate: {until: 0.4 s, every: 10 ms}
"""


@pytest.mark.parametrize("mass", [1e-9, 1e-6, 1e6])
def test_dry_friction_holds_and_slides_for_bodies_of_any_mass(mass: float) -> None:
    """a = 2 sin(w t) - 1 from the breakaway at sin(w t_0) = 1/2 on, with the default constants of the friction."""
    run = hb.simulate(hb.loads(RUBBED), parameters={"mass": mass})
    w, t = 2 * np.pi, run.time
    phase, begin = np.maximum(w * t, np.pi / 6), np.pi / 6
    speed = (2 * (np.cos(begin) - np.cos(phase)) - (phase - begin)) / w
    assert np.abs(run["b.v"] - speed).max() < 1e-7  # 1e-8 a step, in some hundred steps


SAMPLED = """
model: sampled
components:
  g: {is: Fixed}
  a: {is: DryFriction, F_c: 1e-9 N, F_s: 2e-9 N}
  c: {is: DryFriction, F_c: 1e-9 N, F_s: 1.5e-9 N}
  m: {is: Mass, m: 1e-9 kg}
  h: {is: SampleHold, T_s: 20 ms, u: "=8e-9 N*sin(5*time/(1 s))"}
  d: {is: Delay, T: 33 ms, u: =h.y}
  p: {is: ForceSource, u: =d.y}
nodes: {g: [g.a, a.a, c.a], b: [a.b, c.b, m.a, p.a]}
initial: {b.x: 0 m, b.v: 0 m/s}
simulate: {until: 1.5 s, every: 10 ms}
"""


@pytest.mark.long
def test_a_tiny_body_behind_events_and_a_delay_is_accurate() -> None:
    """The same machine with a billion times the mass and the forces moves alike. Jumps of the delayed force are far below
    the usual size of a force."""
    small = hb.simulate(hb.loads(SAMPLED))
    large = hb.simulate(hb.loads(SAMPLED.replace("e-9", "")))
    error = np.abs(np.asarray(small["b.x"]) - np.asarray(large["b.x"])).max() / np.ptp(large["b.x"])
    assert small.verdict.status == "clean"
    assert error < 1e-10  # numbers times a power of ten, but for rounding


@pytest.mark.parametrize("solver", SOLVERS[:3])
@pytest.mark.parametrize("amplitude", [1e-18, 1e-30])
def test_a_signal_far_below_any_unit(amplitude: float, solver: str) -> None:
    """First-order lag of a sine from rest: y = (sin wt - wT cos wt + wT exp(-t/T))/(1 + (wT)**2)."""
    run = hb.simulate(hb.loads(f"""
model: lag
components:
  sine: {{is: Sine, a: {amplitude} V, T: 10 ms}}
  lag: {{is: FirstOrderLag, T_1: 5 ms}}
nodes: {{u: [sine.y, lag.u]}}
initial: {{lag.y: 0 V}}
simulate: {{until: 50 ms}}
"""), solver=solver)
    t, wt = run.time, 2 * np.pi * run.time / 10e-3
    k = np.pi
    assert worst(run.si["lag.y"], amplitude * (np.sin(wt) - k * np.cos(wt) + k * np.exp(-t / 5e-3)) / (1 + k**2)) < 1e-5


def test_a_torsion_pendulum_of_tiny_angle_and_a_pressure_of_micropascals_beside_a_large_one() -> None:
    pendulum = hb.simulate(hb.loads("""
model: pendulum
components:
  i: {is: Inertia, J: 2e-3 kg*m**2}
  s: {is: TorsionSpring, c: 0.8 N*m/rad}
  w: {is: FixedShaft}
nodes: {x: [i.a, s.a], w: [s.b, w.a]}
initial: {x.phi: 1e-14 rad, x.w: 0 rad/s}
simulate: {until: 1 s}
"""))
    assert worst(pendulum.si["x.phi"], 1e-14 * np.cos(20 * pendulum.time)) < 1e-5
    oil = hb.simulate(hb.loads("""
model: leaks
components:
  v: {is: Volume, V: 1 L, beta: 1 GPa}
  g: {is: LaminarLeakage, C: 1e-12 m**3/(s*Pa)}
  t: {is: Tank}
  V: {is: Volume, V: 2 L, beta: 1 GPa}
  G: {is: LaminarLeakage, C: 1e-12 m**3/(s*Pa)}
nodes: {p: [v.a, g.a], t: [g.b, t.a, G.b], q: [V.a, G.a]}
initial: {p.p: 1e-6 Pa, q.p: 300 bar}
simulate: {until: 5 s}
"""), sensitivities=["g.C"])
    assert worst(oil.si["p.p"], 1e-6 * np.exp(-oil.time)) < 1e-5
    assert worst(oil.sensitivity("p.p", "g.C"), -1e6 * oil.time * np.exp(-oil.time)) < 1e-5


TRAIN = "exp(2e4*(cos(2*pi*time/(100 s)) - 1))"
TRAINS = {  # trains of narrow pulses: the diagram, the state, and its change by a pulse of unit area
    "heat": ("h: {is: HeatCapacity, m: 1 kg, c: 100 J/(kg*K)}\n  q: {is: HeatSource, u: '=10 W*TRAIN'}", "x.T",
             "300 K", 0.1),
    "oil": ("h: {is: Volume, V: 1 L, beta: 1 GPa}\n  q: {is: FlowSource, u: '=1e-7 m**3/s*TRAIN'}", "x.p", "200 bar", 1e5)}


@pytest.mark.parametrize(("train", "solver"), [("heat", "idas"), ("heat", "cvodes"), ("oil", "idas")])
def test_small_motions_of_many_steps_about_a_large_value_are_exact(train: str, solver: str) -> None:
    """The change after 20.5 periods is the area of the pulses, T (20.5 I_0(k) exp(-k)), whatever the value at the start."""
    parts, name, start, change = TRAINS[train]
    run = hb.simulate(hb.loads(f"model: train\ncomponents:\n  {parts.replace('TRAIN', TRAIN)}\nnodes: {{x: [h.a, q.a]}}\n"
                               f"initial: {{{name}: {start}}}\nsimulate: {{until: 2050 s}}\n"), solver=solver)
    area = 100 * 20.5 * ive(0, 2e4)
    assert run.verdict.status == "clean"
    # tolerances of 1e-8 of the motion a step add up in some 10 000 steps, in part
    assert run.si[name][-1] - run.si[name][0] == pytest.approx(change * area, rel=2e-5)
