"""Options of the test run."""

from __future__ import annotations

import os

import pytest

os.environ.pop("COLUMNS", None)  # workers of the test run are told a terminal's width, which would fold all tables


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--update-golden`: write what the program says now over the stored messages, to be read in the diff."""
    parser.addoption("--update-golden", action="store_true", help="rewrite the stored messages of tests/wrong")
