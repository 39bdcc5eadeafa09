"""Relative influence of parameters on signals from forward sensitivities.

The influence of a parameter p on a signal s is p ds/dp: the change of the signal, at each instant, for twice the parameter
along its tangent; a hundredth of it is the change for one per cent. Its root mean square relative to the rms of the signal
about its mean,

    rms(p ds/dp) / rms(s - mean(s)),

ranks parameters of any unit. Parameters that are zero have no influence in this sense.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from heavebond.core import facade
from heavebond.core.errors import Problem, UsageError, listing, suggest
from heavebond.core.presentation import brief, count, number
from heavebond.core.progress import Progress
from heavebond.core.reporting import reporting
from heavebond.core.units import Unit
from heavebond.language.model import ModelOrFile
from heavebond.numerics.dae import Array, Assembly, assemble
from heavebond.numerics.output_times import Time
from heavebond.numerics.result import Probe, Result
from heavebond.numerics.simulation import with_filled_nodes
from heavebond.numerics.simulator import Simulator

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

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
class Rankings(facade.Displayed):
    """Every signal's ranking, at the same times (N,); `left_out` names parameters that were not among the `tried`, `filled`
    lists capacities that were added to nodes without storage, if any. `rankings["crown.x"]` is the ranking of one signal."""

    time: Array
    rankings: tuple[Ranking, ...]
    left_out: tuple[str, ...]
    filled: str = ""
    model: str = ""
    tried: int = 0

    def __getitem__(self, signal: str) -> Ranking:
        """The influences on a signal; UsageError for one that was not examined."""
        for ranking in self.rankings:
            if ranking.signal == signal:
                return ranking
        signals = [ranking.signal for ranking in self.rankings]
        raise UsageError([Problem("name-unknown", f"'{signal}' was not examined", None,
                                  suggest(signal, signals) or f"Examined: {listing(signals)}.")])

    def as_dict(self) -> dict[str, object]:
        """The influences as a dictionary for JSON."""
        def one(influence: Influence) -> dict[str, object]:
            return {"parameter": influence.parameter, "value": influence.value, "unit": influence.unit.text,
                    "influence": influence.relative, "peak": influence.peak, "time": influence.time}

        return {"model": self.model, "until": float(self.time[-1]),
                "signals": {r.signal: {"unit": r.unit, "rms": r.size, "still": r.still,
                                       "influences": [one(i) for i in r.influences]} for r in self.rankings},
                "left_out": list(self.left_out), "filled": self.filled or None}

    def to_pandas(self) -> pd.DataFrame:
        """The relative influences as a table: a row for each parameter, a column for each signal."""
        import pandas as pd

        return pd.DataFrame({r.signal: {i.parameter: i.relative for i in r.influences} for r in self.rankings})

    def __repr__(self) -> str:
        strongest = [f"{r.signal}: " + ", ".join(f"{i.parameter} {number(i.relative, 3)}" for i in r.influences[:4])
                     for r in self.rankings[:8]]
        return brief(self, self.model, f"{count(self.tried, 'parameter')}", *strongest)

    def plot(self) -> Figure:
        """A matplotlib figure of the influences as bars, and the strongest over time."""
        figure: Figure = facade.call("Rankings.plot", self)
        return figure


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
    (courses, signal, run), filled = with_filled_nodes(
        lambda machine: _courses(machine, signals, chosen, until, every, progress or (lambda text: None)), assembly,
        lambda ranking_run: ranking_run[2], chosen)
    values = np.array([assembly.parameter_values[name] for name in chosen])
    scaled = np.concatenate(courses) * values[:, None, None]
    units = {q.name: q.unit for q in assembly.flat.parameters}
    rankings = []
    for j, name in enumerate(signals):
        size = _rms(signal[j] - signal[j].mean())
        still = size <= STILL * max(_rms(signal[j]), 1e-300)
        size = _rms(signal[j]) if still else size
        influences = []
        for k, parameter in enumerate(chosen):
            course = scaled[k, j]
            peak = int(np.argmax(np.abs(course)))
            influences.append(Influence(parameter, float(values[k]), units[parameter],
                                        _rms(course) / size if size > 0 else float("nan"), float(course[peak]),
                                        float(run.time[peak]), course))
        rankings.append(Ranking(name, run.unit(name), size, still, tuple(sorted(influences, key=lambda i: -_rms(i.course)))))
    return Rankings(run.time, tuple(rankings), () if parameters else tuple(possible[most:]), filled, assembly.model.name,
                    len(chosen))


@reporting
def sensitivity(model: ModelOrFile | Assembly, of: Sequence[str], *, until: Time | None = None, every: Time | None = None,
                parameters: Sequence[str] = (), most: int = MOST, progress: Progress | None = None) -> Rankings:
    """Rank parameters of a diagram by their influence on signals, with exact sensitivities.

    The influence of a parameter is the first-order change of a signal if the parameter were doubled: its rms over time
    divided by the rms of the signal about its mean (dimensionless). `model` is a diagram, the path or bundled name of one,
    or an Assembly; `of` are names or formulas of signals. `until` and `every` are as in `simulate`. `parameters` are those
    to examine, by default the first `most` that are not zero. `progress` is called with a text at each step. Raises
    UsageError for an unknown name, or a parameter that is zero or is solved for at the start.
    """
    signals = [of] if isinstance(of, str) else list(of)
    if isinstance(parameters, Mapping):
        raise UsageError([Problem("parameter-values", "`parameters` are names here; values were given", None,
                                  "Give the values to the diagram, `model.with_parameters({...})`.")])
    assembly = assemble(model, signals)
    return rank(assembly, signals, parameters, until, every=every, most=most, progress=progress)


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


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
