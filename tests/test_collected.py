"""`for_each` runs every case, reports all failures, gives each case its own folder and patches; the choice of long tests."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest
from collected import for_each, partly


def test_all_failing_cases_are_reported_and_none_is_left_out() -> None:
    seen: list[int] = []

    @for_each("number", [1, 2, 3, 4], ids=lambda n: f"number {n}")
    def check(number: int) -> None:
        seen.append(number)
        assert number % 2, f"{number} is even"

    with pytest.raises(AssertionError) as raised:
        check()
    said = str(raised.value)
    assert seen == [1, 2, 3, 4]
    assert "2 of 4 cases fail" in said and "--- number 2" in said and "4 is even" in said and "number 3" not in said


def test_an_empty_list_of_cases_is_an_error() -> None:
    with pytest.raises(AssertionError, match="there is no case"):
        for_each("number", [])


def test_a_skipped_case_does_not_hide_a_failing_one() -> None:
    @for_each("number", [1, 2])
    def check(number: int) -> None:
        if number == 1:
            pytest.skip("not here")
        raise ValueError("at fault")

    with pytest.raises(AssertionError, match="1 of 2 cases fail"):
        check()


@for_each("name, text", [("a", "first"), ("b", "second")])
def test_each_case_has_its_folder_and_its_patches(name: str, text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
                                                  ) -> None:
    assert not list(tmp_path.iterdir())
    assert "OF_A_CASE" not in os.environ
    monkeypatch.setenv("OF_A_CASE", text)
    (tmp_path / name).write_text(text)


NUMBERS: list[int] = []


@for_each("number", range(7), parts=3)
def test_parts_divide_the_cases(number: int) -> None:
    NUMBERS.append(number)
    assert sorted(NUMBERS) == sorted(set(NUMBERS))


def test_of_a_sweep_every_third_case_runs_with_the_fast_tests() -> None:
    cases = partly([(1, "a"), (2, "b"), (3, "c"), (4, "d")], 3)
    assert [cases[0], cases[3]] == [(1, "a"), (4, "d")]
    assert [case.values for case in cases[1:3]] == [(2, "b"), (3, "c")]
    assert {mark.name for case in cases[1:3] for mark in case.marks} == {"long"}


@pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")
def test_make_reads_every_file_with_long_tests() -> None:
    folder = Path(__file__).parent
    texts = {f"tests/{path.name}": path.read_text(encoding="utf-8") for path in folder.glob("test_*.py")}
    long = {name for name, text in texts.items() if "mark.long" in text or "partly" in text}
    told = subprocess.run(["make", "--dry-run", "test-long"], cwd=folder.parent, capture_output=True, text=True, check=True)
    assert long == {word for word in told.stdout.split() if word.startswith("tests/test_")} and len(long) > 100
