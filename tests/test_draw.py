"""Drawings of diagrams: everything is named once, nothing covers anything, nothing in a file or a name can act."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from click.testing import CliRunner
from collected import for_each
from matplotlib.image import imread

import heavebond as hb
from heavebond.cli import main
from heavebond.core.errors import HeavebondError
from heavebond.equations.connect import connect
from heavebond.equations.expand import expand
from heavebond.language.library import bundled, library
from heavebond.pictures import pictograms, placement
from heavebond.pictures.drawing import WARNING
from heavebond.pictures.layout import Drawn, Options, lay_out
from heavebond.pictures.routing import route
from heavebond.pictures.sheets import Sheet, opened_blocks, sheet
from heavebond.pictures.text_metrics import NAME, Box, text_width

SVG = "{http://www.w3.org/2000/svg}"
BUNDLED = sorted(f"{path.parent.name}/{path.stem}" for path in bundled("models").glob("*/*.yaml")
                 if path.read_text(encoding="utf-8").startswith("model:"))
MACHINES = [name for name in BUNDLED if len(set(name.split("/"))) == 1]  # the variants differ in their numbers
RIG = """
model: rig
summary: A load on a spring and a damper.
components:
  sea:    {is: RegularSea, a: 0.2 m, T: 8 s, t_r: 4 s}
  deck:   {is: PositionSource}
  spring: {is: Spring, c: 40 kN/m}
  damper: {is: Damper, d: 8 kN*s/m}
  load:   {is: Mass, m: 1.2 t}
  thrust: {is: ForceSource, u: "=-3 kN*s/m * load.v"}
nodes:
  heave:  [sea.z, deck.u]
  deck:   [deck.a, spring.a, damper.a]
  load:   [spring.b, damper.b, load.a, thrust.a]
