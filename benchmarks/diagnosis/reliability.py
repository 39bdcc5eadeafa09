"""How reliable the stated probabilities are, at each level of the answer, and the constants that suit the cases best.

The answer to a case of the study has a tree for each effect. A row is one tree: laws with their weights at each
temperature, and which of their branches belong to one of the hidden differences (and to the dominant one). From these and
the constants of `heavebond.diagnosis.evidence.probability` follow the probabilities of all branches, as the answer states
them: no diagnosis is needed to try other constants.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.diagnosis import keeping
from benchmarks.diagnosis.verdicts import interval as interval_of_share
from heavebond.diagnosis.answer.tree import LEVELS as ANSWER_LEVELS
from heavebond.diagnosis.answer.tree import LISTED, STATED
from heavebond.diagnosis.evidence.probability import CALIBRATION, TEMPERATURES, Calibration, parts
from heavebond.numerics.dae import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STUDY = "cluttered"
LEVELS = ANSWER_LEVELS[1:]
GRID = TEMPERATURES[1:]
# Before any case is seen: each constant but the temperature is log-normal about these values, a factor of e its deviation.
BEFORE = Calibration(0, 4.0, 0.2, 2.0, 5.0, 0.03)
FITTED = ("outside", "excess", "simpler", "lapse")
KNOWN = ("inside", "other law")  # dominant effects whose class is in the catalogue
TRAINED = ("place", "kind", "class")  # levels to which constants are fitted
LEAST = 1e-3  # probability below which one is not asked to be right
EDGES = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 1.0)
DRAWS = 2000
Row = Mapping[str, Any]


@dataclass(frozen=True)
class Level:
    """The branches of one level of a case: their probabilities p (k,) of at least 1 %, what is left for "another" last, and
    whether they are true (k,)."""

    p: Array
    true: NDArray[np.bool_]


def known_rows(study: str = STUDY) -> list[Row]:
    """A row for each tree of the answer to each case that could be drawn; the last answer counts."""
    cases: dict[object, Any] = {(r["machine"], r["number"]): r for r in keeping.read(study).values()}
    return [{**case, **tree, "tree": k} for case in cases.values() for k, tree in enumerate(case.get("trees", []))]


def masses(row: Row, constants: Calibration) -> tuple[Array, float]:
    """The probabilities of the laws (m,) of a case, and that no effect is missing."""
    at = GRID.index(constants.temperature)
    flexible = row["flexible"][at] if row["flexible"] is not None else float("nan")
    nothing, parameters, outside, among = map(float, parts(constants, row["missing"], row["sheet"], row["left"], flexible))
    p = np.array([(outside if law[3] else among) * law[4][at] for law in row["laws"]])
    return p, nothing + parameters + among * row["values"][at]


def levels(row: Row, constants: Calibration, dominant: bool = False) -> dict[str, Level]:
    """The branches at each level, as the tree of the answer has them, and whether they belong to a hidden difference (or to
    the `dominant` one): branches below 1 % count together, as "another". This one is true if the branch above it is true
    and none of the listed branches below that."""
    p, none = masses(row, constants)
    found: dict[str, Level] = {}
    above: dict[int, tuple[float, bool]] = {-1: (1.0, True)}
    for depth, level in enumerate(LEVELS):
        branches: dict[int, tuple[float, bool]] = {}
        under: dict[int, list[int]] = {}
        for (numbers, *both, _, _), mass in zip(row["laws"], p, strict=True):
            truths = both[dominant]
            if depth < len(numbers) and (parent := numbers[depth - 1] if depth else -1) in above:
                before = branches.get(numbers[depth], (0.0, False))
                branches[numbers[depth]] = (before[0] + mass, before[1] or truths[depth] == "1")
                under.setdefault(parent, []).append(numbers[depth])
        stated, another = [], []
        if depth == 0:
            stated.append((none, bool(row["nothing"])))
        kept = {n: branch for n, branch in branches.items() if branch[0] >= LISTED}
        for parent, (whole, right) in above.items():
            below = [kept[n] for n in dict.fromkeys(under.get(parent, [])) if n in kept]
            if parent not in under and depth:  # a law outside the catalogue has no laws below it
                continue
            rest = whole - sum(q for q, _ in below) - (none if depth == 0 else 0.0)
            another.append((max(rest, 0.0), right and not any(true for _, true in below)
                            and not (depth == 0 and row["nothing"])))
            stated += below
        stated.append((sum(q for q, _ in another), any(true for _, true in another)))
        found[level] = Level(np.array([q for q, _ in stated]), np.array([true for _, true in stated], bool))
        above = kept
    return found


def expected_error(p: Array, true: Array | NDArray[np.bool_]) -> float:
    """The expected calibration error: in bins of the stated probability its distance from the true frequency, weighted."""
    return float(_errors_of(p, np.asarray(true, float)[:, None])[0])


def _bins(p: Array) -> NDArray[np.int64]:
    return np.clip(np.searchsorted(EDGES, p, side="right") - 1, 0, len(EDGES) - 2)


def _errors_of(p: Array, true: Array) -> Array:
    """The expected calibration errors (d,) of d outcomes (n, d) of events with probabilities p (n,)."""
    member = np.eye(len(EDGES) - 1)[_bins(p)]  # (n, bins)
    return np.asarray(np.abs(member.T @ (true - p[:, None])).sum(axis=0) / max(len(p), 1))


def by_chance(cases: Sequence[Array]) -> tuple[float, float]:
    """The expected calibration error of as many cases of exactly these probabilities, of each case those of events that
    exclude each other: its mean and 95 % quantile."""
    random, outcomes = np.random.default_rng(0), []
    for p in cases:
        which = np.searchsorted(np.cumsum(p), random.random(DRAWS))  # beyond the last: none of them
        outcomes.append((np.arange(len(p))[:, None] == which).astype(float))
    found = _errors_of(np.concatenate(cases), np.concatenate(outcomes))
    return float(np.mean(found)), float(np.quantile(found, 0.95))


@dataclass(frozen=True)
class Reliability:
    """How reliable the probabilities of one level are: of the most probable branch of each case (p, true), and of all
    branches of each case."""

    first: Array
    first_true: NDArray[np.bool_]
    cases: tuple[Level, ...]

    @property
    def stated(self) -> Array:
        """The probabilities of all branches."""
        return np.concatenate([c.p for c in self.cases])

    @property
    def true(self) -> NDArray[np.bool_]:
        """Whether they are true."""
        return np.concatenate([c.true for c in self.cases])


def reliability(rows: Sequence[Row], constants: Sequence[Calibration]) -> dict[str, Reliability]:
    """The reliability at each level with the constants that belong to each row; cases without a branch at a level do not
    count there."""
    each = [levels(row, chosen) for row, chosen in zip(rows, constants, strict=True)]
    found = {}
    for level in LEVELS:
        cases = [of[level] for of in each if of[level].p.max() > LISTED]
        best = [int(np.argmax(c.p)) for c in cases]
        found[level] = Reliability(np.array([c.p[k] for c, k in zip(cases, best, strict=True)]),
                                   np.array([c.true[k] for c, k in zip(cases, best, strict=True)], bool), tuple(cases))
    return found


def probability_of_truth(row: Row, constants: Calibration, level: str) -> float:
    """The probability of the true branches of a level."""
    found = levels(row, constants)[level]
    return float(found.p[found.true].sum())


def probability_of_dominant(trees: Sequence[Row], constants: Sequence[Calibration], level: str) -> float:
    """The probability of the dominant effect's branch of a level, in that tree of one case in which it is most probable."""
    found = [levels(row, of, dominant=True)[level] for row, of in zip(trees, constants, strict=True)]
    return max(float(of.p[:-1][of.true[:-1]].sum()) for of in found)


