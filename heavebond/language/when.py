"""The `when:` entries of a component: events with their conditions or times and their assignments."""

from __future__ import annotations

from heavebond.core.errors import Problems
from heavebond.language import reading
from heavebond.language.definition import EventDefinition, Formula, Reset
from heavebond.text.yaml_source import Mapping, Node, Scalar

# first keyword of an entry
KINDS = ("condition", "at", "every")
FORM = "`{condition: x > 0, then: {...}}`, `{at: t_0, then: {...}}` or `{every: T_s, then: {...}}`"


def when_entries(node: Node | None, problems: Problems) -> tuple[EventDefinition, ...]:
    """The events of a component in the order of its file; mistakes in their form are reported."""
    entries = reading.mapping(node, "when", problems, f"Write `name: {FORM.split('`')[1]}`, one event a line.")
    events = []
    for name, item in (entries.items if entries else {}).items():
        key = entries.keys[name] if entries else None
        if key is None or not reading.identifier(key, "an event", problems):
            continue
        entry = reading.mapping(item, f"event '{name}'", problems, f"Write {FORM}.")
        if entry is not None and (event := _event(key, entry, problems)) is not None:
            events.append(event)
    return tuple(events)


def _event(key: Scalar, entry: Mapping, problems: Problems) -> EventDefinition | None:
    subject = f"event '{key.text}'"
    reading.known_keys(entry, (*KINDS, "from", "impulse", "moves", "then", "otherwise"), subject, problems, ("then",))
    kinds = [kind for kind in KINDS if kind in entry.items]
    if len(kinds) != 1:
        defect = "has no condition and no time" if not kinds else f"has `{kinds[0]}:` and `{kinds[1]}:`"
        problems.add("when-form", f"{subject} {defect}", key.place, hint=f"Write {FORM}.")
        return None
    kind = kinds[0]
    if "from" in entry.items and kind != "every":
        problems.add("when-form", f"{subject} has `{kind}:` and `from:`", entry.keys["from"].place,
                     hint="`from:` is the first instant of a periodic event (`every:`); remove it.")
    formula = reading.formula_of(entry.items[kind], kind, problems)
    first = reading.formula_of(entry.items["from"], "from", problems) if "from" in entry.items else None
    resets = _resets(subject, "then", entry, problems)
    impulse = reading.text(entry.items.get("impulse"), "impulse", problems)
    moves = reading.text(entry.items.get("moves"), "moves", problems)
    otherwise = _resets(subject, "otherwise", entry, problems)
    return EventDefinition(key.text, kind, formula, first, resets, key.place, impulse, moves, otherwise) \
        if formula is not None else None


def _resets(subject: str, word: str, entry: Mapping, problems: Problems) -> tuple[Reset, ...]:
    form = f"Write the new values: `{word}: {{contact: 0, a.v: -e * a.v}}`."
    node = entry.items.get(word)
    if isinstance(node, Mapping) and not node.items:
        problems.add("when-empty", f"{subject} sets nothing", node.place, hint=form)
    return resets(word, node, form, problems)


def resets(word: str, node: Node | None, form: str, problems: Problems) -> tuple[Reset, ...]:
    """The variables under a key of a component and the formulas of their values; `form` shows the syntax."""
    entries = reading.mapping(node, word, problems, form)
    resets_read = []
    for name, item in (entries.items if entries else {}).items():
        target = reading.formula_of(entries.keys[name], word, problems) if entries else None
        value = reading.formula_of(item, f"the new value of {name}", problems)
        if target is not None and value is not None:
            resets_read.append(Reset(Formula(target.tree, name, target.place), value))
    return tuple(resets_read)
