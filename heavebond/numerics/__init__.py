"""From equations to runs: DAE functions, initialisation, integration, events, results, failure messages."""
