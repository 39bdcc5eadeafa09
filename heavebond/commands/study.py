"""`heavebond study`: run a study file, case by case."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from heavebond.commands.arguments import Whole, json_option, native_option, scheduler_option
from heavebond.core.cancellation import Interrupted, last_heard

if TYPE_CHECKING:
    from heavebond.studies.study import Study


@click.command(short_help="Run a study: many cases tuned, evaluated and compared with published numbers.")
@click.argument("file", metavar="STUDY")
@click.option("-o", "--output", metavar="FOLDER", type=click.Path(path_type=Path, file_okay=False),
              help="Folder for tables and pictures [default: the study's name].")
@click.option("--processes", type=Whole(1), help="Number of cases that run in parallel [default: all processors].")
@click.option("--fresh", is_flag=True, help="Run all cases again, also those that are complete.")
@scheduler_option
@native_option
@json_option
def study(file: str, output: Path | None, processes: int | None, fresh: bool, scheduler: str | None) -> dict[str, object]:
    """Run every case of STUDY, a YAML file or a bundled one (cmc_ahc/quality_index).

    Each completed case is stored in the folder: after Ctrl-C the same command continues.
    """
    from heavebond.studies.study import load_study

    loaded = load_study(file)
    return work_out(loaded, output or Path(loaded.path.stem), processes, fresh, scheduler)


def work_out(study: Study, folder: Path, processes: int | None, fresh: bool, scheduler: str | None) -> dict[str, object]:
    """Run a study, print its results and write its files; return the figures for JSON."""
    from heavebond.commands import terminal
    from heavebond.core.cluster import connected
    from heavebond.reports.study_tables import study_items, write_study
    from heavebond.studies.campaign import study as run_study
    from heavebond.studies.tables import as_dict

    with connected(scheduler) as cluster, terminal.working("study") as progress:
        result = run_study(study, folder=folder, processes=processes, executor=cluster, fresh=fresh, progress=progress)
    terminal.show(study_items(result))
    files = write_study(result, folder)
    console = terminal.output()
    for path in files:
        console.print(f"wrote {path}", soft_wrap=True)
    if not result.complete:
        console.print(f"stopped with {len(result.outcomes)} of {result.jobs} done; the same command continues",
                      soft_wrap=True)
        raise Interrupted(last_heard(), {**as_dict(result), "files": list(map(str, files))})
    return {**as_dict(result), "files": list(map(str, files))}
