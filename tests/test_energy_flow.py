"""Powers at ports, activity, the flow of energy, reduced diagrams, and the command's audit."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from collected import partly
from test_energy import LEAKY, LIFT, line

import heavebond as hb
from heavebond.cli import main
from heavebond.energy_audit.audit import energy as audit
from heavebond.energy_audit.audit import with_blocks
from heavebond.energy_audit.power_flow import energy_flow
from heavebond.pictures.plot import save
from heavebond.pictures.plot_energy import plot_activity, plot_energy_flow

SWING = """
model: swing
components:
  wall:   {is: Fixed}
  spring: {is: Spring, c: 400 N/m}
  cart:   {is: Mass, m: 4 kg}
  rider:  {is: Mass, m: 1 g}
  film:   {is: Damper, d: 1 mN*s/m}
  weight: {is: ConstantForce, F: =1000*rider.m*1 m/s**2}
nodes:
  ground: [wall.a, spring.a, film.a]
  load:   [spring.b, cart.a, rider.a, film.b, weight.a]
initial: {load.x: 10 mm, load.v: 0 m/s}
show: {x: {is: load.x, unit: mm}}
simulate: {until: 6.283185307179586 s, every: 1 ms}
"""


def test_the_power_at_a_port_is_a_signal() -> None:
    result = hb.simulate(hb.loads(LIFT.format(damper="Damper")))
    assert np.allclose(result["damper.b.power"], result["damper.b.f"]*result["load.v"])
    assert result.unit("damper.b.power") == "kg*m**2/s**3" or result.unit("damper.b.power") == "W"
    gas = hb.simulate(hb.load("receiver_rig"), 1)
    flows = [name for name in gas.assembly.flat.bonds if not gas.assembly.flat.bonds[name].efforts]
    assert np.array_equal(gas[f"{flows[0]}.power"], gas[f"{flows[0]}.H"])
    with pytest.raises(hb.UsageError, match=r"nothing here is called 'damper\.c\.power'"):
        result["damper.c.power"]


def test_activity_and_what_is_delivered_by_hand() -> None:
    """x = A cos(w t) over ten periods: the spring takes c A^2/2 in and gives it out twice a period."""
    found = audit(hb.loads(SWING.replace("F: =1000*rider.m*1 m/s**2", "F: 0 N")))
    energy = 400 * 0.01**2 / 2
    # w changes by 1e-4 with the rider, the film takes 1e-3; the trapezoidal rule is off by (w dt)^2
    assert line(found, "spring").activity == pytest.approx(40 * energy, rel=3e-3)
    assert line(found, "spring").delivered == pytest.approx(20 * energy, rel=3e-3)
    assert line(found, "spring").start == pytest.approx(energy, rel=1e-9)
    assert line(found, "cart").start == 0
    names = [one.component for one, _ in found.ranking]
    assert set(names[:2]) == {"spring", "cart"}
    assert sum(share for _, share in found.ranking) == pytest.approx(1)
    told = found.as_dict()
    assert json.loads(json.dumps(told))["closes"] is True


def test_a_closed_block_is_one_component_and_nothing_is_lost() -> None:
    """The sums of a block are those of its components, and its power is that over its own ports."""
    found = audit(hb.load("cmc_ahc"), "24 s")
    closed = with_blocks(found, ["ahc", "cmc"])
    assert {one.component for one in closed.lines} >= {"ahc", "cmc", "drilling.hook"}
    assert not any(one.component.startswith(("ahc.", "cmc.")) for one in closed.lines)
    for total in ("supplied", "stored", "dissipated", "unbalanced"):
        assert getattr(closed, total) + closed.taken == pytest.approx(getattr(found, total) + found.taken, rel=1e-12)
    parts = [one for one in found.lines if one.component.startswith("ahc.")]
    block = line(closed, "ahc")
    assert block.energy_in == pytest.approx(sum(one.energy_in for one in parts))
    power = closed.ports["ahc.a"] + closed.ports["ahc.b"]
    time = closed.result.time
    assert float(np.trapezoid(power, time)) == pytest.approx(block.energy_in, rel=1e-3)  # samples against an integral
    assert block.activity == pytest.approx(float(np.trapezoid(abs(power), time)))
    assert np.array_equal(closed.result["ahc.a.power"], closed.ports["ahc.a"])
    flow = energy_flow(closed)
    assert ("ahc", False) in flow.boxes and not any(key.path.startswith("ahc.") for key in flow.boxes)
    with pytest.raises(hb.UsageError, match=r"there is no block 'ach' to close(.|\n)*Did you mean 'ahc'"):
        with_blocks(found, ["ach"])


@pytest.mark.parametrize("name", partly(["cylinder_rig", "cmc_ahc", "receiver_rig", "passive_rig"], 2))
def test_what_flows_into_a_box_stays_or_leaves(name: str, tmp_path: Path) -> None:
    """Every box but a node: in - out = heat + stored - supplied, but for what is too small to be drawn."""
    found = audit(hb.load(name))
    flow = energy_flow(found)
    largest = max(link.energy for link in flow.links)
    for box in flow.boxes.values():
        gained = sum(k.energy for k in flow.links if k.target == box.key) - \
            sum(k.energy for k in flow.links if k.source == box.key)
        kept = 0.0 if box.key.node else box.dissipated + box.stored - box.supplied
        assert abs(gained - kept) < 0.02 * largest, box.key
    for link in flow.links:
        forward = flow.boxes[link.target].column > flow.boxes[link.source].column
        assert forward is not link.back
    assert save(plot_energy_flow(flow, title=name), tmp_path / "flow.png").stat().st_size > 10_000
    assert save(plot_activity(found), tmp_path / "activity.svg").stat().st_size > 10_000


def test_what_matters_little_goes_and_what_follows_it_stays() -> None:
    """The gram on the cart moves its period by 1/8000; the force that follows its mass keeps its 1 N."""
    model = hb.loads(SWING)
    found = hb.simplify(model, 0.99)
    assert {one.component for one in found.removed} == {"rider", "film"}
    assert "weight.F" in next(one for one in found.removed if one.component == "rider").step.settings
    # the phase drifts by 10 pi/4000 over ten periods, the film takes 0.08 % of the amplitude: exact runs side by side
    before, after = hb.simulate(model), hb.simulate(found.model)
    rms = np.sqrt(np.mean((before.display["x"] - after.display["x"])**2)) / before.display["x"].std()
    assert found.errors["x"] == pytest.approx(rms, rel=1e-3)
    assert 0 < found.errors["x"] < 0.01
    assert hb.simplify(model, 0.99, limit=1e-9).removed == ()


def test_a_stiff_part_in_line_is_not_removed() -> None:
    """A stiff spring between force and mass is little active, but without it nothing is left to push."""
    text = SWING.replace("  film:   {is: Damper, d: 1 mN*s/m}", "  film:   {is: SpringDamper, c: 40 kN/m, d: 1 N*s/m}") \
        .replace("[wall.a, spring.a, film.a]", "[spring.a, film.b]\n  base:   [wall.a, film.a]") \
        .replace("rider.a, film.b, weight.a]", "rider.a, weight.a]").replace("initial: {", "initial: {ground.x: 0 m, ")
    found = hb.simplify(hb.loads(text), 0.98)
    film = next(one for one in found.tried if one.component == "film")
    assert film.kept
    assert not film.step.settings


def _run(words: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as caught:
        main(words)
    said = capsys.readouterr()
    return int(caught.value.code or 0), said.out, said.err


def test_the_audit_fails_loudly(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    Path("leaky.yaml").write_text(LEAKY)
    Path("lift.yaml").write_text(LIFT.format(damper="LeakyDamper"))
    code, out, err = _run(["energy", "lift.yaml", "--audit", "--json", "told.json"], capsys)
    assert code == 1
    assert "missing" in out
    assert "damper: +" in err
    assert json.loads(Path("told.json").read_text())["problems"][0]["code"] == "energy-open"
    assert _run(["energy", "lift.yaml"], capsys)[0] == 1  # every run ends with a verdict on its power balance
    code, out, _ = _run(["energy", "passive_rig", "--audit"], capsys)
    assert code == 0
    assert "closes" in out


def test_the_command_writes_a_reduced_diagram(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                              capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    Path("swing.yaml").write_text(SWING)
    code, out, _ = _run(["energy", "swing.yaml", "--reduce", "99", "--write", "small.yaml", "--sankey", "flow.svg",
                         "--activity", "bars.png", "--json", "told.json"], capsys)
    assert code == 0
    assert "film.d = 0" in out
    told = json.loads(Path("told.json").read_text())
    assert told["reduced"]["errors"]["x"] < 0.01
    assert told["files"] == ["flow.svg", "bars.png", "small.yaml"]
    small, whole = hb.simulate(hb.load("small.yaml")), hb.simulate(hb.load("swing.yaml"))
    rms = np.sqrt(np.mean((small.display["x"] - whole.display["x"])**2)) / whole.display["x"].std()
    assert rms == pytest.approx(told["reduced"]["errors"]["x"], rel=1e-3)


def test_options_that_need_another_one_say_so(capsys: pytest.CaptureFixture[str]) -> None:
    for words, said in ((["energy", "quarter_car", "--write", "small.yaml"], "Add --reduce 98"),
                        (["draw", "quarter_car", "--at", "1 s"], "Add for example --colour power")):
        with pytest.raises(SystemExit) as caught:
            main(words)
        assert (caught.value.code, said in " ".join(capsys.readouterr().err.split())) == (2, True)
