"""Imported 20-sim models of our own writing against SciPy's solution of the same equations, written down a second time."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import heavebond as hb
from heavebond.import_20sim.importer import import_emx
from heavebond.language.library import library

State = list[float]


def part(name: str, ports: str, body: str, *, knot: bool = False, kind: str = "") -> str:
    """A submodel of equations; `ports` are separated by semicolons, the body begins with a section."""
    declared = "".join(f"   {p.strip()};\n" for p in ports.split(";") if p.strip())
    return (f"{name} 0 0\n {'knot' if knot else 'type'} '{kind or name}'\n  ports\n{declared} end;\n"
            f" implementation eq\n{body}\n implementation_end;\n")


def block(name: str, ports: str, parts: str, connections: str) -> str:
    """A submodel of submodels."""
    declared = "".join(f"   {p.strip()};\n" for p in ports.split(";") if p.strip())
    inner = "".join(f" {c.strip()};\n" for c in connections.split(";") if c.strip())
    return (f"{name} 0 0\n type Submodel\n  ports\n{declared} end;\n implementation bg\n submodels\n{parts} end;\n"
            f" connections\n{inner} end;\n implementation_end;\n")


ONE = """equations
 sum (direct (p.e)) = 0;
 equal (collect (p.f));
 flow = first (p.f);"""
ZERO = """equations
 sum (direct (p.f)) = 0;
 equal (collect (p.e));
 effort = first (p.e);"""


def one(name: str) -> str:
    return part(name, "power knot duplicatable none p [1]; signal knot out flow [1]", ONE, knot=True, kind="OneJunction")


def zero(name: str) -> str:
    return part(name, "power knot duplicatable none p [1]; signal knot out effort [1]", ZERO, knot=True, kind="ZeroJunction")


def imported(folder: Path, parts: str, connections: str, until: float, experiment: str = "",
             untranslated: int = 0) -> hb.Result:
    """The run of a model whose main model has these parts."""
    inner = "".join(f"  {c.strip()};\n" for c in connections.split(";") if c.strip())
    text = (f'<?xml version="1.0"?><Document><Model version="4.6"><Sidops><![CDATA[model 0 0\n type Mainmodel\n end;\n'
            f" implementation bg\n submodels\n{parts} end;\n connections\n{inner} end;\n implementation_end;\n"
            f"]]></Sidops></Model><Experiments><Experiment><ExpData>{experiment}<RunSpecs><SimulatorSettings><FinishTime>"
            f"{until}</FinishTime></SimulatorSettings></RunSpecs></ExpData></Experiment></Experiments></Document>")
    (folder / "m.emx").write_text(text, encoding="utf-8")
    made = import_emx(folder / "m.emx", frozenset(library().names()))
    assert len(made.untranslated) == untranslated, made.untranslated
    made.write(folder / "out")
    return hb.simulate(hb.load(str(folder / "out" / "m.yaml")), rtol=1e-8)


def solved(rate: Callable[[float, State], State], start: State, run: hb.Result, instants: tuple[float, ...] = ()
           ) -> np.ndarray:
    """The states of x' = rate(t, x) at the times of a run; the integration begins anew at each instant."""
    ends = [*instants, float(run.time[-1])]
    found, begin, state = [], 0.0, np.array(start)
    for end in ends:
        own = run.time[(run.time >= begin) & (run.time < end if end < ends[-1] else run.time <= end)]
        answer = solve_ivp(rate, (begin, end), state, method="LSODA", rtol=1e-10, atol=1e-12, dense_output=True)
        found.append(answer.sol(own))
        begin, state = end, answer.y[:, -1]
    return np.concatenate(found, axis=1)


def agree(mine: np.ndarray, theirs: np.ndarray, within: float = 2e-6) -> None:
    """The largest difference over the range; both integrators keep 1e-8 or less a step."""
    assert np.ptp(theirs) > 0
    assert np.abs(mine - theirs).max() <= within * np.ptp(theirs)


def test_a_motor_with_a_pid_controller_in_three_levels(tmp_path: Path) -> None:
    """Armature and rotor as bond graphs within a motor within a drive; a filtered PID controller; a step at 0.1 s."""
    armature = block("Armature", "power in p; power out q", one("Current") + part(
        "L", "power in p; signal out state", "parameters\n real i = 2 {mH};\nequations\n state = int (p.e);\n"
        " p.f = state / i;") + part("Ra", "power in p", "parameters\n real r = 0.8 {ohm};\nequations\n p.e = r * p.f;"),
        "p => Current\\p; Current\\p => L\\p; Current\\p => Ra\\p; Current\\p => q")
    rotor = block("Rotor", "power in p; signal out speed", one("Shaft") + part(
        "J", "power in p", "parameters\n real i = 4 {kg.cm2};\nvariables\n real h;\nequations\n h = int (p.e);\n"
        " p.f = h / i;") + part("Rb", "power in p", "parameters\n real r = 1e-4 {N.m.s/rad};\nequations\n p.e = r * p.f;"),
        "p => Shaft\\p; Shaft\\p => J\\p; Shaft\\p => Rb\\p; Shaft\\flow -> speed")
    motor = block("Motor", "power in p; signal out speed", armature + part(
        "K", "power in p1; power out p2", "parameters\n real r = 0.05 {V.s/rad};\nequations\n p1.e = r * p2.f;\n"
        " p2.e = r * p1.f;") + rotor, "p => Armature\\p; Armature\\q => K\\p1; K\\p2 => Rotor\\p; Rotor\\speed -> speed")
    parts = part("Want", "signal out y", "parameters\n real at = 100 {ms}, size = 90 {deg};\nequations\n"
                 " y = size * step (at);") + part(
        "Controller", "signal in want; signal in is; signal out u", """parameters
 real kp = 4, tauD = 0.05 {s}, N = 10, tauI = 2 {s};	// of the parallel form
variables
 real hidden e, uD, uI, state;
equations
 e = want - is;
 state = int (uD / (kp * tauD));
 uD = kp * tauD * N / tauD * (e - state);
 uI = int (kp * e / tauI);
 u = limit (kp * e + uI + uD, -24, 24);""") + part(
        "Amplifier", "power out p; signal in u", "equations\n p.e = u;") + motor + part(
        "Encoder", "signal in w; signal out angle", "equations\n angle = int (w, 0.1);")
    run = imported(tmp_path, parts, "Want\\y -> Controller\\want; Encoder\\angle -> Controller\\is; "
                   "Controller\\u -> Amplifier\\u; Amplifier\\p => Motor\\p; Motor\\speed -> Encoder\\w", 0.6)

    def rate(t: float, x: State) -> State:
        flux, spin, angle, filtered, integral = x
        error = (np.pi / 2 if t >= 0.1 else 0.0) - angle
        derivative = 40 * (error - filtered)
        volts = min(max(4 * error + integral + derivative, -24), 24)
        current, speed = flux / 2e-3, spin / 4e-4
        return [volts - 0.8 * current - 0.05 * speed, 0.05 * current - 1e-4 * speed, speed,
                derivative / 0.2, 2 * error]

    agree(run["Encoder.y"], solved(rate, [0, 0, 0.1, 0, 0], run, (0.1,))[2], 1e-5)


