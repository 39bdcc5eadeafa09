"""Notebooks: those of docs/ run from the first cell to the last, objects have HTML of their own, progress has bars."""

from __future__ import annotations

import ast
import os
import re
import signal
import sys
import threading
import time as clock
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import ClassVar
from xml.etree import ElementTree

import nbclient
import nbformat
import pytest

import heavebond as hb
from heavebond.core import reporting as core_reporting
from heavebond.diagnosis.diagnose import Diagnosis
from heavebond.diagnosis.state import ladder_entry

pytestmark = pytest.mark.long

ROOT = Path(__file__).parent.parent
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
GAINS = hb.tuning_task({"controller.K_p": "0 .. 8 1/m", "controller.K_v": "0 .. 1.2 s/m"}, "rms(crown.x)/1 m", begin="72 s")
PATIENCE = 120  # s for a cell; on a quiet machine the longest takes two


def test_there_are_three_notebooks() -> None:
    assert [path.stem for path in NOTEBOOKS] == ["compensator_gains", "first_machine", "measurements"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_kept_without_outputs(path: Path) -> None:
    cells = nbformat.read(path, as_version=4).cells
    assert not [k for k, cell in enumerate(cells) if cell.get("outputs") or cell.get("execution_count")]
    assert sum(cell.cell_type == "markdown" for cell in cells) >= 5


@pytest.mark.parametrize("path", NOTEBOOKS[:1], ids=lambda path: path.stem)
def test_the_code_of_a_notebook_runs_as_plain_python(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without Jupyter: the last expression of a cell is displayed by its own HTML, SVG or PNG."""
    monkeypatch.chdir(tmp_path)
    scope: dict[str, object] = {"__name__": "__main__"}
    shown = []
    for cell in nbformat.read(path, as_version=4).cells:
        if cell.cell_type != "code":
            continue
        tree = ast.parse(cell.source)
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) and not cell.source.rstrip().endswith(";") else None
        exec(compile(tree, path.name, "exec"), scope)
        value = eval(compile(ast.Expression(last.value), path.name, "eval"), scope) if isinstance(last, ast.Expr) else None
        shown += [kind for kind in ("html", "svg", "png") if getattr(value, f"_repr_{kind}_", lambda: None)()]
    assert {"html", "svg", "png"} <= set(shown)


# the notebook on measurements repeats the diagnosis of the tutorial on a hidden effect, which runs in every run
@pytest.mark.parametrize("path", [pytest.param(path, marks=pytest.mark.slow) if path.stem == "measurements" else path
                                  for path in NOTEBOOKS[1:]], ids=lambda path: path.stem)
def test_a_notebook_runs(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]))
    notebook = nbformat.read(path, as_version=4)
    nbclient.NotebookClient(notebook, timeout=5 * PATIENCE, resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    html = "".join("".join(output.get("data", {}).get("text/html", "")) for output in outputs)
    assert any("image/png" in output.get("data", {}) for output in outputs) and "data:image/svg+xml" in html
    assert ("<iframe" in html) == ("hb.animate" in path.read_text(encoding="utf-8"))  # the animation plays in the notebook


def pictures(html: str) -> list[str]:
    """The kinds of the pictures in a fragment of HTML, which must be well formed and free of scripts."""
    root = ElementTree.fromstring(re.sub(r"<(img|br)\b([^>]*)>", r"<\1\2/>", html))
    assert root.tag == "div" and not [e for e in root.iter() if e.tag in ("script", "style")]
    return [kind for e in root.iter("img") for kind in re.findall(r"^data:image/([a-z+]+);base64,", e.attrib["src"])]


def texts(html: str) -> str:
    return re.sub(r"<[^>]*>", " ", html)


def test_a_diagram_shows_its_drawing_and_its_parameters() -> None:
    html = hb.load("passive_rig").with_parameters({"gas.c": "40 kN/m", "damper.d": 50e3})._repr_html_()
    assert html is not None and pictures(html) == ["svg+xml"]
    assert "40 kN/m" in html and "50000.0" in html and "217 kN/m" in html


def test_text_of_a_diagram_is_escaped() -> None:
    model = hb.loads("""
model: "<script>alert(1)</script>"
summary: a & b <i>
components: {load: {is: Mass, m: 2 kg}}
nodes: {load: [load.a]}
initial: {load.v: 1 m/s}
show: {"<b>": {is: load.x, unit: mm}}
simulate: {until: 1 s, every: 0.1 s}
""")
    for html in (model._repr_html_(), hb.simulate(model)._repr_html_()):
        assert html is not None and pictures(html) == ["svg+xml"] and "&lt;script&gt;" in html and "<b>" not in html


def test_a_run_shows_its_outputs_in_their_units_and_a_plot() -> None:
    html = hb.simulate(hb.load("passive_rig"))._repr_html_()
    assert pictures(html) == ["svg+xml"]
    assert "Verdict: clean" in html and re.search(r"crown +mm +0 +-119.36 +109.63 +46.409", re.sub(r" +", " ", texts(html)))
    assert pictures(hb.simulate(hb.load("cmc_ahc"))._repr_html_()) == ["png"]  # nine outputs on 4801 points


def test_a_comparison_and_a_fit_show_errors_with_units() -> None:
    comparison = hb.compare("passive_rig/friction")
    html = comparison._repr_html_()
    assert len(pictures(html)) == 1 and "76.5 mm" in html and "validate" in html
    fit = hb.fit("passive_rig/friction", starts=1)
    html = fit._repr_html_()
    assert not pictures(html) and "kN/m" in html and "62.4 kN*s/m" in html and "at its high end" in html


def test_a_diagnosis_shows_its_verdict_and_its_ladder() -> None:
    experiment = hb.load_experiment("passive_rig/friction")
    ladder = (ladder_entry("as drawn", hb.compare(experiment)),)
    words = ("nothing <b>is</b> missing",)
    found = Diagnosis(experiment, "noise", words, ladder, (), (), (), None, None, {}, 1.0, None, experiment)
    html = found._repr_html_()
    assert not pictures(html) and "nothing &lt;b&gt;is&lt;/b&gt; missing" in html and "as drawn" in html


class FakeBar:
    """What is used of tqdm."""

    made: ClassVar[list[FakeBar]] = []

    def __init__(self, desc: str, unit: str, leave: bool):
        self.title, self.texts, self.n, self.total, self.closed = desc, [], 0, None, False
        self.made.append(self)

    def set_postfix_str(self, text: str) -> None:
        self.texts.append(text)

    def update(self, steps: int) -> None:
        self.n += steps

    def refresh(self) -> None:
        pass

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def bars(monkeypatch: pytest.MonkeyPatch) -> list[FakeBar]:
    """The bars that are made, in a notebook with tqdm."""
    fake = ModuleType("tqdm.auto")
    fake.tqdm = FakeBar
    monkeypatch.setitem(sys.modules, "tqdm.auto", fake)
    monkeypatch.setattr(core_reporting, "in_notebook", lambda: True)
    monkeypatch.setattr(FakeBar, "made", [])
    return FakeBar.made


def test_a_notebook_shows_one_bar(bars: list[FakeBar]) -> None:
    hb.compare("passive_rig/friction")
    bar, = bars
    assert (bar.title, bar.texts, bar.total, bar.closed) == ("compare", ["train", "validate"], 2, True)
    hb.errors(["passive_rig/friction"])  # compares, with no bar of its own
    assert [b.title for b in bars[1:]] == ["errors"]
    hb.fit("passive_rig/friction", free={"gas.c": "30 .. 70 kN/m"})
    assert bars[-1].title == "fit" and bars[-1].n == len(bars[-1].texts) > 2 and bars[-1].closed


def test_a_callback_takes_the_place_of_the_bar(bars: list[FakeBar]) -> None:
    said: list[str] = []
    hb.compare("passive_rig/friction", progress=said.append)
    hb.simulate(hb.load("quarter_car"))
    assert said == ["train", "validate"] and not bars


def test_outside_notebooks_and_without_tqdm_there_is_no_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    assert not core_reporting.in_notebook() and core_reporting.make_bar("fit") is None
    monkeypatch.setattr(core_reporting, "in_notebook", lambda: True)
    monkeypatch.setitem(sys.modules, "tqdm.auto", None)
    assert core_reporting.make_bar("fit") is None


def test_a_bar_of_tqdm(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(core_reporting, "in_notebook", lambda: True)
    bar = core_reporting.make_bar("fit")
    assert bar is not None
    bar("a step")
    bar.place(1, 3)
    assert (bar.bar.n, bar.bar.total) == (1, 3)
    bar.bar.close()


@pytest.mark.parametrize("call", [lambda: hb.simulate(hb.load("cmc_ahc"), "10 h", every="1 s"),
                                  lambda: hb.fit("passive_rig/friction", starts=1000),
                                  lambda: hb.tune(hb.load("cmc_ahc"), GAINS, starts=1000)])
def test_the_stop_button_ends_what_runs(call: Callable[[], object]) -> None:
    before, began = signal.getsignal(signal.SIGINT), clock.perf_counter()
    timer = threading.Timer(3.0, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            call()
    finally:
        timer.cancel()
    assert clock.perf_counter() - began < PATIENCE and signal.getsignal(signal.SIGINT) == before
    hb.simulate(hb.load("quarter_car"), "1 s")
