"""Mistakes of an engineer, and for each the code of the message and the words that it must contain.

Each case is a sound file with one change. The file is read and run as from the command line, so that a message counts
wherever it is given: while the file is read, at the start, or in the verdict of the run.
"""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass
from pathlib import Path

import pytest
from click.testing import CliRunner

from heavebond import cli

RIG = """\
model: rig
parameters: {m_0: 120 kg}
components:
  shaker: {is: PositionSource, u: "=40 mm*sin(2*pi*time/2 s)"}
  spring: {is: Spring, c: 4 kN/m}
  damper: {is: Damper, d: 150 N*s/m}
  load:   {is: Mass, m: 120 kg}
nodes:
  deck: [shaker.a, spring.a, damper.a]
  load: [spring.b, damper.b, load.a]
initial: {load.x: 0 m, load.v: 0 m/s}
show:
  load: {is: load.x, unit: mm}
simulate: {until: 1 s, every: 20 ms}
"""
CIRCUIT = """\
model: circuit
components:
  b: {is: VoltageSource, u: 12 V}
  r: {is: Resistor, R: 10 ohm}
  c: {is: Capacitor, C: 1 mF}
  g: {is: ElectricalGround}
nodes:
  plus:  [b.a, r.a]
  out:   [r.b, c.a]
  minus: [b.b, c.b, g.a]
initial: {c.u: 0 V}
show: {u: {is: c.u, unit: V}}
simulate: {until: 0.1 s, every: 1 ms}
"""
PUMP = """\
model: unit
components:
  motor:  {is: SpeedSource, u: 1500 rpm}
  pump:   {is: HydraulicPump, D: 10 cm**3/rev, eta_v: 0.95, eta_hm: 0.95}
  relief: {is: RatedReliefValve, p_0: 100 bar, q_r: 20 L/min}
  line:   {is: Volume, V: 1 L}
  tank:   {is: Tank}
nodes:
  shaft:   [motor.a, pump.s]
  supply:  [pump.b, relief.a, line.a]
  suction: [pump.a, tank.a, relief.b]
initial: {supply.p: 0 bar}
show: {p: {is: supply.p, unit: bar}}
simulate: {until: 1 s, every: 10 ms}
"""
EXPERIMENT = """\
experiment: the rig and its record
model: rig.yaml
records:
  train: {file: r.csv, use: fit}
time: {column: time, unit: s}
inputs:
  shaker.u: {column: deck, unit: mm, interpolation: linear}
outputs:
  load.x: {column: load, unit: mm, noise: 0.1 mm}
free:
  load.m: 100 .. 150 kg
"""
BASES = {"rig": RIG, "circuit": CIRCUIT, "unit": PUMP}


@dataclass(frozen=True)
class Mistake:
    """A change `before` to `after` of the sound file `base`; the message has the `code` and all `words`, and none of
    `unwanted`."""

    name: str
    base: str
    before: str
    after: str
    code: str
    words: tuple[str, ...]
    unwanted: tuple[str, ...] = ()
    command: str = "run"


