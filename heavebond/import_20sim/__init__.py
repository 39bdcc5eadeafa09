"""Import of 20-sim models (.emx): SIDOPS text to diagrams, blocks and component files."""
