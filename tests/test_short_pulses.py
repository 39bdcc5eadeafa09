"""Prescribed functions of time that are short in comparison with the run and the output interval are integrated."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from collected import partly

import heavebond as hb
from heavebond.numerics.forcing import Forcing
from heavebond.numerics.machine_code import compiler
from heavebond.numerics.quick_simulation import CaseSimulator, FitSimulator, QuickSimulator
from heavebond.numerics.simulator import Simulator

# A linear oscillator of 100 kg under a triangle of 1 kN; the displacement shortly after the peak is from SciPy's solve_ivp
# with the
# kinks as ends of its intervals and a tolerance of 1e-12.
MACHINE = """
model: table_pulse_machine
components:
  w: {is: Fixed}
  s: {is: SpringDamper, c: 10 kN/m, d: 2 kN*s/m}
  m: {is: Mass, m: 100 kg}
  t: {is: TableSource, t: [1800 s, 1800.5 s, 1801 s], v: [0 N, 1 kN, 0 N]}
  f: {is: ForceSource}
nodes: {u: [t.y, f.u], w: [w.a, s.a], m: [s.b, m.a, f.a]}
initial: {m.x: 0 m, m.v: 0 m/s}
show: {x: {is: m.x, unit: mm}}
simulate: {until: 3601.2 s, every: 1800.6 s}
"""
INTEGRAL = """
model: integral
parameters: {{t_0: {at}, w: {width}}}
components:
  pulse: {{is: Integrator, k: 1 1/s, u: "={formula}"}}
show: {{y: {{is: pulse.y, unit: "1"}}}}
simulate: {{until: {until}}}
"""
SOLVERS = ("idas", "cvodes", "rosenbrock", "fit", "quick", "case")
# formulas with an area of `share` times w
SHAPES = {
    "triangle": ("max(0, 1 - abs(time - t_0)/w)", 1.0),
    "bell": ("exp(-((time - t_0)/w)**2)", np.sqrt(np.pi)),
    "rectangle": ("if_else(time > t_0, 1, 0)*if_else(time < t_0 + w, 1, 0)", 1.0),
    "window": ("if_else(abs(time - t_0) < w/2, 1, 0)", 1.0),
    "sign": ("(1 - sign(abs(time - t_0) - w/2))/2", 1.0),
    "resonance": ("1/(1 + ((time - t_0)/w)**4)", np.pi / np.sqrt(2)),
    "steps": ("(tanh((time - t_0)/w) - tanh((time - t_0)/w - 2))/2", 2.0),
    "two": ("exp(-((time - t_0)/w)**2) + 0.01*exp(-((time - 0.3*t_0)/w)**2)", 1.01 * np.sqrt(np.pi)),
}


def made(assembly: hb.Assembly, solver: str) -> Simulator:
    if solver == "rosenbrock" and compiler() is None:
        pytest.skip("no C compiler")
    kinds = {"quick": QuickSimulator, "fit": FitSimulator, "case": CaseSimulator}
    return kinds[solver](assembly) if solver in kinds else Simulator(assembly, solver=solver)


def area(shape: str, at: str, width: str, until: str) -> hb.Assembly:
    return hb.assemble(hb.loads(INTEGRAL.format(formula=SHAPES[shape][0], at=at, width=width, until=until)))


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_triangle_of_a_table_source_moves_the_machine(solver: str) -> None:
    found = made(hb.assemble(hb.loads(MACHINE)), solver).run()
    assert found.si["x"][1] == pytest.approx(reference(), rel=1e-6)  # the tolerance of 1e-8 times some hundred steps


def reference() -> float:
    from scipy.integrate import solve_ivp

    state = np.zeros(2)
    for begin, end in ((0.0, 0.5), (0.5, 0.6)):
        def rates(t: float, y: np.ndarray) -> list[float]:
            force = 1000*max(0.0, 1 - abs(t - 0.5)/0.5)
            return [y[1], (force - 1e4*y[0] - 2e3*y[1])/100]
        state = solve_ivp(rates, (begin, end), state, rtol=1e-12, atol=1e-14).y[:, -1]
    return float(state[0])


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(("at", "width", "until"), [("1801.7 s", "50 ms", "3600 s"), ("314159.26 s", "1 ms", "1e6 s")])
def test_the_area_of_a_short_pulse(shape: str, at: str, width: str, until: str) -> None:
    found = hb.simulate(area(shape, at, width, until)).si["y"][-1]
    seconds = 1e-3 if width == "1 ms" else 0.05
    # the solver's tolerance of 1e-8 times the number of steps over a pulse, some hundreds
    assert found == pytest.approx(SHAPES[shape][1]*seconds, rel=2e-6, abs=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("shape", ["bell", "triangle"])
@pytest.mark.parametrize("solver", SOLVERS)
def test_each_solver_follows_a_pulse_whose_time_another_parameter_set_moves(shape: str, solver: str) -> None:
    simulator, share = made(area(shape, "1801.7 s", "50 ms", "3600 s"), solver), SHAPES[shape][1]
    assert simulator.run().si["y"][-1] == pytest.approx(0.05*share, rel=2e-6)
    assert simulator.run({"t_0": 77.7, "w": 0.02}).si["y"][-1] == pytest.approx(0.02*share, rel=2e-6)
    assert simulator.run({"t_0": 5000.0}).si["y"][-1] == pytest.approx(0, abs=1e-9)
    assert simulator.run({"t_0": 3333.0}).si["y"][-1] == pytest.approx(0.05*share, rel=2e-6)


@pytest.mark.parametrize("shape", ["bell", "triangle", "window"])
def test_the_sensitivity_of_the_area_of_a_pulse(shape: str) -> None:
    found = hb.simulate(area(shape, "1801.7 s", "50 ms", "3600 s"), sensitivities=["w", "t_0"])
    assert found.sensitivity("y", "w")[-1] == pytest.approx(SHAPES[shape][1], rel=1e-4)
    # between the outputs at 1800 and 1803.6 s the whole pulse passes
    assert found.sensitivity("y", "t_0")[-1] == pytest.approx(0, abs=1e-4)


CHAIN = """
model: chain
components:
  clock: {is: Ramp, rate: 1 s/s}
  shift: {is: Sum, k_1: 1, k_2: -1}
  late: {is: Constant, k: 2500.1 s}
  size: {is: Absolute}
  slope: {is: Gain, k: -4 1}
  one: {is: Sum, k_1: 1, k_2: 1}
  top: {is: Constant, k: 1 s}
  positive: {is: Maximum}
  zero: {is: Constant, k: 0 s}
  area: {is: Integrator, k: 1 1/s}
