"""Designs of controllers beside python-control and SciPy, and their values in a diagram."""

from __future__ import annotations

import json
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from click.testing import CliRunner
from scipy import signal
from scipy.linalg import expm, solve_discrete_are
from scipy.optimize import nnls
from test_c_events import agree
from test_export import compiled

import heavebond as hb
from heavebond.cli import main
from heavebond.language.symbols import _least_distance

LOOP = """model: loop
# a servo with a lag
components:
  target:  {is: Constant, k: 0}
  control: {is: CONTROL, K_p: 1, K_i: 0 1/s, K_d: 0 s, T_f: 10 ms, y_min: -1e6, y_max: 1e6}   # to be designed
  lag:     {is: FirstOrderLag, T_1: 0.2 s}
  plant:   {is: Integrator, k: 2 1/s}
nodes:
  r: [target.y, control.r]
  c: [control.y, lag.u]
  v: [lag.y, plant.u]
  y: [plant.y, control.u]
initial: {plant.y: 0, lag.y: 0}
simulate: {until: 5 s, every: 10 ms}
"""
PID = LOOP.replace("CONTROL", "PID").replace("lag.y: 0}", "lag.y: 0, control.q: 0}")
SAMPLED = LOOP.replace("CONTROL", "DiscretePID").replace("y_max: 1e6", "y_max: 1e6, T_s: 20 ms")


@pytest.mark.parametrize(("gains", "frequency", "margin"), [
    ("p", "0.3 Hz", None), ("pd", "1 Hz", 60), ("pi", "0.1 Hz", 60), ("pid", "1 Hz", 50)])
def test_gains_have_the_margins_that_python_control_finds(gains: str, frequency: str, margin: float | None) -> None:
    """L is rational, both programs compute margins to rounding; 1e-6 leaves room for root finding."""
    control = pytest.importorskip("control")
    names = [f"control.K_{letter}" for letter in gains]
    design = hb.design_gains(hb.loads(PID), "control.y", names, crossover=frequency,
                             phase_margin=None if margin is None else f"{margin} deg")
    k_p, k_i, k_d = (design.values.get(f"control.K_{letter}", 0.0) for letter in "pid")
    s = control.tf("s")
    loop = 2 / (s * (0.2 * s + 1)) * (k_p + k_i / s + k_d * s / (0.01 * s + 1))
    _, phase, _, crossover = control.margin(loop)
    assert crossover / (2 * np.pi) == pytest.approx(float(frequency.split()[0]), rel=1e-6)
    assert design.phase_margin == pytest.approx(phase, rel=1e-6)
    if margin is not None:
        assert phase == pytest.approx(margin, rel=1e-6)
    if len(gains) == 3:  # the integral part is a tenth of the proportional part at the crossover
        assert k_i / (2 * np.pi * crossover / (2 * np.pi)) == pytest.approx(0.1 * k_p, rel=1e-6)


def test_the_bandwidth_of_the_closed_loop_is_that_of_python_control() -> None:
    """python-control finds the bandwidth on a grid, to some 1 %; |T| there is exact."""
    control = pytest.importorskip("control")
    design = hb.design_gains(hb.loads(PID), "control.y", ["control.K_p", "control.K_d"], bandwidth="2 Hz",
                             phase_margin="60 deg")
    s = control.tf("s")
    loop = 2 / (s * (0.2 * s + 1)) * (design.values["control.K_p"] + design.values["control.K_d"] * s / (0.01 * s + 1))
    assert abs(control.feedback(loop, 1)(4j * np.pi)) == pytest.approx(np.sqrt(0.5), rel=1e-3)
    assert design.bandwidth == pytest.approx(2, rel=1e-3)


def test_gains_of_a_sampled_controller_count_its_hold() -> None:
    """The plant with a hold of 20 ms from python-control, the controller as its difference equations; the block holds its
    output until the next sample and has no further delay."""
    control = pytest.importorskip("control")
    design = hb.design_gains(hb.loads(SAMPLED), "control.y", ["control.K_p", "control.K_i"], crossover="0.3 Hz",
                             phase_margin="45 deg")
    plant = control.sample_system(control.tf([2], [0.2, 1, 0]), 0.02, method="zoh")
    z = control.tf("z")
    z.dt = 0.02
    loop = plant * (design.values["control.K_p"] + design.values["control.K_i"] * 0.02 / (z - 1))
    _, phase, _, crossover = control.margin(loop)
    assert crossover / (2 * np.pi) == pytest.approx(0.3, rel=1e-5)
    assert phase == pytest.approx(45, rel=1e-5)


@pytest.mark.parametrize(("free", "options", "said"), [
    (["control.K_p"], {}, "design-frequency"), (["control.K_p"], {"crossover": 1.0, "phase_margin": 60}, "design-margin"),
    ([], {"crossover": 1.0}, "design-free"), (["control.K_p", "control.K_i"], {"crossover": 1.0}, "design-margin"),
    (["control.K_p", "control.K_i"], {"crossover": "1 Hz", "phase_margin": 60}, "design-not-reached"),
    (["control.K_p", "plant.k"], {"crossover": "1 Hz", "phase_margin": 60}, "loop-none"),
    (["control.K_p"], {"crossover": "-1 Hz"}, "must be above 0"), (["control.K_p"], {"bandwidth": 0.0}, "must be above 0"),
    (["control.K_p", "control.K_i"], {"crossover": "1 Hz", "phase_margin": 400}, "below 180 deg"),
    (["control.K_p", "control.K_i"], {"crossover": "1 Hz", "phase_margin": "0 deg"}, "above 0"),
    (["control.K_p", "plant.k"], {"crossover": "1 Hz", "phase_margin": 60}, "not gains in series"),
    (["control.K_p"], {"crossover": "1 m"}, "unit"), (["control.K"], {"crossover": "1 Hz"}, "parameter-unknown")])
def test_mistakes_are_named(free: list[str], options: dict[str, object], said: str) -> None:
    with pytest.raises(hb.HeavebondError, match=said):
        hb.design_gains(hb.loads(PID), "control.y", free, **options)


@pytest.mark.parametrize(("kind", "band", "cut_off"), [
    ("butterworth", "lowpass", [5]), ("bessel", "lowpass", [5]), ("chebyshev 1", "highpass", [5]),
    ("chebyshev 2", "bandstop", [4, 6])])
