"""Scores: the direction beside differences of runs, z of noise, the amplitude that a small effect is said to have."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks.diagnosis.drawing import drawn
from benchmarks.diagnosis.machines import MACHINES
from heavebond.diagnosis.answer.sentences import acting_as_values
from heavebond.diagnosis.candidates.catalogue import Candidate, single_candidates
from heavebond.diagnosis.candidates.fixed_values import VALUE
from heavebond.diagnosis.evidence.comparison import NEARLY, _beside, _held_directions, equivalent_values
from heavebond.diagnosis.search import base_model, schedule, scoring
from heavebond.diagnosis.search.base_model import Base, searched
from heavebond.diagnosis.search.scoring import SAME, Score, scored
from heavebond.estimation.comparison import assemble_for, driven_by
from heavebond.estimation.experiment import load_experiment
from heavebond.estimation.residuals import Residuals, Run
from heavebond.language.model import Setting
from heavebond.numerics.dae import Array
from heavebond.numerics.simulator import Simulator, Tolerances

EFFECT = "PneumaticValve in inlet (b_cr)"
OTHERS = ("PneumaticLine between receiver and inlet.b", "SensorGain in the channel receiver.p")


@pytest.fixture
def problem() -> Residuals:
    """The receiver at tolerances that leave nothing of the integrator's error beside differences and a small effect."""
    return searched(load_experiment("receiver_rig/choked"), Tolerances(1e-8, 1e-10))


def _candidate(problem: Residuals, label: str) -> Candidate:
    return next(c for c in single_candidates(problem.experiment) if c.label == label)


def _residuals(base: Base, candidate: Candidate, amplitude: float) -> Array:
    run, = base.runs(candidate.change, [])
    values = base.problem.values_of(base.inner, run.record.name)
    return run.residuals({**values, candidate.numbers[0].name: amplitude})[0]


def _measured(problem: Residuals, base: Base, wrong: Array) -> Base:
    """The base model fitted to records that lie `wrong` (n,) noises above what it says at its start."""
    run, = problem.runs
    measured = run.measured.copy()
    measured[run.counts] += (base.r + wrong) * np.broadcast_to(run.noise, run.counts.shape)[run.counts]
    run.measured = measured
    problem._known.clear()
    inner = np.asarray(problem.minimise(problem.start, False, lambda text: None, tolerance=1e-8).x)
    run.measured, fitted = measured, Base.at(problem, inner)
    return fitted


def test_the_direction_is_that_of_differences(problem: Residuals) -> None:
    base = Base.at(problem, problem.start)
    for label, step in ((EFFECT, 5e-3), (OTHERS[1], 1e-3)):
        candidate = _candidate(problem, label)
        score, = scored(base, candidate)
        r = [_residuals(base, candidate, k * step) for k in range(3)]
        s = (-3 * r[0] + 4 * r[1] - r[2]) / (2 * step)  # one-sided, of second order
        assert np.linalg.norm(s) == pytest.approx(score.size, rel=2e-3)  # errs as step**2, and the runs by 1e-8
        left = base.split(s)[0]
        assert np.linalg.norm(left - score.share * score.size * score.direction) < 2e-3 * score.size
        assert np.abs(base.J.T @ score.direction).max() < 2e-2 * np.linalg.norm(base.J, axis=0).max()


def test_z_of_noise_is_standard_normal() -> None:
    problem = searched(load_experiment("receiver_rig/choked"))
    base, random, found = Base.at(problem, problem.start), np.random.default_rng(1), []
    run, = problem.runs
    original = run.measured
    chosen = [_candidate(problem, label) for label in (EFFECT, *OTHERS)]
    directions = np.array([scored(base, c)[0].direction for c in chosen])
    for _ in range(40):
        run.measured = original
        found.append(-directions @ _measured(problem, base, random.standard_normal(len(base.r))).quick)
    z = np.array(found)
    # four standard deviations of the mean and of the deviation of 40 draws
    assert np.abs(z.mean(axis=0)).max() < 4 / np.sqrt(40)
    assert np.abs(z.std(axis=0) - 1).max() < 4 / np.sqrt(80)


def test_a_small_effect_is_said_to_be_as_large_as_it_is(problem: Residuals) -> None:
    base, true = Base.at(problem, problem.start), 0.1
    candidate = _candidate(problem, EFFECT)
    fitted = _measured(problem, base, _residuals(base, candidate, true) - base.quick)
    score, = scored(fitted, candidate)
    assert score.z > 1
    assert score.amplitude == pytest.approx(true, rel=0.25)  # it is not quite linear in b_cr


