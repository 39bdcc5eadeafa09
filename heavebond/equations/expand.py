"""Expansion of a diagram: every component with equations and every node inside its blocks, by full path."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace

from heavebond.core.errors import HeavebondError, ModelError, Place, Problem, Problems, listing, suggest
from heavebond.core.limits import EXPANDED, OF_A_KIND
from heavebond.core.units import is_generic
from heavebond.equations.arrays import by_elements, shared, vector_outputs
from heavebond.equations.data_sheets import DataSheet, data_sheets, value_by_sheet, whole
from heavebond.equations.expanded import Bound, Expanded, Leaf
from heavebond.equations.wires import Wires
from heavebond.language.definition import Body, Component, End, FileInput, Instance, Parameter, Value, Wire
from heavebond.language.lists import lengths, short, written_out, written_size
from heavebond.language.model import Model
from heavebond.language.sections import Setting
from heavebond.language.values import bounds_text, check_bounds, check_dimension
from heavebond.text.expression import Expr, Name, Number, constant
from heavebond.text.shapes import whole_number

DEEPEST_BLOCK = 20


def expand(model: Model) -> Expanded:
    """Open every block of the diagram; ModelError with all problems of names, ports and wires.

    Parameters that are taken from the medium of a circuit are still open (see `medium`).
    """
    expanded, problems = expand_as_far(model)
    problems.raise_as(ModelError)
    return expanded


def expand_as_far(model: Model) -> tuple[Expanded, Problems]:
    """An incomplete diagram, opened as far as possible, and its problems: parts of unknown kinds, invalid ends of wires and
    missing values are left out. ModelError for a diagram that is too large to be opened."""
    opener = _Opener(model)
    opener.top()
    opener.wires.arrays()
    show = vector_outputs(model.show, opener.component, lambda: {
        *opener.wires.junctions, *(end.name for junction in opener.wires.junctions.values() for end in junction.ends)})
    if len(show) != len(model.show):
        model = replace(model, show=show)
    wires = opener.wires
    expanded = Expanded(model, opener.leaves, wires.junctions, opener.parameters, wires.ports, wires.signals,
                        sheets={path: tuple(takers) for path, takers in opener.sheets.items()},
                        approximated=tuple(opener.approximated), defaults=wires.by_default)
    return expanded, opener.problems


class _Opener:
    def __init__(self, model: Model):
        self.model = model
        self.problems = Problems()
        self.leaves: dict[str, Leaf] = {}
        self.parameters: dict[str, Bound] = {}
        self.unused = dict(model.settings)
        self.wires = Wires(self.leaves, self.unused, self.problems)
        self.settable: list[str] = []
        self.components: dict[str, Component] = {}  # by kind
        self.inside: dict[str, tuple[Instance, str]] = {}  # parts that take the place of those of blocks, and their scopes
        self.scopes: dict[str, str] = {}
        self.sheets: dict[str, list[str]] = {}
        self.size = 0  # see EXPANDED
        self.approximated: list[tuple[str, str, str]] = []

    def top(self) -> None:
        model = self.model
        for name, value in model.parameters.items():
            setting = self._setting(name)
            bound = Bound(value, "", value.place) if setting is None else Bound(setting.value, "", setting.place)
            self.parameters[name] = bound
        if not model.body.instances:
            self.problems.add("diagram-empty", "this diagram has no components", Place(model.path.name, 1),
                              hint="Add `components:` and `nodes:`.")
        self._body(model.body, "", None, {}, ())
        for path, setting in self.unused.items():
            owner, _, member = path.rpartition(".")
            settable = [s for s in self.settable if s.rpartition(".")[0] == owner]
            message, choices = f"nothing here is called '{path}', so it cannot be set", self.settable
            if owner in self.leaves:
                component = self.leaves[owner].component
                message, choices = f"'{owner}' ({component.name}) has no parameter '{member}'", settable
            elif owner in self.wires.junctions:
                message, choices = f"'{path}' changes during a run; only parameters and inputs are set", []
            hint = suggest(path, choices) or (f"What can be set: {listing(choices, 20)}." if choices else
                                              "Its value at the start is given under `initial:`.")
            self.problems.add("setting-unknown", message, setting.place, hint=hint)
        self.wires.inside_blocks()
        for path, (instance, _) in self.inside.items():
            self.problems.add("part-unknown", f"there is no part '{path}' inside a block", instance.place,
                              hint=suggest(path, self.leaves) or f"Parts: {listing(self.leaves)}.")

    def _setting(self, path: str) -> Setting | None:
        self.settable.append(path)
        return self.unused.pop(path, None)

    def component(self, path: str) -> Component | None:
        """The component at a path."""
        leaf = self.leaves.get(path)
        return None if leaf is None else leaf.component

    # -- one level -------------------------------------------------------------------------------------------------
    def _body(self, body: Body, prefix: str, owner: Component | None, integers: dict[str, int],
              kinds: tuple[str, ...]) -> None:
        # the parts that a diagram or block around this body substitutes for its own; the outermost substitution counts
        for path, instance in body.inside.items():
            self.inside.setdefault(prefix + path, (instance, prefix))
        instances = dict(body.instances)
        for name in instances:
            if (replacement := self.inside.pop(prefix + name, None)) is not None:
                instances[name], self.scopes[prefix + name] = replace(replacement[0], name=name), replacement[1]
        body = replace(body, instances=instances)
        numbers = dict(integers)
        for name, bound in self.parameters.items() if not prefix else ():
            if isinstance(bound.value, Value) and (number := whole_number(bound.value.expr, numbers)) is not None:
                numbers[name] = number
        body = repeated(body, numbers, lambda instance: self._component(instance, kinds), self.problems)
        for wire in body.wires.values():
            part = body.instances.get(wire.name)
            if part is not None and not any(e.path.split(".")[0] == wire.name for e in wire.ends):
                self.problems.add("name-twice", f"node '{wire.name}' has the name of a component that is not on it",
                                  wire.place, hint="Give the node another name.")
        if owner is None:
            for name, value in self.model.parameters.items():
                if name in body.instances or name in body.wires:
                    self.problems.add("name-twice", f"'{name}' is a parameter and a component or node", value.place,
                                      hint="Give one of them another name.")
        known: dict[str, Component] = {}
        for instance in body.instances.values():
            component = self._component(instance, kinds)
            if component is not None:
                known[instance.name] = component
        self.wires.join(body, prefix, owner, known)
        for name, component in known.items():
            sheets = data_sheets(body.instances[name], body, known, prefix, self.model, self.problems) \
                if body.instances[name].data else ()
            self._instance(body.instances[name], component, prefix, integers, kinds, sheets)
            for sheet in sheets:
                self.sheets.setdefault(sheet.path, []).extend(sheet.takers)

    def _component(self, instance: Instance, kinds: tuple[str, ...]) -> Component | None:
        try:
            component = self.components.get(instance.kind)
            if component is None:  # its file is read and its laws are checked
                library = self.model.library
                component = self.components[instance.kind] = library.component(instance.kind, instance.kind_place)
                library.checked(instance.kind, instance.kind_place)
        except HeavebondError as error:
            self.problems.extend(error)
            return None
        if component.name in kinds or len(kinds) > DEEPEST_BLOCK:
            circle = [*kinds[kinds.index(component.name):], component.name] if component.name in kinds else [*kinds]
            self.problems.add("block-contains-itself", f"'{circle[0]}' contains itself: {' > '.join(circle)}"
                              if component.name in kinds else f"blocks are nested more than "
                              f"{DEEPEST_BLOCK} deep", instance.place,
                              hint="A block is made of other components; leave one of these parts out.")
            return None
        return component

    def _instance(self, instance: Instance, component: Component, prefix: str, outer: dict[str, int],
                  kinds: tuple[str, ...], sheets: tuple[DataSheet, ...]) -> None:
        path = prefix + instance.name
        if any(p.columns is not None for p in component.parameters.values()):
            instance = replace(instance, settings=by_elements(instance.settings, component))
        parameters: dict[str, Bound] = {}
        missing: list[str] = []
        sizes = lengths(component, lambda name: name in instance.settings or f"{path}.{name}" in self.unused
                        or name in component.values or any(sheet.has(name) for sheet in sheets))
        for name in (n for n, p in component.parameters.items() if p.integer):
            bound = self._setting_or_value(instance, name, prefix, path)
            if bound is None and (value := whole(sheets, name, f"{path}.{name}")) is not None:
                bound = Bound(value, "", value.place)
            if bound is None and name in sizes:  # a whole number that follows from the length of a list
                number = Value(Number(sizes[name], None, 0), f"{sizes[name]} values", instance.place, si=True)
                bound = Bound(number, "", instance.place)
            bound = bound or default(component.parameters[name], path)
            if bound is not None:
                parameters[name] = bound
        integers = self._integers(component, parameters, outer)
        if component.approximation and (integers.get(component.approximation.order) or (
                self.model.approximate and not self._passes_through(instance, component, path))):
            self._approximated(instance, component, prefix, outer, kinds, sheets)
            return
        self._check_size(path, written_size(component, integers) + len(component.body.wires))
        component = written_out(component, integers)
        for name, parameter in component.parameters.items():
            bound = parameters.get(name) or self._setting_or_value(instance, name, prefix, path)
            if bound is None and (value := value_by_sheet(sheets, name, f"{path}.{name}", instance.place)) is not None:
                bound = Bound(value, "", instance.place)
            if bound is None and parameter.medium:
                continue  # its circuit decides
            if bound is None and (value := component.values.get(name)) is not None:  # an element of a list, by an extension
                bound = Bound(value, path + ".", value.place)
            bound = bound or default(parameter, path)
            if bound is None:
                missing.append(name)
            elif isinstance(bound.value, FileInput):
                self.problems.add("parameter-file", f"{path}.{name} is a constant; a record cannot set it",
                                  bound.place, hint="Give it a quantity; records are for inputs.")
            else:
                parameters[name] = bound
                literal, before = bound.value, len(self.problems.found)
                # a plain quantity has the right unit and lies within its bounds; formulas are checked when all are known
                if isinstance(literal.expr, Number) and not literal.si and not parameter.integer \
                        and not is_generic(parameter.unit.dimension):
                    check_dimension(f"{path}.{name}", literal, None, parameter.unit, self.problems)
                    if len(self.problems.found) == before:
                        check_bounds(f"{path}.{name}", parameter, literal.expr.value, literal, self.problems)
        if not self._unknown_settings(instance, component, missing):
            self._missing(instance.place, path, component, missing)
        inputs = {name: bound for name, port in component.signals.items() if port.direction == "in"
                  and (bound := self._setting_or_value(instance, name, prefix, path)
                       or self._given_whole(instance, name, prefix, path)) is not None}
        inputs |= {name: Bound(self.wires.by_default[f"{path}.{name}"], path + ".", instance.place)
                   for name in component.signals if f"{path}.{name}" in self.wires.by_default}
        self.leaves[path] = Leaf(path, component, instance.place, parameters, inputs, integers)
        if component.composite:
            self._body(component.body, path + ".", component, integers, (*kinds, component.name))

    def _check_size(self, path: str, added: int) -> None:
        """ModelError if the opened diagram has become too large, before the parts of the next component are made."""
        self.size += 1 + added
        if self.size > EXPANDED:
            outermost = self.model.body.instances.get(path.split(".")[0])
            raise ModelError([Problem(
                "diagram-too-large", f"with its blocks opened, this diagram has more than {EXPANDED} parts, ports, "
                f"parameters and variables; this number is reached at '{path}'",
                outermost.place if outermost is not None else None,
                "The parts of blocks inside blocks multiply: use fewer levels, fewer copies (`repeat`) or shorter lists.")])

    def _passes_through(self, instance: Instance, component: Component, path: str) -> bool:
        """Whether all delays of a component are plain zeros."""
        def is_zero(length: Expr) -> bool:
            if not isinstance(length, Name):
                return False
            setting = self.model.settings.get(f"{path}.{length.text}")
            value = instance.settings.get(length.text) if setting is None else setting.value
            return isinstance(value, Value) and constant(value.expr) == 0

        return all(is_zero(delayed.by.tree) for delayed in component.delayed.values())

    def _approximated(self, instance: Instance, component: Component, prefix: str, outer: dict[str, int],
                      kinds: tuple[str, ...], sheets: tuple[DataSheet, ...]) -> None:
        """The component without history in the place of one with delayed variables, with what both have in common; the
        order of the approximation is its default if none is given."""
        approximation = component.approximation
        assert approximation is not None
        path = prefix + instance.name
        replacement = self._component(replace(instance, kind=approximation.kind, kind_place=approximation.place), kinds)
        if replacement is None:
            return
        common = {*replacement.parameters, *replacement.signals}
        settings = {name: value for name, value in instance.settings.items() if name in common}
        order = settings.get(approximation.order)
        if order is not None and isinstance(order, Value) and whole_number(order.expr, outer) == 0:
            del settings[approximation.order]
        if self.model.approximate and order is None:
            self.approximated.append((path, component.name, replacement.name))
        unused = {f"{path}.{name}" for name in component.parameters if name not in common}
        self.unused = {name: setting for name, setting in self.unused.items() if name not in unused}
        self._instance(replace(instance, settings=settings), replacement, prefix, outer, kinds, sheets)

    def _setting_or_value(self, instance: Instance, name: str, prefix: str, path: str) -> Bound | None:
        setting = self._setting(f"{path}.{name}")
        if setting is not None:
            return Bound(setting.value, "", setting.place)
        value = instance.settings.get(name)
        return None if value is None else Bound(value, self.scopes.get(path, prefix), value.place)

    def _given_whole(self, instance: Instance, name: str, prefix: str, path: str) -> Bound | None:
        """The value of an element of a vector of inputs that is given as a whole: `u: =filter.y`, or one number."""
        base, bracket, _ = name.partition("[")
        setting = self.model.settings.get(f"{path}.{base}") if bracket else None
        value = setting.value if setting is not None else instance.settings.get(base) if bracket else None
        if not isinstance(value, Value):
            return None
        self.unused.pop(f"{path}.{base}", None)
        return Bound(shared(value, base, name), "" if setting is not None else self.scopes.get(path, prefix),
                     value.place)

    def _missing(self, place: Place, path: str, component: Component, names: list[str]) -> None:
        for name in names:
            parameter = component.parameters[name]
            if "[" in name:
                base = name.partition("[")[0]
                elements = [element for element in component.parameters if element.partition("[")[0] == base]
                rows, *columns = elements[-1].removeprefix(base).strip("[]").split("][")
                size = f"a matrix of {rows} rows and {columns[0]} columns" if columns else f"a list of {rows} values"
                form = "[[..., ...], ...]" if columns else f"[{', '.join(['...']*min(int(rows), 3))}]"
                declared = self.model.library.component(component.name).parameters[base].count
                fixed = declared is not None and constant(declared) is not None
                note = "" if fixed or set(elements) <= set(names) else \
                    f"\nOr give the other lists of '{path}' the same length: they determine this size, too."
                self.problems.add("parameter-missing", f"'{path}' ({component.name}) needs {size} for {base} "
                                  f"({parameter.doc}); {name} is not given", place,
                                  hint=f"Write `{base}: {form}`, each value with its unit.{note}")
                return
            unit = "" if parameter.integer or parameter.unit.text == "1" else f" {parameter.unit.text}"
            self.problems.add("parameter-missing", f"'{path}' ({component.name}) needs a value for {name}"
                              + (f" ({parameter.doc})" if parameter.doc else ""), place,
                              hint=f"Add `{name}: ...{unit}`." if "$" not in unit else
                              f"Add `{name}: NUMBER UNIT` {_open_unit(parameter.unit.text, path, component)}.")

    def _unknown_settings(self, instance: Instance, component: Component, missing: list[str]) -> bool:
        """True if there are settings that the component does not have; each gives a problem."""
        inputs = [n for n, s in component.signals.items() if s.direction == "in"]
        whole = {name.partition("[")[0] for name in inputs}
        unknown = [name for name in instance.settings if name not in component.parameters and name not in (*inputs, *whole)]
        if not unknown:
            return False
        settable = short([*component.parameters, *inputs])
        groups = (("port", component.ports), ("signal", component.signals), ("variable", component.variables))
        needs = listing(f"{n.removesuffix('[1]')} ({'a list, ' * ('[' in n)}{p.doc}, {p.unit.text})" for n in missing
                        if (p := component.parameters[n]) and ("[" not in n or n.endswith("[1]")))
        remaining = [n for n in settable if n not in missing]
        needed = f"It needs {needs}." * bool(needs) + f" It may have: {listing(remaining)}." * bool(remaining)
        has = needed.strip() if missing else f"It has: {listing(settable)}." if settable else \
            f"{component.name} has no parameters."
        single = {name.partition("[")[0]: name for name in reversed(unknown) if "[" in name}
        single = {base: name for base, name in single.items() if base in component.parameters}
        for base, name in single.items():
            setting = instance.settings[name]
            unit = component.parameters[base].unit.text
            example = setting.text if isinstance(setting, Value) else f"1 {unit}".removesuffix(" 1")
            self.problems.add("parameter-list", f"{base} of {component.name} is one value, not a list", setting.place,
                              hint=f"Write `{base}: {example}`.")
        lists = {name: rows for name in unknown for rows, element in (("[]", "[1]"), ("[[]]", "[1][1]"))
                 if name + element in component.parameters}
        for name, rows in lists.items():
            setting = instance.settings[name]
            example = setting.text if isinstance(setting, Value) else "1"
            kind, head = ("list", f"{name}[") if rows == "[]" else ("matrix", f"{name}[1][")
            number = sum(parameter.startswith(head) for parameter in component.parameters)
            elements = f"[{', '.join([example] * min(number, 2))}]"
            self.problems.add("parameter-list", f"{name} of {component.name} is a {kind}, not one value", setting.place,
                              hint=f"Write `{name}: {rows.replace('[]', elements)}`, with a value for each "
                              f"{'element' if rows == '[]' else 'element of each row'}.")
        for name in (name for name in unknown if name.partition("[")[0] not in single and name not in lists):
            kind_of_setting = next((k for k, group in groups if name in group), "")
            self.problems.add("parameter-unknown", f"{component.name} has no parameter '{name}'"
                              + (f"; that is a {kind_of_setting} of it" if kind_of_setting else ""),
                              instance.settings[name].place,
                              hint=suggest(name, missing or settable) or has)
        return True

    def _integers(self, component: Component, parameters: dict[str, Bound], outer: dict[str, int]) -> dict[str, int]:
        integers: dict[str, int] = {}
        for name, parameter in component.parameters.items():
            bound = parameters.get(name)
            if not parameter.integer or bound is None or isinstance(bound.value, FileInput):
                continue
            plain = not (isinstance(bound.value.expr, Number) and bound.value.expr.unit is not None)
            number = whole_number(bound.value.expr, {**outer, **integers}) if plain else None
            if number is None:
                self.problems.add("not-an-integer", f"{name} must be a whole number, '{bound.value.text}' is none",
                                  bound.place, hint=f"Write for example `{name}: 3`.")
            elif abs(number) > OF_A_KIND:
                self.problems.add("not-an-integer", f"{name} = {number} is too many", bound.place,
                                  hint=f"The most is {OF_A_KIND}.")
            elif (parameter.low is not None and number < parameter.low) or \
                    (parameter.high is not None and number > parameter.high):
                self.problems.add("parameter-bound", f"{name} = {number} is not allowed; it must be "
                                  f"{bounds_text(parameter)}", bound.place, hint=parameter.doc)
            else:
                integers[name] = number
        return integers


def default(parameter: Parameter, path: str) -> Bound | None:
    """The value of an unspecified parameter of the component at `path`: its default or its neutral value."""
    if parameter.default is not None:
        return Bound(parameter.default, path + ".", parameter.default.place)
    if parameter.neutral is not None:
        neutral = Value(Number(parameter.neutral, None, 0), "neutral", parameter.place, si=True)
        return Bound(neutral, "", parameter.place)
    return None


def _open_unit(unit: str, path: str, component: Component) -> str:
    """The unit of a parameter that contains open units (`$Y/$U`), by the signals that determine these."""
    signals = {name: next((f"{path}.{port}" for port, signal in component.signals.items() if signal.unit.text == name), "")
               for name in dict.fromkeys(re.findall(r"\$\w+", unit))}
    if signals.get(unit):
        return f"in the unit of {signals[unit]}"
    clauses = [f"{name} is the unit of {signal}" for name, signal in signals.items() if signal]
    return f"with a unit of the form {unit}" + (f", where {' and '.join(clauses)}" if clauses else "")


# -- parts that are repeated in series (`repeat:`) ----------------------------------------------------------------------
def repeated(body: Body, numbers: Mapping[str, int], opened: Callable[[Instance], Component | None], problems: Problems
             ) -> Body:
    """The body with each part that is repeated as parts `name_1` to `name_n`, port b of one joined to port a of the next;
    `numbers` are the whole numbers that `repeat:` may name, `opened` gives the component that a part is."""
    if not any(i.repeat for i in body.instances.values()):
        return body
    instances: dict[str, Instance] = {}
    wires = dict(body.wires)
    ends: dict[str, str] = {}
    for instance in body.instances.values():
        if instance.repeat is None or not _in_line(instance, instance.repeat, opened(instance), problems):
            instances[instance.name] = instance
            continue
        count, repeat = whole_number(instance.repeat.expr, numbers), instance.repeat
        if count is None or count < 1:
            problems.add("not-an-integer", f"repeat must be a whole number above 0, '{repeat.text}' is none", repeat.place,
                         hint="Write for example `repeat: 10`, or a parameter: `repeat: =n`.")
            count = 1
        elif count > OF_A_KIND:
            problems.add("not-an-integer", f"repeat: {count} is too many", repeat.place, hint=f"The most is {OF_A_KIND}.")
            count = 1
        for k in range(1, count + 1):
            part = replace(instance, name=f"{instance.name}_{k}", repeat=None)
            _check_free(part.name, instance, body.instances, instances, problems)
            instances[part.name] = part
            if k < count:
                link = f"{instance.name}_{k}_{k + 1}"
                joined: tuple[End, ...] = ()
                if link in wires and wires[link].place.file == "with_component":  # joined to it from without
                    joined = wires[link].ends
                else:
                    _check_free(link, instance, body.wires, wires, problems)
                wires[link] = Wire(link, (End(f"{instance.name}_{k}.b", instance.place),
                                          End(f"{instance.name}_{k + 1}.a", instance.place), *joined), instance.place)
        ends[f"{instance.name}.a"] = f"{instance.name}_1.a"
        ends[f"{instance.name}.b"] = f"{instance.name}_{count}.b"
    wires = {n: replace(w, ends=tuple(replace(e, path=ends.get(e.path, e.path)) for e in w.ends))
             for n, w in wires.items()}
    return Body(instances, wires, layout=body.layout)


def _check_free(name: str, instance: Instance, written: Mapping[str, Instance | Wire],
                generated: Mapping[str, Instance | Wire], problems: Problems) -> None:
    """A name that `repeat:` makes is neither written in the file nor made by another `repeat:`."""
    existing = written.get(name) or generated.get(name)
    if existing is not None:
        noun = "component" if isinstance(existing, Instance) else "node"
        problems.add("name-twice", f"`repeat:` makes a {noun} '{name}' of '{instance.name}' (line {instance.place.line}); "
                     f"there is one already (line {existing.place.line})", existing.place,
                     hint=f"Give the {noun} '{name}' or '{instance.name}' another name.")


def _in_line(instance: Instance, repeat: Value, component: Component | None, problems: Problems) -> bool:
    """True if a part has the two ports a and b that a series needs."""
    if component is None:
        return False
    single = [name for name in ("a", "b") if (port := component.ports.get(name)) is not None and port.count is None]
    if len(single) < 2:
        problems.add("repeat-ports", f"'{instance.name}' ({component.name}) cannot be repeated in line: that takes "
                     "two single ports called a and b", repeat.place, hint="Write each of them by itself.")
    return len(single) == 2

