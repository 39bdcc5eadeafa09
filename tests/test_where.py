"""Where a model fails: effects put into bundled rigs, with noise, are found at their place and by their variable."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from heavebond.cli import main
from heavebond.core.errors import UsageError
from heavebond.equations.places import nodes_of, places_of
from heavebond.estimation import comparison
from heavebond.estimation.comparison import compare_record
from heavebond.estimation.experiment import Experiment, load_experiment
from heavebond.estimation.records import measure
from heavebond.language.model import load, loads
from heavebond.localise.curves import Curve, Design, Variable, best_curve, regression
from heavebond.localise.kalman_smoother import Unknown
from heavebond.localise.law_forms import best_kinks
from heavebond.localise.ltv_model import SourcedRecord, known_of, with_values
from heavebond.localise.misfit import Localization, localize
from heavebond.numerics import compiled_cvodes
from heavebond.numerics.dae import assemble

pytestmark = pytest.mark.long

COMPONENT = """\
component: Missing
summary: A law for a test.
ports: {{a: translational, b: translational}}
parameters: {{{parameters}}}
variables: {{s: {{unit: m}}, v: {{unit: m/s}}, F: {{unit: N}}{variables}}}
equations: |
  s = b.x - a.x
  v = b.v - a.v
  {law}
  b.f = F
  a.f = -F