def test_filters_have_the_response_of_scipy(kind: str, band: str, cut_off: list[float]) -> None:
    """Coefficients against poles, zeros and gain of SciPy's prototypes: the same filter through another representation.
    Poles near z = 1 make coefficients of order 6 sensitive to rounding: 5e-5."""
    frequencies = np.array([0.5, 3.0, 5.0, 20.0])
    types = {"butterworth": "butter", "bessel": "bessel", "chebyshev 1": "cheby1", "chebyshev 2": "cheby2"}
    edges = np.array(cut_off) if len(cut_off) == 2 else cut_off[0]
    for period in (None, 1e-3):
        b, a = hb.filter_coefficients(kind, 3, cut_off, band, period=period)
        options = {"analog": True} if period is None else {"fs": 1 / period}
        edge = edges * 2 * np.pi if period is None else edges
        if kind == "bessel":
            poles = signal.bessel(3, edge, band, norm="mag", output="zpk", **options)
        else:
            poles = signal.iirfilter(3, edge, rp=1.0, rs=40.0, btype=band, ftype=types[kind], output="zpk", **options)
        points = 2j * np.pi * frequencies if period is None else np.exp(2j * np.pi * frequencies * period)
        expected = poles[2] * np.prod(points[:, None] - poles[0], axis=1) / np.prod(points[:, None] - poles[1], axis=1)
        assert np.polyval(b, points) / np.polyval(a, points) == pytest.approx(expected, rel=1e-4, abs=1e-9)
    with pytest.raises(hb.UsageError, match="filter-nyquist"):
        hb.filter_coefficients("butterworth", 2, [600], period=1e-3)
    with pytest.raises(hb.UsageError, match="filter-unknown"):
        hb.filter_coefficients("elliptic", 2, [600])
    with pytest.raises(hb.UsageError, match="one cut-off frequency above 0 Hz"):
        hb.filter_coefficients("bessel", 2, [-5])


def test_a_filter_whose_coefficients_lose_its_response_is_refused() -> None:
    """Poles of a Butterworth filter at 2 Hz, sampled at 1 kHz, are near z = 1. From order 7 on, rounding of the polynomial
    to 16 digits moves them; with order 8 two of them are outside the unit circle."""
    for order in (8, 12):
        with pytest.raises(hb.UsageError, match="accurate up to order 6") as error:
            hb.filter_coefficients("butterworth", order, [2], period=1e-3)
        assert "filter-rounding" in str(error.value)
    _, a = hb.filter_coefficients("butterworth", 6, [2], period=1e-3)
    assert np.abs(np.roots(a)).max() < 1
    assert len(hb.filter_coefficients("butterworth", 12, [2], period=1e-1)[1]) == 13
    with pytest.raises(hb.UsageError, match="filter-rounding"):
        hb.filter_coefficients("butterworth", 60, [5])


def test_a_design_that_makes_the_loop_unstable_is_not_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A plant of negative gain: any positive gain makes the loop unstable. The table is shown, the file is not written."""
    monkeypatch.chdir(tmp_path)
    Path("loop.yaml").write_text(PID.replace("k: 2 1/s", "k: -2 1/s"), encoding="utf-8")
    run = CliRunner().invoke(main, ["design", "loop.yaml", "--loop", "control.y", "--free", "control.K_p", "--crossover",
                                    "1 Hz", "--write", "designed.yaml", "--json", "told.json"])
    assert run.exit_code == 1 and "design-unstable" in run.output and "growing mode" in run.output
    assert not Path("designed.yaml").exists()
    told = json.loads(Path("told.json").read_text(encoding="utf-8"))
    assert told["verdict"] == "unstable" and not told["ok"] and told["values"]["control.K_p"]


def test_a_crossover_above_half_the_sampling_rate_is_refused() -> None:
    with pytest.raises(hb.UsageError, match="half the sampling rate of the loop, 25 Hz"):
        hb.design_gains(hb.loads(SAMPLED), "control.y", ["control.K_p"], crossover="30 Hz")


def test_lqg_is_that_of_python_control() -> None:
    control = pytest.importorskip("control")
    a, b, c = np.array([[0.0, 1], [-4, -0.2]]), np.array([[0.0], [1]]), np.array([[1.0, 0]])
    q, r, w, v = np.diag([10.0, 1]), np.array([[0.1]]), np.diag([0.0, 2]), np.array([[0.01]])
    ours = hb.lqg((a, b, c), (q, r), (w, v))
    assert ours.gain == pytest.approx(np.asarray(control.lqr(a, b, q, r)[0]), rel=1e-8)
    assert ours.observer == pytest.approx(np.asarray(control.lqe(a, np.eye(2), c, w, v)[0]), rel=1e-8)
    step = control.sample_system(control.ss(a, b, c, 0), 0.05)
    ours = hb.lqg((step.A, step.B, step.C), (q, r), (w, v), period=0.05)
    assert ours.gain == pytest.approx(np.asarray(control.dlqr(step.A, step.B, q, r)[0]), rel=1e-8)
    assert ours.observer == pytest.approx(np.asarray(control.dlqe(step.A, np.eye(2), step.C, w, v)[0]), rel=1e-8)
    # outputs with a direct effect, cross weights, and a noise of the outputs that is that of the states
    d, cross, common = np.array([[0.3]]), np.array([[0.4], [-0.1]]), np.array([[0.0], [0.1]])
    for system, regulator in ((control.ss(a, b, c, d), control.lqr), (step, control.dlqr)):
        period = 0.05 if regulator is control.dlqr else None
        ours = hb.lqg((system.A, system.B, system.C, d), (q, r, cross), (w, v, common), period=period)
        assert ours.gain == pytest.approx(np.asarray(regulator(system.A, system.B, q, r, cross)[0]), rel=1e-8)
        dual = np.asarray(regulator(system.A.T, system.C.T, w, v, common)[0]).T
        assert ours.observer == pytest.approx(dual, rel=1e-8)
        sampling = [] if period is None else [period]
        block = control.ss(ours.a, ours.b, ours.c, 0, *sampling)
        closed = control.feedback(control.ss(system.A, system.B, system.C, d, *sampling), block, 1)
        expected = np.sort_complex(np.concatenate(ours.poles))
        assert np.sort_complex(closed.poles()) == pytest.approx(expected, abs=1e-7)
    with pytest.raises(hb.UsageError, match="design-riccati"):
        hb.lqg((np.diag([1.0, 2.0]), np.array([[1.0], [0]]), c), (q, r), (np.eye(2), v))


CART = """model: cart
components:
  observer: {is: BLOCK, n: 1, m: 1, r: 1, A: [[0PER]], B: [[0PER]], C: [[0]]SAMPLE}   # to be designed
  sensor:   {is: Gain, k: 1, u: "=cart.x/1 m"}
  force:    {is: ForceSource, u: "=10 N*command.y"}
  command:  {is: Gain, k: 1}
  gust:     {is: ForceSource, u: 0 N}
  cart:     {is: Mass, m: 2 kg}
nodes:
  cart: [force.a, gust.a, cart.a]
  y: [sensor.y, "observer.u[1]"]
  u: ["observer.y[1]", command.u]
