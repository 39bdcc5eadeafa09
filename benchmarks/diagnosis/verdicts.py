"""What the diagnosis said in the cases of the calibration study, against what was hidden."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

Row = Mapping[str, Any]
UNNAMED = ("shape", "undetermined")
RIGHT, NONE, MISSED, WRONG = "right", "no name", "missed", "wrong"


def outcome(row: Row) -> str:
    """right: what was hidden is in the set that the answer names, or the answer says rightly that it is nothing, parameters
    or no law of the catalogue; no name: something is missing, and nothing is named; missed: an effect or a wrong value is
    said to be nothing; wrong: the set leaves out what was hidden. Where nothing was hidden but free parameters, each answer
    but nothing and parameters is wrong: a false alarm."""
    hidden, said = row["hidden"], row["verdict"]
    if hidden in ("nothing", "free"):
        return RIGHT if said in ("nothing", "parameters") else WRONG
    if said == "nothing":
        return MISSED
    if hidden == "outside":
        return RIGHT if said in UNNAMED else WRONG
    if hidden == "fixed":
        # a value that explains as much is told beside an effect
        told = said == "parameters" or row["right"] or any(f"{row['label']} at" in line for line in row["words"])
        return RIGHT if told else NONE if said in UNNAMED else WRONG
    return NONE if said in UNNAMED else RIGHT if row["right"] else WRONG


def interval(k: int, n: int) -> tuple[float, float]:
    """The 95 % interval of a share of which k of n were seen (C. J. Clopper, E. S. Pearson, 1934,
    doi:10.1093/biomet/26.4.404).
    """
    from scipy.special import betaincinv

    return (float(betaincinv(k, n - k + 1, 0.025)) if k else 0.0, float(betaincinv(k + 1, n - k, 0.975)) if k < n else 1.0)
