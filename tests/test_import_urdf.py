"""Robots in URDF: accelerations of the imported diagram beside Pinocchio's own reader, and the messages for wrong files."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from collected import for_each, partly
from scipy.spatial.transform import Rotation

import heavebond as hb
from heavebond.cli import main
from heavebond.core.errors import UsageError
from heavebond.imports.urdf import DRIVEN, import_urdf, read_urdf

BENCH_ARM = Path(__file__).parent.parent / "models" / "spatial" / "bench_arm.urdf"


def random_arm(seed: int, kinds: tuple[str, ...]) -> str:
    """A tree with oblique axes, turned frames, full inertia tensors in turned inertial frames, and parts on fixed joints."""
    random = np.random.default_rng(seed)

    def triple(size: float = 1.0) -> str:
        return " ".join(repr(float(value)) for value in random.uniform(-size, size, 3))

    lines = ['<robot name="random">', '<link name="l0"/>']
    for k, kind in enumerate(kinds, 1):
        points = random.normal(size=(6, 3))
        J = sum(point @ point*np.eye(3) - np.outer(point, point) for point in points)/6
        tensor = " ".join(f'{name}="{float(J[i])!r}"' for name, i in (("ixx", (0, 0)), ("ixy", (0, 1)), ("ixz", (0, 2)),
                                                                     ("iyy", (1, 1)), ("iyz", (1, 2)), ("izz", (2, 2))))
        axis = random.normal(size=3)
        axis = " ".join(repr(float(value)) for value in axis/np.linalg.norm(axis))
        limit = "" if kind == "fixed" else '<limit lower="-2" upper="2" effort="10" velocity="3"/>'
        lines += [f'<link name="l{k}"><inertial><origin xyz="{triple(0.3)}" rpy="{triple(3)}"/>'
                  f'<mass value="{float(random.uniform(1, 5))!r}"/><inertia {tensor}/></inertial></link>',
                  f'<joint name="j{k}" type="{kind}"><parent link="l{max(0, k - int(random.integers(1, 3)))}"/>'
                  f'<child link="l{k}"/><origin xyz="{triple()}" rpy="{triple(3)}"/><axis xyz="{axis}"/>{limit}</joint>']
    return "\n".join([*lines, "</robot>"])


ARMS = [BENCH_ARM.read_text(encoding="utf-8"),
        random_arm(1, ("revolute", "prismatic", "fixed", "continuous", "revolute", "fixed", "prismatic")),
        random_arm(2, ("continuous", "revolute", "revolute", "fixed", "revolute", "prismatic", "revolute", "revolute"))]


@pytest.mark.parametrize("number", partly(range(len(ARMS)), 3))
def test_accelerations_by_the_reader_of_pinocchio(number: int, tmp_path: Path) -> None:
    """At random coordinates and speeds, with damping and friction: 1e-9 of the largest acceleration."""
    pin = pytest.importorskip("pinocchio", reason="Pinocchio (pin) is not installed")
    path = tmp_path / "arm.urdf"
    path.write_text(ARMS[number], encoding="utf-8")
    robot, text = read_urdf(path), import_urdf(path).files["arm.yaml"]
    tree = pin.buildModelFromXML(ARMS[number])
    random = np.random.default_rng(number)
    q, v = pin.neutral(tree), random.uniform(-1, 1, tree.nv)
    G = np.zeros((tree.nv, tree.nv))  # the speeds of all joints from those of the leaders
    free = []
    for name in tree.names[1:]:
        joint, known = robot.joints[name], tree.joints[tree.getJointId(name)]
        leader = joint.name if joint.mimic is None else joint.mimic[0]
        G[known.idx_v, tree.joints[tree.getJointId(leader)].idx_v] = 1.0 if joint.mimic is None else joint.mimic[1]
        free += [name] if joint.mimic is None else []
    v, start = G @ v, G @ random.uniform(-1, 1, tree.nv)
    for name in tree.names[1:]:
        joint, known = robot.joints[name], tree.joints[tree.getJointId(name)]
        value, turning = start[known.idx_v], joint.kind in ("revolute", "continuous")
        q[known.idx_q:known.idx_q + known.nq] = [np.cos(value), np.sin(value)] if known.nq == 2 else [value]
        position, speed, unit = ("phi", "w", "rad") if turning else ("s", "v", "m")
        text, changes = re.subn(rf"^  {name}\.{position}: 0 {unit}$", f"  {name}.{position}: {float(value)!r} {unit}", text,
                                flags=re.MULTILINE)
        assert changes == 1
        text = text.replace(f"  {name}.{speed}: 0 {unit}/s", f"  {name}.{speed}: {float(v[known.idx_v])!r} {unit}/s")
        text = text.replace("show:\n", f"show:\n  a_{name}: {{is: der({name}.{speed}), unit: {unit}/s**2}}\n")
    run = hb.simulate(hb.loads(text), "1 us", every="1 us")
    order = [tree.joints[tree.getJointId(name)].idx_v for name in free]
    damping, friction = (np.array([getattr(robot.joints[name], what) for name in tree.names[1:]])
                         for what in ("damping", "friction"))
    data = tree.createData()
    forces = -damping*v - friction*np.tanh(v/0.01) - pin.nonLinearEffects(tree, data, q, v)
    M = pin.crba(tree, data, q)
    M = np.triu(M) + np.triu(M, 1).T
    H = G[:, order]
    expected = np.linalg.solve(H.T @ M @ H, H.T @ forces)
    found = np.array([run[f"a_{name}"][0] for name in free])
    assert found == pytest.approx(expected, abs=1e-9*np.abs(expected).max())
    assert all(robot.joints[name].kind in DRIVEN for name in free)


FREE = """<robot name="drone">
  <link name="world"/>
  <link name="body"><inertial><origin xyz="0.1 0 0.2" rpy="0.3 0 0"/><mass value="2"/>
    <inertia ixx="0.1" ixy="0.01" ixz="0" iyy="0.2" iyz="0.02" izz="0.15"/></inertial></link>
  <joint name="free" type="floating"><parent link="world"/><child link="body"/>
    <origin xyz="0 0 3" rpy="0.1 0.2 0.3"/></joint>
  <link name="sledge"><inertial><mass value="3"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
  <joint name="ice" type="planar"><parent link="world"/><child link="sledge"/><axis xyz="0 -0.6 0.8"/></joint>
  <link name="lead"><inertial><mass value="1"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
  <joint name="crank" type="revolute"><parent link="world"/><child link="lead"/><limit lower="0.5" upper="2"/></joint>
  <link name="rod"><inertial><origin xyz="0 0 0.1"/><mass value="0.5"/></inertial></link>
  <joint name="slide" type="prismatic"><parent link="world"/><child link="rod"/><axis xyz="0 0 1"/>
    <mimic joint="crank" multiplier="-0.2" offset="0.05"/></joint>
  <link name="disc"/>
  <joint name="wheel" type="continuous"><parent link="world"/><child link="disc"/>
    <mimic joint="slide" multiplier="3" offset="0.4"/></joint>
  <transmission name="t"/>
