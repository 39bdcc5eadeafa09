"""The reduced model as CasADi functions: scaled, with expressions of parameters alone evaluated once a run."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from math import isfinite
from typing import Any, NamedTuple, TypeVar, cast

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.core.cancellation import check
from heavebond.core.errors import NAMES_LISTED, ModelError, Problem, Problems, UsageError, listing, suggest
from heavebond.core.presentation import brief, count
from heavebond.core.quantities import number_or_text
from heavebond.core.units import UnitProblem, check_unit, interval_text, parse_quantity
from heavebond.equations.flatten import Flat, flatten, without_zeros
from heavebond.equations.reduce import Reduced, reduce_flattened
from heavebond.equations.resolver import Resolver
from heavebond.language.external_functions import opened
from heavebond.language.model import Model, ModelOrFile, loaded
from heavebond.language.symbols import split, stack
from heavebond.numerics.impulses import with_impulses
from heavebond.numerics.interval_functions import operation
from heavebond.numerics.output_times import begin_of
from heavebond.numerics.reset_checks import check_resets
from heavebond.numerics.update_order import UpdateOrder
from heavebond.text.expression import Expr, ExpressionProblem

Array = NDArray[np.float64]
T = TypeVar("T")
MOST_NEWTON = 20  # steps to the algebraic unknowns from what IDAS interpolated
# how often a signal may be differentiated
DERIVATIVES = {"hold": 0, "linear": 1, "spline": 3}
# A delayed variable is integrated in polynomials of so many terms, and has so many rows among the inputs (see
# `substitute_inputs`).
DELAY_TERMS = 8
DELAY_ROWS = 3 + DELAY_TERMS
LARGE = 100  # smallest number of unknowns of a system that is factorised by CSparse
SMALLEST_PIVOT = 1e-12  # of sparse QR, the default of CasADi: a smaller pivot is zero
# Gradient of a residual of a loop (per size of an unknown) from which on, or below the reciprocal of which, the residual is
# scaled: the linear solver does not scale rows, and loses the smaller ones of a matrix to rounding.
FAR_GRADIENT = 1e12
OTHER_STATES = "in other states"  # key of `memo`
LOST_GRADIENT = 1e-9  # of the gradient of a loop at the beginning: below it, the loop no longer determines its unknown


@contextmanager
def without_collection() -> Iterator[None]:
    """Disable the cyclic garbage collector in the body of a `with` statement.

    While hundreds of thousands of long-lived objects are created, each collection traverses all of them again. Reference
    counting still frees objects without cycles.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


class Size(NamedTuple):
    """The nominal size of an unknown in a run, and the value from which a state that moves little about it is counted."""

    value: float
    origin: float = 0.0


