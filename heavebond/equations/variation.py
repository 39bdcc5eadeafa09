"""Parameters that vary during a run: the factors under `vary:` of a diagram, and the equations in which they occur.

The equations of a part contain the parameter times its factor, a formula of variables and the time. In all other formulas
the parameter is the constant, so that it can be fitted, set and tuned like any other.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import casadi as ca

from heavebond.core.errors import Place, Problems, listing, suggest
from heavebond.core.units import DIMENSIONLESS
from heavebond.equations.expanded import Leaf
from heavebond.equations.resolver import Resolver
from heavebond.language.definition import Component, Value
from heavebond.language.incidence import Interval, classify
from heavebond.language.model import Model
from heavebond.language.symbols import split, stack
from heavebond.language.template import Template
from heavebond.language.values import add_formula_problem, check_dimension
from heavebond.text.expression import Call, Expr, ExpressionProblem, children, names


@dataclass(frozen=True)
class Factor:
    """The factor of a varying parameter and the numbers of the unknowns in it."""

    expression: ca.SX
    unknowns: tuple[int, ...]


def factors(model: Model, leaves: Mapping[str, Leaf], templates: Mapping[str, Template], resolver: Resolver,
            problems: Problems) -> dict[str, Factor]:
    """The factors of a diagram by the full names of their parameters; problems are added to `problems`."""
    factors_by_name = {}
    for path, setting in model.vary.items():
        owner, _, name = path.rpartition(".")
        value = setting.value
        if not isinstance(value, Value) or not _may_vary(path, leaves, templates, setting.place, problems):
            continue
        reason = fixed_because(leaves[owner].component, name)
        if reason:
            problems.add("vary-fixed", f"{path} cannot vary: {reason}", setting.place,
                         hint="Vary another parameter of this part, or write a component whose law has the variation.")
            continue
        try:
            check_dimension(f"the factor of {path}", value, resolver.dimension(value.expr), DIMENSIONLESS, problems)
            expression = resolver.evaluate(value.expr)
        except ExpressionProblem as problem:
            add_formula_problem(problem, value, problems)
            continue
        symbols = {s.element_hash() for s in ca.symvar(expression)}
        if symbols & {s.element_hash() for column in resolver.columns[1:] for s in split(column)}:
            problems.add("vary-rate", f"the factor of {path} contains a derivative", value.place,
                         hint="Use a velocity, a flow or a separate variable.")
            continue
        column = split(resolver.columns[0])
        factors_by_name[path] = Factor(expression, tuple(k for k, s in enumerate(column) if s.element_hash() in symbols))
    return factors_by_name


def _may_vary(path: str, leaves: Mapping[str, Leaf], templates: Mapping[str, Template], place: Place, problems: Problems
              ) -> bool:
    """Whether it is a parameter in the equations of a part."""
    owner, _, name = path.rpartition(".")
    if owner in leaves and owner in templates and name in templates[owner].parameters:
        return True
    known = [f"{leaf}.{p}" for leaf in leaves if leaf in templates for p in templates[leaf].parameters]
    parameters = [p for p in known if p.rpartition(".")[0] == owner]
    inside = sorted({p for p in known if p.startswith(f"{owner}.") and p not in parameters}) if owner else []
    problems.add("vary-unknown", f"'{path}' is not a parameter of a part, so it cannot vary", place,
                 hint=suggest(path, known) or (f"Parameters: {listing(parameters, 20)}." if parameters else
                 f"'{owner}' is a block; vary parameters of its parts: {listing(inside, 20)}." if inside else
                 "Write the name of a part and its parameter, for example `spring.c`."))
    return False


def fixed_because(component: Component, name: str) -> str:
    """The reason why a parameter of a component cannot vary; empty if it can."""
    parameter = component.parameters.get(name.partition("[")[0]) or component.parameters.get(name)
    if parameter is not None and parameter.integer:
        return "it is a whole number"
    if any(_differentiated(side, name) for line in component.equations for side in (line.tree.left, line.tree.right)):
        return f"an equation of {component.name} differentiates an expression that contains it"
    return ""


def _differentiated(expr: Expr, name: str) -> bool:
    if isinstance(expr, Call) and expr.function == "der":
        return any(n.text == name for n in names(expr))
    return any(_differentiated(child, name) for child in children(expr))


def incidence(residuals: ca.SX, columns: tuple[ca.SX, ...], unknowns: list[int], constants: set[int],
              bounds: Mapping[int, Interval]) -> Iterator[list[tuple[int, int]]]:
    """The entries (column, kind) of each residual with a varying parameter, column = level * n + unknown."""
    n = columns[0].numel()
    occurring = stack([s for column in columns for s in split(column[unknowns])])
    for row in classify(residuals, occurring, constants, bounds):
        yield [(e.column // len(unknowns) * n + unknowns[e.column % len(unknowns)], e.kind) for e in row]
