"""YAML as text with places: nothing is guessed, nothing is followed, and every mistake has its line and column."""

from __future__ import annotations

import builtins
import io
import os
from contextlib import suppress
from pathlib import Path

import pytest
from collected import for_each
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import heavebond as hb
from heavebond.core.errors import HeavebondError, ModelError, Place, Problem, Problems, suggest
from heavebond.language.library import bundled, library
from heavebond.language.near_names import near_components
from heavebond.text.yaml_source import Mapping, Scalar, Sequence, parse, read

SLIDER = """\
model: slider
parameters: {c_0: 1.2 kN/m}
components:
  wall:   {is: Fixed}
  spring: {is: Spring, c: =c_0}
  cart:   {is: Mass, m: 2.5 kg}
nodes:
  ground: [wall.a, spring.a]
  load:   [spring.b, cart.a]
initial: {load.x: 50 mm}
show: {pull: {is: spring.F, unit: kN}}
simulate: {until: 4 s, every: 1 ms}
"""


def codes(text: str) -> list[tuple[str, int, int]]:
    """Code, line and column of what is wrong in a text."""
    with pytest.raises(ModelError) as caught:
        parse(text)
    return [(p.code, p.place.line, p.place.column) for p in caught.value.problems if p.place]


# -- what is read ----------------------------------------------------------------------------------------------------
@pytest.mark.long
def test_libyaml_reads_every_bundled_file_like_pyyaml() -> None:
    """Tree, texts and places: what the quick reader is used for."""
    files = [path for folder in ("components", "models") for path in sorted(bundled(folder).rglob("*.yaml"))]
    assert len(files) > 500
    for path in files:
        text = path.read_text(encoding="utf-8")
        assert parse(text, trusted=True) == parse(text), path


def test_every_value_is_text() -> None:
    root = parse("a: 1e6\non: yes\nno: 010\nb: 12:30\nc: 0x1F\nd: ~\ne: null\nf: 2001-01-01\ng: 1_000\nh: '5'\n").root
    assert {k: v.text for k, v in root.items.items() if isinstance(v, Scalar)} == {
        "a": "1e6", "on": "yes", "no": "010", "b": "12:30", "c": "0x1F", "d": "~", "e": "null", "f": "2001-01-01",
        "g": "1_000", "h": "5"}
    assert isinstance(root.items["h"], Scalar)
    assert root.items["h"].quoted


def test_words_that_other_readers_take_for_booleans_are_names() -> None:
    model = hb.loads(SLIDER.replace("load", "on").replace("ground", "no"))
    assert set(model.body.wires) == {"no", "on"}
    assert hb.loads(SLIDER.replace("2.5 kg", "1e3 kg")).body.instances["cart"].settings["m"].text == "1e3 kg"


def test_places_count_from_one() -> None:
    root = parse("model: x\nnodes:\n  ground: [wall.a,  'spring.a']\n").root
    assert (root.keys["nodes"].place.line, root.keys["nodes"].place.column) == (2, 1)
    nodes = root.items["nodes"]
    assert isinstance(nodes, Mapping)
    ends = nodes.items["ground"]
    assert isinstance(ends, Sequence)
    assert [(e.place.line, e.place.column, e.place.length) for e in ends.items] == [(3, 12, 6), (3, 21, 10)]


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_line_ends(end: str, tmp_path: Path) -> None:
    path = tmp_path / "slider.yaml"
    path.write_bytes(SLIDER.replace("2.5 kg", "2.5 N").replace("\n", end).encode("utf-8-sig"))
    with pytest.raises(ModelError) as caught:
        hb.assemble(hb.load(path))
    place = caught.value.problems[0].place
    assert place is not None
    assert (place.line, place.column, place.text) == (6, 25, "  cart:   {is: Mass, m: 2.5 N}")


def test_lines_of_a_block_have_their_own_places() -> None:
    item = parse("equations: |\n  a = b   # first\n\n    c = d\nnext: 1\n").root.items["equations"]
    assert isinstance(item, Scalar)
    assert [(line.text, line.place.line, line.place.column) for line in item.lines()] == \
        [("a = b   # first", 2, 3), ("c = d", 4, 5)]


@pytest.mark.parametrize("text", [
    "v: >-\n  =one\n  + two\nw: 1\n", "v: =one\n  + two\nw: 1\n", "v: '=one\n  + two'\nw: 1\n", "v: |\n  =one\n  + two\n"])
def test_place_in_a_text_of_several_lines(text: str) -> None:
    item = parse(text).root.items["v"]
    assert isinstance(item, Scalar)
    quoted = 1 if item.quoted else 0
    second = item.place.moved(item.text.index("two") + quoted, 3)
    assert (second.line, second.text[second.column - 1:second.column + 2]) == (
        next(k for k, line in enumerate(text.splitlines(), 1) if "two" in line), "two")
    first = item.place.moved(item.text.index("one") + quoted, 3)
    assert first.text[first.column - 1:first.column + 2] == "one"


