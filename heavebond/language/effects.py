"""Effects declared by a component file: its `effect:` entry and dormant parameters."""

from __future__ import annotations

import re
from collections.abc import Container
from collections.abc import Mapping as Dictionary
from dataclasses import dataclass, replace

from heavebond.core.errors import ModelError, Place, Problem, Problems, either, listing, suggest
from heavebond.core.units import Range, Unit, UnitProblem, check_unit, is_generic, parse_range
from heavebond.language import reading
from heavebond.language.definition import (
    ATTACHES,
    EXCLUDES,
    FACTOR,
    HELD,
    PARTLY,
    REVERSES,
    VARIES_WITH,
    Component,
    Effect,
    Formula,
    Meaning,
    Parameter,
    Port,
    SearchRange,
    SignalPort,
    Typical,
    Variable,
    rate_of,
)
from heavebond.text.dimensions import number_dimension
from heavebond.text.expression import Expr, ExpressionProblem, Name, names, parse_formula
from heavebond.text.yaml_source import Mapping, Node, Scalar, Sequence

KEYS = ("class", "description", "attaches", "amplitude", "search_range", "also", "replaces", "start", "settled", "begins",
        "meaning", "requires", "acts", "varies_with")


def read_search_range(node: Node | None, unit: Unit, variables: Dictionary[str, Variable], subject: str, problems: Problems
                      ) -> SearchRange | None:
    """Read `1 .. 200 mm/s`, or `seen s`: the range of the component's variable s in the records; or `middle s`, `half s`,
    `peak s`: a fixed value computed from that motion."""
    content = reading.text(node, subject, problems)
    if node is None or not content:
        return None
    first, _, name = content.partition(" ")
    if first in ("seen", *HELD):
        if name not in variables:
            problems.add("effect-seen-unknown", f"{subject} is sought over the motion of '{name}', which is not a variable "
                         "of this component", node.place,
                         hint=suggest(name, variables) or f"Variables: {listing(variables)}.")
            return None
        if variables[name].unit.dimension != unit.dimension:
            problems.add("unit-wrong", f"{subject} is in {unit.text}, '{name}' in {variables[name].unit.text}", node.place,
                         hint=f"Name a variable in {unit.text}, or give a range: `{subject}: low .. high {unit.text}`.")
            return None
        return SearchRange(None, name, node.place, first if first in HELD else "")
    try:
        range_read = parse_range(content)
        _check_ends(range_read, unit, content)
    except UnitProblem as problem:
        problems.add(problem.code, f"{subject}: {problem.message}", node.place,
                     hint=problem.hint or "Write `1 .. 200 mm/s`, or `seen s` with a variable s of the component.")
        return None
    return SearchRange(range_read, "", node.place)


WORDS = ("part", "place")  # fields of `meaning:` besides the ports: the name of the part, and the place in words


def read_meaning(node: Node | None, problems: Problems) -> Meaning | None:
    """A sentence with fields in braces: `Dry friction of {F_c} {place}.`"""
    text = reading.text(node, "meaning", problems)
    if node is None or not text:
        return None
    pieces = re.split(r"\{([^{}]*)\}", text)
    if any(set(piece) & {"{", "}"} for piece in pieces):
        problems.add("meaning-braces", "a brace of the meaning has no partner", node.place,
                     hint="Write a field as `{F_c}`; braces cannot be nested.")
        return None
    fields: list[str | Expr] = []
    for piece in pieces[1::2]:
        expr = reading.parsed(parse_formula, piece, node.place, problems)
        if expr is None:
            return None
        fields.append(piece if isinstance(expr, Name) and len(expr.parts) == 1 and isinstance(expr.parts[0], str) else expr)
    return Meaning(tuple(pieces[::2]), tuple(fields), node.place)


def read_typical(node: Node | None, unit: Unit, subject: str, problems: Problems) -> Typical | None:
    """`{range: 2 .. 25 W/(m**2*K), source: VDI Heat Atlas}`."""
    entry = reading.mapping(node, "typical", problems, "Write `typical: {range: 2 .. 25 mm, source: VDI Heat Atlas}`.")
    if entry is None:
        return None
    reading.known_keys(entry, ("range", "source"), f"typical values of {subject}", problems, ("source",))
    range_read: Range | None = None
    content = reading.text(entry.items.get("range"), "range", problems)
    try:
        if content:
            range_read = parse_range(content)
            _check_ends(range_read, unit, content)
    except UnitProblem as problem:
        problems.add(problem.code, f"{subject}: {problem.message}", entry.items["range"].place, hint=problem.hint)
        range_read = None
    return Typical(range_read, reading.text(entry.items.get("source"), "source", problems))


def _check_ends(limits: Range, unit: Unit, text: str) -> None:
    if not is_generic(unit.dimension):
        check_unit(limits.unit, unit, limits.low, text)


