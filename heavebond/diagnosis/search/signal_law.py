"""Response of a law in a signal to the course of the signal, without the machine around it.

The law has the input u(t) and gives its output y(t). It acts on what follows it as w = y - u. In a channel this w is the
exact effect. Before an input of a machine it is the effect to first order, as long as the machine does not change u. The
equations of the component are integrated over the samples of a record by the implicit Euler method, which is stable for time
constants below a sample interval.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from heavebond.language.definition import Component, Value
from heavebond.language.symbols import Context, evaluate, stack
from heavebond.numerics.dae import Array
from heavebond.text.expression import ExpressionProblem

AT_REST = 1e3  # step from a state at rest to the start, in durations of the record
STEPS = 5  # of Newton's method at one sample; a kinked law needs a few
CONVERGED = 1e-6  # largest last step of Newton's method, as a share of the largest value of the unknown


@dataclass(frozen=True)
class SignalLaw:
    """The equations of a component with one input and one output.

    `numbers` are the amplitudes and shapes of its effect; other parameters have their defaults. `seen` are the variables
    whose motion gives the search ranges of numbers. `step` maps (unknowns before, (u, time) now and before, numbers) to the
    unknowns and the last step of Newton's method; `shown` maps (unknowns, (u, time), unknowns before, (u, time) before,
    numbers) to w and the variables seen.
    """

    numbers: tuple[str, ...]
    seen: tuple[str, ...]
    unknowns: int
    step: ca.Function
    shown: ca.Function
    groups: int = 1

    @classmethod
    def of(cls, component: Component) -> SignalLaw | None:
        """Build the equations of a component. None if it has ports, events or lists, or if its equations do not determine
        its variables."""
        effect = component.effect
        into = [s.name for s in component.signals.values() if s.direction == "in"]
        out = [s.name for s in component.signals.values() if s.direction == "out"]
        if effect is None or component.ports or component.composite or component.when or len(into) != 1 or len(out) != 1 \
                or any(v.count is not None for v in component.variables.values()) \
                or any(p.count is not None for p in component.parameters.values()):
            return None
        unknown, given = [*out, *component.variables], [*into, "time"]
        now, before = ({name: ca.SX.sym(name) for name in (*given, *unknown)} for _ in range(2))
        numbers = {name: ca.SX.sym(name) for name in (*effect.amplitude, *effect.shapes)}
        parameters, rows = dict(numbers), list[ca.SX]()
        h = now["time"] - before["time"]
        all_now, all_before = (stack(of.values()) for of in (now, before))

        def rate(value: ca.SX) -> ca.SX:
            return (value - ca.substitute(value, all_now, all_before)) / h

        context = Context(lambda text, name: {**now, **parameters}[text], rate)
        try:
            for name, parameter in component.parameters.items():
                if name not in numbers and isinstance(parameter.default, Value):
                    parameters[name] = evaluate(parameter.default.expr, context)
            for line in component.equations:
                if line.each is not None:
                    return None
                rows.append(evaluate(line.tree.left, context) - evaluate(line.tree.right, context))
        except (KeyError, ExpressionProblem, RecursionError):
            return None
        if len(rows) != len(unknown):
            return None
        seen = tuple(dict.fromkeys(s.seen for s in (*effect.shapes.values(), *effect.amplitude.values())
                                   if s is not None and s.seen))
        y, known = stack(now[n] for n in unknown), stack(now[n] for n in given)
        y_before, known_before = stack(before[n] for n in unknown), stack(before[n] for n in given)
        p, g = stack(numbers.values()), stack(rows)
        newton = ca.Function("newton", [y, known, y_before, known_before, p], [y - ca.solve(ca.jacobian(g, y), g)])
        arguments = [ca.MX.sym(f"a{k}", part.numel()) for k, part in enumerate((y, known, known_before, p))]
        solution = last_step = arguments[0]
        for _ in range(STEPS):
            closer = newton(solution, arguments[1], arguments[0], *arguments[2:])
            solution, last_step = closer, closer - solution
        return cls(tuple(numbers), seen, len(unknown), ca.Function("step", arguments, [solution, last_step]), ca.Function(
            "shown", [y, known, y_before, known_before, p],
            [stack([now[out[0]] - now[into[0]], *(now[name] for name in seen)])]))

    def at(self, courses: Array, numbers: Mapping[str, float]) -> tuple[Array, Array]:
        """The course of w (1, 1, N) and of the variables seen (seen, N) for u and the time (2, N). w is NaN if the equations
        have no solution."""
        p = np.array([[numbers[name]] for name in self.numbers])
        n = courses.shape[1]
        rest = courses[:, :1] - [[0.0], [AT_REST * float(np.ptp(courses[1]))]]
        before = np.column_stack([rest, courses[:, :-1]])
        start = np.array(self.step(np.zeros(self.unknowns), courses[:, 0], rest, p)[0])
        step, shown = _over(self.step, self.shown, n)
        unknowns, last_step = map(np.array, step(start, courses, before, np.tile(p, n)))
        values = np.array(shown(unknowns, courses, np.column_stack([start, unknowns[:, :-1]]), before, np.tile(p, n)))
        with np.errstate(invalid="ignore"):
            converged = np.all(np.abs(last_step).max(axis=1) <= CONVERGED * np.abs(unknowns).max(axis=1) + 1e-300)
        return (values[None, :1] if converged else np.full((1, 1, n), np.nan)), values[1:]


@lru_cache(maxsize=32)
def _over(step: ca.Function, shown: ca.Function, n: int) -> tuple[ca.Function, ca.Function]:
    """Both functions of a law for n samples one after the other."""
    return step.mapaccum(n), shown.map(n)
