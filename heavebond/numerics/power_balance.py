"""Power balance of components along a run: the power through the ports against stored, dissipated and unbalanced power.

The audit of a run (`audit`) integrates powers together with the states, which costs a second run. The same balance holds
at every instant, with d(stores)/dt along the equations of motion. It is checked here at some points of an existing run,
without errors of quadrature between output points. A violation means that a law creates or loses energy.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from heavebond.equations.flatten import Energetics
from heavebond.language.symbols import stack
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.pointwise import evaluated

# A share of the largest power in the machine that counts as missing. Laws close to rounding, some 1e-12; algebraic unknowns
# are solved to 1e-12 of their size, which differences of large forces magnify.
TOLERANCE = 1e-6
# A share of the apparent power of a machine, its efforts times the nominal sizes of their flows, that is rounding: at rest
# all powers are products of an effort and a flow of 1e-20 or less.
RESTING = 1e-20
# At a kink a derivative is that of one side: a single point says nothing about a law.
LEAST_POINTS = 3


@dataclass(frozen=True)
class Imbalance:
    """A component whose power does not balance: the power in W that is missing (below zero: created) where it is
    largest over the points, the time of the first, how much may be missing, and whether its dissipation is negative."""

    owner: str
    missing: float
    time: float
    limit: float
    made: bool


def balance(assembly: Assembly, columns: Sequence[Array], values: Array, more: Sequence[ca.SX] = ()
            ) -> tuple[list[Imbalance], Array]:
    """The components whose power does not balance at points (t, x, z, p, u, rate), a column each, of a run with the values
    (n_unknowns, N) of all unknowns there; sources and controlled laws are exempt. And the values (k, N) of `more`
    expressions in raw symbols, which are evaluated with the energies."""
    flat = assembly.flat
    with_ports = {b.owner for b in flat.bonds.values()}
    parts = [e for e in flat.energetics if not e.kind and (e.owner in with_ports or not e.energy.is_zero())]
    if not parts and not more:
        return [], np.zeros((0, values.shape[1]))
    (dissipated, unbalanced, held, rate), more_values = _energies(assembly, parts, columns, more)
    rows = list(values)
    ports = {port: bond.power(rows) for port, bond in flat.bonds.items()}
    through = {e.owner: np.zeros(values.shape[1]) for e in flat.energetics}
    for port, bond in flat.bonds.items():
        through[bond.owner] = through[bond.owner] + ports[port]
    duration = float(np.ptp(columns[0]))
    # a pendulum alone has no port and keeps its energy: only what it holds tells what is little
    sizes = [_size(np.sum(np.abs(list(ports.values())), axis=0)) if ports else 0.0, _size(rate), _size(dissipated),
             _size(held) / duration if duration else 0.0]
    imbalances = _missing(parts, through, (rate, dissipated, unbalanced), TOLERANCE * max(sizes), columns[0][0])
    if imbalances:  # in a machine that turns energy it holds into other energy it holds, these powers are the size of things
        turned = _turnover(assembly, parts, columns)
        # the largest sum of the efforts at all ports times the nominal sizes of their flows, W
        pairs = [pair for bond in flat.bonds.values() for pair in zip(bond.efforts, bond.flows, strict=False)]
        apparent = sum((np.abs(values[e])*flat.unknowns[f].nominal for e, f in pairs), np.zeros(values.shape[1]))
        limit = max(TOLERANCE * max(*sizes, turned), RESTING * _size(apparent))
        imbalances = _missing(parts, through, (rate, dissipated, unbalanced), limit, columns[0][0])
    return imbalances, more_values


def _missing(parts: Sequence[Energetics], through: Mapping[str, Array], powers: tuple[Array, Array, Array], limit: float,
             time: Array) -> list[Imbalance]:
    """The parts whose missing power exceeds the limit, from the power into each over its ports and the power that it stores,
    dissipates and leaves unbalanced, each (n_parts, N)."""
    (rate, dissipated, unbalanced), imbalances = powers, []
    for k, part in enumerate(parts):
        missing = through[part.owner] - rate[k] - dissipated[k] - unbalanced[k]
        for lost, negative in ((missing, False), (dissipated[k], True)):
            at = np.flatnonzero(lost < -limit if negative else np.abs(lost) > limit)
            if len(at) >= min(LEAST_POINTS, len(time)):
                worst, first = at[int(np.argmax(np.abs(lost[at])))], float(time[at[0]])
                imbalances.append(Imbalance(part.owner, float(lost[worst]), first, limit, negative))
                break
    return imbalances


def _turnover(assembly: Assembly, parts: Sequence[Energetics], columns: Sequence[Array]) -> float:
    """The largest power that a store exchanges internally: the sum of |dS/dx_i x'_i|, W. For a pendulum dS/dt is 0, this sum
    is not."""
    t, x, _, _, _, rate = assembly.arguments
    gradient = ca.jacobian(assembly.express(stack(e.energy for e in parts)), stack([t, x]))
    terms = ca.sum2(ca.fabs(ca.mtimes(gradient, ca.diag(stack([rate, assembly.ode])))))
    function = ca.Function("turnover", list(assembly.arguments), [ca.densify(terms)])
    return _size(*evaluated(assembly, function, columns))


def _size(values: Array) -> float:
    finite = np.abs(values[np.isfinite(values)])
    return float(finite.max(initial=0.0))


def _energies(assembly: Assembly, parts: Sequence[Energetics], columns: Sequence[Array], more: Sequence[ca.SX]
              ) -> tuple[tuple[Array, ...], Array]:
    """Dissipated and unbalanced power in W, stored energy in J and its rate in W, each (n_parts, N), and the values (k, N)
    of `more`.

    The rate is taken along the motion: dS/dt + dS/dx x' + dS/dz z', with z' = -(dg/dz)^-1 (dg/dt + dg/dx x') of the
    algebraic equations g = 0.
    """
    t, x, z, _, _, rate = assembly.arguments
    m = len(parts)

    def compiled() -> tuple[ca.Function, bool]:
        raw = assembly.express(stack([*(e.dissipated for e in parts), *(e.unbalanced for e in parts),
                                      *(e.energy for e in parts), *more]))
        stored, direction, along = raw[2 * m:3 * m], stack([t, x]), stack([rate, assembly.ode])
        wanted = [raw, ca.jtimes(stored, direction, along)]
        by_z = ca.jacobian(stored, z) if z.numel() else ca.SX(m, 0)
        if by_z.nnz():
            wanted += [ca.vec(ca.densify(by_z)), ca.vec(ca.densify(ca.jacobian(assembly.alg, z))),
                       ca.jtimes(assembly.alg, direction, along)]
        return ca.Function("energies", list(assembly.arguments), [ca.densify(stack(wanted))]), bool(by_z.nnz())

    function, loops = assembly.once(("energies", *(e.element_hash() for e in more)), compiled)
    values, = evaluated(assembly, function, columns)
    size = 3 * m + len(more)
    begin, n_z = size + m, z.numel()
    rates = values[size:begin]
    if loops:
        slopes, jacobian, residual_rates = np.split(values[begin:], [m * n_z, m * n_z + n_z * n_z])
        rates = rates + _by_loops(slopes.reshape(n_z, m, -1), jacobian.reshape(n_z, n_z, -1), residual_rates)
    return (values[:m], values[m:2 * m], values[2 * m:3 * m], rates), values[3 * m:size]


def _by_loops(slopes: Array, jacobian: Array, residual_rates: Array) -> Array:
    """dS/dz z' at each point, (m, N); NaN where the algebraic equations do not decide z'."""
    rates = np.full((slopes.shape[1], slopes.shape[2]), np.nan)
    for k in range(rates.shape[1]):
        try:
            rates[:, k] = slopes[..., k].T @ np.linalg.solve(jacobian[..., k].T, -residual_rates[:, k])
        except np.linalg.LinAlgError:
            continue
    return rates
