"""Progress of long commands where standard error is no terminal."""

from __future__ import annotations

import re
import subprocess
import sys
import time as clock
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from heavebond.cli import main
from heavebond.commands import terminal
from heavebond.commands.progress_lines import ProgressLines
from heavebond.core.progress import duration

SLOW = """
import time
from heavebond.commands.terminal import working
began = time.monotonic()
with working("searching") as progress:
    for k in range(1, 9):
        progress(f"refitting {k} of 8: leaves {9 - k}")
        time.sleep(0.3)
print(time.monotonic() - began)
"""


@pytest.mark.long
def test_a_line_every_few_seconds_without_a_terminal() -> None:
    done = subprocess.run([sys.executable, "-c", SLOW], capture_output=True, text=True, check=True, timeout=60,
                          env={"PATH": "", "HEAVEBOND_PROGRESS": "0.5"})
    lines = done.stderr.splitlines()
    assert 3 <= len(lines) <= float(done.stdout) / 0.5  # (2.4 s, longer on a busy machine)
    assert all(re.match(r"searching, \d+ s: refitting \d of 8: leaves \d", line) for line in lines)
    assert any(re.search(r"; about \d+ s left for these 8$", line) for line in lines)


def test_no_line_of_a_command_that_ends_soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("HEAVEBOND_PROGRESS")
    answer = CliRunner().invoke(main, ["library", "Spring"])
    assert (answer.exit_code, answer.stderr) == (0, "")


def test_the_time_counts_from_the_beginning_of_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also outside of what shows its progress, as while a file is read."""
    monkeypatch.setenv("HEAVEBOND_PROGRESS", "0.2")

    def until(words: str) -> None:
        """Wait for a line, however busy the machine is."""
        end = clock.monotonic() + 60
        while words not in sys.stderr.buffer.getvalue().decode() and clock.monotonic() < end:
            clock.sleep(0.02)

    @click.command("slow")
    def slow() -> None:
        until("slow, ")
        clock.sleep(1.2)
        with terminal.working("fitting") as progress:
            progress("chi-square per sample 3 after 2 runs")
            until("after 2 runs")

    monkeypatch.setitem(main.commands, "slow", slow)
    lines = CliRunner().invoke(main, ["slow"]).stderr.splitlines()
    assert re.match(r"slow, \d+ s$", lines[0])
    told = [re.fullmatch(r"fitting, (\d+) s: chi-square per sample 3 after 2 runs", line) for line in lines]
    assert [found for found in told if found is not None and int(found[1]) >= 1]


def test_the_remaining_time_of_a_stage() -> None:
    lines = ProgressLines("diagnosing", 0.0)
    lines.tell("step 1: scoring 40 of 40: a spring", 3.0)
    assert lines.line(4.0) == "diagnosing, 4 s: step 1: scoring 40 of 40: a spring"
    lines.tell("step 1: refitting 1 of 24: friction leaves 2.5", 10.0)
    assert lines.left(12.0) is None
    lines.tell("step 1: refitting 5 of 24: play leaves 1.5", 50.0)
    assert lines.line(60.0).endswith("play leaves 1.5; about 3 min 00 s left for these 24")
    lines.tell("comparing the best closely", 70.0)
    assert lines.line(71.0) == "diagnosing, 1 min 11 s: comparing the best closely"
    lines.tell("3 of 9 done, 2 min left", 80.0)
    lines.tell("4 of 9 done, 2 min left", 90.0)
    assert lines.line(91.0) == "diagnosing, 1 min 31 s: 4 of 9 done, 2 min left"
    assert [duration(s) for s in (4.4, 65, 7800)] == ["4 s", "1 min 05 s", "2 h 10 min"]


@pytest.mark.long
def test_a_diagnosis_in_a_log_file(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", "from heavebond.cli import main; main()", "diagnose", "receiver_rig/choked", "--only",
         "choked flow", "--folder", str(tmp_path)], capture_output=True, text=True, timeout=300, cwd=tmp_path,
        env={"PATH": "", "HEAVEBOND_PROGRESS": "0.1", "HOME": str(tmp_path)})
    assert done.returncode == 0, done.stderr
    lines = done.stderr.splitlines()
    assert all(re.match(r"(diagnos(e|ing)|localising the misfit), \d+ ", line) for line in lines)
    assert any("scoring " in line or "refitting " in line for line in lines)
