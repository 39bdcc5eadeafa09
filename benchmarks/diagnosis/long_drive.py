"""A drive with friction that its model lacks: two records of 126 000 samples at 1 kHz, made by simulation."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import heavebond as hb

SAMPLES, RATE = 126_000, 1000.0
NOISE = {"motor.i": ("A", 0.02), "rotor.w": ("rad/s", 0.3)}
DRIVE = """model: drive
components:
  supply:  {is: VoltageSource, u: VOLTAGE}
  ground:  {is: ElectricalGround}
  motor:   {is: DCMotor, R: 1.2 ohm, L: 2 mH, k: 0.08 N*m/A, J: 2e-4 kg*m**2, d: 2e-5 N*m*s/rad, M_c: 0 N*m}
  shaft:   {is: TorsionSpring, c: 300 N*m/rad}
  load:    {is: Inertia, J: 8e-4 kg*m**2}
  bearing: {is: RotationalDamper, d: 1e-4 N*m*s/rad}
  frame:   {is: FixedShaft}
nodes:
  plus:  [supply.a, motor.a]
  zero:  [supply.b, motor.b, ground.a]
  rotor: [motor.s, shaft.a]
  table: [shaft.b, load.a, bearing.a]
  still: [frame.a, bearing.b]
initial: {table.w: 0 rad/s, table.phi: 0 rad, rotor.phi: 0 rad, rotor.w: 0 rad/s, motor.i: 0 A}
"""
FRICTION = """  friction: {is: RotationalStribeckFriction, M_c: 0.03 N*m, M_s: 0.045 N*m, w_s: 2 rad/s}
nodes:
"""
EXPERIMENT = """experiment: drive
model: drive.yaml
records: {one: {file: one.csv, use: fit}, two: {file: two.csv, use: validate}}
time: {column: t, unit: s}
inputs: {supply.u: {column: u, unit: V, interpolation: linear}}
outputs:
  motor.i: {column: i, unit: A, noise: 20 mA}
  rotor.w: {column: w, unit: rad/s, noise: 0.3 rad/s}
free: {motor.R: 1.2 ohm +- 10 %, load.J: 8e-4 kg*m**2 +- 20 %, bearing.d: 2e-5 .. 1e-3 N*m*s/rad}
"""


def write_drive(folder: Path) -> Path:
    """Write the diagram, both records and the experiment; the path of the experiment."""
    folder.mkdir()
    truth = DRIVE.replace("nodes:\n", FRICTION).replace("bearing.a]", "bearing.a, friction.a]") \
        .replace("bearing.b]", "bearing.b, friction.b]")
    time = np.arange(SAMPLES) / RATE
    for seed, name in enumerate(("one", "two"), 1):
        generator = np.random.default_rng(seed)
        rates, phases = generator.uniform(0.05, 3, 12), generator.uniform(0, 2 * np.pi, 12)
        voltage = 10 / np.sqrt(12) * np.sin(2 * np.pi * np.outer(time, rates) + phases).sum(axis=1) * (1 - np.exp(-time / 2))
        file = folder / f"{name}.csv"
        np.savetxt(file, np.column_stack([time, voltage]), fmt="%.9g", delimiter=",", header="t,u", comments="")
        (folder / "truth.yaml").write_text(truth.replace(
            "VOLTAGE", f"{{file: {file.name}, column: u, unit: V, interpolation: linear}}"))
        run = hb.simulate(hb.load(folder / "truth.yaml"), until=float(time[-1]), every=1 / RATE)
        channels = [run[channel] + noise * generator.standard_normal(SAMPLES) for channel, (_, noise) in NOISE.items()]
        np.savetxt(file, np.column_stack([time, voltage, *channels]), fmt="%.9g", delimiter=",", header="t,u,i,w",
                   comments="")
    (folder / "drive.yaml").write_text(DRIVE.replace("VOLTAGE", "0 V"))
    (folder / "drive_experiment.yaml").write_text(EXPERIMENT)
    return folder / "drive_experiment.yaml"
