"""Diagnosis of the compensator from records of an independent program: its equations in SciPy, set up by hand.

`benchmarks.reference_cmc_ahc` shares no code with heavebond. Its machine has values that differ from the data sheet by a few
percent, and one or two hidden effects; the sea is irregular, the records have noise. Cases with clutter also have fixed
values that differ from the diagram, quantised channels and a late one. The diagram `cmc_ahc/designed` is compared with these
records, fitted and diagnosed as a user would:

    python -m benchmarks.diagnosis.independent                     cases that are not on disk yet
    python -m benchmarks.diagnosis.independent overlap             these cases again
    python -m benchmarks.diagnosis.independent overlap --report overlap.html
    python -m benchmarks.diagnosis.independent overlap --write DIR   records and experiment in DIR; no diagnosis
    python -m benchmarks.diagnosis.independent --table             the table of docs/compensator.md from the results on disk
"""

from __future__ import annotations

import argparse
import time as clock
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.signal import lfilter

import heavebond as hb
from benchmarks import reference_cmc_ahc as reference
from benchmarks.diagnosis import keeping
from benchmarks.diagnosis.compensator import FRICTION, LEAKAGE, OVERLAP, Case, Effect, answers, diagnose_cases, judged
from benchmarks.diagnosis.judging import SECONDS, told
from benchmarks.diagnosis.making import FINE, generator
from benchmarks.diagnosis.measured import count_processor_time
from heavebond.core.errors import listing
from heavebond.diagnosis.diagnose import Diagnosis
from heavebond.estimation.experiment import Experiment
from heavebond.numerics.dae import Array

STUDY = "independent"
SEAS = {"train": (11, 11.0), "validate": (29, 9.5)}     # seed, and peak period in s
SINES = 60
SHARE = 0.6     # of the data sheet's tolerance, within which the machine's own values are drawn
# by the names of the diagram, those of the equations
NAMES = {
    "cmc.gas.c": "c", "cmc.gas.d": "d", "drilling.string.c": "k_string", "drilling.formation.c": "k_form",
    "drilling.formation.d": "d_form", "ahc.valve.q_r": "q_r", "ahc.valve.f_n": "f_n", "ahc.cylinder.beta": "beta",
    "cmc.friction.F_c": "F_c", "cmc.friction.F_s": "F_s", "cmc.friction.sigma_2": "sigma_2", "cmc.friction.k_p": "k_p",
    "ahc.cylinder.leakage": "leak_piston", "ahc.valve.overlap": "overlap"}
LAG = "lag."     # before the name of a channel: time constant of its sensor, s
OUTPUTS = {"WOB": 1e3, "extension": 1.0, "p_main": 1e5, "p_A": 1e5, "p_B": 1e5, "spool": 1.0}     # SI per unit
WORN = replace(LEAKAGE, numbers={"ahc.cylinder.leakage": 1.5e-10})     # 90 L/min at 100 bar over both pistons
SUPPLY = Effect({"K_supply": 5e10}, "DroopingSource in place of ahc.pump",     # 29 bar at 460 L/min
                answers("supply droop", "line resistance", at=("ahc.pump",)))
HOLE = Effect({"F_hole": 4e3, "d_hole": 2e3}, "CoulombFriction between drilling.bit and drilling.bottom",
              answers("dry friction", at=("drilling.bit", "drilling.bottom")))
GAS = Effect({"n": 1.3}, "PolytropicGasSpring in place of cmc.gas",
             answers("nonlinear stiffness", at=("platform", "crown")))
AIR = Effect({"air": 0.05}, "Cylinder in ahc.cylinder (air)",
             answers("entrained air", "hose compliance", at=("ahc.chamber_a", "ahc.chamber_b")))
SLOW_STROKE = Effect({f"{LAG}extension": 0.06}, "FirstOrderLag in the channel extension", answers("lag", at=("extension",)))
SLOW_GAUGE = Effect({f"{LAG}p_main": 0.4}, "FirstOrderLag in the channel p_main", answers("lag", at=("p_main",)))
# minor differences of the machine that are not declared: fixed values other than those of the diagram, steps of the
# converters and a late channel
CLUTTER = {"zeta": 0.84, "d_wire": 56e3, "d_string": 14e3, "V_0": 0.068, "m_2": 68.5e3, "m_3": 64.5e3, "leak_edge": 1.3e-12}
STEPS = {"WOB": 0.2, "p_main": 0.2, "p_A": 0.2, "p_B": 0.2}     # in the units of the records
LATE = {"spool": 0.01}     # s


@dataclass(frozen=True)
class Cluttered(Case):
    """A case with the minor differences of CLUTTER, STEPS and LATE besides the effects."""


