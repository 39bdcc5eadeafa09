"""Frames: the explicit relations between the frames of nodes, and the relations that close a loop.

A part relates the frames of its ports by a rotation and a translation (`frames:` of a component). Orientations are unit
quaternions: a relation between two of them determines the four numbers of one orientation, but has rank three. The
relation of the angular velocities follows by differentiation. The relations are the edges of a graph whose vertices are
the nodes and the fixed frame. On a spanning tree, a relation determines the orientation, position and velocities of a
node from its predecessor by explicit equations, in which the norm of the quaternion is 1 by construction. Each other
relation closes a loop and gives three equations for the rotation and three for the translation. A tree of bodies
therefore has explicit recursions without derivatives of positions, and a loop has as many equations as constraints.

M. Otter, H. Elmqvist, S. E. Mattsson: The new Modelica MultiBody library. Proc. 3rd International Modelica Conference,
Linkoping 2003, 311-330: overdetermined connectors, and relations of velocities in addition to relations of positions.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import casadi as ca

from heavebond.core.errors import listing
from heavebond.equations.connect import Network
from heavebond.equations.expand import default
from heavebond.equations.expanded import Expanded, Junction, Leaf, PortEnd
from heavebond.language.lists import written_out
from heavebond.language.template import FrameForm, template

FIXED = -1  # the vertex of the fixed frame
SUFFIX = "rotation"  # of the name of an added part
Key = tuple[str, int]  # a part, and the number of one of its relations


class Relation(NamedTuple):
    """A relation between two vertices (numbers of groups of the network, or FIXED)."""

    key: Key
    first: int
    second: int


class FrameForms(NamedTuple):
    """The forms of the rotation and of the translation of a relation; None if it relates only the other."""

    rotation: FrameForm | None
    translation: FrameForm | None


@dataclass(frozen=True)
class FrameTree:
    """The forms of each relation; the groups of nodes whose orientations are related to each other but not to the fixed
    frame (`unrooted`); the nodes whose positions and velocities follow from other nodes (`carried`), and the nodes where
    they do not (`roots`). `rotations` and `translations` are the relations of each spanning tree, from its root outwards;
    `loops` maps a closing relation to the parts of its loop, in their order along it."""

    forms: Mapping[Key, FrameForms]
    unrooted: tuple[tuple[int, ...], ...]
    carried: frozenset[int]
    roots: frozenset[int]
    rotations: tuple[Key, ...]
    translations: tuple[Key, ...]
    loops: Mapping[Key, tuple[str, ...]]


@dataclass(frozen=True)
class RedundantLoop:
    """A loop without its redundant constraints: its `parts`, the part that closes it, and the port of this part, at which
    the `reactions` (`M_x`, in the axes of the port) are taken as zero. It also has the values (n,) of the omitted
    constraints in raw symbols, in rad and in sizes of the loop, and the values of unknowns in a configuration in which the
    loop is closed."""

    parts: tuple[str, ...]
    closing: str
    port: str
    reactions: tuple[str, ...]
    residuals: ca.SX
    configuration: Mapping[int, float]

    @property
    def text(self) -> str:
        """The redundancy and the choice of reactions, in a sentence."""
        n = len(self.reactions)
        return f"the loop {listing(self.parts, 12)} constrains {n} motion{'s' * (n > 1)} more than once; " \
            f"the reaction{'s' * (n > 1)} {listing(self.reactions)} at {self.port} (in its axes) " \
            f"{'are' if n > 1 else 'is'} taken as zero"


def frame_tree(expanded: Expanded, network: Network) -> FrameTree:
    """The spanning trees of orientations and of positions."""
    domains = expanded.model.library.domains
    vertices = [k for k, group in enumerate(network.groups)
                if group.ports and group.domain in domains and domains[group.domain].orientation]
    rotations, translations = list[Relation](), list[Relation]()
    for path, leaf in expanded.leaves.items():
        for number, frame in enumerate(leaf.component.frames):
            first, second = (network.group_of_port[f"{path}.{port}"] if port else FIXED for port in (frame.a, frame.b))
            if frame.turn is not None:
                rotations.append(Relation((path, number), first, second))
            if frame.shift is not None:
                translations.append(Relation((path, number), first, second))
    rotation_forms, orientation_trees, rotation_loops = _spanning_trees(vertices, rotations)
    translation_forms, position_trees, translation_loops = _spanning_trees(vertices, translations)
    forms = {key: FrameForms(rotation_forms.get(key), translation_forms.get(key))
             for key in dict.fromkeys((*rotation_forms, *translation_forms))}
    roots = frozenset(tree[0] for tree in position_trees)
    return FrameTree(forms, tuple(tuple(tree) for tree in orientation_trees), frozenset(vertices) - roots, roots,
                     tuple(key for key, form in rotation_forms.items() if form is not FrameForm.CLOSING),
                     tuple(key for key, form in translation_forms.items() if form is not FrameForm.CLOSING),
                     {**translation_loops, **rotation_loops})


def _spanning_trees(vertices: Iterable[int], relations: Iterable[Relation]
                    ) -> tuple[dict[Key, FrameForm], list[list[int]], dict[Key, tuple[str, ...]]]:
    """The form of each relation by breadth-first search, from the fixed frame and then from the first vertex that is not
    reached, in the order of declaration; the vertices of each tree without the fixed frame, its root first; and the parts of
    the loop of each other relation."""
    edges: dict[int, list[Relation]] = {}
    for relation in relations:
        for vertex in dict.fromkeys((relation.first, relation.second)):
            edges.setdefault(vertex, []).append(relation)
    forms: dict[Key, FrameForm] = {}
    above: dict[int, tuple[int, Key]] = {}  # for each vertex its predecessor, and the relation between both
    closing: list[Relation] = []
    reached: set[int] = set()
    trees: list[list[int]] = []
    for root in (FIXED, *vertices):
        if root in reached:
            continue
        reached.add(root)
        tree, waiting = [root], deque([root])
        while waiting:
            vertex = waiting.popleft()
            for relation in edges.get(vertex, ()):
                if relation.key in forms:
                    continue
                ahead = relation.first == vertex
                neighbour = relation.second if ahead else relation.first
                if neighbour in reached:
                    forms[relation.key] = FrameForm.CLOSING
                    closing.append(relation)
                    continue
                forms[relation.key] = FrameForm.FORWARD if ahead else FrameForm.INVERSE
                reached.add(neighbour)
                above[neighbour] = vertex, relation.key
                tree.append(neighbour)
                waiting.append(neighbour)
        if root != FIXED:
            trees.append(tree)
    loops: dict[Key, tuple[str, ...]] = {}
    for relation in closing:
        branches = list[list[Key]]()
        for vertex in (relation.first, relation.second):
            branch = list[Key]()
            while vertex in above:
                vertex, key = above[vertex]
                branch.append(key)
            branches.append(branch)
        before, after = ([key for key in branches[k] if key not in branches[1 - k]] for k in (0, 1))
        loops[relation.key] = tuple(dict.fromkeys(part for part, _ in (*before[::-1], relation.key, *after)))
    return forms, trees, loops


def with_roots(expanded: Expanded, network: Network) -> Expanded:
    """The diagram with a part for each group of orientations that nothing relates to the fixed frame: `free` of its domain,
    whose states they follow from (for a linearisation `minimal`, with as many states as degrees of freedom), or `idle` if no
    law depends on them."""
    unrooted = frame_tree(expanded, network).unrooted
    if not unrooted:
        return expanded
    leaves, junctions, ports = dict(expanded.leaves), dict(expanded.junctions), dict(expanded.ports)
    turned = _turned(expanded, network)
    library = expanded.model.library
    for tree in unrooted:
        group = network.groups[tree[0]]
        domain = library.domains[group.domain]
        free = domain.minimal if expanded.model.approximate else domain.free
        component = written_out(library.checked(free if turned & set(tree) else domain.idle, group.place), {})
        path = f"{group.name}_{SUFFIX}"
        while path in leaves or path in junctions:
            path += "_"
        values = {name: bound for name, parameter in component.parameters.items()
                  if (bound := default(parameter, path)) is not None}
        leaves[path] = Leaf(path, component, group.place, values, {}, {})
        port = next(iter(component.ports))
        ports[f"{path}.{port}"] = component.ports[port]
        node = next((alias for alias in group.aliases if alias in junctions), "")
        # the node with one more port; without a node, one that joins the port with the free end
        junction = junctions.get(node)
        added = PortEnd(path, port, 1, group.place)
        if junction is not None:
            junctions[node or path] = replace(junction, ends=(*junction.ends, added))
        else:
            leaf, _, name = group.ports[0].rpartition(".")
            junctions[node or path] = Junction(path, (PortEnd(leaf, name, 1, group.place), added), group.place)
    return replace(expanded, leaves=leaves, junctions=junctions, ports=ports)


def _turned(expanded: Expanded, network: Network) -> set[int]:
    """The vertices whose orientation or angular velocity acts on a force, a moment or the place of another node. An angle
    sensor on a point mass is not such an action."""
    domains, turned = expanded.model.library.domains, set[int]()
    for path, leaf in expanded.leaves.items():
        # the members of the domain of each port that describe its orientation
        turning = {port: (*domain.orientation, *domain.vectors[domain.turning])
                   for port, name in network.domains[path].items() if (domain := domains[name]).orientation}
        if not turning or leaf.component.composite:
            continue
        laws = template(leaf.component, domains, network.domains[path], leaf.integers)
        # the variables in the laws that contain through variables, directly or by variables of the part itself
        links = {f"{port}.{member}" for port, name in network.domains[path].items() for member in domains[name].through}
        open_rows = [{laws.slots[e.column % len(laws.slots)] for e in row} for row in laws.entries]
        acting: set[str] = set()
        while linked := [row for row in open_rows if row & links]:
            open_rows = [row for row in open_rows if not row & links]
            acting |= set().union(*linked)
            links |= acting & set(leaf.component.unknowns)
        arms = [row for law in laws.frames if law.translation for row in law.translation[FrameForm.FORWARD].entries]
        acting |= {laws.slots[e.column % len(laws.slots)] for row in arms for e in row}
        turned |= {network.group_of_port[f"{path}.{port}"] for port, members in turning.items()
                   if any(f"{port}.{member}" in acting for member in members)}
    return turned


