"""Insertion and fit of a single effect that the user specifies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from heavebond.core import facade
from heavebond.core.errors import Problem, UsageError, listing, suggest
from heavebond.core.presentation import brief, number
from heavebond.core.progress import Progress
from heavebond.core.reporting import reporting
from heavebond.diagnosis.answer.confirm import at_fit, confirmed, first_entries, loaded
from heavebond.diagnosis.candidates.catalogue import Candidate
from heavebond.diagnosis.candidates.fixed_values import fixed_values
from heavebond.diagnosis.candidates.places import between_all_nodes, candidates
from heavebond.diagnosis.candidates.varying import varying_parameters
from heavebond.diagnosis.search.base_model import searched
from heavebond.diagnosis.search.step import single
from heavebond.diagnosis.search.stepwise import SelectedEffect
from heavebond.diagnosis.state import AddedEffect, LadderEntry
from heavebond.estimation.experiment import ExperimentOrFile
from heavebond.estimation.fitting import Fit, fit


@dataclass(frozen=True)
class Attempt(facade.Displayed):
    """Result of a single effect that the user specifies.

    * ladder: table of models without and with the effect.
    * finding: the effect.
    * bic_difference: change of BIC, negative if the effect improves the model.
    * earned: True if held-out data justify the effect.
    """

    ladder: tuple[LadderEntry, ...]
    finding: AddedEffect
    bic_difference: float
    earned: bool

    def __repr__(self) -> str:
        held_out = " > ".join(number(entry.chi2_held_out, 4) for entry in self.ladder)
        verdict = "justified by held-out data" if self.earned else "not justified by held-out data"
        return brief(self, self.ladder[-1].name, verdict, f"chi-square of held-out samples {held_out}, change of BIC "
                     f"{self.bic_difference:.4g}")

    def as_dict(self) -> dict[str, object]:
        """Return the figures for JSON."""
        return {"ladder": [r.as_dict() for r in self.ladder], "step": self.finding.as_dict(),
                "bic_difference": self.bic_difference, "earned": self.earned}


@reporting
def attempt(experiment: ExperimentOrFile, component: str, places: Sequence[str] = (), *,
            progress: Progress | None = None) -> Attempt:
    """Insert one effect into the diagram of an experiment and fit it.

    Example: `attempt("rig.yaml", "CoulombFriction", ["platform", "crown"])`. `component` is the name of a component with an
    `effect:`, of a dormant parameter (`cylinder.leakage`) or of a fixed parameter (`crown.m`). `places` are names of nodes,
    parts or outputs that determine the place. For a component whose effect attaches to a parameter (`LinearVariation`),
    `places` are the parameter and the variable, `["spring.c", "spring.s"]`. Values of the result are in SI. `progress` is
    called with a text at each step. Raises UsageError if no place or several places fit, and the errors of `fit`.
    """
    experiment, _ = loaded(experiment)
    say = progress or (lambda text: None)
    values = [c for c in fixed_values(experiment) if c.name == component]
    distant = [c for c in between_all_nodes(experiment) if set(c.where) <= set(places)]
    varies = any(c.name == component and c.effect is not None and "parameter" in c.effect.attaches
                 for c in experiment.model.library.effects())

    def fitted() -> Fit | None:
        return fit(experiment, progress=say) if experiment.free else None

    base = fitted() if varies else None
    if varies:  # the fitted model shows which parameters matter and which variables change
        problem = searched(at_fit(experiment, base))
        available = list(varying_parameters(problem, problem.start).candidates)
    else:
        available = [*candidates(experiment), *distant, *values]
    chosen = _named(available, component, places)
    base = base if varies else fitted()
    rungs = first_entries(experiment, base)
    stage = single(at_fit(experiment, base), chosen, say)
    if stage.chosen is None and not stage.trials:
        raise UsageError([Problem("try-broken", f"the diagram with {chosen.label} cannot be simulated", None,
                                  "Try another place, or add the component to a diagram and run it.")])
    trial = stage.trials[0]
    added = confirmed(SelectedEffect(replace(stage, chosen=trial), (trial,)), experiment)
    return Attempt((*rungs, added.rung), added, trial.bic - stage.bic, stage.chosen is not None)


def _named(available: Sequence[Candidate], component: str, places: Sequence[str]) -> Candidate:
    """Select the candidate that matches the component and the places; UsageError with suggestions if there is not exactly
    one."""
    kinds = [c for c in available if component in (c.component, c.name)]
    if not kinds and any(c.kind == component for c in available):
        alike = [c for c in available if c.kind == component]
        laws = dict.fromkeys(c.component for c in alike if _at_all(places, _places_of(c)))
        raise UsageError([Problem("try-class", f"'{component}' is a class of effects, not one of them", None,
                                  f"Try {listing(laws, 8)}." if laws else "`heavebond candidates` lists where it fits.")])
    if len(set(places)) < len(places):
        raise UsageError([Problem("try-place", f"'{places[0]}' is named twice; an effect between two nodes needs two", None,
                                  "Write --between and the names of two different nodes.")])
    if not kinds:
        names = dict.fromkeys([*(c.component for c in available), *(c.name for c in available if c.attaches == "in")])
        raise UsageError([Problem("try-unknown", f"no effect '{component}' fits anywhere in this diagram", None,
                                  suggest(component, names) or "`heavebond candidates` lists what does.")])
    at_place = [c for c in kinds if _at_all(places, _places_of(c))]
    exact = [c for c in at_place if _at_all(places, set(c.where)) and len(places) == len(c.where)]
    if len(at_place) == 1 or len(exact) == 1:
        return (exact or at_place)[0]
    listed = listing((c.place for c in at_place or kinds), 8)
    if not at_place:
        raise UsageError([Problem("try-place", f"{component} does not fit at {listing(places)}", None,
                                  f"It fits {listed}.")])
    raise UsageError([Problem("try-places", f"{component} fits at several places", None,
                              f"Say which, with --between NODE NODE or --at NAME: {listed}.")])


def _places_of(candidate: Candidate) -> set[str]:
    """Names that specify the place of a candidate: nodes and parts; for a variation, the parameter and the variable."""
    if candidate.change.vary:
        return {*candidate.change.vary, candidate.place.rpartition(" with ")[2]}
    return {*candidate.where, *candidate.change.nodes}


def _at_all(places: Sequence[str], known: set[str]) -> bool:
    """True if each of `places` is a known node, part or output, or a port of a known part (`inlet.a`)."""
    return all(place in known or place.rpartition(".")[0] in known for place in places)
