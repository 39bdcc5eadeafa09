"""Relations between runs of one machine, and between two descriptions of one law: whatever comes of them must agree.

    python -m benchmarks.fuzz.relations                    # all bundled machines; goes on where it was stopped
    python -m benchmarks.fuzz.relations --machine examples/spring.yaml
"""

from __future__ import annotations

import argparse
import json
import re
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from random import Random
from typing import Any

import casadi as ca
import numpy as np

import heavebond as hb
from benchmarks.fuzz.campaign import Judge
from benchmarks.fuzz.diagrams import OWN, diagram
from benchmarks.fuzz.metamorphic import DIFFERENCES, RTOL, Compared, Reference, compared_to, difference, signals, write
from benchmarks.fuzz.mutants import Mutant, files_of, kind_of
from benchmarks.fuzz.relations import RELATIONS, Same
from benchmarks.fuzz.sheets import Sheet, over_values, renamed
from benchmarks.fuzz.trying import sandbox
from heavebond.commands.arguments import with_settings
from heavebond.core.errors import HeavebondError
from heavebond.core.units import read_unit
from heavebond.equations.resolver import Unknown
from heavebond.language.library import bundled
from heavebond.language.symbols import split, stack
from heavebond.linear.linear_system import StateSpace, state_space
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.idas import Tolerances
from heavebond.numerics.result import Result
from heavebond.numerics.simulator import Simulator

HERE = Path(__file__).parent
SCALES = (1e-9, 1e-6, 1e9)  # of amplitudes and of times
PARTS = (7, 1000)  # into which an output interval is divided
SHIFTS = (1.0, 1.4e9)  # s; the second is a UNIX time stamp
SHARE = 1e-6  # of its largest value, to which a scaled signal agrees
SPACINGS = 4  # of the numbers at a time, to which it is known
SMALL = 1e-5  # of a parameter, by which an input of the linear comparison moves
PEAK = 1e-4  # share of the size of a signal, to which its extremes agree
KNOWN = 1e-6  # share of a state, above which a small motion is compared; the run is to 1e-12
BEND = 1e-3  # share of a small motion that is not linear, or below the tolerance of the run
CHANGE = 1.03  # factor of a parameter that is set in several ways
PROBES = 3  # random points at which an invariance is tried
MOST_POINTS = 50_000  # output points of a run
QUANTITY = re.compile(r"-?[0-9.]+(e-?[0-9]+)? [A-Za-z].*")
CANCELLED = 1e-3  # nominal sizes of a term, of whose rounding a difference may be
REACH = 1e-9  # share to which equations are invariant under a change of scale

BOUNDS = {"parameter-bound", "start-bound", "requirement", "number-too-large"}  # of declared ranges, which no factor leaves


@dataclass(frozen=True)
class Check:
    """What came of one relation on one machine; see `metamorphic.Compared` for the outcomes."""

    machine: str
    relation: str
    variant: str
    outcome: str
    what: str

    def as_dict(self) -> dict[str, object]:
        """For a line of JSON."""
        return asdict(self)


class Machine(Reference):
    """A diagram with its two runs, and what the relations ask of it."""

    def __init__(self, path: Path):
        super().__init__(path)
        self.path = path
        self.plain = self.run(self.assembly, self.times)

    def run(self, assembly: Assembly, times: Array, parameters: Mapping[str, float] | None = None) -> Result:
        """A run at the tolerances of a user."""
        return Simulator(assembly, times=times, dense=True).run(parameters)

    def same(self, relation: str, values: Mapping[str, Array], *results: Result, least: float = SHARE) -> Compared:
        """Whether signals by name agree with those of the diagram itself."""
        return difference(self, values, relation, *results, least=least)


# -- scale -------------------------------------------------------------------------------------------------------------
def _rates(assembly: Assembly) -> ca.Function:
    """(t, x, z, p, u, rate) -> x' and the residuals of the loops."""
    return ca.Function("rates", list(assembly.arguments), [assembly.ode, assembly.alg])


