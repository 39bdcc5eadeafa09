"""Ways to write the same machine differently: what comes of it must stay the same.

Each relation makes another sheet, and says what a variable is called there: `Same.name` gives a formula, or None where
there is nothing to compare.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from random import Random
from typing import Any

from benchmarks.fuzz.sheets import Sheet, names_in, over_values, quantities, renamed
from heavebond.core.units import UnitProblem, read_unit
from heavebond.language.definition import Component
from heavebond.numerics.dae import Assembly


@dataclass(frozen=True)
class Same:
    """The same machine in other words."""

    sheet: Sheet
    name: Callable[[str], str | None]


Relation = Callable[[Sheet, Assembly, Random], Same | None]


def head(name: str) -> str:
    """The first word of a dotted name."""
    return re.split(r"[.\[]", name, maxsplit=1)[0]


def component_of(kind: str, assembly: Assembly) -> Component | None:
    """The component of a kind; None where a part is something else, as an FMU."""
    library = assembly.model.library
    return library.component(kind) if kind in library.files else None


# -- names and order ---------------------------------------------------------------------------------------------------
def rename(given: Sheet, assembly: Assembly, random: Random) -> Same | None:
    """Every part, node and parameter gets another name, in another order of letters."""
    old = list(dict.fromkeys([*given.parts, *(n for n in given.nodes if "." not in n), *given.parameters]))
    numbers = random.sample(range(len(old)), len(old))
    new = {name: f"n{number}_{random.choice('abxyz')}" for name, number in zip(old, numbers, strict=True)}

    def other(name: str) -> str:
        first = re.match(r"\w+", name)
        return new.get(first[0], first[0]) + name[first.end():] if first else name

    return Same(over_values(given, lambda text: _each_name(text, other), lambda text: renamed(text, other)), other)


def _each_name(text: str, other: Callable[[str], str]) -> str:
    """What names something: one name, or a formula of names (a condition at the start)."""
    return other(text) if re.fullmatch(r"[\w.\[\]]+", text) else renamed(text, other)


def reorder(given: Sheet, assembly: Assembly, random: Random) -> Same | None:
    """Parts, nodes, the ends on them and all else stand in another order."""
    def mixed(section: dict[str, Any]) -> dict[str, Any]:
        return {name: section[name] for name in random.sample(list(section), len(section))}

    nodes = {name: random.sample(ends, len(ends)) for name, ends in mixed(given.nodes).items()}
    return Same(replace(given, parts=mixed(given.parts), nodes=nodes, parameters=mixed(given.parameters),
                        settings=mixed(given.settings), initial=mixed(given.initial)), lambda name: name)


# -- values ------------------------------------------------------------------------------------------------------------
OTHER = {"m": "mm", "mm": "m", "cm": "m", "kg": "g", "t": "kg", "g": "kg", "N": "mN", "kN": "N", "MN": "kN", "s": "ms",
         "ms": "s", "bar": "Pa", "Pa": "kPa", "MPa": "bar", "GPa": "MPa", "kPa": "Pa", "L": "m**3", "min": "s", "K": "mK",
         "V": "mV",
         "A": "mA", "rad": "deg", "deg": "rad", "Hz": "kHz", "W": "kW", "kW": "W", "J": "kJ", "degC": "K", "rpm": "rad/s",
         "%": "1", "ohm": "mohm", "mH": "H", "H": "mH", "uF": "F", "F": "uF", "um": "mm", "km": "m"}
TOKEN = re.compile(r"[A-Za-z%]+")


def units(given: Sheet, assembly: Assembly, random: Random) -> Same | None:
    """Every quantity stands in another unit."""
    def written(value: float, unit: str) -> str:
        found = [m for m in TOKEN.finditer(unit) if m[0] in OTHER]
        for one in random.sample(found, len(found)):
            new = OTHER[one[0]]
            new = f"({new})" if re.search(r"[*/]", new) and one[0] != unit else new
            text = unit[:one.start()] + new + unit[one.end():]
            try:
                return f"{read_unit(text).from_si(value)!r} {text}"
            except UnitProblem:
                continue
        return f"{read_unit(unit).from_si(value)!r} {unit}"

    changed = over_values(given, lambda text: _asked(text, written), lambda text: quantities(text, written))
    times = {k: v if k == "solver" else quantities(v, written) for k, v in given.simulate.items()}
    return Same(replace(changed, simulate=times), lambda name: name)


def _asked(text: str, written: Callable[[float, str], str]) -> str:
    return text if re.fullmatch(r"[\w.\[\]]+", text) else quantities(text, written)


def parameters(given: Sheet, assembly: Assembly, random: Random) -> Same | None:
    """Every number of a part becomes a parameter of the diagram, named in a formula."""
    values = dict(given.parameters)
    parts: dict[str, Any] = {}
    for name, entry in given.parts.items():
        component = component_of(entry["is"], assembly)
        parts[name] = dict(entry)
        for key, text in entry.items():
            declared = component.parameters.get(key) if component is not None else None
            # the unit of a bare 0, and an open one, are known where it is declared
            if declared is not None and not declared.integer and isinstance(text, str) and " " in text and \
                    not text.startswith("=") and "$" not in declared.unit.text and declared.count is None:
                values[f"value_{len(values)}"] = text
                parts[name][key] = f"=value_{len(values) - 1}"
    return Same(replace(given, parameters=values, parts=parts), lambda name: name) if values != given.parameters else None


# -- blocks ------------------------------------------------------------------------------------------------------------
def into_a_block(given: Sheet, assembly: Assembly, random: Random) -> Same | None:
    """Some parts move into a block, with the nodes that only they are on."""
    found = [name for name in given.parts if _movable(name, given, assembly)]
    if len(found) < 1:
        return None
    inside = set(random.sample(found, random.randint((len(found) + 1) // 2, len(found))))
    wires = {name: [e for e in ends if head(e) in inside] for name, ends in given.nodes.items()}
    inner = {n for n, ends in wires.items() if ends and len(ends) == len(given.nodes[n])}
    shared = {n: f"p{k}" for k, n in enumerate(n for n, ends in wires.items() if ends and n not in inner)}
    ports = {port: _domain(wires[n][0], given, assembly) for n, port in shared.items()}
    body = {"component": "Moved", "summary": "Parts that were moved.", "ports": ports,
            "components": {n: e for n, e in given.parts.items() if n in inside},
            "nodes": {**{n: wires[n] for n in inner}, **{f"at_{port}": [port, *wires[n]] for n, port in shared.items()}}}
    if not ports:
        del body["ports"]
    members = {n: _members(wires[n][0], given, assembly) for n in inner}

    def other(name: str) -> str:
        first, _, rest = name.partition(".")
        # of a node and a part with one name, the members of a node are the node's
        node = first in given.nodes and (first not in given.parts or rest in _all_members(first, given, assembly))
        moved = first in members if node else first in inside
        return f"moved.{name}" if moved else name

    changed = over_values(given, lambda text: _each_name(text, other), lambda text: renamed(text, other))
    nodes = {n: [*(e for e in ends if head(e) not in inside), *([f"moved.{shared[n]}"] if n in shared else [])]
             for n, ends in given.nodes.items() if n not in inner}
    parts = {n: e for n, e in changed.parts.items() if n in given.parts and n not in inside}
    sheet = replace(changed, nodes=nodes, parts={**parts, "moved": {"is": "Moved"}},
                    files={**given.files, "components/moved.yaml": _written(body)})
    return Same(sheet, other)


def _written(body: dict[str, Any]) -> str:
    return "\n".join([*(f"{key}: {json.dumps(value)}" for key, value in body.items()), ""])


def _movable(name: str, given: Sheet, assembly: Assembly) -> bool:
    """A part whose figures are numbers, with ports of plain domains, and no signals that are wired."""
    entry = given.parts[name]
    component = component_of(entry["is"], assembly)
    if component is None or "repeat" in entry or any(p.count or "$" in p.domain for p in component.ports.values()):
        return False
    if any(value == name for other in given.parts.values() for key, value in other.items() if key != "is"):
        return False  # a data sheet, which stands beside the part that takes its values
    values = [v for k, v in entry.items() if k not in ("is", "at")]
    if not all(isinstance(v, str) and not names_in(v) for v in values):
        return False
    wired = {e for ends in given.nodes.values() for e in ends}
    reached = {n: ends for n, ends in given.nodes.items() if "." in n}
    ends_there = (e.removeprefix("+") for ends in reached.values() for e in ends)  # `+` adds an end to a node of a block
    if name in map(head, [*reached, *ends_there, *given.initial.get("solve", [])]):
        return False
    return not any(f"{name}.{signal}" in wired for signal in component.signals)


def _domain(end: str, given: Sheet, assembly: Assembly) -> str:
    component = component_of(given.parts[head(end)]["is"], assembly)
    assert component is not None
    return component.ports[end.partition(".")[2]].domain


def _members(end: str, given: Sheet, assembly: Assembly) -> set[str]:
    domain = assembly.model.library.domains[_domain(end, given, assembly)]
    return {*domain.members, *domain.positions}


def _all_members(node: str, given: Sheet, assembly: Assembly) -> set[str]:
    for end in given.nodes[node]:
        component = component_of(given.parts[head(end)]["is"], assembly) if head(end) in given.parts else None
        port = component.ports.get(re.sub(r"\[.*", "", end.partition(".")[2])) if component is not None else None
        if port is not None and port.domain in assembly.model.library.domains:
            return _members(f"{head(end)}.{port.name}", given, assembly)
    return set()


# -- springs and the like ----------------------------------------------------------------------------------------------
# how the values of two equal parts that take the place of one follow from its own: side by side, and one behind the other
PARALLEL = {"Spring": {"c": 0.5}, "Damper": {"d": 0.5}, "SpringDamper": {"c": 0.5, "d": 0.5}, "TorsionSpring": {"c": 0.5},
            "RotationalDamper": {"d": 0.5}, "TorsionSpringDamper": {"c": 0.5, "d": 0.5}, "Mass": {"m": 0.5},
            "Inertia": {"J": 0.5}, "Weight": {"m": 0.5}, "LaminarLeakage": {"G": 0.5}, "Volume": {"V": 0.5},
            "Orifice": {"q_r": 0.5}, "Resistor": {"R": 2.0}, "Capacitor": {"C": 0.5}, "ConstantForce": {"F": 0.5},
            "ThermalResistance": {"R": 2.0}, "HeatCapacity": {"C": 0.5, "m": 0.5}, "Drag": {"k": 0.5}}
SERIES = {"Spring": {"c": 2.0, "l0": 0.5}, "TorsionSpring": {"c": 2.0, "phi0": 0.5}, "Resistor": {"R": 0.5}}


def parallel(given: Sheet, assembly: Assembly, random: Random) -> Same | None:
    """Each spring, damper, mass ... becomes two of half the value, side by side."""
    return _split(given, assembly, PARALLEL, _beside)


def series(given: Sheet, assembly: Assembly, random: Random) -> Same | None:
    """Each spring becomes two of twice the stiffness and half the length, one behind the other."""
    return _split(given, assembly, SERIES, _behind)


def _split(given: Sheet, assembly: Assembly, rules: dict[str, dict[str, float]],
           wired: Callable[[dict[str, list[str]], str, str, Component], None]) -> Same | None:
    said = " ".join([json.dumps([given.settings, given.initial, given.show, [
        {k: v for k, v in e.items() if k != "is"} for e in given.parts.values()]]), *(n for n in given.nodes if "." in n)])
    parts, nodes = dict(given.parts), {n: list(ends) for n, ends in given.nodes.items()}
    done = []
    for name, entry in given.parts.items():
        rule = rules.get(entry["is"])
        component = component_of(entry["is"], assembly)
        own = {*component.parameters, *component.unknowns} if component is not None else set()
        # what is named elsewhere is not what it was, and a node may have the name of a part that is on it
        if (rules is SERIES and name in nodes) or rule is None or component is None or "repeat" in entry or \
                not {*rule} & {*entry} or any(re.search(rf"\b{name}\.{word}\b", said) for word in own):
            continue
        if not all(isinstance(entry.get(key, ""), str) for key in rule) or component.path.parent.name == "components":
            continue
        half = {**entry, **{key: _times(entry[key], factor) for key, factor in rule.items() if key in entry}}
        parts[name], parts[f"{name}_again"] = half, half
        wired(nodes, name, f"{name}_again", component)
        done.append(name)
    if not done:
        return None
    return Same(replace(given, parts=parts, nodes=nodes), lambda name: None if head(name) in done and (
        head(name) not in given.nodes or name.partition(".")[2] not in _all_members(head(name), given, assembly)) else name)


def _times(text: str, factor: float) -> str:
    return f"={factor!r}*({text[1:]})" if text.startswith("=") else f"{factor!r} * ({text})" if re.search(r"[*+/(]", text) \
        else quantities(text, lambda value, unit: f"{factor * read_unit(unit).from_si(value)!r} {unit}") if " " in text \
        else repr(factor * float(text))


def _beside(nodes: dict[str, list[str]], name: str, again: str, component: Component) -> None:
    for ends in nodes.values():
        ends += [f"{again}.{e.partition('.')[2]}" for e in ends if head(e) == name]


def _behind(nodes: dict[str, list[str]], name: str, again: str, component: Component) -> None:
    for ends in nodes.values():
        ends[:] = [f"{again}.b" if e == f"{name}.b" else e for e in ends]
    nodes[f"between_{name}"] = [f"{name}.b", f"{again}.a"]


# -- the axis ----------------------------------------------------------------------------------------------------------
# what is given along the axis in parts with one end on it (and in stops, whose side a is the frame), and turns its sign
ALONG = {"Mass": (), "Fixed": ("x0",), "Weight": ("g",), "ForceSource": ("u",), "ConstantForce": ("F",),
         "PositionSource": ("u",), "VelocitySource": ("u",), "AccelerationSource": ("u",), "RigidStop": ("side", "l0")}
GIVEN = {"g": "9.81 m/s**2", "side": "1"}  # where a part does not say it and the usual value is not 0
# what is the same seen from the other side: ratios of positions, each counted from the same zero
SEEN_ALIKE = {"Lever", "Pulley"}
LINE = "translational"


def reversed_axis(given: Sheet, assembly: Assembly, random: Random) -> Same | None:
    """Positions, speeds and forces along the axis are counted the other way: what lies between two bodies is turned round,
    gravity, sources and stops change their signs, and so do positions and speeds at the start."""
    ports = {name: _ports_on_the_axis(entry, assembly) for name, entry in given.parts.items()}
    if not any(ports.values()) or any(found is None for found in ports.values()):
        return None
    wired = {e for ends in given.nodes.values() for e in ends}
    turned = {name for name, found in ports.items() if found and given.parts[name]["is"] not in ALONG
              and given.parts[name]["is"] not in SEEN_ALIKE}
    parts = dict(given.parts)
    for name, found in ports.items():
        keys = ALONG.get(given.parts[name]["is"], ()) if found else ()
        values = {k: given.parts[name].get(k, GIVEN.get(k)) for k in keys}
        if any(f"{name}.{k}" in wired or not isinstance(v, str | None) or names_in(v or "0") for k, v in values.items()):
            return None
        parts[name] = {**given.parts[name], **{k: _negative(v) for k, v in values.items() if v is not None}}
    axis = {n for n, ends in given.nodes.items() if ends and _on_the_axis(ends[0], given, assembly)}
    lines = json.dumps([given.settings, given.parameters, [e for n, e in given.parts.items() if not ports[n]]])
    if any(re.search(rf"\b{re.escape(n)}\.[xv]\b", lines) for n in axis) or given.initial.get("solve"):
        return None  # a formula elsewhere counts along the axis

    def swapped(end: str) -> str:
        name, _, port = end.partition(".")
        first, second = ports.get(name) or ("", "") if name in turned else ("", "")
        return f"{name}.{second}" if port == first else f"{name}.{first}" if port and port == second else end

    def moves(name: str) -> bool:
        node, _, member = name.rpartition(".")
        return node in axis and member in ("x", "v")

    def other(name: str) -> str | None:
        first, _, rest = name.partition(".")
        component = component_of(given.parts[first]["is"], assembly) if first in given.parts else None
        if moves(name):
            return f"-{name}"
        return None if first in given.parts and ports[first] and (
            first not in turned or component is None or rest not in component.unknowns) else name

    initial = {k: _negative(v) if moves(k) and isinstance(v, str) else v for k, v in given.initial.items()}
    if any(names_in(v) for k, v in given.initial.items() if moves(k) and isinstance(v, str)):
        return None
    nodes = {n: [swapped(e) for e in ends] for n, ends in given.nodes.items()}
    return Same(replace(given, parts=parts, nodes=nodes, initial=initial, show={}), other)


def _ports_on_the_axis(entry: dict[str, Any], assembly: Assembly) -> tuple[str, ...] | None:
    """The two ports, or the one, of a part on the axis; empty where it has none, None where it cannot be turned."""
    component = component_of(entry["is"], assembly)
    if component is None or "repeat" in entry:
        return None
    found = tuple(name for name, port in component.ports.items() if port.domain == LINE or "$" in port.domain)
    known = entry["is"] in ALONG or (len(found) == 2 and not component.signals)
    # what is the user's own may count from anywhere
    return () if not found else found if known and component.path.parent.name != "components" else None


def _on_the_axis(end: str, given: Sheet, assembly: Assembly) -> bool:
    component = component_of(given.parts[head(end)]["is"], assembly) if head(end) in given.parts else None
    port = component.ports.get(end.partition(".")[2]) if component is not None else None
    return port is not None and port.domain == LINE


def _negative(text: str) -> str:
    if text.startswith("="):
        return f"=-({text[1:]})"
    return quantities(text, lambda v, u: f"{read_unit(u).from_si(-v)!r} {u}") if " " in text else repr(-float(text))


RELATIONS: dict[str, Relation] = {"renamed": rename, "reordered": reorder, "units": units, "parameters": parameters,
                                  "into a block": into_a_block, "parallel": parallel, "series": series,
                                  "axis reversed": reversed_axis}


if __name__ == "__main__":
    from benchmarks.fuzz.run_relations import main

    main()
