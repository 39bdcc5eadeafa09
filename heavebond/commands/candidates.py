"""`heavebond candidates`: the effects of the catalogue that fit a diagram, with their places."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from heavebond.commands.arguments import json_option, native_option

if TYPE_CHECKING:
    pass

HEAD = ("class", "effect", "place", "what is fitted")


@click.command(short_help="List the effects that could be missing from a diagram.")
@click.argument("experiment")
@native_option
@json_option
def candidates(experiment: str) -> dict[str, object]:
    """List every effect of the catalogue at every place of EXPERIMENT's diagram where it fits, and one law at all similar
    places together.

    A user-defined component with an `effect:` entry, in the folder of the diagram or in its `components` folder, is
    included.
    """
    from heavebond.commands import terminal
    from heavebond.diagnosis.candidates import places

    candidate_list = places.candidates(experiment)
    ordered = sorted(candidate_list, key=lambda c: c.kind)
    rows = [(c.kind if k == 0 or ordered[k - 1].kind != c.kind else "", c.name if c.attaches == "in" else c.component,
             c.place, ", ".join(n.name.rpartition(".")[2] for n in c.numbers)) for k, c in enumerate(ordered)]
    console = terminal.output()
    console.print(terminal.table("", HEAD, rows, text=4))
    console.print(f"{len(candidate_list)} candidates of {len({c.kind for c in candidate_list})} classes. Try one by hand: "
                  "heavebond try "
                  f"{experiment} EFFECT, with --at PLACE or --between NODE NODE where it fits at several places.",
                  soft_wrap=True)
    return {"candidates": [{**c.as_dict(), "description": c.description, "numbers": [n.name for n in c.numbers]}
                           for c in candidate_list]}
