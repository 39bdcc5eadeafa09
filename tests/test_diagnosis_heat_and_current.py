"""Effects of heat and of electric circuits, hidden in records of small machines and found."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import heavebond as hb
from heavebond.diagnosis.answer.files import Targets, write_findings
from heavebond.estimation.experiment import load_experiment

OVEN = """\
model: oven
components:
  heater:  {is: HeatSource, u: "=200 W + 180 W*sin(2*pi*time/SLOW) + 40 W*sin(2*pi*time/(11 min))"}
  plate:   {is: HeatCapacity, m: 1 kg, c: 450 J/(kg*K)}
  contact: {is: ThermalResistance, R: 0.11 K/W}
  block:   {is: HeatCapacity, m: 5 kg, c: 440 J/(kg*K)}
  air:     {is: ThermalResistance, R: 0.8 K/W}
  room:    {is: Ambient, T_0: 22 degC}
nodes:
  plate: [heater.a, plate.a, contact.a]
  block: [contact.b, block.a, air.a]
  room:  [air.b, room.a]
initial: {plate.T: 22 degC, block.T: 22 degC}
show: {plate: {is: plate.T, unit: degC}, block: {is: block.T, unit: degC}, power: {is: heater.u, unit: W}}
simulate: {until: 4 h, every: 30 s}
"""
DRIVE = """\
model: drive
components:
  supply: {is: VoltageSource, u: "=7 V*sin(2*pi*time/SLOW) + 3 V*sin(2*pi*time/(0.7 s))"}
  ground: {is: ElectricalGround}
  motor:  {is: DCMotor, R: 1.1 ohm, L: 2 mH, k: 0.05 N*m/A, J: 1 kg*cm**2, d: 1e-4 N*m*s/rad}
nodes:
  plus:  [supply.a, motor.a]
  minus: [supply.b, motor.b, ground.a]
  shaft: [motor.s]
initial: {shaft.w: 0 rad/s, motor.i: 0 A}
show: {current: {is: motor.i, unit: A}, speed: {is: shaft.w, unit: rad/s}, voltage: {is: supply.u, unit: V}}
simulate: {until: 8 s, every: 10 ms}
"""
COIL = """\
model: coil
parameters: {late: 0 s}
components:
  supply: {is: VoltageSource, u: "=12 V*sin(2*pi*(time - late)/SLOW)**3"}
  ground: {is: ElectricalGround}
  wire:   {is: Resistor, R: 4 ohm}
  coil:   {is: Inductor, L: 0.8 H}
nodes:
  plus: [supply.a, wire.a]
  top:  [wire.b, coil.a]
  zero: [supply.b, coil.b, ground.a]