</robot>"""


def test_floating_and_planar_joints_and_chains_of_mimics(tmp_path: Path) -> None:
    """A free body falls, a sledge slides down its plane with g sin(alpha), a rack lifts a rod, and a wheel follows it."""
    (tmp_path / "drone.urdf").write_text(FREE, encoding="utf-8")
    imported = hb.import_model(tmp_path / "drone.urdf", tmp_path)
    assert [(item.submodel, item.line, item.reason) for item in imported.untranslated] == [
        ("robot", 19, "1 <transmission> element, not part of the mechanics")]
    run = hb.simulate(hb.load(imported.path), "0.2 s")
    t = run.time
    turn = Rotation.from_euler("xyz", [0.1, 0.2, 0.3])
    centre = turn.apply([0.1, 0, 0.2])[2] + 3
    assert run["body.z"] + np.asarray(run["body.r[3]"]) == pytest.approx(centre - 9.81*t**2/2, abs=1e-7)
    assert run["sledge.z"] == pytest.approx(-0.6**2*9.81*t**2/2, abs=1e-7)
    # the weight of the rod turns the crank: (J + m k**2) a = -m g k
    angle = 0.5 + 0.5*9.81*0.2/(0.1 + 0.5*0.2**2)*t**2/2
    assert run.si["crank.phi"] == pytest.approx(angle, abs=1e-7)
    assert run["rod.z"] == pytest.approx(0.05 - 0.2*angle, abs=1e-7)
    wheel = Rotation.from_quat(np.stack([run[f"disc.q_{k}"] for k in (1, 2, 3, 0)], axis=-1)).as_rotvec()[:, 0]
    assert wheel == pytest.approx(3*(0.05 - 0.2*angle) + 0.4, abs=1e-7)


BODY = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
ARM = (f'<robot name="arm"><link name="base"/><link name="boom">{BODY}</link>\n<joint name="pin" type="revolute">'
       '<parent link="base"/><child link="boom"/><axis xyz="0 1 0"/></joint></robot>')
END, SECOND = "</robot>", '<joint name="two" type="fixed"><parent link="{}"/><child link="{}"/></joint></robot>'
MISTAKES = {
    "": "urdf-xml", "arm": "urdf-xml", "<robot><link></robot>": "urdf-xml",
    '<!DOCTYPE x [<!ENTITY a "b">]>\n' + ARM: "urdf-doctype",
    '<sdf version="1.9"/>': "urdf-root", '<robot xmlns:xacro="x"><xacro:property name="a"/></robot>': "urdf-xacro",
    '<robot name="arm"/>': "urdf-link", ARM.replace(BODY, ""): "urdf-mass", ARM.replace("revolute", "ball"): "urdf-joint",
    ARM.replace(' type="revolute"', ""): "urdf-joint", ARM.replace('<child link="boom"/>', ""): "urdf-joint",
    ARM.replace('<link name="base"/>', '<link name="base"/><link name="other"/>'): "urdf-roots",
    ARM.replace(END, SECOND.format("base", "boom")): "urdf-loop",
    ARM.replace(END, SECOND.format("boom", "base")): "urdf-loop",
    ARM.replace('child link="boom"', 'child link="bom"'): "urdf-link", ARM.replace("0 1 0", "0 0 0"): "urdf-number",
    ARM.replace("0 1 0", "0 1"): "urdf-number", ARM.replace('value="1"', 'value="one"'): "urdf-number",
    ARM.replace('value="1"', 'value="-1"'): "urdf-mass", ARM.replace('izz="1"', 'izz="-1"'): "urdf-inertia",
    ARM.replace(BODY, '<inertial><mass value="1"/></inertial>'): "urdf-inertia",
    ARM.replace('link name="boom"', 'link name="base"'): "urdf-name",
    ARM.replace("<axis", '<mimic joint="pin"/><axis'): "urdf-mimic",
    ARM.replace("<axis", '<limit lower="2" upper="1"/><axis'): "urdf-limit",
    ARM.replace("<axis", '<dynamics damping="-1"/><axis'): "urdf-number",
}


@for_each("text, code", MISTAKES.items())
def test_mistakes_of_a_file(text: str, code: str, tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(hb.ModelError) as caught:
        hb.import_model(path, tmp_path / "arm")
    first = caught.value.problems[0]
    assert first.code == code and first.place is not None and first.hint
    assert not (tmp_path / "arm").exists()


def test_a_decimal_comma_is_one_mistake(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(ARM.replace('izz="1"', 'izz="0,25"'), encoding="utf-8")
    with pytest.raises(hb.ModelError) as caught:
        hb.import_model(tmp_path / "arm.urdf", tmp_path)
    assert len(caught.value.problems) == 1 and 'izz="0.25"' in caught.value.problems[0].hint


@for_each("name, remedy", [("arm.xacro", "xacro arm.xacro -o arm.urdf"), ("arm.sdf", "URDF"), ("arm.xml", "arm.urdf"),
                           ("arm.txt", ".urdf")])
def test_other_files_are_refused_with_the_remedy(name: str, remedy: str) -> None:
    with pytest.raises(hb.UsageError) as caught:
        hb.import_model(name)
    assert caught.value.problems[0].code == "import-suffix" and remedy in str(caught.value)


def test_the_command(tmp_path: Path) -> None:
    run = CliRunner().invoke(main, ["import", "spatial/bench_arm.urdf", "-o", str(tmp_path)])  # a bundled robot
    assert run.exit_code == 0 and "next: heavebond check" in run.output
    assert "cannot find the mesh 'package://bench_arm/hand.stl'" in run.output
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bench_arm.yaml"]
    text = (tmp_path / "bench_arm.yaml").read_text(encoding="utf-8")
    for shape in ("ground: {is: ground, at: base}",
                  "column_2: {is: disc, at: [column, 0.03 m, 0.03 m, 0.2 m], diameter: 0.12 m, width: 0.1 m, "
                  "axis: [0, -1, 0]}",
                  "hand: {is: box, at: [hand, 0 m, 0 m, 0.05 m], size: [0.05 m, 0.1 m, 0.1 m]}"):
        assert f"  {shape}\n" in text
    assert hb.load(tmp_path / "bench_arm.yaml").name == "bench_arm"
    run = CliRunner().invoke(main, ["import", str(BENCH_ARM), "--globals", "x.emx"])
    assert run.exit_code == 2 and "import-option" in run.output


def _box(path: Path, edges: tuple[float, float, float], corner: tuple[float, float, float], faces: int = 12) -> None:
    """A mesh (OBJ) of the first triangles of a box."""
    corners = [[c + e*bit for c, e, bit in zip(corner, edges, bits, strict=True)]
               for bits in ((i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1))]
    sides = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]  # seen from outside
    triangles = [f"f {a} {b} {c}" for p, q, r, s in sides for a, b, c in ((p, q, r), (p, r, s))]
    path.write_text("\n".join([*(f"v {x} {y} {z}" for x, y, z in corners), *triangles[:faces]]) + "\n")


def test_a_mesh_becomes_a_body(tmp_path: Path) -> None:
    """A box of 200, 300 and 600 mm, whose nearest corner is at 100, -50 and 0 mm."""
    pytest.importorskip("trimesh", reason="trimesh is not installed")
    _box(tmp_path / "block.obj", (200, 300, 600), (100, -50, 0))
    imported = hb.import_model(tmp_path / "block.obj", tmp_path / "out")
    model = hb.load(imported.path)
    run = hb.simulate(model, "0.1 s")
    p = {name: float(run[name][0]) for name in ["block.m", *(f"block.{word}_{x}" for word in "lJ" for x in "xyz")]}
    a, b, c, m = 0.2, 0.3, 0.6, 7850*0.036
    assert p["block.m"] == pytest.approx(m) and [p[f"block.l_{x}"] for x in "xyz"] == pytest.approx([0.2, 0.1, 0.3])
    assert [p[f"block.J_{x}"] for x in "xyz"] == pytest.approx([m/12*(b*b + c*c), m/12*(a*a + c*c), m/12*(a*a + b*b)])
    solid = hb.animate(model, "0.1 s").solids[0]
    assert solid.kind == "mesh" and solid.courses["size"][0, 0] == 1e-3
    _box(tmp_path / "open.obj", (1, 1, 1), (0, 0, 0), 10)
    with pytest.raises(UsageError, match="not closed"):
        hb.import_model(tmp_path / "open.obj", tmp_path / "out")


@pytest.mark.long
def test_meshes_of_a_robot_are_shown(tmp_path: Path) -> None:
    """The folder of the package is above the folder of the robot."""
    pytest.importorskip("trimesh", reason="trimesh is not installed")
    (tmp_path / "bench_arm/urdf").mkdir(parents=True)
    _box(tmp_path / "bench_arm/hand.obj", (50, 100, 100), (0, 0, 0))
    text = BENCH_ARM.read_text(encoding="utf-8")
    for line in ('<mesh filename="package://bench_arm/hand.obj" scale="0.001 0.001 0.001"/>',
                 '<mesh filename="../hand.obj"/>', '<mesh filename="package://bench_arm/hand.obj" scale="1 1 2"/>'):
        urdf = tmp_path / "bench_arm/urdf/arm.urdf"
        urdf.write_text(text.replace('<mesh filename="package://bench_arm/hand.stl"/>', line))
        imported = hb.import_model(urdf, tmp_path / "out")
        shown = "unit: 0.001 m" in imported.path.read_text(encoding="utf-8")
        assert shown == ("0.001" in line) != any("mesh" in item.reason for item in imported.untranslated)
        if shown:
            assert any(solid.kind == "mesh" for solid in hb.animate(imported.path, "0.05 s").solids)


@pytest.mark.long
def test_a_hidden_friction_is_localised_in_the_imported_robot(tmp_path: Path) -> None:
    """MuJoCo simulated the records from the same URDF file, with Coulomb friction of 0.4 N*m in the tilting joint."""
    spatial = BENCH_ARM.parent
    hb.import_model(spatial / "pan_tilt.urdf", tmp_path)
    (tmp_path / "hanging.yaml").write_text("model: hanging\nextends: pan_tilt.yaml\ninitial: {tilt.phi: 90 deg}\n")
    text = (spatial / "pan_tilt_friction.yaml").read_text(encoding="utf-8")
    for old, new in (("model: pan_tilt.yaml", "model: hanging.yaml"), ("_oil.d", "_damper.d"),
                     ("data/", f"{spatial}/data/")):
        text = text.replace(old, new)
    (tmp_path / "friction.yaml").write_text(text, encoding="utf-8")
    found = hb.localize(tmp_path / "friction.yaml")
    assert found.suspects[0].place.name == "housing_end-tilt_drive"
