"""`view:` in space: solids are at the frames of the run, on a page, in a film and by default from the parts."""

from __future__ import annotations

import base64
import io
import json
import re
from collections.abc import Iterator
from pathlib import Path

import browser
import numpy as np
import pytest
from click.testing import CliRunner
from collected import partly
from PIL import Image

import heavebond as hb
from heavebond.cli import main
from heavebond.language import library
from heavebond.language.library import bundled
from heavebond.pictures.animation import animation_page, packed
from heavebond.pictures.film import COLOURS
from heavebond.pictures.motion import Motion, animate, check_view
from heavebond.pictures.projection import Camera, _grid, polygons
from heavebond.pictures.space import Solid, cardan, product, resolved, rotated, to_axis
from heavebond.text.expression import names

# an arm that turns about z with 1 rad/s, with a load on a rope below its end
TURNTABLE = """
model: turntable
components:
  table: {is: SpatialPositionSource, x: [0 m, 0 m, 0 m], phi: [0 rad, 0 rad, "=1 rad/s*time"]}
  arm:   {is: SpatialLink, l_x: 2 m}
  rope:  {is: SpatialRope, c: 10 kN/m, d: 2 kN*s/m, l0: 1 m}
  winch: {is: Fixed}
  load:  {is: SpatialPointMass, m: 5 kg}
nodes:
  table: [table.a, arm.a]
  end:   [arm.b, rope.a]
  load:  [rope.b, load.a]
  winch: [rope.w, winch.a]
initial: {load.x: 2 m, load.y: 0 m, load.z: -1 m, load.v_x: 0 m/s, load.v_y: 2 m/s, load.v_z: 0 m/s}
show: {height: {is: load.z, unit: m}}
view:
  floor:   {is: ground, at: [0, 0, -1.5 m], width: 6 m}
  arm:     {is: beam, from: table, to: end, width: 0.1 m}
  head:    {is: box, at: [end, 0, 0, 0.5 m], size: [0.4 m, 0.2 m, 0.1 m], turned: [0, 90 deg, 0], label: <head>}
  rope:    {is: line, from: end, to: load}
  weight:  {is: sphere, at: load, diameter: 0.3 m, colour: red}
  pull:    {is: arrow, at: load, vector: -rope.b.F, scale: 50 N/m}
  disc:    {is: disc, at: [table, 0, 0, -0.1 m], axis: [0, 1, 0], diameter: 0.6 m, width: 0.1 m}
  ram:     {is: cylinder, from: [0, 0, -1 m], to: [end, -1 m, 0, 0]}
  coil:    {is: spring, from: [1 m, 1 m, -1 m], to: end}
  path:    {is: trace, at: load, duration: 0.3 s}
  sea:     {is: level, at: -1.4 m}
  camera:  {is: camera, azimuth: 30 deg, elevation: 10 deg}
simulate: {until: 1 s, every: 10 ms}
"""
OWN = TURNTABLE[:TURNTABLE.index("view:")] + "simulate: {until: 0.1 s, every: 10 ms}\n"


@pytest.fixture(scope="module")
def motion() -> Motion:
    return animate(hb.loads(TURNTABLE))


def _solid(motion: Motion, name: str) -> Solid:
    return next(solid for solid in motion.solids if solid.name == name)


def test_solids_are_at_the_frames_of_the_run(motion: Motion) -> None:
    t = motion.time
    c, s, zero = np.cos(t), np.sin(t), np.zeros(len(t))
    arm, head, pull, disc = (_solid(motion, name).courses for name in ("arm", "head", "pull", "disc"))
    # interpolated between points 10 ms apart: 2 m * (1 rad/s * h)**2 / 8
    np.testing.assert_allclose(arm["to"], [2*c, 2*s, zero], atol=3e-5)
    np.testing.assert_allclose(head["at"], [2*c, 2*s, zero + 0.5], atol=3e-5)
    # after a quarter turn about y, x of the box is down; the box turns with the arm
    one = np.repeat([[1.0], [0.0], [0.0]], len(t), axis=1)
    np.testing.assert_allclose(rotated(head["turn"], one), [zero, zero, zero - 1], atol=1e-6)
    np.testing.assert_allclose(rotated(head["turn"], one[[1, 0, 2]]), [-s, c, zero], atol=2e-5)
    np.testing.assert_allclose(rotated(disc["turn"], one[[2, 1, 0]]), [-s, c, zero], atol=2e-5)
    np.testing.assert_allclose(disc["size"][:, 0], [0.6, 0.6, 0.1])
    # the pull of the rope on the load, which it holds against its weight and on its way around
    force = (pull["to"] - pull["from"])*50
    assert force[2, 0] == pytest.approx(0, abs=1e-6) and force[2, -1] > 10  # slack at first
    assert motion.camera == pytest.approx((np.pi/6, np.pi/18))
    assert motion.edges[2] == pytest.approx(-1.5) and motion.edges[0] == pytest.approx(-3)