nodes:
  a: [clock.y, shift.u_1]
  b: [late.y, shift.u_2]
  c: [shift.y, size.u]
  d: [size.y, slope.u]
  e: [slope.y, one.u_1]
  f: [top.y, one.u_2]
  g: [one.y, positive.u_1]
  h: [zero.y, positive.u_2]
  i: [positive.y, area.u]
show: {y: {is: area.y, unit: s}}
simulate: {until: 3600 s}
"""


def test_a_triangle_made_by_a_chain_of_signal_blocks() -> None:
    assert hb.simulate(hb.loads(CHAIN)).si["y"][-1] == pytest.approx(0.25, rel=1e-7)


def write_nested(folder: Path) -> Path:
    """A bell by a function file, in a component inside a component."""
    (folder / "components").mkdir()
    (folder / "components" / "bell.yaml").write_text("""
function: bell
summary: Bell curve.
inputs: {x: {unit: 1, doc: distance}}
outputs: {y: {unit: 1, doc: height}}
equations: |
  square = x*x
  y = exp(-square)
""")
    (folder / "components" / "gust.yaml").write_text("""
component: Gust
summary: Gust.
ports:
  y: {signal: out, unit: 1, doc: height}
parameters:
  t_0: {unit: s, doc: time of the gust}
  w: {unit: s, doc: width}
equations: |
  y = bell((time - t_0)/w)
""")
    (folder / "m.yaml").write_text("""
model: nested
components:
  gust: {is: Gust, t_0: 1234.5 s, w: 0.1 s}
  twice: {is: Gain, k: 2}
  area: {is: Integrator, k: 1 1/s}
