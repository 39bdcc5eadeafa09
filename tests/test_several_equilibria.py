"""A steady start of a machine with several equilibria: the nearest to the guess, and the verdict on an unstable one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import heavebond as hb
from heavebond.language.edits import Change, Part
from heavebond.language.model import loads
from heavebond.numerics.initialise import renamed_start, start

PENDULUM = """
model: pendulum
components:
  wall: {is: FixedShaft}
  arm:  {is: ArmWeight, m: 1 kg, l: 0.5 m, g: 9.81 m/s**2}
  rot:  {is: Inertia, J: 0.3 kg*m**2}
  damp: {is: RotationalDamper, d: 0.5 N*m*s/rad}
nodes:
  wall:  [wall.a, damp.a]
  shaft: [damp.b, arm.a, rot.a]
initial: {start: steady, shaft.phi: ~ GUESS rad}
simulate: {until: 3 s, every: 10 ms}
"""
# a bistable spring: k (x**3/m**2 - x) = 0 at -1, 0 (unstable) and 1 m
BISTABLE = """
model: bistable
components:
  wall:  {is: Fixed}
  damp:  {is: Damper, d: 30 N*s/m}
  load:  {is: Mass, m: 10 kg}
  push:  {is: ForceSource, u: "=100 N/m*(load.x - load.x**3/1 m**2)"}