"""


def laid_out(model: hb.Model, values: bool = False) -> Drawn:
    expanded = expand(model)
    blocks = opened_blocks(expanded, (), True, ())
    return lay_out(sheet(expanded, connect(expanded), blocks), {}, Options(values, {}))


@cache
def bundled_sheets(name: str, values: bool) -> tuple[Drawn, ...]:
    """A bundled machine with all blocks open, sheet by sheet."""
    return tuple(sheets(laid_out(hb.load(name), values)))


@cache
def picture(name: str, opened: bool) -> str:
    return hb.draw(hb.load(name), open_all=opened)


def texts(svg: str, kind: str) -> list[str]:
    return [t.text or "" for t in ElementTree.fromstring(svg).iter(f"{SVG}text") if t.get("class") == kind]


def sheets(drawn: Drawn) -> Iterator[Drawn]:
    yield drawn
    for item in drawn.items:
        if item.inside is not None:
            yield from sheets(item.inside)


def writing(drawn: Drawn) -> dict[str, Box]:
    """The boxes of all writing on one sheet."""
    found = {f"part {item.part.path}": item.caption.box for item in drawn.items if item.caption}
    found |= {f"node {line.net.path}": line.caption.box for line in drawn.lines if line.caption}
    return found | ({"title": drawn.title.box} if drawn.title else {})


def crossed(drawn: Drawn) -> Iterator[tuple[str, Box]]:
    """The thin boxes of all wires on one sheet, step by step."""
    for line in drawn.lines:
        for (ax, ay), (bx, by) in line.wire.edges:
            yield line.net.path, Box(min(ax, bx), min(ay, by), max(ax, bx), max(ay, by))


# -- the bundled machines ----------------------------------------------------------------------------------------------
@pytest.mark.long
@pytest.mark.parametrize("name", MACHINES)
@pytest.mark.parametrize("opened", [False, True], ids=["closed", "open"])
def test_every_part_and_node_is_named_once(name: str, opened: bool) -> None:
    model = hb.load(name)
    svg = picture(name, opened)
    expanded = expand(model)

    def seen(path: str) -> bool:
        return opened or "." not in path

    assert Counter(texts(svg, "part")) == Counter(p.rpartition(".")[2] for p in expanded.leaves if seen(p))
    assert Counter(texts(svg, "node")) == Counter(p.rpartition(".")[2] for p in expanded.junctions if seen(p))


@pytest.mark.long
@pytest.mark.parametrize("name", MACHINES)
@pytest.mark.parametrize("values", [False, True], ids=["names", "values"])
def test_nothing_covers_anything(name: str, values: bool) -> None:
    for drawn in bundled_sheets(name, values):
        assert drawn.faults == 0
        words = writing(drawn)
        pictures = {f"picture {item.part.path}": item.extent for item in drawn.items}
        for first, box in words.items():
            others = {**words, **pictures}
            assert not [o for o, b in others.items() if o != first and box.meets(b)], first
        for net, piece in crossed(drawn):
            assert not [w for w, box in words.items() if piece.meets(box)], net
            # a wire may end on the edge of a picture, never inside it
            assert not [p for p, box in pictures.items() if piece.meets(box, -1e-6)], net


@pytest.mark.long
@pytest.mark.parametrize("name", MACHINES)
def test_wires_of_two_nodes_never_share_a_stretch(name: str) -> None:
    for drawn in bundled_sheets(name, False):
        stretches = Counter(edge for line in drawn.lines for edge in line.wire.edges)
        assert max(stretches.values()) == 1


@pytest.mark.long
@pytest.mark.parametrize("name", MACHINES)
def test_every_wire_reaches_each_of_its_ports(name: str) -> None:
    for drawn in bundled_sheets(name, False):
        items = {item.part.name: item for item in drawn.items}
        own = {a.port: a for a in drawn.anchors}
        for line in drawn.lines:
            points = {point for edge in line.wire.edges for point in edge}
            for part, port in line.net.ends:
                anchors = items[part].anchors(port) if part else [own[port]]
                assert points & {(a.x, a.y) for a in anchors}, f"{line.net.path} misses {part}.{port}"


# of the forty circuits, whose parts are given no places, one in eight: to find places takes seconds each
VARIANTS = sorted(set(BUNDLED) - set(MACHINES))
CIRCUITS = [name for name in VARIANTS if name.startswith("circuits/")]


@pytest.mark.long
@pytest.mark.parametrize("name", [pytest.param(
    name, marks=[pytest.mark.slow] if name in CIRCUITS and CIRCUITS.index(name) % 8 else []) for name in VARIANTS])
def test_every_variant_is_drawn(name: str) -> None:
    model = hb.load(name)
    drawn = {text for element in ElementTree.fromstring(hb.draw(model)).iter() for text in (element.text or "").split()}
    assert set(model.body.instances) <= drawn


def test_all_lies_on_the_page() -> None:
    root = ElementTree.fromstring(hb.draw(hb.load("cmc_ahc"), values=True))
    left, top, width, height = map(float, root.get("viewBox", "").split())
    for text in root.findall(f"{SVG}text"):
        wide = text_width(text.text or "", NAME) * float(text.get("font-size", "11")) / NAME.size / 1.07
        begin = float(text.get("x", "0")) - {"start": 0, "middle": wide / 2, "end": wide}[text.get("text-anchor", "start")]
        assert left <= begin and begin + wide <= left + width, text.text
        assert top + 8 <= float(text.get("y", "0")) <= top + height, text.text


def test_the_compensator_is_readable_on_a4() -> None:
    """Names of 11 px, shrunk to 277 mm by 190 mm: 6 points and more, as in the smallest print of a data sheet."""
    for opened, least in ((False, 8.0), (True, 6.0)):
        root = ElementTree.fromstring(picture("cmc_ahc/cmc_ahc", opened))
        width, height = float(root.get("width", "0")), float(root.get("height", "0"))
        points_per_px = min(0.75, 277 / 25.4 * 72 / width, 190 / 25.4 * 72 / height)
        assert 11 * points_per_px >= least * (0.75 if opened else 1.0)


# -- layout ------------------------------------------------------------------------------------------------------------
def test_given_places_hold() -> None:
    items = {item.part.name: item for item in laid_out(hb.load("cylinder_rig")).items}
    assert items["pump"].x < items["valve"].x < items["cylinder"].x < items["load"].x < items["wall"].x
    assert items["pump"].y == items["valve"].y == items["load"].y < items["tank"].y == items["load_damper"].y


def test_costs_of_all_cells_at_once_are_those_of_each(monkeypatch: pytest.MonkeyPatch) -> None:
    best, compared = placement._Search._best, []

    def checked(self: placement._Search, name: str) -> tuple[placement.Cell, placement.Matrix]:
        cells = [cell for cell in self._choices(name) if cell not in self.taken]
        turns = self.pieces[name].different
        for k in self.of[name]:
            costs = self._net_costs(k, name, cells, turns)
            for i, j in np.ndindex(costs.shape):
                self._put(name, cells[i], turns[j])
                compared.append((costs[i, j], self._net_cost(k)))
                self._lift(name)
        return best(self, name)

    monkeypatch.setattr(placement._Search, "_best", checked)
    hb.draw(hb.loads(RIG))
    assert len(compared) > 1000 and all(one == other for one, other in compared)


def test_without_places_a_chain_becomes_a_line() -> None:
    """Sea, deck, spring and load stand in one line, the damper beside the spring; wires of two ends have no corner."""
    drawn = laid_out(hb.loads(RIG))
    items = {item.part.name: item for item in drawn.items}
    assert len({items[n].y for n in ("sea", "deck", "spring", "load")}) == 1
    assert items["damper"].x == items["spring"].x
    heave = next(line for line in drawn.lines if line.net.path == "heave")
    assert len(heave.wire.lines) == 1 and len(heave.wire.lines[0]) == 2


UP_AND_DOWN = ("cascaded_tanks", "cylinder_rig", "dc_stage", "emps", "linear_motor", "passive_rig", "pneumatic_cylinder",
               "quarter_car", "receiver_rig", "servo_drive")


def without_places(sheet: Sheet) -> Sheet:
    return replace(sheet, parts={name: replace(part, at=None, turn=None) for name, part in sheet.parts.items()})


@pytest.mark.long
@for_each("name", UP_AND_DOWN)
def test_without_places_supplies_are_above_or_on_the_left_and_grounds_not_above(name: str) -> None:
    """The wire of a source leaves to the right or downwards, that of a ground, a tank or a fixed point not downwards, and
    that of a weight points down on its body. A seat with a given motion is below what it carries if that has a weight."""
    expanded = expand(hb.load(name))
    drawn = lay_out(without_places(sheet(expanded, connect(expanded), frozenset())), {}, Options(False, {}))
    sides = {item.part.name: (item.part.component.name, item.shape.of("a")[0].side) for item in drawn.items
             if "a" in item.part.ports and len(item.part.component.ports) == 1}
    for kind, side in sides.values():
        if kind in ("Fixed", "ElectricalGround", "Tank"):
            assert side != "bottom", sides
        elif kind in ("PressureSource", "PneumaticSource", "FlowSource", "ForceSource", "Weight"):
            assert side in ("right", "bottom"), sides
    if name == "quarter_car":
        assert sides["road"][1] == "top"


def test_without_places_signals_run_from_left_to_right() -> None:
    expanded = expand(hb.load("servo_drive"))
    drawn = lay_out(without_places(sheet(expanded, connect(expanded), frozenset())), {}, Options(False, {}))
    x = {item.part.name: item.x for item in drawn.items}
    assert x["position"] < x["speed_pi"] < x["current_pi"] < x["computing"] <= x["amplifier"]


def test_a_mass_stands_in_its_line() -> None:
    """Spring and string end on opposite sides of the block, without a branch."""
    drawn = laid_out(hb.load("passive_rig"))
    crown = next(line for line in drawn.lines if line.net.path == "crown")
    item = next(item for item in drawn.items if item.part.name == "crown")
    points = {point for edge in crown.wire.edges for point in edge}
    assert {(item.x - 30, item.y), (item.x + 30, item.y)} <= points


def test_an_input_that_reads_a_variable_shows_what() -> None:
    svg = hb.draw(hb.loads(RIG))
    assert texts(svg, "formula") == ["-3 kN*s/m * load.v"]


@pytest.mark.long
def test_a_node_may_reach_out_of_a_block() -> None:
    text = """
