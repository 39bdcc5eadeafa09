"""A diagram as a value: read from its file, derived from another by `extends`, changed by functions that return a new
one."""

from __future__ import annotations

from collections.abc import Container, Iterable
from collections.abc import Mapping as Dictionary
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, TypeAlias

from heavebond.core import facade
from heavebond.core.errors import HeavebondError, ModelError, Place, Problem, Problems, UsageError, listing, suggest
from heavebond.core.native_permission import native_code
from heavebond.core.presentation import brief, count
from heavebond.core.quantities import number_or_text
from heavebond.core.units import Unit
from heavebond.language import reading
from heavebond.language.definition import Body, Component, End, FileInput, Formula, Instance, Value, ViewShape, Wire
from heavebond.language.layout import read_layout
from heavebond.language.library import Library, bundled, is_bundled, joined_functions, library, shown_path
from heavebond.language.sections import (
    Clock,
    Condition,
    Initial,
    NamedOutput,
    Setting,
    read_clocks,
    read_initial,
    read_nominal,
    read_plan,
    read_settings,
    read_show,
    read_vary,
)
from heavebond.language.view import read_view
from heavebond.text.expression import Number, calling
from heavebond.text.yaml_source import Node, Scalar, Source, parse, read

if TYPE_CHECKING:
    import networkx as nx

MODEL_KEYS = ("model", "summary", "extends", "parameters", "components", "nodes", "set", "vary", "remove", "initial",
              "nominal", "clocks", "show", "simulate", "view", "layout", "source", "notes")
LONGEST_CHAIN = 50
BUNDLED = "bundled:"  # prefix of the name of a bundled machine


