"""Parameters that vary: `vary:` in a diagram, and the diagnosis of a parameter that varies."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import heavebond as hb
from heavebond.core.errors import ModelError
from heavebond.language.edits import Change, Part

OSCILLATOR = """
model: oscillator
components:
  wall:   {is: Fixed}
  spring: {is: Spring, c: 100 N/m, l0: 0 m}
  mass:   {is: Mass, m: 2 kg}
  force:  {is: ForceSource, u: "=5 N*sin(2*time/(1 s))"}
nodes:
  wall: [wall.a, spring.a]
  mass: [spring.b, mass.a, force.a]
vary:
  spring.c: =1 + 0.4*spring.s/(0.5 m)
  mass.m: =1 + 0.2*time/(10 s)
initial: {mass.x: 0.1 m, mass.v: 0 m/s}
show: {x: {is: mass.x, unit: m}}
simulate: {until: 10 s, every: 10 ms}
"""


def test_a_stiffness_that_grows_over_the_stroke_and_a_mass_that_drifts_move_as_their_equation_of_motion_says():
    result = hb.simulate(hb.loads(OSCILLATOR), 10.0)

    def motion(t, y):
        return [y[1], (5*np.sin(2*t) - 100*(1 + 0.8*y[0])*y[0]) / (2*(1 + 0.02*t))]

    expected = solve_ivp(motion, (0, 10), [0.1, 0], rtol=1e-10, atol=1e-12, t_eval=np.asarray(result.time)).y[0]
    # the default tolerance of a run, 1e-6 of 0.1 m, accumulated over ten periods
    assert np.abs(np.asarray(result["x"]) - expected).max() < 1e-6


def test_the_free_parameter_of_a_varying_one_is_its_constant():
    model = hb.loads(OSCILLATOR).with_parameters({"spring.c": "120 N/m"})
    doubled = hb.loads(OSCILLATOR.replace("=1 + 0.4", "=1.2 + 1.2*0.4"))
    a, b = (np.asarray(hb.simulate(m, 2.0)["x"]) for m in (model, doubled))
    assert np.abs(a - b).max() < 1e-6


def test_a_varying_part_is_no_error_of_the_energy_balance_and_the_audit_names_it():
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # a part whose power does not balance is a warning of the run
        result = hb.simulate(hb.loads(OSCILLATOR), 10.0)
    flat = result.assembly.flat
    assert {e.owner: e.why for e in flat.energetics if e.why}["spring"] == "spring.c varies"


@pytest.mark.parametrize(("line", "message"), [
    ("spring.k: =1", "'spring.k' is not a parameter of a part, so it cannot vary"),
    ("spring.c: =spring.s", "the factor of spring.c"),
    ("spring.c: =1 + nothing", "nothing here is called 'nothing'"),
    ("spring.c: =1 + der(mass.v)/(1 m/s**2)", "the factor of spring.c contains a derivative"),
])
def test_an_invalid_factor_is_reported_with_its_line(line, message):
    text = OSCILLATOR.replace("  mass.m: =1 + 0.2*time/(10 s)", f"  {line}").replace(
        "  spring.c: =1 + 0.4*spring.s/(0.5 m)\n", "")
    with pytest.raises(ModelError) as caught:
        hb.simulate(hb.loads(text), 1.0)
    assert message in str(caught.value) and "text:12:" in str(caught.value)


def test_factors_of_two_changes_are_multiplied_and_the_file_has_them():
    one = Change({"a": Part("LinearVariation")}, vary={"spring.c": ("a.factor",)})
    two = Change({"b": Part("LinearVariation")}, vary={"spring.c": ("b.factor",)})
    assert 'spring.c: "=a.factor*b.factor"' in one.joined(two).diagram("n", "s", "m.yaml")
