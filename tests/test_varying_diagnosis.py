"""Diagnosis of parameters that vary, of parameters that differ between records, and of effects that begin at a time."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import heavebond as hb
from heavebond.diagnosis.answer.confirm import _with_late_times
from heavebond.diagnosis.answer.files import Targets, write_findings
from heavebond.diagnosis.candidates.catalogue import Candidate
from heavebond.diagnosis.candidates.places import candidates
from heavebond.diagnosis.candidates.varying import varying_parameters
from heavebond.diagnosis.diagnose import diagnose
from heavebond.diagnosis.evidence.comparison import dispensable_variations
from heavebond.diagnosis.evidence.prediction import FITTED, PredictiveErrors
from heavebond.diagnosis.search.base_model import searched
from heavebond.diagnosis.search.onset import _Scan
from heavebond.estimation.comparison import compare
from heavebond.language.definition import Value
from heavebond.language.edits import Change
from heavebond.text.expression import constant

DIAGRAM = """model: small
components:
  shaker: {is: PositionSource, u: "=MOTION"}
  spring: {is: Spring, c: 4 kN/m}
  damper: {is: Damper, d: 60 N*s/m}
  mass:   {is: Mass, m: 10 kg}PARTS
nodes:
  base: [shaker.a, spring.a, damper.a]
  mass: [spring.b, damper.b, mass.aEND]NODES
initial: {mass.x: 0 m, mass.v: 0 m/s}
show: {x: {is: mass.x, unit: m}, u: {is: base.x, unit: m}}
simulate: {until: 20 s, every: 50 ms}
"""
MOTIONS = ("20 mm*sin(3*time/(1 s)) + 15 mm*sin(7.1*time/(1 s))", "25 mm*sin(4*time/(1 s)) + 9 mm*sin(11*time/(1 s))")
EXPERIMENT = """experiment: small
model: small.yaml
records:
  a: {file: a.csv, use: fit}
  b: {file: b.csv, use: USE}
time: {column: t, unit: s}
inputs:
  shaker.u: {column: u, unit: m, interpolation: spline}
outputs:
  x: {is: mass.x, column: x, unit: m, noise: 0.2 mm}
free:
  spring.c: 4 kN/m +- 20 %
  damper.d: 60 N*s/m +- 30 %
