"""Cases of a large study that differ only in the values of parameters: assembled once, and run by compiled code.

A case is usually assembled separately, and run twice: for the sizes of its signals, and with the integrals of the measured
quantities. In a study of many cases a process performs the common steps once: the equations, the formulas of the measured
quantities, the simulators, and, after some runs, the compiled equations (see `numerics.compiled_cvodes`). CVODES replaces
IDAS, with the same tolerances. The choice of these cases depends on the study only, and no case depends on earlier ones, so
the results are the same in any number of processes.

If a value is outside its range, if a study varies a parameter that shapes the equations, or if such a run fails, the case
is computed separately, which also explains the error.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf, isclose, isfinite
from threading import local

import casadi as ca
import numpy as np

from heavebond.core.errors import HeavebondError
from heavebond.core.units import UnitProblem, check_unit
from heavebond.equations.buffered import Buffered
from heavebond.equations.connect import connect
from heavebond.equations.parameters import formula_order, with_declaration
from heavebond.language.definition import Value
from heavebond.language.model import Model
from heavebond.language.symbols import stack
from heavebond.language.template import template
from heavebond.linear.modal_values import NUMBERS
from heavebond.numerics.dae import Array, Assembly, assemble
from heavebond.numerics.output_times import grid
from heavebond.numerics.quick_simulation import CaseSimulator
from heavebond.numerics.result import Result
from heavebond.optimise.cost_evaluation import Evaluator
from heavebond.optimise.costs import read_cost
from heavebond.studies.axes import Level, StudyCase, changed
from heavebond.studies.study import Study
from heavebond.text.expression import Number


@dataclass(frozen=True)
class SharedRunConstants:
    """The constants of the cases that share their equations.

    min_cases: cases of a study from which on they do. Origin: the program in C and the equations take half a second to
    compile, some ten short cases. Doubled: studies of 20 to 40 cases take up to four times as long.
    kept: sets of equations that a process keeps, one for each combination of variants. Origin: some megabytes each.
    Doubled: memory; fewer are assembled again if variants alternate.
    """

    min_cases: int = 20
    kept: int = 4


SHARED_RUNS = SharedRunConstants()


class _Known(local):
    """The sets of equations of a thread, the last used one at the end."""

    def __init__(self) -> None:
        self.shared: list[_Shared] = []


_KNOWN = _Known()


def measured_together(study: Study, case: StudyCase, named: set[str]) -> tuple[dict[str, float], Result] | None:
    """The measured numbers (SI) of a case and their run; None if the case must be computed separately. `named` are the
    signals that the study names."""
    if study.total < SHARED_RUNS.min_cases or study.task is not None or any(level.along for level in case.levels):
        return None
    numbers, variants = _numbers(case.levels)
    if not numbers:
        return None
    model = next((level.model for level in case.levels if level.model is not None), study.model)
    try:
        # common equations of the cases with these variants; created at the first of them
        for shared in _KNOWN.shared:
            if shared.measures is study.measures and shared.model is model \
                    and shared.variants == tuple(level.name for level in variants):
                _KNOWN.shared.remove(shared)
                break
        else:
            shared = _Shared(study, model, variants, named)
        _KNOWN.shared.append(shared)
        del _KNOWN.shared[:-SHARED_RUNS.kept]
        values = shared.values(numbers) if shared.runs is not None else None
        measured_case = shared.runs.measured(values) if values is not None and shared.runs is not None else None
        return measured_case if measured_case is not None and all(map(isfinite, measured_case[0].values())) else None
    except HeavebondError:
        return None  # the separate case reports the error


def _numbers(levels: Sequence[Level]) -> tuple[dict[str, Value], tuple[Level, ...]]:
    """The values that are plain numbers, and the other levels: variants."""
    numbers, variants = dict[str, Value](), list[Level]()
    for level in levels:
        plain_values = {path: setting.value for path, setting in level.settings.items()
                        if isinstance(setting.value, Value) and isinstance(setting.value.expr, Number)}
        if level.model is None and len(plain_values) == len(level.settings):
            numbers |= plain_values
        else:
            variants.append(level)
    return numbers, tuple(variants)


class _Shared:
    """The equations of the cases of a study with the same variants."""

    def __init__(self, study: Study, model: Model, levels: tuple[Level, ...], named: set[str]):
        self.measures, self.model, self.variants = study.measures, model, tuple(level.name for level in levels)
        self.runs: _Runs | None = None
        try:
            self.assembly = assemble(changed(model, [level.settings for level in levels]), named)
            self.runs = _Runs.of(study, self.assembly)
        except HeavebondError:
            return
        self.units = {q.name: q.unit for q in self.assembly.flat.parameters}
        self.calibrated = study.calibrated
        # a function of the independent parameters, and the range of each of its outputs: every parameter of a component
        # within its bounds, every requirement satisfied (not zero)
        flat = self.assembly.flat
        expanded = flat.expanded
        declared = [(flat.constants[name], parameter) for name, parameter, _ in with_declaration(expanded)]
        network = connect(expanded, formula_order(expanded))
        truths = []
        for path, leaf in expanded.leaves.items():
            if leaf.component.requires:
                component_template = template(leaf.component, expanded.model.library.domains, network.domains[path],
                                              leaf.integers)
                truths.append(component_template.requirements(stack([flat.constants[f"{path}.{name}"]
                                                                     for name in component_template.parameters])))
        true = stack(truths)
        rows = stack([*(value for value, _ in declared), ca.if_else(true != 0, 1, 0)])
        low = [-inf if parameter.low is None else parameter.low for _, parameter in declared]
        high = [inf if parameter.high is None else parameter.high for _, parameter in declared]
        self.allowed = (Buffered(ca.Function("allowed", [flat.p], [ca.densify(rows)])),
                        np.array([*low, *[1.0] * true.numel()]), np.array([*high, *[1.0] * true.numel()]))

    def values(self, numbers: Mapping[str, Value]) -> dict[str, float] | None:
        """All parameters with these set; None if one of them is unknown, shapes the equations, or is not permitted."""
        if not numbers.keys() <= self.units.keys():
            return None
        values = self.assembly.parameter_values
        for name, value in numbers.items():
            assert isinstance(value.expr, Number)
            try:
                if not value.si:
                    check_unit(value.expr.unit, self.units[name], value.expr.value, value.text)
            except UnitProblem:
                return None
            values[name] = value.expr.value
        values |= {name: after for name, (before, after) in self.calibrated.items()
                   if isclose(values[name], before, rel_tol=1e-9, abs_tol=0.0)}
        rows, low, high = self.allowed
        inside = rows(np.array([values[name] for name in self.assembly.parameter_names]))["o0"].ravel()
        return values if np.all((inside >= low) & (inside <= high)) else None


@dataclass
class _Runs:
    """The simulator of the cases, and the measured quantities."""

    study: Study
    evaluator: Evaluator
    simulator: CaseSimulator

    @classmethod
    def of(cls, study: Study, assembly: Assembly) -> _Runs | None:
        """None if the compiled program cannot integrate the equations, or if nothing has to be integrated."""
        times = run_times(study, assembly)
        evaluator = Evaluator(assembly, [read_cost(assembly, measure.text) for measure in study.measures.values()],
                              study.begin, float(times[-1]), modes=study.modes or {})
        if not study.signals and all(f.kind in NUMBERS for f in evaluator.functionals):
            return None
        simulator = CaseSimulator(assembly, times=times, quadratures=evaluator.quadratures, factors=evaluator.factors,
                                  dense=True) if evaluator.integrated else CaseSimulator(assembly, times=times, dense=True)
        return cls(study, evaluator, simulator) if simulator.compiled else None

    def measured(self, values: Mapping[str, float]) -> tuple[dict[str, float], Result]:
        """The measured numbers at these parameters (SI), and the run; HeavebondError if it fails."""
        evaluator, simulator = self.evaluator, self.simulator
        if evaluator.integrated:
            # the sizes of signals first, from a run whose integrals are zero
            simulator.factors = replace(evaluator.factors, values=np.zeros(len(evaluator.integrated)))
            run = simulator.run(values)
            evaluator.resized(np.ones(len(evaluator.integrated)))
            simulator.factors = evaluator.resized(evaluator.largest(run))
        run = simulator.run(values)
        references = np.zeros(len(evaluator.functionals))
        if any(any(cost.references) for cost in evaluator.costs):
            passive = simulator.assembly.with_parameters(values).with_parameters(self.study.reference)
            references = evaluator.functional_values(simulator.run(passive.parameter_values))[0]
        numbers, slopes = evaluator.functional_values(run)
        costs = evaluator.cost_values(numbers, slopes, references, run.p, np.zeros((0, len(run.p))))
        return {name: value for name, (value, _) in zip(self.study.measures, costs, strict=True)}, run


def run_times(study: Study, assembly: Assembly) -> Array:
    """Output times of a measured run: the diagram's, to the end of the evaluated time."""
    times = grid(assembly.model, study.end, None)
    return np.union1d(times, [study.begin])
