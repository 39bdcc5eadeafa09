"""Segments of records on which a machine that integrates its inputs is compared.

A cart, a drive or a tank without outlet adds up every small force or flow that the model lacks. Over a long record the
simulated position leaves the measured one, and each law with a restoring force reduces this drift, whether the machine has
the law or not. The drift is therefore not evidence for a law. With the linear system along the run of the fitted base model,

    dx_(i+1) = phi_i dx_i,      dy_i = C_i dx_i,

a direction of dx(0) is carried if the error of the state does not decay and its influence on the channels does not swing
about zero. It is in the invariant subspace of phi, over the whole record, for the eigenvalues of at least `CARRIED`, and a
parabola over time has at least the share `TREND` of the energy of its influence in the last third of the record, unless the
influence grows (share `GROWING` of the energy there). A cart without friction carries its position and its speed, although
the influences of both may cancel each other at some time. An oscillator with little damping swings about zero. It adds up
nothing, and its decay shows only over many periods, so that segments would hide the law that is missing. The record is cut
into segments. The part of each residual along the carried directions at the beginning of each segment is removed, with the
same part of all derivatives. This equals multiple shooting with free initial values of these directions in each segment (H.
G. Bock, K. J. Plitt, 1984, doi:10.1016/S1474-6670(17)61205-9), eliminated to first order (variable projection: G. Golub, V.
Pereyra, 1973, doi:10.1137/0710036).

A segment is as long as the motion: `PERIODS` correlation times of the rate of the channels that carry the error. The
records are cut only if the carried errors are at least the share `DRIFT` of the misfit of the fitted base model.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import HeavebondError
from heavebond.core.presentation import number
from heavebond.estimation.excerpts import EXCERPTS
from heavebond.estimation.experiment import Experiment, Horizon, Record, without_carried
from heavebond.estimation.records import correlation_time, measure
from heavebond.localise.ltv_model import LtvModel, SourcedRecord, known_of
from heavebond.numerics.dae import Array

# TREND: a sine has less than half from half a period on. GROWING: a constant influence has 1/3, one that grows with the
# square of time 0.87.
# CARRIED: a constant has 1, an error that decays with 1.4 record lengths 0.5. PERIODS: a sine has a correlation time of a
# fifth of its period. SEGMENTS: of all fitted records; fewer show hardly less drift. SAMPLES: of each channel in a segment,
# for each carried direction. DRIFT: more than half of the misfit. SEEN: the influence of a direction over the largest.
# ABOVE_NOISE: variance of a change in noise variances; the noise of both readings is then a tenth of it.
CARRIED, PERIODS, SEGMENTS, SAMPLES, DRIFT, SEEN, ABOVE_NOISE = 0.5, 5.0, 3, 20, 0.5, 1e-6, 20.0
TREND, GROWING = 0.5, 0.95
LARGE = 1e100  # beyond it a response is cut off: its square is still a number


@dataclass(frozen=True)
class _Along:
    """The linear system of a record, the noise (m,) of its channels and their measured values (N, m) over it. `response`
    (N, m, n) of the channels to each state at the beginning, `carried` (n, d) the carried directions there."""

    record: Record
    model: LtvModel
    noise: Array
    measured: Array
    response: Array
    carried: Array


def with_horizons(experiment: Experiment, values: Mapping[str, float]) -> Experiment:
    """The experiment with segments for its records, if the errors that the machine carries along are most of the misfit at
    these values (SI) of the free parameters; otherwise the experiment itself, as for long records (the linear system takes
    much memory)."""
    if sum(len(measure(experiment, record).grid) for record in experiment.records.values()) > EXCERPTS.long:
        return experiment
    along: dict[str, _Along] = {}
    for record in sorted(experiment.records.values(), key=lambda r: r.use != "fit"):
        if record.use != "fit" and not all(a.carried.shape[1] for a in along.values()):
            return experiment  # a machine whose initial state decays
        try:
            along[record.name] = _along(experiment, record, values)
        except (HeavebondError, np.linalg.LinAlgError):  # the model cannot be linearised along this run
            return experiment
    fitted = [a for a in along.values() if a.record.use == "fit"]
    length = max(_length(a) for a in fitted)
    horizons = {name: horizon for name, a in along.items() if (horizon := _horizon(a, length)) is not None}
    if any(a.record.name not in horizons for a in fitted) or \
            not all(np.all(np.isfinite(h.responses)) for h in horizons.values()) or \
            sum(int(horizons[a.record.name].segment[-1]) + 1 for a in fitted) < SEGMENTS:
        return experiment
    total, remaining = np.sum([_energies(a, horizons[a.record.name]) for a in fitted], axis=0)
    return replace(experiment, horizons=horizons) if total - remaining >= DRIFT * total else experiment


def horizon_words(experiment: Experiment) -> list[str]:
    """Sentence on the segments on which the model was compared."""
    lengths = [(h.time[-1] - h.time[0]) / (h.segment[-1] + 1) for h in experiment.horizons.values()]
    return ["This machine integrates its inputs, and most of the misfit is an error that adds up along the records. The "
            f"models were therefore compared within segments of {number(min(lengths), 2)} s, each with a separate start. "
            "Chi-square refers to the segments, the errors in % to uninterrupted simulations."] if lengths else []


def _along(experiment: Experiment, record: Record, values: Mapping[str, float]) -> _Along:
    with tempfile.TemporaryDirectory() as folder:
        sourced = SourcedRecord(experiment, record, Path(folder), lambda flat: {})
        at = {name: value for name, value in values.items() if name in sourced.assembly.parameter_values}
        start = {**sourced.assembly.parameter_values, **at}
        model = sourced.about(at, [known_of(free, start[name]) for name, free in experiment.free.items()])
    n = model.phi.shape[1]
    response = np.clip(np.nan_to_num(_responses(model, np.eye(n), np.zeros(len(model.time), np.int64))), -LARGE, LARGE)
    return _Along(record, model, sourced.noise, sourced.measured / sourced.noise, response, _carried(model, response))


def _carried(model: LtvModel, response: Array) -> Array:
    """The carried directions (n, d) at the beginning of a record, from the `response` (N, m, n) of its channels to each
    state there."""
    n = response.shape[2]
    if not n:  # a machine without states
        return np.eye(0)
    place, channel = np.nonzero(model.used)
    flat = response[place, channel]
    size = np.sqrt(np.maximum((flat**2).sum(axis=0), 1 / LARGE))
    _, sizes, directions = np.linalg.svd(flat / size, full_matrices=False)
    seen = directions[sizes > SEEN * sizes[0]].T  # of the scaled states, the observable ones
    through = np.eye(n)
    for step in model.phi:
        through = np.clip(np.nan_to_num(step[:, :n] @ through), -LARGE, LARGE)
    lasting = seen @ _lasting(seen.T @ (size[:, None] * through / size) @ seen)
    if not lasting.shape[1]:
        return np.asarray(lasting)
    whole = flat / size @ lasting
    last = slice(2 * len(flat) // 3, None)
    courses, shares, within = np.linalg.svd(whole[last], full_matrices=False)
    visible = shares > SEEN * shares[0]
    slow = within[visible].T / shares[visible]  # of the unit influences `courses`
    growing = 1 / np.maximum(((whole @ slow)**2).sum(axis=0), 1.0) >= GROWING
    slow = slow @ _trends(courses[:, visible], model.time[place[last]], channel[last], growing)
    return np.asarray(lasting @ slow / size[:, None])


def _lasting(through: Array) -> Array:
    """Orthonormal basis (n, k) of the invariant subspace of a matrix (n, n) for its eigenvalues of at least `CARRIED`."""
    from scipy.linalg import schur

    _, basis, k = schur(through, output="real", sort=lambda real, imaginary: np.hypot(real, imaginary) >= CARRIED)
    return np.asarray(basis[:, :k])


def _trends(courses: Array, time: Array, channel: NDArray[np.int64], growing: NDArray[np.bool_]) -> Array:
    """Directions (k, d) of the orthonormal influences `courses` (j, k) on the last samples, of which a parabola in each
    channel has the share `TREND`, or the influences that are `growing`. `time` (j,) and `channel` (j,) are the times (s) and
    the channels of the samples."""
    x = time - time[-1]
    x = x / max(-float(x[0]), 1e-300)
    powers = np.stack([np.where(channel == c, x**n, 0.0) for c in np.unique(channel) for n in range(3)], axis=1)
    basis, sizes, _ = np.linalg.svd(powers, full_matrices=False)
    in_trend = basis[:, sizes > SEEN * sizes[0]].T @ courses
    _, shares, directions = np.linalg.svd(np.concatenate([in_trend, np.diag(growing.astype(float))]), full_matrices=False)
    return directions[shares**2 >= TREND].T


def _length(along: _Along) -> float:
    """The length (s) of the segments for the motion of a record."""
    model, d = along.model, along.carried.shape[1]
    if not d:
        return 0.0
    responses = along.response @ along.carried
    sizes = np.sqrt((responses**2).mean(axis=(0, 2)))
    times = []
    for k in np.flatnonzero(sizes > 0.01 * sizes.max()):  # channels that carry the error
        # The measured channel moves as the machine does; the simulated one has the drift as well. Its rate is taken over the
        # shortest interval in which the channel changes by more than its noise.
        time, course = model.time[model.used[:, k]], along.measured[model.used[:, k], k]
        over = next((n for n in 2 ** np.arange(12) if 2 * n >= len(course)
                     or float(np.var(course[n:] - course[:-n])) > ABOVE_NOISE), 1)
        rate = course[over:] - course[:-over] if 2 * over < len(course) else course
        times.append(float(correlation_time(time[:len(rate)], rate)))
    least = SAMPLES * float(np.median(np.diff(model.time)))
    return float(max(PERIODS * max(times), d * least))


def _horizon(along: _Along, length: float) -> Horizon | None:
    """The segments of a record, at least one; None if it carries no error."""
    model, d = along.model, along.carried.shape[1]
    if not d:
        return None
    span = float(model.time[-1] - model.time[0])
    count = max(1, int(span / length))
    segment = np.minimum(((model.time - model.time[0]) * count / span).astype(np.int64), count - 1)
    responses = _responses(model, along.carried, segment)
    return Horizon(model.time, segment, np.ascontiguousarray((responses * along.noise[:, None]).transpose(1, 0, 2)))


def _responses(model: LtvModel, directions: Array, segment: NDArray[np.int64]) -> Array:
    """The responses (N, m, d) of the channels to directions (n, d) of the initial state, which become orthonormal at the
    beginning of each segment. Those of an unstable machine may be infinite."""
    n = len(directions)
    responses = np.empty((*model.c.shape[:2], directions.shape[1]))
    with np.errstate(over="ignore", invalid="ignore"):
        for i in range(len(model.time)):
            if i and segment[i] != segment[i - 1]:
                directions = np.linalg.qr(directions)[0]
            responses[i] = model.c[i, :, :n] @ directions
            directions = model.phi[i, :, :n] @ directions if i < len(model.phi) else directions
    return responses


def _energies(along: _Along, horizon: Horizon) -> tuple[float, float]:
    """Sum of squares of the fitted residuals of a record, with and without the carried errors."""
    place, channel = np.nonzero(along.model.used)
    r = along.model.error[place, channel]
    parts = horizon.carried(channel, along.model.time[place], along.noise[channel])
    return float(r @ r), float(np.sum(without_carried(parts, r)**2))
