"""Every signal component in a small example, beside its closed form."""

from __future__ import annotations

import numpy as np
import pytest
import test_library_drives as drives
from examples import Array, Case, check, without_example
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator, RegularGridInterpolator
from scipy.signal import lfilter, step

import heavebond as hb
from heavebond.language.symbols import uniform

PI = np.pi
LAW = "the law itself; nothing is integrated"
RUN = "closed form; 1e-6 for the integration"


def u(t: Array) -> Array:
    """The input of most examples, V."""
    return 2*np.sin(2*PI*t)


def fed_back(t: Array) -> Array:
    """States of x' = A x + B u from rest for u_1 = 1 and u_2 = -0.5 x_1 + 0.25 x_2."""
    a = np.array([[-1, 0], [1 - 0.5, -2 + 0.25]])
    values, vectors = np.linalg.eig(a)
    final = -np.linalg.solve(a, [1, 0])
    share = np.linalg.solve(vectors, -final)
    return np.asarray(final[:, None] + vectors @ (share[:, None]*np.exp(np.outer(values, t))))


def jerks(t: Array) -> Array:
    """Acceleration, speed and position (3, N) of the motion sequence by exact integration of its jerk between the knots.

    400 mm reach 0.5 m/s and 2 m/s**2: a/j = 0.1 s of jerk, v/a - a/j = 0.15 s, 0.4/0.5 - 0.35 = 0.45 s. 150 mm do not
    reach v: x = T_a + 3/2 T_j with 2 m/s**2 (x**2 - T_j**2/4) = 0.15 m. 5 mm have jerk only, 0.05 s."""
    knots, jerk, begin = [0.0], [0.0], 0.1
    for sign, t_j, t_a, t_v, dwell in ((1, 0.1, 0.15, 0.45, 0.2), (-1, 0.1, np.sqrt(0.0775) - 0.15, 0, 0),
                                       (1, 0.05, 0, 0, 0)):
        lengths = [t_j, t_a, t_j, t_v, t_j, t_a, t_j]
        knots += [*(begin + np.cumsum([0, *lengths]))]
        jerk += [*(20*sign*np.array([1, 0, -1, 0, -1, 0, 1, 0]))]
        begin = knots[-1] + dwell
    at, values = np.zeros(3), np.zeros((3, len(t)))
    for k, t_0 in enumerate(knots):
        end = knots[k + 1] if k + 1 < len(knots) else np.inf
        d, inside = np.minimum(t, end) - t_0, (t >= t_0)
        b, w, y = at
        each = np.array([b + jerk[k]*d, w + b*d + jerk[k]*d**2/2, y + w*d + b*d**2/2 + jerk[k]*d**3/6])
        values[:, inside] = each[:, inside]
        h = end - t_0
        at = np.array([b + jerk[k]*h, w + b*h + jerk[k]*h**2/2, y + w*h + b*h**2/2 + jerk[k]*h**3/6]) if h < np.inf else at
    return values


def sampled(t: Array, period: float) -> Array:
    """What u was at the last sample; an output at a sample shows the new one."""
    return u(period*np.floor(t/period + 1e-9))


def sample_number(t: Array, period: float) -> NDArray[np.int_]:
    """The number of the last sample, 0 for that at 0 s."""
    return np.floor(t/period + 1e-9).astype(int)


def filtered(t: Array) -> Array:
    """The step response by SciPy's filter, held between samples."""
    response = lfilter([0, 1, 0.5], [1, -1.8*np.cos(PI/4), 0.81], np.full(51, 2.0))
    return np.asarray(response[sample_number(t, 0.02)])


def discrete_pid(t: Array) -> Array:
    """The algorithm of the component as a program: K_p 2, K_i 8, K_d 0.1, T_f 20 ms, T_t 0.1 s, sampled every 20 ms."""
    q, d, before, found = 0.0, 0.0, 1.0, []
    for k in range(51):
        e = 1.0 if k < 25 else 0.0
        d = 0.02/0.04*d + 0.1/0.04*(e - before)
        w = 2*e + q + d
        found.append(np.clip(w, -4, 4))
        q += 8*0.02*e + 0.02*8/max(8*0.1, 2/20)*(found[-1] - w)
        before = e
    return np.array(found)[sample_number(t, 0.02)]


