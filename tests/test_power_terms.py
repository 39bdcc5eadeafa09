"""Components that create power are told by `check`, with the term and its line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from heavebond.cli import main
from heavebond.language.component_file import parse_component
from heavebond.language.library import library
from heavebond.language.power_law import check_power
from heavebond.language.power_terms import power_problems
from heavebond.text.yaml_source import parse

DAMPER = """\
component: Brake
summary: A damper.
ports: {a: translational, b: translational}
parameters:
  d: {unit: N*s/m, min: 0, doc: damping}
variables:
  v: {unit: m/s, doc: speed of elongation}
  F: {unit: N, doc: tension}
equations: |
  v   = b.v - a.v
  F   = d * v
  b.f = F
  a.f = -F
dissipates: F * v
"""
SPRING = """\
component: Coil
summary: A spring.
ports: {a: translational, b: translational}
parameters:
  c: {unit: N/m, min: 0, doc: stiffness}
variables:
  s: {unit: m, doc: elongation}
  F: {unit: N, doc: tension}
equations: |
  s   = b.x - a.x
  F   = c * s
  b.f = F
  a.f = -F
stores: 1/2 * c * s**2
"""
MODEL = """\
model: rig
components:
  wall: {is: Fixed}
  body: {is: Mass, m: 1 kg}
  mine: {is: Brake, d: 3 N*s/m}
nodes: {wall: [wall.a, mine.a], body: [body.a, mine.b]}
initial: {body.v: 1 m/s}
simulate: {until: 1 s}
"""


@pytest.mark.parametrize(("text", "old", "new", "code", "line", "message"), [
    (DAMPER, "a.f = -F", "a.f = F", "power-created", 13, "the sign at port 'a' is wrong: `a.f = F`"),
    (DAMPER, "b.f = F", "b.f = -F", "power-created", 12, "the sign at port 'b' is wrong: `b.f = -F`"),
    (DAMPER, "b.f = F\n  a.f = -F", "b.f = -F\n  a.f = F", "power-created", 12, "the sign at ports 'a' and 'b' is wrong"),
    (DAMPER, "F   = d * v", "F   = -d * v", "power-created", 11, "the force law `F   = -d * v` has the wrong sign"),
    (DAMPER, "dissipates: F * v", "dissipates: -F * v", "power-created", 14, "`dissipates: -F * v` of Brake has the wrong"),
    (DAMPER, "dissipates: F * v\n", "", "power-undeclared", 12, "takes in power and does not declare its storage or "
                                                                "dissipation"),
    (DAMPER.replace("d * v", "-d * v"), "dissipates: F * v\n", "", "power-undeclared", 12, "gives power and does not"),
    (SPRING, "F   = c * s", "F   = -c * s", "power-created", 12, "the sign at ports 'a' and 'b' is wrong"),
    (SPRING, "1/2 * c", "c", "power-created", 12, "is neither stored, dissipated nor declared"),
], ids=["reaction", "load", "both forces", "force law", "dissipates", "nothing declared", "feeds and nothing declared",
        "spring that pushes", "factor"])
def test_a_wrong_sign_in_a_component_is_told_with_its_line(text: str, old: str, new: str, code: str, line: int,
                                                          message: str) -> None:
    domains = library().domains
    assert old in text
    component = parse_component(parse(text.replace(old, new), Path("mine.yaml"), "mine.yaml"), domains)
    problem, = power_problems([component], domains)
    assert (problem.code, problem.place and problem.place.line) == (code, line)
    assert message in problem.message


@pytest.mark.parametrize("text", [DAMPER, SPRING])
def test_a_right_component_is_told_nothing(text: str) -> None:
    domains = library().domains
    component = parse_component(parse(text, Path("mine.yaml"), "mine.yaml"), domains)
    assert check_power(component, domains).holds
    assert list(power_problems([component], domains)) == []


def _check(words: list[str]) -> int:
    with pytest.raises(SystemExit) as caught:
        main(["check", *words])
    return int(caught.value.code or 0)


def test_a_diagram_whose_own_component_creates_power_is_told_by_check(tmp_path: Path,
                                                                     capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "rig.yaml"
    path.write_text(MODEL, encoding="utf-8")
    mine = tmp_path / "brake.yaml"
    mine.write_text(DAMPER, encoding="utf-8")
    assert _check([str(path), "--json", str(tmp_path / "told.json")]) == 0
    assert json.loads((tmp_path / "told.json").read_text(encoding="utf-8"))["power"] == []
    mine.write_text(DAMPER.replace("a.f = -F", "a.f = F"), encoding="utf-8")
    assert _check([str(path)]) == 1
    told = capsys.readouterr()
    assert "Diagram rig" in told.out
    assert "brake.yaml:13" in told.err
    assert "power-created" in told.err
    mine.write_text(DAMPER.replace("a.f = -F", "a.f = F") + "power: source\n", encoding="utf-8")
    assert _check([str(path)]) == 0


@pytest.mark.long
def test_a_component_file_is_told_from_a_diagram_by_its_first_key(tmp_path: Path,
                                                                  capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "brake.yaml"
    path.write_text(DAMPER, encoding="utf-8")
    assert _check([str(path)]) == 0
    assert "Component Brake" in capsys.readouterr().out
    path.write_text(DAMPER.replace("F   = d * v", "F   = -d * v"), encoding="utf-8")
    assert _check([str(path)]) == 1
    assert "brake.yaml:11" in capsys.readouterr().err
    path.write_text(DAMPER.replace("a.f = -F\n", "a.f = -v\n"), encoding="utf-8")
    assert _check([str(path)]) == 1
    assert "unit" in capsys.readouterr().err
