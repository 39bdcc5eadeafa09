"""Measured records and saved runs: reading, clocks, outliers, delays, spectra, error metrics."""