Change = Callable[[float, Array, Array], tuple[float, Array, Array, Array]]


def _invariant(assembly: Assembly, times: Array, change: Change, rates_by: Array, values_by: Array | None = None) -> bool:
    """Whether at changed values (t, x, z, p) all rates are those times `rates_by` and all variables those times `values_by`,
    each counted by itself: at random points near the run. The residual of a loop is everywhere that times one factor."""
    rates, random, loops = _rates(assembly), np.random.default_rng(1), []
    sizes = np.array([u.nominal for u in assembly.flat.unknowns])
    u = np.zeros(assembly.arguments[4].numel())
    for _ in range(PROBES):
        t = float(times[0] + random.random() * (times[-1] - times[0]))
        x = random.normal(size=len(assembly.x_nominal)) * assembly.x_nominal
        z = random.normal(size=len(assembly.z_nominal)) * assembly.z_nominal
        ode, alg = (np.array(v).ravel() for v in rates(t, x, z, assembly.p, u, 1.0))
        other_t, other_x, other_z, other_p = change(t, x, z)
        ode_2, alg_2 = (np.array(v).ravel() for v in rates(other_t, other_x, other_z, other_p, u, 1.0))
        if not (np.isfinite(ode).all() and np.isfinite(ode_2).all() and np.isfinite(alg).all() and np.isfinite(alg_2).all()):
            return False
        pairs = [(ode * rates_by, ode_2, assembly.x_nominal * np.abs(rates_by))]
        if values_by is not None:
            pairs.append((np.array(assembly.values(t, x, z, assembly.p, u, 1.0)).ravel() * values_by,
                          np.array(assembly.values(other_t, other_x, other_z, other_p, u, 1.0)).ravel(), sizes * values_by))
        # differences of what is equal are no more than rounding; a value that is no number has its reason in a constant
        if not all(np.all(np.isnan(same) | (np.abs(other - same) <= REACH * (np.abs(same) + CANCELLED * size)))
                   for same, other, size in pairs):
            return False
        with np.errstate(divide="ignore", invalid="ignore"):
            loops.append(np.where(alg == alg_2, 1.0, alg_2 / alg))
    return all(np.all(np.abs(k / loops[0] - 1) < np.sqrt(REACH)) for k in loops[1:])


def amplitude(machine: Machine, variant: float) -> Compared:
    """A linear machine with all sources and initial values times a factor gives the result times that factor."""
    name, sheet = "amplitude", machine.sheet
    if machine.assembly.flat.events or machine.assembly.flat.inputs:
        return Compared(name, "not applicable", "events or measured inputs")
    driven = {n: {**e, "u": f"=all_sources*({e['u'].lstrip('= ')})"} if e["is"].endswith("Source") and
              isinstance(e.get("u"), str) and " " in e["u"] else e for n, e in sheet.parts.items()}
    assembly = machine.assembly if driven == sheet.parts else hb.assemble(hb.load(write(Same(
        replace(sheet, parts=driven, parameters={**sheet.parameters, "all_sources": "1"}), lambda n: n), machine.path)))
    sources = _sources(assembly)
    if sources is None:
        return Compared(name, "not applicable", "not linear")
    p = assembly.p.copy()
    p[sources] *= variant
    scaled = replace(assembly, p=p)

    def change(t: float, x: Array, z: Array) -> tuple[float, Array, Array, Array]:
        return t, variant * x, variant * z, p

    if not _invariant(assembly, machine.times, change, np.full(len(assembly.x_nominal), variant)):
        return Compared(name, "not applicable", "not homogeneous")
    before, after = (Simulator(a, times=machine.times[:2]).run().start.x for a in (assembly, scaled))
    if np.any(np.abs(after / variant - before) > REACH * (np.abs(before) + REACH * assembly.x_nominal)):
        return Compared(name, "not applicable", "another start")
    result = machine.run(scaled, machine.times)
    plain = machine.fine.x
    size = np.abs(plain).max(axis=1, keepdims=True)
    off = np.abs(result.x / variant - plain) / np.where(size > 0, size, 1.0)
    return _judged(machine, name, off, list(assembly.state_names))