def test_a_hydraulic_cylinder_with_a_valve(tmp_path: Path) -> None:
    """A four-way valve meters oil into both chambers of a cylinder; the piston pushes a mass on a spring."""
    valve = part("Valve", "hydraulic in ps; hydraulic out pa; hydraulic out pb; hydraulic out pt; signal in spool", """
parameters
 real kv = 2e-8;	// m3/s at 1 Pa
variables
 real qa, qb;
code
 if spool >= 0 then
  qa = kv * spool * sign (ps.p - pa.p) * sqrt (abs (ps.p - pa.p));
  qb = kv * spool * sign (pt.p - pb.p) * sqrt (abs (pt.p - pb.p));
  ps.phi = qa;
 else
  qa = -kv * spool * sign (pt.p - pa.p) * sqrt (abs (pt.p - pa.p));
  qb = -kv * spool * sign (ps.p - pb.p) * sqrt (abs (ps.p - pb.p));
  ps.phi = qb;
 end;
 pa.phi = qa;
 pb.phi = qb;
 pt.phi = qa + qb - ps.phi;""")
    chamber = ("parameters\n real B = 1.2e9 {Pa}, V = VOLUME {cm3};\nequations\n"
               " p.p = (B / V) * int (p.phi, FIRST * V / B);")
    parts = (part("Pump", "hydraulic out p", "parameters\n real ps = 120 {bar};\nequations\n p.p = ps;")
             + part("Tank", "hydraulic in p", "equations\n p.p = 0;") + valve
             + part("Spool", "signal out y", "equations\n y = 0.9 * sin (2 * pi * time);")
             + zero("A") + zero("B")
             + part("ChamberA", "hydraulic in p", chamber.replace("VOLUME", "300").replace("FIRST", "40e5"))
             + part("ChamberB", "hydraulic in p", chamber.replace("VOLUME", "250").replace("FIRST", "50e5"))
             + part("Piston", "hydraulic in pa; hydraulic in pb; translation out p", "parameters\n real a = 12 {cm2}, b = 8 "
                    "{cm2};\nequations\n p.F = a * pa.p - b * pb.p;\n pa.phi = a * p.v;\n pb.phi = -b * p.v;")
             + one("Rod").replace("power knot", "translation knot").replace("p.e", "p.F").replace("p.f", "p.v")
             + part("Mass", "translation in p; signal out x", "parameters\n real m = 40 {kg};\nvariables\n real v;\n"
                    "equations\n v = int (p.F) / m;\n p.v = v;\n x = int (v);")
             + part("Spring", "translation in p", "parameters\n real k = 80 {kN/m}, d = 900 {N.s/m};\nequations\n"
                    " p.F = k * int (p.v) + d * p.v;"))
    parts = parts.replace("power knot duplicatable", "hydraulic knot duplicatable")
    parts = parts.replace("p.e", "p.p").replace("(p.f)", "(p.phi)").replace("direct (p.f", "direct (p.phi")
    run = imported(tmp_path, parts, "Pump\\p => Valve\\ps; Valve\\pt => Tank\\p; Spool\\y -> Valve\\spool; "
                   "Valve\\pa => A\\p; Valve\\pb => B\\p; A\\p => ChamberA\\p; B\\p => ChamberB\\p; "
                   "A\\p => Piston\\pa; B\\p => Piston\\pb; "
                   "Piston\\p => Rod\\p; Rod\\p => Mass\\p; Rod\\p => Spring\\p", 1.0)

    def rate(t: float, x: State) -> State:
        a, b, v, place = x
        spool = 0.9 * np.sin(2 * np.pi * t)
        supply, back = (120e5, 0.0) if spool >= 0 else (0.0, 120e5)
        qa, qb = (2e-8 * abs(spool) * np.sign(p - q) * np.sqrt(abs(p - q)) for p, q in ((supply, a), (back, b)))
        return [1.2e9 / 300e-6 * (qa - 12e-4 * v), 1.2e9 / 250e-6 * (qb + 8e-4 * v),
                (12e-4 * a - 8e-4 * b - 80e3 * place - 900 * v) / 40, v]

    exact = solved(rate, [40e5, 50e5, 0, 0], run, (0.5,))
    agree(run["Mass.x"], exact[3], 1e-5)


