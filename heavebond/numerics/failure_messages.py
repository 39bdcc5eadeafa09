"""Why an integration stopped: when, in which components, with what values, and the likely cause."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import Problem, SimulationError, listing
from heavebond.core.presentation import readable
from heavebond.equations import structural_messages
from heavebond.equations.flatten import EquationRole
from heavebond.equations.lost_rank import losses
from heavebond.language.definition import Value
from heavebond.language.library import is_bundled
from heavebond.language.symbols import stack
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.initialise import Start
from heavebond.numerics.result import Result, columns
from heavebond.numerics.run_verdict import RUNAWAY
from heavebond.numerics.start_equations import Point
from heavebond.numerics.validity import RAN_AWAY, VALIDITY, at_point, typical_size

# singular values below this share of the largest are on their way to zero where a run stops
NEAR = 1e-5
# and in a run that went on: they are zero but for rounding
SINGULAR = 1e-14
LOOKED_AT = 60
AT_LIMIT = 0.01  # share of its distance at the start that is left of the way to a limit that a variable has come to
PASSING = 1e-4  # way of a variable, as a share of its size, in which a law that jumps is seen to
JUMP = 1e-3  # share of the change of a law over the size of a variable that a jump is
TIGHT = 1e-6  # relative tolerances from which on there is nothing to loosen
FOLDED = ("The links of a mechanism come to lie in one line there, from where it could go on in two ways: its constraints "
          "depend on each other. No choice of states helps; change a length a little, or add what decides (a spring).")
# what gives a node a speed of its own, by the unit of its position, with a value to begin with
INERTIA = {"m": ("Mass", "m: 1 kg"), "rad": ("Inertia", "J: 1 kg*m**2")}
_TIME = re.compile(r"[Aa]t t ?= ?([-+.\deE]+)")


@dataclass(frozen=True)
class Stop:
    """A failure of the integrator at time `t` (s, NaN if it was not reported), in the states of `assembly`, shortly after
    the point `last` (None if none could be reached); `folded` if a mechanism is at a dead centre."""

    assembly: Assembly
    t: float
    last: Point | None
    folded: bool = False


def stop_times(message: str) -> list[float]:
    """The times (s) in the message of an integrator on a failure."""
    return [float(t) for t in _TIME.findall(message)]


def explain_failure(stop: Stop, first: Start, message: str, rtol: float) -> SimulationError:
    """The error for a run from `first` that failed; `message` is the message of the integrator, `rtol` its relative
    tolerance."""
    notes: list[str] = []
    loosen, stopped = (", or loosen the tolerances (--rtol 1e-6)" if rtol < TIGHT else ""), stop.t
    hint = f"Check the parameters of these components{loosen}."
    if stop.last is not None:
        cause, notes = _cause(stop.assembly, first, stop.last, loosen)
        # a part outside its law can look like a mechanism at a dead centre
        hint = (_out_of_range(stop.assembly, stop.last, ("physical",)) or FOLDED) if stop.folded else cause or hint
        hint += "" if stop.folded else _without_mass(stop.assembly, stop.last)
        if lawless := [path for path, leaf in stop.assembly.flat.expanded.leaves.items() if leaf.component.placeholder]:
            have = f"{listing(lawless, 4)} {'have' if len(lawless) > 1 else 'has'}"
            hint = f"{have} no law, and what placeholders give is constant: write the laws first. {hint}"
    words = [line for line in message.splitlines() if "IDA" in line or "SUNDIALS" in line.upper()]
    solver = re.findall(r"\b(?:IDA|CV)_[A-Z_]+", message)
    integrator = "CVODES" if solver and solver[0].startswith("CV") else "IDAS"
    notes.append(f"{integrator} said: " + (", ".join(dict.fromkeys(solver)) or (words[0][:160] if words else "nothing")))
    return SimulationError([Problem("integration-failed", stop_message(stopped), None, hint, tuple(notes))])


def stop_message(t: float) -> str:
    """The sentence that the integrator failed at time t (s, NaN if it is not known)."""
    return "the integration stopped" + (f" at t = {t:.6g} s" if np.isfinite(t) else "")


def check_decided(result: Result, at: NDArray[np.intp], slopes: ca.Function) -> None:
    """Raise SimulationError if a run continued although no equation determined an algebraic unknown any more: its values
    after that time are arbitrary. `slopes` is d(algebraic equations)/d(algebraic unknowns) in the arguments of the assembly;
    it is evaluated at some of the output points `at`.
    """
    assembly, n_z = result.assembly, len(result.assembly.z_nominal)
    chosen = at[np.unique(np.linspace(0, len(at) - 1, LOOKED_AT).astype(int))]
    arguments = [a[:, chosen] for a in columns(result)]
    matrices = np.array(slopes(*arguments)).reshape(n_z, len(chosen), n_z).transpose(1, 0, 2) * assembly.z_usual
    largest = np.abs(matrices).max(axis=2, keepdims=True)
    sound = np.isfinite(matrices).all(axis=(1, 2)) & (largest > 0).all(axis=(1, 2))
    for k, matrix in enumerate(matrices / np.where(largest > 0, largest, 1.0)):
        if not np.isfinite(matrix).all():
            continue
        values = np.linalg.svd(matrix, compute_uv=False)
        if not sound[k] or values[-1] <= SINGULAR * values[0]:
            point_arguments = [a[:, k] for a in arguments]
            t = float(point_arguments[0][0])
            point = assembly.point(t, point_arguments[1], point_arguments[2], point_arguments[3], point_arguments[4])
            losses_there = losses(assembly.reduced.system, point)
            raise structural_messages.undecided(assembly.flat, losses_there, assembly.algebraic_names, f"at t = {t:.6g} s")


def _without_mass(assembly: Assembly, last: Point) -> str:
    """The element to add at the fastest node if no mass determines its speed; empty if its speed is a state."""
    flat, reduced = assembly.flat, assembly.reduced
    rates = np.abs(np.array(assembly.rates(*last.values()[:5], 1.0)[0]).ravel()) / assembly.x_nominal
    k = int(np.argmax(np.nan_to_num(rates, nan=-1.0))) if rates.size else -1
    unknown = flat.unknowns[reduced.states[k][0]] if k >= 0 and reduced.states[k][1] == 0 else None
    inertia = INERTIA.get(unknown.unit.text) if unknown is not None and unknown.role == "position" else None
    if unknown is None or inertia is None:
        return ""
    node = unknown.name.rpartition(".")[0]
    speeds = {flat.names[name] for domain in [flat.domains.get(node)] if domain for member in domain.across
              if (name := f"{node}.{member}") in flat.names}
    j = reduced.states[k][0]
    n = len(flat.unknowns)
    rigid = any(packed % n == j for i, _ in reduced.differentiated for packed, _ in flat.entries[i])
    if rigid or any(i in speeds or (i, order) == (j, 1) for i, order in reduced.states):
        return ""
    name, value = inertia
    part = f"{node}_{name.lower()}"
    return (f"\nNo mass decides the speed of node '{node}'; the forces there do, which they cannot where friction slides or "
            f"play opens. Add one: `{part}: {{is: {name}, {value}}}`, with its port `{part}.a` on the node.")


def _cause(assembly: Assembly, first: Start, last: Point, loosen: str) -> tuple[str, list[str]]:
    t, x, z, p, u = last.values()[:5]
    ode, alg = (np.array(v).ravel() for v in assembly.rates(t, x, z, p, u, 1.0))
    same = len(first.x) == len(x) and len(first.z) == len(z)
    begun = (first.x, first.z) if same else (x * 0, z * 0)
    pivots, begin = (np.array(assembly.pivots(t, *at, p, u, 1.0)).ravel() for at in ((x, z), begun))
    rates = np.abs(ode) / assembly.x_nominal
    order = np.argsort(-np.where(np.isfinite(rates), rates, np.inf))[:3]
    owners = _owners(assembly)
    names = [assembly.state_names[k] for k in order]
    notes = [f"{name} = {x[k]:.6g}, changing by {ode[k]:.3g} a second" + (f"   ({owners[name]})" if owners.get(name) else "")
             for k, name in zip(order, names, strict=True)]
    at = assembly.point(t, x, z, p, u)
    if grown := _grown(assembly, x, t):
        return grown, notes
    if same and (limit := _at_limit(assembly, assembly.point(first.t, *begun, p, u), at)):
        return limit, notes
    if cause := _out_of_range(assembly, last):
        return cause, notes
    # the equations that are about to lose their rank at a point shortly before the end, otherwise those that have lost it
    system = assembly.reduced.system
    vanishing = [loss for loss in losses(system, at, NEAR) if loss.zero]
    problems = structural_messages.lost(assembly.flat, vanishing or losses(system, at), f"near t = {t:.4g} s")
    if problems:
        problem = problems[0]
        return f"{problem.message[:1].upper()}{problem.message[1:]}.\n{problem.hint}", [*notes, *problem.notes]
    # one that has turned its sign was zero a moment before: a run may go on a little with a volume below zero
    small = [k for k, value in enumerate(pivots) if abs(value) < 1e-9 * max(abs(begin[k]), 1e-300) or value * begin[k] < 0]
    if small:
        pivot = assembly.reduced.pivots[small[0]]
        return (f"The coefficient of {pivot.unknown} in '{pivot.equation.owner}' ({pivot.equation.text}) passes "
                "through zero there: a volume, an area or a lever arm vanishes.", notes)
    wild = _not_finite(assembly, t, x, z, p, u)
    if wild or not np.all(np.isfinite(ode)) or not np.all(np.isfinite(alg)):
        equations = listing(wild, 4) or "an equation"
        has = "have" if len(wild) > 1 else "has"
        return (f"From there on {equations} {has} no finite value: a root or logarithm of a negative number, a "
                "division by 0.", notes)
    if jumping := _jumping(assembly, at):
        return (f"{jumping}. Smooth it (smooth_sign(v, v_t) for sign(v)), or let it happen as an event (a DryFriction for "
                f"friction, `when:` in a component){loosen}.", notes)
    if len(z) and _singular(assembly, t, x, z, p, u):
        return (f"{listing(assembly.algebraic_names, 4)} cannot be solved for there: a valve shuts a volume-free "
                "line, or a lever loses its arm. Add what decides it: a leakage, a spring.", notes)
    if rates.size and rates[order[0]] > 1e6:
        return f"{listing(names, 2)} run away: an instability, a wrong sign or a very stiff element.", notes
    fastest = names or assembly.algebraic_names
    verb = "changes" if len(fastest) == 1 else "change"
    cause = f"{listing(fastest, 2)} {verb} fastest: a kink or jump there that the solvers cannot step over. "
    parts = list(dict.fromkeys(part for name in fastest for part in _leaves(assembly, name)))
    user_parts = [part for part in parts if _of_the_user(assembly, part)]
    if parts and not user_parts:
        return (f"{cause}The parts there are {listing(parts, 4)}, all of the library: look for one whose size or rating "
                "does not fit its neighbours, or for a volume, a mass or a time constant far below theirs"
                f"{loosen}. If they are right, this is a fault of the library: please report it with the diagram.", notes)
    return (f"{cause}Smooth it{' in ' + listing(user_parts, 4) if user_parts else ''} (smooth_sign(v, v_t) for sign(v), "
            "signed_sqrt for a root), let it happen as an event (a Step for a jump in time, a DryFriction for a sign, "
            f"`when:` in a component){loosen}.", notes)


def _of_the_user(assembly: Assembly, part: str) -> bool:
    """True if the user can change a law of a part: a component file of the user, or an input given by a formula."""
    leaf = assembly.flat.expanded.leaves[part]
    written = (bound.value for bound in leaf.inputs.values() if bound.scope == "")
    return not is_bundled(leaf.component.path) or any(isinstance(value, Value) and value.formula for value in written)


def _leaves(assembly: Assembly, name: str) -> list[str]:
    """The parts whose equations contain a state or an algebraic unknown."""
    flat, n = assembly.flat, len(assembly.flat.unknowns)
    reduced = assembly.reduced
    j = next((c[0] for c in (*reduced.states, *reduced.algebraic) if reduced.name(c) == name), None)
    owners = dict.fromkeys(flat.equations[i].owner for i, row in enumerate(flat.entries) if any(c % n == j for c, _ in row))
    return [owner for owner in owners if owner in flat.expanded.leaves]


def _grown(assembly: Assembly, x: Array, t: float) -> str:
    """The message if states had exceeded all bounds before the run stopped: other faults at that point are consequences."""
    unknowns = [assembly.flat.unknowns[j] for j, _ in assembly.reduced.states]
    sizes = [min(RUNAWAY * typical_size(u, t), VALIDITY.worthless) for u in unknowns]
    grown = [name for name, value, size in zip(assembly.state_names, x, sizes, strict=True) if abs(value) > size]
    if not grown:
        return ""
    return f"By then {listing(grown, 3)} {'have' if len(grown) > 1 else 'has'} grown beyond all bounds. {RAN_AWAY}."


def _at_limit(assembly: Assembly, start: dict[int, float], at: dict[int, float]) -> str:
    """The message if a variable of a component has reached the end of its declared range: a piston at the end of its stroke
    leaves no volume. It adds the restriction of the component, or of the block that contains it."""
    flat = assembly.flat
    for u, symbol in zip(flat.unknowns, flat.levels[0], strict=True):
        begin, value = start[symbol.element_hash()], at[symbol.element_hash()]
        limit = next((end for end in (u.low, u.high) if np.isfinite(end) and begin != end
                      and (value - end) / (begin - end) < AT_LIMIT), None)
        if u.role != "own" or limit is None:
            continue
        leaves = flat.expanded.leaves
        paths = [path for path in accumulate(u.name.split(".")[:-1], "{}.{}".format) if path in leaves]
        lacks = ((path, leaves[path].component.name, " ".join(re.findall(
            r"\bNo [^.]*\.", leaves[path].component.restrictions))) for path in paths)
        restriction = next((f" {path} is a {kind}. {words}" for path, kind, words in lacks if words), "")
        beyond = u.plausible.beyond
        advice = f" Beyond it {beyond}." if beyond and limit == u.low else ""
        return (f"{u.name}{f' ({u.doc})' if u.doc else ''} reaches its limit {readable(limit, u.unit.text)} there, from "
                f"{readable(begin, u.unit.text)} at the start.{restriction}{advice}")
    return ""


def _out_of_range(assembly: Assembly, last: Point, kinds: Sequence[str] = ("physical", "range", "larger")) -> str:
    """The message on a variable outside the range of its laws: oil below vacuum, or at an unusual pressure. `kinds` are
    those of the findings of a verdict that are reported."""
    finding = next((f for f in at_point(assembly, last).findings if f.kind in kinds), None)
    if finding is None or finding.limit is None:
        return ""
    value, limit = (readable(number, finding.unit) for number in (finding.value, finding.limit))
    return f"{finding.name} is {value} there, beyond {limit}: {finding.advice}."


def _not_finite(assembly: Assembly, t: float, x: Array, z: Array, p: Array, u: Array) -> list[str]:
    """The variables without a finite value at the state where the run stopped, or slightly later, with the state unchanged
    or extrapolated."""
    rates = np.array(assembly.rates(t, x, z, p, u, 1.0)[0]).ravel()
    for later, further in ((0.0, 0.0), (1e-6, 0.0), (1e-3, 0.0), (1e-6, 1.0), (1e-5, 1.0)):
        step = later * max(abs(t), 1.0)
        values = np.array(assembly.values(t + step, x + further * step * rates, z, p, u, 1.0)).ravel()
        bad = [unknown.name for unknown, value in zip(assembly.flat.unknowns, values, strict=True)
               if not np.isfinite(value)]
        if bad:
            return bad
    return []


def _jumping(assembly: Assembly, at: dict[int, float]) -> str:
    """Laws that are discontinuous where the run stopped, such as `if_else(v > 0, F, -F)` at v = 0. Their change over a short
    distance of a variable through the point is as large as over a tenth of that distance, and a considerable part of the
    change over the size of the variable."""
    flat, jumps = assembly.flat, []
    known = {s.element_hash(): unknown for s, unknown in zip(flat.levels[0], flat.unknowns, strict=True)}
    for equation, residual in zip(flat.equations, flat.residuals, strict=True):
        if equation.kink is None:
            continue
        symbols = ca.symvar(residual)
        law = ca.Function("law", [stack(symbols)], [residual])
        center = np.array([at.get(s.element_hash(), 0.0) for s in symbols])
        for k, symbol in enumerate(symbols):
            if (unknown := known.get(symbol.element_hash())) is None:
                continue
            steps = np.eye(len(center))[k] * float(unknown.nominal)
            wide, mean, short = (abs(float(law(center + share * steps)) - float(law(center - share * steps)))
                                   for share in (1.0, PASSING, PASSING / 10))
            if short > mean / 2 and mean > JUMP * wide:
                jumps.append((equation, unknown, float(center[k])))
                break
    if not jumps:
        return ""
    equation, unknown, value = jumps[0]
    other_owners = listing(dict.fromkeys(e.owner for e, *_ in jumps[1:] if e.owner != equation.owner), 3)
    return (f"{equation.owner} jumps in '{equation.text}' at {unknown.name} = {readable(value, unknown.unit.text)}, which "
            f"the solvers cannot step over{f'; so do {other_owners}' if other_owners else ''}")


def _singular(assembly: Assembly, t: float, x: Array, z: Array, p: Array, u: Array) -> bool:
    """Whether the equations of the algebraic unknowns are close to losing their solution."""
    jacobian = ca.Function("J", list(assembly.arguments), [ca.jacobian(assembly.alg, assembly.arguments[2])])
    matrix = np.array(jacobian(t, x, z, p, u, 1.0).full()) * assembly.z_nominal
    rows = np.abs(matrix).max(axis=1, keepdims=True)
    return bool(not np.all(np.isfinite(matrix)) or rows.min() == 0 or np.linalg.cond(matrix / rows) > 1e4)


def _owners(assembly: Assembly) -> dict[str, str]:
    flat = assembly.flat
    owners = {}
    n = len(flat.unknowns)
    for name, (j, _) in zip(assembly.state_names, assembly.reduced.states, strict=True):
        using = [flat.equations[i].owner for i, row in enumerate(flat.entries)
                 if any(c % n == j for c, _ in row) and flat.equations[i].role is not EquationRole.RATE]
        owners[name] = listing(dict.fromkeys(using), 4)
    return owners
