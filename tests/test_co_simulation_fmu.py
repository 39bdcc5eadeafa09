"""Co-simulation FMUs: bundled machines against their own runs, exact solutions, restored runs, and refused calls."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from click.testing import CliRunner
from collected import partly
from test_export import DRIVEN, LOOP, compiled

import heavebond as hb
from heavebond.cli import main
from heavebond.exchange.fmu_export import export_fmu

pytestmark = compiled

PUSHED = """
model: pushed
components:
  floor: {is: Fixed}
  spring: {is: SpringDamper, c: 400 N/m, d: 8 N*s/m}
  load:  {is: Mass, m: 4 kg}
  push:  {is: ForceSource, u: 0 N}
nodes:
  floor: [floor.a, spring.a]
  load:  [spring.b, load.a, push.a]
initial: {load.x: 0 m, load.v: 0 m/s}
show: {place: {is: load.x, unit: m}}
simulate: {until: 2 s, every: 10 ms}
"""


@contextmanager
def opened(path: Path, version: int, begin: float = 0.0, **kind: bool) -> Iterator[tuple[Any, dict[str, int]]]:
    """An instance after its initialisation, and the value references by name; `kind` is how FMI 3.0 instantiates it."""
    from fmpy.fmi2 import FMU2Slave
    from fmpy.fmi3 import FMU3Slave

    told = fmpy.read_model_description(str(path))
    made = (FMU3Slave if version == 3 else FMU2Slave)(
        guid=told.guid, unzipDirectory=fmpy.extract(str(path)), instanceName="m",
        modelIdentifier=told.coSimulation.modelIdentifier)
    made.instantiate(**kind)
    if version == 2:
        made.setupExperiment(startTime=begin)
        made.enterInitializationMode()
    else:
        made.enterInitializationMode(startTime=begin)
    made.exitInitializationMode()
    try:
        yield made, {v.name: v.valueReference for v in told.modelVariables}
    finally:
        made.freeInstance()


def put(made: Any, number: int, value: float) -> None:
    (made.setFloat64 if hasattr(made, "setFloat64") else made.setReal)([number], [value])


def get(made: Any, number: int) -> float:
    return float((made.getFloat64 if hasattr(made, "getFloat64") else made.getReal)([number])[0])


@pytest.mark.parametrize(("name", "version"), [
    ("passive_rig", 2), *(pytest.param(name, version, marks=pytest.mark.long) for name, version in (("quarter_car", 3),
        ("cylinder_rig", 3), ("hydrostatic_drive", 3), ("excavator_boom", 2), ("dc_stage", 3), ("cascaded_tanks", 2)))])
def test_bundled_machines_run_in_another_program_as_here(name: str, version: int, tmp_path: Path) -> None:
    from fmpy.validation import validate_fmu

    model, path = hb.load(name), tmp_path / "m.fmu"
    export_fmu(model, path, version=version)
    assert validate_fmu(str(path)) == []
    run = hb.simulate(model, rtol=1e-10)
    found = fmpy.simulate_fmu(str(path), fmi_type="CoSimulation", stop_time=float(run.time[-1]),
                              output_interval=float(run.time[1]))
    for output in model.show:
        exact = run.display[output]
        # two integrators with errors of 1e-9 and 1e-10 a step, over thousands of steps
        assert np.abs(found[output] - exact).max() < 1e-6 * np.ptp(exact), output


@pytest.mark.parametrize("version", [2, 3])
def test_a_held_input_gives_the_exact_solution_at_steps_of_any_length(version: int, tmp_path: Path) -> None:
    """m x'' + d x' + c x = F from rest, with F constant in each step: x = e^(At) x0 + what F leaves (matrix exponential)."""
    from scipy.linalg import expm

    export_fmu(hb.loads(PUSHED), tmp_path / "m.fmu", ["push.u"], version)
    a = np.array([[0, 1, 0], [-100, -2, 0.25], [0, 0, 0]])  # of place, speed and force
    state, time = np.zeros(3), 0.0
    with opened(tmp_path / "m.fmu", version) as (made, numbers):
        for step, force in ((0.01, 40.0), (0.5, -20.0), (1e-6, 100.0), (0.2, 100.0), (0.3, 0.0)):
            put(made, numbers["push.u"], force)
            made.doStep(time, step)
            state[2], time = force, time + step
            state = expm(a * step) @ state
            # an error of 1e-9 a step, of places of 0.1 m
            assert get(made, numbers["place"]) == pytest.approx(state[0], abs=1e-9)


