"""The modes of a diagram with the shares of its components, and the verdict on its stability."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

from heavebond.core import facade
from heavebond.core.errors import SimulationError
from heavebond.core.presentation import brief, count, number
from heavebond.language.model import ModelOrFile, loaded
from heavebond.language.sections import Clock
from heavebond.linear.held_variables import HeldVariable, StartEvents, undecided_reasons
from heavebond.linear.linearisation import Linear, Linearisation, Mode
from heavebond.linear.modal_values import ModalShares, energy_shares
from heavebond.linear.operating_point import OperatingPoints, stuck
from heavebond.linear.slow_modes import SLOW_MODES, SlowModes, slow_modes
from heavebond.linear.stability import UNDECIDED, UNSTABLE
from heavebond.numerics.dae import Assembly
from heavebond.numerics.output_times import Time, grid
from heavebond.numerics.start_equations import Point

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Modes(facade.Displayed):
    """The modes of a diagram at an operating point, the slowest first.

    `operating_point` are the time and the `states` with their units, `shares` the shares of the components in the energy and
    the damping of each mode. `stability` is the verdict, None if
    it is not decided, and `words` explain it. `held` are the variables that are constant in the linear system, `notes`
    describe parts that stick. With a `period` in s the system is sampled, and each mode has a pole z.
    """

    model: str
    states: tuple[str, ...]
    operating_point: Mapping[str, object]
    at: str
    modes: tuple[Mode, ...]
    shares: tuple[ModalShares, ...]
    stability: str | None
    words: tuple[str, ...]
    held: tuple[HeldVariable, ...] = ()
    sampled: tuple[HeldVariable, ...] = ()
    period: float | None = None
    clocks: tuple[Clock, ...] = ()
    notes: tuple[str, ...] = ()
    filled: str = ""

    def __len__(self) -> int:
        return len(self.modes)

    @property
    def frequencies(self) -> tuple[float, ...]:
        """The frequency of each mode in Hz; 0 for a free mode."""
        return tuple(mode.frequency if mode.value else 0.0 for mode in self.modes)

    @property
    def damping(self) -> tuple[float, ...]:
        """The damping ratio of each mode; NaN for a free mode."""
        return tuple(mode.damping for mode in self.modes)

    def as_dict(self) -> dict[str, object]:
        """The modes as a dictionary for JSON."""
        return {"model": self.model, "at": self.at, "operating_point": dict(self.operating_point),
                "stability": self.stability, "T": self.period, "sampled": [h.as_dict() for h in self.sampled],
                "held": [h.as_dict() for h in self.held], "stuck": list(self.notes), "filled": self.filled or None,
                "modes": [_mode_entries(mode, share) for mode, share in zip(self.modes, self.shares, strict=True)]}

    def to_pandas(self) -> pd.DataFrame:
        """A table with a row for each mode: eigenvalue in 1/s, frequency in Hz, damping ratio, and the component with the
        largest share of the energy."""
        import pandas as pd

        return pd.DataFrame({
            "eigenvalue [1/s]": [mode.value for mode in self.modes], "frequency [Hz]": self.frequencies,
            "damping": self.damping, "energy in": [next(iter(share.energy), "") for share in self.shares]})

    def __repr__(self) -> str:
        return brief(self, self.model, f"{count(len(self.modes), 'mode')} {self.at}",
                     f"{self.stability or 'stability is not decided'}",
                     "frequencies " + ", ".join(f"{number(f, 4)} Hz" for f in self.frequencies[:8] if f))


def modes(model: ModelOrFile, *, at: Time | None = None, slowest: int | None = None,
          parameters: Mapping[str, float | str] | None = None) -> Modes:
    """Linearise a diagram and compute its modes: frequency in Hz, damping ratio, and the shares of its components.

    `model` is a diagram, or the path or bundled name of one. The operating point is its start, `at="steady"` or
    a time (`"10 s"`), up to which it is run. `parameters` overrides values by name. All modes are computed up to 300 states;
    above it, or if `slowest` is given, so many of the slowest, and growing modes that a search finds beyond them. Raises
    UsageError for wrong arguments, ModelError for an invalid diagram, and StartError without an operating point.
    """
    diagram = loaded(model)
    operating = OperatingPoints(diagram.with_parameters(parameters) if parameters else diagram, at)
    assembly, point = operating.assembly, operating.at()
    listed_modes, verdict, words, held, linear = _modes(assembly, point, slowest, operating.words)
    period, sampled = (linear.period, linear.sampled) if linear is not None else (None, ())
    states = zip(assembly.state_names, point.x, assembly.reduced.states, strict=True)
    entries = {name: {"value": float(value), "unit": assembly.flat.unknowns[j].unit.text + "/s" * order}
               for name, value, (j, order) in states}
    return Modes(assembly.model.name, tuple(assembly.state_names), {"time": point.t, **entries}, operating.words,
                 tuple(listed_modes), tuple(energy_shares(assembly, point, listed_modes)), verdict, tuple(words), held,
                 tuple(sampled), period, tuple(assembly.model.clocks.values()), tuple(stuck(assembly, point)),
                 operating.filled)


def _modes(assembly: Assembly, point: Point, slowest: int | None, at: str
           ) -> tuple[list[Mode], str | None, list[str], tuple[HeldVariable, ...], Linear | None]:
    """The modes to list, the verdict on stability (None if it is not decided), the sentences on it, the variables that are
    held constant, and the linear system if all modes are listed."""
    linearisation, model = Linearisation(assembly), assembly.model
    if slowest is None and len(assembly.state_names) <= SLOW_MODES.max_all:
        linear = linearisation.at(point)
        judged = linear.stability()
        if judged.undecided:
            return linear.modes(), None, [f"{UNDECIDED} {at}: {'; '.join(judged.reasons)}"], linear.held, linear
        sentences = [] if judged.growing or judged.stable else [f"{judged.verdict} {at}: {'; '.join(judged.reasons)}"]
        sentences += [f"stable {at}"] if judged.stable and linear.period is not None else []
        return linear.modes(), judged.verdict, _growth(len(judged.growing), at) + sentences, linear.held, linear
    times = grid(model, None, None) if model.until is not None else [0.0, 1.0]
    slow = slow_modes(linearisation, point, float(times[-1] - times[0]), slowest or SLOW_MODES.count)
    held = linearisation.held(point)
    if reasons := undecided_reasons(held):
        return slow.modes, None, [f"{UNDECIDED} {at}: {'; '.join(reasons)}", *_not_computed(slow)], held, None
    return slow.modes, UNSTABLE if slow.unstable else None, _growth(slow.unstable, at) + _not_computed(slow), held, None


def _growth(growing: int, at: str) -> list[str]:
    return [f"{growing} modes grow {at}: it is not stable there" if growing > 1 else
            f"1 mode grows {at}: it is not stable there"] if growing else []


def _not_computed(slow: SlowModes) -> list[str]:
    """State which modes were computed, and the limits of this result."""
    low, high = (number(rate, 3) for rate in slow.searched)
    result = f", and {len(slow.growing)} found" if slow.growing else ", and none was found"
    return [f"Computed: the {slow.computed} slowest eigenvalues of {slow.states} (one line for each pair of complex "
            f"eigenvalues), "
            f"those with |s| up to {number(slow.reach, 4)} 1/s. Of hundreds of nearly equal eigenvalues, for example of "
            f"equal pieces with equal damping, only some are listed.",
            f"Growing modes beyond these were looked for at rates from {low} to {high} 1/s{result}. This does not exclude "
            f"others: the search can miss a mode that grows slowly compared with its frequency among many undamped modes."]


def _mode_entries(mode: Mode, share: ModalShares) -> dict[str, object]:
    pole = {} if mode.z is None else {"z": [mode.z.real, mode.z.imag]}
    return {"real": mode.value.real, "imaginary": mode.value.imag, **pole, "frequency": mode.frequency,
            "damping": mode.damping if mode.value else None, "participation": mode.participation, "energy": share.energy,
            "damped_by": share.damping}


def growing_modes(assembly: Assembly, point: Point) -> tuple[list[dict[str, object]], str]:
    """The growing modes at a steady start, the fastest first, and a sentence that warns of them: the machine leaves such an
    equilibrium after any disturbance. Empty if there are none, and for large diagrams, for which they are not computed."""
    if len(assembly.state_names) > SLOW_MODES.max_all:
        return [], ""
    with suppress(SimulationError):  # the run reports it
        point = StartEvents(assembly).after(point)
    judged = Linearisation(assembly).at(point).stability()
    growing = sorted(() if judged.undecided else judged.growing, key=lambda e: -e.value.real)
    words = (f"The steady start is not stable, so that the machine leaves it: {'; '.join(e.text for e in growing)}. "
             "`heavebond modes` shows its modes; guesses (`~`) may lead to another steady state.") if growing else ""
    return [{"real": e.value.real, "imaginary": e.value.imag, "states": list(e.states)} for e in growing], words