model: leaking
extends: cmc_ahc/cmc_ahc.yaml
components:
  leak: {is: LaminarLeakage, C: 1e-11 m**3/(s*Pa)}
  sump: {is: Tank}
nodes:
  ahc.chamber_a: [+leak.a]
  sump: [leak.b, sump.a]
"""
    model = hb.loads(text, bundled("models"))
    assert texts(hb.draw(model), "node").count("chamber_a") == 1
    assert texts(hb.draw(model, open="ahc"), "node").count("chamber_a") == 1


def test_many_parts_are_drawn_all_the_same() -> None:
    """A chain of 80 pieces, every one of them named: more than are moved about to shorten the wires."""
    text = "model: chain\ncomponents:\n  wall: {is: Fixed}\n  rope: {is: Spring, c: 1 kN/m, repeat: 80}\n" \
        "nodes:\n  wall: [wall.a, rope.a]\n  end: [rope.b]\n"
    assert len(texts(hb.draw(hb.loads(text)), "part")) == 81


def test_a_wire_goes_around_what_is_in_the_way() -> None:
    ends = [[pictograms.Anchor("a", 0, 0, "right")], [pictograms.Anchor("b", 200, 0, "left")]]
    wire, = route([ends], [Box(80, -30, 120, 30)], Box(-50, -100, 250, 100))
    assert wire.faults == 0
    assert not [p for edge in wire.edges for p in edge if 80 <= p[0] <= 120 and -30 <= p[1] <= 30]


def test_two_wires_cross_at_a_right_angle() -> None:
    level = [[pictograms.Anchor("a", 0, 0, "right")], [pictograms.Anchor("b", 200, 0, "left")]]
    upright = [[pictograms.Anchor("c", 100, -80, "bottom")], [pictograms.Anchor("d", 100, 80, "top")]]
    wires = route([level, upright], [], Box(-50, -100, 250, 100))
    assert [wire.lines for wire in wires] == [(((0, 0), (200, 0)),), (((100, -80), (100, 80)),)]
    assert not any(wire.dots or wire.faults for wire in wires)


# -- what is drawn -----------------------------------------------------------------------------------------------------
@pytest.mark.long
def test_the_same_diagram_gives_the_same_bytes() -> None:
    """Also in another process, where the order of sets is another one."""
    code = "import sys, heavebond as hb; sys.stdout.write(hb.draw(hb.load('cmc_ahc'), open_all=True))"
    drawn = {subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, encoding="utf-8",
                            env={**os.environ, "PYTHONHASHSEED": seed, "PYTHONIOENCODING": "utf-8",
                                 "PYTHONPATH": str(Path(hb.__file__).parents[1])}).stdout for seed in ("1", "2")}
    assert drawn == {picture("cmc_ahc/cmc_ahc", True)}


def test_hostile_names_stay_text() -> None:
    hostile = "]]></title><script>alert('1')</script>&amp;\"\x0b"
    model = hb.loads(RIG.replace("A load on a spring and a damper.", "']]></title><script>alert(1)</script>&amp;\"'"))
    svg = hb.draw(model, highlight={"load": hostile, "spring": hostile, "damper.a": hostile}, values=True)
    root = ElementTree.fromstring(svg)
    assert not list(root.iter(f"{SVG}script"))
    assert not [name for element in root.iter() for name in element.attrib if name.startswith("on") or "href" in name]
    assert hostile.replace("\x0b", "\ufffd") in texts(svg, "tag")


def test_values_are_written_with_their_units() -> None:
    svg = hb.draw(hb.loads(RIG).with_parameters({"spring.c": 42e3}), values=True)
    written = [t.text for t in ElementTree.fromstring(svg).iter(f"{SVG}text")]
    assert {"c = 42 kN/m", "d = 8 kN·s/m", "m = 1.2 t"} <= set(written)
    assert "c = 42 kN/m" not in hb.draw(hb.loads(RIG))


def test_marks_open_the_blocks_around_them() -> None:
    svg = hb.draw(hb.load("cmc_ahc"), highlight={"ahc.cylinder": "leaks", "platform": "play", "cmc.gas.p": "sticks"})
    assert {"leaks", "play", "sticks"} == set(texts(svg, "tag"))
    assert {"gas", "valve"} <= set(texts(svg, "part"))
    assert "formation" not in texts(svg, "part")
    assert svg.count(f'stroke="{WARNING}"') > picture("cmc_ahc/cmc_ahc", False).count(f'stroke="{WARNING}"') == 0


def test_a_node_is_told_from_a_component_of_its_name() -> None:
    model = hb.load("passive_rig")
    for name, wires in (("crown", 0), ("node crown", 1)):
        root = ElementTree.fromstring(hb.draw(model, highlight=[name]))
        drawn = [path for path in root.iter(f"{SVG}path") if path.get("class") == "wire"]
        assert sum(path.get("stroke") == WARNING for path in drawn) == wires


def test_the_mark_of_a_port_is_where_its_wire_ends() -> None:
    """A cylinder's port has a place above and one below; in the opened block the wires of `A` are on both."""
    svg = hb.draw(hb.load("cylinder_rig"), highlight=["cylinder.A"])
    assert f'<circle cx="-30" cy="-20" r="6" stroke="{WARNING}"' in svg


