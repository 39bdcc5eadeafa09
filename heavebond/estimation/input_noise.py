"""Effect of the noise of measured inputs on the channels of a model that is driven by them.

The machine had the true input u, the model has the measured one, u + w with white noise w (`noise:` at an input). To first
order the residual then contains G w in addition to the noise of the channel, with G the tangent of the channels to the
samples of the input. G w is sampled: the model is run with M realisations of w, and the differences from its run without
them are a sample of the distribution of G w. The sample gives the variance at each time and the correlation along time, also
for a nonlinear machine and for every interpolation. The variance is added to the channel's noise in all weights; the tests
of the residual take the correlation into account (see `diagnosis.evidence.residual_tests`).

This is errors-in-variables identification with known noise, approximated by the tangent at the measured input: T.
Soderstrom, Errors-in-variables methods in system identification, Automatica 43, 2007,
doi:10.1016/j.automatica.2006.11.025.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np

from heavebond.core.errors import HeavebondError, SimulationError, StartError, listing
from heavebond.core.progress import Progress
from heavebond.core.units import read_unit
from heavebond.estimation.experiment import Experiment, InputNoise, Record
from heavebond.estimation.records import Measured, measure
from heavebond.numerics.dae import Array, assemble
from heavebond.numerics.quick_simulation import QuickSimulator
from heavebond.numerics.result import Probe
from heavebond.numerics.simulation import run_by_auto
from heavebond.numerics.simulator import Simulator, Tolerances
from heavebond.text.expression import names

REALISATIONS = 40  # realisations: their standard deviation has an error of 11 %; it is also smoothed along time
NOTICEABLE = 0.05  # share of the variance of a channel
ENOUGH = 20  # least number of realisations that can be simulated
FINE = Tolerances(1e-6, 1e-8)


def with_input_noise(experiment: Experiment, progress: Progress | None = None) -> Experiment:
    """The experiment with the effect of the noise of its inputs on its channels, at the values of its diagram; the same
    object if no input has `noise`, or if the effect is known already. A record on which the model cannot be simulated
    is omitted."""
    if experiment.input_noise or not any(file_input.noise for record in experiment.records.values()
                                         for file_input in experiment.inputs_for(record).values()):
        return experiment
    noise_by_record = {}
    for record in experiment.records.values():
        if progress:
            progress(f"noise of the inputs on {record.name}")
        try:
            noise_by_record[record.name] = _propagated(experiment, record)
        except HeavebondError:  # the run without noise reports the error
            continue
    return replace(experiment, input_noise=noise_by_record)


def noise_notes(experiment: Experiment, measured: Measured) -> list[str]:
    """Share of the noise of the inputs in the variance of each channel of a record, if it is noticeable."""
    has_noise = any(g.noise for g in experiment.inputs_for(measured.record).values())
    if has_noise and measured.record.name not in experiment.input_noise:
        return ["the noise of the inputs is not taken into account: the model cannot be simulated with it"]
    shares = {name: 1 - float(np.mean((c.own_noise / c.deviation) ** 2)) for name, c in measured.channels.items()}
    texts = [f"{100 * share:.0f} % of the variance of {name}" for name, share in shares.items() if share > NOTICEABLE]
    return [f"the noise of the inputs is {listing(texts, 4)} that is expected of a correct model"] if texts else []


def _propagated(experiment: Experiment, record: Record) -> InputNoise:
    grid = measure(experiment, record).grid
    outputs = [o.shown for o in experiment.outputs.values()]
    scale = np.array([read_unit(o.unit).scale for o in outputs])
    wanted = {n.text for o in outputs for n in names(o.expr)}

    measured = assemble(experiment.model_for(record), wanted)
    probe = Probe(measured, [o.text for o in outputs], si=True)

    def channels(seed: int | None) -> Array:
        flat = measured.flat
        inputs = tuple(replace(known, source=replace(known.source, seed=seed if known.source.noise else None))
                       for known in flat.inputs)
        driven = replace(measured, reduced=replace(measured.reduced, flat=replace(flat, inputs=inputs)))
        try:
            result = QuickSimulator(driven, times=grid, tolerances=FINE).run()
        except SimulationError:
            result = run_by_auto(Simulator(driven, times=grid, tolerances=FINE))
        return np.asarray(probe.values(result) / scale[:, None])

    clean, errors = channels(None), []
    for seed in range(REALISATIONS):
        with suppress(SimulationError, StartError):
            errors.append(channels(seed) - clean)
    if len(errors) < ENOUGH:
        raise SimulationError([])
    return InputNoise(grid, np.array(errors))