@dataclass(frozen=True)
class Model:
    """A diagram: all declarations of its file and of the files that it extends.

    `load` and `loads` read one; `with_parameters` and `with_component` return a changed one.
    """

    name: str
    summary: str
    path: Path
    library: Library
    parameters: dict[str, Value] = field(default_factory=dict)
    body: Body = field(default_factory=Body)
    settings: dict[str, Setting] = field(default_factory=dict)
    vary: dict[str, Setting] = field(default_factory=dict)
    initial: Initial = field(default_factory=Initial)
    nominal: dict[str, Setting] = field(default_factory=dict)
    clocks: dict[str, Clock] = field(default_factory=dict)
    show: dict[str, NamedOutput] = field(default_factory=dict)
    begin: Value | None = None
    until: Value | None = None
    every: Value | None = None
    solver: Scalar | None = None
    ends: Formula | None = None  # condition for the end of a run; without one it ends at `until`
    largest_step: Value | None = None
    step: Value | None = None
    view: dict[str, ViewShape] = field(default_factory=dict)
    files: tuple[Path, ...] = ()
    approximate: bool = False  # components with delayed variables are replaced by their approximations

    def __repr__(self) -> str:
        sizes = count(len(self.body.instances), "part"), count(len(self.body.wires), "node"), count(len(self.show), "output")
        return brief(self, self.name, ", ".join(sizes), self.summary)

    def graph(self, open_blocks: bool = True) -> nx.Graph[tuple[str, str]]:
        """The diagram as a networkx graph of parts, ports and nodes: see `heavebond.equations.diagram_graph`."""
        graph: nx.Graph[tuple[str, str]] = facade.call("Model.graph", self, open_blocks)
        return graph

    def _repr_svg_(self) -> str | None:
        """The drawing, for notebooks; None for a diagram that cannot be drawn."""
        try:
            return str(facade.call("Model._repr_svg_", self))
        except HeavebondError:
            return None

    def _repr_html_(self) -> str | None:
        """The drawing and the table of parameters, for notebooks; None for a diagram that cannot be drawn."""
        html: str | None = facade.call("Model._repr_html_", self)
        return html

    @property
    def sources(self) -> tuple[Path, ...]:
        """Paths of the diagram's files, including files with lists of values and meshes."""
        settings = [*(v for i in self.body.instances.values() for v in i.settings.values()),
                    *(s.value for s in self.settings.values())]
        return (*self.files, *dict.fromkeys((*(v.file for v in settings if isinstance(v, Value) and v.file),
                                             *(shape.file for shape in self.view.values() if shape.file))))

    def with_parameters(self, values: Dictionary[str, float | str]) -> Model:
        """A model with other values: `{"gas.c": "40 kN/m"}`, or a plain number in the parameter's base unit; also other
        initial values: `{"initial.crown.x": 0.02}`."""
        settings, conditions = dict(self.settings), dict(self.initial.conditions)
        for path, value_given in ((reading.element_path(key), value) for key, value in values.items()):
            place = Place("with_parameters", 1, 1, f"{path}: {value_given}")
            value, name = _python_value(path, value_given), path.removeprefix("initial.")
            if path == name:
                settings[path] = Setting(path, _like(value, self._value_in_diagram(path)), place)
            else:
                conditions[name] = Condition(name, value, False, place)
        return replace(self, settings=settings, initial=replace(self.initial, conditions=conditions))

    def written(self, path: str, number: float, unit: Unit) -> str:
        """The text of a value of a parameter in SI: in the unit that the diagram writes for it, or in `unit`."""
        value = self._value_in_diagram(path)
        in_diagram = value.expr.unit if isinstance(value, Value) and isinstance(value.expr, Number) else None
        return (in_diagram if in_diagram is not None and in_diagram.dimension == unit.dimension else unit).written(number)

    def _value_in_diagram(self, path: str) -> Value | FileInput | None:
        """The value that the diagram gives to a parameter of one of its parts."""
        owner, _, name = path.rpartition(".")
        if path in self.settings:
            return self.settings[path].value
        return self.body.instances[owner].settings.get(name) if owner in self.body.instances else None

    def with_component(self, name: str, kind: str, wires: Dictionary[str, str],
                       settings: Dictionary[str, float | str] | None = None) -> Model:
        """A model with one more component: `wires` maps each of its ports to its node.

        The same as a diagram that extends this one with `components:` and `nodes:`.
        """
        place = Place("with_component", 1, 1, f"{name}: {{is: {kind}}}")
        if name in self.body.instances:
            raise ModelError([Problem("name-twice", f"there is already a component '{name}'", place)])
        values: dict[str, Value | FileInput] = {k: _python_value(k, v) for k, v in (settings or {}).items()}
        instances = {**self.body.instances, name: Instance(name, kind, place, place, values)}
        joined = dict(self.body.wires)
        for port, node in wires.items():
            end = End(f"{name}.{port}", place)
            old = joined.get(node)
            joined[node] = replace(old, ends=(*old.ends, end)) if old else Wire(node, (end,), place)
        return replace(self, body=replace(self.body, instances=instances, wires=joined))


def _python_value(path: str, number_given: float | str) -> Value:
    number_given = number_or_text(number_given, "N", path)
    text = number_given if isinstance(number_given, str) else repr(number_given)
    place = Place(f"value of {path}", 1, 1, text)
    problems = Problems()
    value_read = reading.value(Scalar(text, place), path, problems)
    problems.raise_as(UsageError)
    assert value_read is not None
    # a plain Python number is in the parameter's base unit, which only the parameter declares
    return value_read if isinstance(number_given, str) else replace(value_read, si=True)


def _like(value: Value, before: Value | FileInput | None) -> Value:
    """A plain Python number with the unit of the value that it replaces, which may determine the units of signals."""
    if value.si and isinstance(value.expr, Number) and isinstance(before, Value) and isinstance(before.expr, Number):
        return replace(value, expr=replace(value.expr, unit=before.expr.unit))
    return value


class Buildable(Protocol):
    """A diagram that is built step by step (`Diagram`)."""

    def model(self) -> Model:
        """The diagram as it is now; ModelError with its mistakes."""
        raise NotImplementedError


