"""The charts of the studio: units, logarithmic axes, one signal over another, one chart alone, the layout after a reload."""

from __future__ import annotations

import json
import os
from pathlib import Path

import browser
import numpy as np
import pytest
from studio_pages import Server, server, tab
from test_studio import BALL
from test_studio_editing import _true
from test_studio_page import CAR, _open

from heavebond.records.spectra import evenly, spectrum

pytestmark = pytest.mark.long
__all__ = ["server", "tab"]
PUMPED = """\
model: pumped
components:
  pump: {is: FlowSource, u: 1 L/min}
  block: {is: Volume, V: 1 L}
  still: {is: Constant, k: 3}
nodes: {suction: [pump.a, block.a], still: [still.y]}
initial: {suction.p: 20 bar}
show: {still: {is: still.y, unit: "1"}}
simulate: {until: 2 s, every: 10 ms}
"""


BLUE = """(() => { const c = studio.runs.plots.charts[0].ctx.canvas;
  const d = c.getContext("2d").getImageData(0, 0, c.width, c.height).data;
  let n = 0; for (let k = 0; k < d.length; k += 4) if (d[k + 3] > 200 && d[k + 2] > d[k] + 60) n++;
  return n > 200; })()"""


def _shot(tab: browser.Tab, name: str) -> None:
    """A picture for the eye, if a folder is given in HEAVEBOND_SCREENSHOTS."""
    if folder := os.environ.get("HEAVEBOND_SCREENSHOTS"):
        (Path(folder) / f"{name}.png").write_bytes(tab.screenshot())


def _run(tab: browser.Tab) -> None:
    tab.key("Enter", ctrl=True, code=13)
    tab.wait("studio.runs.live && !studio.runs.busy && studio.runs.plots.charts.length", 60)


def _press(tab: browser.Tab, label: str) -> None:
    tab.run(f"document.querySelector('#plots [aria-label=\"{label}\"]').click(), 1")


def _choose(tab: browser.Tab, label: str, value: str) -> None:
    tab.run(f"""(() => {{ const box = document.querySelector('#plots [aria-label="{label}"]'); box.value = "{value}";
        box.dispatchEvent(new Event("change")); return 1; }})()""")


def test_a_constant_signal_has_a_sensible_axis(tab: browser.Tab, server: Server) -> None:
    _open(tab, server, "pumped.yaml", PUMPED)
    _run(tab)
    low, high = tab.run("[studio.runs.plots.charts[0].scales.y.min, studio.runs.plots.charts[0].scales.y.max]")
    assert low == pytest.approx(2.7) and high == pytest.approx(3.3)
    _shot(tab, "constant")
    assert tab.complaints == []


def test_unit_and_logarithmic_axis_of_a_chart(tab: browser.Tab, server: Server) -> None:
    _open(tab, server, "pumped.yaml", PUMPED)
    _run(tab)
    tab.run("studio.runs.plot('suction.p', true), 1")
    tab.wait("studio.runs.plots.charts.length === 2")
    assert tab.run("studio.runs.plots.charts.map(c => c.axes[1].label)") == ["", "bar"]
    first = tab.run("studio.runs.plots.charts[1].data[1][0]")
    assert first == pytest.approx(20)
    _choose(tab, "unit of suction.p", "Pa")
    assert tab.run("studio.runs.plots.charts[1].axes[1].label") == "Pa"
    assert tab.run("studio.runs.plots.charts[1].data[1][0]") == pytest.approx(20e5)
    _press(tab, "logarithmic axis of suction.p")
    assert tab.run("studio.runs.plots.charts[1].scales.y.distr") == 3
    assert tab.run("document.querySelector('#plots [aria-label=\"logarithmic axis of suction.p\"]').ariaPressed") == "true"
    _shot(tab, "logarithmic")
    assert tab.complaints == []


