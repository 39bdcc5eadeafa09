"""Data sheets: components that extend others with values of their own, and parts that take values from other parts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import heavebond as hb
from heavebond.cli import main
from heavebond.core.errors import HeavebondError, ModelError
from heavebond.language.library import library
from heavebond.studio.diagram_edits import Named, renamed_mentions

SHEETS = {
    "rubber": """
component: Rubber
summary: Data of a rubber mount.
parameters:
  c: {unit: N/m, min: 0, doc: stiffness}
  tau: {unit: s, min: 0, doc: loss time}
  d: {unit: N*s/m, min: 0, default: =c*tau, doc: damping}
""",
    "soft": "component: SoftRubber\nextends: Rubber\nsummary: Soft rubber.\nset: {c: 2 kN/m, tau: 20 ms}\n",
    "aged": "component: AgedRubber\nextends: SoftRubber\nsummary: Soft rubber after years.\nset: {c: 3 kN/m}\n",
    "stiff": "component: StiffSpring\nextends: Spring\nsummary: A stiff spring.\nset: {c: 8 kN/m}\n",
}
RIG = """
model: rig
components:
  sheet: {is: SoftRubber}
  wall:  {is: Fixed}
  left:  {is: SpringDamper, data: sheet}
  right: {is: SpringDamper, data: sheet, c: 1 kN/m}
  load:  {is: Mass, m: 5 kg}
  weight: {is: Weight, data: load}
nodes:
  wall: [wall.a, left.a, right.a]
  load: [left.b, right.b, load.a, weight.a]
initial: {load.x: 10 mm, load.v: 0 m/s}
show: {load.x: {unit: m}}
simulate: {until: 0.5 s}
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "components").mkdir()
    for name, text in SHEETS.items():
        (tmp_path / "components" / f"{name}.yaml").write_text(text)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_parts_share_the_values_of_a_sheet_but_for_their_own(folder: Path) -> None:
    shared = hb.simulate(hb.loads(RIG, folder))
    by_hand = RIG.replace("data: sheet, c: 1 kN/m", "c: 1 kN/m, d: 40 N*s/m").replace(
        "data: sheet", "c: 2 kN/m, d: 40 N*s/m").replace("data: load", "m: 5 kg").replace("  sheet: {is: SoftRubber}\n", "")
    assert shared["load.x"] == pytest.approx(hb.simulate(hb.loads(by_hand, folder))["load.x"], rel=1e-9, abs=1e-12)
    assembly = hb.assemble(hb.loads(RIG, folder))
    assert {"sheet.c", "sheet.tau", "right.c", "load.m"} <= set(assembly.parameter_values)
    assert not {"left.c", "left.d", "right.d", "weight.m"} & set(assembly.parameter_values)   # formulas of the sheet's
    assert assembly.flat.expanded.sheets == {"sheet": ("left.c", "left.d", "right.d"), "load": ("weight.m",)}


def test_a_sheet_extends_another_one_and_a_setting_precedes_both(folder: Path) -> None:
    for kind, c in (("SoftRubber", 2e3), ("AgedRubber", 3e3), ("SoftRubber, c: 4 kN/m", 4e3)):
        values = hb.assemble(hb.loads(RIG.replace("is: SoftRubber", f"is: {kind}"), folder)).parameter_values
        assert (values["sheet.c"], values["sheet.tau"]) == (c, 0.02)
    known = library([folder])
    aged = known.component("AgedRubber")
    assert aged.is_a("Rubber") and aged.is_a("SoftRubber") and not aged.is_a("Spring")
    assert known.component("StiffSpring").equations == known.component("Spring").equations


