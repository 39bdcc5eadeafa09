"""CVODES driven by compiled code gives what CVODES gives through CasADi."""

from __future__ import annotations

import gc
import weakref

import casadi as ca
import numpy as np
import pytest

from heavebond.numerics import compiled_cvodes
from heavebond.numerics.compiled_cvodes import KNOWN, OPERATIONS, CompiledCvodes
from heavebond.numerics.idas import Tolerances

pytestmark = pytest.mark.skipif(compiled_cvodes.program() is None, reason="no C compiler, or a CasADi with another SUNDIALS")
TOLERANCES = Tolerances(1e-8, 1e-10)
STOPS = np.linspace(0.0, 5.0, 26)


def system(x: ca.SX, ode: ca.SX, p: ca.SX | None = None, u: ca.SX | None = None, t: ca.SX | None = None) -> dict[str, ca.SX]:
    none = ca.SX(0, 1)
    return {"t": ca.SX.sym("t") if t is None else t, "x": x, "z": none, "p": none if p is None else p,
            "u": none if u is None else u, "ode": ode, "alg": none}


def integrate(dae: dict[str, ca.SX], n: int, x0: list[float], p: list[float], most: int = 1000, **more: object
              ) -> np.ndarray:
    assert CompiledCvodes.fits(dae, n)
    return CompiledCvodes(dae, n, STOPS, TOLERANCES, most)(x0=np.array(x0), p=np.array(p), **more)["xf"]


@pytest.mark.parametrize("name", [name for name in OPERATIONS if hasattr(ca, f"OP_{name}")])
def test_operations_are_those_of_casadi(name: str) -> None:
    """x' = operation(p), so that x moves by it in a second; at points on both sides of 0 and of 1 where it is defined."""
    a, b, x = ca.SX.sym("a"), ca.SX.sym("b"), ca.SX.sym("x")
    one = {"ASSIGN": a, "NEG": -a, "SQ": a**2, "TWICE": 2 * a, "NOT": ca.logic_not(a), "INV": 1 / a,
           "LOG1P": ca.log1p(a), "EXPM1": ca.expm1(a), "CONSTPOW": a ** 1.7, "FABS": ca.fabs(a)}
    two = {"ADD": a + b, "SUB": a - b, "MUL": a * b, "DIV": a / b, "POW": a ** b, "LT": a < b, "LE": a <= b, "EQ": a == b,
           "NE": a != b, "AND": ca.logic_and(a, b), "OR": ca.logic_or(a, b), "FMOD": ca.fmod(a, b),
           "COPYSIGN": ca.copysign(a, b), "IF_ELSE_ZERO": ca.if_else(a, b, 0), "FMIN": ca.fmin(a, b), "FMAX": ca.fmax(a, b),
           "ATAN2": ca.atan2(a, b), "HYPOT": ca.hypot(a, b)}
    expression = {**one, **two}.get(name)
    if expression is None:
        expression = getattr(ca, name.lower())(a)
    expected = ca.Function("f", [a, b], [expression])
    tried = 0
    for point in ([0.4, 0.7], [0.7, 0.7], [-0.4, 0.7], [1.8, -0.3], [0.0, 2.5], [-1.8, -0.3]):
        wanted = float(expected(*point))
        if np.isfinite(wanted):
            tried += 1
            found = integrate(system(x, expression, ca.vertcat(a, b)), 1, [0.0], point)
            assert found[0] == pytest.approx(wanted * STOPS[1:], rel=1e-9, abs=1e-12), point
    assert tried


def pendulum() -> tuple[dict[str, ca.SX], ca.Function]:
    """A damped pendulum with its sensitivity to the damping, driven by a table over time."""
    t, x, s, p, u = (ca.SX.sym(name, k) for name, k in (("t", 1), ("x", 2), ("s", 2), ("p", 1), ("u", 2)))
    rate = ca.vertcat(x[1], -ca.sin(x[0]) - p * x[1] + u[1] * (t - u[0]))
    moved = ca.jtimes(rate, x, s) + ca.jacobian(rate, p)
    return system(ca.vertcat(x, s), ca.vertcat(rate, moved), p, u, t), rate


