"""Import of models of other programs."""
