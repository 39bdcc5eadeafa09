"""Models beside measurements: experiments, comparison, parameter estimation, identifiability."""
