"""Predictive comparison of refits, flexible laws, probabilities."""
