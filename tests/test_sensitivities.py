"""Forward sensitivities against fourth-order central differences of runs at tight tolerances."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from collected import partly

import heavebond as hb
from heavebond.numerics.dae import Assembly
from heavebond.numerics.simulator import Simulator, Tolerances

# differences of runs at 1e-12 with steps of 1e-3 of each parameter are right to about 1e-12/1e-3 + (1e-3)**4
TIGHT = Tolerances(1e-12, 1e-14, along=1.0)

SLIDER = """
model: slider
components:
  wall:   {is: Fixed}
  spring: {is: Spring, c: 1.2 kN/m}
  damper: {is: Damper, d: 4 N*s/m}
  cart:   {is: Mass, m: 2.5 kg}
nodes:
  ground: [wall.a, spring.a, damper.a]
  load:   [spring.b, damper.b, cart.a]
initial: {load.x: 50 mm, load.v: 0.1 m/s}
simulate: {until: 2 s, every: 20 ms}
"""

HANGING = """
model: hanging
components:
  wall:   {is: Fixed}
  spring: {is: Spring, c: 1.2 kN/m}
  cart:   {is: Mass, m: 2.5 kg}
  weight: {is: Weight, m: 2.5 kg}
  push:   {is: ForceSource, u: "=5 N*(1 - cos(3 1/s * time))"}
nodes:
  ground: [wall.a, spring.a]
  load:   [spring.b, cart.a, weight.a, push.a]
initial: {start: steady}
simulate: {until: 2 s, every: 20 ms}
"""

PRELOADED = """
model: preloaded
components:
  wall:   {is: Fixed}
  spring: {is: GasSpring, c: 4 kN/m, d: 300 N*s/m, F_0: 1 kN, A: 20 cm**2}
  cart:   {is: Mass, m: 250 kg}
  weight: {is: Weight, m: 250 kg}
  push:   {is: ForceSource, u: "=50 N*sin(3 1/s * time)"}
nodes:
  ground: [wall.a, spring.a]
  load:   [spring.b, cart.a, weight.a, push.a]
  oil:    [spring.p]
initial: {start: steady, load.x: 20 mm, solve: [spring.F_0]}
simulate: {until: 2 s, every: 20 ms}
"""

LOOP = """
model: loop
components:
  source: {is: PressureSource, p_0: 100 bar}
  first:  {is: Orifice, q_r: 60 L/min, dp_r: 10 bar}
  second: {is: Orifice, q_r: 40 L/min, dp_r: 10 bar}
  tank:   {is: Tank}
nodes:
  high: [source.a, first.a]
  mid:  [first.b, second.a]
  low:  [second.b, tank.a]
simulate: {until: 1 s, every: 100 ms}
"""

MEASURED = """
model: measured
components:
  table:  {is: PositionSource, u: {file: table.csv, column: x_m, unit: m, interpolation: spline}}
  spring: {is: Spring, c: 1.2 kN/m}
  damper: {is: Damper, d: 4 N*s/m}
  cart:   {is: Mass, m: 2.5 kg}
nodes:
  table: [table.a, spring.a, damper.a]
  load:  [spring.b, damper.b, cart.a]
initial: {load.x: 0 m, load.v: 0 m/s}
simulate: {until: 2 s, every: 20 ms}
"""

PENDULUM = """
model: pendulum
components:
  bob: {is: PlanarPendulum, m: 2 kg, l: 1.5 m}
initial: {bob.y: ~ -1.4 m, bob.x: 0.4 m, bob.v_x: 0 m/s}
simulate: {until: 2 s, every: 20 ms}
"""

PENDULUM_COMPONENT = """
component: PlanarPendulum
summary: A point mass on a rigid rod in Cartesian coordinates.
parameters:
  m: {unit: kg, min: 0, doc: mass}
  l: {unit: m, min: 0, doc: length of the rod}
  g: {unit: m/s**2, default: 9.81 m/s**2, doc: gravity}
variables:
  x:   {unit: m, doc: horizontal position}
  y:   {unit: m, doc: height above the pivot}
  v_x: {unit: m/s, doc: horizontal velocity}
  v_y: {unit: m/s, doc: vertical velocity}
  s:   {unit: N/m, doc: rod force per length}
equations: |
  v_x        = der(x)               # horizontal velocity
  v_y        = der(y)               # vertical velocity
  m*der(v_x) = -s*x                 # Newton, horizontally
  m*der(v_y) = -s*y - m*g           # Newton, vertically
  x**2 + y**2 = l**2                # the rod is rigid
"""


# the force jumps between two output points, and stays between them while the parameter moves
SWITCHED = """
model: switched
components:
  wall:   {is: Fixed}
  spring: {is: Spring, c: 1.2 kN/m}
  cart:   {is: Mass, m: 2.5 kg}
  step:   {is: Step, t_s: 0.69 s, after: 30 N}
  push:   {is: ForceSource}
nodes:
  ground: [wall.a, spring.a]
  load:   [spring.b, cart.a, push.a]
  force:  [step.y, push.u]
