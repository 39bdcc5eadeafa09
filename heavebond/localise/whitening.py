"""The Kalman filter of a linear system as linear maps of its errors, for many inputs at once.

Gains and variances do not depend on the data. They are computed once for a system; the innovations for any number of
inputs are then one recursion of products,

    v_i = W_i (e_i - C_i x_i),      x_(i+1) = A_i x_i + B_i e_i + u_i,

with e (N, m) the errors, x the predicted states, u their further inputs, W_i the inverse of the lower triangular root of
the variance of e_i - C_i x_i (unit noise), and v the innovations over their standard deviations, channel after channel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from heavebond.localise import compiled_kalman
from heavebond.numerics.dae import Array


@dataclass(frozen=True)
class Whitening:
    """The maps of a system of n states and m channels over N samples: `by_state` (N, m, n), `by_error` (N, m, m) to v;
    `step` (N-1, n, n), `gain` (N-1, n, m) to the next x."""

    by_state: Array
    by_error: Array
    step: Array
    gain: Array

    @classmethod
    def of(cls, phi: Array, c: Array, deviation: Array) -> Whitening:
        """The maps for transitions phi (N-1, n, n), rows c (N, m, n) and independent states of this `deviation` (n,) at
        the start."""
        (count, m, n), p = c.shape, np.diag(deviation**2)
        by_state, by_error = np.zeros((count, m, n)), np.zeros((count, m, m))
        steps, gains = np.empty((count - 1, n, n)), np.empty((count - 1, n, m))
        for i in range(count):
            keeps, takes = np.eye(n), np.zeros((n, m))  # x after the sample by that before, and by e
            for k, row in enumerate(c[i]):
                towards = p @ row
                variance = float(row @ towards) + 1.0
                if not variance > 0:  # rounding has left no covariance, and the sample tells nothing
                    continue
                error = -row @ takes
                error[k] += 1.0
                state = -row @ keeps
                gain, size = towards / variance, np.sqrt(variance)
                by_state[i, k], by_error[i, k] = state / size, error / size
                keeps += gain[:, None] * state
                takes += gain[:, None] * error
                # the form of P. D. Joseph, by which P stays a covariance
                p = p - gain[:, None] * towards
                p = p + (gain - p @ row)[:, None] * gain
            if i < count - 1:
                steps[i], gains[i], p = phi[i] @ keeps, phi[i] @ takes, phi[i] @ p @ phi[i].T
        return cls(by_state, by_error, steps, gains)

    def innovations(self, error: Array, first: Array, driven: Array) -> Array:
        """v (N, m, K) of errors (N, m, K), from the states first (n, K), with driven (N-1, n, K) = u."""
        driven_states = self.gain @ error[:-1] + driven
        states = np.empty((len(error), *first.shape))
        states[0] = x = first
        for i, (step, more) in enumerate(zip(self.step, driven_states, strict=True), 1):
            states[i] = x = step @ x + more
        return np.asarray(self.by_error @ error + self.by_state @ states)

    def responses(self, inputs: Array, gamma: Array, d: Array, means: Array | None = None) -> Array:
        """v (N, m, K) of inputs (N, K) from rest that act as u = gamma (N-1, n) times their mean over a step, and as -d (N,
        m) on the errors: one product a sample, of [v_i; x_(i+1)] from [x_i; input_i; mean_i]. The `means` (N-1, K) over the
        steps default to the means of their ends."""
        (count, m, n), width = self.by_state.shape, inputs.shape[1]
        means = (inputs[1:] + inputs[:-1]) / 2 if means is None else means
        maps = np.zeros((count, m + n, n + 2))
        maps[:, :m, :n], maps[:, :m, n] = self.by_state, -(self.by_error @ d[:, :, None])[:, :, 0]
        maps[:-1, m:, :n], maps[:-1, m:, n + 1] = self.step, gamma
        maps[:-1, m:, n] = -(self.gain @ d[:-1, :, None])[:, :, 0]
        if compiled_kalman.program() is not None:
            return compiled_kalman.responses(maps, inputs, means, m)
        arguments, products, response = np.zeros((n + 2, width)), np.empty((m + n, width)), np.empty((count, m, width))
        for i in range(count):
            arguments[n], arguments[n + 1] = inputs[i], means[min(i, count - 2)]
            np.matmul(maps[i], arguments, out=products)
            response[i], arguments[:n] = products[:m], products[m:]
        return response
