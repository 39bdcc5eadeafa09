"""Contents of a diagram for the page, in addition to its drawing: parts, nodes, parameters with their units and limits,
signals.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from heavebond.core.errors import Problem
from heavebond.core.presentation import readable
from heavebond.core.units import Unit, UnitProblem, read_unit
from heavebond.equations.connect import Network
from heavebond.equations.expanded import Bound, Expanded, Leaf
from heavebond.equations.parameters import declared
from heavebond.language.definition import Component, FileInput, Parameter, SignalPort, Value
from heavebond.text.expression import Number
from heavebond.text.yaml_source import Mapping, Node, Sequence

if TYPE_CHECKING:
    from heavebond.numerics.dae import Assembly
    from heavebond.pictures.layout import Drawn

Entry = dict[str, object]
DECADE = 10.0  # a slider ranges from a tenth of a positive value to ten times it, unless a limit is nearer


def contents(expanded: Expanded, network: Network, assembly: Assembly | None, text_name: str,
             drawn: Drawn | None) -> Entry:
    """Parts and nodes by their paths, the diagram's parameters, and its outputs; signals if it is assembled."""
    ports = port_entries(expanded, network, drawn) if drawn is not None else {}
    joined = {end.name for junction in expanded.junctions.values() for end in junction.ends if end.sign > 0}
    names: dict[str, dict[str, str]] = {}  # every variable with unit and description
    if assembly is not None:
        flat = assembly.flat
        names = {name: {"unit": flat.unknowns[j].unit.text, "doc": flat.unknowns[j].doc} for name, j in flat.names.items()}
        names |= {h.name: {"unit": h.unit.text, "doc": h.doc} for h in flat.held}
    # variables by the innermost part or node at the beginning of their path; a part and a node may have the same name
    known, entries_by_owner = {*expanded.leaves, *expanded.junctions}, dict[str, list[Entry]]()
    for variable, entry in names.items():
        owner_path = variable.rpartition(".")[0]
        while owner_path and owner_path not in known:
            owner_path = owner_path.rpartition(".")[0]
        entries_by_owner.setdefault(owner_path, []).append({"name": variable, **entry})
    # inner variables of a part before the variables of its ports
    owned = {owner_path: sorted(entries, key=lambda e: str(e["name"]).count("."))
             for owner_path, entries in entries_by_owner.items()}
    free = set(assembly.parameter_names) if assembly is not None else set()
    parameters_by_owner: dict[str, list[Entry]] = {}
    for path, bound, leaf in declared(expanded):
        owner = leaf.path if leaf is not None else ""
        name = path.removeprefix(f"{owner}.") if owner else path
        parameter = leaf.component.parameters[name] if leaf is not None else None
        parameters_by_owner.setdefault(owner, []).append(_parameter(path, name, bound, parameter, path in free))
    # signal inputs with a given value
    parts = {path: {"kind": foreign.path.name if (foreign := leaf.component.foreign) else leaf.component.name,
                    "summary": leaf.component.summary, "block": leaf.component.composite,
                    "path": str(leaf.component.path), "line": leaf.place.line if leaf.place.file == text_name else None,
                    "parameters": [*parameters_by_owner.get(path, ()),
                                   *[_parameter(f"{leaf.path}.{name}", name, bound, leaf.component.signals[name],
                                                f"{leaf.path}.{name}" in free)
                                     for name, bound in leaf.inputs.items()], *_missing(leaf, joined)],
                    "signals": owned.get(path, []), "ports": ports.get(path, [])} for path, leaf in expanded.leaves.items()}
    domains = {path: network.groups[index].domain for path, index in network.group_of_node.items()}
    nodes = {path: {"domain": domains.get(path, "signal"), "line": j.place.line if j.place.file == text_name else None,
                    "ends": [f"{end.leaf}.{end.port}" for end in j.ends if end.sign > 0],
                    "signals": owned.get(path, [])} for path, j in expanded.junctions.items()}
    model = expanded.model
    output_entries = [{"name": name, "unit": output.unit, "doc": output.text} for name, output in model.show.items()]
    if not output_entries and assembly is not None:
        output_entries = [{"name": name, **names[name]} for name in assembly.state_names if name in names]
    # begin and end of a run: duration, output interval, kind of start, and the required values at the start
    run_settings = {"until": model.until.text if model.until else "", "every": model.every.text if model.every else "",
                    "start": model.initial.mode or "",
                    "initial": {name: f"{'~ ' if c.guess else ''}{c.value.text}"
                                for name, c in model.initial.conditions.items()}}
    return {"name": model.name, "summary": model.summary, "parts": parts, "nodes": nodes,
            "parameters": parameters_by_owner.get("", []), "outputs": output_entries, "named": bool(model.show),
            "moves": bool(model.view) or any(leaf.component.view for leaf in expanded.leaves.values()),
            "settings": run_settings}


