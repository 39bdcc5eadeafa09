"""Evidence: residual tests, predictive comparison of refits, flexible laws, probabilities."""
