"""Edits of a diagram as changes of its text: add, rename and delete parts and nodes, set values."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from heavebond.core.errors import Problem, Problems, UsageError, suggest
from heavebond.equations.connect import Network, connect_as_far
from heavebond.equations.expand import expand_as_far
from heavebond.equations.expanded import Expanded
from heavebond.language import reading
from heavebond.language.component_file import COMPONENT_KEYS
from heavebond.language.edits import place_of
from heavebond.language.library import example
from heavebond.language.model import MODEL_KEYS, Model, from_source
from heavebond.studio.blocks import is_block, read_block
from heavebond.studio.job import Job
from heavebond.text.yaml_edits import Key, Tree, add_item, delete_entry, rename_key, replace_scalars, set_entry, tree
from heavebond.text.yaml_source import Mapping, Scalar, parse, read

Entry = dict[str, Any]
FIRST = re.compile(r"\.(\w+)")
WORDS = {"view": ("is", "colour", "label"), "show": ("unit",), "components": ("is", "at"), "initial": ("start",)}


@dataclass(frozen=True)
class Written:
    """The text of a diagram while it is edited, and its YAML tree: values may still be wrong."""

    text: str
    root: dict[str, Tree]
    def section(self, name: str) -> dict[str, Tree]:
        """The entries of a section of this file; empty if it is missing."""
        entries = self.root.get(name)
        return entries if isinstance(entries, dict) else {}


@dataclass(frozen=True)
class Diagram(Written):
    """A diagram while it is edited, with its known parts, ports and nodes, and the `problems` of its parts and values."""

    model: Model
    expanded: Expanded
    network: Network
    problems: tuple[Problem, ...] = ()

    @property
    def used_names(self) -> set[str]:
        """Names of parts, nodes and parameters, in a block also of its ports and variables."""
        block = self.expanded.leaves.get("")
        component = block.component if block is not None else None
        return {*self.model.body.instances, *self.model.body.wires, *self.model.parameters,
                *((*component.ports, *component.signal_names, *component.parameters, *component.variables)
                  if component is not None else ())}

    def named(self, name: str) -> Named:
        """Meaning of a part or node name in formulas."""
        leaf = self.expanded.leaves.get(name)
        members: set[str] = set()
        if leaf is not None:
            kind = leaf.component
            members = {m.partition("[")[0] for m in (*kind.parameters, *kind.variables, *kind.ports, *kind.signals,
                                                     *kind.body.instances, *kind.body.wires)}
        return Named(name, frozenset(members), name in self.model.body.instances, name in self.model.body.wires)

    def declared_part(self, name: str) -> str:
        """Check that this file declares the part; UsageError for others."""
        if name not in self.section("components"):
            known = name in self.model.body.instances
            raise UsageError([Problem("part-inherited" if known else "part-unknown",
                                      f"'{name}' is declared in the diagram that this one extends" if known else
                                      f"there is no part '{name}'", None,
                                      "Change it there, or add it here under `components:`." if known else
                                      suggest(name, self.model.body.instances))])
        return name

    def node_of(self, port: str) -> str:
        """The node of a port, empty if it is on none."""
        return next((name for name, wire in self.model.body.wires.items()
                     if any(end.path == port for end in wire.ends)), "")


def read_text_only(text: str, job: Job) -> Written:
    """Read a text as YAML; ModelError if it is malformed."""
    root_tree = tree(parse(text, Path(job.path), job.name).root)
    assert isinstance(root_tree, dict)
    return Written(text, root_tree)


def read_diagram(text: str, job: Job) -> Diagram:
    """Read a diagram or a block that may be unfinished; ModelError for a text that cannot be read."""
    source = parse(text, Path(job.path), job.name)
    root_tree = tree(source.root)
    if is_block(source):
        block = read_block(source)
        assert isinstance(root_tree, dict)
        return Diagram(text, root_tree, block.model, block.whole, block.network, tuple(block.problems.found))
    model = from_source(source)
    expanded, problems = expand_as_far(model)
    network, _ = connect_as_far(expanded)
    assert isinstance(root_tree, dict)
    return Diagram(text, root_tree, model, expanded, network, tuple(problems.found))


# -- parts -----------------------------------------------------------------------------------------------------------------
def place_part(diagram: Diagram, job: Job, action: Entry) -> Entry:
    """Add a part of a kind, with required values from the example of its component."""
    kind = str(action["kind"])
    component = diagram.model.library.component(kind)
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", kind.removesuffix(".fmu"))
    name = free_name(re.sub(r"\W+", "_", words).lower(), diagram.used_names)
    needed = [n for n, p in component.parameters.items() if p.default is None and p.neutral is None and not p.medium]
    example_values = _example_values(component, kind)
    settings: dict[str, Tree] = {n: example_values[n] for n in needed if n in example_values}
    return {"text": with_entry(diagram.text, "components", name, {"is": kind, **settings}), "part": name}


def _example_values(component: Any, kind: str) -> dict[str, Tree]:
    """Parameter values in the component's example, without formulas of other parts."""
    path = example(component)
    example_tree = tree(read(path, bundled=True).root) if path is not None else {}
    parts = example_tree.get("components", {}) if isinstance(example_tree, dict) else {}
    for part in parts.values() if isinstance(parts, dict) else ():
        if isinstance(part, dict) and part.get("is") == kind:
            return {k: v for k, v in part.items() if k not in ("is", "at", "repeat") and "=" not in str(v)}
    return {}


