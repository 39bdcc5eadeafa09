"""The estimated states and parameters of a record, with the tests of the innovations."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from heavebond.core.errors import NAMES_LISTED, Problem, UsageError, suggest
from heavebond.core.presentation import brief, number
from heavebond.numerics.dae import Array
from heavebond.records.metrics import whiteness
from heavebond.records.signal_array import Signal

if TYPE_CHECKING:
    import pandas as pd

LEVEL = 0.05  # significance of the tests of the innovations


@dataclass(frozen=True)
class Consistency:
    """Tests of the innovations, in standard deviations that the filter predicts.

    nis: sum of their squares (normalised innovation squared); samples: their number, which is the degrees of freedom of the
    chi-square distribution of `nis` if the model and the stated noise are right; low, high: the interval of that
    distribution with 95 % probability; white: the p value of the Ljung-Box test for each channel (nan for too few samples).

    Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, Wiley 2001, section
    5.4.
    """

    nis: float
    samples: int
    low: float
    high: float
    white: Mapping[str, float]

    @classmethod
    def of(cls, innovations: Mapping[str, Array]) -> Consistency:
        """The tests for innovations (n,) of each channel; samples that were not taken are nan."""
        from scipy.special import chdtri

        sampled = {name: v[np.isfinite(v)] for name, v in innovations.items()}
        count = sum(len(v) for v in sampled.values())
        low, high = (float(chdtri(count, share)) if count else math.nan for share in (1 - LEVEL / 2, LEVEL / 2))
        return cls(sum(float(v @ v) for v in sampled.values()), count, low, high,
                   {name: whiteness(v) for name, v in sampled.items()})

    @property
    def consistent(self) -> bool:
        """True if `nis` is within its bounds and no channel is significantly correlated in time (5 %, Bonferroni)."""
        return self.low <= self.nis <= self.high and all(not p < LEVEL / len(self.white) for p in self.white.values())

    @property
    def words(self) -> str:
        """The tests as a sentence."""
        per = self.nis / self.samples if self.samples else math.nan
        low, high = (number(end / self.samples, 4) if self.samples else "" for end in (self.low, self.high))
        coloured = [name for name, p in self.white.items() if p < LEVEL / len(self.white)]
        return f"NIS per sample {number(per, 4)}, 95 % bounds {low} .. {high}; " + (
            f"correlated in time: {', '.join(coloured)}" if coloured else "white")

    def as_dict(self) -> dict[str, object]:
        """The tests as plain values."""
        return {"nis": self.nis, "samples": self.samples, "low": self.low, "high": self.high, "white_p": dict(self.white),
                "consistent": self.consistent}


@dataclass(frozen=True, eq=False)
class StateEstimate:
    """States and parameters of a record at its samples, by an estimator.

    time (N,) in s; values, deviations (N,) by name: the estimate of each state and estimated parameter with its standard
    deviation, in SI; units of these; predicted (N,) by channel: the output before its sample is used (of the moving horizon
    estimator: with the final estimate), measured (N,), both in SI, nan where a channel was not sampled; innovations (N,) by
    channel, white with unit variance if the model is right (of the moving horizon estimator: the residuals over their
    noise); steps: steps of the integration between two samples.
    """

    name: str
    time: Array
    values: Mapping[str, Array]
    deviations: Mapping[str, Array]
    units: Mapping[str, str]
    predicted: Mapping[str, Array]
    measured: Mapping[str, Array]
    innovations: Mapping[str, Array]
    steps: int
    notes: tuple[str, ...] = field(default=())

    def __repr__(self) -> str:
        return brief(self, self.name, f"{len(self.time)} samples of {', '.join(self.values)}", self.consistency.words)

    def __getitem__(self, name: str) -> Signal:
        """The estimate of a state or parameter (SI)."""
        return Signal(self._known(name, self.values), self.units[name], time=self.time, name=name)

    def deviation(self, name: str) -> Signal:
        """The standard deviation of an estimate (SI)."""
        return Signal(self._known(name, self.deviations), self.units[name], time=self.time, name=name)

    def _known(self, name: str, values: Mapping[str, Array]) -> Array:
        if name not in values:
            raise UsageError([Problem("estimate-unknown", f"'{name}' was not estimated", None,
                                      suggest(name, values) or NAMES_LISTED)])
        return values[name]

    @property
    def consistency(self) -> Consistency:
        """The tests of the innovations."""
        return Consistency.of(self.innovations)

    def to_pandas(self) -> pd.DataFrame:
        """A table over time (index): each estimate (SI), its standard deviation (`NAME std`) and the innovations
        (`NAME innovation`)."""
        import pandas as pd

        columns = {**self.values, **{f"{name} std": v for name, v in self.deviations.items()},
                   **{f"{name} innovation": v for name, v in self.innovations.items()}}
        return pd.DataFrame(columns, index=pd.Index(self.time, name="time"))
