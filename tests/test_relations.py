"""Some 330 relations between runs of bundled machines, and between two descriptions of one law.

`python -m benchmarks.fuzz.relations` tries all bundled machines and random circuits. What fails today is marked.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import heavebond as hb
from benchmarks.fuzz.laws import compared, laws
from benchmarks.fuzz.metamorphic import DIFFERENCES
from benchmarks.fuzz.run_relations import Check, checks_of, placed, tried
from heavebond.language.model import loads
from heavebond.linear.linear_system import state_space

MECHANICAL = ("spring", "damper", "coulomb_friction", "end_stop", "torsion_spring", "lever", "weight", "gas_spring",
              "backlash", "cubic_spring", "clutch")
ELECTRICAL = ("conductance", "dc_motor", "resistor", "capacitor", "inductor", "transformer")
OTHERS = ("receiver", "convection", "orifice", "pid", "first_order_lag", "ramp", "step", "sample_hold")
SCALE = "a PID whose constants are set to other units of time starts and integrates with another error"
FAILING = {
    ("pid", "time scale", "1000000000.0"): SCALE, ("pid", "time scale", "1e-09"): SCALE,
}
PAIRS = {law.name: law for law in laws() if "contacts" not in law.name or law.name.endswith(("021", "201"))}
@cache
def checks(machine: str) -> dict[tuple[str, str, str], Check]:
    return {(machine, c.relation, c.variant): c for c in tried(f"examples/{machine}.yaml")}


def agree(*machines: str) -> int:
    """The number of relations that hold; those in FAILING are tried elsewhere."""
    all_checks = {key: check for machine in machines for key, check in checks(machine).items()}
    assert not {key: (c.outcome, c.what) for key, c in all_checks.items() if c.outcome in DIFFERENCES and key not in FAILING}
    assert {key for key in FAILING if key[0] in machines} <= {*all_checks}
    return sum(c.outcome == "same" for c in all_checks.values())


@pytest.mark.long
def test_relations_of_mechanical_machines() -> None:
    assert agree(*MECHANICAL) >= 160


@pytest.mark.long
def test_relations_of_electrical_machines() -> None:
    assert agree(*ELECTRICAL) >= 80


@pytest.mark.long
def test_relations_of_hydraulic_thermal_and_signal_machines() -> None:
    assert agree(*OTHERS) >= 95


@pytest.mark.parametrize("key", [pytest.param(key, marks=pytest.mark.xfail(strict=True, reason=why), id=" ".join(key))
                                 for key, why in FAILING.items()])
def test_relation_of_a_machine_that_fails(key: tuple[str, str, str]) -> None:
    check = checks(key[0])[key]
    assert check.outcome not in DIFFERENCES, check.what


@pytest.mark.long
def test_one_law_in_two_descriptions_gives_the_same_run() -> None:
    found = [compared(law) for law in PAIRS.values()]
    assert not [(c.relation, c.outcome, c.what) for c in found if c.outcome != "same"]
    assert len(found) >= 40


LOOP = """
model: loop
components:
  gain: {is: Gain, k: K, u: "=0.1*if_else(time < 0.1 s, 0, 1) - third.y"}
  first: {is: FirstOrderLag, T_1: 0.1 s}
  second: {is: FirstOrderLag, T_1: 0.1 s}
  third: {is: FirstOrderLag, T_1: 0.1 s}
nodes: {a: [gain.y, first.u], b: [first.y, second.u], c: [second.y, third.u]}
simulate: {until: 20 s, every: 5 ms}
"""


def test_a_run_beyond_the_gain_margin_grows_and_one_within_it_decays_with_the_mode() -> None:
    """Three lags T = 0.1 s: the critical gain is 8 at sqrt(3)/T; the decay between two extremes is that of the mode."""
    margin = hb.loop_margins(loads(LOOP.replace("K", "4")), "third.y").least_gain
    assert margin is not None and margin.value == pytest.approx(2, rel=1e-9)
    assert 2 * np.pi * margin.frequency == pytest.approx(np.sqrt(3) / 0.1, rel=1e-9)
    for factor in (0.97, 1.03):
        text = LOOP.replace("K", repr(4 * margin.value * factor))
        run, mode = hb.simulate(loads(text)), state_space(loads(text), ["gain.u"], ["third.y"]).poles
        swing = max(mode, key=lambda s: s.real)
        y = run["third.y"][run.time > 5] - 0.1 * 4 * 2 * factor / (1 + 4 * 2 * factor)  # less the final value K/(1 + K)
        halves = [np.abs(part).max() for part in np.split(y[: len(y) // 2 * 2], 2)]
        assert (halves[1] < halves[0]) == (factor < 1)
        # between the maxima of both halves, 7.5 s apart but for a part of a swing of 0.36 s
        assert np.log(halves[1] / halves[0]) / 7.5 == pytest.approx(swing.real, rel=0.06)


def test_a_run_that_breaks_a_relation_is_seen() -> None:
    """The comparison itself: a friction of 12 N differs from two of 6.01 N, and a machine at rest shows nothing."""
    from dataclasses import replace

    law = PAIRS["two halves of CoulombFriction"]
    assert compared(replace(law, second=law.second.replace("6.0 N", "6.01 N"))).outcome == "different"
    still = PAIRS["step and condition"]
    still = replace(still, first=still.first.replace("after: 2", "after: 0"), second=still.second.replace("0, 2)", "0, 0)"))
    assert compared(still).outcome == "different"
    with placed("seed 2") as path:
        assert len(checks_of(path, "seed 2", {"output grid": (7,), "renamed": ()})) in (1, 2)
