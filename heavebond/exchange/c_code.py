"""Export of the equations of a diagram as one self-contained C file (C99 and its mathematical library)."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np

from heavebond.core.presentation import readable
from heavebond.core.quoting import c_comment, c_string
from heavebond.core.version import VERSION
from heavebond.core.writable import write_text
from heavebond.exchange.portable import Portable, portable
from heavebond.language.external_functions import calls_operations, exported_text
from heavebond.language.model import Model
from heavebond.language.symbols import split, stack
from heavebond.numerics.dae import DELAY_ROWS
from heavebond.numerics.output_times import grid, largest_step_of
from heavebond.numerics.validity import physical_grace

SPARE = 40  # characters of a message in addition to its text: the time
LONGEST_NAME = 60  # length of the prefix of all names; C99 distinguishes at least 63 characters
METHODS = ("euler", "rk4", "backward-euler", "rosenbrock")  # of real-time programs
# Iterations of Newton's method for the algebraic unknowns, and halvings of each, at most.
NEWTON, NEWTON_IN_REAL_TIME = (50, 30), (10, 8)
SOURCES = Path(__file__).parents[1] / "c"
KEYWORDS = frozenset(re.findall(
    r"\w+", "auto break case char const continue default do double else enum extern float for goto if inline int long main "
    "register restrict return short signed sizeof static struct switch typedef union unsigned void volatile while"))


def export_c(model: Model, path: str | Path, inputs: Iterable[str] = ()) -> Portable:
    """Write the equations of a diagram as C; every external name in it begins with the name of the file."""
    path = Path(path)
    prefix = c_name(path.stem)
    exported = portable(model, inputs, f"{prefix}_")
    write_text(path, c_text(exported, prefix))
    return exported


def c_name(text: str) -> str:
    """A valid name of C."""
    plain = re.sub(r"\W", "_", text, flags=re.ASCII)[:LONGEST_NAME]
    return f"m_{plain}" if not plain[:1].isalpha() or plain in KEYWORDS else plain


@dataclass(frozen=True)
class FixedStepProgram:
    """A program with a fixed step (s): its method, one of `METHODS`, and the number of nodes in the ring buffer of
    delays."""

    method: str
    step: float
    ring: int


def c_text(exported: Portable, prefix: str, *, whole: bool = False, fixed: FixedStepProgram | None = None) -> str:
    """The text of the file; `whole` is for an FMU, with directional derivatives and events but without their integrator,
    `fixed` for a real-time program. Its functions must have been built with `prefix`_."""
    generator = ca.CodeGenerator(prefix, {"with_header": False, "casadi_int": "int"})
    steps, stops, parts = bool(fixed) or (not whole and exported.integrated), 0, [_source("evaluate.c")]
    functions = [exported.equations]
    if whole or steps:
        functions += [exported.directions, exported.jacobian, exported.happenings, exported.updates, exported.instants,
                      exported.histories, exported.starting.conditions, exported.allowed]
    elif exported.stops is not None and exported.stops.size1_out(0):
        stops = exported.stops.size1_out(0)
        functions.append(exported.stops)
        parts.append(NEXT_STOP.replace("NUMBER", str(stops)))
    if whole or steps or exported.limited:
        functions.append(exported.limits)
        parts.append(_source("limits.c"))
    if steps:
        names = ("run.c", "c_run.c") if fixed is None else ("real_time.c",)
        parts += [_source(name).replace("model_", f"{prefix}_") for name in names]
    try:
        for function in functions:
            generator.add(function)
        code = generator.dump()
    except RuntimeError as error:  # CasADi writes no code for a Python function
        exported_text(str(error))
        raise
    programs = exported_text(code)
    if programs or calls_operations(code):
        code += _with_places(functions)
        for function in functions:
            code = re.sub(rf"^CASADI_SYMBOL_EXPORT int {function.name()}\(", f"static int {function.name()}_called(", code,
                          count=1, flags=re.MULTILINE)

    # add statements to generated functions that prevent warnings of unused arguments
    def add(match: re.Match[str]) -> str:
        names = [argument.split()[-1].strip("*") for argument in match[2].split(",")]
        return match[1] + "".join(f" (void) {name};" for name in names if name in UNUSED)

    used = re.sub(r"^((?:static|CASADI_SYMBOL_EXPORT) [^\n;{}()]*\(([^\n()]+)\) ?\{)$", add, code,
                  flags=re.MULTILINE)
    # sizes, and values at the start; C does not permit arrays of length 0
    sizes = {"x": exported.states, "z": exported.algebraic, "p": exported.parameters, "u": exported.inputs,
             "y": exported.outputs}
    lines = ["enum { " + ", ".join(f"{prefix}_n_{letter} = {len(found)}" for letter, found in sizes.items()) + " };"]
    values = {f"{letter}_start": [q.start for q in sizes[letter]] for letter in "xzpu"}
    values["u_start"] = exported.at_start[4].tolist()
    values["x_nominal"] = [q.nominal for q in exported.states]
    values["x_origin"] = exported.assembly.x_origin.tolist()
    values["z_nominal"] = [q.nominal for q in exported.algebraic]
    arrays = [*lines,
              *(f"const double {prefix}_{name}[] = {{{', '.join(map(repr, numbers or [0.0]))}}};"
                for name, numbers in values.items())]
    turns, halvings = NEWTON if fixed is None else NEWTON_IN_REAL_TIME
    arrays.append(f"enum {{ {prefix}_turns = {turns}, {prefix}_halvings = {halvings} }}; /* of Newton's method */")
    head = [_head(exported, prefix, stops, steps)]
    if fixed:
        head = [f"/* {c_comment(exported.name)}: a real-time program, written by heavebond {VERSION}; see {prefix}.h */",
                f'#include "{prefix}.h"', "#include <math.h>"]
        del arrays[0]  # the sizes are in the header
        arrays += _real_time_arrays(exported, prefix, fixed)
    return "\n".join([*head, "#include <stdio.h>", used, *arrays,
                      *([*_rule_arrays(exported, prefix), *_event_arrays(exported, prefix),
                         *_start_arrays(exported, prefix, whole),
                         *_delay_arrays(exported, prefix, longest=not fixed)] if whole or steps else []),
                      *(_limit_arrays(exported, prefix) if whole or steps or exported.limited else []),
                      *(part.replace("MODEL", prefix) for part in parts), *([programs] if programs else [])])


def _real_time_arrays(exported: Portable, prefix: str, fixed: FixedStepProgram) -> list[str]:
    """The constants of `real_time.c`, and the names of parameters, inputs and outputs."""
    methods = [f"{prefix}_{method.replace('-', '_')}" for method in METHODS]
    return [f"enum {{ {', '.join(methods)}, {prefix}_method = {methods[METHODS.index(fixed.method)]}, "
            f"{prefix}_ring = {fixed.ring} }};",
            f"const double {prefix}_dt = {fixed.step!r}; /* s */",
            f"static const double {prefix}_t0 = {float(exported.assembly.begin)!r}; /* s */",
            *(f"const char *const {prefix}_{title}_{kind}[] = {{{', '.join(texts or ['0'])}}};"
              for title, quantities in (("parameter", exported.parameters), ("input", exported.inputs),
                                        ("output", exported.outputs))
              for kind, texts in (("names", [c_string(q.name if title != "parameter" or exported.tunable[k] else "")
                                             for k, q in enumerate(quantities)]),
                                  ("units", [c_string(q.unit.text) for q in quantities])))]


def _with_places(functions: Iterable[ca.Function]) -> str:
    """For each function NAME a function of this name that calls NAME_called with the memory that calls of other functions
    need."""
    texts = []
    for function in functions:
        n_in, n_out, name = function.n_in(), function.n_out(), function.name()
        sizes = [max(size, 1) for size in (function.sz_arg(), function.sz_res(), function.sz_iw(), function.sz_w())]
        texts.append(f"""
