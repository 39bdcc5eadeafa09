"""The base model of a case as equations in text, for programs other than heavebond.

The equations are those that heavebond simulates, after index reduction: x' = f(t, x, z, p, u, w), 0 = g(t, x, z, p, u, w),
y = h(t, x, z, p, u, w), in SI. The inputs w are the through variables at all places of the diagram; they are zero in the
base model, and a missing law of the machine is a value of one of them. Algebraic variables z that enter their equations
linearly are solved for, so that most models are explicit.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from heavebond.equations.flatten import flatten
from heavebond.equations.places import Place, nodes_of, places_of, with_virtual_sources
from heavebond.equations.reduce import reduce_flattened
from heavebond.estimation.experiment import Experiment, Record
from heavebond.language.symbols import split, stack
from heavebond.numerics.dae import Assembly, assemble, build, measured_rows
from heavebond.numerics.initialise import start
from heavebond.numerics.inputs import pieced
from heavebond.text.expression import names

BINARY = {ca.OP_ADD: "({0} + {1})", ca.OP_SUB: "({0} - {1})", ca.OP_MUL: "{0}*{1}", ca.OP_DIV: "({0}/{1})",
          ca.OP_POW: "({0})**({1})", ca.OP_CONSTPOW: "({0})**({1})", ca.OP_FMIN: "min({0}, {1})",
          ca.OP_FMAX: "max({0}, {1})", ca.OP_ATAN2: "atan2({0}, {1})", ca.OP_LT: "({0} < {1})", ca.OP_LE: "({0} <= {1})",
          ca.OP_EQ: "({0} == {1})", ca.OP_NE: "({0} != {1})", ca.OP_AND: "both({0}, {1})", ca.OP_OR: "either({0}, {1})",
          ca.OP_IF_ELSE_ZERO: "where({0}, {1}, 0)", ca.OP_HYPOT: "hypot({0}, {1})", ca.OP_COPYSIGN: "copysign({0}, {1})"}
UNARY = {ca.OP_NEG: "(-{0})", ca.OP_SQ: "({0})**2", ca.OP_TWICE: "2*{0}", ca.OP_INV: "(1/{0})", ca.OP_NOT: "(1 - {0})",
         ca.OP_ASSIGN: "{0}", **{getattr(ca, f"OP_{op}"): f"{name}({{0}})" for op, name in (
             ("SQRT", "sqrt"), ("EXP", "exp"), ("LOG", "log"), ("SIN", "sin"), ("COS", "cos"), ("TAN", "tan"),
             ("ASIN", "asin"), ("ACOS", "acos"), ("ATAN", "atan"), ("SINH", "sinh"), ("COSH", "cosh"), ("TANH", "tanh"),
             ("FABS", "abs"), ("SIGN", "sign"), ("LOG1P", "log1p"), ("EXPM1", "expm1"), ("FLOOR", "floor"))}}


@dataclass(frozen=True)
class Written:
    """Expressions as text: intermediate values, each with a name, and the expressions by their keys."""

    intermediate: dict[str, str]
    expressions: dict[str, str]


def written(arguments: Sequence[tuple[str, ca.SX]], expressions: dict[str, ca.SX]) -> Written:
    """Expressions of named scalar symbols as text. Values that are used more than once become intermediate values."""
    function = ca.Function("f", [stack(symbol for _, symbol in arguments)], ca.cse([
        ca.densify(stack(expressions.values()))]))
    operands: list[tuple[int, tuple[int, ...], str]] = []  # operation, the values that it uses, text of an atom
    at: dict[int, int] = {}  # the value in each place of the work vector
    results: dict[int, int] = {}
    for k in range(function.n_instructions()):
        operation, read, write = function.instruction_id(k), function.instruction_input(k), function.instruction_output(k)
        if operation == ca.OP_OUTPUT:
            results[write[1]] = at[read[0]]
            continue
        text = arguments[read[1]][0] if operation == ca.OP_INPUT else f"{function.instruction_constant(k):.17g}" \
            if operation == ca.OP_CONST else ""
        operands.append((operation, () if text else tuple(at[i] for i in read), text))
        at[write[0]] = len(operands) - 1
    uses = Counter(i for _, used, _ in operands for i in used)
    texts, intermediate = list[str](), dict[str, str]()
    for k, (operation, used, atom) in enumerate(operands):
        form = UNARY.get(operation) or BINARY.get(operation) or ""
        parts = [texts[i] for i in used[:form.count("{")]]
        if operation in (ca.OP_DIV, ca.OP_INV) and "*" in parts[-1]:
            parts[-1] = f"({parts[-1]})"  # a product below the line
        text = atom if used == () else form.format(*parts)
        if used and not form:
            raise ValueError(f"operation {operation} has no text")
        if text.startswith("-") and not used:
            text = f"({text})"
        if used and uses[k] > 1:
            name = f"v{len(intermediate) + 1}"
            intermediate[name], text = text, name
        texts.append(text)
    return Written(intermediate, {key: texts[results[i]] if i in results else "0" for i, key in enumerate(expressions)})


def base_model(experiment: Experiment, record: Record) -> dict[str, Any]:
    """The base model of an experiment for JSON: see the page on the format (README.md). `record` gives the start."""
    model = experiment.model_for(record)
    wanted = {n.text for o in experiment.outputs.values() for n in names(o.shown.expr)}
    flat = flatten(model, wanted)
    nodes, places = nodes_of(flat), places_of(flat, nodes_of(flat))
    assembly = build(reduce_flattened(lambda corners: with_virtual_sources(
        flatten(model, wanted, corners=corners), nodes, Path("virtual.csv"))))
    found, symbols = assembly.flat.names, assembly.flat.levels[0]
    signals = {name: assembly.express(symbols[found[name]]) for node in nodes.values()
               for member in (node.across, node.domain.position)
               if member and (name := f"{node.name}.{member}") in found}
    outputs = {name: assembly.expression(o.shown.expr) for name, o in experiment.outputs.items()}
    arguments, sides = _explicit(assembly, [assembly.ode, assembly.alg, stack(outputs.values()), stack(signals.values())])
    keys = [[f"der({name})" for name in assembly.state_names], [f"residual_{k + 1}" for k in range(sides[1].numel())],
            [f"output {name}" for name in outputs], [f"signal {name}" for name in signals]]
    texts = written(arguments, {key: value for group, side in zip(keys, sides, strict=True)
                                for key, value in zip(group, split(side), strict=True)})

    def of(prefix: str) -> dict[str, str]:
        return {key.removeprefix(prefix): text for key, text in texts.expressions.items() if key.startswith(prefix)}

    base = assemble(model, wanted)  # with its recorded inputs only
    first = start(base, None, pieced(base.flat, base.begin, base.begin + 1e-6).at(np.array([base.begin]))[:, 0])
    free = experiment.free
    used = {name for name, symbol in arguments if any(ca.depends_on(side, symbol) for side in sides)}
    return {
        "states": [{"name": name, "unit": assembly.flat.unknowns[j].unit.text, "start": float(value)}
                   for name, (j, _), value in zip(assembly.state_names, assembly.reduced.states, first.x, strict=True)],
        "algebraic": [name for name, _ in arguments if name.startswith("algebraic.")],
        "parameters": {name: {"value": float(value), **({"low": free[name].range.low, "high": free[name].range.high}
                                                        if name in free else {})}
                       for name, value in zip(assembly.parameter_names, first.p, strict=True)
                       if name in used or name in free},
        "inputs": [known.name for known in assembly.flat.inputs if not known.name.startswith("virtual.")],
        "places": [{"name": place.name, "nodes": [n.name for n in place.nodes], "components": list(place.components),
                    "unit": place.unit.text, "domain": place.nodes[0].domain.name,
                    "enters": {f"w.{node}": weight for node, weight in place.weights.items()},
                    "across": _across(place, place.nodes[0].across),
                    "position": _across(place, place.nodes[0].domain.position, signals)} for place in places],
        "equations": {"intermediate": texts.intermediate, "der": {
            key[4:-1]: text for key, text in texts.expressions.items() if key.startswith("der(")},
            "residual": of("residual_"), "outputs": of("output "), "signals": of("signal ")}}


def _across(place: Place, member: str | None, signals: Container[str] | None = None) -> str:
    """A variable over a place as a formula of signals: b - a of mechanical nodes, else a - b; empty if it is not known."""
    texts = [f"{node.name}.{member}" for node in place.nodes]
    if not member or (signals is not None and any(text not in signals for text in texts)):
        return ""
    return texts[0] if len(texts) == 1 else f"{texts[1]} - {texts[0]}" if place.nodes[0].mechanical else \
        f"{texts[0]} - {texts[1]}"


def _explicit(assembly: Assembly, sides: Sequence[ca.SX]) -> tuple[list[tuple[str, ca.SX]], list[ca.SX]]:
    """Names and symbols of all arguments, and the sides in them: inputs in place of their pieces, and algebraic variables
    solved for if they enter their equations linearly."""
    t, x, z, p, pieces, rate = assembly.arguments
    known = assembly.flat.inputs
    symbols = [ca.SX.sym("u", 4) for _ in known]
    columns = stack([t, *(s / ca.SX(ca.DM([1, 1, 2, 6])) for s in symbols)]) if known else ca.SX(0, 1)  # c_k = u^(k)/k!
    assert pieces.numel() == measured_rows(assembly.flat), "delays have no equations in this form"
    found = ca.substitute(list(sides), [pieces, rate], [columns, ca.SX(1)])
    algebraic = [(f"algebraic.{k + 1}", symbol) for k, symbol in enumerate(split(z))]
    slope = ca.jacobian(found[1], z)
    if z.numel() and not ca.depends_on(slope, z):
        value = ca.solve(slope, -ca.substitute(found[1], z, ca.SX.zeros(z.shape)))
        found, algebraic = ca.substitute(found, [z], [value]), []
        found[1] = ca.SX(0, 1)
    inputs = []
    for k, symbol in zip(known, symbols, strict=True):
        name = f"w.{k.name.removeprefix('virtual.')}" if k.name.startswith("virtual.") else k.name
        rates = (name, f"der({name})", f"der(der({name}))", f"der(der(der({name})))")
        inputs += list(zip(rates, split(symbol), strict=True))
    arguments = [("time", t), *zip(assembly.state_names, split(x), strict=True), *algebraic,
                 *zip(assembly.parameter_names, split(p), strict=True), *inputs]
    return arguments, found