def test_marks_without_label_and_of_a_block_and_of_an_element() -> None:
    svg = hb.draw(hb.load("cmc_ahc"), open="cmc", highlight=["cmc", "controller.v"])
    assert not texts(svg, "tag")
    assert WARNING in svg


def test_parts_have_the_colour_of_what_they_carry() -> None:
    svg = hb.draw(hb.load("receiver_rig"))
    wires = {w.get("stroke") for w in ElementTree.fromstring(svg).iter(f"{SVG}path") if w.get("class") == "wire"}
    assert wires == {"#9c3d7e"}


@pytest.mark.parametrize(("asked", "said"), [
    ({"open": ["ahk"]}, "there is no block 'ahk' to open [open-unknown]\n  Did you mean 'ahc'?"),
    ({"open": ["crown"]}, "'crown' (Mass) is not made of other components; there is nothing to open [open-unknown]\n"
     "  Blocks: cmc, ahc, drilling."),
    ({"highlight": {"cmc.gaz": ""}}, "there is no component, node or port 'cmc.gaz' to mark [highlight-unknown]\n"
     "  Did you mean 'cmc.gas' or 'cmc.a'?"),
])
def test_wrong_names(asked: dict[str, object], said: str) -> None:
    with pytest.raises(hb.UsageError) as error:
        hb.draw(hb.load("cmc_ahc"), **asked)
    assert str(error.value) == said


