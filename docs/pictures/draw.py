"""Draws the pictures of the documentation with the program itself: `python docs/pictures/draw.py [FOLDER]`."""

from __future__ import annotations

import sys
from pathlib import Path

import heavebond as hb
from heavebond import plot


def weight_on_bit(folder: Path) -> Path:
    """The published wave (0.5 m, 12 s), passive beside active, both with seal friction."""
    runs = {"passive": hb.simulate(hb.load("cmc_ahc/passive")), "active": hb.simulate(hb.load("cmc_ahc"))}
    title = "Crown-mounted compensator, heave 0.5 m at 12 s"
    figure = plot.plot_runs(runs, ["WOB", "crown"], title=title, shaded=(72.0, 96.0))
    return plot.save(figure, folder / "passive_active.png")


def friction(folder: Path) -> Path:
    """The passive rig without friction beside its records."""
    return plot.save(plot.plot_comparison(hb.compare("passive_rig/friction")), folder / "friction.png")


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    for path in (weight_on_bit(target), friction(target)):
        print(f"wrote {path}")
