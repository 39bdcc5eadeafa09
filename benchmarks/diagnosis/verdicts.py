"""Intervals of shares."""

from __future__ import annotations


def interval(k: int, n: int) -> tuple[float, float]:
    """The 95 % interval of a share of which k of n were seen (C. J. Clopper, E. S. Pearson, 1934,
    doi:10.1093/biomet/26.4.404).
    """
    from scipy.special import betaincinv

    return (float(betaincinv(k, n - k + 1, 0.025)) if k else 0.0, float(betaincinv(k + 1, n - k, 0.975)) if k < n else 1.0)
