"""Studies: many cases of one model, swept, tuned, measured and set beside published figures."""
