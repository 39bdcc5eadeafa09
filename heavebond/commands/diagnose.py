"""`heavebond diagnose`: identify the physical effect that is missing in a diagram."""

from __future__ import annotations

from pathlib import Path
from signal import SIGINT
from typing import TYPE_CHECKING

import click

from heavebond.commands.arguments import Number, Whole, check_writable, json_option, native_option, scheduler_option

if TYPE_CHECKING:
    from heavebond.estimation.experiment import Experiment


@click.command(short_help="Identify the physical effect that is missing in a model.")
@click.argument("experiment")
@click.option("--steps", type=Whole(1), metavar="N", default=5, show_default=True, help="Add up to N effects, as long as "
              "more than the noise is left and each is statistically justified.")
@click.option("--only", "classes", metavar="CLASS", multiple=True, help="Try effects of this class only. May be repeated.")
@click.option("--seconds", type=Number(0, min_open=True), default=600.0, show_default=True,
              help="Time for the whole command; the search then ends with its best result so far.")
@click.option("--processes", type=Whole(1), help="Number of parallel processes [default: all processors].")
@click.option("--samples", type=Whole(100), metavar="N", help="Search on the beginning of the fitted records, so many "
              "points in time [default: all, or 5000 of more than 30000].")
@click.option("--folder", metavar="FOLDER", type=click.Path(path_type=Path, file_okay=False),
              help="Folder for the files; created if it does not exist [default: the folder of EXPERIMENT].")
@click.option("--resume", is_flag=True, help="Continue the same search from its stored results, if it was ended early.")
@click.option("--report", "report_file", metavar="FILE", type=click.Path(path_type=Path),
              help="The report [default: NAME_report.html in the folder].")
@scheduler_option
@native_option
@json_option
def diagnose(experiment: str, steps: int, classes: tuple[str, ...], seconds: float, processes: int | None,
             samples: int | None, folder: Path | None, resume: bool, report_file: Path | None,
             scheduler: str | None) -> dict[str, object]:
    """Identify the physical effect that is missing in the model of EXPERIMENT, its place, and the confidence of the result.

    Writes a diagram that extends the model with the effect, the experiment on it (NAME_2.yaml) and a report
    (NAME_report.html). Held-out records decide; without any, sections of the records are held out. Ctrl-C and SIGTERM end
    the search with the best result so far, which is written too (exit code 0 after Ctrl-C, 143 after SIGTERM).
    If a part of the search ends by a fault of heavebond, the other results are written too, with exit code 70.
    NAME_refits.jsonl stores the completed refits until the search ends: --resume continues from them, also after a crash.
    """
    from heavebond.commands import terminal
    from heavebond.core.cancellation import Budget, Interrupted, finishing, last_heard
    from heavebond.core.cluster import connected
    from heavebond.core.errors import FaultError, HeavebondError
    from heavebond.core.kept_lines import KeptLines
    from heavebond.core.writable import write_text
    from heavebond.diagnosis.answer.files import Targets, write_findings, write_proposal
    from heavebond.diagnosis.diagnose import diagnose as diagnosed
    from heavebond.diagnosis.search.workers import keeping
    from heavebond.estimation.experiment import load_experiment
    from heavebond.reports.report import report
    from heavebond.reports.result_tables import diagnosis_items

    budget = Budget(seconds)
    loaded = load_experiment(experiment)
    check_classes(loaded, classes)
    targets = Targets.beside(loaded, folder)
    page = report_file or targets.report
    check_writable(page, (".html",))
    kept_lines = KeptLines.begin(targets.kept, resume)
    if resume and not kept_lines.known:
        terminal.warn(f"{targets.kept} holds no results of this search: it begins anew")
    try:
        with connected(scheduler) as cluster, terminal.working("diagnosing") as progress, keeping(kept_lines):
            result = diagnosed(loaded, steps=steps, number=processes, executor=cluster, seconds=budget.left(),
                               classes=classes,
                               samples=samples, progress=progress)
    except KeyboardInterrupt:
        click.echo("ended before all records were simulated: there is nothing to report yet", err=True)
        raise
    with finishing(terminal.warn):
        terminal.show(diagnosis_items(result))
        targets = Targets.beside(loaded, folder)  # another command may have written to this folder meanwhile
        files = write_findings(loaded, result.added, targets)
        proposed = write_proposal(result.separation, targets.proposal) if result.separation is not None else []
    with finishing(terminal.warn):
        pages = [report_file or targets.report]
        try:
            write_text(pages[0], report(result, result.localization, written=files))
        except (HeavebondError, OSError):
            raise
        except Exception as fault:  # the results are printed and written to the other files
            terminal.warn(f"the report {pages.pop()} is not written, by a fault of heavebond itself, "
                          f"{type(fault).__name__}: {fault}")
    console = terminal.output()
    if (files or proposed) and targets.passed:
        console.print(f"{targets.passed} exists and is kept: the new files have the next free number", soft_wrap=True)
    for path in (*files, *proposed, *pages):
        console.print(f"wrote {path}", soft_wrap=True)
    if result.partial and not result.faults:
        again = "with --resume continues" if kept_lines.known else "searches anew"
        console.print(f"the search was ended early: the same command {again}, --only CLASS narrows it, --seconds gives it "
                      f"more time than {seconds:g} s", soft_wrap=True)
    elif not result.partial:
        kept_lines.remove()
    if files and result.partial:
        console.print(f"to see its errors: heavebond compare {files[-1]}", soft_wrap=True)
    elif files:
        look = "fit" if result.started else "compare"  # a comparison would begin with the starts of the diagram
        console.print(f"next: heavebond {look} {files[-1]}; heavebond diagnose {files[-1]}", soft_wrap=True)
    elif result.verdict == "parameters":
        keep = f"keep the starts in {experiment} as described above, then " if result.started else ""
        console.print(f"next: {keep}heavebond fit {experiment} --write fitted.yaml", soft_wrap=True)
    if result.verdict == "shape":
        console.print(f"for a law outside the catalogue as a formula: heavebond laws {experiment}", soft_wrap=True)
    figures = {"experiment": loaded.name, **result.as_dict(), "files": [str(f) for f in (*files, *proposed, *pages)]}
    if result.partial and (number := last_heard()) != SIGINT:  # a batch system sees that the search is not complete
        raise Interrupted(number, figures)
    if result.faults or not pages:
        error = FaultError("a part of the search ended by a fault of heavebond itself, not of your files",
                           hint="The answer above states the fault, and holds what was known before. Report it with the "
                           "files of the command to who maintains heavebond for you.")
        error.figures = figures
        raise error
    return figures


def check_classes(experiment: Experiment, classes: tuple[str, ...]) -> None:
    """Raise UsageError for a class that no effect of the catalogue has in this diagram."""
    from heavebond.core.errors import Problem, UsageError, listing, suggest
    from heavebond.diagnosis.candidates.fixed_values import classes_of

    known = classes_of(experiment) if classes else []
    for name in classes:
        if name not in known:
            raise UsageError([Problem("class-unknown", f"no effect of class '{name}' fits in this diagram", None,
                                      suggest(name, known) or f"Classes: {listing(known, 40)}.")])