@dataclass(frozen=True)
class Assembly:
    """A diagram ready to run: x' = ode, 0 = alg in scaled unknowns, and every variable as a function of them.

    Argument order of all functions: (t, x, z, p, u, rate), x (n_x,) and z (n_z,) in SI, p (n_p,) the independent
    parameters, u the polynomial pieces of the measured inputs and of the delayed variables at t (see `substitute_inputs`),
    rate 1 (0: inputs held still). With u = 0 a delayed variable has its value before the start.
    """

    reduced: Reduced
    p: Array
    x_nominal: Array
    z_nominal: Array
    arguments: tuple[ca.SX, ...]
    ode: ca.SX
    alg: ca.SX
    rates: ca.Function
    values: ca.Function
    pivots: ca.Function
    sizes: Mapping[str, Size] = field(default_factory=dict, repr=False)  # that replace nominal ones, see `with_sizes`
    memo: dict[object, Any] = field(default_factory=dict, repr=False, compare=False)  # see `once`

    def __repr__(self) -> str:
        return brief(self, self.model.name, ", ".join((
            count(len(self.state_names), "state"), count(len(self.algebraic_names), "algebraic unknown"),
            count(len(self.parameter_names), "parameter"))))

    def __reduce__(self) -> tuple[Callable[..., Assembly], tuple[object, ...]]:
        """Pickle the diagram and the numbers: another process assembles them again, as CasADi's functions stay in theirs.
        Raises TypeError if the equations of the assembly are no longer those of the diagram."""
        if self.flat.options is None:
            raise TypeError("an assembly with equations that its diagram does not have cannot be pickled")
        return _assembled_again, (self.model, self.flat.options, self.reduced.states, self.p, dict(self.sizes))

    def once(self, key: object, make: Callable[[], T]) -> T:
        """Values derived from the equations alone, independent of parameter values, and needed in every run; computed
        once."""
        if key not in self.memo:
            self.memo[key] = make()
        return cast(T, self.memo[key])

    @property
    def update_order(self) -> UpdateOrder:
        """The order of the updates at one instant."""
        return self.once("update order", lambda: UpdateOrder(self.reduced, self.express))

    @property
    def flat(self) -> Flat:
        """The flat model that this was reduced from."""
        return self.reduced.flat

    @property
    def model(self) -> Model:
        """The diagram."""
        return self.flat.expanded.model

    @property
    def begin(self) -> float:
        """The time (s) at which the runs of the diagram begin."""
        return begin_of(self.model)

    @cached_property
    def state_names(self) -> list[str]:
        """The names of x."""
        return [self.reduced.name(c) for c in self.reduced.states]

    @cached_property
    def algebraic_names(self) -> list[str]:
        """The names of z."""
        return [self.reduced.name(c) for c in self.reduced.algebraic]

    @cached_property
    def parameter_names(self) -> list[str]:
        """The names of p."""
        return [q.name for q in self.flat.parameters]

    @property
    def parameter_values(self) -> dict[str, float]:
        """The independent parameters in SI."""
        return dict(zip(self.parameter_names, self.p.tolist(), strict=True))

    def with_parameters(self, values: Mapping[str, float | str]) -> Assembly:
        """The same equations with other parameter values. The equations change only if a delay becomes or ceases to be zero,
        or if a parameter of `zeros` becomes nonzero (see `at_zero`). Raises UsageError if a name is not an independent
        parameter, ModelError for a value that its component does not allow."""
        p = self.p.copy()
        for (name, new_value), k in zip(values.items(), self.parameter_indices(values), strict=True):
            p[k] = self._number(name, new_value, k)
        self.flat.limits.check(p, values)
        if self.flat.other_delays(p) or any(p[k] != 0 for k in self.parameter_indices(self.flat.zeros)):
            # a variable that equals its source has other equations than one that is delayed
            known = dict(zip(self.parameter_names, p.tolist(), strict=True))
            changed: dict[str, float | str] = {name: value for name, value in known.items() if name in values}
            positions = [u.name for u in self.flat.unknowns if u.role == "position"]
            assembly = assemble(self.model.with_parameters(changed), positions)
            return replace(assembly, p=np.array([known.get(name, value) for name,
                                                 value in assembly.parameter_values.items()]))
        return replace(self, p=p)

    def parameter_indices(self, names: Iterable[str]) -> list[int]:
        """The indices of independent parameters in p; UsageError for a name that cannot be set."""
        index = self.once("parameter indices", lambda: {q.name: k for k, q in enumerate(self.flat.parameters)})
        indices = []
        for name in names:
            if name not in index:
                held = any(name == h.name for h in self.flat.held)
                dependent = name in self.flat.constants
                hint = f"Its initial value is called 'initial.{name}'." if held else \
                    "It follows from other parameters by a formula." if dependent else suggest(name, index) or NAMES_LISTED
                raise UsageError([Problem("parameter-unknown", f"'{name}' cannot be set", None, hint)])
            indices.append(index[name])
        return indices

    @property
    def x_origin(self) -> Array:
        """The values (n_x,) of the states at which the scaled states are 0."""
        return self.once("origins", lambda: np.array([
            size.origin if (size := self.sizes.get(name)) else 0.0 for name in self.state_names]))

    def scaled_x(self, x: Array) -> Array:
        """The scaled states (x - x_origin) / x_nominal of states (n_x,) or (n_x, N)."""
        return np.asarray(((x.T - self.x_origin) / self.x_nominal).T)

    def unscaled_x(self, x: Array, blocks: int = 1) -> Array:
        """The states of scaled states (n_x blocks,) or (n_x blocks, N); all blocks but the first are sensitivities."""
        sizes, origins = self.x_nominal, self.x_origin
        if blocks > 1:
            sizes, origins = np.tile(sizes, blocks), np.pad(origins, (0, len(origins) * (blocks - 1)))
        return np.asarray((x.T * sizes + origins).T)

    @property
    def z_usual(self) -> Array:
        """The sizes (n_z,) of the algebraic unknowns that decide whether an equation determines one: the nominal ones, or
        the usual sizes of their units if these are larger. Whether the equations have a solution does not depend on the
        tolerances of a run."""
        unknowns = [self.flat.unknowns[j] for j, _ in self.reduced.algebraic]
        return np.maximum(self.z_nominal, [max(u.nominal, u.usual) for u in unknowns])

    def with_sizes(self, sizes: Mapping[str, Size]) -> Assembly:
        """The same equations with other nominal sizes of states and algebraic unknowns, by name: those that scale the
        integration and its absolute tolerances. A state with an origin is integrated as its difference from there, to which
        the relative tolerance then applies."""
        flat, reduced = self.flat, self.reduced
        x, z = (np.array([size.value if (size := sizes.get(reduced.name(c))) else flat.unknowns[c[0]].nominal
                          for c in columns]) for columns in (reduced.states, reduced.algebraic))
        return replace(self, x_nominal=x, z_nominal=z, sizes=dict(sizes), memo={OTHER_STATES: self.in_other_states})

    @property
    def in_other_states(self) -> dict[frozenset[tuple[int, int]], Assembly]:
        """The assemblies of the same equations with other states and nominal sizes, by their states (see
        `dynamic_state_selection`)."""
        return self.once(OTHER_STATES, dict)

    def _number(self, name: str, value: float | str, index: int) -> float:
        value = number_or_text(value, self.flat.parameters[index].unit.text, name)
        if not isinstance(value, str):
            if not isfinite(value):
                raise UsageError([Problem("value-not-finite", f"{name} = {value} has no finite value", None,
                                          "Give a finite number.")])
            return float(value)
        try:
            number, unit = parse_quantity(value)
            check_unit(unit, self.flat.parameters[index].unit, number, value)
            if unit is not None and unit.offset and self.flat.origins.of_name(name.removeprefix("initial.")) == 0:
                raise UnitProblem("unit-offset", f"'{value}' is a temperature, and this is a difference",
                                  f"Write '{interval_text(number, unit)}'.")
        except UnitProblem as problem:
            raise UsageError([Problem(problem.code, f"{name}: {problem.message}", None, problem.hint)]) from None
        return number

    @cached_property
    def _raw(self) -> ca.Function:
        return ca.Function("raw", list(self.arguments), [
            substitute_inputs(self.reduced.expressions, self.flat, self.arguments[0], self.arguments[4])])

    def point(self, t: float, x: Array, z: Array, p: Array, u: Array, rate: float = 1.0) -> dict[int, float]:
        """The values of all raw symbols of the flat model by their hashes, at values of the arguments."""
        reduced = self.reduced
        values_by_hash = {self.arguments[0].element_hash(): t, self.arguments[5].element_hash(): rate}
        for symbols, values in ((reduced.symbols, np.array(self._raw(t, x, z, p, u, rate)).ravel()), (reduced.x, x),
                                (reduced.z, z), (self.flat.p, p)):
            values_by_hash |= {s.element_hash(): float(v) for s, v in zip(split(symbols), values, strict=True)}
        return values_by_hash

    def resolver(self) -> Resolver:
        """Names of the diagram to raw symbols and units."""
        flat = self.flat
        return Resolver(flat.names, flat.constants, flat.units, flat.unknowns, flat.columns, flat.time, flat.rate,
                        {**flat.bonds, **flat.block_bonds})

    def expression(self, expr: Expr) -> ca.SX:
        """A formula of the diagram's names as SX in `arguments`; ExpressionProblem for an unknown name."""
        return self.once(("expression", expr), lambda: self.express(self.resolver().evaluate(expr)))

    def express(self, raw: ca.SX) -> ca.SX:
        """Substitute (t, x, z, p, u, rate) for raw symbols; a derivative that no equation contains follows by the chain
        rule."""
        expression = self.reduced.express(raw)
        if self.flat.zeros:  # the power of a volume of 0 needs no rate of its pressure
            left_out = stack([self.flat.constants[name] for name in self.flat.zeros])
            expression = ca.densify(ca.sparsify(ca.substitute(expression, left_out, ca.SX.zeros(left_out.shape))))
        missing = [s for s in ca.symvar(expression) if s.element_hash() not in self._available]
        if missing:
            expression = ca.substitute(expression, stack(missing), stack([self._rate_of(s) for s in missing]))
        return substitute_inputs(expression, self.flat, self.arguments[0], self.arguments[4])

    @cached_property
    def _available(self) -> set[int]:
        """The hashes of the symbols that an expression may have in the end: the arguments and the measured inputs."""
        t, x, z, _, u, rate = self.arguments
        known = (t, x, z, u, rate, *(k.symbols for k in self.flat.driving))
        return {*self.flat.places, *(s.element_hash() for a in known for s in ca.symvar(a))}

    def _rate_of(self, symbol: ca.SX) -> ca.SX:
        """d/dt of an unknown whose derivative does not occur in the equations, by the chain rule."""
        first = {s.element_hash(): j for j, s in enumerate(self.flat.levels[1])}
        j = first.get(symbol.element_hash())
        if j is None:
            flat, key = self.flat, symbol.element_hash()
            name = next(("d" * k + flat.unknowns[j].name for k, level in enumerate(flat.levels)
                         for j, s in enumerate(level) if s.element_hash() == key), "a derivative")  # `dddcrown.x`
            raise ExpressionProblem("derivative-too-high", f"{name} is not available here", 0)
        value = self.reduced.express(self.flat.levels[0][j])
        t, x, z, _, _, rate = self.arguments
        if z.numel() and ca.which_depends(value, z, 1, False)[0]:
            raise ExpressionProblem("derivative-of-loop", f"der({self.flat.unknowns[j].name}) is not available: it "
                                    "is solved for in an algebraic loop", 0)
        low = stack([x, *[k.symbols[:-1] for k in self.flat.driving]])
        high = stack([self.reduced.ode, *[k.symbols[1:] for k in self.flat.driving]])
        return ca.jtimes(value, low, high) + ca.jtimes(value, t, rate)


