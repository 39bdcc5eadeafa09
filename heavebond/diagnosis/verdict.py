"""How sure a diagnosis is, as one of six words and in sentences.

nothing: what is left is noise. parameters: it was their values, no physics; of what is free, or of a number that the
diagram holds fixed. effect: this one, here. one_of: one of these, which the records cannot tell apart. shape: something that
the catalogue lacks; a place and a curve. undetermined: the records do not tell.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence

from heavebond.core.errors import listing
from heavebond.core.presentation import number, readable
from heavebond.diagnosis.catalogue import Candidate
from heavebond.diagnosis.fixed_values import VALUE
from heavebond.diagnosis.ladder import AddedEffect, LadderEntry, channel_errors
from heavebond.diagnosis.refit import Refit
from heavebond.diagnosis.residual_tests import NEAR, is_noise
from heavebond.diagnosis.stage import Stage
from heavebond.estimation.fitting import Fit

# Shares of chi-square above the noise that a name must take away where the noise is not reached: near it, and far from it.
# Where the noise is given it is a yardstick, and flexible laws at a wrong place take away more than nine tenths of a large
# misfit: 0.85 of the error itself is asked for, 1 - (1 - 0.85)**2 of its square. Noise that is estimated leaves out what no
# model of the machine would explain, so less is asked for.
NEARLY = 0.9
GONE = 1 - (1 - 0.85) ** 2
GONE_ESTIMATED = 0.85
LARGE = 0.15  # error, as a share of what was measured, beyond which no name is given however much is gone
FURTHER = 0.2  # share of what is left above the noise that an effect must take away, alone or as a further one
FILTERED = 5.0  # times an estimated noise that noise behind a filter may be; beyond it is no noise
LESS = 0.7  # of an estimated noise: a model that leaves less shows that the estimate is too large
CHANCE = 0.005  # p value below which fitted parameters are better than those of the data sheet
STILL = 3.0  # channels whose own motion is below this many times their noise tell nothing


def worth_it(step: Stage) -> bool:
    """Whether the effect of a step takes away a noticeable part of what is left above the noise (where nothing was held out:
    of what was fitted)."""
    assert step.chosen is not None
    before, after = (step.chi2_held_out, step.chosen.chi2_held_out) if math.isfinite(step.chi2_held_out) else \
        (step.chi2_fit, step.chosen.chi2_fit)
    return (before - after) / max(before - 1.0, 1e-9) > FURTHER


def is_adequate(ladder: Sequence[LadderEntry], findings: Sequence[AddedEffect]) -> bool:
    """Whether the model with all findings leaves little more than noise, or hardly any of the error that was there without
    them: of the better of the diagram as it stands and fitted, lest an effect be credited with what parameters do."""
    if not findings:
        return _held(ladder[-1]) <= NEAR
    last, first = findings[-1].rung, [r for r in ladder[:2] if r is not findings[0].rung]
    held = _gone(min(map(_held, first)), _held(last))
    if not last.comparison.experiment.noise_given:
        return _held(last) <= NEAR or held >= GONE_ESTIMATED
    if is_noise(last.chi2_fit, last.chi2_held_out, last.samples_held_out):
        return True
    # of several effects each mends what another does wrong: together they can come near the noise with wrong names
    gone = min(held, _gone(min(r.chi2_fit for r in first), last.chi2_fit))
    if len(findings) > 1 or _above_noise(last) > LARGE:
        return False
    return gone >= (NEARLY if near_noise(last) else GONE)


def _gone(first: float, last: float) -> float:
    """The share of what is above the noise that is taken away."""
    return (first - last) / (first - 1) if first > 1 else 0.0


def _above_noise(rung: LadderEntry) -> float:
    """The error on held-out data as a share of what was measured, both as root mean squares over all channels, without
    what noise alone would leave: a channel that hardly moves is all noise, and no model could be nearer to it."""
    channels = [c for part in rung.comparison.parts if part.use != "fit" for c in part.channels.values()]
    shares = [c.normalised**2 * max(0.0, 1 - 1 / c.chi2) if c.chi2 else 0.0 for c in channels if math.isfinite(c.normalised)]
    return math.sqrt(sum(shares) / len(shares)) if shares else 0.0


def _held(rung: LadderEntry) -> float:
    return rung.chi2_held_out if rung.chi2_held_out == rung.chi2_held_out else rung.chi2_fit


def near_noise(rung: LadderEntry) -> bool:
    """Whether what a model leaves, on what was and was not fitted, is near the noise."""
    return max(_held(rung), rung.chi2_fit) <= NEAR


def unexplained(ladder: Sequence[LadderEntry], findings: Sequence[AddedEffect], steps: Sequence[Stage]) -> bool:
    """Whether more than noise is left that no name explains: time for a curve without a name."""
    return bool(steps) and steps[0].left.significant and not steps[-1].partial and not is_adequate(ladder, findings)


def verdict(base: Fit | None, ladder: Sequence[LadderEntry], findings: Sequence[AddedEffect], steps: Sequence[Stage],
            shape: AddedEffect | None) -> str:
    """One of the six words."""
    if not steps[0].left.significant:
        if _still(ladder[0]) or steps[0].partial or _astray(ladder):
            return "undetermined"
        return "parameters" if base is not None and _better(base) else "nothing"
    if findings and is_adequate(ladder, findings) and not (steps[-1].partial and _held(findings[-1].rung) > NEAR):
        if any(f.candidate.kind == VALUE for f in findings):
            return "parameters"
        return "effect" if all(f.certain for f in findings) else "one_of"
    if steps[-1].partial:
        return "undetermined"
    return "shape" if shape is not None or findings else "undetermined"


def _still(rung: LadderEntry) -> bool:
    """Whether no channel moves by more than a few times its noise."""
    return all(float(c.measured.std()) < STILL * c.noise for r in rung.comparison.records.values()
               for c in r.channels.values())


def _astray(ladder: Sequence[LadderEntry]) -> bool:
    """Whether what was fitted shows no more than noise, but what was not does: too little was fitted to see more."""
    best = min(ladder[:2], key=_held)
    return _held(best) > NEAR * max(1.0, best.chi2_fit)


def _better(base: Fit) -> bool:
    """Whether the fitted parameters explain the records better than those of the data sheet, beyond chance."""
    from scipy.stats import chi2

    before = sum(float(c.chi2 * c.counts.sum()) for r in base.before.records.values() if r.use == "fit"
                 for c in r.channels.values())
    return bool(chi2.sf(before - base.chi2 * base.samples, len(base.parameters)) < CHANCE)


def sentences(said: str, ladder: Sequence[LadderEntry], findings: Sequence[AddedEffect], steps: Sequence[Stage],
              shape: AddedEffect | None
              ) -> tuple[str, ...]:
    """The verdict in sentences."""
    lines = [_WORDS[said](ladder, findings, steps, shape)]
    if findings:
        lines.append(_fall(ladder[0], findings[-1].rung))
    if steps[0].at_end and findings and not steps[-1].at_end:
        lines.append(f"Without it {listing(steps[0].at_end)} went to the end of the range, a sign that physics is missing; "
                     "with it they come back inside.")
    found = [p for f in findings for p in f.parameters]
    for p in found:
        if p.unreached is not None:
            side = "below" if p.told[0] is None else "above"
            lines.append(f"{p.name} is not reached in the records that were fitted: all they tell is that it lies {side} "
                         f"{readable(p.unreached, p.unit, 3)}.")
    if unsure := [p.name for p in found if p.ended]:
        lines.append(f"{listing(unsure)} ended at the end of the range: the effect is there, but its value is not sure; "
                     "look for more of its kind.")
    if said in ("effect", "one_of") and len(steps) == len(findings):
        left = _held(findings[-1].rung)
        lines.append("The residual on held-out records is near the noise level." if left <= NEAR else
                     f"The residual there is still {number(left**0.5, 3)} times the noise: diagnose the new experiment "
                     "as well.")
    if said in ("effect", "one_of", "undetermined") and steps[0].left.significant:
        lines += _of_estimates(min(ladder, key=_held))
    if said != "undetermined" and any(step.partial for step in steps):
        lines.append("The search was ended early: not every candidate was refitted.")
    return tuple(lines)


def _of_estimates(best: LadderEntry) -> list[str]:
    """What to do about channels whose estimated noise is far from what the best model leaves there."""
    outputs = best.comparison.experiment.outputs
    own = [m for m in channel_errors(best) if outputs[m.channel].noise is None]
    more = [f"`noise: {m.words}` at {m.channel}" for m in own if math.sqrt(NEAR) < m.error / m.noise < FILTERED]
    less = [m.channel for m in own if m.error < LESS * m.noise]
    return [*([f"The noise is estimated, and an estimate sees only what is white. If the residual is the sensor's own (a "
               f"filter, a slow swaying), write {listing(more, 3)}: then no more is sought in it."] if more else []),
            *([f"Less than the estimated noise is left in {listing(less, 3)}, which moves too much from one sample to the "
               "next for an estimate: give its `noise:` to have more sought."] if less else [])]


def _fall(first: LadderEntry, last: LadderEntry) -> str:
    """The error in the units of the channels beside their noise, since a share of what was measured may be small and many
    times the noise."""
    channels = "; ".join(f"{a.channel} {a.words} to {b.words} (noise {readable(b.noise, b.unit, 3)})" for a, b in
                         zip(channel_errors(first), channel_errors(last), strict=True))
    held = math.isfinite(last.chi2_held_out)
    pairs = [(r.error_held_out, r.chi2_held_out) if held else (r.error_fit, r.chi2_fit) for r in (first, last)]
    (error, chi2), (error_last, chi2_last) = pairs
    return f"The error on {'held-out' if held else 'fitted'} data falls: {channels}. That is {number(100 * error, 3)} % " \
           f"to {number(100 * error_last, 3)} % of what was measured, reduced chi-square {number(chi2, 3)} to " \
           f"{number(chi2_last, 3)}; 1 = noise level."


def _nothing(*_: object) -> str:
    return "No effect is missing: the residual is noise."


def _parameters(ladder: Sequence[LadderEntry], findings: Sequence[AddedEffect], *_: object) -> str:
    if not findings:
        return "Parameters, not physics: with fitted values the residual is noise."
    first, *others = map(_revalued, findings[0].alternatives)
    return f"Parameters, not physics: with {first}, the residual is near the noise level." + \
        (f" The records do not tell it from {listing(others, 5)}." if others else "") + \
        " It is held fixed in this experiment: check it, or put it under `free:`."


def equivalent_value_words(trial: Refit) -> str:
    """That another value of a number that is held fixed does what an effect does."""
    return f"As near to the noise comes the diagram without an effect, with {_revalued(trial)}: make sure of that value."


def _revalued(trial: Refit) -> str:
    """`crown.m at 102 t (in the diagram 120 t)`."""
    (held,) = trial.candidate.numbers
    value, before = (readable(v, held.unit.text, 4) for v in (trial.values.get(held.name, held.neutral), held.neutral))
    return f"{held.name} at {value} (in the diagram {before})"


def _effect(ladder: Sequence[LadderEntry], findings: Sequence[AddedEffect], *_: object) -> str:
    # two laws of one kind at one place may together be one that is not in the catalogue (c_2 s**2 + c_3 s**3)
    often = Counter(_called(f.candidate) for f in findings)
    return f"Missing: {'; '.join(name if k == 1 else f'{name}, {k} times' for name, k in often.items())}."


def _called(candidate: Candidate) -> str:
    """The effect by its class and place, and by what `heavebond try` calls it."""
    if candidate.attaches == "in":
        return f"{candidate.kind} in {candidate.where[0]} ({candidate.name})"
    return f"{candidate.kind} {candidate.place} ({candidate.component})"


def _one_of(ladder: Sequence[LadderEntry], findings: Sequence[AddedEffect], *_: object) -> str:
    parts = [" or ".join(dict.fromkeys(f"another value of {t.candidate.name}" if t.candidate.kind == VALUE else
                                       f"{t.candidate.kind} {t.candidate.place}" for t in f.alternatives[:6]))
             for f in findings]
    return "Missing: " + "; and ".join(parts) + ". The records cannot tell these apart."


def _shape(ladder: Sequence[LadderEntry], findings: Sequence[AddedEffect], steps: Sequence[Stage],
           shape: AddedEffect | None) -> str:
    said = "Something is missing that no entry of the catalogue explains."
    if findings:
        near = " and ".join(f"{f.candidate.kind} {f.candidate.place}" for f in findings)
        said += f" Nearest to it: {near}, which is not all."
    if shape is not None:
        said += f" A learnt curve {shape.candidate.place} lowers the error until its name is found."
    return said


def _undetermined(ladder: Sequence[LadderEntry], findings: Sequence[AddedEffect], steps: Sequence[Stage],
                  shape: AddedEffect | None) -> str:
    if steps[-1].partial:
        near = " and ".join(f"{f.candidate.kind} {f.candidate.place}" for f in findings)
        return "No conclusion yet: the search was ended before every candidate was refitted." + (
            f" Best so far: {near}." if near else "")
    if not steps[0].left.significant and not _still(ladder[0]):
        return "Not decided by these records: the residual of the fitted records is noise, but on held-out " \
            f"data the reduced chi-square is {number(min(map(_held, ladder[:2])), 3)}. The missing effect does not show " \
            "where the model is fitted; give a longer or more exciting record `use: fit`."
    if not steps[0].left.significant:
        return "Not decided by these records: no channel moves by more than a few times its noise."
    return "The residual exceeds the noise, but no effect of the catalogue reduces it noticeably on held-out data. Noise " \
        "of a measured input, or parameters that change with time or temperature, leave such a residual."


_WORDS: dict[str, Callable[..., str]] = {
    "nothing": _nothing, "parameters": _parameters, "effect": _effect, "one_of": _one_of, "shape": _shape,
    "undetermined": _undetermined}
