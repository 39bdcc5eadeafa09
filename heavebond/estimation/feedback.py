"""Test for feedback in a record: whether a measured input depends on the readings of the machine's sensors.

In closed loop the input depends on past outputs, and with them on their noise and on all missing physics. A simulation with
the measured input then counts these twice: input and residual are correlated, and estimates are biased (U. Forssell, L.
Ljung, Closed-loop identification revisited, Automatica 35, 1999, doi:10.1016/S0005-1098(99)00022-9).

With the innovations v of the input u (unpredictable from its past) and w of a residual e (unpredictable from the past of e
and u),

    z_k = sum v(t) w(t-k) / sqrt(sum (v(t) w(t-k))**2),       k = 1, 2, ...

is standard normal without feedback, for any missing physics: w(t-k) is then independent of u (a cross-correlation at
negative lags with prewhitening: L. D. Haugh, 1976, doi:10.1080/01621459.1976.10480353; robust to a few large steps). A
controller that computes u(t) from the reading at t shows at k = 0, with w unpredictable from the past alone. So does an
error of the model's direct transmission from u(t); it is feedback if w follows v by more than the complete transmission of
the model. The part of the residual that is proportional to the model is removed before: a sensor of other sign, unit or gain
is not feedback.

Noise n of a measured input that does not act on the machine causes such a correlation too, without feedback: the model
responds to it, e = -H n, and the past of e then contains more information on the true input than the past of the noisy
one. So the correlation is computed again for noise of the size that the input has, with the response H of the model (its
cross-spectrum with the input): if this noise alone explains half of the correlation or more, feedback is not reported.

A correlation at k = 0 also arises if the readings of a row answer to the input of the same row, and the model applies this
input afterwards (`interpolation: hold`). If the model one sample earlier has a smaller residual, and the innovations of this
residual have no correlation at k = 0, feedback is not reported.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import dataclass, replace

import numpy as np

from heavebond.core.presentation import count
from heavebond.estimation.experiment import Experiment, Record
from heavebond.numerics.dae import Array
from heavebond.numerics.inputs import input_samples

ORDER = 20  # number of past samples that predict a signal
LAGS = 10
LEVEL = 1e-4  # probability of a false alarm, over all lags
LEAST = 0.05**0.5  # correlation: less than 5 % of the variance of an input's innovations biases little
SAMPLES = 20_000  # samples from the beginning, at most
SHORTEST = 10 * ORDER
SMOOTHED = 7  # samples of the cubics that separate the noise of an input from its signal
ALONE = 0.5  # share of a correlation above which noise of the input explains it
SEGMENT = 1024  # samples of the segments of averaged spectra


@dataclass(frozen=True)
class Feedback:
    """The largest correlation of innovations of an input with innovations of a residual `lag` samples before."""

    correlation: float
    lag: int

    @property
    def words(self) -> str:
        """`correlation -0.47 with its residual 1 sample before`."""
        when = f"{count(self.lag, 'sample')} before" if self.lag else "at the same sample"
        return f"correlation {self.correlation:.2f} with its residual {when}"


def closed_loops(experiment: Experiment, record: Record, channels: Mapping[str, tuple[Array, Array, Array]],
                 prescribing: Container[str] = ()) -> tuple[str, ...]:
    """A note for each input of a record that depends on a channel; for channels, times, readings and model (n,) each.
    Inputs `prescribing` a shared variable, such as the position of a shaker, may depend on the reaction of the
    machine."""
    notes = []
    for name, file_input in experiment.inputs_for(record).items():
        time, values = input_samples(replace(file_input, bridge=True))
        feedback_by_channel = {channel: fed for channel, (t, y, model) in channels.items()
                               if (fed := feedback(np.interp(t, time, values), y - model, model)) is not None}
        if feedback_by_channel:
            channel, fed = max(feedback_by_channel.items(), key=lambda pair: abs(pair[1].correlation))
            cause = "the machine acts back on its drive, or a controller moves it. A simulation with the measured input " \
                "is correct, but estimates are biased by the noise and by missing physics: use all sensors, and if there " \
                "is a controller, add it to the diagram" if name in prescribing else \
                "it was recorded in closed loop, and a simulation with the measured input is biased by the noise and by " \
                "missing physics; add the controller to the diagram and drive it by the reference"
            notes.append(f"the input {name} follows from the measured {channel} ({fed.words}, both prewhitened): {cause}")
    return tuple(notes)


def feedback(u: Array, e: Array, model: Array) -> Feedback | None:
    """The feedback from a residual e (n,) of a channel to an input u (n,) at the same times; None if it is not
    significant, or if noise of the input alone or a shift by a sample explains it. `model` (n,) is the simulated channel."""
    from scipy.special import erfcinv

    u, e, model = u[:SAMPLES], e[:SAMPLES], model[:SAMPLES]
    if len(u) < SHORTEST or not np.ptp(u) or not np.ptp(e):
        return None
    least = float(np.sqrt(2) * erfcinv(LEVEL / (LAGS + 1)))
    correlations = _correlations(u, e, model)
    strongest = max((Feedback(r, lag) for lag, (r, z) in correlations.items() if abs(z) > least and abs(r) > LEAST),
                    key=lambda fed: abs(fed.correlation), default=None)
    if strongest is None:
        return None
    alone, _ = _correlations(*_with_input_noise(u, e, model)).get(strongest.lag, (0.0, 0.0))
    if alone / strongest.correlation >= ALONE:
        return None
    if strongest.lag == 0:
        earlier = e[:-1] + model[:-1] - model[1:]
        r, z = _correlations(u[:-1], earlier, model[1:]).get(0, (0.0, 0.0))
        if np.var(_without(earlier, model[1:])) < np.var(_without(e, model)) and not (abs(z) > least and abs(r) > LEAST):
            return None
    return strongest


def _correlations(u: Array, e: Array, model: Array) -> dict[int, tuple[float, float]]:
    """The correlation of innovations at each lag, and z."""
    past_inputs, e = _past(u), _without(e, model)
    past = _past(e)
    v = _innovations(u[ORDER:], past_inputs)
    innovations_now = _innovations(e[ORDER:], np.hstack([past, past_inputs]))
    w = _innovations(e[ORDER:], np.hstack([past, past_inputs, u[ORDER:, None]]))
    direct = _innovations(model[ORDER:], np.hstack([_past(model), past_inputs]))
    correlations_by_lag = {}
    for lag in range(0 if abs(innovations_now @ v) > abs(direct @ v) else 1, LAGS + 1):
        after, before = v[lag:], w[:len(w) - lag] if lag else innovations_now
        product = after * before
        size = float(np.sqrt(np.sum(after**2) * np.sum(before**2)))
        spread = float(np.sqrt(np.sum(product**2)))
        if size > 0 and spread > 0:
            correlations_by_lag[lag] = float(product.sum()) / size, float(product.sum()) / spread
    return correlations_by_lag


def _with_input_noise(u: Array, e: Array, model: Array) -> tuple[Array, Array, Array]:
    """Input, residual and model of a machine that is driven by the smooth part of the input, and a model that is driven
    by this with noise of the size that the input has; with additional white noise, so that the innovations of the
    residual have their size."""
    from scipy.signal import csd, savgol_filter, welch

    rng = np.random.default_rng(0)
    smooth = savgol_filter(u, SMOOTHED, 3)
    passed_share = 1 - float(savgol_filter(np.eye(SMOOTHED)[SMOOTHED // 2], SMOOTHED,
                                           3)[SMOOTHED // 2])  # share of white noise
    noise = float(np.std(u - smooth)) / np.sqrt(passed_share) * rng.standard_normal(len(u))
    segment = min(SEGMENT, len(u))
    f, power = welch(u, nperseg=segment)
    response = csd(u, model, nperseg=segment)[1] / np.maximum(power, 1e-12 * float(power.max()))
    fine_frequencies = np.fft.rfftfreq(2 * len(u))
    passed = np.fft.irfft(np.interp(fine_frequencies, f, response) * np.fft.rfft(noise, 2 * len(u)))[:len(u)]
    innovations = [float(np.var(_innovations(x[ORDER:], _past(x)))) for x in (_without(e, model), passed)]
    added_noise = np.sqrt(max(0.0, innovations[0] - innovations[1])) * rng.standard_normal(len(u))
    return smooth + noise, added_noise - passed, model + passed


def _without(e: Array, model: Array) -> Array:
    """Remove the part of a residual e (n,) that is proportional to the model (n,)."""
    course = model - model.mean()
    power = float(course @ course)
    return e - float(e @ course) / power * course if power > 0 else e


def _past(x: Array) -> Array:
    """The past samples (n - ORDER, ORDER) of each sample of a series (n,) from ORDER on."""
    return np.lib.stride_tricks.sliding_window_view(x, ORDER)[:-1]


def _innovations(x: Array, past: Array) -> Array:
    """Residual of a linear prediction of x (n,) from the columns of `past` (n, m)."""
    columns = np.hstack([past - past.mean(axis=0), np.ones((len(past), 1))])
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    coefficients = np.linalg.lstsq(columns / scale, x, rcond=1e-10)[0]
    return np.asarray(x - (columns / scale) @ coefficients)
