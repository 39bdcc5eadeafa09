"""Which parameters move a signal: against what is known of a mass on a spring."""

from __future__ import annotations

import pytest
from click.testing import CliRunner

import heavebond as hb
from heavebond.cli import main
from heavebond.influence import rank

HANGING = """
model: hanging
components:
  wall:   {is: Fixed}
  spring: {is: Spring, c: 1 kN/m}
  cart:   {is: Mass, m: 10 kg}
  push:   {is: ConstantForce, F: 50 N}
nodes:
  ground: [wall.a, spring.a]
  load:   [spring.b, cart.a, push.a]
initial: {start: steady}
simulate: {until: 2 s, every: 20 ms}
"""


def test_a_steady_stretch_depends_on_force_and_stiffness_alone() -> None:
    """x = F/c: 1 % more force is 1 % more stretch, 1 % more stiffness 1 % less, and the mass does nothing."""
    ranking = rank(hb.assemble(hb.loads(HANGING)), ["load.x"], ["spring.c", "cart.m", "push.F"]).rankings[0]
    found = {i.parameter: i for i in ranking.influences}
    assert found["push.F"].peak == pytest.approx(0.05, rel=1e-6)
    assert found["spring.c"].peak == pytest.approx(-0.05, rel=1e-6)
    assert abs(found["cart.m"].peak) < 1e-9
    assert ranking.influences[-1].parameter == "cart.m"


def test_all_parameters_of_the_compensator_are_ranked() -> None:
    found = rank(hb.assemble(hb.load("cmc_ahc")), ["WOB", "crown"], until="12 s", every="50 ms")
    for ranking in found.rankings:
        sizes = [i.relative for i in ranking.influences]
        assert sizes == sorted(sizes, reverse=True)
        assert {"controller.K_p", "controller.K_v", "wave.a"} <= {i.parameter for i in ranking.influences}


def test_the_command_draws_and_lists(tmp_path_factory: pytest.TempPathFactory) -> None:
    picture = tmp_path_factory.mktemp("p") / "s.png"
    result = CliRunner().invoke(main, ["sensitivity", "passive_rig", "--of", "crown.x", "--to", "gas.c,string.c",
                                       "--output", str(picture)])
    assert result.exit_code == 0, result.output
    assert "gas.c" in result.output
    assert picture.stat().st_size > 10_000
    assert CliRunner().invoke(main, ["sensitivity", "passive_rig", "--of", "crown.y"]).exit_code == 2
    assert CliRunner().invoke(main, ["sensitivity", "passive_rig", "--of", "crown.x", "--to", "gas.k"]).exit_code == 2
