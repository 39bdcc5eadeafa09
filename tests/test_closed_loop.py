"""Records of closed loops and inputs with noise: a servo with dry friction, measured by a noisy encoder."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from threadpoolctl import threadpool_info

import heavebond as hb
from heavebond.estimation import comparison
from heavebond.estimation.faulty_columns import prescribing_inputs
from heavebond.estimation.feedback import feedback
from heavebond.reports.result_tables import noticed

PLANT = """
components:
  motor: {is: ForceSource}
  slide: {is: Mass, m: 10 kg}
  oil:   {is: Damper, d: 40 N*s/m}
  bed:   {is: Fixed}
nodes:
  slide: [motor.a, slide.a, oil.b]
  bed:   [bed.a, oil.a]
initial: {slide.x: 0 m, slide.v: 0 m/s}
"""
LOOP = """
components:
  pid:     {is: PID, K_p: 4 kN/m, K_d: 300 N*s/m, T_f: 8 ms, y_min: -500 N, y_max: 500 N, r: 0 m}
  encoder: {is: PositionSensor}
  reading: {is: Sum, u_2: 0 m}
nodes:
  slide:   [+encoder.a]
  place:   [encoder.y, reading.u_1]
  known:   [reading.y, pid.u]
  command: [pid.y, motor.u]
initial: {pid.z: 0 m, pid.q: 0 N}
"""
BOTH = """records: {one: {file: one.csv, use: fit}, two: {file: two.csv, use: validate}}
time: {column: time, unit: s}
free: {slide.m: 10 kg +- 20 %, oil.d: 40 N*s/m +- 50 %}
"""
OPEN = "experiment: open\nmodel: plant.yaml\n" + BOTH + """
inputs: {motor.u: {column: force, unit: N, interpolation: hold}}
outputs: {place: {is: slide.x, column: place, unit: m, noise: 20 um}}
"""
CLOSED = "experiment: closed\nmodel: loop.yaml\n" + BOTH + """
inputs: {pid.r: {column: wish, unit: m, interpolation: linear}}
outputs: {force: {is: pid.y, column: force, unit: N, noise: 1.2 N}}
"""
NOISE, STEP = 20e-6, 0.01


def servo(folder: Path, friction: float = 12.0) -> None:
    """Diagrams of the plant and of the loop, and two records of the loop with friction (N)."""
    (folder / "plant.yaml").write_text("model: plant\n" + PLANT, encoding="utf-8")
    (folder / "loop.yaml").write_text("model: loop\nextends: plant.yaml\n" + LOOP, encoding="utf-8")
    (folder / "truth.yaml").write_text(f"""model: truth
extends: loop.yaml
components: {{rail: {{is: CoulombFriction, F_c: {friction} N}}}}
nodes: {{slide: [+rail.b], bed: [+rail.a]}}
set:
  pid.r: {{file: wish.csv, column: wish, unit: m, interpolation: linear}}
  reading.u_2: {{file: wish.csv, column: noise, unit: m, interpolation: hold}}