def _sources(assembly: Assembly) -> list[int] | None:
    """The parameters (indices) that enter the equations linearly like the states: sources, lengths at rest, initial
    values. None where the equations are not linear in states and sources together."""
    _, x, z, p, *_ = assembly.arguments
    rates = stack([assembly.ode, assembly.alg])
    inner = stack([x, z])
    if inner.numel() and any(ca.which_depends(rates, inner, 2, True)):
        return None
    starts = [k for k, n in enumerate(assembly.parameter_names) if n.startswith("initial.")]
    found = []
    for k, symbol in enumerate(split(p)):
        slope = ca.jacobian(rates, symbol)
        others = ca.symvar(slope)
        hashes = {s.element_hash() for s in others}
        if slope.nnz() and not hashes & {s.element_hash() for s in (*split(inner), symbol)}:
            found.append(k)
    chosen = stack([p[k] for k in found])
    while found and any(ca.which_depends(rates, stack([inner, chosen]), 2, True)):
        found.pop()  # two that multiply each other are no sources both
        chosen = stack([p[k] for k in found])
    return sorted({*found, *starts})


def time_scale(machine: Machine, variant: float) -> Compared:
    """A machine whose parameters, nominal sizes, ranges and limits are counted in another unit of time does the same in the
    time times that factor."""
    assembly, name = machine.assembly, "time scale"
    if assembly.flat.inputs:
        return Compared(name, "not applicable", "measured inputs")
    powers = {u.name: _power(u.unit) for u in assembly.flat.unknowns}
    p = assembly.p * np.array([variant ** _power(q.unit) for q in assembly.flat.parameters])
    columns = [*assembly.reduced.states, *assembly.reduced.algebraic]
    factors = np.array([variant ** (powers[assembly.flat.unknowns[j].name] - order) for j, order in columns])
    n_x = len(assembly.x_nominal)
    if not (np.isfinite(p).all() and np.isfinite(factors).all()) or np.abs(p).max(initial=0.0) > 1e90:
        return Compared(name, "not applicable", "numbers too large")

    def change(t: float, x: Array, z: Array) -> tuple[float, Array, Array, Array]:
        return variant * t, factors[:n_x] * x, factors[n_x:] * z, p

    values_by = np.array([variant ** powers[u.name] for u in assembly.flat.unknowns])
    if not _invariant(assembly, machine.times, change, factors[:n_x] / variant, values_by):
        return Compared(name, "not applicable", "a constant of the equations has a unit of time")
    instants = stack([e for event in assembly.flat.events for e in (event.first, event.period) if e is not None])
    first, later = (np.array(ca.Function("instants", [assembly.arguments[3]], [assembly.express(instants)])(v)).ravel()
                    for v in (assembly.p, p))
    if np.any(np.abs(later - variant * first) > REACH * np.abs(later)):
        return Compared(name, "not applicable", "an event at a time that is a number")
    scaled = _with_scaled_sizes(replace(assembly, p=p), {n: variant ** k for n, k in powers.items()}, factors, 1 / variant)
    before, after = (Simulator(a, times=t[:2]).run().start.x for a, t in (
        (assembly, machine.times), (scaled, variant * machine.times)))
    if np.any(np.abs(after / factors[:n_x] - before) > SHARE * (np.abs(before) + REACH * assembly.x_nominal)):
        return Compared(name, "not applicable", "another start")
    result = machine.run(scaled, variant * machine.times)
    flat = assembly.flat
    values = {n: v / variant ** _power(flat.unknowns[flat.names[n]].unit)
              for n, v in signals(result, {n: n for n in machine.names}).items()}
    shifted = replace(result, instants=tuple(replace(i, time=i.time / variant) for i in result.instants)) \
        if result.instants else result
    return machine.same(name, values, shifted)


