"""Random small diagrams: a seed gives the same text on every machine.

Half of them are sound in form: every port on a node of its domain, units right, one output for each signal. What they
mean is left to chance, so that many are singular, contradict themselves or stand still. The others have slips in form.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache
from random import Random

from heavebond.definition import Component, Parameter
from heavebond.library import library

DOMAINS = ("translational", "rotational", "hydraulic", "pneumatic", "electrical")
# usual sizes by base unit, as text; what is not here is 1
SIZES = {
    "N": 1e3, "m": 0.1, "m/s": 0.3, "N/m": 1e4, "N*s/m": 300.0, "kg": 20.0, "Pa": 2e6, "m**3/s": 2e-4, "m**3": 2e-3,
    "m**2": 2e-3, "m**3/(s*Pa)": 1e-11, "N*m": 50.0, "kg*m**2": 0.3, "N*m/rad": 500.0, "N*m*s/rad": 3.0, "rad": 0.3,
    "rad/s": 3.0, "s": 0.2, "Hz": 4.0, "K": 300.0, "Pa*s/m**3": 1e9, "Pa*s**2/m**6": 1e13, "kg/m**4": 1e7,
    "m**3/Pa": 1e-12, "kg/(s*Pa)": 1e-8, "Pa*s/kg": 1e7, "W/K": 1.0, "J/(kg*K)": 800.0, "kg/m**3": 900.0, "m/s**2": 9.81,
    "N/m**3": 1e6, "N*s**2/m**2": 100.0, "1/m": 3.0, "s/m": 0.5, "1/Pa": 1e-6, "1": 0.7, "kg/s": 0.01, "W": 100.0,
}
ANY_UNIT = ("m", "N", "Pa", "m**3/s", "1", "m/s", "rad", "N*m")

# what decides a node, by the first letter of its domain; the first is the commonest
HOLDS = {"t": ("Mass", "Fixed"), "r": ("Inertia", "FixedShaft"), "h": ("Volume", "Tank", "PressureSource"),
         "p": ("ReceiverWithHeat", "Atmosphere", "Receiver"), "e": ("ElectricalGround", "Capacitor")}


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

    def without_part(self, name: str) -> Diagram:
        """The diagram with one part fewer; nodes that are left without ports go too."""
        nodes = {node: tuple(port for port in ports if not port.startswith(f"{name}."))
                 for node, ports in self.nodes.items()}
        return replace(self, parts=tuple(p for p in self.parts if p.name != name),
                       nodes={node: ports for node, ports in nodes.items() if ports})


@cache
def _components() -> dict[str, Component]:
    found = library()
    return {name: found.component(name) for name in found.names()}


def diagram(seed: int) -> Diagram:
    """The diagram of a seed."""
    return _Maker(seed).made()


class _Maker:
    def __init__(self, seed: int):
        self.seed, self.random = seed, Random(seed)
        self.sloppy = self.random.random() < 0.15
        self.zeros = self.random.choice((0.0, 0.0, 0.1, 0.3))
        self.parts: list[Part] = []
        self.nodes: dict[str, tuple[str, ...]] = {}
        # the unit of $U of each part
        self.unit: dict[str, str] = {}

    def made(self) -> Diagram:
        chosen = self._kinds()
        for k, kind in enumerate(chosen):
            name = f"c{k}"
            self.unit[name] = self.random.choice(ANY_UNIT)
            self.parts.append(Part(name, kind, self._parameters(name, _components()[kind])))
        for domain in DOMAINS:
            self._wire(domain)
        if self.random.random() < 0.6:
            self._settle()
        self._signals()
        initial = self._initial()
        if self.sloppy:
            self._slip()
        return Diagram(self.seed, tuple(self.parts), self.nodes, initial, 10 ** self.random.uniform(-1.5, 0.5))

    def _kinds(self) -> list[str]:
        """Parts of one domain or two, what stands for the surroundings among them more often than by chance."""
        domains = set(self.random.sample(DOMAINS, self.random.choice((1, 1, 1, 2))))
        fitting = [name for name, c in _components().items() if c.ports and {p.domain for p in c.ports.values()} <= domains]
        signals = [name for name, c in _components().items() if not c.ports]
        common = [name for name in ("Fixed", "Mass", "Spring", "Damper", "Tank", "Volume", "PressureSource", "FlowSource",
                                    "Orifice", "Inertia", "FixedShaft", "TorsionSpring", "Atmosphere", "Receiver",
                                    "PneumaticOrifice", "LineInertance", "LaminarLeakage", "ForceSource") if name in fitting]
        number = self.random.randint(1, 7)
        chosen = [self.random.choice(common if common and self.random.random() < 0.6 else fitting) for _ in range(number)]
        if self.random.random() < 0.3:
            chosen += self.random.choices(signals, k=self.random.randint(1, 3))
        return chosen

    # -- values ----------------------------------------------------------------------------------------------------
    def _parameters(self, name: str, component: Component) -> dict[str, str]:
        found = {}
        for parameter in component.parameters.values():
            optional = parameter.default is not None or parameter.neutral is not None
            if optional and self.random.random() < 0.8:
                continue
            found[parameter.name] = self._parameter(name, parameter)
        return found

    def _parameter(self, name: str, parameter: Parameter) -> str:
        if parameter.integer:
            return str(self.random.randint(1, 5))
        unit = self._unit(name, parameter.unit.text)
        value = self._number(unit, signed=parameter.low is None or parameter.low < 0)
        if parameter.low is not None:
            value = max(value, parameter.low)
        if parameter.high is not None:
            value = min(value, parameter.high)
        return _quantity(value, unit)

    def _number(self, unit: str, *, signed: bool) -> float:
        if self.random.random() < self.zeros:
            return 0.0
        # round numbers, so that two parts have the same value at times
        size = SIZES.get(unit, 1.0) * self.random.choice((0.1, 0.5, 1, 1, 1, 2, 10))
        return -size if signed and self.random.random() < 0.3 else size

    def _unit(self, name: str, declared: str) -> str:
        own = self.unit[name]
        if "$" not in declared:
            return declared
        if declared == "$Y/$U":
            return "1"
        return (declared.replace("$U", own).replace("$Y", own)) if own != "1" or "/" not in declared else "1/s"

    # -- wires -----------------------------------------------------------------------------------------------------
    def _wire(self, domain: str) -> None:
        ports = [f"{part.name}.{port.name}" for part in self.parts
                 for port in _components()[part.kind].ports.values() if port.domain == domain]
        self.random.shuffle(ports)
        number = max(1, round(len(ports) / self.random.choice((1.5, 2, 2.5, 3))))
        groups: list[list[str]] = [[] for _ in range(number)]
        for k, port in enumerate(ports):
            groups[k if k < number else self.random.randrange(number)].append(port)
        for k, group in enumerate(g for g in groups if g):
            self.nodes[f"{domain[0]}{k}"] = tuple(group)

    def _settle(self) -> None:
        """A store or a source on every node that has none, so that most of the diagrams run."""
        kinds = {f"{part.name}.{port}": part.kind for part in self.parts for port in _components()[part.kind].ports}
        for node, ports in list(self.nodes.items()):
            choice = HOLDS[node[0]]
            if not {kinds[port] for port in ports} & {*choice}:
                name = f"c{len(self.parts)}"
                kind = self.random.choice((*choice[:1] * 3, *choice))
                self.unit[name] = "1"
                self.parts.append(Part(name, kind, self._parameters(name, _components()[kind])))
                self.nodes[node] = (*ports, f"{name}.a")

    def _signals(self) -> None:
        outputs = [(part, port) for part in self.parts
                   for port in _components()[part.kind].signals.values() if port.direction == "out"]
        inputs = [(part, port) for part in self.parts
                  for port in _components()[part.kind].signals.values() if port.direction == "in"]
        joined: dict[str, list[str]] = {f"{part.name}.{port.name}": [] for part, port in outputs}
        for part, port in inputs:
            unit = self._unit(part.name, port.unit.text)
            fitting = [f"{p.name}.{o.name}" for p, o in outputs
                       if self._unit(p.name, o.unit.text) == unit or self.random.random() < 0.1]
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
        shape = self.random.choice(("constant", "constant", "sine", "ramp", "feedback", "kink"))
        if shape == "constant":
            return quantity
        if shape == "sine":
            return f'"={quantity} * sin(2*pi*time/({self.random.choice((0.1, 0.3, 1))} s))"'
        if shape == "ramp":
            return f'"={quantity} * (1 - time/({self.random.choice((0.2, 0.5, 1))} s))"'
        if shape == "kink":
            return f'"={quantity} * max(min(time/(0.1 s), 1), 0)"'
        of = self._member()
        return f'"={quantity} * {self._measured}/({_quantity(SIZES.get(of, 1.0), of)})"'

    def _member(self) -> str:
        """A unit of a node's member; `_measured` is its name."""
        members = {"t": [("v", "m/s"), ("x", "m")], "r": [("w", "rad/s"), ("phi", "rad")], "h": [("p", "Pa")],
                   "p": [("p", "Pa"), ("T", "K")], "e": [("v", "V")]}
        node = self.random.choice([n for n in self.nodes if n[0] in members] or [""])
        if not node:
            self._measured, unit = "time", "s"
        else:
            member, unit = self.random.choice(members[node[0]])
            self._measured = f"{node}.{member}"
        return unit

    # -- start -----------------------------------------------------------------------------------------------------
    def _initial(self) -> dict[str, str]:
        found = {}
        if self.random.random() < 0.4:
            found["start"] = self.random.choice(("steady", "steady", "rest"))
        for _ in range(self.random.choice((0, 0, 1, 2, 3))):
            unit = self._member()
            if self._measured != "time":
                guess = "~ " if self.random.random() < 0.4 else ""
                found[self._measured] = guess + _quantity(self._number(unit, signed=unit not in ("K",)), unit)
        numbers = [f"{p.name}.{q}" for p in self.parts for q in p.settings if q in _components()[p.kind].parameters]
        if numbers and self.random.random() < 0.1:
            found["solve"] = f"[{self.random.choice(numbers)}]"
        return found

    def _slip(self) -> None:
        """One mistake in form."""
        kind = self.random.randrange(5)
        part = self.random.choice(self.parts)
        if kind == 0 and part.settings:
            part.settings.pop(self.random.choice(list(part.settings)))
        elif kind == 1 and part.settings:
            wrong = self.random.choice(("3 furlong", "abc", "=m/", "-1", "1e400 m"))
            part.settings[self.random.choice(list(part.settings))] = wrong
        elif kind == 2 and self.nodes:
            node = self.random.choice(list(self.nodes))
            self.nodes[node] = self.nodes[node][1:] or ("nowhere.a",)
        elif kind == 3 and len(self.nodes) > 1:
            a, b = self.random.sample(list(self.nodes), 2)
            self.nodes[a] = (*self.nodes[a], *self.nodes.pop(b))
        else:
            self.parts[self.parts.index(part)] = Part(part.name, part.kind + "s", part.settings)


def _quantity(value: float, unit: str) -> str:
    return f"{value:g}" if unit == "1" else f"{value:g} {unit}"
