"""Input that is too large is refused early, in a sentence; problems are counted and the first twenty shown."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from click.testing import CliRunner

import heavebond as hb
from heavebond.cli import main
from heavebond.core import limits
from heavebond.core.errors import ModelError, Place, Problem, Problems
from heavebond.language import fmu_description
from heavebond.records.measurements import read_table
from heavebond.text.yaml_source import parse


def unconnected(number: int) -> str:
    parts = "".join(f"  s{k}: {{is: Spring, c: 1 kN/m}}\n" for k in range(number))
    return f"model: many\ncomponents:\n{parts}nodes: {{}}\nsimulate: {{until: 1 s}}\n"


def test_ten_thousand_problems_are_compared_by_their_hash(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each new problem was compared with all before it: counted are the comparisons, which must not grow with the square."""
    compared = 0
    equal = Problem.__eq__

    def counted(self: Problem, other: object) -> bool:
        nonlocal compared
        compared += 1
        return equal(self, other)

    monkeypatch.setattr(Problem, "__eq__", counted)
    problems = Problems()
    for _ in range(2):
        for k in range(3000):
            problems.add("code", f"part {k}", Place("file", k + 1))
    assert len(problems.found) == 3000 and compared < 9000


def test_problems_are_counted_and_the_first_twenty_shown(tmp_path: Path) -> None:
    (tmp_path / "many.yaml").write_text(unconnected(40))
    ended = CliRunner().invoke(main, ["check", str(tmp_path / "many.yaml")])
    assert ended.exit_code == 1
    assert ended.output.count("[port-unconnected]") + ended.output.count("[port-open]") <= limits.PROBLEMS_SHOWN
    assert "80 problems, the first 20 are shown" in ended.output
    with pytest.raises(hb.ModelError) as caught:
        hb.assemble(hb.loads(unconnected(40)))
    assert len(caught.value.problems) == 80 and str(caught.value).endswith("and 60 more problems")


