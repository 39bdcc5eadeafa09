"""Entry point of the command line: the commands, and the handling of errors (message, exit code, JSON).

Exit codes: 0 success; 1 an error in the model, the data or a run; 2 wrong usage; 3 a model with placeholders; 70 an
internal error of heavebond; 130 interrupted by Ctrl-C, 143 by SIGTERM; 141 the reader of the output closed the pipe. A run
is an error if its verdict fails (see `run_verdict`).
"""

from __future__ import annotations

import atexit
import gc
import json
import math
import os
import shlex
import sys
from collections.abc import Iterator, MutableMapping, Sequence
from importlib import import_module
from pathlib import Path
from signal import Signals
from typing import TYPE_CHECKING, Any, NoReturn

import click

from heavebond.commands.arguments import check_writable
from heavebond.commands.progress_lines import progress_lines
from heavebond.commands.terminal import PIPE_CLOSED, print_problems, warn
from heavebond.core.cancellation import WORDS, clear_signal, is_interrupt, last_heard
from heavebond.core.cancellation import listening as signals_heard
from heavebond.core.errors import FaultError, HeavebondError, Problem, UsageError, suggest
from heavebond.core.version import VERSION
from heavebond.core.writable import write_text

if TYPE_CHECKING:
    from heavebond.numerics.run_verdict import Verdict

# the commands; each is the function of the same name in a module of `heavebond.commands`, except for `FUNCTIONS`
NAMES = ("check", "draw", "run", "plot", "animate", "compare", "fit", "localize", "candidates", "try", "diagnose",
         "monitor", "laws", "errors", "design", "tune", "optimal", "study", "sweep", "signal", "modes", "linear", "energy",
         "sensitivity", "library", "demo", "export", "import", "new", "studio")
# names of the commands in Python and in other programs
OTHER_NAMES = {"simulate": "run", "optimise": "tune", "optimize": "tune", "estimate": "fit", "calibrate": "fit",
               "validate": "compare", "bode": "linear", "linearise": "linear", "linearize": "linear", "eigenvalues": "modes"}
FUNCTIONS = {"try": "try_effect", "import": "import_model"}
SERVING = ("studio",)  # commands that run until they are interrupted: no progress lines
FINE, AT_FAULT, WRONG_USAGE, INCOMPLETE, OWN_FAULT, SIGNALLED = 0, 1, 2, 3, 70, 128


class CommandTable(MutableMapping[str, click.Command]):
    """The commands by name; each is imported at its first use."""

    def __init__(self) -> None:
        self._known: dict[str, click.Command | None] = dict.fromkeys(NAMES)

    def __getitem__(self, name: str) -> click.Command:
        known = self._known[name]
        if known is None:
            function = FUNCTIONS.get(name, name)
            self._known[name] = known = getattr(import_module(f"heavebond.commands.{function}"), function)
        return known

    def __setitem__(self, name: str, command: click.Command) -> None:
        self._known[name] = command

    def __delitem__(self, name: str) -> None:
        del self._known[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._known)

    def __len__(self) -> int:
        return len(self._known)

    def __contains__(self, name: object) -> bool:
        return name in self._known


