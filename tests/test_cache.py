"""What is kept between runs: found again, missed after every change that counts, never wrong, never harmful."""

from __future__ import annotations

import ast
import json
import os
import shutil
import subprocess
import sys
import zlib
from collections.abc import Callable
from pathlib import Path
from unittest import mock

import casadi as ca
import numpy as np
import pytest

import heavebond as hb
from heavebond.basis import cache as store
from heavebond.basis.errors import ModelError, StartError
from heavebond.language import fingerprint, keeping
from heavebond.language import model as diagrams
from heavebond.numbers import dae
from heavebond.numbers.simulation import Simulator
from heavebond.text import instructions, packing

ROOT = Path(hb.__file__).parent
SPRING = """component: MySpring
summary: A spring of the user's own.
ports: {a: translational, b: translational}
parameters: {c: {unit: N/m, doc: stiffness, min: 0 N/m}}
variables: {x: {unit: m, doc: elongation}}
equations: |
  der(x) = a.v - b.v  # elongation
  a.f = c*x  # Hooke's law
  a.f + b.f = 0  # balance
stores: c*x**2/2
"""
DIAGRAM = """model: swing
components:
  body:   {is: Mass, m: 2 kg}
  spring: {is: MySpring, c: 50 N/m}
  wall:   {is: Fixed}
nodes:
  moving: [body.a, spring.a]
  still:  [spring.b, wall.a]
initial: {moving.v: 1 m/s}
show: {v: {is: moving.v, unit: m/s}}
simulate: {until: 2 s, every: 100 ms, solver: idas}
"""


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> store.Cache:
    """An empty cache, which keeps everything at once."""
    monkeypatch.setenv(store.FOLDER, str(tmp_path / "cache"))
    monkeypatch.setattr(keeping, "WORTH", 0.0)
    # files of a test are younger than a tick of the clock
    monkeypatch.setattr(fingerprint.Fingerprint, "settled", lambda self, since: True)
    found = store.the_cache()
    assert found is not None
    return found


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A diagram with a component of its own."""
    made = tmp_path / "project"
    (made / "components").mkdir(parents=True)
    (made / "components" / "my_spring.yaml").write_text(SPRING, encoding="utf-8")
    (made / "swing.yaml").write_text(DIAGRAM, encoding="utf-8")
    return made


class Work:
    """How often a diagram was read, and how often one was reduced."""

    def __init__(self) -> None:
        self.read = self.reduced = 0

    def __enter__(self) -> Work:
        def counted(name: str, work: Callable[..., object]) -> Callable[..., object]:
            def call(*given: object) -> object:
                setattr(self, name, getattr(self, name) + 1)
                return work(*given)
            return call

        self._patches = [mock.patch.object(diagrams, "_load", counted("read", diagrams._load)),
                         mock.patch.object(dae, "reduce", counted("reduced", dae.reduce))]
        for patch in self._patches:
            patch.start()
        return self

    def __exit__(self, *_: object) -> None:
        for patch in self._patches:
            patch.stop()

    @property
    def both(self) -> tuple[int, int]:
        return self.read, self.reduced


def work_of(path: Path | str, **settings: str) -> tuple[int, int]:
    """What has to be done to assemble a diagram now."""
    with Work() as work:
        hb.assemble(hb.load(path).with_parameters(settings) if settings else hb.load(path))
    return work.both


# -- found ---------------------------------------------------------------------------------------------------------------
def test_a_diagram_is_read_and_reduced_once(kept: store.Cache, folder: Path) -> None:
    assert work_of(folder / "swing.yaml") == (1, 1)
    assert work_of(folder / "swing.yaml") == (0, 0)
    assert len(kept.sizes()) == 3  # its files, the diagram, the reduced diagram


MACHINES = ("cmc_ahc", "cmc_ahc/passive", "excavator_boom", "quarter_car", "pneumatic_cylinder", "hydrostatic_drive",
            "mechanisms/four_bar", "examples/sample_hold", "examples/contact")


@pytest.mark.parametrize("name", MACHINES)
def test_a_run_from_the_cache_is_the_same_to_the_last_bit(kept: store.Cache, name: str) -> None:
    model = hb.load(name)
    fresh, sensitive = assembled_and_run(model)
    with Work() as work:
        again = hb.load(name)
        found, sensitive_again = assembled_and_run(again)
    assert work.both == (0, 0)
    assert again == model
    for one, other in ((fresh, found), (sensitive, sensitive_again)):
        assert one.events == other.events
        for column in ("x", "z", "p"):
            assert np.array_equal(getattr(one, column), getattr(other, column), equal_nan=True)
        assert one.along is None or np.array_equal(one.along.x, other.along.x)
        for signal in one.assembly.model.show:
            assert np.array_equal(one[signal], other[signal], equal_nan=True)
    assert fresh.start.table == found.start.table
    same_but_for_symbols(fresh.assembly, found.assembly)


def assembled_and_run(model: hb.Model) -> tuple[hb.Result, hb.Result]:
    assembly = hb.assemble(model)
    parameter = next(q.name for q in assembly.flat.parameters if q.value and "." in q.name)
    plain = Simulator(assembly, 0.5, every=0.05)
    try:
        sensitive = Simulator(assembly, 0.5, every=0.05, sensitivities=[parameter]).run()
    except hb.UsageError:  # no derivatives by what this one sets
        sensitive = plain.run()
    return plain.run(), sensitive


def same_but_for_symbols(one: hb.Assembly, other: hb.Assembly) -> None:
    """All values equal; expressions as they print."""
    assert packed_text(one) == packed_text(other)
    assert [str(e) for e in (one.ode, one.alg, one.reduced.expressions)] == \
        [str(e) for e in (other.ode, other.alg, other.reduced.expressions)]
    assert one.rates.n_instructions() == other.rates.n_instructions()
    assert one.flat.constant_hashes and len(one.flat.bounds) == len(other.flat.bounds)


def packed_text(assembly: hb.Assembly) -> object:
    """The reduced diagram as it is kept."""
    data = packing.pack(assembly.reduced, dae.KEPT.classes, {"model": assembly.model})
    size = int.from_bytes(data[:8], "little")
    return json.loads(data[8:8 + size]), data[8 + size:]


def test_messages_from_the_cache_point_at_the_same_places(kept: store.Cache, folder: Path) -> None:
    text = DIAGRAM.replace("moving.v: 1 m/s", "moving.v: 1 m/s, spring.x: 1 m, body.a.f: 3 N")
    (folder / "swing.yaml").write_text(text, encoding="utf-8")
    said = []
    for _ in range(2):
        with Work() as work, pytest.raises(StartError) as caught:
            hb.simulate(hb.load(folder / "swing.yaml"))
        said.append([str(problem) for problem in caught.value.problems])
    assert work.both == (0, 0)
    assert said[0] == said[1] and "swing.yaml:" in said[0][0]


def test_a_wrong_diagram_is_never_kept(kept: store.Cache, folder: Path) -> None:
    (folder / "swing.yaml").write_text(DIAGRAM.replace("50 N/m", "50 N"), encoding="utf-8")
    for _ in range(2):
        with pytest.raises(ModelError, match=r"swing\.yaml:4"):
            hb.assemble(hb.load(folder / "swing.yaml"))
    (folder / "swing.yaml").write_text(DIAGRAM + "  oops: 1\n", encoding="utf-8")
    for _ in range(2):
        with pytest.raises(ModelError, match=r"swing\.yaml:12"):
            hb.load(folder / "swing.yaml")


# -- missed --------------------------------------------------------------------------------------------------------------
def later(path: Path, old: str, new: str) -> None:
    """Change a file without its size or time telling."""
    status, text = path.stat(), path.read_text(encoding="utf-8")
    assert old in text and len(old) == len(new)
    path.write_text(text.replace(old, new), encoding="utf-8")
    os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))


def test_a_change_to_the_diagram_is_noticed(kept: store.Cache, folder: Path) -> None:
    path = folder / "swing.yaml"
    work_of(path)
    later(path, "m: 2 kg", "m: 3 kg")
    assert work_of(path) == (1, 1)
    assert hb.assemble(hb.load(path)).parameter_values["body.m"] == 3.0
    later(path, "m: 3 kg", "m: 2 kg")
    assert work_of(path) == (0, 0)  # what was kept is still true


def test_a_change_to_a_component_of_the_user_is_noticed(kept: store.Cache, folder: Path) -> None:
    path = folder / "swing.yaml"
    before = hb.simulate(hb.load(path))["v"]
    spring = folder / "components" / "my_spring.yaml"
    spring.write_text(SPRING.replace("a.f = c*x ", "a.f = 4*c*x "), encoding="utf-8")
    assert work_of(path) == (1, 1)
    after = hb.simulate(hb.load(path))["v"]
    assert after == pytest.approx(np.cos(10 * np.arange(21) * 0.1), abs=1e-6)  # sqrt(4*50/2) = 10 rad/s
    assert before == pytest.approx(np.cos(5 * np.arange(21) * 0.1), abs=1e-6)


def test_a_new_file_that_covers_a_bundled_component_is_noticed(kept: store.Cache, folder: Path) -> None:
    path = folder / "swing.yaml"
    work_of(path)
    (folder / "heavy.yaml").write_text(
        "component: Mass\nsummary: Twice as heavy.\nports: {a: translational}\n"
        "parameters: {m: {unit: kg, doc: half the mass, min: 0 kg}}\n"
        "equations: |\n  a.f = 2*m*der(a.v)  # Newton\nstores: m*a.v**2\n", encoding="utf-8")
    assert work_of(path) == (1, 1)
    assert hb.assemble(hb.load(path)).flat.expanded.leaves["body"].component.path == folder / "heavy.yaml"
    (folder / "heavy.yaml").unlink()
    assert work_of(path) == (0, 0)


def test_a_change_to_an_extended_file_is_noticed_and_a_file_that_comes_before_it(
        kept: store.Cache, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "own").mkdir()
    path, base = tmp_path / "own" / "mine.yaml", tmp_path / "base.yaml"
    shutil.copy(diagrams.find("quarter_car"), base)
    path.write_text("model: mine\nextends: ../base.yaml\n", encoding="utf-8")
    work_of(path)
    base.write_text(base.read_text(encoding="utf-8") + "\n# later\n", encoding="utf-8")
    assert work_of(path)[0] == 2  # this file and that one
    bundled = diagrams.find("quarter_car")
    named = bundled.relative_to(bundled.parents[1])
    path.write_text(f"model: mine\nextends: {named}\n", encoding="utf-8")
    work_of(path)
    assert work_of(path) == (0, 0)
    shutil.copytree(bundled.parent, tmp_path / "own" / named.parent)
    assert work_of(path)[0] == 2
    assert hb.load(path).files[0] == tmp_path / "own" / named


TABLE = """model: table
components:
  input: {is: Constant, k: 2}
  law:   {is: Lookup, x: {file: curve.csv, values: x, unit: "1"}, v: {file: curve.csv, values: y, unit: "1"}}
