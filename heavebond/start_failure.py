"""Why no start was found: what contradicts, what is left open, which value is zero, in the words of the diagram."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from heavebond import explain
from heavebond.dae import Array, Assembly
from heavebond.errors import Problem, Problems, StartError, listing
from heavebond.newton import weights
from heavebond.rank import losses
from heavebond.reduce import Pivot
from heavebond.start_equations import Point, StartEquations, StartSystem

AT = "at the start"
# gradients that depend on each other up to this share, and residuals that then disagree by more than this
DEPENDENT, DISAGREE = 1e-8, 1e-6
# what a hint names at most
MOST_NAMED = 6


def lost(assembly: Assembly, point: Point) -> list[Problem]:
    """What the equations of the diagram leave undecided at a point, whatever is asked of the start."""
    values = point.values()
    if not all(np.all(np.isfinite(v)) for v in values):
        return []
    return explain.lost(assembly.flat, losses(assembly.reduced.system, assembly.point(*values)), AT)


def failure(equations: StartEquations, point: Point, residual: Array, system: StartSystem, sizes: Array) -> StartError:
    """The error for a search that ended at `point` with scaled residuals that are not zero."""
    if problems := lost(equations.assembly, point):
        return StartError(problems)
    rows = system.rows
    order = np.argsort(-np.where(np.isfinite(residual), np.abs(residual), np.inf))[:5]
    raw = system.at(point)[0]
    bad = [k for k in order if not np.isfinite(residual[k])] or \
        [k for k in order if abs(residual[k]) > 1e-3 * abs(residual[order[0]])]
    place = rows[int(bad[0])].place if len(bad) else None
    notes = [f"{rows[k].label}   off by {raw[k]:.3g} (SI)" for k in bad]
    if not np.all(np.isfinite(residual)):
        return StartError([Problem("start-failed", "the start cannot be computed: an equation has no finite value at the "
                                   "first guess", place, _away(equations.assembly, point), tuple(notes))])
    if conflict := _conflict(system, point, sizes):
        settled = _settling(equations, system, point, sizes)
        follow = f"\nOr let a parameter follow: `solve: [{settled[0]}]`" if settled else ""
        more = f", or {listing(settled[1:], MOST_NAMED)}" if len(settled) > 1 else ""
        return StartError([Problem("start-contradiction", "the initial values contradict each other", place,
                                   f"Remove one of them, or make it a guess (`~`).{follow}{more}{'.' if follow else ''}",
                                   tuple(conflict))])
    return StartError([Problem("start-failed", "no consistent initial values were found", place,
                               "Give guesses for the variables in these equations, for example "
                               f"`initial: {{{_example(equations.assembly)}}}`.", tuple(notes))])


def _away(assembly: Assembly, point: Point) -> str:
    """What to type where an equation has no value: the states at zero are the first to be suspected."""
    flat = assembly.flat
    zero = [flat.unknowns[j] for (j, order), value in zip(assembly.reduced.states, point.x, strict=True)
            if order == 0 and value == 0]
    if not zero:
        return f"Give guesses, for example `initial: {{{_example(assembly)}}}`, away from where it has none."
    entries = ", ".join(f"{u.name}: ~ {u.nominal:g} {u.unit.text}".rstrip(" 1") for u in zero[:3])
    return f"{listing((u.name for u in zero), MOST_NAMED)} begin at 0 as nothing else is said; say where they begin, for " \
        f"example `initial: {{{entries}}}`."


def _example(assembly: Assembly) -> str:
    for j, order in assembly.reduced.states:
        if order == 0:
            unknown = assembly.flat.unknowns[j]
            return f"{unknown.name}: ~ {unknown.nominal:g} {unknown.unit.text}"
    return "name: ~ 1 m"


def _dependent(system: StartSystem, point: Point, sizes: Array) -> tuple[Array, Array]:
    """The directions of the weighted rows (m, k) whose gradients depend on each other, and how far each row's residual
    takes part in what disagrees (m,)."""
    residual, jacobian = system.at(point)
    if not np.all(np.isfinite(jacobian)) or not residual.size:
        return np.zeros((len(residual), 0)), np.zeros(len(residual))
    jacobian = jacobian * sizes
    row = weights(residual, jacobian)
    left, values, _ = np.linalg.svd(jacobian * row[:, None])
    rank = int((values > DEPENDENT * max(values.max(initial=0.0), 1e-300)).sum())
    null = left[:, rank:]
    return null * row[:, None], np.abs(null @ (null.T @ (residual * row)))


def _conflict(system: StartSystem, point: Point, sizes: Array) -> list[str]:
    """The equations whose gradients depend on each other while their residuals do not agree."""
    _, share = _dependent(system, point, sizes)
    if not share.size or share.max() < DISAGREE:
        return []
    return [system.rows[k].label for k in np.argsort(-share) if share[k] > 0.1 * share.max()][:8]


def _settling(equations: StartEquations, system: StartSystem, point: Point, sizes: Array) -> list[str]:
    """Parameters of components that would settle a contradiction if they were solved for, those that matter most first."""
    null, _ = _dependent(system, point, sizes)
    assembly = equations.assembly
    own = [k for k, name in enumerate(assembly.parameter_names) if not name.startswith(("initial.", "scale."))
           and "." in name and k not in equations.solved_for and point.p[k] != 0]
    if not own or not null.size:
        return []
    directions = np.zeros((len(point.p), len(own)))
    directions[own, range(len(own))] = point.p[own]
    effect = np.abs(null.T @ system.moved(point, directions)).max(axis=0)
    order = np.argsort(-effect, kind="stable")
    return [assembly.parameter_names[own[k]] for k in order if effect[k] > 1e-6 * max(effect.max(), 1e-300)][:MOST_NAMED]


def undetermined(equations: StartEquations, point: Point, sizes: Array) -> None:
    """StartError for what a steady start, or the parameters that it solves for, leave open."""
    residual, jacobian = equations.with_guesses.at(point)
    if not np.all(np.isfinite(jacobian)):
        return
    jacobian = jacobian * sizes
    row = weights(residual, jacobian)
    _, values, right = np.linalg.svd(jacobian * row[:, None], full_matrices=True)
    null = right[int((values > 1e-10 * max(values.max(initial=0.0), 1e-300)).sum()):]
    assembly = equations.assembly
    solved = [assembly.parameter_names[k] for k in equations.solved_for]
    names = [*assembly.state_names, *assembly.algebraic_names, *solved]
    if not equations.steady:
        null = null[np.abs(null[:, len(names) - len(solved):]).max(axis=1, initial=0.0) > 1e-6] if len(null) else null
    if not len(null):
        return
    notes, suggestions = [], list[str]()
    for direction in null:
        share = np.abs(direction)
        involved = [names[k] for k in np.argsort(-share) if share[k] > 0.1 * share.max()]
        notes.append(f"one of: {listing(involved, MOST_NAMED)}")
        suggestions.append(next((i for i in involved if i not in suggestions and i not in solved), involved[0]))
    raise StartError([_open(assembly, notes, suggestions, solved, equations.steady)])


def _open(assembly: Assembly, notes: list[str], suggestions: list[str], solved: list[str], steady: bool) -> Problem:
    number = len(notes)
    unit = {u.name: u.unit.text for u in assembly.flat.unknowns}
    example = ", ".join(f"{s}: 0 {unit.get(s, '')}".rstrip() for s in suggestions)
    hint = f"Decide {'it' if number == 1 else 'them'}, for example `initial: {{{example}}}`, or give guesses (`~ 0 m`)."
    if not steady:
        return Problem("solve-undetermined", f"nothing decides {listing(solved)} under `solve:`", None,
                       "Each parameter that is solved for needs one condition more, for example "
                       f"`initial: {{{example}}}`; or take it out of `solve:`.", tuple(notes))
    return Problem("start-undetermined", f"the steady state is not unique: {number} direction{'s' if number > 1 else ''} "
                   f"stay{'s' if number == 1 else ''} undetermined", None, hint, tuple(notes))


def singular_loop(assembly: Assembly, point: Point, direction: Array) -> StartError:
    """The error for loops that leave an algebraic unknown undecided along a direction (n_z,)."""
    if problems := lost(assembly, point):
        return StartError(problems)
    share = np.abs(direction)
    names = [assembly.algebraic_names[k] for k in np.argsort(-share) if share[k] > 0.1 * share.max()]
    return StartError([Problem(
        "loop-singular", f"nothing decides {listing(names, MOST_NAMED)} {AT}", None,
        f"The equations hardly change with {listing(names, MOST_NAMED)} there. Give a guess away from that place,\nfor "
        f"example `initial: {{{names[0]}: ~ 1}}`, or a condition that decides it.",
        tuple(f"{e.owner}: {e.text}" for e in assembly.reduced.alg_equations[:6]))])


def check_pivots(assembly: Assembly, found: Sequence[tuple[Pivot, float]], point: Point) -> None:
    """StartError for coefficients that were divided by and are zero, or no numbers."""
    zero = [(pivot, value) for pivot, value in found if value == 0 or not np.isfinite(value)]
    if not zero:
        return
    problems = Problems()
    for problem in lost(assembly, point):
        problems.add(problem.code, problem.message, problem.place, hint=problem.hint, notes=problem.notes)
    if not problems.found:
        for pivot, value in zero:
            equation = pivot.equation
            problems.add("coefficient-zero", f"'{equation.owner}': the coefficient of {pivot.unknown} is {value:g} {AT}",
                         equation.place, notes=[equation.text],
                         hint="A mass, volume, area or resistance is zero there; give it a value, or begin elsewhere.")
    problems.raise_as(StartError)


def check_rates(assembly: Assembly, rates: Array, point: Point) -> None:
    """StartError for states whose rate is no number."""
    problems = Problems()
    for name, value, (j, _) in zip(assembly.state_names, rates, assembly.reduced.states, strict=True):
        if not np.isfinite(value):
            problems.add("rate-not-finite", f"der({name}) has no finite value {AT}", assembly.flat.unknowns[j].place,
                         hint=_away(assembly, point))
    problems.raise_as(StartError)