def test_one_number_counts_for_all_that_share_it(folder: Path) -> None:
    """Sensitivity to the number of the sheet beside differences, and an estimate of it from a record."""
    model = hb.loads(RIG, folder)
    run, h = hb.simulate(model, sensitivities=["sheet.tau"]), 1e-5
    higher, lower = (hb.simulate(model.with_parameters({"sheet.tau": 0.02 + d}))["load.x"] for d in (h, -h))
    # runs of 1e-8 of 10 mm over steps of 1e-5: 1e-5 m/s, beside sensitivities of 0.1
    assert run.sensitivity("load.x", "sheet.tau") == pytest.approx((higher - lower)/(2*h), abs=2e-3)
    assert np.abs(run.sensitivity("load.x", "sheet.tau")).max() > 0.05
    np.savetxt(folder / "record.csv", np.column_stack([run.time, run["load.x"]]), delimiter=",", header="t,x", comments="")
    (folder / "rig.yaml").write_text(RIG.replace("is: SoftRubber", "is: SoftRubber, tau: 35 ms"))
    (folder / "fit.yaml").write_text("""
experiment: shared damping
model: rig.yaml
records: {train: {file: record.csv, use: fit}}
time: {column: t, unit: s}
outputs: {load.x: {column: x, unit: m, noise: 0.1 mm}}
free: {sheet.tau: 5 .. 60 ms}
""")
    fitted = hb.fit(hb.load_experiment(folder / "fit.yaml"))
    assert fitted.values["sheet.tau"] == pytest.approx(0.02, rel=1e-4)


def test_lists_and_whole_numbers_are_taken_and_set(folder: Path) -> None:
    (folder / "components" / "curve.yaml").write_text("""
component: Curve
summary: Points of a lookup table.
parameters:
  n: {integer, min: 2, doc: number of points}
  x: {unit: m, count: n, doc: places}
  y: {unit: N, count: n, doc: forces}
""")
    (folder / "components" / "measured.yaml").write_text(
        "component: MeasuredCurve\nextends: Curve\nsummary: x.\nset: {x: [0 mm, 1 mm, 3 mm], y: [0 N, 5 N, 6 N]}\n")
    (folder / "components" / "user.yaml").write_text("""
component: Total
summary: The sum of the forces of a curve.
ports: {s: {signal: out, unit: N}}
parameters:
  n: {integer, min: 2, doc: number of points}
  y: {unit: N, count: n, doc: forces}
equations: |
  s = sum(y)
""")
    text = """
model: curves
components: {curve: {is: Curve, n: 2, x: [0 mm, 1 mm], y: [1 N, 2 N]}, sum: {is: Total, data: curve}}
nodes: {s: [sum.s]}
simulate: {until: 1 s}
"""
    assert hb.simulate(hb.loads(text, folder))["s"][0] == 3
    measured = text.replace("is: Curve, n: 2, x: [0 mm, 1 mm], y: [1 N, 2 N]", "is: MeasuredCurve")
    assert hb.simulate(hb.loads(measured, folder))["s"][0] == 11
    assert hb.simulate(hb.loads(measured, folder).with_parameters({"curve.y[3]": "10 N"}))["s"][0] == 15


def test_a_sheet_inside_a_block_belongs_to_the_block(folder: Path) -> None:
    (folder / "components" / "mount.yaml").write_text("""
component: Mount
summary: A mount of rubber.
ports: {a: translational, b: translational}
parameters: {c: {unit: N/m, min: 0, doc: stiffness}}
components:
  sheet: {is: SoftRubber, c: =c}
  body:  {is: SpringDamper, data: sheet}
nodes: {foot: [a, body.a], head: [body.b, b]}
""")
    text = RIG.replace("left:  {is: SpringDamper, data: sheet}", "left:  {is: Mount, data: sheet}")
    values = hb.assemble(hb.loads(text, folder)).flat.expanded.sheets
    assert values["left.sheet"] == ("left.body.c", "left.body.d")
    assert hb.simulate(hb.loads(text, folder))["load.x"] == pytest.approx(
        hb.simulate(hb.loads(RIG, folder))["load.x"], rel=1e-9, abs=1e-12)


WRONG = {
    "data-unknown": ("data: sheet}", "data: shett}"), "data-nothing": ("data: load", "data: wall"),
    "data-twice": ("data: sheet}", "data: [sheet, right]}"), "unit-wrong": ("m: 5 kg}", "m: 5 kg, data: q}"),
    "parameter-missing": ("left:  {is: SpringDamper, data: sheet}", "left:  {is: SpringDamper}"),
    "parameter-circle": ("m: 5 kg}", "data: weight}"),
}