def rename_part(diagram: Diagram, job: Job, action: Entry) -> Entry:
    """Rename a part, in wires and formulas too. The new name may be the name of a node on one of its ports."""
    old, new = diagram.declared_part(str(action["part"])), str(action["name"])
    if old == new:
        return {"text": diagram.text, "part": old}
    on = {name for name, wire in diagram.model.body.wires.items() if any(e.path.partition(".")[0] == old for e in wire.ends)}
    _check_name(new, diagram, allowed=on - set(diagram.model.body.instances))
    text = renamed_mentions(diagram.text, diagram.named(old), new, node=False)
    return {"text": _renamed_layout(rename_key(text, ("components", old), new), "parts", old, new), "part": new}


def rename_node(diagram: Diagram, job: Job, action: Entry) -> Entry:
    """Rename a node, in formulas too. The new name may be the name of a part on it."""
    old, new = str(action["node"]), str(action["name"])
    if old == new:
        return {"text": diagram.text, "node": old}
    wire = diagram.model.body.wires.get(old)
    on_it = {end.path.partition(".")[0] for end in wire.ends} if wire else set()
    _check_name(new, diagram, allowed=on_it - set(diagram.model.body.wires))
    if old not in diagram.section("nodes") or "extends" in diagram.root:
        raise UsageError([Problem("node-inherited", f"node '{old}' is named in another file", None, "Rename it there.")])
    text = renamed_mentions(diagram.text, diagram.named(old), new, node=True)
    return {"text": _renamed_layout(rename_key(text, ("nodes", old), new), "wires", old, new), "node": new}


def _renamed_layout(text: str, section: str, old: str, new: str) -> str:
    """Rename an entry of `layout:`, if the file has it."""
    try:
        return rename_key(text, ("layout", section, old), new)
    except UsageError:
        return text


def without_layout(text: str, section: str, name: str) -> str:
    """Delete an entry of `layout:`, with the sections that are empty then."""
    layout = tree(parse(text).root)
    assert isinstance(layout, dict)
    entries = layout.get("layout")
    inner = entries.get(section) if isinstance(entries, dict) else None
    if not isinstance(entries, dict) or not isinstance(inner, dict) or name not in inner:
        return text
    keys = ("layout", section, name) if len(inner) > 1 else ("layout", section) if len(entries) > 1 else ("layout",)
    return delete_entry(text, keys)


def _check_name(name: str, diagram: Diagram, allowed: Iterable[str] = ()) -> None:
    problems = Problems()
    reading.identifier(Scalar(name, parse("a: 1").root.place), "a part", problems)
    if problems.found or len(name) > 80:
        raise UsageError([Problem("name-bad", f"'{name[:80]}' cannot be a name", None, "A name has letters, digits and _, a "
                                  "letter first, and is not a word of the formula language.")])
    if name in diagram.used_names - set(allowed):
        raise UsageError([Problem("name-twice", f"there is already a part, a node or a parameter '{name}'")])


