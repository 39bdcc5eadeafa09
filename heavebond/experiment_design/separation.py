"""The experiment that distinguishes the alternatives of a diagnosis: one input, simulated with every alternative.

With y_i(p) (n,) the channels divided by their noise under alternative i and P the priors of its free parameters p, within
their bounds,

    D = min(D_ij, D_ji),     D_ij = min over p of |y_j - y_i(p)|**2 + (p - p_i)'P (p - p_i),

is the difference that no values of either one's parameters can absorb: if j is right, a fit of i to the new record leaves
chi-square higher by D on average, with a standard deviation of 2 sqrt(D). All inputs are compared by D along the tangent
at the fitted values p_i, a bounded linear least squares problem; the best ones are fitted. The old records are not used,
because the new record must decide alone. The proposed input decides most pairs, and among such inputs has the largest
difference of its worst pair. W. G. Hunter, A. M. Reiner, Designs for discriminating between two rival models,
Technometrics 7 (1965), doi:10.1080/00401706.1965.10490265.
"""

from __future__ import annotations

import time as clock
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from heavebond.core.errors import ModelError, SimulationError, StartError, listing
from heavebond.core.presentation import number, quantity, readable, readable_difference
from heavebond.core.progress import Progress
from heavebond.core.units import read_unit
from heavebond.equations.flatten import KnownInput
from heavebond.estimation.comparison import assemble_for
from heavebond.estimation.experiment import Experiment, Record
from heavebond.estimation.records import measure
from heavebond.experiment_design.proposals import Limits, Proposal, Recorded, family, recorded
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.inputs import Pieced, read_input
from heavebond.numerics.quick_simulation import QuickSimulator
from heavebond.numerics.result import Probe
from heavebond.numerics.simulator import Tolerances
from heavebond.records.piecewise import align, evaluate, pieces

STEPS = 6  # iterations of a fit of one alternative to another
# finer than a search, because small differences of runs are needed
FINE = Tolerances(1e-6, 1e-8)


@dataclass(frozen=True)
class Alternative:
    """A diagram that is compatible with the records: its name, its experiment, the fitted values (SI), and the number of
    samples in the records."""

    label: str
    experiment: Experiment
    values: Mapping[str, float]
    samples: int


@dataclass(frozen=True)
class AlternativeRun:
    """A run of one alternative with the values p (m,) of its free parameters: the probed variables (n_y, N) in SI, and
    their derivatives (m, n_y, N)."""

    p: Array
    values: Array
    moved: Array


