"""Which experiment would tell alternatives apart: proposed, then carried out on a machine that is one of them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from heavebond.diagnosis.answer.files import write_proposal
from heavebond.diagnosis.diagnose import diagnose
from heavebond.estimation.comparison import assemble_for
from heavebond.estimation.experiment import Experiment, load_experiment
from heavebond.estimation.fitting import fit
from heavebond.experiment_design.proposals import Limits, Recorded, family
from heavebond.experiment_design.separation import Alternative, Separation, separate
from heavebond.numerics.dae import Array
from heavebond.numerics.simulator import Simulator

NOISE = 2.4e-3  # m
MACHINE = """
model: {name}
components:
  base:   {{is: PositionSource, u: "=0.1 m*sin(time)"}}
  spring: {{is: Spring, c: 4 kN/m}}
  damper: {{is: Damper, d: 200 N*s/m}}
  mass:   {{is: Mass, m: 100 kg}}
  ground: {{is: Fixed}}
  spring_2: {{is: Spring, c: 4 kN/m}}
  {extra}
nodes:
  deck: [base.a, spring.a, damper.a, {a}]
  load: [spring.b, damper.b, mass.a, spring_2.b, {b}]
  ground: [ground.a, spring_2.a{g}]
initial: {{load.x: 0 m, load.v: 0 m/s}}
"""
EXPERIMENT = """
experiment: {name}
model: {name}.yaml
records:
  sine: {{file: sine.csv, use: fit}}
time: {{column: t, unit: s}}
inputs:
  base.u: {{column: deck, unit: mm, interpolation: spline}}
outputs:
  load.x: {{column: x, unit: m, noise: 2.4 mm}}
