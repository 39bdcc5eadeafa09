"""Behaviour of a transfer function at s = 0: G(s) = g s^q (1 + O(s)), q < 0 with integrators, q > 0 with differentiators.

The solution of (s - A) x = b is a Laurent series x = sum_k x_k s^k around 0. The strongly connected blocks of A are solved
one after the other, each after those that it depends on. An orthogonal staircase separates the zero eigenvalues of a block,
Q^T A Q = [[N, X], [0, R]] with N nilpotent and R regular (see `stability`), so that for a right side r = (r_0, r_1)

    R x_1,k = x_1,k-1 - r_1,k,   x_0,k = sum_j N^j (r_0 + X x_1)_(k+1+j).

A coefficient is 0 if it is not above what errors of the entries of A, b and c make of it: a pole that a zero cancels, or
that the input does not move, or that the output does not show. These errors are measured by solutions with disturbed entries
(stochastic arithmetic: J. Vignes, Math. Comput. Simul. 35 (1993) 233-261, doi:10.1016/0378-4754(93)90003-D). G(0) is g for
q = 0, 0 for q > 0 and infinite for q < 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from heavebond.linear.stability import STABILITY, balanced, zero_staircase
from heavebond.numerics.dae import Array


@dataclass(frozen=True)
class ZeroFrequencyConstants:
    """The constants of the behaviour at zero frequency.

    entries: share of their values to which the entries of the matrices are known. Origin: some hundred roundings of 1e-16,
        and the elimination of algebraic unknowns. Doubled: cancellations of ill-conditioned systems are accepted earlier.
    rounding: share of the largest entries of a block to which its staircase is exact. Origin: some roundings of 1e-16.
        Doubled: as with `entries`.
    samples: solutions with entries disturbed by that share. Origin: a chance below 1e-9 that each deviation is below a
        hundredth of the usual one. Doubled: time.
    beyond: multiple of the largest deviation of these solutions up to which a coefficient is 0. Origin: the usual one.
        Doubled: as with `entries`.
    """

    entries: float = 1e-13
    rounding: float = 1e-15
    samples: int = 4
    beyond: float = 3.0


ZERO_FREQUENCY = ZeroFrequencyConstants()


@dataclass(frozen=True)
class Leading:
    """The first term g s^q of a transfer function at s = 0; q is None if it is zero at all frequencies."""

    power: int | None
    factor: float

    @property
    def integrators(self) -> int:
        """The number of poles at 0 that no zero cancels."""
        return max(-(self.power or 0), 0)

    @property
    def gain(self) -> float:
        """G(0), infinite with an integrator (with the sign of g)."""
        if self.power is None or self.power > 0:
            return 0.0
        return float(np.copysign(np.inf, self.factor)) if self.power else self.factor


def states_between(a: Array, b: Array, c: Array) -> NDArray[np.int64]:
    """The states on the paths from the input (b (n,)) to the output (c (n,))."""
    reached, observed = b != 0, c != 0
    for _ in range(len(a)):
        further = reached | ((a != 0) @ reached), observed | ((a != 0).T @ observed)
        if np.array_equal(further[0], reached) and np.array_equal(further[1], observed):
            break
        reached, observed = further
    return np.asarray(np.flatnonzero(reached & observed))


def leading(a: Array, b: Array, c: Array, direct: Array, highest: int = 0) -> Leading:
    """The first term of c (s - a)^-1 b + direct[0] + direct[1] s + ... at s = 0, among the powers up to `highest`.

    a (n, n), b (n,) and c (n,) are of one channel, with states in their nominal sizes.
    """
    selected = states_between(a, b, c)
    a, b, c = a[np.ix_(selected, selected)], b[selected], c[selected]
    blocks = _blocks_in_order(a)
    exact, steps = _series(a, b, c, direct, highest, blocks)
    generator, spread = np.random.default_rng(0), np.zeros_like(exact)
    for _ in range(ZERO_FREQUENCY.samples):
        near_a, near_b, near_c, near_direct = (
            matrix * (1 + ZERO_FREQUENCY.entries * generator.uniform(-1, 1, matrix.shape)) for matrix in (a, b, c, direct))
        near = _series(near_a, near_b, near_c, near_direct, highest, blocks, steps, generator)[0]
        spread = np.maximum(spread, np.abs(near - exact))
    present = np.flatnonzero(np.abs(exact) > ZERO_FREQUENCY.beyond * spread)
    if not len(present):
        return Leading(None, 0.0)
    return Leading(int(present[0]) + highest + 1 - len(exact), float(exact[present[0]]))


def _series(a: Array, b: Array, c: Array, direct: Array, highest: int, blocks: list[list[int]],
            steps: list[tuple[int, ...]] | None = None, generator: np.random.Generator | None = None
            ) -> tuple[Array, list[tuple[int, ...]]]:
    """The coefficients of the Laurent series up to a power, from the power of all zero eigenvalues on, and the staircases of
    the blocks; with the `steps` of known staircases, and with blocks disturbed by the rounding of a staircase
    (`generator`)."""
    matrix, scale = balanced(a)
    least = STABILITY.rounding * len(a) * (float(np.linalg.norm(matrix, 2)) if len(a) else 0.0)
    stairs = []
    for k, block in enumerate(blocks):
        part = matrix[np.ix_(block, block)]
        if generator is not None and len(part) > 1:
            part = part + ZERO_FREQUENCY.rounding * np.abs(part).max() * generator.uniform(-1, 1, part.shape)
        stairs.append(zero_staircase(part, least, steps[k] if steps is not None else None))
    zeros = sum(len(s.nilpotent) for s in stairs)
    # each zero eigenvalue takes one power from the upper end of a truncated series
    x = np.zeros((len(a), 2 * zeros + highest + 1))
    right = np.zeros_like(x)
    right[:, zeros] = b / scale
    for block, s in zip(blocks, stairs, strict=True):
        z = len(s.nilpotent)
        r = s.turn.T @ (right[block] + matrix[block] @ x)
        inverse, coefficients = np.linalg.inv(s.regular), np.zeros_like(r)
        for k in range(r.shape[1]):
            coefficients[z:, k] = inverse @ ((coefficients[z:, k - 1] if k else 0.0) - r[z:, k])
        integrated = r[:z] + s.coupling @ coefficients[z:]
        for j in range(1, z + 1):
            coefficients[:z, :-j] += integrated[:, j:]
            integrated = s.nilpotent @ integrated
        x[block] = s.turn @ coefficients
    y = (c * scale) @ x
    y[zeros:zeros + len(direct)] += direct[:len(y) - zeros]
    return y[:zeros + highest + 1], [s.steps for s in stairs]


def with_zeros_at_zero(zeros: NDArray[np.complex128], number: int) -> NDArray[np.complex128]:
    """The zeros with the `number` smallest of them exactly 0: QZ scatters a multiple zero around 0."""
    result = zeros.copy()
    result[np.argsort(np.abs(result), kind="stable")[:max(number, 0)]] = 0.0
    return result


def _blocks_in_order(a: Array) -> list[list[int]]:
    """The strongly connected states of a matrix, each group after all that it depends on."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    if not len(a):
        return []
    number, label = connected_components(csr_array(a != 0), connection="strong")
    rows, columns = np.nonzero(a)
    needs: list[set[int]] = [set() for _ in range(number)]
    for i, j in zip(label[rows].tolist(), label[columns].tolist(), strict=True):
        if i != j:
            needs[i].add(j)
    order: list[int] = []
    finished: set[int] = set()
    for start in range(number):
        waiting = [start]
        while waiting:
            group = waiting[-1]
            missing = [j for j in needs[group] if j not in finished]
            if missing and group not in finished:
                waiting += missing
                continue
            waiting.pop()
            if group not in finished:
                finished.add(group)
                order.append(group)
    return [np.flatnonzero(label == group).tolist() for group in order]