"""


def diagram(motion: str = "0 m*time/(1 s)", parts: str = "", end: str = "", nodes: str = "") -> str:
    return DIAGRAM.replace("MOTION", motion).replace("PARTS", parts).replace("END", end).replace("NODES", nodes)


def records(folder: Path, more: tuple[str, str], use: str = "validate", **changed: str) -> Path:
    """The experiment on two simulated records of the diagram with `more` in it."""
    random = np.random.default_rng(3)
    for name, motion, line in zip("ab", MOTIONS, more, strict=True):
        result = hb.simulate(hb.loads(diagram(motion, **changed) + line))
        x = np.asarray(result["x"]) + random.normal(0, 2e-4, len(result.time))
        rows = np.column_stack([np.asarray(result.time), np.asarray(result["u"]), x])
        np.savetxt(folder / f"{name}.csv", rows, delimiter=",", header="t,u,x", comments="", fmt="%.9g")
    (folder / "small.yaml").write_text(diagram())
    path = folder / "experiment.yaml"
    path.write_text(EXPERIMENT.replace("USE", use))
    return path


def found(path: Path, *classes: str) -> hb.Diagnosis:
    return diagnose(path, classes=classes or ("varying parameter",), number=1, seconds=1e4)


@pytest.mark.long
def test_a_damper_that_is_weaker_in_compression_is_named_with_the_ratio_of_its_two_values(tmp_path):
    line = 'vary: {damper.d: "=1 + 0.4*smooth_sign(damper.v, 1 mm/s)"}\n'
    diagnosis = found(records(tmp_path, (line, line)))
    assert diagnosis.verdict == "effect"
    assert diagnosis.findings[0].candidate.place == "of damper.d with damper.v"
    # the interval of k in this fit is +- 0.03
    assert diagnosis.findings[0].parameters[0].value == pytest.approx(0.4, abs=0.06)
    assert any("times as large at positive damper.v as at negative damper.v" in word for word in diagnosis.words)


@pytest.mark.long
def test_a_parameter_varies_with_a_recorded_variable_that_no_variable_of_its_part_follows(tmp_path):
    """The damper knows only its speed, but its constant depends on the recorded position of the base."""
    line = 'vary: {damper.d: "=1 + 0.7*min(max(base.x/(34 mm), -1), 1)"}\n'
    diagnosis = found(records(tmp_path, (line, line)))
    assert diagnosis.verdict == "effect" and diagnosis.findings[0].candidate.place == "of damper.d with shaker.u"
    # the reference value of the variation is the middle of the motion of 33.6 mm; the interval of k is +- 0.02
    assert diagnosis.findings[0].parameters[0].value == pytest.approx(0.7, abs=0.04)


@pytest.mark.long
def test_a_spring_that_breaks_is_named_with_the_time(tmp_path):
    line = 'vary: {spring.c: "=1 - 0.2*(1 + tanh((time - 12.3 s)/(0.05 s)))/2"}\n'
    diagnosis = found(records(tmp_path, (line, line)))
    finding = diagnosis.findings[0]
    assert finding.candidate.place == "of spring.c with time in each record"
    assert finding.parameters[0].value == pytest.approx(-0.2, abs=0.01)
    (times,) = {record: values for record, values in finding.fit.record_values.items() if record == "a"}.values()
    # the step is sought with a width of 0.2 s
    assert [value for name, value in times.items() if name.endswith(".t_0")] == pytest.approx([12.3], abs=0.2)


@pytest.mark.long
def test_a_damping_that_differs_between_two_fitted_records_is_named_and_written(tmp_path):
    diagnosis = found(records(tmp_path, ("", "set: {damper.d: 96 N*s/m}\n"), "fit"), "record-dependent parameter")
    assert diagnosis.findings[0].candidate.change.each.keys() == {"damper.d"}
    assert any("1.6 times as large in record b as in record a" in word for word in diagnosis.words)


@pytest.mark.long
def test_a_damping_that_is_larger_in_the_held_out_record_is_stated(tmp_path):
    diagnosis = found(records(tmp_path, ("", "set: {damper.d: 96 N*s/m}\n")))
    assert diagnosis.verdict == "effect" and diagnosis.findings[0].candidate.change.each.keys() == {"damper.d"}
    assert diagnosis.tree.effects[0].path[-1].name == "damper.d"
    said = next(word for word in diagnosis.words if word.startswith("damper.d is"))
    # fitted to the first 2 s of the record
    assert float(said.split()[2]) == pytest.approx(1.6, abs=0.08)


@pytest.mark.slow
def test_friction_that_begins_at_a_time_is_named_with_the_time(tmp_path):
    line = 'vary: {rub.F_c: "=(1 + tanh((time - 9.2 s)/(0.05 s)))/2"}\n'
    path = records(tmp_path, (line, line), parts="\n  rub: {is: CoulombFriction, F_c: 6 N}\n  ground: {is: Fixed}",
                   end=", rub.a", nodes="\n  g: [rub.b, ground.a]")
    diagnosis = found(path, "dry friction")
    assert diagnosis.findings[0].candidate.place == "between mass and the surroundings from a time on"
    times = {record: value for record, values in diagnosis.findings[0].fit.record_values.items()
             for name, value in values.items() if name.endswith(".t_0")}
    assert times == pytest.approx({"a": 9.2, "b": 9.2}, abs=0.1)


def test_friction_varies_with_the_relative_position_of_its_nodes(tmp_path):
    parts = "\n  rub: {is: CoulombFriction, F_c: 6 N}\n  ground: {is: Fixed}"
    rubbing = {"parts": parts, "end": ", rub.a", "nodes": "\n  g: [rub.b, ground.a]"}
    path = records(tmp_path, ("", ""), **rubbing)
    (tmp_path / "small.yaml").write_text(diagram(**rubbing))
    problem = searched(hb.load_experiment(path))
    places = {c.place for c in varying_parameters(problem, problem.start).candidates}
    # the friction acts between the mass and the ground, the damper between two moving nodes
    assert {"of rub.F_c with mass.x", "of damper.d with mass.x - base.x"} <= places
    # the spring has a displacement of its own
    assert "of spring.c with spring.s" in places and "of spring.c with mass.x - base.x" not in places


def test_effects_act_on_the_machine_and_not_on_effects_that_were_found(tmp_path):
    parts = "\n  along: {is: LinearVariation, u: =mass.x, k: 0.1, u_0: 0 m, u_m: 1 m}"
    path = records(tmp_path, ("", ""))
    (tmp_path / "small.yaml").write_text(diagram(parts=parts) + "vary: {spring.c: =along.factor}\n")
    found = candidates(hb.load_experiment(path))
    # the input of a factor is a variable of the machine, and no signal that may be late or wrong
    assert {c.signal for c in found if c.attaches == "input"} == {"shaker.u"}
    friction = next(c for c in found if c.component == "CoulombFriction" and "mass" in c.where)
    slip = replace(next(c for c in found if c.attaches == "in series"), where=("mass", friction.name))
    assert slip.acts_on([friction]) and not slip.acts_on([]) and not friction.acts_on([friction])
    # a sensor error before one that was found in the channel is the same as one behind it
    gain = next(c for c in found if c.component == "SensorGain" and c.attaches == "channel")
    offset = replace(next(c for c in found if c.component == "SensorOffset" and c.attaches == "input"), where=(gain.name,))
    assert offset.acts_on([gain]) and not offset.acts_on([friction])
    # a second factor of a parameter over the same variable
    factor = Candidate("f", "LinearVariation", "varying parameter", "", "of spring.c with mass.x", ("spring",), Change(), (),
                       "parameter")
    assert replace(factor, component="BentVariation").acts_on([factor])
    assert not replace(factor, place="of damper.d with mass.x").acts_on([factor])


@pytest.mark.parametrize(("law", "variation", "kept"), [(30.0, 10.0, False), (60.0, 10.0, True), (3.0, 1.0, True),
                                                        (2.9, 1.6, False)])
def test_a_variation_that_does_not_reach_the_noise_must_leave_several_times_less_than_each_law(
        law: float, variation: float, kept: bool) -> None:
    def trial(chi2: float, attaches: str) -> Any:
        counts = np.full(10, 100.0)
        errors = PredictiveErrors(chi2*counts, counts, np.zeros(10, np.int64), np.full(10, FITTED))
        candidate = Candidate("n", "C", "", "", "", ("part",), Change(), (), attaches)
        return SimpleNamespace(candidate=candidate, errors=errors, chi2_fit=chi2, chi2_held_out=chi2, samples=1000,
                               samples_held_out=0, slack=0.0, experiment=SimpleNamespace(noise_given=False))

    varied = trial(variation, "parameter")
    assert (dispensable_variations([trial(law, "across"), varied]) == []) == kept
    # after the first step only one that reaches the noise counts
    assert (dispensable_variations([trial(law, "across"), varied], later=True) == []) == (variation == 1.0)


def test_a_variation_is_tried_by_hand_at_a_parameter_and_a_variable(tmp_path):
    line = 'vary: {damper.d: "=1 + 0.4*smooth_sign(damper.v, 1 mm/s)"}\n'
    path = records(tmp_path, (line, line))
    tried = hb.attempt(path, "VariationByDirection", ["damper.d", "damper.v"])
    assert tried.earned and tried.finding.candidate.place == "of damper.d with damper.v"
    # the interval of k in this fit is +- 0.03
    assert tried.finding.parameters[0].value == pytest.approx(0.4, abs=0.06)
    with pytest.raises(hb.UsageError, match="fits at several places"):
        hb.attempt(path, "VariationByDirection")


TANK_LINE = """model: line
components:
  pump:   {is: FlowSource, u: "=FLOW"}
  line:   {is: Volume, V: 4 L, beta: 1.3 GPa}
  cooler: {is: LineResistance, R: 60e9 Pa*s/m**3}
  tank:   {is: Tank}PARTS
