"""The three rigs of the study: base experiment, excitations, and where its parts stand."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import heavebond as hb
from heavebond.estimation.experiment import Experiment
from heavebond.numerics.dae import Array

HERE = Path(__file__).parent
Signal = Callable[[Array], Array]
TRAIN, VALIDATE = 0, 1


@dataclass(frozen=True)
class Rig:
    """`experiment` is the bundled base; records of `seconds` at `rate` Hz, driven by `excitation(generator, use)` through
    `input`. `between` tells the nodes between which a part stands, so that places can be compared."""

    name: str
    experiment: Path
    seconds: float
    rate: float
    input: str
    excitation: Callable[[np.random.Generator, int], Signal]
    between: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def base(self) -> Experiment:
        """The bundled experiment: base diagram, channels with their noise, what is free."""
        return hb.load_experiment(self.experiment)

    @property
    def truth(self) -> hb.Model:
        """The same diagram, beside which components of other formulations are found."""
        return hb.load(HERE / f"{self.name}_truth.yaml")

    @property
    def time(self) -> Array:
        """Instants of the samples."""
        return np.arange(round(self.seconds * self.rate) + 1) / self.rate

    def place(self, where: tuple[str, ...]) -> frozenset[str]:
        """Nodes for parts: `gas` is between platform and crown."""
        return frozenset(node for name in where for node in self.between.get(name, (name,)))


def sea(generator: np.random.Generator, use: int) -> Signal:
    """Heave (m): 14 sines around a peak period, zero with its slope at the beginning."""
    period, size = ((11.0, 0.55), (8.5, 0.4))[use]
    ratios = np.linspace(0.65, 2.2, 14) + generator.uniform(-0.04, 0.04, 14)
    weights = np.exp(-0.5 * ((ratios - 1) / 0.3) ** 2) + 0.12
    amplitudes = size * np.sqrt(2) * weights / np.linalg.norm(weights)
    phases = generator.uniform(0, 2 * np.pi, 14)

    def heave(t: Array) -> Array:
        waves = np.sin(np.multiply.outer(t, 2 * np.pi * ratios / period) + phases) @ amplitudes
        return np.asarray(waves * (1 - np.exp(-((t / 4) ** 3))))

    return heave


def steps(generator: np.random.Generator, levels: Callable[[int], Array], hold: tuple[float, float], rise: float) -> Signal:
    """Levels that are held for a while, with smooth transitions of `rise` seconds between them."""
    moments = np.cumsum(generator.uniform(*hold, 60))
    values = levels(61)

    def signal(t: Array) -> Array:
        share = np.clip((t[:, None] - moments) / rise, 0, 1)
        return np.asarray(values[0] + (share**2 * (3 - 2 * share)) @ np.diff(values))

    return signal


def command(generator: np.random.Generator, use: int) -> Signal:
    """Spool command (-1..1): smooth steps of both signs and two sines."""
    size = (0.3, 0.22)[use]
    step = steps(generator, lambda n: size * generator.uniform(-1, 1, n), ((1.0, 3.0), (0.7, 2.2))[use], 0.25)
    rates, phases = 2 * np.pi * generator.uniform(0.15, 1.3, 2), generator.uniform(0, 2 * np.pi, 2)
    return lambda t: step(t) + 0.25 * size * (np.sin(rates[0] * t + phases[0]) + np.sin(rates[1] * t + phases[1]))


def opening(generator: np.random.Generator, use: int) -> Signal:
    """Opening (0..1): smooth steps, now and then shut."""
    low, shut = ((0.4, 0.4), (0.25, 0.3))[use]
    return steps(generator, lambda n: np.where(generator.random(n) < shut, 0.0, generator.uniform(low, 1.0, n)),
                 ((6.0, 18.0), (4.0, 14.0))[use], 0.5)


MODELS = HERE.parents[1] / "models"
RIGS = {rig.name: rig for rig in (
    Rig("receiver", MODELS / "receiver_rig" / "choked.yaml", 120.0, 10.0, "inlet.u", opening,
        {"inlet": ("supply", "receiver"), "outlet": ("receiver", "air")}),
    Rig("passive", MODELS / "passive_rig" / "friction.yaml", 40.0, 25.0, "vessel.u", sea,
        {"gas": ("platform", "crown"), "damper": ("platform", "crown"), "string": ("seabed", "crown"),
         "vessel": ("platform",)}),
    Rig("cylinder", MODELS / "cylinder_rig" / "leakage.yaml", 30.0, 50.0, "valve.u", command,
        {"cylinder": ("chamber_a", "chamber_b"), "load_spring": ("wall", "load"), "load_damper": ("wall", "load"),
         "pump": ("supply",), "frame": ("wall",)}))}
