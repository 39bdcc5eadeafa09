"""Events that set speeds without an impulse, where bodies are coupled.

An impact acts through the ports of its component: impulses P there change the states by B P, with B the response of the
rates of the states to forces at the ports (see `impulses`). An event that sets some speeds and leaves the others as they are
is possible only where some P changes those alone. Otherwise the other states would have to change as well, and the specified
values create momentum and energy.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import Problems, listing
from heavebond.equations.events import FlatEvent
from heavebond.equations.flatten import EquationRole, Flat
from heavebond.equations.parameters import FlatParameter
from heavebond.equations.reduce import Reduced, reduce
from heavebond.language.symbols import split, stack

Array = NDArray[np.float64]
SMALL = 1e-9  # share of the largest response that counts as none: rounding


def check_resets(reduced: Reduced, problems: Problems) -> None:
    """Add a problem for each event that sets a speed which no impulse at the ports of its component changes alone."""
    flat = reduced.flat
    candidates = list(_candidates(reduced))
    column = {row: k for k, row in enumerate(dict.fromkeys(row for c in candidates for row in c.balances))}
    response = _response(flat, list(column), reduced) if candidates else None
    if response is None:
        return
    for event, set_states, speeds, balances in candidates:
        other_speeds = [k for k in range(len(reduced.states)) if k not in set_states and _is_speed(flat, reduced, k)]
        moved_too = _moved_too(response[:, [column[row] for row in balances]], speeds, other_speeds)
        if moved_too:
            set_text, too = (listing((reduced.name(reduced.states[k]) for k in group), 4) for group in
                             (speeds, moved_too))
            problems.add("reset-without-impulse", f"'{event.name}' sets {set_text} and leaves {too}, which a force at its "
                         "ports changes too: momentum and energy would appear from nothing", event.place,
                         hint="Name the force that acts during the impact together with the new speed: `impulse: F_i` with "
                         "`then: {v: -e * v}`, where `F_i: {unit: N, held: 0}` is part of the force at the ports.")


class _Candidate(NamedTuple):
    """An event that sets speeds without an impulse: the states (indices) that it sets, those among them that are speeds at
    the ports of its component, and the force balances (rows) of these ports."""

    event: FlatEvent
    set_states: set[int]
    speeds: list[int]
    balances: list[int]


def _candidates(reduced: Reduced) -> Iterator[_Candidate]:
    flat = reduced.flat
    number = {unknown: k for k, (unknown, order) in enumerate(reduced.states) if order == 0}
    for event in flat.events:
        part = event.name.rpartition(".")[0]
        if event.impulse is not None or event.by_clock or part not in flat.expanded.leaves:
            continue
        set_states = {number[r.unknown] for r in event.resets if r.unknown in number}
        ports = list(_ports(flat, part)) if set_states else []
        flows = [reduced.express(flat.levels[0][flow]) for _, flow in ports]
        speeds = [k for k in sorted(set_states) if any(ca.which_depends(f, reduced.x[k], 1, False)[0] for f in flows)]
        if speeds:
            yield _Candidate(event, set_states, speeds, [row for row, _ in ports])


def _ports(flat: Flat, part: str) -> Iterator[tuple[int, int]]:
    """The balance of forces (a row) and the flow (an unknown) of each mechanical port of a component."""
    n = len(flat.unknowns)
    balances = {c % n: row for row, (equation, entries) in enumerate(zip(flat.equations, flat.entries, strict=True))
                if equation.role is EquationRole.BALANCE for c, _ in entries}
    for port in flat.expanded.leaves[part].component.ports:
        path = f"{part}.{port}"
        domain = flat.domains.get(path)
        for effort, flow in zip(domain.efforts, domain.flows, strict=True) if domain and domain.positions else ():
            force, speed = flat.names.get(f"{path}.{effort}"), flat.names.get(f"{path}.{flow}")
            if force in balances and speed is not None:
                yield balances[force], speed


def _is_speed(flat: Flat, reduced: Reduced, state: int) -> bool:
    path, _, member = reduced.name(reduced.states[state]).rpartition(".")
    domain = flat.domains.get(path)
    return bool(domain and domain.positions and member in domain.flows)


def _response(flat: Flat, rows: list[int], reduced: Reduced) -> Array | None:
    """The rates of the states (n_x, m) by forces in balances, in nominal sizes, at a point without symmetry; None if the
    equations are singular there."""
    forces = ca.SX.sym("force", len(rows))
    residuals = list(flat.residuals)
    for row, force in zip(rows, split(forces), strict=True):
        residuals[row] = residuals[row] + force
    place, unit = flat.equations[rows[0]].place, flat.unknowns[0].unit
    more = tuple(FlatParameter(f"force_{k}", 0.0, unit, place) for k in range(len(rows)))
    pushed = reduce(replace(flat, residual_column=stack(residuals), p=stack([flat.p, forces]),
                            parameters=flat.parameters + more))
    if pushed.states != reduced.states:
        return None
    x, z = pushed.x, pushed.z
    wanted = [ca.densify(ca.jacobian(a, b)) for a in (pushed.ode, pushed.alg) for b in (forces, z)]
    symbols = ca.symvar(ca.veccat(*wanted))
    values = {s: flat.parameters[k].value for s, k in flat.places.items()}
    draw = np.random.default_rng(0)
    for unknowns, symbol in ((pushed.states, x), (pushed.algebraic, z)):
        for (unknown, _), s in zip(unknowns, split(symbol), strict=True):
            values[s.element_hash()] = flat.unknowns[unknown].nominal * draw.uniform(0.3, 0.7)
    point = [values.get(s.element_hash(), 0.0) for s in symbols]
    by_force, by_z, residual, matrix = (np.array(a) for a in ca.Function("b", [stack(symbols)], wanted)(point))
    try:
        response = by_force - by_z @ np.linalg.solve(matrix, residual) if z.numel() else by_force
    except np.linalg.LinAlgError:
        return None
    sizes = np.array([flat.unknowns[unknown].nominal for unknown, _ in pushed.states])
    return response / sizes[:, None] if np.isfinite(response).all() else None


def _moved_too(response: Array, speeds: list[int], other_speeds: list[int]) -> list[int]:
    """The further states changed by every impulse that changes `speeds`; none if some impulse changes `speeds` alone."""
    size = np.abs(response).max(axis=0, initial=0.0)
    scaled = response[:, size > 0] / size[size > 0]
    if not scaled.size or not np.abs(scaled[speeds]).max() > SMALL:
        return []
    _, values, right = np.linalg.svd(scaled[other_speeds]) if other_speeds else (0, np.zeros(0), np.eye(scaled.shape[1]))
    rank = int((values > SMALL).sum())
    alone = right[rank:].T
    if alone.shape[1] and np.linalg.matrix_rank(scaled[speeds] @ alone, SMALL) == len(speeds):
        return []
    return [k for k in other_speeds if np.abs(scaled[k]).max() > SMALL]