initial: {coil.i: 0 A}
show: {current: {is: coil.i, unit: A}, voltage: {is: "12 V*sin(2*pi*time/SLOW)**3", unit: V}}
simulate: {until: 2 s, every: 10 ms}
"""
RADIATION = ("components: {glow: {is: HeatRadiation, A: 600 cm**2, epsilon: 0.8}}\n"
             "nodes: {block: [+glow.a], room: [+glow.b]}\n")
WALLS = ("components: {walls: {is: HeatStorage, G: 6 W/K, tau: 25 min}}\n"
         "nodes: {block: [+walls.a]}\ninitial: {walls.T: 32 degC}\n")
INSULATION = ("components: {air: {is: ThermalWall, R: 0.8 K/W, x: -0.2, tau: 20 min}}\ninitial: {air.T: 45 degC}\n")
BRUSHES = ("components: {brushes: {is: BrushContact, U_b: 0.8 V}}\n"
           "nodes: {plus: [-motor.a, +brushes.a], inside: [brushes.b, motor.a]}\n")


def found(folder: Path, machine: str, hidden: str, slow: tuple[str, str], channels: dict[str, tuple[str, str, str, float]],
          driven: tuple[str, str], free: str, classes: list[str]) -> hb.Diagnosis:
    """The diagnosis of a machine from two records of it with something hidden: `channels` by their outputs with signal,
    unit, text of the noise and its size; `driven` is the input and its output, `slow` its period in each record."""
    rng = np.random.default_rng(5)
    (folder / "machine.yaml").write_text(machine.replace("SLOW", f"({slow[0]})"), encoding="utf-8")
    for name, period in zip(("one", "two"), slow, strict=True):
        (folder / f"{name}.yaml").write_text(machine.replace("SLOW", f"({period})"), encoding="utf-8")
        (folder / "hidden.yaml").write_text(f"model: hidden\nextends: {name}.yaml\n{hidden}", encoding="utf-8")
        run = hb.simulate(hb.load(folder / "hidden.yaml"))
        columns = [run.time, run.display[driven[1]]]
        columns += [run.display[shown] + size*rng.standard_normal(len(run.time)) for shown, (*_, size) in channels.items()]
        np.savetxt(folder / f"{name}.csv", np.array(columns).T, delimiter=",", comments="",
                   header=",".join(["t", "u", *channels]))
    outputs = "".join(f"  {signal}: {{column: {shown}, unit: {unit}, noise: {noise}}}\n"
                      for shown, (signal, unit, noise, _) in channels.items())
    unit = hb.load(folder / "machine.yaml").show[driven[1]].unit
    (folder / "measured.yaml").write_text(
        "experiment: measured\nmodel: machine.yaml\nrecords:\n  one: {file: one.csv, use: fit}\n"
        "  two: {file: two.csv, use: validate}\ntime: {column: t, unit: s}\n"
        f"inputs:\n  {driven[0]}: {{column: u, unit: {unit}, interpolation: spline}}\noutputs:\n{outputs}free: {free}\n",
        encoding="utf-8")
    return hb.diagnose(folder / "measured.yaml", classes=classes, number=1)


@pytest.mark.long
def test_radiation_of_a_hot_block_is_told_from_other_losses_and_from_the_sensors(tmp_path: Path) -> None:
    said = found(tmp_path, OVEN, RADIATION, ("70 min", "95 min"),
                 {"plate": ("plate.T", "degC", "0.15 K", 0.15), "block": ("block.T", "degC", "0.15 K", 0.15)},
                 ("heater.u", "power"), "{contact.R: 0.11 K/W +- 20 %, air.R: 0.8 K/W +- 40 %}",
                 ["heat radiation", "heat loss", "natural convection", "thermal resistance", "sensor offset", "sensor gain"])
    (finding,) = said.findings
    assert said.verdict in ("effect", "one_of") and "heat radiation" in finding.kinds, said.words
    assert finding.candidate.component == "HeatRadiation" and set(finding.candidate.where) == {"block", "room"}
    assert said.ladder[-1].chi2_held_out < 1.3 < 20 < said.ladder[1].chi2_held_out
    # area times emissivity, which act as one
    assert finding.fit.values["heat_radiation.A"] == pytest.approx(0.8*600e-4, rel=0.05)


@pytest.mark.long
def test_walls_that_store_heat_are_told_from_losses_and_from_a_larger_block(tmp_path: Path) -> None:
    """The walls are warmer than the block when a record begins."""
    said = found(tmp_path, OVEN, WALLS, ("70 min", "95 min"),
                 {"plate": ("plate.T", "degC", "0.15 K", 0.15), "block": ("block.T", "degC", "0.15 K", 0.15)},
                 ("heater.u", "power"), "{contact.R: 0.11 K/W +- 20 %, air.R: 0.8 K/W +- 40 %}",
                 ["heat storage", "heat capacity", "heat loss", "natural convection", "thermal resistance", "sensor gain"])
    (finding,) = said.findings
    assert said.verdict in ("effect", "one_of") and "heat storage" in finding.kinds, said.words
    assert finding.candidate.component == "HeatStorage" and finding.candidate.where == ("block",)
    assert said.ladder[-1].chi2_held_out < 1.3 < 20 < said.ladder[1].chi2_held_out
    assert finding.fit.values["heat_storage.G"] == pytest.approx(6, rel=0.05)
    assert finding.fit.values["heat_storage.tau"] == pytest.approx(1500, rel=0.05)


@pytest.mark.long
def test_heat_stored_inside_a_resistance_is_told_from_heat_stored_beside_it(tmp_path: Path) -> None:
    """The insulation of the block stores heat, and is warm from an earlier run when a record begins. The temperature of the
    room changes: beside a constant one, heat stored in the insulation acts as heat stored in the block's walls."""
    varying = OVEN.replace("Ambient, T_0: 22 degC", "TemperatureSource, u: \"=295 K + 15 K*sin(2*pi*time/(53 min))\"")
    said = found(tmp_path, varying, INSULATION, ("70 min", "95 min"),
                 {"plate": ("plate.T", "degC", "0.15 K", 0.15), "block": ("block.T", "degC", "0.15 K", 0.15)},
                 ("heater.u", "power"), "{contact.R: 0.11 K/W +- 20 %, air.R: 0.8 K/W +- 40 %}",
                 ["heat storage", "heat capacity", "heat loss", "thermal resistance"])
    (finding,) = said.findings
    assert said.verdict in ("effect", "one_of"), said.words
    assert finding.candidate.component == "ThermalWall" and finding.candidate.where == ("air",)
    assert said.ladder[-1].chi2_held_out < 1.3 < 20 < said.ladder[1].chi2_held_out
    # the share r and the depth act alike; the conductance from the block into the stored heat is r/((0.5 + x)*R)
    values = finding.fit.values
    assert values["air.r"]/(0.5 + values["air.x"])/values["air.R"] == pytest.approx(1/0.3/0.8, rel=0.1)
    assert "stores heat" in said.tree.effects[0].meaning