nodes: {a: [gust.y, twice.u], b: [twice.y, area.u]}
show: {y: {is: area.y, unit: "1"}}
simulate: {until: 3600 s}
""")
    return folder / "m.yaml"


def test_a_bell_in_a_function_of_a_component(tmp_path: Path) -> None:
    assert hb.simulate(write_nested(tmp_path)).si["y"][-1] == pytest.approx(0.2*np.sqrt(np.pi), rel=2e-6)


@pytest.mark.parametrize("kind", ["ModelExchange", "CoSimulation"])
@pytest.mark.parametrize("shape", partly(["triangle", "bell", "window"], 3))
def test_an_fmu_meets_a_short_pulse_whose_time_a_parameter_moves(tmp_path: Path, shape: str, kind: str) -> None:
    import fmpy

    from heavebond.exchange.fmu_export import export_fmu

    model = hb.loads(INTEGRAL.format(formula=SHAPES[shape][0], at="1801.7 s", width="50 ms", until="3600 s"))
    export_fmu(model, tmp_path / "m.fmu")
    for values in ({}, {"t_0": 2222.2}):
        found = fmpy.simulate_fmu(str(tmp_path / "m.fmu"), fmi_type=kind, stop_time=3600.0, output_interval=3.6,
                                  start_values=values, relative_tolerance=1e-8)
        assert found["y"][-1] == pytest.approx(0.05*SHAPES[shape][1], rel=1e-3)  # the importer's tolerance is its own


def test_exported_c_names_the_instants_at_which_an_integrator_stops(tmp_path: Path) -> None:
    import ctypes
    import subprocess

    from heavebond.exchange.c_code import export_c

    if (command := compiler()) is None:
        pytest.skip("no C compiler")
    model = hb.loads(INTEGRAL.format(formula=SHAPES["triangle"][0], at="1801.7 s", width="50 ms", until="3600 s"))
    made = export_c(model, tmp_path / "pulse.c")
    subprocess.run([command, "-shared", "-fPIC", "-o", tmp_path / "pulse.so", tmp_path / "pulse.c", "-lm"], check=True)
    library = ctypes.CDLL(str(tmp_path / "pulse.so"))
    library.pulse_next_stop.restype = ctypes.c_double
    p = (ctypes.c_double*len(made.parameters))(*(q.start for q in made.parameters))
    found, t = [], 0.0
    while (t := library.pulse_next_stop(ctypes.c_double(t), p)) < np.inf:
        found.append(t)
    assert found == pytest.approx([1801.65, 1801.7, 1801.75], abs=1e-9)


def test_the_verdict_names_a_function_of_time_without_a_bound() -> None:
    """Near 1000.3 s it oscillates faster and faster, without end."""
    text = INTEGRAL.format(formula="sin(w/(time - t_0))", at="1000.3 s", width="1 s", until="3600 s")
    assembly = hb.assemble(hb.loads(text))
    unknown = Forcing(assembly).stops(np.linspace(0, 3600, 1001), assembly.p).unknown
    assert len(unknown) == 1 and "sin" in unknown[0] and "t_0" in unknown[0]
    result = hb.simulate(assembly, until=900.0)
    verdict = replace(result, statistics={**result.statistics, "unknown_forcing": unknown}).verdict
    assert verdict.status == "outside" and "no bound" in verdict.text


@pytest.mark.parametrize("every", ["3600 s", "450 s"])
def test_a_pulse_is_met_whatever_the_output_interval(every: str) -> None:
    """With the default of 1000 points a bell of 20 s is seen by these, with few points it must be looked for."""
    found = hb.simulate(area("bell", "1801.7 s", "20 s", "3600 s"), every=every)
    assert found.si["y"][-1] == pytest.approx(20*np.sqrt(np.pi), rel=2e-6)


@pytest.mark.parametrize("part", ["TableSource, t", "Lookup, u: =time, x"])
@pytest.mark.parametrize(("period", "until"), [("1000 s", "3600 s"), ("30 s", "3600 s"), ("20 ns", "1 us")])
def test_a_table_that_repeats_is_met_in_each_period(part: str, period: str, until: str) -> None:
    """A triangle of area 0.01 T in each period T; the error is that of a run with two kinks a pulse."""
    number, unit = period.split()
    T = float(number)*{"s": 1.0, "ns": 1e-9}[unit]
    points = f"[0 s, {0.5*T!r} s, {0.51*T!r} s, {0.52*T!r} s, {T!r} s]"
    dt = ", dt: 1e-12 s" if part.startswith("Table") else ""
    text = f"""
model: repeated
components:
  k: {{is: {part}: {points}, outside: 2, v: [0, 0, 1, 0, 0]{dt}}}
  i: {{is: Integrator, k: 1 1/s, u: =k.y}}
