"""Mentions of a part or a node in the text of its diagram: in wires, formulas, initial conditions, outputs, settings."""

from __future__ import annotations

import re
from dataclasses import dataclass

from heavebond.text.yaml_edits import Key, Tree, delete_entry, replace_scalars, tree
from heavebond.text.yaml_source import parse

FIRST = re.compile(r"\.(\w+)")
WORDS = {"view": ("is", "colour", "label"), "show": ("unit",), "components": ("is", "at"), "initial": ("start",)}


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


def _formula(path: tuple[Key, ...], raw: str) -> bool:
    """True if names in a scalar are names of the diagram."""
    section = path[0]
    if path[-1] == ":":
        return section in ("nodes", "set", "initial", "show") and len(path) == 3
    if path[-1] in WORDS.get(str(section), ()):
        return False
    if section in ("parameters", "components", "set", "simulate"):
        return re.sub(r"^[|>][^\n]*\n", "", raw).lstrip().lstrip("'\"").startswith("=")  # also a formula in a block of text
    return section in ("nodes", "initial", "show", "view", "equations", "stores", "dissipates", "requires")


def renamed_mentions(text: str, named: Named, new: str, *, node: bool) -> str:
    """Rename all mentions of the part, or of the `node`; keys that declare it stay."""
    pattern = named.pattern()

    def change(path: tuple[Key, ...], raw: str) -> str:
        if path[0] == "components" and path[2:3] == ("data",) and raw.strip("'\"") == named.name and not node:
            return new
        if path[0] == "clocks" and path[2:3] == ("parts",) and not node:
            return re.sub(rf"(?<![\w.]){re.escape(named.name)}(?!\w)", new, raw)
        if not _formula(path, raw):
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
