"""Edits of a YAML text that preserve all other bytes: comments, order, spaces and quotes.

Every edit is checked: the changed text is parsed, and its tree must equal the original tree with only this change.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from collections.abc import Sequence as Several

from heavebond.core.errors import HeavebondError, Problem, UsageError
from heavebond.text.yaml_source import Mapping, Node, Scalar, Span, parse, spans

Tree = dict[str, "Tree"] | list["Tree"] | str
# texts that need no quotes in any place
_WORDS = re.compile(r"[A-Za-z0-9_][\w.]*(?: [A-Za-z0-9_(=][\w./*()]*)*", re.ASCII)
Key = str | int  # key of a mapping, or index of an item of a list


def set_entry(text: str, keys: Several[Key], value: Tree, *, after: str = "") -> str:
    """Set the value at a path of keys, `("components", "damper", "d")`, and return the changed text.

    An existing value is replaced in place. A new entry is added after the last entry of its mapping, or after the entry
    `after`, in the same style. Missing mappings are created, the first of them after `after`. Lists and mappings are
    written in braces.

    Raises ModelError for a text that cannot be parsed, and UsageError if a key of the path does not have a mapping, or if
    the tree of the changed text would differ in more than this value.
    """
    wanted = _with(tree(parse(text).root), keys, value, after)
    at, depth = _deepest(spans(text), keys)
    remaining_keys = keys[depth:]
    if not remaining_keys:
        blank = " " if text[at.begin - 1:at.begin] == ":" else ""
        end = at.end
        while text[at.begin:at.begin + 1] in ("|", ">") and text[end - 1] == "\n":  # ends after its last line
            end -= 1
        changed = text[:at.begin] + blank + flow(value) + text[end:]
    else:
        changed = _inserted(text, at, [str(key) for key in remaining_keys], value, after)
    return _checked(changed, wanted, keys)


def add_item(text: str, keys: Several[Key], value: str) -> str:
    """Append an item to the list at `keys` in the style of the list, and return the changed text."""
    before = tree(parse(text).root)
    old = _at(before, keys)
    if not isinstance(old, list) or not old:
        return set_entry(text, keys, [value])
    at, _ = _deepest(spans(text), keys)
    last = at.items[-1]
    if at.flow:
        changed = text[:last.end] + ", " + flow(value) + text[last.end:]
    else:
        first = at.items[0].begin
        head = text[text.rfind("\n", 0, first) + 1:first]
        end = _line_end(text, last.end)
        changed = text[:end] + "\n" + head + flow(value) + text[end:]
    return _checked(changed, _with(before, keys, [*old, value]), keys)


def delete_entry(text: str, keys: Several[Key]) -> str:
    """Delete the entry or list item at a path of keys and mappings and lists that become empty; return the changed text.

    The comments on the deleted lines are deleted, and comments on other lines are preserved.
    """
    before = tree(parse(text).root)
    # the path of the outermost mapping or list that becomes empty without the entry at `keys`, otherwise `keys`
    if _at(before, keys) is None:
        raise _refused(keys)
    while len(keys) > 1 and len(_at(before, keys[:-1]) or "") == 1:
        keys = keys[:-1]
    at, depth = _deepest(spans(text), keys[:-1])
    key = keys[-1]
    if depth < len(keys) - 1 or (key not in at.entries if isinstance(key, str) else key >= len(at.items)):
        raise _refused(keys)
    if isinstance(key, str):
        order, places = list(at.entries), [(at.keys[k].begin, at.entries[k].end) for k in at.entries]
        k = order.index(key)
    else:
        places, k = [(item.begin, item.end) for item in at.items], key
    changed = _without_flow(text, places, k) if at.flow else _without_lines(text, *places[k])
    return _checked(changed, _without(before, keys), keys)


def rename_key(text: str, keys: Several[Key], name: str) -> str:
    """Rename the last key of a path; its position and its value are unchanged."""
    before = tree(parse(text).root)
    at, depth = _deepest(spans(text), keys[:-1])
    key = keys[-1]
    owner = _at(before, keys[:-1])
    if depth < len(keys) - 1 or not isinstance(owner, dict) or key not in owner or name in owner:
        raise _refused(keys)
    place = at.keys[str(key)]
    wanted = _with(before, keys[:-1], {name if k == key else k: v for k, v in owner.items()}) if keys[:-1] else \
        {name if k == key else k: v for k, v in owner.items()}
    return _checked(text[:place.begin] + flow(name) + text[place.end:], wanted, keys)


def replace_scalars(text: str, change: Callable[[tuple[Key, ...], str], str]) -> str:
    """Replace the raw text of each key and scalar value, including quotes, by `change(path, raw)`.

    The path of a key ends with `":"`. The changed text is not checked; the caller must return valid YAML.
    """
    replacements: list[tuple[int, int, str]] = []

    def visit(at: Span, path: tuple[Key, ...]) -> None:
        for name, key in at.keys.items():
            replacements.append((key.begin, key.end, change((*path, name, ":"), text[key.begin:key.end])))
            visit(at.entries[name], (*path, name))
        for k, item in enumerate(at.items):
            visit(item, (*path, k))
        if not at.mapping and not at.items and at.end > at.begin and text[at.begin] not in "[{":
            replacements.append((at.begin, at.end, change(path, text[at.begin:at.end])))

    visit(spans(text), ())
    pieces, last = [], 0
    for begin, end, fresh in sorted(replacements):
        pieces += [text[last:begin], fresh]
        last = end
    return "".join([*pieces, text[last:]])


def tree(node: Node) -> Tree:
    """Convert a node to a tree of dictionaries, lists and strings, without places and style."""
    if isinstance(node, Mapping):
        return {key: tree(item) for key, item in node.items.items()}
    return node.text if isinstance(node, Scalar) else [tree(item) for item in node.items]


# -- trees -----------------------------------------------------------------------------------------------------------------
def _at(node: Tree, keys: Several[Key]) -> Tree | None:
    """The value at a path, or None if the path does not exist."""
    for key in keys:
        inner = node.get(str(key)) if isinstance(node, dict) else \
            node[key] if isinstance(node, list) and isinstance(key, int) and 0 <= key < len(node) else None
        if inner is None:
            return None
        node = inner
    return node


def _with(before: Tree, keys: Several[Key], value: Tree, after: str = "") -> Tree:
    if not keys:
        return value
    key, inner_keys = keys[0], keys[1:]
    if isinstance(before, list) and isinstance(key, int) and 0 <= key < len(before):
        return [_with(item, inner_keys, value, after) if k == key else item for k, item in enumerate(before)]
    if not isinstance(before, dict) or not isinstance(key, str):
        raise _refused(keys)
    inner = _with(before.get(key, {} if inner_keys else ""), inner_keys, value, after)
    if key not in before and after in before:
        order = list(before)
        k = order.index(after) + 1
        return {**{name: before[name] for name in order[:k]}, key: inner, **{name: before[name] for name in order[k:]}}
    return {**before, key: inner}


def _without(before: Tree, keys: Several[Key]) -> Tree:
    key, inner_keys = keys[0], keys[1:]
    if isinstance(before, dict):
        return {k: _without(v, inner_keys) if inner_keys and k == key else v for k, v in before.items()
                if inner_keys or k != key}
    assert isinstance(before, list)
    return [_without(v, inner_keys) if inner_keys and k == key else v for k, v in enumerate(before)
            if inner_keys or k != key]


def _checked(changed: str, wanted: Tree, keys: Several[Key]) -> str:
    try:
        if _same(tree(parse(changed).root), wanted):
            return changed
    except HeavebondError:
        pass
    raise _refused(keys)


def _same(one: Tree, two: Tree) -> bool:
    """True if two trees are equal, including the order of keys."""
    if isinstance(one, dict) and isinstance(two, dict):
        return list(one) == list(two) and all(_same(one[k], two[k]) for k in one)
    if isinstance(one, list) and isinstance(two, list):
        return len(one) == len(two) and all(map(_same, one, two))
    return one == two


# -- text ------------------------------------------------------------------------------------------------------------------
def _deepest(at: Span, keys: Several[Key]) -> tuple[Span, int]:
    """The place of the longest existing prefix of a path, and the length of this prefix."""
    for depth, key in enumerate(keys):
        if isinstance(key, str) and key in at.entries:
            at = at.entries[key]
        elif isinstance(key, int) and key < len(at.items):
            at = at.items[key]
        else:
            return at, depth
    return at, len(keys)


def _inserted(text: str, at: Span, keys: Several[str], value: Tree, after: str) -> str:
    """Insert an entry after the last entry of a mapping, or after the entry `after`."""
    last = at.entries[after].end if after in at.entries else \
        max((entry.end for entry in at.entries.values()), default=at.begin + 1)
    if at.flow:
        entry = f"{flow(keys[0])}: {_nested(keys[1:], value)}"
        return text[:last] + (", " if at.entries else "") + entry + text[last:]
    if not at.keys:
        raise _refused(keys)
    first = min(key.begin for key in at.keys.values())
    indent = " " * (first - (text.rfind("\n", 0, first) + 1))
    while text[last - 1] == "\n":  # after a block of text
        last -= 1
    line_end = _line_end(text, last)
    head = f"\n{indent}{flow(keys[0])}:"
    entry = f"{head}{_gap(text, at, keys[0])}{flow(value)}" if len(keys) == 1 else \
        f"{head}\n{indent}  {flow(keys[1])}: {_nested(keys[2:], value)}"
    return text[:line_end] + entry + text[line_end:]


def _gap(text: str, at: Span, key: str) -> str:
    """The space between a new key and its value; it aligns the value if most values of the mapping begin in one column."""
    places = [(at.keys[k].begin, at.entries[k].begin) for k in at.entries]
    widths = [value - begin for begin, value in places if "\n" not in text[begin:value]]
    usual = max(widths, key=widths.count, default=0)
    aligned = len(widths) > 1 and 2 * widths.count(usual) > len(widths)
    return " " * max(1, usual - len(flow(key)) - 1) if aligned else " "


def _line_end(text: str, at: int) -> int:
    end = text.find("\n", at)
    return len(text) if end < 0 else end


def _without_lines(text: str, begin: int, end: int) -> str:
    """Delete the lines of an entry of a block."""
    while end > begin and text[end - 1] == "\n":
        end -= 1
    start, stop = text.rfind("\n", 0, begin) + 1, _line_end(text, end)
    following = text[stop + 1:]
    return text[:start] + following if following or not start or stop < len(text) else text[:start - 1]


def _without_flow(text: str, places: Several[tuple[int, int]], k: int) -> str:
    """Delete an entry in braces and its comma."""
    begin, end = places[k]
    if k + 1 < len(places):
        comma = _comma(text, end)
        stop = comma + 1
        alone = not text[text.rfind("\n", 0, begin) + 1:begin].strip()
        while text[stop:stop + 1] == " " or (not k and not alone and text[stop:stop + 1] == "\n"):
            stop += 1  # the next entry moves to the bracket
        stop -= text[stop:stop + 1] == "#"  # a comment needs a blank before `#`
        changed = text[:begin] + text[end:comma] + text[stop:]
    else:
        if k:
            comma = _comma(text, places[k - 1][1])
            between = text[comma + 1:begin]
            separator = between.rstrip(" ") if between.strip() else ""
            begin, text = comma + len(separator), text[:comma] + separator + text[begin:]
            end -= len(between) - len(separator) + 1
        changed = text[:begin] + text[end:]
    start = changed.rfind("\n", 0, begin) + 1
    stop = _line_end(changed, begin)
    return changed[:start] + changed[stop + 1:] if start < begin and not changed[start:stop].strip() else changed


def _comma(text: str, at: int) -> int:
    """The position of the first comma at or after `at` that is not in a comment."""
    while text[at] != ",":
        at = _line_end(text, at) if text[at] == "#" else at + 1
    return at


def _nested(keys: Several[str], value: Tree) -> str:
    return f"{{{flow(keys[0])}: {_nested(keys[1:], value)}}}" if keys else flow(value)


def flow(value: Tree) -> str:
    """A value on one line: lists in brackets, mappings in braces, and a text as a plain scalar or in double quotes.

    A text is quoted if the plain scalar would be parsed differently, outside or inside braces.
    """
    if isinstance(value, dict):
        return "{" + ", ".join(f"{flow(k)}: {flow(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(flow, value)) + "]"
    if _WORDS.fullmatch(value):
        return value
    try:
        sample = tree(parse(f"c: {value}\na: {{b: {value}}}\nd: [{value}]").root)
        if sample == {"c": value, "a": {"b": value}, "d": [value]} and "\n" not in value:
            return value
    except HeavebondError:
        pass
    return json.dumps(value, ensure_ascii=False)


def _refused(keys: Several[Key]) -> UsageError:
    return UsageError([Problem("edit-refused", f"{'.'.join(map(str, keys))} cannot be changed so in this text", None,
                               "Change it in the text by hand.")])
