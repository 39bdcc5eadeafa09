"""Diagnosis of the compensator from records of an independent program: its equations in SciPy, set up by hand.

`benchmarks.reference_cmc_ahc` shares no code with heavebond. Its machine has values that differ from the data sheet by a few
percent, and one or two hidden effects; the sea is irregular, the records have noise. The diagram `cmc_ahc/designed` is
compared with these records, fitted and diagnosed as a user would:

    python -m benchmarks.diagnosis.independent                     cases that are not on disk yet
    python -m benchmarks.diagnosis.independent overlap             these cases again
    python -m benchmarks.diagnosis.independent overlap --report overlap.html
"""

from __future__ import annotations

import time as clock
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

import heavebond as hb
from benchmarks import reference_cmc_ahc as reference
from benchmarks.diagnosis.compensator import FRICTION, LEAKAGE, OVERLAP, Case, command, judged
from benchmarks.diagnosis.judging import SECONDS, told
from benchmarks.diagnosis.making import generator
from heavebond.diagnosis.diagnose import Diagnosis
from heavebond.estimation.experiment import Experiment

STUDY = "independent"
SEAS = {"train": (11, 11.0), "validate": (29, 9.5)}     # seed, and peak period in s
SINES = 60
SHARE = 0.6     # of the data sheet's tolerance, within which the machine's own values are drawn
# by the names of the diagram: those of the equations
NAMES = {
    "cmc.gas.c": "c", "cmc.gas.d": "d", "drilling.string.c": "k_string", "drilling.formation.c": "k_form",
    "drilling.formation.d": "d_form", "ahc.valve.q_r": "q_r", "ahc.valve.f_n": "f_n", "ahc.cylinder.beta": "beta",
    "cmc.friction.F_c": "F_c", "cmc.friction.F_s": "F_s", "cmc.friction.sigma_2": "sigma_2", "cmc.friction.k_p": "k_p",
    "ahc.cylinder.leakage": "leak_piston", "ahc.valve.overlap": "overlap"}
OUTPUTS = {"WOB": 1e3, "extension": 1.0, "p_main": 1e5, "p_A": 1e5, "p_B": 1e5, "spool": 1.0}     # SI per unit
WORN = replace(LEAKAGE, numbers={"ahc.cylinder.leakage": 1.5e-10})     # 90 L/min at 100 bar over both pistons

CASES = {
    "nothing": Case(),
    "friction passive": Case((FRICTION,), passive=True, height=0.5),
    "friction": Case((FRICTION,)),
    "leakage": Case((WORN,)),
    "overlap": Case((OVERLAP,)),
    "leakage and overlap": Case((WORN, OVERLAP)),
    "friction and overlap": Case((FRICTION, OVERLAP)),
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
    """Parameters of the equations: those of the design, and `values` (SI) by the names of the diagram."""
    base = reference.PASSIVE if passive else {**reference.ACTIVE, "K_p": 2.0}
    return {**base, **reference.FRICTIONLESS, "leak_piston": 0.0, **{NAMES[name]: value for name, value in values.items()}}


def made(case: Case, folder: Path, seed: str = STUDY) -> tuple[Experiment, dict[str, float]]:
    """The experiment with both records written to `folder`, and the values (SI) of the machine where the data sheet states a
    tolerance."""
    base, time = case.rig.base, case.rig.time
    rng = generator(seed, *case.numbers)
    values = {f.name: (f.range.low + f.range.high) / 2 + SHARE * rng.uniform(-1, 1) * (f.range.high - f.range.low) / 2
              for f in base.free.values()}
    records = {}
    for name, record in base.records.items():
        moving = sea(*SEAS[name], case.height)
        run = reference.simulate(machine({**values, **case.numbers}, case.passive), time, heave=moving, rtol=1e-9)
        columns = {base.time_column: time, base.inputs["vessel.u"].column: run["platform"]}
        for shown, output in base.outputs.items():
            columns[output.column] = run[shown] / OUTPUTS[shown] + (output.noise or 0.0) * rng.standard_normal(len(time))
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


def diagnosed(name: str, folder: Path) -> tuple[dict[str, object], Diagnosis]:
    """One case, from the records to the answer: `diagnose` with its defaults, in one process, without a limit of time."""
    case = CASES[name]
    experiment, values = made(case, folder)
    began = clock.process_time()
    found = hb.diagnose(experiment, number=1, seconds=SECONDS)
    processor = clock.process_time() - began
    truth = {**values, **case.numbers}
    last = found.findings[-1].fit if found.findings else found.fitted
    fitted = {p: v for p, v in last.values.items() if p in truth} if last is not None else {}
    compared = hb.compare(experiment)
    row = {"key": name, "values": truth, "fitted": fitted, "processor": processor, "scored": len(found.steps[0].scores),
           **told(case.rig, judged(case, experiment, truth, found), found),
           "chi2": {n: part.chi2 for n, part in compared.records.items()},
           "parameters": [{"name": p.name, "value": p.value, "interval": list(p.interval), "unit": p.unit}
                          for f in found.findings for p in f.parameters]}
    return row, found


if __name__ == "__main__":
    command(__doc__, STUDY, CASES, diagnosed)
