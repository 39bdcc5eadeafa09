"""The differences of two diagrams: parts, values, wires, outputs and settings of the run, before and after."""

from __future__ import annotations

from collections.abc import Mapping

from heavebond.core.presentation import readable
from heavebond.equations.expand import expand_as_far
from heavebond.equations.expanded import Bound, Expanded
from heavebond.equations.parameters import declared
from heavebond.language.definition import FileInput, Value
from heavebond.language.model import Model
from heavebond.text.expression import Number

Entry = dict[str, str]
Values = dict[str, tuple[object, str]]  # by path: what is compared, and the text that is shown


def differences(before: Model, after: Model) -> list[Entry]:
    """The differences from one diagram to another: `about` (part, value, wire, output, start, run), `mark` (added, removed,
    changed), `path`, and the texts `before` and `after`, each value in the unit in which it is written. Equal values in
    different units do not differ. The parts inside a block that only one diagram has are not listed.

    Raises ModelError for a diagram that cannot be read.
    """
    old, new = (expand_as_far(model)[0] for model in (before, after))
    kinds: list[Values] = [{path: (leaf.component.name, leaf.component.name) for path, leaf in e.leaves.items()}
                           for e in (old, new)]
    unequal_parts = {path for path in {**kinds[0], **kinds[1]} if kinds[0].get(path) != kinds[1].get(path)}

    def of_equal_parts(path: str) -> bool:
        """True if the parts around a path are of the same kind in both diagrams."""
        steps = path.split(".")
        return not any(".".join(steps[:k]) in unequal_parts for k in range(1, len(steps)))

    entries: list[Entry] = []
    for about, values in (("part", kinds), ("value", [_values(e) for e in (old, new)]), ("wire", _wires(old, new)),
                          ("output", [_outputs(m) for m in (before, after)]),
                          ("start", [_starts(m) for m in (before, after)]), ("run", [_run(m) for m in (before, after)])):
        first, second = values
        for path in {**first, **second}:
            earlier, later = first.get(path), second.get(path)
            if (earlier and earlier[0]) == (later and later[0]) or (
                    about in ("part", "value", "wire") and not of_equal_parts(path)):
                continue
            mark = "added" if earlier is None else "removed" if later is None else "changed"
            entries.append({"about": about, "mark": mark, "path": path, "before": earlier[1] if earlier else "",
                            "after": later[1] if later else ""})
    return entries


def _values(expanded: Expanded) -> Values:
    """The parameters and the given inputs of all parts."""
    values: Values = {}
    for path, bound, leaf in declared(expanded):
        name = path.removeprefix(f"{leaf.path}.") if leaf is not None else path
        values[path] = _value(bound, leaf.component.parameters[name].unit.text if leaf is not None else "")
    for path, leaf in expanded.leaves.items():
        values |= {f"{path}.{name}": _value(bound, leaf.component.signals[name].unit.text)
                   for name, bound in leaf.inputs.items()}
        values |= {f"{path}.{name}": (number, str(number)) for name, number in leaf.integers.items()}
    return values


def _value(bound: Bound, unit: str) -> tuple[object, str]:
    value = bound.value
    if isinstance(value, FileInput):
        return value.file, value.file.name
    if isinstance(value.expr, Number) and not value.formula:
        return value.expr.value, readable(value.expr.value, unit) if value.si else value.text
    return value.text, value.text


def _wires(old: Expanded, new: Expanded) -> list[Values]:
    """The nodes with the ports that they join; a node with another name but the same ports is the same node."""
    ends = [{path: frozenset(f"{end.leaf}.{end.port}" for end in junction.ends if end.sign > 0)
             for path, junction in expanded.junctions.items()} for expanded in (old, new)]
    names = {joined: path for path, joined in ends[1].items() if path not in ends[0]}
    return [{names.get(joined, path) if path not in ends[1] else path: (joined, ", ".join(sorted(joined)))
             for path, joined in entries.items()} for entries in ends]


def _outputs(model: Model) -> Values:
    return {name: ((output.text, output.unit), f"{output.text} [{output.unit or '1'}]")
            for name, output in model.show.items()}


def _starts(model: Model) -> Values:
    starts: Values = {"start": (model.initial.mode, model.initial.mode)} if model.initial.mode else {}
    for name, condition in model.initial.conditions.items():
        compared, text = _plain(condition.value)
        starts[name] = (condition.guess, compared), f"{'~ ' if condition.guess else ''}{text}"
    return starts


def _run(model: Model) -> Values:
    settings: Mapping[str, Value | None] = {"from": model.begin, "until": model.until, "every": model.every}
    return {name: _plain(value) for name, value in settings.items() if value is not None}


def _plain(value: Value) -> tuple[object, str]:
    return (value.expr.value if isinstance(value.expr, Number) and not value.formula else value.text), value.text
