"""Units and signs that were mistaken, parts that check what they fit, sensors that stand still: each is told."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

from heavebond.cli import main
from heavebond.core.errors import DataError, HeavebondError, ModelError
from heavebond.diagnosis.answer import sentences, verdict
from heavebond.diagnosis.state import LadderEntry
from heavebond.estimation.comparison import compare
from heavebond.estimation.experiment import load_experiment
from heavebond.estimation.fitting import fit
from heavebond.estimation.unit_and_sign_checks import (
    declared_otherwise,
    length_seems_in,
    seems_from_another_zero,
    seems_in_another_unit,
    seems_of_another_sign,
    seems_turned,
    seems_without_sign,
    time_seems_in,
)
from heavebond.language.model import loads
from heavebond.numerics.simulation import simulate
from heavebond.records.measurements import read_table
from heavebond.records.noise import NoiseEstimate

MOTION = np.sin(np.linspace(0, 20, 400)) + 0.3 * np.sin(np.linspace(0, 47, 400))

RIG = """\
model: rig
components:
  foot:   {is: PositionSource, u: 0 m}
  spring: {is: Spring, c: 1 kN/m}
  damper: {is: Damper, d: 100 N*s/m}
  load:   {is: Mass, m: 10 kg}
nodes:
  foot: [foot.a, spring.a, damper.a]
  load: [spring.b, damper.b, load.a]
initial: {load.x: 0 m, load.v: 0 m/s}
simulate: {until: 4 s, every: 20 ms}
"""
PUSHED = """\
model: rig
components:
  push:   {is: ForceSource, u: 0 N}
  spring: {is: Spring, c: 1 kN/m}
  damper: {is: Damper, d: 100 N*s/m}
  load:   {is: Mass, m: 1 kg}
  wall:   {is: Fixed}
nodes:
  load: [push.a, spring.a, damper.a, load.a]
  wall: [wall.a, spring.b, damper.b]
initial: {load.x: 0 m, load.v: 0 m/s}
simulate: {until: 4 s, every: 20 ms}
"""
BESIDE = """\
experiment: rig
model: rig.yaml
records:
  one: {file: one.csv, use: fit}
  two: {file: two.csv, use: validate}
time: {column: t, unit: s}
inputs:
  foot.u: {column: foot, unit: mm, interpolation: spline}
outputs:
  load.x: {column: load, unit: mm, noise: 0.1 mm}
