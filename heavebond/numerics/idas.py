"""Integration by IDAS of SUNDIALS through the CasADi interface: options, failures, messages."""

from __future__ import annotations

import io
import os
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, redirect_stderr
from dataclasses import dataclass, replace
from functools import lru_cache
from threading import RLock
from typing import Any

import casadi as ca
import numpy as np

from heavebond.core.errors import Problem, UsageError
from heavebond.numerics.dae import LARGE, Array, Assembly, Integrand, smallest_pivot
from heavebond.numerics.machine_code import Evaluated
from heavebond.numerics.sparse_jacobian import given_jacobian
from heavebond.numerics.time_events import same_instant

# Largest number of steps between two output points: at a NaN IDAS would halve its step for minutes.
MOST_STEPS = 300_000
# First step where x' is unknown, as a share of the time to the first output point; steps double at first.
FIRST_STEP = 1e-9
# CasADi integrates no interval of less than 1e-9 of its time. If two stops are closer than so many seconds, it gets another
# unit of time.
SHORTEST = 1e-5
LARGEST_TOLERANCE = 0.1
_TURN = RLock()
RESTS = (0.01, 0.1, 1.0, 10.0, 100.0)  # s; instants at which `at_rest` yields the state
MOST_STEPS_TO_REST = 20_000


@dataclass(frozen=True)
class Tolerances:
    """Error control of the integrator: relative, and absolute in each unknown's nominal size.

    `along` is the weight of forward sensitivities in the error control: at 1 they are as accurate as the states, with
    twice the number of steps; at 1e-3 the states determine the steps, and the sensitivities are accurate to about 1e-4 of
    their largest value.
    """

    rtol: float = 1e-8
    atol: float = 1e-10
    along: float = 1e-3

    def __post_init__(self) -> None:
        for name, value in (("rtol", self.rtol), ("atol", self.atol)):
            if not 0 < value <= LARGEST_TOLERANCE:
                raise UsageError([Problem("tolerance-bad", f"{name} = {value:g} is no tolerance; it must be above 0 and at "
                                          f"most {LARGEST_TOLERANCE:g}", None, f"Leave it out, or give for example "
                                          f"{name}={type(self).__dataclass_fields__[name].default:g}.")])

    def scaled(self, factor: float) -> Tolerances:
        """Both tolerances times a factor."""
        return replace(self, rtol=factor * self.rtol, atol=factor * self.atol)


def time_unit(stops: Array) -> float:
    """The unit (s) of the time of CasADi's integrator: a second, or a shorter power of two so that two stops differ by at
    least one unit. SUNDIALS takes the same steps in units of any power of two, to the last bit."""
    gaps = np.diff(stops)
    shortest = float(np.min(gaps, where=gaps > same_instant(float(stops[0]), float(stops[-1])), initial=np.inf))
    return 1.0 if shortest >= SHORTEST else float(2.0 ** np.floor(np.log2(shortest)))


def in_unit_of_time(dae: Mapping[str, Any], unit: float) -> dict[str, Any]:
    """A DAE in another unit of time (s)."""
    if unit == 1.0:
        return dict(dae)
    rates, unscaled = [name for name in ("ode", "quad") if name in dae], [name for name in ("alg",) if name in dae]
    sides = [*(unit * dae[name] for name in rates), *(dae[name] for name in unscaled)]
    return {**dae, **dict(zip([*rates, *unscaled], ca.substitute(sides, [dae["t"]], [unit * dae["t"]]), strict=True))}


class Idas:
    """Integrator of a system from the first stop to the others; RuntimeError if IDAS fails.

    The initial values are consistent, so that IDACalcIC only has to find x'. Its line search changes the algebraic unknowns
    together with the states predicted by x', and fails where they depend on the states steeply, as in mechanisms. The
    integration is then repeated without IDACalcIC, with a first step so short that x' is not needed.
    """

    def __init__(self, integrand: Integrand, stops: Array, tolerances: Tolerances, most_steps: int = MOST_STEPS,
                 strict: bool = False):
        """`strict` includes the algebraic unknowns in the error control: the steps are shorter, and the predictor gives
        Newton's method a closer initial guess."""
        self._orders, unit = _orders(integrand.dae), time_unit(stops)
        # the equations with their unknowns permuted by `orders`
        dae = in_unit_of_time(integrand.dae, unit)
        rows = (("x", "x"), ("ode", "x"), ("z", "z"), ("alg", "z")) if self._orders else ()
        permuted = {name: dae[name][self._orders[unknown]] for name, unknown in rows}
        self._dae, self._begin = {**dae, **permuted}, float(stops[0] / unit)
        self._outputs = [float(t) for t in stops[1:] / unit] or [self._begin + 1.0]
        # half of the steps that a call with few steps may take double the first step up to the first output point
        self._first_step = max(FIRST_STEP, 2.0**(-most_steps/2)) * (self._outputs[0] - self._begin)
        self._options = {**integrator_options(self._dae, tolerances, integrand.smallest_pivot), "max_num_steps": most_steps,
                         **({"max_step_size": integrand.longest / unit} if integrand.longest else {})}
        if strict:
            self._options["suppress_algebraic"] = False
        self._usual = self._last = self._integrator({})
        self._blind: Evaluated | None = None

    def _integrator(self, options: Mapping[str, Any]) -> Evaluated:
        arguments = ("run", "idas", self._dae, self._begin, self._outputs)
        return Evaluated(lambda more: ca.integrator(*arguments, {**self._options, **options, **more}), ("xf", "zf"))

    def size1_in(self, name: str) -> int:
        """The number of elements of an input, as in `ca.Function`."""
        return self._usual.size1_in(name)

    def expect(self, seconds: float) -> None:
        """See `Evaluated`."""
        self._usual.expect(seconds)

    def __call__(self, **arguments: Any) -> dict[str, Array]:
        """The states and algebraic unknowns (n, N) at the other stops."""
        if not self._orders:
            return self._called(arguments)
        places = {name: self._orders[name[0]] for name in ("x0", "z0") if name in arguments}
        results = self._called({**arguments, **{name: np.asarray(arguments[name])[k] for name, k in places.items()}})
        return {**results, **{name: results[name][np.argsort(self._orders[name[0]])] for name in ("xf", "zf")}}

    def _called(self, arguments: Mapping[str, Any]) -> dict[str, Array]:
        self._last = self._usual
        try:
            return self._usual(**arguments)
        except RuntimeError as error:
            if "IDACalcIC" not in str(error):
                raise
        if self._blind is None:
            self._blind = self._integrator({"calc_ic": False, "step0": self._first_step})
        self._last = self._blind
        return self._blind(**arguments)

    def stats(self) -> dict[str, Any]:
        """Counts of steps and evaluations of the last call."""
        return self._last.stats()


