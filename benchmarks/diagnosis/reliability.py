"""The constants of the probabilities fitted to the cases of the calibration study, and how reliable they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.diagnosis import keeping
from benchmarks.diagnosis.verdicts import interval as interval_of_share
from heavebond.diagnosis.candidates.fixed_values import VALUE
from heavebond.diagnosis.evidence.probability import (
    NOTHING,
    OTHER,
    OUTSIDE,
    PARAMETERS,
    TEMPERATURES,
    Calibration,
    Event,
    Evidence,
    parts,
    probabilities,
)
from heavebond.numerics.dae import Array
from heavebond.pictures.plot import COLOURS, DPI, RECORD
from heavebond.pictures.plot_sample import SMALL, WIDTH, quiet

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STUDY = "calibration"
# Before any case is seen: each constant but the temperature is log-normal about these values, a factor of e its deviation.
BEFORE = Calibration(0, 4.0, 0.2, 2.0, 5.0, 0.03)
FITTED = ("outside", "excess", "simpler", "lapse")
SIMPLE = {"nothing": NOTHING, "free": PARAMETERS, "fixed": PARAMETERS, "outside": OUTSIDE}  # events of what is hidden
LEAST = 1e-4  # probability below which one is not asked to be right
EDGES = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 1.0)
CREDIBLE = 0.95
DRAWS = 2000
Row = Mapping[str, Any]


@dataclass(frozen=True)
class Reliability:
    """Stated probabilities p (n,) against whether they came true (n,), of all events above 1 % and of the most probable one
    of each case; the Brier score and the mean negative logarithm of the probability of what was hidden; in how many cases
    (0 or 1 for each, n) the most probable events that together have 95 % hold what was hidden, and how many these are."""

    stated: Array
    true: Array
    first: Array
    first_true: Array
    brier: float
    loss: float
    covered: Array
    size: Array


@cache
def known_rows() -> tuple[Row, ...]:
    """The cases of the rules that the last row was made with, that were searched to their end."""
    rows = list(keeping.read(STUDY).values())
    return tuple(r for r in rows if r["rules"] == rows[-1]["rules"] and "evidence" in r and not r["partial"])


def happened(row: Row, events: Sequence[Event]) -> NDArray[np.bool_]:
    """Which of the events (n,) is what was hidden: by what the row says, which effects are; else one of the others."""
    wanted = SIMPLE.get(row["hidden"])
    hit = np.array([wanted is None and bool(event.labels) and event.labels[0] in row["true"] for event in events])
    return hit if hit.any() else np.array([not event.labels and event.kind == (wanted or OTHER) for event in events])


@dataclass(frozen=True)
class Table:
    """The rows (n,) as arrays: what `parts` needs, and at each temperature the weights (n,) of what was hidden, of values
    and of all that is listed."""

    hidden: NDArray[np.str_]
    known: Mapping[str, Array]
    hit: Mapping[float, Array]
    values: Mapping[float, Array]
    listed: Mapping[float, Array]

    @classmethod
    def of(cls, rows: Sequence[Row]) -> Table:
        """The table of rows of the study."""
        evidence = [Evidence.of_dict(r["evidence"]) for r in rows]
        hits = [happened(r, e.effects) if e.effects else np.zeros(0, bool) for r, e in zip(rows, evidence, strict=True)]
        hidden = [SIMPLE.get(r["hidden"]) or ("effect" if any(hit) else OTHER) for r, hit in zip(rows, hits, strict=True)]

        def summed(choose: Sequence[NDArray[np.bool_]]) -> dict[float, Array]:
            return {t: np.array([float(e.weights[t][which].sum()) if e.effects else 0.0
                                 for e, which in zip(evidence, choose, strict=True)]) for t in TEMPERATURES}

        return cls(np.array(hidden), {name: np.array([getattr(e, name) for e in evidence], float)
                                      for name in ("missing", "sheet", "left")}, summed(hits),
                   summed([np.array([x.kind == VALUE for x in e.effects], bool) for e in evidence]),
                   summed([np.ones(len(e.effects), bool) for e in evidence]))

    def losses(self, constants: Calibration) -> Array:
        """The negative logarithms (n,) of the probabilities of what was hidden."""
        t = constants.temperature
        nothing, parameters, outside, among = parts(constants, **self.known)
        found = {NOTHING: nothing, PARAMETERS: parameters + among * self.values[t], OUTSIDE: outside,
                 OTHER: constants.lapse + among * np.maximum(0.0, 1 - self.listed[t]), "effect": among * self.hit[t]}
        p = np.select([self.hidden == what for what in found], list(found.values()))
        return np.asarray(-np.log(np.maximum(p, LEAST)))


def reliability(rows: Sequence[Row], constants: Sequence[Calibration]) -> Reliability:
    """How reliable the probabilities are with the constants that belong to each row."""
    stated, true, first, first_true, brier, loss, covered, size = [], [], [], [], [], [], [], []
    for row, chosen in zip(rows, constants, strict=True):
        events = probabilities(Evidence.of_dict(row["evidence"]), chosen)
        hit, p = happened(row, events), np.array([e.probability for e in events])
        stated += p[p >= 0.01].tolist()
        true += hit[p >= 0.01].tolist()
        first.append(p[0])
        first_true.append(hit[0])
        brier.append(float(np.sum((p - hit) ** 2)))
        loss.append(-np.log(max(p[hit].sum(), LEAST)))
        size.append(int(np.searchsorted(np.cumsum(p), CREDIBLE)) + 1)
        covered.append(hit[:size[-1]].any())
    return Reliability(np.array(stated, float), np.array(true, float), np.array(first, float), np.array(first_true, float),
                       float(np.mean(brier)), float(np.mean(loss)), np.array(covered, float), np.array(size, float))


def fitted(rows: Sequence[Row], temperatures: Sequence[float] = TEMPERATURES[1:]) -> Calibration:
    """The constants with the largest posterior density, the temperature among these."""
    from scipy.optimize import minimize

    middle, table = np.log([getattr(BEFORE, name) for name in FITTED]), Table.of(rows)

    def constants(x: Array, temperature: float) -> Calibration:
        values = np.exp(np.clip(x, middle - 5, middle + 5))
        return replace(BEFORE, cases=len(rows), temperature=temperature, **dict(zip(FITTED, values.tolist(), strict=True)))

    def cost(x: Array, temperature: float) -> float:
        return float(np.sum(table.losses(constants(x, temperature))) + np.sum((x - middle) ** 2) / 2)

    found = [(minimize(cost, middle, (t,), "Nelder-Mead", options={"maxfev": 600, "xatol": 0.01, "fatol": 0.01}), t)
             for t in temperatures]
    best, temperature = min(found, key=lambda pair: float(pair[0].fun))
    return constants(best.x, temperature)


def expected_error(p: Array, true: Array) -> float:
    """The expected calibration error: in bins of the stated probability its distance from the true frequency, weighted."""
    bins = np.clip(np.searchsorted(EDGES, p, side="right") - 1, 0, len(EDGES) - 2)
    return float(sum(abs(p[bins == b].mean() - true[bins == b].mean()) * np.mean(bins == b) for b in np.unique(bins)))


def by_chance(p: Array) -> tuple[float, float]:
    """The expected calibration error of as many events of exactly these probabilities: its mean and 95 % quantile."""
    random = np.random.default_rng(0)
    found = [expected_error(p, (random.random(len(p)) < p).astype(float)) for _ in range(DRAWS)]
    return float(np.mean(found)), float(np.quantile(found, 0.95))


def interval(rows: Sequence[Row], constants: Sequence[Calibration]) -> tuple[float, float]:
    """The 95 % interval of the expected calibration error of the most probable event, by a bootstrap over machines."""
    random, machines = np.random.default_rng(0), sorted({r["machine"] for r in rows})
    each = {m: reliability(*zip(*[(r, c) for r, c in zip(rows, constants, strict=True) if r["machine"] == m], strict=True))
            for m in machines}
    found = []
    for _ in range(DRAWS):
        drawn = [each[m] for m in random.choice(machines, len(machines))]
        found.append(expected_error(np.concatenate([d.first for d in drawn]), np.concatenate([d.first_true for d in drawn])))
    low, high = np.quantile(found, [0.025, 0.975])
    return float(low), float(high)


def left_out(rows: Sequence[Row]) -> list[Calibration]:
    """For each row the constants fitted to all other machines."""
    found = {m: fitted([r for r in rows if r["machine"] != m]) for m in {r["machine"] for r in rows}}
    return [found[r["machine"]] for r in rows]


def figures(rows: Sequence[Row]) -> list[tuple[str, Reliability, tuple[float, float]]]:
    """The figures with the constants fitted to all cases, and to all other machines."""
    own, others = [fitted(rows)] * len(rows), left_out(rows)
    return [(what, reliability(rows, chosen), interval(rows, chosen))
            for what, chosen in (("all cases", own), ("all other machines", others))]


def diagram(rows: Sequence[Row]) -> Figure:
    """The reliability diagram, each machine with the constants fitted to all others: true over stated, 95 % intervals."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    found = reliability(rows, left_out(rows))
    panels = (("most probable explanation of each case", found.first, found.first_true),
              ("all explanations above 1 %", found.stated, found.true))
    with rc_context(SMALL):
        figure = Figure(figsize=(WIDTH, 0.57 * WIDTH), dpi=2 * DPI, layout="constrained")
        for axes, (title, stated, true) in zip(figure.subplots(1, 2, sharey=True), panels, strict=True):
            axes.plot([0, 1], [0, 1], color=RECORD, linewidth=0.8, label="exact")
            bins = np.clip(np.searchsorted(EDGES, stated, side="right") - 1, 0, len(EDGES) - 2)
            for b in np.unique(bins):
                of = bins == b
                n, k, p = int(of.sum()), int(true[of].sum()), float(stated[of].mean())
                low, high = interval_of_share(k, n)
                axes.errorbar(p, k / n, [[k / n - low], [high - k / n]], fmt="o", color=COLOURS[0], capsize=2, markersize=4)
                axes.annotate(f"{n}", (p, low), (0, -8), textcoords="offset points", color=RECORD, ha="center", fontsize=6)
            axes.set(title=title, xlabel="stated probability", xlim=(-0.02, 1.02), ylim=(-0.06, 1.02), aspect="equal")
            quiet(axes)
        figure.axes[0].set_ylabel("true frequency")
    return figure


def fit() -> None:
    """Print the constants and their reliability."""
    rows = known_rows()
    print(fitted(rows))
    for what, found, (low, high) in figures(rows):
        chance, most = by_chance(found.first)
        print(f"fitted to {what}: {len(rows)} cases of {len({r['machine'] for r in rows})} machines, expected calibration "
              f"error {expected_error(found.first, found.first_true):.3f} ({low:.3f} to {high:.3f}; by chance {chance:.3f}, "
              f"up to {most:.3f}), of all events "
              f"{expected_error(found.stated, found.true):.3f}, Brier {found.brier:.3f}, log loss {found.loss:.3f}, most "
              f"probable true {found.first_true.mean():.2f}, stated {found.first.mean():.2f}")
