"""The studio: a local page on which diagrams are seen, changed and run in the browser."""