def _with_scaled_sizes(assembly: Assembly, by: Mapping[str, float], columns: Array, rate: float) -> Assembly:
    """An assembly whose unknowns have nominal sizes, ranges and limits times factors `by` name; `columns` (n_x + n_z,) are
    those of states and algebraic unknowns, `rate` that of 1/s."""

    def scaled(u: Unknown) -> Unknown:
        k, usual = by[u.name], u.plausible
        usual = replace(usual, typical=k * usual.typical, per_second=k * rate * usual.per_second, largest=k * usual.largest,
                        least=k * usual.least)
        return replace(u, nominal=k * u.nominal, low=k * u.low, high=k * u.high,
                       start=None if u.start is None else k * u.start, plausible=usual)

    flat = assembly.flat
    factor = {s.element_hash(): by[u.name] for s, u in zip(flat.levels[0], flat.unknowns, strict=True)}
    factor |= {s.element_hash(): rate ** -_power(q.unit) for s, q in zip(split(flat.p), flat.parameters, strict=True)}
    bounds = {s: (factor.get(s, 1.0) * low, factor.get(s, 1.0) * high) for s, (low, high) in flat.bounds.items()}
    flat = replace(flat, unknowns=tuple(scaled(u) for u in flat.unknowns), bounds=bounds)
    n_x = len(assembly.x_nominal)
    reduced = replace(assembly.reduced, flat=flat, system=replace(assembly.reduced.system, flat=flat))
    return replace(assembly, reduced=reduced, x_nominal=assembly.x_nominal * columns[:n_x],
                   z_nominal=assembly.z_nominal * columns[n_x:], memo={})


def _power(unit: Any) -> int:
    """The exponent of the second in a unit."""
    return int(dict(unit.dimension).get("s", 0))


