"""The integrators by name: which of them can be used for a diagram, and all of them called alike.

`auto`, the default of plain runs, takes CVODES for x' = f and IDAS for x' = f, 0 = g, and changes where they stop (see
`simulation`). `idas` (variable-order BDF for x' = f, 0 = g) takes every diagram. `cvodes` is the same family of methods for
x' = f alone: fewer evaluations and less bookkeeping a step, and its Newton iteration ends at a tenth of the error test.
That of IDAS ends at a third, which can keep it at order 1, where its error test rejects every second step. `rosenbrock` is
a one-step method of order 5 (linearly implicit, L-stable), compiled to machine code before its first step, since
interpreted it is slower than IDAS; it pays where one grid of times is run often. The methods of `fixed_step` have no error
control. C. W. Gear, 1971; A. C. Hindmarsh et al., SUNDIALS, 2005, doi:10.1145/1089014.1089020; E. Hairer and G. Wanner,
Solving Ordinary Differential Equations II, 1996, IV.7.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import casadi as ca

from heavebond.core.errors import Place, Problem, UsageError, listing, suggest
from heavebond.equations.buffered import Buffered
from heavebond.language.sections import FIXED_STEP, SOLVERS
from heavebond.numerics import machine_code
from heavebond.numerics.dae import Array, Assembly, Integrand
from heavebond.numerics.fixed_step import FixedStep
from heavebond.numerics.idas import MOST_STEPS, Idas, Tolerances, in_unit_of_time, integrator_options, time_unit
from heavebond.numerics.machine_code import COMPILERS, MACHINE_CODE, Evaluated, Made, compiled

DEFAULT = "idas"
OUTPUTS = ("xf", "zf")
AUTO = "auto"
# Share of the asked tolerances with which CVODES takes the place of IDAS. At a tenth its errors were at most those of IDAS
# in 95 % of 168 bundled diagrams (median 0.28 of them, in 1.05 of the time); at a third they were up to 30 times as large.
CVODES_SHARE = 0.1
STRICT = "idas_strict"  # IDAS with its algebraic unknowns under error control, to which `auto` changes
# Of the whole method: -O2 is a tenth faster than -O1 for two thirds more time to compile, -O3 gains nothing. That functions
# of the method may be put into each other, as no other library takes their place, saves a tenth more.
FLAGS = ("-O2", "-fno-semantic-interposition")
RETYPE = "Type `--solver {0}` (in Python `solver='{0}'`, in the diagram `simulate: {{solver: {0}}}`)"


@dataclass(frozen=True)
class Choice:
    """The solver of a run and the reason; `provisional` if IDAS replaces it after a failure."""

    name: str
    why: str
    provisional: bool = False

    def controlled(self, tolerances: Tolerances) -> Tolerances:
        """The tolerances of the integration for requested tolerances."""
        return tolerances.scaled(CVODES_SHARE) if self.provisional else tolerances


class Integrator(Protocol):
    """An integration from the first to the other stops, called with x0, z0, p and u as `ca.integrator` names them;
    RuntimeError if it fails."""

    def __call__(self, **arguments: Any) -> dict[str, Any]:
        """One integration."""

    def size1_in(self, name: str) -> int:
        """The number of numbers in an input."""

    def stats(self) -> dict[str, Any]:
        """Counts of steps and evaluations of the last call, if the integrator counts them."""


def chosen(name: str | None, assembly: Assembly, changes_states: bool) -> Choice:
    """The solver of a name; by default IDAS, for `auto` the suitable one.

    `changes_states` is true if a run may continue in other states than at its begin, where algebraic unknowns may appear.
    UsageError for an unknown name and for a solver that cannot integrate the diagram.
    """
    if name == AUTO and not assembly.algebraic_names and not changes_states:
        return Choice("cvodes", "no algebraic unknowns", provisional=True)
    if name is None or name == AUTO:
        return Choice(DEFAULT, "the default")
    _check(name, assembly, changes_states)
    written = assembly.model.solver
    return Choice(name, "as the diagram says" if written is not None and written.text == name else "asked for")


def _check(name: str, assembly: Assembly, changes_states: bool) -> None:
    written = assembly.model.solver
    place = written.place if written is not None and written.text == name else None
    if name not in SOLVERS:
        raise UsageError([Problem("solver-unknown", f"'{name}' is not a solver", place,
                                  suggest(name, SOLVERS) or f"Use one of {listing(SOLVERS)}.")])
    if name == "cvodes" and (algebraic := assembly.algebraic_names):
        raise UsageError([algebraic_left(algebraic, place)])
    if name in ("euler", "rk4") and (algebraic := assembly.algebraic_names):
        raise UsageError([algebraic_left(algebraic, place, name)])
    if name != "rosenbrock" and name not in FIXED_STEP:
        return
    fixed = name in FIXED_STEP
    if (assembly.flat.events and not fixed) or assembly.flat.delays or changes_states:
        feature = "has events" if assembly.flat.events and not fixed else "has delayed variables" if assembly.flat.delays \
            else "may change its states along a run (a mechanism that turns over)"
        alternative = "idas" if assembly.algebraic_names else "cvodes"
        raise UsageError([Problem(
            "solver-cut", f"{name} cannot run this diagram: it {feature}", place, RETYPE.format(alternative) + ".",
            ("Its steps are those of its grid." if fixed else
             "It integrates without interruption; such a run is interrupted at times that are not known beforehand.",))])
    if name == "rosenbrock" and machine_code.compiler() is None:
        raise UsageError([Problem(
            "compiler-missing", "rosenbrock needs a C compiler, and there is none on this computer", place,
            f"Install one (Debian, Ubuntu: sudo apt install gcc). {RETYPE.format('auto')} to do without.",
            (f"Looked for {listing(COMPILERS)} on the PATH.",))])


def algebraic_left(names: list[str], place: Place | None = None, solver: str = "cvodes") -> Problem:
    """Why CVODES or another solver for x' = f cannot be used."""
    number, them = ("algebraic unknowns", "them") if len(names) > 1 else ("an algebraic unknown", "it")
    return Problem("solver-algebraic", f"{solver} cannot run this diagram, which has {number}: {listing(names, 4)}", place,
                   f"{RETYPE.format('idas')}, the default, which solves for {them} on its way, or `auto`.")


