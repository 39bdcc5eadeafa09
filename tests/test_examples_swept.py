"""Every input of every example at zero, reversed, ten times and a thousandth of what the example gives: the run is finite,
or its end is told with what to do; it is never a traceback."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from collected import for_each
from examples import FOLDER

import heavebond as hb
from heavebond.core.errors import HeavebondError, Problem
from heavebond.language.definition import Value
from heavebond.language.library import library
from heavebond.language.model import load

pytestmark = pytest.mark.long

FACTORS = ("(1 - 1)", "(-1)", "10", "0.001")     # a plain 0 would fit any unit
LIBRARY = library()


def inputs(model: hb.Model) -> Iterator[tuple[str, str]]:
    """The signal inputs that a diagram gives a value or formula to, with its text."""
    for name, part in model.body.instances.items():
        signals = LIBRARY.component(part.kind).signals if part.kind in LIBRARY.files else {}
        for key, given in part.settings.items():
            if key in signals and signals[key].direction == "in" and isinstance(given, Value) and given.text[0] != "[":
                yield f"{name}.{key}", given.text.removeprefix("=")


EXAMPLES = [path.stem for path in sorted(FOLDER.glob("*.yaml"))]


def test_most_examples_have_inputs() -> None:
    assert sum(any(inputs(load(FOLDER / f"{example}.yaml"))) for example in EXAMPLES) > 250


@pytest.mark.filterwarnings("ignore::heavebond.RunWarning")
@for_each("example", EXAMPLES, parts=16)
def test_other_inputs_give_a_finite_run_or_a_message(example: str) -> None:
    model = load(FOLDER / f"{example}.yaml")
    for path, text in inputs(model):
        for factor in FACTORS:
            told: list[Problem] = []
            values: list[np.ndarray] = []
            try:
                run = hb.simulate(model.with_parameters({path: f"={factor}*({text})"}))
                values = [run.x, *run.signals(run.display).values()]
            except HeavebondError as error:
                told = list(error.problems)
            assert told or values, (path, factor)
            assert all(problem.message and problem.hint for problem in told), (path, factor)
            assert all(np.isfinite(v).all() for v in values), (path, factor)
