"""State machines with named states: the `states:` entry of a component, and what it means.

    states:
      rest:   {entry: {v: 0}, to: {rising: button > 0.5}}
      rising: {entry: {v: v_up}, to: {rest: {when: button < 0.5, after: T_min}}}

The first state is active at the start. A transition happens as soon as its state has been active for the time `after` and
its condition holds, also if it holds already when the state is entered; of several at one instant the first in the file
happens. On entry a state gives values to outputs and held variables.

The chart is written out in the language. `state` is held, the number of the active state; `entered` is the time of the last
transition; each state is a variable of its name, 1 while it is active. Every transition is an event `SOURCE_to_TARGET`. A
condition that is true at the start lets no event happen: the held variable `begun` is set at the first instant, and the
conditions contain it. An output is y = e_i in a state whose entry value e_i follows from parameters, else the held `y_kept`,
which a transition sets to the entry value, or to y if the state gives none.

D. Harel, Statecharts: a visual formalism for complex systems, Sci. Comput. Program. 8 (1987) 231-274,
doi:10.1016/0167-6423(87)90035-9.
"""

from __future__ import annotations

from collections.abc import Mapping as Dictionary
from collections.abc import Sequence
from dataclasses import dataclass

from heavebond.core.errors import Place, Problems, either, listing, suggest
from heavebond.core.units import DIMENSIONLESS, Unit, read_unit
from heavebond.language import reading
from heavebond.language.definition import (
    ChartState,
    EquationLine,
    EventDefinition,
    Formula,
    Parameter,
    Port,
    Reset,
    SignalPort,
    Transition,
    Variable,
)
from heavebond.language.when import resets
from heavebond.text.expression import Binary, Call, Compare, Equation, Expr, Logic, Name, Number, names
from heavebond.text.yaml_source import Mapping, Node, Scalar

FORM = "`rest: {entry: {y: 0}, to: {rising: button > 0.5, stopped: {when: alarm > 0.5, after: T}}}`"
STATE, ENTERED, BEGUN, KEPT = "state", "entered", "begun", "_kept"
BEGIN = "begin"  # the event that sets it
BEFORE_ANY_RUN = -1e15  # s
Declared = Port | Variable


def read_states(node: Node | None, problems: Problems) -> tuple[ChartState, ...]:
    """The states of a component in the order of its file; what is wrong with their form or their transitions is noted."""
    entries = reading.mapping(node, "states", problems, f"Write one state a line, {FORM}.")
    if entries is None:
        return ()
    states = []
    for name, item in entries.items.items():
        key = entries.keys[name]
        if not reading.identifier(key, "a state", problems):
            continue
        if (entry := reading.mapping(item, f"state '{name}'", problems, f"Write {FORM}.")) is not None:
            reading.known_keys(entry, ("doc", "entry", "to"), f"state '{name}'", problems)
            targets = reading.mapping(entry.items.get("to"), "to", problems, "Write `to: {rising: button > 0.5}`.")
            transitions = [transition for target, to in (targets.items if targets else {}).items() if targets is not None
                           and (transition := _transition(name, targets.keys[target], to, problems))]
            states.append(ChartState(
                name, key.place, reading.text(entry.items.get("doc"), "doc", problems),
                resets("entry", entry.items.get("entry"), "Write `entry: {y: 0}`.", problems), tuple(transitions)))
    _check_transitions(states, entries, problems)
    return tuple(states)


def _transition(source: str, target: Scalar, item: Node, problems: Problems) -> Transition | None:
    subject = f"the transition from '{source}' to '{target.text}'"
    if not isinstance(item, Mapping):
        condition = reading.formula_of(item, subject, problems)
        return Transition(source, target.text, condition, None, target.place) if condition is not None else None
    reading.known_keys(item, ("when", "after"), subject, problems)
    when, after = (reading.formula_of(item.items[word], word, problems) if word in item.items else None
                   for word in ("when", "after"))
    if not {"when", "after"} & item.items.keys():
        problems.add("state-transition", f"{subject} has no condition and no time", target.place,
                     hint=f"Write `{target.text}: button > 0.5`, `{target.text}: {{after: T}}`, or both, "
                     f"`{target.text}: {{when: button > 0.5, after: T}}`.")
        return None
    return Transition(source, target.text, when, after, target.place)


