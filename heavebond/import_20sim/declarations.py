"""The symbols of a submodel: constants, ports, parameters and variables as items of a component."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial

from heavebond.import_20sim import formula_text as f
from heavebond.import_20sim.assignments import counts
from heavebond.import_20sim.choices import names
from heavebond.import_20sim.component import Component, Item
from heavebond.import_20sim.evaluate import MEMBERS, MOST_ELEMENTS, Calculus, Evaluator, fold
from heavebond.import_20sim.expressions_parser import Unreadable, unit_of
from heavebond.import_20sim.matrices import Matrix
from heavebond.import_20sim.names import identifier
from heavebond.import_20sim.sidops_tree import Declared, Equations, Expr, Port, Submodel

ACROSS_IS_FLOW = {"translation", "rotation", "mechanical"}


class Symbols:
    """The names of a submodel with their elements; `ends` are the connections of a knot's ports (name, direction),
    `known` the values of global quantities, `stated` gives the value of a constant in the experiment by its name, or
    None."""

    def __init__(self, submodel: Submodel, component: Component, calculus: Calculus, ends: Iterable[tuple[str, str, str]],
                 known: Mapping[str, float], stated: Callable[[str], float | None]):
        self.submodel, self.component, self.known = submodel, component, known
        self.source = submodel.equations or Equations()
        self.names: dict[str, Matrix] = {}
        self.many: dict[str, list[tuple[str, bool]]] = {}  # for a knot's port: elements and True if they point out
        self.numbers: dict[str, float] = {}
        self.evaluate = Evaluator(self.names, self.numbers, calculus)
        self.ends = list(ends)
        self.stated = stated

    def declare(self) -> None:
        """Enter all symbols; unreadable ones are listed in the component."""
        for constant in self.source.constants:
            self.guard(partial(self._constant, constant), constant.line)
        everything = [*self.submodel.parameters, *self.source.parameters]
        for parameter in everything:  # sizes may need whole parameters
            if parameter.kind == "integer" and not parameter.size:
                value = fold(parameter.value, self.numbers) if parameter.value is not None else \
                    self.known.get(parameter.name) if parameter.is_global else None
                if value is not None:
                    stated = self.stated(identifier(parameter.name))
                    self.numbers[parameter.name] = value if stated is None else stated
        for port in self.submodel.ports:
            self.guard(partial(self._port, port), port.line)
        for parameter in everything:
            self.guard(partial(self._parameter, parameter), parameter.line)
        for variable in [*self.submodel.variables, *self.source.variables, *self.source.externals]:
            self.guard(partial(self._variable, variable), variable.line)
        source = self.source
        sizes = [port.size for port in self.submodel.ports] + [v.size for v in (*self.submodel.variables, *source.variables)]
        loops = map(counts, (*source.initial, *source.equations, *source.code))
        fixed = {n for size in sizes for e in size for n in names(e)}.union(*loops)
        for parameter in everything:
            if not parameter.size and parameter.name not in fixed:
                self.numbers.pop(parameter.name, None)

    def guard(self, action: Callable[[], None], line: int) -> None:
        """Perform an action; list a construct that cannot be read."""
        try:
            action()
        except Unreadable as problem:
            self.component.untranslated.append((problem.line or line, problem.reason))

    def _constant(self, item: Declared) -> None:
        if item.kind == "string":
            return
        if item.is_global and (item.size or item.value is None):  # global quantity of another submodel, or for others
            if item.size or (value := self.known.get(item.name)) is None:
                self._parameter(item)
            else:
                self.numbers[item.name] = value
            return
        if item.value is None:
            return
        if item.size:
            values = self.evaluate(item.value)
            known = [[fold(e, self.numbers) for e in row] for row in values]
            rows, columns = self._shape(item.size)
            flat = [e for row in known for e in row]
            flat = flat * (rows * columns) if len(flat) == 1 else flat
            if len(flat) != rows * columns or None in flat:
                raise Unreadable(item.line, f"the constant '{item.name}' is not {rows} x {columns} known numbers")
            labels = [name for row in self._elements(item.name, item.size, unique=False) for name in row]
            flat = [old if (new := self.stated(name)) is None else new for name, old in zip(labels, flat, strict=True)]
            self.names[item.name] = [[f.number(flat[i * columns + k] or 0.0) for k in range(columns)] for i in range(rows)]
            return
        value = self.stated(identifier(item.name))
        value = fold(self.evaluate.scalar(item.value), self.numbers) if value is None else value
        if value is not None:
            self.numbers[item.name] = value

    def _shape(self, size: tuple[Expr, ...]) -> tuple[int, int]:
        sizes = [self.evaluate.whole(e) for e in size]
        rows, columns = (*sizes, 1, 1)[:2] if sizes else (1, 1)
        if rows < 1 or columns < 1 or rows * columns > MOST_ELEMENTS:
            raise Unreadable(self.submodel.line, f"a size of {rows} x {columns} is not possible")
        return rows, columns

    def _elements(self, label: str, size: tuple[Expr, ...], *, unique: bool = True) -> list[list[str]]:
        """The names of the elements of a quantity: `x`, or `x_1`, `x_2`, or `x_1_1` ..."""
        rows, columns = self._shape(size)
        base = identifier(label)
        while True:
            if (rows, columns) == (1, 1):
                element_names = [[base]]
            elif columns == 1:
                element_names = [[f"{base}_{i + 1}"] for i in range(rows)]
            else:
                element_names = [[f"{base}_{i + 1}_{k + 1}" for k in range(columns)] for i in range(rows)]
            if not unique or not any(name in self.component.items
                                     for name in (base, *(e for row in element_names for e in row))):
                return element_names
            base += "_"

    def _port(self, port: Port) -> None:
        if port.terminals:
            self._terminals(port)
            return
        if not port.many:
            self._end(port, port.name, self._elements(port.name, port.size, unique=False), port.direction == "out")
            return
        self.many[port.name] = [(identifier(name), direction == "out") for port_name, name, direction in self.ends
                                if port_name == port.name]
        rows, columns = self._shape(port.size)
        for label, out in self.many[port.name]:
            group = [[label]] if rows * columns == 1 else [[f"{label}_{i + 1}"] for i in range(rows * columns)]
            self._end(port, label, group, out)
        if not self.submodel.knot and port.domain != "signal":
            # a port of an element with several possible connections: its ends share the across quantity, and the through
            # quantities are added
            if not self.many[port.name]:
                self._end(port, port.name, [[identifier(port.name)]], port.direction == "out")
            else:
                (first, _), *further_ends = self.many[port.name]
                across = self.names[f"{first}.a"]
                through = None
                for name, out in self.many[port.name]:
                    terminal = self.names[f"{name}.t"]
                    signed = [[f.negative(e) if out != (port.direction == "out") else e for e in row] for row in terminal]
                    through = signed if through is None else [[f.add(a, b) for a, b in zip(r, s, strict=True)]
                                                              for r, s in zip(through, signed, strict=True)]
                for name, _ in further_ends:
                    for mine, their_name in zip(across, self.names[f"{name}.a"], strict=True):
                        self.component.equations += [(b, a, "") for a, b in zip(mine, their_name, strict=True)]
                assert through is not None
                effort, flow = (through, across) if port.domain in ACROSS_IS_FLOW else (across, through)
                self._members(port, port.name, effort, flow)

    def _end(self, port: Port, label: str, group: list[list[str]], out: bool) -> None:
        """One port of the component with its elements."""
        names = [e for row in group for e in row]
        self.component.elements[label] = names
        if port.domain == "signal":
            for name in names:
                self.component.items[name] = Item(name, "out" if port.direction == "out" else "in", port.unit, port.doc)
            self.names[label] = [[f.name(e) for e in row] for row in group]
            return
        doc = port.doc or ("" if port.domain == "power" else port.domain)
        for name in names:
            self.component.items[name] = Item(name, "bond", "", doc, out=out)
        effort = [[f.name(f"{e}.e") for e in row] for row in group]
        flow = [[f.negative(f.name(f"{e}.f")) if out else f.name(f"{e}.f") for e in row] for row in group]
        self._members(port, label, effort, flow)

    def _terminals(self, port: Port) -> None:
        """A port with two terminals: the across quantity is the difference between them, and the through quantity is
        equal.
        """
        high, low = (identifier(f"{port.name}_{side}") for side in ("high", "low"))
        for name in (high, low):
            self.component.items[name] = Item(name, "bond", "", port.domain)
            self.component.elements[name] = [name]
        out = port.direction == "out"
        if port.domain not in ACROSS_IS_FLOW:
            effort = Expr("-", (f.name(f"{high}.e"), f.name(f"{low}.e")))
            flow = f.name(f"{high}.f")
            self.component.equations.append((f.name(f"{low}.f"), f.negative(flow),
                                             "what enters at one end leaves at the other"))
            self._members(port, port.name, [[effort]], [[f.negative(flow) if out else flow]])
            return
        directions = {name: direction for _, name, direction in self.ends}
        speeds = [f.negative(f.name(f"{n}.f")) if directions.get(n) == "out" else f.name(f"{n}.f") for n in (high, low)]
        force = f.name(f"{high}.e")
        same = (directions.get(high) == "out") != (directions.get(low) == "out")  # the arrows pass through the element
        self.component.equations.append((f.name(f"{low}.e"), force if same else f.negative(force),
                                         "the force passes through"))
        reverse = (directions.get(high) == "out") != out
        self._members(port, port.name, [[f.negative(force) if reverse else force]], [[Expr("-", (speeds[0], speeds[1]))]])

    def _members(self, port: Port, label: str, effort: Matrix, flow: Matrix) -> None:
        """The names of the quantities of a port in equations."""
        a, b = MEMBERS.get(port.domain, ("e", "f"))
        across, through = (flow, effort) if port.domain in ACROSS_IS_FLOW else (effort, flow)
        self.names.update({f"{label}.e": effort, f"{label}.f": flow, f"{label}.{a}": effort, f"{label}.{b}": flow,
                           f"{label}.a": across, f"{label}.t": through})

    def _parameter(self, item: Declared) -> None:
        if item.kind == "string":
            return
        names = self._elements(item.name, item.size)
        unit = unit_of(item.unit)
        values: list[Expr] = []
        if item.value is not None:
            values = [e for row in self.evaluate(item.value) for e in row]
            count = len(names) * len(names[0])
            values = values * count if len(values) == 1 else values
            if len(values) != count:
                raise Unreadable(item.line, f"'{item.name}' has {len(values)} values for {count} elements")
        values_known = {**self.known, **{n: i.value for n, i in self.component.items.items() if i.value is not None}}
        for k, name in enumerate(e for row in names for e in row):
            value = fold(values[k], {**values_known, **self.numbers}) if values else None
            if values and value is None:
                self.component.omitted.append((item.line, f"the value of the parameter '{item.name}' is not a known number"))
            self.component.items[name] = Item(name, "parameter", unit.base, " ".join(filter(None, (item.doc, unit.doc))),
                                              None if value is None else unit.si(value), before="" if k else item.before)
            if item.is_global:
                self.component.shared[name] = f"{item.name}{name[len(identifier(item.name)):]}"
        self.names[item.name] = [[f.name(e) for e in row] for row in names]

    def _variable(self, item: Declared) -> None:
        if item.kind == "string" or item.name in self.names:
            return
        names = self._elements(item.name, item.size)
        unit = unit_of(item.unit)
        for k, name in enumerate(e for row in names for e in row):
            kind = "in" if "import" in item.words else "variable"
            self.component.items[name] = Item(name, kind, unit.base, " ".join(filter(None, (item.doc, unit.doc))),
                                              before="" if k else item.before)
            if item.is_global and kind == "variable":
                index = "" if len(names) == 1 else name[len(identifier(item.name)):]
                self.component.gives[name] = f"{item.name}{index}"
        self.names[item.name] = [[f.name(e) for e in row] for row in names]
