"""Faults of the input and of the environment are not called faults of heavebond; what processes leave and hand over."""

from __future__ import annotations

import gzip
import os
import pickle
import subprocess
import sys
import threading
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import heavebond as hb
from heavebond.cli import lacks_memory
from heavebond.core.errors import HeavebondError
from heavebond.core.limits import EXPANDED, SYMBOL_BYTES
from heavebond.core.writable import new_file, write_text
from heavebond.equations.expand import expand
from heavebond.import_20sim.emx_file import read_emx
from heavebond.text.yaml_source import parse, read_text

MAIN = "from heavebond.cli import main; main()"


def _code(work: object, *words: object) -> str:
    with pytest.raises(HeavebondError) as caught:
        work(*words)  # type: ignore[operator]
    assert caught.value.problems[0].place is not None
    return caught.value.problems[0].code


@pytest.mark.parametrize("escape", [r"\0", r"\x00", r"\u0000", r"\uD800", r"\uDFFF", r"\uD83D\uDE00"])
@pytest.mark.parametrize("line", ['extends: "a{}.yaml"', 'records: {{a: {{file: "x{}.csv"}}}}', '"a{}": 1', 'set: ["{}"]'])
def test_half_a_character_or_a_nul_in_a_text_is_a_mistake_in_the_file(line: str, escape: str) -> None:
    assert _code(parse, "model: a\n" + line.format(escape) + "\n") == "not-text"


def test_other_escapes_are_read() -> None:
    assert parse('model: "\\t\\x07\\u2028\\U0001F600"').root.items["model"].text == "\t\x07\u2028\U0001F600"  # type: ignore[union-attr]


@pytest.mark.parametrize("encoding", ["no-such", "base64", "rot13", "shift_jis", "utf-7", "utf-16"])
def test_an_unknown_encoding_of_an_emx_file_is_a_mistake_in_the_file(encoding: str, tmp_path: Path) -> None:
    path = tmp_path / "a.emx"
    path.write_bytes(f'<?xml version="1.0" encoding="{encoding}"?>\n<a/>'.encode())
    assert _code(read_emx, path) == "emx-xml"