CASES: dict[str, Case] = {
    "nothing": Case(),
    "friction passive": Case((FRICTION,), passive=True, height=0.5),
    "friction": Case((FRICTION,)),
    "leakage": Case((WORN,)),
    "overlap": Case((OVERLAP,)),
    "leakage and overlap": Case((WORN, OVERLAP)),
    "friction and overlap": Case((FRICTION, OVERLAP)),
    "clutter": Cluttered(height=1.5),
    "supply line and leakage, clutter": Cluttered((SUPPLY, WORN), height=1.5),
    "supply line and drill hole, clutter": Cluttered((SUPPLY, HOLE), height=1.5),
    "overlap and drill hole, clutter": Cluttered((OVERLAP, HOLE)),
    "drill hole and slow stroke, clutter": Cluttered((HOLE, SLOW_STROKE)),
    "leakage and slow stroke, clutter": Cluttered((WORN, SLOW_STROKE), height=1.5),
    "gas and slow gauge, clutter": Cluttered((GAS, SLOW_GAUGE), height=3.0),
    "air and overlap, clutter": Cluttered((AIR, OVERLAP)),
}


def sea(seed: int, period: float, height: float) -> reference.Heave:
    """Heave of an irregular sea of that significant height (m) and peak period (s), gradually from rest: sines at random
    frequencies from 0.6 to 3 peak frequencies, with amplitudes sqrt(2 S df) of the Pierson-Moskowitz spectrum S."""
    rng = np.random.default_rng(seed)
    edges = np.linspace(0.6, 3.0, SINES + 1)
    ratio = rng.uniform(edges[:-1], edges[1:])
    density = ratio**-5 * np.exp(-1.25 * ratio**-4)
    amplitude = height / 4 * np.sqrt(2) * np.sqrt(density / density.sum())
    omega, phase = 2 * np.pi / period * ratio, rng.uniform(0, 2 * np.pi, SINES)

    def heave(t: float) -> tuple[float, float]:
        fade = np.exp(-((t / 6) ** 3))
        sine, cosine = amplitude @ np.sin(omega * t + phase), (amplitude * omega) @ np.cos(omega * t + phase)
        return float((1 - fade) * sine), float((1 - fade) * cosine + t**2 / 72 * fade * sine)

    return heave


def machine(values: Mapping[str, float], passive: bool) -> dict[str, float]:
    """Parameters of the equations: the design with `values` (SI) by the names of the diagram or of the equations."""
    base = reference.PASSIVE if passive else {**reference.ACTIVE, "K_p": 2.0}
    changed = {NAMES.get(name, name): value for name, value in values.items() if not name.startswith(LAG)}
    return {**base, **reference.FRICTIONLESS, "leak_piston": 0.0, **changed}


def lagged(time: Array, values: Array, constant: float) -> Array:
    """First-order lag of samples (n,) that are linear between the times (n,), equally spaced; at rest in the beginning."""
    decay = np.exp(-(time[1] - time[0]) / constant)
    weight = 1 - (1 - decay) * constant / (time[1] - time[0])     # of the newer sample
    driven = weight * values[1:] + (1 - decay - weight) * values[:-1]
    return np.concatenate([values[:1], lfilter([1.0], [1.0, -decay], driven, zi=[decay * values[0]])[0]])


def recorded(case: Case, run: Mapping[str, Array], fine: Array, name: str, noise: float, rng: np.random.Generator
             ) -> Array:
    """A channel as the data logger stores it, in its unit: lag of the sensor, delay, noise, step of the converter. `run` has
    FINE values between two samples of the record."""
    values, cluttered = run[name] / OUTPUTS[name], isinstance(case, Cluttered)
    if f"{LAG}{name}" in case.numbers:
        values = lagged(fine, values, case.numbers[f"{LAG}{name}"])
    if cluttered and name in LATE:
        values = np.interp(fine - LATE[name], fine, values)
    samples = values[::FINE] + noise * rng.standard_normal(len(values[::FINE]))
    return np.round(samples / STEPS[name]) * STEPS[name] if cluttered and name in STEPS else samples


