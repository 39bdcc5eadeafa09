"""CVODES driven by compiled code gives what CVODES gives through CasADi."""

from __future__ import annotations

import ctypes
import gc
import os
import signal
import time
import weakref
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from heavebond.numerics import compiled_cvodes
from heavebond.numerics.compiled_cvodes import (
    CVODES,
    KNOWN,
    OPERATIONS,
    CompiledCvodes,
    Driving,
    Equations,
    Integrated,
    Method,
    NotCompiled,
)
from heavebond.numerics.idas import Tolerances

pytestmark = pytest.mark.skipif(compiled_cvodes.program() is None, reason="no C compiler, or a CasADi with another SUNDIALS")
TOLERANCES = Tolerances(1e-8, 1e-10)
STOPS = np.linspace(0.0, 5.0, 26)


@dataclass
class System:
    """x' = ode, 0 = alg and signals with symbols of their own, unless they are given."""

    x: ca.SX
    ode: ca.SX
    p: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    u: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    t: ca.SX = field(default_factory=lambda: ca.SX.sym("t"))
    z: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    alg: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    signals: ca.SX = field(default_factory=lambda: ca.SX(0, 1))

    def equations(self, *moving: int) -> Equations:
        return Equations([self.t, self.x, self.z, self.p, self.u], self.ode, self.alg, self.signals, moving)


def run(own: CompiledCvodes, x0: list[float], p: list[float], z0: list[float] | None = None) -> Integrated:
    """With a sensitivity to each parameter, in their order, where there are any."""
    return own.run(np.array([*x0, *[0.0] * len(x0) * own.m]), np.array(z0 or []), np.array(p), np.eye(len(p), own.m))


def integrate(system: System, x0: list[float], p: list[float], most: int = 1000) -> np.ndarray:
    return run(CompiledCvodes(system.equations(), 0, STOPS, TOLERANCES, most), x0, p).x


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
            found = integrate(System(x, expression, ca.vertcat(a, b)), [0.0], point)
            assert found[0] == pytest.approx(wanted * STOPS, rel=1e-9, abs=1e-12), point
    assert tried


U = np.vstack([STOPS[:-1], np.sin(STOPS[:-1])])
AT_STOPS = np.vstack([STOPS, np.sin(STOPS)])


def pendulum() -> System:
    """A damped pendulum, driven by a table over time; its signals are an acceleration and a product."""
    t, x, p, u = (ca.SX.sym(name, k) for name, k in (("t", 1), ("x", 2), ("p", 1), ("u", 2)))
    rate = ca.vertcat(x[1], -ca.sin(x[0]) - p * x[1] + u[1] * (t - u[0]))
    return System(x, rate, p, u, t, signals=ca.vertcat(rate[1], x[0] * x[1] + p**2))


def test_runs_and_steps_are_those_of_casadis_cvodes() -> None:
    """With inputs held between stops: the same method begun anew at each stop, so the same steps but for roundings; with the
    sensitivities of states and signals to the damping."""
    system = pendulum()
    x, p = system.x, system.p
    own = CompiledCvodes(system.equations(0), 1, STOPS, TOLERANCES, 1000, Driving(STOPS, U, AT_STOPS, True))
    found = run(own, [1.0, 0.0], [0.2])
    s = ca.SX.sym("s", 2)
    given = {"t": system.t, "x": ca.vertcat(x, s), "p": p, "u": system.u,
             "ode": ca.vertcat(system.ode, ca.jtimes(system.ode, x, s) + ca.jacobian(system.ode, p))}
    peer = ca.integrator("run", "cvodes", given, 0.0, STOPS[1:].tolist(), {"reltol": 1e-8, "abstol": 1e-10})
    wanted = np.array(peer(x0=[1.0, 0, 0, 0], p=0.2, u=U)["xf"])
    # both err by some ten times their tolerance
    assert np.abs(found.x[:, 1:] - wanted).max() < 1e-6
    assert own.stats()["nsteps"] > len(STOPS) and own.stats()["linear_solver"] == "direct"
    moved = ca.jtimes(system.signals, x, s) + ca.jacobian(system.signals, p)
    signals = ca.Function("signals", [system.t, given["x"], p, system.u], [system.signals, moved])
    for k, expected in enumerate(signals(STOPS[None, :], found.x, 0.2, AT_STOPS)):
        assert np.abs(found.signals[:, k].T - np.array(expected)).max() < 1e-12
    assert own.run(np.array([1.0, 0, 0, 0]), np.zeros(0), np.array([0.2]), np.eye(1), False).signals == \
        pytest.approx(found.signals, abs=0)


