"""Diagnoses of measured machines from public records, with the whole catalogue, beside the figures that others published.

    python -m benchmarks.diagnosis.measured FOLDER                      sets that are not on disk yet
    python -m benchmarks.diagnosis.measured FOLDER silverbox            this one again
    python -m benchmarks.diagnosis.measured FOLDER --base               only fits of the diagrams, without a diagnosis
    python -m benchmarks.diagnosis.measured FOLDER passive_rig/friction a bundled experiment, or the path of one
    python -m benchmarks.diagnosis.measured FOLDER emps --without "dry friction"   without the laws of a class, or this law
    python -m benchmarks.diagnosis.measured FOLDER --table              compare the results on disk with the known effects

FOLDER holds the records as text, in one folder for each set. They are not bundled. The sets are data: `measured/sets.yaml`
has their sources, the effects that are known to be missing and the published errors, `measured/NAME.yaml` the diagram and
`measured/NAME_records.yaml` the experiment. `--seconds` is the limit of each diagnosis; with `--processor` it counts
processor time, so that the answers do not depend on the load of the computer. An error is the root mean square in the unit
of the channel.
"""

from __future__ import annotations

import argparse
import os
import signal
import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import yaml

import heavebond as hb
from benchmarks.diagnosis import keeping
from heavebond.core import cancellation
from heavebond.core.errors import HeavebondError
from heavebond.diagnosis.diagnose import Diagnosis
from heavebond.estimation.comparison import Comparison
from heavebond.estimation.experiment import Experiment
from heavebond.language.definition import Component

STUDY = "measured"
SECONDS = 600.0
DIAGRAMS = Path(__file__).parent / "measured"
RANKED = 12  # candidates of each step that are kept in a result


@dataclass(frozen=True)
class Measured:
    """A set of records: see the head of `measured/sets.yaml`."""

    source: str
    licence: str
    effects: Sequence[Mapping[str, Any]] = ()
    published: Sequence[Mapping[str, Any]] = field(default_factory=tuple)

    @property
    def known(self) -> str:
        """The effects that are known to be missing."""
        return "; ".join(e["effect"] + (f" ({e['basis']})" if e["basis"] != "authors" else "") for e in self.effects)

    @property
    def grey(self) -> str:
        """Published errors of physical models."""
        return self._figures("grey")

    @property
    def black(self) -> str:
        """Published errors of black boxes."""
        return self._figures("black")

    def _figures(self, model: str) -> str:
        return "; ".join(f"{p['record']}: {p['figure']} ({p['source']}, {'' if p['verified'] else 'not '}verified)"
                         for p in self.published if p["model"] == model) or "none"


SETS: Mapping[str, Measured] = {name: Measured(**entry) for name, entry in yaml.safe_load(
    (DIAGRAMS / "sets.yaml").read_text(encoding="utf-8")).items()}


def experiment(name: str, folder: Path) -> Experiment:
    """The experiment of a set, with its records in `folder`; of another name the bundled experiment, or the file."""
    if name not in SETS:
        return hb.load_experiment(name)
    unplaced = hb.load_experiment(DIAGRAMS / f"{name}_records.yaml")
    records = {n: replace(r, file=folder / r.file.relative_to(DIAGRAMS)) for n, r in unplaced.records.items()}
    return replace(unplaced, records=records)


def without_effects(given: Experiment, removed: Sequence[str]) -> Experiment:
    """The experiment with a catalogue without the effects of these components and classes."""
    library, parts = given.model.library, dict[str, Component]()
    for component in library.effects():
        kept = tuple(e for e in component.effects if component.name not in removed and e.kind not in removed)
        if len(kept) < len(component.effects):
            parts[component.name] = replace(component, effects=kept)
    return replace(given, model=replace(given.model, library=library.with_components(parts)))


def errors(comparison: Comparison) -> dict[str, dict[str, list[object]]]:
    """Error of each channel of each record and held-out part: root mean square, its unit, its share of what was measured."""
    return {part.name: {c.name: [c.error, c.unit, c.relative] for c in part.channels.values()} for part in comparison.parts}


def row(found: Diagnosis, processor: float, classes: Sequence[str]) -> dict[str, object]:
    """The result of a set, diagnosed with the effects of these `classes` (empty: all)."""
    answer = found.as_dict()
    answer["ranking"] = [step[:RANKED] for step in answer["ranking"]]  # type: ignore[attr-defined]
    return {"verdict": found.verdict, "words": found.words, "processor": processor, "classes": classes,
            "partial": any(s.partial for s in found.steps),
            "effects": [[f.candidate.label, f.candidate.kind, len(f.alternatives)] for f in found.findings],
            "shape": found.shape and found.shape.candidate.label, "errors": [errors(r.comparison) for r in found.ladder],
            "uses": {n: r.use for n, r in found.experiment.records.items()},
            "ladder": [[r.name, r.chi2_fit, r.chi2_held_out] for r in found.ladder], "answer": answer}


def places(name: str, folder: Path) -> dict[str, object]:
    """Where the diagram fails, by `localize`, without the points of its curves."""
    began = clock.process_time()
    located = hb.localize(experiment(name, folder)).as_dict()
    for place in located["places"]:  # type: ignore[attr-defined]
        place["curve"] = place["curve"] and {k: v for k, v in place["curve"].items() if k not in ("x", "y", "y_down")}
    return {**{k: located[k] for k in ("missing", "chance", "words", "places")}, "processor": clock.process_time() - began}


