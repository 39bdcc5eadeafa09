"""Examples of the Modelica Standard Library beside their closed solutions; see `benchmarks/modelica`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import heavebond as hb
from benchmarks.modelica.__main__ import examples, largest_difference, lines_of_modelica, reference, row

FOLDER = Path(__file__).parents[1] / "benchmarks" / "modelica"
PAGE = Path(__file__).parents[1] / "docs" / "modelica_examples.md"


def run(name: str) -> hb.Result:
    return hb.simulate(hb.load(FOLDER / f"{name}.yaml"), rtol=1e-10)


def test_examples_with_closed_solutions() -> None:
    accelerated, masses, braked = run("accelerate"), run("two_masses"), run("damper")
    t = accelerated.time
    assert accelerated.si["accelerate.s"] == pytest.approx(t**2 / 2, abs=1e-9)
    assert masses.si["mass1.T"] == pytest.approx(323.15 + 50*np.exp(-20/15*t), abs=1e-6)
    assert braked.si["damper1.v_rel"] == pytest.approx(-10*np.exp(-25*t), abs=1e-7)


def test_a_forced_oscillation_near_resonance() -> None:
    """x'' + w0² x = sin(w t) from rest: x = (sin(w t) - w/w0 sin(w0 t))/(w0² - w²), by differences of angles."""
    found, w0, w = run("oscillator"), 100.0, 2*np.pi*15.9155
    t = found.time
    # v = w (cos(w t) - cos(w0 t))/(w0² - w²)
    v = 2*w*np.sin((w0 + w)/2*t)*np.sin((w0 - w)/2*t)/((w0 - w)*(w0 + w))
    assert found.si["mass1.v"] == pytest.approx(v, abs=3e-7)


def test_brakes_filters_modulation_and_tanks_with_closed_solutions() -> None:
    """A body of 1 kg that 1 N brakes from 0.1 s to rest; two lags in a row; a frequency that a sine modulates; two tanks of
    1 m² that exchange water through 5 Pa s/m³, with 10 Pa per metre."""
    braked = run("brake")
    assert braked.si["mass1.v"] == pytest.approx(np.clip(1.1 - braked.time, 0, 1), abs=1e-9)
    lag = run("filter_with_rise_time")
    s = np.maximum(lag.time - 1, 0)/(np.sqrt(10**0.15 - 1)*2/5)
    assert lag.si["filter_fac5.x[2]"] == pytest.approx(1 - (1 + s)*np.exp(-s), abs=1e-7)
    modulated = run("modulation")
    phase = 2*np.pi*(100*modulated.time + 50/(4*np.pi)*(1 - np.cos(4*np.pi*modulated.time)))
    assert modulated.si["sinFM.y"] == pytest.approx(np.sin(phase), abs=2e-6)
    tanks = run("two_tanks")
    assert tanks.si["openTank1.m"] == pytest.approx(0.5 + 0.4*np.exp(-4*tanks.time), abs=1e-7)


@pytest.mark.long
def test_the_page_has_a_row_for_each_example() -> None:
    """With its lines of YAML and its notes; the other figures need the files of the Modelica Association."""
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    rows = [line.split(" | ") for line in lines if line.startswith("| ") and "lines of YAML" not in line]
    expected = [row(name, 0, 0.0).split(" | ") for name in examples()]
    assert [(r[:2], r[4:]) for r in rows] == [(r[:2], r[4:]) for r in expected]


@pytest.mark.long
def test_every_example_assembles() -> None:
    for name in examples():
        assert hb.assemble(hb.load(FOLDER / f"{name}.yaml")).model.name == name


def test_the_comparison_reads_classes_and_results(tmp_path: Path) -> None:
    """A class of a package, with an annotation that contains parentheses; a result with an index in a name, two times of an
    event, and a known error."""
    (tmp_path / "Modelica" / "Blocks").mkdir(parents=True)
    (tmp_path / "Modelica" / "Blocks" / "package.mo").write_text(
        "package Blocks\n  model Other\n  end Other;\n  model Lag \"A lag\"\n"
        "    Real x annotation (Placement(\n      text=\"a ) b\"));\n\n"
        "  equation\n    der(x) = -x;\n    annotation (Icon);\n  end Lag;\nend Blocks;\n")
    assert lines_of_modelica(tmp_path, "Modelica.Blocks.Lag") == 5
    t = np.repeat(np.linspace(0, 2, 2001), 1 + (np.arange(2001) == 1000))
    v = np.clip(1.1 - t, 0, 1) + 1e-3*(t > 1.5)
    v[1000] = 5.0   # before the event
    names = ["mass1.s", "mass1.v", "mass2.s", "mass2.v", "x[1, 2]"]
    s = np.where(t < 0.1, t, np.where(t < 1.1, t - (t - 0.1)**2/2, 0.6))
    lines = [",".join(f'"{name}"' for name in ["time", *names]),
             *(",".join(f"{x:.17g}" for x in (a, b, c, b, c, 0)) for a, b, c in zip(t, s, v, strict=True))]
    (tmp_path / "brake.csv").write_text("\n".join(lines))
    columns = reference(tmp_path / "brake.csv")
    assert list(columns) == ["time", *names]
    assert largest_difference("brake", columns) == pytest.approx(1e-3, rel=1e-6)
