"""Candidates whose diagram is singular where they are absent, sought from a finite amplitude on.

At R = 0 a pressure loss R between two volumes makes their pressures one, and no equation gives the flow between them: there
is no tangent at zero. Such amplitudes are sought over decades around the natural size of their place. With X the span of the
across variable of the node there and Y the largest through variable of the port in the base model, the dimension of an
amplitude says which X**a * Y**b that is: X/Y of R, X/Y**2 of a turbulent loss.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from heavebond.core.units import Dimension, Range, times
from heavebond.diagnosis.base_model import Base, values_at
from heavebond.diagnosis.catalogue import Candidate
from heavebond.equations.places import nodes_of
from heavebond.language.definition import SearchRange
from heavebond.numerics.result import Probe

# Of the natural size: below the first the two ends are one for all that is measured, above the last next to nothing passes.
LOWEST, HIGHEST = 1e-5, 10.0
POWERS = ((1, -1), (-1, 1), (1, -2))  # of X and Y: a resistance, a conductance, a resistance to the square


def from_finite_amplitudes(base: Base, candidate: Candidate) -> Candidate | None:
    """The candidate with all its amplitudes sought around the natural size of its place; None where it does not stand in
    series with a port, nothing moves there, or an amplitude is of another kind."""
    if candidate.attaches != "in series":
        return None
    sizes = _sizes(base, candidate)
    ranges = {n.name: (LOWEST * size, HIGHEST * size) for n in candidate.vanishing
              if (size := sizes.get(n.unit.dimension)) is not None}
    return ranged(candidate, ranges) if len(ranges) == len(candidate.vanishing) else None


def ranged(candidate: Candidate, ranges: Mapping[str, tuple[float, float]]) -> Candidate:
    """The candidate with amplitudes that are sought in these ranges (SI) instead of from zero on."""
    return replace(candidate, numbers=tuple(
        replace(n, sought=SearchRange(Range(*ranges[n.name], n.unit), "")) if n.name in ranges else n
        for n in candidate.numbers))


def _sizes(base: Base, candidate: Candidate) -> dict[Dimension, float]:
    """The natural sizes at the place of a candidate by their dimensions; none where nothing moves."""
    run = base.problem.runs[0]
    node = nodes_of(run.assembly.flat).get(candidate.where[0])
    port = next((end.lstrip("-") for ends in candidate.change.nodes.values() for end in ends if end.startswith("-")), "")
    if node is None or port not in node.ports:
        return {}
    names = [f"{node.name}.{node.across}", f"{port}.{node.through}"]
    members = node.domain.members[node.across].unit.dimension, node.domain.members[node.through].unit.dimension
    courses = [Probe(r.assembly, names, si=True).values(r.simulator.run(values_at(base, r, {}))) for r in base.problem.runs]
    across, through = np.hstack(courses)
    x, y = float(np.ptp(across)), float(np.abs(through).max())
    if not (x > 0 and y > 0):
        return {}
    return {times(times((), members[0], a), members[1], b): x**a * y**b for a, b in POWERS}
