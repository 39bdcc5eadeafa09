"""Records that begin in another state than the diagram says: told as such, and no effect named in their place."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

import heavebond as hb
from heavebond.diagnosis.answer.files import Targets, write_findings
from heavebond.estimation.experiment import load_experiment

CART = """\
model: cart
components:
  drive: {is: PositionSource, u: "=8 mm*sin(2*pi*time/SLOW) + 4 mm*sin(2*pi*time/(0.7 s))"}
  link:  {is: SpringDamper, c: 8 kN/m, d: 90 N*s/m}
  cart:  {is: Mass, m: 60 kg}
  rail:  {is: Fixed}
  shoe:  {is: CoulombFriction, F_c: FRICTION, v_t: 1 mm/s}
nodes:
  drive: [drive.a, link.a]
  cart:  [link.b, cart.a, shoe.b]
  rail:  [rail.a, shoe.a]
INITIAL
show: {drive: {is: drive.x, unit: mm}, cart: {is: cart.x, unit: mm}}
simulate: {until: 6 s, every: 20 ms}
"""
MEASURED = """\
experiment: cart measured
model: cart.yaml
records:
  one: {file: one.csv, use: fit}
  two: {file: two.csv, use: validate}
time: {column: t, unit: s}
inputs:
  drive.u: {column: drive, unit: mm, interpolation: spline}
outputs:
  cart.x: {column: cart, unit: mm, noise: 0.2 mm}
free:
  link.c: 8 kN/m +- 10 %
"""
STARTS = {"one": ("2.3 s", 6.0), "two": ("1.9 s", -4.0)}


def experiment(folder: Path, friction: str, initial: str = "", speeds: Mapping[str, float] | None = None) -> Path:
    """Records of a cart that begin at 6 and -4 mm, and with `speeds` (mm/s) where these are given, and an experiment on a
    diagram without friction that begins at rest at 0."""
    rng = np.random.default_rng(7)
    for name, (slow, start) in STARTS.items():
        text = CART.replace("SLOW", f"({slow})").replace("FRICTION", friction)
        speed = (speeds or {}).get(name, 0.0)
        run = hb.simulate(hb.loads(text.replace("INITIAL", f"initial: {{cart.x: {start} mm, cart.v: {speed} mm/s}}")))
        columns = [run.time, run.display["drive"], run.display["cart"] + 0.2 * rng.standard_normal(len(run.time))]
        np.savetxt(folder / f"{name}.csv", np.array(columns).T, delimiter=",", comments="", header="t,drive,cart")
    kept = [line for line in CART.splitlines() if not line.startswith(("  shoe", "  rail"))]
    diagram = "\n".join(kept).replace(", shoe.b", "").replace("INITIAL", initial).replace("SLOW", "(2 s)")
    (folder / "cart.yaml").write_text(diagram + "\n", encoding="utf-8")
    (folder / "measured.yaml").write_text(MEASURED, encoding="utf-8")
    return folder / "measured.yaml"


@pytest.mark.long
@pytest.mark.parametrize("initial", ["", "initial: {cart.x: 0 mm, cart.v: 0 m/s}"])
def test_a_wrong_start_alone_is_no_missing_effect(tmp_path: Path, initial: str) -> None:
    path = experiment(tmp_path, "0 N", initial)
    found = hb.diagnose(path, classes=["dry friction", "backlash"], number=1)
    assert found.verdict == "parameters" and not found.findings and found.started
    names = [entry.name for entry in found.ladder]
    assert names == ["cart", "cart, parameters fitted", "cart, start of each record fitted"]
    assert found.ladder[1].chi2_held_out > 2 and found.ladder[2].chi2_held_out < 1.2
    (said,) = [words for words in found.words if "do not begin where the diagram does" in words]
    begins = [float(part.split(" mm")[0]) for part in said.split("begins at ")[1].split(", ")[:2]]
    assert begins == pytest.approx([6, -4], abs=0.15)
    # what it says to write is an experiment, and leaves noise
    quoted = said.split("`")[1::2]
    path.write_text(MEASURED + f"  {quoted[0]}\n", encoding="utf-8")
    if not initial:
        diagram = (tmp_path / "cart.yaml").read_text(encoding="utf-8")
        (tmp_path / "cart.yaml").write_text(f"{diagram}{quoted[2]}\n", encoding="utf-8")
    assert hb.fit(path).chi2 < 1.2


@pytest.mark.long
def test_an_effect_is_found_beside_wrong_starts(tmp_path: Path) -> None:
    path = experiment(tmp_path, "25 N")
    found = hb.diagnose(path, classes=["dry friction", "backlash"], number=1)
    assert found.verdict == "effect" and {f.candidate.kind for f in found.findings} == {"dry friction"}
    assert found.ladder[-1].chi2_held_out < 1.2
    # the files hold the starts of each record too
    given = load_experiment(path)
    (written,) = write_findings(given, found.findings, Targets.beside(given, tmp_path / "found"))
    assert load_experiment(written).free["initial.cart.x"].each
    # and without another fit, `heavebond compare` shows the errors of the answer
    assert all(part.chi2 < 1.3 for part in hb.compare(written).parts)
    assert hb.fit(written).chi2 < 1.2


@pytest.mark.long
def test_a_right_start_is_not_freed(tmp_path: Path) -> None:
    path = experiment(tmp_path, "25 N")
    text = MEASURED.replace("use: fit", "use: fit, initial: {cart.x: 6 mm}").replace(
        "use: validate", "use: validate, initial: {cart.x: -4 mm}")
    path.write_text(text, encoding="utf-8")
    found = hb.diagnose(path, classes=["dry friction"], number=1)
    assert not found.started and found.verdict == "effect"


@pytest.mark.long
def test_records_cut_from_a_motion_begin_with_a_velocity_too(tmp_path: Path) -> None:
    """Friction beside a start at 6 and -4 mm with -50 and 80 mm/s; the files that are written keep both."""
    speeds = {"one": -50.0, "two": 80.0}
    path = experiment(tmp_path, "25 N", speeds=speeds)
    found = hb.diagnose(path, classes=["dry friction", "backlash"], number=1)
    assert found.verdict == "effect" and {f.candidate.kind for f in found.findings} == {"dry friction"}
    assert found.ladder[-1].chi2_held_out < 1.2
    said = [words for words in found.words if "do not begin where the diagram does" in words]
    assert len(said) == 2 and "cart.v begins at" in said[1]
    begins = [float(part.split(" mm/s")[0]) for part in said[1].split("begins at ")[1].split(", ")[:2]]
    assert begins == pytest.approx(list(speeds.values()), abs=5)
    given = load_experiment(path)
    (written,) = write_findings(given, found.findings, Targets.beside(given, tmp_path / "found"))
    assert load_experiment(written).free["initial.cart.v"].each
    assert hb.fit(written).chi2 < 1.2