def assemble(model: ModelOrFile | Assembly, also: Iterable[str] = (), widths: float = 1.0) -> Assembly:
    """Assemble a diagram: flatten, reduce the index and compile x' = f(t, x, z, p), 0 = g(t, x, z, p).

    `model` is a diagram, or the path or bundled name of one; an Assembly, which serves many runs, is returned as it is.
    `also` names positions that no equation uses; `widths` is a factor on the widths of all regularised transitions. Raises
    ModelError with all problems of the diagram. Sources: C. C. Pantelides, 1988, doi:10.1137/0909014; S. E. Mattsson, G.
    Soederlind, 1993, doi:10.1137/0914043.
    """
    if isinstance(model, Assembly):
        return model
    with without_collection():
        diagram, wanted = loaded(model), sorted(set(also))
        reduced = reduce_flattened(lambda corners: _checked(flatten(diagram, wanted, widths, corners)))
        check()
        assembly = build(reduced)
        check()
        return assembly


def at_zero(assembly: Assembly, free: Iterable[str] = (), flattened: Callable[[Mapping[int, int]], Flat] | None = None
            ) -> Assembly:
    """The assembly with the equations that hold where parameters are 0: terms that these multiply are left out, as if their
    component did not have them.

    An assembly divides by coefficients such as a mass. If a parameter of value 0 makes one of these vanish, the model has
    fewer states or another index: the speed of a body without mass on a spring and a damper is not a state; a lag of 0 s
    passes its input. It is then `flattened` (by default from its diagram) and reduced again without these parameters. The
    assembly itself is returned if no coefficient vanishes, if the equations without the parameters are singular, or if a
    `free` parameter, whose value may change, is among them. Their values remain parameters with the value 0; a sensitivity
    by them does not exist.
    """
    if flattened is None:
        if assembly.flat.options is None:  # equations that the diagram does not have
            return assembly
        flattened = partial(_flattened, assembly.model, assembly.flat.options)
    nonzero, zeros, known = set(free), list[str](), assembly.parameter_values
    result = assembly
    while vanishing := _vanishing(result):
        zeros += vanishing
        if not nonzero.isdisjoint(vanishing):
            return assembly
        try:
            with without_collection():
                result = build(reduce_flattened(partial(_left_out, flattened, tuple(zeros))))
        except ModelError:
            check()
            return assembly
        result = replace(result, p=np.array([known.get(name, value) for name, value in result.parameter_values.items()]))
    return result


