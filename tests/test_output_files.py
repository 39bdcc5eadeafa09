"""Files for the user are written whole or not at all."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from collected import partly

import heavebond as hb
from heavebond.core.writable import new_file, write_text
from heavebond.records.saved_runs import SUFFIXES, SavedRun, write_run

SOURCE = Path(hb.__file__).parent
# what these write is read by themselves, in a temporary folder
OWN = {"exchange/fmu_export.py", "language/external_functions.py", "laws/find.py", "localise/ltv_model.py",
       "numerics/compiled_cvodes.py", "numerics/solvers.py"}
APPENDED = {"core/kept_lines.py"}  # line by line, each complete by itself
IN_MEMORY = {"reports/notebook.py"}  # a picture that a notebook shows
WRITERS = re.compile(r"\.write_text\(|\.write_bytes\(|open\([^)\n]*[\"'][wxa]b?[\"']|\.to_csv\(|\.to_parquet\(|savemat\(|"
                     r"netcdf_file\([^)]*\"w\"|savefig\(|\.savez?\(|savetxt\(|ZipFile\([^)]*\"w\"|writer\.saving\(")


def test_every_writer_writes_to_a_new_file_that_is_renamed() -> None:
    """A module that writes does so inside `new_file`, or is called with its path."""
    called = {"pictures/film.py": "pictures/animation.py"}
    writing = {path.relative_to(SOURCE).as_posix(): path.read_text(encoding="utf-8") for path in SOURCE.rglob("*.py")
               if WRITERS.search(path.read_text(encoding="utf-8"))}
    assert {"pictures/plot.py", "records/saved_runs.py", "exchange/fmu_export.py", "studies/tables.py"} <= set(writing)
    for name, text in writing.items():
        if name in APPENDED:
            continue
        if name in IN_MEMORY:
            assert "io.BytesIO()" in text and "open(" not in text
            continue
        text = (SOURCE / called[name]).read_text(encoding="utf-8") if name in called else text
        for found in WRITERS.finditer(text):
            assert "new_file(" in text or name in OWN or found.group().startswith(".save("), f"{name}: {found.group()}"
            assert not found.group().startswith(".write_text(") or name in OWN, name


def test_what_stood_there_is_kept_where_writing_fails(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text("old")

    def fail() -> None:
        with new_file(path) as fresh:
            fresh.write_text("half of it")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert path.read_text() == "old" and os.listdir(tmp_path) == ["table.csv"]
    with new_file(path) as fresh:
        fresh.write_text("new")
        assert path.read_text() == "old" and fresh.suffix == ".csv"
    assert path.read_text() == "new" and os.listdir(tmp_path) == ["table.csv"]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="a limit for files, as a full disk, is set by POSIX means")
@pytest.mark.parametrize("suffix", partly(SUFFIXES, 4))
def test_a_full_disk_leaves_the_old_file(suffix: str, tmp_path: Path) -> None:
    """The size of files is limited in a process of its own: what is too long ends there as on a full disk."""
    times = np.linspace(0, 1, 3000)
    path = tmp_path / f"run{suffix}"
    write_run(SavedRun("m", times[:5], {"x": times[:5]}, {"x": "m"}), path)
    before = path.read_bytes()
    script = f"""
import resource, signal, sys, numpy as np
from heavebond.records.saved_runs import SavedRun, write_run
import pandas, scipy.io, pyarrow.parquet
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (9000, 9000))
times = np.random.default_rng(1).random(3000)
try:
    write_run(SavedRun("m", times, {{"x": times}}, {{"x": "m"}}), {str(path)!r})
except OSError as error:
    sys.exit(7)
"""
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 7
    assert path.read_bytes() == before and os.listdir(tmp_path) == [path.name]


def test_links_modes_and_devices_are_respected(tmp_path: Path) -> None:
    real, link = tmp_path / "real.json", tmp_path / "link.json"
    real.write_text("old")
    real.chmod(0o640)
    link.symlink_to(real)
    write_text(link, "new\n")
    assert link.is_symlink() and real.read_text() == "new\n" and real.stat().st_mode & 0o777 == 0o640
    write_text(os.devnull, "gone")
    assert not Path(os.devnull).is_file()
    with pytest.raises(FileExistsError):
        write_text(real, "other", exclusive=True)
    with pytest.raises(FileNotFoundError, match=r"none/x\.json"):
        write_text(tmp_path / "none" / "x.json", "")
    umask = os.umask(0o027)
    try:
        write_text(tmp_path / "fresh.json", "")
    finally:
        os.umask(umask)
    assert (tmp_path / "fresh.json").stat().st_mode & 0o777 == 0o640
    assert sorted(os.listdir(tmp_path)) == ["fresh.json", "link.json", "real.json"]
