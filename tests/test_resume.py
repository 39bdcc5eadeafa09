"""A diagnosis that is ended, however that is, goes on from the scores and refits that it has kept."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time as clock
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from heavebond.cli import main
from heavebond.diagnosis.search import workers
from heavebond.diagnosis.search.step import fitted_base
from heavebond.diagnosis.search.workers import digest_of
from heavebond.estimation.experiment import load_experiment
from heavebond.language.library import bundled

COMMAND = ["diagnose", "receiver_rig/choked", "--only", "choked flow", "--only", "lag", "--only", "delay", "--json",
           "told.json"]
KEPT = Path("choked_refits.jsonl")
CHANGED = ("seconds", "files")  # what may differ between two runs of one search


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The answer of the whole search, for machines, and the number of its scores and refits."""
    with pytest.MonkeyPatch.context() as here:
        here.chdir(tmp_path_factory.mktemp("undisturbed"))
        made = counted(here)
        answer = CliRunner().invoke(main, [*COMMAND, "--processes", "1"])
        assert answer.exit_code == 0 and not KEPT.exists(), answer.output
        return {**told(), "made": len(made), "scored": len(made.scored)}


def told() -> dict[str, Any]:
    """What the command wrote, without what may differ."""
    found = json.loads(Path("told.json").read_text())
    return {key: value for key, value in found.items() if key not in CHANGED}


class Made(list[str]):
    """Refits that were made, and the candidates that were scored."""

    def __init__(self) -> None:
        super().__init__()
        self.scored: list[str] = []


def counted(monkeypatch: pytest.MonkeyPatch, end_after: int = 0) -> Made:
    """What is made; SIGINT comes in the refit after so many."""
    made = Made()

    def counting(name: str, plain: Callable[..., Any], where: list[str]) -> Callable[..., Any]:
        def called(*given: Any) -> Any:
            where.append(name)
            if len(made) == end_after + 1 and end_after:
                os.kill(os.getpid(), signal.SIGINT)
            return plain(*given)
        return called

    for name, where in (("begun", made), ("followed", made), ("polished", made), ("scored", made.scored)):
        monkeypatch.setattr(workers, name, counting(name, getattr(workers, name), where))
    return made


def refits() -> list[str]:
    """The lines of the file."""
    return [line for line in KEPT.read_text().splitlines() if line]


@pytest.mark.long
def test_an_ended_search_goes_on_to_the_same_answer(tmp_path: Path, undisturbed: dict[str, Any],
                                                     monkeypatch: pytest.MonkeyPatch) -> None:
    """All is refitted once; a line that was cut short by the end of the process is passed over."""
    monkeypatch.chdir(tmp_path)
    with monkeypatch.context() as first:
        made = counted(first, end_after=3)
        answer = CliRunner().invoke(main, [*COMMAND, "--processes", "1"])
    assert answer.exit_code == 0 and "with --resume continues" in answer.output, answer.output
    assert told()["partial"] and len(made) == 4
    lines = KEPT.read_text().splitlines()
    assert len(refits()) == 3 and lines[-1] == refits()[-1]
    KEPT.write_text("\n".join([*lines[:-1], lines[-1][:50]]))
    with monkeypatch.context() as second:
        made = counted(second)
        answer = CliRunner().invoke(main, [*COMMAND, "--processes", "1", "--resume"])
    assert answer.exit_code == 0 and not KEPT.exists(), answer.output
    assert {**told(), "made": len(made) + 2, "scored": len(made.scored)} == undisturbed


@pytest.mark.long
@pytest.mark.skipif(not hasattr(os, "fork"), reason="signals are sent by POSIX means")
def test_a_search_that_was_killed_goes_on(tmp_path: Path, undisturbed: dict[str, Any],
                                         monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    begun = subprocess.Popen([sys.executable, "-c", "from heavebond.cli import main; main()", *COMMAND, "--processes", "2"],
                             stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    for _ in range(6000):
        if begun.poll() is not None or (KEPT.exists() and len(refits()) > 3):
            break
        clock.sleep(0.02)
    begun.kill()
    assert begun.wait() == -signal.SIGKILL and not Path("told.json").exists()
    made = counted(monkeypatch)
    answer = CliRunner().invoke(main, [*COMMAND, "--processes", "1", "--resume"])
    again = {"made": undisturbed["made"], "scored": len(made.scored)}
    assert answer.exit_code == 0 and {**told(), **again} == undisturbed, answer.output
    assert len(made) <= undisturbed["made"] - 4


def test_what_was_kept_is_of_the_same_records(tmp_path: Path) -> None:
    """One sample of a record that is held out is another search."""
    shutil.copytree(bundled("models") / "receiver_rig", tmp_path / "rig")
    before = digest_of(fitted_base(load_experiment(tmp_path / "rig" / "choked.yaml")))
    assert digest_of(fitted_base(load_experiment(tmp_path / "rig" / "choked.yaml"))) == before
    held_out = next(r for r in load_experiment(tmp_path / "rig" / "choked.yaml").records.values() if r.use != "fit")
    lines = held_out.file.read_text().splitlines()
    held_out.file.write_text("\n".join([*lines[:-1], f"{lines[-1].rpartition(',')[0]},437500"]))
    assert digest_of(fitted_base(load_experiment(tmp_path / "rig" / "choked.yaml"))) != before
