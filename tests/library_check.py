"""A component of the library beside a formula of its source: its equations solved at given points, without a run.

    law = part("Orifice", q_r="30 L/min", dp_r="10 bar", dp_t="1e-3 Pa")
    found = law({"a.p": [80e5, 20e5], "b.p": 40e5})           # any unknowns that are enough, numbers in SI, (N,) or one
    agree(found["a.q"], 5e-4*np.sign(dp)*np.sqrt(abs(dp)/10e5))

What is given may be any variable of the part (`a.p`, `q`, `u`, of a block also `cylinder.F`), the rate of one (`der(a.p)`),
a held variable, the `time`, or a parameter that is swept; what follows from it is found. A dynamic law is checked by
giving its states and comparing their rates; `run` integrates a whole diagram where that is not enough.

`@checks("Orifice")` says which components a test compares: `test_library_checked.py` wants every name of the library.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import wraps
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline

import heavebond as hb
from heavebond.equations.flatten import Flat, flatten
from heavebond.language.library import library
from heavebond.language.symbols import split, stack
from heavebond.text.shapes import whole_number

Array = NDArray[np.float64]
CHECKED: dict[str, list[str]] = {}  # component -> the tests that compare it
LIBRARY = library()
_seen: set[str] = set()
_compared: list[int] = []


def checks(*components: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Register a test as the comparison of components; it fails unless it evaluates each and compares a number."""
    def decorate(test: Callable[..., None]) -> Callable[..., None]:
        for name in components:
            CHECKED.setdefault(name, []).append(f"{test.__module__}.{test.__name__}")

        @wraps(test)
        def guarded(*args: Any, **kwargs: Any) -> None:
            _seen.clear()
            _compared.clear()
            test(*args, **kwargs)
            assert set(components) <= _seen, f"not evaluated: {sorted(set(components) - _seen)}"
            assert sum(_compared), "nothing was compared"
        return guarded
    return decorate


def agree(found: ArrayLike, expected: ArrayLike, rtol: float = 1e-9, size: float | None = None) -> None:
    """Both equal within `rtol` of each number, where that is zero of `size` (the largest number without it)."""
    found, expected = np.broadcast_arrays(np.asarray(found, float), np.asarray(expected, float))
    largest = float(np.abs(expected).max()) if size is None else size
    _compared.append(found.size)
    # what rounding leaves of differences of large numbers
    np.testing.assert_allclose(found, expected, rtol=rtol, atol=1e-13*largest if size is None else rtol*size)


def part(component: str, **given: object) -> Law:
    """One part by itself: parameters and constant inputs as text with a unit, or as numbers in SI."""
    return Law(component, given)


def run(text: str, until: str | None = None, **options: Any) -> hb.Result:
    """A run of a diagram given as text."""
    model = hb.loads(text)
    _seen.update(i.kind for i in model.body.instances.values())
    return hb.simulate(model, until, **options)


class Law:
    """The equations of one part, whose ports are free: what is joined to it is what a point gives."""

    def __init__(self, component: str, given: Mapping[str, object]):
        _seen.add(component)
        self.component = LIBRARY.component(component)
        counts = {name: int(str(value)) for name, value in given.items()
                  if name in self.component.parameters and self.component.parameters[name].integer}
        self.inputs = {name for name, s in self.component.signals.items() if s.direction == "in" and name in given}
        self.text = self._diagram(component, given, counts)
        self.model = hb.loads(self.text)
        self.flat: dict[tuple[str, ...], Flat] = {}
        self.solutions: dict[tuple[str, ...], Solution] = {}

    def _diagram(self, component: str, given: Mapping[str, object], counts: Mapping[str, int]) -> str:
        written = [f"is: {component}", *(f"{name}: {self._value(name, value)}" for name, value in given.items())]
        driven = [s.name for s in self.component.signals.values() if s.direction == "in" and s.name not in given]
        written += [f"{name}: 0" for name in driven]
        nodes = []
        for name, port in self.component.ports.items():
            if port.count is None:
                nodes.append(f"  {name}: [part.{name}]")
            else:
                number = whole_number(port.count, counts) or 0
                nodes += [f'  {name}_{k + 1}: ["part.{name}[{k + 1}]"]' for k in range(number)]
        return "\n".join(["model: one", "components:", f"  part: {{{', '.join(written)}}}",
                          *(["nodes:", *nodes] if nodes else []), ""])

    def _value(self, name: str, value: object) -> str:
        declared = {**self.component.parameters, **self.component.signals}.get(name)
        if isinstance(value, (float, np.floating)) and declared is not None and value != 0:
            unit = declared.unit.text
            return f"{float(value)!r} {unit}" if unit != "1" else repr(float(value))
        text = str(value)
        return text if text.startswith(("[", '"', "{")) or not re.search(r"[,\[\]{}:#]", text) else f'"{text}"'

    def __call__(self, given: Mapping[str, ArrayLike], guess: Mapping[str, float] | None = None) -> Found:
        """What follows from given numbers; `guess` starts the search where equations are implicit."""
        key = tuple(given)
        if key not in self.solutions:
            positions = tuple(f"part.{k}" for k in given if k.endswith((".x", ".y", ".phi")))
            if positions not in self.flat:
                self.flat[positions] = flatten(self.model, positions)
            self.solutions[key] = Solution(self.flat[positions], key, self.inputs - set(key))
        columns = np.broadcast_arrays(*(np.asarray(v, float) for v in given.values())) if given else [np.zeros(())]
        return self.solutions[key].at([np.ravel(c) for c in columns] if given else [], columns[0].shape, guess or {})


