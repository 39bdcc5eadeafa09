"""Verification of a run against numerical settings: tolerances, and the widths of regularised transitions."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from heavebond.core.errors import HeavebondError, Problem, SimulationError, listing
from heavebond.numerics.dae import Assembly, assemble
from heavebond.numerics.result import Result
from heavebond.numerics.simulator import Simulator, Tolerances


@dataclass(frozen=True)
class VerificationConstants:
    """The constants of the verification of a run by tighter tolerances and narrower transitions.

    tolerance_factor: factor on the tolerances. Origin: two decimals. Doubled: a weaker check.
    width_factor: factor on the widths of transitions. Origin: one decimal. Doubled: a weaker check.
    allowed: accepted difference, over the range of an output. Origin: the resolution of a plot. Doubled: larger differences
    pass.
    least_tolerance: tolerance below which rounding prevails. Origin: double precision. Doubled: nothing.
    held_share: share of its size with which an output that is nearly constant is compared. Origin: a controlled pressure.
    Doubled: smaller differences there pass.
    rounding: share of its size below which a difference is rounding. Origin: in any unit that an engineer uses. Doubled:
    nothing.
    """

    tolerance_factor: float = 1e-2
    width_factor: float = 0.1
    allowed: float = 0.01
    least_tolerance: float = 1e-14
    held_share: float = 1e-3
    rounding: float = 1e-9


VERIFICATION = VerificationConstants()


@dataclass(frozen=True)
class OutputChange:
    """Change of an output: rms of the difference over the output's range, with tighter tolerances, and with narrower
    widths as well; nan if that run failed."""

    name: str
    by_tolerances: float
    by_widths: float

    @property
    def worst(self) -> float:
        """The larger of the two; infinite if a run failed."""
        return float(np.nan_to_num(max(self.by_tolerances, self.by_widths, key=lambda v: np.inf if np.isnan(v) else v),
                                   nan=np.inf))


@dataclass(frozen=True)
class Verification:
    """The change of each output, the narrowed widths, the permitted change, and the messages of failed repeated runs."""

    outputs: tuple[OutputChange, ...]
    widths: tuple[str, ...]
    allowed: float
    failures: tuple[Problem, ...]

    @property
    def moved(self) -> list[OutputChange]:
        """The outputs that changed by more than permitted, the worst first."""
        return sorted((m for m in self.outputs if m.worst > self.allowed), key=lambda m: -m.worst)

    def problem(self) -> Problem | None:
        """The problem to report if outputs changed."""
        if not self.moved:
            return None
        steps = [m.name for m in self.moved if not m.by_tolerances <= self.allowed]
        widths = [m.name for m in self.moved if m.by_tolerances <= self.allowed]
        hints = []
        if steps:
            hints.append(f"{listing(steps, 4)}: run with a smaller --rtol until they stay; a chaotic motion never does.")
        if widths:
            hints.append(f"{listing(widths, 4)}: the transitions ({listing(self.widths, 4)}) are too wide to count as "
                         "sharp. Set them narrower, or take a component that switches (DryFriction, RigidStop, on shafts "
                         "RotationalDryFriction, RotationalRigidStop).")
        return Problem("results-moved", f"{len(self.moved)} of {len(self.outputs)} outputs depend on tolerances or "
                       f"transitions by more than {self.allowed:.2g} of their range", None, "\n".join(hints),
                       tuple(line for failed in self.failures for line in (failed.message, *failed.notes)))


def verify(result: Result, names: Sequence[str], also: Iterable[str] = (), tolerances: Tolerances | None = None,
           allowed: float = VERIFICATION.allowed) -> Verification:
    """Repeat a run with a hundredth of its tolerances, and then with a tenth of all widths as well.

    Widths are the parameters that their component declares so. `also` are the additional positions of the assembly of the
    result, `tolerances` its tolerances.
    """
    base = tolerances or Tolerances()
    tight = Tolerances(max(base.rtol * VERIFICATION.tolerance_factor, VERIFICATION.least_tolerance),
                       max(base.atol * VERIFICATION.tolerance_factor, VERIFICATION.least_tolerance / 100))
    failures: list[Problem] = []
    widths = tuple(f"{path}.{name}" for path, leaf in result.assembly.flat.expanded.leaves.items()
                   for name, parameter in leaf.component.parameters.items() if parameter.width)
    tolerance = _shares(result, names, result.assembly, tight, failures, "with tighter tolerances")
    narrow = assemble(result.assembly.model, also, VERIFICATION.width_factor) if widths else result.assembly
    width = _shares(result, names, narrow, tight, failures, "with a tenth of the widths") if widths else tolerance
    return Verification(tuple(OutputChange(n, a, b) for n, a, b in zip(names, tolerance, width, strict=True)), widths,
                        allowed,
                        tuple(failures))


def _shares(result: Result, names: Sequence[str], assembly: Assembly, tolerances: Tolerances, failures: list[Problem],
            how: str) -> list[float]:
    try:
        again = Simulator(assembly, times=result.time, tolerances=tolerances).run().signals(names)
    except HeavebondError as error:
        failures += [Problem(p.code, f"{how}: {p.message}", p.place, p.hint, p.notes) for p in error.problems]
        return [np.nan] * len(names)
    shares, signals = [], result.signals(names)
    for name in names:
        before = signals[name]
        size = max(float(np.ptp(before)), VERIFICATION.held_share * float(np.abs(before).max(initial=0.0)))
        difference = float(np.sqrt(np.mean((again[name] - before) ** 2)))
        shares.append(difference / max(size, VERIFICATION.rounding))
    return shares


def raise_if_moved(verification: Verification, figures: dict[str, object]) -> None:
    """Raise SimulationError, with the figures of the run, if outputs changed."""
    problem = verification.problem()
    if problem is not None:
        error = SimulationError([problem])
        error.figures = figures
        raise error
