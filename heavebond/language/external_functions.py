"""Functions outside the language: C source files, shared libraries and Python files as functions of CasADi.

The arguments of a call are one vector x (n,) in SI, lists and matrices row by row, its results one vector y (m,). A call is
one operation of an expression. Its derivatives are given by another function of the same file, or are central differences
with steps of STEPS times the larger of |x_i| and its nominal size. The second and third derivatives, which index reduction
and Jacobians of sensitivities need, are differences of these.

Nothing is compiled, loaded or executed without permission: see `External.allowed`.
"""

from __future__ import annotations

import atexit
import ctypes
import hashlib
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from math import isfinite
from pathlib import Path
from typing import Any, cast

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import HeavebondError, ModelError, Problem
from heavebond.core.presentation import count
from heavebond.text.shapes import Shape, elements
from heavebond.text.syntax import Function

Array = NDArray[np.float64]
COMPILERS = ("gcc", "clang", "cc")
# the third root of the rounding error balances it with the truncation of a central difference; for differences of
# differences the steps are wider
STEPS = (6e-6, 3e-4, 3e-3)
# a program calls its own functions, not functions of the same name in a program that was loaded before
OWN_NAMES = ("-Wl,-Bsymbolic",) if sys.platform.startswith("linux") else ()
MOST_LOST = 2000  # recent results of a Python function that are not numbers, after which a run ends
DERIVATIVES = 0.01  # relative difference of given derivatives from differences, above which they are refused
LARGEST_DERIVATIVE = 20_000  # numbers of a third derivative, which is left out if it has more
LIBRARIES = (".so", ".dll", ".dylib")
FORMS = (".c", *LIBRARIES, ".py")
SIGNATURES = ("values", "20-sim")
FLAGS = ("-O2", "-ffp-contract=off", "-Werror=implicit-function-declaration", "-Werror=incompatible-pointer-types",
         "-Werror=int-conversion")
LONGEST = 120  # s that a compiler may take
NOT_ALLOWED = "native-not-allowed"
VALUES = 4  # elements of a list that a message shows
LINES = 12  # lines of the compiler that a message shows


@dataclass(frozen=True)
class ForeignFunction:
    """A function of CasADi that calls a program: the C text of its wrapper (empty for a Python function), the sizes of its
    inputs, and the arguments of the first result that was not a number, after them the number of such results. `errors`
    holds the first error of a Python function that had no result."""

    function: Function
    casadi: ca.Function
    text: str
    sizes: tuple[int, ...]
    record: Any  # ctypes array or list (n + 1,)
    errors: list[str] = field(default_factory=list)

    def lost(self) -> str:
        """A sentence on the first result that was not a number; empty if there is none."""
        if not self.record[len(self.record) - 1]:
            return ""
        texts, at = [], 0
        for quantity, size in zip(self.function.inputs.values(), self.sizes, strict=True):
            unit = "" if quantity.unit.text == "1" or "$" in quantity.unit.text else f" {quantity.unit.text}"
            values = [f"{self.record[k]:.6g}" for k in range(at, at + min(size, VALUES))]
            more = ", ..." if size > VALUES else ""
            texts.append(f"{quantity.name} = " + (f"[{', '.join(values)}{more}]" if quantity.sizes else values[0]) + unit)
            at += size
        why = f" ({self.errors[0]})" if self.errors else ""
        return f"{self.function.name} gave a result that is not a number for {', '.join(texts)}{why}"

    def forget(self) -> None:
        """Forget earlier results that were not numbers."""
        self.record[len(self.record) - 1] = 0
        self.errors.clear()


_made: dict[tuple[object, ...], ForeignFunction] = {}
_operations: dict[str, ca.Function] = {}
_folder: list[str] = []
_watched: ContextVar[bool] = ContextVar("watched", default=False)


@contextmanager
def naming_results() -> Iterator[None]:
    """Context: add to an error which external functions gave results that are not numbers, and for which arguments. In a
    context within another one, the outer one does so."""
    if _watched.get():
        yield
        return
    for foreign in _made.values():
        foreign.forget()
    token = _watched.set(True)
    try:
        yield
    except HeavebondError as error:
        if sentences := [text for foreign in _made.values() if (text := foreign.lost())]:
            first, *others = error.problems
            error.problems = (replace(first, notes=(*sentences, *first.notes)), *others)
            error.args = ("\n\n".join(map(str, error.problems)),)
        raise
    finally:
        _watched.reset(token)


def refused(function: Function) -> Problem:
    """The problem of a function whose program must not be executed, at its file."""
    external = function.external
    assert external is not None
    what = "compiles and runs" if external.path.suffix == ".c" else "runs"
    return Problem(NOT_ALLOWED, f"{function.name} {what} {external.path.name}, which can do whatever a program can",
                   function.place, "If you trust the file, add `--allow-native` to the command, or in Python "
                   "`hb.load(file, allow_native=True)`.")


