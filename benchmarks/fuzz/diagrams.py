"""Random small diagrams: a seed gives the same text on every machine.

Three manners. *Careful* diagrams have what decides each node, at most one source there, and modest starts, so that most of
them run. What *careless* ones mean is left to chance: every port on a node of its domain, units right, one output for each
signal, and many are singular, contradict themselves or stand still. *Sloppy* ones have slips in form besides. Sizes are
usual ones, in some diagrams zeros or powers of ten away from these.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from random import Random

from heavebond.language.definition import Component, Parameter
from heavebond.language.library import library
from heavebond.text.expression import Binary, Expr, Name, Number

DOMAINS = ("translational", "rotational", "hydraulic", "pneumatic", "thermal", "electrical", "bond")
# components of a folder of their own: a block of parts, things that switch
OWN = Path(__file__).parent / "own"
# usual sizes by base unit, as text; what is not here is 1
SIZES = {
    "N": 1e3, "m": 0.1, "m/s": 0.3, "N/m": 1e4, "N*s/m": 300.0, "kg": 20.0, "Pa": 2e6, "m**3/s": 2e-4, "m**3": 2e-3,
    "m**2": 2e-3, "m**3/(s*Pa)": 1e-11, "N*m": 50.0, "kg*m**2": 0.3, "N*m/rad": 500.0, "N*m*s/rad": 3.0, "rad": 0.3,
    "rad/s": 3.0, "s": 0.2, "Hz": 4.0, "K": 300.0, "Pa*s/m**3": 1e9, "Pa*s**2/m**6": 1e13, "kg/m**4": 1e7,
    "m**3/Pa": 1e-12, "kg/(s*Pa)": 1e-8, "Pa*s/kg": 1e7, "W/K": 1.0, "J/(kg*K)": 800.0, "kg/m**3": 900.0, "m/s**2": 9.81,
    "N/m**3": 1e6, "N*s**2/m**2": 100.0, "1/m": 3.0, "s/m": 0.5, "1/Pa": 1e-6, "1": 0.7, "kg/s": 0.01, "W": 100.0,
    "m**2/s": 3e-5, "m**3/rad": 5e-6, "V": 20.0, "A": 2.0, "ohm": 3.0, "H": 0.02, "F": 1e-3, "N*m/A": 0.3, "m**2/Pa": 1e-14,
    "W/(m**2*K)": 20.0, "K/W": 0.5, "Pa*s": 0.03, "W/(m*K)": 0.5, "W/(m**2*K**4)": 5.7e-8,
    "m/Pa": 1e-9, "N*m*s**2/rad**2": 0.1,
    # of what fits every domain
    "Pa/(m**3/s)": 1e9, "Pa*s/(m**3/s)": 1e7, "N/(m/s)": 300.0, "N*s/(m/s)": 20.0, "m/N": 1e-4,
    "N*m/(rad/s)": 3.0, "N*m*s/(rad/s)": 0.3, "rad/(N*m)": 2e-3, "V/A": 3.0, "V*s/A": 0.02, "A*s/V": 1e-3,
}
ANY_UNIT = ("m", "N", "Pa", "m**3/s", "1", "m/s", "rad", "N*m", "K")
# effort and flow where their product is the power
BONDS = {"translational": ("N", "m/s"), "rotational": ("N*m", "rad/s"), "hydraulic": ("Pa", "m**3/s"),
         "electrical": ("V", "A"), "bond": ("W", "1")}
# the members that a formula may name
MEMBERS = {"translational": (("v", "m/s"), ("x", "m")), "rotational": (("w", "rad/s"), ("phi", "rad")),
           "hydraulic": (("p", "Pa"),), "pneumatic": (("p", "Pa"), ("T", "K")), "thermal": (("T", "K"),),
           "electrical": (("v", "V"),), "bond": (("e", "W"),)}
# what decides a node; the first is the commonest
HOLDS = {"translational": ("Mass", "Fixed"), "rotational": ("Inertia", "FixedShaft"),
         "hydraulic": ("Volume", "Tank", "PressureSource"), "pneumatic": ("ReceiverWithHeat", "Atmosphere", "Receiver"),
         "thermal": ("HeatCapacity", "Ambient"), "electrical": ("Capacitor", "C", "ElectricalGround"),
         "bond": ("Junction0", "C", "Se")}
# what gives a node its across variable, so that there can be one alone
GIVES = re.compile(r"Fixed|Tank|PressureSource|Atmosphere|PneumaticSource|Ground|(Position|Velocity|Acceleration|Angle|Speed"
                   r"|Temperature|Voltage|Drooping)Source|Ambient|Free|Se$|Battery")
# taken more often than by chance: what is in most machines, and what switches
COMMON = ("Fixed", "Mass", "Spring", "Damper", "Tank", "Volume", "PressureSource", "FlowSource", "Orifice", "Inertia",
          "FixedShaft", "TorsionSpring", "Atmosphere", "Receiver", "PneumaticOrifice", "LineInertance", "LaminarLeakage",
          "ForceSource", "DryFriction", "RigidStop", "RotationalDryFriction", "RotationalRigidStop", "Fluid", "HeatCapacity",
          "ThermalResistance", "Resistor", "Capacitor", "Inductor", "Junction0", "Junction1", "C", "I", "R")
SWITCHING = ("SampleHold", "DelayedSampleHold", "Step", "Relay", "SquareWave", "Comparator", "TwoPoint")
EXTREMES = (1e-9, 1e-6, 1e-3, 1e3, 1e6, 1e9)
WRONG = ("3 furlong", "abc", "=m/", "-1", "1e400 m", "1,5 m", "2kN", "[1, 2]", "{a: 1}", '"="', "=time", "nan", "m", '""')


@dataclass(frozen=True)
class Part:
    """A component of a diagram with its settings, text as it stands behind the colon."""

    name: str
    kind: str
    settings: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Diagram:
    """A diagram as data: parts, nodes (name to ports), initial entries, the end of the run in s."""

    seed: int
    parts: tuple[Part, ...]
    nodes: dict[str, tuple[str, ...]]
    initial: dict[str, str]
    until: float

    def text(self) -> str:
        """The YAML file."""
        lines = [f"model: random_{self.seed}", "components:"]
        for part in self.parts:
            settings = "".join(f", {key}: {value}" for key, value in part.settings.items())
            lines.append(f"  {part.name}: {{is: {part.kind}{settings}}}")
        lines.append("nodes:")
        lines += [f"  {name}: [{', '.join(ports)}]" for name, ports in self.nodes.items()]
        if self.initial:
            lines += ["initial:", *(f"  {key}: {value}" for key, value in self.initial.items())]
        return "\n".join([*lines, f"simulate: {{until: {self.until:g} s, every: {self.until / 50:g} s}}", ""])

    def shortened(self, share: float) -> Diagram:
        """The diagram run for a share of its time."""
        return replace(self, until=share * self.until)

    def without_part(self, name: str) -> Diagram:
        """The diagram with one part fewer; nodes that are left without ports go too."""
        nodes = {node: tuple(port for port in ports if not port.startswith(f"{name}."))
                 for node, ports in self.nodes.items()}
        return replace(self, parts=tuple(p for p in self.parts if p.name != name),
                       nodes={node: ports for node, ports in nodes.items() if ports})


@cache
def _components() -> dict[str, Component]:
    found = library([OWN])
    return {name: found.component(name) for name in found.names()}


def diagram(seed: int) -> Diagram:
    """The diagram of a seed."""
    return _Maker(seed).made()


class _Maker:
    def __init__(self, seed: int):
        self.seed, self.random = seed, Random(seed)
        manner = self.random.random()
        self.careful, self.sloppy = manner < 0.6, manner > 0.88
        self.zeros = 0.0 if self.careful else self.random.choice((0.0, 0.1, 0.3))
        self.extremes = self.random.choice((0.0, 0.0, 0.0, 0.05, 0.2))
        self.parts: list[Part] = []
        self.nodes: dict[str, tuple[str, ...]] = {}
        self.domain_of: dict[str, str] = {}
        # the unit of $U of each part, and the domain of $D
        self.unit: dict[str, str] = {}
        self.kind: dict[str, str] = {}

    def made(self) -> Diagram:
        for kind in self._kinds():
            self._add(kind)
        for domain in DOMAINS:
            self._wire(domain)
        if self.careful or self.random.random() < 0.4:
            self._settle()
        self._signals()
        initial = self._initial()
        if self.sloppy:
            self._slip()
        return Diagram(self.seed, tuple(self.parts), self.nodes, initial, 10 ** self.random.uniform(-1.5, 0.5))

    def _add(self, kind: str, domain: str = "") -> str:
        name, component = f"c{len(self.parts)}", _components()[kind]
        self.unit[name] = self.random.choice(ANY_UNIT)
        self.kind[name] = domain or self.random.choice([d for d in self.domains if d in BONDS] or ["bond"])
        self.parts.append(Part(name, kind, self._parameters(name, component)))
        alone = all(port.count is None for port in component.ports.values()) and not component.signals
        if {"a", "b"} == {*component.ports} and alone and self.random.random() < 0.05:
            self.parts[-1].settings["repeat"] = str(self.random.randint(2, 3))
        return name

    def _kinds(self) -> list[str]:
        """Parts of one domain or some, what stands for the surroundings among them more often than by chance."""
        of = {name: {p.domain for p in c.ports.values()} for name, c in _components().items()}
        # what goes from one domain to another is not met often by chance
        between = [name for name, domains in of.items() if len(domains) > 1]
        first = [self.random.choice(between)] if self.random.random() < 0.25 else []
        self.domains = sorted(of[first[0]]) if first else self.random.sample(DOMAINS, self.random.choice((1, 1, 1, 2, 3)))
        fitting = [name for name, domains in of.items() if domains and domains <= {*self.domains, "$D"}
                   and (domains != {"$D"} or {*self.domains} & {*BONDS})]
        signals = [name for name, domains in of.items() if not domains]
        common = [name for name in COMMON if name in fitting]
        number = self.random.randint(1, 7)
        chosen = first + [self.random.choice(common if common and self.random.random() < 0.5 else fitting)
                          for _ in range(number)]
        if self.random.random() < 0.35:
            chosen += [self.random.choice(SWITCHING if self.random.random() < 0.4 else signals)
                       for _ in range(self.random.randint(1, 3))]
        return chosen

    # -- values ----------------------------------------------------------------------------------------------------
    def _parameters(self, name: str, component: Component) -> dict[str, str]:
        found: dict[str, str] = {}
        for parameter in sorted(component.parameters.values(), key=lambda p: not p.integer):
            optional = parameter.default is not None or parameter.neutral is not None
            if optional and self.random.random() < 0.8:
                continue
            if parameter.medium and self.random.random() < 0.5:
                continue
            found[parameter.name] = self._parameter(name, parameter, found)
        if self.careful:
            _put_in_order(component, found)
        return found

    def _parameter(self, name: str, parameter: Parameter, given: dict[str, str]) -> str:
        if parameter.integer:
            return str(self.random.randint(int(parameter.low or 1), 5))
        unit = self._unit(name, parameter.unit.text)
        if parameter.count is None:
            return _quantity(self._within(parameter, unit), unit)
        values = [self._within(parameter, unit) for _ in range(_number(parameter.count, given))]
        if self.random.random() < 0.9:  # points of a curve stand in order, and no two at one place
            values = [value + 0.01 * SIZES.get(unit, 1.0) * k for k, value in enumerate(sorted(values))]
        return f"[{', '.join(_quantity(value, unit) for value in values)}]"

    def _within(self, parameter: Parameter, unit: str) -> float:
        value = self._number(unit, signed=parameter.low is None or parameter.low < 0)
        if parameter.low is not None:
            value = max(value, parameter.low)
        return value if parameter.high is None else min(value, parameter.high)

    def _number(self, unit: str, *, signed: bool) -> float:
        if self.random.random() < self.zeros:
            return 0.0
        # round numbers, so that two parts have the same value at times
        size = SIZES.get(unit, 1.0) * self.random.choice((0.1, 0.5, 1, 1, 1, 2, 10))
        if self.random.random() < self.extremes:
            # of a time that something takes again and again, a millionth of the run is short enough
            size *= self.random.choice(EXTREMES[2:] if unit == "s" else EXTREMES)
        return -size if signed and self.random.random() < 0.3 else size

    def _unit(self, name: str, declared: str) -> str:
        if "$D" in declared:
            effort, flow = BONDS[self.kind[name]]
            above, _, below = declared.partition("/")
            each = {"$D.effort": effort, "$D.flow": flow, "$D.effort*s": f"{effort}*s", "$D.flow*s": flow.removesuffix("/s")
                    if flow.endswith("/s") else "s" if flow == "1" else f"{flow}*s", "": "1"}
            return _over(each[above], each[below])
        own = self.unit[name]
        fixed = {"$Y/$U": "1", "$U/$W": "1", "$Y/($U*s)": "1/s", "$Y*s/$U": "s"}
        if declared in fixed or "$" not in declared:
            return fixed.get(declared, declared)
        text = re.sub(r"\$[UYW]", own, declared)
        return text if own != "1" else text.replace("1*1", "1")

    # -- wires -----------------------------------------------------------------------------------------------------
    def _ports(self, part: Part) -> list[tuple[str, str]]:
        """The names of a part's ports with their domains."""
        found = []
        for port in _components()[part.kind].ports.values():
            domain = self.kind[part.name] if port.domain == "$D" else port.domain
            if port.count is None:
                found.append((f"{part.name}.{port.name}", domain))
            else:
                defaults = {p.name: str(p.default.text) for p in _components()[part.kind].parameters.values() if p.default}
                number = _number(port.count, {**defaults, **part.settings})
                found += [(f'"{part.name}.{port.name}[{k + 1}]"', domain) for k in range(number)]
        return found

    def _wire(self, domain: str) -> None:
        ports = [name for part in self.parts for name, of in self._ports(part) if of == domain]
        gives = {name for part in self.parts for name, _ in self._ports(part) if GIVES.match(part.kind)}
        self.random.shuffle(ports)
        number = max(1, round(len(ports) / self.random.choice((1.5, 2, 2.5, 3))))
        groups: list[list[str]] = [[] for _ in range(number)]
        for k, port in enumerate(ports):
            group = groups[k if k < number else self.random.randrange(number)]
            if self.careful and port in gives and gives & {*group}:
                groups.append([port])
            else:
                group.append(port)
        for k, group in enumerate(g for g in groups if g):
            self.nodes[f"{domain[:2]}{k}"] = tuple(group)
            self.domain_of[f"{domain[:2]}{k}"] = domain

    def _settle(self) -> None:
        """A store or a source on every node that has none, so that most of the diagrams run."""
        kinds = {name: part.kind for part in self.parts for name, _ in self._ports(part)}
        for node, ports in list(self.nodes.items()):
            choice = HOLDS[self.domain_of[node]]
            # what fits every domain does not tell which one the node has
            open_ = all(port.domain == "$D" for name in ports for port in _components()[kinds[name]].ports.values())
            if open_ or not any(kinds[port] in choice or GIVES.match(kinds[port]) for port in ports):
                self._add(choice[0] if open_ else self.random.choice((*choice[:1] * 3, *choice)), self.domain_of[node])
                first, *others = (port for port, _ in self._ports(self.parts[-1]))
                self.nodes[node] = (*ports, first)
                if others:
                    self._aside(others, self.domain_of[node])

    def _aside(self, ports: list[str], domain: str) -> None:
        """The other ports of a store join the ground of their domain, or make a node of their own."""
        ground = f"{domain[:2]}_0"
        if ground not in self.nodes and domain == "electrical":
            self.nodes[ground] = (f"{self._add('ElectricalGround', domain)}.a",)
        self.nodes[ground] = (*self.nodes.get(ground, ()), *ports)
        self.domain_of[ground] = domain

    def _signals(self) -> None:
        outputs = [(part, port) for part in self.parts
                   for port in _components()[part.kind].signals.values() if port.direction == "out"]
        inputs = [(part, port) for part in self.parts
                  for port in _components()[part.kind].signals.values() if port.direction == "in"]
        joined: dict[str, list[str]] = {f"{part.name}.{port.name}": [] for part, port in outputs}
        for part, port in inputs:
            unit = self._unit(part.name, port.unit.text)
            fitting = [f"{p.name}.{o.name}" for p, o in outputs if self._unit(p.name, o.unit.text) == unit
                       or (not self.careful and self.random.random() < 0.1)]
            fitting = [name for name in fitting if not name.startswith(f"{part.name}.")]
            if fitting and self.random.random() < 0.6:
                joined[self.random.choice(fitting)].append(f"{part.name}.{port.name}")
            else:
                part.settings[port.name] = self._given(unit)
        for k, (output, ends) in enumerate(joined.items()):
            self.nodes[f"y{k}"] = (output, *ends)

    def _given(self, unit: str) -> str:
        value = self._number(unit, signed=True)
        quantity = _quantity(value, unit)
        shape = self.random.choice(("constant", "constant", "sine", "ramp", "feedback", "feedback", "kink"))
        if shape == "constant":
            return quantity
        if shape == "sine":
            return f'"={quantity} * sin(2*pi*time/({self.random.choice((0.1, 0.3, 1))} s))"'
        if shape == "ramp":
            return f'"={quantity} * (1 - time/({self.random.choice((0.2, 0.5, 1))} s))"'
        if shape == "kink":
            return f'"={quantity} * max(min(time/(0.1 s), 1), 0)"'
        name, of = self._member()
        return f'"={quantity} * {name}/({_quantity(SIZES.get(of, 1.0), of)})"'

    def _member(self) -> tuple[str, str]:
        """A node's member and its unit; the time where there is no node."""
        nodes = [n for n in self.nodes if n in self.domain_of]
        if not nodes:
            return "time", "s"
        node = self.random.choice(nodes)
        member, unit = self.random.choice(MEMBERS[self.domain_of[node]])
        return f"{node}.{member}", unit

    # -- start -----------------------------------------------------------------------------------------------------
    def _initial(self) -> dict[str, str]:
        found = {}
        if self.random.random() < 0.4:
            found["start"] = self.random.choice(("steady", "steady", "rest"))
        for _ in range(self.random.choice((0, 0, 0, 1) if self.careful else (0, 0, 1, 2, 3))):
            name, unit = self._member()
            if name != "time":
                guess = "~ " if self.random.random() < (0.7 if self.careful else 0.4) else ""
                found[name] = guess + _quantity(self._number(unit, signed=unit not in ("K",)), unit)
        numbers = [f"{p.name}.{q}" for p in self.parts for q in p.settings if q in _components()[p.kind].parameters]
        if numbers and self.random.random() < (0.03 if self.careful else 0.15):
            found["solve"] = f"[{self.random.choice(numbers)}]"
        return found

    def _slip(self) -> None:
        """One mistake in form."""
        kind = self.random.randrange(8)
        part = self.random.choice(self.parts)
        if kind == 0 and part.settings:
            part.settings.pop(self.random.choice(list(part.settings)))
        elif kind in (1, 2) and part.settings:
            part.settings[self.random.choice(list(part.settings))] = self.random.choice(WRONG)
        elif kind == 3 and self.nodes:
            node = self.random.choice(list(self.nodes))
            self.nodes[node] = self.nodes[node][1:] or ("nowhere.a",)
        elif kind == 4 and len(self.nodes) > 1:
            a, b = self.random.sample(list(self.nodes), 2)
            self.nodes[a] = (*self.nodes[a], *self.nodes.pop(b))
        elif kind == 5 and self.nodes:
            node = self.random.choice(list(self.nodes))
            self.nodes[node] = (*self.nodes[node], self.random.choice(self.nodes[node]))
        elif kind == 6:
            part.settings[self.random.choice(("repeat", "at", "is", "q", "width"))] = self.random.choice(WRONG)
        else:
            self.parts[self.parts.index(part)] = Part(part.name, part.kind + "s", part.settings)


def _number(count: Expr, given: dict[str, str]) -> int:
    """How many a `count` such as `3`, `n` or `n*m` makes."""
    if isinstance(count, Number):
        return int(count.value)
    if isinstance(count, Name):
        return int(given.get(count.text, "1"))
    assert isinstance(count, Binary)
    return _number(count.left, given) * _number(count.right, given)


def _put_in_order(component: Component, given: dict[str, str]) -> None:
    """Exchange values of which a component requires that one is not below the other."""
    for high, low in component.orders:
        if {high, low} <= {*given}:
            given[low], given[high] = sorted((given[low], given[high]), key=lambda text: float(text.split()[0]))


def _over(above: str, below: str) -> str:
    return above if below == "1" else f"{above}/({below})" if re.search(r"[*/]", below) else f"{above}/{below}"


def _quantity(value: float, unit: str) -> str:
    return f"{value:g}" if unit == "1" else f"{value:g} {unit}"
