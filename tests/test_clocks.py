"""Sampled blocks with common instants: updates follow the data flow, whatever the order of the components."""

from __future__ import annotations

from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
from collected import partly
from test_c_events import agree
from test_export import compiled

import heavebond as hb

HOLDS = """
model: two_holds
components:
  h1: {is: SampleHold, T_s: 0.1 s, u: "=10 V/s*time"}
  h2: {is: SampleHold, T_s: 0.1 s, u: =h1.y}
simulate: {until: 1 s, every: 25 ms}
"""

CHAIN = {
    "a": "{is: SampleHold, T_s: 0.1 s, u: =sin(3 rad/s*time)}",
    "g": "{is: Gain, k: 2, u: =a.y}",
    "s": "{is: SampleHold, T_s: 0.1 s, u: =g.y + r.y}",
    "r": "{is: SampleHold, T_s: 0.3 s, u: =a.y}",
    "f": "{is: TransferFunction, n: 2, a: [1, 1], b: [1, 0], u: =s.y}",
    "e": "{is: SampleHold, T_s: 0.2 s, u: =f.y}",
}


def diagram(parts: dict[str, str], order: tuple[str, ...] | None = None, rest: str = "") -> str:
    lines = "\n".join(f"  {name}: {parts[name]}" for name in order or parts)
    return f"model: sampled\ncomponents:\n{lines}\n{rest}\nsimulate: {{until: 1.2 s, every: 50 ms}}\n"


def test_two_holds_in_series_pass_a_value_at_the_same_instant() -> None:
    run = hb.simulate(hb.loads(HOLDS))
    # the sample at t of 10 V/s t, held: 10 V/s times the last multiple of 0.1 s
    held = np.floor(run.time / 0.1 + 1e-9)
    assert run["h1.y"] == pytest.approx(held, abs=1e-12)
    assert np.array_equal(run["h1.y"], run["h2.y"])


def test_the_order_of_components_does_not_change_sampled_values() -> None:
    names = tuple(CHAIN)
    orders = [names, names[::-1], *list(permutations(names))[100::233]]
    first, *others = (hb.simulate(hb.loads(diagram(CHAIN, order)), rtol=1e-8) for order in orders)
    for run in others:
        for name in ("a.y", "s.y", "r.y", "e.y"):
            # the same operations; only the integrator may order its sums in another way
            assert run[name] == pytest.approx(first[name], rel=1e-9, abs=1e-12), name
    t = first.time
    a = np.sin(3 * 0.1 * np.floor(t / 0.1 + 1e-9))
    r = np.sin(3 * 0.3 * np.floor(t / 0.3 + 1e-9))
    assert first["s.y"] == pytest.approx(2 * a + r, abs=1e-12)


def test_blocks_of_commensurate_periods_share_instants_without_drift() -> None:
    """3 x 0.1 is not 0.3 in floating point, nor 7 x (1/7) always 1."""
    parts = {"fast": "{is: SampleHold, T_s: =0.1 s/7, u: =1 1/s*time}", "slow": "{is: SampleHold, T_s: 0.3 s, u: =fast.y}"}
    run = hb.simulate(hb.loads(diagram(parts)), until=30.0, every=0.3)
    assert run["slow.y"] == pytest.approx(run.time, rel=1e-12)
    # an instant for each multiple of the short period, none twice
    times = np.array(sorted({time for time, _ in run.events}))
    assert np.diff(times).min() > 0.9 * 0.1 / 7


def test_a_loop_of_sampled_blocks_is_refused_by_name() -> None:
    parts = {"one": "{is: SampleHold, T_s: 0.1 s, u: =two.y + 1}", "two": "{is: SampleHold, T_s: 0.2 s, u: =g.y}",
             "g": "{is: Gain, k: 0.5, u: =one.y}"}
    with pytest.raises(hb.ModelError) as caught:
        hb.simulate(hb.loads(diagram(parts)))
    problem = caught.value.problems[0]
    assert problem.code == "sampled-loop"
    assert "one" in problem.message and "two" in problem.message and "UnitDelay" in problem.hint


def test_blocks_that_never_act_at_the_same_instant_may_read_each_other() -> None:
    parts = {"one": "{is: SampleHold, T_s: 0.1 s, u: =two.y + 1}",
             "two": "{is: SampleHold, T_s: 0.1 s, t_0: 0.05 s, u: =one.y}"}
    run = hb.simulate(hb.loads(diagram(parts)))
    assert run["one.y"] == pytest.approx(1 + np.floor(run.time / 0.1 + 1e-9))


def test_a_hold_counts_by_a_unit_delay() -> None:
    with pytest.raises(hb.ModelError, match="'n' forms an algebraic loop with itself"):
        hb.simulate(hb.loads(diagram({"n": "{is: SampleHold, T_s: 0.1 s, u: =n.y + 1}"})))
    run = hb.simulate(hb.loads(diagram({"n": "{is: SampleHold, T_s: 0.1 s, u: =d.y + 1}",
                                        "d": "{is: UnitDelay, T_s: 0.1 s, u: =n.y}"})))
    assert run["n.y"] == pytest.approx(1 + np.floor(run.time / 0.1 + 1e-9))


