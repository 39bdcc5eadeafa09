"""Candidates with varying parameters: a parameter of a part times a factor that depends on a variable of the part or on
time.

The forms of the factor are components with `attaches: parameter` (two values by direction, linear, piecewise linear, a step
in time). With amplitude 0 the factor is 1, so that the exact sensitivity scores these candidates like any other effect. The
combinations of parameters, variables and forms are numerous. A candidate is created only if the records can show it: the
parameter influences the channels, and the variable changes. The reason for each omission is reported.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from heavebond.core.units import Range, Unit, declared_unit, is_generic, read_unit
from heavebond.diagnosis.candidates.catalogue import Candidate, EffectNumber, quantity, snake
from heavebond.equations.expanded import Leaf
from heavebond.equations.flatten import Flat
from heavebond.equations.places import nodes_of
from heavebond.equations.variation import fixed_because
from heavebond.estimation.residuals import Residuals, Run
from heavebond.language.definition import FACTOR, Component, SearchRange, Value
from heavebond.language.edits import Change, Part
from heavebond.language.library import Library
from heavebond.numerics.dae import Array
from heavebond.numerics.quick_simulation import QuickSimulator
from heavebond.numerics.result import Probe
from heavebond.text.expression import Name

ONSET = "Onset"  # component whose output is 0 before a time and 1 after it
BY_RECORD = "record-dependent parameter"
SECOND = declared_unit("s")


@dataclass(frozen=True)
class VaryingConstants:
    """Constants of the choice of candidates.

    seen: smallest response of all channels to a change of a parameter by its whole value, in standard deviations of the
        noise, for which its variation is a candidate. Origin: an amplitude of at most 0.95 is detected from 5 standard
        deviations on, like a score. Doubled: variations of weak parameters are left out.
    steady: largest ratio of the span of a variable to its magnitude for which it counts as steady. Origin: a linear
        variation over a hundredth of a value is a constant. Doubled: fewer variables.
    alike: correlation of two variables from which on only one of them is used. Origin: the linear variations with them are
        equal to the accuracy of a score (1 %). Doubled distance to 1: fewer candidates.
    both: smallest share of the time that a variable must spend on either side of zero for two values by direction.
        Origin: each value needs some data. Doubled: one-sided motions have linear variations only.
    variables: largest number of variables of the part, and of recorded variables, for one parameter. Origin: time of a
        search. Doubled: up to twice the scores.
    inside: share of the duration at its beginning and end in which no change of a parameter is sought. Origin: at most a
        twentieth of the samples shows such a change. Doubled: later first changes.
    width: width of the transition of an onset, in half durations of the shortest record. Origin: half the spacing of the
        times of the scan (`search.onset`), so that a refit from the best of them is sensitive to the transition. Doubled:
        the residual of an abrupt onset is larger.
    beyond: largest distance of an onset before the beginning or after the end of a record, in half durations of the
        shortest record. Origin: five widths of the transition, so that the effect acts in the whole record, or in no part
        of it, to 1e-4. Doubled: the same.
    between: largest factor, up or down, on a fixed parameter in one record. Origin: a larger one means another machine.
        Doubled: a wider search.
    most: largest number of candidates. Origin: two seconds of first-order scores (`search.prescore`). Doubled: twice the
        time.
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
    most: int = 300


VARYING = VaryingConstants()


@dataclass(frozen=True)
class Varying:
    """Candidates, and the reason for each omitted variation."""

    candidates: tuple[Candidate, ...] = ()
    left_out: Mapping[str, str] = field(default_factory=dict)


