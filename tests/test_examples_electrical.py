"""Every electrical and bond graph component in a small example, beside its closed form."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import test_library_drives as drives
import test_library_motors as motors
from examples import Array, Case, check, without_example
from scipy.integrate import solve_ivp

PI = np.pi
LAW = "network equations; nothing is integrated"
RUN = "closed form; 1e-6 for the integration"


def motor(t: Array, which: int) -> Array:
    """Current and speed of L*di/dt = u - R*i - k*w, J*dw/dt = k*i from rest, by eigenvalues."""
    R, L, k, J = 0.6, 0.3e-3, 46e-3, 140e-7
    a = np.array([[-R/L, -k/L], [k/J, 0]])
    final = np.array([0, 24/k])
    values, vectors = np.linalg.eig(a)
    share = np.linalg.solve(vectors, -final)
    return np.asarray((final[which] + (vectors[which]*share*np.exp(values*t[:, None])).sum(axis=1)).real)


def coupled(t: Array) -> Array:
    """The flows of M f' = e - K q - R f, q' = f from rest, by the matrix exponential."""
    inverse = np.linalg.inv([[2, 0.5], [0.5, 1]])
    system = np.block([[-inverse @ np.diag([3, 2]), -inverse @ [[90, -20], [-20, 40]]], [np.eye(2), np.zeros((2, 2))]])
    final = np.linalg.solve(system, -np.concatenate([inverse @ [6, 0], [0, 0]]))
    values, vectors = np.linalg.eig(system)
    share = np.linalg.solve(vectors, -final)
    return np.asarray((final[:, None] + vectors @ (share[:, None]*np.exp(np.outer(values, t)))).real[:2])


def swing(t: Array) -> Array:
    """6 W on 1 J, 0.01 s/W and 2 W: natural frequency 10 rad/s, damping ratio 0.1."""
    own = 10*np.sqrt(1 - 0.1**2)
    return 6/own*np.exp(-t)*np.sin(own*t)


def braked(loss: Callable[[float], Array], mass: Array, start: tuple[float, ...], row: int) -> Callable[[Array], Array]:
    """Momenta under p' = -R(t) M^-1 p, by SciPy."""
    inverse = np.linalg.inv(mass)
    return lambda t: np.asarray(solve_ivp(lambda time, p: -loss(time) @ inverse @ p, (0, t[-1]), start, "DOP853", t,
                                          rtol=1e-10, atol=1e-12).y[row])


def turned(time: float) -> Array:
    """The resistance of 1 and 0.1 W along turning axes, in the fixed frame."""
    turn = np.array([[np.cos(time), np.sin(time)], [-np.sin(time), np.cos(time)]])
    return np.asarray(turn.T @ np.diag([1, 0.1]) @ turn)


def gyrated(time: float) -> Array:
    g = np.array([[time, 1], [0, 0.5]])
    return np.asarray(g.T @ np.linalg.inv(np.diag([4, 1])) @ g)


def factored(time: float) -> Array:
    factor = np.array([[time, 0], [time, 0.5]])
    return np.asarray(factor @ factor.T)


def hamiltonian(energy: Callable[[Array, float], float], slide: float, start: tuple[float, ...], row: int
                ) -> Callable[[Array], Array]:
    """Displacement q (2), momentum p (2), place x and momentum of the slide by Hamilton's equations, q' = -dH/dp,
    p' = dH/dq, x' = -p_x/slide, p_x' = dH/dx, with differences of the energy for its derivatives."""
    def rate(_: float, y: Array) -> list[float]:
        h = 1e-5
        slopes = [(energy(y[:4] + h*np.eye(4)[k], y[4]) - energy(y[:4] - h*np.eye(4)[k], y[4]))/(2*h) for k in range(4)]
        along = (energy(y[:4], y[4] + h) - energy(y[:4], y[4] - h))/(2*h)
        return [-slopes[2], -slopes[3], slopes[0], slopes[1], -y[5]/slide, along]

    return lambda t: np.asarray(solve_ivp(rate, (0, t[-1]), start, "DOP853", t, rtol=1e-9, atol=1e-11).y[row])


def tightened(y: Array, x: float) -> float:
    return float(y[:2] @ (np.array([[5, -1], [-1, 4]]) + x*np.diag([2, 1])) @ y[:2]/2 + y[2:] @ y[2:]/2)


def drawn_in(y: Array, x: float) -> float:
    mass = np.array([[3, 1], [1, 2]]) - x*np.diag([1, 0.5])
    return float(y[:2] @ np.diag([5, 3]) @ y[:2]/2 + y[2:] @ np.linalg.solve(mass, y[2:])/2)


MODULATED = "SciPy, 1e-10; 1e-5 for the integration over several swings"
SWING = "closed form; 1e-5 for the integration over several swings"
T, LOAD = np.array([[1, 2], [3, 4]]), np.diag([4, 5])
def winding(t: np.ndarray) -> np.ndarray:
    """The current of a winding that heats itself behind its leads, by SciPy."""
    def current(temperature: np.ndarray) -> np.ndarray:
        return 12/(0.05 + 4*(1 + 0.0039*(temperature - 293.15)))
    rates = solve_ivp(lambda _, y: current(y)**2*4*(1 + 0.0039*(y - 293.15))/38.5, (0, t[-1]), [293.15], t_eval=t,
                      rtol=1e-10)
    return np.asarray(current(rates.y[0]))