def called(function: Function, args: Sequence[ca.SX], outputs: dict[str, Shape]) -> dict[str, ca.SX]:
    """Each output of a call; `outputs` are their shapes. ModelError if the program must not run or cannot be loaded."""
    external = function.external
    assert external is not None
    if not external.allowed:
        raise ModelError([refused(function)])
    columns = [ca.vec(ca.densify(arg).T) for arg in args]
    foreign = _loaded(function, [arg.shape for arg in args], outputs)
    result, = foreign.casadi.call([ca.vertcat(*columns)], False, True)
    values, at = {}, 0
    for name, shape in outputs.items():
        part = result[at:at + elements(shape)]
        at += elements(shape)
        values[name] = ca.reshape(part, shape[1], shape[0]).T if isinstance(shape, tuple) else part
    return values


def called_as_operation(function: ca.Function, args: Sequence[ca.SX]) -> ca.SX:
    """The result of a function of CasADi as one operation of an expression, so that a long formula is written once. Its name
    determines it."""
    return _operations.setdefault(function.name(), function).call(list(args), False, True)[0]


def calls_operations(code: str) -> bool:
    """True if C code calls a function of `called_as_operation`."""
    return any(name in code for name in _operations)


def _loaded(function: Function, shapes: Sequence[tuple[int, int]], outputs: dict[str, Shape]) -> ForeignFunction:
    external = function.external
    assert external is not None
    try:
        program = digest(external.path)
    except OSError as error:
        raise ModelError([Problem("native-missing", f"{external.path.name} of {function.name} cannot be read",
                                  function.place, "`file:` counts from the folder of the function's file.",
                                  (error.strerror or "",))]) from error
    sizes = [h.value or 1.0 for h in function.inputs.values()]
    nominal = [size for size, shape in zip(sizes, shapes, strict=True) for _ in range(shape[0] * shape[1])]
    key = (str(external.path), program, function.name, external.call, external.signature,
           external.derivatives, tuple(shapes), tuple(outputs.items()), tuple(nominal))
    if key not in _made:
        number = sum(map(elements, outputs.values()))
        name = f"hb_{function.name}_{hashlib.sha256(repr(key).encode()).hexdigest()[:12]}"
        make = _of_python if external.path.suffix == ".py" else _of_c
        foreign = make(function, name, shapes, outputs, number, nominal)
        if external.derivatives:
            _check_derivatives(foreign, np.array(nominal))
        foreign.forget()
        _made[key] = foreign
    return _made[key]


def _check_derivatives(foreign: ForeignFunction, nominal: Array) -> None:
    """ModelError if the derivatives that a program gives differ from differences of its values at each of three points."""
    function = foreign.function
    assert function.external is not None
    jacobian, difference = foreign.casadi.jacobian(), ""
    for factor in (1.0, 0.73, 1.31):
        x = factor * nominal
        steps = STEPS[0] * nominal
        computed = np.array(jacobian(x, 0))
        with np.errstate(invalid="ignore"):
            expected = np.column_stack([np.array(foreign.casadi(x + step) - foreign.casadi(x - step)).ravel() / (2 * h)
                                        for h, step in zip(steps, np.diag(steps), strict=True)])
        sizes = np.abs(expected * nominal).max(axis=1, initial=0.0)  # of each result
        errors = np.abs((computed - expected) * nominal)
        if not np.isfinite(expected).all() or not np.isfinite(sizes).all():
            continue
        if (errors <= DERIVATIVES * np.maximum(sizes, 1e-300)[:, None]).all():
            return
        i, j = np.unravel_index(int(np.argmax(np.where(np.isfinite(errors), errors, np.inf))), errors.shape)
        at = ", ".join(f"{v:.6g}" for v in x)
        difference = difference or f"derivative of result {i + 1} by argument {j + 1} at x = {at}: {computed[i, j]:.6g}; " \
            f"by differences of `{function.external.call}`: {expected[i, j]:.6g}"
    if difference:
        raise ModelError([Problem("native-derivatives", f"`{function.external.derivatives}` of "
                                  f"{function.external.path.name} does not give the derivatives of {function.name}",
                                  function.place, "Give the matrix row by row, in SI: a row for each number of the results, "
                                  "a column for each number of the arguments. Or leave out `derivatives:`.",
                                  (difference, *foreign.errors[:1]))])


