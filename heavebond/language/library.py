"""The component library: lookup of components by name."""

from __future__ import annotations

import re
from collections.abc import Iterable
from collections.abc import Mapping as Dictionary
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

from heavebond.core.errors import ModelError, Place, Problem, Problems, either, suggest
from heavebond.core.units import DIMENSIONLESS
from heavebond.language import reading
from heavebond.language.component_file import parse_component
from heavebond.language.definition import Component, Domain, Member
from heavebond.language.fmu_description import described
from heavebond.text.expression import constant
from heavebond.text.yaml_source import Mapping, parse, read, read_text, short_path

_HEAD = re.compile(r"""^component:[ \t]+["']?([^"'#\n]+?)["']?[ \t]*(?:#.*)?$""", re.MULTILINE)


def bundled(folder: str) -> Path:
    """Where `components` and `models` lie: inside an installed package, beside it in a working copy."""
    inside = Path(__file__).parents[1] / folder
    return inside if inside.is_dir() else Path(__file__).parents[2] / folder


@dataclass(frozen=True)
class Library:
    """Domains and the files in which each component is found; the user's own folders come first."""

    domains: dict[str, Domain]
    files: dict[str, Path]
    # names that two of the user's files have
    twice: dict[str, tuple[Path, Path]] = field(default_factory=dict)

    def names(self) -> list[str]:
        """Every component in a file of the language, in the order of their files. FMUs are known by name, but a folder may
        hold some that are no components."""
        return [name for name, path in self.files.items() if path.suffix != ".fmu"]

    def component(self, name: str, place: Place | None = None) -> Component:
        """The component called `name`; ModelError with near names where there is none."""
        if name not in self.files:
            hint = suggest(name, self.files) or "`heavebond library` lists every component."
            raise ModelError([Problem("component-unknown", f"there is no component '{name}'", place, hint)])
        if name in self.twice:
            files = either(p.name for p in self.twice[name])
            raise ModelError([Problem("component-twice", f"two files describe a component '{name}', {files}", place,
                                      "Give one of them another name.")])
        if self.files[name].suffix == ".fmu":
            return _foreign(self.files[name], place)
        return _load(self.files[name], tuple(self.domains.values()))


def library(folders: Iterable[Path] = ()) -> Library:
    """The bundled library with the components of the user's `folders` (each with its `components/`) before it."""
    files: dict[str, Path] = {}
    twice: dict[str, tuple[Path, Path]] = {}
    for folder in folders:
        for path in (*sorted(folder.glob("*.yaml")), *sorted((folder / "components").rglob("*.yaml")),
                     *sorted(folder.glob("*.fmu")), *sorted((folder / "components").rglob("*.fmu"))):
            name = path.name if path.suffix == ".fmu" else _name_in(path)
            if name in files:
                twice[name] = (files[name], path)
            elif name:
                files[name] = path
    for name, path in _bundled_files().items():
        files.setdefault(name, path)
    return Library(domains(), files, twice)


def is_bundled(path: Path) -> bool:
    """Whether a file came with heavebond."""
    return any(path.resolve().is_relative_to(bundled(folder).resolve()) for folder in ("components", "models"))


def example(component: Component) -> Path | None:
    """The smallest diagram that shows a component of the library, `models/examples/` with the name of its file; None where
    there is none."""
    path = bundled("models") / "examples" / component.path.name
    inside = component.path.resolve().is_relative_to(bundled("components").resolve())
    return path if inside and path.is_file() else None


@lru_cache(maxsize=1)
def _bundled_files() -> Dictionary[str, Path]:
    files: dict[str, Path] = {}
    for path in sorted(bundled("components").rglob("*.yaml")):
        if name := _name_in(path):
            files[name] = path
    return files


def _name_in(path: Path) -> str:
    """The name of the component that a file describes, empty where it describes none."""
    try:
        found = _HEAD.search(read_text(path))
    except ModelError:
        return ""  # an unreadable neighbour is no fault of the diagram that is being loaded
    return found.group(1) if found else ""


@lru_cache(maxsize=1)
def domains() -> dict[str, Domain]:
    """The domains of the library by name, from `components/domains.yaml`."""
    path = bundled("components") / "domains.yaml"
    source = read(path, shown_path(path), bundled=True)
    problems = Problems()
    found = {}
    for name, node in source.root.items.items():
        entry = reading.mapping(node, name, problems)
        if entry is not None and name != "signal":
            found[name] = _domain(name, entry, problems)
    problems.raise_as(ModelError)
    return found


