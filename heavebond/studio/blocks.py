"""Blocks: components that consist of others, drawn and edited in their files like diagrams."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from heavebond.core.errors import ModelError, Place, Problem, Problems
from heavebond.equations.connect import Network, connect_as_far
from heavebond.equations.expand import expand_as_far
from heavebond.equations.expanded import Bound, Expanded, Leaf
from heavebond.language import laws
from heavebond.language.component_file import parse_component
from heavebond.language.definition import Body, Component, Instance, Value
from heavebond.language.library import library
from heavebond.language.model import Model
from heavebond.text.expression import Number, calling
from heavebond.text.yaml_source import Source

OUTSIDE = Place("", 0)  # problems that depend on the diagram which uses the block; they are not mistakes of its file
NAME = "block"  # name of the only part of the diagram in which it is expanded


@dataclass(frozen=True)
class Block:
    """A component with its inside as a diagram (`model`, `expanded`, `network`), in which the ports of the block are ends
    without a part, and its problems. `leaf` is the block itself."""

    component: Component
    model: Model
    expanded: Expanded
    network: Network
    problems: Problems
    leaf: Leaf | None

    @property
    def whole(self) -> Expanded:
        """The inside of the block together with the block, so that its ports are drawn on the frame."""
        if self.leaf is None:
            return self.expanded
        return replace(self.expanded, leaves={"": replace(self.leaf, path=""), **self.expanded.leaves})


def is_block(source: Source) -> bool:
    return "component" in source.root.items


def beside(path: Path) -> list[Path]:
    """The folders whose components a component file may use: its folder, and the folder of the diagrams that it belongs
    to.
    """
    return [path.parent, *(p.parent for p in path.parents if p.name == "components")]


def read_block(source: Source) -> Block:
    """Read a component, which may be unfinished; ModelError for a text that cannot be read as one."""
    known = library(beside(source.path))
    with calling(known.functions):
        component = parse_component(source, known.domains, known.base(source.path) if source.path.is_file() else None)
    edited = known.with_components({component.name: component})
    counts = {name: Value(Number(1, None, 0), "1", OUTSIDE, si=True) for name, p in component.parameters.items()
              if p.integer and p.default is None and p.neutral is None}
    part = Instance(NAME, component.name, OUTSIDE, OUTSIDE, dict(counts))
    around, problems = expand_as_far(Model(component.name, component.summary, source.path, edited,
                                           body=Body({NAME: part}, {})))
    network, mixed = connect_as_far(around)
    problems.found = [p for p in (*problems.found, *mixed.found) if p.place is None or p.place != OUTSIDE]
    if not component.composite:
        try:
            laws.check(component, known.domains)
        except ModelError as error:
            problems.extend(error)
    model = replace(around.model, body=component.body)

    # the parts inside the block, with paths relative to it
    def bounds(entries: dict[str, Bound]) -> dict[str, Bound]:
        return {name: replace(bound, scope=bound.scope.removeprefix(f"{NAME}.")) for name, bound in entries.items()}

    leaves = {_cut(path): replace(leaf, path=_cut(path), parameters=bounds(leaf.parameters), inputs=bounds(leaf.inputs))
              for path, leaf in around.leaves.items() if path != NAME}
    junctions = {_cut(path): replace(junction, path=_cut(path), ends=tuple(
        replace(end, leaf=_cut(end.leaf)) for end in junction.ends)) for path, junction in around.junctions.items()}
    inside = Expanded(model, leaves, junctions, {}, {_cut(k): v for k, v in around.ports.items()},
                      {_cut(k): v for k, v in around.signals.items()}, sheets={_cut(k): v for k, v in around.sheets.items()})
    inside_network = replace(network, group_of_port={_cut(k): v for k, v in network.group_of_port.items()},
                             group_of_node={_cut(k): v for k, v in network.group_of_node.items()},
                             domains={_cut(k): v for k, v in network.domains.items()})
    return Block(component, model, inside, inside_network, problems, around.leaves.get(NAME))


def _cut(path: str) -> str:
    return "" if path == NAME else path.removeprefix(f"{NAME}.")


def unrunnable(name: str) -> Problem:
    """Reason why a component is not simulated."""
    return Problem("usage", f"'{name}' is a component: it runs as a part of a diagram", None,
                   f"A diagram uses it under `components:`, as in `part: {{is: {name}, ...}}`.")