nodes: {wall: [wall.a, damp.a], load: [damp.b, load.a, push.a]}
initial: {start: steady, load.x: ~ GUESS m}
simulate: {until: 3 s, every: 10 ms}
"""
CASES = [*((PENDULUM, "shaft.phi", guess, angle) for guess, angle in (
            (0.3, 0.0), (1.5, 0.0), (1.65, np.pi), (2.0, np.pi), (4.6, np.pi), (1.57, 0.0))),
         *((BISTABLE, "load.x", guess, place) for guess, place in (
             (0.3, 0.0), (0.56, 1.0), (0.9, 1.0), (-0.56, -1.0), (-3.0, -1.0)))]


@pytest.mark.parametrize(("diagram", "name", "guess", "expected"), CASES)
def test_a_steady_start_takes_the_equilibrium_nearest_to_the_guess(diagram: str, name: str, guess: float, expected: float
                                                                       ) -> None:
    found = start(hb.assemble(loads(diagram.replace("GUESS", repr(guess)))))
    place = next(line.used for line in found.table if line.name == name)
    assert place == pytest.approx(expected, abs=1e-6)  # the start is solved to 1e-9 of the usual sizes of forces


@pytest.mark.parametrize(("diagram", "name", "guess", "others"), [(PENDULUM, "shaft.phi", 3.0, "0 rad or 6.28"),
                                                                   (BISTABLE, "load.x", 0.0, "-1 m or 1 m")])
def test_the_verdict_names_an_unstable_steady_start_and_other_equilibria(diagram: str, name: str, guess: float, others: str
                                                                         ) -> None:
    with pytest.warns(hb.RunWarning, match=f"{name}.*unstable") as told:
        run = hb.simulate(loads(diagram.replace("GUESS", repr(guess))))
    assert run.verdict.findings[0].kind == "unstable-start" and not run.verdict.failed
    assert others in str(told[0].message)


def test_a_stable_steady_start_and_a_machine_that_is_free_to_move_get_no_such_warning() -> None:
    """A mass without a spring has the eigenvalue 0, an undamped one eigenvalues whose real parts are rounding."""
    free = PENDULUM.replace("  arm:  {is: ArmWeight, m: 1 kg, l: 0.5 m, g: 9.81 m/s**2}\n", "").replace("arm.a, ", "")
    undamped = PENDULUM.replace("0.5 N*m*s/rad", "0 N*m*s/rad")
    for diagram, initial in ((PENDULUM, ""), (undamped, ""), (free, "shaft.phi: 0.2 rad")):
        text = diagram.replace("shaft.phi: ~ GUESS rad", initial or "shaft.phi: ~ 0.1 rad")
        assert hb.simulate(loads(text)).verdict.status == "clean"


@pytest.mark.parametrize("name", ["cmc_ahc/designed", "cmc_ahc/modern"])
def test_a_start_of_a_search_follows_the_last_one_to_the_start_from_the_guess(name: str) -> None:
    """Each solves the same equations to 1e-9 of the sizes of their terms, of which the string makes up to 1e-7 of a metre;
    the difference of both is up to twice as large."""
    assembly = hb.assemble(hb.load(name))
    first = start(assembly)
    for share in (0.97, 1.0, 1.05):
        other = assembly.with_parameters({"drilling.string.c": 298e3 * share, "drilling.formation.c": 1e6 / share})
        searched, followed = start(other), start(other, near=first)
        assert followed.steps < searched.steps
        assert followed.x / other.x_nominal == pytest.approx(searched.x / other.x_nominal, abs=2e-7)
        assert followed.p == pytest.approx(searched.p, rel=1e-6)


def test_a_start_follows_no_other_one_where_its_equations_leave_a_direction_open_or_far_away() -> None:
    """A cart on wheels may rest anywhere: it stays at its guess, wherever the last start was. A pendulum hangs down though
    its last start was upside down."""
    cart = hb.assemble(loads("model: cart\ncomponents: {cart: {is: Mass, m: 1 kg}}\nnodes: {cart: [cart.a]}\n"
                             "initial: {start: steady, cart.x: ~ 2 m}\nsimulate: {until: 1 s, every: 10 ms}\n"))
    at_guess = start(cart)
    elsewhere = replace(at_guess, x=at_guess.x + 1)
    assert start(cart, near=elsewhere).x == pytest.approx(at_guess.x)
    pendulum = hb.assemble(loads(PENDULUM.replace("GUESS", "0.3")))
    hanging = start(pendulum)
    upside_down = start(hb.assemble(loads(PENDULUM.replace("GUESS", "2.0"))))
    assert abs(upside_down.x - hanging.x).max() > 3
    assert start(pendulum, near=replace(hanging, x=upside_down.x - 0.5)).x == pytest.approx(hanging.x, abs=1e-6)


def test_a_start_follows_that_of_a_diagram_with_fewer_states() -> None:
    """The compensator with a leak and a volume of oil behind it: the states that both have are followed, the pressure of the
    volume begins at its guess. The tolerance is that of the starts that follow another parameter."""
    model = hb.load("cmc_ahc/designed")
    base = hb.assemble(model)
    first = start(base)
    change = Change(components={"leak": Part("LaminarLeakage", {"C": "1e-12 m**3/(s*Pa)"}), "pocket": Part("Volume", {
        "V": "1 dm**3"})}, nodes={"ahc.supply": ["+leak.a"], "pocket": ["leak.b", "pocket.a"]})
    other = hb.assemble(change.on_model(model))
    near = renamed_start(first, base, other)
    assert np.isnan(near.x).sum() + np.isnan(near.z).sum() == 1
    searched, followed = start(other), start(other, near=near)
    assert followed.steps < searched.steps
    assert followed.x / other.x_nominal == pytest.approx(searched.x / other.x_nominal, abs=1e-7)


@pytest.mark.parametrize(("guess", "expected"), [(0.9, (0.945649274, 1.04668053)), (-0.9, (-1.04668053, -0.945649274))])
def test_a_sweep_of_a_bistable_machine_stays_on_the_branch_of_the_guess(guess: float, expected: tuple[float, float]) -> None:
    """10 x - 10 x**3 + F = 0 for F = -1 and 1 N."""
    model = hb.loads(f"""
model: bistable
parameters: {{F: 0 N}}
components:
  m: {{is: Mass, m: 1 kg}}
  s: {{is: ForceSource, u: "=10 N/m*x.x - 10 N/m**3*x.x**3 + F"}}
  d: {{is: Damper, d: 1 N*s/m}}
  w: {{is: Fixed}}
nodes: {{x: [m.a, s.a, d.a], w: [w.a, d.b]}}
initial: {{start: steady, x.x: ~ {guess} m}}
simulate: {{until: 1 s}}
""")
    found = hb.sweep(model, {"F": "-1 N, 1 N"}, ["final(x.x)"]).to_pandas().iloc[:, 1]
    assert found.to_numpy() == pytest.approx(expected, rel=1e-7)
