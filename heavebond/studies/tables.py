"""The results of a study as a table: a row per case and procedure, for people, for spreadsheets and for programs."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from heavebond.core.errors import Problem, UsageError
from heavebond.core.presentation import number
from heavebond.core.units import Range
from heavebond.core.writable import new_file, write_text
from heavebond.records.signal_array import xarray_module
from heavebond.studies.campaign import StudyResult
from heavebond.studies.run_case import Outcome
from heavebond.studies.study import SIMULATIONS
from heavebond.studies.uncertainty import Spread, groups, indices, occurrence_means, quantities, slopes, spreads

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

Row = list[Any]


def table(result: StudyResult) -> tuple[list[str], list[Row]]:
    """Head and rows with plain numbers (None for a missing one): the axes, the procedure, every number in its unit,
    followed by the published number and the relative difference."""
    head = [f"{axis.name} [{axis.unit.text}]" if axis.unit is not None else axis.name for axis in result.study.axes]
    head += [f"{name} [{wanted.unit.text}]" for name, wanted in _sampled(result).items()]
    head += ["procedure"] if result.study.procedures else []
    for name in result.units:
        head.append(_titled(result, name))
        for beside in result.study.beside:
            if name in beside.numbers:
                head += [f"{beside.source} {_titled(result, name)}", f"{name} off {beside.source} [%]"]
    return [*head, "problem"], [_row(result, outcome) for outcome in result.outcomes]


def _titled(result: StudyResult, name: str) -> str:
    unit = result.units[name].text
    return name if unit == "1" else f"{name} [{unit}]"


def _row(result: StudyResult, outcome: Outcome) -> Row:
    row: Row = [level.name if axis.unit is None else axis.unit.from_si(level.value)
                for axis, level in zip(result.study.axes, result.case_of(outcome).levels, strict=True)]
    row += [_plain(_point(result, outcome, name)) for name in _sampled(result)]
    row += [outcome.procedure] if result.study.procedures else []
    for name in result.units:
        row.append(_plain(result.value(outcome, name)))
        for k, beside in enumerate(result.study.beside):
            if name in beside.numbers:
                row += [_plain(result.published(outcome, name, k)), _plain(100 * result.difference(outcome, name, k))]
    return [*row, outcome.problem]


def _sampled(result: StudyResult) -> Mapping[str, Range]:
    """The parameters of the sample."""
    axis = result.study.sample
    return axis.sampling.over if axis is not None and axis.sampling is not None else {}


def _point(result: StudyResult, outcome: Outcome, name: str) -> float:
    """A parameter of the sample in its unit; NaN for the value in the diagram."""
    axis = result.study.sample
    assert axis is not None
    level = result.case_of(outcome).levels[result.study.axes.index(axis)]
    return float(_sampled(result)[name].unit.from_si(level.values.get(name, math.nan)))


def _plain(value: float) -> float | None:
    return float(f"{value:.9g}") if math.isfinite(value) else None


def shown(result: StudyResult) -> tuple[list[str], list[list[str]], int]:
    """Head, rows and the number of text columns for a terminal: published numbers with the difference in brackets, names
    without their blocks if they are unambiguous, no empty columns."""
    study = result.study
    columns = [(_axis_head(result, k), [_level(result, o, k) for o in result.outcomes]) for k in range(len(study.axes))]
    words = next((k for k, axis in enumerate(study.axes) if axis.unit is not None), len(study.axes))
    for name, wanted in _sampled(result).items():
        columns.append((f"{name.rpartition('.')[2]}\n[{wanted.unit.text}]",
                        [_number(name, _point(result, o, name)) for o in result.outcomes]))
    if len(study.procedures) > 1:
        columns.append(("procedure", [o.procedure for o in result.outcomes]))
    for name in result.units:
        columns.append((_column_head(result, name), [_number(name, result.value(o, name)) for o in result.outcomes]))
        for k, beside in enumerate(study.beside):
            columns.append((beside.source, [_published(result, o, name, k) for o in result.outcomes]))
    columns.append(("", [o.problem for o in result.outcomes]))
    filled = [(head, cells) for head, cells in columns if any(cells)]
    return [head for head, _ in filled], [list(row) for row in zip(*(cells for _, cells in filled), strict=True)], words


def _column_head(result: StudyResult, name: str) -> str:
    unit = result.units[name].text
    parts = ["simu-", "lations"] if name == SIMULATIONS else [name] if "(" in name else _clear(result, name).split(" ")
    return "\n".join([*parts, *([f"[{unit}]"] if unit != "1" else [])])


def _axis_head(result: StudyResult, k: int) -> str:
    axis = result.study.axes[k]
    name = axis.name.rpartition(".")[2]
    return f"{name}\n[{axis.unit.text}]" if axis.unit is not None and axis.unit.text != "1" else name


def _level(result: StudyResult, outcome: Outcome, k: int) -> str:
    axis, level = result.study.axes[k], result.case_of(outcome).levels[k]
    return number(axis.unit.from_si(level.value), 6) if axis.unit is not None else level.name


def _clear(result: StudyResult, name: str) -> str:
    """`K_p` of `controller.K_p`, unless another name has the same end."""
    short = name.rpartition(".")[2]
    alone = sum(name_of_other.rpartition(".")[2] == short for name_of_other in result.units) == 1
    return short if alone and not set(" (") & set(name) else name


def _number(name: str, value: float) -> str:
    return "" if math.isnan(value) else f"{value:.0f}" if name == SIMULATIONS else number(value, 4)


def _published(result: StudyResult, outcome: Outcome, name: str, source: int) -> str:
    theirs, off = result.published(outcome, name, source), result.difference(outcome, name, source)
    if math.isnan(theirs):
        return ""
    return number(theirs, 6) + (" (unstable)" if outcome.unstable else f" ({percent(off)})" if math.isfinite(off) else "")


def percent(share: float) -> str:
    """`+12 %`, on one line; `0 %` without a sign."""
    return f"{round(100 * share):+d}\u00a0%".replace("+0\u00a0", "0\u00a0")


def mode_rows(result: StudyResult) -> Iterator[tuple[str, str, str, str]]:
    """Case, frequency, damping and components of every oscillating mode."""
    for outcome in result.outcomes:
        first = True
        for mode in outcome.modes:
            if mode["swings"]:
                parts = [f"{name} {100 * share:.0f} %" for name, share in mode["components"].items() if share >= 0.05]
                yield (result.case_of(outcome).name if first else "", f"{mode['frequency']:.4g} Hz",
                       f"{mode['damping']:.3g}", ", ".join(parts[:5]))
                first = False


def stability_rows(result: StudyResult) -> Iterator[tuple[str, str, str]]:
    """Case, procedure and sentence on the stability of the tuned machine."""
    for outcome in result.outcomes:
        sentences: list[str] = outcome.stability.get("summary", [])
        sentences = sentences + [f"{name} ended at the {end} end of its range" for name, end in outcome.at_end.items()]
        for k, sentence in enumerate(sentences):
            yield (result.case_of(outcome).name if not k else "", outcome.procedure if not k else "", sentence)


def calibration_rows(result: StudyResult) -> Iterator[tuple[str, ...]]:
    """Parameter, before, calibrated, range, and the end of it if it is there."""
    calibrated, calibration = result.calibrated, result.study.calibration
    assert calibrated is not None and calibration is not None
    for name, (before, after) in calibrated.values.items():
        wanted = calibration.free[name]
        written = wanted.unit.written
        yield (name, written(before), written(after), f"{written(wanted.low)} .. {written(wanted.high)}",
               f"at its {calibrated.at_end[name]} end" if name in calibrated.at_end else "")


def residual_rows(result: StudyResult) -> Iterator[tuple[str, ...]]:
    """Quantity, case, ours, target, the relative difference, and the difference in widths."""
    assert result.calibrated is not None
    for r in result.calibrated.residuals:
        unit = result.units[r.quantity]
        yield (r.quantity, result.cases[r.case].name, number(unit.from_si(r.value), 4),
               f"{number(unit.from_si(r.target), 6)} {unit.text}".removesuffix(" 1"),
               percent((r.value - r.target) / abs(r.target)), f"{r.off:+.2f}")


def spread_rows(result: StudyResult) -> list[tuple[str, ...]]:
    """Quantity, other levels, mean with its 95 % interval, standard deviation, quantiles and extremes over the sample."""
    return [(f"{_titled(result, s.quantity)}", s.others, number(s.mean, 4),
             "" if math.isnan(s.interval[0]) else f"{number(s.interval[0], 4)} .. {number(s.interval[1], 4)}",
             *(number(v, 4) for v in (s.deviation, s.least, *s.quantiles, s.most)),
             f"{s.number}" + (f" + {s.failed} failed" if s.failed else ""))
        for s in spreads(result)]


def mean_rows(result: StudyResult) -> tuple[list[str], list[list[str]], int]:
    """Head, rows and the number of text columns: the mean of each quantity with half its 95 % interval, a row per
    combination of the other axes; empty unless a sample of independent points is taken at several of them."""
    spread_of: dict[str, dict[str, Spread]] = {}
    for spread in spreads(result):
        spread_of.setdefault(spread.others, {})[spread.quantity] = spread
    if len(spread_of) < 2 or all(math.isnan(s.interval[0]) for row in spread_of.values() for s in row.values()):
        return [], [], 0
    at = [k for k, axis in enumerate(result.study.axes) if axis is not result.study.sample]
    names = quantities(result)
    rows = []
    for combination, outcomes in groups(result):
        one = next(iter(outcomes.values()))
        row_start = [_level(result, one, k) for k in at] + ([one.procedure] if len(result.study.procedures) > 1 else [])
        for name in names:
            mean_spread = spread_of.get(combination, {}).get(name)
            half = mean_spread.mean - mean_spread.interval[0] if mean_spread is not None else math.nan
            if mean_spread is None:
                row_start.append("")
            elif not half > 0:     # one point, or the same number everywhere
                row_start.append(number(mean_spread.mean, 4))
            else:
                # the half width with one significant digit, with two where the first is 1 or 2; the mean to the same
                # decimal place
                power = math.floor(math.log10(half))
                places = max(0, (half < 3*10**power) - power)
                row_start.append(f"{mean_spread.mean:.{places}f} ± {half:.{places}f}")
        rows.append(row_start)
    head = [_axis_head(result, k) for k in at] + (["procedure"] if len(result.study.procedures) > 1 else [])
    words = next((n for n, k in enumerate(at) if result.study.axes[k].unit is not None), len(at))
    return [*head, *(_column_head(result, name) for name in names)], rows, words


def occurrence_rows(result: StudyResult) -> tuple[list[str], list[list[str]]]:
    """Head and rows of the availability, of each required comparison and of the mean of each quantity, weighted by the
    scatter diagram; a column for each combination of levels of the other axes. Empty without `occurrence:`."""
    if result.study.occurrence is None or not result.outcomes:
        return [], []
    columns = occurrence_means(result)
    rows = [[f"{text} [%]", *(number(100 * c.fulfilled[text], 4) for c in columns)] for text in columns[0].fulfilled]
    if len(rows) > 1:
        rows.append(["all of these [%]", *(number(100 * c.available, 4) for c in columns)])
    if any(c.failed for c in columns):
        rows.append(["without a result [%]", *(number(100 * c.failed, 4) for c in columns)])
    rows += [[f"mean {_titled(result, name)}", *(_number(name, c.means[name]) for c in columns)]
             for name in quantities(result)]
    return ["", *(c.others for c in columns)], rows


def index_rows(result: StudyResult) -> list[tuple[str, ...]]:
    """Quantity, other levels, parameter, Sobol indices of first and total order with their 95 % intervals."""
    return [(sobol.quantity if k == 0 else "", sobol.others if k == 0 else "", name,
             f"{sobol.first[k]:.3f}", _interval(sobol.first_interval[k]), f"{sobol.total[k]:.3f}",
             _interval(sobol.total_interval[k]))
            for sobol in indices(result) for k, name in enumerate(sobol.parameters)]


def _interval(ends: tuple[float, float]) -> str:
    return f"{ends[0]:.2f} .. {ends[1]:.2f}"


def slope_rows(result: StudyResult) -> list[tuple[str, ...]]:
    """Quantity, other levels, parameter, change by 1 % more of it, and its share of the variance to first order."""
    return [(_titled(result, slope.quantity) if k == 0 else "", slope.others if k == 0 else "", name,
             f"{slope.percent[k]:+.3g}", f"{slope.swing[k]:+.3g}", f"{100 * slope.share[k]:.1f} %")
            for slope in slopes(result) for k, name in enumerate(slope.parameters)]


# -- files -------------------------------------------------------------------------------------------------------------
def write_files(result: StudyResult, folder: Path) -> list[Path]:
    """Write table.csv, study.json, and signals.csv if there are signals; returns their paths."""
    head, rows = table(result)
    files: dict[str, str] = {"table.csv": _csv([head, *rows]),
             "study.json": json.dumps(as_dict(result), indent=1, ensure_ascii=False) + "\n"}
    if any(outcome.signals for outcome in result.outcomes):
        # case, procedure, time and signals, one row per time: cases may have different times
        names = result.study.signals
        units = next((o.signal_units for o in result.outcomes if o.signals), {})
        signal_rows: list[Row] = [["case", "procedure", "time [s]",
                                        *(f"{name} [{units.get(name, '1')}]" for name in names)]]
        for outcome in result.outcomes:
            case = result.case_of(outcome).name
            for k, time in enumerate(outcome.time):
                signal_rows.append([case, outcome.procedure, time, *(outcome.signals[name][k] for name in names)])
        files["signals.csv"] = _csv(signal_rows)
    try:
        for name, content in files.items():
            write_text(folder / name, content)
    except OSError as error:
        raise UsageError([Problem("file-unwritable", f"'{folder}' cannot be written: {error.strerror or error}")]) from None
    return [folder / name for name in files] + _parquet(result, folder)


def to_pandas(result: StudyResult) -> pd.DataFrame:
    """The table of a study, a row per case and procedure."""
    import pandas as pd

    head, rows = table(result)
    return pd.DataFrame(rows, columns=head)


def to_xarray(result: StudyResult) -> xr.Dataset:
    """The numbers of a study as a dataset, see `StudyResult.to_xarray`."""
    xarray, study = xarray_module(), result.study
    dims = [axis.name if axis.sampling is None else "sample" for axis in study.axes]
    coordinates: dict[str, Any] = {}
    for name, axis in zip(dims, study.axes, strict=True):
        if axis.sampling is not None:
            for parameter, wanted in axis.sampling.over.items():
                values = [float(wanted.unit.from_si(level.values.get(parameter, math.nan))) for level in axis.levels]
                coordinates[parameter] = ("sample", values, {"units": wanted.unit.text})
        elif axis.unit is not None:
            coordinates[name] = (name, [float(axis.unit.from_si(level.value)) for level in axis.levels],
                                 {"units": axis.unit.text})
        else:
            coordinates[name] = (name, [level.name for level in axis.levels])
    procedures = [procedure.name for procedure in study.procedures]
    if len(procedures) > 1:
        dims, coordinates["procedure"] = [*dims, "procedure"], ("procedure", procedures)
    shape = [len(axis.levels) for axis in study.axes] + ([len(procedures)] if len(procedures) > 1 else [])

    def index(outcome: Outcome) -> tuple[int, ...]:
        case_index = tuple(result.case_of(outcome).index)
        return (*case_index, procedures.index(outcome.procedure)) if len(procedures) > 1 else case_index

    arrays: dict[str, Any] = {}
    for name, unit in result.units.items():
        numbers = np.full(shape, np.nan)
        for outcome in result.outcomes:
            numbers[index(outcome)] = result.value(outcome, name)
        arrays[name] = (dims, numbers, {"units": unit.text})
    times = {outcome.time for outcome in result.outcomes if outcome.time}
    if len(times) == 1:
        time, = times
        coordinates["time"] = ("time", list(time), {"units": "s"})
        for name in study.signals:
            courses = np.full((*shape, len(time)), np.nan)
            for outcome in result.outcomes:
                if name in outcome.signals:
                    courses[index(outcome)] = outcome.signals[name]
            unit_text = next((o.signal_units[name] for o in result.outcomes if name in o.signal_units), "1")
            arrays[name] = ([*dims, "time"], courses, {"units": unit_text})
    dataset: xr.Dataset = xarray.Dataset(arrays, coordinates, {"study": study.name})
    return dataset


def _parquet(result: StudyResult, folder: Path) -> list[Path]:
    """Write table.parquet if pyarrow is installed."""
    if find_spec("pyarrow") is None:
        return []
    path = folder / "table.parquet"
    with new_file(path) as fresh:
        to_pandas(result).to_parquet(fresh, engine="pyarrow", index=False)
    return [path]


def _csv(rows: Sequence[Sequence[Any]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([["" if cell is None else cell for cell in row] for row in rows])
    return text.getvalue()


def as_dict(result: StudyResult) -> dict[str, Any]:
    """All results except signals, for programs: the same files give the same result."""
    head, rows = table(result)
    return {"study": result.study.name, "summary": result.study.summary, "complete": result.complete,
            "axes": [axis.name for axis in result.study.axes],
            "spreads": [asdict(s) for s in spreads(result)], "indices": [asdict(i) for i in indices(result)],
            "slopes": [asdict(s) for s in slopes(result)],
            "occurrence": [asdict(m) for m in occurrence_means(result)] if result.study.occurrence is not None else [],
            "calibrated": result.calibrated.as_dict() if result.calibrated is not None else None,
            "rows": [dict(zip(head, row, strict=True)) for row in rows],
            "cases": [{"case": result.case_of(o).name, "procedure": o.procedure, "values": dict(o.values),
                       "limits": dict(o.limits), "stability": dict(o.stability), "at_end": dict(o.at_end),
                       "message": o.message, "modes": list(o.modes), "problem": o.problem, "outside": o.outside,
                       "solver": o.solver}
                      for o in result.outcomes]}