@pytest.mark.long
def test_the_voltage_of_brushes_is_told_from_resistance_and_friction(tmp_path: Path) -> None:
    said = found(tmp_path, DRIVE, BRUSHES, ("2.3 s", "1.7 s"),
                 {"current": ("motor.i", "A", "10 mA", 10e-3), "speed": ("shaft.w", "rad/s", "0.3 rad/s", 0.3)},
                 ("supply.u", "voltage"), "{motor.R: 1.1 ohm +- 20 %, motor.d: 1e-4 N*m*s/rad +- 50 %}",
                 ["brush voltage", "contact resistance", "leakage current", "dry friction", "dead band"])
    (finding,) = said.findings
    assert said.verdict in ("effect", "one_of") and "brush voltage" in finding.kinds, said.words
    assert said.ladder[-1].chi2_held_out < 1.3 < 20 < said.ladder[1].chi2_held_out


@pytest.mark.long
def test_places_that_act_alike_are_all_named(tmp_path: Path) -> None:
    """A linear coil with one channel: whether the voltage or the measured current is late cannot be told."""
    said = found(tmp_path, COIL, "set: {late: 15 ms}\n", ("0.9 s", "0.7 s"), {"current": ("coil.i", "A", "10 mA", 10e-3)},
                 ("supply.u", "voltage"), "{wire.R: 4 ohm +- 10 %, coil.L: 0.8 H +- 10 %}", ["delay", "lag"])
    (finding,) = said.findings
    assert said.verdict == "one_of"
    assert {t.candidate.label for t in finding.alternatives} == {"Delay before supply.u", "Delay in the channel coil.i"}
    # which of the two comes first is chance: both leave noise
    assert "delay before supply.u or in the channel coil.i" in said.words[0]


@pytest.mark.long
def test_gas_that_exchanges_heat_takes_the_place_of_a_polytropic_accumulator(tmp_path: Path) -> None:
    """The exponent n, which is free, has no meaning in the law that is found: with it in the experiment and in its values
    the diagram could not be read. The records are p = m T/V of an ideal gas with
    (m/(kappa - 1)) (T' + (T - T_0)/tau) = -p V', by SciPy."""
    (tmp_path / "rig.yaml").write_text("""
model: accumulator circuit
components:
  pump: {is: FlowSource, u: 20 L/min}
  accumulator: {is: GasAccumulator, V_0: 6 L, p_0: 70 bar, beta: 1.4 GPa}
  throttle: {is: Orifice, q_r: 25 L/min, dp_r: 110 bar}
  tank: {is: Tank}
nodes:
  line: [pump.a, accumulator.a, throttle.a]
  tank: [throttle.b, tank.a]
initial: {line.p: 100 bar}
""")
    (tmp_path / "measured.yaml").write_text("""
experiment: accumulator circuit
model: rig.yaml
records: {a: {file: a.csv, use: fit}, b: {file: b.csv, use: validate}}
time: {column: t, unit: s}
inputs: {pump.u: {column: q, unit: L/min, interpolation: linear}}
outputs: {line.p: {column: p, unit: bar, noise: 0.15 bar}}
free: {throttle.q_r: 25 L/min +- 5 %, accumulator.n: 1 .. 1.4}
""")
    full, air, wall, kappa, tau = 6e-3, 101325.0, 293.15, 1.4, 11.0
    gas = (70e5 + air) * full / wall
    t, random = np.linspace(0.0, 120.0, 601), np.random.default_rng(5)
    for name, slow in (("a", 0.12), ("b", 0.07)):
        q = 24.5 + 6 * np.sin(2 * np.pi * slow * t) + 3 * np.sin(2 * np.pi * 0.29 * t + slow)

        def rates(now: float, state: np.ndarray, q: np.ndarray = q) -> list[float]:
            volume, heat = state
            pressure = gas * heat / volume
            flow = 25 / 6e4 * np.sqrt((pressure - air) / 110e5) - np.interp(now, t, q) / 6e4
            return [flow, -(kappa - 1) / gas * pressure * flow - (heat - wall) / tau]

        start = [gas * wall / (100e5 + air), wall]
        volume, heat = solve_ivp(rates, (0.0, 120.0), start, t_eval=t, rtol=1e-8, atol=[1e-10, 1e-6], max_step=0.2).y
        pressure = (gas * heat / volume - air) / 1e5 + random.normal(0.0, 0.15, len(t))
        np.savetxt(tmp_path / f"{name}.csv", np.column_stack([t, q, pressure]), delimiter=",", header="t,q,p", comments="")
    said = hb.diagnose(tmp_path / "measured.yaml", classes=["heat exchange", "leakage", "hose compliance"], number=1)
    assert said.verdict == "effect" and said.findings[0].candidate.component == "GasAccumulatorWithHeat"
    assert not any("accumulator.n" in line for line in said.words)
    (tau_found,) = said.findings[0].parameters
    assert tau_found.value == pytest.approx(tau, rel=0.1)  # its 95 % interval is +- 6 %
    given = load_experiment(tmp_path / "measured.yaml")
    (written,) = write_findings(given, said.findings, Targets.beside(given, tmp_path / "found"))
    again = load_experiment(written)
    assert set(again.free) == {"throttle.q_r", "accumulator.tau"}
    assert hb.compare(again).records["b"].channels["line.p"].chi2 < 1.2  # 601 samples: 1 +- 0.06
