"""Whether a run stays where its laws mean something: no pressure below vacuum, no variable beyond what is declared for it.

What moves beyond is told, not refused: a diagram in the making may go there, and a short while may not matter.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass

import numpy as np

from heavebond.basis.errors import listing
from heavebond.basis.presentation import readable
from heavebond.equations.explain import domain_at
from heavebond.equations.flatten import Flat
from heavebond.equations.resolver import Unknown
from heavebond.numbers.dae import Array, Assembly
from heavebond.numbers.result import Result
from heavebond.numbers.start_equations import Point

# of the limit (or so little of its usual size) by which a variable may pass one: errors of the integration
GRACE = 1e-3
MOST_NAMED = 3


@dataclass(frozen=True)
class Beyond:
    """A variable that passes a limit first at a time in s, and goes as far as `worst`; both in SI, in `unit`."""

    name: str
    unit: str
    limit: float
    worst: float
    time: float
    advice: str

    def as_dict(self) -> dict[str, object]:
        """For machines."""
        return asdict(self)


def beyond(result: Result) -> list[Beyond]:
    """What leaves the range in which its laws hold, at the points of a run; nodes before components, in their order."""
    return _beyond(result.assembly.flat, result.time, lambda names: result.signals(names))


def beyond_at(assembly: Assembly, point: Point) -> list[Beyond]:
    """The same at one point, as at a start."""
    values = np.array(assembly.values(*point.values())).ravel()
    return _beyond(assembly.flat, np.array([point.t]),
                   lambda names: {name: values[[assembly.flat.names[name]]] for name in names})


def _beyond(flat: Flat, time: Array, signals: Callable[[Iterable[str]], Mapping[str, Array]]) -> list[Beyond]:
    limits = [(u, *limit) for u in flat.unknowns for limit in _limits(flat, u)]
    values = signals(dict.fromkeys(u.name for u, *_ in limits))
    found = []
    for unknown, limit, side, advice in limits:
        over = side * (values[unknown.name] - limit) - GRACE * max(abs(limit), unknown.nominal * GRACE)
        if (over > 0).any():
            found.append(Beyond(unknown.name, unknown.unit.text, limit, float(values[unknown.name][int(np.nanargmax(over))]),
                                float(time[int(np.argmax(over > 0))]), advice))
    return found


def _limits(flat: Flat, unknown: Unknown) -> list[tuple[float, int, str]]:
    """Each limit, the side on which it is passed (1 above, -1 below), and what to say then."""
    if unknown.role == "across":
        node, _, name = unknown.name.rpartition(".")
        domain = domain_at(flat, node)
        member = domain.members.get(name) if domain is not None else None
        return [(member.physical, -1, member.beyond)] if member is not None and member.physical is not None else []
    if unknown.role != "own":
        return []
    owner, _, name = unknown.name.rpartition(".")
    advice = f"beyond what {owner} allows for its {name}. Look at its start, and at what drives it"
    return [(limit, side, advice) for limit, side in ((unknown.low, -1), (unknown.high, 1)) if np.isfinite(limit)]


def told(found: list[Beyond]) -> list[str]:
    """A sentence for each sort of limit, on those that pass it first."""
    lines = []
    for advice in dict.fromkeys(b.advice for b in found):
        same = [b for b in found if b.advice == advice]
        first = min(same, key=lambda b: b.time)
        others = [b.name for b in same if b is not first]
        also = f" ({listing(others, MOST_NAMED)} too)" if others else ""
        lines.append(f"warning: {first.name}{also} goes to {readable(first.worst, first.unit)}, beyond "
                     f"{readable(first.limit, first.unit)} from {first.time:.4g} s on: {first.advice}.")
    return lines
