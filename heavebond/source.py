"""YAML text to a tree in which every scalar is text with its place (the only importer of yaml).

`yaml.safe_load` guesses types (`1e6` is text, `on` is a boolean, `010` is 8), lets a duplicate key win silently and
follows aliases; here nothing is guessed, and what could be misread is an error.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Union

import yaml

from heavebond.errors import ModelError, Place, Problem, Problems

Node = Union["Scalar", "Mapping", "Sequence"]
# A file beyond this is not a diagram; YAML is read with marks, which costs some 100 times the text in memory.
LARGEST_FILE = 20_000_000
DEEPEST_NESTING = 60


@dataclass(frozen=True)
class Scalar:
    """A piece of text as it stands in the file; `quoted` tells '5' from 5, `block` is a `|` or `>` text."""

    text: str
    place: Place
    quoted: bool = False
    block: bool = False

    kind = "a value"

    def lines(self) -> list[Scalar]:
        """The lines of a block text, each with its own place (a plain text is its own single line)."""
        if not self.block:
            return [self]
        return list(self._block_lines)

    _block_lines: tuple[Scalar, ...] = ()


@dataclass(frozen=True)
class Mapping:
    """Keys in the order of the file; `keys[name]` is the key's own scalar."""

    items: dict[str, Node]
    keys: dict[str, Scalar]
    place: Place
    # keys written without a value, as `integer` in `{integer, min: 1}`
    bare: frozenset[str] = frozenset()

    kind = "a list of `key: value` entries"


@dataclass(frozen=True)
class Sequence:
    """A list, `[a, b]` or `- a`."""

    items: tuple[Node, ...]
    place: Place

    kind = "a list"


@dataclass(frozen=True)
class Source:
    """One file that was read: its path, its text lines and its top mapping."""

    path: Path
    name: str
    root: Mapping
    text: str


def read_text(path: Path, name: str | None = None) -> str:
    """The text of a UTF-8 file; ModelError where it is absent, a folder, too large or not text."""
    name = name or str(path)
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise ModelError([Problem("file-too-large", f"{name} is larger than {LARGEST_FILE // 10**6} MB")])
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise ModelError([Problem("file-missing", f"there is no file {name}")]) from None
    except IsADirectoryError:
        raise ModelError([Problem("file-missing", f"{name} is a folder, not a file")]) from None
    except UnicodeDecodeError as error:
        raise ModelError([Problem("not-text", f"{name} is not UTF-8 text (byte {error.start})",
                                  hint="Save the file as UTF-8.")]) from None
    except OSError as error:
        raise ModelError([Problem("file-unreadable", f"{name} cannot be read: {error.strerror}")]) from None


def read(path: Path, name: str | None = None) -> Source:
    """Read a YAML file; raises ModelError with every problem of form that it has."""
    name = name or _short(path)
    return parse(read_text(path, name), path, name)


def parse(text: str, path: Path = Path("text"), name: str = "text") -> Source:
    """Read YAML from a text; see `read`."""
    builder = _Builder(text, name)
    root = builder.build()
    builder.problems.raise_as(ModelError)
    if root is None:
        raise ModelError([Problem("file-empty", f"{name} is empty", hint=EMPTY_HINT)])
    if not isinstance(root, Mapping):
        raise ModelError([Problem("not-a-mapping", f"{name} holds {root.kind}, not `key: value` entries",
                                  root.place, hint=EMPTY_HINT)])
    return Source(path, name, root, text)


EMPTY_HINT = "A diagram begins with `model: name`, a component with `component: Name`, " \
             "an experiment with `experiment: name`."


def _short(path: Path) -> str:
    """The path as a user would write it: relative to the current folder where it lies below."""
    try:
        return str(path.resolve().relative_to(Path.cwd()))
    except ValueError:
        return str(path)


