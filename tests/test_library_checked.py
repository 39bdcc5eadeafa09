"""Every component of the library is compared with an independent formula of its source, by name."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np
import pytest
from library_check import CHECKED, agree, checks, part

import heavebond as hb
from heavebond.language.library import bundled, example, library

for _path in sorted(Path(__file__).parent.glob("test_library_*.py")):
    if _path.stem != Path(__file__).stem:
        importlib.import_module(_path.stem)

# components whose example has the formula of the source beside an output: `force` and `force_expected`
EXPECTED = "_expected:"
BY_EXAMPLE = {name: path for name in library().names()
              if (path := example(library().component(name))) is not None and EXPECTED in path.read_text(encoding="utf-8")}
for _name in BY_EXAMPLE:
    CHECKED.setdefault(_name, []).append(f"{__name__}.test_an_example_agrees_with_the_formula_in_it")

FOLDERS = ("bond_graph", "electrical", "hydraulic", "planar", "pneumatic", "rotational", "signal", "spatial", "thermal",
           "thermohydraulic", "translational")


@pytest.mark.parametrize("folder", FOLDERS)
def test_every_component_is_compared_with_its_source(folder: str) -> None:
    names = [name for name in library().names() if library().component(name).path.parent.name == folder]
    assert names
    assert not [name for name in names if name not in CHECKED]


@pytest.mark.parametrize("name", BY_EXAMPLE)
def test_an_example_agrees_with_the_formula_in_it(name: str) -> None:
    """At all output points; 1e-6 of the largest value: the algebraic unknowns are accurate to the tolerance of Newton's
    method."""
    result = hb.simulate(hb.load(BY_EXAMPLE[name]))
    labels = [label for label in result.assembly.model.show if f"{label}_expected" in result.assembly.model.show]
    assert labels
    for label in labels:
        values, expected = result.display[label], result.display[f"{label}_expected"]
        assert np.ptp(expected) > 0
        assert values == pytest.approx(expected, rel=1e-6, abs=1e-6*np.abs(expected).max())


def test_no_component_is_named_that_does_not_exist() -> None:
    assert not set(CHECKED) - set(library().names())


def test_a_comparison_that_evaluates_or_compares_nothing_fails() -> None:
    @checks("Capillary")
    def other_component() -> None:
        agree(part("Cap")({})["a.q"], 0, size=1)

    @checks("Cap")
    def no_number() -> None:
        part("Cap")

    for empty, said in ((other_component, "not evaluated"), (no_number, "nothing was compared")):
        with pytest.raises(AssertionError, match=said):
            empty()
    for made in (other_component, no_number):
        for tests in CHECKED.values():
            tests[:] = [name for name in tests if made.__name__ not in name]
    for name in [name for name, tests in CHECKED.items() if not tests]:
        del CHECKED[name]


def test_folders_are_those_of_the_library() -> None:
    assert {*FOLDERS, "functions", "symbols"} == {path.name for path in bundled("components").iterdir() if path.is_dir()}
