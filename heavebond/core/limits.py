"""Upper limits of input sizes.

Each is far above any practical use, and low enough that the input is refused before it takes long to process.
"""

from __future__ import annotations

# 1/s in nominal sizes: solvers square such rates; squares above 1e154 overflow, and the integration does not end
RATE = 1e100
# in SI units: squares and products of larger numbers overflow, and the integration does not end
NUMBER = 1e100
PROBLEMS_SHOWN = 20  # problems printed by one command; all are counted
OUTPUT_POINTS = 10_000_000  # output points of a run
COLUMNS = 5_000  # samples of a record
ENTRIES = 200_000  # keys and values of a YAML file; a chain of 5000 parts has some 60 000
FMU_VARIABLES = 5_000  # inputs, outputs and parameters of an FMU that becomes a component
FILE_BYTES = 20_000_000  # bytes of a YAML file: with the place of every entry it takes about 100 times as much memory
NESTING = 60  # nesting of the entries of a YAML file
SYMBOL_BYTES = 100_000  # elements in the SVG file of a symbol; those of the library have less than 3000
# parts with their ports, parameters and variables in a diagram whose blocks are opened; 100 000 unknowns have some 200 000
EXPANDED = 1_000_000
OF_A_KIND = 10_000  # copies of a part in series, ports of an array, and any other integer parameter
QUANTITY = 200  # characters of a number with its unit
FORMULA = 50_000  # characters of a formula
BRACKETS = 30  # nested
OPERATIONS = 200  # nesting of a formula: the depth of recursion over its tree
TERMS = 100_000  # terms of an expanded sum
