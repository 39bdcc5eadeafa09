"""Stability of a steady start: whether a disturbance of the equilibrium grows, and where the machine settles instead."""

from __future__ import annotations

import casadi as ca
import numpy as np

from heavebond.core.cancellation import check
from heavebond.core.errors import StartError
from heavebond.core.presentation import number, readable
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.initialise import SAME_EQUILIBRIUM, Start, StartSearch
from heavebond.numerics.run_verdict import Finding
from heavebond.numerics.start_equations import StartEquations

MOST_STATES = 400  # eigenvalues of more take seconds
# Share of the largest eigenvalue below which a real part is rounding: a double eigenvalue 0 (a body without a spring) is
# split by the root of the rounding, 1e-8.
ROUNDED = 1e-6
PUSHES = (0.1, 1.0)  # of the fastest growing mode, in usual sizes of its states


def unstable_start(assembly: Assembly, first: Start, u: Array, duration: float) -> Finding | None:
    """The finding that the equilibrium at which a run of this duration (s) begins is unstable, from the eigenvalues of
    dx'/dx there (held variables stay). None if it is stable, if the deviation grows by less than a factor e within the run,
    or if a sampled controller may stabilise it."""
    sampled = any(event.period is not None for event in assembly.flat.events)
    if assembly.model.initial.mode != "steady" or sampled or not 0 < len(first.x) <= MOST_STATES:
        return None
    if assembly.sizes:  # of a run that stays at the equilibrium; a machine that leaves it has its usual sizes
        assembly = assembly.with_sizes({})
    def slopes() -> ca.Function:
        _, x, z, *_ = assembly.arguments
        slopes = [ca.jacobian(side, by) for side in (assembly.ode, assembly.alg) for by in (x, z)]
        return ca.Function("slopes", list(assembly.arguments), slopes)

    matrices = assembly.once("state matrix", slopes)(first.t, first.x, first.z, first.p, u, 0.0)
    ode_x, ode_z, alg_x, alg_z = (np.array(part.full()) for part in matrices)
    matrix = ode_x - ode_z @ np.linalg.lstsq(alg_z, alg_x, rcond=None)[0] if len(first.z) else ode_x
    values, modes = np.linalg.eig(np.asarray(matrix * assembly.x_nominal / assembly.x_nominal[:, None]))
    if not np.isfinite(values).all():
        return None
    fastest = int(np.argmax(values.real))
    growth = float(values[fastest].real)
    if growth * duration < 1 or growth < ROUNDED * float(np.abs(values).max()):
        return None
    mode = modes[:, fastest].real
    # a position tells equilibria apart; speeds are 0 at all of them
    speeds = [order > 0 or assembly.flat.unknowns[j].motion for j, order in assembly.reduced.states]
    k = int(np.argmax(np.abs(mode) * (1.0 if all(speeds) else np.logical_not(speeds))))
    name, unknown = assembly.state_names[k], assembly.flat.unknowns[assembly.reduced.states[k][0]]
    # the values of the state at the equilibria to which the machine settles after a disturbance along the mode in either
    # direction
    direction_of_mode = mode / np.abs(mode).max()
    search = StartSearch(StartEquations(assembly), assembly, first.t, u)
    y = np.concatenate([first.x, first.z, first.p[search.equations.solved_for]])
    equilibria: list[float] = []
    for push in (direction * size for size in PUSHES for direction in (-1, 1)):
        begin = y.copy()
        begin[: len(first.x)] += push * direction_of_mode * assembly.x_nominal
        try:
            end = search.at_rest_from(begin)
        except StartError:
            check()
            continue
        value, near = float(end[k]) if end is not None else np.nan, SAME_EQUILIBRIUM * float(assembly.x_nominal[k])
        if np.isfinite(value) and all(abs(value - known) > 10 * near for known in (*equilibria, float(first.x[k]))):
            equilibria.append(0.0 if abs(value) < near else value)
    settled_values = sorted(equilibria, key=lambda value: (abs(value - first.x[k]) // (10 * near), value))[:3]
    places = [readable(value, unknown.unit.text) for value in settled_values]
    choice = f"Other equilibria: {' or '.join(places)}. Write a guess near the one that is meant, " \
        f"`initial: {{{name}: ~ {places[0]}}}`" if places else \
        "`heavebond modes` shows the components that oscillate or run away"
    return Finding("unstable-start", name, name.rpartition(".")[0], first.t, float(first.x[k]), None, unknown.unit.text,
                   f"a disturbance grows by e in {number(1 / growth, 3)} s. {choice}")
