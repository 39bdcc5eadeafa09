"""Every message that a wrong diagram, component or parameter can meet, compared letter by letter.

`tests/wrong/NAME.yaml`, or `tests/wrong/NAME/NAME.yaml` where it takes more files, is a wrong input; what the program
says of it is `tests/wrong/NAME.txt`. To add one, write the input; to change messages, change the program; then run

    python -m pytest tests/test_wrong_models.py --update-golden

and read the diff of the `.txt` files as an engineer who does not know Python: is it in their words, and is it clear
what to type?
"""

from __future__ import annotations

import inspect
import pkgutil
import re
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from collected import for_each

import heavebond as hb
from heavebond.core.errors import HeavebondError
from heavebond.numerics.initialise import start
from heavebond.numerics.inputs import pieced
from heavebond.text.expression import constant

WRONG = Path(__file__).parent / "wrong"
WRITTEN = {path.stem: path for path in [*sorted(WRONG.glob("*.yaml")), *sorted(WRONG.glob("*/*.yaml"))]
           if path.parent == WRONG or path.stem == path.parent.name}
SLIDER = b"""model: slider
components:
  cart: {is: Mass, m: 2.5 kg}
nodes:
  load: [cart.a]
"""
# what no editor would show, or what would fill it
GENERATED = {
    "nested_brackets": b"model: " + b"[" * 10_000 + b"]" * 10_000 + b"\n",
    "nested_parentheses": b"model: deep\nparameters:\n  m: =" + b"(" * 10_000 + b"1" + b")" * 10_000 + b"\n",
    "long_sum": b"model: long\nparameters:\n  m: =" + b" + ".join([b"1"] * 2000) + b"\n",
    "long_line": SLIDER.replace(b"2.5 kg", b"2.5 kg, " + b" " * 200 + b"colour: 3 N"),
    "binary_file": bytes(range(256)) * 8,
    "unseen_character": SLIDER.replace(b"cart.a", b"cart\x01.a"),
    "latin_1": SLIDER.replace(b"slider", "Schlitten für 5 °C".encode("latin-1")),
    "utf_16": SLIDER.decode().encode("utf-16"),
    "a_folder": None,
}
CASES = [*WRITTEN, *GENERATED]
# the start and the records know no line of the diagram, an empty file has none, and a folder neither
WITHOUT_PLACE = {"closed_valve", "no_tank", "undetermined_start", "record_too_short", "empty_file", "binary_file",
                 "utf_16", "a_folder"}


def attempt(path: Path) -> None:
    """Everything that is checked before a run: the file, the diagram, its records, its start; for an experiment
    (`experiment_NAME`) what is checked before its records are compared."""
    if path.stem.startswith("experiment_"):
        hb.compare(path)
    assembly = hb.assemble(hb.load(path))
    u = None
    if assembly.flat.inputs:
        until = assembly.model.until
        end = constant(until.expr) if until is not None else None
        u = pieced(assembly.flat, 0.0, end or 1.0).at(np.zeros(1))[:, 0]
    start(assembly, 0.0, u)


@pytest.mark.long
@for_each("name", CASES, parts=4)
def test_message(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> None:
    """The message of each case, seen from the folder of its file: as stored; with code, place and advice; in words of the
    user."""
    path = WRITTEN.get(name, tmp_path / f"{name}.yaml")
    content = GENERATED.get(name)
    if content is not None:
        path.write_bytes(content)
    elif name == "a_folder":
        path.mkdir()
    monkeypatch.chdir(path.parent)
    before = sorted(path.parent.iterdir())
    with pytest.raises(HeavebondError) as caught:
        attempt(Path(path.name))
    assert sorted(path.parent.iterdir()) == before, "reading a wrong file has written something"
    error = caught.value
    golden = WRONG / f"{name}.txt"
    if request.config.getoption("--update-golden"):
        golden.write_text(f"{error}\n", encoding="utf-8")
    assert f"{error}\n" == golden.read_text(encoding="utf-8")
    assert error.problems
    for one in error.problems:
        assert re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", one.code)
        assert one.hint.strip(), f"no advice: {one}"
        if name not in WITHOUT_PLACE:
            assert one.place is not None
            assert 1 <= one.place.column <= len(one.place.text) + 1
            assert f"{one.place.file}:{one.place.line}: " in str(error)
    assert max(map(len, str(error).splitlines())) < 200
    said = str(error)
    for inside in ("Traceback", " object at 0x", "None", "casadi", "numpy", "<class", "Errno", *_class_names()):
        assert not re.search(rf"(?<!\w){re.escape(inside)}(?!\w)", said), inside
    for folder in (Path(hb.__file__).parents[1], tmp_path, Path.home()):
        assert str(folder) not in said


def _class_names() -> set[str]:
    """Classes of the program whose names are no ordinary words (`FlatEquation`)."""
    found: set[str] = set()
    for module in pkgutil.walk_packages(hb.__path__, "heavebond."):
        classes = inspect.getmembers(import_module(module.name), inspect.isclass)
        found |= {name for name, _ in classes if re.fullmatch(r"_?[A-Z][a-z]+([A-Z]\w*)+", name)}
    return found


def test_missing_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "slider.yaml").write_bytes(SLIDER)
    with pytest.raises(HeavebondError, match=r"(?s)^there is no model 'slidr.yaml' .*Did you mean 'slider.yaml'\?$"):
        hb.load("slidr.yaml")
    with pytest.raises(HeavebondError, match=r"(?s)^there is no model 'x.yaml' .*a bundled name: .*cmc_ahc"):
        hb.load("x.yaml")


def test_no_stored_message_is_left_over() -> None:
    assert {path.stem for path in WRONG.glob("**/*.txt")} == set(CASES)


def test_all_problems_of_a_stage_are_told_at_once() -> None:
    for name in ("five_mistakes", "five_parts"):
        assert (WRONG / f"{name}.txt").read_text(encoding="utf-8").count(f"{name}.yaml:") >= 4
    assert (WRONG / "five_mistakes.txt").read_text(encoding="utf-8").count("five_mistakes.yaml:") == 5
