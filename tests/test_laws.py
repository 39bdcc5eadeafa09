"""Formulas for laws outside the catalogue: the closed forms, their components, the search and its answer."""

import json
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.integrate import solve_ivp

import heavebond as hb
from benchmarks.diagnosis import laws as machines
from benchmarks.diagnosis.beds import write
from heavebond.cli import main
from heavebond.core.units import read_unit
from heavebond.diagnosis.answer.files import Targets
from heavebond.equations.places import Place, nodes_of, places_of
from heavebond.language.library import library
from heavebond.laws.find import find_laws, write_law
from heavebond.laws.forms import MEMORY, ONE_VARIABLE, TWO_VARIABLES, Form, Motion, remembered, values
from heavebond.laws.formula import Formula
from heavebond.laws.regression import Part
from heavebond.localise import compiled_kalman
from heavebond.localise.curves import Variable
from heavebond.localise.whitening import Whitening

TIME = np.linspace(0.0, 4.0, 801)
SPEED = Variable("across", "speed slide.v", "slide.v", "m/s", np.sin(3 * TIME), np.cos(3 * TIME) > 0)
TRAVEL = Variable("position", "position slide.x", "slide.x", "m", 0.2 - np.cos(3 * TIME) / 3, np.sin(3 * TIME) > 0)


@pytest.fixture(scope="module")
def place() -> Place:
    flat = hb.assemble(hb.load("linear_motor")).flat
    return next(p for p in places_of(flat, nodes_of(flat)) if p.name == "frame-slide")


def motion(variable: Variable) -> Motion:
    return Motion(float(variable.values.min()), float(variable.values.max()),
                  np.quantile(variable.values, np.linspace(0.1, 0.9, 9)), TIME[1])


