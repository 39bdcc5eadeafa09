"""The library as text: every component by domain and every function, or one of them in full."""

from __future__ import annotations

import re
from pathlib import Path

from heavebond.core.errors import HeavebondError, ModelError, Problem, Problems, UsageError
from heavebond.core.presentation import columns, number, path_text
from heavebond.equations.medium import medium_of
from heavebond.language.definition import Component, Parameter, Variable
from heavebond.language.library import Library, bundled, domains, example
from heavebond.language.library import library as load_library
from heavebond.language.near_names import near_components
from heavebond.reports.text_page import WIDTH, TextPage
from heavebond.reports.text_page import Lines as _Lines
from heavebond.text.expression import ExpressionProblem, Function
from heavebond.text.yaml_source import read_text

OWN = "this folder"


def library(name: str = "", *, folder: str | Path = ".") -> TextPage:
    """List the components of the library by domain and the functions, or describe one.

    The description has ports, parameters, equations and an example. With the `name` of a component or function describe it;
    other words (rope, check valve) list those that have all of them in their name or summary. Components in `folder`, and in
    its `components/`, are included. `print(page)` shows the text, `page.as_dict()` the content. Raises UsageError if nothing
    has these words, ModelError for a component with mistakes; those in the files of a list are `page.problems`.
    """
    return library_page(name, Path(folder), WIDTH)


def library_page(name: str, folder: Path, width: int) -> TextPage:
    """The page of `library`, in lines of `width` characters."""
    known, lines = load_library([folder]), _Lines(width)
    if not name:
        return _list(known, "", lines)
    if name in known.functions and name not in known.files:
        return lines.page(name, _show_function(known.functions[name], lines))
    if name not in known.files:
        return _list(known, name, lines)
    return lines.page(name, _show(known.component(name), lines))


def _list(known: Library, wanted: str, page: _Lines) -> TextPage:
    """List all, or those whose name or summary contains every word of `wanted`; UsageError if there is none."""

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
    for folder, summaries in [*folders.items(), *([("functions", functions)] if functions else [])]:
        page.add(folder, style="bold")
        for line in columns(sorted(summaries.items()), page.width):
            page.add(line)
        page.add("")
    page.add("`heavebond library NAME` describes one.")
    return page.page(wanted or "library", {"components": folders, "functions": functions}, problems.found)


def _with_words(summaries: dict[str, str], words: list[str]) -> dict[str, str]:
    """Select the summaries, by name, in which each of the lower-case words begins a word of the name or the summary."""
    def matches(name: str) -> bool:
        text = " ".join([re.sub("(?<=[a-z])(?=[A-Z])", " ", name), name, summaries[name]]).lower()
        return all(re.search(f"(?<![a-z]){re.escape(word)}", text) for word in words)

    return {name: summary for name, summary in summaries.items() if matches(name)}


def _show_function(function: Function, page: _Lines) -> dict[str, object]:

    page.add(function.name, style="bold")
    for line in columns([(text,) for text in (function.summary, function.restrictions) if text], page.width):
        page.add(line)
    page.add(f"\nCalled as {function.usage}")
    groups = {"Inputs": function.inputs, "Outputs": function.outputs, "Constants": function.constants}
    for title, group in groups.items():
        if group:
            page.add(f"\n{title}", style="bold")
            rows = [(q.name, q.unit.text, *([number(q.value)] if q.value is not None else []), q.description)
                    for q in group.values()]
            for line in columns(rows, page.width):
                page.add(line.rstrip())
    if function.external is not None:
        page.add(f"\nThe program `{function.external.call}` in {function.external.path.name}; it needs --allow-native")
    else:
        page.add("\nEquations", style="bold")
    width = max((len(step.text.strip()) for step in function.steps), default=0)
    for step in function.steps:
        text = step.text.strip()
        page.add(f"  {text.ljust(width)}  # {step.label}" if step.label else f"  {text}")
    if function.source:
        page.add(f"\nSource: {function.source}")
    page.add(f"\n{path_text(function.path)}", style="dim")
    return {"function": {
        "name": function.name, "summary": function.summary, "restrictions": function.restrictions, "source": function.source,
        "file": str(function.path), "usage": function.usage,
        **({"program": str(function.external.path), "call": function.external.call} if function.external else {}),
        **{key.lower(): {q.name: {"unit": q.unit.text, "doc": q.doc, **({"value": q.value} if q.value is not None else {})}
                         for q in group.values()} for key, group in groups.items()},
        "equations": [{"text": step.text.strip(), "label": step.label} for step in function.steps]}}


def _show(component: Component, page: _Lines) -> dict[str, object]:

    medium = medium_of(component, domains())
    page.add(component.name, style="bold")
    for line in columns([(text,) for text in (component.summary, component.restrictions) if text], page.width):
        page.add(line)
    sections: dict[str, list[tuple[str, ...]]] = {
        "Ports": [*((p.name, p.domain, p.doc) for p in component.ports.values()),
                  *((s.name, f"signal {s.direction}{', vector' * (s.count is not None)}",
                     f"{s.unit.text}{', ' * bool(s.doc)}{s.doc}")
                    for s in component.signals.values())],
        "Parameters": [(p.name, "integer" if p.integer else _unit(p), _bounds(p, medium), p.doc)
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
            page.add(f"\n{title}", style="bold")
            for line in columns(rows, page.width):
                page.add(line.rstrip())
    _equations(component, page)
    example_path = example(component)
    if example_path is not None:
        page.add(f"\nExample (heavebond run examples/{example_path.stem})", style="bold")
        for line in read_text(example_path).splitlines():
            page.add(f"  {line}")
    page.add(f"\n{path_text(component.path)}", style="dim")
    formulas = {key: formula.text for key, formula in (
        ("stores", component.stores), ("dissipates", component.dissipates), ("unbalanced", component.unbalanced))
        if formula}
    return {"component": {
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
    }}


def _equations(component: Component, page: _Lines) -> None:

    if component.equations:
        page.add("\nEquations", style="bold")
        labelled = []
        for equation in component.equations:
            # the equation in the author's form, `each` included
            written, text = equation.place.text.partition("#")[0].strip(), equation.text.strip()
            labelled.append((written if text in written else text, equation.label))
        width = max(len(text) for text, _ in labelled)
        for text, label in labelled:
            page.add(f"  {text.ljust(width)}  # {label}" if label else f"  {text}")
    rows = [(key, formula.text) for key, formula in (
        ("stores", component.stores), ("dissipates", component.dissipates)) if formula]
    if component.unbalanced:
        rows.append(("unbalanced", f"{component.unbalanced.text}   ({component.unbalanced_why})"))
    if component.power:
        rows.append(("power", component.power))
    rows += [("requires", formula.text) for formula in component.requires]
    rows += [("source", component.source)] if component.source else []
    if rows:
        page.add("\nEnergy and origin", style="bold")
        for line in columns(rows, page.width):
            page.add(line)


def _unit(item: Parameter | Variable) -> str:
    return item.unit.text if item.count is None else f"{'list' if item.columns is None else 'matrix'}, {item.unit.text}"


def _bounds(parameter: Parameter, medium: str) -> str:
    """Default and bounds: `default 0 m, at least 0`."""

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
