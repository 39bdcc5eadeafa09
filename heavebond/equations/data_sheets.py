"""Data sheets: parts that supply unspecified parameters of other parts (`data: tr40`).

A parameter without a value becomes the formula `=tr40.pitch` if the part `tr40` has a parameter of the same name. It
follows that parameter in runs, sensitivities and fits, so that all parts share one value.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from heavebond.core.errors import Place, Problems, listing, suggest
from heavebond.language.definition import Body, Component, FileInput, Instance, Value
from heavebond.language.model import Model
from heavebond.text.expression import Expr, Name, Number


@dataclass(frozen=True)
class DataSheet:
    """The part at `path` as one from which another takes parameters; `takers` are the paths of those that do."""

    path: str
    instance: Instance
    component: Component
    model: Model
    takers: list[str] = field(default_factory=list, compare=False)

    def has(self, name: str) -> bool:
        """Whether it has a parameter of that name, or an element of a list that is given."""
        parameter = self.component.parameters.get(name.partition("[")[0])
        if parameter is None or (parameter.count is None) == ("[" in name):
            return False
        return parameter.count is None or self.value_of(name) is not None

    def value_of(self, name: str) -> Value | None:
        """The value that was given to its parameter, or that its component has for it."""
        setting = self.model.settings.get(f"{self.path}.{name}")
        value = setting.value if setting is not None else self.instance.settings.get(name, self.component.values.get(name))
        if value is None and name in self.component.parameters:
            value = self.component.parameters[name].default
        return None if isinstance(value, FileInput) else value


def data_sheets(instance: Instance, body: Body, known: Mapping[str, Component], prefix: str, model: Model,
                problems: Problems) -> tuple[DataSheet, ...]:
    """The data sheets of a part; `known` are the components of the parts at its level. A problem is noted for the name of an
    unknown part, and for a sheet without a parameter of the part."""
    sheets: list[DataSheet] = []
    component = known[instance.name]
    for name, place in instance.data:
        sheet = known.get(name)
        if name == instance.name or name not in body.instances:
            names = [part for part in body.instances if part != instance.name]
            hint = (suggest(name, names) if name != instance.name else "") or f"Parts: {listing(names)}."
            if name != instance.name and name in model.library.files:
                part_name = name[0].lower() + name[1:]
                hint = f"Add it to the parts, `{part_name}: {{is: {name}}}`, and write `data: {part_name}`."
            problems.add("data-unknown", f"'{name}' is the part itself" if name == instance.name else
                         f"there is no part '{name}' at the level of '{instance.name}'", place, hint=hint)
        elif sheet is not None:
            shared = [p for p in component.parameters if p in sheet.parameters]
            # what is given at the part itself is taken from none
            path = f"{prefix}{instance.name}"
            needed = [p for p in shared if p not in instance.settings and f"{path}.{p}" not in model.settings]
            earlier = next(((earlier_sheet, p) for earlier_sheet in sheets for p in needed
                            if p in earlier_sheet.component.parameters), None)
            if not shared:
                problems.add("data-nothing", f"'{name}' ({sheet.name}) has no parameter of '{instance.name}' "
                             f"({component.name})", place, hint=f"{sheet.name} has {listing(sheet.parameters) or 'none'}; "
                             f"{component.name} has {listing(component.parameters) or 'none'}.")
            elif earlier is not None:
                earlier_sheet, twice = earlier
                problems.add("data-twice", f"'{earlier_sheet.instance.name}' and '{name}' both have a value of {twice} for "
                             f"'{instance.name}'", place, hint="Leave one of them out, or write the one that counts "
                             f"at '{instance.name}': `{twice}: ={name}.{twice}`.")
            else:
                sheets.append(DataSheet(prefix + name, body.instances[name], sheet, model))
    return tuple(sheets)


def value_by_sheet(sheets: tuple[DataSheet, ...], name: str, path: str, place: Place) -> Value | None:
    """The formula by which the parameter at `path` follows the parameter of a sheet; None if no sheet has it."""
    for sheet in sheets:
        if sheet.has(name):
            sheet.takers.append(path)
            base, _, index = name.partition("[")
            inner: tuple[Expr, ...] = tuple(Number(float(k), None, 0) for k in index[:-1].split("][")) if index else ()
            text = f"{sheet.path}.{name}"
            return Value(Name((*sheet.path.split("."), base, *inner), 0, len(text)), f"= {text}", place, formula=True)
    return None


def whole(sheets: tuple[DataSheet, ...], name: str, path: str) -> Value | None:
    """The value of a whole number of a sheet; it determines the structure of a part, so that it is needed first."""
    for sheet in sheets:
        if sheet.has(name) and (value := sheet.value_of(name)) is not None:
            sheet.takers.append(path)
            return value
    return None
