"""Numerical rank deficiency: the dependent equations, the undetermined unknowns, and the value that causes it.

The structure shows which unknown occurs in which equation. Whether the equations determine their unknowns depends on
values too: a mass of zero, a shut valve, a lever at its dead centre, a loop with a gain of one make the Jacobian singular.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import cast

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.core.threads import single_threaded
from heavebond.equations.flatten import Flat
from heavebond.equations.matching import block_lower_triangular, components_of, maximum_matching
from heavebond.language.external_functions import jacobian
from heavebond.language.symbols import split, stack, uniform

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Row = tuple[int, int]  # (equation, how often differentiated)
Column = tuple[int, int]  # (unknown, order of its derivative)
# a share of the largest entry of its row below which an entry counts as zero
NEGLIGIBLE = 1e-13
# singular values below this share of the largest are zero
LOST = 1e-11
# a value is rounding where it is so small, alone and beside what it is computed with
SMALL = 1e-9
# members of a direction below this share of the largest do not take part
SHARE = 1e-6
# what a change of a value does to the scaled matrix is rounding below this
ROUNDING = 1e-14
# a value that is changed to see whether it is to blame is changed by this share of its usual size
CHANGED = 0.137
# from so many equations on only the blocks that are singular are looked at together
LARGE = 1500


@dataclass(frozen=True)
class RankLoss:
    """Dependent equations `rows`, undetermined unknowns `columns`, and the cause.

    `parameters` and `variables` (with their values in SI) are those of which each, with another value, would restore the
    rank; if some of these are zero, only they are listed. If both are empty, the cause is the form of the equations, for all
    values.
    """

    rows: tuple[Row, ...]
    columns: tuple[Column, ...]
    parameters: tuple[str, ...]
    variables: tuple[tuple[str, float], ...]
    zero: bool


@dataclass(frozen=True)
class Simultaneous:
    """All equations with their derivatives, and the unknowns (with their derivatives) that they must determine for known
    states: residuals (n,) in raw symbols, unknowns (n,)."""

    flat: Flat
    rows: tuple[Row, ...]
    columns: tuple[Column, ...]
    residuals: ca.SX
    unknowns: ca.SX

    @cached_property
    def jacobian(self) -> ca.SX:
        """d(residuals)/d(unknowns)."""
        return jacobian(self.residuals, self.unknowns)

    @cached_property
    def entries(self) -> tuple[list[int], list[int]]:
        """Row and column of each entry of the Jacobian."""
        return self.jacobian.sparsity().get_triplet()

    @cached_property
    def symbols(self) -> list[ca.SX]:
        """The symbols in the entries of the Jacobian."""
        return ca.symvar(self.jacobian)

    @cached_property
    def values(self) -> ca.Function:
        """The entries of the Jacobian, given `symbols`."""
        return ca.Function("entries", [stack(self.symbols)], [stack(self.nonzeros)])

    @cached_property
    def nonzeros(self) -> list[ca.SX]:
        """The entries of the Jacobian."""
        return cast(list[ca.SX], self.jacobian.nonzeros())  # CasADi's stubs call them SXElem; they are scalar SX

    @cached_property
    def sizes(self) -> Array:
        """The usual size of each unknown."""
        return np.array([self.flat.unknowns[j].nominal for j, _ in self.columns])

    @cached_property
    def names(self) -> dict[int, tuple[str, float]]:
        """Name and usual size of every symbol by its hash: parameters, unknowns without their rates."""
        flat = self.flat
        usual = {u.unit.dimension: u.nominal for u in flat.unknowns}
        known = {s.element_hash(): (q.name, abs(q.value) or usual.get(q.unit.dimension, 1.0))
                 for s, q in zip(split(flat.p), flat.parameters, strict=True)}
        known |= {s.element_hash(): (u.name, u.nominal) for s, u in zip(flat.levels[0], flat.unknowns, strict=True)}
        return known


def losses(system: Simultaneous, point: Mapping[int, float], tolerance: float = LOST) -> list[RankLoss]:
    """The parts of a system that lose their rank at a point (values by the hashes of the symbols; missing and infinite
    values are replaced by small random ones). Empty if the rank is full: if the singular values of every block are above
    `tolerance` times the largest."""
    values = [point.get(s.element_hash(), np.nan) for s in system.symbols]
    at = np.array([value if np.isfinite(value) else 0.1 + uniform(7, k) for k, value in enumerate(values)])
    return _Matrix(system, at, tolerance).losses() if system.rows else []


@dataclass(frozen=True)
class _NullVectors:
    """Directions u with u'M = 0, of the rows (k, n), and v with Mv = 0, of the columns (k, n)."""

    left: Array
    right: Array


