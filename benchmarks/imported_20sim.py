"""Imported 20-sim models against the FMUs that 20-sim made of them.

    python -m benchmarks.imported_20sim FOLDER

FOLDER holds .emx files and FMUs with sources of the INTO-CPS examples (repositories `example-mass_spring_damper`,
`example-single_watertank`, `example-three_tank_watertank`, `example-line_follower_robot`, `example-fcu`,
`example-uav_swarm`); a case whose files are not there is left out. An FMU is compiled from its own
sources with its fixed step made shorter and shorter, at powers of two, in which time adds up without rounding. Both sides
get the same inputs, constant over 1/64 s, and the values of the FMU where those of the .emx file differ. They are compared
in the middle of these intervals: the error is the largest difference over the range of the FMU's output. The method of the
FMUs takes the rate at the begin of a step from before the inputs change, so it converges with the first power of its step.

The instants at which an output switches are compared for themselves: those of the FMU are the ends of the steps at which
its output has changed.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import heavebond as hb
from heavebond.import_20sim.importer import import_emx
from heavebond.language.library import library

Array = NDArray[np.float64]
HOLD = 1 / 64  # s, over which inputs are constant
SHORTER = (1, 8, 64, 256)  # steps are 1/128 s over these


@dataclass(frozen=True)
class Case:
    """An FMU with the part of the diagram that it is, its inputs over time, and parameters that replace its own: name in the
    diagram, and the text in its sources with what replaces it."""

    fmu: str
    emx: str
    part: str
    outputs: tuple[str, ...]
    until: float
    inputs: dict[str, Callable[[Array], Array]] = field(default_factory=dict)
    values: dict[str, str] = field(default_factory=dict)
    edits: dict[str, str] = field(default_factory=dict)
    switching: str = ""  # an output that switches, whose instants are compared


def _pulse(begin: float, end: float, value: float = 1.0) -> Callable[[Array], Array]:
    return lambda t: np.where((t >= begin) & (t < end), value, 0.0)


CASES = (
    Case("mass_spring_damper_1", "mass_spring_damper", "MassSpringDamper1", ("x1", "v1"), 8.0,
         {"fk": lambda t: np.sin(3 * t)}),
    Case("mass_spring_damper_2", "mass_spring_damper", "MassSpringDamper2", ("fk", "x2", "v2"), 8.0,
         {"x1": lambda t: np.cos(2 * t), "v1": lambda t: -2 * np.sin(2 * t)}, {"cc": "1"}),
    Case("single_watertank", "single_watertank", "SingleWatertank", ("level",), 16.0, {"valvecontrol": _pulse(4.0, 9.0)}),
    # pulses at powers of two: at tenths of a second the FMU's clock, which adds up its steps, misses them by a step each
    Case("three_tank_part1", "three_tank", "WaterTanks1", ("Tank1WaterLevel", "Tank2WaterLevel", "Tank1InFlow",
                                                         "Tank2OutFlow"), 16.0,
         values={"Inflow.PulseWave.interval": "0.25 s", "Inflow.PulseWave.pulselength": "0.125 s"},
         edits={"xx_P[0] = 0.2;": "xx_P[0] = 0.25;", "xx_P[1] = 0.1;": "xx_P[1] = 0.125;"}, switching="Tank1InFlow"),
    Case("three_tank_part2", "three_tank", "WaterTanks2", ("level", "Tank3OutFlow"), 16.0,
         {"inFlow": lambda t: 0.5 + 0.4 * np.sin(t), "valveControl": _pulse(6.0, 11.0)}),
    Case("line_follower_body", "line_follower_body", "Body", ("robot_x", "robot_y", "robot_theta", "total_energy_used",
                                                            "wheel_left_rotation", "wheel_right_rotation"), 4.0,
         {"servo_left_input": lambda t: 0.4 + 0.1 * np.sin(2 * t), "servo_right_input": lambda t: -0.3 - 0.0 * t},
         {f"servo_{side}.{name}": value for side in ("left", "right")
          for name, value in (("inductance.I", "0.071 W*s"), ("internal_controller.tauI", "0.1 s"))}),
    Case("RoomHeating", "RoomHeating", "RoomHeating", ("RAT",), 60.0,
         {"fanspeed": lambda t: 0.5 + 0.3 * np.sin(t), "valveopen": lambda t: 0.6 + 0 * t,
          "OAT": lambda t: 10 + 5 * np.sin(t / 7)}, edits={"xx_P[12] = 200.0;": "xx_P[12] = 0.1;"}),
    Case("UAV", "UAV", "UAV", ("posX", "posY", "posZ", "velX", "velY", "velZ", "currentYaw", "currentRoll", "currentPitch",
                               "batteryCharge"), 4.0,
         {"throttle": lambda t: 0.9 + 0 * t, "pitch": lambda t: 0.3 * np.sin(t), "roll": lambda t: 0.2 * np.cos(t),
          "yaw": lambda t: 0.5 + 0 * t}),
)


def instants(case: Case, folder: Path, step: float) -> tuple[Array, Array]:
    """The times in s at which an output switches: of the FMU with a step, and of the imported part."""
    with _opened(case, folder, step) as (made, numbers):
        number, values = numbers[case.switching], []
        times = np.arange(0, case.until, step)
        for t in times:
            values.append(made.getReal([number])[0])
            made.doStep(t, step)
    run = _ours(case, folder)
    switches = run[f"{case.part}.{case.switching}"]
    own = run.time[1:][np.diff(switches) != 0]
    return times[1:][np.diff(values) != 0], own[own < case.until]  # the FMU is not asked at the end


# -- the FMU ---------------------------------------------------------------------------------------------------------
def theirs(case: Case, folder: Path, step: float) -> Array:
    """The outputs (n_out, n) of the FMU with a step in s, in the middle of the intervals."""
    with _opened(case, folder, step) as (made, numbers):
        found = []
        for t in np.arange(0, case.until, HOLD):
            for name, course in case.inputs.items():
                made.setReal([numbers[name]], [float(course(np.array(t)))])
            made.doStep(t, HOLD / 2)
            found.append(made.getReal([numbers[name] for name in case.outputs]))
            made.doStep(t + HOLD / 2, HOLD / 2)
        return np.array(found).T


@contextmanager
def _opened(case: Case, folder: Path, step: float) -> Iterator[tuple[Any, dict[str, int]]]:
    """The FMU with a step after its initialisation, and the value references by name."""
    import fmpy
    from fmpy.fmi2 import FMU2Slave

    unpacked = Path(fmpy.extract(str(folder / f"{case.fmu}.fmu")))
    told = fmpy.read_model_description(str(unpacked))
    identifier = told.coSimulation.modelIdentifier
    _compile(case, unpacked, identifier, step)
    made = FMU2Slave(guid=told.guid, unzipDirectory=str(unpacked), modelIdentifier=identifier, instanceName="m")
    made.instantiate()
    try:
        made.setupExperiment(startTime=0.0)
        made.enterInitializationMode()
        made.exitInitializationMode()
        yield made, {v.name: v.valueReference for v in told.modelVariables}
    finally:
        made.freeInstance()
        shutil.rmtree(unpacked, ignore_errors=True)


def _compile(case: Case, unpacked: Path, identifier: str, step: float) -> None:
    sources = unpacked / "sources"
    changed = 0
    for path in sources.glob("*.c"):
        text = path.read_text(encoding="latin-1")
        text, found = re.subn(r"(XXDouble xx_step_size|model_instance->step_size) = [0-9.e-]+;", rf"\1 = {step!r};", text)
        changed += found
        for old, new in case.edits.items():
            text = text.replace(old, new)
        path.write_text(text.replace("xx_finish_time = ", "xx_finish_time = 1e9 + "), encoding="latin-1")
    if changed != 1:
        raise SystemExit(f"{case.fmu}: the step stands in {changed} places of the sources")
    binary = unpacked / "binaries" / "linux64" / f"{identifier}.so"
    files = map(str, sources.glob("*.c"))
    subprocess.run(["gcc", "-O2", "-w", "-DNO_FUNCTION_PREFIX", "-shared", "-fPIC", "-o", str(binary), *files, "-lm"],
                   check=True)


# -- the imported model ----------------------------------------------------------------------------------------------
def ours(case: Case, folder: Path) -> Array:
    """The same outputs of the imported part, in the middle of the intervals."""
    run = _ours(case, folder)
    rows = np.searchsorted(run.time, np.arange(HOLD / 2, case.until, HOLD) - 1e-9)
    return np.array([run[f"{case.part}.{output}"][rows] for output in case.outputs])


def _ours(case: Case, folder: Path) -> hb.Result:
    """The run of the imported part, driven alone."""
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        made = import_emx(folder / f"{case.emx}.emx", frozenset(library().names()))
        made.write(work)
        diagram = _part(made.files[f"{made.name}.yaml"], case, work)
        model = hb.loads(diagram, work).with_parameters({f"{case.part}.{k}": v for k, v in case.values.items()})
        return hb.simulate(model, rtol=1e-9)


def _part(text: str, case: Case, work: Path) -> str:
    """The diagram with one part only, whose inputs come from a file."""
    t = np.arange(0, case.until + 2 * HOLD, HOLD)
    names = list(case.inputs)
    np.savetxt(work / "in.csv", np.column_stack([t, *(course(t) for course in case.inputs.values())]), delimiter=",",
               header=",".join(["t", *names]), comments="", fmt="%.17g")
    driven = [f"  drive_{n}: {{is: Gain, k: 1, u: {{file: in.csv, column: {n}, unit: '1', interpolation: hold}}}}"
              for n in names]
    kept, section = [], ""
    for line in text.splitlines():
        section = line.partition(":")[0] if line[:1].strip() else section
        if section == "components" and re.match(rf"  {case.part}: ", line):
            kept += ["components:", line, *driven]
        elif section in ("model", "parameters") or (
                section in ("set", "initial") and (line.startswith(f"  {case.part}.") or not line.startswith(" "))):
            kept.append(line)
    kept = [line for line, after in zip(kept, [*kept[1:], "end"], strict=True)
            if line.startswith(" ") or after.startswith(" ") or not line.endswith(":")]
    if names:
        kept += ["nodes:", *(f"  drive_{n}: [drive_{n}.y, {case.part}.{n}]" for n in names)]
    kept.append("show: {" + ", ".join(f"{o}: {{is: {case.part}.{o}, unit: '1'}}" for o in case.outputs) + "}")
    kept.append(f"simulate: {{until: {case.until:g} s, every: {HOLD / 2!r} s}}")
    return "\n".join(kept).replace("'1'", '"1"') + "\n"


def main() -> None:
    """As the command line calls it."""
    folder = Path(sys.argv[1])
    wanted = sys.argv[2:]
    print(f"{'FMU':<22} {'output':<22} {'range':>10}   error over the range at a step of 1/128 s over {SHORTER}")
    for case in CASES:
        if (wanted and case.fmu not in wanted) or not (folder / f"{case.fmu}.fmu").is_file():
            continue
        known = ours(case, folder)
        found = [theirs(case, folder, HOLD / 2 / k) for k in SHORTER]
        for row, output in enumerate(case.outputs):
            size = np.ptp(found[-1][row])
            errors = [np.abs(f[row] - known[row]).max() / size for f in found]
            print(f"{case.fmu:<22} {output:<22} {size:>10.4g}   {' '.join(f'{e:9.2e}' for e in errors)}", flush=True)
        if case.switching:
            pairs = [instants(case, folder, HOLD / 2 / k) for k in SHORTER]
            apart = [np.abs(a - b).max() if len(a) == len(b) else np.nan for a, b in pairs]
            print(f"{case.fmu:<22} {case.switching + ' switches':<22} {len(pairs[0][1]):>9}x   "
                  f"{' '.join(f'{e:9.2e}' for e in apart)} s", flush=True)


if __name__ == "__main__":
    main()