def _orders(dae: Mapping[str, ca.SX]) -> dict[str, list[int]]:
    """Orders of the states and algebraic unknowns of a large system that reduce fill-in (approximate minimum degree), as
    CSparse factorises in the given order. Empty for small systems."""
    n_x, n_z = dae["x"].numel(), dae["z"].numel()
    if not is_large(dae):
        return {}
    pattern = ca.jacobian_sparsity(ca.vertcat(dae["ode"], dae["alg"]), ca.vertcat(dae["x"], dae["z"]))
    order = (pattern + pattern.T + ca.Sparsity.diag(n_x + n_z)).amd()
    return {"x": [k for k in order if k < n_x], "z": [k - n_x for k in order if k >= n_x]}


def at_rest(assembly: Assembly, t: float, x: Array, z: Array, p: Array, u: Array) -> Iterator[tuple[Array, Array]]:
    """Yield x (n_x,) and z (n_z,) of the transient with inputs and time frozen, at the instants RESTS; ends where IDAS
    fails."""
    symbols = assembly.arguments
    x_s, z_s = ca.SX.sym("x", len(x)), ca.SX.sym("z", len(z))
    x_size, z_size = assembly.x_nominal, assembly.z_nominal
    arguments = (t, x_s * x_size, z_s * z_size, p, u, 0.0)
    ode, alg = ca.substitute([assembly.ode / x_size, assembly.alg], list(symbols), [ca.SX(g) for g in arguments])
    dae = {"x": x_s, "z": z_s, "ode": ode, "alg": alg}
    options = {**integrator_options(dae, Tolerances(1e-6, 1e-8), smallest_pivot(assembly)),
               "max_num_steps": MOST_STEPS_TO_REST, "suppress_algebraic": False}
    scaled = x / x_size, z / z_size
    with caught_errors():
        for begin, end in zip((0.0, *RESTS[:-1]), RESTS, strict=True):
            try:
                results = ca.integrator("rest", "idas", dae, begin, end, options)(x0=scaled[0], z0=scaled[1])
            except RuntimeError:
                return
            scaled = np.array(results["xf"]).ravel(), np.array(results["zf"]).ravel()
            if not np.all(np.isfinite(np.concatenate(scaled))):
                return
            yield scaled[0] * x_size, scaled[1] * z_size


def is_large(dae: Mapping[str, ca.SX]) -> bool:
    """Whether a system is factorised by CSparse."""
    return bool(dae["x"].numel() + dae["z"].numel() >= LARGE)


def integrator_options(dae: Mapping[str, ca.SX], tolerances: Tolerances, pivot: float) -> dict[str, Any]:
    """The options of IDAS for a DAE; pivots of its Newton matrix below `smallest_pivot` count as zero."""
    large = is_large(dae)
    return {
        "reltol": tolerances.rtol, "abstol": tolerances.atol, "max_num_steps": MOST_STEPS, "print_time": False,
        # small models factorise fastest by sparse QR; large ones by CSparse
        "linear_solver": "csparse" if large else "qr",
        **({} if large else {"linear_solver_options": {"eps": pivot}}),
        "suppress_algebraic": bool(dae["z"].numel()), **(given_jacobian(dae) if large else {}),
    }


@contextmanager
def caught_errors() -> Iterator[list[str]]:
    """Capture standard error. SUNDIALS reports the time and step of a failure only there, from C or, by CasADi, through
    Python's `sys.stderr`. Both are shared by the whole process, so that a lock admits one thread at a time."""
    with _TURN:
        sys.stderr.flush()
        original, file = os.dup(2), _file(os.getpid())
        begin = os.lseek(file, 0, os.SEEK_END)
        heard: list[str] = []
        words = io.StringIO()
        with redirect_stderr(words):
            os.dup2(file, 2)
            try:
                yield heard
            finally:
                os.dup2(original, 2)
                os.close(original)
                os.lseek(file, begin, os.SEEK_SET)
                message = os.read(file, os.fstat(file).st_size - begin)
                os.ftruncate(file, begin)
                heard.append(message.decode(errors="replace") + words.getvalue())


@lru_cache(maxsize=1)
def _file(process: int) -> int:
    """The temporary file of a process for its captured messages; kept open, as opening takes as long as 100 steps."""
    with tempfile.TemporaryFile() as file:
        return os.dup(file.fileno())
