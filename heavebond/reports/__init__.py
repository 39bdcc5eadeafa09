"""Pages on diagnoses and components, and summaries of models."""
