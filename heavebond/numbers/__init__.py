"""From equations to runs: start, integration, events."""
