"""Comparison of the magnitudes reached in a run with the nominal sizes of its error control.

The absolute tolerance of an unknown is `atol` times its nominal size, usually the size of its unit. A run that stays far
below (picometres, nanovolts) has no relative accuracy: its errors are of the size of the motion. The largest values of a run
are therefore compared with the nominal sizes. If an unknown stays far below, the run is repeated with the size that it
reached.

The relative tolerance applies to the value of a state. If a state moves little about a large value (a body 0.1 mK above
20 degC, a pressure of 200 bar with a ripple of 1 Pa), its errors are of the size of the motion as well. Errors of many
steps add up in a state that does not return by itself (the temperature of a body after many pulses of heat). The run is then
repeated with the difference of the state from its start as the unknown, and with the range of the motion as its size.

An unknown that is zero except for rounding, such as the middle of a symmetric machine, has no size. Rounding of the
right-hand side f(t, x, z, p) is estimated as r = eps sum |df/dv| |v| over all arguments v. In a time T it changes the states
by the integral of exp(J s) r from 0 to T, with the Jacobian matrix J of the right-hand side. It also bounds what a run about
a large value can resolve; the verdict names the states that it hides in part.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from heavebond.language.symbols import stack
from heavebond.numerics.dae import Array, Assembly, Size

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
    motion: range of a state along a run, over its largest value, below which the run is repeated with the difference of the
        state from its start. Origin: the relative tolerance of 1e-8 is then 1e-5 of the motion a step. Doubled: runs with
        errors of half that are repeated too.
    drift: sum of the tolerances of all steps that remains in a state, over its range, above which the run is repeated so.
        Origin: errors of successive steps have one sign in part: trains of pulses on a body of 1 to 300 K were off by 0.05
        to 0.17 of that sum. Doubled: runs with errors of 1e-4 of the motion are accepted.
    moved: range of a state over its largest value from which on it is not repeated so. Origin: the difference from the
        start is then nearly as large as the value. Doubled: runs that gain little are repeated.
    still: range of a state beside a large value, in its rounding, below which it stands still. Origin: the estimate of
        rounding is an upper bound. Doubled: smaller motions that rounding hides are not named.
    resolved: rounding of a state over its range from which on the verdict names it. Origin: the accuracy that a run has at
        the default tolerances. Doubled: motions that are resolved to a hundred-thousandth half as well are not named.
    noise: share of the largest unknown, in nominal sizes, below which a value is no motion. Origin: starts are solved to
        about 1e-12, and this error decays. Doubled: smaller motions with large ones are not followed.
    zero: `noise` of a start that is exact, and share of its nominal size below which a value after another start is zero.
        Origin: rounding in the products of a symmetric machine. Doubled: nothing measurable.
    least: share of its nominal size below which a value is zero in any case. Origin: squares of smaller values are below the
        smallest floating-point number. Doubled: nothing measurable.
    max_repeats: repetitions of a run. Origin: the sizes of the first repetition may follow from errors. Doubled:
        nothing measurable.
    points: points of a run at which rounding is estimated. Origin: extremes of most motions. Doubled: nothing measurable.
    dense: states above which the matrix exponential is replaced by the time constants of the single states, and the states
        that contain them. Origin: a tenth of a second. Doubled: eight times that.
    least_stops: stops of a run from which on they show how large its unknowns become. Origin: an oscillation of a few
        cycles. Doubled: more runs are made once more with these stops where an unknown seems small.
    steep: change of a state in its nominal size in 1 s, or in a shorter run, by the rate that belongs to an algebraic
        unknown of its nominal size, above which this is taken smaller. Origin: at the default tolerances the absolute one of
        the unknown is then an error of 1e-3 of the rate, and all machines of the library are below it. Doubled: runs of tiny
        bodies are slower.
    before_failure: share of the time up to a failure that shows the sizes of algebraic unknowns. Origin: the run up to there
        has to succeed. Doubled: the run fails as before.
    """

    small: float = 1e-4
    algebraic: float = 1e-2
    rounding: float = 30.0
    motion: float = 1e-3
    drift: float = 5e-4
    moved: float = 0.3
    still: float = 3.0
    resolved: float = 1e-5
    noise: float = 1e-12
    zero: float = 1e-19
    least: float = 1e-120
    max_repeats: int = 3
    points: int = 16
    dense: int = 40
    least_stops: int = 100
    steep: float = 1e7
    before_failure: float = 0.99


SIZES = SizeConstants()


def far_below(reached: Mapping[str, float], nominal: Mapping[str, float], declared: Mapping[str, float],
              exact: bool = False) -> list[str]:
    """The unknowns whose largest values stay far below their present nominal sizes, and that are not zero but for the
    errors of the largest unknown in its `declared` nominal size; an `exact` start leaves only rounding, also if all unknowns
    are tiny."""
    largest = max((value / declared[name] for name, value in reached.items() if np.isfinite(value)), default=0.0)
    least = max(SIZES.zero * min(largest, 1.0), SIZES.least) if exact else max(SIZES.noise * largest, SIZES.zero)
    return [name for name, value in reached.items() if least * declared[name] < value < SIZES.small * nominal[name]]


def little_moved(lowest: Mapping[str, float], highest: Mapping[str, float], exact: bool = False) -> list[str]:
    """The states whose range along a run is far below their values, and not an error of a start that is not `exact`."""
    names = []
    for name, low in lowest.items():
        spread, largest = highest[name] - low, max(abs(low), abs(highest[name]))
        least = SIZES.still * EPS if exact else SIZES.noise
        if least * largest < spread < SIZES.motion * largest:
            names.append(name)
    return names


