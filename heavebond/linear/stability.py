"""Stability of an equilibrium: eigenvalues classified as decaying, free (zero), undamped or growing, with their states.

A zero eigenvalue is a state without a restoring effect: a body that may be at rest anywhere (rigid-body mode), an
integrator. It is mostly double (position and velocity of a free body) with one eigenvector, and any method for all
eigenvalues then gives two numbers of the size sqrt(rounding) |A| anywhere around zero. The zeros are therefore separated
first:

1. A is split into the diagonal blocks of its strongly connected states; its eigenvalues are the eigenvalues of the blocks,
   and a stiff block does not affect the accuracy of another. 2. Each block is balanced (E. E. Osborne; B. N. Parlett, C.
   Reinsch, doi:10.1007/BF02165404). 3. Its null vectors are split off by an orthogonal change of coordinates, A -> [[0, *],
   [0, A_1]], then the null vectors of A_1, until a regular matrix remains (the staircase for the Jordan chains of one
   eigenvalue: V. N. Kublanovskaya 1966; G. H. Golub, J. H. Wilkinson, SIAM Review 18 (1976) 578-619, doi:10.1137/1018113).
   Its eigenvalues are well determined.

The other eigenvalues are known up to delta |l|^T |A| |v| / |l^H v| where the entries of A are known to a share delta. An
eigenvalue closer to the imaginary axis than this is undamped: neither its decay nor its growth exceeds rounding.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from heavebond.numerics.dae import Array

Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class StabilityConstants:
    """The constants of the decision on the stability of a linear system.

    coupled: singular value of a closely coupled block, over the largest, that is zero. Origin: entries carry some 5000
        roundings of 2e-16. Doubled: nothing.
    rounding: share of the largest singular value of the whole matrix to which the singular values of a block are known.
        Origin: double precision. Doubled: nothing.
    multiple: imaginary part over the real one up to which a pair may be a multiple real eigenvalue. Origin: five in a row
        are split by 1e-15**(1/5) = 1e-3; a pair at it decays by exp(-600) within a period. Doubled: nothing.
    min_participation: participation below which a state is not named. Origin: readability. Doubled: fewer names.
    max_named: states that are named. Origin: readability. Doubled: longer lines.
    """

    coupled: float = 1e-12
    rounding: float = 1e-15
    multiple: float = 1e-2
    min_participation: float = 0.05
    max_named: int = 4


STABILITY = StabilityConstants()
STABLE, MARGINAL, UNSTABLE, UNDECIDED = "stable", "marginally stable", "unstable", "stability not decided"


@dataclass(frozen=True)
class Eigenvalue:
    """An eigenvalue in 1/s (of a pair the one with a positive imaginary part; exactly 0 for a free mode), the bound of its
    rounding, the participating states, the largest first, and the multiplicity of a free mode (2 for a body that may be at
    rest anywhere and, once pushed, moves on)."""

    value: complex
    accuracy: float
    states: tuple[str, ...]
    rigid: bool = False
    multiplicity: int = 1

    @property
    def free(self) -> bool:
        """True if it is zero."""
        return self.value == 0

    @property
    def undamped(self) -> bool:
        """True if it is on the imaginary axis up to rounding, away from zero."""
        return not self.free and abs(self.value.real) <= self.accuracy

    @property
    def grows(self) -> bool:
        """True if its motion grows."""
        return self.value.real > self.accuracy

    @property
    def text(self) -> str:
        """`rigid-body mode of load.x, load.v`, `undamped mode at 0.5 Hz of ...`, `growing mode at 0.5 Hz of ...`."""
        named = ", ".join(self.states)
        if self.free:
            return f"{'rigid-body mode' if self.rigid else 'integrator'} of {named}"
        kind = "undamped" if self.undamped else "growing" if self.grows else "decaying"
        at = f" at {abs(self.value) / (2 * np.pi):.4g} Hz" if self.value.imag else f" ({self.value.real:.4g} 1/s)"
        return f"{kind} mode{at} of {named}"


@dataclass(frozen=True)
class Stability:
    """All eigenvalues at an operating point, zeros first; `undecided` are the reasons why they do not determine the
    stability of the machine (see `held_variables`)."""

    eigenvalues: tuple[Eigenvalue, ...]
    undecided: tuple[str, ...] = ()

    @property
    def verdict(self) -> str:
        """`stable` if every eigenvalue decays, `marginally stable` with free or undamped modes in addition, `unstable` if
        one grows; `stability not decided` with reasons."""
        if self.undecided:
            return UNDECIDED
        if self.growing:
            return UNSTABLE
        return MARGINAL if self.free or self.undamped else STABLE

    @property
    def stable(self) -> bool:
        """Whether every eigenvalue decays."""
        return self.verdict == STABLE

    @property
    def free(self) -> tuple[Eigenvalue, ...]:
        """The rigid-body modes and integrators."""
        return tuple(e for e in self.eigenvalues if e.free)

    @property
    def undamped(self) -> tuple[Eigenvalue, ...]:
        """The eigenvalues on the imaginary axis, away from zero."""
        return tuple(e for e in self.eigenvalues if e.undamped)

    @property
    def growing(self) -> tuple[Eigenvalue, ...]:
        """The growing eigenvalues."""
        return tuple(e for e in self.eigenvalues if e.grows)

    @property
    def fastest(self) -> float:
        """The largest |s| in 1/s."""
        return max((abs(e.value) for e in self.eigenvalues), default=0.0)

    def beyond(self, share: float) -> tuple[Eigenvalue, ...]:
        """Eigenvalues that are not free and to the right of a share of the fastest rate: Re(s) > -share*fastest."""
        return tuple(e for e in self.eigenvalues if not e.free and e.value.real > -share * self.fastest)

    @property
    def abscissa(self) -> float:
        """The largest Re(s) in 1/s of all that are not free, within its rounding 0; -inf where all are free."""
        return max((0.0 if e.undamped else e.value.real for e in self.eigenvalues if not e.free), default=-np.inf)

    @property
    def reasons(self) -> tuple[str, ...]:
        """A phrase for each mode that prevents stability, or the reasons for an undecided verdict."""
        return self.undecided or tuple(e.text for e in (*self.growing, *self.undamped, *self.free))


def stability(a: Array, sizes: Array, states: Sequence[str], rigid: Sequence[bool] = (), period: float | None = None
              ) -> Stability:
    """The stability of x' = A x, A (n, n) in SI with the usual sizes (n,) and names of the states; `rigid` marks states that
    are positions and speeds of bodies. With a period T in s A is (Phi - 1)/T of x[k+1] = Phi x[k]."""
    scaled = a * sizes / sizes[:, None]
    eigenvalues_of: list[Eigenvalue] = []
    motion = rigid or [False] * len(states)
    whole = float(np.linalg.norm(balanced(scaled)[0], 2)) if len(a) else 0.0
    free: dict[tuple[bool, frozenset[str]], list[Eigenvalue]] = {}
    for block in strong_blocks(scaled):
        names, body = [states[k] for k in block], all(motion[k] for k in block)
        matrix, scale = balanced(scaled[np.ix_(block, block)])
        regular, null, zeros = _without_zeros(matrix, STABILITY.rounding * len(a) * whole)
        if zeros:
            taking = _largest(np.abs(null * scale[:, None]) / np.abs(null * scale[:, None]).max(axis=0), names)
            eigenvalue = Eigenvalue(0j, 0.0, taking, body or all(motion[states.index(n)] for n in taking), zeros)
            free.setdefault((eigenvalue.rigid, frozenset(n.rpartition(".")[0] for n in taking)), []).append(eigenvalue)
        # the eigenvalues of the regular part of a block, with the participating states and the bounds of their rounding
        if len(regular):
            values, right = np.linalg.eig(regular if not zeros else matrix)
            left = np.linalg.pinv(right).conj().T
            exact = np.linalg.eigvals(regular).astype(complex) if zeros else values.astype(complex)
            columns = _matched(exact, values.astype(complex)) if zeros else np.arange(len(values))
            accuracy = _accuracy(right, left, matrix)
            for value, k in zip(exact.tolist(), columns.tolist(), strict=True):
                if value.imag < 0:
                    continue
                shares = np.abs(left[:, k] * right[:, k])
                eigenvalues_of.append(Eigenvalue(complex(value), float(accuracy[k]), _largest(shares[:, None], names)))
    if period is not None:
        eigenvalues_of = [_continued(e, period) for e in eigenvalues_of]
    return Stability((*(_joined(links) for links in free.values()), *sorted(eigenvalues_of, key=lambda e: abs(e.value))))


def _continued(of: Eigenvalue, period: float) -> Eigenvalue:
    """The eigenvalue log(z)/T of a sampled system for one of (Phi - 1)/T."""
    z = 1 + period * of.value
    size = max(abs(z), float(np.finfo(float).eps))
    return replace(of, value=complex(np.log(size), np.angle(z)) / period)  # near the unit circle of the same accuracy


def strong_blocks(a: Array) -> list[list[int]]:
    """The strongly connected groups of states of a matrix, in the order of their first state."""
    reached = np.logical_or(a != 0, np.eye(len(a), dtype=bool))  # over one step at most, then over 2, 4, 8, ...
    for _ in range(len(a).bit_length()):
        steps = reached.astype(np.float32)
        reached = steps @ steps > 0
    groups: dict[int, list[int]] = {}
    for k, first in enumerate((reached & reached.T).argmax(axis=1).tolist() if len(a) else ()):
        groups.setdefault(first, []).append(k)
    return list(groups.values())


def eigenvalues(a: Array) -> Complex:
    """The eigenvalues (n,) of a matrix (n, n), zeros exact."""
    return _eigenvalues(_regular_parts(a))


def _regular_parts(a: Array) -> list[tuple[Array, int]]:
    """Of each strongly connected block of a matrix a regular one with its other eigenvalues, and how often it has 0."""
    whole = float(np.linalg.norm(balanced(a)[0], 2)) if len(a) else 0.0
    parts = [_without_zeros(balanced(a[np.ix_(block, block)])[0], STABILITY.rounding * len(a) * whole)
             for block in strong_blocks(a)]
    return [(regular, zeros) for regular, _, zeros in parts]


def _eigenvalues(parts: Sequence[tuple[Array, int]]) -> Complex:
    """All eigenvalues (n,) of these blocks."""
    values_of_blocks = []
    for regular, zeros in parts:
        values, right = np.linalg.eig(regular)
        values_of_blocks += [np.zeros(zeros, complex), real_within_rounding(values, right, np.linalg.pinv(right).conj().T,
                                                                            regular)]
    return np.concatenate(values_of_blocks) if values_of_blocks else np.zeros(0, complex)


def real_within_rounding(values: Complex | Array, right: Array | Complex, left: Array | Complex, a: Array) -> Complex:
    """Eigenvalues (n,) of a matrix (n, n) with right and left vectors in columns (n, n), in which a pair is real if rounding
    cannot distinguish it from a multiple real eigenvalue. Rounding splits a real one of multiplicity m without as many
    vectors into m numbers on a circle, of a radius that grows as the m-th root of the rounding."""
    result = values.astype(complex)
    near = np.abs(result.imag) <= STABILITY.multiple * np.abs(result.real)
    if np.any(near & (result.imag != 0)):
        near &= np.abs(result.imag) <= _accuracy(right, left, a)
    return np.where(near, result.real, result)


def _accuracy(right: Array | Complex, left: Array | Complex, a: Array) -> Array:
    """The bounds (n,) of the rounding of the eigenvalues of a matrix with these vectors."""
    noise = STABILITY.coupled * np.abs(a) + np.finfo(float).eps * len(a) * np.linalg.norm(a, 2)
    products = np.maximum(np.abs((left.conj() * right).sum(axis=0)), 1e-300)
    return np.asarray((np.abs(left) * (noise @ np.abs(right))).sum(axis=0) / products, float)


def with_zeros(values: Complex, a: Array) -> Complex:
    """Eigenvalues (n,) of a matrix as another method found them, in their order, with the zeros exact."""
    parts = _regular_parts(a)
    if not any(zeros for _, zeros in parts):
        return values
    exact = _eigenvalues(parts)
    result = values.astype(complex)
    result[_matched(exact, values)] = exact
    return result


def balanced(a: Array) -> tuple[Array, Array]:
    """D^-1 A D with rows and columns of like sizes, and the diagonal of D (n,)."""
    from scipy.linalg import matrix_balance

    balanced, (scale, _) = matrix_balance(a, permute=False, separate=True)
    return np.asarray(balanced), np.asarray(scale)


@dataclass(frozen=True)
class ZeroStaircase:
    """Q^T A Q = [[N, X], [0, R]]: `turn` Q (n, n) orthogonal, `nilpotent` N with the zero eigenvalues, `coupling` X and
    `regular` R. `steps` are the numbers of null vectors of A, of the rest of it, and so on."""

    turn: Array
    nilpotent: Array
    coupling: Array
    regular: Array
    steps: tuple[int, ...]


def zero_staircase(a: Array, least: float, steps: Sequence[int] | None = None) -> ZeroStaircase:
    """Separate the zero eigenvalues of a matrix (n, n) from the others; singular values up to `least` count as 0, or the
    numbers of them in `steps`."""
    remaining, bound, counts, zeros = a, least, list[int](), 0
    turn = np.eye(len(a))
    while len(remaining) and (steps is None or len(counts) < len(steps)):
        sizes = np.linalg.svd(remaining, compute_uv=False)
        bound = max(bound, STABILITY.coupled * float(sizes[0])) if not zeros else bound
        k = int(np.count_nonzero(sizes <= bound)) if steps is None else steps[len(counts)]
        if not k:
            break
        turned = np.linalg.svd(remaining)[2][::-1].T
        turn[:, zeros:] = turn[:, zeros:] @ turned
        remaining, zeros = (turned.T @ remaining @ turned)[k:, k:], zeros + k
        counts.append(k)
    whole, step = turn.T @ a @ turn, np.repeat(np.arange(len(counts)), counts)
    nilpotent = np.where(step[:, None] < step[None, :], whole[:zeros, :zeros], 0.0)
    return ZeroStaircase(turn, nilpotent, whole[:zeros, zeros:], remaining, tuple(counts))


def _without_zeros(a: Array, least: float) -> tuple[Array, Array, int]:
    """A regular matrix with the other eigenvalues of A, its null vectors (n, k) and how often 0 is an eigenvalue."""
    stairs = zero_staircase(a, least)
    return stairs.regular, stairs.turn[:, :sum(stairs.steps[:1])], len(stairs.nilpotent)


def _matched(wanted: Complex, computed: Complex) -> NDArray[np.int64]:
    """For each of the wanted values the index of the nearest computed one, each used once."""
    from scipy.optimize import linear_sum_assignment

    return np.asarray(linear_sum_assignment(np.abs(wanted[:, None] - computed[None, :]))[1])


def _largest(shares: Array, names: Sequence[str]) -> tuple[str, ...]:
    """The names with the largest shares (n, k) in any column."""
    most = shares.max(axis=1)
    order = np.argsort(-most, kind="stable")
    return tuple(names[k] for k in order if most[k] >= STABILITY.min_participation * most.max())[:STABILITY.max_named]


def _joined(links: Sequence[Eigenvalue]) -> Eigenvalue:
    """Combine free modes of the same parts: position and speed of a free body."""
    states = tuple(dict.fromkeys(name for link in links for name in link.states))
    return Eigenvalue(0j, 0.0, states, links[0].rigid, sum(link.multiplicity for link in links))
