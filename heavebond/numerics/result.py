"""Time series by name, with units."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.core import facade
from heavebond.core.errors import Problem, UsageError, listing, suggest
from heavebond.core.presentation import brief, count, number
from heavebond.core.units import dimension_text, read_unit
from heavebond.equations.buffered import Buffered
from heavebond.equations.structural_messages import joined_ports
from heavebond.language.symbols import split, stack
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.event_constants import EVENTS
from heavebond.numerics.extremes import SignalFigures, signal_figures
from heavebond.numerics.initialise import Start
from heavebond.numerics.placeholders import depends_on_placeholder, lawless_parts
from heavebond.numerics.pointwise import undetermined
from heavebond.numerics.run_verdict import ALTERNATES, DENSE, JUMP, NOT_BECOME, Finding, Verdict
from heavebond.numerics.start_stability import unstable_start
from heavebond.numerics.validity import RunSection, judged, without_value
from heavebond.records.saved_runs import SavedRun, Signals, write_run
from heavebond.records.signal_array import Signal
from heavebond.text.expression import ExpressionProblem

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

    from heavebond.numerics.trace import Instant


FORMULA_LENGTH = 80  # of a function of time in a finding
LOOP_CLOSED = 1e-5  # largest gap of a closed loop in its size; its dimensions may be rounded to six digits


_PRESSURE = re.compile(r"\b[A-Za-z_]\w*\.\w+\b")


@dataclass(frozen=True)
class ForwardSensitivities:
    """Forward sensitivities in SI: d x / d p_k (m, n_x, N), d z / d p_k (m, n_z, N), how all parameters move with the
    k-th (m, n_p): itself by 1, those under `solve:` as the start requires; d quadratures / d p_k (m, n_q, N); and how the
    held variables do (m, n_h, N), and the pieces of delayed variables (m, n_u, N; None if there are none)."""

    names: tuple[str, ...]
    x: Array
    z: Array
    p: Array
    quadratures: Array
    held: Array
    u: Array | None = None


Stayed = tuple[NDArray[np.intp], "Result"]
Settle = Callable[[NDArray[np.intp]], Array]  # the algebraic unknowns (n_z, k) at points of a run by their numbers


def _kept(dense: Result) -> tuple[Result, Settle | None]:
    """The function `between` of a run that is created with its dense points."""
    return dense, None


@dataclass(frozen=True)
class Result(facade.Displayed):
    """A run: `time` (N,) in s, states x (n_x, N) and algebraic unknowns z (n_z, N) in SI, and every variable by name.

    `result["pull"]` (N,) is a Signal: an array with its unit, which is the one declared under `show:`, else SI.
    `result.si["pull"]` are plain numbers in SI, `result.display["pull"]` plain numbers in the declared unit. A signal may be
    any formula of names: `result["crown.x - platform.x"]`.

    `quadratures` (n_q, N) are the integrals that the caller asked for, `p` (n_p,) the parameters at the start, `held`
    (n_h, N) the held variables, and `instants` the events; at an event the values are those after it. `stays` are the
    parts of the run in which other states were integrated: their times (k,) and the run there in those states. `between`
    makes `dense`, where its algebraic unknowns are those that the function with it gives. `ended` is the violation of a
    physical limit that ended the run.
    """

    assembly: Assembly
    time: Array
    x: Array
    z: Array
    u: Array
    p: Array
    start: Start
    statistics: Mapping[str, object] = field(default_factory=dict)
    quadratures: Array = field(default_factory=lambda: np.zeros((0, 0)))
    along: ForwardSensitivities | None = None
    held: Array = field(default_factory=lambda: np.zeros((0, 0)))
    instants: tuple[Instant, ...] = ()
    stays: tuple[Stayed, ...] = ()
    between: Callable[[], tuple[Result, Settle | None]] | None = field(default=None, repr=False, compare=False)
    ended: Finding | None = None

    def __reduce__(self) -> tuple[Callable[..., Result], tuple[object, ...]]:
        """Pickle the numbers, including those of `dense`; see `Assembly` for the equations."""
        values = {item.name: getattr(self, item.name) for item in fields(self)}
        values["between"] = None if self._points is None else partial(_kept, self.dense)
        return partial(Result, **values), ()

    @cached_property
    def verdict(self) -> Verdict:
        """The verdict on the values of this run: `print(result.verdict)` shows it in a line."""
        dense = [] if self._points is None else list(_stretches(*self._points))
        findings = [*self._findings_at_the_start(), *self._reversed(), *self._findings_of_the_solver(),
                    *self._findings_of_the_motion(), *self._dense_events(), *([self.ended] if self.ended else [])]
        return judged(list(_stretches(self)), findings, dense)

    @cached_property
    def _points(self) -> tuple[Result, Settle | None] | None:
        return None if self.between is None else self.between()

    @cached_property
    def dense(self) -> Result:
        """The run at its output points, at points between them about as dense as the steps of the integrator, and on both
        sides of events, whose time occurs twice. The run itself if it was made without such points."""
        if self._points is None:
            return self
        points, settle = self._points
        return points if settle is None else replace(points, z=settle(np.arange(len(points.time))))

    @property
    def unsettled(self) -> Result:
        """As `dense`, with algebraic unknowns that the integrator interpolated."""
        return self if self._points is None else self._points[0]

    def figures(self, names: Iterable[str]) -> dict[str, SignalFigures]:
        """Extremes, mean, root mean square and last value of signals, each in `result.unit(name)`. They are taken from
        `dense` and do not depend on the output points."""
        dense = self.dense
        return {name: signal_figures(dense.time, values) for name, values in dense.signals(names).items()}

    def without_law(self, names: Iterable[str]) -> tuple[str, ...]:
        """The given signals that depend on a part without a law (`placeholder:`); such a part has constant outputs."""
        if not lawless_parts(self.assembly):
            return ()
        chosen = list(names)
        depends = depends_on_placeholder(self.assembly, [signal_expression(self.assembly, name) for name in chosen])
        return tuple(name for name, yes in zip(chosen, depends, strict=True) if yes)

    def without_value(self, names: Iterable[str]) -> Verdict:
        """The verdict on signals without a value at some output times. The verdict of the run covers its unknowns."""
        def undecided(name: str, values: Array) -> NDArray[np.bool_]:
            if self.stays or not np.isnan(values).any():
                return np.zeros(len(values), bool)
            return undetermined(self.assembly, signal_expression(self.assembly, name), columns(self), values)

        named = {f.name for f in self.verdict.findings}
        verdict = without_value(self.signals(names), self.time, undecided)
        return Verdict(tuple(f for f in verdict.findings if f.failed or f.name not in named))

    def _findings_at_the_start(self) -> list[Finding]:
        """Findings on conditions that are true at the start, placeholders, a fixed step, and parts in short circuit."""
        flat, time = self.assembly.flat, float(self.time[0])
        # events whose conditions are already true at the start do not happen
        names = self.statistics.get("true_at_start", ())
        assert isinstance(names, (list, tuple))
        texts = {event.name: event.text for event in flat.events}
        findings = [Finding("true-at-start", name, name.rpartition(".")[0], time, 1.0, None, "",
                            NOT_BECOME.format(texts[name])) for name in names]
        # placeholders for untranslated parts
        findings += [Finding("placeholder", path, path, time, 0.0, None, "",
                             f"{leaf.component.placeholder.partition(';')[0]}. Write its law, or take it out")
                     for path, leaf in flat.expanded.leaves.items() if leaf.component.placeholder]
        # clocks of FMUs
        findings += [Finding("clock", f"{path}.{name}", path, time, 0.0, None, "",
                             "Clocks tick in co-simulation only if the FMU has an event mode, and need a valid interval")
                     for path, leaf in flat.expanded.leaves.items() if leaf.component.foreign
                     for name in leaf.component.foreign.idle_clocks]
        if isinstance(step := self.statistics.get("step"), float):
            stable = self.statistics.get("stable_step")
            findings.append(Finding("fixed-step", str(self.statistics["solver"]), "", time, step,
                                    stable if isinstance(stable, float) else None, "s",
                                    "Repeat the run with half the step, or by `--solver auto`, to see its error"
                                    if stable is None else "Decaying motions of the machine grow. Take a shorter step"))
        # parts with two ports, both on one node
        joined = {path: node for path in flat.expanded.leaves if (node := joined_ports(flat, path)) is not None}
        return [*findings, *(Finding("joined", path, node, time, 0.0, None, "", "it does nothing there. Put one port on "
                                     "another node, or remove the part") for path, node in joined.items())]

    def _findings_of_the_solver(self) -> list[Finding]:
        """Findings on filled nodes, sizes of unknowns, rounding of states, and narrow functions."""
        assembly, time, findings = self.assembly, float(self.time[0]), list[Finding]()
        flat, reduced = assembly.flat, assembly.reduced
        # nodes without a capacity at which the run was restarted with a small volume
        if isinstance(fills := self.statistics.get("fills"), dict):
            volumes = assembly.parameter_values
            advice = f"Without it, {fills['why']}. Add a Volume or a Receiver of the real size"
            findings += [Finding("filled", node, node, time, volumes[f"{part}.V"], None, "m**3", advice)
                         for node, part in zip(fills["nodes"], fills["components"], strict=True)]
        # unknowns that stay far below the sizes of their absolute tolerances, with which the run could not be repeated
        unfit, rounded = self.statistics.get("unfit", {}), self.statistics.get("rounded", {})
        assert isinstance(unfit, Mapping) and isinstance(rounded, Mapping)
        unknowns = {reduced.name(c): flat.unknowns[c[0]] for c in (*reduced.states, *reduced.algebraic)}
        findings += [Finding("scale", name, name.rpartition(".")[0], time, float(size), u.nominal, u.unit.text,
                             f"State its size, `nominal: {{{name}: {size:g} {u.unit.text}}}`")
                     for name, size in unfit.items() if (u := unknowns.get(name)) is not None]
        # states that move so little about a large value that rounding, or the relative tolerance of a run that could not be
        # repeated, hides a part of their motion
        units = dict(zip(assembly.state_names, (flat.unknowns[j].unit.text if not order else ""
                                                for j, order in reduced.states), strict=True))
        findings += [Finding("rounding", name, name.rpartition(".")[0], time, spread, error, units[name],
                             f"The motion is accurate to {error / spread:.1g} of its range at best. Write the diagram so "
                             f"that it counts {name} from a value near {self[name][0]:.6g}, such as a temperature from the "
                             "ambient") for name, (spread, error) in rounded.items() if name in units]
        # narrow functions of states that the run steps over, although it was repeated with stops at their positions
        times = np.asarray(self.statistics.get("stepped_over", ()), float)
        if len(times):
            findings.append(Finding(
                "narrow", "a narrow function of states", "", float(times[0]), float(len(times)), None, "",
                "A part of its effect may be missing. Write `simulate: {largest_step: ...}`, with a part of the time in "
                "which it acts"))
        return findings

    def _findings_of_the_motion(self) -> list[Finding]:
        """Findings on an unstable equilibrium, open loops, functions of time, jumps of laws, and sampling rates."""
        time = float(self.time[0])
        # a steady start at an unstable equilibrium
        u = columns(self, np.array([0]))[4]
        unstable = unstable_start(self.assembly, self.start, np.asarray(u).ravel(), float(self.time[-1] - self.time[0]))
        findings = [unstable] if unstable is not None else []
        for loop in self.assembly.flat.redundancies:  # the constraints that the equations omit
            error = np.abs(self.evaluate(loop.residuals)).max(axis=0)
            if error.max() > LOOP_CLOSED:
                k = int(np.argmax(error > LOOP_CLOSED))
                at, worst = float(self.time[k]), float(error.max())
                findings.append(Finding("loop", loop.closing, listing(loop.parts, 12), at, worst, LOOP_CLOSED, "",
                                        "Its lengths and axes must agree, and its guesses must be near "
                                        "the intended position; or replace a joint by a SphericalJoint or a "
                                        "CylindricalJoint"))
        # functions of time for which neither the instants of short motions nor a longest step were found; jumps of laws at
        # conditions of states, in a run with sensitivities
        texts, jumps = self.statistics.get("unknown_forcing", ()), self.statistics.get("jumps", ())
        assert isinstance(texts, (list, tuple)) and isinstance(jumps, (list, tuple))
        shortened = [text if len(text) <= FORMULA_LENGTH else f"{text[:FORMULA_LENGTH]}..." for text in texts]
        findings += [Finding("time-formula", f"`{text}`", "", time, 0.0, None, "",
                             "Make `every:` shorter than its shortest motion") for text in shortened]
        findings += [Finding("jump", jump.owner, jump.owner, jump.time, 0.0, None, "", JUMP.format(jump.function))
                     for jump in jumps]
        # transitions between sampling rates that no block states, and in which the age of the value varies or is a part of a
        # period
        if sum(e.period is not None for e in self.assembly.flat.events) > 1:
            findings += [Finding("rates", t.reader, t.source, time, t.period, t.source_period, "s", t.advice)
                         for t in self.assembly.update_order.transitions(self.p) if not t.regular]
        return findings

    def _dense_events(self) -> list[Finding]:
        """Findings on parts whose conditions cause so many events, in the run or in a short time, that they determine its
        computing time."""
        conditions = {e.name for e in self.assembly.flat.events if e.indicator is not None and not e.by_clock}
        instants: dict[str, list[float]] = {}
        for instant in self.instants:
            for part in dict.fromkeys(name.rpartition(".")[0] for name in instant.names if name in conditions):
                instants.setdefault(part, []).append(instant.time)
        findings, span = list[Finding](), float(self.time[-1] - self.time[0])
        for part, times in instants.items():
            most = min(EVENTS.dense_events, len(times))
            lengths = np.asarray(times)[most - 1:] - np.asarray(times)[:len(times) - most + 1]
            k = int(lengths.argmin())
            dense = most == EVENTS.dense_events and lengths[k] < EVENTS.dense_within * span
            # at a fixed step, conditions that alternate from step to step
            fixed_step = "step" in self.statistics
            steps = self.statistics.get("nsteps")
            each_step = fixed_step and isinstance(steps, int) and len(times) >= max(most, EVENTS.share_of_steps * steps)
            dense = dense and not fixed_step
            if dense or each_step or len(times) >= EVENTS.many_events:
                rate = (most - 1) / max(float(lengths[k]), EVENTS.same_instant * span)
                findings.append(Finding("dense-events", part, part, times[k], rate, float(len(times)), "1/s",
                                        ALTERNATES if each_step else DENSE))
        return findings

    def _reversed(self) -> list[Finding]:
        """Valves that open in one direction (`opens:` of the component) and cannot have opened in the run, not even with an
        outlet at its lowest physical pressure, while they would have in the other direction. A valve of which another passes
        in the opposite direction between the same nodes, as in a cross-over relief, is none of these."""
        flat, resolver, findings = self.assembly.flat, self.assembly.resolver(), list[Finding]()
        components = {path: leaf.component for path, leaf in flat.expanded.leaves.items()}
        # the inlet and the outlet of each valve, `a.p` and `b.p`, in the formula by which it opens
        opening = {path: (component.in_diagram(component.opens, path),
                          list(dict.fromkeys(_PRESSURE.findall(component.opens.text)))[:2])
                   for path, component in components.items() if component.opens is not None}
        ports_of_valves = {path: tuple(flat.names.get(f"{path}.{port}") for port in ports)
                           for path, (_, ports) in opening.items()}
        for path, (formula, ports) in opening.items():
            inlet, outlet = ports_of_valves[path]
            if inlet is None or outlet is None or inlet == outlet or (outlet, inlet) in ports_of_valves.values():
                continue
            opens = resolver.evaluate(self.assembly.model.library.formula(formula))
            a, b = flat.levels[0][inlet], flat.levels[0][outlet]
            possible = ca.substitute(opens, b, flat.unknowns[outlet].plausible.least)
            either, backwards = self.evaluate(stack([possible, ca.substitute(opens, stack([a, b]), stack([b, a]))]))
            if either.max() > 0 or not backwards.max() > 0:
                continue
            k, high = int(np.argmax(backwards > 0)), flat.unknowns[outlet].name
            first, last = (port.rpartition(".")[0] for port in ports)
            findings.append(Finding(
                "reversed", path, path, float(self.time[k]), float(backwards.max()), None, flat.unknowns[outlet].unit.text,
                f"it opens from {first} to {last} only. If it is to limit {high}, exchange its ports {first} and {last}"))
        return findings

    def first(self, n: int) -> Result:
        """The run at its first n output times."""
        along, to = self.along, slice(0, n)
        if along is not None:
            along = replace(along, x=along.x[..., to], z=along.z[..., to], quadratures=along.quadratures[..., to],
                            held=along.held[..., to])
        stays = tuple((at[at < n], stay.first(int((at < n).sum()))) for at, stay in self.stays if (at < n).any())
        time = self.time[to]
        return replace(self, time=time, x=self.x[:, to], z=self.z[:, to], u=self.u[:, to],
                       quadratures=self.quadratures[:, to], along=along, held=self.held[:, to], stays=stays, between=None,
                       instants=tuple(i for i in self.instants if i.time <= time[-1]))

    def plot(self, *names: str) -> Figure:
        """A matplotlib figure of signals over time, of the outputs under `show:` if none is named: one axes per unit."""
        chosen = names or tuple(self.assembly.model.show) or tuple(self.assembly.state_names)
        figure: Figure = facade.call("Result.plot", self, chosen)
        return figure

    @property
    def events(self) -> list[tuple[float, str]]:
        """Events of the run in order: time in s and name."""
        return [(instant.time, name) for instant in self.instants for name in instant.names]

    def names(self) -> list[str]:
        """Every variable of the diagram and its named outputs."""
        flat = self.assembly.flat
        return [*self.assembly.model.show, *flat.names, *(h.name for h in flat.held)]

    def unit(self, name: str) -> str:
        """The unit of `result.display[name]`: the one declared under `show:`, else SI."""
        output = self.assembly.model.show.get(name)
        if output is not None:
            return output.unit
        return self._si_unit(name)

    def _si_unit(self, name: str) -> str:
        output = self.assembly.model.show.get(name)
        if output is not None:
            return dimension_text(read_unit(output.unit).dimension)
        index = self.assembly.flat.names.get(name)
        if index is not None:
            return self.assembly.flat.unknowns[index].unit.text
        resolver = self.assembly.resolver()
        try:
            return dimension_text(resolver.dimension(self.assembly.model.library.formula(name)) or ())
        except ExpressionProblem as problem:
            raise unknown_signal(self.assembly, name, problem) from None

    @property
    def display(self) -> Signals:
        """Signals in the units declared under `show:`, all others in SI."""
        return Signals(self.names, lambda name: self.signals([name])[name], self.unit)

    @property
    def si(self) -> Signals:
        """All signals in SI."""
        return Signals(self.names, self._in_si, self._si_unit)

    def __getitem__(self, name: str) -> Signal:
        return Signal(self.signals([name])[name], self.unit(name), name, self.time)

    def __iter__(self) -> Iterator[str]:
        return iter(self.names())

    def __contains__(self, name: object) -> bool:
        return name in self.names()

    def _ipython_key_completions_(self) -> list[str]:
        return self.names()

    def _in_si(self, name: str) -> Array:
        output = self.assembly.model.show.get(name)
        if output is None:
            return self.signals([name])[name]
        return np.asarray(Probe(self.assembly, [output.text], si=True).values(self)[0])

    def __repr__(self) -> str:
        outputs = listing(list(self.assembly.model.show), 8)
        return brief(self, self.assembly.model.name, f"{number(float(self.time[0]))} to {number(float(self.time[-1]))} s, "
                     f"{count(len(self.time), 'point')}", f"outputs {outputs}" if outputs else "")


    def signals(self, names: Iterable[str]) -> dict[str, Array]:
        """Several signals at once, each (N,) in `result.unit(name)`; UsageError for a name that is not there."""
        names = list(names)
        return dict(zip(names, Probe(self.assembly, names).values(self), strict=True))

    def sensitivity(self, name: str, parameter: str) -> Array:
        """d signal / d parameter (N,), the signal in `result.unit(name)`, the parameter in its base unit.

        UsageError unless the run was made with `sensitivities=[parameter]`.
        """
        if self.along is None or parameter not in self.along.names:
            raise self._no_sensitivity(parameter)
        return np.asarray(Probe(self.assembly, [name]).sensitivities(self)[self.along.names.index(parameter), 0])

    def event_sensitivity(self, name: str, number: int, parameter: str) -> float:
        """d (time of the number-th event of a name, from 0) / d parameter, in s per base unit of the parameter.

        UsageError unless the event happened so often, and the run was made with `sensitivities=[parameter]`.
        """
        if self.along is None or parameter not in self.along.names:
            raise self._no_sensitivity(parameter)
        delays = [delay for i in self.instants for event, delay in zip(i.names, i.delays, strict=True) if event == name]
        if not -len(delays) <= number < len(delays):
            names = dict.fromkeys(n for _, n in self.events)
            raise UsageError([Problem("event-missing", f"'{name}' happened {len(delays)} times in this run", None,
                                      suggest(name, names) or f"Events of this run: {listing(names) or 'none'}.")])
        return float(delays[number][self.along.names.index(parameter)])

    def evaluate(self, raw: ca.SX) -> Array:
        """An expression (m,) in the raw symbols of the diagram along the run (m, N)."""
        function = ca.Function("along", list(self.assembly.arguments), [self.assembly.express(raw)])
        values = np.array(function(*columns(self))).reshape(raw.numel(), len(self.time))
        for at, stay in self.stays:
            values[:, at] = stay.evaluate(raw)
        return values

    @staticmethod
    def _no_sensitivity(parameter: str) -> UsageError:
        return UsageError([Problem("sensitivity-missing", f"this run has no sensitivities to '{parameter}'", None,
                                   f"simulate(..., sensitivities=['{parameter}'])")])

    def saved(self, names: Iterable[str] | None = None) -> SavedRun:
        """The numbers without the diagram; by default the named outputs and all unknowns."""
        chosen = list(names) if names is not None else list(dict.fromkeys(
            [*self.assembly.model.show, *(u.name for u in self.assembly.flat.unknowns),
             *(h.name for h in self.assembly.flat.held)]))
        return SavedRun(self.assembly.model.name, self.time, self.signals(chosen), {n: self.unit(n) for n in chosen},
                        f"{self.statistics['solver']} ({self.statistics['why']})" if self.statistics else "",
                        self.without_law(chosen))

    def to_pandas(self, names: Iterable[str] | None = None) -> pd.DataFrame:
        """A table with time as index; by default the named outputs and all unknowns, columns `name [unit]`."""
        return self.saved(names).to_pandas()

    def to_xarray(self, names: Iterable[str] | None = None) -> xr.Dataset:
        """A dataset over `time` with `attrs["units"]` at each variable; UsageError if xarray is missing."""
        return self.saved(names).to_xarray()

    def save(self, path: str | Path, names: Iterable[str] | None = None) -> None:
        """Write the signals in the format of the suffix, such as `run.csv` (see `saved_runs.SUFFIXES`); UsageError for an
        unknown suffix. `read_run` reads them back."""
        write_run(self.saved(names), path)


AT_ONCE = 6000  # points of one call of a function, at most


class Probe:
    """Signals of an assembly as compiled functions, for one run or for many (fitting, sweeps). With `si` all signals are
    formulas in SI: an output with the name of a variable does not replace that variable."""

    def __init__(self, assembly: Assembly, names: Iterable[str], si: bool = False):
        self.assembly, self.names, self.si = assembly, tuple(names), si
        _, x, z, p, u, _ = assembly.arguments
        signals = stack([signal_expression(assembly, name, si) for name in self.names])
        self.signals, self._by = signals, stack([x, z, p, u] if assembly.flat.delays else [x, z, p])
        self._others: dict[int, Probe] = {}

    @cached_property
    def _values(self) -> _Course:
        return _Course(self.assembly, self.signals)

    @cached_property
    def _slopes(self) -> tuple[list[int], _Course]:
        """Which of (x, z, p) the signals contain, and their derivatives by these."""
        slopes = ca.jacobian(self.signals, self._by)
        moving = sorted(set(slopes.sparsity().get_col()))
        return moving, _Course(self.assembly, ca.vec(ca.densify(slopes[:, moving])))

    def values(self, result: Result) -> Array:
        """The signals of a run (n_signals, N)."""
        values = self._values.of(result)
        for at, stay in result.stays:
            values[:, at] = self._alternative_probe(stay).values(stay)
        return values

    def _alternative_probe(self, stay: Result) -> Probe:
        """The same signals in other states."""
        if id(stay.assembly) not in self._others:
            self._others[id(stay.assembly)] = Probe(stay.assembly, self.names, self.si)
        return self._others[id(stay.assembly)]

    def sensitivities(self, result: Result) -> Array:
        """Their derivatives with respect to the parameters of `result.along` (m, n_signals, N)."""
        assert result.along is not None
        along, n_x, n = result.along, len(result.x), len(result.time)
        n_xz, n_p = n_x + len(result.z), len(result.p)
        held = {h.index: k for k, h in enumerate(result.assembly.flat.held)}
        moving, course = self._slopes
        changes = np.zeros((len(along.names), len(moving), n))
        for k, j in enumerate(moving):
            changes[:, k] = along.x[:, j] if j < n_x else along.z[:, j - n_x] if j < n_xz else \
                along.held[:, held[j - n_xz]] if j - n_xz in held else along.p[:, j - n_xz, None] if j - n_xz < n_p else \
                np.zeros((1, 1)) if along.u is None else along.u[:, j - n_xz - n_p]
        slopes = course.of(result).reshape(len(moving), len(self.names), n)
        sensitivities = np.einsum("ksn,mkn->msn", slopes, changes)
        for at, stay in result.stays:
            sensitivities[:, :, at] = self._alternative_probe(stay).sensitivities(stay)
        return np.asarray(sensitivities)


class _Course:
    """An expression in an assembly's arguments, evaluated along runs; only the arguments that it contains are passed to its
    function."""

    def __init__(self, assembly: Assembly, expression: ca.SX):
        known = {s.element_hash() for s in ca.symvar(expression)}
        self._rows = [[k for k, s in enumerate(split(a)) if s.element_hash() in known] for a in assembly.arguments]
        used = [a[k] for a, rows in zip(assembly.arguments, self._rows, strict=True) for k in rows]
        self._function = ca.Function("course", [stack(used)], [ca.densify(expression)])
        self._many: tuple[int, Buffered] | None = None

    def of(self, result: Result) -> Array:
        """Its values (numel, N)."""
        n, (t, x, z, p, u, rate) = len(result.time), self._rows
        held = [(p.index(h.index), k) for k, h in enumerate(result.assembly.flat.held) if h.index in p]
        if not (t or x or z or u or held):
            return np.tile(self._function([*result.p[p], *np.ones(len(rate))]).full(), (1, n))
        arguments = np.tile(result.p[p, None], (1, n))
        for row, k in held:
            arguments[row] = result.held[k]
        return self._evaluated(np.vstack([
            result.time[None, :][t], result.x[x], result.z[z], arguments, result.u[u], np.ones((len(rate), n))]))

    def _evaluated(self, arguments: Array) -> Array:
        """The function at columns (k, N), through buffers: as matrices of CasADi they would take longer to hand over than
        to evaluate. A map over very many points takes longer to make than to evaluate: these are evaluated in parts."""
        n = arguments.shape[1]
        if n > AT_ONCE:
            parts = [self._evaluated(arguments[:, k:k + AT_ONCE]) for k in range(0, n - n % AT_ONCE, AT_ONCE)]
            remainder = self._evaluated(arguments[:, -AT_ONCE:])[:, AT_ONCE - n % AT_ONCE:] if n % AT_ONCE else np.zeros((0,
                                                                                                                          0))
            return np.column_stack([*parts, remainder] if remainder.size else parts)
        if self._many is None or self._many[0] != n:
            self._many = (n, Buffered(self._function.map(n)))
        values, = self._many[1](arguments).values()
        return np.ascontiguousarray(values.reshape((-1, n), order="F"))


def columns(result: Result, at: NDArray[np.intp] | None = None) -> tuple[Array, ...]:
    """The arguments of an assembly's functions along a run, one column per time, or at some of its times."""
    if at is not None:
        held = result.held[:, at] if result.assembly.flat.held else result.held
        u = result.u[:, at] if result.u.shape[-1] == len(result.time) else result.u
        result = replace(result, time=result.time[at], x=result.x[:, at], z=result.z[:, at], u=u, held=held)
    n = len(result.time)
    return (result.time[None, :], result.x, result.z, with_held(result, result.p, result.held), result.u, np.ones((1, n)))


