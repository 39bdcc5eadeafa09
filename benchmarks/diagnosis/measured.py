"""Diagnoses of measured machines from public records, with the whole catalogue, beside the figures that others published.

    python -m benchmarks.diagnosis.measured FOLDER                 sets that are not on disk yet
    python -m benchmarks.diagnosis.measured FOLDER silverbox       this one again

FOLDER holds the records as text, in one folder for each set; where they come from stands in `SETS`. They are not bundled.
Each diagram is what an engineer would begin with, without the effects that the literature knows. `--seconds` is the budget
of each diagnosis. An error is the root mean square on records that were not fitted, in the unit of the channel.
"""

from __future__ import annotations

import argparse
import tempfile
import time as clock
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import heavebond as hb
from benchmarks.diagnosis import keeping
from heavebond.core.errors import HeavebondError
from heavebond.diagnosis.diagnose import Diagnosis
from heavebond.estimation.experiment import Experiment

STUDY = "measured"
SECONDS = 600.0


@dataclass(frozen=True)
class Measured:
    """A set of records: its source, what is known to be missing, published errors of physical models (`grey`) and of black
    boxes (`black`), and the experiment: a bundled one (`name`), or the text of a diagram and of an experiment (`model`,
    `text`) that lies beside the records. A published figure is *verified* where it was read in its source."""

    source: str
    known: str
    grey: str
    black: str
    name: str = ""
    model: str = ""
    text: str = ""


