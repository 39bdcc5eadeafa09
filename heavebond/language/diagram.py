"""Diagrams that are built in Python: the same sections, checks and messages as a YAML file, with the lines of the program.

    rig = Diagram("rig")
    rig.add("Fixed", "wall")
    rig.add("Spring", "spring", c="42 kN/m")
    rig.add("Mass", "load", m="250 kg")
    rig.connect("wall.a", "spring.a")
    rig.connect("spring.b", "load.a", node="load")
"""

from __future__ import annotations

from collections.abc import Mapping as Dictionary
from dataclasses import replace
from pathlib import Path
from typing import Any

from heavebond.core import facade
from heavebond.core.errors import HeavebondError, ModelError, Place, Problem, UsageError, listing, suggest
from heavebond.core.presentation import brief, count
from heavebond.core.units import is_generic
from heavebond.core.writable import write_text
from heavebond.language.component_file import COMPONENT_KEYS, parse_component
from heavebond.language.definition import Component
from heavebond.language.library import Library, library
from heavebond.language.model import MODEL_KEYS, Model, find, from_source
from heavebond.text.expression import calling
from heavebond.text.python_source import PythonCall, calling_place, node_of, plain, yaml_text
from heavebond.text.yaml_source import Mapping, Node, Scalar, Sequence, Source, read

NAMED = ("parameters", "set", "vary", "initial", "nominal", "clocks", "show", "simulate", "view", "layout")
NOT_SECTIONS = ("model", "components", "nodes")


