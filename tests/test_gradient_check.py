"""Every verdict on a gradient, on a model where it is due."""

from __future__ import annotations

import pytest
from click.testing import CliRunner

import heavebond as hb
from heavebond.cli import main
from heavebond.gradient_check import check_gradients, signals_of
from heavebond.simulation import Tolerances

SMOOTH = """
model: smooth
components:
  wall:   {is: Fixed}
  spring: {is: Spring, c: 1.2 kN/m}
  damper: {is: Damper, d: 4 N*s/m}
  cart:   {is: Mass, m: 2.5 kg}
nodes:
  ground: [wall.a, spring.a, damper.a]
  load:   [spring.b, damper.b, cart.a]
initial: {load.x: 50 mm, load.v: 0 m/s}
simulate: {until: 2 s, every: 20 ms}
"""

# A force that stands just at its limit: a higher limit changes nothing, a lower one everything.
LIMITED = """
model: limited
components:
  limit: {is: Saturation, u: 60 N, u_min: -60 N, u_max: 60 N}
  push:  {is: ForceSource}
  cart:  {is: Mass, m: 2.5 kg}
nodes:
  force: [limit.y, push.u]
  load:  [push.a, cart.a]
initial: {load.x: 0 m, load.v: 0 m/s}
simulate: {until: 2 s, every: 20 ms}
"""


def test_a_smooth_model_agrees() -> None:
    verdicts = check_gradients(signals_of(hb.assemble(hb.loads(SMOOTH)), ["load.x"]), ["spring.c", "cart.m"])
    assert [v.word for v in verdicts] == ["agrees", "agrees"]
    assert all(v.best < 1e-6 for v in verdicts)


def test_loose_tolerances_are_blamed() -> None:
    subject = signals_of(hb.assemble(hb.loads(SMOOTH)), ["load.x"], tolerances=Tolerances(1e-2, 1e-3))
    verdict = check_gradients(subject, ["spring.c"])[0]
    assert verdict.word == "tolerance"
    assert verdict.given > 2e-3


def test_a_kink_is_named() -> None:
    """The one-sided differences are 1 and 0 times the effect of the force."""
    verdict = check_gradients(signals_of(hb.assemble(hb.loads(LIMITED)), ["load.x"]), ["limit.u_max"])[0]
    assert verdict.word == "kink"
    assert "limit" in verdict.why
    assert verdict.apart > 0.5


def test_the_command_checks_a_study() -> None:
    result = CliRunner().invoke(main, ["check-gradient", "passive_rig", "--of", "crown.x", "--to", "gas.c"])
    assert result.exit_code == 0, result.output
    assert "agrees" in result.output
    assert CliRunner().invoke(main, ["check-gradient", "passive_rig", "--of", "crown.x", "--to", "gas.k"]).exit_code == 2


def test_nothing_named_is_said() -> None:
    with pytest.raises(hb.UsageError, match="no parameter is named"):
        check_gradients(signals_of(hb.assemble(hb.loads(SMOOTH)), ["load.x"]), [])
