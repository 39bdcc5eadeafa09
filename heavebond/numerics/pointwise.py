"""A function of CasADi at many points of a run."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from heavebond.equations.buffered import Array, Buffered
from heavebond.numerics.dae import Assembly

AT_ONCE = 50  # points a call: a map over thousands takes longer to make than to evaluate


def evaluated(assembly: Assembly, function: ca.Function, columns: Sequence[Array]) -> Array:
    """The only output (m, 1) of a function of an assembly as (m, N), from the values of its inputs, each (k, N)."""
    n = columns[0].shape[1]
    size = min(n, AT_ONCE)
    many = assembly.once((function.__hash__(), size), lambda: Buffered(function.map(size)))
    found = np.empty((function.numel_out(0), n))
    for begin in range(0, n, size):
        at = np.minimum(np.arange(begin, begin + size), n - 1)  # the last call is filled up with the last point
        values, = many(*(c[:, at] for c in columns)).values()
        found[:, begin:begin + size] = values.reshape((-1, size), order="F")[:, :n - begin]
    return found