def test_rotations_agree_with_their_definitions() -> None:
    q = cardan(np.array([0.3]), np.array([-0.4]), np.array([1.1]))
    roll, pitch, yaw = ([[1, 0, 0], [0, np.cos(0.3), -np.sin(0.3)], [0, np.sin(0.3), np.cos(0.3)]],
                        [[np.cos(0.4), 0, -np.sin(0.4)], [0, 1, 0], [np.sin(0.4), 0, np.cos(0.4)]],
                        [[np.cos(1.1), -np.sin(1.1), 0], [np.sin(1.1), np.cos(1.1), 0], [0, 0, 1]])
    v = np.array([[0.2], [-0.7], [0.5]])
    np.testing.assert_allclose(rotated(q, v), np.array(yaw) @ np.array(pitch) @ np.array(roll) @ v, atol=1e-15)
    np.testing.assert_allclose(product(q, q*[[1], [-1], [-1], [-1]]), [[1], [0], [0], [0]], atol=1e-15)
    for axis in ([0, 0, 2], [0, 0, -3], [1, -2, 0.5]):
        n = np.array(axis, float)[:, None]
        np.testing.assert_allclose(rotated(to_axis(n), np.array([[0], [0], [1.0]])), n/np.linalg.norm(n), atol=1e-15)


def test_without_a_view_the_parts_have_their_own_shapes() -> None:
    motion = animate(hb.loads(OWN))
    assert [(solid.name, solid.kind) for solid in motion.solids] == [
        ("ground", "ground"), ("table.table", "disc"), ("arm.bar", "beam"), ("rope.rope", "line"), ("load.ball", "sphere")]
    ball = _solid(motion, "load.ball").courses["size"]
    assert 7850*np.pi/6*ball[0, 0]**3 == pytest.approx(5.0)  # a ball of steel of 5 kg
    assert _solid(motion, "ground").courses["at"][2, 0] <= motion.edges[2]


def test_the_ground_is_a_grid_of_whole_squares() -> None:
    """Without a width it extends beyond the machine; 0.6/0.2 is below 3 by rounding."""
    wide = _solid(animate(hb.loads(TURNTABLE.replace(", width: 6 m}", "}")), "0.1 s"), "floor").courses["size"][0, 0]
    assert 4.0 < wide < 8.0  # the farthest shape is at about 2.2 m
    for width, edge in ((1.2, 0.6), (1.3, 0.6), (1.0, 0.5)):
        lines = np.concatenate([piece.corners for piece in _grid(np.zeros(3), width)])
        np.testing.assert_allclose([lines.min(axis=0), lines.max(axis=0)], [[-edge, -edge, 0], [edge, edge, 0]], atol=1e-12)


def test_a_body_is_a_box_with_its_moments_of_inertia() -> None:
    a, b, c, m = 0.2, 0.5, 1.2, 7.0
    J = m/12*np.array([b*b + c*c, a*a + c*c, a*a + b*b])
    motion = animate(hb.loads(f"""model: body
parameters: {{m: {m} kg, J_x: {J[0]} kg*m**2, J_y: {J[1]} kg*m**2, J_z: {J[2]} kg*m**2}}
components: {{body: {{is: SpatialBody, m: =m, J_x: =J_x, J_y: =J_y, J_z: =J_z, l_x: 0.1 m}}}}
nodes: {{body: [body.a]}}
initial: {{body.w_x: 0 rad/s, body.w_y: 0 rad/s, body.w_z: 1 rad/s}}
simulate: {{until: 0.1 s, every: 10 ms}}
"""))
    box = _solid(motion, "body.body").courses
    np.testing.assert_allclose(box["size"][:, 0], [a, b, c], rtol=1e-9)
    np.testing.assert_allclose(box["at"][:, 0], [0.1, 0, 0], atol=1e-12)


