"""Linear analysis of loops with samples: poles, margins and limits against python-control, z-transforms and runs."""

from __future__ import annotations

import json
from pathlib import Path

import control
import numpy as np
import pytest
from diagrams import SAMPLED_LOOP
from scipy.linalg import expm

import heavebond as hb
from heavebond.cli import main
from heavebond.core.errors import UsageError
from heavebond.linear.held_variables import sampled_lines
from heavebond.linear.linear_system import StateSpaces
from heavebond.linear.linearisation import ModesAtStart
from heavebond.linear.margins import crossings, loops, open_loop
from heavebond.linear.stability import MARGINAL, STABLE, UNDECIDED, UNSTABLE
from heavebond.numerics.dae import assemble
from heavebond.optimise.objective import Objective, tuning_task

POSITION = """
model: sampled_position
parameters: {K: 20 N/m}
components:
  m: {is: Mass, m: 2 kg}
  f: {is: ForceSource, u: 0 N}
  k: {is: ForceSource}
  h: {is: SampleHold, T_s: 40 ms, u: "=-K*b.x - 9 N*s/m*b.v"}
nodes: {y: [h.y, k.u], b: [f.a, m.a, k.a]}
initial: {b.x: 0.1 m, b.v: 0 m/s}
simulate: {until: 4 s, every: 10 ms}
"""
# q+ = p q + u, y = c q + d u: C(z) = d + c/(z - p)
COMPENSATOR = """
component: Compensator
summary: A discrete transfer function of first order.
source: A test.
ports: {u: {signal: in, unit: 1, doc: input}, y: {signal: out, unit: 1, doc: output}}
parameters:
  T_s: {unit: s, doc: period}
  t_0: {unit: s, default: 0 s, doc: first sample}
  p: {unit: 1, doc: pole}
  c: {unit: 1, doc: gain of the pole}
  d: {unit: 1, doc: direct gain}
variables: {q: {unit: 1, held: 0, doc: state}, v: {unit: 1, held: 0, doc: output}}
equations: |
  y = v
when: {sample: {every: T_s, from: t_0, then: {q: p*q + u, v: c*q + d*u}}}
"""
LOOP = """
model: loop
components:
  c: {is: Compensator, T_s: 0.1 s, p: 0, c: 0, d: 1, u: "=-g.y"}
  g: {is: TransferFunction, n: ORDER, a: ONES, b: PROPER}
nodes: {u: [c.y, g.u]}
simulate: {until: 1 s}
"""
# an inner loop of velocity at T, an outer loop of position at 3 T; position' = velocity, velocity' = -velocity/T_m + u
CASCADE = """
model: cascade
components:
  outer: {is: SampleHold, T_s: 30 ms, t_0: OFFSET, u: "=-K_OUTER*b.x"}
  inner: {is: SampleHold, T_s: 10 ms, u: "=40 N*s/m*(outer.y - b.v)"}
  m: {is: Mass, m: 2 kg}
  d: {is: Damper, d: 3 N*s/m}
  g: {is: Fixed}
  f: {is: ForceSource}
nodes: {u: [inner.y, f.u], b: [m.a, f.a, d.b], g: [g.a, d.a]}
initial: {b.x: X m, b.v: V m/s, outer.last: OUTER m/s, inner.last: INNER N}
simulate: {until: 1 s, every: 10 ms}
"""


def _file(text: str, tmp_path: Path, **components: str) -> Path:
    folder = tmp_path / "components"
    folder.mkdir(exist_ok=True)
    for name, part in components.items():
        (folder / f"{name}.yaml").write_text(part.strip() + "\n", encoding="utf-8")
    file = tmp_path / "machine.yaml"
    file.write_text(text.strip() + "\n", encoding="utf-8")
    return file


def _command(words: list[str], tmp_path: Path) -> tuple[int, dict]:
    told = tmp_path / "told.json"
    with pytest.raises(SystemExit) as ended:
        main([*words, "--json", str(told)])
    return int(ended.value.code or 0), json.loads(told.read_text(encoding="utf-8"))


def _held(a: np.ndarray, b: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray]:
    """exp(a t) and its integral times b."""
    n, m = b.shape
    whole = expm(np.block([[a, b], [np.zeros((m, n + m))]]) * time)
    return whole[:n, :n], whole[:n, n:]