nodes:
  u: [input.y, law.u]
show: {y: {is: law.y, unit: "1"}}
simulate: {until: 1 s}
"""


def test_a_change_to_a_list_of_values_in_a_file_is_noticed(kept: store.Cache, tmp_path: Path) -> None:
    (tmp_path / "curve.csv").write_text("x,y\n0,0\n4,4\n", encoding="utf-8")
    (tmp_path / "table.yaml").write_text(TABLE, encoding="utf-8")
    for scale in (1, 3):
        (tmp_path / "curve.csv").write_text(f"x,y\n0,0\n4,{4 * scale}\n", encoding="utf-8")
        assert hb.simulate(hb.load(tmp_path / "table.yaml"))["y"][-1] == pytest.approx(2 * scale, rel=1e-3)
    assert work_of(tmp_path / "table.yaml") == (0, 0)
    # in a block of the user's own nobody but that file knows of the list: it is not kept
    (tmp_path / "block.yaml").write_text(
        "component: Block\nsummary: A curve.\nports: {u: {signal: in, unit: 1}, y: {signal: out, unit: 1}}\ncomponents:\n"
        + TABLE.splitlines()[3] + "\nnodes: {i: [u, law.u], o: [law.y, y]}\n", encoding="utf-8")
    path = tmp_path / "around.yaml"
    path.write_text("model: around\ncomponents:\n  input: {is: Constant, k: 2}\n  block: {is: Block}\n"
                    "nodes: {u: [input.y, block.u]}\nshow: {y: {is: block.y, unit: 1}}\nsimulate: {until: 1 s}\n",
                    encoding="utf-8")
    assert work_of(path) == (1, 1)
    assert work_of(path) == (0, 1)


def test_other_values_signals_widths_and_folders_are_other_entries(
        kept: store.Cache, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = folder / "swing.yaml"
    work_of(path)
    assert work_of(path, **{"spring.c": "200 N/m"}) == (0, 1)
    assert work_of(path, **{"spring.c": "200 N/m"}) == (0, 0)
    assert hb.assemble(hb.load(path).with_parameters({"spring.c": "200 N/m"})).parameter_values["spring.c"] == 200.0
    model = hb.load(path)
    with Work() as work:
        assert "moving.x" in hb.assemble(model, ["moving.x"]).flat.names
        assert "moving.x" not in hb.assemble(model).flat.names
        hb.assemble(model, [], 0.1)
        assert work.both == (0, 2)
        monkeypatch.chdir(folder)  # messages count from here
        hb.assemble(hb.load(path))
        assert work.both == (1, 3)


def test_a_change_to_this_program_its_libraries_or_the_bundled_components_is_another_program(
        monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    before = fingerprint.program()
    copied = tmp_path / "components"
    shutil.copytree(fingerprint.bundled("components"), copied)
    monkeypatch.setattr(fingerprint, "bundled", lambda name: tmp_path / name)
    same = fingerprint.program()
    mass = copied / "translational" / "mass.yaml"
    mass.write_text(mass.read_text(encoding="utf-8") + "\n# later\n", encoding="utf-8")
    assert len({before.digest, same.digest, fingerprint.program().digest}) == 3  # paths count, as messages show them
    monkeypatch.undo()
    assert fingerprint.program().digest == before.digest
    for name, other in (("_versions", lambda: ["casadi-0.1.dist-info"]), ("contents", lambda paths: before)):
        fingerprint._code.cache_clear()
        with monkeypatch.context() as patched:
            patched.setattr(fingerprint, name, other)
            assert fingerprint._code().digest != before.digest[:64]
        fingerprint._code.cache_clear()
    assert any(name.startswith("casadi-") for name in fingerprint._versions())


def test_nothing_is_kept_that_was_read_while_it_changed(
        tmp_path: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(store.FOLDER, str(tmp_path / "cache"))
    monkeypatch.setattr(keeping, "WORTH", 0.0)
    fingerprint._code()  # is kept for the whole process, so it is asked by the right clock
    monkeypatch.setattr(fingerprint, "TICK", 10**18)  # a slow clock: all files were written a moment ago
    hb.assemble(hb.load(folder / "swing.yaml"))
    assert not list((tmp_path / "cache").glob("*"))
    monkeypatch.setattr(fingerprint, "TICK", 10)
    found = fingerprint.contents([folder / "swing.yaml"])
    assert found.settled(found.newest + 2 * fingerprint.TICK) and not found.settled(found.newest)


# -- damaged, foreign ------------------------------------------------------------------------------------------------------
def entries(kept: store.Cache) -> list[Path]:
    return sorted(kept.folder.glob(f"*{store.SUFFIX}"))


DAMAGES = {
    "cut off": lambda data: data[:len(data) // 2],
    "empty": lambda data: b"",
    "garbage": lambda data: bytes(reversed(data)),
    "one byte changed": lambda data: data[:-9] + bytes([data[-9] ^ 1]) + data[-8:],
    "of another version": lambda data: data.replace(b"cache 1", b"cache 0", 1),
}


@pytest.mark.parametrize("how", DAMAGES)
def test_a_damaged_entry_is_made_again(kept: store.Cache, folder: Path, how: str) -> None:
    path = folder / "swing.yaml"
    work_of(path)
    for entry in entries(kept):
        entry.write_bytes(DAMAGES[how](entry.read_bytes()))
    assert work_of(path) == (1, 1)
    assert work_of(path) == (0, 0)


def test_an_entry_of_another_diagram_under_this_name_is_not_taken(kept: store.Cache, folder: Path) -> None:
    path = folder / "swing.yaml"
    work_of(path)
    first = entries(kept)
    work_of(path, **{"body.m": "7 kg"})
    other = next(e for e in entries(kept) if e not in first)
    for entry in first:
        shutil.copy(other, entry)
    assert work_of(path) == (1, 1)


def sound_but_wrong(kept: store.Cache, change: Callable[[bytes], bytes]) -> None:
    """Entries with checksums that fit, as someone could write them who knows how."""
    for entry in entries(kept):
        data = kept.fetch(entry.stem)
        assert data is not None
        kept.keep(entry.stem, change(data))


WRONG = {
    "no JSON": lambda data: b"\x08" + bytes(7) + b"{{{{{{{{",
    "other fields": lambda data: data.replace(b'"place"', b'"plack"'),
    "classes unknown": lambda data: data.replace(b'"Model"', b'"Popen"').replace(b'"Reduced"', b'"Popen__"'),
    "nothing": lambda data: b"",
    "numbers too large": lambda data: data.replace(b'"root":["value",0]', b'"root":["value",9]'.replace(b"9", b"999999")),
    "half": lambda data: data[:len(data) // 2],
    "another value": lambda data: packing.pack(7, ()),
}


@pytest.mark.parametrize("how", WRONG)
def test_an_entry_that_says_something_impossible_is_made_again(kept: store.Cache, folder: Path, how: str) -> None:
    path = folder / "swing.yaml"
    work_of(path)
    sound_but_wrong(kept, WRONG[how])
    assert work_of(path)[1] == 1
    assert hb.simulate(hb.load(path))["v"][-1] == pytest.approx(np.cos(10.0), abs=1e-6)


def test_numbers_that_are_no_expressions_never_reach_casadi(monkeypatch: pytest.MonkeyPatch) -> None:
    x = ca.SX.sym("x", 2)
    good = instructions.instructions(ca.vertcat(x, ca.sin(x[0]) * x[1], 2.5, x[0]))
    assert str(instructions.expressions(good)) == "[x_0, x_1, (sin(x_0)*x_1), 2.5, x_0]"
    monkeypatch.setattr(ca, "StringDeserializer", None)
    for name, at, value in (("first", -1, 10_000), ("first", 2, -1), ("second", -1, 10_000), ("operation", -1, ca.OP_CALL),
                            ("operation", 0, 255), ("outputs", 0, 10_000), ("outputs", 0, -1)):
        array = getattr(good, name).copy()
        binary = np.flatnonzero(np.isin(good.operation, instructions.BINARY))
        array[binary[0] if name == "second" else at] = value
        with pytest.raises(instructions.NotPlain):
            instructions.expressions(instructions.Instructions(**{**vars(good), name: array}))


def test_every_operation_comes_back_as_it_was() -> None:
    x, y = ca.SX.sym("µ"), ca.SX.sym("y")
    made = [f(x) for f in (ca.exp, ca.log, ca.sqrt, ca.sin, ca.cos, ca.tan, ca.asin, ca.acos, ca.atan, ca.floor, ca.ceil,
                           ca.fabs, ca.sign, ca.erf, ca.sinh, ca.cosh, ca.tanh, ca.asinh, ca.acosh, ca.atanh, ca.log1p,
                           ca.expm1, ca.logic_not)]
    made += [-x, x + x, x * x, 1 / x, x + y, x - y, x * y, x / y, x**y, x**2.5, x < y, x <= y, x == y, x != y,
             ca.logic_and(x, y), ca.logic_or(x, y), ca.fmod(x, y), ca.copysign(x, y), ca.if_else(x > 0, x, y),
             ca.fmin(x, y), ca.fmax(x, y), ca.atan2(x, y), ca.hypot(x, y), ca.remainder(x, y)]
    made += [ca.SX(v) for v in (0, 1, 2, -1, 7, -12345, 2**31, 1e300, -0.1, np.inf, -np.inf, np.nan)]
    column = ca.vertcat(*made)
    numbers = instructions.instructions(column)
    assert set(instructions.UNARY) | set(instructions.BINARY) <= set(numbers.operation.tolist()) | {ca.OP_TWICE}
    again = instructions.expressions(numbers)
    assert str(again) == str(column)
    inputs, point = ca.symvar(again), np.array([0.3, 0.7])
    own = np.array(ca.Function("own", [ca.vertcat(x, y)], [column])(point))
    order = [0, 1] if inputs[0].name() == "µ" else [1, 0]
    assert np.array_equal(own, np.array(ca.Function("again", [ca.vertcat(*inputs)], [again])(point[order])), equal_nan=True)


def test_expressions_with_calls_of_functions_are_not_kept() -> None:
    x = ca.SX.sym("x")
    inner = ca.Function("inner", [x], [ca.sin(x)], {"never_inline": True})
    with pytest.raises((instructions.NotPlain, RuntimeError)):
        instructions.instructions(ca.vertcat(inner(x), x))


def test_nothing_that_could_execute_code_is_loaded() -> None:
    forbidden = {"pickle", "marshal", "shelve", "dill", "cloudpickle", "importlib"}
    for name in ("cache", "packing", "instructions", "keeping"):
        tree = ast.parse(next(ROOT.rglob(f"{name}.py")).read_text(encoding="utf-8"))
        nodes = list(ast.walk(tree))
        imported = {alias.name.split(".")[0] for node in nodes if isinstance(node, ast.Import) for alias in node.names}
        imported |= {(node.module or "").split(".")[0] for node in nodes if isinstance(node, ast.ImportFrom)}
        called = {node.func.id for node in nodes if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)}
        assert not imported & forbidden and not called & {"eval", "exec", "compile", "__import__"}
    with pytest.raises(packing.Unpackable):
        packing.pack(subprocess.run, dae.KEPT.classes)


# -- the folder ----------------------------------------------------------------------------------------------------------
def test_a_folder_that_cannot_be_written_does_no_harm(
        tmp_path: Path, folder: Path, kept: store.Cache, monkeypatch: pytest.MonkeyPatch) -> None:
    work_of(folder / "swing.yaml")
    kept.folder.chmod(0o500)
    try:
        assert work_of(folder / "swing.yaml") == (0, 0)
        assert hb.simulate(hb.load(folder / "swing.yaml").with_parameters({"body.m": "8 kg"}))["v"][0] == pytest.approx(1.0)
    finally:
        kept.folder.chmod(0o700)
    (tmp_path / "file").write_text("", encoding="utf-8")
    monkeypatch.setenv(store.FOLDER, str(tmp_path / "file" / "below"))
    assert work_of(folder / "swing.yaml") == (1, 1)


def test_the_least_used_goes_where_there_is_no_room(tmp_path: Path) -> None:
    cache = store.Cache(tmp_path / "cache", 10_000)
    data = [bytes(np.random.default_rng(k).integers(0, 256, 2400, dtype=np.uint8)) for k in range(5)]
    for k in range(4):
        cache.keep(f"{k}", data[k])
        os.utime(tmp_path / "cache" / f"{k}{store.SUFFIX}", (k, k))
    assert cache.fetch("0") == data[0]  # used just now
    cache.keep("4", data[4])
    assert [cache.fetch(f"{k}") is not None for k in range(5)] == [True, False, True, True, True]
    cache.keep("5", bytes(np.random.default_rng(9).integers(0, 256, 9000, dtype=np.uint8)))  # too large to be kept at all
    assert cache.fetch("5") is None and sum(cache.sizes()) <= 10_000


def test_what_unpacks_to_too_much_is_not_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cache = store.Cache(tmp_path / "cache", 10**6)
    monkeypatch.setattr(store, "MOST_UNPACKED", 1000)
    cache.keep("bomb", bytes(100_000))
    assert cache.fetch("bomb") is None
    body = zlib.compress(b"x")
    assert store._opened("a", store.HEAD + store._checksum("a", body) + body) == b"x"


def test_limits_are_read_as_they_are_meant() -> None:
    assert store.limit_of("") == store.limit_of("much") == store.limit_of("nan") == 500_000_000
    assert store.limit_of("20") == 20_000_000
    assert store.limit_of("-3") == 0


COMMAND = (sys.executable, "-c", "from heavebond.cli import main; main()")


def started(*arguments: str, folder: Path, **environment: str) -> subprocess.Popen[str]:
    return subprocess.Popen([*COMMAND, *arguments], cwd=folder, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                            env={**os.environ, "PYTHONPATH": str(ROOT.parent), "COLUMNS": "200", **environment})


def test_processes_share_a_cache_and_tell_the_same(tmp_path: Path, folder: Path) -> None:
    for path in (folder, *folder.rglob("*")):
        os.utime(path)
    shared = {store.FOLDER: str(tmp_path / "cache")}
    first = [started("run", "swing.yaml", "--json", f"{k}.json", folder=folder, **shared) for k in range(2)]
    for process in first:
        _, problems = process.communicate(timeout=120)
        assert process.returncode == 0, problems
    after = started("run", "swing.yaml", "--json", "2.json", folder=folder, **shared)
    assert after.wait(120) == 0
    told = [json.loads((folder / f"{k}.json").read_text(encoding="utf-8"))["outputs"] for k in range(3)]
    assert told[0] == told[1] == told[2]
    assert not list((tmp_path / "cache").glob(".*.new"))
    # its files and the diagram; the reduced one where making it took long enough
    assert len(list((tmp_path / "cache").glob(f"*{store.SUFFIX}"))) in (2, 3)


def test_the_command_shows_empties_and_switches(kept: store.Cache, folder: Path, monkeypatch: pytest.MonkeyPatch,
                                                capsys: pytest.CaptureFixture[str]) -> None:
    from heavebond.cli import main

    def said(*arguments: str) -> str:
        with pytest.raises(SystemExit):
            main(["cache", *arguments])
        return "".join(capsys.readouterr())

    work_of(folder / "swing.yaml")
    assert "3 entries" in said() and str(kept.folder) in said()
    assert "switched off" in said("--off")
    assert work_of(folder / "swing.yaml") == (1, 1)
    assert "switched off" not in said("--on")
    assert work_of(folder / "swing.yaml") == (0, 0)
    assert "no entries" in said("--empty")
    assert "contradict" in said("--on", "--off")
    monkeypatch.setenv(store.FOLDER, "off")
    assert "switches the cache off" in said()
    assert work_of(folder / "swing.yaml") == (1, 1)