@pytest.mark.parametrize(("old", "new", "code", "hint"), [
    ("at: load, diameter", "at: lod, diameter", "view-frame", "load"),
    ("at: load, diameter", "at: winch, diameter", "view-frame", "Nodes: table, end, load"),
    ("at: load, diameter", "at: rope, diameter", "view-frame", "rope.a, rope.b"),
    ("at: load, diameter", "at: load.x, diameter", "view-frame", "Write `load`"),
    ("at: load, diameter", "at: [load, 0, 1 m], diameter", "view-point", "[load, 0, 1 m, 0]"),
    ("at: load, diameter", "at: [1 m, 2 m], diameter", "view-point", "`at: [boom, 0, 0, 0.5 m]`"),
    ("at: load, diameter", "at: {on: load}, diameter", "view-point", "`at: boom`"),
    ("at: [end, 0, 0, 0.5 m]", "at: [end, 0, 0, 0.5 s]", "view-unit", "crown.x + 12 m"),
    ("at: [end, 0, 0, 0.5 m]", "at: [end, 0, 0, end.xx]", "name-unknown", "end.x"),
    ("size: [0.4 m, 0.2 m, 0.1 m]", "size: [0.4 m, 0.2 m]", "view-triple", "size: [0.2 m, 0.2 m, 0.6 m]"),
    ("size: [0.4 m, 0.2 m, 0.1 m]", "size: 0.4 m", "view-triple", "size: [0.2 m, 0.2 m, 0.6 m]"),
    ("turned: [0, 90 deg, 0]", "turned: [0, 1 m, 0]", "view-unit", "turned: [0, 90 deg, 0]"),
    ("axis: [0, 1, 0]", "axis: y", "name-unknown", ""),
    ("vector: -rope.b.F, scale: 50 N/m", "vector: -rope.b.F, scale: 50 N", "view-unit", "scale: 10 kN/m"),
    ("vector: -rope.b.F", "vector: -rope.b.G", "name-unknown", ""),
    ("vector: -rope.b.F", "vector: 5 N", "view-triple", "-rope.b.F"),
    ("duration: 0.3 s", "duration: 1 m", "view-unit", "duration: 2 s"),
    ("is: sphere", "is: circle", "view-kind", "`disc` or `sphere`"),
    ("is: sphere", "is: spere", "is-unknown", "sphere"),
    ("{is: line, from: end, to: load}", "{is: line, from: [0, 0], to: [0, 1 m]}", "view-mixed", "[boom, 0, 0, 0.5 m]"),
    ("{is: level, at: -1.4 m}", "{is: mark, at: -1.4 m}", "view-mixed", "`level`"),
    ("diameter: 0.3 m, ", "radius: 0.3 m, ", "key-unknown", ""),
    ("{is: sphere, at: load, ", "{is: mesh, at: load, file: a.txt, unit: 1 mm, ", "key-unknown", ""),
    ("{is: sphere, at: load, diameter: 0.3 m, ", "{is: mesh, at: load, file: a.txt, ", "file-suffix", ".glb or .gltf"),
    ("{is: sphere, at: load, diameter: 0.3 m, ", "{is: mesh, at: load, file: nothing.stl, ", "file-missing", "relative"),
])
def test_what_is_wrong_is_said_with_its_place(old: str, new: str, code: str, hint: str) -> None:
    assert old in TURNTABLE
    with pytest.raises((hb.ModelError, hb.UsageError)) as error:
        animate(hb.loads(TURNTABLE.replace(old, new, 1)), "10 ms")
    problem = error.value.problems[0]
    assert problem.code.startswith(code) and hint in str(problem)
    assert problem.place is not None and problem.place.line > 17


def test_a_single_point_has_a_picture(tmp_path: Path) -> None:
    motion = animate(hb.loads(OWN + "view: {way: {is: trace, at: table}}\n"))
    assert motion.edges == pytest.approx((-0.5, -0.5, -0.5, 0.5, 0.5, 0.5))
    assert motion.save(tmp_path / "point.png").stat().st_size > 0


