"""Former keys of the language: read as the present ones, with a warning, and rewritten by `heavebond check --fix`."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from heavebond.core.errors import Place, Problems
from heavebond.core.renamed import RenamedKey, meet
from heavebond.core.writable import new_file
from heavebond.text.yaml_source import Mapping, Node, Scalar, Sequence, read

# the former name and the present one, by the mapping in which the key stands; read for one release after the change
RENAMED = {"input": {"between": "interpolation"},
           "effect": {"says": "description", "try": "search_range"},
           "parameter": {"try": "search_range"},
           "study": {"beside": "compare_with"}}


def present(node: Mapping, kind: str, problems: Problems) -> Mapping:
    """The mapping with its keys under their present names; warns of former ones. A problem where a key has both names."""
    former = {old: new for old, new in RENAMED[kind].items() if old in node.items}
    for old, new in former.items():
        place = node.keys[old].place
        if new in node.items:
            problems.add("key-renamed", f"'{old}' is the former name of '{new}', which is there too", place,
                         hint=f"Remove `{old}:`.")
            continue
        meet(RenamedKey(old, new, place))
    if not former:
        return node
    keys = {former.get(name, name): replace(key, text=former.get(name, name)) for name, key in node.keys.items()}
    return replace(node, items={former.get(name, name): item for name, item in node.items.items()}, keys=keys)


def rewrite(keys: Iterable[RenamedKey]) -> dict[Path, int]:
    """Write every file of these keys with their present names; all else stays as it is, to the byte. The number of keys that
    were changed in each file; RuntimeError, before anything is written, where a file would then be read differently."""
    files: dict[str, dict[tuple[int, int], RenamedKey]] = {}
    for key in keys:
        files.setdefault(key.place.file, {})[key.place.line, key.place.column] = key
    done = {}
    for name, found in files.items():
        path = Path(name)
        raw = path.read_bytes()
        mark = b"\xef\xbb\xbf" if raw.startswith(b"\xef\xbb\xbf") else b""
        # keepends: the line ends of the file are kept; YAML's own line breaks only, so that lines are counted as it counts
        lines = re.split(r"(?<=\n)|(?<=\r)(?!\n)", raw.removeprefix(mark).decode("utf-8"))
        for (line, column), key in sorted(found.items(), reverse=True):
            text, begin = lines[line - 1], column - 1
            begin += text[begin] in "'\""
            if not text.startswith(key.old, begin):
                raise RuntimeError(f"{name}:{line}: '{key.old}' is not there any more")
            lines[line - 1] = text[:begin] + key.new + text[begin + len(key.old):]
        before = read(path)
        with new_file(path) as fresh:
            fresh.write_bytes(mark + "".join(lines).encode("utf-8"))
            if _plain(read(fresh).root) != _plain(before.root, {k.place: k.new for k in found.values()}):
                raise RuntimeError(f"{name} would be read differently")
        done[path] = len(found)
    return done


def _plain(node: Node, renamed: dict[Place, str] | None = None) -> object:
    """The content of a tree without its places."""
    if isinstance(node, Mapping):
        return [((renamed or {}).get(node.keys[name].place, name), _plain(item, renamed))
                for name, item in node.items.items()]
    if isinstance(node, Sequence):
        return [_plain(item, renamed) for item in node.items]
    assert isinstance(node, Scalar)
    return node.text, node.quoted, node.block
