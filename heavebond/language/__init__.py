"""What files say: components, diagrams, their laws."""
