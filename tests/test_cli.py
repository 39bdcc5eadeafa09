"""The command line: exit codes, messages, JSON, files, and what happens when somebody interrupts or stops reading."""

from __future__ import annotations

import ast
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result
from collected import partly
from matplotlib.image import imread

import heavebond
from heavebond import cli
from heavebond.commands import terminal
from heavebond.commands.demo import FIGURES, SEAS
from heavebond.core.errors import SimulationError
from heavebond.estimation.experiment import load_experiment

SLIDER = """\
model: slider
summary: A cart on a rail.
parameters: {m_cart: 2.5 kg}
components:
  wall:   {is: Fixed}
  spring: {is: Spring, c: 1.2 kN/m}
  cart:   {is: Mass, m: =m_cart}
nodes:
  ground: [wall.a, spring.a]
  load:   [spring.b, cart.a]
initial: {load.x: 50 mm, load.v: 0 m/s}
show:
  pull:  {is: spring.F, unit: N}
  place: {is: load.x, unit: mm}
simulate: {until: 1 s, every: 5 ms}
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Every test runs in a folder of its own, with a diagram in it, on a terminal of no particular width."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("COLUMNS", raising=False)
    (tmp_path / "slider.yaml").write_text(SLIDER)
    return tmp_path


def call(*words: str) -> Result:
    return CliRunner().invoke(cli.main, words)


def figures(*words: str) -> dict[str, Any]:
    """What a command writes for machines, which must be strict JSON."""
    call(*words, "--json", "out.json")
    found: dict[str, Any] = json.loads(Path("out.json").read_text(), parse_constant=lambda word: pytest.fail(word))
    return found


def program(*words: str, **more: Any) -> subprocess.CompletedProcess[str]:
    """The command line as a process of its own."""
    environment = {**os.environ, "PYTHONPATH": str(Path(heavebond.__file__).parent.parent), **more.pop("env", {})}
    return subprocess.run([sys.executable, "-c", "from heavebond.cli import main; main()", *words], env=environment,
                          capture_output=True, text=True, timeout=60, **more)


# -- check ---------------------------------------------------------------------------------------------------------
def test_check_tells_states_and_start() -> None:
    answer = call("check", "slider.yaml")
    assert answer.exit_code == 0
    for words in ("Diagram slider", "3: Fixed, Spring, Mass", "2 differential equations", "cart: m * der(a.v) = a.f",
                  "asked for"):
        assert words in answer.stdout
    assert answer.stderr == ""


def test_check_tells_a_steady_start_that_is_not_stable(tmp_path: Path) -> None:
    """x' = 2/s x - 1/s stays at 0.5, and nowhere else."""
    (tmp_path / "drift.yaml").write_text("model: drift\ncomponents:\n  x: {is: Integrator, k: 1 1/s, u: =2*x.y - 1}\n"
                                         "initial: {start: steady}\n")
    answer = call("check", str(tmp_path / "drift.yaml"))
    assert answer.exit_code == 0 and "0.5 " in answer.stdout
    assert "The steady start is not stable, so that the machine leaves it: growing mode (2 1/s) of x.y" in answer.stderr
    assert "not stable" not in call("check", "cmc_ahc").stderr
    # a run stays there for ever, which it tells too
    told = tmp_path / "told.json"
    answer = call("run", str(tmp_path / "drift.yaml"), "--until", "20 s", "--json", str(told))
    assert "The steady start is not stable" in answer.stderr
    assert json.loads(told.read_text("utf-8"))["growing"] == [
        {"real": pytest.approx(2), "imaginary": 0, "states": ["x.y"]}]
    call("run", "cmc_ahc", "--until", "1 s", "--json", str(told))
    assert json.loads(told.read_text("utf-8"))["growing"] == []


