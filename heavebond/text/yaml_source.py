"""Parse YAML text to a tree in which every scalar is text with its place (the only importer of yaml).

`yaml.safe_load` guesses types (`1e6` is text, `on` is a boolean, `010` is 8), accepts duplicate keys silently and resolves
aliases. This parser does not guess types, and ambiguous text is an error.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import takewhile
from pathlib import Path
from typing import Protocol, Union

import yaml

from heavebond.core.errors import ModelError, Place, Problem, Problems
from heavebond.core.limits import ENTRIES, FILE_BYTES, NESTING

Node = Union["Scalar", "Mapping", "Sequence"]
FAST_LOADER: type[yaml.SafeLoader] | type[yaml.CSafeLoader] = yaml.CSafeLoader if yaml.__with_libyaml__ else yaml.SafeLoader


@dataclass(frozen=True)
class Scalar:
    """The text of a value in the file; `quoted` distinguishes '5' from 5, `block` is true for a `|` or `>` text."""

    text: str
    place: Place
    quoted: bool = False
    block: bool = False

    kind = "a value"

    def lines(self) -> list[Scalar]:
        """The lines of a block text, each with its place; a plain text is returned unchanged as one line."""
        if not self.block:
            return [self]
        return list(self._block_lines)

    _block_lines: tuple[Scalar, ...] = ()


# keys whose values are sentences, which often contain a comma
TEXTS = {"doc", "summary", "description", "restrictions", "source", "title", "placeholder"}
# keys written without a value, as in `{integer, min: 1}`
FLAGS = ("integer", "width", "instant", "interval")


@dataclass(frozen=True)
class Mapping:
    """A mapping in the order of the file; `keys[name]` is the scalar of the key."""

    items: dict[str, Node]
    keys: dict[str, Scalar]
    place: Place
    # the keys without a value
    bare: frozenset[str] = frozenset()

    kind = "a list of `key: value` entries"


@dataclass(frozen=True)
class Sequence:
    """A list, `[a, b]` or `- a`."""

    items: tuple[Node, ...]
    place: Place

    kind = "a list"


# characters that only an escape sequence can write: NUL, which ends file names in system calls, and surrogates
_NO_TEXT = re.compile("[\0\ud800-\udfff]")


@dataclass(frozen=True)
class Source:
    """A parsed file: its path, its name in messages, its top mapping and its text."""

    path: Path
    name: str
    root: Mapping
    text: str


def read_text(path: Path, name: str | None = None) -> str:
    """The text of a UTF-8 file; raises ModelError if it is missing, a folder, too large or not text."""
    name = name or str(path)
    try:
        with open(path, "rb") as file:
            raw = file.read(FILE_BYTES + 1)
    except OSError as error:
        raise unreadable(error, name) from None
    return decoded_text(raw, name)


def unreadable(error: OSError, name: str) -> ModelError:
    """The error for a file that cannot be read."""
    if isinstance(error, FileNotFoundError):
        return ModelError([Problem("file-missing", f"there is no file {name}", None,
                                   "Check the path; it counts from the current folder.")])
    if isinstance(error, IsADirectoryError):
        return ModelError([Problem("file-is-folder", f"{name} is a folder, not a file", None, "Give the YAML file in it.")])
    return ModelError([Problem("file-unreadable", f"{name} cannot be read: {error.strerror}", None,
                               "Check the file's permissions.")])


def decoded_text(raw: bytes, name: str) -> str:
    """The text of a file with line feeds at the ends of lines; raises ModelError if it is too large or not UTF-8."""
    if len(raw) > FILE_BYTES:
        raise ModelError([Problem("file-too-large", f"{name} is larger than {FILE_BYTES // 10**6} MB", None,
                                  "Is this a record? A diagram is a small text file.")])
    try:
        return raw.decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as error:
        # the problem of the invalid byte at `position`; its line is shown with `?` for invalid bytes if the file is a text
        position = error.start
        if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
            not_utf8 = Problem("not-text", f"{name} is UTF-16 text", None, "Save the file again with the encoding UTF-8.")
        elif b"\0" in raw:
            not_utf8 = Problem("not-text", f"{name} is not plain text", None,
                               "Give a YAML file; is this one of another program?")
        else:
            line = raw.count(b"\n", 0, position)
            text = raw.splitlines()[line].decode("ascii", errors="replace").replace("\ufffd", "?")
            column = position - (raw.rfind(b"\n", 0, position) + 1)
            not_utf8 = Problem("not-text", f"{name} is not UTF-8 text", Place(name, line + 1, column + 1, text),
                               "Save the file again with the encoding UTF-8.")
        raise ModelError([not_utf8]) from None


def read(path: Path, name: str | None = None, *, bundled: bool = False) -> Source:
    """Read a YAML file; raises ModelError with all syntax problems.

    `bundled` files are parsed by libyaml if PyYAML provides it. libyaml is eight times as fast, and a test shows that the
    result is the same for each bundled file. Other files are parsed by PyYAML, because libyaml accepts some invalid files
    (tabs between values).
    """
    name = name or short_path(path)
    return parse(read_text(path, name), path, name, trusted=bundled)


def parse(text: str, path: Path = Path("text"), name: str = "text", *, trusted: bool = False) -> Source:
    """Parse a YAML text; libyaml parses a `trusted` text, from a bundled file or written by heavebond (see `read`)."""
    builder = _Builder(text, name, FAST_LOADER if trusted else yaml.SafeLoader)
    root = builder.build()
    builder.problems.raise_as(ModelError)
    if root is None:
        raise ModelError([Problem("file-empty", f"{name} is empty", hint=EMPTY_HINT)])
    if not isinstance(root, Mapping):
        raise ModelError([Problem("not-a-mapping", f"{name} holds {root.kind}, not `key: value` entries",
                                  root.place, hint=EMPTY_HINT)])
    return Source(path, name, root, text)


# message of PyYAML, meaning, hint, and whether to show the place of the opening sign
SYNTAX = (
    ("while parsing a flow mapping", "the `{` is not closed by a `}`, or a comma between two entries is missing",
     "Inside `{}` entries are separated by commas: `{is: Spring, c: 1 kN/m}`.", True),
    ("while parsing a flow sequence", "the `[` is not closed by a `]`, or a comma between two entries is missing",
     "Inside `[]` entries are separated by commas: `[wall.a, spring.a]`.", True),
    ("while scanning a quoted scalar", "the quote that opens here is not closed",
     "End the text with the same quote; a quote inside the text is written in the other kind.", True),
    ("unknown escape character", "a `\\` in double quotes begins a special sign",
     "Put the text in single quotes.", False),
    ("mapping values are not allowed here", "a second `:` in one entry, or a line that is indented too far",
     "Put a text that holds `: ` in quotes; entries of one list begin in the same column.", False),
    ("could not find expected ':'", "a `: ` is missing behind this word",
     "An entry is written `key: value`, with a space behind the colon.", True),
    ("while parsing a block", "this line does not fit the indentation of the lines above",
     "Entries of one list begin in the same column.", False),
    ("that cannot start any token", "a value cannot begin with SIGN", "Put the value in quotes.", False),
)
EMPTY_HINT = "A diagram begins with `model: name`, a component with `component: Name`, " \
             "an experiment with `experiment: name`."


def short_path(path: Path) -> str:
    """The path for messages: relative to the current folder if it is inside this folder."""
    try:
        return str(path.resolve().relative_to(Path.cwd()))
    except ValueError:
        return str(path)


@dataclass(frozen=True)
class Span:
    """The characters [begin, end) of a node in the text, with the spans of its keys and values or of its items.

    The span of a block ends with its last value and excludes a comment after it. The span of a missing value is empty.
    """

    begin: int
    end: int
    mapping: bool = False
    flow: bool = False
    entries: dict[str, Span] = field(default_factory=dict)
    keys: dict[str, Span] = field(default_factory=dict)
    items: tuple[Span, ...] = ()


def spans(text: str) -> Span:
    """The spans of all nodes in a text that `parse` accepts."""
    outside = (yaml.StreamStartEvent, yaml.DocumentStartEvent)
    events = (e for e in yaml.parse(text, Loader=yaml.SafeLoader) if not isinstance(e, outside))
    return _span(next(events), events)


def _index(mark: _Mark | None) -> int:
    assert mark is not None  # the scanner sets all marks
    return mark.index


def _span(event: yaml.Event, events: Iterator[yaml.Event]) -> Span:
    begin, end = _index(event.start_mark), _index(event.end_mark)
    if not isinstance(event, yaml.CollectionStartEvent):
        return Span(begin, end)
    entries, keys, items, last = {}, {}, [], end
    while not isinstance(inner := next(events), yaml.CollectionEndEvent):
        value_span = _span(inner, events)
        if isinstance(event, yaml.MappingStartEvent):
            assert isinstance(inner, yaml.ScalarEvent)
            keys[inner.value], value_span = value_span, _span(next(events), events)
            entries[inner.value] = value_span
        else:
            items.append(value_span)
        last = value_span.end
    flow, mapping = bool(event.flow_style), isinstance(event, yaml.MappingStartEvent)
    return Span(begin, _index(inner.end_mark) if flow else last, mapping, flow, entries, keys, tuple(items))


class _Mark(Protocol):
    @property
    def line(self) -> int: ...
    @property
    def column(self) -> int: ...
    @property
    def index(self) -> int: ...


class _Builder:
    """Builds the tree from the events of PyYAML, which contain tags, anchors and marks without interpretation."""

    def __init__(self, text: str, name: str, loader: type[yaml.SafeLoader] | type[yaml.CSafeLoader]):
        self.name, self.loader = name, loader
        self.raw = text.splitlines()
        self.problems = Problems()
        self.text = text

    def place(self, mark: _Mark | None, length: int = 1) -> Place:
        number, column = (mark.line, mark.column) if mark is not None else (0, 0)
        while number >= len(self.raw) and number:  # an unclosed bracket or quote is reported at the end of the file
            number, column = number - 1, 0
        line = self.raw[number] if number < len(self.raw) else ""
        return Place(self.name, number + 1, column + 1, line, max(1, length))

    def build(self) -> Node | None:
        try:
            # the events of PyYAML up to the limits of nesting and length (the scanner takes n**2 for n nested brackets)
            events: list[yaml.Event] = []
            depth = 0
            for event in yaml.parse(self.text, Loader=self.loader):
                depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
                if depth > NESTING:
                    self.problems.add("too-deep", f"entries are nested more than {NESTING} deep",
                                      self.place(event.start_mark), hint="Remove the brackets that are too many.")
                    break
                if len(events) > ENTRIES:
                    self.problems.add("file-too-long", f"{self.name} has more than {ENTRIES} keys and values",
                                      self.place(event.start_mark),
                                      hint="Is this a record? Parts that repeat are written once, with `repeat`.")
                    break
                events.append(event)
        except yaml.MarkedYAMLError as error:
            self._syntax(error)
            return None
        except yaml.reader.ReaderError as error:
            position = int(error.position)
            line = self.text.count("\n", 0, position)
            self.problems.add("not-text", f"{self.name} is not plain text: it holds a character (code "
                              f"{ord(self.text[position])}) that no editor shows", Place(self.name, line + 1),
                              hint="Give a YAML file, which is plain text; is this one of another program?")
            return None
        if self.problems.found:
            return None
        documents = [e for e in events if isinstance(e, yaml.DocumentStartEvent)]
        if len(documents) > 1:
            self.problems.add("two-documents", "a second document begins here (`---`)",
                              self.place(documents[1].start_mark, 3),
                              hint="One file holds one document; put the second into a file of its own.")
            return None
        content = [e for e in events if not isinstance(
            e, (yaml.StreamStartEvent, yaml.StreamEndEvent, yaml.DocumentStartEvent, yaml.DocumentEndEvent))]
        if not content or (isinstance(content[0], yaml.ScalarEvent) and not content[0].value):
            return None
        self.events = iter(content)
        return self._node(next(self.events))

    def _syntax(self, error: yaml.MarkedYAMLError) -> None:
        mark = error.problem_mark or error.context_mark
        explanation = " ".join(part for part in (error.context, error.problem) if part)
        where = self.place(mark)
        if "\t" in where.text[:where.column]:
            tab = Place(where.file, where.line, where.text.index("\t") + 1, where.text)
            self.problems.add("tab", "the indentation contains a tab", tab,
                              hint="Put spaces in its place; YAML is indented with spaces.")
            return
        if "mapping values are not allowed here" in explanation and (bare := self._without_colon(where)):
            word = bare.text.split()[0]
            self.problems.add("not-yaml", f"a `:` is missing behind '{word}'", bare,
                              hint=f"Write `{word}: {bare.text.strip()[len(word):].strip()}`.")
            return
        if "while parsing a flow" in explanation and (bracketed := self._bracketed(where)) is not None:
            self.problems.add("not-yaml", "a text that holds a bracket must stand in quotes here", where,
                              hint=f'Write "{bracketed}".')
            return
        if "block mapping" in explanation and "found '-'" in explanation \
            and (entry := where.text.strip().removeprefix("-").strip()):
            self.problems.add("not-yaml", "this line begins with a hyphen, the entries above do not", where,
                              hint=f"Remove the hyphen: `{entry}`. Only the entries of a list begin with one.")
            return
        for words, message, hint, opened in SYNTAX:
            if words in explanation:
                place = self.place(error.context_mark) if opened and error.context_mark else where
                sign = where.text[where.column - 1:where.column]
                notes = [f"noticed in line {where.line}"] if place.line != where.line else []
                self.problems.add("not-yaml", message.replace("SIGN", sign), place, hint=hint, notes=notes)
                return
        self.problems.add("not-yaml", f"this is not YAML: {explanation}", where,
                          hint="A value that holds `: `, `#`, `,`, "
                          "brackets or begins with a special sign is put in quotes.")

    def _bracketed(self, where: Place) -> str | None:
        """The unquoted text of an entry that ends for YAML at a bracket, as in `{column: Force [N], unit: N}`."""
        before, after = where.text[:where.column - 1], where.text[where.column - 1:]
        head = re.search(r"[:,{[]\s*([^\s:,{}\[\]\"'][^:,{}\[\]\"']*)$", before)
        tail = re.match(r"\[[^\[\]{},]*\][^\[\]{},]*", after)
        return (head.group(1) + tail.group()).strip() if head and tail else None

    def _without_colon(self, where: Place) -> Place | None:
        """The place of a key without colon in this line or in the line before: `load {is: Mass}`, `model rig`."""
        number = where.line - 1
        before = next((k for k in range(number - 1, -1, -1) if self.raw[k].strip()), None)
        bare = r"\s*[A-Za-z_]\w* +[^\s:#][^:#]*"
        for k, pattern in ((number, r"\s*[A-Za-z_]\w* +[\[{].*"), (before, bare)):
            if k is not None and re.fullmatch(pattern, self.raw[k]):
                column = len(self.raw[k]) - len(self.raw[k].lstrip())
                return Place(where.file, k + 1, column + 1, self.raw[k], len(self.raw[k].split()[0]))
        return None

    def _node(self, event: yaml.Event) -> Node:
        self._refuse_hidden(event)
        if isinstance(event, yaml.MappingStartEvent):
            return self._mapping(event)
        if isinstance(event, yaml.SequenceStartEvent):
            items = []
            while not isinstance(inner := next(self.events), yaml.SequenceEndEvent):
                items.append(self._node(inner))
            # report a formula in a list that is split at the comma between its arguments: `[max(a, b)]`
            opened: list[Scalar] = []
            for item in items:
                opened = [*opened, item] if isinstance(item, Scalar) and not item.quoted else []
                text = ", ".join(part.text for part in opened)
                if text.count("(") <= text.count(")"):
                    if len(opened) > 1:
                        self.problems.add("formula-cut", f"the comma in '{text}' ends the value", opened[0].place,
                                          hint=f'Put the formula in quotes: "{text}".')
                    opened = []
            return Sequence(tuple(items), self.place(event.start_mark))
        if isinstance(event, yaml.ScalarEvent):
            start, end = event.start_mark, event.end_mark
            if event.style == '"' and (odd := _NO_TEXT.search(event.value)):
                self.problems.add("not-text", f"the character with the code {ord(odd.group())} cannot be used in a text",
                                  self.place(start, 2 + len(event.value)),
                                  hint="Remove the escape sequence that stands for it.")
            if event.style in ("|", ">"):
                return self._block(event)
            quoted = event.style in ("'", '"')
            if start is None or end is None or end.line == start.line:
                length = end.column - start.column if start and end else 1
                return Scalar(event.value, self.place(start, length), quoted=quoted)
            rows = self._rows(start.line, end.line + 1, start.column)
            where = self._spread(self.place(start), event.value, rows, 1 if quoted else 0)
            return Scalar(event.value, where, quoted=quoted)
        return Scalar("*", self.place(event.start_mark))  # an alias, for which an error is already reported

    def _refuse_hidden(self, event: yaml.Event) -> None:
        """Report anchors, aliases and tags: they give a value a second meaning that a reader of the file does not see."""
        mark = event.start_mark
        anchor = getattr(event, "anchor", None)
        if isinstance(event, yaml.AliasEvent):
            self.problems.add("yaml-alias", f"`*{anchor}` refers to another place of the file",
                              self.place(mark, 1 + len(anchor or "")),
                              hint="Write the value out, or put the text in quotes.")
        elif anchor:
            self.problems.add("yaml-anchor", f"`&{anchor}` is a YAML anchor", self.place(mark, 1 + len(anchor)),
                              hint="Remove it, or put the text in quotes.")
        if getattr(event, "tag", None):
            where = self.place(mark)
            begin = max(0, where.text.find("!", where.column - 1))
            written = where.text[begin:].split(" ")[0]
            self.problems.add("yaml-tag", f"`{written}` is a YAML tag; heavebond follows none",
                              Place(where.file, where.line, begin + 1, where.text, len(written)),
                              hint="Remove it, or put the text in quotes.")

    def _mapping(self, event: yaml.MappingStartEvent) -> Mapping:
        items: dict[str, Node] = {}
        keys: dict[str, Scalar] = {}
        bare: list[str] = []
        while not isinstance(inner := next(self.events), yaml.MappingEndEvent):
            key = self._node(inner)
            value = self._node(next(self.events))
            if not isinstance(key, Scalar):
                self.problems.add("key-not-text", "a key must be a plain word", key.place,
                                  hint="Put a value that begins with `[` or `{` in quotes.")
                continue
            if key.text in items:
                first = keys[key.text].place.line
                self.problems.add("duplicate-key", f"'{key.text}' is written twice, first in line {first}", key.place,
                                  hint="Keep one of the two, or join them.")
                continue
            if isinstance(value, Scalar) and not value.text and not value.quoted and not value.block:
                bare.append(key.text)
            items[key.text], keys[key.text] = value, key
        self._refuse_bare(items, keys, bare)
        return Mapping(items, keys, self.place(event.start_mark), frozenset(bare))

    def _refuse_bare(self, items: dict[str, Node], keys: dict[str, Scalar], bare: list[str]) -> None:
        """Report keys without value; the usual cause is a comma in a value or a missing space after `:`."""
        order = list(keys)
        of_text: set[str] = set()
        for name in bare:
            if name in FLAGS or name in of_text:
                continue
            key = keys[name]
            at = order.index(name)
            before = items[order[at - 1]] if at else None
            cut = before if isinstance(before, Scalar) and not before.quoted and before.text and \
                before.place.line == key.place.line else None
            if cut and cut.text[-1].isdigit() and name[:1].isdigit():
                both = cut.place.moved(0, key.place.column + len(name) - cut.place.column)
                self.problems.add("decimal-comma", f"'{cut.text},{name}' has a decimal comma", both,
                                  hint=f"Write '{cut.text}.{name}'.")
            elif cut and order[at - 1] in TEXTS:
                pieces = [name, *takewhile(lambda next_name: next_name in bare and next_name not in FLAGS, order[at + 1:])]
                of_text |= set(pieces)
                text = ", ".join([cut.text, *pieces])
                self.problems.add("key-without-value", f"the comma in '{text}' ends the text", cut.place,
                                  hint=f'Put the text in quotes: `{order[at - 1]}: "{text}"`.')
            elif cut and cut.text.count("(") > cut.text.count(")"):
                self.problems.add("key-without-value", f"the comma in '{cut.text}, {name}' ends the value", cut.place,
                                  hint=f'Put the formula in quotes: "{cut.text}, {name}".')
            elif re.match(r"\w+:\S", name):
                self.problems.add("key-without-value", f"a space is missing behind the colon of '{name}'", key.place,
                                  hint=f"Write `{name.replace(':', ': ', 1)}`.")
            elif spaced := re.fullmatch(r"(\w+)\s+(\S.*)", name):
                self.problems.add("key-without-value", f"a colon is missing behind '{spaced.group(1)}'", key.place,
                                  hint=f"Write `{spaced.group(1)}: {spaced.group(2)}`.")
            else:
                self.problems.add("key-without-value", f"'{name}' has no value", key.place,
                                  hint=f"Write `{name}: ...` with a value, or remove it.")

    def _block(self, event: yaml.ScalarEvent) -> Scalar:
        start, end = event.start_mark, event.end_mark
        first, last = (start.line, end.line) if start and end else (0, 0)
        stop = last if end is not None and end.column == 0 else last + 1
        rows = self._rows(first + 1, min(stop, len(self.raw)))
        lines = tuple(Scalar(row.text[row.column - 1:].rstrip(), row) for row in rows)
        return Scalar(event.value, self._spread(self.place(start), event.value, rows), block=True, _block_lines=lines)

    def _rows(self, first: int, stop: int, column: int = 0) -> list[Place]:
        """The places of the nonempty lines first .. stop - 1 (from 0), each from its first character."""
        rows = []
        for number in range(first, min(stop, len(self.raw))):
            raw = self.raw[number]
            begin = column if number == first and column else len(raw) - len(raw.lstrip())
            if raw[begin:].strip():
                rows.append(Place(self.name, number + 1, begin + 1, raw, len(raw[begin:].rstrip())))
        return rows

    @staticmethod
    def _spread(place: Place, value: str, rows: list[Place], quote: int = 0) -> Place:
        """The place of a text that YAML joined from several lines, with the position of the start of each line in it."""
        continued, at = [], 0
        for row in rows:
            inner = row.text[row.column - 1:].strip().strip("'\"")
            position = value.find(inner, at) if inner else -1
            if position > 0:
                continued.append((position + quote, row))
            at = max(at, position + len(inner))
        first = rows[0] if rows else place
        return Place(first.file, first.line, first.column, first.text, first.length, tuple(continued))
