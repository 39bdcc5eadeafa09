"""Messages on structural singularity in terms of the diagram: over- and underdetermined variables and their parts."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence

from heavebond.core.errors import ModelError, Place, Problem, SimulationError, either, listing
from heavebond.equations.flatten import EquationRole, Flat, FlatEquation
from heavebond.equations.lost_rank import RankLoss, assumed
from heavebond.equations.matching import Block, dulmage_mendelsohn, maximum_matching
from heavebond.equations.resolver import Unknown
from heavebond.language.definition import Domain

SHARED = ("across", "position")
MOST_LINES = 8
MOST_BLAMED = 4


def singular(flat: Flat, rows: Sequence[Sequence[int]], matching: Sequence[int], dependent: Sequence[int] = ()
             ) -> ModelError:
    """The error for a system whose equations cannot be assigned one to each unknown.

    `rows[i]` lists the unknowns of equation i whatever their derivatives; a Dulmage-Mendelsohn decomposition finds the
    smallest parts with more equations than unknowns, and those with more unknowns than equations. Both parts are reported
    together if they share a component: a velocity that is prescribed twice leaves two forces undetermined, a flow that is
    prescribed twice a pressure. If the decomposition gives no part, the error names the equations `dependent`.
    """
    try:
        parts = dulmage_mendelsohn(rows, len(flat.unknowns), matching)
    except ValueError:  # the caller's matching was of other equations (their derivatives)
        parts = dulmage_mendelsohn(rows, len(flat.unknowns), maximum_matching(rows, len(flat.unknowns)))
    problems, reported = [], set()
    for block in parts.overdetermined:
        part = _Part(flat, block)
        near = [b for b in parts.underdetermined if part.touched.intersection(b.core_columns)]
        reported.update(near)
        loose = [flat.unknowns[j] for b in near for j in b.core_columns]
        # heat that goes nowhere leaves a temperature open, whatever pressures the equations hold besides
        domains = [_domain(flat, u) for u in part.shared]
        elsewhere = [u for u in loose if u.role in SHARED and _domain(flat, u) not in domains]
        if part.shared and elsewhere:
            problems.append(_undecided(flat, elsewhere, part))
        elif part.shared or not any(u.role in SHARED for u in loose):
            problems.append(part.fixed_twice(loose))
        else:
            problems.append(_undecided(flat, loose, part))
    for block in parts.underdetermined:
        if block not in reported and block.core_columns and (block.core_rows or not parts.overdetermined):
            problems.append(_undecided(flat, [flat.unknowns[j] for j in block.core_columns], None))
    if not problems:  # equations that depend on each other for all values
        equations = [flat.equations[i] for i in dict.fromkeys(dependent or range(len(flat.equations)))]
        laws = [e for e in equations if not bookkeeping(e)] or equations
        owners = listing(dict.fromkeys(e.owner for e in laws), MOST_BLAMED)
        problems.append(Problem(
            "singular", f"equations of {owners} are equivalent, so that no equation determines some unknowns",
            laws[0].place if laws else None, (_massless_ends(flat, {e.owner for e in laws}) or "Look for two parts that "
            "hold the same position, or for a circuit without a Tank or a Volume."), tuple(_table(laws))))
    return ModelError(problems)


def _massless_ends(flat: Flat, owners: Collection[str]) -> str:
    """Advice for nodes with a position that join these parts to nothing that determines their motion, such as the free end
    of a rope; empty if there is none."""
    leaves = flat.expanded.leaves
    for junction in flat.expanded.junctions.values():
        parts, domain = {end.leaf for end in junction.ends}, flat.domains.get(junction.path)
        others = [leaves[part].component for part in parts - set(owners) if part in leaves]
        if domain is not None and domain.positions and domain.determined_by and parts & set(owners) \
                and not any(c.stores or c.name == domain.reference for c in others):
            return f"No part gives node '{junction.path}' a mass, or holds it: add {domain.determined_by}."
    return ""


class _Part:
    """A smallest set of k equations with k - 1 unknowns, in the terms of a user."""

    def __init__(self, flat: Flat, block: Block):
        self.flat = flat
        equations = [flat.equations[i] for i in block.core_rows]
        # the assembler's own equations and the values of inputs are no choice between which a user could decide
        self.said = [e for e in equations if not bookkeeping(e)] or equations
        unknowns = [flat.unknowns[j] for j in block.core_columns]
        self.shared = _without_rates([u for u in unknowns if u.role in SHARED])
        self.unknowns = self.shared or [u for u in unknowns if u.role != "signal"] or unknowns
        self.owners = list(dict.fromkeys(e.owner for e in self.said))
        self.touched = {j for name, j in flat.names.items() if any(name.startswith(f"{o}.") for o in self.owners)}
        # a node without parts of its own, or a signal, has no component; its unknowns are those of the block
        self.touched.update(block.core_columns)

    def fixed_twice(self, loose: Sequence[Unknown]) -> Problem:
        """The problem of equations that contradict or repeat each other; `loose` are the unknowns that they leave
        undetermined."""
        names = listing((u.name for u in self.unknowns), 4) or "nothing that is unknown"
        number = len(self.said)
        message = f"these {number} equations fix the same unknown{'s' * (len(self.unknowns) > 1)}, {names}" \
            if number > 1 else f"this equation has nothing left to decide: {names} is fixed already"
        sharing = _sharing(self.flat, loose, self.owners)
        owners = self.owners[:4]
        nodes = {u.name.rpartition(".")[0] for u in self.shared}
        domain = _domain(self.flat, self.shared[0]) if self.shared else None
        elastic = domain.compliance if domain else Domain.compliance
        quantity = self.shared[0].doc if self.shared else ""
        advice = f"Remove or change {either(owners)}." if len(self.owners) == 1 else \
            (f"{either(owners)} each hold the {quantity} of one node, which one part alone can do.\n" if quantity
             else "") + \
            f"Put {either(owners)} on different nodes, or remove one of them." if len(nodes) < 2 else \
            f"They rigidly join nodes that are fixed at both ends: remove one of {either(owners, 'or')},\n" \
            f"or put {elastic} between them."
        place = self.unknowns[0].place if self.unknowns else self.said[0].place
        if joined := short_circuit(self.flat, self.owners):
            (message, advice), sharing = joined, ""
        return Problem("overdetermined", message, place, f"{sharing}\n{advice}".strip(), tuple(_table(self.said)))


def _undecided(flat: Flat, loose: Sequence[Unknown], part: _Part | None) -> Problem:
    """The problem of undetermined unknowns, together with redundant equations."""
    shared = _without_rates([u for u in loose if u.role in SHARED])
    named = shared or list(loose)
    names = listing((u.name for u in named), 6)
    message = f"no equation determines {names}" + ("; one of them must be known" if len(named) > 1 else "")
    domains = _domains(flat, shared)
    advice = "Add " + ", or ".join(d.determined_by for d in domains) + "." if domains else \
        "An equation is missing there, or a component."
    notes: list[str] = []
    if part is not None:
        through = [u for u in part.unknowns if u.role == "through"]
        quantity = _noun(through[0].doc) if through else "what flows"
        notes = [f"these equations decide {quantity} there without {'them' if len(named) > 1 else 'it'}:",
                 *_table(part.said)]
        if shared and through:
            held = shared[0].doc or "other variable"
            advice = f"{quantity[:1].upper()}{quantity[1:]} is given by {either(part.owners[:4])}, and no part there " \
                f"gives the {held}: none stores, and none ties it to a reference.\n{advice}"
    return Problem("underdetermined", message, named[0].place if named else None, advice, tuple(notes))


def lost(flat: Flat, rank_losses: Sequence[RankLoss], when: str = "") -> list[Problem]:
    """The problems of equations that depend on each other at their values; `when` is the time in a run (`at the start`)."""
    joined: dict[tuple[int, ...], list[RankLoss]] = {}
    for loss in rank_losses:  # a tie of velocities is one of accelerations, and of forces, too
        equations = tuple(dict.fromkeys(i for i, _ in loss.rows if not bookkeeping(flat.equations[i])))
        joined.setdefault(equations, []).append(loss)
    if len(joined) > 1 and () in joined:  # what only the assembler's own equations say belongs to the others
        joined[next(equations for equations in joined if equations)] += joined.pop(())
    problems = []
    for same in joined.values():  # losses of the same equations as one
        rows, columns, parameters, variables = (
            tuple(dict.fromkeys(item for loss in same for item in getattr(loss, member)))
            for member in ("rows", "columns", "parameters", "variables"))
        loss = RankLoss(rows, columns, parameters, variables, any(loss.zero for loss in same))
        problems.append(_Lost(flat, loss).problem(when))
    return problems


def undecided(flat: Flat, rank_losses: Sequence[RankLoss], names: Sequence[str], when: str) -> SimulationError:
    """The error for a run where (`at t = 2 s`) no equation determines its algebraic unknowns `names` any more, from the
    equations that lost their rank."""
    return SimulationError(lost(flat, rank_losses, when) or [Problem(
        "loop-singular", f"no equation determines {listing(names, 4)} {when}", None,
        "A closed valve, a dead centre or an open contact does this. Add what decides it there.")])


class _Lost:
    """Dependent equations and the unknowns that they leave undetermined, in the terms of a user."""

    def __init__(self, flat: Flat, loss: RankLoss):
        self.flat, self.loss = flat, loss
        loose = [flat.unknowns[j] for j in dict.fromkeys(j for j, _ in loss.columns)]
        self.shared = _without_rates([u for u in loose if u.role in SHARED])
        self.shown = self.shared or [u for u in loose if u.role == "through"] or loose
        equations = [flat.equations[i] for i in dict.fromkeys(i for i, _ in loss.rows)]
        self.said = [e for e in equations if not bookkeeping(e)] or equations
        self.owners = [o for o in dict.fromkeys(e.owner for e in self.said) if o in flat.expanded.leaves]
        specified = [name for name in loss.parameters if not assumed(flat, name)]
        # of what is zero, what the diagram itself says comes before what a component assumes
        self.blamed = (specified or [name for name, _ in loss.variables] or list(loss.parameters)) if loss.zero else \
            [name for name, _ in loss.variables] or list(loss.parameters)
        self.blamed = self.blamed[:MOST_BLAMED]
        domains = _domains(flat, self.shared)
        self.decides = "add " + ", or ".join(d.determined_by for d in domains) if domains else ""
        self.elastic = domains[0].compliance if domains else Domain.compliance

    def problem(self, when: str) -> Problem:
        cause = f": {listing(self.blamed)} {'is' if len(self.blamed) == 1 else 'are'} 0" if self.loss.zero else ""
        notes = [("of these equations one is then too many:" if len(self.said) > 1 else
                  "this equation then does not contain it:"), *_table(self.said)] if self.said else []
        places = {q.name: q.place for q in self.flat.parameters}
        places |= {e.subject: e.place for e in self.flat.equations if e.role is EquationRole.GIVEN}
        place = next((places[name] for name in self.blamed if self.loss.zero and name in places),
                     self.shown[0].place if self.shown else self.said[0].place if self.said else None)
        if joined := short_circuit(self.flat, self.owners):
            return Problem("rank-lost", joined[0], place, joined[1], tuple(notes))
        return Problem("rank-lost", " ".join(f"no equation determines {self._names()} {when}".split()) + cause, place,
                       self._remedy(), tuple(notes))

    def _names(self) -> str:
        """`A.p, B.p`, `der(cart.v)` where the value itself is known, `the volume flow through pump, pipe`."""
        if not self.shown:
            return "the unknowns of these equations"
        if all(u.role == "through" for u in self.shown):
            parts = dict.fromkeys(u.name.rpartition(".")[0].rpartition(".")[0] for u in self.shown)
            return f"{_noun(self.shown[0].doc)} through {listing(parts, 6)}"
        least = {self.flat.unknowns[j].name: k for j, k in sorted(self.loss.columns, reverse=True)}
        rates = self.loss.zero or bool(self.loss.variables)
        return listing((f"der({u.name})" if rates and least[u.name] else u.name for u in self.shown), 6)

    def _remedy(self) -> str:
        """The kind of mistake, and the lines to type."""
        loss, blamed = self.loss, self.blamed
        if loss.zero:
            if self.blamed[0] in self.loss.parameters:
                owner = self.blamed[0].rpartition(".")[0]
                otherwise = f", or take '{owner}' out of the diagram" if owner else ""
                return f"Give {listing(self.blamed)} a value other than 0{otherwise}."
            dormant = f"give {listing(self.loss.parameters, MOST_BLAMED)} a value" if self.loss.parameters else ""
            remedies = [remedy for remedy in (f"keep {listing(self.blamed)} away from 0", dormant, self.decides) if remedy]
            return f"{remedies[0][:1].upper()}{remedies[0][1:]}{''.join(f', or {remedy}' for remedy in remedies[1:])}."
        if self.shown and all(u.role == "signal" for u in self.shown):
            agree = f"With these values of {listing(blamed)} the loop has no solution, or any value is one.\n" * bool(blamed)
            return f"{agree}A loop of signals without memory: each follows from the others at the same instant.\n" \
                "Put a FirstOrderLag or a SampleHold between them."
        if loss.variables:
            return "A dead centre, or a place where a law stops to act: " + ", ".join(
                f"{name} = {value:.6g}" for name, value in loss.variables[:MOST_BLAMED]) + ".\n" \
                f"Begin away from it, for example `initial: {{{loss.variables[0][0]}: ...}}`, or drive the machine from " \
                "another part."
        if self.shared and not blamed:
            nodes = f"these {len(self.shared)} nodes" if len(self.shared) > 1 else "this node"
            return f"Nothing ties {nodes} to a reference: any value fits, as long as all move together.\n" \
                f"{self.decides[:1].upper()}{self.decides[1:]}."
        agree = f", since {listing(blamed)} agree" if blamed else ""
        if len(self.owners) > 1:
            return f"A loop of redundant rigid parts{agree}.\nTake one of {either(self.owners[:4], 'or')} out, or " \
                f"put {self.elastic} in line with one of them."
        return f"Remove or change {either(self.owners[:1]) or 'a part there'}" + (f", or {self.decides}." if self.decides
                                                                                 else ".")


def short_circuit(flat: Flat, owners: Iterable[str]) -> tuple[str, str] | None:
    """Message and advice for the first of the parts, whose equations contradict, with both ports on one node."""
    joined = next(((owner, node) for owner in owners if (node := joined_ports(flat, owner))), None)
    if joined is None:
        return None
    owner, node = joined
    return (f"both ports of '{owner}' are on the same node, '{node}', although '{owner}' prescribes their difference",
            f"Put one port of '{owner}' on another node.")


def joined_ports(flat: Flat, path: str) -> str | None:
    """The node to which both ports of a component with two ports are connected; None for any other component."""
    leaf = flat.expanded.leaves.get(path)
    if leaf is None or leaf.component.composite or len(leaf.component.ports) != 2:
        return None
    return next((junction.path for junction in flat.expanded.junctions.values()
                 if sum(end.leaf == path and end.port in leaf.component.ports for end in junction.ends) == 2), None)


def _without_rates(unknowns: Sequence[Unknown]) -> list[Unknown]:
    """Omit a velocity if the position of the same node is named: for a user they are one quantity."""
    positions = {u.name.rpartition(".")[0] for u in unknowns if u.role == "position"}
    return [u for u in unknowns if not (u.motion and u.name.rpartition(".")[0] in positions)]


def _sharing(flat: Flat, loose: Sequence[Unknown], owners: Iterable[str]) -> str:
    """`and no equation determines how wall.a.f and drive.a.f share the force at node 'ground'.`"""
    through = [u for u in loose if u.role == "through" and any(u.name.startswith(f"{o}.") for o in owners)]
    if not through:
        return ""
    ports = {u.name.rpartition(".")[0] for u in through}
    nodes = list(dict.fromkeys(j.path for j in flat.expanded.junctions.values() for e in j.ends if e.name in ports))
    members = {u.name.rpartition(".")[2] for u in through}
    names = " and ".join(u.name for u in through[:2]) if len(through) <= 2 else listing((u.name for u in through), 4)
    mechanical = all(u.unit.text in ("N", "N*m") for u in through)
    quantity = _noun(through[0].doc) if len(members) == 1 else "the forces" if mechanical else "what flows"
    return f"and no equation determines how {names} share {quantity} at node{'s' * (len(nodes) > 1)} {either(nodes[:3])}."


def _noun(doc: str) -> str:
    """`the force` from a member's description, `force on the component`."""
    return "the " + doc.partition(" on ")[0].partition(" into ")[0] if doc else "what flows"


