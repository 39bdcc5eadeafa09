"""Identification of unmodelled physics: catalogue of effects, scoring, refits, selection, experiment design."""
