"""Plots, drawings and animations."""
