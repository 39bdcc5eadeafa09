"""Relative influence of parameters on signals from forward sensitivities.

The influence of a parameter p on a signal s is p ds/dp: the change of the signal, at each instant, for twice the parameter
along its tangent; a hundredth of it is the change for one per cent. Its root mean square relative to the rms of the signal
about its mean,

    rms(p ds/dp) / rms(s - mean(s)),

ranks parameters of any unit. Parameters that are zero have no influence in this sense.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from heavebond.core.errors import Problem, UsageError, listing
from heavebond.core.progress import Progress
from heavebond.core.units import Unit
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.output_times import Time
from heavebond.numerics.result import Probe, Result
from heavebond.numerics.simulation import with_filled_nodes
from heavebond.numerics.simulator import Simulator

MOST = 60  # default number of parameters
AT_ONCE = 6  # sensitivities in a run: above it the cost of the Jacobian exceeds the saving of runs
STILL = 1e-9  # share of its size below which the motion of a signal counts as none


@dataclass(frozen=True)
class Influence:
    """One parameter on one signal: its rms relative to the signal's, the signed largest value in the signal's unit (for a
    relative change of 1), its time (s), and p ds/dp over time (N,)."""

    parameter: str
    value: float
    unit: Unit
    relative: float
    peak: float
    time: float
    course: Array


@dataclass(frozen=True)
class Ranking:
    """The influences on one signal, the largest first; `size` is the rms of the signal about its mean, or of the signal
    itself if it is constant."""

    signal: str
    unit: str
    size: float
    still: bool
    influences: tuple[Influence, ...]


@dataclass(frozen=True)
class Rankings:
    """Every signal's ranking, at the same times (N,); `left_out` names parameters that were not tried, `filled` lists
    capacities that were added to nodes without storage, if any."""

    time: Array
    rankings: tuple[Ranking, ...]
    left_out: tuple[str, ...]
    filled: str = ""


def candidates(assembly: Assembly) -> list[str]:
    """The independent parameters that may have an influence: neither zero nor solved for at the start."""
    solved = assembly.model.initial.solve
    return [name for name, value in assembly.parameter_values.items() if value != 0 and name not in solved]


def rank(assembly: Assembly, signals: Sequence[str], parameters: Sequence[str] = (), until: Time | None = None, *,
         every: Time | None = None, most: int = MOST, progress: Progress | None = None) -> Rankings:
    """Rank parameters (by default all that are not zero, `most` of them) by their influence on signals; nodes without
    storage are filled if a run needs it (see `heavebond.numerics.simulation`). UsageError for an unknown name, a
    parameter that is zero or is solved for at the start.
    """
    possible = candidates(assembly)
    chosen = list(dict.fromkeys(parameters)) or possible[:most]
    _check(assembly, chosen, possible)
    (courses, signal, run), filled = with_filled_nodes(
        lambda machine: _courses(machine, signals, chosen, until, every, progress or (lambda text: None)), assembly,
        lambda found: found[2], chosen)
    values = np.array([assembly.parameter_values[name] for name in chosen])
    scaled = np.concatenate(courses) * values[:, None, None]
    units = {q.name: q.unit for q in assembly.flat.parameters}
    return Rankings(run.time, tuple(
        _ranking(name, run.unit(name), run.time, signal[j], [
            (parameter, float(values[k]), units[parameter], scaled[k, j]) for k, parameter in enumerate(chosen)])
        for j, name in enumerate(signals)), () if parameters else tuple(possible[most:]), filled)


def _courses(assembly: Assembly, signals: Sequence[str], chosen: Sequence[str], until: Time | None, every: Time | None,
             say: Progress) -> tuple[list[Array], Array, Result]:
    """The sensitivities of signals to groups of parameters, the signals themselves, and the last of the runs."""
    probe = Probe(assembly, signals)
    courses, computed = [], 0
    for group in in_chunks(chosen):
        say(f"parameters {computed + 1} to {computed + len(group)} of {len(chosen)}")
        computed += len(group)
        run = Simulator(assembly, until, every=every, sensitivities=group).run()
        courses.append(probe.sensitivities(run))
    return courses, probe.values(run), run


def in_chunks(names: Sequence[str], size: int = AT_ONCE) -> list[Sequence[str]]:
    """The names in groups of about equal length, each for one run with sensitivities."""
    groups = max(1, -(-len(names) // size))
    return [names[k * len(names) // groups:(k + 1) * len(names) // groups] for k in range(groups)]


def _check(assembly: Assembly, chosen: Sequence[str], possible: Sequence[str]) -> None:
    assembly.parameter_indices(chosen)  # UsageError for a name that cannot be set
    solved = [name for name in chosen if name in assembly.model.initial.solve]
    zero = [name for name in chosen if name not in possible and name not in solved]
    if solved:
        raise UsageError([Problem("parameter-solved", f"{listing(solved)} cannot be varied: parameters under `solve:` "
                                  "follow from the start", None, "Take it out of `solve:` and give it a value.")])
    if zero:
        raise UsageError([Problem("parameter-zero", f"{listing(zero)} has no relative influence: its value is zero", None,
                                  f"Give it a value, for example --set {zero[0]}='...'.")])
    if not chosen:
        raise UsageError([Problem("parameters-missing", f"{assembly.model.name} has no parameter that is not zero")])


def _ranking(signal: str, unit: str, time: Array, values: Array, moved: list[tuple[str, float, Unit, Array]]) -> Ranking:
    size = _rms(values - values.mean())
    still = size <= STILL * max(_rms(values), 1e-300)
    size = _rms(values) if still else size
    influences = []
    for parameter, value, influence_rms, course in moved:
        at = int(np.argmax(np.abs(course)))
        relative = _rms(course) / size if size > 0 else float("nan")
        influences.append(Influence(parameter, value, influence_rms, relative, float(course[at]), float(time[at]), course))
    return Ranking(signal, unit, size, still, tuple(sorted(influences, key=lambda i: -_rms(i.course))))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