class Commands(click.Group):
    """A command group that handles errors: print problems without a traceback, write the JSON file, set the exit code."""

    def resolve_command(self, ctx: click.Context, args: list[str]
                        ) -> tuple[str | None, click.Command | None, list[str]]:
        if args and not args[0].startswith("-") and args[0] not in self.commands:
            intended = OTHER_NAMES.get(args[0].lower())
            hint = f"Did you mean '{intended}'?" if intended else suggest(args[0], self.commands)
            raise UsageError([Problem("command-unknown", f"there is no command '{args[0]}'", None,
                                      hint or f"Commands: {', '.join(self.commands)}.")])
        return super().resolve_command(ctx, args)

    def main(self, args: Sequence[str] | None = None, prog_name: str | None = None, *_: Any, **__: Any) -> NoReturn:
        # most objects live until the end of a command; with Python's default threshold of 700, garbage collection takes 1/20
        # of the time of a run, with 20 000 still 1/40
        gc.set_threshold(100_000, 5, 2)
        # avoid the search for cycles in all objects at exit, which takes 1/10 of the time of a run because of CasADi
        atexit.register(gc.freeze)
        # set before NumPy is imported: do not split small matrices over processors (see core.threads)
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        # set before matplotlib is imported: pictures are written to files, and an unknown backend would stop every command
        os.environ["MPLBACKEND"] = "agg"
        with signals_heard():
            self._main(args, prog_name)

    def _main(self, args: Sequence[str] | None, prog_name: str | None) -> NoReturn:
        from heavebond.numerics.run_verdict import listening

        given = list(sys.argv[1:] if args is None else args)
        command = next((word for word in given if word in self.commands), "")
        problems: list[Problem] = []
        figures: dict[str, object] = {}
        heard: list[tuple[str, Verdict]] = []
        try:
            if path := json_path(given):
                check_writable(Path(path))
            words = "" if command in SERVING else command or "heavebond"
            with listening() as heard, progress_lines(words):
                code, figures = self._run(given, prog_name)
        except HeavebondError as error:
            problems, figures = list(error.problems), error.figures
            code = WRONG_USAGE if isinstance(error, UsageError) else OWN_FAULT if isinstance(error, FaultError) else AT_FAULT
            if is_interrupt(error):  # caused by a signal that a library has discarded
                problems, code = _interrupted()
        except BrokenPipeError:
            _forget_output()
            sys.exit(PIPE_CLOSED)
        except OSError as error:
            problems, code = [Problem("file", f"{error.filename or 'a file'}: {error.strerror or error}")], WRONG_USAGE
            if lacks_memory(error):
                problems, code = [own_fault(error, given)], AT_FAULT
        except (click.Abort, KeyboardInterrupt) as error:
            problems, code = _interrupted()
            figures = getattr(error.__cause__ or error, "figures", {})  # click converts KeyboardInterrupt to Abort
        except Exception as error:
            problems, code = _interrupted() if is_interrupt(error) else (
                [own_fault(error, given)], AT_FAULT if lacks_memory(error) else OWN_FAULT)
        try:
            if heard:
                code, problems, figures = _judged(heard, code, problems, figures)
            code = _end(given, command, code, problems, figures)
        except BrokenPipeError:
            _forget_output()
            code = PIPE_CLOSED
        except Exception as error:
            code = _end([], command, OWN_FAULT, [own_fault(error, given)], {})
        sys.exit(code)

    def _run(self, arguments: list[str], prog_name: str | None) -> tuple[int, dict[str, object]]:
        try:
            answer = super().main(arguments, prog_name or "heavebond", standalone_mode=False)
        except click.UsageError as error:
            # convert a usage error of click to a problem with the usage of the command
            message = error.format_message().rstrip(".")
            hint = ""
            if error.ctx is not None:
                hint = f"{error.ctx.get_usage()}\n`{error.ctx.command_path} --help` describes all options."
                if isinstance(error, click.MissingParameter) and isinstance(error.param, click.Option) and error.param.help:
                    hint = f"{error.param.opts[-1]} {error.param.make_metavar(error.ctx)}: {error.param.help}\n{hint}"
                if "unexpected extra argument" in message:
                    hint = "An option that takes several values is repeated: --plot WOB --plot crown.\n" + hint
            raise UsageError([Problem("usage", message[:1].lower() + message[1:], None, hint)]) from None
        except click.ClickException as error:
            raise UsageError([Problem("usage", error.format_message())]) from None
        sys.stdout.flush()
        if isinstance(answer, dict):
            return INCOMPLETE if answer.get("placeholders") else FINE, answer
        return int(answer or 0), {}


def _judged(heard: list[tuple[str, Verdict]], code: int, problems: list[Problem], figures: dict[str, object]
            ) -> tuple[int, list[Problem], dict[str, object]]:
    """Report the verdicts of the runs of a command: a warning for each exceeded range, a problem for each failed run."""
    from heavebond.numerics.run_verdict import verdict_of_all, verdicts_as_dict

    for name, verdict in dict(heard).items():
        if verdict.failed:
            problems = [*problems, verdict.problem]
        elif verdict.findings:
            warn(f"warning: {verdict.text}" if len(heard) == 1 else f"warning: {name}: {verdict.text}")
    figures = {**figures, "validity": verdicts_as_dict(heard)}
    whole = verdict_of_all(heard)
    if code == FINE and any(finding.kind == "placeholder" for finding in whole.findings):
        code = INCOMPLETE
    return (AT_FAULT if code in (FINE, INCOMPLETE) and whole.failed else code), problems, figures


