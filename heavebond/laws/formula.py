"""A formula at a place of a diagram: its text, its component file and its value."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from heavebond.core.units import Dimension, Range, Unit, dimension_text, read_unit, times
from heavebond.equations.places import Node, Place
from heavebond.laws.forms import REFERENCE, TRANSITION, Motion, Shape, remembered, values
from heavebond.laws.regression import Part
from heavebond.localise.curves import Variable
from heavebond.numerics.dae import Array

SYMBOLS = {"translational": "F", "rotational": "M"}  # of the law; that of the through variable in other domains
PITCH = 0.1  # relative distance from a pitch within which it is refitted: further away there are other minima
LEAST = 1e3  # factor below their values down to which scales of a dissipating law are allowed
WIDER = 10.0  # factor within which amplitudes and scales are refitted
# A gas or oil with temperature takes its enthalpy along, from upstream: parameters, variable and equations of a law between
# two nodes of it.
_CONDUCTANCE = "  G: {unit: W/K, min: 1e-9 W/K, default: 1e-3 W/K, doc: thermal conductance from a to b at rest}"
_OIL = "rho, alpha, beta, k_T, c_p, T_0"
CARRIED = {
    "pneumatic": ((
        "  c_p: {unit: J/(kg*K), medium: c_p, min: 1 J/(kg*K), default: 1005 J/(kg*K), "
        "doc: specific heat capacity at constant pressure (air)}", _CONDUCTANCE),
        "H = upwind_enthalpy_flow(m, a.T, b.T, c_p, G)"),
    "thermohydraulic": ((
        "  rho: {unit: kg/m**3, min: 1 kg/m**3, medium: rho, doc: density at T_0}",
        "  alpha: {unit: 1/K, min: 0, medium: alpha, doc: volumetric expansion coefficient}",
        "  beta: {unit: Pa, min: 1e5 Pa, medium: beta, doc: bulk modulus at T_0}",
        "  k_T: {unit: 1/K, min: 0, medium: k_T, doc: relative increase of the compressibility with temperature}",
        "  c_p: {unit: J/(kg*K), min: 1 J/(kg*K), medium: c_p, doc: specific heat capacity}",
        "  T_0: {unit: K, min: 1 K, medium: T_0, doc: reference temperature of the oil data}",
        "  m_t: {unit: kg/s, width, min: 1e-9 kg/s, default: 1e-4 kg/s, doc: mass flow at a change of direction}",
        _CONDUCTANCE), f"H = oil_enthalpy_flow(m, a.p, a.T, b.p, b.T, {_OIL}, m_t, G)")}
ENTHALPY = "  H: {unit: W, doc: enthalpy flow from a to b}"
# Names that a parameter cannot have.
RESERVED = frozenset(["a", "b", "pi", "s", "c_p", "G", "H", "T", "rho", "alpha", "beta", "k_T", "T_0", "m_t"])
CONTROLLED = "power: controlled, an empirical law"
EFFORT_TIMES_FLOW = ("translational", "rotational", "hydraulic", "electrical")  # domains whose power is that product
_NAME = re.compile(r"[A-Za-z_]\w*")


@dataclass(frozen=True)
class Number:
    """A parameter of a formula: its name, value (SI), unit and description, and the range in which it is refitted; None if
    it is not fitted."""

    name: str
    value: float
    unit: Unit
    doc: str
    range: Range | None = None

    @property
    def fitted(self) -> bool:
        """Whether it is fitted."""
        return self.range is not None


@dataclass(frozen=True)
class Formula:
    """A sum of parts at a place. `motions` are the ranges of its variables, by their formulas; `fixed` the constants of each
    part that are not fitted."""

    place: Place
    parts: tuple[Part, ...]
    motions: Mapping[str, Motion]
    fixed: tuple[Mapping[str, float], ...]

    @property
    def key(self) -> frozenset[tuple[str, ...]]:
        """The forms and variables of its parts, without values."""
        return frozenset(part.key for part in self.parts)

    @property
    def node(self) -> Node:
        """The node at which the law acts, the first of two."""
        return self.place.nodes[0]

    @property
    def possible(self) -> bool:
        """Whether a component can have the law: a port with one flow, or gas or oil with temperature between two nodes."""
        return len(self.node.domain.through) == 1 or (self.node.domain.name in CARRIED and len(self.place.nodes) == 2)

    @property
    def symbol(self) -> str:
        """The name of the law."""
        return SYMBOLS.get(self.node.domain.name, self.node.through)

    @cached_property
    def variables(self) -> dict[str, tuple[Variable, str]]:
        """The variables by their formulas in the diagram, each with its name in the law."""
        named: dict[str, tuple[Variable, str]] = {}
        for part in self.parts:
            for variable in part.variables:
                if variable.formula not in named:
                    named[variable.formula] = (variable, self._name(variable, [name for _, name in named.values()]))
        return named

    def _name(self, variable: Variable, used: Sequence[str]) -> str:
        domain = self.node.domain
        if variable.kind == "across":
            name = domain.across[0] if self.node.mechanical or len(self.place.nodes) == 1 else f"d{domain.across[0]}"
        elif variable.kind == "position":
            name = domain.position or "x"
        else:
            name = re.sub(r"\W+", "_", variable.formula).strip("_")
        while name in used or name == self.symbol or (name in RESERVED and name != "s"):
            name += "_1"
        return name

    def _is_own(self, variable: Variable) -> bool:
        """Whether the component can compute a variable from its ports."""
        return variable.kind in ("across", "position")

    @property
    def inputs(self) -> dict[str, Variable]:
        """The variables that enter as signals, by their names in the law."""
        return {name: variable for variable, name in self.variables.values() if not self._is_own(variable)}

    @cached_property
    def _named(self) -> tuple[tuple[Number, ...], tuple[dict[str, str], ...]]:
        """The numbers, and for each part the names of its terms' amplitudes (`0`, `1`, ...), shapes, constants and
        variables."""
        numbers: list[Number] = []
        renamed: list[dict[str, str]] = []
        used = {name for _, name in self.variables.values()} | {self.symbol, *RESERVED}

        def fresh(base: str, count: int = 1) -> str:
            """A name that is free: the base, or for one with a count, `F_1`, `F_2`, ..."""
            stem = base.removesuffix("_0")
            names = [base, *(f"{base}_{k}" for k in range(2, 99))] if count == 1 else [f"{stem}_{k}" for k in range(1, 99)]
            name = next(n for n in names if n not in used)
            used.add(name)
            return name

        law = self.node.unit.dimension
        alike = Counter(times(law, self._unit_of(part, term.degree), -1) == law for part in self.parts
                        for term in part.form.terms)
        for index, (part, fixed) in enumerate(zip(self.parts, self.fixed, strict=True)):
            u = self.variables[part.first.formula][1]
            names = {"u": u}
            if part.second is not None:
                names["w"] = self.variables[part.second.formula][1]
            if part.form.memory:
                names["s"] = "s" if index == 0 else f"s_{index + 1}"
            shapes = list[Number]()
            for shape, value in zip(part.form.shapes, part.shapes, strict=True):
                letter = {"u_0": f"{u}_0", "w_0": f"{names.get('w', 'w')}_0", "p": "pitch"}.get(shape.name, shape.name)
                names[shape.name] = fresh(letter)
                unit = _unit({"": (), "time": read_unit("s").dimension, "s": self._unit_of(part, (1, 0, 1)),
                              "u": self._unit_of(part, (1, 0, 0)), "w": self._unit_of(part, (0, 1, 0))}[shape.unit])
                shapes.append(Number(names[shape.name], value, unit, shape.doc, Range(
                    *self._ends(part, shape, value), unit)))
            constants, text = list[Number](), " ".join([part.form.memory, *(term.text for term in part.form.terms)])
            for key, doc in ((REFERENCE, "reference value"), (TRANSITION, "transition around zero")):
                if re.search(rf"\b{key}\b", text):
                    names[key] = fresh(f"{u}_{key[-1]}")
                    constants.append(Number(names[key], fixed[key], _unit(read_unit(part.first.unit).dimension), doc))
            for k, (term, amplitude) in enumerate(zip(part.form.terms, part.amplitudes, strict=True)):
                dimension = times(law, self._unit_of(part, term.degree), -1)
                name = fresh(f"{self.symbol}_0" if dimension == law else "c", alike[dimension == law])
                names[str(k)] = name
                size = WIDER * abs(amplitude)
                unit = _unit(dimension)
                numbers.append(Number(name, amplitude, unit, f"amplitude of {self._with_names(term.text, names)}",
                                      Range(-size, size, unit)))
            numbers += [*shapes, *constants]
            renamed.append(names)
        return tuple(numbers), tuple(renamed)

    def _unit_of(self, part: Part, degree: tuple[int, int, int]) -> Dimension:
        product: Dimension = ()
        units = (part.first.unit, part.second.unit if part.second is not None else "1", "s")
        for text, power in zip(units, degree, strict=True):
            if power:
                product = times(product, read_unit(text).dimension, power)
        return product

    def _ends(self, part: Part, shape: Shape, value: float) -> tuple[float, float]:
        """The range in which a shape parameter is refitted: on its side of the motion, and near a pitch."""
        motion = self.motions[(part.second if shape.unit == "w" and part.second is not None else part.first).formula]
        low, high = sorted(shape.bounds(motion))
        if shape.doc == "pitch":
            return value * (1 - PITCH), value * (1 + PITCH)
        if shape.doc == "threshold":
            return low, high
        if shape.doc == "value at which the law is infinite":
            edge = (motion.size if low > 0 else motion.high) if value > 0 else motion.low
            near, far = edge + (value - edge) / WIDER, edge + (value - edge) * WIDER
            return min(near, far), max(near, far)
        near, far = value / WIDER, value * WIDER
        return max(low, min(near, far)), min(high, max(near, far))

    def with_numbers(self, values: Mapping[str, float]) -> Formula:
        """The formula with other values (SI) of its parameters."""
        parts = []
        for part, names in zip(self.parts, self._named[1], strict=True):
            shapes = tuple(values.get(names[s.name], value) for s, value in zip(part.form.shapes, part.shapes, strict=True))
            amplitudes = tuple(values.get(names[str(k)], value) for k, value in enumerate(part.amplitudes))
            parts.append(replace(part, shapes=shapes, amplitudes=amplitudes))
        return replace(self, parts=tuple(parts))

    def joined(self, addend: Formula) -> Formula:
        """The sum of two formulas at one place; the motions are those of the other."""
        return replace(self, parts=(*self.parts, *addend.parts), fixed=(*self.fixed, *addend.fixed),
                       motions={**self.motions, **addend.motions})

    @property
    def numbers(self) -> tuple[Number, ...]:
        """All parameters, in the order of the text."""
        return self._named[0]

    @property
    def count(self) -> int:
        """How many parameters are fitted."""
        return sum(number.fitted for number in self.numbers)

    def _least(self, values: Mapping[str, float]) -> dict[str, str]:
        """The bounds of the parameters of a dissipating law, as text for the component: amplitudes are not negative, scales
        above zero."""
        numbers = {n.name: n for n in self.numbers}
        least = {name: 0.0 if key.isdigit() else values.get(name, numbers[name].value) / LEAST
                 for names in self._named[1] for key, name in names.items()
                 if key.isdigit() or key in ("u_0", REFERENCE, TRANSITION)}
        return {name: f"min: {_with_unit(low, numbers[name].unit)}, " for name, low in least.items()}

    def _energy(self, numbers: Mapping[str, float]) -> str:
        """The line of the component that declares its energy: a law of the speed (pressure drop, voltage) whose parts all
        dissipate, a law of the position with the integral as stored energy, or one that is not accounted for."""
        values = {n.name: numbers.get(n.name, n.value) for n in self.numbers}
        kinds = {part.first.kind for part in self.parts}
        if self.node.domain.name not in EFFORT_TIMES_FLOW:
            return CONTROLLED
        if kinds == {"across"} and all(part.form.passive for part in self.parts) and all(
                values[name] > 0 for names in self._named[1] for key, name in names.items()
                if key.isdigit() or key in ("u_0", "n")):
            across = self.variables[self.parts[0].first.formula][1]
            return f"dissipates: {self.symbol}*{across}"
        if kinds == {"position"} and all(part.form.energies for part in self.parts) and not any(
                part.first.formula.startswith("∫") for part in self.parts):
            terms = [f"{names[str(k)]}*{_factor(self._with_names(text, names))}"
                     for part, names in zip(self.parts, self._named[1], strict=True)
                     for k, text in enumerate(part.form.energies)]
            return f"stores: {' + '.join(terms)}"
        return CONTROLLED

    @staticmethod
    def _with_names(text: str, names: Mapping[str, str]) -> str:
        return _NAME.sub(lambda match: names.get(match.group(), match.group()), text)

    @property
    def right_side(self) -> str:
        """The law without its name."""
        terms = []
        for part, names in zip(self.parts, self._named[1], strict=True):
            for k, term in enumerate(part.form.terms):
                text = self._with_names(term.text, names)
                terms.append(names[str(k)] if text == "1" else f"{names[str(k)]}/{text[2:]}" if text.startswith("1/")
                             else f"{names[str(k)]}*{_factor(text)}")
        return " + ".join(terms)

    @property
    def memories(self) -> dict[str, str]:
        """The right side of the differential equation of each memory, by its state."""
        return {names["s"]: self._with_names(part.form.memory, names)
                for part, names in zip(self.parts, self._named[1], strict=True) if part.form.memory}

    @property
    def text(self) -> str:
        """The law: `F = F_0*sin(2*pi*x/pitch)`."""
        states = [f"der({s}) = {slope}" for s, slope in self.memories.items()]
        return "; ".join([f"{self.symbol} = {self.right_side}", *states])

    def value(self, motion: Mapping[str, Array], time: Array, numbers: Mapping[str, float] | None = None) -> Array:
        """The law (N,) in SI at values (N,) of its variables by their formulas in the diagram, with these values of its
        numbers or its own; a memory begins at zero."""
        known = {number.name: number.value for number in self.numbers} | dict(numbers or {})
        total = np.zeros(len(time))
        for part, names in zip(self.parts, self._named[1], strict=True):
            part_numbers: dict[str, Array | float] = {key: known[name] for key, name in names.items() if name in known}
            courses = {"u": motion[part.first.formula]}
            if part.second is not None:
                courses["w"] = motion[part.second.formula]
            if part.form.memory:
                constants = {key: np.array([value]) for key, value in part_numbers.items() if not key.isdigit()}
                part_numbers["s"] = remembered(part.form.memory, time, courses, constants)[:, 0]
            for k, term in enumerate(part.form.terms):
                total = total + float(np.asarray(part_numbers[str(k)])) * values(term.text, {**part_numbers, **courses})
        return np.asarray(total)

    # -- the component -----------------------------------------------------------------------------------------------------
    def component(self, name: str, numbers: Mapping[str, float] | None = None, notes: Mapping[str, str] | None = None,
                  restrictions: str = "", effect: bool = True) -> str:
        """The text of a component file with the law, at these values of its numbers (SI); `notes` are added to their
        descriptions. Without an `effect:` a diagnosis does not try it, its energy is not declared, and an amplitude may
        have any sign, as in a search."""
        domain, across, through = self.node.domain, self.node.across, self.node.through
        pair, symbol, noun = len(self.place.nodes) == 2, self.symbol, self.node.domain.members[self.node.through].noun
        ports = [f"  {port}: {domain.name}" for port in ("a", "b")[:1 + pair]]
        ports += [f"  {s}: {{signal: in, unit: {_base_unit(v.unit)}, doc: {_quoted(v.phrase)}}}"
                  for s, v in self.inputs.items()]
        parameters, variables = list[str](), list[str]()
        lines: list[tuple[str, str]] = []
        energy = self._energy(numbers or {}) if effect else CONTROLLED
        least = self._least(numbers or {}) if energy.startswith("dissipates") else {}
        for number in self.numbers:
            value = (numbers or {}).get(number.name, number.value)
            unit = number.unit.text
            doc = number.doc + (f" {(notes or {})[number.name]}" if number.name in (notes or {}) else "")
            written = f"{value:.6g}" + ("" if unit == "1" else f" {unit}")
            parameters.append(f"  {number.name}: {{unit: {unit}, {least.get(number.name, '')}default: {written}, "
                              f"doc: {_quoted(doc)}}}")
        place_variables = {v.kind: (v, s) for v, s in self.variables.values() if self._is_own(v)}
        needed = dict(place_variables)
        if "position" in place_variables and place_variables["position"][0].formula.startswith("∫") \
                and "across" not in place_variables:
            rate = across if across not in (s for _, s in self.variables.values()) else f"{across}_ab"
            needed["across"] = (place_variables["position"][0], rate)
        for kind, (variable, s) in needed.items():
            unit = domain.members[across if kind == "across" else domain.position or ""].unit.text \
                if kind == "across" or not variable.formula.startswith("∫") else _base_unit(variable.unit)
            noun_of_kind = domain.members[across].noun if kind == "across" else "position"
            between = (" of b relative to a" if self.node.mechanical else " drop") if pair else ""
            variables.append(f"  {s}: {{unit: {unit}, doc: {noun_of_kind}{between}}}")
            member = across if kind == "across" else domain.position or ""
            difference = f"a.{member}" if not pair else f"b.{member} - a.{member}" if self.node.mechanical else \
                f"a.{member} - b.{member}"
            if kind == "position" and variable.formula.startswith("∫"):
                lines.append((f"der({s}) = {needed['across'][1]}", noun_of_kind))
            else:
                lines.append((f"{s} = {difference}", noun_of_kind))
        remembering = [part for part in self.parts if part.form.memory]
        units = {s: _unit(self._unit_of(part, part.form.terms[0].degree)).text
                 for s, part in zip(self.memories, remembering, strict=True)}
        for s, slope in self.memories.items():
            variables.append(f"  {s}: {{unit: {units[s]}, doc: memory}}")
            lines.append((f"der({s}) = {slope}", "memory"))
        variables.append(f"  {symbol}: {{unit: {self.node.unit.text}, doc: {noun}}}")
        lines.append((f"{symbol} = {self.right_side}", "law"))
        if pair and self.node.mechanical:
            lines += [(f"b.{through} = {symbol}", f"{noun} at b"), (f"a.{through} = -{symbol}", "reaction at a")]
        else:
            lines.append((f"a.{through} = {symbol}", f"{noun} into a"))
            lines += [(f"b.{through} = -{symbol}", f"{noun} into b")] if pair else []
        if len(domain.through) > 1:
            fluid, enthalpy_flow = CARRIED[domain.name]
            parameters += fluid
            variables.append(ENTHALPY)
            lines += [(enthalpy_flow, "enthalpy from upstream"), ("a.H = H", "in at a"), ("b.H = -H", "out at b")]
        width = max(len(equation) for equation, _ in lines)
        states = [s for v, s in place_variables.values() if v.formula.startswith("∫")] + list(self.memories)
        text = [f"component: {name}", f"summary: {_quoted(f'Law {self.place.words} that was found from records.')}"]
        text += [f"restrictions: {_quoted(restrictions)}"] if restrictions else []
        text += ["source: formula found from records by heavebond", "ports:", *ports, "parameters:", *parameters]
        text += ["variables:", *variables]
        text += ["initial:", *(f"  {s}: 0" for s in states)] if states else []
        text += ["equations: |", *(f"  {equation.ljust(width)}   # {comment}" for equation, comment in lines)]
        text.append(energy)
        if effect and not self.inputs:
            text += ["effect:", "  class: empirical law", f"  attaches: {'across' if pair else 'at'}",
                     f"  amplitude: [{', '.join(n for names in self._named[1] for k, n in names.items() if k.isdigit())}]"]
            shapes = [n for n in self.numbers if n.range is not None and n.name not in
                      {m for names in self._named[1] for k, m in names.items() if k.isdigit()}]
            if shapes:
                text += ["  search_range:", *(f"    {n.name}: {n.range.low:.6g} .. {_with_unit(n.range.high, n.unit)}"
                                              for n in shapes if n.range is not None)]
            text += [f"  description: {_quoted(f'the law {self.text}')}"]
        return "\n".join(text) + "\n"


def _factor(text: str) -> str:
    """A term in brackets where a product needs them."""
    depth = 0
    for k, letter in enumerate(text):
        depth += (letter == "(") - (letter == ")")
        if depth == 0 and letter in "+-" and k and text[k - 1] == " ":
            return f"({text})"
    return text


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "/").replace('"', "'") + '"'


def _unit(dimension: Dimension) -> Unit:
    return read_unit(dimension_text(dimension))


def _base_unit(text: str) -> str:
    return dimension_text(read_unit(text).dimension)


def _with_unit(value: float, unit: Unit) -> str:
    return f"{value:.6g}" + ("" if unit.text == "1" else f" {unit.text}")
