"""Every parameter of the library whose range includes 0 has a law at 0: its component runs and its energy balances.

The rig of a component is its example under `models/examples`. Where the example has no solution at 0 (a source on a shut
valve, a body without mass beside nothing), each of its nodes gets a store, as any machine has around such a part.
"""

from __future__ import annotations

import warnings
from dataclasses import replace

import pytest
from collected import for_each

import heavebond as hb
from heavebond.core.errors import HeavebondError, ModelError, StartError
from heavebond.language.library import example, library
from heavebond.language.model import Model, load
from heavebond.numerics.dae import assemble
from heavebond.numerics.run_verdict import Verdict

LIBRARY = library()
ALLOWED = [(kind, p.name) for kind in LIBRARY.names() for p in LIBRARY.component(kind).parameters.values()
           if p.low == 0 and not p.integer]
# a component, its settings and its port on the node; with two ports the component of the other one
STORES: dict[str, tuple[tuple[str, dict[str, str | float], str, str], ...]] = {
    "hydraulic": (("Volume", {"V": "1 L", "beta": "1 GPa"}, "a", ""),),
    "thermohydraulic": (("OilVolume", {"V": "1 L"}, "a", ""),),
    "pneumatic": (("ReceiverWithHeat", {"V": "1 L", "G": "0.01 W/K"}, "a", ""),),
    "translational": (("Mass", {"m": "1 kg"}, "a", ""), ("SpringDamper", {"c": "1 kN/m", "d": "10 N*s/m"}, "b", "Fixed")),
    "rotational": (("Inertia", {"J": "0.01 kg*m**2"}, "a", ""),
                   ("TorsionSpringDamper", {"c": "10 N*m/rad", "d": "0.1 N*m*s/rad"}, "b", "FixedShaft")),
    "electrical": (("Capacitor", {"C": "1 mF"}, "b", "ElectricalGround"),
                   ("Resistor", {"R": "1 kohm"}, "b", "ElectricalGround")),
    "thermal": (("HeatCapacity", {"m": "1 kg", "c": "500 J/(kg*K)"}, "a", ""),),
    "planar": (("PlanarBody", {"m": "1 kg", "J": "0.01 kg*m**2"}, "a", ""),),
}
# what a run may find where the law has its values: it leaves what machines do (a pump on a shut valve), a node has no volume
FOUND = {"physical", "larger", "range", "front", "filled"}
# volumes at one end of a stroke: the run begins within the stroke
WITHIN: dict[tuple[str, str], dict[str, float]] = {
    ("Cylinder", "V_A0"): {"initial.load.x": 0.1}, ("Cylinder", "V_B0"): {"initial.load.x": -0.1},
    ("PlungerCylinder", "V_A0"): {"initial.load.x": 0.1}, ("OilCylinder", "V_A0"): {"initial.load.x": 0.1},
    ("OilCylinder", "V_B0"): {"initial.load.x": -0.02}, ("OilChamber", "V_0"): {"initial.piston.x": -0.1},
    ("PneumaticCylinderSingle", "V_d"): {"initial.jaw.x": 0.01}}
# runs that end before the example leaves what its parts may do: a rope without free length is wound up, a pump fills a
# dead end to 5000 bar
UNTIL = {("RopeStrand", "l0"): 0.02, ("OilReliefValve", "C"): 5e-4, ("OilCylinder", "A_A"): 0.1}
# examples in which nothing else decides a variable at 0, so that its error names the parameter
NAMED = {
    ("Resistor", "R"): "a short circuit of an ideal source", ("LineInertance", "I"): "no resistance beside it",
    ("PneumaticChamber", "V_0"): "the example holds its piston where its volume is V_0"}


def with_stores(model: Model, part: str) -> Model:
    """The diagram with stores on the nodes of a part."""
    domains = assemble(model).flat.domains
    ends = {name: [end.path.partition(".")[0] for end in wire.ends] for name, wire in model.body.wires.items()}
    stores = [(name, store) for name, parts in ends.items() if part in parts and name in domains
              for store in STORES.get(domains[name].name, ())]
    for k, (node, (kind, settings, port, other)) in enumerate(stores):
        if other:
            model = model.with_component(f"end_{k}", other, {"a": f"end_node_{k}"})
        wires = {port: node, "a": f"end_node_{k}"} if other else {port: node}
        model = model.with_component(f"store_{k}", kind, wires, settings)
    return model


def with_guesses(model: Model) -> Model:
    """The diagram with its initial values as guesses: some may be no states at 0."""
    guesses = {name: replace(condition, guess=True) for name, condition in model.initial.conditions.items()}
    return replace(model, initial=replace(model.initial, mode=None, conditions=guesses))


def rig(kind: str, parameter: str) -> tuple[str, Model]:
    """The example of a component with its parameter at 0, and the part."""
    path = example(LIBRARY.component(kind))
    assert path is not None
    model = load(path)
    part = next(name for name, instance in model.body.instances.items() if instance.kind == kind)
    element = "[1]" if LIBRARY.component(kind).parameters[parameter].count is not None else ""
    return part, model.with_parameters({f"{part}.{parameter}{element}": 0.0})


def verdict(kind: str, parameter: str, model: Model) -> Verdict:
    """The verdict on a run of a rig."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        until = UNTIL.get((kind, parameter))
        return hb.simulate(model, until, every=until and until / 50, parameters=WITHIN.get((kind, parameter))).verdict


@pytest.mark.long
@for_each("kind, parameter", ALLOWED, ids=".".join, parts=12)
def test_a_parameter_whose_range_includes_zero_runs_at_zero(kind: str, parameter: str) -> None:
    part, model = rig(kind, parameter)
    try:
        found = verdict(kind, parameter, model)
    except HeavebondError as error:
        failure = error
    else:
        assert {f.kind for f in found.findings} <= FOUND, found.text
        return
    if isinstance(failure, ModelError):  # bounds that follow from others: a default of V/1000, F_s >= F_c
        assert failure.problems[0].code in ("requirement", "parameter-bound")
    elif (kind, parameter) in NAMED:
        assert isinstance(failure, StartError) and f"{part}." in str(failure) and " is 0" in str(failure)
    else:
        try:
            found = verdict(kind, parameter, with_guesses(model))
        except HeavebondError:
            found = verdict(kind, parameter, with_guesses(with_stores(model, part)))
        assert {f.kind for f in found.findings} <= FOUND, found.text
