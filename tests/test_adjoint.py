"""Gradients by runs backwards against forward sensitivities, which have tests of their own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from test_sensitivities import LOOP, MEASURED, PENDULUM, PRELOADED, _bundled, _text

import heavebond as hb
from heavebond.language.library import bundled
from heavebond.language.model import loads
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.simulator import Simulator, Tolerances
from heavebond.optimise.adjoint import Adjoint
from heavebond.optimise.cost_evaluation import Evaluator
from heavebond.optimise.costs import read_cost
from heavebond.optimise.objective import Objective, TuningProblem, ranges
from heavebond.optimise.tuning import tune

TIGHT = Tolerances(1e-10, 1e-12, along=0.1)

# A record that jumps from sample to sample pushes a cart: its scale is a parameter, and every jump a stop.
PUSHED = MEASURED.replace("PositionSource", "ForceSource")\
    .replace("unit: m, interpolation: spline", "unit: kN, interpolation: hold") \
    .replace("components:", "components:\n  wall:   {is: Fixed}") \
    .replace("table: [table.a, spring.a, damper.a]", "ground: [wall.a, spring.a, damper.a]") \
    .replace("load:  [spring.b", "load:  [table.a, spring.b")

TEN = ["controller.K_p", "controller.K_v", "wave.a", "crown.m", "ahc.valve.f_n", "cmc.friction.F_c", "cmc.friction.F_s",
       "drilling.string.c", "cmc.gas.c", "cmc.gas.d"]
INDEX = "rms(crown.x)/ref(rms(crown.x)) + rms(crown.v)/ref(rms(crown.v))"

# model, costs, parameters, evaluated from, to
CASES = {
    "steady start, solved preload": (_text(PRELOADED), ["rms(spring.F)/1 N + rms(load.v)/1 m*1 s", "final(spring.F)/1 kN"],
                                     ["weight.m", "spring.c", "cart.m"], 1, 2),
    "initial values": (_text(MEASURED), ["mean(load.x**2)/1 cm/1 cm"], ["initial.load.x", "initial.load.v"], 0, 2),
    "spline through a record": (_text(MEASURED), ["rms(load.x)/1 mm", "final(load.v)/1 m*1 s"],
                                ["spring.c", "damper.d", "scale.table.u"], 1, 2),
    "record that jumps": (_text(PUSHED), ["rms(load.x)/1 mm", "mean(load.v)/1 m*1 s"],
                          ["spring.c", "damper.d", "cart.m", "scale.table.u"], 1, 2),
    "algebraic loop": (_text(LOOP), ["mean(mid.p)/1 bar + final(mid.p)/1 bar"], ["first.q_r", "source.p_0"], 0, 1),
    "index 3": (_text(PENDULUM), ["mean(bob.x**2)/1 m/1 m + final(bob.s)/1 N*1 m", "peak(bob.v_x)/1 m*1 s"],
                ["bob.l", "bob.g", "initial.bob.x"], 1, 2),
    "cylinder": (_bundled("cylinder_rig"), ["rms(load.x)/1 mm"], ["cylinder.beta", "valve.f_n", "load.m"], 1, 3),
}


def _evaluated(assembly: Assembly, costs: list[str], begin: float, end: float, tolerances: Tolerances
               ) -> tuple[Simulator, Evaluator]:
    read = [read_cost(assembly, cost) for cost in costs]
    evaluator = Evaluator(assembly, read, begin, end)
    return Simulator(assembly, times=np.unique([0.0, begin, end]), tolerances=tolerances,
                     quadratures=evaluator.quadratures, factors=evaluator.factors), evaluator


def _forward(plain: Simulator, evaluator: Evaluator, names: list[str], references: Array) -> list[tuple[float, Array]]:
    run = Simulator(plain.assembly, times=plain.time, tolerances=plain.tolerances, quadratures=evaluator.quadratures,
                    factors=evaluator.factors, sensitivities=names).run()
    assert run.along is not None
    return evaluator.cost_values(*evaluator.functional_values(run), references, run.p, run.along.p)


@pytest.mark.parametrize("case", list(CASES))
def test_a_run_backwards_agrees_with_forward_sensitivities(case: str, tmp_path: Path) -> None:
    build, costs, names, begin, end = CASES[case]
    plain, evaluator = _evaluated(build(tmp_path), costs, begin, end, TIGHT)
    run = plain.run()
    references = np.zeros(len(evaluator.functionals))
    exact = _forward(plain, evaluator, names, references)
    values = np.abs([plain.assembly.parameter_values[n] or 1.0 for n in names])
    for (cost, gradient), (wanted, forward) in zip(Adjoint(plain, evaluator, names).costs(run, references), exact,
                                                   strict=True):
        assert cost == pytest.approx(wanted, rel=1e-7)
        assert np.abs((gradient - forward) * values).max() <= 1e-5 * np.abs(forward * values).max()


def test_ten_parameters_of_the_compensator() -> None:
    """Ten at once, on the machine whose time `make bench` compares with that of forward sensitivities."""
    assembly = hb.assemble(hb.load("cmc_ahc"))
    plain, evaluator = _evaluated(assembly, [INDEX], 12, 36, Tolerances(1e-8, 1e-10))
    run = plain.run()
    references = evaluator.functional_values(run)[0] * 1.3
    adjoint = Adjoint(plain, evaluator, TEN)
    (_, gradient), (_, forward) = adjoint.costs(run, references)[0], _forward(plain, evaluator, TEN, references)[0]
    values = np.abs([assembly.parameter_values[n] for n in TEN])
    assert np.abs((gradient - forward) * values).max() <= 1e-4 * np.abs(forward * values).max()


def test_there_is_room_for_longer_runs_than_the_first(tmp_path: Path) -> None:
    """The steps that are kept grow with the run: a stiffer spring swings faster."""
    assembly = _text(MEASURED)(tmp_path)
    plain, evaluator = _evaluated(assembly, ["rms(load.x)/1 mm"], 1, 2, TIGHT)
    adjoint, none = Adjoint(plain, evaluator, ["spring.c"]), np.zeros(1)
    adjoint.costs(plain.run({"spring.c": 1.0}), none)
    stiff = {"spring.c": 1e6}
    gradient = adjoint.costs(plain.run(stiff), none)[0][1]
    again = _evaluated(assembly.with_parameters(stiff), ["rms(load.x)/1 mm"], 1, 2, TIGHT)
    assert gradient == pytest.approx(_forward(*again, ["spring.c"], none)[0][1], rel=1e-5)


@pytest.mark.parametrize("name", ["cmc_ahc", "cylinder_rig"])
def test_one_call_gives_what_a_run_and_a_run_backwards_do(name: str) -> None:
    """At parameters that were not run before: the unknown values of the integrals do not matter to the way back."""
    chosen = {"cmc_ahc": TEN, "cylinder_rig": ["cylinder.beta", "valve.f_n", "load.m"]}[name]
    cost = {"cmc_ahc": INDEX, "cylinder_rig": "rms(load.x)/1 mm + mean(load.v**2)*1 s*1 s/1 m/1 m"}[name]
    assembly, end = hb.assemble(hb.load(name)), {"cmc_ahc": 36, "cylinder_rig": 3}[name]
    plain, evaluator = _evaluated(assembly, [cost], end / 3, end, Tolerances(1e-8, 1e-10))
    adjoint, known = Adjoint(plain, evaluator, chosen), assembly.parameter_values
    references = 1.3 * evaluator.functional_values(plain.run())[0]
    adjoint.at(known, references)
    other = {**known, chosen[0]: 1.02 * known[chosen[0]]}
    (value, gradient), = adjoint.at(other, references)
    (wanted, exact), = adjoint.costs(plain.run(other), references)
    sizes = np.abs([known[n] for n in chosen])
    assert value == pytest.approx(wanted, rel=1e-6)
    assert np.abs((gradient - exact) * sizes).max() <= 1e-4 * np.abs(exact * sizes).max()


def test_a_cost_without_slope_has_none(tmp_path: Path) -> None:
    plain, evaluator = _evaluated(_text(PRELOADED)(tmp_path), ["rms(load.x)/ref(rms(load.x))*0 + spring.c/1 kN*1 m"], 1,
                                  2, TIGHT)
    cost, gradient = Adjoint(plain, evaluator, ["weight.m", "spring.c"]).costs(plain.run(), np.ones(2))[0]
    assert cost == 4.0
    assert gradient.tolist() == [0.0, 1e-3]


def test_unknown_parameters_are_said(tmp_path: Path) -> None:
    plain, evaluator = _evaluated(_text(PRELOADED)(tmp_path), ["rms(load.x)"], 1, 2, TIGHT)
    with pytest.raises(hb.UsageError, match=r"'spring.k' cannot be set"):
        Adjoint(plain, evaluator, ["spring.k"])


# -- tuning ----------------------------------------------------------------------------------------------------------
CHAIN = """
model: chain
summary: Three carts in a row, shaken by a force; springs and dampers to be tuned.
components:
  wall: {is: Fixed}
  s_1: {is: Spring, c: 1 kN/m}
  s_2: {is: Spring, c: 1 kN/m}
  s_3: {is: Spring, c: 1 kN/m}
  d_1: {is: Damper, d: 20 N*s/m}
  d_2: {is: Damper, d: 20 N*s/m}
  d_3: {is: Damper, d: 20 N*s/m}
  m_1: {is: Mass, m: 10 kg}
  m_2: {is: Mass, m: 10 kg}
  m_3: {is: Mass, m: 10 kg}
  shaker: {is: ForceSource, u: "=20 N*sin(7 rad/s * time)"}
