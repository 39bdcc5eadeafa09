"""Bundled files with slips in them end in a run or in advice; a machine written differently gives the same run.

`make mutants` tries twenty thousand, and goes on where it was stopped.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

import heavebond as hb
from benchmarks.fuzz import mutate
from benchmarks.fuzz.campaign import Judge
from benchmarks.fuzz.metamorphic import DIFFERENCES, compared
from benchmarks.fuzz.mutants import Mutant, files_of, mutant, roots
from benchmarks.fuzz.relations import RELATIONS
from benchmarks.fuzz.trying import FAULTS, sandbox, tried, unfinished
from heavebond.core.errors import HeavebondError
from heavebond.language.library import bundled
from heavebond.numerics.simulator import Simulator

pytestmark = pytest.mark.long

LIMIT = 10.0  # s of processor time for each step that is tried with a mutant; drawings of the largest circuits take 5 s

EXAMPLES = ("spring", "cylinder", "end_cushion", "thermal_resistance", "receiver", "dc_motor", "torsion_spring")
MACHINES = (*(f"examples/{name}.yaml" for name in EXAMPLES), "quarter_car/quarter_car.yaml")
WEIGHT = """
model: hung
components: {wall: {is: Fixed}, spring: {is: Spring, c: 1 kN/m}, load: {is: Mass, m: 1 kg, AT}}
nodes: {wall: [wall.a, spring.a], load: [spring.b, load.a]}
simulate: {until: 1 s}
"""


@pytest.mark.parametrize("first", [first if first < 150 else pytest.param(first, marks=pytest.mark.slow)
                                   for first in range(0, 300, 50)])
def test_mutants_of_bundled_files_end_in_a_run_or_in_advice(first: int) -> None:
    """A controller that samples a thousand times as often runs a thousand times as long, which is no fault: a mutant that
    takes longer than a machine of the library does is run over a thousandth of its time."""
    judge = Judge(LIMIT, tried, unfinished)
    try:
        found = [mutate.patiently(judge, seed) for seed in range(first, first + 50)]
    finally:
        judge.close()
    assert not [(f.seed, f.outcome, f.what) for f in found if f.outcome in FAULTS]
    assert any(f.outcome == "ran" for f in found)


def test_what_is_written_beside_a_mutant_stays_in_its_folder() -> None:
    given = Mutant(0, bundled("models") / "spatial", "platform.yaml", dict(files_of("spatial/platform.yaml")), "", ())
    with sandbox(given) as path:
        (path.parent / "components" / "moved.yaml").write_text("component: Moved", encoding="utf-8")
        assert (path.parent / "components" / "platform_leg.yaml").is_file()
    assert not (bundled("models") / "spatial" / "components" / "moved.yaml").exists()


def test_a_seed_gives_the_same_mutant() -> None:
    assert mutant(12) == mutant(12) != mutant(13)
    given = mutant(12)
    assert given.mutations
    assert given.files != files_of(f"{given.folder.name}/{given.root}")


def test_every_bundled_file_that_can_be_run_may_be_chosen() -> None:
    assert len({*roots()}) > 300
    assert {"cmc_ahc/cmc_ahc.yaml", "passive_rig/friction.yaml", "examples/spring.yaml"} <= {*roots()}


@pytest.mark.parametrize("root", MACHINES)
def test_a_machine_written_differently_gives_the_same_run(root: str) -> None:
    folder, _, name = root.partition("/")
    with sandbox(Mutant(0, bundled("models") / folder, name, dict(files_of(root)), "", ())) as path:
        found = compared(path, tuple(RELATIONS), 7)
    assert not [f for f in found if f.outcome in DIFFERENCES]
    assert sum(f.outcome == "same" for f in found) >= 4


@pytest.mark.parametrize("root", ["circuits/log_splitter.yaml", "examples/weight.yaml", "examples/cylinder.yaml"])
def test_a_machine_with_its_axis_reversed_gives_the_same_run(root: str) -> None:
    folder, _, name = root.partition("/")
    with sandbox(Mutant(0, bundled("models") / folder, name, dict(files_of(root)), "", ())) as path:
        found, = compared(path, ("axis reversed",), 7)
    assert found.outcome == "same" and found.signals


def test_a_mutant_that_runs_is_written_differently_too() -> None:
    assert any({*tried(seed).steps} & {*RELATIONS} for seed in range(160, 400, 10))


def test_a_machine_that_is_another_one_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """The comparison itself: a spring that is 1e-4 stiffer is no longer the same."""
    from dataclasses import replace

    from benchmarks.fuzz.relations import Same

    def stiffer(given, assembly, random):
        parts = {**given.parts, "spring": {**given.parts["spring"], "c": "100.01 N/m"}}
        return Same(replace(given, parts=parts), lambda name: name)

    monkeypatch.setitem(RELATIONS, "stiffer", stiffer)
    spring = Mutant(0, bundled("models") / "examples", "spring.yaml", dict(files_of("examples/spring.yaml")), "", ())
    with sandbox(spring) as path:
        found, = compared(path, ("stiffer",), 1)
    assert found.outcome == "different"


def test_the_campaign_of_mutants_goes_on_where_it_was_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    results = tmp_path / "results.jsonl"
    monkeypatch.setattr(mutate, "WARM", 0)
    monkeypatch.setattr(mutate, "MEMORY", -1)
    for seeds in ("2", "3"):
        monkeypatch.setattr(sys, "argv", ["mutate", "--seeds", seeds, "--results", str(results)])
        mutate.main()
    assert [json.loads(line)["seed"] for line in results.read_text().splitlines()] == [0, 1, 2]
    assert mutate.summary(results)["mutants"] == 3


# -- what mutants have found -------------------------------------------------------------------------------------------
def test_a_stay_in_other_states_that_passes_between_two_output_points_is_no_fault() -> None:
    """Of a run that changes its states, one stretch may hold no output point."""
    assembly = hb.assemble(hb.load("mechanisms/double_pendulum"))
    times = np.linspace(0.0, 3.0, 4)
    result = Simulator(assembly, times=times).run()
    assert len(result.statistics["state_changes"]) > len(times)  # more stays than points: some hold none
    values = result.signals(list(assembly.model.show))
    assert all(np.isfinite(v).all() for v in values.values())


@pytest.mark.parametrize("place", ["[4, 1e20]", "[nan, 1]", "[inf, 1]"])
def test_a_place_far_off_any_sheet_is_refused(place: str) -> None:
    with pytest.raises(HeavebondError) as caught:
        hb.loads(WEIGHT.replace("AT", f"at: {place}"))
    assert {p.code for p in caught.value.problems} == {"at-bad"}


def test_what_is_not_found_is_answered_with_what_to_do_though_nothing_is_called_alike(tmp_path: Path) -> None:
    (tmp_path / "e.yaml").write_text("experiment: e\nmodel: zzzz.yaml\n", encoding="utf-8")
    (tmp_path / "f.yaml").write_text("experiment: f\nextends: qqqq.yaml\n", encoding="utf-8")
    (tmp_path / "s.yaml").write_text("study: s\nmodel: zzzz.yaml\n", encoding="utf-8")
    (tmp_path / "m.yaml").write_text(WEIGHT.replace(", AT", ""), encoding="utf-8")
    (tmp_path / "r.csv").write_text("time,load\n0,1\n1,2\n2,3\n", encoding="utf-8")
    for name, record in (("g", "absent.csv"), ("h", "r.csv"), ("i", "nowhere/absent.csv"), ("j", ".")):
        (tmp_path / f"{name}.yaml").write_text(
            f"experiment: {name}\nmodel: m.yaml\nrecords: {{one: {{file: {record}, use: fit}}}}\n"
            "time: {column: time, unit: s}\noutputs: {load.x: {column: qqqq, unit: m}}\n", encoding="utf-8")
    for name in "efghij":
        with pytest.raises(HeavebondError) as caught:
            hb.compare(tmp_path / f"{name}.yaml")
        assert all(p.hint.strip() for p in caught.value.problems), (name, caught.value.problems)
    with pytest.raises(HeavebondError) as caught:
        hb.load_study(tmp_path / "s.yaml")
    assert all(p.hint.strip() for p in caught.value.problems)
