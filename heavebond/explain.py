"""Structural mistakes in the words of the diagram: which parts fix the same thing, and what nothing decides."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from heavebond.definition import Domain
from heavebond.errors import ModelError, Place, Problem, either, listing
from heavebond.flatten import Flat, FlatEquation
from heavebond.resolver import Unknown
from heavebond.structure import Block, dulmage_mendelsohn, maximum_matching

SHARED = ("across", "position")
MOST_LINES = 8
# what decides the shared variable of a node, by domain
DECIDES = {
    "translational": "a Fixed, a Mass or a PositionSource on one of these nodes, or a Spring from there to such a node",
    "rotational": "an inertia or a fixed point on one of these nodes",
    "hydraulic": "a Volume, a Tank or a PressureSource on one of these nodes, or an Orifice from there to such a node",
    "electrical": "an ElectricalGround, a VoltageSource or a Capacitor on one of these nodes, or a Resistor from there to "
                  "such a node",
    "pneumatic": "a Receiver, an Atmosphere or a PneumaticSource on one of these nodes",
}


def singular(flat: Flat, rows: Sequence[Sequence[int]], matching: Sequence[int]) -> ModelError:
    """The error for a system whose equations cannot be assigned one to each unknown.

    `rows[i]` lists the unknowns of equation i whatever their derivatives; a Dulmage-Mendelsohn decomposition finds
    the smallest parts with more equations than unknowns, and those with more unknowns than equations. The two belong
    together where they meet in a component: what fixes a velocity twice leaves two forces open, and what fixes a flow
    twice leaves a pressure open.
    """
    try:
        parts = dulmage_mendelsohn(rows, len(flat.unknowns), matching)
    except ValueError:  # the caller's matching was of other equations (their derivatives)
        parts = dulmage_mendelsohn(rows, len(flat.unknowns), maximum_matching(rows, len(flat.unknowns)))
    problems, told = [], set()
    for block in parts.overdetermined:
        part = _Part(flat, block)
        near = [b for b in parts.underdetermined if part.touched.intersection(b.core_columns)]
        told.update(near)
        loose = [flat.unknowns[j] for b in near for j in b.core_columns]
        if part.shared or not any(u.role in SHARED for u in loose):
            problems.append(part.fixed_twice(loose))
        else:
            problems.append(_undecided(flat, loose, part))
    for block in parts.underdetermined:
        if block not in told and block.core_columns and (block.core_rows or not parts.overdetermined):
            problems.append(_undecided(flat, [flat.unknowns[j] for j in block.core_columns], None))
    return ModelError(problems or [Problem(
        "singular", "some of these equations say the same in another form, so that nothing decides some unknowns", None,
        "Look for two parts that hold the same position, or for a circuit without a Tank or a Volume.")])


class _Part:
    """The smallest set of equations that have one unknown fewer than they are, as a user would tell it."""

    def __init__(self, flat: Flat, block: Block):
        self.flat = flat
        equations = [flat.equations[i] for i in block.core_rows]
        # the assembler's own equations and the values of inputs are no choice between which a user could decide
        self.said = [e for e in equations if not _bookkeeping(e)] or equations
        unknowns = [flat.unknowns[j] for j in block.core_columns]
        self.shared = _without_rates([u for u in unknowns if u.role in SHARED])
        self.unknowns = self.shared or [u for u in unknowns if u.role != "signal"] or unknowns
        self.owners = list(dict.fromkeys(e.owner for e in self.said))
        self.touched = {j for name, j in flat.names.items() if any(name.startswith(f"{o}.") for o in self.owners)}
        # a node without parts of its own, or a signal, has no component; its unknowns are those of the block
        self.touched.update(block.core_columns)

    def fixed_twice(self, loose: Sequence[Unknown]) -> Problem:
        """The problem of equations that contradict, or repeat, each other; `loose` is what they leave open instead."""
        names = listing((u.name for u in self.unknowns), 4) or "nothing that is unknown"
        number = len(self.said)
        message = f"these {number} equations fix the same unknown{'s' * (len(self.unknowns) > 1)}, {names}" \
            if number > 1 else f"this equation has nothing left to decide: {names} is fixed already"
        sharing = _sharing(self.flat, loose, self.owners)
        owners = self.owners[:3]
        advice = f"Put {either(owners)} on different nodes, or remove one of them." if len(self.owners) > 1 else \
            f"Remove or change {either(owners)}."
        place = self.unknowns[0].place if self.unknowns else self.said[0].place
        return Problem("overdetermined", message, place, f"{sharing}\n{advice}".strip(), tuple(_table(self.said)))


def _undecided(flat: Flat, loose: Sequence[Unknown], part: _Part | None) -> Problem:
    """The problem of unknowns that no equation decides, beside equations that are one too many for what they hold."""
    shared = _without_rates([u for u in loose if u.role in SHARED])
    shown = shared or list(loose)
    names = listing((u.name for u in shown), 6)
    message = f"nothing decides {names}" + ("; one of them must be known" if len(shown) > 1 else "")
    domains = dict.fromkeys(d.name for u in shared if (d := _domain(flat, u)) is not None)
    advice = "Add " + ", or ".join(DECIDES.get(d, "what decides it") for d in domains) + "." if domains else \
        "An equation is missing there, or a component."
    notes: list[str] = []
    if part is not None:
        through = [u for u in part.unknowns if u.role == "through"]
        what = _noun(through[0].doc) if through else "what flows"
        notes = [f"these equations decide {what} there without {'them' if len(shown) > 1 else 'it'}:", *_table(part.said)]
    return Problem("underdetermined", message, shown[0].place if shown else None, advice, tuple(notes))


def _without_rates(unknowns: Sequence[Unknown]) -> list[Unknown]:
    """A velocity is left out where the position beside it is named: to a user they are one thing."""
    positions = {u.name.rpartition(".")[0] for u in unknowns if u.role == "position"}
    return [u for u in unknowns if not (u.motion and u.name.rpartition(".")[0] in positions)]


def _sharing(flat: Flat, loose: Sequence[Unknown], owners: Iterable[str]) -> str:
    """`and nothing decides how wall.a.f and drive.a.f share the force at node 'ground'.`"""
    through = [u for u in loose if u.role == "through" and any(u.name.startswith(f"{o}.") for o in owners)]
    if not through:
        return ""
    ports = {u.name.rpartition(".")[0] for u in through}
    nodes = list(dict.fromkeys(j.path for j in flat.expanded.junctions.values() for e in j.ends if e.name in ports))
    members = {u.name.rpartition(".")[2] for u in through}
    names = " and ".join(u.name for u in through[:2]) if len(through) <= 2 else listing((u.name for u in through), 4)
    what = _noun(through[0].doc) if len(members) == 1 else "what flows"
    return f"and nothing decides how {names} share {what} at node{'s' * (len(nodes) > 1)} {either(nodes[:3])}."


def _noun(doc: str) -> str:
    """`the force` from a member's description, `force on the component`."""
    return "the " + doc.partition(" on ")[0].partition(" into ")[0] if doc else "what flows"