SILVERBOX = Measured(
    "T. Wigren, J. Schoukens, Three free data sets for development and benchmarking in nonlinear system identification, "
    "European Control Conference, 2013",
    "cubic stiffness (the circuit is a Duffing oscillator; volts are read as metres, 1 mm is 1 mV)",
    "arrow: 0.96 mV (Hjalmarsson, Schoukens 2004, not verified)",
    "arrow: recurrent networks 2.4 to 4.9 mV, without extrapolation 0.95 to 1.7 mV (Champneys et al. 2024, "
    "arXiv:2405.10779, verified); 0.26 mV (PNLSS, not verified)",
    model="""
model: silverbox
components:
  drive:  {is: ForceSource, u: 0 N}
  mass:   {is: Mass, m: 5.2e-6 kg}
  spring: {is: Spring, c: 0.95 N/m}
  damper: {is: Damper, d: 2.2e-4 N*s/m}
  ground: {is: Fixed}
nodes:
  y: [drive.a, mass.a, spring.b, damper.b]
  ground: [ground.a, spring.a, damper.a]
initial: {y.x: 0 m, y.v: 0 m/s}
""", text="""
experiment: Silverbox, volts read as newtons and metres
model: silverbox.yaml
records:
  multisine: {file: silverbox/silverbox_snls80mv.csv, use: fit, from: 66.42 s, to: 80.6 s}
  another:   {file: silverbox/silverbox_snls80mv.csv, use: validate, from: 80.66 s, to: 94.8 s}
  arrow:     {file: silverbox/silverbox_snls80mv.csv, use: test, from: 0.05 s, to: 65.5 s}
time: {column: time_s, unit: s}
inputs: {drive.u: {column: u_V, unit: N, interpolation: spline}}
outputs: {y.x: {column: y_V, unit: m}}
free: {mass.m: 5.2e-6 kg +- 20 %, spring.c: 0.95 N/m +- 20 %, damper.d: 2.2e-4 N*s/m +- 50 %}
""")
DAMPER = Measured(
    "A. N. Vargas, Labcontrol UTFPR, doi:10.5281/zenodo.4445334",
    "dry friction with presliding (the authors use the laws of Dahl and of Bouc and Wen), a weak spring",
    "15 to 37 % of the force (by the authors, definition not given, verified)", "none",
    model="""
model: mr_damper
components:
  table:  {is: PositionSource, u: 0 m}
  cell:   {is: ForceSensor}
  oil:    {is: Damper, d: 800 N*s/m}
  gas:    {is: Preload, F: 130 N}
  ground: {is: Fixed}
nodes:
  table: [table.a, cell.a]
  rod: [cell.b, oil.b, gas.b]
  ground: [ground.a, oil.a, gas.a]
""", text="""
experiment: magneto-rheological damper without current on a shaking table
model: mr_damper.yaml
records:
  one:   {file: mr_damper/mr_off_0V_01.csv, use: fit}
  four:  {file: mr_damper/mr_off_0V_04.csv, use: validate}
  eight: {file: mr_damper/mr_off_0V_08.csv, use: test}
time: {column: time_s, unit: s}
inputs: {table.u: {column: disp_m, unit: m, interpolation: spline}}
outputs: {cell: {is: -cell.y, column: force_N, unit: N}}
free: {oil.d: 100 .. 6000 N*s/m, gas.F: -400 .. 400 N}
""")
DRIVES = Measured(
    "T. Wigren, M. Schoukens, Coupled electric drives data set and reference models, Uppsala University, 2017-024",
    "a speed sensor without sign; by the three amplitudes, dry friction or a dead band of the drives (not by the authors)",
    "none", "none for these records (PRBS); 0.09 to 0.33 for the records DATAUNIF (Champneys et al. 2024, verified)",
    model="""
model: coupled_drives
components:
  motors: {is: TorqueSource, u: 0 N*m}
  rotor:  {is: Inertia, J: 0.08 kg*m**2}
  loss:   {is: RotationalDamper, d: 0.55 N*m*s/rad}
  belt:   {is: TorsionSpringDamper, c: 2.1 N*m/rad, d: 0.065 N*m*s/rad}
  pulley: {is: Inertia, J: 0.005 kg*m**2}
  frame:  {is: FixedShaft}
nodes:
  rotor: [motors.a, rotor.a, loss.b, belt.a]
  pulley: [belt.b, pulley.a]
  frame: [frame.a, loss.a]
initial: {rotor.phi: 0 rad, rotor.w: 0 rad/s, pulley.phi: 0 rad, pulley.w: 0 rad/s}
""", text="""
experiment: coupled electric drives, volts read as newton metres and ticks as radians per second
model: coupled_drives.yaml
records:
  medium: {file: coupled_electric_drives/prbs_u1_amp1V.csv, use: fit}
  large:  {file: coupled_electric_drives/prbs_u2_amp1.5V.csv, use: validate}
  small:  {file: coupled_electric_drives/prbs_u3_amp0.5V.csv, use: test}
time: {column: time_s, unit: s}
inputs: {motors.u: {column: u_V, unit: N*m, interpolation: hold}}
outputs: {pulley.w: {column: z_speed_ticks_unsigned, unit: rad/s}}
free:
  rotor.J: 0.02 .. 0.3 kg*m**2
  loss.d: 0.15 .. 2 N*m*s/rad
  belt.c: 0.7 .. 6 N*m/rad
  belt.d: 0.01 .. 0.4 N*m*s/rad
""")
PENDULUM = Measured(
    "DFKI underactuated lab, torque-limited simple pendulum, doi:10.21105/joss.03884",
    "dry and viscous friction of the joint (by the authors); a torque that reads about a fifth too low (not by the authors)",
    "none", "none",
    model="""
model: pendulum
components:
  motor:  {is: TorqueSource, u: 0 N*m}
  arm:    {is: Inertia, J: 0.1495 kg*m**2}
  weight: {is: ArmWeight, m: 0.676 kg, l: 0.45 m}
  frame:  {is: FixedShaft}
  cable:  {is: RotationalDamper, d: 0.01 N*m*s/rad}
nodes:
  shaft: [motor.a, arm.a, weight.a, cable.b]
  frame: [frame.a, cable.a]
initial: {shaft.phi: 0 rad, shaft.w: 0 rad/s}
""", text="""
experiment: swing-up of a pendulum by a motor, recorded in closed loop
model: pendulum.yaml
# up to the last rise: at the top a simulation with the measured torque is unstable
records:
  ddp:    {file: dfki_simple_pendulum/ddp_swingup.csv, use: fit, to: 5.4 s}
  dircol: {file: dfki_simple_pendulum/dircol_swingup.csv, use: test, to: 3 s}
time: {column: time_s, unit: s}
inputs: {motor.u: {column: tau_measured_Nm, unit: N*m, interpolation: linear}}
outputs: {shaft.phi: {column: q_rad, unit: rad}}
free: {arm.J: 0.1495 kg*m**2 +- 10 %, weight.m: 0.676 kg +- 10 %, cable.d: 0 .. 0.2 N*m*s/rad}
""")
SETS: Mapping[str, Measured] = {
    "mr_damper": DAMPER,
    "coupled_electric_drives": DRIVES,
    "cascaded_tanks": Measured(
        "M. Schoukens, P. Mattsson, T. Wigren, J.-P. Noel, Cascaded tanks benchmark, doi:10.4121/12960104",
        "square-root outlets, overflow of both tanks",
        "about 0.2 V (with overflow, Rogers et al. 2017, not verified)",
        "0.40 to 2.0 V (Champneys et al. 2024, verified); PNLSS 0.45 V, Volterra series 0.54 V (as quoted in "
        "doi:10.1155/2021/6613425, verified there)",
        name="cascaded_tanks/tanks"),
    "silverbox": SILVERBOX,
    "dfki_simple_pendulum": PENDULUM,
    "emps": Measured(
        "A. Janot, M. Gautier, M. Brunot, Data set and reference models of EMPS, Eindhoven, 2019",
        "dry friction, a constant force, friction that differs by direction",
        "8.94 % of the force on the pulses (closed loop, parameters of the authors, verified)",
        "none of the force; position 74 to 220 mm (Champneys et al. 2024, verified), 2.6 to 4 mm (Forgione, Piga 2021, not "
        "verified)",
        name="emps/drive"),
}


