"""Response of a law to the course of the variables that drive it, without the machine around it.

* A law in a signal is driven by the signal u(t) and gives its output y(t). It acts on what follows it as w = y - u. In a
  channel this w is the exact effect. Before an input of a machine it is the effect to first order, as long as the machine
  does not change u.
* A law on nodes is driven by their across variables and positions, and gives the through variables w at its ports.
* A law in series with a port is driven by the through variable of the port. It gives the difference w that it makes between
  the port and its node, in position in a domain that has positions, else in the across variable.

The equations of the component are integrated over the samples of a record by the backward differentiation formula of second
order, which is stable for time constants below a sample interval. (The implicit Euler method would delay a rate by half a
sample. The inertia of an added mass then looks like damping.) Derivatives with respect to amplitudes follow from the same
equations, linearised along the solution.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from heavebond.core.units import Dimension
from heavebond.equations.buffered import Buffered
from heavebond.language.definition import Component, Domain, Parameter, Value
from heavebond.language.symbols import Context, evaluate, stack
from heavebond.numerics.dae import Array
from heavebond.text.expression import ExpressionProblem, names

AT_REST = 1e3  # step from a state at rest to the start, in durations of the record
STEPS = 5  # of Newton's method at one sample; a kinked law needs a few
CONVERGED = 1e-6  # largest last step of Newton's method, as a share of the largest value of the unknown
SIGNALS, SERIES = ("input", "channel"), "in series"  # ways to attach; the others are on nodes


@dataclass(frozen=True)
class DrivenLaw:
    """The equations of a component that is driven by given variables.

    `given` are the names of the variables that drive it, the last one the time; those of a law in series are the through
    variable of its second port and, in a domain without positions, the across variable of the first. `delayed` are the
    indices of those that it also reads with the delays `lags`, a function of the numbers. `through` are the
    names of the variables w. `numbers` are the amplitudes and shapes of its effect; other parameters have their defaults, or
    the value of the medium. `seen` are the variables whose motion gives the search ranges of numbers. The arguments of all
    functions are the unknowns at two samples, (given now and at these samples), and the numbers. `step` maps (unknowns at
    the last two samples, ...) to the unknowns at this and the last sample and to the last step of Newton's method; `shown`
    maps (unknowns now, unknowns at the last two samples, ...) to w and the variables seen. `slopes` maps (derivatives of the
    unknowns at the last two samples, arguments of `shown`) to the derivatives of the unknowns at this and the last sample,
    and of w, with respect to the amplitudes of each of the `groups`, which move together; None without amplitudes that
    vanish.
    """

    given: tuple[str, ...]
    delayed: tuple[int, ...]
    lags: ca.Function
    through: tuple[str, ...]
    numbers: tuple[str, ...]
    seen: tuple[str, ...]
    unknowns: int
    step: ca.Function
    shown: ca.Function
    slopes: ca.Function | None = None
    groups: int = 1

    @classmethod
    def of(cls, component: Component, attaches: str, vanishes: bool, domains: Mapping[str, Domain],
           medium: Mapping[str, float]) -> DrivenLaw | None:
        """Build the equations of a component that attaches in this way. If it `vanishes`, its amplitudes have neutral values
        and w is their derivative. `domains` are those of the library, `medium` are the values of the circuits by the name
        of the medium's parameter. None if it has events or lists, if a port has several across variables, or if its
        equations do not determine its variables."""
        effect = component.effect_of(attaches)
        of_port = {port.name: domains.get(port.domain) for port in component.ports.values()}
        if effect is None or component.composite or component.when or component.frames \
                or any(v.count is not None for v in component.variables.values()) \
                or any(p.count is not None for p in component.parameters.values()) \
                or any(d is None or max(len(d.across), len(d.through)) > 1 for d in of_port.values()):
            return None
        wired = _in_signal(component) if attaches in SIGNALS else _on_nodes(component, of_port, attaches == SERIES)
        if wired is None:
            return None
        given, unknown, fixed, rates, shifts, output = wired
        delays = {v.name: v.delayed for v in component.variables.values() if v.delayed is not None}
        if not {delay.of for delay in delays.values()} <= {*given}:
            return None
        # the delayed courses are known as well
        driving, given = [*given, "time"], [*given, "time", *delays]
        unknown = [*unknown, *(name for name in component.variables if name not in delays)]
        now, before, earlier = ({name: ca.SX.sym(name) for name in (*given, *unknown)} for _ in range(3))
        numbers = {name: ca.SX.sym(name) for name in (*effect.amplitude, *effect.shapes)}
        parameters, rows = dict(numbers), list[ca.SX]()
        h, h_before = now["time"] - before["time"], before["time"] - earlier["time"]
        all_now, all_before, all_earlier = (stack(of.values()) for of in (now, before, earlier))

        def rate(value: ca.SX) -> ca.SX:
            last, last_but_one = (ca.substitute(value, all_now, there) for there in (all_before, all_earlier))
            slope, slope_before = (value - last) / h, (last - last_but_one) / h_before
            return slope + (slope - slope_before) * h / (h + h_before)

        known = {**now, **{name: ca.SX(value) for name, value in fixed.items()}}
        known |= {name: rate(now[of]) for name, of in rates.items()}
        known |= {name: now[of] + now[more] for name, (of, more) in shifts.items()}
        context = Context(lambda text, name: {**known, **parameters}[text], rate)
        try:
            for name, parameter in component.parameters.items():
                if name not in numbers:
                    parameters[name] = _value(parameter, medium, context)
            lags = stack(evaluate(delay.by.tree, context) for delay in delays.values())
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
        if not set(seen) <= known.keys():
            return None
        y, drive = (stack(now[n] for n in of) for of in (unknown, given))
        y_before, drive_before = (stack(of[n] for of in (before, earlier) for n in group) for group in (unknown, given))
        p, g = stack(numbers.values()), stack(rows)
        every = [y, y_before, drive, drive_before, p]
        newton = ca.Function("newton", every, [y - ca.solve(ca.jacobian(g, y), g)])
        known_before, *driven = (ca.MX.sym(f"a{k}", part.numel()) for k, part in enumerate(every[1:]))
        solution = known_before[:len(unknown)]
        linear = not ca.depends_on(ca.jacobian(g, y), y)
        last_step = ca.MX.zeros(len(unknown))
        for _ in range(1 if linear else STEPS):
            closer = newton(solution, known_before, *driven)
            solution, last_step = closer, last_step if linear else closer - solution
        step = ca.Function("step", [known_before, *driven], [ca.vertcat(solution, known_before[:len(unknown)]), last_step])
        w = stack(known[name] - (known[less] if less else 0) for name, less in output.items())
        slopes, groups = None, dict[Dimension, list[ca.SX]]()
        if vanishes:  # amplitudes of one unit move together
            for name in effect.amplitude:
                groups.setdefault(component.parameters[name].unit.dimension, []).append(numbers[name])
            g_along, w_along = (ca.horzcat(*(ca.sum2(ca.jacobian(of, stack(group))) for group in groups.values()))
                                for of in (g, w))
            moved_before = ca.SX.sym("moved", 2 * len(unknown), len(groups))
            moved = -ca.solve(ca.jacobian(g, y), ca.mtimes(ca.jacobian(g, y_before), moved_before) + g_along)
            slopes = ca.Function("slopes", [moved_before, *every], [
                ca.densify(ca.vertcat(moved, moved_before[:len(unknown), :])),
                ca.densify(ca.vec(ca.mtimes(ca.jacobian(w, y), moved) + w_along))])
        shown = ca.Function("shown", every, [stack([*(w[k] for k in range(w.numel())), *(known[name] for name in seen)])])
        return cls(tuple(driving), tuple(driving.index(delay.of) for delay in delays.values()),
                   ca.Function("lags", [p], [lags]), tuple(output), tuple(numbers), seen, len(unknown), step, shown, slopes,
                   len(groups) or 1)

    def at(self, courses: Array, numbers: Mapping[str, float]) -> tuple[Array, Array]:
        """The course of w, or its derivatives (groups, through, N) with respect to the amplitudes that vanish, and of the
        variables seen (seen, N) for the given variables (given, N). w is NaN if the equations have no solution."""
        p = np.array([[numbers.get(name, 0.0)] for name in self.numbers])
        n, u, outputs, time = courses.shape[1], self.unknowns, len(self.through), courses[-1]
        delays = zip(self.delayed, np.array(self.lags(p)).ravel(), strict=True)
        courses = np.vstack([courses, *(np.interp(time - lag, time, courses[k]) for k, lag in delays)])
        rest = np.repeat(courses[:, :1], 2, axis=1)  # before the record
        rest[len(self.given) - 1] -= AT_REST * float(np.ptp(time)) * np.arange(1, 3)
        start = np.array(self.step(np.zeros(2 * u), courses[:, 0], rest.ravel("F"), p)[0])
        start[u:] = start[:u]
        step, shown, slopes = _over(self.step, self.shown, self.slopes, n)
        before = np.vstack([np.column_stack([rest[:, :1], courses[:, :-1]]),
                            np.column_stack([rest[:, 1:], rest[:, :1], courses[:, :-2]])])
        solved, last_step = step(start, courses, before, np.tile(p, n)).values()
        unknowns = solved[:u]
        every = unknowns, np.column_stack([start, solved[:, :-1]]), courses, before, np.tile(p, n)
        values, = shown(*every).values()
        with np.errstate(invalid="ignore"):
            converged = np.all(np.abs(last_step).max(axis=1) <= CONVERGED * np.abs(unknowns).max(axis=1) + 1e-300)
        if not converged:
            return np.full((self.groups, outputs, n), np.nan), values[outputs:]
        if slopes is None:
            return values[None, :outputs], values[outputs:]
        derivatives = slopes(np.zeros((2 * u, self.groups)), *every)["o1"]
        return derivatives.reshape(self.groups, outputs, n), values[outputs:]


# given, unknowns, constant variables, rates of unknowns, sums of two variables, and w: a variable less another one
_Wired = tuple[list[str], list[str], dict[str, float], dict[str, str], dict[str, tuple[str, str]], dict[str, str]]


def _in_signal(component: Component) -> _Wired | None:
    """A law with one input and one output."""
    into = [s.name for s in component.signals.values() if s.direction == "in"]
    out = [s.name for s in component.signals.values() if s.direction == "out"]
    if component.ports or len(into) != 1 or len(out) != 1:
        return None
    return into, out, {}, {}, {}, {out[0]: into[0]}


def _on_nodes(component: Component, domains: Mapping[str, Domain | None], series: bool) -> _Wired | None:
    """A law between nodes, or in series with a port: its second port is then connected to this port, and its first port is
    at the node. Mechanical laws in series depend on the distance of their ports only."""
    if component.signals:
        return None
    through, shared = ({port: getattr(domain, of) for port, domain in domains.items() if domain is not None}
                       for of in ("through", "shared"))
    if not series:
        outputs = [f"{port}.{member}" for port, members in through.items() for member in members]
        sides = [side for line in component.equations for side in (line.tree.left, line.tree.right)]
        read = {name.text for side in sides for name in names(side)}
        driving = [name for port, members in shared.items() for member in members if (name := f"{port}.{member}") in read]
        return driving, outputs, {}, {}, {}, dict.fromkeys(outputs, "")
    if len(domains) != 2:
        return None
    (first, domain), (second, _) = domains.items()
    assert domain is not None
    flow, across = domain.through[0], domain.across[0]
    driving, free = [f"{second}.{flow}"], [f"{first}.{flow}"]
    if domain.position is None:
        return [*driving, f"{first}.{across}"], [*free, "w"], {}, {}, {f"{second}.{across}": (f"{first}.{across}", "w")}, \
            {"w": ""}
    position = f"{second}.{domain.position}"
    return driving, [*free, position], {f"{first}.{across}": 0.0, f"{first}.{domain.position}": 0.0}, \
        {f"{second}.{across}": position}, {}, {position: ""}


def _value(parameter: Parameter, medium: Mapping[str, float], context: Context) -> ca.SX:
    """The value of a parameter that is not a number of the effect; KeyError if it has none."""
    if parameter.medium in medium:
        return ca.SX(medium[parameter.medium])
    if not isinstance(parameter.default, Value):
        raise KeyError(parameter.name)
    return evaluate(parameter.default.expr, context)


@lru_cache(maxsize=64)
def _over(step: ca.Function, shown: ca.Function, slopes: ca.Function | None, n: int
          ) -> tuple[Buffered, Buffered, Buffered | None]:
    """The functions of a law for n samples one after the other."""
    return Buffered(step.expand().mapaccum(n)), Buffered(shown.map(n)), \
        None if slopes is None else Buffered(slopes.mapaccum(n))
