"""A diagnosis that is ended, however that is, goes on from the refits that it has kept."""

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
from heavebond.diagnosis import candidate_workers
from heavebond.diagnosis.kept_refits import digest_of
from heavebond.diagnosis.stage import fitted_base
from heavebond.estimation.experiment import load_experiment
from heavebond.language.library import bundled

COMMAND = ["diagnose", "receiver_rig/choked", "--only", "choked flow", "--only", "lag", "--only", "delay", "--json",
           "told.json"]
KEPT = Path("choked_refits.jsonl")
CHANGED = ("seconds", "files")  # what may differ between two runs of one search


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The answer of the whole search, for machines, and the number of its refits."""
    with pytest.MonkeyPatch.context() as here:
        here.chdir(tmp_path_factory.mktemp("undisturbed"))
        made = counted(here)
        answer = CliRunner().invoke(main, [*COMMAND, "--processes", "1"])
        assert answer.exit_code == 0 and not KEPT.exists(), answer.output
        return {**told(), "made": len(made)}


def told() -> dict[str, Any]:
    """What the command wrote, without what may differ."""
    found = json.loads(Path("told.json").read_text())
    return {key: value for key, value in found.items() if key not in CHANGED}


def counted(monkeypatch: pytest.MonkeyPatch, end_after: int = 0) -> list[str]:
    """The refits that are made; SIGINT comes in the one after so many."""
    made: list[str] = []

    def counting(name: str, plain: Callable[..., Any]) -> Callable[..., Any]:
        def called(*given: Any) -> Any:
            made.append(name)
            if len(made) == end_after + 1 and end_after:
                os.kill(os.getpid(), signal.SIGINT)
            return plain(*given)
        return called

    for name in ("begun", "followed", "polished"):
        monkeypatch.setattr(candidate_workers, name, counting(name, getattr(candidate_workers, name)))
    return made


def test_an_ended_search_goes_on_to_the_same_answer(tmp_path: Path, undisturbed: dict[str, Any],
                                                     monkeypatch: pytest.MonkeyPatch) -> None:
    """Each refit is made once; a line that was cut short by the end of the process is passed over."""
    monkeypatch.chdir(tmp_path)
    with monkeypatch.context() as first:
        made = counted(first, end_after=3)
        answer = CliRunner().invoke(main, [*COMMAND, "--processes", "1"])
    assert answer.exit_code == 0 and "with --resume goes on" in answer.output, answer.output
    assert told()["partial"] and len(made) == 4
    lines = [line for line in KEPT.read_text().splitlines() if line]
    assert len(lines) == 3
    KEPT.write_text("\n".join([*lines[:2], lines[2][:50]]))
    with monkeypatch.context() as second:
        made = counted(second)
        answer = CliRunner().invoke(main, [*COMMAND, "--processes", "1", "--resume"])
    assert answer.exit_code == 0 and not KEPT.exists(), answer.output
    assert {**told(), "made": len(made) + 2} == undisturbed


@pytest.mark.skipif(not hasattr(os, "fork"), reason="signals are sent by POSIX means")
def test_a_search_that_was_killed_goes_on(tmp_path: Path, undisturbed: dict[str, Any],
                                         monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    begun = subprocess.Popen([sys.executable, "-c", "from heavebond.cli import main; main()", *COMMAND, "--processes", "2"],
                             stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    for _ in range(6000):
        if begun.poll() is not None or (KEPT.exists() and KEPT.read_text().count("digest") > 3):
            break
        clock.sleep(0.02)
    begun.kill()
    assert begun.wait() == -signal.SIGKILL and not Path("told.json").exists()
    made = counted(monkeypatch)
    answer = CliRunner().invoke(main, [*COMMAND, "--processes", "1", "--resume"])
    assert answer.exit_code == 0 and {**told(), "made": undisturbed["made"]} == undisturbed, answer.output
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