# -- symbols -----------------------------------------------------------------------------------------------------------
@for_each("name", library().names())
def test_the_symbol_of_a_component_has_all_its_ports(name: str) -> None:
    component = library().component(name)
    shape = pictograms.symbol(component)
    # without one it is a box that names its ports, as a controller with several inputs needs
    assert shape is None or {a.port for a in shape.anchors} >= {*component.ports, *component.signals}


@for_each("path", sorted((bundled("components") / "symbols").glob("*.svg")), ids=lambda path: path.stem)
def test_turning_a_symbol_keeps_its_anchors_on_its_edge(path: Path) -> None:
    shape = pictograms._read(path, 0)
    for turn in shape.turns:
        turned = shape.turned(turn)
        edges = {"left": turned.left, "right": turned.right, "top": turned.top, "bottom": turned.bottom}
        for anchor in turned.anchors:
            assert edges[anchor.side] == (anchor.x if anchor.side in ("left", "right") else anchor.y)
            assert anchor.x % pictograms.GRID == anchor.y % pictograms.GRID == 0


PAD = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="-20 -20 40 40">{}<circle data-port="a" cx="-20" cy="0"/></svg>'


@pytest.mark.parametrize(("symbol", "said"), [
    (PAD.format("<script>alert(1)</script>"), "a symbol has no <script>"),
    (PAD.format('<image href="http://x"/>'), "a symbol has no <image>"),
    (PAD.format('<path onclick="x" d="M0 0"/>'), "<path> has onclick, which a symbol cannot have"),
    (PAD.format('<path fill="url(#x)" d="M0 0"/>'), "<path> has fill, which a symbol cannot have"),
    ('<!DOCTYPE svg [<!ENTITY a "aa">]>' + PAD.format(""), "a symbol has no document type and no entities"),
    (PAD.format("").replace('cx="-20"', 'cx="-15"'), "the place of port 'a' is not on the edge"),
    (PAD.format("").replace("-20 -20 40 40", "wide"), "this is not a symbol"),
    (PAD.format("<path"), "this is not a symbol"),
    (PAD.format("").replace("viewBox", 'data-leave="upwards" viewBox'), "data-leave is none of left, right, top, bottom"),
    (PAD.format("").replace('data-port="a"', 'data-port="b"'), "the symbol 'pad' has no place for a of Pad"),
])
def test_a_symbol_that_could_act_or_misses_a_port_is_refused(tmp_path: Path, symbol: str, said: str) -> None:
    model = _with_symbol(tmp_path, symbol)
    with pytest.raises(hb.ModelError) as error:
        hb.draw(model)
    assert said in str(error.value)
    assert not [problem for problem in error.value.problems if not problem.hint]


