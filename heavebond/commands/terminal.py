"""Terminal output: problems in colour, tables, progress. Plain text in files and pipes."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import IO, TYPE_CHECKING, Any, NoReturn

from heavebond.commands.progress_lines import progress_lines
from heavebond.commands.progress_lines import told as told_in_lines
from heavebond.core.cancellation import check
from heavebond.core.errors import Problem
from heavebond.core.limits import PROBLEMS_SHOWN
from heavebond.core.quoting import visible

if TYPE_CHECKING:
    from rich.console import Console, Group

    from heavebond.reports.result_tables import Item
    from heavebond.reports.text_page import TextPage

PIPE_CLOSED = 141  # exit code that shells report for SIGPIPE
PLAIN_WIDTH = 120  # width of tables in a file or a pipe
GAP = 3  # between columns


def output() -> Console:
    """Standard output: coloured on a terminal (unless NO_COLOR is set), else plain."""
    return _console(sys.stdout)


def messages() -> Console:
    """Standard error, for problems and progress."""
    return _console(sys.stderr)


def _console(file: IO[str]) -> Console:
    from rich.console import Console
    from rich.segment import Segment

    class Terminal(Console):
        def on_broken_pipe(self) -> NoReturn:
            raise BrokenPipeError

        def render(self, *objects: Any, **options: Any) -> Iterator[Segment]:
            """Segments of the output, with control characters from names and records made visible."""
            for segment in super().render(*objects, **options):
                yield segment if segment.control else segment._replace(text=visible(segment.text))

    # a file has no width; the default of 80 characters would break tables
    width = None if file.isatty() or "COLUMNS" in os.environ else PLAIN_WIDTH
    return Terminal(file=file, width=width, highlight=False, markup=False, emoji=False, soft_wrap=False)


def table(title: str, head: Sequence[str], rows: Sequence[Sequence[str]], *, text: int = 1) -> Group:
    """A table; the first `text` columns are aligned left, the others, numbers, right. The title is a separate line, which
    is not broken at the width of the table."""
    from rich import box
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    rich_table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False)
    for k, (name, width) in enumerate(zip(head, _widths(head, rows, output().width), strict=True)):
        rich_table.add_column(name, justify="left" if k < text else "right", overflow="fold", width=width)
    for row in rows:
        rich_table.add_row(*row)
    return Group(*([Text(title, style="bold", no_wrap=True, overflow="ignore")] if title else []), rich_table)


def _widths(head: Sequence[str], rows: Sequence[Sequence[str]], width: int) -> Sequence[int | None]:
    """Column widths for a table whose lines must be broken between words, in the widest columns. None if the table fits,
    or if its longest words do not fit."""
    cells = [[name, *(row[k] for row in rows)] for k, name in enumerate(head)]
    words = [max((len(word) for cell in column for word in cell.split()), default=0) for column in cells]
    widths = [max(map(len, column)) for column in cells]
    room = width - GAP * (len(head) - 1)
    if sum(widths) <= room or sum(words) > room:
        return [None] * len(head)
    while sum(widths) > room:
        widths[max((k for k in range(len(head)) if widths[k] > words[k]), key=widths.__getitem__)] -= 1
    return widths


def show(items: Sequence[Item]) -> None:
    """Print the tables and lines of a result, warnings on standard error."""
    from heavebond.core.presentation import columns
    from heavebond.reports.result_tables import Line, ResultTable

    console = output()
    for item in items:
        if isinstance(item, ResultTable):
            console.print(table(item.title, item.head, item.rows, text=item.text), crop=False)
        elif isinstance(item, Line) and item.warning:
            warn(item.text)
        elif isinstance(item, Line):
            console.print(item.text, style="yellow" if item.highlight else None, soft_wrap=True)
        else:
            for line in ["noticed", *columns(item.rows, console.width)]:
                console.print(line)


def show_page(page: TextPage) -> None:
    """Print the lines and tables of a page; ModelError with its problems after them."""
    from heavebond.core.errors import ModelError
    from heavebond.reports.text_page import TextLine

    console = output()
    for item in page.items:
        if isinstance(item, TextLine) and item.style == "warning":
            warn(item.text)
        elif isinstance(item, TextLine):
            console.print(item.text, style=item.style or None, soft_wrap=True, markup=False, highlight=False)
        else:
            console.print(table(item.title, item.head, item.rows, text=item.text), crop=False)
    if page.problems:
        raise ModelError(page.problems)


def warn(line: str) -> None:
    """Print a warning on standard error."""
    messages().print(line, style="yellow", soft_wrap=True)


def print_problems(problems: Sequence[Problem]) -> None:
    """Print problems on standard error in the form of `str(Problem)`, numbered if there are several."""
    from rich.text import Text

    console = messages()
    for k, problem in enumerate(problems[:PROBLEMS_SHOWN]):
        if k:
            console.print()
        lines = str(problem).split("\n")
        hint = len(problem.hint.splitlines())
        head = Text(lines[0], style="bold red")
        if problem.place:
            head.stylize("bold", 0, len(f"{problem.place.file}:{problem.place.line}: "))
        head.stylize("not bold dim", len(lines[0]) - len(problem.code) - 2)
        styled = [head]
        for line in lines[1:len(lines) - hint]:
            caret = line.lstrip(" |").startswith("^") and line.lstrip().startswith("|")
            styled.append(Text(line, style="yellow" if caret else ""))
        styled += [Text(line, style="green") for line in lines[len(lines) - hint:]]
        for line_text in styled:
            # no line breaks here: they could split a name that the user copies
            console.print(line_text, soft_wrap=True)
    if len(problems) > 1:
        suffix = f", the first {PROBLEMS_SHOWN} are shown" if len(problems) > PROBLEMS_SHOWN else ""
        console.print(f"\n{len(problems)} problems{suffix}", style="bold red")


@contextlib.contextmanager
def working(words: str) -> Iterator[Callable[[str], None]]:
    """Show `words` and the progress on a terminal, or print them every few seconds elsewhere (see `progress_lines`).

    Yields the progress callback, which also raises KeyboardInterrupt after a request to end (see `cancellation.check`).
    """
    if not sys.stderr.isatty():
        with progress_lines(words), told_in_lines(words) as tell:
            def follow(text: str) -> None:
                check()
                tell(visible(text))

            yield follow
        return
    # a duplicate of the terminal: during an integration the solver's messages are captured from file descriptor 2
    with open(os.dup(sys.stderr.fileno()), "w", encoding=sys.stderr.encoding) as copy, \
            _console(copy).status(words, spinner="dots") as status:
        def show_status(text: str) -> None:
            check()
            status.update(f"{words}: {text}")

        yield show_status
