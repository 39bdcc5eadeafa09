"""Parts of one circuit that would take the defaults of different media are refused."""

from __future__ import annotations

from pathlib import Path

import pytest

import heavebond as hb

TANK = """model: tank
components:
  t: {is: OpenTank, A: 0.1 m**2}
  c: {is: Cap}
  o: {is: SharpEdgedOrifice, d: 20 mm}
  r: {is: Tank}
nodes: {i: [c.a, t.a], b: [t.b, o.a], r: [o.b, r.a]}
initial: {t.h: 1 m}
simulate: {until: 200 s, every: 1 s}
"""
BLOCK = """component: Outlet
summary: An orifice.
ports: {a: hydraulic, b: hydraulic}
components: {o: {is: SharpEdgedOrifice, d: 20 mm}}
nodes: {a: [a, o.a], b: [o.b, b]}
"""


def refused(text: str, folder: Path = Path()) -> str:
    with pytest.raises(hb.ModelError) as error:
        hb.assemble(hb.loads(text, folder))
    problem = error.value.problems[0]
    assert problem.code == "media-defaults"
    return str(error.value)


def test_a_tank_of_water_with_an_orifice_of_oil_is_refused_with_the_list() -> None:
    text = refused(TANK)
    assert "t.rho" in text and "1000 kg/m**3" in text
    assert "o.rho" in text and "870 kg/m**3" in text
    assert "{is: Water}" in text  # what to type


def test_a_circuit_that_continues_in_a_block_is_refused(tmp_path: Path) -> None:
    (tmp_path / "components").mkdir()
    (tmp_path / "components" / "outlet.yaml").write_text(BLOCK)
    assert "o.o.rho" in refused(TANK.replace("is: SharpEdgedOrifice, d: 20 mm", "is: Outlet"), tmp_path)


def test_water_beside_the_compressibility_of_oil_is_refused() -> None:
    """No property is taken twice: the tank has the density of water, the volume the bulk modulus of mineral oil."""
    text = TANK.replace("o: {is: SharpEdgedOrifice, d: 20 mm}", "o: {is: Volume, V: 1 L}").replace(
        "b: [t.b, o.a], r: [o.b, r.a]", "b: [t.b, k.a], k: [k.b, o.a], r: [r.a]").replace(
        "  r: {is: Tank}", "  r: {is: Tank}\n  k: {is: LineResistance, R: 1e9 Pa*s/m**3}")
    assert "o.beta" in refused(text)


def test_parts_of_another_gas_by_default_are_refused(tmp_path: Path) -> None:
    (tmp_path / "components").mkdir()
    source = next(Path(hb.__file__).parent.parent.glob("components/pneumatic/receiver_with_heat.yaml")).read_text()
    helium = source.replace("component: ReceiverWithHeat", "component: HeliumVessel").replace(
        "default: 287.05 J/(kg*K)", "default: 2077.1 J/(kg*K)")
    assert helium.count("2077.1") == 1
    (tmp_path / "components" / "helium_vessel.yaml").write_text(helium)
    text = """model: two gases
components:
  he:  {is: HeliumVessel, V: 1 L, G: 0.1 W/K}
  air: {is: ReceiverWithHeat, V: 1 L, G: 0.1 W/K}
  line: {is: PneumaticLine, R: 1e8 Pa*s/kg}
nodes: {he: [he.a, line.a], air: [line.b, air.a]}
simulate: {until: 1 s}
"""
    found = refused(text, tmp_path)
    assert "he.R" in found and "air.R" in found


def test_one_medium_for_the_whole_circuit_empties_the_tank_as_torricelli() -> None:
    """sqrt(h) falls by c_d A_o/A sqrt(g/2) a second, whatever the density."""
    import numpy as np

    for fluid in ("{is: Water}", "{is: Fluid, rho: 1000 kg/m**3}"):
        text = TANK.replace("r: {is: Tank}", "r: {is: Tank}\n  f: " + fluid).replace("t.b, o.a]", "t.b, o.a, f.a]")
        run = hb.simulate(hb.loads(text))
        fall = 0.61 * np.pi / 4 * 0.02**2 / 0.1 * np.sqrt(9.81 / 2)
        # the transition of the orifice to laminar flow is neglected: 1e-4 of the level
        assert run["t.h"][100] == pytest.approx((1 - 100 * fall)**2, abs=2e-4)


def test_values_of_their_own_or_parts_that_take_nothing_else_stay() -> None:
    own = TANK.replace("d: 20 mm", "d: 20 mm, rho: 1000 kg/m**3, nu: 1 mm**2/s")
    alone = TANK.replace("is: SharpEdgedOrifice, d: 20 mm", "is: LineResistance, R: 1e9 Pa*s/m**3")
    apart = TANK.replace("b: [t.b, o.a]", "b: [t.b, k.a], oil: [p.a, o.a]").replace(
        "  r: {is: Tank}", "  r: {is: Tank}\n  k: {is: Cap}\n  p: {is: PressureSource, p_0: 1 bar}")
    for text in (own, alone, apart):
        assert hb.assemble(hb.loads(text)).model.name == "tank"


def test_a_part_that_takes_only_a_density_takes_that_of_the_tank() -> None:
    model = hb.loads(TANK.replace("is: SharpEdgedOrifice, d: 20 mm", "is: TurbulentLeakage, A: 1 cm**2"))
    assert hb.assemble(model).parameter_values["o.rho"] == 1000.0


@pytest.mark.parametrize("parts", [
    """  t: {is: OpenTank, A: 1 m**2}
  l: {is: Line, n: 2, length: 5 m, d: 20 mm}
  s: {is: Tank}
  c: {is: Cap}
nodes: {x: [t.b, l.a], y: [l.b, s.a], z: [t.a, c.a]}""",
    """  p: {is: FlowSource, u: 10 L/min}
  o: {is: SharpEdgedOrifice, d: 3 mm}
  t: {is: OpenTank, A: 0.1 m**2}
  c: {is: Cap}
nodes: {x: [p.a, o.a], y: [o.b, t.b], z: [t.a, c.a]}""",
    """  w: {is: Fluid, rho: 1000 kg/m**3, nu: 1e-6 m**2/s, beta: 2.1 GPa}
  f: {is: Fluid, rho: 870 kg/m**3, nu: 46e-6 m**2/s, beta: 1.4 GPa}
  v: {is: Volume, V: 1 L}
  o: {is: SharpEdgedOrifice, d: 1 mm}
  t: {is: Tank}
nodes: {x: [v.a, o.a, w.a], y: [o.b, t.a, f.a]}""",
], ids=["tank and line", "pump and tank", "two fluids"])
def test_further_circuits_of_two_media_are_refused(parts: str) -> None:
    with pytest.raises(hb.ModelError) as caught:
        hb.simulate(hb.loads(f"model: mixed\ncomponents:\n{parts}\nsimulate: {{until: 1 s}}\n"))
    assert caught.value.problems[0].code in ("media-defaults", "media-mixed")