def test_modulated_elements(tmp_path: Path) -> None:
    """A crank drives a mass through an MTF of its angle; an MR brakes; an MSe pulls."""
    parts = (one("Shaft") + one("Slide")
             + part("MSe", "power out p; signal in effort", "variables\n real flow;\nequations\n p.e = effort;\n"
                    " flow = p.f;")
             + part("Torque", "signal out y", "equations\n y = 3 + 0.5 * sin (7 * time);")
             + part("J", "power in p", "parameters\n real i = 0.2;\nvariables\n real state;\nequations\n"
                    " state = int (p.e);\n p.f = state / i;")
             + part("MR", "power in p; signal in r", "equations\n p.e = r * p.f;")
             + part("Angle", "signal in w; signal out ratio; signal out brake; signal out y", """parameters
 real radius = 100 {mm};
variables
 real a;
equations
 a = int (w, 0.3);
code
 ratio = radius * sin (a);
 brake = 0.4 + 0.2 * cos (a) ^ 2;
 y = a;""")
             + part("MTF", "power in p1; power out p2; signal in r", "equations\n p2.f = r * p1.f;\n p1.e = r * p2.e;")
             + part("M", "power in p", "parameters\n real i = 1500 {g};\nequations\n p.f = int (p.e) / i;")
             + part("C", "power in p", "parameters\n real c = 0.005;\nvariables\n real state;\nequations\n"
                    " state = int (p.f);\n p.e = state / c;")
             + part("Rl", "power in p", "parameters\n real r = 5;\nequations\n p.e = r * p.f;") + zero("Bar"))
    # the mass hangs on a spring behind the crank, so that both have integral causality
    run = imported(tmp_path, parts, "Torque\\y -> MSe\\effort; MSe\\p => Shaft\\p; Shaft\\p => J\\p; Shaft\\p => MR\\p; "
                   "Shaft\\flow -> Angle\\w; Angle\\brake -> MR\\r; Shaft\\p => MTF\\p1; Angle\\ratio -> MTF\\r; "
                   "MTF\\p2 => Bar\\p; Bar\\p => C\\p; Bar\\p => Slide\\p; Slide\\p => M\\p; Slide\\p => Rl\\p", 4.0)

    def rate(t: float, x: State) -> State:
        spin, angle, momentum, stretch = x
        ratio, w, v = 0.1 * np.sin(angle), spin / 0.2, momentum / 1.5
        force = stretch / 0.005
        brake = 0.4 + 0.2 * np.cos(angle)**2
        return [3 + 0.5 * np.sin(7 * t) - brake * w - ratio * force, w, force - 5 * v, ratio * w - v]

    agree(run["Angle.y"], solved(rate, [0, 0.3, 0, 0], run)[1])


def test_multi_bonds_with_matrices(tmp_path: Path) -> None:
    """M v' + D v + K q = F of two coordinates: an inertia with a full matrix, a spring and a damper with matrices."""
    junction = ONE.replace(" flow = first (p.f);", "")
    parts = (part("One", "power knot duplicatable none p [2]", junction, knot=True, kind="OneJunction")
             + part("Force", "power out p [2]", "equations\n p.e = [10 * sin (3 * time); -4];")
             + part("Mass", "power in p [2]; signal out v [2]", "parameters\n real M[2,2] = [2, 0.5; 0.5, 1];\nvariables\n"
                    " real h[2];\nequations\n h = int (p.e, [0.2; 0]);\n p.f = inverse (M) * h;\n v = p.f;")
             + part("Spring", "power in p [2]; signal out q [2]", "parameters\n real K[2,2] = [30, -10; -10, 20];\n"
                    "variables\n real x[2];\nequations\n x = int (p.f, [0; 0.1]);\n p.e = K * x;\n q = x;")
             + part("Damper", "power in p [2]", "parameters\n real global D[2,2];\nequations\n p.e = D * p.f;")
             + part("Globals", "", "parameters\n real global D[2,2] = [0.8, -0.1; -0.1, 0.6];\nvariables\n real n;\n"
                    "equations\n n = D[1,1];")
             + part("Energy", "signal in v [2]; signal in q [2]; signal out e", "equations\n"
                    " e = norm (v) + transpose (q) * [1, 0; 0, 2] * q + inner (v, q) + sum (q);"))
    run = imported(tmp_path, parts, "Force\\p => One\\p; One\\p => Mass\\p; One\\p => Spring\\p; One\\p => Damper\\p; "
                   "Mass\\v -> Energy\\v; Spring\\q -> Energy\\q", 5.0)
    m, d, k = np.array([[2, .5], [.5, 1]]), np.array([[.8, -.1], [-.1, .6]]), np.array([[30., -10], [-10, 20]])

    def rate(t: float, x: State) -> State:
        v = np.linalg.solve(m, x[:2])
        return [*(np.array([10 * np.sin(3 * t), -4]) - d @ v - k @ x[2:]), *v]

    x = solved(rate, [0.2, 0, 0, 0.1], run)
    v, q = np.linalg.solve(m, x[:2]), x[2:]
    agree(run["Spring.q_2"], q[1])
    agree(run["Energy.e"], np.hypot(*v) + q[0]**2 + 2 * q[1]**2 + (v * q).sum(0) + q.sum(0))


LOOKUP = """parameters
 real A[5,2] = [-1, -3; 0, -0.5; 0.5, 0.5; 2, 1; 3, 4];
variables
 integer i, n; boolean found;
code
 i = 1; n = rows (A); found = false;
 while (i <= n and not found) do
  if u < A[i,1] then
   found = true;
   if i == 1 then y = A[i,2];
   else y = A[i-1,2] + (u - A[i-1,1]) * (A[i,2] - A[i-1,2]) / (A[i,1] - A[i-1,1]); end;
  else
   if i == n then found = true; y = A[i,2]; end;
  end;
  i = i + 1;
 end;"""


def test_a_table_that_a_loop_searches(tmp_path: Path) -> None:
    """The loop ends at a condition of the run; before the first point and behind the last one the table is constant."""
    parts = (part("In", "signal out y", "equations\n y = 4.5 * sin (time / 1{min} * 2 * pi * 15);")
             + part("Table", "signal in u; signal out y", LOOKUP)
             + part("Sum", "signal in u; signal out y", "equations\n y = int (u - y);"))
    run = imported(tmp_path, parts, "In\\y -> Table\\u; Table\\y -> Sum\\u", 4.0)
    wave = 4.5 * np.sin(run.time * np.pi / 2)
    agree(run["Table.y"], np.interp(wave, [-1, 0, 0.5, 2, 3], [-3, -0.5, 0.5, 1, 4]))


