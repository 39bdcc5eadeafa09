"""Units of loggers that stand for another: 1/min and Hz of a shaft count revolutions, g of an accelerometer is gravity."""

from __future__ import annotations

from math import pi
from pathlib import Path

import pytest
from click.testing import CliRunner

import heavebond as hb
from heavebond.cli import main
from heavebond.core.errors import HeavebondError
from heavebond.core.units import read_unit
from heavebond.estimation.unit_and_sign_checks import declared_otherwise
from heavebond.records.measurements import read_table

DIAGRAM = """\
model: shaft
components:
  motor: {is: SpeedSource, u: 10 rad/s}
  coupling: {is: TorsionSpringDamper, c: 40 N*m/rad, d: 1 N*m*s/rad}
  wheel: {is: Inertia, J: 0.2 kg*m**2}
nodes:
  motor: [motor.a, coupling.a]
  wheel: [coupling.b, wheel.a]
show: {speed: {is: SHOWN, unit: UNIT}}
simulate: {until: 1 s}
"""
EXPERIMENT = """\
experiment: shaft
model: shaft.yaml
records: {one: {file: one.csv, use: fit}}
time: {column: t, unit: s}
inputs: {motor.u: {column: n_in, unit: INPUT, interpolation: linear}}
outputs: {speed: {is: SHOWN, column: n_out, unit: OUTPUT, noise: 1 UNIT}}
"""


def written(folder: Path, *, shown: str = "wheel.w", unit: str = "rpm", given: str = "rpm", read: str = "rpm") -> Path:
    (folder / "shaft.yaml").write_text(DIAGRAM.replace("SHOWN", shown).replace("UNIT", unit))
    rows = [f"{0.01 * k},{95 + k % 7},{96 + k % 5}" for k in range(200)]
    (folder / "one.csv").write_text("\n".join(["t,n_in,n_out", *rows]) + "\n")
    text = EXPERIMENT.replace("SHOWN", shown).replace("INPUT", given).replace("OUTPUT", read).replace("UNIT", "rad/s")
    (folder / "one.yaml").write_text(text)
    return folder / "one.yaml"


@pytest.mark.parametrize(("case", "advice"), [({"read": "1/min"}, "`rpm`"), ({"given": "1/min"}, "`rpm`"),
                                              ({"read": "Hz"}, "`rps`"), ({"given": "Hz"}, "`rps`"),
                                              ({"unit": "1/min"}, "`rpm`"),
                                              ({"shown": "-(wheel.w)", "read": "1/min"}, "`rpm`"),
                                              ({"shown": "wheel.w - motor.w", "unit": "1/min"}, "`rpm`")])
def test_a_speed_in_turns_without_a_name_is_refused_with_the_unit_to_write(tmp_path: Path, case: dict[str, str], advice: str
                                                                         ) -> None:
    with pytest.raises(HeavebondError) as caught:
        hb.compare(written(tmp_path, **case))
    assert {p.code for p in caught.value.problems} == {"unit-cycles"}
    assert advice in caught.value.problems[0].hint


@pytest.mark.parametrize("case", [{}, {"read": "1/s", "given": "1/s", "unit": "1/s"}, {"read": "deg/s"},
                                  {"shown": "wheel.w/(2*pi)", "unit": "Hz", "read": "1/min"}])
def test_speeds_that_say_what_they_count_and_formulas_that_convert_are_taken(tmp_path: Path, case: dict[str, str]) -> None:
    assert list(hb.compare(written(tmp_path, **case)).records) == ["one"]