power: source
"""
LAWS = {
    "cube": ("c: {unit: N/m**3, default: 60e3 N/m**3}", "", "F = c * s**3"),
    "stop": ("c: {unit: N/m, default: 300 kN/m}, x: {unit: m, default: 0.25 m}", "", "F = c * max(s - x, 0)"),
    "play": ("c: {unit: N/m, default: 42 kN/m}, x: {unit: m, default: 0.1 m}", "", "F = -c * max(min(s, x), -x)"),
    "drag": ("d: {unit: N*s**2/m**2, default: 90e3 N*s**2/m**2}", "", "F = d * v * abs(v)"),
    "hysteresis": ("c: {unit: N/m, default: 400 kN/m}, x: {unit: m, default: 0.03 m}", ", z: {unit: m}",
                   "F = c * z\n  der(z) = v - abs(v) * z / x"),
}


def with_missing(folder: Path, law: str, experiment: Experiment, seed: int = 1) -> Experiment:
    """The experiment with records of a machine that has something more between platform and crown, and white noise."""
    parameters, variables, text = LAWS[law]
    (folder / "missing.yaml").write_text(COMPONENT.format(parameters=parameters, variables=variables, law=text))
    machine = loads("model: rig\nextends: passive_rig/passive_rig.yaml\ncomponents:\n  more: {is: Missing}\nnodes:\n"
                    "  platform: [+more.a]\n  crown: [+more.b]\n"
                    + ("initial: {more.z: 0 m}\n" if law == "hysteresis" else ""), folder)
    return measured(folder, replace(experiment, model=machine), experiment, seed)


def measured(folder: Path, machine: Experiment, experiment: Experiment, seed: int) -> Experiment:
    """The experiment with records that the machine of another gives."""
    noise, records = np.random.default_rng(seed), {}
    for name, record in machine.records.items():
        channels = compare_record(machine, record).channels.values()
        given = np.genfromtxt(record.file, delimiter=",", names=True)
        table = {"time_s": given["time_s"], **{i.column: given[i.column] for i in machine.inputs.values()}}
        for channel, output in zip(channels, machine.outputs.values(), strict=True):
            table[output.column] = channel.model + channel.noise * noise.standard_normal(len(channel.model))
        np.savetxt(folder / f"{name}.csv", np.column_stack(list(table.values())), delimiter=",", header=",".join(table),
                   comments="", fmt="%.10g")
        records[name] = replace(record, file=folder / f"{name}.csv")
    return replace(experiment, records=records)


@pytest.fixture(scope="module")
def friction() -> Localization:
    return localize("passive_rig/friction")


def test_friction_is_found_between_platform_and_crown_by_the_speed(friction: Localization) -> None:
    best = friction.suspects[0]
    assert friction.missing and friction.foreseen
    assert best.place.name == "platform-crown"
    assert best.curve is not None and best.curve.variable.formula == "crown.v - platform.v"
    assert best.curve.shape in ("step", "step and line", "falling step") and best.curve.r2 > 0.8
    assert "dry friction" in best.words
    assert best.explained > 0.99
    assert set(friction.unseen) == {"platform", "seabed"}


def test_the_implied_force_is_that_of_the_truth(friction: Localization) -> None:
    """truth.yaml: 12 kN of Coulomb friction, 10 kN s/m besides; where it slides fast the two add up to some 15 to 20 kN."""
    implied = friction.implied("platform-crown")["train"]
    speed = implied.local["crown.v - platform.v"]
    fast = np.abs(speed) > 0.25
    truth = 12e3 * np.sign(speed) + 10e3 * speed
    assert fast.sum() > 200
    # the estimate smooths over some samples and the damper's own value is uncertain by 10 %
    assert np.median(np.abs(implied.value - truth)[fast]) < 4e3
    assert implied.time.shape == implied.value.shape == implied.deviation.shape
    with pytest.raises(UsageError, match="nothing was estimated at 'moon'"):
        friction.implied("moon")


def test_leakage_is_found_between_the_chambers_by_their_pressure_difference() -> None:
    """truth.yaml: laminar, 6e-11 m**3/(s*Pa); the slope of the implied flow is within 10 % of it."""
    found = localize("cylinder_rig/leakage")
    best = found.suspects[0]
    assert best.place.name == "chamber_a-chamber_b"
    assert best.curve is not None and best.curve.variable.formula == "chamber_a.p - chamber_b.p"
    assert best.curve.shape == "line" and best.curve.r2 > 0.9
    slope = (best.curve.y[-1] - best.curve.y[0]) / (best.curve.x[-1] - best.curve.x[0])
    assert slope == pytest.approx(6e-11, rel=0.1)
    assert "laminar leakage" in best.words
    behind = [s.behind for s in found.suspects if s.place.name not in ("chamber_a-chamber_b",)]
    assert min(behind) > 1000


def test_places_that_are_not_asked_for_are_left_out() -> None:
    nodes = frozenset(("wall", "load"))
    found = localize("cylinder_rig/leakage", besides=[nodes])
    best, *others = found.suspects
    assert {n.name for n in best.place.nodes} == {"chamber_a", "chamber_b"} and best.behind == 0
    assert any({n.name for n in s.place.nodes} == nodes for s in others)
    assert {s.place.name for s in others} == {others[0].place.name, *others[0].alike}  # the one group that has them
    assert others[0].behind > 1000
    alone = localize("cylinder_rig/leakage", besides=()).suspects
    assert [s.place.name for s in alone] == [best.place.name]
    assert alone[0].rms == pytest.approx(best.rms, rel=1e-9) and alone[0].words == best.words
    assert localize("passive_rig/nothing", besides=()).suspects == ()


def test_choked_flow_is_found_at_the_receiver() -> None:
    """One volume only: what enters through the inlet or the outlet cannot be distinguished, which is said."""
    found = localize("receiver_rig/choked")
    assert found.missing
    best = found.suspects[0]
    assert {best.place.name, *best.alike} == {"supply-receiver", "receiver-air", "receiver"}
    assert "By its effect on these records it could as well act" in found.words[1]
    assert "mass flow" in best.words


def test_where_nothing_is_missing_nothing_is_named() -> None:
    found = localize("passive_rig/nothing")
    assert not found.missing and found.suspects == ()
    assert found.words == ("No effect is missing at any place: the residual of the fitted parameters is noise.",)
    assert found.values["train"]["gas.c"] == pytest.approx(47e3, rel=2e-3)  # truth.yaml


@pytest.mark.parametrize(("law", "variable", "shapes"), [
    ("cube", "crown.x - platform.x", {"cube", "line and cube"}),
    # the estimate rounds the kink off, so that a free curve may do better
    ("stop", "crown.x - platform.x", {"one-sided above", "curve"}),
    ("play", "crown.x - platform.x", {"saturation", "dead band"}),
    ("drag", "crown.v - platform.v", {"square", "line and square"}),
    ("hysteresis", "crown.v - platform.v", {"loop"}),
])
def test_other_effects_are_found_at_their_place_and_by_their_variable(law: str, variable: str, shapes: set[str],
                                                                      tmp_path: Path) -> None:
    experiment = with_missing(tmp_path, law, load_experiment("passive_rig/nothing"))
    # a law without memory or gap shows on half the record
    end = 60.0 if law in ("cube", "drag") else None
    found = localize(replace(experiment, records={n: replace(r, end=end) for n, r in experiment.records.items()}))
    best = found.suspects[0]
    assert found.missing and best.place.name == "platform-crown"
    assert best.curve is not None and best.curve.variable.formula == variable
    assert best.curve.shape in shapes
    # a bristle's force is no function of speed and direction: two branches explain part of it
    assert best.curve.r2 > (0.5 if law == "hysteresis" else 0.9)


def test_a_mass_that_is_too_small_is_told_by_the_acceleration(tmp_path: Path) -> None:
    """The crown has 132 t and not 120 t. In a swell of one frequency a spring of the opposite sign would do as much, with
    all parameters a standard deviation off: the law of the acceleration alone leaves them where they are."""
    given = load_experiment("passive_rig/nothing")
    machine = loads("model: rig\nextends: passive_rig/passive_rig.yaml\ncomponents:\n  crown: {is: Mass, m: 132 t}\n",
                    tmp_path)
    experiment = measured(tmp_path, replace(given, model=machine), given, 1)
    records = {n: replace(r, end=60.0) for n, r in experiment.records.items()}
    best = localize(replace(experiment, records=records)).suspects[0]
    assert best.curve is not None and best.curve.variable.formula == "der(crown.v)" and best.curve.shape == "line"
    slope = (best.curve.y[-1] - best.curve.y[0]) / (best.curve.x[-1] - best.curve.x[0])
    assert slope == pytest.approx(12e3, rel=0.02)
    assert "an added mass" in best.words


@pytest.mark.slow
def test_the_gain_of_an_integrating_machine_is_not_moved_in_place_of_a_leak(tmp_path: Path) -> None:
    """A cylinder without a spring: its position is the integral of the flow, whose gain is known to a factor of two."""
    text = "model: cyl\nextends: cylinder_rig/cylinder_rig.yaml\ncomponents:\n  load_spring: {is: Spring, c: 1e-3 N/m}\n"
    (tmp_path / "cyl.yaml").write_text(text)
    given = load_experiment("cylinder_rig/leakage")
    gain = given.free["valve.q_r"]
    nominal = gain.range.nominal
    assert nominal is not None
    wide = replace(gain.range, low=nominal / 2, high=2 * nominal, nominal=None)
    free = {**given.free, "valve.q_r": replace(gain, range=wide)}
    given = replace(given, model=load(tmp_path / "cyl.yaml"), free={n: f for n, f in free.items() if n != "load_spring.c"})
    leaking = loads("model: leaking\nextends: cyl.yaml\ncomponents:\n  leak: {is: LaminarLeakage, C: 1e-10 m**3/(s*Pa)}\n"
                    "nodes:\n  chamber_a: [+leak.a]\n  chamber_b: [+leak.b]\n", tmp_path)
    best = localize(measured(tmp_path, replace(given, model=leaking), given, 1)).suspects[0]
    assert best.place.name == "chamber_a-chamber_b" and best.curve is not None
    assert best.curve.variable.formula == "chamber_a.p - chamber_b.p" and best.curve.r2 > 0.95
    slope = (best.curve.y[-1] - best.curve.y[0]) / (best.curve.x[-1] - best.curve.x[0])
    assert slope == pytest.approx(1e-10, rel=0.1)


def test_the_linear_system_foretells_a_run_with_an_input_and_another_parameter(tmp_path: Path) -> None:
    """A force of 10 N on a linear machine and a parameter moved by 1/20 of its tolerance: foretold to 1 %."""
    experiment = load_experiment("passive_rig/friction")
    side = SourcedRecord(experiment, experiment.records["train"], tmp_path)
    known = [known_of(free, side.assembly.parameter_values[free.name]) for free in experiment.free.values()]
    system = side.about({}, known)
    q, w = np.array([0.05, 0.0, 0.0, 0.0]), np.zeros((len(side.time), len(side.nodes)))
    w[:, list(side.nodes).index("crown")] = 10 * np.sin(side.time)
    moved = side.about(with_values(known, system.centre + q), known, w)
    x, foretold = system.start @ q, []
    n = len(x)
    for i in range(len(side.time)):
        if i:
            x = system.phi[i - 1] @ np.append(x, q) + system.gamma[i - 1] @ (w[i - 1] + w[i]) / 2
        foretold.append(system.c[i] @ np.append(x, q) + system.d[i] @ w[i])
    found = system.error - moved.error
    assert n == 2
    assert np.abs(np.array(foretold) - found).max() < 0.01 * np.abs(found).max()


def test_the_smoother_is_the_batch_estimate(tmp_path: Path) -> None:
    """On a short record the smoother and its likelihood are those of one Gaussian of all samples, to rounding."""
    experiment = load_experiment("passive_rig/friction")
    short = replace(experiment.records["train"], end=1.2)
    side = SourcedRecord(replace(experiment, free={}), short, tmp_path)
    system = side.about({}, [])
    place = next(p for p in side.places if p.name == "platform-crown")
    size, intensity = 1e4, np.array([2.0])
    unknown = Unknown(system, list(side.nodes), [place], np.array([size]))
    smoothed, likelihood = unknown.smoothed(intensity), unknown.filtered(intensity)
    count, n = len(side.time), unknown.n
    # every output as a sum of the start and of the steps of w, all normal and independent
    causes = n + count
    state, outputs, w_of = np.zeros((n + 1, causes)), [], []
    state[:n, :n] = np.diag(system.start_deviation)
    state[n, n] = 10.0
    for i in range(count):
        if i:
            h = side.time[i] - side.time[i - 1]
            step = np.eye(n + 1)
            step[:n, :n], step[:n, n] = system.phi[i - 1], unknown.gamma[i - 1, 0]
            state = step @ state
            state[:, n + i] += np.sqrt(intensity[0] * h) * np.append(unknown.gamma[i - 1, 0] / 2, 1.0)
        outputs.append(system.c[i] @ state[:n] + np.outer(unknown.d[i, 0], state[n]))
        w_of.append(state[n].copy())
    matrix, error = np.concatenate(outputs), system.error.ravel()
    covariance = matrix @ matrix.T + np.eye(len(error))
    best = np.array(w_of) @ matrix.T @ np.linalg.solve(covariance, error)
    whole = error @ np.linalg.solve(covariance, error) + np.linalg.slogdet(2 * np.pi * covariance)[1]
    assert smoothed.w[:, 0, 0] / size == pytest.approx(best, abs=1e-6 * np.abs(best).max())
    assert likelihood.constant[0] == pytest.approx(whole, rel=1e-8)
    spread = np.array(w_of) @ (np.eye(causes) - matrix.T @ np.linalg.solve(covariance, matrix)) @ np.array(w_of).T
    assert smoothed.deviation[:, 0] / size == pytest.approx(np.sqrt(np.diag(spread)), rel=1e-5)


def law_of(w: np.ndarray, deviation: float, learn: np.ndarray, *variables: tuple[str, str, np.ndarray]) -> Curve:
    """The law of a force that is measured itself, with a deviation."""
    design = Design([Variable(kind, name, name, "m", v, np.gradient(v) > 0) for kind, name, v in variables], learn)
    whitened = np.concatenate([w[:, None], -design.columns], axis=1)[:, None, :] / deviation
    curve = best_curve(design, regression(whitened, learn, np.ones(len(w)), np.zeros(0)), learn)
    assert curve is not None
    return curve


@pytest.mark.parametrize(("law", "shape"), [
    (lambda v: 3 * v, "line"), (lambda v: np.tanh(v / 0.01), "step"), (lambda v: v**3, "cube"),
    (lambda v: np.maximum(v - 0.4, 0), "one-sided above"), (lambda v: np.clip(v, -0.3, 0.3), "saturation"),
    (lambda v: np.sin(6 * v), "curve"),
])
def test_shapes_are_told_from_curves(law: object, shape: str) -> None:
    """With noise of a tenth of the force; learnt on one half and tried on the other."""
    random = np.random.default_rng(2)
    t = np.linspace(0, 60, 3000)
    v, x = np.sin(t) * np.sin(0.31 * t), np.cos(1.7 * t)
    w = law(v)
    deviation = 0.1 * w.std()
    curve = law_of(w + deviation * random.standard_normal(len(t)), deviation, t < 30, ("position", "x", x),
                   ("across", "v", v))
    assert curve.variable.formula == "v"
    assert curve.shape == shape and curve.r2 > 0.95
    assert curve.chance < 0.05  # what acts beyond a limit alone acts in a few blocks of time


def test_a_step_whose_height_follows_a_pressure_is_told_as_one() -> None:
    """Seal friction: neither the speed nor the pressure alone explains it, and no side of zero is without it."""
    random = np.random.default_rng(4)
    t = np.linspace(0, 60, 3000)
    v, p = np.sin(t) * np.sin(0.31 * t), 1 + 0.8 * np.cos(1.7 * t)
    for height, times in ((0.3 + p, ""), (p, "p")):
        w = height * np.tanh(v / 0.01)
        curve = law_of(w + 0.1 * random.standard_normal(len(t)), 0.1, t < 30, ("across", "v", v), ("pressure", "p", p))
        assert curve.variable.formula == "v" and curve.shape == "step" and curve.r2 > 0.95
        assert curve.chance < 0.01 and curve.covered > 0.9
        assert curve.times == times and (times or (curve.second is not None and curve.second.formula == "p"))


def test_noise_follows_no_variable() -> None:
    t = np.linspace(0, 60, 3000)
    w = np.random.default_rng(3).standard_normal(len(t))
    curve = law_of(w, 0.5, t < 30, ("across", "v", np.sin(t)))
    assert curve.r2 < 0.1 and curve.chance > 0.01


def test_command_tells_draws_and_writes_figures(tmp_path: Path) -> None:
    picture, figures = tmp_path / "where.png", tmp_path / "where.json"
    done = CliRunner().invoke(main, ["localize", "receiver_rig/choked", "--output", str(picture), "--json", str(figures)])
    assert done.exit_code == 0, done.output
    assert "supply-receiver" in done.output
    assert picture.stat().st_size > 10_000
    assert (tmp_path / "where_misfit.png").stat().st_size > 10_000
    written = json.loads(figures.read_text(encoding="utf-8"))
    assert written["missing"] is True
    assert {p["place"] for p in written["places"]} == {"supply-receiver", "receiver-air", "receiver"}


def test_places_inside_of_blocks_are_beside_their_parts() -> None:
    flat = assemble(load("cmc_ahc/designed")).flat
    beside = {place.name: place.components for place in places_of(flat, nodes_of(flat))}
    assert beside["ahc.chamber_a-ahc.chamber_b"] == ("ahc.cylinder", "ahc.valve", "ahc.bypass")
    assert beside["drilling.bottom-drilling.bit"] == ("drilling.formation",)
    assert {"cmc.gas", "cmc.friction", "ahc.cylinder", "rocker"} < set(beside["platform-crown"])


@pytest.mark.skipif(compiled_cvodes.program() is None, reason="no C compiler")
def test_runs_over_many_samples_are_made_by_the_compiled_program(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of comparisons, and those about which what acts is estimated; with the same result."""
    experiment = load_experiment("passive_rig/friction")
    assembly = comparison.assemble_for(experiment, experiment.records["train"])
    grid = measure(experiment, experiment.records["train"]).grid[:600]
    by_idas = comparison.simulate_over(assembly, grid)
    monkeypatch.setattr(comparison, "MANY", 500)
    quick = comparison.simulate_over(assembly, grid)
    assert (by_idas.statistics["solver"], quick.statistics["solver"]) == ("idas", "cvodes")
    assert quick.x == pytest.approx(by_idas.x, rel=1e-4, abs=1e-6)


def test_a_variable_with_a_single_value_has_no_kinks() -> None:
    assert best_kinks(lambda kinks: 0.0, 2, np.full(50, 0.3)) == ()