initial: {load.x: 50 mm, load.v: 0.1 m/s}
simulate: {until: 2 s, every: 20 ms}
"""


def _text(text: str) -> Callable[[Path], Assembly]:
    def build(folder: Path) -> Assembly:
        t = np.arange(0, 2.2, 0.02)
        rows = "\n".join(f"{a:.2f},{0.05 * np.sin(5 * a) * a:.9f}" for a in t)
        (folder / "table.csv").write_text("t_s,x_m\n" + rows + "\n", encoding="utf-8")
        (folder / "pendulum.yaml").write_text(PENDULUM_COMPONENT, encoding="utf-8")
        return hb.assemble(hb.loads(text, folder))
    return build


def _bundled(name: str) -> Callable[[Path], Assembly]:
    return lambda folder: hb.assemble(hb.load(name))


# model, signal, parameters, until
CASES = {
    "damped oscillator": (_text(SLIDER), "load.x", ["spring.c", "cart.m", "initial.load.x", "initial.load.v"], 2),
    "steady start": (_text(HANGING), "load.x", ["spring.c", "cart.m", "weight.m"], 2),
    "solved preload": (_text(PRELOADED), "spring.F", ["weight.m", "spring.c", "cart.m"], 2),
    "algebraic loop": (_text(LOOP), "mid.p", ["first.q_r", "second.q_r", "source.p_0"], 1),
    "measured input": (_text(MEASURED), "load.x", ["spring.c", "damper.d", "scale.table.u"], 2),
    "index 3": (_text(PENDULUM), "bob.x", ["bob.l", "bob.g", "initial.bob.x"], 2),
    "time event": (_text(SWITCHED), "load.x", ["step.t_s", "step.after", "spring.c"], 2),
    "cylinder": (_bundled("cylinder_rig"), "load.x", ["cylinder.beta", "valve.f_n", "load.m"], 3),
    "receiver": (_bundled("receiver_rig"), "receiver.p", ["inlet.C", "outlet.C", "receiver.V"], 5),
    "tanks": (_bundled("cascaded_tanks"), "lower.h", ["outlet_1.C", "pump.k"], 400),
    "compensator": (_bundled("cmc_ahc/active_frictionless"), "WOB",
                    ["controller.K_p", "controller.K_v", "wave.a", "ahc.valve.f_n"], 10),
}


@pytest.mark.parametrize("case", partly(CASES, 3))
def test_sensitivities_agree_with_differences(case: str, tmp_path: Path) -> None:
    build, signal, parameters, until = CASES[case]
    assembly = build(tmp_path)
    along = Simulator(assembly, until, tolerances=TIGHT, sensitivities=parameters).run()
    plain = Simulator(assembly, until, tolerances=TIGHT)
    for name in parameters:
        value = assembly.parameter_values[name]
        step = 3e-3 * (abs(value) or 1.0)  # wide enough for the noise of the runs, of sixth order besides
        runs = {k: plain.run({name: value + k * step}).display[signal] for k in (-3, -2, -1, 1, 2, 3)}
        difference = (45 * (runs[1] - runs[-1]) - 9 * (runs[2] - runs[-2]) + (runs[3] - runs[-3])) / (60 * step)
        exact = along.sensitivity(signal, name)
        assert np.abs(exact - difference).max() <= 1e-6 * np.abs(exact).max()


def test_the_default_weight_is_right_to_a_few_parts_in_ten_thousand() -> None:
    assembly = hb.assemble(hb.load("cmc_ahc"))
    names = ["controller.K_p", "crown.m"]
    default = hb.simulate(assembly, "36 s", sensitivities=names)
    tight = Simulator(assembly, "36 s", tolerances=Tolerances(1e-10, 1e-12, along=1.0), sensitivities=names).run()
    for name in names:
        exact = tight.sensitivity("WOB", name)
        assert np.abs(default.sensitivity("WOB", name) - exact).max() < 3e-4 * np.abs(exact).max()


def test_unknown_names_and_missing_sensitivities_are_said(tmp_path: Path) -> None:
    assembly = _text(SLIDER)(tmp_path)
    with pytest.raises(hb.UsageError, match=r"Did you mean 'spring.c'"):
        hb.simulate(assembly, sensitivities=["spring.k"])
    result = hb.simulate(assembly, sensitivities=["spring.c"])
    with pytest.raises(hb.UsageError, match=r"no sensitivities to 'cart\.m'"):
        result.sensitivity("load.x", "cart.m")


def test_shown_outputs_have_sensitivities_in_their_own_unit() -> None:
    result = hb.simulate(hb.load("cmc_ahc"), "2 s", sensitivities=["wave.a"])
    assert result.sensitivity("platform", "wave.a") == pytest.approx(result.sensitivity("platform.x", "wave.a"))
    assert result.sensitivity("WOB", "wave.a") == pytest.approx(
        1e-3 * result.sensitivity("drilling.formation.N", "wave.a"))
