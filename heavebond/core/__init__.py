"""Foundations of every package: errors, units, numbers as text, output files, parallel work, cancellation."""