initial: {cart.x: 10 mm, cart.v: 0 m/s}
simulate: {until: 10 s, every: 10 ms}
"""


@pytest.mark.parametrize(("block", "per", "sample"), [
    ("LinearSystem", " 1/s", ""), ("DiscreteStateSpace", "", ", T_s: 50 ms")])
def test_the_command_writes_an_observer_controller_that_holds_the_cart(block: str, per: str, sample: str, tmp_path: Path,
                                                                       monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text = CART.replace("BLOCK", block).replace("PER", per).replace("SAMPLE", sample)
    Path("cart.yaml").write_text(text, encoding="utf-8")
    words = ["design", "cart.yaml", "--lqg", "observer", "--weigh", "cart.x=10 mm", "--disturbance", "cart.f=1 N", "--noise",
             "1e-4", "--in-place"]
    run = CliRunner().invoke(main, words)
    assert run.exit_code == 0, run.output
    assert "# to be designed" in Path("cart.yaml").read_text(encoding="utf-8")
    designed = hb.load("cart.yaml")
    assert hb.loop_crossings(designed, "command.y").stable
    held = hb.simulate(designed)
    assert abs(held["cart.x"].magnitude[-1]) < 1e-4  # from 10 mm; without control the cart stays there
    for weigh, disturbance, message in (
            ("cart.x=10 N", "cart.f=1 N", "is in N"), ("cart.x=10 mm", "cart.f=1 m", "is in m"),
            ("cart.x=0 mm", "cart.f=1 N", "must be above 0")):
        run = CliRunner().invoke(main, [*words[:4], "--weigh", weigh, "--disturbance", disturbance])
        assert run.exit_code == 2 and message in run.output


def test_the_command_writes_gains_and_filters(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("loop.yaml").write_text(PID, encoding="utf-8")
    run = CliRunner().invoke(main, ["design", "loop.yaml", "--loop", "control.y", "--free", "control.K_p,control.K_d",
                                    "--crossover", "1 Hz", "--phase-margin", "60 deg", "--over", "plant.k=1 1/s, 4 1/s",
                                    "--in-place", "--json", "told.json"])
    assert run.exit_code == 0, run.output
    text = Path("loop.yaml").read_text(encoding="utf-8")
    assert "# a servo with a lag" in text and "# to be designed" in text
    margins = hb.loop_margins("loop.yaml", "control.y")
    assert margins.least_phase is not None and margins.least_phase.value == pytest.approx(60, rel=1e-4)
    told = json.loads(Path("told.json").read_text(encoding="utf-8"))
    assert set(told["margins"]) == {"design", "plant.k = 1 1/s", "plant.k = 4 1/s"}
    other = hb.loop_margins("loop.yaml", "control.y", parameters={"plant.k": "4 1/s"})
    assert other.least_phase is not None
    assert told["margins"]["plant.k = 4 1/s"]["phase"][0] == pytest.approx(other.least_phase.value, rel=1e-3)
    Path("smooth.yaml").write_text("""model: smooth
components:
  source: {is: Sine, a: 1, T: 1 s}
  smooth: {is: TransferFunction, n: 3, a: [1, 1, 1], b: [0, 0, 1], u: =source.y}
simulate: {until: 1 s, every: 10 ms}
""", encoding="utf-8")
    run = CliRunner().invoke(main, ["design", "smooth.yaml", "--filter", "smooth", "--cut-off", "5 Hz", "--in-place"])
    assert run.exit_code == 0, run.output
    system = hb.state_space("smooth.yaml", ["source.y"], ["smooth.y"])
    assert abs(system.response(2j * np.pi * 5)[0, 0, 0]) == pytest.approx(np.sqrt(0.5), rel=1e-6)
    run = CliRunner().invoke(main, ["design", "smooth.yaml", "--filter", "smooth", "--cut-off", "5 Hz", "--order", "3",
                                    "--in-place"])
    assert run.exit_code == 0, run.output  # the number of coefficients changes from 3 to 4
    system = hb.state_space("smooth.yaml", ["source.y"], ["smooth.y"])
    assert abs(system.response(2j * np.pi * 5)[0, 0, 0]) == pytest.approx(np.sqrt(0.5), rel=1e-6)
    run = CliRunner().invoke(main, ["design", "loop.yaml", "--loop", "control.y", "--filter", "smooth"])
    assert "design-task" in run.output


def test_lists_of_numbers_keep_equal_ones(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`1, 1` for one input are two numbers, not one."""
    monkeypatch.chdir(tmp_path)
    text = CART.replace("BLOCK", "DiscreteStateSpace").replace("PER", "").replace("SAMPLE", ", T_s: 50 ms")
    Path("cart.yaml").write_text(text, encoding="utf-8")
    command = ["design", "cart.yaml", "--lqg", "observer", "--weigh", "cart.x=10 mm", "--disturbance", "cart.f=1 N"]
    for option in ("--noise", "--effort"):
        run = CliRunner().invoke(main, [*command, option, "1, 1"])
        assert run.exit_code == 2 and "design-sizes" in run.output
    run = CliRunner().invoke(main, [*command, "--lqg", "observe"])
    assert "design-block" in run.output and "DiscreteStateSpace: observer." in run.output


def test_an_output_in_no_loop_has_no_margins() -> None:
    """The second output of the block acts on nothing; the first one is designed as without it."""
    text = CART.replace("BLOCK", "LinearSystem").replace("PER", " 1/s").replace("SAMPLE", "")
    task = {"cart.x": "10 mm"}, {"cart.f": "1 N"}, [1e-3]
    wider = hb.loads(text.replace("r: 1, A", "r: 2, A").replace("C: [[0]]", "C: [[0], [0]]"))
    two = hb.design_lqg(wider, "observer", task[0], [1, 1], *task[1:])
    one = hb.design_lqg(hb.loads(text), "observer", task[0], [1], *task[1:])
    assert list(two.points) == ["design, observer.y[1]"] and two.gain[0] == pytest.approx(one.gain[0])
    assert two.gain[1] == pytest.approx(0, abs=1e-9)
    margins = [next(iter(found.points.values())).least_phase for found in (one, two)]
    assert margins[0] is not None and margins[1] is not None and margins[0].value == pytest.approx(margins[1].value)


