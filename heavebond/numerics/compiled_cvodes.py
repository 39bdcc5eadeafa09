"""CVODES driven by compiled code, for the many short runs of a search.

Through `ca.integrator` every evaluation of the right-hand side passes several layers and reads two clocks, which takes
longer than the equations of a small machine. Here a program in C (`heavebond/c/cvodes.c`) calls the same CVODES, by the
addresses of the functions in CasADi's own shared library, and evaluates the equations itself, from the list of operations
of the CasADi function. The program is the same for all models: a process compiles it once, into a private folder that
is deleted as soon as the library is loaded; nothing compiled is read back from disk.

It serves on Linux where a C compiler is present, CasADi brings the SUNDIALS that the program was written for, and the
equations are x' = f (`CompiledCvodes.fits`); everywhere else searches integrate through CasADi, by the same method with the
same tolerances.
"""

from __future__ import annotations

import ctypes
import subprocess
import sys
import tempfile
import weakref
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.core.cancellation import check
from heavebond.numerics.dae import Array
from heavebond.numerics.idas import Tolerances

SOURCE = Path(__file__).parents[1] / "c" / "cvodes.c"
FLAGS = ("-O2", "-shared", "-fPIC", "-ffp-contract=off")
VERSIONS = ("3.7", "3.8")  # of CasADi, whose CVODES is that of SUNDIALS 2 with double precision
MOST_STATES = 60  # of the model: its Jacobian is dense here
CHUNK = 100  # stops between two looks whether the run is still wanted
# What the program knows, in C, of the operands A and B.
OPERATIONS = {
    "ASSIGN": "A", "ADD": "A + B", "SUB": "A - B", "MUL": "A * B", "DIV": "A / B", "NEG": "-A", "EXP": "exp(A)",
    "LOG": "log(A)", "POW": "pow(A, B)", "CONSTPOW": "pow(A, B)", "SQRT": "sqrt(A)", "SQ": "A * A", "TWICE": "2.0 * A",
    "SIN": "sin(A)", "COS": "cos(A)", "TAN": "tan(A)", "ASIN": "asin(A)", "ACOS": "acos(A)", "ATAN": "atan(A)",
    "LT": "A < B", "LE": "A <= B", "EQ": "A == B", "NE": "A != B", "NOT": "!A", "AND": "A && B", "OR": "A || B",
    "FLOOR": "floor(A)", "CEIL": "ceil(A)", "FMOD": "fmod(A, B)", "FABS": "fabs(A)",
    "SIGN": "A < 0 ? -1.0 : A > 0 ? 1.0 : A", "COPYSIGN": "copysign(A, B)", "IF_ELSE_ZERO": "A != 0 ? B : 0.0",
    "ERF": "erf(A)", "FMIN": "fmin(A, B)", "FMAX": "fmax(A, B)", "INV": "1.0 / A", "SINH": "sinh(A)", "COSH": "cosh(A)",
    "TANH": "tanh(A)", "ASINH": "asinh(A)", "ACOSH": "acosh(A)", "ATANH": "atanh(A)", "ATAN2": "atan2(A, B)",
    "LOG1P": "log1p(A)", "EXPM1": "expm1(A)", "HYPOT": "hypot(A, B)"}
# Their numbers in CasADi, and in the order in which C has them.
KNOWN = {getattr(ca, f"OP_{name}"): k for k, name in enumerate(OPERATIONS) if hasattr(ca, f"OP_{name}")}
END = len(OPERATIONS)
# The functions of SUNDIALS in the order of the structure in C.
FUNCTIONS = (
    "CVodeCreate", "CVodeInit", "CVodeReInit", "CVodeSStolerances", "CVodeSetUserData", "CVodeSetMaxNumSteps",
    "CVodeSetMaxStep", "CVodeSetStopTime", "CVodeSetErrHandlerFn", "CVSpgmr", "CVSpilsSetPreconditioner",
    "CVSpilsSetJacTimesVecFn", "CVode", "CVodeGetNumSteps", "CVodeGetNumRhsEvals", "CVodeGetNumErrTestFails", "CVodeFree",
    "N_VNew_Serial", "N_VGetArrayPointer", "N_VDestroy_Serial")
MESSAGES = {-1: "mxstep steps taken before reaching tout", -2: "too much accuracy was asked for",
            -3: "error test failures occurred too many times", -4: "convergence test failures occurred too many times",
            -8: "the right-hand side failed", -9: "the right-hand side failed at the first call",
            -10: "the right-hand side failed repeatedly"}
_Pointer = ctypes.c_void_p


class _Tape(ctypes.Structure):
    _fields_ = [("length", ctypes.c_long), ("n_out", ctypes.c_long), ("n_constants", ctypes.c_long), ("code", _Pointer),
                ("out", _Pointer), ("slots", _Pointer)]


