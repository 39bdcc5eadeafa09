"""Every component is shown and explained: an example, a symbol, a page, the source of its law, words for everything."""

from __future__ import annotations

import importlib
from pathlib import Path

from collected import for_each
from library_check import CHECKED

from heavebond.language.definition import Component
from heavebond.language.library import bundled, example, library
from heavebond.language.model import load
from heavebond.pictures.pictograms import symbol

LIBRARY = library()
COMPONENTS = {name: LIBRARY.component(name) for name in LIBRARY.names()}
PAGES = Path(__file__).parent.parent / "docs" / "components"


def is_law(component: Component) -> bool:
    """Whether it states a law of physics with coefficients; ideal sources, sensors and signal blocks are definitions."""
    return bool(component.ports) and bool(component.parameters) and component.power != "source"


def lacks(component: Component) -> list[str]:
    """What a component's file or its surroundings do not say."""
    path = component.path.resolve()
    page = PAGES / path.relative_to(bundled("components").resolve()).with_suffix(".md")
    found = {"an example under models/examples": example(component), "a symbol": symbol(component),
             "a page (`make pages`)": page.is_file() and page.with_suffix(".svg").is_file(),
             "a source": component.source or not is_law(component)}
    words = [*component.parameters.values(), *component.variables.values(), *component.signals.values()]
    return [*(what for what, there in found.items() if not there),
            *(f"a doc of {item.name}" for item in words if not item.doc)]


@for_each("name", COMPONENTS)
def test_nothing_is_left_out(name: str) -> None:
    assert lacks(COMPONENTS[name]) == []


def test_each_example_is_named_as_a_component_and_uses_it() -> None:
    stems = {c.path.stem: name for name, c in COMPONENTS.items()}
    wrong = []
    for path in sorted((bundled("models") / "examples").glob("*.yaml")):
        kinds = {i.kind for i in load(path).body.instances.values()}
        if path.stem not in stems or stems[path.stem] not in kinds:
            wrong.append(path.name)
    assert not wrong


