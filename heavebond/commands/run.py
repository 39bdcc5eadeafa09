"""`heavebond run`: simulate a diagram; a table of its outputs, pictures and files."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from heavebond.commands.arguments import (
    Number,
    assembled,
    blamed_on_settings,
    check_picture,
    check_writable,
    json_option,
    native_option,
    picture_option,
    read_signals,
    set_option,
    with_settings,
)
from heavebond.core.errors import Problem, UsageError, listing

if TYPE_CHECKING:
    from heavebond.numerics.result import Result
    from heavebond.optimise.verification import Verification


@click.command(short_help="Simulate a diagram; plot and save the results.")
@click.argument("model")
@set_option
@click.option("--from", "begin", metavar="TIME", help="Start time of the simulation, e.g. --from '-10 s'; 0 s without it.")
@click.option("--until", metavar="TIME", help="End time of the simulation, e.g. --until '2 min'.")
@click.option("--every", metavar="TIME", help="Time between output points, e.g. --every '10 ms'.")
@click.option("--plot", "plotted", metavar="SIGNAL", multiple=True,
              help="Draw a variable, an output or a formula of these. May be repeated.")
@click.option("--save", "saved", metavar="FILE", multiple=True, type=click.Path(path_type=Path),
              help="Write the time series; the suffix selects the format, e.g. run.csv. May be repeated.")
@picture_option("Picture file; without --plot all outputs of the diagram are drawn")
@click.option("--rtol", metavar="NUMBER", type=Number(0, 0.1, min_open=True), default=1e-8, show_default=True,
              help="Relative tolerance of the integrator.")
@click.option("--solver", metavar="NAME",
              help="Integration method: auto (the default), idas, cvodes, rosenbrock (compiled), or with a fixed --step "
                   "euler, rk4, backward-euler.")
@click.option("--step", metavar="TIME", help="Step of euler, rk4 and backward-euler, e.g. --step '1 ms'.")
@click.option("--allow-fmu", is_flag=True,
              help="Run the programs in the FMUs of the diagram. Do so only with FMUs you trust.")
@click.option("--verify", "verified", is_flag=True, help="Repeat with tighter tolerances and a tenth of the widths of all "
                                                         "transitions; show how far each output moves.")
@click.option("--within", metavar="SHARE", type=Number(0, 1, min_open=True), default=0.01, show_default=True,
              help="With --verify: allowed change of an output, as a share of its range.")
@native_option
@json_option
def run(model: str, settings: tuple[str, ...], begin: str | None, until: str | None, every: str | None,
        plotted: tuple[str, ...], saved: tuple[Path, ...], output: Path | None, rtol: float, solver: str | None,
        step: str | None, allow_fmu: bool, verified: bool, within: float) -> dict[str, object]:
    """Simulate the diagram MODEL and show minimum, maximum, RMS and final value of each output.

    MODEL is a YAML file or the name of a bundled diagram (cmc_ahc, cmc_ahc/passive).
    """
    from heavebond.commands import terminal
    from heavebond.commands.steady_start import warn_where_it_stands
    from heavebond.language.model import load
    from heavebond.numerics.placeholders import lawless_parts
    from heavebond.numerics.run_verdict import report_verdict
    from heavebond.numerics.simulation import changes_of, simulate
    from heavebond.text.expression import names as names_in

    if plotted and output is None:
        output = Path(re.sub(r"\W+", "_", Path(model).stem) + ".png")
    check_picture(output)
    if saved:
        from heavebond.records.saved_runs import SUFFIXES

        for path in saved:
            check_writable(path, SUFFIXES)
    with blamed_on_settings(settings):
        loaded = with_settings(load(model), settings)
        formulas = read_signals("--plot", plotted, loaded)
        with terminal.working("assembling"):
            assembly = assembled(loaded, "--plot", formulas)
        with terminal.working("integrating"):
            result = simulate(assembly, until, every=every, begin=begin, rtol=rtol, solver=solver, step=step,
                              allow_fmu=allow_fmu)
    listed = list(assembly.model.show) or assembly.state_names or [u.name for u in assembly.flat.unknowns]
    names = list(dict.fromkeys([*listed, *plotted]))
    figures: dict[str, dict[str, float | str]] = {name: {**numbers.as_dict(), "unit": result.unit(name)}
                                                  for name, numbers in result.figures(names).items()}
    if not result.verdict.failed and any(not math.isfinite(float(f["rms"])) for f in figures.values()):
        report_verdict(f"{assembly.model.name}, outputs", result.without_value(names))
    console = terminal.output()
    without_law = result.without_law(names)
    console.print(terminal.table(
        f"{assembly.model.name}, {result.time[0]:.10g} to {result.time[-1]:{'.10g' if result.time[0] else 'g'}} s",
        ("output", "unit", "min", "max", "rms", "final"),
        [(f"{name} *" if name in without_law else name, str(figures[name]["unit"]),
          *(_parameter_text(figures[name][k]) for k in ("min", "max", "rms", "final")))
         for name in names], text=2))
    if without_law:
        parts = lawless_parts(assembly)
        console.print(f"* depends on {listing(parts, 6)}, which {'have' if len(parts) > 1 else 'has'} no law",
                      soft_wrap=True, markup=False)
    if defaults := assembly.flat.expanded.defaults:
        console.print("unconnected: " + ", ".join(f"{name} = {value.text}" for name, value in defaults.items())
                      + " (start value of the input)", soft_wrap=True, markup=False)
    files = _files(result, plotted or listed, output, saved)
    for path in files:
        console.print(f"wrote {path}", soft_wrap=True)
    console.print(_statistics(result), soft_wrap=True)
    fmus = result.statistics.get("fmus", [])
    assert isinstance(fmus, list)
    for line in (*fmus, *changes_of(result)):
        console.print(line, soft_wrap=True)
    growing = warn_where_it_stands(result)
    statistics = {k: v for k, v in result.statistics.items() if k != "quadratures"}
    run_figures: dict[str, object] = {"model": assembly.model.name, "until": float(result.time[-1]),
                                      "points": len(result.time),
            "outputs": figures, "without_law": list(without_law),
            "events": [{"time": time, "name": name} for time, name in result.events],
            "files": list(map(str, files)), "statistics": statistics, "growing": growing}
    if verified:
        from heavebond.numerics.simulator import Tolerances
        from heavebond.optimise.verification import verify

        with blamed_on_settings(settings), terminal.working("repeating with tighter tolerances and narrower transitions"):
            verification = verify(result, names, [n.text for f in formulas.values() for n in names_in(f)], Tolerances(rtol),
                                  within)
        _tell(verification, run_figures)
    return run_figures


def _tell(verification: Verification, figures: dict[str, object]) -> None:
    """Print how far each output moves and add it to the figures; SimulationError if one moves too far."""
    from heavebond.commands import terminal
    from heavebond.optimise.verification import raise_if_moved

    terminal.output().print(terminal.table(
        "change, as a share of the range", ("output", "tolerances / 100", "and widths / 10"),
        [(m.name, f"{m.by_tolerances:.1e}", f"{m.by_widths:.1e}" if verification.widths else "-")
         for m in verification.outputs], text=1))
    shares = {m.name: {"by_tolerances": m.by_tolerances, "by_widths": m.by_widths} for m in verification.outputs}
    figures["verify"] = {"allowed": verification.allowed, "widths": list(verification.widths),
                         "moved": [m.name for m in verification.moved],
                         "outputs": shares}
    raise_if_moved(verification, figures)


def _parameter_text(value: float | str) -> str:
    from heavebond.core.presentation import number

    # smaller values are rounding of the integrator in any unit in use
    return number(0.0 if abs(float(value)) < 1e-12 else float(value))


def _files(result: Result, plotted: Sequence[str], output: Path | None, saved: Sequence[Path]) -> list[Path]:
    written = []
    for path in saved:
        try:
            result.save(path)
        except OSError as error:
            raise UsageError([Problem("file-unwritable", f"'{path}' cannot be written: {error.strerror or error}")]) \
                from None
        written.append(path)
    if output is not None:
        from heavebond.pictures.plot import plot_signals, save

        written.append(save(plot_signals(result, plotted), output))
    return written


def _statistics(result: Result) -> str:
    from heavebond.core.presentation import count

    statistics = result.statistics
    seconds = statistics["seconds"]
    assert isinstance(seconds, dict)
    reduced = result.assembly.reduced
    parts = [f"{count(len(reduced.states), 'state')}, {count(len(reduced.algebraic), 'algebraic unknown')}",
             *([count(len(result.events), "event")] if result.assembly.flat.events else []),
             f"{len(result.time)} points", f"solver {statistics['solver']} ({statistics['why']})",
             f"start {seconds['start']:.2g} s",
             f"integration {seconds['integration']:.2g} s"]
    if "nsteps" in statistics:
        parts.append(f"{statistics['nsteps']} steps" + (f" of {statistics['step']:g} s" if "step" in statistics else ""))
    parts += [clock.text for clock in result.assembly.model.clocks.values()]
    return "; ".join(parts)
