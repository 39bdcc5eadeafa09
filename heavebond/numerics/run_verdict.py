"""Findings about a run, the verdict, and its report to the caller of the run.

A function that runs a diagram for a user ends with `report_verdict`. In Python it gives a warning (RunWarning) unless the
verdict is clean. The command line collects the verdicts (`listening`) for its lines on standard error, `validity` in the
JSON file and the exit code.
"""

from __future__ import annotations

import inspect
import math
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import asdict, dataclass

from heavebond.core.errors import Problem, RunWarning, SimulationError, listing
from heavebond.core.presentation import count, number, readable

MOST_NAMED = 3
PACKAGE = __name__.partition(".")[0]
NOT_BECOME = ("`{}` acts as it becomes true. State what holds at the start, `initial: {{switch.on: 1}}`, or begin the run "
              "before it is true")
DENSE = ("each one stops the integrator. If a switch drives itself back, widen its band (of a Relay, `u_on` and `u_off`) or "
         "give the driven part an inertia or a lag. Sample the counts of a quantiser or encoder (`Encoder`, `Quantiser`) "
         "instead of an event for each edge. If the machine needs these events, shorten the run, or "
         "let them act at the ends of fixed steps (`--solver rk4 --step '1 ms'`)")
ALTERNATES = ("its conditions alternate at the ends of the steps, so that the run depends on the step. Replace a friction "
              "that jumps by DryFriction, widen the band of a switch, give the law a width (smooth_sign), or sample the "
              "counts of an encoder (`Encoder`, `Quantiser`)")
JUMP = ("The values of the run are right. Let the condition of `{}` happen as an event, which sensitivities pass exactly: a "
        "Switch, Comparator or Relay, a DryFriction for friction, or `when:` in a component; or smooth it (smooth_sign)")
RUNAWAY = 1e6  # typical sizes from which on a value is no result: a machine of metres does not go a thousand kilometres


@dataclass(frozen=True)
class Finding:
    """A fault of a run: its kind (see `KINDS`), the variable and its part or node, the first time and the worst value, the
    limit and the unit (SI), and a hint where to look."""

    kind: str
    name: str
    part: str
    time: float
    value: float
    limit: float | None
    unit: str
    advice: str

    @property
    def failed(self) -> bool:
        """Whether the run is worthless."""
        return KINDS[self.kind]

    @property
    def text(self) -> str:
        """What happened, as the beginning of a sentence."""
        t = f"{self.time:.4g} s"
        value = readable(self.value, self.unit)
        if self.kind == "not-finite":
            return f"{self.name} is {'no number' if math.isnan(self.value) else 'infinite'} from {t} on"
        if self.kind == "undetermined":
            return f"{self.name} is undetermined from {t} on"
        if self.kind == "energy":
            return f"the power of {self.part} does not balance: {readable(abs(self.value), self.unit)} " \
                f"{'appear' if self.value < 0 else 'disappear'}, from {t} on"
        if self.kind == "loop":
            return f"the loop {self.part} is open at {self.name} from {t} on, by up to {number(self.value, 3)} of its " \
                "size: its constraints contradict each other"
        if self.kind == "growth":
            return f"{self.name} grows exponentially, to {value} at the end"
        if self.kind == "true-at-start":
            return f"the condition of {self.name} is true at the start, which lets nothing happen"
        if self.kind == "jump":
            return f"the sensitivities lack the jump of {self.name} at {t}, and are wrong from there on"
        if self.kind == "dense-events":
            many = number(self.limit or 0.0, 6)
            return f"{self.name} has {number(self.value, 3)} events per second at {t} and {many} in the run"
        if self.kind == "unstable-start":
            return f"{self.name} starts at an unstable equilibrium, {value}"
        if self.kind == "scale":
            return f"{self.name} stays at {value}, far below the size {readable(self.limit or 0.0, self.unit)} of its " \
                "absolute tolerance, so that it is not accurate; the run with a tolerance that fits failed"
        if self.kind == "rounding":
            return f"{self.name} moves by {value} only, and its error is up to {readable(self.limit or 0.0, self.unit)}"
        if self.kind == "narrow":
            return f"{self.name} acts within one step of the integrator, as at {t}"
        if self.kind == "time-formula":
            return f"the function of time {self.name} has no bound: motions shorter than an output interval may be " \
                "passed over"
        if self.kind == "rates":
            return f"{self.name} is sampled every {value} and reads {self.part}, which has other instants"
        if self.kind == "placeholder":
            return f"{self.name} has no law: it is a placeholder"
        if self.kind == "clock":
            return f"the clock {self.name} of an FMU never ticks"
        if self.kind == "fixed-step":
            beyond = "" if self.limit is None else f", beyond its limit of stability at {readable(self.limit, 's')}"
            return f"{self.name} has no error control: its step is {value}{beyond}"
        if self.kind == "joined":
            return f"{self.name} has both ports on the same node, '{self.part}'"
        if self.kind == "filled":
            return f"{self.name} has no capacity: the run was restarted with a volume of {value} there"
        if self.kind == "reversed":
            return f"{self.name} cannot open: from {t} on the pressure at its outlet is above that at its inlet, by up to " \
                f"{value} more than would open it in reverse"
        if self.kind == "front":
            travel = readable(self.limit or 0.0, "s")
            return f"{self.name} passes a front of {value} at {t}, and a wave takes {travel} through each of its segments"
        limit = readable(self.limit or 0.0, self.unit)
        if self.kind == "physical":
            return f"{self.name} falls below {limit} at {t}"
        if self.kind == "runaway":
            return f"{self.name} reaches {value}, beyond {limit} (a million typical sizes) from {t} on"
        return f"{self.name} reaches {value}, beyond {limit} from {t} on"

    def as_dict(self) -> dict[str, object]:
        """For machines."""
        return {**asdict(self), "failed": self.failed, "message": self.text}