def integrator(solver: str, integrand: Integrand, stops: Array, tolerances: Tolerances, most_steps: int = MOST_STEPS
               ) -> Integrator:
    """An integrator of a name that `chosen` gave."""
    if solver in (DEFAULT, STRICT):
        return Idas(integrand, stops, tolerances, most_steps, solver == STRICT)
    if solver in FIXED_STEP:
        return FixedStep(solver, integrand, stops)
    return Explicit(solver, integrand, stops, tolerances, most_steps)


def other(solver: str, loops: bool) -> str:
    """The solver with which `auto` continues after a failure, for a system with or without algebraic unknowns."""
    return DEFAULT if solver != DEFAULT else STRICT if loops else "cvodes"


class Explicit:
    """An integration by CVODES or by the compiled Rosenbrock method, called as that by IDAS is."""

    def __init__(self, solver: str, integrand: Integrand, stops: Array, tolerances: Tolerances,
                 most_steps: int = MOST_STEPS):
        self._counts = solver == "cvodes"
        unit = time_unit(stops)
        dae, begin = in_unit_of_time(integrand.dae, unit), float(stops[0] / unit)
        outputs = [float(t) for t in stops[1:] / unit] or [begin + 1.0]
        options = {**solver_options(solver, dae, tolerances, integrand.smallest_pivot), "max_num_steps": most_steps}
        if integrand.longest:
            options["max_step_size"] = integrand.longest / unit
        def make(more: Mapping[str, Any]) -> ca.Function:
            return ca.integrator("run", solver, dae, begin, outputs, {**options, **more})

        self._function = Evaluated(make, OUTPUTS) if solver != "rosenbrock" else Buffered(_compiled(make), OUTPUTS)

    def size1_in(self, name: str) -> int:
        """The number of numbers in an input."""
        return self._function.size1_in(name)

    def expect(self, seconds: float) -> None:
        """See `Evaluated`; the Rosenbrock method is compiled in any case."""
        if isinstance(self._function, Evaluated):
            self._function.expect(seconds)

    def __call__(self, **arguments: Any) -> dict[str, Array]:
        return self._function(**arguments)

    def stats(self) -> dict[str, Any]:
        """Counts of steps and evaluations of the last call (a compiled method keeps none), and how its equations were
        evaluated."""
        return self._function.stats() if self._counts else {"equations": MACHINE_CODE}


def solver_options(solver: str, dae: Mapping[str, ca.SX], tolerances: Tolerances, pivot: float) -> dict[str, Any]:
    """The options of a solver for a DAE; pivots of its Newton matrix below `smallest_pivot` count as zero."""
    options = integrator_options(dae, tolerances, pivot)
    unknown = {"idas": (), "cvodes": ("suppress_algebraic",),
               "rosenbrock": ("suppress_algebraic", "linear_solver", "linear_solver_options", "cache")}[solver]
    return {k: v for k, v in options.items() if k not in unknown}


def _compiled(make: Made) -> ca.Function:
    """The integrator as machine code; UsageError if the compiler fails."""
    try:
        return compiled(make, FLAGS)
    except RuntimeError as error:
        message = str(error).strip().splitlines()[-1]
        raise UsageError([Problem("compiler-failed", f"{machine_code.compiler()} could not compile the equations", None,
                                  RETYPE.format("auto") + ".", (message[:300],))]) from None
