"""Search for the term that violates the power balance of a component: a wrong sign, or undeclared energy.

The third law (see `power_law`), sum of the powers in = d(stores)/dt + dissipates + unbalanced, fails on random motions.
If it holds on all of them after the sign of one term, or of the power at some ports, is changed, this term is the cause.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import combinations

import numpy as np

from heavebond.core.errors import Place, Problem, either
from heavebond.language.definition import Body, Component, Domain, EquationLine
from heavebond.language.library import Library, is_bundled
from heavebond.language.power_law import TOLERANCE, Array, check_power, powers, wrong_rates
from heavebond.text.expression import Expr, Name, names

MOST_PORTS = 5  # components with up to this number of ports are tried in all combinations, others port by port
EXEMPT = "A component declares its energy by `stores:` and `dissipates:`; a source is exempt by `power: source`."


CREATED, UNDECLARED, UNTRIED = "power-created", "power-undeclared", "power-untried"


def used(library: Library, bodies: Iterable[Body]) -> list[Component]:
    """The user-defined components in diagrams and blocks, each once; the bundled ones are checked by tests."""
    components_used: dict[str, Component] = {}
    waiting = list(bodies)
    while waiting:
        for instance in waiting.pop().instances.values():
            if instance.kind not in components_used:
                components_used[instance.kind] = component = library.component(instance.kind, instance.kind_place)
                waiting.append(component.body)
    return [component for component in components_used.values() if not is_bundled(component.path)]


def power_problems(components: Iterable[Component], domains: Mapping[str, Domain]) -> Iterator[Problem]:
    """Power problems of components, each reported once; nothing if the law holds."""
    for component in components:
        for relation, key in wrong_rates(component, domains):
            formula, whole = getattr(relation, key), "turn" if key == "spin" else "shift"
            yield Problem("frames-rate", f"`{key}: {formula.text}` of {component.name} is not the rate of its `{whole}:`",
                          formula.place, f"Correct it, or leave it out: then `{key}:` is the derivative of `{whole}:`.")
        report = check_power(component, domains)
        if not report.holds:
            yield power_problem(component, domains) if report.tried else Problem(
                UNTRIED, f"the power of {component.name} was not checked: too few motions satisfy its equations "
                "within the bounds of its variables", component.place, EXEMPT)


def power_problem(component: Component, domains: Mapping[str, Domain]) -> Problem:
    """The term by which a component creates power, with its line."""
    ports, rows = powers(component, domains)
    power, stored, dissipated, unbalanced, least = rows[:, :5].T
    sizes = np.abs(np.column_stack([rows[:, 5:], stored, dissipated, unbalanced])).max(axis=1) + least
    sizes = np.where(sizes > 0, sizes, 1.0)

    def negligible(values: Array) -> bool:
        return bool((np.abs(values) <= TOLERANCE * sizes).all())

    if negligible(power - stored - dissipated - unbalanced):
        formula = component.dissipates
        assert formula is not None
        always = bool((dissipated / sizes <= TOLERANCE).all())
        laws = [line for line in component.equations if _names(line.tree.left) | _names(line.tree.right) <= (
            set(component.variables) | set(component.parameters)) and _names(formula.tree) & _names(line.tree.left)]
        line = laws[0] if laws else None
        message = (f"{component.name} creates power: `dissipates: {formula.text}` is negative"
                   f"{'' if always else ' in some of the motions that its equations allow'}")
        message += f", so the force law `{line.text}` has the wrong sign" if line and always else ""
        return _problem(message, line.place if line else formula.place, _with_lines(laws[1:]))
    if not (component.stores or component.dissipates or component.unbalanced):
        lines = _lines_of(component, domains, ports)
        takes = bool((power / sizes >= -TOLERANCE).all())
        problem = Problem(UNDECLARED, f"{component.name} {'takes in' if takes else 'gives'} power and does not declare its "
                          f"{'storage or dissipation' if takes else 'source'}",
                          lines[0].place if lines else component.place,
                          "Write `dissipates:` or `stores:` with the formula, then a wrong sign is found." if takes else
                          "If it should not, reverse the sign of its force law. If it may, write `power: source`, or "
                          "`stores:` or `dissipates:` with the formula.")
        return replace(problem, notes=tuple(_with_lines(lines[1:])))
    positive = bool((dissipated >= -TOLERANCE * sizes).all())
    for chosen in _choices(len(ports)) if positive else ():
        signs = np.ones(len(ports))
        signs[list(chosen)] = -1
        if negligible(rows[:, 5:] @ signs - stored - dissipated - unbalanced):
            return _turned(component, domains, [ports[k] for k in chosen], len(chosen) == len(ports))
    for formula, remainder, key in ((component.dissipates, power - stored + dissipated, "dissipates"),
                                    (component.stores, power + stored - dissipated, "stores")):
        if formula is not None and negligible(remainder - unbalanced):
            return _problem(f"`{key}: {formula.text}` of {component.name} has the wrong sign: with the other its power "
                            "balances", formula.place, ())
    lines = _lines_of(component, domains, ports)
    share = float((np.abs(power - stored - dissipated - unbalanced) / sizes).max())
    declared = [(key, getattr(component, key)) for key in ("stores", "dissipates")]
    return _problem(f"{component.name} creates or loses power: up to {100 * share:.2g} % of the power through it is "
                    "neither stored, dissipated nor declared as unbalanced", lines[0].place if lines else component.place,
                    [*_with_lines(lines[1:]), *(f"line {f.place.line}: {key}: {f.text}" if f else f"it has no `{key}:`"
                                          for key, f in declared)])


def _choices(number: int) -> Iterator[tuple[int, ...]]:
    """Sets of ports whose power is reversed, small sets first."""
    for size in range(1, number + 1 if number <= MOST_PORTS else 2):
        yield from combinations(range(number), size)


def _turned(component: Component, domains: Mapping[str, Domain], ports: list[str], every: bool) -> Problem:
    lines = _lines_of(component, domains, ports)
    where = f"{'port' if len(ports) == 1 else 'ports'} {either(ports)}"
    message = f"{component.name} creates power: the sign at {where} is wrong"
    message += " (or the sign of `stores:` and `dissipates:`)" if every else ""
    if len(lines) == 1:
        message += f": `{lines[0].text}`"
    through = {m for port in ports
               if (declared := component.ports.get(port.partition("[")[0])) and declared.domain in domains
               for m in domains[declared.domain].through}
    through_text = either(sorted(through) or ["flow"])
    rule = f"{through_text} {'count' if len(through) > 1 else 'counts'} into the component at every port"
    return _problem(message, lines[0].place if lines else component.place,
                    [*_with_lines(lines[1:]), f"The sign rule: {rule}."])


def _problem(message: str, place: Place | None, notes: Iterable[str]) -> Problem:
    return replace(Problem(CREATED, message, place, EXEMPT), notes=tuple(notes))


def _lines_of(component: Component, domains: Mapping[str, Domain], ports: Iterable[str]) -> list[EquationLine]:
    """The equations that set the through variables of ports; equations with a through variable alone on one side first."""
    wanted = {port.partition("[")[0] for port in ports}
    shared = {member for domain in domains.values() for member in domain.shared}
    matching_lines = [line for line in component.equations
                      if any(name.partition("[")[0].partition(".")[0] in wanted for side in (line.tree.left, line.tree.right)
                             if isinstance(side, Name) for name in [side.text])
             and not any(name.rpartition(".")[2] in shared for name in _names(line.tree.left) | _names(line.tree.right))]
    return matching_lines or [line for line in component.equations if any(
        name.partition("[")[0].partition(".")[0] in wanted for name in _names(line.tree.left) | _names(line.tree.right))]



def _names(expr: Expr) -> set[str]:
    return {name.text for name in names(expr)}


def _with_lines(lines: Iterable[EquationLine]) -> list[str]:
    return [f"line {line.place.line}: {line.text}" for line in lines]
