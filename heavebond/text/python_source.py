"""Trees of values that are written in Python instead of YAML, with the places of the Python lines, and their YAML text."""

from __future__ import annotations

import json
import linecache
import re
import sys
from collections.abc import Iterator
from collections.abc import Mapping as Dictionary
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from types import FrameType
from typing import Any

from heavebond.core.errors import Place, Problem, UsageError
from heavebond.text.yaml_edits import flow
from heavebond.text.yaml_source import FLAGS, Mapping, Node, Scalar, Sequence, short_path

PACKAGE = str(Path(__file__).parents[1])
WIDTH = 100  # a mapping that is longer in braces is written one entry per line
BLOCK = ("equations",)  # keys of texts of several lines


@dataclass(frozen=True)
class PythonCall:
    """A call in a Python file or notebook cell: the file, the lines of its source text that the call covers, and all."""

    file: str
    line: int
    lines: tuple[str, ...]
    whole: tuple[str, ...] = ()

    def place(self, text: str, written: str, key: str = "") -> Place:
        """The place of a text: in the call, as the value of `key`, as a string or as a keyword; else the value of `key` that
        is next before the call in the file; else the first line of the call. Without the source text (interactive input)
        `written` is shown."""
        inside = [(self.line + k, line) for k, line in enumerate(self.lines) if text and text in line]
        earlier = range(min(self.line, len(self.whole)), 0, -1) if key and text and not inside else ()
        before = [(k, self.whole[k - 1]) for k in earlier if text in self.whole[k - 1]]
        body = re.escape(text) if inside or before else ""
        entry = rf"\b{re.escape(key)}[\"']?\s*[:=]\s*[\"']?(?P<text>{body})" if key else ""
        string, keyword = rf"(?<=[\"'])(?P<text>{body})(?=[\"'])", rf"\b(?P<text>{body})\b(?=\s*=)"
        patterns = (string, keyword, rf"(?<![\w.])(?P<text>{body})(?![\w.])", rf"(?P<text>{body})") if inside else ()
        for pattern in filter(None, (entry, *patterns)):
            for number, line in inside or before:
                if match := re.search(pattern, line):
                    return Place(self.file, number, match.start("text") + 1, line, len(text))
        first = self.lines[0] if self.lines else written
        return Place(self.file, self.line, len(first) - len(first.lstrip()) + 1, first, len(first.strip()))


