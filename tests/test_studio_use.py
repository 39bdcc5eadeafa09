"""The studio as it is used at first: keys after a click, values that are refused, warnings that cannot be overlooked."""

from __future__ import annotations

import browser
from studio_pages import Server, server, tab
from test_studio_editing import _fill, _left, _settled, _true
from test_studio_page import CAR, _open

__all__ = ["_left", "server", "tab"]
SUCKED = """\
model: sucked
components:
  pump: {is: FlowSource, u: -1 L/min}
  block: {is: Volume, V: 1 L}
nodes: {suction: [pump.a, block.a]}
simulate: {until: 2 s, every: 10 ms}
"""


def test_keys_act_on_the_part_that_was_clicked(tab: browser.Tab, server: Server) -> None:
    _open(tab, server)
    tab.click("g.part[data-part='damper'] .frame")
    _true(tab, "studio.picked?.path === 'damper'")
    tab.key("F2", code=113)
    _true(tab, "document.activeElement.id === 'item-name'")
    tab.write("dashpot")
    tab.key("Enter", code=13, text="\r")
    _settled(tab, "studio.view.parts.dashpot")
    tab.wait("document.activeElement.getAttribute('data-part') === 'dashpot'")
    tab.key("Delete", code=46)
    _settled(tab, "!studio.view.parts.dashpot")
    tab.key("z", ctrl=True)
    tab.key("z", ctrl=True)
    _true(tab, "!studio.unsaved")
    assert tab.complaints == []


def test_a_value_that_is_refused_stays_in_its_field_with_the_reason(tab: browser.Tab, server: Server) -> None:
    _open(tab, server)
    tab.click("g.part[data-part='damper'] .frame")
    _true(tab, "document.getElementById('p-damper.d')")
    tab.run("document.getElementById('p-damper.d').focus(), document.getElementById('p-damper.d').select(), 1")
    tab.write("5 lightyears")
    tab.key("Enter", code=13, text="\r")
    tab.wait("document.querySelector('[data-parameter=\"damper.d\"] .wrong').innerText.includes('lightyears')")
    assert tab.run("document.getElementById('p-damper.d').value") == "5 lightyears"
    assert tab.run("document.getElementById('p-damper.d').getAttribute('aria-invalid')") == "true"
    assert tab.run("studio.editor.text") == CAR
    _fill(tab, "damper.d", "1.7 kN*s/m")
    assert tab.run("studio.editor.text") == CAR.replace("d: 1.5 kN*s/m", "d: 1.7 kN*s/m")
    assert tab.complaints == []


def test_a_warning_of_a_run_stands_above_its_charts_and_pressures_are_in_bar(tab: browser.Tab, server: Server) -> None:
    (server.folder / "sucked.yaml").write_text(SUCKED, encoding="utf-8")
    tab.go("about:blank")
    tab.go(server.address + "#sucked.yaml")
    _true(tab, "studio.view?.svg")
    tab.key("Enter", ctrl=True, code=13)
    _true(tab, "studio.runs.live && !studio.runs.busy && document.querySelector('#plots .verdict')", 60)
    assert "below vacuum" in tab.run("document.querySelector('#plots .verdict').innerText")
    warned, chart = (tab.run(f"document.querySelector('#plots {s}').getBoundingClientRect().y") for s in (".verdict", ".chart"))
    assert warned < chart
    assert tab.run("studio.runs.plots.charts.map(c => c.axes[1].label)") == ["bar"]
    lowest = tab.run("Math.min(...studio.runs.live.series.get('suction.p'))")
    assert abs(tab.run("Math.min(...studio.runs.plots.charts[0].data[1])") - lowest / 1e5) < 1e-9 * abs(lowest)
    assert tab.complaints == []