class PreparedAlternative:
    """An alternative ready to be run with many inputs."""

    def __init__(self, alternative: Alternative, record: Record, time: Array, known: Mapping[str, Array]):
        experiment = alternative.experiment
        assembly = assemble_for(experiment, record)
        names = set(assembly.parameter_values)
        self.label = alternative.label
        self.time = time
        self.assembly: Assembly = assembly.with_parameters({n: v for n, v in alternative.values.items() if n in names})
        self.simulator = QuickSimulator(self.assembly, times=time, tolerances=FINE, sensitivities=list(experiment.free),
                                        driven=self.pieced(known))
        ranges = [f.range for f in experiment.free.values()]
        self.names = list(experiment.free)
        self.fitted = np.array([self.assembly.parameter_values[name] for name in self.names])
        self.low, self.high = (np.array([getattr(r, end) for r in ranges]) for end in ("low", "high"))
        # 1/sigma of each prior, 0 without one
        self.precision = np.sqrt([0.0 if r.nominal is None else (2 / (r.high - r.nominal)) ** 2 for r in ranges])
        self.probe = Probe(self.assembly, [o.shown.text for o in experiment.outputs.values()], si=True)

    def pieced(self, known: Mapping[str, Array]) -> Pieced:
        """Inputs by column, (N,) in SI at the times of the run, as pieces between those."""
        inputs = self.assembly.flat.inputs
        pieced_inputs = [pieces(self.time, known[k.source.column] if k.source.column in known else self._elsewhere(k),
                                k.source.interpolation) for k in inputs]
        breaks, coefficients = align(pieced_inputs, float(self.time[0]), float(self.time[-1]),
                                     names=[k.name for k in inputs])
        return Pieced(breaks, np.vstack([breaks[:-1], coefficients.reshape(len(breaks) - 1, -1).T]))

    def _elsewhere(self, known: KnownInput) -> Array:
        """An input that the diagram reads from another file."""
        signal = read_input(known, float(self.time[0]), float(self.time[-1]))
        return evaluate(signal, self.time)

    def run(self, known: Mapping[str, Array], probe: Probe | None = None, p: Array | None = None) -> AlternativeRun:
        """One run; SimulationError or StartError if it fails."""
        simulator = copy(self.simulator)
        simulator.pieces = self.pieced(known)
        if simulator.looks_up or simulator.compiled:  # the integrator contains the input
            simulator.prepare()
        p = self.fitted if p is None else p
        result, probe = simulator.run(dict(zip(self.names, p.tolist(), strict=True))), probe or self.probe
        sensitivities = probe.sensitivities(result) if self.names else np.zeros((0, len(probe.names), len(self.time)))
        return AlternativeRun(p, probe.values(result), sensitivities)

    def left(self, first: AlternativeRun, second: AlternativeRun, weight: Array) -> tuple[Array, Array]:
        """The difference between its run and another's (n_y, N) that its parameters cannot absorb, along the tangent, and
        their step (m,); `weight` (n_y,) is sqrt(samples that each one represents) / noise."""
        from scipy.optimize import lsq_linear

        d = ((second.values - first.values) * weight[:, None]).ravel()
        if not self.names:
            return d.reshape(first.values.shape), np.zeros(0)
        J = (first.moved * weight[None, :, None]).reshape(len(first.moved), -1).T
        rows = np.vstack([J, np.diag(self.precision)])
        scale = np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
        q, r = np.linalg.qr(rows / scale)
        target = q.T @ np.concatenate([d, self.precision * (self.fitted - first.p)])
        room = (np.minimum(self.low - first.p, 0.0) * scale - 1e-9, np.maximum(self.high - first.p, 0.0) * scale + 1e-9)
        step = np.clip(first.p + lsq_linear(r, target, room, method="bvls").x / scale, self.low, self.high) - first.p
        return (d - J @ step).reshape(first.values.shape), step

    def imitating(self, imitated: AlternativeRun, other: AlternativeRun, known: Mapping[str, Array], weight: Array) -> Array:
        """The same with fitted parameters: Gauss-Newton steps, halved until they reduce the difference."""
        def distance(run: AlternativeRun) -> float:
            off = (other.values - run.values) * weight[:, None]
            return float(np.sum(off**2) + np.sum((self.precision * (run.p - self.fitted)) ** 2))

        for _ in range(STEPS if self.names else 0):
            step, before, better = self.left(imitated, other, weight)[1], distance(imitated), imitated
            for share in (1.0, 0.5, 0.1):
                try:
                    seen = self.run(known, p=imitated.p + share * step)
                except (ModelError, SimulationError, StartError):
                    continue
                if distance(seen) < before:
                    better = seen
                    break
            imitated = better
            if distance(imitated) > 0.99 * before:
                break
        return np.asarray((other.values - imitated.values) * weight[:, None])


POINTS = 1000  # largest number of simulated samples of an input
MOST = 5  # number of compared alternatives, the most probable ones
SURE = 0.95  # probability of the right decision from which a pair counts as distinguished
REACH = 0.5  # share of their range by which channels may leave the range of the records
RANGE_NOISE = 1e-3  # assumed noise of an unmeasured channel, as a share of its range
REFITTED = 8  # number of inputs for which the alternatives are fitted to each other, the best along the tangent
ENOUGH = 10.0  # multiple of the required difference at which the search for inputs ends
SECONDS = 40.0  # time after which no further input is simulated, and half as long again after which none is refined
CLOSER = 3  # number of inputs that are examined again in the search for a further channel


@dataclass(frozen=True)
class Pair:
    """Two alternatives under one input: the difference of chi-square under the wrong one (D), the channel with the
    largest difference, its time (s), its size in units of noise, and the probability of the right decision."""

    one: str
    other: str
    chi2: float
    channel: str
    at: float
    size: float
    sure: float


@dataclass(frozen=True)
class Predicted:
    """A channel under every alternative (alternatives, N), in its unit."""

    unit: str
    noise: float
    values: Array


@dataclass(frozen=True)
class AdditionalSensor:
    """A variable that would distinguish the alternatives if it were measured with `noise` (in `unit`), and the smallest D
    of all pairs then."""

    name: str
    unit: str
    noise: float
    chi2: float


