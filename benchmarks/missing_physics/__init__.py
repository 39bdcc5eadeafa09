"""A benchmark of methods that find missing physics in a model: machines, records, hidden truth, score and entries."""