def test_a_record_with_a_hundred_thousand_columns_is_refused_before_its_cells_are_read(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("heavebond.records.text_tables._numbers", lambda cells: pytest.fail("cells are read"))
    names = ",".join(f"c{k}" for k in range(100_000))
    (tmp_path / "wide.csv").write_text(f"{names}\n{names.replace('c', '')}\n")
    with pytest.raises(hb.DataError, match=r"100000 columns; up to 5000 are read \[record-columns\]"):
        read_table(tmp_path / "wide.csv")


def test_a_file_of_hundreds_of_thousands_of_keys_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("heavebond.text.yaml_source.ENTRIES", 2000)
    parse("model: a\nnodes:\n" + "".join(f"  k{k}: v\n" for k in range(900)))
    with pytest.raises(ModelError, match=r"more than 2000 keys and values \[file-too-long\]"):
        parse("model: a\nnodes:\n" + "".join(f"  k{k}: v\n" for k in range(1100)))
    assert limits.ENTRIES < 2 * 280_000


def test_an_fmu_with_sixty_thousand_parameters_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    variable: dict[str, Any] = {"causality": "parameter", "type": "Real", "dimensions": []}
    told = SimpleNamespace(fmiVersion="3.0", coSimulation=SimpleNamespace(hasEventMode=False), unitDefinitions=[],
                           modelVariables=[SimpleNamespace(name=f"p{k}", **variable) for k in range(60_000)])
    monkeypatch.setattr(fmu_description, "_read", lambda path: told)
    monkeypatch.setattr(fmu_description, "_variables", lambda *given: pytest.fail("variables are read"))
    with pytest.raises(ModelError, match="60000 inputs, outputs and parameters; up to 5000 are read"):
        fmu_description.described(tmp_path / "large.fmu")


SLIDING = """
model: sliding
components:
  drive: {is: ForceSource, u: "=10 N*sw.y"}
  load: {is: Mass, m: 1 kg}
  sw: {is: Relay, u_on: BAND m/s, u_off: -BAND m/s, y_on: -1, y_off: 1, u: "=n.v"}
nodes: {n: [drive.a, load.a]}
initial: {n.x: 0 m, n.v: 0.01 m/s}
simulate: {until: 10 s}
"""


@pytest.mark.long
def test_a_relay_in_sliding_mode_ends_with_a_message_that_names_it() -> None:
    with pytest.raises(hb.SimulationError, match=r"'sw\.[^\n]* switched 500 times within [^\n]*\[event-sliding\]") as caught:
        hb.simulate(hb.loads(SLIDING.replace("BAND", "1e-6")))
    assert "u_on" in caught.value.problems[0].hint
    # the same relay with a band that a machine has
    assert len(hb.simulate(hb.loads(SLIDING.replace("BAND", "0.2")), until="5 s").events) > 50


RIGID = """
model: rigid
components: {wall: {is: Fixed}, spring: {is: Spring, c: STIFF}, load: {is: Mass, m: 250 kg}}
nodes: {top: [wall.a, spring.a], bottom: [spring.b, load.a]}
initial: {bottom.x: BEGIN}
simulate: {until: 2 s}
"""


@pytest.mark.parametrize("stiffness", ["=1e90 kN/m*1e90", "=1e90 kN/m*1e90*1e90"])
def test_a_stiffness_beyond_what_solvers_count_is_refused_at_the_start(stiffness: str) -> None:
    """In a process of its own: without the check the integrator neither goes on nor ends."""
    script = f"""
import heavebond as hb
for x in ("1 mm", "0 mm"):
    model = hb.loads('''{RIGID}'''.replace("STIFF", "{stiffness}").replace("BEGIN", x))
    try:
        hb.simulate(model)
    except hb.HeavebondError as error:
        print(error.problems[0].code)
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=120, check=False)
    assert done.stdout.split() == ["rate-too-large"] * 2, (done.stdout, done.stderr)


@pytest.mark.parametrize("text", ["1e200 N/m", "=2e101 N/m", "1e98 kN/m", "=1e98 kN/m", "-1e101 N/m"])
def test_a_number_that_solvers_cannot_count_with_is_refused_where_it_is_read(text: str) -> None:
    with pytest.raises(hb.ModelError, match="The largest number is 1e\\+100 in SI units") as caught:
        hb.loads(RIGID.replace("STIFF", f'"{text}"').replace("BEGIN", "0 mm"))
    assert [p.code for p in caught.value.problems] == ["number-too-large"]


def test_the_page_states_the_limits_that_hold() -> None:
    page = (Path(__file__).parents[1] / "docs" / "reading_errors.md").read_text(encoding="utf-8")
    table = page.partition("| limit | of |")[2].partition("\n\n")[0].splitlines()[2:]
    stated = sorted(float(row.split("|")[1].replace(" ", "")) for row in table)
    held = {name: value for name, value in vars(limits).items() if name.isupper() and name != "PROBLEMS_SHOWN"}
    assert {*stated} == {float(value) for value in held.values()}
    assert f"the first {limits.PROBLEMS_SHOWN} are shown" in page


def test_an_equation_for_a_billion_indices_is_refused(tmp_path: Path) -> None:
    (tmp_path / "components").mkdir()
    (tmp_path / "components" / "long.yaml").write_text("""
component: Long
summary: An equation that is repeated too often.
ports: {a: translational}
variables: {y: {unit: N, count: n}}
parameters: {n: {unit: 1, integer: true, default: 3}}
equations: |
  a.f = sum(y[i] for i in 1..n)
  each i in 1..1000000000: y[i] = 0
""", encoding="utf-8")
    (tmp_path / "m.yaml").write_text("model: m\ncomponents: {l: {is: Long}, m: {is: Mass, m: 1 kg}}\n"
                                     "nodes: {a: [l.a, m.a]}\nsimulate: {until: 1 s}\n", encoding="utf-8")
    with pytest.raises(ModelError, match="Long has 10001 equations for 4 unknowns"):
        hb.assemble(hb.load(tmp_path / "m.yaml"))
