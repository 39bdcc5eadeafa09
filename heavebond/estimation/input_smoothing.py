"""Noise and steps of measured inputs that a model differentiates, and the proposed smoothing.

A measured position that drives a source is differentiated. The derivative of white noise of deviation s, sampled at
intervals h, has a deviation of about sqrt(2) s/h: a millimetre at 100 Hz is 0.14 m/s. The integrator follows it in small
steps, and the response is similar to that of effects which the machine does not have.

The bandwidth is twice the bandwidth with the least estimated error of the smoothed signal (Mallows' C_L): with the gain H of
the smoothing spline at each frequency, residual r (n,) and noise s,

    error = mean(r**2) - s**2 + 2 s**2 mean(H).

C. L. Mallows, Technometrics 15, 1973, 661-675, doi:10.1080/00401706.1973.10489103.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from heavebond.core.errors import DataError
from heavebond.core.presentation import number
from heavebond.estimation.experiment import Experiment, Record
from heavebond.language.definition import FileInput
from heavebond.language.symbols import split
from heavebond.numerics.dae import Assembly
from heavebond.numerics.inputs import input_samples
from heavebond.records.noise import estimate_noise
from heavebond.records.outliers import step_of
from heavebond.records.piecewise import evaluate, smoothed_pieces


@dataclass(frozen=True)
class SmoothingConstants:
    """Constants of the proposal.

    visible: deviation of the noise of the derivative in shares of the derivative's rms, from which smoothing is proposed.
    Origin: an error of a tenth in a velocity is an error of a tenth in a damper force. Doubled: noisier inputs are accepted
    without advice.
    per_octave: bandwidths tried in an octave. Origin: the error is flat near its least value. Doubled: a finer bandwidth.
    octaves: octaves below half the sampling frequency that are tried. Origin: periods of 1/1000 of it exceed the length of
    most records. Doubled: slower signals.
    wider: factor on the bandwidth of least error. Origin: at the least error the signal loses about as much as the
    remaining noise. `noise:` accounts for the noise, but not for a loss, which acts like a gain of the input. At twice
    the bandwidth the loss is a sixteenth. Doubled: less loss, more noise of the derivative.
    """

    visible: float = 0.1
    per_octave: int = 2
    octaves: int = 10
    wider: float = 2.0


SMOOTHING = SmoothingConstants()


@dataclass(frozen=True)
class Smoothing:
    """Proposed smoothing of an input: the bandwidth in Hz, the noise and the resolution of its readings in its unit (a
    step of 0: not visible), and the noise of its derivative in shares of the derivative."""

    bandwidth: float
    noise: float
    step: float
    share: float

    def entry(self, unit: str) -> str:
        """The entry for the input."""
        return f"smooth: {self.bandwidth:g} Hz, noise: {number(self.noise, 2)} {unit}"


def differentiated_inputs(assembly: Assembly, experiment: Experiment) -> list[str]:
    """The measured inputs whose derivatives are in the equations of a model or in the formula of a channel.

    A prescribed speed of a mass leaves no differential equation for it; its derivative is in the measured force only.
    """
    resolver = assembly.resolver()
    channels = [assembly.reduced.express(resolver.evaluate(output.shown.expr)) for output in experiment.outputs.values()]
    used = {s.element_hash() for e in (assembly.reduced.ode, assembly.reduced.alg, *channels) for s in ca.symvar(e)}
    return [known.name for known in assembly.flat.inputs
            if any(s.element_hash() in used for s in split(known.symbols)[1:])]


def proposed_smoothing(file_input: FileInput) -> Smoothing | None:
    """The smoothing of an input that a model differentiates; None if it has one, or if no noise is visible."""
    if file_input.smooth is not None or file_input.interpolation == "hold":
        return None
    try:
        time, values = input_samples(replace(file_input, bridge=True))
    except DataError:
        return None  # reported when the input is read
    step = step_of(values)
    estimate = estimate_noise([(values, time)]).deviation
    noise = max(file_input.noise or (estimate if math.isfinite(estimate) else 0.0), step / math.sqrt(12))
    interval = float(np.median(np.diff(time)))
    differences = float(np.sqrt(np.mean(np.diff(values) ** 2)))  # of the signal and of its noise
    if len(time) < 2 ** 6 or not math.sqrt(2) * noise > SMOOTHING.visible / 2 * differences:
        return None
    highest = 0.5 / interval
    trials = [highest * 2.0 ** (-k / SMOOTHING.per_octave) for k in range(1, SMOOTHING.octaves * SMOOTHING.per_octave)]
    # the estimated mean square error of the signal that is smoothed with a bandwidth
    errors = []
    for bandwidth in trials:
        residual = values[:-1] - evaluate(smoothed_pieces(time, values, "spline", bandwidth), time[:-1])
        frequencies = np.linspace(0, highest, 200)
        gain = float(np.mean(1 / (1 + (frequencies / bandwidth) ** 4)))
        errors.append(float(np.mean(residual**2)) - noise**2 + 2 * noise**2 * gain)
    best = min(SMOOTHING.wider * trials[int(np.argmin(errors))], highest / 2)
    smooth = smoothed_pieces(time, values, "spline", best)
    rate = float(np.sqrt(np.mean(evaluate(smooth, time[:-1], 1) ** 2)))
    share = math.sqrt(2) * noise / interval / rate if rate > 0 else math.inf
    return Smoothing(float(f"{best:.2g}"), noise, step, share) if share > SMOOTHING.visible else None


def smoothing_notes(experiment: Experiment, record: Record, assembly: Assembly) -> list[str]:
    """The advice for each input of a record that the model differentiates and that has visible noise or steps."""
    inputs = experiment.inputs_for(record)
    proposals = {name: proposal for name in differentiated_inputs(assembly, experiment)
                 if name in inputs and (proposal := proposed_smoothing(inputs[name])) is not None}
    return [f"the model differentiates the input {name}, whose {_cause(p, inputs[name].unit)}: the noise of its derivative "
            f"is {number(100 * p.share, 2)} % of the derivative. Write `{p.entry(inputs[name].unit)}` at this input"
            for name, p in proposals.items()]


def _cause(proposal: Smoothing, unit: str) -> str:
    if proposal.step:
        return f"readings go in steps of {number(proposal.step, 2)} {unit} and have noise of " \
            f"{number(proposal.noise, 2)} {unit}"
    return f"readings have noise of {number(proposal.noise, 2)} {unit}"


def with_smoothed_inputs(experiment: Experiment, assembly: Assembly) -> tuple[Experiment, tuple[str, ...]]:
    """The experiment with the proposed smoothing of each input that the model differentiates, the same on all records,
    and a sentence for each; the same object and no sentences without proposals."""
    proposals: dict[str, Smoothing] = {}
    names = differentiated_inputs(assembly, experiment)
    for record in experiment.records.values():
        for name, file_input in experiment.inputs_for(record).items():
            if name in names and (proposal := proposed_smoothing(file_input)) is not None:
                before = proposals.get(name)
                wider = before is None or proposal.bandwidth > before.bandwidth
                proposals[name] = proposal if wider else before or proposal
    if not proposals:
        return experiment, ()

    def smoothed(inputs: dict[str, FileInput]) -> dict[str, FileInput]:
        return {name: replace(file_input, smooth=file_input.smooth or proposals[name].bandwidth,
                              noise=file_input.noise or proposals[name].noise) if name in proposals else file_input
                for name, file_input in inputs.items()}

    records = {name: replace(record, inputs=smoothed(record.inputs)) for name, record in experiment.records.items()}
    units = {name: file_input.unit for record in experiment.records.values()
             for name, file_input in experiment.inputs_for(record).items()}
    sentences = tuple(f"The model differentiates the measured input {name}, whose {_cause(p, units[name])}. For this "
                 "diagnosis "
                      f"it is smoothed, and its noise is taken into account: write `{p.entry(units[name])}` at this input."
                      for name, p in proposals.items())
    return replace(experiment, inputs=smoothed(experiment.inputs), records=records), sentences