ModelOrFile: TypeAlias = Model | Buildable | str | Path


def load(name: str | Path, *, allow_native: bool = False) -> Model:
    """Load a diagram: the path of a file, or the `name` of a bundled one (`cmc_ahc`, `cmc_ahc/passive`).

    The programs of its external functions may be executed with `allow_native` only; the permission stays with the diagram.
    Raises UsageError if the file does not exist, ModelError with the lines that are wrong.
    """
    with native_code(allow_native):
        return _load(find(name), ())


def loads(text: str, folder: Path | str = ".", *, allow_native: bool = False) -> Model:
    """Load a diagram from a `text`; files and components in it are looked up in `folder`. `allow_native` as of `load`.

    Raises ModelError with the lines that are wrong.
    """
    with native_code(allow_native):
        return from_source(parse(text, Path(folder) / "text.yaml", "text"), ())


def loaded(model: ModelOrFile) -> Model:
    """A diagram itself, one that is built in Python, or the diagram of a path or bundled name (see `load`)."""
    if isinstance(model, Model):
        return model
    if isinstance(model, (str, Path)):
        return load(model)
    if not callable(getattr(model, "model", None)):
        hint = "Write hb.Diagram.from_dict(...)." if isinstance(model, dict) else \
            "Give its diagram, .model, and changed values as `parameters=`." if hasattr(model, "model") else \
            'Give a Model, a Diagram, the path of a file, or a bundled name: "cmc_ahc".'
        raise UsageError([Problem("not-a-model", f"a {type(model).__name__} is not a diagram", None, hint)])
    return model.model()


def find(name: str | Path, head: str = "model", records: Container[str] = ()) -> Path:
    """The file of a path or bundled name; UsageError with similar names if it does not exist. Files with a suffix of
    `records` contain measurements, for which the message proposes a new experiment."""
    if str(name).startswith(BUNDLED):
        name = str(name).removeprefix(BUNDLED)
        inside_models = bundled_file(name) if ".." not in Path(name).parts else None
        if inside_models is not None and inside_models.is_relative_to(bundled("models")):
            return inside_models
        raise UsageError([Problem("file-missing", f"there is no bundled {head} '{name}'", None,
                                  _bundled_hint(name, head, ()))])
    path = Path(name)
    if path.is_dir() and (path.suffix or not (bundled("models") / path).is_dir()):
        files = [str(p) for p in sorted(path.glob("*.yaml"))]
        raise UsageError([Problem("file-is-folder", f"'{name}' is a folder, not a file", None,
                                  f"Give a file in it: {listing(files, 4)}." if files else "It has no YAML file.")])
    if path.suffix in (".yaml", ".yml"):
        if path.is_file():
            return path
        inside = bundled("models") / path
        if inside.is_file():
            return inside
    elif (inside_models := bundled_file(str(name))) is not None:
        return inside_models
    if path.is_file():
        raise UsageError([Problem("file-suffix", f"'{name}' is not a YAML file", None,
                                  f"Give the {head}, whose name ends in .yaml." + (
                                      f" `heavebond new NAME.yaml --from DIAGRAM.yaml {name}` proposes one for this record."
                                      if path.suffix.lower() in records else ""))])
    files_here = [p.name for p in sorted(Path.cwd().glob("*.yaml"))[:50]]
    raise UsageError([Problem("file-missing", f"there is no {head} '{name}'", None,
                              _bundled_hint(str(name), head, files_here))])


def _bundled_hint(name: str, head: str, local_names: Iterable[str]) -> str:
    """The bundled names, and the `local_names`, that are similar to a name; without one all bundled machines."""
    known = [m.parent.name if m.stem == m.parent.name else f"{m.parent.name}/{m.stem}"
             for m in sorted(bundled("models").glob("*/*.yaml"))]
    if head == "study":
        known += [m.relative_to(bundled("models")).with_suffix("").as_posix()
                  for m in sorted(bundled("models").glob("*/studies/*.yaml"))]
    return suggest(name, [*known, *local_names]) or "Give the path of a YAML file, or a bundled name: " \
        + ", ".join(k for k in known if "/" not in k) + "."


