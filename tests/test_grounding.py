"""What ties each circuit of a diagram to a reference."""

from __future__ import annotations

from pathlib import Path

import pytest

import heavebond as hb
from heavebond.equations.flatten import flatten
from heavebond.equations.grounding import Circuit, circuits

HARD = Path(__file__).parent / "hard"


def found(name: str | Path) -> tuple[Circuit, ...]:
    return circuits(flatten(hb.load(name)))


def test_the_circuits_of_the_compensator() -> None:
    mechanics, gas, oil = found("cmc_ahc")
    assert mechanics.domain == "translational"
    assert mechanics.held == ("vessel", "drilling.seabed")
    assert mechanics.carried == ("crown", "drilling.hook", "drilling.bit")
    # the pressure behind the seals of a friction presses on it, and is not held by it
    assert gas == Circuit("hydraulic", ("cmc.main_cylinder",), ("cmc.gas", "cmc.equaliser"), ())
    assert oil.nodes == ("ahc.supply", "ahc.return", "ahc.chamber_a", "ahc.chamber_b")
    assert (oil.held, oil.carried) == (("ahc.pump", "ahc.tank"), ("ahc.cylinder",))


@pytest.mark.parametrize(("name", "held", "carried"), [
    ("circuit_without_reference", (), ()),              # orifices feel differences alone
    ("volume_of_zero", ("tank",), ("oil",)),  # a volume carries its pressure
    ("bridge_of_sharp_orifices", ("pump", "tank"), ()),
    ("joined_volumes_at_other_pressures", (), ("left", "right")),  # a sensor in line holds nothing
])
def test_who_holds_and_who_carries_oil(name: str, held: tuple[str, ...], carried: tuple[str, ...]) -> None:
    last = found(HARD / f"{name}.yaml")[-1]
    assert (last.domain, last.held, last.carried) == ("hydraulic", held, carried)


def test_gas_is_told_from_oil_and_a_velocity_source_holds(tmp_path: Path) -> None:
    gas, = found(HARD / "gas_line_to_nowhere.yaml")
    assert gas.domain == "pneumatic"
    path = tmp_path / "driven.yaml"
    path.write_text("""model: driven
components:
  drive:  {is: VelocitySource, u: 1 m/s}
  damper: {is: Damper, d: 1 N*s/m}
  cart:   {is: Mass, m: 1 kg}
  free:   {is: Mass, m: 1 kg}
nodes: {a: [drive.a, damper.a], b: [damper.b, cart.a], c: [free.a]}
""")
    driven, floating = found(path)
    assert (driven.nodes, driven.held, driven.carried) == (("a", "b"), ("drive",), ("cart",))
    assert (floating.nodes, floating.held, floating.carried) == (("c",), (), ("free",))