MISTAKES = [
    # mistakes of which the message was known to be wrong or unhelpful
    Mistake("the poles of a source on one node", "circuit", "  plus:  [b.a, r.a]\n  out:   [r.b, c.a]\n  minus: [b.b,",
            "  plus:  [b.a, b.b, r.a]\n  out:   [r.b, c.a]\n  minus: [", "rank-lost", ("'b'", "same node", "plus")),
    Mistake("a pump with its ports exchanged", "unit", "supply:  [pump.b, relief.a, line.a]\n  suction: [pump.a,",
            "supply:  [pump.a, relief.a, line.a]\n  suction: [pump.b,", "run-physical",
            ("pump draws", "exchange its ports")),
    Mistake("a word for a number: yes", "rig", "m: 120 kg}\nn", "m: yes}\nn", "not-a-quantity",
            ("'yes'", "mass", "kg"), ("Write 1.",)),
    Mistake("a list for a single value", "rig", "m: 120 kg}\nn", "m: [120 kg]}\nn", "parameter-list",
            ("m", "one value", "m: 120 kg"), ("'m[1]'",)),
    # values
    Mistake("a word for a number: TBD", "rig", "m: 120 kg}\nn", "m: TBD}\nn", "formula-unmarked", ("'TBD'", "mass", "kg")),
    Mistake("a switch word for a force: off", "rig", "c: 4 kN/m", "c: off", "not-a-quantity", ("'off'", "N/m"),
            ("Write 0.",)),
    Mistake("no unit", "rig", "m: 120 kg}\nn", "m: 120}\nn", "unit-missing", ("120 kg",)),
    Mistake("kg spelled Kg", "rig", "m: 120 kg}\nn", "m: 120 Kg}\nn", "unit-unknown", ("'kg'",)),
    Mistake("no value", "rig", "m: 120 kg}\nn", "m: }\nn", "key-without-value", ("'m' has no value",)),
    Mistake("value and unit as a mapping", "rig", "m: 120 kg}\nn", "m: {value: 120, unit: kg}}\nn", "not-a-quantity",
            ("m: 120 kg",)),
    Mistake("a range for a value", "rig", "m: 120 kg}\nn", "m: 100 .. 120 kg}\nn", "not-a-quantity", ("range", "free:")),
    Mistake("a tolerance for a value", "rig", "m: 120 kg}\nn", "m: 120 kg +- 5 %}\nn", "not-a-quantity",
            ("tolerance", "free:")),
    Mistake("not a number", "rig", "m: 120 kg}\nn", "m: nan kg}\nn", "not-a-quantity", ("nan", "number")),
    Mistake("a thousands separator", "rig", "m: 120 kg}\nn", "m: 1'200 kg}\nn", "not-a-quantity", ("1200",)),
    Mistake("a name without an equals sign", "rig", "m: 120 kg}\nn", "m: m_0}\nn", "formula-unmarked",
            ("'m_0' is a parameter", "`=m_0`")),
    Mistake("t for the time", "rig", "(2*pi*time/2 s)", "(2*pi*t/2 s)", "name-unknown", ("'t'", "'time'")),
    Mistake("an amplitude without a unit", "rig", "=40 mm*", "=40*", "unit-wrong", ("must be in m", "without unit")),
    # connections
    Mistake("the ends of a resistor on one node", "circuit", "  plus:  [b.a, r.a]\n  out:   [r.b, c.a]\n",
            "  plus:  [b.a, r.a, r.b]\n  out:   [c.a]\n", "", ("r", "same node", "plus")),
    Mistake("two current sources in series", "circuit", "  b: {is: VoltageSource, u: 12 V}\n  r: {is: Resistor, R: 10 ohm}",
            "  b: {is: CurrentSource, u: 1 A}\n  r: {is: CurrentSource, u: 2 A}", "underdetermined",
            ("'b'", "'r'", "current")),
    Mistake("no ground", "circuit", ", g.a]", "]", "port-unconnected", ("g.a",)),
    Mistake("no part for the ground", "circuit", "  g: {is: ElectricalGround}\nnodes:\n  plus:  [b.a, r.a]\n"
            "  out:   [r.b, c.a]\n  minus: [b.b, c.b, g.a]", "nodes:\n  plus:  [b.a, r.a]\n  out:   [r.b, c.a]\n"
            "  minus: [b.b, c.b]", "rank-lost", ("ElectricalGround",)),
    Mistake("the relief valve reversed", "unit",
            "supply:  [pump.b, relief.a, line.a]\n  suction: [pump.a, tank.a, relief.b]",
            "supply:  [pump.b, relief.b, line.a]\n  suction: [pump.a, tank.a, relief.a]", "",
            ("supply.p", "relief", "exchange")),
    Mistake("the motor turning the other way", "unit", "u: 1500 rpm", "u: -1500 rpm", "run-physical",
            ("pump draws", "reverse its drive (motor)")),
    Mistake("no brackets and commas", "rig", "[shaker.a, spring.a, damper.a]", "shaker.a spring.a damper.a",
            "node-not-a-list", ("[shaker.a, spring.a, damper.a]",)),
    Mistake("a component in place of its port", "rig", "[shaker.a, spring.a", "[shaker, spring.a", "port-missing",
            ("shaker.a",)),
    Mistake("hyphens between the ports", "rig", "[shaker.a, spring.a, damper.a]", "shaker.a - spring.a - damper.a",
            "node-not-a-list", ("[shaker.a, spring.a, damper.a]",)),
    Mistake("nodes without names", "rig", "  deck: [shaker.a, spring.a, damper.a]\n  load: [spring.b, damper.b, load.a]",
            "  - [shaker.a, spring.a, damper.a]\n  - [spring.b, damper.b, load.a]", "not-a-mapping", ("ground: [wall.a",)),
    # the other sections
    Mistake("components as a list", "rig", "  load:   {is: Mass, m: 120 kg}", "  - load: {is: Mass, m: 120 kg}", "not-yaml",
            ("load:", "hyphen")),
    Mistake("type for is", "rig", "load:   {is: Mass,", "load:   {type: Mass,", "kind-missing", ("is: Mass",)),
    Mistake("an initial value of a parameter", "rig", "load.v: 0 m/s}", "load.v: 0 m/s, load.m: 100 kg}", "initial-constant",
            ("parameter", "component")),
    Mistake("an initial speed in m", "rig", "load.v: 0 m/s}", "load.v: 0 m}", "unit-wrong", ("m/s",)),
    Mistake("show as a list of names", "rig", "show:\n  load: {is: load.x, unit: mm}", "show: [load.x]", "not-a-mapping",
            ("is: load.x",)),
    Mistake("stop time in other words", "rig", "until: 1 s", "t_end: 1 s", "key-unknown", ("until",)),
    Mistake("an end before the start", "rig", "until: 1 s", "until: -1 s", "time-not-positive", ("until", "above 0")),
    Mistake("a solver of another tool", "rig", "every: 20 ms", "every: 20 ms, solver: ode45", "solver-unknown", ("idas",)),
    # experiments
    Mistake("a range whose ends are exchanged", "experiment", "100 .. 150 kg", "150 .. 100 kg", "range-empty",
            ("100 .. 150 kg",), command="compare"),
    Mistake("a free parameter without a range", "experiment", "100 .. 150 kg", "120 kg", "not-a-range", ("120 kg +- 20 %",),
            command="compare"),
    Mistake("a range that excludes the model's value", "experiment", "100 .. 150 kg", "200 .. 300 kg", "",
            ("load.m", "120 kg", "200 .. 300 kg"), command="compare"),
    # thirty further mistakes
    Mistake("a weight for a mass", "rig", "m: 120 kg}\nn", "m: 1200 N}\nn", "unit-wrong", ("force", "9.80665 m/s**2", "kg")),
    Mistake("a product for a quotient of units", "rig", "c: 4 kN/m", "c: 4 kN m", "unit-space", ("4 kN*m",)),
    Mistake("a negative mass", "rig", "m: 120 kg}\nn", "m: -120 kg}\nn", "parameter-bound",
            ("load.m = -120 kg", "at least 0 kg")),
    Mistake("a negative stiffness", "rig", "c: 4 kN/m", "c: -4 kN/m", "parameter-bound",
            ("spring.c = -4 kN/m", "at least 0")),
    Mistake("a parameter twice", "rig", "m: 120 kg}\nn", "m: 120 kg, m: 130 kg}\nn", "duplicate-key",
            ("'m' is written twice",)),
    Mistake("a component twice", "rig", "damper: {is: Damper", "spring: {is: Damper", "duplicate-key",
            ("'spring' is written twice", "line 5")),
    Mistake("a port on two nodes", "rig", "damper.b, load.a]", "damper.b, load.a, shaker.a]", "port-on-two-nodes",
            ("'shaker.a'", "'deck'", "'load'")),
    Mistake("a port on no node", "rig", "[spring.b, damper.b, load.a]", "[spring.b, load.a]", "port-unconnected",
            ("'damper.b'", "damper_b: [damper.b]")),
    Mistake("a component misspelled", "rig", "is: Spring,", "is: Sprng,", "component-unknown", ("'Spring'",)),
    Mistake("a parameter in the wrong case", "rig", "d: 150 N*s/m", "D: 150 N*s/m", "parameter-unknown", ("'d'",)),
    Mistake("an inertia for a mass", "rig", "is: Mass, m: 120 kg", "is: Inertia, J: 120 kg*m**2", "domains-mixed",
            ("translational", "rotational", "'load.a'")),
    Mistake("a node misspelled in a start", "rig", "load.v: 0 m/s}", "lod.v: 0 m/s}", "name-unknown", ("'load.v'",)),
    Mistake("a start of a prescribed position", "rig", "load.v: 0 m/s}", "load.v: 0 m/s, deck.x: 5 mm}",
            "start-contradiction",
            ("deck.x = 5 mm", "0 m")),
    Mistake("an angle that grows without a rate", "rig", "sin(2*pi*time/2 s)", "sin(180 deg*time)", "units-argument",
            ("argument of sin", "in s")),
    Mistake("a caret for a power", "rig", "=40 mm*sin", "=40 mm*time^2/1 s**2*sin", "formula-power", ("`**`",)),
    Mistake("a formula without an equals sign", "rig", "=40 mm*sin", "40 mm*sin", "formula-unmarked", ("begins with `=`",)),
    Mistake("a function of NumPy", "rig", "*sin(", "*np.sin(", "function-unknown", ("'np.sin'", "Write `sin`")),
    Mistake("output points longer than the run", "rig", "every: 20 ms", "every: 20 s", "every-too-long", ("20 s", "1 s")),
    Mistake("an end without a unit", "rig", "until: 1 s", "until: 1", "unit-missing", ("'1 s'",)),
    Mistake("an output misspelled", "rig", "is: load.x,", "is: load.pos,", "name-unknown", ("'load.x'",)),
    Mistake("an output in a wrong unit", "rig", "unit: mm}", "unit: kN}", "unit-wrong", ("'load' is in m", "kN")),
    Mistake("a tab", "rig", "  load:   {is: Mass", "\tload:   {is: Mass", "tab", ("tab", "spaces")),
    Mistake("an open brace", "rig", "m: 120 kg}\nn", "m: 120 kg\nn", "not-yaml", ("`{`", "comma")),
    Mistake("a current for a voltage", "circuit", "u: 12 V", "u: 12 A", "unit-wrong", ("b.u", "V")),
    Mistake("an inductance for a capacitance", "circuit", "C: 1 mF", "C: 1 mH", "unit-wrong", ("c.C", "F")),
    Mistake("a source on an empty capacitor", "circuit", "R: 10 ohm", "R: 0 ohm", "start-contradiction",
            ("c.u = 0 V", "12 V")),
    Mistake("a unit with the zero of a pressure", "unit", "p_0: 100 bar", "p_0: 100 bara", "unit-unknown",
            ("'bar'", "atmospheric")),
    Mistake("a displacement without a turn", "unit", "D: 10 cm**3/rev", "D: 10 cm**3", "unit-cycles", ("cm**3/rev",)),
    Mistake("a percentage without its sign", "unit", "eta_v: 0.95,", "eta_v: 95,", "parameter-bound", ("eta_v", "`95 %`")),
    Mistake("a node with a space in its name", "rig", "  deck: [", "  the deck: [", "name-bad", ("`the_deck`",)),
    Mistake("a number below the smallest one", "rig", "m: 120 kg}\nn", "m: 1e-999 kg}\nn", "number-too-small", ("1e-999",)),
]