def _check_transitions(states: Sequence[ChartState], entries: Mapping, problems: Problems) -> None:
    known = {state.name: state for state in states}
    for transition in (t for state in states for t in state.transitions):
        if transition.target not in entries.items:
            problems.add("state-unknown", f"state '{transition.source}' leads to '{transition.target}', which is no state",
                         transition.place, hint=suggest(transition.target, known) or f"States: {listing(known)}.")
        elif transition.target == transition.source and transition.after is None:
            problems.add("state-itself", f"state '{transition.source}' leads to itself without a delay, so that it would "
                         "be entered again and again at one instant", transition.place,
                         hint=f"Give the time that it lasts, `{transition.target}: {{when: ..., after: T}}`.")
    if len(states) < 2:
        problems.add("states-few", "a state machine has two states at least", entries.place, hint=f"Write {FORM}.")
        return
    reached, waiting = set[str](), [states[0].name]
    while waiting:
        if (name := waiting.pop()) in known and name not in reached:
            reached.add(name)
            waiting += [t.target for t in known[name].transitions]
    if lost := [state for state in states if state.name not in reached]:
        problems.add("state-unreachable", f"no transition leads from '{states[0].name}', the first state, to "
                     f"{either(s.name for s in lost)}", lost[0].place,
                     hint=f"Add a transition, `to: {{{lost[0].name}: ...}}`, or remove the state.")


@dataclass(frozen=True)
class WrittenChart:
    """What a chart adds to its component."""

    variables: dict[str, Variable]
    equations: tuple[EquationLine, ...]
    events: tuple[EventDefinition, ...]


def written_out(states: Sequence[ChartState], signals: Dictionary[str, SignalPort], parameters: Dictionary[str, Parameter],
                declared: Dictionary[str, Declared], problems: Problems) -> WrittenChart:
    """A chart in variables, equations and events; `declared` are the ports and variables that the component declares."""
    place, seconds, number = states[0].place, read_unit("s"), {state.name: k for k, state in enumerate(states, 1)}
    held = _held(ENTERED, seconds, place, "time at which the active state was entered"), \
        _held(BEGUN, DIMENSIONLESS, place, "1 after the first instant")
    numbered = "number of the active state: " + ", ".join(f"{k} {name}" for name, k in number.items())
    added = {STATE: Variable(STATE, DIMENSIONLESS, place, numbered, low=1.0, high=float(len(states)), held=1.0),
             **{variable.name: variable for variable in held}}
    for state in states:
        added[state.name] = Variable(state.name, DIMENSIONLESS, state.place,
                                     state.doc or f"1 while the state {state.name} is active", 0.0, 1.0)
    equations = [EquationLine(Equation(_name(state.name), _chosen(k, _number(1), _number(0))),
                              f"{state.name} = if_else({STATE} == {k}, 1, 0)", f"state {state.name}", state.place)
                 for k, state in enumerate(states, 1)]
    outputs: dict[str, str] = {}  # with the held variable of each, if it has one
    for name in (n for n, signal in signals.items() if signal.direction == "out"):
        entries = [state.entry_of(name) for state in states]
        if not any(entries):
            continue
        fixed = [_fixed(entry, parameters) for entry in entries]
        entered = {number[t.target] - 1 for state in states for t in state.transitions if t.target in number}
        keeps = any(fixed[k] is None for k in entered)
        outputs[name] = name + KEPT if keeps else ""
        if keeps:
            added[outputs[name]] = _held(outputs[name], signals[name].unit, place,
                                         f"value of {name} in states that do not fix it")
        if entries[0] is not None and fixed[0] is None:
            problems.add("state-start", f"'{states[0].name}' is active at the start, so its value of '{name}' must follow "
                         "from parameters", entries[0].value.place, hint="Use parameters and plain numbers only, or "
                         "begin in another state: the first one in the file is active at the start.")
        *chosen, (_, value) = [(k, entry) for k, entry in enumerate(fixed, 1) if entry is not None] + \
            ([] if all(fixed) else [(0, _name(outputs[name]) if keeps else _number(0))])
        for k, entry in reversed(chosen):
            value = _chosen(k, entry, value)
        equations.append(EquationLine(Equation(_name(name), value), f"{name} = value of the active state",
                                      f"{name} of the active state", place))
    for name, item in ((n, group[n]) for group in (signals, parameters, declared) for n in added if n in group):
        problems.add("state-name", f"'{name}' is declared, and the state machine has a variable of this name", item.place,
                     hint=f"Take another name. The state machine has {listing(added)}.")
    begin = EventDefinition(BEGIN, "at", Formula(Number(BEFORE_ANY_RUN, seconds, 0), "the start", place), None,
                            (_reset(BEGUN, _number(1), place), _reset(ENTERED, _name("time"), place)), place)
    transitions = [t for state in states for t in state.transitions if t.target in number]
    events = [_event(t, states[number[t.source] - 1], states[number[t.target] - 1], number, outputs, parameters)
              for t in transitions]
    return WrittenChart(added, tuple(equations), (begin, *events))