# -- C -----------------------------------------------------------------------------------------------------------------
def _of_c(function: Function, name: str, shapes: Sequence[tuple[int, int]], outputs: dict[str, Shape], count: int,
          nominal: Sequence[float]) -> ForeignFunction:
    external = function.external
    assert external is not None
    wrapper = _wrapper(function, name, shapes, outputs, count, nominal)
    library = external.path.suffix in LIBRARIES
    head = _pointers(function, name, outputs) if library else f'#include "{external.path}"\n'
    check = "" if library else _type_check(function, outputs)
    path = _compiled(function, head + check + wrapper.replace("INT", "long long int"), name)
    # names in the global scope: compiled equations of a model call the function directly
    loaded = ctypes.CDLL(path, mode=ctypes.RTLD_GLOBAL | getattr(os, "RTLD_DEEPBIND", 0))
    if library:
        _connect(function, name, loaded)
    record = (ctypes.c_double * (len(nominal) + 1)).in_dll(loaded, f"{name}_lost")
    text = "" if library else wrapper.replace("INT", "int")
    return ForeignFunction(function, ca.external(name, path), text, _sizes(shapes), record)


def exported_text(code: str) -> str:
    """The C of the external functions that C code calls, to be added at its end: the sources with the files that they
    include, each once, and the wrappers. ModelError for a program without a C source."""
    called_ones = [foreign for foreign in _made.values() if foreign.casadi.name() in code]
    sources, included = list[str](), set[Path]()
    for foreign in called_ones:
        external = foreign.function.external
        assert external is not None
        if not foreign.text:
            raise ModelError([not_exported(foreign.function)])
        if external.path.resolve() not in included:
            sources.append(f"/* {external.path.name} */\n{source_text(external.path, included)}")
    return "\n".join([*sources, *(foreign.text for foreign in called_ones)])


def functions_called(function: ca.Function) -> list[Function]:
    """The external functions that a function of CasADi calls, itself or by their derivatives."""
    names = [one.name() for one in function.find_functions()]
    functions = {foreign.casadi.name(): foreign.function for foreign in _made.values()}
    return list({called.name: called for key, called in functions.items() if any(key in name for name in names)}.values())


def not_exported(function: Function) -> Problem:
    """The problem of a function that cannot be part of C code."""
    external = function.external
    assert external is not None
    kind = "a Python function" if external.path.suffix == ".py" else "a function of a compiled library"
    return Problem("native-not-exported", f"{function.name} is {kind}; it cannot be part of C code or of an FMU",
                   function.place, f"Write {external.path.name} in C, and give the source: `file: {external.path.stem}.c`.")


def _sizes(shapes: Sequence[tuple[int, int]]) -> tuple[int, ...]:
    return tuple(rows * columns for rows, columns in shapes)


def source_text(path: Path, included: set[Path] | None = None) -> str:
    """A C source with the files that it includes by `#include "..."` from its folder, each once."""
    included = set() if included is None else included
    included.add(path.resolve())

    def inserted(match: re.Match[str]) -> str:
        inner = (path.parent / match.group(1)).resolve()
        if not inner.is_file():
            return match.group(0)
        return "" if inner in included else source_text(inner, included)

    return re.sub(r'^[ \t]*#[ \t]*include[ \t]+"([^"\n]+)"[^\n]*$', inserted, path.read_text("utf-8", "replace"),
                  flags=re.MULTILINE)


def digest(path: Path) -> str:
    """The digest of a program, of a C source with the files that it includes; OSError if it cannot be read."""
    content = source_text(path).encode() if path.suffix == ".c" else path.read_bytes()
    return hashlib.sha256(content).hexdigest()


def _compiled(function: Function, text: str, name: str) -> str:
    """The path of the library that the C compiler makes of a text; ModelError with the messages of the compiler."""
    external = function.external
    assert external is not None
    compiler = next((c for c in COMPILERS if shutil.which(c)), None)
    if compiler is None:
        raise ModelError([Problem("native-no-compiler", f"{function.name} needs a C compiler; this computer has none",
                                  function.place, f"Install one of {', '.join(COMPILERS)}.")])
    if not _folder:
        _folder.append(tempfile.mkdtemp(prefix="heavebond_"))
        atexit.register(shutil.rmtree, _folder[0], ignore_errors=True)
    source, target = Path(_folder[0]) / f"{name}.c", Path(_folder[0]) / f"{name}.so"
    source.write_text(text, "utf-8")
    command = [compiler, *FLAGS, *OWN_NAMES, "-I", str(external.path.parent), "-shared", "-fPIC", "-o", str(target),
               str(source), "-lm"]
    try:
        answer = subprocess.run(command, capture_output=True, timeout=LONGEST, check=False, text=True, errors="replace")
        messages = answer.stderr
        failed = answer.returncode != 0
    except (OSError, subprocess.SubprocessError) as error:
        messages, failed = str(error), True
    if failed:
        lines = [line.replace(str(external.path.parent) + "/", "").replace(str(source), f"call of {function.name}")
                 for line in messages.splitlines() if line.strip()]
        raise ModelError([Problem("native-not-compiled", f"{external.path.name} of {function.name} does not compile",
                                  function.place, _expected(function), tuple(lines[:LINES]))])
    return str(target)


