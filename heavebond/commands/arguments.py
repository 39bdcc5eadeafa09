"""Command line options that several commands share."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from heavebond.core.errors import HeavebondError, Problem, Problems, UsageError, suggest
from heavebond.core.numerals import NUMBER as NUMBER_FORM
from heavebond.core.numerals import whole

if TYPE_CHECKING:
    from heavebond.language.model import Model
    from heavebond.numerics.dae import Assembly
    from heavebond.text.expression import Expr

Command = TypeVar("Command", bound=Callable[..., Any])


class Number(click.FloatRange):
    """A finite number within bounds, with the digits 0 to 9."""

    name = "number"  # as --help shows it

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, str) and not re.fullmatch(NUMBER_FORM, value.strip()):
            self.fail(f"{value!r} is not a number.", param, ctx)
        if not math.isfinite(float(value)):
            self.fail(f"{value!r} is too large a number.", param, ctx)
        return super().convert(value, param, ctx)


class Whole(click.IntRange):
    """A finite integer within bounds, with the digits 0 to 9."""

    name = "n"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, str) and whole(value.strip().removeprefix("-")) is None:
            self.fail(f"{value!r} is not a whole number.", param, ctx)
        return super().convert(value, param, ctx)


def json_option(command: Command) -> Command:
    """--json FILE; `main` of the command line writes the file, also after a failure."""
    return click.option("--json", metavar="FILE", expose_value=False,
                        help="Write the results to FILE as JSON, problems included.")(command)


def native_option(command: Command) -> Command:
    """--allow-native; diagrams that the command loads have the permission."""
    def permit(ctx: click.Context, _: click.Parameter, allowed: bool) -> None:
        from heavebond.core.native_permission import native_code

        if allowed:
            ctx.with_resource(native_code())

    return click.option("--allow-native", is_flag=True, is_eager=True, expose_value=False, callback=permit,
                        help="Compile and run the programs of external functions. Do so only with files you trust.")(command)


def scheduler_option(command: Command) -> Command:
    """--scheduler ADDRESS."""
    return click.option("--scheduler", metavar="ADDRESS",
                        help="Work on the workers of this dask scheduler, e.g. tcp://host:8786. Plain tcp has no "
                        "authentication: whoever reaches the port of the scheduler can run programs on its workers. In a "
                        "network that others use, give tls://host:8786 and set the certificates in dask's configuration "
                        "(distributed.comm.tls: ca-file, client.cert, client.key).")(command)


def set_option(command: Command) -> Command:
    """--set PATH=VALUE, as often as wanted."""
    return click.option("--set", "settings", metavar="PATH=VALUE", multiple=True,
                        help="Set a parameter or an input, e.g. --set gas.c='40 kN/m'. May be repeated.")(command)


def at_options(command: Command) -> Command:
    """--at TIME and --steady; see `operating_time`."""
    command = click.option("--steady", is_flag=True, help="Linearise in the steady state, not at the start.")(command)
    return click.option("--at", metavar="TIME", help="Run to this time first, and linearise there.")(command)


def operating_time(at: str | None, steady: bool) -> str | None:
    """Argument of `OperatingPoints`; UsageError if --at and --steady are both given."""
    if at is not None and steady:
        raise UsageError([Problem("at-and-steady", "--at and --steady name two operating points", None,
                                  "Give one of them.")])
    return "steady" if steady else at


def picture_option(words: str) -> Callable[[Command], Command]:
    """--output PICTURE."""
    return click.option("-o", "--output", metavar="PICTURE", type=click.Path(path_type=Path),
                        help=f"{words} (.png, .svg or .pdf).")


def of_option(required: bool) -> Callable[[Command], Command]:
    """--of SIGNAL, as often as wanted."""
    return click.option("--of", metavar="SIGNAL", multiple=True, required=required,
                        help="A variable, an output or a formula of these. May be repeated.")


def parameter_option(more: str) -> Callable[[Command], Command]:
    """--parameter PARAMETER[,PARAMETER...]; see `listed`."""
    return click.option("--parameter", "parameters", metavar="PARAMETER[,...]", multiple=True,
                        help=f"Parameters, separated by commas. {more} May be repeated.")


def listed(texts: Iterable[str]) -> list[str]:
    """The names in texts such as `a.x,b.y`, each once."""
    return list(dict.fromkeys(name for text in texts for name in list_items(text)))


def list_items(text: str) -> list[str]:
    """The items of a text such as `1, 1, 2`, in their order; equal ones are kept."""
    return [item.strip() for item in text.split(",") if item.strip()]


def with_settings(model: Model, settings: Iterable[str]) -> Model:
    """Set every `PATH=VALUE` in the model; UsageError for a text of another form."""
    values = settings_of("--set", settings)
    return model.with_parameters(values) if values else model


def settings_of(option: str, settings: Iterable[str], example: str = "gas.c='40 kN/m'") -> dict[str, str]:
    """`PATH=VALUE` of an option as a mapping; UsageError with an example for a text of another form."""
    values = {}
    for text in settings:
        path, sign, value = (part.strip() for part in text.partition("="))
        if not sign or not path or not value:
            raise UsageError([Problem("set-form", f"{option} {text}: this is not PATH=VALUE", None,
                                      f"Write for example {option} {example}.")])
        values[path] = value
    return values


@contextmanager
def blamed_on_settings(settings: Iterable[str], overs: Iterable[str] = ()) -> Iterator[None]:
    """Inside, report a problem in the text of a --set or --over option as one of the command line instead of a file."""
    try:
        yield
    except HeavebondError as error:
        problems = [_about(problem, settings, overs) for problem in error.problems]
        changed = any(new is not old for new, old in zip(problems, error.problems, strict=True))
        raise (UsageError if changed else type(error))(problems) from None


def _about(problem: Problem, settings: Iterable[str], overs: Iterable[str]) -> Problem:
    """Remove the file position of a problem if it lies in a value that was set by an option."""
    if problem.place is None:
        return problem
    for option, text in (*(("--set", text) for text in settings), *(("--over", text) for text in overs)):
        path, _, value = (part.strip() for part in text.partition("="))
        same = problem.place.text == f"{path}: {value}" if option == "--set" else problem.place.text.startswith(f"{path}: ")
        if same or problem.place.file == f"value of {path}":
            return replace(problem, place=None, message=f"{option} {text}: {problem.message}")
    return problem


def read_signals(option: str, texts: Sequence[str], model: Model) -> dict[str, Expr]:
    """Read the signals of an option as formulas; UsageError if one cannot be read."""
    from heavebond.text.expression import ExpressionProblem

    formulas, problems = {}, Problems()
    for text in texts:
        try:
            formulas[text] = model.library.formula(text)
        except ExpressionProblem as problem:
            problems.add(problem.code, f"{option} {text}: {problem.message}", hint=problem.hint)
    problems.raise_as(UsageError)
    return formulas


def assembled(model: Model, option: str, formulas: dict[str, Expr]) -> Assembly:
    """Assemble the diagram with the positions that only signals of an option need; UsageError for an unknown signal."""
    from heavebond.numerics.dae import assemble
    from heavebond.text.expression import ExpressionProblem, names

    assembly = assemble(model, {name.text for formula in formulas.values() for name in names(formula)})
    # raise UsageError for a signal that the diagram does not have, before the integration begins
    problems, outputs = Problems(), assembly.model.show
    for text, formula in formulas.items():
        try:
            if text not in outputs:
                assembly.resolver().dimension(formula)
                assembly.expression(formula)
        except ExpressionProblem as problem:
            hint = suggest(text, [*outputs, *assembly.flat.names]) or problem.hint
            problems.add(problem.code, f"{option} {text}: {problem.message}", hint=hint)
    problems.raise_as(UsageError)
    return assembly


def check_picture(path: Path | None) -> None:
    """Raise UsageError if no picture can be written to `path`."""
    if path is not None:
        from heavebond.pictures.plot import SUFFIXES

        check_writable(path, SUFFIXES)


def check_writable(path: Path, suffixes: Sequence[str] = ()) -> None:
    """Raise UsageError if a file cannot be written to `path`, before the computation begins."""
    if suffixes and path.suffix.lower() not in suffixes:
        raise UsageError([Problem("file-suffix", f"'{path}' does not end in {' or '.join(suffixes)}", None,
                                  f"Write for example {path.stem or 'file'}{suffixes[0]}.")])
    from heavebond.core.writable import why_unwritable

    if path.is_dir():
        reason = "it is a folder"
    elif path.exists() and not os.access(path, os.W_OK):
        reason = "permission denied"
    else:
        # the new file is created in the folder of the old one; a device or a pipe is written directly
        target = Path(os.path.realpath(path))
        reason = "" if target.exists() and not target.is_file() else why_unwritable(target.parent)
    if reason:
        missing = not path.is_dir() and not path.parent.is_dir()
        raise UsageError([Problem("file-unwritable", f"'{path}' cannot be written: {reason}", None,
                                  "Create this folder first, or give another path." if missing else "Give another path.")])


def check_new(path: Path, suffixes: Sequence[str]) -> None:
    """Raise UsageError if `path` is an existing file, or if no file can be created there."""
    check_writable(path, suffixes)
    if os.path.lexists(path):  # also as a link that leads nowhere
        raise UsageError([Problem("file-exists", f"{path} exists already", None, "Give another name, or remove it first.")])