def _stretches(result: Result, settle: Settle | None = None) -> Iterator[RunSection]:
    """The run part by part, each in the states that were integrated there; `settle` gives the algebraic unknowns of a run of
    one part."""
    default_times = np.arange(len(result.time))
    if result.stays:
        default_times = np.setdiff1d(default_times, np.concatenate([at for at, _ in result.stays]))
    for part, at in ((result, default_times), *((stay, np.arange(len(stay.time))) for _, stay in result.stays)):
        if len(at):
            whole = len(at) == len(part.time)
            yield RunSection(part.assembly, part.time if whole else part.time[at], part.x if whole else part.x[:, at],
                             partial(_columns_of, part, settle, at))


def _columns_of(part: Result, settle: Settle | None, points: NDArray[np.intp], at: NDArray[np.intp]) -> tuple[Array, ...]:
    arguments = columns(part, points[at])
    return arguments if settle is None else (*arguments[:2], settle(points[at]), *arguments[3:])


def with_held(result: Result, p: Array, held: Array) -> Array:
    """Parameters (n_p,), or how they move, at each time of a run (n_p, N), with the held variables (n_h, N) among them."""
    parameters = np.tile(p[:, None], (1, len(result.time)))
    if result.assembly.flat.held:
        parameters[[h.index for h in result.assembly.flat.held]] = held
    return parameters