def test_a_sampled_controller_between_a_sampler_and_a_hold(tmp_path: Path) -> None:
    """A discrete PI controller every 50 ms on a continuous lag; a disturbance that events switch; a counter of them."""
    parts = (part("Control", "signal in want; signal in is; signal out u", """parameters
 real kp = 2, ki = 1.5;
variables
 real e, s;
equations
 e = want - sample (is);
 s = dint (e, 0.1);
 u = hold (kp * e + ki * s, 0.2);""")
             + part("Want", "signal out y", "equations\n y = if time < 1.02 then 1 else -0.5 end;")
             + part("Plant", "signal in u; signal in d; signal out y", "parameters\n real tau = 0.3;\nequations\n"
                    " y = int ((u + d - y) / tau, 0.25);")
             + part("Disturbance", "signal out d; signal out count", """variables
 real level, n;
initialequations
 level = 0; n = 0;
code
 if timeevent (0.73) then level = 0.4; n = n + 1; end;
 if frequencyevent (0.5, 0.31) then level = level + 0.1; n = n + 1; end;
 d = level;
 count = n;"""))
    run = imported(tmp_path, parts, "Want\\y -> Control\\want; Plant\\y -> Control\\is; Control\\u -> Plant\\u; "
                   "Disturbance\\d -> Plant\\d", 2.0,
                   "<D><DiscreteID>A\\y</DiscreteID><TimeInterval>0.05</TimeInterval></D>")
    times = sorted({*np.round(np.arange(0, 2, 0.05), 9), 0.73, 1.02, 0.31, 0.81, 1.31, 1.81})
    y, u, s, d, n, found = 0.25, 0.2, 0.1, 0.0, 0, []
    for begin, end in zip(times, [*times[1:], 2.0], strict=True):
        if begin == 0.73:
            d, n = 0.4, n + 1
        if round((begin - 0.31) / 0.5, 9) in (0, 1, 2, 3):
            d, n = d + 0.1, n + 1
        if round(begin / 0.05, 6) == round(begin / 0.05):
            e = (1 if begin < 1.02 else -0.5) - y
            u = 2 * e + 1.5 * s
            s += 0.05 * e
        found.append((begin, y, u + d))
        y = u + d + (y - u - d) * np.exp(-(end - begin) / 0.3)
    exact = [next(v + (w - v) * np.exp(-(t - b) / 0.3) for b, w, v in reversed(found) if b <= t + 1e-12) for t in run.time]
    agree(run["Plant.y"], np.array(exact))
    assert run["Disturbance.count"][-1] == n == 5


@pytest.mark.parametrize("turned", [False, True], ids=["to_the_mass", "from_the_mass"])
def test_an_iconic_diagram_of_a_motor_on_a_shaft(tmp_path: Path, turned: bool) -> None:
    """Elements whose port takes several connections (rotor, ground), a motor between both domains, spring and bearing."""
    parts = (part("Source", "electric delta out p", "equations\n p.u = 12;")
             + part("Ground", "electric psi duplicatable in p", "equations\n p.u = 0;")
             + part("R", "electric delta in p", "parameters\n real R = 1.5 {Ohm};\nequations\n p.u = R * p.i;")
             + part("L", "electric delta in p", "parameters\n real L = 5 {mH};\nequations\n p.i = int (p.u) / L;")
             + part("Motor", "electric delta in p1; rotation out p2", "parameters\n real k = 0.1 {N.m/A};\nequations\n"
                    " p2.T = k * p1.i;\n p1.u = k * p2.omega;")
             + part("Rotor", "rotation psi duplicatable in p; signal out phi", "parameters\n real J = 2e-3 {kg.m2};\n"
                    "equations\n p.omega = int (p.T) / J;\n phi = int (p.omega);")
             + part("Bearing", "rotation in p", "parameters\n real d = 4e-3 {N.m.s/rad};\nequations\n p.T = d * p.omega;")
             + part("Shaft", "rotation delta in p", "parameters\n real k = 3 {N.m/rad}, d = 0.01;\nequations\n"
                    " p.T = k * int (p.omega) + d * p.omega;")
             + part("Load", "rotation psi duplicatable in p; signal out phi", "parameters\n real J = 5e-3 {kg.m2};\n"
                    "variables\n real w;\nequations\n w = (1 / J) * int (p.T);\n p.omega = w;\n phi = int (w);"))
    ends = ("Rotor\\p => Shaft\\p_high; Load\\p => Shaft\\p_low" if turned else
            "Shaft\\p_high => Rotor\\p; Load\\p => Shaft\\p_low")
    run = imported(tmp_path, parts, "Source\\p_high => R\\p_high; R\\p_low => L\\p_high; L\\p_low => Motor\\p1_high; "
                   "Motor\\p1_low => Ground\\p; Source\\p_low => Ground\\p; Motor\\p2 => Rotor\\p; Rotor\\p => Bearing\\p; "
                   + ends, 1.0)

    def rate(_: float, x: State) -> State:
        flux, spin, load, phi, theta = x
        i, w, v = flux / 5e-3, spin / 2e-3, load / 5e-3
        twist = 3 * (phi - theta) + 0.01 * (w - v)
        return [12 - 1.5 * i - 0.1 * w, 0.1 * i - 4e-3 * w - twist, twist, w, v]

    x = solved(rate, [0, 0, 0, 0, 0], run)
    agree(run["Rotor.phi"], x[3])
    agree(run["Load.phi"], x[4])


def test_arrays_loops_and_functions_of_code(tmp_path: Path) -> None:
    """A chain of four masses in one submodel: sizes by a constant, loops over indices, values that code computes in turn."""
    parts = part("Chain", "signal out last; signal out energy", """constants
 integer n = 4;
parameters
 real m[n] = [1; 2; 3; 4], k = 40, d = 0.3 {N.s/m};
variables
 real x[n], v[n], F[n], a[n], stretch, force, total;
 integer i;
equations
 x = int (v, [0.1; 0; 0; -0.05]);
 v = int (a);
code
 for i = 1 to n do F[i] = 0; end;
 for i = 1 to n - 1 do
  stretch = x[i + 1] - x[i];
  force = k * stretch + d * (v[i + 1] - v[i]);
  if abs (stretch) > 0.05 then
   force = force + 300 * (stretch - 0.05 * sign (stretch));
  end;
  F[i] = F[i] + force;
  F[i + 1] = F[i + 1] - force;
 end;
 total = 0;
 for i = 1 to n do
  a[i] = F[i] / m[i];
  total = total + 0.5 * m[i] * v[i]^2;
 end;
 a[1] = a[1] - 9 * arctan2 (x[1], 1) + arctan2 (0, x[1] - 9) + 0.2 * cosh (x[1]) - exp10 (-1);
 last = x[n];
 energy = sqrt (total);""")
    run = imported(tmp_path, parts, "", 3.0)
    m = np.array([1, 2, 3, 4.0])

    def rate(_: float, s: State) -> State:
        x, v, f = np.array(s[:4]), np.array(s[4:]), np.zeros(4)
        for i in range(3):
            u = x[i + 1] - x[i]
            force = 40 * u + 0.3 * (v[i + 1] - v[i]) + (300 * (u - 0.05 * np.sign(u)) if abs(u) > 0.05 else 0)
            f[i] += force
            f[i + 1] -= force
        a = f / m
        a[0] += -9 * np.arctan2(x[0], 1) + np.pi + 0.2 * np.cosh(x[0]) - 0.1
        return [*v, *a]

    s = solved(rate, [0.1, 0, 0, -0.05, 0, 0, 0, 0], run)
    agree(run["Chain.last"], s[3], 1e-5)
    agree(run["Chain.energy"], np.sqrt(0.5 * (m[:, None] * s[4:]**2).sum(0)), 1e-4)  # a root of nearly zero at its ends


