"""HTML report of a diagnosis, for screen and print: the missing effect, its place and certainty, the tested candidates.

The file is self-contained: pictures are inline SVG, records are JSON, a small script provides zooming and panning. Equal
diagnoses give equal files.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from heavebond.core.errors import HeavebondError
from heavebond.core.presentation import count, number, path_text, readable_difference, readable_unit
from heavebond.core.units import read_unit
from heavebond.core.version import VERSION
from heavebond.diagnosis.answer.tree import SHOWN, Node
from heavebond.diagnosis.answer.verdict import without_effects
from heavebond.diagnosis.diagnose import Diagnosis
from heavebond.diagnosis.evidence.probability import PROBABILITY, percent
from heavebond.diagnosis.state import AddedEffect, LadderEntry, channel_errors, parameter_description, restrictions
from heavebond.language.library import bundled
from heavebond.localise.misfit import Localization
from heavebond.pictures.drawing import draw
from heavebond.pictures.markup import Html, data_block, element, joined, page, table
from heavebond.reports.report_charts import BLUE, Fall, ladder, swatch
from heavebond.reports.report_series import ModelStyle, key, packed, record_section, shown_rungs
from heavebond.reports.report_tables import (
    explained,
    noise,
    parameters,
    ranking,
    records,
    separating,
    tests,
    tried,
    valued,
)
from heavebond.reports.report_where import failing, learnt

# heading of each verdict, and the CSS class of its colour
KINDS = {
    "nothing": ("No effect is missing", "fine"), "parameters": ("Parameters, not physics", "fine"),
    "effect": ("Missing effect found", "found"), "one_of": ("One of these is missing", "found"),
    "mainly": ("Mainly this effect; more is missing", "found"),
    "shape": ("A law is missing that the catalogue does not have", "open"),
    "undetermined": ("Not decided by these records", "open"),
}
FITTED, HELD_OUT = "#8fa3b5", BLUE
HEADLINE = 3  # number of channels with an error card at the top; they have the largest ratios of error to noise
Section = tuple[str, str, Html]


def report(diagnosis: Diagnosis, where: Localization | None = None, *, written: Sequence[Path] = ()) -> str:
    """The report of a diagnosis as the text of an HTML file.

    `where` (see `localise.misfit`) adds the states of motion with a large misfit of the original diagram, and the
    estimated inputs at its places. `written` are the experiment files of the findings, for the commands under the next
    steps.
    """
    styles = shown_rungs(diagnosis.ladder)
    sections = [s for s in _sections(diagnosis, styles, where, written) if s[2]]
    contents = element("nav", *(element("a", title, href=f"#{name}") for name, title, _ in sections), aria_label="contents")
    parts = [element("section", element("h2", title, id=name), inside) for name, title, inside in sections]
    title = f"Diagnosis of {diagnosis.experiment.name}"
    model = diagnosis.experiment.model
    summary = f": {model.summary}" if model.summary else ""
    return page(title,
                element("header", element("h1", title), element("p", f"Diagram {model.name}{summary}"),
                        element("p", f"Experiment {_named(diagnosis)}", class_="small"), class_="page"),
                element("main", _verdict(diagnosis), contents, *parts),
                element("footer", element("p", f"Made by heavebond {VERSION}. This page is self-contained and "
                                          "loads nothing.")), data_block("series", packed(styles)))


def _sections(diagnosis: Diagnosis, styles: Sequence[ModelStyle], where: Localization | None,
              written: Sequence[Path]) -> list[Section]:
    """The sections below the verdict: name, title and content of each."""
    if not diagnosis.ladder:  # no model was simulated
        return [("next", "How to go on", _next(diagnosis, written))]
    fit = diagnosis.added[-1].fit if diagnosis.added else diagnosis.fitted
    finding = diagnosis.findings[0] if diagnosis.findings else diagnosis.shape
    apart = diagnosis.separation
    records = styles[-1].rung.comparison.records.values()
    return [("machine", "The machine", _machine(diagnosis, where)), ("finding", "Added effects", _effects(diagnosis)),
            ("records", "Records and models",
             joined([key(), *(record_section(k, record, styles) for k, record in enumerate(records))])),
            ("ladder", "Errors of the models", _ladder(diagnosis.ladder)),
            ("where", "Where the diagram fails", failing(where, finding) if where is not None else Html("")),
            ("separation", "What to record next", separating(apart) if apart is not None else Html("")),
            ("candidates", "Candidates and their evidence", _candidates(diagnosis)),
            ("parameters", "Parameters", parameters(fit, diagnosis.fitted) if fit is not None else Html("")),
            ("left", "Residual", _residual(diagnosis)), ("tried", "What was tried", _tried(diagnosis)),
            ("next", "How to go on", _next(diagnosis, written))]


# -- the top -----------------------------------------------------------------------------------------------------------
def _verdict(diagnosis: Diagnosis) -> Html:
    kind, mood = KINDS[diagnosis.verdict]
    if diagnosis.verdict == "undetermined" and diagnosis.partial:
        kind = "The search was ended early"
    first, *more_words = diagnosis.tree.words
    # the levels of the answer, system, place, kind, class and law, as nested lists with their probabilities
    tree = diagnosis.tree

    def listed(node: Node) -> Html:
        items = [element("li", child.name, " ", element("small", percent(child.probability)), listed(child))
                 for child in node.children if child.probability >= SHOWN]
        return element("ul", *items) if items else Html("")

    several = len(tree.effects) > 1
    parts = [joined([*([element("p", f"{k}. {effect.name}", class_="small")] if several else []), listed(effect.root)])
             for k, effect in enumerate(tree.effects, 1)]
    box = element("section", element("p", kind, class_="kind"), element("p", first, class_="said"),
                  *(element("p", line) for line in more_words),
                  element("div", *parts, class_="levels") if parts else Html(""),
                  *(element("p", line) for line in diagnosis.words), class_=f"verdict {mood}", aria_label="verdict")
    return joined([box, _figures(diagnosis)]) if diagnosis.ladder else box


def _figures(diagnosis: Diagnosis) -> Html:
    """The summary values: first the errors and the noise in the units of the channels, then relative errors.

    A relative error alone is not sufficient, because it can be small although the error is many times the noise.
    """
    added = diagnosis.added
    first, last = without_effects(diagnosis.ladder, added) if added else diagnosis.ladder[0], diagnosis.ladder[-1]
    held = math.isfinite(last.error_held_out)
    errors = [r.error_held_out if held else r.error_fit for r in (first, last)]
    chi2 = [r.chi2_held_out if held else r.chi2_fit for r in (first, last)]
    on = "held out" if held else "fitted"
    tried_ = len({s.candidate.label for step in diagnosis.steps for s in step.scores})
    fitted_ = len({t.candidate.label for step in diagnosis.steps for t in step.trials})
    pairs = list(zip(channel_errors(first), channel_errors(last), strict=True))
    worst = sorted(pairs, key=lambda pair: -pair[0].error / pair[0].noise)[:HEADLINE]
    channels = [_figure(f"{a.channel}: rms error, on records {on}", f"{a.words} → {b.words}",
                        f" noise {readable_difference(b.noise, b.unit, 3)}") for a, b in worst]
    cards = [*channels, _figure(f"error over noise, on records {on}", " → ".join(number(math.sqrt(c), 3) for c in chi2),
                                f" chi-square {' → '.join(number(c, 3) for c in chi2)} per sample; 1 = noise level"),
             _figure("error as a share of what was measured", " → ".join(f"{number(100 * e, 3)} %" for e in errors),
                     f" {on}"),
             _figure("effects tried", str(tried_), f" of which fitted {fitted_}; {diagnosis.seconds:.0f} s")]
    return element("dl", *cards, class_="figures six" if len(cards) == 6 else "figures")


def _figure(name: str, value: str, small: str) -> Html:
    return element("div", element("dt", name), element("dd", value, element("small", small)))


# -- the machine and the finding ---------------------------------------------------------------------------------------
def _machine(diagnosis: Diagnosis, where: Localization | None) -> Html:
    """The last diagram with the findings marked, or else the place at which an unknown input explains most."""
    model, marks = diagnosis.last.model, {}
    for k, finding in enumerate(diagnosis.added, 1):
        candidate = finding.candidate
        # an inactive parameter has no picture; mark its component
        name = candidate.where[0] if candidate.attaches == "in" else candidate.name
        marks[name] = candidate.kind if len(diagnosis.added) == 1 else f"{k}: {candidate.kind}"
    caption = "The diagram with the added effects marked." if marks else "The diagram without changes; nothing was added."
    if not marks and where is not None and where.suspects and diagnosis.verdict == "undetermined":
        marks = {n.name: "unknown input" for n in where.suspects[0].place.nodes}
        caption = "The diagram without changes; marked is the place where an unknown input would explain most."
    # the alternative places of uncertain findings
    alternatives = {name: f"or here: {trial.candidate.kind}" for finding in diagnosis.findings if not finding.certain
                    for trial in finding.alternatives[1:] for name in trial.candidate.where[:1]
                    if trial.candidate.where != finding.candidate.where}
    # fewer marks if some cannot be drawn
    for highlight in ({**alternatives, **marks}, marks, {}):
        try:
            picture = Html(draw(model, highlight=highlight))
        except HeavebondError:
            continue
        return element("figure", element("div", picture, class_="diagram"), element("figcaption", caption))
    return Html("")


def _effects(diagnosis: Diagnosis) -> Html:
    """Each effect with its parameters, and the candidates that the records cannot distinguish from it."""
    parts = [element("h3", PROBABILITY), table(("explanation", "probability"), [e.row for e in diagnosis.events],
                                               numbers=(1,))] if diagnosis.events else []
    parts += [_finding(k, f) for k, f in enumerate((*diagnosis.findings, *diagnosis.doubtful), 1)]
    shape = diagnosis.shape
    if shape is not None:
        parts += [element("h3", f"A curve without a name: {shape.candidate.description} {shape.candidate.place}"),
                  element("p", "With it the chi-square per sample on held-out data is "
                          f"{number(shape.rung.chi2_held_out, 4)}."), learnt(shape)]
    return joined(parts)


def _finding(k: int, finding: AddedEffect) -> Html:
    candidate = finding.candidate
    inactive = candidate.attaches == "in"
    role = f"parameter of {candidate.component}:" if inactive else f"component {candidate.component}, in the diagram as"
    rows = [(explained(p.name, parameter_description(finding.fit, p.name)), *valued(p),
             f"at the {p.ended} end of its range" if p.ended else "") for p in finding.parameters]
    parts = [element("h3", f"{k}. {candidate.kind[:1].upper()}{candidate.kind[1:]} {candidate.place}"),
             element("p", f"{candidate.description[:1].upper()}{candidate.description[1:]}; {role} ",
                     element("code", candidate.name), ".")]
    if rows:
        parts.append(table(("number", "value", "95 % interval", ""), rows))
    if limits := restrictions(finding):
        parts.append(element("p", f"Limits of this law: {limits}", class_="small"))
    # the text of a diagram that adds a finding to the previous diagram
    values = {p.name: read_unit(readable_unit(p.unit, p.value)).written(p.value) for p in finding.parameters}
    added, diagram_path = finding.candidate, finding.fit.experiment.model.path
    label = f"with {added.kind} {added.place}"
    diagram = added.change.with_values(values).diagram(diagram_path.stem + "_2", label, diagram_path.name)
    parts.append(element("details", element("summary", "as a diagram"), element("pre", element("code", diagram))))
    alternatives = finding.alternatives[1:]
    if alternatives:
        parts.append(element("p", "The records cannot distinguish it from: " if not finding.certain else
                             "Other laws of the same class at the same place explain the records as well:"))
        parts.append(element("ul", *(element("li", f"{t.candidate.kind} {t.candidate.place} ({t.candidate.component}), "
                                             f"chi-square held out {number(t.chi2_held_out, 4)}") for t in alternatives)))
    return joined(parts)


# -- errors ------------------------------------------------------------------------------------------------------------
def _ladder(rungs: Sequence[LadderEntry]) -> Html:
    """The errors of the models as a bar chart and a table."""
    levels = []
    for use in ("fit", "validate"):
        # the error due to noise alone on the records of one use; NaN if there are no such records
        shares = [float(np.mean([(c.noise * c.normalised / c.error)**2 if c.error > 0 else 0.0
                                 for c in part.channels.values()])) for part in rungs[-1].comparison.parts
                  if (part.use == "fit") == (use == "fit")]
        levels.append(100 * (float(np.sqrt(np.mean(shares))) if shares else math.nan))
    falls = [Fall(r.name, (("fitted", 100 * r.error_fit, levels[0]), ("held out", 100 * r.error_held_out, levels[1])))
             for r in rungs]
    rows = [(r.name, *(f"{number(100 * e, 4)} %" if math.isfinite(e) else "–" for e in (r.error_fit, r.error_held_out)),
             *(number(c, 4) for c in (r.chi2_fit, r.chi2_held_out))) for r in rungs]
    head = ("model", "error, fitted", "error, held out", "reduced χ², fitted", "reduced χ², held out")
    label = "Error of each model on fitted and on held-out records"
    alone = ", ".join(f"{number(level, 3)} % {on}" for level, on in zip(levels, ("fitted", "held out"), strict=True)
                      if math.isfinite(level))
    legend = swatch(("area", FITTED, "on fitted records"), ("area", HELD_OUT, "on held-out data"),
                    ("mark", "#000000", f"noise alone: {alone}"))
    words = "Error: root mean square of record − model, divided by the root mean square of the record about its mean. The " \
            "reduced χ² is 1 if the residual is noise only."
    return joined([element("figure", element("div", ladder(falls, (FITTED, HELD_OUT), label), class_="scroll"),
                           element("figcaption", legend)), element("p", words, class_="small"),
                   table(head, rows, numbers=(1, 2, 3, 4))])


# -- evidence ----------------------------------------------------------------------------------------------------------
def _candidates(diagnosis: Diagnosis) -> Html:
    if not diagnosis.steps:
        return Html("")
    all_ = "Effects of the catalogue were tried at places where they fit, until the search was ended. The score" \
        if any(step.partial for step in diagnosis.steps) else \
        "Every effect of the catalogue was tried at every place where it fits. Its score"
    words = element("p", f"{all_} is the chi-square "
                    "that it could remove, to first order. The decision follows from the refit of all free parameters with "
                    "it, and from the error on held-out data.", class_="small")
    steps = [joined([element("h3", f"Step {k}"), ranking(step)]) for k, step in enumerate(diagnosis.steps, 1)]
    if diagnosis.verdict == "parameters" and diagnosis.findings:
        steps.insert(1, element("p", "In the next step other values of the fixed parameters were tried, without an "
                                "effect.", class_="small"))
    return joined([words, *steps])


def _residual(diagnosis: Diagnosis) -> Html:
    if not diagnosis.steps:
        return noise(diagnosis)
    first = "the diagram, its free parameters fitted" if diagnosis.fitted is not None else "the diagram"
    # the last step may have chosen no effect, and effects that are not certain are no findings
    added = diagnosis.added if diagnosis.verdict != "parameters" else ()
    names = [f"the diagram with {added[min(k, len(added)) - 1].candidate.label}" if k and added else first
             for k in range(len(diagnosis.steps))]
    note = "Tests on the fitted samples. If no effect is missing, at least one answer is a false yes in 2 of 100 cases."
    return joined([tests(diagnosis.steps, names), element("p", note, class_="quiet small"), noise(diagnosis)])


def _tried(diagnosis: Diagnosis) -> Html:
    ended = [name for step in diagnosis.steps[:1] for name in step.at_end]
    note = element("p", f"Before anything was added, {', '.join(ended)} ended at an end of the range given: a sign of "
                   "missing physics.") if ended else Html("")
    total = element("p", f"In all {count(len(diagnosis.steps), 'step')}, {diagnosis.seconds:.0f} s.")
    return joined([tried(diagnosis), note, total, records(diagnosis)])


# -- how to go on ------------------------------------------------------------------------------------------------------
def _named(diagnosis: Diagnosis) -> str:
    """The experiment as an argument of the command line."""
    path, inside = diagnosis.experiment.path.resolve(), bundled("models").resolve()
    return path.relative_to(inside).with_suffix("").as_posix() if path.is_relative_to(inside) else path_text(path)


def _next(diagnosis: Diagnosis, written: Sequence[Path]) -> Html:
    """The commands of the next steps."""
    name = _named(diagnosis)
    # a `heavebond try` command for each of the indistinguishable effects
    lines = []
    for finding in diagnosis.findings:
        for candidate in (t.candidate for t in finding.alternatives[:6]):
            where, pair = candidate.where, candidate.attaches == "across" and len(candidate.where) == 2
            place = f"--between {where[0]} {where[1]}" if pair else f"--at {where[0]}"
            inactive = candidate.attaches == "in"
            lines.append(f"heavebond try {name} " + (candidate.name if inactive else f"{candidate.component} {place}"))
    advice, lines = {
        "nothing": ("The diagram may be used as it is.", [f"heavebond compare {name} --output compared.png"]),
        "parameters": ("Write the fitted values back as a diagram:", [f"heavebond fit {name} --write fitted.yaml"]),
        "effect": ("Add the effect, and diagnose again:", [f"heavebond diagnose {name}"]),
        "one_of": ("A further record can distinguish them. Each can be added by hand:", lines),
        "mainly": ("Add the effect, and diagnose again, as more is missing:", [f"heavebond diagnose {name}"]),
        "shape": ("Look at the unknown input at the places, and describe it by a component with an entry `effect:`:",
                  [f"heavebond localize {name} --fitted --output where.png", f"heavebond candidates {name}"]),
        "undetermined": ("Record a larger or a longer motion, or localise the misfit:",
                         [f"heavebond localize {name} --fitted --output where.png"])}[diagnosis.verdict]
    if diagnosis.partial and diagnosis.verdict == "undetermined":
        advice, lines = "Give the search more time:", [f"heavebond diagnose {name} --seconds {2 * diagnosis.seconds:.0f}"]
    if written:
        files = [path_text(path) for path in written]
        lines = [*(f"heavebond compare {file}" for file in files), f"heavebond diagnose {files[-1]}"]
        advice = "The added effects are written to files. Compare them with the records, and diagnose again:"
    return joined([element("p", advice), element("pre", element("code", "\n".join(lines)))])