""", encoding="utf-8")
    random = np.random.default_rng(5)
    time = np.arange(501) * STEP
    for name, (size, first) in {"one": (0.05, 0.7), "two": (0.04, 0.55)}.items():
        waves = np.sin(2 * np.pi * first * time) + 0.5 * np.sin(2 * np.pi * 1.9 * first * time)
        wish = size * waves * (1 - np.exp(-time**2))
        noise = NOISE * random.standard_normal(len(time))
        pd.DataFrame({"time": time, "wish": wish, "noise": noise}).to_csv(folder / "wish.csv", index=False)
        run = hb.simulate(hb.load(folder / "truth.yaml"), until=5.0, every=STEP)
        pd.DataFrame({"time": time, "wish": wish, "force": run["pid.y"], "place": run["slide.x"] + noise}
                     ).to_csv(folder / f"{name}.csv", index=False)


@pytest.mark.long
def test_a_loop_that_is_treated_as_open_is_told_and_in_the_diagram_it_finds_the_effect(tmp_path: Path) -> None:
    """Driven by the measured force, the record is told to be of a closed loop, by `compare` and by `diagnose`. With the
    controller in the diagram and the reference as the input the friction is found, with its size."""
    servo(tmp_path)
    for name, text in (("open", OPEN), ("closed", CLOSED)):
        (tmp_path / f"{name}.yaml").write_text(text, encoding="utf-8")
    told = hb.compare(tmp_path / "open.yaml").records["one"]
    assert len(told.feedback) == 1 and "motor.u follows from the measured place" in told.feedback[0]
    assert told.feedback[0] in told.notes
    found = hb.diagnose(tmp_path / "closed.yaml", number=1, steps=1,
                        classes=["dry friction", "quadratic damping", "constant force"])
    assert found.verdict == "effect" and found.findings[0].candidate.kind == "dry friction"
    (size,) = (p.value for p in found.findings[0].parameters if p.name.endswith(".F_c"))
    assert abs(size - 12.0) < 0.5
    assert not any("closed loop" in words for words in found.words)


def test_a_comparison_computes_in_one_thread(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Least squares of few columns, shared among threads, take eight times the processor time, on a busy computer more."""
    used: list[int] = []

    def watched(*given: object) -> tuple[str, ...]:
        used.extend(library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas")
        return ()

    servo(tmp_path)
    (tmp_path / "open.yaml").write_text(OPEN, encoding="utf-8")
    monkeypatch.setattr(comparison, "closed_loops", watched)
    hb.compare(tmp_path / "open.yaml")
    assert used and set(used) == {1}


@pytest.mark.long
def test_a_diagnosis_of_a_closed_loop_says_that_it_may_be_biased(tmp_path: Path) -> None:
    """A diagnosis with the measured force as the input says so after its verdict."""
    servo(tmp_path)
    (tmp_path / "open.yaml").write_text(OPEN.replace("interpolation: hold", "interpolation: linear"), encoding="utf-8")
    found = hb.diagnose(tmp_path / "open.yaml", number=1, steps=1, classes=["constant force"], samples=300)
    assert any(words.startswith("The answer may be biased: the input motor.u follows") for words in found.words)


def test_feedback_is_told_once_for_all_records_and_of_a_driven_motion_as_a_reaction(tmp_path: Path) -> None:
    """A rig driven by its displacement has no controller that could be put into the diagram."""
    servo = "the input motor.u follows from the measured place (correlation 0.6 with its residual 1 sample before)"
    records = {name: SimpleNamespace(notes=("short", f"{servo}: {name}"), feedback=(f"{servo}: {name}",))
               for name in ("first", "second", "third")}
    rows = noticed(SimpleNamespace(records=records))[0].rows  # type: ignore[arg-type]
    assert rows == [("first", "short"), ("", f"{servo}: first (the same in second, third)"), ("second", "short"),
                    ("third", "short")]
    text = ("model: m\ncomponents:\n  p: {is: PositionSource, u: {file: r.csv, column: x, unit: m, interpolation: linear, "
            "time: {column: t, unit: s}}}\n  f: {is: ForceSource, u: {file: r.csv, column: x, unit: N, interpolation: "
            "linear, time: {column: t, unit: s}}}\n  s: {is: Spring, c: 1 kN/m}\n  m: {is: Mass, m: 1 kg}\n"
            "nodes: {a: [p.a, s.a], b: [s.b, m.a, f.a]}\n")
    (tmp_path / "r.csv").write_text("t,x\n0,0\n1,1\n2,0\n")
    assert prescribing_inputs(hb.assemble(hb.loads(text, tmp_path))) == {"p.u"}


def test_readings_that_answer_to_the_input_of_their_row_are_not_feedback() -> None:
    """A first-order lag with a random input: the logger writes the input that was held before the row, and the model holds
    it after the row. With a gain 10 % off there is a residual besides."""
    random = np.random.default_rng(3)
    u, y = random.standard_normal(2000).cumsum() / 10, np.zeros(2001)
    for k in range(2000):
        y[k + 1] = 0.9 * y[k] + 0.1 * u[k]
    noise = 0.002 * random.standard_normal(2000)
    model = 0.9 * y
    assert feedback(u, y[1:] + noise - model[:-1], model[:-1]) is None
    # a controller without delay is reported all the same: it adds the noise of the reading to its input
    controlled, held = np.zeros(2000), np.zeros(2001)
    for k in range(2000):
        controlled[k] = u[k] - 3 * (held[k] + 10 * noise[k])
        held[k + 1] = 0.9 * held[k] + 0.1 * controlled[k]
    found = feedback(controlled, held[:-1] + 10 * noise - 0.9 * held[:-1], 0.9 * held[:-1])
    assert found is not None and found.lag == 0
