"""CVODES driven by compiled code, for the many short runs of a search.

Through `ca.integrator` every evaluation of the right-hand side passes several layers and reads two clocks, which takes
longer than the equations of a small machine. Here a program in C (`heavebond/c/cvodes.c`) calls the same CVODES, by the
addresses of the functions in CasADi's own shared library, and evaluates the equations itself, from the list of operations
of the CasADi function. The program is the same for all models: a process compiles it once, into a private folder that
is deleted as soon as the library is loaded; nothing compiled is read back from disk.

Once compiled equations would have saved as much time in the runs of one model as compiling takes, they are compiled as well,
in the same manner, while further runs go on with the list: a run, most of which is the integrator's own work, then takes 5
to 25 % less. The operations and their order are the same, and so are the results, to the last bit.

Records with few samples in a cycle of the motion ask for many steps between two samples, and a method of several steps falls
back to its low orders at each. Where CVODES takes more evaluations than the explicit one-step method of order 5 by Dormand
and Prince, at the same tolerances, that method may take over (see `Method`).

The program is used on Linux if a C compiler is present and CasADi's SUNDIALS passes a self-test, with a direct linear solver
or else with GMRES; otherwise searches integrate through CasADi, by the same method with the same tolerances.
"""

from __future__ import annotations

import contextlib
import ctypes
import faulthandler
import os
import shutil
import signal
import subprocess
import tempfile
import time as clock
import warnings
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from threading import Lock
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.core.cancellation import check
from heavebond.equations.buffered import Buffered
from heavebond.language.symbols import stack
from heavebond.numerics import machine_code
from heavebond.numerics.dae import Array, Assembly, from_begin
from heavebond.numerics.idas import Tolerances
from heavebond.numerics.machine_code import COMPILING, LISTED, MACHINE_CODE, compiler, loaded, worthwhile

SOURCE = Path(__file__).parents[1] / "c" / "cvodes.c"
FLAGS = ("-O2", "-ffp-contract=off")
EQUATION_FLAGS = ("-shared", "-fPIC", *machine_code.FLAGS)
MOST_STATES = 60  # of the model: its Jacobian is dense here
# Stages of the one-step method, with the first of the next step; how many times as many evaluations it may take as CVODES,
# whose own work in a step is at least half of that of an evaluation; and as it took itself at first.
STAGES, CHEAPER, WORSE = 7, 1.5, 3.0
# Stops between two looks whether the run is still wanted: at least, at most, and between these so that there are as
# many looks. One takes as long as thirty stops of a small machine.
CHUNK, LARGEST_CHUNK, LOOKS = 50, 200, 16
Watch = Callable[[int, Array], None]  # of the number of stops seen before, and the signals (k, n_signals) at those since


# The self-test of the program: largest error (it is some 5e-7), most steps (it takes some 520), and seconds until it is
# ended.
SELF_TEST_ERROR, SELF_TEST_STEPS, SELF_TEST_SECONDS = 1e-5, 1100, 20.0


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
    "CVSpilsSetJacTimesVecFn", "CVode", "CVodeGetDky", "CVodeGetNumSteps", "CVodeGetNumRhsEvals", "CVodeGetNumErrTestFails",
    "CVodeFree",
    "N_VNew_Serial", "N_VGetArrayPointer", "N_VDestroy_Serial")
MESSAGES = {-1: "mxstep steps taken before reaching tout", -2: "too much accuracy was asked for",
            -3: "error test failures occurred too many times", -4: "convergence test failures occurred too many times",
            -8: "the right-hand side failed", -9: "the right-hand side failed at the first call",
            -10: "the right-hand side failed repeatedly", -101: "the one-step method took too many evaluations"}
LIMIT_PASSED = -103
_Pointer = ctypes.c_void_p


class _Tape(ctypes.Structure):
    _fields_ = [("length", ctypes.c_long), ("n_out", ctypes.c_long), ("n_constants", ctypes.c_long), ("code", _Pointer),
                ("out", _Pointer), ("slots", _Pointer), ("compiled", _Pointer), ("first", ctypes.c_long)]


class _Pattern(ctypes.Structure):
    _fields_ = [("nonzeros", ctypes.c_long), ("rows", _Pointer), ("columns", _Pointer)]


