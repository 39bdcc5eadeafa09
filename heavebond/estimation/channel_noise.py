"""Estimated noise of channels without `noise:` in an experiment: one estimate for each channel, over all its records.

A sensor has the same noise in every record, so the records have equal weight; and a record in which a channel moves
little, or in another band, shows noise that others hide (see `records.noise`).
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

from heavebond.core.errors import HeavebondError
from heavebond.estimation.experiment import Experiment
from heavebond.estimation.input_noise import with_input_noise
from heavebond.estimation.records import Samples, measure
from heavebond.records.noise import estimate_noise


def with_noise(experiment: Experiment) -> Experiment:
    """The experiment with the estimated noise of its channels, and with the effect of the noise of its inputs on them."""
    return with_input_noise(with_channel_noise(experiment))


def with_channel_noise(experiment: Experiment) -> Experiment:
    """The experiment with an estimate for each channel without given noise; the same object if all are given or
    estimated. An unreadable record is omitted: the comparison reports it."""
    wanted = [name for name, output in experiment.outputs.items()
              if output.noise is None and name not in experiment.estimated_noise]
    if not wanted:
        return experiment
    samples: dict[str, list[Samples]] = {name: [] for name in wanted}
    for record in experiment.records.values():
        with suppress(HeavebondError):
            channels = measure(experiment, record).channels
            for name in wanted:
                samples[name].append(channels[name])
    estimates = {name: estimate_noise([(c.measured, c.time) for c in channels]) for name, channels in samples.items()}
    known = {name: estimate for name, estimate in estimates.items() if estimate.deviation > 0}
    return replace(experiment, estimated_noise={**experiment.estimated_noise, **known})
