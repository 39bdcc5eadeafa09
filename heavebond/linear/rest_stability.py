"""Stability of an equilibrium: a smooth limit for tuning, and the margins of tuned parameters.

An eigenvalue s of the machine linearised at its operating point is scored by

    r = (Re s + eps w) / sqrt(|s|**2 + 1/T**2),

minus its damping ratio if it is fast against the time T of the run; w is the fastest rate, eps = 1e-6. Eigenvalues of
zero (bodies that nothing holds, integrators outside of every loop) have no score. The limit is a smooth maximum over all
scores, log(sum exp(rho r))/rho, which is differentiable when another mode becomes the largest; G. Kreisselmeier, R.
Steinhauser, Systematic control design by optimizing a vector performance index, IFAC Symposium, Zurich 1979, 113-117.

A machine with dry friction is judged as modelled, while all dry friction slides, and with the slopes that it has over the
motion of the case (see `describing_function`). The sentences add the verdict over all slopes between these.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.equations.buffered import Buffered
from heavebond.language.symbols import stack
from heavebond.linear.describing_function import NO_FRICTION, dry_frictions
from heavebond.linear.linearisation import DIFFERENCE, Linear, Mode, ModesAtStart
from heavebond.linear.sampled import equivalent
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.initialise import Start
from heavebond.numerics.newton import Scaling, newton
from heavebond.numerics.start_equations import Point

STABLE = "stable"


@dataclass(frozen=True)
class RestStabilityConstants:
    """The constants of the stability at rest, a smooth function of the parameters for searches.

    smoothing: distance of a real pole from zero, over the fastest, that counts as kept. Origin: rounding of eigenvalues.
        Doubled: nothing.
    sharpness: exponent of the smooth maximum over modes: n equal scores lie log(n)/sharpness above them, a damping ratio of
        some 0.0005. Origin: small against damping ratios that matter. Doubled: half of that, stiffer gradients.
    min_damping: damping ratio that a search keeps. Origin: twice the tolerance of a limit. Doubled: searches keep farther
        from the boundary.
    at_rest: change of a state in a second of the run's time, over its size, below which it is at rest. Origin: tolerances.
        Doubled: nothing.
    min_weight: weight in the smooth maximum below which a mode is left out. Origin: it does not move the sum. Doubled:
        nothing.
    max_factor: factor on a gain, up or down, within which a stability boundary is looked for. Origin: two decades. Doubled:
        boundaries farther away are found.
    factor_ratio: ratio of successive factors in that search. Origin: 9 for each decade. Doubled (in its excess over 1): two
        crossings close to each other are missed.
    rank_one: singular value, over the largest, below which a friction acts on one direction. Origin: rounding of a
        linearisation. Doubled: nothing.
    """

    smoothing: float = 1e-6
    sharpness: float = 2000.0
    min_damping: float = 2e-4
    at_rest: float = 1e-6
    min_weight: float = 1e-8
    max_factor: float = 100.0
    factor_ratio: float = 1.3
    rank_one: float = 1e-6


REST_STABILITY = RestStabilityConstants()
# the slope of dry friction, as shares of that at rest, half a decade apart, and sliding
SHARES = (*(10 ** (-k / 2) for k in range(11)), 0.0)
PHASES = np.radians(np.arange(1, 181, 2))


@dataclass(frozen=True)
class Variant:
    """The linearised machine with shares of the slopes of its dry frictions."""

    shares: tuple[float, ...]
    point: Point
    linear: Linear
    modes: tuple[Mode, ...]

    @cached_property
    def fastest(self) -> float:
        """The fastest rate in 1/s."""
        return max((abs(mode.value) for mode in self.modes), default=0.0)

    @property
    def zeros(self) -> int:
        """How many eigenvalues are zero: free bodies, integrators outside of every loop."""
        return sum(1 + mode.swings for mode in self.modes if not mode.value)

    def score(self, mode: Mode, base: float) -> float:
        """r, positive for an eigenvalue that grows; a decaying real eigenvalue is scored without eps."""
        s = mode.value
        margin = REST_STABILITY.smoothing * self.fastest if s.imag or s.real > 0 else 0.0
        return float((s.real + margin) / np.hypot(abs(s), base))


@dataclass(frozen=True)
class OperatingPointStability:
    """A machine at its operating point: as modelled, and if it has dry friction, with the slopes of the case and while
    that slides; `first` is the start that was linearised, None if the point was found from it."""

    first: Start | None
    variants: tuple[Variant, ...]
    base: float

    @property
    def worst(self) -> float:
        """The largest score, below zero where the machine is stable; -1 where nothing moves by itself."""
        return max((v.score(m, self.base) for v in self.variants for m in v.modes if m.value), default=-1.0)

    @property
    def smooth(self) -> float:
        """The smooth maximum of the scores."""
        scores = np.array([v.score(m, self.base) for v in self.variants for m in v.modes if m.value])
        most = float(scores.max(initial=-1.0))
        sharpness = REST_STABILITY.sharpness
        return most + float(np.log(np.exp(sharpness * (scores - most)).sum())) / sharpness if len(scores) else most


class RestStability:
    """The stability of an assembly at its operating point, for any parameters; `until` is the time T of its runs."""

    def __init__(self, assembly: Assembly, until: float):
        self.modes = ModesAtStart(assembly)
        self.assembly, self.base = self.modes.assembly, 1 / until
        self.frictions = dry_frictions(self.assembly)
        self.shares: tuple[float, ...] | None = None  # the slopes of the case, as shares of those at rest

    def at(self, values: Mapping[str, float | str]) -> OperatingPointStability | None:
        """The machine at rest with these parameters set, None without an equilibrium; StartError without a start."""
        first = self.modes.start(values)
        point, at_start = self.modes.point(first), True
        if not self._rests(point):
            # the equilibrium that Newton's method finds from the start, with the inputs held still
            assembly, n_x = self.assembly, len(point.x)
            sizes = np.concatenate([assembly.x_nominal, assembly.z_nominal])
            updates = self.modes.linearisation.updates(point)
            if updates is not None:
                equilibrium = updates.at_rest(point, self.modes.equations.bounds)
            else:

                def system(y: Array) -> tuple[Array, Array]:
                    sides, jacobian = self._at(replace(point, x=y[:n_x], z=y[n_x:], rate=0.0))
                    return sides, jacobian * sizes

                low, high = self.modes.equations.bounds
                result = newton(system, np.concatenate([point.x, point.z]),
                                Scaling(sizes, low[:len(sizes)], high[:len(sizes)]))
                equilibrium = replace(point, x=result.y[:n_x], z=result.y[n_x:], rate=0.0) if result.good else None
            if equilibrium is None:
                return None
            point, at_start = equilibrium, False
        variants = [self._variant(point, share) for share in ((1.0, 0.0) if self.frictions.names else (1.0,))]
        # a friction of no force, or one that slides already, is the same whatever its slope at rest
        if len(variants) > 1 and np.array_equal(variants[0].linear.a, variants[1].linear.a):
            variants = variants[:1]
        elif self.shares is not None:
            variants.insert(1, self._variant(point, self.shares))
        return OperatingPointStability(first if at_start else None, tuple(variants), self.base)

    def unstable_shares(self, operating: OperatingPointStability) -> tuple[float, float] | None:
        """The slopes of all dry friction, as shares of those at rest, between which the machine is not stable."""
        if len(operating.variants) < 2:
            return None
        point = operating.variants[0].point  # with the slopes as modelled
        bad = [share for share in SHARES if not OperatingPointStability(None, (self._variant(point, share),),
                                                                        self.base).worst < 0]
        return (min(bad), max(bad)) if bad else None

    def limit(self, values: Mapping[str, float | str], named: Sequence[str]) -> tuple[float, Array]:
        """The limit, positive if the damping ratio is below the least one, and its derivatives by parameters (m,); -1 if
        stability at rest is not defined."""
        operating = self.at(values)
        if operating is None:
            return -1.0, np.zeros(len(named))
        value = operating.smooth
        if any(variant.linear.period is not None for variant in operating.variants):
            # the slope (m,) of the limit of a sampled system, by central differences
            present, slope = self.assembly.with_parameters(values).parameter_values, np.zeros(len(named))
            for k, name in enumerate(named):
                step = DIFFERENCE * (abs(present[name]) or 1.0)
                ends = [self.at({**values, name: present[name] + sign * step}) for sign in (-1, 1)]
                if all(end is not None for end in ends):
                    low, high = (end.smooth for end in ends if end is not None)
                    slope[k] = (high - low) / (2 * step)
            return value + REST_STABILITY.min_damping, slope
        slope = np.zeros(len(named))
        for variant in operating.variants if named and operating.first is not None else ():
            for mode in variant.modes:
                r = variant.score(mode, self.base) if mode.value else -np.inf
                if (weight := float(np.exp(REST_STABILITY.sharpness * (r - value)))) > REST_STABILITY.min_weight:
                    assert operating.first is not None
                    ds = self.modes.slope(operating.first, mode, named, variant.point)
                    s, size = mode.value, float(np.hypot(abs(mode.value), self.base))
                    excess = variant.score(mode, self.base) * size
                    score_slope = ds.real / size - excess * (s.real * ds.real + s.imag * ds.imag) / size**3
                    slope += weight * np.where(np.isfinite(score_slope), score_slope, 0.0)
        return value + REST_STABILITY.min_damping, slope

    def _variant(self, point: Point, share: float | Sequence[float]) -> Variant:
        shares = [share] * len(self.frictions.names) if isinstance(share, float) else share
        point = replace(point, p=self.frictions.sliding(point.p, shares))
        linear = self.modes.linearisation.at(point)
        return Variant(tuple(shares), point, linear, tuple(linear.modes()))

    @cached_property
    def _rates(self) -> Buffered:
        """f and g, and their Jacobian by x and z."""
        assembly = self.assembly
        _, x, z, _, _, _ = assembly.arguments
        sides, inner = stack([assembly.ode, assembly.alg]), stack([x, z])
        return Buffered(ca.Function("rates", list(assembly.arguments), [sides, ca.jacobian(sides, inner)]))

    def _at(self, point: Point) -> tuple[Array, Array]:
        sides, jacobian = self._rates(*point.values()).values()
        return sides.ravel(), jacobian

    def _rests(self, point: Point) -> bool:
        """True if no state changes at the point, or only at a constant rate: a shaft that turns at a constant speed."""
        n_x, sizes = len(point.x), self.assembly.x_nominal
        rates = self._at(replace(point, rate=0.0))[0][:n_x]
        if not np.all(np.isfinite(rates)):
            return False
        if (samples := self.modes.linearisation.updates(point)) is not None:  # they must set their variables to these values
            sides, jacobian = (np.array(v) for v in samples.rest(*point.values()))
            changes, slopes = sides[-len(samples.target):].ravel(), jacobian[-len(samples.target):]
            reach = np.abs(slopes[:, :n_x]) @ sizes + \
                np.abs(slopes[:, n_x + len(point.z):]) @ np.abs(point.p[samples.indices])
            if not np.all(np.abs(changes) <= REST_STABILITY.at_rest * reach):
                return False
        if np.all(np.abs(rates) <= REST_STABILITY.at_rest * sizes * self.base):
            return True
        linear, updates = self.modes.linearisation.continuous(point)
        scaled = np.abs(linear.a @ rates) / sizes
        if updates is not None:  # nor does what the samples set
            rows = linear.c[len(linear.c) - len(updates.target):]
            scaled = np.append(scaled, np.abs(rows @ rates) / np.maximum(np.abs(rows) @ sizes, 1e-300))
        fastest = float(np.abs(rates / sizes).max())
        return bool(np.all(scaled <= REST_STABILITY.at_rest * max(fastest, self.base) * self.base))


# -- what is told of a tuned machine -------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Loop:
    """The margins of the loop that runs through the free parameters of controllers: factors of its gain (None: no limit
    within a hundred), the phase margin in degrees (None: none up to 180), and its crossover in Hz."""

    through: tuple[str, ...]
    gain_down: float | None
    gain_up: float | None
    phase: float | None
    frequency: float


@dataclass(frozen=True)
class Stability:
    """The stability of a tuned machine. `decided` is the basis of the verdict: `equilibrium`, `periodic run` or `` (not
    decided); `stable` is None if it is not decided. `damping` is the least damping ratio as modelled, `sliding` the least
    damping ratio with sliding dry friction, and `in_case` the least damping ratio with the slopes of the case (None without
    dry friction); `slowest` the frequency (Hz) and damping ratio of the slowest mode that oscillates; `shares` the slopes of
    dry friction, as shares of those at rest, between which the machine is unstable, which need not include those of the
    case; `marginal` the number of free bodies and integrators; `boundary` the factors by which each free parameter may fall
    and grow; `case` the least stable case; `multiplier` the largest Floquet multiplier; `undecided` the held variables that
    make the stability undecided, and `held` all of them with their treatment."""

    decided: str
    stable: bool | None
    damping: float | None = None
    sliding: float | None = None
    in_case: float | None = None
    slowest: tuple[float, float] | None = None
    frictions: tuple[str, ...] = ()
    fixed: tuple[str, ...] = ()
    shares: tuple[float, float] | None = None
    marginal: int = 0
    loop: Loop | None = None
    boundary: Mapping[str, tuple[float | None, float | None]] | None = None
    case: str = ""
    multiplier: float | None = None
    undecided: tuple[str, ...] = ()
    held: tuple[str, ...] = ()


def least_damping(variant: Variant) -> float:
    """The least damping ratio of all modes except those with eigenvalue zero."""
    return min((mode.damping for mode in variant.modes if mode.value), default=1.0)


def describe(machine: RestStability, operating: OperatingPointStability, case: str, named: Sequence[str],
             values: Mapping[str, float],
             boundary: Mapping[str, tuple[float | None, float | None]]) -> Stability:
    """The margins of the machine of one case at its operating point."""
    modelled, slid = operating.variants[0], operating.variants[-1]
    oscillating = [mode for mode in modelled.modes if mode.swings]
    bad = tuple(not OperatingPointStability(None, (v,), operating.base).worst < 0 for v in operating.variants)
    friction = machine.frictions if len(operating.variants) > 1 else NO_FRICTION
    case_too = len(operating.variants) > 2
    return Stability(
        "equilibrium", not any(bad), least_damping(modelled), least_damping(slid) if friction.names else None,
        least_damping(operating.variants[1]) if case_too else None,
        (oscillating[0].frequency, oscillating[0].damping) if oscillating else None, friction.names, friction.fixed,
        machine.unstable_shares(operating), modelled.zeros,
        None if any(bad) else loop(machine, slid, named, values), boundary, case)


def loop(machine: RestStability, variant: Variant, named: Sequence[str], values: Mapping[str, float]) -> Loop | None:
    """The margins of the loop through those parameters that belong to signals, if all of them together scale one loop: A(k)
    = A_0 + k M with M of rank one, M = B C, so that L(s) = -C (s - A_0)^-1 B. With a phase of phi in the loop the poles are
    the eigenvalues of A_0 + exp(-j phi) M. For a sampled system A is its Delta."""
    gains = [name for name in named if values[name] and _of_signals(machine.assembly, name)]
    if not gains:
        return None
    at = [machine.assembly.parameter_names.index(name) for name in gains]

    zeros, period = variant.zeros, variant.linear.period

    def matrix(factor: float) -> Array:
        p = variant.point.p.copy()
        p[at] *= factor
        sizes = variant.linear.sizes
        return np.asarray(machine.modes.linearisation.at(replace(variant.point, p=p)).generator * sizes / sizes[:, None])

    def rates(poles: NDArray[Any]) -> NDArray[Any]:
        # without this number of smallest poles, which are zero except for rounding
        moving = poles[np.argsort(np.abs(poles))[zeros:]]
        return moving if period is None else equivalent((1 + period * moving).astype(complex), period)

    one = matrix(1.0)
    m = one - matrix(0.0)
    values_of = np.linalg.svd(m, compute_uv=False)
    if not values_of[0] > 0 or (len(values_of) > 1 and values_of[1] > REST_STABILITY.rank_one * values_of[0]) or \
            np.abs(matrix(2.0) - one - m).max() > REST_STABILITY.rank_one * np.abs(m).max():
        return None

    def growth(factor: complex) -> float:
        return float(rates(np.linalg.eigvals(one - m + factor * m)).real.max(initial=-np.inf))

    down, up = (crossing(growth, upwards) for upwards in (False, True))
    turns = [growth(np.exp(-1j * phi)) for phi in (0.0, *PHASES)]
    phase, frequency = None, 0.0
    for (phase_low, phase_high), (low, high) in zip(pairwise((0.0, *PHASES.tolist())), pairwise(turns), strict=True):
        if (low < 0) != (high < 0):
            from scipy.optimize import brentq

            phi = float(brentq(lambda phi: growth(np.exp(-1j * phi)), phase_low, phase_high, xtol=1e-6))
            poles = rates(np.linalg.eigvals(one - m + np.exp(-1j * phi) * m))
            phase, frequency = float(np.degrees(phi)), float(abs(poles[np.argmax(poles.real)].imag) / (2 * np.pi))
            break
    return Loop(tuple(gains), down, up, phase, frequency)


def _of_signals(assembly: Assembly, name: str) -> bool:
    """Whether a parameter is taken by components with signal outputs only."""
    symbol = assembly.flat.p[assembly.parameter_names.index(name)]
    leaves = assembly.flat.expanded.leaves
    takers = {path for path in leaves if name.rpartition(".")[0] == path} | {
        key.rpartition(".")[0] for key, expression in assembly.flat.constants.items()
        if key != name and isinstance(expression, ca.SX) and ca.depends_on(expression, symbol)}
    components = [leaves[path].component for path in takers if path in leaves]
    return bool(components) and all(any(port.direction == "out" for port in c.signals.values()) for c in components)


def crossing(score: Callable[[float], float], up: bool) -> float | None:
    """The factor, above or below 1, at which a score changes its sign; None if it keeps its sign within a factor of 100, or
    if it has no value before that factor."""
    from scipy.optimize import brentq

    near, first = 1.0, score(1.0)
    while 1 / REST_STABILITY.max_factor < near < REST_STABILITY.max_factor and np.isfinite(first):
        far = near * REST_STABILITY.factor_ratio if up else near / REST_STABILITY.factor_ratio
        score_here = score(far)
        if not np.isfinite(score_here):
            return None
        if (score_here < 0) != (first < 0):
            try:
                return float(brentq(score, near, far, xtol=1e-4))
            except ValueError:  # no score at a factor in between: the machine has no operating point
                return None
        near = far
    return None


def stability_sentences(stability: Stability, *, asked: bool = True) -> Iterator[str]:
    """Sentences on the stability of a tuned machine."""
    if stability.undecided:
        yield f"stability not decided: {'; '.join(stability.undecided)}"
    elif not stability.decided:
        yield "stability not decided: no equilibrium was found from the start, and the run does not end in a period or " \
            "has events"
    if not stability.decided:
        yield from stability.held
        return
    if stability.decided != "equilibrium":
        assert stability.multiplier is not None
        yield f"{'stable' if stability.stable else 'NOT STABLE'} by its periodic run: the largest Floquet multiplier is " \
              f"{stability.multiplier:.4g}"
        yield from stability.held
        return
    assert stability.damping is not None
    if stability.stable:
        yield f"stable at its operating point: {_dampings(stability)}"
    elif not stability.frictions:
        yield f"NOT STABLE at its operating point: the least damping ratio is {stability.damping:.3g}; a run that looks " \
            "well is held by limits or by its short time, not by the gains"
    else:
        yield f"NOT STABLE: {_dampings(stability)}"
    if stability.shares is not None:
        low, high = stability.shares
        slopes = f"below {high:.2g}" if low == 0 else f"from {low:.2g} to {high:.2g}"
        yield f"over the amplitude: unstable where the slope of its dry friction is {slopes} of that at rest; motions " \
            "grow there until their amplitude gives it another slope"
    if not asked:
        yield "stability was not asked for (`stable: off`)"
    yield from stability.held
    if stability.slowest is not None:
        yield f"slowest oscillating mode: {stability.slowest[0]:.4g} Hz, damping ratio {stability.slowest[1]:.3g}"
    if stability.marginal:
        yield f"{stability.marginal} eigenvalue{'s' * (stability.marginal > 1)} of zero not counted (free bodies, " \
            "integrators outside of every loop)"
    if stability.fixed:
        yield f"the dry friction of {', '.join(stability.fixed)} follows from other parameters and was taken as modelled"
    if stability.loop is not None:
        yield _loop_words(stability.loop)


def summary_sentences(stability: Stability, *, asked: bool = True) -> list[str]:
    """Whether it is stable, and the margins of its loop."""
    return [next(stability_sentences(stability, asked=asked)), *([_loop_words(stability.loop)]
                                                                 if stability.loop is not None else [])]


def _dampings(stability: Stability) -> str:
    text = f"least damping ratio {stability.damping:.3g}"
    if stability.sliding is None:
        return text
    in_case = f", {stability.in_case:.3g} with its slope over the motion of the run" if stability.in_case is not None else ""
    return f"{text} as modelled{in_case}, {stability.sliding:.3g} while its dry friction slides"


def _loop_words(loop: Loop) -> str:
    ends = " and ".join(f"{factor:.3g}" for factor in (loop.gain_down, loop.gain_up) if factor is not None)
    gain = f"gain margin times {ends}" if ends else "no gain margin within a factor of 100"
    phase = f"phase margin {loop.phase:.3g} deg at {loop.frequency:.3g} Hz" if loop.phase is not None else \
        "infinite phase margin"
    return f"loop through {', '.join(loop.through)}: {gain}, {phase}"
