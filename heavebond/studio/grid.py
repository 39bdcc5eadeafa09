"""The grid of a drawing: its columns and rows, and their numbers in `at:`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil, floor, isfinite
from typing import Any

from heavebond.equations.connect import Network
from heavebond.equations.expanded import Expanded
from heavebond.pictures.drawing import own_sides
from heavebond.pictures.layout import Drawn, placed
from heavebond.pictures.sheets import sheet

Cell = tuple[float, float]
STEPS = (1.0, 0.5, 0.25, 0.125)  # resolution of a place in `at:`


@dataclass(frozen=True)
class Grid:
    """The numbers of the columns and of the rows in `at:`, and the cell (column, row, both counted from 0) of each part."""

    columns: tuple[float, ...]
    rows: tuple[float, ...]
    cells: dict[str, Cell]

    @staticmethod
    def read(action: Mapping[str, Any]) -> Grid:
        """Read the grid that the page sends back; ValueError if it is malformed."""
        grid = action.get("grid") or {}
        numbers = [tuple(map(float, grid.get(key, ()))) for key in ("columns", "rows")]
        if not all(isfinite(value) for group in numbers for value in group):
            raise ValueError(grid)
        return Grid(numbers[0], numbers[1], {str(k): (float(v[0]), float(v[1])) for k, v in grid.get("cells", {}).items()})

    def place(self, column: float, row: float) -> list[str]:
        """The text of `at:` for a cell, `k + 0.5` between two columns or rows; empty if no number is left there."""
        numbers_at = [_between(self.columns, column), _between(self.rows, row)]
        return [f"{value:g}" for value in numbers_at if value is not None] if None not in numbers_at else []


def _between(values: Sequence[float], k: float) -> float | None:
    """The number for the k-th of some columns; between two of them, or beyond the ends, the number with the fewest
    digits.
    """
    if not values:
        return float(floor(k))
    if k < 0:
        return float(ceil(values[0]) - 1)
    if k > len(values) - 1:
        return float(floor(values[-1]) + 1)
    low, high = values[floor(k)], values[ceil(k)]
    if low == high:
        return low
    middle = (low + high) / 2
    for step in STEPS:
        rounded = step * floor(middle / step + 0.5)
        if low < rounded < high:
            return rounded
    return None


def renumbered(k: float, inserted: float) -> str:
    """The number of a column by its order, if another one is inserted at `k + 0.5` or replaces one."""
    return str(ceil(k) + (k > inserted != floor(inserted)))


def grid_of(drawn: Drawn) -> dict[str, Any]:
    """The grid of a drawing for the page, with the centres of columns and rows in px."""
    cells = {item.part.name: item.cell for item in drawn.items}
    given_places = {item.part.name: item.part.at for item in drawn.items if item.part.at is not None}
    numbers = []
    for k, count in enumerate((len(drawn.xs), len(drawn.ys))):
        known: dict[int, float] = {}
        for name, at in given_places.items():
            known.setdefault(cells[name][k], at[k])
        numbers.append(_filled(known, count))
    return {"xs": list(drawn.xs), "ys": list(drawn.ys), "columns": numbers[0], "rows": numbers[1],
            "cells": {name: list(cell) for name, cell in cells.items()}}


def _filled(known: Mapping[int, float], count: int) -> list[float]:
    """Numbers for all columns in ascending order: the known ones, with numbers between and beyond them."""
    if not known:
        return [float(k) for k in range(count)]
    order = sorted(known)
    numbers = []
    for k in range(count):
        before, after = max((j for j in order if j <= k), default=None), min((j for j in order if j >= k), default=None)
        if before is None or after is None:
            end = order[0] if before is None else order[-1]
            numbers.append(known[end] + (k - end))
        elif before == after:
            numbers.append(known[before])
        else:
            numbers.append(known[before] + (known[after] - known[before]) * (k - before) / (after - before))
    return numbers


def cells_of(expanded: Expanded, network: Network) -> dict[str, Cell]:
    """The cells of the parts on the outermost sheet, without drawing it."""
    outermost = sheet(expanded, network, frozenset())
    return {name: (float(c), float(r)) for name, (c, r) in placed(outermost, own_sides(expanded, outermost)).cells.items()}
