"""The example of every thermal component, beside its closed form."""

from __future__ import annotations

import numpy as np
import pytest
from examples import Array, Case, check, without_example

import heavebond as hb

ZERO = 273.15  # K, 0 degC
TIGHT = 2e-6  # integration is accurate to 1e-8 of each state, times the number of time constants that are seen


def two_bodies(t: Array, capacities: tuple[float, float], conductances: tuple[float, float], heat: float, air: float,
               start: tuple[float, float]) -> Array:
    """Temperatures (2, N) of two capacities in line, the second on the air: T' = A T + b, by the eigenvectors of A."""
    (c_1, c_2), (g_1, g_2) = capacities, conductances
    a = np.array([[-g_1/c_1, g_1/c_1], [g_1/c_2, -(g_1 + g_2)/c_2]])
    rest = -np.linalg.solve(a, [heat/c_1, g_2*air/c_2])
    rates, vectors = np.linalg.eig(a)
    shares = np.linalg.solve(vectors, np.array(start) - rest)
    return rest[:, None] + vectors @ (shares[:, None] * np.exp(np.outer(rates, t)))


def bath(t: Array) -> Array:
    """A first-order lag of 92 s behind a sine of 10 K that begins at rest."""
    w, tau = 2*np.pi/600, 0.1*2*460
    return 293.15 + 10/(1 + (w*tau)**2)*(np.sin(w*t) - w*tau*np.cos(w*t) + w*tau*np.exp(-t/tau))


CASES = [
    Case("ambient", "1*block.T", lambda t: ZERO + 20 + 60*np.exp(-t/(0.5*2*460)), "first-order decay", TIGHT),
    Case("heat_capacity", "1*oil.T", lambda t: ZERO + 20 + 100e5*5e-4*t/(80*1900),
         "all of 100 bar times 30 L/min stays in the oil; the orifice is laminar below its transition, 1e-6 of the drop",
         TIGHT),
    Case("heat_storage", "air.T - walls.T", lambda t: 0.25*75*(1 - np.exp(-t/75)),
         "first-order lag of 1/(20 W/K*(1/2000 + 1/6000 K/J)) behind 500 W over 2000 J/K", TIGHT),
    Case("heat_storage", "2000*air.T + 6000*walls.T", lambda t: 8000*(ZERO + 20) + 500*t, "first law", TIGHT),
    Case("thermal_wall", "1*wall.T", lambda t: ZERO + 17 + 16*np.exp(-t/7200),
         "exponential to 0.75*20 degC + 0.25*8 degC, the temperature at a quarter of the resistance", TIGHT),
    Case("temperature_source", "1*block.T", bath, "forced and free response of a first-order lag", TIGHT),
    Case("heat_source", "1*block.T", lambda t: ZERO + 20 + 500*t/4500, "first law", TIGHT),
    Case("thermal_resistance", "1*winding.T",
         lambda t: two_bodies(t, (0.3*390, 1800), (2, 1/1.2), 40, ZERO + 25, (ZERO + 25, ZERO + 25))[0],
         "sum of the exponentials of both modes", TIGHT),
    Case("thermal_resistance", "1*housing.T",
         lambda t: two_bodies(t, (0.3*390, 1800), (2, 1/1.2), 40, ZERO + 25, (ZERO + 25, ZERO + 25))[1],
         "sum of the exponentials of both modes", TIGHT),
    Case("conduction", "hot.T - cold.T", lambda t: 80*np.exp(-0.2*(1/460 + 1/1380)*t),
         "the difference of two bodies decays at G*(1/C_1 + 1/C_2), G = 50*2e-4/0.05 W/K", 1e-5),
    Case("conduction", "460*hot.T + 1380*cold.T", lambda t: np.full_like(t, 460*(ZERO + 100) + 1380*(ZERO + 20)),
         "no heat is lost", TIGHT),
    Case("convection", "1*plate.T", lambda t: ZERO + 20 + 50*(1 - np.exp(-t/150)), "300 W over 6 W/K, 900 J/K", TIGHT),
    Case("natural_convection", "wall.T - air.T", lambda t: (60**(-1/3) + 1.19/(20*460)*t/3)**-3.0,
         "dT' = -k*dT**(4/3) integrated; the transition at 0.1 K shows by some (0.1/13)**2/6", 5e-5),
    Case("heat_radiation", "1*block.T", lambda t: (1000.0**-3 + 3*0.8*5.670374e-8*0.05/920*t)**(-1/3),
         "T' = -k*T**4 integrated", TIGHT),
    Case("heat_flow_curve_of_difference", "1*block.T", lambda t: ZERO + 20 + 60*np.exp(-2*t/(2*460)),
         "2 W/K, 920 J/K", TIGHT),
    Case("temperature_sensor", "1*lag.y", lambda t: ZERO + 20 + (t - 10*(1 - np.exp(-t/10)))*500/4500,
         "a lag of 10 s behind a ramp", TIGHT),
    Case("heat_flow_sensor", "1*meter.y", lambda t: np.full_like(t, 0.04*10/0.1*25), "Fourier's law"),
]


@pytest.mark.parametrize("case", CASES, ids=[f"{c.example}-{c.signal}" for c in CASES])
def test_examples(case: Case) -> None:
    check(case)


def test_every_component_has_one() -> None:
    assert not without_example(["thermal"], CASES)


def test_a_temperature_begins_where_its_domain_says() -> None:
    """Two capacities on one node share one temperature, which neither of them declares."""
    run = hb.simulate(hb.loads("""
model: pair
components:
  heater: {is: HeatSource, u: 100 W}
  one: {is: HeatCapacity, m: 1 kg, c: 500 J/(kg*K)}
  two: {is: HeatCapacity, m: 3 kg, c: 500 J/(kg*K)}
nodes: {body: [heater.a, one.a, two.a]}
show: {body.T: {unit: K}}
simulate: {until: 100 s}
"""))
    assert run["body.T"] == pytest.approx(293.15 + 100/2000*run.time, rel=1e-6)