def test_one_chart_alone_and_the_layout_after_a_reload(tab: browser.Tab, server: Server) -> None:
    _open(tab, server)
    _run(tab)
    charts = tab.run("document.querySelectorAll('#plots .chart-box').length")
    assert charts > 1
    subject = tab.run("document.querySelector('#plots .chart-tools button:last-child').ariaLabel")
    _press(tab, subject)
    seen = "[...document.querySelectorAll('#plots .chart-box')].filter(b => b.checkVisibility()).length"
    assert tab.run(seen) == 1
    assert tab.run("document.querySelector('#plots .chart-box:not([hidden]) canvas').clientHeight") >= 190
    _shot(tab, "alone")
    tab.run("studio.runs.plot('damper.F', true), 1")
    _open(tab, server)
    tab.wait("studio.runs.plotted.includes('damper.F')")
    _run(tab)
    assert tab.run(seen) == 1
    _press(tab, "show all charts")
    assert tab.run(seen) > 1
    assert tab.complaints == []


def test_the_limits_of_an_axis_hold_in_every_unit(tab: browser.Tab, server: Server) -> None:
    _open(tab, server, "limited.yaml", PUMPED)
    tab.run("studio.runs.plotted = ['suction.p'], 1")
    _run(tab)

    def limit(text: str) -> None:
        tab.click(".axis-limits")
        tab.run(f"document.getElementById('ask-name').value = '{text}', 1")
        tab.click("#ask button.main")

    ends = "[studio.runs.plots.charts[0].scales.y.min, studio.runs.plots.charts[0].scales.y.max]"
    limit("40 .. 10")
    tab.wait("document.querySelector('#ask .wrong').innerText.includes('such as 0 .. 40')")
    tab.key("Escape", code=27)
    limit("10 .. 40")
    tab.wait("!document.querySelector('#ask').open && document.querySelector('.axis-limits').ariaPressed === 'true'")
    assert tab.run(ends) == [10, 40]
    _choose(tab, "unit of suction.p", "Pa")
    assert tab.run(ends) == pytest.approx([10e5, 40e5])
    window = "[studio.runs.plots.charts[0].scales.x.min, studio.runs.plots.charts[0].scales.x.max]"
    whole = tab.run(window)
    limit("1e6 .. 4e6; time 0.2 .. 0.4")
    tab.wait("studio.runs.plots.charts[0].scales.x.min === 0.2")
    assert tab.run(ends) == pytest.approx([10e5, 40e5]) and tab.run(window) == [0.2, 0.4]
    _open(tab, server, "limited.yaml", PUMPED)
    _run(tab)
    assert tab.run(window) == [0.2, 0.4]  # as when it was open before
    limit("")
    tab.wait("document.querySelector('.axis-limits').ariaPressed === 'false'")
    assert tab.run(ends) != pytest.approx([10e5, 40e5]) and tab.run(window) == whole
    assert tab.complaints == []


def test_kept_runs_are_there_after_a_reload(tab: browser.Tab, server: Server) -> None:
    _open(tab, server, "kept.yaml")
    _run(tab)
    tab.run("studio.runs.setValue('damper.d', '4 kN*s/m'), 1")
    tab.wait("!studio.runs.busy && studio.runs.live.values['damper.d']")
    tab.run("studio.runs.keep('stiff damper'), 1")
    before = tab.run("[...studio.runs.live.series.get(studio.runs.plotted[0])]")
    _open(tab, server, "kept.yaml")
    tab.wait("studio.runs.kept.length === 1 && !studio.runs.busy && studio.runs.plots.charts.length", 60)
    assert tab.run("studio.runs.kept[0].label") == "stiff damper"
    assert tab.run("[...studio.runs.kept[0].series.get(studio.runs.plotted[0])]") == before
    tab.run("document.querySelector('[aria-label=\"forget stiff damper\"]').click(), 1")
    _open(tab, server, "kept.yaml")
    tab.wait("studio.view?.svg && studio.runs.recalled")
    assert tab.run("studio.runs.kept.length + studio.runs.stored.length") == 0
    # more runs than are computed without a question
    tab.run("studio.runs.stored = [1, 2].map(k => ({label: `long ${k}`, values: {}, text: studio.editor.text, "
            "visible: true, seconds: 60})), studio.runs.remember(), 1")
    _open(tab, server, "kept.yaml")
    tab.click("#restore")
    tab.wait("studio.runs.kept.length === 2 && !studio.runs.busy", 60)
    # a run that is asked for meanwhile is not superseded by them
    tab.run("studio.runs.kept.forEach(run => run.seconds = 1), studio.runs.remember(), 1")
    _open(tab, server, "kept.yaml")
    tab.wait("studio.runs.restoring")
    tab.key("Enter", ctrl=True, code=13)
    tab.wait("studio.runs.live && studio.runs.kept.length === 2 && !studio.runs.busy", 60)
    assert tab.complaints == []


