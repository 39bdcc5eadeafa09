"""The slowest modes of a large machine, and a search for growing ones, from sparse matrices.

With v = (x, z) the linearised equations are M v' = J v, M = diag(1, 0), J = [[f_x, f_z], [g_x, g_z]]: the eigenvalues s
of A = f_x - f_z g_z^-1 g_x solve J v = s M v. A product (A - a)^-1 x is the upper part of (J - a M)^-1 (x, 0), solved with
the sparse factors of J - a M; A itself, which is full, is never formed. Arnoldi's method (R. B. Lehoucq, D. C. Sorensen, C.
Yang, ARPACK Users' Guide, SIAM 1998) finds

* the modes nearest to a point a close to 0, as the largest eigenvalues 1/(s - a) of that product;
* growing modes, as eigenvalues theta = (s + a)/(s - a) of I + 2 a (A - a)^-1 (Cayley transform): |theta| > 1 exactly where
  Re s > 0, and most so where |s| is near a (K. Meerbergen, A. Spence, D. Roose, BIT 34 (1994) 409-423,
  doi:10.1007/BF01935650). As a goes from the slowest to the fastest rate of the machine, each growing mode is among the
  largest at some a, unless it grows by a small share of its frequency only and many undamped modes hide it.

Each estimate is refined by two-sided inverse iteration with a shift next to it (A. M. Ostrowski, Arch. Rational Mech.
Anal. 3 (1959) 325-340, doi:10.1007/BF00284184), which gives both vectors and the bound of its rounding delta |l|^T |J| |v| /
|l^H M v|, for entries of J with a relative error delta: a mode with |Re s| below it does not grow, and one with |s|
below it is free.

A group of equal eigenvalues (parts of one kind that do not act on each other) may be found fewer times than it occurs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import Problem, UsageError
from heavebond.linear.linearisation import Linearisation, Mode
from heavebond.linear.stability import STABILITY
from heavebond.numerics.start_equations import Point

Complex = NDArray[np.complex128]
Product = Callable[[Any], Any]


@dataclass(frozen=True)
class SlowModesConstants:
    """The constants of sparse modes.

    max_all: states up to which all modes are computed, densely. Origin: some ten seconds. Doubled: eight times as many.
    count: modes that are computed of larger machines. Origin: a page. Doubled: a longer table.
    near: distance of the shift from zero, as a share of 1/T of the run's time T. Origin: far below the modes that a run
        shows, far above the rounding of its rates. Doubled: nothing measurable.
    next: distance of the shift from an eigenvalue that is computed again, as a share of it. Origin: two iterations converge,
        and the factors are not singular. Doubled: nothing measurable.
    iterations: such iterations. Origin: each gains six digits and more. Doubled: time.
    ratio: ratio of successive shifts of the search for growing modes. Origin: at a ratio of 1.8 of |s| to a the transform
        shows 0.85 of the growth that it shows at a. Doubled: half of the time, weak growth missed.
    candidates: eigenvalues of the transform that are computed again at each shift. Origin: few modes grow. Doubled: time.
    basis_growing: vectors of Arnoldi's basis in that search. Origin: a second for 10 000 states. Doubled: four times as long
        for large machines, weaker growth found.
    certain: residual of an estimate, over the excess of its magnitude above 1, up to which it may be an eigenvalue. Origin:
        vectors are far from orthogonal where motions decay. Doubled: a few more are computed again in vain.
    basis: vectors of Arnoldi's basis in the search for the slowest. Origin: twice the usual number. Doubled: time.
    restarts: restarts in that search. Origin: a bound; modes apart from each other need a few, and of hundreds that differ
        by 1e-9, as of equal pieces damped alike, not each is found. Doubled: time.
    powers: products of the power method that finds the fastest rate. Origin: its order of magnitude is enough. Doubled:
        nothing measurable.
    rounding: length of a new vector of the basis, over the product, from which on it is rounding. Origin: double precision.
        Doubled: nothing.
    """

    max_all: int = 300
    count: int = 30
    near: float = 1e-2
    next: float = 1e-4
    iterations: int = 3
    ratio: float = 3.1622776601683795
    candidates: int = 3
    basis_growing: int = 120
    certain: float = 1e-2
    basis: int = 40
    restarts: int = 20
    powers: int = 60
    rounding: float = 1e-13


SLOW_MODES = SlowModesConstants()


@dataclass(frozen=True)
class SlowModes:
    """The slowest modes, the slowest first; growing modes beyond them; and the rates in 1/s between which growing modes were
    searched; `unstable` is the number of all growing eigenvalues, `states` the number of all eigenvalues. Free modes have
    the value 0."""

    slowest: list[Mode]
    growing: list[Mode]
    searched: tuple[float, float]
    unstable: int
    states: int

    @property
    def modes(self) -> list[Mode]:
        """All modes."""
        return [*self.slowest, *self.growing]

    @property
    def computed(self) -> int:
        """The number of the slowest eigenvalues, two for a pair."""
        return sum(1 + mode.swings for mode in self.slowest)

    @property
    def reach(self) -> float:
        """The largest |s| in 1/s of the slowest."""
        return max((abs(mode.value) for mode in self.slowest), default=0.0)


def slow_modes(linearisation: Linearisation, point: Point, span: float, count: int = SLOW_MODES.count) -> SlowModes:
    """The `count` slowest eigenvalues near a point, and growing ones; `span` is the time in s of a run, whose inverse is the
    slowest rate that matters. UsageError if an algebraic loop is singular at the point, or if there are not so many
    modes."""
    pencil = _Pencil(linearisation, point)
    if not 0 < count < pencil.n - 1:
        raise UsageError([Problem("modes-count", f"{count} modes of {pencil.n} states cannot be chosen", None,
                                  f"Take 1 to {max(pencil.n - 2, 1)}, or all of them.")])
    near = pencil.shifted(SLOW_MODES.near / span)
    # the eigenvalues of largest magnitude that converged
    from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs

    try:
        every = eigs(LinearOperator((pencil.n, pencil.n), matvec=lambda x: near(x.ravel()), dtype=float), count,
                     v0=_first(pencil.n), maxiter=SLOW_MODES.restarts,
                     ncv=min(pencil.n, max(2 * count + 1, SLOW_MODES.basis)))
        inverse, vectors = (np.asarray(part, complex) for part in every)
    except ArpackNoConvergence as some:
        inverse, vectors = some.eigenvalues, some.eigenvectors
    modes = [pencil.mode(near.shift + 1 / mu, vectors[:, k], near.shift.real) for k, mu in enumerate(inverse)
             if (near.shift + 1 / mu).imag >= 0]
    slowest = sorted((mode for mode, _ in modes), key=lambda mode: (abs(mode.value), mode.value.real))
    slow = min((abs(mode.value) for mode in slowest if mode.value), default=1 / span)
    fastest = max(pencil.fastest(), slow)
    # the modes that are not among the known ones, each once
    candidates = _growing(pencil, slow, fastest)
    distinct: list[Mode] = []
    for mode in candidates:
        if all(abs(mode.value - known_mode.value) > SLOW_MODES.next * abs(mode.value) for known_mode in (*slowest,
                                                                                                         *distinct)):
            distinct.append(mode)
    growing = sorted(distinct, key=lambda mode: -mode.value.real)
    slow_unstable = sum(mode.value.real > accuracy for mode, accuracy in modes)
    return SlowModes(slowest, growing, (slow, fastest), slow_unstable + len(growing), pencil.n)


def _growing(pencil: _Pencil, slow: float, fastest: float) -> Iterator[Mode]:
    """Modes with Re s > 0 beyond their rounding."""
    steps = math.ceil(math.log(fastest / slow, SLOW_MODES.ratio)) if fastest > slow else 0
    for k in range(steps + 1):
        shifted = pencil.shifted(min(slow * SLOW_MODES.ratio**k, fastest))
        a = shifted.shift.real

        def cayley(x: Any, shifted: _Shifted = shifted, a: float = a) -> Any:
            return x + 2 * a * shifted(x)

        thetas, vectors = _ritz(cayley, pencil.n)
        for theta, vector in zip(thetas.tolist(), vectors.T, strict=True):
            mode, accuracy = pencil.mode(a * (theta + 1) / (theta - 1), vector, SLOW_MODES.next * a)
            if mode.value.real > accuracy:
                yield mode


class _Pencil:
    """J - s M near a point, its columns in the nominal sizes of states and algebraic unknowns, the rows of the loops with
    entries up to one."""

    def __init__(self, linearisation: Linearisation, point: Point):
        from scipy.sparse import csc_array, diags_array

        assembly = linearisation.assembly
        self.states, self.n = tuple(assembly.state_names), len(assembly.x_nominal)
        sizes = np.concatenate([assembly.x_nominal, assembly.z_nominal])
        whole = linearisation.sparse(point) @ diags_array(sizes)
        largest = np.maximum(np.ravel(abs(whole).max(axis=1).toarray()), 1e-300)
        self.jacobian = csc_array(diags_array(1 / np.concatenate([assembly.x_nominal, largest[self.n:]])) @ whole)
        self.sizes = abs(self.jacobian)
        self.mass = csc_array(diags_array(np.repeat([1.0, 0.0], [self.n, len(sizes) - self.n])))

    def shifted(self, shift: complex) -> _Shifted:
        """The solutions with J - shift M; the shift is changed slightly if it is an eigenvalue."""
        for factor in (1.0, 1.0 + SLOW_MODES.near):
            if (factorised := _factors(self.jacobian - shift * factor * self.mass)) is not None:
                return _Shifted(shift * factor, factorised, self.n)
        raise UsageError([Problem("loop-singular", "an algebraic loop is singular here, so that its unknowns are "
                                  "undetermined",
                                  None, "Linearise at another state.")])

    def fastest(self) -> float:
        """The largest |s| in 1/s, about, by the power method."""
        product: Product = self.jacobian.__matmul__
        if self.jacobian.shape[0] > self.n:
            upper, lower = self.jacobian[:self.n], self.jacobian[self.n:, :self.n]
            loops = _factors(self.jacobian[self.n:, self.n:])

            def product(x: Any) -> Any:
                return upper @ np.concatenate([x, -loops.solve(lower @ x)])
        x, sizes = np.cos(np.arange(1.0, self.n + 1)), np.ones(SLOW_MODES.powers)
        for k in range(len(sizes)):
            x = product(x / np.linalg.norm(x))
            sizes[k] = np.linalg.norm(x)
        return float(np.exp(np.log(np.maximum(sizes, 1e-300)[len(sizes) // 2:]).mean()))

    def mode(self, value: complex, right: Complex, least: float) -> tuple[Mode, float]:
        """The mode near a value, and the bound of its error in 1/s; `least` is the least distance of the shift."""
        near = self.shifted(value + max(SLOW_MODES.next * abs(value), least))
        v, left = right.astype(complex), right.conj().astype(complex)
        for _ in range(SLOW_MODES.iterations):
            v, left = (w / np.linalg.norm(w) for w in (near(v), near.transposed(left)))  # the left is l conjugate
        product = left @ v
        value = complex(near.shift + product / (left @ near(v)))
        sides = abs(value - near.shift) * np.abs(near.whole(left, "T")), abs(value - near.shift) * np.abs(near.whole(v))
        left_over = np.linalg.norm(near(v) * (value - near.shift) - v) * abs(value - near.shift)
        accuracy = (STABILITY.coupled * float(sides[0] @ (self.sizes @ sides[1])) + left_over) / max(abs(product), 1e-300)
        if value.imag < 0:
            value, v, left = value.conjugate(), v.conj(), left.conj()
            product = left @ v
        if abs(value) <= accuracy:
            value = 0j
        elif abs(value.imag) <= accuracy:
            value = complex(value.real)
        left = left.conj() / (np.conj(product) or 1.0)
        return Mode(value, np.asarray(v, complex), np.asarray(left, complex), self.states), accuracy


class _Shifted:
    """x -> (A - shift)^-1 x, (n,) real or complex."""

    def __init__(self, shift: complex, factors: Any, n: int):
        self.shift, self.factors, self.n = complex(shift), factors, n

    def whole(self, x: Any, side: str = "N") -> Any:
        """(J - shift M)^-1 (x, 0) with its lower part, or with `side` "T" the transpose."""
        right = np.zeros(self.factors.shape[0], np.result_type(x, complex if self.shift.imag else float))
        right[:self.n] = x
        if not self.shift.imag and np.iscomplexobj(right):
            return self.factors.solve(right.real.copy(), side) + 1j * self.factors.solve(right.imag.copy(), side)
        return self.factors.solve(right, side)

    def __call__(self, x: Any) -> Any:
        return self.whole(x)[:self.n]

    def transposed(self, x: Any) -> Any:
        """(A - shift)^-T x."""
        return self.whole(x, "T")[:self.n]


def _factors(matrix: Any) -> Any:
    """The sparse triangular factors of a matrix; None if it is exactly singular."""
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import splu

    try:
        return splu(csc_array(matrix))
    except RuntimeError:
        return None


def _ritz(product: Product, n: int) -> tuple[Complex, Complex]:
    """Estimates (k,) of the largest eigenvalues of magnitude above 1, imaginary part >= 0, of a product (n,) -> (n,), and of
    their vectors (n, k), by Arnoldi's method without restarts: a separate eigenvalue appears early, however many others have
    the magnitude 1. Estimates are omitted if their residual is more than a small share of the excess of their magnitude over
    1."""
    m = min(SLOW_MODES.basis_growing, n)
    basis, small = np.zeros((m + 1, n)), np.zeros((m + 1, m))
    basis[0] = _first(n) / np.linalg.norm(_first(n))
    for k in range(m):
        x = product(basis[k])
        for _ in range(2):  # once more for what rounding leaves
            along = basis[:k + 1] @ x
            x = x - along @ basis[:k + 1]
            small[:k + 1, k] += along
        small[k + 1, k] = np.linalg.norm(x)
        if not small[k + 1, k] > SLOW_MODES.rounding * np.abs(small[:, k]).max():
            m = k + 1
            break
        basis[k + 1] = x / small[k + 1, k]
    thetas, vectors = np.linalg.eig(small[:m, :m])
    beyond = np.abs(thetas) - 1
    sure = (SLOW_MODES.certain * beyond > small[m, m - 1] * np.abs(vectors[-1])) & (thetas.imag >= 0)
    chosen = sorted(np.flatnonzero(sure).tolist(), key=lambda k: -beyond[k])[:SLOW_MODES.candidates]
    return thetas[chosen].astype(complex), basis[:m].T @ vectors[:, chosen]


def _first(n: int) -> NDArray[np.float64]:
    """The first vector of a search, the same in every run."""
    return np.asarray(np.cos(np.arange(1.0, n + 1)))
