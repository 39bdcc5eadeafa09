"""Search ranges of the numbers of an effect, from the motion of the base model at its place.

A component file gives the search range of a stiffness, a gap or a time constant for machines of usual size. The stiffness of
a belt in a desktop robot is ten thousand times smaller than that of a drive shaft, and the time constant of a furnace is a
million times that of a valve. The sizes that can matter on the records are the *natural range* of a number. Let X be the
span of the across variable (speed, pressure, temperature) of the nodes at the place, S the span of their position, Y the
largest through variable (force, flow, heat flow) of the ports there, h the median sample interval, and D the duration of the
longest record. The natural range of a number with the dimension of

    Y/S, S/Y, Y/X, X/Y   (stiffness, compliance, damping, resistance)   is 0.01 to 100 times this ratio,
    Y*t/X, X*t/Y         (inertia, capacity, inertance; t a time)       from h to D times the ratio,
    X, S                 (a speed of transition, a gap)                 0.01 times this span,
    t                    (a delay, a lag)                               from h/2 to D/10.

The search range of an amplitude is extended such that it contains the natural range. The range of a shape is extended in the
same way if it has no value in common with the natural range. A gap or a transition of the size of the whole motion is not
sought: it imitates other laws. Scores are computed at time constants from h/2 to D, if the range has such values: a law with
a shorter one is the same as one without memory, and with a longer one as a drift. A refit may leave this part of the range.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from heavebond.core.units import Dimension, Range, times, unit
from heavebond.diagnosis.candidates.catalogue import Candidate, EffectNumber
from heavebond.diagnosis.search.base_model import Base
from heavebond.equations.places import Node, nodes_of
from heavebond.language.definition import SearchRange
from heavebond.localise.regressors import integral

SMALL, LARGE = 0.01, 100.0  # factors of the ratios and spans, see the module
TIME = unit("s").dimension


@dataclass(frozen=True)
class Sizes:
    """Spans of the across variable X and of the position S of a node, and the largest through variable Y of its ports, with
    their dimensions (see the module)."""

    across: float
    position: float
    through: float
    of_across: Dimension
    of_position: Dimension | None
    of_through: Dimension


def with_natural_ranges(base: Base, candidates: Sequence[Candidate]) -> list[Candidate]:
    """The candidates with search ranges that contain the natural sizes of their places."""
    runs = [base.exact[run.record.name] for run in base.problem.runs]
    steps = np.concatenate([np.diff(run.found.grid) for run in runs])
    interval, duration = float(np.median(steps)), max(float(np.ptp(run.found.grid)) for run in runs)
    sizes = _sizes(base)
    extended = []
    for candidate in candidates:
        at_place = [size for name in (*candidate.where, *candidate.change.nodes) for size in sizes.get(name, ())]
        numbers = tuple(n if n.sought is None else _distinct(replace(n, sought=_extended(n, natural_range(
            n.unit.dimension, at_place, interval, duration))), interval, duration) for n in candidate.numbers)
        extended.append(candidate if numbers == candidate.numbers else replace(candidate, numbers=numbers))
    return extended


def natural_range(dimension: Dimension, at_place: Sequence[Sizes], interval: float, duration: float
                  ) -> tuple[float, float] | None:
    """The natural range (SI) of a number of this dimension, see the module, with the sample interval and the duration of the
    records (s). None for other dimensions, for a number without dimension, and if nothing moves at the place."""
    ranges = [(interval / 2, duration / 10)] if dimension == TIME else []
    for s in at_place if dimension else ():
        spans = [(size, of_size) for size, of_size in ((s.position, s.of_position), (s.across, s.of_across))
                 if of_size is not None and size > 0]
        ratios = [pair for size, of_size in spans if s.through > 0
                  for pair in ((s.through / size, times(s.of_through, of_size, -1)),
                               (size / s.through, times(of_size, s.of_through, -1)))]
        ranges += [(SMALL * size, SMALL * size) for size, of_size in spans if dimension == of_size]
        at_once = [(SMALL * ratio, LARGE * ratio) for ratio, of_ratio in ratios if dimension == of_ratio]
        ranges += at_once or [(interval * ratio, duration * ratio) for ratio, of_ratio in ratios[-2:]
                              if dimension == times(of_ratio, TIME)]
    return (min(low for low, _ in ranges), max(high for _, high in ranges)) if ranges else None


def _distinct(number: EffectNumber, interval: float, duration: float) -> EffectNumber:
    """A time constant that is scored within the times that the records distinguish; other numbers as they are."""
    sought = number.sought
    if sought is None or sought.range is None or number.amplitude or number.unit.dimension != TIME or sought.range.low <= 0:
        return number
    low, high = max(sought.range.low, interval / 2), min(sought.range.high, duration)
    return replace(number, sought=replace(sought, scored=Range(low, high, sought.range.unit))) if low < high else number


def _extended(number: EffectNumber, natural: tuple[float, float] | None) -> SearchRange:
    """The search range of a number, extended to its natural range within its physical limits."""
    sought = number.sought
    assert sought is not None
    given = sought.range
    # a range that contains zero states which part of all values is meant
    if natural is None or given is None or given.low <= 0 or not (
            number.amplitude or natural[1] < given.low or natural[0] > given.high):
        return sought
    low, high = min(given.low, natural[0]), max(given.high, natural[1])
    low = low if number.limits[0] is None else max(low, number.limits[0])
    high = high if number.limits[1] is None else min(high, number.limits[1])
    return sought if (low, high) == (given.low, given.high) else replace(sought, range=Range(low, high, given.unit))


def _sizes(base: Base) -> dict[str, list[Sizes]]:
    """The natural sizes at each node, and at the nodes of each part, of the base model on the fitted records."""
    sizes: dict[str, list[Sizes]] = {}
    for node in nodes_of(base.results[0].assembly.flat).values():
        size = _of_node(node, [result.si for result in base.results], [result.time for result in base.results])
        for name in (node.name, *dict.fromkeys(port.rpartition(".")[0] for port in node.ports)):
            sizes.setdefault(name, []).append(size)
    return sizes


def _of_node(node: Node, courses: Sequence[Mapping[str, np.ndarray]], times_of: Sequence[np.ndarray]) -> Sizes:
    members, domain = node.domain.members, node.domain
    across = [course[f"{node.name}.{node.across}"] for course in courses]
    through = [course[f"{port}.{node.through}"] for course in courses for port in node.ports
               if f"{port}.{node.through}" in course]
    # integrated from speeds: a diagram has positions only if an equation uses them
    positions = [integral(v, t) for v, t in zip(across, times_of, strict=True)] if domain.position is not None else []
    return Sizes(max((float(np.ptp(v)) for v in across), default=0.0),
                 max((float(np.ptp(x)) for x in positions), default=0.0),
                 max((float(np.abs(y).max()) for y in through), default=0.0), members[node.across].unit.dimension,
                 members[domain.position].unit.dimension if domain.position is not None else None,
                 members[node.through].unit.dimension)