def test_charts_and_kept_runs_belong_to_the_folder(tab: browser.Tab, server: Server, tmp_path: Path) -> None:
    """Another browser shows the charts, the cursors and the kept runs; of two tabs neither loses the runs of the other."""
    _open(tab, server, "shared.yaml")
    _run(tab)
    tab.run("studio.runs.keep('first'), studio.runs.plot('damper.F', true), 1")
    tab.click("#measure")
    stored = server.folder / ".heavebond" / "shared.yaml.json"
    tab.wait("!studio.runs.storing")
    assert json.loads(stored.read_text())["kept"][0]["label"] == "first" and CAR in json.loads(stored.read_text())["texts"]
    other = browser.Tab(tmp_path / "profile", 1500, 1000)
    try:
        other.go(f"{server.address}#shared.yaml")
        other.wait("Boolean(window.studio?.runs.kept.length === 1 && !studio.runs.busy && studio.runs.plots.charts.length)",
                   60)
        assert other.run("studio.runs.plotted.includes('damper.F') && studio.runs.plots.cursors.on")
        _run(other)
        other.run("studio.runs.keep('second'), 1")
        other.wait("!studio.runs.storing")
        _run(tab)
        tab.run("studio.runs.keep('third'), 1")
        tab.wait("!studio.runs.storing && studio.runs.stored.length === 1")
        assert {run["label"] for run in json.loads(stored.read_text())["kept"]} == {"first", "second", "third"}
        tab.click("#restore")
        tab.wait("studio.runs.kept.length === 3 && !studio.runs.busy", 60)
        tab.run("document.querySelector('[aria-label=\"forget second\"]').click(), 1")
        tab.wait("!studio.runs.storing")
        assert {run["label"] for run in json.loads(stored.read_text())["kept"]} == {"first", "third"}
        assert other.complaints == []
    finally:
        other.close()
    assert tab.complaints == []


def test_listed_signals_have_values_at_the_cursor_and_are_dragged_into_charts(tab: browser.Tab, server: Server) -> None:
    _open(tab, server, "listed.yaml")
    _run(tab)
    tab.run("studio.pick('part', 'damper'), 1")
    place = "document.querySelector('.worth-now[data-signal=\"damper.F\"]')"
    tab.wait(f"{place}?.textContent.endsWith(' N')")
    tab.run("studio.animation.at(1.1), 1")
    values = tab.run("[...studio.runs.live.time].map((t, k) => [t, studio.runs.live.listed.get('damper.F')[k]])")
    instant, expected = next((t, value) for t, value in reversed(values) if t <= 1.1)
    assert float(tab.run(f"{place}.textContent").split()[0]) == pytest.approx(expected, rel=1e-3)
    assert abs(instant - 1.1) < 0.02 and tab.run(f"{place}.title") == f"at {instant:g} s"
    drag = """((name, target) => { const data = new DataTransfer();
        const row = document.querySelector(`.worth-now[data-signal="${name}"]`).closest("label");
        row.dispatchEvent(new DragEvent("dragstart", {bubbles: true, dataTransfer: data}));
        for (const kind of ["dragover", "drop"]) document.querySelector(target).dispatchEvent(new DragEvent(kind,
            {bubbles: true, cancelable: true, dataTransfer: data})); return 1; })"""
    tab.run(f"{drag}('damper.F', '#plots')")  # beside the charts: one of its own
    tab.wait("studio.runs.plots.groups.some(g => g.base === 'N#damper.F')")
    tab.run(f"{drag}('damper.a.f', '[data-chart=\"N#damper.F\"]')")
    tab.wait("studio.runs.plots.groups.find(g => g.base === 'N#damper.F').lines.length === 2")
    assert tab.complaints == []


