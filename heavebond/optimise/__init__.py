"""Tuning: costs, sensitivities and adjoints, search, robustness."""
