"""An opened diagram: every component with equations and every node inside its blocks, by full path."""

from __future__ import annotations

from dataclasses import dataclass, field

from heavebond.core.errors import Place
from heavebond.language.definition import Component, FileInput, Port, SignalPort, Value
from heavebond.language.model import Model
from heavebond.text.expression import names


@dataclass(frozen=True)
class Bound:
    """A value given to a parameter or an input, and the scope (path prefix) in which its names are looked up."""

    value: Value | FileInput
    scope: str
    place: Place

    @property
    def varies(self) -> bool:
        """Whether a measured file or a formula in time gives the value."""
        return isinstance(self.value, FileInput) or any(n.text == "time" for n in names(self.value.expr))


@dataclass(frozen=True)
class Leaf:
    """A component in the opened diagram. A block is a leaf too, as it may have equations in addition to its parts."""

    path: str
    component: Component
    place: Place
    parameters: dict[str, Bound]
    inputs: dict[str, Bound]
    integers: dict[str, int]

    @property
    def scope(self) -> str:
        """The prefix of the names inside."""
        return self.path + "."


@dataclass(frozen=True)
class PortEnd:
    """A port on a node; the sign is -1 for a block's own port seen from its inside."""

    leaf: str
    port: str
    sign: int
    place: Place

    @property
    def name(self) -> str:
        """Its full path."""
        return f"{self.leaf}.{self.port}" if self.leaf else self.port


@dataclass(frozen=True)
class Junction:
    """A node: its full path and the ends that it joins."""

    path: str
    ends: tuple[PortEnd, ...]
    place: Place


@dataclass(frozen=True)
class Medium:
    """The medium of a circuit: the part `source` of this `kind` that sets it (if empty, the usual values are used), the
    nodes of the circuit, and the parameters `takers` that take their values from it."""

    source: str
    kind: str
    nodes: tuple[str, ...]
    takers: tuple[str, ...]


@dataclass(frozen=True)
class Expanded:
    """The opened diagram. The opened diagram. `ports` and `signals` give the domain or unit of each port end, by full port
    path; `media` the media of circuits with parts that need one; `sheets` the parameters that follow a data sheet.
    `approximated` are the parts with delayed variables that components without history replace, for computations without a
    history: path, component and replacement. `defaults` are the inputs on no node that have the value of their component.
    """

    model: Model
    leaves: dict[str, Leaf]
    junctions: dict[str, Junction]
    parameters: dict[str, Bound] = field(default_factory=dict)
    ports: dict[str, Port] = field(default_factory=dict)
    signals: dict[str, SignalPort] = field(default_factory=dict)
    media: tuple[Medium, ...] = ()
    sheets: dict[str, tuple[str, ...]] = field(default_factory=dict)
    approximated: tuple[tuple[str, str, str], ...] = ()
    defaults: dict[str, Value] = field(default_factory=dict)

    @property
    def blocks(self) -> list[str]:
        """The paths of the blocks, which are components that consist of other components."""
        return [path for path, leaf in self.leaves.items() if leaf.component.composite]
