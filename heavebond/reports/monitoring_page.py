"""Results of monitoring as a table and as a page."""

from __future__ import annotations

import math
from collections.abc import Mapping

from heavebond.core.presentation import number
from heavebond.monitoring.monitor import CHANGED, UNUSABLE, MonitoredRecord, Monitoring
from heavebond.pictures.markup import element, page, table
from heavebond.reports.result_tables import Item, Line, ResultTable

HEAD = ("record", "outcome", "alarm raised by", "NIS per sample", "95 % bounds", "change [s]", "95 % interval [s]",
        "alarm [s]")
ORDER = {CHANGED: 0, UNUSABLE: 1}
SHOWN = 40  # records in the table of the terminal; the page has all


def monitoring_items(monitoring: Monitoring) -> list[Item]:
    """The table of the records, those that need attention first, and the numbers of records."""
    rows = [_row(record) for record in _ordered(monitoring)]
    more = [Line(f"and {len(rows) - SHOWN} more records")] if len(rows) > SHOWN else []
    reasons = [Line(f"{record.name}: {record.reason}") for record in monitoring.unusable[:SHOWN]]
    return [ResultTable("", HEAD, rows[:SHOWN], text=3), *more, *reasons, Line(f"{monitoring.words}.")]


def monitoring_page(monitoring: Monitoring, diagnoses: Mapping[str, object]) -> str:
    """The table as a page, with a link to the picture of each record that left the model, and the answers of diagnoses."""
    marks = {CHANGED: "chosen", UNUSABLE: "alike"}
    ordered = _ordered(monitoring)
    title = f"Records of {monitoring.experiment.name}"
    answers = [element("section", element("h2", name), *(element("p", str(line)) for line in lines),
                       element("p", element("a", "report", href=f"{name}_report.html")))
               for name, lines in diagnoses.items() if isinstance(lines, list)]
    rows = [[element("a", record.name, href=f"{record.name}.png") if record.outcome == CHANGED else record.name,
             record.outcome, record.statistic or record.reason, *_row(record)[3:]] for record in ordered]
    return page(title, element("header", element("h1", title), class_="page"), element(
        "main", element("p", f"{monitoring.words}."), *answers,
        table((*HEAD[:2], "alarm raised by, or reason", *HEAD[3:]), rows, numbers=range(3, len(HEAD)),
              marks=[marks.get(r.outcome, "") for r in ordered], wide=True)))


def _ordered(monitoring: Monitoring) -> list[MonitoredRecord]:
    return sorted(monitoring.records, key=lambda r: ORDER.get(r.outcome, 2))


def _row(record: MonitoredRecord) -> tuple[str, ...]:
    def formatted(value: float, digits: int = 6) -> str:
        return number(value, digits) if math.isfinite(value) else ""

    between = f"{formatted(record.low, 4)} .. {formatted(record.high, 4)}" if math.isfinite(record.low) else ""
    interval = f"{formatted(record.earliest)} .. {formatted(record.latest)}" if math.isfinite(record.earliest) else ""
    return (record.name, record.outcome, record.statistic, formatted(record.nis, 4), between,
            formatted(record.change), interval, formatted(record.alarm))