SHUT = """\
model: shut
summary: A valve that is shut at the start; what leaks past its edges decides the pressures of a blocked cylinder.
components:
  pump:  {is: PressureSource, p_0: 200 bar}
  tank:  {is: Tank}
  valve: {is: ProportionalValve43, u: 0, q_r: 10 L/min, dp_r: 35 bar, f_n: 5 Hz, zeta: 0.8, leakage: 1e-12 m**3/(s*Pa)}
  left:  {is: Volume, V: 1 L, beta: 1e9 Pa}
  right: {is: Volume, V: 1 L, beta: 1e9 Pa}
  path:  {is: LaminarLeakage, C: 2e-12 m**3/(s*Pa)}
nodes:
  supply: [pump.a, valve.P]
  return: [tank.a, valve.T]
  a: [valve.A, left.a, path.a]
  b: [valve.B, right.a, path.b]
initial: {start: steady}
simulate: {until: 1 s}
"""
BESIDE = """\
experiment: shut
model: shut.yaml
records: {train: {file: train.csv, use: fit}}
time: {column: t, unit: s}
inputs: {valve.u: {column: u, unit: 1, interpolation: spline}}
outputs: {left.a.p: {column: p, unit: bar, noise: 0.1 bar}}
free: {left.beta: 1e9 Pa +- 10 %}
"""


def _shut(folder: Path) -> Residuals:
    """The blocked cylinder with its valve moved a little after a second of rest."""
    (folder / "shut.yaml").write_text(SHUT)
    (folder / "shut_at_rest.yaml").write_text(BESIDE)
    t = np.linspace(0, 4, 201)
    u = 1e-3 * np.where(t > 1, np.sin(3 * (t - 1)), 0) ** 3
    np.savetxt(folder / "train.csv", np.stack([t, u, 100 + 0 * t], 1), delimiter=",", header="t,u,p", comments="")
    return searched(load_experiment(folder / "shut_at_rest.yaml"))


def test_a_kink_at_amplitude_zero_has_a_tangent_of_its_own_on_either_side(tmp_path: Path) -> None:
    """Overlap of a valve that is shut at rest: the derivative at zero itself is of neither side."""
    problem = _shut(tmp_path)
    base = Base.at(problem, problem.start)
    candidate = _candidate(problem, "ProportionalValve43 in valve (overlap)")
    run, = base.runs(candidate.change, [candidate.numbers[0].name])

    def tangent(amplitude: float) -> float:
        return float(np.linalg.norm(run.residuals({candidate.numbers[0].name: amplitude})[1][0]))

    sides = {s.side: s.size for s in scored(base, candidate)}
    assert sides[1] == pytest.approx(tangent(1e-9), rel=0.05)  # beside zero it hardly changes
    assert sides[-1] == pytest.approx(tangent(-1e-9), rel=0.05)
    # (at the kink itself both edges count: the rounding of the spool decides for how many samples)
    assert tangent(2e-9) == pytest.approx(tangent(1e-9), rel=1e-3)


def test_a_tangent_that_turns_before_the_effect_is_seen_is_taken_there_too(tmp_path: Path) -> None:
    """What leaks between two blocked chambers decides how fast their pressures meet: twice as much is another course."""
    problem = _shut(tmp_path)
    base = Base.at(problem, problem.start)
    candidate = _candidate(problem, "LaminarLeakage between a and b")
    zero, beside = scored(base, candidate)
    assert (zero.side, beside.side) == (0, 1)
    there = scoring.SEEN / (zero.size * zero.share)  # where z of the first tangent would be 5
    run, = base.runs(candidate.change, [candidate.numbers[0].name])
    tangent = run.residuals({candidate.numbers[0].name: there})[1][0]
    assert beside.size == pytest.approx(float(np.linalg.norm(tangent)), rel=1e-3)  # at the tolerances of a search
    assert beside.size < 0.7 * zero.size  # more of it does less; of a law in proportion as much
    assert zero.direction @ beside.direction < scoring.TURNED
    # a law in proportion to its amplitude has one tangent
    assert [s.side for s in scored(base, _candidate(problem, "SensorOffset in the channel left.a.p"))] == [0]


def test_amplitudes_of_different_units_are_scored_one_after_the_other() -> None:
    problem = searched(load_experiment("passive_rig/friction"))
    base = Base.at(problem, problem.start)
    candidate = _candidate(problem, "EndStop between platform and crown")
    found = scored(base, candidate)
    stiffness, damping = (n.name for n in candidate.numbers if n.amplitude)
    assert {s.along for s in found} == {(stiffness,), (damping,)}
    run, = base.runs(candidate.change, [])
    for name in (stiffness, damping):
        score = max((s for s in found if s.along == (name,)), key=lambda s: s.size)
        step = 1e-3 * np.linalg.norm(base.r) / score.size  # moves the channels by a thousandth of the misfit
        moved = run.residuals({**score.shapes, stiffness: 0.0, damping: 0.0, name: step})[0] - base.quick
        assert np.linalg.norm(moved) == pytest.approx(step * score.size, rel=0.05)  # 5 %: the stop is met now and then only