def test_a_table_is_looked_up_by_time() -> None:
    """The same pieces, stepped over under error control."""
    equations = pendulum().equations()
    over = CompiledCvodes(equations, 0, STOPS, TOLERANCES, 1000, Driving(STOPS, U, AT_STOPS, False), 0.4)
    stopping = CompiledCvodes(equations, 0, STOPS, TOLERANCES, 1000, Driving(STOPS, U, AT_STOPS, True))
    assert np.abs(run(over, [1.0, 0.0], [0.2]).x - run(stopping, [1.0, 0.0], [0.2]).x).max() < 1e-6


ONE_STEP = Method(True, 1e6)


@pytest.mark.parametrize("held", [False, True])
def test_the_one_step_method_gives_what_cvodes_gives(held: bool) -> None:
    """With inputs as a table or held between stops, with sensitivities of states and signals; to some ten times the
    tolerance, as above. A table is continuous: sin(t) joined by lines."""
    system = pendulum()
    t, u = system.t, ca.SX.sym("u", 3)
    if not held:
        system.ode = ca.substitute(system.ode, system.u, ca.vertcat(t - 1, u[1] + u[2] * (t - u[0])))
        system.signals, system.u = ca.substitute(system.signals, system.u, ca.vertcat(t - 1, u[1] + u[2] * (t - u[0]))), u
    lines = np.vstack([STOPS[:-1], np.sin(STOPS[:-1]), np.diff(np.sin(STOPS)) / np.diff(STOPS)])
    joined = Driving(STOPS, lines, np.column_stack([lines, [STOPS[-1], np.sin(STOPS[-1]), 0.0]]), False)
    driving = Driving(STOPS, U, AT_STOPS, True) if held else joined
    own, peer = (CompiledCvodes(system.equations(0), 1, STOPS, TOLERANCES, 1000, driving, 0.4, method)
                 for method in (ONE_STEP, CVODES))
    one, other = run(own, [1.0, 0.0], [0.2]), run(peer, [1.0, 0.0], [0.2])
    assert own.stats()["linear_solver"] == "none" and own.stats()["nfevals"] > 6 * (len(STOPS) - 1)
    assert np.abs(one.x - other.x).max() < 1e-6
    assert np.abs(one.signals - other.signals).max() < 1e-6


def oscillator(p: ca.SX) -> System:
    """x'' = -x - p x', with x0 = 1 cos t without damping."""
    x = ca.SX.sym("x", 2)
    return System(x, ca.vertcat(x[1], -x[0] - p * x[1]), p)


def test_the_one_step_method_is_of_order_5() -> None:
    """Its error falls as the tolerance, with steps that grow by its fifth root: the sixth power of the step, times as many
    steps as there are."""
    system, stops = oscillator(ca.SX.sym("p")), np.array([0.0, 50.0])
    found = {}
    for rtol in (1e-5, 1e-10):
        own = CompiledCvodes(system.equations(), 0, stops, Tolerances(rtol, rtol), 10_000, method=ONE_STEP)
        error = abs(run(own, [1.0, 0.0], [0.0]).x[0, -1] - np.cos(50.0))
        found[rtol] = error, own.stats()["nsteps"]
    assert found[1e-5][0] < 50 * 1e-5 * 5  # no more than its errors of all steps together, of the scaled state 1
    assert found[1e-10][0] < 50 * 1e-10 * 5
    assert found[1e-10][1] / found[1e-5][1] == pytest.approx(10.0, rel=0.15)