def test_a_joint_that_a_constraint_holds(tmp_path: Path) -> None:
    """A mass whose flow `constraint` keeps at 0 through a lever: the lever's ratio carries the force of the source."""
    parts = (one("Left") + one("Right")
             + part("Force", "power out p", "equations\n p.e = 5 * sin (time);")
             + part("M", "power in p", "parameters\n real i = 2;\nequations\n p.f = int (p.e, 3) / i;")
             + part("C", "power in p; signal out x", "equations\n x = int (p.f);\n p.e = 50 * x;") + zero("Bar")
             + part("Hold", "power in p; signal out e", "equations\n p.e = constraint (p.f);\n e = p.e;"))
    run = imported(tmp_path, parts, "Force\\p => Left\\p; Left\\p => M\\p; Left\\p => Bar\\p; Bar\\p => C\\p; "
                   "Bar\\p => Right\\p; Right\\p => Hold\\p", 3.0)

    def rate(t: float, x: State) -> State:
        return [5 * np.sin(t) - 50 * x[1], x[0] / 2]

    agree(run["Hold.e"], 50 * solved(rate, [3, 0], run)[1])


def test_initial_values_that_parameters_and_initial_equations_compute(tmp_path: Path) -> None:
    """int (x, x0) where x0 comes from initial equations, from equations of parameters, from a shared global parameter."""
    parts = (part("Globals", "", "parameters\n real global start ('shared') {mm};")
             + part("Charge", "signal out y; signal out z; signal out w", """parameters
 real capacity = 1.8 {A.h}, half = 0.5;
 real global start;
variables
 real Ah, low;
initialequations
 Ah = capacity * half;
equations
 low = 2 * half;
 y = int (-y, Ah);
 z = int (-z, low + 1);
 w = int (-w, start);"""))
    run = imported(tmp_path, parts, "", 2.0, "<Variables><Parameters><Variable><Name>start</Name><Value>0.25</Value>"
                   "</Variable></Parameters></Variables>")
    for name, first in (("y", 0.9 * 3600), ("z", 2), ("w", 0.25)):
        agree(run[f"Charge.{name}"], first * np.exp(-run.time))


def test_initial_values_that_the_experiment_states_of_parameters(tmp_path: Path) -> None:
    """20-sim lists a parameter that serves as an initial value among these, be it global or not."""
    parts = (part("Globals", "", "parameters\n real global start ('shared');")
             + part("Charge", "signal out y; signal out z", """parameters
 real global start;
 real first = 1;
equations
 y = int (-y, start);
 z = int (-z, first);"""))
    run = imported(tmp_path, parts, "", 1.0, "<Variables><Initials><Variable><Name>start</Name><Value>0.25</Value>"
                   "</Variable><Variable><Name>Charge\\first</Name><Value>3</Value></Variable></Initials></Variables>")
    agree(run["Charge.y"], 0.25 * np.exp(-run.time))
    agree(run["Charge.z"], 3 * np.exp(-run.time))


def test_equations_with_one_quantity_on_the_left_hold_at_the_same_time(tmp_path: Path) -> None:
    """A heat exchanger: three balances of one heat flow give it and the two temperatures at its outlets."""
    body = """parameters
 real eps = 0.4, Cw = 400, Ca = 500, Tw = 40;
variables
 real Q, T_back, T_supply;
equations
 Q = Cw * (Tw - T_back);
 Q = eps * Ca * (Tw - T);
 Q = Ca * (T_supply - T);
 T = int (Q / 1000, 10);
 back = T_back;
 supply = T_supply;"""
    run = imported(tmp_path, part("Coil", "signal out T; signal out back; signal out supply", body), "", 2.0, "")
    heat = 0.4 * 500 * 30 * np.exp(-0.2 * run.time)
    agree(run["Coil.back"], 40 - heat / 400)
    agree(run["Coil.supply"], run["Coil.T"] + heat / 500)


