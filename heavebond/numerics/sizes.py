"""Comparison of the magnitudes reached in a run with the nominal sizes of its error control.

The absolute tolerance of an unknown is `atol` times its nominal size, usually the size of its unit. A run that stays far
below (picometres, nanovolts) has no relative accuracy: its errors are of the size of the motion. The largest values of a run
are therefore compared with the nominal sizes. If an unknown stays far below, the run is repeated with the size that it
reached.

An unknown that is zero except for rounding, such as the middle of a symmetric machine, has no size. Rounding of the
right-hand side f(t, x, z, p) is estimated as eps sum |df/dv| |v| over all arguments v. With x' = f it changes a state by
that times the length of the run, or times the time constant of the state if that is shorter, and passes on to the states
that contain it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from heavebond.language.symbols import stack
from heavebond.numerics.dae import Array, Assembly

EPS = float(np.finfo(float).eps)


@dataclass(frozen=True)
class SizeConstants:
    """The constants of the comparison of a run with the nominal sizes of its unknowns.

    small: largest value of an unknown, in its nominal size, below which the run is repeated. Origin: at the default
        tolerances the absolute one then allows a hundred times the relative one, an error of about 1e-5 of the largest
        value over a run. Doubled: runs with errors of half that are repeated too.
    algebraic: factor on `small` for algebraic unknowns. Origin: they are solved by Newton's method, which errs by far less
        than its tolerance, and are in no error test. Doubled: more runs are repeated.
    rounding: multiple of the estimated rounding below which a value is no motion. Origin: the estimate leaves out what
        passes through several states. Doubled: smaller motions beside large cancelling forces are not followed.
    noise: share of the largest unknown, in nominal sizes, below which a value is no motion. Origin: starts are solved to
        about 1e-12, and this error decays. Doubled: smaller motions with large ones are not followed.
    zero: share of its nominal size below which a value is zero in any case. Origin: rounding in the products of a symmetric
        machine that starts exactly; no motion is as small. Doubled: nothing measurable.
    max_repeats: repetitions of a run. Origin: the sizes of the first repetition may follow from errors. Doubled:
        nothing measurable.
    points: points of a run at which rounding is estimated. Origin: extremes of most motions. Doubled: nothing measurable.
    least_stops: stops of a run from which on they show how large its unknowns become. Origin: an oscillation of a few
        cycles. Doubled: more runs are made once more with these stops where an unknown seems small.
    """

    small: float = 1e-4
    algebraic: float = 1e-2
    rounding: float = 30.0
    noise: float = 1e-12
    zero: float = 1e-19
    max_repeats: int = 3
    points: int = 16
    least_stops: int = 100


SIZES = SizeConstants()


def far_below(reached: Mapping[str, float], nominal: Mapping[str, float], declared: Mapping[str, float],
              exact: bool = False) -> list[str]:
    """The unknowns whose largest values stay far below their present nominal sizes, and that are not zero but for the
    errors of the largest unknown in its `declared` nominal size; a start that is `exact` has none."""
    largest = 0.0 if exact else max((value / declared[name] for name, value in reached.items() if np.isfinite(value)),
                                    default=0.0)
    return [name for name, value in reached.items()
            if max(SIZES.noise * largest, SIZES.zero) * declared[name] < value < SIZES.small * nominal[name]]


def fitting_sizes(assembly: Assembly, names: Sequence[str], reached: Mapping[str, float], columns: Sequence[Array],
                  steps: int, atol: float) -> dict[str, float]:
    """Sizes of some unknowns that fit a run, powers of ten; unknowns that are zero except for rounding are omitted, and no
    size is so small that rounding exceeds the absolute tolerance. `columns` are the arguments (., N) along the run."""
    span = float(np.ptp(columns[0]))
    every = [*assembly.state_names, *assembly.algebraic_names]
    whole, in_step = (dict(zip(every, _rounding(assembly, columns, time), strict=True))
                      for time in (span, span / max(steps, 1)))
    nominal = dict(zip(every, [*assembly.x_nominal, *assembly.z_nominal], strict=True))
    sizes = {}
    for name in names:
        size = 10.0 ** np.ceil(np.log10(max(reached[name], in_step.get(name, 0.0) / atol)))
        if reached[name] > SIZES.rounding * whole.get(name, 0.0) and size < nominal.get(name, np.inf):
            sizes[name] = float(size)
    return sizes


def _rounding(assembly: Assembly, columns: Sequence[Array], time: float) -> Array:
    """The largest accumulated rounding of x and z (n_x + n_z,) in a time (s), from some points of a run: of each unknown's
    own equation, and for states of the other states in it (a position from its speed)."""
    n_x, n_z = len(assembly.x_nominal), len(assembly.z_nominal)
    t, x, z, p, _, _ = assembly.arguments
    function = assembly.once("rounding", lambda: ca.Function("rounding", list(assembly.arguments), [
        ca.jacobian(stack([assembly.ode, assembly.alg]), stack([x, z, t, p]))]))
    largest = np.zeros(n_x + n_z)
    for k in np.unique(np.linspace(0, columns[0].shape[1] - 1, SIZES.points).astype(int)):
        t_k, x_k, z_k, p_k, u_k, rate = (a[:, k] for a in columns)
        slope = np.nan_to_num(np.array(function(t_k, x_k, z_k, p_k, u_k, rate).full()), posinf=0.0, neginf=0.0)
        rounded = EPS * np.abs(slope) @ np.abs(np.concatenate([x_k, z_k, t_k, p_k]))
        loops = np.abs(np.linalg.pinv(slope[n_x:, n_x:n_x + n_z])) @ rounded[n_x:]
        rates = rounded[:n_x] + np.abs(slope[:n_x, n_x:n_x + n_z]) @ loops
        by_x, diagonal = np.abs(slope[:n_x, :n_x]), np.abs(np.diagonal(slope[:n_x, :n_x]))
        times = np.minimum(time, 1 / np.maximum(diagonal, 1e-300))
        first = rates * times
        passed = (by_x @ first - diagonal * first) * times
        largest = np.maximum(largest, np.concatenate([first + passed, loops]))
    return largest
