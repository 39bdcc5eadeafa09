"""The search of structures: its linear machine beside closed forms, and the page beside the recorded results."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks import published_search as search
from benchmarks import published_structures as structures
from benchmarks.published_structures import BASE, OURS, STRUCTURES

PAGE = Path(__file__).parents[1] / "docs" / "published_structures.md"
RIGID = replace(BASE, oil="rigid")
RESULTS = search.kept_results(search.RESULTS)


def values(**changed: float) -> dict[str, np.ndarray]:
    return {name: np.array([[value]]) for name, value in {**OURS, **changed}.items()}


@pytest.mark.parametrize("zeta", [0.5, 0.87, 1.2])
def test_stability_boundary_of_rigid_oil(zeta: float) -> None:
    """K_p K_q = 2 zeta omega_n, by Hurwitz's criterion."""
    at = structures.plane(RIGID, values(), structures.NYQUIST)
    open_loop = structures.linear(RIGID, values(), at, 0.0).spool
    found = structures.limit_of_gain(RIGID, values(zeta=zeta), 0.75, [open_loop]).item()
    assert found == pytest.approx(2 * zeta * 2 * np.pi * 0.75 / structures.K_Q, rel=2e-3)


def test_rigid_oil_is_not_below_its_bound() -> None:
    """The crown block moves by at least a (f/f_n)**2 at the stability boundary."""
    cells = structures.cells(RIGID, values(T_1=1e-3), False)
    static = 1 / (1 / structures.WIRES + 1 / structures.STRING + 1 / structures.FORMATION)
    for f_n, cell in zip(structures.VALVES, cells, strict=True):
        bound = static * structures.HEAVE / (structures.PERIOD * f_n) ** 2 / 1e3
        if cell.K_p.item() < structures.LARGEST_K_P * 0.99:
            assert bound < cell.WOB.item() < 1.4 * bound


def test_first_order_valve_has_no_boundary() -> None:
    first = replace(RIGID, law="first order")
    at = structures.plane(first, values(), structures.NYQUIST)
    open_loop = structures.linear(first, values(), at, 0.0).spool
    assert structures.limit_of_gain(first, values(), 0.75, [open_loop]).item() > 1e6


def test_boundary_of_the_full_model() -> None:
    """3.29 1/m at 0.75 Hz and 2.109 1/m at 2.5 Hz without friction, as on docs/published_system.md."""
    at = structures.plane(BASE, values(), structures.NYQUIST)
    open_loop = structures.linear(BASE, values(), at, 0.0).spool
    for f_n, limit in ((0.75, 3.29), (2.5, 2.109)):
        assert structures.limit_of_gain(BASE, values(), f_n, [open_loop]).item() == pytest.approx(limit, rel=0.01)


@pytest.mark.parametrize("box", search.BOXES)
def test_the_page_has_the_recorded_results(box: str) -> None:
    rows = [" ".join(line.split()) for line in PAGE.read_text(encoding="utf-8").splitlines()]
    assert set(RESULTS[box]) == {structure.name for structure in STRUCTURES}
    for structure in STRUCTURES:
        assert search.row(structure, RESULTS[box][structure.name]) in rows


@pytest.mark.parametrize("box", search.BOXES)
def test_recorded_numbers_follow_from_recorded_values(box: str) -> None:
    for structure in STRUCTURES:
        kept = RESULTS[box][structure.name]
        found = structures.numbers(structure, values(**kept["values"]))[0]
        assert found == pytest.approx(kept["numbers"], rel=1e-6)


def test_sentences_on_the_results() -> None:
    """Counts that the page states in prose."""
    text = " ".join(PAGE.read_text(encoding="utf-8").split())
    most = {(box, name): max(kept["most"][name] for kept in RESULTS[box].values())
            for box in search.BOXES for name in search.CONDITIONS}
    stated = re.search(r"No structure meets more than (\w+) of the ten cells", text)
    assert stated and stated[1] == {9: "nine", 8: "eight"}[max(most[box, "cells alone"] for box in search.BOXES)]
    stated = re.search(r"With all four gains and the eigenfrequency, at most (\w+) cells are met", text)
    assert stated and stated[1] == {9: "nine", 8: "eight", 7: "seven"}[
        max(most[box, "with all gains and 0.23 Hz"] for box in search.BOXES)]
