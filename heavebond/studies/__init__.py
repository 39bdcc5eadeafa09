"""Studies: many cases of one model, swept, tuned, measured and compared with published figures."""
