"""`heavebond library`: every component by domain and every function, or one of them in full."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import click

from heavebond.commands.arguments import json_option
from heavebond.core.errors import HeavebondError, ModelError, Problem, Problems, UsageError

if TYPE_CHECKING:
    from heavebond.language.definition import Component, Parameter, Variable
    from heavebond.language.library import Library
    from heavebond.text.expression import Function

OWN = "this folder"


@click.command(short_help="List the components and functions, or describe one.")
@click.argument("words", metavar="[NAME]", nargs=-1)
@json_option
def library(words: tuple[str, ...]) -> dict[str, object]:
    """List the components by domain, those of the current folder first, and the functions.

    With NAME describe one; other words (rope, check valve) list those that have all of them in their name or summary.
    """
    from heavebond.language.library import library as load_library

    known = load_library([Path.cwd()])
    if not words:
        return _list(known)
    name = " ".join(words)
    if name in known.functions and name not in known.files:
        return _show_function(known.functions[name])
    if name not in known.files:
        return _list(known, name)
    return _show(known.component(name))


def _list(known: Library, wanted: str = "") -> dict[str, object]:
    """Print all, or those whose name or summary contains every word of `wanted`; UsageError if there is none."""
    from heavebond.commands.terminal import output
    from heavebond.core.presentation import columns
    from heavebond.language.library import bundled
    from heavebond.language.near_names import near_components
    from heavebond.text.expression import ExpressionProblem

    problems = Problems()
    folders: dict[str, dict[str, str]] = {}
    root = bundled("components").resolve()
    for name in known.names():
        path = known.files[name]
        inside = path.resolve().is_relative_to(root)
        folder = path.resolve().relative_to(root).parts[0] if inside else OWN
        try:
            folders.setdefault(folder, {})[name] = known.component(name).summary
        except ModelError as error:
            problems.extend(error)
    functions = {}
    for name in known.functions:
        try:
            functions[name] = known.functions[name].summary
        except HeavebondError as error:
            problems.extend(error)
        except ExpressionProblem as problem:
            problems.add(problem.code, problem.message, hint=problem.hint)
    words = wanted.lower().split()
    folders = {folder: part for folder, members in folders.items() if (part := _with_words(members, words))}
    functions = _with_words(functions, words)
    if wanted and not folders and not functions:
        message = f"there is no component '{wanted}', and none with this in its summary"
        raise UsageError([Problem("component-unknown", message, None,
                                  near_components(wanted, {**known.files, **known.functions.files}))])
    console = output()
    for folder, summaries in [*folders.items(), *([("functions", functions)] if functions else [])]:
        console.print(folder, style="bold")
        for line in columns(sorted(summaries.items()), console.width):
            console.print(line, soft_wrap=True)
        console.print()
    console.print("`heavebond library NAME` describes one.", soft_wrap=True)
    problems.raise_as(ModelError)
    return {"components": folders, "functions": functions}


def _with_words(summaries: dict[str, str], words: list[str]) -> dict[str, str]:
    """Select the summaries, by name, in which each of the lower-case words begins a word of the name or the summary."""
    def found(name: str) -> bool:
        text = " ".join([re.sub("(?<=[a-z])(?=[A-Z])", " ", name), name, summaries[name]]).lower()
        return all(re.search(f"(?<![a-z]){re.escape(word)}", text) for word in words)

    return {name: summary for name, summary in summaries.items() if found(name)}


def _show_function(function: Function) -> dict[str, object]:
    from heavebond.commands.terminal import output
    from heavebond.core.presentation import columns, number, path_text

    console = output()
    console.print(function.name, style="bold")
    for line in columns([(text,) for text in (function.summary, function.restrictions) if text], console.width):
        console.print(line, soft_wrap=True)
    console.print(f"\nCalled as {function.usage}", soft_wrap=True, markup=False, highlight=False)
    groups = {"Inputs": function.inputs, "Outputs": function.outputs, "Constants": function.constants}
    for title, group in groups.items():
        if group:
            console.print(f"\n{title}", style="bold")
            rows = [(q.name, q.unit.text, *([number(q.value)] if q.value is not None else []), q.description)
                    for q in group.values()]
            for line in columns(rows, console.width):
                console.print(line.rstrip(), soft_wrap=True)
    console.print("\nEquations", style="bold")
    width = max(len(step.text.strip()) for step in function.steps)
    for step in function.steps:
        text = step.text.strip()
        console.print(f"  {text.ljust(width)}  # {step.label}" if step.label else f"  {text}", soft_wrap=True, markup=False)
    if function.source:
        console.print(f"\nSource: {function.source}", soft_wrap=True, markup=False)
    console.print(f"\n{path_text(function.path)}", style="dim", soft_wrap=True)
    return {"function": {
        "name": function.name, "summary": function.summary, "restrictions": function.restrictions, "source": function.source,
        "file": str(function.path), "usage": function.usage,
        **{key.lower(): {q.name: {"unit": q.unit.text, "doc": q.doc, **({"value": q.value} if q.value is not None else {})}
                         for q in group.values()} for key, group in groups.items()},
        "equations": [{"text": step.text.strip(), "label": step.label} for step in function.steps]}}


def _show(component: Component) -> dict[str, object]:
    from heavebond.commands.terminal import output
    from heavebond.core.presentation import columns, path_text
    from heavebond.equations.medium import medium_of
    from heavebond.language.library import domains

    console, medium = output(), medium_of(component, domains())
    console.print(component.name, style="bold")
    for line in columns([(text,) for text in (component.summary, component.restrictions) if text], console.width):
        console.print(line, soft_wrap=True)
    sections: dict[str, list[tuple[str, ...]]] = {
        "Ports": [*((p.name, p.domain, p.doc) for p in component.ports.values()),
                  *((s.name, f"signal {s.direction}{', vector' * (s.count is not None)}",
                     f"{s.unit.text}{', ' * bool(s.doc)}{s.doc}")
                    for s in component.signals.values())],
        "Parameters": [(p.name, "integer" if p.integer else _unit(p), _given(p, medium), p.doc)
                       for p in component.parameters.values()],
        "Variables": [(v.name, _unit(v), v.doc if v.held is None else f"{v.doc} (held)".lstrip())
                      for v in component.variables.values()],
        "States": [(s.name, ", ".join(f"{r.target.text} = {r.value.text}" for r in s.entry),
                    ", ".join(f"to {t.target}: {t.text}" for t in s.transitions)) for s in component.states],
        "Events": [(e.name, f"{e.key}: {e.formula.text}", ", ".join(f"{r.target.text} becomes {r.value.text}"
                                                                    for r in e.resets)
                    + f" by an impulse of {e.impulse}" * bool(e.impulse)
                    + f" if that lets {e.moves} change" * bool(e.moves)) for e in component.when],
        "Parts": [(i.name, i.kind, ", ".join(f"{k} {getattr(v, 'text', 'measured')}" for k, v in i.settings.items()))
                  for i in component.body.instances.values()],
        "Nodes": [(w.name, ", ".join(e.path for e in w.ends)) for w in component.body.wires.values()],
    }
    for title, rows in sections.items():
        if rows:
            console.print(f"\n{title}", style="bold")
            for line in columns(rows, console.width):
                console.print(line.rstrip(), soft_wrap=True)
    _equations(component)
    _example(component)
    console.print(f"\n{path_text(component.path)}", style="dim", soft_wrap=True)
    return {"component": _as_dict(component)}


def _equations(component: Component) -> None:
    from heavebond.commands.terminal import output
    from heavebond.core.presentation import columns

    console = output()
    if component.equations:
        console.print("\nEquations", style="bold")
        written = [(_text(component, k), line.label) for k, line in enumerate(component.equations)]
        width = max(len(text) for text, _ in written)
        for text, label in written:
            console.print(f"  {text.ljust(width)}  # {label}" if label else f"  {text}", soft_wrap=True)
    rows = [(key, formula.text) for key, formula in (
        ("stores", component.stores), ("dissipates", component.dissipates)) if formula]
    if component.unbalanced:
        rows.append(("unbalanced", f"{component.unbalanced.text}   ({component.unbalanced_why})"))
    if component.power:
        rows.append(("power", component.power))
    rows += [("requires", formula.text) for formula in component.requires]
    rows += [("source", component.source)] if component.source else []
    if rows:
        console.print("\nEnergy and origin", style="bold")
        for line in columns(rows, console.width):
            console.print(line, soft_wrap=True)


def _example(component: Component) -> None:
    from heavebond.commands.terminal import output
    from heavebond.language.library import example
    from heavebond.text.yaml_source import read_text

    path = example(component)
    if path is None:
        return
    console = output()
    console.print(f"\nExample (heavebond run examples/{path.stem})", style="bold")
    for line in read_text(path).splitlines():
        console.print(f"  {line}", soft_wrap=True)


def _text(component: Component, k: int) -> str:
    """An equation in the author's form, `each` included."""
    line = component.equations[k]
    written = line.place.text.partition("#")[0].strip()
    return written if line.text.strip() in written else line.text.strip()


