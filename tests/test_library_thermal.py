"""Thermal components beside formulas of their sources."""

from __future__ import annotations

import numpy as np
from library_check import agree, checks, cubic_spline, part

T_A = np.array([250.0, 293.15, 300, 350, 1000])  # colder and warmer than the other side, and as warm
T_B = 300.0
FLOWS = np.array([-300.0, 0, 20, 5e3])


def carries(name: str, expected: np.ndarray, rtol: float = 1e-9, **given: object) -> None:
    """A part between two temperatures carries a heat flow and keeps none."""
    found = part(name, **given)({"a.T": T_A, "b.T": T_B})
    agree(found["a.Q"], expected, rtol, size=float(np.abs(expected).max())*1e-6)
    agree(found["b.Q"], -found["a.Q"])


@checks("Conduction", "Convection", "ThermalResistance")
def test_linear_resistances() -> None:
    carries("Conduction", 50*2e-4/0.05*(T_A - T_B), k="50 W/(m*K)", A="2 cm**2", L="50 mm")  # Fourier, Incropera (1.2)
    carries("Convection", 8*0.3*(T_A - T_B), h="8 W/(m**2*K)", A="0.3 m**2")                 # Newton, Incropera (1.3a)
    carries("ThermalResistance", (T_A - T_B)/1.2, R="1.2 K/W")                               # Incropera (3.6)


@checks("HeatRadiation")
def test_radiation() -> None:
    h, c, k = 6.62607015e-34, 299792458.0, 1.380649e-23  # exact in the SI
    sigma = 2*np.pi**5*k**4/(15*h**3*c**2)
    carries("HeatRadiation", 0.9*sigma*0.5*(T_A**4 - T_B**4), 1e-6, A="0.5 m**2", epsilon=0.9)


@checks("NaturalConvection")
def test_natural_convection_follows_one_source() -> None:
    # air at 300 K, Incropera table A.4; Nu = 0.1 Ra**(1/3), eq. (9.24) with n = 1/3, from which the height drops out
    k, nu, Pr, g = 26.3e-3, 15.89e-6, 0.707, 9.81
    difference = np.array([2.0, 20, 60, -15])
    h = 0.1*k*(g/300*np.abs(difference)*Pr/nu**2)**(1/3)
    law = part("NaturalConvection", A="2 m**2", dT_t="1e-6 K")
    found = law({"a.T": 300 + difference, "b.T": 300})
    agree(found["a.Q"], h*2*difference, 5e-3)  # h_1 has three figures
    agree(found["b.Q"], -found["a.Q"])
    # the transition: at a difference of dT_t the coefficient is 2**(1/6) of the law's, at none it stays
    law = part("NaturalConvection", A="2 m**2", h_1="1.19 W/(m**2*K)")
    agree(law({"a.T": np.array([300.1, 299.9]), "b.T": 300})["a.Q"], np.array([1, -1])*1.19*2*0.1**(4/3)*2**(1/6), 1e-8)
    agree(law({"a.T": 300, "b.T": 300})["a.Q"], 0, size=1e-12)


@checks("HeatCapacity")
def test_heat_capacity() -> None:
    agree(part("HeatCapacity", m="2 kg", c="460 J/(kg*K)")({"a.T": 300, "a.Q": FLOWS})["der(a.T)"], FLOWS/920)


@checks("HeatStorage")
def test_heat_storage_is_a_capacity_behind_a_resistance() -> None:
    """A body of 6000 J/K behind 0.05 K/W: Incropera (5.7), tau = R*C."""
    found = part("HeatStorage", G="20 W/K", tau="300 s")({"a.T": T_A, "T": 310})
    agree(found["a.Q"], (T_A - 310)/0.05)
    agree(found["der(T)"], (T_A - 310)/0.05/6000)


@checks("ThermalWall")
def test_thermal_wall_is_a_capacity_between_two_resistances() -> None:
    """A capacity of 5000 J/K behind 0.05 K/W from a and 0.15 K/W from b; with r below 1 a resistance in parallel keeps the
    whole one."""
    R_a, R_b, C = 0.05, 0.15, 5000
    tau = f"{C*R_a*R_b/(R_a + R_b)} s"
    found = part("ThermalWall", R="0.2 K/W", r=1, x=-0.25, tau=tau)({"a.T": T_A, "b.T": 290, "T": 310})
    agree(found["a.Q"], (T_A - 310)/R_a)
    agree(found["b.Q"], (290 - 310)/R_b, size=1.0)
    agree(found["der(T)"], (found["a.Q"] + found["b.Q"])/C)
    found = part("ThermalWall", R="0.2 K/W", r=0.4, x=-0.25, tau="100 s")({"a.T": T_A, "b.T": 290, "T": 310})
    agree(found["a.Q"], 0.4*(T_A - 310)/R_a + 0.6*(T_A - 290)/0.2)


@checks("Ambient", "TemperatureSource", "HeatSource", "HeatFlowSensor", "TemperatureSensor")
def test_sources_and_sensors_are_what_they_define() -> None:
    agree(part("Ambient", T_0="25 degC")({"a.Q": FLOWS})["a.T"], 298.15)
    agree(part("TemperatureSource", u="300 K")({"a.Q": FLOWS, "u": 350})["a.T"], 350)
    agree(part("HeatSource")({"a.T": 300, "u": FLOWS})["a.Q"], -FLOWS)
    meter = part("HeatFlowSensor")({"a.Q": FLOWS, "a.T": 310})
    agree(meter["y"], FLOWS)
    agree(meter["b.Q"], -FLOWS)
    agree(meter["b.T"], 310)
    gauge = part("TemperatureSensor")({"a.T": T_A})
    agree(gauge["y"], T_A)
    agree(gauge["a.Q"], 0, size=1e-30)


@checks("HeatFlowCurveOfDifference")
def test_heat_flow_curve() -> None:
    coefficients = np.array([3, -1, 4, 1, -5, 9, 2, -6, 5])*10.0
    heights = {f"Q_{k + 1}": c for k, c in enumerate(coefficients)}
    law = part("HeatFlowCurveOfDifference", dT_0="10 K", dT_r="80 K", **heights)
    positions = np.linspace(-3.75, 3.75, 31)
    expected = cubic_spline(positions, coefficients)
    found = law({"a.T": 310 + positions*20, "b.T": 300})
    agree(found["a.Q"], expected, size=10)
    agree(found["b.Q"], -found["a.Q"])
    ends = law({"a.T": 310 + np.array([-9, -4, 4, 9])*20, "b.T": 300})["Q"]
    agree(ends[[0, 3]], ends[[1, 2]])  # beyond the range it keeps its value
