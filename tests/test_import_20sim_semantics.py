# Wrong answers that an import of a 20-sim model must not give without a word: each with its solution in closed form.
"""Laws with choices, initial values, powers and quotients of matrices, and names that collide."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from test_import_20sim import one_part, run_part

from heavebond.import_20sim.importer import import_emx
from heavebond.language.library import library


@pytest.mark.parametrize(("body", "value"), [
    ("equations\n y = if (time > 1) == (time > 0.5) then 1 else 2 end;", lambda t: np.where((t > 0.5) & (t < 1), 2, 1)),
    ("parameters\n real k = 2;\nequations\n y = if time > 7 then 5 else k end;", lambda t: np.where(t > 7, 5, 2)),
    ("parameters\n real k = 2;\nequations\n y = min (k, 5.5 - time / 2);", lambda t: np.minimum(2, 5.5 - t / 2)),
])
def test_a_choice_far_away_is_no_constant(tmp_path: Path, body: str, value: object) -> None:
    run = run_part(tmp_path, one_part(body, "y", 9))
    apart = np.min(np.abs(run.time[:, None] - [0.5, 1, 7]), axis=1) > 1e-6
    assert run["Part.y"][apart] == pytest.approx(value(run.time)[apart])  # type: ignore[operator]


def test_a_gain_with_a_limit_far_away_is_no_gain(tmp_path: Path) -> None:
    body = "variables\n real u;\nequations\n u = 100 * time;\n y = if u > 50 then 50 else u end;"
    run = run_part(tmp_path, one_part(body, "y", 1))
    assert run["Part.y"][-1] == pytest.approx(50)


@pytest.mark.parametrize("law", [
    "ddt (x) = -x;", "x = int (-x);",
    "d = ddt (x, [3; 4]); d = -x;", "d = -x; d = ddt (x, [3; 4]);", "ddt (x, [3; 4]) = -x;"])
def test_initial_values_of_states(tmp_path: Path, law: str) -> None:
    """From `ddt (x, first)` on either side, and from initial equations where the law states none."""
    first = "" if "[3; 4]" in law else "initialequations\n x = [3; 4];\n"
    body = f"variables\n real x[2]{', d[2]' if 'd =' in law else ''};\n{first}equations\n {law}\n a = x[1]; b = x[2];"
    run = run_part(tmp_path, one_part(body, "a b"))
    assert run["Part.a"] == pytest.approx(3 * np.exp(-run.time), abs=1e-6)
    assert run["Part.b"] == pytest.approx(4 * np.exp(-run.time), abs=1e-6)


def test_an_initial_equation_against_the_value_of_the_integral_is_listed(tmp_path: Path) -> None:
    body = "variables\n real x;\ninitialequations\n x = 4;\nequations\n x = int (-x, 2);\n y = x;"
    assert run_part(tmp_path, one_part(body, "y"), untranslated=1)["Part.y"][0] == 2


def test_powers_and_quotients_of_matrices(tmp_path: Path) -> None:
    """`^` and `/` are those of matrices, `.^` acts on each element."""
    body = ("parameters\n real A[2,2] = [1, 2; 3, 4];\nvariables\n real P[2,2], E[2,2], Q[2,2], R[2,2], I[2,2];\nequations\n"
            " P = A ^ 2; E = A .^ 2; Q = A / [2, 0; 0, 4]; R = 2 / A; I = A ^ -1;\n"
            " y = P[1,2] + 0 * time; z = E[1,2]; q = Q[2,1] + 10 * Q[1,2]; r = R[1,1]; i = I[2,1];")
    run = run_part(tmp_path, one_part(body, "y z q r i"))
    values = [run[f"Part.{name}"][-1] for name in "yzqri"]
    assert values == pytest.approx([10, 4, 1.5 + 5, -4, 1.5])


@pytest.mark.parametrize("names", ["x_1, x[2]", "x[2], x_1"])
def test_elements_do_not_take_the_name_of_a_variable(tmp_path: Path, names: str) -> None:
    body = (f"variables\n real {names};\nequations\n x_1 = 5 * time; x[1] = 7 * time; x[2] = 9;\n"
            " a = x_1; b = x[1]; c = x[2];")
    run = run_part(tmp_path, one_part(body, "a b c"))
    assert [run[f"Part.{name}"][-1] for name in "abc"] == pytest.approx([10, 14, 9])


def test_a_discrete_state_in_code(tmp_path: Path) -> None:
    body = "variables\n real k;\ncode\n next (k, 5) = k + 2 * sampletime;\n y = hold (k);"
    run = run_part(tmp_path, one_part(body, "y"), untranslated=1)  # the sample time of 0.1 s
    assert run["Part.y"][np.argmin(np.abs(run.time - 1.05))] == pytest.approx(7)


@pytest.mark.parametrize("exponent", ["0.5", "17", "time", "-1e9"])
def test_a_power_of_a_matrix_that_is_not_whole_or_too_high_is_listed(tmp_path: Path, exponent: str) -> None:
    body = ("parameters\n real A[2,2] = [1, 2; 3, 4], c = 2;\nvariables\n real P[2,2];\nequations\n"
            f" P = (c * A) ^ ({exponent});\n y = P[1,2];")
    (tmp_path / "part.emx").write_text(one_part(body, "y"))
    made = import_emx(tmp_path / "part.emx", frozenset(library().names()))
    assert any("the exponent of a matrix" in u.reason for u in made.untranslated)