def wichmann_hill(seed: int, n: int) -> tuple[Array, Array]:
    """Pairs of successive numbers of the generator AS 183 with the first states that the components take."""
    state = [1 + int((m - 1)*uniform(seed, i)) for i, m in enumerate((30269, 30307, 30323), 1)]
    found = []
    for _ in range(2*n):
        found.append(sum(s/m for s, m in zip(state, (30269, 30307, 30323), strict=True)) % 1)
        state = [a*s % m for a, s, m in zip((171, 172, 170), state, (30269, 30307, 30323), strict=True)]
    return np.array(found[::2]), np.array(found[1::2])


def gaussian(seed: int, n: int) -> Array:
    """By Box and Muller."""
    first, second = wichmann_hill(seed, n)
    return np.sqrt(-2*np.log(first))*np.sin(2*PI*second)


def kept_samples(t: Array) -> Array:
    """4 V/s times the time of the last sample that was not lost, of samples every 10 ms."""
    kept = np.where(wichmann_hill(1, 101)[0] < 0.2, -1, np.arange(101))
    return 4*0.01*np.maximum(np.maximum.accumulate(kept), 0)[sample_number(t, 0.01)]


def within(t: Array, begin: float, end: float) -> Array:
    """1 from begin to end of each second."""
    return ((np.mod(t + 1e-9, 1) >= begin) & (np.mod(t + 1e-9, 1) < end)).astype(float)


def chirp(t: Array) -> Array:
    """Phase as the integral of the frequency, which is piecewise linear: the trapezium rule is exact."""
    grid = np.union1d(t, [2.0])
    f = np.minimum(1 + 2*grid, 5)
    cycles = np.concatenate(([0], np.cumsum(np.diff(grid)*(f[1:] + f[:-1])/2)))
    return 2*np.sin(2*PI*np.interp(t, grid, cycles))


def heave_behind_a_filter(t: Array) -> Array:
    """T z' + z = sin(w t) from z = 0."""
    w, T = 2*np.pi/8, 0.2
    return (np.sin(w*t) - w*T*np.cos(w*t) + w*T*np.exp(-t/T))/(1 + (w*T)**2)


def second_order(t: Array) -> Array:
    w, zeta = 4*PI, 0.3
    own = w*np.sqrt(1 - zeta**2)
    return 2*(1 - np.exp(-zeta*w*t)*(np.cos(own*t) + zeta*w/own*np.sin(own*t)))


def pid(t: Array) -> Array:
    """K_p 2, K_i 1, K_d 0.1 on an error of 1 mm: the same equations by another solver."""
    def rates(_: float, y: Array) -> Array:
        w = 2 + y[1] + 0.1*(1 - y[0])/0.01
        return np.array([(1 - y[0])/0.01, 1 + (np.clip(w, -10, 10) - w)/0.2])
    z, q = solve_ivp(rates, (0, 1), [0, 0], t_eval=t, rtol=1e-10, atol=1e-12, max_step=1e-3).y
    return np.asarray(np.clip(2 + q + 10*(1 - z), -10, 10))


def trapezium(t: Array) -> Array:
    """1 m with 1 m/s**2 up to 0.5 m/s, from 0.2 s on."""
    s = np.clip(t - 0.2, 0, 2.5)
    return np.where(s < 0.5, s**2/2, np.where(s < 2, 0.125 + 0.5*(s - 0.5), 1 - (2.5 - s)**2/2))


def share(t: Array) -> Array:
    return np.clip((t - 0.2)/2, 0, 1)


