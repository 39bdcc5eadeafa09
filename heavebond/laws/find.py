"""Search of the law that a model lacks, as a formula with units.

1. The unknown input at each place is estimated from the records (see `localise`).
2. At the likeliest places closed forms are fitted to the innovations and composed to formulas (see `laws.regression`).
3. The formulas that leave least with each number of parameters are put into the diagram as components and refitted in
   simulation, with all free parameters, by exact sensitivities; so are the laws of the catalogue at the same place.
4. If the simplest formula that leaves as little as the best one leaves much more than the noise, the diagram with it is the
   model of a further search at its place: about the motion with the first part of a law, which stops and slides when the
   machine does, further parts are found that the first motion hides. They are added to it, and all are refitted together.
5. A formula counts if BIC falls by strong evidence, and the error on held-out data by more than chance. Formulas are
   compared by their errors on data to which their parameters were not fitted (cross-validated, and held out). Of those that
   the records cannot distinguish from the best, and that are not much less probable, the one with the fewest parameters is
   the simplest.

The probability of a formula is its weight by bootstrapped predictive likelihoods (pseudo-BMA+; Y. Yao, A. Vehtari, D.
Simpson, A. Gelman, 2018, doi:10.1214/17-BA1091) times exp(-k/2 ln b) for its k parameters, with b the number of
independent blocks that the records are worth. The rest is the probability of another form, with the odds that a diagnosis
gives to a law outside its catalogue (see `diagnosis.evidence.probability`): they grow with the prediction error that the
best formula leaves above the noise.

The input that would decide between formulas that the records cannot distinguish is designed as for the alternatives of a
diagnosis (see `experiment_design.separation`).
"""

from __future__ import annotations

import atexit
import re
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from copy import copy
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from heavebond.core import facade
from heavebond.core.errors import HeavebondError, Problem, UsageError, listing, suggest
from heavebond.core.presentation import brief, number
from heavebond.core.progress import Progress
from heavebond.core.reporting import reporting
from heavebond.diagnosis.answer.files import Targets, write_findings
from heavebond.diagnosis.candidates.catalogue import UNKNOWN, Candidate, EffectNumber, fresh, quantity, site_of, snake
from heavebond.diagnosis.candidates.places import candidates
from heavebond.diagnosis.evidence.comparison import STRONG, compared, loss
from heavebond.diagnosis.evidence.prediction import SELECTION, TEST, block_length, predictive_errors
from heavebond.diagnosis.evidence.probability import CALIBRATION, law_weights, parts, percent
from heavebond.diagnosis.evidence.residual_tests import is_noise
from heavebond.diagnosis.search.base_model import Base
from heavebond.diagnosis.search.refit import Refit, begun, bic, followed, refitted_at
from heavebond.diagnosis.search.scoring import scored
from heavebond.diagnosis.search.step import EARNED, fallen, fitted_base
from heavebond.diagnosis.state import AddedEffect, ladder_entry
from heavebond.equations.places import Place
from heavebond.estimation.channel_noise import with_noise
from heavebond.estimation.experiment import Experiment, ExperimentOrFile, Free, changed_experiment, load_experiment
from heavebond.estimation.fitting import fit
from heavebond.experiment_design.separation import Alternative, Separation, separate
from heavebond.language.definition import SearchRange
from heavebond.language.edits import Change, Part, write_new
from heavebond.laws.formula import Formula
from heavebond.laws.regression import at_place, composed
from heavebond.localise.constants import INPUT_ESTIMATION
from heavebond.localise.curves import Variable
from heavebond.localise.input_estimation import Estimate, Search
from heavebond.localise.ltv_model import with_values
from heavebond.localise.misfit import ImpliedInput, beginning, estimated_inputs, implied_inputs, input_at
from heavebond.localise.regressors import Regressors
from heavebond.numerics.dae import Array

NOISE = 2.0  # mean squared prediction error, in noise variances, from which on a formula is only an approximation
PROBABLE = 0.1  # share of the probability of the most probable formula from which on a simpler one can be the answer
PLACES = 2  # at most, at which formulas are sought
VARIABLES = 4  # of a place that are tried: those across it and its positions first
FURTHER, LESS = 2, 0.7  # further searches, and the share of the loss that each must leave at most for another one
LISTED = 3  # formulas that are named beside the answer
CATALOGUE = 5  # laws of the catalogue at the place that are refitted beside them: one of each class, by their scores


