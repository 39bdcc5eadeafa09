"""`heavebond library`: every component by domain and every function, or one of them in full."""

from __future__ import annotations

from pathlib import Path

import click

from heavebond.commands.arguments import json_option


@click.command(short_help="List the components and functions, or describe one.")
@click.argument("words", metavar="[NAME]", nargs=-1)
@json_option
def library(words: tuple[str, ...]) -> dict[str, object]:
    """List the components by domain, those of the current folder first, and the functions.

    With NAME describe one; other words (rope, check valve) list those that have all of them in their name or summary.
    """
    from heavebond.commands import terminal
    from heavebond.reports.library_page import library_page

    page = library_page(" ".join(words), Path.cwd(), terminal.output().width)
    terminal.show_page(page)
    return page.as_dict()
