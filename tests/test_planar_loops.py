"""Closed loops of planar parts: their start from any guess, why there is none, and states that change on the way."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from doc_pages import blocks
from scipy.integrate import solve_ivp

import heavebond as hb
from heavebond.energy_audit.audit import energy as audit

G = 9.81
PAGE = Path(__file__).parent.parent / "docs" / "mechanisms.md"
DIAGRAMS = {block.mark[1]: block.text for block in blocks(PAGE) if block.mark[0] == "file"}


def begun(name: str, initial: str, **changed: str) -> hb.Model:
    """A diagram of the page with other initial conditions, and with other lines of parts."""
    lines = DIAGRAMS[f"{name}.yaml"].splitlines()
    lines = [f"initial: {{{initial}}}" if line.startswith("initial:") else line for line in lines]
    for part, text in changed.items():
        lines = [f"  {part}: {text}" if line.lstrip().startswith(f"{part}:") and "is:" in line else line for line in lines]
    return hb.loads("\n".join(lines))


@pytest.mark.parametrize("initial", [
    "crank.phi: 60 deg, crank.w: 0 rad/s, rocker.phi: ~ 60 deg, two.phi: ~ 0 deg",  # guesses at the ports b
    "one.phi: 60 deg, one.w: 0 rad/s, rocker.phi: ~ 60 deg",
    "crank.phi: 60 deg, crank.w: 0 rad/s",  # none at all
])
def test_a_parallelogram_starts_from_any_guess(initial: str) -> None:
    """Guesses far from any position of the loop once made the level coupler's own angle a state, which never moves."""
    found = hb.simulate(begun("parallelogram", initial), "0.1 s")
    fallen = solve_ivp(lambda t, y: (y[1], -G/0.3*np.cos(y[0])), (0, 0.1), (np.pi/3, 0), rtol=1e-10, atol=1e-10)
    assert found["crank.phi"][-1] == pytest.approx(fallen.y[0, -1], abs=1e-6)
    assert found["rocker.phi"] == pytest.approx(found["crank.phi"], abs=1e-9)


def test_a_strut_whose_ends_coincide_at_the_guess_does_not_spoil_the_choice_of_states() -> None:
    """Its distance has no derivative there, where all frames lie at the origin."""
    text = DIAGRAMS["parallelogram.yaml"]
    text = text.replace("components:", "components:\n  strut: {is: PlanarStrut}\n  zero: {is: Fixed}")
    for node, port in (("left:   [", "strut.a"), ("coupler: [", "strut.b")):
        text = text.replace(f"  {node}", f"  {node}{port}, ")
    text = text.replace("nodes:", "nodes:\n  zero: [zero.a, strut.h]\n  free: [strut.r]")
    lines = ["initial: {crank.phi: 60 deg, crank.w: 0 rad/s}" if line.startswith("initial:") else line
             for line in text.splitlines()]
    found = hb.simulate(hb.loads("\n".join(lines)), "0.1 s")
    assert found["rocker.phi"] == pytest.approx(found["crank.phi"], abs=1e-9)


@pytest.mark.parametrize(("initial", "changed", "said"), [
    ("crank.phi: 0 deg, crank.w: 1 rad/s, foot.phi: ~ 0 deg, coupler.phi: ~ 0 deg", {}, "begins at a dead centre"),
    ("crank.phi: 60 deg", {"coupler": "{is: RigidLink, l: 2 m}"}, "cannot be assembled"),
    ("crank.phi: 60 deg, foot.phi: 50 deg", {}, "do not meet where crank.phi, foot.phi have the values given"),
])
def test_why_a_loop_has_no_start(initial: str, changed: dict[str, str], said: str) -> None:
    with pytest.raises(hb.StartError) as caught:
        hb.simulate(begun("parallelogram", initial, **changed))
    assert said in str(caught.value)
    assert "reference" not in str(caught.value)


@pytest.mark.long
def test_a_crank_and_rocker_that_begins_with_its_rocker_as_state() -> None:
    """The rocker stands still twice in each turn of the crank, where its angle cannot be a state.

    By energy: phi' = -sqrt(2 E/m)/|d/dphi of the path of the centre of mass| in a level plane, the rocker's angle from the
    half-angle formula of the four-bar loop.
    """
    model = begun("four_bar", "crank.phi: ~ 0 rad, foot.phi: 92 deg, foot.w: -2 rad/s, coupler.phi: ~ 50 deg",
                  motor="{is: Inertia, J: 0.02 kg*m**2}", load="{is: PlanarBody, m: 2 kg, J: 0.1 kg*m**2, g: 0}")
    found = hb.simulate(model, "3 s", rtol=1e-10, atol=1e-12)
    crank, rocker = found["crank.phi"], found["foot.phi"]
    assert np.ptp(crank) > 4*np.pi
    assert len(found.statistics["state_changes"]) >= 1
    a, b, c, d = 0.3, 1.0, 0.8, 0.9

    def ratio(phi: float, psi: float) -> float:
        """d(psi)/d(phi): both ends of the coupler have the same speed along it."""
        along = np.array([d + c*np.cos(psi) - a*np.cos(phi), c*np.sin(psi) - a*np.sin(phi)])
        return float(a*(along @ [-np.sin(phi), np.cos(phi)])/(c*(along @ [-np.sin(psi), np.cos(psi)])))

    def inertia(phi: float, psi: float) -> float:
        return 0.02 + (0.1 + 2*c**2)*ratio(phi, psi)**2

    energy = inertia(crank[0], rocker[0])*found["crank.w"][0]**2
    way = np.sign(found["crank.w"][0])

    def rates(t: float, y: np.ndarray) -> tuple[float, float]:
        speed = way*np.sqrt(energy/inertia(*y))
        return speed, ratio(*y)*speed

    exact = solve_ivp(rates, (0, 3), (crank[0], rocker[0]), "DOP853", found.time, rtol=1e-11, atol=1e-11)
    # what the integrator adds up over three turns at rtol 1e-10
    assert crank == pytest.approx(exact.y[0], abs=1e-5)
    assert rocker == pytest.approx(exact.y[1], abs=1e-5)
    gap = np.hypot(d + c*np.cos(rocker) - a*np.cos(crank), c*np.sin(rocker) - a*np.sin(crank)) - b
    assert np.abs(gap).max() < 1e-10
    audit(model, "1 s", rtol=1e-10, atol=1e-12).raise_if_open(1e-6)
