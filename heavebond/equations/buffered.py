"""CasADi functions called on NumPy buffers, without copies of the arguments."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from threading import Lock
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.core.cancellation import check

Array = NDArray[np.float64]
KEPT = 256  # numbers of an output up to which its array is bound once: to copy so many takes less time than to bind another


class Buffered:
    """A function of CasADi that reads and writes arrays; inputs that are not given are zero. Outputs are dense, or with
    `sparse` those that have zeros by structure are of `scipy.sparse.csc_array`.

    In an ordinary call CasADi converts every argument to a matrix, and returns its results element by element: the states at
    6000 points take longer than a tenth of a run. The arrays are shared, so that a lock admits one thread at a time.
    """

    def __init__(self, function: ca.Function, outputs: Sequence[str] | None = None, *, sparse: bool = False):
        """`outputs` are those that are wanted, by default all."""
        self._lock = Lock()
        self._buffer, self._run = function.buffer()
        self._given = {name: np.zeros(function.nnz_in(name)) for name in function.name_in()}
        self._outputs = [_Output(function, name, sparse) for name in outputs or function.name_out()]
        for k, values in enumerate(self._given.values()):
            _bind(self._buffer.set_arg, k, values)
        for output in self._outputs:
            if output.size <= KEPT:
                _bind(self._buffer.set_res, output.number, output.values)

    def __call__(self, *given: Any, **named: Any) -> dict[str, Any]:
        """Each output (m, n), given the inputs in their order or by name; RuntimeError if it fails."""
        with self._lock:
            for k, (name, values) in enumerate(self._given.items()):
                value = given[k] if k < len(given) else named.get(name, 0.0)
                plain = type(value) is float or (type(value) is np.ndarray and value.ndim == 1)
                values[:] = value if plain else np.asarray(value, float).ravel(order="F")
            for output in self._outputs:
                if output.size > KEPT:
                    output.values = np.empty(output.size)
                    _bind(self._buffer.set_res, output.number, output.values)
            try:
                self._run()
            finally:
                check()  # a signal that came meanwhile: CasADi may have dropped it, or made a failure of it
            if self._buffer.ret():  # compiled code cannot raise what CasADi's own does
                raise RuntimeError("the function could not be evaluated")
            return {output.name: output.matrix() for output in self._outputs}

    def size1_in(self, name: str) -> int:
        """The number of elements of an input."""
        return len(self._given[name])

    def stats(self) -> dict[str, Any]:
        """Counts of steps and evaluations of the last call, if it is an integrator."""
        return dict(self._buffer.stats())


class _Output:
    """An output of a function, with the positions of its nonzeros in the dense matrix."""

    def __init__(self, function: ca.Function, name: str, sparse: bool):
        self.name, self.number, pattern = name, function.index_out(name), function.sparsity_out(name)
        self.shape, self.size = pattern.shape, pattern.nnz()
        self._places = None if pattern.is_dense() else tuple(np.array(k, dtype=int) for k in pattern.get_triplet())
        self._columns = np.array(pattern.colind(), dtype=int) if sparse else None
        self.values = np.empty(self.size if self.size <= KEPT else 0)

    def matrix(self) -> Any:
        """The values of the last call; a new matrix."""
        if self.size <= KEPT:
            values = self.values.copy()
        else:
            values, self.values = self.values, np.empty(0)
        if self._places is None:
            return values.reshape(self.shape, order="F")
        if self._columns is not None:
            from scipy.sparse import csc_array
            return csc_array((values, self._places[0], self._columns), shape=self.shape)
        matrix = np.zeros(self.shape)
        matrix[self._places] = values
        return matrix


def _bind(bind: Callable[..., None], number: int, values: Array) -> None:
    if values.size:
        bind(number, memoryview(values))  # type: ignore[arg-type]  # arrays are buffers; typing knows it from Python 3.12 on