@lru_cache(maxsize=1)
def effect_classes() -> Dictionary[str, str]:
    """Classes of effects that are special cases and the class of each (`components/effect_classes.yaml`)."""
    path = bundled("components") / "effect_classes.yaml"
    source = read(path, shown_path(path), bundled=True)
    problems = Problems()
    found = {}
    for name, node in source.root.items.items():
        entry = reading.mapping(node, name, problems)
        if entry is not None:
            reading.known_keys(entry, ("is",), f"class '{name}'", problems, required=("is",))
            found[name] = reading.text(entry.items.get("is"), "is", problems)
    problems.raise_as(ModelError)
    return found


def same_class(one: str, other: str) -> bool:
    """Whether two classes of effects are one, or one is a special case of the other."""
    parents = effect_classes()
    return one == other or parents.get(one) == other or parents.get(other) == one


def _domain(name: str, node: Mapping, problems: Problems) -> Domain:
    keys = ("effort", "flow", "across", "through", "position", "power", "members", "doc", "reference", "medium",
            "fills", "relative", "colour", "pale", "determined_by", "compliance")
    reading.known_keys(node, keys, f"domain '{name}'", problems, required=("across", "through", "members"))
    members = {}
    entries = reading.mapping(node.items.get("members"), "members", problems)
    for key, item in (entries.items if entries else {}).items():
        entry = reading.mapping(item, key, problems)
        if entry is None:
            continue
        unit = reading.unit(entry.items.get("unit"), problems) or DIMENSIONLESS
        low, nominal, start, physical, largest = (_figure(entry, name, problems) for name in (
            "min", "nominal", "start", "physical", "largest"))
        doc, beyond, noun = (reading.text(entry.items.get(name), name, problems) for name in ("doc", "beyond", "noun"))
        members[key] = Member(key, unit, nominal or 1.0, doc, low, start, physical, beyond, largest, nominal is not None,
                              noun or doc)

    def listed(key: str) -> tuple[str, ...]:
        return tuple(s.text for s in reading.words(node.items.get(key), key, problems))

    def single(key: str) -> str | None:
        return reading.text(node.items.get(key), key, problems) or None

    return Domain(name, members, listed("across"), listed("through"), single("effort"), single("flow"),
                  single("position"), single("power"), single("reference"), single("medium"), _fills(node, problems),
                  reading.choice(node.items.get("relative"), "relative", ("true", "false"), problems) == "true",
                  **{key: found for key in ("colour", "pale", "determined_by", "compliance") if (found := single(key))})


def _fills(node: Mapping, problems: Problems) -> tuple[str, tuple[tuple[str, str], ...]] | None:
    """The component that fills a node without storage, and its settings."""
    entry = reading.mapping(node.items.get("fills"), "fills", problems)
    if entry is None:
        return None
    values = {key: reading.text(item, key, problems) for key, item in entry.items.items()}
    return values.pop("is", ""), tuple(values.items())


def _figure(entry: Mapping, key: str, problems: Problems) -> float | None:
    node = entry.items.get(key)
    found = reading.value(node, key, problems) if node is not None else None
    return constant(found.expr) if found is not None else None


@lru_cache(maxsize=1024)
def _load_cached(path: Path, shown: str, stamp: tuple[int, int], names: tuple[str, ...]) -> Component:
    return parse_component(read(path, shown, bundled=is_bundled(path)), domains())


def _load(path: Path, domains: tuple[Domain, ...]) -> Component:
    status = path.stat()
    stamp = (status.st_mtime_ns, status.st_size)
    return _load_cached(path.resolve(), shown_path(path), stamp, tuple(d.name for d in domains))


def _foreign(path: Path, place: Place | None) -> Component:
    """The component that an FMU amounts to."""
    status = path.stat()
    try:
        return _foreign_cached(path.resolve(), (status.st_mtime_ns, status.st_size))
    except ModelError as error:
        raise ModelError([replace(p, place=p.place or place) for p in error.problems]) from error


@lru_cache(maxsize=64)
def _foreign_cached(path: Path, stamp: tuple[int, int]) -> Component:
    text, foreign = described(path)
    return replace(parse_component(parse(text, path, path.name), domains()), foreign=foreign)


def shown_path(path: Path) -> str:
    """A file as messages name it: `components/...` and `models/...` for what is bundled."""
    resolved = path.resolve()
    for folder in ("components", "models"):
        root = bundled(folder).resolve()
        if root in resolved.parents:
            return f"{folder}/{resolved.relative_to(root)}"
    return short_path(path)
