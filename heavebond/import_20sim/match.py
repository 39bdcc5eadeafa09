"""A library component that replaces an imported one."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Match:
    """A library component that replaces an imported one: its name, its ports by the imported ones, its parameters (and
    constant inputs) by the imported parameters or as numbers with units, and its states by its port."""

    name: str
    ports: dict[str, str]
    parameters: dict[str, str]
    numbers: dict[str, float]
    units: dict[str, str]
    initial: dict[str, float] = field(default_factory=dict)
    lists: dict[str, str] = field(default_factory=dict)  # for a table: the names of its inputs `x` and values `v`
    matrices: dict[str, list[list[float]]] = field(default_factory=dict)  # matrix parameters, by rows
    any_domain: bool = False  # its ports take the domain of the connected node
