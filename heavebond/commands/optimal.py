"""`heavebond optimal`: the best input of a machine within its limits, by direct collocation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from heavebond.commands.arguments import (
    Whole,
    blamed_on_settings,
    check_picture,
    check_writable,
    json_option,
    native_option,
    picture_option,
    set_option,
    settings_of,
    with_settings,
)
from heavebond.core.errors import ModelError, Problem, UsageError

if TYPE_CHECKING:
    from heavebond.numerics.dae import Assembly
    from heavebond.optimise.optimal import Optimal, OptimalProblem
    from heavebond.studies.study import Study


@click.command(short_help="Compute the best input within the limits of a machine.")
@click.argument("study", metavar="STUDY|DIAGRAM")
@click.option("--free", metavar="SIGNAL=RANGE", multiple=True,
              help="A signal whose law is replaced by the best function of time: controller.u='-1 .. 1'. May be repeated.")
@click.option("--cost", metavar="FORMULA", help="The cost to minimise, e.g. 'deviation(WOB)'.")
@click.option("--limit", "limits", metavar="FORMULA", multiple=True,
              help="A limit, e.g. 'peak(extension) < 3.8 m'. May be repeated.")
@click.option("--evaluate", metavar="'FROM .. TO'", help="The horizon, e.g. '24 .. 36 s' [default: the whole run].")
@click.option("--periodic", is_flag=True, help="Seek a periodic motion; else the machine begins as in the diagram's run.")
@click.option("--at-end", "ends", metavar="SIGNAL=VALUE", multiple=True,
              help="A value at the end, e.g. cart.x='1 m'. May be repeated.")
@click.option("--duration", metavar="'LOW .. HIGH'", help="A free duration, e.g. '0.2 .. 2 s'; for the shortest one "
              "--cost 'integral(1)'.")
@click.option("--intervals", type=Whole(2), help="Intervals of the first grid [default: 100].")
@click.option("--hold", is_flag=True, help="Inputs are constant in each interval; else they are straight lines.")
@set_option
@picture_option("Draw free signals and outputs: optimal run, collocation, and the diagram's own run")
@click.option("--save", "saved", metavar="FILE", type=click.Path(path_type=Path),
              help="Write the verifying run with the input (.csv, .parquet, .mat, .nc), of a study with one case.")
@native_option
@json_option
def optimal(study: str, free: tuple[str, ...], cost: str | None, limits: tuple[str, ...], evaluate: str | None,
            periodic: bool, ends: tuple[str, ...], duration: str | None, intervals: int | None, hold: bool,
            settings: tuple[str, ...], output: Path | None, saved: Path | None) -> dict[str, object]:
    """Compute the input of least cost that any controller of these signals could reach, and verify it by a run.

    heavebond optimal cmc_ahc/studies/optimal --output best.png

    heavebond optimal positioning.yaml --free motor.u='-24 .. 24 V' --cost 'integral(1)' --duration '0.1 .. 2 s'
    --at-end load.phi='1 rad' --at-end load.w='0 rad/s'

    STUDY is a file with `optimal:`; each of its cases is computed. The laws of the free signals are replaced; everything
    else is the diagram. The verdict compares the collocation with the run. A result is a local optimum unless the problem
    is convex.
    """
    from heavebond.commands import terminal
    from heavebond.reports.analysis_tables import optimal_figures, optimal_items
    from heavebond.studies.study import load_study
    from heavebond.studies.tuning_request import horizon

    check_picture(output)
    if saved is not None:
        check_writable(saved)
    loaded: Study | None = None
    try:
        loaded = load_study(study)
    except ModelError as error:
        if error.problems[0].code != "not-a-study":
            raise
        if not free:
            raise UsageError([Problem("free-missing", f"'{study}' is not a study, and no signal is free", None,
                                      "For a diagram add for example --free motor.u='-24 .. 24 V' --cost 'rms(load.x)'. A "
                                      "study begins with `study: name`.")]) from None
    results: dict[str, tuple[Assembly, Optimal]] = {}
    with blamed_on_settings(settings), terminal.working("optimal input") as progress:
        from heavebond.language.model import load
        from heavebond.numerics.dae import assemble
        from heavebond.optimise.optimal import optimal as best

        if loaded is not None and loaded.optimal is None:
            raise UsageError([Problem("study-not-optimal", f"the study '{loaded.name}' has no `optimal:`", None,
                                      "Add `optimal: {free: {SIGNAL: RANGE}, cost: FORMULA}`.")])
        models = [(case.name if loaded.axes else "", case.model) for case in loaded.cases] if loaded is not None else \
            [("", load(study))]
        assemblies = [assemble(with_settings(model, settings)) for _, model in models]
        flat = assemblies[0].flat
        units = {name: flat.unknowns[k].unit.text for name, k in flat.names.items()}
        task = _task(loaded.optimal if loaded is not None else None, free, cost, limits, ends, duration, units)
        begin, end = (task.begin, task.end) if evaluate is None else horizon(evaluate)
        task = replace(task, begin=begin, end=end, start="periodic" if periodic else task.start,
                       intervals=intervals or task.intervals, interpolation="hold" if hold else task.interpolation)
        for k, ((name, _), assembly) in enumerate(zip(models, assemblies, strict=True), 1):
            say = (lambda text, k=k: progress(f"case {k} of {len(models)}: {text}")) if len(models) > 1 else progress
            results[name] = assembly, best(assembly, task, progress=say)
    title = loaded.name if loaded is not None else models[0][1].name
    measures = {} if loaded is None else {name: (measure.text, measure.unit) for name, measure in loaded.measures.items()}
    terminal.show(optimal_items(title, results, measures))
    files = _files(title, {name: result for name, (_, result) in results.items()}, output, saved)
    return {**optimal_figures(title, results, measures), "files": list(map(str, files))}


def _task(written: OptimalProblem | None, free: Sequence[str], cost: str | None, limits: Sequence[str], ends: Sequence[str],
          duration: str | None, units: Mapping[str, str]) -> OptimalProblem:
    """The problem of a study, with options in place of its entries; the problem of a diagram consists of options only.
    `units` are the units of the signals by name."""
    from heavebond.core.quantities import ranges
    from heavebond.optimise.optimal import optimal_task

    if written is None and cost is None:
        raise UsageError([Problem("cost-missing", "no cost is given", None, "Add for example --cost 'rms(load.x)'.")])
    free_ranges = ranges(settings_of("--free", free, "motor.u='-24 .. 24 V'"), units)
    from_options = optimal_task(free_ranges, cost or "", limits=limits,
                                at_end=settings_of("--at-end", ends, "load.x='0.3 m'"), duration=duration)
    if written is None:
        return from_options
    return replace(written, free={**written.free, **from_options.free}, cost=cost or written.cost,
                   limits=(*written.limits, *limits), at_end={**written.at_end, **from_options.at_end},
                   duration=from_options.duration or written.duration)


def _files(title: str, results: Mapping[str, Optimal], output: Path | None, saved: Path | None) -> list[Path]:
    from heavebond.commands import terminal

    files = list[Path]()
    if output is not None:
        from heavebond.pictures.plot import plot_runs, save

        for name, result in results.items():
            path = output if len(results) == 1 else output.with_stem(f"{output.stem}_{len(files) + 1}")
            names = list(result.trajectory.values)
            runs = {"optimal, run": result.run.saved(names), "optimal, collocation": result.trajectory,
                    "diagram": result.diagram}
            files.append(save(plot_runs(runs, names, title=f"{title}: {name}" if name else title), path))
    if saved is not None:
        if len(results) > 1:
            raise UsageError([Problem("save-several", f"the study has {len(results)} cases, and --save writes one run", None,
                                      "Give the diagram of one case in place of the study.")])
        result = next(iter(results.values()))
        result.run.save(saved, list(result.trajectory.values))
        files.append(saved)
    for path in files:
        terminal.output().print(f"wrote {path}", soft_wrap=True)
    return files