def bundled_file(name: str) -> Path | None:
    """The file of a bundled diagram, experiment or study: `cmc_ahc`, `cmc_ahc/passive`, `cmc_ahc/passive.yaml`."""
    root, path = bundled("models"), Path(name)
    candidates = (root / path,) if path.suffix in (".yaml", ".yml") else \
        (root / path / f"{path.name}.yaml", root / path.parent / f"{path.name}.yaml")
    return next((candidate for candidate in candidates if candidate.is_file()), None)


def beside(folder: Path, name: str) -> Path:
    """Resolve a file name relative to the folder of the file that contains it, else to the bundled machines;
    `bundled:NAME` is always a bundled machine."""
    path, inside = folder / name, bundled("models") / name
    if name.startswith(BUNDLED):
        return find(name, "diagram")
    return path if path.exists() else inside if inside.is_file() else bundled_file(name) or path


def beside_hint(path: Path, near: list[str]) -> str:
    """Advice for a missing file without similar names."""
    return f"The path counts from the folder of {path.name}" + (f"; there are {listing(near, 4)}." if near else ".")


def load_beside(source: Source, node: Node, problems: Problems) -> Model:
    """The diagram of an experiment or a study; ModelError with similar names if it does not exist."""
    target = _named(source, node, "model", problems)
    if not target.is_file():
        near = [p.name for p in sorted(source.path.parent.glob("*.yaml"))]
        raise ModelError([Problem("file-missing", f"there is no diagram {target.name} beside {source.name}", node.place,
                                  suggest(target.name, near) or beside_hint(source.path, near))])
    return load(target)


def _named(source: Source, node: Node, key: str, problems: Problems) -> Path:
    """The file after `extends:` or `model:`; ModelError for an unknown bundled one."""
    try:
        return beside(source.path.parent, reading.text(node, key, problems))
    except UsageError as error:
        raise ModelError([replace(problem, place=node.place) for problem in error.problems]) from None


def _load(path: Path, chain: tuple[Path, ...]) -> Model:
    return from_source(read(path, shown_path(path), bundled=is_bundled(path)), chain)


def from_source(source: Source, chain: tuple[Path, ...] = (), components: Dictionary[str, Component] | None = None) -> Model:
    """Read a diagram from its source; `chain` contains the files that were read before through `extends`. `components`
    have no file."""
    root = source.root
    if "model" not in root.items or "experiment" in root.items:
        message, hint = _other_kind(source)
        raise ModelError([Problem("not-a-model", message, root.place, hint)])
    base = _base(source, chain)
    return extended(replace(base, library=base.library.with_components(components)) if components else base, source)