def _domain(flat: Flat, unknown: Unknown) -> Domain | None:
    """The domain to whose node an across variable or a position belongs: the one that has all of the node's members."""
    node, _, member = unknown.name.rpartition(".")
    for domain in flat.expanded.model.library.domains.values():
        if member in (*domain.across, domain.position) and all(f"{node}.{m}" in flat.names for m in domain.across):
            size = len(domain.across)
            others = [d for d in flat.expanded.model.library.domains.values() if len(d.across) > size
                      and member in d.across and all(f"{node}.{m}" in flat.names for m in d.across)]
            return others[0] if others else domain
    return None


def _bookkeeping(equation: FlatEquation) -> bool:
    """A node's own equation, which the assembler wrote and no user can remove, or the value of an input."""
    return equation.label.startswith("sum of ") or " is the rate of " in equation.label \
        or equation.label.endswith((" as given", " as measured"))


def _table(equations: Sequence[FlatEquation]) -> list[str]:
    shown = [(f"{e.owner}:", e.text, e.label, f"{e.place.file}:{e.place.line}") for e in equations[:MOST_LINES]]
    widths = [max(len(row[k]) for row in shown) for k in range(3)]
    lines = ["  ".join([*(cell.ljust(width) for cell, width in zip(row, widths, strict=False)), row[3]])
             for row in shown]
    if len(equations) > MOST_LINES:
        lines.append(f"and {len(equations) - MOST_LINES} more")
    return lines


def kinked(flat: Flat, indices: Sequence[int]) -> ModelError:
    """The error for equations that index reduction must differentiate but that have a kink."""
    problems = []
    for i in indices:
        equation = flat.equations[i]
        place: Place = equation.place
        problems.append(Problem(
            "kink-differentiated", f"'{equation.owner}': this equation must be differentiated in time, but "
            f"{equation.kink} has a kink", place,
            "It holds positions or other states together, so its rate is needed. Use a smooth function instead (tanh, "
            "smooth_sign),\nor let the parts meet through a spring."))
    return ModelError(problems)
