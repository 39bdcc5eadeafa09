"""`heavebond design`: gains, compensators, filters, regulators, observer and predictive controllers by their specification,
written into a diagram."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from heavebond.commands.arguments import (
    Number,
    Whole,
    blamed_on_settings,
    check_new,
    json_option,
    list_items,
    listed,
    native_option,
    set_option,
    settings_of,
    with_settings,
)
from heavebond.core.errors import ModelError, Problem, UsageError, listing

if TYPE_CHECKING:
    from heavebond.language.model import Model
    from heavebond.linear.margins import Crossings
    from heavebond.reports.result_tables import Item
    from heavebond.text.yaml_edits import Tree

# the tasks on which an option has an effect, by the names of the options in Python
_TASKS = {**dict.fromkeys(("crossover", "bandwidth", "phase_margin"), ("free", "lead")),
          **dict.fromkeys(("kind", "order", "cut_off", "band", "ripple", "attenuation"), ("filter",)),
          **dict.fromkeys(("weigh", "effort"), ("lqr", "lqg", "mpc")),
          **dict.fromkeys(("disturbances", "noise"), ("lqg", "mpc")), "horizon": ("mpc",),
          **dict.fromkeys(("overs", "at"), ("free", "lead", "notch", "lqr", "lqg", "mpc"))}


@click.command(short_help="Design gains, notches, filters, observer and predictive controllers.")
@click.argument("model", metavar="DIAGRAM")
@click.option("--loop", metavar="SIGNAL", help="Gains of the loop through this signal.")
@click.option("--free", metavar="PARAMETER[,...]", multiple=True,
              help="With --loop: the gains, proportional, integral, derivative; or one or two of them.")
@click.option("--lead", metavar="BLOCK", help="With --loop: a LeadLag from crossover or bandwidth and phase margin.")
@click.option("--notch", metavar="BLOCK", help="With --loop: a NotchFilter at the mode that limits the gain.")
@click.option("--schedule", metavar="BLOCK", help="With --loop and --free: the table of gains of a ScheduledPID, with an "
              "operating point for each value of --over.")
@click.option("--crossover", metavar="FREQUENCY", help="With --loop: frequency of the gain 1: '0.5 Hz'.")
@click.option("--bandwidth", metavar="FREQUENCY", help="With --loop: bandwidth of the closed loop, in place of --crossover.")
@click.option("--phase-margin", metavar="ANGLE", help="With --loop: phase margin, e.g. '60 deg'.")
@click.option("--filter", "filtered", metavar="BLOCK",
              help="Coefficients of a TransferFunction or DiscreteTransferFunction.")
@click.option("--type", "kind", default="butterworth", show_default=True,
              help="With --filter: butterworth, bessel, chebyshev 1 or chebyshev 2.")
@click.option("--order", type=Whole(1), default=2, show_default=True, help="With --filter: order.")
@click.option("--cut-off", metavar="FREQUENCY[,...]",
              help="With --filter: cut-off frequency, or the two edges of a band.")
@click.option("--band", default="lowpass", show_default=True,
              help="With --filter: lowpass, highpass, bandpass or bandstop.")
@click.option("--ripple", type=Number(0, min_open=True), default=1.0, show_default=True,
              help="With --filter: ripple of chebyshev 1 in dB.")
@click.option("--attenuation", type=Number(0, min_open=True), default=40.0, show_default=True,
              help="With --filter: attenuation of chebyshev 2 in dB.")
@click.option("--lqr", metavar="BLOCK", help="Matrix of a MatrixGain that measures all states: optimal state feedback.")
@click.option("--lqg", metavar="BLOCK",
              help="Matrices of a LinearSystem or DiscreteStateSpace: regulator with Kalman filter.")
@click.option("--mpc", metavar="BLOCK",
              help="Matrices of a PredictiveController: the same regulator with limits of commands, their rates, and "
              "measured values.")
@click.option("--horizon", type=Whole(1), default=10, show_default=True,
              help="With --mpc: number of samples over which the limits are kept; 30 commands at most.")
@click.option("--weigh", metavar="FORMULA=SIZE", multiple=True,
              help="With --lqg and --mpc: a signal and the deviation that counts as 1: crown.x='10 mm'. May be repeated.")
@click.option("--effort", metavar="NUMBERS", default="1", show_default=True,
              help="With --lqg and --mpc: outputs of the block that count as 1.")
@click.option("--disturbance", "disturbances", metavar="INPUT=SIZE", multiple=True,
              help="With --lqg and --mpc: a signal or force with white noise, root of its spectral density in SI. May be "
              "repeated.")
@click.option("--noise", metavar="NUMBERS", default="1e-3", show_default=True,
              help="With --lqg and --mpc: noise of the inputs of the block, root of its spectral density.")
@click.option("--over", "overs", metavar="PATH=VALUES", multiple=True,
              help="Further operating points for the margins: ahc.valve.f_n='0.75 Hz, 5 Hz'. May be repeated.")
@click.option("--at", metavar="TIME", help="Run to this time first, and linearise there.")
@set_option
@click.option("--write", "written", metavar="FILE", type=click.Path(path_type=Path),
              help="Write a diagram that extends DIAGRAM with the values (.yaml, must be new).")
@click.option("--in-place", is_flag=True, help="Write the values into DIAGRAM; comments and layout are kept.")
@native_option
@json_option
def design(model: str, loop: str | None, free: tuple[str, ...], lead: str | None, notch: str | None,
           schedule: str | None, crossover: str | None, bandwidth: str | None, phase_margin: str | None,
           filtered: str | None, kind: str, order: int, cut_off: str | None, band: str, ripple: float, attenuation: float,
           lqr: str | None, lqg: str | None, mpc: str | None, horizon: int, weigh: tuple[str, ...], effort: str,
           disturbances: tuple[str, ...], noise: str, overs: tuple[str, ...], at: str | None, settings: tuple[str, ...],
           written: Path | None, in_place: bool) -> dict[str, object]:
    """Design a controller of DIAGRAM on the linearised machine, with its samples, holds and delays.

    heavebond design cmc_ahc --loop command --free controller.K_p --crossover '0.2 Hz'

    heavebond design servo.yaml --loop pid.y --free pid.K_p,pid.K_i,pid.K_d --crossover '3 Hz' --phase-margin '60 deg'
    --over load.J='1 kg*m**2, 3 kg*m**2' --in-place

    heavebond design servo.yaml --loop pid.y --notch notch --in-place

    heavebond design servo.yaml --filter smoothing --type bessel --order 4 --cut-off '50 Hz'

    The margins belong to the complete linearised machine at each operating point. Dry friction is linearised at rest, where
    it locks its parts: --set its forces to 0 for the machine in motion.
    """
    from heavebond.commands import terminal
    from heavebond.language.model import load
    from heavebond.linear.stability import UNSTABLE
    from heavebond.numerics.dae import assemble

    if loop is None and (lead or notch or schedule or free):
        raise UsageError([Problem("design-task", "--free, --lead, --notch and --schedule need the signal of the loop", None,
                                  "Add for example --loop controller.y.")])
    if sum(task is not None for task in (loop, filtered, lqr, lqg, mpc)) != 1:
        raise UsageError([Problem("design-task", "exactly one of --loop, --filter, --lqr, --lqg and --mpc is needed", None,
                                  "Write for example --loop controller.y --free controller.K_p --crossover '1 Hz'.")])
    if loop is not None and sum([bool(free), lead is not None, notch is not None]) > 1:
        raise UsageError([Problem("design-task", "with --loop exactly one of --free, --lead and --notch is needed", None,
                                  "Design a notch first, and the gains in a second step.")])
    if schedule is not None and (lead or notch):
        raise UsageError([Problem("design-task", "--schedule cannot be combined with --lead or --notch", None,
                                  "Give the gains of the table, for example --free control.K_p,control.K_i.")])
    _check_options("free" if schedule is not None else next(
        task for task, block in (("lead", lead), ("notch", notch), ("filter", filtered), ("lqr", lqr), ("lqg", lqg),
                                 ("mpc", mpc), ("free", loop)) if block is not None))
    if written is not None:
        check_new(written, (".yaml",))
    if in_place and not Path(model).is_file():
        raise UsageError([Problem("design-place", f"'{model}' is not a file that can be changed", None,
                                  "Give --write FILE for a new diagram that extends it.")])
    items: list[Item]
    texts: dict[str, Tree]
    with blamed_on_settings(settings, overs), terminal.working("design"):
        diagram = with_settings(load(model), settings)
        units = {q.name: q.unit for q in assemble(diagram).flat.parameters}
        if loop is not None and schedule is not None:
            items, texts, figures = _schedule(diagram, loop, schedule, listed(free), crossover, bandwidth, phase_margin, at,
                                              overs)
        elif loop is not None:
            items, values, figures = _loop(diagram, loop, listed(free), lead, notch, crossover, bandwidth, phase_margin, at,
                                           overs)
            texts = {name: diagram.written(name, value, units[name]) for name, value in values.items()}
        elif filtered is not None:
            items, texts, figures = _filter(diagram, filtered, kind, order, cut_off, band, ripple, attenuation)
        else:
            items, texts, figures = _observer(diagram, lqr, lqg, mpc, weigh, effort, disturbances, noise, horizon, at, overs)
    terminal.show(items)
    if figures.get("verdict") == UNSTABLE:
        problem = ModelError([Problem(
            "design-unstable", "the closed loop with the designed values is unstable; nothing is written", None,
            "Lower the crossover, give a larger phase margin, or put a NotchFilter at the growing mode (--notch). If the "
            "machine reverses the sign of the command, reverse it in the diagram: the gains of a design are positive."
            if loop is not None else "Sample faster, or give larger sizes under --weigh and --noise.")])
        problem.figures = {"model": diagram.name, **figures, "values": texts, "files": []}
        raise problem
    files = _written(diagram, Path(model), texts, settings_of("--set", settings), written, in_place)
    for path in files:
        terminal.output().print(f"wrote {path}", soft_wrap=True)
    return {"model": diagram.name, **figures, "values": texts, "files": list(map(str, files))}


def _check_options(task: str) -> None:
    """UsageError for an option of the command line that has no effect on the task."""
    context = click.get_current_context()
    for option in context.command.params:
        tasks = _TASKS.get(option.name or "", (task,))
        if task not in tasks and context.get_parameter_source(option.name or "") is click.core.ParameterSource.COMMANDLINE:
            raise UsageError([Problem("design-task", f"{option.opts[-1]} has no effect on a design by --{task}", None,
                                      f"Leave it out, or design by one of {listing([f'--{name}' for name in tasks])}.")])


def _points(overs: Sequence[str]) -> dict[str, dict[str, str | float]]:
    """The operating points of --over by name."""
    from heavebond.studies.sweep import read_over

    return {f"{axis.path} = {value}": {axis.path: value} for axis in map(read_over, overs) for value in axis.values}


def _margins(points: Mapping[str, Crossings]) -> dict[str, object]:
    """The verdicts and margins at operating points, for JSON."""
    return {name: {"verdict": loop.verdict, **{
        kind: None if margin is None else [margin.value, margin.frequency] for kind, margin in (
            ("gain_up", loop.gain_up), ("gain_down", loop.gain_down), ("phase", loop.least_phase),
            ("delay", loop.least_delay))}} for name, loop in points.items()}


def _loop(diagram: Model, loop: str, free: Sequence[str], lead: str | None, notch: str | None, crossover: str | None,
          bandwidth: str | None, phase_margin: str | None, at: str | None, overs: Sequence[str]
          ) -> tuple[list[Item], Mapping[str, float], dict[str, object]]:
    from heavebond.linear.design import design_gains, design_lead, design_notch
    from heavebond.reports.analysis_tables import design_items

    points = _points(overs)
    if lead is not None:
        if phase_margin is None:
            raise UsageError([Problem("design-margin", "a lead or lag needs a phase margin", None,
                                      "Give for example --phase-margin '60 deg'.")])
        result = design_lead(diagram, loop, lead, crossover=crossover, bandwidth=bandwidth, phase_margin=phase_margin, at=at,
                             points=points)
    elif notch is not None:
        result = design_notch(diagram, loop, notch, at=at, points=points)
    else:
        result = design_gains(diagram, loop, free, crossover=crossover, bandwidth=bandwidth, phase_margin=phase_margin,
                              at=at, points=points)
    return design_items(diagram, result), result.values, {
        "verdict": result.crossings.verdict,
        "crossover": result.crossover, "bandwidth": result.bandwidth, "phase_margin": result.phase_margin,
        "margins": _margins({"design": result.crossings, **result.points})}


def _schedule(diagram: Model, loop: str, block: str, free: Sequence[str], crossover: str | None, bandwidth: str | None,
              phase_margin: str | None, at: str | None, overs: Sequence[str]
              ) -> tuple[list[Item], dict[str, Tree], dict[str, object]]:
    """The tables, the values and the figures of a table of gains."""
    from heavebond.linear.design import design_schedule
    from heavebond.linear.stability import UNSTABLE
    from heavebond.numerics.dae import assemble
    from heavebond.reports.analysis_tables import schedule_items
    from heavebond.studies.sweep import read_over

    axes = [read_over(over) for over in overs]
    result = design_schedule(diagram, loop, block, free, {axis.path: axis.values for axis in axes}, crossover=crossover,
                             bandwidth=bandwidth, phase_margin=phase_margin, at=at)
    units = {q.name: q.unit for q in assemble(diagram).flat.parameters}
    texts: dict[str, Tree] = {name: [units[f"{name}[{k}]"].written(result.values[f"{name}[{k}]"])
                                     for k in range(1, len(result.inputs) + 1)] for name in (f"{block}.x", *free)}
    verdicts = {name: check.verdict for name, check in result.checks.items()}
    return schedule_items(diagram, result, block, free), texts, {
        "verdict": UNSTABLE if UNSTABLE in verdicts.values() else next(iter(verdicts.values())), "verdicts": verdicts}


def _filter(diagram: Model, block: str, kind: str, order: int, cut_off: str | None, band: str, ripple: float,
            attenuation: float) -> tuple[list[Item], dict[str, Tree], dict[str, object]]:
    from heavebond.core.units import UnitProblem, check_unit, parse_quantity, unit
    from heavebond.linear.design import filter_coefficients
    from heavebond.numerics.dae import assemble
    from heavebond.reports.result_tables import Line, ResultTable

    known = assemble(diagram).parameter_values
    blocks = sorted({n.removesuffix(".a[1]") for n in known if n.endswith(".a[1]") and n[:-4] + "b[1]" in known})
    if block not in blocks:
        which = f": {listing(blocks)}" if blocks else "; this diagram has none"
        raise UsageError([Problem("design-block", f"'{block}' has no coefficients a and b", None,
                                  f"Name a TransferFunction or a DiscreteTransferFunction{which}.")])
    frequencies = []
    for text in list_items(cut_off or ""):
        try:
            number, read = parse_quantity(text)
            check_unit(read, unit("Hz"), number, text)
        except UnitProblem as problem:
            raise UsageError([Problem(problem.code, f"--cut-off: {problem.message}", None, problem.hint)]) from None
        frequencies.append(number)
    period = known.get(f"{block}.T_s")
    b, a = filter_coefficients(kind, order, frequencies, band, ripple=ripple, attenuation=attenuation, period=period,
                               time_unit=known.get(f"{block}.T", 1.0))
    rows = [(f"{'z' if period else 's'}^{len(a) - 1 - k}", f"{x:.10g}", f"{y:.10g}") for k, (x, y) in enumerate(
        zip(b, a, strict=True))]
    lists: dict[str, Tree] = {f"{block}.n": str(len(a))}
    lists |= {f"{block}.{name}": [repr(float(x)) for x in numbers] for name, numbers in (("b", b), ("a", a))}
    return [ResultTable(f"{block}: {kind} {band} of order {order}", ("power", "numerator b", "denominator a"), rows),
            Line(f"sampled every {period:g} s" if period else f"time unit {known.get(f'{block}.T', 1.0):g} s")], \
        lists, {"b": b.tolist(), "a": a.tolist(), "period": period}


def _observer(diagram: Model, lqr: str | None, lqg: str | None, mpc: str | None, weigh: Sequence[str], effort: str,
              disturbances: Sequence[str], noise: str, horizon: int, at: str | None, overs: Sequence[str]
              ) -> tuple[list[Item], dict[str, Tree], dict[str, object]]:
    """The tables, the values and the figures of a state feedback, an LQG controller or a predictive controller."""
    from heavebond.core.presentation import count
    from heavebond.core.quantities import si_value
    from heavebond.linear.optimal_design import ObserverController, StateFeedback, design_lqg, design_lqr, design_mpc
    from heavebond.linear.stability import UNSTABLE
    from heavebond.numerics.dae import assemble
    from heavebond.reports.analysis_tables import observer_items

    def numbers(option: str, texts: Sequence[str]) -> list[float]:
        return [si_value(text, "1", option) for text in texts]

    deviations = settings_of("--weigh", weigh, "load.x='1 mm'")
    densities = settings_of("--disturbance", disturbances, "load.f='10 N'")
    if not deviations or (lqr is None and not densities):
        filtered, example = (", and its filter --disturbance", " --disturbance force.u='10 N'") if lqr is None else ("", "")
        raise UsageError([Problem("design-weights", f"a regulator needs --weigh{filtered}", None,
                                  f"Write for example --weigh load.x='1 mm'{example}.")])
    sizes = deviations, numbers("--effort", list_items(effort)), densities, numbers("--noise", list_items(noise))
    block, title, points = lqr or lqg or mpc or "", "observer controller", _points(overs)
    result: ObserverController | StateFeedback
    if lqr is not None:
        result, title = design_lqr(diagram, block, *sizes[:2], at=at, points=points), "state feedback"
        matrices, counts = {"K": result.matrix}, {}
    elif mpc is not None:
        design = design_mpc(diagram, block, *sizes, horizon=horizon, at=at, points=points)
        result, title = design.controller, f"predictive controller with a horizon of {count(horizon, 'sample')}"
        matrices = {"A": design.a, "B": design.b, "C": design.c, "L": design.observer, "F": design.plan,
                    "W": design.response, "S": design.soft}
        counts = {"n": len(design.a), "N": horizon}
    else:
        result = design_lqg(diagram, block, *sizes, at=at, points=points)
        matrices, counts = {"A": result.a, "B": result.b, "C": result.c}, {"n": len(result.a)}
    texts: dict[str, Tree] = {f"{block}.{name}": str(number) for name, number in counts.items()}
    units = {q.name: q.unit for q in assemble(diagram).flat.parameters}
    period = result.period if isinstance(result, ObserverController) else None
    for name, matrix in matrices.items():
        unit = "" if lqr is not None or name == "C" or period is not None else "1/s"
        per = f" {units[f'{block}.K[1][1]'].text if lqr is not None else unit}".removesuffix(" ").removesuffix(" 1")
        rows: list[Tree] = [[f"{value!r}{per}" for value in row] for row in matrix.reshape(-1, matrix.shape[-1]).tolist()]
        texts[f"{block}.{name}"] = rows if matrix.ndim == 2 else rows[0]
    at_design = {loop.verdict for name, loop in result.points.items() if name.partition(",")[0] == "design"}
    return observer_items(f"{block}: {title}", result), texts, {
        "verdict": UNSTABLE if UNSTABLE in at_design else next(iter(at_design), None), "margins": _margins(result.points),
        **{name.lower(): matrix.tolist() for name, matrix in matrices.items()}, "states": list(result.states)}


def _written(diagram: Model, path: Path, texts: Mapping[str, Tree], settings: Mapping[str, str], written: Path | None,
             in_place: bool) -> list[Path]:
    from heavebond.core.writable import write_text
    from heavebond.language.edits import extended_from, with_values, write

    files = []
    if in_place:
        write_text(path, with_values(path.read_text(encoding="utf-8"), texts))
        files.append(path)
    if written is not None:
        head = f"model: {written.stem}\nsummary: {diagram.name} with a designed controller.\n" \
            f"extends: {extended_from(written, diagram.path)}\nset: {{}}\n"
        write(written, with_values(head, {**settings, **texts}))
        files.append(written)
    return files