def driven(number: int) -> CompiledCvodes:
    """The oscillator over 50 s, driven by numbers of its own between so many stops, without a method."""
    system, stops = oscillator(ca.SX.sym("p")), np.linspace(0.0, 50.0, number)
    u = ca.SX.sym("u")
    system.ode, system.u = ca.vertcat(system.ode[0], system.ode[1] + u), u
    held = 0.1 * np.sin(1.7 * stops[None, :-1])
    return CompiledCvodes(system.equations(), 0, stops, Tolerances(1e-5, 1e-7), 10_000,
                          Driving(stops, held, np.column_stack([held, [0.0]]), True), method=None)


def test_the_first_run_chooses_the_method() -> None:
    """The one-step method where CVODES has to begin anew at each of a few samples a cycle, which stays; CVODES where an
    undriven motion has many stops a cycle."""
    own = driven(101)
    first = run(own, [1.0, 0.0], [0.1])
    assert run(own, [1.0, 0.0], [0.1]).x == pytest.approx(first.x, abs=0)
    assert own.method is not None and own.method.one_step
    many = CompiledCvodes(oscillator(ca.SX.sym("p")).equations(), 0, np.linspace(0.0, 50.0, 2001), TOLERANCES, 10_000,
                          method=None)
    run(many, [1.0, 0.0], [0.1])
    assert many.method == CVODES


def test_the_one_step_method_hands_over_what_becomes_stiff() -> None:
    """With a damping of 1e6 its steps would be some 1e-6 of a cycle; x stays where it was, but for x' = u/p."""
    own = driven(101)
    run(own, [1.0, 0.0], [0.1])
    assert own.method is not None and own.method.one_step
    seen: list[int] = []
    found = own.run(np.array([1.0, 0.0]), np.zeros(0), np.array([1e6]), np.zeros((1, 0)), True,
                    lambda before, signals: seen.append(before))
    assert np.abs(found.x[0] - np.exp(-np.linspace(0.0, 50.0, 101) / 1e6)).max() < 1e-5
    assert own.method == CVODES and seen[-2:] == [0, 51]  # the watch begins anew too


def test_algebraic_unknowns_follow_the_states() -> None:
    """x' = -z with z + p z**3 = x, whose z has no simple form: as IDAS integrates it, with sensitivities."""
    x, z, p = ca.SX.sym("x"), ca.SX.sym("z"), ca.SX.sym("p")
    system = System(x, -z, p, z=z, alg=z + p * z**3 - x, signals=x * z)
    found = run(CompiledCvodes(system.equations(0), 1, STOPS, TOLERANCES, 1000), [1.0], [0.5], [0.7])
    s, w = ca.SX.sym("s"), ca.SX.sym("w")
    moved = ca.jtimes(system.alg, ca.vertcat(x, z), ca.vertcat(s, w)) + ca.jacobian(system.alg, p)
    dae = {"x": ca.vertcat(x, s), "z": ca.vertcat(z, w), "p": p, "ode": ca.vertcat(-z, -w),
           "alg": ca.vertcat(system.alg, moved)}
    peer = ca.integrator("run", "idas", dae, 0.0, STOPS[1:].tolist(), {"reltol": 1e-10, "abstol": 1e-12})
    wanted = peer(x0=[1.0, 0.0], z0=[0.7, 0.0], p=0.5)
    assert np.abs(found.x[:, 1:] - np.array(wanted["xf"])).max() < 1e-6
    assert np.abs(found.z[:, 1:] - np.array(wanted["zf"])).max() < 1e-6
    assert found.signals[:, 1, 0] == pytest.approx(found.x[1] * found.z[0] + found.x[0] * found.z[1], abs=1e-12)