def test_elements_of_the_library_are_recognised_by_their_equations(tmp_path: Path) -> None:
    """Whatever they are called and however their equations are arranged; what is only similar keeps its own component."""
    parts = (part("Sum1", "signal knot duplicatable in plus [1]; signal knot duplicatable in minus [1]; signal knot out "
                  "output [1]", "equations\n output = sum (collect (plus)) - sum (collect (minus));", knot=True)
             + part("Wave", "signal out y", "equations\n y = sin (3 * time);")
             + part("Bias", "signal out output", "parameters\n real C = 0.25;\nequations\n output = C;")
             + part("Amplifier", "signal in input; signal out output", "parameters\n real K = 3;\nequations\n"
                    " output = K * input;")
             + part("Limiter", "signal in input; signal out output", "parameters\n real maximum = 1, minimum = -0.5;\n"
                    "equations\n output = limit (input, minimum, maximum);")
             + part("Store", "signal in input; signal out output", "parameters\n real initial = 0.5;\nequations\n"
                    " output = int (input, initial);")
             + part("Effort", "power out p", "parameters\n real effort = 6;\nvariables\n real flow;\nequations\n"
                    " p.e = effort;\n flow = p.f;")
             + one("Ring") + part("Loss", "power in p", "parameters\n real r = 1;\nequations\n p.f = p.e / r;")
             + part("Leak", "power in p", "parameters\n real g = 0.5;\nequations\n p.f = g * p.e;")
             + part("Square", "power in p", "parameters\n real r = 0.5;\nequations\n p.e = r * p.f * abs (p.f);")
             + part("Momentum", "power in p; signal out state", "parameters\n real i = 4;\nequations\n"
                    " state = int (p.e, 2);\n p.f = state / i;")
             + part("Ratio", "power in p1; power out p2", "parameters\n real r = 0.2;\nequations\n p1.e = r * p2.e;\n"
                    " p2.f = r * p1.f;")
             + part("Spring", "power in p", "parameters\n real c = 0.1;\nvariables\n real state;\nequations\n"
                    " state = int (p.f, 0.05);\n p.e = state / c;"))
    run = imported(tmp_path, parts, "Wave\\y -> Sum1\\plus; Bias\\output -> Sum1\\minus; Sum1\\output -> Amplifier\\input; "
                   "Amplifier\\output -> Limiter\\input; Limiter\\output -> Store\\input; Effort\\p => Ring\\p; "
                   "Ring\\p => Loss\\p; Ring\\p => Leak\\p; Ring\\p => Square\\p; Ring\\p => Momentum\\p; "
                   "Ring\\p => Ratio\\p1; Ratio\\p2 => Spring\\p", 3.0)
    text = (tmp_path / "out" / "m.yaml").read_text()
    for line in ("Sum1: {is: Sum, k_1: 1, k_2: -1,", "Bias: {is: Constant, k: 0.25,", "Amplifier: {is: Gain, k: 3,",
                 "Limiter: {is: Saturation, u_min: -0.5, u_max: 1,", "Store: {is: Integrator, k: 1 1/s,",
                 "Effort: {is: Se, u: 6 W, k: 1,", "Loss: {is: R, R: 1 W,", "Leak: {is: Leak,",
                 "Square: {is: Square,", "Momentum: {is: I, I: 4 W*s,", "Ratio: {is: TF, m: 0.2,",
                 "Spring: {is: C, C: 0.1 s/W,", "Momentum.a.f: 0.5\n", "Spring.a.e: 0.5 W\n", "Store.y: 0.5\n"):
        assert line in re.sub(" +", " ", text), line

    def rate(t: float, x: State) -> State:
        f = x[1] / 4
        wave = min(max(3 * (np.sin(3 * t) - 0.25), -0.5), 1)
        return [wave, 6 - f - 2 * f - 0.5 * f * abs(f) - 0.2 * x[2] / 0.1, 0.2 * f]

    x = solved(rate, [0.5, 2, 0.05], run)
    agree(run["Store.y"], x[0], 1e-5)
    agree(run["Momentum.a.f"], x[1] / 4)


def test_a_first_order_lag_with_a_gain_of_1(tmp_path: Path) -> None:
    """The gain of 1 needs no parameter: the lag of the library. With another gain it keeps a component of its own."""
    lag = """parameters
 real k = 1;  // gain
 real tau = 0.4 {s};
variables
 real rate, state;
equations
 rate = (k * input - state) / tau;
 state = int (rate, 0.5);
 output = state;"""
    ports = "signal in input; signal out output"
    parts = part("Ramp", "signal out y", "equations\n y = time^2;") + "".join(
        part(name, ports, lag.replace("k = 1", gain), kind="TransferFunction") for name, gain in (
            ("Lag", "k = 1"), ("Other", "k = 2")))
    run = imported(tmp_path, parts, "Ramp\\y -> Lag\\input; Ramp\\y -> Other\\input", 2.0)
    text = (tmp_path / "out" / "m.yaml").read_text()
    assert "Lag:   {is: FirstOrderLag, T_1: 0.4 s" in text and "Other: {is: Other," in text
    agree(run["Lag.y"], solved(lambda t, x: [(t**2 - x[0]) / 0.4], [0.5], run)[0])
    agree(run["Other.output"], solved(lambda t, x: [(2 * t**2 - x[0]) / 0.4], [0.5], run)[0])


def test_global_relations_of_submodels_within_each_other(tmp_path: Path) -> None:
    """A submodel of equations with relations of its own, relations that name those around them, initial values that global
    matrices give, and a supply of a block with several connections."""
    relations = ("description '<Attributes><GlobalRelations>parameters\n real global A_1[2,2];\n real size[2] = [2; 3];\n"
                 "variables\n real first_1[2];\nequations\n first_1 = A_1 * size;</GlobalRelations></Attributes>';\n")
    own = "description '<A><GlobalRelations>parameters\n real rate = 0.7 {1/s};</GlobalRelations></A>';\n"
    decay = part("Decay", "signal out y [2]; electric in p", "parameters\n real global rate;\nvariables\n"
                 " real global first_1[2];\n real v[2];\nequations\n v = first_1;\n"
                 " y = int (-rate * y, v);\n p.i = y[1] + 0 * p.u;")
    decay = decay.replace(" type 'Decay'", f" {own} type 'Decay'")
    wire = part("Node", "electric knot duplicatable none p [1]", "equations\n sum (direct (p.i)) = 0;\n"
                " equal (collect (p.u));", knot=True)
    load = block("Loads", "electric psi duplicatable in pin", wire + decay + part(
        "R", "electric in p", "parameters\n real r = 5;\nequations\n p.u = r * p.i;"),
        "pin => Node\\p; Node\\p => Decay\\p; Node\\p => R\\p").replace(" type Submodel", f" {relations} type Submodel")
    parts = (part("Matrices", "", "parameters\n real global A_1[2,2] = [1, 0.5; 0, 2];\nvariables\n real n;\nequations\n"
                  " n = A_1[1,2];")
             + part("Supply", "electric out p", "equations\n p.u = 10;")
             + part("Sense", "electric in p", "equations\n p.i = 0 * p.u;") + load)
    run = imported(tmp_path, parts, "Supply\\p => Loads\\pin; Sense\\p => Loads\\pin", 2.0)
    agree(run["Loads.Decay.y_1"], 3.5 * np.exp(-0.7 * run.time))
    agree(run["Loads.Decay.y_2"], 6 * np.exp(-0.7 * run.time))
    agree(run["Supply.p.f"], -(2 + 3.5 * np.exp(-0.7 * run.time)))


