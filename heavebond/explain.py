"""Structural mistakes in the words of the diagram: which parts fix the same thing, and what nothing decides."""

from __future__ import annotations

from collections.abc import Sequence

from heavebond.errors import ModelError, Place, Problem, listing
from heavebond.flatten import Flat, FlatEquation
from heavebond.structure import Block, dulmage_mendelsohn


def singular(flat: Flat, rows: Sequence[Sequence[int]], matching: Sequence[int]) -> ModelError:
    """The error for a system whose equations cannot be assigned one to each unknown.

    `rows[i]` lists the unknowns of equation i whatever their derivatives; a Dulmage-Mendelsohn decomposition finds
    the smallest parts with more equations than unknowns, and those with more unknowns than equations.
    """
    parts = dulmage_mendelsohn(rows, len(flat.unknowns), matching)
    problems = [_over(flat, block, parts.underdetermined) for block in parts.overdetermined]
    if not parts.overdetermined:
        problems = [_under(flat, block) for block in parts.underdetermined]
    return ModelError(problems)


def _over(flat: Flat, block: Block, under: Sequence[Block]) -> Problem:
    equations = [flat.equations[i] for i in block.core_rows]
    said = [e for e in equations if not _bookkeeping(e)] or equations
    unknowns = [flat.unknowns[j].name for j in block.core_columns]
    owners = list(dict.fromkeys(e.owner for e in said))
    loose = [flat.unknowns[j].name for b in under for j in b.core_columns if flat.unknowns[j].role == "through"
             and any(flat.unknowns[j].name.startswith(o + ".") for o in owners)]
    notes = [*_table(said)]
    if loose:
        notes.append(f"and nothing decides how {listing(loose, 4)} share what they carry.")
    what = listing(unknowns, 4) or "nothing that is unknown"
    message = f"these {len(said)} equations fix the same unknown{'s' * (len(unknowns) > 1)}, {what}" if len(said) > 1 \
        else f"this equation has no unknown left to decide: {what} is fixed already"
    hint = f"Put {_either(owners)} on different nodes, or remove one of them." if len(owners) > 1 else \
        f"Remove or change '{owners[0]}'."
    return Problem("overdetermined", message, _place(said), hint, tuple(notes))


def _under(flat: Flat, block: Block) -> Problem:
    unknowns = [flat.unknowns[j] for j in block.core_columns]
    across = [u.name for u in unknowns if u.role in ("across", "position")]
    names = listing(across or [u.name for u in unknowns], 6)
    hint = "Add a component that decides it: a Fixed, a Mass, a Tank, a Volume or a source on that node." if across \
        else "An equation is missing there."
    place = unknowns[0].place if unknowns else None
    return Problem("underdetermined", f"nothing decides {names}", place, hint)


def _bookkeeping(equation: FlatEquation) -> bool:
    """A node's own equation, which the assembler wrote and no user can remove."""
    return equation.label.startswith("sum of ") or " is the rate of " in equation.label


def _table(equations: Sequence[FlatEquation]) -> list[str]:
    shown = [(f"{e.owner}:", e.text, e.label, f"{e.place.file}:{e.place.line}") for e in equations[:8]]
    widths = [max(len(row[k]) for row in shown) for k in range(3)]
    lines = ["  ".join([*(cell.ljust(width) for cell, width in zip(row, widths, strict=False)), row[3]])
             for row in shown]
    if len(equations) > 8:
        lines.append(f"and {len(equations) - 8} more")
    return lines


def _either(owners: Sequence[str]) -> str:
    return " and ".join(f"'{o}'" for o in owners[:3]) + (" ..." if len(owners) > 3 else "")


def _place(equations: Sequence[FlatEquation]) -> Place | None:
    return equations[0].place if equations else None


def kinked(flat: Flat, indices: Sequence[int]) -> ModelError:
    """The error for equations that index reduction must differentiate but that have a kink."""
    problems = []
    for i in indices:
        equation = flat.equations[i]
        problems.append(Problem(
            "kink-differentiated", f"'{equation.owner}': this equation must be differentiated in time, but "
            f"{equation.kink} has a kink", equation.place,
            "It constrains positions or other states. Replace the function by a smooth one (smooth_sign, a table "
            "with `smooth`), or write the derivative yourself with der(...).", (equation.text,)))
    return ModelError(problems)
