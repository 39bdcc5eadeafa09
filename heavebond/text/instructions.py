"""SX expressions as plain numbers, and back: nodes in the order of their evaluation, each an operation on earlier ones.

CasADi can write expressions out, but what it reads back may also name functions in shared libraries, which it then loads.
So nothing that CasADi wrote is kept, only numbers. Its text is made anew from these when they are read: by what is below, it
holds constants, symbols and the operations in UNARY and BINARY, whatever the numbers are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

UNARY = np.array([
    ca.OP_NEG, ca.OP_EXP, ca.OP_LOG, ca.OP_SQRT, ca.OP_SQ, ca.OP_TWICE, ca.OP_SIN, ca.OP_COS, ca.OP_TAN, ca.OP_ASIN,
    ca.OP_ACOS, ca.OP_ATAN, ca.OP_NOT, ca.OP_FLOOR, ca.OP_CEIL, ca.OP_FABS, ca.OP_SIGN, ca.OP_ERF, ca.OP_INV, ca.OP_SINH,
    ca.OP_COSH, ca.OP_TANH, ca.OP_ASINH, ca.OP_ACOSH, ca.OP_ATANH, ca.OP_LOG1P, ca.OP_EXPM1])
BINARY = np.array([
    ca.OP_ADD, ca.OP_SUB, ca.OP_MUL, ca.OP_DIV, ca.OP_POW, ca.OP_CONSTPOW, ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_AND,
    ca.OP_OR, ca.OP_FMOD, ca.OP_COPYSIGN, ca.OP_IF_ELSE_ZERO, ca.OP_FMIN, ca.OP_FMAX, ca.OP_ATAN2, ca.OP_HYPOT,
    ca.OP_REMAINDER])
# what jumps or turns at a point, though its second derivative is zero everywhere else
CORNERS = {ca.OP_FMIN, ca.OP_FMAX, ca.OP_FABS, ca.OP_FMOD, ca.OP_REMAINDER, ca.OP_COPYSIGN, ca.OP_SIGN, ca.OP_FLOOR,
           ca.OP_CEIL, ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_NOT, ca.OP_IF_ELSE_ZERO}
CONSTANT, SYMBOL = ca.OP_CONST, ca.OP_PARAMETER
AT_ONCE = 10_000
SMALLEST, LARGEST = -2**31, 2**31 - 1  # whole numbers that CasADi keeps as such

# CasADi's text, two letters a byte: a magic number, the version, no descriptions, a list of matrices ...
HEAD = (123456789012345).to_bytes(8, "little") + (3).to_bytes(8, "little") + b"\0" + b"\x17"
# ... the nodes as matrices of one entry. Their shape is said at the first and referred to as number 0 at the others, so that
# node k is number k + 1
SHAPE = b"d" + b"".join(k.to_bytes(8, "little") for k in (5, 1, 1, 0, 1, 0))
SHAPE_AGAIN = b"r" + bytes(8)
BEFORE = SHAPE_AGAIN + (1).to_bytes(8, "little") + b"d"  # stands before the operation of every node
AT = len(BEFORE)
LENGTH_UNARY, LENGTH_BINARY = AT + 8 + 9, AT + 8 + 18
# constants: a letter, then nothing, a whole number or a real one
SPECIAL = {0.0: b"0", 1.0: b"1", -1.0: b"m", np.inf: b"F", -np.inf: b"f"}
LENGTH_OF = {**dict.fromkeys(b"01mFfn", AT + 9), b"i"[0]: AT + 13, b"r"[0]: AT + 17}


class NotPlain(ValueError):
    """Expressions that hold more than numbers can say (a call of a function), or numbers that are no expressions."""


@dataclass(frozen=True)
class Instructions:
    """A column of expressions as numbers. Node k is `operation[k]` of the nodes first[k] and second[k] (both below k), the
    constant number first[k] or the symbol number first[k]; the column holds the nodes `outputs`."""

    operation: NDArray[np.uint8]
    first: NDArray[np.int32]
    second: NDArray[np.int32]
    constants: NDArray[np.float64]
    outputs: NDArray[np.int32]
    symbols: tuple[str, ...]


def instructions(column: ca.SX) -> Instructions:
    """The numbers of a dense column of at least two expressions; NotPlain for what they cannot say."""
    packer = ca.StringSerializer()
    packer.pack([column])
    text = packer.encode()
    found = _parsed(_bytes(text))
    if _text(found) != text:
        raise NotPlain("CasADi writes expressions in another way than is known here")
    return found


def expressions(found: Instructions) -> ca.SX:
    """The column of expressions; NotPlain where the numbers are none."""
    _check(found)
    column = ca.StringDeserializer(_text(found)).unpack()[0]
    if not isinstance(column, ca.SX) or column.shape != (len(found.outputs), 1):
        raise NotPlain("CasADi reads expressions in another way than is known here")
    return column


def _check(found: Instructions) -> None:
    """Operations that are known, of nodes that come before."""
    n, own = len(found.operation), np.arange(len(found.operation))
    constant, symbol = found.operation == CONSTANT, found.operation == SYMBOL
    unary, binary = np.isin(found.operation, UNARY), np.isin(found.operation, BINARY)
    below = np.select([constant, symbol], [len(found.constants), len(found.symbols)], own)
    good = (len(found.first) == len(found.second) == n and len(found.outputs) >= 2
            and np.all(constant | symbol | unary | binary)
            and np.all((found.first >= 0) & (found.first < below))
            and np.all((found.second[binary] >= 0) & (found.second[binary] < own[binary]))
            and np.all((found.outputs >= 0) & (found.outputs < n)))
    if not good:
        raise NotPlain("these numbers are no expressions")


# -- CasADi's text -------------------------------------------------------------------------------------------------------
def _bytes(text: str) -> bytes:
    letters = np.frombuffer(text.encode("ascii"), np.uint8) - np.uint8(ord("a"))
    return (letters[0::2] | (letters[1::2] << 4)).tobytes()


def _letters(data: bytes) -> str:
    found = np.frombuffer(data, np.uint8)
    letters = np.empty(2 * len(found), np.uint8)
    letters[0::2], letters[1::2] = found & 15, found >> 4
    return (letters + np.uint8(ord("a"))).tobytes().decode("ascii")


def _numbers(data: bytes, at: NDArray[np.intp], kind: str) -> NDArray[Any]:
    """The numbers of a kind (`<i8`) that begin at these bytes."""
    size = np.dtype(kind).itemsize
    found: NDArray[Any] = np.frombuffer(data, np.uint8)[at[:, None] + np.arange(size)].copy().view(kind)
    return found.reshape(len(at))


def _parsed(data: bytes) -> Instructions:
    """The numbers in a text of CasADi's; what it holds beside them is not looked at."""
    n = int.from_bytes(data[len(HEAD):len(HEAD) + 8], "little")
    unary, binary = set(UNARY.tolist()), set(BINARY.tolist())
    starts, operations = np.zeros(n, np.intp), np.zeros(n, np.uint8)
    constants: list[float] = []
    symbols: list[str] = []
    first = np.zeros(n, np.int32)
    start = len(HEAD) + 8 + len(SHAPE) - len(SHAPE_AGAIN)
    for k in range(n):
        starts[k], operations[k] = start, (operation := data[start + AT])
        if operation in binary:
            start += LENGTH_BINARY
        elif operation in unary:
            start += LENGTH_UNARY
        elif operation == CONSTANT:
            first[k] = len(constants)
            constants.append(_constant(data[start + AT + 8:start + AT + 17]))
            start += LENGTH_OF[data[start + AT + 8]]
        elif operation == SYMBOL:
            first[k] = len(symbols)
            length = int.from_bytes(data[start + AT + 8:start + AT + 12], "little")
            symbols.append(data[start + AT + 12:start + AT + 12 + length].decode())
            start += AT + 12 + length
        else:
            raise NotPlain(f"operation {operation} is none of numbers")
    either = np.isin(operations, (*unary, *binary))
    two, second = np.isin(operations, BINARY), np.zeros(n, np.int32)
    first[either] = _numbers(data, starts[either] + AT + 9, "<i8") - 1
    second[two] = _numbers(data, starts[two] + AT + 18, "<i8") - 1
    size = int.from_bytes(data[start + 17:start + 25], "little")
    outputs = _numbers(data, len(data) - 9 * size + 9 * np.arange(size) + 1, "<i8") - 1
    return Instructions(operations, first, second, np.array(constants), outputs.astype(np.int32), tuple(symbols))