def other_states(assembly: Assembly) -> UsageError:
    """The error for a nonzero value of a parameter that is 0 in the diagram, in computations with the equations for the
    value 0."""
    zeros = listing(assembly.flat.zeros)
    return UsageError([Problem("zero-left", f"{zeros} = 0 in the diagram is to have another value, with which the model has "
                               "other states", None, "Give a value other than 0 in the diagram.")])


def _flattened(model: Model, options: tuple[tuple[str, ...], float, tuple[str, ...]], corners: Mapping[int, int]) -> Flat:
    """The flat model of a diagram with the options of another one."""
    also, widths, zeros = options
    flat = _checked(flatten(model, also, widths, corners))
    return without_zeros(flat, zeros) if zeros else flat


def _left_out(flattened: Callable[[Mapping[int, int]], Flat], zeros: tuple[str, ...], corners: Mapping[int, int]) -> Flat:
    return without_zeros(flattened(corners), zeros)


def _vanishing(assembly: Assembly) -> list[str]:
    """The parameters whose value 0 makes a divisor zero or the algebraic equations singular for all values of the other
    parameters."""
    flat, (_, _, z, *_) = assembly.flat, assembly.arguments
    symbols_of_p = split(flat.p)
    zero = {symbols_of_p[k].element_hash(): k for k in np.flatnonzero(assembly.p == 0).tolist()}
    for h in flat.held:
        zero.pop(symbols_of_p[h.index].element_hash(), None)
    if not zero:
        return []

    def zero_symbols(expression: ca.SX) -> list[ca.SX]:
        return [s for s in ca.symvar(expression) if s.element_hash() in zero]

    def without(expression: ca.SX, symbols: Sequence[ca.SX]) -> ca.SX:
        return ca.sparsify(ca.substitute(expression, stack(symbols), ca.SX.zeros(len(symbols))))

    vanishing = dict[int, None]()
    for pivot in assembly.reduced.pivots:
        if not pivot.derived and (symbols := zero_symbols(pivot.coefficient)) \
                and without(pivot.coefficient, symbols).nnz() == 0:
            vanishing |= dict.fromkeys(zero[s.element_hash()] for s in symbols)
    slopes = assembly.once("algebraic slopes", lambda: ca.jacobian(assembly.alg, z))
    if symbols := zero_symbols(slopes):
        def rank(left_out: Sequence[ca.SX]) -> int:
            return ca.sprank(without(slopes, left_out).sparsity())

        lost, needed = rank(symbols), symbols
        if lost < ca.sprank(slopes.sparsity()):
            for symbol in symbols:  # those that make no difference remain
                fewer = [s for s in needed if s is not symbol]
                needed = fewer if fewer and rank(fewer) == lost else needed
            vanishing |= dict.fromkeys(zero[s.element_hash()] for s in needed)
    return [assembly.parameter_names[k] for k in vanishing]


