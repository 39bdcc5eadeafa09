"""HTML representation of objects in notebooks: tables with units, and pictures as SVG; all text is escaped.

A picture is embedded as a data URI, so that its styles and identifiers cannot conflict with the page. A figure with many
points is a PNG. A figure with many axes is omitted: call `result.plot()` or `comparison.plot()` to draw it.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from heavebond.core.errors import HeavebondError
from heavebond.core.presentation import count, number, readable_unit, unit_label
from heavebond.core.units import dimension_text, read_unit
from heavebond.language.definition import Value
from heavebond.pictures.markup import Html, element, table
from heavebond.reports.result_tables import (
    Item,
    Line,
    ResultTable,
    comparison_items,
    effect_table,
    fit_items,
    ladder_table,
    probability_table,
    tree_tables,
)
from heavebond.text.expression import Number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from heavebond.diagnosis.diagnose import Diagnosis
    from heavebond.estimation.comparison import Comparison
    from heavebond.estimation.fitting import Fit
    from heavebond.language.model import Model
    from heavebond.numerics.extremes import SignalFigures
    from heavebond.numerics.result import Result
    from heavebond.records.saved_runs import SavedRun

MOST_POINTS = 20_000  # maximum number of points of an SVG figure, about 0.3 MB
MOST_AXES = 12  # maximum number of axes of a figure
MOST_ROWS = 60  # maximum number of rows of a table
ROUNDING = 1e-9  # a value smaller than this share of the largest is a rounding error
WIDTH = "max-width: 100%"


def model_html(model: Model) -> Html | None:
    """The drawing of a diagram and the table of its parameters; None if the diagram cannot be drawn."""
    from heavebond.pictures.drawing import draw

    try:
        drawing = str(draw(model))
    except HeavebondError:
        return None
    # name, component and value of each parameter that the diagram sets, as written
    instance_settings = {f"{name}.{key}": (instance.kind, value) for name, instance in model.body.instances.items()
                         for key, value in instance.settings.items()}
    settings = {**{name: ("", value) for name, value in model.parameters.items()}, **instance_settings}
    settings |= {path: (settings.get(path, ("", None))[0], setting.value) for path, setting in model.settings.items()}
    rows = [(name, kind, _value_text(value) if isinstance(value, Value) else "from a file")
            for name, (kind, value) in settings.items()]
    details = element("details", element("summary", count(len(rows), "parameter")),
                      table(("parameter", "component", "value"), rows))
    return element("div", _heading(model.name, model.summary), _picture(drawing.encode("utf-8"), "svg+xml", model.name),
                   *([details] if rows else []))


def result_html(result: Result) -> Html:
    """A run: its verdict, the first, minimum, maximum and last value of each output, and the plot of the outputs."""
    from heavebond.pictures.plot import drawn_run, plot_signals

    outputs = list(result.assembly.model.show) or list(result.assembly.state_names)
    names = outputs[:MOST_ROWS]
    values, figures = result.signals(names), result.figures(names)
    head = ("output" if result.assembly.model.show else "state", "unit", "start", "minimum", "maximum", "end")
    rows = [_course(name, result.unit(name), float(values[name][0]), figures[name]) for name in names]
    signal_table = table(head, rows, numbers=range(2, 6))
    span = f"{number(float(result.time[0]))} to {number(float(result.time[-1]))} s, {count(len(result.time), 'point')}"
    few = names and len({result.unit(name) for name in names}) <= MOST_AXES
    points = len(names) * len(drawn_run(result, names).time) if few else 0
    picture = [_figure(plot_signals(result, names), points, "signals over time")] if few else []
    return element("div", _heading(result.assembly.model.name, span), element("p", f"Verdict: {result.verdict}"),
                   signal_table, *_more(outputs), *picture)


def saved_run_html(run: SavedRun) -> Html:
    """A run that was read from a file: the first, minimum, maximum and last value of each signal, and the plot."""
    from heavebond.numerics.extremes import signal_figures
    from heavebond.pictures.plot import plot_runs

    names = [name for name in run.names() if len(run.time)][:MOST_ROWS]
    rows = [_course(name, run.unit(name), float(run.display[name][0]), signal_figures(run.time, run.display[name]))
            for name in names]
    few = 0 < len(names) <= MOST_AXES
    picture = [_figure(plot_runs({run.model: run}, names), len(names) * len(run.time), "signals over time")] if few else []
    return element("div", _heading(run.model, count(len(run.time), "point")),
                   table(("signal", "unit", "start", "minimum", "maximum", "end"), rows, numbers=range(2, 6)),
                   *_more(run.names()), *picture)


def comparison_html(comparison: Comparison) -> Html:
    """A comparison: the tables of `heavebond compare`, and the figure if it has few axes."""
    from heavebond.pictures.plot import plot_comparison

    channels = [c for r in comparison.records.values() for c in r.channels.values()]
    points = sum(3 * len(c.time) for c in channels)
    picture = [_figure(plot_comparison(comparison), points, "records and model over time")] if len(channels) <= MOST_AXES \
        else []
    return element("div", _heading(comparison.experiment.name, count(len(comparison.records), "record")),
                   *_items(comparison_items(comparison)), *picture)


def fit_html(fit: Fit) -> Html:
    """A fit: the tables of `heavebond fit`."""
    return element("div", _heading(fit.experiment.name, fit.message), *_items(fit_items(fit)))


def items_html(name: str, words: str, items: Iterable[Item], figures: Sequence[Figure] = ()) -> Html:
    """The tables and sentences of a result, and its figures."""
    return element("div", _heading(name, words), *_items(items),
                   *(_figure(figure, MOST_POINTS + 1, name) for figure in figures))


def diagnosis_html(diagnosis: Diagnosis) -> Html:
    """A diagnosis: the answer by levels, the verdict in words, the probabilities, the errors of the models, and the
    parameters of each added effect."""
    tables = [*tree_tables(diagnosis.tree), *probability_table(diagnosis), ladder_table(diagnosis.ladder, "model"),
              *map(effect_table, diagnosis.findings), *map(effect_table, diagnosis.doubtful)]
    return element("div", _heading(diagnosis.experiment.name, f"verdict {diagnosis.verdict}"),
                   _list((*diagnosis.tree.words, *diagnosis.words)), *_items(tables))


# -- rows ----------------------------------------------------------------------------------------------------------
def _value_text(value: Value) -> str:
    """A value as written; a number that was set in Python gets the SI unit of its parameter."""
    if not (value.si and isinstance(value.expr, Number)):
        return value.text.strip()
    unit = value.expr.unit
    return f"{value.text} {dimension_text(unit.dimension)}" if unit else f"{value.text} (SI)"


def _course(name: str, unit: str, start: float, figures: SignalFigures) -> tuple[str, ...]:
    """The row of an output, in a unit suited to its largest value."""
    finite = [start, figures.least, figures.most, figures.final]
    largest = max(map(abs, finite))
    display_unit = readable_unit(unit, largest)
    source, target = read_unit(unit), read_unit(display_unit)
    return name, unit_label(display_unit), *(number(target.from_si(source.to_si(v if abs(v) > ROUNDING * largest else 0.0)),
                                                    5)
                                             for v in finite)


# -- pieces --------------------------------------------------------------------------------------------------------
def _heading(name: str, words: str) -> Html:
    return element("p", element("strong", name), f": {words}" if words else "")


def _list(words: Sequence[str]) -> Html:
    return element("ul", *(element("li", w) for w in words)) if words else Html("")


def _items(items: Iterable[Item]) -> Iterable[Html]:
    """Convert the tables, sentences and notes of `heavebond.reports.result_tables` to HTML."""
    for item in items:
        if isinstance(item, ResultTable):
            yield element("p", item.title)
            yield table(item.head, item.rows[:MOST_ROWS], numbers=range(item.text, len(item.head)))
            yield from _more(item.rows)
        elif isinstance(item, Line):
            yield element("p", item.text)
        else:
            yield _list([f"{record}: {note}" if record else note for record, note in item.rows])


def _more(rows: Sequence[object]) -> list[Html]:
    return [element("p", f"... and {len(rows) - MOST_ROWS} more")] if len(rows) > MOST_ROWS else []


def _figure(figure: Figure, points: int, alt: str) -> Html:
    """A figure as SVG, or as PNG if it has many points."""
    from matplotlib import rc_context

    svg, file = points <= MOST_POINTS, io.BytesIO()
    with rc_context({"svg.hashsalt": "heavebond", "svg.fonttype": "path"}):
        figure.savefig(file, format="svg" if svg else "png", metadata={"Date": None} if svg else None)
    return _picture(file.getvalue(), "svg+xml" if svg else "png", alt)


def _picture(data: bytes, kind: str, alt: str) -> Html:
    text = base64.b64encode(data).decode("ascii")
    return element("img", src=f"data:image/{kind};base64,{text}", alt=alt, style=WIDTH)
