"""The page of a diagnosis: complete, safe, the same each time, and alive in a real browser."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from browser import Tab, browser

from heavebond.core.presentation import number, readable
from heavebond.diagnosis.answer.ranking import BY_KEY, entries
from heavebond.diagnosis.answer.verdict import without_effects
from heavebond.diagnosis.diagnose import Diagnosis, diagnose
from heavebond.diagnosis.state import channel_errors, parameter_description, restrictions
from heavebond.experiment_design.separation import Alternative, separate
from heavebond.localise.misfit import Localization, localize
from heavebond.pictures.markup import data_block, element, escaped
from heavebond.reports.report import report
from heavebond.reports.report_charts import ticks
from heavebond.reports.report_series import pack, thinned

HOSTILE = "<script>alert(1)</script>\"' onload=x \u2028 </title> &amp; \x00"
OPEN = {"meta", "br"}


@pytest.fixture(scope="module")
def found() -> Diagnosis:
    return diagnose("receiver_rig/choked", classes=["choked flow"], number=1)


@pytest.fixture(scope="module")
def failing(found: Diagnosis) -> Localization:
    return localize(found.experiment, values=found.fitted)


@pytest.fixture(scope="module")
def page(found: Diagnosis, failing: Localization) -> str:
    return report(found, failing)


class Tree(HTMLParser):
    """Checks that every element is closed in its turn; keeps texts, attributes and scripts."""

    def __init__(self, text: str):
        super().__init__(convert_charrefs=True)
        self.stack: list[str] = []
        self.attributes: list[tuple[str, str, str]] = []
        self.texts: list[str] = []
        self.scripts: list[tuple[str, str]] = []
        self.feed(text)
        self.close()
        assert not self.stack, self.stack

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.attributes += [(tag, name, value or "") for name, value in attrs]
        if tag == "script":
            self.scripts.append((dict(attrs).get("type") or "", ""))
        if tag not in OPEN:
            self.stack.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.attributes += [(tag, name, value or "") for name, value in attrs]

    def handle_endtag(self, tag: str) -> None:
        assert self.stack and self.stack.pop() == tag, f"</{tag}> closes nothing"

    def handle_data(self, data: str) -> None:
        if self.stack and self.stack[-1] == "script":
            kind, text = self.scripts[-1]
            self.scripts[-1] = (kind, text + data)
        elif "style" not in self.stack:
            self.texts.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.texts).split())


# -- what it says ------------------------------------------------------------------------------------------------------
@pytest.mark.long
def test_every_element_is_closed(page: str) -> None:
    tree = Tree(page)
    names = [value for _, name, value in tree.attributes if name == "id"]
    assert len(names) == len(set(names))
    targets = [value[1:] for tag, name, value in tree.attributes if tag == "a" and name == "href"]
    assert set(targets) <= set(names)


@pytest.mark.long
def test_verdict_ladder_and_ranking_are_told(found: Diagnosis, page: str) -> None:
    text = Tree(page).text
    assert all(" ".join(line.split()) in text for line in found.words)
    for rung in found.ladder:
        assert f"{100 * rung.error_held_out:.3g} %" in text
    for entry in entries(found.steps[0])[:len(found.steps[0].trials)]:
        assert f"{entry['class']} {entry['effect']} {entry['place']}" in text
        assert BY_KEY["chi2_held_out"].text(entry) in text
    for title in ("The machine", "Records and models", "Errors of the models", "Where the diagram fails", "Parameters",
                  "Residual", "What was tried", "How to go on"):
        assert title in text


def test_errors_stand_in_channel_units_beside_the_noise(found: Diagnosis, page: str) -> None:
    """A share of what was measured may be small and many times the noise: the top of the page says both. The errors before
    are those of the fitted model without the effect."""
    text = Tree(page).text
    fitted = without_effects(found.ladder, found.added)
    assert fitted is found.ladder[-2]
    for before, after in zip(channel_errors(fitted), channel_errors(found.ladder[-1]), strict=True):
        channels = [part.channels[before.channel] for part in fitted.comparison.parts if part.use != "fit"]
        assert before.error == pytest.approx(np.sqrt(np.mean([c.error**2 for c in channels])), rel=0.1)
        noise = readable(after.noise, after.unit, 3)
        assert f"{before.channel}: rms error, on records held out {before.words} → {after.words} noise {noise}" in text
        assert f"{before.channel} {before.words} to {after.words} (noise {noise})" in found.words[1]
    for parameter in found.findings[0].parameters:
        assert f"{parameter.name} {parameter_description(found.findings[0].fit, parameter.name)}" in text
    assert f"Limits of this law: {restrictions(found.findings[0])}" in text


def test_sections_that_have_nothing_to_say_are_left_out(found: Diagnosis) -> None:
    text = Tree(report(replace(found, fitted=None, findings=(), verdict="undetermined"))).text
    assert "Where the diagram fails" not in text
    assert "fitted alone" not in text


@pytest.mark.parametrize("verdict", ["nothing", "parameters", "one_of", "shape", "undetermined"])
def test_every_verdict_has_its_page(found: Diagnosis, verdict: str) -> None:
    only = replace(found, verdict=verdict, findings=found.findings if verdict in ("one_of", "shape") else (),
                   ladder=found.ladder[:2] if verdict in ("nothing", "parameters") else found.ladder)
    Tree(report(only))


def test_what_cannot_be_told_apart_comes_with_what_to_record_next(found: Diagnosis) -> None:
    trials = found.steps[0].trials[:2]
    apart = separate([Alternative(t.candidate.label, t.experiment, t.values, t.samples) for t in trials])
    unsure = replace(found.findings[0], alternatives=trials)
    text = Tree(report(replace(found, verdict="one_of", findings=(unsure,), separation=apart))).text
    assert "What to record next" in text
    assert all(line in text for line in apart.words)
    assert apart.best is not None
    assert number(apart.best.pairs[0].chi2, 4) in text
    assert "heavebond try receiver_rig/choked inlet.b_cr" in text
    assert "heavebond try receiver_rig/choked outlet.b_cr" in text


def test_files_that_were_written_are_gone_on_with(found: Diagnosis) -> None:
    text = Tree(report(found, written=[Path("found/choked_2.yaml")])).text
    assert "heavebond diagnose found/choked_2.yaml" in text


def test_the_same_diagnosis_gives_the_same_page(found: Diagnosis, failing: Localization, page: str) -> None:
    assert report(found, failing) == page


# -- what it must not do -----------------------------------------------------------------------------------------------
def test_nothing_is_fetched(page: str) -> None:
    tree = Tree(page)
    policy = next(value for tag, name, value in tree.attributes if tag == "meta" and "default-src" in value)
    assert policy.startswith("default-src 'none'")
    assert "unsafe" not in policy
    assert not [a for a in tree.attributes if a[1] in ("src", "srcset", "action", "style") or a[1].startswith("on")]
    assert all(value.startswith("#") for _, name, value in tree.attributes if name in ("href", "xlink:href"))
    # names of XML dialects are no addresses
    assert set(re.findall(r"https?://[^\s\"'<>]*", page)) <= {"http://www.w3.org/2000/svg"}
    assert "eval(" not in page
    assert "url(http" not in page


def test_hostile_names_stay_text(found: Diagnosis) -> None:
    model = replace(found.experiment.model, name=HOSTILE, summary=HOSTILE)
    experiment = replace(found.experiment, name=HOSTILE, model=model)
    record = next(iter(found.ladder[-1].comparison.records.values()))
    hostile = replace(record, notes=(HOSTILE,), file=Path(HOSTILE.replace("/", "").replace("\0", "")))
    last = replace(found.ladder[-1], name=HOSTILE, comparison=replace(
        found.ladder[-1].comparison, records={**found.ladder[-1].comparison.records, record.name: hostile}))
    text = report(replace(found, experiment=experiment, words=(HOSTILE, HOSTILE), ladder=(*found.ladder[:-1], last)))
    tree = Tree(text)
    assert [kind for kind, _ in tree.scripts] == ["application/json", ""]
    assert not [a for a in tree.attributes if a[1].startswith("on")]
    assert "<script>alert" not in text
    assert "\u2028" not in tree.scripts[0][1]
    assert json.loads(tree.scripts[0][1])[0]["charts"][0]["models"][-1]["label"] == HOSTILE


def test_markup_escapes_what_is_put_into_it() -> None:
    assert element("p", "<b>", title='"x"') == '<p title="&quot;x&quot;">&lt;b&gt;</p>'
    assert escaped("a\x00b\ud800") == "a\ufffdb\ufffd"
    block = data_block("d", {"a": "</script>\u2028<!--"})
    assert block.count("<") == 2 and "\u2028" not in block
    assert json.loads(block[block.index(">") + 1:block.rindex("<")]) == {"a": "</script>\u2028<!--"}


# -- numbers for the script --------------------------------------------------------------------------------------------
def _unpacked(packed: dict[str, object]) -> np.ndarray:
    return packed["o"] + packed["q"] * np.cumsum(packed["d"])


def test_packed_values_come_back_to_half_a_quantum() -> None:
    values = np.random.default_rng(1).normal(size=1000).cumsum()
    assert np.max(np.abs(_unpacked(pack(values, 1e-3)) - values)) <= 0.5e-3 + 1e-9


def test_thinning_loses_no_peak() -> None:
    rng = np.random.default_rng(2)
    measured, model = rng.normal(size=50_000), np.zeros(50_000)
    measured[[123, 40_000]] = 50, -60
    always = np.zeros(50_000, dtype=bool)
    always[777] = True
    kept = thinned(measured, [model], always, 2000)
    assert {0, 123, 777, 40_000, 49_999} <= set(kept.tolist())
    assert len(kept) <= 2003
    assert np.all(np.diff(kept) > 0)


def test_gaps_stay_open_and_held_out_stretches_are_marked(found: Diagnosis) -> None:
    comparison = found.ladder[-1].comparison
    records = {}
    for name, record in comparison.records.items():
        channels = {}
        for key, c in record.channels.items():
            keep = (c.time < 20) | (c.time > 30)
            channels[key] = replace(c, time=c.time[keep], measured=c.measured[keep], model=c.model[keep],
                                    counts=c.counts[keep], outlier=c.outlier[keep], astray=c.astray[keep])
        part = {key: replace(c, counts=(c.time > 50) & (c.time < 60)) for key, c in channels.items()}
        records[name] = replace(record, channels=channels, validate=replace(record, channels=part, use="validate"))
    last = replace(found.ladder[-1], comparison=replace(comparison, records=records))
    text = report(replace(found, ladder=(last,), findings=(), verdict="nothing"))
    chart = json.loads(Tree(text).scripts[0][1])[0]["charts"][0]
    time = _unpacked(chart["time"])
    (gap,) = chart["breaks"]
    assert time[gap] == pytest.approx(20, abs=0.1)
    assert time[gap + 1] == pytest.approx(30, abs=0.1)
    assert chart["held"] == [[pytest.approx(50, abs=0.1), pytest.approx(60, abs=0.1)]]


def test_a_long_record_stays_a_page(found: Diagnosis) -> None:
    """Half a million samples: below 3 MB, and the largest of them is still there."""
    ladder = []
    for rung in found.ladder:
        records = {}
        for name, record in rung.comparison.records.items():
            channels = {}
            for key, c in record.channels.items():
                n = 250_000
                measured = np.resize(c.measured, n)
                measured[99_999] = 9e6
                channels[key] = replace(c, time=np.arange(n) * 0.01, measured=measured, model=np.resize(c.model, n),
                                        counts=np.ones(n, dtype=bool), outlier=np.zeros(n, dtype=bool),
                                        astray=np.zeros(n, dtype=bool))
            records[name] = replace(record, channels=channels)
        ladder.append(replace(rung, comparison=replace(rung.comparison, records=records)))
    text = report(replace(found, ladder=tuple(ladder)))
    assert len(text) < 3_000_000
    chart = json.loads(Tree(text).scripts[0][1])[0]["charts"][0]
    assert chart["unit"] == "bar"
    assert max(_unpacked(chart["measured"])) == pytest.approx(90, rel=1e-6)


@pytest.mark.parametrize(("low", "high", "expected"), [(0, 1, [0, 0.2, 0.4, 0.6, 0.8, 1.0]), (-70, 130, [-50, 0, 50, 100])])
def test_ticks_are_round(low: float, high: float, expected: list[float]) -> None:
    assert ticks(low, high, 5) == pytest.approx(expected)


# -- in a browser ------------------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def tab(page: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Tab]:
    if browser() is None:
        pytest.skip("no Chromium is installed")
    folder = tmp_path_factory.mktemp("browser")
    (folder / "report.html").write_text(page, encoding="utf-8")
    opened = Tab(folder / "profile")
    opened.open(folder / "report.html")
    yield opened
    opened.close()


SPAN = "(() => { const s = document.querySelector('svg.series'); return [+s.dataset.from, +s.dataset.to]; })()"
PATH = "document.querySelector('svg.series path.model').getAttribute('d')"
MIDDLE = """(() => { const s = document.querySelector('svg.series'); s.scrollIntoView({block: 'center'});
  const b = s.getBoundingClientRect(); return [b.left, b.top + 60, b.width]; })()"""


def test_the_page_loads_without_complaint_and_without_a_request(tab: Tab) -> None:
    assert not tab.complaints
    assert [url for url in tab.requested() if not url.startswith("file:")] == []
    assert len(tab.requested()) == 1
    channels, records = 1, 2
    assert tab.run("document.querySelectorAll('svg.series path.record').length") == channels * records
    # nothing hangs over the edge of the window
    assert tab.run("document.documentElement.scrollWidth <= window.innerWidth")


def test_dragging_zooms_and_a_double_click_shows_all(tab: Tab) -> None:
    whole, drawn = tab.run(SPAN), tab.run(PATH)
    left, y, width = tab.run(MIDDLE)
    tab.mouse("Moved", left + 0.4 * width, y)
    tab.mouse("Pressed", left + 0.4 * width, y, button="left", clickCount=1)
    tab.mouse("Moved", left + 0.6 * width, y, button="left")
    tab.mouse("Released", left + 0.6 * width, y, button="left", clickCount=1)
    begin, end = tab.run(SPAN)
    assert whole[0] < begin < end < whole[1]
    # a fifth of the width of the picture, whose margins take some 7 %
    assert (end - begin) / (whole[1] - whole[0]) == pytest.approx(0.2 / 0.93, rel=0.05)
    assert tab.run(PATH) != drawn
    for count in (1, 2):
        tab.mouse("Pressed", left + 0.5 * width, y, button="left", clickCount=count)
        tab.mouse("Released", left + 0.5 * width, y, button="left", clickCount=count)
    assert tab.run(SPAN) == whole
    assert tab.run(PATH) == drawn


def test_the_wheel_zooms_about_the_pointer_and_buttons_move(tab: Tab) -> None:
    whole = tab.run(SPAN)
    left, y, width = tab.run(MIDDLE)
    frames = "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(1))))"
    tab.run("document.activeElement.blur()")
    tab.mouse("Wheel", left + 0.5 * width, y, deltaX=0, deltaY=-1)
    tab.run(frames)
    assert tab.run(SPAN) == whole, "the wheel belongs to the page until the chart is clicked"
    tab.run("document.querySelector('svg.series').focus({preventScroll: true})")
    left, y, width = tab.run(MIDDLE)
    tab.mouse("Wheel", left + 0.5 * width, y, deltaX=0, deltaY=-400)
    tab.run(frames)
    zoomed = tab.run(SPAN)
    assert zoomed[1] - zoomed[0] < 0.7 * (whole[1] - whole[0])
    tab.run("document.querySelector('button[data-do=on]').click()")
    moved = tab.run(SPAN)
    assert moved[0] > zoomed[0] and moved[1] - moved[0] == pytest.approx(zoomed[1] - zoomed[0])
    tab.run("document.querySelector('button[data-do=whole]').click()")
    assert tab.run(SPAN) == whole


def test_a_model_can_be_switched_off_and_values_are_read_off(tab: Tab) -> None:
    count = "document.querySelector('svg.series').querySelectorAll('path.model').length"
    before = tab.run(count)
    button = "document.querySelector('button[data-model][aria-pressed=true]')"
    tab.run(f"window.pressed = {button}; window.pressed.click()")
    assert tab.run(count) < before
    tab.run("window.pressed.click()")
    assert tab.run(count) == before
    left, y, width = tab.run(MIDDLE)
    tab.mouse("Moved", left + 0.5 * width, y)
    said = tab.run("document.querySelector('figure[data-chart] output').textContent")
    assert re.match(r"[\d.]+ s  \|  record [\d.]+  \|  ", said)
    assert not tab.complaints


def test_it_fits_a_narrow_screen(tab: Tab) -> None:
    tab.call("Emulation.setDeviceMetricsOverride", width=390, height=800, deviceScaleFactor=1, mobile=False)
    tab.run("new Promise(done => setTimeout(done, 100))")
    assert tab.run("document.documentElement.scrollWidth <= 390")
    tab.call("Emulation.clearDeviceMetricsOverride")