class Diagram:
    """A diagram that is built step by step; every function that takes a model takes it.

    `name` and `summary` are those of the diagram, `extends` is the path or bundled name of another one that it changes.
    Files in it, and components of your own, are looked up in `folder`. Values are text with a unit (`"42 kN/m"`), formulas
    (`"=2*spring.c"`), quantities of pint, or plain numbers in the base unit of the parameter. Mistakes are reported when
    the diagram is used, with the line of the program; only a name that is used twice is reported at once.
    """

    def __init__(self, name: str, summary: str = "", *, extends: str | Path = "", folder: str | Path = ".") -> None:
        call = calling_place()
        self.folder = Path(folder)
        self._place = call.place(name, f"model: {name}")
        self._sections: dict[str, Node] = {}
        self._keys: dict[str, Scalar] = {}
        self._definitions: dict[str, Mapping] = {}
        self._known: Library | None = None  # for units of numbers; read again for a component that it does not have
        for key, value in (("model", name), ("summary", summary), ("extends", extends)):
            if value:
                self._put(key, node_of(value, key, call), call)

    @classmethod
    def from_dict(cls, content: Dictionary[str, Any], *, folder: str | Path = ".") -> Diagram:
        """A diagram from a dictionary with the sections of a file, `{"model": "rig", "components": {...}, ...}`. Raises
        UsageError if it has no name."""
        if not isinstance(content.get("model"), str):
            raise UsageError([Problem("not-a-model", "the dictionary has no `model`, the name of the diagram", None,
                                      suggest("model", content) or 'Add "model": "rig".')])
        diagram = cls(content["model"], folder=folder)
        call = calling_place()
        for key, value in content.items():
            diagram._put(key, node_of(value, key, call), call)
        return diagram

    @classmethod
    def read(cls, name: str | Path) -> Diagram:
        """The diagram of a YAML file or a bundled one, to be changed; it keeps the lines of the file in messages. Raises
        UsageError if it does not exist, ModelError if it is not YAML."""
        path = find(name)
        source = read(path)
        title = source.root.items.get("model")
        diagram = cls(title.text if isinstance(title, Scalar) else path.stem, folder=path.parent)
        diagram._sections, diagram._keys = dict(source.root.items), dict(source.root.keys)
        diagram._place = source.root.place
        return diagram

    # -- building ------------------------------------------------------------------------------------------------------
    def add(self, kind: str, name: str, settings: Dictionary[str, Any] | None = None, **more: Any) -> Diagram:
        """Add a part of a kind, the name of a component: `add("Mass", "load", m="250 kg")`.

        Values of parameters and signal inputs are keywords, or `settings` for names that are no keywords (`"x[1]"`);
        `at=[column, row]` is its place in the drawing. A plain number is in the base unit of its parameter. Returns the
        diagram. Raises ModelError if the diagram has a part of this name.
        """
        call = calling_place()
        parts = self._section("components", call)
        if name[:1].isupper() and str(kind)[:1].islower() and name in self._library().files:
            raise ModelError([Problem("component-unknown", f"'{name}' is a component, '{kind}' is none",
                                      call.place(name, name), f'The component comes first: add("{name}", "{kind}").')])
        if name in parts.items:
            raise self._twice("component", name, parts, call)
        entry = node_of({"is": kind, **(settings or {}), **more}, name, call)
        assert isinstance(entry, Mapping)
        parts.items[name], parts.keys[name] = self._with_units(kind, entry), Scalar(name, call.place(name, name))
        return self

    def connect(self, *ports: str, node: str = "") -> Diagram:
        """Connect ports (`"spring.b"`): put them on one node.

        A port that is on a node already brings its node with it; nodes that are joined become one. `node` names the node;
        without it a new node has the name of its first port, with `_` for the point: `spring_b`. Its variables are
        available as `spring_b.x` and as those of each port (`spring.b.x`). Returns the diagram. Raises ModelError if two
        named nodes would be joined, UsageError without ports.
        """
        call = calling_place()
        for port in (*ports, node):
            if not isinstance(port, str):
                raise UsageError([Problem("python-value", f"a {type(port).__name__} is not the name of a port or a node",
                                          call.place("connect", "connect()"),
                                          'Write the ports one after the other: connect("spring.b", "load.a").')])
        if not ports or (len(ports) < 2 and not node):
            raise UsageError([Problem("connect-alone", "connect needs two ports", call.place("connect", "connect()"),
                                      'Write for example connect("spring.b", "load.a").')])
        nodes = self._section("nodes", call)
        joined = dict.fromkeys([*([node] if node in nodes.items else []),
                                *(old for port in ports if (old := next((
                                    name for name, ends in nodes.items.items()
                                    if port in (end.text for end in _ends(ends))), None)) is not None)])
        named = [old for old in joined if old != self._automatic(nodes.items[old])]
        if len(named) + (bool(node) and node not in named) > 1:
            both = [*named, *([node] if node and node not in named else [])]
            raise ModelError([Problem("nodes-joined", f"this joins the nodes {listing(both)}, which have names of their own",
                                      call.place(ports[0], f"connect({', '.join(ports)})"),
                                      f'Connect all ports with node="{both[0]}" from the start.')])
        ends = [end for old in joined for end in _ends(nodes.items[old])]
        known = {end.text for end in ends}
        ends += [Scalar(port, call.place(port, port)) for port in dict.fromkeys(ports) if port not in known]
        name = node or (named[0] if named else ends[0].text.replace(".", "_"))
        for old in joined:
            del nodes.items[old], nodes.keys[old]
        nodes.items[name] = Sequence(tuple(ends), ends[0].place)
        nodes.keys[name] = Scalar(name, call.place(node or ports[0], name))
        return self

    def show(self, name: str, formula: str = "", *, unit: str = "") -> Diagram:
        """Add an output: its `name`, the `formula` (by default the name, which is then a variable) and the `unit` in which
        it is shown (required), `show("place", "load.x", unit="mm")`. Returns the diagram. Raises ModelError for a name that
        is used twice."""
        call = calling_place()
        outputs = self._section("show", call)
        if name in outputs.items:
            raise self._twice("output", name, outputs, call)
        entry = {key: value for key, value in (("is", formula), ("unit", unit)) if value}
        outputs.items[name] = node_of(entry, name, call)
        outputs.keys[name] = Scalar(name, call.place(name, name))
        return self

    def initial(self, values: Dictionary[str, Any] | None = None, *, start: str = "", solve: list[str] | None = None
                ) -> Diagram:
        """Set initial values by name, `initial({"load.x": "20 mm"})`; `start` is steady or rest, `solve` names the
        parameters that the start determines. Returns the diagram."""
        return self._merge("initial", {**({"start": start} if start else {}), **(values or {}),
                                       **({"solve": solve} if solve else {})}, calling_place())

    def update(self, **sections: Any) -> Diagram:
        """Set entries of other sections, in the form of the file: `update(simulate={"until": "60 s", "every": "20 ms"},
        parameters={"m_load": "1.2 t"})`. Returns the diagram. Raises UsageError for an unknown section."""
        call = calling_place()
        allowed = [key for key in MODEL_KEYS if key not in NOT_SECTIONS]
        for key, value in sections.items():
            if key not in allowed:
                instead = {"components": 'add("Mass", "load", m="250 kg")', "nodes": 'connect("spring.b", "load.a")'}
                raise UsageError([Problem("key-unknown", f"`update` cannot set the section '{key}'", call.place(key, key),
                                          f"Write {instead[key]} for each." if key in instead else
                                          suggest(key, allowed) or f"Sections: {', '.join(allowed)}.")])
            if isinstance(value, Dictionary):
                self._merge(key, value, call)
            elif key in NAMED:
                example = {"simulate": '{"until": "60 s", "every": "20 ms"}'}.get(key, '{"name": ...}')
                message = f"the section '{key}' is a dictionary, not a {type(value).__name__}"
                raise UsageError([Problem("not-a-mapping", message, call.place(key, key),
                                          f"Write update({key}={example}).")])
            else:
                self._put(key, node_of(value, key, call), call)
        return self

    def define(self, name: str, **content: Any) -> Diagram:
        """Define a component for this diagram, with the entries of a component file: `define("Snubber", summary="...",
        ports={"a": "translational"}, parameters={"k": {"unit": "N*s/m", "doc": "..."}}, equations=["a.f = k*a.v"])`.

        Returns the diagram. Raises ModelError with the mistakes in the component, its units and its laws, and for a name
        that is defined twice, UsageError for an unknown entry.
        """
        call = calling_place()
        unknown = [key for key in content if key not in COMPONENT_KEYS]
        if unknown:
            raise UsageError([Problem("key-unknown", f"a component has no entry '{unknown[0]}'",
                                      call.place(unknown[0], unknown[0]),
                                      suggest(unknown[0], COMPONENT_KEYS) or f"Entries: {', '.join(COMPONENT_KEYS)}.")])
        if name in self._definitions:
            raise ModelError([Problem("name-twice", f"the component '{name}' is defined twice", call.place(name, name),
                                      "Give one of them another name.")])
        root = node_of({"component": name, **content}, name, call)
        assert isinstance(root, Mapping)
        self._definitions[name], self._known = root, None
        try:
            self._library().checked(name)
        except HeavebondError:
            del self._definitions[name]
            self._known = None
            raise
        return self

    def remove(self, name: str) -> Diagram:
        """Remove a part and its ends on nodes. Returns the diagram. Raises ModelError if there is none of this name."""
        call = calling_place()
        parts, nodes = self._section("components", call), self._section("nodes", call)
        if name not in parts.items:
            raise ModelError([Problem("remove-unknown", f"there is no component '{name}' to remove", call.place(name, name),
                                      suggest(name, parts.items) or f"Components: {listing(parts.items)}.")])
        del parts.items[name], parts.keys[name]
        for node, ends in list(nodes.items.items()):
            remaining_ends = tuple(end for end in _ends(ends) if end.text.partition(".")[0] != name)
            nodes.items[node] = Sequence(remaining_ends, ends.place)
            if not remaining_ends:
                del nodes.items[node], nodes.keys[node]
        return self

    # -- using ---------------------------------------------------------------------------------------------------------
    def model(self) -> Model:
        """The diagram as a Model, as it is now; ModelError with all mistakes and the lines of the program."""
        source = Source(self.folder / f"{self.name}.yaml", self._place.file, self._root(), "")
        return from_source(source, components=self._components())

    @property
    def name(self) -> str:
        """The name of the diagram."""
        head = self._sections["model"]
        return head.text if isinstance(head, Scalar) else ""

    def as_dict(self) -> dict[str, Any]:
        """The diagram as dictionaries, lists and texts, as `from_dict` reads them; components of `define` are not in it."""
        content = plain(self._root())
        assert isinstance(content, dict)
        return content

    def yaml(self) -> str:
        """The text of the file of the diagram, which `loads` reads back; components of `define` need files of their own,
        see `save`."""
        return yaml_text(self._root())

    def save(self, path: str | Path) -> Path:
        """Write the diagram to a YAML file, and each component of `define` to `components/NAME.yaml` beside it; return the
        path. Raises UsageError if a file cannot be written."""
        path = Path(path)
        files = {path: self.yaml(), **{path.parent / "components" / f"{name}.yaml": yaml_text(root)
                                       for name, root in self._definitions.items()}}
        if path.suffix not in (".yaml", ".yml"):
            raise UsageError([Problem("file-suffix", f"'{path}' does not end in .yaml", None,
                                      f"Write {path.with_suffix('.yaml').name}.")])
        for file, text in files.items():
            try:
                file.parent.mkdir(parents=True, exist_ok=True)
                write_text(file, text)
            except OSError as error:
                raise UsageError([Problem("file-unwritable", f"'{file}' cannot be written: {error.strerror}")]) from None
        return path

    def __eq__(self, other: object) -> bool:
        """Equal content; the order of keys and the places of the lines do not count."""
        if not isinstance(other, Diagram):
            return NotImplemented
        return self.as_dict() == other.as_dict() and {name: plain(root) for name, root in self._definitions.items()} == {
            name: plain(root) for name, root in other._definitions.items()}

    __hash__ = None  # type: ignore[assignment]  # it can be changed

    def __repr__(self) -> str:
        sizes = [count(len(_entries(self._sections.get(key))), word) for key, word in (
            ("components", "part"), ("nodes", "node"), ("show", "output"))]
        return brief(self, self.name, ", ".join(sizes))

    def _repr_html_(self) -> str:
        """The drawing and the table of parameters, for notebooks; the mistakes of a diagram that cannot be drawn."""
        html: str = facade.call("Diagram._repr_html_", self)
        return html

    # -- inside --------------------------------------------------------------------------------------------------------
    def _root(self) -> Mapping:
        return Mapping(dict(self._sections), dict(self._keys), self._place)

    def _put(self, key: str, node: Node, call: PythonCall) -> None:
        self._sections[key], self._keys[key] = node, Scalar(key, call.place(key, key))

    def _section(self, key: str, call: PythonCall) -> Mapping:
        """The section as a mapping that can be changed; it is created at its first use."""
        section = self._sections.get(key)
        if not isinstance(section, Mapping):
            section = Mapping({}, {}, call.place(key, key))
            self._put(key, section, call)
        return section

    def _merge(self, key: str, values: Dictionary[str, Any], call: PythonCall) -> Diagram:
        section, added = self._section(key, call), node_of(values, key, call)
        assert isinstance(added, Mapping)
        section.items.update(added.items)
        section.keys.update(added.keys)
        return self

    def _with_units(self, kind: str, entry: Mapping) -> Mapping:
        """The entry of a part in which plain numbers have the base unit of their parameter or input."""
        items = dict(entry.items)
        for name, node in entry.items.items():
            if isinstance(node, Scalar) and name not in ("is", "repeat") and _is_number(node.text):
                unit = self._unit(kind, name.partition("[")[0])
                items[name] = replace(node, text=f"{node.text} {unit}" if unit else node.text)
        return replace(entry, items=items)

    def _unit(self, kind: str, name: str) -> str:
        """The base unit of a parameter or a signal input; empty without one, or for an unknown component."""
        if self._known is None or kind not in self._known.files:
            self._known = self._library()
        try:
            component = self._known.component(kind)
        except HeavebondError:
            return ""
        declared = component.parameters.get(name) or component.signals.get(name)
        if declared is None or getattr(declared, "integer", False) or is_generic(declared.unit.dimension):
            return ""
        return "" if declared.unit.text == "1" else declared.unit.text

    def _library(self) -> Library:
        return library([self.folder]).with_components(self._components())

    def _components(self) -> dict[str, Component]:
        """The components of `define`; one may use or extend those before it."""
        components: dict[str, Component] = {}
        for name, root in self._definitions.items():
            known = library([self.folder]).with_components(components)
            source = Source(self.folder / "components" / f"{name}.yaml", root.place.file, root, "")
            extended = root.items.get("extends")
            base = known.component(extended.text, extended.place) if isinstance(extended, Scalar) else None
            with calling(known.functions):
                components[name] = parse_component(source, known.domains, base)
        return components

    @staticmethod
    def _automatic(node: Node) -> str:
        """The name that a node has without one of its own."""
        ends = _ends(node)
        return ends[0].text.replace(".", "_") if ends else ""

    @staticmethod
    def _twice(noun: str, name: str, section: Mapping, call: PythonCall) -> ModelError:
        first: Place = section.keys[name].place
        return ModelError([Problem("name-twice", f"there is already a{'n' * (noun == 'output')} {noun} '{name}', of "
                                   f"{first.file}:{first.line}", call.place(name, name), "Give one of them another name.")])


def _ends(node: Node) -> list[Scalar]:
    items = node.items if isinstance(node, Sequence) else (node,)
    return [item for item in items if isinstance(item, Scalar)]


def _entries(node: Node | None) -> dict[str, Node]:
    return node.items if isinstance(node, Mapping) else {}


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
