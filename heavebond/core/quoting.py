"""Escaping of text from files for another language: terminal, C comment, XML and HTML, JSON in a script, file name.

All text that becomes part of a document, a program or a command's output passes through one of these functions.
"""

from __future__ import annotations

import json
import re
import unicodedata

LONGEST_STEM = 100  # characters of a file name without its suffix
REPLACEMENT = "\ufffd"
_INVISIBLE = {"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"}  # control characters, direction marks, lone surrogates, line ends
_DEVICES = {"con", "prn", "aux", "nul", *(f"{port}{k}" for port in ("com", "lpt") for k in range(10))}  # of Windows
# forbidden inside a script element, even within a string of JSON
_UNSAFE = {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026", "\u2028": "\\u2028", "\u2029": "\\u2029"}


def visible(text: str) -> str:
    """The text for a terminal: characters that control it, or change the direction of writing, as `\x1b`, `\u202e`; line
    ends and tabs stay."""
    if text.isascii() and text.isprintable():
        return text
    return "".join(c if c in "\n\t" or unicodedata.category(c) not in _INVISIBLE else _code(c) for c in text)


def _code(character: str) -> str:
    number = ord(character)
    return f"\\x{number:02x}" if number < 0x100 else f"\\u{number:04x}" if number < 0x10000 else f"\\U{number:08x}"


def c_comment(text: str) -> str:
    """One line of the text inside a comment of C, which it cannot end, continue or translate: a space is inserted into
    `*/` and trigraphs, a backslash becomes a bar, a non-printable character a space."""
    plain = "".join(c if c.isprintable() else " " for c in text).replace("\\", "|")
    return re.sub(r"(?<=\*)(?=/)|(?<=/)(?=\*)|(?<=\?)(?=\?)", " ", plain)


def c_string(text: str) -> str:
    """One line of the text as a string literal of C, in its UTF-8 bytes, without trigraphs."""
    plain = "".join(c if c.isprintable() else " " for c in text)
    return '"' + "".join(c if c.isascii() and c not in '"\\?' else "".join(f"\\{byte:03o}" for byte in c.encode(
        "utf-8", "replace")) for c in plain) + '"'


def xml_text(text: str) -> str:
    """The text without the characters that XML 1.0 does not allow, for a writer that escapes the rest."""
    return "".join(c if c in "\t\n" or (c >= " " and not "\ud800" <= c <= "\udfff" and c not in "\ufffe\uffff\x7f")
                   else REPLACEMENT for c in text)


def xml(text: str) -> str:
    """The text in XML, SVG or HTML, between elements or in an attribute in double quotes."""
    return xml_text(text).replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;").replace('"', "&quot;")


def script_json(value: object) -> str:
    """JSON inside a script element, which its content cannot end early."""
    text = json.dumps(value, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    for unsafe, safe in _UNSAFE.items():
        text = text.replace(unsafe, safe)
    return text.encode("utf-8", "replace").decode("utf-8")


def file_stem(text: str) -> str:
    """A file name that is valid on every system, without suffix and folder: `rig 1/2` becomes `rig_1_2`."""
    plain = re.sub(r"[^\w.+-]+", "_", text).strip("._ ")[:LONGEST_STEM] or "unnamed"
    return f"_{plain}" if plain.partition(".")[0].lower() in _DEVICES or plain[0] == "-" else plain