def test_a_signal_over_another(tab: browser.Tab, server: Server) -> None:
    _open(tab, server)
    _run(tab)
    tab.run("studio.runs.plotted = ['damper.F', 'body.v'], studio.runs.complete(), 1")
    tab.wait("studio.runs.plots.charts.length === 2")
    _choose(tab, "what damper.F is drawn over", "body.v")
    tab.wait("!!studio.runs.plots.charts[0].along")
    assert tab.run("document.querySelector('#plots .chart').ariaLabel") == "damper.F over body.v"
    assert tab.run("studio.runs.plots.charts[0].axes[0].label") == "body.v [m/s]"
    ends = tab.run("[studio.runs.plots.charts[0].scales.x.min, studio.runs.plots.charts[0].scales.x.max]")
    values = np.array(tab.run("[...studio.runs.live.series.get('body.v')]"))
    assert ends[0] <= values.min() and ends[1] >= values.max() and ends[1] - ends[0] < 1.5 * np.ptp(values)
    tab.wait(BLUE)  # the line is drawn
    _shot(tab, "over")
    _choose(tab, "unit of body.v", "mm/s")  # the abscissa has the unit of the chart of its signal
    assert tab.run("studio.runs.plots.charts[0].axes[0].label") == "body.v [mm/s]"
    tab.click(".axis-limits")
    tab.run("document.getElementById('ask-name').value = '-1 .. 1; over -50 .. 100', 1")
    tab.click("#ask button.main")
    tab.wait("studio.runs.plots.charts[0].scales.x.min === -50 && studio.runs.plots.charts[0].scales.x.max === 100")
    assert tab.run("studio.runs.plots.limits") is None
    assert tab.complaints == []


def test_signals_are_searched_over_the_whole_machine(tab: browser.Tab, server: Server) -> None:
    _open(tab, server, "searched.yaml")  # a name of its own: the layout of each is kept
    tab.wait("!!document.querySelector('#find-signal')")
    tab.run("document.querySelector('#find-signal').focus(), 1")
    tab.write("damper N")
    found = tab.run("[...document.querySelectorAll('[id^=\"f-\"]')].map(box => box.id)")
    assert "f-damper.F" in found and all("damper" in name for name in found)
    assert " of " in tab.run("document.querySelector('#panel').innerText")
    tab.run("document.getElementById('f-damper.F').click(), 1")
    _run(tab)
    tab.wait("studio.runs.plotted.includes('damper.F') && studio.runs.live.series.has('damper.F')")
    assert tab.run("document.querySelector('#find-signal').value") == "damper N"
    assert tab.run("document.getElementById('f-damper.F').checked")
    _shot(tab, "search")
    tab.run("document.querySelector('#find-signal').value = 'nowhere', "
            "document.querySelector('#find-signal').dispatchEvent(new Event('input')), 1")
    assert tab.run("document.querySelectorAll('[id^=\"f-\"]').length") == 0
    assert tab.complaints == []


def test_two_cursors_measure_between_them(tab: browser.Tab, server: Server) -> None:
    """Minimum, maximum, mean and root mean square are those of the straight lines between the samples."""
    _open(tab, server, "measured.yaml")
    _run(tab)
    tab.click("#measure")
    _true(tab, "document.querySelector('#cursor-table tbody tr')")
    for which, value in (("a", "0.5"), ("b", "1.5")):
        tab.run(f"(() => {{ const f = document.getElementById('cursor-{which}'); f.value = '{value}'; f.onchange; "
                "f.dispatchEvent(new Event('change')); return 1; })()")
    assert tab.run("studio.runs.plots.cursors.times") == [0.5, 1.5]
    name, *row = tab.run("[...document.querySelector('#cursor-table tbody tr').children].map(c => c.textContent)")
    time, values = (np.array(tab.run(f"[...{what}]")) for what in (
        "studio.runs.live.time", f"studio.runs.live.series.get({name!r})"))
    inside = (time >= 0.5) & (time <= 1.5)
    t, v = time[inside], values[inside]
    wanted = [v[0], v[-1], v[-1] - v[0], v.min(), v.max(), np.trapezoid(v, t), np.sqrt(np.trapezoid(v**2, t))]
    # five digits are printed; the square of a straight line is integrated exactly in the page
    assert [float(x) for x in row[1:]] == pytest.approx(wanted, rel=2e-4, abs=1e-6)
    x, y, width = tab.run("(() => { const b = document.querySelector('.u-over').getBoundingClientRect(); "
                          "return [b.x, b.y + b.height / 2, b.width]; })()")
    tab.mouse("Pressed", x + 0.5 * width, y, button="left", clickCount=1)
    tab.mouse("Released", x + 0.5 * width, y, button="left", clickCount=1)
    _true(tab, "Math.abs(studio.runs.plots.cursors.times[1] - 2) < 0.05 && studio.runs.plots.cursors.times[0] === 0.5")
    _shot(tab, "cursors")
    tab.click("#measure")
    assert tab.run("document.querySelector('#cursor-table')") is None
    assert tab.complaints == []


