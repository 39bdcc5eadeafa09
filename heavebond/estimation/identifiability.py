"""Practical identifiability: parameter combinations that the data do not determine, with a text for each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from heavebond.core.errors import listing
from heavebond.numerics.dae import Array


@dataclass(frozen=True)
class IdentifiabilityConstants:
    """The constants of the report on identifiability.

    max_deviation: standard deviation, of a logarithm or over the range, above which a combination of parameters is not
    identifiable. Origin: 30 %. Doubled: fewer combinations are named.
    unknown_deviation: standard deviation of a logarithm above which no value is reported. Origin: a factor of a hundred.
    Doubled: useless values are reported.
    min_share: component of a direction, over its largest, below which it is omitted from the text. Origin: readability.
    Doubled: shorter texts.
    """

    max_deviation: float = 0.3
    unknown_deviation: float = 4.6
    min_share: float = 0.15


IDENTIFIABILITY = IdentifiabilityConstants()


@dataclass(frozen=True)
class Identifiability:
    """Combinations of parameters, the best determined first.

    `deviations` (m,) are the standard deviations along the `directions` (m, n_parameters), in logarithms of parameters
    above zero and in shares of the range of the others; `words` has a sentence for each combination that is not
    identifiable.
    """

    names: tuple[str, ...]
    deviations: Array
    directions: Array
    words: tuple[str, ...]

    @property
    def unseen(self) -> Array:
        """The directions that are not identifiable (k, n_parameters)."""
        return self.directions[self.deviations > IDENTIFIABILITY.max_deviation]

    @property
    def unseen_names(self) -> set[str]:
        """The parameters in directions that the data do not determine."""
        shares = [np.abs(direction) for direction in self.unseen]
        return {name for share in shares for name, component in zip(self.names, share, strict=True)
                if component > IDENTIFIABILITY.min_share * share.max()}


def identifiability(jacobian: Array, names: Sequence[str], logarithmic: Sequence[bool]) -> Identifiability:
    """Singular values of the noise-weighted Jacobian (n, m) in relative parameters; see `Identifiability`.

    The standard deviation along a right singular vector is 1 / singular value (the Cramer-Rao bound).
    """
    _, values, directions = np.linalg.svd(jacobian, full_matrices=False)
    deviations = 1 / np.maximum(values, 1e-300)
    words = [_words(direction, deviation, names, logarithmic)
             for direction, deviation in zip(directions, deviations, strict=True)
             if deviation > IDENTIFIABILITY.max_deviation]
    return Identifiability(tuple(names), deviations, directions, tuple(words))


def _words(direction: Array, deviation: float, names: Sequence[str], logarithmic: Sequence[bool]) -> str:
    share = np.abs(direction)
    chosen = [k for k in np.argsort(-share) if share[k] > IDENTIFIABILITY.min_share * share.max()]
    involved = [names[k] for k in sorted(chosen)]
    relative = all(logarithmic[k] for k in chosen)
    certainty = "not identifiable" if deviation > (IDENTIFIABILITY.unknown_deviation if relative else 1e3) else \
        f"seen to a factor of {np.exp(deviation):.2g} only" if relative else \
        f"seen to {100 * deviation:.2g} % of the range only"
    if len(chosen) == 1:
        return f"{involved[0]} is {certainty}."
    equal = share[chosen].min() > 0.85 * share.max() and all(logarithmic[k] for k in chosen)
    signs = np.sign(direction[sorted(chosen)])
    if equal and abs(signs.sum()) == len(signs):
        return f"Only the ratios between {listing(involved)} are determined: multiplying all of them by one " \
               f"factor does not change the simulated records (their common factor is {certainty})."
    if equal and len(chosen) == 2:
        return f"Only the product {involved[0]} * {involved[1]} is determined: multiplying one and dividing the " \
               f"other by a factor does not change the simulated records (their ratio is {certainty})."
    parts = ", ".join(f"{names[k]} by {10 * direction[k] / share.max():+.2g} %" for k in sorted(chosen))
    return f"{listing(involved)} are strongly correlated: changing them together ({parts}) hardly changes the simulated " \
           f"records (that combination is {certainty})."