def experiment(name: str, given: Measured, records: Path, folder: Path) -> Experiment:
    """The experiment of a set, with its records in the folder `records`."""
    if given.text:
        for file, text in ((f"{name}.yaml", given.model), ("measured.yaml", given.text)):
            (folder / file).write_text(text, encoding="utf-8")
        model = given.text.partition("model: ")[2].partition(".yaml")[0]
        (folder / f"{name}.yaml").rename(folder / f"{model}.yaml")
        (folder / name).symlink_to((records / name).resolve())
        return hb.load_experiment(folder / "measured.yaml")
    found = hb.load_experiment(given.name)
    moved = {n: replace(r, file=records / name / r.file.name) for n, r in found.records.items()}
    return replace(found, records=moved)


def row(name: str, found: Diagnosis, processor: float, classes: list[str]) -> dict[str, object]:
    """The result of a set, diagnosed with the effects of these `classes` (empty: all)."""
    errors = [{record: {c.name: [c.error, c.unit, c.relative] for c in part.channels.values()}
               for record, part in rung.comparison.records.items()} for rung in found.ladder]
    return {"key": name, "verdict": found.verdict, "words": found.words, "processor": processor, "classes": classes,
            "partial": any(s.partial for s in found.steps),
            "effects": [[f.candidate.label, f.candidate.kind, len(f.alternatives)] for f in found.findings],
            "shape": found.shape and found.shape.candidate.label, "errors": errors,
            "uses": {n: r.use for n, r in found.experiment.records.items()},
            "ladder": [[r.name, r.chi2_fit, r.chi2_held_out] for r in found.ladder]}


def main() -> None:
    """The sets named, or all that are not on disk."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("sets", nargs="*", choices=[*SETS, []], help="those to be diagnosed again")
    parser.add_argument("--seconds", type=float, default=SECONDS)
    parser.add_argument("--samples", type=int, help="of long records, for the search")
    parser.add_argument("--only", action="append", default=[], metavar="CLASS", help="effects of this class")
    given = parser.parse_args()
    done = keeping.read(STUDY)
    for name in given.sets or [n for n in SETS if n not in done]:
        began = clock.process_time()
        with tempfile.TemporaryDirectory() as folder:
            try:
                found = hb.diagnose(experiment(name, SETS[name], given.folder, Path(folder)), number=1,
                                    seconds=given.seconds, samples=given.samples, classes=given.only)
            except HeavebondError as error:
                print(f"{name}: {error}")
                continue
            result = row(name, found, clock.process_time() - began, given.only)
        keeping.add(STUDY, result)
        print(f"{name}: {found.verdict}, {result['processor']:.0f} s\n  " + "\n  ".join(found.words), flush=True)


if __name__ == "__main__":
    main()