# -- what is refused -------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("text", "found"), [
    ("a: 1\nb: 2\na: 3\n", [("duplicate-key", 3, 1)]),
    ("a: &x 1\nb: *x\n", [("yaml-anchor", 1, 4), ("yaml-alias", 2, 4)]),
    ("a: !!int 3\nb: !kg 2\n", [("yaml-tag", 1, 4), ("yaml-tag", 2, 4)]),
    ("a: &x !!int 3\n", [("yaml-anchor", 1, 4), ("yaml-tag", 1, 7)]),
    ("a:\nb: 1\n", [("key-without-value", 1, 1)]),
    ("{m: =max(a, b)}\n", [("key-without-value", 1, 5)]),
    ("{unit: 1, doc: the inner, outer, and mean diameter, min: 0}\n", [("key-without-value", 1, 16)]),
    ("{c: 1,2 kN/m}\n", [("decimal-comma", 1, 5)]),
    ("{is: Spring, c:1 kN/m}\n", [("key-without-value", 1, 14)]),
    ("a: 1\n---\nb: 2\n", [("two-documents", 2, 1)]),
    ("a:\n  b: 1\n\tc: 2\n", [("tab", 3, 1)]),
    ("a: {b: 1\nc: 2\n", [("not-yaml", 1, 4)]),
    ("a: 'b\nc: 2\n", [("not-yaml", 1, 4)]),
    ("a: b: c\n", [("not-yaml", 1, 5)]),
    ("a: 1\nb\nc: 2\n", [("not-yaml", 2, 1)]),
    ("a: @b\n", [("not-yaml", 1, 4)]),
    ('a: "\\q"\n', [("not-yaml", 1, 6)]),
    ("{[a]: 1}\n", [("key-not-text", 1, 2)]),
    ("- a\n- b\n", [("not-a-mapping", 1, 1)]),
    ("a: " + "[" * 10000, [("too-deep", 1, 63)]),
    ("a: " + "{b: " * 10000, [("too-deep", 1, 240)])])
def test_refused_form(text: str, found: list[tuple[str, int, int]]) -> None:
    assert codes(text) == found


@pytest.mark.parametrize("text", ["", "\n\n", "# nothing\n", "---\n", "''\n"])
def test_empty_files(text: str) -> None:
    with pytest.raises(ModelError, match=r"text is empty \[file-empty\]"):
        parse(text)


def test_key_integer_needs_no_value() -> None:
    root = parse("n: {integer, min: 1}\n").root.items["n"]
    assert isinstance(root, Mapping)
    assert root.bare == {"integer"}


@pytest.mark.parametrize(("content", "word"), [
    (b"\xff\xfem\x00", "UTF-16"), (b"\x00\xff", "plain text"), ("a: ü".encode("latin-1"), "UTF-8"), (b"a: \x07", "code 7")])
def test_what_is_no_text(content: bytes, word: str, tmp_path: Path) -> None:
    path = tmp_path / "x.yaml"
    path.write_bytes(content)
    with pytest.raises(ModelError) as caught:
        read(path)
    assert [p.code for p in caught.value.problems] == ["not-text"]
    assert word in caught.value.problems[0].message
    assert caught.value.problems[0].hint


def test_folders_and_missing_files(tmp_path: Path) -> None:
    for path, code in ((tmp_path, "file-is-folder"), (tmp_path / "x.yaml", "file-missing")):
        with pytest.raises(ModelError) as caught:
            read(path)
        assert caught.value.problems[0].code == code


def test_a_file_of_any_size_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("heavebond.text.yaml_source.FILE_BYTES", 100)
    (tmp_path / "x.yaml").write_text(SLIDER)
    with pytest.raises(ModelError, match="file-too-large"):
        read(tmp_path / "x.yaml")


# -- problems as data ------------------------------------------------------------------------------------------------
def test_excerpt_of_a_long_line_is_the_part_around_the_place() -> None:
    line = "x" * 500 + "HERE" + "y" * 500
    shown, caret = Place("f", 7, 501, line, 4).excerpt()
    assert len(shown) < 130
    assert shown[caret.index("^"):caret.rindex("^") + 1] == "HERE"
    assert shown.startswith("    7 | ...x")


def test_problems_come_in_the_order_of_the_lines_and_once() -> None:
    problems = Problems()
    for line in (9, 2, 5, 2):
        problems.add("code", f"in line {line}", Place("a.yaml", line), hint="do this")
    problems.add("code", "somewhere")
    with pytest.raises(ModelError) as caught:
        problems.raise_as(ModelError)
    assert [p.message for p in caught.value.problems] == ["in line 2", "in line 5", "in line 9", "somewhere"]


