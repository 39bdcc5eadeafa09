"""`heavebond monitor`: filter records and report those that leave the model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from heavebond.commands.arguments import Number, Whole, json_option, native_option, scheduler_option, settings_of
from heavebond.core.errors import DataError, Problem, listing

if TYPE_CHECKING:
    from heavebond.monitoring.monitor import Monitoring


@click.command(short_help="Report the records that leave the model.")
@click.argument("experiment")
@click.argument("records", metavar="RECORDS...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--walk", "walks", metavar="NAME=VALUE", multiple=True,
              help="Process noise of a state, or random walk of a free parameter: its standard deviation after one second, "
              "e.g. --walk load.v='1 mm/s'. A parameter with 0 is estimated as a constant. May be repeated.")
@click.option("--rate", metavar="SHARE", default="1 %", show_default=True,
              help="Probability of a false alarm in a record of a sound machine.")
@click.option("--record", metavar="NAME", help="Record of EXPERIMENT with the settings of the monitored machine [default: "
              "the first].")
@click.option("--start-deviation", metavar="SHARE", default="2 %", show_default=True,
              help="Standard deviation of the state at the beginning of a record, as a share of the span of each state.")
@click.option("--diagnose", "number", type=Whole(0), metavar="N", default=1, show_default=True,
              help="Diagnose the first N records that leave the model.")
@click.option("--seconds", type=Number(0, min_open=True), default=600.0, show_default=True,
              help="Time for each diagnosis; its search then ends with its best result so far.")
@click.option("--estimates", is_flag=True, help="Write the estimated states of each record as Parquet.")
@click.option("--processes", type=Whole(1), help="Number of parallel processes [default: all processors].")
@click.option("-o", "--output", metavar="FOLDER", type=click.Path(path_type=Path, file_okay=False),
              help="Folder for table, page and pictures [default: EXPERIMENT_monitor].")
@scheduler_option
@native_option
@json_option
def monitor(experiment: str, records: tuple[Path, ...], walks: tuple[str, ...], rate: str, record: str | None,
            start_deviation: str, number: int, seconds: float, estimates: bool, processes: int | None, output: Path | None,
            scheduler: str | None) -> dict[str, object]:
    """Filter RECORDS by the model of EXPERIMENT, and report those that leave the model, with the time.

    RECORDS are files and folders; in a folder, all files with a format of records are read. The records have the columns
    that EXPERIMENT names. Writes monitor.parquet, monitor.html and a picture of each record that leaves the model
    (NAME.png); the time after the change is diagnosed (NAME_report.html). Records that cannot be used are listed with the
    reason. Exit code 0: all records agree with the model; 1: a record leaves the model or cannot be used; 2: wrong usage.
    Ctrl-C writes the records finished so far.
    """
    from heavebond.commands import terminal
    from heavebond.core.cluster import connected
    from heavebond.core.errors import UsageError
    from heavebond.core.writable import make_folder, new_file, write_text
    from heavebond.estimation.experiment import load_experiment
    from heavebond.monitoring.monitor import monitor as monitored
    from heavebond.pictures.plot import save
    from heavebond.reports.monitoring_page import monitoring_items, monitoring_page

    loaded = load_experiment(experiment)
    target = output or Path(f"{loaded.path.stem}_monitor")
    if target.resolve() in {path.resolve() for path in records}:
        raise UsageError([Problem("folder-same", f"the output folder '{target}' is the folder of the records", None,
                                  "Give another folder with --output.")])
    make_folder(target)
    with connected(scheduler) as cluster, terminal.working("monitoring") as progress:
        monitoring = monitored(loaded, records, walks=settings_of("--walk", walks, "load.v='1 mm/s'"), rate=rate,
                               record=record, start_deviation=start_deviation, estimates=estimates, processes=processes,
                               executor=cluster, progress=progress)
    terminal.show(monitoring_items(monitoring))
    files = [target / "monitor.parquet"]
    try:
        monitoring.save(files[0])
    except UsageError as error:
        if error.problems[0].code != "pyarrow-missing":
            raise
        files = [target / "monitor.csv"]
        monitoring.save(files[0])
        terminal.warn("monitor.csv is written in place of Parquet: pip install 'heavebond[parquet]'")
    files += [save(monitoring.plot(r.name), target / f"{r.name}.png") for r in monitoring.changed]
    for name, estimate in monitoring.estimates.items() if estimates else ():
        files.append(target / f"{name}_estimate.parquet")
        with new_file(files[-1]) as fresh:
            estimate.to_pandas().to_parquet(fresh, engine="pyarrow")
    diagnoses = _diagnosed(monitoring, number, seconds, processes, target, files)
    files.append(target / "monitor.html")
    write_text(files[-1], monitoring_page(monitoring, {name: answer["words"] for name, answer in diagnoses.items()}))
    for path in files:
        terminal.output().print(f"wrote {path}", soft_wrap=True)
    figures: dict[str, object] = {"experiment": loaded.name, **monitoring.as_dict(), "diagnoses": diagnoses,
                                  "files": list(map(str, files))}
    if monitoring.partial:
        terminal.output().print("ended early: these are the records that were filtered so far", soft_wrap=True)
    if monitoring.changed or monitoring.unusable:
        names = [r.name for r in (*monitoring.changed, *monitoring.unusable)]
        problem = DataError([Problem("records-changed", f"{len(monitoring.changed)} of {len(monitoring.records)} records "
                                     f"left the model, and {len(monitoring.unusable)} could not be used", None,
                                     f"See {files[-1]} ({listing(names, 8)}).")])
        problem.figures = figures
        raise problem
    return figures


def _diagnosed(monitoring: Monitoring, number: int, seconds: float, processes: int | None, target: Path, files: list[Path]
               ) -> dict[str, dict[str, object]]:
    """The diagnoses of the first records that leave the model, by record; their reports are added to `files`."""
    from heavebond.commands import terminal
    from heavebond.core.errors import HeavebondError
    from heavebond.core.presentation import count
    from heavebond.core.writable import write_text
    from heavebond.diagnosis.diagnose import diagnose
    from heavebond.reports.report import report

    answers: dict[str, dict[str, object]] = {}
    for record in monitoring.changed[:number]:
        try:
            with terminal.working(f"diagnosing {record.name}") as progress:
                result = diagnose(monitoring.window(record.name), seconds=seconds, number=processes, progress=progress)
        except HeavebondError as error:
            terminal.warn(f"{record.name} cannot be diagnosed: {error.problems[0].message}")
            continue
        answers[record.name] = {"verdict": result.verdict, "words": list(result.tree.words)}
        terminal.output().print(f"{record.name}: {' '.join(result.tree.words)}", soft_wrap=True)
        files.append(target / f"{record.name}_report.html")
        write_text(files[-1], report(result, result.localization))
    if len(monitoring.changed) > number:
        remaining = len(monitoring.changed) - number
        are = "is" if remaining == 1 else "are"
        terminal.output().print(f"{count(remaining, 'record')} that left the model {are} not diagnosed: give --diagnose "
                                f"{len(monitoring.changed)}", soft_wrap=True)
    return answers