nodes:
  line: [pump.a, line.a, cooler.aPORT]
  tank: [cooler.b, tank.aEND]
initial: {line.p: 100 bar}
show: {p: {is: line.p, unit: bar}, q: {is: pump.u, unit: L/min}}
simulate: {until: 20 s, every: 100 ms}
"""
LINE_RECORDS = """experiment: line
model: line.yaml
records:
  first: {file: first.csv, use: fit}
  second: {file: second.csv, use: fit}
  third: {file: third.csv, use: validate}
time: {column: t, unit: s}
inputs:
  pump.u: {column: q, unit: L/min, interpolation: spline}
outputs:
  line.p: {column: p, unit: bar, noise: 0.2 bar}
free:
  cooler.R: 60e9 Pa*s/m**3 +- 10 %
  line.beta: 1.3 GPa +- 20 %
"""


def leaking(folder: Path, onsets: tuple[str, str, str], conductance: str = "1.5e-12") -> Path:
    """The experiment on three records of a line that leaks to the tank from a time on."""
    random = np.random.default_rng(5)
    for k, (name, onset) in enumerate(zip(("first", "second", "third"), onsets, strict=True)):
        flow = f"10 L/min + 3 L/min*sin({1.1 + 0.2*k}*time/(1 s)) + 2 L/min*sin({3.1 - 0.4*k}*time/(1 s) + {k})"
        parts = f'\n  seal: {{is: LaminarLeakage, C: {conductance} m**3/(s*Pa)}}'
        text = TANK_LINE.replace("FLOW", flow).replace("PARTS", parts).replace("PORT", ", seal.a").replace("END", ", seal.b")
        result = hb.simulate(hb.loads(text + f'vary: {{seal.C: "=(1 + tanh((time - {onset})/(50 ms)))/2"}}\n'))
        p = result.display["p"] + random.normal(0, 0.2, len(result.time))
        rows = np.column_stack([np.asarray(result.time), result.display["q"], p])
        np.savetxt(folder / f"{name}.csv", rows, delimiter=",", header="t,q,p", comments="", fmt="%.9g")
    (folder / "line.yaml").write_text(TANK_LINE.replace("=FLOW", "10 L/min").replace("PARTS", "").replace("PORT", "")
                                      .replace("END", ""))
    path = folder / "experiment.yaml"
    path.write_text(LINE_RECORDS)
    return path


@pytest.mark.long
def test_a_leakage_that_begins_at_another_time_in_each_record_is_named_with_these_times_and_written(tmp_path):
    diagnosis = found(leaking(tmp_path, ("12 s", "-5 s", "6.5 s")), "leakage")
    finding = diagnosis.findings[0]
    assert diagnosis.verdict == "effect" and finding.candidate.kind == "leakage"
    times = {record: values["onset_" + finding.candidate.name + ".t_0"]
             for record, values in finding.fit.record_values.items()}
    # the records are sampled every 0.1 s
    assert times["first"] == pytest.approx(12, abs=0.05) and times["third"] == pytest.approx(6.5, abs=0.05)
    assert times["second"] < 0
    said = next(word for word in diagnosis.words if word.startswith("The effect begins at"))
    assert said.endswith(" s in record third (fitted to this record) and acts in the whole record second.")
    given = hb.load_experiment(tmp_path / "experiment.yaml")
    written = write_findings(given, diagnosis.added, Targets.beside(given, tmp_path))[-1]
    # 200 samples: chi-square per sample is 1 +- 0.1
    assert all(0.7 < record.chi2 < 1.3 for record in hb.compare(written).records.values())
    fitted = {record: next(iter(values.values())) for record, values in hb.fit(written).record_values.items()}
    assert fitted["second"] < 0
    assert (fitted["first"], fitted["third"]) == pytest.approx((times["first"], times["third"]), abs=0.05)


def test_the_scan_finds_the_onset_of_each_record_with_both_ends():
    random = np.random.default_rng(1)
    begins = {"early": 3.0, "whole": -1.0, "absent": 99.0, "late": 18.7}
    grid, n = np.linspace(0, 20, 401), 401
    time = np.tile(grid, 2*len(begins))  # two channels
    record = np.repeat(np.arange(len(begins)), 2*n)
    acting = time > np.array(list(begins.values()))[record]
    s = np.sin(1.7*time + record) + 0.5*np.sign(np.sin(0.6*time))
    J = np.column_stack([np.cos(0.9*time), 1 + 0.1*time, s + 0.7*np.cos(time)])
    projected = np.linalg.qr(J)[0]

    def apart(v: np.ndarray) -> np.ndarray:
        return v - projected @ (projected.T @ v)

    r = apart(random.normal(size=len(time)) - 2.0*s*acting)
    left, length = apart(s), float(np.linalg.norm(apart(s)))
    z = -float(left @ r)/length
    counts, found_grid = np.ones((2, n), bool), SimpleNamespace(grid=grid)
    runs = [SimpleNamespace(record=SimpleNamespace(name=name), found=found_grid, counts=counts) for name in begins]
    base = SimpleNamespace(J=J, priors=np.zeros((0, 3)), moving=np.arange(3), r=r, problem=SimpleNamespace(runs=runs))
    score = SimpleNamespace(told_apart=True, z=z, size=float(np.linalg.norm(s)), share=length/float(np.linalg.norm(s)),
                            direction=left/length, signed=False,
                            step=-np.linalg.lstsq(J, s, rcond=None)[0]*z/length)
    gain, whole, found_times = _Scan(base).best(score)
    # the grid of a record has 200 steps of 0.1 s; the noise moves a time by a few samples of 50 ms
    assert found_times["early"] == pytest.approx(3.0, abs=0.3) and found_times["late"] == pytest.approx(18.7, abs=0.3)
    assert found_times["whole"] == 0.0 and found_times["absent"] == 20.0
    # the gain is that of the direction with these times
    exact = apart(s*(time > np.array(list(found_times.values()))[record] - 1e-9*(record == 1)))
    assert gain == pytest.approx(float(exact @ r)**2/float(exact @ exact), rel=1e-6)
    assert whole == pytest.approx(z**2, rel=1e-6)


def test_what_does_not_begin_in_an_excerpt_begins_after_the_whole_record(tmp_path):
    path = records(tmp_path, ("", ""))
    rubbing = {"parts": "\n  rub: {is: CoulombFriction, F_c: 6 N}\n  ground: {is: Fixed}\n"
                        "  late: {is: Onset, u: =time, t_0: 5 s, u_m: 10 s}",
               "end": ", rub.a", "nodes": "\n  g: [rub.b, ground.a]"}
    (tmp_path / "small.yaml").write_text(diagram(**rubbing) + "vary: {rub.F_c: =late.factor}\n")
    text = path.read_text().replace("{file: a.csv,", "{file: a.csv, set: {late.t_0: 8.2 s}, to: 8 s,")
    path.write_text(text + "  late.t_0: {range: 0 .. 8.2 s, each: record}\n")
    searched = hb.load_experiment(path)
    whole = replace(searched, records={**searched.records, "a": replace(searched.records["a"], end=None)})
    moved = _with_late_times(whole, searched, compare(whole))
    # the excerpt ends at 8 s, the record at 20 s
    setting = moved.records["a"].settings["late.t_0"].value
    assert isinstance(setting, Value) and constant(setting.expr) == pytest.approx(20.2)
    assert moved.free["late.t_0"].range.high == pytest.approx(20.2)
    # a time within the excerpt stays
    within = whole.with_record_values({"a": {"late.t_0": 6.0}})
    assert _with_late_times(within, searched, compare(whole)).free["late.t_0"].range.high == pytest.approx(8.2)
