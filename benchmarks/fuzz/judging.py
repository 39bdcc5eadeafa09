"""What becomes of one diagram, and whether that may be."""

from __future__ import annotations

import time
import traceback
from dataclasses import asdict, dataclass

import casadi as ca
import numpy as np

import heavebond as hb
from benchmarks.fuzz.diagrams import OWN
from heavebond.core.errors import HeavebondError
from heavebond.language.model import loads
from heavebond.language.symbols import split, stack
from heavebond.numerics.dae import Array
from heavebond.numerics.result import Result, columns

# an energy that does not close to this share at the usual tolerances is looked at again with tighter ones
OPEN = 1e-5
# by which a hundredth of the tolerances must make it smaller: an undamped circuit keeps IDAS at low orders over thousands of
# swings, a law that is wrong stays as it is
CLOSER = 4
# the equations of the diagram themselves must hold along the run to this share of their terms
WRONG = 1e-6
# a diagram at rest has but the rounding of its numbers, in J
NOTHING = 1e-9
# share by which states, algebraic unknowns and parameters are rounded, and with them what is computed from them
ROUNDING = 64 * float(np.finfo(float).eps)
# of the usual size of an unknown, added to its terms; of its rates, which are differences of large forces by small masses
SMALL, SMALL_RATE = 1e-3, 0.1


@dataclass(frozen=True)
class Verdict:
    """`outcome`: refused (with the codes), ran, long (see `campaign.patiently`), or one of the FAULTS; `what` it was, and
    the `seconds` of processor time that it took."""

    seed: int
    outcome: str
    what: str
    seconds: float

    def as_dict(self) -> dict[str, object]:
        """For a line of JSON."""
        return asdict(self)


FAULTS = ("traceback", "hang", "no advice", "equation", "energy")


def judge(seed: int, text: str) -> Verdict:
    """Read, check and run a diagram, and account for its energy."""
    began = time.process_time()
    try:
        outcome, what = _judged(text)
    except HeavebondError as error:
        outcome, what = "refused", " ".join(sorted({p.code for p in error.problems}))
        silent = [p for p in error.problems if not p.hint.strip() or not p.message.strip()]
        if silent or not error.problems:
            outcome, what = "no advice", str(error)
    except Exception:
        outcome, what = "traceback", traceback.format_exc(limit=-6)
    return Verdict(seed, outcome, what, time.process_time() - began)


def _judged(text: str) -> tuple[str, str]:
    assembly = hb.assemble(loads(text, OWN))
    audit = hb.energy(assembly)
    wrong, equation = violation(audit.result)
    if wrong > WRONG:
        return "equation", f"{equation} is off by {wrong:.2g} of its terms"
    worst = max(audit.imbalance, audit.nodes)
    if worst > OPEN and audit.largest > NOTHING:
        audit = hb.energy(assembly, rtol=1e-11, atol=1e-13)
        if max(audit.imbalance, audit.nodes) > max(OPEN, worst / CLOSER):
            return "energy", f"{audit.imbalance:.2g} of {audit.largest:.3g} J, nodes {audit.nodes:.2g}"
    return "ran", f"{worst:.1e}"


def violation(result: Result) -> tuple[float, str]:
    """How far the equations of the diagram, as written, are from holding along a run: the largest residual over the sum of
    the sizes of its terms (each unknown's share), and the text of that equation. Rates come from the reduced model. What
    rounding does to a residual is taken off: a contact of 500 kN holds 0.2 g in place to 1e-5 m/s**2 and no better."""
    assembly, flat = result.assembly, result.assembly.flat
    known = {s.element_hash() for s in split(assembly.reduced.symbols)}
    known |= {s.element_hash() for a in assembly.arguments for s in split(a)}
    rows = [k for k, r in enumerate(flat.residuals) if {s.element_hash() for s in ca.symvar(r)} <= known]
    if not rows:
        return 0.0, ""
    residuals = stack([flat.residuals[k] for k in rows])
    symbols = ca.symvar(residuals)
    usual = {s.element_hash(): (SMALL_RATE if order else SMALL) * u.nominal for order, level in enumerate(flat.levels)
             for s, u in zip(level, flat.unknowns, strict=True)}
    terms = stack([ca.fabs(s) + usual.get(s.element_hash(), 0.0) for s in symbols])
    slopes = ca.fabs(ca.jacobian(residuals, stack(symbols))) if symbols else ca.SX(len(rows), 0)
    inner, values = stack(assembly.arguments[1:4]), assembly.express(stack(symbols))  # x, z, p
    rounded = ROUNDING * assembly.express(slopes) @ (ca.fabs(ca.jacobian(values, inner)) @ ca.fabs(inner))
    both = ca.Function("both", list(assembly.arguments),
                       [assembly.express(residuals), assembly.express(slopes @ terms), rounded])
    off, sizes, least = (np.array(v) for v in both.map(len(result.time))(*columns(result)))
    share = _share(np.maximum(np.abs(off) - np.where(np.isfinite(least), least, 0.0), 0.0), sizes)
    k = int(np.argmax(share.max(axis=1)))
    return float(share.max()), flat.equations[rows[k]].text


def _share(off: Array, terms: Array) -> Array:
    """|residual| over the largest size that its terms have during the run."""
    size = np.nanmax(np.where(np.isfinite(terms), terms, 0.0), axis=1, keepdims=True)
    return np.asarray(np.where(np.isfinite(off), np.abs(off), np.inf) / np.maximum(size, 1e-12))
