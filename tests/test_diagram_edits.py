"""Edits of a drawing: only the lines meant are changed, names are followed everywhere, and what does not fit is told."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Any

import pytest
from collected import partly

import heavebond as hb
from heavebond.core.errors import UsageError
from heavebond.language.library import bundled
from heavebond.pictures.drawing import draw_expanded
from heavebond.studio.bench import view
from heavebond.studio.diagram_edits import read_diagram
from heavebond.studio.edit_actions import edited
from heavebond.studio.job import Job
from heavebond.studio.palette import palette
from heavebond.studio.sheet_edits import places_of

CAR = (bundled("models") / "quarter_car" / "quarter_car.yaml").read_text(encoding="utf-8")
WHOLE = [p for p in sorted(bundled("models").glob("*/*.yaml")) if p.parent.name != "examples"
         and p.read_text(encoding="utf-8").startswith("model:") and "\nextends:" not in p.read_text(encoding="utf-8")
         and "\ncomponents:" in p.read_text(encoding="utf-8")]


def _edit(text: str, act: str, /, *, file: Path | str = "/nowhere/car.yaml", **action: Any) -> str:
    return str(edited(Job(text, str(file), "car.yaml"), {"act": act, **action})["text"])


def _refused(text: str, act: str, /, **action: Any) -> str:
    with pytest.raises(UsageError) as caught:
        _edit(text, act, **action)
    return caught.value.problems[0].message


def _lines(before: str, after: str) -> tuple[list[str], list[str]]:
    lines = list(difflib.ndiff(before.splitlines(), after.splitlines()))
    return [x[2:] for x in lines if x[0] == "-"], [x[2:] for x in lines if x[0] == "+"]


def _places(text: str) -> dict[str, Any]:
    diagram = read_diagram(text, Job(text, "/nowhere/car.yaml", "car.yaml"))
    return places_of(draw_expanded(diagram.expanded, diagram.network)[1])


def _wire(text: str, node: str) -> set[tuple[int, int]]:
    """The points of a wire, in steps of the grid."""
    diagram = read_diagram(text, Job(text, "/nowhere/car.yaml", "car.yaml"))
    drawn = draw_expanded(diagram.expanded, diagram.network)[1]
    return {(x // 10, y // 10) for line in drawn.lines if line.net.path == node for edge in line.wire.edges for x, y in edge}


@pytest.mark.parametrize("path", partly(WHOLE[::4], 4), ids=lambda p: f"{p.parent.name}-{p.stem}")
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
    # also in a diagram with an input that has no value yet
    for text in (CAR, CAR.replace("components:\n", "components:\n  push: {is: ForceSource}\n", 1)):
        for value, reason in (("400 N", "kg is needed"), ("400", "has no unit"), ("-4 kg", "is not allowed")):
            assert reason in _refused(text, "set", path="body.m", value=value)
        assert "m: =2*wheel.m" in _edit(text, "set", path="body.m", value="=2*wheel.m")
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


def test_a_moved_part_lies_where_it_was_dropped_and_the_others_stay() -> None:
    """Also parts that the layout has placed: the first move writes all places, further ones change their line alone."""
    places = _places(CAR)
    moved = _edit(CAR, "move", part="damper", to={"damper": [41, 13]}, places=places)
    assert _lines(CAR, moved)[0] == []
    wanted = {**places, "damper": [41, 13, *places["damper"][2:]]}
    assert _places(moved) == wanted
    again = _edit(moved, "move", part="damper", to={"damper": [43, 12], "spring": [18, 11]}, places=wanted)
    went, came = _lines(moved, again)
    assert len(went) == len(came) == 2 and _places(again) == {
        **wanted, "damper": [43, 12, *places["damper"][2:]], "spring": [18, 11, *places["spring"][2:]]}
    assert "beyond the end" in _refused(CAR, "move", to={"damper": [99999, 0]}, places=places)
    assert "no part" in _refused(CAR, "move", to={"dampr": [0, 0]}, places=places)


def test_a_part_that_is_written_into_a_placed_diagram_covers_no_other() -> None:
    text = _edit(CAR, "move", to={"damper": [41, 13]}, places=_places(CAR))
    text = text.replace("components:\n", "components:\n  buffer: {is: Spring, c: 1 kN/m}\n").replace(
        "wheel: [spring.a", "wheel: [buffer.a, spring.a")
    places = _places(text)
    x, y = places["buffer"][:2]
    assert all(max(abs(x - place[0]), abs(y - place[1])) >= 5 for name, place in places.items() if name != "buffer")


def test_a_wire_goes_through_its_fixed_pieces_and_is_freed() -> None:
    places = _places(CAR)
    routed = _edit(CAR, "route", node="wheel", piece=[10, 27, 30, 27], places=places)
    assert "wheel: [[10, 27, 30, 27]]" in routed and _places(routed) == places
    ports = {(x, y) for x, y in _wire(CAR, "wheel")}
    points = _wire(routed, "wheel")
    assert points and {y for _, y in points} >= {27} and ports != points
    for part in ("spring", "damper", "tyre", "wheel_weight"):  # all ports are still reached
        diagram = read_diagram(routed, Job(routed, "/nowhere/car.yaml", "car.yaml"))
        drawn = draw_expanded(diagram.expanded, diagram.network)[1]
        item = next(item for item in drawn.items if item.part.name == part)
        port = "b" if part == "tyre" else "a"
        assert any((a.x // 10, a.y // 10) in points for a in item.anchors(port)), part
    moved = _edit(routed, "route", node="wheel", piece=[10, 28, 30, 28], old=[10, 27, 30, 27], places=places)
    assert "wheel: [[10, 28, 30, 28]]" in moved
    freed = _edit(moved, "route", node="wheel", places=places)
    assert "wires" not in freed and _wire(freed, "wheel") == ports
    with pytest.raises(ValueError, match="10, 27, 30, 28"):
        _edit(CAR, "route", node="wheel", piece=[10, 27, 30, 28], places=places)


def test_a_note_is_written_moved_and_deleted() -> None:
    noted = _edit(CAR, "note", text="ours: a \"guess\"\nsecond line", x=30, y=2, places=_places(CAR))
    found: Any = view(Job(noted, "/nowhere/car.yaml", "car.yaml"))
    assert found["notes"] == {"note": {"text": 'ours: a "guess"\nsecond line', "at": [30, 2]}}
    assert "second line" in found["svg"] and "guess" in found["svg"]
    moved = _edit(noted, "note", name="note", text="short", x=31, y=2, places=found["places"])
    assert "note: {text: short, at: [31, 2]}" in moved
    gone = _edit(moved, "note", name="note", text="", x=0, y=0, places=found["places"])
    assert "notes" not in gone and "layout:" in gone


def test_a_layout_that_cannot_be_read_is_told_with_its_form() -> None:
    for entry, said in (("parts: {body: [1]}", "the place of 'body'"), ("parts: {body: [1, 2, 45]}", "the place of 'body'"),
                        ("wires: {body: [[1, 2, 3, 4]]}", "a piece of the wire"), ("wires: {body: 3}", "a list of pieces"),
                        ("notes: {a: text}", "needs a text and a place"), ("part: {}", "no entry 'part'"),
                        ("notes: {a: {text: x, at: [1, z]}}", "the place of the note")):
        with pytest.raises(hb.ModelError, match=said):
            hb.loads(f"{CAR}layout: {{{entry}}}\n")
    with pytest.raises(hb.ModelError) as caught:
        hb.loads(f"{CAR}layout: {{parts: {{bdy: [3, 4]}}, wires: {{absent: [[1, 2, 1, 4]]}}}}\n")
    part, wire = caught.value.problems
    assert (part.message, part.hint) == ("`layout:` has an entry for the component 'bdy', which does not exist",
                                         "Did you mean 'body'?")
    assert part.place is not None and part.place.text[part.place.column - 1:][:3] == "bdy"
    assert wire.hint.startswith("Delete this entry, or write the name of a node: ")


def test_a_variant_places_the_parts_that_it_inherits(tmp_path: Path) -> None:
    (tmp_path / "car.yaml").write_text(CAR, encoding="utf-8")
    text, path = "model: b\nextends: car.yaml\n", tmp_path / "b.yaml"
    moved = _edit(text, "move", file=path, to={"damper": [50, 3]}, places=_places(CAR))
    assert "  damper: [50, 3" in moved
    removed = _edit(moved, "delete", file=path, parts=["damper"])
    assert removed.count("damper") == 2  # under `remove:`, and its place, in case it returns


def test_a_placed_part_has_the_values_it_needs() -> None:
    text = _edit("model: a\nsimulate: {until: 1 s}\n", "place", kind="SpringDamper", x=3, y=4)
    assert text == "model: a\ncomponents:\n  spring_damper: {is: SpringDamper, c: 100 N/m, d: 2 N*s/m}\n" \
                   "simulate: {until: 1 s}\nlayout:\n  parts:\n    spring_damper: [3, 4]\n"
    again = _edit(text, "copy", parts=["spring_damper"], places=_places(text))
    assert "  spring_damper2: {is: SpringDamper, c: 100 N/m, d: 2 N*s/m}\n" in again
    assert "    spring_damper2: [9, 10" in again
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
    added = _edit(text, "place", file=path, kind="Spring", x=30, y=0)
    joined = _edit(added, "join", file=path, **{"from": "spring2.a", "to": "wheel.a"})
    assert "nodes:\n  wheel: [+spring2.a]\n" in joined


def test_a_turned_or_mirrored_part_stands_as_written() -> None:
    text, seen = CAR, []
    for _ in range(4):
        text = _edit(text, "turn", part="damper", places=_places(text))
        seen.append(_places(text)["damper"][2])
    assert sorted(seen) == ["0", "180", "270", "90"]
    mirrored = _edit(text, "turn", part="damper", mirror=True, places=_places(text))
    before, after = _places(text)["damper"], _places(mirrored)["damper"]
    assert before[:2] == after[:2] and before[2:] != after[2:]
    assert _edit(mirrored, "turn", part="damper", mirror=True, places=_places(mirrored)) == text
    tank = _edit(CAR, "place", kind="Tank", x=90, y=9)
    assert "never turned" in _refused(tank, "turn", part="tank", places=_places(tank))


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


def test_parts_are_copied_with_the_wires_between_them_also_to_another_diagram() -> None:
    """The copy is joined as the original is, its weight is that of its own body, and nothing else changes."""
    parts, places = ["body", "body_weight", "spring"], _places(CAR)
    copied = _edit(CAR, "copy", parts=parts, places=places)
    went, came = _lines(CAR, copied)
    assert went == [] and [" ".join(line.split()) for line in came[:4]] == [
        "body2: {is: Mass, m: 320 kg}", "body_weight2: {is: Weight, m: =body2.m}",
        "spring2: {is: Spring, c: 22 kN/m, l0: 0.5 m}", "body2: [body2.a, body_weight2.a, spring2.b]"]
    after = _places(copied)
    assert {name: after[name] for name in places} == places
    assert [[after[f"{name}2"][k] - places[name][k] for k in (0, 1)] for name in parts] == [[6, 6]] * 3
    grown = _edit(copied, "delete", parts=["body2", "body_weight2", "spring2"])
    assert hb.loads(grown).body.layout.parts.keys() == places.keys()
    clipboard = str(edited(Job(CAR, "/nowhere/car.yaml", "car.yaml"), {"act": "fragment", "parts": parts, "places": places})[
        "clipboard"])
    pasted = _edit("model: other\n", "paste", clipboard=clipboard, x=5, y=7, places={})
    model = hb.loads(pasted)
    assert list(model.body.instances) == parts and [e.path for e in model.body.wires["body"].ends] == [
        "body.a", "body_weight.a", "spring.b"]
    assert min(place.x for place in model.body.layout.parts.values()) == 5
    assert "no parts of a diagram" in _refused(CAR, "paste", clipboard="hello", places=places)
    assert "no parts of a diagram" in _refused(CAR, "paste", clipboard="components: [1, 2]", places=places)
    assert "too large" in _refused(CAR, "paste", clipboard="components:" + "x" * 10**6, places=places)


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
