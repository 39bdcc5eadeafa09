"""Import of a 20-sim model: an .emx file to a folder with a diagram and its components.

Power ports without a connection: determination whether their flow or their effort is 0.

A bond of 20-sim without a partner has the causality of its submodel: a port that receives an effort, such as a mass, has
effort 0, one that receives a flow has flow 0. The causality follows from a maximum matching of equations and unknowns, in
which states are known and one equation of each free port determines its flow, or else its effort.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_bipartite_matching

from heavebond.core.errors import ModelError, Place, Problem, UsageError, listing
from heavebond.core.quoting import file_stem
from heavebond.core.writable import write_text
from heavebond.import_20sim import formula_text as f
from heavebond.import_20sim.block import OWN, Block, Part, Translator
from heavebond.import_20sim.choices import OPPOSITE, names, rebuilt
from heavebond.import_20sim.component import Component, Item, without_unit
from heavebond.import_20sim.emx_file import EmxFile, read_emx
from heavebond.import_20sim.evaluate import MEMBERS, fold
from heavebond.import_20sim.external import Programs
from heavebond.import_20sim.memory import SAMPLE_TIME
from heavebond.import_20sim.names import identifier, labels, snake
from heavebond.import_20sim.recognition import Match, recognised
from heavebond.import_20sim.sampling import sampling
from heavebond.import_20sim.sidops_lexer import tokenise
from heavebond.import_20sim.sidops_parser import parse_sidops
from heavebond.import_20sim.sidops_tree import Assign, Do, Equations, Expr, For, If, Statement, Submodel, While
from heavebond.import_20sim.write import block_text, component_text, mapping, numbers, parts_text, quantity, remark, scalar
from heavebond.language.library import library as known_library

NO_VALUE = "no value in the 20-sim file"  # characters of a description
ASSUMED_SAMPLE_TIME = 0.1  # s
USUAL_DURATION = 10.0  # duration in s, for a run of 20-sim whose file gives none
EFFORTS, FLOWS = ({pair[side] for pair in MEMBERS.values()} for side in (0, 1))
LIBRARY_LINES = 10_000_000  # more than the lines of any file, so that a line number determines its file
READ = 2000  # characters at the beginning of a component file that contain its summary
INSTANT = {"timeevent": 0, "step": 0, "ramp": 0, "impulse": 0, "frequencyevent": 1}  # index of the argument that is a time
Rows = list[set[str]]  # the unknowns of each equation


@dataclass(frozen=True)
class Untranslated:
    """A construct that has no translation: submodel, line of the .emx file, reason; `lawless` if the submodel is a
    placeholder because of it."""

    submodel: str
    line: int
    reason: str
    lawless: bool = False


@dataclass
class Imported:
    """The files of an import by their name, the diagram first, and the list of untranslated constructs."""

    name: str
    model: str  # the name of the file of 20-sim, without its ending
    files: dict[str, str] = field(default_factory=dict)
    untranslated: list[Untranslated] = field(default_factory=list)
    warnings: list[Problem] = field(default_factory=list)

    def left_over(self, folder: Path) -> list[Path]:
        """Components in a folder from an earlier import of the same model that this import does not write."""
        origin = f"of the 20-sim model {self.model}."
        component_files = sorted((folder / "components").glob("*.yaml")) if (folder / "components").is_dir() else []
        return [path for path in component_files if f"components/{path.name}" not in self.files
                and origin in path.read_text(encoding="utf-8", errors="replace")[:READ]]

    def write(self, folder: Path) -> list[Path]:
        """Write all files below a folder, which is created if it does not exist."""
        for name, text in self.files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            write_text(folder / name, text)
        return [folder / name for name in self.files]


def import_20sim(file: Path, functions: Mapping[str, str | Path], global_files: Iterable[str | Path] = (),
                 libraries: Iterable[str | Path] = ()) -> Imported:
    """Translate a file with C sources of functions, files with global parameters, and files or folders with implementations
    that the file does not contain; raises UsageError for wrong sources, ModelError for a wrong file."""
    sources = {name.lower(): Path(source) for name, source in functions.items()}
    for name, source in sources.items():
        if source.suffix != ".c" or not source.is_file():
            raise UsageError([Problem("import-function", f"'{source}' of the function {name} is not a C source", None,
                                      "Give the path of its file, `--function NAME=FILE.c`.")])
    programs = Programs(sources)
    imported = import_emx(file, frozenset(known_library().names()), programs,
                          [Path(global_file) for global_file in global_files], [Path(source) for source in libraries])
    if unused := [name for name in sources if name not in {function.lower() for function, *_ in programs.called.values()}]:
        calls = [function for function, *_ in programs.called.values()] + [*programs.without]
        raise UsageError([Problem("import-function", f"the model does not call a function '{unused[0]}' of a library", None,
                                  f"It calls {listing(calls)}." if calls else "It calls none.")])
    return imported


def import_emx(path: Path, library: frozenset[str] = frozenset(), programs: Programs | None = None,
               global_files: Iterable[Path] = (), libraries: Iterable[Path] = ()) -> Imported:
    """Translate a file; `library` contains the component names that the result must not use. Raises ModelError."""
    emx, programs = read_emx(path), programs or Programs()
    root = parse_sidops(emx.sidops, path.name, emx.first_line)
    if root.ports or root.equations is not None:  # the whole model is a part
        root.name = path.stem
        emx.within(identifier(path.stem))
        root = Submodel("model", root.line, submodels=[root])
    for global_file in global_files:
        _enter_globals(root, global_file)
    comments = dict(tokenise(emx.sidops, path.name, emx.first_line).comments)
    origins = _enter_implementations(root, libraries, comments)
    if emx.start:
        shift_time(root, emx.start)
    translator = Translator(emx, comments, library, sampling(root, emx.sample_times), programs)
    translator.enter_texts(root)
    translator.enter_constants(root)
    top = translator.block(root, "", "")
    if not top.parts:
        why = "the model has no submodels and no equations"
        raise ModelError([Problem("emx-structure", why, Place(path.name, root.line))])
    translator.finish()
    imported = _Writer(emx, translator, top, library).imported()
    imported.files.update(programs.files())
    imported.untranslated = [_located(item, origins) for item in imported.untranslated]
    if origins:  # the lines of other files in the reasons of placeholders
        imported.files = {name: re.sub(r"\bline ([0-9]{8,})\b", lambda m: (
            f"{origins[int(m[1]) // LIBRARY_LINES - 1][0]} line {int(m[1]) % LIBRARY_LINES}"), text)
            for name, text in imported.files.items()}
    return imported


def _enter_implementations(root: Submodel, libraries: Iterable[Path], comments: dict[int, str]) -> list[tuple[str, int]]:
    """Complete submodels without an implementation: take the implementation of the submodel with the same type, or else the
    same name, in other files, and add the comments of these files. The lines of the k-th file are counted from k *
    `LIBRARY_LINES`. Returns the name of each file, and the line of the first submodel of the model that uses it."""
    files: list[Path] = []
    for source in libraries:
        source_files = sorted(source.glob("*.emx")) if source.is_dir() else [source]
        if not source_files or not all(path.suffix.lower() == ".emx" and path.is_file() for path in source_files):
            raise UsageError([Problem("import-library", f"cannot find 20-sim models at '{source}'", None,
                                      "Name an .emx file that contains the submodels, or a folder of such files.")])
        files += source_files
    implemented: dict[str, tuple[Submodel, int]] = {}
    origins: list[tuple[str, int]] = []
    for k, path in enumerate(files, 1):
        emx = read_emx(path)
        first = k * LIBRARY_LINES + emx.first_line
        waiting = [parse_sidops(emx.sidops, path.name, first)]
        comments.update(tokenise(emx.sidops, path.name, first).comments)
        origins.append((path.name, 0))
        if waiting[0].ports:  # the whole file is a submodel
            implemented.setdefault(identifier(path.stem).lower(), (waiting[0], k))
        while waiting:
            submodel = waiting.pop(0)
            waiting += submodel.submodels
            if submodel.equations is not None or submodel.submodels:
                for name in (submodel.type, submodel.name):
                    if name and name not in ("Mainmodel", "model"):
                        implemented.setdefault(identifier(name).lower(), (submodel, k))
    chain = [(part, frozenset[int]()) for part in root.submodels]
    while chain and implemented:
        part, above = chain.pop()
        if part.equations is None and not part.submodels:
            match = next((implemented[key] for name in (part.type, part.name)
                          if (key := identifier(name).lower()) in implemented), None)
            if match is not None and id(match[0]) not in above:
                submodel, k = match
                origins[k - 1] = (origins[k - 1][0], origins[k - 1][1] or part.line)
                copy = deepcopy(submodel)
                named = {item.name: item for item in part.parameters if item.value is not None}
                part.ports, part.knot = part.ports or copy.ports, copy.knot
                part.equations, part.submodels, part.connections = copy.equations, copy.submodels, copy.connections
                part.relations, part.comments, part.variables = copy.relations, copy.comments, copy.variables
                part.parameters = [named.get(item.name, item) for item in copy.parameters]
                above = above | {id(submodel)}
        chain += [(inner, above) for inner in part.submodels]
    return origins


def _located(item: Untranslated, origins: list[tuple[str, int]]) -> Untranslated:
    """An untranslated construct of another file at the line of the model that uses it."""
    k, line = divmod(item.line, LIBRARY_LINES)
    return item if not k else replace(item, line=origins[k - 1][1], reason=f"{item.reason} ({origins[k - 1][0]}:{line})")


def _enter_globals(root: Submodel, path: Path) -> None:
    """Enter the global constants and parameters with values of another file as global relations of the model."""
    if path.suffix.lower() != ".emx" or not path.is_file():
        raise UsageError([Problem("import-globals", f"cannot find the 20-sim model '{path}'", None,
                                  "Name an .emx file that declares the global parameters.")])
    emx = read_emx(path)
    if root.relations is None:
        root.relations = Equations()
    known = {item.name for item in (*root.relations.constants, *root.relations.parameters)}
    waiting = [parse_sidops(emx.sidops, path.name, emx.first_line)]
    while waiting:
        submodel = waiting.pop(0)
        waiting += submodel.submodels
        for section in (submodel.relations, submodel.equations):
            for group, target in ((section.constants, root.relations.constants),
                                  (section.parameters, root.relations.parameters)) if section is not None else ():
                for item in group:
                    shared = item.is_global or section is submodel.relations
                    if shared and item.value is not None and item.name not in known:
                        stated = emx.stated(identifier(item.name))
                        value = item.value if stated is None or item.size else f.number(stated)
                        target.append(replace(item, value=value))
                        known.add(item.name)


class _Writer:
    """Names of files, shared quantities, initial conditions and outputs of one import."""

    def __init__(self, emx: EmxFile, translator: Translator, top: Block, library: frozenset[str]):
        self.emx, self.translator, self.top, self.library = emx, translator, top, library
        self.result = Imported(identifier(file_stem(emx.path.stem)), emx.path.stem)
        self.names: dict[int, str] = {}
        self.texts: dict[tuple[str, str], str] = {}  # wanted name and common text of all parts of a kind: the name
        self.defaults: dict[int, Component] = {}  # for each component: the one whose values are in its file
        self.kinds: dict[str, Component] = {}  # for each file: the first component of its kind
        self.file_names: set[str] = set()
        self.globals: dict[str, tuple[float, str]] = {}
        self.docs: dict[str, str] = {}  # of global parameters
        self.set: list[tuple[str, str]] = []
        self.matches: dict[int, Match] = {}  # components that the library has, by their identity

    def imported(self) -> Imported:
        """All files."""
        self._shared()
        everything: list[tuple[str, Component | Block]] = [*self.translator.components, *self.translator.blocks]
        for path, component in everything:
            lawless = isinstance(component, Component)
            self.result.untranslated += [Untranslated(path or self.emx.path.stem, line, why, lawless)
                                         for line, why in component.untranslated]
            if isinstance(component, Component):
                self.result.untranslated += [Untranslated(path, line, why) for line, why in component.omitted]
        self.result.untranslated += [Untranslated(path or self.emx.path.stem, line, why)
                                     for path, line, why in self.translator.notes]
        # sources of an effort of 0 at power ports on no connection that take an effort
        for block, node in with_free_effort(self.translator.components, self.translator.blocks):
            name, end = f"{node}_free", block.nodes[node][0]
            beside = next((p for p in block.parts.values() if p.name == end.partition(".")[0]), None)
            items = [Item("p", "bond", "", out=True), Item("E", "parameter", "W", "", 0.0)]
            source = Component("FreeEnd", "", items={item.name: item for item in items})
            source.equations = [(Expr("name", name="p.e"), Expr("name", name="E"), "")]
            block.parts[name] = Part(name, source, beside.x if beside else 0.0, (beside.y if beside else 0.0) - 80)
            block.nodes[node].append(f"{name}.p")
            path = next(p for p, b in self.translator.blocks if b is block)
            self.translator.components.append((f"{path}.{name}" if path else name, source))
        self.result.files[f"{self.result.name}.yaml"] = ""
        if self.library:
            for path, block in self.translator.blocks:
                self._recognise(path, block)
        self._place(self.top)
        self.result.files[f"{self.result.name}.yaml"] = self._diagram()
        return self.result

    def _shared(self) -> None:
        """Global parameters become parameters of the diagram; global variables become inputs of the parts that read them."""
        self._sample_time()
        missing: set[str] = set()
        givers: dict[str, str] = {}
        for path, component in self.translator.components:
            for local_name, label in component.gives.items():
                if label in givers:
                    why = f"the global quantity '{label}' is computed by '{givers[label]}' too, which is used"
                    self.result.untranslated.append(Untranslated(path, component.line, why))
                if givers.setdefault(label, f"{path}.{local_name}") == f"{path}.{local_name}":
                    without_unit(component.items[local_name])  # it feeds inputs, which have none
        units: dict[str, str] = {}
        used = {label for _, component in self.translator.components for label in component.shared.values()}
        for label, (value, unit) in self.translator.values.items():
            if label in used and label not in givers:
                self.globals[label], units[label] = (value, unit), unit
        for _, component in self.translator.components:
            for local_name, label in component.shared.items():
                item = component.items[local_name]
                if item.kind == "parameter" and item.value is not None and label not in self.globals:
                    self.globals[label] = (item.value, item.unit)
                    units[label] = item.unit
        for path, component in self.translator.components:
            for local_name, label in component.shared.items():
                item = component.items[local_name]
                if label in self.globals:
                    item.unit = units[label]
                    if item.kind != "parameter":
                        item.kind, item.value = "parameter", None
                    item.value = self.globals[label][0] if item.value is None else item.value
                    self.set.append((f"{path}.{local_name}", f"={identifier(label)}"))
                elif label in givers:
                    item.kind, item.value = "in", None
                    self.set.append((f"{path}.{local_name}", f"={givers[label]}"))
                else:
                    base = re.sub(r"(_[0-9]+)+$", "", label)
                    if base not in missing:
                        self.result.untranslated.append(Untranslated(path, component.line,
                                                                     f"the global quantity '{base}' has no "
                                                                     "value; 0 is used"))
                    missing.add(base)
                    item.kind, item.value, item.doc = "parameter", 0.0, "; ".join(filter(None, (NO_VALUE, item.doc)))

        self._unused()
        set_paths = {path for path, _ in self.set}
        for path, component in self.translator.components:
            for item in component.of_kind("parameter"):
                if item.value is None and f"{path}.{item.name}" not in set_paths:
                    item.value, item.doc = 0.0, "; ".join(filter(None, (NO_VALUE, item.doc)))
                    why = f"the parameter '{item.name}' has no value; 0 is used"
                    self.result.untranslated.append(Untranslated(path, component.line, why))

    def _unused(self) -> None:
        """Remove parameters that no equation uses, such as initial values, which are in the diagram, and submodels that
        only declare global quantities."""
        plotted = {label.replace("\\", ".") for name in self.emx.plotted for label in labels(name)}
        unused: set[str] = set()
        for path, component in self.translator.components:
            if component.untranslated:
                continue
            text = component_text(component, "")
            used = set(re.findall(r"\w+", text[text.index("equations: |"):] if component.equations else ""))
            used |= set(re.findall(r"\w+", text[text.index("when:"):] if component.events else ""))
            for item in component.of_kind("parameter"):
                if item.name not in used and f"{path}.{item.name}" not in plotted:
                    if (label := component.shared.pop(item.name, "")):
                        self.docs.setdefault(label, item.doc)
                    del component.items[item.name]
                    unused.add(f"{path}.{item.name}")
        self.set = [(name, value) for name, value in self.set if name not in unused]
        empty = {id(component) for _, component in self.translator.components if not component.items
                 and not component.untranslated}
        self.translator.components = [(path, component) for path, component in self.translator.components
                                      if id(component) not in empty]
        for _, block in self.translator.blocks:
            remaining_parts = {name: part for name, part in block.parts.items() if id(part.content) not in empty}
            block.parts = remaining_parts or block.parts

    def _sample_time(self) -> None:
        """The sample time of the discrete parts, if there are any."""
        stated = list(dict.fromkeys(self.emx.sample_times.values()))
        reported = False
        for path, component in self.translator.components:
            if component.shared.get(SAMPLE_TIME) != SAMPLE_TIME:
                continue
            item = component.items[SAMPLE_TIME]
            if item.value is None and len(stated) != 1 and not reported:
                reported, used = True, stated[0] if stated else ASSUMED_SAMPLE_TIME
                self.result.untranslated.append(Untranslated(
                    path, component.line,
                    f"the file states no sample time{' of it' if stated else ''}; {used:g} s is used: set "
                    f"`{SAMPLE_TIME}` in the diagram"))
            item.value = item.value or (stated[0] if stated else ASSUMED_SAMPLE_TIME)
            if stated and item.value != stated[0]:  # of another discrete system
                component.shared[SAMPLE_TIME] = f"{SAMPLE_TIME}_{stated.index(item.value) + 1}"

    def _recognise(self, path: str, block: Block) -> None:
        """Replace parts of a block by library components with the same law."""
        joined = {end for ends in block.nodes.values() if len(ends) > 1 for end in ends}
        shared = dict(self.set)
        plotted = {label.replace("\\", ".") for name in self.emx.plotted for label in labels(name)}
        matches: dict[str, tuple[Part, Match]] = {}
        for part in block.parts.values():
            component, full_name = part.content, f"{path}.{part.name}" if path else part.name
            if not isinstance(component, Component):
                continue
            match = recognised(component, {n for n in component.items if f"{part.name}.{n}" in joined})
            if match is None or any(f"{full_name}.{n}" in plotted and n not in match.ports for n in component.items) or any(
                    f"{full_name}.{n}" in shared and component.items[n].unit != match.units[p]
                    for p, n in match.parameters.items()):
                continue
            matches[part.name] = part, match
        for ends in block.nodes.values():  # a domain must be known at each node
            bonds = [end for end in ends if block.is_bond(end)]
            if bonds and all(end.partition(".")[0] in matches and matches[end.partition(".")[0]][1].any_domain
                             for end in bonds):
                del matches[bonds[0].partition(".")[0]]
        for part, match in matches.values():
            self.matches[id(part.content)] = match
            renamed = {f"{part.name}.{a}": f"{part.name}.{b}" for a, b in match.ports.items()}
            block.nodes = {name: [renamed.get(end, end) for end in ends if renamed.get(end) or end.partition(".")[0]
                                  != part.name] for name, ends in block.nodes.items()}
            block.nodes = {name: ends for name, ends in block.nodes.items() if ends}
            block.equations = [(left, renamed.get(right, right)) for left, right in block.equations]
            part.inputs = {match.ports[name]: value for name, value in part.inputs.items()}
            full_name = f"{path}.{part.name}" if path else part.name
            back = {f"{full_name}.{n}": f"{full_name}.{p}" for p, n in match.parameters.items()}
            back |= {f"{full_name}.{n}": f"{full_name}.{p}" for n, p in match.ports.items()}  # inputs from global quantities
            self.set = [(back.get(name, name), value) for name, value in self.set
                        if name in back or not name.startswith(f"{full_name}.")]

    def _part_values(self, block: Block) -> dict[int, list[tuple[str, str]]]:
        path = next((p for p, b in self.translator.blocks if b is block), "")
        return {id(part.content): self._values(part, path) for part in block.parts.values()}

    @staticmethod
    def _tables(component: Component, names: dict[str, str]) -> list[tuple[str, str]]:
        return [(names.get(kind, f"{name}_{kind}"), numbers(points, "s" if names.get(kind) == "t" else ""))
                for name, table in component.tables.items()
                for kind, points in zip("xyv" if len(table) == 3 else "xv", table, strict=True)]

    def _values(self, part: Part, path: str) -> list[tuple[str, str]]:
        """The values of a part that differ from the defaults of its file."""
        match, content = self.matches.get(id(part.content)), part.content
        if not isinstance(content, Component):
            return []
        if match is None:
            part_path = f"{path}.{part.name}" if path else part.name
            shared, usual = {name for name, _ in self.set}, self.defaults[id(content)].items
            return self._tables(content, {}) + [
                (item.name, quantity(item.value, item.unit)) for item in content.of_kind("parameter")
                if item.value is not None
                and item.value != usual[item.name].value and f"{part_path}.{item.name}" not in shared]
        if match.lists:
            return self._tables(content, match.lists)
        if match.matrices:
            return [(name, f"[{', '.join(numbers(row, match.units[name]) for row in rows)}]")
                    for name, rows in match.matrices.items()]
        part_path = f"{path}.{part.name}" if path else part.name
        shared = {name for name, _ in self.set}
        values = {**match.numbers, **{p: content.items[n].value or 0.0 for p, n in match.parameters.items()}}
        return [(name, quantity(values[name], unit)) for name, unit in match.units.items()
                if name in values and f"{part_path}.{name}" not in shared]

    def _place(self, block: Block) -> None:
        """Write the contents of a block, the inner files first."""
        for part in block.parts.values():
            content = part.content
            if isinstance(content, Block):
                self._place(content)
                parts = parts_text(content, self.names, self._part_values(content), *_origin(content))
                name, new = self._kind(content, block_text(content, "", parts), block)
                text = block_text(content, name, parts) if new else ""
            elif id(content) in self.matches:
                self.names[id(content)] = self.matches[id(content)].name
                continue
            else:
                name, new = self._kind(content, component_text(content, "", defaults=False), block)
                self.defaults[id(content)] = self.kinds.setdefault(name, content)
                text = component_text(content, name) if new else ""
            if new:
                self.result.files[f"components/{snake(name)}.yaml"] = text

    def _kind(self, content: Component | Block, common: str, within: Block) -> tuple[str, bool]:
        """The name of the file for a submodel of a block, and True if it is new: submodels with the same text except for
        parameter values, and with one type or with names that differ by a number only, are parts of one kind. If another
        kind has the name, the name of the block is its prefix."""
        key = (re.sub(rf"{OWN}$|(?<=[A-Za-z])[0-9]+$", "", content.name), common)
        new = key not in self.texts
        if new:
            name, k = content.name, 1
            qualified = f"{within.name.removesuffix(OWN)}{content.name.removesuffix(OWN)}"
            if name.lower() in self.file_names and within is not self.top and qualified not in self.library:
                name = content.name = qualified
            while name.lower() in self.file_names:
                k, name = k + 1, f"{content.name}{k + 1}"
            self.file_names.add(name.lower())
            self.texts[key] = name
            content.summary = f"Submodel {content.name} of the 20-sim model {self.emx.path.stem}."
        self.names[id(content)] = self.texts[key]
        return self.texts[key], new

    def _diagram(self) -> str:
        lines = [f"model: {self.result.name}", f"summary: {scalar(f'Imported from the 20-sim model {self.emx.path.name}.')}"]
        if self.globals:
            comments = {name: f"   # {remark(doc)}" for name, doc in self.docs.items() if doc}
            lines += ["parameters:",
                      *(f"  {identifier(n)}: {quantity(v, u)}{comments.get(n, '')}" for n, (v, u) in self.globals.items())]
        lines += parts_text(self.top, self.names, self._part_values(self.top), *_origin(self.top))
        if self.set:
            lines += ["set:", *(f"  {path}: {scalar(value)}" for path, value in self.set)]
        initial: list[tuple[str, str]] = []
        for path, component in self.translator.components:
            if (match := self.matches.get(id(component))) is not None:
                initial += [(f"{path}.{name}", quantity(first, match.units[name])) for name, first in match.initial.items()]
                continue
            units = {item.name: item.unit for item in component.of_kind("variable")}
            initial += [(f"{path}.{name}", quantity(fold(value, {}) or 0.0, units.get(name, "")))
                        for name, value in component.initial.items()]
        if initial:
            lines += ["initial:", *(f"  {path}: {value}" for path, value in initial)]
        lines += self._show()
        until = USUAL_DURATION if self.emx.finish is None else self.emx.finish - self.emx.start
        if until > 0:
            times = [("until", until), *([("every", self.emx.every)] if self.emx.every else [])]
            lines.append(f"simulate: {mapping((name, quantity(value, 's')) for name, value in times)}")
        return "\n".join(lines) + "\n"

    def _show(self) -> list[str]:
        """The plotted variables of the experiment."""
        items: dict[str, Item] = {}
        renamed: dict[str, str] = {}
        everything: list[tuple[str, Component | Block]] = [*self.translator.components, *self.translator.blocks]
        for path, component in everything:
            items_of_component: dict[str, Item] = component.items
            items.update({f"{path}.{name}" if path else name: item for name, item in items_of_component.items()
                          if item.kind != "bond"})
            if (match := self.matches.get(id(component))) is not None:
                renamed.update({f"{path}.{a}": f"{path}.{b}" for a, b in match.ports.items()})
            elif isinstance(component, Component):
                renamed.update({f"{path}.{a}": f"{path}.{b}" for a, b in component.sampled_values.items()})
        bonds = {f"{path}.{name}": item for path, component in self.translator.components
                 for name, item in component.items.items()
                 if item.kind == "bond"}
        names: dict[str, str] = {}
        for plotted in self.emx.plotted:
            path = next((p for name in labels(plotted) if (p := name.replace("\\", ".")) in items), "")
            label = identifier(plotted.replace("\\", "_"))
            if path in items and label not in names:
                item, name_shown = items[path], renamed.get(path, path)
                unit = item.unit if item.kind in ("variable", "held", "parameter") else ""
                # the value of its signal at the last sample
                if label in self.top.nodes and name_shown not in self.top.nodes[label]:
                    label = f"{label}_sampled"
                names[label] = mapping([("is", scalar(name_shown)), ("unit", unit or "1")])
            port, _, member = plotted.rpartition(".")
            port = ".".join(identifier(word) for word in port.split("\\"))
            if port in bonds and label not in names and member in (*EFFORTS, *FLOWS):  # of a port: p.e, p.f, p.u ...
                quantity_of = f"{renamed.get(port, port)}.{'e' if member in EFFORTS else 'f'}"
                sign = "-" if member in FLOWS and bonds[port].out else ""
                names[label] = mapping([("is", scalar(f"{sign}{quantity_of}")), ("unit", "W" if member in EFFORTS else "1")])
        return ["show:", *(f"  {label}: {entry}" for label, entry in names.items())] if names else []

    def problems(self) -> list[Problem]:
        return [Problem("emx-untranslated", f"{u.submodel}: {u.reason}", Place(self.emx.path.name, u.line))
                for u in self.result.untranslated]


def _origin(block: Block) -> tuple[float, float]:
    return (min((p.x for p in block.parts.values()), default=0.0), max((p.y for p in block.parts.values()), default=0.0))


def shift_time(submodel: Submodel, start: float) -> None:
    """Rewrite the equations of a submodel and of those within it in the time since the start, which is given in s.
    Instants that are compared with the time are reduced by the start; elsewhere, `time` is replaced by that time plus
    the start."""
    for section in (submodel.equations, submodel.relations):
        if section is not None:
            declared = {d.name.lower() for d in (*section.constants, *section.parameters, *section.variables)}
            if "time" not in declared:
                for statements in (section.initial, section.equations, section.code):
                    statements[:] = _statements(statements, start)
    for part in submodel.submodels:
        shift_time(part, start)


def _statements(statements: Iterable[Statement], start: float) -> tuple[Statement, ...]:
    shifted_statements: list[Statement] = []
    for s in statements:
        if isinstance(s, Assign):
            shifted_statements.append(replace(s, left=_shifted(s.left, start), right=_shifted(s.right, start)))
        elif isinstance(s, If):
            shifted_statements.append(replace(s, condition=_shifted(s.condition, start), then=_statements(s.then, start),
                                              otherwise=_statements(s.otherwise, start)))
        elif isinstance(s, Do):
            shifted_statements.append(replace(s, call=_shifted(s.call, start)))
        elif isinstance(s, While):
            shifted_statements.append(replace(s, condition=_shifted(s.condition, start), body=_statements(s.body, start)))
        elif isinstance(s, For):
            shifted_statements.append(replace(s, body=_statements(s.body, start)))
    return tuple(shifted_statements)


def _shifted(expr: Expr, start: float) -> Expr:
    if _is_time(expr):
        return Expr("+" if start > 0 else "-", (expr, f.number(abs(start))), line=expr.line)
    if expr.op == "name" and expr.name.lower() == "starttime":
        return f.number(start)
    if expr.op in OPPOSITE and any(map(_is_time, expr.args)):
        return rebuilt(expr, lambda e: e if _is_time(e) else _earlier(_shifted(e, start), start))
    shifted = rebuilt(expr, lambda e: _shifted(e, start))
    at = INSTANT.get(expr.name.lower()) if expr.op == "call" else None
    if at is None or len(shifted.args) <= at:
        return shifted
    args = (*shifted.args[:at], _earlier(shifted.args[at], start), *shifted.args[at + 1:])
    return Expr(shifted.op, args, shifted.name, line=shifted.line)


def _is_time(expr: Expr) -> bool:
    return expr.op == "name" and expr.name.lower() == "time"


def _earlier(instant: Expr, start: float) -> Expr:
    known = fold(instant, {})
    return Expr("-", (instant, f.number(start)), line=instant.line) if known is None else f.number(known - start)


def with_free_effort(components: list[tuple[str, Component]], blocks: list[tuple[str, Block]]) -> list[tuple[Block, str]]:
    """The nodes with one end whose effort must be 0, with their blocks: with flow 0, no equation would determine it."""
    free = [(path, block, name, ends[0]) for path, block in blocks for name, ends in block.nodes.items()
            if len(ends) == 1 and block.is_bond(ends[0])]
    if not free:
        return []
    rows: Rows = []
    for path, component in components:
        rows += _of_component(f"{path}." if path else "", component)
    for path, block in blocks:
        prefix = f"{path}." if path else ""
        for node_ends in block.nodes.values():
            own_ends = [prefix + end for end in node_ends]
            if len(own_ends) > 1 and block.is_bond(node_ends[0]):
                rows += [{f"{own_ends[0]}.e", f"{end}.e"} for end in own_ends[1:]]
                rows.append({f"{end}.f" for end in own_ends})
            elif not block.is_bond(node_ends[0]):
                rows += [{own_ends[0], end} for end in own_ends[1:]]
        for sides in block.equations:
            rows.append({prefix + n for side in sides for n in re.findall(r"[A-Za-z_][\w.]*", side)})
        rows += [{f"{prefix}{part.name}.{name}"} for part in block.parts.values() for name in part.inputs]
    ports = [f"{path}.{end}" if path else end for path, _, _, end in free]
    ends = [{f"{port}.f"} for port in ports]
    loose = [{f"{port}.e", f"{port}.f"} for port in ports]
    most = _matched([*rows, *loose])
    for k, (_, block, _, end) in enumerate(free):
        first, second = ("e", "f") if _gives_flow(block, end) else ("f", "e")
        ends[k] = {f"{ports[k]}.{first}"}
        if _matched([*rows, *ends[:k + 1], *loose[k + 1:]]) < most:
            ends[k] = {f"{ports[k]}.{second}"}
    return [(block, name) for (_, block, name, _), row in zip(free, ends, strict=True) if next(iter(row)).endswith(".e")]


def _gives_flow(block: Block, end: str) -> bool:
    """True if the equations of a port state its flow: they may contain its effort too without determining it."""
    name, _, port = end.partition(".")
    content = next(p.content for p in block.parts.values() if p.name == name)
    if isinstance(content, Component):
        stated = {left.args[0].name if left.op == "negative" else left.name for left, *_ in content.equations}
        return f"{port}.f" in stated and f"{port}.e" not in stated
    inner = [e for ends in content.nodes.values() if port in ends for e in ends if e != port and content.is_bond(e)]
    return len(inner) == 1 and "." in inner[0] and _gives_flow(content, inner[0])


def _rates(expr: Expr) -> Iterator[str]:
    """The names whose rates occur in an expression."""
    if expr.op == "call" and expr.name == "der":
        yield from names(expr)
    for e in expr.args:
        yield from _rates(e)


def _of_component(prefix: str, component: Component) -> Rows:
    sides = [(left, right) for left, right, _ in component.equations]
    rates = [{*_rates(left), *_rates(right)} for left, right in sides]
    states = set().union(*rates) if rates else set()
    kinds = {name: item.kind for name, item in component.items.items()}

    def unknown(name: str) -> bool:
        base = name.partition(".")[0]
        return name not in states and kinds.get(base) in ("variable", "out", "in", "bond") and base not in component.shared

    return [{prefix + n for e in pair for n in names(e) if unknown(n)} | {f"{prefix}der {n}" for n in base}
            for pair, base in zip(sides, rates, strict=True)]


def _matched(rows: Rows) -> int:
    """Number of matched equations."""
    numbers: dict[str, int] = {}
    pairs = [(i, numbers.setdefault(n, len(numbers))) for i, row in enumerate(rows) for n in sorted(row)]
    if not pairs:
        return 0
    i, k = np.array(pairs).T
    graph = csr_array((np.ones(len(pairs), dtype=np.int8), (i, k)), shape=(len(rows), len(numbers)))
    return int(np.count_nonzero(maximum_bipartite_matching(graph, perm_type="column") >= 0))
