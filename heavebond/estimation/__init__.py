"""Models and measurements: experiments, comparison, parameter estimation, identifiability."""
