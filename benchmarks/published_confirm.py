"""Results of the search of structures repeated with the full model.

    python -m benchmarks.published_confirm "crown block and hook as one mass"
    python -m benchmarks.published_confirm "second order, natural frequency" --set hook=76.7e3

`heavebond tune` retunes both gains of every cell, with stability required, except with the friction as printed, which drives
the piston at rest whatever the gains are. `--set` takes the values of the published model in place of those of the search,
with the changes named. The structures with one mass, a sampled controller, a fixed step, feedback of the stroke or K_v in
steps have no diagram; those with another valve law, friction or wires do.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

import heavebond as hb
from benchmarks.published_search import RESULTS, kept_results
from benchmarks.published_structures import (
    CELLS,
    FINE,
    FREE_FLOW,
    K_Q,
    OURS,
    PUBLISHED,
    STRUCTURES,
    Array,
    Structure,
    arrays,
    numbers,
)
from heavebond.linear.linearisation import ModesAtStart

FAST = 100.0  # a first-order valve as the slow pole of a spool that is so many times faster
STIFF = 1e10  # N/m, wires that join crown block and hook


def parameters(structure: Structure, values: Mapping[str, float]) -> dict[str, float]:
    """Values of the diagram, without the valve's frequency."""
    names = {"beta": "ahc.cylinder.beta", "leakage": "ahc.cylinder.leakage", "hook": "drilling.hook.m", "T_1": "mru.T_1",
             "d_wires": "drilling.wires.d", "d_string": "drilling.string.d", "d_formation": "drilling.formation.d"}
    found = {path: values[name] for name, path in names.items() if name in values}
    found["ahc.valve.q_r"] = 2 * 460 / 60e3 * values.get("K_q", K_Q) / K_Q
    found["cmc.equaliser.A"] = values["equalised"] / 1.027 * 69e-4
    zeta = {"two lags": 1.0, "first order": FAST / 2}
    found["ahc.valve.zeta"] = zeta.get(structure.law, values.get("zeta", 0.87))
    if structure.masses == "no wires":
        found["drilling.wires.c"] = STIFF
    return found


def spool_frequency(structure: Structure, values: Mapping[str, float], f_n: float) -> float:
    """Natural frequency of the spool of a valve called f_n, Hz."""
    if structure.law == "first order":
        return FAST * f_n
    if structure.law == "-3 dB":
        b = 1 - 2 * values["zeta"] ** 2
        return float(f_n / np.sqrt(b + np.sqrt(b**2 + 1)))
    return f_n


def has_diagram(structure: Structure) -> bool:
    """Whether the full model can be set to this structure."""
    return (structure.masses in ("three", "no wires") and structure.feedback == "crown" and structure.stable
            and structure.oil == "compliant" and not (structure.sampled or structure.euler or structure.resolution))


def confirmed(structure: Structure, values: Mapping[str, float], *, explore: int = 8, starts: int = 2) -> Array:
    """(15,) what PUBLISHED lists, from the full model."""
    task = hb.load_study("cmc_ahc/quality_index").tuning
    printed = structure.friction == "printed"
    names = {True: "cmc_ahc/printed_friction" if printed else "cmc_ahc", False: "cmc_ahc/active_frictionless"}
    given = parameters(structure, values)
    wob, gains = [], {}
    for friction, f_n in CELLS:
        machine = hb.assemble(hb.load(names[friction])).with_parameters(
            {**given, "ahc.valve.f_n": spool_frequency(structure, values, f_n)})
        tuned = hb.tune(machine, replace(task, stable=not (printed and friction)), explore=explore, starts=starts)
        run = hb.simulate(machine, parameters=tuned.values)
        wob.append(float(abs(run.display["WOB"][3600:] - 30).max()))
        gains[friction, f_n] = tuned.values
    k_v = [gains[friction, 0.75]["controller.K_v"] for friction in (True, False)]
    k_p = [gains[friction, 0.75]["controller.K_p"] for friction in (True, False)]
    if structure.cascade:
        k_p = [a / b for a, b in zip(k_p, k_v, strict=True)]
    passive = hb.assemble(hb.load("cmc_ahc/passive_frictionless")).with_parameters(given)
    _, modes = ModesAtStart(passive).at({})
    slowest = min((mode for mode in modes if mode.swings), key=lambda mode: mode.frequency)
    return np.array([*wob, *k_p, *k_v, slowest.frequency])


def main() -> None:
    """As the command line calls it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="+", help="names of structures")
    parser.add_argument("--wide", action="store_true", help="values of the wide search")
    parser.add_argument("--set", nargs="+", default=[], metavar="NAME=VALUE", help="values of the model with these changes")
    options = parser.parse_args()
    changed = {name: float(value) for name, _, value in (text.partition("=") for text in options.set)}
    box = "as set" if changed else "wide" if options.wide else "data sheet"
    results = kept_results(RESULTS)
    for structure in (*STRUCTURES, *FREE_FLOW):
        if structure.name not in options.names:
            continue
        if not has_diagram(structure):
            print(f"{structure.name}: the full model cannot be set to this structure")
            continue
        values = {**OURS, **changed} if changed else results[box][structure.name]["values"]
        linear = numbers(structure, arrays(values), FINE)[0]
        found = confirmed(structure, values)
        print(f"{structure.name}, {box}: {(abs(found[:10] / PUBLISHED[:10] - 1) <= 0.25).sum()} cells within 25 %")
        for label, text in (("linear", linear), ("full", found), ("published", PUBLISHED)):
            print(f"  {label:10}" + " ".join(f"{number:6.2f}" for number in text), flush=True)


if __name__ == "__main__":
    main()