free:
{free}
"""


def machine(folder: Path, name: str, extra: str, ends: tuple[str, str, str], free: str) -> Experiment:
    """A mass on a moving deck with something beside the spring, and the experiment on it."""
    (folder / f"{name}.yaml").write_text(MACHINE.format(name=name, extra=extra, a=ends[0], b=ends[1], g=ends[2]))
    path = folder / f"{name}_fit.yaml"
    path.write_text(EXPERIMENT.format(name=name, free=free))
    return load_experiment(path)


def columns(path: Path) -> dict[str, Array]:
    head = path.read_text().splitlines()[0].split(",")
    return dict(zip(head, np.loadtxt(path, delimiter=",", skiprows=1).T, strict=True))


def carry_out(experiment: Experiment, values: dict[str, float], path: Path, seed: int) -> None:
    """Put what the machine does, with noise, into a file that has its inputs."""
    known = columns(path)
    record = replace(experiment.records["sine"], file=path)
    result = Simulator(assemble_for(experiment, record).with_parameters(values), times=known["t"]).run()
    known["x"] = result["load.x"] + NOISE * np.random.default_rng(seed).standard_normal(len(known["t"]))
    np.savetxt(path, np.column_stack(list(known.values())), delimiter=",", header=",".join(known), comments="", fmt="%.9g")


def sine(time: Array) -> Array:
    """One amplitude, one frequency: mm."""
    return 100 * np.sin(3 * time) * (1 - np.exp(-time))


def ramp(time: Array) -> Array:
    """One speed: mm."""
    return 5 * time


BESIDE = ("more.a", "more.b", "")
CASES = {
    "quadratic or viscous": (
        sine, ("more: {is: Damper, d: 150 N*s/m}", "  more.d: 0 .. 800 N*s/m"),
        ("more: {is: Drag, d_2: 500 N*s**2/m**2}", "  more.d_2: 0 .. 5000 N*s**2/m**2"), {"more.d_2": 400.0}),
    "dry friction or a preload": (
        ramp, ("more: {is: Preload, F: 50 N}", "  more.F: -200 .. 200 N\n  initial.load.x: -50 .. 50 mm"),
        ("more: {is: CoulombFriction, F_c: 50 N}", "  more.F_c: 0 .. 200 N\n  initial.load.x: -50 .. 50 mm"),
        {"more.F_c": 80.0, "initial.load.x": 0.01}),
}


def fitted(experiment: Experiment, file: Path) -> tuple[Alternative, float]:
    """An experiment fitted to the whole of a file as an alternative, and its chi-square."""
    record = replace(experiment.records["sine"], file=file)
    again = replace(record, name="again", use="validate")  # a record without a partner is fitted to its first part only
    found = fit(replace(experiment, records={"sine": record, "again": again}))
    return Alternative(experiment.name, replace(experiment, records={"sine": record}), found.values, found.samples), \
        found.chi2 * found.samples


@pytest.mark.long
@pytest.mark.parametrize("case", CASES)
def test_alike_on_the_record_and_told_apart_by_what_is_proposed(case: str, tmp_path: Path) -> None:
    course, (wrong_part, wrong_free), (right_part, right_free), truth = CASES[case]
    wrong = machine(tmp_path, "wrong", wrong_part, BESIDE, wrong_free)
    right = machine(tmp_path, "right", right_part, BESIDE, right_free)
    time = np.arange(0, 40, 0.05)
    first = tmp_path / "first.csv"
    np.savetxt(first, np.column_stack([time, course(time)]), delimiter=",", header="t,deck", comments="", fmt="%.9g")
    carry_out(right, truth, first, seed=1)
    (a, chi2_wrong), (b, chi2_right) = fitted(wrong, first), fitted(right, first)
    assert abs(chi2_wrong - chi2_right) < 12  # the record does not tell
    proposed = separate([a, b])
    assert proposed.decides
    measured = columns(first)["x"]
    for predicted in proposed.channels.values():  # nor does the machine go where it has not been, by much
        assert np.abs(predicted.values - np.median(measured)).max() < 1.55 * np.ptp(measured)
    (second,) = write_proposal(proposed, tmp_path / "second.csv")
    inside(proposed, columns(second), course(time))
    carry_out(right, truth, second, seed=2)
    chi2_wrong, chi2_right = fitted(wrong, second)[1], fitted(right, second)[1]
    assert chi2_wrong - chi2_right > proposed.needed


def inside(found: Separation, file: dict[str, Array], seen: Array) -> None:
    """The file stays in the range of the record, and no faster (the spline through coarser points overshoots a little)."""
    deck, t = file["deck"], file["t"]
    room = 0.02 * np.ptp(seen)
    assert seen.min() - room <= deck.min() and deck.max() <= seen.max() + room
    fastest = found.limits["base.u"][0].rate * 1000  # mm/s
    assert np.abs(np.diff(deck) / np.diff(t)).max() < 1.1 * fastest


def stiffer(folder: Path, name: str, part: str) -> Alternative:
    """The machine with one of its parts free."""
    found = machine(folder, name, "more: {is: Spring, c: 2 kN/m}", BESIDE, f"  {part}.c: 1 .. 9 kN/m")
    return Alternative(name, found, {f"{part}.c": 5000.0 if part == "spring" else 3000.0}, 800)


def test_what_no_channel_shows_and_the_channel_that_would(tmp_path: Path) -> None:
    time = np.arange(0, 20, 0.05)
    np.savetxt(tmp_path / "sine.csv", np.column_stack([time, sine(time), 0.2 * np.sin(time)]), delimiter=",",
               header="t,deck,x", comments="")
    # one of two springs side by side is stiffer: the load moves alike, the force in each of them is another
    one, other = stiffer(tmp_path, "one", "spring"), stiffer(tmp_path, "other", "more")
    found = separate([one, other])
    assert not found.decides and found.best is not None and found.best.smallest < 1
    assert found.extra is not None and found.extra.name in ("spring.F", "more.F")
    assert "force" in found.words[-1] and found.extra.name in found.words[-1]
    assert write_proposal(found, tmp_path / "nothing.csv") == [] and not (tmp_path / "nothing.csv").exists()
    # of the part that may be missing in the machine nothing can be measured
    ring = "ring: {is: Damper, d: 0 N*s/m}"
    bare = machine(tmp_path, "bare", ring, ("ring.a", "ring.b", ""), "  damper.d: 1 .. 400 N*s/m")
    within = separate([one, other], machine=bare).extra
    assert within is not None and within.name == "spring.F"
    # twice the same: no channel can tell
    same = separate([one, replace(one, label="the same")])
    assert not same.decides and same.words[-1].startswith("No further channel distinguishes")


@pytest.mark.parametrize("rate", [0.3, np.inf])
@pytest.mark.parametrize("start", [-0.2, 0.5])
def test_every_shape_is_inside_the_limits(rate: float, start: float) -> None:
    limits = Limits(-0.2, 1.0, rate, start, 0.3)
    time = np.arange(0, 60, 0.05)
    made = family("valve.u", time, Recorded(limits, {"first": start + 0.5 * np.sin(time)}))
    assert len(made) > 25
    for proposal in made:
        u = proposal.values
        assert u.min() >= -0.2 - 1e-9 and u.max() <= 1.0 + 1e-9, proposal.shape
        assert np.abs(np.gradient(u, 0.05)).max() <= rate * (1 + 1e-9), proposal.shape
        assert abs(u[0] - start) < 1e-9 and np.ptp(u) > 0, proposal.shape


def test_a_diagnosis_that_ends_with_two_names_proposes_an_experiment(tmp_path: Path) -> None:
    right = machine(tmp_path, "right", CASES["quadratic or viscous"][2][0], BESIDE, "  more.d_2: 0 .. 5000 N*s**2/m**2")
    time = np.arange(0, 40, 0.05)
    np.savetxt(tmp_path / "sine.csv", np.column_stack([time, sine(time)]), delimiter=",", header="t,deck", comments="")
    carry_out(right, {"more.d_2": 400.0}, tmp_path / "sine.csv", seed=1)
    base = machine(tmp_path, "base", "", ("", "", ""), "  spring.c: 3.9 .. 4.1 kN/m")
    found = diagnose(base, number=1, classes=("viscous damping", "quadratic damping"))
    assert found.verdict == "one_of"
    assert found.separation is not None and found.separation.decides
    *told, tried = found.words
    assert found.separation.words == tuple(told[-len(found.separation.words):])
    assert tried == "Tried were only effects of these classes: viscous damping, quadratic damping."
    said = json.loads(json.dumps(found.as_dict()))["separation"]
    assert said["proposal"]["input"] == "base.u" and said["decides"]
    assert {len(c.values) for c in found.separation.channels.values()} == {len(found.separation.alternatives)}