def sea(t: Array) -> Array:
    """Forty sines at the middle of equal parts of the energy of a Pierson-Moskowitz spectrum, shaken within half of their
    part, and enhanced around the peak."""
    i = np.arange(1, 41)
    shaken, phase = (np.array([uniform(7, int(k)) for k in i + n]) for n in (0, 40))
    r = (1.25/-np.log((i - 0.75 + 0.5*shaken)/40))**0.25
    weight = 3.3**(0.5*np.exp(-0.5*((r - 1)/0.08)**2))
    waves = weight*np.sin(2*PI*(t[:, None]/10*r + phase))
    return (1 - np.exp(-(t/4)**3))*2/4*np.sqrt(2/40*(1 - 0.287*np.log(3.3)))*waves.sum(axis=1)


def ship(t: Array) -> Array:
    """Twenty sines of a sea as above, each with the complex response between those of the table."""
    i = np.arange(1, 21)
    shaken, phase = (np.array([uniform(7, int(k)) for k in i + n]) for n in (0, 20))
    r = (1.25/-np.log((i - 0.75 + 0.5*shaken)/20))**0.25
    weight = 3.3**(0.5*np.exp(-0.5*((r - 1)/0.08)**2))
    table = np.array([[1.04, 0.97], [1.28, 0.22], [0.14, 0.003]])*np.exp(1j*np.array([[0, 0], [-0.4, -0.4], [-2.3, 0.8]]))
    row = table[:, 0] + (table[:, 1] - table[:, 0])*30/90
    omega = 2*PI/10*r
    response = np.interp(omega, [0.2, 0.5, 1], row.real) + 1j*np.interp(omega, [0.2, 0.5, 1], row.imag)
    waves = np.imag(weight*response*np.exp(1j*(omega*t[:, None] + 2*PI*phase)))
    return (1 - np.exp(-(t/4)**3))*2/4*np.sqrt(2/20*(1 - 0.287*np.log(3.3)))*waves.sum(axis=1)


def rolling_ship(t: Array) -> Array:
    """Twenty sines of the same sea, each from one of the directions around 180 degrees, by the quantiles of a histogram."""
    i, m, s = np.arange(1, 21), 12, 5
    shaken, phase = (np.array([uniform(7, int(k)) for k in i + n]) for n in (0, 20))
    r = (1.25/-np.log((i - 0.75 + 0.5*shaken)/20))**0.25
    weight = 3.3**(0.5*np.exp(-0.5*((r - 1)/0.08)**2))
    limits = 2*np.arccos(0.001**(0.5/s))*np.linspace(-1, 1, m + 1)
    energy = np.cumsum(np.cos((limits[1:] + limits[:-1])/4)**(2*s))
    share = np.mod(i*(np.sqrt(5) - 1)/2 + uniform(7, 41), 1)
    place = np.degrees(PI + np.interp(share, [0, *energy/energy[-1]], limits))
    omega = 2*PI/10*r
    abeam = np.array([0.01j, 0.04*np.exp(1j*PI/3), 0.03*np.exp(-7j*PI/18)])
    response = (np.interp(omega, [0.2, 0.5, 1], abeam.real) + 1j*np.interp(omega, [0.2, 0.5, 1], abeam.imag)) \
        * np.interp(place, [0, 90, 180, 270, 360], [0, 1, 0, -1, 0])
    waves = np.imag(weight*response*np.exp(1j*(omega*t[:, None] + 2*PI*phase)))
    return (1 - np.exp(-(t/4)**3))*2/4*np.sqrt(2/20*(1 - 0.287*np.log(3.3)))*waves.sum(axis=1)


MAP = RegularGridInterpolator(([0, 1000, 2000], [0, 100]), [[0.5, 0.6], [0.8, 0.9], [0.7, 0.95]])
ORDERS = np.arange(1, 11)