class _Builder:
    """Builds the tree from PyYAML's events, which carry tags, anchors and marks before any meaning is given."""

    def __init__(self, text: str, name: str):
        self.name = name
        self.raw = text.splitlines()
        self.problems = Problems()
        self.text = text

    def place(self, mark: yaml.Mark, length: int = 1) -> Place:
        line = self.raw[mark.line] if mark.line < len(self.raw) else ""
        return Place(self.name, mark.line + 1, mark.column + 1, line, max(1, length))

    def build(self) -> Node | None:
        try:
            events = list(yaml.parse(self.text, Loader=yaml.SafeLoader))
        except yaml.MarkedYAMLError as error:
            self._syntax(error)
            return None
        except yaml.reader.ReaderError as error:
            self.problems.add("not-yaml", f"{self.name}: a character that YAML does not allow "
                              f"(number {error.position + 1} of the file)")
            return None
        documents = [e for e in events if isinstance(e, yaml.DocumentStartEvent)]
        if len(documents) > 1:
            self.problems.add("two-documents", "a second document begins here (`---`)",
                              self.place(documents[1].start_mark, 3), hint="One file holds one document.")
            return None
        content = [e for e in events if not isinstance(
            e, (yaml.StreamStartEvent, yaml.StreamEndEvent, yaml.DocumentStartEvent, yaml.DocumentEndEvent))]
        if not content or (isinstance(content[0], yaml.ScalarEvent) and not content[0].value):
            return None
        self.events = iter(content)
        return self._node(next(self.events), 0)

    def _syntax(self, error: yaml.MarkedYAMLError) -> None:
        mark = error.problem_mark or error.context_mark
        where = self.place(mark) if mark else None
        what = " ".join(part for part in (error.context, error.problem) if part)
        hint = "A value that holds `: `, `#`, `,`, brackets or begins with a special sign is put in quotes."
        if mark and "\t" in (where.text if where else ""):
            hint = "YAML is indented with spaces; this line has a tab."
        self.problems.add("not-yaml", f"this is not YAML: {what}", where, hint=hint)

    def _node(self, event: yaml.Event, depth: int) -> Node:
        self._refuse_hidden(event)
        if depth > DEEPEST_NESTING:
            raise ModelError([Problem("too-deep", "entries are nested too deeply", self.place(event.start_mark))])
        if isinstance(event, yaml.MappingStartEvent):
            return self._mapping(event, depth)
        if isinstance(event, yaml.SequenceStartEvent):
            items = []
            while not isinstance(inner := next(self.events), yaml.SequenceEndEvent):
                items.append(self._node(inner, depth + 1))
            return Sequence(tuple(items), self.place(event.start_mark))
        if isinstance(event, yaml.ScalarEvent):
            return self._scalar(event)
        return Scalar("", self.place(event.start_mark))

    def _refuse_hidden(self, event: yaml.Event) -> None:
        """Anchors, aliases and tags give a value a second meaning that the reader of the file does not see."""
        mark = event.start_mark
        if isinstance(event, yaml.AliasEvent):
            self.problems.add("yaml-alias", f"`*{event.anchor}` refers to another place of the file",
                              self.place(mark, 1 + len(event.anchor)),
                              hint="Write the value out, or put the text in quotes.")
        elif getattr(event, "anchor", None):
            self.problems.add("yaml-anchor", f"`&{event.anchor}` is a YAML anchor",
                              self.place(mark, 1 + len(event.anchor)),
                              hint="Remove it, or put the text in quotes.")
        tag = getattr(event, "tag", None)
        if tag:
            self.problems.add("yaml-tag", f"`{tag}` is a YAML tag, which heavebond never follows",
                              self.place(mark, len(tag)), hint="Remove it, or put the text in quotes.")

    def _mapping(self, event: yaml.MappingStartEvent, depth: int) -> Mapping:
        items: dict[str, Node] = {}
        keys: dict[str, Scalar] = {}
        bare = set()
        while not isinstance(inner := next(self.events), yaml.MappingEndEvent):
            key = self._node(inner, depth + 1)
            value = self._node(next(self.events), depth + 1)
            if not isinstance(key, Scalar):
                self.problems.add("key-not-text", "a key must be a plain word", key.place,
                                  hint="Put a value that begins with `[` or `{` in quotes.")
                continue
            if isinstance(value, Scalar) and not value.text and not value.quoted and not value.block:
                bare.add(key.text)
            if key.text in items:
                first = keys[key.text].place.line
                self.problems.add("duplicate-key", f"'{key.text}' stands twice, first in line {first}", key.place,
                                  hint="Keep one of the two; YAML itself would silently take the last.")
                continue
            items[key.text], keys[key.text] = value, key
        self._refuse_bare(keys, bare)
        return Mapping(items, keys, self.place(event.start_mark), frozenset(bare))

    def _refuse_bare(self, keys: dict[str, Scalar], bare: set[str]) -> None:
        for name in bare - {"integer"}:
            key = keys[name]
            broken_formula = any(sign in key.text for sign in "()=*+/") or any(
                k.startswith("=") and "(" in k for k in keys)
            hint = "Quote this formula: inside `{}` a comma ends the value." if broken_formula else \
                f"Write `{name}: value`, or remove the line."
            self.problems.add("key-without-value", f"'{name}' has no value", key.place, hint=hint)

    def _scalar(self, event: yaml.ScalarEvent) -> Scalar:
        mark = event.start_mark
        if event.style in ("|", ">"):
            return self._block(event)
        length = event.end_mark.column - mark.column if event.end_mark.line == mark.line else 1
        return Scalar(event.value, self.place(mark, length), quoted=event.style in ("'", '"'))

    def _block(self, event: yaml.ScalarEvent) -> Scalar:
        mark = event.start_mark
        lines = []
        for number in range(mark.line + 1, min(event.end_mark.line + 1, len(self.raw))):
            raw = self.raw[number]
            inner = raw.strip()
            if not inner or (number == event.end_mark.line and event.end_mark.column == 0):
                continue
            start = len(raw) - len(raw.lstrip()) + 1
            lines.append(Scalar(inner, Place(self.name, number + 1, start, raw, len(inner))))
        return Scalar(event.value, self.place(mark), block=True, _block_lines=tuple(lines))