def test_the_unit_of_an_amplitude_does_not_decide_whether_it_is_seen(tmp_path: Path) -> None:
    """What a line of a small machine loses by turbulence is K*q**2: the smaller the flows,
    the larger the K that is seen, and the smaller the derivatives to it."""
    problem = _shut(tmp_path)
    base = Base.at(problem, problem.start)
    sizes = {s.along: s.size for s in scored(base, _candidate(problem, "LineResistance between a and left.a"))}
    channels = np.linalg.norm(problem.runs[0].measured / problem.runs[0].noise[:, None])
    assert all(0 < size < 1e-12 * channels for size in sizes.values())
    # what moves no channel has the derivative zero, whatever its unit: the pressure behind a source
    found = scored(base, _candidate(problem, "LaminarLeakage between supply and return"))
    assert {s.size for s in found} == {0.0}


def test_a_tangent_is_no_error_of_algebraic_unknowns(tmp_path: Path) -> None:
    """A supply that droops is an algebraic loop with the valve; a unit of its resistance does next to nothing."""
    problem = _shut(tmp_path)
    base = Base.at(problem, problem.start)
    candidate = _candidate(problem, "DroopingSource in place of pump")
    score = scored(base, candidate)[0]
    name, = score.along
    run, = base.runs(candidate.change, [])
    exact = run.again([name], {name: 1e8}, Simulator)  # the size of 1e8 is what error control sees
    tangent = exact.residuals({name: 0.0})[1][0]
    assert score.size == pytest.approx(float(np.linalg.norm(tangent)), rel=0.02)


def test_laws_with_other_shapes_are_not_the_same_machine() -> None:
    direction = np.array([1.0, 0.0])
    candidate = next(iter(single_candidates(load_experiment("receiver_rig/choked"))))
    plain = Score(candidate, {}, 9.0, 1.0, np.zeros(0), 1.0, 1.0, direction)
    for shapes, alike in (({}, True), ({"s_0": 1.0, "s_1": 2.0}, False)):
        other = Score(candidate, shapes, 9.0, 1.0, np.zeros(0), 1.0, 1.0, direction)
        assert schedule._same([plain], [other], {}) is alike


def test_a_law_of_an_input_and_of_a_channel_are_refitted_both_unless_their_tangents_are_one() -> None:
    """Neither stands at a node: what two laws at nodes that move as one may differ by is no measure for them."""
    found = {c.label: c for c in single_candidates(load_experiment("receiver_rig/choked"))}
    places = (("FirstOrderLag before inlet.u", "FirstOrderLag in the channel receiver.p", False),
              ("PneumaticOrifice between receiver and air", "PneumaticOrifice between supply and air", True))
    for first, second, joined in places:
        for turned, alike in ((0.0, True), (0.01, joined)):
            directions = np.array([1.0, 0.0]), np.array([np.cos(turned), np.sin(turned)])
            one, other = ([Score(found[label], {}, 9.0, 1.0, np.zeros(0), 1.0, 1.0, direction)]
                          for label, direction in zip((first, second), directions, strict=True))
            assert schedule._same(one, other, {"receiver": "supply"}) is alike


def test_one_diagram_serves_records_that_differ_in_their_files_alone(problem: Residuals) -> None:
    experiment = problem.experiment
    train, check = experiment.records.values()
    found = driven_by(problem.runs[0].assembly, experiment, train, check)
    assert found is not None and found.flat.inputs[0].source.file == check.file
    assert found.model.settings == assemble_for(experiment, check).model.settings
    assert np.array_equal(Run(experiment, check, [], assembly=found).held_out({})[0],
                          Run(experiment, check, []).held_out({})[0])
    given, = experiment.inputs_for(check).values()
    other = replace(check, settings={"outlet.u": Setting("outlet.u", given, check.place)})
    assert driven_by(problem.runs[0].assembly, experiment, train, other) is None


def test_a_tangent_that_is_noise_gives_way_to_a_secant(problem: Residuals, monkeypatch: pytest.MonkeyPatch) -> None:
    """A derivative that is numerical noise, a thousand times as large as the true one: what it asks for does nothing."""
    base = Base.at(problem, problem.start)
    candidate = _candidate(problem, "PneumaticOrifice between supply and receiver")
    true, *_ = scored(base, candidate)
    assert true.side == 0
    responses, random = base_model.responses, np.random.default_rng(1)

    def noisy(base: Base, runs: Sequence[Run], values: Mapping[str, float]) -> tuple[Array, dict[str, Array]]:
        r, moved = responses(base, runs, values)
        noise = random.standard_normal(len(r))
        return r, {name: 1e3 * true.size * noise / np.linalg.norm(noise) for name in moved}

    for module in (base_model, scoring):
        monkeypatch.setattr(module, "responses", noisy)
    (found,) = scored(base, candidate)
    assert found.side == 1
    assert found.size == pytest.approx(true.size, rel=0.2)  # a decade of amplitudes of a law that is not quite linear
    assert found.direction @ true.direction > 0.98
    assert found.amplitude == pytest.approx(true.amplitude, rel=0.2)