def test_runs_and_steps_are_those_of_casadis_cvodes() -> None:
    """With inputs held between stops: the same method begun anew at each stop, so the same steps but for roundings."""
    dae, _ = pendulum()
    u = np.vstack([STOPS[:-1], np.sin(STOPS[:-1])])
    own = CompiledCvodes(dae, 2, STOPS, TOLERANCES, 1000)
    found = own(x0=np.array([1.0, 0, 0, 0]), p=np.array([0.2]), u=u)["xf"]
    given = {k: v for k, v in dae.items() if k not in ("z", "alg")}
    peer = ca.integrator("run", "cvodes", given, 0.0, STOPS[1:].tolist(), {"reltol": 1e-8, "abstol": 1e-10})
    wanted = np.array(peer(x0=[1.0, 0, 0, 0], p=0.2, u=u)["xf"])
    # both err by some ten times their tolerance
    assert np.abs(found - wanted).max() < 1e-6
    assert own.stats()["nsteps"] > len(STOPS)


def test_a_table_is_looked_up_by_time() -> None:
    """The same pieces, stepped over under error control."""
    dae, _ = pendulum()
    u = np.vstack([STOPS[:-1], np.sin(STOPS[:-1])])
    x0, p = np.array([1.0, 0, 0, 0]), np.array([0.2])
    over = CompiledCvodes(dae, 2, STOPS, TOLERANCES, 1000, (STOPS, u), 0.4)(x0=x0, p=p)["xf"]
    stopping = CompiledCvodes(dae, 2, STOPS, TOLERANCES, 1000)(x0=x0, p=p, u=u)["xf"]
    assert np.abs(over - stopping).max() < 1e-6


def test_what_runs_away_is_an_error_that_says_when() -> None:
    x = ca.SX.sym("x")
    with pytest.raises(RuntimeError, match=r"At t = (0\.99|1\.0)"):
        integrate(system(x, x**2), 1, [1.0], [])
    with pytest.raises(RuntimeError, match="mxstep"):
        integrate(system(x, 100 * ca.cos(1e4 * x) - x), 1, [1.0], [], most=3)


def test_an_equation_that_is_no_number_is_an_error() -> None:
    x = ca.SX.sym("x")
    with pytest.raises(RuntimeError, match="right-hand side"):
        integrate(system(x, ca.log(x - 2.0)), 1, [1.0], [])


def test_it_is_not_offered_what_it_cannot_integrate(monkeypatch: pytest.MonkeyPatch) -> None:
    x, z = ca.SX.sym("x"), ca.SX.sym("z")
    dae = system(x, -x)
    assert not CompiledCvodes.fits({**dae, "z": z, "alg": z - x}, 1)
    assert not CompiledCvodes.fits(dae, compiled_cvodes.MOST_STATES + 1)
    external = ca.Function("outside", [ca.MX.sym("a")], [ca.DM(1)])
    assert not KNOWN.get(ca.OP_CALL) and external.n_in() == 1
    monkeypatch.setattr(compiled_cvodes, "program", lambda: None)
    assert not CompiledCvodes.fits(dae, 1)


def test_without_a_compiler_there_is_no_program(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    compiled_cvodes.program.cache_clear()
    try:
        assert compiled_cvodes.program() is None
    finally:
        monkeypatch.undo()
        compiled_cvodes.program.cache_clear()


def test_what_sundials_holds_is_given_back() -> None:
    x = ca.SX.sym("x")
    own = CompiledCvodes(system(x, -x), 1, STOPS, TOLERANCES, 1000)
    problem, gone = own._problem, weakref.ref(own)
    assert problem.memory
    del own
    gc.collect()
    assert gone() is None and not problem.memory
