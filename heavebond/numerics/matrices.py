"""Linear algebra of the start: Jacobians, dense for small machines and sparse for large ones, of any shape and rank."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
# a dense array, or a `scipy.sparse.csc_array` from `MATRICES.sparse_from` unknowns on
Matrix = Any


@dataclass(frozen=True)
class MatrixConstants:
    """The constants of the linear algebra of the start.

    rank: singular value, over the largest, below which no equation determines a direction. Origin: nominal values may
        be off by some powers of ten without a false alarm. Doubled: nothing but for values within rounding of it.
    sparse_from: number of unknowns from which sparse elimination is used where the rank is beyond doubt. Origin:
        decomposing a thousand rows takes seconds, eliminating them milliseconds. Doubled: larger starts take longer,
        with the same result.
    certain_rank: smallest singular value, over the largest, from which on the rank is beyond doubt. Origin: ten times
        `rank`; a chain of n masses at rest has about 1/n**2. Doubled: more systems are decomposed.
    converged_change: relative change of that value at which inverse iteration ends. Origin: a tenth of it is enough for
        the comparison. Doubled: an iteration less.
    max_iterations: inverse iterations. Origin: a bound; each gains a power of the ratio of the last two singular
        values. Doubled: nothing measurable.
    max_dense: rows or columns up to which a matrix whose rank is in doubt is decomposed. Origin: a second. Doubled:
        some eight seconds, exact ranks of larger matrices.
    damping: damping of larger ones, over the largest singular value. Origin: square root of rounding. Doubled: slower
        convergence.
    max_repeats: repetitions of the damped solution. Origin: a bound; it ends where the residual falls no more. Doubled:
        nothing where it converges.
    max_directions: undetermined directions that are sought in a large matrix. Origin: more are not reported. Doubled:
        time.
    direction_iterations: iterations that find them. Origin: each gains a power of their ratio to the other singular
        values. Doubled: time, sharper directions.
    """

    rank: float = 1e-11
    sparse_from: int = 200
    certain_rank: float = 1e-10
    converged_change: float = 0.1
    max_iterations: int = 20
    max_dense: int = 1000
    damping: float = 1e-8
    max_repeats: int = 30
    max_directions: int = 12
    direction_iterations: int = 6


MATRICES = MatrixConstants()


def finite(matrix: Matrix) -> bool:
    """Whether every entry is a finite number."""
    return bool(np.all(np.isfinite(matrix if isinstance(matrix, np.ndarray) else matrix.data)))


def scaled(matrix: Matrix, rows: Array | None = None, columns: Array | None = None) -> Matrix:
    """diag(rows) matrix diag(columns), with rows (m,) and columns (n,)."""
    if isinstance(matrix, np.ndarray):
        product = matrix if columns is None else matrix * columns
        return product if rows is None else product * rows[:, None]
    product = matrix.copy()
    if columns is not None:
        product.data *= np.repeat(columns, np.diff(product.indptr))
    if rows is not None:
        product.data *= rows[product.indices]
    return product


def added(matrix: Matrix, rows: NDArray[np.int_] | list[int], columns: NDArray[np.int_], values: Array) -> Matrix:
    """The matrix with values (k,) added at k different places."""
    if isinstance(matrix, np.ndarray):
        matrix[rows, columns] += values
        return matrix
    from scipy.sparse import csc_array
    return csc_array(matrix + csc_array((values, (np.asarray(rows), columns)), shape=matrix.shape))


def largest_of_rows(matrix: Matrix) -> Array:
    """The largest absolute value of each row, (m,)."""
    if isinstance(matrix, np.ndarray):
        return np.asarray(np.abs(matrix).max(axis=1, initial=0.0))
    largest = np.zeros(matrix.shape[0])
    np.maximum.at(largest, matrix.indices, np.abs(matrix.data))
    return largest


def dense(matrix: Matrix) -> Array:
    """The matrix as an array."""
    return matrix if isinstance(matrix, np.ndarray) else np.asarray(matrix.toarray())


def factors(matrix: Matrix) -> Any:
    """The sparse triangular factors of a large square matrix (n, n) of full rank, with their `solve`; None for a small one,
    and where the rank is in doubt.

    The smallest singular value is estimated by inverse iteration with A A^T, which approaches it from above; the largest is
    bounded by the norms: |A|_2^2 <= |A|_1 |A|_inf (G. H. Golub, C. F. Van Loan, Matrix Computations, 4th ed., section 2.3).
    """
    n = matrix.shape[0]
    if n < MATRICES.sparse_from or matrix.shape != (n, n):
        return None
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import splu

    columns = csc_array(matrix)
    columns.eliminate_zeros()
    try:
        factorised: Any = splu(columns)
    except RuntimeError:  # exactly singular
        return None
    direction, smallest = np.cos(np.arange(1.0, n + 1)), np.inf
    for _ in range(MATRICES.max_iterations):
        direction = factorised.solve(factorised.solve(direction / np.linalg.norm(direction), "T"))
        before, smallest = smallest, 1 / np.sqrt(float(np.linalg.norm(direction)))
        if not smallest < (1 - MATRICES.converged_change) * before:
            break
    return factorised if smallest > MATRICES.certain_rank * _bound(columns) else None


def _bound(columns: Any) -> float:
    """An upper bound of the largest singular value."""
    sizes = abs(columns)
    return float(np.sqrt(sizes.sum(axis=0).max(initial=0.0) * sizes.sum(axis=1).max(initial=0.0)))


def least_change(matrix: Matrix, right: Array) -> Array:
    """The x (n,) or (n, k) of least norm that solves matrix (m, n) x = right in the sense of least squares."""
    if (factorised := factors(matrix)) is not None:
        return np.asarray(factorised.solve(right))
    if max(matrix.shape) <= MATRICES.max_dense:
        return np.asarray(np.linalg.lstsq(dense(matrix), right, rcond=MATRICES.rank)[0])
    return _Damped(matrix).least_change(right)


def solved(matrix: Matrix, right: NDArray[Any]) -> NDArray[Any]:
    """The x (n, k) with matrix (n, n) x = right, real or complex."""
    if len(right) < MATRICES.sparse_from:
        return np.asarray(np.linalg.solve(dense(matrix), right))
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import splu

    factorised: Any = splu(csc_array(matrix))
    if np.iscomplexobj(right):
        return np.asarray(factorised.solve(right.real.copy()) + 1j * factorised.solve(right.imag.copy()))
    return np.asarray(factorised.solve(right))


def null_space(matrix: Matrix, share: float) -> Array:
    """Orthonormal directions (n, k) that matrix (m, n) shortens to less than a share of its largest singular value; of a
    large one whose rank is in doubt at most `MATRICES.max_directions`, the most shortened."""
    if factors(matrix) is not None:
        return np.zeros((matrix.shape[1], 0))
    if max(matrix.shape) <= MATRICES.max_dense:
        _, values, right = np.linalg.svd(dense(matrix), full_matrices=True)
        rank = int((values > share * max(values.max(initial=0.0), 1e-300)).sum())
        return np.asarray(right[rank:].T)
    return _Damped(matrix).shortened(share)


class _Damped:
    """The equations (A^T A + d^2) x = A^T b of a large sparse matrix A (m, n), as the system [[d, A], [A^T, -d]] [y, x] =
    [b, 0]. Its condition is the condition of A with the singular values below d raised to d.

    Repeated with the residual of b, its solution approaches the solution of least norm: a singular value s counts as 1 -
    (d^2 / (s^2 + d^2))^k after k repetitions (iterated Tikhonov regularisation; H. W. Engl, M. Hanke, A. Neubauer,
    Regularization of Inverse Problems, Kluwer 1996, section 5.1).
    """

    def __init__(self, matrix: Matrix):
        from scipy.sparse import block_array, csc_array, eye_array
        from scipy.sparse.linalg import splu

        self.matrix = csc_array(matrix)
        m, n = self.matrix.shape
        self.bound = _bound(self.matrix) or 1.0
        self.damping = MATRICES.damping * self.bound
        whole = block_array([[self.damping * eye_array(m), self.matrix], [self.matrix.T, -self.damping * eye_array(n)]])
        self.factors = splu(csc_array(whole))

    def least_change(self, right: Array) -> Array:
        m, n = self.matrix.shape
        factorised, residual, size = np.zeros((n, *right.shape[1:])), right, float(np.linalg.norm(right))
        for _ in range(MATRICES.max_repeats):
            trial = factorised + self.factors.solve(np.concatenate([residual, np.zeros_like(factorised)]))[m:]
            residual = right - self.matrix @ trial
            before, size = size, float(np.linalg.norm(residual))
            if not size < before:
                break
            factorised = trial
            if size > (1 - MATRICES.converged_change) * before:
                break
        return np.asarray(factorised)

    def shortened(self, share: float) -> Array:
        """The directions that A shortens below a share of its largest singular value, by inverse subspace iteration."""
        m, n = self.matrix.shape
        basis = np.cos(np.outer(np.arange(1.0, n + 1), np.arange(1.0, 1 + min(MATRICES.max_directions, n))))
        for _ in range(MATRICES.direction_iterations):
            basis = self.factors.solve(np.concatenate([np.zeros((m, basis.shape[1])), -basis]))[m:]
            basis, _ = np.linalg.qr(basis)
        _, values, turned = np.linalg.svd(self.matrix @ basis, full_matrices=False)
        return np.asarray(basis @ turned.T[:, values <= share * self.bound])
