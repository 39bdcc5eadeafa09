"""Options of the test run."""

from __future__ import annotations

import os

import pytest

# what is tested is the assembler: nothing comes from an earlier run, nor is the user's own cache touched
os.environ["HEAVEBOND_CACHE"] = "off"


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--update-golden`: write what the program says now over the stored messages, to be read in the diff."""
    parser.addoption("--update-golden", action="store_true", help="rewrite the stored messages of tests/wrong")