def test_one_over_minutes_in_a_header_agrees_with_revolutions_a_minute(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("t [s],n [1/min],f [Hz]\n0,1,2\n1,2,3\n")
    table = read_table(tmp_path / "log.csv")
    assert declared_otherwise(table, "n [1/min]", "rpm") is None
    assert "one of them is wrong" in (declared_otherwise(table, "f [Hz]", "rpm") or "")
    assert read_unit("rpm").scale == pytest.approx(2 * pi / 60)


def test_an_experiment_from_a_record_takes_one_over_minutes_for_revolutions(tmp_path: Path) -> None:
    (tmp_path / "shaft.yaml").write_text(DIAGRAM.replace("SHOWN", "wheel.w").replace("UNIT", "rpm"))
    (tmp_path / "log.csv").write_text("t [s],motor speed [1/min],wheel speed [1/min]\n" +
                                      "".join(f"{0.1 * k},{k % 9},{k % 7}\n" for k in range(40)))
    found = CliRunner().invoke(main, ["new", str(tmp_path / "log.yaml"), "--from", str(tmp_path / "shaft.yaml"),
                                      str(tmp_path / "log.csv")])
    assert found.exit_code == 0, found.output
    text = (tmp_path / "log.yaml").read_text()
    assert text.count("unit: rpm") == 2
    assert "1/min, i" not in text


SHAKER = """\
model: shaker
components:
  table: {is: AccelerationSource, u: 1 m/s**2}
  pad: {is: SpringDamper, c: 40 kN/m, d: 100 N*s/m}
  load: {is: Mass, m: 3 kg}
nodes:
  table: [table.a, pad.a]
  load: [pad.b, load.a]
show: {load: {is: der(load.v), unit: m/s**2}}
simulate: {until: 1 s}
"""


def test_accelerations_in_multiples_of_gravity_are_read_and_proposed_as_such(tmp_path: Path) -> None:
    (tmp_path / "shaker.yaml").write_text(SHAKER)
    (tmp_path / "log.csv").write_text("t_s,table_g,load_g\n" + "".join(f"{0.01 * k},{k % 9},{k % 7}\n" for k in range(40)))
    found = CliRunner().invoke(main, ["new", str(tmp_path / "log.yaml"), "--from", str(tmp_path / "shaker.yaml"),
                                      str(tmp_path / "log.csv")])
    assert found.exit_code == 0, found.output
    text = (tmp_path / "log.yaml").read_text()
    assert text.count("unit: g_n") == 2
    assert read_unit("g_n").scale == 9.80665
    with_noise = text.replace("column: load_g,", "column: load_g, noise: 0.1 g_n,")
    (tmp_path / "log.yaml").write_text(with_noise)
    record = hb.compare(tmp_path / "log.yaml").records["log"]
    assert not any("one of them is wrong" in remark for remark in record.notes)
    (tmp_path / "log.yaml").write_text(with_noise.replace("g_n", "g"))
    with pytest.raises(HeavebondError) as caught:
        hb.compare(tmp_path / "log.yaml")
    assert all("g_n" in problem.hint for problem in caught.value.problems if problem.code == "unit-wrong")
    assert "unit-wrong" in {problem.code for problem in caught.value.problems}


@pytest.mark.parametrize(("header", "row", "unit"), [
    ("phi", "Grad", "deg"), ("torque", "kNm", "kN*m"), ("torque [Ncm]", "", "N*cm"), ("torque_lbf_ft", "", "lbf*ft"),
    ("torque [ft-lb]", "", "lbf*ft"), ("torque", "in-lb", "lbf*in"), ("n", "min-1", "1/min"), ("clock", "Min", "min"),
    ("pull_kN", "", "kN"), ("x", "foo", None)])
def test_units_as_files_write_them(tmp_path: Path, header: str, row: str, unit: str | None) -> None:
    (tmp_path / "log.csv").write_text(f"time;{header};other\n" + (f"s;{row};mm\n" if row else "") + "0;1;2\n1;2;3\n")
    found = read_table(tmp_path / "log.csv").unit_of(header)
    assert (found[1].text if found else None) == unit
    if found and unit:
        assert found[1].scale == read_unit(unit).scale


PUMP = """\
model: drive
components:
  engine: {is: SpeedSource, u: 1100 rpm}
  pump: {is: HydraulicPump, D: 28 cm**3/rev}
  line: {is: Volume, V: 1 L, beta: 1.4 GPa}
  relief: {is: LaminarLeakage, C: 1e-10 m**3/(s*Pa)}
  tank: {is: Tank}
nodes:
  drive: [engine.a, pump.s]
  high: [pump.b, line.a, relief.a]
  low: [tank.a, pump.a, relief.b]
show: {pressure: {is: high.p, unit: bar}}
simulate: {until: 1 s}
"""


def test_what_a_source_prescribes_is_proposed_as_its_input(tmp_path: Path) -> None:
    """The measured speed of a pump that a speed source turns is no output, even where the source is called otherwise."""
    (tmp_path / "drive.yaml").write_text(PUMP)
    rows = "".join(f"{0.01 * k},{k % 9},{k % 7}\n" for k in range(40))
    (tmp_path / "log.csv").write_text("t_s,pump_rpm,high [barg]\n" + rows)
    found = CliRunner().invoke(main, ["new", str(tmp_path / "log.yaml"), "--from", str(tmp_path / "drive.yaml"),
                                      str(tmp_path / "log.csv")])
    assert found.exit_code == 0, found.output
    text = (tmp_path / "log.yaml").read_text()
    assert "engine.u: {column: pump_rpm, unit: rpm" in text
    assert "pump.s.w" not in text
    assert "'barg', the unit of 'high [barg]', is not known. Write 'bar'" in found.output
