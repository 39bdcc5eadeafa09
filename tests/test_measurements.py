"""Reading records: what is accepted, and that each complaint names file, line and what to do."""

import sys
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

from heavebond.core.errors import DataError, HeavebondError, Place, UsageError
from heavebond.records.measurements import Table, check_gaps, check_time, column, gaps, read_table, samples


def write(folder: Path, text: str, name: str = "train.csv") -> Path:
    path = folder / name
    path.write_bytes(text.encode())
    return path


def complaint(folder: Path, text: str, used: str = "") -> DataError:
    with pytest.raises(DataError) as caught:
        column(read_table(write(folder, text)), used)
    return caught.value


def where(error: HeavebondError) -> list[tuple[str, int, int]]:
    return [(p.code, p.place.line, p.place.column) for p in error.problems if p.place]


def steady(n: int = 10, step: float = 0.5) -> str:
    return "time_s,z\n" + "".join(f"{k * step},{k}\n" for k in range(n))


@pytest.mark.parametrize("separator", [",", ";", "\t", " , "])
@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
def test_separators_and_line_ends(tmp_path: Path, separator: str, newline: str) -> None:
    rows = ["# made by hand", "time_s{}heave_m", "0{}1e-3", "", "# half way", "0.5{}-.25"]
    table = read_table(write(tmp_path, newline.join(rows).replace("{}", separator)))
    assert table.header == ("time_s", "heave_m")
    assert column(table, "time_s").tolist() == [0.0, 0.5]
    assert column(table, "heave_m").tolist() == [0.001, -0.25]
    assert table.lines.tolist() == [3, 6]


def test_byte_order_mark_quotes_and_closing_separator(tmp_path: Path) -> None:
    table = read_table(write(tmp_path, '\ufefftime,"force, hook",\n0,"1.5",\n1,2,\n'))
    assert table.header == ("time", "force, hook")
    assert column(table, "force, hook").tolist() == [1.5, 2.0]
    spot = table.place(0, "force, hook")
    assert (spot.line, spot.column, spot.length) == (2, 3, 5)


def test_all_problems_of_a_file_at_once(tmp_path: Path) -> None:
    error = complaint(tmp_path, "t,z,y\n0,1,2\n1,x1,3\n2,4\n3,5,6,7\n4,8,9\n")
    assert where(error) == [("record-ragged", 4, 4), ("record-ragged", 5, 7)]
    text = str(error) + str(complaint(tmp_path, "t,z,y\n0,1,2\n1,x1,3\n", "z"))
    assert f"{tmp_path / 'train.csv'}:3: 'x1' in column 'z' is not a number" in text
    assert "    3 | 1,x1,3\n      |   ^^" in text
    assert "this row has 2 cells, the row of names has 3" in text
    assert "Write a number, or empty the cell: a sample that was not taken." in text
    assert "separated by commas" in text


def test_many_of_a_kind_are_counted(tmp_path: Path) -> None:
    bad = complaint(tmp_path, "t,z\n" + "".join(f"{k},{'oops' if 3 <= k < 23 else k}\n" for k in range(30)), "z")
    assert where(bad) == [("record-text", k, 3) for k in (5, 6, 7, 8, 9)]
    assert [p.notes for p in bad.problems][3:] == [(), ("and 15 more such cells in this file",)]
    ragged = complaint(tmp_path, "t,z\n0,1\n" + "7\n" * 6 + "1,1\n")
    assert where(ragged) == [("record-ragged", k, 2) for k in (3, 4, 5, 6, 7)]
    assert ragged.problems[-1].notes == ("and 1 more such rows in this file",)
    five = complaint(tmp_path, "t,z\n0,1\n" + "7\n" * 5)
    assert len(five.problems) == 5 and not any(p.notes for p in five.problems)


