"""Initial states that differ from the diagram, estimated for each record as an explanation next to missing effects.

A wrong initial state causes a transient that no effect explains, and that effects may imitate. If the first sample of a
measured state differs from the model, the initial value of this state in each record is estimated together with all free
parameters. Effects are then searched with these initial values. An exception is made if an offset or a gain of the sensor
explains the first samples of all records, because a sensor error is itself a candidate effect. A record that was cut from a
longer motion also has an initial velocity; it is estimated together with the position if the data justify it.
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from heavebond.core.errors import listing
from heavebond.core.presentation import number, readable
from heavebond.core.progress import Progress
from heavebond.core.units import Range
from heavebond.core.units import unit as read_unit
from heavebond.diagnosis.search.step import EARNED
from heavebond.diagnosis.state import LadderEntry
from heavebond.estimation.comparison import ELSEWHERE, Channel, Comparison
from heavebond.estimation.experiment import Experiment, Free
from heavebond.estimation.fitting import Fit, fit

INITIAL = "initial."


def _with_own_starts(experiment: Experiment, comparison: Comparison) -> Experiment | None:
    """The experiment with a free initial value, one for each record, for every state whose first sample differs from the
    model, unless a sensor error explains the difference (see `_as_a_sensor`).

    The search range covers the model's initial value and the first samples of all records, with a margin of `ELSEWHERE`
    standard deviations of the noise. None if no state differs, or if the diagram starts from an equilibrium.
    """
    if experiment.model.initial.mode is not None:
        return None
    names = dict.fromkeys(name for record in comparison.records.values() for name in record.elsewhere)
    free, values = dict(experiment.free), {}
    place = next(iter(experiment.records.values())).place
    for name in names:
        state, unit = experiment.outputs[name].shown.text, read_unit(experiment.outputs[name].shown.unit)
        known = next(iter(comparison.records.values())).result.assembly.flat.names
        if state not in known or f"{INITIAL}{state}" in free:
            continue  # an output that is a formula of states has no initial value
        channels = [record.channels[name] for record in comparison.records.values()]
        if _as_a_sensor(channels):
            continue
        before = float(unit.to_si(channels[0].model[0]))
        around = ELSEWHERE * max(max(c.noise, c.step) for c in channels) * unit.scale
        begins = [before, *(float(unit.to_si(c.measured[0])) for c in channels)]
        free[f"{INITIAL}{state}"] = Free(f"{INITIAL}{state}", Range(min(begins) - around, max(begins) + around, unit), place,
                                         each=True)
        values[f"{INITIAL}{state}"] = before
    if not values:
        return None
    return replace(experiment, model=experiment.model.with_parameters(values), free=free)


def _with_velocities(with_positions: Experiment, before: Experiment, comparison: Comparison) -> Experiment | None:
    """The experiment with free initial velocities in addition to the free initial positions, for velocities that are
    states and are not measured. The search range extends to the largest rate of change between two samples. None if there is
    no such velocity."""
    assembly = next(iter(comparison.records.values())).result.assembly
    measured_states = {output.shown.text for output in with_positions.outputs.values()}
    free, values = dict(with_positions.free), {}
    for name in with_positions.free:
        if name in before.free:
            continue
        path, _, position = name.removeprefix(INITIAL).rpartition(".")
        domain = assembly.flat.domains.get(path)
        if domain is None or position not in domain.positions:
            continue
        state = f"{path}.{domain.rate(position)}"
        if state in assembly.state_names and state not in measured_states and f"{INITIAL}{state}" not in free:
            output = next(n for n, o in with_positions.outputs.items() if o.shown.text == f"{path}.{position}")
            scale = read_unit(with_positions.outputs[output].shown.unit).scale
            channels = [record.channels[output] for record in comparison.records.values()]
            begins = [float(record.result[state][0]) for record in comparison.records.values()]
            most = max(float(np.max(np.abs(np.diff(c.measured) / np.diff(c.time)))) for c in channels) * scale
            unit = read_unit(assembly.flat.unknowns[assembly.flat.names[state]].unit.text)
            free[f"{INITIAL}{state}"] = Free(f"{INITIAL}{state}", Range(min(-most, *begins), max(most, *begins), unit),
                                             with_positions.free[name].place, each=True)
            values[f"{INITIAL}{state}"] = begins[0]
    return replace(with_positions, model=with_positions.model.with_parameters(values), free=free) if values else None


def own_starts(experiment: Experiment, before: LadderEntry, seconds: float, say: Progress) -> Fit | None:
    """Fit initial values for each record together with all free parameters, in at most `seconds`. `before` is the model
    without them. Velocities are added in a second fit.

    None if no first sample differs from the model, or if the sum of squares of the fitted records falls by no more than
    chance allows. The significance is judged in units of the noise, not of the residual: the difference of the first samples
    is a measured fact, and a large residual of a missing effect could hide it.
    """
    extended = _with_own_starts(experiment, before.comparison)
    best, chi2, free = None, before.chi2_fit, experiment.free
    ends = clock.monotonic() + seconds
    while extended is not None and (seconds_left := ends - clock.monotonic()) > 0:
        trial = fit(extended, progress=lambda text: say(f"fitting the start of each record: {text}"), partial=True,
                    seconds=seconds_left)
        added = sum(p.name not in free for p in trial.parameters)
        if (chi2 - trial.chi2) * trial.samples <= EARNED * added:
            break
        extended = _with_velocities(extended, experiment, before.comparison) if best is None else None
        best, chi2, free = trial, trial.chi2, trial.experiment.free
    return best


def _as_a_sensor(channels: Sequence[Channel]) -> bool:
    """True if one offset or one gain of the sensor explains the first samples of all records. This is always so with one
    record. In this case the first samples cannot distinguish a sensor error from a different initial state."""
    shifts = [float(c.measured[0] - c.model[0]) for c in channels]
    noise = ELSEWHERE * max(max(c.noise, c.step) for c in channels)
    largest, starts = max(((abs(float(c.model[0])), k) for k, c in enumerate(channels)), default=(0.0, 0))
    gain = shifts[starts] / float(channels[starts].model[0]) if largest else 0.0
    deviations = [shift - gain * float(c.model[0]) for shift, c in zip(shifts, channels, strict=True)]
    return max(shifts) - min(shifts) <= noise or (largest > 0 and max(map(abs, deviations)) <= noise)


def own_start_words(before: Experiment, base: Fit | None, fitted: Fit | None) -> list[str]:
    """Messages that state the fitted initial values of each record and what to write in the experiment. `base` is the fit
    without effects, `fitted` the last fit."""
    if base is None or fitted is None:
        return []
    diagrams = {p.name: p.before for p in base.parameters}
    lines, reported = [], set[str]()
    for name, free in fitted.experiment.free.items():
        if name in before.free or not name.startswith(INITIAL):
            continue
        state, unit = name.removeprefix(INITIAL), free.range.unit
        output = next((n for n, o in fitted.experiment.outputs.items() if o.shown.text == state), None)
        if output is None:  # the velocity of a position
            if state.rpartition(".")[0] not in reported:
                continue
            begins = {p.record: float(unit.from_si(p.value)) for p in fitted.parameters if p.name == name}
            begins |= {record: float(unit.from_si(estimate.values[name])) for record, estimate in fitted.held_out.items()
                       if name in estimate.values}
        else:
            channels = {record.name: record.channels[output] for record in fitted.after.records.values()}
            diagram = float(unit.from_si(diagrams[name]))
            if all(abs(float(c.model[0]) - diagram) <= ELSEWHERE * max(c.noise, c.step) for c in channels.values()):
                continue  # with the selected effects, the records begin at the diagram's value
            begins = {record: float(c.model[0]) for record, c in channels.items()}
            reported.add(state.rpartition(".")[0])
        start_texts = listing(f"{readable(value, unit.text, 3)} in {record}" for record, value in begins.items())
        lines.append(f"The records do not begin where the diagram does: {state} begins at {start_texts}. The answer holds "
                     f"for these start values. To keep them, write `{name}: {free_text(free)}` under `free:`"
                     + (f", and `initial: {{{state}: 0 {unit.text}}}` in the diagram"
                        if state not in before.model.initial.conditions else "") + ".")
    return lines


def free_text(free: Free) -> str:
    """A free initial value for each record as text for the section `free:`. The range is rounded outwards to two digits
    of its larger end."""
    unit = free.range.unit
    low, high = (float(unit.from_si(end)) for end in (free.range.low, free.range.high))
    step = 10.0 ** (math.floor(math.log10(max(abs(low), abs(high)))) - 1)
    low, high = math.floor(low / step) * step, math.ceil(high / step) * step
    return f"{{range: {number(low)} .. {number(high)} {unit.text}, each: record}}"