def _assembled_again(model: Model, options: tuple[tuple[str, ...], float, tuple[str, ...]],
                     states: tuple[tuple[int, int], ...], p: Array, sizes: Mapping[str, Size]) -> Assembly:
    """The assembly of a diagram in the states and with the numbers of another one."""
    assembly = build(reduce_flattened(partial(_flattened, model, options)))
    if assembly.reduced.states != states:
        assembly = build(assembly.reduced.choices.solve(list(states)))
    return replace(assembly.with_sizes(sizes) if sizes else assembly, p=p)


def _checked(flat: Flat) -> Flat:
    """The flat model, unless the work was cancelled meanwhile."""
    check()
    return flat


def build(reduced: Reduced) -> Assembly:
    """The CasADi functions of a reduced model."""
    problems = Problems()
    check_resets(reduced, problems)
    problems.raise_as(ModelError)
    reduced = with_impulses(reduced)
    flat = reduced.flat
    u = ca.SX.sym("u", measured_rows(flat) + DELAY_ROWS * len(flat.delays)) if flat.driving else ca.SX(0, 1)
    arguments = (flat.time, reduced.x, reduced.z, flat.p, u, flat.rate)
    values = reduced.unknowns()

    def with_inputs(expression: ca.SX) -> ca.SX:
        return substitute_inputs(expression, flat, flat.time, u)

    _check_events(reduced)
    _check_smoothness(reduced, [reduced.ode, reduced.alg, values])
    ode, alg, values = (with_inputs(e) for e in (reduced.ode, reduced.alg, values))
    pivots = with_inputs(stack([q.coefficient for q in reduced.pivots]))
    assembly = Assembly(
        reduced, np.array([q.value for q in flat.parameters]),
        np.array([flat.unknowns[j].nominal for j, _ in reduced.states]),
        np.array([flat.unknowns[j].nominal for j, _ in reduced.algebraic]),
        arguments, ode, alg, ca.Function("rates", list(arguments), [ode, alg]),
        ca.Function("values", list(arguments), [values]), ca.Function("pivots", list(arguments), [pivots]))
    if flat.events:
        assembly.update_order.at(assembly.p)  # ModelError for a loop of sampled parts
    return assembly


def _check_events(reduced: Reduced) -> None:
    """Raise ModelError if an event sets a variable that is not a state, or if a period is not positive."""
    flat, problems = reduced.flat, Problems()
    states = {j for j, order in reduced.states if order == 0}
    for event in flat.events:
        for reset in (r for r in event.resets if r.unknown is not None and r.unknown not in states):
            names = listing([reduced.name(c) for c in reduced.states] or ["none"], 20)
            problems.add("reset-no-state", f"'{event.name}' sets '{reset.name}', which is not a state: it follows from the "
                         "states", reset.place, hint=f"States of this diagram: {names}.")
        if event.period is not None:
            p = [q.value for q in flat.parameters]
            period = float(ca.Function("period", [flat.p], [event.period])(p))
            if not period > 0:
                problems.add("every-not-positive", f"'{event.name}' would happen every {period:g} s", event.place,
                             hint="Give a time above 0.")
    problems.raise_as(ModelError)


def _check_smoothness(reduced: Reduced, expressions: list[ca.SX]) -> None:
    """Raise ModelError if the equations need the derivative of a held input or the second derivative of a linear one."""
    if not reduced.flat.inputs:
        return
    used = {s.element_hash() for e in expressions for s in ca.symvar(e)}
    problems = Problems()
    for known in reduced.flat.inputs:
        needed = max((k for k, s in enumerate(split(known.symbols)) if s.element_hash() in used), default=0)
        if needed > DERIVATIVES[known.source.interpolation]:
            times = ("", "once", "twice", "three times")[needed]
            problems.add("input-not-smooth", f"{known.name} must be differentiated {times} in time, which "
                         f"`interpolation: {known.source.interpolation}` does not allow", known.source.place,
                         hint="Write `interpolation: spline`.")
    problems.raise_as(ModelError)


def measured_rows(flat: Flat) -> int:
    """The number of rows of u for the measured inputs."""
    return 1 + 4 * len(flat.inputs) if flat.inputs else 0


def delay_coefficients(flat: Flat) -> list[int]:
    """The rows of u that hold the coefficients of the delayed variables."""
    begin = measured_rows(flat)
    return [begin + DELAY_ROWS * k + i for k in range(len(flat.delays)) for i in range(DELAY_ROWS - DELAY_TERMS, DELAY_ROWS)]