def _digits(value: float, ends: tuple[float, float] | None) -> int:
    """Digits with which a value is shown, so that its interval has two."""
    if ends is None or not ends[1] > ends[0] or value == 0:
        return 4
    return int(np.clip(np.ceil(np.log10(abs(value) / (ends[1] - ends[0]))) + 2, 3, 9))


@dataclass(frozen=True)
class FoundLaw:
    """A formula after its refit in simulation.

    place: names of the nodes; text: the formula; name: of its component; numbers: fitted values (SI) by name, with 95 %
    intervals in `intervals` (of the simplest formula), and their `covariance` (SI) in the order of the fitted ones of
    `formula.numbers`; covered: the range of each variable in the fitted records (SI), by its formula in the diagram;
    implied: the input that the records ask for at the place; finding: the law in the diagram, fitted to all samples;
    chi2_fit, chi2_held_out: chi-square per sample; loss: mean squared prediction error of all samples in units of the
    noise; probability: see the module.
    """

    formula: Formula
    refit: Refit
    numbers: Mapping[str, float]
    probability: float
    name: str = ""
    intervals: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)), repr=False)
    implied: tuple[ImpliedInput, ...] = field(default=(), repr=False)
    finding: AddedEffect | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        return brief(self, self.text, self.values_text)

    @property
    def place(self) -> tuple[str, ...]:
        """The names of its nodes."""
        return tuple(node.name for node in self.formula.place.nodes)

    @property
    def text(self) -> str:
        """The formula with the names of its parameters."""
        return self.formula.text

    @property
    def values_text(self) -> str:
        """The parameters with their values, and 95 % intervals if they are known."""
        texts = []
        for n in self.formula.numbers:
            value, ends = self.numbers.get(n.name, n.value), self.intervals.get(n.name)
            digits = _digits(value, ends)
            interval = f" ({number(ends[0], digits)} to {number(ends[1], digits)})" if ends is not None else \
                " (not fitted)" if not n.fitted else ""
            unit = "" if n.unit.text == "1" else f" {n.unit.text}"
            texts.append(f"{n.name} = {number(value, digits)}{unit}{interval}")
        return ", ".join(texts)

    @property
    def chi2_fit(self) -> float:
        """Chi-square per sample of the fitted records."""
        return self.refit.chi2_fit

    @property
    def chi2_held_out(self) -> float:
        """Chi-square per sample of the data that were held out."""
        return self.refit.chi2_held_out

    @property
    def loss(self) -> float:
        """Mean squared prediction error of all samples in units of the noise."""
        return loss(self.refit)

    @property
    def covered(self) -> dict[str, tuple[float, float]]:
        """The range of each variable in the fitted records, in SI."""
        return {name: (motion.low, motion.high) for name, motion in self.formula.motions.items()
                if name in self.formula.variables}

    def value(self, motion: Mapping[str, Array], time: Array) -> Array:
        """The law (N,) in SI at values (N,) of its variables (SI), by their formulas in the diagram, at times (N,) in s."""
        return self.formula.value(motion, time, self.numbers)

    def component(self, name: str = "") -> str:
        """The text of a component file with the law, its values and intervals."""
        notes = {key: f"({number(low, digits)} to {number(high, digits)})" for key, (low, high) in self.intervals.items()
                 for digits in [_digits(self.numbers[key], (low, high))]}
        ranges = ", ".join(f"{low:.4g} .. {high:.4g} {v.unit} of the {v.phrase}" for v, _ in self.formula.variables.values()
                           for low, high in [self.covered[v.formula]])
        restrictions = f"Found for {ranges}; beyond that it is an extrapolation."
        return self.formula.component(name or self.name, self.numbers, notes, restrictions)

    def as_dict(self) -> dict[str, object]:
        """The figures, for machines; values in SI."""
        return {"place": list(self.place), "formula": self.text, "numbers": dict(self.numbers),
                "chi2_held_out": self.chi2_held_out, "covered": {k: list(v) for k, v in self.covered.items()},
                "intervals": {k: list(v) for k, v in self.intervals.items()},
                "probability": self.probability, "chi2_fit": self.chi2_fit}


