"""Writing of diagrams: files that extend another diagram and set fitted values; checks of their names."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path

from heavebond.core.errors import UsageError
from heavebond.core.units import Unit
from heavebond.core.writable import write_text
from heavebond.estimation.change import Change, block
from heavebond.estimation.fitting import Fit, Fitted
from heavebond.language.library import bundled


def quantity(value: float, unit: Unit) -> str:
    """`46.998 kN/m`: an SI value in a unit, to six digits."""
    return unit.written(value)


def fitted_diagram(fit: Fit, path: Path) -> str:
    """The text of a diagram at `path` that extends the fitted one and sets what was fitted for all records."""
    experiment = fit.experiment
    records = [r.name for r in experiment.records.values() if r.use == "fit"]
    change, notes = fitted_values(fit)
    head = [f"model: {path.stem}",
            f"summary: {experiment.model.name} with parameters fitted to {', '.join(records)}.",
            f"extends: {extended_from(path, experiment.model.path)}"]
    return "\n".join([*head, *block("set", change.settings, notes), *block("initial", change.initial, notes)]) + "\n"


def fitted_values(fit: Fit) -> tuple[Change, dict[str, str]]:
    """What was fitted for all records, as a change to the diagram, and the interval of each as a note."""
    values, notes = {}, {}
    for p in fit.parameters:
        if not p.record:
            unit = fit.experiment.free[p.name].range.unit
            values[p.name] = quantity(p.value, unit)
            notes[p.name.removeprefix("initial.")] = f"at the {p.at_bound} end of its range" if p.at_bound else \
                p.known(partial(quantity, unit=unit))
    return Change().with_values(values), notes


def extended_from(path: Path, model: Path) -> str:
    """How a file at `path` names the diagram at `model`: a bundled one by its name, so that the file can move."""
    inside = bundled("models").resolve()
    if model.resolve().is_relative_to(inside) and not path.resolve().is_relative_to(inside):
        return model.resolve().relative_to(inside).as_posix()
    return Path(os.path.relpath(model.resolve(), path.resolve().parent)).as_posix()


def span(fitted: Fitted, unit: Unit, amplitude: bool) -> str:
    """The range of a number that was found: an amplitude may grow by half and shrink to nothing, a shape keeps its own."""
    low, high = fitted.low, fitted.high
    if amplitude and fitted.value:
        reach = 1.5 * abs(fitted.value)
        low, high = max(low, -reach if low < 0 else low), min(high, reach) if high > 0 else high
    shown = [f"{unit.from_si(end):.4g}" for end in (low, high)]
    return f"{shown[0]} .. {shown[1]}" + ("" if unit.text in ("1", "") else f" {unit.text}")


def write(path: Path, text: str) -> None:
    """Write a new file; UsageError where it exists already or cannot be written, so that nothing is lost."""
    if path.suffix not in (".yaml", ".yml"):
        raise UsageError(f"'{path.name}' is no name of a diagram", hint=f"Write {path.with_suffix('.yaml').name}.")
    write_new(path, text)


def write_new(path: Path, text: str) -> None:
    """Write a text to a file that does not exist; UsageError where it does, or cannot be written."""
    try:
        write_text(path, text, exclusive=True)
    except FileExistsError:
        raise UsageError(f"{path} exists already", hint="Give another name, or remove it first.") from None
    except OSError as error:
        raise UsageError(f"{path} cannot be written: {error.strerror}") from None
