"""Models beside records: comparison, fit, diagnosis."""