CASES = [
    Case("constant", "part.y", lambda t: 5 + 0*t, LAW),
    Case("sine", "part.y", lambda t: 1 + 2*np.sin(4*PI*t + PI/6), LAW),
    Case("step", "part.y", lambda t: np.where(t < 0.305, 1, 3), LAW),
    Case("ramp", "part.y", lambda t: 1 + 4*(np.clip(t, 0.2, 0.7) - 0.2), LAW),
    Case("chirp", "part.y", chirp, "sine of the integral of the frequency"),
    Case("multisine", "part.y", lambda t: np.sqrt(0.2)*np.cos(
        2*PI*ORDERS*t[:, None] - PI*ORDERS*(ORDERS - 1)/10).sum(axis=1), LAW),
    Case("square_wave", "part.y", lambda t: 5.0*(np.mod(t + 1e-9, 0.4) < 0.1), LAW),
    Case("pulse", "part.y", lambda t: 5.0*((t > 0.3 - 1e-9) & (t < 0.55)), LAW),
    Case("table_source", "part.y", lambda t: np.interp(t, [0.1, 0.3, 0.6, 0.8], [0, 2, 2, -1]), "np.interp"),
    Case("lookup", "part.y", lambda t: np.interp(u(t), [-1, 0, 1, 2], [-10, 0, 5, 20])/6e4, "np.interp"),
    Case("step_lookup", "part.y", lambda t: np.where(t < 6*3600, 0.2, np.where(
        t < 20*3600, 0.5 + 0.1*(t/3600 - 6)/14, 0.3 - 0.1*(t/3600 - 20)/4)), "straight lines between steps"),
    Case("monotone_lookup", "part.y", PchipInterpolator([0, 1, 2, 4, 5], [0, 0.1, 2, 2.2, 2.2]),
         "SciPy's PchipInterpolator, the same slopes"),
    Case("lookup2", "part.y", lambda t: MAP(np.column_stack((2000*t, 100*(1 - t)))), "SciPy's RegularGridInterpolator"),
    Case("record", "part.y", lambda t: np.interp(t, [0, 0.5, 1.5, 2], [0, 0.02, -0.01, 0.03]), "np.interp"),
    Case("gain", "part.y", lambda t: 6/6e4*u(t), LAW),
    Case("sensor_gain", "part.y", lambda t: 1.05*u(t), LAW),
    Case("sensor_offset", "part.y", lambda t: u(t) + 0.3, LAW),
    Case("sensor_drift", "part.y", lambda t: u(t) + 0.4*t, LAW),
    Case("curved_gain", "part.y", lambda t: u(t)*np.abs(u(t))/2, LAW),
    Case("sided_gain", "part.y", lambda t: np.abs(u(t)), LAW),
    Case("sum", "part.y", lambda t: 3 - u(t), LAW),
    Case("product", "part.y", lambda t: 3*u(t), LAW),
    Case("division", "part.y", lambda t: 6/(2 + np.sin(2*PI*t)), LAW),
    Case("integrator", "part.y", lambda t: 1 + 3*2*(1 - np.cos(2*PI*t))/(2*PI), RUN),
    Case("filtered_derivative", "part.y", lambda t: 4*(1 - np.exp(-t/0.1)), RUN),
    Case("first_order_lag", "part.y", lambda t: 2*(1 - np.exp(-t/0.2)), RUN),
    Case("motion_reference_unit", "part.z", heave_behind_a_filter, RUN),
    Case("second_order_lag", "part.y", second_order, RUN),
    Case("transfer_function", "part.y", lambda t: 1.5 - 2*np.exp(-t) + 0.5*np.exp(-2*t), "partial fractions"),
    Case("state_space", "part.y", lambda t: 2*(1 - 2*np.exp(-t) + np.exp(-2*t)), "partial fractions"),
    # both loops in one: A + B F with the feedback F of the second input
    Case("linear_system", "outputs[3]", lambda t: fed_back(t).sum(axis=0), "matrix exponential"),
    Case("linear_system", "outputs[2]", lambda t: fed_back(t)[1], "matrix exponential"),
    Case("matrix_gain", "loads[2]", lambda t: -15*np.sin(2*PI*t) + 40*np.cos(2*PI*t), LAW),
    Case("state_space22", "part.y_1", lambda t: 2*(1 - np.exp(-t)), "partial fractions"),
    Case("state_space22", "part.y_2", lambda t: 2.5 - 2*np.exp(-t) - 0.5*np.exp(-2*t), "partial fractions"),
    Case("saturation", "part.y", lambda t: np.clip(u(t), -1, 1.5), LAW),
    Case("linear_variation", "part.factor", lambda t: 1 + 0.4*np.clip(u(t), -1, 1), LAW),
    Case("piecewise_variation", "part.factor",
         lambda t: 1 + np.interp(u(t), [-2, -1, 0, 1, 2], [0.4, 0.1, 0, -0.2, 1]), LAW),
    Case("bent_variation", "part.factor", lambda t: 1 + np.where(u(t) > 0, 0.5, -0.1)*u(t), LAW),
    Case("step_variation", "part.factor", lambda t: 1 - 0.1*(1 + np.tanh((t - 0.5)/0.01)), LAW),
    Case("onset", "part.factor", lambda t: (1 + np.tanh((t - 0.5)/0.01))/2, LAW),
    Case("variation_by_direction", "part.factor", lambda t: 1 + 0.3*np.tanh(u(t)/0.04), LAW),
    Case("dead_band", "part.y", lambda t: u(t) - np.clip(u(t), -0.5, 0.5), LAW),
    Case("rate_limit", "part.y", lambda t: 3*t, "the limit; 1e-5 for what the smoothing takes near the end", 1e-5),
    # sin reaches 1/2 at 1/12 s, and falls through -1/4 after half a period
    Case("sequencer", "1*part.y",
         lambda t: np.array([0, 5, -10])[np.searchsorted([0.2, 1.4, 2, 2.2, 3.4, 4], t + 1e-9) % 3],
         "timing diagram", 1e-9),
    Case("state_machine", "part.y",  # ready, up, rest, down, up, rest, down, up, rest, stopped
         lambda t: np.array([0, 0.4, 0, -0.2, 0.4, 0, -0.2, 0.4, 0, 0])[
             np.searchsorted([1e-6, 1, 1.5, 2, 3, 3.5, 4, 5, 5.2], t + 1e-9)], "timing diagram", 1e-9),
    Case("relay", "part.y", lambda t: 24*within(t, 1/12, 0.5 + np.arcsin(0.25)/(2*PI)), LAW),
    Case("comparator", "part.y", lambda t: within(t, 1/12, 5/12), LAW),
    Case("switch", "part.y", lambda t: np.where(within(t + 0.3/(2*PI), 0, 0.5) == 1, 3, -t), LAW),
    Case("delay", "part.y", lambda t: 4*np.maximum(t - 0.1, 0), "a ramp, constant before the start"),
    Case("pade_delay", "part.y", lambda t: 4*(t - 0.1), "a ramp, once exp(-50*t) is gone", 1e-6, 0.6),
    Case("delay_chain", "part.y", lambda t: 4*(t - 0.1), "a ramp, once exp(-200*t) is gone", 1e-6, 0.4),
    Case("quantiser", "part.y", lambda t: 0.1*np.round(sampled(t, 0.02)/0.1), "np.round of the samples"),
    Case("delayed_sample_hold", "part.y", lambda t: np.where(t < 0.02, 0, sampled(np.maximum(t - 0.02, 0), 0.05)), LAW),
    Case("sample_hold", "part.y", lambda t: sampled(t, 0.05), LAW),
    Case("unit_delay", "part.y", lambda t: sampled(np.maximum(t - 0.05, 0), 0.05), LAW),
    Case("first_order_hold", "part.y", lambda t: sampled(t, 0.05) + np.where(t < 0.05 - 1e-9, 0, (
        sampled(t, 0.05) - sampled(np.maximum(t - 0.05, 0), 0.05))/0.05)*(t - 0.05*sample_number(t, 0.05)), LAW),
    Case("enabled_sample_hold", "part.y", lambda t: np.where(t < 0.3 - 1e-9, 0, sampled(np.minimum(t, 0.58), 0.02)), LAW),
    # the trigger rises through 0.5 at a quarter of each period
    Case("triggered_sample_hold", "part.y", lambda t: 4*np.maximum(0.05 + 0.2*np.floor((t - 0.05)/0.2 + 1e-9), 0), LAW,
         1e-9),
    Case("discrete_transfer_function", "part.y", filtered, "SciPy's lfilter", 1e-12),
    Case("discrete_state_space", "outputs[1]", lambda t: 3*(0.1*sample_number(t, 0.1))**2/2, "a parabola at the samples"),
    Case("predictive_controller", "control.y[1]", lambda t: -np.minimum(0.1*sample_number(t, 0.1), 0.5),
         "the least rate until the least command", 1e-9),
    Case("scheduled_pid", "control.y", lambda t: 1 + 2*np.clip((10*t - 2)/4, 0, 1) + 2*t,
         "a gain that rises from 1 to 3 V/m between 2 and 6 bar, and the integral of 2 V/(m s); 1e-6 for the integration"),
    Case("discrete_pid", "part.y", discrete_pid, "the algorithm in Python", 1e-12),
    Case("discrete_switchable_pid", "part.y",
         lambda t: 3 + 0.5*0.05*np.maximum(sample_number(t, 0.05) - 20, 0), "the integral from the change at 1 s on", 1e-12),
    Case("discrete_low_pass", "part.y", lambda t: np.where(t < 0.2 - 1e-9, 0, 2*(
        1 - np.exp(-0.02*(sample_number(t, 0.02) - 9)/0.1))), "step response of a lag, one sample ahead", 1e-12),
    Case("moving_average", "part.y", lambda t: 4*0.02*np.where(sample_number(t, 0.02) < 4, sample_number(t, 0.02)/2,
                                                               sample_number(t, 0.02) - 2), "the mean of a straight line"),
    Case("analog_digital_converter", "part.y", lambda t: 0.1*np.round(np.clip(sampled(t, 0.02), 0, 1.5)/0.1), LAW),
    Case("white_noise", "part.y", lambda t: 2e4*gaussian(3, 1001)[sample_number(t, 1e-3)], "the generator in Python", 1e-9),
    Case("random_walk", "part.y", lambda t: 0.01*np.sqrt(1e-3)*np.cumsum(gaussian(3, 1001))[sample_number(t, 1e-3)],
         "the generator in Python", 1e-9),
    Case("lossy_sample_hold", "part.y", kept_samples, "the generator in Python"),
    Case("on_delay", "part.y", lambda t: 1.0*((np.mod(t - 0.1, 0.5) > 0.2 - 1e-9) & (np.mod(t - 0.1, 0.5) < 0.3 - 1e-9)
                                              & (t > 0.1)), "timing diagram"),
    Case("timer", "part.y", lambda t: np.where((t > 0.1) & (np.mod(t - 0.1, 0.5) < 0.3 - 1e-9), np.mod(t - 0.1, 0.5), 0),
         "timing diagram", 1e-9),
    Case("flip_flop", "part.y", lambda t: 1.0*((t > 0.2 - 1e-9) & (t < 0.7 - 1e-9)), "timing diagram"),
    Case("counter", "part.y", lambda t: np.floor((t + 0.1)/0.2 + 1e-9) - np.where(t > 0.65 - 1e-9, 3, 0), "timing diagram"),
    Case("edge_detector", "part.y", lambda t: 1.0*((t > 0.1 - 1e-9) & (np.mod(t - 0.1 + 1e-9, 0.4) < 0.05)),
         "timing diagram"),
    Case("minimum", "part.y", lambda t: np.minimum(1, u(t)), LAW),
    Case("maximum", "part.y", lambda t: np.maximum(1, u(t)), LAW),
    Case("absolute", "part.y", lambda t: np.abs(u(t)), LAW),
    Case("and", "part.y", lambda t: 1.0*((t > 0.205) & (t < 0.605)), LAW),
    Case("or", "part.y", lambda t: 1.0*((t > 0.605) | (t < 0.205)), LAW),
    Case("not", "part.y", lambda t: 1.0*(t <= 0.205), LAW),
    Case("pid", "part.y", pid, "SciPy's Runge-Kutta with steps of 1 ms; 1e-5 for the corner at the limit", 1e-5),
    Case("trapezoidal_motion", "part.y", trapezium, "parabola, line, parabola"),
    Case("trapezoidal_motion", "part.w", lambda t: np.clip(np.minimum(t - 0.2, 2.7 - t), 0, 0.5), "trapezium"),
    *(Case("motion_sequence", f"part.{name}", lambda t, row=row: jerks(t)[row], "the jerk of each motion, integrated thrice",
           1e-12) for row, name in enumerate("bwy")),
    *(Case("polynomial_sequence", f"part.{name}", lambda t, order=order: sum(
        way*np.polyval(np.polyder([6, -15, 10, 0, 0, 0], order), np.clip((t - begin)/T, 0, 1))/T**order
        for way, begin, T in ((0.4, 0.1, 1.0), (-0.25, 1.3, 0.5))), LAW) for order, name in enumerate("ywb")),
    Case("s_curve_motion", "part.y", lambda t: share(t) - np.sin(2*PI*share(t))/(2*PI), LAW),
    Case("s_curve_motion", "part.w", lambda t: (1 - np.cos(2*PI*share(t)))/2, "its derivative"),
    Case("polynomial_motion", "part.y", lambda t: np.polyval([6, -15, 10, 0, 0, 0], share(t)), LAW),
    Case("polynomial_motion", "part.w", lambda t: np.polyval([30, -60, 30, 0, 0], share(t))/2, "its derivative"),
    Case("regular_sea", "part.z", lambda t: (1 - np.exp(-(t/4)**3))*np.sin(2*PI*t/8), LAW),
    Case("irregular_sea", "part.z", sea, "the sum of sines in NumPy"),
    Case("sea_response", "part.z", ship, "the sum of responses in NumPy"),
    Case("short_crested_response", "part.z", rolling_ship, "the sum of responses in NumPy"),
    Case("heave_controller", "part.u", lambda t: np.clip(-0.3 - 1.5*np.sin(2*PI*t), -1, 1), LAW),
    Case("signal_curve", "part.y", lambda t: u(t)*1.1, "cubic splines reproduce the straight line 0.1 V per V"),
]


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.example}-{case.signal}")
def test_the_example_shows_the_law(case: Case) -> None:
    check(case)