@dataclass(frozen=True)
class Laws(facade.Displayed):
    """The answer: whether an effect is missing at all, the formulas (most probable first), the laws of the catalogue at the
    same places, and the formula with the fewest parameters among those that the records cannot distinguish from the best;
    `known` is the law of the catalogue that predicts as well as it with no more parameters. `chi2`: per sample of the fitted
    and of the held-out data without a formula; `failed`: no formula could be simulated. `alike`: further formulas and laws
    of the catalogue that the records cannot distinguish from the best, in words; `separation`: the input that would
    distinguish them from the simplest, if it was asked for."""

    experiment: Experiment
    missing: bool
    laws: tuple[FoundLaw, ...]
    catalogue: tuple[Refit, ...] = ()
    simplest: FoundLaw | None = None
    known: Refit | None = None
    chi2: tuple[float, float] = (np.nan, np.nan)
    failed: bool = False
    alike: tuple[str, ...] = ()
    separation: Separation | None = None

    def __repr__(self) -> str:
        return brief(self, self.experiment.name, *self.words)

    @property
    def words(self) -> tuple[str, ...]:
        """The answer in sentences."""
        if not self.missing:
            return ("No effect is missing: the parameters explain the records to the noise.",)
        best = self.simplest
        if best is None and self.failed:
            return ("An effect is missing, but no formula could be simulated at the likeliest places. `heavebond diagnose` "
                    "tries the laws of the catalogue.",)
        if best is None:
            return ("No formula at the likeliest places lowers the error by more than chance.",)
        words = [f"{best.formula.place.words[:1].upper()}{best.formula.place.words[1:]}: {best.text}",
                 f"with {best.values_text}.",
                 f"Probability {percent(best.probability)}. Chi-square per sample falls from {number(self.chi2[0], 3)} to "
                 f"{number(best.chi2_fit, 3)} on fitted data and from {number(self.chi2[1], 3)} to "
                 f"{number(best.chi2_held_out, 3)} on held-out data."]
        if best.loss > NOISE:
            words.append(f"It leaves {number(best.loss, 3)} times the noise: the law has another form, or more is missing. "
                         "The formula is an approximation within the motion of the records. `heavebond diagnose` searches "
                         "several effects at once.")
        if self.known is not None:
            words.append(f"The catalogue's {self.known.candidate.label} predicts as well with no more parameters "
                         f"(chi-square {number(self.known.chi2_held_out, 3)} held out): use that law.")
        if self.alike:
            words.append(f"The records cannot distinguish it from {listing(self.alike, LISTED)}.")
            words += self.separation.words if self.separation is not None else [
                "`heavebond laws --decide FILE` proposes the input that would."]
        return tuple(words)

    def as_dict(self) -> dict[str, object]:
        """The answer, for machines; values in SI."""
        return {"missing": self.missing, "words": list(self.words), "laws": [law.as_dict() for law in self.laws],
                "simplest": self.simplest.as_dict() if self.simplest is not None else None,
                "catalogue": [{**t.candidate.as_dict(), "chi2_fit": t.chi2_fit, "chi2_held_out": t.chi2_held_out}
                              for t in self.catalogue],
                "known": self.known.candidate.label if self.known is not None else None, "alike": list(self.alike),
                "separation": self.separation.as_dict() if self.separation is not None else None}