def test_a_shape_in_space_needs_frames() -> None:
    car = (bundled("models") / "quarter_car" / "quarter_car.yaml").read_text(encoding="utf-8").partition("\nview:")[0]
    with pytest.raises(hb.ModelError, match=r"view-space"):
        animate(hb.loads(car + "\nview: {ball: {is: sphere, at: body}}\n"))
    with pytest.raises(hb.ModelError, match=r"In a plane, places are `\[x, y\]`"):
        hb.loads(car + "\nview: {body: {is: box, at: body, size: [1 m, 1 m]}}\n")
    with pytest.raises(hb.ModelError, match=r"two lengths[\s\S]*view-pair"):
        animate(hb.loads(car + "\nview: {line: {is: line, from: body, to: wheel}}\n"))


def test_the_shape_of_a_component_is_at_one_of_its_ports(tmp_path: Path) -> None:
    (tmp_path / "hook.yaml").write_text("""component: Hook
summary: A hook without mass.
ports: {a: spatial}
parameters: {l: {unit: m, default: 0.2 m}}
equations: |
  a.F = 0
  a.M = 0
view:
  shank: {is: beam, from: a, to: [a, 0, 0, -l]}
""")
    diagram = OWN.replace("components:\n", "components:\n  hook: {is: Hook}\n").replace("rope.a]", "rope.a, hook.a]")
    (tmp_path / "m.yaml").write_text(diagram)
    shank = _solid(animate(hb.load(tmp_path / "m.yaml")), "hook.shank").courses
    np.testing.assert_allclose(shank["to"][:, 0], [2, 0, -0.2], atol=1e-9)
    text = (tmp_path / "hook.yaml").read_text()
    for folder, old, new, words in (("other", "from: a,", "from: b,", "'b' is not a port"), (
            "plane", "from: a, to: [a, 0, 0, -l]", "width: 1 m, from: [0, 0], to: [0, 1 m]", "in a plane")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "hook.yaml").write_text(text.replace(old, new))
        (tmp_path / folder / "m.yaml").write_text(diagram)
        with pytest.raises(hb.ModelError, match=words):
            hb.assemble(hb.load(tmp_path / folder / "m.yaml"))


def test_shapes_of_the_library_name_what_their_component_has() -> None:
    known = library.library()
    components = [known.component(name) for name, file in known.files.items() if file.parent.name == "spatial"]
    components = [component for component in components if component.view]
    assert len(components) > 20
    for component in components:
        for shape in component.view.values():
            placed = shape.placed("part", component)
            used = {name.text for formula in placed.all_formulas for name in names(formula.tree)} - {"pi"}
            assert all(name.startswith("part.") for name in used), (component.name, shape.name, used)


def test_a_mesh_is_drawn_in_its_unit(tmp_path: Path) -> None:
    pytest.importorskip("trimesh", reason="trimesh is not installed")
    (tmp_path / "part.obj").write_text("v 0 0 0\nv 100 0 0\nv 0 200 0\nv 0 0 300\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n")
    (tmp_path / "m.yaml").write_text(TURNTABLE.replace("{is: sphere, at: load, diameter: 0.3 m, ",
                                                       "{is: mesh, at: load, file: part.obj, unit: mm, "))
    model = hb.load(tmp_path / "m.yaml")
    assert tmp_path / "part.obj" in model.sources
    motion = animate(model, "20 ms")
    mesh = _solid(motion, "weight")
    assert mesh.faces is not None and mesh.faces[1].shape == (4, 3) and mesh.courses["size"][0, 0] == 1e-3
    seen = polygons((mesh,), 0, motion.time, Camera(np.array([2.0, 0, -1]), 1.0, 0.5, 0.4), COLOURS)
    assert len(seen) == 4
    assert '"triangles"' in animation_page(motion)


# -- film ------------------------------------------------------------------------------------------------------------------
def test_the_nearer_solid_is_painted_over_the_farther(motion: Motion) -> None:
    n, turn = np.zeros((1, 1)), np.array([[1.0], [0], [0], [0]])

    def ball(x: float, colour: str) -> Solid:
        at = np.array([[x], [0], [0]])
        return Solid(colour, "sphere", colour, "", {"at": at, "turn": turn, "size": np.full((3, 1), 0.5)})

    camera = Camera(np.zeros(3), 2.0, 0.0, 0.2)  # on the side of +x
    order = [p.face for p in polygons((ball(1.0, "red"), ball(-1.0, "blue")), 0, n[0], camera, COLOURS)]
    red = [k for k, face in enumerate(order) if face is not None and face[0] > face[2]]
    assert min(red) == len(order) - len(red)  # all of the red one after all of the blue one
    # a level between two parts of a box hides its lower part
    sea = Solid("sea", "level", "sea", "", {"at": n.repeat(3, 0), "size": np.array([[9.0], [9.0], [0]])})
    box = Solid("box", "box", "dark", "", {"at": n.repeat(3, 0), "turn": turn, "size": np.ones((3, 1))})
    cut = polygons((box, sea), 0, n[0], camera, COLOURS)
    water = next(k for k, p in enumerate(cut) if p.edge is None)
    assert 0 < water < len(cut) - 1
    assert max(p.corners[:, 1].max() for p in cut[:water]) < max(p.corners[:, 1].max() for p in cut[water + 1:])


