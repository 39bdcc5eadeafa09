"""Sampled loops: runs with many samples against runs of their plants with as many restarts of the integrator."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import heavebond as hb
from benchmarks.measuring import Figure, at_most, duration, paired

DIAGRAM = Path(__file__).parent / "sampled_loop.yaml"
LIMIT, GOAL = 2.0, 0.5  # of the ratio, and s of processor time of 8000 samples
SENSITIVE = ("K",)
AGREE = 1e-6  # of the largest value: the plant has the tolerances of one run, its record those of the other


@dataclass(frozen=True)
class Loop:
    """The loop, and its plant with the record of the held command as a measured input that jumps."""

    loop: hb.Assembly
    plant: hb.Assembly

    def check(self) -> None:
        """AssertionError unless both runs agree."""
        loop, plant = hb.simulate(self.loop)["c.y"], hb.simulate(self.plant)["c.y"]
        assert np.abs(loop - plant).max() < AGREE * np.abs(loop).max()


def prepared(folder: Path, until: str = "8 s") -> Loop:
    """Both sides; the record of the plant is written to a folder."""
    text = DIAGRAM.read_text(encoding="utf-8").replace("until: 8 s", f"until: {until}")
    (folder / "loop.yaml").write_text(text, encoding="utf-8")
    run = hb.simulate(folder / "loop.yaml", every="1 ms")
    rows = [f"{t:.17g},{u:.17g}" for t, u in zip(run.time, run["control.y"], strict=True)]
    (folder / "command.csv").write_text("\n".join(["time_s,u", *rows]) + "\n", encoding="utf-8")
    plant = [line for line in text.splitlines() if "control:" not in line and "target:" not in line]
    plant = [line.replace("=control.y", '{file: command.csv, column: u, unit: "1", interpolation: hold}') for line in plant]
    (folder / "plant.yaml").write_text("\n".join(plant) + "\n", encoding="utf-8")
    return Loop(hb.assemble(folder / "loop.yaml"), hb.assemble(folder / "plant.yaml"))


def figures() -> list[Figure]:
    """The ratio of both runs, and the time of the loop."""
    with tempfile.TemporaryDirectory() as name:
        sides = prepared(Path(name))
        sides.check()
        plain = paired(lambda: hb.simulate(sides.loop), lambda: hb.simulate(sides.plant))
        moved = paired(lambda: hb.simulate(sides.loop, sensitivities=SENSITIVE), lambda: hb.simulate(sides.plant))
    return [at_most("sampled loop, 8000 samples: run / plant with as many restarts", plain, LIMIT),
            Figure("sampled loop, 8000 samples: run", duration(plain.ours), f"≤ {GOAL:g} s", plain.ours <= GOAL),
            at_most("sampled loop, 8000 samples: run with sensitivities to 1 parameter / plant without", moved, LIMIT)]
