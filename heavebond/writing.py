"""Findings written back as diagrams: a file that extends the model and says only what was found."""

from __future__ import annotations

import os
from pathlib import Path

from heavebond.errors import UsageError
from heavebond.fitting import Fit
from heavebond.library import bundled
from heavebond.model import Model
from heavebond.tuning import Task, Tuned
from heavebond.units import Unit


def quantity(value: float, unit: Unit) -> str:
    """`46.998 kN/m`: an SI value in a unit, to six digits."""
    number = f"{unit.from_si(value):.6g}"
    return number if unit.text in ("1", "") else f"{number} {unit.text}"


def fitted_diagram(fit: Fit, path: Path) -> str:
    """The text of a diagram at `path` that extends the fitted one and sets what was fitted for all records."""
    experiment = fit.experiment
    records = [r.name for r in experiment.records.values() if r.use == "fit"]
    sets: list[tuple[str, str]] = []
    starts: list[tuple[str, str]] = []
    for p in fit.parameters:
        if p.record:
            continue
        unit = experiment.free[p.name].range.unit
        low, high = (quantity(end, unit) for end in p.interval)
        note = f"# {low} .. {high}" + (f"; at the {p.at_bound} end of its range" if p.at_bound else "")
        name, target = (p.name.removeprefix("initial."), starts) if p.name.startswith("initial.") else (p.name, sets)
        target.append((f"{name}: {quantity(p.value, unit)}", note))
    head = [f"model: {path.stem}",
            f"summary: {experiment.model.name} with parameters fitted to {', '.join(records)}.",
            f"extends: {_from(path, experiment.model.path)}"]
    return "\n".join([*head, *_block("set", sets), *_block("initial", starts)]) + "\n"


def tuned_diagram(model: Model, task: Task, result: Tuned, path: Path) -> str:
    """The text of a diagram at `path` that extends the tuned one and sets the best values."""
    lines = [(f"{name}: {quantity(value, task.free[name].unit)}", "") for name, value in result.values.items()]
    head = [f"model: {path.stem}",
            f"summary: {model.name}, tuned to a cost of {result.cost:.5g} (from {result.before:.5g}).",
            f"extends: {_from(path, model.path)}"]
    return "\n".join([*head, *_block("set", lines)]) + "\n"


def _from(path: Path, model: Path) -> str:
    """How a file at `path` names the diagram at `model`: a bundled one by its name, so that the file can move."""
    inside = bundled("models").resolve()
    if model.resolve().is_relative_to(inside) and not path.resolve().is_relative_to(inside):
        return model.resolve().relative_to(inside).as_posix()
    return Path(os.path.relpath(model.resolve(), path.resolve().parent)).as_posix()


def _block(name: str, lines: list[tuple[str, str]]) -> list[str]:
    if not lines:
        return []
    width = max(len(text) for text, _ in lines)
    return [f"{name}:", *(f"  {text.ljust(width)}   {note}".rstrip() for text, note in lines)]


def write(path: Path, text: str) -> None:
    """Write a new file; UsageError where it exists already or cannot be written, so that nothing is lost."""
    if path.suffix not in (".yaml", ".yml"):
        raise UsageError(f"'{path.name}' is no name of a diagram", hint=f"Write {path.with_suffix('.yaml').name}.")
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise UsageError(f"{path} exists already", hint="Give another name, or remove it first.") from None
    except OSError as error:
        raise UsageError(f"{path} cannot be written: {error.strerror}") from None