def test_expressions_that_are_too_long_or_too_deep_are_split(tmp_path: Path) -> None:
    """Products of eight rotations, and a table of 45 points that a loop searches: each is longer or deeper than a formula
    may be."""
    rows = "; ".join(f"{k}, {k * k % 17}" for k in range(45))
    parts = (part("Table", "signal in u; signal out y", LOOKUP.replace("A[5,2] = [-1, -3; 0, -0.5; 0.5, 0.5; 2, 1; 3, 4]",
                                                                       f"A[45,2] = [{rows}]"))
             + part("In", "signal out y", "equations\n y = 22 + 23 * cos (time);")
             + part("Turned", "signal out y", "variables\n real R[3,3], P[3,3];\nequations\n"
                    " R = [cos (time), -sin (time), 0; sin (time), cos (time), 0; 0, 0, 1];\n"
                    " P = R * R * R * R * R * R * R * R;\n y = P[1,2] + P[3,3];"))
    run = imported(tmp_path, parts, "In\\y -> Table\\u", 3.0)
    k = np.arange(45)
    agree(run["Table.y"], np.interp(22 + 23 * np.cos(run.time), k, k * k % 17))
    agree(run["Turned.y"], 1 - np.sin(8 * run.time))


def test_tables_from_files(tmp_path: Path) -> None:
    """A table of the time, one of a signal, and one within equations; what is not beside the model is not read."""
    (tmp_path / "profile.txt").write_text("% time value\n0 1\n0.5\t3\n2 -1\n", encoding="utf-8")
    (tmp_path / "curve.csv").write_text("x, y\n-1, 2\n0, 0\n3, 1.5\n", encoding="utf-8")
    parts = (part("Profile", "signal out y", "parameters\n string filename;\nequations\n y = table (filename, time);")
             + part("Curve", "signal in u; signal out y", "parameters\n string filename = 'C:\\old\\curve.csv';\nequations\n"
                    " y = table (filename, u);")
             + part("Both", "signal in u; signal out y", "parameters\n real k = 2;\nequations\n"
                    " y = int (k * table ('curve.csv', u - 1) + table ('profile.txt', 2 * time));")
             + part("Named", "signal in u; signal out y", "parameters\n string global shared_file;\nequations\n"
                    " y = 2 * table (shared_file, u);")
             + part("Names", "signal in u", "parameters\n string global shared_file = 'curve.csv';\nvariables\n real w;\n"
                    "equations\n w = u;")
             + part("Secret", "signal out y", "equations\n y = table ('../m.emx', time);"))
    run = imported(tmp_path, parts, "Profile\\y -> Curve\\u; Profile\\y -> Both\\u; Profile\\y -> Named\\u", 3.0,
                   "<Variables><Parameters><Variable><Name>Profile\\filename</Name><Value>&quot;profile.txt&quot;</Value></Variable>"
                   "</Parameters></Variables>", untranslated=6)
    text = re.sub(" +", " ", (tmp_path / "out" / "m.yaml").read_text())
    assert "Profile: {is: TableSource, t: [0 s, 0.5 s, 2 s], v: [1, 3, -1]," in text
    assert "Curve: {is: Lookup, x: [-1, 0, 3], v: [2, 0, 1.5]," in text
    profile, curve = ((lambda t: np.interp(t, [0, 0.5, 2], [1, 3, -1])), (lambda u: np.interp(u, [-1, 0, 3], [2, 0, 1.5])))
    agree(run["Curve.y"], curve(profile(run.time)))
    agree(run["Named.y"], 2 * curve(profile(run.time)))
    exact = solved(lambda t, x: [2 * curve(profile(t) - 1) + profile(2 * t)], [0], run, (0.25, 0.5, 0.875, 1.0, 2.0))
    agree(run["Both.y"], exact[0], 1e-5)


def test_a_sum_of_vectors_without_a_subtrahend(tmp_path: Path) -> None:
    """A knot of signals whose port `minus` has no connection counts as 0 for each element; sizes that differ are listed."""
    ports = "".join(f"signal knot duplicatable in {name} [3,1]; " for name in ("plus", "minus")) + "signal knot out y [3,1]"
    knot = part("Sum", ports, "equations\n y = sum (collect (plus)) - sum (collect (minus));", knot=True, kind="PlusMinus")
    parts = (part("A", "signal out y [3,1]", "equations\n y = [1; time; 3];")
             + part("B", "signal out y [3,1]", "equations\n y = [10; 20; 30 * time];") + knot
             + part("Lag", "signal in u [3,1]; signal out y [3,1]", "equations\n y = int (u - y, [1; 2; 3]);")
             + part("Wrong", "signal in u [3,1]; signal out z [2,1]", "equations\n z = 2 * u;"))
    run = imported(tmp_path, parts, "A\\y -> Sum\\plus; B\\y -> Sum\\plus; Sum\\y -> Lag\\u; A\\y -> Wrong\\u", 2.0,
                   untranslated=1)
    exact = solved(lambda t, x: [11 - x[0], t + 20 - x[1], 3 + 30 * t - x[2]], [1, 2, 3], run)
    for k in range(3):
        agree(run[f"Lag.y_{k + 1}"], exact[k])


def test_a_knot_whose_port_cannot_be_read_is_listed(tmp_path: Path) -> None:
    knot = part("Sum", "signal knot duplicatable in plus [n,1]; signal knot out y", "equations\n y = sum (collect (plus));",
                knot=True, kind="PlusMinus")
    parts = (part("A", "signal out y", "equations\n y = time;") + knot
             + part("B", "signal in u", "variables\n real v;\nequations\n v = u;"))
    # the size, the port and its connection
    imported(tmp_path, parts, "A\\y -> Sum\\plus; Sum\\y -> B\\u", 1.0, untranslated=3)


TABLE_2D = """constants
 string dll_name = 'Table2D.dll';
 string initialize_function_name = 'Table2DInit';
 string function_name = 'TableRead';
parameters
 string file = 'map.txt';
variables
 real id, input [3];
initialequations
 "initialize the DLL with the table to use"
 id = dll (dll_name, initialize_function_name, file);
equations
 input[1] = id;
 input[2] = u[2];
 input[3] = u[1];
"""