def substitute_inputs(expression: ca.SX, flat: Flat, t: ca.SX, u: ca.SX) -> ca.SX:
    """Measured inputs and their derivatives as the polynomial piece c0 + c1 s + c2 s**2 + c3 s**3, s = t - u[0].

    A delayed variable has the rows (v, t_0, r, c_0 ... c_7): it is (1 - v) h + sum(c_i s**i), s = r (t - t_0), with h its
    value before the start."""
    used = {s.element_hash() for s in ca.symvar(expression)} if flat.driving else set()
    present = [any(s.element_hash() in used for s in split(known.symbols)) for known in flat.driving]
    if not any(present):
        return expression
    symbols, pieces = [], []
    for k, known in enumerate(flat.inputs):
        if not present[k]:
            continue
        s = t - u[0]
        c0, c1, c2, c3 = (u[1 + 4 * k + i] for i in range(4))
        symbols.append(known.symbols)
        pieces += [c0 + s * (c1 + s * (c2 + s * c3)), c1 + s * (2 * c2 + s * 3 * c3), 2 * c2 + 6 * s * c3, 6 * c3]
    for k, delayed in enumerate(flat.delays):
        if not present[len(flat.inputs) + k]:
            continue
        rows = u[measured_rows(flat) + DELAY_ROWS * k:measured_rows(flat) + DELAY_ROWS * (k + 1)]
        s, scale, terms = rows[2] * (t - rows[1]), ca.SX(1), split(rows[DELAY_ROWS - DELAY_TERMS:])
        symbols.append(delayed.symbols)
        for order in range(delayed.symbols.numel()):
            # sum(terms[i] s**i)
            value = terms[-1]
            for term in reversed(terms[:-1]):
                value = term + s * value
            pieces.append(scale * value + ((1 - rows[0]) * flat.p[delayed.index] if order == 0 else 0))
            terms, scale = [i * c for i, c in enumerate(terms)][1:], scale * rows[2]
    return ca.substitute(expression, stack(symbols), stack(pieces))


@dataclass(frozen=True)
class Factors:
    """Factors in quadratures that may be other numbers in every run: symbols and their values (k,)."""

    symbols: ca.SX
    values: Array


@dataclass(frozen=True)
class Integrand:
    """What CasADi's integrators take, in scaled unknowns; `hoist` maps (p, directions) to the integrand's parameters.

    Terms that depend on parameters alone (the amplitudes of a sea's hundred sines) are computed once a run, common
    subexpressions (an elongation) once a step. With m directions, x and z hold the model's own unknowns first and then m
    blocks of their sensitivities. No step is longer than `longest` (s; 0 for no limit). A pivot of the Newton matrix below
    `smallest_pivot` is zero.
    """

    dae: dict[str, ca.SX]
    hoist: ca.Function
    longest: float = 0.0
    smallest_pivot: float = SMALLEST_PIVOT


def smallest_pivot(assembly: Assembly) -> float:
    """The size below which a pivot of the integrator's Newton matrix is zero: SMALLEST_PIVOT, or less where the gradients
    of a loop are tiny from the beginning, as the residuals of loops are not scaled, or where an unknown has a nominal size
    far below the usual one.

    The gradients are taken at equal pressures, where the regularised laws are steepest. A loop without a gradient at that
    point, such as an open contact, does not count.
    """
    rows = _row_sizes(assembly) * _row_scales(assembly)
    least_gradient = float(np.min(rows, where=np.isfinite(rows) & (rows > 0.0), initial=np.inf))
    smallest_share = float(np.min(assembly.z_nominal / assembly.z_usual, initial=1.0))
    return min(SMALLEST_PIVOT, LOST_GRADIENT * least_gradient) * smallest_share


def _row_scales(assembly: Assembly) -> Array:
    """Factors (n_z,) of the residuals of loops: powers of two that bring gradients far from 1 to it, else 1. A row is scaled
    only if its gradient is far from 1 both at zero unknowns and at unknowns of their nominal sizes (a temperature is never
    zero)."""
    rows = np.stack([_row_sizes(assembly, share) for share in (0.0, 1.0)])
    near = np.exp2(np.floor(np.log2(np.where(np.isfinite(rows) & (rows > 0.0), rows, 1.0))))
    steep, flat = near.min(axis=0), near.max(axis=0)
    return np.where(steep > FAR_GRADIENT, 1 / steep, np.where(flat < 1 / FAR_GRADIENT, 1 / flat, 1.0))


def _row_sizes(assembly: Assembly, share: float = 0.0) -> Array:
    """The largest gradient in each residual of a loop, per size of an unknown, with the unknowns at a given share of their
    sizes; 0 in large systems."""
    n_z = assembly.alg.numel()
    if not 0 < n_z < LARGE:
        return np.zeros(n_z)
    slopes = assembly.once("slopes of loops", lambda: ca.Function(
        "slopes", list(assembly.arguments), [ca.jacobian(assembly.alg, assembly.arguments[2])]))
    u = np.zeros(assembly.arguments[4].shape)
    gradients = slopes(assembly.begin, share * assembly.x_nominal, share * assembly.z_nominal, assembly.p, u, 1.0)
    return np.asarray(np.abs(np.array(gradients) * assembly.z_nominal).max(axis=1))


