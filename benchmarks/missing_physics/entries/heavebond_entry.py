"""heavebond: `diagnose` for laws of its catalogue; if that leaves more than the noise, `find_laws` for a formula."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

import heavebond as hb
from benchmarks.diagnosis.measured import count_processor_time
from benchmarks.missing_physics.reading import Case
from benchmarks.missing_physics.scoring import predictions_of
from heavebond.diagnosis.diagnose import Diagnosis
from heavebond.estimation.experiment import Experiment, load_experiment
from heavebond.estimation.residuals import Run
from heavebond.language.library import effect_kind

NAME, NEEDS = "heavebond", ()
SECONDS = 25.0
ADEQUATE = 1.5  # chi-square per sample from which on a formula is searched as well


def answer(case: Case) -> dict[str, Any]:
    """The answer of both commands; the time limit is processor time."""
    count_processor_time()
    file = case.folder / "experiment.yaml"
    found = hb.diagnose(file, number=1, seconds=SECONDS)
    last = found.ladder[-1]
    effects = [_effect(f.candidate) for f in found.findings]
    fits = [f.fit for f in (*found.findings, *found.doubtful)] or ([found.fitted] if found.fitted is not None else [])
    experiment = fits[-1].experiment if fits else found.experiment
    values = {p.name: p.value for p in fits[-1].parameters} if fits else {}
    told = {"missing": bool(effects) or found.verdict not in ("nothing", "parameters", "undetermined"),
            "effects": effects, "words": list(found.words)}
    if last.chi2_fit > ADEQUATE:
        laws = hb.find_laws(file)
        law = laws.simplest
        if law is not None and law.finding is not None and law.loss < _loss(found):
            experiment = law.finding.fit.experiment
            values = {p.name: p.value for p in law.finding.fit.parameters}
            record = next(iter(case.records.values()))
            told = {"missing": True, "words": list(laws.words), "effects": [{
                "side": "machine", "place": list(law.place), "class": laws.known.candidate.kind if laws.known else "",
                "kind": kind, "law": law.text, "words": law.text} for kind in _kinds(law, record.time)]}
            own = next(iter(law.implied)).local
            told["input"] = {"place": list(law.place), "values": [float(f"{v:.5g}") for v in law.value(
                {name: own[name] for name in law.formula.variables}, record.time)]}
    return told | {"predictions": _predicted(case, experiment, values)}


def _kinds(law: hb.FoundLaw, time: Any) -> list[str]:
    """On what the parts of a formula depend, the part with the largest values first; each kind once."""
    formula, local = law.formula.with_numbers(law.numbers), next(iter(law.implied)).local
    sizes: dict[str, float] = {}
    for k, part in enumerate(formula.parts):
        kind = {"across": "rate", "position": "displacement"}.get(part.first.kind, "")
        alone = replace(formula, parts=(part,), fixed=(formula.fixed[k],))
        sizes[kind] = max(sizes.get(kind, 0.0), float(np.std(alone.value(local, time))))
    return sorted(sizes, key=lambda kind: -sizes[kind])


def _loss(found: Diagnosis) -> float:
    return float(found.ladder[-1].chi2_fit)


def _effect(candidate: Any) -> dict[str, Any]:
    kind = effect_kind(candidate.kind) or "variation"
    side = "measuring chain" if kind == "measurement" or candidate.attaches == "channel" else "machine"
    return {"side": side, "place": list(candidate.where), "kind": kind, "class": candidate.kind,
            "law": candidate.component, "words": candidate.label}


def _predicted(case: Case, experiment: Experiment, values: Mapping[str, float]) -> dict[str, Any]:
    """The channels of the scored record, simulated with the fitted diagram."""
    scored = next(r for r in case.records.values() if r.use == "score")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        text = yaml.safe_load((case.folder / "experiment.yaml").read_text(encoding="utf-8"))
        table = pd.read_csv(case.folder / case.content["records"][scored.name]["file"])
        for output in text["outputs"].values():
            table[output["column"]] = np.zeros(len(table))
        table.to_csv(folder / "scored.csv", index=False)
        text["model"] = str((case.folder / text["model"]).resolve())
        text["records"] = {scored.name: {"file": "scored.csv", "use": "fit"}}
        (folder / "scored.yaml").write_text(yaml.safe_dump(text, sort_keys=False), encoding="utf-8")
        record = next(iter(load_experiment(folder / "scored.yaml").records.values()))
        run = Run(experiment, record, [])
        known = run.assembly.parameter_values
        channels = run.probe.values(run.simulator.run({k: v for k, v in values.items() if k in known}))
    return predictions_of(scored.name, dict(zip(experiment.outputs, channels, strict=True)))
