"""Table of models of a diagnosis, and the effects that it adds to the diagram."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from heavebond.core.errors import Problem, UsageError
from heavebond.core.presentation import readable_difference
from heavebond.core.progress import Progress
from heavebond.core.reporting import place, reporting
from heavebond.core.units import read_unit
from heavebond.diagnosis.candidates.catalogue import Candidate
from heavebond.diagnosis.search.refit import Refit
from heavebond.estimation.comparison import Channel, Comparison, RecordComparison, compare
from heavebond.estimation.experiment import Experiment, ExperimentOrFile, load_experiment, without_carried
from heavebond.estimation.fitting import Fit, Fitted
from heavebond.estimation.residuals import AT_END
from heavebond.language.definition import Component, Typical
from heavebond.numerics.result import Probe


@dataclass(frozen=True)
class LadderEntry:
    """One entry of the table of models.

    error_fit, error_held_out: rms error over the rms of the measured signal about its mean, on fitted and held-out samples.
    chi2_fit, chi2_held_out: chi-square per sample.
    """

    name: str
    error_fit: float
    error_held_out: float
    chi2_fit: float
    chi2_held_out: float
    comparison: Comparison

    @property
    def samples_held_out(self) -> int:
        """Number of held-out samples."""
        return sum(int(c.counts.sum()) for p in self.comparison.parts if p.use != "fit" for c in p.channels.values())

    def as_dict(self) -> dict[str, object]:
        """Return the figures for JSON."""
        return {"name": self.name, "error_fit": self.error_fit, "error_held_out": self.error_held_out,
                "chi2_fit": self.chi2_fit, "chi2_held_out": self.chi2_held_out}


@dataclass(frozen=True)
class ChannelError:
    """Error of a model in a channel: rms error and noise, both in the unit of the channel."""

    channel: str
    unit: str
    error: float
    noise: float

    @property
    def words(self) -> str:
        """Error with a readable unit, for example `9549 Pa`."""
        return readable_difference(self.error, self.unit, 3)


@dataclass(frozen=True)
class AddedEffect:
    """An effect that was added to the diagram.

    * candidate: the effect.
    * parameters: its fitted parameters.
    * rung: entry of the model with the effect in the table.
    * fit: the fit.
    * alternatives: refits that the records cannot distinguish from it, the selected one first.
    * doubt: sentence on why a further effect is not certain.
    """

    candidate: Candidate
    parameters: tuple[Fitted, ...]
    rung: LadderEntry
    fit: Fit
    alternatives: tuple[Refit, ...]
    doubt: str = ""

    @property
    def kinds(self) -> tuple[str, ...]:
        """Possible classes of the effect, the most likely first."""
        return tuple(dict.fromkeys(t.candidate.kind for t in self.alternatives))

    @property
    def certain(self) -> bool:
        """True if all alternatives have the same class and the same place."""
        return len(self.kinds) == 1 and len({frozenset(t.candidate.where) for t in self.alternatives}) == 1

    @property
    def beyond(self) -> tuple[str, ...]:
        """Parameters at an end of their search range beyond which the error would decrease."""
        return self.alternatives[0].beyond if self.alternatives else ()

    @property
    def at_limits(self) -> tuple[Fitted, ...]:
        """Parameters at a limit of the parameter itself (a friction of 0), which is a valid result. Their values are set to
        the limit, which the search only approaches."""
        limits = {n.name: n.limits for n in self.candidate.numbers}
        return tuple(replace(p, value=limit) for p in self.parameters if p.ended for limit in limits.get(p.name, ())
                     if limit is not None and abs(p.value - limit) <= AT_END * (p.high - p.low))

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Amplitudes if the records determine none of them, that is if each interval covers the whole range; otherwise
        empty."""
        amplitudes = {n.name for n in self.candidate.numbers if n.amplitude}
        fitted = [p for p in self.parameters if p.name in amplitudes]
        unknown = [p.name for p in fitted if p.told == (None, None)]
        return tuple(unknown) if len(unknown) == len(fitted) else ()

    def as_dict(self) -> dict[str, object]:
        """Return the figures for JSON."""
        return {**self.candidate.as_dict(), "part": self.candidate.name,
                "parameters": {p.name: p.as_dict() for p in self.parameters},
                **({"each_record": {record: {name: values[name] for name in self.candidate.change.each if name in values}
                                    for record, values in self.fit.record_values.items()}}
                   if self.candidate.change.each else {}),
                "error_fit": self.rung.error_fit, "error_held_out": self.rung.error_held_out,
                "chi2_fit": self.rung.chi2_fit, "chi2_held_out": self.rung.chi2_held_out,
                "one_of": [t.candidate.as_dict() for t in self.alternatives], "doubt": self.doubt}


def ladder_entry(name: str, comparison: Comparison) -> LadderEntry:
    """Create an entry of the table of models from the comparison with all records."""
    figures = []
    for parts in ([p for p in comparison.parts if p.use == "fit"], [p for p in comparison.parts if p.use != "fit"]):
        squares = [p.normalised**2 for p in parts if math.isfinite(p.normalised)]
        total, count = chi2_sum(comparison.experiment, parts)
        figures.append((math.sqrt(np.mean(squares)) if squares else math.nan, total / count if count else math.nan))
    (error_fit, chi2_fit), (error_held_out, chi2_held_out) = figures
    return LadderEntry(name, error_fit, error_held_out, chi2_fit, chi2_held_out, comparison)


