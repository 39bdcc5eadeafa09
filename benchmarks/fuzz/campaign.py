"""Diagrams judged by a process of its own, which is ended where one takes too long; faults made smaller."""

from __future__ import annotations

import multiprocessing as mp
from collections.abc import Callable
from multiprocessing.connection import Connection

from benchmarks.fuzz.diagrams import Diagram
from benchmarks.fuzz.judging import Verdict, judge

RENEW = 500  # diagrams after which a worker is renewed: CasADi keeps what it compiled


def _serve(pipe: Connection) -> None:
    while (task := pipe.recv()) is not None:
        pipe.send(judge(*task))


class Judge:
    """A process that judges one diagram after the other, each within `limit` seconds."""

    def __init__(self, limit: float, first: float = 20.0):
        """`first`: seconds more for the first diagram of a process, which imports everything."""
        self.limit, self.first, self.done = limit, first, 0
        self._begin()

    def _begin(self) -> None:
        context = mp.get_context("spawn")
        self.pipe, other = context.Pipe()
        self.process = context.Process(target=_serve, args=(other,), daemon=True)
        self.process.start()
        self.done = 0

    def __call__(self, seed: int, text: str) -> Verdict:
        """The verdict; a process that dies is a traceback, one that is late a hang."""
        if self.done >= RENEW:
            self.close()
            self._begin()
        self.done += 1
        self.pipe.send((seed, text))
        patience = self.limit + (self.first if self.done == 1 else 0)
        try:
            if self.pipe.poll(patience):
                found: Verdict = self.pipe.recv()
                return found
            fault, what = "hang", f"more than {self.limit:g} s"
        except EOFError:
            fault, what = "traceback", "the process died"
        self.process.kill()
        self.process.join()
        self._begin()
        return Verdict(seed, fault, what, self.limit)

    def close(self) -> None:
        """End the process."""
        self.pipe.send(None)
        self.process.join(10)


def smallest(judged: Callable[[int, str], Verdict], given: Diagram, outcome: str) -> Diagram:
    """The diagram without the parts that the fault does not need, taken out one after the other."""
    again = True
    while again:
        again = False
        for part in given.parts:
            fewer = given.without_part(part.name)
            if fewer.parts and judged(given.seed, fewer.text()).outcome == outcome:
                given, again = fewer, True
                break
    return given
