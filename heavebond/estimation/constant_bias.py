"""Biases of channels that are equal on all records: offsets of sensors or of inputs.

The bias of a record is the mean of its residuals. Residuals are hardly ever white, so the standard error for n
independent samples does not apply: it is computed from the means of ten batches of successive samples (R. W. Conway,
Management Science 10 (1963) 47-61, doi 10.1287/mnsc.10.1.47), which are nearly independent if the residuals are
correlated over less than a tenth of the record.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from heavebond.core.errors import listing
from heavebond.core.presentation import difference_unit, number, path_text, readable_unit
from heavebond.core.units import read_unit
from heavebond.estimation.experiment import Experiment, Output
from heavebond.numerics.dae import Array


@dataclass(frozen=True)
class BiasCheckConstants:
    """The constants of the check for a constant bias of a channel.

    batches: batches of successive samples (batch means). Origin: usual for correlated residuals. Doubled: a smaller standard
    error if residuals are correlated over long times.
    min_batch: samples in a batch. Origin: below, records are too short. Doubled: no advice on short records.
    significant: standard errors from which a bias is significant. Origin: 1 % (two-sided) of Student's t with 9 degrees of
    freedom. Doubled: only gross biases.
    interval: half width of the 95 % interval, in standard errors. Origin: Student's t. Doubled: an interval that is too
    wide.
    similar: share of the common bias by which the bias of a record may differ. Origin: sensors drift between records.
    Doubled: less equal biases are treated as one.
    otherwise_good: reduced chi-square without the bias up to which little else is wrong. Origin: the error is dominated by
    the bias. Doubled: advice on worse models.
    noticeable: share of the noise of its channel below which a bias is not reported. Origin: it changes chi-square by
    less than a tenth. Doubled: larger biases are not reported.
    """

    batches: int = 10
    min_batch: int = 5
    significant: float = 3.25
    interval: float = 2.262
    similar: float = 0.3
    otherwise_good: float = 3.0
    noticeable: float = 0.3


BIAS_CHECK = BiasCheckConstants()


@dataclass(frozen=True)
class Bias:
    """The mean residual of a channel in one record, and its standard error, in the channel's unit."""

    value: float
    deviation: float

    @property
    def significant(self) -> bool:
        """True if it differs significantly from zero."""
        return abs(self.value) > BIAS_CHECK.significant * self.deviation


def mean_residual(residuals: Array) -> Bias | None:
    """The mean of residuals (n,) in the order of their times, with a standard error that allows for their correlation; None
    for fewer than 50 samples."""
    if len(residuals) < BIAS_CHECK.batches * BIAS_CHECK.min_batch:
        return None
    means = [float(np.mean(part)) for part in np.array_split(residuals, BIAS_CHECK.batches)]
    return Bias(float(np.mean(residuals)), float(np.std(means, ddof=1)) / math.sqrt(BIAS_CHECK.batches))


def common_bias(biases: Sequence[Bias | None], noise: float) -> Bias | None:
    """The bias that all records share, weighted by precision; None with a single record, if one of them is not
    significant, or if they differ in sign or size."""
    significant = [bias for bias in biases if bias is not None and bias.significant]
    if len(significant) < len(biases) or len(significant) < 2:
        return None
    weights = np.array([1 / max(bias.deviation, 1e-3 * abs(bias.value))**2 for bias in significant])
    mean = float(weights @ [bias.value for bias in significant] / weights.sum())
    alike = all(bias.value * mean > 0 and abs(bias.value - mean) <= max(BIAS_CHECK.similar * abs(mean), 2 * bias.deviation)
                for bias in significant)
    return Bias(mean, float(1 / np.sqrt(weights.sum()))) if alike and abs(mean) > BIAS_CHECK.noticeable * noise else None


def advice(experiment: Experiment, name: str, bias: Bias, chi2: float) -> str:
    """A line on a channel whose bias is equal on all records, with the entry to write and the command to try. `chi2` is
    the reduced chi-square without the bias: if it is far from the noise, missing physics may have caused the bias too."""
    output = experiment.outputs[name]
    value, unit = _written(output, bias.value)
    half = _written(output, BIAS_CHECK.interval * bias.deviation, beside=bias.value)[0]
    size = f"{number(value, 3)} +- {number(half, 2)}{unit} (95 %)"
    sign = "+" if value > 0 else "-"
    attempt = f"heavebond try {path_text(experiment.path)} SensorOffset --at"
    inputs = dict.fromkeys([*experiment.inputs, *(n for r in experiment.records.values() for n in r.inputs)])
    input_text = f" or of an input (--at {listing(inputs, 3)})" if inputs else ""
    cause = f"which suggests an offset of the sensor{input_text}" if chi2 < BIAS_CHECK.otherwise_good else \
        f"from an offset of the sensor{input_text}, or from a missing effect, as without it chi-square is still " \
        f"{number(chi2, 3)}"
    return f"{name}: bias equal on all records, {size}, {cause}: " \
        f"`{attempt} {name}` estimates it; `is: {output.shown.text} {sign} {number(abs(value), 3)}{unit}` at this output " \
        "corrects the sensor"


def _written(output: Output, value: float, beside: float | None = None) -> tuple[float, str]:
    """A difference of a channel as a number and its unit: for degC in K."""
    scale, unit = difference_unit(output.shown.unit)
    value *= scale
    display_unit = readable_unit(unit, value if beside is None else scale * beside)
    if display_unit != unit:
        value *= read_unit(unit).scale / read_unit(display_unit).scale
    return value, "" if display_unit == "1" else f" {display_unit}"


def all_advice(experiment: Experiment, residuals: Mapping[str, Sequence[Array]], noise: Mapping[str, float]) -> list[str]:
    """The lines for all channels; `residuals` (n,) of each by record, measured minus model, in its unit."""
    biases = {name: common_bias([mean_residual(part) for part in parts], noise[name]) for name, parts in residuals.items()}
    remaining_chi2 = {name: max((float(np.var(part)) / noise[name]**2 for part in parts if len(part)), default=0.0)
                      for name, parts in residuals.items() if biases[name] is not None}
    lines = [advice(experiment, name, bias, remaining_chi2[name]) for name, bias in biases.items() if bias is not None]
    if len(lines) > 1:
        lines.append(f"{len(lines)} channels are biased at once: one wrong value of the diagram (a load, a supply, an "
                     "ambient temperature) or a missing effect is a likelier cause than an offset of each sensor")
    return lines