def _cascade(offset: str, gain: float, state: tuple[float, ...] = (0, 0, 0, 0)) -> str:
    values = dict(zip(("X m", "V m/s", "OUTER m/s", "INNER N"), state, strict=True))
    text = CASCADE.replace("OFFSET", offset).replace("K_OUTER", f"{gain} 1/s")
    for name, value in values.items():
        text = text.replace(f": {name}", f": {value} {name.split()[1]}")
    return text


def _ordered(poles: np.ndarray) -> np.ndarray:
    return np.array(sorted(np.asarray(poles, dtype=complex), key=lambda z: (round(z.real, 6), z.imag)))


def test_the_margins_of_a_loop_with_a_sample_and_hold_are_those_of_its_z_transform(tmp_path: Path):
    """The hold was a constant: "in no loop", and the stability that of the open loop. Gain margin 2.793/2.7 = 1.034."""
    file = _file(SAMPLED_LOOP, tmp_path)
    loop = 2.7 * control.sample_system(control.tf([2], [1, 3, 2, 0]), 0.05)
    for signal in ("y", "e", "u"):  # read by a sample, held by one, and an algebraic multiple of that
        found = hb.loop_margins(hb.load(file), signal)
        with pytest.warns(UserWarning, match="frd"):
            gain, phase, modulus, at_gain, at_phase, _ = control.stability_margins(loop)
        # python-control refines margins from a grid of frequencies here, to some 1e-5
        assert found.gain_up.value == pytest.approx(gain, rel=1e-4) and found.gain_up.value == pytest.approx(1.034, abs=5e-4)
        assert found.least_phase.value == pytest.approx(phase, rel=1e-3)
        assert found.gain_up.frequency == pytest.approx(at_gain / (2 * np.pi), rel=1e-4)
        assert found.least_phase.frequency == pytest.approx(at_phase / (2 * np.pi), rel=1e-4)
        assert found.modulus.value == pytest.approx(modulus, rel=1e-2)
        assert found.verdict == STABLE and not found.held
    code, told = _command(["linear", str(file), "--loop", "y"], tmp_path)
    assert code == 0 and told["stability"] == STABLE and told["T"] == pytest.approx(0.05) and told["held"] == []
    assert told["margins"]["gain_up"]["value"] == pytest.approx(1.0343653, rel=1e-6)


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:stability_margins. Falling back:UserWarning")
def test_fifty_random_loops_have_the_poles_and_margins_of_python_control(tmp_path: Path):
    """Plants of order 1 to 5, controllers of order 1, any period."""
    generator = np.random.default_rng(4)
    verdicts = list[bool]()
    for order in range(1, 6):
        ones = ", ".join("1" for _ in range(order))
        file = _file(LOOP.replace("ORDER", str(order + 1)).replace("ONES", f"[1, {ones}]").replace("PROPER", f"[0, {ones}]"),
                     tmp_path, compensator=COMPENSATOR)
        made = loops(hb.load(file), "c.y")
        for _ in range(10):
            roots = -generator.uniform(0.2, 5, order) + 0j
            for k in range(0, order - 1, 2):
                roots[k:k + 2] = roots[k].real + 1j * generator.uniform(0, 6) * np.array([1, -1])
            a = np.real(np.poly(roots))
            b = np.append(0, generator.uniform(-0.5, 1, order) * a[1:])
            period, p = generator.uniform(0.02, 0.5), generator.uniform(-0.8, 0.95)
            c, d = generator.uniform(-0.5, 0.5), generator.uniform(0.2, 2)
            values = {"c.T_s": period, "c.p": p, "c.c": c, "c.d": d}
            values |= {f"g.{name}[{k + 1}]": v for name, row in (("a", a), ("b", b)) for k, v in enumerate(row.tolist())}
            closed = made.at(values)
            loop = control.ss([[p]], [[1.0]], [[c]], [[d]], period) * control.sample_system(control.ss(control.tf(b, a)),
                                                                                            period)
            expected = control.feedback(loop, 1).poles()
            # the poles of fifth order are known to some 1e-8 where they are close together
            assert _ordered(closed.poles) == pytest.approx(_ordered(expected), abs=1e-6)
            stable = np.abs(expected).max() < 1
            assert closed.stability().verdict == (STABLE if stable else UNSTABLE) and closed.period == pytest.approx(period)
            found = crossings(open_loop(closed), closed.stability())
            gains, _, _, at_gain, at_phase, _ = control.stability_margins(loop, returnall=True)
            for margin in found.gain:  # each is one, by the transfer function of python-control
                value = loop(np.exp(2j * np.pi * margin.frequency * period))
                assert margin.value * value == pytest.approx(-1, abs=1e-6)
            for margin in found.phase:
                value = loop(np.exp(2j * np.pi * margin.frequency * period))
                assert value * np.exp(-1j * np.radians(margin.value)) == pytest.approx(-1, abs=1e-6)
            # and none is left out that python-control finds, and confirms by its transfer function
            for value, at in zip(gains, at_gain, strict=True):
                if np.isfinite(value) and abs(value * loop(np.exp(1j * at * period)) + 1) < 1e-3:
                    assert any(m.value == pytest.approx(value, rel=1e-2) for m in found.gain), (value, at, found.gain)
            for at in at_phase:  # of large gains it finds some where |L| is 4
                if np.isfinite(at) and abs(abs(loop(np.exp(1j * at * period))) - 1) < 1e-3:
                    assert any(2 * np.pi * m.frequency == pytest.approx(at, rel=1e-2) for m in found.phase), at
            verdicts.append(stable)
            omega = np.linspace(1e-4, 1, 1001) * np.pi / period
            assert found.modulus.value <= np.abs(1 + loop(np.exp(1j * omega * period))).min() * (1 + 1e-9)
            at = np.exp(2j * np.pi * found.modulus.frequency * period)
            assert found.modulus.value == pytest.approx(abs(1 + loop(at)), rel=1e-6)
    assert len(verdicts) == 50 and 10 < sum(verdicts) < 45