def _interrupted() -> tuple[list[Problem], int]:
    """The problem of an interrupted command, and the exit code of a program that was ended by a signal (128 + number)."""
    number = last_heard()
    clear_signal()
    return [Problem("interrupted", WORDS.get(Signals(number).name, "interrupted"))], SIGNALLED + number


# messages of errors that libraries raise instead of MemoryError: the loader of shared libraries, CasADi, threads
NO_MEMORY = ("failed to map segment", "cannot allocate memory", "bad_alloc", "can't start new thread")


def lacks_memory(error: BaseException | None) -> bool:
    """True if an exception or one of its causes is due to insufficient memory."""
    while error is not None:
        if isinstance(error, MemoryError) or any(words in str(error).lower() for words in NO_MEMORY):
            return True
        error = error.__cause__ or error.__context__
    return False


def own_fault(error: Exception, arguments: Sequence[str]) -> Problem:
    """The problem for an unexpected exception; write its full traceback to a file."""
    import platform
    import tempfile
    import traceback

    message = (str(error).strip().splitlines() or [""])[0]
    head = f"heavebond {VERSION}, Python {platform.python_version()}, {platform.platform()}\n" \
           f"command: {shlex.join(['heavebond', *arguments])}\n\n"
    try:
        with tempfile.NamedTemporaryFile("w", prefix="heavebond-fault-", suffix=".txt", delete=False, encoding="utf-8",
                                         errors="backslashreplace") as file:
            file.write(head + "".join(traceback.format_exception(error)))
        where = f"The trace is in {file.name}"
    except OSError as unwritten:
        where = f"The trace could not be written ({unwritten.strerror or unwritten})"
    if lacks_memory(error):
        return Problem("memory", "the memory of this machine does not suffice", None, "Ask for fewer output points (a "
                       f"longer `every`), a shorter run, or fewer workers. {where}.")
    return Problem("internal", f"a fault of heavebond itself, not of your files: {type(error).__name__}: {message}", None,
                   f"{where}. Report it with that file and the files of the command to who maintains heavebond for you.")


def _end(arguments: list[str], command: str, code: int, problems: list[Problem], figures: dict[str, object]) -> int:
    """Write the JSON file, print the problems and return the exit code."""
    unwritten = _write(arguments, command, code, problems, figures)
    if unwritten and code == FINE:  # otherwise the error was reported before, or another problem is more important
        problems, code = [unwritten], WRONG_USAGE
    if problems and problems[0].code == "interrupted":
        print(problems[0].message, file=sys.stderr)
    elif problems:
        print_problems(problems)
    return code


def _write(arguments: list[str], command: str, code: int, problems: list[Problem], figures: dict[str, object]
           ) -> Problem | None:
    """Write the file of --json if it is requested; return the problem if it cannot be written."""
    path = json_path(arguments)
    if not path:
        return None
    document = {"command": command, "ok": code == FINE, "problems": [p.as_dict() for p in problems], **figures}
    try:
        write_text(path, json.dumps(_plain(document), indent=1, ensure_ascii=False, allow_nan=False) + "\n")
    except OSError as error:
        return Problem("file-unwritable", f"'{path}' cannot be written: {error.strerror or error}")
    return None


def json_path(given: Sequence[str]) -> str:
    """The FILE of --json, read from the unparsed arguments because wrong usage must be reported there too."""
    for k, word in enumerate(given):
        if word == "--":
            break
        if word.startswith("--json="):
            return word.removeprefix("--json=")
        if word == "--json" and k + 1 < len(given):
            return given[k + 1]
    return ""


def _plain(value: Any) -> Any:
    """Convert a value for JSON: tuples to lists, NumPy scalars to numbers, NaN and infinity to null."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, (str, bool, int)) or value is None:
        return value
    if hasattr(value, "item"):  # NumPy's scalars
        return _plain(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return str(value)


def _forget_output() -> None:
    """Redirect standard output to the null device after the pipe is closed, so that Python reports no error at exit."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())


@click.group("heavebond", cls=Commands, commands=CommandTable(), no_args_is_help=True,
             context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(VERSION, prog_name="heavebond")
def main() -> None:
    """Model machines from diagrams, simulate them and compare them with measurements.

    Exit codes: 0 fine, 1 the model or the data is at fault, 2 wrong usage, 3 parts of the model are placeholders without a
    law, 70 a fault of heavebond itself.
    """
