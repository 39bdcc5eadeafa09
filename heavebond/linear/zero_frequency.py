"""Behaviour of a transfer function at s = 0: G(s) = g s^q (1 + O(s)), q < 0 with integrators, q > 0 with differentiators.

The solution of (s - A) x = b is a Laurent series x = sum_k x_k s^k around 0. The strongly connected blocks of A are solved
one after the other, each after those that it depends on. An orthogonal staircase separates the zero eigenvalues of a block,
Q^T A Q = [[N, X], [0, R]] with N nilpotent and R regular (see `stability`), so that for a right side r = (r_0, r_1)

    R x_1,k = x_1,k-1 - r_1,k,   x_0,k = sum_j N^j (r_0 + X x_1)_(k+1+j).

Each coefficient has a bound of its rounding, carried along componentwise (N. J. Higham, Accuracy and Stability of Numerical
Algorithms, SIAM 2002, section 7.2). A coefficient below its bound is 0: a pole that a zero cancels, or that the input does
not move, or that the output does not show. G(0) is g for q = 0, 0 for q > 0 and infinite for q < 0.
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
    """

    entries: float = 1e-13


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
    reached, seen = b != 0, c != 0
    for _ in range(len(a)):
        further = reached | ((a != 0) @ reached), seen | ((a != 0).T @ seen)
        if np.array_equal(further[0], reached) and np.array_equal(further[1], seen):
            break
        reached, seen = further
    return np.asarray(np.flatnonzero(reached & seen))


def leading(a: Array, b: Array, c: Array, direct: Array, highest: int = 0) -> Leading:
    """The first term of c (s - a)^-1 b + direct[0] + direct[1] s + ... at s = 0, among the powers up to `highest`.

    a (n, n), b (n,) and c (n,) are of one channel, with states in their nominal sizes.
    """
    kept = states_between(a, b, c)
    matrix, scale = balanced(a[np.ix_(kept, kept)])
    n, share = len(kept), ZERO_FREQUENCY.entries
    b, c = b[kept] / scale, c[kept] * scale
    blocks = _blocks_in_order(matrix)
    least = STABILITY.rounding * n * (float(np.linalg.norm(matrix, 2)) if n else 0.0)
    staircases = [zero_staircase(matrix[np.ix_(block, block)], least) for block in blocks]
    zeros = sum(len(s.nilpotent) for s in staircases)
    # each zero eigenvalue takes one power from the upper end of a truncated series
    first, number = -zeros, 2 * zeros + highest + 1
    x, error = np.zeros((n, number)), np.zeros((n, number))
    right, right_error = np.zeros((n, number)), np.zeros((n, number))
    right[:, -first], right_error[:, -first] = b, share * np.abs(b)
    for block, stairs in zip(blocks, staircases, strict=True):
        before = matrix[block].copy()
        before[:, block] = 0.0
        r, bound = right[block] + before @ x, right_error[block] + np.abs(before) @ (error + share * np.abs(x))
        x[block], error[block] = stairs.solved(r, bound, share)
    y, bound = c @ x, np.abs(c) @ (error + share * np.abs(x))
    for k, value in enumerate(direct.tolist()):
        if k - first < number:
            y[k - first] += value
            bound[k - first] += share * abs(value)
    for k in range(zeros + highest + 1):
        if abs(y[k]) > bound[k]:
            return Leading(k + first, float(y[k]))
    return Leading(None, 0.0)


def with_zeros_at_zero(zeros: NDArray[np.complex128], number: int) -> NDArray[np.complex128]:
    """The zeros with the `number` smallest of them exactly 0: QZ scatters a multiple zero around 0."""
    found = zeros.copy()
    found[np.argsort(np.abs(found), kind="stable")[:max(number, 0)]] = 0.0
    return found


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
    done: set[int] = set()
    for start in range(number):
        waiting = [start]
        while waiting:
            group = waiting[-1]
            missing = [j for j in needs[group] if j not in done]
            if missing and group not in done:
                waiting += missing
                continue
            waiting.pop()
            if group not in done:
                done.add(group)
                order.append(group)
    return [np.flatnonzero(label == group).tolist() for group in order]
