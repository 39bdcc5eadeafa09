"""Reading records: what is accepted, and that each complaint names file, line and what to do."""

from pathlib import Path

import numpy as np
import pytest

from heavebond.errors import DataError, HeavebondError, Place, UsageError
from heavebond.measurements import Table, check_time, check_values, column, read_table


def write(folder: Path, text: str, name: str = "train.csv") -> Path:
    path = folder / name
    path.write_bytes(text.encode())
    return path


def complaint(folder: Path, text: str) -> DataError:
    with pytest.raises(DataError) as caught:
        read_table(write(folder, text))
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
    error = complaint(tmp_path, "t,z,z\n0,1,2\n1,x1,3\n2,4\n3,5,6,7\n4,8,9\n")
    assert where(error) == [("record-column-twice", 1, 5), ("record-text", 3, 3), ("record-ragged", 4, 4),
                            ("record-ragged", 5, 7)]
    text = str(error)
    assert f"{tmp_path / 'train.csv'}:3: 'x1' in column 'z' is not a number" in text
    assert "    3 | 1,x1,3\n      |   ^^" in text
    assert "this row has 2 cells, the row of names has 3" in text
    assert "two columns are called 'z' (columns 2 and 3)" in text
    assert "Write a number, or delete the row." in text
    assert "separated by commas" in text


def test_many_of_a_kind_are_counted(tmp_path: Path) -> None:
    bad = complaint(tmp_path, "t,z\n" + "".join(f"{k},{'oops' if 3 <= k < 23 else k}\n" for k in range(30)))
    assert where(bad) == [("record-text", k, 3) for k in (5, 6, 7, 8, 9)]
    assert [p.notes for p in bad.problems][3:] == [(), ("and 15 more such cells in this file",)]
    ragged = complaint(tmp_path, "t,z\n0,1\n" + "7\n" * 6 + "1,1\n")
    assert where(ragged) == [("record-ragged", k, 2) for k in (3, 4, 5, 6, 7)]
    assert ragged.problems[-1].notes == ("and 1 more such rows in this file",)
    five = complaint(tmp_path, "t,z\n0,1\n" + "7\n" * 5)
    assert len(five.problems) == 5 and not any(p.notes for p in five.problems)


def test_decimal_comma_says_so(tmp_path: Path) -> None:
    error = complaint(tmp_path, "t;z\n0;0,5\n0,04;0,6\n")
    assert where(error) == [("decimal-comma", 2, 3), ("decimal-comma", 3, 1), ("decimal-comma", 3, 6)]
    assert "'0,5' in column 'z' has a decimal comma" in str(error)
    assert "Export the table with decimal points." in str(error)


def test_places_behind_quoted_separators(tmp_path: Path) -> None:
    error = complaint(tmp_path, 'who,z,t\n"x, y",oops,0\n"u",1,"0,5"\n')
    assert where(error) == [("record-text", 2, 8), ("decimal-comma", 3, 7)]


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
    ("t,,z\n0,1,2\n", "record-header", 1, "column 2 has no name"),
    ("t,z\ns,m\n0,1\n", "record-units-row", 2, "Put a # in front of this line"),
    ("t  z\n0 1\n1 2\n", "record-separator", 1, "commas, semicolons or tabs"),
])
def test_not_a_table(tmp_path: Path, text: str, code: str, line: int, advice: str) -> None:
    error = complaint(tmp_path, text)
    assert [(p.code, p.place.line) for p in error.problems if p.place] == [(code, line)]
    assert f"{tmp_path / 'train.csv'}:{line}" in str(error) and advice in str(error)


def test_encoding(tmp_path: Path) -> None:
    path = tmp_path / "train.csv"
    path.write_bytes("t,z\n0,1\n# 20 °C\n".encode("latin-1"))
    with pytest.raises(DataError, match=r"train\.csv:3: .*not UTF-8(.|\n)*UTF-8\."):
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
    wanted = r"'train\.mat'(.|\n)*\.csv, \.tsv(.|\n)*\.parquet(.|\n)*Export it as CSV"
    with pytest.raises(UsageError, match=wanted):
        read_table(write(tmp_path, "", "train.mat"))


def test_unknown_column_and_text_column(tmp_path: Path) -> None:
    table = read_table(write(tmp_path, "clock,time_s,heave_m\n12:00,0,1\n12:01,1,2\n"))
    asked = Place("rig.yaml", 7, 30, "inputs: {heave.u: {column: heav_m, unit: m}}", 6)
    with pytest.raises(DataError) as caught:
        column(table, "heav_m", asked)
    text = str(caught.value)
    assert text.startswith("rig.yaml:7: 'train.csv' has no column 'heav_m'")
    assert "Did you mean 'heave_m'?" in text and "clock, time_s, heave_m" in text
    with pytest.raises(DataError, match=r"'clock' of 'train\.csv' holds text or dates(.|\n)*train\.csv:2"
                                        r"(.|\n)*seconds since the start"):
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
    assert "the time 1 in 't' stands twice (line 4)" in str(caught.value)
    assert "the time 0 in 't' is less than the one before it (line 7)" in str(caught.value)
    assert "two runs are two records" in str(caught.value)


