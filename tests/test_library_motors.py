"""Motors, inverters, soft start and ejector: their laws from phases, phasors and data sheets, and their examples."""

from __future__ import annotations

import numpy as np
import pytest
from examples import Array, Case, check
from library_check import agree, checks, part
from pneumatics_reference import R as R_AIR
from pneumatics_reference import integrated, iso

PI = np.pi
LAW = "network equations; nothing is integrated"


def park(angle: float) -> Array:
    """Power-invariant transformation (3, 3) of phases a, b, c to d, q and zero at an electrical angle."""
    turned = angle - np.array([0, 2*PI/3, -2*PI/3])
    return np.sqrt(2/3)*np.array([np.cos(turned), -np.sin(turned), np.full(3, np.sqrt(0.5))])


def synchronous(t: Array) -> Array:
    """Currents (2, N) in d and q at constant speed: a linear system of two states, by its eigenvalues."""
    R, L_d, L_q, psi, w = 1.2, 8e-3, 11e-3, 1.1/(np.sqrt(3)*4), 4*50*PI
    a = np.array([[-R/L_d, w*L_q/L_d], [-w*L_d/L_q, -R/L_q]])
    final = np.linalg.solve(a, -np.array([0, (200 - w*psi)/L_q]))
    values, vectors = np.linalg.eig(a)
    share = np.linalg.solve(vectors, -final)
    return np.asarray((final[:, None] + vectors @ (share[:, None]*np.exp(values[:, None]*t))).real)


def equivalent_circuit(slip: float) -> tuple[float, float]:
    """Rms current and torque of the induction motor of the example by the phasors of one phase."""
    w = 100*PI
    rotor = 1.4/slip + 1j*w*6e-3
    cross = 1j*w*170e-3
    stator = 400/np.sqrt(3)/(1.4 + 1j*w*6e-3 + rotor*cross/(rotor + cross))
    return abs(stator), 3*abs(stator*cross/(rotor + cross))**2*1.4/slip/(w/2)


def filled(t: Array) -> Array:
    """10 L at constant temperature behind the throttle and, above half of 7 bar, the main seat of a soft start valve."""
    def rate(time: float, y: Array) -> list[float]:
        opening = min(max((y[0]/7e5 - 0.5)/0.05, 0), 1)
        return [R_AIR*293.15/0.01*iso(0.4e-8 + 6e-8*opening, 0.3, 7e5, min(y[0], 7e5))]
    return integrated(rate, [1.013e5], t)[0]


RIPPLE = 0.25*0.5e-3/2.5e-3, 0.5e-3/2.5e-3   # pulse and period over the time constant
ELECTRICAL = [
    Case("synchronous_motor", "motor.i_d", lambda t: synchronous(t)[0], "eigenvalues", 1e-6),
    Case("synchronous_motor", "motor.i_q", lambda t: synchronous(t)[1], "eigenvalues", 1e-6),
    Case("induction_motor", "motor.M", lambda t: equivalent_circuit(0.04)[1], "phasors of a phase", 1e-5, 0.55),
    Case("induction_motor", "sqrt((motor.i_a**2 + motor.i_b**2)/3)", lambda t: equivalent_circuit(0.04)[0],
         "phasors of the equivalent circuit", 1e-5, 0.55),
    Case("stepper_motor", "1*shaft.phi", lambda t: (PI/3 - PI/4)/50 + 0*t,
         "half of the holding torque at cos = 1/2", 1e-6, 0.9),
    Case("averaged_inverter", "sqrt(d.v**2 + q.v**2)", lambda t: 0.5*560/np.sqrt(2)*20/20.1 + 0*t, LAW, 1e-5),  # band y_t
    Case("averaged_inverter", "-link.a.i", lambda t: (0.5*560/np.sqrt(2))**2/20.1/560 + 20/560 + 0*t, LAW, 1e-5),
    Case("half_bridge", "1*coil.i", lambda t: 12*(np.exp(RIPPLE[0]) - 1)/(np.exp(RIPPLE[1]) - 1)*(1 - np.exp(-t/2.5e-3)),
         "the sum of all pulses before the begin of a period", 1e-6),
]
PNEUMATIC = [
    Case("soft_start_valve", "1*system.p", filled, "isothermal filling by ISO 6358, laminar in the last thousandth", 1e-3),
    Case("ejector", "vacuum.p - 16325 Pa",
         lambda t: 0.85e5*np.exp(-R_AIR*293.15/2e-3*0.8e-3/0.85e5*t), "linear suction", 2e-6),
    Case("ejector", "1*ejector.m", lambda t: 0.25e-8*1.185*6.01325e5 + 0*t, "choked nozzle", 1e-6),
]