def test_a_state_that_the_weights_do_not_contain_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a weight of the speed only, the regulator brakes the cart and leaves its position where it is: a pole at 0."""
    monkeypatch.chdir(tmp_path)
    for block, per, sample in (("LinearSystem", " 1/s", ""), ("DiscreteStateSpace", "", ", T_s: 50 ms")):
        text = CART.replace("BLOCK", block).replace("PER", per).replace("SAMPLE", sample)
        Path("cart.yaml").write_text(text, encoding="utf-8")
        run = CliRunner().invoke(main, ["design", "cart.yaml", "--lqg", "observer", "--weigh", "cart.v=1 m/s",
                                        "--disturbance", "cart.f=1 N"])
        assert run.exit_code == 2
        assert "design-not-decaying" in run.output or "design-riccati" in run.output
        assert "cart.x" in run.output or "design-riccati" in run.output


@pytest.mark.parametrize(("block", "per", "sample", "direct"), [
    ("LinearSystem", " 1/s", "", "0.3*command.y"),
    ("DiscreteStateSpace", "", ", T_s: 50 ms", "0.3*command.y"),        # of the same instant: a signal
    ("DiscreteStateSpace", "", ", T_s: 50 ms", "0.03*force.a.f/1 N"),   # of the former instant: a force
    ("DiscreteStateSpace", "", ", T_s: 50 ms", "0.02*command.y - 0.03*force.a.f/1 N")])
def test_an_observer_counts_the_direct_effect_of_its_command(block: str, per: str, sample: str, direct: str) -> None:
    """The closed loop of the diagram has the poles of the regulator and of the observer (separation). Rounding of double
    poles at 0: square root of 1e-16."""
    model = hb.loads(CART.replace("BLOCK", block).replace("PER", per).replace("SAMPLE", sample).replace(
        "cart.x/1 m", f"cart.x/1 m + {direct}"))
    design = hb.design_lqg(model, "observer", {"cart.x": "10 mm"}, [0.3], {"cart.f": "1 N"}, [1e-3])
    assert design.points["design"].stable
    designed = model.with_parameters({"observer.n": str(len(design.a)), **{
        f"observer.{name}[{i + 1}][{j + 1}]": float(value) for name in "ABC"
        for (i, j), value in np.ndenumerate(getattr(design, name.lower()))}})
    poles = np.linalg.eigvals(hb.state_space(designed, ["gust.u"], ["cart.x"]).a)
    expected = np.sort_complex(np.concatenate(design.poles))
    expected, poles = (np.sort_complex(values[np.abs(values) > 1e-6]) for values in (expected, poles))
    assert poles == pytest.approx(expected, abs=1e-6 * np.abs(expected).max())


def test_a_design_whose_measured_value_contains_a_derivative_of_the_command_is_refused() -> None:
    text = CART.replace("BLOCK", "LinearSystem").replace("PER", " 1/s").replace("SAMPLE", "").replace(
        "{is: ForceSource, u: \"=10 N*command.y\"}", "{is: VelocitySource, u: \"=1 m/s*command.y\"}").replace(
        "cart.x/1 m", "force.a.f/1 N").replace(", gust.a, cart.a]", ", cart.a]").replace(
        "  gust:     {is: ForceSource, u: 0 N}\n", "").replace(", cart.v: 0 m/s", "")
    with pytest.raises(hb.UsageError, match="derivative of a command"):
        hb.design_lqg(hb.loads(text), "observer", {"cart.x": "10 mm"}, [1], {"command.y": 1}, [1e-3])


TANK = """model: tank
components:
  target:  {is: Constant, k: 1 m}
  control: {is: DiscretePID, K_p: 0.02 m**2/s, K_i: 0.0002 m**2/s**2, y_min: 0 m**3/s, y_max: 20 L/s, T_s: 1 s, u: =tank.h}
  valve:   {is: FirstOrderLag, T_1: 3 s}
  inflow:  {is: FlowSource}
  tank:    {is: OpenTank, A: 2 m**2}
  outlet:  {is: Orifice, q_r: 5 L/s, dp_r: 0.1 bar, dp_t: 1 Pa}
  drain:   {is: Tank}
nodes:
  inlet: [tank.a, inflow.a]
  bottom: [tank.b, outlet.a]
  away: [outlet.b, drain.a]
  r: [target.y, control.r]
  u: [control.y, valve.u]
  q: [valve.y, inflow.u]
initial: {tank.h: 1 m, valve.y: 0 L/s}
simulate: {until: 300 s, every: 1 s}
"""


def test_gains_at_an_operating_point_that_the_gains_reach(tmp_path: Path) -> None:
    """A sampled PI of the level of a tank: without the integral gain, the command at rest would be another one. The margins
    are those of python-control for the linearised tank."""
    control = pytest.importorskip("control")
    file = tmp_path / "tank.yaml"
    file.write_text(TANK, encoding="utf-8")
    words = ["design", str(file), "--loop", "control.y", "--free", "control.K_p,control.K_i", "--crossover", "0.02 Hz",
             "--phase-margin", "60 deg", "--in-place"]
    run = CliRunner().invoke(main, words)
    assert run.exit_code == 2 and "command is at its limit" in " ".join(run.output.split())  # 0 at the start
    run = CliRunner().invoke(main, [*words, "--at", "3000 s"])
    assert run.exit_code == 0, run.output
    assert "m**2/s**2" in file.read_text(encoding="utf-8") and "J/kg" not in run.output  # the units of the diagram
    found = hb.load(file).body.instances["control"].settings
    k_p, k_i = (float(found[name].text.split()[0]) for name in ("K_p", "K_i"))
    flow = 5e-3 * np.sqrt(1000 * 9.81 / 1e4)
    step = control.sample_system(control.ss([[-1 / 3, 0], [1 / 2, -flow / 4]], [[1 / 3], [0]], [[0, 1]], 0), 1.0)
    loop = control.tf(step) * (k_p + k_i * control.tf([1], [1, -1], 1.0))
    value = complex(loop(np.exp(2j * np.pi * 0.02)))
    assert value == pytest.approx(np.exp(1j * (np.radians(60) - np.pi)), abs=1e-4)


TWO_CARTS = """model: carts
components:CONTROL
  left:    {is: Mass, m: 2 kg}
  right:   {is: Mass, m: 1 kg}
  spring:  {is: SpringDamper, c: 40 N/m, d: 0.5 N*s/m}