class _Problem(ctypes.Structure):
    _fields_ = [("sundials", _Pointer), ("right", _Tape), ("full", _Tape), ("signals", _Tape), ("looked", _Tape),
                ("slopes", _Pattern),
                ("signal_slopes", _Pattern),
                *((name, ctypes.c_long) for name in ("n", "n_z", "m", "total", "n_moving", "n_p", "n_u", "n_signals",
                                                     "n_pieces", "restart", "n_kinks")),
                *((name, _Pointer) for name in ("breaks", "pieces", "at_stops", "kinks", "directions")),
                ("piece", ctypes.c_long), ("kink", ctypes.c_long), ("noted", ctypes.c_long * 3),
                *((name, _Pointer) for name in ("z", "along", "jacobian", "lu", "inverse", "pivots", "loop", "loop_inverse",
                                                "by_x", "loop_pivots", "memory", "x", "newton")),
                ("factored", ctypes.c_double), ("stages", _Pointer),
                *((name, ctypes.c_long) for name in ("one_step", "most_steps", "most_evaluations")),
                *((name, ctypes.c_double) for name in ("rtol", "atol", "longest", "step")),
                ("n_limits", ctypes.c_long), ("first_limit", ctypes.c_long), ("grace", _Pointer), ("margins", _Pointer),
                ("end", ctypes.c_double), ("at", ctypes.c_double), ("sampled", _Pointer)]


class Equations:
    """x' = f, 0 = g and signals s of (t, x, z, p, u) as lists of operations, with their derivatives by x, z and the
    parameters `moving` (indices), and further values `looked` without derivatives. What depends on p alone, other than its
    elements `changing`, is computed once a run. Raises NotCompiled."""

    def __init__(self, arguments_of_dae: Sequence[ca.SX], ode: ca.SX, alg: ca.SX, signals: ca.SX, moving: Sequence[int],
                 looked: ca.SX | None = None, changing: Sequence[int] = ()):
        _, x, z, p, _ = arguments_of_dae
        self.n, self.n_z, self.n_signals = x.numel(), z.numel(), signals.numel()
        if not 0 < self.n <= MOST_STATES or self.n_z > MOST_STATES:
            raise NotCompiled
        self.moving = list(moving)
        both, by = stack([ode, alg]), stack([x, z, p[self.moving]])
        slopes, signal_slopes = ca.jacobian(both, by), ca.jacobian(signals, by)
        parts = [both, ca.vec(slopes.nz[:]), signals, ca.vec(signal_slopes.nz[:]), ca.SX(0, 1) if looked is None else looked]
        ends = np.cumsum([part.numel() for part in parts])
        stacked, = ca.cse([stack(parts)])
        constants, parametric, fixed = p, ca.SX(0, 1), sorted({*range(p.numel())} - {*changing})
        if fixed:
            stacked, symbols, expressions = ca.extract_parametric(stacked, p[fixed])
            constants, parametric = stack([p, *symbols]), stack(expressions)
        self.hoist = Buffered(ca.Function("hoist", [p], [stack([p, parametric])]))
        self.n_p = constants.numel()
        arguments = [*arguments_of_dae[:3], constants, arguments_of_dae[4]]
        self.expressions = stack(arguments), (stacked[:self.n], stacked[:ends[1]], stacked[ends[1]:ends[3]],
                                                stacked[ends[3]:])
        self.functions: tuple[_Listed | _Machine, ...] = tuple(_tape(arguments, wanted) for wanted in self.expressions[1])
        self.seconds = 0.0  # that compiled code would have saved
        self.compilation: _Compilation | None = None
        self._turn = Lock()
        self.patterns = [tuple(np.array(k, np.int32) for k in of.sparsity().get_triplet()) for of in (slopes, signal_slopes)]

    def structures(self, slots: Sequence[Array]) -> tuple[_Tape, ...]:
        """The functions as C sees them, with `slots` of each to work in (see `slots`)."""
        return tuple(function.structure(slot) for function, slot in zip(self.functions, slots, strict=True))

    def jacobians(self) -> tuple[_Pattern, ...]:
        """The patterns of the Jacobians as C sees them."""
        return tuple(_Pattern(len(rows), _address(rows), _address(columns)) for rows, columns in self.patterns)

    def slots(self) -> list[Array]:
        """Arrays to work in, which no two integrations share: they may run in several threads."""
        return [function.slots.copy() for function in self.functions]

    def spent(self, evaluations: int, derivatives: bool) -> None:
        """Note the evaluations of a run, of f alone or with `derivatives`; once there were enough, the functions are
        compiled: when these evaluations, compiled, would have saved as much time as compiling takes."""
        right, full, *_ = self.functions
        with self._turn:
            self.seconds += COMPILING.seconds_saved * evaluations * (full if derivatives else right).length
            if self.compilation is None:
                if worthwhile(self.seconds, sum(function.length for function in self.functions)):
                    self.compilation = _Compilation(*self.expressions)
            elif compiled_functions := self.compilation.functions():
                self.functions = compiled_functions


