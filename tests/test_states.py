"""The choice of columns by pivoted QR, which decides on the states."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg

from heavebond.equations.state_selection import LARGE, pivot_columns


@pytest.mark.parametrize("rows", [1, 2, 7, 40])
@pytest.mark.parametrize("seed", range(5))
def test_the_columns_are_those_of_lapack(rows: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    matrix = random.normal(size=(rows, 2 * rows + 1)) * (random.random((rows, 2 * rows + 1)) < 0.7)
    assert pivot_columns(matrix) == list(scipy.linalg.qr(matrix, mode="r", pivoting=True)[1][:rows])


def test_rows_that_depend_on_each_other_still_give_as_many_columns() -> None:
    matrix = np.array([[1.0, 2.0, 0.0, 0.0], [2.0, 4.0, 0.0, 0.0], [0.0, 0.0, 3.0, 0.0]])
    chosen = pivot_columns(matrix)
    assert chosen[:2] == [1, 2]
    assert len(set(chosen)) == 3


def test_both_ways_agree_at_the_border() -> None:
    random = np.random.default_rng(1)
    for rows in (LARGE, LARGE + 1):
        matrix = random.normal(size=(rows, rows + 20))
        lapack = scipy.linalg.qr(matrix, mode="r", pivoting=True)[1]
        assert pivot_columns(matrix) == list(lapack[:rows])
