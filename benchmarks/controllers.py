"""PID and LQG controllers of the compensator beside tuned gains, at three valves: `python -m benchmarks.controllers`.

Gains and matrices are designed on the linearised machine with sliding seals (without friction); the runs contain the
friction. Printed are the deviation and the largest variation of the weight on bit from 24 to 36 s, one period of the
published wave, and the margins of the designed loops.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import heavebond as hb

SLIDING = {"cmc.friction.F_c": "0 N", "cmc.friction.F_s": "0 N", "cmc.friction.k_p": "0 m**2"}
TUNED = {"0.75 Hz": (3.02, 0.55), "5 Hz": (1.77, 0.528), "20 Hz": (0.96, 0.529)}  # K_p in 1/m, K_v in s/m
LQG = "model: designed\nextends: cmc_ahc/lqg_control\nset: {{controller.n: {n}, controller.A: {a}, controller.B: {b}, " \
    "controller.C: {c}}}\n"


def variation(model: hb.Model) -> str:
    """The deviation and the largest variation of the weight on bit in kN."""
    run = hb.simulate(model, "36 s", every="20 ms")
    wob = run.display["WOB"][run.time >= 24]
    return f"WOB deviation {np.sqrt(np.mean((wob - wob.mean())**2)):.2f} kN, largest {np.abs(wob - 30).max():.2f} kN"


def margins(model: hb.Model) -> str:
    """The margins of the loop through the command, while the seals slide."""
    found = hb.loop_crossings(model.with_parameters(dict(SLIDING)), "drive.y")
    phase, gain = found.least_phase, found.gain_up
    return f"{found.verdict}, phase margin {'none' if phase is None else f'{phase.value:.1f} deg'}, gain margin " \
        f"{'none' if gain is None else f'{gain.value:.2f}'}"


def rows(matrix: NDArray[np.float64], unit: str = "") -> str:
    """A matrix in the language."""
    return "[" + ", ".join("[" + ", ".join(f"{value!r}{unit}" for value in row) + "]" for row in matrix.tolist()) + "]"


def main() -> None:
    """Design and run the controllers for each valve, and print the figures."""
    for valve, (k_p, k_v) in TUNED.items():
        at_valve = {"ahc.valve.f_n": valve}
        tuned = hb.load("cmc_ahc").with_parameters({**at_valve, "controller.K_p": k_p, "controller.K_v": k_v})
        print(f"{valve}, tuned: {variation(tuned)}", flush=True)
        pid = hb.load("cmc_ahc/pid_control").with_parameters(dict(at_valve))
        gains = hb.design_gains(pid.with_parameters(dict(SLIDING)), "drive.y", ["controller.K_p", "controller.K_i"],
                                crossover="0.25 Hz", phase_margin="45 deg").values
        pid = pid.with_parameters(dict(gains))
        text = ", ".join(f"{name.rpartition('.')[2]} {value:.3f}" for name, value in gains.items())
        print(f"{valve}, PID with {text}: {variation(pid)}; {margins(pid)}", flush=True)
        plant = hb.load("cmc_ahc/lqg_control").with_parameters({**at_valve, **SLIDING})
        design = hb.design_lqg(plant, "controller", {"crown.x": "10 mm"}, [0.1], {"drive.y": 0.3}, [1e-6])
        lqg = hb.loads(LQG.format(n=len(design.a), a=rows(design.a, " 1/s"), b=rows(design.b, " 1/s"), c=rows(design.c)))
        lqg = lqg.with_parameters(dict(at_valve))
        print(f"{valve}, LQG with {len(design.a)} states: {variation(lqg)}; {margins(lqg)}", flush=True)


if __name__ == "__main__":
    main()