# whether a run with such a finding is worthless
KINDS = {"physical": True, "not-finite": True, "runaway": True, "energy": True, "loop": True, "range": False,
         "larger": False, "growth": False, "scale": False, "rounding": False, "undetermined": False, "true-at-start": False,
         "unstable-start": False, "placeholder": False, "fixed-step": False, "joined": False, "reversed": False,
         "filled": False, "front": False, "time-formula": False, "narrow": False, "dense-events": False, "rates": False,
         "jump": False, "clock": False}
FAILURES = tuple(kind for kind, failed in KINDS.items() if failed)


@dataclass(frozen=True)
class Verdict:
    """The verdict on a run: its findings, the worst kind first, then by time. Clean if there are none."""

    findings: tuple[Finding, ...] = ()

    @property
    def failed(self) -> bool:
        """Whether the numbers of the run are worthless."""
        return any(f.failed for f in self.findings)

    @property
    def status(self) -> str:
        """`clean`, `outside` (a range was left) or `failed`."""
        return "failed" if self.failed else "outside" if self.findings else "clean"

    @property
    def text(self) -> str:
        """The verdict in a line: what happened first of the worst kind, what to look at, and what else was found."""
        if not self.findings:
            return "clean"
        first = self.findings[0]
        other_names = list(dict.fromkeys(f.name for f in self.findings if f.name != first.name))
        same = [f.name for f in self.findings[1:] if f.kind == first.kind and f.advice == first.advice]
        also = f" ({listing(same, MOST_NAMED)} too)" if same else ""
        unrelated = [name for name in other_names if name not in same]
        begin = first.text.removeprefix(first.name) if first.text.startswith(first.name) else f": {first.text}"
        more = f" Also outside: {listing(unrelated, MOST_NAMED)}." if unrelated else ""
        before = self._before(first)
        return f"{first.name}{also}{begin}: {before}{first.advice}.{more}"

    def __str__(self) -> str:
        return self.text

    def _before(self, first: Finding) -> str:
        """The earlier finding of a variable outside its range, which may be the cause."""
        earliest = min(self.findings, key=lambda f: f.time)
        return f"{earliest.name} was the first to leave its range, at {earliest.time:.4g} s. " \
            if first.failed and earliest.time < first.time and earliest.kind in ("range", "larger", *FAILURES) else ""

    @property
    def problem(self) -> Problem:
        """The failure as a problem with its code."""
        first = self.findings[0]
        # a finding that is not outside of a range has advice of another kind
        also = [f.text if f.kind in ("range", "larger", *FAILURES) else f"{f.text}. {f.advice}" for f in self.findings[1:]]
        notes = (*also[:MOST_NAMED], *([f"and {count(len(also) - MOST_NAMED, 'more finding')} (--json lists all)"]
                                       if len(also) > MOST_NAMED else []))
        return Problem(f"run-{first.kind}", first.text, None, f"{self._before(first)}{first.advice}.", notes)

    def raise_if_failed(self) -> Verdict:
        """The verdict itself; SimulationError if the run is worthless."""
        if self.failed:
            raise SimulationError([self.problem])
        return self

    def as_dict(self) -> dict[str, object]:
        """For machines; `exit` is the exit status that the command line gives it."""
        return {"status": self.status, "exit": int(self.failed), "findings": [f.as_dict() for f in self.findings]}


