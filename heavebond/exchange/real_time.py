"""Export of a diagram as a C program with a fixed step for real time: the program, its header and a runner.

The program (`heavebond/c/real_time.c`) needs one block of memory of constant size, and the work of each step has a bound.
Explicit methods therefore need equations x' = f(t, x, u). The implicit methods factorise one matrix in each step, which also
gives the algebraic unknowns. The runner (`heavebond/c/runner.c`) is a POSIX program that calls the program in real time.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import ceil
from pathlib import Path

import numpy as np

from heavebond.core.errors import Problem, UsageError, listing, suggest
from heavebond.core.quoting import c_comment
from heavebond.core.version import VERSION
from heavebond.core.writable import write_text
from heavebond.exchange.c_code import METHODS, SOURCES, FixedStepProgram, c_name, c_text
from heavebond.exchange.portable import Portable, Quantity, portable
from heavebond.language.model import Model
from heavebond.numerics.dae import Array
from heavebond.numerics.fixed_step import amplification, longest_step
from heavebond.numerics.output_times import Time, largest_step_of, step_of


@dataclass(frozen=True)
class RealTimeConstants:
    """The constants of real-time programs.

    unknowns: largest number of states and algebraic unknowns for the implicit methods. Origin: two matrices of 1 MB each are
        on the stack. Doubled: 4 MB each, which fill the usual stack of 8 MB.
    spare: nodes of the ring buffer for each step of the longest delay. Origin: a step can contain a discontinuity, which
        adds two nodes. Doubled: twice the memory.
    nodes: largest number of nodes of the ring buffer. Origin: 100 MB of memory with ten delayed variables. Doubled: twice.
    same: difference between a period and a multiple of the step, relative to the step, that counts as rounding. Origin:
        decimal numbers are rounded to 1e-16 of their value. Doubled: nothing measurable.
    """

    unknowns: int = 350
    spare: int = 4
    nodes: int = 1_000_000
    same: float = 1e-6


REAL_TIME = RealTimeConstants()
DEFAULT_METHOD = "rosenbrock"
MARK = "written by heavebond"  # in the first lines of header and runner


def export_real_time(model: Model, path: str | Path, inputs: Iterable[str] = (), solver: str | None = None,
                     step: Time | None = None) -> Portable:
    """Write a diagram as NAME.c, NAME.h and NAME_runner.c, by default with the solver and the step of the diagram.

    Raises UsageError for an unsuitable method or step, ModelError for a diagram that cannot be exported.
    """
    path = Path(path)
    prefix = c_name(path.stem)
    method, length = _method(model, solver), step_of(model, step)
    exported = portable(model, inputs, f"{prefix}_", events=True)
    program = FixedStepProgram(method, length, _checked(exported, method, length))
    header, runner = companions(path)
    for companion in (header, runner):
        if companion.exists() and MARK not in companion.read_text(encoding="utf-8", errors="replace")[:300]:
            raise UsageError([Problem("file-exists", f"'{companion}' exists and was not written by heavebond", None,
                                      "Rename it, or choose another name for the program.")])
    runner_text = (SOURCES / "runner.c").read_text(encoding="utf-8")
    for part, name in (("MODEL.c", path.name), ("MODEL_runner.c", runner.name), ("MODEL.h", header.name)):
        runner_text = runner_text.replace(part, c_comment(name))
    write_text(path, c_text(exported, prefix, fixed=program))
    write_text(header, header_text(exported, prefix, program))
    write_text(runner, runner_text.replace("MODEL", prefix))
    return exported


def _method(model: Model, solver: str | None) -> str:
    """The method of a program; UsageError for a solver without a fixed step."""
    written = model.solver.text if model.solver is not None and model.solver.text in METHODS else DEFAULT_METHOD
    method = solver or written
    if method not in METHODS:
        raise UsageError([Problem("real-time-solver", f"'{method}' is not a method with a fixed step", None,
                                  suggest(method, METHODS) or f"Use one of {listing(METHODS)}.")])
    return method


def companions(path: Path) -> list[Path]:
    """The header and the runner of a program."""
    prefix = c_name(path.stem)
    return [path.with_name(f"{prefix}.h"), path.with_name(f"{prefix}_runner.c")]


def _checked(exported: Portable, method: str, step: float) -> int:
    """The number of nodes in the ring buffer of the delays; UsageError if the method or the step is unsuitable for a
    diagram."""
    problems, algebraic = [], [q.name for q in exported.algebraic]
    if method in ("euler", "rk4") and algebraic:
        problems.append(Problem(
            "real-time-algebraic", f"{method} cannot solve for the algebraic unknowns {listing(algebraic, 4)} without "
            "iteration", None, "Type `--solver rosenbrock` (or `backward-euler`), which solves for them by one "
            "factorisation in each step."))
    if method not in ("euler", "rk4") and len(exported.states) + len(algebraic) > REAL_TIME.unknowns:
        problems.append(Problem(
            "real-time-size", f"{method} would factorise a matrix of {len(exported.states) + len(algebraic)} rows in each "
            f"step; the most is {REAL_TIME.unknowns}", None, "Type `--solver rk4`." if not algebraic else
            "Export a smaller diagram: divide lines and strings into fewer parts."))
    longest = largest_step_of(exported.assembly.model)
    if longest and step > longest:
        problems.append(Problem("real-time-step", f"the step of {step:.6g} s is longer than `largest_step` of the diagram, "
                                f"{longest:.6g} s", None, f"Type `--step '{longest:.6g} s'` or less."))
    periods = _periods(exported)
    sampled = [(period, event) for event, period in zip(exported.events, periods.tolist(), strict=True)
               if event.period is not None and period > 0]
    if sampled:
        period, event = min(sampled, key=lambda pair: pair[0])
        if period < step * (1 - REAL_TIME.same):
            problems.append(Problem("real-time-period", f"the period of {event.name}, {period:.6g} s, is shorter than the "
                                    f"step of {step:.6g} s", event.place, f"Type `--step '{period:.6g} s'` or less."))
    delays = np.array(exported.histories(*exported.at_start)[1]).ravel()
    if delays.size:
        delay, length = exported.delays[int(delays.argmin())], float(delays.min())
        if 0 < length < step * (1 - REAL_TIME.same):
            problems.append(Problem("real-time-delay", f"the delay of {delay.name}, {length:.6g} s, is shorter than the "
                                    f"step of {step:.6g} s", None, f"Type `--step '{length:.6g} s'` or less."))
    nodes = REAL_TIME.spare * (ceil(delays.max() / step) + 8) if delays.size and np.all(np.isfinite(delays)) else 1
    if nodes > REAL_TIME.nodes:
        problems.append(Problem("real-time-delay", f"a delay of {delays.max():.6g} s has {delays.max() / step:.3g} steps; "
                                "its ring buffer would be too large", None, "Make the step longer."))
    if problems:
        raise UsageError(problems)
    return nodes


def _periods(exported: Portable) -> Array:
    """The period of each event in s; 0 for an event without one."""
    return np.array(exported.instants([q.start for q in exported.parameters])[1]).ravel()


def notes(exported: Portable, solver: str | None, step: Time | None) -> list[str]:
    """Notes on the step of an exported program: events within steps, and an explicit method that is unstable with this step
    at the start of the run."""
    model, remarks = exported.assembly.model, list[str]()
    method, length = _method(model, solver), step_of(model, step)
    parts = [event.name for event, period in zip(exported.events, _periods(exported).tolist(), strict=True)
             if event.period is not None and period > 0 and abs(period / length - round(period / length)) > REAL_TIME.same]
    if parts:
        remarks.append(f"{listing(parts, 3)}: the period is not a multiple of the step; its instants divide steps")
    if method in ("euler", "rk4") and exported.states:
        n = len(exported.states)
        matrix = np.array(exported.jacobian(*exported.at_start)[0]).reshape(n, n)
        if np.all(np.isfinite(matrix)) and (limit := stability_limit(matrix, method == "rk4", length)) is not None:
            remarks.append(f"{method} is unstable with this step at the start of the run; its longest stable step is "
                         f"{limit:.2g} s. Type a shorter `--step`, or `--solver rosenbrock`.")
    return remarks


def stability_limit(matrix: Array, fourth_order: bool, step: float) -> float | None:
    """The longest step (s) with which each decaying motion of x' = matrix x decays; None if `step` is not longer."""
    eigenvalues = np.linalg.eigvals(matrix)
    eigenvalues = eigenvalues[eigenvalues.real < -1e-9 * np.abs(eigenvalues)]

    def grows(h: float) -> bool:
        return bool(np.any(amplification(h * eigenvalues, fourth_order) > 1))

    return longest_step(grows, step)


