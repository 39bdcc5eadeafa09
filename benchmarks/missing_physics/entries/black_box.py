"""Black boxes for the error on the scored record: NARX models (scikit-learn), simulated freely. They name nothing.

Each channel is a function of the last values of all inputs and channels. A polynomial of second degree with ridge
regression, a neural network and a Gaussian process are trained; the one that predicts the last fifth of the training records
best in a free simulation is taken. A second family predicts the residual of the fitted base model from the inputs and its
channels.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
from sklearn.linear_model import Ridge
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler

from benchmarks.missing_physics.entries.refitting import scored_record
from benchmarks.missing_physics.reading import Array, Case, Record
from benchmarks.missing_physics.scoring import predictions_of
from benchmarks.missing_physics.simulation import Simulation

NAME, NEEDS = "black boxes (NARX, GP)", ("sklearn", "scipy")
LAGS = (2, 4)
POINTS = 600  # of a Gaussian process
MODELS: Mapping[str, Callable[[], Any]] = {
    "polynomial": lambda: make_pipeline(StandardScaler(), PolynomialFeatures(2), Ridge(1e-4)),
    "line": lambda: make_pipeline(StandardScaler(), Ridge(1e-6)),
    "network": lambda: make_pipeline(StandardScaler(), MLPRegressor(
        hidden_layer_sizes=(24, 24), alpha=1e-4, max_iter=300, random_state=1)),
    "process": lambda: make_pipeline(StandardScaler(), GaussianProcessRegressor(
        ConstantKernel(1.0) * RBF(3.0) + WhiteKernel(1e-3), normalize_y=True, random_state=1))}


class Narx:
    """Models of the steps of all channels (N, channels) from inputs (N, inputs) and their own last values."""

    def __init__(self, make: Callable[[], Any], lags: int, thin: bool):
        self.make, self.lags, self.thin = make, lags, thin

    def _row(self, u: Array, y: Array, k: int) -> Array:
        return np.concatenate([u[k - self.lags:k + 1].ravel(), y[k - self.lags:k].ravel()])

    def fit(self, records: Sequence[tuple[Array, Array]]) -> None:
        """Learn the step from one sample to the next."""
        rows = np.array([self._row(u, y, k) for u, y in records for k in range(self.lags, len(u))])
        steps = np.concatenate([np.diff(y, axis=0)[self.lags - 1:] for _, y in records])
        if self.thin and len(rows) > POINTS:
            kept = np.linspace(0, len(rows) - 1, POINTS).astype(int)
            rows, steps = rows[kept], steps[kept]
        self.size = np.where(steps.std(axis=0) > 0, steps.std(axis=0), 1.0)
        self.model = self.make().fit(rows, steps / self.size)

    def simulate(self, u: Array, first: Array) -> Array:
        """A free run from the first values (lags, channels)."""
        y = np.zeros((len(u), first.shape[1]))
        y[:self.lags] = first
        for k in range(self.lags, len(u)):
            step = np.reshape(self.model.predict(self._row(u, y, k)[None]), -1) * self.size
            y[k] = y[k - 1] + step
            if not np.all(np.isfinite(y[k])) or np.abs(y[k]).max() > 1e6:
                return np.full_like(y, np.inf)
        return y


def _scaled(case: Case) -> tuple[list[Record], Array, Array]:
    """The training records, and mean and deviation of the channels in them."""
    train = [r for r in case.records.values() if r.use != "score"]
    y = np.concatenate([np.column_stack(list(r.outputs.values())) for r in train])
    return train, y.mean(axis=0), np.where(y.std(axis=0) > 0, y.std(axis=0), 1.0)


def answer(case: Case) -> dict[str, Any]:
    """The predictions of the best black box, alone or on the residual of the base model."""
    warnings.simplefilter("ignore")
    train, mean, deviation = _scaled(case)
    scored, simulation = scored_record(case), Simulation(case)
    base = simulation.fitted()
    noise = np.array([c["noise"] for c in case.outputs.values()]) / deviation
    start = simulation.channels(scored, base.parameters)
    based = {r.name: np.column_stack(list((simulation.channels(r, base.parameters) or {}).values())) for r in train}
    inputs = {r.name: np.column_stack([(u - u.mean()) / (u.std() or 1) for u in r.inputs.values()])
              for r in (*train, scored)}
    trials: list[tuple[float, str, Array]] = []
    residual_scale = 1.0
    for kind in ("alone", "on the residual"):
        data: list[tuple[Array, Array]] = []
        scored_data = inputs[scored.name]
        for r in train:
            y = (np.column_stack(list(r.outputs.values())) - mean) / deviation
            u = inputs[r.name]
            if kind != "alone":
                prior = (based[r.name] - mean) / deviation
                residual_scale = residual_scale if data else max(float(np.std(y - prior)), 1e-12)
                data.append((np.column_stack([u, prior]), (y - prior) / residual_scale))
            else:
                data.append((u, y))
        prior_scored = np.zeros((len(scored.time), len(mean)))
        if kind != "alone":
            if start is None:
                continue
            prior_scored = (np.column_stack(list(start.values())) - mean) / deviation
            scored_data = np.column_stack([scored_data, prior_scored])
        factor = residual_scale if kind != "alone" else 1.0
        for name, make in MODELS.items():
            for lags in LAGS:
                cut = [max(int(0.8 * len(u)), lags + 2) for u, _ in data]
                narx = Narx(make, lags, name == "process")
                narx.fit([(u[:n], y[:n]) for (u, y), n in zip(data, cut, strict=True)])
                u, y = data[0]
                n = cut[0]
                off = (narx.simulate(u[n - lags:], y[n - lags:n])[lags:] - y[n:]) * factor / noise
                narx.fit(data)
                first = np.zeros((lags, len(mean)))
                if kind == "alone" and start is not None:
                    first = (np.column_stack(list(start.values()))[:lags] - mean) / deviation
                found = narx.simulate(scored_data, first) * factor + prior_scored
                trials.append((float(np.mean(off**2)), f"{name} {kind}, {lags} lags", found))
    usable = [t for t in trials if np.isfinite(t[0]) and np.all(np.isfinite(t[2]))]
    _, words, best = min(usable, key=lambda t: t[0])
    channels = dict(zip(case.outputs, (best * deviation + mean).T, strict=True))
    return {"missing": False, "effects": [], "predictions": predictions_of(scored.name, channels), "words": words}