@dataclass(frozen=True)
class SimulatedInput:
    """One simulated input and its effect on every pair, with the alternatives `refitted` to each other or along the
    tangent."""

    proposal: Proposal
    pairs: tuple[Pair, ...]
    refitted: bool = False

    @property
    def smallest(self) -> float:
        return min(p.chi2 for p in self.pairs)

    @property
    def decided(self) -> int:
        """Number of pairs that it distinguishes."""
        return sum(p.sure >= SURE for p in self.pairs)

    @property
    def least(self) -> Pair:
        """The least distinct pair, among the distinguished ones if there are any."""
        return min(self.pairs, key=lambda p: (p.sure < SURE and self.decided > 0, p.chi2))


@dataclass(frozen=True)
class Separation:
    """The proposal. `best` is the input that distinguishes most pairs, None if none could be simulated; `tried` all of
    them, best first; `time` (N,) s and `channels` are its run under every alternative, the input itself in SI in
    `best.proposal.values`; `columns` are the file to drive the machine, with the names and units of the records."""

    alternatives: tuple[str, ...]
    limits: Mapping[str, tuple[Limits, str]]
    tried: tuple[SimulatedInput, ...]
    needed: float
    time: Array
    channels: Mapping[str, Predicted]
    columns: Mapping[str, Array]
    extra: AdditionalSensor | None
    words: tuple[str, ...]

    @property
    def best(self) -> SimulatedInput | None:
        return self.tried[0] if self.tried else None

    @property
    def decides(self) -> bool:
        """True if the proposed input distinguishes at least two of the alternatives."""
        return self.best is not None and self.best.decided > 0

    def as_dict(self) -> dict[str, object]:
        best, extra = self.best, self.extra
        return {
            "alternatives": list(self.alternatives), "decides": self.decides, "needed": self.needed,
            "limits": {name: {"low": limit.low, "high": limit.high, "rate": limit.rate if np.isfinite(limit.rate) else None,
                              "unit": unit} for name, (limit, unit) in self.limits.items()},
            "proposal": best and {**_formed(best.proposal), "level": best.proposal.level, "length": float(self.time[-1])},
            "pairs": [{"one": p.one, "other": p.other, "rise": p.chi2, "channel": p.channel, "at": p.at, "apart": p.size,
                       "sure": p.sure} for p in best.pairs] if best else [],
            "tried": [{**_formed(t.proposal), "rise": t.smallest, "decided": t.decided, "closely": t.refitted}
                      for t in self.tried],
            "extra": extra and {"variable": extra.name, "unit": extra.unit, "noise_taken": extra.noise, "rise": extra.chi2},
            "words": list(self.words)}


def _formed(proposal: Proposal) -> dict[str, object]:
    """The description of an input for JSON."""
    return {"input": proposal.input, "form": proposal.shape, "amplitude": proposal.amplitude,
            "frequency": proposal.frequency}


@dataclass(frozen=True)
class _Frame:
    """Common data of all runs: the record with the settings, its inputs by column, the times (N,) in s and the number of
    samples of a record that each represents, the noise of the channels (n_y,) and their permitted range (n_y, 2), in
    SI, and the required chi-square."""

    record: Record
    known: tuple[KnownInput, ...]
    seen: Mapping[str, Recorded]
    time: Array
    finer: int
    weight: Array
    noise: Array
    reach: Array
    needed: float

    def within(self, runs: Sequence[AlternativeRun]) -> bool:
        """True if every channel stays near the range of the records: an integrating drive leaves it with other inputs."""
        return all(bool(np.all((s.values >= self.reach[:, :1]) & (s.values <= self.reach[:, 1:]))) for s in runs)

    def quiet(self) -> dict[str, Array]:
        """Every input at the first value of its record."""
        return {k.source.column: np.full(len(self.time), self.seen[k.name].limits.start) for k in self.known}

    def with_proposal(self, proposal: Proposal) -> dict[str, Array]:
        """The same with one proposed input."""
        column = next(k.source.column for k in self.known if k.name == proposal.input)
        return {**self.quiet(), column: proposal.values}