nodes: {left: [pushed.a, left.a, spring.a], right: [pulled.a, right.a, spring.b]}
initial: {left.x: 0.3 m, left.v: 0 m/s, right.x: -0.2 m, right.v: 0 m/s}
simulate: {until: 3 s, every: 50 ms}
"""


def test_a_state_feedback_is_that_of_python_control(tmp_path: Path) -> None:
    """Two carts, with a force on each; the second measured value contains the command directly."""
    control = pytest.importorskip("control")
    file = tmp_path / "carts.yaml"
    file.write_text(TWO_CARTS.replace("CONTROL", """
  feedback: {is: MatrixGain, K: [[0 N, 0 N, 0 N, 0 N], [0 N, 0 N, 0 N, 0 N]],
             u: ["=left.x/1 m", "=left.v/(1 m/s) + pushed.u/9 N", "=right.x/1 m", "=right.v/(1 m/s)"]}
  pushed:  {is: ForceSource, u: "=feedback.y[1]"}
  pulled:  {is: ForceSource, u: "=feedback.y[2]"}""").replace("until: 3 s", "until: 8 s"), encoding="utf-8")
    words = ["design", str(file), "--lqr", "feedback", "--weigh", "left.x=20 mm", "--weigh", "right.x=10 mm", "--effort"]
    figures = tmp_path / "figures.json"
    run = CliRunner().invoke(main, [*words, "2, 3", "--over", "right.m=2 kg", "--in-place", "--json", str(figures)])
    assert run.exit_code == 0, run.output
    found = json.loads(figures.read_text(encoding="utf-8"))
    a = np.array([[0, 1, 0, 0], [-20, -0.25, 20, 0.25], [0, 0, 0, 1], [40, 0.5, -40, -0.5]])
    b, c, d = np.array([[0, 0], [0.5, 0], [0, 0], [0, 1.0]]), np.eye(4), np.array([[0, 0], [1 / 9, 0], [0, 0], [0, 0]])
    gain, _, poles = control.lqr(a, b, np.diag([1 / 0.02**2, 0, 1 / 0.01**2, 0]), np.diag([1 / 4, 1 / 9]))
    assert np.array(found["k"]) @ (c - d @ gain) == pytest.approx(-np.asarray(gain), rel=1e-7, abs=1e-7)
    closed = hb.modes(file)
    assert all(min(abs(mode.value - pole) for pole in poles) < 1e-6 * abs(mode.value) for mode in closed.modes)
    assert {"design, feedback.y[1]", "right.m = 2 kg, feedback.y[2]"} < found["margins"].keys()
    file.write_text(file.read_text(encoding="utf-8").replace("=right.v/(1 m/s)", "=right.x/1 m"), encoding="utf-8")
    run = CliRunner().invoke(main, [*words, "2, 3"])
    assert run.exit_code == 2 and "do not determine the 4 states" in run.output and "right.v" in run.output


PUSHED_CART = """model: cart
components:
  control: BLOCK
  sensor:  {is: Gain, k: 1, u: "=cart.x/1 m"}
  force:   {is: ForceSource, u: "=10 N*command.y"}
  command: {is: Gain, k: 1}
  cart:    {is: Mass, m: 2 kg}
nodes:
  cart: [force.a, cart.a]
  place: [sensor.y, "control.u[1]"]
  command: [OUT, command.u]
initial: {cart.x: 1 m, cart.v: 0 m/s}
show: {x: {is: cart.x, unit: m}, y: {is: command.u, unit: 1}}
simulate: {until: 3 s, every: 25 ms}
"""
PREDICTIVE = PUSHED_CART.replace("OUT", '"control.y[1]"').replace(
    "BLOCK", "{is: PredictiveController, n: 1, m: 1, r: 1, LIMITS, T_s: 50 ms}")
REGULATOR = PUSHED_CART.replace("OUT", '"control.y[1]"').replace(
    "BLOCK", "{is: DiscreteStateSpace, n: 1, m: 1, r: 1, A: [[0]], B: [[0]], C: [[0]], T_s: 50 ms}")
TASK = ["--weigh", "cart.x=10 mm", "--effort", "0.05", "--disturbance", "cart.f=1 N", "--noise", "1e-4", "--in-place"]


def least_distance(matrix: np.ndarray, c: np.ndarray, low: np.ndarray, high: np.ndarray, soft: np.ndarray) -> np.ndarray:
    """By non-negative least squares: Lawson, Hanson, Solving Least Squares Problems, 1974, chapter 23. The excess over a
    soft limit is another variable."""
    extended = np.hstack([matrix, np.diag(soft)[:, soft > 0]])
    rows, right = np.vstack([extended, -extended]), np.concatenate([low - c, c - high])
    stacked = np.vstack([rows.T, right])
    last = np.eye(len(stacked))[-1]
    residual = stacked @ nnls(stacked, last, maxiter=10_000)[0] - last
    return (-residual[:-1] / residual[-1])[:matrix.shape[1]]


def test_the_shortest_correction_is_that_of_non_negative_least_squares() -> None:
    """30 steps of the interior-point method. Hard limits: rounding. Soft limits, which here are often far from what the hard
    limits permit: multipliers up to 1e4 amplify the rounding of both methods."""
    random = np.random.default_rng(8)
    symbols = [ca.SX.sym("W", 18, 6), *(ca.SX.sym(name, 18) for name in ("c", "low", "high", "soft"))]
    found = ca.Function("v", symbols, [_least_distance(*symbols)])
    active = 0
    for k in range(60):
        response = np.tril(random.standard_normal((6, 6)), -1) + np.eye(6)
        measured = np.tril(random.standard_normal((6, 6)))
        matrix, high = np.vstack([response, response - np.eye(6, k=-1) @ response, measured]), random.uniform(0.2, 1, 18)
        c = matrix @ random.standard_normal(6) * 10 ** random.uniform(-1, 1.5)
        if k % 2:
            high[12:] = 1e6
        soft = np.concatenate([np.zeros(12), np.full(6, 0.01 * np.linalg.norm(measured, axis=1).max())])
        v = np.array(found(matrix, c, -high, high, soft)).ravel()
        expected = least_distance(matrix, c, -high, high, soft)
        assert np.abs(v - expected).max() < (1e-9 if k % 2 else 1e-5) * max(np.abs(c).max(), 1)
        assert (v == 0).all() == (np.abs(c / high).max() <= 1)
        active += (v != 0).any()
    assert active > 30


@pytest.fixture(scope="module")
def cart_runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The cart with an LQG controller, and with predictive controllers of wide and of narrow limits."""
    folder, files = tmp_path_factory.mktemp("cart"), {}
    wide, narrow = "y_min: [-1e3], y_max: [1e3], rate: [1e6 1/s]", "y_min: [-0.5], y_max: [0.4], rate: [4 1/s]"
    for name, option, text in (("lqg", "--lqg", REGULATOR), ("wide", "--mpc", PREDICTIVE.replace("LIMITS", wide)),
                               ("narrow", "--mpc", PREDICTIVE.replace("LIMITS", narrow))):
        files[name] = folder / f"{name}.yaml"
        files[name].write_text(text, encoding="utf-8")
        run = CliRunner().invoke(main, ["design", str(files[name]), option, "control", *TASK])
        assert run.exit_code == 0, run.output
    return files


@pytest.mark.long
def test_a_predictive_controller_without_an_active_limit_is_the_regulator(cart_runs: dict[str, Path]) -> None:
    """The same difference equations in another form: rounding, over 60 samples."""
    commands = [hb.simulate(hb.load(cart_runs[name]), rtol=1e-10).si["y"] for name in ("lqg", "wide")]
    assert np.abs(commands[0]).max() > 10
    assert commands[1] == pytest.approx(commands[0], abs=1e-9 * np.abs(commands[0]).max())
    at_rest = [hb.loads(cart_runs[name].read_text(encoding="utf-8").replace("cart.x: 1 m", "cart.x: 0 m"))
               for name in ("lqg", "narrow")]
    phases, gains = zip(*((found.least_phase.value, found.gain_up.value) for found in (
        hb.loop_crossings(model, "command.y") for model in at_rest)), strict=True)
    assert phases[1] == pytest.approx(phases[0], rel=1e-6) and gains[1] == pytest.approx(gains[0], rel=1e-6)


