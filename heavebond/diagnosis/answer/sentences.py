"""The result of a diagnosis in sentences.

The verdict is followed by notes on the final residual, on wrong initial values, on inputs that depend on outputs, and on
omitted parts of the search.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

from heavebond.core.cancellation import ENDED_EARLY
from heavebond.core.errors import joined, listing
from heavebond.core.presentation import count as counted
from heavebond.core.presentation import number, readable, readable_difference
from heavebond.diagnosis.answer.verdict import (
    held_out_or_fitted,
    is_still,
    misfit_reduction,
    near_noise,
    predicts_nothing,
    without_effects,
)
from heavebond.diagnosis.candidates.catalogue import called
from heavebond.diagnosis.candidates.fixed_values import VALUE
from heavebond.diagnosis.decision import DECISION
from heavebond.diagnosis.evidence.comparison import ALL, loss
from heavebond.diagnosis.evidence.flexible_laws import OTHER_CAUSES, Adequacy, Remainder
from heavebond.diagnosis.evidence.prediction import FITTED, share_taken
from heavebond.diagnosis.evidence.residual_tests import LEVELS
from heavebond.diagnosis.search.refit import Refit
from heavebond.diagnosis.search.step import Stage
from heavebond.diagnosis.state import AddedEffect, LadderEntry, channel_errors, typical_values
from heavebond.estimation.comparison import Comparison
from heavebond.estimation.experiment import Experiment
from heavebond.estimation.fitting import Fit
from heavebond.numerics.kinks import jump_notes

FILTERED = 5.0  # largest ratio of a residual to the estimated noise that filtered noise may explain
LESS = 0.7  # ratio of a residual to the estimated noise below which the estimate is too large
GAIN = "sensor gain"  # class of a factor of a channel or an input
MENTIONED = 3  # largest number of candidates that are mentioned as not excluded


def sentences(verdict: str, ladder: Sequence[LadderEntry], findings: Sequence[AddedEffect], steps: Sequence[Stage],
              shape: AddedEffect | None, adequacy: Adequacy | None = None, stated: bool = True) -> tuple[str, ...]:
    """Sentences on the verdict. `stated` is False if the tree of the answer states another place or class than the first
    finding."""
    lines = [verdict_words(verdict, ladder, findings, steps, shape, adequacy, stated)]
    if findings and verdict not in ("nothing", "parameters") and predicts_nothing(ladder, findings):
        error = number(100 * findings[-1].rung.error_fit, 3)
        lines.append("The effect is not certain: the model with it predicts the fitted records hardly better than their "
                     f"mean values would (error {error} %).")
    lines += _same_laws(findings, steps)
    if adequacy is not None and (verdict == "mainly" or adequacy.beaten):
        lines += _curve_comparison(adequacy)
    short = [s.identity.blocks for s, f in zip(steps, findings, strict=False)
             if s.identity is not None and s.identity.too_short and len(f.alternatives) > 1]
    if short:
        blocks = min(short)
        lines.append(f"The records are too short to distinguish them: they hold {number(blocks, 2)} independent blocks, and "
                     f"about {number(DECISION.blocks, 2)} are needed.")
    if findings:
        lines.append(_fall(without_effects(ladder, findings), findings[-1].rung, len(findings) > 1))
        lines += _not_held_out(findings[0], steps[0])
    ended = [name for name in steps[0].at_end if findings and name in findings[-1].fit.experiment.free]
    if ended and not steps[-1].at_end:
        lines.append(f"Without it {listing(ended)} went to the end of the range, a sign that physics is missing; "
                     f"with it {'they come' if len(ended) > 1 else 'it comes'} back inside.")
    for p in (p for f in findings for p in f.parameters):
        if p.unreached is not None:
            side = "below" if p.told[0] is None else "above"
            lines.append(f"{p.name} is not reached in the records that were fitted: they show only that it is {side} "
                         f"{readable(p.unreached, p.unit, 3)}.")
    lines += [line for f in findings for line in at_ends(f)]
    lines += _not_excluded(findings, steps)
    if verdict in ("effect", "one_of") and len(steps) == len(findings):
        residual = held_out_or_fitted(findings[-1].rung)
        lines.append("The residual on held-out records is near the noise level." if residual <= DECISION.near else
                     f"The residual there is still {number(residual**0.5, 3)} times the noise: diagnose the new experiment "
                     "as well.")
    if verdict in ("effect", "one_of", "undetermined") and steps[0].left.significant:
        lines += _of_estimates(min(ladder, key=held_out_or_fitted))
    return tuple(lines)


def at_ends(finding: AddedEffect, is_shown: bool = True) -> list[str]:
    """Sentences on parameters of an effect at an end of their range; `is_shown`: the records show the effect."""
    limits = {p.name for p in finding.at_limits}
    open_ended = [p.name for p in finding.parameters if p.ended and p.name not in limits and p.name not in finding.beyond]
    several = len(finding.beyond) > 1
    lines = []
    if finding.beyond:
        lines.append(f"{listing(finding.beyond)} {'are' if several else 'is'} at the end of the range in which "
                     f"{'they were' if several else 'it was'} sought, and the error would fall beyond it: neither "
                     f"{'the values' if several else 'the value'} nor the name is certain. Look for a further effect of "
                     "its kind, or widen `search_range` in a copy of the component file beside the diagram.")
    if open_ended:
        lines.append(f"{listing(open_ended)} ended at the end of the range; the records do not show how far beyond it may "
                     "be.")
    if limits:
        lines.append(f"{listing(f'{p.name} = {readable(p.value, p.unit, 3)}' for p in finding.at_limits)}: the law is "
                     "fitted best at this limit of the parameter.")
    if finding.undetermined:
        how = "show that the effect is there but not how large it is" if is_shown else "do not show how large the effect is"
        lines.append(f"The records {how}: {listing(finding.undetermined)} may lie anywhere in the range.")
    return lines


def _not_excluded(findings: Sequence[AddedEffect], steps: Sequence[Stage]) -> list[str]:
    """Sentences on candidates of the first step whose search stopped at an end of a range, beyond which their residual would
    decrease.

    They explain as much of the misfit as the answer, except for an immaterial share. Either they are alternatives in the
    answer, or they have a class or place that the answer does not contain.
    """
    if not steps or not findings or near_noise(findings[-1].rung):
        return []
    answer = findings[0].alternatives
    named = {t.candidate.label for t in answer}
    alike = {(t.candidate.kind, frozenset(t.candidate.where)) for t in answer}
    shares = {t.candidate.label: misfit_reduction(steps[0].chi2_fit, t.chi2_fit) for t in steps[0].trials}
    least = max((share for label, share in shares.items() if label in named), default=1.0) - DECISION.material
    lines = []
    for trial in steps[0].trials:
        candidate = trial.candidate
        is_alternative = candidate.label in named
        if not trial.beyond or candidate is findings[0].candidate or shares[candidate.label] < max(least, DECISION.mainly) \
                or (not is_alternative and (candidate.kind, frozenset(candidate.where)) in alike):
            continue
        where = listing(f"{n.name} at {readable(trial.values[n.name], n.unit.text, 3)}" for n in candidate.numbers
                        if n.name in trial.beyond)
        lines.append(f"The search for {called(candidate)}, "
                     f"{'one of these' if is_alternative else 'which is not excluded'}, stopped at the end of a range "
                     f"({where}), beyond which its residual would be smaller: widen `search_range` in a copy of the "
                     "component file beside the diagram.")
    return lines[:MENTIONED]


def _of_estimates(best: LadderEntry) -> list[str]:
    """Advice for channels whose estimated noise differs strongly from the residual of the best model."""
    outputs = best.comparison.experiment.outputs
    estimated = [m for m in channel_errors(best) if outputs[m.channel].noise is None]
    more = [f"`noise: {m.words}` at {m.channel}" for m in estimated
            if math.sqrt(DECISION.near) < m.error / m.noise < FILTERED]
    less = [m.channel for m in estimated if m.error < LESS * m.noise]
    estimates = best.comparison.experiment.estimated_noise
    mixed = [f"{m.channel} (estimated at {readable_difference(m.noise, m.unit, 2)})" for m in estimated
             if m.channel in estimates and not estimates[m.channel].separable]
    return [*([f"The noise of {listing(mixed, 3)} cannot be separated from the signal: judge the residual by the error in "
               "its unit, not by chi-square, or give `noise:`."] if mixed else []),
            *([f"The noise is estimated, and only white noise can be estimated. If the residual is the sensor's own (a "
               f"filter, a slow swaying), write {listing(more, 3)}: then no more is sought in it."] if more else []),
            *([f"Less than the estimated noise is left in {listing(less, 3)}, which moves too much from one sample to the "
               "next for an estimate: give its `noise:` to have more sought."] if less else [])]


def _fall(fitted: LadderEntry, last: LadderEntry, several: bool) -> str:
    """Sentence on the errors without and with the effects.

    The errors are stated in the units of the channels together with the noise, because a small share of the measured signal
    may be many times the noise. Both models have fitted parameters, so the reduction is due to the effects only.
    """
    channels = "; ".join(f"{a.channel} {a.words} to {b.words} (noise {readable_difference(b.noise, b.unit, 3)})" for a, b in
                         zip(channel_errors(fitted), channel_errors(last), strict=True))
    held = math.isfinite(last.chi2_held_out)
    pairs = [(r.error_held_out, r.chi2_held_out) if held else (r.error_fit, r.chi2_fit) for r in (fitted, last)]
    (error, chi2), (error_last, chi2_last) = pairs
    where, verb = "held-out" if held else "fitted", "falls" if chi2_last < chi2 else "rises"
    effects = "these effects" if several else "the effect"
    return f"Compared with the fitted model without {effects}, the error on {where} data {verb}: {channels}. That is " \
           f"{number(100 * error, 3)} % to {number(100 * error_last, 3)} % of the measured signal, and reduced chi-square " \
           f"{number(chi2, 3)} to {number(chi2_last, 3)} (1 = noise level)."


def _not_held_out(finding: AddedEffect, step: Stage) -> list[str]:
    """Note that only the fitted data, and not the held-out data, show an effect."""
    after = next((t.errors for t in finding.alternatives), None)
    if step.shown_held_out or not step.samples_held_out or step.errors is None or after is None:
        return []
    return [f"Held-out data do not show the effect: without it they hold no more than noise (reduced chi-square "
            f"{number(step.chi2_held_out, 3)}). What shows it are the fitted data, cross-validated by blocks of time "
            f"({number(step.errors.mean(FITTED), 3)} to {number(after.mean(FITTED), 3)}): make sure with a record that "
            "moves as these do."]


def _share(explained: float) -> str:
    """Format a share in percent; never as 100, because the text also states that more is missing."""
    return "more than 99" if explained > 0.995 else number(100 * explained, 2)


def verdict_words(verdict: str, ladder: Sequence[LadderEntry], findings: Sequence[AddedEffect], steps: Sequence[Stage],
                  shape: AddedEffect | None, adequacy: Adequacy | None = None, stated: bool = True) -> str:
    """First sentences of the answer: the missing effect with its alternatives, or the reason why none is named. `stated`:
    see `sentences`."""
    if verdict == "nothing" or (verdict == "parameters" and not findings):
        tests = steps[0].left
        # a significant score that no refit confirms
        refuted = f" (The largest score of a candidate, z = {number(tests.z, 3)}, is exceeded by chance in " \
                  f"{number(100 * tests.score, 2)} % of such records; refitted, no candidate is justified.)" \
            if tests.significant else ""
        return ("No effect is missing: the residual is noise." if verdict == "nothing" else
                "Parameters, not physics: with fitted values the residual is noise.") + refuted
    if verdict == "parameters":
        first, *alternatives = map(_revalued, findings[0].alternatives)
        return f"Parameters, not physics: with {first}, the residual is near the noise level." + \
            (f" The records do not distinguish it from {listing(alternatives, 5)}." if alternatives else "") + \
            " It is held fixed in this experiment: check it, or put it under `free:`."
    # laws of the same class and place that the records do not distinguish from the named ones
    laws = dict.fromkeys(t.candidate.component for f in findings for t in f.alternatives[1:]
                         if f.certain and t.candidate.component != f.candidate.component)
    same_place = f" The records do not distinguish this law from {listing(laws, len(laws))} there." if laws else ""
    if verdict == "effect":
        # two laws of one class at one place may together represent a law outside the catalogue (c_2 s**2 + c_3 s**3)
        often = Counter(called(f.candidate) for f in findings)
        return f"Missing: {'; '.join(name if k == 1 else f'{name}, {k} times' for name, k in often.items())}." + same_place
    if verdict == "one_of":
        return "Missing: " + "; and ".join(map(_alternatives, findings)) + "." + _unsure(findings)
    if verdict == "mainly":
        assert adequacy is not None
        share = f"{'It explains' if len(findings) == 1 else 'Together they explain'} {_share(adequacy.explained)} % of " \
                "the misfit (chi-square above the noise)"
        enough = near_noise(findings[-1].rung)  # the residual is then noise, and only the name of the effect is uncertain
        first, *further = (called(f.candidate) if f.certain else _alternatives(f, 1 if k else MENTIONED)
                           for k, f in enumerate(findings))
        unsure = "" if findings[0].certain else _unsure(findings[:1])
        more = f"; added after it: {'; '.join(further)}" if further else ""
        begin = f"Missing: {'probably' if enough else 'mainly'}" if stated else "The best effect of the catalogue is"
        return f"{begin} {first}.{unsure}{same_place} {share}{more}." + \
            ("" if enough else " More is missing.")
    if verdict == "shape" and adequacy is not None and adequacy.beaten:
        assert adequacy.flexible is not None
        first, *further = (_alternatives(f, 1 if k else MENTIONED) for k, f in enumerate(findings)) if findings else [""]
        nearest = f" ({first})" if first else ""
        return f"Something is missing {adequacy.flexible.candidate.place} that no entry of the catalogue explains: an " \
               f"identified curve there explains most of what the best law of the catalogue{nearest} leaves." \
               + (f" Found together with it: {'; '.join(further)}." if further else "")
    if verdict == "shape":
        text = "Something is missing that no entry of the catalogue explains."
        if findings:
            text += f" Nearest to it: {'; and '.join(map(_alternatives, findings))}, but more is missing."
        if shape is not None:
            text += f" An identified curve {shape.candidate.place} lowers the error until its name is found."
        return text
    return _undetermined(ladder, findings, steps)


def _curve_comparison(adequacy: Adequacy) -> list[str]:
    """Sentences on the comparison of a named effect with identified curves, if the residual exceeds the noise."""
    curve, elsewhere, law = adequacy.flexible, adequacy.elsewhere, adequacy.law
    lines = []
    if not adequacy.tried and (curve is None or not adequacy.beaten):
        lines.append("Whether another law at this place would explain more was not tried to the end.")
    elif curve is None:
        lines.append("No identified curve at this place lowers the error; whether another law there would explain more is "
                     "not decided.")
    elif not adequacy.decided:
        inside = "it could not be determined how much of the held-out motion lies" if math.isnan(adequacy.covered) else \
            f"only {number(100 * adequacy.covered, 2)} % of the held-out motion lies"
        lines.append(f"Whether another law there would explain more is not decided: {inside} inside the motion that an "
                     "identified curve was fitted to.")
    elif not adequacy.beaten:
        lines.append("An identified curve at this place does not explain much more (held-out chi-square per sample "
                     f"{number(curve.chi2_held_out, 3)}), so the residual is due to something else.")
    if elsewhere is not None:  # its predictions are as good or not significantly worse
        opening = f"The place is not certain: an identified curve {elsewhere.candidate.place}"
        figures = f"chi-square of all predictions {number(loss(elsewhere), 3)}"
        if law is not None:
            figures += f", with the named effect {number(loss(law), 3)}"
        if law is None or loss(elsewhere) <= loss(law) + DECISION.material * max(loss(law), 1.0):
            lines.append(f"{opening} predicts as well ({figures}).")
        else:
            lines.append(f"{opening} is not excluded. It leaves more ({figures}), but not significantly more, or a small "
                         "part of the misfit.")
    return lines


def acting_as_values(findings: Sequence[AddedEffect], steps: Sequence[Stage], known: Sequence[str]) -> list[str]:
    """Sentences on findings that are equivalent to other values of fixed parameters, to first order.

    Parameters in `known` are left out. If the finding is itself such a value, the sentence lists the equivalent effects.
    """
    lines = []
    for finding, step in zip(findings, steps, strict=False):
        names = [n for n in step.acts_as.get(finding.candidate.label, ()) if n not in known]
        if names:
            lines.append(f"{called(finding.candidate)} acts as another value of {listing(names, len(names))}: the "
                         "records cannot distinguish them if the effect is small. Check that value.")
        if finding.candidate.kind == VALUE and (alike := [label for label, names in step.acts_as.items()
                                                          if finding.candidate.numbers[0].name in names]):
            lines.append(f"If {finding.candidate.numbers[0].name} is right in the diagram, an effect that acts the same is "
                         f"missing: {' or '.join(alike)}.")
    return lines


def equivalent_value_words(trial: Refit) -> str:
    """Sentence on another value of a fixed parameter that explains the misfit as well as an effect."""
    return f"The diagram without an effect comes as near to the noise with {_revalued(trial)}: check that value."


def better_values(values: Stage | None, first: Stage, known: Sequence[str]) -> list[str]:
    """Sentence on other values of fixed parameters that explain most of the misfit without any effect, and predict as well
    as the first effect alone, or better. `values` is the step of all fixed values, `first` the first step; parameters in
    `known` are left out."""
    effect = first.chosen
    if values is None or values.partial or first.errors is None or (effect is not None and effect.candidate.kind == VALUE):
        return []
    largest = loss(effect) if effect is not None else math.inf
    trials = sorted(((t, share_taken(first.errors, t.errors, *ALL)) for t in values.trials
                     if t.candidate.kind == VALUE and t.errors is not None and t.candidate.name not in known
                     and loss(t) <= (1 + DECISION.material) * largest), key=lambda pair: loss(pair[0]))
    trials = [(t, share) for t, share in trials if share >= DECISION.mainly]
    near = [t for t, _ in trials if loss(t) <= (1 + DECISION.material) * loss(trials[0][0])]
    if not near:
        return []
    names = {s.candidate.label: s.candidate.name for s in values.scores}
    texts = [_revalued(t) + (f", which acts as {listing(twins)}," if (twins := [
        names[label] for label in values.twins.get(t.candidate.label, ()) if label in names]) else "")
        for t in near[:MENTIONED]]
    one = len(near) == 1 and " which acts as " not in texts[0]
    alone = "" if effect is None else f", with {called(effect.candidate)} alone {number(largest, 3)}"
    share = _share(trials[0][1])
    return [f"Without any effect, {joined(texts, 'or')} explains {share} % of the misfit (chi-square of all "
            f"predictions {number(loss(near[0]), 3)}{alone}): check {'that value' if one else 'these values'}, or put "
            f"{'it' if one else 'one of them'} under `free:` and diagnose again."]


def opposite_signs(first: Stage, experiment: Experiment) -> list[str]:
    """Sentence on a law that would explain most of the misfit if it gave energy instead of dissipating it: an input or a
    channel may have the wrong sign."""
    recorded = [name for record in experiment.records.values() for name in experiment.inputs_for(record)]
    library = first.experiment.model.library
    shares = {s.candidate.label: (s.z**2 / first.cost, s.candidate) for s in sorted(first.scores, key=lambda s: abs(s.z))
              if s.z < 0 and not s.signed and first.cost > 0
              and library.component(s.candidate.component).dissipates is not None and s.candidate.attaches == "across"}
    if not shares or not recorded:
        return []
    share, candidate = max(shares.values(), key=lambda pair: pair[0])
    if share < DECISION.mainly:
        return []
    name, inputs = f"{candidate.kind[0].upper()}{candidate.kind[1:]}", list(dict.fromkeys(recorded))
    return [f"{name} {candidate.place} of the opposite sign, which would give energy to the machine, would explain about "
            f"{_share(share)} % of the misfit. Check the signs: of the measured {'input' if len(inputs) == 1 else 'inputs'} "
            f"{listing(inputs)} (`factor: -1`) and of the channels (`is: -(...)`)."]


def _revalued(trial: Refit) -> str:
    """Format a fixed parameter with its new value, `crown.m at 102 t (in the diagram 120 t)`; without the value if it was
    not fitted."""
    (held,) = trial.candidate.numbers
    value, before = (readable(v, held.unit.text, 4) for v in (trial.values.get(held.name, held.neutral), held.neutral))
    return f"{held.name} at {value} (in the diagram {before})" if held.name in trial.values and value != before else \
        f"another value of {held.name} (in the diagram {before})"


def _same_laws(findings: Sequence[AddedEffect], steps: Sequence[Stage]) -> list[str]:
    """Sentences on other entries of the catalogue that are the same law at the same place: `leakage` of a cylinder and
    `LaminarLeakage` between its chambers."""
    lines = []
    for finding, step in zip(findings, steps, strict=False):
        named = {t.candidate.label for t in finding.alternatives}
        same = [label for label in step.twins.get(finding.candidate.label, ()) if label not in named]
        if same:
            lines.append(f"{listing(same, MENTIONED)} {'is' if len(same) == 1 else 'are'} the same law as "
                         f"{called(finding.candidate)}.")
    return lines


def _places(finding: AddedEffect) -> dict[str, list[str]]:
    """Places of a finding for each of its classes; another value of a fixed parameter is an entry without places."""
    places_by_class: dict[str, dict[str, None]] = {}
    for trial in finding.alternatives:
        candidate = trial.candidate
        if candidate.kind == VALUE:
            places_by_class[f"another value of {candidate.name}"] = {"": None}
        else:
            places_by_class.setdefault(candidate.kind, {})[candidate.place] = None
    return {kind: list(places) for kind, places in places_by_class.items()}


def _alternatives(finding: AddedEffect, classes: int = MENTIONED) -> str:
    """Format the first classes and places of a finding and the number of further ones: `dry friction at the wall, at the
    floor or at one of 2 other places; or backlash in the gear`."""
    places_by_class = _places(finding)
    named = []
    for kind, places in [*places_by_class.items()][:classes]:
        listed, more = places[:MENTIONED], len(places) - MENTIONED
        if more > 0:
            listed = [*listed, f"at {'another place' if more == 1 else f'one of {more} other places'}"]
        named.append(f"{kind} {joined(listed, 'or')}".strip())
    more = len(places_by_class) - len(named)
    remaining = [] if more <= 0 else ["another class"] if more == 1 else [f"one of {more} other classes"]
    several = classes > 1 and any(len(places) > 1 for places in places_by_class.values())
    return ("; or " if several else " or ").join([*named, *remaining])


def _unsure(findings: Sequence[AddedEffect]) -> str:
    """Sentence on the alternatives that the records cannot distinguish: only places if each finding has a single class."""
    alternatives = "these" if any(len(_places(f)) > 1 for f in findings) else "these places"
    return f" The records cannot distinguish {alternatives}."


def _undetermined(ladder: Sequence[LadderEntry], findings: Sequence[AddedEffect], steps: Sequence[Stage]) -> str:
    """Reason why the records do not decide. After a search that was ended early, the best result with its share of the
    misfit; "no conclusion" only if no candidate removes a large share."""
    step = steps[-1]
    if findings:
        near = "; and ".join(map(_alternatives, findings))
        share = misfit_reduction(held_out_or_fitted(without_effects(ladder, findings)),
                                 held_out_or_fitted(findings[-1].rung))
        return f"The search was ended early. Best so far: {near}; {_share(share)} % of the misfit is explained."
    if step.partial:
        held = math.isfinite(step.chi2_held_out)
        shares = [(misfit_reduction(step.chi2_held_out, trial.chi2_held_out) if held else
                   misfit_reduction(step.chi2_fit, trial.chi2_fit), trial.candidate) for trial in step.trials]
        if not shares or shares[0][0] < DECISION.mainly:
            return "No conclusion yet: the search was ended early."
        (share, first), runners_up = shares[0], shares[1:]
        behind = [f"{called(c)} explains {_share(s)} %" for s, c in runners_up
                  if (c.kind, c.where) != (first.kind, first.where)][:1]
        return f"The search was ended early. Best so far: {called(first)}, which explains {_share(share)} % of the misfit" \
            + (f"; of the others {behind[0]}" if behind else "") + "."
    if steps[0].left.significant:
        return "The residual exceeds the noise, but no effect of the catalogue reduces it noticeably on held-out data."
    if is_still(ladder[0]):
        return "Not decided by these records: no channel moves by more than a few times its noise."
    best = min(ladder, key=held_out_or_fitted)
    # white by the test for memory in each channel of the held-out data
    p_values = [c.white for part in best.comparison.parts if part.use != "fit" for c in part.channels.values()]
    if p_values and all(p * len(p_values) >= LEVELS["memory"] for p in p_values):
        to_write = [f"`noise: {m.words}` at {m.channel}" for m in channel_errors(best)
                    if m.error > math.sqrt(DECISION.near) * m.noise]
        why = "It is white there too, which a missing effect seldom leaves, and a sensor that is noisier in some records " \
              f"does. If so, nothing is missing: write {listing(to_write, 3)}."
    else:
        why = "The missing effect does not show where the model is fitted; give a longer or more exciting record `use: fit`."
    return "Not decided by these records: the residual of the fitted records is noise, but on held-out data the " \
           f"reduced chi-square is {number(held_out_or_fitted(best), 3)}. {why}"


def residual_notes(verdict: str, remainder: Remainder | None, steps: Sequence[Stage]) -> list[str]:
    """Sentences on the final residual if the findings do not explain it."""
    if verdict not in ("mainly", "shape", "undetermined") or not steps[0].left.significant:
        return []
    if remainder is None:
        return [OTHER_CAUSES] if verdict == "undetermined" and not steps[-1].partial else []
    other_causes = remainder.place is None or (verdict == "undetermined" and not remainder.decided)
    return [remainder.words, *([OTHER_CAUSES] if other_causes else [])]


def lost_candidates(steps: Sequence[Stage]) -> list[str]:
    """Sentence on candidates that are missing because the operating system ended a process."""
    lost = list(dict.fromkeys(label for step in steps for label in step.lost))
    return [f"Not tried to the end: {listing(lost, 4)}. The processes that worked on this died, also when it was tried "
            "again alone (killed, or out of memory). Fewer `--processes`, or `--samples`, need less memory."] if lost else []


def broken_candidates(verdict: str, steps: Sequence[Stage]) -> list[str]:
    """Sentence on candidates that were not tried, if the answer is incomplete."""
    broken = steps[0].broken if verdict in ("mainly", "shape", "undetermined") and steps[0].left.significant else ()
    return [f"Not tried, as the diagram with it cannot be simulated: {listing(broken, 4)}. `heavebond try` with one "
            "of them states the reason."] if broken else []


def wrong_starts(verdict: str, last: Comparison) -> list[str]:
    """Sentences on channels whose initial values differ from the model with all effects, with advice if the verdict is
    undetermined."""
    notes = [f"{name}: {start}." for name, record in last.records.items() for start in record.starts]
    if notes and verdict == "undetermined":
        notes.append("A wrong start leaves a transient that no effect explains, and may hide the one that is missing: set "
                     "the start right, then diagnose again.")
    return notes


def wrong_channels(last: Comparison, added: Sequence[AddedEffect] = (), experiment: Experiment | None = None) -> list[str]:
    """Sentences on channels whose unit, sign or zero seems to differ from the experiment file, according to the final
    model, and on fitted gains of channels and inputs of the given `experiment` that are below zero: their sign is wrong."""
    records_by_slip: dict[str, list[str]] = {}
    for name, record in last.records.items():
        for slip in record.slips:
            records_by_slip.setdefault(slip, []).append(name)
    notes = [f"{listing(records)}: {slip}." for slip, records in records_by_slip.items()]
    for effect in added:
        errors = [p.value for p in effect.parameters] if effect.candidate.kind == GAIN else []
        if not any(1 + error < 0 for error in errors):
            continue
        name, declared = effect.candidate.signal or effect.candidate.where[0], experiment or last.experiment
        inputs = {**declared.inputs, **{n: file_input for record in declared.records.values()
                                        for n, file_input in record.inputs.items()}}
        remedy = f"write `is: -({declared.outputs[name].shown.text})` at {name}" if name in declared.outputs else \
            f"write `factor: {number(-inputs[name].factor)}` at {name}" if name in inputs else "turn it in the diagram"
        notes.append(f"The fitted gain {effect.candidate.place} is {number(1 + errors[0], 3)}: the signal seems to have the "
                     f"opposite sign. To turn it, {remedy}.")
    return [*notes, "If so, correct it and diagnose again: the answer holds for its present value."] if notes else []


def passed_conditions(last: Comparison) -> list[str]:
    """Sentences on conditions at which a law jumps without an event in the runs of the final model."""
    notes = dict.fromkeys(note for record in last.records.values() for note in jump_notes(record.result, "fit"))
    return [f"{note}." for note in notes]


def closed_loops(first: Comparison) -> list[str]:
    """Sentence on inputs that depend on outputs, and the consequence for the answer."""
    feedback_notes = dict.fromkeys(note for record in first.records.values() for note in record.feedback)
    return [f"The answer may be biased: {next(iter(feedback_notes))}."] if feedback_notes else []


def left_out_words(steps: Sequence[Stage]) -> list[str]:
    """Sentence on the effects that the first step did not try or discarded: for each reason one effect and the number of
    others."""
    if not steps:
        return []
    reasons: dict[str, list[str]] = {}
    for label, reason in steps[0].excluded.items():
        reasons.setdefault(reason, []).append(label)
    parts = [f"{labels[0]}{f' and {len(labels) - 1} more' if len(labels) > 1 else ''} ({reason})"
             for reason, labels in sorted(reasons.items(), key=lambda pair: -len(pair[1]))]
    return [f"Not among the candidates: {listing(parts, len(parts))}. `--json` lists all."] if parts else []


def search_limits(classes: Sequence[str], looked: str, shorter: bool) -> list[str]:
    """Sentences on restrictions of the search: classes and samples."""
    only = f"Tried were only effects of {'this class' if len(classes) == 1 else 'these classes'}: {listing(classes)}."
    fitted = "the time did not suffice to fit the effects to the whole records. All figures hold for these beginnings" \
        if shorter else "the effects were fitted to the whole records"
    part = f"The records are long: the search used their beginning ({looked}), and {fitted}. `--samples` sets how " \
        "much, `from:` and `to:` at a record which part."
    return [*([only] if classes else []), *([part] if looked else [])]


# Parts of a search that may be left out, in order.
EFFECTS = "effects of the catalogue"
CALIBRATION = "offsets and gains of inputs and channels together with the leading effects"
FURTHER, VALUES = "further effects", "other values of the fixed parameters"
CURVES = "identified curves in place of an effect"
SEGMENTS = "effects within segments of the records, which hold little of the drift of the model"
MORE_TIME = "More time: `--seconds`. Less to do: `--samples`, `--only CLASS`, or `from:` and `to:` at a record."


def before_search(ladder: Sequence[LadderEntry], base: Fit | None) -> tuple[str, ...]:
    """Answer of a search that was ended before its first candidate was scored."""
    if not ladder:
        return "No conclusion yet: the search was ended before the model was simulated on all records. Nothing is known.", \
            MORE_TIME
    lines = ["No conclusion yet: the search was ended before the first candidate was scored. Known is how far the diagram "
             "is from the records" + ("." if base is None else ", before and after the fit of the free parameters.")]
    if base is not None and was_ended(base):
        lines.append(f"The fit was ended too, after {counted(len(base.history), 'run')}: its values are the best so far.")
    return *lines, MORE_TIME


def was_ended(fit: Fit) -> bool:
    """True if the fit was ended before convergence."""
    return fit.message == ENDED_EARLY


def so_far(steps: Sequence[Stage], untried: Sequence[str]) -> list[str]:
    """Sentences on a search that was ended early: the number of scored and refitted candidates, the leading one, and the
    parts of the search that were not tried."""
    lines = []
    cut = next((k for k, step in enumerate(steps, 1) if step.partial), 0)
    if cut:
        step = steps[cut - 1]
        scored, refitted = {s.candidate.label for s in step.scores}, {t.candidate.label for t in step.trials}
        planned = max(step.planned - len(step.broken), len(scored | refitted))
        line = f"{f'In step {cut}' if len(steps) > 1 else 'So far'}, {len(scored)} of {counted(planned, 'candidate')} " \
               f"{'was' if len(scored) == 1 else 'were'} scored and {len(refitted)} refitted; the others may explain the " \
               "residual as well."
        largest = max(step.scores, key=lambda s: s.gain, default=None)
        if step.trials:
            best, held = step.trials[0], math.isfinite(step.chi2_held_out)
            before, after = (step.chi2_held_out, best.chi2_held_out) if held else (step.chi2_fit, best.chi2_fit)
            line += f" Leading: {best.candidate.label}, which changes chi-square per sample from {number(before, 3)} to " \
                    f"{number(after, 3)} on {'held-out' if held else 'fitted'} data."
        elif largest is not None and largest.gain > 0:
            line += f" Largest score: {largest.candidate.label}."
        lines.append(line)
    if untried:
        lines.append(f"Not tried, as the search was ended early: {listing(untried, len(untried))}.")
    return lines


def unusual_values(findings: Sequence[AddedEffect]) -> list[str]:
    """Sentences on fitted parameters outside the typical range, and on parameters that should be compared with the
    machine."""
    lines = []
    for p, typical in [(p, typical_values(f.fit, p.name)) for f in findings for p in f.parameters]:
        if typical is None:
            continue
        value = readable(p.value, p.unit, 3)
        if typical.range is None:
            lines.append(f"{p.name} = {value}: compare this with {typical.source}.")
        elif not typical.range.low <= p.value <= typical.range.high:
            low, high = (readable(end, p.unit, 3) for end in (typical.range.low, typical.range.high))
            lines.append(f"{p.name} = {value} is unusual: {low} to {high} is typical ({typical.source}).")
    return lines