def from_begin(expressions: Sequence[ca.SX], time: ca.SX, begin: float | ca.SX) -> list[ca.SX]:
    """Expressions (columns) with the time counted from the begin of a run (s, a number or a symbol).

    A straight line a*time + b becomes a*time + (a*begin + b). If the begin is large, such as the time of a UNIX clock, the
    difference to another instant is then as exact as a short time, and steps are not rounded.
    """
    columns = list(expressions)
    sizes = [c.numel() for c in columns]
    together = ca.densify(stack(columns))
    if (not isinstance(begin, ca.SX) and not begin) or not together.numel():
        return columns
    driven = np.flatnonzero(ca.which_depends(together, time, 1, True)).tolist()
    if not driven:
        return columns
    whole = opened([together[driven]])
    if whole.calls:
        parts = from_begin([*whole.columns, whole.args], time, begin)
        together[driven] = whole.closed(parts[:1], parts[1])[0]
        return list(ca.vertsplit(together, [0, *np.cumsum(sizes).tolist()]))
    chosen, = ca.cse([together[driven]])
    symbols = ca.symvar(chosen)
    function = ca.Function("f", [stack(symbols)], [chosen])
    results = list[ca.SX]([ca.SX()] * len(driven))
    values, moves, lines = dict[int, ca.SX](), dict[int, bool](), dict[int, tuple[ca.SX, ca.SX] | None]()
    for k in range(function.n_instructions()):
        op, inputs, outputs = (function.instruction_id(k), function.instruction_input(k), function.instruction_output(k))
        if op == ca.OP_OUTPUT:
            results[outputs[1]] = values[inputs[0]]
            continue
        line: tuple[ca.SX, ca.SX] | None = None
        moving = False
        if op == ca.OP_INPUT:
            value = symbols[inputs[1]]
            if moving := value.element_hash() == time.element_hash():
                line = ca.SX(1), ca.SX(begin)
        elif op == ca.OP_CONST:
            value = ca.SX(function.instruction_constant(k))
        else:
            args = [values[i] for i in inputs]
            value, moving = operation(op, args), any(moves[i] for i in inputs)
            line = _line(op, args, [lines[i] if moves[i] else (ca.SX(0), values[i]) for i in inputs]) if moving else None
        if line is not None:
            value = line[0] * time + line[1]
        values[outputs[0]], moves[outputs[0]], lines[outputs[0]] = value, moving, line
    together[driven] = stack(results)
    return list(ca.vertsplit(together, [0, *np.cumsum(sizes).tolist()]))


def _line(op: int, args: Sequence[ca.SX], lines: Sequence[tuple[ca.SX, ca.SX] | None]) -> tuple[ca.SX, ca.SX] | None:
    """Slope and value at 0 of an operation on straight lines in time; None if the result is none."""
    if any(line is None for line in lines):
        return None
    (a, b), (c, d) = lines[0] or (args[0], args[0]), lines[-1] or (args[-1], args[-1])
    if op in (ca.OP_ADD, ca.OP_SUB):
        return (a + c, b + d) if op == ca.OP_ADD else (a - c, b - d)
    if op in (ca.OP_NEG, ca.OP_TWICE):
        return (-a, -b) if op == ca.OP_NEG else (2 * a, 2 * b)
    if op == ca.OP_MUL and (a.is_zero() or c.is_zero()):
        return (b * c, b * d) if a.is_zero() else (a * d, b * d)
    return (a / d, b / d) if op == ca.OP_DIV and c.is_zero() else None


