"""The commands of the command line in the studio: forms, arguments that a page may give, runs, and the list of places."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from heavebond.cli import NAMES, main
from heavebond.core.errors import UsageError
from heavebond.core.writable import confined
from heavebond.language.library import bundled
from heavebond.studio.command_forms import COMMANDS, EXCLUDED, arguments, forms, run_command

CAR = (bundled("models") / "quarter_car" / "quarter_car.yaml").read_text(encoding="utf-8")
LINE = "heavebond.cli:main"
PAGE = Path(__file__).parents[1] / "docs" / "tutorials" / "studio.md"


@pytest.fixture
def car(tmp_path: Path) -> Path:
    path = tmp_path / "folder" / "car.yaml"
    path.parent.mkdir()
    path.write_text(CAR, encoding="utf-8")
    return path


def test_each_command_has_its_place_in_the_studio() -> None:
    """The page lists every command of the command line, and the forms are those that it names."""
    rows = dict(re.findall(r"^\| `(\w+)` \| (.+?) \|$", PAGE.read_text(encoding="utf-8"), re.MULTILINE))
    assert rows.keys() == set(NAMES)
    with_form = {name for names in COMMANDS.values() for name in names}
    assert {name for name, place in rows.items() if "*Analyses" in place} == with_form


def test_a_form_has_no_option_that_names_a_file_or_permits_execution() -> None:
    found = forms(LINE)
    options = {o["name"] for kind in found.values() for form in kind for o in form["options"]}
    assert {"settings", "inputs", "rtol", "solver"} <= options and not options & set(EXCLUDED)
    assert not [name for name in options if "allow" in name]
    assert {form["name"] for kind in found.values() for form in kind} == {n for names in COMMANDS.values() for n in names}
    for values in ({"output": "/etc/passwd"}, {"allow_fmu": True}, {"allow_native": True}, {"json": "a.json"},
                   {"nonsense": "1"}):
        with pytest.raises(UsageError, match="unknown"):
            arguments(main, "run", values)
    for name in ("studio", "new", "import", "demo", "nonsense"):
        with pytest.raises(UsageError, match="unknown"):
            arguments(main, name, {})
    # a value stays the value of its option
    assert arguments(main, "modes", {"at": "--output=/tmp/x", "steady": True, "settings": ["a=1", "", "b=2"]}) == [
        "--at=--output=/tmp/x", "--steady", "--set=a=1", "--set=b=2"]


def test_a_command_prints_what_it_prints_on_the_command_line(car: Path) -> None:
    with confined(car.parent):
        told = run_command(car, {"command_line": LINE, "command": "modes", "values": {"settings": ["damper.d=2 kN*s/m"]}},
                           car.parent)
    printed = CliRunner().invoke(main, ["modes", str(car), "--set", "damper.d=2 kN*s/m"]).output
    assert told["text"].split() == printed.split() and told["files"] == [] and "Hz" in printed
    assert told["command"] == "heavebond modes car.yaml '--set=damper.d=2 kN*s/m'"
    with pytest.raises(UsageError, match=r"nothing\.d"):
        run_command(car, {"command_line": LINE, "command": "modes", "values": {"settings": ["nothing.d=2 kN*s/m"]}},
                    car.parent)


def test_an_export_is_written_into_the_folder_and_a_picture_is_returned(car: Path) -> None:
    with confined(car.parent):
        told = run_command(car, {"command_line": LINE, "command": "export", "format": "c"}, car.parent)
        drawn = run_command(car, {"command_line": LINE, "command": "linear", "picture": True,
                                  "values": {"inputs": ["road.u"], "outputs": ["body.x"]}}, car.parent)
        with pytest.raises(UsageError, match="unknown"):
            run_command(car, {"command_line": LINE, "command": "export", "format": "../x.c"}, car.parent)
    assert told["files"] == ["car.c"] and (car.parent / "car.c").is_file()
    assert "<svg" in drawn["pictures"][0]["svg"] and str(car.parent) not in drawn["text"]
    assert sorted(p.name for p in car.parent.iterdir()) == ["car.c", "car.yaml"]
    assert sorted(p.name for p in car.parent.parent.iterdir()) == ["folder"]