@dataclass(frozen=True)
class EffectReader:
    """Reader of a component's effects, with the parts of the component that they refer to."""

    ports: Dictionary[str, Port]
    signals: Dictionary[str, SignalPort]
    parameters: Dictionary[str, Parameter]
    variables: Dictionary[str, Variable]
    problems: Problems

    def effects(self, node: Node | None) -> tuple[Effect, ...]:
        """Read the `effect:` entry, or a list of them; problems are noted with their places."""
        entries = node.items if isinstance(node, Sequence) else [node]
        return tuple(effect for entry in entries if (effect := self._effect(entry)) is not None)

    def _effect(self, node: Node | None) -> Effect | None:
        entry = reading.mapping(node, "effect", self.problems)
        if entry is None:
            return None
        reading.known_keys(entry, KEYS, "effect", self.problems, ("class", "description"))
        # further ports, which do not count for the way of attaching
        also: dict[str, str] = {}
        for key, item in self._entries(entry.items.get("also"), "also"):
            if key.text not in self.ports:
                self.problems.add("effect-also", f"'{key.text}' is not a power port of this component", key.place,
                                  hint=suggest(key.text, self.ports) or f"Ports: {listing(self.ports)}.")
            elif (domain := reading.text(item, key.text, self.problems)) != self.ports[key.text].domain:
                self.problems.add("effect-also", f"port '{key.text}' is {self.ports[key.text].domain}", item.place,
                                  hint=f"Write `also: {{{key.text}: {self.ports[key.text].domain}}}`.")
            else:
                also[key.text] = domain
        # the ways of attaching that the ports of the component suit
        attachments = []
        node = entry.items.get("attaches")
        # items of a list are single words; a plain text may contain a space (`in series`)
        entries = [node] if isinstance(node, Scalar) else reading.words(node, "attaches", self.problems)
        for word in entries:
            if word.text not in ATTACHES:
                self.problems.add("effect-attaches", f"an effect cannot attach '{word.text}'", word.place,
                                  hint=suggest(word.text, ATTACHES) or f"Write {either(ATTACHES, 'or')}.")
            elif why := self._unsuited(word.text, also):
                self.problems.add("effect-ports", f"an effect that attaches '{word.text}' needs {why}", word.place,
                                  hint=f"This one has {self._has()}.")
            else:
                attachments.append(word.text)
        attaches = tuple(attachments)
        acts = entry.items.get("acts")
        partly = isinstance(acts, Scalar) and acts.text.startswith(PARTLY)
        effect = Effect(
            reading.text(entry.items.get("class"), "class", self.problems),
            reading.text(entry.items.get("description"), "description", self.problems), attaches,
            self._amplitude(entry), self._shapes(entry.items.get("search_range"), "search_range"), also,
            tuple(word.text for word in reading.words(entry.items.get("replaces"), "replaces", self.problems)),
            self._start(entry.items.get("start")), self._settled(entry.items.get("settled")), entry.place,
            read_meaning(entry.items.get("meaning"), self.problems),
            self._requires(entry.items.get("requires")), self._acts(acts),
            self._varies_with(entry.items.get("varies_with"), attaches),
            self._shapes(entry.items.get("begins"), "begins"), partly)
        self._check(entry)
        self._check_meaning(effect.meaning, () if effect.replaces else tuple(self.ports))
        return effect

    def _unsuited(self, word: str, also: Dictionary[str, str]) -> str:
        """The ports that are missing for a way of attaching; empty if they suit. Ports under `also:` do not count."""
        power = [p for p in self.ports.values() if p.name not in also]
        inputs = [s for s in self.signals.values() if s.direction == "in"]
        outputs = [s for s in self.signals.values() if s.direction == "out"]
        if word in ("across", "in series"):
            fits = len(power) == 2 and power[0].domain == power[1].domain
            return "" if fits else "two power ports of one domain, further ones under `also:`"
        if word == "at":
            return "" if len(power) == 1 else "one power port, further ones under `also:`"
        if word == "parameter":
            fits = not power and len(inputs) == 1 and not outputs and FACTOR in self.variables
            return "" if fits else f"one signal in, no other port and a variable '{FACTOR}'"
        fits = not power and len(inputs) == len(outputs) == 1 and inputs[0].unit.dimension == outputs[0].unit.dimension
        return "" if fits else "one signal in and one signal out of the same unit, and no power port"

    def _varies_with(self, node: Node | None, attaches: tuple[str, ...]) -> tuple[str, ...]:
        varied = []
        for word in reading.words(node, "varies_with", self.problems):
            if word.text in VARIES_WITH and "parameter" in attaches:
                varied.append(word.text)
            else:
                self.problems.add("effect-varies", f"an effect cannot vary with '{word.text}'" if "parameter" in attaches
                                  else "only an effect that attaches 'parameter' varies with something", word.place,
                                  hint=f"Write `attaches: parameter` and {either(VARIES_WITH, 'or')}.")
        return tuple(varied)

    def _has(self) -> str:
        """The ports in words: `a (translational), b (translational), u (signal in)`."""
        ports = [f"{p.name} ({p.domain})" for p in self.ports.values()]
        signals = [f"{s.name} (signal {s.direction}, {s.unit.text})" for s in self.signals.values()]
        return listing([*ports, *signals]) or "no ports"

    def _entries(self, node: Node | None, subject: str) -> list[tuple[Scalar, Node]]:
        entries = reading.mapping(node, subject, self.problems)
        return [(entries.keys[name], item) for name, item in entries.items.items()] if entries else []

    def _parameter(self, name: str, place: Place) -> Parameter | None:
        parameter = self.parameters.get(name)
        if parameter is None:
            self.problems.add("effect-parameter", f"'{name}' is not a parameter of this component", place,
                              hint=suggest(name, self.parameters) or f"Parameters: {listing(self.parameters)}.")
        return parameter

    def _amplitude(self, entry: Mapping) -> dict[str, SearchRange | None]:
        node, starts = entry.items.get("amplitude"), _named(entry.items.get("start"))
        if isinstance(node, Mapping):
            return dict(self._shapes(node, "amplitude"))
        amplitudes: dict[str, SearchRange | None] = {}
        for word in reading.words(node, "amplitude", self.problems):
            parameter = self._parameter(word.text, word.place)
            if parameter is not None and word.text not in starts and ((parameter.low or 0) > 0 or (parameter.high or 0) < 0):
                start = ("replaces" in entry.items) * (
                    f" Or give its value without the effect: `start: {{{word.text}: old.{word.text}}}`.")
                self.problems.add("effect-amplitude", f"'{word.text}' cannot be 0, the value of an absent effect",
                                  word.place, hint=f"Give its range: `amplitude: {{{word.text}: low .. high}}`.{start}")
            elif parameter is not None:
                amplitudes[word.text] = None
        return amplitudes

    def _shapes(self, node: Node | None, subject: str) -> dict[str, SearchRange]:
        shapes = {}
        for key, item in self._entries(node, subject):
            parameter = self._parameter(key.text, key.place)
            if parameter is not None:
                search_range = read_search_range(item, parameter.unit, self.variables, key.text, self.problems)
                if search_range is not None:
                    shapes[key.text] = search_range
        return shapes

    def _start(self, node: Node | None) -> dict[str, Formula]:
        start_formulas = {}
        for key, item in self._entries(node, "start"):
            formula = reading.formula_of(item, key.text, self.problems)
            if self._parameter(key.text, key.place) is not None and formula is not None:
                start_formulas[key.text] = formula
        return start_formulas

    def _settled(self, node: Node | None) -> tuple[str, ...]:
        settled_names = []
        for word in reading.words(node, "settled", self.problems):
            name = rate_of(word.text) or word.text
            if name in self.variables:
                settled_names.append(word.text)
            else:
                self.problems.add("effect-settled", f"'{name}' is not a variable of this component", word.place,
                                  hint=suggest(name, self.variables) or f"Variables: {listing(self.variables)}.")
        return tuple(settled_names)

    def _check_meaning(self, meaning: Meaning | None, ports: tuple[str, ...]) -> None:
        """Check that each field is a word, one of the `ports`, or a formula of parameters with a unit."""
        if meaning is None:
            return
        for field in meaning.fields:
            known = [*self.parameters, *WORDS, *ports]
            unknown = [name for name in ([field] if isinstance(field, str) else [n.text for n in names(field)])
                       if name not in (known if isinstance(field, str) else self.parameters)]
            for name in unknown:
                self.problems.add("meaning-unknown", f"'{name}' in the meaning is not a parameter of this component",
                                  meaning.place, hint=suggest(name, known) or f"Fields: {listing(known)}.")
            if unknown or isinstance(field, str):
                continue
            try:
                number_dimension(field, lambda name: self.parameters[name.text].unit.dimension)
            except ExpressionProblem as problem:
                self.problems.add(problem.code, problem.message, meaning.place, hint=problem.hint)

    def _requires(self, node: Node | None) -> dict[str, tuple[str, ...]]:
        """Kinds of components that are, or with `no` are not, on the node of a port, or `reverses` of a variable."""
        requirements = {}
        for key, item in self._entries(node, "requires"):
            kinds = tuple(word.text for word in reading.words(item, key.text, self.problems))
            if key.text not in {**self.ports, **self.variables}:
                self.problems.add("effect-requires", f"'{key.text}' is not a port or variable of this component", key.place,
                                  hint=suggest(key.text, {**self.ports, **self.variables}) or self._has())
            elif key.text in self.variables and kinds != (REVERSES,):
                self.problems.add("effect-requires", f"for a variable, `requires:` may only be `{REVERSES}`", item.place,
                                  hint=f"Write `requires: {{{key.text}: {REVERSES}}}`.")
            else:
                requirements[key.text] = kinds
        return requirements

    def _acts(self, node: Node | None) -> Formula | None:
        """A formula of the component's own parameters, variables and signals; without the word PARTLY before it."""
        if isinstance(node, Scalar) and node.text.startswith(PARTLY):
            text = node.text.removeprefix(PARTLY)
            node = replace(node, text=text, place=node.place.moved(len(PARTLY), len(text)))
        formula = reading.formula_of(node, "acts", self.problems) if node is not None else None
        known = {**self.parameters, **self.variables, **self.signals}
        for name in names(formula.tree) if formula is not None else ():
            if name.text not in known and name.text.partition(".")[0] not in self.ports:
                self.problems.add("effect-acts", f"'{name.text}' is not a variable of this component",
                                  formula.place if formula is not None else None,
                                  hint=suggest(name.text, known) or f"Variables: {listing(known)}.")
        return formula

    def _check(self, entry: Mapping) -> None:
        """Report missing entries; wrong entries have been reported already."""
        problems, place = self.problems, entry.place
        if not {"attaches", "replaces"} & entry.items.keys():
            problems.add("effect-nowhere", "the effect has no place: `attaches:` or `replaces:` is missing", place,
                         hint=f"Write `attaches:` with {either(ATTACHES, 'or')}, or `replaces: Component`.")
        if "attaches" in entry.items and "amplitude" not in entry.items:
            problems.add("effect-amplitude", "`amplitude:` is missing in the effect", place,
                         hint="Write `amplitude: [...]` with the parameters that are 0 if the effect is absent.")
        listed_names = {word for key in ("amplitude", "search_range", "start") for word in _named(entry.items.get(key))}
        for parameter in self.parameters.values():
            if parameter.name not in listed_names and parameter.default is None and parameter.neutral is None \
                    and not parameter.medium:
                problems.add("effect-parameter", f"the effect does not list '{parameter.name}', which has no default",
                             place, hint="List it under `search_range:` with a range, or give it a default.")

    def dormant(self) -> None:
        """Report inconsistent declarations of dormant effects at parameters."""
        for parameter in self.parameters.values():
            needed = (("class", parameter.kind), ("wakes_with", parameter.wakes_with), ("meaning", parameter.meaning))
            self._check_meaning(parameter.meaning, ())
            for key in [key for key, is_declared in needed if is_declared and parameter.neutral is None]:
                self.problems.add("effect-neutral", f"'{parameter.name}' has `{key}:` but no value at which the effect is "
                                  "absent", parameter.place, hint="Add `neutral: 0`, or the value at which it is absent.")
            for name in parameter.wakes_with:
                if self._parameter(name, parameter.place) is not None and self.parameters[name].sought is None:
                    self.problems.add("effect-parameter", f"'{name}' wakes with '{parameter.name}', but has no "
                                                          "`search_range:`", self.parameters[name].place,
                                      hint=f"Add `search_range: low .. high` to '{name}'.")