def _unit(item: Parameter | Variable) -> str:
    return item.unit.text if item.count is None else f"{'list' if item.columns is None else 'matrix'}, {item.unit.text}"


def _given(parameter: Parameter, medium: str) -> str:
    """Default and bounds: `default 0 m, at least 0`."""
    from heavebond.core.presentation import number

    parts = []
    if parameter.default is not None:
        parts.append(f"default {parameter.default.text}")
    if parameter.neutral is not None:
        parts.append(f"absent at {number(parameter.neutral)}")
    if parameter.medium:
        parts.append(f"{parameter.medium} of the {medium}")
    if parameter.low is not None:
        parts.append(f">= {number(parameter.low)}")
    if parameter.high is not None:
        parts.append(f"<= {number(parameter.high)}")
    return ", ".join(parts)


def _as_dict(component: Component) -> dict[str, object]:
    from heavebond.language.library import example

    example_path = example(component)
    formulas = {key: formula.text for key, formula in (
        ("stores", component.stores), ("dissipates", component.dissipates), ("unbalanced", component.unbalanced))
        if formula}
    return {
        "name": component.name, "summary": component.summary, "restrictions": component.restrictions,
        "source": component.source, "file": str(component.path),
        "example": str(example_path) if example_path else None, "power": component.power, **formulas,
        "ports": {p.name: p.domain for p in component.ports.values()},
        "signals": {s.name: {"direction": s.direction, "unit": s.unit.text} for s in component.signals.values()},
        "parameters": {p.name: {
            "unit": p.unit.text, "doc": p.doc, "min": p.low, "max": p.high, "neutral": p.neutral,
            "default": p.default.text if p.default else None, "list": p.count is not None,
            "medium": p.medium or None}
            for p in component.parameters.values()},
        "variables": {v.name: {"unit": v.unit.text, "doc": v.doc} for v in component.variables.values()},
        "events": {e.name: {e.key: e.formula.text, "then": {r.target.text: r.value.text for r in e.resets},
                            **({"impulse": e.impulse} if e.impulse else {}),
                            **({"moves": e.moves, "otherwise": {r.target.text: r.value.text for r in e.otherwise}}
                               if e.moves else {})}
                   for e in component.when},
        "states": {s.name: {"entry": {r.target.text: r.value.text for r in s.entry},
                            "to": {t.target: t.text for t in s.transitions}} for s in component.states},
        "initial": {r.target.text: r.value.text for r in component.initial},
        "equations": [{"text": line.text.strip(), "label": line.label} for line in component.equations],
        "parts": {i.name: i.kind for i in component.body.instances.values()},
    }
