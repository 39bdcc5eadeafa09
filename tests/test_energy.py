"""The energy audit: signs, sums, what it says where a law leaks, and the integrals it stands on."""

from __future__ import annotations

from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

import heavebond as hb
from heavebond.energy_audit.audit import EnergyAudit, EnergyLine, table
from heavebond.energy_audit.audit import energy as audit

LIFT = """
model: lift
components:
  rope:   {{is: ConstantForce, F: 700 N}}
  load:   {{is: Mass, m: 50 kg}}
  weight: {{is: Weight, m: 50 kg}}
  damper: {{is: {damper}, d: 100 N*s/m}}
  frame:  {{is: Fixed}}
nodes:
  load:  [rope.a, load.a, weight.a, damper.b]
  frame: [damper.a, frame.a]
initial: {{load.x: 0 m, load.v: 0 m/s}}
simulate: {{until: 3 s, every: 10 ms}}
"""
LEAKY = """\
component: LeakyDamper
summary: A damper that holds less than it pulls.
ports: {a: translational, b: translational}
parameters:
  d: {unit: N*s/m, min: 0, doc: damping}
equations: |
  b.f = d * (b.v - a.v)          # viscous law
  a.f = -0.9 * d * (b.v - a.v)   # a tenth of the force is lost
dissipates: 0.9 * d * (b.v - a.v)**2
"""


def line(found: EnergyAudit, name: str) -> EnergyLine:
    return next(one for one in found.lines if one.component == name)


def test_a_lift_by_hand() -> None:
    """v = (F - m g)/d (1 - exp(-d t/m)), so that every energy is known."""
    found = audit(hb.loads(LIFT.format(damper="Damper"))).raise_if_open()
    force, m, d, t = 700 - 50 * 9.81, 50, 100, 3
    decay = np.exp(-d * t / m)
    v = force / d * (1 - decay)
    x = force / d * (t - m / d * (1 - decay))
    assert line(found, "rope").supplied == pytest.approx(700 * x, rel=1e-7)
    assert line(found, "weight").supplied == pytest.approx(-50 * 9.81 * x, rel=1e-7)
    assert line(found, "load").stored == pytest.approx(m * v**2 / 2, rel=1e-7)
    assert line(found, "load").energy_in == pytest.approx(m * v**2 / 2, rel=1e-7)
    assert line(found, "damper").dissipated == pytest.approx(force * x - m * v**2 / 2, rel=1e-7)
    assert found.supplied == pytest.approx(700 * x, rel=1e-7)
    assert found.taken == pytest.approx(-50 * 9.81 * x, rel=1e-7)
    assert found.largest == pytest.approx(700 * x, rel=1e-7)
    assert found.unbalanced == 0
    assert found.nodes < 1e-14


def test_a_law_that_leaks_is_named(tmp_path: Path) -> None:
    (tmp_path / "leaky.yaml").write_text(LEAKY)
    found = audit(hb.loads(LIFT.format(damper="LeakyDamper"), tmp_path))
    assert not found.closes()
    assert found.closes(0.2)
    with pytest.raises(hb.SimulationError) as error:
        found.raise_if_open()
    problem = error.value.problems[0]
    assert problem.code == "energy-open"
    assert len(problem.notes) == 1
    assert problem.notes[0].startswith("damper: +")
    assert line(found, "damper").imbalance == pytest.approx(0.1 * line(found, "damper").energy_in, rel=1e-6)


def test_integrals_are_exact_where_the_states_are_straight_lines() -> None:
    """Force and velocity are linear in time, the power is too: nothing in the states asks for short steps."""
    found = audit(hb.loads("""
model: push
components:
  push: {is: ConstantForce, F: 6 N}
  cart: {is: Mass, m: 3 kg}
nodes: {cart: [push.a, cart.a]}
initial: {cart.v: 1 m/s}
simulate: {until: 2 s, every: 0.5 s}
"""))
    assert line(found, "push").supplied == pytest.approx(6 * (2 + 2 * 2**2 / 2), rel=1e-9)
    assert found.closes(1e-9)


def test_a_machine_without_exchange_closes() -> None:
    found = audit(hb.loads("""
model: idle
components: {cart: {is: Mass, m: 3 kg}}
nodes: {cart: [cart.a]}
initial: {cart.v: 0 m/s}
simulate: {until: 1 s}
"""))
    assert found.largest == 0
    assert found.closes(0)


def test_parameters_and_assemblies_are_taken_as_by_simulate() -> None:
    assembly = hb.assemble(hb.loads(LIFT.format(damper="Damper")))
    slow, fast = (audit(assembly, 3, parameters={"damper.d": d}) for d in (400.0, "50 N*s/m"))
    assert slow.supplied < fast.supplied
    assert slow.closes()
    assert fast.closes()


@pytest.mark.parametrize("name", ["passive_rig", "passive_rig/passive_rig_friction", "cylinder_rig", "receiver_rig",
                                  "emps", "cascaded_tanks", pytest.param("cmc_ahc", marks=pytest.mark.long)])
def test_bundled_machines_close(name: str) -> None:
    found = audit(hb.load(name)).raise_if_open(1e-6)
    assert found.nodes < 1e-12
    for one in found.lines:
        assert one.dissipated >= -1e-9 * found.largest, one.component


def test_table_shows_every_component_and_the_reasons() -> None:
    found = audit(hb.load("cylinder_rig"), 4)
    out = StringIO()
    Console(file=out, width=200).print(table(found))
    text = out.getvalue()
    assert all(one.component in text for one in found.lines)
    assert "supplied" in text
    assert "storage function" in text
    assert "energy over 4 s in kJ" in text


def test_a_run_of_next_to_no_energy_is_told() -> None:
    """1e-9 s of a small filter: sizes whose logarithms are far below those of the unit."""
    assert table(hb.energy(hb.load("examples/filter"), until=1e-9, every=1e-10))