class _Problem(ctypes.Structure):
    _fields_ = [("sundials", _Pointer), ("right", _Tape), ("slope", _Tape),
                *((name, ctypes.c_long) for name in ("n", "blocks", "total", "n_p", "n_u", "n_pieces", "restart")),
                *((name, _Pointer) for name in ("rows", "columns", "breaks", "pieces")), ("piece", ctypes.c_long),
                *((name, _Pointer) for name in ("jacobian", "lu", "inverse", "pivots", "memory", "x"))]


class CompiledCvodes:
    """An integration of x' = f from the first to the other stops, called as those of `solvers` are."""

    def __init__(self, dae: Mapping[str, ca.SX], n: int, stops: Array, tolerances: Tolerances, most_steps: int,
                 table: tuple[Array, Array] | None = None, longest: float = 0.0):
        """`n` states of the model stand first in x, then blocks of their sensitivities, then integrals. `table` (breaks
        (m + 1,), columns (k, m)) is looked up by time in the right-hand side; without it the inputs are given to the call,
        for each interval between two stops, and integration begins anew at each."""
        compiled = program()
        assert compiled is not None
        self._program, self._stops = compiled, np.ascontiguousarray(stops, float)
        total, self._n_u = dae["x"].numel(), dae["u"].numel()
        given = [dae[name] for name in ("t", "x", "p", "u")]
        x = dae["x"][:n]
        jacobian = ca.jacobian(dae["ode"][:n], x) if n else ca.SX(0, 0)
        right, slope = _tape(given, dae["ode"]), _tape(given, jacobian.nz[:])
        rows, columns = (np.array(k, np.int32) for k in jacobian.sparsity().get_triplet())
        breaks, pieces = (np.zeros(0), np.zeros((0, 0))) if table is None else table
        pieces = np.ascontiguousarray(pieces.T)
        breaks = np.ascontiguousarray(breaks)
        self._counts = np.zeros(3, np.int64)
        # what C points to must live as long as this does
        self._kept: list[Any] = [rows, columns, breaks, pieces, np.zeros((n, n)), np.zeros((n, n)), np.zeros(n),
                                 np.zeros(n, np.int32), right, slope]
        self._problem = _Problem(
            ctypes.cast(compiled.sundials, _Pointer), right.structure(), slope.structure(), n,
            (total // n) if n else 0, total, dae["p"].numel(), self._n_u, len(pieces), table is None and self._n_u > 0,
            *(_address(k) for k in (rows, columns, breaks, pieces)), 0, *(_address(k) for k in self._kept[4:8]), None, None)
        self._totals = total, dae["p"].numel()
        answer = compiled.library.prepare(
            ctypes.byref(self._problem), self._stops[0], tolerances.rtol, tolerances.atol, most_steps, longest)
        # before what it points to is collected
        weakref.finalize(self, _finish, compiled.library, self._problem, self._kept)
        if answer:
            raise RuntimeError(f"CVODES could not be prepared ({answer})")

    @staticmethod
    def fits(dae: Mapping[str, ca.SX], n: int) -> bool:
        """Whether such equations can be integrated here."""
        return not dae["z"].numel() and 0 < n <= MOST_STATES and dae["x"].numel() > 0 and program() is not None and \
            _known(dae["ode"])

    def size1_in(self, name: str) -> int:
        """The number of numbers in an input."""
        return {"x0": self._totals[0], "p": self._totals[1], "z0": 0, "u": self._n_u}[name]

    def __call__(self, **given: Any) -> dict[str, Array]:
        """The states (n, N) at the other stops from x0 (n,), with p and, without a table, u (n_u, N); RuntimeError where
        CVODES fails."""
        problem, stops = self._problem, self._stops
        x, p = (np.ascontiguousarray(given[name], float).ravel() for name in ("x0", "p"))
        assert (len(x), len(p)) == self._totals  # C reads so many
        if problem.restart:
            self._held = np.ascontiguousarray(np.asarray(given["u"], float).T)
            assert self._held.shape == (max(len(stops) - 1, 1), self._n_u)
            problem.pieces, problem.n_pieces = _address(self._held), len(self._held)
        found = np.empty((max(len(stops) - 1, 1), len(x)))
        self._counts[:] = 0
        library, at = self._program.library, ctypes.byref(problem)
        answer = library.begin(at, stops[0], _address(x), _address(p))
        reached, first = ctypes.c_double(float(stops[0])), 0
        targets = stops if len(stops) > 1 else np.append(stops, stops[0] + 1.0)
        while not answer and first < len(targets) - 1:
            number = min(CHUNK, len(targets) - 1 - first)
            answer = library.advance(at, number, _address(targets[first:]), first, _address(found[first:]),
                                     ctypes.byref(reached), _address(self._counts))
            first += number
            check()
        if answer:
            raise RuntimeError(f"At t = {reached.value:.17g}, {MESSAGES.get(answer, f'CVODES answered {answer}')}")
        return {"xf": found.T, "zf": np.zeros((0, len(found)))}

    def stats(self) -> dict[str, Any]:
        """Counts of steps and evaluations of the last call."""
        return dict(zip(("nsteps", "nfevals", "netfails"), self._counts.tolist(), strict=True))


class _Listed:
    """A function as a list of operations over an array of slots: constants, then its inputs, then results."""

    def __init__(self, code: NDArray[np.int32], out: NDArray[np.int32], constants: Sequence[float], slots: int):
        self.code, self.out, self.n_constants = np.ascontiguousarray(code), out, len(constants)
        self.slots = np.zeros(slots)
        self.slots[:len(constants)] = constants

    def structure(self) -> _Tape:
        """As C sees it."""
        return _Tape(len(self.code), len(self.out), self.n_constants, _address(self.code), _address(self.out),
                     _address(self.slots))


def _tape(given: Sequence[ca.SX], wanted: ca.SX) -> _Listed:
    """The operations of an expression, each result in a slot of its own."""
    function = ca.Function("f", list(given), [ca.densify(wanted)])
    begins = np.cumsum([0, *(g.numel() for g in given)]).tolist()
    constant: dict[str, int] = {}
    code: list[tuple[int, int, int, int]] = []  # operands below 0 are constants, from 0 on inputs, then results
    at: dict[int, int] = {}  # where the value of each of CasADi's registers stands
    out = [0] * wanted.numel()
    number = begins[-1]
    for k in range(function.n_instructions()):
        operation, to, of = function.instruction_id(k), function.instruction_output(k), function.instruction_input(k)
        if operation == ca.OP_CONST:
            at[to[0]] = ~constant.setdefault(repr(function.instruction_constant(k)), len(constant))
        elif operation == ca.OP_INPUT:
            at[to[0]] = begins[of[0]] + of[1]
        elif operation == ca.OP_OUTPUT:
            out[to[1]] = at[of[0]]
        else:
            one = at[of[0]]
            code.append((KNOWN[operation], number, one, at[of[1]] if len(of) > 1 else one))
            at[to[0]] = number
            number += 1
    numbers = [float(value) for value in constant] or [0.0]  # an operation without operands reads the first slot
    first = len(numbers)

    def placed(slots: Any) -> NDArray[np.int32]:
        slots = np.array(slots, np.int32)
        return np.asarray(np.where(slots < 0, ~slots, slots + first), np.int32)

    code.append((END, 0, 0, 0))
    table = np.array(code, np.int32)
    table[:, 1:] = placed(table[:, 1:])
    return _Listed(table, placed(out), numbers, first + number)


def _known(wanted: ca.SX) -> bool:
    """Whether all operations of an expression are known to the program."""
    function = ca.Function("f", ca.symvar(wanted), [wanted])
    own = {ca.OP_CONST, ca.OP_INPUT, ca.OP_OUTPUT, *KNOWN}
    return all(function.instruction_id(k) in own for k in range(function.n_instructions()))


def _address(values: Any) -> int | None:
    return int(values.ctypes.data) if values.size else None


def _finish(library: ctypes.CDLL, problem: _Problem, kept: object) -> None:
    library.finish(ctypes.byref(problem))


class _Program:
    """The compiled program and the addresses of CVODES that it is given."""

    def __init__(self, library: ctypes.CDLL, sundials: Any):
        self.library, self.sundials = library, sundials
        number, real, whole = ctypes.c_double, ctypes.c_double, ctypes.c_long
        library.prepare.argtypes = [_Pointer, number, real, real, whole, real]
        library.begin.argtypes = [_Pointer, number, _Pointer, _Pointer]
        library.advance.argtypes = [_Pointer, whole, _Pointer, whole, _Pointer, _Pointer, _Pointer]
        library.finish.argtypes = [_Pointer]
        library.finish.restype = None


@lru_cache(maxsize=1)
def program() -> _Program | None:
    """The program, compiled at its first use; None where this computer has no compiler or another SUNDIALS."""
    from heavebond.numerics.solvers import compiler

    command = compiler()
    if command is None or not ca.CasadiMeta.version().startswith(VERSIONS) or sys.platform != "linux":
        return None
    try:
        sundials = _sundials()
        with tempfile.TemporaryDirectory(prefix="heavebond_", ignore_cleanup_errors=True) as folder:
            target = Path(folder) / "cvodes.so"
            labels = ", ".join([*(f"&&{name}_" for name in OPERATIONS), "&&END"])
            operations = " ".join(f"OPERATION({name}_, {text})" for name, text in OPERATIONS.items())
            subprocess.run([command, *FLAGS, f"-DLABELS={labels}", f"-DOPERATIONS={operations}", "-o", str(target),
                            str(SOURCE), "-lm"], check=True, capture_output=True, timeout=60)
            return _Program(ctypes.CDLL(str(target)), sundials)
    except (OSError, AttributeError, subprocess.SubprocessError):
        return None


def _sundials() -> Any:
    """The addresses of CVODES in CasADi's library; OSError or AttributeError where they are not found."""
    library = ctypes.CDLL(str(Path(ca.__file__).parent / "libcasadi_integrator_cvodes.so"))
    return (_Pointer * len(FUNCTIONS))(*(ctypes.cast(getattr(library, name), _Pointer) for name in FUNCTIONS))