def test_the_computing_time_of_a_whole_period_is_a_delay_of_one_sample() -> None:
    parts = {"d": "{is: DelayedSampleHold, T_s: 0.1 s, T_d: 0.1 s, u: =1 1/s*time}",
             "h": "{is: SampleHold, T_s: 0.1 s, u: =d.y}"}
    run = hb.simulate(hb.loads(diagram(parts)))
    assert run["h.y"] == pytest.approx(np.maximum(np.floor(run.time / 0.1 + 1e-9) - 1, 0) * 0.1, abs=1e-12)


def test_a_sampled_physical_quantity_is_that_before_the_instant() -> None:
    """A converter samples the acceleration before the force of the same instant acts: no loop."""
    text = """
    model: force
    components:
      cart: {is: Mass, m: 2 kg}
      pull: {is: ForceSource, u: =command.y}
      taken: {is: SampleHold, T_s: 0.1 s, u: =der(cart.a.v)}
      command: {is: SampleHold, T_s: 0.1 s, u: =2 kg*taken.y + 1 N}
    nodes: {load: [cart.a, pull.a]}
    initial: {load.x: 0 m, load.v: 0 m/s}
    simulate: {until: 1 s, every: 50 ms}
    """
    run = hb.simulate(hb.loads(text))
    # force k is 1 N more than force k - 1
    assert run["command.y"] == pytest.approx(1 + np.floor(run.time / 0.1 + 1e-9), abs=1e-9)


def test_a_chain_of_converter_and_controller_follows_the_z_transform() -> None:
    parts = {"plant": "{is: Integrator, k: 1 1/s, u: =control.y}", "adc": "{is: SampleHold, T_s: 0.1 s, u: =plant.y}",
             "control": "{is: SampleHold, T_s: 0.1 s, u: =15*(1 - adc.y)}"}
    run = hb.simulate(hb.loads(diagram(parts, rest="initial: {plant.y: 0}")))
    k = np.flatnonzero(np.abs(run.time / 0.1 - np.round(run.time / 0.1)) < 1e-9)
    # x[k+1] = x[k] + K T (1 - x[k]) with K T = 1.5; a further delay of one sample would make it unstable
    assert run["plant.y"][k] == pytest.approx(1 - (1 - 1.5) ** np.round(run.time[k] / 0.1), abs=1e-7)


def test_sensitivities_pass_along_a_chain_of_sampled_blocks() -> None:
    text = diagram({"a": "{is: SampleHold, T_s: =T, u: =1 1/s**2*time**2}", "b": "{is: SampleHold, T_s: =T, u: =K*a.y}",
                    "c": "{is: Integrator, k: 1 1/s, u: =b.y}"}, ("c", "b", "a"),
                   "parameters: {T: 0.1 s, K: 3}\ninitial: {c.y: 0}")
    run = hb.simulate(hb.loads(text), until=1.03, sensitivities=["T", "K"])
    k = np.floor(run.time / 0.1 + 1e-9)
    assert run.sensitivity("b.y", "K") == pytest.approx((0.1 * k) ** 2, abs=1e-9)
    assert run.sensitivity("b.y", "T") == pytest.approx(2 * 3 * 0.1 * k**2, abs=1e-7)
    steps = np.arange(10)
    # y = sum over k < 10 of 3 T (k T)^2 + 3 (10 T)^2 (t - 10 T)
    by_period = 9 * 0.1**2 * (steps**2).sum() + 3 * 100 * (2 * 0.1 * 1.03 - 30 * 0.1**2)
    assert run.sensitivity("c.y", "T")[-1] == pytest.approx(by_period, rel=1e-6)


def test_periods_that_move_apart_leave_a_value_of_the_other_period() -> None:
    """b reads at its own instants what a held: the derivative of b by the period of a is that of the sample of a."""
    text = diagram({"b": "{is: SampleHold, T_s: =T_b, u: =a.y}", "a": "{is: SampleHold, T_s: =T_a, u: =1 1/s*time}"}, None,
                   "parameters: {T_a: 0.1 s, T_b: 0.1 s}")
    run = hb.simulate(hb.loads(text), sensitivities=["T_a", "T_b"])
    assert run.sensitivity("b.y", "T_a") == pytest.approx(np.floor(run.time / 0.1 + 1e-9), abs=1e-9)
    assert run.sensitivity("b.y", "T_b") == pytest.approx(0 * run.time, abs=1e-9)


def test_a_step_at_a_sampling_instant_is_sampled() -> None:
    """A Step has its value after the step at its own instant, also for a block that samples there."""
    run = hb.simulate(hb.loads(diagram({"h": "{is: SampleHold, T_s: 0.1 s, u: =s.y}",
                                        "s": "{is: Step, t_s: 0.5 s, after: 1}"})))
    assert run["h.y"] == pytest.approx(np.where(run.time > 0.5 - 1e-9, 1.0, 0.0))