def separate(alternatives: Sequence[Alternative], *, machine: Experiment | None = None, seconds: float = SECONDS,
             progress: Progress | None = None) -> Separation:
    """Propose the input that distinguishes alternatives: two or more diagrams on the same records.

    Every input that a record drives is varied in many shapes within the limits of the records (see `proposals`), the
    others keep their first values; no further input is simulated after `seconds`. A further channel is sought among the
    variables of `machine`, the experiment without the additions of the alternatives (without one, among all common
    variables): the state of a hysteresis that may be missing cannot be measured. Raises DataError if a record cannot be
    read and ModelError if a diagram cannot be assembled.
    """
    say, began = progress or (lambda text: None), clock.perf_counter()
    alternatives = alternatives[:MOST]
    frame = _frame(alternatives)
    rivals = [PreparedAlternative(a, frame.record, frame.time, frame.quiet()) for a in alternatives]
    proposals = [p for k in frame.known if frame.seen[k.name].limits.half > 0
                 for p in family(k.name, frame.time, frame.seen[k.name])]
    names = list(alternatives[0].experiment.outputs)
    tried: list[SimulatedInput] = []
    # an order with shapes of all kinds early: every fifth, then the ones after these
    for k, proposal in enumerate([p for first in range(5) for p in proposals[first::5]], 1):
        if clock.perf_counter() - began > seconds and tried:
            break
        say(f"simulating input {k} of {len(proposals)}: {proposal.input}, {proposal.shape}")
        runs = _runs(rivals, frame.with_proposal(proposal))
        if runs is not None and frame.within(runs):
            tried.append(SimulatedInput(proposal, _pairs(rivals, runs, frame, names)))
    # all inputs, best first, with the alternatives fitted to each other for the best ones: the tangent may overestimate a
    # difference
    until = began + 1.5 * seconds
    order = sorted(tried, key=_merit)
    for k in range(REFITTED):
        good = any(t.refitted and t.decided == len(t.pairs) and t.smallest > ENOUGH * frame.needed for t in order)
        if not order or order[0].refitted or good or (k and clock.perf_counter() > until):
            break
        say(f"fitting the alternatives to each other under input {k + 1}")
        known = frame.with_proposal(order[0].proposal)
        runs = _runs(rivals, known) or []
        order[0] = SimulatedInput(order[0].proposal, _pairs(rivals, runs, frame, names, known), True)
        order.sort(key=_merit)
    tried = sorted(order, key=lambda t: (not t.refitted, *_merit(t)))
    extra = None
    if tried and not tried[0].decided:
        say("looking for a channel that distinguishes them")
        extra = _extra(rivals, frame, tried, machine)
    return _separation(alternatives, rivals, frame, tried, extra)


