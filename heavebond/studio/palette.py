"""The components for a diagram: by domain for the palette, and one in full."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

from heavebond.core.errors import HeavebondError
from heavebond.language.definition import Component, Parameter, Value
from heavebond.language.library import bundled, library
from heavebond.pictures.drawing import symbol_picture

Entry = dict[str, Any]
OWN = "this folder"


def palette(folder: Path) -> Entry:
    """Name, summary, symbol and ports of each component, by the folders of the library; those in the folder of the
    diagram first, with its FMUs.
    """
    known = library([folder])
    root = bundled("components").resolve()
    groups: dict[str, list[Entry]] = {}
    for name in [*known.names(), *(name for name, path in known.files.items() if path.suffix == ".fmu")]:
        path = known.files[name].resolve()
        inside = path.is_relative_to(root)
        group = path.relative_to(root).parts[0].replace("_", " ") if inside else OWN
        try:
            # an FMU is used by the name of its file
            entry = _of_library(name) if inside else {**_brief(known.component(name)), "name": name}
        except HeavebondError:
            continue  # a file that is being written; `check` reports it if it is used
        groups.setdefault(group, []).append(entry)
    order = sorted(groups, key=lambda group: (group != OWN, group == "bond graph", group))
    return {"groups": [{"name": group, "components": sorted(groups[group], key=lambda c: str(c["name"]).lower())}
                       for group in order]}


def bundled_entries() -> list[Entry]:
    """The entries of the components of the bundled library; later calls of `palette` use them."""
    return [_of_library(name) for name in library().names()]


@cache
def _of_library(name: str) -> Entry:
    return _brief(library().component(name))


def _brief(component: Component) -> Entry:
    ports = {**{p.name: p.domain for p in component.ports.values()}, **dict.fromkeys(component.signal_names, "signal")}
    return {"name": component.name, "summary": component.summary, "svg": symbol_picture(component), "ports": ports,
            "parameters": {name: _unit(p) for name, p in component.parameters.items()},
            "inputs": [name for name, port in component.signals.items() if port.direction == "in"]}


def component_entry(folder: Path, name: str) -> Entry:
    """The page of a component: its restrictions, ports, parameters, equations and source."""
    component = library([folder]).component(name)
    ports = [{"name": p.name, "what": p.domain, "doc": p.doc} for p in component.ports.values()]
    ports += [{"name": s.name, "what": f"signal {s.direction}put", "doc": s.doc} for s in component.signals.values()]
    parameters = []
    for p in component.parameters.values():
        default = p.default.text if isinstance(p.default, Value) else \
            "no effect" if p.neutral is not None else ""
        parameters.append({"name": p.name, "unit": _unit(p), "doc": p.doc, "default": default,
                           "limits": [None if v is None else p.unit.from_si(v) for v in (p.low, p.high)]})
    return {**_brief(component), "name": name, "restrictions": component.restrictions, "source": component.source,
            "port_list": ports, "parameter_list": parameters,
            "equations": [f"{line.text.strip()}  # {line.label}" if line.label else line.text.strip()
                          for line in component.equations]}


def _unit(parameter: Parameter) -> str:
    return "" if parameter.unit.text == "1" else parameter.unit.text