def test_a_film_and_a_picture_show_the_machine(motion: Motion, tmp_path: Path) -> None:
    motion.save(tmp_path / "a.gif", speed=4)
    with Image.open(tmp_path / "a.gif") as film:
        assert film.n_frames == 3
    pictures = []
    for at in (0, "1 s"):
        with Image.open(motion.save(tmp_path / "a.png", at=at)) as picture:
            pictures.append(np.asarray(picture.convert("RGB"), float))
    assert np.abs(pictures[0] - pictures[1]).max() > 100
    assert 0.03 < (pictures[0].min(axis=2) < 245).mean() < 0.9
    with pytest.raises(hb.UsageError, match="at-outside"):
        motion.save(tmp_path / "a.png", at="2 s")
    with pytest.raises(hb.UsageError, match="at-moving"):
        motion.save(tmp_path / "a.gif", at=0)


def test_the_command_writes_a_picture(tmp_path: Path) -> None:
    answer = CliRunner().invoke(main, ["animate", "spatial/gyroscope", "--until", "50 ms", "-o", str(tmp_path / "g.png"),
                                       "--at", "20 ms"])
    assert answer.exit_code == 0, answer.output
    with Image.open(tmp_path / "g.png") as picture:
        assert picture.size[0] > 300


# -- pages -----------------------------------------------------------------------------------------------------------------
def test_runs_are_overlaid(motion: Motion, tmp_path: Path) -> None:
    """On the page with their own times, and in a picture with their labels; the ground and the sea are drawn once."""
    fast = animate(hb.loads(TURNTABLE), "0.5 s", parameters={"arm.l_x": 4.0})
    both = motion.with_runs({"long arm": fast})
    run, = packed(both)["runs"]
    assert run["label"] == "long arm" and run["times"][1] == 0.5 and len(run["solids"]) == len(motion.solids)
    pictures = []
    for k, shown in enumerate((motion, both)):
        shown.save(tmp_path / f"{k}.png", at="0.3 s")
        with Image.open(tmp_path / f"{k}.png") as image:
            pictures.append(np.asarray(image.convert("RGB")).astype(int))
    half = min(picture.shape[0] for picture in pictures)//2, min(picture.shape[1] for picture in pictures)//2
    assert (np.abs(pictures[0][:half[0], :half[1]] - pictures[1][:half[0], :half[1]]).max(axis=2) > 20).sum() > 200
    with pytest.raises(hb.UsageError, match="not a machine in space"):
        hb.animate("mechanisms/crane", "0.1 s").with_runs({"other": motion})


BARGE = """
model: barge
components:
  barge: {is: SpatialBody, m: 328 t, J_x: 2.5e6 kg*m**2, J_y: 1.2e7 kg*m**2, J_z: 1.3e7 kg*m**2}
  hull:  {is: FloatingHull, V: 320 m**3, A_w: 160 m**2, I_x: 853.3333 m**4, I_y: 5333.3333 m**4, z_B: -1 m}
nodes: {deck: [barge.a, hull.a]}
view: {hull: {is: box, at: deck, size: [20 m, 8 m, 2 m]}, mast: {is: beam, from: deck, to: [deck, 0, 0, 10 m]}}
simulate: {until: 1 s}
"""


