"""Records and models on the page: the contents of an experiment, its comparison, its residuals over a signal."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from heavebond.core.errors import HeavebondError, Problem, UsageError, suggest
from heavebond.core.presentation import readable, readable_unit
from heavebond.core.units import dimension_text, read_unit
from heavebond.equations.places import nodes_of
from heavebond.estimation.comparison import Channel, Comparison, assemble_for, compare
from heavebond.estimation.experiment import Experiment, experiment_from_source
from heavebond.estimation.proposed_experiment import IN_THE_FORM, Chosen, Records, experiment_text, propose
from heavebond.estimation.records import measure
from heavebond.language.model import load
from heavebond.numerics.dae import Array, Assembly, assemble
from heavebond.numerics.result import Probe
from heavebond.records.measurements import read_table
from heavebond.reports.result_tables import Item, Line, ResultTable, comparison_items
from heavebond.studio.contents import Entry
from heavebond.studio.job import Job
from heavebond.text.expression import ExpressionProblem
from heavebond.text.yaml_source import parse


def read_experiment(job: Job) -> Experiment:
    """The experiment of a text, with the values of sliders as `heavebond compare --set` takes them."""
    experiment = experiment_from_source(parse(job.text, Path(job.path), job.name))
    return experiment.with_parameters(dict(job.values)) if job.values else experiment


def experiment_entry(experiment: Experiment) -> Entry:
    """The contents of an experiment, for the page."""
    return {
        "name": experiment.name, "diagram": experiment.model.name,
        "records": [{"name": r.name, "file": r.file.name, "use": r.use} for r in experiment.records.values()],
        "inputs": {name: source.column for name, source in experiment.inputs.items()},
        "outputs": [{"name": name, "unit": o.shown.unit, "formula": o.shown.text} for name, o in experiment.outputs.items()],
        "free": {name: {"low": f.range.low / f.range.unit.scale, "high": f.range.high / f.range.unit.scale,
                        "unit": f.range.unit.text} for name, f in experiment.free.items()}}


def fitting_classes(job: Job) -> Entry:
    """The classes of the effects that fit in the diagram of an experiment."""
    from heavebond.diagnosis.candidates.fixed_values import classes_of

    return {"classes": classes_of(read_experiment(job))}


def files_of(experiment: Experiment) -> list[Path]:
    """Other files of an experiment: those that it extends, its diagram's, its records."""
    records = [path for r in experiment.records.values() for path in (
        r.file, *(o.file for o in r.origins.values() if o.file), *(g.file for g in r.inputs.values() if g.file != Path()))]
    input_files = [g.file for g in experiment.inputs.values() if g.file != Path()]
    return list(dict.fromkeys([*experiment.files, experiment.model.path, *experiment.model.sources, *records, *input_files]))


def assembled(experiment: Experiment) -> Assembly:
    """Assemble the diagram with the inputs of its first record; ModelError for unknown outputs or free parameters."""
    return assemble_for(experiment, next(iter(experiment.records.values())))


def item_entries(items: Sequence[Item]) -> list[Entry]:
    """Tables and lines of a result for the page."""
    entries: list[Entry] = []
    for item in items:
        if isinstance(item, ResultTable):
            entries.append({"title": item.title, "head": list(item.head), "rows": [list(row) for row in item.rows],
                            "text": item.text})
        elif isinstance(item, Line):
            entries.append({"line": item.text, "warning": item.warning})
        else:
            entries.append({"notes": [list(row) for row in item.rows]})
    return entries


