"""Changes of a text: what is read afterwards is the tree with the one change, and only the lines meant are others."""

from __future__ import annotations

import difflib
from pathlib import Path

import pytest
from collected import partly
from hypothesis import given, settings
from hypothesis import strategies as st

from heavebond.core.errors import UsageError
from heavebond.language.library import bundled
from heavebond.text.yaml_edits import add_item, delete_entry, rename_key, replace_scalars, set_entry, tree
from heavebond.text.yaml_source import Mapping, Scalar, Sequence, parse, read

DIAGRAMS = [p for p in sorted(bundled("models").glob("*/*.yaml")) if p.parent.name != "examples"
            and isinstance(read(p, bundled=True).root.items.get("components"), Mapping)]


def _changed(before: str, after: str) -> tuple[list[str], list[str]]:
    """The lines that went and those that came."""
    lines = list(difflib.ndiff(before.splitlines(), after.splitlines()))
    return [x[2:] for x in lines if x[0] == "-"], [x[2:] for x in lines if x[0] == "+"]


@pytest.mark.parametrize("path", partly(DIAGRAMS, 4), ids=lambda p: p.stem)
def test_each_value_of_a_bundled_part_can_be_set(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    root = parse(text).root
    parts = root.items.get("components")
    assert isinstance(parts, Mapping)
    for name, part in list(parts.items.items())[:4]:
        if not isinstance(part, Mapping):
            continue
        for key, value in part.items.items():
            if key != "is" and isinstance(value, Scalar) and not value.block:
                went, came = _changed(text, set_entry(text, ("components", name, key), "1.25 kN/m"))
                assert len(went) == len(came) == 1 and "1.25 kN/m" in came[0], (name, key)
        went, came = _changed(text, set_entry(text, ("components", name, "fresh"), "7 mm"))
        assert len(went) <= 1 and len(came) == 1 and "fresh: 7 mm" in came[0]
    went, came = _changed(text, set_entry(text, ("set", "a.b.c"), "3 bar"))
    assert len(went) <= 1 and len(came) <= 2


@pytest.mark.parametrize(("before", "keys", "value", "after"), [
    ("a: 1  # one\nb: 2\n", ("a",), "5 m", "a: 5 m  # one\nb: 2\n"),
    ("a: 'x'\n", ("a",), "5 m", "a: 5 m\n"),
    ("m: {a: 1,   b: 2 }  # c\n", ("m", "c"), "3", "m: {a: 1,   b: 2, c: 3 }  # c\n"),
    ("m: {a: 1,  # one\n    b: 2   # two\n   }\n", ("m", "c"), "3", "m: {a: 1,  # one\n    b: 2, c: 3   # two\n   }\n"),
    ("m: {}\n", ("m", "c"), "3", "m: {c: 3}\n"),
    ("m:\n    a: 1  # one\n    # end\nn: 2\n", ("m", "b"), "3", "m:\n    a: 1  # one\n    b: 3\n    # end\nn: 2\n"),
    ("a: 1", ("set", "x.y"), "3 bar", "a: 1\nset:\n  x.y: 3 bar"),
    ("a: >-\n  5\n  m\n\nb: 2\n", ("a",), "6 m", "a: 6 m\n\nb: 2\n"),
    ("a:\n  b: |\n    =1\n", ("a", "b"), "6 m", "a:\n  b: 6 m\n"),
    ("t: |\n  text\n  more\n", ("b",), "2", "t: |\n  text\n  more\nb: 2\n"),
    ("a: 1\n", ("b",), "=max(1, 2)", 'a: 1\nb: "=max(1, 2)"\n'),
    ("a: 1\n", ("b", "c", "d"), "2", "a: 1\nb:\n  c: {d: 2}\n")])
def test_an_entry_is_set_in_the_style_around_it(before: str, keys: tuple[str, ...], value: str, after: str) -> None:
    assert set_entry(before, keys, value) == after


def test_what_is_no_mapping_is_not_replaced() -> None:
    for text in ("a: 1\n", "a: [1, 2]\n"):
        with pytest.raises(UsageError):
            set_entry(text, ("a", "b"), "2")


KEYS = st.sampled_from(["a", "b", "c", "d.e", "f_1"])
VALUES = st.sampled_from(["1", "2 kN/m", "=x*3", "[1, 2]", "it's", "a: b", "#", "-", "'q'", "1,5", "~ 3 bar", "{x", "\"",
                          "ü", "yes"])
GAPS = st.sampled_from(["", "  # why", "   "])


@st.composite
def documents(draw: st.DrawFn) -> str:
    """Mappings in both styles with comments and blank lines between their entries."""
    lines = ["top: 0"]
    for name in draw(st.lists(KEYS, unique=True, min_size=1)):
        inner = draw(st.lists(KEYS, unique=True, min_size=1))
        values = [draw(st.sampled_from(["1", "2 kN/m", "'q, r'", "[1, 2]", '"x: y"'])) for _ in inner]
        entries = [f"{k}: {v}" for k, v in zip(inner, values, strict=True)]
        if draw(st.booleans()):
            lines.append(f"{name}: {{{', '.join(entries)}}}{draw(GAPS)}")
        else:
            lines += [f"{name}:{draw(GAPS)}", *(f"  {entry}{draw(GAPS)}" for entry in entries)]
        lines += draw(st.lists(st.sampled_from(["", "# a comment", "  # an indented one"]), max_size=2))
    return "\n".join(lines) + draw(st.sampled_from(["\n", "", "\n\n"]))


@settings(max_examples=150, deadline=None)
@given(documents(), KEYS, KEYS, VALUES)
def test_reading_a_changed_text_gives_the_changed_tree(text: str, outer: str, inner: str, value: str) -> None:
    before = tree(parse(text).root)
    changed = set_entry(text, (outer, inner), value)
    assert isinstance(before, dict)
    old = before.get(outer, {})
    assert isinstance(old, dict)
    assert tree(parse(changed).root) == {**before, outer: {**old, inner: value}}
    went, came = _changed(text, changed)
    assert len(went) <= 1 and len(came) <= 2


def _entries(text: str) -> list[tuple[str | int, ...]]:
    """The paths of the inner entries and of the items of their lists."""
    found: list[tuple[str | int, ...]] = []
    for outer, inner in parse(text).root.items.items():
        for name, value in inner.items.items() if isinstance(inner, Mapping) else ():
            found.append((outer, name))
            found += [(outer, name, k) for k in range(len(value.items))] if isinstance(value, Sequence) else []
    return found


@settings(max_examples=150, deadline=None)
@given(documents(), st.data())
def test_deleting_leaves_all_other_lines_as_they_are(text: str, data: st.DataObject) -> None:
    keys = data.draw(st.sampled_from(_entries(text)))
    changed = delete_entry(text, keys)
    end = "" if text.endswith("\n") else "\n"  # a text whose last line has no end keeps that form
    went, came = _changed(text + end, changed + end)
    assert len(came) <= 1 and len(went) <= 2  # the entry, and the head of a mapping that is empty then
    assert all(line.split("#")[0].strip() for line in went)  # no blank line, no comment on a line of its own
    kept = _entries(changed) if "," in changed or ":" in changed else []
    gone = {entry for entry in _entries(text) if entry[:2] == keys[:2]}
    assert {entry for entry in _entries(text) if entry[:2] != keys[:2]} == set(kept) - gone
    if len(keys) == 2:
        assert keys not in kept


@settings(max_examples=100, deadline=None)
@given(documents(), st.data())
def test_renaming_there_and_back_gives_the_same_bytes(text: str, data: st.DataObject) -> None:
    outer, name = data.draw(st.sampled_from(_entries(text)))[:2]
    changed = rename_key(text, (outer, name), "fresh")
    went, came = _changed(text, changed)
    assert len(went) == len(came) == 1
    assert rename_key(changed, (outer, "fresh"), str(name)) == text


@pytest.mark.parametrize(("before", "keys", "after"), [
    ("m:\n  a: 1\n  # about b\n  b: 2  # two\nn: 3\n", ("m", "b"), "m:\n  a: 1\n  # about b\nn: 3\n"),
    ("m:\n  a: 1\nn: 3", ("n",), "m:\n  a: 1"),
    ("n: 3\nm:\n  a: 1\n", ("m", "a"), "n: 3\n"),
    ("m: {a: 1, b: 2, c: 3}\n", ("m", "b"), "m: {a: 1, c: 3}\n"),
    ("m: {a: 1, b: 2 }  # c\n", ("m", "b"), "m: {a: 1 }  # c\n"),
    ("m: {a: 1,  # one\n    b: 2,  # two, b\n    c: 3}\n", ("m", "b"), "m: {a: 1,  # one\n     # two, b\n    c: 3}\n"),
    ("m: {a: 1,  # one\n    b: 2}\n", ("m", "b"), "m: {a: 1  # one\n}\n"),
    ("m: {a: 1,\n    b: 2}   # c\n", ("m", "a"), "m: {b: 2}   # c\n"),
    ("m: {\n    a: 1,\n    b: 2}\n", ("m", "a"), "m: {\n    b: 2}\n"),
    ("m: {a: 1,  # one\n    b: 2}\n", ("m", "a"), "m: { # one\n    b: 2}\n"),
    ("m: [x.a, y.b, z.c]\n", ("m", 0), "m: [y.b, z.c]\n"),
    ("m:\n  - x.a\n  - y.b  # why\nn: 1\n", ("m", 1), "m:\n  - x.a\nn: 1\n"),
    ("t: |\n  text\n\n  more\nb: 2\n", ("t",), "b: 2\n")])
def test_an_entry_is_deleted_with_its_line_and_nothing_else(before: str, keys: tuple[str | int, ...], after: str) -> None:
    assert delete_entry(before, keys) == after


@pytest.mark.parametrize(("before", "item", "after"), [
    ("m: [a.x,  b.y ]  # c\n", "d.z", "m: [a.x,  b.y, d.z ]  # c\n"),
    ("m:\n  - a.x\n  - b.y  # why\nn: 1\n", "d.z", "m:\n  - a.x\n  - b.y  # why\n  - d.z\nn: 1\n"),
    ("n: 1\n", "d.z", "n: 1\nm: [d.z]\n"), ("m: []\n", "d.z", "m: [d.z]\n")])
def test_an_item_follows_the_last_one(before: str, item: str, after: str) -> None:
    assert add_item(before, ("m",), item) == after


def test_new_entries_keep_the_column_of_their_neighbours() -> None:
    text = "components:\n  wall:   {is: Fixed}  # left\n  spring: {is: Spring}\n"
    changed = set_entry(text, ("components", "load"), {"is": "Mass", "m": "2 kg", "at": ["1", "0.5"]}, after="wall")
    assert changed == text.replace("  spring", "  load:   {is: Mass, m: 2 kg, at: [1, 0.5]}\n  spring")


def test_scalars_are_replaced_where_they_stand() -> None:
    text = "a.x: 'a.y'  # a.z\nb: [a.x, {a.q: \"=2*a.y\"}]\n"
    assert replace_scalars(text, lambda path, raw: raw.replace("a.", "c.")) == \
        "c.x: 'c.y'  # a.z\nb: [c.x, {c.q: \"=2*c.y\"}]\n"


def test_what_is_not_there_is_not_deleted_or_renamed() -> None:
    for keys in (("b",), ("a", "b"), ("m", 2), ("m", "x")):
        with pytest.raises(UsageError):
            delete_entry("a: 1\nm: [1, 2]\n", keys)
    with pytest.raises(UsageError):
        rename_key("m: {a: 1, b: 2}\n", ("m", "a"), "b")
