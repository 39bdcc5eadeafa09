"""Terms of laws that an engineer would try, and the class that each means: the library of the sparse regression, and the
names for formulas of the symbolic regression."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.missing_physics.reading import Array

CLASSES: Mapping[str, Mapping[str, str]] = {
    "mechanical": {"sign": "dry friction", "line": "viscous damping", "drag": "quadratic damping", "cube": "damping law",
                   "root": "damping law", "position": "stiffness", "position cube": "nonlinear stiffness",
                   "position square": "nonlinear stiffness", "constant": "constant force"},
    "hydraulic": {"line": "leakage", "root": "orifice law", "drag": "line resistance", "cube": "leakage",
                  "constant": "supply droop", "sign": "leakage"},
    "thermal": {"line": "heat loss", "cube": "natural convection", "drag": "natural convection", "root": "heat loss"},
    "electrical": {"line": "leakage current", "sign": "brush voltage"}}
DOMAINS = {"translational": "mechanical", "rotational": "mechanical", "pneumatic": "hydraulic",
           "thermohydraulic": "hydraulic"}
EXPLAINED = 0.95  # share of the variance of a formula that one term explains if the formula is named after it


@dataclass(frozen=True)
class Term:
    """A function of the across variable v and the position x in units of their largest values."""

    name: str
    value: Callable[[Any, Any], Any]


def terms(has_position: bool, pitches: Sequence[float] = ()) -> list[Term]:
    """The terms at a place; `pitches` of periodic ones in units of the largest position."""
    found = [Term("constant", lambda v, x: 1.0 + 0 * v), Term("line", lambda v, x: v),
             Term("sign", lambda v, x: np.tanh(v / 0.02)), Term("drag", lambda v, x: v * abs(v)),
             Term("cube", lambda v, x: v**3), Term("root", lambda v, x: v / (v * v + 1e-4)**0.25)]
    if has_position:
        found += [Term("position", lambda v, x: x), Term("position square", lambda v, x: x * x),
                  Term("position cube", lambda v, x: x**3), Term("line times position", lambda v, x: v * x),
                  Term("drag times position", lambda v, x: v * abs(v) * x),
                  Term("line times square", lambda v, x: v * x * x)]
        found += [Term(name, _wave(function, pitch)) for pitch in pitches
                  for name, function in (("sine", np.sin), ("cosine", np.cos))]
    return found


def _wave(function: Callable[[Any], Any], pitch: float) -> Callable[[Any, Any], Any]:
    return lambda v, x: function(2 * np.pi * x / pitch)


def pitches(position: Array, value: Array) -> list[float]:
    """The pitches, in units of the largest position, of the two strongest harmonics of a value over the position."""
    span, found = float(np.ptp(position)), list[tuple[float, float]]()
    if span == 0:
        return []
    smooth = np.polynomial.Polynomial.fit(position, value, 3)(position)
    for periods in np.arange(1.0, 40.0, 0.25):
        phase = 2 * np.pi * periods * position / span
        A = np.column_stack([np.sin(phase), np.cos(phase)])
        left = value - smooth
        fitted = A @ np.linalg.lstsq(A, left, rcond=None)[0]
        found.append((float(np.var(left - fitted)), span / periods))
    return [pitch for _, pitch in sorted(found)[:2]]


def effect(place: Mapping[str, Any], across: Array, position: Array, value: Array, formula: str) -> dict[str, Any]:
    """The effect that a law means, from its values over a motion: the class of the term that explains most of it, if that
    is nearly all, and the kind by the variable that does."""
    v_size, x_size = (max(float(np.abs(one).max()), 1e-30) for one in (across, position))
    best, share = "", -np.inf
    for term in terms(bool(place["position"])):
        column = np.asarray(term.value(across / v_size, position / x_size), float)
        left = value - column * (column @ value) / max(float(column @ column), 1e-300)
        explained = 1 - float(left @ left) / max(float(value @ value), 1e-300)
        if explained > share:
            best, share = term.name, explained
    kind = "source" if best == "constant" else "displacement" if best.startswith("position") else "rate"
    if place["position"]:  # a law of both is one of the variable that explains more in bins
        by_speed, by_position = _binned(across, value), _binned(position, value)
        if best != "constant" and abs(by_speed - by_position) > 0.05:
            kind = "rate" if by_speed > by_position else "displacement"
    domain = DOMAINS.get(place["domain"], place["domain"])
    named = CLASSES.get(domain, {}).get(best, "") if share > EXPLAINED else ""
    return {"side": "machine", "place": list(place["nodes"]), "kind": kind, "class": named, "law": formula, "words": formula}


def _binned(variable: Array, value: Array, bins: int = 30) -> float:
    """The share of the variance of a value that its means over bins of a variable explain."""
    if np.ptp(variable) == 0:
        return 0.0
    index = np.minimum((bins * (variable - variable.min()) / np.ptp(variable)).astype(int), bins - 1)
    means = np.bincount(index, value, bins) / np.maximum(np.bincount(index, minlength=bins), 1)
    return 1 - float(np.var(value - means[index]) / max(np.var(value), 1e-300))
