"""Edits of a drawing: only the lines meant are changed, names are followed everywhere, and what does not fit is told."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Any

import pytest

import heavebond as hb
from heavebond.core.errors import UsageError
from heavebond.language.library import bundled
from heavebond.pictures.drawing import draw_expanded
from heavebond.studio.bench import view
from heavebond.studio.diagram_edits import read_diagram
from heavebond.studio.edit_actions import edited
from heavebond.studio.grid import grid_of
from heavebond.studio.job import Job
from heavebond.studio.palette import palette

CAR = (bundled("models") / "quarter_car" / "quarter_car.yaml").read_text(encoding="utf-8")
WHOLE = [p for p in sorted(bundled("models").glob("*/*.yaml")) if p.parent.name != "examples"
         and p.read_text(encoding="utf-8").startswith("model:") and "\nextends:" not in p.read_text(encoding="utf-8")
         and "\ncomponents:" in p.read_text(encoding="utf-8")]


def _edit(text: str, act: str, *, file: Path | str = "/nowhere/car.yaml", **action: Any) -> str:
    return str(edited(Job(text, str(file), "car.yaml"), {"act": act, **action})["text"])


def _refused(text: str, act: str, **action: Any) -> str:
    with pytest.raises(UsageError) as caught:
        _edit(text, act, **action)
    return caught.value.problems[0].message


def _lines(before: str, after: str) -> tuple[list[str], list[str]]:
    lines = list(difflib.ndiff(before.splitlines(), after.splitlines()))
    return [x[2:] for x in lines if x[0] == "-"], [x[2:] for x in lines if x[0] == "+"]


def _grid(text: str) -> Any:
    diagram = read_diagram(text, Job(text, "/nowhere/car.yaml", "car.yaml"))
    return grid_of(draw_expanded(diagram.expanded, diagram.network)[1])


@pytest.mark.parametrize("path", WHOLE[::4], ids=lambda p: f"{p.parent.name}-{p.stem}")
def test_renaming_a_part_keeps_the_diagram_and_all_other_bytes(path: Path) -> None:
    """The renamed diagram has no fault that it had not before, and renaming back gives the same bytes."""
    text = path.read_text(encoding="utf-8")
    diagram = read_diagram(text, Job(text, str(path), path.name))
    parts = [name for name in diagram.section("components") if name in diagram.expanded.leaves]
    for name in {parts[0], parts[-1]}:
        changed = _edit(text, "rename", file=path, part=name, name="renamed_part")
        went, came = _lines(text, changed)
        assert len(went) == len(came) and all(name in line for line in went) and all("renamed_part" in line for line in came)
        assert _edit(changed, "rename", file=path, part="renamed_part", name=name) == text
        again = read_diagram(changed, Job(changed, str(path), path.name))
        assert len(again.expanded.leaves) == len(diagram.expanded.leaves)
        ends = [sorted(len(j.ends) for j in d.expanded.junctions.values()) for d in (diagram, again)]
        assert ends[0] == ends[1]


def test_a_part_and_a_node_of_one_name_are_told_apart() -> None:
    """`body.m` is the mass of the part, `body.x` the position of the node."""
    changed = _edit(CAR, "rename", part="body", name="chassis")
    assert "m: =chassis.m" in changed and "is: body.x, unit: m" in changed and "der(body.v)" in changed
    assert "body:  [chassis.a, body_weight.a, spring.b, damper.b]" in changed
    changed = _edit(CAR, "rename_node", node="body", name="hull")
    assert "m: =body.m" in changed and "is: hull.x, unit: m" in changed and "hull:  [body.a, body_weight.a" in changed
    result = hb.simulate(hb.loads(changed))
    assert result.display["comfort"].max() == hb.simulate(hb.loads(CAR)).display["comfort"].max()


def test_a_formula_in_a_block_of_text_follows_a_new_name_and_is_replaced() -> None:
    part = "  other:\n    is: Mass\n    m: >-\n      =2*\n      body.m\n    at: [5, 5]\n"
    text = CAR.replace("components:\n", f"components:\n{part}", 1)
    went, came = _lines(text, _edit(text, "rename", part="body", name="shell"))
    assert "      body.m" in went and "      shell.m" in came and len(went) == len(came)
    assert _lines(text, _edit(text, "set", path="other.m", value="3 kg")) == (
        ["    m: >-", "      =2*", "      body.m"], ["    m: 3 kg"])


def test_a_value_that_cannot_be_read_is_refused_and_one_that_stands_there_is_mended() -> None:
    assert "lightyears" in _refused(CAR, "set", path="body.m", value="5 lightyears")
    assert "lightyears" in _refused(CAR, "setting", key="until", value="5 lightyears")
    typed = _edit(CAR, "set", path="body.m", value="400 kg").replace("400 kg", "5 lightyears")
    assert _edit(typed, "set", path="body.m", value="400 kg") == _edit(CAR, "set", path="body.m", value="400 kg")
    assert "lightyears" in _edit(typed, "set", path="wheel.m", value="41 kg")  # another fault is no reason


def test_a_deleted_part_goes_with_its_wires_and_mentions() -> None:
    changed = _edit(CAR, "delete", parts=["tyre"])
    went, came = _lines(CAR, changed)
    assert [line.split(":")[0].strip() for line in went] == ["tyre", "wheel", "road", "tyre_force"]
    assert [line.strip() for line in came] == ["wheel: [spring.a, damper.a, wheel.a, wheel_weight.a]", "road:  [road.a]"]
    assert "# of the bump" in changed and "# Every figure is ours" in changed
    changed = _edit(CAR, "delete", nodes=["wheel"])
    assert "\n  wheel: [" not in changed and "suspension:" not in changed and "comfort:" in changed


def test_what_else_goes_with_a_part_is_told() -> None:
    assert edited(Job(CAR, "car.yaml", "car.yaml"), {"act": "delete", "parts": ["tyre"]})["removed"] == ["output tyre_force"]


def test_a_wire_makes_a_node_joins_one_or_makes_two_one() -> None:
    text = "model: a\ncomponents:\n  m: {is: Mass, m: 1 kg}\n  s: {is: Spring, c: 1 N/m}\n  d: {is: Damper, d: 1 N*s/m}\n"
    text = _edit(text, "join", **{"from": "s.b", "to": "m.a"})
    assert text.endswith("nodes:\n  m: [s.b, m.a]\n")  # the name of the part that has this port alone
    text = _edit(text, "join", **{"from": "d.a", "to": "s.a"})
    assert text.endswith("  m: [s.b, m.a]\n  d_a: [d.a, s.a]\n")
    text = _edit(text, "join", **{"from": "d.b", "to": "s.b"})
    assert text.endswith("  m: [s.b, m.a, d.b]\n  d_a: [d.a, s.a]\n")
    shown = text + "show: {gap: {is: d_a.x - m.x, unit: mm}}\n"
    assert "nodes:\n  m: [s.b, m.a, d.b, d.a, s.a]\nshow: {gap: {is: m.x - m.x, unit: mm}}\n" in \
        _edit(shown, "join", **{"from": "m.a", "to": "d.a"})
    assert "  m: [s.b, m.a]\n" in _edit(text, "leave", port="d.b")


@pytest.mark.parametrize(("one", "two", "said"), [
    ("body.a", "oil.a", "a translational port and 'oil.a' a hydraulic port"),
    ("body.a", "road.u", "a signal acts through a source"),
    ("body.a", "spring.b", "joined already, on node 'body'"),
    ("body.a", "body.a", "a wire joins two ports"),
    ("step.y", "road.u", "has a value in place, `u: =height"),
    ("step.y", "step2.y", "are both outputs"),
    ("body.a", "nothing.a", "there is no port 'nothing.a'")])
def test_what_does_not_fit_is_told(one: str, two: str, said: str) -> None:
    text = CAR.replace("nodes:\n", "  oil: {is: PressureSource, p_0: 1 bar}\n  step: {is: Step, y: 1 m}\n"
                                   "  step2: {is: Step, y: 1 m}\nnodes:\n")
    assert said in _refused(text, "join", **{"from": one, "to": two})


def test_a_moved_part_changes_its_line_alone() -> None:
    changed = _edit(CAR, "move", part="damper", column=2, row=2, grid=_grid(CAR))
    went, came = _lines(CAR, changed)
    assert len(went) == len(came) == 1 and came[0].endswith("d: 1.5 kN*s/m, at: [2, 2]}")
    changed = _edit(CAR, "move", part="damper", column=0.5, row=1, grid=_grid(CAR))
    assert "d: 1.5 kN*s/m, at: [0.5, 1]}" in changed
    changed = _edit(CAR, "move", part="damper", column=-1, row=5, grid=_grid(CAR))
    assert "d: 1.5 kN*s/m, at: [-1, 5]}" in changed


def test_parts_without_a_place_stay_where_they_are_when_another_is_moved() -> None:
    bare = "".join(line.replace(", at: [" + line.split(", at: [")[1], "}\n") if ", at: [" in line and "is:" in line
                   and not line.startswith("  road:    {is: ground") else line for line in CAR.splitlines(keepends=True)
                   if not line.startswith(("view", "  axle", "  tyre:    {is: circle", "  road:    {is: ground",
                                           "  spring:  {is: spring", "  damper:  {is: damper", "  body:    {is: box")))
    grid = _grid(bare)
    others = {name: cell for name, cell in grid["cells"].items() if name != "body_weight"}
    column = len(grid["columns"])
    after = _grid(_edit(bare, "move", part="body_weight", column=column, row=0, grid=grid))

    def order(cells: dict[str, Any]) -> dict[str, tuple[int, ...]]:
        ranks = [sorted({cell[k] for name, cell in cells.items() if name in others}) for k in (0, 1)]
        return {name: tuple(ranks[k].index(cells[name][k]) for k in (0, 1)) for name in others}

    assert order(after["cells"]) == order(grid["cells"])
    assert after["cells"]["body_weight"][0] == max(cell[0] for cell in after["cells"].values())


def test_many_parts_between_two_columns_are_numbered_anew() -> None:
    text = CAR
    for _ in range(6):  # halves, quarters, eighths; then no number is left
        text = _edit(text, "place", kind="Mass", column=0.5, row=0, grid=_grid(text))
    cells = _grid(text)["cells"]
    assert sorted(cells[name][0] for name in cells if name.startswith("mass")) == [1, 2, 3, 4, 5, 6]
    assert cells["body"][0] == 7


def test_a_placed_part_has_the_values_it_needs() -> None:
    text = _edit("model: a\nsimulate: {until: 1 s}\n", "place", kind="SpringDamper", column=0, row=0)
    assert text == "model: a\ncomponents:\n  spring_damper: {is: SpringDamper, c: 100 N/m, d: 2 N*s/m, at: [0, 0]}\n" \
                   "simulate: {until: 1 s}\n"
    again = _edit(text, "copy", part="spring_damper", grid=_grid(text))
    assert "  spring_damper2: {is: SpringDamper, c: 100 N/m, d: 2 N*s/m, at: [0, 1]}\n" in again
    assert "c: 3 kN/m" in _edit(text, "set", path="spring_damper.c", value="3 kN/m")
    assert "c:" not in _edit(text, "set", path="spring_damper.c", value="")


@pytest.mark.parametrize("name", ["", "1a", "a b", "time", "a: b", "spring", "x" * 90, "é;", "height"])
def test_bad_names_are_refused(name: str) -> None:
    assert _refused(CAR, "rename", part="damper", name=name)


def test_a_part_of_another_file_is_not_changed_here(tmp_path: Path) -> None:
    (tmp_path / "car.yaml").write_text(CAR, encoding="utf-8")
    text = "model: b\nextends: car.yaml\n"
    path = tmp_path / "b.yaml"
    with pytest.raises(UsageError, match="declared in the diagram that this one extends"):
        _edit(text, "rename", file=path, part="damper", name="d")
    assert _edit(text, "delete", file=path, parts=["damper"]) == text + "remove: [damper]\n"
    added = _edit(text, "place", file=path, kind="Spring", column=3, row=0)
    joined = _edit(added, "join", file=path, **{"from": "spring2.a", "to": "wheel.a"})
    assert "nodes:\n  wheel: [+spring2.a]\n" in joined


def test_a_turned_part_stands_as_written() -> None:
    text = _edit(CAR, "turn", part="damper", turn=90, grid=_grid(CAR))
    assert "d: 1.5 kN*s/m, at: [2, 1, 180]}" in text
    assert "never turned" in _refused(_edit(CAR, "place", kind="Tank", column=9, row=9), "turn", part="tank", turn=0,
                                      grid={"cells": {"tank": [0, 0]}})


def test_an_unfinished_diagram_is_drawn() -> None:
    text = "model: a\ncomponents:\n  m: {is: Mass}\n  s: {is: Spring, c: 1 N/m}\n  q: {is: Sprig}\nnodes:\n  x: [s.a, q.b]\n"
    found: Any = view(Job(text, "/nowhere/a.yaml", "a.yaml"))
    assert 'data-part="m"' in found["svg"] and 'data-part="s"' in found["svg"] and not found["whole"] and not found["runs"]
    assert {"port-unconnected", "parameter-missing", "component-unknown"} <= {p["code"] for p in found["problems"]}
    assert [p["needed"] for p in found["parts"]["m"]["parameters"] if p["text"] == ""] == [True]
    assert [port["node"] for port in found["parts"]["s"]["ports"]] == ["x", ""]
    assert view(Job("model: a\n", "/nowhere/a.yaml", "a.yaml"))["svg"] == ""


def test_the_palette_has_every_component(tmp_path: Path) -> None:
    (tmp_path / "own.yaml").write_text("component: Own\nsummary: Mine.\nports: {a: translational}\n"
                                       "parameters: {k: {unit: N*s/m, doc: slope}}\nequations: |\n  a.f = k*a.v  # drag\n",
                                       encoding="utf-8")
    groups = palette(tmp_path)["groups"]
    assert groups[0]["name"] == "this folder" and [c["name"] for c in groups[0]["components"]] == ["Own"]
    names = {c["name"] for group in groups for c in group["components"]}
    assert {"Mass", "Cylinder", "PID"} <= names or {"Mass", "Cylinder"} <= names


def test_parts_are_moved_together_and_keep_their_distances() -> None:
    grid = _grid(CAR)
    moved = _edit(CAR, "move_parts", grid=grid, parts=["wheel", "tyre", "road"], part="tyre", column=3, row=3)
    went, came = _lines(CAR, moved)
    assert [line.split(":")[0].strip() for line in came] == ["wheel", "tyre", "road"] and len(went) == 3
    assert "at: [3, 2]" in came[0] and "at: [3, 3]" in came[1] and "at: [3, 4]" in came[2]
    assert _refused(CAR, "move_parts", grid=grid, parts=["wheel", "tyre"], part="tyre", column=1, row=4) == \
        "'tyre' would cover 'road'"


def test_parts_are_copied_with_the_wires_between_them() -> None:
    """The copy below is joined as the original is, its weight is that of its own body, and nothing else changes."""
    copied = _edit(CAR, "copy_parts", grid=_grid(CAR), parts=["body", "body_weight", "spring"], part="body")
    went, came = _lines(CAR, copied)
    assert went == [] and [" ".join(line.split()) for line in came] == [
        "body2: {is: Mass, m: 320 kg, at: [1, 5]}", "body_weight2: {is: Weight, m: =body2.m, at: [0, 5]}",
        "spring2: {is: Spring, c: 22 kN/m, l0: 0.5 m, at: [1, 6]}", "body2: [body2.a, body_weight2.a, spring2.b]"]
    grown = _edit(copied, "delete", parts=["body2", "body_weight2", "spring2"])
    assert grown == CAR


def test_outputs_initial_values_and_the_duration_are_set() -> None:
    """One line for each, sections where the language lists them, and nothing left of a section that becomes empty."""
    bare = "model: m\ncomponents:\n  load: {is: Mass, m: 2 kg}\nnodes:\n  load: [load.a]\nsimulate: {until: 5 s}\n"
    shown = _edit(bare, "show", signal="load.v", unit="m/s", on=True)
    assert _lines(bare, shown) == ([], ["show:", "  load_v: {is: load.v, unit: m/s}"])
    assert _edit(shown, "show", signal="load.v", on=False) == bare
    begun = _edit(shown, "initial", signal="load.v", value="3 m/s")
    assert "initial:\n  load.v: 3 m/s\nshow:" in begun and hb.simulate(hb.loads(begun)).display["load_v"][0] == 3.0
    assert _edit(begun, "initial", signal="load.v", value="") == shown
    longer = _edit(begun, "setting", key="until", value="7 s")
    assert _lines(begun, longer) == (["simulate: {until: 5 s}"], ["simulate: {until: 7 s}"])
    rest = _edit(bare, "setting", key="start", value="rest")
    assert hb.loads(rest).initial.mode == "rest" and _edit(rest, "setting", key="start", value="") == bare
    mine = f"model: mine\nextends: {bundled('models') / 'quarter_car' / 'quarter_car.yaml'}\n"
    assert "not an output of this file" in _refused(mine, "show", signal="body.x", on=False)
    again = _edit(CAR, "setting", key="start", value="")
    assert _lines(CAR, again) == (["initial: {start: steady}"], [])