@pytest.mark.parametrize("code", WRONG)
def test_a_wrong_sheet_is_told(code: str, folder: Path) -> None:
    text = RIG.replace(*WRONG[code])
    if code == "unit-wrong":
        (folder / "components" / "other.yaml").write_text(
            "component: Other\nsummary: x.\nparameters: {m: {unit: m, default: 1 m, doc: length}}\n")
        text = text.replace("m: 5 kg, data: q}", "data: q}").replace("  wall:  {", "  q: {is: Other}\n  wall:  {")
    with pytest.raises(ModelError) as caught:
        hb.assemble(hb.loads(text, folder))
    assert code in {problem.code for problem in caught.value.problems}, caught.value
    assert all(problem.place is not None and problem.hint for problem in caught.value.problems)


def test_the_part_itself_and_a_component_are_no_parts_beside_it(folder: Path) -> None:
    for written, said in (("data: left", "the part itself"), ("data: SoftRubber", "`softRubber: {is: SoftRubber}`")):
        with pytest.raises(ModelError, match=said):
            hb.assemble(hb.loads(RIG.replace("left:  {is: SpringDamper, data: sheet}",
                                             f"left:  {{is: SpringDamper, {written}}}"), folder))


MISTAKES = {
    "extends: Rubbr": "component-unknown", "extends: Wrong": "extends-circle",
    "extends: Rubber\nequations: c = d": "key-unknown",
    "extends: Rubber\nset: {cc: 1 N/m}": "parameter-unknown", "extends: Rubber\nset: {c: 1 kg}": "unit-wrong",
    "extends: Rubber\nset: {c: -1 N/m}": "parameter-bound", "extends: Rubber\nset: {c: =k/2}": "name-unknown",
    "extends: Rubber\nset: {c: =2*tau}": "unit-wrong", "extends: PumpPoints\nset: {dp: 3 bar}": "list-number",
    "extends: [Rubber]": "extends-missing", "set: {c: 1 N/m}": "extends-missing",
}


@pytest.mark.parametrize("text", MISTAKES)
def test_a_wrong_extension_is_told_with_its_line(text: str, folder: Path) -> None:
    (folder / "components" / "points.yaml").write_text("""
component: PumpPoints
summary: x.
parameters: {n: {integer, min: 1, doc: number}, dp: {unit: Pa, count: n, doc: pressures}}
""")
    path = folder / "components" / "wrong.yaml"
    path.write_text(f"component: Wrong\n{text}\nsummary: x.\n")
    with pytest.raises(HeavebondError) as caught:
        library([folder]).checked("Wrong")
    assert [problem.code for problem in caught.value.problems] == [MISTAKES[text]]
    assert all(p.place is not None and p.place.file.endswith("wrong.yaml") and p.hint for p in caught.value.problems)


def test_a_circle_over_several_files_is_told(folder: Path) -> None:
    for name, base in (("One", "Two"), ("Two", "One")):
        (folder / "components" / f"{name}.yaml").write_text(f"component: {name}\nextends: {base}\nsummary: x.\n")
    with pytest.raises(ModelError, match="extends itself over others"):
        library([folder]).component("One")


def test_check_tells_who_takes_what_and_checks_an_extension(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "rig.yaml").write_text(RIG)
    with pytest.raises(SystemExit, match="0"):
        main(["check", "rig.yaml"])
    assert "sheet (SoftRubber) gives left.c, left.d, right.d" in capsys.readouterr().out
    for name in ("aged", "stiff"):
        with pytest.raises(SystemExit, match="0"):
            main(["check", f"components/{name}.yaml"])
    assert "Component StiffSpring" in capsys.readouterr().out


def test_a_sheet_is_renamed_where_parts_take_from_it() -> None:
    named = Named("sheet", frozenset({"c"}), is_part=True, is_node=False)
    text = "components:\n  a: {is: Spring, data: sheet}\n  b: {is: A, data: [sheet, other]}\n  c: {is: A, c: =sheet.c}\n"
    assert renamed_mentions(text, named, "rubber", node=False) == text.replace("sheet", "rubber")
