"""The scatter diagram of a study: the share of each combination of the levels of some axes, and the weighted means.

    occurrence:
      of: [H_s, T_p]
      share: [[12, 30, 8], [2, 25, 20]]
      required: {WOB deviation: <= 2 kN, off bottom: <= 1 %}

With the shares w_i of the combinations of levels (w_i >= 0, any common factor), the mean of a quantity x is
sum(w_i x_i)/sum(w_i), and the availability is sum(w_i a_i)/sum(w_i), where a_i is 1 if all required comparisons hold in
combination i and 0 if not. If a sample is drawn for each combination, x_i and a_i are its means. For the sea, DNV-RP-C205
(section 3.6) defines scatter diagrams of significant wave height and period.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from heavebond.core.errors import Place, Problems, listing, suggest
from heavebond.core.units import Unit, UnitProblem, parse_quantity, read_unit
from heavebond.language import reading
from heavebond.studies.axes import Axis
from heavebond.studies.published import read_cases
from heavebond.text.yaml_source import Node

COMPARISON = re.compile(r"(<=|>=|<|>)\s*(.+)", re.DOTALL)
EXAMPLE = "Write a comparison with a quantity: `WOB deviation: <= 2 kN`."


@dataclass(frozen=True)
class Requirement:
    """A comparison of a measured quantity with a limit (SI, in `unit`): `sign` is one of <=, <, >=, >."""

    quantity: str
    sign: str
    limit: float
    unit: Unit
    place: Place

    @property
    def text(self) -> str:
        """The comparison as text."""
        return f"{self.quantity} {self.sign} {self.unit.written(self.limit)}"

    def holds(self, value: float) -> bool:
        """True if a value (SI) fulfils the comparison; False for NaN, a case without a value."""
        return bool({"<=": value <= self.limit, "<": value < self.limit, ">=": value >= self.limit,
                     ">": value > self.limit}[self.sign])


@dataclass(frozen=True)
class Occurrence:
    """A scatter diagram: the numbers of its axes, the share of each combination of their levels, and the requirements."""

    axes: tuple[int, ...]
    shares: Mapping[tuple[int, ...], float]
    required: tuple[Requirement, ...] = ()

    def share(self, index: tuple[int, ...]) -> float:
        """The share of a case with these levels on all axes of the study; 0 if it never occurs."""
        return self.shares.get(tuple(index[k] for k in self.axes), 0.0)


def read_occurrence(node: Node | None, axes: Sequence[Axis], quantities: Sequence[str], problems: Problems
                    ) -> Occurrence | None:
    """The scatter diagram under `occurrence:`; `quantities` are the measured ones."""
    entry = reading.mapping(node, "occurrence", problems, "Write `of: [H_s, T_p]` and `share: [[...], ...]`.")
    if entry is None:
        return None
    reading.known_keys(entry, ("of", "share", "required"), "occurrence", problems, required=("of", "share"))
    known = {axis.name: k for k, axis in enumerate(axes) if axis.sampling is None}
    numbers, words = [], reading.words(entry.items.get("of"), "of", problems)
    for word in words:
        if word.text not in known:
            problems.add("occurrence-axis", f"'{word.text}' is not an axis of `cases:` with fixed levels", word.place,
                         hint=suggest(word.text, list(known)) or f"Axes: {listing(known)}.")
        elif known[word.text] in numbers:
            problems.add("occurrence-axis", f"'{word.text}' is named twice", word.place, hint="Name each axis once.")
        else:
            numbers.append(known[word.text])
    shares: dict[tuple[int, ...], float] = {}
    share_node = entry.items.get("share")
    if share_node is not None and numbers and len(numbers) == len(words):
        for index, share in read_cases(share_node, "share", [axes[k] for k in numbers], problems):
            if share.unit.dimension or not 0 <= share.value < math.inf:
                problems.add("occurrence-share", "share: a share is a number of at least 0 without a unit", share.place,
                             hint="Write for example `12`, `3 %`, or `-` for a combination that never occurs.")
            shares[index] = share.value
        if not problems and not sum(shares.values()) > 0:
            problems.add("occurrence-never", "share: no combination occurs", share_node.place,
                         hint="Write a number above 0 for at least one of them.")
    required = []
    requirements = reading.mapping(entry.items.get("required"), "required", problems, EXAMPLE)
    for name, item in (requirements.items if requirements else {}).items():
        place = requirements.keys[name].place if requirements else item.place
        if name not in quantities:
            problems.add("quantity-unknown", f"'{name}' is neither measured nor tuned in this study", place,
                         hint=suggest(name, quantities) or f"Known: {listing(quantities)}.")
            continue
        comparison = COMPARISON.fullmatch(reading.text(item, name, problems).strip())
        if comparison is None:
            problems.add("requirement-wrong", f"{name}: this is not a comparison with a limit", item.place, hint=EXAMPLE)
            continue
        try:
            limit, unit = parse_quantity(comparison[2])
        except UnitProblem as problem:
            problems.add(problem.code, f"{name}: {problem.message}", item.place, hint=problem.hint or EXAMPLE)
            continue
        required.append(Requirement(name, comparison[1], limit, unit or read_unit("1"), item.place))
    return Occurrence(tuple(numbers), shares, tuple(required))


def check_units(occurrence: Occurrence, units: Mapping[str, Unit], problems: Problems) -> None:
    """Report limits whose unit has another dimension than their quantity."""
    for requirement in occurrence.required:
        if requirement.unit.dimension != units[requirement.quantity].dimension:
            limit = "has no unit" if requirement.unit.text == "1" else f"is in {requirement.unit.text}"
            problems.add("unit-wrong", f"{requirement.quantity} is in {units[requirement.quantity].text}; its limit {limit}",
                         requirement.place, hint=f"Write the limit in {units[requirement.quantity].text} or in a multiple "
                         "of it.")
