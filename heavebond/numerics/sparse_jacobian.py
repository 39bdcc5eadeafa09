"""Jacobians of large systems, their fullest rows differentiated backwards and the others forwards.

CasADi finds a Jacobian by sweeps in one direction. Forwards, a sweep serves columns that share no row, so that there are at
least as many as the fullest row has entries; backwards, a sweep serves rows that share no column. A thousand actuators on
one supply have a full row (the balance of the supply) and a full column (its pressure), with which either direction needs as
many sweeps as there are states. Both together need a few (T. F. Coleman, A. Verma, SIAM J. Sci. Comput. 19 (1998) 1210-1233,
doi:10.1137/S1064827595295349).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

INPUTS = ("t", "x", "z", "p", "u")  # of the equations of an integrator
OUTPUTS = ("jac_ode_x", "jac_alg_x", "jac_ode_z", "jac_alg_z")


def jacobian(residuals: ca.SX, unknowns: ca.SX) -> ca.SX:
    """The Jacobian (m, n) of residuals (m,) by symbols (n,)."""
    backwards = rows_backwards(ca.jacobian_sparsity(residuals, unknowns))
    if not len(backwards):
        return ca.jacobian(residuals, unknowns)
    forwards = np.setdiff1d(np.arange(residuals.numel()), backwards)
    parts = [ca.jacobian(residuals[rows.tolist()], unknowns, {direction: False})
             for rows, direction in ((backwards, "allow_forward"), (forwards, "allow_reverse"))]
    return ca.vertcat(*parts)[np.argsort(np.concatenate([backwards, forwards])).tolist(), :]


def rows_backwards(pattern: ca.Sparsity) -> NDArray[np.int_]:
    """The rows that are differentiated backwards, a sweep each; none if sweeps in one direction are not more.

    The k fullest rows are left to backward sweeps; the others need at least as many forward sweeps as the fullest of them
    has entries. The sum of both is the least."""
    rows, columns = (np.array(indices, dtype=int) for indices in pattern.get_triplet())
    entries = np.bincount(rows, minlength=pattern.size1())
    order = np.argsort(-entries, kind="stable")
    sweeps = np.arange(len(order) + 1) + np.append(entries[order], 0)
    fewest = int(np.argmin(sweeps))
    in_one_direction = min(int(sweeps[0]), int(np.bincount(columns, minlength=1).max()))
    return np.sort(order[:fewest]) if sweeps[fewest] < in_one_direction else order[:0]


def given_jacobian(dae: Mapping[str, ca.SX]) -> dict[str, Any]:
    """The option of CasADi's integrators with the Jacobian of a system with x, z, ode and alg (t, p, u); empty if sweeps in
    one direction are not more."""
    n_x, unknowns, rates = dae["x"].numel(), ca.vertcat(dae["x"], dae["z"]), ca.vertcat(dae["ode"], dae["alg"])
    if not len(rows_backwards(ca.jacobian_sparsity(rates, unknowns))):
        return {}
    whole = jacobian(rates, unknowns)
    blocks = [whole[:n_x, :n_x], whole[n_x:, :n_x], whole[:n_x, n_x:], whole[n_x:, n_x:]]
    arguments = [dae.get(name, ca.SX.sym("t") if name == "t" else ca.SX(0, 1)) for name in INPUTS]
    return {"cache": {"jacF": ca.Function("jacF", arguments, blocks, INPUTS, OUTPUTS)}}
