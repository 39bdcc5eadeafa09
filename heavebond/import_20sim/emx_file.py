"""Reading .emx files: XML with SIDOPS text and experiments, read without entities and with limits of size and nesting."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from xml.parsers import expat

from heavebond.core.errors import ModelError, Place, Problem
from heavebond.import_20sim.names import labels

MOST_BYTES = 50_000_000
DEEPEST = 100
MOST_ELEMENTS = 1_000_000
# beginnings of compressed files
COMPRESSED = {b"PK\x03\x04": "a ZIP archive", b"\x1f\x8b": "compressed by gzip", b"7z\xbc\xaf": "a 7-Zip archive"}
MOST_CONTROL = 0.05  # share of control characters at the beginning of a text; random bytes have 0.11
SAVE_AS_TEXT = ("Unpack it, or open it in 20-sim and save it as a plain .emx file. A model encrypted by its author can be "
                "read by 20-sim only: ask the author for the open model.")
UTF_16 = (b"\xff\xfe", b"\xfe\xff", b"<\0", b"\0<")  # byte order marks, and the beginning without one
CONTROL = bytes(c if c >= 32 or c in b"\t\n\r" else 32 for c in range(256))  # control characters, which XML does not permit


@dataclass
class EmxFile:
    """The SIDOPS text with its first line, and the run settings, values and plotted variables of the default experiment;
    values of constants are among those of parameters. Values and texts have the names of `names.labels`, plotted
    variables those of the file."""

    path: Path
    sidops: str = ""
    first_line: int = 1
    default: str = ""  # name of the default experiment
    name: str = ""  # of the experiment
    start: float = 0.0  # s
    finish: float | None = None
    every: float | None = None  # output interval
    sample_times: dict[str, float] = field(default_factory=dict)  # of discrete systems, by a quantity of each
    parameters: dict[str, float] = field(default_factory=dict)
    initials: dict[str, float] = field(default_factory=dict)
    texts: dict[str, str] = field(default_factory=dict)  # parameters that are texts, such as names of files
    plotted: list[str] = field(default_factory=list)

    def stated(self, parameter: str) -> float | None:
        """The value of a parameter in the experiment, which may be listed among the initial values."""
        return self.parameters.get(parameter, self.initials.get(parameter))

    def within(self, part: str) -> None:
        """Name the quantities as quantities of a part, in addition to the global ones."""
        for values in (self.parameters, self.initials, self.sample_times):
            values.update({f"{part}\\{name}": value for name, value in values.items()})
        self.texts.update({f"{part}\\{name}": text for name, text in self.texts.items()})
        self.plotted = [f"{part}\\{name}" for name in self.plotted]


class _Handler:
    """Collects the texts of the elements that the importer uses."""

    def __init__(self, parser: expat.XMLParserType, emx: EmxFile):
        self.parser, self.emx = parser, emx
        self.path: list[str] = []
        self.text: list[str] = []
        self.elements = 0
        self.experiment: EmxFile | None = None  # the experiment that is being read
        self.use_every = False
        self.names: list[str] = []

    def begin(self, tag: str, attributes: dict[str, str]) -> None:
        self.elements += 1
        self.path.append(tag)
        if len(self.path) > DEEPEST or self.elements > MOST_ELEMENTS:
            raise _refused(self.emx.path, self.parser.CurrentLineNumber, "emx-nesting", "its XML is nested too deeply "
                           "or has too many elements")
        if tag == "Experiment":
            self.experiment, self.use_every = EmxFile(self.emx.path), False
        if tag == "Sidops":
            self.emx.first_line = self.parser.CurrentLineNumber
        self.text = []

    def data(self, text: str) -> None:
        self.text.append(text)

    def end(self, tag: str) -> None:
        text = "".join(self.text)
        if tag == "Sidops" and not self.emx.sidops:
            self.emx.sidops = text
        elif tag == "DefaultExperiment":
            self.emx.default = text.strip()
        elif tag == "Experiment":
            self.keep()
        elif self.experiment is not None:
            self._settings(self.experiment, tag, text.strip())
            self._experiment(self.experiment, tag, text.strip())
        self.path.pop()
        self.text = []

    def keep(self) -> None:
        """Use the experiment that has been read if it is the first or the default one."""
        read, self.experiment = self.experiment, None
        if read is None:
            return
        if not self.emx.name or (read.name == self.emx.default != self.emx.name):
            self.emx = replace(read, sidops=self.emx.sidops, first_line=self.emx.first_line,
                               default=self.emx.default, name=read.name or "Experiment")

    def _settings(self, emx: EmxFile, tag: str, text: str) -> None:
        if tag == "Name" and self.path[-2:-1] == ["Experiment"]:
            emx.name = text
        elif tag == "StartTime":
            emx.start = _number(text) or 0.0
        elif tag == "FinishTime":
            emx.finish = _number(text)
        elif tag == "UseOutputAfterEach":
            self.use_every = text.lower() == "true"
        elif tag == "OutputAfterEach" and self.use_every and (value := _number(text)) and value > 0:
            emx.every = value
        elif tag == "DiscreteID":
            self.names = labels(text)[:1]
        elif tag == "TimeInterval" and (value := _number(text)) and value > 0:
            emx.sample_times.update(dict.fromkeys(self.names, value))

    def _experiment(self, emx: EmxFile, tag: str, text: str) -> None:
        parent = self.path[-2] if len(self.path) > 1 else ""
        group = self.path[-3] if len(self.path) > 2 else ""
        if parent == "Variable" and tag == "Name":
            self.names = labels(text)
        elif parent == "Variable" and tag == "Value" and (value := _number(text)) is not None:
            if group in ("Parameters", "Constants"):
                emx.parameters.update(dict.fromkeys(self.names, value))
            elif group == "Initials":
                emx.initials.update(dict.fromkeys(self.names, value))
        elif parent == "Variable" and tag == "Value" and group == "Parameters":
            emx.texts.update(dict.fromkeys(self.names, text.strip("\"'")))
        elif tag == "VarName" and parent == "YCurveData" and text not in emx.plotted:
            emx.plotted.append(text)


def _number(text: str) -> float | None:
    try:
        value = {"true": 1.0, "false": 0.0}[text.lower()] if text.lower() in ("true", "false") else float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _refused(path: Path, line: int, code: str, why: str, hint: str = "") -> ModelError:
    return ModelError([Problem(code, f"'{path.name}' is not read: {why}", Place(path.name, max(1, line)), hint)])


def _well_encoded(content: bytes) -> bytes:
    """The content without control characters, and converted to UTF-8 if it is declared so but is not: 20-sim copies texts
    of icons in the code page of Windows, such as letters of a symbol font, into files that it declares as UTF-8."""
    head = content[:200].lower()
    if content[:2] in UTF_16 or (b"encoding" in head and b"utf-8" not in head):
        return content
    content = content.translate(CONTROL)
    try:
        content.decode("utf-8")
    except UnicodeDecodeError:
        return content.decode("cp1252", "replace").encode()
    return content


def read_emx(path: Path) -> EmxFile:
    """Read a file; raises ModelError if it is not an .emx file, for document types and entities, and beyond the limits."""
    if path.stat().st_size > MOST_BYTES:
        raise _refused(path, 1, "emx-size", f"it has more than {MOST_BYTES // 1_000_000} MB")
    parser = expat.ParserCreate()
    handler = _Handler(parser, EmxFile(path))
    parser.StartElementHandler, parser.EndElementHandler = handler.begin, handler.end
    parser.CharacterDataHandler = handler.data
    parser.buffer_text = True

    def refuse(*_: object) -> None:
        raise _refused(path, parser.CurrentLineNumber, "emx-doctype", "it declares a document type or entities, "
                       "which a 20-sim model does not")

    parser.StartDoctypeDeclHandler, parser.EntityDeclHandler = refuse, refuse
    raw = path.read_bytes()
    # ModelError if a file is compressed or encrypted, or a text that is not XML
    head = raw[:4096]
    packed = next((kind for mark, kind in COMPRESSED.items() if raw.startswith(mark)), None)
    binary = raw[:2] not in UTF_16 and sum(c < 32 and c not in b"\t\n\r" for c in head) > MOST_CONTROL * len(head)
    if packed or binary:
        raise _refused(path, 1, "emx-binary", f"it is {packed}" if packed else
                       "it is not text; it may be encrypted or compressed", SAVE_AS_TEXT)
    text = head.removeprefix(b"\xef\xbb\xbf").lstrip()
    if raw[:2] not in UTF_16 and not text.startswith(b"<"):
        raise _refused(path, 1, "emx-xml", "it does not begin as XML" if text else "it is empty",
                       "A 20-sim model is XML with a <Sidops> text. " + SAVE_AS_TEXT)
    content = _well_encoded(raw)
    try:
        parser.Parse(content, True)
    except (expat.ExpatError, ValueError, LookupError) as error:  # LookupError: an unknown encoding
        if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
            refuse()
        if not handler.emx.sidops:
            raise _refused(path, getattr(error, "lineno", 1), "emx-xml", f"its XML is wrong: {error}") from None
        handler.keep()
    if not handler.emx.sidops.strip():
        raise _refused(path, 1, "emx-xml", "it has no SIDOPS text; 20-sim models of version 4 and later have one")
    return handler.emx