def _named(node: Node | None) -> list[str]:
    """The names in a list or before the colons of a mapping."""
    if isinstance(node, Mapping):
        return list(node.items)
    return [word.text for word in reading.words(node, "amplitude", Problems())]


def check_required(component: Component, effect: Effect, kinds: Container[str]) -> None:
    """Raise ModelError if an effect requires a kind of component that does not exist."""
    for port, required in effect.requires.items():
        for kind in required if port in component.ports else ():
            if kind.removeprefix(EXCLUDES) not in kinds:
                raise ModelError([Problem("effect-requires", f"there is no component '{kind.removeprefix(EXCLUDES)}'",
                                          effect.place)])


def check_replacing(component: Component, effect: Effect, old: Component) -> None:
    """Raise ModelError if a component cannot replace the one that its effect names: other ports, or formulas under
    `start:` with names other than the parameters of the old one."""
    problems = Problems()
    if {*component.ports, *component.signals} != {*old.ports, *old.signals}:
        problems.add("effect-ports", f"{component.name} cannot take the place of {old.name}: their ports have other names",
                     effect.place, hint=f"{old.name} has {listing([*old.ports, *old.signals])}.")
    known = [f"old.{name}" for name in old.parameters]
    for formula in effect.start.values():
        for name in names(formula.tree):
            if name.text not in (*known, "pi"):
                problems.add("effect-start", f"'{name.text}' is not a parameter of {old.name}", formula.place,
                             hint=suggest(name.text, known) or f"Write a formula of {listing(known)}.")
    problems.raise_as(ModelError)