def port_entries(expanded: Expanded, network: Network, drawn: Drawn) -> dict[str, list[Entry]]:
    """The ports of the parts on the outermost sheet: domain, end points of wires, node."""
    # a node inside a block may extend to a part of the sheet: `block.node: [+part.port]`
    on = {end.name: path for path, junction in expanded.junctions.items()
          for end in junction.ends if end.sign > 0 and "." not in end.leaf}
    entries: dict[str, list[Entry]] = {}
    for item in drawn.items:
        leaf = expanded.leaves[item.part.path]
        for port in item.part.ports:
            if port.startswith(":"):
                continue  # a node inside a block that extends out of it
            base, path = port.partition("[")[0], f"{item.part.path}.{port}"
            signal = leaf.component.signal(base)
            domain = "signal" if signal else network.domains.get(leaf.path, {}).get(base, "")
            entries.setdefault(item.part.path, []).append({
                "name": port, "path": path, "domain": domain, "direction": signal.direction if signal else "",
                "doc": signal.doc if signal else leaf.component.ports[base].doc, "node": on.get(path, ""),
                "value": base in leaf.inputs and f"{item.part.path}.{base}" not in expanded.defaults,
                "default": f"{item.part.path}.{base}" in expanded.defaults,
                "at": [[a.x, a.y, a.side] for a in item.anchors(port)]})
    return entries


def own_port_entries(block: Component, network: Network, expanded: Expanded, drawn: Drawn) -> list[Entry]:
    """The ports of a block that is drawn by itself, in the form of `port_entries`."""
    on = {end.name: path for path, junction in expanded.junctions.items() for end in junction.ends if not end.leaf}
    entries: list[Entry] = []
    for anchor in drawn.anchors:
        base = anchor.port.partition("[")[0]
        signal = block.signal(base)
        domain = "signal" if signal else network.domains.get("", {}).get(base, "")
        entries.append({"name": anchor.port, "path": anchor.port, "domain": domain,
                        "direction": signal.direction if signal else "",
                        "doc": signal.doc if signal else block.ports[base].doc,
                        "node": on.get(anchor.port, ""), "value": False, "inner": True,
                        "at": [[anchor.x, anchor.y, anchor.side]]})
    return entries


def own_parameters(block: Component) -> list[Entry]:
    """The parameters that a component declares, with their defaults."""
    return [{"path": p.name, "name": p.name, "text": p.default.text if p.default else "", "doc": p.doc, "unit": p.unit.text,
             "limits": [None if v is None else p.unit.from_si(v) for v in (p.low, p.high)]}
            for p in block.parameters.values()]


def _missing(leaf: Leaf, joined: set[str]) -> list[Entry]:
    """Parameters that need a value, and inputs on no node, if they have none yet."""
    needed: list[Parameter | SignalPort] = [
        p for name, p in leaf.component.parameters.items() if name not in leaf.parameters and not p.medium]
    needed += [s for name, s in leaf.component.signals.items() if s.direction == "in" and name not in leaf.inputs
               and f"{leaf.path}.{name}" not in joined]
    return [{"path": f"{leaf.path}.{p.name}", "name": p.name, "text": "", "doc": p.doc, "unit": p.unit.text,
             "needed": isinstance(p, Parameter)} for p in needed]