"""


def written(folder: Path, text: str = BESIDE, load: np.ndarray | None = None) -> Path:
    t = np.arange(0, 4.01, 0.02)
    foot = 20 * np.sin(2 * np.pi * t) * (1 - np.exp(-t))
    (folder / "rig.yaml").write_text(RIG)
    for k, name in enumerate(("one", "two"), 1):
        measured = k * foot if load is None else load
        rows = "\n".join(f"{a:.2f},{k * b:.4f},{c:.4f}" for a, b, c in zip(t, foot, measured, strict=True))
        (folder / f"{name}.csv").write_text("t,foot,load\n" + rows + "\n")
    path = folder / "beside.yaml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(("column", "unit", "told"), [
    ("pull [kN]", "N", "in kN, the experiment has `unit: N`"), ("pull [kN]", "kN", ""), ("pull [kN]", "bar", "in kN"),
    ("p_Pa", "bar", "in Pa"), ("p_Pa", "Pa", ""), ("crown_m", "kg", ""), ("T (°C)", "K", "in °C"), ("free", "m", ""),
])
def test_a_file_that_gives_another_unit(tmp_path: Path, column: str, unit: str, told: str) -> None:
    path = tmp_path / "one.csv"
    path.write_text(f"t,{column}\n0,1\n1,2\n")
    said = declared_otherwise(read_table(path), column, unit)
    assert told in said if told and said else (said or "") == told


def test_a_row_of_units_counts_too(tmp_path: Path) -> None:
    path = tmp_path / "one.csv"
    path.write_text("t;pull\ns;kN\n0;1\n1;2\n")
    table = read_table(path)
    assert declared_otherwise(table, "t", "s") is None and "in s" in (declared_otherwise(table, "t", "ms") or "")
    assert "'one.csv' gives 'pull' in kN" in (declared_otherwise(table, "pull", "N") or "")


@pytest.mark.parametrize(("factor", "unit", "best"), [
    (1e-3, "mm", "m"), (1e3, "kN", "N"), (14.0, "bar", "psi"), (0.07, "psi", "bar"), (1.5, "mm", ""), (30.0, "N*s/m", "")])
def test_a_factor_that_is_one_between_units(factor: float, unit: str, best: str) -> None:
    """A model that is wrong by half does not hide it; a factor that no unit explains says nothing."""
    wrong = MOTION + 0.4 * np.cos(np.linspace(0, 31, 400))
    for measured, model in ((factor * MOTION, MOTION), (5 + factor * MOTION, wrong)):
        said = seems_in_another_unit(measured, model, unit)
        assert f"with `unit: {best}` in place of `unit: {unit}`" in (said or "") if best else said is None
    assert seems_in_another_unit(np.full(400, 3.0), MOTION, unit) is None
    assert seems_in_another_unit(factor * np.random.default_rng(0).standard_normal(400), MOTION, unit) is None


def test_times_in_ms_that_are_read_as_s_are_asked_about(tmp_path: Path) -> None:
    """Rows every 20 ms for 4 s, as 0, 20, 40 ...: read in s they last 4000 s, a thousand times the run."""
    path = written(tmp_path, BESIDE)
    assert not any("is its time in" in note for note in compare(path).records["one"].notes)
    for file in ("one.csv", "two.csv"):
        head, *rows = (tmp_path / file).read_text().splitlines()
        cells = [row.split(",", 1) for row in rows]
        (tmp_path / file).write_text("\n".join([head, *(f"{1000 * float(t):.0f},{rest}" for t, rest in cells)]) + "\n")
    said = "record 'one' lasts 4000 s, the diagram is run for 4 s: is its time in ms? (`unit: ms` in place of `unit: s`)"
    assert said in compare(path).records["one"].notes
    path.write_text(BESIDE.replace("column: t, unit: s", "column: t, unit: ms"))
    assert not any("is its time in" in note for note in compare(path).records["one"].notes)


@pytest.mark.parametrize(("scale", "unit", "better"), [
    (1e3, "s", "ms"), (1e-3, "ms", "s"), (1 / 60, "s", "min"), (1e6, "s", "us"), (1, "s", ""), (30, "s", ""), (1e5, "s", ""),
])
def test_a_unit_of_time_is_asked_for_where_another_fits(scale: float, unit: str, better: str) -> None:
    assert time_seems_in(scale * np.arange(0, 10, 0.01), 10, 0.01, unit) == better
    assert time_seems_in(np.linspace(0, scale * 10, 3), 10, scale * 5, unit) == ""  # as dense as the run's points


def test_a_record_of_two_samples_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path, BESIDE)
    rows = (tmp_path / "one.csv").read_text().splitlines()
    (tmp_path / "one.csv").write_text("\n".join(rows[:3]) + "\n")
    with pytest.raises(DataError, match="no channel of record 'one' has more than 2 samples"):
        compare(path)


def test_a_sign_that_is_turned() -> None:
    assert "write `is: -(a.x - b.x)`" in (seems_turned(3 - 0.9 * MOTION, MOTION, "a.x - b.x") or "")
    assert "write `is: a.x`" in (seems_turned(3 + 0.9 * MOTION, -MOTION, "-a.x") or "")
    assert seems_turned(MOTION, MOTION, "a.x") is None and seems_turned(np.full(400, 0.1), MOTION, "a.x") is None


def test_a_sign_that_is_turned_while_an_effect_is_missing() -> None:
    """Friction beside a measured force, say: the correlation alone leaves the sign open, the size does not."""
    missing = 0.6 * np.std(MOTION) * np.sign(np.cos(np.arange(len(MOTION)) * 0.37))
    assert -0.9 < np.corrcoef(missing - MOTION, MOTION)[0, 1] < -0.8
    assert "write `is: -(a.x)`" in (seems_turned(3 + missing - MOTION, MOTION, "a.x") or "")
    for other in (missing - 0.2 * MOTION, missing + MOTION, missing, 2 * missing - MOTION):
        assert seems_turned(other, MOTION, "a.x") is None


def test_an_input_of_the_opposite_sign(tmp_path: Path) -> None:
    """It turns all channels; the factor corrects it."""
    turned = BESIDE.replace("{column: foot,", "{column: foot, factor: -1,")
    notes = compare(written(tmp_path, turned)).records["one"].notes
    assert any("if the input foot.u has the opposite sign, write `factor: 1` at foot.u" in note for note in notes)
    one_more = "  time: {column: t, unit: s, noise: 1 s}\n"  # a channel that does not move against the model
    assert not any("factor" in note for note in compare(written(tmp_path, turned + one_more)).records["one"].notes)


def test_a_factor_multiplies_the_readings(tmp_path: Path) -> None:
    path = written(tmp_path)
    before = compare(path).records["one"].channels["load.x"].error
    rows = [row.split(",") for row in (tmp_path / "one.csv").read_text().split()[1:]]
    (tmp_path / "one.csv").write_text("t,foot,load\n" + "".join(f"{t},{-float(a) / 2:.5f},{b}\n" for t, a, b in rows))
    path.write_text(BESIDE.replace("{column: foot,", "{column: foot, factor: -2,"))
    assert compare(path).records["one"].channels["load.x"].error == pytest.approx(before, rel=0.01)


@pytest.mark.parametrize("factor", ["0", "2 mm", "sign", "=time"])
def test_a_factor_is_a_number(tmp_path: Path, factor: str) -> None:
    with pytest.raises(HeavebondError) as caught:
        compare(written(tmp_path, BESIDE.replace("{column: foot,", f"{{column: foot, factor: {factor},")))
    assert caught.value.problems[0].place and caught.value.problems[0].place.line == 8


@pytest.mark.parametrize(("unit", "offset", "write"), [
    ("bar", -1.01, "`is: A.p - 1.01325 bar`"), ("kPa", 98.0, "`is: A.p + 101.325 kPa`"),
    ("K", -273.15, "`unit: degC`"), ("degC", 273.15, "`unit: K`"),
    ("bar", -1.3, ""), ("mm", -1.01, ""), ("bar", 0.0, ""),
])
def test_a_zero_of_pressure_or_temperature_that_is_another(unit: str, offset: float, write: str) -> None:
    size = 0.2 if unit == "bar" else 10.0
    said = seems_from_another_zero(offset + 1.1 * size * MOTION, size * MOTION, unit, "A.p")
    assert write in said if said and write else not said and not write
    assert seems_from_another_zero(offset + 10 * abs(offset) * MOTION, 0 * MOTION, unit, "A.p") is None  # more is wrong


def test_compare_tells_them(tmp_path: Path) -> None:
    in_metres = BESIDE.replace("unit: mm, noise: 0.1 mm", "unit: m, noise: 0.1 m")
    notes = compare(written(tmp_path, in_metres)).records["one"].notes
    assert any("with `unit: mm` in place of `unit: m`" in note for note in notes)
    notes = compare(written(tmp_path, BESIDE.replace("load.x: {", "load.x: {is: -load.x, "))).records["one"].notes
    assert any("write `is: load.x`" in note for note in notes)


def test_a_sensor_that_stands_still(tmp_path: Path) -> None:
    found = compare(written(tmp_path, load=np.full(201, 0.1))).records["one"]
    assert np.isnan(found.normalised) and np.isnan(found.channels["load.x"].fit)
    assert not found.channels["load.x"].outlier.any()
    assert [note for note in found.notes if "all its 201 samples read 0.1 mm: is it the right column" in note]


def test_an_input_that_drives_nothing(tmp_path: Path) -> None:
    """No input at all, one that stands still, one whose column is compared as well: each is told of every record."""
    path = written(tmp_path)
    for change, said in (
            ((BESIDE.partition("time: {column: t, unit: s}\n")[2].partition("outputs")[0], ""),
             "no column of the record drives the model"),
            (("column: load", "column: foot"), "the output load.x and the input foot.u are the same column 'foot'")):
        path.write_text(BESIDE.replace(*change))
        assert all(any(note.startswith(said) for note in r.notes) for r in compare(path).records.values()), said
    rows = (tmp_path / "two.csv").read_text().splitlines()
    (tmp_path / "two.csv").write_text("\n".join([rows[0], *(",".join([r.split(",")[0], "2.5", r.split(",")[2]])
                                                          for r in rows[1:])]))
    path.write_text(BESIDE)
    notes = compare(path).records["two"].notes
    assert "the input foot.u reads 2.5 mm throughout: is it the right column, and was the sensor connected?" in notes


@pytest.mark.parametrize(("change", "said"), [
    (("unit: mm, noise: 0.1 mm", "unit: mmm, noise: 0.1 mm"), "'mmm' is not a known unit"),
    (("time: {column: t, unit: s}\n", ""), "Write `time: {column: time_s, unit: s}`, or `time: {every: 10 ms}`"),
    ((", interpolation: spline", ""), "Add `interpolation: spline` (for smooth signals), `linear`, or `hold`"),
    (("outputs:", "free: {spring.c: 1 kN/m +/- 10 %}\noutputs:"), "Write `1 kN/m +- 10 %`."),
    (("outputs:", "free: {spring.c: 1 kN/m}\noutputs:"), "Write `1 kN/m +- 20 %`."),
    (("outputs:", "free: {spring.c: 1 kN +- 10 %}\noutputs:"), "Write it in N/m or in a multiple of it."),
])
def test_mistakes_in_an_experiment_end_with_what_to_type(tmp_path: Path, change: tuple[str, str], said: str) -> None:
    with pytest.raises(HeavebondError) as caught:
        fit(written(tmp_path, BESIDE.replace(*change)))
    assert said in str(caught.value)


@pytest.mark.parametrize(("change", "refused"), [
    ("file: one.csv, use: validate", True), ("file: copy.csv, use: validate", True),
    ("file: one.csv, use: validate, from: 2 s", True), ("file: one.csv, use: validate, from: 3 s", False)])
def test_what_is_fitted_does_not_check_the_fit(tmp_path: Path, change: str, refused: bool) -> None:
    text = BESIDE.replace("one: {file: one.csv, use: fit", "one: {file: one.csv, use: fit, to: 3 s")
    path = written(tmp_path, text.replace("file: two.csv, use: validate", change))
    (tmp_path / "copy.csv").write_bytes((tmp_path / "one.csv").read_bytes())
    if not refused:
        assert len(load_experiment(path).records) == 2
        return
    with pytest.raises(ModelError, match="record 'two' validates the fit, but its data are fitted as 'one'"):
        load_experiment(path)


def test_noise_where_it_is_fitted_and_misfit_where_not_is_not_nothing() -> None:
    """Four fitted samples show nothing; that the model is right is not said while the other record misses by 75 times."""
    channel = SimpleNamespace(measured=MOTION, noise=0.01, white=0.0)
    record = SimpleNamespace(channels={"x": channel}, use="validate")
    comparison = SimpleNamespace(records={"one": record}, parts=(record,))
    step = SimpleNamespace(left=SimpleNamespace(significant=False), partial=False, at_end=())
    for held_out, said in ((5687.0, "undetermined"), (1.4, "nothing")):
        ladder = [LadderEntry("rig", 1.1, 0.4, 1.1, held_out, comparison)]
        assert verdict.verdict(None, ladder, [], [step], None) == said
    (told,) = sentences.sentences("undetermined", [LadderEntry("rig", 1.1, 0.4, 1.1, 5687.0, comparison)],
                                [], [step], None)
    assert "reduced chi-square is 5687" in told and "`use: fit`" in told


def test_an_estimated_noise_that_cannot_be_right_is_told() -> None:
    """Of four channels one leaves twice its estimate (a filtered sensor), one half of it, one has its noise given, and one
    leaves far more than any filter would hide."""
    channels = {name: SimpleNamespace(unit="N", error=error, noise=0.02, counts=np.ones(100, bool))
                for name, error in (("filtered", 0.04), ("quick", 0.01), ("given", 0.04), ("wrong", 1.0))}
    outputs = {name: SimpleNamespace(noise=0.02 if name == "given" else None) for name in channels}
    estimates = {"filtered": NoiseEstimate(0.02, 0.03, 0.75), "quick": NoiseEstimate(0.02, 0.03, 0.125)}
    comparison = SimpleNamespace(parts=(SimpleNamespace(use="validate", channels=channels),),
                                 experiment=SimpleNamespace(outputs=outputs, estimated_noise=estimates))
    step = SimpleNamespace(left=SimpleNamespace(significant=True), partial=False, at_end=())
    told = sentences.sentences("undetermined", [LadderEntry("rig", 1.1, 0.4, 9.0, 9.0, comparison)],
                             [], [step], None)
    assert told[1].startswith("The noise of quick (estimated at 0.02 N) cannot be separated from the signal")
    assert "`noise: 0.04 N` at filtered: then" in told[2] and "given" not in told[2] and "wrong" not in told[2]
    assert "noise is left in quick, which" in told[3]


def test_a_record_without_sign_is_told() -> None:
    told = seems_without_sign(np.abs(MOTION) - 0.02, 0.8 * MOTION, "drum.w")
    assert told is not None and "`is: abs(drum.w)`" in told
    # a record with its sign, one that is always above zero, and one that has nothing to do with the model
    assert seems_without_sign(MOTION, MOTION, "drum.w") is None
    assert seems_without_sign(MOTION + 2, MOTION, "drum.w") is None
    assert seems_without_sign(np.abs(MOTION), np.abs(MOTION) - 0.1, "drum.w") is None
    assert seems_without_sign(np.abs(np.cos(np.arange(400.0))), MOTION, "drum.w") is None


def test_a_force_of_one_sign_recorded_with_the_other_is_told_with_both_remedies() -> None:
    """A hanging load, whose force the model counts below zero throughout: a mistuned model, so that neither is sure."""
    model = -15.0 + MOTION
    told = seems_of_another_sign(15.2 - 0.9 * MOTION + 0.6 * np.cos(np.arange(len(MOTION)) * 0.37), model, "rope.b.f")
    assert told is not None and "`is: -(rope.b.f)`" in told and "`is: abs(rope.b.f)`" in told


@pytest.mark.parametrize(("between", "told"), [("hold", True), ("linear", False)])
def test_an_input_that_should_not_be_held_is_told(tmp_path: Path, between: str, told: bool) -> None:
    """A force that went on between its samples, eight of them in a swing."""
    pushed = PUSHED.replace("u: 0 N", 'u: "=20 N*sin(2*pi*time/0.16 s)"')
    run = simulate(loads(pushed), "8 s", every="20 ms")
    rows = "\n".join(f"{a:.2f},{20 * np.sin(2 * np.pi * a / 0.16):.4f},{1e3 * b:.6f}"
                     for a, b in zip(run.time, run["load.x"], strict=True))
    (tmp_path / "one.csv").write_text(f"t,push,load\n{rows}\n")
    (tmp_path / "rig.yaml").write_text(PUSHED)
    path = tmp_path / "beside.yaml"
    path.write_text(f"""\
