"""Describing functions of dry friction for linearisation: its slope at rest, over a motion, and while it slides.

Near rest a friction law F(v) is a damper far stiffer than any damper of the machine. Over a motion it acts like a damper of
smaller slope, its describing function. At large amplitudes the slope is the slope of the sliding law, zero except for
viscous parts. A share of the slope at rest is obtained by widening the transition of the law around rest (a `width` in the
unit of a speed), without another change; laws without such a width declare the values that make them slide (`sliding`).

The slope over a run is the coefficient of the damper with the same dissipation, <F v>/<v**2>. For a sinusoidal motion this
is the describing function at its amplitude, for other motions the best linear estimate of the force. A. Gelb, W. E. Vander
Velde, Multiple-input describing functions and nonlinear system design, McGraw-Hill 1968, sections 1.5 and 2.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from heavebond.core.units import read_unit
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.result import Result, columns
from heavebond.text.expression import parse_formula

WIDEST = 1e12  # so many times its width, a transition has no slope
SPEEDS = tuple(read_unit(text).dimension for text in ("m/s", "rad/s"))
# a width so many times the largest speed makes a law straight; speeds below this share of the largest are rounding
STRAIGHT, SLOW = 1e3, 1e-9


@dataclass(frozen=True)
class Frictions:
    """Dry frictions by the path of their part: the parameters whose widening makes it slide (`widths`, indices in p), the
    values to set instead (`set_to`: index, value), and the parts that have neither."""

    names: tuple[str, ...]
    widths: tuple[tuple[int, ...], ...]
    set_to: tuple[tuple[int, float], ...]
    fixed: tuple[str, ...]

    def sliding(self, p: Array, shares: Sequence[float]) -> Array:
        """The parameters (n_p,) at which each slope is this share of its slope at rest; a friction without a width slides
        for shares below 1."""
        p = p.copy()
        for at, share in zip(self.widths, shares, strict=True):
            p[list(at)] *= 1 / max(share, 1 / WIDEST)
        for k, value in self.set_to if any(share < 1 for share in shares) else ():
            p[k] = value
        return p


def dry_frictions(assembly: Assembly) -> Frictions:
    """The dry frictions of a diagram, by what their components declare: a `width` in the unit of a speed, or `sliding`."""
    flat = assembly.flat
    index = {q.name: k for k, q in enumerate(flat.parameters)} | {h.name: h.index for h in flat.held}
    names, widths, set_to, fixed = [], [], [], []
    for path, leaf in flat.expanded.leaves.items():
        own_widths = [f"{path}.{q.name}" for q in leaf.component.parameters.values()
                      if q.width and q.unit.dimension in SPEEDS]
        instead = {f"{path}.{name}": value for name, value in leaf.component.sliding.items()}
        if not own_widths and not instead:
            continue
        names.append(path)
        widths.append(tuple(index[name] for name in own_widths if name in index))
        set_to += [(index[name], value) for name, value in instead.items() if name in index]
        if any(name not in index for name in (*own_widths, *instead)):
            fixed.append(path)
    return Frictions(tuple(names), tuple(widths), tuple(set_to), tuple(fixed))


NO_FRICTION = Frictions((), (), (), ())


def slopes_over(assembly: Assembly, frictions: Frictions, run: Result) -> tuple[float, ...]:
    """The equivalent slope of each dry friction over a run, as a share of its slope at rest; 0 if it has no width.

    D is the part of its dissipation that widening removes. With a width k times as large, so that the law is straight over
    the whole motion, the slope at rest is k D_k/v**2 near rest.
    """
    losses = {e.owner: e.dissipated for e in assembly.flat.energetics}
    arguments = columns(run)
    shares = []
    for path, at in zip(frictions.names, frictions.widths, strict=True):
        # the sliding speed of a part: its variable in the unit of the width
        component = assembly.flat.expanded.leaves[path].component
        units = [q.unit.dimension for q in component.parameters.values() if q.width and q.unit.dimension in SPEEDS]
        variables = [name for name, v in component.variables.items() if v.held is None and v.unit.dimension in units]
        speed = assembly.expression(parse_formula(f"{path}.{variables[0]}")) if variables else None
        if not at or speed is None or path not in losses:
            shares.append(0.0)
            continue
        dissipation = ca.Function("told", list(assembly.arguments), [assembly.express(losses[path]), speed])
        shares.append(_share(dissipation, arguments, list(at), run.time))
    return tuple(shares)


def _share(dissipation: ca.Function, arguments: Sequence[Array], at: list[int], time: Array) -> float:
    t, x, z, p, u, rate = arguments

    def widened(times: float) -> tuple[Array, Array]:
        wide = p.copy()
        wide[at] *= times
        loss, v = (np.array(column.full()).ravel() for column in dissipation(t, x, z, wide, u, rate))
        return loss, v

    (one, v), (none, _) = widened(1.0), widened(WIDEST)
    size = float(np.abs(v).max(initial=0.0))
    if not size > 0:
        return 1.0
    least = int(np.argmin(np.where(np.abs(v) > SLOW * size, np.abs(v), np.inf)))
    k = max(STRAIGHT * size / float(p[at[0], 0]), 1.0)
    at_rest = k * float((widened(k)[0] - none)[least]) / float(v[least]) ** 2
    mean = float(np.trapezoid(one - none, time) / np.trapezoid(v**2, time))
    return float(np.clip(mean / at_rest, 0.0, 1.0)) if at_rest > 0 else 0.0