nodes:
  ground: [wall.a, s_1.a, d_1.a]
  one:    [s_1.b, d_1.b, m_1.a, s_2.a, d_2.a]
  two:    [s_2.b, d_2.b, m_2.a, s_3.a, d_3.a]
  three:  [s_3.b, d_3.b, m_3.a, shaker.a]
initial: {one.x: 0 m, one.v: 0 m/s, two.x: 0 m, two.v: 0 m/s, three.x: 0 m, three.v: 0 m/s}
simulate: {until: 20 s, every: 0.1 s}
"""
NINE = TuningProblem(ranges({f"s_{k}.c": "0.5 .. 2 kN/m" for k in (1, 2, 3)} | {f"d_{k}.d": "1 .. 100 N*s/m" for k in (1, 2,
                                                                                                                       3)}
                            | {f"m_{k}.m": "9 .. 11 kg" for k in (1, 2, 3)}),
                     "rms(three.x)/1 mm", ("rms(one.x) < 10 mm",), begin=10.0, end=20.0)


@pytest.fixture(scope="module")
def chain() -> Assembly:
    return hb.assemble(hb.loads(CHAIN))


def test_many_free_parameters_are_tuned_by_runs_backwards(chain: Assembly) -> None:
    objective = Objective(chain, NINE)
    assert objective.backwards
    at = objective.start
    exact = objective.evaluate(at)
    for k in range(9):
        step = np.zeros(9)
        step[k] = 5e-3
        runs = [objective.plain(at + n * step) for n in (-2, -1, 1, 2)]
        costs = np.array([[run.cost, *run.limits] for run in runs])
        differences = (8 * (costs[2] - costs[1]) - (costs[3] - costs[0])) / (12 * 5e-3)
        assert exact.gradient[k] == pytest.approx(differences[0], abs=2e-3 * np.abs(exact.gradient).max())
        assert exact.limit_gradients[0][k] == pytest.approx(differences[1],
                                                            abs=2e-3 * np.abs(exact.limit_gradients).max())


@pytest.mark.long
def test_both_ways_end_at_one_optimum(chain: Assembly, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where the run backwards always breaks down: then the gradients are taken forward."""
    backwards = tune(chain, NINE)

    def failing(*_: object) -> None:
        raise hb.SimulationError("the run backwards stopped")

    monkeypatch.setattr(Adjoint, "costs", failing)
    forward = tune(chain, NINE)
    assert backwards.cost == pytest.approx(forward.cost, rel=1e-3)
    assert max(backwards.limits.values()) < 1e-3


