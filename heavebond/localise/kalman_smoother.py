"""Kalman filter and smoother for an unknown input, vectorised over places and intensities.

The state is s = (dx, w): the deviation of a machine from a run and one unknown input as a random walk, w(t + h) = w(t) +
e, e ~ N(0, r h), which acts on dx as a line between the samples. The measured errors have unit noise. Parameters q are
regressors: every quantity is linear in them, x = x_0 + X q, innovations e = e_0 + E q with variances S that do not depend on
q, so that columns for each parameter pass with the data through the same gains, and

    -2 log L(q) = sum_i (log(2 pi S_i) + (e_0i + E_i q)^2 / S_i).

A larger intensity is penalised by larger S. Channels are processed one after another, so that no matrix is inverted; the
backward pass has the form of Bryson and Frazier, which needs no inverse either. P. de Jong, The diffuse Kalman filter, 1991,
doi:10.1214/aos/1176348139; G. J. Bierman, Fixed interval smoothing with discrete measurements, Int. J. Control 18 (1973)
65-75, doi:10.1080/00207177308932487.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from heavebond.equations.places import Place
from heavebond.localise import compiled_kalman
from heavebond.localise.constants import INPUT_ESTIMATION
from heavebond.localise.ltv_model import LtvModel
from heavebond.numerics.dae import Array


@dataclass(frozen=True)
class Likelihood:
    """-2 log L(q) = constant + 2 slope q + q curvature q for each of G places: (G,), (G, k), (G, k, k)."""

    constant: Array
    slope: Array
    curvature: Array


@dataclass(frozen=True)
class Smoothed:
    """For G places, each quantity as [at q = 0, per unit of each q] in its last axis (1+k): w (N, G, 1+k) in SI, the states
    (N, G, n, 1+k) and the remaining errors (N, G, m, 1+k); the standard deviation of w (N, G)."""

    w: Array
    deviation: Array
    state: Array
    left: Array

    def at(self, place: int, q: Array) -> tuple[Array, Array, Array]:
        """w (N,), states (N, n) and remaining errors (N, m) at one place with parameters q (k,)."""
        full = np.concatenate([[1.0], q])
        return self.w[:, place] @ full, self.state[:, place] @ full, self.left[:, place] @ full


class Unknown:
    """An unknown input at one place each, in sizes (G,) of that place, in the linear system of a record."""

    def __init__(self, system: LtvModel, nodes: Sequence[str], places: Sequence[Place], sizes: Array):
        self.system, self.sizes = system, sizes
        self.n, self.k = system.phi.shape[1], len(system.centre)
        weights = np.zeros((len(nodes), len(places)))
        for g, place in enumerate(places):
            for node, weight in place.weights.items():
                weights[nodes.index(node), g] = weight * sizes[g]
        self.gamma = np.swapaxes(system.gamma @ weights, 1, 2)  # (N-1, G, n)
        self.d = np.swapaxes(system.d @ weights, 1, 2)  # (N, G, m)
        # the run was made with `driven`: what is asked for is the whole input, not its deviation
        between = (system.driven[:-1] + system.driven[1:]) / 2
        shift = -np.einsum("knj,kj->kn", system.gamma, between)
        self.moved = np.concatenate([shift[:, :, None], system.phi[:, :, self.n:]], axis=2)  # (N-1, n, 1+k)
        error = system.error + np.einsum("kmj,kj->km", system.d, system.driven)
        self.error = np.concatenate([error[:, :, None], -system.c[:, :, self.n:]], axis=2)  # (N, m, 1+k)

    def _first(self) -> tuple[Array, Array]:
        """The state at the first sample: the start depends on the parameters; w is unknown."""
        n, count = self.n, len(self.sizes)
        x = np.zeros((count, n + 1, 1 + self.k))
        x[:, :n, 1:] = self.system.start
        p = np.zeros((count, n + 1, n + 1))
        p[:, range(n), range(n)] = self.system.start_deviation**2
        return x, p

    def filtered(self, intensity: Array, keep: _FilterPass | None = None) -> Likelihood:
        """One forward pass with `intensity` (G,), per second, of each place; an intensity of 0 means no input."""
        n = self.n
        x, p = self._first()
        p[:, -1, -1] = np.where(intensity > 0, INPUT_ESTIMATION.first_input**2, 0.0)
        squares, constant = np.zeros((len(x), 1 + self.k, 1 + self.k)), np.zeros(len(x))
        if compiled_kalman.serves(self.n):
            compiled_kalman.run("filter", **self._program_inputs(intensity), x=x, p=p, constant=constant, squares=squares,
                                **(keep.arrays if keep is not None else {}))
            return _likelihood(constant, squares)
        step = np.broadcast_to(np.eye(n + 1), p.shape).copy()
        noise, rows = np.ones(x.shape[:2]), np.zeros(x.shape[:2])
        h = np.diff(self.system.time)
        for i in range(len(self.system.time)):
            if i:
                step[:, :n, :n], step[:, :n, -1] = self.system.phi[i - 1, :, :n], self.gamma[i - 1]
                noise[:, :n] = self.gamma[i - 1] / 2
                x = step @ x
                x[:, :n] += self.moved[i - 1]
                p = step @ p @ np.swapaxes(step, 1, 2)
                p += (intensity * h[i - 1])[:, None, None] * (noise[:, :, None] * noise[:, None, :])
            for c in range(self.error.shape[1]):
                rows[:, :n], rows[:, -1] = self.system.c[i, c, :n], self.d[i, :, c]
                towards = (p @ rows[:, :, None])[:, :, 0]
                variance = (rows * towards).sum(axis=1) + 1.0
                wrong = self.error[i, c] - (rows[:, None, :] @ x)[:, 0]
                gain = towards / variance[:, None]
                x = x + gain[:, :, None] * wrong[:, None, :]
                # as P. D. Joseph writes it, (I - K c) P (I - K c)' + K K': P stays a covariance where an input is so free,
                # or a state so far from any sample, that the shorter form leaves nothing but rounding
                p = p - gain[:, :, None] * towards[:, None, :]
                p = p + (gain - (p @ rows[:, :, None])[:, :, 0])[:, :, None] * gain[:, None, :]
                # rounding may still leave no covariance, in a model whose states run away: such an input is no explanation
                constant += np.log(2 * np.pi * np.where(variance > 0, variance, np.inf))
                scaled = wrong / variance[:, None]
                squares += scaled[:, :, None] * wrong[:, None, :]
                if keep is not None:
                    keep.update(i, c, rows, gain, scaled, 1 / variance)
            if keep is not None:
                keep.state(i, x, p)
        return _likelihood(constant, squares)

    def _program_inputs(self, intensity: Array) -> dict[str, Array]:
        """The input of the compiled program."""
        arguments = {"phi": self.system.phi, "c": self.system.c, "gamma": self.gamma, "d": self.d, "moved": self.moved,
                     "error": self.error, "growth": intensity * np.diff(self.system.time)[:, None]}
        return {name: np.ascontiguousarray(values, float) for name, values in arguments.items()}

    def smoothed(self, intensity: Array) -> Smoothed:
        """Forward and backward pass: the best estimate of all quantities at every sample from the whole record."""
        count, m, n = len(self.system.time), self.error.shape[1], self.n
        filtered = _FilterPass(count, m, len(self.sizes), n + 1, 1 + self.k)
        self.filtered(intensity, filtered)
        states, variance = np.empty_like(filtered.x), np.empty(filtered.x.shape[:2])
        if compiled_kalman.serves(self.n):
            compiled_kalman.run("smooth", **self._program_inputs(intensity), **filtered.arrays, states=states,
                                variance=variance)
        else:
            self._back(filtered, states, variance)
        w = states[:, :, -1]
        predicted = np.einsum("kmj,kgjq->kgmq", self.system.c[:, :, :n], states[:, :, :n]) + self.d[:, :, :, None] * w[:, :,
                                                                                                                       None]
        return Smoothed(w * self.sizes[:, None], np.sqrt(np.maximum(variance, 0)) * self.sizes, states[:, :, :n],
                        self.error[:, None] - predicted)

    def _back(self, filtered: _FilterPass, states: Array, variance: Array) -> None:
        """Write the states (N, G, n+1, 1+k) and the variance of w (N, G) from the results of a filter."""
        count, m, n = len(self.system.time), self.error.shape[1], self.n
        adjoint = np.zeros(filtered.x.shape[1:])
        information = np.zeros(filtered.p.shape[1:])
        step = np.broadcast_to(np.eye(n + 1), information.shape).copy()
        for i in range(count - 1, -1, -1):
            p = filtered.p[i]
            states[i] = filtered.x[i] - p @ adjoint
            last = p[:, -1, :]
            variance[i] = last[:, -1] - np.einsum("gi,gij,gj->g", last, information, last)
            for c in range(m - 1, -1, -1):
                row, gain = filtered.rows[i, c], filtered.gain[i, c]
                through = (gain[:, None, :] @ adjoint)[:, 0]
                adjoint = adjoint - row[:, :, None] * (filtered.wrong[i, c] + through)[:, None, :]
                turned = (information @ gain[:, :, None])[:, :, 0]
                size = (gain * turned).sum(axis=1) + filtered.weight[i, c]
                cross = row[:, :, None] * turned[:, None, :]
                information = information - cross - np.swapaxes(cross, 1, 2) \
                    + size[:, None, None] * (row[:, :, None] * row[:, None, :])
            if i:
                step[:, :n, :n], step[:, :n, -1] = self.system.phi[i - 1, :, :n], self.gamma[i - 1]
                back = np.swapaxes(step, 1, 2)
                adjoint = back @ adjoint
                information = back @ information @ step

    def innovations(self, inputs: Array) -> Array:
        """Innovations over their standard deviations (N, m, 1+k+K) of the data, per unit of each parameter and of each of
        the `inputs` (N, K) in SI at the first place, where nothing but these acts: with inputs a (K,) and parameters q they
        are e[..., 0] + e[..., 1:] @ (q, a)."""
        filtering = self.system.whitening
        first = np.concatenate([np.zeros((self.n, 1)), self.system.start], axis=1)
        gamma, d = self.gamma[:, 0] / self.sizes[0], self.d[:, 0] / self.sizes[0]
        return np.concatenate([filtering.innovations(self.error, first, self.moved),
                               filtering.responses(inputs, gamma, d)], axis=2)


def _likelihood(constant: Array, squares: Array) -> Likelihood:
    return Likelihood(constant + squares[:, 0, 0], squares[:, 0, 1:], squares[:, 1:, 1:])


class _FilterPass:
    """The results of a filter for the backward pass."""

    def __init__(self, count: int, m: int, places: int, size: int, columns: int):
        self.x, self.p = np.empty((count, places, size, columns)), np.empty((count, places, size, size))
        self.rows, self.gain = np.empty((count, m, places, size)), np.empty((count, m, places, size))
        self.wrong, self.weight = np.empty((count, m, places, columns)), np.empty((count, m, places))

    @property
    def arrays(self) -> dict[str, Array]:
        """The arrays by their names in the compiled program."""
        return {"all_x": self.x, "all_p": self.p, "rows": self.rows, "gains": self.gain, "wrong": self.wrong,
                "weight": self.weight}

    def update(self, i: int, c: int, rows: Array, gain: Array, wrong: Array, weight: Array) -> None:
        self.rows[i, c], self.gain[i, c], self.wrong[i, c], self.weight[i, c] = rows, gain, wrong, weight

    def state(self, i: int, x: Array, p: Array) -> None:
        self.x[i], self.p[i] = x, p
