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
FILE_BYTES = 20_000_000  # of a YAML file: read with marks it takes some 100 times as much memory
NESTING = 60  # of the entries of a YAML file
OF_A_KIND = 10_000  # copies of a part in line, ports of an array, and any other integer parameter
QUANTITY = 200  # characters of a number with its unit
FORMULA = 50_000  # characters of a formula
BRACKETS = 30  # within each other
OPERATIONS = 200  # of a formula one within the other: functions that walk its tree call themselves as often
TERMS = 100_000  # of a sum that is written out
