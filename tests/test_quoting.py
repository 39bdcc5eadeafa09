"""Text from files inside other languages: any text in, one token, one comment, one attribute out."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from heavebond.core.quoting import c_comment, file_stem, script_json, visible, xml
from heavebond.exchange.c_code import c_text
from heavebond.exchange.fmu_export import description
from heavebond.exchange.portable import portable
from heavebond.language.model import loads

# texts made of what could end or translate something, beside any other character
SHARP = st.text(st.one_of(st.sampled_from('*/\\?=\n\r"\'<>&]-!{}%$#\x1b\x00\u202e\u2028\ud800\ufffe '), st.characters()),
                max_size=40)
TRIGRAPHS = {"=": "#", "/": "\\", "'": "^", "(": "[", ")": "]", "!": "|", "<": "{", ">": "}", "-": "~"}


def translated(source: str) -> str:
    """The first two phases of C: trigraphs, then lines joined at a backslash (blanks behind it allowed, as gcc does)."""
    source = re.sub(r"\?\?([=/'()!<>-])", lambda found: TRIGRAPHS[found.group(1)], source)
    return re.sub(r"\\[ \t\v\f]*(\r\n|\n|\r)", "", source)


def comment_ends(source: str) -> int:
    """Where the comment that begins the source ends."""
    source = translated(source)
    assert source.startswith("/*")
    return len(source) - source.index("*/", 2) - 2


@pytest.mark.long
@given(SHARP, SHARP)
@settings(max_examples=500, deadline=None)
def test_no_text_ends_a_comment_of_c(first, second):
    comment = f"/* {c_comment(first)}\n   {c_comment(second)} */"
    assert comment_ends(comment) == 0
    assert comment.count("\n") == 1
    assert "/*" not in comment[2:]


def named(name: str, doc: str = "a place") -> str:
    shown = json.dumps(name)
    return f"model: {shown}\nsummary: {json.dumps(doc)}\ncomponents: {{load: {{is: Mass, m: 1 kg}}}}\n" \
           f"nodes: {{load: [load.a]}}\ninitial: {{load.x: 1 m}}\n" \
           f"show: {{{shown}: {{is: load.v, unit: m/s}}}}\nsimulate: {{until: 1 s}}\n"


@pytest.mark.parametrize("name", ["load *\\", "a ??/", "a */ int evil; /*", "*\\ \t", "*", "\\", "/",
                                  "??/ ", "a\x1bb"])
def test_a_name_of_the_diagram_adds_nothing_to_the_exported_c(name, tmp_path):
    """Behind `*\\` at a line's end, or a trigraph, what followed the comment was compiled."""
    made = portable(loads(named(name)), (), "m_")
    text = c_text(made, "m")
    plain = c_text(portable(loads(named("plain")), (), "m_"), "m")
    assert translated(text)[-comment_ends(text):] == translated(plain)[-comment_ends(plain):]
    if compiler := shutil.which("gcc"):
        def preprocessed(source: str) -> bytes:
            return subprocess.run([compiler, "-std=c99", "-trigraphs", "-E", "-P", "-"], input=source.encode(), check=True,
                                  capture_output=True).stdout
        assert preprocessed(text[:-comment_ends(text)]).strip() == b""


@pytest.mark.parametrize("name", ["a\x1bb", "<&>\"'", "]]>", "\u202e", "a\nb"])
def test_the_description_of_an_fmu_is_xml_whatever_the_names(name):
    made = portable(loads(named(name, doc=name)), (), "model_")
    root = ElementTree.fromstring(description(made, "m", "{0}"))
    assert root.tag == "fmiModelDescription"


@given(SHARP)
@settings(max_examples=300, deadline=None)
def test_no_text_leaves_its_element_or_attribute(text):
    root = ElementTree.fromstring(f'<svg title="{xml(text)}"><text>{xml(text)}</text></svg>')
    assert [child.tag for child in root.iter()] == ["svg", "text"]
    assert list(root.attrib) == ["title"]


