"""State estimation from running data, and detection of the time at which a record leaves its model."""