@pytest.mark.parametrize("version", partly([2, 3], 2))
@pytest.mark.parametrize("text", [LOOP, DRIVEN], ids=["loop", "driven"])
def test_a_restored_run_is_the_same_to_the_last_bit(text: str, version: int, tmp_path: Path) -> None:
    model = hb.loads(text)
    export_fmu(model, tmp_path / "m.fmu", version=version)
    with opened(tmp_path / "m.fmu", version) as (made, numbers):
        steps = [0.003, 0.02, 0.0011, 0.05, 0.007]

        def onwards(time: float) -> list[float]:
            found = []
            for step in steps:
                made.doStep(time, step)
                time += step
                found += [get(made, numbers[name]) for name in model.show]
            return found

        made.doStep(0.0, 0.013)
        state = made.getFMUState() if version == 3 else made.getFMUstate()
        first = onwards(0.013)
        (made.setFMUState if version == 3 else made.setFMUstate)(state)
        assert onwards(0.013) == first
        if version == 2:
            kept = made.deSerializeFMUstate(made.serializeFMUstate(state))
            made.setFMUstate(kept)
            assert onwards(0.013) == first
        assert max(first) > min(first)


@pytest.mark.parametrize("version", partly([3, 2], 2))
def test_derivatives_at_communication_points_and_refused_calls(version: int, tmp_path: Path) -> None:
    """The rate of the speed by the force is 1/m, by the place -c/m; what is no unknown and no variable is refused."""
    export_fmu(hb.loads(PUSHED), tmp_path / "m.fmu", ["push.u"], version)
    with opened(tmp_path / "m.fmu", version) as (made, numbers):
        made.doStep(0.0, 0.1)
        rate = [numbers["der(load.v)"]]
        for name, exact in (("push.u", 1 / 4), ("load.x", -100)):
            assert made.getDirectionalDerivative(rate, [numbers[name]], [1.0]) == pytest.approx([exact])
        for wrong in (lambda: put(made, 10_000, 1.0), lambda: put(made, numbers["place"], 1.0),
                      lambda: made.doStep(0.1, -0.1), lambda: made.getDirectionalDerivative([0], rate, [1.0])):
            with pytest.raises(fmpy.fmi1.FMICallException):
                wrong()


def test_names_and_descriptions_carry_no_code_into_the_sources(tmp_path: Path) -> None:
    text = PUSHED.replace("model: pushed", 'model: pushed\nsummary: "ends */ system(1); /* <x> & \\" here"')
    export_fmu(hb.loads(text), tmp_path / "m.fmu", version=2)
    with zipfile.ZipFile(tmp_path / "m.fmu") as archive:
        assert "*/ system" not in archive.read("sources/model.c").decode()
        assert "system(1)" in fmpy.read_model_description(str(tmp_path / "m.fmu")).description
        assert {"sources/fmi2.c", "sources/fmu_core.c", "sources/rosenbrock.c"} < set(archive.namelist())


def test_the_command_writes_fmi_2(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("pushed.yaml").write_text(PUSHED)
    answer = CliRunner().invoke(main, ["export", "pushed.yaml", "-o", "m.fmu", "--fmi", "2", "--input", "push.u"])
    assert answer.exit_code == 0, answer.output
    assert fmpy.read_model_description("m.fmu").fmiVersion == "2.0"
    with pytest.raises(hb.UsageError, match="fmi-version"):
        export_fmu(hb.loads(PUSHED), "n.fmu", version=4)


@pytest.mark.parametrize("version", [2, pytest.param(3, marks=pytest.mark.long)])
def test_values_that_parameters_must_not_give_are_refused_as_in_a_run(version: int, tmp_path: Path) -> None:
    """A stiffness that follows from parameters becomes negative: at the initialisation, and when they are set later."""
    from fmpy.fmi1 import FMICallException

    model, path = hb.loads("""
model: stiff
parameters: {k1: 4 kN/m, k2: 1 kN/m}
components: {wall: {is: Fixed}, spring: {is: Spring, c: =k1 - k2}, load: {is: Mass, m: 10 kg}}
nodes: {a: [wall.a, spring.a], load: [spring.b, load.a]}
initial: {load.x: 1 mm, load.v: 0 m/s}
show: {x: {is: load.x, unit: mm}}
simulate: {until: 0.1 s, every: 10 ms}
"""), tmp_path / "m.fmu"
    with pytest.raises(hb.ModelError, match=r"spring.c = k1 - k2, that is -1000 N/m, is not allowed"):
        hb.simulate(model, parameters={"k2": 5000.0})
    export_fmu(model, path, version=version)
    heard = list[str]()
    logger = {"logger": lambda *words: heard.append(str(words[-1]))} if version == 3 else {}
    for kind in ("CoSimulation", "ModelExchange"):
        with pytest.raises(FMICallException):
            fmpy.simulate_fmu(str(path), fmi_type=kind, stop_time=0.1, start_values={"k2": 5000.0}, **logger)
        assert version == 2 or "spring.c is -1000 N/m; it must be at least 0 N/m" in heard[-1]
    with opened(path, version) as (made, numbers):
        put(made, numbers["k1"], 500.0)
        put(made, numbers["k2"], 500.0)  # only the values at the next evaluation count
        assert get(made, numbers["x"]) == 1
        put(made, numbers["k2"], 5000.0)
        with pytest.raises(FMICallException):
            made.doStep(0.0, 0.01)