def by_case(rows: Sequence[Row], constants: Sequence[Calibration]) -> list[tuple[list[Row], list[Calibration]]]:
    """The trees of each case, with the constants that belong to them."""
    cases: dict[object, tuple[list[Row], list[Calibration]]] = {}
    for row, of in zip(rows, constants, strict=True):
        trees, chosen = cases.setdefault((row["machine"], row["number"]), ([], []))
        trees.append(row)
        chosen.append(of)
    return list(cases.values())


def deepest(row: Row, constants: Calibration) -> tuple[str, bool]:
    """The deepest level that the answer states (empty: none), and whether its branch is true: the most probable branch as
    long as it has at least `STATED`, which no other one can have."""
    level, right = "", False
    for name, branches in levels(row, constants).items():
        k = int(np.argmax(branches.p))
        if branches.p[k] < STATED or k == len(branches.p) - 1:
            break
        level, right = name, bool(branches.true[k])
        if name == "system" and k == 0:  # no effect is missing
            break
    return level, right


# -- the fit of the constants ------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Table:
    """The rows (n,) as arrays: what `parts` needs, whether nothing is true, and for each level of TRAINED the weights (n,)
    of true laws of the catalogue and outside it, and of all laws, at each temperature of the grid."""

    known: Mapping[str, Array]
    flexible: Array
    nothing: NDArray[np.bool_]
    values: Array
    true: Mapping[str, Array]
    all: Array

    @classmethod
    def of(cls, rows: Sequence[Row]) -> Table:
        """The table of rows of the study."""
        def summed(choose: Callable[[Any], bool]) -> Array:
            """(2, n, temperatures): in the catalogue, outside it."""
            return np.array([[np.sum([law[4] for law in r["laws"] if law[3] == outside and choose(law)] or
                                     [np.zeros(len(GRID))], axis=0) for r in rows] for outside in (0, 1)])

        depth = {level: LEVELS.index(level) for level in TRAINED}
        none = [float("nan")] * len(GRID)
        return cls({name: np.array([r[name] for r in rows], float) for name in ("missing", "sheet", "left")},
                   np.array([r["flexible"] or none for r in rows]), np.array([bool(r["nothing"]) for r in rows]),
                   np.array([r["values"] for r in rows]),
                   {level: summed(lambda law, d=d: law[1][d:d + 1] == "1") for level, d in depth.items()},  # type: ignore[misc]
                   summed(lambda law: True))

    def losses(self, constants: Calibration) -> Array:
        """The negative logarithms (n,) of the probabilities of the true branches, the mean over the levels."""
        at = GRID.index(constants.temperature)
        nothing, parameters, outside, among = parts(
            constants, self.known["missing"], self.known["sheet"], self.known["left"], self.flexible[:, at])
        none = nothing + parameters + among * self.values[:, at]
        rest = np.maximum(1 - none - among * self.all[0, :, at] - outside * self.all[1, :, at], 0.0)
        found = []
        for of in self.true.values():
            p = among * of[0, :, at] + outside * of[1, :, at]
            listed = (of[0, :, at] + of[1, :, at] > 0) | self.nothing
            found.append(-np.log(np.maximum(np.where(listed, p + none * self.nothing, rest), LEAST)))
        return np.asarray(np.mean(found, axis=0))


