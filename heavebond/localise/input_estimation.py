"""Unknown-input estimation: the input at each place that makes the model match its records, with a ranking of places.

At every place (see `places`) a through variable w(t) is estimated by a Kalman smoother together with the free parameters
and small deviations of the start. The intensity of w maximises the likelihood of the fitted records; places are ranked by
that likelihood, which penalises the intensity. For a nonlinear machine the run is repeated with the parameters and the w of
the best place, and all is estimated again about it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import ModelError, SimulationError, StartError
from heavebond.core.presentation import count
from heavebond.equations.places import Place
from heavebond.localise.constants import INPUT_ESTIMATION
from heavebond.localise.kalman_smoother import Likelihood, Smoothed, Unknown
from heavebond.localise.ltv_model import Known, LtvModel, SourcedRecord, with_values
from heavebond.numerics.dae import Array

Say = Callable[[str], None]
# Intensities that are tried, in sizes of the place per record (a size moves the outputs by as much as they are wrong), and
# about the best of them once the runs have been made anew.
INTENSITIES, FINER = 10.0 ** np.arange(-2.0, 5.1), 10.0 ** np.array([-0.5, 0.0, 0.5])


@dataclass(frozen=True)
class Group:
    """Places that no record can distinguish by their responses: an input at the first, times `ratio`, is the equivalent
    input at each. `size` is the input of the first that changes the outputs by the size of their errors."""

    places: tuple[Place, ...]
    ratios: tuple[float, ...]
    size: float


@dataclass(frozen=True)
class Ranked:
    """A group with its log likelihood on the records to be fitted, and the intensity at which it is largest."""

    group: Group
    likelihood: float
    intensity: float


@dataclass(frozen=True)
class Estimate:
    """The estimates for all places and records. `likelihood` is the likelihood of the parameters alone, `ideal` of pure
    noise, `samples` their number; `base` are the runs with `values`, `systems` the runs with the input of the best place,
    about which `smoothed` (by record, the places as in `full`) was estimated. `foreseen` is true if those runs agree with
    the prediction, so that the estimate holds for the machine and not only for its linear system.
    """

    ranked: tuple[Ranked, ...]
    unseen: tuple[Place, ...]
    likelihood: float
    ideal: float
    samples: int
    base: Mapping[str, LtvModel]
    systems: Mapping[str, LtvModel]
    smoothed: Mapping[str, Smoothed]
    values: Mapping[str, Mapping[str, float]]
    foreseen: bool
    full: tuple[Ranked, ...] = ()

    @property
    def gain(self) -> float:
        """Log likelihood that the best place adds to the parameters alone."""
        return self.ranked[0].likelihood - self.likelihood if self.ranked else 0.0

    @property
    def chance(self) -> float:
        """The p value of the gain: the likelihood ratio test of one intensity, half of whose chi-square distribution is at
        0, times the number of places (Bonferroni)."""
        from scipy.special import chdtrc

        return float(min(1.0, len(self.ranked) * 0.5 * chdtrc(1, 2 * max(self.gain, 0.0)))) if self.ranked else 1.0

    def explained(self, ranked: Ranked) -> float:
        """The share of the log likelihood between the parameters alone and pure noise that a place explains, with its
        penalty."""
        difference = self.ideal - self.likelihood
        return float(np.clip((ranked.likelihood - self.likelihood) / difference, 0.0, 1.0)) if difference > 0 else 0.0


@dataclass(frozen=True)
class EstimationPass:
    """All groups about one set of runs; `null` is the best q of the parameters alone, by record."""

    ranked: tuple[Ranked, ...]
    likelihood: float
    null: Mapping[str, Array]


@dataclass(frozen=True)
class Search:
    """Records with their machines, those to be fitted first, and the priors of the free parameters."""

    sides: Sequence[SourcedRecord]
    known: Sequence[Known]
    say: Say

    @property
    def fitted(self) -> list[str]:
        """The records whose likelihood counts."""
        return [s.record.name for s in self.sides if s.record.use == "fit"] or [self.sides[0].record.name]

    def columns(self, record: str) -> NDArray[np.int64]:
        """The indices of the q of a record in the q of all: shared ones first, then separate ones of each record."""
        shared = [k for k, known in enumerate(self.known) if not known.each]
        separate = [k for k, known in enumerate(self.known) if known.each]
        first = len(shared) + len(separate) * [s.record.name for s in self.sides].index(record)
        return np.array([shared.index(k) if k in shared else first + separate.index(k) for k in range(len(self.known))],
                        dtype=np.int64)  # of nothing, where nothing is free

    @property
    def width(self) -> int:
        """The number of all q."""
        separate = sum(k.each for k in self.known)
        return len(self.known) - separate + separate * len(self.sides)

    def centre(self, systems: Mapping[str, LtvModel]) -> Array:
        """The q of the runs, of all."""
        centre = np.zeros(self.width)
        for name, system in systems.items():
            centre[self.columns(name)] = system.centre
        return centre

    def estimate(self, values: Mapping[str, Mapping[str, float]],
                 chosen: Callable[[Sequence[Ranked]], Sequence[Ranked]]) -> Estimate:
        """Rank the places, beginning with runs at `values` (by record); of the ranking, those `chosen` are smoothed."""
        self.say("running the records")
        systems = self.about(values, {})
        groups, unseen = self.groups(systems)
        grids = [(group, INTENSITIES) for group in groups]
        self.say(f"estimating the inputs at {count(len(groups), 'place')}")
        estimation = self.round(systems, grids)
        known = Estimate(estimation.ranked, (), estimation.likelihood, 0.0, 0, systems, systems, {}, values, True)
        systems, values, estimation = self._parameters_alone(systems, values, grids, estimation)
        samples = sum(int(systems[name].used.sum()) for name in self.fitted)
        # what was not sampled counts as a sample without error
        ideal = -0.5 * (samples + np.log(2 * np.pi) * sum(systems[name].used.size for name in self.fitted))
        estimate = Estimate(estimation.ranked, tuple(unseen), estimation.likelihood, ideal, samples, systems, systems, {},
                            values, True)
        if estimate.chance < INPUT_ESTIMATION.level:
            # about the parameters as they are known: those that were fitted alone have taken up a part of what is missing
            about = self._along_the_best(replace(known, samples=samples)) if systems is not known.systems else None
            estimate = replace(about, unseen=estimate.unseen, likelihood=estimate.likelihood, ideal=ideal, base=systems,
                               values=values) if about is not None and about.foreseen else self._along_the_best(estimate)
        smoothed = tuple(chosen(estimate.ranked))
        return replace(estimate, full=smoothed, smoothed=self._smoothed(estimate.systems, smoothed))

    def about(self, values: Mapping[str, Mapping[str, float]], driven: Mapping[str, Array]) -> dict[str, LtvModel]:
        """Every record's linear system about its run."""
        return {s.record.name: s.about(values[s.record.name], self.known, driven.get(s.record.name)) for s in self.sides}

    def groups(self, systems: Mapping[str, LtvModel]) -> tuple[list[Group], list[Place]]:
        """Places grouped by equal responses, and the places without a response."""
        side = self.sides[0]
        responses = np.concatenate([_responses(systems[name], list(side.nodes), side.places) for name in self.fitted])
        strength = np.sqrt(np.mean(responses**2, axis=0))
        groups: list[tuple[list[int], list[float]]] = []
        unseen = []
        for g, place in enumerate(side.places):
            node = place.nodes[0]
            if strength[g] * node.domain.members[node.through].nominal < INPUT_ESTIMATION.unseen:
                unseen.append(place)
                continue
            for members, ratios in groups:
                first = responses[:, members[0]]
                along = float(first @ responses[:, g]) / (responses[:, g] @ responses[:, g])
                if abs(along * along * strength[g]**2 / strength[members[0]]**2 - 1) < INPUT_ESTIMATION.parallel:
                    members.append(g)
                    ratios.append(along)
                    break
            else:
                groups.append(([g], [1.0]))
        wrong = np.sqrt(misfit(systems, self.fitted))
        return [Group(tuple(side.places[g] for g in members), tuple(ratios), float(wrong / strength[members[0]]))
                for members, ratios in groups], unseen

    def round(self, systems: Mapping[str, LtvModel], grids: Sequence[tuple[Group, Array]]) -> EstimationPass:
        """The likelihood of every group at its intensities, with the parameters integrated out over their priors."""
        # first nothing at all, as an input of intensity 0
        tried = np.concatenate([[0.0], *(grid for _, grid in grids)])
        places = [self.sides[0].places[0], *(group.places[0] for group, grid in grids for _ in grid)]
        sizes = np.concatenate([[1.0], *(np.full(len(grid), group.size) for group, grid in grids)])
        constant = np.zeros(len(tried))
        slope, curvature = np.zeros((len(tried), self.width)), np.zeros((len(tried), self.width, self.width))
        alone: dict[str, Likelihood] = {}
        for side in self.sides:
            name, system = side.record.name, systems[side.record.name]
            if name not in self.fitted and not any(k.each for k in self.known):
                continue
            shared = slice(None) if name in self.fitted else slice(1)
            unknown = Unknown(system, list(side.nodes), places[shared], sizes[shared])
            alone[name] = unknown.filtered(tried[shared]**2 / _span(system))
            if name in self.fitted:
                columns = self.columns(name)
                constant += alone[name].constant
                slope[:, columns] += alone[name].slope
                curvature[:, columns[:, None], columns] += alone[name].curvature
        total, q = self._integrated(constant, slope, curvature, -self.centre(systems))
        ends = np.cumsum([1, *(len(grid) for _, grid in grids)])
        ranked = []
        for (group, grid), begin, end in zip(grids, ends[:-1], ends[1:], strict=True):
            best = int(total[begin:end].argmax())
            ranked.append(Ranked(group, float(total[begin + best]), float(grid[best])))
        null = {s.record.name: self._parameters_of(s.record.name, q[0], systems, alone) for s in self.sides}
        return EstimationPass(tuple(sorted(ranked, key=lambda r: -r.likelihood)), float(total[0]), null)

    def _integrated(self, constant: Array, slope: Array, curvature: Array, mean: Array) -> tuple[Array, Array]:
        """Log likelihood (G,) with q ~ N(mean, 1) integrated out, and the most likely q (G, width)."""
        precision = curvature + np.eye(self.width)
        q = np.linalg.solve(precision, (mean - slope)[:, :, None])[:, :, 0] if self.width else slope
        bottom = constant + 2 * (slope * q).sum(axis=1) + np.einsum("gi,gij,gj->g", q, curvature, q) \
            + ((q - mean)**2).sum(axis=1)
        return np.asarray(-0.5 * (bottom + np.linalg.slogdet(precision)[1])), np.asarray(q)

    def _parameters_of(self, record: str, q: Array, systems: Mapping[str, LtvModel], alone: Mapping[str, Likelihood]
                       ) -> Array:
        """The q of one record about zero; for a record that is not fitted, its separate q are estimated from it alone."""
        deviation, separate = q[self.columns(record)], np.array([k.each for k in self.known], dtype=bool)
        if record not in self.fitted and separate.any():
            likelihood = alone[record]
            curvature, mean = likelihood.curvature[0], -systems[record].centre
            right = mean - likelihood.slope[0] - curvature[:, ~separate] @ deviation[~separate]
            deviation[separate] = np.linalg.solve(curvature[np.ix_(separate, separate)] + np.eye(int(separate.sum())),
                                                  right[separate])
        return np.asarray(systems[record].centre + deviation)

    def _parameters_alone(self, systems: dict[str, LtvModel], values: Mapping[str, Mapping[str, float]],
                          grids: Sequence[tuple[Group, Array]], estimation: EstimationPass
                          ) -> tuple[dict[str, LtvModel], Mapping[str, Mapping[str, float]], EstimationPass]:
        """Gauss-Newton steps of the parameters, if these alone nearly explain the records."""
        samples = sum(int(systems[name].used.sum()) for name in self.fitted)
        size = sum(systems[name].used.size for name in self.fitted)
        for _ in range(INPUT_ESTIMATION.max_steps if self.known else 0):
            foreseen = (-2 * estimation.likelihood - size * np.log(2 * np.pi)) / samples
            if foreseen > INPUT_ESTIMATION.stepwise_below:
                break
            self.say("fitting the parameters alone")
            try:
                stepped = {name: with_values(self.known, q) for name, q in estimation.null.items()}
                better = self.about(stepped, {})
            except (ModelError, SimulationError, StartError):
                break
            gained = misfit(systems, self.fitted) - misfit(better, self.fitted)
            if gained < -0.01:
                break
            systems, values, estimation = better, stepped, self.round(better, grids)
            if gained < 0.01:
                break
        return systems, values, estimation

    def _along_the_best(self, first: Estimate) -> Estimate:
        """Repeat the runs with the input of the best place until they agree with the prediction."""
        estimate = replace(first, foreseen=False)
        for _ in range(INPUT_ESTIMATION.max_rounds):
            place = estimate.ranked[0].group.places[0]
            self.say(f"simulating the records with the input {place.words}")
            smoothed = self._smoothed(estimate.systems, estimate.ranked[:1])
            expected = sum(float(np.sum(smoothed[n].left[:, 0, :, 0]**2)) for n in self.fitted) / estimate.samples
            vector = np.array([place.weights.get(node, 0.0) for node in self.sides[0].nodes])
            try:
                systems = self.about(estimate.values, {name: s.w[:, 0, :1] * vector for name, s in smoothed.items()})
            except (ModelError, SimulationError, StartError):
                break
            reached = misfit(systems, self.fitted)
            if reached > 0.5 * misfit(first.systems, self.fitted) and reached > 2 * expected:
                break  # a machine that this input throws off its way
            again = self.round(systems, [(r.group, r.intensity * FINER) for r in estimate.ranked])
            settled = abs(reached - expected) < INPUT_ESTIMATION.as_predicted * expected + 0.02 \
                or reached < INPUT_ESTIMATION.small_misfit * misfit(first.systems, self.fitted)
            estimate = replace(estimate, ranked=again.ranked, systems=systems, foreseen=settled)
            if settled:
                break
        return estimate

    def _smoothed(self, systems: Mapping[str, LtvModel], ranked: Sequence[Ranked]) -> dict[str, Smoothed]:
        """The input at the first place of each group, in every record."""
        if not ranked:
            return {}
        places, sizes = [r.group.places[0] for r in ranked], np.array([r.group.size for r in ranked])
        tried = np.array([r.intensity for r in ranked])
        return {s.record.name: Unknown(systems[s.record.name], list(s.nodes), places, sizes).smoothed(
            tried**2 / _span(systems[s.record.name])) for s in self.sides}


def _span(system: LtvModel) -> float:
    return float(system.time[-1] - system.time[0])


def misfit(systems: Mapping[str, LtvModel], names: Sequence[str]) -> float:
    """Chi-square per sample of the runs."""
    return float(sum(np.sum(systems[n].error**2) for n in names) / sum(int(systems[n].used.sum()) for n in names))


def _responses(system: LtvModel, nodes: Sequence[str], places: Sequence[Place]) -> Array:
    """The responses of the outputs (N m, places), in noise, to the same random walk of size 1 at each place."""
    w = np.cumsum(np.random.default_rng(0).standard_normal(len(system.time)))
    w /= np.sqrt(np.mean(w**2))
    unknown = Unknown(system, nodes, places, np.ones(len(places)))
    n = unknown.n
    x = np.zeros((len(places), n))
    responses = np.empty((len(system.time), system.error.shape[1], len(places)))
    for i in range(len(system.time)):
        if i:
            x = x @ system.phi[i - 1, :, :n].T + unknown.gamma[i - 1] * ((w[i - 1] + w[i]) / 2)
        responses[i] = (x @ system.c[i, :, :n].T + unknown.d[i] * w[i]).T
    return responses.reshape(-1, len(places))