def test_problem_for_machines() -> None:
    problem = Problem("unit-missing", "'5' has no unit", Place("a.yaml", 3, 7, "m: 5"), "Write '5 kg'.", ("note",))
    assert problem.as_dict() == {"code": "unit-missing", "message": "'5' has no unit", "hint": "Write '5 kg'.",
                                 "place": {"file": "a.yaml", "line": 3, "column": 7}, "notes": ["note"]}


def test_suggestions() -> None:
    assert suggest("Sprng", ["Damper", "Spring"]) == "Did you mean 'Spring'?"
    assert suggest("MASS", ["Mass"]) == "Did you mean 'Mass'?"
    assert suggest("x" * 10_000, ["x" * 9_999]) == ""
    assert suggest("valve", ["spring"]) == ""
    assert suggest("K_p", ["wave.a", "controller.K_p", "k"]) == "Did you mean 'controller.K_p'?"
    assert suggest("lineA.p", ["lineB.a.p", "lineA.p_a", "lineA.a.p"]) == "Did you mean 'lineA.a.p'?"


@pytest.mark.parametrize(("name", "begin"), [
    ("HydraulicCylinder", "'Cylinder'?"), ("PIController", "'PID'"), ("Ground", "'Fixed'"), ("Gearbox", "'Gear'"),
    ("RotationalSpring", "'TorsionSpring'"), ("TorsionSprng", "'TorsionSpring'"), ("Limiter", "'Saturation'?"),
])
def test_components_are_found_by_what_they_are(name: str, begin: str) -> None:
    assert near_components(name, library().files).startswith(f"Did you mean {begin}")


# -- any text --------------------------------------------------------------------------------------------------------
PIECES = [
    "=", "(", ")", "{", "}", "[", "]", ":", ": ", ",", "#", "&x", "*x", "!t", "|", ">",
    "'", '"', "~", "-", "\n", "\n  ", "\t",
    "is", "0", "1e999", "nan", "time", "der(", "**", "^", "..", "kN/m", "m", "Hz", "rad/s", "%", "steady", "$U", "extends",
    "spring.c", "load.x", "ground", "Spring", "{is: Mass}", "[cart.a]", "repeat: 3", "file: x.csv", "\u2028", "ü", "\x85"]
ATTACKS = [
    "__import__('os').system('touch pwned')", "=open('pwned', 'w')", "!!python/object/apply:os.system [touch pwned]",
    "=().__class__.__base__.__subclasses__()", "${HOME}", "=exec('1')", "../../etc/passwd", "/etc/passwd", "*alias",
    "&anchor 1", "{file: /etc/passwd, column: a, unit: m, interpolation: spline}"]


@st.composite
def damaged(draw: st.DrawFn) -> str:
    """A diagram with a few slips of the pen: pieces put in, taken out, or moved."""
    text = SLIDER
    for _ in range(draw(st.integers(1, 4))):
        begin = draw(st.integers(0, len(text)))
        end = min(len(text), begin + draw(st.integers(0, 6)))
        text = text[:begin] + draw(st.sampled_from(PIECES) | st.just("")) + text[end:]
    return text


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(damaged() | st.text(max_size=200))
def test_any_diagram_is_assembled_or_explained(text: str) -> None:
    found: HeavebondError | None = None
    try:
        hb.assemble(hb.loads(text, Path(__file__).parent / "no_such_folder"))
    except HeavebondError as error:
        found = error
    assert found is None or all(p.code and p.message and str(p) for p in found.problems)


@for_each("attack", ATTACKS)
@for_each("line", range(len(SLIDER.splitlines())))
def test_nothing_read_is_executed_or_opened(attack: str, line: int) -> None:
    """A value of the diagram replaced by an attack: no process is started, and no file is opened for writing."""
    lines = SLIDER.splitlines()
    key, _, _ = lines[line].partition(":")
    lines[line] = f"{key}: {attack}"
    with pytest.MonkeyPatch.context() as patch:
        for name in ("system", "popen", "execv", "execve", "fork", "remove", "unlink", "posix_spawn"):
            if hasattr(os, name):
                patch.setattr(os, name, _forbidden)
        plain = io.open

        def watched(file: object, mode: str = "r", *args: object, **kwargs: object) -> object:
            assert set(mode) <= set("rbtU"), f"{file} was opened for writing"
            assert "passwd" not in str(file), "a file was opened that the diagram does not read"
            return plain(file, mode, *args, **kwargs)

        patch.setattr(builtins, "open", watched)
        patch.setattr(io, "open", watched)
        with suppress(HeavebondError):
            hb.assemble(hb.loads("\n".join(lines) + "\n", Path(__file__).parent / "no_such_folder"))
    assert not Path("pwned").exists()


def _forbidden(*args: object, **kwargs: object) -> None:
    raise AssertionError("reading a diagram has tried to act on the system")
