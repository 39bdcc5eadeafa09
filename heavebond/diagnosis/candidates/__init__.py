"""Candidates: effects of the catalogue at the places of a diagram."""
