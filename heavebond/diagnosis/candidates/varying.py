"""Parameters that vary, as candidates: a factor of a part's parameter that depends on a variable of the part or on time.

The forms of the factors are components with `attaches: parameter` (two values by direction, linear, piecewise linear, a
step in time). With amplitude 0 the factor is 1, so that the exact sensitivity scores them like any other effect.
Parameters times variables times forms are many. A candidate is made only if the records can show it: the parameter moves
the channels, and the variable moves. What is left out is stated with its reason.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from heavebond.core.units import Range, Unit, declared_unit, is_generic, read_unit
from heavebond.diagnosis.candidates.catalogue import Candidate, EffectNumber, quantity, snake
from heavebond.equations.expanded import Leaf
from heavebond.equations.flatten import Flat
from heavebond.equations.places import nodes_of
from heavebond.equations.variation import fixed_because
from heavebond.estimation.residuals import Residuals, Run
from heavebond.language.definition import FACTOR, Component, Parameter, SearchRange, Value
from heavebond.language.edits import Change, Part
from heavebond.language.library import Library
from heavebond.language.model import Model
from heavebond.numerics.dae import Array
from heavebond.numerics.quick_simulation import QuickSimulator
from heavebond.numerics.result import Probe
from heavebond.text.expression import Name

ONSET = "Onset"  # the component that is 0 before a time and 1 after it
BY_RECORD = "record-dependent parameter"
SECOND = declared_unit("s")


@dataclass(frozen=True)
class VaryingConstants:
    """Constants of the choice of candidates.

    seen: length of the response of all channels to a change of a parameter by its whole value, in standard deviations of the
        noise, from which its variation is a candidate. Origin: an amplitude of at most 0.95 is seen from 5 standard
        deviations on, as a score is. Doubled: variations of weak parameters are left out.
    steady: share of its size below which the span of a variable counts as steady. Origin: a linear variation over a
        hundredth of a value is a constant. Doubled: fewer variables.
    alike: correlation of two variables from which one stands for both. Origin: the linear variations with them are one to
        the accuracy of a score (1 %). Doubled distance to 1: fewer candidates.
    both: share of the time that a variable spends on either side of zero where two values by direction are a candidate.
        Origin: each value needs some data. Doubled: one-sided motions have linear variations only.
    variables: variables at most with which one parameter varies. Origin: time of a search. Doubled: up to twice the scores.
    inside: share of the duration at its beginning and end in which no change of a parameter is sought. Origin: a change
        there is shown by a twentieth of the samples at most. Doubled: later first changes.
    width: width of the transition of an onset, in half durations of the shortest record. Origin: half the distance of the
        times of the scan (`search.onset`), so that a refit from the best of them feels the transition. Doubled: an abrupt
        onset leaves more.
    beyond: half durations of the shortest record before the begin and after the end of a record at which an onset may lie.
        Origin: five widths of its transition, so that the effect acts in the whole record, or in no part of it, to 1e-4.
        Doubled: the same.
    between: times and parts of its value that a fixed parameter may have in one record. Origin: more is another machine.
        Doubled: a wider search.
    most: candidates at most. Origin: as many as the rest of the catalogue of a rig of ten parts. Doubled: twice the time.
    """

    seen: float = 5.0
    steady: float = 0.01
    alike: float = 0.995
    both: float = 0.1
    variables: int = 3
    inside: float = 0.05
    width: float = 0.005
    beyond: float = 0.025
    between: float = 5.0
    most: int = 96


VARYING = VaryingConstants()


@dataclass(frozen=True)
class Varying:
    """The candidates, and what is not tried with the reason."""

    candidates: tuple[Candidate, ...] = ()
    left_out: Mapping[str, str] = field(default_factory=dict)


def varying_parameters(problem: Residuals, inner: Array) -> Varying:
    """The variations of parameters that the fitted records can show, at a point of their least squares problem: those of the
    most influential parameters first."""
    runs, model = problem.runs, problem.experiment.model
    forms = [c for c in model.library.effects() if c.effect is not None and "parameter" in c.effect.attaches]
    left_out: dict[str, str] = {}
    influence = _influence(problem, inner, left_out)
    if not forms or not influence:
        return Varying((), left_out)
    leaves = runs[0].assembly.flat.expanded.leaves
    values = [problem.values_of(inner, run.record.name) for run in runs]
    names = {path: _variables(leaves[path], runs[0]) for path in dict.fromkeys(n.rpartition(".")[0] for n in influence)}
    wanted = list(dict.fromkeys(name for listed in names.values() for name in listed))
    courses = dict(zip(wanted, np.hstack([Probe(run.assembly, wanted, si=True).values(run.simulator.run(own))
                                          for run, own in zip(runs, values, strict=True)]), strict=True)) if wanted else {}
    moving = {path: _moving({name: courses[name] for name in listed}) for path, listed in names.items()}
    begin = min(float(run.found.grid[0]) for run in runs)
    end = max(float(run.found.grid[-1]) for run in runs)
    found: list[Candidate] = []
    for name in influence:
        path, _, key = name.rpartition(".")
        units = {v: unit_of_variable(runs[0].assembly.flat, v) for v in moving[path]}
        for form in forms:
            found += _of_form(form, leaves[path], key, {v: courses[v] for v in moving[path]}, units, (begin, end))
    found = [_beside_earlier(c, model) for c in found if c.name not in model.body.instances]
    independent = {*runs[0].assembly.parameter_names}
    by_record = [_by_record(problem, leaves[name.rpartition(".")[0]], name) for name in influence if name in independent] \
        if len(runs) > 1 else []
    found = [*by_record, *found]
    left_out |= {c.place: "other parameters have a larger influence" for c in found[VARYING.most:]}
    return Varying(tuple(found[:VARYING.most]), left_out)


def _beside_earlier(candidate: Candidate, model: Model) -> Candidate:
    """The candidate with the factors that its parameter has in the diagram already."""
    vary = {name: (*((f"({setting.value.text.lstrip('= ')})",) if (setting := model.vary.get(name)) is not None
                     and isinstance(setting.value, Value) else ()), *factors)
            for name, factors in candidate.change.vary.items()}
    return replace(candidate, change=replace(candidate.change, vary=vary))


def differing_parameters(problem: Residuals, inner: Array) -> tuple[Candidate, ...]:
    """The influential parameters with a value of their own for each record."""
    leaves = problem.runs[0].assembly.flat.expanded.leaves
    independent = {*problem.runs[0].assembly.parameter_names}
    return tuple(_by_record(problem, leaves[name.rpartition(".")[0]], name) for name in _influence(problem, inner, {})
                 if name in independent)


def _influence(problem: Residuals, inner: Array, left_out: dict[str, str]) -> list[str]:
    """The parameters of parts that move the channels, the most influential first."""
    assembly = problem.runs[0].assembly
    independent, values = {q.name for q in assembly.flat.parameters}, assembly.parameter_values
    sources = {}
    for leaf in assembly.flat.expanded.leaves.values():
        for parameter in leaf.component.parameters.values():
            name = f"{leaf.path}.{parameter.name}"
            own = _independent(name, leaf, independent)
            if not own or not _is_candidate(leaf, parameter, values.get(name, 0.0)):
                continue
            if reason := fixed_because(leaf.component, parameter.name):
                left_out[name] = reason
            else:
                sources[name] = own
    names = list(dict.fromkeys(sources.values()))
    if not names:
        return []
    squares = np.zeros(len(names))
    for run in problem.runs:
        there = {n: v for n, v in problem.values_of(inner, run.record.name).items() if n in values}
        J = run.again(names, {}, QuickSimulator).residuals(there)[1]
        squares += np.sum((J * np.array([there.get(n, values[n]) for n in names])[:, None])**2, axis=1)
    size = dict(zip(names, np.sqrt(squares), strict=True))
    left_out |= {name: "the records hardly depend on it" for name, own in sources.items() if not size[own] > VARYING.seen}
    return sorted((n for n in sources if n not in left_out), key=lambda n: -size[sources[n]])


def _is_candidate(leaf: Leaf, parameter: Parameter, value: float) -> bool:
    """Whether a parameter is a single physical number other than zero; signals are computed, not subject to physics."""
    return bool(leaf.component.ports) and not leaf.component.composite and not parameter.integer and not parameter.width \
        and parameter.count is None and bool(np.isfinite(value)) and value not in (0.0, parameter.neutral) \
        and leaf.component.power != "source"


def _independent(name: str, leaf: Leaf, independent: set[str]) -> str:
    """The independent parameter whose value a parameter has: itself, or the one that its formula names alone."""
    if name in independent:
        return name
    bound = leaf.parameters.get(name.rpartition(".")[2])
    expr = getattr(bound.value, "expr", None) if bound is not None else None
    text = bound.scope + expr.text if bound is not None and isinstance(expr, Name) else ""
    return text if text in independent else ""


def _variables(leaf: Leaf, run: Run) -> list[str]:
    """The variables of a part and the efforts at its ports, as far as the diagram has them. Of a part between two moving
    nodes only the relative motion matters, which its own variables describe."""
    flat, domains = run.assembly.flat, [port.domain for port in leaf.component.ports.values()]
    ports = [f"{port.name}.{member}" for port in leaf.component.ports.values()
             if port.count is None and (domain := flat.domains.get(f"{leaf.path}.{port.name}")) is not None
             and not (domain.positions and domains.count(port.domain) > 1)
             for member in domain.across]
    own = [v.name for v in leaf.component.variables.values() if v.name not in leaf.component.held]
    found = [full for name in (*own, *ports) if (full := f"{leaf.path}.{name}") in flat.names]
    return [*_relative_positions(leaf, run), *found]


def _relative_positions(leaf: Leaf, run: Run) -> list[str]:
    """Of a part between two mechanical nodes that has no displacement of its own (a damper, friction) the formula of the
    relative position of its nodes, as far as the diagram has their positions: friction may vary along the path."""
    flat = run.assembly.flat
    nodes = {port: node for node in nodes_of(flat).values() for port in node.ports}
    ends = [node for port in reversed(leaf.component.ports) if (node := nodes.get(f"{leaf.path}.{port}")) is not None]
    if len(ends) != 2 or any(node.domain.position is None for node in ends):
        return []
    length = ends[0].domain.members[ends[0].domain.position or ""].unit.dimension
    if any(v.unit.dimension == length for v in leaf.component.variables.values()):
        return []
    moving = [node for node in ends if not any(
        other.component.is_a(node.domain.reference or "") for port in node.ports
        if (other := flat.expanded.leaves.get(port.rpartition(".")[0])) is not None)]
    names = [f"{node.name}.{node.domain.position}" for node in moving]
    return [" - ".join(names)] if names and all(name in flat.names for name in names) else []


def unit_of_variable(flat: Flat, variable: str) -> Unit:
    """The unit of a variable with which a parameter may vary: of the diagram, a difference of two, or time."""
    return SECOND if variable == "time" else flat.unknowns[flat.names[variable.partition(" - ")[0]]].unit


def _moving(courses: Mapping[str, Array]) -> list[str]:
    """The variables that move, one of those that move alike, at most as many as are tried."""
    found: list[str] = []
    for name, course in courses.items():
        span, size = float(np.ptp(course)), float(np.abs(course).max())
        if not np.isfinite(size) or not span > VARYING.steady * size or len(found) == VARYING.variables:
            continue
        if all(abs(float(np.corrcoef(course, courses[other])[0, 1])) < VARYING.alike for other in found):
            found.append(name)
    return found


def _of_form(form: Component, leaf: Leaf, key: str, courses: Mapping[str, Array], units: Mapping[str, Unit],
             times: tuple[float, float]) -> Iterator[Candidate]:
    """The candidates of one form of factor for one parameter."""
    assert form.effect is not None
    words, u = form.effect.varies_with, next(iter(form.signals))
    for variable, course in courses.items():
        low, high = float(course.min()), float(course.max())
        sides = min(float(np.mean(course > 0)), float(np.mean(course < 0)))
        if "variable" in words or ("rate" in words and sides > VARYING.both):
            yield _candidate(form, leaf, key, variable, units[variable], (low, high), u)
    if {"time", "instant"} & set(words):
        yield _candidate(form, leaf, key, "time", SECOND, times, u)


def _by_record(problem: Residuals, leaf: Leaf, name: str) -> Candidate:
    """A parameter with a value of its own for each record."""
    key = name.rpartition(".")[2]
    unit = leaf.component.parameters[key].unit
    value = problem.runs[0].assembly.parameter_values[name]
    low, high = sorted((value / VARYING.between, value * VARYING.between))
    declared = leaf.component.parameters[key]
    span = Range(low if declared.low is None else max(low, declared.low),
                 high if declared.high is None else min(high, declared.high), unit)
    return Candidate(name, leaf.component.name, BY_RECORD, "a parameter that differs between records",
                     f"of {name} with the record", (leaf.path,), Change(each={name: span}), (), "in")


def _candidate(form: Component, leaf: Leaf, key: str, variable: str, unit: Unit, span: tuple[float, float],
               u: str) -> Candidate:
    """One factor of one parameter with one variable, at its neutral value."""
    effect = form.effect
    assert effect is not None
    low, high = span
    at_motion = {"middle": (low + high) / 2, "half": (high - low) / 2, "peak": max(abs(low), abs(high))}
    part = re.sub(r"\W+", "_", f"{snake(form.name)}_{leaf.path}_{key}_{variable.removeprefix(leaf.path + '.')}")
    base, values, numbers = read_unit(unit.text), {u: f"={variable}"}, []
    for name, sought in (*effect.amplitude.items(), *effect.shapes.items()):
        parameter = form.parameters[name]
        own = base if is_generic(parameter.unit.dimension) else parameter.unit
        if sought is not None and sought.held:
            values[name] = quantity(float(f"{at_motion[sought.held]:.4g}"), own)
            continue
        if sought is not None and sought.range is None:
            inside = VARYING.inside * (high - low)  # at the ends a step is another constant value
            sought = SearchRange(Range(low + inside, high - inside, own), "")
        values[name] = quantity(0.0 if sought is None else (low + high) / 2, own)
        numbers.append(EffectNumber(f"{part}.{name}", own, parameter.low, parameter.high, sought, name in effect.amplitude,
                                    limits=(parameter.low, parameter.high)))
    full = f"{leaf.path}.{key}"
    return Candidate(part, form.name, effect.kind, effect.description, f"of {full} with {variable}", (leaf.path,),
                     Change({part: Part(form.name, values)}, vary={full: (f"{part}.{FACTOR}",)}), tuple(numbers),
                     "parameter")


def with_onset(candidate: Candidate, library: Library, spans: Mapping[str, tuple[float, float]],
               begins: Mapping[str, float]) -> Candidate | None:
    """The effect that acts from a time on, with one time for each record: `begins` (s), sought within and beyond the `spans`
    of the records; None if its amplitudes cannot vary. A parameter that changes at a time changes at one in each record."""
    component = library.component(candidate.component)
    amplitudes = candidate.vanishing
    changes = next((n for n in candidate.numbers if n.name.rpartition(".")[2] in component.parameters
                    and component.parameters[n.name.rpartition(".")[2]].instant), None)
    if not amplitudes or component.composite or candidate.change.each or any(
            n.neutral != 0 or n.parts or fixed_because(component, n.name.rpartition(".")[2]) for n in amplitudes):
        return None
    if candidate.attaches == "parameter" and changes is None:
        return None
    part, onset = re.sub(r"\W+", "_", f"onset_{candidate.name}"), library.component(ONSET)
    u, time = next(iter(onset.signals)), "t_0"
    half = min(high - low for low, high in spans.values()) / 2
    beyond = VARYING.beyond * half
    span = Range(min(low for low, _ in spans.values()) - beyond, max(high for _, high in spans.values()) + beyond, SECOND)
    # at an end the effect acts in the whole record, or not at all
    ends = {name: (low - beyond, high + beyond) for name, (low, high) in spans.items()}
    there = {name: ends[name][0] if begin <= spans[name][0] else ends[name][1] if begin >= spans[name][1] else begin
             for name, begin in begins.items()}
    first = quantity(next(iter(there.values())), SECOND)

    def own_times(name: str) -> Change:
        return Change(each={name: span}, of_records={r: {name: quantity(begin, SECOND)} for r, begin in there.items()})

    if changes is not None:
        change = candidate.change.with_values({changes.name: first}).joined(own_times(changes.name))
        return replace(candidate, place=f"{candidate.place} in each record", change=change,
                       numbers=tuple(n for n in candidate.numbers if n is not changes))
    values = {u: "=time", time: first, "u_m": quantity(float(f"{half:.4g}"), SECOND),
              "w": f"{VARYING.width:g}"}
    factor = {n.name: (*candidate.change.vary.get(n.name, ()), f"{part}.{FACTOR}") for n in amplitudes}
    change = candidate.change.joined(Change({part: Part(ONSET, values)}, vary=factor)).joined(own_times(f"{part}.{time}"))
    return replace(candidate, place=f"{candidate.place} from a time on", change=change)
