"""Placement of the vertices of a graph so that straight bonds can be drawn between them.

Distances on the paper should equal distances along the bonds: the weighted sum of squared differences (the stress) is
minimised by majorisation, from several starts, and the result with the fewest crossings is chosen. T. Kamada, S. Kawai,
Inf. Process. Lett. 31 (1989) 7-15, doi:10.1016/0020-0190(89)90102-6; E. R. Gansner, Y. Koren, S. North, Graph Drawing
2004, LNCS 3383, 239-250, doi:10.1007/978-3-540-31843-9_25.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Point = tuple[float, float]
STARTS, SWEEPS = 24, 200  # number of starts; steps of each
INSISTING = 30.0  # weight of vertices that are too close
NEAR = 16.0  # px: a vertex this close to a bond of others is hidden by it
ROOM = 60.0  # px between components that no bond connects


def places(lengths: Mapping[tuple[str, str], float], room: Mapping[str, float]) -> dict[str, Point]:
    """x to the right and y downwards of each vertex in px, wider than high; `lengths` are the desired lengths of the
    bonds, `room` is the free radius around each vertex."""
    import networkx as nx

    vertices, around = list(room), np.array(list(room.values()))
    number = {name: k for k, name in enumerate(vertices)}
    links = [(number[one], number[two]) for one, two in lengths if one != two]
    graph: nx.Graph[int] = nx.Graph()
    graph.add_nodes_from(range(len(vertices)))
    graph.add_weighted_edges_from((number[one], number[two], length) for (one, two), length in lengths.items() if one != two)
    wanted = np.asarray(nx.floyd_warshall_numpy(graph))  # the shortest path along bonds
    places_found, top = {}, 0.0
    # connected components, the largest first
    for piece in sorted(map(sorted, nx.connected_components(graph)), key=lambda piece: (-len(piece), piece)):
        inside = {k: n for n, k in enumerate(piece)}
        piece_links = [(inside[one], inside[two]) for one, two in links if one in inside]
        points = _laid(wanted[np.ix_(piece, piece)], around[piece], piece_links)
        points += np.array([0.0, top]) - points.min(axis=0)
        top = float(points[:, 1].max()) + ROOM
        places_found.update({vertices[k]: (float(x), float(y)) for k, (x, y) in zip(piece, points.tolist(), strict=True)})
    return places_found


def _laid(wanted: Array, around: Array, links: Sequence[tuple[int, int]]) -> Array:
    """The places (n, 2) of one connected component."""
    if len(wanted) == 1:
        return np.zeros((1, 2))
    random = np.random.default_rng(len(wanted))
    tried = []
    for k in range(STARTS):
        start = _scaled(wanted) if k == 0 else random.standard_normal((len(wanted), 2)) * wanted.max() / 4
        points = _settled(start, wanted, around[:, None] + around[None, :])
        hidden = crossings(points, links) + 2 * _covered(points, links)
        tried.append((hidden, round(_stress(points, wanted), 6), k, points))
    return _lying(min(tried, key=lambda one: one[:3])[3])


def _scaled(wanted: Array) -> Array:
    """Classical scaling: the two largest principal axes of the squared distances."""
    centred = wanted**2 - np.mean(wanted**2, axis=0)
    values, vectors = np.linalg.eigh(-0.5 * (centred - np.mean(centred, axis=1)[:, None]))
    coordinates = vectors[:, :-3:-1] * np.sqrt(np.maximum(values[:-3:-1], 1e-9))
    spread = 1e-3 * wanted.max() * np.random.default_rng(0).standard_normal((len(wanted), 2))
    return np.asarray((coordinates if coordinates.shape[1] == 2 else np.column_stack([coordinates, np.zeros(len(wanted))]))
                      + spread)


def _settled(points: Array, wanted: Array, least: Array) -> Array:
    """Stress majorisation; in the last steps vertices nearer than `least` are pushed apart."""
    with np.errstate(divide="ignore"):
        usual = np.where(wanted > 0, 1 / wanted**2, 0.0)
    for sweep in range(SWEEPS):
        apart = points[:, None, :] - points[None, :, :]
        size = np.maximum(np.hypot(apart[..., 0], apart[..., 1]), 1e-9)
        near = (size < least) & (usual > 0) & (sweep > SWEEPS // 2)
        aim, weight = np.where(near, least, wanted), np.where(near, INSISTING / least**2, usual)
        aims = points[None, :, :] + (aim / size)[..., None] * apart
        points = (weight[..., None] * aims).sum(axis=1) / weight.sum(axis=1)[:, None]
    return points


def _stress(points: Array, wanted: Array) -> float:
    apart = points[:, None, :] - points[None, :, :]
    above = np.triu_indices(len(points), 1)
    return float((((np.hypot(apart[..., 0], apart[..., 1]) - wanted)[above] / wanted[above])**2).sum())


def crossings(points: Array, links: Sequence[tuple[int, int]]) -> int:
    """Number of pairs of straight links that cross."""
    def side(a: int, b: int, c: int) -> bool:
        (x, y), (u, v), (p, q) = points[a], points[b], points[c]
        return bool((u - x) * (q - y) > (v - y) * (p - x))

    return sum(1 for (a, b), (c, d) in combinations(links, 2) if len({a, b, c, d}) == 4
               and side(a, b, c) != side(a, b, d) and side(c, d, a) != side(c, d, b))


def _covered(points: Array, links: Sequence[tuple[int, int]]) -> int:
    """Number of vertices that nearly lie on a link of others."""
    count = 0
    for one, two in links:
        direction = points[two] - points[one]
        share = np.clip((points - points[one]) @ direction / max(float(direction @ direction), 1e-9), 0.0, 1.0)
        off = np.hypot(*(points - points[one] - share[:, None] * direction).T)
        off[[one, two]] = np.inf
        count += int((off < NEAR).sum())
    return count


def _lying(points: Array) -> Array:
    """Rotate the picture to its smallest height, with the first vertex at the left."""
    best = None
    for angle in np.linspace(0, np.pi, 37)[:-1]:
        turned = points @ np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]).T
        if best is None or np.ptp(turned[:, 1]) < np.ptp(best[:, 1]):
            best = turned
    assert best is not None
    best = best - best.mean(axis=0)
    return np.asarray(best * np.where(best[0] > 0, -1.0, 1.0))