def test_a_mode_has_its_shape() -> None:
    """Heave moves the hull upwards and turns nothing, roll turns it about x; both have the frequencies of closed forms."""
    barge = hb.loads(BARGE)
    heave, roll = np.sqrt(1025*9.81*160/328e3), np.sqrt(1025*9.81*320*(853.3333/320 - 1)/2.5e6)
    frequencies = list(hb.modes(barge).frequencies)
    for wanted, direction in ((heave, "heave"), (roll, "roll")):
        number = int(np.argmin(np.abs(np.array(frequencies) - wanted/(2*np.pi)))) + 1
        motion = hb.animate_mode(barge, number)
        at, turn = _solid(motion, "hull").courses["at"], _solid(motion, "hull").courses["turn"]
        wave = np.cos(wanted*motion.time)
        if direction == "heave":
            assert np.abs(at[:2]).max() < 1e-9 and np.abs(turn[1:]).max() < 1e-9
            size = np.abs(at[2]).max()
            np.testing.assert_allclose(np.abs(at[2] @ wave), size*np.sum(wave**2), rtol=0.01)
            assert size == pytest.approx(0.1*20)  # a tenth of the length of the hull
        else:
            assert np.abs(at).max() < 1e-9 and np.abs(turn[2:]).max() < 1e-9 and np.abs(turn[1]).max() > 0.05
    with pytest.raises(hb.UsageError, match="mode 99 cannot be animated"):
        hb.animate_mode(barge, 99)


def test_the_command_animates_a_mode(tmp_path: Path) -> None:
    (tmp_path / "barge.yaml").write_text(BARGE, encoding="utf-8")
    command = ["animate", str(tmp_path / "barge.yaml"), "--mode"]
    result = CliRunner().invoke(main, [*command, "12", "-o", str(tmp_path / "mode.html")])
    assert result.exit_code == 2 and "the diagram has" in result.output
    assert CliRunner().invoke(main, [*command, "7", "-o", str(tmp_path / "mode.html")]).exit_code == 0
    page = (tmp_path / "mode.html").read_text(encoding="utf-8")
    assert "Hz, damping ratio" in page
    assert all(len(speed) <= 6 for speed in re.findall(r">([0-9.]+) ×<", page))  # three digits, as 0.0414
    both = CliRunner().invoke(main, [*command, "7", "--until", "1 s"])
    assert both.exit_code == 2 and "--until acts on a run" in both.output


def test_the_command_overlays_runs(tmp_path: Path) -> None:
    (tmp_path / "turntable.yaml").write_text(TURNTABLE, encoding="utf-8")
    result = CliRunner().invoke(main, ["animate", str(tmp_path / "turntable.yaml"), "--until", "0.1 s", "-o",
                                       str(tmp_path / "t.html"), "--also", "arm.l_x=3 m; load.m=7 kg"])
    assert result.exit_code == 0, result.output
    text = (tmp_path / "t.html").read_text(encoding="utf-8")
    assert "arm.l_x=3 m; load.m=7 kg" in text
    wrong = CliRunner().invoke(main, ["animate", str(tmp_path / "turntable.yaml"), "--also", "arm.l=3 m"])
    assert wrong.exit_code and "arm.l" in wrong.output


def test_the_page_holds_what_it_needs(motion: Motion) -> None:
    text = animation_page(motion)
    assert "http://" not in text.replace("http://www.w3.org/", "") and "https://" not in text
    assert "\\u003chead\\u003e" in text
    assert len(text) < 700_000  # of which three.js 460 000
    solids = packed(motion)["solids"]
    assert isinstance(solids, list) and json.dumps(solids)


@pytest.mark.long
@pytest.mark.parametrize("name", ["vessel_crane", "landing_crane"])
def test_the_view_of_the_crane_names_what_it_has(name: str) -> None:
    """Its run takes several seconds."""
    assembly = hb.assemble(hb.load(f"spatial/{name}"))
    check_view(assembly, resolved(assembly.model.view, assembly), {})


def test_shapes_in_space_replace_those_of_a_machine_in_the_plane() -> None:
    plane, space = (hb.load(name).view for name in ("mechanisms/crane", "spatial/barge_crane"))
    assert "truck" in plane and "truck" not in space
    assert all(shape.spatial is not False for shape in space.values())


@pytest.mark.parametrize("name", partly(["gyroscope", "robot_arm", "pan_tilt", "platform"], 2))
def test_every_bundled_view_in_space_moves(name: str) -> None:
    found = animate(hb.load(f"spatial/{name}"), "1 s", every="20 ms")
    low, high = np.array(found.edges[:3]), np.array(found.edges[3:])
    for solid in found.solids:
        assert all(np.isfinite(course).all() for course in solid.courses.values()), solid.name
        if solid.kind != "level":
            for key in {"at", "from", "to"} & set(solid.courses):
                place = solid.courses[key].T
                assert (place >= low - 1e-9).all() and (place <= high + 1e-9).all(), solid.name
    assert max(float(np.ptp(c, axis=1).max()) for s in found.solids for c in s.courses.values()) > 0.01