def record() -> str:
    """A record of the rig, 0.1 s apart, as its static displacement: only its form matters here."""
    angles = [math.pi * k / 10 for k in range(60)]
    rows = (f"{k / 10:g},{40 * math.sin(a):.3f},{41 * math.sin(a - 0.02):.3f}" for k, a in enumerate(angles))
    return "time,deck,load\n" + "\n".join(rows) + "\n"


def message(mistake: Mistake, folder: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[list[str], str]:
    """The codes and the text of all that the command prints for a mistake; without codes for remarks."""
    monkeypatch.chdir(folder)
    files = {f"{name}.yaml": text for name, text in {**BASES, "experiment": EXPERIMENT}.items()}
    name = f"{mistake.base}.yaml"
    assert mistake.before in files[name], "the sound file does not contain the text to change"
    files[name] = files[name].replace(mistake.before, mistake.after, 1)
    files["r.csv"] = record()
    for path, text in files.items():
        Path(path).write_text(text)
    run = CliRunner().invoke(cli.main, [mistake.command, name, "--json", "out.json"])
    problems = json.loads(Path("out.json").read_text())["problems"]
    texts = [" ".join([p["message"], *p["notes"], p["hint"]]) for p in problems]
    return [p["code"] for p in problems], " ".join([*texts, *([] if problems else [run.output])])


@pytest.mark.parametrize("mistake", [pytest.param(m, id=m.name) for m in MISTAKES])
def test_the_message_names_the_mistake(mistake: Mistake, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    codes, text = message(mistake, tmp_path, monkeypatch)
    assert not mistake.code or mistake.code in codes, f"{codes}: {text}"
    text = re.sub(r"\s+", " ", text)
    assert all(word in text for word in mistake.words), text
    assert not any(word in text for word in mistake.unwanted), text