def _expected(function: Function) -> str:
    """The declaration in C that a call expects."""
    external = function.external
    assert external is not None
    if external.signature == "20-sim":
        form = f"int {external.call}(double *inarr, int inputs, double *outarr, int outputs, int major)"
        return f"`{external.call}` must be `{form}`."
    inputs = [f"const double *{n}, int {n}_n" if q.sizes else f"double {n}" for n, q in function.inputs.items()]
    slopes = "" if not external.derivatives else \
        f" `{external.derivatives}` must be `void {external.derivatives}({', '.join([*inputs, 'double *d'])})`."
    if len(function.outputs) == 1 and not next(iter(function.outputs.values())).sizes:
        return f"`{external.call}` must be `double {external.call}({', '.join(inputs)})`.{slopes}"
    results = [f"double *{n}" for n in function.outputs]
    return f"`{external.call}` must be `void {external.call}({', '.join([*inputs, *results])})`.{slopes}"


def _type_check(function: Function, outputs: dict[str, Shape]) -> str:
    """Text with which a compiler refuses a C function of other types. C would convert its arguments and its result: a
    function that is declared `int` would cut off the decimals."""
    external = function.external
    assert external is not None
    text = '#pragma GCC diagnostic error "-Wfloat-conversion"\n'
    if external.signature == "values" and len(outputs) == 1 and next(iter(outputs.values())) is None:
        zeros = ", ".join("(const double *)0, 0" if q.sizes else "0.0" for q in function.inputs.values())
        text += f'_Static_assert(_Generic({external.call}({zeros}), double: 1, default: 0), "the result is not double");\n'
    return text


def _pointers(function: Function, name: str, outputs: dict[str, Shape]) -> str:
    """The pointers to the functions of a library, under the names of the functions. A library is not linked, since the
    system takes a library that was built again for the one that it has loaded under this path."""
    external = function.external
    assert external is not None
    if external.signature == "20-sim":
        kinds = ["int (*{})(double *inarr, int inputs, double *outarr, int outputs, int major);"] * 2
    else:
        inputs = ["const double *, int" if q.sizes else "double" for q in function.inputs.values()]
        plain = len(outputs) == 1 and next(iter(outputs.values())) is None
        value = f"double (*{{}})({', '.join(inputs)});" if plain else \
            f"void (*{{}})({', '.join([*inputs, *['double *'] * len(outputs)])});"
        kinds = [value, f"void (*{{}})({', '.join([*inputs, 'double *'])});"]
    return "".join(f"{kind.format(f'{name}_{k}')}\n#define {called_name} {name}_{k}\n"
                   for k, (kind, called_name) in enumerate(zip(kinds, external.entries, strict=False)))


def _connect(function: Function, name: str, loaded: ctypes.CDLL) -> None:
    """Give the functions of a library to its wrapper. The library is loaded from a copy with a unique name, or, if it
    needs files beside it, from its place. ModelError if it cannot be loaded or lacks a function."""
    external = function.external
    assert external is not None
    try:
        copy = shutil.copyfile(external.path, Path(_folder[0]) / f"{name}_library{external.path.suffix}")
        try:
            library = ctypes.CDLL(str(copy))
        except OSError:
            library = ctypes.CDLL(str(external.path))
        for k, called_name in enumerate(external.entries):
            entry = ctypes.cast(getattr(library, called_name), ctypes.c_void_p)
            ctypes.c_void_p.in_dll(loaded, f"{name}_{k}").value = entry.value
    except (OSError, AttributeError) as error:
        raise ModelError([Problem("native-not-loaded", f"{external.path.name} of {function.name} cannot be loaded",
                                  function.place, _expected(function), (str(error),))]) from error


