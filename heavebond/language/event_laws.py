"""Checks of a component's events and held variables: units, and the variables that may be set."""

from __future__ import annotations

from collections.abc import Iterator

from heavebond.core.errors import Problems, listing, suggest
from heavebond.core.units import ONE, dimension_text, is_generic
from heavebond.language import reading
from heavebond.language.definition import Component, EventDefinition, Formula, Reset
from heavebond.language.state_chart import BEGIN, BEGUN, ENTERED, KEPT, STATE
from heavebond.text.dimensions import SECOND, TRUTH, Lookup, dimension, number_dimension
from heavebond.text.expression import Call, Compare, Expr, ExpressionProblem, Name, children, constant, names
from heavebond.text.shapes import Lengths

EQUALITIES = ("==", "!=")


def check_events(component: Component, lookup: Lookup, lengths: Lengths, problems: Problems) -> None:
    """Report mistakes in the held variables and the events of a component; `lookup` gives the unit of a name."""
    # no equation determines a held variable
    for line in component.equations:
        sides = (line.tree.left, line.tree.right)
        if isinstance(determined := line.tree.left, Name) and determined.text in component.held:
            problems.add("held-equation", f"'{determined.text}' is held, so no equation may determine it",
                         line.place.moved(determined.column, determined.length),
                         hint="Set it under `when:`, or remove `held:` from its declaration. In equations it may occur on "
                              "the right side.")
        for call in (c for side in sides for c in _walk(side) if isinstance(c, Call) and c.function == "der"):
            inner = call.args[0]
            if isinstance(inner, Name) and inner.text in component.held:
                problems.add("held-rate", f"'{inner.text}' is held, so it has no rate",
                             line.place.moved(call.column, 3), hint="Between events der() of it is 0; leave it out.")
    transitions = {t.event: t for state in component.states for t in state.transitions}
    for event in component.when:
        if event.name in transitions or (component.states and event.name == BEGIN):
            continue  # checked as they are written, below
        if event.key == "condition":
            _condition(component, event.formula, lookup, lengths, problems)
        else:
            _instant(component, event, lookup, lengths, problems)
        for reset in event.resets:
            _reset(component, reset, lookup, lengths, problems)
        if event.impulse:
            _impulse(component, event, problems)
        if event.moves or event.otherwise:
            _breakaway(component, event, problems)
    for transition in transitions.values():
        if transition.when is not None:
            _condition(component, transition.when, lookup, lengths, problems)
        if transition.after is not None:
            _time("after", transition.after, "after: T", lookup, lengths, problems)
    for entry in (reset for state in component.states for reset in state.entry):
        # a state sets outputs and held variables
        settable = [*(s.name for s in component.signals.values() if s.direction == "out"),
                    *(name for name in component.held if name not in (STATE, ENTERED, BEGUN) and not name.endswith(KEPT))]
        output = component.signal(entry.target.text)
        if output is not None and output.count is not None:
            problems.add("state-entry", f"`entry:` sets '{entry.target.text}', and {output.name} is a list",
                         entry.target.place, hint="A state sets outputs that are numbers: give each element an output of "
                         "its own, or set a held list and write `y = h` under `equations:`.")
        elif entry.target.text.partition("[")[0] in settable:
            _reset(component, entry, lookup, lengths, problems)
        else:
            problems.add("state-entry", f"`entry:` sets '{entry.target.text}', which is no output and no held variable",
                         entry.target.place, hint=suggest(entry.target.text, settable) or f"There are {listing(settable)}.")
    # an event sets an element of a list, `h[2]`
    set_by = {name.partition("[")[0] for event in component.when
              for name in (event.impulse, *(reset.target.text for reset in (*event.resets, *event.otherwise)))}
    for name, variable in component.held.items():
        if name not in set_by:
            problems.add("held-never-set", f"'{name}' is held, but no event sets it", variable.place,
                         hint=f"Add `when: {{...: {{condition: ..., then: {{{name}: ...}}}}}}`, or make it a parameter.")


