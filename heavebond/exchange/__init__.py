"""Models for other programs: FMU, C, JSON Schema."""