def test_algebraic_unknowns_that_nothing_determines_are_an_error() -> None:
    x, z = ca.SX.sym("x"), ca.SX.sym("z", 2)
    system = System(x, -z[0], z=z, alg=ca.vertcat(z[0] + z[1] - x, 2 * (z[0] + z[1] - x)))
    with pytest.raises(RuntimeError, match="right-hand side"):
        run(CompiledCvodes(system.equations(), 0, STOPS, TOLERANCES, 1000), [1.0], [], [0.5, 0.5])


def test_what_runs_away_is_an_error_that_says_when() -> None:
    x = ca.SX.sym("x")
    with pytest.raises(RuntimeError, match=r"At t = (0\.99|1\.0)"):
        integrate(System(x, x**2), [1.0], [])
    with pytest.raises(RuntimeError, match="mxstep"):
        integrate(System(x, 100 * ca.cos(1e4 * x) - x), [1.0], [], most=3)


def test_an_equation_that_is_no_number_is_an_error() -> None:
    x = ca.SX.sym("x")
    with pytest.raises(RuntimeError, match="right-hand side"):
        integrate(System(x, ca.log(x - 2.0)), [1.0], [])


def test_what_it_cannot_integrate_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    many = ca.SX.sym("x", compiled_cvodes.MOST_STATES + 1)
    with pytest.raises(NotCompiled):
        System(many, -many).equations()
    monkeypatch.delitem(KNOWN, ca.OP_SIN)
    with pytest.raises(NotCompiled):
        System(many[0], ca.sin(many[0])).equations()


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
    own = CompiledCvodes(System(x, -x).equations(), 0, STOPS, TOLERANCES, 1000)
    problem, gone = own._problem, weakref.ref(own)
    assert problem.memory
    del own
    gc.collect()
    assert gone() is None and not problem.memory


def swinging() -> System:
    """A pendulum with friction at a kink, a loop (z = cos(z) x) and every kind of signal."""
    x, p, z = ca.SX.sym("x", 2), ca.SX.sym("p", 2), ca.SX.sym("z")
    ode = ca.vertcat(x[1], -ca.sin(x[0]) - p[0] * ca.fmax(x[1], 0) + p[1] * z ** 1.3)
    signals = ca.vertcat(z * x[0], ca.if_else(x[1] > 0, 1, 2))
    return System(x, ode, p, z=z, alg=z - 0.5 * ca.exp(-z * x[0] ** 2), signals=signals)


def compile_to_the_end(equations: Equations) -> None:
    """As after runs that took long enough, and further ones until the compiler is ready."""
    equations.spent(10**12, False)
    assert equations.compilation is not None
    end = time.monotonic() + 60
    while equations.compilation.busy and time.monotonic() < end:
        equations.spent(0, False)
        time.sleep(0.01)


def test_machine_code_gives_the_same_bits() -> None:
    """Compiled after the first run that took long enough; states, algebraic unknowns, signals and their sensitivities."""
    equations = swinging().equations(0, 1)
    runs = [CompiledCvodes(equations, 2, STOPS, TOLERANCES, 1000) for _ in range(2)]

    def found() -> list[Integrated]:
        return [run(own, [1.0, 0.0], [0.2, 0.3], [0.4]) for own in runs]

    before = found()
    assert runs[0].stats()["equations"] == "list of operations" and equations.compilation is None
    equations.spent(10**12, False)
    while_compiled = found()
    compile_to_the_end(equations)
    after = found()
    assert runs[1].stats()["equations"] == "machine code"
    for one, *others in zip(before, while_compiled, after, strict=True):
        for name in ("x", "z", "signals"):
            assert all(np.array_equal(getattr(one, name), getattr(other, name)) for other in others), name