def test_missing_time_is_no_gap(tmp_path: Path) -> None:
    table = read_table(write(tmp_path, "t,z\n0,1\n1,1\nnan,1\n2,1\n3,1\n"))
    with pytest.raises(DataError) as caught:
        check_time(table, "t")
    assert where(caught.value) == [("record-value", 4, 1)]


def test_gaps(tmp_path: Path) -> None:
    table = read_table(write(tmp_path, "t,z\n0,1\n1,1\n2,1\n4,1\n5,1\n6.5,1\n7.5,1\n"))
    with pytest.raises(DataError) as caught:
        check_time(table, "t")
    assert where(caught.value) == [("record-gap", 5, 1)]  # 1.5 steps are still none
    text = str(caught.value)
    assert "'t' goes from 2 (line 4) to 4 (line 5), where a step is 1" in text
    assert "`gaps: ok`" in text and "`from:`" in text
    check_time(table, "t", gaps_ok=True)
    check_time(table, "t", max_gap=2)
    with pytest.raises(DataError) as caught:
        check_time(table, "t", max_gap=1)
    assert [line for _, line, _ in where(caught.value)] == [5, 7]
    many = read_table(write(tmp_path, "t\n" + "".join(f"{k}\n" for k in range(60) if k % 7 or k > 55)))
    with pytest.raises(DataError) as caught:
        check_time(many, "t")
    assert len(caught.value.problems) == 5
    assert caught.value.problems[-1].notes == ("and 2 more such gaps in this file",)


def test_too_short(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"train\.csv:2: .*has 1 sample, it needs at least 2"):
        check_time(read_table(write(tmp_path, "t,z\n0,1\n")), "t")
    table = read_table(write(tmp_path, steady()))
    with pytest.raises(DataError, match="has 0 samples, it needs at least 2"):
        check_time(table.keep(column(table, "time_s") > 100), "time_s")


def test_missing_and_infinite_values(tmp_path: Path) -> None:
    z = ["1", "", "nan", "inf", "NA", "-", "", "n/a", "null", "0"]
    table = read_table(write(tmp_path, "t,z,w\n" + "".join(f"{k},{cell},\n" for k, cell in enumerate(z))))
    with pytest.raises(DataError) as caught:
        check_values(table, ["t", "z"])
    assert where(caught.value) == [("record-value", 3, 3), ("record-value", 5, 3)]
    text = str(caught.value)
    assert "'z' has no value in 7 of 10 rows (lines 3, 4, 6, 7, 8 and 2 more)" in text
    assert "'z' has an infinite value in 1 of 10 rows (line 5)" in text
    assert "`from:` and `to:`" in text
    check_values(table, ["t"])  # what is not used may be empty


def test_cut_keeps_line_numbers(tmp_path: Path) -> None:
    table = read_table(write(tmp_path, "t,z\n0,\n1,2\n2,3\n"))
    late = table.keep(column(table, "t") >= 1)
    assert late.lines.tolist() == [3, 4] and column(late, "z").tolist() == [2, 3]
    check_values(late, ["z"])
    assert late.place(1, "z").line == 4


def test_parquet(tmp_path: Path) -> None:
    pd = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    path = tmp_path / "train.parquet"
    holed = pd.array([1, None, 3], dtype="Int64")
    frame = pd.DataFrame({"t": [0.0, 1.0, 2.0], "n": holed, "who": ["a", "b", "c"]})
    frame.to_parquet(path)
    table = read_table(path)
    assert isinstance(table, Table) and table.header == ("t", "n", "who") and "who" not in table.columns
    np.testing.assert_array_equal(column(table, "n"), [1.0, np.nan, 3.0])
    with pytest.raises(DataError, match=r"train\.parquet:2: 'n' has no value in 1 of 3 rows \(row 2\)"):
        check_values(table, ["n"])
    frame.set_index("t").to_parquet(path)
    assert column(read_table(path), "t").tolist() == [0.0, 1.0, 2.0]
    with pytest.raises(DataError, match=r"other\.parquet' is not a Parquet file"):
        read_table(write(tmp_path, "t,z\n", "other.parquet"))


def test_parquet_without_its_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pd = pytest.importorskip("pandas")

    def absent(_: Path) -> None:
        raise ImportError("Unable to find a usable engine")

    monkeypatch.setattr(pd, "read_parquet", absent)
    with pytest.raises(DataError, match=r"'train\.parquet' needs a library(.|\n)*pip install pyarrow"):
        read_table(write(tmp_path, "", "train.parquet"))
