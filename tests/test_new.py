"""A new folder works as its README says: every command of it is typed."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from click.testing import CliRunner

import heavebond as hb
from heavebond.cli import main


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def call(*words: str) -> object:
    return CliRunner().invoke(main, list(words))


def commands(readme: Path) -> list[list[str]]:
    """What the README says is to be typed."""
    blocks = re.findall(r"^```sh\n(.*?)^```", readme.read_text(), re.MULTILINE | re.DOTALL)
    return [shlex.split(line) for block in blocks for line in block.splitlines()]


def typed(folder: Path, monkeypatch: pytest.MonkeyPatch, *, but: str) -> list[str]:
    """Type all commands of a README but those that take long; the names of those typed."""
    monkeypatch.chdir(folder)
    done = []
    for name, command, *words in commands(folder / "README.md"):
        assert name == "heavebond"
        if command != but:
            answer = call(command, *words)
            assert answer.exit_code == 0, (command, answer.output)
            done.append(command)
    return done


def test_a_new_folder_runs_at_once(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    answer = call("new", "rig")
    assert answer.exit_code == 0, answer.output
    for name in ("rig.yaml", "measured.yaml", "README.md", "data/monday.csv", "data/tuesday.csv", "data/hidden.yaml"):
        assert (folder / "rig" / name).is_file()
        assert f"wrote rig/{name}" in answer.stdout
        assert "NAME" not in (folder / "rig" / name).read_text()
    assert typed(folder / "rig", monkeypatch, but="diagnose") == ["check", "run", "compare", "fit"]
    assert {"rig.png", "compared.png"} < {path.name for path in (folder / "rig").iterdir()}


@pytest.mark.long
def test_what_is_hidden_matters_and_explains_the_records(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    call("new", "rig")
    monkeypatch.chdir("rig")
    for record in hb.compare("measured.yaml").records.values():
        assert all(channel.error > 10 * channel.noise for channel in record.channels.values())
    assert min(record.chi2 for record in hb.fit("measured.yaml").after.records.values()) > 100
    answer = call("try", "measured.yaml", "CoulombFriction", "--between", "deck", "load")
    assert answer.exit_code == 0, answer.output
    # the fitted force is the 25 N of data/hidden.yaml, and only noise is left
    assert 24.5 < float(re.search(r"coulomb_friction\.F_c +([\d.]+) N", answer.stdout)[1]) < 25.5
    assert re.search(r"\+ CoulombFriction between deck and load .* (0\.9\d*|1\.0\d*|1) +(0\.9\d*|1\.0\d*|1)$", answer.stdout,
                     re.MULTILINE), answer.stdout


@pytest.mark.slow
def test_the_diagnosis_as_the_readme_says_it(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    call("new", "rig")
    monkeypatch.chdir("rig")
    command, = (words for words in commands(Path("README.md")) if words[1] == "diagnose")
    answer = call(*command[1:])
    assert answer.exit_code == 0, answer.output
    assert "Missing: dry friction between deck and load" in answer.stdout
    assert 24 < hb.load("rig_2.yaml").body.instances["coulomb_friction"].settings["F_c"].expr.value < 26


def test_records_are_the_same_each_time(folder: Path) -> None:
    call("new", "rig")
    call("new", "other")
    assert (folder / "rig/data/monday.csv").read_text() == (folder / "other/data/monday.csv").read_text()
    assert (folder / "other" / "other.yaml").is_file()


@pytest.mark.long
def test_a_copy_of_a_machine(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    answer = call("new", "mine", "--from", "passive_rig")
    assert answer.exit_code == 0, answer.output
    assert not list(folder.rglob("truth.yaml"))
    assert typed(folder / "mine", monkeypatch, but="diagnose") == ["check", "run", "compare"]


@pytest.mark.parametrize("machine", ["cmc_ahc", "emps", "cascaded_tanks", "receiver_rig", "cylinder_rig"])
def test_every_machine_can_be_copied(folder: Path, machine: str) -> None:
    answer = call("new", "mine", "--from", machine)
    assert answer.exit_code == 0, answer.output
    said = commands(folder / "mine" / "README.md")
    assert [words[1] for words in said][:2] == ["check", "run"]
    for words in said:
        assert (folder / "mine" / words[2]).is_file()
    # the records of the positioning drive are not ours to give away
    assert any(words[1] == "compare" for words in said) == (machine not in ("cmc_ahc", "emps"))


@pytest.mark.parametrize(("words", "code", "said"), [
    (("there",), "folder-exists", "another name"), (("file.txt",), "name-bad", "heavebond new file_txt"),
    (("2 rigs",), "name-bad", "letters, digits"), (("no/where",), "file-unwritable", "no folder"),
    (("rig", "--from", "pasive_rig"), "machine-unknown", "Did you mean 'passive_rig'"), ((), "usage", "folder"),
])
def test_messages(folder: Path, words: tuple[str, ...], code: str, said: str) -> None:
    (folder / "there").mkdir()
    (folder / "there" / "a.txt").write_text("mine")
    answer = call("new", *words)
    assert answer.exit_code == 2
    assert f"[{code}]" in answer.stderr
    assert said in answer.stderr.lower() or said in answer.stderr
    assert sorted(p.name for p in folder.iterdir()) == ["there"]