def channel_errors(rung: LadderEntry) -> list[ChannelError]:
    """Error of a model in each channel, over the held-out samples of all records (without held-out samples, over the fitted
    ones)."""
    parts = [p for p in rung.comparison.parts if p.use != "fit"] or list(rung.comparison.parts)
    by_name: dict[str, list[Channel]] = {}
    for part in parts:
        for name, channel in part.channels.items():
            by_name.setdefault(name, []).append(channel)
    return [ChannelError(name, channels[0].unit, *(
        float(np.sqrt(np.average([v**2 for v in values], weights=[c.counts.sum() for c in channels])))
        for values in ([c.error for c in channels], [c.noise for c in channels]))) for name, channels in by_name.items()]


def with_limits(candidate: Candidate, fit: Fit) -> Fit:
    """Mark fitted limits that the motion does not reach.

    Such a limit is a parameter that is sought within the motion of a variable of the part. It is not reached if it is beyond
    the largest or smallest value of the variable on the fitted records, and its interval is open on this side.
    """
    limits = {n.name: n.follows for n in candidate.numbers if n.follows and n.sought is not None and not n.sought.held}
    runs = [record.result for record in fit.after.records.values() if record.use == "fit"]
    parameters = []
    for p in fit.parameters:
        if p.name in limits:
            course = np.hstack([Probe(run.assembly, [limits[p.name]], si=True).values(run)[0] for run in runs])
            least, most = float(course.min()), float(course.max())
            low, high = p.told
            reach = most if p.value >= most and high is None else least if p.value <= least and low is None else None
            p = replace(p, unreached=reach)
        parameters.append(p)
    return replace(fit, parameters=tuple(parameters))


def parameter_description(fit: Fit, name: str) -> str:
    """Description of a fitted parameter from its component; empty for an initial value or without a description."""
    path, _, key = name.rpartition(".")
    if not path:
        return "parameter of the diagram"
    component = _component(fit, path)
    declared = component.parameters.get(key) if component is not None else None
    return declared.doc if declared is not None else ""


def typical_values(fit: Fit, name: str) -> Typical | None:
    """Typical values of a parameter from its component; None if there are none."""
    path, _, key = name.rpartition(".")
    component = _component(fit, path) if path else None
    return component.parameters[key].typical if component is not None and key in component.parameters else None


def restrictions(finding: AddedEffect) -> str:
    """Restrictions of the law of a finding, from its component; empty if there are none."""
    candidate = finding.candidate
    component = _component(finding.fit, candidate.where[0] if candidate.attaches == "in" else candidate.name)
    return component.restrictions if component is not None else ""


def _component(fit: Fit, path: str) -> Component | None:
    """Component at a path of the fitted diagram; None if the diagram has no such part."""
    leaves = next(iter(fit.after.records.values())).result.assembly.flat.expanded.leaves
    return leaves[path].component if path in leaves else None


def chi2_sum(experiment: Experiment, parts: Sequence[RecordComparison]) -> tuple[float, int]:
    """Chi-square of all samples of these parts of records, and their number. Errors that the machine carries from one
    segment of a record to the next do not count (see `Horizon`)."""
    total, count = 0.0, 0
    for part in parts:
        channels = part.channels.values()
        count += sum(int(c.counts.sum()) for c in channels)
        horizon = experiment.horizons.get(part.name.removesuffix(", held out"))
        if horizon is None:
            total += sum(float(c.chi2 * c.counts.sum()) for c in channels if c.counts.any())
            continue
        number = {name: k for k, name in enumerate(experiment.outputs)}
        r = np.concatenate([((c.model - c.measured) / c.noise)[c.counts] for c in channels])
        channel = np.concatenate([np.full(int(c.counts.sum()), number[c.name]) for c in channels])
        time = np.concatenate([c.time[c.counts] - experiment.outputs[c.name].shift for c in channels])
        noise = np.concatenate([np.full(int(c.counts.sum()), c.noise * read_unit(c.unit).scale) for c in channels])
        total += float(np.sum(without_carried(horizon.carried(channel, time, noise), r)**2))
    return total, count


@reporting
def errors(experiments: Sequence[ExperimentOrFile], *, progress: Progress | None = None) -> list[LadderEntry]:
    """Compare several models with the same records, in the order of `experiments`.

    An error is the rms of the residual over the rms of the record about its mean (dimensionless). Each model has the values
    of its diagram. `progress` is called with the name of each experiment. Raises UsageError if records or channels differ,
    and the errors of `compare`.
    """
    loaded = [load_experiment(e) for e in experiments]
    measured = [(sorted((str(r.file.resolve()), r.use, r.begin or 0.0, r.end or 0.0) for r in e.records.values()),
                 sorted((o.column, o.shown.unit) for o in e.outputs.values())) for e in loaded]
    for later, parts in zip(loaded, measured, strict=True):
        if parts != measured[0]:
            raise UsageError([Problem("ladder-records", f"{later.path.name} and {loaded[0].path.name} have different "
                                      "records or channels, so their errors cannot be compared", None,
                                      "Let the later experiments `extends:` the first one.")])
    rungs = []
    for k, experiment in enumerate(loaded):
        if progress:
            place(progress, k, len(loaded))
            progress(experiment.path.name)
        rungs.append(ladder_entry(experiment.path.stem, compare(experiment)))
    return rungs
