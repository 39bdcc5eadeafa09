"""Headers of shared libraries: the processor, the exported functions and the imported libraries of ELF, PE and Mach-O."""

from __future__ import annotations

import struct
from dataclasses import dataclass


@dataclass(frozen=True)
class Library:
    """A shared library: format, processor, names of exported symbols, and names of the libraries that it needs."""

    kind: str
    machine: str
    exports: frozenset[str]
    needs: frozenset[str]


def read_header(data: bytes) -> Library:
    """Read a library of 64 bits; ValueError for another file."""
    if data[:4] == b"\x7fELF":
        return _elf(data)
    if data[:2] == b"MZ":
        return _pe(data)
    if struct.unpack_from("<I", data)[0] == 0xFEEDFACF:
        return _mach_o(data)
    raise ValueError("no ELF, PE or Mach-O of 64 bits")


def _text(data: bytes, at: int) -> str:
    return data[at:data.index(b"\0", at)].decode()


def _elf(data: bytes) -> Library:
    machine = {0x3E: "x86_64", 0xB7: "aarch64"}[struct.unpack_from("<H", data, 18)[0]]
    table, size, number = struct.unpack_from("<Q", data, 40)[0], *struct.unpack_from("<HH", data, 58)
    sections = [struct.unpack_from("<IIQQQQIIQQ", data, table + k * size) for k in range(number)]
    exports, needs = set[str](), set[str]()
    for _, kind, _, _, offset, length, link, _, _, entry in sections:
        strings = sections[link][4] if link < number else 0
        for at in range(offset, offset + length, entry) if kind in (6, 11) and entry else ():
            if kind == 11:  # dynamic symbols: name, info, visibility, section
                name, info, _, section = struct.unpack_from("<IBBH", data, at)
                if section and info >> 4 == 1 and info & 15 == 2:
                    exports.add(_text(data, strings + name))
            else:  # the dynamic section: DT_NEEDED
                tag, value = struct.unpack_from("<qQ", data, at)
                if tag == 1:
                    needs.add(_text(data, strings + value))
    return Library("ELF", machine, frozenset(exports), frozenset(needs))


def _pe(data: bytes) -> Library:
    header = struct.unpack_from("<I", data, 60)[0]
    assert data[header:header + 4] == b"PE\0\0"
    code, number, optional = *struct.unpack_from("<HH", data, header + 4), struct.unpack_from("<H", data, header + 20)[0]
    machine = {0x8664: "x86_64", 0xAA64: "aarch64"}[code]
    sections = [struct.unpack_from("<IIII", data, header + 24 + optional + 40 * k + 8) for k in range(number)]

    def place(address: int) -> int:
        return next(address - virtual + raw for size, virtual, raw_size, raw in sections
                    if virtual <= address < virtual + max(size, raw_size))

    export, _, imported, _ = struct.unpack_from("<IIII", data, header + 24 + 112)
    names, pointers = struct.unpack_from("<I", data, place(export) + 24)[0], struct.unpack_from("<I", data,
                                                                                               place(export) + 32)[0]
    exports = {_text(data, place(struct.unpack_from("<I", data, place(pointers) + 4 * k)[0])) for k in range(names)}
    needs, at = set[str](), place(imported)
    while name := struct.unpack_from("<IIIII", data, at)[3]:
        needs.add(_text(data, place(name)))
        at += 20
    return Library("PE", machine, frozenset(exports), frozenset(needs))


def _mach_o(data: bytes) -> Library:
    processor, commands = struct.unpack_from("<I", data, 4)[0], struct.unpack_from("<I", data, 16)[0]
    machine, at = {0x01000007: "x86_64", 0x0100000C: "aarch64"}[processor], 32
    exports, needs = set[str](), set[str]()
    for _ in range(commands):
        kind, size = struct.unpack_from("<II", data, at)
        if kind == 0xC:  # LC_LOAD_DYLIB
            needs.add(_text(data, at + struct.unpack_from("<I", data, at + 8)[0]))
        elif kind == 2:  # LC_SYMTAB
            symbols, number, strings, _ = struct.unpack_from("<IIII", data, at + 8)
            for k in range(number):
                name, flags, section = struct.unpack_from("<IBB", data, symbols + 16 * k)
                if flags & 0x1F == 0x0F and section:  # external, defined
                    exports.add(_text(data, strings + name).removeprefix("_"))
        at += size
    return Library("Mach-O", machine, frozenset(exports), frozenset(needs))