def test_files_of_spreadsheets_are_read_as_they_come(tmp_path: Path) -> None:
    """As a German Excel writes it: Windows-1252, semicolons, decimal commas, a row of units, empty cells."""
    text = "Zeit;Weg;Temperatur;Träger\r\ns;mm;°C;kN/m²\r\n0,00;12,5;20;1,5E-3\r\n0,02;;20,5;-,25\r\n"
    path = tmp_path / "excel.csv"
    path.write_bytes(text.encode("cp1252"))
    table = read_table(path)
    assert table.header == ("Zeit", "Weg", "Temperatur", "Träger")
    assert column(table, "Zeit").tolist() == [0.0, 0.02] and column(table, "Träger").tolist() == [1.5e-3, -0.25]
    assert column(table, "Weg")[0] == 12.5 and np.isnan(column(table, "Weg")[1])
    assert table.lines.tolist() == [3, 4] and table.place(0, "Weg").column == 6
    known = {name: said and (said[0], said[1].scale, said[2]) for name in table.header for said in [table.unit_of(name)]}
    assert known == {"Zeit": ("s", 1.0, True), "Weg": ("mm", 1e-3, True), "Temperatur": ("°C", 1.0, True),
                     "Träger": ("kN/m²", 1e3, True)}
    for other in (text.encode("utf-16"), ("sep=;\r\n" + text).encode("utf-8-sig")):
        path.write_bytes(other)
        again = read_table(path)
        assert again.header == table.header and column(again, "Träger").tolist() == [1.5e-3, -0.25]


def test_unit_beside_a_name(tmp_path: Path) -> None:
    table = read_table(write(tmp_path, "t_s,pull [kN],p (bar),crown_mm,valve_u,n [best],kN\n" + "0,1,2,3,4,5,6\n" * 2))
    found = [table.unit_of(name) for name in table.header]
    assert [f and (f[0], f[2]) for f in found] == [("s", False), ("kN", True), ("bar", True), ("mm", False),
                                                   None, None, None]


@pytest.mark.parametrize("text", [
    "Axis1\nSampling interval (ms),0.7\nt,z,n\nms,rpm,-\n0,1,2\n1,2,3\n",  # a servo drive
    "Trace 4\n\nDate;3,5\nt;z;n\n0;1,5;1\n1;2,5;1\n",  # decimal commas
    "Run, of today, at noon, in the lab\nt\tz\tn\n0\t1\t2\n1\t2\t3\n",  # a title with other separators
    "Started,2020-03-16,17:04\nInterval,0.7,0.7\nt,z,n\nUnit,V,V\n0,1,2\n1,2,3\n",  # as wide as the table
    "Run 7,,\nDate,2024-05-01,\nt,z,n\n0,1,2\n1,2,3\n",  # a spreadsheet
    "Run 7;;\n;;\nRate;100;\nt;z;n\ns;mm;\n0;1,5;1\n1;2,5;1\n",
])
def test_settings_of_a_logger_above_the_names_are_skipped(tmp_path: Path, text: str) -> None:
    table = read_table(write(tmp_path, text))
    assert table.header == ("t", "z", "n") and column(table, "t").tolist() == [0, 1]
    assert table.place(1, "z").line == text.count("\n")  # lines are counted as in an editor


def test_settings_between_runs_are_no_settings(tmp_path: Path) -> None:
    """No row of numbers is skipped: a second row of names further below is a row with text."""
    again = write(tmp_path, "t,z\n0,1\n1,2\nt,z\n0,3\n1,4\n2,5\n3,6\n4,7\n5,8\n")
    assert read_table(again).header == ("t", "z")
    assert where(complaint(tmp_path, again.read_text(), "z")) == [("record-text", 4, 3)]
    early = "t,z\n0,OVER\n1,OVER\n2,3\n3,4\n4,5\n5,6\n6,7\n"  # text where the numbers should begin
    assert where(complaint(tmp_path, early, "z")) == [("record-text", 2, 3), ("record-text", 3, 3)]
    assert column(read_table(write(tmp_path, early)), "t").tolist() == [0, 1, 2, 3, 4, 5, 6]


def test_two_rows_that_may_be_the_names_are_refused(tmp_path: Path) -> None:
    """Which line is to be marked is stated."""
    text = "deck,load,load\ntime,place,force\n" + "".join(f"{k},{k},{k}\n" for k in range(9))
    assert "Put a # in front of line 2, or in front of line 1 if the names are in line 2" in str(complaint(tmp_path, text))
    assert read_table(write(tmp_path, "#" + text)).header == ("time", "place", "force")


@pytest.mark.parametrize("cells", ["ok,,7", "1;2,,ok", ",,", "1,2,x", "v1.2,0,1_0", '"a, b",,2', "1.234.5,1e400,inf"])
def test_columns_that_are_not_used_may_hold_anything(tmp_path: Path, cells: str) -> None:
    """Text, text between numbers, numbers in another form: the other columns are read, and the fault is stated when the
    column is used."""
    rows = [f"{k},{k / 2},{cells if k % 3 else '1,2,3'}" for k in range(12)]
    table = read_table(write(tmp_path, "t,z,a,b,c\n" + "\n".join(rows) + "\n"))
    assert column(table, "t").tolist() == list(range(12)) and column(table, "z")[3] == 1.5
    for name in table.defects:
        error = complaint(tmp_path, table.text or "", name)
        assert error.problems[0].place and error.problems[0].place.line == 3 and f"column '{name}'" in str(error)


