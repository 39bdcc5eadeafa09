"""From a diagram to a reduced system of equations: expansion, node balances, structural analysis, index reduction."""