def test_check_prints_all_problems_and_ends_with_1(folder: Path) -> None:
    (folder / "slider.yaml").write_text(SLIDER.replace("1.2 kN/m", "1.2 kN").replace("{is: Fixed}", "{is: Fixd}"))
    answer = call("check", "slider.yaml")
    assert answer.exit_code == 1
    assert "slider.yaml:5: there is no component 'Fixd' [component-unknown]" in answer.stderr
    assert "Did you mean 'Fixed'?" in answer.stderr
    assert "Traceback" not in answer.stderr


def test_several_problems_are_counted(folder: Path) -> None:
    (folder / "slider.yaml").write_text(SLIDER.replace("is: Mass", "is: Mas").replace("is: Fixed", "is: Fixd"))
    answer = call("check", "slider.yaml")
    assert answer.exit_code == 1
    found = figures("check", "slider.yaml")
    assert len(found["problems"]) == 2
    assert answer.stderr.rstrip().endswith("2 problems")


def test_check_shows_the_structure_even_where_no_start_is_found(folder: Path) -> None:
    text = SLIDER.replace("load.v: 0 m/s", "load.v: 0 m/s, spring.F: 1 kN")
    (folder / "slider.yaml").write_text(text)
    answer = call("check", "slider.yaml")
    assert answer.exit_code == 1
    assert "States" in answer.stdout
    assert "start-contradiction" in answer.stderr


def test_problems_as_data() -> None:
    found = figures("check", "slidr")
    assert (found["command"], found["ok"]) == ("check", False)
    assert [p["code"] for p in found["problems"]] == ["file-missing"]
    assert set(found["problems"][0]) == {"code", "message", "place", "hint", "notes"}


def test_check_as_data() -> None:
    found = figures("check", "slider.yaml")
    assert found["ok"] is True
    assert found["problems"] == []
    assert [state["name"] for state in found["states"]] == ["load.v", "load.x"]
    assert found["equations_left"] == {"differential": 2, "algebraic": 0}


def test_lines_of_problems_are_not_broken(folder: Path) -> None:
    name = "long_" * 30 + "name"
    answer = call("run", "slider.yaml", "--set", f"{name}=1 N")
    assert f"nothing here is called '{name}', so it cannot be set" in answer.stderr.splitlines()[0]


# -- run -----------------------------------------------------------------------------------------------------------
def test_run_prints_a_table_of_outputs() -> None:
    answer = call("run", "slider.yaml")
    assert answer.exit_code == 0
    rows = {line.split()[0]: line.split() for line in answer.stdout.splitlines() if line.strip()}
    head, pull, place = (rows[word] for word in ("output", "pull", "place"))
    assert head == ["output", "unit", "min", "max", "rms", "final"]
    assert pull[1] == "N"
    assert float(pull[3]) == pytest.approx(60, rel=1e-4)  # 1.2 kN/m * 50 mm
    assert place[1] == "mm"
    assert float(place[2]) == pytest.approx(-50, rel=1e-4)
    assert "2 states" in answer.stdout


def test_run_as_data() -> None:
    found = figures("run", "slider.yaml", "--until", "2 s", "--every", "10 ms")
    assert (found["until"], found["points"]) == (2.0, 201)
    assert found["outputs"]["pull"]["unit"] == "N"
    assert found["outputs"]["pull"]["max"] == pytest.approx(60, rel=1e-6)
    assert found["statistics"]["nsteps"] > 10


def test_set_changes_the_numbers() -> None:
    found = figures("run", "slider.yaml", "--set", "spring.c=2.4 kN/m", "--set", "m_cart=5 kg")
    assert found["outputs"]["pull"]["max"] == pytest.approx(120, rel=1e-6)


