"""Dormant parameters of the library act unlike any other parameter of their component.

An effect whose derivative at its neutral value is in constant proportion to that of another parameter (a polytropic exponent
without a temperature, beside the volume) can never be told from another value of that parameter.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from collected import for_each

from heavebond.language.definition import Component
from heavebond.language.library import library
from heavebond.language.symbols import Context, evaluate, stack
from heavebond.text.expression import Name, names

LIBRARY = library()
# those that a block hands on to a part of it are that part's
DORMANT = [(name, p.name) for name in LIBRARY.names() for p in LIBRARY.component(name).parameters.values()
           if p.neutral is not None and any(n.text == p.name for line in LIBRARY.component(name).equations
                                            for side in (line.tree.left, line.tree.right) for n in names(side))]
POINTS = 100  # a valve is closed or wide open at most of them
KELVIN = 300.0  # laws of oil and gas hold at such temperatures; all other numbers are of the order of 1
# the wall of one segment without air yields as oil of a lower bulk modulus does: that of all oil is another value of beta
ALIKE = {("LineSegment", "expansion"): ["beta"]}
BESIDE, ABSENT = 1e-6, 1e-4  # all numbers are of the order of 1 here
SMALL = 1e-9  # of the largest derivative at a point: rounding


def derivatives(component: Component, dormant: str) -> dict[str, np.ndarray]:
    """d residual / d parameter (equations, points) of each parameter, at random values of all variables and the same values
    of the parameters, with what the equations give explicitly put in; the dormant parameter is a hair beside its neutral
    value, where it may have a kink."""
    symbols: dict[str, ca.SX] = {}
    rates: dict[str, ca.SX] = {}

    def symbol(text: str, _: Name | None = None) -> ca.SX:
        return symbols.setdefault(text, ca.SX.sym(text))

    def rate(of: ca.SX) -> ca.SX:
        return rates.setdefault(str(of), ca.SX.sym(f"der({of})"))

    context = Context(symbol, rate, {p.name: 2 for p in component.parameters.values() if p.integer})
    explicit, rest = {}, []
    for line in component.equations:
        left, right = line.tree.left, line.tree.right
        # what a block calculates acts in its parts
        explicitly = not component.body.instances and isinstance(left, Name) \
            and str(evaluate(left, context)) in component.variables
        if explicitly and not ca.depends_on(evaluate(right, context), evaluate(left, context)) \
                and str(evaluate(left, context)) not in explicit:
            explicit[str(evaluate(left, context))] = evaluate(right, context)
        else:
            rest.append(evaluate(left, context) - evaluate(right, context))
    residual = stack(rest)
    for _ in explicit:
        residual = ca.substitute([residual], [symbols[n] for n in explicit], list(explicit.values()))[0]
    own = [p for p in component.parameters if p in symbols and not component.parameters[p].integer]
    J = ca.jacobian(residual, stack(symbols[p] for p in own))
    unknown = [*symbols.values(), *rates.values()]
    function = ca.Function("J", [stack(unknown)], [J])
    random, found = np.random.default_rng(3), []
    neutral = component.parameters[dormant].neutral or 0.0
    high = component.parameters[dormant].high
    beside = neutral + BESIDE * (1 if high is None or high > neutral else -1)
    held = {p.name: random.uniform(0.5, 2.0) * (KELVIN if p.unit.text == "K" else 1) if p.neutral is None else p.neutral
            for p in component.parameters.values()}
    for _ in range(POINTS):
        point = {str(s): random.uniform(0.5, 2.0) * (KELVIN if str(s).endswith(".T") else 1) for s in unknown} | held
        found.append(np.asarray(function([beside if str(s) == dormant else point[str(s)] for s in unknown])))
    block = np.stack(found, axis=-1)
    return {p: block[:, k] for k, p in enumerate(own)}


def same_as(component: Component, dormant: str) -> list[str]:
    """The parameters of which a dormant one is another value."""
    moved = derivatives(component, dormant)
    finite = np.isfinite(moved[dormant]).all(axis=0)
    assert np.count_nonzero(finite) > 0.9*POINTS  # the others are states of oil that do not exist
    acts = finite & np.any(moved[dormant] != 0, axis=0)
    assert np.count_nonzero(acts) > 2
    # each point counts alike: one of an exponential law would decide alone otherwise
    size = np.abs(moved[dormant][:, acts]).max(axis=0)
    own = (moved[dormant][:, acts]/size).ravel()
    found = []
    for other, column in moved.items():
        theirs = (column[:, acts]/size).ravel()
        # one that shapes the dormant law alone does nothing while that is absent
        if other != dormant and np.all(np.isfinite(theirs)) and np.abs(theirs).max() > ABSENT:
            ratio = float(own @ theirs) / float(theirs @ theirs)
            if np.abs(own - ratio * theirs).max() <= SMALL:
                found.append(other)
    return found


@pytest.mark.long
@for_each(("name", "dormant"), DORMANT)
def test_a_dormant_parameter_is_no_other_value_of_another_one(name: str, dormant: str) -> None:
    assert same_as(LIBRARY.component(name), dormant) == ALIKE.get((name, dormant), [])


def test_an_exponent_without_a_temperature_acts_as_the_volume() -> None:
    """The balance of a receiver alone, V/(n R T) dp/dt = m: n there is another value of V and of R."""
    receiver = LIBRARY.component("Receiver")
    isothermal = replace(receiver, equations=tuple(line for line in receiver.equations if "der" in line.text))
    assert set(same_as(isothermal, "n")) == {"V", "R"}