def test_sensitivities_of_a_predictive_controller_are_those_of_finite_differences(cart_runs: dict[str, Path]) -> None:
    """The mass of the cart, at active limits too; differences with 1e-5 kg have an error of 1e-6 of the sensitivity."""
    model, h = hb.load(cart_runs["narrow"]), 1e-5
    found = hb.simulate(model, sensitivities=["cart.m"]).sensitivity("x", "cart.m")
    low, high = (hb.simulate(model.with_parameters({"cart.m": 2 + d}), rtol=1e-11).si["x"] for d in (-h, h))
    assert found == pytest.approx((high - low) / (2 * h), abs=1e-5 * np.abs(found).max())


def test_a_predictive_controller_keeps_its_limits_and_is_optimal_within_them(cart_runs: dict[str, Path]) -> None:
    """Each command is the first one of the plan that the problem solved in another way gives, at the states of the run."""
    run = hb.simulate(hb.load(cart_runs["narrow"]))
    y = run.si["y"]
    assert y.min() == pytest.approx(-0.5, abs=1e-12) and y.max() == pytest.approx(0.4, abs=1e-12)
    assert np.abs(np.diff(y)).max() == pytest.approx(4 * 0.05, abs=1e-12)
    assert abs(run.si["x"][-1]) < 0.01
    p = run.assembly.parameter_values
    plan, response = (np.array([[p[f"control.{m}[{i}][{j}]"] for j in range(1, n + 1)] for i in range(1, 31)])
                      for m, n in (("F", 2), ("W", 10)))
    low, high = np.repeat([-0.5, -0.2, -1e6], 10), np.repeat([0.4, 0.2, 1e6], 10)
    soft = np.repeat([0, p["control.S[1]"]], [20, 10])
    states = np.array([run.si["control.x[1]"], run.si["control.x[2]"]])
    for k in range(2, 100, 2):  # after the sample at 25 ms * k; the states before it are those of the point before
        c = plan @ states[:, k - 1]
        c[10] -= y[k - 1]
        assert y[k] == pytest.approx((c + response @ least_distance(response, c, low, high, soft))[0], abs=1e-7)
    # a regulator with a limited actuator, without a plan: the position overshoots by more
    clipped = cart_runs["lqg"].read_text(encoding="utf-8").replace(
        "{is: Gain, k: 1}", "{is: Saturation, u_min: -0.5, u_max: 0.4}")
    assert hb.simulate(hb.loads(clipped)).si["x"].min() < 1.5 * run.si["x"].min()


@pytest.mark.long
@compiled
def test_a_predictive_controller_runs_in_c(cart_runs: dict[str, Path], tmp_path: Path) -> None:
    """The integrator of C steps with 1e-9 over 60 samples."""
    agree(hb.load(cart_runs["narrow"]), tmp_path)


CARTS = TWO_CARTS.replace("CONTROL", """
  control: {is: PredictiveController, n: 1, m: 2, r: 2, y_min: [-1, -0.6], y_max: [1, 0.6], rate: [8 1/s, 5 1/s],
            u_min: [-0.35, -1e6], u_max: [1e6, 0.25], T_s: 50 ms, u: ["=left.x/1 m", "=right.x/1 m"]}
  pushed:  {is: ForceSource, u: "=12 N*control.y[1]"}
  pulled:  {is: ForceSource, u: "=8 N*control.y[2]"}""")


@pytest.fixture(scope="module")
def carts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two carts with two commands, and limits of commands, rates and positions."""
    file = tmp_path_factory.mktemp("carts") / "carts.yaml"
    file.write_text(CARTS, encoding="utf-8")
    run = CliRunner().invoke(main, [
        "design", str(file), "--mpc", "control", "--weigh", "left.x=20 mm", "--weigh", "right.x=20 mm",
        "--effort", "0.2, 0.3", "--disturbance", "left.f=1 N", "--disturbance", "right.f=1 N", "--noise", "1e-4, 1e-4",
        "--horizon", "8", "--over", "spring.c=20 N/m, 80 N/m", "--in-place"])
    assert run.exit_code == 0, run.output
    assert "spring.c = 80 N/m, control.y[2]" in run.output
    return file


@pytest.mark.long
def test_commands_of_a_predictive_controller_of_two_inputs_are_those_of_a_quadratic_program(carts: Path) -> None:
    """At each sample the commands are those of the quadratic program over states and commands, written down from the
    equations of the carts: weighted squares of positions and commands over the horizon, the cost of the regulator after it,
    limits of commands and rates, and squares of the excess of positions. qpOASES and the interior-point method agree to some
    1e-7."""
    run = hb.simulate(hb.load(carts))
    commands = np.array([run.si["control.y[1]"], run.si["control.y[2]"]]).T
    p = run.assembly.parameter_values
    n, size, steps = 4, 0.05, 8
    # x = (left.x, left.v, right.x, right.v)
    a = np.array([[0, 1, 0, 0], [-20, -0.25, 20, 0.25], [0, 0, 0, 1], [40, 0.5, -40, -0.5]])
    b = np.array([[0, 0], [6, 0], [0, 0], [0, 8.0]])
    both = expm(np.block([[a, b], [np.zeros((2, 6))]]) * size)
    a, b, c = both[:4, :4], both[:4, 4:], np.eye(4)[[0, 2]]
    q, r = size * c.T @ c / 0.02**2, size * np.diag([1 / 0.2**2, 1 / 0.3**2])
    least = solve_discrete_are(a, b, q, r)
    y_max, change = np.array([1, 0.6]), size * np.array([8, 5])
    soft = np.array([p["control.S[1]"], p["control.S[2]"]])
    program = ca.Opti("conic")
    state, command, excess = program.variable(n, steps + 1), program.variable(2, steps), program.variable(2, steps)
    start, last = program.parameter(n), program.parameter(2)
    cost = ca.bilin(ca.DM(least), state[:, -1], state[:, -1])
    program.subject_to(state[:, 0] == start)
    for k in range(steps):
        cost += ca.bilin(ca.DM(q), state[:, k], state[:, k]) + ca.bilin(ca.DM(r), command[:, k], command[:, k])
        cost += ca.sumsqr(excess[:, k] / soft)
        program.subject_to(state[:, k + 1] == a @ state[:, k] + b @ command[:, k])
        program.subject_to(program.bounded(-y_max, command[:, k], y_max))
        program.subject_to(program.bounded(-change, command[:, k] - (command[:, k - 1] if k else last), change))
        measured = c @ state[:, k + 1]
        program.subject_to(measured[0] >= -0.35 - excess[0, k])
        program.subject_to(measured[1] <= 0.25 + excess[1, k])
    program.minimize(cost)
    program.solver("qpoases", {"printLevel": "none", "print_time": False})
    estimates = np.array([run.si[f"control.x[{k}]"] for k in range(1, 5)]).T
    permuted = [["left.x", "left.v", "right.x", "right.v"].index(name) for name in hb.state_space(
        carts, ["control.y[1]"], ["left.x"]).states if not name.startswith("control")]
    active = np.zeros(3)
    for k in range(1, 60):
        x = np.zeros(n)
        x[permuted] = estimates[k - 1]
        program.set_value(start, x)
        program.set_value(last, commands[k - 1])
        solution = program.solve()
        assert commands[k] == pytest.approx(solution.value(command)[:, 0], abs=1e-6), k
        distances = y_max - np.abs(commands[k]), change - np.abs(commands[k] - commands[k - 1])
        active += [*(distance.min() < 1e-6 for distance in distances), solution.value(excess).max() > 1e-6]
    assert (active > 3).all()  # each kind of limit matters
    free = hb.simulate(hb.load(carts).with_parameters({"control.u_min[1]": -1e6, "control.u_max[2]": 1e6}))
    # the filter does not know the speeds of the start: millimetres of excess
    assert free.si["right.x"].max() > 0.3 and run.si["right.x"].max() < 0.255 and run.si["left.x"].min() > -0.355


def test_options_without_effect_on_a_design_are_refused(cart_runs: dict[str, Path]) -> None:
    for arguments, option in ((["--lqg", "control", *TASK, "--horizon", "5"], "--horizon has no effect on a design by"),
                              (["--mpc", "control", *TASK, "--crossover", "1 Hz"], "--crossover has no effect"),
                              (["--filter", "control", "--over", "cart.m=1 kg"], "--over has no effect"),
                              (["--loop", "command.y", "--free", "sensor.k", "--order", "3"], "--order has no effect"),
                              (["--loop", "command.y", "--notch", "sensor", "--phase-margin", "50 deg"], "--phase-margin")):
        run = CliRunner().invoke(main, ["design", str(cart_runs["lqg"]), *arguments])
        assert run.exit_code == 2 and option in " ".join(run.output.split()), (arguments, run.output)


def test_mistakes_of_a_predictive_design_are_named(cart_runs: dict[str, Path], tmp_path: Path) -> None:
    for name, arguments, said in (
            ("lqg", ["--mpc", "control", *TASK], "'control' is not a PredictiveController"),
            ("wide", ["--lqg", "control", *TASK], "Name a LinearSystem or a DiscreteStateSpace"),
            ("wide", ["--mpc", "control", *TASK, "--horizon", "31"], "1 to 30 are possible"),
            ("wide", ["--mpc", "control", *TASK, "--effort", "1, 1"], "effort needs 1 number above 0"),
            ("wide", ["--mpc", "control", "--lqg", "control"], "exactly one of")):
        run = CliRunner().invoke(main, ["design", str(cart_runs[name]), *arguments])
        assert run.exit_code == 2 and said in " ".join(run.output.split()), (arguments, run.output)
    run = CliRunner().invoke(main, ["export", str(cart_runs["wide"]), "-o", str(tmp_path / "cart.mo")])
    assert run.exit_code == 2 and "least_distance" in run.output


COMPENSATED = """model: compensated
components:
  target: {is: Constant, k: 0}
  gain:   {is: Gain, k: GAIN, u: =target.y - plant.y}
  lead:   {is: LeadLag, T_1: 1 s, T_2: 1 s, u: =gain.y}
  notch:  {is: NotchFilter, f_n: 3 Hz, zeta_z: 0.7, u: =lead.y}
  plant:  {is: TransferFunction, b: B, a: A, u: =notch.y}
