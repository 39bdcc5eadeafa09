"""Kinks of laws: switching of max, min, abs, sign, floor and if_else, and whether two runs are on the same branch."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np

from heavebond.language.symbols import stack
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.result import Result, columns
from heavebond.text.expression import ExpressionProblem

_DIFFERENCES = {ca.OP_FMAX: "max", ca.OP_FMIN: "min", ca.OP_LT: "if_else", ca.OP_LE: "if_else", ca.OP_EQ: "if_else",
                ca.OP_NE: "if_else"}
_ARGUMENTS = {ca.OP_FABS: "abs", ca.OP_SIGN: "sign"}
JUMPS = ("sign", "floor", "if_else")
HALVINGS = 50  # of the line between two points of a run, at a condition: down to the rounding of the states
BESIDE = 1e-11  # share of that line, by which the rates are taken before and after the condition
JUMPS_PASSED = (
    "{} jumps at a condition (`{}`) that the model passes at {:.4g} s and that is no event. Derivatives of the {} lack this "
    "jump: values and intervals may be wrong. Let the condition happen as an event (a Switch, Comparator, Relay or "
    "DryFriction, or `when:` in a component), or smooth it (smooth_sign)")
JUMPED = 1e-6  # share of the rates by which they differ on both sides of a condition where they jump


@dataclass(frozen=True)
class Kink:
    """A place in a law that switches if `argument`, in the arguments of the assembly, passes through zero; in an equation
    of `owner`, or in the formula of `signal` itself."""

    owner: str
    function: str
    argument: ca.SX
    signal: str = ""

    @property
    def jumps(self) -> bool:
        """True if the value may jump there, and not only its slope."""
        return self.function in JUMPS


@dataclass(frozen=True)
class KinkCrossing:
    """A kink that two runs pass at different times or on different sides, with the first such time."""

    kink: Kink
    time: float


class Kinks:
    """The kinks of a diagram's equations and of some signals."""

    def __init__(self, assembly: Assembly, signals: Iterable[str] = ()):
        self.kinks = [*_of_equations(assembly), *_of_signals(assembly, signals)]
        self._arguments = ca.Function("kinks", list(assembly.arguments), [stack(k.argument for k in self.kinks)])

    def apart(self, first_run: Result, second_run: Result) -> list[KinkCrossing]:
        """The kinks at which two runs on the same grid are on different sides, in the order of time."""
        if not self.kinks:
            return []
        differ = self._sides(first_run) != self._sides(second_run)
        crossings = [KinkCrossing(kink, float(first_run.time[np.argmax(row)]))
                     for kink, row in zip(self.kinks, differ, strict=True)
                     if row.any()]
        return sorted(crossings, key=lambda passing: passing.time)

    def _sides(self, run: Result) -> Array:
        return np.sign(np.array(self._arguments(*columns(run))).reshape(len(self.kinks), -1))


@dataclass(frozen=True)
class Jump:
    """A law of `owner` that jumps at the time `time` of a run, where a state passes the condition of an `if_else` or a
    `sign`."""

    owner: str
    function: str
    time: float


def passed_jumps(run: Result) -> list[Jump]:
    """The conditions of states at which the equations jump during a run, each with its first time between two points of the
    run. No event happens there. Solvers shorten their steps, but sensitivities lack their jump (f_before - f_after) dt,
    with dt the change of the instant."""
    assembly = run.assembly
    if run.stays:
        return []

    def conditions() -> tuple[list[Kink], ca.Function]:
        _, x, z, *_ = assembly.arguments
        moving = stack([x, z])
        kinks = [k for k in _of_equations(assembly) if k.jumps and ca.depends_on(k.argument, moving)]
        return kinks, ca.Function("conditions", list(assembly.arguments), [stack(k.argument for k in kinks)])

    kinks, arguments = assembly.once("jumps of states", conditions)
    if not kinks:
        return []
    points = columns(run)
    values = np.array(arguments(*points)).reshape(len(kinks), -1)
    instants = np.searchsorted(run.time, [instant.time for instant in run.instants])
    jumps = []
    for number, (kink, row) in enumerate(zip(kinks, values, strict=True)):
        between = np.flatnonzero(row[:-1] * row[1:] < 0)
        for k in between[~np.isin(between + 1, instants)].tolist():
            low, high = ([np.reshape(part[:, at], (-1, 1)) for part in points] for at in (k, k + 1))
            beside = [BESIDE * (b - a) for a, b in zip(low, high, strict=True)]  # at the condition both sides may agree
            side = arguments(*low)[number] > 0
            for _ in range(HALVINGS):
                middle = [(a + b) / 2 for a, b in zip(low, high, strict=True)]
                low, high = (middle, high) if (arguments(*middle)[number] > 0) == side else (low, middle)
            before, after = (np.concatenate([np.array(part).ravel() for part in assembly.rates(
                *(a + sign * b for a, b in zip(at, beside, strict=True)))]) for at, sign in ((low, -1), (high, 1)))
            if np.any(np.abs(after - before) > JUMPED * (np.abs(before) + np.abs(after) + JUMPED)):
                jumps.append(Jump(kink.owner, kink.function, float(low[0][0, 0])))
                break
    return sorted(jumps, key=lambda jump: jump.time)


def jump_notes(run: Result, task: str) -> list[str]:
    """Sentences on the jumps that a run passes, for a `task` (fit, cost) that uses its derivatives by parameters."""
    return [JUMPS_PASSED.format(jump.owner, jump.function, jump.time, task) for jump in passed_jumps(run)]


def _of_equations(assembly: Assembly) -> Iterator[Kink]:
    flat = assembly.flat
    for equation, residual in zip(flat.equations, flat.residuals, strict=True):
        if equation.kink:
            yield from _expressed(assembly, residual, equation.owner)


def _of_signals(assembly: Assembly, signals: Iterable[str]) -> Iterator[Kink]:
    for name in signals:
        output = assembly.model.show.get(name)
        formula = assembly.resolver().evaluate(output.expr if output else assembly.model.library.formula(name))
        yield from _expressed(assembly, formula, f"the signal {name}", name)


def _expressed(assembly: Assembly, raw: ca.SX, owner: str, signal: str = "") -> Iterator[Kink]:
    """The kinks of an expression in raw symbols, with arguments in the assembly's symbols."""
    for function, argument in _kinks(raw):
        try:
            yield Kink(owner, function, assembly.express(argument), signal)
        except ExpressionProblem:  # a derivative within a loop, which cannot be evaluated outside
            continue


def _kinks(expression: ca.SX) -> Iterator[tuple[str, ca.SX]]:
    """Function and argument of each kink in a scalar expression."""
    waiting, visited = [expression], set()
    while waiting:
        node = waiting.pop()
        if node.element_hash() in visited or node.is_constant() or node.is_symbolic():
            continue
        visited.add(node.element_hash())
        operation, parts = node.op(), [node.dep(k) for k in range(node.n_dep())]
        if operation in _DIFFERENCES:
            yield _DIFFERENCES[operation], parts[0] - parts[1]
        elif operation in _ARGUMENTS:
            yield _ARGUMENTS[operation], parts[0]
        elif operation == ca.OP_FLOOR:
            yield "floor", ca.sin(np.pi * parts[0])  # changes its sign when the argument passes a whole number
        waiting += parts