@pytest.mark.parametrize(("setting", "code", "words"), [
    ("spring.c", "set-form", "not PATH=VALUE"), ("spring.c=", "set-form", "not PATH=VALUE"),
    ("spring.k=1 N/m", "setting-unknown", "Did you mean 'spring.c'"), ("spring.c=1 N", "unit-wrong", "N/m is needed"),
    ("spring.c=40", "unit-missing", "Write '40 N/m'"), ("spring.c=40N/m", "quantity-no-space", "Write '40 N/m'"),
    ("spring.c=-1 N/m", "parameter-bound", "at least 0"), ("spring.c==2*", "formula-incomplete", "ends too early"),
])
def test_a_wrong_setting_is_told_as_one_of_the_command_line(setting: str, code: str, words: str) -> None:
    answer = call("run", "slider.yaml", "--set", setting)
    assert answer.exit_code == 2
    assert f"[{code}]" in answer.stderr
    assert words in answer.stderr
    assert answer.stderr.startswith(f"--set {setting}: ")


def test_pictures_and_files(folder: Path) -> None:
    answer = call("run", "slider.yaml", "--plot", "place", "--plot", "load.v", "--output", "p.png", "--save", "t.csv",
                  "--save", "t.parquet")
    assert answer.exit_code == 0
    for name in ("p.png", "t.csv", "t.parquet"):
        assert f"wrote {name}" in answer.stdout
    assert imread(folder / "p.png").shape[1] == 1200
    head = (folder / "t.csv").read_text().splitlines()[0]
    assert "place [mm]" in head
    assert "load.v [m/s]" in head