def _parameter(path: str, name: str, bound: Bound, declaration: Parameter | SignalPort | None, free: bool) -> Entry:
    """A parameter with its value as written, and the range of its slider if it is one number that may be changed without
    a new assembly."""
    value = bound.value
    text = value.file.name if isinstance(value, FileInput) else value.text
    if isinstance(value, Value) and value.si and isinstance(value.expr, Number) and declaration is not None:
        text = readable(value.expr.value, declaration.unit.text)  # a value that is in no text, such as for an absent effect
    entry: Entry = {"path": path, "name": name, "text": text, "doc": declaration.doc if declaration else "",
                    "unit": declaration.unit.text if declaration else ""}
    low = declaration.low if isinstance(declaration, Parameter) else None
    high = declaration.high if isinstance(declaration, Parameter) else None
    if declaration is not None:
        entry["limits"] = [None if low is None else declaration.unit.from_si(low),
                           None if high is None else declaration.unit.from_si(high)]
    if free and isinstance(value, Value) and (slider := _slider(value, text.partition(" ")[2].strip(), low, high)):
        entry["slider"] = slider
    return entry


def _slider(value: Value, written: str, low: float | None, high: float | None) -> Entry | None:
    """Value, ends and limits in the `written` unit of the value; logarithmic if all are positive."""
    if not isinstance(value.expr, Number) or value.formula:
        return None
    try:
        unit = read_unit(written) if written else Unit("1", 1.0, 0.0, ())
    except UnitProblem:
        return None
    current = unit.from_si(value.expr.value)
    least, most = (None if end is None else unit.from_si(end) for end in (low, high))
    if current > 0 and not unit.offset:
        begin, end = current / DECADE, current * DECADE
    elif current < 0 and not unit.offset:
        begin, end = 2 * current, 0.0
    elif unit.offset:
        begin, end = current - 50.0, current + 50.0
    else:
        begin, end = -1.0 if least is None or least < 0 else 0.0, 1.0
    begin = begin if least is None else max(begin, least)
    end = end if most is None else min(end, most)
    if least is not None and most is not None and not (most > 100 * max(least, current / DECADE) > 0):
        begin, end = least, most
    if not begin < end:
        return None
    return {"value": current, "unit": written, "from": begin, "to": end, "low": least, "high": most,
            "log": begin > 0 and end / begin >= DECADE}


def problem_entry(problem: Problem, text_name: str, parts: dict[str, tuple[int, int]]) -> Entry:
    """A problem with its place in the text, and the part of the diagram in which it lies."""
    place = problem.place
    in_text = place is not None and place.file == text_name
    owners = [name for name, (first, last) in parts.items() if place is not None and in_text and first <= place.line <= last]
    return {"code": problem.code, "message": problem.message, "hint": problem.hint, "notes": list(problem.notes),
            "file": place.file if place and not in_text else "", "line": place.line if place and in_text else None,
            "other_line": place.line if place and not in_text else None,
            "column": place.column if place and in_text else 1, "length": place.length if place and in_text else 0,
            "part": owners[-1] if owners else ""}


def part_lines(root: Mapping) -> dict[str, tuple[int, int]]:
    """First and last line of each part under `components:`."""
    entries = root.items.get("components")
    return {name: (key.place.line, last_line(entries.items[name])) for name, key in entries.keys.items()} \
        if isinstance(entries, Mapping) else {}


def last_line(node: Node) -> int:
    """The last line of a node's entries."""
    inner: list[Node] = []
    if isinstance(node, Mapping):
        inner = list(node.items.values())
    elif isinstance(node, Sequence):
        inner = list(node.items)
    return max([node.place.line, *(last_line(n) for n in inner)])