initial: {{i.y: 0}}
simulate: {{until: {until}}}
"""
    found = hb.simulate(hb.loads(text))
    end = float(found.time[-1])
    whole = np.floor(end/T) + (end/T % 1 > 0.52)
    assert found["i.y"][-1] == pytest.approx(0.01*T*whole, rel=1e-7)
    assert found.verdict.status == "clean", found.verdict.text
    assert Forcing(found.assembly).stops(found.time, found.assembly.p).unknown == ()


def test_a_table_that_repeats_has_its_steps_at_the_end_of_a_period() -> None:
    """Rectangles of 1 s every 2 s from 2 s on, before the first point too: 6.5 s of 13 s."""
    found = hb.simulate(hb.loads("""
model: rectangles
components:
  k: {is: TableSource, outside: 2, t: [2 s, 2 s, 3 s, 3 s, 4 s], v: [0, 1, 1, 0, 0]}
  i: {is: Integrator, k: 1 1/s, u: =k.y}
initial: {i.y: 0}
simulate: {from: -3.5 s, until: 9.5 s}
"""))
    assert found["i.y"][-1] == pytest.approx(6.5, abs=1e-7)  # a step takes 1 ns
    with pytest.raises(hb.HeavebondError, match=r"v\[1\] == v\[n\]"):
        hb.simulate(hb.loads("model: open\ncomponents:\n  k: {is: TableSource, outside: 2, t: [0 s, 1 s], v: [0, 1]}\n"
                             "simulate: {until: 1 s}\n"))


@pytest.mark.parametrize("solver", ["auto", "idas", "cvodes"])
@pytest.mark.parametrize("width", [0.005, 0.5])
def test_a_spike_in_a_quiet_record_is_integrated(width: float, solver: str, tmp_path: Path) -> None:
    """A triangle of two rows and a top charges a capacitor. A multistep method that goes on with its history over the top
    takes a step of 3 % of the area: the mean slope before the top is the slope after it."""
    rows = [*((500.0 * k, 0.0) for k in range(11)), (7000.0, 0.0), (7000.0 + width, 2.0), (7000.0 + 2 * width, 0.0),
            (10000.0, 0.0)]
    (tmp_path / "spike.csv").write_text("t,i\n" + "".join(f"{t!r},{i}\n" for t, i in rows), encoding="utf-8")
    (tmp_path / "spike.yaml").write_text("""
model: spike
components:
  i: {is: CurrentSource, u: {file: spike.csv, column: i, unit: A, interpolation: linear, gaps: bridge}}
  c: {is: Capacitor, C: 1 F}
  r: {is: Resistor, R: 1 kohm}
  g: {is: ElectricalGround}
nodes: {p: [i.a, c.a, r.a], n: [i.b, c.b, r.b, g.a]}
initial: {p.v: 0 V}
simulate: {until: 9000 s}
""", encoding="utf-8")
    found = hb.simulate(hb.load(tmp_path / "spike.yaml"), solver=solver).si["p.v"][-1]
    # the spike is symmetric about its top; 1e-5 is the accuracy of a run at the default tolerances
    assert found == pytest.approx(2 * width * np.exp(-(2000 - width) / 1000), rel=1e-5)


def test_steps_in_a_record_of_noise_are_no_kinks() -> None:
    from heavebond.numerics.inputs import Pieced

    breaks, random = np.arange(1001.0), np.random.default_rng(1)
    values = random.standard_normal(1001)
    columns = np.vstack([breaks[:-1], values[:-1], np.diff(values), np.zeros((2, 1000))])
    assert len(Pieced(breaks, columns).kinks()) == 0
    values = np.where(breaks > 400, 1.0, 0.0)
    columns = np.vstack([breaks[:-1], values[:-1], np.zeros((3, 1000))])
    assert Pieced(breaks, columns).kinks().tolist() == [401.0]


@pytest.mark.parametrize("solver", ["auto", "idas", "cvodes"])
def test_a_narrow_pulse_passes_a_long_delay(solver: str) -> None:
    found = hb.simulate(hb.loads("""
model: late
components:
  d: {is: Delay, T: 333.3 s, u: "=exp(-((time - 500.0003 s)/1 ms)**2)"}
  i: {is: Integrator, k: 1 1/s}
nodes: {b: [d.y, i.u]}
simulate: {until: 1000 s, every: 100 s}
"""), solver=solver).si["i.y"]
    assert found[8] == pytest.approx(0, abs=1e-9)
    assert found[9] == pytest.approx(np.sqrt(np.pi) * 1e-3, rel=1e-5)
