"""Energy: audit of a run, power flow, model simplification by activity."""