@pytest.mark.parametrize(("rig", "expected"), [
    ("passive_rig/friction", {"Mass on crown": ("crown.m",), "Spring between platform and crown": ("gas.c",),
                              "CoulombFriction between platform and crown": (),
                              "SensorGain in the channel string.F": ("crown.m",)}),
    ("receiver_rig/choked", {"SensorGain before inlet.u": ("inlet.C",), EFFECT: (),
                             "PneumaticOrifice between supply and receiver": (), OTHERS[0]: (),
                             "PneumaticOrifice between receiver and air": ("outlet.C",)}),
])
def test_candidates_that_are_another_value_of_a_number_are_known_before_the_search(
        rig: str, expected: dict[str, tuple[str, ...]]) -> None:
    """A spring beside a free one, a gain of a valve and an outlet whose conductances are free; mass on a body, whose mass is
    held fixed, as the gain of the load cell is: with all stiffnesses and dampings free, forces and mass have one scale."""
    problem = searched(load_experiment(rig))
    base = Base.at(problem, problem.start)
    scores = [score for label in expected for score in scored(base, _candidate(problem, label))]
    found = equivalent_values(base, scores)
    assert {label: found.get(label, ()) for label in expected} == expected


def test_parallel_tangents_are_recognised_where_runs_of_the_search_bend_them_apart(tmp_path: Path) -> None:
    """Heat capacity on a body whose mass is held fixed is another value of that mass exactly, m c der(T) = Q; tangents of
    the search differ by 0.5 %. A store of heat that follows within seconds is not the same."""
    case = drawn(MACHINES["winding"], 39, tmp_path)
    problem = searched(case.experiment)
    base = Base.at(problem, problem.start)
    scores = [score for label in ("HeatCapacity on winding", "HeatStorage on winding")
              for score in scored(base, _candidate(problem, label))]
    held = _held_directions(base)["winding.m"]
    assert all(SAME < _beside(s.direction, {"": held})[""] < NEARLY for s in scores if "Capacity" in s.candidate.label)
    assert equivalent_values(base, scores) == {"HeatCapacity on winding": ("winding.c", "winding.m")}
    # a difference at a finite value, as a compliance in series has, is no tangent that finer runs could show
    differences = [replace(s, along=()) for s in scores if "Capacity" in s.candidate.label]
    assert equivalent_values(base, differences) == {}


def test_words_tell_what_acts_as_another_value() -> None:
    candidate = SimpleNamespace(label="Mass on crown", attaches="at", kind="added mass", place="on crown", component="Mass")
    step: Any = SimpleNamespace(acts_as={"Mass on crown": ("crown.m",)})
    finding: Any = SimpleNamespace(candidate=candidate)
    (line,) = acting_as_values([finding], [step], [])
    assert line.startswith("added mass on crown (Mass) acts as another value of crown.m:")
    assert acting_as_values([finding], [step], ["crown.m"]) == []  # told already
    value: Any = SimpleNamespace(candidate=SimpleNamespace(label="Mass in crown (m)", kind=VALUE,
                                                           numbers=(SimpleNamespace(name="crown.m"),)))
    assert acting_as_values([value], [step], []) == [
        "If crown.m is right in the diagram, an effect that acts the same is missing: Mass on crown."]


@pytest.mark.parametrize(("motion", "found"), [((1.0, 3.0), (1.0, 3.0)), ((-2.0, -0.2), (0.0, 0.7)), ((-9.0, -8.0), None)])
def test_a_limit_that_the_motion_does_not_reach_is_looked_for_where_a_refit_seeks_it(
        monkeypatch: pytest.MonkeyPatch, motion: tuple[float, float], found: tuple[float, float] | None) -> None:
    """A limit that is not negative, of a motion above and below zero: half of the span beyond it belongs to the search."""
    number = SimpleNamespace(name="limit.x", sought=SimpleNamespace(range=None), low=0.0, high=None)
    candidate: Any = SimpleNamespace(numbers=(number,), vanishes=True, orders=(), attaches="across")
    monkeypatch.setattr(scoring, "motion_ranges", lambda *others: {"limit.x": motion})
    unused: Any = None
    points = scoring.points_within(candidate, scoring.motion_ranges(candidate.numbers, (), unused))
    low, high = found or (0.0, 0.0)
    assert all(low < point["limit.x"] < high if found else not point for point in points)
