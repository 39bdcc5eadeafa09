"""IDAS through CasADi, and what it is told of a system."""

from __future__ import annotations

import io
import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stderr
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.dae import Array, Integrand

# Steps between two output points, after which a run is given up: at a value that is no number IDAS would halve its
# step for minutes.
MOST_STEPS = 300_000
# Share of the way to the first output point that a first step without a known x' is tried with; steps double at first.
FIRST_STEP = 1e-9


@dataclass(frozen=True)
class Tolerances:
    """Error control of the integrator: relative, and absolute in each unknown's nominal size.

    `along` is the weight of forward sensitivities in it: at 1 they are as accurate as the states, at twice the steps;
    at 1e-3 they ride on the steps of the states and are right to some 1e-4 of their largest value.
    """

    rtol: float = 1e-8
    atol: float = 1e-10
    along: float = 1e-3


class Buffered:
    """A function of CasADi that works on arrays where they are. (Made into an array number by number, the states at 6000
    points take longer than a tenth of a run.) Inputs that are not given are zero."""

    def __init__(self, function: ca.Function, outputs: Sequence[str]):
        self._buffer, self._run = function.buffer()
        self._given = {name: np.zeros(function.nnz_in(name)) for name in function.name_in()}
        self._shapes = {name: (function.size2_out(name), function.size1_out(name)) for name in outputs}
        self._number = {name: function.index_out(name) for name in outputs}
        for k, values in enumerate(self._given.values()):
            if values.size:
                self._set(self._buffer.set_arg, k, values)

    @staticmethod
    def _set(bind: Callable[..., None], number: int, values: NDArray[np.float64]) -> None:
        bind(number, memoryview(values))  # type: ignore[arg-type]  # arrays are buffers, which typing knows from Python 3.12 on

    def __call__(self, **given: Any) -> dict[str, Array]:
        for name, values in self._given.items():
            values[:] = np.asarray(given[name], float).ravel(order="F") if name in given else 0.0
        found = {name: np.empty(shape) for name, shape in self._shapes.items()}
        for name, made in found.items():
            if made.size:
                self._set(self._buffer.set_res, self._number[name], made)
        self._run()
        return {name: made.T for name, made in found.items()}

    def size1_in(self, name: str) -> int:
        """The number of numbers in an input."""
        return len(self._given[name])

    def stats(self) -> dict[str, Any]:
        """Counts of steps and evaluations of the last call."""
        return dict(self._buffer.stats())


class Idas:
    """The integration of a system from the first to the other stops; RuntimeError where IDAS fails.

    What it starts from is consistent, and IDAS has to find x' only. Its line search for that moves the algebraic unknowns
    with the states that x' would lead to, and finds no way where they follow steeply, as in a mechanism. Then it begins
    without x', by a step so short that none is needed.
    """

    def __init__(self, made: Integrand, stops: Array, tolerances: Tolerances, most_steps: int = MOST_STEPS):
        self._dae, self._begin = made.dae, float(stops[0])
        self._outputs = [float(t) for t in stops[1:]] if len(stops) > 1 else [self._begin + 1.0]
        self._options = {**integrator_options(made.dae, tolerances), "max_num_steps": most_steps}
        self._usual = self._last = self._made({})
        self._blind: Buffered | None = None

    def _made(self, options: Mapping[str, Any]) -> Buffered:
        return Buffered(ca.integrator("run", "idas", self._dae, self._begin, self._outputs, {**self._options, **options}),
                        ("xf", "zf"))

    def size1_in(self, name: str) -> int:
        """The number of numbers in an input, as in `ca.Function`."""
        return self._usual.size1_in(name)

    def __call__(self, **given: Any) -> dict[str, Array]:
        """The states and algebraic unknowns (n, N) at the other stops."""
        self._last = self._usual
        try:
            return self._usual(**given)
        except RuntimeError as error:
            if "IDACalcIC" not in str(error):
                raise
        if self._blind is None:
            self._blind = self._made({"calc_ic": False, "step0": FIRST_STEP * (self._outputs[0] - self._begin)})
        self._last = self._blind
        return self._blind(**given)

    def stats(self) -> dict[str, Any]:
        """Counts of steps and evaluations of the last call."""
        return self._last.stats()


def integrator_options(dae: Mapping[str, ca.SX], tolerances: Tolerances) -> dict[str, Any]:
    """What IDAS is told of a DAE."""
    return {
        "reltol": tolerances.rtol, "abstol": tolerances.atol, "max_num_steps": MOST_STEPS, "print_time": False,
        # small models factorise fastest by sparse QR; large ones by CSparse
        "linear_solver": "qr" if dae["x"].numel() + dae["z"].numel() < 100 else "csparse",
        "suppress_algebraic": bool(dae["z"].numel()),
    }


@contextmanager
def caught_errors() -> Iterator[list[str]]:
    """Catch what is written to standard error: the time and step at which SUNDIALS gave up are said only there, by C
    itself or by CasADi through Python's `sys.stderr`."""
    sys.stderr.flush()
    kept = os.dup(2)
    heard: list[str] = []
    words = io.StringIO()
    with tempfile.TemporaryFile() as file, redirect_stderr(words):
        os.dup2(file.fileno(), 2)
        try:
            yield heard
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            file.seek(0)
            heard.append(file.read().decode(errors="replace") + words.getvalue())