def test_a_symbol_of_your_own_stands_beside_the_component(tmp_path: Path) -> None:
    svg = hb.draw(_with_symbol(tmp_path, PAD.format('<path d="M0 0 L12.5 7"/>')))
    assert 'd="M0 0 L12.5 7"' in svg


def test_a_symbol_that_is_not_there(tmp_path: Path) -> None:
    model = _with_symbol(tmp_path, PAD.format(""))
    (tmp_path / "symbols" / "pad.svg").rename(tmp_path / "symbols" / "pads.svg")
    with pytest.raises(HeavebondError, match=r"there is no symbol 'pad' for Pad(.|\n)*Did you mean 'pads'"):
        hb.draw(model)


def _with_symbol(folder: Path, symbol: str) -> hb.Model:
    (folder / "symbols").mkdir()
    (folder / "symbols" / "pad.svg").write_text(symbol, encoding="utf-8")
    (folder / "pad.yaml").write_text(
        "component: Pad\nsummary: A pad.\nsymbol: pad\nports: {a: translational}\nequations: |\n  a.f = 0\n")
    text = "model: m\ncomponents:\n  pad: {is: Pad}\n  load: {is: Mass, m: 1 kg}\nnodes:\n  load: [pad.a, load.a]\n"
    return hb.loads(text, folder)


# -- the command -------------------------------------------------------------------------------------------------------
def test_the_command_writes_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    run = CliRunner().invoke(main, ["draw", "cmc_ahc/passive", "--open", "cmc", "--values", "--highlight",
                                    "cmc.friction=larger", "--json", "out.json"])
    assert run.exit_code == 0 and run.output == "wrote passive.svg\n"
    assert json.loads(Path("out.json").read_text())["files"] == ["passive.svg"]
    svg = Path("passive.svg").read_text(encoding="utf-8")
    assert "larger" in texts(svg, "tag") and re.search(r"F_c = 12 kN", svg)


