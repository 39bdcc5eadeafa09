"""Published numbers for comparison with a study: per source, quantity and case.

    compare_with:
      published:
        WOB variation: {with: [15 kN, 6.2 kN, 2.1 kN], without: [15 kN, 7.1 kN, 1.1 kN]}
        controller.K_p: {0.75 Hz: {with: 3.02 1/m, without: 6.15 1/m}}
        frequency: 0.23 Hz

A mapping names levels of an axis, a list follows the first remaining axis, a single quantity holds for all remaining
axes; `-` marks a missing number.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

from heavebond.core.errors import Place, Problems, listing, suggest
from heavebond.core.units import AS_QUANTITY, Unit, UnitProblem, parse_quantity, read_unit
from heavebond.language import reading
from heavebond.studies.axes import Axis
from heavebond.text.yaml_source import Mapping as Entries
from heavebond.text.yaml_source import Node, Scalar
from heavebond.text.yaml_source import Sequence as Items

NONE = "-"


@dataclass(frozen=True)
class Published:
    """A number in SI, its unit in the file, and its place."""

    value: float
    unit: Unit
    place: Place


@dataclass(frozen=True)
class ReferenceValues:
    """The numbers of one source: by quantity, by the index of the case."""

    source: str
    numbers: Mapping[str, Mapping[tuple[int, ...], Published]]

    def at(self, quantity: str, index: tuple[int, ...]) -> float | None:
        """The number in SI, None if the source has none."""
        published_value = self.numbers.get(quantity, {}).get(index)
        return published_value.value if published_value is not None else None


def read_beside(node: Node | None, axes: Sequence[Axis], quantities: Sequence[str], problems: Problems
                ) -> tuple[ReferenceValues, ...]:
    """The sources under `compare_with:`; `quantities` are the permitted names."""
    sources = reading.mapping(node, "compare_with", problems, "Write `published: {QUANTITY: NUMBER}`.")
    source_list = []
    for source, item in (sources.items if sources else {}).items():
        entries = reading.mapping(item, f"'{source}'", problems,
                                  "Write one quantity a line: `WOB variation: [15 kN, 6 kN]`.")
        numbers = {}
        for name, entry in (entries.items if entries else {}).items():
            if name not in quantities:
                problems.add("quantity-unknown", f"'{name}' is neither measured nor tuned in this study",
                             entries.keys[name].place if entries else entry.place,
                             hint=suggest(name, quantities) or f"Known: {listing(quantities)}.")
                continue
            numbers[name] = dict(read_cases(entry, name, axes, problems))
        source_list.append(ReferenceValues(source, numbers))
    return tuple(source_list)


def read_cases(node: Node, name: str, axes: Sequence[Axis], problems: Problems
               ) -> Iterator[tuple[tuple[int, ...], Published]]:
    """Each index of a combination of levels of the axes with its number, as they are written for quantity `name`."""
    return _spread(node, name, dict(enumerate(axes)), {}, problems, len(axes))


def _spread(node: Node, name: str, left: dict[int, Axis], chosen: dict[int, int], problems: Problems, number: int
            ) -> Iterator[tuple[tuple[int, ...], Published]]:
    """Each index of a case with its number; `left` are the axes that are not chosen yet."""
    if isinstance(node, Scalar):
        published = _published(node, name, problems)
        if published is not None:
            for index in product(*(range(len(axis.levels)) for axis in left.values())):
                full = {**chosen, **dict(zip(left, index, strict=True))}
                yield tuple(full[k] for k in range(number)), published
        return
    pairs = list(_levels(node, name, left, problems))
    for k, level, item in pairs:
        remaining = {j: axis for j, axis in left.items() if j != k}
        yield from _spread(item, name, remaining, {**chosen, k: level}, problems, number)


def _levels(node: Entries | Items, name: str, remaining: dict[int, Axis],
            problems: Problems) -> Iterator[tuple[int, int, Node]]:
    """Axis, level, and value of each entry."""
    if not remaining:
        problems.add("beside-deep", f"{name}: no axis is left along which these numbers could go", node.place,
                     hint="Write one quantity here.")
    elif isinstance(node, Items):
        k, axis = next(iter(remaining.items()))
        if len(node.items) != len(axis.levels):
            levels = listing([level.name for level in axis.levels])
            problems.add("beside-number", f"{name}: {len(node.items)} numbers are given along '{axis.name}', which has "
                         f"{len(axis.levels)} levels", node.place,
                         hint=f"Write one number for each level ({levels}), `{NONE}` where there is none.")
        else:
            yield from ((k, level, item) for level, item in enumerate(node.items))
    else:
        axis_match = next(((k, places) for k, axis in remaining.items() if (places := _matched(node, axis))), None)
        if axis_match is None:
            names = "; ".join(f"{axis.name}: {listing([lv.name for lv in axis.levels])}" for axis in remaining.values())
            problems.add("level-unknown", f"{name}: these are not levels of one axis", node.place, hint=f"Levels: {names}.")
        else:
            yield from ((axis_match[0], level, item) for level, item in axis_match[1])


def _matched(node: Entries, axis: Axis) -> list[tuple[int, Node]]:
    """The levels of the keys; empty if a key is not a level."""
    levels = []
    for key, item in node.items.items():
        at = next((k for k, level in enumerate(axis.levels) if _same(key, level.name, level.value)), None)
        if at is None:
            return []
        levels.append((at, item))
    return levels


def _same(key: str, name: str, value: float) -> bool:
    if key == name:
        return True
    try:
        return bool(abs(parse_quantity(key)[0] - value) <= 1e-9 * abs(value))
    except UnitProblem:
        return False


def _published(node: Scalar, name: str, problems: Problems) -> Published | None:
    if node.text.strip() == NONE:
        return None
    try:
        value, unit = parse_quantity(node.text)
    except UnitProblem as problem:
        hint = f"Write a number, with its unit if it has one, or `{NONE}` for none." if problem.hint == AS_QUANTITY else \
            problem.hint
        problems.add(problem.code, f"{name}: {problem.message}", node.place, hint=hint)
        return None
    return Published(value, unit or read_unit("1"), node.place)