def made(case: Case, folder: Path, seed: str = STUDY) -> tuple[Experiment, dict[str, float]]:
    """The experiment with both records written to `folder`, and the values (SI) of the machine where the data sheet states a
    tolerance."""
    base, time = case.rig.base, case.rig.time
    rng = generator(seed, *case.numbers)
    values = {f.name: (f.range.low + f.range.high) / 2 + SHARE * rng.uniform(-1, 1) * (f.range.high - f.range.low) / 2
              for f in base.free.values()}
    fine = np.linspace(0, time[-1], FINE * (len(time) - 1) + 1)
    differences = CLUTTER if isinstance(case, Cluttered) else {}
    records = {}
    for name, record in base.records.items():
        moving = sea(*SEAS[name], case.height)
        parameters = machine({**differences, **values, **case.numbers}, case.passive)
        run = reference.simulate(parameters, fine, heave=moving, rtol=1e-9)
        columns = {base.time.column: time, base.inputs["vessel.u"].column: run["platform"][::FINE]}
        for shown, output in base.outputs.items():
            columns[output.column] = recorded(case, run, fine, shown, output.noise or 0.0, rng)
        records[name] = replace(record, file=folder / f"{name}.csv")
        pd.DataFrame(columns).to_csv(records[name].file, index=False, float_format="%.8g")
    return replace(base, records=records), values


def write_case(name: str, folder: Path) -> Path:
    """The records of a case and its experiment in `folder`; the path of the experiment."""
    case = CASES[name]
    made(case, folder)
    text = case.rig.experiment.read_text(encoding="utf-8")
    diagram = case.rig.base.model.path
    file = folder / "compensator.yaml"
    lines = [f"model: {diagram}" if line.startswith("model:") else line for line in text.splitlines()]
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return file


def diagnosed(name: str, folder: Path, seconds: float = SECONDS) -> tuple[dict[str, object], Diagnosis]:
    """One case, from the records to the answer: `compare`, `localize` and `diagnose` with its defaults, in one process;
    `seconds` limit the processor time of `diagnose`."""
    case = CASES[name]
    experiment, values = made(case, folder)
    began = clock.process_time()
    compared = hb.compare(experiment)
    located = hb.localize(experiment)
    first = clock.process_time() - began
    if seconds < SECONDS:
        count_processor_time()
    began = clock.process_time()
    found = hb.diagnose(experiment, number=1, seconds=seconds)
    processor = clock.process_time() - began
    truth = {**values, **case.numbers}
    last = found.findings[-1].fit if found.findings else found.fitted
    fitted = {p: v for p, v in last.values.items() if p in truth} if last is not None else {}
    row = {"key": name, "values": truth, "fitted": fitted, "processor": processor, "scored": len(found.steps[0].scores),
           "compare and localize": first, "places": [p.words for p in located.suspects[:3]], "limit": min(seconds, 1e9),
           **told(case.rig, judged(case, experiment, truth, found), found),
           "chi2": {n: part.chi2 for n, part in compared.records.items()},
           "parameters": [{"name": p.name, "value": p.value, "interval": list(p.interval), "unit": p.unit}
                          for f in found.findings for p in f.parameters]}
    return row, found


def table() -> str:
    """The results of the cases with clutter: the answer, chi-square on the held-out record as designed, with the parameters
    fitted and after each effect, and the processor time of `diagnose`."""
    lines = ["| hidden | result | chi-square | processor, s |", "|---|---|---|---|"]
    for name, row in keeping.read(STUDY).items():
        if isinstance(CASES.get(name), Cluttered):
            named = "; ".join(f"{n['kind']} {n['place']}" for n in row["named"])  # type: ignore[attr-defined]
            rungs = " to ".join(f"{chi2:.4g}" for _, _, chi2 in row["ladder"])  # type: ignore[attr-defined]
            lines.append(f"| {name} | {row['verdict']}: {named} | {rungs} | {row['processor']:.0f} |")
    return "\n".join(lines)


def main() -> None:
    """Records, a table, or diagnoses."""
    reading = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    reading.add_argument("cases", nargs="*", metavar="CASE", help="which (default: those that are not on disk yet)")
    reading.add_argument("--report", type=Path, help="where the page about the last of them is written")
    reading.add_argument("--seconds", type=float, default=SECONDS, help="limit of the processor time of each diagnosis")
    reading.add_argument("--write", type=Path, metavar="DIR", help="write records and experiment of a case; no diagnosis")
    reading.add_argument("--table", action="store_true", help="print the table of the cases with clutter; no diagnosis")
    options = reading.parse_args()
    if unknown := set(options.cases) - CASES.keys():
        reading.error(f"no such case: {listing(sorted(unknown))}; there are {listing(CASES)}")
    if options.table:
        print(table())
    elif options.write:
        for name in options.cases:
            options.write.mkdir(parents=True, exist_ok=True)
            print(write_case(name, options.write))
    else:
        diagnose_cases(STUDY, options.cases or [name for name in CASES if name not in keeping.read(STUDY)],
                       lambda name, folder: diagnosed(name, folder, options.seconds), options.report)


if __name__ == "__main__":
    main()
