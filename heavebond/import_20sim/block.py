"""Submodels made of submodels: parts and nodes, from connections."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import reduce

from heavebond.import_20sim import formula_text as f
from heavebond.import_20sim.component import Component, Item
from heavebond.import_20sim.emx_file import EmxFile
from heavebond.import_20sim.equations import Builder
from heavebond.import_20sim.evaluate import fold
from heavebond.import_20sim.expressions_parser import Unreadable
from heavebond.import_20sim.external import Programs
from heavebond.import_20sim.memory import SAMPLE_TIME
from heavebond.import_20sim.names import camel, identifier, labels
from heavebond.import_20sim.sampling import Sampling
from heavebond.import_20sim.sidops_tree import Assign, Connection, Do, Expr, Submodel

GENERIC = {"Submodel", "SubmodelEquation", "SubmodelGraphical", "Mainmodel", "SubmodelTryout"}
GLOBALS = "globals"  # the name of the submodel of global relations
Made = "Component | Block"


@dataclass
class Part:
    """Part of a block, with its component, its values, and its place."""

    name: str
    content: Component | Block
    x: float
    y: float
    inputs: dict[str, str] = field(default_factory=dict)
    elements: dict[str, list[str]] = field(default_factory=dict)  # of each 20-sim port


@dataclass
class Block:
    """A block or diagram: parts, nodes, ports, and equations between its ports."""

    name: str
    summary: str
    parts: dict[str, Part] = field(default_factory=dict)
    nodes: dict[str, list[str]] = field(default_factory=dict)
    items: dict[str, Item] = field(default_factory=dict)
    equations: list[tuple[str, str]] = field(default_factory=list)
    elements: dict[str, list[str]] = field(default_factory=dict)
    untranslated: list[tuple[int, str]] = field(default_factory=list)
    line: int = 0

    def is_bond(self, end: str) -> bool:
        """True if an end of a node, `part.port` or a port of the block, belongs to a bond."""
        name, _, port = end.partition(".")
        part = next((p for p in self.parts.values() if p.name == name), None)
        items = part.content.items if part and port else self.items
        return (port or name) in items and items[port or name].kind == "bond"


OWN = "20sim"  # suffix of a name that a library component has, too


def title(submodel: Submodel, library: frozenset[str] = frozenset()) -> str:
    """The name of the component for a submodel: its type, or its name if the type is general or taken."""
    kind = camel(submodel.type)
    name = camel(submodel.name) if kind in GENERIC or kind in library or not submodel.type else kind
    return f"{name}{OWN}" if name in library else name


def _unused(base: str, used_names: Collection[str]) -> str:
    """A name that is not taken: `Gain`, `Gain_2` ..."""
    k, candidate = 1, base
    while candidate in used_names:
        k, candidate = k + 1, f"{base}_{k + 1}"
    return candidate


def _known_values(component: Component, builder: Builder, values: Mapping[str, float]) -> dict[str, float]:
    """The values that are known before the run: numbers, parameters, given ones, and results of the initial equations and
    the equations with these."""
    known = {**values, **{i.name: i.value for i in component.of_kind("parameter") if i.value is not None}, **builder.numbers}
    formulas = {**{left.name: right for left, right, _ in component.equations if left.op == "name"}, **builder.start}
    changed = True
    while changed:
        new = {name: value for name, right in formulas.items() if name not in known
               and (value := fold(right, known)) is not None}
        known.update(new)
        changed = bool(new)
    return known


class Translator:
    """The tree of submodels of one model as components and blocks."""

    def __init__(self, emx: EmxFile, comments: Mapping[int, str], library: frozenset[str], sampling: Sampling,
                 programs: Programs):
        self.programs = programs
        self.emx, self.comments, self.library, self.sampling = emx, comments, library, sampling
        self.components: list[tuple[str, Component]] = []  # by dotted path of the new diagram
        self.blocks: list[tuple[str, Block]] = []
        self.scopes: list[dict[str, str]] = []  # global relations of the enclosing submodels: name to name in the diagram
        self.values: dict[str, tuple[float, str]] = {}  # of global parameters by their name in the diagram, with their unit
        self.computed: dict[str, float] = {}  # values of other global quantities that are known before the run
        self.constants: dict[str, float] = {}  # global constants
        self.texts: dict[str, str] = {}  # text values of global parameters, such as names of files
        self.notes: list[tuple[str, int, str]] = []  # global relations that have no results: path, line, reason
        self.pending: list[tuple[Component, str, Builder]] = []  # without initial values; with the prefix of their names

    def enter_texts(self, submodel: Submodel) -> None:
        """Enter the global texts of a submodel and of those within it; the experiment may give others."""
        for section in (submodel.relations, submodel.equations):
            for item in (*section.constants, *section.parameters, *section.variables) if section is not None else ():
                if item.kind == "string" and item.is_global and item.value is not None:
                    self.texts.setdefault(identifier(item.name), item.value.name)
        self.texts.update({name: text for name, text in self.emx.texts.items() if name in self.texts})
        for part in submodel.submodels:
            self.enter_texts(part)

    def enter_constants(self, submodel: Submodel) -> None:
        """Enter the global constants and whole parameters of a submodel and of those within it, which may be sizes."""
        equations = submodel.equations
        for item in (*equations.constants,
                     *(p for p in equations.parameters if p.kind == "integer")) if equations is not None else ():
            if item.is_global and not item.size and item.value is not None and (value := fold(item.value, {})) is not None:
                stated = self.emx.stated(identifier(item.name))
                self.constants.setdefault(item.name, value if stated is None else stated)
        for part in submodel.submodels:
            self.enter_constants(part)

    def scoped(self, label: str) -> str:
        """The name in the diagram of a global quantity."""
        return next((scope[label] for scope in reversed(self.scopes) if label in scope), label)

    def _known(self) -> dict[str, float]:
        known = {**self.constants, **{name: value for name, (value, _) in self.values.items()}, **self.computed}
        return {**known, **{label: known[name] for scope in self.scopes for label, name in scope.items() if name in known}}

    def _relations(self, submodel: Submodel, old: str, new: str) -> Component | None:
        """Enter the global relations of a submodel; relations with results become a component."""
        self.scopes.append({})
        relations = submodel.relations
        if relations is None:
            return None
        outer = "|".join(re.escape(identifier(item.name)) for item in (*relations.parameters, *relations.variables)
                         if item.is_global and item.value is None)
        for group in (relations.constants, relations.parameters, relations.variables):
            group[:] = [replace(item, words=(*item.words, "global")) for item in group]
        relations.parameters[:0] = relations.constants
        relations.constants = []
        builder = Builder(Submodel(GLOBALS, submodel.line, type="Globals", equations=relations), submodel.comments,
                          known=self._known())
        component = builder.build()
        component.line, component.name = submodel.line, f"{title(submodel)}Globals" if new else "Globals"
        self._experiment(component, old, builder)
        prefix = f"{new.replace('.', '_')}_" if new else ""
        # `global` without a value belongs to an enclosing submodel, or to another submodel that assigns it
        self.scopes[-1] = {label: f"{prefix}{label}" for label in (*component.shared.values(), *component.gives.values())
                           if not (outer and re.fullmatch(f"({outer})(_[0-9]+)*", identifier(label)))}
        component.shared = {local_name: self.scoped(label) for local_name, label in component.shared.items()}
        component.gives = {local_name: self.scoped(label) for local_name, label in component.gives.items()}
        for local_name, label in component.shared.items():
            if (value := component.items[local_name].value) is not None:
                self.values[label] = value, component.items[local_name].unit
        if component.equations or component.events or component.untranslated:
            return component
        self.notes += [(new, line, why) for line, why in component.omitted]
        return None

    def submodel(self, submodel: Submodel, old: str, new: str,
                 ends: list[tuple[str, str, str]]) -> Component | Block:
        """A submodel with its path in 20-sim (`a\\b`) and in the diagram (`a.b`)."""
        if submodel.equations is None and (submodel.submodels or submodel.connections):
            block = self.block(submodel, old, new)
            if block.parts:
                return block
            self.blocks.remove((new, block))
            through = Component(block.name, "", line=block.line, items=block.items, elements=block.elements)
            through.untranslated += block.untranslated
            passing(through, block.equations, self._ends(submodel, {part.name: part for part in submodel.submodels})[0])
            self.components.append((new, through))
            return through
        computed = self._relations(submodel, old, new)
        prefix = f"{old}\\" if old else ""
        texts = {**self.texts, **{n[len(prefix):]: text for n, text in self.emx.texts.items() if n.startswith(prefix)}}
        builder = Builder(submodel, self.comments, ends, self._known(), texts, self.emx.path.parent,
                          id(submodel) in self.sampling.discrete, self.sampling.held.get(id(submodel), ()), [
                              label[len(prefix):] for name in self.emx.plotted for label in labels(name)
                              if label.startswith(prefix)],
                          lambda name: self.emx.stated(f"{prefix}{name}"), self.sampling.sampled.get(id(submodel), ()),
                          self.programs)
        component = builder.build()
        sampled = None if id(submodel) in self.sampling.discrete else self.sampling.sampled.get(id(submodel), ())
        if sampled != () and not component.untranslated:
            # plotted variables of a discrete submodel keep their values between the samples; `sampled` are the names of such
            # variables in one with continuous parts
            for plotted in (label for name in self.emx.plotted for label in labels(name)):
                name = plotted[len(prefix):]
                item = component.items.get(name)
                if not plotted.startswith(prefix) or (sampled is not None and name not in sampled):
                    continue
                if item is not None and item.kind in ("variable", "out", "held") and name not in component.sampled_values:
                    component.sampled_values[name] = builder.memory.at_samples(f.name(name))
        if computed is not None:
            component.untranslated.append((submodel.line,
                                           "its global relations have results, which is supported in a submodel "
                                                     "of submodels only"))
        if SAMPLE_TIME in component.shared:
            component.items[SAMPLE_TIME].value = self.sampling.times.get(id(submodel))
        component.name = title(submodel, self.library)
        component.shared = {local_name: self.scoped(label) for local_name, label in component.shared.items()}
        component.gives = {local_name: self.scoped(label) for local_name, label in component.gives.items()}
        if submodel.equations is None and submodel.ports:
            component.untranslated.append((submodel.line, "it has no implementation"))
        self._experiment(component, old, builder)
        self.scopes.pop()
        self.components.append((new, component))
        return component

    def finish(self) -> None:
        """Set the initial values, after all global quantities that are known before the run have been determined."""
        for _, component in self.components:
            self.computed.update({label: value for local_name, label in component.shared.items()
                                  if label not in self.computed
                                  and (value := component.items[local_name].value) is not None})
        size = -1
        while size != len(self.computed):
            size = len(self.computed)
            for component, _, builder in self.pending:
                known = _known_values(component, builder, self._of_globals(component)) if component.gives else {}
                self.computed.update({label: known[local_name] for local_name, label in component.gives.items()
                                      if local_name in known and label not in self.computed})
        for component, prefix, builder in self.pending:
            # initial values from the experiment, or from the equations; a parameter without a value is 0
            values = dict.fromkeys((item.name for item in component.of_kind("parameter")), 0.0) | self._of_globals(component)
            known = _known_values(component, builder, values)
            for held, first in component.first.items():
                value = fold(first, known)
                if value is None:
                    why = f"the first value of '{held}' depends on the run; 0 is used"
                    component.omitted.append((builder.submodel.line, why))
                component.items[held].value = value or 0.0
            for variable, first in list(component.initial.items()):
                of_element = re.sub(r"((?:_[0-9]+)*)$", r"_initial\1", variable)  # x_initial[2]
                stated = self.emx.initials.get(f"{prefix}{variable}_initial", self.emx.initials.get(f"{prefix}{of_element}"))
                value = fold(first, known) if stated is None else stated
                if value is None:
                    why = f"the initial value of '{variable}' depends on the run; 0 is used"
                    component.omitted.append((builder.submodel.line, why))
                component.initial[variable] = first.__class__("number", value=value or 0.0)

    def _of_globals(self, component: Component) -> dict[str, float]:
        """The known values of the global quantities that a component needs, by its local names."""
        known = {**self.computed, **{name: value for name, (value, _) in self.values.items()}}
        return {local_name: known[label] for local_name, label in component.shared.items() if label in known}

    def _experiment(self, component: Component, old: str, builder: Builder) -> None:
        """Values of the experiment. 20-sim writes 0 for parameters of global relations that it has not compiled; then the
        value in the text is used."""
        prefix = f"{old}\\" if old else ""
        relations = builder.submodel.name == GLOBALS
        for item in component.of_kind("parameter"):
            stated = self.emx.stated(f"{prefix}{item.name}")
            if stated is None and item.name in component.shared:
                stated = self.emx.stated(identifier(component.shared[item.name]))
            if relations and stated == 0 and item.value:
                why = f"the experiment states 0 for '{item.name}', and the global relations {item.value:g}, which is used"
                component.omitted.append((component.line, why))
            elif stated is not None and not (stated == 0
                                             and self.scoped(component.shared.get(item.name, "")) in self.values):
                item.value = stated
        self.pending.append((component, prefix, builder))

    def block(self, submodel: Submodel, old: str, new: str) -> Block:
        """The parts of a submodel and their nodes."""
        block = Block(title(submodel, self.library), "", line=submodel.line)
        block.untranslated += submodel.problems
        computed = self._relations(submodel, old, new)
        for port in submodel.ports:
            if port.terminals:  # of a block: its parts are connected to each terminal
                for label in (f"{port.name}_high", f"{port.name}_low"):
                    block.elements[label] = [identifier(label)]
                    block.items[identifier(label)] = Item(identifier(label), "bond", "", port.domain)
                continue
            # the names of the elements of a port, with the values of global quantities
            known = self._known()
            sizes = [round(fold(e, known) or 1) for e in port.size]
            rows, columns = (*sizes, 1, 1)[:2] if sizes else (1, 1)
            base = identifier(port.name)
            if rows * columns == 1 or rows * columns > 2000:
                block.elements[port.name] = [base]
            else:
                block.elements[port.name] = [f"{base}_{i + 1}" for i in range(rows)] if columns == 1 \
                    else [f"{base}_{i + 1}_{k + 1}" for i in range(rows) for k in range(columns)]
            for name in block.elements[port.name]:
                kind = port.direction if port.domain == "signal" else "bond"
                block.items[name] = Item(name, kind, port.unit if kind != "bond" else "",
                                         "" if port.domain in ("signal", "power") else port.domain)
        if computed is not None:
            name = _unused("globals", {identifier(part.name) for part in submodel.submodels})
            self.components.append((f"{new}.{name}" if new else name, computed))
            block.parts["\\globals"] = Part(name, computed, min((p.x for p in submodel.submodels), default=0.0) - 80,
                                            max((p.y for p in submodel.submodels), default=0.0))
        by_name = {part.name: part for part in submodel.submodels}
        used_names = {part.name for part in block.parts.values()}
        nets, ends = self._ends(submodel, by_name)
        for part in submodel.submodels:
            if _alias(part, ends.get(part.name, [])):
                continue
            name = _unused(identifier(part.name), used_names)
            used_names.add(name)
            part_name = identifier(part.name)
            inner = self.submodel(part, f"{old}\\{part_name}" if old else part_name, f"{new}.{name}" if new else name,
                                  ends.get(part.name, []))
            placed = Part(name, inner, part.x, part.y)
            placed.elements = {**inner.elements, **{
                label: inner.elements[identifier(label)] for _, label, _ in ends.get(part.name, [])
                if identifier(label) in inner.elements}}
            block.parts[part.name] = placed
        self._nodes(block, nets)
        self.scopes.pop()
        self.blocks.append((new, block))
        return block

    def _ends(self, submodel: Submodel, by_name: Mapping[str, Submodel]
              ) -> tuple[Nets, dict[str, list[tuple[str, str, str]]]]:
        """Connections as nets, and for each knot its ends: (port, name of the end, direction)."""
        ends: dict[str, list[tuple[str, str, str]]] = {}
        labelled: list[tuple[str, str]] = []
        for connection in submodel.connections:
            pair = []
            for end, direction in ((connection.start, "out"), (connection.stop, "in")):
                name, _, port = end.rpartition("\\")
                part = by_name.get(name)
                declared = next((p for p in part.ports if p.name == port), None) if part else None
                if part is not None and declared is not None and declared.many and not part.submodels:
                    knot_ends = ends.setdefault(name, [])
                    label = f"{port}_{sum(p == port for p, *_ in knot_ends) + 1}"
                    knot_ends.append((port, label, direction))
                    pair.append(f"{name}\\{label}")
                else:
                    side = port.removesuffix("_high").removesuffix("_low")
                    if part is not None and ((part.knot and declared is not None) or
                                             any(p.terminals and p.name == side for p in part.ports)):
                        ends.setdefault(name, []).append((port, port, direction))
                    pair.append(end)
            labelled.append((pair[0], pair[1]))
        nets = Nets()
        for a, b in labelled:
            alias = [f"{e.rpartition(chr(92))[0]}\\" if (e.rpartition("\\")[0] in by_name and _alias(
                by_name[e.rpartition("\\")[0]], ends.get(e.rpartition("\\")[0], []))) else e for e in (a, b)]
            nets.join(alias[0], alias[1])
        return nets, ends

    def _nodes(self, block: Block, nets: Nets) -> None:
        for group in nets.groups():
            inner = [(block.parts[e.rpartition("\\")[0]], e.rpartition("\\")[2]) for e in group
                     if e.rpartition("\\")[0] in block.parts]
            knot_elements = [e for e in group if e in block.elements]
            widths = {len(p.elements.get(port, [port])) for p, port in inner} | {len(block.elements[e])
                                                                                 for e in knot_elements}
            if len(widths) > 1:
                block.untranslated.append((block.line, f"the ends of {', '.join(group)} have different sizes"))
            for k in range(min(widths, default=0)):
                self._node(block, [(p, p.elements.get(port, [port])[k]) for p, port in inner],
                           [block.elements[e][k] for e in knot_elements])
        for part in block.parts.values():
            # power ports without a connection are free ends; inputs without one are 0, as in 20-sim
            joined = {end for ends in block.nodes.values() for end in ends}
            for item in part.content.items.values():
                if f"{part.name}.{item.name}" in joined:
                    continue
                if item.kind == "bond":
                    used_names = {*block.items, *(p.name for p in block.parts.values()), *block.nodes}
                    block.nodes[_unused(f"{part.name}_{item.name}", used_names)] = [f"{part.name}.{item.name}"]
                    if isinstance(part.content, Component) and part.content.untranslated:  # no flow: its effort is 0
                        part.content.equations = [(Expr(left.op, left.args, f"{item.name}.e"), right, comment)
                                                  if left.name == f"{item.name}.f" else (left, right, comment)
                                                  for left, right, comment in part.content.equations]
                elif item.kind == "in" and item.name not in getattr(part.content, "shared", {}):
                    part.inputs[item.name] = "0"
        driven = {end for ends in block.nodes.values() for end in ends} | {left for left, _ in block.equations}
        for item in block.items.values():
            if item.kind == "out" and item.name not in driven:
                block.equations.append((item.name, "0"))
                block.untranslated.append((block.line, f"the output '{item.name}' is connected to nothing; it is 0"))

    def _node(self, block: Block, inner: list[tuple[Part, str]], block_ends: list[str]) -> None:
        for p, e in inner:
            if e not in p.content.items:
                why = f"a connection ends at '{p.name}\\{e}', which is not a port; it is left out"
                block.untranslated.append((block.line, why))
        inner = [(p, e) for p, e in inner if e in p.content.items]
        kinds = {e: block.items[e].kind for e in block_ends}
        bonds = [f"{p.name}\\{e}" for p, e in inner if p.content.items[e].kind == "bond"]
        bonds += [e for e in block_ends if kinds[e] == "bond"]
        if bonds and len(bonds) < len(inner) + len(block_ends):
            block.untranslated.append((block.line, f"a signal is connected to the power port '{bonds[0]}'; it is left out"))
            inner = [(p, e) for p, e in inner if p.content.items[e].kind != "bond"]
            block.equations += [(f"{e}.f", "0") for e in block_ends if kinds[e] == "bond"]
            block_ends = [e for e in block_ends if kinds[e] != "bond"]
        sources = [(p, e) for p, e in inner if p.content.items[e].kind == "out"]
        inputs_of_block = [e for e in block_ends if kinds[e] == "in"]
        outs = [e for e in block_ends if kinds[e] == "out"]
        ends = [f"{p.name}.{e}" for p, e in (*sources, *((p, e) for p, e in inner if (p, e) not in sources))]
        if inputs_of_block and outs:
            block.equations += [(out, inputs_of_block[0]) for out in outs]
            outs = []
        elif len(outs) > 1:
            block.equations += [(out, outs[0]) for out in outs[1:]]
            outs = outs[:1]
        ends += [e for e in block_ends if kinds[e] == "bond"] + inputs_of_block + outs
        if not inner or len(ends) < 2:
            return
        first, element = (sources or inner)[0]
        used_names = {*block.items, *(part.name for part in block.parts.values()), *block.nodes}
        block.nodes[_unused(f"{first.name}_{element}", used_names)] = ends


def _alias(part: Submodel, ends: list[tuple[str, str, str]]) -> bool:
    """True if a knot is only a node: a splitter, or a 0-junction whose effort no signal takes."""
    if not part.knot or part.equations is None:
        return False
    lines = part.equations.equations
    ports = {p.name for p in part.ports}
    if all(isinstance(s, Assign) and s.left.name.lower() == "collect" and s.right.op == "name" and s.right.name in ports
           for s in lines):
        return bool(lines)
    if any(port != "p" for port, *_ in ends) or any(p.domain in ("translation", "rotation") for p in part.ports):
        return False
    equal = [s.call.args[0] for s in lines if isinstance(s, Do) and s.call.name.lower() == "equal" and s.call.args]
    return bool(equal) and equal[0].op == "call" and bool(equal[0].args) and equal[0].args[0].name in ("p.e", "p.a", "p.p")


__all__ = ["Block", "Connection", "Part", "Translator", "Unreadable"]


# -- ends of connections that form one node ----------------------------------------------------------------------------
class Nets:
    """Ends of connections that form one node."""

    def __init__(self) -> None:
        self.parent: dict[str, str] = {}

    def find(self, end: str) -> str:
        self.parent.setdefault(end, end)
        while self.parent[end] != end:
            self.parent[end] = self.parent[self.parent[end]]
            end = self.parent[end]
        return end

    def join(self, a: str, b: str) -> None:
        self.parent[self.find(b)] = self.find(a)

    def groups(self) -> list[list[str]]:
        groups: dict[str, list[str]] = {}
        for end in self.parent:
            groups.setdefault(self.find(end), []).append(end)
        return list(groups.values())


def passing(component: Component, equations: Iterable[tuple[str, str]], nets: Nets) -> None:
    """Give a component the equations of a submodel without parts, whose ports are connected to each other: signals are
    equal, and bonds have one effort and flows whose sum is 0. `equations` are the known equations between its signals."""
    component.equations = [(f.name(left), f.number(0) if right == "0" else f.name(right), "") for left, right in equations]
    set_names = {left.name for left, *_ in component.equations}
    for group in nets.groups():
        for elements in zip(*(component.elements[e] for e in group if e in component.elements), strict=False):
            inputs, outputs, bonds = ([e for e in elements if component.items[e].kind == kind]
                                      for kind in ("in", "out", "bond"))
            component.equations += [(f.name(e), f.name(inputs[0]), "") for e in outputs if inputs and e not in set_names]
            component.equations += [(f.name(f"{e}.e"), f.name(f"{bonds[0]}.e"), "") for e in bonds[1:]]
            if bonds:
                component.equations.append((reduce(f.add, (f.name(f"{e}.f") for e in bonds)), f.number(0), ""))