SWINGS = """
model: pendulum
components: {bob: {is: Pendulum, m: 0.7 kg, L: 1.3 m}}
initial: {bob.x: 0 m, bob.y: ~ -1.3 m, bob.v_x: SPEED m/s}
simulate: {until: 1.5 s}
"""
HEIGHT = "mean((bob.y + 2 m)**2)/1 m/1 m"


def _pendulum(speed: float) -> Assembly:
    return hb.assemble(loads(SWINGS.replace("SPEED", f"{speed:g}"), bundled("models") / "mechanisms"))


def test_where_states_change_the_way_back_is_refused_and_tuning_goes_forward() -> None:
    """A pendulum that turns over: no gradient through its first choice of states would be right."""
    assembly, names = _pendulum(9), ["bob.L", "bob.g", "initial.bob.v_x", "bob.m"]
    plain, evaluator = _evaluated(assembly, [HEIGHT], 0, 1.5, TIGHT)
    adjoint, references = Adjoint(plain, evaluator, names), np.zeros(len(evaluator.functionals))
    with pytest.raises(hb.SimulationError, match=r"(?s)states change at t = .*forward sensitivities") as caught:
        adjoint.costs(plain.run(), references)
    assert "bob.x, bob.v_x -> bob.y, bob.v_y" in str(caught.value)
    with pytest.raises(hb.SimulationError, match="states change"):
        adjoint.at(assembly.parameter_values, references)

    free = ranges(dict(zip(names, ("1 .. 2 m", "9 .. 10 m/s**2", "8.5 .. 9.5 m/s", "0.5 .. 1 kg"), strict=True)))
    objective = Objective(assembly, TuningProblem(free, HEIGHT))
    case = objective.cases[0]
    case.adjoint = Adjoint(case.plain, case.evaluator, names)  # for so few parameters runs would go forward anyhow
    exact, step = objective.evaluate(objective.start).gradient, 5e-3
    assert case.adjoint is None
    for k in range(len(names)):  # a pendulum near its top magnifies what tolerances leave open
        at = objective.start + step * np.eye(len(names))[k] * np.array([[-2], [-1], [1], [2]])
        low, lower, higher, high = (objective.plain(y).cost for y in at)
        assert exact[k] == pytest.approx((8 * (higher - lower) - (high - low)) / (12 * step),
                                         abs=1e-2 * np.abs(exact).max())


def test_a_mechanism_that_keeps_its_states_has_a_way_back() -> None:
    """The same pendulum where it swings little."""
    assembly, names = _pendulum(1), ["bob.L", "bob.g", "initial.bob.v_x"]
    plain, evaluator = _evaluated(assembly, [HEIGHT], 0, 1.5, TIGHT)
    references = np.zeros(len(evaluator.functionals))
    (cost, gradient), = Adjoint(plain, evaluator, names).costs(plain.run(), references)
    (wanted, forward), = _forward(plain, evaluator, names, references)
    assert cost == pytest.approx(wanted, rel=1e-7)
    assert np.abs(gradient - forward).max() <= 1e-5 * np.abs(forward).max()