def _constant(data: bytes) -> float:
    """The constant that begins with a letter."""
    letter = data[:1]
    if letter == b"i":
        return float(int.from_bytes(data[1:5], "little", signed=True))
    if letter == b"r":
        return float(np.frombuffer(data[1:9], "<f8")[0])
    return next((value for value, own in SPECIAL.items() if own == letter), float("nan"))


def _constant_text(value: float) -> bytes:
    if np.isnan(value):
        return b"n"
    if value in SPECIAL:
        return SPECIAL[value]
    whole = value.is_integer() and SMALLEST <= value <= LARGEST
    return b"i" + int(value).to_bytes(4, "little", signed=True) if whole else b"r" + np.float64(value).tobytes()


def _text(found: Instructions) -> str:
    """CasADi's text of the column, from nothing but the numbers."""
    operation, n = found.operation.astype("<i8"), len(found.operation)
    leaves = {int(k): _leaf(found, int(k)) for k in np.flatnonzero((operation == CONSTANT) | (operation == SYMBOL))}
    two = np.isin(operation, BINARY)
    lengths = np.where(two, LENGTH_BINARY, LENGTH_UNARY)
    lengths[list(leaves)] = [AT + 8 + len(text) for text in leaves.values()]
    starts = np.concatenate([[0], np.cumsum(lengths)]).astype(np.intp)
    data = np.zeros(starts[-1], np.uint8)
    begin, inner = starts[:-1], np.setdiff1d(np.arange(n), list(leaves))
    _put(data, begin, np.broadcast_to(np.frombuffer(BEFORE, np.uint8), (n, AT)))
    _put(data, begin + AT, operation[:, None].view(np.uint8))
    _put(data, begin[inner] + AT + 8, _references(found.first[inner]))
    _put(data, begin[two] + AT + 17, _references(found.second[two]))
    for k, text in leaves.items():
        data[starts[k] + AT + 8:starts[k + 1]] = np.frombuffer(text, np.uint8)
    size = len(found.outputs)
    column = np.array([4 + size, size, 1, 0, size, *range(size), size], "<i8")
    tail = (1).to_bytes(8, "little") + b"d" + column.tobytes() + _references(found.outputs).tobytes()
    return _letters(HEAD + n.to_bytes(8, "little") + SHAPE + data.tobytes()[len(SHAPE_AGAIN):] + tail)


def _put(data: NDArray[np.uint8], at: NDArray[np.intp], rows: NDArray[np.uint8]) -> None:
    """Write the rows where they begin, some thousand at a time: the places of all bytes would take hundreds of MB."""
    for k in range(0, len(at), AT_ONCE):
        data[at[k:k + AT_ONCE, None] + np.arange(rows.shape[1])] = rows[k:k + AT_ONCE]


def _references(nodes: NDArray[np.int32]) -> NDArray[np.uint8]:
    """A row for each node that is referred to."""
    number = (nodes.astype("<i8") + 1)[:, None].view(np.uint8)
    return np.hstack([np.full((len(nodes), 1), ord("r"), np.uint8), number])


def _leaf(found: Instructions, k: int) -> bytes:
    """What stands behind the operation of a constant or a symbol."""
    if found.operation[k] == CONSTANT:
        return _constant_text(float(found.constants[found.first[k]]))
    written: bytes = found.symbols[found.first[k]].encode()
    return len(written).to_bytes(4, "little") + written