def calling_place() -> PythonCall:
    """The call in the program of the user that led here: the innermost one outside of heavebond."""
    frame: FrameType | None = sys._getframe(1)
    while frame is not None and frame.f_code.co_filename.startswith(PACKAGE):
        frame = frame.f_back
    if frame is None:
        return PythonCall("python", 1, ())
    code = frame.f_code
    first, last, _, _ = next(islice(code.co_positions(), frame.f_lasti // 2, None))
    first, last = first or frame.f_lineno, last or frame.f_lineno
    whole = tuple(line.rstrip("\n") for line in linecache.getlines(code.co_filename, frame.f_globals))
    name = code.co_filename
    cell = re.search(r"ipykernel_[0-9]+[\\/][0-9]+\.py$|^<ipython-input", name) is not None
    return PythonCall("notebook cell" if cell else name if name.startswith("<") else short_path(Path(name)), first,
                      whole[first - 1:last], whole)


def node_of(value: Any, subject: str, call: PythonCall) -> Node:
    """A Python value as a node: texts, numbers, quantities with `magnitude` and `units` (pint), lists, arrays and
    dictionaries; `subject` names the value in messages. UsageError for a value of another type."""
    if isinstance(value, Dictionary):
        entries = {str(key): item for key, item in value.items()}
        bare = frozenset(key for key, item in entries.items() if item is None or (key in FLAGS and item is True))
        items = {key: Scalar("", call.place(key, subject)) if key in bare else
                 block_text(item, call) if key in BLOCK and isinstance(item, (list, tuple)) else
                 node_of(item, f"{subject}.{key}", call) for key, item in entries.items()}
        keys = {key: Scalar(key, call.place(key, f"{subject}: {key}")) for key in items}
        return Mapping(items, keys, call.place(subject.rpartition(".")[2], subject), bare)
    if hasattr(value, "tolist") and not hasattr(value, "magnitude"):  # arrays and scalars of NumPy
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return Sequence(tuple(node_of(item, subject, call) for item in value),
                        call.place(subject.rpartition(".")[2], subject))
    # a value as it is written in YAML: 2.5e-3, true, `42.0 kN/m` of a quantity of pint
    if isinstance(value, bool):
        text = str(value).lower()
    elif isinstance(value, (str, int, float, Path)):
        text = value if isinstance(value, str) else repr(value) if isinstance(value, (int, float)) else value.as_posix()
    elif hasattr(value, "magnitude") and hasattr(value, "units"):
        unit = f"{value.units:~C}"
        text = f"{float(value.magnitude)!r} {unit}".rstrip()
    else:
        raise UsageError([Problem("python-value", f"{subject} is a {type(value).__name__}, which a diagram cannot hold",
                                  calling_place().place(subject.rpartition(".")[2], subject),
                                  "Write a text with a unit, such as \"250 kg\", a number, a list or a dictionary.")])
    if "\n" not in text:
        return Scalar(text, call.place(text, f"{subject}: {text}", subject.rpartition(".")[2]))
    rows = tuple(Scalar(line.strip(), call.place(line.strip(), line.strip())) for line in text.splitlines() if line.strip())
    return Scalar("\n".join(row.text for row in rows) + "\n", rows[0].place, block=True, _block_lines=rows)


def block_text(lines: list[str] | tuple[str, ...], call: PythonCall) -> Scalar:
    """Lines of equations as one block, each with its place."""
    rows = tuple(Scalar(line.strip(), call.place(line.strip(), line.strip())) for line in lines if line.strip())
    place = rows[0].place if rows else call.place("equations", "equations")
    return Scalar("".join(f"{row.text}\n" for row in rows), place, block=True, _block_lines=rows)


def plain(node: Node, key: str = "") -> Any:
    """A node as dictionaries, lists and texts; None for a key without a value. A sentence of several lines becomes one
    line, equations keep their lines."""
    if isinstance(node, Mapping):
        return {name: None if name in node.bare else plain(item, name) for name, item in node.items.items()}
    if isinstance(node, Sequence):
        return [plain(item, key) for item in node.items]
    return " ".join(node.text.split()) if node.block and key not in BLOCK else node.text


# -- YAML --------------------------------------------------------------------------------------------------------------
def yaml_text(root: Mapping) -> str:
    """The YAML text of a tree, which `yaml_source.parse` reads back as an equal tree. Entries of a section are written one
    per line, their values in braces; blocks of equations keep their lines."""
    return "\n".join(line for key, item in root.items.items() for line in _entry(key, item, 0, key in root.bare)) + "\n"


def _entry(key: str, node: Node, depth: int, bare: bool) -> Iterator[str]:
    indent, head = "  " * depth, flow(key)
    if bare:
        yield f"{indent}{head}:"
    elif isinstance(node, Scalar) and key in BLOCK and "\n" in node.text:
        yield f"{indent}{head}: |"
        yield from (f"{indent}  {line}" for line in node.text.splitlines())
    elif isinstance(node, Mapping) and node.items and (depth == 0 or len(indent + _inline(node)) > WIDTH):
        yield f"{indent}{head}:"
        for name, item in node.items.items():
            yield from _entry(name, item, depth + 1, name in node.bare)
    else:
        yield f"{indent}{head}: {_inline(node)}"


def _inline(node: Node) -> str:
    if isinstance(node, Mapping):
        return "{" + ", ".join(flow(key) if key in node.bare else f"{flow(key)}: {_inline(item)}"
                               for key, item in node.items.items()) + "}"
    if isinstance(node, Sequence):
        return "[" + ", ".join(map(_inline, node.items)) + "]"
    text = plain(node)
    return json.dumps(text, ensure_ascii=False) if "\n" in text else flow(text)