@pytest.mark.parametrize("text", ["t,z\n0,1\n1\n", "t,z\n0,1\n1,2,3\n", "t\n0,1\n1,2\n", "rig\n0;1,5\n1;2,5\n",
                                  "12:00,1\n13:00,1,2\n14:00,1,2\n"])
def test_a_row_of_names_that_does_not_fit_is_no_setting(tmp_path: Path, text: str) -> None:
    assert complaint(tmp_path, text).problems[0].code in ("record-ragged", "record-header", "decimal-comma")


def test_columns_without_an_own_name_are_refused_when_they_are_used(tmp_path: Path) -> None:
    """Loggers call unused channels alike, and tables with a numbered first column leave its name out."""
    table = read_table(write(tmp_path, ",t,z,off,off\n0,0,1,5,6\n1,1,2,5,6\n"))
    assert column(table, "t").tolist() == [0, 1] and column(table, "z").tolist() == [1, 2]
    for name, why in (("off", "is the name of 2 columns (4, 5)"), ("", "column 1 has none")):
        with pytest.raises(DataError, match="Give each column a different name in the file") as caught:
            column(table, name)
        assert why in str(caught.value)


def test_commas_that_may_be_either_are_refused(tmp_path: Path) -> None:
    error = complaint(tmp_path, "t;z\n0.5;0,5\n1.5;0,6\n", "z")
    assert where(error) == [("decimal-comma", 2, 5), ("decimal-comma", 3, 5)]
    assert "'0,5' in column 'z' has a decimal comma; other numbers here may have decimal points" in str(error)
    assert "Export the table with decimal points" in str(error)
    assert "comma between thousands" in str(complaint(tmp_path, "t;z\n0;1,234\n1;1,301\n", "z"))
    assert column(read_table(write(tmp_path, "t;z\n0,5;1,234\n1;1,301\n")), "z").tolist() == [1.234, 1.301]
    assert where(complaint(tmp_path, "t;z\n0,5;1.234,5\n1;2\n", "z")) == [("record-thousands", 2, 5)]


def test_decimal_comma_between_commas(tmp_path: Path) -> None:
    error = complaint(tmp_path, "t,z\n0,00,0,5\n0,04,0,6\n")
    assert where(error) == [("decimal-comma", 2, 1)]
    assert "each row has 4 cells for 2 names" in str(error) and "'0,00'" in str(error)


@pytest.mark.parametrize(("text", "code", "line", "advice"), [
    ("", "record-empty", 1, "names the columns"),
    ("# nothing\n\n", "record-empty", 1, "names the columns"),
    ("t,z\n", "record-empty", 1, "names but no rows"),
    ("0,1\n1,2\n", "record-header", 1, "`time_s,heave_m`"),
    ("# t,z\n0,1\n1,2\n", "record-header", 2, "Remove the # in front of the names."),
    ("t,z\nbegin,middle\n0,1\n", "record-units-row", 2, "Put a # in front of line 2, or"),
    ("t  z\n0 1\n1 2\n", "record-separator", 1, "commas, semicolons or tabs"),
    ("t|z\n0|1\n1|2\n", "record-separator", 1, "commas, semicolons or tabs"),
])
def test_not_a_table(tmp_path: Path, text: str, code: str, line: int, advice: str) -> None:
    error = complaint(tmp_path, text)
    assert [(p.code, p.place.line) for p in error.problems if p.place] == [(code, line)]
    assert f"{tmp_path / 'train.csv'}:{line}" in str(error) and advice in str(error)


def test_what_is_no_text(tmp_path: Path) -> None:
    path = tmp_path / "train.csv"
    path.write_bytes(b"PK\x03\x04 a workbook under another name")
    with pytest.raises(DataError, match=r"is a workbook or an archive(.|\n)*save it as CSV"):
        read_table(path)
    path.write_bytes(b"t,z\n0,1\n\x81\x9d\n")  # neither UTF-8 nor letters of Windows-1252
    with pytest.raises(DataError, match=r"train\.csv:3: .*is not text(.|\n)*UTF-8\."):
        read_table(path)