def test_the_command_writes_png_and_pdf(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the proportions of the drawing; without the library the message says what to install, or which file to write."""
    pytest.importorskip("cairosvg")
    monkeypatch.chdir(tmp_path)
    for name in ("a.svg", "a.png", "a.pdf"):
        assert CliRunner().invoke(main, ["draw", "quarter_car", "-o", name]).exit_code == 0
    found = re.search(r'viewBox="[-0-9.]+ [-0-9.]+ ([0-9.]+) ([0-9.]+)"', Path("a.svg").read_text(encoding="utf-8"))
    assert found is not None and Path("a.pdf").read_bytes().startswith(b"%PDF")
    height, width = imread("a.png").shape[:2]
    assert width / height == pytest.approx(float(found[1]) / float(found[2]), rel=0.01)  # whole pixels
    monkeypatch.setitem(sys.modules, "cairosvg", None)
    run = CliRunner().invoke(main, ["draw", "quarter_car", "-o", "b.png"])
    assert run.exit_code == 2 and "heavebond[pictures]" in run.output and "b.svg" in run.output


def test_the_command_says_what_is_wrong(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for words, said in ((["-o", "a.gif"], "'a.gif' does not end in .svg"), (["--open", "gas"], "there is nothing to open"),
                        (["--highlight", "gaz"], "Did you mean 'gas'"), (["--set", "gas.k=1"], "gas")):
        run = CliRunner().invoke(main, ["draw", "passive_rig", *words])
        assert run.exit_code == 2 and said in run.output + (run.stderr if run.stderr_bytes else ""), words


@pytest.mark.parametrize("turn", [0, 90, 180, 270])
def test_a_part_is_turned_as_its_place_says(turn: int) -> None:
    """The picture's left to right points to the right, down, to the left, up."""
    text = (bundled("models") / "quarter_car" / "quarter_car.yaml").read_text(encoding="utf-8")
    drawn = laid_out(hb.loads(text.replace("at: [2, 1]", f"at: [2, 1, {turn}]")))
    damper = next(item for item in drawn.items if item.part.name == "damper")
    assert damper.shape.turn[:2] == {0: (1, 0), 90: (0, 1), 180: (-1, 0), 270: (0, -1)}[turn]
    with pytest.raises(HeavebondError, match="cannot be rotated by 45 degrees"):
        hb.loads(text.replace("at: [2, 1]", "at: [2, 1, 45]"))


def test_the_names_in_a_box_do_not_meet() -> None:
    """Names of ports at all four sides, those at the corners too, and the name of the part between them."""
    sides = {"left": ["pitch", "roll"], "right": ["batteryVoltage", "currentDraw", "throttle"], "bottom": ["supply"],
             "top": ["thrust_forward", "thrust_sideways", "thrust_upwards"]}
    boxes = {}
    for mark in pictograms.box("Quadcopter", "ThrottleEquation", sides).marks:
        if mark.tag == "text":
            given = dict(mark.attributes)
            style = NAME if given["data-style"] == "name" else pictograms.PORT
            width, x, y = text_width(mark.text, style), float(given["x"]), float(given["y"])
            left = x - width * {"start": 0, "end": 1}.get(given.get("text-anchor", "middle"), 0.5)
            boxes[mark.text] = Box(left, y - style.size, left + width, y)
    assert len(boxes) == 9 + 2
    assert not [(a, b) for a in boxes for b in boxes if a < b and boxes[a].meets(boxes[b])]


def test_a_node_named_after_a_port_is_not_named_across_something_else(tmp_path: Path) -> None:
    """Two boxes close to each other: what the wires between them are called stands at their ends already."""
    names = [f"measured_position_{k}" for k in range(6)]
    for kind, way in (("Sender", "out"), ("Taker", "in")):
        ports = "".join(f"  {n}: {{signal: {way}, unit: 1}}\n" for n in names)
        law = "".join(f"  {n} = time\n" for n in names) if way == "out" else ""
        total = f"variables:\n  s: {{unit: 1}}\nequations: |\n  s = {' + '.join(names)}\n"
        inner = f"equations: |\n{law}" if law else total
        (tmp_path / f"{kind.lower()}.yaml").write_text(
            f"component: {kind}\nsummary: A box.\nunits: unchecked\nports:\n{ports}{inner}")
    nodes = "".join(f"  sender_{n}: [sender.{n}, taker.{n}]\n" for n in names)
    model = hb.loads("model: close\nsummary: Two boxes.\ncomponents:\n  sender: {is: Sender, at: [0, 0]}\n"
                     f"  taker: {{is: Taker, at: [0, 1]}}\nnodes:\n{nodes}", tmp_path)
    drawn = laid_out(model)
    named = [line.caption.box for line in drawn.lines if line.caption is not None]
    solid = [item.extent for item in drawn.items]
    assert not [box for box in named if any(box.meets(other) for other in solid)]


def test_a_rotation_that_is_not_possible_is_named_with_those_that_are() -> None:
    text = "model: one\ncomponents:\n  wall: {is: Fixed}\nnodes: {wall: [wall.a]}\nlayout: {parts: {wall: [0, 0, 45]}}\n"
    with pytest.raises(hb.ModelError, match=r"the rotation \(0, 90, 180, 270\) and `mirrored`"):
        hb.loads(text)