@reporting
def find_laws(experiment: ExperimentOrFile, *, at: Sequence[str] = (), separation: bool = False,
              progress: Progress | None = None) -> Laws:
    """Search a formula, with units, for the law that the model of an experiment lacks.

    `at` names the nodes of the place (one, or two that a component joins); without it the likeliest places are searched.
    With `separation`, the input is designed that would distinguish formulas which the records cannot. `progress` is called
    with a text at each step. Raises UsageError for an unknown place and what `compare` raises.
    """
    say = progress or (lambda text: None)
    original = with_noise(load_experiment(experiment))
    searched = beginning(original, None)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        search, estimate = estimated_inputs(searched, folder, None, say)
        if estimate.chance >= INPUT_ESTIMATION.level and not at:
            return Laws(original, False, ())
        formulas, places = list[tuple[Formula, Array]](), _places(search, estimate, at)
        for place in places:
            say(f"composing formulas {place.place.words}")
            formulas += _formulas(search, estimate, place)
        say("fitting the free parameters")
        components = {_kind(k): formula.component(_kind(k), effect=False) for k, (formula, _) in enumerate(formulas)}
        # the components of formulas remain until the program ends: a library reads them when a diagram is assembled
        component_folder = Path(tempfile.mkdtemp(prefix="heavebond_laws_"))
        atexit.register(shutil.rmtree, component_folder, ignore_errors=True)
        base = fitted_base(_with_components(searched, components, component_folder))
        known = [refit for place in places for refit in _of_catalogue(base, place.place, say)]
        laws = _refitted(base, search, formulas, say)
        answer, alternatives = _answer(original, base, laws, known)
        for turn in range(FURTHER):
            if answer.simplest is None or answer.simplest.loss < NOISE:
                break
            further = _further(base, answer.simplest, folder / f"further_{turn}", component_folder, say)
            if not further:
                break
            laws, before = [*laws, *further], answer.simplest
            answer, alternatives = _answer(original, base, laws, known)
            if answer.simplest is None or answer.simplest.loss > LESS * before.loss:
                break
        law = answer.simplest
        if law is None:
            return answer
        if separation and len(alternatives) > 1:
            say("designing the experiment that decides")
            answer = replace(answer, separation=_separation(searched, alternatives, say))
        say(f"fitting all samples with {law.text}")
        place = next(p for p in places if p.place.name == law.formula.place.name)
        exact = replace(_confirmed(original, law, component_folder, say), implied=_implied(search, place, law.refit.values))
        return replace(answer, simplest=exact, laws=tuple(exact if listed is law else listed for listed in answer.laws))


@dataclass(frozen=True)
class _Sought:
    """A place at which formulas are sought: the ratio of an input there to the input of its group, and the estimate of the
    latter: values (N,) with their deviations (N,), its derivatives (N, k) by the free parameters, and the local signals."""

    place: Place
    ratio: float
    value: Array
    deviation: Array
    slopes: Array
    local: Regressors


def _places(search: Search, estimate: Estimate, at: Sequence[str]) -> list[_Sought]:
    """The places at which formulas are sought; of places that act alike the first pair."""
    def sought(k: int, place: Place) -> _Sought:
        group = estimate.full[k].group
        return _Sought(place, group.ratios[group.places.index(place)], *input_at(search, estimate, k, estimate.full[k]))

    if at:
        for k, ranked in enumerate(estimate.full):
            for place in ranked.group.places:
                if {node.name for node in place.nodes} == set(at):
                    return [sought(k, place)]
        names = [place.name for ranked in estimate.full for place in ranked.group.places]
        raise UsageError([Problem("place-unknown", f"nothing was estimated at '{'-'.join(at)}'", None,
                                  suggest("-".join(at), names) or f"Places: {', '.join(names)}.")])
    best = estimate.full[0].likelihood
    return [sought(k, next((p for p in ranked.group.places if len(p.nodes) == 2), ranked.group.places[0]))
            for k, ranked in enumerate(estimate.full) if best - ranked.likelihood < INPUT_ESTIMATION.distinct][:PLACES]


def _formulas(search: Search, estimate: Estimate, sought: _Sought) -> list[tuple[Formula, Array]]:
    """The formulas at a place that are worth a refit, each with the free parameters q (k,) about their priors."""
    place = sought.place
    variables = [v for v in sought.local.variables(place) if v.kind != "rate"]
    at_ports = [v for v in variables if v.kind in ("across", "position")] + _temperatures(sought)
    problem = at_place(search, estimate, place, [*at_ports, *(v for v in variables if v not in at_ports)][:VARIABLES])
    formulas = [(Formula(place, c.parts, problem.motions, tuple(problem.fixed(part) for part in c.parts)),
                 c.q + search.centre(estimate.systems)) for c in composed(problem)]
    return [(formula, q) for formula, q in formulas if formula.possible]


def _temperatures(sought: _Sought) -> list[Variable]:
    """The further across variables of the nodes of a place: temperatures of gas or oil that are no constant."""
    domain, signals = sought.place.nodes[0].domain, sought.local.signals
    variables = []
    for name in (f"{node.name}.{member}" for member in domain.across[1:] for node in sought.place.nodes):
        values = signals.get(name)
        if values is not None and np.ptp(values) > INPUT_ESTIMATION.still * float(np.abs(values).max()):
            member = domain.members[name.rpartition(".")[2]]
            variables.append(Variable("pressure", f"{member.noun} {name}", name, member.unit.text, values,
                                      np.gradient(values) > 0))
    return variables


