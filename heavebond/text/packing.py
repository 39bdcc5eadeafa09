"""Frozen values as bytes, and back: dataclasses of a closed list, plain containers, paths, fractions, SX expressions.

Bytes hold numbers, text and the names of classes of that list; reading them makes such values and calls nothing else. A
value of a dataclass is written once, however many others hold it. The fields of a class stand in columns, so that reading
takes little more than the reading of JSON.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

from heavebond.basis.garbage import put_off

if TYPE_CHECKING:
    import casadi as ca

# metadata of a field: a dictionary whose keys are hashes of symbols, which are others in every process
BY_SYMBOL = {"keys": "symbols"}
ARRAYS = {"operation": "|u1", "first": "<i4", "second": "<i4", "constants": "<f8", "outputs": "<i4"}
_PLAIN = frozenset({str, int, float, bool, type(None)})
# how the entries of a column are written: as they stand; all values of dataclasses, by their numbers; all expressions, by
# theirs; all pairs of plain entries, one behind the other; each with what it is
_AS_IS, _VALUES, _EXPRESSIONS, _PAIRS, _MIXED = range(5)


class Unpackable(ValueError):
    """A value that cannot be packed, or bytes that are no packed value of these classes."""


def pack(value: object, classes: Sequence[type], outside: Mapping[str, object] | None = None) -> bytes:
    """`value` as bytes; Unpackable for what is of no class of the list. What is `outside` is written by its name alone."""
    with put_off():
        return _Packer(classes, outside or {}).packed(value)


def unpack(data: bytes, classes: Sequence[type], outside: Mapping[str, object] | None = None) -> Any:
    """The value in bytes that `pack` made with the same classes; Unpackable for other bytes."""
    try:
        with put_off():
            return _Unpacker(data, classes, outside or {}).value()
    except (ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RuntimeError) as error:
        raise Unpackable(f"no packed value: {error}") from error


class _Packer:
    def __init__(self, classes: Sequence[type], outside: Mapping[str, object]):
        self.kinds = {c: k for k, c in enumerate(classes)}
        self.fields = {c: [(f.name, f.metadata == BY_SYMBOL) for f in fields(c)] for c in classes}
        self.named = {id(value): name for name, value in outside.items()}
        self.values: list[object] = []
        self.number: dict[int, int] = {}
        self.expressions: list[ca.SX] = []
        self.expression_number: dict[int, int] = {}
        # dictionaries by symbols: the hashes to be replaced by places among the expressions
        self.open: list[list[Any]] = []

    def packed(self, value: object) -> bytes:
        root = self.entry(value)
        columns: dict[type, dict[str, list[Any]]] = {c: {name: [] for name, _ in f} for c, f in self.fields.items()}
        for item in self.values:  # which grows on the way
            column = columns[type(item)]
            for name, by_symbol in self.fields[type(item)]:
                inner = getattr(item, name)
                column[name].append(inner if type(inner) in _PLAIN else
                                    self.by_symbol(inner) if by_symbol else self.entry(inner))
        arrays, shapes, symbols = self.pool()
        document = {
            "root": root, "kinds": [self.kinds[type(item)] for item in self.values],
            "fields": {c.__name__: {name: _column(entries) for name, entries in found.items()}
                       for c, found in columns.items()},
            "shapes": shapes, "symbols": symbols, "lengths": [len(a) for a in arrays]}
        text = json.dumps(document, separators=(",", ":")).encode()
        return b"".join([len(text).to_bytes(8, "little"), text, *arrays])

    def entry(self, value: object) -> Any:
        """What stands for a value in its column: itself where it is plain, else a list that begins with what it is."""
        kind = type(value)
        if kind in _PLAIN:
            return value
        if isinstance(value, (tuple, list)):
            return [kind.__name__, *_column(self.entries(value))]
        if id(value) in self.named:
            return ["outside", self.named[id(value)]]
        if kind in self.kinds:
            return ["value", self._numbered(value, self.values, self.number)]
        if kind.__name__ == "SX":
            return ["sx", self._numbered(value, self.expressions, self.expression_number)]
        return self.rarer(value)

    def rarer(self, value: object) -> list[Any]:
        if isinstance(value, (set, frozenset)):
            return [type(value).__name__, *_column(self.entries(sorted(value, key=repr)))]
        if type(value) is dict:
            keys = self.entries(value)
            if any(isinstance(k, list) and (k[0] != "tuple" or k[1] != _AS_IS) for k in keys):
                raise Unpackable("keys must be plain: those of dataclasses could not be compared before they are filled")
            return ["dict", *_column(keys), *_column(self.entries(value.values()))]
        if isinstance(value, Path):
            return ["path", str(value)]
        if isinstance(value, Fraction):
            return ["fraction", value.numerator, value.denominator]
        raise Unpackable(f"a {type(value).__name__} cannot be packed")

    def entries(self, values: Iterable[object]) -> list[Any]:
        return [value if type(value) in _PLAIN else self.entry(value) for value in values]

    @staticmethod
    def _numbered(value: Any, values: list[Any], number: dict[int, int]) -> int:
        found = number.setdefault(id(value), len(values))
        if found == len(values):
            values.append(value)
        return found

    def by_symbol(self, value: Mapping[int, object]) -> list[Any]:
        self.open.append(["symbols", list(value), *_column(self.entries(value.values()))])
        return self.open[-1]

    def pool(self) -> tuple[list[bytes], list[Any], tuple[str, ...]]:
        """All expressions in one column: its numbers as bytes, the shape of each, the names of the symbols."""
        if not self.expressions:
            return [], [], ()
        import casadi as ca

        from heavebond.text.instructions import NotPlain, instructions
        from heavebond.text.symbols import split

        shapes = [_shape(x) for x in self.expressions]
        dense = [x if isinstance(shape, int) else x.nz[:] for x, shape in zip(self.expressions, shapes, strict=True)]
        column = ca.vertcat(*dense, 0, 1)  # never of one entry, which CasADi writes otherwise
        if self.open:
            place = {x.element_hash(): k for k, x in enumerate(split(column))}
            for entry in self.open:
                entry[1] = [place[key] for key in entry[1]]
        try:
            found = instructions(column)
        except NotPlain as error:
            raise Unpackable(str(error)) from error
        arrays = [getattr(found, name).astype(kind).tobytes() for name, kind in ARRAYS.items()]
        return arrays, shapes, found.symbols


def _column(entries: list[Any]) -> tuple[int, list[Any]]:
    """How entries are written, and these."""
    tagged = [e for e in entries if type(e) is list]
    if not tagged:
        return _AS_IS, entries
    if len(tagged) == len(entries):
        kinds = {e[0] for e in tagged}
        if kinds == {"value"}:
            return _VALUES, [e[1] for e in entries]
        if kinds == {"sx"}:
            return _EXPRESSIONS, [e[1] for e in entries]
        if kinds == {"tuple"} and all(e[1] == _AS_IS and len(e[2]) == 2 for e in entries):
            return _PAIRS, [item for e in entries for item in e[2]]
    return _MIXED, entries


def _shape(x: ca.SX) -> Any:
    """The number of rows of a dense column, or (rows, columns, column offsets, rows of the entries)."""
    if x.is_dense() and x.is_column():
        return x.numel()
    pattern = x.sparsity()
    return [*x.shape, list(pattern.colind()), list(pattern.row())]


class _Unpacker:
    def __init__(self, data: bytes, classes: Sequence[type], outside: Mapping[str, object]):
        size = int.from_bytes(data[:8], "little")
        self.document = json.loads(data[8:8 + size])
        self.arrays, self.classes, self.outside = data[8 + size:], classes, outside
        if sorted(self.document["fields"]) != sorted(c.__name__ for c in classes):
            raise Unpackable("these are values of other classes")
        self.values = [object.__new__(classes[kind]) for kind in self.document["kinds"]]
        self.shapes = self.document["shapes"]
        self.made: dict[int, ca.SX] = {}
        self.places: list[int] = []
        self._pool()
        self.makers: dict[str, Callable[[list[Any]], Any]] = {
            "value": lambda e: self.values[e[1]], "sx": lambda e: self.expression(e[1]),
            "tuple": lambda e: tuple(self.column(*e[1:])), "list": lambda e: list(self.column(*e[1:])),
            "set": lambda e: set(self.column(*e[1:])), "frozenset": lambda e: frozenset(self.column(*e[1:])),
            "dict": lambda e: dict(zip(self.column(*e[1:3]), self.column(*e[3:]), strict=True)),
            "symbols": lambda e: dict(zip(map(self.hash_of, e[1]), self.column(*e[2:]), strict=True)),
            "path": lambda e: Path(e[1]), "fraction": lambda e: Fraction(e[1], e[2]),
            "outside": lambda e: self.outside[e[1]]}

    def _pool(self) -> None:
        """The column of all expressions, and where each begins."""
        if not self.shapes:
            return
        import numpy as np

        from heavebond.text.instructions import Instructions, expressions
        from heavebond.text.symbols import split

        found, at = [], 0
        for length, kind in zip(self.document["lengths"], ARRAYS.values(), strict=True):
            found.append(np.frombuffer(self.arrays[at:at + length], kind))
            at += length
        operation, first, second, constants, outputs = found
        self.pool = expressions(Instructions(operation, first, second, constants, outputs, tuple(self.document["symbols"])))
        self.elements = split(self.pool)
        sizes = [s if isinstance(s, int) else len(s[3]) for s in self.shapes]
        self.places = np.concatenate([[0], np.cumsum(sizes)]).tolist()
        if self.places[-1] + 2 != len(self.elements):
            raise Unpackable("there are more or fewer expressions than their shapes say")

    def value(self) -> Any:
        own: dict[type, list[dict[str, Any]]] = {c: [] for c in self.classes}
        for item in self.values:
            own[type(item)].append(vars(item))
        for kind, filled in own.items():
            columns = self.document["fields"][kind.__name__]
            if list(columns) != [f.name for f in fields(kind)]:
                raise Unpackable(f"{kind.__name__} has other fields")
            for name, column in columns.items():
                for item, entry in zip(filled, self.column(*column), strict=True):
                    item[name] = entry
        return self.entry(self.document["root"])

    def column(self, how: int, entries: list[Any]) -> list[Any]:
        if how == _AS_IS:
            return entries
        if how == _VALUES:
            return [self.values[k] for k in entries]
        if how == _EXPRESSIONS:
            return [self.expression(k) for k in entries]
        if how == _PAIRS:
            both = iter(entries)
            return list(zip(both, both, strict=True))
        return [self.entry(e) for e in entries]

    def entry(self, entry: Any) -> Any:
        return self.makers[entry[0]](entry) if isinstance(entry, list) else entry

    def hash_of(self, k: int) -> int:
        return self.elements[k].element_hash()

    def expression(self, k: int) -> ca.SX:
        if k not in self.made:
            import casadi as ca

            begin, end, shape = self.places[k], self.places[k + 1], self.shapes[k]
            if shape == 1:
                self.made[k] = self.elements[begin]
            elif isinstance(shape, int):
                self.made[k] = self.pool[begin:end]
            else:
                pattern = ca.Sparsity(*shape)
                self.made[k] = ca.SX(pattern, self.pool[begin:end]) if end > begin else ca.SX(*shape[:2])
        return self.made[k]