class LimitReached(Exception):
    """A run ended at the time `t` because a variable is below its physical limit, with scaled states x (n,) and algebraic
    unknowns z (n_z,)."""

    def __init__(self, t: float, x: Array, z: Array):
        super().__init__()
        self.t, self.x, self.z = t, x, z


class NotCompiled(Exception):
    """The program in C does not have an operation of the equations, or they are too many for a dense Jacobian."""


def scaled_equations(assembly: Assembly, signals: ca.SX, moving: Sequence[int], begin: float,
                     quadratures: ca.SX | None = None, factors: ca.SX | None = None, looked: ca.SX | None = None,
                     flags: ca.SX | None = None) -> Equations | None:
    """The equations of an assembly in scaled unknowns, with integrals behind the states, and factors in these and then the
    `flags` of events behind the parameters, all with the time counted from `begin`; None if the program in C cannot
    evaluate them. Held variables and flags may change in a run."""
    t, x, z, p, u, rate = assembly.arguments
    x_s, z_s = ca.SX.sym("x", x.numel()), ca.SX.sym("z", z.numel())
    x_nominal, z_nominal = ca.SX(ca.DM(assembly.x_nominal)), ca.SX(ca.DM(assembly.z_nominal))
    x_origin = ca.SX(ca.sparsify(ca.DM(assembly.x_origin)))
    rates = assembly.ode / x_nominal
    if quadratures is not None:
        rates = stack([rates, quadratures])
    expressions = [rates, assembly.alg, signals, ca.SX(0, 1) if looked is None else looked]
    ode, alg, signals, looked = ca.substitute(from_begin(expressions, t, begin), [x, z, rate],
                                              [x_origin + x_s * x_nominal, z_s * z_nominal, ca.SX(1)])
    integrals = ca.SX.sym("integral", ode.numel() - x_s.numel())
    parameters = stack([p, *(more for more in (factors, flags) if more is not None)])
    changing = () if flags is None else (*(h.index for h in assembly.flat.held),
                                         *range(parameters.numel() - flags.numel(), parameters.numel()))
    try:
        return Equations((t, stack([x_s, integrals]), z_s, parameters, u), ode, alg, signals, moving, looked, changing)
    except NotCompiled:
        return None


@dataclass(frozen=True)
class Driving:
    """The inputs of the equations, columns u (n_u, ...): `pieces` (n_u, k) between `breaks` (k + 1,), and `at_stops` (n_u,
    N). Integration begins anew at every stop where it `restarts`; then there is one piece for each interval between stops.
    It also begins anew at the `kinks` (n_kinks,), which are stops."""

    breaks: Array
    pieces: Array
    at_stops: Array
    restarts: bool
    kinks: Array = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class Method:
    """The integrator: CVODES, or with `one_step` the method of Dormand and Prince. The latter is replaced by CVODES for all
    further runs if it takes more than this mean number of evaluations between two stops, because the equations are stiff."""

    one_step: bool
    evaluations: float = 0.0


CVODES = Method(False)