simulate: {until: 1 s}
"""


def transfer(numbers: np.ndarray) -> str:
    return "[" + ", ".join(repr(float(x)) for x in numbers) + "]"


@pytest.mark.long
def test_leads_and_lags_of_random_plants_have_the_margins_that_python_control_finds() -> None:
    """Both programs compute with rational functions; 1e-5 leaves room for polynomials of order 5."""
    control, random = pytest.importorskip("control"), np.random.default_rng(2)
    s, signs = control.tf("s"), set()
    for _ in range(8):
        lags = random.uniform(0.02, 0.5, 2)
        a, b = np.poly([0, *(-1 / lags)]), np.array([random.uniform(0.5, 5) / np.prod(lags)])
        plant = control.tf(np.concatenate([np.zeros(3), b]), a)
        crossover = float(random.uniform(0.5, 2) / (2 * np.pi))
        unchanged = np.degrees(np.angle(-plant(2j * np.pi * crossover)))
        margin = float(np.clip(unchanged + random.uniform(-45, 60), 10, 80))
        signs.add(margin > unchanged)
        model = hb.loads(COMPENSATED.replace("GAIN", "1").replace("b: B", f"b: {transfer([0, 0, 0, *b])}").replace(
            "a: A", f"a: {transfer(a)}"))
        design = hb.design_lead(model, "gain.y", "lead", crossover=crossover, phase_margin=margin)
        k, t_1, t_2 = (design.values[f"lead.{name}"] for name in ("k", "T_1", "T_2"))
        loop = k * (t_1 * s + 1) / (t_2 * s + 1) * plant
        gain_margin, phase_margin, _, gain_at = control.margin(loop)
        assert phase_margin == pytest.approx(margin, rel=1e-5) and design.phase_margin == pytest.approx(margin, rel=1e-5)
        assert gain_at == pytest.approx(2 * np.pi * crossover, rel=1e-5)
        assert design.crossings.gain_up.value == pytest.approx(gain_margin, rel=1e-5)
        assert t_2 == pytest.approx(10 * t_1) if margin < unchanged else \
            2 * np.pi * crossover == pytest.approx(1 / np.sqrt(t_1 * t_2))  # the largest phase of a lead is there
        band = hb.design_lead(model, "gain.y", "lead", bandwidth=design.bandwidth, phase_margin=margin)
        assert band.crossover == pytest.approx(crossover, rel=0.2)
        assert band.bandwidth == pytest.approx(design.bandwidth, rel=1e-3)
    assert signs == {True, False}


@pytest.mark.long
def test_notches_of_random_plants_cancel_the_mode_that_limits_the_gain() -> None:
    """The gain margins beside python-control; the frequency and damping of the mode are exact."""
    control, random = pytest.importorskip("control"), np.random.default_rng(3)
    s = control.tf("s")
    for _ in range(5):
        f_n, zeta = float(random.uniform(2, 8)), float(random.uniform(0.005, 0.05))
        w = 2 * np.pi * f_n
        mode = np.array([1 / w**2, 2 * zeta / w, 1])
        a = np.convolve([1, 0], np.convolve([0.01, 1], mode))
        model = hb.loads(COMPENSATED.replace("GAIN", f"{zeta * w!r}").replace("b: B", "b: [0, 0, 0, 0, 1]").replace(
            "a: A", f"a: {transfer(a)}"))
        design = hb.design_notch(model, "gain.y", "notch", points={"slow": {"gain.k": zeta * w / 2}})
        assert design.values["notch.f_n"] == pytest.approx(f_n, rel=1e-6)
        assert design.values["notch.zeta_z"] == pytest.approx(zeta, rel=1e-5)
        plant = control.tf([0, 0, 0, 0, zeta * w], a)
        notch = (s**2 / w**2 + 2 * zeta / w * s + 1) / (s**2 / w**2 + 1.4 / w * s + 1)
        expected = control.margin(control.minreal(notch * plant, 1e-6, False))[0]
        assert design.crossings.gain_up.value == pytest.approx(expected, rel=1e-3)
        assert design.crossings.gain_up.value > 5 * control.margin(plant)[0]
        assert design.points["slow"].gain_up.value == pytest.approx(2 * design.crossings.gain_up.value, rel=1e-6)


def test_the_command_designs_a_lead_and_a_notch_in_the_diagram(tmp_path: Path) -> None:
    path, w = tmp_path / "axis.yaml", 2 * np.pi * 5
    a = np.convolve([1, 0], np.convolve([0.01, 1], [1 / w**2, 0.02 / w, 1]))
    path.write_text(COMPENSATED.replace("GAIN", "1").replace("b: B", "b: [0, 0, 0, 0, 1]").replace(
        "a: A", f"a: {transfer(a)}"), encoding="utf-8")
    common = ["design", str(path), "--loop", "gain.y", "--over", "gain.k=0.5, 2"]
    run = CliRunner().invoke(main, [*common, "--notch", "notch", "--in-place"])
    assert run.exit_code == 0 and "gain.k = 2" in run.output, run.output
    run = CliRunner().invoke(main, [*common, "--lead", "lead", "--bandwidth", "2 Hz", "--phase-margin", "70 deg",
                                    "--in-place"])
    assert run.exit_code == 0 and "bandwidth 2 Hz" in run.output, run.output
    values = hb.assemble(hb.load(path)).parameter_values
    assert values["notch.f_n"] == pytest.approx(5, rel=1e-6) and values["lead.T_1"] != 1
    margins = hb.loop_crossings(hb.load(path), "gain.y")
    assert margins.least_phase.value == pytest.approx(70, rel=1e-4) and margins.gain_up.value > 2
    for arguments, said in (
            (["--lead", "plant", "--crossover", "1 Hz", "--phase-margin", "60 deg"], "Name a LeadLag: lead"),
            (["--notch", "lead"], "Name a NotchFilter"), (["--lead", "lead", "--crossover", "1 Hz"], "needs a phase margin"),
            (["--lead", "lead", "--crossover", "20 Hz", "--phase-margin", "80 deg"], "two blocks in series"),
            (["--notch", "notch", "--lead", "lead"], "exactly one of"),
            (["--lead", "lead", "--schedule", "lead"], "--schedule cannot be combined with --lead or --notch")):
        run = CliRunner().invoke(main, [*common, *arguments])
        assert run.exit_code == 2 and said in " ".join(run.output.split()), (arguments, run.output)


SCHEDULED = """model: scheduled
parameters: {m: 2}
components:
  target:  {is: Constant, k: 0}
  load:    {is: Constant, k: =m}
  control: {is: ScheduledPID, x: [1, 2, 3], K_p: [1, 1, 1], y_min: -1e6, y_max: 1e6, r: =target.y, u: =plant.y, s: =load.y}
  lag:     {is: FirstOrderLag, T_1: 0.1 s, u: =control.y}
  plant:   {is: Integrator, k: "=(2 1/s)/m", u: =lag.y}