def check_initial(component: Component, lookup: Lookup, problems: Problems) -> None:
    """Note initial values of unknown variables or in wrong units."""
    outputs = {name for name, signal in component.signals.items() if signal.direction == "out"}
    for reset in component.initial:
        base = reset.target.text.partition("[")[0]  # of an element of a list
        try:
            if base not in {*component.unknowns, *component.variables, *outputs} - {*component.held}:
                raise ExpressionProblem("initial-given", f"'{reset.target.text}' is not a variable or output of "
                                        f"{component.name} that has an initial value", 0, len(reset.target.text),
                                        f"Name one of {listing(component.variables)}." if component.variables else "")
            if reset.steady:
                continue
            wanted = lookup(Name((base,), 0, len(base))) or ONE
            actual = dimension(reset.value.tree, lookup)
        except ExpressionProblem as problem:
            reading.add_expression_problem(problem, reset.target.place, problems)
            continue
        if actual is not None and actual != wanted and not is_generic(actual) and not is_generic(wanted):
            problems.add("units-differ", f"'{reset.target.text}' is in {dimension_text(wanted)}, its initial value is in "
                         f"{dimension_text(actual)}", reset.value.place, hint="Check the factors of the formula.")


def _walk(expr: Expr) -> Iterator[Expr]:
    yield expr
    for child in children(expr):
        yield from _walk(child)


def _only_parameters(component: Component, name: Name, subject: str) -> None:
    if name.text not in component.parameters and name.text != "pi":
        known = list(component.parameters)
        raise ExpressionProblem("not-a-parameter", f"{subject} must be known before the run, but '{name.text}' is not a "
                                f"parameter of {component.name}", name.column, name.length, suggest(name.text, known)
                                or (f"Parameters: {listing(known)}." if known else "Declare it under `parameters:`."))


def _instant(component: Component, event: EventDefinition, lookup: Lookup, lengths: Lengths, problems: Problems) -> None:
    """Check that `at`, `every` and `from` are times that depend on parameters only, and that a period is above zero."""
    for key, formula in ((event.key, event.formula), ("from", event.first)):
        if formula is None:
            continue
        try:
            for name in names(formula.tree):
                _only_parameters(component, name, f"`{key}:`")
        except ExpressionProblem as problem:
            reading.add_expression_problem(problem, formula.place, problems)
            continue
        is_time = _time(key, formula, "every: T_s", lookup, lengths, problems)
        if is_time and key == "every" and (number := constant(formula.tree)) is not None and number <= 0:
            problems.add("every-not-positive", f"`every: {formula.text}` is not a time above 0", formula.place,
                         hint="Name a parameter in s, as in `every: T_s`.")


def _time(key: str, formula: Formula, example: str, lookup: Lookup, lengths: Lengths, problems: Problems) -> bool:
    """Check that the formula of a key is a number in seconds; `example` is one that would be."""
    try:
        dimension_found = number_dimension(formula.tree, lookup)
        lengths.number(formula.tree, f"`{key}:`")
    except ExpressionProblem as problem:
        reading.add_expression_problem(problem, formula.place, problems)
        return False
    if dimension_found is None or dimension_found == SECOND or is_generic(dimension_found):
        return True
    problems.add("units-differ", f"`{key}:` is a time; this is in {dimension_text(dimension_found)}", formula.place,
                 hint=f"Name a parameter in s, as in `{example}`.")
    return False


def _condition(component: Component, formula: Formula, lookup: Lookup, lengths: Lengths, problems: Problems) -> None:
    try:
        dimension_found = dimension(formula.tree, lookup)
        lengths.number(formula.tree, "a condition")
        if dimension_found != TRUTH:
            raise ExpressionProblem("condition-form", "a condition is a comparison; this is a number", 0, len(formula.text),
                                    f"Write for example `{formula.text} > 0`.")
        for part in _walk(formula.tree):
            if isinstance(part, Compare) and part.op in EQUALITIES:
                # equality of continuous variables is refused: a moving value passes the other in no time; held variables
                # and parameters may be compared
                still = {*component.held, *component.parameters, "pi"}
                for name in (n for side in (part.left, part.right) for n in names(side) if n.text not in still):
                    raise ExpressionProblem("condition-equality", f"'{name.text}' varies continuously and equals another "
                                            "value at an instant only", part.column, 2,
                                            "Compare with `>` or `<`: the event occurs when it passes the value.")
    except ExpressionProblem as problem:
        reading.add_expression_problem(problem, formula.place, problems)