def _event(transition: Transition, source: ChartState, target: ChartState, number: Dictionary[str, int],
           outputs: Dictionary[str, str], parameters: Dictionary[str, Parameter]) -> EventDefinition:
    """The event of a transition; the transitions above it in its state take precedence."""
    place = next((f.place for f in (transition.when, transition.after) if f is not None), transition.place)
    condition: Expr = Logic("and", _active(number[source.name]), Compare("==", _name(BEGUN), _number(1), 0), 0)
    if transition.after is not None:
        lasted = Binary("-", _name("time"), _name(ENTERED), 0)
        condition = Logic("and", condition, Compare(">", lasted, transition.after.tree, 0), 0)
    if transition.when is not None:
        condition = Logic("and", condition, transition.when.tree, 0)
    sets = [_reset(STATE, _number(number[target.name]), place), _reset(ENTERED, _name("time"), place)]
    for name, held_value in outputs.items():
        entry = target.entry_of(name)
        if held_value and entry is None:
            sets.append(_reset(held_value, _name(name), place))
        elif held_value and entry is not None and _fixed(entry, parameters) is None:
            sets.append(Reset(Formula(_name(held_value), held_value, entry.target.place), entry.value))
    sets += [reset for reset in target.entry if reset.target.text not in outputs]
    above = source.transitions[:source.transitions.index(transition)]
    return EventDefinition(transition.event, "condition", Formula(condition, transition.text, place), None, tuple(sets),
                           transition.place, yields_to=tuple(t.event for t in above))


def _fixed(entry: Reset | None, parameters: Dictionary[str, Parameter]) -> Expr | None:
    """An entry value that follows from parameters alone."""
    if entry is None or any(name.base not in (*parameters, "pi") for name in names(entry.value.tree)):
        return None
    return entry.value.tree


def _held(name: str, unit: Unit, place: Place, doc: str) -> Variable:
    return Variable(name, unit, place, doc, held=0.0)


def _name(text: str) -> Name:
    return Name((text,), 0, len(text))


def _number(value: float) -> Number:
    return Number(float(value), None, 0)


def _active(k: int) -> Compare:
    return Compare("==", _name(STATE), _number(k), 0)


def _chosen(k: int, value: Expr, otherwise: Expr) -> Expr:
    return Call("if_else", (_active(k), value, otherwise), 0)


def _reset(name: str, value: Name | Number, place: Place) -> Reset:
    text = value.text if isinstance(value, Name) else f"{value.value:g}"
    return Reset(Formula(_name(name), name, place), Formula(value, text, place))