def formula(place: Place, form: Form) -> Formula:
    """A form with amplitudes of 2, 3, ... and the shape in the middle of its grid."""
    first = TRAVEL if form.first == "position" else SPEED
    part = Part(form, first, TRAVEL if form.second else None)
    of = {"w": part.second or first}
    shapes = []
    for shape in form.shapes:
        tried = shape.tried(motion(of.get(shape.unit, first)))
        shapes.append(float(tried[len(tried) // 2]))
    amplitudes = tuple(float(k + 2) for k in range(len(form.terms)))
    part = replace(part, shapes=tuple(shapes), amplitudes=amplitudes)
    return Formula(place, (part,), {v.formula: motion(v) for v in (SPEED, TRAVEL)}, ({"u_r": 1.0, "u_t": 0.005},))


FORMS = [*ONE_VARIABLE, *TWO_VARIABLES, *MEMORY]


def test_every_form_is_a_component_that_gives_the_value_of_the_formula(place: Place, tmp_path: Path) -> None:
    """The units and equations of every component agree; between a slide on a prescribed course and the frame its force is
    the formula."""
    laws = [formula(place, form) for form in FORMS]
    for k, law in enumerate(laws):
        (tmp_path / f"law{k}.yaml").write_text(law.component(f"Law{k}"), encoding="utf-8")
    known = library([tmp_path])
    assert all(known.checked(f"Law{k}").effects for k in range(len(laws)))  # raises ModelError
    (tmp_path / "d.yaml").write_text("\n".join([
        "model: d", "components:", '  drive: {is: PositionSource, u: "=0.2 m - 1/3*1 m*cos(3*time/1 s)"}',
        "  frame: {is: Fixed}",
        *(f"  law_{k}: {{is: Law{k}}}" for k in range(len(laws))), "nodes:",
        f"  slide: [drive.a, {', '.join(f'law_{k}.b' for k in range(len(laws)))}]",
        f"  frame: [frame.a, {', '.join(f'law_{k}.a' for k in range(len(laws)))}]"]), encoding="utf-8")
    run = hb.simulate(hb.load(str(tmp_path / "d.yaml")), "4 s", every="5 ms", rtol=1e-9)
    motion_of_slide = {"slide.v": run.si["slide.v"], "slide.x": run.si["slide.x"]}
    wrong = {}
    for k, law in enumerate(laws):
        written = {n.name: float(f"{n.value:.6g}") for n in law.numbers}  # in the file
        expected = law.value(motion_of_slide, run.time, written)
        # a memory of the formula is integrated in steps of 5 ms by a method of second order; a sign changes within one step
        error = float(np.abs(run.si[f"law_{k}.F"] - expected).max() / np.abs(expected).max())
        if not error < (1e-2 if law.memories else 1e-8):
            wrong[FORMS[k].name] = error
    assert not wrong


def test_a_memory_follows_its_differential_equation() -> None:
    found = remembered("(u*abs(u) - s)/tau", TIME, {"u": SPEED.values}, {"tau": np.array([0.1, 0.5])})
    for k, tau in enumerate((0.1, 0.5)):
        exact = solve_ivp(lambda t, s, tau=tau: (np.sin(3 * t) * abs(np.sin(3 * t)) - s) / tau, (0, 4), [0.0], t_eval=TIME,
                          rtol=1e-10, atol=1e-12).y[0]
        assert found[:, k] == pytest.approx(exact, abs=1e-4)  # steps of 5 ms, of second order


def test_terms_broadcast_over_values_and_shapes() -> None:
    found = values("sin(2*pi*u/p)", {"u": np.array([0.0, 0.25]), "p": np.array([[1.0], [0.5]])})
    assert found == pytest.approx(np.array([[0.0, 1.0], [0.0, 0.0]]), abs=1e-12)


def test_compiled_responses_of_a_filter_are_those_of_numpy() -> None:
    rng = np.random.default_rng(0)
    count, n, m, width = 40, 3, 2, 5
    filtering = Whitening(rng.normal(size=(count, m, n)), rng.normal(size=(count, m, m)),
                          0.3 * rng.normal(size=(count - 1, n, n)), 0.3 * rng.normal(size=(count - 1, n, m)))
    given = rng.normal(size=(count, width)), rng.normal(size=(count - 1, n)), rng.normal(size=(count, m))
    found = filtering.responses(*given)
    with patch.object(compiled_kalman, "program", lambda: None):
        assert found == pytest.approx(filtering.responses(*given), rel=1e-12, abs=1e-12)


@pytest.mark.long
def test_a_periodic_force_is_found_with_its_pitch_and_written_as_a_component(tmp_path: Path) -> None:
    found = find_laws("linear_motor/cogging")
    law = found.simplest
    assert law is not None and law.text == "F = F_0*sin(2*pi*x/pitch)" and law.place == ("frame", "slide")
    # the truth of the records is 14 N and 32 mm
    assert law.numbers["F_0"] == pytest.approx(14.0, rel=0.01) and law.numbers["pitch"] == pytest.approx(0.032, rel=1e-3)
    low, high = law.intervals["F_0"]
    assert low < 14.0 < high and law.chi2_held_out < 1.1 and law.probability > 0.5
    paths = write_law(found, Targets.beside(found.experiment, tmp_path))
    assert [p.name for p in paths] == ["law_frame_slide.yaml", "cogging_2.yaml"]
    after = hb.compare(paths[-1])
    assert max(part.chi2 for part in after.parts) < 1.1
    names = [c.component for c in hb.candidates(paths[-1])]  # the law is in the user's catalogue from then on
    assert "LawFrameSlide" in names


@pytest.mark.long
@pytest.mark.parametrize("name", ["magnet", "squeeze", "norton", "barus"])
def test_laws_of_handbooks_are_found(name: str, tmp_path: Path) -> None:
    """One variable, two variables beside dry friction, memory, and a leak."""
    law = machines.LAWS[name]
    file = write(law.bed, tmp_path)
    found = find_laws(file).simplest
    assert found is not None and set(found.place) == set(law.place)
    near, beyond = machines.differences(law, found, *machines.motion_of(law, file))
    assert near < machines.NEAR and beyond < machines.BEYOND


def test_no_formula_is_found_where_nothing_is_missing() -> None:
    found = find_laws("passive_rig/nothing")
    assert not found.missing and found.simplest is None
    assert found.words == ("No effect is missing: the parameters explain the records to the noise.",)


def test_an_unknown_place_is_named_with_the_places_that_there_are() -> None:
    with pytest.raises(hb.UsageError, match="nothing was estimated at 'slied'"):
        find_laws("linear_motor/cogging", at=["slied"])


@pytest.mark.long
def test_the_command_shows_the_formula_and_draws_it(tmp_path: Path) -> None:
    picture = tmp_path / "law.png"
    done = CliRunner().invoke(main, ["laws", "linear_motor/cogging", "--at", "slide", "--at", "frame", "-o", str(picture),
                                     "--write", str(tmp_path)])
    assert done.exit_code == 0, done.output
    assert "F = F_0*sin(2*pi*x/pitch)" in done.output and picture.stat().st_size > 10_000


def test_units_of_amplitudes_follow_from_the_law(place: Place) -> None:
    law = formula(place, next(f for f in TWO_VARIABLES if f.name == "drag times w"))
    amplitude, = (n for n in law.numbers if n.fitted)
    assert amplitude.unit.dimension == read_unit("N*s**2/m**3").dimension


# -- energy, sums of formulas, domains -------------------------------------------------------------------------------------
def test_a_component_declares_the_energy_of_its_law(place: Place) -> None:
    """Laws of the speed that dissipate say so, laws of the position store their integral; the values of both are checked."""
    texts = {form.name: formula(place, form).component("Law") for form in FORMS}
    dissipating = {name for name, text in texts.items() if "\ndissipates: F*v\n" in text}
    storing = {name for name, text in texts.items() if "\nstores: " in text}
    assert {"sign", "falling sign", "drag times exp(w/w_0)"} <= dissipating
    assert {"sine", "wave and harmonic"} <= storing
    assert "square" not in dissipating and "line times w" not in dissipating  # they may give power
    assert all("\npower: controlled" in text for name, text in texts.items() if name not in dissipating | storing)


def test_a_dissipating_law_with_a_negative_amplitude_is_not_declared_as_one(place: Place) -> None:
    law = formula(place, next(f for f in FORMS if f.name == "drag"))
    assert "dissipates" in law.component("Law") and "min: 0 " in law.component("Law")
    assert "dissipates" not in law.component("Law", {"c": -2.0})


def test_the_stored_energy_is_the_integral_of_the_force(place: Place) -> None:
    """A slide that is moved slowly gains the energy: its difference is the work of the force."""
    x = np.linspace(-0.1, 0.2, 20001)
    for form in (f for f in ONE_VARIABLE if f.energies):
        constants = {"u_0": 0.35, "p": 0.05}
        for term, energy in zip(form.terms, form.energies, strict=True):
            force, stored = (np.broadcast_to(values(text, {"u": x, **constants}), x.shape) for text in (term.text, energy))
            work = np.sum((force[1:] + force[:-1]) / 2 * np.diff(x))
            assert stored[-1] - stored[0] == pytest.approx(work, rel=1e-5, abs=1e-9), form.name


def test_formulas_are_joined_with_their_values(place: Place) -> None:
    sign, drag = (formula(place, next(f for f in FORMS if f.name == name)) for name in ("falling sign", "drag"))
    first = sign.with_numbers({"F_0": 7.0, "v_0": 0.3})
    both = first.joined(drag)
    assert both.text == "F = F_0*smooth_sign(v, v_t)*exp(-abs(v)/v_0) + c*v*abs(v)"
    assert {n.name: n.value for n in both.numbers if n.fitted} == {"F_0": 7.0, "v_0": 0.3, "c": 2.0}
    assert sign.key < both.key and not both.key <= drag.key


def test_a_node_of_oil_is_not_taken_for_one_of_gas() -> None:
    """Gas and oil with temperature have the same variables: the ports decide."""
    nodes = nodes_of(hb.assemble(hb.load("examples/oil_volume")).flat)
    assert {node.domain.name for node in nodes.values()} == {"thermohydraulic"}
    nodes = nodes_of(hb.assemble(hb.load("receiver_rig")).flat)
    assert {node.domain.name for node in nodes.values()} == {"pneumatic"}


# -- the experiment that decides -------------------------------------------------------------------------------------------
SOFTENING = machines._slide(
    "softening", "A slide on a soft magnetic spring.", "F = 30 N*sin(x/50 mm)", "F = F_0*sin(x/x_0)",
    {"F_0": "30 N", "x_0": "0.05 m"}, lambda q, t: 30 * np.sin(q["x"] / 0.05), drive=20.0, seconds=6.0, rate=50.0)


@pytest.mark.long
def test_an_experiment_is_designed_that_decides_between_formulas(tmp_path: Path) -> None:
    """Within the small motion of the records several softening laws are alike. The command writes an input of the drive
    within its limits in the records, under which two of them differ by more than a fit can absorb."""
    file, proposal = write(SOFTENING.bed, tmp_path), tmp_path / "next.csv"
    result = CliRunner().invoke(main, ["laws", str(file), "--at", "frame", "--at", "slide", "--decide", str(proposal),
                                       "--json", str(tmp_path / "r.json")])
    assert result.exit_code == 0, result.output
    answer = json.loads((tmp_path / "r.json").read_text())
    formulas = {law["formula"] for law in answer["laws"]}
    assert len(formulas) == len(answer["laws"])  # each once
    assert len(answer["alike"]) >= 2 and answer["simplest"]["formula"] not in answer["alike"]
    separation = answer["separation"]
    assert separation["decides"] and any(pair["sure"] > 0.95 for pair in separation["pairs"])
    assert "To distinguish them, record drive.u as" in " ".join(answer["words"])
    columns = np.genfromtxt(proposal, delimiter=",", names=True)
    seen = np.genfromtxt(tmp_path / "train.csv", delimiter=",", names=True, deletechars="")
    assert np.abs(columns["driveu"]).max() <= 1.001 * np.abs(seen["drive.u"]).max()
    again = CliRunner().invoke(main, ["laws", str(file), "--decide", str(proposal)])
    assert again.exit_code == 2 and "exists already" in again.output


@pytest.mark.slow  # a minute of processor time; laws of one part, and of several variables, are found in every run
def test_a_law_of_two_parts_is_found_about_the_motion_with_the_first() -> None:
    """The friction of the passive rig sticks: about the motion without it no sum of a few parts is near. The law has the
    Stribeck form with the Coulomb friction and the additional static friction of the truth within 25 %, as it has no
    bristles; a quarter of the misfit of Coulomb friction is left at most."""
    found = find_laws("passive_rig/friction")
    stribeck = "F = F_1*smooth_sign(v, v_t) + F_2*smooth_sign(v, v_t_2)*exp(-abs(v)/v_0)"
    law = next(law for law in found.laws if law.text == stribeck)
    assert law.place == ("platform", "crown")
    # a law with a state in addition, in place of the bristles, predicts better
    assert found.simplest is not None and found.simplest.place == law.place and found.simplest.loss <= law.loss
    assert found.simplest is law or (found.simplest.text.startswith(stribeck) and "der(" in found.simplest.text)
    assert law.numbers["F_1"] == pytest.approx(12e3, rel=0.25) and law.numbers["F_2"] == pytest.approx(10.8e3, rel=0.25)
    coulomb = next(other for other in found.laws if other.text == "F = F_0*smooth_sign(v, v_t)")
    assert law.loss < coulomb.loss / 4


@pytest.mark.long
def test_a_leak_of_oil_whose_viscosity_depends_on_the_temperature_is_found(tmp_path: Path) -> None:
    law = find_laws(write(machines.OIL.bed, tmp_path)).simplest
    assert law is not None and law.text == "m = c*dp*exp(block_T/block_T_0)"
    assert law.numbers["block_T_0"] == pytest.approx(30.0, rel=0.01)
    assert law.finding is not None
    hb.assemble(law.finding.fit.experiment.model)  # its component can be read after the search
