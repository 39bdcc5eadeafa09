"""Regressors of a law at a place of a diagram: estimated speeds, positions, pressures and signals near it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from heavebond.equations.flatten import Flat
from heavebond.equations.places import Node, Place
from heavebond.localise.constants import INPUT_ESTIMATION
from heavebond.localise.curves import Variable
from heavebond.localise.ltv_model import LocalSignal, LtvModel
from heavebond.numerics.dae import Array


def estimated(system: LtvModel, locals_: Sequence[LocalSignal], state: Array, driven: Array) -> dict[str, Array]:
    """The local signals (N,) of a record in SI as they were with the estimated state (N, n+k) and input (N, M)."""
    deviations = np.einsum("klj,kj->kl", system.local_c, state) + np.einsum("klj,kj->kl", system.local_d,
                                                                            driven - system.driven)
    return dict(zip((s.name for s in locals_), (system.local + deviations).T, strict=True))


def smooth_rate(values: Array, time: Array) -> Array:
    """The derivative (N,) of an estimated signal, from cubics over a sixth of its mean period about each sample; differences
    of neighbours would mostly show the errors of the signal (A. Savitzky, M. J. E. Golay, 1964, doi:10.1021/ac60214a047)."""
    step = float(np.median(np.diff(time)))
    rate = np.gradient(values, time)
    omega = float(np.sqrt(np.mean(rate**2) / max(float(np.var(values)), 1e-300)))
    width = min(int(2 * np.pi / max(omega, 1e-12) / INPUT_ESTIMATION.rate_window / step), len(values) // 4) | 1
    return _rate_of_cubics(values, width) / step if width > 3 else rate


def integral(values: Array, time: Array) -> Array:
    """The integral (N,) of a signal from its first sample, by the trapezoidal rule."""
    return np.concatenate([[0.0], np.cumsum((values[1:] + values[:-1]) / 2 * np.diff(time))])


def _rate_of_cubics(values: Array, width: int) -> Array:
    """The derivative (N,), per sample, of the cubics fitted to `width` samples about each; near the ends of the first and
    the last of these cubics."""
    half = width // 2
    k = np.arange(-half, half + 1.0)
    fit = np.linalg.pinv((k[:, None] / half)**np.arange(4)) / float(half)**np.arange(4)[:, None]
    slopes = np.stack([np.zeros_like(k), np.ones_like(k), 2 * k, 3 * k**2], axis=1) @ fit
    return np.concatenate([slopes[:half] @ values[:width], np.convolve(values, slopes[half, ::-1], "valid"),
                           slopes[half + 1:] @ values[-width:]])


@dataclass(frozen=True)
class Regressors:
    """The variables at one place in several records, one after another; `breaks` are the first samples of each."""

    flat: Flat
    nodes: Mapping[str, Node]
    signals: Mapping[str, Array]
    times: Sequence[Array]

    def variables(self, place: Place) -> list[Variable]:
        """First the conjugate variable of the through variable (speed, pressure drop), then its integral or position, its
        rate, then the same of other ports of the components there, and their signals; constant variables are left out."""
        candidates = self._across(place.nodes)
        for component in place.components:
            candidates += self._neighbours(place, component)
        variables: dict[str, Variable] = {}
        for variable in candidates:
            if np.ptp(variable.values) > INPUT_ESTIMATION.still * max(float(np.abs(variable.values).max()), 1e-12):
                variables.setdefault(variable.formula, variable)
        return list(variables.values())[:INPUT_ESTIMATION.max_regressors]

    def _across(self, nodes: tuple[Node, ...], of_place: bool = True) -> list[Variable]:
        node = nodes[0]
        name, domain = node.across, node.domain
        values, formula = self._between(nodes, name)
        word = domain.members[name].noun
        phrase = word if node.mechanical or len(nodes) == 1 else f"{word} drop"
        unit = domain.members[name].unit
        kind = "across" if of_place else "speed" if node.mechanical else "pressure"
        variables = [self._variable(kind, f"{phrase} {formula}", formula, unit.text, values)]
        if domain.position:
            # the position, or without one in the diagram the integral of the speed about its mean
            member = domain.position
            if all(f"{n.name}.{member}" in self.signals for n in nodes):
                place, its = self._between(nodes, member)
            else:
                parts = []
                for v, t in zip(self._parts(values), self.times, strict=True):
                    x = integral(v, t)
                    parts.append(x - x.mean())
                place, its = np.concatenate(parts), f"∫ {formula}"
            variables.append(self._variable("position" if of_place else "place", f"position {its}", its,
                                            domain.members[domain.position].unit.text, place))
        if of_place:
            rate = np.concatenate([smooth_rate(part, t) for part, t in zip(self._parts(values), self.times, strict=True)])
            per_second = "m/s**2" if unit.text == "m/s" else f"{unit.text}/s"
            rate_phrase = f"acceleration der({formula})" if node.mechanical else f"rate of the {phrase} {formula}"
            variables.append(self._variable("rate", rate_phrase, f"der({formula})", per_second, rate))
            if not domain.position and len(nodes) == 2:
                variables += [self._variable("pressure", f"{word} {n.name}.{name}", f"{n.name}.{name}", unit.text,
                                   self.signals[f"{n.name}.{name}"]) for n in nodes]
        return variables

    def _between(self, nodes: tuple[Node, ...], member: str) -> tuple[Array, str]:
        """The difference of an across variable over a place: b - a of mechanical ports, else a - b."""
        a = self.signals[f"{nodes[0].name}.{member}"]
        if len(nodes) == 1:
            return a, f"{nodes[0].name}.{member}"
        b = self.signals[f"{nodes[1].name}.{member}"]
        first, second = (nodes[1], nodes[0]) if nodes[0].mechanical else (nodes[0], nodes[1])
        values = b - a if nodes[0].mechanical else a - b
        lower = self.signals[f"{second.name}.{member}"]
        if not np.any(lower):
            return values, f"{first.name}.{member}"
        if not np.any(self.signals[f"{first.name}.{member}"]):
            return values, f"-{second.name}.{member}"
        return values, f"{first.name}.{member} - {second.name}.{member}"

    def _variable(self, kind: str, phrase: str, formula: str, unit: str, values: Array) -> Variable:
        rising = np.concatenate([np.gradient(v) > 0 for v in self._parts(values)])
        return Variable(kind, phrase, formula, unit, values, rising)

    def _parts(self, values: Array) -> list[Array]:
        return np.split(values, np.cumsum([len(t) for t in self.times])[:-1])

    def _neighbours(self, place: Place, component: str) -> list[Variable]:
        """The ports of a component in other domains, and its signals."""
        other_nodes: dict[str, list[Node]] = {}
        for node in self.nodes.values():
            single = node.key == node.name and node.domain.name != place.nodes[0].domain.name
            if single and any(p.rpartition(".")[0] == component for p in node.ports):
                other_nodes.setdefault(node.domain.name, []).append(node)
        variables: list[Variable] = []
        for nodes in other_nodes.values():
            if nodes[0].mechanical and len(nodes) == 2:
                variables += self._across((nodes[0], nodes[1]), of_place=False)
            else:
                for node in nodes:
                    variables += self._across((node,), of_place=False)
        leaf = self.flat.expanded.leaves.get(component)
        for name in (leaf.component.signals if leaf else {}):
            index = self.flat.names.get(f"{component}.{name}")
            if index is not None and self.flat.unknowns[index].name in self.signals:
                unknown = self.flat.unknowns[index]
                variables.append(self._variable("signal", f"signal {component}.{name}", f"{component}.{name}",
                                                unknown.unit.text,
                                                self.signals[unknown.name]))
        return variables
