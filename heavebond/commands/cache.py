"""`heavebond cache`: what is kept between runs, and how much room it takes."""

from __future__ import annotations

import click

from heavebond.commands.arguments import json_option


@click.command(short_help="See, empty or switch off what is kept between runs.")
@click.option("--empty", is_flag=True, help="Remove all that is kept.")
@click.option("--off", is_flag=True, help="Keep nothing any more, and use nothing that is kept.")
@click.option("--on", is_flag=True, help="Keep and use it again.")
@json_option
def cache(empty: bool, off: bool, on: bool) -> dict[str, object]:
    """Tell where read and reduced diagrams are kept between runs, how many there are and how much room they take.

    They are known by the contents of all files that they follow from, so that a change to any of these is always noticed.
    The environment variable HEAVEBOND_CACHE names another folder, or is `off` for nothing to be kept; HEAVEBOND_CACHE_LIMIT
    is the room that may be taken, in MB.
    """
    from heavebond.basis.cache import FOLDER, LIMIT, MB, the_cache
    from heavebond.basis.errors import Problem, UsageError
    from heavebond.basis.presentation import count
    from heavebond.commands.terminal import output

    if on and off:
        raise UsageError([Problem("cache-on-off", "--on and --off contradict each other", None, "Give one of them.")])
    found = the_cache()
    if found is None:
        output().print(f"{FOLDER} switches the cache off", soft_wrap=True)
        return {"folder": None, "on": False, "entries": 0, "bytes": 0, "limit": 0}
    if empty:
        found.empty()
    if on or off:
        found.switch(on=on)
    sizes, state = found.sizes(), not found.switched_off
    output().print(f"{found.folder}: {count(len(sizes), 'entry', 'entries')}, {sum(sizes) / MB:.1f} MB of at most "
                   f"{found.limit / MB:g} MB ({LIMIT})", soft_wrap=True, highlight=False)
    if not state:
        output().print("It is switched off; `heavebond cache --on` turns it on.", soft_wrap=True, highlight=False)
    return {"folder": str(found.folder), "on": state, "entries": len(sizes), "bytes": sum(sizes), "limit": found.limit}