def free_name(first: str, used_names: Iterable[str]) -> str:
    """`first`, or `first2`, `first3`, ... if that is taken or not a valid name."""
    known = {*used_names, *reading.RESERVED}
    stem = first if first[:1].isalpha() else f"part_{first}"
    return next(name for k in range(1, len(known) + 3) if (name := stem if k == 1 else f"{stem}{k}") not in known)


def delete(diagram: Diagram, job: Job, action: Entry) -> Entry:
    """Delete parts and nodes, with wires, outputs, initial conditions and settings that mention them."""
    text, before = diagram.text, diagram
    for name in map(str, action.get("parts", ())):
        diagram = read_diagram(text, job)
        if name not in diagram.section("components") and name in diagram.model.body.instances:
            text = add_item(text, ("remove",), name)
            continue
        text = _without_part(diagram, diagram.declared_part(name), job)
    for name in map(str, action.get("nodes", ())):
        text = without_node(read_diagram(text, job), name)
    after = tree(parse(text).root)
    assert isinstance(after, dict)
    # entries that were removed with parts and nodes: outputs, initial conditions, settings and shapes
    removed_entries = []
    for section, word in (("show", "output"), ("initial", "initial value"), ("set", "setting"), ("view", "shape")):
        old, new = before.root.get(section), after.get(section)
        remaining = new if isinstance(new, dict) else {}
        removed_entries += [f"{word} {name}" for name in old if name not in remaining] if isinstance(old, dict) else []
    return {"text": text, "removed": removed_entries}


def _without_part(diagram: Diagram, name: str, job: Job) -> str:
    text = deleted_mentions(diagram.text, diagram.named(name), node=False)
    text = without_layout(delete_entry(text, ("components", name)), "parts", name)
    for node, ends in diagram.section("nodes").items():
        if isinstance(ends, list):
            for k in reversed([k for k, end in enumerate(ends) if str(end).lstrip("+-").partition(".")[0].partition("[")[0]
                               == name]):
                text = delete_entry(text, ("nodes", node, k))
            if all(str(end).lstrip("+-").partition(".")[0] == name for end in ends):
                text = deleted_mentions(text, Named(node, frozenset(), False, True), node=True)
                text = without_layout(text, "wires", node)
    return text


def without_node(diagram: Diagram, name: str) -> str:
    if name not in diagram.section("nodes"):
        raise UsageError([Problem("node-inherited", f"node '{name}' is declared in the diagram that this one extends", None,
                                  "Take ports from it here: `-part.port`.")])
    text = delete_entry(deleted_mentions(diagram.text, diagram.named(name), node=True), ("nodes", name))
    return without_layout(text, "wires", name)


# -- values ----------------------------------------------------------------------------------------------------------------
def set_value(diagram: Written, job: Job, action: Entry) -> Entry:
    """Set a parameter or input by its path, as written; an empty value removes the entry."""
    path, value = str(action["path"]), str(action["value"]).strip()
    keys: tuple[Key, ...] = place_of(parse(diagram.text).root, path)
    part = {"part": path.rpartition(".")[0]} if "." in path else {}
    if not value:
        try:
            return {"text": delete_entry(diagram.text, keys), **part}
        except UsageError:
            return {"text": diagram.text, **part}
    return {"text": set_entry(diagram.text, keys, value, after=section_before(diagram.text, str(keys[0]))), **part}


def with_entry(text: str, section: str, name: str, value: Tree) -> str:
    """Add an entry to a section, which is inserted in the order of the language if it is missing."""
    return set_entry(text, (section, name), value, after=section_before(text, section))


def section_before(text: str, section: str) -> str:
    """The section of a text after which a new section `section` is inserted; empty if the text has this section."""
    present = list(parse(text).root.items)
    if section in present:
        return ""
    known = COMPONENT_KEYS if "component" in present else MODEL_KEYS
    earlier = known[:known.index(section)]
    return next((key for key in reversed(present) if key in earlier), "")