class _Matrix:
    """The Jacobian of a system at one point, scaled by rows and by the usual sizes of the unknowns."""

    def __init__(self, system: Simultaneous, at: Array, tolerance: float):
        self.system, self.at, self.tolerance = system, at, tolerance
        self.row, self.column = (np.array(k, dtype=int) for k in system.entries)
        # the usual sizes of the unknowns. If no domain declares the unit (a compressibility), the size is the value; if the
        # value is zero (an absent leakage) or rounding (a lever arm in the middle of its stroke), it follows from the other
        # terms of the equations
        flat, sizes = self.system.flat, self.system.sizes.copy()
        known = {m.unit.dimension for d in flat.expanded.model.library.domains.values() for m in d.members.values()}
        values = {s.element_hash(): abs(v) for s, v in zip(self.system.symbols, self.at, strict=True)}
        for k, (j, order) in enumerate(self.system.columns):
            if flat.unknowns[j].unit.dimension not in known:
                value = values.get(flat.levels[0][j].element_hash() if order == 0 else 0, 0.0)
                # the least size at which the unknown has the same weight as the other terms in one of its equations
                weight = np.abs(np.array(self.system.values(self.at)).ravel()) * sizes[self.column]
                candidates = []
                for entry in np.flatnonzero((self.column == k) & (weight > 0)):
                    other_weights = weight[(self.row == self.row[entry]) & (self.column != k)]
                    candidates.append(float(other_weights.max(initial=0.0) / weight[entry] * sizes[k]))
                beside = min((size for size in candidates if np.isfinite(size) and size > 0), default=0.0)
                sizes[k] = (beside if value < SMALL * beside else value) or sizes[k]
        self.sizes = sizes
        raw = np.array(system.values(at)).ravel()
        raw = np.where(np.isfinite(raw), raw, 1.0) * self.sizes[self.column]
        largest = np.zeros(len(system.rows))
        np.maximum.at(largest, self.row, np.abs(raw))
        self.largest = np.where(largest > 0, largest, 1.0)
        self.entries = raw / self.largest[self.row]
        self.entries[np.abs(self.entries) < NEGLIGIBLE] = 0.0

    def losses(self) -> list[RankLoss]:
        """One loss for each set of dependent equations and the unknowns that occur in them."""
        null = self._null()
        return [] if null is None else [self._loss(null, *pair) for pair in self._pairs(null)]

    @single_threaded
    def _null(self) -> _NullVectors | None:
        pattern: list[list[int]] = [[] for _ in self.system.rows]
        for row, column, value in zip(self.row, self.column, self.entries, strict=True):
            if value:
                pattern[row].append(int(column))
        matching = maximum_matching(pattern, len(self.system.columns))
        complete = -1 not in matching and len(pattern) == len(self.system.columns)
        if complete:
            singular = []
            for block in block_lower_triangular(pattern, matching):
                values = np.linalg.svd(self._dense(block, [matching[row] for row in block]), compute_uv=False)
                if values[-1] <= self.tolerance * max(values[0], 1.0):
                    singular.append(block)
            if not singular:
                return None
        rows, columns = list(range(len(pattern))), list(range(len(self.system.columns)))
        if complete and len(rows) > LARGE:  # what lies between the blocks is left aside
            rows = sorted(row for block in singular for row in block)
            columns = sorted(matching[row] for row in rows)
        left, values, right = np.linalg.svd(self._dense(rows, columns))
        rank = int((values > self.tolerance * values[0]).sum())
        u, v = np.zeros((len(rows) - rank, len(self.system.rows))), np.zeros((len(columns) - rank, len(self.system.columns)))
        u[:, list(rows)], v[:, list(columns)] = _sparse(left[:, rank:].T), _sparse(right[rank:])
        return _NullVectors(u, v) if len(u) or len(v) else None

    def _dense(self, rows: Sequence[int], columns: Sequence[int]) -> Array:
        row_at = np.full(len(self.system.rows), -1)
        column_at = np.full(len(self.system.columns), -1)
        row_at[list(rows)], column_at[list(columns)] = np.arange(len(rows)), np.arange(len(columns))
        inside = (row_at[self.row] >= 0) & (column_at[self.column] >= 0)
        matrix = np.zeros((len(rows), len(columns)))
        matrix[row_at[self.row[inside]], column_at[self.column[inside]]] = self.entries[inside]
        return matrix

    def _pairs(self, null: _NullVectors) -> list[tuple[list[int], list[int]]]:
        """The pairs of dependent sets of rows and undetermined columns: columns that occur in the equations, or would occur
        if a value were not zero."""
        stands = np.zeros((len(self.system.rows), len(self.system.columns)), dtype=bool)
        stands[self.row, self.column] = True
        meets: Flags = _both(_taking_part(null.left) @ stands, _taking_part(null.right))
        # which equation (row) belongs to which component or node (column)
        owners = [self.system.flat.equations[i].owner for i, _ in self.system.rows]
        number = {owner: k for k, owner in enumerate(dict.fromkeys(owners))}
        owns = np.zeros((len(owners), len(number)), dtype=bool)
        owns[np.arange(len(owners)), [number[owner] for owner in owners]] = True
        near = _both(_taking_part(null.left) @ owns, _taking_part(null.right) @ stands.T @ owns)
        alone_left, alone_right = np.atleast_1d(~meets.any(axis=1)), np.atleast_1d(~meets.any(axis=0))
        meets = meets | (near & alone_left[:, None] & alone_right)
        return [(list(rows), list(columns))
                for rows, columns in components_of([np.flatnonzero(row).tolist() for row in meets], len(null.right))]

    def _loss(self, null: _NullVectors, rows: list[int], columns: list[int]) -> RankLoss:
        """To first order a change dM of the matrix restores its rank where u'dM v is not zero."""
        system, left, right = self.system, null.left[rows], null.right[columns]
        taking_rows, taking_columns = (np.flatnonzero(_taking_part(d).any(axis=0)) for d in (left, right))
        near = np.isin(self.row, taking_rows) & np.isin(self.column, taking_columns)
        involved = {s.element_hash() for s in ca.symvar(stack([system.nonzeros[k] for k in np.flatnonzero(near)]))}
        # a value that its own column is counted in is not small, unless it is zero
        scaled = {system.flat.unknowns[j].name for k, (j, _) in enumerate(system.columns)
                  if self.sizes[k] != system.sizes[k]}
        repairing: list[tuple[str, bool, float]] = []
        for k, symbol in enumerate(system.symbols):
            if symbol.element_hash() in involved and symbol.element_hash() in system.names and len(rows) and len(columns):
                name, size = system.names[symbol.element_hash()]
                changed = self.at.copy()
                changed[k] += CHANGED * (abs(changed[k]) or size)
                changes = (np.array(system.values(changed)).ravel() * self.sizes[self.column] / self.largest[self.row]
                                     - self.entries)[near]
                changes = np.where(np.isfinite(changes), changes, 0.0)
                restored = left[:, self.row[near]] * changes @ right[:, self.column[near]].T
                if np.abs(restored).max() > max(1e-6 * np.abs(changes).max(), ROUNDING):
                    is_zero = bool(abs(self.at[k]) <= np.sqrt(self.tolerance) * size) \
                        and (self.at[k] == 0 or name not in scaled)
                    if self.tolerance > LOST and self.at[k] == 0:
                        continue  # the rank is not lost yet, so that what is zero already is not what is going there
                    repairing.append((name, is_zero, float(np.abs(restored).max())))
        parameter_names = {q.name for q in system.flat.parameters}
        # a value that the diagram gives is blamed before a zero that a component assumes
        if any(name in parameter_names and not zero and not assumed(system.flat, name) for name, zero, _ in repairing):
            repairing = [r for r in repairing if r[0] not in parameter_names or not r[1] or not assumed(system.flat, r[0])]
        # the usual sizes of variables are known, so that their effects can be compared
        most = max((effect for name, _, effect in repairing if name not in parameter_names), default=0.0)
        repairing = [r for r in repairing if r[0] in parameter_names or r[2] > 1e-3 * most]
        zero = [name for name, is_zero, _ in repairing if is_zero]
        causes = zero or [name for name, _, _ in repairing]
        return RankLoss(tuple(system.rows[r] for r in taking_rows), tuple(system.columns[c] for c in taking_columns),
                        tuple(n for n in causes if n in parameter_names),
                        tuple((n, self._value(n)) for n in causes if n not in parameter_names), bool(zero))

    def _value(self, name: str) -> float:
        number = self.system.flat.levels[0][self.system.flat.names[name]].element_hash()
        return next(float(v) for s, v in zip(self.system.symbols, self.at, strict=True) if s.element_hash() == number)


def assumed(flat: Flat, name: str) -> bool:
    """True if a parameter has the default of its component and is not set in the diagram."""
    owner, _, parameter = name.rpartition(".")
    leaf = flat.expanded.leaves.get(owner)
    return leaf is not None and leaf.parameters[parameter].place.file == leaf.component.place.file


def _both(a: Flags, b: Flags) -> Flags:
    """True for pairs of rows of a and b with a common entry."""
    return np.asarray(a @ b.T, dtype=bool)


def _taking_part(directions: Array) -> Flags:
    return np.asarray(np.abs(directions) > SHARE * np.abs(directions).max(axis=1, keepdims=True, initial=0.0))


def _sparse(basis: Array) -> Array:
    """A sparse basis (k, n) of the same directions, by elimination with pivoting."""
    basis = basis.copy()
    pivots: list[int] = []
    for k in range(len(basis)):
        free = [c for c in range(basis.shape[1]) if c not in pivots]
        pivot = free[int(np.argmax(np.abs(basis[k, free])))]
        pivots.append(pivot)
        basis[k] /= basis[k, pivot]
        for row in range(len(basis)):
            if row != k:
                basis[row] -= basis[row, pivot] * basis[k]
    return basis