def _reset(component: Component, reset: Reset, lookup: Lookup, lengths: Lengths, problems: Problems) -> None:
    target = reset.target.tree
    if not isinstance(target, Name):
        problems.add("reset-form", f"'{reset.target.text}' cannot be set by an event", reset.target.place,
                     hint=_settable(component))
        return
    try:
        wanted = lookup(target)
        # parameters, the time and inputs are determined from outside
        signal = component.signals.get(target.text)
        if target.text in component.parameters or target.text in ("time", "pi") or \
                (signal is not None and signal.direction == "in"):
            raise ExpressionProblem("reset-given", f"an event cannot set '{target.text}'", target.column, target.length,
                                    _settable(component))
    except ExpressionProblem as problem:
        reading.add_expression_problem(problem, reset.target.place, problems)
        return
    try:
        actual = number_dimension(reset.value.tree, lookup)
        lengths.assigned(target, reset.value.tree)
    except ExpressionProblem as problem:
        reading.add_expression_problem(problem, reset.value.place, problems)
        return
    if None not in (actual, wanted) and actual != wanted and not is_generic(actual or ONE) and not is_generic(wanted or ONE):
        problems.add("units-differ", f"'{target.text}' is in {dimension_text(wanted or ONE)}, its new value is in "
                     f"{dimension_text(actual or ONE)}", reset.value.place,
                     hint="Check the factors of the formula.")


def _impulse(component: Component, event: EventDefinition, problems: Problems) -> None:
    """Check that an impulse belongs to a held variable that is 0 between events and occurs in the equations, and that it
    changes one variable of the component."""
    force = component.held.get(event.impulse)
    speeds = [reset.target.text for reset in event.resets if reset.target.text not in component.held]
    if force is None or force.held or force.count is not None:
        problems.add("impulse-form", f"`impulse: {event.impulse}` is not a held variable that starts at 0", event.place,
                     hint=f"Declare it, `{event.impulse}: {{unit: N, held: 0}}`, and add it to the force of the contact in "
                     "the equations.")
    elif any(reset.target.text == event.impulse for one in component.when for reset in one.resets):
        problems.add("impulse-form", f"'{event.impulse}' is the force of an impact, so no event sets it", event.place,
                     hint="Leave it out of `then:`; apart from the instant of the impact it is 0.")
    elif not any(name.text == event.impulse for line in component.equations for side in (line.tree.left, line.tree.right)
                 for name in names(side)):
        problems.add("impulse-form", f"'{event.impulse}' occurs in no equation, so its impulse has no effect", event.place,
                     hint="Add it to the force of the contact in the equations.")
    if len(speeds) != 1:
        problems.add("impulse-form", f"the impulse of '{event.name}' changes one variable; `then:` has "
                     f"{listing(speeds) if speeds else 'none that is not held'}", event.place,
                     hint="Write the new value of the relative speed, `then: {v: -e*v}`, in addition to held variables.")


def _breakaway(component: Component, event: EventDefinition, problems: Problems) -> None:
    """Check that a breakaway names the speed that it may change, and otherwise sets a held variable, which starts at 0,
    to 1 or -1.
    """
    calls = [call for line in component.equations for side in (line.tree.left, line.tree.right) for call in _walk(side)]
    rated = {call.args[0].text for call in calls
             if isinstance(call, Call) and call.function == "der" and isinstance(call.args[0], Name)}
    limits = [component.held.get(reset.target.text) for reset in event.otherwise]
    values = [constant(reset.value.tree) for reset in event.otherwise]
    if event.key != "condition" or event.impulse or event.moves not in rated:
        problems.add("breakaway-form", f"event '{event.name}' has `moves: {event.moves}`, which is not a speed whose rate "
                                       "is "
                     "in the equations", event.place, hint="Give the sliding speed of the contact, `moves: v`, in an "
                                                           "event with a `condition:`; the law of the stuck contact "
                                                           "contains `der(v)`.")
    elif len(limits) != 1 or limits[0] is None or limits[0].held or values[0] not in (1, -1):
        problems.add("breakaway-form", f"event '{event.name}' has `moves:`, and its `otherwise:` does not set one held "
                     "variable that starts at 0 to 1 or -1", event.place, hint="Declare `limit: {unit: 1, held: 0, min: -1, "
                     "max: 1}`, let the force be `limit*F_s` while it is not 0, and write `otherwise: {limit: 1}`.")


def _settable(component: Component) -> str:
    held = listing(component.held)
    return "An event sets held variables" + (f" ({held})" if held else "") + " and states."