def fitted(rows: Sequence[Row], temperatures: Sequence[float] = GRID) -> Calibration:
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


def left_out(rows: Sequence[Row]) -> list[Calibration]:
    """For each row the constants fitted to all other machines."""
    found = {m: fitted([r for r in rows if r["machine"] != m]) for m in {r["machine"] for r in rows}}
    return [found[r["machine"]] for r in rows]


# -- the report ------------------------------------------------------------------------------------------
def report(rows: Sequence[Row], pictures: Path | None = None) -> str:
    """The calibration errors at each level with their values by chance, with the present and with fitted constants."""
    if not rows:
        return "no cases"
    machines = sorted({r["machine"] for r in rows})
    cases = [trees[0] for trees, _ in by_case(rows, [CALIBRATION] * len(rows))]
    lines = [f"{len(cases)} cases of {len(machines)} machines, {sum(bool(r['partial']) for r in cases)} ended by the limit, "
             f"with {len(rows)} trees; median processor time {np.median([r['seconds'] for r in cases]):.0f} s"]
    sets: dict[str, list[Calibration]] = {"present constants": [CALIBRATION] * len(rows)}
    if len(machines) > 1:
        sets["fitted to all other machines"] = left_out(rows)
        sets["fitted to all"] = [fitted(rows)] * len(rows)
    for what, constants in sets.items():
        lines += ["", what + (f": {constants[0]}" if len(set(constants)) == 1 else ""), _table(rows, constants)]
        if pictures is not None:
            pictures.mkdir(parents=True, exist_ok=True)
            diagram(rows, constants).savefig(pictures / f"{what.replace(' ', '_')}.png")
    return "\n".join(lines)


