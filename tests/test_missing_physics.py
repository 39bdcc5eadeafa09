"""The benchmark of missing physics: the equations of its cases, the score, and that entries see no truth."""

import json
import re
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from benchmarks.missing_physics import __main__ as command
from benchmarks.missing_physics import making
from benchmarks.missing_physics.equations import written
from benchmarks.missing_physics.reading import System, parsed
from benchmarks.missing_physics.scoring import FOLDER, cases, error_of, scored, truth_of
from heavebond.estimation.comparison import assemble_for
from heavebond.estimation.experiment import load_experiment
from heavebond.numerics.inputs import pieced
from heavebond.numerics.result import Probe
from tests.collected import for_each

CASES = cases()


def agree(name: str) -> None:
    """Check that the equations in case.json give the rates and channels of the diagram, at disturbed starts."""
    case = CASES[name]
    experiment = load_experiment(case.folder / "experiment.yaml")
    record = next(iter(experiment.records.values()))
    assembly = assemble_for(experiment, record)
    texts = [o.shown.text for o in experiment.outputs.values()]
    t, x, z, p, u, rate = assembly.arguments
    probe = Probe(assembly, texts, si=True)
    system, seen = System(case), case.records[record.name]
    sides = ca.Function("sides", [t, x, z, p, u, rate], [assembly.ode, probe.signals, assembly.alg])
    rng = np.random.default_rng(1)
    columns = pieced(assembly.flat, float(seen.time[0]), float(seen.time[-1]))
    for time in seen.time[[1, len(seen.time) // 2]]:
        moved = rng.standard_normal((2, len(system.start)))
        state = system.start * (1 + 0.01 * moved[0]) + 1e-3 * moved[1]
        column = columns.at(np.array([time]))[:, 0]
        rates, outputs, residual = (np.array(side).ravel() for side in sides(time, state, 0, assembly.p, column, 1.0))
        if residual.size:  # algebraic variables that enter linearly: one Newton step
            slope = np.array(ca.Function("s", [t, x, z, p, u, rate], [ca.jacobian(assembly.alg, z)])(
                time, state, 0, assembly.p, column, 1.0))
            rates, outputs, _ = (np.array(side).ravel() for side in sides(
                time, state, -np.linalg.solve(slope, residual), assembly.p, column, 1.0))
        values: dict[str, Any] = {**system.parameters, "time": time, **dict(zip(system.states, state, strict=True))}
        for k, known in enumerate(assembly.flat.inputs):
            key, rates_of_input = known.name, column[1 + 4 * k:5 + 4 * k] * [1, 1, 2, 6]
            rate_names = (key, f"der({key})", f"der(der({key}))", f"der(der(der({key})))")
            values |= dict(zip(rate_names, rates_of_input, strict=True))
        np.testing.assert_allclose(system.derivatives(values), rates, rtol=1e-9, atol=1e-12 * np.abs(rates).max() + 1e-12)
        np.testing.assert_allclose([*system.outputs(values).values()], outputs, rtol=1e-9, atol=1e-12)


@for_each("name", ["law_barus", "heave_rig", "swivel", "oil_block", "rig_choked"])
def test_the_equations_of_some_cases_are_those_of_their_diagrams(name: str) -> None:
    agree(name)


@pytest.mark.long
@for_each("name", list(CASES))
def test_the_equations_of_all_cases_are_those_of_their_diagrams(name: str) -> None:
    agree(name)


def test_written_expressions_have_the_value_of_what_they_are_written_from() -> None:
    a, b, c = (ca.SX.sym(n) for n in "abc")
    expressions = {"quotients": a / (b * c) / (a * b / c) - (a - (b - c)) / (a * (b + c)),
                   "power": (a * b)**(c - a) - a**2 / b**2, "shared": ca.sin(a * b) * ca.exp(a * b),
                   "choice": ca.if_else(a < b, a * c, -b) + ca.fmin(a, b) - ca.fabs(c - a),
                   "constant": ca.SX(-2.5) * a, "inverse": 1 / (a * b)}
    texts = written([("part.a", a), ("b", b), ("c", c)], expressions)
    values: dict[str, Any] = {"part.a": 1.3, "b": 0.7, "c": 2.1}
    for name, text in texts.intermediate.items():
        values[name] = parsed(text)(values)
    for key, expression in expressions.items():
        expected = float(ca.Function("f", [a, b, c], [expression])(1.3, 0.7, 2.1))
        assert parsed(texts.expressions[key])(values) == pytest.approx(expected, rel=1e-12), key


@pytest.mark.parametrize("text", ["__import__('os').system('ls')", "(lambda: 1)()", "[1, 2]", "open('x')", "'a'",
                                  "a if b else c"])
def test_an_expression_outside_of_the_grammar_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="no expression of the format"):
        parsed(text)


def test_every_case_is_complete_and_hides_what_is_scored() -> None:
    assert set(CASES) == set(making.names())
    for name, case in CASES.items():
        scored_records = [r for r in case.records.values() if r.use == "score"]
        assert len(scored_records) == 1 and not scored_records[0].outputs, name
        assert all(r.outputs.keys() == case.outputs.keys() for r in case.records.values() if r.use != "score"), name
        assert scored_records[0].name not in (case.folder / "experiment.yaml").read_text().partition("time:")[0], name
        assert set(truth_of(case)["records"]) == {scored_records[0].name}


def test_no_entry_reads_the_truth() -> None:
    for path in (FOLDER / "entries").glob("*.py"):
        assert not re.search(r"truth", path.read_text(encoding="utf-8")), path


def answer(name: str, **content: Any) -> dict[str, Any]:
    return {"entry": "e", "case": name, "effects": [], "processor": 1.0, **content}


def test_the_levels_of_an_answer_count_from_the_top() -> None:
    case = CASES["rig_friction"]
    right = {"side": "machine", "place": ["crown", "platform"], "kind": "rate", "class": "dry friction",
             "law": "CoulombFriction"}
    levels = [scored(case, answer(case.name, effects=[{**right, **wrong}])).levels for wrong in (
        {}, {"law": "Other"}, {"class": "leakage"}, {"kind": "source"}, {"place": ["crown", "seabed"]},
        {"side": "measuring chain"})]
    assert levels == [6, 5, 4, 3, 2, 1]
    assert scored(case, answer(case.name)).levels == 0
    second = scored(case, answer(case.name, effects=[right, {**right, "place": ["seabed"]}]))
    assert (second.levels, second.extra) == (6, 1)
    nothing = CASES["rig_nothing"]
    assert scored(nothing, answer("rig_nothing", effects=[right])).false and not scored(nothing, answer("rig_nothing")).false


def test_a_law_outside_of_catalogues_counts_by_its_values() -> None:
    case = CASES["law_magnet"]
    truth = truth_of(case)
    effect = {"side": "machine", "place": ["frame", "slide"], "kind": "displacement", "class": "", "law": "F = ..."}
    w = np.array(truth["input"]["values"])
    for share, expected in ((1.0, 6), (1.04, 6), (-1.0, 6), (1.1, 4)):
        given = answer(case.name, effects=[effect], input={"place": ["frame", "slide"], "values": (share * w).tolist()})
        assert scored(case, given).levels == expected, share


def test_the_error_of_the_measured_record_is_zero_and_a_missing_one_infinite() -> None:
    import pandas as pd

    case = CASES["rig_friction"]
    truth = truth_of(case)
    (name, file), = truth["records"].items()
    table = pd.read_csv(FOLDER / "truths" / file)
    exact = {key: (table[c["column"]] * c["scale"] + c["offset"]).tolist() for key, c in case.outputs.items()}
    assert error_of(case, truth, {"predictions": {name: exact}}) == 0.0
    off = {key: (np.array(values) + 2 * case.outputs[key]["noise"]).tolist() for key, values in exact.items()}
    assert error_of(case, truth, {"predictions": {name: off}}) == pytest.approx(2.0)
    assert error_of(case, truth, {"predictions": {}}) == np.inf


def test_writing_a_case_again_gives_the_same_files(tmp_path: Path) -> None:
    for name in ("law_magnet", "rig_cogging"):
        making.write(name, tmp_path)
        for folder in (f"machines/{name}", "truths"):
            for path in (tmp_path / folder).glob(f"{name}*" if folder == "truths" else "*.csv"):
                new, old = (np.array(re.findall(r"-?\d+\.?\d*(?:e[-+]?\d+)?", p.read_text()), float)
                            for p in (path, FOLDER / folder / path.name))
                # simulated values are equal to the tolerance of the integrator on every computer
                np.testing.assert_allclose(new, old, rtol=2e-4, atol=1e-6, err_msg=str(path))


def test_an_entry_without_its_packages_is_left_out_with_the_reason(tmp_path: Path, capsys: pytest.CaptureFixture[str],
                                                                    monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command, "find_spec", lambda word: None)
    command.run(tmp_path, ["sindy", "ude"], [], FOLDER)
    assert "sindy: left out, not installed: pysindy, scipy" in capsys.readouterr().out


@pytest.mark.long
def test_the_base_model_answers_and_is_scored(tmp_path: Path, capsys: pytest.CaptureFixture[str],
                                              monkeypatch: pytest.MonkeyPatch) -> None:
    command.run(tmp_path, ["base_model"], ["coil"], FOLDER)
    found = json.loads((tmp_path / "base_model" / "coil.json").read_text())
    assert found["effects"] == [] and set(found["predictions"]) == set(truth_of(CASES["coil"])["records"])
    monkeypatch.setattr("sys.argv", ["x", "score", str(tmp_path)])
    command.main()
    assert "base model, fitted" in capsys.readouterr().out