def varying_parameters(problem: Residuals, inner: Array) -> Varying:
    """Variations of parameters that the fitted records can show, at the point `inner` of the least squares problem. The most
    influential parameters are first."""
    runs, model = problem.runs, problem.experiment.model
    forms = [c for c in model.library.effects() if c.effect is not None and "parameter" in c.effect.attaches]
    left_out: dict[str, str] = {}
    influence = _influence(problem, inner, left_out)
    if not forms or not influence:
        return Varying((), left_out)
    flat = runs[0].assembly.flat
    leaves = flat.expanded.leaves
    values = [problem.values_of(inner, run.record.name) for run in runs]
    names = {path: _variables(leaves[path], runs[0]) for path in dict.fromkeys(n.rpartition(".")[0] for n in influence)}
    channels = [o.shown.expr.text for o in problem.experiment.outputs.values() if isinstance(o.shown.expr, Name)]
    recorded = [name for name in (*problem.experiment.inputs, *channels) if name in flat.names]
    wanted = list(dict.fromkeys(name for listed in (*names.values(), recorded) for name in listed))
    courses = dict(zip(wanted, np.hstack([
        Probe(run.assembly, wanted, si=True).values(run.simulator.run(parameter_values))
        for run, parameter_values in zip(runs, values, strict=True)]), strict=True)) if wanted else {}
    moving = {path: _moving(listed, recorded, courses) for path, listed in names.items()}
    begin = min(float(run.found.grid[0]) for run in runs)
    end = max(float(run.found.grid[-1]) for run in runs)
    variations: list[Candidate] = []
    for name in influence:
        path, _, key = name.rpartition(".")
        units = {v: unit_of_variable(flat, v) for v in moving[path]}
        for form in forms:
            assert form.effect is not None
            words, u = form.effect.varies_with, next(iter(form.signals))
            for variable in moving[path]:
                course = courses[variable]
                sides = min(float(np.mean(course > 0)), float(np.mean(course < 0)))
                if "variable" in words or ("rate" in words and sides > VARYING.both):
                    span = float(course.min()), float(course.max())
                    variations.append(_candidate(form, leaves[path], key, variable, units[variable], span, u))
            if _stores_or_dissipates(leaves[path]) and {"time", "instant"} & set(words):
                variations.append(_candidate(form, leaves[path], key, "time", SECOND, (begin, end), u))
    variations = [c for c in variations if c.name not in model.body.instances]
    for k, candidate in enumerate(variations):  # the factors that the parameter already has in the diagram are kept
        vary = {name: (*((f"({setting.value.text.lstrip('= ')})",) if (setting := model.vary.get(name)) is not None
                         and isinstance(setting.value, Value) else ()), *factors)
                for name, factors in candidate.change.vary.items()}
        variations[k] = replace(candidate, change=replace(candidate.change, vary=vary))
    variations = [*(_each_record(problem, influence) if len(runs) > 1 else ()), *variations]
    left_out |= {c.place: "other parameters have a larger influence" for c in variations[VARYING.most:]}
    return Varying(tuple(variations[:VARYING.most]), left_out)


def differing_parameters(problem: Residuals, inner: Array) -> tuple[Candidate, ...]:
    """Candidates that give an influential parameter a separate value for each record."""
    return _each_record(problem, _influence(problem, inner, {}))


def _each_record(problem: Residuals, influence: Sequence[str]) -> tuple[Candidate, ...]:
    """Candidates that give one of these parameters a separate value for each record."""
    assembly = problem.runs[0].assembly
    leaves, independent = assembly.flat.expanded.leaves, {*assembly.parameter_names}
    return tuple(_by_record(problem, leaf, name) for name in influence
                 if name in independent and _stores_or_dissipates(leaf := leaves[name.rpartition(".")[0]]))


def _stores_or_dissipates(leaf: Leaf) -> bool:
    """False for sources and signals: they may follow any course in time, and a variation in time would only copy it."""
    return bool(leaf.component.ports) and leaf.component.power != "source"


