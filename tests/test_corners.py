"""Expressions with rounded corners: sharp in the limit, and with gradients on both sides of every corner."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from heavebond.language.smoothing import rounded

X = ca.SX.sym("x", 3)
Y = ca.SX.sym("y", 2)
LAWS = {
    "contact": ca.fmax(1e6 * ca.fmax(X[0] - Y[0], 0) + 100 * X[1], 0),
    "play": ca.if_else(X[0] > Y[0], X[1] ** 2, -X[2]),
    "several": ca.fabs(X[2]) + ca.sign(Y[0]) + ca.atan2(X[0], Y[0]) + ca.fmin(X[0], ca.fmin(X[1], 3)),
    "logic": ca.if_else(ca.logic_or(ca.logic_and(X[0] > 0, X[1] <= Y[1]), ca.logic_not(Y[0] < X[2])), 2, X[0]),
}


@pytest.mark.parametrize("name", list(LAWS))
def test_without_width_the_law_is_what_it_was(name: str) -> None:
    found = rounded(LAWS[name], [X, Y])
    sharp, given = ca.Function("r", [X, Y, found.widths], [found.column]), ca.Function("g", [X, Y], [LAWS[name]])
    rng = np.random.default_rng(5)
    for x, y in zip(rng.normal(size=(40, 3)), rng.normal(size=(40, 2)), strict=True):
        # the width of 1e-12 is seen to 1e-6 through the stiffness, and not at all on a draw's distance from a corner
        assert float(sharp(x, y, 1e-12)) == pytest.approx(float(given(x, y)), rel=1e-9, abs=1e-5)


def test_an_open_contact_has_a_gradient_when_rounded() -> None:
    law = LAWS["contact"]
    found = rounded(law, [X, Y])
    slope = ca.Function("s", [X, Y, found.widths], [ca.jacobian(found.column, X)])
    open_ = [-1.0, 0.0, 0.0], [0.0, 0.0]
    assert float(ca.Function("s", [X, Y], [ca.jacobian(law, X)])(*open_)[0]) == 0
    assert float(slope(*open_, [1.0, 1e6])[0]) > 1e4
    assert found.at.numel() == 2
