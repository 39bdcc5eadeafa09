"""Localisation of model error: unknown-input estimation place by place."""