def test_runs_go_on_while_equations_are_compiled(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A compiler that hangs, or fails, holds up nothing, and is ended with the equations; its folder is deleted."""
    command = tmp_path / "slow"
    command.write_text("#!/bin/sh\nexec sleep 600\n", encoding="utf-8")
    command.chmod(0o755)
    monkeypatch.setattr("heavebond.numerics.compiled_cvodes.compiler", lambda: str(command))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    equations = swinging().equations(0, 1)
    own = CompiledCvodes(equations, 2, STOPS, TOLERANCES, 1000)
    equations.spent(10**12, False)
    assert equations.compilation is not None
    process = equations.compilation._process
    assert process is not None and list(tmp_path.glob("heavebond_*"))
    run(own, [1.0, 0.0], [0.2, 0.3], [0.4])
    assert process.poll() is None and own.stats()["equations"] == "list of operations"
    process.kill()
    compile_to_the_end(equations)
    run(own, [1.0, 0.0], [0.2, 0.3], [0.4])
    assert own.stats()["equations"] == "list of operations" and not list(tmp_path.glob("heavebond_*"))


def test_without_a_compiler_the_list_of_operations_remains(monkeypatch: pytest.MonkeyPatch) -> None:
    equations = swinging().equations(0, 1)
    own = CompiledCvodes(equations, 2, STOPS, TOLERANCES, 1000)
    monkeypatch.setattr("heavebond.numerics.compiled_cvodes.compiler", lambda: None)
    equations.spent(10**12, False)
    run(own, [1.0, 0.0], [0.2, 0.3], [0.4])
    assert own.stats()["equations"] == "list of operations"


# -- the self-test ---------------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def library() -> ctypes.CDLL:
    program = compiled_cvodes.program()
    assert program is not None
    return program.library


@pytest.fixture
def anew(library: ctypes.CDLL, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The program is chosen again from the compiled library, during the test and after it."""
    monkeypatch.setattr(compiled_cvodes, "loaded", lambda *_: library)
    compiled_cvodes.program.cache_clear()
    yield
    compiled_cvodes.program.cache_clear()


@pytest.mark.parametrize(("refused", "solver"), [((), "direct"), ((True,), "gmres")])
def test_the_program_has_the_solver_that_passes(refused: tuple[bool, ...], solver: str, anew: None,
                                               monkeypatch: pytest.MonkeyPatch) -> None:
    test = compiled_cvodes._self_test
    monkeypatch.setattr(compiled_cvodes, "_self_test", lambda program: program.direct not in refused and test(program))
    own = CompiledCvodes(pendulum().equations(), 0, STOPS, TOLERANCES, 1000, Driving(STOPS, U, AT_STOPS, True))
    run(own, [1.0, 0.0], [0.2])
    assert own.stats()["linear_solver"] == solver


def test_a_crash_of_the_self_test_leaves_casadis_integrator(anew: None, monkeypatch: pytest.MonkeyPatch) -> None:
    def crash(program: object) -> bool:
        os.kill(os.getpid(), signal.SIGKILL)
        return True

    monkeypatch.setattr(compiled_cvodes, "_self_test", crash)
    assert compiled_cvodes.program() is None


@pytest.mark.parametrize(("one", "other"), [("CVode", "CVodeGetNumSteps"), ("CVSpilsSetPreconditioner", "CVodeSetMaxStep"),
                                            ("N_VGetArrayPointer", "CVodeGetNumErrTestFails")])
def test_other_functions_than_those_expected_are_found_out(one: str, other: str, anew: None) -> None:
    """Entries of the table of addresses exchanged, as in a library with other functions of these names."""
    program = compiled_cvodes.program()
    assert program is not None
    k, j = (compiled_cvodes.FUNCTIONS.index(name) for name in (one, other))
    addresses = type(program.sundials)(*program.sundials)
    addresses[k], addresses[j] = addresses[j], addresses[k]
    assert not compiled_cvodes._passes(compiled_cvodes._Program(program.library, addresses, True))
    assert compiled_cvodes._passes(compiled_cvodes._Program(program.library, program.sundials, True))
