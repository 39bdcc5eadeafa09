"""Many runs of one model, derivatives, and models for other programs."""
