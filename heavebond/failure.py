"""Why an integration stopped: when, in which components, with what values, and the likely cause."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from heavebond.dae import Array, Assembly
from heavebond.errors import Problem, SimulationError, listing
from heavebond.initialise import Start
from heavebond.start_equations import Point

if TYPE_CHECKING:
    from heavebond.simulation import Simulator

_TIME = re.compile(r"[Aa]t t ?= ?([-+.\deE]+)")


def explain_failure(simulator: Simulator, assembly: Assembly, first: Start, said: str) -> SimulationError:
    """The error for a run that stopped; looks at the state shortly before it did."""
    times = [float(t) for t in _TIME.findall(said)]
    stopped = max(times) if times else float("nan")
    if simulator.switching is not None and simulator.switching.last is not None:
        stretch = simulator.switching.last
        stopped = stretch.time(times[-1]) if times else stretch.begin.t
        last: Point | None = simulator.switching.before(stretch, stopped)
        assembly = stretch.begin.frame.assembly
    else:
        last = _state_before(simulator, assembly, first, stopped)
    notes: list[str] = []
    hint = "Check the parameters of these components, or loosen the tolerances (--rtol 1e-6)."
    if last is not None:
        cause, notes = _cause(assembly, last.t, last.x, last.z, last.p, last.u)
        hint = cause or hint
    words = [line for line in said.splitlines() if "IDA" in line or "SUNDIALS" in line.upper()]
    solver = re.findall(r"IDA_[A-Z_]+", said)
    notes.append("IDAS said: " + (", ".join(dict.fromkeys(solver)) or (words[0][:160] if words else "nothing")))
    when = f" at t = {stopped:.6g} s" if np.isfinite(stopped) else ""
    return SimulationError([Problem("integration-failed", f"the integration stopped{when}", None, hint, tuple(notes))])


def _state_before(simulator: Simulator, assembly: Assembly, first: Start, stopped: float) -> Point | None:
    """The state a little before the end, found by integrating again up to there."""
    begin = float(simulator.time[0])
    if not np.isfinite(stopped) or stopped <= begin:
        u = simulator.pieces.at(np.array([begin]))[:, 0]
        return Point(begin, first.x, first.z, first.p, u, 1.0)
    for share in (1 - 1e-6, 1 - 1e-3, 0.9):
        times = np.array([begin, begin + (stopped - begin) * share])
        again = type(simulator)(assembly, times=times, tolerances=simulator.tolerances)
        try:
            found = again.attempt(first)
        except RuntimeError:
            continue
        u = again.pieces.at(times[-1:])[:, 0]
        return Point(float(times[-1]), found.x[:, -1], found.z[:, -1], first.p, u, 1.0)
    return None


def _cause(assembly: Assembly, t: float, x: Array, z: Array, p: Array, u: Array) -> tuple[str, list[str]]:
    ode, alg = (np.array(v).ravel() for v in assembly.rates(t, x, z, p, u, 1.0))
    pivots = np.abs(np.array(assembly.pivots(t, x, z, p, u, 1.0)).ravel())
    begin = np.abs(np.array(assembly.pivots(0.0, x * 0, z * 0, p, u, 1.0)).ravel())
    rates = np.abs(ode) / assembly.x_nominal
    order = np.argsort(-np.where(np.isfinite(rates), rates, np.inf))[:3]
    owners = _owners(assembly)
    names = [assembly.state_names[k] for k in order]
    notes = [f"{assembly.state_names[k]} = {x[k]:.6g}, changing by {ode[k]:.3g} a second"
             f"   ({owners.get(assembly.state_names[k], '')})" for k in order]
    small = [k for k, value in enumerate(pivots) if value < 1e-9 * max(begin[k], 1e-300) or value == 0]
    if small:
        pivot = assembly.reduced.pivots[small[0]]
        return (f"The coefficient of {pivot.unknown} in '{pivot.equation.owner}' ({pivot.equation.text}) passes "
                "through zero there: a volume, an area or a lever arm vanishes.", notes)
    wild = _not_finite(assembly, t, x, z, p, u)
    if wild or not np.all(np.isfinite(ode)) or not np.all(np.isfinite(alg)):
        which = listing(wild, 4) or "an equation"
        return (f"From there on {which} has no finite value: a root or logarithm of a negative number, a division by 0.",
                notes)
    if len(z) and _singular(assembly, t, x, z, p, u):
        return (f"{listing(assembly.algebraic_names, 4)} cannot be solved for there: the links of a mechanism lie in "
                "one line, from where it could go on in two ways, or a valve shuts a volume-free line. No choice of states "
                "helps there: change a length a little, or add what decides it (a spring, a leakage).", notes)
    if rates.size and rates[order[0]] > 1e6:
        return f"{listing(names, 2)} run away: an instability, a wrong sign or a very stiff element.", notes
    return (f"{listing(names, 2)} change fastest: a kink or jump there that the solver cannot step over. Smooth it "
            "(a transition velocity or pressure), let it happen as an event (`when:`), or loosen the tolerances.", notes)


def _not_finite(assembly: Assembly, t: float, x: Array, z: Array, p: Array, u: Array) -> list[str]:
    """The variables that are no numbers at the state where the run stopped, or a little later in time."""
    for later in (0.0, 1e-6, 1e-3):
        values = np.array(assembly.values(t + later * max(abs(t), 1.0), x, z, p, u, 1.0)).ravel()
        bad = [unknown.name for unknown, value in zip(assembly.flat.unknowns, values, strict=True)
               if not np.isfinite(value)]
        if bad:
            return bad
    return []


def _singular(assembly: Assembly, t: float, x: Array, z: Array, p: Array, u: Array) -> bool:
    """Whether the equations of the algebraic unknowns are close to losing their solution."""
    jacobian = ca.Function("J", list(assembly.arguments), [ca.jacobian(assembly.alg, assembly.arguments[2])])
    matrix = np.array(jacobian(t, x, z, p, u, 1.0).full()) * assembly.z_nominal
    rows = np.abs(matrix).max(axis=1, keepdims=True)
    return bool(not np.all(np.isfinite(matrix)) or rows.min() == 0 or np.linalg.cond(matrix / rows) > 1e4)


def _owners(assembly: Assembly) -> dict[str, str]:
    flat = assembly.flat
    found = {}
    n = len(flat.unknowns)
    for name, (j, _) in zip(assembly.state_names, assembly.reduced.states, strict=True):
        using = [flat.equations[i].owner for i, row in enumerate(flat.entries)
                 if any(c % n == j for c, _ in row) and " is the rate of " not in flat.equations[i].label]
        found[name] = listing(dict.fromkeys(using), 4)
    return found