def drifting(assembly: Assembly, lowest: Mapping[str, float], highest: Mapping[str, float], allowed: float,
             along: Callable[[], Sequence[Array]]) -> list[str]:
    """The states in which the tolerances of the steps add up to a considerable share of their ranges. `allowed` is the
    relative tolerance times the number of steps, and `along` gives the arguments (., N) along the run."""
    largest = np.array([max(abs(lowest[name]), abs(highest[name])) for name in assembly.state_names])
    ranges = np.array([highest[name] - lowest[name] for name in assembly.state_names])
    suspected = (ranges < SIZES.moved * largest) & (allowed * largest > SIZES.drift * ranges) & \
        (ranges > SIZES.motion * largest) & np.array([name not in assembly.sizes for name in assembly.state_names], bool)
    if not suspected.any():
        return []
    columns = along()
    span = float(np.ptp(columns[0]))
    remaining = _accumulated(assembly, columns, span, np.where(suspected, allowed * largest / span, 0.0))
    return [name for name, found, k, moved in zip(assembly.state_names, suspected, remaining, ranges, strict=False)
            if found and k > SIZES.drift * moved]


@dataclass(frozen=True)
class FittingSizes:
    """The sizes of some unknowns that fit a run, and the motions that the rounding of their values hides in part: range of
    the state, and the error of rounding in it."""

    sizes: Mapping[str, Size]
    hidden: Mapping[str, tuple[float, float]]


def fitting_sizes(assembly: Assembly, reached: Mapping[str, float], origins: Mapping[str, float],
                  moved: Mapping[str, float], columns: Sequence[Array], steps: int, atol: float) -> FittingSizes:
    """Sizes that fit a run, powers of ten, of unknowns with the largest values `reached`, of which some are counted from
    `origins`; unknowns that are zero except for rounding are omitted, and no size is so small that rounding exceeds the
    absolute tolerance. `moved` are ranges of states to be compared with rounding, and `columns` the arguments (., N) along
    the run."""
    span = float(np.ptp(columns[0]))
    every = [*assembly.state_names, *assembly.algebraic_names]
    whole, in_step = (dict(zip(every, _accumulated(assembly, columns, time).tolist(), strict=True))
                      for time in (span, span / max(steps, 1)))
    nominal = dict(zip(every, [*assembly.x_nominal, *assembly.z_nominal], strict=True))
    largest = dict(zip(every, np.abs(np.concatenate([columns[1], columns[2]])).max(axis=1), strict=True))
    sizes = {}
    for name, value in reached.items():
        resolvable, before = in_step.get(name, 0.0) / atol, assembly.sizes.get(name)
        if before is not None and before.origin and resolvable > value:
            continue  # rounding limits its size, and a repetition has fitted it
        size = float(10.0 ** np.ceil(np.log10(max(value, resolvable))))
        least = SIZES.still if name in origins else SIZES.rounding
        if value > least * whole.get(name, 0.0) and (name in origins or size < nominal.get(name, np.inf)):
            sizes[name] = Size(min(size, nominal.get(name, size)), origins.get(name, before.origin if before else 0.0))
    hidden = {}
    for name, value in moved.items():
        error = max(EPS * largest.get(name, 0.0), whole.get(name, 0.0))
        if SIZES.still * error < value < error / SIZES.resolved:
            hidden[name] = value, float(error)
    return FittingSizes(sizes, hidden)


def _accumulated(assembly: Assembly, columns: Sequence[Array], time: float, errors: Array | None = None) -> Array:
    """The largest error of x and z (n_x + n_z,) after a time (s), from some points of a run: the response of the linearised
    equations to `errors` of the right-hand sides (n_x,), or else to their rounding, held constant. With many states each one
    has its own time constant in place of the matrix exponential."""
    from scipy.linalg import expm

    n_x, n_z = len(assembly.x_nominal), len(assembly.z_nominal)
    t, x, z, p, _, _ = assembly.arguments
    function = assembly.once("rounding", lambda: ca.Function("rounding", list(assembly.arguments), [
        ca.jacobian(stack([assembly.ode, assembly.alg]), stack([x, z, t, p]))]))
    largest, scale = np.zeros(n_x + n_z), assembly.x_nominal
    for k in np.unique(np.linspace(0, columns[0].shape[1] - 1, SIZES.points).astype(int)):
        t_k, x_k, z_k, p_k, u_k, rate = (a[:, k] for a in columns)
        slope = np.nan_to_num(np.array(function(t_k, x_k, z_k, p_k, u_k, rate).full()), posinf=0.0, neginf=0.0)
        rounded = EPS * np.abs(slope) @ np.abs(np.concatenate([x_k, z_k, t_k, p_k]))
        f_z, back = slope[:n_x, n_x:n_x + n_z], np.linalg.pinv(slope[n_x:, n_x:n_x + n_z])
        loops = np.abs(back) @ rounded[n_x:]
        rates = rounded[:n_x] + np.abs(f_z) @ loops if errors is None else errors
        if n_x > SIZES.dense:
            by_x, diagonal = np.abs(slope[:n_x, :n_x]), np.abs(np.diagonal(slope[:n_x, :n_x]))
            times = np.minimum(time, 1 / np.maximum(diagonal, 1e-300))
            in_time = rates * times + (by_x @ (rates * times) - diagonal * rates * times) * times
        else:
            generator = (slope[:n_x, :n_x] - f_z @ back @ slope[n_x:, :n_x]) * scale / scale[:, None] * time
            with np.errstate(over="ignore", invalid="ignore"):
                whole = expm(np.block([[generator, np.eye(n_x)], [np.zeros((n_x, 2 * n_x))]]))[:n_x, n_x:]
                in_time = np.nan_to_num(np.abs(whole) @ (rates / scale) * scale * time, nan=np.inf, posinf=np.inf)
        largest = np.maximum(largest, np.concatenate([in_time, loops]))
    return largest