@dataclass(frozen=True)
class Named:
    """A name and its meaning: `name.member` belongs to the part if the part has that member or no node has the name, else
    to the node."""

    name: str
    members: frozenset[str]
    is_part: bool
    is_node: bool

    def pattern(self) -> re.Pattern[str]:
        """Pattern of the name before a dot, and after neither a dot nor a letter; an index of a repeated part may follow
        it.
        """
        return re.compile(rf"(?<![\w.]){re.escape(self.name)}(?=(?:\[[^\[\]]*\])?\.\w)")

    def means(self, raw: str, match: re.Match[str], *, node: bool) -> bool:
        """True if a mention in a formula belongs to the node, or else to the part."""
        if self.is_part and self.is_node:
            member = FIRST.search(raw, match.end())
            return node != (member is not None and member.group(1) in self.members)
        return True


def renamed_mentions(text: str, named: Named, new: str, *, node: bool) -> str:
    """Rename all mentions of the part, or of the `node`; keys that declare it stay."""
    pattern = named.pattern()

    def change(path: tuple[Key, ...], raw: str) -> str:
        if path[0] == "components" and path[2:3] == ("data",) and raw.strip("'\"") == named.name and not node:
            return new
        if path[0] == "clocks" and path[2:3] == ("parts",) and not node:
            return re.sub(rf"(?<![\w.]){re.escape(named.name)}(?!\w)", new, raw)
        # true if names in a scalar are names of the diagram
        section = path[0]
        if path[-1] == ":":
            formula = section in ("nodes", "set", "initial", "show") and len(path) == 3
        elif path[-1] in WORDS.get(str(section), ()):
            formula = False
        elif section in ("parameters", "components", "set", "simulate"):
            # also a formula in a block of text
            formula = re.sub(r"^[|>][^\n]*\n", "", raw).lstrip().lstrip("'\"").startswith("=")
        else:
            formula = section in ("nodes", "initial", "show", "view", "equations", "stores", "dissipates", "requires")
        if not formula:
            return raw
        wires = path[0] == "nodes"
        if wires and node and path[-1] != ":":
            return raw

        def put(match: re.Match[str]) -> str:
            mine = (not node) if wires or path[0] == "set" else named.means(raw, match, node=node)
            return new if mine else match.group()

        return pattern.sub(put, raw)

    return replace_scalars(text, change)


def deleted_mentions(text: str, named: Named, *, node: bool) -> str:
    """Remove outputs, initial conditions, settings and shapes that mention the part, or the `node`. Formulas of other
    parts stay, and `check` reports them."""
    root_tree = tree(parse(text).root)
    assert isinstance(root_tree, dict)
    pattern = named.pattern()

    def mentions(value: Tree, *, setting: bool = False) -> bool:
        if isinstance(value, str):
            return any(setting or named.means(value, mention, node=node) for mention in pattern.finditer(value))
        inner = value.values() if isinstance(value, dict) else value
        return any(mentions(item) for item in inner)

    for section in ("set", "initial", "show", "view"):
        entries = root_tree.get(section)
        for name, value in reversed(entries.items()) if isinstance(entries, dict) else ():
            keyed = section != "view" and mentions(name, setting=section == "set") and not (section == "set" and node)
            if keyed or (section in ("show", "view") and mentions(value)):
                text = delete_entry(text, (section, name))
            elif section == "initial" and isinstance(value, list):
                for k in reversed([k for k, item in enumerate(value) if mentions(item)]):
                    text = delete_entry(text, (section, name, k))
    return text


def with_records(text: str, files: Sequence[str]) -> tuple[str, list[str]]:
    """Add records to the text of an experiment; returns it and their names. Existing records are skipped."""
    names = []
    for file in files:
        entries = parse(text).root.items.get("records")
        known = entries.items if isinstance(entries, Mapping) else {}
        if any(isinstance(r, Mapping) and getattr(r.items.get("file"), "text", "") == file for r in known.values()):
            continue
        stem = re.sub(r"\W+", "_", PurePosixPath(file).stem).strip("_") or "record"
        name = next(n for k in range(1, 10_000) if (n := stem if k == 1 else f"{stem}_{k}") not in known)
        text = set_entry(text, ("records", name), {"file": file, "use": "validate"})
        names.append(name)
    return text, names
