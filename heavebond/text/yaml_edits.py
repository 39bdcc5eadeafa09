"""Changes of a YAML text that leave everything else in it as it is, to the byte: comments, order, spaces, quotes."""

from __future__ import annotations

import json
from collections.abc import Sequence as Several

from heavebond.core.errors import HeavebondError, Problem, UsageError
from heavebond.text.yaml_source import Mapping, Node, Scalar, Span, parse, spans

Tree = dict[str, "Tree"] | list["Tree"] | str


def set_entry(text: str, keys: Several[str], value: str) -> str:
    """The text with a value at a path of keys, `("components", "damper", "d")`. A value that is there is replaced where it
    stands; a new entry follows the last one of its mapping, in the same style; mappings that are missing are made.

    ModelError for a text that cannot be read; UsageError where a key on the way holds no mapping, and where reading the
    changed text would not give the tree with this one value changed.
    """
    wanted = _with(tree(parse(text).root), keys, value)
    at, depth = spans(text), 0
    while depth < len(keys) - 1 and keys[depth] in at.entries:
        at, depth = at.entries[keys[depth]], depth + 1
    rest = keys[depth:]
    if rest[0] in at.entries:
        place = at.entries[rest[0]]
        blank = " " if text[place.begin - 1:place.begin] == ":" else ""
        changed = text[:place.begin] + blank + _scalar(value) + text[place.end:]
    else:
        changed = _inserted(text, at, rest, value)
    try:
        if tree(parse(changed).root) == wanted:
            return changed
    except HeavebondError:
        pass
    raise _refused(keys)


def tree(node: Node) -> Tree:
    """What a text says, without places and style."""
    if isinstance(node, Mapping):
        return {key: tree(item) for key, item in node.items.items()}
    return node.text if isinstance(node, Scalar) else [tree(item) for item in node.items]


def _with(before: Tree, keys: Several[str], value: str) -> Tree:
    if not keys:
        return value
    if not isinstance(before, dict):
        raise _refused(keys)
    inner = before.get(keys[0], {})
    return {**before, keys[0]: _with(inner if len(keys) > 1 else "", keys[1:], value)}


def _inserted(text: str, at: Span, keys: Several[str], value: str) -> str:
    """A new entry behind the last one of a mapping."""
    last = max((entry.end for entry in at.entries.values()), default=at.begin + 1)
    if at.flow:
        entry = f"{_scalar(keys[0])}: {_nested(keys[1:], value)}"
        return text[:last] + (", " if at.entries else "") + entry + text[last:]
    first = min(at.keys.values())
    indent = " " * (first - (text.rfind("\n", 0, first) + 1))
    while text[last - 1] == "\n":  # behind a block of text
        last -= 1
    line_end = text.find("\n", last)
    line_end = len(text) if line_end < 0 else line_end
    head = f"\n{indent}{_scalar(keys[0])}:"
    entry = f"{head} {_scalar(value)}" if len(keys) == 1 else \
        f"{head}\n{indent}  {_scalar(keys[1])}: {_nested(keys[2:], value)}"
    return text[:line_end] + entry + text[line_end:]


def _nested(keys: Several[str], value: str) -> str:
    return f"{{{_scalar(keys[0])}: {_nested(keys[1:], value)}}}" if keys else _scalar(value)


def _scalar(text: str) -> str:
    """A text as a plain scalar where that is read as the same, inside braces too, else in double quotes."""
    try:
        if tree(parse(f"c: {text}\na: {{b: {text}}}").root) == {"c": text, "a": {"b": text}} and "\n" not in text:
            return text
    except HeavebondError:
        pass
    return json.dumps(text, ensure_ascii=False)


def _refused(keys: Several[str]) -> UsageError:
    return UsageError([Problem("edit-refused", f"{'.'.join(keys)} cannot be set in this text", None,
                               "Write it into the text by hand.")])