def test_missing_file_lists_the_folder(tmp_path: Path) -> None:
    write(tmp_path, steady(), "train.csv")
    write(tmp_path, steady(), "validate.csv")
    asked = Place("rig.yaml", 4, 12, "  train: {file: trian.csv}", 9)
    with pytest.raises(DataError) as caught:
        read_table(tmp_path / "trian.csv", place=asked)
    text = str(caught.value)
    assert text.startswith("rig.yaml:4: there is no file 'trian.csv'")
    assert "files there: train.csv, validate.csv" in text and "Did you mean 'train.csv'?" in text
    with pytest.raises(DataError, match=r"there is no folder .*nowhere"):
        read_table(tmp_path / "nowhere" / "train.csv")
    with pytest.raises(DataError, match="is a folder"):
        read_table(tmp_path)


def test_unknown_suffix_lists_what_is_read(tmp_path: Path) -> None:
    wanted = r"'train\.xlsx'(.|\n)*\.csv, \.tsv(.|\n)*\.parquet(.|\n)*\.mat(.|\n)*Export it as CSV"
    with pytest.raises(UsageError, match=wanted):
        read_table(write(tmp_path, "", "train.xlsx"))


def test_unknown_column_and_text_column(tmp_path: Path) -> None:
    table = read_table(write(tmp_path, "clock,time_s,heave_m\n12:00,0,1\n12:01,1,2\n"))
    asked = Place("rig.yaml", 7, 30, "inputs: {heave.u: {column: heav_m, unit: m}}", 6)
    with pytest.raises(DataError) as caught:
        column(table, "heav_m", asked)
    text = str(caught.value)
    assert text.startswith("rig.yaml:7: 'train.csv' has no column 'heav_m'")
    assert "Did you mean 'heave_m'?" in text and "clock, time_s, heave_m" in text
    with pytest.raises(DataError, match=r"'clock' of 'train\.csv' holds text or dates(.|\n)*train\.csv:2"
                                        r"(.|\n)*dates are read as the times"):
        column(table, "clock")


def test_good_times_pass(tmp_path: Path) -> None:
    table = read_table(write(tmp_path, steady()))
    check_time(table, "time_s")
    jitter = "t\n" + "".join(f"{k * 0.04 + 0.001 * (-1) ** k:.7g}\n" for k in range(50))
    check_time(read_table(write(tmp_path, jitter)), "t")


def test_repeated_and_decreasing_times(tmp_path: Path) -> None:
    table = read_table(write(tmp_path, "t,z\n0,1\n1,1\n1,1\n2,1\n# run 2\n0,1\n1,1\n"))
    with pytest.raises(DataError) as caught:
        check_time(table, "t")
    assert where(caught.value) == [("record-time-repeated", 4, 1), ("record-time-decreasing", 7, 1)]
    assert "the time 1 in 't' (line 4) occurs twice" in str(caught.value)
    assert "the time 0 in 't' (line 7) is less than the one before it" in str(caught.value)
    assert "make it a separate record" in str(caught.value) and "one row per instant" in str(caught.value)


def test_rows_without_time_or_value(tmp_path: Path) -> None:
    """Two tables side by side, one longer than the other, leave empty cells at the end; that is no mistake."""
    table = read_table(write(tmp_path, "t,z,t_2,w\n0,1,0,5\n1,1,0.1,6\n2,1,,\n3,,,\n4,1,,\n"))
    check_time(table, "t_2")
    assert samples(table, "t", "z").tolist() == [0, 1, 2, 4]
    assert samples(table, "t_2", "w").tolist() == [0, 1]
    with pytest.raises(DataError) as caught:
        samples(table, "t_2", "z")
    assert where(caught.value) == [("record-time-missing", 4, 5)]
    assert "'z' has a value where 't_2' has none (lines 4, 6)" in str(caught.value)


def test_gaps(tmp_path: Path) -> None:
    times = np.array([0, 1, 2, 4, 5, 6.5, 7.5])
    assert gaps(times).tolist() == [2]  # 1.5 steps are still none
    assert gaps(times, 3).tolist() == [] and gaps(times[:1]).tolist() == []
    text = "t,z\n" + "".join(f"{k},{'' if 3 <= k <= 7 else 1}\n" for k in range(20) if k not in (12, 13, 14, 15, 16))
    table = read_table(write(tmp_path, text))
    rows = samples(table, "t", "z")
    with pytest.raises(DataError) as caught:
        check_gaps(table, "t", {"z": rows})
    assert where(caught.value) == [("record-gap", 10, 3), ("record-gap", 14, 4)]
    assert "'z' has no value between the times 2 (line 4) and 8 (line 10); elsewhere it has one every 1" in str(caught.value)
    assert "`gaps: bridge`" in str(caught.value) and "`from:`" in str(caught.value)
    check_gaps(table, "t", {"z": rows}, begin=8, end=11)
    many = read_table(write(tmp_path, "t,z\n" + "".join(f"{k},1\n" for k in range(300) if k % 20 > 6)))
    with pytest.raises(DataError) as caught:
        check_gaps(many, "t", {"z": samples(many, "t", "z")})
    assert len(caught.value.problems) == 5
    assert caught.value.problems[-1].notes == ("and 9 more such gaps in this file",)


