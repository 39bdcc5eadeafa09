"""Changes of a diagram as values, such as the addition of an effect, and the files that contain them.

A change is represented by the text of a file that extends the diagram; the changed diagram is read from that text, so that
the model in memory and the written file agree.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from heavebond.core.errors import UsageError
from heavebond.core.quoting import file_stem
from heavebond.core.units import Range
from heavebond.core.writable import write_text
from heavebond.language.library import bundled
from heavebond.language.model import Model, extended
from heavebond.text.yaml_edits import Tree, set_entry
from heavebond.text.yaml_source import Mapping as Entries
from heavebond.text.yaml_source import parse

_PLAIN = re.compile(r"[-+]?[\w.](?:[\w.+\-*/ ]*[\w)])?")
_UNWRITTEN = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029\ufeff\ud800-\udfff]")


@dataclass(frozen=True)
class Part:
    """A component that is added: its kind and its settings, as written."""

    kind: str
    values: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Change:
    """Additions to a diagram: components by name, ends of nodes with their signs, values, initial values, factors of
    parameters that `vary`. Additions to the experiment: `channels` maps outputs to the formulas that they equal now,
    `moved` maps inputs to their new destination, `each` maps parameters with one value for each record to their
    ranges, and `of_records` maps records to such values, as written."""

    components: dict[str, Part] = field(default_factory=dict)
    nodes: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    settings: dict[str, str] = field(default_factory=dict)
    initial: dict[str, str] = field(default_factory=dict)
    channels: dict[str, str] = field(default_factory=dict)
    vary: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    moved: dict[str, str] = field(default_factory=dict)
    each: Mapping[str, Range] = field(default_factory=dict)
    of_records: Mapping[str, Mapping[str, str]] = field(default_factory=dict)

    def with_values(self, values: Mapping[str, str]) -> Change:
        """A copy with other parameter values, by full name, as written."""
        parts, settings, initial = dict(self.components), dict(self.settings), dict(self.initial)
        for name, text in values.items():
            owner, _, parameter = name.rpartition(".")
            if name.startswith("initial."):
                initial[name.removeprefix("initial.")] = text
            elif owner in parts:
                parts[owner] = replace(parts[owner], values={**parts[owner].values, parameter: text})
            else:
                settings[name] = text
        return replace(self, components=parts, settings=settings, initial=initial)

    def value(self, name: str) -> str:
        """The text of a parameter value that `with_values` has set, by its full name; KeyError if it is not set."""
        owner, _, parameter = name.rpartition(".")
        return str(self.components[owner].values[parameter] if owner in self.components else self.settings[name])

    def joined(self, other: Change) -> Change:
        """Both changes combined; nodes in both get the ends of both."""
        nodes = dict(self.nodes)
        for name, ends in other.nodes.items():
            nodes[name] = (*nodes.get(name, ()), *ends)
        vary = {name: tuple(dict.fromkeys((*self.vary.get(name, ()), *other.vary.get(name, ()))))
                for name in (*self.vary, *other.vary)}
        of_records = {name: {**self.of_records.get(name, {}), **other.of_records.get(name, {})}
                      for name in (*self.of_records, *other.of_records)}
        return Change({**self.components, **other.components}, nodes, {**self.settings, **other.settings},
                      {**self.initial, **other.initial}, {**self.channels, **other.channels}, vary,
                      {**self.moved, **other.moved}, {**self.each, **other.each}, of_records)

    def diagram(self, name: str, summary: str, extends: str) -> str:
        """The text of a diagram that extends the former one."""
        lines = [f"model: {quoted(name)}", f"summary: {quoted(summary)}", f"extends: {quoted(extends)}"]
        lines += block("components", {k: _part(p) for k, p in self.components.items()})
        lines += block("nodes", {k: f"[{', '.join(ends)}]" for k, ends in self.nodes.items()})
        lines += block("set", {k: quoted(v) for k, v in self.settings.items()})
        lines += block("vary", {k: quoted("=" + "*".join(v)) for k, v in self.vary.items()})
        lines += block("initial", {k: quoted(v) for k, v in self.initial.items()})
        return "\n".join(lines) + "\n"

    def on_model(self, model: Model, name: str = "", summary: str = "", path: Path | None = None) -> Model:
        """Apply the change to a model; `path` is the path that the file would have."""
        path = path or model.path.with_name(f"{file_stem(name or model.name)}.yaml")
        text = self.diagram(name or model.name, summary or model.summary or model.name, model.path.name)
        return extended(model, parse(text, path, path.name, trusted=True))


def quoted(text: str) -> str:
    """A text as a YAML scalar: plain if that is safe, else in double quotes."""
    if _PLAIN.fullmatch(text) and "  " not in text and text.lower() not in ("yes", "no", "on", "off", "true", "false",
                                                                         "null", "~"):
        return text
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", " ")
    return '"' + _UNWRITTEN.sub(lambda character: f"\\u{ord(character.group()):04x}", escaped) + '"'


def _part(part: Part) -> str:
    values = "".join(f", {name}: {quoted(text)}" for name, text in part.values.items())
    return f"{{is: {part.kind}{values}}}"


def block(name: str, entries: Mapping[str, str], notes: Mapping[str, str] | None = None) -> list[str]:
    """`name:` and its entries, one per line, with notes at their ends; nothing without entries."""
    if not entries:
        return []
    lines = {key: f"  {key}: {text}" for key, text in entries.items()}
    width = max(len(text) for text in lines.values())
    notes = notes or {}
    return [f"{name}:", *(f"{text.ljust(width)}   # {notes[key]}" if notes.get(key) else text
                          for key, text in lines.items())]


def extended_from(path: Path, model: Path) -> str:
    """The `extends:` value for a file at `path` and a diagram at `model`: the name of a bundled one, so that the file can
    be moved.
    """
    inside = bundled("models").resolve()
    if model.resolve().is_relative_to(inside) and not path.resolve().is_relative_to(inside):
        return model.resolve().relative_to(inside).as_posix()
    return Path(os.path.relpath(model.resolve(), path.resolve().parent)).as_posix()


def with_values(text: str, values: Mapping[str, Tree]) -> str:
    """Set values of parameters by their paths; see `set_entry`."""
    for path, value in values.items():
        text = set_entry(text, place_of(parse(text).root, path), value)
    return text


def place_of(root: Entries, path: str) -> tuple[str, ...]:
    """The keys under which a parameter is set: in `set:` if it is there already, else at the diagram's parameter (for a
    component: its default) or at the part, else under `set:`, which also overrides a diagram that is extended."""
    settings = root.items.get("set")
    if isinstance(settings, Entries) and path in settings.items:
        return "set", path
    owner, _, name = path.rpartition(".")
    if not owner:
        return ("parameters", name, "default") if "component" in root.items else ("parameters", name)
    parts = root.items.get("components")
    if "extends" not in root.items and isinstance(parts, Entries) and isinstance(parts.items.get(owner), Entries):
        return "components", owner, name
    return "set", path


def write(path: Path, text: str) -> None:
    """Write a new file; UsageError if it exists already or cannot be written."""
    if path.suffix not in (".yaml", ".yml"):
        raise UsageError(f"'{path.name}' is not a name of a diagram", hint=f"Write {path.with_suffix('.yaml').name}.")
    write_new(path, text)


def write_new(path: Path, text: str) -> None:
    """Write a text to a file that does not exist; UsageError if it exists or cannot be written."""
    try:
        write_text(path, text, exclusive=True)
    except FileExistsError:
        raise UsageError(f"{path} exists already", hint="Give another name, or remove it first.") from None
    except OSError as error:
        raise UsageError(f"{path} cannot be written: {error.strerror}") from None