def test_labels_of_a_picture_have_units(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from matplotlib.figure import Figure

    seen: list[str] = []
    monkeypatch.setattr(Figure, "savefig", lambda self, path, **_: seen.extend(a.get_ylabel() for a in self.axes))
    assert call("run", "slider.yaml", "--output", "p.svg").exit_code == 0
    assert seen == ["force [N]", "position [mm]"]


def test_plot_without_output_names_the_picture_after_the_model(folder: Path) -> None:
    assert call("run", "slider.yaml", "--plot", "pull").exit_code == 0
    assert (folder / "slider.png").stat().st_size > 10_000


def test_a_position_that_no_equation_uses_can_be_drawn(folder: Path) -> None:
    text = SLIDER.replace("spring: {is: Spring, c: 1.2 kN/m}", "spring: {is: Damper, d: 3 N*s/m}")
    text = text.replace("spring.F, unit: N}", "spring.F, unit: N}").replace("place: {is: load.x, unit: mm}", "")
    (folder / "slider.yaml").write_text(text.replace("load.x: 50 mm, load.v: 0 m/s", "load.v: 1 m/s"))
    assert call("run", "slider.yaml", "--plot", "load.x - ground.x").exit_code == 0


@pytest.mark.parametrize(("words", "code", "said"), [
    (("--plot", "pul"), "name-unknown", "Did you mean 'pull'"),
    (("--plot", "max(pull"), "formula-incomplete", "--plot max"),
    (("--output", "p.jpg"), "file-suffix", ".png"), (("--save", "t.xlsx"), "file-suffix", ".csv"),
    (("--output", "nowhere/p.png"), "file-unwritable", "find the folder"), (("--output", ".png"), "file-suffix", ".png"),
    (("--save", "nowhere/t.csv"), "file-unwritable", "find the folder"), (("--until", "5"), "unit-missing", "5 s"),
    (("--until", "-1 s"), "time-not-positive", "above 0"), (("--rtol", "2"), "usage", "rtol"),
    (("--json", "nowhere/o.json"), "file-unwritable", "find the folder"), (("more",), "usage", "unexpected extra argument"),
    (("--plt", "pull"), "usage", "--plot"), (("--set",), "usage", "requires an argument"),
])
def test_wrong_usage_ends_with_2(words: tuple[str, ...], code: str, said: str) -> None:
    answer = call("run", "slider.yaml", *words)
    assert answer.exit_code == 2
    assert f"[{code}]" in answer.stderr
    assert said in answer.stderr
    assert "Traceback" not in answer.output
    assert not list(Path().glob("p.*"))


def test_a_failed_integration_ends_with_1(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise SimulationError("the integration stopped at t = 0.2 s")

    monkeypatch.setattr("heavebond.numerics.simulation.simulate", fail)
    answer = call("run", "slider.yaml")
    assert answer.exit_code == 1
    assert answer.stderr.startswith("the integration stopped at t = 0.2 s [simulation]")


@pytest.mark.own_fault
def test_a_fault_of_the_program_is_in_the_json_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("heavebond.numerics.simulation.simulate", lambda *_, **__: 1 / 0)
    answer = call("run", "slider.yaml", "--json", "out.json")
    assert answer.exit_code == 70
    assert json.loads(Path("out.json").read_text())["problems"][0]["code"] == "internal"


# -- compare -------------------------------------------------------------------------------------------------------
def test_compare_prints_errors_and_draws(folder: Path) -> None:
    answer = call("compare", "passive_rig/nothing", "--output", "c.png")
    assert answer.exit_code == 0
    assert re.search(r"train +extension +[\d.]+ mm", answer.stdout)
    assert "validate (validate): normalised error" in answer.stdout
    assert imread(folder / "c.png").shape[1] == 1200


def test_compare_as_data_and_with_settings() -> None:
    before = figures("compare", "passive_rig/nothing")["records"]
    after = figures("compare", "passive_rig/nothing", "--set", "damper.d=90 kN*s/m")["records"]
    assert set(before) == {"train", "validate"}
    assert after["train"]["normalised"] > 2 * before["train"]["normalised"]


def test_a_diagram_is_no_experiment() -> None:
    answer = call("compare", "slider.yaml")
    assert answer.exit_code == 1
    assert "heavebond run" in answer.stderr


# -- library -------------------------------------------------------------------------------------------------------
def test_library_lists_by_domain_and_the_folder_first(folder: Path) -> None:
    (folder / "rod.yaml").write_text("component: Rod\nsummary: My own rod.\n"
                                     "ports: {a: translational}\nequations: |\n  a.f = 0\n")
    found = figures("library")["components"]
    assert next(iter(found)) == "this folder"
    assert found["this folder"] == {"Rod": "My own rod."}
    assert "Cylinder" in found["hydraulic"]
    answer = call("library")
    assert answer.exit_code == 0
    assert "translational" in answer.stdout.splitlines()


def test_library_tells_all_about_a_component() -> None:
    answer = call("library", "Cylinder")
    for words in ("A  hydraulic", "l0       m            default 0 m", "absent at 0", "thrust (positive in extension)",
                  "V_A*k_A * der(A.p) = A.q - q_leak - A_A * v", "# continuity of chamber A", "dissipates",
                  "Merritt"):
        assert words in answer.stdout
    found = figures("library", "Spring")["component"]
    assert found["parameters"]["c"] == {"unit": "N/m", "doc": "stiffness", "min": 0.0, "max": None, "neutral": None,
                                        "default": None, "medium": None, "list": False}
    assert found["stores"] == "1/2 * c * s**2"


def test_library_shows_equations_as_they_are_written(folder: Path) -> None:
    answer = call("library", "Mass")
    assert "m * der(a.v) = a.f" in answer.stdout


def test_library_finds_components_by_the_words_of_their_summaries() -> None:
    found = figures("library", "check", "valve")["components"]
    assert "CheckValve" in found["hydraulic"] and "PneumaticCheckValve" in found["pneumatic"]
    assert all("valve" in summary.lower() for part in found.values() for summary in part.values())
    assert "Spring" in figures("library", "spring")["components"]["translational"]  # a name in small letters
    assert "RotationalDrag" not in figures("library", "rope")["components"]["rotational"]  # of a propeller


def test_library_suggests() -> None:
    answer = call("library", "Sprng")
    assert answer.exit_code == 2
    assert "Did you mean 'Spring'" in answer.stderr


# -- demo ----------------------------------------------------------------------------------------------------------
@pytest.mark.long
def test_demo_tables_and_pictures(folder: Path) -> None:
    answer = call("demo", "--output", "shown/deep", "--json", "out.json")
    assert answer.exit_code == 0
    found = json.loads((folder / "out.json").read_text())
    assert list(found["runs"]) == [f"{sea.title}, {mode}" for sea in SEAS for mode in sea.modes]
    for sea in SEAS:
        passive, active = (found["runs"][f"{sea.title}, {mode}"] for mode in ("passive", "active"))
        assert set(passive) == {figure.name for figure in FIGURES}
        assert active["WOB variation"] < passive["WOB variation"] / 5
        assert active["crown block motion"] < passive["crown block motion"] / 5
        assert active["bit off bottom"] == 0
        assert imread(folder / "shown" / "deep" / f"{sea.file}.png").shape[1] == 1200
    # the published wave: what the paper calls active control keeps the weight on bit within some kilonewton
    assert found["runs"]["regular sea, active"]["WOB variation"] == pytest.approx(2.86, rel=0.02)


def test_demo_needs_a_folder_that_can_be_made(folder: Path) -> None:
    (folder / "file").write_text("")
    answer = call("demo", "--output", "file/below")
    assert answer.exit_code == 2
    assert "[file-unwritable]" in answer.stderr
    assert call("demo").exit_code == 2


# -- the whole -----------------------------------------------------------------------------------------------------
def test_unknown_command_is_suggested() -> None:
    answer = call("chekc", "slider.yaml")
    assert answer.exit_code == 2
    assert "Did you mean 'check'" in answer.stderr
    assert f"Commands: {', '.join(cli.main.commands)}." in call("zzz").stderr


def test_usage_mistakes_reach_the_json_file() -> None:
    found = figures("run")
    assert (found["command"], found["ok"]) == ("run", False)
    assert "missing argument" in found["problems"][0]["message"]


@pytest.mark.parametrize(("words", "path"), [
    (["run", "--json", "a"], "a"), (["run", "--json=b"], "b"), (["run", "--", "--json", "c"], ""), (["run"], ""),
    (["--json"], ""),
])
def test_json_path(words: list[str], path: str) -> None:
    assert cli.json_path(words) == path


def test_interrupted_is_one_line_and_130(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("heavebond.numerics.simulation.simulate", interrupt)
    answer = call("run", "slider.yaml", "--json", "out.json")
    assert answer.exit_code == 130
    assert answer.stderr.split() == ["interrupted"]
    assert json.loads(Path("out.json").read_text())["problems"][0]["code"] == "interrupted"


def test_output_that_nobody_reads_ends_silently() -> None:
    read, write = os.pipe()
    os.close(read)
    environment = {**os.environ, "PYTHONPATH": str(Path(heavebond.__file__).parent.parent)}
    code = "from heavebond.cli import main; main()"
    done = subprocess.run([sys.executable, "-c", code, "library"], stdout=write, stderr=subprocess.PIPE, text=True,
                          env=environment, timeout=60)
    os.close(write)
    assert (done.returncode, done.stderr) == (141, "")


def test_help_loads_nothing_heavy() -> None:
    code = ("import sys\nfrom heavebond.cli import main\ntry:\n    main(['--help'])\nexcept SystemExit:\n    pass\n"
            "heavy = {'numpy', 'casadi', 'matplotlib', 'pandas', 'scipy', 'networkx', 'pint', 'rich', 'yaml'}\n"
            "sys.exit(repr(sorted(heavy & set(sys.modules))) if heavy & set(sys.modules) else 0)")
    environment = {**os.environ, "PYTHONPATH": str(Path(heavebond.__file__).parent.parent)}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, timeout=60)
    assert done.returncode == 0, done.stderr
    assert "Commands:" in done.stdout


@pytest.mark.long
def test_plain_where_nobody_looks_and_coloured_if_forced() -> None:
    assert "\x1b[" not in program("check", "slidr").stderr
    assert "\x1b[" in program("check", "slidr", env={"FORCE_COLOR": "1", "TERM": "xterm"}).stderr
    assert "\x1b[31" not in program("check", "slidr", env={"FORCE_COLOR": "1", "NO_COLOR": "1", "TERM": "xterm"}).stderr


def test_version_and_help() -> None:
    assert heavebond.__version__ in call("--version").output
    for command in cli.main.commands:
        answer = call(command, "--help")
        assert answer.exit_code == 0
        assert "--json" in answer.output


@pytest.mark.parametrize("width", partly([80, 120], 2))
def test_tables_fit_the_terminal(width: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    for words in (("check", "cmc_ahc"), ("run", "cmc_ahc", "--until", "1 s"), ("library",),
                  ("compare", "passive_rig/nothing")):
        # notes of one line are not tables
        notes = ("wrote", "11 states", "repeated")
        lines = [line for line in call(*words).stdout.splitlines() if not line.startswith(notes)]
        assert max(map(len, lines)) <= width, words


def test_check_lists_every_name() -> None:
    result = CliRunner().invoke(cli.main, ["check", "passive_rig", "--names"])
    assert result.exit_code == 0
    lines = result.stdout.splitlines()
    assert any(line.split()[:2] == ["crown.x", "m"] for line in lines)
    assert any(line.split()[:4] == ["gas.c", "N/m", "42", "kN/m"] for line in lines)


# -- an experiment from records -------------------------------------------------------------------------------------
def test_new_writes_an_experiment_for_a_diagram_and_its_records(folder: Path) -> None:
    assert call("new", "rig").exit_code == 0
    files = sorted(str(p) for p in Path("rig").rglob("*.csv"))
    found = figures("new", "measured.yaml", "--from", "rig/rig.yaml", *files)
    assert {c["target"]: c["role"] for c in found["columns"] if c["target"]} == {
        "shaker.u": "input", "load.x": "output", "shaker.a.f": "output"}
    text = Path("measured.yaml").read_text(encoding="utf-8")
    assert "#   damper.d: 150 N*s/m +- 20 %" in text
    records = figures("compare", "measured.yaml")["records"]
    assert [r["use"] for r in records.values()] == ["fit", "validate"]
    # what is proposed for the parameters is an experiment once the # are removed
    Path("measured.yaml").write_text(text.replace("# free:", "free:").replace("#   ", "  "), encoding="utf-8")
    assert set(load_experiment("measured.yaml").free) == {"spring.c", "damper.d", "load.m"}
    for given, code in ((("measured.yaml", "--from", "rig/rig.yaml", *files), "file-exists"),
                        (("other.yaml", *files), "usage"), (("other.yaml", "--from", "rig/rig.yaml"), "usage"),
                        (("other.yaml", "--from", "rig/rigg.yaml", *files), "file-missing"),
                        (("other.yaml", "--from", "rig/rig.yaml", "monday.csv"), "record-missing"),
                        (("other.txt", "--from", "rig/rig.yaml", *files), "file-suffix")):
        assert f"[{code}]" in call("new", *given).stderr, given


HEATED = """model: heated
components:
  heater: {is: HeatSource, u: 0 W}
  oil:    {is: HeatCapacity, m: 40 kg, c: 1900 J/(kg*K)}
  film:   {is: ThermalResistance, R: 0.02 K/W}
  air:    {is: Ambient, T_0: 22 degC}
nodes:
  oil: [heater.a, oil.a, film.a]
  air: [film.b, air.a]
simulate: {until: 10 s}
"""


def test_new_takes_clock_times_by_their_look_and_lists_what_a_column_may_be(folder: Path) -> None:
    Path("heated.yaml").write_text(HEATED, encoding="utf-8")
    rows = [f"2026-03-01 08:00:{5 * k:02d};1,5;{20 + k},5" for k in range(12)]
    Path("log.csv").write_text("Datum;Heizung kW;Tempo\n;kW;°C\n" + "\n".join(rows) + "\n", encoding="utf-8")
    found = figures("new", "measured.yaml", "--from", "heated.yaml", "log.csv")
    assert [(c["name"], c["role"]) for c in found["columns"]] == [("Datum", "time"), ("Heizung kW", "input"), ("Tempo", "")]
    assert "no column was recognised as an output: give the measured quantities under `outputs:`" in found["remarks"]
    text = Path("measured.yaml").read_text(encoding="utf-8")
    assert "#   oil.T: {column: Tempo, unit: degC}   # or air.T" in text
    Path("measured.yaml").write_text(text.replace("#   oil.T", "  oil.T"), encoding="utf-8")
    assert set(load_experiment("measured.yaml").outputs) == {"oil.T"}


def test_new_cuts_a_record_at_a_gap_of_an_input(folder: Path) -> None:
    Path("heated.yaml").write_text(HEATED, encoding="utf-8")
    rows = [f"{t},{t % 7},{20 + t / 10}" for t in range(60) if not 10 < t < 18]
    Path("log.csv").write_text("t_s,heater_kW,oil_degC\n" + "\n".join(rows) + "\n", encoding="utf-8")
    found = figures("new", "measured.yaml", "--from", "heated.yaml", "log.csv")
    assert [r for r in found["remarks"] if "gap" in r] == [
        "'heater_kW' of 'log.csv' has a gap: the record is cut to its longest part without one, `from: 18 s` to `to: 59 s`; "
        "`gaps: bridge` at an input goes across"]
    assert call("check", "measured.yaml").exit_code == 0


def test_new_names_the_rows_of_times_that_decrease(folder: Path) -> None:
    Path("heated.yaml").write_text(HEATED, encoding="utf-8")
    Path("log.csv").write_text("t_s,heater_kW,oil_degC\n2,1,21\n1,2,20.5\n0,1,20\n", encoding="utf-8")
    said = call("new", "measured.yaml", "--from", "heated.yaml", "log.csv").stderr
    assert "the time 1 in 't_s' (lines 3, 4) is less than the one before it [record-time-decreasing]" in said, said


# -- tables --------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("width", [74, 100, 120])
def test_lines_of_a_table_are_broken_between_words(width: int, monkeypatch: pytest.MonkeyPatch,
                                                   capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    row = ["dry friction", "RotationalDirectionalFriction", "between fast and the surroundings of the drum", "8.95"]
    console = terminal.output()
    console.print(terminal.table("", ("class", "effect", "place", "held out"), [row], text=3))
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= width
    assert all(word in " ".join(lines).split() for cell in row for word in cell.split())


def test_options_in_messages_are_options_of_a_command() -> None:
    """A hint such as `Give --from before --to` needs options of these names."""
    options = {option for name in cli.NAMES for parameter in cli.main.commands[name].params
               for option in (*parameter.opts, *parameter.secondary_opts)}
    unknown = []
    for path in sorted(Path(heavebond.__file__).parent.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)) if re.search("--[a-z]", text) else ():
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                words = re.findall(r"(?<![\w-])--[a-z][a-z-]*[a-z]", node.value)
                unknown += [f"{path.name}:{node.lineno}: {word}" for word in words if word not in options]
    others = {"--help", "--version", "--nthreads"}  # of click, of dask
    assert [text for text in unknown if text.split()[1] not in others and "__init__.py:1" not in text] == []


def test_the_package_is_run_by_its_name(tmp_path: Path) -> None:
    run, wrong = (subprocess.run([sys.executable, "-m", "heavebond", word, "Spring"], cwd=tmp_path, capture_output=True,
                                 text=True) for word in ("library", "librar"))
    assert "Did you mean 'run'?" in call("simulate", "rig.yaml").stderr  # the name of the function in Python
    assert run.returncode == 0 and "Linear translational spring" in run.stdout
    assert wrong.returncode == 2 and "Did you mean 'library'" in wrong.stderr