def test_tables_of_two_inputs_from_files(tmp_path: Path) -> None:
    """`Table2D.dll` as the library of 20-sim calls it: a Lookup2, and one within equations; not without its file."""
    from scipy.interpolate import RegularGridInterpolator

    rows, columns = [0.0, 1.0, 2.5], [-1.0, 0.0, 0.5, 4.0]
    values = np.array([[k * k - 3 * k * i + i for i in range(4)] for k in range(3)], dtype=float)
    lines = ["\t".join(map(str, [0, *columns]))] + ["\t".join(map(str, [r, *v])) for r, v in zip(rows, values, strict=True)]
    (tmp_path / "map.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (tmp_path / "short.txt").write_text("0 1 2\n1 2 3\n2 x 4\n", encoding="utf-8")
    parts = (part("Place", "signal out y [2,1]", "equations\n y = [1 + 4 * sin (3 * time); 1.2 + 1.5 * cos (time)];")
             + part("Map", "signal in u [2,1]; signal out y", TABLE_2D + " y = dll (dll_name, function_name, input);")
             + part("Own", "signal in u [2,1]; signal out y",
                    TABLE_2D + " y = 3 - dll (dll_name, function_name, [1; u[2]; u[1] / 2]);")
             + part("Lost", "signal in u [2,1]; signal out y", TABLE_2D.replace("map", "lost") + " y = u[1];")
             + part("Wrong", "signal in u [2,1]; signal out y", TABLE_2D.replace("map", "short") + " y = u[1];")
             + part("Other", "signal in u [2,1]; signal out y", "equations\n y = dll ('other.dll', 'f', u[1]);"))
    run = imported(tmp_path, parts, "; ".join(f"Place\\y -> {n}\\u" for n in ("Map", "Own", "Lost", "Wrong", "Other")), 4.0,
                   untranslated=5)
    table = RegularGridInterpolator((rows, columns), values)
    first, second = 1 + 4 * np.sin(3 * run.time), 1.2 + 1.5 * np.cos(run.time)

    def read(row: np.ndarray, column: np.ndarray) -> np.ndarray:
        return table(np.stack([np.clip(row, 0, 2.5), np.clip(column, -1, 4)], axis=1))

    agree(run["Map.y"], read(second, first))
    agree(run["Own.y"], 3 - read(second, first / 2))
    assert "{is: Lookup2, x_1: [0, 1, 2.5], x_2: [-1, 0, 0.5, 4], v: [" in (tmp_path / "out" / "m.yaml").read_text()
    reasons = " ".join(u.reason for u in import_emx(tmp_path / "m.emx", frozenset(library().names())).untranslated)
    assert "the table 'lost.txt' is not in the folder of the model" in reasons and "not of numbers: 2 x 4" in reasons


PROFILE = """parameters
 real hidden period = 5;
 integer nrTimes = 2;
variables
 real hidden fu, modTime, divTime, stroke, dllInput, localStrokeOffset, share;
 integer hidden region, count;
 real hidden dllOutput[3];
initialequations
 region = 0;
 stroke = 1.0;
 dllOutput = 0.0;
code
 modTime = time mod period;
 divTime = time div period;
 count = 1 + round (divTime);
 if count <= nrTimes then
  if modTime < 2 then
   region = 1;
   share = modTime / 2;
  else
   if modTime < 2 then
    region = 2;
    share = (modTime - 2) / 0;
   else
    if modTime < 3 then
     region = 3;
     share = (modTime - 2) / 1;
    else
     region = 4;
     share = (modTime - 3) / 2;
    end;
   end;
  end;
  switch (region)
   case 1 do
    dllInput = share;
    dllOutput = dll ('MotionProfiles.dll', 'ProfileFlat', dllInput);
    localStrokeOffset = 0.25; stroke = 0;
   case 2 do
    dllInput = share;
    dllOutput = dll ('MotionProfiles.dll', 'ProfileRamp', dllInput);
    localStrokeOffset = 0.25; stroke = 0;
   case 3 do
    dllInput = share;
    dllOutput = dll ('MotionProfiles.dll', 'ProfileRamp', dllInput);
    localStrokeOffset = 0.25; stroke = 2;
   case 4 do
    dllInput = share;
    dllOutput = dll ('MotionProfiles.dll', 'ProfileFlat', dllInput);
    localStrokeOffset = 2.25; stroke = 0;
  end;
  fu = dllOutput[1];
  position = localStrokeOffset + stroke * fu;
 end;
"""


def test_flat_and_ramped_motion_profiles(tmp_path: Path) -> None:
    """What the wizard of 20-sim writes: regions of time, one of them of no length, with a division by zero."""
    run = imported(tmp_path, part("Profile", "signal out position", PROFILE)
                   + part("Lag", "signal in u; signal out y", "equations\n y = int (u - y);"),
                   "Profile\\position -> Lag\\u", 12.0)
    assert not [finding for finding in run.verdict.findings if finding.kind == "true-at-start"]
    inner = run.time % 5.0
    exact = 0.25 + 2 * np.clip(inner - 2, 0, 1)
    within = (run.time < 10) & (np.minimum(inner, 5 - inner) > 1e-6)
    agree(run["Profile.position"][within], exact[within])
    assert run["Profile.position"][-1] == pytest.approx(2.25)  # kept after both strokes


def test_discrete_systems_have_sample_times_of_their_own(tmp_path: Path) -> None:
    """The experiment states a sample time beside one quantity of each system; other blocks have that of their system."""
    def chain(name: str) -> str:
        return (part(f"Sample{name}", "signal in u; signal out y", "equations\n y = sample (u);")
                + part(f"Twice{name}", "signal in u; signal out y", "equations\n y = 2 * u;")
                + part(f"Hold{name}", "signal in u; signal out y", "equations\n y = hold (u);"))

    parts = part("Clock", "signal out y", "equations\n y = time;") + chain("A") + chain("B")
    joined = "; ".join(f"Clock\\y -> Sample{n}\\u; Sample{n}\\y -> Twice{n}\\u; Twice{n}\\y -> Hold{n}\\u" for n in "AB")
    run = imported(tmp_path, parts, joined, 1.0, "".join(
        f"<DiscreteSystem><DiscreteID>{name}</DiscreteID><TimeInterval>{time}</TimeInterval></DiscreteSystem>"
        for name, time in (("SampleA\\y", 0.1), ("TwiceB\\y", 0.25))))
    at = np.searchsorted(run.time, 0.33)
    assert [run["HoldA.y"][at], run["HoldB.y"][at]] == pytest.approx([0.6, 0.5])
    assert "sampletime: 0.1 s" in (text := (tmp_path / "out" / "m.yaml").read_text()) and "sampletime_2: 0.25 s" in text
