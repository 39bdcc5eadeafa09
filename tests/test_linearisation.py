"""The linearised machine against closed forms and differences."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from test_sensitivities import LOOP

import heavebond as hb
from heavebond.cli import main
from heavebond.linear.linearisation import Linearisation, ModesAtStart, start_point
from heavebond.linear.modal_values import chosen_mode, modal_number, modal_slope
from heavebond.numerics.dae import Assembly
from heavebond.numerics.initialise import start

NONE = np.zeros(0)
OSCILLATOR = """
model: oscillator
parameters:
  force: 5 N
components:
  wall:   {is: Fixed}
  spring: {is: Spring, c: 4 kN/m}
  damper: {is: Damper, d: 40 N*s/m}
  cart:   {is: Mass, m: 10 kg}
  push:   {is: ForceSource, u: =force}
nodes:
  ground: [wall.a, spring.a, damper.a]
  load:   [spring.b, damper.b, cart.a, push.a]
initial: {load.x: 0 m, load.v: 0 m/s}
simulate: {until: 1 s}
"""
FREE = """
model: free
components:
  one: {is: Mass, m: 1 kg}
  two: {is: Mass, m: 3 kg}
  spring: {is: Spring, c: 300 N/m}
nodes:
  left: [one.a, spring.a]
  right: [two.a, spring.b]
initial: {left.x: 0 m, left.v: 0 m/s, right.x: 0 m, right.v: 0 m/s}
simulate: {until: 1 s}
"""


@pytest.fixture(scope="module")
def oscillator() -> Assembly:
    return hb.assemble(hb.loads(OSCILLATOR))


def test_an_oscillator_has_its_closed_form(oscillator: Assembly) -> None:
    """w_0 = sqrt(c/m) = 20 rad/s, D = d/(2 sqrt(c m)) = 0.1; static compliance 1/c."""
    linear = Linearisation(oscillator, ["force"], ["load.x", "spring.F"]).at(start_point(start(oscillator), NONE))
    mode, = linear.modes()
    assert mode.frequency == pytest.approx(20 / (2 * np.pi), rel=1e-12)
    assert mode.damping == pytest.approx(0.1, rel=1e-12)
    assert sum(mode.participation.values()) == pytest.approx(1)
    static = linear.d - linear.c @ np.linalg.solve(linear.a, linear.b)
    assert abs(static[0, 0]) == pytest.approx(1 / 4000, rel=1e-10)
    assert abs(static[1, 0]) == pytest.approx(1, rel=1e-10)


def test_algebraic_unknowns_are_eliminated() -> None:
    """The slope of the outputs as the loop's own differences of the static solution have it."""
    assembly = hb.assemble(hb.loads(LOOP))
    assert assembly.algebraic_names
    linear = Linearisation(assembly, ["source.p_0"], ["mid.p"]).at(start_point(start(assembly), NONE))
    value, step = assembly.parameter_values["source.p_0"], 1e-4 * assembly.parameter_values["source.p_0"]
    low, high = (hb.simulate(assembly, 1e-9, every=1e-9, parameters={"source.p_0": value + h})["mid.p"][0]
                 for h in (-step, step))
    assert linear.d[0, 0] == pytest.approx((high - low) / (2 * step), rel=1e-6)


def test_a_body_that_nothing_holds_has_a_mode_at_zero() -> None:
    """Two masses on a spring: 0, 0 and w**2 = c (1/m_1 + 1/m_2) = 400; none of the first two counts as damped or not."""
    assembly = hb.assemble(hb.loads(FREE))
    _, modes = ModesAtStart(assembly).at({})
    moving = [m for m in modes if m.value]
    assert len(moving) == 1
    assert moving[0].frequency == pytest.approx(20 / (2 * np.pi), rel=1e-9)
    assert modal_number("damping", chosen_mode(modes, "damping", "least")) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("name", ["cmc_ahc", "cmc_ahc/active_frictionless"])
@pytest.mark.parametrize(("number", "which"), [("damping", "least"), ("damping", "slowest"), ("decay", "least")])
def test_numbers_of_modes_move_as_differences_say(name: str, number: str, which: str) -> None:
    """The start moves along: the mass of the crown block changes the gas preload that is solved for."""
    assembly = hb.assemble(hb.load(name))
    modes, names = ModesAtStart(assembly), ["controller.K_p", "ahc.valve.f_n", "crown.m", "cmc.gas.c"]
    first, found = modes.at({})
    mode = chosen_mode(found, number, which)
    assert mode is not None
    exact = modal_slope(number, mode, modes.slope(first, mode, names))
    for slope, parameter in zip(exact, names, strict=True):
        value = assembly.parameter_values[parameter]
        low, high = (modal_number(number, chosen_mode(modes.at({parameter: value * (1 + h)})[1], number, which))
                     for h in (-1e-5, 1e-5))
        # differences over 1e-5 of numbers that are right to 3e-11
        assert slope == pytest.approx((high - low) / (2e-5 * value), rel=1e-4, abs=3e-6 / value)


def test_modes_with_a_loop_inside_move_as_differences_say() -> None:
    """Between two orifices the pressure is algebraic, behind them a chamber fills: the vectors of the whole system count."""
    text = LOOP.replace("tank:   {is: Tank}", "chamber: {is: Volume, V: 1 L, beta: 1 GPa}\n"
                        "  leak: {is: LaminarLeakage, C: 1e-12 m**3/(s*Pa)}\n  tank: {is: Tank}") \
        .replace("low:  [second.b, tank.a]", "low:  [second.b, chamber.a, leak.a]\n  out: [leak.b, tank.a]")
    text += "initial: {low.p: 40 bar}\n"
    assembly = hb.assemble(hb.loads(text))
    assert assembly.algebraic_names
    modes, name = ModesAtStart(assembly), "first.q_r"
    first, (mode,) = modes.at({})
    value = assembly.parameter_values[name]
    low, high = (modes.at({name: value * (1 + h)})[1][0].value.real for h in (-1e-5, 1e-5))
    assert modes.slope(first, mode, [name])[0].real == pytest.approx((high - low) / (2e-5 * value), rel=1e-5)


def test_unknown_names_are_said(oscillator: Assembly) -> None:
    with pytest.raises(hb.UsageError, match="Did you mean 'force'"):
        Linearisation(oscillator, ["forc"])
    with pytest.raises(hb.UsageError, match=r"load\.z"):
        Linearisation(oscillator, [], ["load.z"])


def test_the_command_lists_modes_and_says_what_grows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                                     capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "oscillator.yaml").write_text(OSCILLATOR, encoding="utf-8")
    for setting, grows in (("damper.d=40 N*s/m", False), ("damper.d=0 N*s/m", False)):
        with pytest.raises(SystemExit) as caught:
            main(["modes", "oscillator.yaml", "--set", setting, "--json", "told.json"])
        assert caught.value.code == 0
        mode, = json.loads((tmp_path / "told.json").read_text(encoding="utf-8"))["modes"]
        assert mode["frequency"] == pytest.approx(20 / (2 * np.pi))
        assert set(mode["participation"]) == {"load.x", "load.v"}
        assert ("mode grows" in capsys.readouterr().out) is grows
    with pytest.raises(SystemExit):
        main(["modes", "cmc_ahc", "--set", "controller.K_p=7 1/m"])
    assert "1 mode grows" in capsys.readouterr().out
