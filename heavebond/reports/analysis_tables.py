"""Results of `modes`, `sensitivity`, `energy` and `signal` as tables and lines, for the terminal and for notebooks."""

from __future__ import annotations

from heavebond.core.presentation import count, number, readable
from heavebond.energy_audit.audit import EnergyAudit, table
from heavebond.linear.held_variables import clock_lines, held_lines, sampled_lines
from heavebond.linear.linearisation import Mode
from heavebond.linear.modes import Modes
from heavebond.linear.sampled import sampled_words
from heavebond.optimise.influence import Ranking, Rankings
from heavebond.records.spectra import SignalAnalysis
from heavebond.reports.result_tables import Item, Line, ResultTable

LEAST = 0.05  # smaller shares are not listed
MOST = 4
ROWS = 15  # parameters listed for each signal
INFLUENCE = ("parameter", "value", "influence", "1 % more moves it by", "at")


# -- modes -------------------------------------------------------------------------------------------------------------
def modes_items(found: Modes) -> list[Item]:
    """The modes with their frequency, damping and components, and the sentences on stability and held variables."""
    modes = found.modes
    first = [(_frequency(mode), *((f"{mode.damping:.4g}", f"{-mode.value.real:.4g} 1/s") if mode.value else ("", "")))
             for mode in modes]
    states = modes[0].states if found.period is not None and modes else found.states
    title = f"{found.model} {found.at}, {count(len(states), 'state')}"
    if found.period is None:
        rows = [(*begin, named(share.energy or mode.participation), named(share.damping))
                for begin, mode, share in zip(first, modes, found.shares, strict=True)]
        items: list[Item] = [ResultTable(title, ("frequency", "damping", "decay", "energy in", "damping contribution"), rows,
                                         5)]
    else:
        rows = [(*begin, _pole(mode), named(mode.participation)) for begin, mode in zip(first, modes, strict=True)]
        items = [ResultTable(f"{title}, {sampled_words(found.period)}", ("frequency", "damping", "decay", "z", "states"),
                             rows, 5)]
    items += map(Line, (*found.words, *sampled_lines(found.sampled),
                        *clock_lines(found.clocks if found.sampled else ())))
    items += (Line(note, highlight=True) for note in (*held_lines(found.held), *found.notes, found.filled) if note)
    if found.shares and found.shares[0].left_out:
        items.append(Line(f"not counted (described by mass and temperature): {', '.join(found.shares[0].left_out)}"))
    return items


def _frequency(mode: Mode) -> str:
    if not mode.value:
        return "free"
    return f"{mode.frequency:.4g} Hz" if mode.swings else "non-oscillatory"


def _pole(mode: Mode) -> str:
    """`0.9973 ± 0.06718j`."""
    z = mode.z or 0j
    return f"{z.real:.4g} ± {z.imag:.4g}j" if z.imag else f"{z.real:.4g}"


def named(shares: dict[str, float]) -> str:
    """The largest shares; if each is small, the shares of the blocks of the diagram."""
    largest = _large(shares)
    if not largest and shares:
        blocks: dict[str, float] = {}
        for name, share in shares.items():
            blocks[name.partition(".")[0]] = blocks.get(name.partition(".")[0], 0.0) + share
        largest = _large(dict(sorted(blocks.items(), key=lambda item: -abs(item[1]))))
    return ", ".join(f"{name} {100 * share:.0f} %" for name, share in largest)


def _large(shares: dict[str, float]) -> list[tuple[str, float]]:
    return [(name, share) for name, share in shares.items() if abs(share) >= LEAST][:MOST]


# -- sensitivity -------------------------------------------------------------------------------------------------------
def sensitivity_items(rankings: Rankings, rows: int = ROWS) -> list[Item]:
    """The parameters with the largest influence on each signal."""
    items: list[Item] = [_influences(ranking, rows) for ranking in rankings.rankings]
    if rankings.left_out:
        items.append(Line(f"{len(rankings.left_out)} more parameters were not tried; add --most "
                          f"{rankings.tried + len(rankings.left_out)}: {', '.join(rankings.left_out)}"))
    return [*items, *([Line(f"Run {rankings.filled}", highlight=True)] if rankings.filled else [])]


def _influences(ranking: Ranking, rows: int) -> ResultTable:
    size = f"rms {readable(ranking.size, ranking.unit, 3)} " + ("(it stands still)" if ranking.still else "about its mean")
    return ResultTable(f"{ranking.signal}: {size}", INFLUENCE, [
        (i.parameter, readable(i.value, i.unit.text, 4), number(i.relative, 3),
         readable(i.peak / 100, ranking.unit, 3) if i.peak else "-", f"{number(i.time, 4)} s" if i.peak else "-")
        for i in ranking.influences[:rows]])


# -- energy ------------------------------------------------------------------------------------------------------------
def energy_items(found: EnergyAudit) -> list[Item]:
    """The energies of the components, and the notes on them."""
    made = table(found)
    rows = list(zip(*([str(cell) for cell in column.cells] for column in made.columns), strict=True))
    shown = ResultTable(str(made.title), [str(column.header) for column in made.columns], rows)
    return [shown, *map(Line, filter(None, str(made.caption or "").splitlines()))]


# -- signal ------------------------------------------------------------------------------------------------------------
def signal_items(one: SignalAnalysis) -> list[Item]:
    """Mean, spectrum, waves and load cycles of a signal."""
    unit, values = one.course.unit, one.as_dict()
    rows = [("mean", "mean", unit), ("deviation", "standard deviation", unit), ("least", "least", unit),
            ("most", "most", unit), ("significant", "spectrum: significant height, 4 sqrt(m0)", unit),
            ("peak_period", "spectrum: peak period", "s"), ("mean_period", "spectrum: mean period, m0/m1", "s"),
            ("crossing_period", "spectrum: crossing period, sqrt(m0/m2)", "s"), ("waves", "waves", ""),
            ("wave_period", "waves: mean period", "s"), ("highest_third", "waves: mean height of the highest third", unit),
            ("period_of_highest_third", "waves: mean period of these", "s"), ("highest_wave", "waves: the highest", unit),
            ("cycles", "rainflow: cycles", ""), ("largest_range", "rainflow: largest range", unit),
            ("equivalent_range", f"rainflow: equivalent range at 1 Hz, slope {one.slope:g}", unit)]
    shown = [(words, number(float(str(values[key])), 4), of) for key, words, of in rows if values.get(key) is not None]
    title = f"{one.course.name}, {one.course.time[0]:g} to {one.course.time[-1]:g} s"
    return [ResultTable(title, ("", "value", "unit"), shown), *([Line(one.course.note)] if one.course.note else [])]
