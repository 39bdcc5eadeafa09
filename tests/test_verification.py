"""Runs repeated with tighter tolerances and narrower transitions, and what is told of them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import heavebond as hb
from heavebond.cli import main
from heavebond.numerics.simulator import Tolerances
from heavebond.optimise.verification import VERIFICATION, verify

BLOCK = """
model: block
components:
  frame:    {is: Fixed}
  friction: {is: CoulombFriction, F_c: 10 N, v_t: 20 mm/s}
  mass:     {is: Mass, m: 1 kg}
  push:     {is: ForceSource, u: "=9 N*sin(2*pi*time/1 s)"}
nodes: {frame: [frame.a, friction.a], load: [friction.b, mass.a, push.a]}
initial: {load.x: 0 m, load.v: 0 m/s}
show: {x: {is: load.x, unit: mm}, push: {is: push.u, unit: N}}
simulate: {until: 2 s, every: 10 ms}
"""


def test_a_body_that_creeps_where_it_should_stick() -> None:
    """9 N never move what 10 N hold; with a transition of 20 mm/s it creeps to and fro, in proportion to the width."""
    result = hb.simulate(hb.loads(BLOCK))
    found = verify(result, ["x", "push"])
    assert found.widths == ("friction.v_t",)
    assert [m.name for m in found.moved] == ["x"]
    x, push = found.outputs
    assert x.by_tolerances < 1e-6
    narrow = hb.simulate(hb.loads(BLOCK), parameters={"friction.v_t": 0.002}, rtol=1e-10, atol=1e-12)
    moved = np.sqrt(np.mean((narrow.display["x"] - result.display["x"]) ** 2)) / np.ptp(result.display["x"])
    assert x.by_widths == pytest.approx(moved, rel=1e-4)
    assert push.worst == 0
    problem = found.problem()
    assert problem is not None
    assert "friction.v_t" in problem.hint and "DryFriction" in problem.hint


def test_what_switches_does_not_depend_on_widths() -> None:
    result = hb.simulate(hb.loads(BLOCK.replace("is: CoulombFriction, F_c: 10 N, v_t: 20 mm/s",
                                                "is: DryFriction, F_c: 8 N, F_s: 10 N")))
    assert np.ptp(result.display["x"]) < 1e-8  # it sticks; v is kept to the absolute tolerance of 1e-10
    assert verify(result, ["push"]).moved == []


def test_loose_tolerances_are_told() -> None:
    text = BLOCK.replace("{is: CoulombFriction, F_c: 10 N, v_t: 20 mm/s}", "{is: Spring, c: 4 kN/m}")
    result = hb.simulate(hb.loads(text), rtol=1e-2, atol=1e-2)
    found = verify(result, ["x"], tolerances=Tolerances(1e-2, 1e-2))
    assert found.widths == ()
    assert found.outputs[0].by_tolerances > VERIFICATION.allowed
    problem = found.problem()
    assert problem is not None
    assert "--rtol" in problem.hint


def test_a_run_that_fails_with_narrow_widths_has_moved() -> None:
    text = BLOCK.replace("v_t: 20 mm/s", "v_t: 5e-9 m/s")
    result = hb.simulate(hb.loads(text), "0.1 s")
    with pytest.raises(hb.ModelError, match="v_t"):  # a tenth is below what the component allows
        verify(result, ["x"])


def test_a_width_given_by_a_formula_is_narrowed() -> None:
    text = BLOCK.replace("v_t: 20 mm/s", "v_t: =v").replace("model: block", "model: block\nparameters: {v: 20 mm/s}")
    direct, formula = (verify(hb.simulate(hb.loads(t)), ["x"]) for t in (BLOCK, text))
    assert formula.outputs[0].by_widths == pytest.approx(direct.outputs[0].by_widths, rel=1e-9)


def test_on_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, told = tmp_path / "block.yaml", tmp_path / "told.json"
    path.write_text(BLOCK, encoding="utf-8")
    with pytest.raises(SystemExit) as ended:
        main(["run", str(path), "--verify", "--json", str(told)])
    assert ended.value.code == 1
    assert "results-moved" in capsys.readouterr().err
    document = json.loads(told.read_text(encoding="utf-8"))
    assert document["ok"] is False
    assert document["verify"]["moved"] == ["x"]
    assert document["outputs"]["x"]["unit"] == "mm"
    with pytest.raises(SystemExit) as ended:
        main(["run", str(path), "--verify", "--within", "0.99"])
    assert ended.value.code == 0