def base(name: str, folder: Path) -> dict[str, object]:
    """The fit of the diagram without any effect."""
    began = clock.process_time()
    fitted = hb.fit(experiment(name, folder))
    return {"processor": clock.process_time() - began,
            "parameters": [[p.name, p.record, p.value, p.unit, p.at_bound] for p in fitted.parameters],
            "uses": {n: r.use for n, r in fitted.experiment.records.items()},
            "before": errors(fitted.before), "after": errors(fitted.after)}


def diagnosis(name: str, folder: Path, seconds: float, samples: int | None, classes: Sequence[str],
              removed: Sequence[str] = ()) -> dict[str, object]:
    """The answer of a set and the places of `localize`, with their processor times; `removed` are the components and
    classes that the catalogue lacks."""
    began = clock.process_time()
    found = hb.diagnose(without_effects(experiment(name, folder), removed), number=1, seconds=seconds, samples=samples,
                        classes=classes)
    result = row(found, clock.process_time() - began, classes) | ({"without": removed} if removed else {})
    try:
        return {**result, "places": places(name, folder)}
    except HeavebondError as error:
        return {**result, "places": {"words": [str(error)]}}


def right_levels(candidate: Mapping[str, Any], effect: Mapping[str, Any]) -> list[str]:
    """The levels at which a named candidate agrees with an effect that is known to be missing."""
    chain = candidate["place"].startswith(("before ", "in the channel "))
    agrees = {"side": chain == (effect["side"] == "measuring chain"),
              "place": set(candidate["where"]) in [set(place) for place in effect["places"]],
              "class": candidate["class"] in effect["classes"], "law": candidate["component"] in effect["laws"]}
    return [level for level, right in agrees.items() if right]


def table(rows: Mapping[str, Mapping[str, Any]]) -> str:
    """Results of sets as Markdown: for each named effect the known effect with which it agrees best and at which levels, as
    it is named first and with the alternatives that are named beside it; errors on the last held-out record."""
    lines = ["| set | known | answer | right, first name | right, any name | held-out error | published | s |",
             "|---|---|---|---|---|---|---|---|"]
    for name, result in rows.items():
        if name not in SETS:
            continue
        entry = SETS[name]
        named, first, inside = list[str](), list[str](), list[str]()
        for step in result["answer"]["steps"]:
            named.append(f"{step['class']} {step['place']} (1 of {len(step['one_of'])})")
            for levels, candidates in ((first, [step]), (inside, step["one_of"])):
                pairs = [(right_levels(c, e), e["effect"]) for c in candidates for e in entry.effects]
                best, effect = max(pairs, key=lambda pair: len(pair[0]))
                levels.append(f"{', '.join(best)} ({effect})" if best else "none")
        record = list(result["errors"][0])[-1]
        held_out = [", ".join(f"{error:.3g} {unit}" for error, unit, _ in errors_of[record].values())
                    for errors_of in result["errors"][1:]]
        published = " / ".join(f"{p['figure']} ({p['model']})" for p in entry.published if p["record"] == record) or "none"
        lines.append("| " + " | ".join((
            name, "; ".join(e["effect"] for e in entry.effects if not e.get("minor")),
            f"{result['verdict']}: {'; '.join(named) or '-'}{' (ended early)' if result['partial'] else ''}",
            "; ".join(first) or "-", "; ".join(inside) or "-", " to ".join(held_out), published,
            f"{result['processor']:.0f}")) + " |")
    return "\n".join(lines)


def count_processor_time() -> None:
    """Let all limits of time in this process count its processor time (for one process without workers)."""
    clock.perf_counter = clock.process_time
    signal.signal(signal.SIGPROF, lambda number, frame: os.kill(os.getpid(), signal.SIGALRM))
    cancellation.set_timer = lambda seconds: signal.setitimer(signal.ITIMER_PROF, seconds)[0]


def main() -> None:
    """The sets named, or all that are not on disk."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("sets", nargs="*", help="those to be diagnosed again, bundled experiments or files of experiments")
    parser.add_argument("--seconds", type=float, default=SECONDS)
    parser.add_argument("--processor", action="store_true", help="`--seconds` are processor time")
    parser.add_argument("--samples", type=int, help="of long records, for the search")
    parser.add_argument("--only", action="append", default=[], metavar="CLASS", help="effects of this class")
    parser.add_argument("--without", action="append", default=[], metavar="NAME",
                        help="diagnose without the effects of this component or class")
    parser.add_argument("--base", action="store_true", help="fit the diagrams, diagnose nothing")
    parser.add_argument("--table", action="store_true", help="print the results on disk")
    parser.add_argument("--study", help="file of the results, without ending")
    given = parser.parse_args()
    if given.processor:
        count_processor_time()
    folder, study = given.folder.resolve(), given.study or (f"{STUDY}_base" if given.base else STUDY)
    done = keeping.read(study)
    if given.table:
        print(table(done))
        return
    for name in given.sets or [n for n in SETS if n not in done]:
        try:
            result = base(name, folder) if given.base else diagnosis(
                name, folder, given.seconds, given.samples, given.only, given.without)
            result["key"] = " ".join(["/".join(Path(name).with_suffix("").parts[-2:]),
                                      *(f"without {n}" for n in given.without)])
        except HeavebondError as error:
            print(f"{name}: {error}", flush=True)
            continue
        keeping.add(study, result)
        print(f"{name}: {result['processor']:.0f} s", *(result.get("words") or [result["parameters"], result["after"]]),  # type: ignore[misc]
              sep="\n  ", flush=True)


if __name__ == "__main__":
    main()