def verdict(findings: Sequence[Finding]) -> Verdict:
    """The verdict on a run: the worst finding of each variable at its first time, failures first, then by time (growth
    and a step without error control, which have no beginning, last)."""
    order = list(KINDS)
    worst: dict[str, Finding] = {}
    for f in sorted(findings, key=lambda f: (order.index(f.kind), f.time)):
        worst.setdefault(f.name, f)

    def last(f: Finding) -> bool:
        return f.kind == "growth" or (f.kind == "fixed-step" and f.limit is None)

    return Verdict(tuple(sorted(worst.values(), key=lambda f: (
        not f.failed, order.index(f.kind) if f.failed else last(f), f.time))))


# The verdicts of the runs that a command made, by the name of the run; None where nobody listens.
_HEARD: ContextVar[list[tuple[str, Verdict]] | None] = ContextVar("verdicts heard", default=None)


@contextmanager
def listening() -> Iterator[list[tuple[str, Verdict]]]:
    """Context in which verdicts are collected by the name of the run instead of being issued as warnings."""
    heard: list[tuple[str, Verdict]] = []
    token = _HEARD.set(heard)
    try:
        yield heard
    finally:
        _HEARD.reset(token)


def report_verdict(name: str, verdict_of_run: Verdict) -> None:
    """Report the verdict on a run of that name: to `listening` if active, else as a warning unless it is clean."""
    heard = _HEARD.get()
    if heard is not None:
        heard.append((name, verdict_of_run))
    elif verdict_of_run.findings:
        warnings.warn(f"{name}: {verdict_of_run.text}", RunWarning, stacklevel=_depth_of_caller())


def _depth_of_caller() -> int:
    """The stack level of the first function outside heavebond, counted from `report_verdict`."""
    frame, depth = inspect.currentframe(), 0
    while frame is not None and str(frame.f_globals.get("__name__", "")).partition(".")[0] == PACKAGE:
        frame, depth = frame.f_back, depth + 1
    return depth


def verdicts_as_dict(heard: Sequence[tuple[str, Verdict]]) -> dict[str, object]:
    """The verdicts of all runs of a command for machines: the worst status, and the findings of each run."""
    whole = verdict_of_all(heard)
    findings = [{"run": name, **f.as_dict()} for name, run_verdict in dict(heard).items() for f in run_verdict.findings]
    return {**whole.as_dict(), "findings": findings}


def verdict_of_all(heard: Sequence[tuple[str, Verdict]]) -> Verdict:
    """One verdict on several runs."""
    return Verdict(tuple(f for _, run_verdict in heard for f in run_verdict.findings))
