"""Runs as files: what is written is read back to the last digit, by heavebond and by the tools that own the formats."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import heavebond as hb
from heavebond.records.saved_runs import SUFFIXES, SavedRun, identifiers, write_run

MODEL = """
model: pair
components:
  wall:   {is: Fixed}
  spring: {is: Spring, c: 2 kN/m}
  cart:   {is: Mass, m: 3 kg}
  tank:   {is: Tank}
  oil:    {is: Volume, V: 1 L, beta: 1.5 GPa}
  pump:   {is: FlowSource, u: 1 L/min}
  leak:   {is: Orifice, q_r: 1 L/min, dp_r: 1 bar}
nodes:
  wall: [wall.a, spring.a]
  cart: [spring.b, cart.a]
  oil:  [oil.a, pump.a, leak.a]
  back: [leak.b, tank.a]
initial: {cart.x: 10 mm, cart.v: 0 m/s}
show:
  pull:  {is: spring.F, unit: kN}
  share: {is: oil.p/1 bar, unit: "%"}
simulate: {until: 0.5 s, every: 10 ms}
"""


@pytest.fixture(scope="module")
def run() -> hb.Result:
    return hb.simulate(hb.loads(MODEL))


def test_the_page_lists_the_formats() -> None:
    page = (Path(__file__).parent.parent / "docs" / "exchange.md").read_text(encoding="utf-8")
    assert [suffix for suffix in SUFFIXES if f"| `{suffix}` |" not in page] == []


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_run_is_read_back_as_it_was(run: hb.Result, suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"pair{suffix}"
    run.save(path)
    back = hb.read_run(path)
    assert back.model == "pair"
    assert back.solver == ("" if suffix == ".csv" else "cvodes (no algebraic unknowns)")
    assert np.array_equal(back.time, run.time)
    assert back.names() == run.saved().names()
    assert {"pull", "share", "cart.x", "pump.a.q"} <= set(back.names())
    for name in back.names():
        assert np.array_equal(back.display[name], run.display[name]), name
        assert back.unit(name) == run.unit(name)
    assert (back.unit("pull"), back.unit("share"), back.unit("pump.a.q")) == ("kN", "%", "m**3/s")


def test_chosen_signals_and_formulas(run: hb.Result, tmp_path: Path) -> None:
    chosen = ["cart.x", "spring.F/spring.c", "spring.F*cart.v"]
    for suffix in SUFFIXES:
        run.save(tmp_path / f"some{suffix}", chosen)
        back = hb.read_run(tmp_path / f"some{suffix}")
        assert back.names() == chosen
        assert [back.unit(name) for name in chosen] == ["m", "m", run.unit(chosen[2])]


def test_the_formats_are_those_of_their_own_tools(run: hb.Result, tmp_path: Path) -> None:
    from scipy.io import loadmat, netcdf_file

    for suffix in SUFFIXES:
        run.save(tmp_path / f"r{suffix}")
    assert pd.read_csv(tmp_path / "r.csv")["pull [kN]"].iloc[0] == run.display["pull"][0]
    assert pd.read_parquet(tmp_path / "r.parquet")["pull [kN]"].iloc[0] == run.display["pull"][0]
    mat = loadmat(tmp_path / "r.mat")
    assert mat["cart_x"][0, 0] == run["cart.x"][0]
    assert mat["units"][list(mat["variables"].ravel()).index("pull"), 0].item() == "kN"
    with netcdf_file(str(tmp_path / "r.nc"), mmap=False) as file:
        assert file.variables["cart.x"].units == b"m"
        assert file.variables["cart.x"].dimensions == ("time",)


@pytest.mark.parametrize("suffix", [".csv", ".mat", ".parquet"])
def test_a_saved_run_serves_as_a_record(run: hb.Result, suffix: str, tmp_path: Path) -> None:
    from heavebond.records.measurements import read_table

    run.save(tmp_path / f"r{suffix}")
    table = read_table(tmp_path / f"r{suffix}", beside="time" if suffix == ".mat" else None)
    column = "cart_x" if suffix == ".mat" else "cart.x [m]"
    assert np.array_equal(table.columns[column], run["cart.x"])


def test_names_become_variables_that_matlab_knows() -> None:
    names = ["crown.x", "crown_x", "time", "p[2].q", "2*a", "a" * 80, "a" * 81]
    found = identifiers(names)
    assert found[:5] == ["crown_x", "crown_x_2", "time_2", "p_2_q", "s_2_a"]
    assert all(name.isidentifier() and len(name) <= 63 for name in found)
    assert len(set(found)) == len(names)


@pytest.mark.parametrize(("name", "content", "said"), [
    ("a.csv", "t,x\n0,1\n", "first column"), ("b.csv", "time [s],x,rows left [1]\n0,1,0\n", "'x' has no unit"),
    ("c.csv", "", "columns"),
    ("d.mat", "nonsense", ""), ("e.nc", "nonsense", ""), ("f.parquet", "nonsense", ""),
])
def test_other_files_are_refused(name: str, content: str, said: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(hb.DataError, match="run-unreadable") as caught:
        hb.read_run(tmp_path / name)
    assert said in str(caught.value)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_file_that_was_cut_off_is_not_read_as_a_whole_run(suffix: str, tmp_path: Path) -> None:
    """Every place of a small file: within numbers, between rows and variables, before the last byte."""
    times = np.arange(8) / 7
    write_run(SavedRun("m", times, {"a.x": np.cos(times), "b.F": 1e5 * times}, {"a.x": "m", "b.F": "N"}, "idas"),
              tmp_path / f"whole{suffix}")
    whole = (tmp_path / f"whole{suffix}").read_bytes()
    cut = tmp_path / f"cut{suffix}"
    # the line feed behind the last row of a text may be missing
    places = range(len(whole) - (suffix == ".csv"))
    for size in places if len(whole) < 2500 else [*places[:1200:7], *places[-1200:]]:
        cut.write_bytes(whole[:size])
        with pytest.raises(hb.DataError, match=r"run-unreadable|record-cut-off"):
            hb.read_run(cut)


def test_a_number_cut_at_the_end_of_a_csv_file_is_refused(tmp_path: Path) -> None:
    run = SavedRun("m", np.arange(3.0), {"x": np.array([0.1, 0.2, 0.026615332])}, {"x": "m"})
    write_run(run, tmp_path / "run.csv")
    text = (tmp_path / "run.csv").read_text()
    (tmp_path / "run.csv").write_text(text[:text.index("0.026615") + 8])
    with pytest.raises(hb.DataError, match="record-cut-off"):
        hb.read_run(tmp_path / "run.csv")


def test_a_cut_run_is_refused_as_a_record_too(run: hb.Result, tmp_path: Path) -> None:
    from heavebond.records.measurements import read_table

    run.save(tmp_path / "r.csv", ["cart.x"])
    lines = (tmp_path / "r.csv").read_text().splitlines()
    for kept, said in ((lines[:-1], "ends before its last row"), (lines[:9] + lines[10:], "lacks rows before line 10")):
        (tmp_path / "r.csv").write_text("\n".join(kept) + "\n")
        for read in (hb.read_run, read_table):
            with pytest.raises(hb.DataError, match=said):
                read(tmp_path / "r.csv")


def test_a_mat_file_of_something_else(tmp_path: Path) -> None:
    from scipy.io import savemat

    savemat(tmp_path / "x.mat", {"time": np.arange(3.0)})
    with pytest.raises(hb.DataError, match="no variable 'model'"):
        hb.read_run(tmp_path / "x.mat")


def test_messages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = SavedRun("m", np.zeros(2), {"crown.x": np.ones(2)}, {"crown.x": "m"})
    with pytest.raises(hb.UsageError, match=r"\.csv, \.parquet, \.mat or \.nc"):
        write_run(run, tmp_path / "run.xlsx")
    write_run(run, tmp_path / "run.csv")
    with pytest.raises(hb.UsageError, match=r"Did you mean 'run\.csv'"):
        hb.read_run(tmp_path / "rum.csv")
    with pytest.raises(hb.UsageError, match=r"Did you mean 'crown\.x'"):
        hb.read_run(tmp_path / "run.csv")["crown.z"]
    write_run(run, tmp_path / "run.parquet")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    for act in (lambda: write_run(run, tmp_path / "run.parquet"), lambda: hb.read_run(tmp_path / "run.parquet")):
        with pytest.raises(hb.UsageError, match=r"heavebond\[parquet\]"):
            act()