def _kind(k: int) -> str:
    """The name of the component of the k-th formula."""
    return f"FoundLaw{k + 1}"


def _with_components(experiment: Experiment, components: Mapping[str, str], folder: Path) -> Experiment:
    """The experiment with further components in its library, whose texts by name are written to files of a folder."""
    paths = {kind: folder / f"{snake(kind)}.yaml" for kind in components}
    for kind, text in components.items():
        paths[kind].write_text(text, encoding="utf-8")
    model = experiment.model
    library = replace(model.library, files={**model.library.files, **paths})
    return replace(experiment, model=replace(model, library=library))


def _further(base: Base, law: FoundLaw, folder: Path, component_folder: Path, say: Progress) -> list[tuple[Formula, Refit]]:
    """Formulas that add parts to a law, from the records about the motion with it; refitted in simulation."""
    say(f"searching parts beside {law.text}")
    folder.mkdir()
    experiment = law.refit.experiment
    values = {name: value for name, value in law.refit.values.items()
              if name in experiment.free and not name.startswith("initial.")}
    try:
        model = experiment.model.with_parameters(values)
        search, estimate = estimated_inputs(replace(experiment, model=model), folder, None, say)
    except HeavebondError:
        return []
    place = next((p for p in _places(search, estimate, ()) if p.place.name == law.formula.place.name), None)
    if place is None:
        return []
    first, formulas = law.formula.with_numbers(law.numbers), list[tuple[Formula, Array]]()
    for formula, q in _formulas(search, estimate, place):
        if not first.key & formula.key:
            formulas.append((first.joined(formula), q))
    number = len(base.problem.experiment.model.library.files)  # other names than those of the formulas before
    components = {_kind(number + k): formula.component(_kind(number + k), effect=False)
                  for k, (formula, _) in enumerate(formulas)}
    problem = copy(base.problem)
    problem.experiment = _with_components(base.problem.experiment, components, component_folder)
    return _refitted(replace(base, problem=problem, diagrams={}, shared={}), search, formulas, say, number)


def _refitted(base: Base, search: Search, formulas: Sequence[tuple[Formula, Array]], say: Progress, number: int = 0
              ) -> list[tuple[Formula, Refit]]:
    """The formulas refitted in simulation, each as a component in the diagram; of one formula from several starts the best
    refit."""
    refits: dict[tuple[str, frozenset[tuple[str, ...]]], tuple[Formula, Refit]] = {}
    for k, (formula, q) in enumerate(formulas):
        say(f"refitting {k + 1} of {len(formulas)}: {formula.text}")
        candidate = candidate_of(base.problem.experiment, formula, _kind(number + k))
        numbers = {f"{candidate.name}.{n.name}": n for n in formula.numbers if n.range is not None}
        values = {**with_values(search.known, q[search.columns(search.sides[0].record.name)]),
                  **{name: n.value for name, n in numbers.items()}}
        trial = refitted_at(base, candidate, values, {name: n.range for name, n in numbers.items() if n.range is not None},
                            progress=say)
        if trial is not None and trial.errors is not None:
            key = (formula.place.name, formula.key)
            if key not in refits or loss(trial) < loss(refits[key][1]):
                refits[key] = (formula, trial)
    return list(refits.values())


def candidate_of(experiment: Experiment, formula: Formula, kind: str) -> Candidate:
    """The law of a formula as a candidate at its place, with a component of the library."""
    site = site_of(experiment)
    name = fresh(site, snake(kind))
    ends: dict[str, tuple[str, ...]] = {}
    for port, node in zip("ab", formula.place.nodes, strict=False):
        ends[node.name] = (f"+{name}.{port}",)
    inputs = {s: f"={variable.formula}" for s, variable in formula.inputs.items()}
    numbers = tuple(EffectNumber(f"{name}.{n.name}", n.unit, None, None, SearchRange(n.range, ""), False, n.value)
                    for n in formula.numbers if n.range is not None)
    return Candidate(name, kind, "empirical law", formula.text, formula.place.words, tuple(ends),
                     Change({name: Part(kind, inputs)}, ends), numbers, "across" if len(ends) == 2 else "at")