CASADI_SYMBOL_EXPORT int {name}(const casadi_real** arg, casadi_real** res, casadi_int* iw, casadi_real* w, int mem) {{
  const casadi_real *arg_[{sizes[0]}] = {{0}};
  casadi_real *res_[{sizes[1]}] = {{0}};
  casadi_int iw_[{sizes[2]}];
  casadi_real w_[{sizes[3]}];
  int k;
  (void) iw; (void) w;
  for (k = 0; k < {n_in}; ++k) arg_[k] = arg[k];
  for (k = 0; k < {n_out}; ++k) res_[k] = res[k];
  return {name}_called(arg_, res_, iw_, w_, mem);
}}
""")
    return "".join(texts)


def _source(name: str) -> str:
    """A file of C, with those that it includes."""
    text = (SOURCES / name).read_text(encoding="utf-8")
    return re.sub(r'^#include "(\w+\.c)"$', lambda found: _source(found[1]), text, flags=re.MULTILINE)


NEXT_STOP = """
/* The next instant after t at which an integrator stops and begins anew: a kink or a short motion of a function of time. */
double MODEL_next_stop(double t, const double *p) {
  double stops[NUMBER], next = INFINITY;
  const double *arg[] = {p};
  double *res[] = {stops};
  int k;
  if (MODEL_stops(arg, res, 0, 0, 0)) return INFINITY;
  for (k = 0; k < NUMBER; ++k)
    if (stops[k] > t && stops[k] < next) next = stops[k];
  return next;
}
"""


UNUSED = ("arg", "res", "iw", "w", "mem")  # arguments of every function that CasADi generates


def _head(exported: Portable, prefix: str, stops: int, steps: bool) -> str:
    """The comment at the beginning that lists the contents."""
    parts = [
        f"{exported.name}: equations in C, written by heavebond {VERSION}", "",
        f"int {prefix}_evaluate(double t, const double *x, double *z, const double *p, const double *u,",
        f"{' ' * len(prefix)}              double *dx, double *y)", "",
        "gives the derivatives dx = dx/dt of the states x and the outputs y at the time t; either may be a null pointer.",
        "z holds the algebraic unknowns: a first guess on entry, the solution on return (it is ignored if there",
        "are none). It returns 0, or another number if z was not found. It has no memory between calls.", "",
        *([f"Only {prefix}_advance can call it: after the inputs, u holds {DELAY_ROWS} values of each delayed",
           "variable, which follow from the history of the run, and the time of the begin, from which t counts.", ""]
          if exported.delays else []),
        *([f"double {prefix}_next_stop(double t, const double *p)", "",
           "gives the next instant after t at which a function of time has a kink or a fast transition, or INFINITY.",
           "An integrator must end a step there and restart, because it may skip the transition otherwise.", ""]
          if stops else []),
        *([f"int {prefix}_check(double t, const double *x, const double *z, const double *p, const double *u,",
           f"{' ' * len(prefix)}           char *message, size_t size)", "",
           "tests the physical limits of variables, such as a volume below 0, at the end of an accepted step. It returns 0,",
           "or another number with a message that names the variable and the time: the run has to end there.", ""]
          if exported.limited else []),
        *([f"size_t {prefix}_size(void)",
           f"void {prefix}_begin(void *run, double t, const double *p)",
           f"int {prefix}_advance(void *run, double end, const double *u, double *x, double *y, char *message, size_t size)",
           "",
           "integrate the equations with all events and delays.",
           f"A run needs {prefix}_size() bytes of memory, aligned for double. It begins at the time t with",
           f"the parameters p (a null pointer: {prefix}_p_start). {prefix}_advance integrates to",
           "the time end with constant inputs u; x and y are states and outputs there. Null pointers are permitted for",
           "u, x, y and message.",
           "It returns 0, or another number with a message if the run has to end. A copy of the block is a snapshot.", ""]
          if steps else []),
        f"All is in SI but y. {prefix}_x_start, {prefix}_z_start, {prefix}_p_start and {prefix}_u_start hold the values",
        f"at the start, {prefix}_n_x, {prefix}_n_z, {prefix}_n_p, {prefix}_n_u and {prefix}_n_y the numbers of each."]
    for letter, title, quantities in (
            ("x", "States", exported.states), ("z", "Algebraic unknowns", exported.algebraic),
            ("p", "Parameters", exported.parameters),
            ("u", "Inputs", exported.inputs), ("y", "Outputs", exported.outputs)):
        if quantities:
            rows = [(f"{letter}[{k}]", q.name, q.unit.text, f"{q.start:.9g}", q.doc) for k, q in enumerate(quantities)]
            widths = [max(len(row[column]) for row in rows) for column in range(4)]
            listed = ["  ".join(["", *(text.ljust(width) for text, width in zip(row, (*widths, 0), strict=True))]).rstrip()
                      for row in rows]
            parts += ["", title, *listed]
    return "/* " + "\n   ".join(c_comment(line) for line in parts).replace("\n   \n", "\n\n") + " */"


def _limit_arrays(exported: Portable, prefix: str) -> list[str]:
    """The messages on physical limits, and the tolerance of each limit, in proportion to the variable's size at the
    start.
    """
    at_start, _ = exported.limits(*exported.at_start)
    above = np.array(at_start).ravel().tolist()
    texts = [c_string(f"{u.name} falls below {readable(u.plausible.least, u.unit.text)}") for u in exported.limited]
    advice = [c_string(f"{u.plausible.beyond}.") for u in exported.limited]
    graces = [physical_grace(u, size if size > 0 else u.nominal) for u, size in zip(exported.limited, above, strict=True)]
    longest = max([0, *(len(a) + len(b) for a, b in zip(texts, advice, strict=True)),
                   *(len(c_string(rule.text + rule.rest)) for rule in exported.rules)]) + SPARE
    return [f"enum {{ {prefix}_n_l = {len(texts)}, {prefix}_n_m = {longest} }};",
            *(f"static const char *const {prefix}_l_{name}[] = {{{', '.join(entries or ['0'])}}};"
              for name, entries in (("text", texts), ("advice", advice))),
            f"static const double {prefix}_l_grace[] = {{{', '.join(map(repr, graces or [0.0]))}}};"]


def _rule_arrays(exported: Portable, prefix: str) -> list[str]:
    """The bounds of the values of `allowed`, and the parts of their messages."""
    def number(value: float) -> str:
        return repr(value) if np.isfinite(value) else f"{'-' if value < 0 else ''}INFINITY"

    bounds = {"low": [rule.low for rule in exported.rules], "high": [rule.high for rule in exported.rules]}
    texts = {"name": [rule.text for rule in exported.rules], "rule": [rule.rest for rule in exported.rules]}
    return [f"enum {{ {prefix}_n_g = {len(exported.rules)} }};",
            *(f"static const double {prefix}_g_{name}[] = {{{', '.join(map(number, values or [0.0]))}}};"
              for name, values in bounds.items()),
            *(f"static const char *const {prefix}_g_{name}[] = {{{', '.join(map(c_string, values or ['']))}}};"
              for name, values in texts.items())]


def _event_arrays(exported: Portable, prefix: str) -> list[str]:
    """The event of each condition, single and periodic instants, and the targets of resets."""
    resets = [reset for event in exported.events for reset in event.resets]
    states = {column: k for k, column in enumerate(exported.assembly.reduced.states)}
    conditions = [k for k, event in enumerate(exported.events) if event.indicator is not None]
    breakaways = [(k, event.breakaway) for k, event in enumerate(exported.events) if event.breakaway]
    numbers = {
        "condition": conditions,
        "repeated": [0 if event.period is None else 1 for event in exported.events],
        "timed": [0 if k in conditions else 1 for k in range(len(exported.events))],
        "clock": [int(event.by_clock) for event in exported.events],
        "rows": np.cumsum([0, *(len(event.resets) for event in exported.events)]).tolist(),
        "set_state": [-1 if r.unknown is None else states[(r.unknown, 0)] for r in resets],
        "set_held": [-1 if r.held is None else r.held for r in resets],
        "breaks": [1 if event.breakaway else 0 for event in exported.events],
        "break_event": [k for k, _ in breakaways], "break_limit": [b.limit for _, b in breakaways],
        "break_direction": [int(b.direction) for _, b in breakaways]}
    times = grid(exported.assembly.model, None, None) if exported.assembly.model.until is not None else [0.0, 1.0]
    return [
        "enum { " + ", ".join(f"{prefix}_{name} = {len(values)}" for name, values in (
            ("n_c", conditions), ("n_e", exported.events), ("n_r", resets), ("n_f", exported.sizes), ("n_b", breakaways)))
            + " };",
        *(f"static const int {prefix}_{name}[] = {{{', '.join(map(str, values or [0]))}}};"
          for name, values in numbers.items()),
        f"static const double {prefix}_f_size[] = {{{', '.join(map(repr, exported.sizes or (0.0,)))}}};",
        f"static const double {prefix}_span = {float(times[-1] - times[0]) or 1.0!r}; /* s; of the run of the diagram */"]


def _delay_arrays(exported: Portable, prefix: str, longest: bool) -> list[str]:
    """Numbers, sizes and values before the start of the delayed variables; whether the equations have rates of them, whether
    a source depends on one without a state between, and with `longest` the longest step."""
    delays, u = exported.delays, exported.assembly.arguments[4]
    reduced = exported.assembly.reduced
    used = {s.element_hash() for s in ca.symvar(stack([reduced.ode, reduced.alg, reduced.unknowns()]))}
    direct = bool(delays) and ca.depends_on(exported.assembly.express(stack(d.source for d in delays)),
                                            stack([u, exported.assembly.arguments[2]]))
    arrays: dict[str, tuple[str, Sequence[float]]] = {
        "d_nominal": ("double", [d.nominal for d in delays]), "d_before": ("int", [d.index for d in delays]),
        "d_rated": ("int", [int(any(s.element_hash() in used for s in split(d.symbols)[1:])) for d in delays])}
    return [f"enum {{ {prefix}_n_d = {len(delays)}, {prefix}_n_v = {len(exported.at_start[4])}, "
            f"{prefix}_direct = {int(direct)} }};",
            *(f"static const {kind} {prefix}_{name}[] = {{{', '.join(map(repr, numbers or [0]))}}};"
              for name, (kind, numbers) in arrays.items()),
            *([f"static const double {prefix}_longest = {largest_step_of(exported.assembly.model)!r}; /* s; 0: no limit */"]
              if longest else [])]


def _start_arrays(exported: Portable, prefix: str, whole: bool) -> list[str]:
    """The sizes of the conditions of the start, 0 if no settable value changes it; the values on which it depends, and of
    an FMU, whose states can be set before, the parameters that hold their specified values."""
    starting = exported.starting
    conditions, _, guesses = (starting.conditions.numel_out(k) for k in range(3))
    counts = (conditions, guesses, len(starting.solved_for), int(starting.square)) if starting.follows else (0, 0, 0, 0)
    numbers = {"solved": starting.solved_for, "by_p": [int(b) for b in starting.by_parameters],
               **({"of_x": starting.of_states} if whole else {}),
               "by_u": [int(b) for b in starting.by_inputs]}
    return [
        "enum { " + ", ".join(f"{prefix}_{name} = {count}" for name, count in zip(
            ("n_s", "n_a", "n_q", "start_square"), counts, strict=True)) + " };",
        *(f"static const int {prefix}_start_{name}[] = {{{', '.join(map(str, values or [0]))}}};"
          for name, values in numbers.items()),
        f"static const double {prefix}_start_size[] = {{{', '.join(map(repr, starting.sizes or (1.0,)))}}};"]