def test_every_component_has_an_example() -> None:
    assert without_example(["signal"], [*CASES, *drives.SIGNALS]) == []


def test_a_multisine_has_its_rms_and_a_low_peak() -> None:
    wave = hb.simulate(hb.load("examples/multisine"))["part.y"][:1000]   # one period
    spectrum = np.abs(np.fft.rfft(wave))/1000
    assert np.sqrt(np.mean(wave**2)) == pytest.approx(1, rel=1e-9)
    assert spectrum[1:11] == pytest.approx(np.sqrt(0.2)/2, rel=1e-9)
    assert spectrum[11:] == pytest.approx(0, abs=1e-9)
    assert np.abs(wave).max() < 1.95   # ten sines in phase: 4.5


def test_a_rigid_mass_follows_a_motion_sequence_that_rests_where_two_positions_are_equal() -> None:
    """The force is m*b; 200 mm with 1 m/s, 4 m/s**2 and 40 m/s**3 take 4 T_j + 2 T_a with T_a + 3/2 T_j = sqrt(0.0525) s."""
    run = hb.simulate(hb.loads("""model: axis
components:
  part:  {is: MotionSequence, p: [0 m, 200 mm, 200 mm, 0 m], T_d: [0.1 s, 0.1 s, 0.1 s], v: 1 m/s, a: 4 m/s**2, j: 40 m/s**3}
  drive: {is: PositionSource, u: =part.y}
  mass:  {is: Mass, m: 2 kg}
nodes: {axis: [drive.a, mass.a]}
show: {F: {is: -drive.a.f, unit: N}, b: {is: part.b, unit: m/s**2}}
simulate: {until: 1.5 s, every: 5 ms}
"""))
    assert run["F"] == pytest.approx(2*run["b"], abs=1e-6)   # rounding of two derivatives
    assert np.abs(run["b"]).max() == pytest.approx(4, rel=1e-9)
    duration, moving = 0.4 + 2*(np.sqrt(0.0525) - 0.15), np.flatnonzero(np.abs(run["b"]) > 1e-9)
    assert run.time[moving[-1]] == pytest.approx(0.3 + 2*duration, abs=6e-3)
    assert run.si["part.y"][-1] == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize(("way", "top"), [(0.1, np.sqrt(0.1)), (-0.1, -np.sqrt(0.1)), (2.0, 0.5)])
