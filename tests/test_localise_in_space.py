"""Localisation of a force on a node in space."""

from pathlib import Path

import numpy as np

import heavebond as hb

BALL = """model: ball
components:
  hook:   {is: SpatialFixed}
  spring: {is: SpatialSpring, c: 300 N/m, d: 1 N*s/m, l0: 0.5 m}
  ball:   {is: SpatialBody, m: 2 kg, J_x: 0.01 kg*m**2, J_y: 0.01 kg*m**2, J_z: 0.01 kg*m**2}
nodes:
  hook: [hook.a, spring.a]
  ball: [spring.b, ball.a]
initial: {ball.x: 0.1 m, ball.y: 0.2 m, ball.z: -0.55 m, ball.v_x: 0 m/s, ball.v_y: 0 m/s, ball.v_z: 0 m/s}
simulate: {until: 4 s, every: 20 ms}
"""


def test_a_force_along_one_axis_is_found(tmp_path: Path) -> None:
    """The records have a drag along y, which the diagram does not have."""
    drag = BALL.replace("  ball:   {", '  drag:   {is: SpatialForce, F: [0 N, "=-3 N*s/m*ball.v_y", 0 N], M: [0 N*m, 0 N*m, '
                        '0 N*m]}\n  ball:   {', 1).replace("ball.a]", "ball.a, drag.a]")
    run = hb.simulate(hb.loads(drag))
    places = np.array([run[f"ball.{axis}"] for axis in "xyz"]) + 2e-4*np.random.default_rng(0).standard_normal((3, 201))
    np.savetxt(tmp_path / "ball.csv", np.column_stack([run.time, *places]), delimiter=",", header="t,x,y,z", comments="")
    (tmp_path / "ball.yaml").write_text(BALL)
    (tmp_path / "drag.yaml").write_text("""experiment: drag
model: ball.yaml
records: {one: {file: ball.csv, use: fit}}
time: {column: t, unit: s}
outputs:
  ball.x: {column: x, unit: m, noise: 0.2 mm}
  ball.y: {column: y, unit: m, noise: 0.2 mm}
  ball.z: {column: z, unit: m, noise: 0.2 mm}
""")
    found = hb.localize(tmp_path / "drag.yaml")
    best = found.suspects[0]
    assert best.place.name == "ball.F_y"
    assert best.curve is not None and best.curve.variable.formula == "ball.v_y"
    assert found.words[0].startswith("At ball a force along y is missing")
