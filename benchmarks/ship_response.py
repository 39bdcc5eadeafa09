"""Response amplitude operators of a box-shaped drill ship by closed formulas: the tables of `cmc_ahc/drill_ship`.

    python -m benchmarks.ship_response          # the lines of the diagram

Heave and pitch: J. J. Jensen, A. E. Mansour, A. S. Olsen, Estimation of ship motions using closed-form expressions,
Ocean Engineering 31 (2004) 61-85, without forward speed. Roll: a linear oscillator driven by the slope of the wave at half
the draught. Phases are leads against the wave at the middle of the ship; the wave comes from astern at 0, from port at 90
and from ahead at 180 degrees.
"""

from __future__ import annotations

import numpy as np

LENGTH, BREADTH, DRAUGHT = 200.0, 36.0, 10.0     # m
ROLL_PERIOD, ROLL_DAMPING = 20.0, 0.08           # s; share of critical
OMEGA = np.array([0.05, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 1.0, 1.3])     # rad/s
HEADINGS = np.array([0, 45, 90, 135, 180])       # degrees
GRAVITY = 9.81


def responses(omega: float, heading: float) -> tuple[complex, complex, complex]:
    """Heave (m), roll (rad, starboard down) and pitch (rad, bow down) per metre of wave amplitude; heading in rad."""
    k = omega**2 / GRAVITY
    k_e = abs(k * np.cos(heading))
    damping = 2 * np.sin(min(k * BREADTH / 2, np.pi / 2)) * np.exp(-k * DRAUGHT)
    loss = damping**2 / (k * BREADTH)
    half = k_e * LENGTH / 2
    force = np.exp(-k_e * DRAUGHT) * (1 - k * DRAUGHT + 1j * loss)     # of the water that moves relative to the ship
    heaving = np.sinc(half / np.pi)
    tilting = 3 * (np.sin(half) - half * np.cos(half)) / half**2 if half > 1e-3 else half
    oscillator = 1 / (1 - 2 * k * DRAUGHT + 1j * loss)
    heave = force * heaving * oscillator
    # the slope of the wave along the ship leads its height by 90 degrees where the wave comes from ahead
    pitch = -1j * np.sign(-np.cos(heading)) * force * 2 / LENGTH * tilting * oscillator
    ratio = omega * ROLL_PERIOD / (2 * np.pi)
    slope = 1j * k * np.sin(heading) * np.exp(-k * DRAUGHT / 2)
    return heave, slope / (1 - ratio**2 + 2j * ROLL_DAMPING * ratio), pitch


def tables() -> dict[str, np.ndarray]:
    """Amplitude and phase (rad) of each motion, (frequencies, headings)."""
    motions = np.array([[responses(w, np.radians(b)) for b in HEADINGS] for w in OMEGA])
    motions[abs(motions) < 1e-9] = 0
    found = {}
    for number, name in enumerate(("heave", "roll", "pitch")):
        found[f"{name}_amplitude"] = abs(motions[..., number])
        found[f"{name}_phase"] = np.angle(motions[..., number])
    return found


def lines() -> list[str]:
    """The components of the diagram."""
    found = []
    for name, table in tables().items():
        motion, _, value = name.partition("_")
        part = {"heave": "heaving", "roll": "rolling", "pitch": "pitching"}[motion]
        unit = "rad" if value == "phase" else "1" if motion == "heave" else "rad/m"
        rows = [", ".join(f"{value:.4g}" if unit == "1" else f"{value:.4g} {unit}" for value in row) for row in table]
        if value == "amplitude":
            found += [f"  {part}:", "    is: SeaResponse", "    n: 30", "    seed: 1", "    t_r: 6 s",
                      *(f"    {key}: ={key}" for key in ("H_s", "T_p", "gamma", "heading"))]
            found += [f"    omega: [{', '.join(f'{w:g} rad/s' for w in OMEGA)}]",
                      f"    beta: [{', '.join(f'{b:g} deg' for b in HEADINGS)}]"]
        found += [f"    {value}:", *(f"      - [{row}]" for row in rows)]
    return found


if __name__ == "__main__":
    print("\n".join(lines()))