def _wrapper(function: Function, name: str, shapes: Sequence[tuple[int, int]], outputs: dict[str, Shape], m: int,
             nominal: Sequence[float]) -> str:
    """The functions that CasADi calls, with the type of its integers as INT."""
    external, n = function.external, len(nominal)
    assert external is not None
    given, at = [], 0
    for quantity, shape in zip(function.inputs.values(), shapes, strict=True):
        size = shape[0] * shape[1]
        given.append(f"x + {at}, {size}" if quantity.sizes else f"x[{at}]")
        at += size
    if external.signature == "20-sim":
        def call(name: str, target: str, size: int) -> str:
            return (f"double a[{n}]; int k; for (k = 0; k < {n}; ++k) a[k] = x[k];\n"
                    f"  if ({name}(a, {n}, {target}, {size}, 1) != 0) for (k = 0; k < {size}; ++k) {target}[k] = NAN;")

        value = call(external.call, "y", m)
        begun = re.search(r"\bint\s+Initialize\s*\(\s*(void)?\s*\)", source_text(external.path)) \
            if external.path.suffix == ".c" else None
        if begun:
            value = "static int begun; if (!begun) { begun = 1; Initialize(); }\n  " + value
        slope = call(external.derivatives, "r", m * n) if external.derivatives else ""
    else:
        places = np.cumsum([0, *map(elements, outputs.values())]).tolist()
        if len(outputs) == 1 and next(iter(outputs.values())) is None:
            value = f"y[0] = {external.call}({', '.join(given)});"
        else:
            value = f"{external.call}({', '.join([*given, *(f'y + {k}' for k in places[:-1])])});"
        slope = f"{external.derivatives}({', '.join([*given, 'r'])});" if external.derivatives else ""
    sizes = [m, m * n, m * n * n]
    if m * n**3 > LARGEST_DERIVATIVE:
        sizes.pop()
    if external.derivatives:  # row by row into CasADi's columns
        jacobian = f"double r[{m * n}]; int i, j;\n  {slope}\n" \
            f"  for (i = 0; i < {m}; ++i) for (j = 0; j < {n}; ++j) d[i + j*{m}] = r[i*{n} + j];"
    else:
        jacobian = f"{name}_differences({name}_value, {m}, {STEPS[0]!r}, x, d, place);"
    derived = [f"{name}_jacobian", *(f"{name}_derivative_{k + 2}" for k in range(len(sizes) - 1))]
    steps = STEPS[0 if external.derivatives else 1:]
    inner = "".join(f"""static void {derived[k + 1]}(const double *x, double *d) {{
  double place[{2 * size}];
  {name}_differences({derived[k]}, {size}, {steps[k]!r}, x, d, place);
}}
""" for k, size in enumerate(sizes[1:]))
    entries = "".join(f"""int {'jac_' * (k + 1)}{name}(const double **arg, double **res, INT *iw, double *w, int mem) {{
  double x[{n}]; (void) iw; (void) w; (void) mem;
  {name}_arguments(arg, x);
  if (res[0]) {one}(x, res[0]);
  return 0;
}}
""" for k, one in enumerate(derived))
    return f"""
#include <math.h>
static const double {name}_nominal[] = {{{', '.join(map(repr, map(float, nominal)))}}};
double {name}_lost[{n + 1}];
static void {name}_value(const double *x, double *y) {{
  int i_, lost_ = 0;
  {{ {value} }}
  for (i_ = 0; i_ < {m}; ++i_) if (!(y[i_] - y[i_] == 0)) lost_ = 1;
  if (lost_ && {name}_lost[{n}]++ == 0) for (i_ = 0; i_ < {n}; ++i_) {name}_lost[i_] = x[i_];
}}
static void {name}_differences(void (*f)(const double *, double *), int m, double step, const double *x, double *d,
                               double *place) {{
  double a[{n}], *high = place, *low = place + m, h;
  int i, j;
  for (j = 0; j < {n}; ++j) a[j] = x[j];
  for (j = 0; j < {n}; ++j) {{
    h = step * fmax(fabs(x[j]), {name}_nominal[j]);
    a[j] = x[j] + h; f(a, high);
    a[j] = x[j] - h; f(a, low);
    a[j] = x[j];
    for (i = 0; i < m; ++i) d[i + j*m] = (high[i] - low[i]) / (2*h);
  }}
}}
static void {name}_jacobian(const double *x, double *d) {{
  double place[{2 * m}]; (void) place;
  {jacobian}
}}
{inner}static void {name}_arguments(const double **arg, double *x) {{
  int k;
  for (k = 0; k < {n}; ++k) x[k] = arg[0] ? arg[0][k] : 0;
}}
int {name}(const double **arg, double **res, INT *iw, double *w, int mem) {{
  double x[{n}]; (void) iw; (void) w; (void) mem; (void) {name}_differences;
  {name}_arguments(arg, x);
  if (res[0]) {name}_value(x, res[0]);
  return 0;
}}
{entries}""" + _sparsities(name, n, sizes)