def _of_catalogue(base: Base, place: Place, say: Progress) -> list[Refit]:
    """The laws of the catalogue at a place with the largest scores, refitted."""
    nodes = {node.name for node in place.nodes}
    at_place = [c for c in candidates(base.problem.experiment) if c.kind != UNKNOWN and set(c.where) == nodes
                and c.attaches in ("across", "at") and not c.members]
    scores = []
    for candidate in at_place:
        with suppress(HeavebondError):
            candidate_scores = scored(base, candidate)
            if candidate_scores:
                scores.append((max(s.gain for s in candidate_scores), candidate, candidate_scores))
    refits = []
    best_of_each = {candidate.kind: (gain, candidate, its) for gain, candidate, its in sorted(scores, key=lambda s: s[0])}
    for _, candidate, candidate_scores in sorted(best_of_each.values(), key=lambda entry: -entry[0])[:CATALOGUE]:
        say(f"refitting {candidate.label}")
        trial = begun(base, candidate, candidate_scores)
        if trial is not None:
            refits.append(followed(base, trial, candidate_scores))
    return [t for t in refits if t.errors is not None]


def _answer(experiment: Experiment, base: Base, laws: Sequence[tuple[Formula, Refit]], known: Sequence[Refit]
            ) -> tuple[Laws, list[Alternative]]:
    """The answer from the refits of formulas and of laws of the catalogue, and the simplest formula with those that the
    records cannot distinguish from it as alternatives."""
    before = predictive_errors(base.problem, base.inner, base.exact, base.r)
    trials, comparable = ([t for t in refits if len(t.errors.sums if t.errors is not None else ()) == len(before.sums)]
                          for refits in ([refit for _, refit in laws], known))
    chi2 = (float(base.r @ base.r) / len(base.r), before.mean(SELECTION, TEST))
    samples = before.samples(SELECTION, TEST)
    without = bic(base.cost, len(base.r), len(base.inner))
    trials = [t for t in trials if t.bic < without - STRONG
              and (not samples or fallen(chi2[1], t.chi2_held_out, samples) > EARNED)]
    if not trials:
        return Laws(experiment, not is_noise(chi2[0], chi2[1], samples), (), tuple(known), chi2=chi2, failed=not laws), []
    best = min(trials, key=loss)
    alike = compared(best, trials, before).members
    weights = law_weights(trials)[CALIBRATION.temperature]
    assert best.errors is not None
    length = block_length(np.asarray(best.errors.sums, float), best.errors.stretch)[0]
    blocks = max(2.0, len(before.sums) / max(length, 1.0))
    counts = {id(refit): formula.count for formula, refit in laws}
    odds = np.array([w * blocks**(-0.5 * (counts[id(t)] - counts[id(best)])) for t, w in zip(trials, weights, strict=True)])
    _, _, outside, among = map(float, parts(CALIBRATION, 0.0, 0.0, max(1.0, loss(best))))
    shares = odds / odds.sum() * among / (among + outside)
    fitted_laws = []
    for formula, refit in laws:
        if refit in trials:
            prefix = f"{refit.candidate.name}."
            numbers = {name.removeprefix(prefix): value for name, value in refit.values.items() if name.startswith(prefix)}
            numbers |= {n.name: n.value for n in formula.numbers if not n.fitted}
            fitted_laws.append(FoundLaw(formula, refit, numbers, float(shares[trials.index(refit)])))
    members = [law for law in fitted_laws if law.refit in alike]
    probable = PROBABLE * max(law.probability for law in members)
    simplest = min((law for law in members if law.probability >= probable), key=lambda law: (law.formula.count, law.loss))
    catalogue = sorted(known, key=loss)
    as_good = next((t for t in catalogue if len(t.candidate.numbers) <= simplest.formula.count
                    and loss(t) <= loss(simplest.refit)), None)
    ordered = sorted(fitted_laws, key=lambda law: -law.probability)
    same = compared(best, [*trials, *comparable], before).members
    alternatives = _alternatives(simplest, [law for law in ordered if law.refit in alike],
                                 [t for t in comparable if t in same])
    return Laws(experiment, True, tuple(ordered), tuple(catalogue), simplest, as_good, chi2,
                alike=tuple(a.label for a in alternatives[1:])), alternatives


