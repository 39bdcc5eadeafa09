"""A machine looked at: linear system, energy, what may be left out."""
