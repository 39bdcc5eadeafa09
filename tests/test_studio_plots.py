"""The charts of the studio: units, logarithmic axes, one signal over another, one chart alone, the layout after a reload."""

from __future__ import annotations

import os
from pathlib import Path

import browser
import numpy as np
import pytest
from studio_pages import Server, server, tab
from test_studio_page import _open

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
