"""The library: lookup of components and functions by name."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from collections.abc import Mapping as Dictionary
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache
from pathlib import Path
from stat import S_ISREG

from heavebond.core.errors import ModelError, Place, Problem, Problems, either
from heavebond.core.native_permission import native_allowed
from heavebond.core.units import DIMENSIONLESS
from heavebond.language import laws, reading
from heavebond.language.component_file import parse_component
from heavebond.language.definition import Component, Domain, Member
from heavebond.language.fmu_description import described
from heavebond.language.function_file import parse_function
from heavebond.language.lists import Same
from heavebond.language.near_names import near_components
from heavebond.text.expression import Expr, ExpressionProblem, Function, calling, constant, functions_in, parse_formula
from heavebond.text.yaml_source import Mapping, Scalar, parse, read, read_text, short_path

_HEAD = re.compile(r"""^(component|function):[ \t]+["']?([^"'#\n]+?)["']?[ \t]*(?:#.*)?$""", re.MULTILINE)
_EXTENDS = re.compile(r"""^["']?extends["']?[ \t]*:""", re.MULTILINE)
HEAD_BYTES = 400
_EXTERNAL = re.compile(r"""^["']?is["']?[ \t]*:[ \t]*["']?external\b""", re.MULTILINE)
_EFFECT = re.compile(r"""^["']?effect["']?[ \t]*:""", re.MULTILINE)


@cache
def bundled(folder: str) -> Path:
    """The folder `components` or `models`: inside an installed package, or next to it in a working copy."""
    inside = Path(__file__).parents[1] / folder
    return inside if inside.is_dir() else Path(__file__).parents[2] / folder


@cache
def _resolved(folder: str) -> Path:
    return bundled(folder).resolve()


# name, file, its time of change and size; of an external function also the digest of its program
OwnFunction = tuple[str, Path, tuple[int | str, ...]]


@dataclass(frozen=True, eq=False)
class Functions(Dictionary[str, Function]):
    """The functions of files by name, each read at its first use: the user's, in the present state of their files, and
    the library's. `twice`: names in two of the user's files; `allow_native`: the programs of external functions may be
    executed. Created by `_functions`."""

    own: tuple[OwnFunction, ...]
    twice: tuple[tuple[str, tuple[Path, Path]], ...]
    files: dict[str, Path]
    allow_native: bool = False
    _read: dict[str, Function] = field(default_factory=dict)
    _reading: list[str] = field(default_factory=list)

    def __hash__(self) -> int:
        return id(self)

    def __eq__(self, other: object) -> bool:
        return self is other

    def __reduce__(self) -> tuple[object, ...]:
        """Unpickle to the existing object for the same files: components are cached by it."""
        return _functions, (self.own, self.twice, self.allow_native)

    def __iter__(self) -> Iterator[str]:
        return iter(self.files)

    def __len__(self) -> int:
        return len(self.files)

    def __contains__(self, name: object) -> bool:
        return name in self.files

    def __getitem__(self, name: str) -> Function:
        """The function; ModelError with the mistakes in its file, ExpressionProblem if it cannot be called."""
        if paths := dict(self.twice).get(name):
            raise ExpressionProblem("function-twice", "two files describe a function "
                                    f"'{name}', {either(p.name for p in paths)}", 0, 1,
                                    "Give one of them another name.")
        if name in self._reading:
            circle = [*self._reading[self._reading.index(name):], name]
            raise ExpressionProblem("function-circle", f"'{name}' calls itself" if len(circle) == 2 else
                                    "functions call each other in a circle: " + " > ".join(circle), 0, 1,
                                    "A function is evaluated line by line; remove one of these calls.")
        if name not in self._read:
            path = self.files[name]
            self._reading.append(name)
            try:
                with calling(self):
                    self._read[name] = parse_function(read(path, shown_path(path), bundled=is_bundled(path)),
                                                      self.allow_native)
            finally:
                self._reading.pop()
        return self._read[name]


@dataclass(frozen=True)
class Library:
    """Domains, and the file of each component and each function; the user's folders come first. `defined`: components
    without a file, such as those of a diagram that is built in Python."""

    domains: dict[str, Domain]
    files: dict[str, Path]
    # names in two of the user's files
    twice: dict[str, tuple[Path, Path]] = field(default_factory=dict)
    functions: Functions = field(default_factory=lambda: library_functions())
    defined: dict[str, Component] = field(default_factory=dict)

    def with_components(self, components: Dictionary[str, Component]) -> Library:
        """A library in which these components take precedence over those of files."""
        paths = {name: component.path for name, component in components.items()}
        twice = {name: files for name, files in self.twice.items() if name not in components}
        return replace(self, files={**self.files, **paths}, twice=twice, defined={**self.defined, **components})

    def formula(self, text: str, functions: Dictionary[str, int] | None = None) -> Expr:
        """Parse a formula of a diagram with `parse_formula`; it may call the functions of the library."""
        with calling(self.functions):
            return parse_formula(text, functions=functions)

    def names(self) -> list[str]:
        """Every component in a file of the language, in the order of the files. FMUs can be used by name, but are not
        listed: a folder may contain FMUs that are not components."""
        return [name for name, path in self.files.items() if path.suffix != ".fmu"]

    def user_files(self) -> dict[str, Path]:
        """The file of each component that is in one of the user's folders."""
        known = _bundled_files()["component"]
        return {name: path for name, path in self.files.items() if path != known.get(name)}

    def effects(self) -> list[Component]:
        """The components that have an `effect:`, in the order of their files; the others are not parsed."""
        having = (name for name in self.names() if name in self.defined
                  or _has_effect(self.files[name].absolute(), _stamp(self.files[name])))
        return [component for component in map(self.component, having) if component.effect is not None]

    def component(self, name: str, place: Place | None = None) -> Component:
        """The component `name`; ModelError with similar names if it does not exist."""
        if name in self.defined:
            return self.defined[name]
        if name not in self.files:
            hint = near_components(name, self.files)
            raise ModelError([Problem("component-unknown", f"there is no component '{name}'", place, hint)])
        if name in self.twice:
            files = either(p.name for p in self.twice[name])
            raise ModelError([Problem("component-twice", f"two files describe a component '{name}', {files}", place,
                                      "Give one of them another name.")])
        if self.files[name].suffix == ".fmu":
            return _foreign(self.files[name], place)
        return _load_cached(*self._state(name), self._same_base(name))

    def base(self, path: Path, chain: tuple[Path, ...] = ()) -> Component | None:
        """The component that a file extends, or None; ModelError if it does not exist."""
        head = _extends(path.absolute(), _stamp(path))
        if head is None:
            return None
        chain = (*chain, path.resolve())
        following = self.files.get(head.text)
        if following is not None and following.resolve() in chain:
            raise ModelError([Problem("extends-circle", f"'{head.text}' extends itself" + " over others" * (len(chain) > 1),
                                      head.place, "Extend a component that contains equations, or remove `extends:`.")])
        if following is not None and following.suffix != ".fmu":
            self.base(following, chain)
        return self.component(head.text, head.place)

    def checked(self, name: str, place: Place | None = None) -> Component:
        """The component with its laws checked, once for each state of its file; ModelError with all mistakes."""
        component = self.component(name, place)
        if component.foreign is not None or name in self.defined:
            if not component.composite:
                laws.check(component, self.domains)
            return component
        return _checked_cached(*self._state(name), self._same_base(name))

    def _same_base(self, name: str) -> Same | None:
        base = self.base(self.files[name])
        return None if base is None else Same(base)

    def _state(self, name: str) -> tuple[Path, tuple[int, int], tuple[str, ...], Functions]:
        """The state on which a component depends: its file as it is now, the domains and the functions."""
        path = self.files[name].absolute()
        return path, _stamp(path), tuple(self.domains), self.functions


@lru_cache(maxsize=4096)
def _has_effect(path: Path, stamp: tuple[int, int]) -> bool:
    """True if a file has the key `effect:`."""
    return _EFFECT.search(read_text(path)) is not None


@lru_cache(maxsize=1024)
def _extends(path: Path, stamp: tuple[int, int]) -> Scalar | None:
    """The name of the component that the file extends; None if it extends none."""
    if not _EXTENDS.search(read_text(path)):
        return None
    head = read(path, shown_path(path), bundled=is_bundled(path)).root.items.get("extends")
    return head if isinstance(head, Scalar) else None


def library_functions() -> Functions:
    """The functions of the library without the user's."""
    return _functions((), ())


def library(folders: Iterable[Path] = ()) -> Library:
    """The bundled library with the components of the user's `folders` (each with its `components/`) before it."""
    files: dict[str, dict[str, Path]] = {"component": {}, "function": {}}
    twice: dict[str, dict[str, tuple[Path, Path]]] = {"component": {}, "function": {}}
    for folder in folders:
        for file in _user_files(folder.absolute()):
            kind, name = ("component", os.path.basename(file)) if file.endswith(".fmu") else _head_of(file)
            if not name:
                continue
            path = folder / os.path.relpath(file, folder.absolute())
            if name in files[kind] and files[kind][name].resolve() != path.resolve():
                twice[kind][name] = (files[kind][name], path)
            else:
                files[kind][name] = path
    user_functions = tuple((name, path, _function_stamp(path)) for name, path in files["function"].items())
    for kind, known in _bundled_files().items():
        for name, path in known.items():
            files[kind].setdefault(name, path)
    return Library(domains(), files["component"], twice["component"],
                   _functions(user_functions, tuple(twice["function"].items()), native_allowed()))


@lru_cache(maxsize=64)
def _functions(own: tuple[OwnFunction, ...], twice: tuple[tuple[str, tuple[Path, Path]], ...], native: bool = False
               ) -> Functions:
    """The library's functions with the user's before them; the same object for unchanged files."""
    return Functions(own, twice, {**_bundled_files()["function"], **{name: path for name, path, _ in own}}, native)


def joined_functions(folder: Path, inherited: Functions, own: Functions) -> Functions:
    """The functions for a diagram in a folder that extends a diagram of another folder: those of its folder before the
    inherited ones.
    """
    local = {entry[0]: entry for entry in own.own if folder.resolve() in entry[1].resolve().parents}
    if not local:
        return inherited
    every = {**{entry[0]: entry for entry in inherited.own}, **local}
    return _functions(tuple(every.values()), tuple({**dict(inherited.twice), **dict(own.twice)}.items()), own.allow_native)


def _stamp(path: Path) -> tuple[int, int]:
    status = path.stat()
    return status.st_mtime_ns, status.st_size


def _function_stamp(path: Path) -> tuple[int | str, ...]:
    """The state of a function's file and of its program with the files that it includes."""
    stamp = _stamp(path)
    try:
        if (program := _program(path, stamp)) is None:
            return stamp
        from heavebond.language.external_functions import digest  # import CasADi only for external functions

        return *stamp, digest(program)
    except (OSError, ModelError):  # an error of the function, if it is called
        return stamp


@lru_cache(maxsize=1024)
def _program(path: Path, stamp: tuple[int, int]) -> Path | None:
    """The program that the file of an external function names."""
    text = read_text(path)
    if not _EXTERNAL.search(text):
        return None
    file = read(path, shown_path(path)).root.items.get("file")
    return path.parent / file.text if isinstance(file, Scalar) else None


def is_bundled(path: Path) -> bool:
    return any(path.resolve().is_relative_to(_resolved(folder)) for folder in ("components", "models"))


def example(component: Component) -> Path | None:
    """The smallest diagram with a component of the library, `models/examples/` with the name of its file; None without
    one."""
    path = bundled("models") / "examples" / component.path.name
    inside = component.path.resolve().is_relative_to(bundled("components").resolve())
    return path if inside and path.is_file() else None


def called_functions(component: Component) -> list[Function]:
    """The functions of files that a component calls, in the order of its file."""
    formulas = [component.stores, component.dissipates, component.unbalanced, *component.requires,
                *(formula for relation in component.frames for _, formula, _ in relation.formulas)]
    for event in component.when:
        formulas += [event.formula, *(reset.value for reset in event.resets)]
    trees = [side for line in component.equations for side in (line.tree.left, line.tree.right)]
    trees += [formula.tree for formula in formulas if formula is not None]
    return list(dict.fromkeys(function for tree in trees for function in functions_in(tree)))


def _bundled_files() -> dict[str, dict[str, Path]]:
    """The files of the library by kind and name; listed anew if a file has been added to one of its folders or removed."""
    return _listed(tuple(os.stat(folder).st_mtime_ns for folder in _bundled_folders()))


@cache
def _bundled_folders() -> list[str]:
    return [folder for folder, _, _ in os.walk(bundled("components"))]


@lru_cache(maxsize=1)
def _listed(stamps: tuple[int, ...]) -> dict[str, dict[str, Path]]:
    files: dict[str, dict[str, Path]] = {"component": {}, "function": {}}
    for path in _files_below(bundled("components")):
        with open(path, "rb") as file:  # the library's heads are on the first lines
            whole_lines = file.read(HEAD_BYTES).replace(b"\r\n", b"\n").rpartition(b"\n")[0]
        head = _HEAD.search(whole_lines.decode("utf-8", "replace"))
        kind, name = (head.group(1), head.group(2)) if head else _head_of(path)
        if name:
            files[kind][name] = Path(path)
    return files


def _user_files(folder: Path) -> list[str]:
    """The YAML files and the FMUs in a folder and below its `components`, in the order in which they are read; in a working
    copy of heavebond the latter are the library's. Strings: a folder may hold hundreds of diagrams, of which a library takes
    none."""
    try:
        names = sorted(os.listdir(folder))
    except OSError:
        names = []
    below = folder / "components"
    return [file for suffix in (".yaml", ".fmu") for file in (
        *(os.path.join(folder, name) for name in names if name.endswith(suffix)),
        *(_files_below(below, suffix) if below.resolve() != _resolved("components") else ()))]


def _files_below(top: Path, suffix: str = ".yaml") -> list[str]:
    """The files of a kind in a folder and those below it."""
    paths = (os.path.join(folder, name) for folder, _, names in os.walk(top) for name in names if name.endswith(suffix))
    return sorted(paths, key=lambda path: path.split(os.sep))


def _head_of(path: str) -> tuple[str, str]:
    """`component` or `function` and the name; empty for other files."""
    try:
        status = os.stat(path)
        # reading a pipe would block
        return _head_in(path, (status.st_mtime_ns, status.st_size)) if S_ISREG(status.st_mode) else ("", "")
    except (OSError, ModelError):
        return "", ""  # an unreadable file in the same folder does not make the diagram wrong


@lru_cache(maxsize=4096)
def _head_in(path: str, stamp: tuple[int, int]) -> tuple[str, str]:
    """The same for one state of a file; ModelError if it cannot be read."""
    head_match = _HEAD.search(read_text(Path(path)))
    return (head_match.group(1), head_match.group(2)) if head_match else ("", "")


@lru_cache(maxsize=1)
def domains() -> dict[str, Domain]:
    """The domains of the library by name, from `components/domains.yaml`."""
    path = bundled("components") / "domains.yaml"
    source = read(path, shown_path(path), bundled=True)
    problems = Problems()
    domains_by_name = {}
    for name, node in source.root.items.items():
        entry = reading.mapping(node, name, problems)
        if entry is not None and name != "signal":
            domains_by_name[name] = _domain(name, entry, problems)
    problems.raise_as(ModelError)
    return domains_by_name


KINDS = ("rate", "displacement", "acceleration", "storage", "source", "transport", "variation", "measurement")


@lru_cache(maxsize=1)
def _effect_classes() -> Dictionary[str, tuple[str, str]]:
    """Each class of effects with its general class, or else its kind (see KINDS), from `components/effect_classes.yaml`."""
    path = bundled("components") / "effect_classes.yaml"
    source = read(path, shown_path(path), bundled=True)
    problems = Problems()
    classes = {}
    for name, node in source.root.items.items():
        entry = reading.mapping(node, name, problems)
        if entry is not None:
            reading.known_keys(entry, ("is", "kind"), f"class '{name}'", problems)
            classes[name] = (reading.text(entry.items.get("is"), "is", problems),
                             reading.text(entry.items.get("kind"), "kind", problems))
    problems.raise_as(ModelError)
    return classes


def effect_classes() -> Dictionary[str, str]:
    """Classes of effects that are special cases and the class of each (`components/effect_classes.yaml`)."""
    return {name: parent for name, (parent, _) in _effect_classes().items() if parent}


def effect_kind(name: str) -> str:
    """The kind of a class of effects, one of KINDS; empty for a class that the library does not have."""
    parent, kind = _effect_classes().get(name, ("", ""))
    return effect_kind(parent) if parent else kind


def same_class(one: str, other: str) -> bool:
    """True if two classes of effects are equal, or one is a special case of the other."""
    parents = effect_classes()
    return one == other or parents.get(one) == other or parents.get(other) == one


def _domain(name: str, node: Mapping, problems: Problems) -> Domain:
    keys = ("effort", "flow", "across", "through", "position", "power", "members", "doc", "reference", "medium",
            "fills", "relative", "colour", "pale", "determined_by", "compliance", "vectors", "orientation", "turning",
            "free", "minimal", "idle")
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

    lists = reading.mapping(node.items.get("vectors"), "vectors", problems)
    vectors = {key: tuple(s.text for s in reading.words(item, key, problems)) for key, item in (
        lists.items if lists else {}).items()}
    return Domain(name, members, listed("across"), listed("through"), listed("effort"), listed("flow"),
                  listed("position"), single("power"), single("reference"), single("medium"), _fills(node, problems),
                  reading.choice(node.items.get("relative"), "relative", ("true", "false"), problems) == "true",
                  **{key: found for key in ("colour", "pale", "determined_by", "compliance", "turning", "free", "minimal",
                                            "idle")
                     if (found := single(key))}, vectors=vectors, orientation=listed("orientation"))


def _fills(node: Mapping, problems: Problems) -> tuple[str, tuple[tuple[str, str], ...]] | None:
    """The component that is added to a node without storage, and its settings."""
    entry = reading.mapping(node.items.get("fills"), "fills", problems)
    if entry is None:
        return None
    values = {key: reading.text(item, key, problems) for key, item in entry.items.items()}
    return values.pop("is", ""), tuple(values.items())


def _figure(entry: Mapping, key: str, problems: Problems) -> float | None:
    node = entry.items.get(key)
    quantity = reading.value(node, key, problems) if node is not None else None
    return constant(quantity.expr) if quantity is not None else None


@lru_cache(maxsize=1024)
def _load_cached(path: Path, stamp: tuple[int, int], names: tuple[str, ...], functions: Functions, base: Same | None
                 ) -> Component:
    with calling(functions):
        return parse_component(read(path, shown_path(path), bundled=is_bundled(path)), domains(),
                               None if base is None else base.component)


@lru_cache(maxsize=1024)
def _checked_cached(path: Path, stamp: tuple[int, int], names: tuple[str, ...], functions: Functions, base: Same | None
                    ) -> Component:
    component = _load_cached(path, stamp, names, functions, base)
    laws.check(component, domains())
    return component


def _foreign(path: Path, place: Place | None) -> Component:
    """The component of an FMU."""
    try:
        return _foreign_cached(path.resolve(), _stamp(path))
    except ModelError as error:
        raise ModelError([replace(p, place=p.place or place) for p in error.problems]) from error


@lru_cache(maxsize=64)
def _foreign_cached(path: Path, stamp: tuple[int, int]) -> Component:
    text, foreign = described(path)
    return replace(parse_component(parse(text, path, path.name), domains()), foreign=foreign)


def shown_path(path: Path) -> str:
    """Path of a file for messages: `components/...` and `models/...` for bundled ones."""
    resolved = path.resolve()
    for folder in ("components", "models"):
        root = _resolved(folder)
        if root in resolved.parents:
            return f"{folder}/{resolved.relative_to(root)}"
    return short_path(path)
