"""Messages on a start that was not found: contradictory conditions, undetermined unknowns and zero divisors, by the names of
the diagram."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from heavebond.core.errors import Place, Problem, Problems, StartError, listing
from heavebond.core.presentation import readable
from heavebond.equations import structural_messages
from heavebond.equations.block_solver import Pivot
from heavebond.equations.lost_rank import assumed, losses
from heavebond.language.library import is_bundled
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.matrices import dense, finite, null_space, scaled
from heavebond.numerics.mechanism_messages import dead_centre, redundant_loop
from heavebond.numerics.newton import weights
from heavebond.numerics.pointwise import missing
from heavebond.numerics.start_equations import INITIALISATION, Point, StartEquations, StartRow, StartSystem
from heavebond.text.expression import constant

AT = "at the start"
MOST_NAMED = 6
UNIT_LENGTH = 1e-3  # error of a unit quaternion that is rounded to three digits

# what brings a state to rest, by its unit
BALANCES = {"m": "a Fixed, a Spring", "m/s": "a Fixed, a Spring, a Damper", "rad": "a FixedShaft, a TorsionSpring",
            "rad/s": "a FixedShaft, a RotationalDamper", "Pa": "a way out to a Tank or an Atmosphere",
            "K": "a way for the heat, a ThermalResistance to an Ambient", "V": "a Resistor", "A": "a Resistor"}


def lost(assembly: Assembly, point: Point) -> list[Problem]:
    """The unknowns that the equations of the diagram leave undetermined at a point, for any requirements on the start."""
    values = point.values()
    if not all(np.all(np.isfinite(v)) for v in values):
        return []
    rank_losses = losses(assembly.reduced.system, assembly.point(*values))
    if rank_losses and (problem := redundant_loop(assembly)):
        return [problem]
    if rank_losses and not any(loss.parameters or loss.variables
                               for loss in rank_losses) and (problem := dead_centre(assembly)):
        return [problem]
    return structural_messages.lost(assembly.flat, rank_losses, AT)


def failure(equations: StartEquations, point: Point, residual: Array, system: StartSystem, sizes: Array) -> StartError:
    """The error for a search that ended at `point` with scaled residuals that are not zero."""
    if problems := _quaternions(equations) or lost(equations.assembly, point):
        return StartError(problems)
    rows = system.rows
    order = np.argsort(-np.where(np.isfinite(residual), np.abs(residual), np.inf))[:5]
    raw = system.at(point)[0]
    bad = [k for k in order if not np.isfinite(residual[k])] or \
        [k for k in order if abs(residual[k]) > 1e-3 * abs(residual[order[0]])]
    place = rows[int(bad[0])].place if len(bad) else None
    notes = [f"{rows[k].label}   off by {raw[k]:.3g} (SI)" for k in bad]
    if not np.all(np.isfinite(residual)):
        hint, zero = _cure(equations.assembly, point, lambda p: bool(np.all(np.isfinite(system.at(p)[0]))))
        return StartError([Problem("start-failed", "the start cannot be computed: an equation has no finite value at the "
                                   "first guess", zero or place, hint, tuple(notes))])
    numbers = _conflict(system, point, sizes)
    if len(numbers) == 1 and (problem := _unmoved(equations, system, point, numbers[0])):
        return StartError([problem])
    conflict = [rows[k] for k in numbers]
    loop_rows = {id(row) for row in equations.loops}
    if any(id(row) not in loop_rows for row in conflict):  # the diagram's own equations are no values to be removed
        settled = _settling(equations, system, point, sizes)
        follow = f"\nOr let a parameter follow: `solve: [{settled[0]}]`" if settled else ""
        more = f", or {listing(settled[1:], MOST_NAMED)}" if len(settled) > 1 else ""
        follow += f"{more}." if follow else ""
        return StartError([_contradiction(equations, point, conflict, follow)])
    if ends := _at_bounds(equations, point):
        return StartError([Problem("start-bound", "no consistent initial values were found within the bounds", place,
                                   "Ask for something else, or let another parameter follow under `solve:`.",
                                   (*ends, *notes))])
    if bad and all(rows[k].steady for k in bad):
        return StartError([_no_rest(equations, point, [rows[k] for k in bad])])
    return StartError([Problem("start-failed", "no consistent initial values were found", place,
                               "Give guesses for the variables in these equations, for example "
                               f"`initial: {{{_example(equations.assembly)}}}`.", tuple(notes))])


def _quaternions(equations: StartEquations) -> list[Problem]:
    """The required orientations that are no unit quaternion."""
    assembly, problems = equations.assembly, list[Problem]()
    conditions = {c.name: c for c in equations.initial.conditions.values() if not c.guess}
    for domain in assembly.model.library.domains.values():
        for frame in dict.fromkeys(name.rpartition(".")[0] for name in conditions if domain.orientation):
            members = [f"{frame}.{member}" for member in domain.orientation]
            required = [c for name in members if (c := conditions.get(name)) is not None]
            if not required or any(name not in assembly.flat.names for name in members):
                continue
            values = [constant(c.value.expr) for c in required]
            length = float(np.linalg.norm([v for v in values if v is not None]))
            if None in values or (length < 1 + UNIT_LENGTH and (len(required) < 4 or length > 1 - UNIT_LENGTH)):
                continue
            hint = "Remove them. To set an orientation, add a SpatialSensor to the node and give its angles, for example " \
                "`attitude.pitch: 20 deg`."
            problems.append(Problem(
                "start-quaternion", f"{listing(c.name for c in required)}: the length of the quaternion is "
                f"{'' if len(required) == len(members) else 'at least '}{length:.4g} in place of 1", required[0].place,
                hint))
    return problems


def _cure(assembly: Assembly, point: Point, finite: Callable[[Point], bool]) -> tuple[str, Place | None]:
    """Suggest the input line that would determine an undetermined variable, with its location: a value of zero that must
    differ."""
    flat = assembly.flat
    states = [k for k, (_, order) in enumerate(assembly.reduced.states) if order == 0 and point.x[k] == 0]
    # a default of 0 of the library is right everywhere
    numbers = [k for k, name in enumerate(assembly.parameter_names) if point.p[k] == 0
               and (leaf := flat.expanded.leaves.get(name.rpartition(".")[0])) is not None
               and not (assumed(flat, name) and is_bundled(leaf.component.path))]
    cured = [k for k in numbers if finite(replace(point, p=_with_change(point.p, k, 1.0)))]
    if cured:
        names = listing((assembly.parameter_names[k] for k in cured), MOST_NAMED)
        return f"{names} {'is' if len(cured) == 1 else 'are'} 0: give it another value.", flat.parameters[cured[0]].place
    together = point.p.copy()
    together[numbers] = 1.0
    if numbers and finite(replace(point, p=together)):
        return f"Some of {listing((assembly.parameter_names[k] for k in numbers), MOST_NAMED)} may not be 0: give them " \
            "other values.", flat.parameters[numbers[0]].place
    begun = [k for k in states if finite(replace(point, x=_with_change(point.x, k, assembly.x_nominal[k])))]
    if not begun and finite(replace(point, t=point.t + INITIALISATION.just_after)):
        return "It has one just after the start: an equation divides by the time, or takes the root or logarithm of an " \
            "expression that is 0 at the start. Write it such that it has a value at the start, too.", None
    begun = begun or states
    if not begun:
        return f"Give guesses, for example `initial: {{{_example(assembly)}}}`, at which it has a value.", None
    unknowns = [flat.unknowns[assembly.reduced.states[k][0]] for k in begun]
    entries = ", ".join(f"{u.name}: ~ {u.nominal:g} {u.unit.text}" for u in unknowns[:3])
    return f"{listing((u.name for u in unknowns), MOST_NAMED)} begin{'s' * (len(unknowns) == 1)} at 0, at which it has " \
        f"no value; begin at another value, for example `initial: {{{entries}}}`.", unknowns[0].place


def _with_change(values: Array, k: int, by: float) -> Array:
    values = values.copy()
    values[k] += by
    return values


def _example(assembly: Assembly) -> str:
    for j, order in assembly.reduced.states:
        if order == 0:
            unknown = assembly.flat.unknowns[j]
            return f"{unknown.name}: ~ {unknown.nominal:g} {unknown.unit.text}"
    return "name: ~ 1 m"


def _dependent(system: StartSystem, point: Point, sizes: Array) -> tuple[Array, Array]:
    """The directions of the weighted rows (m, k) with dependent gradients, and the share of each row (m,) in the
    contradictory residual."""
    residual, jacobian = system.at(point)
    if not finite(jacobian) or not residual.size:
        return np.zeros((len(residual), 0)), np.zeros(len(residual))
    jacobian = scaled(jacobian, None, sizes)
    row = weights(residual, jacobian)
    null = null_space(scaled(jacobian, row).T, INITIALISATION.dependent)
    return null * row[:, None], np.abs(null @ (null.T @ (residual * row)))


def _at_bounds(equations: StartEquations, point: Point) -> list[str]:
    """The sentence on unknowns that the search has pushed to a declared bound."""
    assembly = equations.assembly
    low, high = equations.bounds
    y = np.concatenate([point.x, point.z, point.p[equations.solved_for]])
    columns = [*assembly.reduced.states, *assembly.reduced.algebraic]
    names = [*assembly.state_names, *assembly.algebraic_names, *(assembly.parameter_names[k] for k in equations.solved_for)]
    units = [*(assembly.flat.unknowns[j].unit.text for j, _ in columns),
             *(assembly.flat.parameters[k].unit.text for k in equations.solved_for)]
    return [f"{name} was pushed to its {'lowest' if value <= a else 'highest'} value, {readable(value, unit, 6)}"
            for name, value, a, b, unit in zip(names, y, low, high, units, strict=True) if value <= a or value >= b]


def _unmoved(equations: StartEquations, system: StartSystem, point: Point, row: int) -> Problem | None:
    """A condition without a gradient at the point, though it depends on unknowns that have one elsewhere: the force of an
    open contact, the flow through a shut valve. None if it has a gradient, or if other conditions determine it."""
    assembly, row_asked = equations.assembly, system.rows[row]
    standing = system.standing(row)
    if row_asked.name not in assembly.flat.names or not standing or np.any(dense(system.at(point)[1][[row]])):
        return None
    solved = [assembly.parameter_names[k] for k in equations.solved_for]
    names = [*assembly.state_names, *assembly.algebraic_names, *solved]
    units = {p.name: p.unit.text for p in assembly.flat.parameters}
    j = assembly.flat.names[row_asked.name]
    value = float(np.array(assembly.values(*point.values())).ravel()[j])
    known = {name: v for name, v in zip(assembly.parameter_names, point.p, strict=True) if name in solved}
    first = [f"{name} (tried from {readable(float(known[name]), units[name], 4)}: `set: {{{name}: ...}}`)"
             for name in (names[k] for k in standing) if name in known]
    fixed = {c.name for c in equations.initial.conditions.values() if not c.guess}
    guesses = [name for name in (names[k] for k in standing) if name not in known and name not in fixed]
    if not first and not guesses:
        return None
    unknowns = {n: assembly.flat.unknowns[assembly.flat.names[n]].unit.text for n in guesses if n in assembly.flat.names}
    speeds = {f"{unit}/s" for unit in unknowns.values()}  # they follow from the places
    guesses = [n for n in guesses if unknowns.get(n) not in speeds]
    begin = [*([f"a guess (`~`) for {listing(guesses, 3)}"] if guesses else []),
             *([f"another first value for {listing(first, 3)}"] if first else [])]
    return Problem("start-unmoved", f"{row_asked.label} was not reached: at the end of the search it is "
                   f"{readable(value, assembly.flat.unknowns[j].unit.text, 6)}, and small changes have no effect on it",
                   row_asked.place, "An open contact and a shut valve behave like this. Begin where it acts: give "
                   f"{', or '.join(begin)}.")


def _contradiction(equations: StartEquations, point: Point, conflict: Sequence[StartRow], follow: str) -> Problem:
    place = next((row.place for row in conflict if row.name), conflict[0].place)
    notes = (*(row.label for row in conflict), *_at_bounds(equations, point))
    alone = conflict[0]
    assembly = equations.assembly
    if (moving := [row for row in conflict if row.steady]) and not any(row.name for row in conflict):
        return _no_rest(equations, point, moving)
    if len(conflict) > 1 or alone.name not in assembly.flat.names:
        return Problem("start-contradiction", "the initial values contradict each other", place,
                       f"Remove one of them, or make it a guess (`~`).{follow}", notes)
    j = assembly.flat.names[alone.name]
    value = float(np.array(assembly.values(*point.values())).ravel()[j])
    return Problem("start-contradiction", f"{alone.label} cannot hold: the diagram itself decides it, "
                   f"{readable(value, assembly.flat.unknowns[j].unit.text, 6)}", place,
                   f"Leave it out of `initial:`, or change the part that holds it.{follow}")


def _no_rest(equations: StartEquations, point: Point, conflict: Sequence[StartRow]) -> Problem:
    """The message on rates that no state can make zero."""
    raw = dict(zip(equations.all.rows, equations.all.at(point)[0], strict=True))
    assembly = equations.assembly
    units = {f"steady: der({name}) = 0": (assembly.flat.unknowns[j].unit.text + "/s" * (order + 1)).replace("/s/s", "/s**2")
             for name, (j, order) in zip(assembly.state_names, assembly.reduced.states, strict=True)}
    rates = (f"{row.label.removeprefix('steady: ').removesuffix(' = 0')} stays at {raw[row]:.4g} {units[row.label]}"
             for row in conflict)
    # a steady start holds an input that a file or a formula in time drives at its first value
    flat = assembly.flat
    values = np.array(assembly.values(*point.values())).ravel()
    driven = [f"{leaf.path}.{name}" for leaf in flat.expanded.leaves.values() for name, bound in leaf.inputs.items()
              if bound.varies]
    notes = (*rates, *_at_bounds(equations, point), *(
        f"{name} is held at {readable(float(values[j]), flat.unknowns[j].unit.text, 4)}, its value at the start"
        for name in driven if (j := flat.names.get(name)) is not None))
    return Problem("start-unsteady", "this machine has no steady state, or none that can be reached from the guess",
                   conflict[0].place, f"Something must hold or balance what moves there{_balances(equations, conflict)}."
                   "\nOr begin without `start: steady`, or give guesses (`~`) near the equilibrium.", notes)


def _balances(equations: StartEquations, conflict: Sequence[StartRow]) -> str:
    """`: a Spring or a Fixed`, for a part that cannot be at rest."""
    flat, moving = equations.assembly.flat, " ".join(row.label for row in conflict)
    kinds = [BALANCES[unit] for j, _ in equations.assembly.reduced.states
             if (unit := flat.unknowns[j].unit.text) in BALANCES and f"({flat.unknowns[j].name})" in moving]
    return f": {'; '.join(dict.fromkeys(kinds))}" if kinds else ""


def _conflict(system: StartSystem, point: Point, sizes: Array) -> list[int]:
    """The message on equations with dependent gradients and contradictory residuals."""
    _, share = _dependent(system, point, sizes)
    if not share.size or share.max() < INITIALISATION.disagree:
        return []
    # equal shares, which differ by rounding, in the order of the file
    order = np.argsort(-np.round(share / share.max(), 6), kind="stable")
    # what the user asked for is told whatever its share, as it can be taken back
    is_condition = [bool(system.rows[k].name) for k in range(len(share))]
    return [int(k) for k in order if share[k] > (1e-4 if is_condition[k] else 0.1) * share.max()][:8]


def _settling(equations: StartEquations, system: StartSystem, point: Point, sizes: Array) -> list[str]:
    """Parameters of components that would settle a contradiction if they were solved for, those that matter most first."""
    null, _ = _dependent(system, point, sizes)
    assembly, flat = equations.assembly, equations.assembly.flat
    adjustable = [k for k, name in enumerate(assembly.parameter_names) if not name.startswith(("initial.", "scale.",
                                                                                               "history."))
                  and "." in name and k not in equations.solved_for]
    if not adjustable or not null.size:
        return []
    usual = {u.unit.dimension: u.nominal for u in flat.unknowns}
    directions = np.zeros((len(point.p), len(adjustable)))
    directions[adjustable, range(len(adjustable))] = [abs(point.p[k]) or usual.get(flat.parameters[k].unit.dimension,
                                                                                   0.0) for k in adjustable]
    effect = np.abs(null.T @ system.moved(point, directions)).max(axis=0)
    dimensions = {flat.unknowns[flat.names[row.name]].unit.dimension for row in system.rows if row.name in flat.names}

    def rank(k: int) -> tuple[bool, bool, float]:  # a length for a position, what the diagram itself gives, what does most
        name = assembly.parameter_names[adjustable[k]]
        unlike = flat.parameters[adjustable[k]].unit.dimension not in dimensions
        return unlike, assumed(flat, name), -float(effect[k])

    chosen = sorted((k for k in range(len(adjustable)) if effect[k] > 1e-6 * max(effect.max(), 1e-300)), key=rank)
    return [assembly.parameter_names[adjustable[k]] for k in chosen[:MOST_NAMED // 2]]


def undetermined(equations: StartEquations, point: Point, sizes: Array) -> tuple[str, ...]:
    """StartError for undetermined directions of a steady start, or of the parameters under `solve:`. Pressures of shut
    volumes are free: they keep their guess, and their names are returned."""
    residual, jacobian = equations.with_guesses.at(point)
    if not finite(jacobian):
        return ()
    jacobian = scaled(jacobian, None, sizes)
    null = null_space(scaled(jacobian, weights(residual, jacobian)), INITIALISATION.undetermined).T
    assembly = equations.assembly
    solved = list(equations.initial.solve)
    names = [*assembly.state_names, *assembly.algebraic_names, *(assembly.parameter_names[k] for k in equations.solved_for)]
    begin = len(assembly.state_names) + len(assembly.algebraic_names)
    if not equations.steady:
        solved_for = np.abs(null[:, begin:begin + len(solved)]).max(axis=1, initial=0.0) > 1e-6
        null = null[solved_for] if len(null) else null
    if not len(null):
        return ()
    shut_in = [name for name, share in zip(names, np.abs(null).max(axis=0), strict=True) if share > INITIALISATION.share]
    # the states that are pressures of oil or gas: in the domains with `fills:`
    members = {domain.across[0] for domain in assembly.model.library.domains.values() if domain.fills}
    if set(shut_in) <= {name for (j, _), name in zip(assembly.reduced.states, assembly.state_names, strict=True)
                        if assembly.flat.unknowns[j].role == "across" and name.rpartition(".")[2] in members}:
        return tuple(shut_in)
    notes, suggestions = [], list[str]()
    for direction in null:
        share = np.abs(direction)
        involved = [names[k] for k in np.argsort(-share) if share[k] > 0.1 * share.max()]
        if open_ := [name for name in involved if name in solved]:
            # the parameters under `solve:` without an equation that determines them, and the variables that would follow
            # them
            followers = [name for name in involved if name not in solved]
            place = equations.assembly.model.initial.solve[open_[0]]
            steady = "" if equations.steady else "`start: steady`, or "
            *more, last = followers[:MOST_NAMED] or ["a variable that it brings about"]
            follower = " or ".join(filter(None, [", ".join(more), last]))
            raise StartError([Problem("solve-undetermined", f"no equation determines {listing(open_)} under `solve:`", place,
                                      "Each parameter that is solved for needs one condition more under `initial:`: "
                                      f"{steady}a value of {follower}.\nOr take it out of `solve:`.")])
        notes.append(f"one of: {listing(involved, MOST_NAMED)}")
        suggestions.append(next((i for i in involved if i not in suggestions), involved[0]))
    number, index_of = len(notes), equations.assembly.flat.names
    guess, unknowns = equations.guess(point.p), equations.assembly.flat.unknowns
    values = [readable(float(guess[j]), unknowns[j].unit.text, 6) if (j := index_of.get(s)) is not None else "0"
              for s in suggestions]
    example = ", ".join(f"{name}: {value}" for name, value in zip(suggestions, values, strict=True))
    hint = f"Decide {'it' if number == 1 else 'them'}, for example `initial: {{{example}}}`, or give guesses " \
        f"(`~ {values[0]}`)."
    directions = f"{number} directions stay" if number > 1 else f"{number} direction stays"
    raise StartError([Problem("start-undetermined", f"the steady state is not unique: {directions} undetermined", None, hint,
                              tuple(notes))])


def singular_loop(assembly: Assembly, point: Point, direction: Array) -> StartError:
    """The error for loops that leave an algebraic unknown undetermined along a direction (n_z,)."""
    if problems := lost(assembly, point):
        return StartError(problems)
    share = np.abs(direction)
    names = [assembly.algebraic_names[k] for k in np.argsort(-share) if share[k] > 0.1 * share.max()]
    return StartError([Problem(
        "loop-singular", f"no equation determines {listing(names, MOST_NAMED)} {AT}", None,
        f"The equations hardly change with {listing(names, MOST_NAMED)} there. Give a guess away from that place,\nfor "
        f"example `initial: {{{names[0]}: ~ 1}}`, or a condition that decides it.",
        tuple(f"{e.owner}: {e.text}" for e in assembly.reduced.alg_equations[:6]))])


def check_pivots(assembly: Assembly, pivots: Sequence[tuple[Pivot, float]], point: Point) -> None:
    """Raise StartError for divisors that are zero or not finite."""
    zero = [(pivot, value) for pivot, value in pivots if (value == 0 and not pivot.derived) or not np.isfinite(value)]
    if not zero:
        return
    problems = Problems()
    for problem in lost(assembly, point):
        problems.add(problem.code, problem.message, problem.place, hint=problem.hint, notes=problem.notes)
    if not problems.found:
        hint, place = _cure(assembly, point, lambda p: _sound(assembly, p))
        for pivot, value in zero:
            equation = pivot.equation
            problems.add("coefficient-zero", f"'{equation.owner}': the coefficient of {pivot.unknown} is {value:g} {AT}",
                         place or equation.place, notes=[equation.text], hint=hint)
    problems.raise_as(StartError)


def _sound(assembly: Assembly, point: Point) -> bool:
    """Whether all coefficients are numbers other than zero, but for those on which no motion depends."""
    pivots = np.array(assembly.pivots(*point.values())).ravel()
    return all(np.isfinite(v) and (v != 0 or q.derived)
               for v, q in zip(pivots, assembly.reduced.pivots, strict=True))


def check_values(assembly: Assembly, point: Point) -> None:
    """Raise StartError for variables and rates of states that are not finite, except for undetermined ones that have no
    effect on the motion."""
    def values(at: Point) -> Array:
        rates = np.array(assembly.rates(*at.values())[0]).ravel()
        return np.concatenate([np.array(assembly.values(*at.values())).ravel(), rates])

    unknowns, first = assembly.flat.unknowns, values(point)
    bad = ~np.isfinite(first)
    if bad.any():
        columns = [np.reshape(v, (-1, 1)) for v in point.values()]
        bad[:len(unknowns)] &= ~missing(assembly, range(len(unknowns)), columns, first[:len(unknowns), None])[:, 0]
    if not bad.any():
        return
    pivots = np.array(assembly.pivots(*point.values())).ravel()
    if any(q.derived and v == 0 for v, q in zip(pivots, assembly.reduced.pivots, strict=True)) and \
            (problems := lost(assembly, point)):
        raise StartError(problems)
    for u, value in zip(unknowns, first, strict=False):
        if u.plausible.beyond and value < u.low:
            leaf, advice = assembly.flat.expanded.leaves.get(u.name.rpartition(".")[0]), u.plausible.beyond
            raise StartError([Problem("value-not-finite", f"{u.name} ({u.doc}) is {readable(value, u.unit.text, 4)} {AT}",
                                      leaf.place if leaf else u.place, f"{advice[0].upper()}{advice[1:]}.")])
    names = [*(u.name for u in unknowns), *(f"der({name})" for name in assembly.state_names)]
    places = [*(u.place for u in unknowns), *(unknowns[j].place for j, _ in assembly.reduced.states)]
    wrong = [k for k in range(len(names)) if bad[k]]
    listed = listing((names[k] for k in wrong), MOST_NAMED)
    hint, place = _cure(assembly, point, lambda p: bool(np.isfinite(values(p)).sum() > (~bad).sum()))
    raise StartError([Problem("value-not-finite", f"{listed} {'has' if len(wrong) == 1 else 'have'} no finite value {AT}",
                              place or places[wrong[0]], hint)])