def _sparsities(name: str, n: int, sizes: Sequence[int]) -> str:
    """The shapes of inputs and outputs of the function of sizes[0] results and of its derivatives, as CasADi reads them."""
    def dense(rows: int, columns: int) -> list[int]:
        return [rows, columns, 1]

    def empty(rows: int, columns: int) -> list[int]:
        return [rows, columns, *[0] * (columns + 1)]

    # a derivative has the outputs as further inputs, on which it does not depend
    parts, entered, left = [(name, [dense(n, 1)], [dense(sizes[0], 1)])], [(n, 1)], [(sizes[0], 1)]
    for k, size in enumerate(sizes):
        further = entered[1:] + left
        blocks = [(rows * columns, a * b) for rows, columns in left for a, b in entered]
        entered, left = [(n, 1), *further], blocks
        parts.append(("jac_" * (k + 1) + name, [dense(n, 1), *(empty(*shape) for shape in further)],
                      [dense(size, n), *(empty(*shape) for shape in blocks[1:])]))
    lines = []
    for called_name, entering, leaving in parts:
        lines += [f"INT {called_name}_n_in(void) {{ return {len(entering)}; }}",
                  f"INT {called_name}_n_out(void) {{ return {len(leaving)}; }}"]
        for side, patterns in (("in", entering), ("out", leaving)):
            lines.append(f"const INT *{called_name}_sparsity_{side}(INT i) {{")
            lines += [f"  static const INT s{k}[] = {{{', '.join(map(str, p))}}};" for k, p in enumerate(patterns)]
            lines += [f"  if (i == {k}) return s{k};" for k in range(len(patterns))]
            lines += ["  return 0;", "}"]
    return "\n".join(lines) + "\n"


# -- Python ------------------------------------------------------------------------------------------------------------
def _of_python(function: Function, name: str, shapes: Sequence[tuple[int, int]], outputs: dict[str, Shape], m: int,
               nominal: Sequence[float]) -> ForeignFunction:
    external = function.external
    assert external is not None
    specification = importlib.util.spec_from_file_location(name, external.path)
    assert specification is not None and specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    try:
        specification.loader.exec_module(module)
        value = getattr(module, external.call)
        slope = getattr(module, external.derivatives) if external.derivatives else None
    except (Exception, SystemExit) as error:  # of the user's file: whatever it raises
        raise ModelError([Problem("native-not-loaded", f"{external.path.name} of {function.name} cannot be loaded",
                                  function.place, f"It must define a function `{external.call}`.",
                                  (f"{type(error).__name__}: {error}",))]) from error
    record, errors = [0.0] * (len(nominal) + 1), list[str]()
    recent = 0.0  # results that are not numbers, less a fiftieth of the others

    def arguments(x: Array) -> list[Any]:
        elements, at = list[Any](), 0
        for quantity, shape in zip(function.inputs.values(), shapes, strict=True):
            size = shape[0] * shape[1]
            part = x[at:at + size]
            elements.append(float(part[0]) if not quantity.sizes else part.reshape(shape) if len(quantity.sizes) > 1
                            else part)
            at += size
        return elements

    def results(x: Array) -> Array:
        output = value(*arguments(x))
        parts = output if len(outputs) > 1 else [output]
        if None in [part if part is None else 0 for part in parts]:
            raise TypeError("it returns None; is `return` missing?")
        y = np.concatenate([np.ravel(np.asarray(part, float)) for part in parts])
        if len(y) != m:
            raise TypeError(f"it returns {count(len(y), 'number')} in place of {m}")
        return y

    def note(error: BaseException) -> None:
        if not errors:  # a run may call the function thousands of times
            errors.append(_why(error, external.path))

    def slopes(x: Array) -> Array:
        assert slope is not None
        try:
            return np.asarray(np.asarray(slope(*arguments(x)), float).reshape(m, len(x)))
        except (Exception, SystemExit) as error:
            note(error)
            return np.full((m, len(x)), np.nan)

    def values(x: Array) -> Array:
        nonlocal recent
        try:
            y = results(x)
        except (Exception, SystemExit) as error:  # CasADi cannot pass it on: the record names it
            note(error)
            y = np.full(m, np.nan)
        if not all(map(isfinite, y)):
            if not record[-1]:
                record[:-1] = x.tolist()
            record[-1] += 1
            recent += 1
            if recent > MOST_LOST:
                recent = 0.0
                raise RuntimeError(f"{function.name} gives no numbers")
        else:
            recent = max(recent - 0.02, 0.0)
        return y

    size = np.array(nominal)

    def differences(of: Callable[[Array], Array], step: float) -> Callable[[Array], Array]:
        def jacobian(x: Array) -> Array:
            steps = step * np.maximum(np.abs(x), size)
            return np.stack([(of(x + h * e) - of(x - h * e)).ravel(order="F") / (2 * h)
                             for h, e in zip(steps, np.eye(len(x)), strict=True)], axis=1)
        return jacobian

    steps = list(STEPS)
    jacobian = differences(values, steps.pop(0)) if slope is None else slopes
    second = differences(jacobian, steps.pop(0))
    n = len(nominal)
    orders = [values, jacobian, second, differences(second, steps.pop(0))]
    whole = _PythonFunction(name, orders, [ca.Sparsity.dense(n, 1)], [ca.Sparsity.dense(m, 1)])
    try:
        results(size)
    except (ArithmeticError, ValueError):  # of these arguments; others may have a result
        pass
    except (Exception, SystemExit) as error:
        inputs, plain = ", ".join(function.inputs), "a number" if m == 1 else f"{m} numbers"
        raise ModelError([Problem("native-failed", f"`{external.call}` of {external.path.name} fails", function.place,
                                  f"It must be `def {external.call}({inputs})` and return {plain}.",
                                  (_why(error, external.path),))]) from error
    return ForeignFunction(function, whole, "", _sizes(shapes), record, errors)


