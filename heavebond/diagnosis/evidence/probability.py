"""Calibrated probabilities of the events that can explain the records.

The events are the classes of the catalogue at their places, "outside the catalogue", "parameters only" and "nothing". Their
probabilities add up to 1.

The effects, and other values of the numbers that the diagram holds fixed, are weighted by stacking with bootstrapped
predictive likelihoods (pseudo-BMA+: Y. Yao, A. Vehtari, D. Simpson, A. Gelman, 2018, doi:10.1214/17-BA1091), tempered by one
temperature T. Let l_i be the mean squared whitened prediction error of model i over n samples in one resample of blocks (see
`evidence.prediction`). The weight of model i is

    w_i = E[ l_i**-q / sum_j l_j**-q ],      q = n/2T / c + min(n/2T, b/2) (1 - 1/c)

with the expectation over resamples. For T = 0 it is the share of resamples in which i predicts best. c is the mean squared
error of the best model, in noise variances, and b is the number of independent blocks in the records. The excess over the
noise is a correlated discrepancy, for which n samples carry only the information of b independent ones.

The weights are multiplied by two factors. The first is a penalty for k unknowns, (2 q)**(-k/2) (Laplace's approximation of
the evidence; G. Schwarz, 1978, doi:10.1214/aos/1176344136, with 2 q effective samples). The second is a prior: all classes
are equally probable, and the places of a class, or the parameters and variables of a variation, share the probability of
their class. So one of ninety variations must predict better than one of two sensor errors to be as probable. Some laws only
refine a simpler law at the same place, with an amplitude that is not significant. The weight of such a law is added to the
weight of the simpler one.

A law that explains no noticeable part of the misfit (`step.explains`) is not what is missing, also if it predicts best
of all: its weight counts as a law outside the catalogue. The further odds of such a law are A if the residual is noise. If
it is larger, the identified curves represent such laws. With the same weight r_k of curve k relative to the best law, both
in one diagram, and the share w of the best law among the effects, the odds are A w sum_k r_k. If no curve was fitted, the
odds are A exp(B (1 - 1/c)). Here c is at least 1, and 1 - 1/c is the share of the squared error that exceeds the noise.

The probability that no effect is missing follows from the p value of the residual tests. The smallest Bayes factor for this
hypothesis, -e p ln p (T. Sellke, M. J. Bayarri, J. O. Berger, 2001, doi:10.1198/000313001300339950), is multiplied by prior
odds. The probability that the data sheet is right follows in the same way, with the same odds, from the p value of the
likelihood ratio of the fitted parameters. A constant share of the probability is kept for effects that were not considered.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from heavebond.diagnosis.candidates.catalogue import Candidate
from heavebond.diagnosis.candidates.fixed_values import VALUE
from heavebond.diagnosis.decision import DECISION
from heavebond.diagnosis.evidence.comparison import ALL, HOPELESS, leaves_noise, loss
from heavebond.diagnosis.evidence.flexible_laws import Adequacy
from heavebond.diagnosis.evidence.prediction import block_length, levelled, resampled, share_taken
from heavebond.diagnosis.evidence.residual_tests import LEVELS
from heavebond.diagnosis.search.refit import Refit
from heavebond.diagnosis.search.schedule import family, largest_gains
from heavebond.diagnosis.search.step import Stage, explains, refines, twins_of
from heavebond.language.library import same_class
from heavebond.numerics.dae import Array

NOTHING, PARAMETERS = "nothing", "parameters only"
OUTSIDE, OTHER = "outside the catalogue", "another effect of the catalogue"
TEMPERATURES = (0.0, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
Share = TypeVar("Share", float, Array)
KEPT = 0.01  # smallest weight, at any temperature, of an effect that is written to a file
CLUSTERS = 4  # smallest number of stretches from which the variance between them is estimated
STATED = 0.01  # smallest probability of a separate entry for an effect that the answer does not name


@dataclass(frozen=True)
class Calibration:
    """Constants of the probabilities, fitted to the cases of the study on success rates (`docs/diagnosis_study.md`).

    The machines of these cases lack at most one law. `python -m benchmarks.diagnosis.calibration report` compares the
    calibration with machines that also have clutter.

    * cases: number of cases.
    * temperature: T, by which log-likelihoods are divided.
    * outside: A, odds of a law outside the catalogue if the residual of a law of the catalogue is noise.
    * excess: B, logarithm of the factor on these odds if the residual is much larger than the noise.
    * simpler: K, prior odds that nothing is missing, and that the data sheet is right.
    * lapse: share kept for effects of the catalogue that were not considered.
    """

    cases: int = 744
    temperature: float = 16.0
    outside: float = 0.152
    excess: float = 3.6
    simpler: float = 40.0
    lapse: float = 0.019


CALIBRATION = Calibration()
PROBABILITY = f"Probability, calibrated on {CALIBRATION.cases} cases"  # heading of a table


def percent(probability: float) -> str:
    """Format a probability in whole percent, or as < 1 % or > 99 %."""
    value = 100 * probability
    return "> 99 %" if value > 99 else "< 1 %" if value < 1 else f"{value:.0f} %"


@dataclass(frozen=True)
class Event:
    """An event that can explain the records, and its probability.

    * kind: class of an effect; for an identified curve, the type of its variable (rate or displacement), or what it does
      to a signal (measurement, transport); otherwise the name of the event.
    * place, where: place of an effect or a curve, in words and as names.
    * labels: candidates of an effect.
    """

    kind: str
    probability: float
    place: str = ""
    where: tuple[str, ...] = ()
    labels: tuple[str, ...] = ()

    @property
    def row(self) -> tuple[str, str]:
        """Row of a table: the event in words and its probability in percent."""
        return f"{self.kind} {self.place}".rstrip(), percent(self.probability)

    def as_dict(self) -> dict[str, object]:
        """Return the event and its probability for JSON."""
        return {"event": self.kind, "place": self.place, "where": list(self.where), "probability": self.probability}


@dataclass(frozen=True)
class Evidence:
    """Data from which the probabilities are computed.

    * effects: events of the models, with probability 0; class VALUE for another value of a fixed number.
    * weights: their weights (m,) at each of the TEMPERATURES. Laws that explain no noticeable part of the misfit have the
      weight 0, so that the sum may be below 1; the rest counts as a law outside the catalogue.
    * left: mean squared whitened prediction error of the best model, at least 1 (1 = noise level; 1 if no model was fitted).
    * missing: bound of the Bayes factor for "nothing is missing" from the residual tests.
    * sheet: bound of the Bayes factor for the values of the data sheet from the fitted parameters.
    * curves, flexible: places of identified curves, and their weights (k,) relative to the best effect at each of the
      TEMPERATURES; empty if no curve was fitted.
    * untried: share of the promising candidates without a refit, because the search was ended early.
    """

    effects: tuple[Event, ...]
    weights: Mapping[float, Array]
    left: float
    missing: float
    sheet: float
    curves: tuple[Event, ...] = ()
    flexible: Mapping[float, Array] = field(default_factory=dict)
    untried: float = 0.0

    @property
    def outside(self) -> Mapping[float, float]:
        """Weight of all identified curves relative to all effects, at each of the TEMPERATURES."""
        return {t: float(self.weights[t].max(initial=0.0) * curve_weights.sum())
                for t, curve_weights in self.flexible.items()}

    def unexplained(self, temperature: float) -> float:
        """Share of the laws that explain no noticeable part of the misfit; 0 before the first refit."""
        return max(0.0, 1 - float(self.weights[temperature].sum())) if self.effects else 0.0

    def as_dict(self) -> dict[str, object]:
        """Return the evidence for JSON, without effects of negligible weight."""
        most = np.max([*self.weights.values()], axis=0) if self.effects else np.zeros(0)
        listed = [k for k, weight in enumerate(most) if weight >= KEPT]
        effects = [self.effects[k] for k in listed]
        return {"effects": [[e.kind, e.place, list(e.where), list(e.labels)] for e in effects],
                "weights": {f"{t:g}": [round(float(values[k]), 4) for k in listed] for t, values in self.weights.items()},
                "left": self.left, "missing": self.missing, "sheet": self.sheet,
                "curves": [[e.kind, e.place, list(e.where), list(e.labels)] for e in self.curves],
                "flexible": {f"{t:g}": [float(f"{x:.4g}") for x in values] for t, values in self.flexible.items()},
                "untried": self.untried}

    @classmethod
    def of_dict(cls, entry: Mapping[str, object]) -> Evidence:
        """Create the evidence from the result of `as_dict`."""
        effects, weights = entry["effects"], entry["weights"]
        assert isinstance(weights, dict)
        def events(of: object) -> tuple[Event, ...]:
            assert isinstance(of, list)
            return tuple(Event(kind, 0.0, place, tuple(where), tuple(labels)) for kind, place, where, labels in of)

        flexible = entry.get("flexible", {})
        assert isinstance(flexible, dict)
        residual, missing, sheet = (float(str(entry[name])) for name in ("left", "missing", "sheet"))
        return cls(events(effects), {float(t): np.array(values) for t, values in weights.items()}, residual, missing, sheet,
                   events(entry.get("curves", [])),
                   {float(t): np.array(values) for t, values in flexible.items()}, float(str(entry.get("untried", 0.0))))


def evidence(steps: Sequence[Stage], values: Stage | None = None, sheet: float = 1.0, adequacy: Adequacy | None = None,
             review: Stage | None = None) -> Evidence:
    """Collect the evidence for the first effect of these steps.

    It consists of the refits of the first step, the refits of other values of fixed parameters on the same records
    (`values`), the p value `sheet` of the hypothesis that the data sheet is right, and the identified curves of `adequacy`.

    The refits are given by `compared_step`. The residual is the one after all steps, because further effects of the
    catalogue are not evidence for a law outside it.
    """
    first = steps[0]
    stage = compared_step(first, review)
    value_trials = [t for t in values.trials if t.candidate.kind == VALUE] if values is not None else []
    alike = _families((*stage.trials, *value_trials), stage)

    def explaining(trial: Refit) -> bool:
        return explains(first if trial.candidate.kind == VALUE else stage, trial)

    best = [min(family, key=lambda t: (not explaining(t), loss(t))) for family in alike]
    weights = _with_prior(law_weights(best), best, stage)
    if stage.joint and value_trials:
        weights = _beside_values(best, weights, _families((*first.trials, *value_trials), first), first)
    weights = {t: w * [explaining(b) for b in best] for t, w in weights.items()}
    later = [step.chosen for step in steps[1:] if step.chosen is not None and step.chosen.errors is not None]
    # after a search that was ended early the residual is not evidence for a law outside the catalogue: further effects were
    # not tried
    residual = 1.0 if any(step.partial for step in steps) else max(1.0, min(map(loss, [*best, *later]), default=1.0))
    # the three p values combined are below the sum of the significance levels if one of them is below its level
    level = sum(LEVELS.values())
    p_value = float(min(1.0, *(getattr(stage.left, name) * level / own_level for name, own_level in LEVELS.items())))
    untried = _untried(stage) if stage.partial else 0.0
    return Evidence(*_weighted(alike, _to_simpler(alike, best, weights, stage), stage), residual, factor_bound(p_value),
                    factor_bound(sheet), *_flexible(adequacy, stage), untried)


def _untried(stage: Stage) -> float:
    """Probability that an effect is missing that was not refitted, because the search was ended early.

    u is the share of the gains of all scores whose candidates are of a class, at a place, without a refit, and were not
    excluded. A candidate that is equivalent to a refitted one counts as refitted, and one that has no score yet as one with
    the mean gain. The diagrams that cannot be simulated are left out. If one of these effects is missing, the best refit is
    a wrong law. It then explains at least the share e of the misfit with the probability 1 - e, if all shares are equally
    probable: the result is u (1 - e) / (u (1 - e) + 1 - u).
    """
    gains = largest_gains(stage.scores, lambda candidate: candidate.label)
    reached = {*(t.candidate.label for t in stage.trials), *stage.failed, *stage.excluded}
    reached |= {twin for label in reached for twin in stage.twins.get(label, ())}
    families = {family(s.candidate) for s in stage.scores if s.candidate.label in reached}
    reached |= {s.candidate.label for s in stage.scores if family(s.candidate) in families}
    unscored = max(stage.planned - len(gains) - len(stage.broken), 0)
    mean = sum(gains.values()) / len(gains) if any(gains.values()) else 1.0
    left = sum(gain for label, gain in gains.items() if label not in reached) + unscored * mean
    u = left / max(sum(gains.values()) + unscored * mean, 1e-300)
    explained = max((share_taken(stage.errors, t.errors, *ALL) for t in stage.trials
                     if t.errors is not None and stage.errors is not None), default=0.0)
    wrong = u * (1 - min(max(explained, 0.0), 1.0))
    return wrong / max(wrong + 1 - u, 1e-300)


def compared_step(step: Stage, review: Stage | None) -> Stage:
    """Select the refits from which the probabilities of the effect of a step are computed.

    There are three cases:

    * The effect was compared again in the diagram with all later effects (the step `review`), and a refit there reaches the
      noise: the refits of `review` are used. Otherwise candidates that imitate the later effects would get weight.
    * No refit reaches the noise, so further effects are missing. The later effects were selected to complete one law and
      favour it. Therefore the leading laws are compared in pairs, each with the further effect that completes it best
      (`Stage.joint`).
    * Without such pairs, the refits of `review` are used if there is a review, otherwise those of the step.
    """
    if review is not None and (not step.joint or any(map(leaves_noise, review.trials))):
        return replace(review, left=step.left)
    if not step.joint:
        return step
    pairs = {t.candidate.label for t in step.joint}
    return replace(step, trials=(*step.joint, *(t for t in step.trials if t.candidate.label not in pairs)))


def _families(trials: Sequence[Refit], stage: Stage) -> list[list[Refit]]:
    """Group refits by class and place (fixed values by their names). Only refits with predictive errors on the samples of
    the step are used."""
    bins = len(stage.errors.sums) if stage.errors is not None else 0
    families: dict[object, list[Refit]] = {}
    for trial in (t for t in trials if t.errors is not None and len(t.errors.sums) == bins > 0):
        families.setdefault((trial.candidate.kind, frozenset(trial.candidate.where)
                             if trial.candidate.kind != VALUE else trial.candidate.name), []).append(trial)
    return list(families.values())


def _with_prior(weights: Mapping[float, Array], best: Sequence[Refit], stage: Stage) -> dict[float, Array]:
    """Multiply the weights of the best laws of each class and place by their prior probabilities.

    The prior is one over the number of places of the class, or of parameters and variables of a variation, among all scored
    candidates that the records can show. Equivalent candidates at other places, which were not refitted, add their priors:
    the records cannot distinguish them, and one of two such places is twice as probable as a single one.
    """
    if not best:
        return dict(weights)
    by_label = {s.candidate.label: s.candidate for s in stage.scores if s.told_apart}
    places: dict[str, set[str]] = {}
    for candidate in (*by_label.values(), *(t.candidate for t in best)):
        places.setdefault(candidate.kind, set()).add(candidate.place)
    prior = []
    for trial in best:
        twins = [by_label[label] for label in stage.twins.get(trial.candidate.label, ()) if label in by_label]
        prior.append(sum(max(1 / len(places[c.kind]) for c in alike)
                         for alike in _alike([trial.candidate, *twins], stage).values()))
    return {t: weight * prior / max(float(weight @ prior), 1e-300) for t, weight in weights.items()}


def _alike(candidates: Sequence[Candidate], stage: Stage) -> dict[object, list[Candidate]]:
    """Group equivalent candidates by class and place; fixed values by their names. The class is that of the first one for a
    class that is a special case of it, or of which it is one."""
    alike: dict[object, list[Candidate]] = {}
    for c in candidates:
        kind = candidates[0].kind if same_class(c.kind, candidates[0].kind) else c.kind
        alike.setdefault(c.name if c.kind == VALUE else (kind, stage.places.place(c)), []).append(c)
    return alike


def _beside_values(best: Sequence[Refit], weights: Mapping[float, Array], alone: Sequence[Sequence[Refit]], stage: Stage
                   ) -> dict[float, Array]:
    """Combine the weights of pairs of effects with the weights of fixed values, which were refitted without a further
    effect.

    Each value keeps the share that it has in the comparison with single effects (`alone`).
    """
    singles = [min(family, key=loss) for family in alone]
    shares = _with_prior(law_weights(singles), singles, stage)
    combined = {}
    for t, weight in weights.items():
        of_values = {s.candidate.name: share for s, share in zip(singles, shares[t], strict=True)
                     if s.candidate.kind == VALUE}
        effects = np.array([0.0 if b.candidate.kind == VALUE else w for b, w in zip(best, weight, strict=True)])
        effects *= (1 - sum(of_values.values())) / max(float(effects.sum()), 1e-300)
        combined[t] = effects + [of_values[b.candidate.name] if b.candidate.kind == VALUE else 0.0 for b in best]
    return combined


def _flexible(adequacy: Adequacy | None, stage: Stage) -> tuple[tuple[Event, ...], dict[float, Array]]:
    """Best identified curve of each place, with its weight relative to the law that it replaces.

    If the refits of the step `stage` contain the law with the further effect that completes it best, this pair is the
    reference: a curve has enough coefficients to absorb such an effect.
    """
    if adequacy is None or adequacy.law is None or not adequacy.curves or not adequacy.tried:
        return (), {}
    best: dict[frozenset[str], Refit] = {}
    for curve in sorted(adequacy.curves, key=loss):
        best.setdefault(frozenset(curve.candidate.where), curve)
    curves = list(best.values())
    law = min([adequacy.law, *(t for t in stage.joint if t.candidate.label == adequacy.law.candidate.label)], key=loss)
    weights = law_weights([law, *curves], penalised=False)  # no penalty: a curve represents laws with few numbers
    return tuple(Event("measurement" if c.candidate.attaches == "channel" or c.candidate.change.moved else
                       "transport" if c.candidate.attaches == "input" else
                       "displacement" if c.candidate.curve_of_displacement else "rate", 0.0, c.candidate.place,
                       c.candidate.where, (c.candidate.label,)) for c in curves), \
        {t: relative[1:] / max(float(relative[0]), 1e-6) for t, relative in weights.items()}


def _to_simpler(families: Sequence[Sequence[Refit]], best: Sequence[Refit], weights: Mapping[float, Array],
                stage: Stage) -> dict[float, Array]:
    """Move the weights of laws that only refine a simpler law at the same place to the simpler law.

    A refinement without a significant gain is the same law, because its additional amplitude is not significant. A law with
    an amplitude that the records do not support is not simpler than one without, whatever its number of unknowns: play whose
    gap is closed is a compliance.
    """
    least = [(bool(b.unshown), min(t.unknowns for t in family)) for b, family in zip(best, families, strict=True)]
    laws = [(*family, *twins_of(family, stage)) for family in families]  # with the equivalent candidates at other places
    to = np.arange(len(best))
    for k in sorted(range(len(best)), key=lambda k: least[k]):
        simpler = [j for j in range(len(best)) if least[j] < least[k] and refines(best[k], laws[j])]
        if simpler:
            to[k] = to[min(simpler, key=lambda j: (least[j], -weights[1.0][j]))]
    return {t: np.asarray(np.bincount(to, weight, len(best)), float) for t, weight in weights.items()}


def _weighted(families: Sequence[Sequence[Refit]], weights: Mapping[float, Array], stage: Stage
              ) -> tuple[tuple[Event, ...], dict[float, Array]]:
    """Events (a class at a place) with their weights. Classes and places with equivalent candidates share a weight
    equally."""
    if not families:
        return (), {}
    by_label = {s.candidate.label: s.candidate for s in stage.scores}
    events: dict[object, Event] = {}
    shares: dict[object, dict[int, float]] = {}
    order = sorted(range(len(families)), key=lambda k: -weights[1.0][k])  # an event gets the name of its best law
    for k in order:
        family = families[k]
        members = [t.candidate for t in family]
        twins = [by_label[label] for c in members for label in stage.twins.get(c.label, ()) if label in by_label]
        alike = _alike([*members, *twins], stage)
        for key, candidates in alike.items():
            c, labels = candidates[0], tuple(c.label for c in candidates)
            before = events.setdefault(key, Event(c.kind, 0.0, c.place, c.where))
            events[key] = replace(before, labels=(*before.labels, *labels))
            shares.setdefault(key, {})[k] = 1 / len(alike)
    mixing = np.array([[of.get(k, 0.0) for k in range(len(families))] for of in shares.values()])
    return tuple(events.values()), {t: mixing @ weight for t, weight in weights.items()}


def law_weights(trials: Sequence[Refit], penalised: bool = True) -> dict[float, Array]:
    """Weights (m,) of m models at each of the TEMPERATURES; if `penalised`, with the penalty for the number of unknowns."""
    if len(trials) < 2:
        return {t: np.ones(1) for t in TEMPERATURES} if trials else {}
    errors = [t.errors for t in trials if t.errors is not None]
    losses, counts, stretch = levelled(errors), errors[0].counts, errors[0].stretch
    weights = {t: np.zeros(len(trials)) for t in TEMPERATURES}
    samples = float(counts.sum())
    means = losses.sum(axis=1) / samples
    close = np.flatnonzero(means <= HOPELESS * max(float(means.min()), 1.0))
    part, first = losses[close], int(np.argmin(means[close]))
    lengths = [block_length(d - d.sum() / samples * counts, stretch)[0]
               for k, d in enumerate(part - part[first]) if k != first]
    drawn = resampled(stretch, max(lengths, default=1.0), DECISION.draws, np.random.default_rng(0))
    log = np.log(np.maximum((drawn @ part.T) / (drawn @ counts)[:, None], 1e-300))
    ahead = log - log.min(axis=1, keepdims=True)
    blocks = _independent_blocks(part - part[first], counts, stretch, max(lengths, default=1.0))
    noise = 1 / max(1.0, min(float(e.sums.sum()) for e in errors) / samples)
    more = np.array([trials[k].unknowns for k in close.tolist()], dtype=np.float64)
    for t in TEMPERATURES:
        power = (noise * samples / t + (1 - noise) * min(samples / t, blocks)) / 2 if t > 0 else 0.0
        lost = penalised * (more - more.min()) / 2 * np.log(max(2 * power, 1.0))
        each = np.exp(-power * ahead - lost) if t > 0 else (ahead == 0).astype(float)
        weights[t][close] = np.mean(each / each.sum(axis=1, keepdims=True), axis=0)
    return weights


def _independent_blocks(differences: Array, counts: Array, stretch: NDArray[np.int64], length: float) -> float:
    """Number of independent blocks in the bins, for differences (m, k) of errors.

    It is at most the number of blocks of this `length` (bins). It is smaller if the differences vary more between stretches
    (records) than independent blocks would.

    A parameter that differs between records (friction after warming up) makes a difference persist throughout a record. The
    variance of a sum over S stretches is then equal to the variance of a sum of S independent numbers.
    """
    blocks, count = len(counts) / length, int(stretch.max(initial=-1)) + 1
    if count < CLUSTERS:
        return blocks
    edges = np.arange(0, len(counts), max(1, round(length)))
    ratios = []
    for d in differences:
        centred = d - d.sum() / counts.sum() * counts
        between, within = np.bincount(stretch, centred), np.add.reduceat(centred, edges)
        if within.any():
            ratios.append(float(between @ between) * count / (count - 1) / float(within @ within))
    return blocks / max(1.0, float(np.median(ratios)) if ratios else 1.0)


def factor_bound(p: float) -> float:
    """Smallest Bayes factor for a hypothesis with the p value p: -e p ln p, and 1 for p >= 1/e."""
    return float(-math.e * p * math.log(p)) if 0 < p < 1 / math.e else float(p > 0)


def parts(constants: Calibration, missing: Share, sheet: Share, residual: Share, flexible: Share | None = None
          ) -> tuple[Share, ...]:
    """Probabilities of "nothing", "parameters only", "outside the catalogue", and of all effects and other values together.

    The arguments are numbers, or arrays with one element per case. `flexible` is the weight of the identified curves
    relative to all effects (NaN if no curve was fitted).
    """
    without, right = _share(constants.simpler * missing), _share(constants.simpler * sheet)
    factor = np.exp(constants.excess * (1 - 1 / residual))
    if flexible is not None:
        factor = np.where(np.isnan(flexible), factor, flexible)
    outside = _share(constants.outside * factor)
    considered = 1 - constants.lapse
    return (considered * without * right, considered * without * (1 - right), considered * (1 - without) * outside,
            considered * (1 - without) * (1 - outside))


def probabilities(known: Evidence, constants: Calibration = CALIBRATION) -> tuple[Event, ...]:
    """Events with their probabilities, the most probable first. The probabilities add up to 1."""
    nothing, parameters, outside, among = map(float, parts(
        constants, known.missing, known.sheet, known.left, known.outside.get(constants.temperature, math.nan)))
    weights = known.weights[constants.temperature] if known.effects else np.zeros(0)
    by_kind = {NOTHING: nothing, PARAMETERS: parameters,
               OTHER: constants.lapse + among * (known.untried if known.effects else 1.0)}
    among *= 1 - known.untried
    by_kind[OUTSIDE] = outside + among * known.unexplained(constants.temperature)
    effects = []
    for event, weight in zip(known.effects, weights, strict=True):
        if event.kind == VALUE:
            by_kind[PARAMETERS] += among * float(weight)
        else:
            effects.append(replace(event, probability=among * float(weight)))
    events = [*effects, *(Event(kind, p) for kind, p in by_kind.items())]
    return tuple(sorted(events, key=lambda event: -event.probability))


def stated(events: Sequence[Event], named: Sequence[str]) -> tuple[Event, ...]:
    """Merge the improbable events that the answer does not name into one event. `named` are the labels of the candidates in
    the answer."""
    listed = [e for e in events if e.kind == OTHER or e.probability >= STATED or set(e.labels) & set(named)]
    more = sum(e.probability for e in events if e not in listed)
    merged = [replace(e, probability=e.probability + more) if e.kind == OTHER else e for e in listed]
    return tuple(sorted(merged, key=lambda event: -event.probability))


def _share(odds: Share) -> Share:
    return odds / (1 + odds)