def test_too_short(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"train\.csv:2: .*has 1 sample, it needs at least 2"):
        check_time(read_table(write(tmp_path, "t,z\n0,1\n")), "t")
    table = read_table(write(tmp_path, steady()))
    with pytest.raises(DataError, match="has 0 samples, it needs at least 2"):
        check_time(table.keep(column(table, "time_s") > 100), "time_s")


def test_missing_and_infinite_values(tmp_path: Path) -> None:
    z = ["1", "", "nan", "2", "NA", "-", "", "n/a", "null", "0"]
    table = read_table(write(tmp_path, "t,z,w,i\n" + "".join(f"{k},{cell},,{'inf' if k == 3 else k}\n"
                                                            for k, cell in enumerate(z))))
    assert samples(table, "t", "z").tolist() == [0, 3, 9]
    with pytest.raises(DataError, match=r"one beyond 1e\+100, in 1 of 10 rows \(line 5\)(.|\n)*Empty these cells"):
        samples(table, "t", "i")
    with pytest.raises(DataError, match=r"column 'w' of 'train.csv' has no number in any of its 10 rows"):
        samples(table, "t", "w")
    with pytest.raises(DataError, match=r"column 'z' of 'train.csv' has 3 numbers, at least 4 are needed"):
        samples(table, "t", "z", least=4)


def test_cut_keeps_line_numbers(tmp_path: Path) -> None:
    table = read_table(write(tmp_path, "t,z\n0,\n1,2\n2,3\n"))
    late = table.keep(column(table, "t") >= 1)
    assert late.lines.tolist() == [3, 4] and column(late, "z").tolist() == [2, 3]
    assert samples(late, "t", "z").tolist() == [0, 1]
    assert late.place(1, "z").line == 4


def test_parquet(tmp_path: Path) -> None:
    path = tmp_path / "train.parquet"
    holed = pd.array([1, None, 3], dtype="Int64")
    frame = pd.DataFrame({"t": [0.0, 1.0, 2.0], "n": holed, "who": ["a", "b", "c"]})
    frame.to_parquet(path)
    table = read_table(path)
    assert isinstance(table, Table) and table.header == ("t", "n", "who") and "who" not in table.columns
    np.testing.assert_array_equal(column(table, "n"), [1.0, np.nan, 3.0])
    assert samples(table, "t", "n").tolist() == [0, 2]
    frame.set_index("t").to_parquet(path)
    assert column(read_table(path), "t").tolist() == [0.0, 1.0, 2.0]
    with pytest.raises(DataError, match=r"other\.parquet' is not a Parquet file"):
        read_table(write(tmp_path, "t,z\n", "other.parquet"))


def test_parquet_without_its_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(_: Path) -> None:
        raise ImportError("Unable to find a usable engine")

    monkeypatch.setattr(pd, "read_parquet", absent)
    with pytest.raises(DataError, match=r"'train\.parquet' needs a library(.|\n)*pip install pyarrow"):
        read_table(write(tmp_path, "", "train.parquet"))


# -- MAT files -----------------------------------------------------------------------------------------------------
def mat(path: Path, content: dict[str, object], version: str = "5") -> Path:
    savemat(path, content, format=version, do_compression=version == "5")
    return path


@pytest.mark.parametrize("version", ["4", "5"])
def test_mat_variables_are_columns(tmp_path: Path, version: str) -> None:
    t = np.arange(5) / 10
    table = read_table(mat(tmp_path / "train.mat", {"t": t, "z": t[:, None] ** 2, "F": (3 * t)[None, :]}, version))
    assert table.header == ("t", "z", "F")
    np.testing.assert_array_equal(column(table, "z"), t**2)
    np.testing.assert_array_equal(column(table, "F"), 3 * t)
    assert table.lines_of([1, 2]) == "rows 2, 3" and table.place(1, "z").line == 2


