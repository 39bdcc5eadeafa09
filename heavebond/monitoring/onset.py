"""Time at which a fault begins in a record that leaves the model: the posterior probability of each sample.

A fault is an input w that is zero until sample j: a through variable at a place of the diagram (see `places`), an error of a
channel, or a change of a free parameter. With the deviation s of the states and walking parameters from the prediction of
the filter, the corrections k of the filter, and the derivatives of its equations along its estimate,

    s_(i+1) = Phi_i (s_i - k_i) + Gamma_i w_i,   e_i = H_i s_i + D_i w_i + noise,   w_i = 0 for i < j.

From sample j on, w is a stationary Gaussian process with the covariance sigma^2 exp(-|t - t'|/tau) (a disturbance of unknown
course), or sigma * a * phi(t) with a constant, standard normal a. The signatures phi are laws of the place: its across
variable, the sign of this variable, its position, or 1. The likelihood of all samples for a change at j is exact:

    log p_j = log p(e_0 .. e_(j-1)) + log of the integral of N(s_j; 0, P_j) N(w_j; 0, sigma^2) exp(L_j(s_j, w_j)),

where the filter gives the first term and P_j, and a backward information filter the quadratic form L_j, the log likelihood
of the samples from j on (two-filter formula, D. Q. Mayne 1966, doi:10.1016/0005-1098(66)90019-7; the generalised likelihood
ratio for known signatures is A. S. Willsky, H. L. Jones 1976, doi:10.1109/TAC.1976.1101146). One backward pass gives all j.
Noise of another size is one more fault. All faults have the same prior probability, equally divided between their sigma and
tau, and so have all samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import casadi as ca
import numpy as np

from heavebond.equations.flatten import flatten
from heavebond.equations.places import Place, input_nodes, places_of, with_virtual_sources
from heavebond.equations.reduce import reduce_flattened
from heavebond.estimation.experiment import Record
from heavebond.language.symbols import stack
from heavebond.localise.ltv_model import Jacobians, Known, LocalSignal, known_of, stepped
from heavebond.monitoring.change_detection import Change
from heavebond.monitoring.kalman_filter import Estimator, SampledRecord
from heavebond.monitoring.radau_step import Point
from heavebond.numerics.dae import Array, Assembly, build
from heavebond.text.expression import names as names_in


@dataclass(frozen=True)
class OnsetConstants:
    """The constants of the dating of faults.

    sizes: sigma, in inputs that move the normalised innovations by 1 (rms). Origin: from a tenth of the noise to a thousand
        times the noise. Doubled: less precise for the faults between.
    times: tau, as a share of the window. Origin: disturbances that follow the motion, and slow ones. Doubled: later onsets
        of disturbances that change quickly.
    scales: standard deviations of noise of another size. Origin: as sizes. Doubled: as above.
    kept: faults of the first, coarse comparison that are compared in detail. Origin: places that are hard to distinguish.
        Doubled: twice the time.
    coarse: samples at which the first comparison is evaluated. Origin: a fraction of the time of the rest. Doubled: twice
        the time.
    before: samples of the window before the alarm, at most. Origin: some seconds of processor time. Doubled: twice the time;
        an onset long before its alarm is found.
    after: samples of the window after the alarm, at most. Origin: as before. Doubled: twice the time.
    excess: half of the sum of squares of the innovations above its expected value, from the alarm on, at which the window
        ends. Origin: this is ample for the time of a fault, and farther samples add errors of the linearisation. Doubled:
        faults that are hard to distinguish are compared over a longer time.
    """

    sizes: tuple[float, ...] = tuple(10.0 ** np.arange(-1.0, 3.1, 0.5))
    times: tuple[float, ...] = (0.3, 0.03)
    scales: tuple[float, ...] = (1.2, 1.5, 2.0, 3.0, 6.0)
    kept: int = 3
    coarse: int = 50
    before: int = 1000
    after: int = 1000
    excess: float = 1e4


ONSET = OnsetConstants()


@dataclass(frozen=True)
class Fault:
    """A fault: its name, the place, and its columns of Gamma (N-1, n+k) and D (N, m); `constant` if w is a constant times a
    signature, which is contained in the columns."""

    name: str
    group: str
    gamma: Array
    d: Array
    constant: bool


@dataclass(frozen=True, eq=False)
class FilteredWindow:
    """The filter along a window of a record, with s = n+k states and walking parameters: times (N,), predicted covariances
    `p` (N, s, s), errors `e` (N, m) of the predicted outputs over their noise, corrections `k` (N, s), the linear system of
    its errors `phi` (N-1, s, s) and `h` (N, m, s), and the squares of the process noise per second (s,)."""

    time: Array
    p: Array
    e: Array
    k: Array
    phi: Array
    h: Array
    noise: Array


@dataclass(frozen=True, eq=False)
class _Sourced:
    """The equations with virtual sources at `nodes`, their places, the signals that laws may read, the parameters that may
    change, the Jacobians, and the unknowns as a function of the arguments of the equations of the filter."""

    assembly: Assembly
    nodes: tuple[str, ...]
    places: tuple[Place, ...]
    signals: tuple[LocalSignal, ...]
    parameters: tuple[Known, ...]
    jacobians: Jacobians
    unknowns: ca.Function


class FaultOnset:
    """The dating of faults in the records of an estimator, by the equations of its diagram with a virtual source at every
    node. They are assembled when the first record is dated."""

    def __init__(self, estimator: Estimator):
        self.estimator = estimator

    @cached_property
    def _sourced(self) -> _Sourced | None:
        """The equations with virtual sources; None if they have other states than the filter. Raises ModelError if they
        cannot be assembled."""
        estimator, experiment = self.estimator, self.estimator.experiment
        model, outputs = experiment.model_for(estimator.record), list(experiment.outputs.values())
        wanted = {n.text for o in outputs for n in names_in(o.shown.expr)}
        wanted |= {name.removeprefix("initial.") for name in experiment.free if name.startswith("initial.")}
        flat, known = flatten(model, wanted), estimator.assembly
        nodes = input_nodes(flat)
        # the columns of the sources in the inputs are zero: no file is read
        assembly = build(reduce_flattened(lambda corners: with_virtual_sources(
            flatten(model, wanted, corners=corners), nodes, Path())))
        columns = (*assembly.reduced.states, *assembly.reduced.algebraic)
        if assembly.state_names != known.state_names or any(order >= len(known.flat.levels) for _, order in columns):
            return None
        signals = [LocalSignal(u.name, u.unit, u.role) for u in assembly.flat.unknowns if u.role in ("across", "position")]
        walking = [prior.name for prior in estimator.known]
        parameters = [*estimator.known, *(
            known_of(free, float(known.p[known.parameter_indices([name])[0]])) for name, free in experiment.free.items()
            if name not in walking and not name.startswith("initial."))]
        symbols = [known.express(known.flat.levels[order][known.flat.names[assembly.flat.unknowns[j].name]])
                   for j, order in columns]
        return _Sourced(
            assembly, tuple(nodes), tuple(places_of(flat, nodes)), tuple(signals), tuple(parameters),
            Jacobians(assembly, [assembly.expression(o.shown.expr) for o in outputs], signals, len(parameters), len(nodes)),
            ca.Function("unknowns", list(known.arguments), [ca.densify(stack(symbols))]))

    def dated(self, record: Record, change: Change) -> Change:
        """A change of a record with the median of its time and the interval that contains it with 95 % probability; the same
        change if the equations with sources have other states than the filter."""
        if self._sourced is None:
            return change
        time, probability = self.posterior(record, change.alarm)
        below = np.searchsorted(np.cumsum(probability), (0.025, 0.5, 0.975))
        low, median, high = time[np.minimum(below, len(time) - 1)].tolist()
        return replace(change, time=median, low=low, high=high)

    def posterior(self, record: Record, alarm: float) -> tuple[Array, Array]:
        """The times (N,) of the samples around an alarm, and the probability (N,) of each to be the first one with the
        fault."""
        window, faults, innovations = self._linearised(self.estimator.sampled(record), alarm)
        faults, span = _seen(window, faults), window.time[-1] - window.time[0]
        cases = [(f, size, ONSET.times[0] * span) for f, fault in enumerate(faults) if fault.name == fault.group
                 for size in ONSET.sizes[1::3]]
        ratios = [_other_noise(innovations)]
        if cases:
            best: dict[str, tuple[float, float]] = {}
            coarse = likelihood_ratios(window, faults, cases, max(1, len(window.time) // ONSET.coarse)).max(axis=0)
            for (f, size, _), ratio in zip(cases, coarse.tolist(), strict=True):
                best[faults[f].group] = max(best.get(faults[f].group, (-np.inf, 0.0)), (ratio, size))
            kept = dict(sorted(best.items(), key=lambda item: -item[1][0])[:ONSET.kept])
            cases = [(f, size, time * span) for f, fault in enumerate(faults) if fault.group in kept
                     for size in ONSET.sizes if 0.04 < size / kept[fault.group][1] < 25
                     for time in ((np.inf,) if fault.constant else (*ONSET.times, np.inf))]
            fine, of = likelihood_ratios(window, faults, cases, 1), np.array([f for f, _, _ in cases])
            ratios += [np.logaddexp.reduce(fine[:, of == f], axis=1) - np.log((of == f).sum()) for f in np.unique(of)]
        total = np.logaddexp.reduce(ratios, axis=0)
        probability = np.exp(total - total.max())
        return window.time, np.asarray(probability / probability.sum())

    def _linearised(self, samples: SampledRecord, alarm: float) -> tuple[FilteredWindow, list[Fault], Array]:
        """The filter along the window of a record, the faults with their columns, and the normalised innovations (N, m)."""
        estimator, sourced = self.estimator, self._sourced
        assert sourced is not None
        points, after, innovations = list[Point](), list[Point](), list[Array]()
        estimator.begin(float(samples.time[0]), samples.inputs.at(samples.time[:1])[:, 0])
        begin = max(0, int(np.searchsorted(samples.time, alarm)) - ONSET.before)
        excess, end = 0.0, len(samples.time)
        for i, time in enumerate(samples.time.tolist()):
            if i:
                estimator.predict(time, samples.inputs)
            points.append(estimator.point)
            innovations.append(estimator.correct(samples.values[i], samples.deviations[i], samples.inputs)[1])
            after.append(estimator.point)
            if time >= alarm:
                excess += float(np.nansum(innovations[-1] ** 2 - 1)) / 2
                if excess > ONSET.excess or i >= begin + ONSET.before + ONSET.after:
                    end = i + 1
                    break
        points, after, time = points[begin:end], after[begin:end], samples.time[begin:end]
        middles = (time[:-1] + time[1:]) / 2
        x_nominal, z_nominal = estimator.assembly.x_nominal, estimator.assembly.z_nominal
        walking, n = len(estimator.known), len(x_nominal)

        def states(part: Sequence[Point], name: str, nominal: Array) -> Array:
            return np.array([getattr(point, name) for point in part]).reshape(len(part), -1).T * nominal[:, None]

        ends = [(states(part, "x", x_nominal), states(part, "z", z_nominal)) for part in (points, after)]
        between = [(first[:, :-1] + second[:, 1:]) / 2 for first, second in zip(ends[1], ends[0], strict=True)]
        directions = np.zeros((len(estimator.p), len(sourced.parameters)))
        for k, prior in enumerate(sourced.parameters):
            index = sourced.assembly.parameter_indices([prior.name])[0]
            directions[index, k] = prior.slope(float(estimator.p[index]))
        a, b, *_ = sourced.jacobians.at(self._arguments(middles, between[0], between[1], samples), directions)
        _, _, y, c, d, local, _, _ = sourced.jacobians.at(self._arguments(time, *ends[0], samples), directions)
        phi, gamma = stepped(a, b, np.diff(time))
        used = np.isfinite(samples.values[begin:end])
        weight = used / samples.deviations[begin:end]
        c, d = c * weight[:, :, None], d * weight[:, :, None]
        whole = np.tile(np.eye(n + walking), (len(phi), 1, 1))
        whole[:, :n] = phi[:, :, :n + walking]
        s = [np.concatenate([states(part, name, np.ones(size)) for name, size in (("x", n), ("q", walking))]).T
             for part in (points, after)]
        window = FilteredWindow(time, np.array([p.covariance for p in points]),
                                (np.where(used, samples.values[begin:end], 0.0) - y) * weight, s[1] - s[0], whole,
                                c[:, :, :n + walking], estimator.noise)
        rest = np.zeros((len(phi), walking, 1))
        faults = []
        for place in sourced.places:
            enters = np.array([place.weights.get(node, 0.0) for node in sourced.nodes])
            columns = np.concatenate([(gamma @ enters)[:, :, None], rest], axis=1)[:, :, 0], d @ enters
            faults.append(Fault(place.name, place.name, *columns, False))
            for name, signature in self._signatures(place, local):
                faults.append(Fault(name, place.name, columns[0] * ((signature[1:] + signature[:-1]) / 2)[:, None],
                                    columns[1] * signature[:, None], True))
        for k in range(c.shape[1]):
            faults.append(Fault(f"channel {k}", f"channel {k}", np.zeros(whole.shape[:2]),
                                np.eye(c.shape[1])[k] * used, False))
        for k, prior in enumerate(sourced.parameters):
            faults.append(Fault(prior.name, prior.name, np.concatenate([phi[:, :, [n + k]], rest], axis=1)[:, :, 0],
                                c[:, :, n + k], True))
        return window, faults, np.array(innovations[begin:end])

    def _arguments(self, time: Array, x: Array, z: Array, samples: SampledRecord) -> tuple[Array, ...]:
        """The arguments of the equations with virtual sources at times (N,), from x and z (n, N) of the filter in SI."""
        estimator, sourced = self.estimator, self._sourced
        assert sourced is not None
        u, p, ones = samples.inputs.at(time), np.tile(estimator.p[:, None], (1, len(time))), np.ones((1, len(time)))
        unknowns = np.array(sourced.unknowns(time[None, :], x, z, p, u, ones))
        count, zeros = len(sourced.assembly.x_nominal), np.zeros((4 * len(sourced.nodes), len(time)))
        with_sources = np.vstack([u if len(u) else time[None, :], zeros])
        return time[None, :], unknowns[:count], unknowns[count:], p, with_sources, ones

    def _signatures(self, place: Place, local: Array) -> list[tuple[str, Array]]:
        """The laws of a place whose amplitude is one number: the names and values (N,) of their signatures."""
        assert self._sourced is not None
        index, node = {signal.name: k for k, signal in enumerate(self._sourced.signals)}, place.nodes[0]
        laws = []
        for variable in dict.fromkeys((node.across, *node.domain.positions)):
            names = [f"{n.name}.{variable}" for n in place.nodes]
            if not all(name in index for name in names):
                continue
            value = local[:, [index[name] for name in names]] @ np.array([place.weights[n.key] for n in place.nodes])
            size = float(np.sqrt(np.mean(value**2)))
            if size > 0:
                laws.append((f"{place.name}.{variable}", value / size))
                if variable == node.across:
                    laws.append((f"sign of {place.name}.{variable}", np.tanh(10 * value / size)))
        return laws


def _seen(window: FilteredWindow, faults: Sequence[Fault]) -> list[Fault]:
    """The faults that move the innovations, each scaled so that w = 1 moves the normalised innovations by 1 (rms)."""
    h, p = window.h, window.p
    variances = h @ p @ h.transpose(0, 2, 1) + np.eye(h.shape[1])
    gains = p @ h.transpose(0, 2, 1) @ np.linalg.inv(variances)
    whiten = np.linalg.inv(np.linalg.cholesky(variances))
    moved, total = np.zeros((p.shape[1], len(faults))), np.zeros(len(faults))
    gamma, d = (np.stack([getattr(fault, name) for fault in faults], axis=2) for name in ("gamma", "d"))
    for i in range(len(window.time)):
        errors = h[i] @ moved + d[i]
        total += ((whiten[i] @ errors) ** 2).sum(axis=0)
        if i < len(window.phi):
            moved = window.phi[i] @ (moved - gains[i] @ errors) + gamma[i]
    sizes = np.sqrt(total / len(window.time))
    return [replace(fault, gamma=fault.gamma / size, d=fault.d / size)
            for fault, size in zip(faults, sizes.tolist(), strict=True) if np.isfinite(1 / size if size else np.inf)]


def _other_noise(innovations: Array) -> Array:
    """The log likelihood ratio (N,) for normalised innovations (N, m) of another size from each sample on."""
    squares, counts = np.nansum(innovations**2, axis=1), np.isfinite(innovations).sum(axis=1)
    ratios = [np.cumsum((squares * (1 - scale**-2) / 2 - counts * np.log(scale))[::-1])[::-1] for scale in ONSET.scales]
    return np.asarray(np.logaddexp.reduce(ratios, axis=0) - np.log(len(ratios)))


def likelihood_ratios(window: FilteredWindow, faults: Sequence[Fault], cases: Sequence[tuple[int, float, float]], every: int
              ) -> Array:
    """The log likelihood ratio of all samples (N, cases) if the fault of a case (its number, sigma, tau) begins at a sample;
    at every so-many-th sample, -inf at the others.

    Backwards from the end, log p(e_i .. | s_i, w_i) = c + o'(s, w) - (s, w)'O(s, w)/2 of each case."""
    size, n = window.h.shape[2], len(window.time)
    sigma, tau = (np.array(part) for part in tuple(zip(*cases, strict=True))[1:])
    gamma, d = (np.stack([getattr(faults[f], name) for f, _, _ in cases], axis=1) * sigma[:, None]
                for name in ("gamma", "d"))
    variances = window.h @ window.p @ window.h.transpose(0, 2, 1) + np.eye(window.h.shape[1])
    null = (np.einsum("ij,ij->i", window.e, np.linalg.solve(variances, window.e[:, :, None])[:, :, 0])
            + np.linalg.slogdet(variances)[1]) / 2
    information = np.zeros((len(cases), size + 1, size + 1))
    linear, constant, result = np.zeros((len(cases), size + 1)), np.zeros(len(cases)), np.full((n, len(cases)), -np.inf)
    step, rows = np.zeros_like(information), np.zeros((len(cases), window.h.shape[1], size + 1))
    prior, noise, eye = np.zeros((size + 1, size + 1)), np.zeros((len(cases), size + 1)), np.eye(size + 1)
    prior[size, size], known = 1.0, np.zeros(size + 1)
    for i in range(n - 1, -1, -1):
        rows[:, :, :size], rows[:, :, size] = window.h[i], d[i]
        information = information + rows.transpose(0, 2, 1) @ rows
        linear, constant = linear + rows.transpose(0, 2, 1) @ window.e[i], constant + null[i] - window.e[i] @ window.e[i] / 2
        if i % every == 0:
            prior[:size, :size] = window.p[i]
            mixed = eye + information @ prior
            solved = np.linalg.solve(mixed, linear[:, :, None])[:, :, 0]
            result[i] = constant - np.linalg.slogdet(mixed)[1] / 2 + (linear * (solved @ prior)).sum(axis=1) / 2
        if not i:
            break
        h = window.time[i] - window.time[i - 1]
        decay = np.exp(-h / tau)
        noise[:, :size], noise[:, size] = window.noise * h, 1 - decay**2
        mixed = eye + information * noise[:, None, :]
        solved = np.linalg.solve(mixed, np.concatenate([information, linear[:, :, None]], axis=2))
        constant = constant - np.linalg.slogdet(mixed)[1] / 2 + (linear * noise * solved[:, :, -1]).sum(axis=1) / 2
        information, linear = solved[:, :, :-1], solved[:, :, -1]
        known[:size] = -window.phi[i - 1] @ window.k[i - 1]
        moved = information @ known
        constant = constant + (linear - moved / 2) @ known
        step[:, :size, :size], step[:, :size, size], step[:, size, size] = window.phi[i - 1], gamma[i - 1], decay
        linear = ((linear - moved)[:, None, :] @ step)[:, 0]
        information = step.transpose(0, 2, 1) @ information @ step
        information = (information + information.transpose(0, 2, 1)) / 2
    return np.where(np.isfinite(result), result, -np.inf)  # a case may be too ill-conditioned