def _influence(problem: Residuals, inner: Array, left_out: dict[str, str]) -> list[str]:
    """Names of the parameters of parts that influence the channels, the most influential first."""
    assembly = problem.runs[0].assembly
    independent, values = {q.name for q in assembly.flat.parameters}, assembly.parameter_values
    sources = {}
    for leaf in assembly.flat.expanded.leaves.values():
        for parameter in leaf.component.parameters.values():
            name = f"{leaf.path}.{parameter.name}"
            source = _independent(name, leaf, independent)
            value = values.get(name, 0.0)
            # a single physical number other than zero
            single = not leaf.component.composite and not parameter.integer and not parameter.width \
                and parameter.count is None and bool(np.isfinite(value)) and value not in (0.0, parameter.neutral)
            if not source or not single:
                continue
            if reason := fixed_because(leaf.component, parameter.name):
                left_out[name] = reason
            else:
                sources[name] = source
    names = list(dict.fromkeys(sources.values()))
    if not names:
        return []
    squares = np.zeros(len(names))
    for run in problem.runs:
        point = {n: v for n, v in problem.values_of(inner, run.record.name).items() if n in values}
        J = run.again(names, {}, QuickSimulator).residuals(point)[1]
        squares += np.sum((J * np.array([point.get(n, values[n]) for n in names])[:, None])**2, axis=1)
    size = dict(zip(names, np.sqrt(squares), strict=True))
    left_out |= {name: "the records hardly depend on it" for name, source in sources.items()
                 if not size[source] > VARYING.seen}
    return sorted((n for n in sources if n not in left_out), key=lambda n: -size[sources[n]])


def _independent(name: str, leaf: Leaf, independent: set[str]) -> str:
    """Independent parameter that determines the value of a parameter: the parameter itself, or the only name in its
    formula."""
    if name in independent:
        return name
    bound = leaf.parameters.get(name.rpartition(".")[2])
    expr = getattr(bound.value, "expr", None) if bound is not None else None
    text = bound.scope + expr.text if bound is not None and isinstance(expr, Name) else ""
    return text if text in independent else ""


def _variables(leaf: Leaf, run: Run) -> list[str]:
    """Variables of a part, and the efforts at its ports, that exist in the diagram.

    For a part between two moving nodes only the relative motion matters, which is described by the variables of the part. A
    mechanical part without a displacement variable (damper, friction) has the formula of the relative position of its nodes
    as well, because friction may vary along the path, unless the diagram lacks the positions.
    """
    flat, domains = run.assembly.flat, [port.domain for port in leaf.component.ports.values()]
    ports = [f"{port.name}.{member}" for port in leaf.component.ports.values()
             if port.count is None and (domain := flat.domains.get(f"{leaf.path}.{port.name}")) is not None
             and not (domain.positions and domains.count(port.domain) > 1)
             for member in domain.across]
    part_variables = [v.name for v in leaf.component.variables.values() if v.name not in leaf.component.held]
    existing = [full for name in (*part_variables, *ports) if (full := f"{leaf.path}.{name}") in flat.names]
    nodes = {port: node for node in nodes_of(flat).values() for port in node.ports}
    ends = [node for port in reversed(leaf.component.ports) if (node := nodes.get(f"{leaf.path}.{port}")) is not None]
    if len(ends) != 2 or any(node.domain.position is None for node in ends):
        return existing
    length = ends[0].domain.members[ends[0].domain.position or ""].unit.dimension
    if any(v.unit.dimension == length for v in leaf.component.variables.values()):
        return existing
    moving = [node for node in ends if not any(
        attached.component.is_a(node.domain.reference or "") for port in node.ports
        if (attached := flat.expanded.leaves.get(port.rpartition(".")[0])) is not None)]
    names = [f"{node.name}.{node.domain.position}" for node in moving]
    return [" - ".join(names), *existing] if names and all(name in flat.names for name in names) else existing


def unit_of_variable(flat: Flat, variable: str) -> Unit:
    """Unit of the variable of a varying parameter: a variable of the diagram, a difference of two, or time."""
    return SECOND if variable == "time" else flat.unknowns[flat.names[variable.partition(" - ")[0]]].unit


