"""How unknowns stand in equations, and what the assembler makes of it."""

from __future__ import annotations

from math import inf
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import heavebond as hb
from heavebond.equations.block_solver import explicit
from heavebond.language.incidence import (
    DEFINITE,
    INDEFINITE,
    NONLINEAR,
    NUMBER,
    PARAMETER,
    UNIT,
    classify,
    interval,
    intervals,
)

x, y, p, volume = (ca.SX.sym(name) for name in ("x", "y", "p", "V"))


@pytest.mark.parametrize(("residual", "kind"), [
    (y - x, UNIT), (2 * x + y, NUMBER), (p * x - y, PARAMETER), (volume * x - y, DEFINITE), (y * x, INDEFINITE),
    (x**2 - y, NONLINEAR), (ca.sign(x) - y, NONLINEAR), (ca.if_else(x > 0, y, 0), NONLINEAR),
    (x - ca.if_else(x > 0, y, 0), NONLINEAR), (p * x + ca.sign(x), NONLINEAR), (x - ca.if_else(y > 0, p, 0), UNIT),
    # y*(V*y) is a square times V, y*(V*p) is of any sign, and a cube has that of its base
    (volume * x + y * (volume * (y * x)), DEFINITE), (-y * (volume * (-y)) * x - p, DEFINITE),
    (volume * x + y * (volume * (p * x)), INDEFINITE), (y * (volume * (y * (y * x))), INDEFINITE)])
def test_the_kind_of_an_unknown_in_an_equation(residual: ca.SX, kind: int) -> None:
    row, = classify(residual, x, {p.element_hash()}, {volume.element_hash(): (0.0, inf)})
    assert [(entry.column, entry.kind) for entry in row] == [(0, kind)]


def test_equations_are_solved_together_as_they_are_alone() -> None:
    residuals = [p * x - y**2, 3 * volume + y]
    a, v = explicit(ca.vertcat(*residuals), ca.vertcat(x, volume))
    for k, (residual, symbol) in enumerate(zip(residuals, (x, volume), strict=True)):
        alone = explicit(residual, symbol)
        assert ca.is_equal(a[k], alone[0], 10) and ca.is_equal(v[k], alone[1], 10)


def test_a_loop_through_a_condition_is_not_solved_as_if_it_were_linear(tmp_path: Path) -> None:
    """left = 10 - a - b, where a and b are 3 and 4 as long as something is left: 3, and not the 10 of a linear loop."""
    (tmp_path / "components").mkdir()
    (tmp_path / "components" / "budget.yaml").write_text("""component: Budget
summary: Two consumers of what is left.
ports: {y: {signal: out, unit: "1"}}
variables: {a: {unit: 1}, b: {unit: 1}, left: {unit: 1}, s: {unit: 1}}
equations: |
  a = if_else(left > 0, 3, 0)
  b = if_else(left > 0, 4, 0)
  left = if_else(10 - a - b < 0, 0, 10 - a - b)
  der(s) + s/1 = 0
  y = left
units: unchecked
""")
    model = hb.loads("model: m\ncomponents: {b: {is: Budget}}\nnodes: {y: [b.y]}\ninitial: {b.s: 1, b.left: ~ 1}\n"
                     "simulate: {until: 1 s}\n", tmp_path)
    run = hb.simulate(model)
    assert run["b.left"] == pytest.approx(np.full(len(run.time), 3.0))


RELAY = """
component: Relay
summary: Pushes while its input, moved by an offset, is above zero.
ports:
  u: {signal: in, unit: m, doc: input}
  y: {signal: out, unit: N, doc: force}
parameters:
  F: {unit: N, doc: force when on}
variables:
  w: {unit: m, doc: input moved by the offset}
equations: |
  y = if_else(w > 0, F, 0)   # the relay
  w = u                      # stands behind the line that needs it
"""
PUSHED = """
model: pushed
components:
  relay: {is: Relay, F: 1 N, u: "=0.1 m*sin(pi*time/1 s)"}
  push:  {is: ForceSource}
  mass:  {is: Mass, m: 1 kg}
nodes:
  load:  [mass.a, push.a]
  force: [relay.y, push.u]
initial: {load.v: 0 m/s}
simulate: {until: 2 s}
"""


def test_what_only_a_comparison_needs_is_evaluated_before_it(tmp_path: Path) -> None:
    (tmp_path / "relay.yaml").write_text(RELAY)
    result = hb.simulate(hb.loads(PUSHED, tmp_path))
    assert result["load.v"][-1] == pytest.approx(1.0, rel=1e-6)  # on for one second of two


def test_intervals_of_expressions_that_share_parts_are_those_of_each() -> None:
    """A chain of rotations: the entries of its product are walked once, and keep the intervals that each has alone."""
    angles = ca.SX.sym("q", 4)
    bounds = {angles[0].element_hash(): (0.1, 0.2)}
    product = ca.SX.eye(2)
    for k in range(4):
        turned = ca.vertcat(ca.horzcat(ca.cos(angles[k]), angles[k]), ca.horzcat(-angles[0], ca.fabs(angles[k])))
        product = ca.mtimes(product, turned)
    entries = [*ca.vertsplit(ca.vec(product)), ca.SX(0), angles[0] * angles[0], 1 / angles[0]]
    assert intervals(entries, bounds) == [interval(e, bounds) for e in entries]
    assert intervals([], bounds) == []