CASES = [
    Case("resistor_with_heat_port", "winding.i", winding, "SciPy"),
    Case("resistor", "load.i", lambda t: 3 + 0*t, LAW),
    Case("conductance", "store.u", lambda t: 12*np.exp(-2*t), RUN),
    Case("brush_contact", "winding.i", lambda t: 2.5 + 0*t, "(12 V - 2 V)/4 ohm; tanh(2.5 A/50 mA) is 1", 1e-6),
    Case("current_curve_of_voltage", "part.i", lambda t: 1.5 + 0*t, LAW),
    Case("electrical_ground", "middle.v", lambda t: 9 + 0*t, LAW),
    Case("capacitor", "store.u", lambda t: 12*(1 - np.exp(-t/0.2)), RUN),
    Case("inductor", "coil.i", lambda t: 3*(1 - np.exp(-5*t)), RUN),
    Case("voltage_source", "load.i", lambda t: 2.5*np.sin(2*PI*t), LAW),
    Case("current_source", "plus.v", lambda t: 12 + 0*t, LAW),
    Case("battery", "plus.v", lambda t: 11 + 0*t, LAW),
    Case("voltage_sensor", "meter.y", lambda t: 3 + 0*t, LAW),
    Case("current_sensor", "meter.y", lambda t: 3 + 0*t, LAW),
    Case("electrical_power_sensor", "meter.y", lambda t: 36 + 0*t, LAW),
    Case("transformer", "load.i", lambda t: 4.6*np.sin(2*PI*t), LAW),
    Case("transformer", "transformer.i", lambda t: 0.46*np.sin(2*PI*t), LAW),
    # r**2*C is 1 H
    Case("gyrator", "gyrator.i_1", lambda t: 12*t, RUN),
    Case("motor_constant", "shaft.w", lambda t: 2*t, RUN),
    Case("motor_constant", "plus.v", lambda t: 0.4*t, RUN),
    Case("dc_motor", "shaft.w", lambda t: motor(t, 1), "eigenvalues; 1e-6 for the integration"),
    Case("dc_motor", "motor.i", lambda t: motor(t, 0), "eigenvalues; 1e-6 for the integration"),
    Case("se", "store.a.e", lambda t: 6*(1 - np.exp(-t/0.3)), RUN),
    Case("sf", "zero.e", lambda t: 6*(1 - np.exp(-t/0.3)), RUN),
    Case("r", "body.v", lambda t: np.exp(-2*t), RUN),
    Case("c", "oil.p", lambda t: 1e7*t, RUN),
    Case("i", "shaft.w", lambda t: 1.5*t, RUN),
    Case("tf", "loss.a.f", lambda t: 0.5 + 0*t, LAW),
    Case("gy", "store.a.e", lambda t: 30*t, RUN),
    Case("gy", "motor.a.f", lambda t: 15*t, RUN),
    Case("mtf", "loss.a.f", lambda t: 1.5/(1 + t), LAW),
    Case("mgy", "loss.a.f", lambda t: 0.5*(1 + t), LAW),
    Case("junction0", "first.a.f", lambda t: 4 + 0*t, LAW),
    Case("junction0", "second.a.f", lambda t: 2 + 0*t, LAW),
    Case("junction1", "one.f", swing, RUN),
    Case("junction1_field", "part.f[2]", lambda t: coupled(t)[1], "matrix exponential"),
    # eigenvalues 4 and 6 of the stiffness, 3 and 1 of the masses; the eigenvectors are (1, 1) and (1, -1)
    Case("c_field", "first", lambda t: (np.cos(2*t) + np.cos(np.sqrt(6)*t))/2, SWING, 1e-5),
    Case("i_field", "second", lambda t: (np.exp(-t/3) - np.exp(-t))/2, RUN),
    Case("r_field", "first", lambda t: 2/(2*2 + 1)*6 + 0*t, LAW),
    Case("tf_field", "part.a[1].f", lambda t: np.linalg.solve(T.T @ LOAD @ T, [6, 1])[0] + 0*t, LAW),
    Case("mtf_field", "momenta[1]", braked(turned, 2*np.eye(2), (2, 0), 0), MODULATED, 1e-5),
    Case("mgy_field", "momenta[2]", braked(gyrated, np.diag([2, 1]), (2, 1), 1), MODULATED, 1e-5),
    Case("mr_field", "momenta[1]", braked(factored, np.diag([2, 1]), (2, -1), 0), MODULATED, 1e-5),
    Case("mc_field", "place", hamiltonian(tightened, 3, (1, 0.5, 0, 0, 0, -3), 4), MODULATED, 1e-5),
    Case("mc_field", "energy", lambda t: tightened(np.array([1, 0.5, 0, 0]), 0) + 1.5 + 0*t, "conserved", 1e-5),
    Case("mi_field", "place", hamiltonian(drawn_in, 20, (0, 0, 1, -1, 0, -4), 4), MODULATED, 1e-5),
    Case("mi_field", "energy", lambda t: drawn_in(np.array([0, 0, 1, -1]), 0) + 0.4 + 0*t, "conserved", 1e-5),
    Case("gy_field", "part.a[2].f", lambda t: np.linalg.solve(T.T @ np.linalg.inv(LOAD) @ T, [6, 1])[1] + 0*t, LAW),
]


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.example}-{case.signal}")
def test_the_example_shows_the_law(case: Case) -> None:
    check(case)


def test_every_component_has_an_example() -> None:
    assert without_example(["electrical", "bond_graph"], [*CASES, *drives.ELECTRICAL, *motors.ELECTRICAL]) == []