def _moving(of_part: Sequence[str], recorded: Sequence[str], courses: Mapping[str, Array]) -> list[str]:
    """Select variables that change and are not strongly correlated with each other: at most `VARYING.variables` of the part,
    and as many recorded ones."""
    selected: list[str] = []
    for names in (of_part, recorded):
        most = len(selected) + VARYING.variables
        for name in names:
            course = courses[name]
            span, size = float(np.ptp(course)), float(np.abs(course).max())
            if np.isfinite(size) and span > VARYING.steady * size and len(selected) < most and all(
                    abs(float(np.corrcoef(course, courses[earlier])[0, 1])) < VARYING.alike for earlier in selected):
                selected.append(name)
    return selected


def _by_record(problem: Residuals, leaf: Leaf, name: str) -> Candidate:
    """Candidate that gives a parameter a separate value for each record."""
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
    """Candidate with one factor of one parameter that depends on one variable, at its neutral value."""
    effect = form.effect
    assert effect is not None
    low, high = span
    at_motion = {"middle": (low + high) / 2, "half": (high - low) / 2, "peak": max(abs(low), abs(high))}
    part = re.sub(r"\W+", "_", f"{snake(form.name)}_{leaf.path}_{key}_{variable.removeprefix(leaf.path + '.')}")
    base, values, numbers = read_unit(unit.text), {u: f"={variable}"}, []
    for name, sought in (*effect.amplitude.items(), *effect.shapes.items()):
        parameter = form.parameters[name]
        number_unit = base if is_generic(parameter.unit.dimension) else parameter.unit
        if sought is not None and sought.held:
            values[name] = quantity(float(f"{at_motion[sought.held]:.4g}"), number_unit)
            continue
        if sought is not None and sought.range is None:
            inside = VARYING.inside * (high - low)  # a step at an end is another constant value
            sought = SearchRange(Range(low + inside, high - inside, number_unit), "")
        values[name] = quantity(0.0 if sought is None else (low + high) / 2, number_unit)
        numbers.append(EffectNumber(f"{part}.{name}", number_unit, parameter.low, parameter.high, sought,
                                    name in effect.amplitude, limits=(parameter.low, parameter.high)))
    full = f"{leaf.path}.{key}"
    return Candidate(part, form.name, effect.kind, effect.description, f"of {full} with {variable}", (leaf.path,),
                     Change({part: Part(form.name, values)}, vary={full: (f"{part}.{FACTOR}",)}), tuple(numbers),
                     "parameter")


def with_onset(candidate: Candidate, library: Library, spans: Mapping[str, tuple[float, float]],
               begins: Mapping[str, float]) -> Candidate | None:
    """Candidate whose effect begins at a separate time in each record; None if its amplitudes cannot vary.

    `begins` are the initial values of these times (s). They are sought within the `spans` (s) of the records and a short
    distance beyond. If the candidate is a step of a parameter at a time, this time becomes separate for each record.
    """
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
    # at an end of its range the effect acts in the whole record, or not at all
    ends = {name: (low - beyond, high + beyond) for name, (low, high) in spans.items()}
    onset_times = {name: ends[name][0] if begin <= spans[name][0] else ends[name][1] if begin >= spans[name][1] else begin
                   for name, begin in begins.items()}
    first = quantity(next(iter(onset_times.values())), SECOND)

    def own_times(name: str) -> Change:
        return Change(each={name: span}, of_records={r: {name: quantity(begin, SECOND)} for r, begin in onset_times.items()})

    if changes is not None:
        change = candidate.change.with_values({changes.name: first}).joined(own_times(changes.name))
        return replace(candidate, place=f"{candidate.place} in each record", change=change,
                       numbers=tuple(n for n in candidate.numbers if n is not changes))
    values = {u: "=time", time: first, "u_m": quantity(float(f"{half:.4g}"), SECOND),
              "w": f"{VARYING.width:g}"}
    factor = {n.name: (*candidate.change.vary.get(n.name, ()), f"{part}.{FACTOR}") for n in amplitudes}
    change = candidate.change.joined(Change({part: Part(ONSET, values)}, vary=factor)).joined(own_times(f"{part}.{time}"))
    return replace(candidate, place=f"{candidate.place} from a time on", change=change)
