"""Sizes beyond which input is refused: each far above what serves a purpose, and low enough that the refusal comes soon."""

from __future__ import annotations

# 1/s in nominal sizes: solvers square such rates, which overflows from 1e154 on, and then neither go on nor end
RATE = 1e100
# in SI units: squares and products of larger numbers overflow, and solvers then neither go on nor end; the mass of all that
# can be seen of the universe is 1e53 kg
NUMBER = 1e100
PROBLEMS_SHOWN = 20  # of one command; all are counted
OUTPUT_POINTS = 10_000_000  # of a run
COLUMNS = 5_000  # of a record
ENTRIES = 200_000  # keys and values of a YAML file; a chain of 5000 parts has some 60 000
FMU_VARIABLES = 5_000  # inputs, outputs and parameters of an FMU that becomes a component