class Found(dict[str, Array]):
    """Numbers by name; a name that is not decided says what is."""

    def __missing__(self, name: str) -> Array:
        raise KeyError(f"'{name}' does not follow from what is given; {sorted(self)} do")


class Solution:
    """The equations of a flat model solved for what is not given: explicitly one after the other as far as that goes, what
    is left by Newton's method."""

    def __init__(self, flat: Flat, given: Sequence[str], inputs: Collection[str] = ()):
        """`inputs` keep the constant that the diagram gives."""
        self.flat, self.names = flat, self._symbol_names(flat)
        by_name = {name: s for s, name in self.names}
        parameters = {n.removeprefix("part."): s for n, s in flat.constants.items() if s.is_symbolic()}
        self.given = [self._given(name, {**by_name, "time": flat.time}, parameters) for name in given]
        known = {s.element_hash() for s in (*self.given, *split(flat.p), flat.time, flat.rate)}
        self.residuals = [r for e, r in zip(flat.equations, flat.residuals, strict=True)
                          if not (e.label.startswith("sum of") and "." not in e.owner and e.owner != "part")
                          and (not e.label.endswith("as given") or e.label.removesuffix(" as given").removeprefix("part.")
                               in inputs or e.owner != "part")]
        self.found: list[tuple[ca.SX, ca.SX]] = []
        self._peel(known)
        self.rest = self._unknown(self.residuals, known)
        if self.rest and len(self.rest) != len(self.residuals):
            raise ValueError(f"{len(self.residuals)} equations are left for {[s.name() for s in self.rest]}")
        self._compile()

    @staticmethod
    def _symbol_names(flat: Flat) -> list[tuple[ca.SX, str]]:
        """Every symbol of an unknown or its rate with each of its names, without `part.`."""
        forms = ("{}", "der({})", "der(der({}))")
        return [(flat.levels[k][j], form.format(name.removeprefix("part."))) for name, j in flat.names.items()
                for k, form in enumerate(forms)]

    @staticmethod
    def _given(name: str, by_name: Mapping[str, ca.SX], parameters: Mapping[str, ca.SX]) -> ca.SX:
        found = by_name.get(name, parameters.get(name))
        if found is None:
            raise KeyError(f"'{name}' is neither a variable nor a parameter; there are {sorted([*by_name, *parameters])}")
        return found

    @staticmethod
    def _unknown(residuals: Sequence[ca.SX], known: set[int]) -> list[ca.SX]:
        found = {s.element_hash(): s for r in residuals for s in ca.symvar(r)}
        return [s for h, s in found.items() if h not in known]

    def _peel(self, known: set[int]) -> None:
        """Take out equations with one unknown in which it is linear, and those that decide nothing else."""
        while True:
            for k, residual in enumerate(self.residuals):
                left = self._unknown([residual], known)
                if len(left) != 1:
                    continue
                slope = ca.jacobian(residual, left[0])
                if not ca.depends_on(slope, left[0]):
                    self.found.append((left[0], -ca.substitute(residual, left[0], ca.SX(0))/slope))
                    known.add(left[0].element_hash())
                    del self.residuals[k]
                    break
            else:
                if not self._drop_undecided(known):
                    return

    def _drop_undecided(self, known: set[int]) -> bool:
        """Take out an equation with an unknown that stands nowhere else, where there are more unknowns than equations."""
        left = [{s.element_hash() for s in self._unknown([r], known)} for r in self.residuals]
        if len(set().union(*left)) <= len(left):
            self.residuals = [r for r, own in zip(self.residuals, left, strict=True) if own]
            return False
        for k, own in enumerate(left):
            if own - set().union(*(other for i, other in enumerate(left) if i != k)):
                del self.residuals[k]
                return True
        return False

    def _compile(self) -> None:
        flat = self.flat
        # what is given may be a parameter or the time: its symbol stands in `given` then
        given = {s.element_hash() for s in self.given}
        p, (time,) = ([ca.SX.sym("unused") if s.element_hash() in given else s for s in own]
                      for own in (split(flat.p), [flat.time]))
        fixed = [stack(self.given), stack(p), time, flat.rate]
        explicit: list[ca.SX] = []
        symbols: list[ca.SX] = []
        for symbol, expression in self.found:
            explicit.append(ca.substitute(expression, stack(symbols), stack(explicit)) if symbols else expression)
            symbols.append(symbol)
        rest = stack(self.rest)
        residuals = stack(self.residuals)
        if symbols and self.residuals:
            residuals = ca.substitute(residuals, stack(symbols), stack(explicit))
        self.symbols = symbols
        self.explicit = ca.Function("explicit", fixed, [ca.densify(stack(explicit))])
        self.implicit = ca.Function("implicit", [rest, *fixed], [residuals, ca.densify(ca.jacobian(residuals, rest))])

    def at(self, columns: Sequence[Array], shape: tuple[int, ...], guess: Mapping[str, float]) -> Found:
        p = [q.value for q in self.flat.parameters]
        number = len(columns[0]) if columns else 1
        starts = np.array([guess.get(name, 0.0) for name in self._names_of(self.rest)])
        points = np.array(columns) if columns else np.zeros((0, 1))
        explicit = np.asarray(self.explicit(points, p, 0.0, 1.0), float).reshape(len(self.symbols), -1)
        explicit = np.broadcast_to(explicit, (len(self.symbols), number))
        implicit = [self._newton(starts, [points[:, k], p, 0.0, 1.0]) for k in range(number)] if self.rest else []
        found = Found()
        values = [*explicit, *(np.array(implicit).T if implicit else []), *columns]
        value_of = {s.element_hash(): np.asarray(v).reshape(shape) for s, v in
                    zip([*self.symbols, *self.rest, *self.given], values, strict=True)}
        found.update({name: value_of[s.element_hash()] for s, name in self.names if s.element_hash() in value_of})
        return found

    def _names_of(self, symbols: Sequence[ca.SX]) -> list[str]:
        first: dict[int, str] = {}
        for s, name in self.names:
            first.setdefault(s.element_hash(), name)
        return [first[s.element_hash()] for s in symbols]

    def _newton(self, start: Array, fixed: list[Any]) -> Array:
        """Newton's method with steps halved until the residual, in sizes of its slopes, falls."""
        y = start.astype(float)
        for _ in range(200):
            residual, jacobian = (np.asarray(o, float) for o in self.implicit(y, *fixed))
            weights = 1/np.abs(jacobian).max(axis=1)
            step = np.linalg.solve(jacobian*weights[:, None], -residual.ravel()*weights)
            norm, length = np.linalg.norm(residual.ravel()*weights), 1.0
            if np.all(np.abs(step) <= 1e-14*np.abs(y)) or norm == 0:
                return y + step
            while length > 1e-6 and not np.linalg.norm(
                    np.asarray(self.implicit(y + length*step, *fixed)[0]).ravel()*weights) < norm:
                length /= 2
            if length <= 1e-6:
                assert np.all(np.abs(step) <= 1e-8*np.abs(y)), f"no solution near {start}"
                return y
            y = y + length*step
        raise AssertionError(f"no solution near {start}")


def cubic_spline(x: ArrayLike, heights: Sequence[float]) -> Array:
    """Cardinal cubic B-splines of the given heights at -4, -3 ... 4, constant beyond these (de Boor)."""
    knots = np.arange(-9.0, 10.0)
    return np.asarray(BSpline(knots, [0, 0, 0, *heights, 0, 0, 0], 3)(np.clip(x, -4, 4)))
