"""From a diagram to a reduced system of equations."""