def _largest_with_delay(delay: float, gain: float) -> float:
    """The largest |z| of the loop of SAMPLED_LOOP with a delay of n periods and a rest in it, by x+ = P x +
    G_1 u(k - n - 1) + G_0 u(k - n)."""
    model = control.ss(control.tf([2 * gain], [1, 3, 2, 0]))
    whole, rest = int(delay // 0.05), delay % 0.05
    a, b, c = model.A, model.B, model.C
    p = expm(a * 0.05)
    later, now = expm(a * (0.05 - rest)) @ _held(a, b, rest)[1], _held(a, b, 0.05 - rest)[1]
    n = whole + 1
    matrix = np.zeros((3 + n, 3 + n))
    matrix[:3, :3] = p
    matrix[:3, 3 + whole:4 + whole] += later
    if whole:
        matrix[:3, 2 + whole:3 + whole] += now
    else:
        matrix[:3, :3] -= now @ c
    matrix[3, :3] = -c
    for k in range(1, n):
        matrix[3 + k, 2 + k] = 1
    return float(np.abs(np.linalg.eigvals(matrix)).max())


@pytest.mark.parametrize("gain", [2.70, 0.9])
def test_the_delay_margin_of_a_sampled_loop_holds_between_whole_periods(gain: float, tmp_path: Path):
    """The phase margin over its frequency is a delay of whole periods only."""
    file = _file(SAMPLED_LOOP, tmp_path)
    loop = loops(hb.load(file), "e").at({"k.k": gain})
    margin = crossings(open_loop(loop), loop.stability()).least_delay.value

    assert _largest_with_delay(margin * (1 - 1e-5), gain) < 1 < _largest_with_delay(margin * (1 + 1e-5), gain)
    # a dead time takes from it
    found = hb.loop_margins(hb.load(file), "e", dead_time=margin / 2) if gain == 2.70 else None
    assert found is None or found.least_delay.value == pytest.approx(margin / 2, rel=1e-3)


def test_the_modes_of_a_sampled_position_loop_are_those_of_its_z_transform(tmp_path: Path,
                                                                           capsys: pytest.CaptureFixture[str]):
    """m x'' = u(t_k) was a free body: z+ = P z - G [20, 9] z has a damping ratio of 0.71."""
    p, g = _held(np.array([[0, 1.0], [0, 0]]), np.array([[0], [0.5]]), 0.04)
    expected = np.linalg.eigvals(p - g @ np.array([[20.0, 9.0]]))
    code, told = _command(["modes", str(_file(POSITION, tmp_path))], tmp_path)
    mode, = told["modes"]
    s = np.log(expected[expected.imag > 0][0]) / 0.04
    assert code == 0 and told["stability"] == STABLE and told["T"] == pytest.approx(0.04)
    assert complex(*mode["z"]) == pytest.approx(expected[expected.imag > 0][0], abs=1e-12)
    assert (mode["damping"], mode["frequency"]) == pytest.approx((-s.real / abs(s), abs(s) / (2 * np.pi)))
    assert "sampled every 40 ms" in capsys.readouterr().out


def _two_rates(k_outer: float, order_new: bool, offset: float) -> np.ndarray:
    """The monodromy matrix of CASCADE over (x, v, outer, inner), from right before its common instant."""
    a, b = np.array([[0, 1.0], [0, -1.5]]), np.array([[0], [0.5]])
    whole = np.eye(4)

    def flow(time: float) -> None:
        nonlocal whole
        step = np.eye(4)
        p, g = _held(a, b, time)
        step[:2, :2], step[:2, 3:] = p, g
        whole = step @ whole

    def sample(outer: bool, inner: bool) -> None:
        nonlocal whole
        step, read = np.eye(4), np.eye(4)
        if outer:
            step[2] = [-k_outer, 0, 0, 0]
        read = step if order_new else np.eye(4)
        if inner:
            step[3] = 40 * (read[2] - np.array([0, 1.0, 0, 0]))
        whole = step @ whole

    times = sorted({0.0, 0.01, 0.02, offset})
    for time, after in zip(times, [*times[1:], 0.03], strict=True):
        sample(time == offset, time in (0.0, 0.01, 0.02))
        flow(after - time)
    return whole


@pytest.mark.parametrize("offset", [0.0, 0.004])
def test_two_rates_have_the_monodromy_matrix_of_their_common_period(offset: float, tmp_path: Path):
    """At a common instant the inner block reads the new set point of the outer one."""
    for gain in (2.0, 12.0, 40.0):
        at_start = ModesAtStart(assemble(hb.load(_file(_cascade(f"{offset} s", gain), tmp_path))))
        linear = at_start.linearisation.at(at_start.point(at_start.start({})))
        assert linear.period == pytest.approx(0.03)
        expected = np.linalg.eigvals(_two_rates(gain, True, offset))
        found = np.linalg.eigvals(linear.a)
        # eigenvalues of zero, of what is set before it is read, are left out
        assert _ordered(found[np.abs(found) > 1e-9]) == pytest.approx(_ordered(expected[np.abs(expected) > 1e-9]), abs=1e-9)
        assert linear.stability().stable == (np.abs(expected).max() < 1)


def test_two_rates_agree_with_runs_from_disturbed_states(tmp_path: Path):
    """The columns of the monodromy matrix are ends of runs over a hyperperiod; no two blocks act at one instant."""
    columns = []
    for k in range(4):
        text = _cascade("4 ms", 12, tuple(float(k == i) for i in range(4)))
        run = hb.simulate(hb.load(_file(text, tmp_path)), until=0.03 - 1e-9, every=0.03 - 1e-9, rtol=1e-10)
        columns.append([run[name][-1] for name in ("b.x", "b.v", "outer.y", "inner.y")])
    expected = np.linalg.eigvals(np.array(columns).T)
    at_start = ModesAtStart(assemble(hb.load(_file(_cascade("4 ms", 12), tmp_path))))
    found = np.linalg.eigvals(at_start.linearisation.at(at_start.point(at_start.start({}))).a)
    # the runs end 1e-9 s before the instant, and keep 1e-10
    assert _ordered(found[np.abs(found) > 1e-6]) == pytest.approx(_ordered(expected[np.abs(expected) > 1e-6]), abs=1e-6)


def test_the_margins_of_two_rates_are_factors_that_bring_the_monodromy_matrix_to_the_unit_circle(tmp_path: Path):
    file = _file(_cascade("0 s", 12), tmp_path)
    slow = hb.loop_margins(hb.load(file), "outer.u")
    factor = slow.gain_up.value
    assert np.abs(np.linalg.eigvals(_two_rates(12 * factor, True, 0.0))).max() == pytest.approx(1, abs=1e-6)
    # the force is set three times in a hyperperiod
    fast = hb.loop_margins(hb.load(file), "u")

    def largest(k: complex) -> float:
        whole = np.eye(4, dtype=complex)
        p, g = _held(np.array([[0, 1.0], [0, -1.5]]), np.array([[0], [0.5]]), 0.01)
        for n in range(3):
            step = np.eye(4, dtype=complex)
            if n == 0:
                step[2] = [-12, 0, 0, 0]
            step[3] = k * 40 * (step[2] - np.array([0, 1.0, 0, 0]))
            flow = np.eye(4)
            flow[:2, :2], flow[:2, 3:] = p, g
            whole = flow @ step @ whole
        return float(np.abs(np.linalg.eigvals(whole)).max())

    assert largest(1) < 1
    assert largest(fast.gain_up.value * (1 - 1e-6)) < 1 < largest(fast.gain_up.value * (1 + 1e-6))
    turn = np.radians(abs(fast.least_phase.value))
    assert largest(np.exp(-1j * turn * (1 - 1e-6))) < 1 < largest(np.exp(-1j * turn * (1 + 1e-6)))
    assert 0 < fast.modulus.value < 1 and fast.least_delay.value > 0
    assert fast.gain_up.frequency == pytest.approx(50)  # Nyquist's of the inner block, not that of the hyperperiod


def test_algebraic_unknowns_belong_to_the_discretised_plant(tmp_path: Path):
    """w + w**3 = u, x' = w - x with u = 2 - 3 x(t_k): at rest w = x, 3 x + ... = 2 - x**3 - x; dw/du = 1/(1 + 3 w**2)."""
    implicit = """
component: Implicit
summary: A law that is solved for by iteration.
source: A test.
ports: {u: {signal: in, unit: 1, doc: input}, y: {signal: out, unit: 1, doc: output}}
variables: {w: {unit: 1, nominal: 1, doc: solution}, x: {unit: 1, start: 0.5, doc: state}}
parameters: {T: {unit: s, default: 1 s, doc: time constant}}
equations: |
  w + w**3 + 0.1*sin(w) = u
  T*der(x) = w - x
  y = x
"""
    file = _file("""
model: implicit
components:
  h: {is: SampleHold, T_s: 0.4 s, u: "=2 - 3*g.y"}
  g: {is: Implicit}
nodes: {u: [h.y, g.u]}
simulate: {until: 4 s, every: 0.4 s}
""", tmp_path, implicit=implicit)
    assembly = assemble(hb.load(file))
    assert assembly.algebraic_names
    at_start = ModesAtStart(assembly)
    point = at_start.point(at_start.start({}))
    linear = at_start.linearisation.at(point)
    w = float(point.z[0])
    slope = 1 / (1 + 3 * w**2 + 0.1 * np.cos(w))
    assert linear.a == pytest.approx(np.array([[np.exp(-0.4) - 3 * slope * (1 - np.exp(-0.4))]]), abs=1e-12)


def test_a_computing_delay_and_a_state_that_samples_set_belong_to_the_loop(tmp_path: Path):
    memory = """
component: Memory
summary: A sampled force law.
source: A test.
ports: {u: {signal: in, unit: N, doc: input}, y: {signal: out, unit: N, doc: output}}
parameters: {T_s: {unit: s, doc: period}}
variables: {q: {unit: N, doc: memory}}
equations: |
  der(q) = 0
  y = q
when: {sample: {every: T_s, then: {q: u}}}
"""
    a, b, k = np.array([[0, 1.0], [0, 0]]), np.array([[0], [0.5]]), np.array([[20.0, 9.0]])
    p, g = _held(a, b, 0.04)
    late, now = expm(a * 0.03) @ _held(a, b, 0.01)[1], _held(a, b, 0.03)[1]
    for text, expected in (
            (POSITION.replace("{is: SampleHold,", "{is: Memory,"), p - g @ k),
            (POSITION.replace("SampleHold, T_s: 40 ms", "DelayedSampleHold, T_s: 40 ms, T_d: 10 ms"),
             np.block([[p - now @ k, late], [-k, np.zeros((1, 1))]]))):
        at_start = ModesAtStart(assemble(hb.load(_file(text, tmp_path, memory=memory))))
        linear = at_start.linearisation.at(at_start.point(at_start.start({})))
        assert _ordered(np.linalg.eigvals(linear.a)) == pytest.approx(_ordered(np.linalg.eigvals(expected)), abs=1e-10)
        assert linear.stability().stable and not linear.held


def test_a_free_body_beside_a_sampled_loop_is_marginal_and_an_integrating_plant_has_infinite_gain(tmp_path: Path):
    text = POSITION.replace("-K*b.x - 9", "-9")
    system = hb.state_space(hb.load(_file(text, tmp_path)), ["b.f"], ["b.x", "b.v"])
    judged = system.stability()
    assert judged.verdict == MARGINAL and [e.states for e in judged.free] == [("b.x",)]
    # a constant force F makes the speed F/9, and the position grow
    assert np.isinf(system.dc_gain()[0, 0]) and system.dc_gain()[1, 0] == pytest.approx(1 / 9)


def test_a_discrete_state_space_states_its_period_wherever_it_goes(tmp_path: Path):
    file, saved = _file(POSITION, tmp_path), tmp_path / "matrices.npz"
    system = hb.state_space(hb.load(file), ["b.f"], ["b.x"])
    assert system.period == pytest.approx(0.04) and system.to_control().dt == system.to_scipy().dt == system.period
    p, g = _held(np.array([[0, 1.0], [0, 0]]), np.array([[0], [0.5]]), 0.04)
    reference = control.ss(p - g @ np.array([[20.0, 9.0]]), g, [[1.0, 0]], 0, 0.04)
    f = np.array([0.1, 1.0, 12.5])
    assert system.response(2j * np.pi * f)[:, 0, 0] == pytest.approx(reference(np.exp(2j * np.pi * f * 0.04)), rel=1e-9)
    assert system.dc_gain()[0, 0] == pytest.approx(1 / 20) and system.frequencies()[-1] == pytest.approx(12.5)
    assert _ordered(system.zeros()) == pytest.approx(_ordered(reference.zeros()), abs=1e-9)
    time = 0.04 * np.arange(50)
    assert system.step(time)[:, 0, 0] == pytest.approx(control.step_response(reference, time).outputs, abs=1e-12)
    code, told = _command(["linear", str(file), "--from", "b.f", "--to", "b.x", "--save", str(saved)], tmp_path)
    assert code == 0 and told["T"] == pytest.approx(0.04) and float(np.load(saved)["T"]) == pytest.approx(0.04)
    passive = hb.state_space(hb.load("passive_rig"), ["vessel.u"], ["crown.x"])
    assert passive.as_dict()["T"] is None and passive.to_control().dt == 0


def test_a_root_locus_finds_the_gain_limit_of_a_sampled_loop(tmp_path: Path):
    found = hb.root_locus(hb.load(_file(SAMPLED_LOOP, tmp_path)), "k.k", "0.5 .. 4", points=15)
    limit, = found.limits
    assert limit == pytest.approx(2.7 * 1.0343652596, rel=1e-6)
    assert found.periods == pytest.approx(0.05) and found.stability[0].verdict == STABLE
    assert found.stability[-1].verdict == UNSTABLE and np.abs(found.z[-1]).max() > 1


def test_tuning_keeps_to_the_stability_limit_of_a_sampled_loop(tmp_path: Path):
    """The loop of POSITION becomes unstable at a longer period, by its z-transform: |z| = 1 there."""
    file = _file(POSITION, tmp_path)
    task = tuning_task({"h.T_s": "30 .. 500 ms"}, "rms(b.x)/1 m", end="1 s", stable=True)
    problem = Objective(assemble(hb.load(file)), task)
    assert problem.limits[-1] == "stable" and not problem.undecided

    def largest(period: float) -> float:
        p, g = _held(np.array([[0, 1.0], [0, 0]]), np.array([[0], [0.5]]), period)
        return float(np.abs(np.linalg.eigvals(p - g @ np.array([[20.0, 9.0]]))).max())

    limits = {period: problem._stable({"h.T_s": period}, ["h.T_s"])[0] for period in (0.05, 0.2, 0.3, 0.4)}
    for period, (value, _) in limits.items():
        assert (value < 0) == (largest(period) < 1), period
    step = 1e-4
    ends = [problem._stable({"h.T_s": 0.2 + sign * step}, ["h.T_s"])[0][0] for sign in (-1, 1)]
    # central differences of two step lengths, of a smooth function; the point is an equilibrium that Newton's method finds
    assert limits[0.2][1][0] == pytest.approx((ends[1] - ends[0]) / (2 * step), rel=1e-3)
    at = problem.at_rest({"h.T_s": 0.05})
    assert at is not None and at[2].worst < 0


@pytest.mark.parametrize("block", [
    "{is: Quantiser, step: 1 N, T_s: 40 ms, u: LAW}",
    "{is: AnalogDigitalConverter, bits: 12, u_min: -100 N, u_max: 100 N, T_s: 40 ms, u: LAW}",
])
def test_a_quantiser_has_a_gain_of_one_and_is_named(block: str, tmp_path: Path):
    """The poles and the verdict are those of a sample and hold."""
    law = '"=-K*b.x - 9 N*s/m*b.v"'
    hold = f"{{is: SampleHold, T_s: 40 ms, u: {law}}}"
    base = POSITION[:POSITION.index("h: {")] + "h: BLOCK" + POSITION[POSITION.index("}", POSITION.index("h: {")) + 1:]
    found = []
    for k, text in enumerate((hold, block.replace("LAW", law))):
        folder = tmp_path / str(k)
        folder.mkdir()
        at_start = ModesAtStart(assemble(hb.load(_file(base.replace("BLOCK", text), folder))))
        found.append(at_start.linearisation.at(at_start.point(at_start.start({}))))
    plain, rounded = found
    assert _ordered(plain.poles()) == pytest.approx(_ordered(rounded.poles()), rel=1e-9, abs=1e-9)
    assert rounded.stability().verdict == plain.stability().verdict and rounded.period == plain.period
    assert [(h.name, h.rounded) for h in rounded.sampled] == [("h.k", True)] and not any(h.rounded for h in plain.sampled)
    told = sampled_lines(rounded.sampled)[1]
    assert told.startswith("rounded to steps: h.k (") and "a gain of 1" in told and "limit cycle" in told


@pytest.mark.filterwarnings("ignore:stability_margins. Falling back:UserWarning")
def test_an_encoder_in_a_loop_gives_a_verdict_and_its_margin(tmp_path: Path):
    """phi'' = T/J, T = -K times the counted angle, with a damper d on the shaft: the gain margin is that of the loop with an
    ideal sampler, and a run on either side of it decays to some counts or grows."""
    text = """
model: turned
parameters: {K: 2 N*m/rad}
components:
  shaft:   {is: Inertia, J: 0.1 kg*m**2}
  air:     {is: RotationalDamper, d: 0.2 N*m*s/rad}
  frame:   {is: FixedShaft}
  drive:   {is: TorqueSource, u: "=-K*encoder.y"}
  encoder: {is: Encoder, N: 65536, T_s: 20 ms}
nodes: {shaft: [shaft.a, air.a, drive.a, encoder.a], frame: [air.b, frame.a]}
initial: {shaft.phi: 0.1 rad, shaft.w: 0 rad/s}
simulate: {until: 20 s, every: 20 ms}
"""
    model = hb.load(_file(text, tmp_path))
    margin = min(m.value for m in hb.loop_margins(model, "encoder.y").gain if m.value > 1)
    loop = control.sample_system(control.tf([2], [0.1, 0.2, 0]), 0.02)
    assert margin == pytest.approx(control.margin(loop)[0], rel=1e-6)
    for factor, stable in ((0.7, True), (1.3, False)):
        changed = model.with_parameters({"K": f"{2 * margin * factor!r} N*m/rad"})
        at_start = ModesAtStart(assemble(changed))
        linear = at_start.linearisation.at(at_start.point(at_start.start({})))
        assert linear.stability().verdict == (STABLE if stable else UNSTABLE)
        run = hb.simulate(changed)["shaft.phi"]
        # a hundred counts are a tenth of the initial angle
        assert (np.abs(run[-100:]).max() < 100 * 2 * np.pi / 65536) == stable


def test_a_random_number_is_no_quantiser(tmp_path: Path):
    """Its generator rounds its own state: a hold that loses samples keeps its place among what is not decided."""
    text = POSITION.replace("SampleHold, T_s", "LossySampleHold, p: 0.3, T_s")
    at_start = ModesAtStart(assemble(hb.load(_file(text, tmp_path))))
    linear = at_start.linearisation.at(at_start.point(at_start.start({})))
    assert linear.stability().verdict == UNDECIDED and not linear.sampled


@pytest.mark.parametrize("law", ["if_else(b.x > 0 m, -5 N, 5 N) - 0*K*1 m", "-K*b.x - 3 N*sign(b.v)"])
def test_a_sampled_relay_takes_the_verdict(law: str, tmp_path: Path):
    """Its derivative is zero, its effect is not: a loop through it is no open one."""
    text = POSITION.replace('u: "=-K*b.x - 9 N*s/m*b.v"', f'u: "={law}"')
    at_start = ModesAtStart(assemble(hb.load(_file(text, tmp_path))))
    linear = at_start.linearisation.at(at_start.point(at_start.start({})))
    assert linear.stability().verdict == UNDECIDED and "h.last" in linear.stability().reasons[0]


def test_periods_without_a_short_common_multiple_are_refused_with_advice(tmp_path: Path):
    for period in ("3.1415926 ms", "10.0001 ms"):
        text = _cascade("0 s", 12).replace("T_s: 30 ms", f"T_s: {period}")
        with pytest.raises(UsageError, match=r"hyperperiod|common multiple|meet") as caught:
            hb.loop_margins(hb.load(_file(text, tmp_path)), "u")
        assert caught.value.problems[0].code == "hyperperiod" and "inner" in str(caught.value)


def test_a_loop_cannot_be_cut_between_the_samples(tmp_path: Path):
    """Behind a lag the signal is neither sampled nor held: L(z) does not exist there."""
    text = SAMPLED_LOOP.replace("u: [k.y, g.u]", "u: [k.y, l.u], w: [l.y, g.u]").replace(
        "  g: {is", "  l: {is: FirstOrderLag, T_1: 20 ms}\n  g: {is")
    file = _file(text, tmp_path)
    with pytest.raises(UsageError, match="neither read by sampled blocks alone") as caught:
        hb.loop_margins(hb.load(file), "w")
    assert caught.value.problems[0].code == "loop-continuous"
    # the lag makes the loop unstable
    held, read = (hb.loop_crossings(hb.load(file), signal) for signal in ("u", "e"))
    assert held.unstable and held.least_gain.value == pytest.approx(read.least_gain.value, rel=1e-9) and read.gain_up is None


def test_holds_in_series_add_no_sample_whatever_their_order(tmp_path: Path):
    """Three holds of one clock are one; a fourth, half a period later, is a delay of half a period."""
    lines = {"h": '{is: SampleHold, T_s: 40 ms, u: "=-K*b.x - 9 N*s/m*b.v"}', "i": "{is: SampleHold, T_s: 40 ms, u: =h.y}",
             "j": "{is: SampleHold, T_s: 40 ms, u: =i.y}"}
    one = hb.state_space(hb.load(_file(POSITION, tmp_path)), ["b.f"], ["b.x"])
    for order in ("hij", "jih", "ihj"):
        parts = "\n".join(f"  {name}: {lines[name]}" for name in order)
        text = POSITION.replace(f"  h: {lines['h']}", parts).replace("y: [h.y, k.u]", "y: [j.y, k.u]")
        system = hb.state_space(hb.load(_file(text, tmp_path)), ["b.f"], ["b.x"])
        assert system.a == pytest.approx(one.a, abs=1e-14) and system.states == one.states


def test_figures_of_sampled_systems_show_the_z_plane_and_the_period(tmp_path: Path):
    from heavebond.pictures.plot_linear import plot_bode, plot_poles

    system = hb.state_space(hb.load(_file(POSITION, tmp_path)), ["b.f"], ["b.x"])
    figure = plot_poles(system.poles, {}, title="poles", period=system.period)
    assert figure.axes[0].get_xlabel() == "real part of z" and "40 ms" in figure.texts[0].get_text()
    assert any("sampled every 40 ms" in text.get_text() for text in plot_bode([system], system.frequencies()).texts)


def test_state_spaces_of_two_rates_give_runs_at_their_common_instants(tmp_path: Path):
    """From an initial state, the states of the discrete system are those of the run at every third sample."""
    model = hb.load(_file(_cascade("4 ms", 12, (0.1, 0, 0, 0)), tmp_path))
    system = StateSpaces(model, ["b.f"], ["b.x"]).at()
    run = hb.simulate(model, until=0.6, every=0.03, rtol=1e-10)
    state = np.zeros(len(system.states))
    state[system.states.index("b.x")] = 0.1
    for expected in run["b.x"][1:]:
        state = system.a @ state
        # the tolerance of the run, grown over 60 samples
        assert state[system.states.index("b.x")] == pytest.approx(expected, abs=1e-7)


def test_a_steady_state_of_a_sampled_loop_is_one_of_its_samples_too(tmp_path: Path):
    """The law 3*(2 - x) + 0.1*x**3 of the samples at rest is x: x = 1.5 + 0.025 x**3. Repeated samples lead away from it."""
    file = _file("""
model: steady
components:
  h: {is: SampleHold, T_s: 0.4 s, u: "=3*(2 - g.y) + 0.1*g.y**3"}
  g: {is: FirstOrderLag, T_1: 1 s}
nodes: {u: [h.y, g.u]}
initial: {g.y: 0.5}
simulate: {until: 4 s}
""", tmp_path)
    system = hb.state_space(hb.load(file), ["h.u"], ["g.y"], at="steady")
    x = system.point.x[0]
    assert x == pytest.approx(1.5 + 0.025 * x**3, rel=1e-9) and x < 2
    # x+ = exp(-0.4) x + (1 - exp(-0.4)) law'(x) x
    assert system.a[0, 0] == pytest.approx(np.exp(-0.4) + (1 - np.exp(-0.4)) * (0.3 * x**2 - 3), rel=1e-9)