def test_a_formula_of_the_time_at_an_input_switches_before_the_sample_of_its_instant() -> None:
    run = hb.simulate(hb.loads(diagram({"h": "{is: SampleHold, T_s: 0.1 s, u: '=if_else(time < 0.5 s, 0, 1)'}"})))
    assert run["h.y"] == pytest.approx(np.where(run.time > 0.5 - 1e-9, 1.0, 0.0))


@pytest.mark.parametrize("version", partly([2, 3], 2))
def test_an_fmu_updates_sampled_blocks_in_the_order_of_the_run(version: int, tmp_path: Path) -> None:
    fmpy = pytest.importorskip("fmpy")
    from heavebond.exchange.fmu_export import export_fmu

    show = "show: {s: {is: s.y, unit: 1}, e: {is: e.y, unit: 1}}"
    model = hb.loads(diagram(CHAIN, ("e", "s", "f", "r", "g", "a"), show))
    run = hb.simulate(model)
    export_fmu(model, tmp_path / "m.fmu", version=version)
    found = fmpy.simulate_fmu(str(tmp_path / "m.fmu"), stop_time=1.2, output_interval=0.05)
    last = np.searchsorted(found["time"], run.time + 1e-9, side="right") - 1
    for name in ("s", "e"):
        # two integrators, and held values that carry their errors of some 1e-9
        assert found[name][last] == pytest.approx(run.display[name], abs=1e-6), name


@compiled
def test_a_c_program_updates_sampled_blocks_in_the_order_of_the_run(tmp_path: Path) -> None:
    show = "show: {s: {is: s.y, unit: 1}, e: {is: e.y, unit: 1}}"
    agree(hb.loads(diagram(CHAIN, ("e", "s", "f", "r", "g", "a"), show)), tmp_path)


def test_transitions_between_rates_are_listed_with_the_block_to_add() -> None:
    """A formula that reads another rate; a hold and a unit delay state the transition."""
    parts = {"fast": "{is: SampleHold, T_s: 0.1 s, u: =sin(time/(1 s))}",
             "slow": "{is: SampleHold, T_s: 0.3 s, u: =2 - fast.y}", "back": "{is: SampleHold, T_s: 0.1 s, u: =1 + slow.y}",
             "odd": "{is: SampleHold, T_s: 0.25 s, u: =1 + fast.y}",
             "late": "{is: SampleHold, T_s: 0.1 s, t_0: 0.04 s, u: =1 + fast.y}"}

    def found(**changed: str) -> dict[tuple[str, str], str]:
        assembly = hb.assemble(hb.loads(diagram({**parts, **changed})))
        return {(t.reader, t.source): t.text for t in assembly.update_order.transitions(assembly.p)}

    texts = found()
    assert set(texts) == {("slow", "fast"), ("back", "slow"), ("odd", "fast"), ("late", "fast")}
    assert "one value of 3" in texts["slow", "fast"] and "SampleHold with T_s: 0.3 s" in texts["slow", "fast"]
    assert "above 1.6667 Hz alias" in texts["slow", "fast"]  # 1/(2 * 0.3 s)
    assert "UnitDelay with T_s: 0.3 s behind slow" in texts["back", "slow"]
    assert "neither period is a multiple" in texts["odd", "fast"]
    assert "its instants are others" in texts["late", "fast"]
    explicit = found(slow="{is: SampleHold, T_s: 0.3 s, u: =taken.y - 2}",
                     taken="{is: SampleHold, T_s: 0.3 s, u: =3*fast.y}",
                     back="{is: SampleHold, T_s: 0.1 s, u: =1 + passed.y}",
                     passed="{is: UnitDelay, T_s: 0.3 s, u: =slow.y}")
    assert set(explicit) == {("odd", "fast"), ("late", "fast")}


def test_a_run_names_the_transitions_between_rates_of_which_none_is_a_multiple() -> None:
    fast = "{is: SampleHold, T_s: 0.1 s, u: =sin(time/(1 s))}"
    for slow, named in (("T_s: 0.25 s", True), ("T_s: 0.1 s, t_0: 0.04 s", True), ("T_s: 0.3 s, t_0: 0.05 s", True),
                        ("T_s: 0.3 s", False), ("T_s: 0.3 s, t_0: 0.2 s", False)):
        run = hb.simulate(hb.loads(diagram({"fast": fast, "slow": f"{{is: SampleHold, {slow}, u: =2 - fast.y}}"})))
        findings = [(f.kind, f.name, f.part, f.failed) for f in run.verdict.findings]
        assert findings == ([("rates", "slow", "fast", False)] if named else [])
    parts = {"fast": fast, "slow": "{is: SampleHold, T_s: 0.25 s, u: =2 - taken.y}",
             "taken": "{is: SampleHold, T_s: 0.25 s, u: =fast.y}"}
    assert hb.simulate(hb.loads(diagram(parts))).verdict.status == "clean"  # the hold is stated