def test_a_wrong_backend_of_matplotlib_does_not_end_a_command() -> None:
    code = "from heavebond.cli import main\ntry:\n main(['--version'])\nexcept SystemExit:\n pass\nimport matplotlib.figure"
    done = subprocess.run([sys.executable, "-c", code], env={**os.environ, "MPLBACKEND": "nonsense"}, capture_output=True,
                          text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.skipif(sys.platform != "linux", reason="a limit of the memory of a process is set by Linux's means")
def test_too_little_memory_while_importing_is_said(tmp_path: Path) -> None:
    limit = "import resource; resource.setrlimit(resource.RLIMIT_AS, (150 << 20, 150 << 20)); "
    done = subprocess.run([sys.executable, "-c", limit + MAIN, "run", "quarter_car"], cwd=tmp_path, capture_output=True,
                          text=True, check=False, env={**os.environ, "HEAVEBOND_PROGRESS": "0"})
    # the linear algebra library ends the process by itself if its own allocation is the one that fails
    assert done.returncode == 1 and ("[memory]" in done.stderr or "Memory allocation" in done.stderr), done.stderr


def test_exceptions_that_stand_for_too_little_memory() -> None:
    assert lacks_memory(MemoryError()) and lacks_memory(OSError(12, "Cannot allocate memory"))
    assert lacks_memory(ImportError("libcasadi.so.3.7: failed to map segment from shared object"))
    error = RuntimeError("numpy cannot be imported")
    error.__cause__ = ImportError("x.so: cannot allocate memory in static TLS block")
    assert lacks_memory(error) and not lacks_memory(ImportError("no module named numpy"))


# -- the size of what a diagram expands to -------------------------------------------------------------------------------
def _nested(folder: Path, levels: int, width: int) -> hb.Model:
    """Blocks of `width` blocks each, `levels` deep, with masses in the innermost."""
    names = "pqrs"[:width]
    for k in range(levels):
        part = f"{{is: Level{k - 1}}}" if k else "{is: Mass, m: 1 kg}"
        parts = "".join(f"  {name}: {part}\n" for name in names)
        ends = ", ".join(f"{name}.a" for name in names)
        (folder / f"level{k}.yaml").write_text(f"component: Level{k}\nsummary: A block.\nports: {{a: translational}}\n"
                                               f"components:\n{parts}nodes:\n  n: [a, {ends}]\n")
    (folder / "deep.yaml").write_text(f"model: deep\ncomponents:\n  d: {{is: Level{levels - 1}}}\nnodes: {{n: [d.a]}}\n")
    return hb.load(folder / "deep.yaml")


def test_blocks_in_blocks_end_at_a_limit_while_they_are_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """4**14 masses would take some 100 GB; the limit is lowered so that the test is short."""
    monkeypatch.setattr("heavebond.equations.expand.EXPANDED", 5000)
    assert _code(expand, _nested(tmp_path, 14, 4)) == "diagram-too-large"
    assert len(expand(_nested(tmp_path, 3, 4)).leaves) == 1 + 4 + 16 + 64


def test_the_limit_is_checked_before_a_matrix_is_written_out(tmp_path: Path) -> None:
    model = hb.loads("model: wide\ncomponents: {g: {is: CField, n: 9000}}\nnodes: {n: [g.a]}\n", tmp_path)
    assert EXPANDED < 9000**2 and _code(expand, model) == "diagram-too-large"


def test_a_symbol_of_megabytes_is_refused(tmp_path: Path) -> None:
    (tmp_path / "symbols").mkdir()
    marks = '<path d="M0 0"/>' * (SYMBOL_BYTES // 16)
    head = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 40 40">'
    (tmp_path / "symbols" / "big.svg").write_text(f"{head}{marks}</svg>")
    (tmp_path / "big.yaml").write_text("component: Big\nsummary: A part.\nsymbol: big\nports: {a: translational}\n"
                                       "equations: |\n  a.f = 0\n")
    from heavebond.language.library import library
    from heavebond.pictures.pictograms import symbol

    assert _code(symbol, library([tmp_path]).component("Big")) == "symbol-bad"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes are made by POSIX means")
def test_a_text_from_a_pipe_ends_at_the_limit_of_a_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")

    def write() -> None:
        with open(tmp_path / "pipe", "w") as pipe:
            pipe.write("model: a\r\n")

    threading.Thread(target=write, daemon=True).start()
    assert read_text(tmp_path / "pipe") == "model: a\n"
    with pytest.raises(HeavebondError, match="larger than"):
        read_text(Path("/dev/zero"))


# -- unfinished files ----------------------------------------------------------------------------------------------------
KILLED = """
import os, signal
from heavebond.core.writable import new_file
with new_file("table.csv") as fresh:
    fresh.write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="unfinished files are told from others by POSIX locks")
def test_an_unfinished_file_of_a_killed_process_is_removed_by_the_next_write(tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-c", KILLED], cwd=tmp_path, check=False)
    assert len(os.listdir(tmp_path)) == 1
    mine = tmp_path / ".notes.12345678.new"  # of the user: a link, which is never followed
    mine.symlink_to("elsewhere")
    with new_file(tmp_path / "other.csv") as fresh:  # unfinished, and in use
        fresh.write_text("1")
        assert sorted(os.listdir(tmp_path)) == sorted([fresh.name, mine.name])
        write_text(tmp_path / "third.csv", "3")
        assert fresh.exists()
    assert sorted(os.listdir(tmp_path)) == [mine.name, "other.csv", "third.csv"]


# -- pickling ------------------------------------------------------------------------------------------------------------
MODEL = """
model: bouncing
components:
  wall: {is: Fixed}
  spring: {is: Spring, c: 1 kN/m}
  load: {is: Mass, m: 1 kg}
nodes:
  a: [wall.a, spring.a]
  b: [spring.b, load.a]
initial: {b.x: 1 mm, b.v: 0 m/s}
simulate: {until: 0.5 s, every: 5 ms}
"""


def _last(assembly: hb.Assembly) -> float:
    return float(hb.simulate(assembly)["b.x"][-1])


def test_an_assembly_and_a_run_can_be_pickled(tmp_path: Path) -> None:
    assembly = hb.assemble(hb.loads(MODEL, tmp_path)).with_parameters({"load.m": 2.0})
    run = hb.simulate(assembly)
    other_assembly, other = pickle.loads(pickle.dumps((assembly, run)))
    assert other_assembly is not assembly and other_assembly.parameter_values == assembly.parameter_values
    assert other.verdict.text == run.verdict.text
    for name in run.names():
        assert np.array_equal(other[name], run[name])
        assert other.figures([name]) == run.figures([name])
    with ProcessPoolExecutor(1) as pool:
        assert pool.submit(_last, assembly).result() == _last(assembly)


@pytest.mark.parametrize(("content", "code", "words"), [
    (gzip.compress(b"<Document/>"), "emx-binary", "it is compressed by gzip"),
    (b"PK\x03\x04" + bytes(60), "emx-binary", "it is a ZIP archive"),
    (bytes((71 * k * k + 13 * k) % 256 for k in range(1000)), "emx-binary", "it may be encrypted or compressed"),
    (b"parameters\n  real c = 1;\nequations\n  p.e = c*p.f;\n", "emx-xml", "it does not begin as XML"),
    (b"", "emx-xml", "it is empty")], ids=["gzip", "zip", "random", "text", "empty"])  # gzip writes the time
def test_a_compressed_or_encrypted_emx_file_is_named_as_that(content: bytes, code: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "a.emx"
    path.write_bytes(content)
    with pytest.raises(hb.ModelError, match=words) as caught:
        read_emx(path)
    assert caught.value.problems[0].code == code
    assert "save it as a plain .emx file" in caught.value.problems[0].hint
