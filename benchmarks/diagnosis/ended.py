"""Diagnoses that end at random moments of each phase: the answer has the same form, and its files are written.

    python -m benchmarks.diagnosis.ended                 20 moments of each phase on three machines
    python -m benchmarks.diagnosis.ended 3 passive       3 moments of each phase on this machine

Time is counted in looks for a signal (`cancellation.check`), of which there is one before each run, each fifty samples of a
run and each evaluation of a function. So the moments and the answers do not depend on the speed of the computer.
"""

from __future__ import annotations

import random
import signal
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Any
from unittest.mock import patch

from click.testing import CliRunner

from heavebond.cli import main
from heavebond.core import cancellation
from heavebond.diagnosis import phases
from heavebond.diagnosis.diagnose import Diagnosis, diagnose

MACHINES = {"receiver": ("receiver_rig/choked", ("choked flow", "leakage")),
            "passive": ("passive_rig/friction", ("dry friction", "viscous damping")),
            "cylinder": ("cylinder_rig/leakage", ("internal leakage", "leakage"))}
DRIVER = "heavebond.diagnosis.diagnose"
FORM = ("verdict", "words", "probabilities", "steps", "ladder", "ranking", "noise")  # keys of every answer


class Looks(list[int]):
    """The list of signals that `cancellation` keeps: each look at it counts as a second, and SIGALRM comes in time."""

    def __init__(self) -> None:
        super().__init__()
        self.spent, self.timer = 0, 0.0

    def __bool__(self) -> bool:
        self.spent += 1
        if self.timer and self.spent >= self.timer:
            self.timer = 0.0
            handler = signal.getsignal(signal.SIGALRM)
            assert callable(handler)
            handler(signal.SIGALRM, None)
        return len(self) > 0

    def set_timer(self, seconds: float) -> float:
        """Set the timer to so many looks; the looks that were left of the former one."""
        left = max(self.timer - self.spent, 0.0) if self.timer else 0.0
        self.timer = self.spent + seconds if seconds else 0.0
        return left


@contextmanager
def counted_looks() -> Iterator[Looks]:
    """Within it, time is counted in looks."""
    looks = Looks()
    with patch.object(cancellation, "_heard", looks), patch.object(cancellation, "now", lambda: float(looks.spent)), \
            patch.object(cancellation, "set_timer", looks.set_timer):
        yield looks


@dataclass(frozen=True)
class Ended:
    """A diagnosis that was ended: the phase and the moment (looks), the looks it took, its answer, and its faults."""

    phase: str
    moment: int
    took: int
    answer: Diagnosis | None
    faults: tuple[str, ...]


def phase_times(experiment: str, classes: Sequence[str]) -> tuple[dict[str, tuple[int, int]], Diagnosis]:
    """The first and last look of each phase of a whole diagnosis, and its answer."""
    times: dict[str, tuple[int, int]] = {}
    with counted_looks() as looks:
        def timed(phase: Callable[..., Any]) -> Callable[..., Any]:
            def run(*arguments: Any) -> Iterator[Any]:
                began = looks.spent
                yield from phase(*arguments)
                times[phase.__name__] = began, looks.spent
            run.__name__ = phase.__name__
            return run

        known = {phase: timed(phase) for phase in phases.PHASES}
        with patch(f"{DRIVER}.PHASES", tuple(known.values())), \
                patch(f"{DRIVER}.FIRST", tuple(known[phase] for phase in phases.FIRST)), \
                patch(f"{DRIVER}.CLOSING", tuple(known[phase] for phase in phases.CLOSING)):
            whole = diagnose(experiment, number=1, seconds=inf, classes=classes)
    return times, whole


def ended(experiment: str, classes: Sequence[str], phase: str, moment: int) -> Ended:
    """The same diagnosis with a time limit at this look."""
    with counted_looks() as looks:
        try:
            answer = diagnose(experiment, number=1, seconds=float(moment), classes=classes)
        except Exception:  # every failure is a fault
            return Ended(phase, moment, looks.spent, None, (traceback.format_exc(limit=-4),))
        took = looks.spent
    found = answer.as_dict()
    faults = [f"no `{key}`" for key in FORM if key not in found]
    if not answer.words:
        faults.append("no words")
    if answer.findings and answer.verdict == "undetermined":
        faults.append("effects were found, but there is no conclusion")
    if moment > 100 and took > 1.5 * moment + 100:
        faults.append(f"took {took} of {moment}")
    return Ended(phase, moment, took, answer, tuple(faults))


def signalled(experiment: str, classes: Sequence[str], moment: int, folder: Path) -> tuple[int, bool]:
    """The exit code of the command with a time limit at this look, and whether the report was written."""
    with counted_looks():
        answer = CliRunner().invoke(main, ["diagnose", experiment, "--seconds", str(moment), "--processes", "1", "--folder",
                                           str(folder), *(word for name in classes for word in ("--only", name))])
    return answer.exit_code, any(folder.glob("*_report*.html"))


def run(machine: str, per_phase: int, commands: Collection[str] | None = None) -> list[Ended]:
    """Diagnoses ended at random moments of each phase; the last of each phase (in `commands`) also by the command."""
    experiment, classes = MACHINES[machine]
    times, _ = phase_times(experiment, classes)
    draws = random.Random(0)
    results = []
    for phase, (first, last) in times.items():
        for _ in range(per_phase):
            moment = draws.randint(first + 1, max(first + 1, last))
            results.append(ended(experiment, classes, phase, moment))
            print(machine, phase, moment, results[-1].answer and results[-1].answer.verdict, *results[-1].faults, flush=True)
        if commands is not None and phase not in commands:
            continue
        with tempfile.TemporaryDirectory() as folder:
            code, written = signalled(experiment, classes, moment, Path(folder))
            if code or not written:
                results.append(Ended(phase, moment, 0, None, (f"the command: exit {code}, report written: {written}",)))
                print(machine, *results[-1].faults, flush=True)
    return results


if __name__ == "__main__":
    number = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    everything = [e for machine in sys.argv[2:] or MACHINES for e in run(machine, number)]
    print(f"{len(everything)} ended; {sum(bool(e.faults) for e in everything)} with faults")
    print(dict(Counter((e.phase, e.answer.verdict if e.answer else "-") for e in everything)))
