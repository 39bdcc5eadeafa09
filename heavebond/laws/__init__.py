"""Laws outside the catalogue: closed formulas for the effect that a model lacks."""