def extended(base: Model, source: Source) -> Model:
    """Read a source that `extends` the diagram `base`; ModelError with the mistakes."""
    problems = Problems()
    reading.known_keys(source.root, MODEL_KEYS, "a diagram", problems)
    with calling(base.library.functions):
        root = source.root
        files = base.library.files
        body = reading.body(root, source, problems, lambda kind: base.library.component(kind) if kind in files else None)
        instances, inside = {**base.body.instances, **body.instances}, {**base.body.inside, **body.inside}
        wires = _wires(base.body.wires, body.wires, extends="extends" in root.items, problems=problems)
        for word in reading.words(root.items.get("remove"), "remove", problems):
            if word.text not in instances:
                problems.add("remove-unknown", f"there is no component '{word.text}' to remove", word.place,
                             hint=suggest(word.text, instances) or f"Components: {listing(instances)}.")
                continue
            del instances[word.text]
            inside = {path: part for path, part in inside.items() if path.split(".")[0] != word.text}
            wires = {n: replace(w, ends=tuple(e for e in w.ends if e.path.lstrip("-").split(".")[0] != word.text))
                     for n, w in wires.items()}
            wires = {n: w for n, w in wires.items() if w.ends}
        entries = reading.mapping(root.items.get("parameters"), "parameters", problems)
        values_by_name = {}
        for parameter_name, item in (entries.items if entries else {}).items():
            if entries and reading.identifier(entries.keys[parameter_name], "a parameter", problems):
                value = reading.value(item, parameter_name, problems)
                if value is not None:
                    values_by_name[parameter_name] = value
        parameters = {**base.parameters, **values_by_name}
        plan = read_plan(root.items.get("simulate"), problems)
        shapes = read_view(root.items.get("view"), problems, source.path.parent)
        if any(shape.spatial for shape in shapes.values()):  # a machine in the plane has become one in space
            base = replace(base, view={name: shape for name, shape in base.view.items() if shape.spatial is not False})
        # the place of an inherited part that is removed may remain in the file, in case the part returns
        layout = read_layout(root.items.get("layout"), base.body.layout, problems,
                             parts={**base.body.instances, **instances}, wires={**base.body.wires, **wires})
        model = replace(
            base, name=reading.text(root.items["model"], "model", problems), path=source.path,
            summary=reading.text(root.items.get("summary"), "summary", problems) or base.summary,
            parameters=parameters, body=Body(instances, wires, inside, layout),
            settings={**_kept_settings(base, body), **read_settings(root.items.get("set"), source, problems)},
            vary={**base.vary, **read_vary(root.items.get("vary"), problems)},
            initial=read_initial(root.items.get("initial"), base.initial, problems),
            nominal={**base.nominal, **read_nominal(root.items.get("nominal"), problems)},
            clocks={**base.clocks, **read_clocks(root.items.get("clocks"), problems)},
            show={**base.show, **read_show(root.items.get("show"), problems)},
            begin=plan.begin or base.begin, until=plan.until or base.until, every=plan.every or base.every,
            solver=plan.solver or base.solver, ends=plan.ends if plan.until or plan.ends else base.ends,
            largest_step=plan.largest_step or base.largest_step, step=plan.step or base.step,
            view={**base.view, **shapes},
            files=(*base.files, source.path))
    problems.raise_as(ModelError)
    return model


def _other_kind(source: Source) -> tuple[str, str]:
    """The kind of a file that is not a diagram, and the command for it."""
    items = source.root.items
    for kind, article in (("experiment", "an"), ("study", "a"), ("component", "a"), ("function", "a")):
        if isinstance(head := items.get(kind), Scalar):
            description = f"{source.name} is not a diagram; it describes {article} {kind}, '{head.text}'"
            diagram = items.get("model")
            if kind == "component":
                return description, f"A diagram uses it under `components:`, as in `part: {{is: {head.text}, ...}}`."
            if kind == "function":
                return description, f"Equations call it: `{head.text}(...)`."
            use = f" `heavebond compare {source.name}` compares it with its records." if kind == "experiment" else \
                f" `heavebond study {source.name}` runs it."
            return description, (f"Its diagram is {diagram.text}." if isinstance(diagram, Scalar)
                                 else "Give its diagram.") + use
    return f"{source.name} is not a diagram", suggest("model", items) or "A diagram begins with `model: name`."