def test_mat_structs_matrices_and_kinds_of_numbers(tmp_path: Path) -> None:
    n = np.arange(4)
    log = {"time": n / 2.0, "signals": {"values": np.stack([n, 2 * n], axis=1).astype(np.int16), "label": "foot"}}
    table = read_table(mat(tmp_path / "train.mat", {"log": log, "on": n > 1, "note": "sea state 4", "gain": 2.5}),
                       beside="log.time")
    assert column(table, "log.signals.values.2").tolist() == [0, 2, 4, 6]
    assert column(table, "on").tolist() == [0, 0, 1, 1]
    for name, said in (("note", "holds text, not numbers"), ("gain", "is a single number; a column is a vector"),
                       ("log.signals.label", "holds text")):
        with pytest.raises(DataError, match=f"'{name}' of 'train.mat' {said}"):
            column(table, name)


def test_mat_vectors_of_other_lengths_have_their_own_time(tmp_path: Path) -> None:
    path = mat(tmp_path / "train.mat", {"t": np.arange(8.0), "z": np.arange(8.0), "t_2": np.arange(3.0), "w": np.ones(3)})
    assert read_table(path).columns.keys() == {"t", "z"}
    assert read_table(path, beside="t_2").columns.keys() == {"t_2", "w"}
    with pytest.raises(DataError, match=r"'w' of 'train.mat' has 3 values, 't' has 8(.|\n)*Give its time column"):
        column(read_table(path, beside="t"), "w")


def test_mat_objects_are_told_and_not_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An object of MATLAB (timeseries, timetable) as the reader hands it out: name, kind and class, no numbers."""
    import scipy.io
    from scipy.io.matlab import MatlabOpaque

    kinds = [("s0", "O"), ("s1", "O"), ("s2", "O"), ("arr", "O")]
    opaque = MatlabOpaque(np.array([(b"heave", b"MCOS", b"timeseries", np.zeros(6))], dtype=kinds))
    monkeypatch.setattr(scipy.io, "loadmat", lambda *_, **__: {"__globals__": [], "t": np.arange(3.0), "None": opaque})
    table = read_table(write(tmp_path, "", "train.mat"))
    with pytest.raises(DataError, match=r"'heave' of 'train.mat' is a MATLAB timeseries(.|\n)*t = heave.Time;"):
        column(table, "heave")


def test_mat_that_cannot_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(DataError, match=r"'train.mat' is not a MAT file that can be read"):
        read_table(write(tmp_path, "t,z\n0,1\n", "train.mat"))
    whole = mat(tmp_path / "cut.mat", {"t": np.random.default_rng(0).random(1000)}).read_bytes()
    (tmp_path / "cut.mat").write_bytes(whole[:len(whole) // 2])
    with pytest.raises(DataError, match=r"'cut.mat' is not a MAT file that can be read"):
        read_table(tmp_path / "cut.mat")
    with pytest.raises(DataError, match=r"'words.mat' has no vector of numbers(.|\n)*note holds text"):
        read_table(mat(tmp_path / "words.mat", {"note": "nothing"}))
    # version 7.3 is another kind of file altogether
    (tmp_path / "new.mat").write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM" + bytes(600))
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(DataError, match=r"'new.mat' is a MAT file of version 7.3(.|\n)*pip install h5py(.|\n)*-v7"):
        read_table(tmp_path / "new.mat")


def test_mat_of_version_7_3(tmp_path: Path) -> None:
    path = tmp_path / "train.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values, kind in (("t", np.arange(4.0)[None, :], "double"), ("log/z", np.arange(4)[None, :], "int32"),
                                   ("note", np.array([[72], [105]], dtype=np.uint16), "char"),
                                   ("heave", np.zeros((1, 6), dtype=np.uint32), "timeseries")):
            file[name] = values
            file[name].attrs["MATLAB_class"] = np.bytes_(kind)
        file["log"].attrs["MATLAB_class"] = np.bytes_("struct")
        file["elsewhere"] = h5py.ExternalLink(str(tmp_path / "other.mat"), "/t")
    path.write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM" + path.read_bytes()[128:])
    table = read_table(path, beside="t")
    assert table.columns.keys() == {"t", "log.z"} and column(table, "log.z").tolist() == [0, 1, 2, 3]
    assert "elsewhere" not in table.header
    with pytest.raises(DataError, match=r"'heave' of 'train.mat' is a MATLAB timeseries"):
        column(table, "heave")