def _table(rows: Sequence[Row], constants: Sequence[Calibration]) -> str:
    found = reliability(rows, constants)
    lines = ["level    trees  first: ECE  chance 95 %  stated   true   all: ECE  chance 95 %  p of the true branch"]
    for level, of in found.items():
        chance, every = (by_chance(cases)[1] for cases in ([np.array([p]) for p in of.first], [c.p for c in of.cases]))
        true = np.mean([c.p[c.true].sum() for c in of.cases])
        lines.append(f"{level:8s} {len(of.cases):5d} {expected_error(of.first, of.first_true):11.3f} {chance:12.3f} "
                     f"{of.first.mean():7.2f} {of.first_true.mean():6.2f} {expected_error(of.stated, of.true):10.3f} "
                     f"{every:12.3f} {true:10.2f}")
    pairs = list(zip(rows, constants, strict=True))
    for kinds in (("inside",), KNOWN):
        of_class = [probability_of_dominant(trees, of, "class") for trees, of in by_case(rows, constants)
                    if trees[0]["hidden"] in kinds]
        if of_class:
            lines.append(f"mean probability of the true class, dominant effect {' or '.join(kinds)}: "
                         f"{np.mean(of_class):.2f} ({len(of_class)} cases)")
    for hidden in sorted({r["hidden"] for r in rows}):
        ends = [deepest(r, c) for r, c in pairs if r["hidden"] == hidden]
        counts = [f"{level or 'none'} {sum(e == (level, True) for e in ends)} right"
                  + (f" {sum(e == (level, False) for e in ends)} wrong" if level else "")
                  for level in ("", *LEVELS) if any(e[0] == level for e in ends)]
        lines.append(f"deepest stated level, {hidden} ({len(ends)}): {'; '.join(counts)}")
    return "\n".join(lines)


def diagram(rows: Sequence[Row], constants: Sequence[Calibration]) -> Figure:
    """Reliability diagrams, one for each level: true over stated, with the number of events and 95 % intervals."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    from heavebond.pictures.plot import COLOURS, DPI, RECORD
    from heavebond.pictures.plot_sample import SMALL, WIDTH, quiet

    found = reliability(rows, constants)
    with rc_context(SMALL):
        figure = Figure(figsize=(1.6 * WIDTH, 0.72 * WIDTH), dpi=2 * DPI, layout="constrained")
        panels = figure.subplots(2, len(LEVELS), sharex=True, sharey=True)
        for k, (level, of) in enumerate(found.items()):
            for axes, stated, true in ((panels[0, k], of.first, of.first_true), (panels[1, k], of.stated, of.true)):
                axes.plot([0, 1], [0, 1], color=RECORD, linewidth=0.8)
                bins = _bins(stated)
                for b in np.unique(bins):
                    n, hits, p = int((bins == b).sum()), int(true[bins == b].sum()), float(stated[bins == b].mean())
                    low, high = interval_of_share(hits, n)
                    ends = [[max(hits / n - low, 0.0)], [max(high - hits / n, 0.0)]]
                    axes.errorbar(p, hits / n, ends, fmt="o", color=COLOURS[0], capsize=2, markersize=3)
                    axes.annotate(f"{n}", (p, low), (0, -8), textcoords="offset points", color=RECORD, ha="center",
                                  fontsize=6)
                axes.set(xlim=(-0.02, 1.02), ylim=(-0.08, 1.02), aspect="equal")
                quiet(axes)
            panels[0, k].set_title(level)
            panels[1, k].set_xlabel("stated probability")
        panels[0, 0].set_ylabel("first branch: true")
        panels[1, 0].set_ylabel("all branches: true")
    return figure