# What users of hydraulics, pneumatics, mechanisms, drives and control look for, and the components by which they find it
WANTED = {
    "load-sensing pump": "LoadSensingPump", "power-controlled pump": "PowerControlledPump",
    "efficiency maps": "MappedPump", "ripple of a pump": "PistonPump",
    "pressure compensator": "PressureCompensator", "priority valve": "PriorityValve",
    "sequence valve": "SequenceValve", "unloading valve": "UnloadingValve",
    "pilot-operated relief valve": "PilotReliefValve",
    "proportional pressure valve": "ProportionalReliefValve ProportionalReducingValve", "cartridge valve": "LogicValve",
    "flow divider and combiner": "FlowDivider RotaryFlowDivider", "spool and poppet": "SpoolEdge Poppet",
    "two-stage servo valve": "TwoStageServoValve43", "frequency-dependent friction": "DynamicLine",
    "column separation, release of gas": "Cavitation CavitatingVolume", "height differences": "HeightDifference",
    "bends and tees": "Bend Tee", "cooler": "OilCooler", "centrifugal pump": "CentrifugalPump",
    "telescopic and rotary actuators": "TelescopicCylinder RotaryActuator", "intensifier": "PressureIntensifier",
    "gas accumulator with heat": "GasAccumulatorWithHeat", "valve from a table": "TabulatedValve",
    "pneumatic source by a measured pressure": "ControlledPneumaticSource", "air motor": "AirMotor",
    "muscle": "PneumaticMuscle", "ejector": "Ejector", "soft start": "SoftStartValve",
    "seal friction on a pneumatic port": "PneumaticSealFriction", "friction pressed by any force": "PressedFriction",
    "differential": "Differential", "screw": "LeadScrew PowerScrew", "cam": "Cam", "self-locking gear": "WormGear",
    "one-way clutch": "OneWayClutch", "locking clutch and brake": "LockingClutch", "rope drum with layers": "WinchDrum",
    "tyre": "Tyre", "solenoid": "Solenoid", "voice coil, linear motor": "VoiceCoil", "diode": "Diode",
    "electrical switch": "ElectricalSwitch",
    "PMSM": "SynchronousMotor", "stepper": "StepperMotor", "induction drive": "InductionMotor",
    "inverter averaged and switched": "AveragedInverter HalfBridge", "bumpless PID": "SwitchablePID", "notch": "NotchFilter",
    "lead-lag": "LeadLag", "Kalman filter": "KalmanFilter", "state machine": "StateMachine Sequencer",
    "impact between two bodies": "RigidStop RotationalRigidStop",
    "planar body": "PlanarBody", "planar joints": "RevoluteJoint PrismaticJoint", "rigid link": "RigidLink",
    "planar springs and dampers": "PlanarSpring PlanarStrut", "wheel": "RollingWheel", "pulley with rope": "RopeStrand",
    "planar cam": "PlanarCam", "planar gear pair": "PlanarGear", "contact with friction": "PlanarContact",
    "planar sensors": "PlanarSensor PlanarVelocitySensor PlanarForceSensor DistanceSensor",
    "to one-dimensional translation and rotation": "PlanarSlider PlanarShaft",
    "contact in space": "SpherePlaneContact SphereContact", "rolling in space": "RollingSphere RollingDisc",
    "floating body": "FloatingHull AddedMass HullDamping", "flexible beam": "ElasticBeam", "tie rod": "SpatialRod",
    "elastic bearing of six directions": "SpatialBushing", "from the plane to space": "PlaneInSpace PlaneOnBody",
    "fields": "CField IField RField TFField GYField", "modulated fields": "MCField MIField MRField MTFField MGYField",
    "junction of multi-bonds": "Junction1Field",
    "oil with temperature": "Oil OilVolume OilLine OilCylinder OilOrifice OilReliefValve", "pump that heats": "OilPump",
    "adapter to hydraulic": "HydraulicAdapter",
}
# Those of the list that carry no effect of their own, and why: what a diagnosis may miss there is a component that attaches
# to their nodes, or a value that they have already.
VALUES = "its law is its values, and each of these may be fitted"
MEASURED = "its map or table is measured and holds its losses"
ATTACHED = "friction, play, compliance and stops attach to its ports as components"
IDEAL = "an ideal source, sensor, store of data or block of a controller"
FIELD = "a general bond-graph element; its matrix is its law"
NO_EFFECT = {
    "MappedPump": MEASURED, "TabulatedValve": MEASURED, "Ejector": MEASURED, "OilCooler": MEASURED,
    "CavitatingVolume": "it is the effect itself, drawn", "HeightDifference": VALUES,
    "Bend": "another loss would be another angle of the bend", "Tee": VALUES,
    "OilVolume": VALUES, "OilOrifice": VALUES, "SoftStartValve": VALUES,
    "PressedFriction": "it is the effect itself, drawn", "RigidStop": VALUES, "RotationalRigidStop": VALUES,
    "Diode": VALUES, "ElectricalSwitch": VALUES, "AveragedInverter": VALUES, "HalfBridge": VALUES,
    "Cam": ATTACHED, "WormGear": ATTACHED, "PlanarBody": ATTACHED, "RevoluteJoint": ATTACHED, "RigidLink": ATTACHED,
    "PlanarSpring": VALUES, "PlanarStrut": ATTACHED, "RopeStrand": VALUES, "PlanarCam": VALUES, "PlanarGear": ATTACHED,
    "SpherePlaneContact": VALUES, "SphereContact": VALUES, "RollingSphere": ATTACHED, "RollingDisc": ATTACHED,
    "FloatingHull": VALUES, "AddedMass": VALUES, "HullDamping": VALUES, "ElasticBeam": VALUES, "SpatialRod": ATTACHED,
    "SpatialBushing": VALUES, "PlaneInSpace": ATTACHED, "PlaneOnBody": ATTACHED,
    "PlanarSlider": ATTACHED, "PlanarShaft": ATTACHED,
    **dict.fromkeys(("ControlledPneumaticSource", "Oil", "HydraulicAdapter", "PlanarSensor", "PlanarVelocitySensor",
                     "PlanarForceSensor", "DistanceSensor", "SwitchablePID", "NotchFilter", "LeadLag", "KalmanFilter",
                     "StateMachine", "Sequencer"), IDEAL),
    **dict.fromkeys(("CField", "IField", "RField", "TFField", "GYField", "MCField", "MIField", "MRField", "MTFField",
                     "MGYField", "Junction1Field"), FIELD),
}


@for_each("item", WANTED)
def test_what_users_look_for_is_there(item: str) -> None:
    """Each with parameters of a data sheet (words for all), source, symbol, example, page and a comparison by a test."""
    importlib.import_module("test_library_checked")  # which imports all comparisons
    for name in WANTED[item].split():
        assert name in COMPONENTS, name
        assert lacks(COMPONENTS[name]) == []
        assert name in CHECKED


@for_each("item", WANTED)
def test_the_list_has_effects_where_they_apply(item: str) -> None:
    """An effect that attaches or a dormant parameter, each with a formula of its own by a test, or the reason why none."""
    importlib.import_module("test_library_checked")
    for name in WANTED[item].split():
        component = COMPONENTS[name]
        own = component.effect is not None or any(p.neutral is not None for p in component.parameters.values())
        assert own != (name in NO_EFFECT), name


def test_reasons_for_no_effect_are_those_of_the_list() -> None:
    assert set(NO_EFFECT) <= {name for names in WANTED.values() for name in names.split()}