@pytest.mark.parametrize("case", [*ELECTRICAL, *PNEUMATIC], ids=lambda case: f"{case.example}-{case.signal}")
def test_the_example_shows_the_law(case: Case) -> None:
    check(case)


@checks("SynchronousMotor")
def test_synchronous_motor_is_its_three_phases() -> None:
    """Flux of the phases C'(L i + psi) by differences over time; torque by the balance of power; k_T by the rms value."""
    # the third row is that of the zero current, which is not there
    R, L, psi, z_p, w, angle = 0.8, np.diag([5e-3, 9e-3, 1e-3]), 0.9/(np.sqrt(3)*3), 3, 120.0, 0.7
    law = part("SynchronousMotor", R="0.8 ohm", L_d="5 mH", L_q="9 mH", k_T="0.9 N*m/A", z_p=3, J="1e-3 kg*m**2")
    i, v = np.array([-2.0, 7.0]), np.array([40.0, 110.0])
    found = law({"i_d": i[0], "i_q": i[1], "d.v": v[0] + 5, "q.v": v[1] + 5, "n.v": 5.0, "s.w": w, "der(s.w)": 0.0})
    rates = np.array([float(found["der(i_d)"]), float(found["der(i_q)"])])

    def flux(t: float) -> Array:
        return park(angle + z_p*w*t).T @ (L @ np.array([*(i + rates*t), 0]) + np.array([psi, 0, 0]))
    e = 1e-6
    phases = park(angle).T @ np.array([*i, 0])
    agree(park(angle) @ (R*phases + (flux(e) - flux(-e))/(2*e)), [*v, 0], 1e-7, size=100)
    stored = L[0, 0]*i[0]*rates[0] + L[1, 1]*i[1]*rates[1]
    agree(-found["s.tau"]*w, v @ i - R*i @ i - stored)
    agree([found["d.i"], found["q.i"], found["n.i"]], [i[0], i[1], -i.sum()])
    rms = 4.0    # a symmetrical current in the quadrature axis gives its rms value times k_T
    current = park(0.3) @ (-np.sqrt(2)*rms*np.sin(0.3 - np.array([0, 2*PI/3, -2*PI/3])))
    agree(current, [0, np.sqrt(3)*rms, 0], size=1)
    agree(law({"i_d": 0.0, "i_q": current[1], "d.v": 0.0, "q.v": 0.0, "n.v": 0.0, "s.w": 0.0,
               "der(s.w)": 0.0})["M"], 0.9*rms)


@checks("InductionMotor")
def test_induction_motor_in_complex_numbers() -> None:
    law = part("InductionMotor", R_s="2 ohm", R_r="1.5 ohm", L_s="8 mH", L_r="9 mH", L_m="0.2 H", z_p=2, J="0.02 kg*m**2")
    i, j, v, w = 5 + 3j, -4 - 1j, 200 - 80j, 140.0
    found = law({"i_a": i.real, "i_b": i.imag, "j_a": j.real, "j_b": j.imag, "a.v": v.real + 7,
               "b.v": v.imag + 7, "n.v": 7.0,
                 "s.w": w, "der(s.w)": 0.0})
    flux = 0.209*j + 0.2*i
    rates = np.linalg.solve([[0.208, 0.2], [0.2, 0.209]], [v - 2*i, -1.5*j + 2j*w*flux])
    agree([found["der(i_a)"], found["der(i_b)"]], [rates[0].real, rates[0].imag])
    agree([found["der(j_a)"], found["der(j_b)"]], [rates[1].real, rates[1].imag])
    torque = 2*0.2*(i*np.conj(j)).imag
    agree([found["M"], found["s.tau"]], [torque, -torque])
    agree([found["a.i"], found["b.i"], found["n.i"]], [5, 3, -8])
    # the power of the stator: losses, magnetic energy, shaft
    stored = (np.conj(i)*(0.208*rates[0] + 0.2*rates[1]) + np.conj(j)*(0.2*rates[0] + 0.209*rates[1])).real
    agree((v*np.conj(i)).real, 2*abs(i)**2 + 1.5*abs(j)**2 + stored + torque*w)


