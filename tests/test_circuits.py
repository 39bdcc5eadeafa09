"""Circuits of library parts with data-sheet values (`models/circuits`): each runs to its end with the default settings,
and comes to where a calculation by hand says."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import heavebond as hb
from heavebond.numerics.output_times import grid

FOLDER = Path(__file__).parents[1] / "models" / "circuits"
G, BAR, LPM = 9.81, 1e5, 1e-3 / 60
HIT = np.sqrt(2.5**2 - 2 * 0.5 * 3) * np.sqrt(20e3 * 4e6)  # a wagon of 20 t against 4 MN/m after 3 m of braking
SLOW = {
    "crane", "crane_with_volumes", "electric_hoist", "compressor_station", "constant_pressure_axis",
    "hydraulic_winch", "pneumatic_hammer", "positioning_servo", "pwm_drive", "sliding_door", "vibrating_conveyor",
    "load_sensing", "gripper", "power_pack", "tipper", "water_hammer", "intensifier", "log_splitter",
}
LONG = {"clamp", "excavator_boom_drop", "hydrostatic_swing", "pile_driver", "pneumatic_stopper", "press", "regenerative",
        "scissor_lift", "sequence"}


def disc(d: float) -> float:
    """The area of a disc."""
    return float(np.pi / 4 * d**2)


class Ran:
    """A run whose signals are read at instants."""

    def __init__(self, name: str):
        self.run = hb.simulate(hb.load(FOLDER / f"{name}.yaml"))

    def __call__(self, signal: str, time: float | None = None) -> float:
        """A signal at a time, or at the end."""
        end = float(self.run.time[-1]) if time is None else time
        return float(np.interp(end, self.run.time, self.run.display[signal]))

    def most(self, signal: str) -> float:
        """Its largest value."""
        return float(self.run.display[signal].max())

    def least(self, signal: str) -> float:
        """Its smallest value."""
        return float(self.run.display[signal].min())


def near(value: float, share: float = 0.02, size: float = 0.0) -> object:
    """Within a share of a value that is estimated by hand, or a distance."""
    return pytest.approx(value, rel=share, abs=size or None)


# each yields pairs of what the run says and what is estimated
Pairs = list[tuple[float, object]]
CHECKS: dict[str, Callable[[Ran], Pairs]] = {
    # p V**n constant in the gas from the filling pressure on
    "accumulator_press": lambda r: [
        (r("store.V"), near(2.5e-3 * (1 - (91.01325 / (r("supply.p") / BAR + 1.01325)) ** (1 / 1.4)), 1e-3)),
        (r("tool.x"), near(0, size=1e-3))],
    # the piston rests in its buffer against the pressure
    "air_cannon": lambda r: [(r("ball.x") - 0.6, near((r("breech.p") - 101325) * 80e-4 / 8e6, size=2e-5))],
    "clamp": lambda r: [(r("part.F", 8), near(r("cap.p", 8) * disc(0.04), 0.01)), (r("cap.p", 8), near(r("cap.p", 4), 0.01)),
                        (r("tip.x"), near(0, size=1e-3))],
    "clutch_start": lambda r: [(r("crank.w"), near(12 * r("body.v") / 0.31, 1e-3))],  # it does not slip any more
    "compressor_station": lambda r: [(r.most("gauge.y"), near(8 * BAR, 1e-3)), (r("inlet.p"), near(5 * BAR + 101325, 0.01))],
    "constant_pressure_axis": lambda r: [(r("supply.p"), near(160 * BAR - r("pump.x") * 10 * BAR, 0.005)),
                                         (r.most("axis.x"), near(0.3, size=1e-3)), (r.least("axis.x"), near(0, size=1e-3))],
    # what the pump gives less its leakage at the load pressure; the relief valve takes that at the end of the stroke
    "crane": lambda r: [(r("hook.v", 8), near((28e-6 * 1450 / 60 - 28e-6 * 25 * 0.05 * 70 / 200) / disc(0.11))),
                        (r("supply.p", 17.9), near((210 + 21 * 38.3 / 60) * BAR)), (r("hook.x", 17.9), near(0.9, 1e-3)),
                        (r("hook.x"), near(0, size=1e-3))],
    "crane_with_volumes": lambda r: [
        (r("cap.p", 0), near((6000 * G + r("line_B.p", 0) * (disc(0.11) - disc(0.07))) / disc(0.11), 0.002)),
        (r("hook.x", 0.9), near(0.3, 1e-3)), (r("hook.x"), near(0.9, 1e-3))],
    # torque of the load through drum, gear and its loss; the brake holds
    "electric_hoist": lambda r: [(r("motor.i", 3.8), near((500 * G * 0.15 / 20 / 0.9 + 0.5) / 1.1)),
                                 (r("hook.x", 5.9), near(r("hook.x", 5), size=5e-3))],
    # oil and air of the cap side give way under the load, then it falls
    "excavator_boom_drop": lambda r: [(r("head.x", 0.95), near(
        0.9 - 10.3e-3 * (87e5 / 1.4e9 + 0.01 * (1 - 1 / 87)) / disc(0.12), size=5e-3)), (r("head.x"), near(0, size=1e-3))],
    "flywheel_press": lambda r: [(r.most("ram.x"), near(0.46, 1e-3)), (r.least("ram.x"), near(0.34, 1e-3)),
                                 (r("main.w"), near(0, size=0.02))],
    "gripper": lambda r: [(r("tip.x", 0.49), near(0.03, size=5e-4)), (r("tip.x", 0.99), near(0, size=5e-4)),
                          (r("A.p", 0.49), near(7 * BAR))],
    # flow of the pump less the leakage of the motor at the pressure of the load
    "hydraulic_winch": lambda r: [
        (r("hook.v", 6), near((1e-3 - 2.5e-3 * (1 / 0.95 - 1) * (r("up.p", 6) - r("down.p", 6)) / (200 * BAR)) / 1e-4
                              * 2 * np.pi / 25 * 0.2, 0.03)),
        (r("hook.x", 9.9), near(r("hook.x", 9.2), size=0.02))],
    "hydrostatic_swing": lambda r: [(r.most("turret.w"), near(55 * 2000 / 60 / 80 / 140 * 2 * np.pi, 0.03)),
                                    (r("turret.w"), near(0, size=1e-3))],
    "injection_unit": lambda r: [(r("cushion.F", 2.9), near(
        r("A.p", 2.9) * disc(0.1) - r("B.p", 2.9) * (disc(0.1) - disc(0.07)), 0.03)),
                                 (r("tip.x"), near(0, size=1e-3))],
    # areas of 30 and 10 cm**2: three times the pressure, less the friction of the seals
    "intensifier": lambda r: [(r("load.p"), near(3 * r("supply.p") - 300 / 10e-4, 0.05))],
    "load_sensing": lambda r: [(r("supply.p") - r("sensed.p"), near(20 * BAR)), (r("hook_1.x"), near(0.8, 1e-3)),
                               (r("hook_2.x"), near(0.6, 1e-3))],
    "log_splitter": lambda r: [(r("edge.v", 2), near(44 * LPM / disc(0.09))), (r("log.N", 11.9), near(3e6 * 0.03, 0.01)),
                               (r("edge.x"), near(0, size=1e-3))],
    "pile_driver": lambda r: [(r.least("hammer.v"), near(-np.sqrt(2 * G * r.most("hammer.x")), 0.03)),
                              (r("head.v"), near(0, size=1e-6))],
    "pneumatic_hammer": lambda r: [(float(sum(name == "anvil.impact" for _, name in r.run.events) > 3), near(1)),
                                   (r.least("hammer.x"), near(0, size=2e-3))],
    "pneumatic_press": lambda r: [
        (r("rubber.N", 3), near((r("port.p", 3) - 101325) * disc(0.1) - 400 - 2000 * r("tool.x", 3), 0.01)),
        (r("port.p", 3), near(7 * BAR, 0.01)), (r("tool.x"), near(0, size=1e-3))],
    "pneumatic_stopper": lambda r: [(r("tip.x", 0.65), near(0.025, size=2e-4)), (r("tip.x"), near(0, size=2e-4))],
    "positioning_servo": lambda r: [(r("slide.x", 0.95), near(0.1, size=0.01)), (r.most("slide.x"), near(0.31, size=3e-3)),
                                    (r("slide.x"), near(0.05, size=3e-3))],
    "power_pack": lambda r: [(r.most("supply.p"), near(150 * BAR, 0.01)), (r("supply.p") / BAR, near(135, size=15.1))],
    "press": lambda r: [(r("part.N", 7.9), near(r("cap.p", 7.9) * disc(0.16) + 8800
                                                - r("rod.p", 7.9) * (disc(0.16) - disc(0.11)), 0.01)),
                        (r("tool.x"), near(0, size=1e-3))],
    # the water stays above vacuum, and below the pressure of a rigid column, 4 bar - rho L dv/dt = 0.95 bar
    "pump_trip": lambda r: [(r("check.q", 1) + r("spill.q", 1), near(0.012, 1e-3)), (r("check.q"), near(0, size=1e-5)),
                            (r.least("foot.p") / BAR, near(-0.03, size=0.98))],
    # mean voltage, back-EMF, friction through the gear
    "pwm_drive": lambda r: [(r("fast.w"), near((0.6 * 24 - 0.8 * (0.6 / (30 * 0.85) + 0.008) / 0.05) / 0.05, 0.01))],
    "regenerative": lambda r: [(r("tip.v", 1.5), near(25 * LPM / disc(0.045))), (r("tip.x"), near(0.5, 1e-3))],
    "rope_pick_up": lambda r: [(r("hook.x", 7.5), near(1.1 - 0.2 - 2500 * G / (100e9 * 120e-6 / 15), 0.01)),
                               (r("rope.F"), near(0, size=1))],
    "scissor_lift": lambda r: [((r("top.x", 22) - r("top.x", 14)) / 8, near(-8 * LPM / 28e-4)),
                              (r("top.x", 11), near(0.6, 0.01)),
                               (r("top.x"), near(0, size=1e-3))],
    "sequence": lambda r: [(float(r.run["tip_2.x"][r.run["tip_1.x"] < 0.295][:200].max()), near(0, size=2e-3)),
                           (r.most("tip_2.x"), near(0.4, 1e-3)), (r("tip_1.x"), near(0, size=1e-3))],
    "sliding_door": lambda r: [(r.most("leaf.x"), near(0.7, 2e-3)), (r("leaf.x", 0.49), near(0.25, size=0.02))],
    "steering": lambda r: [(r("lock.F", 3), near((r("A.p", 3) - r("B.p", 3)) * 20e-4, 0.02)),
                           (r("supply.p", 4.9), near(130 * BAR, 0.01))],
    # over the edge goes the rain less what the open valve takes at that level
    "tank_level": lambda r: [(r.most("tank.q_o"), near(15e-3 - 4e-3 * np.sqrt(998 * G * r.most("tank.h") / 0.15e5), 0.05)),
                             (r.most("coil"), near(6e-3, 1e-6))],
    "thermostat": lambda r: [(r.most("bulk.T"), near(333.15, size=0.5)), (r.most("coil"), near(2000, 1e-6))],
    "tipper": lambda r: [((r("top.x", 15) - r("top.x", 5)) / 10, near(30 * LPM / 100e-4, 0.03)),
                         (r("top.x", 24), near(1.0, 0.01))],
    # braked over 3 m, then against the buffer between one wagon alone and three as one
    "train_buffers": lambda r: [(r("last.v"), near(0, size=1e-9)), (r("last.x") - r("first.x"), near(24, size=0.07)),
                                (r.most("stop.F"), near(0.5 * (1 + 3**0.5) * HIT, size=0.5 * (3**0.5 - 1) * HIT))],
    # the air of the vessel shared with chamber and lines
    "truck_brake": lambda r: [(r("port.p", 3.4), near((30 * 9.5 + 0.96 * 1.013) / (30 + 1.97) * BAR, 0.025)),
                              (r("tip.x", 3.4), near(0.057, size=5e-4)), (r("tip.x"), near(0, size=5e-4))],
    "vibrating_conveyor": lambda r: [(float(any(name == "grip.stick" for _, name in r.run.events)), near(1)),
                                     (r("goods.x"), near(0.55, 0.3))],
    # Joukowsky: rho a v
    "water_hammer": lambda r: [(r("end.p", 1.04) - r("end.p", 0.99), near(
        998 * np.sqrt(2.1e9 / 998) * r("valve.q", 0.99) / disc(0.05), 0.06))],
}


def test_every_circuit_has_a_check() -> None:
    assert sorted(CHECKS) == sorted(p.stem for p in FOLDER.glob("*.yaml")) and len(CHECKS) == 40


@pytest.mark.parametrize("name", [
    pytest.param(name, marks=[pytest.mark.slow]*(name in SLOW) + [pytest.mark.long]*(name in LONG))
    for name in sorted(CHECKS)])
def test_a_circuit_of_library_parts_runs_to_its_end(name: str) -> None:
    ran = Ran(name)
    assert ran.run.time[-1] == pytest.approx(grid(ran.run.assembly.model, None, None)[-1])
    for found, estimated in CHECKS[name](ran):
        assert found == estimated