def test_a_short_way_is_a_triangle_and_any_way_ends_where_it_should(way: float, top: float) -> None:
    """A way below v**2/a, 0.25 m, reaches sqrt(a*way) at its middle only."""
    result = hb.simulate(hb.load("examples/trapezoidal_motion").with_parameters({"part.end": way}), "6 s")
    assert result["part.y"][-1] == pytest.approx(way, rel=1e-12)
    # samples every 10 ms miss the tip of a triangle by 10 mm/s at most
    assert np.abs(result["part.w"]).max() == pytest.approx(abs(top), abs=0.01)
    assert np.gradient(result["part.y"], result.time) == pytest.approx(result["part.w"], abs=6e-3)


def test_the_integral_of_a_controller_is_led_back_from_the_limit() -> None:
    """An error of 1 V for 10 s would wind an integral of 10 V up; led back it stays within T_t*K_i above the limit."""
    text = """model: windup
components:
  error: {is: Step, t_s: 10.0005 s, before: 1 V, after: -1 V}
  part:  {is: PID, K_p: 0.1, K_i: 1 1/s, y_min: -1 V, y_max: 1 V, T_t: 0.5 s, r: =error.y, u: 0 V}
simulate: {until: 12 s, every: 1 ms}
"""
    result = hb.simulate(hb.loads(text))
    held = result["part.q"][result.time <= 10]
    # der(q) = 1 + (1 - 0.1 - q)/0.5 at rest
    assert held[-1] == pytest.approx(1.4, rel=1e-6)
    after = result.time > 10.001
    falls = result.time[after][result["part.y"][after] < 1][0] - 10
    # from w = 1.3 with rate -1 + (1 - w)/0.5 down to 1: 0.5*log(1 + 0.3/0.5)
    assert falls == pytest.approx(0.5*np.log(1.6), abs=3e-3)


def test_a_transfer_function_of_third_order_in_milliseconds_and_one_with_a_direct_part() -> None:
    result = hb.simulate(hb.loads("""model: filters
components:
  butterworth: {is: TransferFunction, a: [1, 2, 2, 1], b: [0, 0, 0, 1], T: 100 ms, u: 1 V}
  lead: {is: TransferFunction, a: [2, 1], b: [1, 0], u: 1 V}
initial: {"butterworth.z[1]": 0 V, "lead.z[1]": 0 V}
simulate: {until: 1 s, every: 10 ms}
"""))
    _, expected = step(([1], [1, 2, 2, 1]), T=result.time/0.1)
    assert result["butterworth.y"] == pytest.approx(expected, abs=1e-6)   # integration
    assert result["lead.y"] == pytest.approx(0.5*np.exp(-result.time/2), abs=1e-9)
