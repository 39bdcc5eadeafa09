"""Localisation of the misfit of a model: by time, channel, state of motion and place of the diagram."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Collection, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from heavebond.core import facade
from heavebond.core.errors import Problem, UsageError, suggest
from heavebond.core.presentation import brief, number, readable
from heavebond.core.progress import Progress
from heavebond.core.reporting import reporting
from heavebond.core.units import dimension_text, read_unit
from heavebond.equations.places import Place
from heavebond.estimation.channel_noise import with_noise
from heavebond.estimation.comparison import compare
from heavebond.estimation.excerpts import EXCERPTS, excerpt
from heavebond.estimation.experiment import Experiment, ExperimentOrFile, load_experiment
from heavebond.estimation.fitting import Fit
from heavebond.estimation.records import measure
from heavebond.localise.constants import INPUT_ESTIMATION
from heavebond.localise.curves import Curve, Design, Mask, Variable, best_curve, regression
from heavebond.localise.error_states import RecordSection, State, envelope, states, stretches, worst
from heavebond.localise.input_estimation import Estimate, Ranked, Search, misfit
from heavebond.localise.kalman_smoother import Unknown
from heavebond.localise.ltv_model import SourcedRecord, known_of
from heavebond.localise.regressors import Regressors, estimated
from heavebond.numerics.dae import Array, Assembly


@dataclass(frozen=True)
class ImpliedInput:
    """The implied input at a place in one record: `value` (N,) with its standard deviation, in SI (`unit`); the variables
    around it by formula (`local`), in SI."""

    record: str
    time: Array
    value: Array
    deviation: Array
    unit: str
    local: dict[str, Array]


@dataclass(frozen=True)
class PlaceEstimate:
    """A place, and the quality with which an input there explains the misfit.

    explained: share of the log likelihood between the parameters alone and pure noise, with the penalty; behind: difference
    of its log likelihood to the best; alike: names of places that the records cannot distinguish from it; curve: the
    variable that best predicts the input, with R2 on samples not learnt from; implied: the input, by record.
    """

    place: Place
    explained: float
    behind: float
    alike: tuple[str, ...]
    curve: Curve | None
    implied: dict[str, ImpliedInput]
    words: str

    @property
    def rms(self) -> float:
        """RMS of the estimated input over all records, in SI."""
        return float(np.sqrt(np.mean(np.concatenate([i.value for i in self.implied.values()])**2)))

    @property
    def deviation(self) -> float:
        """Median standard deviation of the estimated input, in SI."""
        return float(np.median(np.concatenate([i.deviation for i in self.implied.values()])))

    def as_dict(self) -> dict[str, object]:
        """The figures, for machines."""
        curve = self.curve
        curve_figures = None if curve is None else {
            "variable": curve.variable.formula, "kind": curve.variable.kind, "r2": curve.r2, "shape": curve.shape,
            "shape_r2": curve.shape_r2, "times": curve.times, "second": curve.second.formula if curve.second else "",
            "scores": curve.scores, "x": curve.x.tolist(), "y": curve.y.tolist(), "y_down": curve.y_down.tolist()}
        return {"place": self.place.name, "nodes": [n.name for n in self.place.nodes],
                "components": list(self.place.components), "explained": self.explained, "behind": self.behind,
                "alike": list(self.alike), "unit": self.place.unit.text, "rms": self.rms, "deviation": self.deviation,
                "curve": curve_figures, "words": self.words}


def _place_text(suspect: PlaceEstimate) -> str:
    """A place and the quality with which its best variable predicts its input."""
    curve = suspect.curve
    curve_text = f" (R2 {max(curve.r2, 0.0):.2f} with {curve.variable.formula})" if curve is not None else ""
    return suspect.place.words + curve_text


@dataclass(frozen=True)
class Localization(facade.Displayed):
    """The location of a model error: when it occurs and the places that may cause it, the likeliest first.

    `missing` is true if there is more than parameters and noise explain, `chance` is the p value of the opposite; `chi2` is
    the reduced chi-square of the runs with `values` (by record, in SI) on the fitted records.
    """

    experiment: Experiment
    missing: bool
    chance: float
    chi2: float
    suspects: tuple[PlaceEstimate, ...]
    unseen: tuple[str, ...]
    stretches: tuple[RecordSection, ...]
    states: tuple[State, ...]
    values: Mapping[str, Mapping[str, float]]
    foreseen: bool

    def __repr__(self) -> str:
        return brief(self, self.experiment.name, *self.words)

    @property
    def words(self) -> tuple[str, ...]:
        """The result in sentences."""
        if not self.missing:
            return ("No effect is missing at any place: the residual of the fitted parameters is noise.",
                    ) if self.chi2 < 1.5 else (
                "The residual is not a force or flow at any place of this diagram.",)
        best = self.suspects[0]
        sentences = [best.words]
        same = [s for s in self.suspects if s.place.name in best.alike]
        if same:
            places = "; ".join(map(_place_text, same))
            sentences.append(f"By its effect on these records it could as well act {places}.")
        rivals = [s for s in self.suspects[1:] if s.behind < INPUT_ESTIMATION.distinct and s.place.name not in best.alike]
        if rivals:
            sentences.append("As likely: " + "; ".join(map(_place_text, rivals)) + ".")
        if not self.foreseen:
            sentences.append("The machine is far from linear in the input there: its size and shape are approximate.")
        return tuple(sentences)

    def implied(self, place: str) -> dict[str, ImpliedInput]:
        """Estimated unknown input at a place for each record, on its time grid (N,), in SI.

        Raises UsageError for a place that was not estimated.
        """
        for suspect in self.suspects:
            if suspect.place.name == place:
                return suspect.implied
        names = [s.place.name for s in self.suspects]
        raise UsageError([Problem("place-unknown", f"nothing was estimated at '{place}'", None,
                                  suggest(place, names) or f"Places: {', '.join(names)}.")])

    def as_dict(self) -> dict[str, object]:
        """The result without time series as a dictionary of plain values, in SI."""
        return {"missing": self.missing, "chance": self.chance, "chi2_per_sample": self.chi2, "words": list(self.words),
                "places": [s.as_dict() for s in self.suspects], "unseen": list(self.unseen), "foreseen": self.foreseen,
                "stretches": [{"record": s.record, "from": s.begin, "to": s.end, "chi2_per_sample": s.chi2}
                              for s in self.stretches],
                "states": [{"channel": s.channel, "variable": s.variable, "r2": s.r2, "chance": s.chance}
                           for s in self.states], "values": {n: dict(v) for n, v in self.values.items()}}


@reporting
def localize(experiment: ExperimentOrFile, *, values: Fit | Mapping[str, float | str] | None = None,
             progress: Callable[[str], None] | None = None, besides: Collection[Set[str]] | None = None
             ) -> Localization:
    """Localise a model error: when, in what state of motion and at which place of its diagram a model fails its records.

    The unknown input at each place (in SI) is estimated together with the free parameters and initial values of
    `experiment`, beginning at the parameters of the diagram or at `values` (a fit, or values by name, in SI or as text with
    a unit), so that no fit is needed before. The beginning of long records is used (see `estimation.excerpts`). With
    `besides`, names of nodes, only places that are about as likely as the best and those at just these nodes are estimated
    in full. `progress` is called with a text at each step. Raises the errors of `compare`.
    """
    say = progress or (lambda text: None)
    experiment = beginning(with_noise(load_experiment(experiment)), values)
    with tempfile.TemporaryDirectory() as folder:
        search, estimate = estimated_inputs(experiment, Path(folder), values, say, besides)
    say("searching for the variables of the input")
    missing = estimate.chance < INPUT_ESTIMATION.level
    suspects = [s for k, ranked in enumerate(estimate.full) for s in _group(search, estimate, k, ranked)] if missing else []
    return Localization(experiment, missing, estimate.chance, misfit(estimate.base, search.fitted), tuple(suspects),
                        tuple(p.name for p in estimate.unseen), *_when(experiment, search, estimate), estimate.values,
                        estimate.foreseen)


def estimated_inputs(experiment: Experiment, folder: Path, values: Fit | Mapping[str, float | str] | None, say: Progress,
                     besides: Collection[Set[str]] | None = None) -> tuple[Search, Estimate]:
    """The records with their machines, and the estimated input at each place; `folder` holds files of the runs while the
    result is used, the other arguments as in `localize`."""
    records = sorted(experiment.records.values(), key=lambda r: r.use != "fit")
    sides = [SourcedRecord(experiment, record, folder) for record in records]
    if not sides[0].places:
        raise UsageError([Problem(
            "place-none", "the diagram has no node at which an unknown input could act", None,
            "Unknown inputs act on nodes of one effort and on nodes in space; a planar node has three efforts.\n"
            "Join a PlanarShaft, a PlanarSlider or a PlanarStrut where one may act.")])
    p = sides[0].assembly.parameter_values
    search = Search(sides, [known_of(free, p[free.name]) for free in experiment.free.values()], say)
    def in_full(ranked: Sequence[Ranked]) -> Sequence[Ranked]:
        first = ranked[:INPUT_ESTIMATION.max_places]
        return first if besides is None else [
            group for group in first if first[0].likelihood - group.likelihood < INPUT_ESTIMATION.distinct
            or any({node.name for node in place.nodes} in besides for place in group.group.places)]

    return search, search.estimate({r.name: _known_values(values, r.name, sides[0].assembly) for r in records}, in_full)


def beginning(experiment: Experiment, values: Fit | Mapping[str, float | str] | None) -> Experiment:
    """The beginning of long records, other records unchanged: the effort grows with samples times places."""
    if sum(len(measure(experiment, r).grid) for r in experiment.records.values() if r.use == "fit") <= EXCERPTS.long:
        return experiment
    return excerpt(experiment, values.after if isinstance(values, Fit) else compare(experiment, parameters=values))


def _known_values(values: Fit | Mapping[str, float | str] | None, record: str, assembly: Assembly) -> dict[str, float]:
    if isinstance(values, Fit):
        return {p.name: p.value for p in values.parameters if p.record in ("", record)}
    known = assembly.with_parameters(values or {}).parameter_values
    return {name: known[name] for name in values or {}}


def _learn(search: Search) -> list[Mask]:
    """True for samples of each record that are learnt from: those to be fitted."""
    return [side.learn for side in search.sides]


# -- where in the diagram ------------------------------------------------------------------------------------------------
def _group(search: Search, estimate: Estimate, k: int, ranked: Ranked) -> list[PlaceEstimate]:
    """The places of one group, first the one whose variables best predict the input."""
    w, deviation, by_parameters, around = input_at(search, estimate, k, ranked)
    suspects = [_suspect(search, estimate, ranked, k, w, deviation, by_parameters, around)
                for k in range(len(ranked.group.places))]
    # a pair of nodes says more than a node; it stands first and keeps its place unless another is clearly better
    return sorted(suspects, key=lambda s: -round(s.curve.r2 if s.curve else 0.0, 2))


def input_at(search: Search, estimate: Estimate, k: int, ranked: Ranked) -> tuple[Array, Array, Array, Regressors]:
    """The input estimated at the first place of the k-th group: w (N,) with the parameters at their known values, its
    standard deviation (N,), its derivatives by the parameters (N, q), and the signals around it, over all records one after
    another."""
    mean = -search.centre(estimate.systems)
    side, first = search.sides[0], ranked.group.places[0]
    vector = np.array([first.weights.get(node, 0.0) for node in side.nodes])
    parts, by_parameters, signals = [], [], []
    for s in search.sides:
        name = s.record.name
        columns, smoothed = search.columns(name), estimate.smoothed[name]
        w, states_, _ = smoothed.at(k, mean[columns])
        both = np.concatenate([states_, np.tile(mean[columns], (len(w), 1))], axis=1)
        signals.append(estimated(estimate.systems[name], s.locals, both, w[:, None] * vector))
        wide = np.zeros((len(w), search.width))
        wide[:, columns] = smoothed.w[:, k, 1:]
        parts.append((w, smoothed.deviation[:, k]))
        by_parameters.append(wide)
    around = Regressors(side.assembly.flat, side.nodes, {n: np.concatenate([s[n] for s in signals]) for n in signals[0]},
                        [s.time for s in search.sides])
    w, deviation = (np.concatenate(both) for both in zip(*parts, strict=True))
    return w, deviation, np.concatenate(by_parameters), around


def _suspect(search: Search, estimate: Estimate, ranked: Ranked, k: int, w: Array, deviation: Array, by_parameters: Array,
             around: Regressors) -> PlaceEstimate:
    """The k-th place of a group: w (N,) is the input at its first place with the parameters at their known values, and
    `by_parameters` (N, k) its derivatives by them."""
    place, ratio = ranked.group.places[k], ranked.group.ratios[k]
    alike = tuple(p.name for p in ranked.group.places if p is not place)
    variables, learn = around.variables(place), np.concatenate(_learn(search))
    design = Design(variables, learn)
    mean = -search.centre(estimate.systems)
    # the responses of the outputs of all records to the functions of a design at a place
    parts, counts = [], []
    begin = 0
    for s in search.sides:
        system, end = estimate.systems[s.record.name], begin + len(s.time)
        innovations = Unknown(system, list(s.nodes), [place], np.ones(1)).innovations(design.columns[begin:end])
        wide = np.zeros((*innovations.shape[:2], 1 + search.width + design.columns.shape[1]))
        wide[:, :, [0, *(1 + search.columns(s.record.name))]] = innovations[:, :, :1 + len(search.known)]
        wide[:, :, 1 + search.width:] = innovations[:, :, 1 + len(search.known):]
        parts.append(wide)
        counts.append(s.used.sum(axis=1))
        begin = end
    curve = best_curve(design, regression(np.concatenate(parts), learn, np.concatenate(counts), mean), learn)
    value = (w + by_parameters @ (curve.q - mean) if curve is not None else w) * ratio
    implied = implied_inputs(search, place, value, deviation * abs(ratio), variables)
    place_estimate = PlaceEstimate(place, estimate.explained(ranked), estimate.ranked[0].likelihood - ranked.likelihood,
                                   alike, curve,
                                   implied, "")
    return replace(place_estimate, words=words_of(place_estimate))


def implied_inputs(search: Search, place: Place, value: Array, deviation: Array, variables: Sequence[Variable]
                   ) -> dict[str, ImpliedInput]:
    """The input at a place by record, from its values (N,) and standard deviations (N,) over all records one after
    another, with the variables there."""
    ends = np.cumsum([0, *(len(s.time) for s in search.sides)])
    return {s.record.name: ImpliedInput(s.record.name, s.time, value[a:b], deviation[a:b], place.unit.text,
                                        {v.formula: v.values[a:b] for v in variables})
            for s, a, b in zip(search.sides, ends[:-1], ends[1:], strict=True)}


# -- when, and in what state of motion -----------------------------------------------------------------------------------
def _when(experiment: Experiment, search: Search, estimate: Estimate) -> tuple[tuple[RecordSection, ...], tuple[State, ...]]:
    parts: list[RecordSection] = []
    states_of_errors: list[State] = []
    learn = np.concatenate(_learn(search))
    locals_ = search.sides[0].locals
    systems = [estimate.base[s.record.name] for s in search.sides]
    for s, system in zip(search.sides, systems, strict=True):
        parts += stretches(s.record.name, s.time, dict(zip(experiment.outputs, system.error.T, strict=True)),
                           dict(zip(experiment.outputs, s.used.T, strict=True)))
    signals = {s.name: (s.unit.text, np.concatenate([system.local[:, k] for system in systems]))
               for k, s in enumerate(locals_)}
    for c, (name, output) in enumerate(experiment.outputs.items()):
        unit = read_unit(output.shown.unit)
        used = [s.used[:, c] for s in search.sides]
        error = np.concatenate([system.error[u, c] * s.noise[c]
                                for s, u, system in zip(search.sides, used, systems, strict=True)])
        both = [envelope(s.measured[u, c], s.time[u]) for s, u in zip(search.sides, used, strict=True)]
        amplitudes = {f"amplitude of {name}": (dimension_text(read_unit(output.shown.unit).dimension),
                                               np.concatenate([a for a, _ in both])),
                      f"frequency of {name}": ("Hz", np.concatenate([f for _, f in both]))}
        every = np.concatenate(used)
        signals_here = {n: (text, values[every]) for n, (text, values) in signals.items()}
        states_of_errors += states(name, error / unit.scale, {**signals_here, **amplitudes}, learn[every])[:3]
    return tuple(parts), tuple(states_of_errors)


# -- words ---------------------------------------------------------------------------------------------------------------
SHAPES = {
    "line": "in proportion", "step": "as a step at zero", "step and line": "as a step at zero and a slope",
    "falling step": "as a step at zero that is higher near it",
    "square": "with its square, against the motion", "line and square": "by a slope and its square", "root": "with its root",
    "cube": "with its cube", "line and cube": "by a slope and its cube", "parabola": "along a parabola",
    "one-sided above": "on one side only, above a certain value",
    "one-sided below": "on one side only, below a certain value",
    "dead band": "beyond a dead band only", "saturation": "up to certain values, beyond which it stays",
    "loop": "along a loop, one way going up and another going down", "curve": "along an unnamed curve",
}
LOOKS = {
    ("across", "step"): "dry friction", ("across", "step and line"): "dry friction", ("across", "line"): "a damper",
    ("across", "falling step"): "dry friction with stiction",
    ("across", "loop"): "friction that gives before it slides, or hysteresis,",
    ("across", "square"): "quadratic drag", ("across", "line and square"): "quadratic drag",
    ("position", "line"): "a spring, or a stiffness that is wrong,", ("position", "parabola"): "a spring that is not linear",
    ("position", "cube"): "a hardening or softening spring",
    ("position", "line and cube"): "a hardening or softening spring",
    ("position", "one-sided above"): "an end stop", ("position", "one-sided below"): "an end stop",
    ("position", "dead band"): "stops at both ends, or play,", ("position", "saturation"): "play where the model has none",
    ("position", "loop"): "hysteresis", ("rate", "line"): "an added mass",
}
FLOWS = {("across", "line"): "laminar leakage", ("across", "root"): "an orifice", ("pressure", "line"): "leakage",
         ("rate", "line"): "a compliance, a hose or entrained air", ("across", "one-sided above"): "a relief valve"}


# The same with a height that changes with a pressure.
PRESSED = {(kind, shape): "the friction of a seal that the pressure presses" for kind, shape in LOOKS
           if LOOKS[kind, shape].startswith("dry friction")}


def noun(suspect: PlaceEstimate) -> str:
    """The missing quantity at a place in one word: force, volume flow, current."""
    node = suspect.place.nodes[0]
    return node.domain.members[node.through].noun


def shape_words(curve: Curve) -> str:
    """The dependence of an unknown input on its variables, in words."""
    return SHAPES[curve.shape] + (f", times {curve.times}" if curve.times else "") + \
        (f", and changes with the {curve.second.phrase}" if curve.second is not None else "")


def words_of(suspect: PlaceEstimate) -> str:
    """Sentences on one place."""
    place, curve = suspect.place, suspect.curve
    quantity = noun(suspect)
    size = readable(suspect.rms, place.unit.text, 2)
    first = f"{place.words[:1].upper()}{place.words[1:]} a {quantity} is missing (rms {size}); "
    if curve is None or curve.r2 < INPUT_ESTIMATION.explains:
        best = f" (at best {curve.variable.phrase}, R2 {max(curve.r2, 0):.2f})" if curve is not None else ""
        reason = "it is hardly larger than its uncertainty." if suspect.rms < 2 * suspect.deviation \
            else "that means memory (hysteresis), several variables at once, or the wrong place."
        return first + f"no single variable explains it{best}: {reason}"
    shape = shape_words(curve)
    looks = (LOOKS if place.nodes[0].mechanical else FLOWS).get((curve.variable.kind, curve.shape), "")
    if curve.times or curve.second is not None:
        second = next((f for f in (curve.times, curve.second.formula if curve.second else "") if f), "")
        pressed = place.nodes[0].mechanical and curve.units.get(second) == "Pa"
        looks = PRESSED.get((curve.variable.kind, curve.shape), "") if pressed else ""
    end = f": this is typical of {looks.removesuffix(',')}." if looks else "."
    return first + f"it follows the {curve.variable.phrase} (R2 {number(curve.r2, 2)} on data not used), {shape}{end}"


def summary(localization: Localization) -> list[str]:
    """When and in what state of motion the model fails, in sentences."""
    lines = []
    if localization.stretches:
        part = worst(localization.stretches)
        channel = max(part.chi2, key=lambda n: part.chi2[n])
        lines.append(f"The error is largest in {part.record} from {part.begin:.4g} s to {part.end:.4g} s, in {channel} "
                     f"(reduced chi-square {number(part.chi2[channel], 3)}).")
    for channel in dict.fromkeys(s.channel for s in localization.states):
        states_of_channel = [s for s in localization.states if s.channel == channel]
        lines.append(f"The error of {channel} follows " + ", ".join(f"{s.variable} (R2 {s.r2:.2f})"
                                                                    for s in states_of_channel) + ".")
    return lines


def best_of_each_group(localization: Localization) -> Sequence[PlaceEstimate]:
    """The best place of each group."""
    groups: set[frozenset[str]] = set()
    places = []
    for suspect in localization.suspects:
        key = frozenset((suspect.place.name, *suspect.alike))
        if key not in groups:
            groups.add(key)
            places.append(suspect)
    return places
