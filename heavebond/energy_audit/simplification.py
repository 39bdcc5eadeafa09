"""Model simplification by activity: remove the components with the least activity one by one, and check each by a run.

The components are ranked by activity (see `audit`). The most active ones, which together have the requested share, are kept.
Each of the others, the least active first, is set to its null values (`effect:` of its component: a spring of zero
stiffness, a friction of zero force). If that does not run (a mass), the component is deleted from the diagram. The change is
kept if the diagram still runs and no output changes by more than a limit. Parameters of other components that depend on it
by a formula (the weight of a mass) keep their values. A stiff part in series with other parts also has a low activity but
cannot be removed: the outputs then change by more than the limit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import casadi as ca
import numpy as np

from heavebond.core.errors import HeavebondError, listing
from heavebond.core.presentation import brief, number
from heavebond.core.quantities import si_value
from heavebond.core.reporting import reporting
from heavebond.energy_audit.audit import EnergyAudit
from heavebond.energy_audit.audit import energy as audit
from heavebond.language.edits import Change, extended_from
from heavebond.language.model import Model, ModelOrFile, extended, loaded
from heavebond.language.symbols import stack
from heavebond.numerics.dae import Array, assemble
from heavebond.numerics.output_times import Time
from heavebond.numerics.result import Result
from heavebond.numerics.simulator import Simulator
from heavebond.text.yaml_source import parse

STILL = 1e-9  # a smaller share of activity is a rounding error


@dataclass(frozen=True)
class Step:
    """A change to a diagram: values by name, and components to delete."""

    settings: dict[str, str] = field(default_factory=dict)
    removed: tuple[str, ...] = ()

    def joined(self, further: Step) -> Step:
        """Combine two changes."""
        return Step({**self.settings, **further.settings}, (*self.removed, *further.removed))

    def diagram(self, name: str, summary: str, extends: str) -> str:
        """The text of the changed diagram, which extends the original diagram."""
        settings = {k: v for k, v in self.settings.items() if k.rpartition(".")[0] not in self.removed}
        return Change(settings=settings).diagram(name, summary, extends) + (
            f"remove: [{', '.join(self.removed)}]\n" if self.removed else "")

    def on_model(self, model: Model) -> Model:
        """The changed diagram."""
        return extended(model, parse(self.diagram(model.name, model.name, model.path.name), model.path, model.path.name))

    @property
    def words(self) -> str:
        """The change in words: `crown.m = 0 kg`, or `crown is taken out`."""
        return ", ".join([*(f"{name} is taken out" for name in self.removed),
                          *(f"{name} = {value}" for name, value in self.settings.items())])


@dataclass(frozen=True)
class Tried:
    """A component with low activity, its share, and the change that removes its effect; `kept` is the reason for keeping it,
    empty if the change was made."""

    component: str
    share: float
    step: Step
    kept: str = ""


@dataclass(frozen=True)
class Simplified:
    """The reduced diagram, the tried components, the error of each output due to all changes (rms of the change over rms of
    the output about its mean), and the number of states before and after."""

    model: Model
    original: Model
    tried: tuple[Tried, ...]
    errors: dict[str, float]
    states: tuple[int, int]

    def __repr__(self) -> str:
        return brief(self, self.original.name, f"{self.states[0]} states before, {self.states[1]} after",
                     f"neutralised: {listing([trial.component for trial in self.removed]) or 'nothing'}",
                     *(f"{name} moves by {number(100 * error, 3)} %" for name, error in list(self.errors.items())[:8]))

    @property
    def removed(self) -> tuple[Tried, ...]:
        """The components without effect in the reduced diagram."""
        return tuple(trial for trial in self.tried if not trial.kept)

    def diagram(self, path: Path) -> str:
        """The text of the reduced diagram at `path`, which extends the original one."""
        whole = Step()
        for trial in self.removed:
            whole = whole.joined(trial.step)
        return whole.diagram(path.stem, f"{self.original.name} without what is little active.",
                             extended_from(path, self.original.path))

    def as_dict(self) -> dict[str, object]:
        """The result as a dictionary for JSON."""
        return {"tried": [{"component": trial.component, "activity_share": trial.share, "set": trial.step.settings,
                           "removed": list(trial.step.removed), "kept": trial.kept} for trial in self.tried],
                "errors": self.errors, "states": {"before": self.states[0], "after": self.states[1]}}


@reporting
def simplify(model: ModelOrFile, share: float | str = 0.99, limit: float | str = 0.05, *, until: Time | None = None,
             every: Time | None = None, found: EnergyAudit | None = None,
             progress: Callable[[str], None] = lambda text: None) -> Simplified:
    """Remove the effect of the components outside `share` of the activity while no output changes by more than `limit`.

    Both are shares (0 to 1, or text such as `"99 %"`). The activity of a component is the integral of |power| over the
    run. The arguments `model`, `until` and `every` are the same as in `simulate`. `found` is the audit of the diagram, if
    it exists already. `progress` is called with the name of each component. Raises the errors of `simulate`.
    """
    model = loaded(model)
    share, limit = si_value(share, "1", "share"), si_value(limit, "1", "limit")
    found = found or audit(model, until, every=every)
    whole = found.result
    outputs = list(model.show) or whole.assembly.state_names
    tried: list[Tried] = []
    applied, errors, changed, states = Step(), dict[str, float](), model, len(whole.assembly.state_names)
    # the components outside the requested share of activity, the least active first
    total, beyond = 0.0, []
    for line, part in found.ranking:
        if total >= share and not line.kind and part > STILL:
            beyond.append((line, part))
        total += part
    for line, part in beyond[::-1]:
        progress(line.component)
        why = "it has no values at which it is absent"
        for step in _steps(model, whole, line.component):
            attempt = applied.joined(step)
            changes, number, why = _output_changes(attempt, model, whole, outputs)
            worst = max(changes, key=lambda name: changes[name], default="")
            if not why and worst and changes[worst] > limit:
                why = f"{worst} would move by {100 * changes[worst]:.3g} %"
            if not why:
                applied, errors, changed, states = attempt, changes, attempt.on_model(model), number
                break
        tried.append(Tried(line.component, part, Step() if why else step, why))
    return Simplified(changed, model, tuple(tried), errors, (len(whole.assembly.state_names), states))


def _steps(model: Model, whole: Result, component: str) -> list[Step]:
    """The changes that remove the effect of a component: set its null values, or delete it from the diagram."""
    flat = whole.assembly.flat
    effect = flat.expanded.leaves[component].component.effect
    if effect is None or not effect.amplitude or any(sought is not None for sought in effect.amplitude.values()) \
            or effect.start.keys() & effect.amplitude:  # the null value is a value of the simpler part, not 0
        return []
    units = flat.units
    null_values = {f"{component}.{name}": f"0 {units[f'{component}.{name}'].text}" for name in effect.amplitude}
    # the parameters of other components that depend on the parameters of a component by a formula, with their values
    own_values = [value for name, value in flat.constants.items()
                  if name.startswith(component + ".") and value.is_symbolic()]
    names = [name for name, value in flat.constants.items()
             if not name.startswith(component + ".") and own_values and ca.depends_on(value, stack(own_values))]
    values = np.array(ca.Function("held", [flat.p], [stack([flat.constants[name] for name in names])])(whole.p)).ravel()
    held = {name: flat.units[name].written(value) for name, value in zip(names, values.tolist(), strict=True)}
    return [Step({**null_values, **held}), *([Step(held, (component,))] if component in model.body.instances else [])]


def _output_changes(step: Step, model: Model, whole: Result, outputs: list[str]) -> tuple[dict[str, float], int, str]:
    """The error of each output due to a change, the number of states, and the message if the changed diagram fails."""
    try:
        assembly = assemble(step.on_model(model))
        result = Simulator(assembly, times=whole.time).run()
        before, after = whole.signals(outputs), result.signals(outputs)
    except HeavebondError as error:
        return {}, 0, error.problems[0].message

    def rms(values: Array) -> float:
        return float(np.sqrt(np.mean(values**2)))

    changes = {}
    for name, values in before.items():
        size = rms(values - values.mean()) or rms(values)
        changes[name] = rms(after[name] - values) / size if size else float(rms(after[name]) > 0)
    return changes, len(assembly.state_names), ""