@checks("StepperMotor")
def test_stepper_motor_by_its_data_sheet() -> None:
    law = part("StepperMotor", R="1 ohm", L="2 mH", M_h="1.2 N*m", I_r="2 A", n=200, M_d="0.05 N*m", J="1e-4 kg*m**2",
               d_v="0.01 N*m*s/rad")
    phi, w = np.linspace(0, 2*PI/50, 7201), 30.0
    still = {"a.v": 9.0, "b.v": 1.0, "c.v": 3.0, "d.v": 0.0, "s.w": w, "der(s.w)": 0.0}
    found = law({"i_1": 2.0, "i_2": 2.0, "s.phi": phi, **still})
    without = np.asarray(found["M"]) + 0.05*np.sin(200*phi)
    agree(without.max(), 1.2, 1e-6)                        # the holding torque, both phases on
    agree(found["s.tau"], 0.01*w - np.asarray(found["M"]))
    back = [8 - 2 - 2e-3*np.asarray(found["der(i_1)"]), 3 - 2 - 2e-3*np.asarray(found["der(i_2)"])]
    agree(2*back[0] + 2*back[1], without*w, 1e-8, size=10)  # the back-EMF takes the power of the torque
    agree([found["a.i"], found["b.i"], found["c.i"], found["d.i"]], np.array([2, -2, 2, -2])[:, None])

    def rest(first: float, second: float) -> float:
        torque = np.asarray(law({"i_1": first, "i_2": second, "s.phi": phi, **still})["M"])
        return float(phi[:-1][(torque[:-1] > 0) & (torque[1:] <= 0)][0])
    positions = [rest(*signs) for signs in ((2, -2), (2, 2), (-2, 2))]
    agree((np.diff(positions) + PI/100) % (PI/25) - PI/100, PI/100, 2e-3)   # forwards by 1.8 degrees, to the grid


@checks("AveragedInverter")
def test_averaged_inverter() -> None:
    law = part("AveragedInverter", R="0.2 ohm", P_0="30 W", U_r="500 V", y_t=1e-9)
    u = np.array([[0.3, 0.6, -1.2], [0.4, -0.8, 1.6]])     # half, full and twice the amplitude
    found = law({"u_d": u[0], "u_q": u[1], "a.v": 610.0, "b.v": 10.0, "n.v": 3.0, "d.i": -5.0, "q.i": 2.0})
    ideal = u/np.array([1, 1, 2])*600/np.sqrt(2)
    agree([found["d.v"] - 3, found["q.v"] - 3], ideal + 0.2*np.array([[-5], [2]]), 1e-8)
    agree(600*found["a.i"], -ideal[0]*-5 - ideal[1]*2 + 30*(600/500)**2, 1e-8)
    agree(found["a.i"] + found["b.i"], 0, size=1)
    agree(found["n.i"], 3)
    # full modulation is the linear range of space vector modulation: a line voltage with the amplitude of the DC voltage
    agree(np.hypot(ideal[0, 1], ideal[1, 1])*np.sqrt(2), 600)


@checks("HalfBridge")
def test_half_bridge() -> None:
    on = np.array([1.0, 0.0])
    found = part("HalfBridge", T_s="1 ms", R="0.1 ohm", u=0.5)({"on": on, "a.v": 48.0, "b.v": 2.0, "c.i": -4.0})
    agree(found["c.v"], [48 - 0.4, 2 - 0.4])
    agree(found["a.i"], [4, 0])
    agree(found["b.i"], [0, 4])


@checks("SoftStartValve", "Ejector")
def test_soft_start_valve_and_ejector() -> None:
    found = part("SoftStartValve", C="6 L/(s*bar)", C_s="0.5 L/(s*bar)")(
        {"a.p": 8e5, "a.T": 293.15, "b.p": np.array([2e5, 4.2e5, 6e5]), "b.T": 293.15})
    agree(found["a.m"], [iso(C*1e-8, 0.3, 8e5, p) for C, p in ((0.5, 2e5), (0.5 + 6*0.5, 4.2e5), (6.5, 6e5))], 2e-3)
    agree(found["b.m"], -found["a.m"])
    law = part("Ejector", C="0.3 L/(s*bar)", m_0="1 g/s", p_v="0.9 bar", G="1e-9 W/K")
    vacuum = np.array([1.013e5, 0.563e5, 0.113e5, 0.05e5])   # none, half, all and below
    found = law({"P.p": 6.013e5, "P.T": 310.0, "V.p": vacuum, "V.T": 290.0, "R.p": 1.013e5, "R.T": 300.0})
    nozzle = 0.3e-8*1.185*6.013e5*np.sqrt(293.15/310)
    agree(found["P.m"], nozzle, 1e-6)
    agree(found["V.m"], [1e-3, 0.5e-3, 0, 0], size=1e-3)
    agree(found["R.m"], -found["P.m"] - found["V.m"])
    agree(found["R.H"], -1005*(nozzle*310 + found["V.m"]*290), 1e-6)
    # at half of the supply there is half of the flow and of the vacuum
    vacuum = 1.013e5 - np.array([0, 0.45e5])
    found = law({"P.p": 3.513e5, "P.T": 293.15, "V.p": vacuum, "V.T": 290.0, "R.p": 1.013e5, "R.T": 293.15})
    agree(found["V.m"], [0.5e-3, 0], size=1e-3)