def _why(error: BaseException, path: Path) -> str:
    """An error of a Python function with its line: `ValueError: too high, pump.py:3`."""
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if Path(frame.filename) == path]
    text = f"{type(error).__name__}: {error}".rstrip(": ")
    return f"{text}, {path.name}:{lines[-1]}" if lines else text


class _PythonFunction(ca.Callback):
    """One order of derivatives of a function of x (n,): its values, its Jacobian, the Jacobian of that."""

    def __init__(self, name: str, orders: Sequence[Callable[[Array], Array]], inputs: Sequence[ca.Sparsity],
                 outputs: Sequence[ca.Sparsity]):
        ca.Callback.__init__(self)
        self.orders, self.inputs, self.outputs, self.kept = orders, inputs, outputs, list[ca.Function]()
        self.construct(name, {})

    def get_n_in(self) -> int:
        return len(self.inputs)

    def get_n_out(self) -> int:
        return len(self.outputs)

    def get_sparsity_in(self, k: int) -> ca.Sparsity:
        return self.inputs[k]

    def get_sparsity_out(self, k: int) -> ca.Sparsity:
        return self.outputs[k]

    def eval(self, values: Sequence[ca.DM]) -> list[ca.DM]:
        column = ca.DM(self.orders[0](np.array(values[0]).ravel()))
        return [column, *(ca.DM(pattern.size1(), pattern.size2()) for pattern in self.outputs[1:])]

    def has_jacobian(self) -> bool:
        return len(self.orders) > 1

    def get_jacobian(self, name: str, inames: Sequence[str], onames: Sequence[str], opts: Any) -> ca.Function:
        n, rows = self.inputs[0].numel(), self.outputs[0].numel()
        inputs = [*self.inputs, *(ca.Sparsity(p.size1(), p.size2()) for p in self.outputs)]
        outputs = [ca.Sparsity(y.numel(), x.numel()) for y in self.outputs for x in self.inputs]
        outputs[0] = ca.Sparsity.dense(rows, n)
        jacobian = _PythonFunction(name, self.orders[1:], inputs, outputs)
        self.kept.append(jacobian)
        return jacobian


def _elements(matrix: ca.SX) -> list[ca.SX]:
    """The elements of a matrix that are not zero by structure."""
    return cast(list[ca.SX], matrix.nonzeros())  # CasADi's stubs call them SXElem; they are scalar SX


def _column(elements: Iterable[ca.SX]) -> ca.SX:
    items = list(elements)
    return ca.vertcat(*items) if items else ca.SX(0, 1)


# -- calls in expressions ----------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Opened:
    """Columns in which each result of a call is a symbol, and `args`, one column with the arguments of all calls in turn,
    in these symbols. Use it to rebuild expressions operation by operation: `closed` makes the calls again, with arguments
    that were rebuilt in the same way."""

    columns: list[ca.SX]
    args: ca.SX
    calls: list[tuple[ca.Function, dict[int, ca.SX]]]  # the function and the symbol of each of its results, by number

    def closed(self, columns: Sequence[ca.SX], args: ca.SX) -> list[ca.SX]:
        """The columns with the calls, whose arguments are `args`."""
        if not self.calls:
            return list(columns)
        symbols, values, at = list[ca.SX](), list[ca.SX](), 0
        for function, results in self.calls:
            inputs = []
            for k in range(function.n_in()):
                pattern = function.sparsity_in(k)
                part = args[at:at + pattern.nnz()]
                inputs.append(ca.SX(pattern, ca.substitute(part, ca.vertcat(*symbols), ca.vertcat(*values)) if symbols
                                    else part))
                at += pattern.nnz()
            results_of = function.call(inputs, False, True)
            outputs = _column(e for y in results_of for e in _elements(y))
            symbols += results.values()
            values += [outputs[k] for k in results]
        return ca.substitute(list(columns), [ca.vertcat(*symbols)], [ca.vertcat(*values)])


