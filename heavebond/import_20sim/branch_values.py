"""Variables that branches assign and that are read only if a branch has assigned them, so that their former value is not
needed.

In `code`, a variable that no branch assigns keeps its value, which needs events. A value that is computed only for use in
the same branch, as `r` in `if x > 0 then r = x / a; y = r^2; else y = 0; end`, is a plain equation.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping

from heavebond.import_20sim import formula_text as f
from heavebond.import_20sim.choices import decided, former, keeps, names, rebuilt, simplified, triggers
from heavebond.import_20sim.sidops_tree import Expr

Guards = tuple[tuple[Expr, bool], ...]
# functions without a value for some arguments
PARTIAL = {"sqrt", "log", "ln", "log10", "asin", "acos", "tan", "arcsin", "arccos"}
LARGEST = 20_000  # limit of the nodes of all values: the analysis of larger ones takes too long
SHORT = 3  # nodes of an expression below which a variable is not worthwhile


def without_memory(values: Mapping[str, Expr], candidates: Collection[str], constants: Collection[str]) -> dict[str, Expr]:
    """The values of variables after `code`. Variables of `candidates` whose former value is not needed become plain
    values and are used by name in the others; `constants` are the names of parameters, which are permitted divisors. A
    value that cannot be computed without its condition, such as a root, is 0 while no branch assigns it."""
    reduced_values = dict(values)
    if sum(value.size for value in reduced_values.values()) > LARGEST:
        return reduced_values
    uses: dict[str, list[tuple[Guards, Expr]]] = {}
    for name in candidates:
        value = reduced_values[name]
        if not keeps(value, name) or set(former(value)) != {name} or triggers(value):
            continue
        whole = simplified(_assigned_only(value, name))
        always = defined_everywhere(whole, constants)
        other_values = [v for n, v in values.items() if n != name]
        if not all(_known(value, name, guards) and (always or not former(v))
                   for v in other_values for guards in _reads(v, name, ())):
            continue
        reduced_values[name] = whole if always else simplified(_begun(value, name))
        uses[name] = [((), whole)] if always else list(_leaves(value, name, ()))
    for name, leaves in uses.items():
        for guards, leaf in leaves:
            for dependent, value in reduced_values.items():
                # kept values are evaluated when their branch has ended, and then a value by branches is 0
                if dependent != name and leaf.size >= SHORT and not keeps(leaf, dependent) and \
                        (not guards or not former(value)) and not _depends(reduced_values, name, dependent):
                    reduced_values[dependent] = _by_name(value, leaf, f.name(name), guards, ())
    return reduced_values


def _depends(values: Mapping[str, Expr], name: str, dependent: str) -> bool:
    """True if the value of a variable depends on another one, which must not depend on it then."""
    visited, front = set[str](), [name]
    while front:
        reached_name = front.pop()
        if reached_name not in visited and reached_name in values:
            visited.add(reached_name)
            front += names(values[reached_name])
    return dependent in visited


def _reads(expr: Expr, name: str, guards: Guards) -> Iterator[Guards]:
    """The conditions under which an expression reads a variable."""
    if expr.op in ("name", "prev") and expr.name == name:
        yield guards
    for inner, inner_guards in _inner(expr, guards):
        yield from _reads(inner, name, inner_guards)


def _inner(expr: Expr, guards: Guards) -> Iterator[tuple[Expr, Guards]]:
    """The arguments of an expression, with the conditions under which they are evaluated."""
    if expr.op != "if":
        yield from ((e, guards) for e in expr.args)
        return
    condition, then, otherwise = expr.args
    yield condition, guards
    yield then, (*guards, (condition, True))
    yield otherwise, (*guards, (condition, False))


def _known(value: Expr, name: str, guards: Guards) -> bool:
    """True if a branch has assigned a variable under these conditions."""
    for condition, holds in guards:
        value = decided(value, condition, holds)
    return not keeps(value, name)


def _assigned_only(value: Expr, name: str) -> Expr:
    """A nested choice without the branches that keep the value."""
    if value.op != "if":
        return value
    condition, *branches = value.args
    remaining = [_assigned_only(b, name) for b in branches]
    keeping = [keeps(b, name) for b in remaining]
    if any(keeping):
        return remaining[0] if keeping[1] else remaining[1]
    return remaining[0] if remaining[0] == remaining[1] else Expr("if", (condition, *remaining), line=value.line)


def _begun(value: Expr, name: str) -> Expr:
    """A value that is 0 if no branch assigns it."""
    if value.op == "prev" and value.name == name:
        return f.number(0)
    return rebuilt(value, lambda e: _begun(e, name)) if value.args else value


def _leaves(value: Expr, name: str, guards: Guards) -> Iterator[tuple[Guards, Expr]]:
    """The largest parts of a nested choice that do not need the former value, with their conditions."""
    if not keeps(value, name):
        yield guards, value
    elif value.op == "if":
        for inner, inner_guards in list(_inner(value, guards))[1:]:
            yield from _leaves(inner, name, inner_guards)


def defined_everywhere(expr: Expr, constants: Collection[str]) -> bool:
    """True if an expression has a value for all values of its arguments."""
    if expr.op == "call" and expr.name in PARTIAL:
        return False
    if expr.op == "/" and not _constant(expr.args[1], constants):
        return False
    if expr.op == "^" and not (expr.args[1].op == "number" and expr.args[1].value >= 0 and expr.args[1].value.is_integer()):
        return False
    return all(defined_everywhere(e, constants) for e in expr.args)


def _constant(expr: Expr, constants: Collection[str]) -> bool:
    return expr.op not in ("prev", "event") and (expr.op != "name" or expr.name in constants or expr.name == "pi") and \
        all(_constant(e, constants) for e in expr.args)


def _by_name(expr: Expr, old: Expr, new: Expr, needed: Guards, guards: Guards) -> Expr:
    """An expression with a variable in place of its value, under the conditions of that value."""
    if expr == old and set(needed) <= set(guards):
        return new
    if expr.size <= old.size:
        return expr
    inner = [_by_name(e, old, new, needed, inner_guards) for e, inner_guards in _inner(expr, guards)]
    return Expr(expr.op, tuple(inner), expr.name, expr.value, expr.line, expr.columns)

