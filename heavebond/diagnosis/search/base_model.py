"""Base model of a search: a diagram with its free parameters at their optimum, to which candidates are added for scoring and
refitting.

Each record is simulated twice: by IDAS for the reported figures, and by the integrator of the search for comparisons with
runs of changed diagrams. In these comparisons the errors of the integrator cancel.

Many candidates share one diagram, because inserting a candidate and assembling the diagram takes longer than the runs of its
score. A law without states does not change the machine while its amplitude is neutral, even if the diagram contains other
inactive laws. Candidates that do not change the same part are therefore inserted into one diagram. The diagram is assembled
once, and its equations with the derivatives with respect to all amplitudes are generated once. Each candidate is simulated
separately in this diagram. A refit moves all free parameters and uses a diagram with one candidate only.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property, reduce

import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import HeavebondError
from heavebond.diagnosis.candidates.catalogue import Candidate
from heavebond.estimation.comparison import assemble_for, driven_by
from heavebond.estimation.experiment import Experiment, changed_experiment
from heavebond.estimation.residuals import Residuals, Run
from heavebond.language.edits import Change
from heavebond.language.library import Library
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.quick_simulation import QuickSimulator, Unexplained
from heavebond.numerics.result import Result
from heavebond.numerics.simulator import Tolerances
from heavebond.text.expression import Call, Expr, children

ADDING = ("across", "at", "in", "input", "channel", "parameter")  # ways to attach that keep all parts and connections
MOST = 12  # candidates in one diagram: inactive ones also cost time in every run


@dataclass(frozen=True)
class SharedDiagram:
    """Candidates that are inserted into one diagram; the names of their parts do not collide."""

    members: tuple[Candidate, ...]

    @property
    def change(self) -> Change:
        """The change that inserts all candidates."""
        return reduce(Change.joined, (c.change for c in self.members))

    @property
    def amplitudes(self) -> tuple[str, ...]:
        """The names of the amplitudes of all candidates."""
        return tuple(n.name for c in self.members for n in c.vanishing)

    def member(self, label: str) -> Candidate:
        """The candidate with this label. Its parts have the names that they have in the shared diagram."""
        return next(c for c in self.members if c.label == label)


def shared_diagrams(library: Library, candidates: Sequence[Candidate]) -> dict[str, SharedDiagram]:
    """Assign candidates to shared diagrams.

    Candidates share a diagram if their changes name no common item, up to `MOST` candidates. Candidates at inputs are never
    mixed with other candidates. The result maps the labels of candidates to shared diagrams. Candidates that need a
    separate diagram are not in it.
    """
    groups: list[tuple[set[str], list[Candidate]]] = []
    for candidate in candidates:
        if not _may_share(library, candidate):
            continue
        # names that two changes of one diagram must not have in common: parts, new nodes, ports that are removed from a
        # node, parameter values, initial values, channels and inputs
        change = candidate.change
        ends = [(node, end) for node, joined in change.nodes.items() for end in joined]
        claimed = {*change.components, *(node for node, end in ends if end[0] not in "+-"),
                   *(end for _, end in ends if end[0] == "-"), *change.settings, *change.initial,
                   *(f"channel {name}" for name in change.channels), *(f"input {name}" for name in change.moved)}
        for occupied, group in groups:
            if len(group) < MOST and not claimed & occupied \
                    and (group[0].attaches == "input") is (candidate.attaches == "input"):
                occupied.update(claimed)
                group.append(candidate)
                break
        else:
            groups.append((claimed, [candidate]))
    return {candidate.label: shared for _, group in groups if len(group) > 1
            for shared in [SharedDiagram(tuple(group))] for candidate in group}


def _may_share(library: Library, candidate: Candidate) -> bool:
    """True if a candidate can be inserted into a shared diagram at amplitude zero: no number of it is fixed before the
    runs, and its parts have neither states nor events."""
    if not candidate.vanishes or candidate.attaches not in ADDING \
            or any(n.sought is not None and n.sought.held for n in candidate.numbers):
        return False
    components = [library.component(part.kind) for part in candidate.change.components.values()]
    return not any(c.composite or c.when for c in components) and not any(
        _differentiates(side) for c in components for line in c.equations for side in (line.tree.left, line.tree.right))


def _differentiates(expr: Expr) -> bool:
    return (isinstance(expr, Call) and expr.function == "der") or any(map(_differentiates, children(expr)))


# Tolerances of search runs. The rms error of the runs must be below the share ERRS of the noise, because candidates could
# otherwise explain it. If it is larger, the tolerances are multiplied by FINER, at most TIMES times.
SEARCH = Tolerances(1e-5, 1e-7)
ERRS, FINER, TIMES = 0.05, 0.1, 2
# A difference of two search runs is treated as zero if it is below ROUGH times the error of one run: the errors of both may
# add.
ROUGH = 2.0
DIAGRAMS = 200  # changed diagrams that are kept in memory, about 1 MB each


def searched(experiment: Experiment, tolerances: Tolerances = SEARCH) -> Residuals:
    """The least squares problem of an experiment, with the integrator and the tolerances of a search."""
    fitted = [r for r in experiment.records.values() if r.use == "fit"]
    return Residuals(experiment, runs=[Run(experiment, record, list(experiment.free), tolerances, kind=QuickSimulator)
                                       for record in fitted])


def finer(problem: Residuals) -> Residuals:
    """The same problem with tolerances that are smaller by the factor `FINER`."""
    then = problem.runs[0].simulator.tolerances.scaled(FINER)
    return Residuals(problem.experiment, runs=[run.again(run.names, {}, QuickSimulator, then) for run in problem.runs])


def exact_runs(experiment: Experiment, fitted: Sequence[Run], like: Mapping[str, Run] | None = None,
               assembled: dict[str, Assembly] | None = None) -> dict[str, Run]:
    """Runs of all records by IDAS. The runs of the fitted records use the diagram of `fitted`. The runs of the other
    records read the measured data from `like` if it contains a run of the record (possibly with another diagram), and keep
    the equations that were assembled for a record in `assembled` for the next call with this diagram."""
    fitted_runs = {run.record.name: run.again([], {}, Unexplained) for run in fitted}
    first, runs = fitted[0], dict[str, Run]()
    for name, record in experiment.records.items():
        if name in fitted_runs:
            runs[name] = fitted_runs[name]
            continue
        known = driven_by(first.assembly, experiment, first.record, record)
        runs[name] = Run(experiment, record, [], first.simulator.tolerances, kind=Unexplained,
                         like=(like or {}).get(record.name), assembly=known or (assembled or {}).get(name))
        if known is None and assembled is not None:
            assembled[name] = runs[name].assembly
    return runs


@dataclass(frozen=True)
class Diagram:
    """A changed diagram: the experiment with this diagram, and the equations for each fitted record; `held_out` are the
    equations for other records, if the diagram differs there (see `exact_runs`)."""

    experiment: Experiment
    assemblies: tuple[Assembly, ...]
    held_out: dict[str, Assembly] = field(default_factory=dict, repr=False, compare=False)


@dataclass(frozen=True)
class Base:
    """The base model at its optimum.

    `r` (n,) are the residuals by IDAS, `quick` (n,) the same residuals by the integrator of the search, `J` (n, m) the
    Jacobian, `priors` (priors, m) the derivatives of the priors, and `inner` (m,) the unknowns of the optimiser. `exact`
    holds runs of all records by IDAS.
    """

    problem: Residuals
    inner: Array
    r: Array
    quick: Array
    J: Array
    priors: Array
    exact: Mapping[str, Run]
    diagrams: dict[str, Diagram] = field(default_factory=dict, repr=False, compare=False)
    shared: dict[str, list[Run] | None] = field(default_factory=dict, repr=False, compare=False)  # see `sleeping`

    @classmethod
    def at(cls, problem: Residuals, inner: Array) -> Base:
        """Evaluate the base model at the point `inner` (m,) of a least squares problem."""
        J = problem.evaluate(inner)[1]
        exact = exact_runs(problem.experiment, problem.runs)
        r = np.concatenate([exact[run.record.name].residuals(problem.values_of(inner, run.record.name))[0]
                            for run in problem.runs])
        quick = np.concatenate([run.again([], {}, QuickSimulator).residuals(problem.values_of(inner, run.record.name))[0]
                                for run in problem.runs])
        return cls(problem, inner, r, quick, J, problem.priors(inner)[1], exact)

    def diagram(self, change: Change) -> Diagram:
        """The changed diagram, assembled once for the score and the refit of a candidate. HeavebondError if it cannot be
        assembled."""
        key = repr(change)
        if key not in self.diagrams:
            changed = changed_experiment(self.problem.experiment, change)
            records = [changed.records[run.record.name] for run in self.problem.runs]
            assembled = Diagram(changed, tuple(assemble_for(changed, record) for record in records))
            if len(self.diagrams) == DIAGRAMS:
                del self.diagrams[next(iter(self.diagrams))]
            self.diagrams[key] = assembled
        return self.diagrams[key]

    def runs(self, change: Change, names: Sequence[str], among: Sequence[str] = ()) -> list[Run]:
        """Runs of the fitted records with the changed diagram. `names` are the parameters for which sensitivities are
        computed; `among` are further parameters that other runs of the same diagram change."""
        diagram = self.diagram(change)
        pairs = zip(self.problem.runs, diagram.assemblies, strict=True)
        return [Run(diagram.experiment, run.record, list(names), run.simulator.tolerances, kind=QuickSimulator, like=run,
                    assembly=assembly, among=among) for run, assembly in pairs]

    def sleeping(self, shared: SharedDiagram | None, label: str) -> list[Run] | None:
        """Runs of the fitted records with the shared diagram of a candidate, all amplitudes neutral, without
        sensitivities. If the inactive candidates change the residuals of the base model, the shared diagram is halved
        until they do not. None if the candidate needs a separate diagram."""
        while shared is not None:
            key = repr(shared.members)
            if key not in self.shared:
                usable = None
                with suppress(HeavebondError):
                    runs = self.runs(shared.change, [], shared.amplitudes)
                    # the same states and algebraic unknowns, and the same number of events
                    alike = all(run.assembly.state_names == base_run.assembly.state_names
                                and run.assembly.algebraic_names == base_run.assembly.algebraic_names
                                and len(run.assembly.flat.events) == len(base_run.assembly.flat.events)
                                for run, base_run in zip(runs, self.problem.runs, strict=True))
                    if alike and np.linalg.norm(plain_residuals(self, runs, {}) - self.quick) <= ROUGH * self.error:
                        usable = runs
                self.shared[key] = usable
            if (shared_runs := self.shared[key]) is not None:
                return shared_runs
            middle = len(shared.members) // 2
            halves = shared.members[:middle], shared.members[middle:]
            members = next(half for half in halves if label in (c.label for c in half))
            shared = SharedDiagram(members) if len(members) > 1 else None
        return None

    @cached_property
    def results(self) -> tuple[Result, ...]:
        """The runs of the fitted records by IDAS."""
        return tuple(self.exact[run.record.name].simulator.run(self.problem.values_of(self.inner, run.record.name))
                     for run in self.problem.runs)

    @cached_property
    def cost(self) -> float:
        """Sum of squares of residuals and priors."""
        prior = self.problem.priors(self.inner)[0]
        return float(self.r @ self.r + prior @ prior)

    @cached_property
    def error(self) -> float:
        """Norm of the errors in the residuals that are due to the integrator of the search."""
        return float(np.linalg.norm(self.r - self.quick))

    @cached_property
    def moving(self) -> NDArray[np.int64]:
        """Indices of the free parameters that are not at an end of their range. A parameter at an end cannot reduce the
        residual further."""
        return np.flatnonzero(~self.problem.at_end(self.inner))

    @property
    def rough(self) -> bool:
        """True if the errors of the search runs exceed the share `ERRS` of the noise."""
        return self.error > ERRS * float(np.sqrt(len(self.r)))

    def split(self, s: Array) -> tuple[Array, Array]:
        """Split a residual vector s (n,) into the part that the free parameters cannot explain, (n,), and the step (m,)
        of the free parameters that cancels the other part."""
        J, priors = self.J[:, self.moving], self.priors[:, self.moving]
        normal = J.T @ J + priors.T @ priors
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        step = np.zeros(len(self.inner))
        step[self.moving] = np.linalg.lstsq(normal / scale[:, None] / scale, J.T @ s / scale, rcond=1e-12)[0] / scale
        return s - self.J @ step, -step


def plain_residuals(base: Base, runs: Sequence[Run], values: Mapping[str, float]) -> Array:
    """Residuals (n,) at the base model's parameter values and the additional `values`."""
    return np.concatenate([run.residuals(values_at(base, run, values))[0] for run in runs])


def values_at(base: Base, run: Run, more: Mapping[str, float]) -> dict[str, float]:
    """The parameter values of the base model that the changed diagram also has, and `more`."""
    known = run.assembly.parameter_values
    values = base.problem.values_of(base.inner, run.record.name)
    return {**{name: value for name, value in values.items() if name in known}, **more}


def sensitivities(base: Base, runs: Sequence[Run], values: Mapping[str, float]) -> dict[str, Array]:
    """Derivatives dr/da (n,) of the residuals with respect to each amplitude."""
    return responses(base, runs, values)[1]


def responses(base: Base, runs: Sequence[Run], values: Mapping[str, float]) -> tuple[Array, dict[str, Array]]:
    """Residuals (n,) at these values, and their derivatives dr/da (n,) with respect to each amplitude."""
    results = [run.residuals(values_at(base, run, values)) for run in runs]
    return np.concatenate([r for r, _ in results]), dict(zip(runs[0].names, np.hstack([J for _, J in results]), strict=True))