def _base(source: Source, chain: tuple[Path, ...]) -> Model:
    problems = Problems()
    node = source.root.items.get("extends")
    source_path = source.path.resolve()
    if node is None:
        folder = source.path.parent
        return Model("", "", source.path, library([folder]))
    target = _named(source, node, "extends", problems)
    problems.raise_as(ModelError)
    if len(chain) > LONGEST_CHAIN:
        problems.add("extends-too-long", f"more than {LONGEST_CHAIN} files extend each other", node.place,
                     hint="Write a complete diagram.")
        problems.raise_as(ModelError)
    if target.resolve() in (*chain, source_path):
        circle = [*(chain[chain.index(target.resolve()):] if target.resolve() in chain else ()), source_path, target]
        problems.add("extends-circle", "these files extend each other in a circle: "
                     + " > ".join(p.name for p in circle) if len(circle) > 2 else f"{source.name} extends itself",
                     node.place, hint="One of them must be a complete diagram, without `extends:`.")
        problems.raise_as(ModelError)
    if not target.is_file():
        near = [p.name for p in sorted(target.parent.glob("*.yaml"))] if target.parent.is_dir() else []
        problem_text = f"{target} is a folder, not a file" if target.is_dir() else f"there is no file {target}"
        problems.add("file-missing", problem_text, node.place,
                     hint=suggest(target.name, near) or f"The path counts from the folder of {source.path.name}.")
        problems.raise_as(ModelError)
    base = _load(target, (*chain, source_path))
    if target.parent.resolve() != source.path.parent.resolve():
        folder_library, top = library([source.path.parent]), source.path.parent.resolve()
        local = {n: p for n, p in folder_library.user_files().items() if top in p.resolve().parents}
        inherited = base.library
        base = replace(base, library=Library(
            inherited.domains, {**inherited.files, **local}, {**inherited.twice, **folder_library.twice},
            joined_functions(source.path.parent, inherited.functions, folder_library.functions)))
    return base


def _kept_settings(base: Model, body: Body) -> dict[str, Setting]:
    """The settings that a variant inherits from its base diagram, without the settings of a part that is replaced by
    another kind, which does not have these parameters."""
    def lost(path: str) -> bool:
        owner, _, parameter = path.partition("[")[0].rpartition(".")
        before, after = base.body.instances.get(owner), body.instances.get(owner) or body.inside.get(owner)
        if after is None or after.kind not in base.library.files or (
                before.kind == after.kind if before is not None else owner not in body.inside):
            return False
        return parameter not in base.library.component(after.kind).parameters

    return {path: setting for path, setting in base.settings.items() if not lost(path)}


def _wires(old: dict[str, Wire], new: dict[str, Wire], *, extends: bool, problems: Problems) -> dict[str, Wire]:
    wires = dict(old)
    for name, wire in new.items():
        before = wires.get(name)
        plain = [e for e in wire.ends if e.path[:1] not in "+-"]
        if before is not None and plain:
            problems.add("node-exists", f"node '{name}' is in the diagram that this one extends already", plain[0].place,
                         hint=f"Write `+{plain[0].path}` to join a port to it, `-{plain[0].path}` to remove one.")
            continue
        if not extends and len(plain) < len(wire.ends):
            signed = next(e for e in wire.ends if e.path[:1] in "+-")
            if "." not in name:
                problems.add("node-sign", f"'{signed.path}' adds to a node, but this diagram extends no other",
                             signed.place, hint=f"Write `{signed.path[1:]}`.")
                continue
        ends = list(before.ends) if before else []
        for end in wire.ends:
            if end.path.startswith("-"):
                remaining_ends = [e for e in ends if e.path != end.path[1:]]
                if len(remaining_ends) == len(ends) and "." in name:  # ends of a block are declared in its file
                    remaining_ends.append(end)
                elif len(remaining_ends) == len(ends):
                    problems.add("node-end-unknown", f"'{end.path[1:]}' is not on node '{name}'", end.place,
                                 hint=suggest(end.path[1:], [e.path for e in ends]) or
                                 (f"On it: {listing(e.path for e in ends)}." if ends else f"There is no node '{name}' yet."))
                ends[:] = remaining_ends
            else:
                ends.append(End(end.path.removeprefix("+"), end.place))
        wires[name] = Wire(name, tuple(ends), before.place if before else wire.place)
    return {name: wire for name, wire in wires.items() if wire.ends or name in new}
