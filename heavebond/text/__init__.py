"""YAML with places, expression grammar, dimensions, TeX."""
