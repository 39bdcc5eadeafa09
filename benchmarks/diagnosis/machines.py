"""The machines of the calibration study: bundled diagrams of all domains, each with an input that is recorded, its channels
and what the data sheet leaves open. Records are short, so that a case costs seconds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.diagnosis.rigs import MODELS, Signal, steps
from heavebond.numerics.dae import Array

NOISE = 0.01  # of a channel, as a share of its standard deviation under the input


@dataclass(frozen=True)
class Machine:
    """`model` is a bundled diagram whose `input` (in `unit`) moves between `low` and `high` in records of `samples` at
    `rate` Hz, by smooth `steps` or by sines that begin at rest; `outputs` are the formulas of the channels with their units,
    `free` parameters with their tolerances in percent."""

    name: str
    model: Path
    input: str
    unit: str
    low: float
    high: float
    samples: int
    rate: float
    outputs: Mapping[str, str]
    free: Mapping[str, float]
    steps: bool = False

    @property
    def time(self) -> Array:
        """Instants of the samples (s)."""
        return np.arange(self.samples) / self.rate

    def excitation(self, rng: np.random.Generator) -> Signal:
        """An input drawn at random, in its unit."""
        length = self.samples / self.rate
        scale = rng.uniform(0.6, 1.0)
        if self.steps:
            size = (self.high - self.low) * scale
            low = self.low + rng.uniform(0, 1) * (self.high - self.low - size)
            return steps(rng, lambda n: low + size * rng.random(n), (0.04 * length, 0.15 * length), 0.01 * length)
        middle, half = (self.low + self.high) / 2, scale * (self.high - self.low) / 2
        rates = 2 * np.pi * np.exp(rng.uniform(np.log(2), np.log(18), 6)) / length
        sizes, phases = rng.uniform(0.3, 1, 6), rng.uniform(0, 2 * np.pi, 6)
        sizes *= half / sizes.sum() * 1.4

        def signal(t: Array) -> Array:
            waves = np.sin(np.multiply.outer(t, rates) + phases) @ sizes
            return np.asarray(middle + np.clip(waves, -half, half) * (1 - np.exp(-((t / (0.05 * length)) ** 3))))

        return signal

    def experiment(self, records: Mapping[str, str], noise: Mapping[str, float], of_input: float = 0.0) -> str:
        """The text of the experiment on records with their uses; `noise` of the channels, and `of_input`, as far as it is
        given, in their units."""
        known = f", noise: {of_input:.6g} {self.unit}" if of_input else ""
        lines = [f"experiment: {self.name}", f"model: {self.model}", "records:"]
        lines += [f"  {name}: {{file: {name}.csv, use: {use}}}" for name, use in records.items()]
        lines += ["time: {column: time, unit: s}", "inputs:",
                  f"  {self.input}: {{column: input, unit: {self.unit}, interpolation: spline{known}}}", "outputs:"]
        for k, (formula, unit) in enumerate(self.outputs.items()):
            given = f", noise: {noise[formula]:.6g} {unit}" if formula in noise else ""
            lines.append(f"  channel_{k}: {{is: {formula}, column: channel_{k}, unit: {unit}{given}}}")
        return "\n".join(lines) + "\n"


def _at(*parts: str) -> Path:
    return MODELS.joinpath(*parts).resolve()


MACHINES = {m.name: m for m in (
    Machine("receiver", _at("receiver_rig", "receiver_rig.yaml"), "inlet.u", "1", 0.15, 1.0, 240, 3.0,
            {"receiver.p": "Pa"}, {"inlet.C": 15, "outlet.C": 15}, steps=True),
    Machine("heave rig", _at("passive_rig", "passive_rig.yaml"), "vessel.u", "m", -1.0, 1.0, 300, 5.0,
            {"crown.x - platform.x": "m", "string.F": "N"},
            {"gas.c": 20, "damper.d": 20, "string.c": 5, "string.d": 20}),
    Machine("servo cylinder", _at("cylinder_rig", "cylinder_rig.yaml"), "valve.u", "1", -0.25, 0.25, 240, 20.0,
            {"load.x": "m", "chamber_a.p": "Pa"}, {"load_spring.c": 10, "load_damper.d": 10, "cylinder.beta": 25,
                                                   "valve.q_r": 5}),
    Machine("tanks", _at("cascaded_tanks", "cascaded_tanks.yaml"), "pump.u", "V", 1.0, 6.0, 250, 0.25,
            {"upper.h": "m", "lower.h": "m"}, {"outlet_1.C": 20, "outlet_2.C": 20, "pump.k": 10}, steps=True),
    Machine("car wheel", _at("quarter_car", "quarter_car.yaml"), "road.u", "m", -0.05, 0.05, 300, 50.0,
            {"body.x - wheel.x": "m", "body.x": "m"}, {"spring.c": 10, "damper.d": 20}),
    Machine("motor", _at("examples", "dc_motor.yaml"), "supply.u", "V", -24.0, 24.0, 240, 1500.0,
            {"shaft.w": "rad/s", "motor.i": "A"}, {"motor.R": 10, "motor.k": 5, "motor.J": 15}),
    Machine("winding", _at("examples", "thermal_resistance.yaml"), "loss.u", "W", 0.0, 80.0, 240, 0.02,
            {"winding.T": "K", "housing.T": "K"}, {"inner.R": 20, "outer.R": 20}, steps=True),
    Machine("swivel", _at("examples", "rotary_actuator.yaml"), "pump.u", "L/min", 1.0, 9.0, 240, 120.0,
            {"shaft.w": "rad/s", "A.p": "Pa"}, {"brake.d": 20, "part.beta": 20}),
    Machine("lift", _at("examples", "plunger_cylinder.yaml"), "pump.u", "L/min", 0.0, 3.0, 240, 60.0,
            {"line.p": "Pa", "load.v": "m/s"}, {"guide.d": 20, "part.beta": 20}),
    Machine("drive in closed loop", _at("emps", "emps.yaml"), "controller.q_ref", "m", -0.03, 0.03, 300, 30.0,
            {"motor.k*controller.u": "N"}, {"load.m": 10, "friction.d": 20}),
    Machine("oil block", _at("examples", "oil_volume.yaml"), "pump.u", "L/min", 3.0, 9.0, 240, 1.0,
            {"block.T": "K", "block.p": "Pa"}, {"outlet.q_r": 15, "block.V": 15}, steps=True),
    Machine("gas cushion", _at("examples", "pneumatic_chamber.yaml"), "piston.u", "m", -0.06, 0.06, 240, 120.0,
            {"gas.p": "Pa", "chamber.F": "N"}, {"chamber.V_0": 10}),
    Machine("coil", _at("examples", "inductor.yaml"), "supply.u", "V", -12.0, 12.0, 240, 60.0,
            {"coil.i": "A"}, {"wire.R": 10, "coil.L": 10}),
    Machine("gearbox", _at("examples", "gear.yaml"), "motor.u", "N*m", -10.0, 10.0, 240, 60.0,
            {"slow.w": "rad/s"}, {"wheel.J": 15}),
    Machine("block on a screw", _at("examples", "lead_screw.yaml"), "motor.u", "N*m", -1.0, 1.0, 240, 60.0,
            {"slide.v": "m/s"}, {"slide.m": 15}))}