experiment: pushed
model: rig.yaml
records: {{one: {{file: one.csv, use: fit}}}}
time: {{column: t, unit: s}}
inputs: {{push.u: {{column: push, unit: N, interpolation: {between}}}}}
outputs: {{load.x: {{column: load, unit: mm}}}}
""")
    assert any("`interpolation: linear`" in note for note in compare(path).records["one"].notes) == told


# -- of two hints that exclude each other the likelier ----------------------------------------------------------------
def test_one_hint_about_an_input_that_is_held(tmp_path: Path) -> None:
    """All channels look early; to shift each of them would be the other way to correct the same."""
    test_an_input_that_should_not_be_held_is_told(tmp_path, "hold", True)
    notes = compare(tmp_path / "beside.yaml").records["one"].notes
    assert not any("write `shift:" in note or "if shifted in time" in note for note in notes)


def test_one_hint_about_a_sign() -> None:
    below = MOTION - np.max(MOTION)  # never above zero
    assert seems_without_sign(-below, below, "x") and seems_turned(-below, below, "x")
    assert "is: -(x)" in (seems_of_another_sign(-below, below, "x") or "")
    below = MOTION - 0.85
    assert "is: abs(x)" in (seems_of_another_sign(np.abs(below), below, "x") or "")


def test_one_hint_about_a_unit(tmp_path: Path) -> None:
    """What the file says of a column is likelier than what the size of its values suggests, and all of it likelier than an
    offset."""
    path = written(tmp_path, BESIDE.replace("column: load, unit: mm", "column: 'load [um]', unit: mm"))
    for file in ("one.csv", "two.csv"):
        cells = [row.split(",") for row in (tmp_path / file).read_text().splitlines()[1:]]
        (tmp_path / file).write_text("\n".join(["t,foot,load [um]", *(
            f"{t},{foot},{100 + 0.1 * float(x):.5f}" for t, foot, x in cells)]) + "\n")
    found = compare(path)
    for record in found.records.values():
        assert sum("unit: " in note for note in record.notes) == 1, record.notes
        assert any("gives 'load [um]' in um" in note for note in record.notes)
    assert found.advice == ()


def test_one_hint_about_the_time(tmp_path: Path) -> None:
    """Times in ms that are read as s: that the channel seems late comes of it."""
    t = np.arange(0, 4.01, 0.02)
    path = written(tmp_path, load=20 * np.sin(2 * np.pi * (t - 0.03)) * (1 - np.exp(-t)))
    for file in ("one.csv", "two.csv"):
        head, *rows = (tmp_path / file).read_text().splitlines()
        cells = [row.split(",", 1) for row in rows]
        (tmp_path / file).write_text("\n".join([head, *(f"{1000 * float(t):.0f},{rest}" for t, rest in cells)]) + "\n")
    found = compare(path)
    assert all(len(r.notes) == 1 and "is its time in ms?" in r.notes[0] for r in found.records.values())
    assert found.advice == ()


def test_a_unit_of_time_is_likelier_than_an_input_that_ends_early(tmp_path: Path) -> None:
    assert length_seems_in(0.004, 4.0, "ms") == "s" and length_seems_in(3.0, 4.0, "s") == ""
    own_time = BESIDE.replace("column: foot, unit: mm,", "column: foot, unit: mm, time: {column: s, unit: ms},")
    path = written(tmp_path, own_time)
    for file in ("one.csv", "two.csv"):
        head, *rows = (tmp_path / file).read_text().splitlines()
        (tmp_path / file).write_text("\n".join([f"{head},s", *(f"{row},{row.split(',')[0]}" for row in rows)]) + "\n")
    with pytest.raises(DataError) as caught:
        compare(path)
    assert "In s the times of this input would be as long: correct the `unit:`" in str(caught.value)
    assert "Write `to:" not in str(caught.value)


def test_the_end_of_a_range_says_nothing_of_what_is_not_seen(tmp_path: Path) -> None:
    """Without motion of its own the mass is not identifiable: that it ends at its range is no sign of a missing effect."""
    path = written(tmp_path, BESIDE + "free: {load.m: 10 .. 20 kg, spring.c: 0.5 .. 2 kN/m}\n")
    (tmp_path / "rig.yaml").write_text(RIG.replace("c: 1 kN/m}", "c: 1 MN/m}").replace("d: 100 N*s/m", "d: 1 MN*s/m"))
    path.write_text(path.read_text().replace("0.5 .. 2 kN/m", "0.5 .. 2 MN/m"))
    found = fit(path)
    said = CliRunner().invoke(main, ["fit", str(path)]).stdout
    for p in found.parameters:
        assert not (p.name in found.identifiability.unseen_names and f"{p.name} ended at" in said)
    assert "load.m" in found.identifiability.unseen_names and any(p.at_bound for p in found.parameters if p.name == "load.m")