def header_text(exported: Portable, prefix: str, program: FixedStepProgram) -> str:
    """The header: the functions, and the indices of inputs, outputs and parameters with their units."""
    sizes = {"n_x": exported.states, "n_z": exported.algebraic, "n_p": exported.parameters, "n_u": exported.inputs,
             "n_y": exported.outputs}
    lines = [f"/* {c_comment(exported.name)}: a program with a fixed step of {program.step:g} s ({program.method}), written "
             f"by heavebond {VERSION}.",
             "   Its memory is one block; no step allocates memory or iterates without a bound. */",
             f"#ifndef {prefix.upper()}_H", f"#define {prefix.upper()}_H", "#include <stddef.h>", "",
             "enum { " + ", ".join(f"{prefix}_{name} = {len(values)}" for name, values in sizes.items()) + " };",
             f"extern const double {prefix}_dt; /* the step, s */", ""]
    for title, short, quantities in (
            ("Inputs, in SI units, held during a step", "in", exported.inputs),
            ("Outputs, in the units of the diagram", "out", exported.outputs),
            ("Parameters, in SI units, with their values in the diagram", "par", exported.parameters)):
        listed = [(k, q) for k, q in enumerate(quantities) if short != "par" or exported.tunable[k]]
        if listed:
            lines += [f"/* {title} */", "enum {", *_indices(f"{prefix}_{short}_", listed), "};", ""]
    lines += [FUNCTIONS.replace("MODEL", prefix), "#endif", ""]
    return "\n".join(lines)