def _alternatives(simplest: FoundLaw, laws: Sequence[FoundLaw], known: Sequence[Refit]) -> list[Alternative]:
    """The simplest formula and those that are no sum of another one and further parts, and laws of the catalogue."""
    chosen, keys = [simplest], [simplest.formula.key]
    for law in sorted(laws, key=lambda law: (law.formula.count, -law.probability)):
        if not any(key <= law.formula.key and law.place == earlier.place for key, earlier in zip(keys, chosen, strict=True)):
            chosen.append(law)
            keys.append(law.formula.key)
    one_place = len({law.place for law in chosen}) == 1
    refits = [(law.text if one_place else f"{law.text} ({law.formula.place.words})", law.refit) for law in chosen]
    refits[1:] = sorted([*refits[1:], *((t.candidate.label, t) for t in known)], key=lambda entry: loss(entry[1]))
    return [Alternative(label, t.experiment, t.values, t.samples + t.samples_held_out) for label, t in refits]


def _separation(machine: Experiment, alternatives: Sequence[Alternative], say: Progress) -> Separation | None:
    """The input that would distinguish the alternatives; None if one of them cannot be simulated."""
    try:
        return separate(alternatives, machine=machine, progress=say)
    except HeavebondError:
        return None


def _confirmed(original: Experiment, law: FoundLaw, folder: Path, say: Progress) -> FoundLaw:
    """The law in the diagram with its final name, fitted to all samples with all free parameters, with intervals."""
    words = re.findall(r"[A-Za-z0-9]+", law.formula.place.name)
    base = "Law" + "".join(word[:1].upper() + word[1:] for word in words)
    name = next(n for n in (base, *(f"{base}{k}" for k in range(2, 99))) if n not in original.model.library.files)
    experiment = _with_components(original, {name: law.formula.component(name, effect=False)}, folder)
    candidate = candidate_of(experiment, law.formula, name)
    free = {n.name: n for n in law.formula.numbers if n.range is not None}
    change = candidate.change.with_values({f"{candidate.name}.{n.name}": quantity(law.numbers[n.name], n.unit)
                                           for n in free.values()})
    changed = changed_experiment(experiment, change)
    place = next(iter(changed.records.values())).place
    law_numbers = {f"{candidate.name}.{n.name}": Free(f"{candidate.name}.{n.name}", n.range, place)
           for n in free.values() if n.range is not None}
    before = {key: value for key, value in law.refit.values.items()
              if key in changed.free and not key.startswith("initial.")}
    model = changed.model.with_parameters(before)
    try:
        fitted = fit(replace(changed, model=model, free={**changed.free, **law_numbers}), progress=say)
    except HeavebondError:
        return replace(law, name=name)
    index = [k for k, p in enumerate(fitted.parameters) if p.name in law_numbers]
    numbers = {fitted.parameters[k].name.rpartition(".")[2]: fitted.parameters[k] for k in index}
    deviations = np.array([(p.interval[1] - p.interval[0]) / 3.92 for p in numbers.values()])
    finding = AddedEffect(replace(candidate, change=change), tuple(fitted.parameters[k] for k in index),
                          ladder_entry(f"+ {candidate.label}", fitted.after), fitted, (law.refit,))
    return replace(law, name=name, numbers={**law.numbers, **{key: p.value for key, p in numbers.items()}},
                   intervals={key: p.interval for key, p in numbers.items()},
                   covariance=fitted.correlation[np.ix_(index, index)] * np.outer(deviations, deviations), finding=finding)


def _implied(search: Search, sought: _Sought, values: Mapping[str, float]) -> tuple[ImpliedInput, ...]:
    """The input that each record asks for at a place, with these values (SI) of the free parameters."""
    q = np.zeros(search.width)
    for side in search.sides:
        q[search.columns(side.record.name)] = [k.place_of(values.get(k.name, k.centre)) for k in search.known]
    value = (sought.value + sought.slopes @ q) * sought.ratio
    return tuple(implied_inputs(search, sought.place, value, sought.deviation * abs(sought.ratio),
                                sought.local.variables(sought.place)).values())


def write_law(laws: Laws, targets: Targets) -> list[Path]:
    """The component of the simplest formula, the diagram with it, and the experiment on that, in the folder of the
    targets; the paths that were written. None if no formula was found."""
    law = laws.simplest
    if law is None or law.finding is None:
        return []
    path = targets.folder / f"{snake(law.name)}.yaml"
    write_new(path, law.component())
    return [path, *write_findings(laws.experiment, [law.finding], targets)]
