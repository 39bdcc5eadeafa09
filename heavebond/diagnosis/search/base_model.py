"""The base model of a search: a diagram at the optimum of its free parameters, beside which candidates are scored and
refitted.

Its runs are made twice: by IDAS for reported figures, and by the integrator of the search for comparisons with runs of
changed diagrams, so that the errors of the two integrations cancel.

Many candidates share one diagram. To insert a candidate and assemble the diagram takes longer than the runs of its score. A
law without states does not change the machine while its amplitude is neutral, whatever other laws are inactive beside it.
So candidates that do not change the same part are put into one diagram: it is assembled once, and the equations with the
derivatives to all amplitudes are generated once. Each candidate has runs of its own in it. (A refit, which moves every free
parameter, has a diagram of its own.)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, reduce

import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import HeavebondError
from heavebond.diagnosis.candidates.catalogue import Candidate
from heavebond.estimation.comparison import assemble_for, driven_by
from heavebond.estimation.experiment import Experiment, Record, changed_experiment
from heavebond.estimation.residuals import Residuals, Run
from heavebond.language.definition import Component
from heavebond.language.edits import Change
from heavebond.language.library import Library
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.quick_simulation import QuickSimulator, Unexplained
from heavebond.numerics.simulator import Tolerances
from heavebond.text.expression import Call, Expr, children

ADDING = ("across", "at", "in", "input", "channel", "parameter")  # ways to attach that leave what is there as it is
MOST = 12  # candidates in one diagram: what sleeps is evaluated in every run


@dataclass(frozen=True)
class SharedDiagram:
    """Candidates that are put into a diagram together, the parts of each under names of their own."""

    members: tuple[Candidate, ...]

    @property
    def change(self) -> Change:
        """The change that puts all of them there."""
        return reduce(Change.joined, (c.change for c in self.members))

    @property
    def amplitudes(self) -> tuple[str, ...]:
        """Those of all of them."""
        return tuple(n.name for c in self.members for n in c.vanishing)

    def member(self, label: str) -> Candidate:
        """A candidate as it stands there."""
        return next(c for c in self.members if c.label == label)

    def half(self, label: str) -> SharedDiagram | None:
        """The half of them to which a candidate belongs; None where that is the candidate alone."""
        middle = len(self.members) // 2
        found = next(part for part in (self.members[:middle], self.members[middle:]) if label in (c.label for c in part))
        return SharedDiagram(found) if len(found) > 1 else None


def shared_diagrams(library: Library, candidates: Sequence[Candidate]) -> dict[str, SharedDiagram]:
    """The diagram that a candidate shares with others, by its label, for those that share one. In one diagram are those that
    name nothing that another one names: many where the parts of each have names of their own."""
    groups: list[tuple[set[str], list[Candidate]]] = []
    for candidate in candidates:
        if not _may_sleep_beside_others(library, candidate):
            continue
        own = _taken(candidate.change)
        for taken, group in groups:
            if len(group) < MOST and not own & taken and (group[0].attaches == "input") is (candidate.attaches == "input"):
                taken.update(own)
                group.append(candidate)
                break
        else:
            groups.append((own, [candidate]))
    return {candidate.label: shared for _, group in groups if len(group) > 1
            for shared in [SharedDiagram(tuple(group))] for candidate in group}


def _taken(change: Change) -> set[str]:
    """What no two changes of one diagram may both name: parts, nodes that are new, ports that are taken off a node, values,
    initial values, channels and inputs."""
    ends = [(node, end) for node, joined in change.nodes.items() for end in joined]
    new = {node for node, end in ends if end[0] not in "+-"}
    return {*change.components, *new, *(end for _, end in ends if end[0] == "-"), *change.settings, *change.initial,
            *(f"channel {name}" for name in change.channels), *(f"input {name}" for name in change.moved)}


def _may_sleep_beside_others(library: Library, candidate: Candidate) -> bool:
    """Whether it can stand in the diagram at amplitude zero, with no number that is set before its runs, and its parts have
    neither states nor events."""
    return candidate.vanishes and candidate.attaches in ADDING and \
        not any(n.sought is not None and n.sought.held for n in candidate.numbers) and \
        all(_is_static(library.component(part.kind)) for part in candidate.change.components.values())


def _is_static(component: Component) -> bool:
    return not (component.composite or component.when) and not any(
        _differentiates(side) for line in component.equations for side in (line.tree.left, line.tree.right))


def _differentiates(expr: Expr) -> bool:
    return (isinstance(expr, Call) and expr.function == "der") or any(map(_differentiates, children(expr)))


# A search needs no more where the runs then err by less than this share of the noise (rms): what they err by, candidates
# would explain. Where a record moves so far above its noise that they err by more, each is made that much finer, so often.
SEARCH = Tolerances(1e-5, 1e-7)
ERRS, FINER, TIMES = 0.05, 0.1, 2
DIAGRAMS = 200  # changed diagrams that are kept, of about 1 MB each


def searched(experiment: Experiment, tolerances: Tolerances = SEARCH) -> Residuals:
    """The least squares problem of an experiment with runs for a search."""
    fitted = [r for r in experiment.records.values() if r.use == "fit"]
    return Residuals(experiment, runs=[Run(experiment, record, list(experiment.free), tolerances, kind=QuickSimulator)
                                       for record in fitted])


def finer(problem: Residuals) -> Residuals:
    """The same problem with runs that err by less."""
    then = problem.runs[0].simulator.tolerances.scaled(FINER)
    return Residuals(problem.experiment, runs=[run.again(run.names, {}, QuickSimulator, then) for run in problem.runs])


def exact_runs(experiment: Experiment, fitted: Sequence[Run], like: Mapping[str, Run] | None = None) -> dict[str, Run]:
    """Runs of all records by IDAS; those fitted as given, of the others those of another diagram (`like`) may be there."""
    own = {run.record.name: run.again([], {}, Unexplained) for run in fitted}
    like = like or {}
    first = fitted[0]

    def other(record: Record) -> Run:
        return Run(experiment, record, [], first.simulator.tolerances, kind=Unexplained, like=like.get(record.name),
                   assembly=driven_by(first.assembly, experiment, first.record, record))

    return {name: own.get(name) or other(record) for name, record in experiment.records.items()}


@dataclass(frozen=True)
class Diagram:
    """A changed diagram: the experiment with it, and its equations for each of the records that are fitted."""

    experiment: Experiment
    assemblies: tuple[Assembly, ...]


@dataclass(frozen=True)
class Base:
    """The base model at its optimum: residuals r (n,) by IDAS and `quick` by the integrator of the search, Jacobian J
    (n, m), the derivatives of the priors (priors, m), the inner unknowns (m,), and runs of all records by IDAS."""

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
        """The base at a point of its least squares problem."""
        J = problem.evaluate(inner)[1]
        exact = exact_runs(problem.experiment, problem.runs)
        r = np.concatenate([exact[run.record.name].residuals(problem.values_of(inner, run.record.name))[0]
                            for run in problem.runs])
        quick = np.concatenate([run.again([], {}, QuickSimulator).residuals(problem.values_of(inner, run.record.name))[0]
                                for run in problem.runs])
        return cls(problem, inner, r, quick, J, problem.priors(inner)[1], exact)

    def diagram(self, change: Change) -> Diagram:
        """The changed diagram; one that is scored and then refitted is assembled once. HeavebondError where it cannot be."""
        key = repr(change)
        if key not in self.diagrams:
            changed = changed_experiment(self.problem.experiment, change)
            records = [changed.records[run.record.name] for run in self.problem.runs]
            made = Diagram(changed, tuple(assemble_for(changed, record) for record in records))
            if len(self.diagrams) == DIAGRAMS:
                del self.diagrams[next(iter(self.diagrams))]
            self.diagrams[key] = made
        return self.diagrams[key]

    def runs(self, change: Change, names: Sequence[str], among: Sequence[str] = ()) -> list[Run]:
        """The fitted records with the changed diagram, whose parameters `names` are to be moved, `among` others that other
        runs with it move."""
        made = self.diagram(change)
        pairs = zip(self.problem.runs, made.assemblies, strict=True)
        return [Run(made.experiment, run.record, list(names), run.simulator.tolerances, kind=QuickSimulator, like=run,
                    assembly=assembly, among=among) for run, assembly in pairs]

    def sleeping(self, shared: SharedDiagram | None, label: str) -> list[Run] | None:
        """The fitted records with the diagram that a candidate shares with others, without sensitivities: that of all of
        them, or of as many as leave the base model what it is while they sleep. None where the candidate has none."""
        while shared is not None:
            key = repr(shared.members)
            if key not in self.shared:
                self.shared[key] = self._sleeping(shared)
            if (found := self.shared[key]) is not None:
                return found
            shared = shared.half(label)
        return None

    def _sleeping(self, shared: SharedDiagram) -> list[Run] | None:
        try:
            runs = self.runs(shared.change, [], shared.amplitudes)
            alike = all(_same_unknowns(run.assembly, own.assembly) for run, own in zip(runs, self.problem.runs, strict=True))
            return runs if alike and np.linalg.norm(plain_residuals(self, runs, {}) - self.quick) <= self.error else None
        except HeavebondError:
            return None

    @cached_property
    def cost(self) -> float:
        """The sum of squares of data and priors."""
        prior = self.problem.priors(self.inner)[0]
        return float(self.r @ self.r + prior @ prior)

    @cached_property
    def error(self) -> float:
        """The length of what the integrator of the search does to the residuals by its errors."""
        return float(np.linalg.norm(self.r - self.quick))

    @cached_property
    def moving(self) -> NDArray[np.int64]:
        """The free parameters (indices) that are not held by an end of their range: one that is can take nothing more."""
        return np.flatnonzero(~self.problem.at_end(self.inner))

    @property
    def rough(self) -> bool:
        """Whether the runs of the search err by more than is small beside the noise."""
        return self.error > ERRS * float(np.sqrt(len(self.r)))

    def split(self, s: Array) -> tuple[Array, Array]:
        """s without what the free parameters take of it, and the step of theirs that takes it: (n,), (m,)."""
        J, priors = self.J[:, self.moving], self.priors[:, self.moving]
        normal = J.T @ J + priors.T @ priors
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        step = np.zeros(len(self.inner))
        step[self.moving] = np.linalg.lstsq(normal / scale[:, None] / scale, J.T @ s / scale, rcond=1e-12)[0] / scale
        return s - self.J @ step, -step


def plain_residuals(base: Base, runs: Sequence[Run], values: Mapping[str, float]) -> Array:
    """The residuals (n,) with the base's values and these."""
    return np.concatenate([run.residuals(values_at(base, run, values))[0] for run in runs])


def _same_unknowns(one: Assembly, other: Assembly) -> bool:
    """Whether two diagrams have the same states and algebraic unknowns, and as many events."""
    return one.state_names == other.state_names and one.algebraic_names == other.algebraic_names and \
        len(one.flat.events) == len(other.flat.events)


def values_at(base: Base, run: Run, more: Mapping[str, float]) -> dict[str, float]:
    """The base's values that the changed diagram has, and `more`."""
    known = run.assembly.parameter_values
    values = base.problem.values_of(base.inner, run.record.name)
    return {**{name: value for name, value in values.items() if name in known}, **more}


def sensitivities(base: Base, runs: Sequence[Run], values: Mapping[str, float]) -> dict[str, Array]:
    """d r / d a (n,) for each amplitude."""
    return responses(base, runs, values)[1]


def responses(base: Base, runs: Sequence[Run], values: Mapping[str, float]) -> tuple[Array, dict[str, Array]]:
    """The residuals (n,) with these values, and d r / d a (n,) for each amplitude."""
    found = [run.residuals(values_at(base, run, values)) for run in runs]
    return np.concatenate([r for r, _ in found]), dict(zip(runs[0].names, np.hstack([J for _, J in found]), strict=True))
