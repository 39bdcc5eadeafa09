"""What all of them need: messages, units, processes, signals."""