def test_events_are_listed_and_lead_to_their_instant_and_part(tab: browser.Tab, server: Server) -> None:
    _open(tab, server, "ball.yaml", BALL)
    _run(tab)
    tab.click("#show-events")
    tab.wait("document.querySelectorAll('#events tbody tr').length === studio.runs.live.told.events", 60)
    tab.run("document.querySelectorAll('#events tbody button')[1].click(), 1")
    assert tab.run("studio.animation.time") == pytest.approx(0.45152, abs=1e-5)
    tab.wait("studio.picked?.path === 'stop'")
    assert "ball.v -4.4294 → 3.1006 m/s" in tab.run("document.querySelector('#events').innerText")
    _shot(tab, "events")
    tab.click("#show-events")
    assert tab.run("document.querySelector('#events').hidden") and tab.complaints == []


def test_charts_stand_beside_each_other_are_split_and_moved(tab: browser.Tab, server: Server) -> None:
    _open(tab, server, "docked.yaml")
    _run(tab)
    keys = "[...document.querySelectorAll('[data-chart]')].map(b => b.dataset.chart)"
    before = tab.run(keys)
    tab.run("(() => { const c = document.getElementById('columns'); c.value = '2'; "
            "c.dispatchEvent(new Event('change')); return 1; })()")
    _true(tab, "document.querySelectorAll('.dock.narrow').length === 1")
    tops = tab.run("[...document.querySelectorAll('[data-chart]')].slice(0, 2).map(b => b.getBoundingClientRect().top)")
    assert tops[0] == tops[1]
    tab.click("[aria-label='a chart for each signal of body']")
    _true(tab, f"{keys}.includes('m#wheel')")
    handle = f"[data-chart='{before[0]}'] .handle"
    tab.run(f"document.querySelector({handle!r}).focus()")
    tab.key("ArrowRight", code=39)
    _true(tab, f"{keys}[1] === {before[0]!r}")
    tab.click("[aria-label='wheel into the chart of its unit']")
    _true(tab, f"!{keys}.includes('m#wheel')")
    tab.run(f"document.querySelector({handle!r}).focus()")
    tab.key("ArrowRight", code=39)
    _true(tab, f"{keys}[1] === {before[0]!r}")
    moved = tab.run(keys)
    _open(tab, server, "docked.yaml")  # the layout belongs to the diagram of the folder
    _run(tab)
    assert tab.run(keys) == moved and moved != before
    tab.click("#charts-only")
    assert not tab.run("document.querySelector('#sheet').checkVisibility()")
    tab.click("#charts-only")
    assert tab.complaints == []


def test_a_formula_is_plotted_with_its_unit_and_a_spectrum_is_shown(tab: browser.Tab, server: Server) -> None:
    _open(tab, server, "derived.yaml")
    _run(tab)
    tab.click("#formula")
    tab.write("spring.F + spring.s")
    tab.key("Enter", code=13, text="\r")
    tab.wait("document.querySelector('#ask .wrong').innerText.includes('unit')", 60)
    tab.run("document.getElementById('ask-name').select()")
    tab.write("spring.F*body.v")
    tab.key("Enter", code=13, text="\r")
    tab.wait("studio.runs.live.series.has('spring.F*body.v')", 60)
    assert tab.run("studio.runs.live.units['spring.F*body.v']") == "W"
    _choose(tab, "what comfort is drawn over", "~spectrum")
    _true(tab, "studio.runs.live.spectra?.get('comfort')", 60)
    _true(tab, "studio.runs.plots.charts.some(c => c.frequency)")
    time, values = (np.array(tab.run(f"[...{what}]")) for what in (
        "studio.runs.live.time", "studio.runs.live.series.get('comfort')"))
    wanted = spectrum(evenly("comfort", "m/s**2", time, values))
    assert tab.run("[...studio.runs.live.spectra.get('comfort')[1]]") == pytest.approx(list(wanted.density[1:]))
    _shot(tab, "spectrum")
    assert tab.complaints == []