# -- output points and time --------------------------------------------------------------------------------------------
def output_grid(machine: Machine, variant: int) -> Compared:
    """Values at common points and the verdict do not depend on the output interval."""
    times = machine.times
    if len(times) * variant > MOST_POINTS:
        times = times[: max(2, MOST_POINTS // variant)]
    finer = np.unique(np.concatenate([np.linspace(a, b, variant, endpoint=False) for a, b in pairwise(times)]
                                     + [times[-1:]]))
    at = np.searchsorted(finer, times)
    at[-1] = len(finer) - 1
    result = machine.run(machine.assembly, finer)
    if len(times) == len(machine.times) and result.verdict.status != machine.plain.verdict.status:
        return Compared("output grid", "different",
                        f"verdict {machine.plain.verdict.status} becomes {result.verdict.status}")
    values = {n: np.concatenate([v[at], machine.values[n][len(times):]])
              for n, v in signals(result, {n: n for n in machine.names}).items()}
    return machine.same("output grid", values, result)


def extremes(machine: Machine, variant: int) -> Compared:
    """The largest and smallest values of a run do not depend on the output interval."""
    name, step = "extremes", machine.times[::variant]
    if len(step) < 5:
        return Compared(name, "not applicable", "few points")
    if step[-1] != machine.times[-1]:
        step = np.append(step, machine.times[-1])
    few = machine.run(machine.assembly, step)
    if machine.until < len(machine.times):
        return Compared(name, "not applicable", "sensitive")
    shown = [n for n in machine.names if n in machine.assembly.state_names]
    found, reference = few.figures(shown), machine.plain.figures(shown)
    for n in shown:
        for which in ("most", "least"):
            one, other = getattr(found[n], which), getattr(reference[n], which)
            off = abs(one - other) / machine.sizes[n]
            if off > PEAK:
                return Compared(name, "different", f"{which} {n} differs by {off:.2g} of its size", len(shown))
    return Compared(name, "same", "", len(shown))


SHIFTED = {"Step": ("t_s",), "Pulse": ("t_s",), "Ramp": ("t_s", "t_e"), "SquareWave": ("t_s",)}


def start_time(machine: Machine, variant: float) -> Compared:
    """A run that begins at another time, with all that depends on the time shifted with it, is the same run."""
    name, sheet = "start time", machine.sheet
    if machine.assembly.flat.inputs:
        return Compared(name, "not applicable", "measured inputs")
    formula = f"(time - {variant!r} s)"
    moved = over_values(sheet, lambda text: text, lambda text: renamed(text, lambda n: formula if n == "time" else n)
                        if "time" in text else text)
    parts = {n: _later(n, entry, variant) for n, entry in moved.parts.items()}
    rates = stack([machine.assembly.ode, machine.assembly.alg])
    clock = any(ca.which_depends(rates, machine.assembly.arguments[0], 1, True))
    if any(part is None for part in parts.values()) or (clock and moved == sheet and parts == sheet.parts) \
            or _clocked(machine, sheet):
        return Compared(name, "not applicable", "components count from time 0")
    later = {n: part for n, part in parts.items() if part is not None}
    other = write(Same(replace(moved, parts=later), lambda n: n), machine.path)
    result = machine.run(hb.assemble(hb.load(other)), variant + machine.times)
    back = replace(result, time=machine.times, instants=tuple(replace(i, time=i.time - variant) for i in result.instants)) \
        if not result.stays else result
    values = signals(result, {n: n for n in machine.names})
    # a signal moves while the time that is rounded passes
    fastest = max((float(np.abs(np.diff(machine.values[n])).max(initial=0.0)) / machine.sizes[n] for n in values),
                  default=0.0)
    rounding = SPACINGS * float(np.spacing(variant + machine.times[-1])) / float(machine.times[1] - machine.times[0])
    return machine.same(name, values, back, least=SHARE + rounding * fastest)


def _later(name: str, entry: dict[str, Any], shift: float) -> dict[str, Any] | None:
    """A part whose instants are later; None where one of them is no number."""
    found = dict(entry)
    for key in SHIFTED.get(entry["is"], ()):
        text = entry.get(key, "0 s")
        if not isinstance(text, str) or (key not in entry and key != "t_s"):
            continue
        found[key] = f"={text.lstrip('= ')} + {shift!r} s"
    return found


def _clocked(machine: Machine, sheet: Sheet) -> bool:
    """Whether a component other than those of SHIFTED looks at the clock."""
    for leaf in machine.assembly.flat.expanded.leaves.values():
        text = leaf.component.path.read_text(encoding="utf-8")
        if leaf.component.name not in SHIFTED and re.search(r"\btime\b(?! constant)|\bevery:|\bat: (?!0[,}])",
                                                             re.sub(r"#.*|doc: .*", "", text.partition("\nequations")[2])):
            return True
    return False


# -- parameters --------------------------------------------------------------------------------------------------------
def parameter_ways(machine: Machine, variant: int) -> Compared:
    """A parameter that is set in the file, by `--set`, by `with_parameters` or in a call gives the same run."""
    name, random = "parameter in six ways", Random(variant)
    numbers = [(part, key) for part, entry in machine.sheet.parts.items() for key, text in entry.items()
               if isinstance(text, str) and QUANTITY.fullmatch(text)
               and f"{part}.{key}" in machine.assembly.parameter_names]
    if not numbers:
        return Compared(name, "not applicable", "no parameter")
    part, key = random.choice(numbers)
    path = f"{part}.{key}"
    value = CHANGE * machine.assembly.parameter_values[path]
    unit = machine.assembly.flat.parameters[machine.assembly.parameter_names.index(path)].unit.text
    written = f"{value!r} {unit}"
    parts = {**machine.sheet.parts, part: {**machine.sheet.parts[part], key: written}}
    file = write(Same(replace(machine.sheet, parts=parts), lambda n: n), machine.path)
    model = hb.load(machine.path)
    span: dict[str, Any] = {"until": float(machine.times[-1]), "every": float(machine.times[1] - machine.times[0])}
    runs = {"file": lambda: hb.simulate(hb.load(file), **span),
            "--set": lambda: hb.simulate(with_settings(model, [f"{path}={written}"]), **span),
            "with_parameters": lambda: hb.simulate(model.with_parameters({path: value}), **span),
            "assembly": lambda: hb.simulate(hb.assemble(model).with_parameters({path: written}), **span),
            "simulate(parameters=)": lambda: hb.simulate(model, parameters={path: value}, **span),
            "Simulator.run": lambda: _auto(model, path, value, span)}
    found = {way: _outcome(run) for way, run in runs.items()}
    first = found["file"]
    for way, other in found.items():
        if isinstance(first, str) or isinstance(other, str):
            if first != other:
                return Compared(name, "different", f"{path}: file {_brief(first)}, {way} {_brief(other)}")
        elif first.x.shape == other.x.shape and list(first.assembly.state_names) == list(other.assembly.state_names):
            size = np.abs(first.x).max(axis=1, keepdims=True) + 1e-3 * first.assembly.x_nominal[:, None]
            off = float((np.abs(first.x - other.x) / size).max(initial=0.0))
            if off > SHARE and machine.until == len(machine.times) and not first.instants:
                return Compared(name, "different", f"{path}: file and {way} differ by {off:.2g}")
    return Compared(name, "same", path, len(runs))


def _auto(model: hb.Model, path: str, value: float, span: dict[str, Any]) -> Result:
    from heavebond.numerics.simulation import run_by_auto

    return run_by_auto(Simulator(hb.assemble(model), span["until"], every=span["every"], solver="auto"), {path: value})


def _outcome(run: Callable[[], Result]) -> Result | str:
    try:
        return run()
    except HeavebondError as error:
        return " ".join(sorted({p.code for p in error.problems}))


def _brief(found: Result | str) -> str:
    return found if isinstance(found, str) else "runs"


# -- linear ------------------------------------------------------------------------------------------------------------
SOURCES = {"ForceSource": "u", "TorqueSource": "u", "FlowSource": "u", "VoltageSource": "u", "CurrentSource": "u",
           "PressureSource": "u", "HeatSource": "u"}


def small_motion(machine: Machine, variant: int) -> Compared:
    """A small step of a source, with a lag, moves the machine as its state space from a steady start says."""
    name, sheet = "linear and nonlinear", machine.sheet
    fixed = [(part, SOURCES[e["is"]]) for part, e in sheet.parts.items() if e["is"] in SOURCES and
             isinstance(text := e.get(SOURCES[e["is"]]), str) and QUANTITY.fullmatch(text)]
    if not fixed or machine.assembly.flat.events or machine.assembly.flat.inputs:
        return Compared(name, "not applicable", "no source, or events")
    part, key = fixed[variant % len(fixed)]
    text = sheet.parts[part][key]
    number, _, unit = text.partition(" ")
    step = SMALL * abs(float(number)) or SMALL
    lag = 0.1 * float(machine.times[-1])
    steady = replace(sheet, initial={"start": "steady"})
    moving = replace(steady, parts={**sheet.parts, part: {**sheet.parts[part], key:
                                                          f"={text} + {step!r} {unit}*(1 - exp(-time/{lag!r} s))"}})
    file = write(Same(steady, lambda n: n), machine.path)
    try:
        model = hb.load(file)
        states = [n for n in hb.assemble(model).state_names if not n.startswith("der(")]
        system = state_space(model, [f"{part}.{key}"], states)
    except HeavebondError as error:
        return Compared(name, "not applicable", error.problems[0].code)
    if not system.proper or not len(system.a):
        return Compared(name, "not applicable", "improper")
    result = Simulator(hb.assemble(hb.load(write(Same(moving, lambda n: n), machine.path))), times=machine.times,
                       tolerances=Tolerances(RTOL / 1e4, 1e-14)).run()
    y, seen = _response(system, step * float(read_unit(unit).scale), lag, machine.times), 0
    for k, state in enumerate(states):
        moved = result.si[state] - result.si[state][0]
        size = max(float(np.abs(y[:, k]).max()), float(np.abs(moved).max()))
        # the run knows a state to its tolerance, of which the motion must be many times as large
        if size < KNOWN * max(float(np.abs(result.si[state]).max()), machine.sizes.get(state, 1.0)):
            continue
        seen += 1
        off = float(np.abs(moved - y[:, k]).max())
        if off > BEND * size:
            return Compared(name, "different", f"{part}.{key} to {state}: {off / size:.2g} of the motion", len(states))
    return Compared(name, "same" if seen else "not applicable", part, seen)


def _response(system: StateSpace, step: float, lag: float, times: Array) -> Array:
    """The outputs (N, k) after a step of the input through a lag, by the matrix exponential with lag and step as states."""
    from scipy.linalg import expm

    n = len(system.a)
    matrix, state, found = np.zeros((n + 2, n + 2)), np.zeros(n + 2), []
    matrix[:n, :n], matrix[:n, n:n + 1], matrix[n, n], matrix[n, n + 1] = system.a, system.b, -1 / lag, 1 / lag
    state[n + 1] = step
    for before, now in pairwise([times[0], *times]):
        state = expm(matrix * (now - before)) @ state
        found.append(system.c @ state[:n] + system.d[:, 0] * state[n])
    return np.array(found)


def _judged(machine: Machine, relation: str, off: Array, names: list[str]) -> Compared:
    """The outcome for deviations (n, N) in sizes of the signals; what the run itself is unsure of is allowed."""
    off = off[:, : machine.until]
    allowed = SHARE + 30 * machine.error[:, : machine.until].max(axis=0, initial=0.0)
    over = off / allowed
    outcome = "sensitive" if machine.until < len(machine.times) else "same"
    if over.size and not over.max() <= 1:
        k, j = np.unravel_index(int(np.nanargmax(over)), over.shape)
        return Compared(relation, "different", f"{names[k]} at {machine.times[j]:.6g} s: off by {off[k, j]:.2g} of its "
                        f"size, {allowed[j]:.2g} are allowed", len(names))
    return Compared(relation, outcome, f"{off.max(initial=0.0):.1e}", len(names))


OF_RUNS: dict[str, tuple[Callable[[Machine, Any], Compared], tuple[Any, ...]]] = {
    "amplitude": (amplitude, SCALES), "time scale": (time_scale, SCALES), "output grid": (output_grid, PARTS),
    "extremes": (extremes, PARTS[:1]), "start time": (start_time, SHIFTS),
    "parameter in six ways": (parameter_ways, (0, 1)),
    "linear and nonlinear": (small_motion, (0,))}


# -- one machine -------------------------------------------------------------------------------------------------------
def checks_of(path: Path, label: str, wanted: Mapping[str, tuple[Any, ...]] | None = None, seed: int = 7) -> list[Check]:
    """Try all relations on the diagram at `path`: those of runs, then those that write it differently (see
    `relations`). `wanted` are the variants of chosen relations."""
    try:
        machine = Machine(path)
    except HeavebondError as error:
        return [Check(label, "reference", "", "not applicable", error.problems[0].code)]
    found = []
    chosen = {n: variants for n, (_, variants) in OF_RUNS.items()} if wanted is None else wanted
    for name, variants in chosen.items():
        if name in RELATIONS:
            continue
        for variant in variants:
            found.append(_check(label, name, variant, partial(OF_RUNS[name][0], machine, variant)))
    for name in RELATIONS if wanted is None else [n for n in wanted if n in RELATIONS]:
        found.append(_check(label, name, seed, partial(compared_to, machine, path, name, seed)))
    return found


def _check(machine: str, relation: str, variant: Any, run: Callable[[], Compared]) -> Check:
    try:
        found = run()
    except HeavebondError as error:
        beyond = relation in ("amplitude", "time scale") and {p.code for p in error.problems} <= BOUNDS
        return Check(machine, relation, f"{variant}", "not applicable" if beyond else "refused", str(error)[:400])
    except Exception:
        return Check(machine, relation, f"{variant}", "traceback", traceback.format_exc(limit=-6))
    return Check(machine, relation, f"{variant}", found.outcome, found.what)


@contextmanager
def placed(label: str) -> Iterator[Path]:
    """Copy a bundled machine, or the random diagram `seed N`, to a temporary folder."""
    if label.startswith("seed "):
        import tempfile

        with tempfile.TemporaryDirectory() as name:
            path = Path(name) / "random.yaml"
            path.write_text(diagram(int(label.split()[1])).text(), encoding="utf-8")
            (Path(name) / "components").symlink_to(OWN.resolve())
            yield path
    else:
        folder, _, name = label.partition("/")
        with sandbox(Mutant(0, bundled("models") / folder, name, dict(files_of(label)), "", ())) as path:
            yield path


def machines() -> list[str]:
    """Every bundled diagram."""
    models = bundled("models")
    files = [f for f in sorted(models.rglob("*.yaml")) if kind_of(f.read_text(encoding="utf-8")) == "model"]
    names = [f.relative_to(models).as_posix() for f in files if "data" not in f.parts and "components" not in f.parts]
    return sorted(names, key=lambda name: not name.startswith("examples/"))  # small ones first


def tried(label: str) -> list[Check]:
    """All relations of a machine, in a folder of its own."""
    with placed(label) as path:
        return checks_of(path, label)


def _unfinished(task: tuple[str], outcome: str, what: str, seconds: float) -> list[Check]:
    return [Check(task[0], "all", "", "long" if outcome == "hang" else outcome, what)]


def summary(results: Path) -> dict[str, Any]:
    """How many checks of each relation ended how, and the machines of those that differ."""
    lines = [json.loads(line) for line in results.read_text(encoding="utf-8").splitlines()]
    counts: dict[str, Counter[str]] = {}
    differences: dict[str, list[str]] = {}
    for line in lines:
        counts.setdefault(line["relation"], Counter())[line["outcome"]] += 1
        if line["outcome"] in DIFFERENCES:
            differences.setdefault(f"{line['relation']} {line['variant']}: {line['outcome']}", []).append(line["machine"])
    return {"machines": len({line["machine"] for line in lines}), "checks": len(lines),
            "relations": {n: dict(found.most_common()) for n, found in counts.items()},
            "differences": differences}


def main() -> None:
    """Try the machines that are not in the results yet, and write the counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--machine", help="print all checks of one bundled machine, or of `seed N`, and stop")
    parser.add_argument("--seeds", type=int, default=200, help="random diagrams besides")
    parser.add_argument("--limit", type=float, default=120.0, help="seconds of processor time for one machine")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="stop after so long")
    parser.add_argument("--results", type=Path, default=HERE / "relations.jsonl")
    parser.add_argument("--summary", type=Path, default=HERE / "relations.json")
    options = parser.parse_args()
    if options.machine:
        for check in tried(options.machine):
            print(check.relation, check.variant, check.outcome, check.what)
        return
    done = {json.loads(line)["machine"] for line in options.results.read_text().splitlines()} \
        if options.results.exists() else set()
    judge, end = Judge(options.limit, tried, _unfinished), time.monotonic() + 60 * options.minutes
    with options.results.open("a", encoding="utf-8") as out:
        for label in [*machines(), *(f"seed {k}" for k in range(options.seeds))]:
            if label in done:
                continue
            for check in judge(label):
                out.write(json.dumps(check.as_dict()) + "\n")
                if check.outcome in DIFFERENCES:
                    print(f"{check.machine}, {check.relation} {check.variant}: {check.outcome}: {check.what}", flush=True)
            out.flush()
            if time.monotonic() > end:
                break
    judge.close()
    found = summary(options.results)
    options.summary.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
    differences = sum(map(len, found["differences"].values()))
    print(f"{found['checks']} checks of {found['machines']} machines, {differences} differences")
