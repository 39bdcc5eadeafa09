"""Scores, refits and stepwise selection of candidates."""