class CompiledCvodes:
    """An integration of x' = f, 0 = g with m forward sensitivities from the first to the other stops."""

    def __init__(self, equations: Equations, m: int, stops: Array, tolerances: Tolerances, most_steps: int,
                 driving: Driving | None = None, longest: float = 0.0, method: Method | None = CVODES,
                 graces: Array | None = None, compiled: _Program | None = None):
        """Steps are no longer than `longest` (s) if it is above 0. Without a `method` the first run decides. The last
        values `looked` of the equations are distances of variables from their physical limits: a run ends (LimitReached) at
        an accepted step where one is below its limit by more than its grace (k,). `compiled` is the program, by default the
        one that passed the self-test (see `program`)."""
        compiled = compiled or program()
        assert compiled is not None
        self._program, self._stops, self.equations = compiled, np.ascontiguousarray(stops, float), equations
        n, n_z, self.m, self._total = equations.n, equations.n_z, m, equations.n * (1 + m)
        self.method = method
        none = np.zeros((0, 0))
        driving = driving or Driving(np.zeros(0), none, none, False)
        columns = [np.ascontiguousarray(driving.breaks, float), np.ascontiguousarray(driving.pieces.T, float),
                   np.ascontiguousarray(driving.at_stops.T, float), np.ascontiguousarray(driving.kinks, float)]
        self._directions = np.zeros((max(m, 1), len(equations.moving)))
        self._z = np.zeros(n_z)
        work = [self._z, np.zeros(n_z * m), np.zeros((n, n)), np.zeros((n, n)), np.zeros(n), np.zeros(n, np.int32),
                np.zeros((n_z, n_z)), np.zeros(n_z), np.zeros((n, n_z)), np.zeros(n_z, np.int32)]
        stages = np.zeros((STAGES + 1, self._total))
        self._counts = np.zeros(3, np.int64)
        graces = np.zeros(0) if graces is None else np.ascontiguousarray(graces, float)
        # of the last run: the least distances from the limits, their times, and the largest distances
        self.margins = np.zeros((3, len(graces)))
        # what C points to must live as long as this does
        self._functions, slots = equations.functions, equations.slots()
        self._kept = references = [*columns, *work, stages, graces, self.margins, *slots, self._directions, equations,
                                   self._functions]
        n_u = driving.pieces.shape[0]
        assert n_u == 0 or len(columns[2]) == len(stops)  # C reads so many
        self._problem = _Problem(
            ctypes.cast(compiled.sundials, _Pointer), *equations.structures(slots), *equations.jacobians(), n, n_z, m,
            self._total, len(equations.moving), equations.n_p, n_u, equations.n_signals, len(columns[1]), driving.restarts,
            len(driving.kinks), *map(_address, columns), _address(self._directions), 0, 0, (0, 0, 0),
            *map(_address, work), None, None, None, 0.0, _address(stages), 0, 0, 0, 0.0, 0.0, 0.0, 0.0,
            len(graces), len(self._functions[3].out) - len(graces), _address(graces), _address(self.margins),
            self._stops[-1], 0.0, None)
        answer = compiled.library.prepare(
            ctypes.byref(self._problem), self._stops[0], tolerances.rtol, tolerances.atol, most_steps, longest,
            compiled.direct)
        # before what it points to is collected
        weakref.finalize(self, _finish, compiled.library, self._problem, references)
        if answer:
            raise RuntimeError(f"CVODES could not be prepared ({answer})")

    def limit_steps(self, longest: float) -> None:
        """Make the steps of further runs no longer than this (s); 0 for no limit."""
        self._program.library.limit(ctypes.byref(self._problem), longest)

    def run(self, x0: Array, z0: Array, p: Array, directions: Array, states: bool = True, watch: Watch | None = None
            ) -> Integrated:
        """From x0 (n (1 + m),), the states and then their sensitivities along each column of `directions` (n_p, m), with z
        near z0 (n_z,); RuntimeError if CVODES fails. Without `states` only the signals are kept. `watch` is called after
        at least `CHUNK` stops with the signals at these, from the first stop again if another method starts over; an
        exception that it raises ends the run."""
        arguments, intervals = (x0, z0, p, directions, states, watch), len(self._stops) - 1
        if self.method is not None and self.method.one_step:
            try:
                return self._run(*arguments, most=int(self.method.evaluations * intervals))
            except RuntimeError:
                check()
                self.method = CVODES
        integrated = self._run(*arguments)
        if self.method is None:
            self.method, evaluations = CVODES, int(self._counts[1])
            if (most := int(CHEAPER * evaluations)) > (STAGES - 1) * intervals:
                with contextlib.suppress(RuntimeError):
                    integrated = self._run(*arguments, most=most)
                    self.method = Method(True, WORSE * int(self._counts[1]) / intervals)
                check()
        return integrated

    def _run(self, x0: Array, z0: Array, p: Array, directions: Array, states: bool, watch: Watch | None, most: int = 0
             ) -> Integrated:
        """The same by CVODES, or by the one-step method with so many evaluations at `most`."""
        equations, problem, stops = self.equations, self._problem, self._stops
        x0, z0 = np.ascontiguousarray(x0, float), np.ascontiguousarray(z0, float)
        hoisted, = equations.hoist(p).values()
        hoisted = np.ascontiguousarray(hoisted.ravel())
        assert (len(x0), len(z0), len(hoisted)) == (self._total, equations.n_z, equations.n_p)  # C reads so many
        self._directions[:self.m] = directions[equations.moving].T
        N, m = len(stops), self.m
        x = np.empty((N, self._total)) if states else np.zeros((0, 0))
        z = np.empty((N, equations.n_z * (1 + m))) if states else np.zeros((0, 0))
        signals = np.empty((N, equations.n_signals * (1 + m)))
        outputs = [_address(k) for k in (x, z, signals)]
        self._counts[:] = 0
        problem.one_step, problem.most_evaluations = most > 0, most
        self._renew()
        library, at = self._program.library, ctypes.byref(problem)
        answer = library.begin(at, stops[0], _address(x0), _address(z0), _address(hoisted), *outputs)
        chunk = min(max(CHUNK, N // LOOKS), LARGEST_CHUNK)
        reached, first, reported = ctypes.c_double(float(stops[0])), 0, 0
        stops_address, counts = _address(stops) or 0, _address(self._counts)
        try:
            while not answer and first < N - 1:
                number = min(chunk, N - 1 - first)
                answer = library.advance(at, number, stops_address + first * stops.itemsize, first, *outputs,
                                         ctypes.byref(reached),
                                         counts)
                first += number
                check()
                if watch is not None and not answer:
                    watch(reported, signals[reported:first + 1, :equations.n_signals])
                    reported = first + 1
        finally:
            equations.spent(int(self._counts[1]), bool(m or equations.n_z))
        if answer == LIMIT_PASSED:
            n = equations.n
            ended = ctypes.cast(library.state(at), ctypes.POINTER(ctypes.c_double))
            raise LimitReached(reached.value, np.array(ended[:n]), self._z.copy())
        if answer:
            raise RuntimeError(f"At t = {reached.value:.17g}, {MESSAGES.get(answer, f'CVODES answered {answer}')}")
        return Integrated(x.T, z.T, signals.reshape(N, 1 + m, equations.n_signals))

    def _renew(self) -> None:
        """Update the functions: they may have been compiled since the last run."""
        if self._functions is self.equations.functions:
            return
        self._functions, slots = self.equations.functions, self.equations.slots()
        self._kept += [*slots, self._functions]
        for name, structure in zip(("right", "full", "signals", "looked"), self.equations.structures(slots), strict=True):
            setattr(self._problem, name, structure)

    def stats(self) -> dict[str, Any]:
        """Counts of steps and evaluations of the last run, how the equations were evaluated, and which linear solver CVODES
        was given."""
        how = MACHINE_CODE if isinstance(self._functions[0], _Machine) else LISTED
        return {**dict(zip(("nsteps", "nfevals", "netfails"), self._counts.tolist(), strict=True)), "equations": how,
                "linear_solver": "none" if self._problem.one_step else "direct" if self._problem.newton else "gmres"}


@dataclass(frozen=True)
class Integrated:
    """Along the stops: x (n (1 + m), N) and z (n_z (1 + m), N), each with its sensitivities behind it, and the signals with
    theirs (N, 1 + m, n_signals)."""

    x: Array
    z: Array
    signals: Array


class _Listed:
    """A function as a list of operations over an array of slots: constants, then its inputs, then results."""

    def __init__(self, code: NDArray[np.int32], out: NDArray[np.int32], constants: Sequence[float], slots: int):
        self.code, self.out, self.n_constants = np.ascontiguousarray(code), out, len(constants)
        self.slots = np.zeros(slots)
        self.slots[:len(constants)] = constants
        self.length = len(code)

    def structure(self, slots: Array) -> _Tape:
        """As C sees it."""
        return _Tape(len(self.code), len(self.out), self.n_constants, _address(self.code), _address(self.out),
                     _address(slots), None, 0)


class _Machine:
    """A function as machine code. Its first slots are the inputs, the next ones the outputs."""

    def __init__(self, library: ctypes.CDLL, name: str, inputs: int, outputs: int):
        self.library, self.length, self.first = library, 0, inputs
        self.out = np.arange(inputs, inputs + outputs, dtype=np.int32)
        self.slots = np.zeros(inputs + outputs)
        self.pointer = ctypes.cast(getattr(library, name), _Pointer)

    def structure(self, slots: Array) -> _Tape:
        """As C sees it."""
        return _Tape(0, len(self.out), 0, None, _address(self.out), _address(slots), self.pointer, self.first)


class _Compilation:
    """A compiler at work on functions of one column, with the same operations in the same floating-point arithmetic. It ends
    with this object, at the latest with the process."""

    def __init__(self, arguments: ca.SX, wanted: Sequence[ca.SX]):
        generator = ca.CodeGenerator("equations.c")
        for k, expression in enumerate(wanted):
            generator.add(ca.Function(f"equations_{k}", [arguments], [ca.densify(expression)]))
        self._sizes, self._until = [(arguments.numel(), of.numel()) for of in wanted], clock.monotonic() + COMPILING.timeout
        self._process: subprocess.Popen[bytes] | None = None
        if (command := compiler()) is None:
            return
        folder = tempfile.mkdtemp(prefix="heavebond_")
        source, self._target = Path(folder) / "equations.c", Path(folder) / "equations.so"
        source.write_text(generator.dump(), encoding="utf-8")
        self._process = subprocess.Popen([command, *EQUATION_FLAGS, "-o", str(self._target), str(source), "-lm"],
                                         stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self._end = weakref.finalize(self, _end_compiler, self._process, folder)

    @property
    def busy(self) -> bool:
        """True if the functions are not yet returned."""
        return self._process is not None

    def functions(self) -> tuple[_Machine, ...] | None:
        """The functions as machine code, returned once; None during the compilation, after the first return, and if the
        compiler fails."""
        if self._process is None:
            return None
        answer, library = self._process.poll(), None
        if answer is None and clock.monotonic() < self._until:
            return None
        if answer == 0:
            with contextlib.suppress(OSError):
                library = ctypes.CDLL(str(self._target))
        self._end()
        self._process = None
        return None if library is None else tuple(_Machine(library, f"equations_{k}", *sizes)
                                                  for k, sizes in enumerate(self._sizes))


def _end_compiler(process: subprocess.Popen[bytes], folder: str) -> None:
    process.kill()
    process.wait()
    shutil.rmtree(folder, ignore_errors=True)


def _tape(arguments: Sequence[ca.SX], wanted: ca.SX) -> _Listed:
    """The operations of an expression, each with a separate slot for its result."""
    function = ca.Function("f", list(arguments), [ca.densify(wanted)])
    begins = np.cumsum([0, *(g.numel() for g in arguments)]).tolist()
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
            if operation not in KNOWN:
                raise NotCompiled
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


def _address(values: Any) -> int | None:
    return int(values.ctypes.data) if values.size else None


def _finish(library: ctypes.CDLL, problem: _Problem, references: object) -> None:
    library.finish(ctypes.byref(problem))


class _Program:
    """The compiled program and the addresses of CVODES that it is given; `direct` permits the direct solver."""

    def __init__(self, library: ctypes.CDLL, sundials: Any, direct: bool):
        self.library, self.sundials, self.direct = library, sundials, direct
        number, real, whole = ctypes.c_double, ctypes.c_double, ctypes.c_long
        library.prepare.argtypes = [_Pointer, number, real, real, whole, real, ctypes.c_int]
        library.begin.argtypes = [_Pointer, number, *[_Pointer] * 6]
        library.advance.argtypes = [_Pointer, whole, _Pointer, whole, *[_Pointer] * 5]
        library.limit.argtypes = [_Pointer, number]
        library.state.argtypes, library.state.restype = [_Pointer], _Pointer
        library.place.argtypes, library.place.restype = [_Pointer] * 5, None
        library.sample.argtypes = [_Pointer, number, whole, *[_Pointer] * 13]
        library.finish.argtypes = [_Pointer]
        library.finish.restype = None


@lru_cache(maxsize=1)
def program() -> _Program | None:
    """The program, compiled at its first use. It has the direct solver if the self-test passes with it, else GMRES; None
    if this computer has no compiler, if its SUNDIALS has other functions, or if no self-test passes."""
    labels = ", ".join([*(f"&&{name}_" for name in OPERATIONS), "&&END"])
    operations = " ".join(f"OPERATION({name}_, {text})" for name, text in OPERATIONS.items())
    try:
        # the addresses of CVODES in CasADi's library
        solvers = ctypes.CDLL(str(Path(ca.__file__).parent / "libcasadi_integrator_cvodes.so"))
        sundials = (_Pointer * len(FUNCTIONS))(*(ctypes.cast(getattr(solvers, name), _Pointer) for name in FUNCTIONS))
    except (OSError, AttributeError):
        return None
    library = loaded(SOURCE, (*FLAGS, f"-DLABELS={labels}", f"-DOPERATIONS={operations}"))
    if library is None:
        return None
    return next((p for p in (_Program(library, sundials, direct) for direct in (True, False)) if _passes(p)), None)


def _passes(candidate: _Program) -> bool:
    """Run the self-test in a child process, so that a crash or an endless loop ends the child alone."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of Python 3.12 in a process with several threads
        child = os.fork()
    if child == 0:
        faulthandler.disable()  # a crash is an answer here
        passed = False
        try:
            passed = _self_test(candidate)
        finally:
            os._exit(0 if passed else 1)
    end = clock.monotonic() + SELF_TEST_SECONDS
    while clock.monotonic() < end:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return status == 0
        clock.sleep(0.001)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return False


def _self_test(candidate: _Program) -> bool:
    """Compare a run with the closed solution of a damped oscillator, x = exp(-d t) (cos W t + d/W sin W t) with
    W^2 = w^2 - d^2, and its sensitivity to w; the spring force is an algebraic unknown.

    The errors of CVODES add up to some 50 times the tolerance over three periods. SELF_TEST_ERROR leaves twenty times that;
    a wrong linear solver or a wrong entry of its memory errs by far more, takes more steps, or fails.
    """
    t, x, z, w, u = (ca.SX.sym(name, k) for name, k in (("t", 1), ("x", 2), ("z", 1), ("w", 1), ("u", 0)))
    damping, frequency, tolerances = 0.2, 1.3, Tolerances(1e-8, 1e-10)
    equations = Equations([t, x, z, w, u], ca.vertcat(x[1], z - 2 * damping * x[1]), z + w**2 * x[0], x[0], [0])
    stops = np.linspace(0.0, 15.0, 31)
    run = CompiledCvodes(equations, 1, stops, tolerances, 1000, compiled=candidate)
    integrated = run.run(np.array([1.0, 0.0, 0.0, 0.0]), np.array([-frequency**2]), np.array([frequency]), np.eye(1))

    def closed(w: complex) -> NDArray[np.complex128]:
        turn = np.sqrt(w**2 - damping**2 + 0j)
        return np.asarray(np.exp(-damping * stops) * (np.cos(turn * stops) + damping / turn * np.sin(turn * stops)))

    exact = closed(frequency + 1e-30j)  # its imaginary part is the derivative times the step
    error = np.abs(integrated.signals[:, :, 0] - np.stack([exact.real, exact.imag / 1e-30], axis=1)).max()
    return bool(error < SELF_TEST_ERROR and run.stats()["nsteps"] < SELF_TEST_STEPS)