# -- comparison ----------------------------------------------------------------------------------------------------------
class Evidence:
    """The latest comparison, stored for its charts."""

    def __init__(self) -> None:
        self._kept: tuple[Any, Comparison] | None = None

    def compare(self, job: Job) -> tuple[Entry, None]:
        """The results of `heavebond compare` and a list of the charts."""
        comparison = self._comparison(job)
        parts = [{"record": part.name, "use": part.use, "of": name,
                  "channels": [{"name": c.name, "unit": c.unit, "noise": c.noise, "error": c.error, "chi2": c.chi2}
                               for c in part.channels.values()]}
                 for name, r in comparison.records.items() for part in (r, r.validate) if part is not None]
        verdicts = {r.name: r.result.verdict.text for r in comparison.records.values() if r.result.verdict.status != "clean"}
        # variables over which a residual can be drawn: velocity, position or pressure of each node, and their differences
        # across parts
        flat = next(iter(comparison.records.values())).result.assembly.flat
        nodes = nodes_of(flat)
        members = {path: [m for m in (*node.domain.across, node.domain.position) if m and f"{path}.{m}" in flat.names]
                   for path, node in nodes.items()}
        docs = {f"{path}.{m}": flat.unknowns[flat.names[f"{path}.{m}"]].doc for path in nodes for m in members[path]}
        owners = {path: {port.rpartition(".")[0] for port in node.ports} for path, node in nodes.items()}
        pairs = [(a, b) for a, b in combinations(nodes, 2) if owners[a] & owners[b] and nodes[a].domain is nodes[b].domain]
        docs |= {f"{b}.{m} - {a}.{m}": f"{docs[f'{a}.{m}']} between" for a, b in pairs for m in members[a]
                 if m in members[b]}
        variables = [{"name": name, "doc": doc} for name, doc in docs.items()]
        return {"records": comparison.as_dict(), "items": item_entries(comparison_items(comparison)), "parts": parts,
                "advice": list(comparison.advice), "verdicts": verdicts, "variables": variables}, None

    def channel(self, job: Job, record: str, name: str) -> tuple[Entry, Array]:
        """Times in s, measured values, model and residual (measured - model) of a channel in a readable unit, and the use
        of each sample (1 fitted, 2 held out, 0 left out)."""
        compared, channel = self._channel(job, record, name)
        counts = channel.counts.astype(float)
        held = compared.validate.channels.get(name) if compared.validate is not None else None
        if held is not None:
            counts = np.where(held.counts, 2.0, counts)
        display_unit, scale = _drawn_unit(channel)
        rows = np.vstack([channel.time, *(scale * row for row in (
            channel.measured, channel.model, channel.measured - channel.model)), counts])
        largest = max(channel.error, channel.noise)
        rms, noise = (readable(v, channel.unit, 3, beside=largest) for v in (channel.error, channel.noise))
        return {"unit": display_unit, "noise": scale * channel.noise, "rms": rms, "noise_words": noise}, rows

    def against(self, job: Job, record: str, name: str, signal: str) -> tuple[Entry, Array]:
        """The residual of a channel over a signal of the run at the same instants, for fitted and held-out samples."""
        compared, channel = self._channel(job, record, name)
        result = compared.result
        unit = _unit_of(result.assembly, signal)
        course = Probe(result.assembly, [signal], si=True).values(result)[0]
        shift = self._comparison(job).experiment.outputs[name].shift
        display_unit = readable_unit(unit, float(np.max(np.abs(course), initial=0.0)))
        x = np.interp(channel.time - shift, result.time, course) / read_unit(display_unit).scale
        counts = channel.counts | (compared.validate.channels[name].counts if compared.validate is not None
                                   and name in compared.validate.channels else False)
        rising = np.gradient(x) > 0 if len(x) > 1 else np.zeros(len(x), dtype=bool)
        residual, scale = _drawn_unit(channel)
        rows = np.vstack([x, scale * (channel.measured - channel.model), rising.astype(float)])[:, counts]
        return {"unit": residual, "across": display_unit}, rows

    def _channel(self, job: Job, record: str, name: str) -> tuple[Any, Channel]:
        compared = self._comparison(job).records[record]
        return compared, compared.channels[name]

    def _comparison(self, job: Job) -> Comparison:
        experiment = read_experiment(job)
        files = tuple((str(p), p.stat().st_mtime_ns if p.exists() else 0) for p in files_of(experiment))
        key = (job.text, job.path, tuple(sorted(job.values.items())), files)
        if self._kept is None or self._kept[0] != key:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # the page shows the verdicts
                self._kept = (key, compare(experiment))
        return self._kept[1]


def _drawn_unit(channel: Channel) -> tuple[str, float]:
    """The display unit of a channel, and the factor from its unit."""
    unit = readable_unit(channel.unit, float(np.max(np.abs(channel.measured), initial=0.0)))
    return unit, 1.0 if unit == channel.unit else read_unit(channel.unit).scale / read_unit(unit).scale


def _unit_of(assembly: Assembly, signal: str) -> str:
    """The SI unit of a formula in the diagram's signals; UsageError if it cannot be read."""
    try:
        formula = assembly.model.library.formula(signal)
        return dimension_text(assembly.resolver().dimension(formula) or ())
    except ExpressionProblem as problem:
        raise UsageError([Problem("signal-unknown", f"'{signal}': {problem.message}", None,
                                  suggest(signal, assembly.flat.names) or problem.hint)]) from None


# -- records that become an experiment -----------------------------------------------------------------------------------
def proposal(job: Job, file: str) -> tuple[Entry, None]:
    """The columns of a record with their likely meaning for the diagram of the page."""
    assembly = assemble(load(job.path))
    proposed = propose(read_table(Path(file)), assembly, instructions=IN_THE_FORM)
    return {"columns": [asdict(c) for c in proposed.columns],
            "inputs": {k: list(v) for k, v in proposed.inputs.items()},
            "outputs": {k: list(v) for k, v in proposed.outputs.items()},
            "remarks": list(proposed.remarks)}, None


def written_experiment(path: str, name: str, title: str, model: str, files: Mapping[str, str],
                       columns: Sequence[Mapping[str, str]], free: Mapping[str, str], every: str = "") -> tuple[Entry, None]:
    """The text of the experiment that a form describes, read once as a file at `path`, so that mistakes are reported
    before it is written. `every` is the time between two rows of files without a column of times."""
    chosen = [Chosen(c["column"], c["role"], c["unit"] or "1", c.get("target", ""), c.get("interpolation") or "linear",
                     c.get("noise", "") if c["role"] in ("input", "output") else "") for c in columns]
    for c in chosen:
        if c.role in ("input", "output") and not c.target.strip():
            raise UsageError([Problem("record-roles", f"column '{c.column}' is an {c.role}, but its signal is not "
                                                      "chosen", None,
                                      "Choose a signal for it, or 'not used'.")])
    if twice := next((c.target for k, c in enumerate(chosen) if c.target and any(
            c.target == d.target and c.role == d.role for d in chosen[:k])), ""):
        raise UsageError([Problem("record-roles", f"two columns are both {twice}", None, "Keep one of them.")])
    measured = Records(Path(model), {Path(f): use for f, use in files.items()}, chosen, free, every=every)
    text = experiment_text(title, Path(path), measured)
    experiment = experiment_from_source(parse(text, Path(path), name))
    for record in experiment.records.values():
        try:
            assemble_for(experiment, record)
            measure(experiment, record)
        except HeavebondError as error:
            raise UsageError(list(error.problems)) from None
    return {"text": text}, None