@given(SHARP)
@settings(max_examples=300, deadline=None)
def test_no_text_ends_a_script(text):
    seen = []

    class Reader(HTMLParser):
        def handle_starttag(self, tag, attrs):
            seen.append(tag)

    reader = Reader()
    reader.feed(f'<script type="application/json">{script_json([text])}</script><p></p>')
    assert seen == ["script", "p"]
    assert len(json.loads(script_json([text]))) == 1


@given(SHARP)
@settings(max_examples=300, deadline=None)
def test_no_text_steers_the_terminal(text):
    shown = visible(text)
    assert not re.search("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2028\u2029\u2066-\u2069\ud800-\udfff]",
                         shown)
    assert visible(shown) == shown


@given(SHARP)
@settings(max_examples=300, deadline=None)
def test_any_text_is_a_file_name_in_the_same_folder(text):
    stem = file_stem(text)
    path = Path("folder") / f"{stem}.yaml"
    assert path.parent == Path("folder")
    assert path.with_name(f"{stem}.csv").parent == Path("folder")
    assert not re.search(r'[\\/:*?"<>|\x00-\x1f]', stem)
    assert stem.partition(".")[0].lower() not in ("con", "nul", "")


def test_control_characters_of_a_name_do_not_reach_the_terminal(tmp_path, capfd):
    from heavebond.cli import main

    path = tmp_path / "rig.yaml"
    path.write_text(named("evil \x1b]0;title\x07 \x1b[2J name"))
    with pytest.raises(SystemExit) as ended:
        main(["run", str(path)])
    told = capfd.readouterr()
    assert ended.value.code == 0
    assert "\x1b" not in told.out + told.err
    assert "\\x1b[2J" in told.out
    with pytest.raises(SystemExit):
        main(["run", str(path), "--plot", "no\x1b[2Jthing"])
    told = capfd.readouterr()
    assert "\x1b" not in told.out + told.err


def test_a_model_named_like_a_path_is_changed_in_memory():
    from heavebond.language.edits import Change

    model = loads(named('rig 1/2: "a" #'))
    changed = Change(settings={"load.m": "2 kg"}).on_model(model)
    assert changed.name == model.name
    assert changed.path.parent == model.path.parent


@pytest.mark.parametrize("name", ["- a", "* b", "a\x1bb", "? c", "a: b", "#", "-", ".", "& x"])
def test_a_name_stays_what_it_is_in_a_written_diagram(name):
    from heavebond.language.edits import Change

    assert Change().on_model(loads(named("plain")), name=name).name == name


def test_more_output_points_than_any_machine_holds_are_refused():
    import heavebond as hb
    from heavebond.core.errors import UsageError

    for until, every, said in (("1e300 s", "1e-15 s", "too large a number"), ("1e90 s", "1e-15 s", "the most is 10000000"),
                               (1e300, 1e-15, "the most is 10000000"), ("1e5 s", "1e-15 s", "the most is 10000000")):
        with pytest.raises(UsageError, match=said):
            hb.simulate(loads(named("plain")), until=until, every=every)


@pytest.mark.own_fault
@pytest.mark.parametrize(("fault", "code"), [(ZeroDivisionError("x\x1b[2J"), 70), (RecursionError("deep"), 70),
                                             (MemoryError(), 1), (KeyError("k"), 70)])  # memory is the machine's
def test_a_fault_of_the_program_is_one_message_and_a_file(fault, code, tmp_path, monkeypatch, capfd):
    from heavebond.cli import main

    def fail(*_, **__):
        raise fault

    monkeypatch.setattr("heavebond.numerics.simulation.simulate", fail)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    path = tmp_path / "rig.yaml"
    path.write_text(named("plain"))
    with pytest.raises(SystemExit) as ended:
        main(["run", str(path)])
    told = capfd.readouterr().err
    assert ended.value.code == code
    assert "Traceback" not in told
    assert "\x1b" not in told
    trace = next(tmp_path.glob("heavebond-fault-*.txt"))
    assert trace.name in told
    assert type(fault).__name__ in trace.read_text()
    assert "Traceback" in trace.read_text()
