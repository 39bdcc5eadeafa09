"""The oil of a circuit is given once: which parts take it, what a circuit without it has, and two in one circuit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import heavebond as hb
from heavebond.cli import main
from heavebond.core.errors import ModelError
from heavebond.diagnosis.candidates.catalogue import single_candidates
from heavebond.estimation.experiment import load_experiment
from heavebond.language.library import library
from heavebond.reports.summary import summary

CIRCUIT = """
model: circuit
components:
  oil:  {is: Fluid, rho: 900 kg/m**3, beta: 1.2 GPa}
  pump: {is: FlowSource, u: 6 L/min}
  can:  {is: Volume, V: 2 L}
  hole: {is: TurbulentLeakage, A: 1 mm**2}
  tank: {is: Tank}
nodes:
  line: [pump.a, can.a, hole.a]
  back: [hole.b, tank.a, oil.a]
initial: {line.p: 0 bar}
show: {line.p: {unit: Pa}}
simulate: {until: 0.2 s}
"""
WITHOUT = CIRCUIT.replace("  oil:  {is: Fluid, rho: 900 kg/m**3, beta: 1.2 GPa}\n", "").replace(", oil.a", "")


def test_what_is_asked_of_a_medium_is_a_property_of_it_in_the_same_unit() -> None:
    known = library()
    for name in known.names():
        component = known.component(name)
        for parameter in component.parameters.values():
            if parameter.medium:
                domain = next(known.domains[p.domain] for p in component.ports.values()
                              if p.domain in known.domains and known.domains[p.domain].medium)
                assert domain.medium is not None
                its = known.component(domain.medium).parameters[parameter.medium]
                assert its.unit.dimension == parameter.unit.dimension, f"{name}.{parameter.name}"
                assert parameter.neutral in (None, its.neutral), f"{name}.{parameter.name}"


def test_a_fluid_counts_for_the_whole_circuit_past_valves() -> None:
    given = CIRCUIT.replace("V: 2 L", "V: 2 L, beta: 1.2 GPa").replace("A: 1 mm**2", "A: 1 mm**2, rho: 900 kg/m**3")
    by_hand = given.replace("  oil:  {is: Fluid, rho: 900 kg/m**3, beta: 1.2 GPa}\n", "").replace(", oil.a", "")
    assert hb.simulate(hb.loads(CIRCUIT))["line.p"] == pytest.approx(hb.simulate(hb.loads(by_hand))["line.p"], rel=1e-9)


def test_a_value_of_its_own_comes_first_and_a_usual_one_last() -> None:
    own = hb.assemble(hb.loads(CIRCUIT.replace("V: 2 L", "V: 2 L, beta: 1 GPa")))
    assert own.parameter_values["can.beta"] == 1e9
    assert "hole.rho" not in own.parameter_values    # a formula of the fluid's
    usual = hb.assemble(hb.loads(WITHOUT))
    assert (usual.parameter_values["can.beta"], usual.parameter_values["hole.rho"]) == (1.4e9, 870.0)


def test_runs_can_be_differentiated_by_the_fluid() -> None:
    model, h = hb.loads(CIRCUIT), 1e5
    run = hb.simulate(model, sensitivities=["oil.beta", "oil.rho"])
    higher, lower = (hb.simulate(model.with_parameters({"oil.beta": 1.2e9 + d}))["line.p"] for d in (h, -h))
    # differences of runs at 1e-8 of the pressure over 2e5 Pa
    assert run.sensitivity("line.p", "oil.beta") == pytest.approx((higher - lower)/(2*h), abs=1e-5)
    assert abs(run.sensitivity("line.p", "oil.rho")[-1]) > 1e2


def test_separate_circuits_have_fluids_of_their_own() -> None:
    two = CIRCUIT.replace("nodes:", """\
  water: {is: Fluid, rho: 1000 kg/m**3}
  other: {is: Volume, V: 1 L}
nodes:
  apart: [water.a, other.a]""")
    media = hb.assemble(hb.loads(two)).flat.expanded.media
    assert [(m.source, m.nodes) for m in media] == [("oil", ("line", "back")), ("water", ("apart",))]


def test_two_fluids_in_one_circuit_are_refused() -> None:
    two = CIRCUIT.replace("nodes:", "  more: {is: Fluid}\nnodes:").replace("pump.a, can.a", "pump.a, more.a, can.a")
    with pytest.raises(ModelError, match="'oil' and 'more' fill the same circuit") as error:
        hb.assemble(hb.loads(two))
    assert [problem.code for problem in error.value.problems] == ["media-mixed"]


def test_a_fluid_reaches_past_a_cylinder_and_wakes_its_air() -> None:
    press = hb.load("cylinder_rig")
    filled = press.with_component("oil", "Fluid", {"a": "chamber_a"}, {"air": 0.01})
    assert {"cylinder.air"} <= {t for m in hb.assemble(filled).flat.expanded.media for t in m.takers}


def test_air_sleeps_once_in_the_fluid_and_not_in_every_part() -> None:
    experiment = load_experiment("cylinder_rig/leakage")
    filled = replace(experiment, model=experiment.model.with_component("oil", "Fluid", {"a": "chamber_a"}, {}))
    before, after = ({c.label for c in single_candidates(e) if "(air)" in c.label} for e in (experiment, filled))
    assert (before, after) == ({"Cylinder in cylinder (air)"}, {"Fluid in oil (air)"})


def test_the_library_tells_what_is_taken_from_the_fluid(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["library", "Capillary"])
    assert "rho of the Fluid" in capsys.readouterr().out


def test_check_says_what_fills_a_circuit() -> None:
    with_oil, without = (summary(hb.assemble(hb.loads(text)), None).media for text in (CIRCUIT, WITHOUT))
    assert with_oil == ("oil (Fluid) fills the circuit of line, back: beta 12000 bar, air 0, p_a 1.0132 bar, "
                        "n_air 1, rho 900 kg/m**3",)
    assert without == ("no Fluid in the circuit of line, back; usual values for can.beta, hole.rho: beta 14000 bar, "
                       "rho 870 kg/m**3",)


def test_a_property_that_the_fluid_lacks_is_named(tmp_path: Path) -> None:
    own = tmp_path / "warm.yaml"
    own.write_text("component: Warm\nsummary: Asks for more.\nports: {a: hydraulic}\n"
                   "parameters:\n  T: {unit: K, medium: T, doc: temperature}\nequations: |\n  a.q = 0   # none\n")
    (tmp_path / "rig.yaml").write_text(CIRCUIT.replace("nodes:", "  warm: {is: Warm}\nnodes:").replace(
        "pump.a, can.a", "pump.a, warm.a, can.a"))
    with pytest.raises(ModelError) as error:
        hb.assemble(hb.load(tmp_path / "rig.yaml"))
    assert [problem.code for problem in error.value.problems] == ["medium-property"]