def opened(columns: Sequence[ca.SX]) -> Opened:
    """Replace the calls in columns by symbols of their results."""
    if not _made and not _operations:
        return Opened(list(columns), ca.SX(0, 1), [])
    new: dict[int, ca.SX] = {}
    kept = list[ca.SX]()  # their hashes are valid as long as they exist
    calls: dict[int, tuple[ca.Function, dict[int, ca.SX], list[ca.SX]]] = {}
    for column in columns:
        waiting = _elements(column)
        while waiting:
            node = waiting[-1]
            if node.element_hash() in new:
                waiting.pop()
                continue
            if node.is_constant() or node.is_symbolic():
                new[node.element_hash()] = node
                kept.append(node)
                continue
            call = node.dep(0) if node.is_output() else None
            source = node if call is None else call
            parts = [source.dep(k) for k in range(source.n_dep())]
            missing = [part for part in parts if part.element_hash() not in new]
            if missing:
                waiting += missing
                continue
            kept.append(node)
            inner = [new[part.element_hash()] for part in parts]
            if call is not None:
                kept.append(call)
                function, results, _ = calls.setdefault(call.element_hash(), (call.which_function(), {}, inner))
                number = node.which_output()
                if number not in results:
                    results[number] = ca.SX.sym(f"{function.name()}_{len(calls)}_{number}")
                new[node.element_hash()] = results[number]
            elif all(a.element_hash() == b.element_hash() for a, b in zip(parts, inner, strict=True)):
                new[node.element_hash()] = node
            else:
                new[node.element_hash()] = ca.SX.binary(node.op(), *inner) if len(inner) == 2 else \
                    ca.SX.unary(node.op(), inner[0])
    if not calls:
        return Opened(list(columns), ca.SX(0, 1), [])
    replaced = [ca.SX(column.sparsity(), _column(new[e.element_hash()] for e in _elements(column)))
                if column.nnz() else column for column in columns]
    return Opened(replaced, _column(e for _, _, args in calls.values() for e in args),
                  [(function, results) for function, results, _ in calls.values()])


def substituted_in_turn(symbols: ca.SX, definitions: ca.SX, columns: Sequence[ca.SX]) -> tuple[ca.SX, list[ca.SX]]:
    """The definitions of symbols, each in the symbols before it, and columns, with all symbols substituted; as CasADi's
    `substitute_inplace`, which loses calls."""
    whole = opened([definitions, *columns])
    if not whole.calls:
        (expressions,), replaced = ca.substitute_inplace([symbols], [definitions], list(columns), False)
        return expressions, replaced
    definitions, *others = whole.columns
    (expressions,), replaced = ca.substitute_inplace([symbols], [definitions], [*others, whole.args], False)
    first, *rest = whole.closed([expressions, *replaced[:-1]], replaced[-1])
    return first, rest


def derivative_along(column: ca.SX, symbols: ca.SX, direction: ca.SX) -> ca.SX:
    """The derivative of a column (m,) by symbols (n,) times a direction (n,)."""
    return ca.mtimes(jacobian(column, symbols), direction) if opened([column]).calls else \
        ca.jtimes(column, symbols, direction)


def jacobian(column: ca.SX, symbols: ca.SX) -> ca.SX:
    """The derivatives of a column (m,) by symbols (n,), with a zero wherever an element does not depend on a symbol; CasADi
    joins the derivatives of several symbols in one call, whose zeros are not known."""
    whole = opened([column])
    if not whole.calls:
        return ca.jacobian(column, symbols)
    results, slopes, at = ca.SX(0, 1), ca.SX(0, symbols.numel()), 0
    for function, numbered in whole.calls:
        arguments, places = [], list[int]()
        for k in range(function.n_in()):
            pattern = function.sparsity_in(k)
            offset = sum(function.numel_in(i) for i in range(k))
            places += [offset + i for i in pattern.find()]
            arguments.append(ca.SX(pattern, whole.args[at:at + pattern.nnz()]))
            at += pattern.nnz()
        args = _column(e for g in arguments for e in _elements(g))
        along = ca.jacobian(args, symbols) + ca.mtimes(ca.jacobian(args, results), slopes)
        slope = function.jacobian()
        outputs = function.call(arguments, False, True)
        by_argument = slope.call([*arguments, *(y if slope.nnz_in(function.n_in() + k) else ca.SX(y.size1(), y.size2())
                                                for k, y in enumerate(outputs))], False, True)
        n_in = function.n_in()
        rows = ca.vertcat(*(ca.horzcat(*by_argument[o * n_in:(o + 1) * n_in]) for o in range(function.n_out())))
        numbers = [sum(function.numel_out(i) for i in range(o)) + i for o in range(function.n_out())
                   for i in function.sparsity_out(o).find()]
        results = ca.vertcat(results, *numbered.values())
        slopes = ca.vertcat(slopes, ca.mtimes(rows[[numbers[k] for k in numbered], places], along))
    total = ca.jacobian(whole.columns[0], symbols) + ca.mtimes(ca.jacobian(whole.columns[0], results), slopes)
    return whole.closed([ca.sparsify(total)], whole.args)[0]