def integrand(assembly: Assembly, quadratures: ca.SX | None = None, directions: int = 0, moving: Sequence[int] = (),
              begin: float = 0.0) -> Integrand:
    """The DAE for `ca.integrator`: x = x_origin + x_nominal * x_s, z = z_nominal * z_s; quadratures unscaled.

    `directions` adds that many forward sensitivities: with dp (n_p, directions) the directions in parameter space, zero but
    for the parameters `moving` (by their indices), X = dx_s/dp and Z = dz_s/dp satisfy X' = f_x X + f_z Z + f_p dp,
    0 = g_x X + g_z Z + g_p dp. Written out in SX and integrated with the model, this is cheaper than the integrator's own
    forward mode and under the same error control. The time of the DAE is counted from `begin`.
    """
    t, x, z, p, u, rate = assembly.arguments
    x_s, z_s = ca.SX.sym("x", x.numel()), ca.SX.sym("z", z.numel())
    x_nominal, z_nominal = ca.SX(ca.DM(assembly.x_nominal)), ca.SX(ca.DM(assembly.z_nominal))
    x_origin = ca.SX(ca.sparsify(ca.DM(assembly.x_origin)))
    scales = _row_scales(assembly)
    alg = assembly.alg if np.all(scales == 1.0) else ca.SX(ca.DM(scales)) * assembly.alg
    right = from_begin([assembly.ode / x_nominal, alg, *([quadratures] if quadratures is not None else [])],
                       t, begin)
    replaced = ca.substitute(right, [x, z, rate], [x_origin + x_s * x_nominal, z_s * z_nominal, ca.SX(1)])
    rows = list(moving) if directions else []
    dp, whole = ca.SX.sym("dp", len(rows), directions), ca.SX.sym("dp", p.numel(), directions)
    coefficients = delay_coefficients(assembly.flat) if directions else []
    du = ca.SX.sym("du", len(coefficients), directions)
    x_s, z_s, replaced = _augmented(x_s, z_s, p[rows], dp, replaced, u[coefficients], du)
    sizes = [r.numel() for r in replaced]
    stacked, = ca.cse([stack(replaced)])
    parameters, parametric = stack([p, ca.vec(dp)]), ca.SX(0, 1)
    constants = parameters
    if p.numel():
        stacked, symbols, expressions = ca.extract_parametric(stacked, parameters)
        constants, parametric = stack([parameters, *symbols]), stack(expressions)
    hoisted, = ca.substitute([stack([parameters, parametric])], [ca.vec(dp)], [ca.vec(whole[rows, :])])
    hoist = ca.Function("hoist", [p, whole], [hoisted])
    parts = ca.vertsplit(stacked, [0, *np.cumsum(sizes).tolist()])
    if not x_s.numel():  # an integrator needs a state: one that stays zero
        x_s, parts[0] = ca.SX.sym("x"), ca.SX(1, 1)
    dae = {"x": x_s, "z": z_s, "p": constants, "u": stack([u, ca.vec(du)]) if coefficients else u, "t": t, "ode": parts[0],
           "alg": parts[1]}
    if quadratures is not None:
        dae["quad"] = parts[2]
    return Integrand(dae, hoist, smallest_pivot=smallest_pivot(assembly))


def _augmented(x: ca.SX, z: ca.SX, p: ca.SX, dp: ca.SX, right: list[ca.SX], u: ca.SX, du: ca.SX
               ) -> tuple[ca.SX, ca.SX, list[ca.SX]]:
    """x, z and the right sides (ode, alg, quadratures) with forward sensitivities along each column of dp (directions of
    some parameters p) and du (directions of some inputs u)."""
    columns = dp.shape[1]
    if not columns:
        return x, z, right
    x_along, z_along = ca.SX.sym("X", x.numel(), columns), ca.SX.sym("Z", z.numel(), columns)
    # one Jacobian serves all columns, so that each partial derivative is written once
    derivatives = ca.jacobian(stack(right), stack([x, z, p, u])) @ ca.vertcat(x_along, z_along, dp, du)
    ends = np.cumsum([0, *(side.numel() for side in right)]).tolist()
    both = [stack([side, ca.vec(derivatives[begin:end, :])]) for side, begin, end in zip(right, ends[:-1], ends[1:],
                                                                                         strict=True)]
    return stack([x, ca.vec(x_along)]), stack([z, ca.vec(z_along)]), both


def summed(original: Integrand, factors: Factors | None) -> Integrand:
    """Append the quadratures to the states: IDAS excludes quadratures from its choice of order, so that a run whose states
    are straight lines would integrate its quadratures by first-order steps."""
    dae = dict(original.dae)
    if "quad" not in dae:
        return original
    if factors is not None:
        dae["u"] = stack([dae["u"], factors.symbols])
    rates = dae.pop("quad")
    dae["x"], dae["ode"] = stack([dae["x"], ca.SX.sym("integral", rates.numel())]), stack([dae["ode"], rates])
    return replace(original, dae=dae)


def newton_loops(loops_dae: Integrand) -> ca.Function | None:
    """Newton's method for the algebraic unknowns, given (t, x, p, u); None if there are none."""
    dae = loops_dae.dae
    if not dae["z"].numel():
        return None
    return solved_loops(dae["z"], stack([dae["t"], dae["x"], dae["p"], dae["u"]]), dae["alg"], MOST_NEWTON,
                        loops_dae.smallest_pivot)


def solved_loops(z: ca.SX, arguments: ca.SX, residuals: ca.SX, most: int, pivot: float = SMALLEST_PIVOT) -> ca.Function:
    """(z, given) to the z near by with residuals (n_z,) = 0, by at most so many steps of Newton's method; smaller pivots of
    its matrix are zero.

    CasADi's method leaves out the last step, one of less than 1e-12: it is taken here, because an acceleration of 1e-12
    times a very large mass is a considerable force.
    """
    newton = ca.rootfinder("newton", "newton", {"x": z, "p": arguments, "g": residuals},
                           {"error_on_fail": False, "abstol": 1e-14, "max_iter": most,
                            "linear_solver_options": {"eps": pivot}})
    linear = ca.Function("linear", [z, arguments], [residuals, ca.jacobian(residuals, z)])
    first, fixed = ca.MX.sym("z", z.numel()), ca.MX.sym("given", arguments.numel())
    near = newton(first, fixed)
    residual, slopes = linear(near, fixed)
    return ca.Function("loops", [first, fixed], [near - ca.solve(slopes, residual, "qr", {"eps": pivot})])
