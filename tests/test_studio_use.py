"""The studio as it is used at first: keys after a click, values that are refused, warnings that cannot be overlooked."""

from __future__ import annotations

import browser
import pytest
from studio_pages import Server, server, tab
from test_studio_editing import _fill, _left, _settled, _true
from test_studio_page import CAR, _open

pytestmark = pytest.mark.long

__all__ = ["_left", "server", "tab"]
SUCKED = """\
model: sucked
components:
  pump: {is: FlowSource, u: -1 L/min}
  block: {is: Volume, V: 1 L}
nodes: {suction: [pump.a, block.a]}
initial: {suction.p: 20 bar}
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


def test_the_problems_of_a_failed_run_go_when_the_text_is_corrected(tab: browser.Tab, server: Server) -> None:
    _open(tab, server, "failing.yaml", CAR.replace("[spring.a, damper.a, wheel.a", "[spring.a, wheel.a", 1))
    tab.key("Enter", ctrl=True, code=13)
    _true(tab, "!studio.runs.busy && document.querySelector('#plots').innerText.includes('damper.a')", 60)
    tab.run("studio.editor.replace(studio.editor.text.replace('[spring.a, wheel.a', '[spring.a, damper.a, wheel.a')), 1")
    _true(tab, "document.querySelector('#plots').innerText.startsWith('Press Run')")
    tab.run("studio.runs.setValue('damper.d', '1e30 N*s/m'), document.getElementById('sheet').focus(), 1")
    tab.key("Enter", ctrl=True, code=13)
    _true(tab, "!studio.runs.busy && document.querySelector('#plots').innerText.includes('damper.d = 1e30 N*s/m')", 60)
    assert tab.complaints == []


def test_a_warning_of_a_run_stands_above_its_charts_and_pressures_are_in_bar(tab: browser.Tab, server: Server) -> None:
    (server.folder / "sucked.yaml").write_text(SUCKED, encoding="utf-8")
    tab.go("about:blank")
    tab.go(server.address + "#sucked.yaml")
    _true(tab, "studio.view?.svg")
    tab.key("Enter", ctrl=True, code=13)
    _true(tab, "studio.runs.live && !studio.runs.busy && document.querySelector('#plots .verdict')", 60)
    assert "below vacuum" in tab.run("document.querySelector('#plots .verdict').innerText")
    warned, chart = (tab.run(f"document.querySelector('#plots .{what}').getBoundingClientRect().y")
                     for what in ("verdict", "chart"))
    assert warned < chart
    assert tab.run("studio.runs.plots.charts.map(c => c.axes[1].label)") == ["bar"]
    lowest = tab.run("Math.min(...studio.runs.live.series.get('suction.p'))")
    assert abs(tab.run("Math.min(...studio.runs.plots.charts[0].data[1])") - lowest / 1e5) < 1e-9 * abs(lowest)
    tab.run("(() => { const find = document.getElementById('find-signal'); find.value = 'block pressure'; "
            "find.dispatchEvent(new Event('input')); })()")
    tab.wait("[...document.querySelectorAll('.worth-now')].some(value => value.textContent === '20 bar')")  # as on the chart
    assert tab.complaints == []


def test_the_tree_of_parts_unfolds_and_selects_by_keyboard(tab: browser.Tab, server: Server) -> None:
    tab.go("about:blank")
    tab.go(f"{server.address}#bundled:cmc_ahc")
    _true(tab, "studio.view?.svg", 60)
    tab.run("document.querySelector('#hierarchy summary').focus(), 1")
    tab.key("Enter", code=13, text="\r")
    _true(tab, "document.querySelectorAll('#tree li').length === Object.keys(studio.view.parts).length")
    tab.key("Tab", code=9)
    _true(tab, "document.activeElement.getAttribute('role') === 'treeitem'")
    assert _unnamed(tab) == []
    for key, code in (("End", 35), ("a", 65), ("ArrowRight", 39), ("ArrowRight", 39)):
        tab.key(key, code=code, **({"text": key} if key == "a" else {}))
    tab.key("Enter", code=13, text="\r")
    tab.wait("studio.picked.path === 'ahc.pump' && studio.view.opened.includes('ahc')")
    assert tab.run("document.activeElement.dataset.path") == "ahc.pump"
    tab.click("#tree li[data-path=cmc] .row", count=2)
    tab.wait("studio.view.opened.includes('cmc')")
    assert tab.complaints == []


def test_differences_are_listed_and_marked_on_the_drawing(tab: browser.Tab, server: Server) -> None:
    before = CAR.replace("damper:      ", "dashpot:      ").replace(", damper.", ", dashpot.").replace("22 kN/m", "20 kN/m")
    (server.folder / "before.yaml").write_text(before, encoding="utf-8")
    _open(tab, server)
    tab.click("#differences")
    _true(tab, "document.querySelector('#ask').open && document.querySelector('#other-diagram')")
    assert _unnamed(tab) == []
    tab.run("document.querySelector('#other-diagram').value = 'before.yaml', 1")
    tab.click("#ask button.main")
    _true(tab, "!document.querySelector('#ask').open && document.querySelector('.differences')")
    assert "20 kN/m → 22 kN/m" in tab.run("document.querySelector('#panel').innerText")
    assert tab.run("['damper', 'spring'].map(part => studio.diagram.group(part).classList.contains("
                   "part === 'damper' ? 'added' : 'changed'))") == [True, True]
    assert "dashpot" in tab.run("document.querySelector('.removed-parts').textContent")
    tab.click("#end-differences")
    assert tab.run("document.querySelectorAll('#sheet .added, #sheet .changed, .removed-parts').length") == 0
    assert tab.complaints == []


def test_the_tour_leads_through_all_steps_and_ends_at_any_time(tab: browser.Tab, server: Server) -> None:
    tab.go("about:blank")
    tab.go(server.address)
    _true(tab, "document.querySelector('#begin-tour')")
    tab.run("document.getElementById('begin-tour').focus(), 1")
    titles, steps = [], tab.run("studio.tour.steps.length")
    tab.key("Enter", code=13, text="\r")
    for k in range(steps):
        _true(tab, f"studio.tour.at === {k} && document.querySelector('#tour:not([aria-busy])') && "
                   "document.querySelector('.toured')", 60)
        assert k != 4 or _unnamed(tab) == []
        # a step describes what is already visible: the open block, the tabs of the comparison
        assert k != 5 or tab.run("studio.view.opened") == ["ahc"]
        assert k != 7 or tab.run("Boolean(studio.evidence.told && document.querySelector('#evidence-bar [role=tab]'))")
        assert tab.run("document.querySelector('.toured').checkVisibility()")
        titles.append(tab.run("document.getElementById('tour-title').textContent"))
        tab.wait(f"document.activeElement.id === '{'tour-end' if k == steps - 1 else 'tour-next'}'")
        tab.key("Enter", code=13, text="\r")
    tab.wait("document.querySelector('#tour').hidden && !document.querySelector('.toured')")
    assert len(set(titles)) == steps and tab.run("studio.document.name") == "bundled:cmc_ahc"
    tab.run("void studio.tour.begin()")
    tab.key("Escape", code=27)
    tab.wait("document.querySelector('#tour').hidden && studio.tour.at === -1")
    assert tab.complaints == []


def test_a_connection_that_was_lost_changes_nothing(tab: browser.Tab, server: Server) -> None:
    _open(tab, server)
    tab.run("studio.editor.replace(studio.editor.text.replace('1.5 kN*s/m', '1.6 kN*s/m'))")
    tab.run("studio.link.socket.close()")
    assert "ended" in tab.wait("!document.querySelector('#banner').hidden && document.querySelector('#banner').innerText")
    tab.wait("document.querySelector('#banner').hidden")
    assert tab.run("studio.unsaved && studio.editor.text") == CAR.replace("1.5 kN*s/m", "1.6 kN*s/m")
    tab.key("s", ctrl=True)
    tab.wait("!studio.unsaved")
    assert "1.6 kN*s/m" in (server.folder / "car.yaml").read_text(encoding="utf-8")
    assert tab.complaints == []


def _unnamed(tab: browser.Tab) -> list[str]:
    """What the keyboard reaches and a screen reader has no name for, by tag and attributes."""
    found = []
    for node in tab.call("Accessibility.getFullAXTree")["nodes"]:
        focusable = any(p["name"] == "focusable" and p["value"].get("value") for p in node.get("properties", ()))
        if focusable and not node.get("ignored") and not node.get("name", {}).get("value") and "backendDOMNodeId" in node:
            element = tab.call("DOM.describeNode", backendNodeId=node["backendDOMNodeId"])["node"]
            given = element.get("attributes", [])
            attributes = dict(zip(given[::2], given[1::2], strict=True))
            if attributes.get("tabindex") != "-1" and element["nodeName"] != "#document":
                found.append(f"{element['localName']} {attributes}")
    return found


def _walked(tab: browser.Tab, steps: int = 150) -> list[str]:
    """The stops of Tab until it comes round again; each is in view as it is reached."""
    found: list[str] = []
    for _ in range(steps):
        tab.key("Tab", code=9)
        stop, seen = tab.run("""(() => { const a = document.activeElement, box = a.getBoundingClientRect();
            const inside = box.bottom > 0 && box.right > 0 && box.top < innerHeight && box.left < innerWidth;
            return [a.id || a.getAttribute("aria-label") || a.textContent.trim() || a.tagName,
                a === document.body || a.matches(".cm-content") || (inside && a.checkVisibility())]; })()""")
        assert seen, stop
        if stop in found[:1]:
            return found
        found.append(stop)
    raise AssertionError(f"Tab is kept: {found}")


def _to(tab: browser.Tab, stop: str) -> None:
    """Go on by Tab to an element."""
    for _ in range(120):
        if tab.run("document.activeElement.id") == stop:
            return
        tab.key("Tab", code=9)
    raise AssertionError(f"Tab does not reach {stop}")


def test_everything_is_reached_and_named_by_the_keyboard(tab: browser.Tab, server: Server) -> None:
    """Home, a dialog, a diagram with its library and a run, tuning, the form of a record: all without the mouse."""
    tab.call("Accessibility.enable")
    tab.go("about:blank")
    tab.go(server.address)
    _true(tab, "document.querySelector('[data-open]')")
    assert {"new", "new-empty", "filter"} <= set(_walked(tab)) and _unnamed(tab) == []
    tab.run("document.getElementById('home').scrollTop = 0, 1")
    tab.wait("Boolean(document.querySelector('.thumbnail svg'))")
    _to(tab, "new")
    tab.key("Enter", code=13, text="\r")
    _true(tab, "document.querySelector('#ask').open && document.activeElement.id === 'ask-name'")
    assert _unnamed(tab) == []
    tab.key("Escape", code=27)
    tab.wait("!document.querySelector('#ask').open && document.activeElement.id === 'new'")
    _open(tab, server)
    tab.key("Enter", ctrl=True, code=13)
    _true(tab, "studio.runs.live && !studio.runs.busy", 60)
    tab.key("l", alt=True)
    _true(tab, "document.activeElement.id === 'palette-search' && studio.palette.components", 60)
    assert _unnamed(tab) == []
    tab.key("Escape", code=27)
    _true(tab, "document.activeElement.id === 'sheet'")
    stops = _walked(tab)
    assert {"go-home", "run", "sheet", "keep", "png", "csv", "play", "instant", "shown", "split-drawing", "damper, Damper",
            "node road", "p-height", "s-height", "run-until", "to-problems"} <= set(stops)
    assert _unnamed(tab) == []
    _to(tab, "show-keys")
    tab.key("Enter", code=13, text="\r")
    _true(tab, "document.querySelector('#keys').open")
    tab.key("Escape", code=27)
    tab.wait("!document.querySelector('#keys').open && document.activeElement.id === 'show-keys'")
    _to(tab, "tune")
    tab.key("Enter", code=13, text="\r")
    _true(tab, "document.activeElement.id === 'tab-tune' && document.querySelector('#begin-tune')")
    assert {"tab-tune", "close-tuning", "free-damper.d", "tune-cost", "begin-tune"} <= set(_walked(tab))
    assert _unnamed(tab) == []
    _to(tab, "close-tuning")
    tab.key("Enter", code=13, text="\r")
    _true(tab, "document.activeElement.id === 'tune'")
    tab.run("document.getElementById('records').focus()")
    rows = "\n".join(f"{k / 100},{k / 1000}" for k in range(100))
    tab.drop("#sheet", {"keys.csv": f"time [s],wheel.x [m]\n{rows}\n"})
    _true(tab, "document.querySelector('#record-form').open && document.activeElement.id === 'use-0'", 60)
    assert _unnamed(tab) == []
    _to(tab, "make-experiment")
    tab.key("Escape", code=27)
    tab.wait("!document.querySelector('#record-form').open && document.activeElement.id === 'records'")
    assert tab.complaints == []
