"""A valve that opens in one direction and is connected in reverse is named by the verdict."""

from __future__ import annotations

import re
import warnings

from collected import for_each

import heavebond as hb
from heavebond.language.library import library
from heavebond.numerics.run_verdict import Verdict

SUPPLY = """
model: supply
components:
  pump: {is: FlowSource, u: 10 L/min}
  line: {is: Volume, V: 1 L, beta: 1 GPa}
  valve: {is: VALVE}
  tank: {is: Tank}
nodes: {supply: [pump.a, line.a, valve.IN], tank: [valve.OUT, tank.a]}
simulate: {until: 0.5 s, every: 10 ms}
"""
VALVES = {
    "ReliefValve": ("C: 1 L/(min*bar), dp_0: 200 bar", "ab"),
    "RatedReliefValve": ("p_0: 200 bar, q_r: 20 L/min", "ab"),
    "PilotReliefValve": ("p_0: 200 bar, q_r: 20 L/min, dp_r: 10 bar", "PT"),
    "ProportionalReliefValve": ("p_n: 200 bar, q_r: 20 L/min, u: 1", "ab")}


def verdict(text: str) -> Verdict:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return hb.simulate(hb.loads(text)).verdict


def reversed_valves(text: str) -> list[str]:
    return [f.part for f in verdict(text).findings if f.kind == "reversed"]


def supply(kind: str, turned: bool) -> str:
    settings, ports = VALVES[kind]
    first, last = reversed(ports) if turned else ports
    text = SUPPLY.replace("VALVE", f"{kind}, {settings}").replace("IN", first).replace("OUT", last)
    return text.replace("tank: {is", "cap: {is: Cap}\n  tank: {is").replace("nodes: {", "nodes: {x: [valve.X, cap.a], ") \
        if kind == "PilotReliefValve" else text


@for_each("kind", VALVES)
def test_a_relief_valve_in_reverse_is_named_and_one_that_opens_is_not(kind: str) -> None:
    found = verdict(supply(kind, True))
    assert [f.part for f in found.findings if f.kind == "reversed"] == ["valve"]
    first, last = VALVES[kind][1]
    assert f"limit supply.p, exchange its ports {first} and {last}" in found.text
    assert not reversed_valves(supply(kind, False))


def test_a_relief_valve_that_stays_shut_is_not_in_reverse() -> None:
    assert not reversed_valves(supply("ReliefValve", False).replace("10 L/min", "1 mL/min"))
    # 100 bar, in whatever direction, do not open it
    assert not reversed_valves(supply("ReliefValve", True).replace("0.5 s", "0.05 s"))


def test_a_spring_loaded_check_valve_that_holds_a_pressure_is_not_in_reverse() -> None:
    """It opens from the tank at 0.5 bar below it, as for suction."""
    assert not reversed_valves(supply("ReliefValve", True).replace("200 bar", "0.5 bar"))


def test_cross_over_relief_valves_are_not_in_reverse() -> None:
    text = supply("ReliefValve", False).replace("  tank: {is", "  other: {is: ReliefValve, C: 1 L/(min*bar), dp_0: 200 bar}"
                                                "\n  tank: {is", 1)
    text = text.replace("valve.a]", "valve.a, other.b]").replace("valve.b, tank.a]", "valve.b, other.a, tank.a]")
    assert not reversed_valves(text)


def test_a_relief_valve_of_several_parts_in_reverse_is_named() -> None:
    text = """
model: air
components:
  compressor: {is: PneumaticFlowSource, u: 10 g/s}
  vessel: {is: Receiver, V: 10 L}
  valve: {is: PneumaticReliefValve, C: 5e-9 m**3/(s*Pa), p_set: 6 bar}
  air: {is: Atmosphere}
nodes: {vessel: [compressor.a, vessel.a, valve.a], air: [valve.b, air.a]}
simulate: {until: 20 s, every: 0.1 s}
"""
    assert not reversed_valves(text)
    assert reversed_valves(text.replace("valve.a]", "valve.b]").replace("[valve.b, air", "[valve.a, air")) == ["valve"]


def test_each_valve_that_opens_in_one_direction_names_its_inlet_and_outlet() -> None:
    known = library()
    found = [name for name in known.names() if (opens := known.component(name).opens) is not None
             and re.match(r"(\w+)\.p - (\w+)\.p - ", opens.text)]
    assert set(VALVES) | {"OilReliefValve", "PneumaticReliefValve"} == set(found)