def _indices(prefix: str, quantities: Iterable[tuple[int, Quantity]]) -> list[str]:
    """One enumerator with a comment for each quantity, whose value is the index of the quantity. If two quantities have the
    same name in C, the index is appended."""
    lines, used, k = [], set[str](), 0
    for k, q in quantities:
        name = c_name(f"{prefix}{q.name}")
        name = name if name not in used else f"{name[:50]}_{k}"
        used.add(name)
        doc = f", {c_comment(q.doc)}" if q.doc else ""
        lines.append(f"  {name} = {k}, /* {c_comment(q.name)} [{c_comment(q.unit.text)}], {q.start:.9g}{doc} */")
    lines[-1] = lines[-1].replace(f" = {k},", f" = {k}", 1)
    return lines


FUNCTIONS = """extern const double MODEL_p_start[], MODEL_u_start[]; /* values of parameters and inputs in the diagram */
/* Names and units by index; the names of values that belong to the start of the diagram are empty. */
extern const char *const MODEL_parameter_names[], *const MODEL_parameter_units[];
extern const char *const MODEL_input_names[], *const MODEL_input_units[];
extern const char *const MODEL_output_names[], *const MODEL_output_units[];

typedef struct MODEL_run MODEL_run;

/* The bytes of a run; the caller provides the memory, aligned for double. A copy of it is a snapshot. */
size_t MODEL_size(void);
/* Begin a run with parameters p (MODEL_n_p values; NULL: MODEL_p_start). 0, or 1 with a message. If the initial conditions
   follow a changed parameter, they are solved here, with memory from malloc that is freed at the end. */
int MODEL_init(MODEL_run *run, const double *p);
/* One step. 0, or 1 with a message if the run has ended; the outputs then keep their last values. */
int MODEL_step(MODEL_run *run);
/* Set an input for the following steps; 1 for an unknown index or a value that is infinite or not a number. */
int MODEL_set_input(MODEL_run *run, int index, double value);
/* An output after the last step; not a number for an unknown index. */
double MODEL_get_output(const MODEL_run *run, int index);
/* The time of the outputs, s. */
double MODEL_time(const MODEL_run *run);
/* The reason why the run has ended; empty before. */
const char *MODEL_message(const MODEL_run *run);
/* The number of steps with more instants of events than they have parts; the last events happened at their ends. */
long long MODEL_late(const MODEL_run *run);
/* The index of a name, or -1. */
int MODEL_parameter_index(const char *name);
int MODEL_input_index(const char *name);
int MODEL_output_index(const char *name);
"""
