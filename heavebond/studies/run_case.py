"""One case of a study: assembly, tuning if requested, run, measurement; and the checks before any run."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from heavebond.core.errors import NAMES_LISTED, HeavebondError, ModelError, Place, Problems, UsageError, suggest
from heavebond.core.parallel import Stopped, check_cancelled
from heavebond.core.progress import Progress
from heavebond.core.units import Unit, counts_from_origin, interval_text, read_unit
from heavebond.equations.parameters import check_ranges
from heavebond.language.model import Model
from heavebond.linear.held_variables import check_decided, held_lines
from heavebond.linear.linearisation import ModesAtStart
from heavebond.linear.modal_values import NUMBERS, chosen_mode, modal_number
from heavebond.linear.rest_stability import stability_sentences as stability_words
from heavebond.linear.rest_stability import summary_sentences
from heavebond.numerics.dae import Assembly, assemble
from heavebond.numerics.result import Result, unknown_signal
from heavebond.numerics.run_verdict import Verdict
from heavebond.numerics.simulation import with_filled_nodes
from heavebond.numerics.simulator import Simulator
from heavebond.optimise.cost_evaluation import Evaluator
from heavebond.optimise.costs import FUNCTIONALS, Cost, read_cost, read_limit
from heavebond.optimise.objective import Objective, check_free, check_smooth
from heavebond.optimise.tuning import Tuned, sweep_in_turn, tune
from heavebond.studies.axes import StudyCase, case_at, changed
from heavebond.studies.occurrence import check_units
from heavebond.studies.shared_runs import measured_together, run_times
from heavebond.studies.study import COST, SIMULATIONS, Calibration, PackedCase, Procedure, Study
from heavebond.text.expression import ExpressionProblem, names

# Digits, and largest number of points, of stored signals of pictures.
DIGITS = 7
MOST_POINTS = 5000


@dataclass(frozen=True)
class Outcome:
    """The outcome of one case by one procedure (empty without tuning): numbers in SI by name, the limits of the tuning
    (above zero if exceeded), the modes, signals over time in their units; slopes of numbers by parameters and these
    parameters (`at`), in SI, if requested; the margins of stability of the tuned machine, with its `words`, and the
    parameters at an end of their range; the variables that left their range (`outside`, a sentence); or the problem
    that prevented a result, which includes invalid runs; the `solver` of the measured run."""

    case: int
    procedure: str = ""
    values: Mapping[str, float] = field(default_factory=dict)
    limits: Mapping[str, float] = field(default_factory=dict)
    message: str = ""
    modes: tuple[Mapping[str, Any], ...] = ()
    time: tuple[float, ...] = ()
    signals: Mapping[str, Sequence[float]] = field(default_factory=dict)
    signal_units: Mapping[str, str] = field(default_factory=dict)
    seconds: float = 0.0
    problem: str = ""
    outside: str = ""
    slopes: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    at: Mapping[str, float] = field(default_factory=dict)
    stability: Mapping[str, Any] = field(default_factory=dict)
    at_end: Mapping[str, str] = field(default_factory=dict)
    solver: str = ""

    @property
    def unstable(self) -> bool:
        """True if the tuned machine is known to be unstable: it agrees with no published number."""
        return self.stability.get("stable") is False

    def as_dict(self) -> dict[str, Any]:
        return asdict(self)


def worked(packed: Study | PackedCase, number: int, procedure: Procedure | None,
           progress: Progress | None = None) -> Outcome:
    """Compute the case of that number; an error in this case is part of its outcome."""
    began = clock.perf_counter()
    study = packed.study if isinstance(packed, PackedCase) else packed
    name = procedure.name if procedure is not None else ""
    try:
        outcome = _worked(study, study.case(number), procedure, progress or check_cancelled)
    except HeavebondError as error:
        first = error.problems[0]
        outcome = Outcome(number, problem=first.message + (f" {first.hint}" if first.hint else ""))
    except Stopped:
        raise
    except Exception as error:  # a fault of the program in one case must not discard the others, which may be hours of work
        outcome = Outcome(number, problem=f"the program failed: {type(error).__name__}: {error}")
    return replace(outcome, case=number, procedure=name, seconds=clock.perf_counter() - began)


def _worked(study: Study, case: StudyCase, procedure: Procedure | None, progress: Progress | None) -> Outcome:
    if (together := measured_together(study, case, named_in(study))) is not None:
        values, shared_run = together
        if not shared_run.verdict.failed:
            time, signals = _signals(study, shared_run)
            return Outcome(0, values=values, modes=_modes(study, shared_run.assembly), time=time, signals=signals,
                           outside=shared_run.verdict.text if shared_run.verdict.findings else "",
                           signal_units={name: shared_run.unit(name) for name in signals}, solver=_solver(shared_run))
    assembly = assembled(study, case)
    values = {}
    limits: Mapping[str, float] = {}
    message = ""
    stability: Mapping[str, Any] = {}
    at_end: Mapping[str, str] = {}
    if study.task is not None and procedure is not None:
        tuned = tuned_by(Objective(assembly, study.task), procedure, progress)
        values = {**tuned.values, COST: tuned.cost, SIMULATIONS: tuned.simulations}
        limits, message, at_end = tuned.limits, tuned.message, tuned.at_end
        stability_required = study.task.stable is not False
        stability = {**asdict(tuned.stability), "words": list(stability_words(tuned.stability, asked=stability_required)),
                     "summary": summary_sentences(tuned.stability, asked=stability_required)}
        assembly = assembly.with_parameters(tuned.values)
    by = tuple(name for level in case.levels for name in level.along)
    (numbers, run, slopes), filled = with_filled_nodes(lambda machine: measured(study, machine, by), assembly,
                                                       lambda measured_run: measured_run[1], by)
    verdict = run.verdict.raise_if_failed() if run is not None else Verdict()
    time, signals = _signals(study, run)
    return Outcome(0, values={**values, **numbers}, limits=dict(limits), message=message, modes=_modes(study, assembly),
                   time=time, signals=signals, slopes=slopes,
                   outside=" ".join([*([verdict.text] if verdict.findings else []), *([f"run {filled}"] if filled else [])]),
                   stability=stability, at_end=at_end,
                   at={name: assembly.parameter_values[name] for name in by},
                   signal_units={name: run.unit(name) for name in signals} if run is not None else {}, solver=_solver(run))


def _solver(run: Result | None) -> str:
    return str(run.statistics["solver"]) if run is not None else ""


def assembled(study: Study, case: StudyCase) -> Assembly:
    """The diagram of a case with calibrated values; a case that sets such a parameter keeps its value."""
    assembly = assemble(case.model, named_in(study))
    parameter_values = assembly.parameter_values
    return assembly.with_parameters({name: after for name, (before, after) in study.calibrated.items()
                                     if math.isclose(parameter_values[name], before, rel_tol=1e-9, abs_tol=0.0)})


def tuned_by(problem: Objective, procedure: Procedure, progress: Progress | None = None) -> Tuned:
    if procedure.sweeps:
        return sweep_in_turn(problem, procedure.begin, procedure.sweeps, progress=progress)
    return tune(problem, problem.task, explore=procedure.explore, starts=procedure.starts, method=procedure.method,
                progress=progress)


# -- measuring ---------------------------------------------------------------------------------------------------------
def measured(study: Study, assembly: Assembly, by: Sequence[str] = ()
             ) -> tuple[dict[str, float], Result | None, dict[str, dict[str, float]]]:
    """The measured numbers in SI, their run (None if only modes are requested), and their exact derivatives by parameters
    (`ref(...)` constant)."""
    costs = [read_cost(assembly, measure.text) for measure in study.measures.values()]
    modes = study.modes or {}
    if not by and not study.signals and all(f.kind in NUMBERS for cost in costs for f in cost.functionals):
        return dict(zip(study.measures, _of_modes(assembly, costs, modes), strict=True)), None, {}
    times = run_times(study, assembly)
    evaluator = Evaluator(assembly, costs, study.begin, float(times[-1]), named=tuple(by), modes=modes)
    simulator = Simulator(assembly, times=times, dense=True)
    run = simulator.run()
    if evaluator.integrated:
        # the sizes of signals first: a 32nd power of plain newtons would dominate
        evaluator.resized(evaluator.largest(run))
        simulator = Simulator(assembly, times=times, quadratures=evaluator.quadratures, factors=evaluator.factors,
                              dense=True)
        run = simulator.run()
    references = np.zeros(len(evaluator.functionals))
    if any(any(cost.references) for cost in costs):
        passive = simulator.run(assembly.with_parameters(study.reference).parameter_values)
        references = evaluator.functional_values(passive)[0]
    if by:
        run = Simulator(assembly, times=times, quadratures=evaluator.quadratures, factors=evaluator.factors,
                        sensitivities=by, dense=True).run()
    numbers, slopes = evaluator.functional_values(run)
    cost_gradients = evaluator.cost_values(numbers, slopes, references, run.p,
                                           run.along.p if run.along is not None else np.zeros((0, len(run.p))))
    return ({name: value for name, (value, _) in zip(study.measures, cost_gradients, strict=True)}, run,
            {name: dict(zip(by, slope.tolist(), strict=True))
             for name, (_, slope) in zip(study.measures, cost_gradients, strict=True)
             } if by else {})


def _of_modes(assembly: Assembly, costs: Sequence[Cost], settings: Mapping[str, float | str]) -> Iterator[float]:
    """Costs that contain modes only."""
    if not costs:
        return
    at_start = ModesAtStart(assembly.with_parameters(settings))
    first, modes = at_start.at({})
    check_decided(at_start.constant(first), "a number of the modes", "Leave it out of `measure:`.")
    for cost in costs:
        numbers = [modal_number(f.kind, chosen_mode(modes, f.kind, f.which)) for f in cost.functionals]
        yield float(cost.value(numbers, first.p))


def _signals(study: Study, run: Result | None) -> tuple[tuple[float, ...], dict[str, list[float]]]:
    if run is None or not study.signals:
        return (), {}
    step = math.ceil(len(run.time) / MOST_POINTS)
    signals = {name: [float(f"{v:.{DIGITS}g}") for v in values[::step]]
               for name, values in run.signals(study.signals).items()}
    return tuple(float(f"{t:.{DIGITS}g}") for t in run.time[::step]), signals


def _modes(study: Study, assembly: Assembly) -> tuple[dict[str, Any], ...]:
    """The modes with the share of each component in them, the largest first."""
    if study.modes is None:
        return ()
    mode_entries = []
    at_start = ModesAtStart(assembly.with_parameters(study.modes))
    first, modes = at_start.at({})
    held = held_lines(at_start.constant(first))
    for mode in modes:
        shares: dict[str, float] = {}
        for state, share in mode.participation.items():
            component = state.rpartition(".")[0] or state
            shares[component] = shares.get(component, 0.0) + share
        mode_entries.append({"frequency": mode.frequency, "damping": mode.damping if mode.value else None,
                             "real": mode.value.real,
                             "imaginary": mode.value.imag, "swings": mode.swings,
                             "components": dict(sorted(shares.items(), key=lambda pair: -pair[1])), "held": held})
    return tuple(mode_entries)


# -- checks before any run -----------------------------------------------------------------------------------------------
def checked(study: Study) -> dict[str, Unit]:
    """The display unit of each number; ModelError with places in the study file for mistakes in it. Diagrams are
    assembled so often that every level of every axis occurs once.
    """
    problems, units = Problems(), {}
    # cases in which every variant occurs; for a parameter's values, which are of one kind, the first is sufficient
    numbers = [len(axis.levels) if axis.unit is None and axis.sampling is None else 1 for axis in study.axes]
    wanted = dict.fromkeys(tuple(min(k, number - 1) for number in numbers) for k in range(max(numbers, default=1)))
    # for a sample all parameters that any point sets
    sampled = [level.settings for axis in study.axes if axis.sampling is not None for level in axis.levels[-1:0:-1]]
    cases = [case_at(study.axes, study.model, index) for index in wanted]
    for case in [replace(case, model=changed(case.model, sampled)) for case in cases]:
        assembly = assemble(case.model, named_in(study))
        # check that slopes are taken by parameters, with ranges in their units
        axis = study.sample
        parameter_units = {q.name: q.unit for q in assembly.flat.parameters}
        for name in axis.levels[0].along if axis is not None else ():
            assert axis is not None and axis.sampling is not None
            if name not in parameter_units:
                problems.add("parameter-unknown", f"'{name}' is not a parameter by which a slope could be taken", axis.place,
                             hint=suggest(name, parameter_units) or NAMES_LISTED)
            elif parameter_units[name].dimension != axis.sampling.over[name].unit.dimension:
                problems.add("unit-wrong", f"the range of {name} is in {axis.sampling.over[name].unit.text}; "
                             f"{parameter_units[name].text} is needed", axis.place)
        units = _units(study, assembly, problems)
        problems.raise_as(ModelError)
    if study.occurrence is not None:
        check_units(study.occurrence, units, problems)
        problems.raise_as(ModelError)
    if study.calibration is not None:
        with relocated(study.places["calibrate"], problems):
            own_values(study.model, study.calibration)
        problems.raise_as(ModelError)
    return units


def own_values(model: Model, calibration: Calibration) -> dict[str, float]:
    """Values of the calibrated parameters in the diagram; UsageError for an unknown parameter or another unit."""
    assembly = assemble(model)
    check_ranges({q.name: q.unit for q in assembly.flat.parameters}, calibration.free, assembly.flat.limits,
                 assembly.flat.origins.of_name)
    return {name: assembly.parameter_values[name] for name in calibration.free}


def _units(study: Study, assembly: Assembly, problems: Problems) -> dict[str, Unit]:
    units: dict[str, Unit] = {}
    if study.task is not None:
        with relocated(study.places.get("cost"), problems):
            check_smooth(read_cost(assembly, study.task.cost))
        for limit in study.task.limits:
            with relocated(study.places.get("limits"), problems):
                check_smooth(read_limit(assembly, limit))
        with relocated(study.places.get("free"), problems):
            check_free(assembly, study.task)
        units = {name: wanted.unit for name, wanted in study.task.free.items()}
        units |= {COST: read_unit("1"), SIMULATIONS: read_unit("1")}
    for measure in study.measures.values():
        with relocated(measure.place, problems):
            cost = read_cost(assembly, measure.text, shown=bool(measure.unit) and counts_from_origin(measure.unit))
            if not measure.unit:
                units[measure.name] = read_unit(cost.unit)
            else:
                unit = read_unit(measure.unit)
                if unit.dimension != cost.dimension:
                    problems.add("unit-wrong", f"'{measure.name}' is in {cost.unit}, not in {measure.unit}", measure.place,
                                 hint="Write a unit of the same kind, or leave it out.")
                units[measure.name] = unit.of_intervals if cost.origin == 0 else unit
            if study.calibration is not None and measure.name in study.calibration.targets and any(cost.references):
                problems.add("target-reference", f"'{measure.name}' holds ref(...), and nothing is calibrated by that",
                             measure.place, hint="Take a number without it as a target.")
    for picture in (p for p in study.pictures if p.kind == "signals"):
        for name in picture.names:
            with relocated(picture.place, problems):
                if name not in assembly.model.show:
                    try:
                        formula = assembly.model.library.formula(name)
                        assembly.resolver().dimension(formula)
                        assembly.expression(formula)
                    except ExpressionProblem as problem:
                        raise unknown_signal(assembly, name, problem) from None
    # check that published numbers have the units of the measured ones
    for beside in study.beside:
        for name, numbers in beside.numbers.items():
            for published_value in numbers.values():
                if name in units and published_value.unit.dimension != units[name].dimension:
                    problems.add("unit-wrong",
                                 f"{name} is given in {published_value.unit.text}; {units[name].text} is needed",
                                 published_value.place)
                elif name in units and published_value.unit.offset and units[name].text == units[name].of_intervals.text \
                        and study.measures[name].unit and read_unit(study.measures[name].unit).offset:
                    problems.add("unit-offset",
                                 f"{name} is a difference of temperatures, and {published_value.unit.text} has an "
                                 "offset", published_value.place,
                                 hint=f"Write '{interval_text(published_value.value, published_value.unit)}'.")
    return units


@contextmanager
def relocated(place: Place | None, problems: Problems) -> Iterator[None]:
    """Inside, report an error in a formula, or in a value from a file, at its place in the file."""
    try:
        yield
    except UsageError as error:
        for problem in error.problems:
            inner = problem.place
            at = place.moved(inner.column - 1, inner.length) if place is not None and inner is not None else place
            problems.add(problem.code, problem.message, at, hint=problem.hint)


def named_in(study: Study) -> set[str]:
    """Names that the study needs although no equation uses them, for example positions."""
    texts = [*(m.text for m in study.measures.values()), *study.signals,
             *((study.task.cost, *study.task.limits) if study.task is not None else ())]
    names_needed: set[str] = set()
    for text in texts:
        with suppress(ExpressionProblem):
            names_needed |= {name.text for name in names(study.model.library.formula(text, FUNCTIONALS))}
    return names_needed