def signal_expression(assembly: Assembly, name: str, si: bool = False) -> ca.SX:
    """A signal in the assembly's arguments: an output in its declared unit, any other formula (with `si` every one) in SI;
    UsageError for an unknown name."""
    output = None if si else assembly.model.show.get(name)
    try:
        if output is None:
            return assembly.expression(assembly.model.library.formula(name))
        unit = read_unit(output.unit)
        return (assembly.expression(output.expr) - unit.offset) / unit.scale
    except ExpressionProblem as problem:
        raise unknown_signal(assembly, name, problem) from None


def unknown_signal(assembly: Assembly, name: str, problem: ExpressionProblem) -> UsageError:
    """The error for a formula of signals that is wrong; positions that no equation uses must be requested by `also`."""
    if problem.code != "name-unknown":
        return UsageError([Problem(problem.code, problem.message, None, problem.hint)])
    flat = assembly.flat
    hint = suggest(name, [*assembly.model.show, *flat.names]) or problem.hint
    node, _, member = name.rpartition(".")
    if member in ("x", "phi") and any(f"{node}.{flow}" in flat.names for flow in ("v", "w")):
        hint = f"No equation uses this position; ask for it: simulate(..., also=['{name}'])."
    return UsageError([Problem(problem.code, problem.message, None, hint)])