def _frame(alternatives: Sequence[Alternative]) -> _Frame:
    """Times and channels of the first fitted record of the first alternative."""
    first = alternatives[0].experiment
    record = next(r for r in first.records.values() if r.use == "fit")
    measured = measure(first, record)
    driven = first.inputs_for(record)
    known = tuple(k for k in assemble_for(first, record).flat.inputs if k.name in driven)
    step = float(np.median(np.diff(measured.grid)))
    count = round((measured.grid[-1] - measured.grid[0]) / step)
    finer = max(1, -(-count // POINTS))
    time = np.arange(count // finer + 1) * step * finer
    channels = measured.channels.values()
    samples = np.array([len(c.time) for c in channels])
    noise = np.array([c.noise * read_unit(c.output.shown.unit).scale for c in channels])
    needed = 10.0 + 0.003 * (float(samples.sum()) + max(a.samples for a in alternatives))
    recorded_inputs = {k.name: recorded(first, k, time) for k in known}
    values = [measure(first, record).on_grid()[0] for record in first.records.values()]
    low, high = (np.array([pick(v, axis=1) for v in values]) for pick in (np.nanmin, np.nanmax))
    low, high = low.min(axis=0), high.max(axis=0)
    return _Frame(record, known, recorded_inputs, time, finer, samples / len(time), noise,
                  np.column_stack([low - REACH * (high - low), high + REACH * (high - low)]), needed)


def _runs(rivals: Sequence[PreparedAlternative], known: Mapping[str, Array], probes: Sequence[Probe | None] | None = None
          ) -> list[AlternativeRun] | None:
    """All alternatives with the same inputs; None if one of them fails."""
    try:
        return [c.run(known, probe) for c, probe in zip(rivals, probes or [None] * len(rivals), strict=True)]
    except (ModelError, SimulationError, StartError):
        return None


def _pairs(rivals: Sequence[PreparedAlternative], runs: Sequence[AlternativeRun], frame: _Frame, names: Sequence[str],
           known: Mapping[str, Array] | None = None) -> tuple[Pair, ...]:
    """Every pair under one input; with `known`, the input itself, they are fitted to each other."""
    weight = np.sqrt(frame.weight) / frame.noise
    pairs = []
    for i, j in combinations(range(len(rivals)), 2):
        sides = [rivals[a].left(runs[a], runs[b], weight)[0] for a, b in ((i, j), (j, i))]
        # if the tangent finds no difference, no fit is needed
        if known is not None and min(float(np.sum(side**2)) for side in sides) > 1.0:
            sides = [rivals[a].imitating(runs[a], runs[b], known, weight) for a, b in ((i, j), (j, i))]
        d = min(sides, key=lambda side: float(np.sum(side**2)))
        channel = int(np.argmax(np.sum(d**2, axis=1)))
        at = int(np.argmax(np.abs(d[channel])))
        chi2 = float(np.sum(d**2))
        pairs.append(Pair(rivals[i].label, rivals[j].label, chi2, names[channel], float(frame.time[at]),
                          float(abs(d[channel, at])) / float(np.sqrt(frame.weight[channel])), _sure(chi2, frame.needed)))
    return tuple(pairs)


def _merit(tried: SimulatedInput) -> tuple[float, float]:
    """Sort key, smaller is better: number of decided pairs, and distinctness of the least distinct one."""
    return -tried.decided, -tried.least.chi2


def _sure(chi2: float, needed: float) -> float:
    """The probability that the difference of chi-square, which is normal about D with variance 4 D, reaches the required
    value.
    """
    from scipy.special import ndtr

    return float(ndtr((chi2 - needed) / (2 * np.sqrt(chi2)))) if chi2 > 0 else 0.0


def _extra(rivals: Sequence[PreparedAlternative], frame: _Frame, tried: Sequence[SimulatedInput],
           machine: Experiment | None) -> AdditionalSensor | None:
    """The variable of all diagrams that, as an additional channel, distinguishes most pairs under one of the better
    inputs; among about equal ones, a variable of a node or component rather than of a port."""
    flat = [r.assembly.flat for r in rivals] + ([assemble_for(machine, frame.record).flat] if machine is not None else [])
    units = [{u.name: u.unit.text for u in model.unknowns} for model in flat]
    names = [n for n in units[0] if all(n in others for others in units[1:])
             and n not in rivals[0].probe.names]
    probes = [Probe(r.assembly, [*r.probe.names, *names], si=True) for r in rivals]
    sensors: list[AdditionalSensor] = []
    for trial in tried[:CLOSER]:
        runs = _runs(rivals, frame.with_proposal(trial.proposal), probes)
        if runs is not None:
            sensors += [extra for k, name in enumerate(names, len(frame.noise))
                        if (extra := _measured_too(rivals, frame, runs, k, name, units[0][name])) is not None]
    most = max((e.chi2 for e in sensors), default=0.0)
    close = [e for e in sensors if e.chi2 > 0.5 * most > 0]
    return min(close, key=lambda e: (e.name.count("."), -e.chi2)) if close else None


def _measured_too(rivals: Sequence[PreparedAlternative], frame: _Frame, runs: Sequence[AlternativeRun], k: int, name: str,
                  unit: str
                  ) -> AdditionalSensor | None:
    """Gain by the k-th of the probed variables as an additional channel; None if it is constant."""
    noise = RANGE_NOISE * max(float(np.ptp(s.values[k])) for s in runs)
    if noise <= 1e-12 * max(float(np.abs(s.values[k]).max()) for s in runs):
        return None
    rows = [*range(len(frame.noise)), k]
    weight = np.sqrt(np.append(frame.weight, frame.weight.max())) / np.append(frame.noise, noise)
    cut = [AlternativeRun(s.p, s.values[rows], s.moved[:, rows]) for s in runs]
    pairs = [(a, b) for a in range(len(cut)) for b in range(len(cut)) if a != b]
    return AdditionalSensor(name, unit, noise, min(float(np.sum(rivals[a].left(cut[a], cut[b], weight)[0] ** 2))
                                                   for a, b in pairs))


def _separation(alternatives: Sequence[Alternative], rivals: Sequence[PreparedAlternative], frame: _Frame,
                tried: list[SimulatedInput],
                extra: AdditionalSensor | None) -> Separation:
    """The complete proposal, with the run of the best input."""
    channels: dict[str, Predicted] = {}
    columns: dict[str, Array] = {}
    if tried:
        known = frame.with_proposal(tried[0].proposal)
        runs = _runs(rivals, known) or []
        for k, (name, output) in enumerate(alternatives[0].experiment.outputs.items()):
            unit = output.shown.unit
            channels[name] = Predicted(unit, float(frame.noise[k]) / read_unit(unit).scale,
                                       np.array([_in(unit, s.values[k]) for s in runs]))
        columns = _columns(alternatives[0].experiment, frame, known)
    limits = {k.name: (frame.seen[k.name].limits, k.unit.text) for k in frame.known}
    separation = Separation(tuple(a.label for a in alternatives), limits, tuple(tried), frame.needed, frame.time, channels,
                            columns, extra, ())
    return replace(separation, words=_words(separation, frame))


def _columns(experiment: Experiment, frame: _Frame, known: Mapping[str, Array]) -> dict[str, Array]:
    """The file with the inputs: with the sampling, columns and units of the records."""
    count = (len(frame.time) - 1) * frame.finer
    time = np.linspace(0.0, float(frame.time[-1]), count + 1)
    axis = experiment.time
    columns = {"time [s]" if axis.every is not None else axis.column: _in(axis.unit, time)}
    for k in frame.known:
        signal = pieces(frame.time, known[k.source.column], k.source.interpolation)
        columns[k.source.column] = _in(k.source.unit, evaluate(signal, time)) / k.source.factor
    return columns


def _in(unit: str, values: Array) -> Array:
    """SI values in a unit."""
    read = read_unit(unit)
    return np.asarray((values - read.offset) / read.scale)


# -- text ----------------------------------------------------------------------------------------------------------
def _words(separation: Separation, frame: _Frame) -> tuple[str, ...]:
    if not frame.known:
        return ("No input is driven by a record, so no other one can be proposed.",)
    if separation.best is None:
        return ("No input was found that keeps the machine within the range of the records under all of them.",)
    best = separation.best
    if not separation.decides:
        lines = ["No input within the limits of the records would distinguish them with these channels: under the best, "
                 f"{described(separation)}, chi-square would differ by {number(best.smallest, 2)}, and "
                 f"{number(separation.needed, 2)} is needed."]
        extra = separation.extra
        if extra is None:
            extra_words = ("No further channel distinguishes them either.",)
        else:
            noun = quantity(extra.unit) or "variable"
            noise = readable_difference(extra.noise, extra.unit, 2)
            if _sure(extra.chi2, separation.needed) < SURE:
                extra_words = (f"No further channel distinguishes them either; the best is the {noun} {extra.name}.",)
            else:
                extra_words = (f"With the {noun} {extra.name} measured as well, with a noise of {noise}, chi-square would "
                               f"differ by {number(extra.chi2, 3)}.",)
        return (*lines, *extra_words)
    pair = best.least
    lines = [f"To distinguish them, record {described(separation)}.",
             f"{pair.one} and {pair.other} then differ most in {pair.channel}, near {number(pair.at, 3)} s by "
             f"{number(pair.size, 2)} times its noise; chi-square of the wrong one would be {number(pair.chi2, 3)} higher "
             f"({number(separation.needed, 2)} is needed), which decides {_chance(pair.sure)}."]
    alike = [f"{p.one} and {p.other}" for p in best.pairs if p.sure < SURE]
    if alike:
        lines.append(f"Still alike: {listing(alike, 6)}.")
    return tuple(lines)


def described(separation: Separation) -> str:
    """The proposed input: `vessel.u as a sine of 0.2 m at 0.1 Hz about 0 m for 120 s`."""
    assert separation.best is not None
    p, unit = separation.best.proposal, separation.limits[separation.best.proposal.input][1]
    shape = p.shape if p.shape.startswith(("the ", "steps", "small steps")) else f"a {p.shape}"
    often = f" at {number(p.frequency, 3)} Hz" if p.frequency is not None else ""
    level = "0" if abs(p.level) < 0.02 * p.amplitude else readable(p.level, unit, 3)
    return f"{p.input} as {shape}, amplitude {readable(p.amplitude, unit, 3)}{often} about {level}, for " \
        f"{number(float(separation.time[-1]), 3)} s"


def _chance(sure: float) -> str:
    return "in more than 99.9 of 100 cases" if sure > 0.999 else f"in {number(100 * sure, 3)} of 100 cases"