initial: {plant.y: 0, lag.y: 0, control.q: 0}
simulate: {until: 5 s, every: 10 ms}
"""


@pytest.mark.long
def test_a_table_of_gains_has_the_margins_at_its_points_and_between_them(tmp_path: Path) -> None:
    """Gains that are proportional to the load are linear between the points: the margins are equal everywhere."""
    path = tmp_path / "scheduled.yaml"
    path.write_text(SCHEDULED, encoding="utf-8")
    run = CliRunner().invoke(main, ["design", str(path), "--loop", "control.y", "--schedule", "control", "--free",
                                    "control.K_p,control.K_i", "--crossover", "0.4 Hz", "--phase-margin", "50 deg", "--over",
                                    "m=4, 1, 8", "--in-place", "--json", str(tmp_path / "told.json")])
    assert run.exit_code == 0, run.output
    told = json.loads((tmp_path / "told.json").read_text(encoding="utf-8"))
    assert list(told["verdicts"]) == ["m = 1", "between 1 and 4", "m = 4", "between 4 and 8", "m = 8"]
    assert set(told["verdicts"].values()) == {"stable"}
    values = hb.assemble(hb.load(path)).parameter_values
    assert [values[f"control.x[{k}]"] for k in (1, 2, 3)] == [1, 4, 8]
    s = 2j * np.pi * 0.4
    for k, m in enumerate((1, 4, 8), 1):
        loop = (values[f"control.K_p[{k}]"] + values[f"control.K_i[{k}]"] / s) * 2 / m / s / (0.1 * s + 1)
        assert loop == pytest.approx(-np.exp(1j * np.radians(50)), rel=1e-5)  # six digits are written
    for m in (1.5, 5.0):
        margins = hb.loop_crossings(hb.load(path).with_parameters({"m": m}), "control.y")
        assert margins.least_phase.value == pytest.approx(50, rel=1e-4)
    common = ["design", str(path), "--loop", "control.y", "--free", "control.K_p,control.K_i", "--crossover", "0.4 Hz",
              "--phase-margin", "50 deg"]
    for arguments, said in ((["--schedule", "lag", "--over", "m=1, 2, 3"], "Name a ScheduledPID: control"),
                            (["--schedule", "control", "--over", "m=1, 2"], "has 3 points, and there are 2"),
                            (["--schedule", "control", "--over", "lag.T_1=0.1 s, 0.2 s, 0.3 s"], "does not differ"),
                            (["--schedule", "control", "--free", "lag.T_1", "--over", "m=1, 2, 3"], "not a list of gains")):
        run = CliRunner().invoke(main, [*common, *arguments])
        assert run.exit_code == 2 and said in " ".join(run.output.split()), (arguments, run.output)


@pytest.mark.long
def test_the_observer_controller_of_the_compensator_has_the_figures_of_the_page() -> None:
    """The valve of 5 Hz in the table of docs/design.md, which has two digits."""
    from benchmarks.controllers import LQG, SLIDING, margins, rows, variation

    valve = {"ahc.valve.f_n": "5 Hz"}
    design = hb.design_lqg(hb.load("cmc_ahc/lqg_control").with_parameters({**valve, **SLIDING}), "controller",
                           {"crown.x": "10 mm"}, [0.1], {"drive.y": 0.3}, [1e-6])
    model = hb.loads(LQG.format(n=len(design.a), a=rows(design.a, " 1/s"), b=rows(design.b, " 1/s"), c=rows(design.c)))
    model = model.with_parameters(dict(valve))
    assert variation(model) == "WOB deviation 0.15 kN, largest 0.45 kN"
    assert margins(model).startswith("stable, phase margin 64.7 deg")