def _domain(flat: Flat, unknown: Unknown) -> Domain | None:
    """The domain to whose node an across variable or a position belongs."""
    node, _, member = unknown.name.rpartition(".")
    domain = flat.domains.get(node)
    return domain if domain is not None and member in domain.shared else None


def _domains(flat: Flat, unknowns: Iterable[Unknown]) -> list[Domain]:
    """The domains of shared variables, each once."""
    return list({d.name: d for u in unknowns if (d := _domain(flat, u)) is not None}.values())


def bookkeeping(equation: FlatEquation) -> bool:
    """True for the balance of a node, which the assembler generates, and for the value of an input."""
    return equation.role is not EquationRole.LAW


def _table(equations: Sequence[FlatEquation]) -> list[str]:
    rows = [(f"{e.owner}:", e.text, e.label, f"{e.place.file}:{e.place.line}") for e in equations[:MOST_LINES]]
    widths = [max(len(row[k]) for row in rows) for k in range(3)]
    lines = ["  ".join([*(cell.ljust(width) for cell, width in zip(row, widths, strict=False)), row[3]])
             for row in rows]
    if len(equations) > MOST_LINES:
        lines.append(f"and {len(equations) - MOST_LINES} more")
    return lines


class KinkError(ModelError):
    """Equations with a kink would have to be differentiated: their numbers, and how often."""

    def __init__(self, problems: Iterable[Problem] | str, *, hint: str = "", orders: Mapping[int, int] | None = None):
        super().__init__(problems, hint=hint)
        self.orders = dict(orders or {})


def kinked(flat: Flat, orders: Mapping[int, int]) -> KinkError:
    """The error for equations that index reduction must differentiate so often but that have a kink."""
    problems = []
    for i in orders:
        equation = flat.equations[i]
        place: Place = equation.place
        problems.append(Problem(
            "kink-differentiated", f"'{equation.owner}': this equation must be differentiated in time, but "
            f"{equation.kink} has a kink", place,
            "It holds positions or other states together, so its rate is needed. Use a smooth function instead (tanh, "
            "smooth_sign;\nan SCurveMotion for a motion in time), or put between what gives way: a spring, a resistance, "
            "a lag behind a signal."))
    return KinkError(problems, orders=orders)