@pytest.fixture(scope="module")
def tab(motion: Motion, tmp_path_factory: pytest.TempPathFactory) -> Iterator[browser.Tab]:
    if browser.browser() is None:
        pytest.skip("no browser is installed")
    folder = tmp_path_factory.mktemp("space")
    found = browser.Tab(folder / "profile")
    found.open(motion.save(folder / "turntable.html"))
    yield found
    found.close()


def _picture(tab: browser.Tab) -> np.ndarray:
    """The picture that the button PNG saves."""
    address = tab.run("scene.picture().toDataURL('image/png')")
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(address.partition(",")[2]))).convert("RGB"), float)


def test_the_machine_moves_in_a_browser(tab: browser.Tab, motion: Motion) -> None:
    first = _picture(tab)
    assert 0.05 < (first.min(axis=2) < 245).mean() < 0.95
    assert (np.abs(first - [194, 65, 12]).sum(axis=2) < 250).any()  # the red weight
    end = tab.run("""(() => { const slider = document.getElementById("when"); slider.value = slider.max;
        slider.dispatchEvent(new Event("input"));
        return scene.solids.find(found => found.solid.name === "head").group.position.toArray(); })()""")
    np.testing.assert_allclose(end, _solid(motion, "head").courses["at"][:, -1], atol=1e-4)
    assert np.abs(_picture(tab) - first).max() > 100
    assert [address for address in tab.requested() if not address.startswith(("file:", "about:", "blob:"))] == []
    assert tab.complaints == []


def test_an_overlaid_run_has_its_own_time(tab: browser.Tab, motion: Motion, tmp_path: Path) -> None:
    short = animate(hb.loads(TURNTABLE), "0.5 s")
    path = tmp_path / "both.html"
    path.write_text(str(animation_page(motion.with_runs({"short": short}))), encoding="utf-8")
    tab.open(path)
    tab.wait("Boolean(window.scene?.solids)")
    turn = "window.scene.solids.find(found => found.solid.name === 'arm' && found.run === {}).group.quaternion.toArray()"
    for frame, expected in ((30, True), (90, False)):
        tab.run(f"window.scene.show({frame}); 1")
        same = tab.run(turn.format(0)) == pytest.approx(tab.run(turn.format(1)), abs=1e-3)
        assert same is expected  # the shorter run stays at its end
    tab.click("[data-kind='run 1']")
    assert not tab.run("window.scene.solids.some(found => found.run === 1 && found.group.visible)")


def test_keys_turn_the_camera_and_it_follows_a_body(tab: browser.Tab) -> None:
    place = "scene.camera.position.toArray()"
    tab.run("document.querySelector('canvas').focus()")
    before = np.array(tab.run(place))
    tab.key("ArrowLeft", code=37)
    turned = np.array(tab.run(place))
    assert turned[2] == pytest.approx(before[2]) and np.linalg.norm(turned - before) > 0.1
    tab.key("+", text="+")
    assert np.linalg.norm(np.array(tab.run(place)) - turned) > 0.1
    tab.key("0", text="0")
    np.testing.assert_allclose(tab.run(place), before, atol=1e-6)
    moved = tab.run("""(() => {
        const slider = document.getElementById("when"), select = document.querySelector("#camera select");
        const at = value => { slider.value = value; slider.dispatchEvent(new Event("input"));
            return scene.controls.target.clone(); };
        at(0); select.value = "head"; select.dispatchEvent(new Event("change"));
        const one = at(0), other = at(slider.max); select.value = ""; select.dispatchEvent(new Event("change"));
        return other.sub(one).toArray(); })()""")
    np.testing.assert_allclose(moved, [2*np.cos(1) - 2, 2*np.sin(1), 0], atol=1e-3)
    tab.run("document.querySelector('#camera [data-kind=arrow]').click()")
    assert tab.run("scene.solids.find(found => found.solid.name === 'pull').group.visible") is False
    assert "arrow keys turn the camera" in tab.run("document.querySelector('canvas').getAttribute('aria-label')")
